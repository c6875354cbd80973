#include "recon/check/resolution.h"

#include <math.h>
#include <stdlib.h>

#include "base/mem.h"

#define HALF 0.5

static const double sizes[REC_RESOLUTION_WAVES] = {1, 1.5, 2, 3, 4, 6, 8};

struct lanczos {
    const struct rec_subsys *a;
    struct rec_images *im;
    float *q, *before, *next, *y; /* [n] three times, [room] */
    double diagonal[REC_RESOLUTION_STEPS], beside[REC_RESOLUTION_STEPS];
    size_t steps;
};

static double resolution_dot(const struct lanczos *z, const float *u, const float *v)
{
    double out[4];
    rec_dot(z->a, z->a->n, u, v, out);
    return out[0];
}

/* T of N, started at v; the steps end early when no new direction appears. */
static void resolution_run(struct lanczos *z, const float *v)
{
    size_t n = (size_t)z->a->n;
    double norm = sqrt(resolution_dot(z, v, v)), top = 0;
    z->steps = 0;
    for (size_t i = 0; i < n && norm > 0; i++) {
        z->q[i] = (float)((double)v[i] / norm);
        z->before[i] = 0;
    }
    for (size_t k = 0; k < REC_RESOLUTION_STEPS && norm > 1e-6 * top; k++) {
        double beta = k > 0 ? z->beside[k - 1] : 0;
        rec_forward(z->a, z->im, z->q, z->y);
        rec_adjoint_range(z->a, z->y, 0, z->a->n, z->next);
        double alpha = resolution_dot(z, z->q, z->next);
        for (size_t i = 0; i < n; i++)
            z->next[i] -= (float)(alpha * (double)z->q[i] + beta * (double)z->before[i]);
        norm = sqrt(resolution_dot(z, z->next, z->next));
        z->diagonal[k] = alpha;
        z->beside[k] = norm;
        z->steps = k + 1;
        top = fmax(top, alpha);
        for (size_t i = 0; i < n && norm > 0; i++) {
            z->before[i] = z->q[i];
            z->q[i] = (float)((double)z->next[i] / norm);
        }
    }
}

/* (T (T + mu I)^-1)_11 = 1 - mu ((T + mu I)^-1)_11, a continued fraction from the last row up. */
static double resolution_share_of(const struct lanczos *z, double mu)
{
    double pivot = 0;
    for (size_t k = z->steps; k-- > 0;) {
        double b = k + 1 < z->steps ? z->beside[k] : 0;
        pivot = z->diagonal[k] + mu - (b > 0 ? b * b / pivot : 0);
    }
    return z->steps > 0 ? fmin(fmax(1 - mu / pivot, 0), 1) : 0;
}

static pvx_err resolution_allocate(struct lanczos *z)
{
    size_t n = (size_t)z->a->n + 1;
    z->q = pvx_calloc(n, sizeof *z->q);
    z->before = pvx_calloc(n, sizeof *z->before);
    z->next = pvx_calloc(n, sizeof *z->next);
    z->y = pvx_calloc(z->a->S->win.room, sizeof *z->y);
    return z->q != NULL && z->before != NULL && z->next != NULL && z->y != NULL ? PVX_OK
                                                                                : PVX_ENOMEM;
}

static void resolution_release(struct lanczos *z)
{
    free(z->q);
    free(z->before);
    free(z->next);
    free(z->y);
}

pvx_err rec_resolution_share(const struct rec_subsys *a, struct rec_images *im, const float *v,
                             const double *mu, size_t n, double *share)
{
    struct lanczos z = {.a = a, .im = im};
    pvx_err e = resolution_allocate(&z);
    if (e == PVX_OK)
        resolution_run(&z, v);
    for (size_t i = 0; i < n && e == PVX_OK; i++)
        share[i] = resolution_share_of(&z, mu[i]);
    resolution_release(&z);
    return e;
}

/* Size from which on all shares are above one half, interpolated between two sizes. */
static double resolution_least(const struct rec_resolution *r, int axis, int noise)
{
    const double *s = r->share[axis][noise];
    size_t k = REC_RESOLUTION_WAVES;
    while (k > 0 && s[k - 1] >= HALF)
        k--;
    if (k == REC_RESOLUTION_WAVES)
        return INFINITY;
    double at = r->size[k];
    if (k > 0)
        at -= (r->size[k] - r->size[k - 1]) * (s[k] - HALF) / fmax(s[k] - s[k - 1], 1e-9);
    return at * r->voxel[axis];
}

/* Half a wave of `size` voxels along an axis, from a phase that favours neither nodes nor crests. */
static void wave(const struct rec_subsys *a, int axis, double size, float *v)
{
    const struct rec_grid *g = &a->S->grid;
    int32_t step = axis == 0 ? 1 : axis == 1 ? g->n[0] : g->n[0] * g->n[1];
    for (int32_t q = 0; q < a->n; q++)
        v[q] =
            (float)cos(3.14159265358979 * ((double)(a->col[q] / step % g->n[axis]) / size + 0.25));
}

pvx_err rec_resolution_find(const struct rec_subsys *a, struct rec_images *im, double noise,
                            struct rec_resolution *out)
{
    const double mu[2] = {noise * noise, noise * noise / 16};
    float *v = pvx_calloc((size_t)a->n + 1, sizeof *v);
    pvx_err e = v == NULL ? PVX_ENOMEM : PVX_OK;
    *out = (struct rec_resolution){.least = {{0}}};
    for (int k = 0; k < REC_RESOLUTION_WAVES; k++)
        out->size[k] = sizes[k];
    for (int axis = 0; axis < 3 && e == PVX_OK; axis++) {
        out->voxel[axis] = rec_grid_h(&a->S->grid, axis);
        for (int k = 0; k < REC_RESOLUTION_WAVES && e == PVX_OK; k++) {
            double share[2];
            wave(a, axis, sizes[k], v);
            e = rec_resolution_share(a, im, v, mu, 2, share);
            for (int i = 0; i < 2 && e == PVX_OK; i++)
                out->share[axis][i][k] = share[i];
        }
        for (int i = 0; i < 2; i++)
            out->least[axis][i] = resolution_least(out, axis, i);
    }
    free(v);
    return e;
}
