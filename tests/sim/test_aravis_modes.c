/* Every way to make cameras expose together, on four GigE cameras of our own over real GVCP/GVSP: the
 * images say from which instant each frame of a set is. */
#include <arv.h>
#include <math.h>

#include "arvbed.h"

#define FPS 20.0

static int64_t now_ms(void)
{
    return pvx_now_mono() / MS;
}

static struct cap_capture_config capture_config(struct cap_source_config cameras[BED_CAMERAS])
{
    static char uri[BED_CAMERAS][32];
    for (int c = 0; c < BED_CAMERAS; c++) {
        cameras[c] = bed_source(c);
        snprintf(uri[c], sizeof uri[c], "aravis:%s", bed_address[c]);
        cameras[c].uri = uri[c];
        cameras[c].fps = 0;
    }
    return (struct cap_capture_config){.n_cameras = BED_CAMERAS,
                                       .camera = cameras,
                                       .fps = FPS,
                                       .discard_first = 1,
                                       .sets = {.max_wait_ns = 500 * MS}};
}

static cap_capture *start(const struct cap_capture_config *config)
{
    cap_capture *cap = NULL;
    struct pvx_diag d = {""};
    T_EQ_I(cap_capture_new(config, &cap, &d), PVX_OK);
    T_EQ_S(d.text, "");
    if (cap != NULL)
        T_EQ_I(cap_capture_start(cap, &d), PVX_OK);
    return cap;
}

/* n complete sets one after the other; all frames of each from the same instant, or, at most, `apart`
 * images from it.  The largest spread of exposures as they were mapped, ms; -1 = they did not come. */
static double sets_of_one_instant(cap_capture *cap, int n, int apart, const char *what)
{
    double most = 0, sum = 0;
    int got = 0, wrong = 0;
    for (int64_t end = now_ms() + 30000; got < n && now_ms() < end;) {
        struct cap_set *set;
        if (cap_capture_next(cap, PVX_NS_PER_S, &set) != PVX_OK)
            continue;
        int first = -1;
        for (int c = 0; c < BED_CAMERAS && set->n == BED_CAMERAS; c++) {
            int i = bed_truth(set->frame[c], c);
            first = c == 0 ? i : first;
            int d = abs(i - first) % BED_RING;
            wrong += i < 0 || (d > apart && BED_RING - d > apart);
        }
        if (set->n == BED_CAMERAS) {
            double spread = (double)set->spread_ns * 1e-6;
            got++;
            sum += spread;
            most = spread > most ? spread : most;
        }
        cap_set_release(set);
    }
    T_EQ_I(got, n);
    T_EQ_I(wrong, 0);
    printf("  %s: %d sets, spread mean %.3f ms, max %.3f ms\n", what, got, sum / (got + !got),
           most);
    return got == n ? most : -1;
}

static void stop(cap_capture *cap, struct cap_stats *st)
{
    cap_capture_stop(cap);
    cap_capture_stats(cap, st);
    cap_capture_free(&cap);
}

/* ---- free run --------------------------------------------------------------------------------- */

static void free_run_with_ptp(void)
{
    NEED_BED();
    bed_ring_fps = FPS;
    for (int c = 0; c < BED_CAMERAS; c++) { /* clocks of their own before: since power-up */
        struct cap_gvcam_config k = bed_config(c);
        k.boot_clock = true;
        k.tick_hz = 125e6;
        k.tai_offset_s = 37;
        bed_restart(c, &k);
    }
    struct cap_source_config cameras[BED_CAMERAS];
    struct cap_capture_config config = capture_config(cameras);
    for (int c = 0; c < BED_CAMERAS; c++)
        cameras[c].ptp = true;
    cap_capture *cap = start(&config);
    if (cap == NULL)
        return;
    sets_of_one_instant(cap, 30, 0, "free run, PTP");
    struct cap_stats st;
    cap_capture_stats(cap, &st);
    for (int c = 0; c < BED_CAMERAS; c++) {
        const struct cap_health *h = &st.camera[c].health;
        T_EQ_S(h->ptp, "Slave");
        T_LE(fabs(h->ptp_offset_ns), 1000);
        T_OK(isfinite(h->temperature_c));
        T_OK(h->clock.bound_ns > 0);
        T_EQ_I(h->address, 0x7F000002 + c);
        T_EQ_I(h->broadcast, 0x7FFFFFFF);
        /* its clock is TAI now */
        double ahead = (double)(h->clock.device_ns - h->clock.host_mono_ns -
                                (pvx_now_real() - pvx_now_mono()));
        T_NEAR(ahead * 1e-9, 37, 0.05);
    }
    stop(cap, &st);
}

