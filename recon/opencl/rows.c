/* rows.c - S by rows: which bricks have entries in a tile, and where those entries are.  kernels/rows.cl has the steps of
 * the device. */
#include <stdlib.h>

#include "base/mem.h"
#include "recon/opencl/upload.h"

/* The pairs, on the host. */
struct pairs {
    uint32_t *tile_from; /* [all_tiles + 1] */
    uint32_t *brick;     /* [pairs] */
    uint32_t *size, *at; /* [pairs]: numbers of two bytes; in units of REC_CL_UNIT numbers */
};
static void pairs_free(struct pairs *p)
{
    free(p->tile_from);
    free(p->brick);
    free(p->size);
    free(p->at);
}

/* What the kernels read and work on. */
#define READ(l)                                                                 \
    REC_CL_BUFFER(&(l)->at), REC_CL_BUFFER(&(l)->w), REC_CL_BUFFER(&(l)->more), \
        REC_CL_BUFFER(&(l)->more_from)

/* rect [stored][cameras] */
static pvx_err rects(rec_cl_queue *q, const struct rec_cl_level *l, struct rec_rect *rect,
                     struct pvx_diag *d)
{
    rec_cl *cl = rec_cl_of(q);
    struct rec_cl_buffer out;
    uint64_t n = (uint64_t)l->stored * l->S->n_cameras;
    PVX_TRY(rec_cl_part_new(cl, "bricks", n * sizeof *rect, &out, d));
    bool ok = true;
    for (uint64_t first = 0; ok && first < n; first += REC_CL_LAUNCH) {
        size_t groups = (size_t)(n - first < REC_CL_LAUNCH ? n - first : REC_CL_LAUNCH);
        REC_CL_RUN(q, REC_CL_K_BRICK_RECTS, 1, groups, REC_CL_GROUP, REC_CL_BUFFER(&l->geometry),
                   REC_CL_VALUE(first), READ(l), REC_CL_BUFFER(&out));
        ok = rec_cl_wait(q);
    }
    rec_cl_download(q, &out, 0, rect, n * sizeof *rect);
    ok = rec_cl_wait(q) && ok;
    rec_cl_buffer_free(cl, &out);
    return ok ? PVX_OK : pvx_fail(d, PVX_ENODEV, "%s: %s", rec_cl_about(cl)->name, rec_cl_lost(cl));
}

/* Every tile of a rectangle: adds 1 to next[tile], and where there is a list, puts the brick there. */
static void visit(const struct rec_cl_camera *c, struct rec_rect r, uint32_t *next, uint32_t brick,
                  uint32_t *list)
{
    for (int y = r.y0 / REC_CL_TILE; y <= r.y1 / REC_CL_TILE; y++)
        for (int x = r.x0 / REC_CL_TILE; x <= r.x1 / REC_CL_TILE; x++) {
            uint32_t at = next[c->tile0 + y * c->tiles + x]++;
            if (list != NULL)
                list[at] = brick;
        }
}
static void visit_all(const struct rec_cl_level *l, const struct rec_rect *rect, uint32_t *next,
                      uint32_t *list)
{
    for (uint32_t s = 0; s < l->stored; s++)
        for (int c = 0; c < l->g.cameras; c++, rect++)
            if (rec_rect_seen(*rect))
                visit(&l->g.camera[c], *rect, next, s, list);
}

/* p->tile_from and p->brick: ascending bricks in each tile. */
static pvx_err list_pairs(const struct rec_cl_level *l, const struct rec_rect *rect,
                          struct pairs *p, struct pvx_diag *d)
{
    size_t tiles = (size_t)l->g.all_tiles;
    uint64_t n = 0;
    p->tile_from = pvx_calloc(tiles + 2, sizeof *p->tile_from);
    PVX_NEED(p->tile_from);
    visit_all(l, rect, p->tile_from + 2, NULL);
    for (size_t t = 0; t < tiles; t++) {
        n += p->tile_from[t + 2];
        p->tile_from[t + 2] += p->tile_from[t + 1];
    }
    if (n > UINT32_MAX)
        return pvx_fail(
            d, PVX_ERANGE,
            "bricks and tiles of the pictures make %llu pairs; on a graphics card there "
            "may be 4294967295: use fewer voxels or larger bins",
            (unsigned long long)n);
    p->brick = pvx_calloc((size_t)n, sizeof *p->brick);
    p->size = pvx_calloc((size_t)n, sizeof *p->size);
    p->at = pvx_calloc((size_t)n, sizeof *p->at);
    PVX_NEED(p->brick != NULL && p->size != NULL && p->at != NULL);
    visit_all(l, rect, p->tile_from + 1, p->brick);
    return PVX_OK;
}

