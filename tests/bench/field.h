/* field.h - an emission field as truth: a volume from disk, trilinear between its cell centres and
 * zero outside, or a function.
 *
 * Line integrals are midpoint sums in quarter-cell steps, never the system matrix. */
#ifndef BENCH_FIELD_H
#define BENCH_FIELD_H
#include <unistd.h>

#include "base.h"
#include "capture/files/imgio.h"
#include "recon/geom/body.h"
#include "recon/geom/camera.h"
#include "recon/geom/grid.h"
#include "tests/lib/centre.h"

struct field {
    float *v;                                     /* [n2][n1][n0][3], or NULL and */
    void (*at)(const double x[3], double out[3]); /* a function that does not bend within a cell */
    int n[3];                                     /* 0: no field */
    double lo[3], hi[3];
    double absorb; /* of its own light: kappa over the mean of the channels' emission */
    const struct rec_bodies *bodies; /* rays end there; or NULL */
};

/* The volume of a file, its box set by the caller.  false: no such file (one that is there and cannot be
 * read ends the program). */
static inline bool field_load(struct field *f, const char *path)
{
    size_t shape[4];
    int ndim;
    struct pvx_diag d = {""};
    if (access(path, R_OK) != 0)
        return false;
    if (cap_npy_load(path, &f->v, shape, &ndim, &d) != PVX_OK || ndim != 4 || shape[3] != 3) {
        fprintf(stderr, "%s: not a volume [z][y][x][3]: %s\n", path, d.text);
        exit(1);
    }
    for (int a = 0; a < 3; a++)
        f->n[a] = (int)shape[2 - a];
    return true;
}

/* Blocks of 8 x 8 x 8 of the cells between the voxels' centres: whether one of their corners is not 0. */
static inline size_t field_block(const struct field *f, int i, int j, int k)
{
    size_t nx = (size_t)f->n[0] / 8 + 1, ny = (size_t)f->n[1] / 8 + 1;
    return (((size_t)(k + 1) / 8) * ny + (size_t)(j + 1) / 8) * nx + (size_t)(i + 1) / 8;
}
static inline bool *field_blocks(const struct field *f)
{
    bool *lit = NULL;
    if (f->at != NULL)
        return NULL;
    lit = calloc(field_block(f, f->n[0] - 1, f->n[1] - 1, f->n[2] - 1) + 1, sizeof *lit);
    CHECK(lit != NULL ? PVX_OK : PVX_ENOMEM);
    const float *v = f->v;
    for (int k = 0; k < f->n[2]; k++)
        for (int j = 0; j < f->n[1]; j++)
            for (int i = 0; i < f->n[0]; i++, v += 3)
                for (int c = 0; c < 8 && (v[0] != 0 || v[1] != 0 || v[2] != 0); c++)
                    lit[field_block(f, i - (c & 1), j - (c >> 1 & 1), k - (c >> 2))] = true;
    return lit;
}

