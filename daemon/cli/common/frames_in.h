/* frames_in.h - the offline source of the pipeline: recorded frames, from a folder or from a take of raw frames
 * (FILE.h5).  The folder has, for each camera, one of
 *
 *   DIR/<camera>/            numbered pictures, TIFF files of several pages, or one film (reel.h)
 *   DIR/<camera>.(mp4|avi|mkv|mov|cine|mraw)   DIR/<camera>.(tif|tiff)
 *
 * or a list names them: CAMERA=PATH,CAMERA=PATH,...  (what reel.h takes)
 *
 * Pictures of one number form a set, frames of films those of one instant (pairs.h).  Frames of a take have the numbers
 * of their sets.
 * With how.means a set is the mean of several (means.h).  Its time is that of the earliest.
 * A frame that a camera lacks is missing from its set.  A frame that cannot be used is reported on stderr
 * and is missing too.  So are a camera without frames, and what pairs.h finds.
 * Ownership: the struct is the caller's.  It must stay in its place while it is a source.  Threads: one. */
#ifndef FRAMES_IN_H
#define FRAMES_IN_H
#include <stdatomic.h>
#include "capture/files/pairs.h"
#include "capture/take/take.h"
#include "daemon/cli/common/arg.h"
#include "daemon/cli/common/cli.h"
#include "daemon/cli/common/means.h"
#include "daemon/pipeline/images.h"
#include "daemon/pipeline/pipeline.h"

#define FRAMES_IN_LAST (INT64_MAX - 1023) /* no limit; a double can hold it */

/* Grey pictures beside pictures with colour. */
enum frames_in_kinds {
    FRAMES_IN_GREY, /* one channel, the mean of three where there is colour */
    FRAMES_IN_SAME, /* all grey, one channel, or all with colour; others are refused */
    FRAMES_IN_EACH  /* each camera is used by itself: three channels if any has colour */
};

/* How to read the files, where they do not say it themselves. */
struct frames_in_reading {
    enum cap_pixfmt fmt; /* format as which grey files are read (cap_pixfmt_fits); NONE = grey */
    enum cap_transfer transfer;
    enum cap_mosaic mosaic; /* of Bayer images at binning 1 */
    int32_t numbers;        /* enum cap_numbers: what the numbers of pictures are */
    struct means_how means; /* sets to average before they are solved */
};

/* Rows (arg.h) for the options of all commands that read recorded frames.  T is the command's struct, with the fields
 * first, last, reading and quiet.  FRAMES_IN_PHOTO_ROWS: how silhouettes are found, into its frame.photo. */
/* clang-format off */
#define FRAMES_IN_ROWS(T)                                                                          \
    {"first", "N", CLI_AT(T, first), 0, FRAMES_IN_LAST, "first frame number"},                     \
    {"last", "N", CLI_AT(T, last), 0, FRAMES_IN_LAST, "last frame number"},                        \
    {"pixel-format", "NAME", offsetof(T, reading.fmt), CLI_PIXFMT, 0, 0,                            \
     "read images as this format: BayerRG8 for raw pictures of a colour camera, Mono12 for "  \
     "12 bits in 16, RGB12 for 12 bits in 16 with colour ..."},                                    \
    {"transfer", "auto|linear|srgb|bt709", CLI_AT(T, reading.transfer), 0, 0,                      \
     "how sample values represent light (auto: srgb for JPEG files, linear for all others)"},      \
    {"numbers", CAP_NUMBERS, CLI_AT(T, reading.numbers), 0, 0,                                     \
     "what the numbers of pictures are: count (default: one number, one set), or times of the "    \
     "cameras' common clock in ms, us or ns, which are paired to half a frame period"},            \
    {"quiet", NULL, CLI_AT(T, quiet), 0, 0, "no progress"}
#define FRAMES_IN_PHOTO_ROWS(T)                                                                    \
    {"threshold", "X|auto", CLI_AT(T, frame.photo.threshold), 0, 1e6,                              \
     "a bin is flame from X of full scale on (auto, the default: from the noise)"},                \
    {"black", "X", CLI_AT(T, frame.photo.black), 0, 1e6,                                           \
     "black level, share of full scale (default 0), of floats in their own unit"},                 \
    {"margin", "N", CLI_AT(T, frame.photo.margin), 0, 64,                                          \
     "grow silhouettes by N bins (default 0). Use the calibration error in bins: a smaller "       \
     "margin cuts the rim of the flame off, a larger one takes time and lets light leak outwards"}
/* clang-format on */

