/* test_capture_sim.c - the whole capture layer on simulated cameras: every set holds one instant,
 * every frame is accounted for, broken cameras do not hold up the others.
 * Deadlines are generous and nothing asserts on a rate: the machine may be busy. */
#include "tests/lib/rig.h"

#include <pthread.h>

#define N         8
#define PERIOD_NS 10000000LL

static struct rig r;

static void options(uint32_t n, const char *options)
{
    char uri[128];
    struct cap_source_config one = sim_camera();
    snprintf(uri, sizeof uri, "sim:%s", options);
    one.uri = uri;
    rig_init(&r, n, 1e9 / PERIOD_NS, one);
    r.cfg.shared_clock = true;
    r.cfg.sets.min_cameras = 2;
    r.cfg.sets.max_wait_ns = 2 * PVX_NS_PER_S;
}

/* What the sets say, gathered over a run. */
struct tally {
    uint64_t frames[CAP_MAX_CAMERAS], sets, complete, mixed, backwards, wrong_camera, gaps;
    int64_t last_t;
    uint64_t next_number;
};
static struct tally y;

static void begin(void)
{
    y = (struct tally){0};
    rig_start(&r);
}

static void look(const struct cap_set *s)
{
    int64_t t = 0;
    uint32_t members = 0, n = r.cfg.n_cameras;
    for (uint32_t i = 0; i < n; i++) {
        const struct cap_frame *f = s->frame[i];
        if (f == NULL)
            continue;
        struct truth truth;
        memcpy(&truth, f->img.data, sizeof truth);
        y.frames[i]++;
        members++;
        y.mixed += t != 0 && truth.t != t;
        y.wrong_camera += truth.camera != i || f->camera != i;
        t = truth.t;
    }
    T_EQ_I(members, s->n);
    y.sets++;
    y.complete += members == n;
    y.backwards += t <= y.last_t;
    y.last_t = t;
    y.gaps += s->number != y.next_number;
    y.next_number = s->number + 1;
}

/* The next set, if one comes by then. */
static pvx_err look_next(int64_t wait_ns)
{
    struct cap_set *s;
    pvx_err e = cap_capture_next(r.cap, wait_ns, &s);
    if (e == PVX_OK) {
        look(s);
        cap_set_release(s);
    }
    return e;
}

/* Sets until so many were complete, or the capture closes. */
static void consume(uint64_t want)
{
    pvx_err e = PVX_OK;
    UNTIL (y.complete >= want || e == PVX_ECLOSED)
        e = look_next(PVX_NS_PER_S);
}

/* Stop, take what is left: everything is accounted for. */
static void finish(void)
{
    cap_capture_stop(r.cap);
    while (look_next(0) == PVX_OK)
        ;
    rig_stats(&r);
    for (uint32_t i = 0; i < r.cfg.n_cameras; i++) {
        const uint64_t *k = r.st.camera[i].count;
        T_EQ_I(k[CAP_RECEIVED], y.frames[i] + k[CAP_LATE] + k[CAP_UNMATCHED] + k[CAP_OVERFLOW]);
    }
    T_EQ_I(r.st.sets_complete + r.st.sets_partial, y.sets + r.st.sets_dropped);
    T_EQ_I(r.st.spread.count, r.st.sets_complete + r.st.sets_partial);
    T_EQ_I(y.wrong_camera, 0);
    T_EQ_I(y.backwards, 0);
    cap_capture_free(&r.cap);
    T_OK(r.cap == NULL);
}

static void finish_pure(void)
{
    finish();
    T_EQ_I(y.mixed, 0);
}

T_CASE(eight_cameras_give_pure_sets)
{
    options(N, "");
    for (int i = 0; i < N; i++) /* below the tolerance together: 2.5 ms */
        snprintf(r.uri[i], sizeof r.uri[i], "sim:skew_us=%d,drop=0.05,jitter_us=500,seed=3",
                 i * 100);
    r.cfg.discard_first = 1;
    begin();
    consume(100);
    finish_pure();
    T_OK(y.complete >= 100);
    T_OK(y.sets > y.complete); /* 5 % of the frames were dropped */
    for (int i = 0; i < N; i++) {
        T_OK(r.st.camera[i].count[CAP_ID_GAP] > 0);
        T_EQ_I(r.st.camera[i].count[CAP_BAD_SIZE], 0);
        T_EQ_S(r.st.camera[i].error, "");
    }
    T_OK(pvx_hist_quantile(&r.st.spread, 0.5) > 600000);
    T_LE(r.st.spread.max_ns, 2500000);
}

