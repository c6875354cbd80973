/* test_capture_sim.c - the whole capture layer on simulated cameras: every set holds one instant,
 * every frame is accounted for, broken cameras do not hold up the others.
 * Deadlines are generous and nothing asserts on a rate: the machine may be busy. */
#include "../t.h"

#include <pthread.h>

#include "base/clock.h"
#include "base/log.h"
#include "capture/rig/capture.h"

#define N           8
#define PERIOD_NS   10000000LL
#define PATIENCE_NS (60 * PVX_NS_PER_S) /* no wait in here should come near */

/* The scene writes the true time of exposure and the camera into the picture. */
struct truth {
    int64_t t;
    uint32_t camera;
};
static void render(void *ctx, uint32_t camera, int64_t t, enum cap_pixfmt fmt, int32_t w, int32_t h,
                   void *data)
{
    (void)ctx, (void)fmt, (void)w, (void)h;
    struct truth truth = {t, camera};
    memcpy(data, &truth, sizeof truth);
}
static const struct cap_scene scene = {.render = render};

struct rig {
    struct cap_source_config cam[N];
    struct cap_capture_config cfg;
    char uri[N][128], name[N][16];
};

static void rig_init(struct rig *r, uint32_t n, const char *options)
{
    memset(r, 0, sizeof *r);
    for (uint32_t i = 0; i < n; i++) {
        snprintf(r->uri[i], sizeof r->uri[i], "sim:%s", options);
        snprintf(r->name[i], sizeof r->name[i], "cam%u", i);
        r->cam[i] = (struct cap_source_config){.uri = r->uri[i],
                                               .name = r->name[i],
                                               .width = 16,
                                               .height = 4,
                                               .fmt = CAP_GREY8,
                                               .scene = &scene,
                                               .buffers = 16,
                                               .exposure_us = -1,
                                               .gain = -1};
    }
    r->cfg = (struct cap_capture_config){
        .n_cameras = n,
        .camera = r->cam,
        .fps = 1e9 / PERIOD_NS,
        .shared_clock = true,
        .sets = {.policy = CAP_POLICY_PARTIAL, .min_cameras = 2, .max_wait_ns = 2 * PVX_NS_PER_S}};
}

static cap_capture *begin(const struct rig *r)
{
    cap_capture *c;
    struct pvx_diag d = {""};
    pvx_err e = cap_capture_new(&r->cfg, &c, &d);
    T_CHECK_(e == PVX_OK, "new: %s", d.text);
    if (e != PVX_OK)
        exit(1);
    T_EQ_I(cap_capture_start(c, &d), PVX_OK);
    return c;
}

/* What the sets say, gathered over a run. */
struct tally {
    uint64_t frames[CAP_MAX_CAMERAS], sets, complete, mixed, backwards, wrong_camera, gaps;
    int64_t last_t;
    uint64_t next_number;
};

static void look(struct tally *y, const struct cap_set *s, uint32_t n)
{
    int64_t t = 0;
    uint32_t members = 0;
    for (uint32_t i = 0; i < n; i++) {
        const struct cap_frame *f = s->frame[i];
        if (f == NULL)
            continue;
        struct truth truth;
        memcpy(&truth, f->img.data, sizeof truth);
        y->frames[i]++;
        members++;
        y->mixed += t != 0 && truth.t != t;
        y->wrong_camera += truth.camera != i || f->camera != i;
        t = truth.t;
    }
    T_EQ_I(members, s->n);
    y->sets++;
    y->complete += members == n;
    y->backwards += t <= y->last_t;
    y->last_t = t;
    y->gaps += s->number != y->next_number;
    y->next_number = s->number + 1;
}

/* Take sets until `want` complete ones, or the time is over. */
static void consume(cap_capture *c, struct tally *y, uint32_t n, uint64_t want)
{
    int64_t until = pvx_now_mono() + PATIENCE_NS;
    while (y->complete < want && pvx_now_mono() < until) {
        struct cap_set *s;
        pvx_err e = cap_capture_next(c, PVX_NS_PER_S, &s);
        if (e == PVX_ECLOSED)
            break;
        if (e == PVX_OK) {
            look(y, s, n);
            cap_set_release(s);
        }
    }
}

static void rest(cap_capture *c, struct tally *y, uint32_t n)
{
    struct cap_set *s;
    while (cap_capture_next(c, 0, &s) == PVX_OK) {
        look(y, s, n);
        cap_set_release(s);
    }
}

