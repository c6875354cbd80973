/* slot.h - a slot with a carver and a solver of its own, for tests and benches of one frame set at a time. */
#ifndef SLOT_H
#define SLOT_H
#include "recon/frame/impl.h"
#include "recon/solve/start.h"

static inline void slot_free(rec_frame **f)
{
    if (*f == NULL)
        return;
    rec_carver *k = (*f)->carver;
    rec_solver *s = (*f)->solver;
    rec_frame_free(f);
    rec_carver_free(&k);
    rec_solver_free(&s);
}

static inline pvx_err slot_new(const rec_sysmat *S, const struct rec_rig *rig,
                               const struct rec_frame_params *p, pvx_pool *pool, rec_frame **out,
                               struct pvx_diag *d)
{
    rec_carver *k = NULL;
    rec_solver *s = NULL;
    *out = NULL;
    pvx_err e = rec_carver_new(S, rig, p, pool, &k, d);
    if (e == PVX_OK)
        e = rec_solver_new(S, p, &s, d);
    if (e == PVX_OK)
        e = rec_frame_new(k, s, out, d);
    if (e != PVX_OK) {
        rec_carver_free(&k);
        rec_solver_free(&s);
    }
    return e;
}

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
    in.sigma = sigma;
    return in;
}

#endif
