#include "recon/matrix/columns.h"

#include <stdlib.h>
#include <string.h>

#include "base/mem.h"

#define CHUNK      65536 /* columns per task while summing */
#define STRIPS_MAX 16

struct job {
    const struct rec_band_rows *rows;
    size_t N, strips;
    size_t strip[STRIPS_MAX + 1]; /* their first bands */
    uint32_t *at;                 /* [strips][N] counts, then the next free place */
    uint64_t *chunk;              /* entries of CHUNK columns, then of all before them */
    struct rec_entries *out;
};

bool rec_band_grow(struct rec_band *b, size_t more)
{
    if (b->room - b->n > more)
        return true;
    size_t room = b->room + b->room / 2 + more + 65536;
    uint32_t *col = realloc(b->col, room * sizeof *col);
    if (col != NULL)
        b->col = col;
    uint8_t *val = realloc(b->val, room * sizeof *val);
    if (val != NULL)
        b->val = val;
    if (col == NULL || val == NULL)
        return false;
    b->room = room;
    return true;
}

uint64_t rec_band_entries(const struct rec_band_rows *r)
{
    uint64_t n = 0;
    for (size_t k = 0; k < r->bands; k++)
        n += r->band[k].n;
    return n;
}

void rec_band_rows_free(struct rec_band_rows *r)
{
    for (size_t k = 0; k < REC_BANDS_MAX; k++) {
        free(r->band[k].col);
        free(r->band[k].val);
        r->band[k].col = NULL;
        r->band[k].val = NULL;
        r->band[k].n = r->band[k].room = 0;
    }
}

static void count_strip(void *ctx, size_t task)
{
    struct job *j = ctx;
    uint32_t *at = j->at + task * j->N;
    memset(at, 0, j->N * sizeof *at);
    for (size_t k = j->strip[task]; k < j->strip[task + 1]; k++)
        for (size_t i = 0; i < j->rows->band[k].n; i++)
            at[j->rows->band[k].col[i]]++;
}

static size_t columns_chunk_end(const struct job *j, size_t task)
{
    return (task + 1) * CHUNK < j->N ? (task + 1) * CHUNK : j->N;
}

static void sum_chunk(void *ctx, size_t task)
{
    struct job *j = ctx;
    uint64_t sum = 0;
    for (size_t strip = 0; strip < j->strips; strip++)
        for (size_t c = task * CHUNK; c < columns_chunk_end(j, task); c++)
            sum += j->at[strip * j->N + c];
    j->chunk[task] = sum;
}

static void place_chunk(void *ctx, size_t task)
{
    struct job *j = ctx;
    uint32_t next = (uint32_t)j->chunk[task], *colptr = j->out->colptr;
    for (size_t c = task * CHUNK; c < columns_chunk_end(j, task); c++) {
        colptr[c] = next;
        for (size_t strip = 0; strip < j->strips; strip++) {
            uint32_t n = j->at[strip * j->N + c];
            j->at[strip * j->N + c] = next;
            next += n;
        }
    }
}

static void fill_strip(void *ctx, size_t task)
{
    struct job *j = ctx;
    uint32_t *at = j->at + task * j->N, *row = j->out->row;
    uint8_t *val = j->out->val;
    for (size_t k = j->strip[task]; k < j->strip[task + 1]; k++) {
        const struct rec_band *in = &j->rows->band[k];
        uint32_t end = (uint32_t)(in[1].row0 * j->rows->bw);
        size_t i = 0;
        for (uint32_t r = (uint32_t)(in->row0 * j->rows->bw); r < end; r++)
            for (size_t last = i + j->rows->bin_n[r]; i < last; i++) {
                uint32_t e = at[in->col[i]]++;
                row[e] = r;
                val[e] = in->val[i];
            }
    }
}

/* Cuts the bands into strips with about equal numbers of entries. */
static void cut_strips(struct job *j)
{
    uint64_t total = rec_band_entries(j->rows), sum = 0;
    size_t s = 0;
    for (size_t k = 0; k < j->rows->bands; k++) {
        while (s < j->strips && sum * j->strips >= total * s)
            j->strip[s++] = k;
        sum += j->rows->band[k].n;
    }
    while (s <= j->strips)
        j->strip[s++] = j->rows->bands;
}

static pvx_err columns_sort(struct job *j, pvx_pool *pool)
{
    struct rec_entries *out = j->out;
    size_t chunks = (j->N + CHUNK - 1) / CHUNK;
    uint64_t total = 0;
    out->row = rec_sysmat_array(out->nnz * sizeof *out->row);
    out->val = rec_sysmat_array(out->nnz * sizeof *out->val);
    out->colptr = rec_sysmat_array((j->N + 1) * sizeof *out->colptr);
    j->at = rec_sysmat_array(j->strips * j->N * sizeof *j->at);
    j->chunk = pvx_calloc(chunks, sizeof *j->chunk);
    if (out->row == NULL || out->val == NULL || out->colptr == NULL || j->at == NULL ||
        j->chunk == NULL)
        return PVX_ENOMEM;
    pvx_pool_run(pool, j->strips, count_strip, j);
    pvx_pool_run(pool, chunks, sum_chunk, j);
    for (size_t i = 0; i < chunks; i++) {
        uint64_t n = j->chunk[i];
        j->chunk[i] = total;
        total += n;
    }
    pvx_pool_run(pool, chunks, place_chunk, j);
    out->colptr[j->N] = (uint32_t)total;
    pvx_pool_run(pool, j->strips, fill_strip, j);
    return PVX_OK;
}

pvx_err rec_columns(const struct rec_band_rows *rows, size_t N, pvx_pool *pool,
                    struct rec_entries *out)
{
    struct job j = {.rows = rows, .N = N, .strips = pvx_pool_threads(pool), .out = out};
    j.strips = j.strips < STRIPS_MAX ? j.strips : STRIPS_MAX;
    out->nnz = rec_band_entries(rows);
    cut_strips(&j);
    pvx_err e = columns_sort(&j, pool);
    free(j.at);
    free(j.chunk);
    return e;
}
