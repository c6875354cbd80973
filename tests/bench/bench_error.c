/* bench_error.c - error against time, iterate by iterate, for every solver, both bases, three noise
 * levels and two truths; and over grid sizes for the default solver. */
#include "bench.h"

#include <unistd.h>

/* ---- a volume from disk as truth: trilinear between cell centres, zero outside -------------------- */

struct field {
    float *v; /* [n2][n1][n0][3] */
    int n[3];
    double lo[3], hi[3];
};

static void field_at(const struct field *f, const double x[3], double out[3])
{
    int i[3];
    double t[3];
    out[0] = out[1] = out[2] = 0;
    for (int a = 0; a < 3; a++) {
        double u = (x[a] - f->lo[a]) / (f->hi[a] - f->lo[a]) * f->n[a] - 0.5;
        if (!(u > -1 && u < f->n[a]))
            return;
        i[a] = (int)floor(u);
        t[a] = u - i[a];
    }
    for (int c = 0; c < 8; c++) {
        double w = 1;
        int k[3];
        bool in = true;
        for (int a = 0; a < 3; a++) {
            k[a] = i[a] + (c >> a & 1);
            w *= c >> a & 1 ? t[a] : 1 - t[a];
            in &= k[a] >= 0 && k[a] < f->n[a];
        }
        if (!in)
            continue;
        const float *v =
            f->v +
            (((size_t)k[2] * (size_t)f->n[1] + (size_t)k[1]) * (size_t)f->n[0] + (size_t)k[0]) * 3;
        for (int ch = 0; ch < 3; ch++)
            out[ch] += w * v[ch];
    }
}

/* Midpoint sums in quarter-cell steps along the part of the ray inside the field. */
static void field_ray(const struct field *f, const double o[3], const double d[3], double out[3])
{
    double s0 = 0, s1 = 1e9, cell = 1e9;
    out[0] = out[1] = out[2] = 0;
    for (int a = 0; a < 3; a++) {
        double h = (f->hi[a] - f->lo[a]) / f->n[a], lo = f->lo[a] - h / 2, hi = f->hi[a] + h / 2;
        cell = fmin(cell, h);
        if (fabs(d[a]) < 1e-12) {
            if (o[a] < lo || o[a] > hi)
                return;
            continue;
        }
        double u = (lo - o[a]) / d[a], v = (hi - o[a]) / d[a];
        s0 = fmax(s0, fmin(u, v));
        s1 = fmin(s1, fmax(u, v));
    }
    if (s1 <= s0)
        return;
    int steps = (int)ceil((s1 - s0) / (cell / 4));
    double ds = (s1 - s0) / steps;
    for (int i = 0; i < steps; i++) {
        double x[3], e[3];
        for (int a = 0; a < 3; a++)
            x[a] = o[a] + (s0 + (i + 0.5) * ds) * d[a];
        field_at(f, x, e);
        for (int ch = 0; ch < 3; ch++)
            out[ch] += e[ch] * ds;
    }
}

struct field_job {
    const struct field *f;
    const struct rec_camera *c;
    float *img;
};

static void field_row(void *ctx, size_t y)
{
    const struct field_job *j = ctx;
    enum { SUB = 2 };
    for (int32_t x = 0; x < j->c->width; x++)
        for (int s = 0; s < SUB * SUB; s++) {
            double o[3], d[3], rgb[3];
            if (!rec_camera_ray(j->c, x + (s % SUB + 0.5) / SUB - 0.5,
                                (double)y + (s / SUB + 0.5) / SUB - 0.5, o, d))
                continue;
            field_ray(j->f, o, d, rgb);
            for (int ch = 0; ch < 3; ch++)
                j->img[(y * (size_t)j->c->width + (size_t)x) * 3 + (size_t)ch] +=
                    (float)(rgb[ch] / (SUB * SUB));
        }
}

static float *field_image(const struct field *f, const struct rec_camera *c, pvx_pool *pool)
{
    struct field_job j = {f, c, bench_floats((size_t)c->width * (size_t)c->height * 3)};
    pvx_pool_run(pool, (size_t)c->height, field_row, &j);
    return j.img;
}

