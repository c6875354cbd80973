/* shot.h - pixels with noise, the same for every solver, and the same calls that the daemon makes. */
#ifndef BENCH_SHOT_H
#define BENCH_SHOT_H
#include "bench.h"

/* ---- what the cameras deliver ------------------------------------------------------------------- */

struct noise {
    const char *name;
    double sigma; /* share of the peak */
    double blue;  /* sigma of the last channel, where it has one of its own; else 0 */
};
static const struct noise noise_0 = {"0 %", 0, 0}, noise_1 = {"1 %", 0.01, 0},
                          noise_5 = {"5 %", 0.05, 0};

/* Pixels of one instant, ready to be copied into a slot: every solver gets the same ones. */
struct shot {
    size_t n_cameras, floats[REC_MAX_CAMERAS];
    float *px[REC_MAX_CAMERAS]; /* [h][w][cs] */
};

static inline void shot_new(struct shot *t, const struct scene *s, const struct noise *noise,
                            uint64_t seed)
{
    size_t nch = (size_t)s->nch, cs = nch == 3 ? 4 : 1;
    bench_seed(seed);
    *t = (struct shot){.n_cameras = s->rig.n_cameras};
    for (size_t c = 0; c < t->n_cameras; c++) {
        size_t n = (size_t)s->rig.cameras[c].width * (size_t)s->rig.cameras[c].height;
        t->floats[c] = n * cs;
        t->px[c] = must_floats(n * cs);
        for (size_t i = 0; i < n; i++)
            for (size_t ch = 0; ch < nch; ch++) {
                double v = s->image[c][i * nch + ch];
                if (noise->sigma > 0)
                    v += (ch == 2 && noise->blue > 0 ? noise->blue : noise->sigma) * s->peak *
                         bench_normal();
                t->px[c][i * cs + ch] = (float)v;
            }
    }
}

static inline void shot_free(struct shot *t)
{
    for (size_t c = 0; c < t->n_cameras; c++)
        free(t->px[c]);
}

static inline void shot_put(const struct shot *t, rec_frame *f)
{
    rec_frame_reset(f);
    for (size_t c = 0; c < t->n_cameras; c++) {
        memcpy(rec_frame_input(f, c), t->px[c], t->floats[c] * sizeof(float));
        rec_frame_camera(f, c)->present = true;
    }
}

/* ---- a solver and a matrix ----------------------------------------------------------------------- */

/* A solver's own stop on one shot, the volume dense [values]; the shorter of two times. */
static inline struct rec_frame_report solve_once(const struct scene *s, const struct shot *shot,
                                                 const rec_sysmat *S, const char *solver,
                                                 pvx_pool *pool, float *dense, double *least_ms)
{
    struct rec_frame_params p = rec_frame_defaults;
    struct rec_sparse v;
    rec_frame *slot;
    p.nch = s->nch;
    p.photo.saturation = 1e30F;
    p.solve.solver = solver;
    CHECK(rec_frame_alone(S, &s->rig, &p, pool, &slot, NULL));
    shot_put(shot, slot);
    rec_frame_carve(slot);
    *least_ms = INFINITY;
    for (int r = 0; r < 2; r++) { /* the first one touches pages */
        int64_t t0 = pvx_now_mono();
        CHECK(rec_frame_solve(slot, 0, NULL));
        *least_ms = fmin(*least_ms, ms(pvx_now_mono() - t0));
    }
    rec_frame_volume(slot, &v);
    rec_sparse_to_dense(&v, dense);
    struct rec_frame_report r = *rec_frame_get_report(slot);
    rec_frame_free(&slot);
    return r;
}

/* The matrix of a scene's rig and grid, unbinned. */
static inline rec_sysmat *scene_matrix(const struct scene *s, int32_t rays, pvx_pool *pool)
{
    struct rec_sysmat_params p = {.binning = 1, .rays_per_bin = rays};
    rec_sysmat *S;
    CHECK(rec_sysmat_build(&s->rig, &p, pool, NULL, NULL, &S, NULL));
    return S;
}

#endif
