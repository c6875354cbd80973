/* absorption.h - how much a flame absorbs of its own light, from pictures of cameras that had no part in the volume.
 *
 *     c = argmin of F(c) = sum over left-out pictures k, their bins:  ( I_c(E_k) - b_k )^2           (1)
 *     E_k: emission along the bins' rays in the volume of the others, reconstructed with c (unseen.h)
 *     I_c: the visible part of it (absorb.h)
 * An absorbing flame looks thinner than it is where it is deep.  From another side it is deep elsewhere, so volumes
 * with a wrong c do not match pictures that had no part in them.  The residuals of the pictures that made the volume
 * do not show c: thin sheets of flame leave larger ones than absorption does.
 * The search tries values of c that give an optical depth of 0 .. 6 to the brightest bin of all cameras but one, then
 * values between the three best.  c is accepted where
 *     gain = (F(0) - F(c)) / (F(0) - N) >= REC_ABSORPTION_GAIN,   N: the part of F that noise alone makes    (2)
 * and at least REC_ABSORPTION_SURE standard errors, from how the pictures differ, and three quarters of the pictures
 * improve; otherwise c = 0.  A flame that looks alike from all sides gives no information, so c stays 0 (NUMERICS.md).
 * Cost: 9 x REC_ABSORPTION_VIEWS solves of unseen's grid, a second or two.
 * Threads: as unseen.h. */
#ifndef REC_ABSORPTION_H
#define REC_ABSORPTION_H
#include "recon/check/judge.h"

#define REC_ABSORPTION_GAIN  0.12
#define REC_ABSORPTION_SURE  2
#define REC_ABSORPTION_SETS  4  /* at most, evenly spread */
#define REC_ABSORPTION_VIEWS 16 /* pictures left out over all sets together, one at a time */
#define REC_ABSORPTION_LEAST 3  /* cameras of a set, so that at least two others make the volume */

struct rec_absorption {
    double c;                 /* 1 / pixel value; 0: none was accepted */
    double best, depth, gain; /* argmin of (1); optical depth at the brightest bin; (2) */
    double unsure;            /* standard error of the gain, from how the pictures differ */
    double missed[2], noise;  /* (F / sum b^2)^(1/2) at 0 and at the best c tried; that of N */
    double brightest;         /* value of that bin */
    uint32_t sets, views;     /* sets with a flame; pictures left out */
    uint32_t better;          /* pictures that improve */
};

/* Errors: PVX_ECANCELED (the source's progress); PVX_ENOENT: no set has a flame in three cameras; those of
 * the source and of rec_unseen_solve. */
PVX_MUST_CHECK pvx_err rec_absorption_find(rec_unseen *u, const struct rec_check_source *sets,
                                           struct rec_absorption *out, struct pvx_diag *d);

#endif
