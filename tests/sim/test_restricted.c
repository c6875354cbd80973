/* test_restricted.c - the restricted system and its solution against the paper's words, written out
 * plainly here: remove columns, solve what is left; and against the truth of an analytic flame. */
#include "tests/lib/scene.h"
#include "tests/lib/slot.h"
#include "tests/lib/entries.h"
#include "recon/frame/inside.h"

#define CAMERAS 6
#define W       48
#define VOXELS  20

/* The scene's rig, matrix and truth, and a slot with parameters of its own. */
struct bed {
    struct scene sc;
    struct rec_frame_params p;
    rec_frame *f;
};

static void bed_free(struct bed *b)
{
    rec_frame_free(&b->f);
    scene_free(&b->sc);
}

static void bed_new(struct bed *b, float threshold, const char *solver)
{
    *b = (struct bed){.p = rec_frame_defaults};
    scene_new(&b->sc, CAMERAS, W, VOXELS, 1, 2);
    b->p.photo.saturation = 1e30F;
    b->p.photo.threshold = threshold;
    b->p.solve.solver = solver;
    T_EQ_I(rec_frame_alone(b->sc.S, &b->sc.rig, &b->p, b->sc.pool, &b->f, NULL), PVX_OK);
}

/* The flame at time t as every camera sees it, carved. */
static void look(struct bed *b, double t, double noise)
{
    scene_at(&b->sc, t);
    scene_shoot(&b->sc, b->f, noise);
    rec_frame_carve(b->f);
}

static double error_of(const struct bed *b)
{
    struct rec_sparse v;
    rec_frame_volume(b->f, &v);
    for (int32_t i = 0; i < v.n * v.cs; i++)
        T_OK(isfinite(v.value[i]) && v.value[i] >= 0);
    return scene_error(&b->sc, &v);
}

/* y += S x for one channel, straight from the entries: the definition. */
static void plain_forward(const struct entries *S, const double *x, double *y)
{
    for (size_t j = 0; j < S->n; j++)
        for (uint32_t e = S->colptr[j]; e < S->colptr[j + 1]; e++)
            y[S->row[e]] += entries_value(S, e) * x[j];
}
static void plain_adjoint(const struct entries *S, const double *y, double *x)
{
    for (size_t j = 0; j < S->n; j++)
        for (uint32_t e = S->colptr[j]; e < S->colptr[j + 1]; e++)
            x[j] += entries_value(S, e) * y[S->row[e]];
}

#define KEEP 6
struct iterates {
    int32_t n;
    float *x[KEEP + 1];
};
static void keep(void *ctx, uint32_t k, const float *x, double objective, double residual)
{
    (void)objective;
    (void)residual;
    struct iterates *it = ctx;
    if (k <= KEEP && it->x[k] == NULL) {
        it->x[k] = pvx_calloc((size_t)it->n * 4, sizeof(float));
        memcpy(it->x[k], x, (size_t)it->n * 4 * sizeof(float));
    }
}

/* Paper 4.3 and 4.4 in double on the full matrix with columns removed: a_j = 0 for j outside. */
static void paper_cgls(const struct entries *S, size_t M, const bool *in, const double *p,
                       int iterations, double *a)
{
    size_t N = S->n;
    double *r = pvx_calloc(M, sizeof *r), *q = pvx_calloc(M, sizeof *q);
    double *d = pvx_calloc(N, sizeof *d), *s = pvx_calloc(N, sizeof *s);
    memcpy(r, p, M * sizeof *r);
    plain_adjoint(S, r, s);
    double gamma = 0;
    for (size_t j = 0; j < N; j++) {
        d[j] = s[j] = in[j] ? s[j] : 0;
        gamma += s[j] * s[j];
    }
    for (int k = 0; k < iterations; k++) {
        memset(q, 0, M * sizeof *q);
        plain_forward(S, d, q);
        double qq = 0, next = 0;
        for (size_t i = 0; i < M; i++)
            qq += q[i] * q[i];
        double alpha = gamma / qq;
        for (size_t j = 0; j < N; j++)
            a[j] = fmax(0, a[j] + alpha * d[j]);
        for (size_t i = 0; i < M; i++)
            r[i] -= alpha * q[i];
        memset(s, 0, N * sizeof *s);
        plain_adjoint(S, r, s);
        for (size_t j = 0; j < N; j++) {
            s[j] = in[j] ? s[j] : 0;
            next += s[j] * s[j];
        }
        for (size_t j = 0; j < N; j++)
            d[j] = s[j] + next / gamma * d[j];
        gamma = next;
    }
    free(r);
    free(q);
    free(d);
    free(s);
}

