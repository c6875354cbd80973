/* frames_in.h - the offline source of the pipeline: recorded frames, from a folder
 * DIR/<camera name>/<frame number, 6 digits or more>.(npy|png|tif|tiff|jpg) or a take of raw frames (FILE.h5), whose
 * frames are numbered by their sets.
 *
 * A frame that a camera lacks is missing from its set; one that cannot be used is told on stderr, and
 * missing too.
 * Ownership: the struct is the caller's; it may not be moved once used as a source.  Threads: one. */
#ifndef FRAMES_IN_H
#define FRAMES_IN_H
#include <stdatomic.h>
#include "capture/files/imgio.h"
#include "capture/take/take.h"
#include "daemon/pipeline/images.h"
#include "daemon/pipeline/pipeline.h"

#define FRAMES_IN_LAST (UINT32_MAX - 1) /* the largest frame number; 20 a second for 6 years */

/* What the files do not say. */
struct frames_in_reading {
    enum cap_pixfmt fmt; /* what grey files are taken for (cap_pixfmt_fits); NONE = grey */
    enum cap_transfer transfer;
    enum cap_mosaic mosaic; /* of Bayer images at binning 1 */
};

struct frames_in {
    const struct rec_rig *rig; /* borrowed, as the pool */
    pvx_pool *pool;
    const char *dir;
    struct frames_in_reading how;
    const dmn_photometry *light; /* the rig's, borrowed; NULL = pictures as they are */
    size_t n;                    /* frame sets wanted */
    uint32_t *number;            /* [n] ascending */
    char **path;                 /* [n][cameras] NULL = that camera has no such frame */
    cap_take *take;              /* instead of paths: */
    int64_t *row;                /* [n][cameras] place among the take's frames, -1 = none */
    int take_camera[REC_MAX_CAMERAS];
    int nch; /* 1 or 3 */
    atomic_bool stop;

    int32_t binning;
    enum cap_mosaic mosaic;
    size_t at, left;    /* the set that is read, those that are not read yet */
    bool backwards;     /* as a source: from the last set to the first */
    dmn_images *images; /* NULL before frames_in_begin */
    struct cap_loaded loaded[REC_MAX_CAMERAS];
    const struct cap_image *image[REC_MAX_CAMERAS]; /* NULL = missing */
    struct pvx_diag why[REC_MAX_CAMERAS];           /* "" = it is just not there */
};

/* Look what is there from frame `first` to `last`; channels are those of the first image
 * that can be read.  grey: one channel whatever the images have.
 * Errors: PVX_ENOENT (says what was looked for), the first image's. */
PVX_MUST_CHECK pvx_err frames_in_open(struct frames_in *f, const char *dir, uint32_t first,
                                      uint32_t last, bool grey, struct pvx_diag *d);
/* A take's pictures are of the cameras, exposures and gains that the rig's photometry was measured with.
 * PVX_EINVAL: they are not.  Of folders nothing is known. */
PVX_MUST_CHECK pvx_err frames_in_check_light(const struct frames_in *f, struct pvx_diag *d);
/* From now on there are only the sets [first, end) of those that there were. */
void frames_in_only(struct frames_in *f, size_t first, size_t end);
void frames_in_close(struct frames_in *f);

/* Raw pixels per bin side, before loading; may be called again.  Bayer images at binning 1 as `mosaic`. */
PVX_MUST_CHECK pvx_err frames_in_begin(struct frames_in *f, int32_t binning, enum cap_mosaic mosaic,
                                       struct pvx_diag *d);
/* Whether set i lacks no camera. */
bool frames_in_complete(const struct frames_in *f, size_t i);
/* Room for the bins of camera c; owner: caller, free(). */
float *frames_in_room(const struct frames_in *f, size_t c);
/* Set i into out[camera] [bins down][bins across][1 or 4]; the cameras that are in it. */
uint64_t frames_in_load(struct frames_in *f, size_t i, float *const *out);
/* The same into a frame that was reset. */
uint64_t frames_in_load_frame(struct frames_in *f, size_t i, rec_frame *frame);
/* DIR/<camera>.npy, .tif, .tiff or .png, the first that is there; false: none is. */
bool frames_in_background_file(const char *dir, const char *camera, char *path, size_t size);
/* DIR/<camera>.(npy|tif|tiff|png) of every camera, the same way; but .npy of floats are what
 * `calibrate background` wrote, with the rig's photometry in them.  Owner of each out[camera]: caller, free(),
 * after an error too. */
PVX_MUST_CHECK pvx_err frames_in_background(struct frames_in *f, const char *dir, float **out,
                                            struct pvx_diag *d);
/* All sets, until `stop` or Ctrl-C; from the last to the first, what cannot be used is not told again. */
struct dmn_source frames_in_source(struct frames_in *f, bool backwards);

#endif