static void check_sums(cap_capture *c, const struct tally *y, uint32_t n)
{
    static struct cap_stats st;
    cap_capture_stats(c, &st);
    for (uint32_t i = 0; i < n; i++) {
        const uint64_t *k = st.camera[i].count;
        T_EQ_I(k[CAP_RECEIVED], y->frames[i] + k[CAP_LATE] + k[CAP_UNMATCHED] + k[CAP_OVERFLOW]);
    }
    T_EQ_I(st.sets_complete + st.sets_partial, y->sets + st.sets_dropped);
    T_EQ_I(st.spread.count, st.sets_complete + st.sets_partial);
}

static void check_pure(const struct tally *y)
{
    T_EQ_I(y->mixed, 0);
    T_EQ_I(y->wrong_camera, 0);
    T_EQ_I(y->backwards, 0);
}

static void eight_cameras_give_pure_sets(void)
{
    static struct rig r;
    rig_init(&r, N, "");
    for (int i = 0; i < N; i++) /* below the tolerance together: 2.5 ms */
        snprintf(r.uri[i], sizeof r.uri[i], "sim:skew_us=%d,drop=0.05,jitter_us=500,seed=3",
                 i * 100);
    r.cfg.discard_first = 1;
    cap_capture *c = begin(&r);
    struct tally y = {0};
    consume(c, &y, N, 100);
    cap_capture_stop(c);
    rest(c, &y, N);
    T_OK(y.complete >= 100);
    T_OK(y.sets > y.complete); /* 5 % of the frames were dropped */
    check_pure(&y);
    check_sums(c, &y, N);
    static struct cap_stats st;
    cap_capture_stats(c, &st);
    for (int i = 0; i < N; i++) {
        T_OK(st.camera[i].count[CAP_ID_GAP] > 0);
        T_EQ_I(st.camera[i].count[CAP_BAD_SIZE], 0);
        T_EQ_S(st.camera[i].error, "");
    }
    T_OK(pvx_hist_quantile(&st.spread, 0.5) > 600000);
    T_LE(st.spread.max_ns, 2500000);
    cap_capture_free(&c);
    T_OK(c == NULL);
}

/* Clocks that are not the host's: offset by hours, drifting, delivered at random times. */
static void foreign_clocks_are_mapped(void)
{
    static struct rig r;
    rig_init(&r, 4, "");
    for (int i = 0; i < 4; i++)
        snprintf(r.uri[i], sizeof r.uri[i], "sim:skew_us=%g,drift_ppm=%d,jitter_us=300",
                 -1e10 * (i + 1), 40 * i - 60);
    r.cfg.shared_clock = false;
    r.cfg.fps = 20; /* tolerance 12.5 ms: the first delays are the machine's, not ours to bound */
    r.cfg.sets.policy = CAP_POLICY_DROP;
    cap_capture *c = begin(&r);
    struct tally y = {0};
    consume(c, &y, 4, 50);
    cap_capture_stop(c);
    rest(c, &y, 4);
    T_OK(y.complete >= 50);
    check_pure(&y);
    check_sums(c, &y, 4);
    cap_capture_free(&c);
}

/* What is asked of matching, live: 1 ms of jitter, 100 ppm either way, 5 % lost, clocks of any epoch. */
static void eight_foreign_clocks_are_matched(void)
{
    static struct rig r;
    rig_init(&r, N, "");
    for (int i = 0; i < N; i++)
        snprintf(r.uri[i], sizeof r.uri[i],
                 "sim:skew_us=%g,drift_ppm=%d,jitter_us=1000,drop=0.05,seed=5", -1e12 + 3e9 * i,
                 i % 2 == 0 ? 100 : -100);
    r.cfg.shared_clock = false;
    r.cfg.fps = 30;
    cap_capture *c = begin(&r);
    struct tally y = {0};
    consume(c, &y, N, 90);
    cap_capture_stop(c);
    rest(c, &y, N);
    T_OK(y.complete >= 90);
    T_OK(y.sets > y.complete);
    check_pure(&y);
    check_sums(c, &y, N);
    cap_capture_free(&c);
}

