/* envelope.h - the straight line under points that lie on or above the truth, on line.
 *
 *     y = offset + drift x,  as high as it can be with no point below it                 (1)
 * x: a camera's time since an origin [ns]; y: arrival minus camera's time [ns], which is the clocks' offset plus a
 * delay with a minimum.  The smallest y of each bucket of 1 s counts.  The line is the edge of the lower convex hull
 * of the last 64 buckets over their mean time (Moon, Skelly, Towsley, INFOCOM 1999, section 3).
 * Drift is clamped to +-500 ppm, and to +-150 ppm until CAP_ENVELOPE_KNOWN buckets are full.  Until three are full,
 * it is the drift from before the last start.  Three full buckets in a row 5 ms above the line start the envelope
 * again.
 * Reasons: SYNC.md section 10.   Used by: clockmap.h.
 * Threads: one.  Allocates nothing; O(1) a point, a fit over 64 buckets once a second. */
#ifndef CAP_ENVELOPE_H
#define CAP_ENVELOPE_H
#include <stdbool.h>
#include <stdint.h>

#define CAP_ENVELOPE_BUCKETS 64
#define CAP_ENVELOPE_LINE    3  /* full buckets from which on there is a line */
#define CAP_ENVELOPE_KNOWN   16 /* and from which on its drift is known well */
#define CAP_DRIFT_MAX        500e-6

/* All zero, then begin(). */
struct cap_envelope {
    double drift, offset_ns; /* of (1) */
    double excess_ns;        /* mean height of the buckets above the line: its uncertainty */
    struct cap_envelope_bucket {
        int64_t x;
        double y;
    } current, bucket[CAP_ENVELOPE_BUCKETS];
    int n, head;   /* full buckets, place of the next */
    int above;     /* full buckets in a row that lie far above the line */
    int64_t until; /* x at which the current bucket is full */
};

/* Begin again at this point, with the present drift.  y infinite: no point yet; the line goes through 0. */
void cap_envelope_begin(struct cap_envelope *e, int64_t x, double y);
double cap_envelope_at(const struct cap_envelope *e, int64_t x);
/* Add points in order of time x.  True: the line may have moved.  *above_ns: if the envelope began again because
 * three buckets lay above the line, how far above it they were; else 0. */
bool cap_envelope_add(struct cap_envelope *e, int64_t x, double y, double *above_ns);

#endif