/* Clocks that are not the host's: offset by hours, drifting, delivered at random times. */
T_CASE(foreign_clocks_are_mapped)
{
    options(4, "");
    for (int i = 0; i < 4; i++)
        snprintf(r.uri[i], sizeof r.uri[i], "sim:skew_us=%g,drift_ppm=%d,jitter_us=300",
                 -1e10 * (i + 1), 40 * i - 60);
    r.cfg.shared_clock = false;
    r.cfg.fps = 20; /* tolerance 12.5 ms: the first delays are the machine's, not ours to bound */
    r.cfg.sets.policy = CAP_POLICY_DROP;
    begin();
    consume(50);
    finish_pure();
    T_OK(y.complete >= 50);
}

/* What is asked of matching, live: 1 ms of jitter, 100 ppm either way, 5 % lost, clocks of any epoch. */
T_CASE(eight_foreign_clocks_are_matched)
{
    options(N, "");
    for (int i = 0; i < N; i++)
        snprintf(r.uri[i], sizeof r.uri[i],
                 "sim:skew_us=%g,drift_ppm=%d,jitter_us=1000,drop=0.05,seed=5", -1e12 + 3e9 * i,
                 i % 2 == 0 ? 100 : -100);
    r.cfg.shared_clock = false;
    r.cfg.fps = 30;
    begin();
    consume(90);
    finish_pure();
    T_OK(y.complete >= 90);
    T_OK(y.sets > y.complete);
}

T_CASE(camera_that_dies_comes_back)
{
    options(3, "");
    snprintf(r.uri[1], sizeof r.uri[1], "sim:die_after=20");
    begin();
    UNTIL (rig_stats(&r)->camera[1].count[CAP_LOST_CAMERA] >= 2) /* two lives at least */
        consume(y.complete + 5);
    consume(y.complete + 5);
    finish_pure();
    T_OK(r.st.camera[1].count[CAP_LOST_CAMERA] >= 2);
    T_EQ_I(r.st.camera[0].count[CAP_LOST_CAMERA], 0);
    T_OK(y.frames[1] > 20);
    T_OK(y.sets > y.complete); /* the others went on while it was away */
}

T_CASE(silent_camera_is_noticed)
{
    options(3, "");
    snprintf(r.uri[2], sizeof r.uri[2], "sim:silent_after=10");
    begin();
    UNTIL (rig_stats(&r)->camera[2].count[CAP_LOST_CAMERA] >= 1)
        look_next(PVX_NS_PER_S / 10);
    T_OK(r.st.camera[2].count[CAP_LOST_CAMERA] >= 1);
    finish_pure();
}

T_CASE(absent_camera_is_named_and_not_waited_for)
{
    options(N, "");
    snprintf(r.uri[5], sizeof r.uri[5], "sim:absent");
    r.cfg.sets.min_cameras = 7;
    begin();
    UNTIL (y.sets >= 50)
        look_next(PVX_NS_PER_S);
    T_OK(y.sets >= 50);
    T_EQ_I(y.frames[5], 0);
    rig_stats(&r);
    T_EQ_I(r.st.camera[5].state, CAP_OPENING);
    T_CONTAINS(r.st.camera[5].error, "absent");
    T_EQ_I(r.st.camera[0].state, CAP_RUNNING);
    T_EQ_S(r.st.camera[0].error, "");
    finish_pure();
    T_EQ_I(y.complete, 0);
}

/* The others have been sending for long when the last one has been opened: wait is wait. */
T_CASE(camera_that_starts_late_is_waited_for)
{
    options(N, "");
    snprintf(r.uri[3], sizeof r.uri[3], "sim:open_ms=300");
    r.cfg.sets = (struct cap_assembler_params){.policy = CAP_POLICY_WAIT};
    begin();
    consume(10);
    T_OK(y.complete >= 10);
    T_EQ_I(y.sets, y.complete);
    finish_pure();
}

T_CASE(frozen_and_short_frames_are_left_out)
{
    options(4, "");
    snprintf(r.uri[0], sizeof r.uri[0], "sim:freeze");
    snprintf(r.uri[3], sizeof r.uri[3], "sim:short_every=3");
    begin();
    UNTIL (rig_stats(&r)->camera[0].count[CAP_BAD_STAMP] >= 20 && y.sets >= 20 &&
           r.st.camera[3].count[CAP_BAD_SIZE] >= 5)
        look_next(PVX_NS_PER_S);
    finish_pure();
    T_OK(r.st.camera[0].count[CAP_BAD_STAMP] >= 20);
    T_LE(y.frames[0], 1);
    T_OK(r.st.camera[3].count[CAP_BAD_SIZE] >= 5);
    T_OK(y.sets >= 20);
}

T_CASE(wrong_format_is_counted_never_given_out)
{
    options(2, "");
    r.cam[0].width = 0; /* sim: refuses */
    r.cfg.sets.min_cameras = 1;
    begin();
    T_EQ_I(look_next(PATIENCE_NS), PVX_OK);
    UNTIL (rig_stats(&r)->camera[0].error[0] != '\0')
        ;
    T_CONTAINS(r.st.camera[0].error, "size");
    rig_end(&r);
}

