#include "recon/matrix/subsys.h"

#include <stdlib.h>
#include <string.h>

#include "base/mem.h"

#define SLAB   1024 /* columns, at least, as long as there are no more than REC_SLABS_MAX slabs */
#define RUN    64   /* columns copied and processed while they are in the cache */
#define RANGES 32   /* of blocks: tasks of the numbering */

static size_t blocks_of_room(size_t room)
{
    return room / REC_ROW_BLOCK;
}

pvx_err rec_restrictor_new(const rec_sysmat *S, struct rec_restrictor **out)
{
    struct rec_restrictor *r = *out = pvx_calloc(1, sizeof *r);
    PVX_NEED(r);
    r->room = S->win.room;
    r->voxels = rec_grid_count(&S->grid);
    r->list = pvx_reserve(r->voxels * sizeof *r->list);
    r->covered = pvx_reserve(blocks_of_room(r->room) * sizeof *r->covered);
    bool ok = r->list != NULL && r->covered != NULL;
    for (size_t s = 0; s < REC_SLABS_MAX; s++) {
        struct rec_slab *slab = &r->slab[s];
        slab->row = pvx_reserve(r->room);
        slab->seen = pvx_reserve(r->room * sizeof *slab->seen);
        slab->place = pvx_reserve(r->room * sizeof *slab->place);
        ok = ok && slab->row != NULL && slab->seen != NULL && slab->place != NULL;
    }
    if (!ok)
        rec_restrictor_free(out);
    return ok ? PVX_OK : PVX_ENOMEM;
}

void rec_restrictor_free(struct rec_restrictor **rp)
{
    struct rec_restrictor *r = *rp;
    if (r == NULL)
        return;
    for (size_t s = 0; s < REC_SLABS_MAX; s++) {
        pvx_unreserve(r->slab[s].row, r->room);
        pvx_unreserve(r->slab[s].seen, r->room * sizeof *r->slab[s].seen);
        pvx_unreserve(r->slab[s].place, r->room * sizeof *r->slab[s].place);
    }
    pvx_unreserve(r->covered, blocks_of_room(r->room) * sizeof *r->covered);
    pvx_unreserve(r->list, r->voxels * sizeof *r->list);
    PVX_FREE(*rp);
}

/* Bytes of the windows of all columns. */
struct sizes {
    size_t at, w, more, norm2, block, is_row;
};
static struct sizes sizes_of(const rec_sysmat *S)
{
    size_t N = rec_grid_count(&S->grid), windows = N * (size_t)S->win.slots;
    return (struct sizes){.at = windows * sizeof *S->win.at,
                          .w = windows * rec_window_size(&S->win) + REC_WINDOWS_PAD,
                          .more = (size_t)S->win.n_more * sizeof *S->win.more,
                          .norm2 = N * sizeof(float),
                          .block = blocks_of_room(S->win.room) * sizeof(uint32_t),
                          .is_row = S->win.room};
}

pvx_err rec_subsys_new(const rec_sysmat *S, const struct rec_kernels *k, pvx_pool *pool, int cs,
                       struct rec_subsys **out)
{
    *out = NULL;
    struct rec_subsys *a = pvx_calloc(1, sizeof *a);
    PVX_NEED(a);
    struct sizes z = sizes_of(S);
    a->S = S;
    a->k = k;
    a->pool = pool;
    a->cs = cs;
    memcpy(a->row0, S->row0, (S->n_cameras + 1) * sizeof *a->row0);
    a->win = S->win;
    a->win.at = pvx_reserve(z.at);
    a->win.w = pvx_reserve(z.w);
    a->win.more = pvx_reserve(z.more);
    a->norm2 = pvx_reserve(z.norm2);
    a->block = pvx_reserve(z.block);
    a->slabs_of = pvx_reserve(z.block);
    a->is_row = pvx_reserve(z.is_row);
    if (a->win.at == NULL || a->win.w == NULL || a->win.more == NULL || a->norm2 == NULL ||
        a->block == NULL || a->slabs_of == NULL || a->is_row == NULL) {
        rec_subsys_free(&a);
        return PVX_ENOMEM;
    }
    *out = a;
    return PVX_OK;
}

