/* images.h - the raw frames of one set become the binned pixels of a rec_frame.
 *
 * JPEG frames are decoded first, one task per camera, then every image is converted in bands.  A frame
 * that cannot be used is counted by cause and told (at most once a second); its camera is missing from
 * this set.
 * Owner: caller; S, rig and pool are borrowed.  Threads: one set at a time; counts from any thread.
 * After new nothing is allocated here; libjpeg-turbo takes work memory for each picture (jpeg.h). */
#ifndef DMN_IMAGES_H
#define DMN_IMAGES_H
#include "capture/sync/frameset.h"
#include "capture/pixel/pixfmt.h"
#include "daemon/control/state.h"
#include "recon/frame/frame.h"

typedef struct dmn_images dmn_images;

struct dmn_images_params {
    int nch;
    enum cap_pixfmt fmt; /* what the cameras are asked for; NONE = any, JPEG too */
    enum cap_transfer transfer;
    enum cap_mosaic mosaic; /* of Bayer images when S has binning 1 */
};

/* Errors: PVX_ENOMEM, PVX_EINVAL (camera too large for a JPEG). */
PVX_MUST_CHECK pvx_err dmn_images_new(const struct dmn_images_params *p, const rec_sysmat *S,
                                      const struct rec_rig *rig, pvx_pool *pool, dmn_images **out,
                                      struct pvx_diag *d);
void dmn_images_free(dmn_images **i);

/* Fills f's inputs and says which cameras are present; returns how many and their bits in *mask. */
uint32_t dmn_images_bin(dmn_images *i, const struct cap_set *set, rec_frame *f, uint64_t *mask);
void dmn_images_counts(dmn_images *i, uint64_t out[][DMN_N_IMAGE]); /* [cameras] */
#endif
