/* test_syncwatch.c - what is wrong with a camera's trigger, rate or numbers is found, in time, in the
 * right camera, and nothing is found where nothing is wrong. */
#include "../t.h"

#include "base/clock.h"
#include "capture/sync/syncwatch.h"

#define S    PVX_NS_PER_S
#define MS   PVX_NS_PER_MS
#define T0   1700000000000000000LL
#define N    4
#define BOOT (7 * S) /* what devices' clocks showed at 0 */

static uint64_t counts[CAP_MAX_CAMERAS][CAP_N_COUNT];
static char details[CAP_MAX_CAMERAS][CAP_N_COUNT][128];
static void count(void *ctx, uint32_t camera, enum cap_count what, uint64_t n)
{
    (void)ctx;
    counts[camera][what] += n;
}
static void detail(void *ctx, uint32_t camera, enum cap_count what, const char *text)
{
    (void)ctx;
    snprintf(details[camera][what], sizeof details[camera][what], "%s", text);
}

static struct cap_syncwatch w;
static uint64_t next_id[CAP_MAX_CAMERAS];

static void begin(uint32_t cameras, double hz)
{
    memset(counts, 0, sizeof counts);
    memset(details, 0, sizeof details);
    for (uint32_t c = 0; c < CAP_MAX_CAMERAS; c++)
        next_id[c] = 1 + t_rand() % 60000;
    struct cap_syncwatch_params p = {.cameras = cameras,
                                     .period_ns = (int64_t)(1e9 / hz),
                                     .tolerance_ns = (int64_t)(1e9 / hz / 4)};
    struct cap_sink sink = {.count = count};
    cap_syncwatch_init(&w, &p, &sink, detail);
}

static void frame(uint32_t c, double t)
{
    struct cap_frame f = {.camera = c,
                          .id = next_id[c]++,
                          .t_device_ns = BOOT + (int64_t)(t * 1e9),
                          .t_exposure_ns = T0 + (int64_t)(t * 1e9),
                          .t_arrival_mono_ns = (int64_t)((t + 0.01 + t_uniform(0, 0.001)) * 1e9)};
    cap_syncwatch_frame(&w, &f);
}

/* A set of the cameras in `mask` at t, ids as they are; the frames are seen too. */
static void set(uint32_t cameras, uint64_t mask, double t)
{
    static struct cap_frame f[CAP_MAX_CAMERAS];
    struct cap_set s = {.t_exposure_ns = T0 + (int64_t)(t * 1e9)};
    for (uint32_t c = 0; c < cameras; c++)
        if (mask >> c & 1) {
            f[c] =
                (struct cap_frame){.camera = c,
                                   .id = next_id[c]++,
                                   .t_exposure_ns = s.t_exposure_ns + (int64_t)t_uniform(-1e5, 1e5),
                                   .t_arrival_mono_ns = (int64_t)(t * 1e9)};
            s.frame[c] = &f[c];
            s.n++;
            cap_syncwatch_frame(&w, &f[c]);
        }
    cap_syncwatch_set(&w, &s);
}

/* So many of the N cameras' sets at 30 Hz from t on; when the next one is due. */
static double sets(int n, uint64_t mask, double t)
{
    for (; n > 0; n--, t += 1 / 30.)
        set(N, mask, t);
    return t;
}

static uint64_t any(uint32_t c)
{
    uint64_t n = 0;
    for (int i = CAP_CLOCK_STUCK; i < CAP_N_COUNT; i++)
        n += counts[c][i];
    return n;
}
static uint64_t anything(void)
{
    uint64_t n = 0;
    for (uint32_t c = 0; c < CAP_MAX_CAMERAS; c++)
        n += any(c);
    return n;
}

/* A camera may send any 64 bits as a number: nothing overflows (the sanitizer looks on). */
T_CASE(any_numbers_are_borne)
{
    static const uint64_t odd[] = {1, UINT64_MAX, INT64_MAX, 1ull << 63, (1ull << 63) + 1, 2};
    begin(3, 100);
    for (int k = 0; k < 5000; k++) {
        if (k % 3 == 0)
            next_id[0] = odd[t_rand() % 6];
        if (k % 500 > 250)
            next_id[1] = next_id[2] = odd[k % 6];
        set(3, 7, k * 0.01);
    }
    begin(3, 100); /* and it is itself again afterwards */
    for (uint32_t c = 0; c < 3; c++)
        next_id[c] = (uint64_t)INT64_MAX - 50 * c;
    for (int k = 0; k < 1000; k++)
        set(3, 7, k * 0.01);
    T_EQ_I(anything(), 0);
}

