#include "recon/view/view.h"

#include <stdatomic.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/mem.h"
#include "recon/simd/kernels.h"
#include "recon/geom/traverse.h"
#include "recon/view/eye.h"

/* Image rows are dealt out in turn to this many tasks, so that the bright middle is shared evenly. */
enum { TASKS = 32 };

/* Rows y = task, task + TASKS, ... of the image. */
struct part {
    struct rec_gather v; /* [rows * w] outputs */
    size_t room;         /* entries */
    float *out;          /* [rows * w][4] */
};

/* Entries of one pixel's rays, added up by column: open addressing, small enough for the cache. */
struct sum {
    uint32_t *column; /* [mask + 1] EMPTY = free */
    double *value;
    uint32_t *slot; /* in use, in the order of coming */
    uint32_t mask, n;
};
#define EMPTY UINT32_MAX

struct rec_view {
    struct rec_camera camera; /* of eye */
    struct rec_eye eye;
    struct rec_bundle bundle; /* of the grid */
    size_t max_bytes;
    pvx_pool *pool;
    struct rec_kernels kernels;
    struct rec_grid grid; /* n[0] = 0: none yet */
    size_t voxels;
    uint8_t *lit;    /* [voxels] has a column */
    uint8_t *grown;  /* [voxels] work area */
    int32_t *number; /* [voxels] column or -1 */
    float *x;        /* [columns][4] or [columns] */
    struct part part[TASKS];
    struct rec_view_stats stats;
};

pvx_err rec_view_new(const struct rec_eye *eye, size_t max_bytes, pvx_pool *pool, rec_view **out)
{
    const struct rec_camera *c = eye->camera;
    *out = NULL;
    if (eye->sub < 1 || eye->sub > REC_RENDER_SUB_MAX || c->width < 1 || c->height < 1)
        return PVX_EINVAL;
    rec_view *v = pvx_calloc(1, sizeof *v);
    PVX_NEED(v);
    v->camera = *c;
    v->eye = *eye;
    v->eye.camera = &v->camera;
    v->max_bytes = max_bytes;
    v->pool = pool;
    rec_kernels_init(&v->kernels, PVX_CPU_BEST);
    size_t w = (size_t)c->width;
    for (int32_t t = 0; t < TASKS; t++) {
        size_t rows = t < c->height ? (size_t)((c->height - 1 - t) / TASKS) + 1 : 0;
        v->part[t].v.ptr = pvx_calloc(rows * w + 1, sizeof(uint32_t));
        v->part[t].out = pvx_calloc(rows * w * 4, sizeof(float));
        if (v->part[t].v.ptr == NULL || v->part[t].out == NULL) {
            rec_view_free(&v);
            return PVX_ENOMEM;
        }
    }
    *out = v;
    return PVX_OK;
}

static void forget_grid(rec_view *v)
{
    PVX_FREE(v->lit);
    PVX_FREE(v->grown);
    PVX_FREE(v->number);
    PVX_FREE(v->x);
    v->grid.n[0] = 0;
    v->stats.columns = 0;
}

void rec_view_free(rec_view **vp)
{
    rec_view *v = *vp;
    if (v == NULL)
        return;
    forget_grid(v);
    for (int t = 0; t < TASKS; t++) {
        free(v->part[t].v.ptr);
        free(v->part[t].v.entry);
        free(v->part[t].out);
    }
    free(v);
    *vp = NULL;
}

static pvx_err use_grid(rec_view *v, const struct rec_grid *g)
{
    if (v->grid.n[0] != 0 && v->grid.basis == g->basis &&
        memcmp(v->grid.n, g->n, sizeof g->n) == 0 &&
        memcmp(v->grid.min, g->min, sizeof g->min) == 0 &&
        memcmp(v->grid.max, g->max, sizeof g->max) == 0)
        return PVX_OK;
    forget_grid(v);
    v->voxels = rec_grid_count(g);
    v->lit = pvx_calloc(v->voxels, 1);
    v->grown = pvx_calloc(v->voxels, 1);
    v->number = pvx_calloc(v->voxels, sizeof *v->number);
    if (v->lit == NULL || v->grown == NULL || v->number == NULL) {
        forget_grid(v);
        return PVX_ENOMEM;
    }
    for (size_t i = 0; i < v->voxels; i++)
        v->number[i] = -1;
    v->grid = *g;
    rec_eye_rays(&v->eye, g, &v->bundle);
    return PVX_OK;
}

static bool has_light(const float *dense, size_t i, int nch)
{
    const float *a = dense + i * (size_t)nch;
    return a[0] != 0 || (nch == 3 && (a[1] != 0 || a[2] != 0));
}

/* ---- the columns ------------------------------------------------------------------------------ */

struct look {
    rec_view *v;
    const float *dense;
    int nch;
    atomic_bool news; /* there is light where there is no column */
};