void rec_subsys_free(struct rec_subsys **ap)
{
    struct rec_subsys *a = *ap;
    if (a == NULL)
        return;
    struct sizes z = sizes_of(a->S);
    pvx_unreserve(a->win.at, z.at);
    pvx_unreserve(a->win.w, z.w);
    pvx_unreserve(a->win.more, z.more);
    pvx_unreserve(a->norm2, z.norm2);
    pvx_unreserve(a->block, z.block);
    pvx_unreserve(a->slabs_of, z.block);
    pvx_unreserve(a->is_row, z.is_row);
    PVX_FREE(*ap);
}

/* ---- restriction -------------------------------------------------------------------------------- */

struct restriction {
    struct rec_subsys *a;
    struct rec_restrictor *r;
    size_t n_blocks;                      /* that hold rows of S */
    int32_t blocks[RANGES], rows[RANGES]; /* of each range, then the first of each */
};

/* Copies columns [q0,q1), which follow one another in S. */
static void copy_windows(struct rec_subsys *a, int32_t q0, int32_t q1)
{
    size_t slots = (size_t)a->win.slots, bytes = slots * rec_window_size(&a->win);
    size_t n = (size_t)(q1 - q0), from = (size_t)a->col[q0];
    memcpy(a->win.at + (size_t)q0 * slots, a->S->win.at + from * slots,
           n * slots * sizeof *a->win.at);
    memcpy(a->win.w + (size_t)q0 * bytes, a->S->win.w + from * bytes, n * bytes);
}

/* Absent cameras get no windows. */
static void drop_absent(struct rec_subsys *a, int32_t q0, int32_t q1)
{
    size_t slots = (size_t)a->win.slots, size = rec_window_size(&a->win);
    for (size_t c = 0; c < a->S->n_cameras; c++) {
        if (a->present[c])
            continue;
        for (size_t at = (size_t)q0 * slots + c; at < (size_t)q1 * slots; at += slots) {
            a->win.at[at] = a->win.nowhere;
            memset(a->win.w + at * size, 0, size);
        }
    }
}

/* Bit k: w[k] is not 0.  n is 12 or 16, and no more is read, because what follows may belong to another slab. */
REC_INLINE uint32_t not_zero(const uint8_t *w, size_t n)
{
#ifdef __SSE2__
    int last;
    memcpy(&last, w + 8, sizeof last);
    __m128i v = n == 12
                    ? _mm_unpacklo_epi64(_mm_loadl_epi64((const void *)w), _mm_cvtsi32_si128(last))
                    : _mm_loadu_si128((const void *)w);
    __m128i zero = _mm_cmpeq_epi8(v, _mm_setzero_si128());
    return ~(uint32_t)_mm_movemask_epi8(zero) & ((1u << n) - 1);
#else
    uint32_t bits = 0;
    for (size_t k = 0; k < n; k++)
        bits |= (uint32_t)(w[k] != 0) << k;
    return bits;
#endif
}

/* Notes the windows of columns.  Many begin at the same bin, and each such bin is marked once, later.  Windows at
 * `nowhere` have no weights. */
REC_INLINE void note_windows(const struct rec_subsys *a, struct rec_slab *s, int32_t q0, int32_t q1,
                             size_t size)
{
    const size_t slots = (size_t)a->win.slots, end = (size_t)q1 * slots, at_once = 16 / size;
    const uint32_t *at = a->win.at;
    uint16_t *seen = s->seen;
    uint32_t *place = s->place + s->places, *first = place;
    for (size_t i = (size_t)q0 * slots; i < end; i += at_once) {
        uint32_t all = not_zero(a->win.w + i * size, at_once * size);
        for (size_t k = i; k < i + at_once; k++, all >>= size) {
            uint32_t bits = all & ((1u << size) - 1), before = seen[at[k]];
            *place = (uint32_t)k;
            place += (before == 0) & (bits != 0);
            seen[at[k]] = (uint16_t)(before | bits);
        }
    }
    s->places += (uint32_t)(place - first);
}
/* Selects by the size of a window, which is then a constant. */
static void subsys_note(const struct rec_subsys *a, struct rec_slab *s, int32_t q0, int32_t q1)
{
    switch (rec_window_size(&a->win)) {
    case 4: note_windows(a, s, q0, q1, 4); break;
    case 8: note_windows(a, s, q0, q1, 8); break;
    case 12: note_windows(a, s, q0, q1, 12); break;
    default: note_windows(a, s, q0, q1, 16);
    }
}