/* Drops with gaps, jitter of 1 ms, 29.99 Hz instead of 30: nothing is wrong. */
T_CASE(nothing_is_found_where_nothing_is_wrong)
{
    for (int round = 0; round < 40; round++) {
        double hz = 30;
        uint32_t cameras = 2 + (uint32_t)(t_rand() % 7);
        begin(cameras, hz);
        for (int k = 0; k < 40 * 30; k++) {
            static struct cap_frame f[CAP_MAX_CAMERAS];
            struct cap_set s = {.t_exposure_ns = T0 + (int64_t)(k / 29.99 * 1e9)};
            for (uint32_t c = 0; c < cameras; c++, next_id[c - 1]++) {
                if (t_uniform(0, 1) < 0.05)
                    continue;
                f[c] = (struct cap_frame){
                    .camera = c,
                    .id = next_id[c],
                    .t_exposure_ns = s.t_exposure_ns + (int64_t)t_uniform(-1e6, 1e6),
                    .t_arrival_mono_ns = (int64_t)(k / 29.99 * 1e9 + t_uniform(2e6, 4e6))};
                s.frame[c] = &f[c];
                s.n++;
                cap_syncwatch_frame(&w, &f[c]);
            }
            if (s.n >= 2)
                cap_syncwatch_set(&w, &s);
        }
        T_CHECK_(anything() == 0, "round %d: %llu findings", round, (unsigned long long)anything());
    }
}

T_CASE(a_missed_trigger_is_found_at_once)
{
    begin(N, 30);
    double t = sets(10, 15, 0);
    t = sets(1, 15 & ~4u, t); /* camera 2 takes no picture, and its numbers do not tell */
    t = sets(1, 15, t);
    T_EQ_I(anything(), 0);
    t = sets(1, 15, t);
    T_EQ_I(counts[2][CAP_MISSED_TRIGGER], 1);
    T_EQ_I(anything(), 1);
    /* a loss that its numbers tell is no missed trigger */
    t = sets(1, 15 & ~2u, t);
    next_id[1]++;
    t = sets(10, 15, t);
    T_EQ_I(anything(), 1);
    /* three at once, while only whole sets are given out */
    for (uint32_t c = 0; c < N; c++)
        next_id[c] += c == 3 ? 0 : 3;
    sets(10, 15, t + 3 / 30.);
    T_EQ_I(counts[3][CAP_MISSED_TRIGGER], 3);
    T_EQ_I(anything(), 4);
}

/* One after the other, with one picture between them: still no slip. */
T_CASE(missed_triggers_close_together)
{
    begin(N, 30);
    double t = sets(10, 15, 0);
    for (int k = 0; k < 6; k++)
        t = sets(1, k % 2 == 0 ? 15 & ~4u : 15, t);
    sets(10, 15, t);
    T_EQ_I(counts[2][CAP_MISSED_TRIGGER], 3);
    T_EQ_I(anything(), 3);
}

T_CASE(off_by_one_is_found)
{
    for (uint32_t cameras = 2; cameras <= 8; cameras++)
        for (int by = -1; by <= 1; by += 2) {
            begin(cameras, 30);
            double t = 0;
            for (int k = 0; k < 10; k++, t += 1 / 30.)
                set(cameras, (1u << cameras) - 1, t);
            next_id[1] +=
                (uint64_t)by; /* its pictures and its stamps are no longer the same ones */
            set(cameras, (1u << cameras) - 1, t);
            set(cameras, (1u << cameras) - 1, t + 1 / 30.);
            T_EQ_I(counts[1][CAP_SLIP], 1);
            for (int k = 2; k < 30; k++)
                set(cameras, (1u << cameras) - 1, t + k / 30.);
            T_EQ_I(anything(), 1);
        }
}

T_CASE(numbers_may_begin_anew)
{
    begin(N, 30);
    double t = sets(10, 15, 0);
    next_id[0] = 1;
    cap_syncwatch_restart(&w, 0);
    t = sets(30, 15, t);
    next_id[3] = 500000; /* nobody said so */
    sets(30, 15, t);
    T_EQ_I(anything(), 0);
}

/* Camera `odd` at its own rate and phase beside triggered ones; the time until `what` is counted, s. */
static double noise = 2e-4; /* s, of stamps, each way */
static double until(uint32_t cameras, uint32_t odd, double hz, double odd_hz, double phase,
                    enum cap_count what, double most)
{
    double next[CAP_MAX_CAMERAS] = {0};
    begin(cameras, hz);
    next[odd] = phase;
    for (;;) {
        uint32_t c = 0;
        for (uint32_t b = 1; b < cameras; b++)
            if (next[b] < next[c])
                c = b;
        double t = next[c];
        if (t > most || counts[odd][what] > 0)
            return t;
        frame(c, t + t_uniform(-noise, noise));
        next[c] += 1 / (c == odd ? odd_hz : hz);
    }
}

