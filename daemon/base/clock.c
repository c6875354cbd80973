#include "base/clock.h"

#include <errno.h>
#include <time.h>

static int64_t clock_now(clockid_t id)
{
    struct timespec ts;
    clock_gettime(id, &ts);
    return (int64_t)ts.tv_sec * PVX_NS_PER_S + ts.tv_nsec;
}

int64_t pvx_now_mono(void)
{
    return clock_now(CLOCK_MONOTONIC);
}

int64_t pvx_now_real(void)
{
    return clock_now(CLOCK_REALTIME);
}

void pvx_now_both(int64_t *real_ns, int64_t *mono_ns)
{
    int64_t best = INT64_MAX;
    for (int i = 0; i < 4 && best > 2000; i++) {
        int64_t before = pvx_now_mono(), real = pvx_now_real(), after = pvx_now_mono();
        if (after - before < best) {
            best = after - before;
            *real_ns = real;
            *mono_ns = before + best / 2;
        }
    }
}

void pvx_sleep_until_mono(int64_t mono_ns)
{
    if (mono_ns <= 0)
        return;
    struct timespec ts = {.tv_sec = mono_ns / PVX_NS_PER_S, .tv_nsec = mono_ns % PVX_NS_PER_S};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &ts, NULL) == EINTR)
        ;
}

void pvx_cond_init(pthread_cond_t *cond, clockid_t clock)
{
    pthread_condattr_t a;
    pthread_condattr_init(&a);
    pthread_condattr_setclock(&a, clock);
    pthread_cond_init(cond, &a);
    pthread_condattr_destroy(&a);
}