static void without_a_ptp_master_nothing_is_taken(void)
{
    NEED_BED();
    bed_all(FPS);
    bed_fault(2, (struct cap_gvcam_fault){.no_ptp_master = true});
    struct cap_source_config cameras[BED_CAMERAS];
    struct cap_capture_config config = capture_config(cameras);
    for (int c = 0; c < BED_CAMERAS; c++)
        cameras[c].ptp = true;
    config.sets.policy = CAP_POLICY_DROP;
    cap_capture *cap = start(&config);
    if (cap == NULL)
        return;
    struct cap_stats st = {0};
    for (int64_t end = now_ms() + 20000; st.camera[2].error[0] == '\0' && now_ms() < end;) {
        usleep(20000);
        cap_capture_stats(cap, &st);
    }
    T_CONTAINS(st.camera[2].error,
               "camera c (aravis:127.0.0.4): its clock is not synchronized: PTP "
               "says Listening");
    T_EQ_I(st.camera[2].count[CAP_RECEIVED], 0);
    bed_fault(2, (struct cap_gvcam_fault){0});
    sets_of_one_instant(cap, 5, 0, "free run, PTP master found");
    /* and lost again while it runs: the frames go on, the state is told */
    bed_fault(1, (struct cap_gvcam_fault){.ptp_offset_us = 400});
    for (int64_t end = now_ms() + 20000; now_ms() < end;) {
        cap_capture_stats(cap, &st);
        if (st.camera[1].health.ptp_offset_ns > 300e3)
            break;
        usleep(20000);
    }
    T_NEAR(st.camera[1].health.ptp_offset_ns * 1e-3, 400, 20);
    T_EQ_I(st.camera[1].count[CAP_LOST_CAMERA], 0);
    stop(cap, &st);
}

/* ---- triggers --------------------------------------------------------------------------------- */

static void hardware_line(void)
{
    NEED_BED();
    bed_all(100);
    struct cap_source_config cameras[BED_CAMERAS];
    struct cap_capture_config config = capture_config(cameras);
    config.trigger = CAP_TRIGGER_LINE;
    cap_capture *cap = start(&config);
    if (cap == NULL)
        return;
    cap_gvnet_line(bed_net, FPS);
    sets_of_one_instant(cap, 30, 0, "line");
    cap_gvnet_line(bed_net, 0);
    struct cap_stats st;
    stop(cap, &st);
    for (int c = 0; c < BED_CAMERAS; c++)
        T_LE(30, bed_stats(c).triggers);
}

static struct cap_stats stats_when(cap_capture *cap, enum cap_count what)
{
    struct cap_stats st;
    int64_t end = now_ms() + 20000;
    for (bool all = false; !all && now_ms() < end; usleep(20000)) {
        cap_capture_stats(cap, &st);
        all = true;
        for (int c = 0; c < BED_CAMERAS; c++)
            all &= st.camera[c].count[what] > 0;
    }
    return st;
}

/* Setting a trigger sets an edge as well: what the configuration says of triggers comes after it. */
static void trigger_features_have_the_last_word(void)
{
    NEED_BED();
    bed_all(100);
    struct cap_feature edge = {"TriggerActivation", "FallingEdge"};
    struct cap_source_config cameras[BED_CAMERAS];
    struct cap_capture_config config = capture_config(cameras);
    config.trigger = CAP_TRIGGER_LINE;
    cameras[1].features = &edge;
    cameras[1].n_features = 1;
    cap_capture *cap = start(&config);
    if (cap == NULL)
        return;
    cap_gvnet_line(bed_net, FPS);
    sets_of_one_instant(cap, 3, 0, "line, one on the falling edge");
    struct cap_stats now;
    cap_capture_stats(cap, &now);
    T_EQ_S(now.camera[1].error, "");
    for (int c = 0; c < 2; c++) { /* another program may read */
        ArvCamera *other = arv_camera_new(c == 0 ? "127.0.0.2" : "127.0.0.3", NULL);
        T_OK(other != NULL);
        if (other == NULL)
            continue;
        T_EQ_S(arv_camera_get_string(other, "TriggerActivation", NULL),
               c == 0 ? "RisingEdge" : "FallingEdge");
        g_object_unref(other);
    }
    cap_gvnet_line(bed_net, 0);
    struct cap_stats st;
    stop(cap, &st);
}

/* A generator that is switched off is not a camera that is lost: nothing is opened anew, and the first
 * pulse makes a set again. */