static void look_slab(void *ctx, size_t k)
{
    struct look *t = ctx;
    rec_view *v = t->v;
    size_t layer = (size_t)v->grid.n[0] * (size_t)v->grid.n[1];
    bool news = false;
    for (size_t i = k * layer; i < (k + 1) * layer; i++)
        news = news || (v->number[i] < 0 && has_light(t->dense, i, t->nch));
    if (news)
        atomic_store(&t->news, true);
}

/* Voxels added around the light: a flame moves by a few per frame, by more on a finer grid. */
static int32_t border(const struct rec_grid *g)
{
    int32_t most = g->n[0] > g->n[1] ? g->n[0] : g->n[1];
    return 2 + (most > g->n[2] ? most : g->n[2]) / 32;
}

/* lit = lit and all voxels within `by` of it along `axis`. */
static void view_grow(rec_view *v, int axis, int32_t by)
{
    const int32_t *n = v->grid.n;
    size_t stride = axis == 0 ? 1 : axis == 1 ? (size_t)n[0] : (size_t)n[0] * (size_t)n[1];
    memset(v->grown, 0, v->voxels);
    for (size_t i = 0; i < v->voxels; i++) {
        if (!v->lit[i])
            continue;
        int32_t at = (int32_t)(i / stride % (size_t)n[axis]);
        for (int32_t d = -by; d <= by; d++)
            if (at + d >= 0 && at + d < n[axis])
                v->grown[(size_t)((int64_t)i + d * (int64_t)stride)] = 1;
    }
    memcpy(v->lit, v->grown, v->voxels);
}

static pvx_err number_columns(rec_view *v, const float *dense, int nch)
{
    int32_t n = 0;
    for (size_t i = 0; i < v->voxels; i++)
        v->lit[i] |= has_light(dense, i, nch);
    for (int a = 0; a < 3; a++)
        view_grow(v, a, border(&v->grid));
    for (size_t i = 0; i < v->voxels; i++)
        v->number[i] = v->lit[i] ? n++ : -1;
    v->stats.columns = n;
    free(v->x);
    v->x = pvx_calloc((size_t)n * 4, sizeof *v->x);
    return v->x != NULL ? PVX_OK : PVX_ENOMEM;
}

/* ---- the rays --------------------------------------------------------------------------------- */

struct trace {
    rec_view *v;
    size_t max; /* entries of one ray */
    _Atomic uint64_t entries;
    _Atomic int err;
};

static bool sum_init(struct sum *s, size_t most)
{
    size_t size = 16;
    while (size < 2 * most)
        size *= 2;
    s->mask = (uint32_t)(size - 1);
    s->n = 0;
    s->column = malloc(size * sizeof *s->column);
    s->value = malloc(size * sizeof *s->value);
    s->slot = malloc(size * sizeof *s->slot);
    if (s->column == NULL || s->value == NULL || s->slot == NULL)
        return false;
    memset(s->column, 0xff, size * sizeof *s->column);
    return true;
}

static void sum_fini(struct sum *s)
{
    free(s->column);
    free(s->value);
    free(s->slot);
}

static void sum_add(struct sum *s, uint32_t column, double value)
{
    uint32_t k = column * 2654435761u >> 7 & s->mask;
    while (s->column[k] != EMPTY && s->column[k] != column)
        k = (k + 1) & s->mask;
    if (s->column[k] == EMPTY) {
        s->column[k] = column;
        s->value[k] = 0;
        s->slot[s->n++] = k;
    }
    s->value[k] += value;
}

/* Move the sum's entries to the end of the part, which has room for them. */
static void sum_unload(struct sum *s, struct rec_entry *out, double factor)
{
    for (uint32_t i = 0; i < s->n; i++) {
        uint32_t k = s->slot[i];
        out[i] = (struct rec_entry){s->column[k], (float)(s->value[k] * factor)};
        s->column[k] = EMPTY;
    }
    s->n = 0;
}

static bool view_make_room(struct part *p, size_t entries)
{
    if (entries <= p->room)
        return true;
    size_t room = entries + entries / 2 + 4096;
    struct rec_entry *e = realloc(p->v.entry, room * sizeof *e);
    if (e == NULL)
        return false;
    p->v.entry = e;
    p->room = room;
    return true;
}

/* One pixel's rays into the sum. */
static void trace_pixel(const rec_view *v, int32_t x, int32_t y, int32_t *index, float *value,
                        struct sum *s)
{
    for (int32_t i = 0; i < rec_bundle_rays(&v->bundle); i++) {
        size_t n =
            rec_eye_ray(&v->eye, &v->bundle, &v->grid, (const int32_t[2]){x, y}, i, index, value);
        for (size_t e = 0; e < n; e++)
            if (v->number[index[e]] >= 0)
                sum_add(s, (uint32_t)v->number[index[e]], value[e]);
    }
}

