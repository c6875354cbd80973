/* Coarser levels by Galerkin's rule: a coarse entry is the mean over a bin's fine rows of the sum
 * over a voxel's children, in integers throughout.
 *   sum      the layers of coarse voxels in parallel: each column gathers its children, camera after
 *            camera, into a picture of sums of which only the touched rectangle is read
 *   round    along every row in the order of the columns, one thread: an eighth of S's entries */
#include <stdatomic.h>
#include <stdlib.h>

#include "base/mem.h"
#include "recon/matrix/entries.h"
#include "recon/matrix/footprint.h"

struct job {
    const rec_sysmat *fine;
    const struct rec_entries *e; /* of the finer level */
    rec_sysmat *m;
    size_t layer;       /* coarse columns of one layer */
    size_t picture_max; /* coarse bins of the largest image */
    /* Exact entries, in eighths of the coarse unit.  Those of a layer start at the index where the finer matrix has
     * the entries of its children: there cannot be more.  Reserved, mostly never touched. */
    uint32_t *row, *eighths;
    uint32_t *count; /* [coarse columns] */
    atomic_bool out_of_memory;
};

static size_t children(const struct rec_grid *f, const int32_t ijk[3], size_t child[8])
{
    size_t n = 0;
    for (int32_t z = 2 * ijk[2]; z < 2 * ijk[2] + 2 && z < f->n[2]; z++)
        for (int32_t y = 2 * ijk[1]; y < 2 * ijk[1] + 2 && y < f->n[1]; y++)
            for (int32_t x = 2 * ijk[0]; x < 2 * ijk[0] + 2 && x < f->n[0]; x++)
                child[n++] = (size_t)rec_grid_index(f, x, y, z);
    return n;
}

/* The rectangle of coarse bins that were touched; it grows with each addition. */
struct touched {
    uint32_t x0, y0, x1, y1;
};

/* Adds the entries of camera c from `e` on, up to `end`, to the picture; returns where the next camera's begin. */
static uint32_t add_child(const struct job *j, size_t c, uint32_t e, uint32_t end,
                          uint32_t *picture, struct touched *t)
{
    const rec_sysmat *f = j->fine;
    uint32_t first = (uint32_t)f->row0[c], last = (uint32_t)f->row0[c + 1];
    uint32_t bw = (uint32_t)f->block[c].bw, coarse_bw = (uint32_t)j->m->block[c].bw;
    double per_bw = 1.0 / bw;
    for (; e < end && j->e->row[e] < last; e++) {
        uint32_t r = j->e->row[e] - first;
        uint32_t fine_y = (uint32_t)(int32_t)((r + 0.5) * per_bw); /* r / bw, exactly */
        uint32_t x = (r - fine_y * bw) / 2, y = fine_y / 2;
        picture[y * coarse_bw + x] += j->e->val[e];
        t->x0 = x < t->x0 ? x : t->x0;
        t->y0 = y < t->y0 ? y : t->y0;
        t->x1 = x > t->x1 ? x : t->x1;
        t->y1 = y > t->y1 ? y : t->y1;
    }
    return e;
}

/* Moves the sums of the picture to j->row[at], j->eighths[at] ...; the picture is zero again afterwards. */
static size_t unload(const struct job *j, size_t c, uint32_t *picture, const struct touched *t,
                     size_t at)
{
    const struct rec_sysmat_block *f = &j->fine->block[c], *b = &j->m->block[c];
    uint32_t bw = (uint32_t)b->bw, odd_x = f->bw & 1 ? bw - 1 : bw;
    uint32_t odd_y = f->bh & 1 ? (uint32_t)b->bh - 1 : (uint32_t)b->bh;
    for (uint32_t y = t->y0; y <= t->y1; y++)
        for (uint32_t x = t->x0; x <= t->x1; x++) {
            uint32_t sum = picture[y * bw + x];
            if (sum == 0)
                continue;
            picture[y * bw + x] = 0;
            j->row[at] = (uint32_t)j->m->row0[c] + y * bw + x;
            j->eighths[at++] = sum << ((x == odd_x) + (y == odd_y));
        }
    return at;
}

