/* test_aravis_watch.c - what the slow loop of a GigE camera finds while it runs: another trigger mode than
 * was set, and two PTP masters; each counted and told once. */
#include <arv.h>

#include "tests/lib/logged.h"
#include "tests/lib/arvbed.h"

#define FPS 20.0

static struct rig r;

static void start(enum cap_trigger trigger, bool ptp)
{
    bed_together(&r, FPS, trigger, ptp);
    rig_start(&r);
}

/* Sets are taken until the condition holds of r.st. */
#define HOLDS_SOON(condition)            \
    UNTIL ((rig_stats(&r), (condition))) \
        rig_next(&r);                    \
    T_OK(condition)

static uint64_t modes(int c)
{
    return r.st.camera[c].count[CAP_TRIGGER_MODE];
}

static bool runs_again(uint64_t sets)
{
    return r.st.sets_complete >= sets && r.st.camera[1].state == CAP_RUNNING;
}

static bool was_lost(void)
{
    return r.st.camera[1].count[CAP_LOST_CAMERA] >= 1;
}

/* Triggered, and runs freely all of a sudden; set again while it runs. */
T_CASE(a_changed_mode_is_found_and_set_again)
{
    uint64_t sets;
    bed_all(FPS);
    cap_gvnet_line(bed_net, FPS);
    log_begin(PVX_LOG_INFO);
    start(CAP_TRIGGER_LINE, false);
    HOLDS_SOON(r.st.sets_complete >= 5);
    usleep(1000000); /* some rounds with nothing to find */
    rig_stats(&r);
    for (int c = 0; c < BED_CAMERAS; c++)
        T_EQ_I(modes(c), 0);
    int64_t t0 = pvx_now_mono();
    cap_gvcam_do(bed_cam[1], CAP_GVCAM_TRIGGER_MODE, 0);
    HOLDS_SOON(modes(1) >= 1);
    printf("  TriggerMode Off behind our back: found after %.2f s\n",
           (double)(pvx_now_mono() - t0) * 1e-9);
    sets = r.st.sets_complete;
    HOLDS_SOON(runs_again(sets + 10));
    T_EQ_I(modes(1), 1);
    T_EQ_I(modes(0) + modes(2), 0);
    T_EQ_I(r.st.camera[1].count[CAP_LOST_CAMERA], 0);
    bool trouble = false;
    for (uint32_t i = 0; i < r.st.camera[1].n_troubles; i++)
        if (r.st.camera[1].trouble[i].cause == CAP_TRIGGER_MODE) {
            trouble = true;
            T_EQ_S(r.st.camera[1].trouble[i].detail,
                   "TriggerMode is Off instead of On; it was set again");
        }
    T_OK(trouble);
    rig_end(&r);
    log_end();
    T_EQ_I(log_count("its trigger mode is not the one that was set: TriggerMode is Off"), 1);
    cap_gvnet_line(bed_net, 0);
}

/* Free run, and waits for a trigger that never comes. */
T_CASE(a_camera_that_begins_to_wait_is_set_free)
{
    uint64_t sets;
    bed_all(FPS);
    start(CAP_TRIGGER_FREE_RUN, false);
    HOLDS_SOON(r.st.sets_complete >= 5);
    cap_gvcam_do(bed_cam[1], CAP_GVCAM_TRIGGER_MODE, 1);
    HOLDS_SOON(modes(1) >= 1 || was_lost()); /* a slow machine may find the silence first */
    sets = r.st.sets_complete;
    HOLDS_SOON(runs_again(sets + 10));
    T_EQ_I(modes(0) + modes(2), 0);
    rig_end(&r);
}

/* A camera that does not let its mode be set while it takes frames is opened anew. */
T_CASE(a_locked_camera_is_opened_anew)
{
    uint64_t sets;
    bed_all(FPS);
    cap_gvnet_line(bed_net, FPS);
    bed_fault(1, (struct cap_gvcam_fault){.lock_trigger = true});
    start(CAP_TRIGGER_LINE, false);
    HOLDS_SOON(r.st.sets_complete >= 5);
    cap_gvcam_do(bed_cam[1], CAP_GVCAM_TRIGGER_MODE, 0);
    HOLDS_SOON(modes(1) >= 1);
    HOLDS_SOON(was_lost());
    sets = r.st.sets_complete;
    HOLDS_SOON(runs_again(sets + 10));
    T_EQ_I(modes(1), 1);
    T_EQ_I(r.st.camera[0].count[CAP_LOST_CAMERA] + r.st.camera[2].count[CAP_LOST_CAMERA], 0);
    rig_end(&r);
    bed_fault(1, (struct cap_gvcam_fault){.lock_trigger = false});
    cap_gvnet_line(bed_net, 0);
}

T_CASE(two_ptp_masters_are_told)
{
    for (int c = 0; c < BED_CAMERAS; c++) {
        struct cap_gvcam_config k = bed_config(c);
        k.ring_fps = FPS;
        k.ptp_settle_ms = 100;
        bed_restart(c, &k);
    }
    bed_fault(0, (struct cap_gvcam_fault){.ptp_master = true});
    log_begin(PVX_LOG_INFO);
    start(CAP_TRIGGER_FREE_RUN, true);
    HOLDS_SOON(r.st.sets_complete >= 5);
    HOLDS_SOON(strcmp(r.st.camera[2].health.ptp, "Slave") == 0 &&
               strcmp(r.st.camera[0].health.ptp, "Master") == 0); /* one is as it should be */
    usleep(1200000);
    rig_stats(&r);
    T_EQ_I(r.st.camera[0].count[CAP_PTP_MASTERS], 0);
    bed_fault(2, (struct cap_gvcam_fault){.ptp_master = true});
    HOLDS_SOON(r.st.camera[0].count[CAP_PTP_MASTERS] >= 2);
    T_LE(1, r.st.camera[2].count[CAP_PTP_MASTERS]);
    T_EQ_I(r.st.camera[1].count[CAP_PTP_MASTERS], 0);
    rig_end(&r);
    log_end();
    T_EQ_I(log_count("2 cameras are PTP masters at once ("), 1);
}

T_MAIN(bed_open(), bed_close())