static void trace_part(void *ctx, size_t task)
{
    struct trace *t = ctx;
    rec_view *v = t->v;
    struct part *p = &v->part[task];
    struct sum s = {0};
    int32_t *index = malloc(t->max * sizeof *index);
    float *value = malloc(t->max * sizeof *value);
    size_t rays = (size_t)rec_bundle_rays(&v->bundle) * t->max, columns = (size_t)v->stats.columns;
    uint32_t at = 0;
    size_t pixel = 0;
    int err = PVX_OK;
    if (index == NULL || value == NULL || !sum_init(&s, rays < columns ? rays : columns))
        err = PVX_ENOMEM;
    p->v.ptr[0] = 0;
    for (int32_t y = (int32_t)task; y < v->camera.height && err == PVX_OK; y += TASKS) {
        uint32_t before = at;
        for (int32_t x = 0; x < v->camera.width && err == PVX_OK; x++) {
            trace_pixel(v, x, y, index, value, &s);
            if ((size_t)at + s.n > UINT32_MAX)
                err = PVX_ERANGE;
            else if (!view_make_room(p, (size_t)at + s.n))
                err = PVX_ENOMEM;
            else {
                uint32_t n = s.n;
                sum_unload(&s, p->v.entry + at, 1.0 / rec_bundle_rays(&v->bundle));
                at += n;
                p->v.ptr[++pixel] = at;
            }
        }
        uint64_t all = atomic_fetch_add(&t->entries, at - before) + (at - before);
        if (all * sizeof(struct rec_entry) > v->max_bytes)
            err = PVX_ERANGE;
        if (atomic_load(&t->err) != PVX_OK) /* an error of another part */
            break;
    }
    if (err != PVX_OK)
        atomic_store(&t->err, err);
    sum_fini(&s);
    free(index);
    free(value);
}

static pvx_err view_trace(rec_view *v)
{
    struct trace t = {.v = v, .max = rec_traverse_max(&v->grid)};
    pvx_pool_run(v->pool, TASKS, trace_part, &t);
    v->stats.entries = atomic_load(&t.entries);
    v->stats.traced++;
    return (pvx_err)atomic_load(&t.err);
}

/* ---- the product ------------------------------------------------------------------------------ */

struct product {
    rec_view *v;
    const float *dense;
    int nch;
    float *image;
};

static void gather_x(void *ctx, size_t k)
{
    const struct product *t = ctx;
    rec_view *v = t->v;
    size_t layer = (size_t)v->grid.n[0] * (size_t)v->grid.n[1];
    for (size_t i = k * layer; i < (k + 1) * layer; i++) {
        if (v->number[i] < 0)
            continue;
        size_t q = (size_t)v->number[i];
        const float *a = t->dense + i * (size_t)t->nch;
        if (t->nch == 1)
            v->x[q] = a[0];
        else
            memcpy(v->x + q * 4, (float[4]){a[0], a[1], a[2], 0}, 4 * sizeof *v->x);
    }
}

static void view_multiply(void *ctx, size_t task)
{
    const struct product *t = ctx;
    const rec_view *v = t->v;
    const struct part *p = &v->part[task];
    size_t w = (size_t)v->camera.width, nch = (size_t)t->nch, cs = nch == 3 ? 4 : 1, row = 0;
    for (int32_t y = (int32_t)task; y < v->camera.height; y += TASKS, row++) {
        (cs == 4 ? v->kernels.gather4 : v->kernels.gather1)(&p->v, (int32_t)(row * w),
                                                            (int32_t)((row + 1) * w), v->x, p->out);
        float *out = t->image + (size_t)y * w * nch;
        for (size_t i = 0; i < w; i++)
            memcpy(out + i * nch, p->out + (row * w + i) * cs, nch * sizeof *out);
    }
}

pvx_err rec_view_render(rec_view *v, const struct rec_grid *g, const float *dense, int nch,
                        float *image)
{
    if (nch != 1 && nch != 3)
        return PVX_EINVAL;
    int64_t t0 = pvx_now_mono(), tracing = 0;
    PVX_TRY(use_grid(v, g));
    struct look look = {.v = v, .dense = dense, .nch = nch};
    pvx_pool_run(v->pool, (size_t)g->n[2], look_slab, &look);
    if (atomic_load(&look.news)) {
        int64_t t1 = pvx_now_mono();
        pvx_err e = number_columns(v, dense, nch);
        PVX_THEN(e, view_trace(v));
        tracing = pvx_now_mono() - t1;
        v->stats.trace_ns += tracing;
        if (e != PVX_OK) {
            forget_grid(v);
            return e;
        }
    }
    if (v->stats.columns == 0) {
        memset(image, 0,
               (size_t)v->camera.width * (size_t)v->camera.height * (size_t)nch * sizeof *image);
    } else {
        struct product p = {v, dense, nch, image};
        pvx_pool_run(v->pool, (size_t)g->n[2], gather_x, &p);
        pvx_pool_run(v->pool, TASKS, view_multiply, &p);
    }
    v->stats.rendered++;
    v->stats.product_ns += pvx_now_mono() - t0 - tracing;
    return PVX_OK;
}

void rec_view_get_stats(const rec_view *v, struct rec_view_stats *out)
{
    *out = v->stats;
}
