/* clockfit.h - the straight line through readings of a clock, each with a bound.
 *
 *     y = diff + drift (x - at),  least squares weighted with 1 / bound^2 about the weighted mean  (1)
 * x: the camera's time since an origin [ns]; y: host's minus camera's time [ns]; bound: half the round trip of the
 * question.  The last 16 readings count.  A reading farther from the line than all bounds and 100 us allow starts the
 * fit again.  Standard errors of diff and drift are those of (1) with the bounds as sigma.
 * Reasons: SYNC.md section 10.   Used by: clockmap.h.
 * Threads: one.  Allocates nothing; O(16) a reading. */
#ifndef CAP_CLOCKFIT_H
#define CAP_CLOCKFIT_H
#include <stdbool.h>
#include <stdint.h>

#define CAP_CLOCKFIT_READINGS 16

/* All zero is empty. */
struct cap_clockfit {
    struct cap_clockfit_reading {
        int64_t x;
        double y, bound_ns;
    } reading[CAP_CLOCKFIT_READINGS];
    int n, head;
    bool good;      /* three readings or more, and they give the drift to 50 ppm */
    int64_t newest; /* x */
    double at, diff_ns, bound_ns, drift, drift_bound;
};

void cap_clockfit_forget(struct cap_clockfit *f);
void cap_clockfit_add(struct cap_clockfit *f, int64_t x, double y, double bound_ns);
double cap_clockfit_at(const struct cap_clockfit *f, int64_t x);
/* Whether the fit is good, and its newest reading less than 10 s old at x. */
bool cap_clockfit_holds(const struct cap_clockfit *f, int64_t x);

#endif
