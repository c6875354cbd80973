/* test_clockmap.c - a camera's clock is recovered from stamps and arrival times alone. */
#include "../t.h"

#include "base/clock.h"
#include "base/median.h"
#include "capture/sync/clockmap.h"

#define S     PVX_NS_PER_S
#define MS    PVX_NS_PER_MS
#define HOST0 1700000000000000000LL

static struct cap_clockmap fresh(bool shared)
{
    struct cap_clockmap m;
    cap_clockmap_init(&m, shared);
    return m;
}

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

T_CASE(drift_and_skew_are_recovered)
{
    static const double fps[] = {30, 60, 100};
    for (int k = 0; k < 3; k++)
        for (int sign = -1; sign <= 1; sign++) {
            struct cap_clockmap m = fresh(false);
            double w = worst(&m, HOST0 + 500000, sign * 50, fps[k], 120, 30, 1e6);
            T_LE(w, 100e3);
            T_NEAR(m.envelope.drift * 1e6, -sign * 50, 5);
            T_EQ_I(m.jumps, 0);
        }
}

T_CASE(any_epoch_will_do)
{
    struct cap_clockmap m = fresh(false);
    T_LE(worst(&m, 12345, 20, 30, 60, 30, 1e6), 100e3); /* counts from its power-up */
    cap_clockmap_init(&m, false);
    T_LE(worst(&m, 4000000000000000000LL, -20, 30, 60, 30, 1e6), 100e3);
}

/* From the start the error is that of the delay, never more than the worst delay so far. */
T_CASE(usable_from_the_first_frame)
{
    struct cap_clockmap m = fresh(false);
    T_EQ_I(cap_clockmap_add(&m, 1000, HOST0), HOST0);
    T_EQ_I(cap_clockmap_add(&m, 1000 + 33 * MS, HOST0 + 33 * MS + 20 * MS), HOST0 + 33 * MS);
    /* a quicker one moves the whole line */
    T_EQ_I(cap_clockmap_add(&m, 1000 + 66 * MS, HOST0 + 66 * MS - 5 * MS), HOST0 + 61 * MS);
    T_EQ_I(cap_clockmap_add(&m, 1000 + 99 * MS, HOST0 + 99 * MS), HOST0 + 94 * MS);
}

T_CASE(drift_is_clamped)
{
    struct cap_clockmap m = fresh(false);
    (void)worst(&m, 1000, -3000, 30, 20, 0, 1e5);
    T_LE(m.envelope.drift, 500e-6 + 1e-12);
    T_OK(m.envelope.drift > 100e-6);
    cap_clockmap_init(&m, false);
    (void)worst(&m, 1000, -450, 30, 40, 0, 1e5);
    T_NEAR(m.envelope.drift * 1e6, 450, 10);
}