/* lit: of field_blocks, or NULL. */
static inline void field_at(const struct field *f, const bool *lit, const double x[3],
                            double out[3])
{
    int i[3];
    double t[3];
    if (f->at != NULL) {
        f->at(x, out);
        return;
    }
    out[0] = out[1] = out[2] = 0;
    for (int a = 0; a < 3; a++) {
        double u = (x[a] - f->lo[a]) / (f->hi[a] - f->lo[a]) * f->n[a] - 0.5;
        if (!(u > -1 && u < f->n[a]))
            return;
        i[a] = (int)u - (u < (int)u);
        t[a] = u - i[a];
    }
    if (lit != NULL && !lit[field_block(f, i[0], i[1], i[2])])
        return;
    if (i[0] >= 0 && i[1] >= 0 && i[2] >= 0 && i[0] + 1 < f->n[0] && i[1] + 1 < f->n[1] &&
        i[2] + 1 < f->n[2]) { /* the same without looking where each corner is */
        size_t row = 3 * (size_t)f->n[0], slice = row * (size_t)f->n[1];
        const float *v = f->v + (size_t)i[2] * slice + (size_t)i[1] * row + (size_t)i[0] * 3;
        for (int c = 0; c < 8; c += 2) {
            const float *at = v + (c & 2 ? row : 0) + (c & 4 ? slice : 0);
            double y = c & 2 ? t[1] : 1 - t[1], z = c & 4 ? t[2] : 1 - t[2];
            double w[2] = {(1 - t[0]) * y * z, t[0] * y * z};
            for (int ch = 0; ch < 3; ch++)
                out[ch] = out[ch] + w[0] * at[ch] + w[1] * at[3 + ch];
        }
        return;
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

/* Integral along the part of the ray inside the field, times the transmission from there to its origin. */
static inline void field_ray(const struct field *f, const bool *lit, const double o[3],
                             const double d[3], double out[3])
{
    double s0 = 0, s1 = 1e9, cell = 1e9, depth = 0;
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
    if (f->bodies != NULL)
        s1 = fmin(s1, rec_body_hit(f->bodies, o, d));
    if (s1 <= s0)
        return;
    int steps = (int)ceil((s1 - s0) / (cell / 4));
    double ds = (s1 - s0) / steps;
    for (int i = 0; i < steps; i++) {
        double x[3], e[3];
        for (int a = 0; a < 3; a++)
            x[a] = o[a] + (s0 + (i + 0.5) * ds) * d[a];
        field_at(f, lit, x, e);
        double thick = f->absorb * (e[0] + e[1] + e[2]) / 3 * ds;
        double through = f->absorb > 0 ? exp(-depth - 0.5 * thick) : 1;
        for (int ch = 0; ch < 3; ch++)
            out[ch] += e[ch] * ds * through;
        depth += thick;
    }
}

struct field_job {
    const struct field *f;
    const bool *lit;
    const struct rec_camera *c;
    const struct rec_grid *g;
    float *out;
};

static inline void field_row(void *ctx, size_t y)
{
    const struct field_job *j = ctx;
    enum { SUB = 2 };
    for (int32_t x = 0; x < j->c->width; x++)
        for (int s = 0; s < SUB * SUB; s++) {
            double o[3], d[3], rgb[3];
            if (!rec_camera_ray(j->c, x + (s % SUB + 0.5) / SUB - 0.5,
                                (double)y + (s / SUB + 0.5) / SUB - 0.5, o, d))
                continue;
            field_ray(j->f, j->lit, o, d, rgb);
            for (int ch = 0; ch < 3; ch++)
                j->out[(y * (size_t)j->c->width + (size_t)x) * 3 + (size_t)ch] +=
                    (float)(rgb[ch] / (SUB * SUB));
        }
}

/* What camera c sees, [h][w][3]: mean over 2 x 2 rays per pixel.  Owner: caller. */
static inline float *field_image(const struct field *f, const struct rec_camera *c, pvx_pool *pool)
{
    bool *lit = field_blocks(f);
    struct field_job j = {f, lit, c, NULL, must_floats((size_t)c->width * (size_t)c->height * 3)};
    pvx_pool_run(pool, (size_t)c->height, field_row, &j);
    free(lit);
    return j.out;
}

static inline void field_slice(void *ctx, size_t k)
{
    const struct field_job *j = ctx;
    const struct rec_grid *g = j->g;
    size_t slice = (size_t)g->n[0] * (size_t)g->n[1];
    int m = g->basis == REC_BOX ? 4 : 1;
    for (size_t i = k * slice; i < (k + 1) * slice; i++) {
        double c[3], e[3];
        grid_centre(g, (int32_t)i, c);
        for (int s = 0; s < m * m * m; s++) {
            double off[3] = {(s % m + 0.5) / m - 0.5, (s / m % m + 0.5) / m - 0.5,
                             (s / m / m + 0.5) / m - 0.5};
            double x[3] = {c[0] + off[0] * rec_grid_h(g, 0), c[1] + off[1] * rec_grid_h(g, 1),
                           c[2] + off[2] * rec_grid_h(g, 2)};
            field_at(j->f, NULL, x, e);
            for (int ch = 0; ch < 3; ch++)
                j->out[i * 3 + (size_t)ch] += (float)(e[ch] / (m * m * m));
        }
    }
}

/* Truth on a grid, [nz][ny][nx][3]: mean over the cell (box) or value at its centre (trilinear). */
static inline float *field_voxels(const struct field *f, const struct rec_grid *g, pvx_pool *pool)
{
    struct field_job j = {f, NULL, NULL, g, must_floats(rec_grid_count(g) * 3)};
    pvx_pool_run(pool, (size_t)g->n[2], field_slice, &j);
    return j.out;
}

#endif
