#include "recon/solve/flow.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"

#define FINEST     40 /* cells along an axis of level 0, at most */
#define COARSEST   6  /* cells along an axis at least, or as many as the grid has */
#define MAX_LEVELS 4
#define ROUNDS     2
#define ITERATIONS 12
#define SMOOTH     0.2f
#define TINY       1e-30f

enum { FROM, TO, MOVED, GX, GY, GZ, UX, UY, UZ, VX, VY, VZ, U0, V0, W0, N_FIELDS };

/* Cell (i, j, k) is at i + wide (j + n1 k), with a rim of one cell along x. */
struct level {
    int32_t n[3], wide;
    float *v[N_FIELDS];
};

struct rec_flow {
    struct rec_grid grid;
    int shift, levels; /* cells of 2^shift voxels; level 0 is the finest */
    struct level at[MAX_LEVELS];
    struct level *now; /* level of the running tasks */
    float alpha;
    bool back; /* u is in V, else in U */
    double square[FINEST + 1][2];
    float *room;
};

static size_t flow_cells(const struct level *v)
{
    return (size_t)v->wide * (size_t)v->n[1] * (size_t)v->n[2];
}
static size_t row_of(const struct level *v, int32_t j, int32_t k)
{
    j = j < 0 ? 0 : j >= v->n[1] ? v->n[1] - 1 : j;
    k = k < 0 ? 0 : k >= v->n[2] ? v->n[2] - 1 : k;
    return (size_t)v->wide * ((size_t)j + (size_t)v->n[1] * (size_t)k) + 1;
}

static size_t flow_lay_out(rec_flow *f, float *room)
{
    size_t end = 0;
    for (int i = 0; i < f->levels; i++)
        for (int k = 0; k < N_FIELDS; k++) {
            f->at[i].v[k] = room == NULL ? NULL : room + end;
            end += flow_cells(&f->at[i]);
        }
    return end;
}

static bool small_enough(const struct rec_grid *g, int shift)
{
    bool fits = true;
    for (int a = 0; a < 3; a++)
        fits = fits && (g->n[a] + (1 << shift) - 1) >> shift <= FINEST;
    return fits;
}

pvx_err rec_flow_new(const struct rec_grid *g, rec_flow **out)
{
    rec_flow *f = *out = pvx_calloc(1, sizeof *f);
    if (f == NULL)
        return PVX_ENOMEM;
    f->grid = *g;
    for (f->shift = 1; !small_enough(g, f->shift);)
        f->shift++;
    for (bool more = true; more && f->levels < MAX_LEVELS; f->levels++) {
        struct level *v = &f->at[f->levels];
        for (int a = 0; a < 3; a++) {
            int s = f->shift + f->levels;
            v->n[a] = (g->n[a] + (1 << s) - 1) >> s;
            more = more && v->n[a] >= 2 * COARSEST;
        }
        v->wide = v->n[0] + 2;
    }
    f->room = pvx_calloc(flow_lay_out(f, NULL), sizeof *f->room);
    if (f->room == NULL) {
        rec_flow_free(out);
        return PVX_ENOMEM;
    }
    flow_lay_out(f, f->room);
    return PVX_OK;
}

void rec_flow_free(rec_flow **f)
{
    if (*f == NULL)
        return;
    free((*f)->room);
    PVX_FREE(*f);
}

/* ---- the two volumes on all levels --------------------------------------------------------------*/

static void flow_put(rec_flow *f, const struct rec_flow_volume *x, int field)
{
    struct level *v = &f->at[0];
    memset(v->v[field], 0, flow_cells(v) * sizeof(float));
    for (int32_t q = 0; q < x->n; q++) {
        int32_t ijk[3];
        float sum = 0;
        rec_grid_ijk(&f->grid, x->index[q], ijk);
        for (int l = 0; l < x->nch; l++)
            sum += x->value[(size_t)q * (size_t)x->cs + (size_t)l];
        v->v[field][row_of(v, ijk[1] >> f->shift, ijk[2] >> f->shift) +
                    (size_t)(ijk[0] >> f->shift)] += sum;
    }
    for (int l = 1; l < f->levels; l++) {
        const struct level *fine = &f->at[l - 1];
        v = &f->at[l];
        memset(v->v[field], 0, flow_cells(v) * sizeof(float));
        for (int32_t k = 0; k < fine->n[2]; k++)
            for (int32_t j = 0; j < fine->n[1]; j++)
                for (int32_t i = 0; i < fine->n[0]; i++)
                    v->v[field][row_of(v, j / 2, k / 2) + (size_t)(i / 2)] +=
                        fine->v[field][row_of(fine, j, k) + (size_t)i] / 8;
    }
}