static void sum_layer(void *ctx, size_t k)
{
    struct job *j = ctx;
    const rec_sysmat *f = j->fine;
    const struct rec_grid *fg = &f->grid, *g = &j->m->grid;
    uint32_t *picture = pvx_calloc(j->picture_max, sizeof *picture);
    if (picture == NULL) {
        atomic_store(&j->out_of_memory, true);
        return;
    }
    size_t at = j->e->colptr[2 * k * (size_t)fg->n[0] * (size_t)fg->n[1]];
    for (size_t J = k * j->layer; J < (k + 1) * j->layer; J++) {
        int32_t ijk[3];
        size_t child[8], before = at;
        uint32_t e[8];
        rec_grid_ijk(g, (int32_t)J, ijk);
        size_t n = children(fg, ijk, child);
        for (size_t i = 0; i < n; i++)
            e[i] = j->e->colptr[child[i]];
        for (size_t c = 0; c < f->n_cameras; c++) {
            struct touched t = {UINT32_MAX, UINT32_MAX, 0, 0};
            for (size_t i = 0; i < n; i++)
                e[i] = add_child(j, c, e[i], j->e->colptr[child[i] + 1], picture, &t);
            at = unload(j, c, picture, &t, at);
        }
        j->count[J] = (uint32_t)(at - before);
    }
    free(picture);
}

/* Rounds exact sums to entries, column after column; carry [rows]: the remainders of the rounding. */
static void round_all(const struct job *j, struct rec_entries *out, int32_t *carry)
{
    const rec_sysmat *f = j->fine;
    rec_sysmat *m = j->m;
    uint32_t n = 0;
    for (size_t k = 0; k < (size_t)m->grid.n[2]; k++) {
        size_t at = j->e->colptr[2 * k * (size_t)f->grid.n[0] * (size_t)f->grid.n[1]];
        for (size_t J = k * j->layer; J < (k + 1) * j->layer; J++) {
            out->colptr[J] = n;
            size_t c = 0;
            for (size_t end = at + j->count[J]; at < end; at++) {
                uint32_t r = j->row[at];
                int32_t exact = carry[r] + (int32_t)j->eighths[at], q = (exact + 4) >> 3;
                q = q > UINT8_MAX ? UINT8_MAX : q;
                carry[r] = exact - 8 * q;
                if (q <= 0)
                    continue;
                while (r >= m->row0[c + 1])
                    c++;
                m->block[c].nnz++;
                out->row[n] = r;
                out->val[n++] = (uint8_t)q;
            }
        }
    }
    out->colptr[rec_grid_count(&m->grid)] = n;
    out->nnz = m->nnz = n;
}

static void union_layer(void *ctx, size_t k)
{
    const struct job *j = ctx;
    const rec_sysmat *f = j->fine;
    for (size_t J = k * j->layer; J < (k + 1) * j->layer; J++) {
        int32_t ijk[3];
        size_t child[8];
        rec_grid_ijk(&j->m->grid, (int32_t)J, ijk);
        size_t n = children(&f->grid, ijk, child);
        size_t place = rec_brick_place(&j->m->grid, ijk[0], ijk[1], ijk[2]);
        for (size_t c = 0; c < f->n_cameras; c++) {
            struct rec_rect u = {1, 1, 0, 0};
            for (size_t i = 0; i < n; i++) {
                struct rec_rect r = rec_footprint(f, c, (int32_t)child[i]);
                if (!rec_rect_seen(r))
                    continue;
                r = (struct rec_rect){r.x0 / 2, r.y0 / 2, r.x1 / 2, r.y1 / 2};
                if (!rec_rect_seen(u)) {
                    u = r;
                    continue;
                }
                u.x0 = r.x0 < u.x0 ? r.x0 : u.x0;
                u.y0 = r.y0 < u.y0 ? r.y0 : u.y0;
                u.x1 = r.x1 > u.x1 ? r.x1 : u.x1;
                u.y1 = r.y1 > u.y1 ? r.y1 : u.y1;
            }
            ((struct rec_rect *)j->m->block[c].fp)[place] = u;
        }
    }
}

static pvx_err coarse_fill(struct job *j, pvx_pool *pool, struct rec_entries *out)
{
    rec_sysmat *m = j->m;
    size_t N = rec_grid_count(&m->grid), rows = m->row0[m->n_cameras],
           layers = (size_t)m->grid.n[2];
    for (size_t c = 0; c < m->n_cameras; c++) {
        struct rec_rect *fp = rec_sysmat_array(rec_brick_places(&m->grid) * sizeof *fp);
        m->block[c].fp = fp;
        PVX_NEED(fp);
        rec_no_footprints(m, fp);
    }
    pvx_pool_run(pool, layers, union_layer, j);
    pvx_pool_run(pool, layers, sum_layer, j);
    if (atomic_load(&j->out_of_memory))
        return PVX_ENOMEM;
    uint64_t most = 0;
    for (size_t J = 0; J < N; J++)
        most += j->count[J];
    out->colptr = rec_sysmat_array((N + 1) * sizeof *out->colptr);
    out->row = rec_sysmat_array(most * sizeof *out->row);
    out->val = rec_sysmat_array(most * sizeof *out->val);
    int32_t *carry = pvx_calloc(rows, sizeof *carry);
    if (out->colptr == NULL || out->row == NULL || out->val == NULL || carry == NULL) {
        free(carry);
        return PVX_ENOMEM;
    }
    round_all(j, out, carry);
    free(carry);
    return PVX_OK;
}