static void line_without_pulses(void)
{
    NEED_BED();
    bed_all(100);
    struct cap_source_config cameras[BED_CAMERAS];
    struct cap_capture_config config = capture_config(cameras);
    config.trigger = CAP_TRIGGER_LINE;
    cap_capture *cap = start(&config);
    if (cap == NULL)
        return;
    cap_gvnet_line(bed_net, FPS);
    sets_of_one_instant(cap, 5, 0, "line");
    cap_gvnet_line(bed_net, 0);
    struct cap_stats st = stats_when(cap, CAP_NO_TRIGGER);
    usleep(1500000); /* twice what silence may last */
    cap_capture_stats(cap, &st);
    for (int c = 0; c < BED_CAMERAS; c++) {
        T_EQ_I(st.camera[c].count[CAP_NO_TRIGGER], 1);
        T_EQ_I(st.camera[c].count[CAP_LOST_CAMERA], 0);
        T_EQ_I(st.camera[c].state, CAP_RUNNING);
        T_EQ_I(st.camera[c].n_troubles, 1);
        T_EQ_I(st.camera[c].trouble[0].cause, CAP_NO_TRIGGER);
    }
    cap_gvnet_line(bed_net, FPS);
    sets_of_one_instant(cap, 5, 0, "line again");
    cap_gvnet_line(bed_net, 0);
    stop(cap, &st);
}

/* The commands reach one camera after the other: a few of 10 ms may lie between on a busy machine. */
static void software_to_all(void)
{
    NEED_BED();
    bed_all(100);
    struct cap_source_config cameras[BED_CAMERAS];
    struct cap_capture_config config = capture_config(cameras);
    config.trigger = CAP_TRIGGER_SOFTWARE;
    cap_capture *cap = start(&config);
    if (cap == NULL)
        return;
    sets_of_one_instant(cap, 30, 2, "software");
    struct cap_stats st;
    stop(cap, &st);
}

static void action_at_once(void)
{
    NEED_BED();
    bed_all(100);
    struct cap_source_config cameras[BED_CAMERAS];
    struct cap_capture_config config = capture_config(cameras);
    config.trigger = CAP_TRIGGER_ACTION;
    config.action = (struct cap_action_config){.keys = {0xCAFE, 7, 0x11}, .acknowledge = true};
    cap_capture *cap = start(&config);
    if (cap == NULL)
        return;
    /* one datagram, four cameras: one image further when it came at the turn of an image */
    sets_of_one_instant(cap, 30, 1, "action command");
    struct cap_stats st;
    cap_capture_stats(cap, &st);
    uint64_t before = st.camera[3].action.silent;
    cap_gvcam_free(&bed_cam[3]); /* a dead one does not answer */
    for (int64_t end = now_ms() + 10000; st.camera[3].action.silent == before && now_ms() < end;) {
        usleep(20000);
        cap_capture_stats(cap, &st);
    }
    T_LE(before + 1, st.camera[3].action.silent);
    stop(cap, &st);
    T_LE(30, st.action.sent);
    T_EQ_I(st.action.failed, 0);
    for (int c = 0; c < 3; c++) {
        T_LE(30, st.camera[c].action.acknowledged);
        T_EQ_I(st.camera[c].action.refused, 0);
    }
}

static cap_capture *start_scheduled(struct cap_source_config cameras[BED_CAMERAS], double lead_ms)
{
    bed_ring_fps = 100;
    for (int c = 0; c < BED_CAMERAS; c++) {
        struct cap_gvcam_config k = bed_config(c);
        k.tai_offset_s = 37;
        bed_restart(c, &k);
    }
    struct cap_capture_config config = capture_config(cameras);
    config.trigger = CAP_TRIGGER_ACTION;
    config.action = (struct cap_action_config){
        .keys = {1, 1, 1}, .lead_ns = (int64_t)(lead_ms * 1e6), .acknowledge = true};
    for (int c = 0; c < BED_CAMERAS; c++)
        cameras[c].ptp = true;
    return start(&config);
}

static void scheduled_action(void)
{
    NEED_BED();
    struct cap_source_config cameras[BED_CAMERAS];
    cap_capture *cap = start_scheduled(cameras, 30);
    if (cap == NULL)
        return;
    sets_of_one_instant(cap, 30, 0, "scheduled action command");
    struct cap_stats st;
    cap_capture_stats(cap, &st);
    T_LE(30, st.action.sent);
    for (int c = 0; c < BED_CAMERAS; c++)
        T_LE(30, st.camera[c].action.acknowledged);
    /* a camera that has lost its master says so, each time */
    bed_fault(1, (struct cap_gvcam_fault){.no_ptp_master = true});
    for (int64_t end = now_ms() + 10000; st.camera[1].action.no_clock == 0 && now_ms() < end;) {
        usleep(20000);
        cap_capture_stats(cap, &st);
    }
    T_LE(1, st.camera[1].action.no_clock);
    T_EQ_I(st.camera[0].action.no_clock, 0);
    stop(cap, &st);
}

