/* test_restricted.c - the restricted system and its solution against the paper's words, written out
 * plainly here: remove columns, solve what is left; and against the truth of an analytic flame. */
#include "../t.h"

#include "base/mem.h"
#include "recon/view/flame.h"
#include "recon/frame/frame.h"
#include "recon/metrics.h"

#define CAMERAS 6
#define W       48
#define H       36
#define VOXELS  20

struct bed {
    struct rec_rig rig;
    rec_sysmat *S;
    struct rec_frame_params p;
    pvx_pool *pool;
    rec_frame *f;
    float *truth; /* [N][3] */
};

static void bed_free(struct bed *b)
{
    rec_frame_free(&b->f);
    rec_sysmat_free(&b->S);
    pvx_pool_free(&b->pool);
    rec_rig_fini(&b->rig);
    free(b->truth);
}

static void bed_new(struct bed *b, unsigned threads)
{
    struct pvx_diag d = {""};
    memset(b, 0, sizeof *b);
    b->p = rec_frame_defaults;
    b->p.photo.saturation = 1e30F;
    T_EQ_I(rec_rig_ring(CAMERAS, 2.4, W, H, VOXELS, &b->rig), PVX_OK);
    T_EQ_I(pvx_pool_new(threads, "t", &b->pool), PVX_OK);
    struct rec_sysmat_params mp = {1, 1};
    T_EQ_I(rec_sysmat_build(&b->rig, &mp, b->pool, NULL, NULL, &b->S, &d), PVX_OK);
    T_EQ_I(rec_frame_new(b->S, &b->rig, &b->p, b->pool, &b->f, &d), PVX_OK);
    b->truth = pvx_calloc(rec_grid_count(&b->rig.grid) * 3, sizeof *b->truth);
}

/* The flame at time t as every camera sees it, area-integrated, never from S; plus noise. */
static void look(struct bed *b, double t, double noise)
{
    struct rec_flame flame;
    struct rec_flame_pose pose;
    rec_flame_init(&flame, &b->rig.grid, 1);
    rec_flame_at(&flame, t, &pose);
    float *img = pvx_calloc((size_t)W * H * 3, sizeof *img);
    rec_frame_reset(b->f);
    for (size_t c = 0; c < CAMERAS; c++) {
        rec_flame_render(&pose, &b->rig.cameras[c], 3, 0, H, img);
        float *in = rec_frame_input(b->f, c);
        for (size_t i = 0; i < (size_t)W * H; i++) {
            for (int l = 0; l < 3; l++)
                in[i * 4 + (size_t)l] = img[i * 3 + (size_t)l] + (float)(noise * t_normal());
            in[i * 4 + 3] = 0;
        }
        rec_frame_present(b->f, c, true);
    }
    free(img);
    rec_flame_voxels(&pose, &b->rig.grid, 0, b->rig.grid.n[2], b->truth);
}

static double error_of(struct bed *b)
{
    size_t n = rec_grid_count(&b->rig.grid) * 3;
    float *dense = pvx_calloc(n, sizeof *dense);
    struct rec_sparse v;
    rec_frame_volume(b->f, &v);
    rec_sparse_to_dense(&v, dense);
    for (size_t i = 0; i < n; i++)
        T_OK(isfinite(dense[i]) && dense[i] >= 0);
    double e = rec_rel_l2(dense, b->truth, n);
    free(dense);
    return e;
}

/* y += S x for one lane, straight from the entries: the definition. */
static void plain_forward(const rec_sysmat *S, const double *x, double *y)
{
    for (size_t j = 0; j < rec_grid_count(&S->grid); j++)
        for (uint32_t e = S->colptr[j]; e < S->colptr[j + 1]; e++)
            y[S->row[e]] += rec_sysmat_value(S, e) * x[j];
}
static void plain_adjoint(const rec_sysmat *S, const double *y, double *x)
{
    for (size_t j = 0; j < rec_grid_count(&S->grid); j++)
        for (uint32_t e = S->colptr[j]; e < S->colptr[j + 1]; e++)
            x[j] += rec_sysmat_value(S, e) * y[S->row[e]];
}

