/* Rigs, pictures and truth of the stability cases, and the chain run on them. */
#include "tests/stability/stab.h"

#include <stdlib.h>
#include <string.h>

#include "tests/lib/normal.h"

#define RADIUS 2.2
#define SUB    4 /* rays per pixel side: pixels are area means */

size_t stab_pixels(const struct stab_bed *b, size_t camera)
{
    return (size_t)b->rig.cameras[camera].width * (size_t)b->rig.cameras[camera].height;
}

/* ---- rigs ---------------------------------------------------------------------------------------*/

/* Pinholes whose middle column, row and pixel look exactly along faces, edges and diagonals. */
static void faces(struct rec_rig *rig)
{
    static const double at[8][3] = {{RADIUS, 0, 0.5}, {0, RADIUS, 0.5}, {-RADIUS, 0, 0.5},
                                    {0, 0, 2.7},      {1.5, 1.5, 0.5},  {-1.5, 1.5, 0.5},
                                    {1.2, -1.2, 1.7}, {0.25, -1e4, 0.5}};
    for (size_t i = 0; i < rig->n_cameras; i++) {
        struct rec_camera *c = &rig->cameras[i];
        double aim[3] = {0, 0, 0.5}, f = c->fx;
        if (i == 7) { /* a tele lens so far away that its rays hardly leave the planes */
            aim[0] = at[i][0];
            f *= 1e4 / RADIUS * 0.6;
        }
        rec_camera_look(at[i], aim, c);
        memset(c->dist, 0, sizeof c->dist);
        c->fx = c->fy = f;
        c->cx = c->width / 2;
        c->cy = c->height / 2;
    }
}

static void make_rig(struct rec_rig *rig, enum stab_rig kind, size_t n, struct stab_size size)
{
    CHECK(rec_rig_ring(n, RADIUS, size.w, size.h, size.voxels, rig));
    switch (kind) {
    case RIG_RING: break;
    case RIG_TWINS:
        memcpy(rig->cameras[1].R, rig->cameras[0].R, sizeof rig->cameras[0].R);
        memcpy(rig->cameras[1].t, rig->cameras[0].t, sizeof rig->cameras[0].t);
        rig->cameras[1].t[0] += 1e-3;
        break;
    case RIG_PLANE:
        for (size_t i = 0; i < n; i++) {
            double at[3], aim[3] = {0, 0, 0.5};
            rec_camera_centre(&rig->cameras[i], at);
            at[2] = 0.5;
            rec_camera_look(at, aim, &rig->cameras[i]);
        }
        break;
    case RIG_INSIDE: {
        static const double at[3] = {0.15, 0.1, 0.45}, aim[3] = {-0.3, -0.2, 0.6};
        rec_camera_look(at, aim, &rig->cameras[n - 1]);
        rig->cameras[n - 1].fx = rig->cameras[n - 1].fy = 0.5 * size.w;
        break;
    }
    case RIG_FACES: faces(rig); break;
    }
}

/* ---- pictures -----------------------------------------------------------------------------------*/

/* The half line's part of (2) of flame.h:
 *     A sqrt(pi / 2a) exp(-1/2 (c - b^2/a)) erfc(b / sqrt(2a)). */
static void half_line(const struct rec_flame_pose *p, const double o[3], const double d[3],
                      double out[3])
{
    for (int g = 0; g < p->n; g++) {
        const struct rec_blob *q = &p->blob[g];
        double a = 0, b = 0, c = 0;
        for (int i = 0; i < 3; i++) {
            double e = (o[i] - q->m[i]) / q->s[i], v = d[i] / q->s[i];
            a += v * v;
            b += v * e;
            c += e * e;
        }
        double far = c - b * b / a;
        if (far > 60)
            continue;
        double v = sqrt(1.5707963267948966 / a) * exp(-0.5 * far) * erfc(b / sqrt(2 * a));
        for (int l = 0; l < 3; l++)
            out[l] += q->a[l] * v;
    }
}

