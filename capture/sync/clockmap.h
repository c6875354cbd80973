/* clockmap.h - one camera's clock mapped to the host's, on line.
 *
 *     host = offset + (1 + drift) * device                                              (1)
 * `host` is any clock of the host that is never stepped.  The rig uses CLOCK_MONOTONIC, so a change of the time of
 * day does not disturb the map.  While the line through the readings (clockfit.h) is valid, it gives offset and
 * drift.  Otherwise they are those of the frames' envelope (envelope.h), less the delay that readings have
 * measured.  Without readings the least delay of the frames stays in the offset, which is common to equal cameras.
 * Jumps: a clock that runs backwards, or a difference of 5 ms or more from the line, starts the map again with the
 * old drift.  It is counted when the clock ran backwards, or jumped by 0.1 s or more.
 * `shared`: the device clock already is the host's (PTP, simulation, recorded frames).  The map is the identity
 * without a fit, and backwards steps are still counted as jumps.
 * Error measured by test_clockmap (30 Hz, 5 % lost, 100 ppm, delay 0.2 ms + up to 1 ms at random), median / worst
 * frame, mean of many runs: 76 / 510 us in the first second, 99 / 180 until the third, 16 / 154 until the tenth,
 * 3 / 26 until the sixtieth, then 1.5 / 13 in ten minutes.
 * Reasons: SYNC.md section 10.
 * Threads: one camera's map belongs to one thread.  Allocates nothing; cost O(1) per frame, a
 * refit over 64 buckets once a second. */
#ifndef CAP_CLOCKMAP_H
#define CAP_CLOCKMAP_H
#include "capture/sync/clockfit.h"
#include "capture/sync/envelope.h"

struct cap_clockmap {
    bool shared; /* device clock is the host's: identity */
    bool valid;
    int64_t dev0, host0; /* reference point: x = device - dev0, y = difference - (host0 - dev0) */
    int64_t last_dev;
    uint64_t jumps;
    struct cap_envelope envelope; /* of the frames */
    struct cap_clockfit read;     /* of the readings */
    double delay_ns; /* constant part of the frames' delay, found by readings; 0 = not known */
};
void cap_clockmap_init(struct cap_clockmap *m, bool shared);
/* Feed one frame; returns exposure time on the host clock, ns.  device_ns = 0: arrival is used. */
int64_t cap_clockmap_add(struct cap_clockmap *m, int64_t device_ns, int64_t arrival_ns);
/* Drift in use, host seconds per device second - 1. */
double cap_clockmap_drift(const struct cap_clockmap *m);
/* How far mapped times may move within some seconds, ns; infinite while the drift is not known well. */
double cap_clockmap_doubt(const struct cap_clockmap *m);
/* A reading: the camera's clock showed device_ns when the host's showed host_ns +- bound_ns (half the round trip
 * of the question).  The last 16 readings count.  Readings with bounds above 10 ms are ignored. */
void cap_clockmap_measure(struct cap_clockmap *m, int64_t device_ns, int64_t host_ns,
                          int64_t bound_ns);

#endif
