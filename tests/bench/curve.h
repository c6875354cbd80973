/* curve.h - error against time, measured from outside: the same calls that the daemon makes.
 *
 * A point of a curve is one iteration budget (or one deadline): the whole of rec_frame_solve with it,
 * repeated, its shortest time and the error of what it returned.  So a curve contains everything that
 * a solver does before its first iteration and after its last one, and needs no trace.  What a solver
 * has prepared while the system is restricted, beyond the restriction that all need, is added.
 * Points of a sequence are means over its frames; warm = each frame starts from the volume before. */
#ifndef BENCH_CURVE_H
#define BENCH_CURVE_H
#include "bench.h"

/* ---- what the cameras deliver ------------------------------------------------------------------- */

struct noise {
    const char *name;
    double sigma; /* share of the peak */
    bool bits8;   /* rounded and clipped to 0..255 as an 8-bit camera does, silhouettes included */
    double blue;  /* sigma of the last channel, where it has one of its own; else 0 */
};
static const struct noise noise_0 = {"0 %", 0, false, 0}, noise_1 = {"1 %", 0.01, false, 0},
                          noise_5 = {"5 %", 0.05, false, 0},
                          noise_8bit = {"1 % 8-bit", 0.01, true, 0};

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
        rec_frame_camera(f, c)->present = true;
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
    double restrict_ms; /* of the restriction alone, mean over frames; course_base */
};

struct setting {
    const char *solver;
    enum rec_stop stop;
    uint32_t iterations;
    double deadline_ms; /* from the call on; 0: none */
    bool warm;
    bool look;                                               /* judge the unseen view too */
    bool once;                                               /* the time does not matter */
    void (*after)(void *ctx, int frame, const float *dense); /* NULL: nothing */
    void *ctx;
};

struct point {
    double ms; /* rec_frame_solve and what was prepared for it, mean over frames */
    double restrict_ms;
    struct quality q; /* mean over frames; views only if asked for */
    double iterations;
    enum rec_status status; /* of the last frame */
    struct rec_frame_report report;
};

/* Time of rec_frame_solve on a carved slot: the shortest of at least two, as the first one touches
 * pages that the others find mapped; the solution is the same each time.  patience_ms 0: one.
 * With a deadline the solution is that of the last of two. */
static inline double solve_ms(rec_frame *f, const struct rec_sparse *previous,
                              const struct setting *set, double patience_ms)
{
    double best = 1e300, spent = 0;
    for (int r = 0; r < 9; r++) {
        int64_t t0 = pvx_now_mono();
        CHECK(rec_frame_solve(f, set->deadline_ms > 0 ? t0 + (int64_t)(1e6 * set->deadline_ms) : 0,
                              previous));
        double t = ms(pvx_now_mono() - t0);
        if (set->deadline_ms > 0 && r == 1)
            return t;
        best = fmin(best, t);
        spent += t;
        if (set->deadline_ms > 0)
            continue;
        if (patience_ms == 0 || spent > 400 || (r >= 1 && spent > patience_ms))
            break;
    }
    return best;
}

/* Carve; shortest time of the restriction in *restrict_ms. */
static inline void carve(const struct shot *shot, rec_frame *f, int repeats, double *restrict_ms)
{
    *restrict_ms = 1e300;
    for (int r = 0; r < repeats; r++) {
        shot_put(shot, f);
        rec_frame_carve(f);
        *restrict_ms = fmin(*restrict_ms, ms(rec_frame_get_report(f)->restrict_ns));
    }
}

