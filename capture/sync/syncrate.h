/* syncrate.h - a camera's frame rate from its stamps, and its uncertainty (private to syncwatch.c).
 *
 * Picture i of a camera, counted by rounded intervals so that lost pictures leave a gap, has the stamp
 *     t_i = t_0 + i (period + off) + noise                                               (1)
 * Sums over blocks of max(0.1 s, 3 periods), 128 of them; `off` and its standard error by least squares
 * over the last m blocks (Draper, Smith, Applied Regression Analysis, 1.4).  Two cameras differ over m blocks when
 *     |d| > 400 ppm  and  |d| - 200 ppm > q se(d),  d = difference of their periods      (2)
 * and d has its sign and at least half its size in either half of the blocks: a step is not a rate.  200 ppm is the
 * largest difference of two good crystals.  q is Student's quantile at 1e-10 (there are many tests), from the normal
 * one by Wallace's approximation (Ann. Math. Stat. 30, 1959).  m = 4, 5, 6, 8, ... blocks: large differences
 * and good stamps are found early, the rest later.
 * Stamps are the device's own, before any map, so an unfinished map does not matter.
 * Threads: the caller's.  Allocates nothing; cost O(1) per frame, O(cameras x blocks) per block. */
#ifndef CAP_SYNCRATE_H
#define CAP_SYNCRATE_H
#include <stdbool.h>
#include <stdint.h>

#define CAP_RATE_BLOCKS 128
#define CAP_RATE_FEWEST 4 /* fewest blocks that give a rate */

/* All zero is empty. */
struct cap_rate {
    int64_t t_ns, count; /* last stamp; periods since the first */
    int64_t off_ns;      /* t - t_first - count period */
    struct cap_rate_block {
        int64_t t0_ns, count0, off0_ns; /* of its first picture */
        double n, x, y, xx, xy, yy;     /* sums, relative to the first picture */
    } block[CAP_RATE_BLOCKS];
    unsigned n, head; /* full blocks; the one being filled */
};

void cap_rate_forget(struct cap_rate *r);
/* Add the next stamp, `periods` after the last one (ignored for the first).  True = a block is full. */
bool cap_rate_add(struct cap_rate *r, int64_t t_ns, int64_t periods, int64_t period_ns);
/* Relative difference of the periods of a and b over their last m blocks; > 0: a is slower.  0 if (2) does not
 * hold, or if there are fewer blocks. */
double cap_rate_unlike(const struct cap_rate *a, const struct cap_rate *b, unsigned m,
                       int64_t period_ns);
/* Of the last m <= n blocks: time on the camera's clock, pictures per second. */
int64_t cap_rate_span_ns(const struct cap_rate *r, unsigned m);
double cap_rate_hz(const struct cap_rate *r, unsigned m, int64_t period_ns);
/* Student's quantile at 1e-10, both sides: a difference of this many standard errors is not chance. */
double cap_rate_quantile(double dof);

#endif