/* Where one slab leaves its marks. */
struct marks {
    uint8_t *row;
    _Atomic uint32_t *covered;
    uint32_t bit;
};
/* Any order of the slabs leaves the same bits. */
REC_INLINE void cover(const struct marks *m, uint32_t bin)
{
    _Atomic uint32_t *c = &m->covered[bin / REC_ROW_BLOCK];
    if ((atomic_load_explicit(c, memory_order_relaxed) & m->bit) == 0)
        atomic_fetch_or_explicit(c, m->bit, memory_order_relaxed);
}
/* Marks the bins of a window: those that it covers and, by the bits of its weights, those that are rows. */
static void mark_window(const struct marks *m, const struct rec_windows *win, uint32_t at,
                        size_t slot, uint32_t bits)
{
    uint32_t wide = (uint32_t)win->wide, of_row = (1u << wide) - 1;
    for (int r = 0; r < win->high; r++, at += (uint32_t)win->pitch[slot], bits >>= wide) {
        uint32_t row;
        memcpy(&row, m->row + at, sizeof row);
        row |= (bits & of_row) * 0x00204081 & 0x01010101; /* a byte for each bit */
        memcpy(m->row + at, &row, sizeof row);
        cover(m, at);
        if (at % REC_ROW_BLOCK + wide > REC_ROW_BLOCK)
            cover(m, at + wide - 1);
    }
}
static void subsys_mark(const struct rec_subsys *a, struct rec_slab *s, const struct marks *m)
{
    for (uint32_t i = 0; i < s->places; i++) {
        uint32_t window = s->place[i], at = a->win.at[window];
        mark_window(m, &a->win, at, window % (uint32_t)a->win.slots, s->seen[at]);
        s->seen[at] = 0;
    }
}

static float norm_of(const struct rec_subsys *a, double w2)
{
    return (float)((double)a->S->unit * a->S->unit * w2);
}

/* Sum of the weights, of their squares, number of those not 0: exact in integers, for any cut into slabs.  n is a
 * multiple of 16. */
struct sums {
    uint32_t w, w2, n;
};
static struct sums sums_of(const uint8_t *w, size_t n)
{
    struct sums s = {0};
#ifdef __SSE2__
    const __m128i zero = _mm_setzero_si128(), one = _mm_set1_epi8(1);
    __m128i sum = zero, sum2 = zero, count = zero;
    for (size_t i = 0; i < n; i += 16) {
        __m128i v = _mm_loadu_si128((const void *)(w + i));
        __m128i low = _mm_unpacklo_epi8(v, zero), high = _mm_unpackhi_epi8(v, zero);
        low = _mm_add_epi32(_mm_madd_epi16(low, low), _mm_madd_epi16(high, high));
        sum2 = _mm_add_epi32(sum2, low);
        sum = _mm_add_epi64(sum, _mm_sad_epu8(v, zero));
        count = _mm_add_epi64(count, _mm_sad_epu8(_mm_min_epu8(v, one), zero));
    }
    sum2 = _mm_add_epi32(sum2, _mm_unpackhi_epi64(sum2, sum2));
    sum2 = _mm_add_epi32(sum2, _mm_shuffle_epi32(sum2, 1));
    s.w = (uint32_t)_mm_cvtsi128_si32(_mm_add_epi64(sum, _mm_unpackhi_epi64(sum, sum)));
    s.w2 = (uint32_t)_mm_cvtsi128_si32(sum2);
    s.n = (uint32_t)_mm_cvtsi128_si32(_mm_add_epi64(count, _mm_unpackhi_epi64(count, count)));
#else
    for (size_t i = 0; i < n; i++) {
        s.w += w[i];
        s.w2 += (uint32_t)w[i] * w[i];
        s.n += w[i] != 0;
    }
#endif
    return s;
}
static void add_sums(struct rec_slab *s, struct sums d)
{
    s->sum += d.w;
    s->sum2 += d.w2;
    s->nnz += d.n;
}