T_CASE(software_trigger_sweeps_all)
{
    options(4, "");
    r.cfg.trigger = CAP_TRIGGER_SOFTWARE;
    r.cfg.fps = 20;
    r.cfg.sets.tolerance_ns = 20 * PVX_NS_PER_MS; /* sweeps of a busy machine */
    begin();
    consume(20);
    finish();
    T_OK(y.complete >= 20);
}

T_CASE(ended_sources_close_the_capture)
{
    options(3, "end_after=10");
    snprintf(r.uri[2], sizeof r.uri[2], "sim:absent"); /* does not keep the run alive */
    begin();
    pvx_err e = PVX_OK;
    UNTIL (e == PVX_ECLOSED)
        e = look_next(PVX_NS_PER_S);
    T_EQ_I(e, PVX_ECLOSED);
    T_LE(y.gaps,
         rig_stats(&r)->sets_dropped); /* none, but what a consumer that was held up missed */
    T_EQ_I(rig_stats(&r)->camera[0].state, CAP_ENDED);
    finish();
}

/* A consumer that sleeps: sets are displaced and counted, the newest come. */
T_CASE(slow_consumer_gets_the_newest)
{
    options(2, "");
    begin();
    UNTIL (rig_stats(&r)->sets_dropped >= 10) {
        pvx_sleep_until_mono(pvx_now_mono() + 50 * PVX_NS_PER_MS);
        look_next(0);
    }
    finish_pure();
    T_OK(r.st.sets_dropped >= 10);
    T_OK(y.gaps > 0);
}

/* Frames that the consumer still holds stay valid after everything else has gone. */
T_CASE(sets_outlive_the_capture)
{
    options(2, "");
    begin();
    struct cap_set *s;
    T_EQ_I(cap_capture_next(r.cap, PATIENCE_NS, &s), PVX_OK);
    cap_capture_free(&r.cap);
    look(s);
    T_OK(y.sets == 1);
    cap_set_release(s);
}

static void *stopper(void *c)
{
    cap_capture_stop(c);
    return NULL;
}
T_CASE(stops_at_any_time)
{
    for (int round = 0; round < 12; round++) {
        options(4, round % 3 == 0 ? "open_ms=30" : round % 3 == 1 ? "absent" : "");
        begin();
        pvx_sleep_until_mono(pvx_now_mono() + round * 3 * PVX_NS_PER_MS);
        pthread_t a, b;
        pthread_create(&a, NULL, stopper, r.cap);
        pthread_create(&b, NULL, stopper, r.cap);
        struct cap_set *s;
        pvx_err e;
        while ((e = cap_capture_next(r.cap, PATIENCE_NS, &s)) == PVX_OK)
            cap_set_release(s);
        T_EQ_I(e, PVX_ECLOSED);
        pthread_join(a, NULL);
        pthread_join(b, NULL);
        cap_capture_free(&r.cap);
    }
}

/* The driver sits in its open for longer than stop is willing to wait. */
T_CASE(stop_leaves_a_stuck_driver_behind)
{
    options(2, "");
    snprintf(r.uri[0], sizeof r.uri[0], "sim:open_ms=3600");
    begin();
    pvx_sleep_until_mono(pvx_now_mono() + 20 * PVX_NS_PER_MS);
    int64_t t0 = pvx_now_mono();
    cap_capture_free(&r.cap);
    T_OK(pvx_now_mono() - t0 < 20 * PVX_NS_PER_S);
    pvx_sleep_until_mono(t0 + 4200 * PVX_NS_PER_MS); /* it cleans up after itself: ASan, TSan */
}

T_CASE(bad_values_are_refused_by_name)
{
    cap_capture *c;
    struct pvx_diag d = {""};
    options(2, "");
    r.cam[1].uri = "usb:3";
    T_EQ_I(cap_capture_new(&r.cfg, &c, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "cam1");
    T_CONTAINS(d.text, "usb:3");
    T_CONTAINS(d.text, "sim:");
    T_OK(c == NULL);
    options(2, "");
    r.cfg.sets.tolerance_ns = PERIOD_NS / 2;
    d.text[0] = '\0';
    T_EQ_I(cap_capture_new(&r.cfg, &c, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "tolerance");
    options(2, "");
    r.cam[0].buffers = 3;
    T_EQ_I(cap_capture_new(&r.cfg, &c, NULL), PVX_EINVAL);
    r.cfg.n_cameras = 0;
    T_EQ_I(cap_capture_new(&r.cfg, &c, NULL), PVX_EINVAL);
}

int main(void)
{
    pvx_log_set_level(PVX_LOG_ERROR);
    return t_run();
}
