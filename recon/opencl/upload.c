/* upload.c - columns and footprints of a level, in the order of its bricks.  They pass in pieces: there is never a second
 * copy of them on the host. */
#include "recon/opencl/upload.h"

#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/carve/hull_bricks.h"
#include "recon/matrix/active.h"

#define VOXELS REC_BRICK_VOXELS
#define PIECE  ((size_t)4 << 20) /* bytes of windows, about */

pvx_err rec_cl_part_new(rec_cl *cl, const char *what, size_t bytes, struct rec_cl_buffer *out,
                        struct pvx_diag *d)
{
    struct pvx_diag why = {""};
    pvx_err e = rec_cl_buffer_new(cl, bytes, out, &why);
    return e == PVX_OK ? e
                       : pvx_fail(d, e, "the system matrix' %s: %s", what, pvx_diag_text(&why, e));
}
pvx_err rec_cl_part_from(rec_cl_queue *q, const char *what, const void *from, size_t bytes,
                         struct rec_cl_buffer *out, struct pvx_diag *d)
{
    PVX_TRY(rec_cl_part_new(rec_cl_of(q), what, bytes, out, d));
    rec_cl_upload(q, out, 0, from, bytes);
    return PVX_OK;
}

/* Windows of some bricks, as the device has them. */
struct piece {
    size_t bricks;
    int32_t *at; /* [bricks][cameras][64] */
    uint8_t *w;  /* [bricks][cameras][high*wide/4][64][4] */
};

/* The voxel of place o of a brick; -1: beside the grid. */
static int32_t voxel_of(const struct rec_grid *g, uint32_t brick, int32_t o)
{
    int32_t b = (int32_t)brick, nx = rec_bricks(g, 0), ny = rec_bricks(g, 1);
    int32_t i = b % nx * REC_BRICK + o % REC_BRICK;
    int32_t j = b / nx % ny * REC_BRICK + o / REC_BRICK % REC_BRICK;
    int32_t k = b / nx / ny * REC_BRICK + o / (REC_BRICK * REC_BRICK);
    return i < g->n[0] && j < g->n[1] && k < g->n[2] ? rec_grid_index(g, i, j, k) : -1;
}

static void put_windows(const rec_sysmat *S, uint32_t brick, int32_t *at, uint8_t *w)
{
    const struct rec_windows *m = &S->win;
    size_t slots = (size_t)m->slots, size = rec_window_size(m);
    for (int32_t o = 0; o < VOXELS; o++) {
        int32_t q = voxel_of(&S->grid, brick, o);
        for (size_t c = 0; c < S->n_cameras; c++) {
            size_t from = (size_t)q * slots + c, to = c * VOXELS + (size_t)o;
            bool is = q >= 0 && m->at[from] != m->nowhere;
            at[to] = is ? (int32_t)m->at[from] : REC_CL_NOWHERE;
            uint8_t *quad = w + (c * size * VOXELS + (size_t)o * 4);
            for (size_t k = 0; k < size; k += 4, quad += 4 * (size_t)VOXELS)
                if (is)
                    memcpy(quad, m->w + from * size + k, 4);
                else
                    memset(quad, 0, 4);
        }
    }
}

static void upload_windows(rec_cl_queue *q, const struct rec_cl_level *l, const uint32_t *brick,
                           const struct piece *p)
{
    size_t windows = l->S->n_cameras * VOXELS, size = rec_window_size(&l->S->win);
    for (size_t s = 0, n; s < l->stored; s += n) {
        n = l->stored - s < p->bricks ? l->stored - s : p->bricks;
        for (size_t i = 0; i < n; i++)
            put_windows(l->S, brick[s + i], p->at + i * windows, p->w + i * windows * size);
        rec_cl_upload(q, &l->at, s * windows * sizeof *p->at, p->at, n * windows * sizeof *p->at);
        rec_cl_upload(q, &l->w, s * windows * size, p->w, n * windows * size);
    }
}

/* Number of the further window's brick among the stored, and its place there. */
static size_t brick_of(const rec_sysmat *S, const int32_t *store, const struct rec_more *k,
                       int32_t *place)
{
    int32_t ijk[3];
    rec_grid_ijk(&S->grid, (int32_t)k->column, ijk);
    size_t at = rec_brick_place(&S->grid, ijk[0], ijk[1], ijk[2]);
    *place = (int32_t)(at % VOXELS);
    return (size_t)store[at / VOXELS];
}

