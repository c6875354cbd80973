/* parts.h - the pieces of error bars that bars.c and running.c share: (3) to (5) of bars.h without the sums.
 * Threads: pure, except rec_bars_detail, which uses the spread's work areas.  Private to recon/frame. */
#ifndef REC_FRAME_PARTS_H
#define REC_FRAME_PARTS_H
#include "recon/frame/bars.h"
#include "recon/frame/spread.h"
#include "recon/solve/perturb.h"

/* Factor by which a deviation from n of them is longer, since so few say little about their size. */
double rec_bars_student(double n);
/* j^2 of (3): `left` groups of `cameras`, of a solve with this report. */
double rec_bars_groups(const struct rec_solve_report *r, uint32_t cameras, uint32_t left);
/* sigma and share of the prior of a draw into p, and the factor on its deviation, (4) without sqrt n, into by.  alone:
 * without J.  detail: of rec_bars_detail. */
void rec_bars_drawn(const struct rec_perturb_fit fit[4], int nch, bool alone, double detail,
                    struct rec_perturbation *p, double by[4]);
/* Iterations of a repeated solve, where the solve has this report; of J with so many cameras, 0: of D. */
uint32_t rec_bars_iterations(const struct rec_solve_report *r, uint32_t cameras);
/* d of (5) from x; mean: a work area [n][cs].  Returns R. */
double rec_bars_detail(struct rec_spread *s, const struct rec_perturb_fit fit[4], uint32_t cameras,
                       const float *x, float *mean, float *d);
uint32_t rec_bars_doubt(const struct rec_perturb_fit fit[4], int nch, uint32_t cameras,
                        double detail);

#endif