/* A lead that no host can keep: nothing is sent late, everything is counted. */
static void a_late_command_is_not_sent(void)
{
    NEED_BED();
    struct cap_source_config cameras[BED_CAMERAS];
    cap_capture *cap = start_scheduled(cameras, 1e-6);
    if (cap == NULL)
        return;
    struct cap_stats st = {0};
    for (int64_t end = now_ms() + 20000; st.action.late < 10 && now_ms() < end;) {
        usleep(20000);
        cap_capture_stats(cap, &st);
    }
    stop(cap, &st);
    T_LE(10, st.action.late);
    T_EQ_I(st.action.sent, 0);
    for (int c = 0; c < BED_CAMERAS; c++)
        T_EQ_I(bed_stats(c).triggers, 0);
}

/* ---- what a camera says about its frames and its clock ------------------------------------------ */

/* Ticks of 8 ns, and how far the camera's clock is from the host's. */
static void clock_readings_and_ticks(void)
{
    NEED_BED();
    struct session s;
    bed_ring_fps = FPS;
    struct cap_gvcam_config k = bed_config(0);
    k.tick_hz = 125e6;
    bed_restart(0, &k);
    bed_fault(0, (struct cap_gvcam_fault){.skew_us = 250000});
    struct cap_source_config config = bed_source(0);
    if (begin(&s, &config)) {
        for (int i = 0; i < 5 && take_good(&s); i++)
            ;
        int64_t grid = (int64_t)(1e9 / FPS), off = (s.last_stamp - 250 * MS) % grid;
        T_LE(off < grid / 2 ? off : grid - off, 16); /* on the images' grid, to two ticks */
        int readings = 0;
        for (int64_t end = now_ms() + 10000; readings == 0 && now_ms() < end;) {
            usleep(10000);
            pthread_mutex_lock(&s.box.lock);
            readings = s.box.readings;
            pthread_mutex_unlock(&s.box.lock);
        }
        T_LE(1, readings);
        int64_t skew = s.box.device_ns - (s.box.mono_ns + pvx_now_real() - pvx_now_mono());
        printf("  clock read to +-%.3f ms\n", (double)s.box.bound_ns * 1e-6);
        T_LE(fabs((double)skew - 250e6), (double)s.box.bound_ns + 100e3);
    }
    end(&s);
}

static void chunks_tell_exposure_and_gain(void)
{
    NEED_BED();
    static const char *const layouts[] = {"ExtendedChunk", "ImageExtendedChunk"};
    bed_all(FPS);
    for (int i = 0; i < 2; i++) {
        struct session s;
        struct cap_feature layout = {"ChunkPayloadType", ""};
        struct cap_source_config config = bed_source(i);
        snprintf(layout.value, sizeof layout.value, "%s", layouts[i]);
        config.chunks = true;
        config.exposure_us = 2500;
        config.gain = 6;
        config.features = &layout;
        config.n_features = 1;
        if (begin(&s, &config)) {
            for (int n = 0; n < 5; n++) {
                struct cap_frame *f = next_frame(&s.box);
                T_OK(f != NULL);
                if (f == NULL)
                    break;
                T_OK(f->img.size >= BED_BYTES &&
                     memcmp(f->img.data, bed_image[i][((const unsigned char *)f->img.data)[0]],
                            BED_BYTES) == 0);
                if (i == 1) {
                    T_NEAR(f->exposure_us, 2500, 0.01);
                    T_NEAR(f->gain, 6, 1e-3);
                } else { /* not read by Aravis, and no reason to lose the frame */
                    T_OK(isnan(f->exposure_us) && isnan(f->gain));
                }
                T_EQ_I(f->t_device_ns % (int64_t)(1e9 / FPS), 0);
                cap_frame_release(f);
            }
            T_EQ_I(counted(&s.box, CAP_INCOMPLETE), 0);
        }
        end(&s);
    }
}

int main(void)
{
    bed_open();
    T_RUN(free_run_with_ptp);
    T_RUN(without_a_ptp_master_nothing_is_taken);
    T_RUN(hardware_line);
    T_RUN(line_without_pulses);
    T_RUN(trigger_features_have_the_last_word);
    T_RUN(software_to_all);
    T_RUN(action_at_once);
    T_RUN(scheduled_action);
    T_RUN(a_late_command_is_not_sent);
    T_RUN(clock_readings_and_ticks);
    T_RUN(chunks_tell_exposure_and_gain);
    bed_close();
    return t_done();
}
