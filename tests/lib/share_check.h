/* share_check.h - a shared volume, read voxel by voxel with PNanoVDB.h, against what bed_value.h says of its set.  Needs
 * nothing of pyrovox but pyrovox_share.h. */
#ifndef TESTS_SHARE_CHECK_H
#define TESTS_SHARE_CHECK_H
#include <math.h>
#include <stdbool.h>
#include <stdio.h>

#define PNANOVDB_C
#define PNANOVDB_BUF_BOUNDS_CHECK /* a check that can fail meets what it was made for */
#include <nanovdb/PNanoVDB.h>

#include "proto/clients/pyrovox_share.h"
#include "tests/lib/bed_value.h"

struct share_want {
    uint32_t n[3], channels;
    bool split, empty; /* empty: no brick at all */
    double min[3], max[3];
};

struct share_grid { /* one grid while it is read */
    pnanovdb_buf_t buf;
    pnanovdb_grid_handle_t head;
    pnanovdb_grid_type_t type;
    pnanovdb_readaccessor_t acc;
};

static inline bool share_grid_open(const struct pvp_share_volume *v, const char *name,
                                   uint32_t type, struct share_grid *g)
{
    size_t size;
    const void *at = pvp_share_grid(v, name, &size);
    if (at == NULL || size % 32 != 0 || (uintptr_t)at % 32 != 0)
        return false;
    g->buf = pnanovdb_make_buf((uint32_t *)(uintptr_t)at, size / 4);
    g->head.address = pnanovdb_address_null();
    g->type = pnanovdb_grid_get_grid_type(g->buf, g->head);
    const uint32_t version = pnanovdb_grid_get_version(g->buf, g->head);
    pnanovdb_root_handle_t root =
        pnanovdb_tree_get_root(g->buf, pnanovdb_grid_get_tree(g->buf, g->head));
    pnanovdb_readaccessor_init(&g->acc, root);
    return pnanovdb_grid_get_magic(g->buf, g->head) == PNANOVDB_MAGIC_NUMBER &&
           pnanovdb_version_get_major(version) == PNANOVDB_MAJOR_VERSION_NUMBER &&
           pnanovdb_grid_get_grid_size(g->buf, g->head) == size && g->type == type;
}

static inline bool share_voxel(struct share_grid *g, int i, int j, int k, const float *want,
                               uint32_t n)
{
    pnanovdb_coord_t at = {i, j, k};
    pnanovdb_address_t p = pnanovdb_readaccessor_get_value_address(g->type, g->buf, &g->acc, &at);
    bool on = false;
    for (uint32_t c = 0; c < n; c++) {
        const float got = pnanovdb_read_float(g->buf, pnanovdb_address_offset(p, 4 * c));
        if (!(fabsf(got - want[c]) <= 1e-6f * fabsf(want[c])))
            return false;
        on |= want[c] != 0;
    }
    return (pnanovdb_readaccessor_is_active(g->type, g->buf, &g->acc, &at) != 0) == on;
}

/* Index (0, 0, 0) and (1, 2, 3) are the centres of their voxels. */
static inline bool share_place(const struct share_grid *g, const struct share_want *w)
{
    for (int step = 0; step < 2; step++) {
        pnanovdb_vec3_t index = {(float)step, (float)(2 * step), (float)(3 * step)};
        pnanovdb_vec3_t got = pnanovdb_grid_index_to_worldf(g->buf, g->head, &index);
        const float at[3] = {got.x, got.y, got.z}, of[3] = {index.x, index.y, index.z};
        for (int a = 0; a < 3; a++)
            if (fabs(w->min[a] + (of[a] + 0.5) * (w->max[a] - w->min[a]) / w->n[a] - at[a]) > 1e-6)
                return false;
    }
    return true;
}

/* Voxels of all grids that are not what they should be, those around the volume too; a grid that is not there counts as
 * one. */
static inline unsigned long share_errors(const struct pvp_share_volume *v,
                                         const struct share_want *w)
{
    static const char *const names[] = {"density", "red", "green", "blue"};
    struct share_grid g[4];
    const uint32_t n_grids = w->channels == 1 ? 1 : w->split ? 4 : 2;
    unsigned long bad = v->n_grids != n_grids;
    for (uint32_t q = 0; q < n_grids; q++) {
        bool vectors = n_grids == 2 && q == 1;
        if (!share_grid_open(v, vectors ? "emission" : names[q],
                             vectors ? PNANOVDB_GRID_TYPE_VEC3F : PNANOVDB_GRID_TYPE_FLOAT, &g[q]))
            return bad + 1;
        bad += !share_place(&g[q], w);
    }
    for (int k = -9; k < (int)w->n[2] + 9; k++)
        for (int j = -9; j < (int)w->n[1] + 9; j++)
            for (int i = -9; i < (int)w->n[0] + 9; i++) {
                const uint32_t at[3] = {(uint32_t)i, (uint32_t)j, (uint32_t)k};
                float c[3] = {0, 0, 0};
                if (!w->empty && at[0] < w->n[0] && at[1] < w->n[1] && at[2] < w->n[2] &&
                    bed_lit(w->n, v->set, at[0], at[1], at[2]))
                    for (uint32_t a = 0; a < w->channels; a++)
                        c[a] = bed_value(w->n, v->set, at[0], at[1], at[2], a);
                const float grey =
                    w->channels == 1 ? c[0] : 0.2126f * c[0] + 0.7152f * c[1] + 0.0722f * c[2];
                bad += !share_voxel(&g[0], i, j, k, &grey, 1);
                if (n_grids == 2)
                    bad += !share_voxel(&g[1], i, j, k, c, 3);
                for (uint32_t q = 1; n_grids == 4 && q < 4; q++)
                    bad += !share_voxel(&g[q], i, j, k, &c[q - 1], 1);
            }
    return bad;
}
#endif
