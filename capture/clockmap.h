/* clockmap.h - one camera's clock mapped to the host's, on line.
 *
 *     host = offset + (1 + drift) * device                                              (1)
 * Arrival = host time of exposure + a delay that is never below some minimum; so the line (1) is
 * fitted to the lower envelope of (arrival - device): the smallest difference in each bucket of
 * 1 s, a least-squares line through the last 64 full buckets, drift clamped to +-500 ppm; before
 * three buckets are full the smallest difference alone is used (drift 0).  The constant minimum of
 * the delay cannot be seen from one side and stays in the offset: it is common to equal cameras.
 * A jump of the device clock (more than 0.5 s off the line, or backwards) restarts the map and is
 * counted.
 * `shared`: the device clock already is the host's (PTP, simulation, recorded frames): identity,
 * no fit; backwards steps are still counted as jumps.
 * Threads: one camera's map belongs to one thread.  Allocates nothing; cost O(1) per frame, a
 * refit over 64 buckets once a second. */
#ifndef CAP_CLOCKMAP_H
#define CAP_CLOCKMAP_H
#include <stdbool.h>
#include <stdint.h>

#define CAP_CLOCK_BUCKETS 64
struct cap_clockmap {
    bool shared; /* device clock is the host's: identity */
    bool valid;
    int64_t dev0, host0; /* reference point */
    double drift;        /* host seconds per device second - 1 */
    double offset_ns;    /* at dev0, relative to host0 - dev0 */
    int64_t last_dev;
    uint64_t jumps;
    int64_t bucket_end; /* device time at which the current bucket is full */
    struct cap_clock_bucket {
        int64_t dev;
        double diff_ns;
    } current, bucket[CAP_CLOCK_BUCKETS];
    int n, head; /* full buckets, place of the next */
};
void cap_clockmap_init(struct cap_clockmap *m, bool shared);
/* Feed one frame; returns exposure time on the host clock, ns.  device_ns = 0: arrival is used. */
int64_t cap_clockmap_add(struct cap_clockmap *m, int64_t device_ns, int64_t arrival_ns);
#endif