static pvx_err coarsen(const rec_sysmat *f, const struct rec_entries *e, rec_sysmat *m,
                       pvx_pool *pool, struct rec_entries *out)
{
    struct job j = {
        .fine = f, .e = e, .m = m, .layer = (size_t)m->grid.n[0] * (size_t)m->grid.n[1]};
    for (size_t c = 0; c < m->n_cameras; c++) {
        size_t bins = (size_t)m->block[c].bw * (size_t)m->block[c].bh;
        j.picture_max = bins > j.picture_max ? bins : j.picture_max;
    }
    j.row = pvx_reserve(f->nnz * sizeof *j.row);
    j.eighths = pvx_reserve(f->nnz * sizeof *j.eighths);
    j.count = pvx_calloc(rec_grid_count(&m->grid), sizeof *j.count);
    pvx_err err = j.row == NULL || j.eighths == NULL || j.count == NULL
                      ? PVX_ENOMEM
                      : coarse_fill(&j, pool, out);
    pvx_unreserve(j.row, f->nnz * sizeof *j.row);
    pvx_unreserve(j.eighths, f->nnz * sizeof *j.eighths);
    free(j.count);
    return err;
}

void rec_sysmat_coarse_frame(const rec_sysmat *fine, rec_sysmat *coarse)
{
    rec_sysmat_coarse_grid(&fine->grid, &coarse->grid);
    coarse->key = fine->key;
    coarse->unit = 2 * fine->unit;
    coarse->binning = 2 * fine->binning;
    coarse->rays_per_bin = 2 * fine->rays_per_bin;
    for (size_t c = 0; c < coarse->n_cameras; c++) {
        coarse->block[c].bw = (fine->block[c].bw + 1) / 2;
        coarse->block[c].bh = (fine->block[c].bh + 1) / 2;
    }
    for (size_t c = 0; c < fine->n_cameras; c++)
        coarse->row0[c + 1] =
            coarse->row0[c] + (size_t)coarse->block[c].bw * (size_t)coarse->block[c].bh;
}

pvx_err rec_sysmat_coarsen(const rec_sysmat *fine, const struct rec_entries *e, pvx_pool *pool,
                           rec_sysmat **coarse, struct rec_entries *out, struct pvx_diag *d)
{
    *coarse = NULL;
    *out = (struct rec_entries){0};
    pvx_err err = rec_sysmat_alloc(fine->n_cameras, coarse);
    if (err == PVX_OK) {
        rec_sysmat_coarse_frame(fine, *coarse);
        err = coarsen(fine, e, *coarse, pool, out);
    }
    if (err != PVX_OK) {
        rec_entries_free(out);
        rec_sysmat_free(coarse);
        return pvx_fail(d, err, "out of memory for a coarser level of the system matrix");
    }
    return PVX_OK;
}

pvx_err rec_sysmat_make_windows(rec_sysmat *m, const struct rec_entries *e, pvx_pool *pool,
                                struct pvx_diag *d)
{
    pvx_err err = rec_sysmat_windows(m, e, pool);
    if (err == PVX_ERANGE)
        return pvx_fail(d, err,
                        "the voxels are far larger than the bins: their windows are more "
                        "than the 2^32-1 of one matrix; use a larger binning");
    return err == PVX_OK ? err : pvx_fail(d, err, "out of memory for the system matrix");
}

pvx_err rec_sysmat_add_levels(rec_sysmat *m, struct rec_entries *e, pvx_pool *pool,
                              struct pvx_diag *d)
{
    struct rec_entries now = *e, coarser;
    *e = (struct rec_entries){0};
    pvx_err err = rec_sysmat_make_windows(m, &now, pool, d);
    for (size_t n = rec_sysmat_levels(&m->grid); err == PVX_OK && n > 1; n--, m = m->coarse) {
        err = rec_sysmat_coarsen(m, &now, pool, &m->coarse, &coarser, d);
        rec_entries_free(&now);
        now = coarser;
        PVX_THEN(err, rec_sysmat_make_windows(m->coarse, &now, pool, d));
    }
    rec_entries_free(&now);
    return err;
}
