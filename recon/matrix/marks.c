#include "recon/matrix/marks.h"

#include <stdlib.h>

#include "base/mem.h"

void rec_active_free(struct rec_active **ap)
{
    struct rec_active *a = *ap;
    if (a == NULL)
        return;
    free(a->brick);
    for (size_t c = 0; c < REC_MAX_CAMERAS; c++)
        free(a->rect[c]);
    free(a->bits);
    free(a->rank);
    free(a->column);
    PVX_FREE(*ap);
}

pvx_err rec_active_new(const struct rec_grid *g, struct rec_active **out)
{
    struct rec_active *a = *out = pvx_calloc(1, sizeof *a);
    PVX_NEED(a);
    a->bricks = rec_brick_places(g) / REC_BRICK_VOXELS;
    a->brick = pvx_calloc(a->bricks, sizeof *a->brick);
    if (a->brick == NULL)
        rec_active_free(out);
    return *out == NULL ? PVX_ENOMEM : PVX_OK;
}

/* Sets the bits of the kept voxels: those in a marked brick. */
static void set_bits(struct rec_active *a, const struct rec_grid *g)
{
    size_t voxel = 0;
    for (int32_t k = 0; k < g->n[2]; k++)
        for (int32_t j = 0; j < g->n[1]; j++) {
            size_t brick = rec_brick_place(g, 0, j, k) / REC_BRICK_VOXELS;
            for (int32_t i = 0; i < g->n[0]; i++, voxel++)
                a->bits[voxel / 64] |= (uint64_t)(a->brick[brick + (size_t)(i / REC_BRICK)] != 0)
                                       << voxel % 64;
        }
}

pvx_err rec_active_close(struct rec_active *a, const struct rec_grid *g)
{
    size_t words = (rec_grid_count(g) + 63) / 64;
    a->bits = pvx_calloc(words, sizeof *a->bits);
    a->rank = pvx_calloc(words, sizeof *a->rank);
    if (a->bits == NULL || a->rank == NULL)
        return PVX_ENOMEM;
    set_bits(a, g);
    a->marked = a->columns = 0;
    for (size_t b = 0; b < a->bricks; b++)
        a->marked += a->brick[b];
    for (size_t w = 0; w < words; w++) {
        a->rank[w] = (uint32_t)a->columns;
        a->columns += (size_t)__builtin_popcountll(a->bits[w]);
    }
    a->column = pvx_calloc(a->columns, sizeof *a->column);
    if (a->column == NULL)
        return PVX_ENOMEM;
    for (size_t w = 0, n = 0; w < words; w++)
        for (uint64_t bits = a->bits[w]; bits != 0; bits &= bits - 1)
            a->column[n++] = (uint32_t)(64 * w) + (uint32_t)__builtin_ctzll(bits);
    return PVX_OK;
}

/* A brick of the coarser grid has 8 bricks of this one, fewer at the sides. */
pvx_err rec_active_coarser(const struct rec_active *a, const struct rec_grid *g,
                           const struct rec_grid *coarse, struct rec_active **out)
{
    PVX_TRY(rec_active_new(coarse, out));
    int32_t nx = rec_bricks(g, 0), ny = rec_bricks(g, 1), nz = rec_bricks(g, 2);
    size_t b = 0;
    for (int32_t z = 0; z < nz; z++)
        for (int32_t y = 0; y < ny; y++)
            for (int32_t x = 0; x < nx; x++, b++)
                if (a->brick[b])
                    (*out)->brick[rec_brick_place(coarse, x / 2 * REC_BRICK, y / 2 * REC_BRICK,
                                                  z / 2 * REC_BRICK) /
                                  REC_BRICK_VOXELS] = 1;
    pvx_err e = rec_active_close(*out, coarse);
    if (e != PVX_OK)
        rec_active_free(out);
    return e;
}