static void camera_that_dies_comes_back(void)
{
    static struct rig r;
    rig_init(&r, 3, "");
    snprintf(r.uri[1], sizeof r.uri[1], "sim:die_after=20");
    cap_capture *c = begin(&r);
    struct tally y = {0};
    int64_t until = pvx_now_mono() + PATIENCE_NS;
    static struct cap_stats st;
    do { /* two lives at least */
        consume(c, &y, 3, y.complete + 5);
        cap_capture_stats(c, &st);
    } while (st.camera[1].count[CAP_LOST_CAMERA] < 2 && pvx_now_mono() < until);
    consume(c, &y, 3, y.complete + 5);
    cap_capture_stop(c);
    rest(c, &y, 3);
    T_OK(st.camera[1].count[CAP_LOST_CAMERA] >= 2);
    T_EQ_I(st.camera[0].count[CAP_LOST_CAMERA], 0);
    T_OK(y.frames[1] > 20);
    T_OK(y.sets > y.complete); /* the others went on while it was away */
    check_pure(&y);
    check_sums(c, &y, 3);
    cap_capture_free(&c);
}

static void silent_camera_is_noticed(void)
{
    static struct rig r;
    rig_init(&r, 3, "");
    snprintf(r.uri[2], sizeof r.uri[2], "sim:silent_after=10");
    cap_capture *c = begin(&r);
    struct tally y = {0};
    static struct cap_stats st;
    int64_t until = pvx_now_mono() + PATIENCE_NS;
    do {
        struct cap_set *s;
        if (cap_capture_next(c, PVX_NS_PER_S / 10, &s) == PVX_OK) {
            look(&y, s, 3);
            cap_set_release(s);
        }
        cap_capture_stats(c, &st);
    } while (st.camera[2].count[CAP_LOST_CAMERA] < 1 && pvx_now_mono() < until);
    T_OK(st.camera[2].count[CAP_LOST_CAMERA] >= 1);
    cap_capture_stop(c);
    rest(c, &y, 3);
    check_pure(&y);
    check_sums(c, &y, 3);
    cap_capture_free(&c);
}

static void absent_camera_is_named_and_not_waited_for(void)
{
    static struct rig r;
    rig_init(&r, N, "");
    snprintf(r.uri[5], sizeof r.uri[5], "sim:absent");
    r.cfg.sets.min_cameras = 7;
    cap_capture *c = begin(&r);
    struct tally y = {0};
    int64_t until = pvx_now_mono() + PATIENCE_NS;
    while (y.sets < 50 && pvx_now_mono() < until) {
        struct cap_set *s;
        if (cap_capture_next(c, PVX_NS_PER_S, &s) != PVX_OK)
            continue;
        look(&y, s, N);
        T_OK(s->frame[5] == NULL);
        cap_set_release(s);
    }
    T_OK(y.sets >= 50);
    static struct cap_stats st;
    cap_capture_stats(c, &st);
    T_EQ_I(st.camera[5].state, CAP_OPENING);
    T_CONTAINS(st.camera[5].error, "absent");
    T_EQ_I(st.camera[0].state, CAP_RUNNING);
    T_EQ_S(st.camera[0].error, "");
    cap_capture_stop(c);
    rest(c, &y, N);
    T_EQ_I(y.complete, 0);
    check_pure(&y);
    check_sums(c, &y, N);
    cap_capture_free(&c);
}

/* The others have been sending for long when the last one has been opened: wait is wait. */
static void camera_that_starts_late_is_waited_for(void)
{
    static struct rig r;
    rig_init(&r, N, "");
    snprintf(r.uri[3], sizeof r.uri[3], "sim:open_ms=300");
    r.cfg.sets = (struct cap_assembler_params){.policy = CAP_POLICY_WAIT};
    cap_capture *c = begin(&r);
    struct tally y = {0};
    consume(c, &y, N, 10);
    cap_capture_stop(c);
    T_OK(y.complete >= 10);
    T_EQ_I(y.sets, y.complete);
    rest(c, &y, N);
    check_pure(&y);
    check_sums(c, &y, N);
    cap_capture_free(&c);
}

