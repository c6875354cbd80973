/* clockmap.h - one camera's clock mapped to the host's, on line.
 *
 *     host = offset + (1 + drift) * device                                              (1)
 * `host` is any clock of the host that is never stepped: capture.c uses CLOCK_MONOTONIC, so that
 * setting the time of day does not tear the map.
 * Arrival = host time of exposure + a delay that is never below some minimum; so the line (1) is
 * fitted to the lower envelope of (arrival - device): of the smallest difference in each bucket of
 * 1 s, the last 64 full buckets, the lower side of the convex hull; the line is its edge over the mean
 * time.  It lies under all of them and as close as a line can (Moon, Skelly, Towsley, INFOCOM 1999,
 * section 3), so frames that come late do not pull it.  Drift is clamped to +-500 ppm, to +-150 ppm
 * before 16 buckets are full (a crystal's is below 100; a few seconds of a busy network look like more).
 * Before three are full it is that of the camera's last life, or 0: then the error grows with the drift,
 * 100 us per second at 100 ppm.  A difference below the line lowers the line at once.
 * The constant minimum of the delay cannot be seen from one side and stays in the offset: it is
 * common to equal cameras.
 * Readings of the camera's clock with a bound (cap_clockmap_measure) see both sides.  Three or more that
 * give the drift to 50 ppm are the line, by least squares weighted with 1 / bound^2, while the newest
 * is not older than 10 s: frames that a busy host takes late do not move it.  Fewer take the
 * delay out of the envelope.  A reading that does not fit the others begins anew.
 * Jumps: a clock that runs backwards, or a difference more than 5 ms below the line, or 5 ms above it
 * throughout three buckets, starts the envelope anew with the old drift.  Those of 0.1 s and more, and
 * all backwards, are counted as jumps of the camera's clock; smaller ones may as well be the network's
 * delay, which changed.  After a start or a jump the first frames should only be fed, not used: one
 * that was held up would be taken for the least delay (capture.c: eight, or a quarter of a second).
 * `shared`: the device clock already is the host's (PTP, simulation, recorded frames): identity,
 * no fit; backwards steps are still counted as jumps.
 * Error, measured by test_clockmap (30 Hz, 5 % lost, 100 ppm, delay 0.2 ms + up to 1 ms at random): at
 * most 1 ms in the first second, 0.3 ms until the tenth, 0.1 ms until the sixtieth, then 0.02 ms.
 * Threads: one camera's map belongs to one thread.  Allocates nothing; cost O(1) per frame, a
 * refit over 64 buckets once a second. */
#ifndef CAP_CLOCKMAP_H
#define CAP_CLOCKMAP_H
#include <stdbool.h>
#include <stdint.h>

#define CAP_CLOCK_BUCKETS  64
#define CAP_CLOCK_KNOWN    16 /* full buckets from which on the drift is known well */
#define CAP_CLOCK_READINGS 16
struct cap_clockmap {
    bool shared; /* device clock is the host's: identity */
    bool valid;
    int64_t dev0, host0; /* reference point */
    double drift;        /* host seconds per device second - 1 */
    double offset_ns;    /* at dev0, relative to host0 - dev0: of the envelope */
    double delay_ns; /* constant part of the delay that readings have taken out; 0 = not known */
    double delay_bound_ns;
    int64_t last_dev;
    uint64_t jumps;
    int64_t bucket_end; /* device time at which the current bucket is full */
    struct cap_clock_bucket {
        int64_t dev;
        double diff_ns;
    } current, bucket[CAP_CLOCK_BUCKETS];
    int n, head;      /* full buckets, place of the next */
    int above;        /* full buckets in a row that lie far above the line */
    double excess_ns; /* mean of the buckets above the envelope: how firmly it lies */
    struct cap_clock_reading {
        int64_t dev;
        double diff_ns, bound_ns;
    } reading[CAP_CLOCK_READINGS];
    int n_readings, reading_head;
    struct { /* line through the readings */
        bool good;
        int64_t newest;
        double at, diff_ns, drift, drift_bound, bound_ns; /* at: device time - dev0 */
    } read;
};
void cap_clockmap_init(struct cap_clockmap *m, bool shared);
/* Feed one frame; returns exposure time on the host clock, ns.  device_ns = 0: arrival is used. */
int64_t cap_clockmap_add(struct cap_clockmap *m, int64_t device_ns, int64_t arrival_ns);
/* Drift in use, host seconds per device second - 1. */
double cap_clockmap_drift(const struct cap_clockmap *m);
/* What mapped times may wander by within some seconds, ns; infinite while the drift is not known well. */
double cap_clockmap_doubt(const struct cap_clockmap *m);
/* The camera's clock showed device_ns when the host's was host_ns +- bound_ns (half the round trip of
 * the question).  The last 16 readings count.  Bounds above 10 ms are ignored. */
void cap_clockmap_measure(struct cap_clockmap *m, int64_t device_ns, int64_t host_ns,
                          int64_t bound_ns);

#endif
