/* slot.h - a slot looked into, for tests and benches of one frame set at a time (rec_frame_alone). */
#ifndef SLOT_H
#define SLOT_H
#include "recon/frame/impl.h"
#include "recon/solve/start.h"

/* One problem from x on: an earlier volume, or zero. */
static inline pvx_err solve_from(rec_problem *pb, const struct rec_subsys *a,
                                 const struct rec_pictures *in, const struct rec_solve_params *p,
                                 float *x, struct rec_solve_report *out)
{
    rec_problem_load(pb, a, in);
    rec_start_earlier(pb, x);
    return rec_solve(pb, p, x, out);
}

/* What a carved slot's system is solved for, with noise sigma. */
static inline struct rec_pictures slot_pictures(const rec_frame *f, double sigma)
{
    struct rec_pictures in = rec_frame_pictures(f);
    for (int l = 0; l < 4; l++)
        in.sigma[l] = sigma;
    return in;
}

#endif