struct frames_in {
    const struct rec_rig *rig; /* borrowed, as the pool */
    pvx_pool *pool;
    const char *dir;
    struct frames_in_reading how;
    const dmn_photometry *light; /* the rig's, borrowed; NULL = pictures as they are */
    double black;                /* only to check that the pictures can have it */
    size_t n;                    /* frame sets wanted */
    int64_t *number;             /* [n] ascending */
    int64_t *t_ns;               /* [n] of films and of numbers that are times; otherwise NULL */
    int64_t *row;                /* [n][cameras] place among the camera's frames, -1 = none */
    /* The sets above are means of these, or means.n is 0. */
    struct means means;
    size_t members;                      /* sets of the recording */
    int64_t *member_row, *member_number; /* as row and number, of each of them */
    double *sum[REC_MAX_CAMERAS]; /* of a mean's bins and their squares, and which are saturated */
    double *square[REC_MAX_CAMERAS];
    uint8_t *full[REC_MAX_CAMERAS];
    struct cap_reel *reel; /* [cameras] */
    cap_take *take;        /* instead */
    int take_camera[REC_MAX_CAMERAS];
    enum frames_in_kinds kinds;
    struct cap_depth
        depth[REC_MAX_CAMERAS]; /* of the samples in words of 16 bits, as far as looked at */
    uint64_t grey;              /* cameras with grey pictures where others have colour; else 0 */
    int nch;                    /* 1 or 3 */
    atomic_bool stop;

    int32_t binning;
    enum cap_mosaic mosaic;
    size_t left;              /* sets that are not read yet */
    int64_t bin_ns;           /* time to bin the set that was read last */
    struct cli_progress *bar; /* of sets averaged, borrowed; or NULL */
    dmn_images *images;       /* NULL before frames_in_begin */
    struct cap_loaded loaded[REC_MAX_CAMERAS];
    const struct cap_image *image[REC_MAX_CAMERAS]; /* NULL = missing */
    struct pvx_diag why[REC_MAX_CAMERAS];           /* "" = there is no such frame */
    struct frames_in_seen *seen;                    /* [cameras], while they are looked at */
};

/* Find the frames from number `first` to `last`.  The number of channels follows from `kinds` and from pictures of
 * each camera.
 * Errors: PVX_ENOENT (names the files that it looked for), those of the first image, PVX_EINVAL (pictures of two
 * kinds; a black level above full scale). */
PVX_MUST_CHECK pvx_err frames_in_open(struct frames_in *f, const char *dir, int64_t first,
                                      int64_t last, enum frames_in_kinds kinds, struct pvx_diag *d);
/* Check that a take has the cameras, exposures and gains that the rig's photometry was measured with.
 * PVX_EINVAL: it has others.  Of a folder only recordings of high-speed cameras contain an exposure; all else passes. */
PVX_MUST_CHECK pvx_err frames_in_check_light(const struct frames_in *f, struct pvx_diag *d);
/* Keep only the sets [first, end). */
void frames_in_only(struct frames_in *f, size_t first, size_t end);
void frames_in_close(struct frames_in *f);

/* Set the raw pixels per bin side, before loading.  May be called again.  mosaic: for Bayer images at binning 1. */
PVX_MUST_CHECK pvx_err frames_in_begin(struct frames_in *f, int32_t binning, enum cap_mosaic mosaic,
                                       struct pvx_diag *d);
/* Whether set i has all cameras. */
bool frames_in_complete(const struct frames_in *f, size_t i);
/* Room for the bins of camera c; owner: caller, free(). */
float *frames_in_room(const struct frames_in *f, size_t c);
/* Load set i into out[camera] [bins down][bins across][1 or 4].  Returns a mask of the cameras that are in it. */
uint64_t frames_in_load(struct frames_in *f, size_t i, float *const *out);
/* The same, into a frame that was reset. */
uint64_t frames_in_load_frame(struct frames_in *f, size_t i, rec_frame *frame);
/* Find DIR/<camera>.(npy|png|tif|tiff|jpg|jpeg).  PVX_ENOENT: there is none.  PVX_EINVAL: there are two. */
PVX_MUST_CHECK pvx_err frames_in_background_file(const char *dir, const char *camera, char *path,
                                                 size_t size, struct pvx_diag *d);
/* Load that file of every camera.  A .npy of floats was written by
 * `calibrate background`: the rig's photometry is in it already.  Owner of each out[camera]: caller, free(),
 * after an error too. */
PVX_MUST_CHECK pvx_err frames_in_background(struct frames_in *f, const char *dir, float **out,
                                            struct pvx_diag *d);
/* A source of all sets.  It ends early at `stop` or Ctrl-C. */
struct dmn_source frames_in_source(struct frames_in *f);

#endif
