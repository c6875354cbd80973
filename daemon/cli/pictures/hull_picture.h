/* hull_picture.h - the visual hull of a frame as a picture (Figure 4 of the method's paper).  Voxels inside are red,
 * partly inside green, outside yellow.  They are shown from two cameras and in three slices, with the silhouette of
 * every camera.
 * Threads: one picture at a time per object. */
#ifndef HULL_PICTURE_H
#define HULL_PICTURE_H
#include "recon/frame/frame.h"

typedef struct hull_picture hull_picture;

/* S, rig and pool are borrowed.  Errors: PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err hull_picture_new(const rec_sysmat *S, const struct rec_rig *rig, int nch,
                                        uint32_t min_views, pvx_pool *pool, hull_picture **out);
void hull_picture_free(hull_picture **h);

/* Draw a carved frame and save it as .png.  present[c]: the frame has a picture of camera c.  Errors: the file's. */
PVX_MUST_CHECK pvx_err hull_picture_save(hull_picture *h, const rec_frame *f, const bool *present,
                                         uint64_t number, const char *path, struct pvx_diag *d);

#endif