static void frozen_and_short_frames_are_left_out(void)
{
    static struct rig r;
    rig_init(&r, 4, "");
    snprintf(r.uri[0], sizeof r.uri[0], "sim:freeze");
    snprintf(r.uri[3], sizeof r.uri[3], "sim:short_every=3");
    cap_capture *c = begin(&r);
    struct tally y = {0};
    static struct cap_stats st;
    int64_t until = pvx_now_mono() + PATIENCE_NS;
    do {
        struct cap_set *s;
        if (cap_capture_next(c, PVX_NS_PER_S, &s) == PVX_OK) {
            look(&y, s, 4);
            cap_set_release(s);
        }
        cap_capture_stats(c, &st);
    } while (pvx_now_mono() < until && (st.camera[0].count[CAP_BAD_STAMP] < 20 || y.sets < 20 ||
                                        st.camera[3].count[CAP_BAD_SIZE] < 5));
    cap_capture_stop(c);
    rest(c, &y, 4);
    cap_capture_stats(c, &st);
    T_OK(st.camera[0].count[CAP_BAD_STAMP] >= 20);
    T_LE(y.frames[0], 1);
    T_OK(st.camera[3].count[CAP_BAD_SIZE] >= 5);
    T_OK(y.sets >= 20);
    check_pure(&y);
    check_sums(c, &y, 4);
    cap_capture_free(&c);
}

static void wrong_format_is_counted_never_given_out(void)
{
    static struct rig r;
    rig_init(&r, 2, "");
    r.cam[0].width = 0; /* sim: refuses */
    r.cfg.sets.min_cameras = 1;
    cap_capture *c = begin(&r);
    struct tally y = {0};
    static struct cap_stats st;
    struct cap_set *s;
    T_EQ_I(cap_capture_next(c, PATIENCE_NS, &s), PVX_OK);
    look(&y, s, 2);
    cap_set_release(s);
    int64_t until = pvx_now_mono() + PATIENCE_NS;
    do {
        cap_capture_stats(c, &st);
    } while (st.camera[0].error[0] == '\0' && pvx_now_mono() < until);
    T_CONTAINS(st.camera[0].error, "size");
    cap_capture_free(&c);
}

static void software_trigger_sweeps_all(void)
{
    static struct rig r;
    rig_init(&r, 4, "");
    r.cfg.trigger = CAP_TRIGGER_SOFTWARE;
    r.cfg.fps = 20;
    r.cfg.sets.tolerance_ns = 20 * PVX_NS_PER_MS; /* sweeps of a busy machine */
    cap_capture *c = begin(&r);
    struct tally y = {0};
    consume(c, &y, 4, 20);
    cap_capture_stop(c);
    rest(c, &y, 4);
    T_OK(y.complete >= 20);
    T_EQ_I(y.wrong_camera, 0);
    T_EQ_I(y.backwards, 0);
    check_sums(c, &y, 4);
    cap_capture_free(&c);
}

static void ended_sources_close_the_capture(void)
{
    static struct rig r;
    rig_init(&r, 3, "end_after=10");
    snprintf(r.uri[2], sizeof r.uri[2], "sim:absent"); /* does not keep the run alive */
    cap_capture *c = begin(&r);
    struct tally y = {0};
    pvx_err e;
    int64_t until = pvx_now_mono() + PATIENCE_NS;
    do {
        struct cap_set *s;
        e = cap_capture_next(c, PVX_NS_PER_S, &s);
        if (e == PVX_OK) {
            look(&y, s, 3);
            cap_set_release(s);
        }
    } while (e != PVX_ECLOSED && pvx_now_mono() < until);
    T_EQ_I(e, PVX_ECLOSED);
    T_EQ_I(y.gaps, 0);
    check_sums(c, &y, 3);
    static struct cap_stats st;
    cap_capture_stats(c, &st);
    T_EQ_I(st.camera[0].state, CAP_ENDED);
    cap_capture_free(&c);
}

/* A consumer that sleeps: sets are displaced and counted, the newest come. */
static void slow_consumer_gets_the_newest(void)
{
    static struct rig r;
    rig_init(&r, 2, "");
    cap_capture *c = begin(&r);
    struct tally y = {0};
    static struct cap_stats st;
    int64_t until = pvx_now_mono() + PATIENCE_NS;
    do {
        pvx_sleep_until_mono(pvx_now_mono() + 50 * PVX_NS_PER_MS);
        struct cap_set *s;
        if (cap_capture_next(c, 0, &s) == PVX_OK) {
            look(&y, s, 2);
            cap_set_release(s);
        }
        cap_capture_stats(c, &st);
    } while (st.sets_dropped < 10 && pvx_now_mono() < until);
    cap_capture_stop(c);
    rest(c, &y, 2);
    T_OK(st.sets_dropped >= 10);
    T_OK(y.gaps > 0);
    check_pure(&y);
    check_sums(c, &y, 2);
    cap_capture_free(&c);
}