/* The campfire, shrunk to the rig: its box of 2 x 2 x 4 m becomes 1/2 x 1/2 x 1. */
static bool scene_campfire(struct scene *s, const char *path, enum rec_basis basis, pvx_pool *pool)
{
    struct field f = {.lo = {-0.25, -0.25, 0}, .hi = {0.25, 0.25, 1}};
    size_t shape[4];
    int ndim;
    if (access(path, R_OK) != 0)
        return false;
    struct pvx_diag d = {""};
    if (cap_npy_load(path, &f.v, shape, &ndim, &d) != PVX_OK || ndim != 4 || shape[3] != 3) {
        fprintf(stderr, "%s: %s\n", path, d.text);
        return false;
    }
    for (int a = 0; a < 3; a++)
        f.n[a] = (int)shape[2 - a];
    scene_rig(s, 8, 160, 120, 64, basis);
    struct rec_grid *g = &s->rig.grid;
    memcpy(g->min, f.lo, sizeof g->min);
    memcpy(g->max, f.hi, sizeof g->max);
    g->n[0] = g->n[1] = 32;
    for (size_t c = 0; c < 8; c++)
        s->image[c] = field_image(&f, &s->rig.cameras[c], pool);
    s->unseen_image = field_image(&f, &s->unseen, pool);
    scene_peak(s);
    s->truth = bench_floats(rec_grid_count(g) * 3);
    int m = basis == REC_BOX ? 4 : 1; /* mean over the cell, or value at the centre */
    for (size_t i = 0; i < rec_grid_count(g); i++) {
        double c[3], e[3];
        rec_grid_centre(g, (int32_t)i, c);
        for (int k = 0; k < m * m * m; k++) {
            double off[3] = {(k % m + 0.5) / m - 0.5, (k / m % m + 0.5) / m - 0.5,
                             (k / m / m + 0.5) / m - 0.5};
            double x[3] = {c[0] + off[0] * rec_grid_h(g, 0), c[1] + off[1] * rec_grid_h(g, 1),
                           c[2] + off[2] * rec_grid_h(g, 2)};
            field_at(&f, x, e);
            for (int ch = 0; ch < 3; ch++)
                s->truth[i * 3 + (size_t)ch] += (float)(e[ch] / (m * m * m));
        }
    }
    /* the scale is arbitrary: the brightest pixel becomes 0.8 */
    float k = (float)(0.8 / s->peak);
    size_t px = 160 * 120 * 3;
    for (size_t c = 0; c < 8; c++)
        for (size_t i = 0; i < px; i++)
            s->image[c][i] *= k;
    for (size_t i = 0; i < px; i++)
        s->unseen_image[i] *= k;
    for (size_t i = 0; i < rec_grid_count(g) * 3; i++)
        s->truth[i] *= k;
    s->peak = 0.8;
    free(f.v);
    return true;
}

/* ---- one solver, iterate by iterate ------------------------------------------------------------- */

struct trace {
    const struct scene *s;
    const struct rec_subsys *a;
    FILE *csv;
    const char *prefix;
    float *dense;
    int64_t solver_ns, last; /* time spent in the solver; when the callback was left */
    double best, best_ms, last_error;
    uint32_t best_k;
};

static void to_dense(const struct trace *t, const float *x)
{
    struct rec_sparse v = {
        .grid = &t->a->S->grid, .nch = 3, .cs = 4, .n = t->a->n, .index = t->a->col, .value = x};
    rec_sparse_to_dense(&v, t->dense);
}

static void on_iterate(void *ctx, uint32_t k, const float *x, double objective, double residual)
{
    struct trace *t = ctx;
    t->solver_ns += pvx_now_mono() - t->last;
    to_dense(t, x);
    t->last_error = rec_rel_l2(t->dense, t->s->truth, rec_grid_count(&t->s->rig.grid) * 3);
    fprintf(t->csv, "%s,%u,%.4f,%.6f,%.6g,%.6g\n", t->prefix, k, ms(t->solver_ns), t->last_error,
            objective, residual);
    if (t->last_error < t->best) {
        t->best = t->last_error;
        t->best_k = k;
        t->best_ms = ms(t->solver_ns);
    }
    t->last = pvx_now_mono();
}

