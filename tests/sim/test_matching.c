/* test_matching.c - frame sets against the truth that the pictures carry, for hours and for any seed:
 * 1 ms jitter of the delivery, 100 ppm of drift either way, 5 % of frames lost, cameras that start at
 * different moments with clocks of any epoch.  Every set must hold one instant; every set of instants that
 * all cameras delivered must be given out whole (after the first second, while the clocks are unknown, as
 * well).
 * Offline: clock maps and assembler are fed with arrivals of a made-up host clock, as assembly.c does it,
 * so an hour takes a second. */
#include "../t.h"

#include "base/clock.h"
#include "capture/sync/clockmap.h"
#include "capture/sync/frameset.h"

#define S     PVX_NS_PER_S
#define MS    PVX_NS_PER_MS
#define MONO0 (777 * PVX_NS_PER_S)
#define REAL0 1700000000000000000LL

/* The picture: which instant it shows. */
struct picture {
    struct cap_frame f; /* first */
    int64_t instant;
};

static struct picture *pool[8192];
static size_t n_pool;
static int64_t n_out;
static void give_back(struct cap_frame *f)
{
    n_out--;
    pool[n_pool++] = (struct picture *)f;
}
static struct picture *picture(void)
{
    n_out++;
    if (n_pool > 0)
        return pool[--n_pool];
    return calloc(1, sizeof(struct picture));
}

static uint64_t counts[CAP_MAX_CAMERAS][CAP_N_COUNT];
static void count(void *ctx, uint32_t camera, enum cap_count what, uint64_t n)
{
    (void)ctx;
    counts[camera][what] += n;
}

#define SETTLING 8 /* frames after a start that only tell the clock, as intake.c has it */

struct stream {
    double ppm;
    int64_t dev0, start; /* its clock at mono MONO0; first instant that is matched */
    int64_t least;       /* ns, constant part of its delay */
    int64_t last_arrival;
    struct cap_clockmap clock;
    struct picture *next; /* on its way */
    int64_t instant;      /* of it */
};

struct setup {
    uint32_t cameras;
    double hz, seconds, drop, jitter_ms, ppm;
    double stall;          /* share of frames that hold up the ones behind them, up to 60 ms */
    bool readings;         /* clocks are read once a second, +-0.3 ms */
    double delays;         /* ms, cameras' constant delays differ by up to this */
    int64_t step_at, step; /* s; ns: the host's clock is set meanwhile */
};

struct result {
    uint64_t sets, mixed, disorder, whole_possible, whole, lost_whole, put, in_sets;
    double spread_max_us;
};

static void send(const struct setup *u, struct stream *x, uint32_t c, int64_t period)
{
    do {
        x->instant++;
    } while (t_uniform(0, 1) < u->drop);
    int64_t t = x->instant * period; /* mono - MONO0 */
    int64_t delay = x->least + (int64_t)t_uniform(0, u->jitter_ms * 1e6);
    if (t_uniform(0, 1) < u->stall)
        delay += (int64_t)t_uniform(0, 60e6);
    if (t + delay <= x->last_arrival) /* a camera's frames come in order */
        delay = x->last_arrival + 1000 - t;
    x->last_arrival = t + delay;
    x->next = picture();
    x->next->instant = x->instant;
    x->next->f =
        (struct cap_frame){.camera = c,
                           .id = (uint64_t)x->instant,
                           .t_device_ns = x->dev0 + t + (int64_t)((double)t * x->ppm * 1e-6),
                           .t_arrival_mono_ns = MONO0 + t + delay,
                           .release = give_back};
}

static uint64_t members[1 << 17]; /* bit per camera that delivers instant i */

