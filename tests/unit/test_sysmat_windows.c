/* Any entries as windows and back: the same, whatever the columns and images are; in the shape that they fill. */
#include "recon/matrix/entries.h"

#include "tests/lib/entries.h"
#include "tests/t.h"

#define COLUMNS 5000 /* more than one task's */

/* A matrix of columns that somebody wrote: a line of voxels. */
struct bed {
    rec_sysmat *m;
    struct rec_entries e;
    size_t room;
};

static const struct size {
    int32_t w, h;
} large = {64, 48};

/* Cameras of these sizes, one after the other and over again. */
static void bed_new(struct bed *b, size_t cameras, const struct size *size, size_t sizes)
{
    *b = (struct bed){.room = 1 << 21};
    if (rec_sysmat_alloc(cameras, &b->m) != PVX_OK)
        exit(2);
    b->m->grid = (struct rec_grid){.max = {1, 1, 1}, .n = {COLUMNS, 1, 1}};
    b->m->unit = rec_sysmat_unit(&b->m->grid);
    for (size_t c = 0; c < cameras; c++) {
        b->m->block[c].bw = size[c % sizes].w;
        b->m->block[c].bh = size[c % sizes].h;
    }
    T_EQ_I(rec_sysmat_number_rows(b->m, NULL), PVX_OK);
    b->e.colptr = pvx_calloc(COLUMNS + 1, sizeof *b->e.colptr);
    b->e.row = pvx_calloc(b->room, sizeof *b->e.row);
    b->e.val = pvx_calloc(b->room, sizeof *b->e.val);
}
static void bed_free(struct bed *b)
{
    rec_entries_free(&b->e);
    rec_sysmat_free(&b->m);
}

/* A bin of column `column`; rows ascend. */
static void put(struct bed *b, size_t camera, int32_t x, int32_t y)
{
    T_OK(b->e.nnz < b->room);
    b->e.row[b->e.nnz] = (uint32_t)b->m->row0[camera] + (uint32_t)(y * b->m->block[camera].bw + x);
    b->e.val[b->e.nnz++] = (uint8_t)(1 + t_rand() % 255);
}

/* Bins of a rectangle, each with that probability; what lies outside the image is left out. */
struct patch {
    int32_t x, y, w, h;
};
static void put_patch(struct bed *b, size_t camera, struct patch p, double density)
{
    for (int32_t y = p.y; y < p.y + p.h; y++)
        for (int32_t x = p.x; x < p.x + p.w; x++)
            if (x < b->m->block[camera].bw && y < b->m->block[camera].bh &&
                t_uniform(0, 1) < density)
                put(b, camera, x, y);
}
static int32_t below(int32_t n)
{
    return (int32_t)(t_rand() % (uint64_t)n);
}

/* Nothing; a small patch; bins anywhere; all of the image. */
static void put_anything(struct bed *b, size_t camera)
{
    int32_t w = b->m->block[camera].bw, h = b->m->block[camera].bh;
    struct patch at = {below(w), below(h), 1 + below(6), 1 + below(6)}, whole = {0, 0, w, h};
    switch (t_rand() % 100) {
    case 0: put_patch(b, camera, whole, 20.0 / (w * h)); break;
    case 1: put_patch(b, camera, whole, t_rand() % 16 == 0 ? 1 : 0); break;
    case 2: break;
    default: put_patch(b, camera, at, t_uniform(0.3, 1.5)); break;
    }
}

static void windows(struct bed *b, pvx_pool *pool)
{
    b->m->nnz = b->e.nnz;
    T_EQ_I(rec_sysmat_windows(b->m, &b->e, pool), PVX_OK);
}

/* What comes back. */
static void same(const struct bed *b)
{
    struct entries got = entries_of(b->m);
    T_EQ_I(got.nnz, b->e.nnz);
    T_OK(memcmp(got.colptr, b->e.colptr, (COLUMNS + 1) * sizeof *got.colptr) == 0);
    T_OK(memcmp(got.row, b->e.row, got.nnz * sizeof *got.row) == 0);
    T_OK(memcmp(got.val, b->e.val, got.nnz) == 0);
    entries_free(&got);
}

/* The first window of a camera is the column's own: there are further ones only where there is a first. */
static void first_is_own(const rec_sysmat *m)
{
    int64_t wrong = 0;
    for (size_t i = 0; i < m->win.n_more; i++) {
        const struct rec_more *k = &m->win.more[i];
        wrong += m->win.at[k->column * (size_t)m->win.slots + k->slot] == m->win.nowhere;
    }
    T_EQ_I(wrong, 0);
}

T_CASE(any_entries)
{
    static const size_t cameras[] = {1, 4, 5, 8, 12};
    static const struct size sizes[] = {{64, 48}, {9, 7}, {1, 5}, {2, 2},  {3, 1}, {40, 3},
                                        {4, 4},   {1, 1}, {5, 3}, {3, 30}, {2, 8}, {100, 2}};
    for (size_t n = 0; n < sizeof cameras / sizeof *cameras; n++)
        for (int turn = 0; turn < 3; turn++) {
            struct bed b;
            size_t first = turn == 0 ? 0 : (size_t)below(11), most = 0;
            bed_new(&b, cameras[n], sizes + first, sizeof sizes / sizeof *sizes - first);
            for (size_t j = 0; j < COLUMNS; j++) {
                for (size_t c = 0; c < cameras[n]; c++)
                    put_anything(&b, c);
                b.e.colptr[j + 1] = (uint32_t)b.e.nnz;
                size_t bins = b.e.colptr[j + 1] - b.e.colptr[j];
                most = bins > most ? bins : most;
            }
            T_OK(turn > 0 || most > 1024); /* covered in pieces */
            windows(&b, NULL);
            same(&b);
            first_is_own(b.m);
            bed_free(&b);
        }
}

