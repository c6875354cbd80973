/* Products with the restricted system, and sums over its columns. */
#include <string.h>

#include "base/mem.h"
#include "recon/matrix/collect.h"

/* The first of a slab's further windows that is of column q or later. */
static const struct rec_more *more_from(const struct rec_subsys *a, int32_t slab, int32_t q)
{
    const struct rec_more_run run = {a->win.more + a->more_at[slab],
                                     a->win.more + a->more_end[slab]};
    return rec_more_from(run, (uint32_t)q);
}

/* y += w x[q] of the further windows of a slab. */
static void scatter_more(const struct rec_subsys *a, size_t slab, struct rec_slots slots,
                         const float *x, float *y)
{
    const struct rec_more_run run = {a->win.more + a->more_at[slab],
                                     a->win.more + a->more_end[slab]};
    if (run.at < run.end)
        (a->cs == 4 ? a->k->scatter4_more : a->k->scatter1_more)(&a->win, slots, run, x, y);
}

void rec_adjoint_cameras(const struct rec_subsys *a, struct rec_cameras c, const float *y,
                         int32_t q0, int32_t q1, float *x)
{
    const struct rec_slots slots = {c.c0, c.c1};
    (a->cs == 4 ? a->k->adjoint4 : a->k->adjoint1)(&a->win, slots, q0, q1, y, x);
    for (int32_t s = 0; s < a->slabs && a->win.n_more > 0; s++) {
        const struct rec_more_run run = {more_from(a, s, q0), more_from(a, s, q1)};
        if (run.at < run.end)
            (a->cs == 4 ? a->k->adjoint4_more : a->k->adjoint1_more)(&a->win, slots, run, y, x);
    }
}
void rec_adjoint_range(const struct rec_subsys *a, const float *y, int32_t q0, int32_t q1, float *x)
{
    rec_adjoint_cameras(a, (struct rec_cameras){0, a->win.slots}, y, q0, q1, x);
}

pvx_err rec_images_new(const rec_sysmat *S, int cs, struct rec_images *out)
{
    bool ok = true;
    *out = (struct rec_images){.bytes = (size_t)S->win.room * (size_t)cs * sizeof(float)};
    for (size_t s = 0; s < REC_SLABS_MAX; s++) {
        out->of[s] = pvx_reserve(out->bytes);
        ok = ok && out->of[s] != NULL;
    }
    if (!ok)
        rec_images_free(out);
    return ok ? PVX_OK : PVX_ENOMEM;
}
void rec_images_free(struct rec_images *im)
{
    for (size_t s = 0; s < REC_SLABS_MAX; s++)
        pvx_unreserve(im->of[s], im->bytes);
    *im = (struct rec_images){0};
}

struct product {
    const struct rec_subsys *a;
    struct rec_images *im;
    struct rec_cameras c;
    const float *x;
    float *y;
};

void rec_add_forward_alone(const struct rec_subsys *a, struct rec_cameras c, const float *x,
                           float *y)
{
    const struct rec_slots slots = {c.c0, c.c1};
    (a->cs == 4 ? a->k->scatter4 : a->k->scatter1)(&a->win, slots, 0, a->n, x, y);
    for (size_t s = 0; s < (size_t)a->slabs && a->win.n_more > 0; s++)
        scatter_more(a, s, slots, x, y);
}
void rec_forward_alone(const struct rec_subsys *a, const float *x, float *y)
{
    size_t cs = (size_t)a->cs, bytes = REC_ROW_BLOCK * cs * sizeof *y;
    for (int32_t b = 0; b < a->n_blocks; b++)
        memset(y + (size_t)a->block[b] * REC_ROW_BLOCK * cs, 0, bytes);
    rec_add_forward_alone(a, (struct rec_cameras){0, a->win.slots}, x, y);
}

static void scatter_slab(void *ctx, size_t slab)
{
    const struct product *t = ctx;
    const struct rec_subsys *a = t->a;
    const struct rec_slots slots = {t->c.c0, t->c.c1};
    float *y = t->im->of[slab];
    int32_t q0, q1;
    rec_slab_range(a, slab, &q0, &q1);
    (a->cs == 4 ? a->k->scatter4 : a->k->scatter1)(&a->win, slots, q0, q1, t->x, y);
    scatter_more(a, slab, slots, t->x, y);
}

void rec_scatter_cameras(const struct rec_subsys *a, struct rec_images *im, struct rec_cameras c,
                         const float *x)
{
    struct product t = {.a = a, .im = im, .c = c, .x = x};
    pvx_pool_run(a->pool, (size_t)a->slabs, scatter_slab, &t);
}
void rec_scatter(const struct rec_subsys *a, struct rec_images *im, const float *x)
{
    rec_scatter_cameras(a, im, (struct rec_cameras){0, a->win.slots}, x);
}

void rec_collect(const struct rec_subsys *a, struct rec_images *im, struct rec_block_range blocks,
                 float *y)
{
    rec_collect_blocks(a, im, blocks, y, false);
}

