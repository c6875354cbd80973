/* Joins the cameras' columns end to end.  S is written from front to back in slices of columns.  The memory that a
 * slice has read is given back to the system before the next one. */
#include <stdint.h>
#include <stdlib.h>
#include <sys/mman.h>

#include "recon/matrix/entries.h"

#define CHUNK  16384 /* columns per task */
#define SLICES 16
#define PAGE   ((size_t)4096)

struct job {
    rec_sysmat *m;
    const struct rec_entries *part;
    size_t N, first; /* columns; first chunk of the slice */
    uint32_t *colptr, *row;
    uint8_t *val;
};

static void merge_chunk(void *ctx, size_t task)
{
    const struct job *j = ctx;
    size_t cameras = j->m->n_cameras;
    size_t j0 = (j->first + task) * CHUNK, j1 = j0 + CHUNK < j->N ? j0 + CHUNK : j->N;
    uint32_t at = 0, next[REC_MAX_CAMERAS];
    for (size_t c = 0; c < cameras; c++)
        at += next[c] = j->part[c].colptr[j0];
    for (size_t col = j0; col < j1; col++) {
        j->colptr[col] = at;
        for (size_t c = 0; c < cameras; c++) {
            const struct rec_entries *p = &j->part[c];
            uint32_t row0 = (uint32_t)j->m->row0[c], end = p->colptr[col + 1], e = next[c];
            for (; e < end; e++, at++) {
                j->row[at] = row0 + p->row[e];
                j->val[at] = p->val[e];
            }
            next[c] = end;
        }
    }
}

void rec_entries_free(struct rec_entries *e)
{
    free(e->colptr);
    free(e->row);
    free(e->val);
    free(e->depth);
    *e = (struct rec_entries){0};
}

/* Gives back whole pages of [base + from, base + to). */
static void merge_give_back(const void *base, size_t from, size_t to)
{
    uintptr_t a = ((uintptr_t)base + from + PAGE - 1) & ~(PAGE - 1);
    uintptr_t b = ((uintptr_t)base + to) & ~(PAGE - 1);
    if (b > a)
        madvise((void *)a, b - a, MADV_DONTNEED); /* freed below in any case */
}

static void merge_slice(struct job *j, size_t first, size_t end, pvx_pool *pool)
{
    j->first = first;
    pvx_pool_run(pool, end - first, merge_chunk, j);
    size_t j0 = first * CHUNK, j1 = end * CHUNK < j->N ? end * CHUNK : j->N;
    for (size_t c = 0; c < j->m->n_cameras; c++) {
        const struct rec_entries *p = &j->part[c];
        merge_give_back(p->row, p->colptr[j0] * sizeof *p->row, p->colptr[j1] * sizeof *p->row);
        merge_give_back(p->val, p->colptr[j0] * sizeof *p->val, p->colptr[j1] * sizeof *p->val);
    }
}

pvx_err rec_sysmat_merge(rec_sysmat *m, struct rec_entries *part, pvx_pool *pool,
                         struct rec_entries *out, struct pvx_diag *d)
{
    struct job j = {.m = m, .part = part, .N = rec_sysmat_columns(m)};
    m->nnz = 0;
    *out = (struct rec_entries){0};
    for (size_t c = 0; c < m->n_cameras; c++)
        m->nnz += m->block[c].nnz = part[c].nnz;
    if (m->nnz > UINT32_MAX)
        return pvx_fail(d, PVX_ERANGE,
                        "%llu matrix entries are more than the 2^32-1 of one matrix; use fewer "
                        "voxels or a larger binning",
                        (unsigned long long)m->nnz);
    out->colptr = j.colptr = rec_sysmat_array((j.N + 1) * sizeof *j.colptr);
    out->row = j.row = rec_sysmat_array(m->nnz * sizeof *j.row);
    out->val = j.val = rec_sysmat_array(m->nnz * sizeof *j.val);
    if (j.colptr == NULL || j.row == NULL || j.val == NULL)
        return pvx_fail(d, PVX_ENOMEM, "out of memory: the system matrix has %llu MiB",
                        (unsigned long long)(m->nnz * (sizeof *j.row + sizeof *j.val) >> 20));
    size_t chunks = (j.N + CHUNK - 1) / CHUNK;
    for (size_t s = 0; s < SLICES; s++)
        merge_slice(&j, chunks * s / SLICES, chunks * (s + 1) / SLICES, pool);
    j.colptr[j.N] = (uint32_t)m->nnz;
    out->nnz = m->nnz;
    for (size_t c = 0; c < m->n_cameras; c++)
        rec_entries_free(&part[c]);
    return PVX_OK;
}