/* Patches of one size take windows of that size, none further, wherever they lie; a row or a column
 * more takes further ones. */
static void shape(struct patch p, int32_t high, int32_t wide, bool more)
{
    struct bed b;
    bed_new(&b, 5, &large, 1);
    for (size_t j = 0; j < COLUMNS; j++) {
        for (size_t c = 0; c < 5; c++) {
            p.x = j % 7 == 0 ? large.w - p.w : below(large.w - p.w + 1);
            p.y = j % 5 == 0 ? large.h - p.h : below(large.h - p.h + 1);
            put_patch(&b, c, p, 1);
        }
        b.e.colptr[j + 1] = (uint32_t)b.e.nnz;
    }
    windows(&b, NULL);
    T_EQ_I(b.m->win.high, high);
    T_EQ_I(b.m->win.wide, wide);
    T_EQ_I(b.m->win.n_more > 0, more);
    same(&b);
    first_is_own(b.m);
    bed_free(&b);
}
T_CASE(each_shape)
{
    shape((struct patch){.w = 1, .h = 1}, 2, 2, false);
    shape((struct patch){.w = 2, .h = 2}, 2, 2, false);
    shape((struct patch){.w = 4, .h = 2}, 2, 4, false);
    shape((struct patch){.w = 3, .h = 3}, 3, 4, false);
    shape((struct patch){.w = 4, .h = 3}, 3, 4, false);
    shape((struct patch){.w = 4, .h = 4}, 4, 4, false);
    shape((struct patch){.w = 6, .h = 4}, 4, 4, true);
}

/* Columns 2i and 2i+1 have their windows at one place as long as one holds both, at an even bin where there is room;
 * a column that is not seen, or seen elsewhere, has its own. */
static void two_columns(int32_t apart, bool one_place)
{
    struct bed b;
    int64_t apart_n = 0, odd = 0;
    bed_new(&b, 4, &large, 1);
    for (size_t j = 0; j < COLUMNS; j += 2) {
        struct patch p = {below(large.w - 7), below(large.h - 4), 2, 3};
        for (int32_t i = 0; i < 2; i++) {
            for (size_t c = 0; c < 4; c++)
                if (c < 3 || i == 0) /* the last camera sees but one of the two */
                    put_patch(&b, c, (struct patch){p.x + i * apart, p.y, p.w, p.h}, 1);
            b.e.colptr[j + (size_t)i + 1] = (uint32_t)b.e.nnz;
        }
    }
    windows(&b, NULL);
    same(&b);
    T_EQ_I(b.m->win.wide, 4);
    const uint32_t *at = b.m->win.at;
    for (size_t j = 0; j < COLUMNS; j += 2, at += 8) {
        for (size_t c = 0; c < 3; c++)
            apart_n += at[c] != at[4 + c];
        odd += at[3] % 2;
        T_EQ_I(at[7], b.m->win.nowhere);
    }
    T_EQ_I(apart_n, one_place ? 0 : COLUMNS / 2 * 3);
    T_EQ_I(odd, 0);
    bed_free(&b);
}
T_CASE(two_columns_at_one_place)
{
    two_columns(1, true);
    two_columns(2, true);
    two_columns(3, false);
}

/* A column that leans takes windows that begin left of where it was met first. */
T_CASE(leaning_columns)
{
    struct bed b;
    bed_new(&b, 2, &large, 1);
    for (size_t j = 0; j < COLUMNS; j++) {
        int32_t slope = below(9), x0 = 40 + below(20), y0 = below(40);
        for (size_t c = 0; c < 2; c++)
            for (int32_t y = 0; y < 8; y++)
                for (int32_t x = 0; x < 3; x++)
                    if (x0 - slope * y + x >= 0)
                        put(&b, c, x0 - slope * y + x, y0 + y);
        b.e.colptr[j + 1] = (uint32_t)b.e.nnz;
    }
    windows(&b, NULL);
    same(&b);
    first_is_own(b.m);
    bed_free(&b);
}

T_CASE_OF_THREADS(same_bits_for_any_number_of_threads)
{
    struct bed b;
    bed_new(&b, 5, &large, 1);
    for (size_t j = 0; j < COLUMNS; j++) {
        for (size_t c = 0; c < 5; c++)
            put_anything(&b, c);
        b.e.colptr[j + 1] = (uint32_t)b.e.nnz;
    }
    windows(&b, NULL);
    struct rec_windows one = b.m->win;
    size_t n = COLUMNS * (size_t)one.slots;
    for (unsigned threads = 2; threads <= 5; threads++) {
        pvx_pool *pool;
        T_EQ_I(pvx_pool_new(threads, "t", &pool), PVX_OK);
        windows(&b, pool);
        const struct rec_windows *w = &b.m->win;
        T_EQ_I(w->n_more, one.n_more);
        T_OK(memcmp(w->at, one.at, n * sizeof *w->at) == 0);
        T_OK(memcmp(w->w, one.w, n * rec_window_size(w)) == 0);
        T_OK(memcmp(w->more, one.more, one.n_more * sizeof *w->more) == 0);
        free(w->at);
        free(w->w);
        free(w->more);
        pvx_pool_free(&pool);
    }
    b.m->win = one;
    bed_free(&b);
}

T_CASE(no_entries)
{
    struct bed b;
    bed_new(&b, 3, &large, 1);
    windows(&b, NULL);
    same(&b);
    T_EQ_I(b.m->win.n_more, 0);
    bed_free(&b);
}