/* One kernel over some tiles: l->rows, or where there is a `size`, that. */
static void run_some(rec_cl_queue *q, const struct rec_cl_level *l, uint32_t tile, uint32_t tiles,
                     const struct rec_cl_buffer *size)
{
    if (size != NULL)
        REC_CL_RUN(q, REC_CL_K_PAIR_SIZES, 1, tiles, REC_CL_GROUP, REC_CL_BUFFER(&l->geometry),
                   REC_CL_VALUE(tile), READ(l), REC_CL_BUFFER(&l->tile_from),
                   REC_CL_BUFFER(&l->pair_brick), REC_CL_BUFFER(size));
    else
        REC_CL_RUN(q, REC_CL_K_PAIR_FILL, 1, tiles, REC_CL_GROUP, REC_CL_BUFFER(&l->geometry),
                   REC_CL_VALUE(tile), READ(l), REC_CL_BUFFER(&l->tile_from),
                   REC_CL_BUFFER(&l->pair_brick), REC_CL_BUFFER(&l->pair_at),
                   REC_CL_BUFFER(&l->pair_bins), REC_CL_BUFFER(&l->rows));
}
/* All tiles, some pairs at a time. */
static bool run_all(rec_cl_queue *q, const struct rec_cl_level *l, const struct pairs *p,
                    const struct rec_cl_buffer *size)
{
    const uint32_t tiles = (uint32_t)l->g.all_tiles, *from = p->tile_from;
    for (uint32_t tile = 0, end; tile < tiles; tile = end) {
        for (end = tile + 1; end < tiles && from[end + 1] - from[tile] <= REC_CL_LAUNCH;)
            end++;
        run_some(q, l, tile, end - tile, size);
        if (!rec_cl_wait(q))
            return false;
    }
    return true;
}

/* p->size of all pairs. */
static pvx_err measure(rec_cl_queue *q, struct rec_cl_level *l, const struct pairs *p,
                       struct pvx_diag *d)
{
    size_t tiles = (size_t)l->g.all_tiles, n = p->tile_from[tiles];
    struct rec_cl_buffer size = {NULL, 0};
    PVX_TRY(rec_cl_part_from(q, "tiles", p->tile_from, (tiles + 1) * sizeof *p->tile_from,
                             &l->tile_from, d));
    PVX_TRY(rec_cl_part_from(q, "pairs", p->brick, n * sizeof *p->brick, &l->pair_brick, d));
    PVX_TRY(rec_cl_part_new(rec_cl_of(q), "pairs", n * sizeof *p->size, &size, d));
    bool ok = run_all(q, l, p, &size);
    rec_cl_download(q, &size, 0, p->size, n * sizeof *p->size);
    ok = rec_cl_wait(q) && ok;
    rec_cl_buffer_free(rec_cl_of(q), &size);
    return ok ? PVX_OK
              : pvx_fail(d, PVX_ENODEV, "%s: %s", rec_cl_about(rec_cl_of(q))->name,
                         rec_cl_lost(rec_cl_of(q)));
}

/* Leaves out pairs without an entry.  p->at; *units of l->rows. */
static void pack(struct rec_cl_level *l, struct pairs *p, uint64_t *units)
{
    uint32_t n = 0, from = 0;
    *units = 0;
    for (uint32_t t = 0; t < (uint32_t)l->g.all_tiles; t++) {
        uint32_t end = p->tile_from[t + 1];
        for (p->tile_from[t] = n; from < end; from++) {
            if (p->size[from] == 0)
                continue;
            p->brick[n] = p->brick[from];
            p->at[n++] = (uint32_t)*units;
            *units += (p->size[from] + REC_CL_UNIT - 1) / REC_CL_UNIT;
        }
    }
    p->tile_from[l->g.all_tiles] = l->pairs = n;
}

static pvx_err fill(rec_cl_queue *q, struct rec_cl_level *l, struct pairs *p, struct pvx_diag *d)
{
    uint64_t units;
    size_t tiles = (size_t)l->g.all_tiles;
    rec_cl *cl = rec_cl_of(q);
    pack(l, p, &units);
    if (units > UINT32_MAX)
        return pvx_fail(d, PVX_ERANGE,
                        "the system matrix' rows take %.3g GB; on a graphics card it may be "
                        "%.3g: use fewer voxels or larger bins",
                        1e-9 * 2 * REC_CL_UNIT * (double)units,
                        1e-9 * 2 * REC_CL_UNIT * (double)UINT32_MAX);
    rec_cl_upload(q, &l->tile_from, 0, p->tile_from, (tiles + 1) * sizeof *p->tile_from);
    rec_cl_upload(q, &l->pair_brick, 0, p->brick, l->pairs * sizeof *p->brick);
    PVX_TRY(rec_cl_part_from(q, "pairs", p->at, l->pairs * sizeof *p->at, &l->pair_at, d));
    PVX_TRY(rec_cl_part_new(cl, "pairs", l->pairs * sizeof(uint64_t), &l->pair_bins, d));
    PVX_TRY(rec_cl_part_new(cl, "rows", units * REC_CL_UNIT * sizeof(uint16_t), &l->rows, d));
    return run_all(q, l, p, NULL)
               ? PVX_OK
               : pvx_fail(d, PVX_ENODEV, "%s: %s", rec_cl_about(cl)->name, rec_cl_lost(cl));
}

pvx_err rec_cl_make_rows(rec_cl_queue *q, struct rec_cl_level *l, struct pvx_diag *d)
{
    struct rec_rect *rect = pvx_calloc((size_t)l->stored * l->S->n_cameras, sizeof *rect);
    struct pairs p = {0};
    pvx_err e = rect == NULL ? PVX_ENOMEM : rects(q, l, rect, d);
    PVX_THEN(e, list_pairs(l, rect, &p, d));
    free(rect);
    PVX_THEN(e, measure(q, l, &p, d));
    PVX_THEN(e, fill(q, l, &p, d));
    pairs_free(&p);
    return e;
}