/* ---- one level ----------------------------------------------------------------------------------*/

/* Position of a point between two cells of an axis of n. */
struct between {
    int32_t i[2];
    float t;
};
static struct between flow_between(float x, int32_t n)
{
    x = x > 0 ? x : 0; /* NaN too */
    x = x < (float)(n - 1) ? x : (float)(n - 1);
    int32_t i = (int32_t)x;
    return (struct between){{i, i + 1 < n ? i + 1 : i}, x - (float)i};
}
static float flow_sample(const struct level *v, const float *of, const struct between b[3])
{
    float sum = 0;
    for (int c = 0; c < 4; c++) {
        const float *row = of + row_of(v, b[1].i[c & 1], b[2].i[c >> 1]);
        float w = (c & 1 ? b[1].t : 1 - b[1].t) * (c >> 1 ? b[2].t : 1 - b[2].t);
        sum += w * (row[b[0].i[0]] * (1 - b[0].t) + row[b[0].i[1]] * b[0].t);
    }
    return sum;
}

/* Sets u0 = u, and w. */
static void move_layer(void *ctx, size_t k)
{
    rec_flow *f = ctx;
    const struct level *v = f->now;
    for (int32_t j = 0; j < v->n[1]; j++)
        for (int32_t i = 0; i < v->n[0]; i++) {
            size_t at = row_of(v, j, (int32_t)k) + (size_t)i;
            const float x[3] = {(float)i, (float)j, (float)k};
            struct between b[3];
            for (int a = 0; a < 3; a++) {
                v->v[U0 + a][at] = v->v[UX + a][at];
                b[a] = flow_between(x[a] - v->v[UX + a][at], v->n[a]);
            }
            v->v[MOVED][at] = flow_sample(v, v->v[FROM], b);
        }
}

/* Sets G, and the sums for alpha. */
static void gradient_layer(void *ctx, size_t layer)
{
    rec_flow *f = ctx;
    const struct level *v = f->now;
    int32_t k = (int32_t)layer, last = v->n[0] - 1;
    double s2 = 0, s4 = 0;
    for (int32_t j = 0; j < v->n[1]; j++) {
        size_t row = row_of(v, j, k), y0 = row_of(v, j - 1, k), y1 = row_of(v, j + 1, k);
        size_t z0 = row_of(v, j, k - 1), z1 = row_of(v, j, k + 1);
        for (int32_t i = 0; i <= last; i++) {
            size_t m = (size_t)i, l = (size_t)(i > 0 ? i - 1 : i),
                   r = (size_t)(i < last ? i + 1 : i);
            float g[3] = {0};
            for (int of = TO; of <= MOVED; of++) {
                const float *e = v->v[of];
                g[0] += 0.25f * (e[row + r] - e[row + l]);
                g[1] += 0.25f * (e[y1 + m] - e[y0 + m]);
                g[2] += 0.25f * (e[z1 + m] - e[z0 + m]);
            }
            double s = (double)g[0] * g[0] + (double)g[1] * g[1] + (double)g[2] * g[2];
            s2 += s;
            s4 += s * s;
            for (int a = 0; a < 3; a++)
                v->v[GX + a][row + m] = g[a];
        }
    }
    f->square[layer][0] = s2;
    f->square[layer][1] = s4;
}

