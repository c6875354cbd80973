/* curve.h - error against time, measured from outside: the same call that the daemon makes.
 *
 * A point of a curve is one iteration budget: the whole of rec_frame_solve with that budget, repeated,
 * its shortest time and the error of what it returned.  So a curve contains everything that a solver
 * does before its first iteration and after its last one, whatever that is, and needs no trace.
 * Points of a sequence are means over its frames; warm = each frame starts from the volume before. */
#ifndef BENCH_CURVE_H
#define BENCH_CURVE_H
#include "bench.h"

/* ---- what the cameras deliver ------------------------------------------------------------------- */

struct noise {
    const char *name;
    double sigma; /* share of the peak */
    bool bits8;   /* rounded and clipped to 0..255 as an 8-bit camera does, silhouettes included */
};
static const struct noise noise_0 = {"0 %", 0, false}, noise_1 = {"1 %", 0.01, false},
                          noise_5 = {"5 %", 0.05, false}, noise_8bit = {"1 % 8-bit", 0.01, true},
                          noise_5_8bit = {"5 % 8-bit", 0.05, true};

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
        t->px[c] = bench_floats(n * cs);
        for (size_t i = 0; i < n; i++)
            for (size_t ch = 0; ch < nch; ch++) {
                double v = s->image[c][i * nch + ch];
                if (noise->sigma > 0)
                    v += noise->sigma * s->peak * bench_normal();
                if (noise->bits8)
                    v = fmin(255, fmax(0, floor(255 * v + 0.5))) / 255;
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
        rec_frame_present(f, c, true);
    }
}

/* ---- one point ---------------------------------------------------------------------------------- */

/* What is reconstructed: frames of one rig in time order, their matrix and pixels. */
struct course {
    const struct scene *scene; /* [n] */
    const struct shot *shot;   /* [n] */
    int n, from;               /* frames before `from` are solved, not counted */
    const rec_sysmat *S;
    pvx_pool *pool;
};

struct setting {
    const char *solver;
    enum rec_stop stop;
    uint32_t iterations;
    bool warm;
    bool look;                                               /* judge the unseen view too */
    bool once;                                               /* the time does not matter */
    void (*after)(void *ctx, int frame, const float *dense); /* NULL: nothing */
    void *ctx;
};

struct point {
    double ms;        /* rec_frame_solve, mean over frames */
    struct quality q; /* mean over frames; views only if asked for */
    double iterations;
    enum rec_status status; /* of the last frame */
    struct rec_frame_report report;
};

/* Shortest time of rec_frame_solve on a carved slot.  The first run touches pages that the others
 * find mapped; the solution is the same each time.  Two runs at least (patience_ms 0: one). */
static inline double shortest(rec_frame *f, const struct rec_sparse *previous, double patience_ms)
{
    double best = 1e300, spent = 0;
    for (int r = 0; r < 9; r++) {
        int64_t t0 = pvx_now_mono();
        CHECK(rec_frame_solve(f, 0, previous));
        double t = ms(pvx_now_mono() - t0);
        best = fmin(best, t);
        spent += t;
        if (patience_ms == 0 || spent > 400 || (r >= 1 && spent > patience_ms))
            break;
    }
    return best;
}