static struct result play(const struct setup *u)
{
    static struct stream stream[CAP_MAX_CAMERAS];
    struct result r = {0};
    int64_t period = (int64_t)(1e9 / u->hz), n = (int64_t)(u->seconds * u->hz);
    uint64_t all = (1ull << u->cameras) - 1;
    memset(counts, 0, sizeof counts);
    memset(members, 0, sizeof members);
    struct cap_assembler_params p = {
        .cameras = u->cameras, .period_ns = period, .policy = CAP_POLICY_PARTIAL, .min_cameras = 1};
    struct cap_sink sink = {.count = count};
    cap_assembler *a;
    T_EQ_I(cap_assembler_new(&p, &sink, &a), PVX_OK);
    int64_t all_alive = -1; /* first instant after the last camera's first frame had come */
    uint64_t alive = 0;
    for (uint32_t c = 0; c < u->cameras; c++) {
        struct stream *x = &stream[c];
        memset(x, 0, sizeof *x);
        x->ppm = t_uniform(-u->ppm, u->ppm);
        if (c < 2) /* the worst there is: one each way */
            x->ppm = c == 0 ? u->ppm : -u->ppm;
        x->dev0 = (int64_t)t_uniform(1e9, 1.7e18);
        x->start = x->instant = (int64_t)(t_rand() % 40);
        x->least = 200000 + (int64_t)t_uniform(0, u->delays * 1e6);
        cap_clockmap_init(&x->clock, false);
        cap_assembler_alive(a, c, false); /* until its first frame, as assembly.c has it */
        send(u, x, c, period);
        x->start = x->instant + (u->stall > 0 || u->readings ? SETTLING : 1);
    }
    int64_t last = -1, offset = REAL0 - MONO0, stepped = 0;
    for (;;) {
        uint32_t c = 0;
        for (uint32_t b = 1; b < u->cameras; b++)
            if (stream[b].next->f.t_arrival_mono_ns < stream[c].next->f.t_arrival_mono_ns)
                c = b;
        struct stream *x = &stream[c];
        struct picture *pic = x->next;
        if (pic->instant >= n)
            break;
        int64_t now = pic->f.t_arrival_mono_ns;
        if (u->step != 0 && stepped == 0 && now - MONO0 > u->step_at * S) {
            stepped = u->step;
            offset += u->step;
            cap_assembler_shift(a, u->step);
        }
        if (u->readings && (!x->clock.valid || pic->instant % (int64_t)u->hz == 0)) {
            int64_t err = (int64_t)t_uniform(-300e3, 300e3), t = pic->instant * period;
            cap_clockmap_measure(&x->clock, pic->f.t_device_ns, MONO0 + t + err, 300000);
        }
        pic->f.t_exposure_ns =
            cap_clockmap_add(&x->clock, pic->f.t_device_ns, pic->f.t_arrival_mono_ns) + offset;
        if (u->stall > 0 && pic->instant < x->start) { /* intake.c: for the clock only */
            give_back(&pic->f);
            send(u, x, c, period);
            continue;
        }
        alive |= 1ull << c;
        if (alive == all && all_alive < 0)
            all_alive = (now - MONO0) / period + 1;
        cap_assembler_alive(a, c, true);
        cap_assembler_tick(a, now);
        members[pic->instant] |= 1ull << c;
        r.put++;
        cap_assembler_put(a, &pic->f);
        send(u, x, c, period);
        struct cap_set *s;
        while ((s = cap_assembler_pop(a)) != NULL) {
            int64_t shows = -1;
            for (uint32_t i = 0; i < u->cameras; i++) {
                if (s->frame[i] == NULL)
                    continue;
                int64_t is = ((struct picture *)s->frame[i])->instant;
                r.mixed += shows >= 0 && is != shows;
                r.mixed += s->frame[i]->camera != i;
                shows = is;
                r.in_sets++;
            }
            r.disorder += shows <= last;
            last = shows;
            r.sets++;
            if (s->n == u->cameras) {
                r.whole++;
                r.spread_max_us = fmax(r.spread_max_us, (double)s->spread_ns * 1e-3);
                members[shows] |= 1ull << 63; /* given out whole */
            }
            cap_set_release(s);
        }
    }
    for (int64_t i = 0; i <= last; i++) { /* what could have been whole, and was not */
        bool possible = all_alive >= 0 && i >= all_alive && (members[i] & all) == all;
        r.whole_possible += possible;
        r.lost_whole += possible && members[i] >> 63 == 0;
    }
    r.put -= cap_assembler_open(a);
    for (uint32_t c = 0; c < u->cameras; c++) {
        r.in_sets += counts[c][CAP_LATE] + counts[c][CAP_UNMATCHED] + counts[c][CAP_OVERFLOW];
        cap_frame_release(&stream[c].next->f);
    }
    T_EQ_I(r.put, r.in_sets);
    cap_assembler_free(&a);
    T_EQ_I(n_out, 0);
    return r;
}