/* Rays end at the first body (NULL: none stand there). */
static void render_inside(const struct rec_flame_pose *p, const struct rec_camera *c,
                          const struct rec_bodies *bodies, float *image)
{
    for (int32_t y = 0; y < c->height; y++)
        for (int32_t x = 0; x < c->width; x++) {
            double sum[3] = {0}, behind[3] = {0}, o[3], d[3];
            for (int s = 0; s < SUB * SUB; s++) {
                if (!rec_camera_ray(c, x + (s % SUB + 0.5) / SUB - 0.5,
                                    y + (s / SUB + 0.5) / SUB - 0.5, o, d))
                    continue;
                half_line(p, o, d, sum);
                double end = bodies != NULL ? rec_body_hit(bodies, o, d) : INFINITY;
                for (int i = 0; i < 3; i++)
                    o[i] += end * d[i];
                if (isfinite(end))
                    half_line(p, o, d, behind);
            }
            for (int l = 0; l < 3; l++)
                image[((size_t)y * (size_t)c->width + (size_t)x) * 3 + (size_t)l] =
                    (float)((sum[l] - behind[l]) / (SUB * SUB));
        }
}

struct picture {
    const struct stab_bed *b;
    const struct rec_camera *cameras;
};
static void render_camera(void *ctx, size_t i)
{
    struct picture *t = ctx;
    const struct rec_camera *c = &t->cameras[i];
    const struct rec_grid *g = &t->b->rig.grid;
    double at[3];
    bool inside = true;
    rec_camera_centre(c, at);
    for (int a = 0; a < 3; a++)
        inside = inside && at[a] > g->min[a] && at[a] < g->max[a];
    if (inside || t->b->bodies != NULL)
        render_inside(&t->b->pose, c, t->b->bodies, t->b->image[i]);
    else
        rec_flame_render(&t->b->pose, c, SUB, 0, c->height, t->b->image[i]);
}

static void measure(struct stab_bed *b)
{
    b->peak = b->norm = 0;
    for (size_t c = 0; c < b->rig.n_cameras; c++)
        for (size_t i = 0; i < stab_pixels(b, c) * 3; i++)
            b->peak = fmax(b->peak, b->image[c][i]);
    for (size_t i = 0; i < b->voxels * 3; i++)
        b->norm += (double)b->truth[i] * b->truth[i];
    b->norm = sqrt(b->norm);
}

void stab_bed_render(struct stab_bed *b, const struct rec_camera *cameras)
{
    struct picture t = {b, cameras != NULL ? cameras : b->rig.cameras};
    pvx_pool_run(b->run->pool, b->rig.n_cameras, render_camera, &t);
    rec_flame_voxels(&b->pose, &b->rig.grid, 0, b->rig.grid.n[2], b->truth);
    measure(b);
}

void stab_bed_reset(struct stab_bed *b)
{
    b->p = rec_frame_defaults;
    b->p.card = b->run->card;
    b->rng = 1;
    b->residual = false;
    b->pose = b->pose0;
    for (size_t c = 0; c < b->rig.n_cameras; c++) {
        b->present[c] = true;
        memcpy(b->image[c], b->image0[c], stab_pixels(b, c) * 3 * sizeof *b->image[c]);
    }
    memcpy(b->truth, b->truth0, b->voxels * 3 * sizeof *b->truth);
    measure(b);
}

void stab_bed_noise(struct stab_bed *b, double share)
{
    for (size_t c = 0; c < b->rig.n_cameras; c++)
        for (size_t i = 0; share > 0 && i < stab_pixels(b, c) * 3; i++)
            b->image[c][i] += (float)(share * b->peak * normal_deviate(&b->rng));
}

void stab_bed_new(struct stab_bed *b, const struct stab_run *run, enum stab_rig kind,
                  size_t cameras, enum rec_basis basis, struct stab_size size)
{
    memset(b, 0, sizeof *b);
    b->run = run;
    make_rig(&b->rig, kind, cameras, size);
    b->rig.grid.basis = basis;
    struct rec_sysmat_params p = {.binning = 1};
    CHECK(rec_sysmat_build(&b->rig, &p, run->pool, NULL, NULL, &b->S, NULL));
    b->voxels = rec_grid_count(&b->rig.grid);
    b->truth = must_floats(b->voxels * 3);
    b->truth0 = must_floats(b->voxels * 3);
    for (size_t c = 0; c < cameras; c++) {
        b->image[c] = must_floats(stab_pixels(b, c) * 3);
        b->image0[c] = must_floats(stab_pixels(b, c) * 3);
    }
    struct rec_flame flame;
    rec_flame_init(&flame, &b->rig.grid, 1);
    rec_flame_at(&flame, 0.3, &b->pose0);
    b->pose = b->pose0;
    stab_bed_render(b, NULL);
    for (size_t c = 0; c < cameras; c++)
        memcpy(b->image0[c], b->image[c], stab_pixels(b, c) * 3 * sizeof *b->image[c]);
    memcpy(b->truth0, b->truth, b->voxels * 3 * sizeof *b->truth);
    stab_bed_reset(b);
}