/* Norms of columns, and the sums over them. */
static void add_norms(const struct rec_subsys *a, struct rec_slab *s, int32_t q0, int32_t q1)
{
    size_t bytes = (size_t)a->win.slots * rec_window_size(&a->win); /* a multiple of 16 */
    for (int32_t q = q0; q < q1; q++) {
        struct sums d = sums_of(a->win.w + (size_t)q * bytes, bytes);
        a->norm2[q] = norm_of(a, d.w2);
        add_sums(s, d);
    }
}

/* The first of S's further windows from number `from` on that is of this column or a later one.  It is near. */
static size_t more_of(const struct rec_windows *m, size_t from, uint32_t column)
{
    size_t step = 1, end;
    if (from == m->n_more || m->more[from].column >= column)
        return from;
    for (; step < m->n_more - from && m->more[from + step].column < column; step *= 2)
        from += step;
    end = step < m->n_more - from ? from + step : m->n_more;
    const struct rec_more_run run = {m->more + from + 1, m->more + end};
    return (size_t)(rec_more_from(run, column) - m->more);
}
/* Copies the further windows of the slab's columns to the place where S has those of its first one: there cannot be
 * more. */
static void copy_more(struct restriction *t, size_t slab, const struct marks *marks, int32_t q0,
                      int32_t q1)
{
    struct rec_subsys *a = t->a;
    const struct rec_windows *m = &a->S->win;
    size_t from = q0 < q1 ? more_of(m, 0, (uint32_t)a->col[q0]) : 0, to = from;
    a->more_at[slab] = (uint32_t)to;
    for (int32_t q = q0; q < q1; q++) {
        from = more_of(m, from, (uint32_t)a->col[q]);
        for (; from < m->n_more && m->more[from].column == (uint32_t)a->col[q]; from++) {
            struct rec_more k = m->more[from];
            if (!a->present[k.slot])
                continue;
            struct sums d = sums_of(k.w, sizeof k.w);
            k.column = (uint32_t)q;
            a->win.more[to++] = k;
            mark_window(marks, m, k.at, k.slot, not_zero(k.w, sizeof k.w));
            a->norm2[q] += norm_of(a, d.w2);
            add_sums(&t->r->slab[slab], d);
        }
    }
    a->more_end[slab] = (uint32_t)to;
}

/* End of the run that begins with column q. */
static int32_t subsys_run_end(const struct rec_subsys *a, int32_t q, int32_t q1)
{
    int32_t end = q1 - q < RUN ? q1 : q + RUN, next = q + 1;
    while (next < end && a->col[next] == a->col[next - 1] + 1)
        next++;
    return next;
}
static void subsys_fetch(const void *from, size_t bytes)
{
    for (size_t i = 0; i < bytes; i += PVX_ALIGN)
        __builtin_prefetch((const uint8_t *)from + i);
}
/* Prefetches a run, because a processor cannot predict where the next run is. */
static void fetch_windows(const struct rec_subsys *a, int32_t q0, int32_t q1)
{
    size_t slots = (size_t)a->win.slots, bytes = slots * rec_window_size(&a->win);
    size_t n = (size_t)(q1 - q0), from = (size_t)a->col[q0];
    subsys_fetch(a->S->win.at + from * slots, n * slots * sizeof *a->win.at);
    subsys_fetch(a->S->win.w + from * bytes, n * bytes);
}

static void copy_slab(void *ctx, size_t slab)
{
    struct restriction *t = ctx;
    struct rec_subsys *a = t->a;
    struct rec_slab *s = &t->r->slab[slab];
    const struct marks marks = {s->row, t->r->covered, 1u << slab};
    int32_t q0, q1;
    rec_slab_range(a, slab, &q0, &q1);
    s->sum = s->sum2 = s->nnz = 0;
    s->places = 0;
    for (int32_t q = q0, next, end = q0 < q1 ? subsys_run_end(a, q0, q1) : q1; q < q1; q = next) {
        next = end;
        copy_windows(a, q, next);
        if (next < q1) {
            end = subsys_run_end(a, next, q1);
            fetch_windows(a, next, end);
        }
        drop_absent(a, q, next);
        subsys_note(a, s, q, next);
        add_norms(a, s, q, next);
    }
    subsys_mark(a, s, &marks);
    copy_more(t, slab, &marks, q0, q1);
}