static inline struct point measure(const struct course *c, const struct setting *set)
{
    struct rec_frame_params p = rec_frame_defaults;
    struct point out = {0};
    size_t nch = (size_t)c->scene->nch, values = rec_grid_count(&c->S->grid) * nch;
    float *dense = bench_floats(values);
    rec_frame *f[2] = {NULL, NULL};
    struct rec_sparse volume[2];
    int counted = c->n - c->from;

    p.nch = c->scene->nch;
    p.photo.saturation = 1e30f;
    p.solve.solver = set->solver;
    p.solve.stop = set->stop;
    p.solve.iterations = set->iterations;
    for (int i = 0; i < (c->n > 1 ? 2 : 1); i++) /* as in a pipeline: the volume before stays */
        CHECK(rec_frame_new(c->S, &c->scene->rig, &p, c->pool, &f[i], NULL));
    for (int i = 0; i < c->n; i++) {
        rec_frame *now = f[i % 2];
        bool count = i >= c->from;
        if (!count && !set->warm)
            continue;
        shot_put(&c->shot[i], now);
        rec_frame_carve(now);
        double patience = set->once || !count ? 0 : c->n > 1 ? 1 : 30;
        double t = shortest(now, set->warm && i > 0 ? &volume[(i + 1) % 2] : NULL, patience);
        rec_frame_volume(now, &volume[i % 2]);
        rec_sparse_to_dense(&volume[i % 2], dense);
        out.report = *rec_frame_get_report(now);
        out.status = out.report.solve.status;
        if (set->after != NULL)
            set->after(set->ctx, i, dense);
        if (!count)
            continue;
        struct quality q = {.volume = rec_rel_l2(dense, c->scene[i].truth, values)};
        if (set->look)
            q = judge(&c->scene[i], dense, c->pool);
        out.ms += t / counted;
        out.iterations += (double)out.report.solve.iterations / counted;
        out.q.volume += q.volume / counted;
        out.q.view += q.view / counted;
        out.q.psnr += q.psnr / counted;
        out.q.ssim += q.ssim / counted;
    }
    for (int i = 0; i < 2; i++)
        rec_frame_free(&f[i]);
    free(dense);
    return out;
}

/* ---- curves ------------------------------------------------------------------------------------- */

static const uint16_t budgets[] = {1,  2,  3,  4,  5,  6,  7,  8,  9,  10, 11,
                                   12, 14, 16, 20, 24, 32, 48, 64, 80, 100};
#define N_BUDGETS ((int)(sizeof budgets / sizeof *budgets))

struct curve {
    int n, best; /* best: smallest volume error */
    uint32_t k[N_BUDGETS];
    struct point at[N_BUDGETS];
};

/* The solver of `like`, started and judged as it says; stops at `k_limit` iterations, or past
 * `ms_limit`. */
static inline void curve_measure(const struct course *c, const struct setting *like,
                                 uint32_t k_limit, double ms_limit, struct curve *out)
{
    struct setting set = *like;
    *out = (struct curve){0};
    set.stop = REC_STOP_ITERATIONS;
    for (int i = 0; i < N_BUDGETS && budgets[i] <= k_limit; i++) {
        set.iterations = budgets[i];
        out->k[i] = budgets[i];
        out->at[i] = measure(c, &set);
        out->n = i + 1;
        if (out->at[i].q.volume < out->at[out->best].q.volume)
            out->best = i;
        if (out->at[i].ms > ms_limit)
            break;
    }
}

/* Last point within a time, or -1. */
static inline int curve_by(const struct curve *c, double t_ms)
{
    int at = -1;
    for (int i = 0; i < c->n; i++)
        if (c->at[i].ms <= t_ms && (at < 0 || c->at[i].ms >= c->at[at].ms))
            at = i;
    return at;
}

/* Shortest time that gives a volume error of `error` or less; +inf when none does. */
static inline double curve_reach(const struct curve *c, double error)
{
    double t = INFINITY;
    for (int i = 0; i < c->n; i++)
        if (c->at[i].q.volume <= error)
            t = fmin(t, c->at[i].ms);
    return t;
}

/* ---- matrices ----------------------------------------------------------------------------------- */

/* The matrix of a scene's rig and grid, unbinned; *build_s may be NULL. */
static inline rec_sysmat *scene_matrix(const struct scene *s, int32_t rays, pvx_pool *pool,
                                       double *build_s)
{
    struct rec_sysmat_params p = {.binning = 1, .rays_per_bin = rays};
    rec_sysmat *S;
    int64_t t0 = pvx_now_mono();
    CHECK(rec_sysmat_build(&s->rig, &p, pool, NULL, NULL, &S, NULL));
    if (build_s != NULL)
        *build_s = (double)(pvx_now_mono() - t0) * 1e-9;
    return S;
}

#endif
