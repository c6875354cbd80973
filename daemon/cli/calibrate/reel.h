/* reel.h - the pictures of one camera one after the other, of a video or a take, and which of them are worth
 * looking at.
 *
 * A board that is carried about is sharp, and in the same place for cameras that differ by a part of a frame, only while
 * it stands still; and a view that is there already adds nothing.  So of every N instants that one is looked at in
 * which the least moves: the sum over cameras of how much the picture differs from the one before and the one after
 * (the larger of the two), in units of what that camera's pictures differ on average. */
#ifndef CALIBRATE_REEL_H
#define CALIBRATE_REEL_H
#include "capture/files/imgio.h"
#include "capture/pixel/jpeg.h"
#include "daemon/cli/calibrate/look.h"

#define CALIBRATE_LOOKED_AT 200 /* instants, by default */

struct calibrate_reel {
    const struct calibrate_look *l; /* borrowed */
    size_t camera;
    cap_video *video;
    uint32_t next; /* of the video */
    double fps;
    void *mem; /* of the take */
    size_t size;
    cap_jpeg *jpeg;
};
/* Errors: the file's. */
PVX_MUST_CHECK pvx_err calibrate_reel_open(struct calibrate_reel *r, const struct calibrate_look *l,
                                           size_t camera, struct pvx_diag *d);
/* The picture of this number, of a video not below that of the last call; borrowed until the next call, never JPEG.
 * Errors: PVX_ECLOSED: the video ends before it; PVX_ENOENT: the take's set lacks it; what is wrong with it. */
PVX_MUST_CHECK pvx_err calibrate_reel_read(struct calibrate_reel *r, uint32_t number,
                                           struct cap_image *img, struct pvx_diag *d);
void calibrate_reel_close(struct calibrate_reel *r);

/* How much each of n instants differs from the one before, for one camera: >= 0; NAN: there is nothing to compare with;
 * CALIBRATE_LACKS: it has no picture. */
#define CALIBRATE_LACKS (-1.0f)
struct calibrate_motion {
    size_t n;
    float *of;
};
/* Of every `every` instants the one in which the least moves over all cameras, ascending; an instant that a camera lacks
 * counts as if it moved four times as much as usual there.  at: room for n / every + 1.  Returns how many. */
size_t calibrate_choose(const struct calibrate_motion *m, size_t cameras, size_t every, size_t *at);

/* All reels gone through, the pictures to be looked at listed in l.  Independent of the number of threads.
 * Errors: PVX_ECANCELED (Ctrl-C); PVX_EINVAL: videos of different rates; the files'. */
PVX_MUST_CHECK pvx_err calibrate_survey(struct calibrate_look *l, pvx_pool *pool, bool quiet,
                                        struct pvx_diag *d);
#endif