/* S's further windows by bricks; those of a brick ascend already.  from [stored + 2]: 0 */
static void sort_more(const rec_sysmat *S, const int32_t *store, size_t stored, uint32_t *from,
                      struct rec_cl_more *out)
{
    const struct rec_windows *m = &S->win;
    int32_t place;
    for (uint32_t i = 0; i < m->n_more; i++)
        from[brick_of(S, store, &m->more[i], &place) + 2]++;
    for (size_t s = 0; s < stored; s++)
        from[s + 2] += from[s + 1];
    for (uint32_t i = 0; i < m->n_more; i++) { /* from[s + 1]: the next of brick s */
        const struct rec_more *k = &m->more[i];
        struct rec_cl_more *o = &out[from[brick_of(S, store, k, &place) + 1]++];
        *o = (struct rec_cl_more){place, (int32_t)k->slot, (int32_t)k->at, {0}};
        memcpy(o->w, k->w, sizeof o->w);
    }
}

static pvx_err upload_more(rec_cl_queue *q, struct rec_cl_level *l, const int32_t *store,
                           struct pvx_diag *d)
{
    size_t n = l->S->win.n_more;
    uint32_t *from = pvx_calloc(l->stored + 2, sizeof *from);
    struct rec_cl_more *more = pvx_calloc(n, sizeof *more);
    pvx_err e = from == NULL || more == NULL ? PVX_ENOMEM : PVX_OK;
    if (e == PVX_OK)
        sort_more(l->S, store, l->stored, from, more);
    PVX_THEN(e, rec_cl_part_from(q, "further windows", more, n * sizeof *more, &l->more, d));
    PVX_THEN(e,
             rec_cl_part_from(q, "bricks", from, (l->stored + 1) * sizeof *from, &l->more_from, d));
    free(from);
    free(more);
    return e;
}

pvx_err rec_cl_upload_columns(rec_cl_queue *q, struct rec_cl_level *l, const struct rec_cl_order *o,
                              struct pvx_diag *d)
{
    size_t windows = l->S->n_cameras * VOXELS, size = rec_window_size(&l->S->win);
    size_t bytes = windows * (sizeof(int32_t) + size), n = PIECE / bytes;
    struct piece p = {.bricks = n > 0 ? n : 1};
    PVX_TRY(
        rec_cl_part_new(rec_cl_of(q), "windows", l->stored * windows * sizeof *p.at, &l->at, d));
    PVX_TRY(rec_cl_part_new(rec_cl_of(q), "weights", l->stored * windows * size, &l->w, d));
    p.at = pvx_calloc(p.bricks * windows, sizeof *p.at);
    p.w = pvx_calloc(p.bricks * windows, size);
    pvx_err e = p.at == NULL || p.w == NULL ? PVX_ENOMEM : PVX_OK;
    if (e == PVX_OK)
        upload_windows(q, l, o->brick, &p);
    free(p.at);
    free(p.w);
    return e == PVX_OK ? upload_more(q, l, o->store, d) : e;
}

/* ---- footprints --------------------------------------------------------------------------------- */

/* Bricks that follow one another in the grid go at once. */
static void upload_camera(rec_cl_queue *q, const struct rec_cl_level *l, const uint32_t *brick,
                          size_t c)
{
    const struct rec_rect *fp = l->S->block[c].fp;
    const size_t bytes = VOXELS * sizeof *fp;
    for (size_t s = 0, n; s < l->stored; s += n) {
        for (n = 1; s + n < l->stored && brick[s + n] == brick[s] + n;)
            n++;
        rec_cl_upload(q, &l->fp, (c * l->stored + s) * bytes, fp + (size_t)brick[s] * VOXELS,
                      n * bytes);
    }
}

pvx_err rec_cl_upload_footprints(rec_cl_queue *q, struct rec_cl_level *l,
                                 const struct rec_cl_order *o, struct pvx_diag *d)
{
    const rec_sysmat *S = l->S;
    const size_t bricks = (size_t)l->g.all_bricks, cameras = S->n_cameras;
    const size_t bytes = bricks * sizeof(struct rec_rect);
    PVX_TRY(rec_cl_part_new(rec_cl_of(q), "footprints",
                            cameras * l->stored * VOXELS * sizeof(struct rec_rect), &l->fp, d));
    PVX_TRY(rec_cl_part_new(rec_cl_of(q), "footprints of bricks", cameras * bytes, &l->rect, d));
    struct rec_rect *own = pvx_calloc(bricks, sizeof *own);
    PVX_NEED(own);
    for (size_t c = 0; c < cameras; c++) {
        upload_camera(q, l, o->brick, c);
        for (size_t b = 0; b < bricks && S->active == NULL; b++)
            own[b] = rec_hull_rect(S, c, b);
        rec_cl_upload(q, &l->rect, c * bytes, S->active != NULL ? S->active->rect[c] : own, bytes);
    }
    free(own);
    return PVX_OK;
}
