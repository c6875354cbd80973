/* test_player.c - stop gets a source's thread out of whatever it waits for, and a start after it works. */
#include "../t.h"

#include <stdatomic.h>

#include "base/clock.h"
#include "capture/source/player.h"
#include "tests/lib/patience.h"

#define FRAMES 4

static atomic_int frames, underruns, ends;

static void push(void *ctx, struct cap_frame *f)
{
    (void)ctx;
    (void)f; /* run() keeps it in `held` */
    atomic_fetch_add(&frames, 1);
}
static void event(void *ctx, uint32_t camera, enum cap_event ev)
{
    (void)ctx;
    T_EQ_I(camera, 3);
    T_EQ_I(ev, CAP_EV_END);
    atomic_fetch_add(&ends, 1);
}
static void count(void *ctx, uint32_t camera, enum cap_count what, uint64_t n)
{
    (void)ctx;
    T_EQ_I(camera, 3);
    T_EQ_I(what, CAP_UNDERRUN);
    atomic_fetch_add(&underruns, (int)n);
}
static const struct cap_sink sink = {.push = push, .event = event, .count = count};

struct one {
    struct cap_player p;
    struct cap_frame *held[FRAMES + 1]; /* the consumer gives none back */
};

static void open_one(struct one *s, bool lossless, clockid_t clock)
{
    struct cap_source_config c = {.camera = 3, .lossless = lossless, .buffers = 1};
    memset(s, 0, sizeof *s);
    frames = underruns = ends = 0;
    cap_player_init(&s->p, &c, clock);
    T_EQ_I(cap_player_make_pool(&s->p, &c, 16), PVX_OK);
}

static void close_one(struct one *s)
{
    for (int i = 0; i <= FRAMES; i++)
        cap_frame_release(s->held[i]);
    cap_player_fini(&s->p);
}

/* Take all that there is and one more, then wait for a time that never comes. */
static void *run(void *arg)
{
    struct one *s = arg;
    for (int i = 0; i <= FRAMES; i++) {
        if ((s->held[i] = cap_player_get(&s->p)) != NULL)
            s->p.sink.push(s->p.sink.ctx, s->held[i]);
        else if (cap_player_stopped(&s->p))
            return NULL;
    }
    if (cap_player_wait_until(&s->p, INT64_MAX / 2))
        cap_player_event(&s->p, CAP_EV_END);
    return NULL;
}

static void wait_for(atomic_int *what, int n)
{
    for (int64_t until = pvx_now_mono() + PATIENCE_NS;
         atomic_load(what) < n && pvx_now_mono() < until;)
        pvx_sleep_until_mono(pvx_now_mono() + PVX_NS_PER_MS);
    T_EQ_I(atomic_load(what), n);
}

static void start(struct one *s)
{
    struct pvx_diag d = {""};
    T_EQ_I(cap_player_start(&s->p, "test", &sink, run, s, &d), PVX_OK);
}

T_CASE(stop_ends_a_wait_for_a_time)
{
    static const clockid_t clocks[] = {CLOCK_MONOTONIC, CLOCK_REALTIME};
    for (int k = 0; k < 2; k++) {
        struct one s;
        open_one(&s, false, clocks[k]);
        start(&s);
        wait_for(&underruns, 1); /* the fifth of four */
        cap_player_stop(&s.p);
        cap_player_stop(&s.p); /* nothing to be stopped */
        T_EQ_I(frames, FRAMES);
        T_EQ_I(ends, 0);
        close_one(&s);
    }
}

T_CASE(stop_ends_a_wait_for_a_frame)
{
    struct one s;
    open_one(&s, true, CLOCK_MONOTONIC);
    start(&s);
    wait_for(&frames, FRAMES);
    cap_player_stop(&s.p);
    T_OK(s.held[FRAMES] == NULL);
    T_EQ_I(underruns, 0); /* being stopped is no underrun */
    T_EQ_I(ends, 0);
    close_one(&s);
}

T_CASE(starts_again)
{
    struct one s;
    open_one(&s, true, CLOCK_MONOTONIC);
    for (int turn = 1; turn <= 3; turn++) {
        start(&s);
        wait_for(&frames, turn * FRAMES);
        cap_player_stop(&s.p);
        for (int i = 0; i <= FRAMES; i++) {
            cap_frame_release(s.held[i]);
            s.held[i] = NULL;
        }
    }
    close_one(&s);
}

static void *run_to_end(void *arg)
{
    struct one *s = arg;
    if (cap_player_wait_until(&s->p, pvx_now_mono() - 1)) /* has passed: at once */
        cap_player_event(&s->p, CAP_EV_END);
    return NULL;
}

T_CASE(a_thread_that_has_ended_is_joined)
{
    struct one s;
    open_one(&s, false, CLOCK_MONOTONIC);
    T_EQ_I(cap_player_start(&s.p, "test", &sink, run_to_end, &s, NULL), PVX_OK);
    wait_for(&ends, 1);
    cap_player_stop(&s.p);
    close_one(&s);
}