static inline struct point measure(const struct course *c, const struct setting *set)
{
    struct rec_frame_params p = rec_frame_defaults;
    struct point out = {0};
    size_t nch = (size_t)c->scene->nch, values = rec_grid_count(&c->S->grid) * nch;
    float *dense = must_floats(values);
    rec_frame *f[2] = {NULL, NULL};
    struct rec_sparse volume[2];
    int counted = c->n - c->from;

    p.nch = c->scene->nch;
    p.photo.saturation = 1e30f;
    p.solve.solver = set->solver;
    p.solve.stop = set->stop;
    p.solve.iterations = set->iterations;
    for (int i = 0; i < (c->n > 1 ? 2 : 1); i++) /* as in a pipeline: the volume before stays */
        CHECK(rec_frame_alone(c->S, &c->scene->rig, &p, c->pool, &f[i], NULL));
    for (int i = 0; i < c->n; i++) {
        rec_frame *now = f[i % 2];
        bool count = i >= c->from;
        if (!count && !set->warm)
            continue;
        double restricted;
        carve(&c->shot[i], now, set->once || !count ? 1 : 3, &restricted);
        double patience = set->once || !count ? 0 : c->n > 1 ? 1 : 20;
        double t = solve_ms(now, set->warm && i > 0 ? &volume[(i + 1) % 2] : NULL, set, patience);
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
        out.restrict_ms += restricted / counted;
        out.iterations += (double)out.report.solve.iterations / counted;
        out.q.volume += q.volume / counted;
        out.q.view += q.view / counted;
        out.q.psnr += q.psnr / counted;
        out.q.ssim += q.ssim / counted;
    }
    out.ms += fmax(0, out.restrict_ms - c->restrict_ms);
    for (int i = 0; i < 2; i++)
        rec_frame_free(&f[i]);
    free(dense);
    return out;
}

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

/* What the restriction takes when nothing else is prepared with it: cgls-paper needs nothing. */
static inline void course_base(struct course *c)
{
    struct setting set = {.solver = "cgls-paper", .stop = REC_STOP_ITERATIONS, .iterations = 1};
    c->restrict_ms = 1e300;
    double a = measure(c, &set).restrict_ms, b = measure(c, &set).restrict_ms;
    c->restrict_ms = fmin(a, b);
}

/* ---- curves ------------------------------------------------------------------------------------- */

static const uint16_t budgets[] = {1, 2, 3, 4, 5, 6, 8, 10, 12, 16, 20, 24, 32, 48, 64, 100};
#define N_BUDGETS ((int)(sizeof budgets / sizeof *budgets))
/* Shares of a time. */
static const double shares[] = {0.1, 0.2, 0.33, 0.5, 0.7, 0.85, 1};
#define N_SHARES ((int)(sizeof shares / sizeof *shares))

struct curve {
    int n, best;                      /* best: smallest volume error */
    uint32_t k[N_BUDGETS + N_SHARES]; /* budget; 0: a deadline */
    struct point at[N_BUDGETS + N_SHARES];
};

static inline void curve_add(struct curve *c, uint32_t k, const struct point *p)
{
    c->k[c->n] = k;
    c->at[c->n] = *p;
    if (p->q.volume < c->at[c->best].q.volume)
        c->best = c->n;
    c->n++;
}

/* The solver of `like`, started and judged as it says; stops at `k_limit` iterations, or past
 * `ms_limit`.  k iterations are the first of k + 1 and cannot take longer: where a measurement says
 * so, the larger budget had the quieter machine and its time is taken. */
static inline void curve_measure(const struct course *c, const struct setting *like,
                                 uint32_t k_limit, double ms_limit, struct curve *out)
{
    struct setting set = *like;
    *out = (struct curve){0};
    set.stop = REC_STOP_ITERATIONS;
    for (int i = 0; i < N_BUDGETS && budgets[i] <= k_limit; i++) {
        set.iterations = budgets[i];
        struct point p = measure(c, &set);
        curve_add(out, budgets[i], &p);
        for (int k = i - 1; k >= 0 && out->at[k].ms > p.ms; k--)
            out->at[k].ms = p.ms;
        if (p.ms > ms_limit)
            break;
    }
}

/* More points: what `like` returns when its deadline is a share of `whole_ms`. */
static inline void curve_deadlines(const struct course *c, const struct setting *like,
                                   double whole_ms, struct curve *out)
{
    struct setting set = *like;
    set.stop = REC_STOP_AUTO;
    for (int i = 0; i < N_SHARES; i++) {
        set.deadline_ms = shares[i] * whole_ms;
        struct point p = measure(c, &set);
        curve_add(out, 0, &p);
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
