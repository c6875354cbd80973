/* holdout.h - how well volumes predict the pictures of cameras that had no part in them: the figure that compares
 * settings where no truth is known.
 *
 *     e^2 = sum over left-out pictures k of || I(S_k x_others) - b_k ||^2 / sum of || b_k ||^2         (1)
 * over bins that are lit or have light in the volume; I: absorb.h.
 * Cost: a solve of unseen's grid for each of them.  Threads: as unseen.h. */
#ifndef REC_HOLDOUT_H
#define REC_HOLDOUT_H
#include "recon/check/judge.h"

/* Numerator of (1) of camera k.  The set was loaded without absorption; the volume is of other cameras, solved
 * with absorption c.  *all, unless NULL: the denominator. */
double rec_holdout_miss(rec_unseen *u, size_t k, double c, double *all);

/* Sum of sigma^2 over its lit bins of positive weight: the part of the numerator that noise alone makes. */
double rec_holdout_noise(const rec_unseen *u, size_t k);

/* (1) over at most `sets` sets and `views` pictures, evenly spread; every `step`-th of the other cameras makes the
 * volume, 1 = all of them.  absorption: c of I.  *ms: time of a solve, mean.  Errors: PVX_ENOENT: no set has a flame
 * in three cameras that make volumes; PVX_ECANCELED; those of the source and of rec_unseen_solve. */
struct rec_holdout_params {
    size_t sets, views, step;
    double absorption;
};
PVX_MUST_CHECK pvx_err rec_holdout(rec_unseen *u, const struct rec_check_source *from,
                                   const struct rec_holdout_params *p, double *error, double *ms);
/* Cameras that see a flame in the set that is loaded. */
size_t rec_holdout_who(const rec_unseen *u, bool *sees);

/* Standard error of the sum of what n left-out pictures gain by a change, from how they differ; one: INFINITY. */
double rec_holdout_unsure(const double *gain, size_t n);

#endif