/* Played, and right. */
static struct result matched(const struct setup *u)
{
    struct result got = play(u), *r = &got;
    T_CHECK_(r->mixed == 0 && r->disorder == 0 && r->lost_whole == 0,
             "%u cameras, %.0f Hz: %llu frames of another instant, %llu sets out of order, %llu of "
             "%llu whole sets lost",
             u->cameras, u->hz, (unsigned long long)r->mixed, (unsigned long long)r->disorder,
             (unsigned long long)r->lost_whole, (unsigned long long)r->whole_possible);
    T_OK(r->whole_possible > 0);
    return got;
}

/* What is asked of matching. */
static const struct setup asked = {
    .cameras = 8, .hz = 30, .seconds = 20, .drop = 0.05, .jitter_ms = 1, .ppm = 100};

T_CASE(any_seed_is_matched)
{
    uint64_t sets = 0, whole = 0;
    double spread = 0;
    for (int round = 0; round < 300; round++) {
        struct setup u = asked;
        u.cameras = 2 + (uint32_t)(t_rand() % 7);
        u.hz = 15 << round % 3;
        u.seconds = 10 + t_uniform(0, 20);
        struct result r = matched(&u);
        sets += r.sets;
        whole += r.whole;
        spread = fmax(spread, r.spread_max_us);
    }
    printf("  300 runs: %llu sets, %llu whole, all of one instant, none lost; spread at most %.0f "
           "us\n",
           (unsigned long long)sets, (unsigned long long)whole, spread);
}

T_CASE(an_hour_is_matched)
{
    struct setup u = asked;
    u.seconds = 3600;
    struct result r = matched(&u);
    printf("  1 h at 30 Hz: %llu sets, %llu whole, none lost; spread at most %.0f us\n",
           (unsigned long long)r.sets, (unsigned long long)r.whole, r.spread_max_us);
}

/* Frames held up by a resend, and all behind them with it: 60 ms is four periods. */
T_CASE(held_up_frames_are_matched)
{
    for (int round = 0; round < 60; round++) {
        struct setup u = asked;
        u.hz = 60;
        u.stall = 0.01;
        (void)matched(&u);
    }
}

/* Cameras whose constant delays differ by more than the tolerance: with readings of their clocks. */
T_CASE(unlike_cameras_are_matched_by_readings)
{
    for (int round = 0; round < 40; round++) {
        struct setup u = asked;
        u.cameras = 4;
        u.hz = 60;
        u.delays = 25;
        u.readings = true;
        (void)matched(&u);
    }
}

T_CASE(setting_the_host_clock_loses_nothing)
{
    static const int64_t steps[] = {3600 * S, -3600 * S, 11 * MS, -11 * MS};
    for (size_t k = 0; k < 4; k++) {
        struct setup u = asked;
        u.seconds = 30;
        u.step_at = 12;
        u.step = steps[k];
        (void)matched(&u);
    }
}

static void tear_down(void)
{
    while (n_pool > 0)
        free(pool[--n_pool]);
}
T_MAIN((void)0, tear_down())
