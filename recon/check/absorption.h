/* absorption.h - how much a flame absorbs of its own light, from what cameras see that had no part in the volume.
 *
 *     c = argmin of F(c) = sum over left-out pictures k, their bins:  ( I_c(E_k) - b_k )^2           (1)
 *     E_k: emission along the bins' rays in the volume of the others, reconstructed with c (unseen.h)
 *     I_c: what is seen of it (absorb.h)
 * An absorbing flame looks thinner than it is where it is deep.  From another side it is deep elsewhere, so
 * volumes with a wrong c miss the pictures that they were not made from.  Residuals of the pictures they
 * were made from do not tell: thin sheets leave more of those than absorption does.
 * c is looked for among those that give the brightest bin of all cameras but one an optical depth of 0 .. 6, then between the three
 * best.  It is believed where
 *     gain = (F(0) - F(c)) / (F(0) - N) >= REC_ABSORPTION_GAIN,   N: what noise alone makes of F           (2)
 * and three quarters of the pictures get better;
 * else nothing absorbs.  A flame that looks alike from all sides says nothing: c stays 0 (NUMERICS.md).
 * Cost: 9 x REC_ABSORPTION_VIEWS solves of unseen's grid, a second or two.
 * Threads: as unseen.h. */
#ifndef REC_ABSORPTION_H
#define REC_ABSORPTION_H
#include "recon/check/judge.h"

#define REC_ABSORPTION_GAIN  0.12
#define REC_ABSORPTION_SETS  4  /* at most, evenly spread */
#define REC_ABSORPTION_VIEWS 16 /* left out of all of them together, one after the other */
#define REC_ABSORPTION_LEAST 3  /* cameras of a set; two others make no volume else */

struct rec_absorption {
    double c;                 /* 1 over pixel value; 0: none that is worth it */
    double best, depth, gain; /* argmin of (1); at the brightest bin; (2) */
    double missed[2], noise;  /* (F / sum b^2)^(1/2) at 0 and at the best of those tried; N's */
    double brightest;         /* that bin, of all cameras but one */
    uint32_t sets, views;     /* with a flame; pictures left out */
    uint32_t better;          /* of them */
};

/* Errors: PVX_ECANCELED (the source's progress); PVX_ENOENT: no set has a flame in three cameras; those of
 * the source and of rec_unseen_solve. */
PVX_MUST_CHECK pvx_err rec_absorption_find(rec_unseen *u, const struct rec_check_source *sets,
                                           struct rec_absorption *out, struct pvx_diag *d);

#endif