/* Frames that the consumer still holds stay valid after everything else has gone. */
static void sets_outlive_the_capture(void)
{
    static struct rig r;
    rig_init(&r, 2, "");
    cap_capture *c = begin(&r);
    struct cap_set *s;
    T_EQ_I(cap_capture_next(c, PATIENCE_NS, &s), PVX_OK);
    cap_capture_free(&c);
    struct tally y = {0};
    look(&y, s, 2);
    T_OK(y.sets == 1);
    cap_set_release(s);
}

static void *stopper(void *c)
{
    cap_capture_stop(c);
    return NULL;
}
static void stops_at_any_time(void)
{
    static struct rig r;
    for (int round = 0; round < 12; round++) {
        rig_init(&r, 4, round % 3 == 0 ? "open_ms=30" : round % 3 == 1 ? "absent" : "");
        cap_capture *c = begin(&r);
        pvx_sleep_until_mono(pvx_now_mono() + round * 3 * PVX_NS_PER_MS);
        pthread_t a, b;
        pthread_create(&a, NULL, stopper, c);
        pthread_create(&b, NULL, stopper, c);
        struct cap_set *s;
        pvx_err e;
        while ((e = cap_capture_next(c, PATIENCE_NS, &s)) == PVX_OK)
            cap_set_release(s);
        T_EQ_I(e, PVX_ECLOSED);
        pthread_join(a, NULL);
        pthread_join(b, NULL);
        cap_capture_free(&c);
    }
}

/* The driver sits in its open for longer than stop is willing to wait. */
static void stop_leaves_a_stuck_driver_behind(void)
{
    static struct rig r;
    rig_init(&r, 2, "");
    snprintf(r.uri[0], sizeof r.uri[0], "sim:open_ms=3600");
    cap_capture *c = begin(&r);
    pvx_sleep_until_mono(pvx_now_mono() + 20 * PVX_NS_PER_MS);
    int64_t t0 = pvx_now_mono();
    cap_capture_free(&c);
    T_OK(pvx_now_mono() - t0 < 20 * PVX_NS_PER_S);
    pvx_sleep_until_mono(t0 + 4200 * PVX_NS_PER_MS); /* it cleans up after itself: ASan, TSan */
}

static void bad_values_are_refused_by_name(void)
{
    static struct rig r;
    cap_capture *c;
    struct pvx_diag d = {""};
    rig_init(&r, 2, "");
    r.cam[1].uri = "usb:3";
    T_EQ_I(cap_capture_new(&r.cfg, &c, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "cam1");
    T_CONTAINS(d.text, "usb:3");
    T_CONTAINS(d.text, "sim:");
    T_OK(c == NULL);
    rig_init(&r, 2, "");
    r.cfg.sets.tolerance_ns = PERIOD_NS / 2;
    d.text[0] = '\0';
    T_EQ_I(cap_capture_new(&r.cfg, &c, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "tolerance");
    rig_init(&r, 2, "");
    r.cam[0].buffers = 3;
    T_EQ_I(cap_capture_new(&r.cfg, &c, NULL), PVX_EINVAL);
    r.cfg.n_cameras = 0;
    T_EQ_I(cap_capture_new(&r.cfg, &c, NULL), PVX_EINVAL);
}

int main(void)
{
    pvx_log_set_level(PVX_LOG_ERROR);
    T_RUN(eight_cameras_give_pure_sets);
    T_RUN(foreign_clocks_are_mapped);
    T_RUN(eight_foreign_clocks_are_matched);
    T_RUN(camera_that_dies_comes_back);
    T_RUN(silent_camera_is_noticed);
    T_RUN(absent_camera_is_named_and_not_waited_for);
    T_RUN(camera_that_starts_late_is_waited_for);
    T_RUN(frozen_and_short_frames_are_left_out);
    T_RUN(wrong_format_is_counted_never_given_out);
    T_RUN(software_trigger_sweeps_all);
    T_RUN(ended_sources_close_the_capture);
    T_RUN(slow_consumer_gets_the_newest);
    T_RUN(sets_outlive_the_capture);
    T_RUN(stops_at_any_time);
    T_RUN(stop_leaves_a_stuck_driver_behind);
    T_RUN(bad_values_are_refused_by_name);
    return t_done();
}