static void one(FILE *table, FILE *curves, const char *scene, const struct scene *s,
                const rec_sysmat *S, double noise, const char *solver, uint32_t budget,
                pvx_pool *pool)
{
    struct rec_frame_params p = rec_frame_defaults;
    p.photo.saturation = 1e30f;
    rec_frame *f;
    rec_solver *w;
    CHECK(rec_frame_new(S, &s->rig, &p, pool, &f, NULL));
    CHECK(rec_solver_new(S, 3, &w));
    scene_fill(s, f, noise);
    rec_frame_carve(f);
    const struct rec_subsys *a = rec_frame_subsys(f);
    float *x = bench_floats((size_t)a->n * 4 + 4);
    char prefix[128];
    snprintf(prefix, sizeof prefix, "%s,%d,%s,%g,%s", scene, S->grid.n[2],
             rec_basis_name(S->grid.basis), noise, solver);
    struct trace t = {.s = s,
                      .a = a,
                      .csv = curves,
                      .prefix = prefix,
                      .best = 1e300,
                      .dense = bench_floats(rec_grid_count(&S->grid) * 3)};
    struct rec_solve_params sp = rec_solve_defaults;
    struct rec_solve_report r;
    sp.solver = solver;
    double sigma = rec_frame_get_report(f)->sigma;
    if (budget > 0) { /* the whole curve first */
        sp.stop = REC_STOP_ITERATIONS;
        sp.iterations = budget;
        t.last = pvx_now_mono();
        CHECK(rec_solve(w, a, rec_frame_rhs(f), rec_frame_weight(f), sigma, &sp, x, on_iterate, &t,
                        &r));
        memset(x, 0, (size_t)a->n * 4 * sizeof *x);
    }
    sp.stop = REC_STOP_AUTO; /* then what a user gets */
    sp.iterations = 0;
    CHECK(rec_solve(w, a, rec_frame_rhs(f), rec_frame_weight(f), sigma, &sp, x, NULL, NULL, &r));
    to_dense(&t, x);
    struct quality q = judge(s, t.dense, pool);
    printf("  %-9s %4d %-9s %3.0f %% %-10s", scene, S->grid.n[2], rec_basis_name(S->grid.basis),
           noise * 100, solver);
    if (budget > 0)
        printf(" %6.3f at %3u, %6.1f ms; %6.3f at %3u |", t.best, t.best_k, t.best_ms, t.last_error,
               budget);
    printf(" %6.3f %6.2f %5.1f %6.3f %4u it %7.1f ms %s\n", q.volume, q.view, q.psnr, q.ssim,
           r.best, ms(r.time_ns), rec_status_name(r.status));
    fprintf(table, "%s,%.4f,%.5f,%.4f,%.3f,%.5f,%u,%s\n", prefix, ms(r.time_ns), q.volume, q.view,
            q.psnr, q.ssim, r.best, rec_status_name(r.status));
    free(t.dense);
    free(x);
    rec_solver_free(&w);
    rec_frame_free(&f);
    fflush(stdout);
}

static void all_solvers(FILE *table, FILE *curves, const char *name, const struct scene *s,
                        const double *noise, int n_noise, pvx_pool *pool)
{
    static const struct rec_sysmat_params mp = {.binning = 1, .rays_per_bin = 2};
    static const char *const solver[] = {"cgls-paper", "pcg", "mlem"};
    rec_sysmat *S;
    CHECK(rec_sysmat_build(&s->rig, &mp, pool, NULL, NULL, &S, NULL));
    for (int n = 0; n < n_noise; n++)
        for (int k = 0; k < 3; k++)
            one(table, curves, name, s, S, noise[n], solver[k], 100, pool);
    rec_sysmat_free(&S);
}

int main(int argc, char **argv)
{
    FILE *table = bench_csv(argc, argv, "error"), *curves = bench_csv(argc, argv, "curves");
    pvx_pool *pool;
    struct scene s;
    static const double noise[] = {0, 0.01, 0.05};
    CHECK(pvx_pool_new(2, "bench", &pool));
    fprintf(table, "scene,voxels,basis,noise,solver,ms,volume,view,psnr,ssim,iteration,status\n");
    fprintf(curves, "scene,voxels,basis,noise,solver,iteration,ms,volume,objective,residual\n");
    printf(
        "\nerror against time, 8 x 160x120 RGB, 2 threads; left: best iterate of 100 and the last; "
        "right: as returned with the default stop\n"
        "  scene     grid basis   noise solver     volume error                          | volume "
        "  view  PSNR   SSIM\n");
    for (int basis = 0; basis < 2; basis++) {
        scene_flame(&s, 8, 160, 120, 64, basis == 0 ? REC_BOX : REC_TRILINEAR, 0.3, pool);
        all_solvers(table, curves, "flame", &s, noise, 3, pool);
        scene_fini(&s);
    }
    const char *path = "../shared/data/campfire/emission-000006.npy";
    for (int basis = 0; basis < 2; basis++) {
        if (!scene_campfire(&s, path, basis == 0 ? REC_BOX : REC_TRILINEAR, pool)) {
            printf("  campfire: skipped, no %s here\n", path);
            break;
        }
        all_solvers(table, curves, "campfire", &s, noise + 1, 1, pool);
        scene_fini(&s);
    }
    static const int sizes[] = {32, 48, 64, 72, 96, 128};
    printf("over grid sizes, default solver, 1 %% noise\n");
    for (int basis = 0; basis < 2; basis++)
        for (int i = 0; i < 6; i++) {
            static const struct rec_sysmat_params mp = {.binning = 1, .rays_per_bin = 0};
            rec_sysmat *S;
            scene_flame(&s, 8, 160, 120, sizes[i], basis == 0 ? REC_BOX : REC_TRILINEAR, 0.3, pool);
            CHECK(rec_sysmat_build(&s.rig, &mp, pool, NULL, NULL, &S, NULL));
            one(table, curves, "flame", &s, S, 0.01, rec_solver_names()[0], 0, pool);
            rec_sysmat_free(&S);
            scene_fini(&s);
        }
    fclose(table);
    fclose(curves);
    pvx_pool_free(&pool);
    return 0;
}
