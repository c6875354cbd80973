/* pairs.h - which frames of several cameras belong together.
 *
 * Pictures and pages go together if they have one number.  Frames with times (films, and pictures whose numbers are
 * times) go together if they are of one instant.  The instants are those of the camera with the highest rate.  Where it
 * lacks a frame, its rate goes on.  A frame belongs to the nearest instant, so it is at most half a frame period away.
 * Threads: pure. */
#ifndef CAP_PAIRS_H
#define CAP_PAIRS_H
#include "capture/files/reel.h"

/* What the numbers of pictures are: counts, or times in these units. */
enum cap_numbers { CAP_NUMBERS_COUNT, CAP_NUMBERS_MS, CAP_NUMBERS_US, CAP_NUMBERS_NS };
#define CAP_NUMBERS "count|ms|us|ns"

struct cap_pairs {
    size_t n;        /* frame sets */
    int64_t *number; /* [n] ascending: the frames' number; of instants their place, from 0 */
    int64_t *t_ns;   /* [n] the instants; NULL: there are only numbers */
    int64_t *row;    /* [n][cameras] place in the camera's reel, -1: it has none */
    char *said;      /* what is not as it should be, a sentence on each line; "" */
};

/* A camera without a reel has n = 0.  apart: cameras need not have frames in common.  Owner: caller, cap_pairs_free, after an error too.  Errors: PVX_EINVAL: a camera
 * has no frame in common with another, films beside pictures; PVX_ERANGE: a time is too large; PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err cap_pairs_find(const struct cap_reel *reel, const char *const *camera,
                                      size_t cameras, enum cap_numbers numbers, bool apart,
                                      struct cap_pairs *out, struct pvx_diag *d);
void cap_pairs_free(struct cap_pairs *p);
#endif
