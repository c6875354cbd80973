/* test_clockmap.c - a camera's clock is recovered from stamps and arrival times alone. */
#include "../t.h"

#include "base/clock.h"
#include "capture/clockmap.h"

#define S     PVX_NS_PER_S
#define MS    PVX_NS_PER_MS
#define HOST0 1700000000000000000LL

static double exponential(double mean)
{
    return -mean * log(t_uniform(1e-12, 1));
}

/* A camera whose clock reads `dev0` at HOST0 and gains `ppm`; frames at fps for `seconds`, delivered
 * after least + exponential(mean).  Returns the largest |error| after `from` seconds, ns. */
static double worst(struct cap_clockmap *m, int64_t dev0, double ppm, double fps, double seconds,
                    double from, double mean_ns)
{
    double w = 0;
    for (int64_t i = 0; (double)i < seconds * fps; i++) {
        double t = (double)i / fps * 1e9;
        int64_t host = HOST0 + (int64_t)t;
        int64_t dev = dev0 + (int64_t)(t * (1 + ppm * 1e-6));
        int64_t got = cap_clockmap_add(m, dev, host + (int64_t)exponential(mean_ns));
        if (t >= from * 1e9)
            w = fmax(w, fabs((double)(got - host)));
    }
    return w;
}

static void drift_and_skew_are_recovered(void)
{
    static const double fps[] = {30, 60, 100};
    for (int k = 0; k < 3; k++)
        for (int sign = -1; sign <= 1; sign++) {
            struct cap_clockmap m;
            cap_clockmap_init(&m, false);
            double w = worst(&m, HOST0 + 500000, sign * 50, fps[k], 120, 30, 1e6);
            T_LE(w, 100e3);
            T_NEAR(m.drift * 1e6, -sign * 50, 5);
            T_EQ_I(m.jumps, 0);
        }
}

static void any_epoch_will_do(void)
{
    struct cap_clockmap m;
    cap_clockmap_init(&m, false);
    T_LE(worst(&m, 12345, 20, 30, 60, 30, 1e6), 100e3); /* counts from its power-up */
    cap_clockmap_init(&m, false);
    T_LE(worst(&m, 4000000000000000000LL, -20, 30, 60, 30, 1e6), 100e3);
}

/* From the start the error is that of the delay, never more than the worst delay so far. */
static void usable_from_the_first_frame(void)
{
    struct cap_clockmap m;
    cap_clockmap_init(&m, false);
    T_EQ_I(cap_clockmap_add(&m, 1000, HOST0), HOST0);
    T_EQ_I(cap_clockmap_add(&m, 1000 + 33 * MS, HOST0 + 33 * MS + 20 * MS), HOST0 + 33 * MS);
    /* a quicker one moves the whole line */
    T_EQ_I(cap_clockmap_add(&m, 1000 + 66 * MS, HOST0 + 66 * MS - 5 * MS), HOST0 + 61 * MS);
    T_EQ_I(cap_clockmap_add(&m, 1000 + 99 * MS, HOST0 + 99 * MS), HOST0 + 94 * MS);
}

static void drift_is_clamped(void)
{
    struct cap_clockmap m;
    cap_clockmap_init(&m, false);
    (void)worst(&m, 1000, -3000, 30, 20, 0, 1e5);
    T_LE(m.drift, 500e-6 + 1e-12);
    T_OK(m.drift > 400e-6);
}

static void late_frames_do_not_pull_the_line(void)
{
    struct cap_clockmap m;
    cap_clockmap_init(&m, false);
    double w = 0;
    for (int i = 0; i < 60 * 30; i++) {
        int64_t t = i * (S / 30);
        int64_t delay = i % 10 == 3 ? 120 * MS : 200000; /* resend, retention */
        int64_t got = cap_clockmap_add(&m, 777 + t, HOST0 + t + delay);
        w = fmax(w, fabs((double)(got - (HOST0 + t + 200000))));
    }
    T_LE(w, 1000);
    T_EQ_I(m.jumps, 0);
}

static void jumps_restart_the_map(void)
{
    struct cap_clockmap m;
    cap_clockmap_init(&m, false);
    (void)worst(&m, 50 * S, 50, 30, 20, 0, 1e6);
    T_EQ_I(m.jumps, 0);
    /* reboot: the clock begins again */
    int64_t h = HOST0 + 25 * S;
    T_EQ_I(cap_clockmap_add(&m, 1 * S, h), h);
    T_EQ_I(m.jumps, 1);
    T_EQ_I(cap_clockmap_add(&m, 1 * S + 10 * MS, h + 12 * MS), h + 10 * MS);
    T_EQ_I(m.jumps, 1);
    /* the epoch is set while it runs */
    T_EQ_I(cap_clockmap_add(&m, HOST0, h + 20 * MS), h + 20 * MS);
    T_EQ_I(m.jumps, 2);
    T_EQ_I(cap_clockmap_add(&m, HOST0 + 10 * MS, h + 33 * MS), h + 30 * MS);
    T_EQ_I(m.jumps, 2);
}

static void shared_clock_is_identity(void)
{
    struct cap_clockmap m;
    cap_clockmap_init(&m, true);
    for (int i = 0; i < 100; i++)
        T_EQ_I(cap_clockmap_add(&m, HOST0 + i * MS, HOST0 + i * MS + (int64_t)(t_rand() % MS)),
               HOST0 + i * MS);
    T_EQ_I(m.jumps, 0);
    T_OK(m.drift == 0);
    T_EQ_I(cap_clockmap_add(&m, HOST0, HOST0 + S), HOST0);
    T_EQ_I(m.jumps, 1);
}

static void no_device_clock_means_arrival(void)
{
    struct cap_clockmap m;
    cap_clockmap_init(&m, false);
    T_EQ_I(cap_clockmap_add(&m, 0, 4711), 4711);
    cap_clockmap_init(&m, true);
    T_EQ_I(cap_clockmap_add(&m, 0, 4711), 4711);
}

int main(void)
{
    T_RUN(drift_and_skew_are_recovered);
    T_RUN(any_epoch_will_do);
    T_RUN(usable_from_the_first_frame);
    T_RUN(drift_is_clamped);
    T_RUN(late_frames_do_not_pull_the_line);
    T_RUN(jumps_restart_the_map);
    T_RUN(shared_clock_is_identity);
    T_RUN(no_device_clock_means_arrival);
    return t_done();
}
