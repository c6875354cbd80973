/* Every way to make cameras expose together, on four GigE cameras of our own over real GVCP/GVSP: the
 * images say from which instant each frame of a set is. */
#include <arv.h>
#include <math.h>

#include "tests/lib/arvbed.h"

#define FPS 20.0

static struct rig r;

/* n complete sets one after the other; all frames of each from the same instant, or, at most, `apart`
 * images from it. */
static void sets_of_one_instant(int n, int apart, const char *what)
{
    double most = 0, sum = 0;
    int got = 0, wrong = 0;
    UNTIL (got >= n) {
        struct cap_set *set;
        if (cap_capture_next(r.cap, PVX_NS_PER_S, &set) != PVX_OK)
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
}

/* ---- free run --------------------------------------------------------------------------------- */

T_CASE(free_run_with_ptp)
{
    bed_ring_fps = FPS;
    for (int c = 0; c < BED_CAMERAS; c++) { /* clocks of their own before: since power-up */
        struct cap_gvcam_config k = bed_config(c);
        k.boot_clock = true;
        k.tick_hz = 125e6;
        k.tai_offset_s = 37;
        bed_restart(c, &k);
    }
    bed_together(&r, FPS, CAP_TRIGGER_FREE_RUN, true);
    rig_start(&r);
    static const char *const serial[] = {"T00", "T01", "T02", "T03"};
    sets_of_one_instant(30, 0, "free run, PTP");
    rig_stats(&r);
    for (int c = 0; c < BED_CAMERAS; c++) {
        const struct cap_health *h = &r.st.camera[c].health;
        T_EQ_S(h->ptp, "Slave");
        T_LE(fabs(h->ptp_offset_ns), 1000);
        T_OK(isfinite(h->temperature_c));
        T_EQ_S(h->serial, serial[c]);
        T_OK(h->clock.bound_ns > 0);
        T_EQ_I(h->address, 0x7F000002 + c);
        T_EQ_I(h->broadcast, 0x7FFFFFFF);
        /* its clock is TAI now */
        double ahead = (double)(h->clock.device_ns - h->clock.host_mono_ns -
                                (pvx_now_real() - pvx_now_mono()));
        T_NEAR(ahead * 1e-9, 37, 0.05);
    }
    rig_end(&r);
}

T_CASE(without_a_ptp_master_nothing_is_exposed)
{
    bed_all(FPS);
    bed_fault(2, (struct cap_gvcam_fault){.no_ptp_master = true});
    bed_together(&r, FPS, CAP_TRIGGER_FREE_RUN, true);
    r.cfg.sets.policy = CAP_POLICY_DROP;
    rig_start(&r);
    UNTIL (r.st.camera[2].error[0] != '\0')
        rig_wait(&r);
    T_CONTAINS(r.st.camera[2].error,
               "camera c (aravis:127.0.0.4): its clock is not synchronized: PTP "
               "says Listening");
    T_EQ_I(r.st.camera[2].count[CAP_RECEIVED], 0);
    bed_fault(2, (struct cap_gvcam_fault){0});
    sets_of_one_instant(5, 0, "free run, PTP master found");
    /* and lost again while it runs: the frames go on, the state is told */
    bed_fault(1, (struct cap_gvcam_fault){.ptp_offset_us = 400});
    UNTIL (rig_stats(&r)->camera[1].health.ptp_offset_ns > 300e3)
        usleep(20000);
    T_NEAR(r.st.camera[1].health.ptp_offset_ns * 1e-3, 400, 20);
    T_EQ_I(r.st.camera[1].count[CAP_LOST_CAMERA], 0);
    rig_end(&r);
}

/* ---- triggers --------------------------------------------------------------------------------- */

T_CASE(hardware_line)
{
    bed_all(100);
    bed_together(&r, FPS, CAP_TRIGGER_LINE, false);
    rig_start(&r);
    cap_gvnet_line(bed_net, FPS);
    sets_of_one_instant(30, 0, "line");
    cap_gvnet_line(bed_net, 0);
    rig_end(&r);
    for (int c = 0; c < BED_CAMERAS; c++)
        T_LE(30, bed_stats(c).triggers);
}

/* Setting a trigger sets an edge as well: what the configuration says of triggers comes after it. */
T_CASE(trigger_features_have_the_last_word)
{
    bed_all(100);
    struct cap_feature edge = {"TriggerActivation", "FallingEdge"};
    bed_together(&r, FPS, CAP_TRIGGER_LINE, false);
    r.cam[1].features = &edge;
    r.cam[1].n_features = 1;
    rig_start(&r);
    cap_gvnet_line(bed_net, FPS);
    sets_of_one_instant(3, 0, "line, one on the falling edge");
    rig_stats(&r);
    T_EQ_S(r.st.camera[1].error, "");
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
    rig_end(&r);
}

/* A generator that is switched off is not a camera that is lost: nothing is opened anew, and the first
 * pulse makes a set again. */
T_CASE(line_without_pulses)
{
    bed_all(100);
    bed_together(&r, FPS, CAP_TRIGGER_LINE, false);
    rig_start(&r);
    cap_gvnet_line(bed_net, FPS);
    sets_of_one_instant(5, 0, "line");
    cap_gvnet_line(bed_net, 0);
    for (int c = 0; c < BED_CAMERAS; c++)
        T_OK(rig_counts(&r, (uint32_t)c, CAP_NO_TRIGGER, 1));
    usleep(1500000); /* twice what silence may last */
    rig_stats(&r);
    for (int c = 0; c < BED_CAMERAS; c++) {
        T_EQ_I(r.st.camera[c].count[CAP_NO_TRIGGER], 1);
        T_EQ_I(r.st.camera[c].count[CAP_LOST_CAMERA], 0);
        T_EQ_I(r.st.camera[c].state, CAP_RUNNING);
        T_EQ_I(r.st.camera[c].n_troubles, 1);
        T_EQ_I(r.st.camera[c].trouble[0].cause, CAP_NO_TRIGGER);
    }
    cap_gvnet_line(bed_net, FPS);
    sets_of_one_instant(5, 0, "line again");
    cap_gvnet_line(bed_net, 0);
    rig_end(&r);
}

/* The commands reach one camera after the other: a few of 10 ms may lie between on a busy machine. */
T_CASE(software_to_all)
{
    bed_all(100);
    bed_together(&r, FPS, CAP_TRIGGER_SOFTWARE, false);
    rig_start(&r);
    sets_of_one_instant(30, 2, "software");
    rig_end(&r);
}

T_CASE(action_at_once)
{
    bed_all(100);
    bed_together(&r, FPS, CAP_TRIGGER_ACTION, false);
    r.cfg.action = (struct cap_action_config){.keys = {0xCAFE, 7, 0x11}, .acknowledge = true};
    rig_start(&r);
    /* one datagram, four cameras: one image further when it came at the turn of an image */
    sets_of_one_instant(30, 1, "action command");
    rig_stats(&r);
    uint64_t before = r.st.camera[3].action.silent;
    cap_gvcam_free(&bed_cam[3]); /* a dead one does not answer */
    UNTIL (r.st.camera[3].action.silent != before)
        rig_wait(&r);
    T_LE(before + 1, r.st.camera[3].action.silent);
    rig_end(&r);
    T_LE(30, r.st.action.sent);
    T_EQ_I(r.st.action.failed, 0);
    for (int c = 0; c < 3; c++) {
        T_LE(30, r.st.camera[c].action.acknowledged);
        T_EQ_I(r.st.camera[c].action.refused, 0);
    }
}

static void start_scheduled(double lead_ms)
{
    bed_ring_fps = 100;
    for (int c = 0; c < BED_CAMERAS; c++) {
        struct cap_gvcam_config k = bed_config(c);
        k.tai_offset_s = 37;
        bed_restart(c, &k);
    }
    bed_together(&r, FPS, CAP_TRIGGER_ACTION, true);
    r.cfg.action = (struct cap_action_config){
        .keys = {1, 1, 1}, .lead_ns = (int64_t)(lead_ms * 1e6), .acknowledge = true};
    rig_start(&r);
}

T_CASE(scheduled_action)
{
    start_scheduled(30);
    sets_of_one_instant(30, 0, "scheduled action command");
    rig_stats(&r);
    T_LE(30, r.st.action.sent);
    for (int c = 0; c < BED_CAMERAS; c++)
        T_LE(30, r.st.camera[c].action.acknowledged);
    /* a camera that has lost its master says so, each time */
    bed_fault(1, (struct cap_gvcam_fault){.no_ptp_master = true});
    UNTIL (r.st.camera[1].action.no_clock > 0)
        rig_wait(&r);
    T_LE(1, r.st.camera[1].action.no_clock);
    T_EQ_I(r.st.camera[0].action.no_clock, 0);
    rig_end(&r);
}

/* A lead that no host can keep: nothing is sent late, everything is counted. */
T_CASE(a_late_command_is_not_sent)
{
    start_scheduled(1e-6);
    UNTIL (r.st.action.late >= 10)
        rig_wait(&r);
    rig_end(&r);
    T_LE(10, r.st.action.late);
    T_EQ_I(r.st.action.sent, 0);
    for (int c = 0; c < BED_CAMERAS; c++)
        T_EQ_I(bed_stats(c).triggers, 0);
}

/* ---- what a camera says about its frames and its clock ------------------------------------------ */

/* Ticks of 8 ns, and how far the camera's clock is from the host's. */
T_CASE(clock_readings_and_ticks)
{
    struct session s;
    bed_ring_fps = FPS;
    struct cap_gvcam_config k = bed_config(0);
    k.tick_hz = 125e6;
    bed_restart(0, &k);
    bed_fault(0, (struct cap_gvcam_fault){.skew_us = 250000});
    struct cap_source_config config = bed_source(0);
    if (begin(&s, &config)) {
        for (int i = 0; i < 5 && next_good(&s); i++)
            ;
        int64_t grid = (int64_t)(1e9 / FPS), off = (s.last_stamp - 250 * MS) % grid;
        T_LE(off < grid / 2 ? off : grid - off, 16); /* on the images' grid, to two ticks */
        T_OK(wait_count(&s.box, &s.box.readings, 1));
        int64_t skew = s.box.device_ns - (s.box.mono_ns + pvx_now_real() - pvx_now_mono());
        printf("  clock read to +-%.3f ms\n", (double)s.box.bound_ns * 1e-6);
        T_LE(fabs((double)skew - 250e6), (double)s.box.bound_ns + 100e3);
    }
    end(&s);
}

T_CASE(chunks_tell_exposure_and_gain)
{
    static const char *const layouts[] = {"ExtendedChunk", "ImageExtendedChunk"};
    bed_all(FPS);
    for (int i = 0; i < 2; i++) {
        struct session s;
        struct cap_feature layout = {"ChunkPayloadType", ""};
        struct cap_source_config config = bed_source(i);
        snprintf(layout.value, sizeof layout.value, "%s", layouts[i]);
        config.chunks = true;
        config.gige.frame_retention_ms = 5000;
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

/* Only the lines are asked for, so exposure and gain stay unknown. */
T_CASE(chunks_tell_lines)
{
    struct cap_source_config config = bed_source(1);
    struct session s;
    struct cap_feature layout = {"ChunkPayloadType", "ImageExtendedChunk"};
    bed_all(FPS);
    config.lines = true;
    config.features = &layout;
    config.n_features = 1;
    config.gige.frame_retention_ms = 5000;
    if (begin(&s, &config)) {
        for (uint64_t lines = 0; lines < 0x80000004; lines += 0x80000002) {
            bool seen = false;
            bed_fault(1,
                      (struct cap_gvcam_fault){.optics = cap_optics_none, .inputs = (double)lines});
            UNTIL (seen) {
                struct cap_frame *f = next_frame(&s.box);
                if (f == NULL)
                    continue;
                T_EQ_I(f->img.size, BED_BYTES); /* without the chunk data */
                T_OK(f->lines_known && (f->lines == lines || f->lines == 0));
                T_OK(isnan(f->exposure_us) && isnan(f->gain));
                seen = f->lines == lines;
                cap_frame_release(f);
            }
            T_OK(seen);
        }
        bed_fault(1, (struct cap_gvcam_fault){.optics = cap_optics_none});
    }
    end(&s);
}

T_MAIN(bed_open(), bed_close())
