/* reel.h - read the pictures of one camera in order, from a video or a take, and choose which are worth looking at.
 *
 * A board that is carried about is sharp only while it stands still.  Only then do cameras that are apart by a part
 * of a frame see it in the same place.  A view that exists already adds nothing.  So of every N instants only the one
 * with the least motion is looked at.  The motion of an instant is a sum over the cameras.  Each camera adds the
 * difference of its picture from the one before or after, the larger of the two, over the average difference of its
 * pictures. */
#ifndef CALIBRATE_REEL_H
#define CALIBRATE_REEL_H
#include "capture/files/imgio.h"
#include "capture/pixel/jpeg.h"
#include "daemon/cli/calibrate/look.h"

#define CALIBRATE_LOOKED_AT 200 /* instants, by default */

struct calibrate_reel {
    struct calibrate_look *l; /* borrowed; its reel of this camera is used */
    size_t camera;
    struct cap_loaded loaded; /* of the reel */
    void *mem;                /* of the take */
    size_t size;
    cap_jpeg *jpeg;
};
/* Errors: the file's. */
PVX_MUST_CHECK pvx_err calibrate_reel_open(struct calibrate_reel *r, struct calibrate_look *l,
                                           size_t camera, struct pvx_diag *d);
/* Read the picture of this number.  A video is fast only forwards.  The picture is borrowed until the next call
 * and never JPEG.  Errors: PVX_ENOENT: there is none; those of reading. */
PVX_MUST_CHECK pvx_err calibrate_reel_read(struct calibrate_reel *r, uint32_t number,
                                           struct cap_image *img, struct pvx_diag *d);
void calibrate_reel_close(struct calibrate_reel *r);

/* How much each of n instants of one camera differs from the one before: >= 0.  NAN: there is nothing to compare
 * with.  CALIBRATE_LACKS: the camera has no picture. */
#define CALIBRATE_LACKS (-1.0f)
struct calibrate_motion {
    size_t n;
    float *of;
};
/* Of each `every` successive instants choose the one with the least motion over all cameras.  An instant that a
 * camera lacks counts as four times that camera's average.  at: the chosen, ascending, room for n / every + 1.
 * Returns how many. */
size_t calibrate_choose(const struct calibrate_motion *m, size_t cameras, size_t every, size_t *at);

/* Read all reels and list in l the pictures to look at.  The result does not depend on the number of threads.
 * Errors: PVX_ECANCELED (Ctrl-C); the files'. */
PVX_MUST_CHECK pvx_err calibrate_survey(struct calibrate_look *l, pvx_pool *pool, bool quiet,
                                        struct pvx_diag *d);
#endif