static void products_are_those_of_the_full_matrix(void)
{
    struct bed b;
    bed_new(&b, 2);
    look(&b, 0.3, 0.002);
    rec_frame_carve(b.f);
    const struct rec_subsys *a = rec_frame_subsys(b.f);
    size_t row0[REC_MAX_CAMERAS + 1], rows = rec_rowspace(b.S, row0);
    size_t N = rec_grid_count(&b.S->grid);
    T_OK(a->n > 100 && (size_t)a->n < N / 2);
    float *x = pvx_calloc((size_t)a->n * 4, sizeof *x),
          *y = pvx_calloc((size_t)a->rows * 4, sizeof *y);
    float *back = pvx_calloc((size_t)a->n * 4, sizeof *back);
    double *fx = pvx_calloc(N, sizeof *fx), *fy = pvx_calloc(rows, sizeof *fy);
    double *fb = pvx_calloc(N, sizeof *fb), *fr = pvx_calloc(rows, sizeof *fr);
    for (int32_t q = 0; q < a->n; q++) {
        for (int l = 0; l < 3; l++)
            x[q * 4 + l] = (float)t_uniform(0, 1);
        fx[a->col[q]] = x[q * 4 + 1];
    }
    rec_forward(a, x, y);
    plain_forward(b.S, fx, fy);
    double worst = 0, size = 0, xy = 0, yx = 0;
    for (int32_t i = 0; i < a->rows; i++) {
        worst = fmax(worst, fabs((double)y[i * 4 + 1] - fy[a->ray[i]]));
        size = fmax(size, fabs(fy[a->ray[i]]));
        fy[a->ray[i]] = 0;
    }
    T_LE(worst, 1e-5 * size);
    for (size_t i = 0; i < rows; i++) /* rays outside a->ray see no active voxel */
        T_OK(fy[i] == 0);
    /* adjoint, on random y */
    for (int32_t i = 0; i < a->rows; i++) {
        float ax = y[i * 4 + 1];
        float r = (float)t_uniform(-1, 1);
        xy += (double)ax * r;
        for (int l = 0; l < 3; l++)
            y[i * 4 + l] = r;
        y[i * 4 + 3] = 0;
        fr[a->ray[i]] = r;
    }
    rec_adjoint(a, y, back);
    plain_adjoint(b.S, fr, fb);
    for (int32_t q = 0; q < a->n; q++) {
        T_NEAR(back[q * 4 + 1], fb[a->col[q]], 1e-5);
        yx += (double)back[q * 4 + 1] * x[q * 4 + 1];
    }
    T_NEAR(xy, yx, 1e-5 * fabs(xy) + 1e-4); /* <Ax,y> = <x,A'y> */
    free(x);
    free(y);
    free(back);
    free(fx);
    free(fy);
    free(fb);
    free(fr);
    bed_free(&b);
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
static void paper_cgls(const rec_sysmat *S, const bool *in, const double *p, int iterations,
                       double *a)
{
    size_t row0[REC_MAX_CAMERAS + 1], M = rec_rowspace(S, row0), N = rec_grid_count(&S->grid);
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

static void restricted_solution_is_the_full_one_with_columns_removed(void)
{
    struct bed b;
    bed_new(&b, 2);
    look(&b, 0.3, 0.002);
    rec_frame_carve(b.f);
    const struct rec_subsys *a = rec_frame_subsys(b.f);
    size_t row0[REC_MAX_CAMERAS + 1], M = rec_rowspace(b.S, row0), N = rec_grid_count(&b.S->grid);
    const float *rhs = rec_frame_rhs(b.f);
    bool *in = pvx_calloc(N, sizeof *in);
    double *p = pvx_calloc(M, sizeof *p), *want = pvx_calloc(N, sizeof *want);
    for (int32_t q = 0; q < a->n; q++)
        in[a->col[q]] = true;
    for (size_t i = 0; i < M; i++)
        p[i] =
            rhs[i * 4]; /* red; rays without an entry do not matter to the columns that are left */
    paper_cgls(b.S, in, p, KEEP, want);

    rec_solver *s;
    struct iterates it = {.n = a->n};
    struct rec_solve_report rep;
    struct rec_solve_params sp = {
        .solver = "cgls-paper", .stop = REC_STOP_ITERATIONS, .iterations = KEEP, .lambda = -1};
    T_EQ_I(rec_solver_new(b.S, 3, &s), PVX_OK);
    float *x = pvx_calloc((size_t)a->n * 4, sizeof *x);
    T_EQ_I(rec_solve(s, a, rhs, rec_frame_weight(b.f), 0, &sp, x, keep, &it, &rep), PVX_OK);
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
    rec_solver_free(&s);
    free(x);
    free(in);
    free(p);
    free(want);
    bed_free(&b);
}

struct descent {
    double last;
    int bad;
    unsigned n;
};
static void falls(void *ctx, uint32_t k, const float *x, double objective, double residual)
{
    (void)x;
    (void)k;
    (void)residual;
    struct descent *d = ctx;
    if (d->n++ > 0 && objective > d->last * (1 + 1e-6))
        d->bad++;
    d->last = objective;
}
static void objective_of_the_default_never_rises(void)
{
    for (int noisy = 0; noisy < 3; noisy++) {
        struct bed b;
        bed_new(&b, 2);
        look(&b, 0.1, 0.02 * noisy);
        rec_frame_carve(b.f);
        const struct rec_subsys *a = rec_frame_subsys(b.f);
        rec_solver *s;
        struct descent d = {0};
        struct rec_solve_report rep;
        struct rec_solve_params sp = {.stop = REC_STOP_ITERATIONS, .iterations = 60, .lambda = -1};
        T_EQ_I(rec_solver_new(b.S, 3, &s), PVX_OK);
        float *x = pvx_calloc((size_t)a->n * 4, sizeof *x);
        T_EQ_I(rec_solve(s, a, rec_frame_rhs(b.f), rec_frame_weight(b.f), 0.02 * noisy, &sp, x,
                         falls, &d, &rep),
               PVX_OK);
        T_OK(d.n > 3);
        T_EQ_I(d.bad, 0);
        free(x);
        rec_solver_free(&s);
        bed_free(&b);
    }
}

static void same_bits_for_any_number_of_threads(void)
{
    float *first = NULL;
    int32_t n = 0;
    for (unsigned threads = 1; threads <= 4; threads++) {
        struct bed b;
        bed_new(&b, threads);
        t_state = 12345; /* the same noise each time */
        look(&b, 0.7, 0.01);
        rec_frame_carve(b.f);
        T_EQ_I(rec_frame_solve(b.f, 0, NULL), PVX_OK);
        struct rec_sparse v;
        rec_frame_volume(b.f, &v);
        if (first == NULL) {
            n = v.n;
            first = pvx_calloc((size_t)n * 4, sizeof *first);
            memcpy(first, v.value, (size_t)n * 4 * sizeof *first);
        } else {
            T_EQ_I(v.n, n);
            T_OK(v.n == n && memcmp(first, v.value, (size_t)n * 4 * sizeof *first) == 0);
        }
        bed_free(&b);
    }
    free(first);
}

/* Images made by S itself are exact.  A voxel that no ray of some camera meets shows in a real, area-
 * integrating pixel but not in S; so the voxels are taken from those that every seeing camera meets. */
static bool has_entries(const rec_sysmat *S, size_t c, size_t j)
{
    for (uint32_t e = S->colptr[j]; e < S->colptr[j + 1]; e++)
        if (S->row[e] >= S->row0[c] && S->row[e] < S->row0[c + 1])
            return true;
    return false;
}
static bool met_by_all(const rec_sysmat *S, size_t j)
{
    for (size_t c = 0; c < S->n_cameras; c++)
        if (rec_rect_seen(S->block[c].fp[j]) && !has_entries(S, c, j))
            return false;
    return true;
}
static void hull_never_carves_what_carries_energy(void)
{
    struct bed b;
    bed_new(&b, 2);
    b.p.photo.threshold = 1e-12F;
    struct pvx_diag d = {""};
    rec_frame_free(&b.f);
    T_EQ_I(rec_frame_new(b.S, &b.rig, &b.p, b.pool, &b.f, &d), PVX_OK);
    size_t row0[REC_MAX_CAMERAS + 1], M = rec_rowspace(b.S, row0), N = rec_grid_count(&b.S->grid);
    double *x = pvx_calloc(N, sizeof *x), *y = pvx_calloc(M, sizeof *y);
    for (int round = 0; round < 25; round++) {
        memset(x, 0, N * sizeof *x);
        memset(y, 0, M * sizeof *y);
        int lit = 1 + (int)(t_rand() % 40);
        for (int placed = 0; placed < lit;) {
            size_t v = t_rand() % N;
            if (!met_by_all(b.S, v))
                continue;
            x[v] = t_uniform(0.01, 1);
            placed++;
        }
        plain_forward(b.S, x, y);
        rec_frame_reset(b.f);
        for (size_t c = 0; c < CAMERAS; c++) {
            float *in = rec_frame_input(b.f, c);
            for (size_t i = 0; i < row0[c + 1] - row0[c]; i++)
                for (int l = 0; l < 4; l++)
                    in[i * 4 + (size_t)l] = l < 3 ? (float)y[row0[c] + i] : 0;
            rec_frame_present(b.f, c, true);
        }
        rec_frame_carve(b.f);
        const struct rec_subsys *a = rec_frame_subsys(b.f);
        for (int32_t q = 0; q < a->n; q++)
            x[a->col[q]] = 0;
        for (size_t j = 0; j < N; j++)
            T_CHECK_(x[j] == 0, "voxel %zu holds %g but was carved", j, x[j]);
        const struct rec_hull_counts *h = &rec_frame_get_report(b.f)->hull;
        T_EQ_I(h->inside + h->partial + h->outside, N);
        T_EQ_I(a->n, h->inside + h->partial);
    }
    free(x);
    free(y);
    bed_free(&b);
}

/* The whole chain against the truth: written bounds, and the default ahead of the paper's baseline. */
static void default_solver_beats_the_baseline(void)
{
    static const double noise[] = {0, 0.01, 0.05}, bound[] = {0.22, 0.30, 0.50};
    for (int i = 0; i < 3; i++) {
        double err[2];
        for (int s = 0; s < 2; s++) {
            struct bed b;
            bed_new(&b, 2);
            b.p.solve.solver = s == 0 ? "cgls-paper" : NULL;
            struct pvx_diag d = {""};
            rec_frame_free(&b.f);
            T_EQ_I(rec_frame_new(b.S, &b.rig, &b.p, b.pool, &b.f, &d), PVX_OK);
            t_state = 99;
            look(&b, 0.4, noise[i]);
            rec_frame_carve(b.f);
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
static void warm_start_leaves_no_old_flame(void)
{
    struct bed b;
    bed_new(&b, 2);
    look(&b, 0.2, 0);
    rec_frame_carve(b.f);
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
    rec_frame_carve(b.f);
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

int main(void)
{
    T_RUN(products_are_those_of_the_full_matrix);
    T_RUN(restricted_solution_is_the_full_one_with_columns_removed);
    T_RUN(objective_of_the_default_never_rises);
    T_RUN(same_bits_for_any_number_of_threads);
    T_RUN(hull_never_carves_what_carries_energy);
    T_RUN(default_solver_beats_the_baseline);
    T_RUN(warm_start_leaves_no_old_flame);
    return t_done();
}