static void only(uint32_t cameras, uint32_t odd)
{
    for (uint32_t c = 0; c < cameras; c++)
        for (int i = CAP_CLOCK_STUCK; c != odd && i < CAP_N_COUNT; i++)
            T_CHECK_(counts[c][i] == 0, "camera %u: %s: %s", c, cap_count_defs[i].name,
                     details[c][i]);
}

T_CASE(a_camera_out_of_step_is_found_in_a_second)
{
    T_LE(until(N, 2, 30, 30, 0.012, CAP_OUT_OF_STEP, 20), 1.2);
    only(N, 2);
    T_CONTAINS(details[2][CAP_OUT_OF_STEP], "ms after the others");
    T_LE(until(8, 7, 100, 100, 0.0072, CAP_OUT_OF_STEP, 20), 1.2);
    only(8, 7);
    T_CONTAINS(details[7][CAP_OUT_OF_STEP], "before");
    /* another time altogether: whole periods away */
    T_LE(until(3, 0, 30, 30, 0, CAP_OUT_OF_STEP, 3), 3.1);
    begin(3, 30);
    for (int k = 0; k < 60; k++)
        for (uint32_t c = 0; c < 3; c++) {
            struct cap_frame f = {.camera = c,
                                  .id = next_id[c]++,
                                  .t_exposure_ns = T0 + k * S / 30 + (c == 1 ? 3600 * S : 0),
                                  .t_arrival_mono_ns = k * S / 30 + (int64_t)t_uniform(0, 1e6)};
            cap_syncwatch_frame(&w, &f);
        }
    T_OK(counts[1][CAP_OUT_OF_STEP] > 0);
    T_CONTAINS(details[1][CAP_OUT_OF_STEP], "3600.0");
    only(3, 1);
}

T_CASE(a_free_running_camera_is_found_before_it_is_out_of_step)
{
    static const struct {
        double ppm, noise;
        enum cap_count what;
        double at_most;
    } row[] = {{1000, 2e-6, CAP_RATE, 0.7},     {-1000, 2e-6, CAP_RATE, 0.7},
               {450, 2e-6, CAP_RATE, 0.7},      {1000, 2e-4, CAP_RATE, 1.7},
               {-1000, 2e-4, CAP_RATE, 1.7},    {1000, 1e-3, CAP_RATE, 5},
               {1000, 2e-4, CAP_PHASE_WALK, 4}, {-1000, 2e-4, CAP_PHASE_WALK, 4},
               {200, 2e-4, CAP_PHASE_WALK, 7},  {50, 2e-4, CAP_PHASE_WALK, 15}};
    for (size_t k = 0; k < sizeof row / sizeof row[0]; k++) {
        noise = row[k].noise;
        double t = until(N, 1, 30, 30 * (1 + row[k].ppm * 1e-6), 0, row[k].what, 100);
        printf("  free running %5.0f ppm off at 30 Hz, stamps +-%4.0f us: %-10s after %5.2f s\n",
               row[k].ppm, noise * 1e6, cap_count_defs[row[k].what].name, t);
        T_LE(t, row[k].at_most);
        T_EQ_I(counts[1][CAP_OUT_OF_STEP], 0);
        only(N, 1);
    }
    noise = 2e-4;
}

T_CASE(wrong_rates_are_found)
{
    static const struct {
        double hz, at_most;
    } row[] = {{60, 1.05}, {15, 1.05}, {25, 1.05}, {30.5, 1.05}, {29.97, 1.7}};
    for (size_t k = 0; k < sizeof row / sizeof row[0]; k++) {
        double t = until(N, 3, 30, row[k].hz, 0, CAP_RATE, 60);
        printf("  %.2f Hz instead of 30: found after %.1f s: %s\n", row[k].hz, t,
               details[3][CAP_RATE]);
        T_LE(t, row[k].at_most);
        only(N, 3);
    }
    T_LE(until(2, 1, 30, 29.97, 0, CAP_RATE, 60), 1.7); /* of two the one that is not nominal */
    T_EQ_I(counts[0][CAP_RATE], 0);
    /* all alike and a little off nominal: an outside trigger, nothing is wrong */
    begin(N, 30);
    for (int k = 0; k < 30 * 40; k++)
        for (uint32_t c = 0; c < N; c++)
            frame(c, k / 29.97);
    T_EQ_I(anything(), 0);
    /* all of them far off: the configuration is */
    begin(N, 20);
    for (int k = 0; k < 30 * 2; k++)
        for (uint32_t c = 0; c < N; c++)
            frame(c, k / 30.);
    for (uint32_t c = 0; c < N; c++)
        T_OK(counts[c][CAP_RATE] > 0);
}

T_CASE(a_set_host_clock_is_no_finding)
{
    begin(N, 30);
    double t = sets(90, 15, 0);
    cap_syncwatch_shift(&w, -1000 * S);
    sets(210, 15, t - 1000);
    T_EQ_I(anything(), 0);
}
