/* frames_in.h - recorded frame sets, loaded and binned: what `pyrovox reconstruct` reads.
 * Threads: everything but scan may be called for different cameras at the same time. */
#ifndef FRAMES_IN_H
#define FRAMES_IN_H
#include "capture/files/imgio.h"
#include "capture/pixel/pixfmt.h"
#include "capture/take/take.h"
#include "daemon/framedir.h"

/* What the files do not say. */
struct frames_in_reading {
    enum cap_pixfmt fmt; /* what grey files are taken for (cap_pixfmt_fits); NONE = grey */
    enum cap_transfer transfer;
    enum cap_mosaic mosaic; /* set it to RAYS once all that loads images knows of mosaics */
};

struct frames_in {
    const struct rec_rig *rig; /* borrowed */
    struct dmn_framedir dir;
    cap_take *take; /* the frames are in this file, and dir only lists them; NULL = in files */
    int take_camera[REC_MAX_CAMERAS];
    size_t n;        /* frame sets wanted */
    size_t *set;     /* [n] their places in dir, ascending */
    int nch;         /* 1 or 3 */
    bool full_scale; /* integers: a value of 1 is saturation */
    int32_t binning; /* raw pixels per bin side; set by the caller before loading */
    struct frames_in_reading how;
};

/* dir: a folder, or a take of raw frames (FILE.h5), whose frames are numbered by their sets.
 * Look what is there from frame `first` to `last`; channels and full_scale are those of the first
 * image that can be read.  grey: one channel whatever the images have.
 * Errors: PVX_ENOENT (says what was looked for), the first image's. */
PVX_MUST_CHECK pvx_err frames_in_scan(struct frames_in *f, const struct rec_rig *rig,
                                      const char *dir, uint32_t first, uint32_t last, bool grey,
                                      const struct frames_in_reading *how, struct pvx_diag *d);
void frames_in_fini(struct frames_in *f);

static inline uint32_t frames_in_number(const struct frames_in *f, size_t i)
{
    return f->dir.number[f->set[i]];
}
static inline int32_t frames_in_bins(const struct frames_in *f, int32_t pixels)
{
    return pixels / f->binning;
}

enum frames_in_got { FRAMES_MISSING, FRAMES_LOADED, FRAMES_BAD };
/* Frame set i of camera c into out [bins down][bins across][1 or 4].  FRAMES_MISSING: there is no
 * such file; FRAMES_BAD: it cannot be used, *d says why.  *bin_ns += time for the binning alone. */
enum frames_in_got frames_in_load(const struct frames_in *f, size_t i, size_t c, float *out,
                                  int64_t *bin_ns, struct pvx_diag *d);
/* DIR/<camera>.(npy|tif|tiff|png) of camera c, the same way. */
PVX_MUST_CHECK pvx_err frames_in_background(const struct frames_in *f, const char *dir, size_t c,
                                            float *out, struct pvx_diag *d);

#endif