T_CASE(late_frames_do_not_pull_the_line)
{
    struct cap_clockmap m = fresh(false);
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

T_CASE(jumps_restart_the_map)
{
    struct cap_clockmap m = fresh(false);
    (void)worst(&m, 50 * S, 50, 30, 20, 0, 1e6);
    T_EQ_I(m.jumps, 0);
    /* reboot: the clock begins again */
    int64_t h = HOST0 + 25 * S;
    T_EQ_I(cap_clockmap_add(&m, 1 * S, h), h);
    T_EQ_I(m.jumps, 1);
    /* the drift is kept: 0.5 us in 10 ms */
    T_NEAR(cap_clockmap_add(&m, 1 * S + 10 * MS, h + 12 * MS) - (h + 10 * MS), 0, 1000);
    T_EQ_I(m.jumps, 1);
    /* the epoch is set while it runs */
    T_EQ_I(cap_clockmap_add(&m, HOST0, h + 20 * MS), h + 20 * MS);
    T_EQ_I(m.jumps, 2);
    T_NEAR(cap_clockmap_add(&m, HOST0 + 10 * MS, h + 33 * MS) - (h + 30 * MS), 0, 1000);
    T_EQ_I(m.jumps, 2);
}

/* ---- how far off: delays and drift as in the header's promise ---- */

struct spread {
    double p50, p99, max;
    size_t n;
};
static double sample[300000];

static struct spread spread_of(size_t n)
{
    struct spread s = {.n = n};
    qsort(sample, n, sizeof sample[0], pvx_ascending);
    if (n > 0) {
        s.p50 = sample[n / 2];
        s.p99 = sample[n * 99 / 100];
        s.max = sample[n - 1];
    }
    return s;
}

/* |mapped - true exposure|, us, over [from, to) seconds of a run that starts with the map's first
 * frame.  Delay: 0.2 ms, the constant that cannot be seen and is taken off, + up to 1 ms; 5 % lost. */
static struct spread error_of(double ppm, double from, double to, bool readings)
{
    struct cap_clockmap m = fresh(false);
    int64_t dev0 = (int64_t)t_uniform(1e9, 1e18), start = HOST0 + (int64_t)t_uniform(0, 1e9);
    int64_t constant = 200000;
    size_t n = 0;
    for (int64_t i = 0; (double)i < to * 30; i++) {
        double t = (double)i / 30 * 1e9;
        int64_t host = start + (int64_t)t, dev = dev0 + (int64_t)(t * (1 + ppm * 1e-6));
        if (readings && i % 30 == 0) {
            double bound = t_uniform(50e3, 500e3), at = t_uniform(-bound, bound);
            cap_clockmap_measure(&m, dev, host + (int64_t)at, (int64_t)bound);
        }
        if (t_uniform(0, 1) < 0.05)
            continue;
        int64_t got = cap_clockmap_add(&m, dev, host + constant + (int64_t)t_uniform(0, 1e6));
        if (t >= from * 1e9 && n < sizeof sample / sizeof sample[0])
            sample[n++] = fabs((double)(got - host - (readings ? 0 : constant))) * 1e-3;
    }
    T_EQ_I(m.jumps, 0);
    return spread_of(n);
}

/* The mean of each over `runs` runs of other clocks and delays, with drifts of both signs. */
static struct spread mean_of(int runs, double from, double to, bool readings)
{
    struct spread mean = {0};
    for (int r = 0; r < runs; r++) {
        struct spread s = error_of(r % 2 ? 100 : -100, from, to, readings);
        mean.p50 += s.p50 / runs;
        mean.p99 += s.p99 / runs;
        mean.max += s.max / runs;
        mean.n += s.n;
    }
    return mean;
}

/* A limit for the mean of `runs` runs, where many of them gave `mean` and the deviation `sd` of one: seven standard errors.
 * A sum of positive values that is skewed as a Gamma distribution of that mean and deviation passes it with a probability
 * below exp(-k (z - log(1 + z))), z = 7 / sqrt(k), k = runs (mean / sd)^2: 3e-8 at the least k here, 110 (Chernoff). */
static double limit(double mean, double sd, int runs)
{
    return mean + 7 * sd / sqrt(runs);
}

/* The statistics are of 30000 runs of each of the first three, 10000, 1000 and 100 of the last.  In the first second it is
 * the least of so many delays, 1 ms / n; then the drift makes 0.1 ms a second, until there is a line. */
T_CASE(errors_are_bounded)
{
    static const struct {
        double from, to; /* s */
        int runs;
        struct {
            double mean, sd; /* us */
        } p50, p99, max;
    } row[] = {{0, 1, 200, {75.9, 54.6}, {508, 280}, {508, 280}},
               {1, 3, 200, {99.2, 41.5}, {178.5, 57.9}, {178.5, 57.9}},
               {3, 10, 200, {16.0, 11.5}, {146.1, 91.4}, {153.8, 92.1}},
               {10, 60, 100, {3.20, 2.24}, {22.9, 13.5}, {26.0, 15.6}},
               {60, 600, 20, {1.465, 0.425}, {10.4, 3.08}, {13.3, 4.11}},
               {600, 3600, 2, {1.48, 0.188}, {11.0, 1.49}, {19.1, 7}}};
    for (size_t k = 0; k < sizeof row / sizeof row[0]; k++) {
        struct spread s = mean_of(row[k].runs, row[k].from, row[k].to, false);
        printf(
            "  %4.0f..%4.0f s after start: p50 %5.1f  p99 %5.1f  max %5.1f us, mean of %d runs\n",
            row[k].from, row[k].to, s.p50, s.p99, s.max, row[k].runs);
        T_LE(s.p50, limit(row[k].p50.mean, row[k].p50.sd, row[k].runs));
        T_LE(s.p99, limit(row[k].p99.mean, row[k].p99.sd, row[k].runs));
        T_LE(s.max, limit(row[k].max.mean, row[k].max.sd, row[k].runs));
    }
}

/* Readings of the clock take out the constant part of the delay as well.  The last 16, weighted with 1 / bound^2, whose mean
 * is 1 / (50 us 500 us), are good to 40 us in the middle of their time, at its end to 80, and being uniform within their
 * bounds to 1 / sqrt(3) of that: half of the errors below 0.67 of 46 us.  Statistics of 3000 runs. */
T_CASE(readings_take_out_the_delay)
{
    const int runs = 10;
    struct spread s = mean_of(runs, 20, 300, true);
    printf("  with readings +-50..500 us once a second: p50 %.0f  p99 %.0f  max %.0f us\n", s.p50,
           s.p99, s.max);
    T_LE(s.p50, limit(35.5, 4.45, runs));
    T_LE(s.max, limit(194.6, 38.1, runs));
    /* one before the first frame is enough for the first frame to be right */
    struct cap_clockmap m = fresh(false);
    cap_clockmap_measure(&m, 5 * S, HOST0, 100000);
    T_EQ_I(cap_clockmap_add(&m, 5 * S + 40 * MS, HOST0 + 40 * MS + 25 * MS), HOST0 + 40 * MS);
    /* nonsense is not believed */
    cap_clockmap_measure(&m, 0, HOST0, 1000);
    cap_clockmap_measure(&m, 5 * S + 50 * MS, HOST0 + 50 * MS, -1);
    cap_clockmap_measure(&m, 5 * S + 50 * MS, HOST0 + 51 * MS, 20 * MS);
    cap_clockmap_measure(&m, 500 * S, HOST0 + 60 * MS, 1000);
    T_EQ_I(cap_clockmap_add(&m, 5 * S + 80 * MS, HOST0 + 80 * MS + 25 * MS), HOST0 + 80 * MS);
    cap_clockmap_init(&m, true);
    cap_clockmap_measure(&m, HOST0, HOST0 + MS, 1000);
    T_EQ_I(cap_clockmap_add(&m, HOST0, HOST0 + S), HOST0);
}

/* A host so busy that no frame comes in time: its delays wander by milliseconds over seconds.  The
 * line of the readings does not, and says how sure it is; it is given up when readings end. */
static void busy_host(double *worst, double *doubt)
{
    struct cap_clockmap m = fresh(false);
    int64_t dev0 = 777 * S;
    *worst = *doubt = 0;
    for (int64_t i = 0; i < 120 * 30; i++) {
        double t = (double)i / 30 * 1e9, busy = 3e6 + 3e6 * sin((double)i / 100);
        int64_t host = HOST0 + (int64_t)t, dev = dev0 + (int64_t)(t * (1 + 80e-6));
        if (i % 60 == 0 && i < 90 * 30) {
            double bound = t_uniform(10e3, 60e3), at = t_uniform(-bound, bound);
            cap_clockmap_measure(&m, dev, host + (int64_t)at, (int64_t)bound);
        }
        int64_t got = cap_clockmap_add(&m, dev, host + (int64_t)(busy + t_uniform(0, 4e6)));
        if (i > 5 * 30 && i < 90 * 30) {
            *worst = fmax(*worst, fabs((double)(got - host)));
            *doubt = fmax(*doubt, cap_clockmap_doubt(&m));
        }
    }
    T_LE(1e6, cap_clockmap_doubt(&m)); /* the envelope alone again */
}

T_CASE(readings_hold_the_line_on_a_busy_host)
{
    enum { RUNS = 20 };
    double worst = 0, doubt = 0;
    for (int r = 0; r < RUNS; r++) {
        double w, u;
        busy_host(&w, &u);
        worst += w / RUNS;
        doubt += u / RUNS;
    }
    printf("  on a busy host wrong by %.0f us at most, doubt %.0f us; mean of %d runs\n",
           worst * 1e-3, doubt * 1e-3, RUNS);
    T_LE(worst, limit(34.7e3, 15.2e3, RUNS)); /* statistics of 20000 */
    T_LE(doubt, limit(104.5e3, 33.8e3, RUNS));
    struct cap_clockmap m = fresh(false);
    int64_t dev0 = 777 * S;
    /* a clock that was steered by half a millisecond is followed with the third reading after it */
    for (int64_t i = 0; i < 20; i++) {
        int64_t host = HOST0 + i * 2 * S, dev = dev0 + i * 2 * S + (i >= 10 ? 500000 : 0);
        cap_clockmap_measure(&m, dev, host, 10000);
        int64_t got = cap_clockmap_add(&m, dev, host + MS);
        if (i > 2 && i != 10 && i != 11)
            T_LE(llabs(got - host), 30000);
    }
    T_EQ_I(m.jumps, 0);
    T_NEAR(cap_clockmap_drift(&m) * 1e6, 0, 1);
}

/* A start on a busy machine: slow frames for 5 s, then the true delay; followed at once. */
T_CASE(a_slow_start_heals_at_once)
{
    struct cap_clockmap m = fresh(false);
    int64_t k = 0;
    for (; k < 5 * 30; k++)
        (void)cap_clockmap_add(&m, 777 + k * (S / 30), HOST0 + k * (S / 30) + 40 * MS);
    for (; k < 20 * 30; k++) {
        int64_t t = k * (S / 30), got = cap_clockmap_add(&m, 777 + t, HOST0 + t + MS);
        T_NEAR((double)(got - HOST0 - t), 1e6, 1e3);
    }
    T_EQ_I(m.jumps, 0);
}

/* Clock steps too small to run backwards: below the line at once, above it after three seconds. */
T_CASE(small_steps_are_followed)
{
    for (int sign = -1; sign <= 1; sign += 2) {
        struct cap_clockmap m = fresh(false);
        double after = 0;
        for (int64_t k = 0; k < 60 * 30; k++) {
            int64_t t = k * (S / 30), step = k >= 30 * 30 ? sign * 20 * MS : 0;
            int64_t got =
                cap_clockmap_add(&m, 777 + t + step, HOST0 + t + MS + (int64_t)t_uniform(0, 1e6));
            if (k > (sign > 0 ? 30 * 30 + 1 : 35 * 30))
                after = fmax(after, fabs((double)(got - HOST0 - t - MS)));
        }
        T_LE(after, 1.1e6);
        T_EQ_I(m.jumps, 0);
    }
    /* half a second is the clock's doing */
    struct cap_clockmap m = fresh(false);
    (void)worst(&m, 50 * S, 50, 30, 20, 0, 1e5);
    int64_t h = HOST0 + 20 * S;
    T_NEAR((double)(cap_clockmap_add(&m, 70 * S + S / 2, h) - h), 0, 1e6);
    T_EQ_I(m.jumps, 1);
    T_NEAR(m.envelope.drift * 1e6, -50, 20); /* the crystal is the same */
}

T_CASE(shared_clock_is_identity)
{
    struct cap_clockmap m = fresh(true);
    for (int i = 0; i < 100; i++)
        T_EQ_I(cap_clockmap_add(&m, HOST0 + i * MS, HOST0 + i * MS + (int64_t)(t_rand() % MS)),
               HOST0 + i * MS);
    T_EQ_I(m.jumps, 0);
    T_OK(m.envelope.drift == 0);
    T_EQ_I(cap_clockmap_add(&m, HOST0, HOST0 + S), HOST0);
    T_EQ_I(m.jumps, 1);
}

T_CASE(no_device_clock_means_arrival)
{
    struct cap_clockmap m = fresh(false);
    T_EQ_I(cap_clockmap_add(&m, 0, 4711), 4711);
    cap_clockmap_init(&m, true);
    T_EQ_I(cap_clockmap_add(&m, 0, 4711), 4711);
}

/* A map that has run for ten years knows a frame's time as well as one that has just begun: the same frames and readings of
 * the clock give both the same, though one counts from ten years ago, where a double of ns has steps of 64. */
T_CASE(ten_years_later)
{
    const double ppm = -80; /* the other way round ten years of nothing would be a jump */
    const int64_t years = 10 * 365 * 86400 * S;
    for (int readings = 0; readings < 2; readings++) {
        struct cap_clockmap young = fresh(false), old = fresh(false);
        double apart = 0, wrong = 0;
        (void)cap_clockmap_add(&old, 5 * S, HOST0 - years);
        for (int64_t i = 0; i < 150 * 30; i++) {
            int64_t t = i * S / 30, host = HOST0 + t;
            int64_t dev = 5 * S + years + t + llrint((double)t * ppm * 1e-6) +
                          llrint((double)years * ppm * 1e-6);
            int64_t arrival = host + 200000 + (int64_t)exponential(1e6);
            if (readings && i % 60 == 0) {
                cap_clockmap_measure(&young, dev, host + 3000, 20000);
                cap_clockmap_measure(&old, dev, host + 3000, 20000);
            }
            int64_t a = cap_clockmap_add(&young, dev, arrival);
            int64_t b = cap_clockmap_add(&old, dev, arrival);
            if (t < 70 * S) /* until the old one's first frame is out of its window */
                continue;
            apart = fmax(apart, fabs((double)(a - b)));
            wrong = fmax(wrong, fabs((double)(b - host)));
        }
        printf("  readings %d: apart by %.0f ns at most, wrong by %.1f us\n", readings, apart,
               wrong * 1e-3);
        T_LE(apart, 10);
        T_LE(wrong, readings ? 20e3 : 300e3);
        T_NEAR(cap_clockmap_drift(&old), cap_clockmap_drift(&young), 1e-10);
        T_EQ_I(old.jumps, 0);
    }
}
