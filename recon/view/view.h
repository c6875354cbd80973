/* view.h - one viewpoint, many volumes: every picture is one matrix product (paper 5).
 *
 *     y = V x,   V = the rays of the viewpoint's pixels, columns of voxels with light in them     (1)
 *
 * V is traced for the first volume and kept.  Its columns are the voxels that had light so far and those next to
 * them.  When light appears elsewhere, V is traced again for the union.  Pictures equal those of rec_render except
 * for the order of the sums (floats, 1e-6 of the brightest).
 * Memory: 8 bytes per entry of V.
 * Ownership: the camera is copied, bodies and pool are borrowed.  Threads: one call per rec_view at a time;
 * parallel inside, same bits for any thread count. */
#ifndef REC_VIEW_H
#define REC_VIEW_H
#include <stddef.h>
#include "base/err.h"
#include "base/pool.h"
#include "recon/geom/camera.h"
#include "recon/geom/grid.h"
#include "recon/view/render.h"

#ifdef __cplusplus
extern "C" {
#endif

typedef struct rec_view rec_view;

struct rec_view_stats {
    uint32_t traced, rendered; /* times */
    uint64_t entries;          /* of V as it is now */
    int32_t columns;
    int64_t trace_ns, product_ns; /* sums; product_ns is all but the tracing */
};

/* V may take at most max_bytes.  Errors: PVX_EINVAL, PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_view_new(const struct rec_eye *eye, size_t max_bytes, pvx_pool *pool,
                                    rec_view **out);
void rec_view_free(rec_view **v);

/* dense [nz][ny][nx][nch], nch 1 or 3, on g -> image [h][w][nch], unclipped.  A grid other than
 * the last one starts anew.  Errors: PVX_EINVAL, PVX_ENOMEM; PVX_ERANGE: V would be over
 * max_bytes (rec_render needs no V). */
PVX_MUST_CHECK pvx_err rec_view_render(rec_view *v, const struct rec_grid *g, const float *dense,
                                       int nch, float *image);
void rec_view_get_stats(const rec_view *v, struct rec_view_stats *out);

#ifdef __cplusplus
}
#endif
#endif