_Static_assert(REC_ROW_BLOCK == sizeof(uint64_t), "a block's rows are read at once");

/* Collects the bins of a block that are rows; the slabs' marks are 0 afterwards. */
static uint64_t subsys_take_rows(struct restriction *t, size_t block, uint32_t slabs)
{
    uint64_t rows = 0, m, zero = 0;
    for (; slabs != 0; slabs &= slabs - 1) {
        uint8_t *row = t->r->slab[__builtin_ctz(slabs)].row + block * REC_ROW_BLOCK;
        memcpy(&m, row, sizeof m);
        memcpy(row, &zero, sizeof zero);
        rows |= m;
    }
    return rows;
}

static void count_range(void *ctx, size_t i)
{
    struct restriction *t = ctx;
    int32_t n = 0;
    for (size_t b = t->n_blocks * i / RANGES; b < t->n_blocks * (i + 1) / RANGES; b++)
        n += atomic_load_explicit(&t->r->covered[b], memory_order_relaxed) != 0;
    t->blocks[i] = n;
}

static void number_range(void *ctx, size_t i)
{
    struct restriction *t = ctx;
    struct rec_subsys *a = t->a;
    int32_t at = t->blocks[i], rows = 0;
    for (size_t b = t->n_blocks * i / RANGES; b < t->n_blocks * (i + 1) / RANGES; b++) {
        uint32_t slabs = atomic_load_explicit(&t->r->covered[b], memory_order_relaxed);
        if (slabs == 0)
            continue;
        atomic_store_explicit(&t->r->covered[b], 0, memory_order_relaxed);
        uint64_t row = subsys_take_rows(t, b, slabs);
        a->block[at] = (uint32_t)b;
        a->slabs_of[at++] = slabs;
        memcpy(a->is_row + b * REC_ROW_BLOCK, &row, sizeof row);
        for (; row != 0; row >>= 8)
            rows += (row & 0xFF) != 0;
    }
    t->rows[i] = rows;
}

void rec_subsys_restrict(struct rec_subsys *a, struct rec_restrictor *r, const int32_t *col,
                         int32_t n, const bool *present)
{
    struct restriction t = {.a = a, .r = r, .n_blocks = a->win.nowhere / REC_ROW_BLOCK};
    uint64_t sum = 0, sum2 = 0;
    a->card = NULL;
    a->col = col;
    a->n = n;
    a->slabs = n / SLAB < 1 ? 1 : n / SLAB < REC_SLABS_MAX ? n / SLAB : REC_SLABS_MAX;
    memcpy(a->present, present, a->S->n_cameras * sizeof *present);
    pvx_pool_run(a->pool, (size_t)a->slabs, copy_slab, &t);
    pvx_pool_run(a->pool, RANGES, count_range, &t);
    a->n_blocks = 0;
    for (size_t i = 0; i < RANGES; i++) {
        int32_t of_range = t.blocks[i];
        t.blocks[i] = a->n_blocks;
        a->n_blocks += of_range;
    }
    pvx_pool_run(a->pool, RANGES, number_range, &t);
    for (size_t b = t.n_blocks; b < blocks_of_room(a->win.room); b++) /* windows that hang over */
        atomic_store_explicit(&r->covered[b], 0, memory_order_relaxed);
    a->rows = 0;
    a->nnz = 0;
    for (size_t i = 0; i < RANGES; i++)
        a->rows += t.rows[i];
    for (int32_t s = 0; s < a->slabs; s++) {
        sum += r->slab[s].sum;
        sum2 += r->slab[s].sum2;
        a->nnz += r->slab[s].nnz;
    }
    a->sum = (double)a->S->unit * (double)sum;
    a->sum2 = (double)a->S->unit * a->S->unit * (double)sum2;
}
