/* clock.h - the clocks of the product, int64_t nanoseconds each.
 *
 * mono = CLOCK_MONOTONIC: durations, deadlines, latency.  real = CLOCK_REALTIME (UTC): what is
 * written into frames, volumes and files.  Every field that holds a time names its clock. */
#ifndef PVX_CLOCK_H
#define PVX_CLOCK_H
#include <pthread.h>
#include <stdint.h>

#define PVX_NS_PER_S  1000000000LL
#define PVX_NS_PER_MS 1000000LL

int64_t pvx_now_mono(void);
int64_t pvx_now_real(void);
/* Both clocks at one instant (to some us, even if the thread is interrupted in between). */
void pvx_now_both(int64_t *real_ns, int64_t *mono_ns);
/* Sleep until `mono_ns` of the mono clock.  Never returns early; returns at once if that time has passed. */
void pvx_sleep_until_mono(int64_t mono_ns);
/* A condition whose timed waits are by `clock`. */
void pvx_cond_init(pthread_cond_t *cond, clockid_t clock);

#endif