T_CASE(restricted_solution_is_the_full_one_with_columns_removed)
{
    struct bed b;
    bed_new(&b, rec_photo_defaults.threshold, NULL);
    look(&b, 0.3, 0.002);
    const struct rec_subsys *a = rec_frame_subsys(b.f);
    struct entries all = entries_of(b.sc.S);
    size_t M = b.sc.S->row0[CAMERAS], N = all.n;
    const float *rhs = rec_frame_rhs(b.f);
    bool *in = pvx_calloc(N, sizeof *in);
    double *p = pvx_calloc(M, sizeof *p), *want = pvx_calloc(N, sizeof *want);
    for (int32_t q = 0; q < a->n; q++)
        in[a->col[q]] = true;
    for (size_t i = 0; i < M; i++)
        p[i] =
            rhs[i * 4]; /* red; rays without an entry do not matter to the columns that are left */
    paper_cgls(&all, M, in, p, KEEP, want);
    entries_free(&all);

    rec_problem *s;
    struct iterates it = {.n = a->n};
    struct rec_solve_report rep;
    struct rec_solve_params sp = {.solver = "cgls-paper",
                                  .stop = REC_STOP_ITERATIONS,
                                  .iterations = KEEP,
                                  .lambda = -1,
                                  .trace = keep,
                                  .trace_ctx = &it};
    T_EQ_I(rec_problem_new(b.sc.S, 3, &s), PVX_OK);
    float *x = pvx_calloc((size_t)a->n * 4, sizeof *x);
    const struct rec_pictures pic = slot_pictures(b.f, 0);
    T_EQ_I(solve_from(s, a, &pic, &sp, x, &rep), PVX_OK);
    T_OK(it.x[KEEP] != NULL);
    double diff = 0, norm = 0;
    for (int32_t q = 0; q < a->n && it.x[KEEP] != NULL; q++) {
        double e = it.x[KEEP][q * 4] - want[a->col[q]];
        diff += e * e;
        norm += want[a->col[q]] * want[a->col[q]];
    }
    T_OK(norm > 0);
    T_LE(sqrt(diff / norm), 1e-4);
    for (int k = 0; k <= KEEP; k++)
        free(it.x[k]);
    rec_problem_free(&s);
    free(x);
    free(in);
    free(p);
    free(want);
    bed_free(&b);
}

/* The whole chain against the truth: written bounds, and the default ahead of the paper's baseline. */
T_CASE(default_solver_beats_the_baseline)
{
    static const double noise[] = {0, 0.01, 0.05}, bound[] = {0.22, 0.30, 0.50};
    for (int i = 0; i < 3; i++) {
        double err[2];
        for (int s = 0; s < 2; s++) {
            struct bed b;
            bed_new(&b, rec_photo_defaults.threshold, s == 0 ? "cgls-paper" : NULL);
            t_state = 99;
            look(&b, 0.4, noise[i]);
            T_EQ_I(rec_frame_solve(b.f, 0, NULL), PVX_OK);
            err[s] = error_of(&b);
            bed_free(&b);
        }
        printf("  noise %.2f: cgls-paper %.3f, default %.3f\n", noise[i], err[0], err[1]);
        T_LE(err[1], bound[i]);
        T_LE(err[1], err[0] * 1.02);
    }
}

/* A flame that jumps: what the last frame left must not be in the next. */
T_CASE(warm_start_leaves_no_old_flame)
{
    struct bed b;
    bed_new(&b, rec_photo_defaults.threshold, NULL);
    look(&b, 0.2, 0);
    T_EQ_I(rec_frame_solve(b.f, 0, NULL), PVX_OK);
    struct rec_sparse v;
    rec_frame_volume(b.f, &v);
    float *val = pvx_calloc((size_t)v.n * 4, sizeof *val);
    int32_t *idx = pvx_calloc((size_t)v.n, sizeof *idx);
    for (int32_t i = 0; i < v.n * 4; i++)
        val[i] = 50 * v.value[i]; /* as wrong as can be */
    memcpy(idx, v.index, (size_t)v.n * sizeof *idx);
    struct rec_sparse old = v;
    old.index = idx;
    old.value = val;
    look(&b, 1.1, 0);
    T_EQ_I(rec_frame_solve(b.f, 0, NULL), PVX_OK);
    double cold = error_of(&b);
    rec_frame_carve(b.f);
    T_EQ_I(rec_frame_solve(b.f, 0, &old), PVX_OK);
    double warm = error_of(&b);
    T_LE(warm, cold * 1.1 + 0.01);
    /* no time at all: still no worse than saying nothing */
    rec_frame_carve(b.f);
    T_EQ_I(rec_frame_solve(b.f, 1, &old), PVX_OK);
    T_LE(rec_frame_get_report(b.f)->solve.rel_residual, 1 + 1e-6);
    free(val);
    free(idx);
    bed_free(&b);
}
