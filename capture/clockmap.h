/* clockmap.h - one camera's clock mapped to the host's, on line.
 *
 *     host = offset + (1 + drift) * device                                              (1)
 * Arrival = host time of exposure + a delay that is never below some minimum; so the line (1) is
 * fitted to the lower envelope of (arrival - device): the smallest difference in each bucket of
 * about 1 s, a least-squares line through the last 64 buckets, drift clamped to +-500 ppm.  A jump
 * of the device clock (more than 0.5 s off the line, or backwards) restarts the map and is counted.
 * With a device clock that already is host time (difference within 1 s at start, as PTP or the
 * simulated cameras give) `shared` skips the fit and uses the identity.
 * Threads: one camera's map belongs to one thread. */
#ifndef CAP_CLOCKMAP_H
#define CAP_CLOCKMAP_H
#include <stdbool.h>
#include <stdint.h>

#define CAP_CLOCK_BUCKETS 64
struct cap_clockmap {
    bool shared;      /* device clock is the host's: identity */
    bool valid;
    int64_t dev0, host0;                 /* reference point */
    double drift;                        /* host seconds per device second - 1 */
    double offset_ns;                    /* at dev0, relative to host0 - dev0 */
    int64_t last_dev;
    uint64_t jumps;
    int n, head;
    struct { int64_t dev; double diff_ns; } bucket[CAP_CLOCK_BUCKETS];
};
void cap_clockmap_init(struct cap_clockmap *m, bool shared);
/* Feed one frame; returns exposure time on the host clock, ns.  device_ns = 0: arrival is used. */
int64_t cap_clockmap_add(struct cap_clockmap *m, int64_t device_ns, int64_t arrival_ns);
#endif
