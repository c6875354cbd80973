/* images.h - the raw images of one set become binned pixels.
 *
 * Pictures of 16 bits whose samples all end at 10 to 15 bits are saturated there (depth.h).  Pictures of a format
 * of 10, 12 or 14 bits with samples above are not used.
 * A grey picture has no colour, so beside pictures with colour it is not used (`alike`).  A picture without a finite
 * bin is not used either.
 * JPEG images are decoded first, one task per camera, then every image is converted in bands.  An image that
 * cannot be used is counted by cause; its camera is missing from this set.
 * Owner: caller; rig and pool are borrowed.  Threads: one set at a time; counts from any thread.
 * Memory is allocated by new, and for a camera's maps when its first picture of a format comes (with photometry).
 * Nothing else is allocated here.  libjpeg-turbo takes work memory for each picture (jpeg.h). */
#ifndef DMN_IMAGES_H
#define DMN_IMAGES_H
#include "capture/pixel/depth.h"
#include "capture/pixel/pixfmt.h"
#include "daemon/control/state.h"
#include "daemon/pipeline/photometry.h"
#include "recon/frame/frame.h"

typedef struct dmn_images dmn_images;

struct dmn_images_params {
    int nch, binning;    /* raw pixels per bin side */
    enum cap_pixfmt fmt; /* asked of the cameras; NONE = any, JPEG too */
    enum cap_transfer transfer;
    enum cap_mosaic mosaic;      /* of Bayer images at binning 1 */
    const dmn_photometry *light; /* borrowed; NULL = none: pictures as they are */
    /* Pictures of one kind only.  3 channels: no grey one while another camera's last picture has colour.  1 channel:
     * none with colour.  false: grey becomes three equal channels, colour the mean of three. */
    bool alike;
    int32_t
        look; /* every so many rows are looked at for the depth, other ones in the next set; 0 = 1 */
};

/* Errors: PVX_ENOMEM, PVX_EINVAL (camera too large for a JPEG). */
PVX_MUST_CHECK pvx_err dmn_images_new(const struct dmn_images_params *p, const struct rec_rig *rig,
                                      pvx_pool *pool, dmn_images **out, struct pvx_diag *d);
void dmn_images_free(dmn_images **i);

/* The black level that is subtracted later, from any thread.  Above 1 it is for floats: others are not used. */
void dmn_images_black(dmn_images *i, float black);
/* What was seen before of camera c's samples. */
void dmn_images_seen(dmn_images *i, size_t c, const struct cap_depth *d);
/* Bins image[cameras] (NULL = missing) into out[cameras] [bins down][bins across][1 or 4].  Returns the number of
 * usable images, with their bits in *mask. */
uint32_t dmn_images_bin(dmn_images *i, const struct cap_image *const *image, float *const *out,
                        uint64_t *mask);
/* The same into a frame; also sets the frame's rec_frame_camera of each camera.  A frame whose card unpacks pictures
 * gets them as they are, if all are raw (raw.h).  It may ask for its bins until the next set comes here. */
uint32_t dmn_images_bin_frame(dmn_images *i, const struct cap_image *const *image, rec_frame *f,
                              uint64_t *mask);
/* Camera c's image in the last set: colours of the 2x2 pixels of its Bayer filter; NULL = it has none. */
const uint8_t *dmn_images_bayer(const dmn_images *i, size_t c);
/* Whether its pixels are floating-point numbers. */
bool dmn_images_floats(const dmn_images *i, size_t c);
/* Samples of a pixel: 1 of grey and Bayer images, else 3. */
int dmn_images_samples(const dmn_images *i, size_t c);
/* Value of its saturated bins.  0 means 1, the value for most cameras without photometry. */
float dmn_images_saturated(const dmn_images *i, size_t c);
/* Bits at which its samples end, fewer than its format has; 0: they do not, or it is not known. */
int dmn_images_bits(const dmn_images *i, size_t c);
/* Why it could not be used. */
const char *dmn_images_why(const dmn_images *i, size_t c);
void dmn_images_counts(dmn_images *i, uint64_t out[][DMN_N_IMAGE]); /* [cameras] */
#endif
