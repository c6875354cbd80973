/* hull_picture.h - the visual hull of a frame as a picture (paper Fig. 4): voxels inside red, partly
 * inside green, outside yellow, seen from two cameras and in three slices, and the silhouette of
 * every camera that they come from.
 * Threads: one picture at a time per object.  Used by: reconstruct.c. */
#ifndef HULL_PICTURE_H
#define HULL_PICTURE_H
#include "recon/frame/frame.h"

typedef struct hull_picture hull_picture;

/* S, rig and pool are borrowed.  Errors: PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err hull_picture_new(const rec_sysmat *S, const struct rec_rig *rig, int nch,
                                        uint32_t min_views, pvx_pool *pool, hull_picture **out);
void hull_picture_free(hull_picture **h);

/* Picture of a carved frame to a .png; present[c] as the frame was told.  Errors: the file's. */
PVX_MUST_CHECK pvx_err hull_picture_save(hull_picture *h, const rec_frame *f, const bool *present,
                                         uint32_t number, const char *path, struct pvx_diag *d);

#endif
