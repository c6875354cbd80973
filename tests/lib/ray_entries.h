/* ray_entries.h - a system matrix entry by entry against its rays. */
#ifndef TESTS_RAY_ENTRIES_H
#define TESTS_RAY_ENTRIES_H
#include "recon/geom/rig.h"
#include "tests/lib/entries.h"
#include "tests/t.h"

/* Adds `share` of what a ray meets to want [voxels]. */
typedef void add_ray(void *ctx, const double o[3], const double d[3], double share, double *want);

/* The worst difference.  Each entry has a ray that meets it by more than `least`, and no entry is left over.  *empty:
 * columns without an entry. */
static inline double entries_against_rays(const struct rec_rig *r, const rec_sysmat *m,
                                          add_ray *add, void *ctx, double least, size_t *empty)
{
    size_t N = rec_grid_count(&r->grid), c = 0;
    double *want = pvx_calloc(N, sizeof *want), worst = 0;
    uint32_t *at = pvx_calloc(N, sizeof *at);
    struct entries all = entries_of(m);
    int32_t rays = m->rays_per_bin, binning = m->binning;
    memcpy(at, all.colptr, N * sizeof *at);
    for (uint32_t row = 0; row < m->row0[r->n_cameras]; row++) {
        while (row >= m->row0[c + 1])
            c++;
        uint32_t bw = (uint32_t)m->block[c].bw, bin = row - (uint32_t)m->row0[c];
        memset(want, 0, N * sizeof *want);
        for (int q = 0; q < rays * rays; q++) {
            double u = (bin % bw + (q % rays + 0.5) / rays) * binning - 0.5, o[3], d[3];
            double v = (bin / bw + (q / rays + 0.5) / rays) * binning - 0.5;
            T_OK(rec_camera_ray(&r->cameras[c], u, v, o, d));
            add(ctx, o, d, 1.0 / (rays * rays), want);
        }
        for (size_t j = 0; j < N; j++) {
            double got = 0;
            if (at[j] < all.colptr[j + 1] && all.row[at[j]] == row) {
                got = entries_value(&all, at[j]++);
                T_OK(want[j] > least);
            }
            worst = fmax(worst, fabs(got - want[j]));
        }
    }
    *empty = 0;
    for (size_t j = 0; j < N; j++) { /* all used: rows ascend and none is there twice */
        T_EQ_I(at[j], all.colptr[j + 1]);
        *empty += all.colptr[j] == all.colptr[j + 1];
    }
    entries_free(&all);
    free(at);
    free(want);
    return worst;
}
#endif