static void collect_chunk(void *ctx, size_t k)
{
    const struct product *t = ctx;
    rec_collect(t->a, t->im, rec_blocks_of(t->a, k), t->y);
}
void rec_forward(const struct rec_subsys *a, struct rec_images *im, const float *x, float *y)
{
    struct product t = {.a = a, .im = im, .y = y};
    rec_scatter(a, im, x);
    pvx_pool_run(a->pool, rec_row_pieces(a), collect_chunk, &t);
}

void rec_add_column(const struct rec_subsys *a, const struct rec_images *im, size_t slab, int32_t q,
                    rec_f4 e)
{
    const struct rec_slots slots = {0, a->win.slots};
    struct rec_windows one = a->win; /* as if the column were the first */
    size_t first = (size_t)q * (size_t)one.slots;
    const float *x = (const float *)&e;
    one.at += first;
    one.w += first * rec_window_size(&one);
    (a->cs == 4 ? a->k->scatter4 : a->k->scatter1)(&one, slots, 0, 1, x, im->of[slab]);
    for (const struct rec_more *k = more_from(a, (int32_t)slab, q),
                               *end = a->win.more + a->more_end[slab];
         k < end && k->column == (uint32_t)q; k++) {
        struct rec_more moved = *k;
        moved.column = 0;
        (a->cs == 4 ? a->k->scatter4_more : a->k->scatter1_more)(
            &one, slots, (struct rec_more_run){&moved, &moved + 1}, x, im->of[slab]);
    }
}

/* ---- columns ------------------------------------------------------------------------------------ */

struct norms {
    const struct rec_subsys *a;
    struct rec_cameras c;
    const float *row_weight;
    float *d2, *d1;
};

/* A window's part of both sums, in units. */
static void weigh_window(const struct norms *t, size_t at, size_t slot, const uint8_t *w,
                         double *d2, double *d1)
{
    const struct rec_windows *m = &t->a->win;
    for (int r = 0; r < m->high; r++, at += (size_t)m->pitch[slot])
        for (size_t k = 0; k < (size_t)m->wide; k++, w++) {
            double v = *w, wv = t->row_weight == NULL || v == 0 ? v : v * t->row_weight[at + k];
            *d2 += v * wv;
            *d1 += wv;
        }
}

static void norms_chunk(void *ctx, size_t chunk)
{
    const struct norms *t = ctx;
    const struct rec_subsys *a = t->a;
    const struct rec_windows *m = &a->win;
    size_t slots = (size_t)m->slots, size = rec_window_size(m);
    double unit = m->unit;
    int32_t q0, q1;
    rec_chunk_range(a->n, chunk, &q0, &q1);
    for (int32_t q = q0; q < q1; q++) {
        double d2 = 0, d1 = 0;
        for (size_t c = (size_t)t->c.c0; c < (size_t)t->c.c1; c++) {
            size_t i = (size_t)q * slots + c;
            weigh_window(t, m->at[i], c, m->w + i * size, &d2, &d1);
        }
        for (int32_t s = 0; s < a->slabs && m->n_more > 0; s++) {
            const struct rec_more *k = more_from(a, s, q), *end = m->more + a->more_end[s];
            for (; k < end && k->column == (uint32_t)q; k++)
                if (rec_more_is_of(k, (struct rec_slots){t->c.c0, t->c.c1}))
                    weigh_window(t, k->at, k->slot, k->w, &d2, &d1);
        }
        if (t->d2 != NULL)
            t->d2[q] = (float)(unit * unit * d2);
        if (t->d1 != NULL)
            t->d1[q] = (float)(unit * d1);
    }
}

void rec_column_norms(const struct rec_subsys *a, const float *row_weight, float *d2, float *d1)
{
    struct norms t = {a, {0, a->win.slots}, row_weight, d2, d1};
    pvx_pool_run(a->pool, rec_chunks(a->n), norms_chunk, &t);
}
void rec_column_sums_cameras(const struct rec_subsys *a, struct rec_cameras c,
                             const float *row_weight, float *d1)
{
    struct norms t = {a, c, row_weight, NULL, d1};
    pvx_pool_run(a->pool, rec_chunks(a->n), norms_chunk, &t);
}

struct dot {
    int32_t n;
    int cs;
    const float *u, *v;
    double part[REC_MAX_CHUNKS][4];
};

REC_INLINE void dot_lanes(struct dot *t, size_t k, size_t cs)
{
    int32_t i0, i1;
    rec_d4 sum = {0};
    rec_chunk_range(t->n, k, &i0, &i1);
    for (size_t i = (size_t)i0; i < (size_t)i1; i++)
        rec_add_product(&sum, rec_ld(t->u, i, cs), rec_ld(t->v, i, cs));
    rec_put(t->part[k], &sum);
}
static void dot_chunk(void *ctx, size_t k)
{
    struct dot *t = ctx;
    t->cs == 4 ? dot_lanes(t, k, 4) : dot_lanes(t, k, 1);
}

void rec_dot(const struct rec_subsys *a, int32_t n, const float *u, const float *v, double out[4])
{
    struct dot t = {.n = n, .cs = a->cs, .u = u, .v = v};
    pvx_pool_run(a->pool, rec_chunks(n), dot_chunk, &t);
    for (int l = 0; l < 4; l++) {
        out[l] = 0;
        for (size_t k = 0; k < rec_chunks(n); k++)
            out[l] += t.part[k][l];
    }
}
