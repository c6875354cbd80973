/* matrices.h - system matrices for tests of what works with them: of a rig, and of entries that somebody wrote. */
#ifndef TESTS_MATRICES_H
#define TESTS_MATRICES_H
#include "recon/matrix/active.h"
#include "recon/matrix/footprint.h"
#include "tests/t.h"

/* A rig whose sides are nobody's multiples. */
struct real {
    struct rec_rig rig;
    struct rec_sysmat_params p;
    rec_sysmat *S;
};
static inline void real_rig(struct real *r, enum rec_basis basis, int32_t across,
                            const int32_t n[3])
{
    *r = (struct real){.p = {1, 1}};
    T_EQ_I(rec_rig_ring(5, 2, across, across * 3 / 4 + 1, n[0], &r->rig), PVX_OK);
    r->rig.cameras[4].width = 62; /* and another size */
    r->rig.cameras[4].height = 34;
    r->rig.cameras[1].dist[0] = -0.2;
    memcpy(r->rig.grid.n, n, sizeof r->rig.grid.n);
    r->rig.grid.basis = basis;
}
static inline void real_free(struct real *r)
{
    rec_sysmat_free(&r->S);
    rec_rig_fini(&r->rig);
}

/* Bins that somebody wrote: in each camera of a voxel mostly a patch of this size, sometimes bins anywhere, all of a
 * small picture, or none. */
static inline void put_bins(rec_sysmat *m, struct rec_entries *e, size_t c, int32_t w, int32_t h)
{
    int32_t bw = m->block[c].bw, bh = m->block[c].bh, kind = (int32_t)(t_rand() % 64);
    int32_t x0 = (int32_t)(t_rand() % (uint64_t)bw), y0 = (int32_t)(t_rand() % (uint64_t)bh);
    double density = kind == 0 ? 30.0 / (bw * bh) : kind == 1 ? 0 : 0.95;
    if (kind == 0 || (kind == 2 && bw * bh < 60)) {
        x0 = y0 = 0;
        w = bw;
        h = bh;
    }
    for (int32_t y = y0; y < y0 + h && y < bh; y++)
        for (int32_t x = x0; x < x0 + w && x < bw; x++)
            if (t_uniform(0, 1) < density) {
                e->row[e->nnz] = (uint32_t)m->row0[c] + (uint32_t)(y * bw + x);
                e->val[e->nnz++] = (uint8_t)(1 + t_rand() % 255);
            }
}
/* Windows of that shape, and many beyond a voxel's first, in pictures that are smaller than a window too. */
static inline rec_sysmat *written_new(int32_t high, int32_t wide, pvx_pool *pool)
{
    static const int32_t size[][2] = {{64, 48}, {3, 50}, {61, 7}, {2, 2}, {1, 1}};
    enum { CAMERAS = sizeof size / sizeof *size, N = 9 * 6 * 5 };
    rec_sysmat *m;
    struct rec_entries e = {.row = pvx_calloc(1 << 20, 4), .val = pvx_calloc(1 << 20, 1)};
    e.colptr = pvx_calloc(N + 1, sizeof *e.colptr);
    if (rec_sysmat_alloc(CAMERAS, &m) != PVX_OK)
        exit(2);
    m->grid = (struct rec_grid){.max = {1, 1, 1}, .n = {9, 6, 5}};
    m->unit = rec_sysmat_unit(&m->grid);
    for (size_t c = 0; c < CAMERAS; c++) {
        struct rec_rect *fp = pvx_calloc(rec_brick_places(&m->grid), sizeof *fp);
        rec_no_footprints(m, fp);
        m->block[c] = (struct rec_sysmat_block){size[c][0], size[c][1], 0, fp};
    }
    T_EQ_I(rec_sysmat_number_rows(m, NULL), PVX_OK);
    for (int32_t j = 0; j < N; j++) {
        for (size_t c = 0; c < CAMERAS; c++)
            put_bins(m, &e, c, wide, high);
        e.colptr[j + 1] = (uint32_t)e.nnz;
    }
    m->nnz = e.nnz;
    T_EQ_I(rec_sysmat_windows(m, &e, pool), PVX_OK);
    T_EQ_I(m->win.high * 10 + m->win.wide, high * 10 + wide);
    rec_entries_free(&e);
    return m;
}
#endif