/* One Jacobi iteration of (1), from U to V or back. */
static void iterate_layer(void *ctx, size_t layer)
{
    const rec_flow *f = ctx;
    const struct level *v = f->now;
    int32_t k = (int32_t)layer;
    const int in = f->back ? VX : UX, out = f->back ? UX : VX;
    const float six = 6 * f->alpha;
    for (int32_t j = 0; j < v->n[1]; j++) {
        size_t row = row_of(v, j, k), y0 = row_of(v, j - 1, k), y1 = row_of(v, j + 1, k);
        size_t z0 = row_of(v, j, k - 1), z1 = row_of(v, j, k + 1);
        for (size_t i = 0; i < (size_t)v->n[0]; i++) {
            float m[3], r = v->v[TO][row + i] - v->v[MOVED][row + i], den = six;
            for (int a = 0; a < 3; a++) {
                const float *u = v->v[in + a];
                float g = v->v[GX + a][row + i];
                m[a] = (u[row + i - 1] + u[row + i + 1] + u[y0 + i] + u[y1 + i] + u[z0 + i] +
                        u[z1 + i]) /
                       6;
                r += g * (m[a] - v->v[U0 + a][row + i]);
                den += g * g;
            }
            for (int a = 0; a < 3; a++) {
                float old = v->v[U0 + a][row + i], x = m[a] - v->v[GX + a][row + i] * r / den;
                x = x < old + 1 ? x : old + 1;
                v->v[out + a][row + i] = x > old - 1 ? x : old - 1;
            }
        }
        for (int a = 0; a < 3; a++) { /* the rim */
            float *u = v->v[out + a] + row;
            u[-1] = u[0];
            u[v->n[0]] = u[v->n[0] - 1];
        }
    }
}

static void solve_level(rec_flow *f, pvx_pool *pool)
{
    size_t layers = (size_t)f->now->n[2];
    for (int round = 0; round < ROUNDS; round++) {
        double s2 = 0, s4 = 0;
        pvx_pool_run(pool, layers, move_layer, f);
        pvx_pool_run(pool, layers, gradient_layer, f);
        for (size_t k = 0; k < layers; k++) {
            s2 += f->square[k][0];
            s4 += f->square[k][1];
        }
        f->alpha = s2 > 0 && isfinite(s4 / s2) ? SMOOTH * (float)(s4 / s2) + TINY : 1;
        for (int i = 0; i < ITERATIONS; i++) { /* an even number: u ends in U */
            f->back = i % 2 != 0;
            pvx_pool_run(pool, layers, iterate_layer, f);
        }
    }
}

/* Sets U of level l, with its rim, from the next coarser level. */
static void begin_level(rec_flow *f, int l)
{
    struct level *v = &f->at[l];
    const struct level *c = &f->at[l + 1];
    for (int a = 0; a < 3; a++) {
        memset(v->v[UX + a], 0, flow_cells(v) * sizeof(float));
        for (int32_t k = 0; l + 1 < f->levels && k < v->n[2]; k++)
            for (int32_t j = 0; j < v->n[1]; j++)
                for (int32_t i = -1; i <= v->n[0]; i++) {
                    int32_t in = i < 0 ? 0 : i < v->n[0] ? i : v->n[0] - 1;
                    const struct between b[3] = {flow_between(((float)in - 0.5f) / 2, c->n[0]),
                                                 flow_between(((float)j - 0.5f) / 2, c->n[1]),
                                                 flow_between(((float)k - 0.5f) / 2, c->n[2])};
                    v->v[UX + a][row_of(v, j, k) + (size_t)in + (size_t)(i - in)] =
                        2 * flow_sample(c, c->v[UX + a], b);
                }
    }
}

void rec_flow_find(rec_flow *f, const struct rec_flow_volume *from,
                   const struct rec_flow_volume *to, pvx_pool *pool)
{
    flow_put(f, from, FROM);
    flow_put(f, to, TO);
    for (int l = f->levels - 1; l >= 0; l--) {
        f->now = &f->at[l];
        begin_level(f, l);
        solve_level(f, pool);
    }
}

void rec_flow_at(const rec_flow *f, const int32_t ijk[3], float u[3])
{
    const struct level *v = &f->at[0];
    float cell = (float)(1 << f->shift);
    struct between b[3];
    for (int a = 0; a < 3; a++)
        b[a] = flow_between(((float)ijk[a] + 0.5f) / cell - 0.5f, v->n[a]);
    for (int a = 0; a < 3; a++)
        u[a] = cell * flow_sample(v, v->v[UX + a], b);
}