void stab_bed_free(struct stab_bed *b)
{
    for (size_t c = 0; c < b->rig.n_cameras; c++)
        free(b->image[c]);
    for (size_t c = 0; c < b->rig.n_cameras; c++)
        free(b->image0[c]);
    free(b->truth);
    free(b->truth0);
    rec_sysmat_free(&b->S);
    rec_rig_fini(&b->rig);
}

/* ---- the chain ----------------------------------------------------------------------------------*/

void stab_fill(const struct stab_bed *b, rec_frame *f)
{
    size_t nch = (size_t)b->p.nch, cs = nch == 3 ? 4 : 1;
    rec_frame_reset(f);
    for (size_t c = 0; c < b->rig.n_cameras; c++) {
        float *in = rec_frame_input(f, c);
        for (size_t i = 0; i < stab_pixels(b, c); i++)
            for (size_t l = 0; l < cs; l++)
                in[i * cs + l] = l < nch ? b->image[c][i * 3 + l] : 0;
        rec_frame_camera(f, c)->present = b->present[c];
    }
}

struct stab_result stab_solve(const struct stab_bed *b, rec_frame *f,
                              const struct rec_sparse *previous)
{
    struct stab_result r = {.finite = true};
    struct rec_sparse v;
    stab_fill(b, f);
    if (f->carver->matrix != NULL) {
        r.finite = stab_solve_pair(b, f, previous);
    } else {
        rec_frame_carve(f);
        CHECK(rec_frame_solve(f, 0, previous));
    }
    rec_frame_volume(f, &v);
    r.report = *rec_frame_get_report(f);
    double e = 0, amount = 0, truth = 0;
    int32_t at = 0;
    for (size_t i = 0; i < b->voxels; i++) {
        bool in = at < v.n && v.index[at] == (int32_t)i;
        for (int l = 0; l < v.nch; l++) {
            double x = in ? v.value[(size_t)at * (size_t)v.cs + (size_t)l] : 0;
            double t = b->truth[i * 3 + (size_t)l];
            r.finite = r.finite && isfinite(x) && x >= 0;
            e += (x - t) * (x - t);
            amount += x * x;
            truth += t * t;
        }
        at += in;
    }
    r.finite = r.finite && at == v.n && isfinite(r.report.solve.rel_residual) &&
               isfinite(r.report.solve.objective) && isfinite(r.report.solve.lambda);
    r.error = b->residual ? r.report.solve.rel_residual : sqrt(e) / b->norm;
    r.flame = b->residual || truth > 0;
    bool empty = r.report.solve.status == REC_EMPTY && r.report.active_voxels == 0;
    r.outcome = !r.flame      ? (amount > 0 ? "ghost" : "dark")
                : amount == 0 ? (empty ? "carved away" : "nothing")
                : r.error < 1 ? "light"
                              : "astray";
    r.ms = 1e-6 * (double)(r.report.photo_ns + r.report.hull_ns + r.report.restrict_ns +
                           r.report.solve_ns);
    return r;
}

struct stab_result stab_reconstruct(const struct stab_bed *b, const char *solver)
{
    struct rec_frame_params p = b->p;
    rec_frame *f;
    p.solve.solver = solver;
    CHECK(rec_frame_alone(b->S, &b->rig, &p, b->run->pool, &f, NULL));
    struct stab_result r = stab_solve(b, f, NULL);
    rec_frame_free(&f);
    return r;
}

struct stab_row stab_row_of(const char *name, const struct stab_bed *b, const char *solver,
                            const struct stab_result *r)
{
    return (struct stab_row){.name = name,
                             .basis = (int)b->rig.grid.basis,
                             .solver = solver,
                             .outcome = r->outcome,
                             .error = r->error,
                             .bound = STAB_MEASURED,
                             .sound = r->finite,
                             .flame = r->flame,
                             .residual = r->report.solve.rel_residual,
                             .iterations = r->report.solve.iterations,
                             .voxels = (int32_t)r->report.active_voxels,
                             .ms = r->ms};
}
