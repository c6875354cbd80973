/* test_aravis_watch.c - what the slow loop of a GigE camera finds while it runs: another trigger mode than
 * was set, and two PTP masters; each counted and told once. */
#include <arv.h>
#include <fcntl.h>

#include "arvbed.h"

#define FPS 20.0

static struct cap_stats st;
static char text[1 << 16];
static int log_file = -1, stderr_was = -1;

static int64_t now_ms(void)
{
    return pvx_now_mono() / MS;
}

static void log_begin(void)
{
    char path[] = "/tmp/pyrovox-watch-XXXXXX";
    log_file = mkstemp(path);
    stderr_was = dup(STDERR_FILENO);
    T_OK(log_file >= 0 && stderr_was >= 0);
    unlink(path);
    dup2(log_file, STDERR_FILENO);
    pvx_log_set_level(PVX_LOG_INFO);
}

static void log_end(void)
{
    pvx_log_set_level(PVX_LOG_ERROR);
    dup2(stderr_was, STDERR_FILENO);
    close(stderr_was);
    ssize_t n = pread(log_file, text, sizeof text - 1, 0);
    close(log_file);
    text[n > 0 ? n : 0] = '\0';
}

static int lines_with(const char *part)
{
    int n = 0;
    for (const char *p = text; (p = strstr(p, part)) != NULL; p += strlen(part))
        n++;
    return n;
}

static cap_capture *start(enum cap_trigger trigger, bool ptp)
{
    static char uri[BED_CAMERAS][32];
    static struct cap_source_config cameras[BED_CAMERAS];
    for (int c = 0; c < BED_CAMERAS; c++) {
        cameras[c] = bed_source(c);
        snprintf(uri[c], sizeof uri[c], "aravis:%s", bed_address[c]);
        cameras[c].uri = uri[c];
        cameras[c].fps = 0;
        cameras[c].ptp = ptp;
    }
    struct cap_capture_config config = {
        .n_cameras = BED_CAMERAS,
        .camera = cameras,
        .fps = FPS,
        .trigger = trigger,
        .discard_first = 1,
        .sets = {.max_wait_ns = 500 * MS, .policy = CAP_POLICY_PARTIAL, .min_cameras = 1}};
    cap_capture *cap = NULL;
    struct pvx_diag d = {""};
    T_EQ_I(cap_capture_new(&config, &cap, &d), PVX_OK);
    T_EQ_S(d.text, "");
    if (cap != NULL)
        T_EQ_I(cap_capture_start(cap, &d), PVX_OK);
    return cap;
}

/* Take sets until `true_now` of st, or for 30 s. */
static bool until(cap_capture *cap, bool (*true_now)(uint64_t), uint64_t arg)
{
    for (int64_t end = now_ms() + 30000; now_ms() < end;) {
        struct cap_set *set;
        if (cap_capture_next(cap, 20 * MS, &set) == PVX_OK)
            cap_set_release(set);
        cap_capture_stats(cap, &st);
        if (true_now(arg))
            return true;
    }
    return false;
}

static bool complete(uint64_t n)
{
    return st.sets_complete >= n;
}

static uint64_t modes(int c)
{
    return st.camera[c].count[CAP_TRIGGER_MODE];
}

static bool mode_found(uint64_t n)
{
    return modes(1) >= n;
}

static bool runs_again(uint64_t n)
{
    return st.sets_complete >= n && st.camera[1].state == CAP_RUNNING;
}

static bool was_lost(uint64_t n)
{
    return st.camera[1].count[CAP_LOST_CAMERA] >= n;
}

/* Triggered, and runs freely all of a sudden; set again while it runs. */
static void a_changed_mode_is_found_and_set_again(void)
{
    NEED_BED();
    bed_all(FPS);
    cap_gvnet_line(bed_net, FPS);
    log_begin();
    cap_capture *cap = start(CAP_TRIGGER_LINE, false);
    if (cap == NULL)
        return;
    T_OK(until(cap, complete, 5));
    usleep(1000000); /* some rounds with nothing to find */
    cap_capture_stats(cap, &st);
    for (int c = 0; c < BED_CAMERAS; c++)
        T_EQ_I(modes(c), 0);
    int64_t t0 = now_ms();
    cap_gvcam_do(bed_cam[1], CAP_GVCAM_TRIGGER_MODE, 0);
    T_OK(until(cap, mode_found, 1));
    printf("  TriggerMode Off behind our back: found after %.2f s\n",
           (double)(now_ms() - t0) * 1e-3);
    T_OK(until(cap, runs_again, st.sets_complete + 10));
    T_EQ_I(modes(1), 1);
    T_EQ_I(modes(0) + modes(2), 0);
    T_EQ_I(st.camera[1].count[CAP_LOST_CAMERA], 0);
    bool trouble = false;
    for (uint32_t i = 0; i < st.camera[1].n_troubles; i++)
        if (st.camera[1].trouble[i].cause == CAP_TRIGGER_MODE) {
            trouble = true;
            T_EQ_S(st.camera[1].trouble[i].detail,
                   "TriggerMode is Off instead of On; it was set again");
        }
    T_OK(trouble);
    cap_capture_stop(cap);
    log_end();
    cap_capture_free(&cap);
    T_EQ_I(lines_with("its trigger mode is not the one that was set: TriggerMode is Off"), 1);
    cap_gvnet_line(bed_net, 0);
}

/* Free run, and waits for a trigger that never comes. */
static void a_camera_that_begins_to_wait_is_set_free(void)
{
    NEED_BED();
    bed_all(FPS);
    cap_capture *cap = start(CAP_TRIGGER_FREE_RUN, false);
    if (cap == NULL)
        return;
    T_OK(until(cap, complete, 5));
    cap_gvcam_do(bed_cam[1], CAP_GVCAM_TRIGGER_MODE, 1);
    T_OK(until(cap, mode_found, 1) || was_lost(1)); /* a slow machine may find the silence first */
    T_OK(until(cap, runs_again, st.sets_complete + 10));
    T_EQ_I(modes(0) + modes(2), 0);
    cap_capture_free(&cap);
}

/* A camera that does not let its mode be set while it takes frames is opened anew. */
static void a_locked_camera_is_opened_anew(void)
{
    NEED_BED();
    bed_all(FPS);
    cap_gvnet_line(bed_net, FPS);
    bed_fault(1, (struct cap_gvcam_fault){.lock_trigger = true});
    cap_capture *cap = start(CAP_TRIGGER_LINE, false);
    if (cap == NULL)
        return;
    T_OK(until(cap, complete, 5));
    cap_gvcam_do(bed_cam[1], CAP_GVCAM_TRIGGER_MODE, 0);
    T_OK(until(cap, mode_found, 1));
    T_OK(until(cap, was_lost, 1));
    T_OK(until(cap, runs_again, st.sets_complete + 10));
    T_EQ_I(modes(1), 1);
    T_EQ_I(st.camera[0].count[CAP_LOST_CAMERA] + st.camera[2].count[CAP_LOST_CAMERA], 0);
    cap_capture_free(&cap);
    bed_fault(1, (struct cap_gvcam_fault){.lock_trigger = false});
    cap_gvnet_line(bed_net, 0);
}

static bool masters(uint64_t n)
{
    return st.camera[0].count[CAP_PTP_MASTERS] >= n;
}

static bool one_master(uint64_t n)
{
    (void)n;
    return strcmp(st.camera[2].health.ptp, "Slave") == 0 &&
           strcmp(st.camera[0].health.ptp, "Master") == 0;
}

static void two_ptp_masters_are_told(void)
{
    NEED_BED();
    for (int c = 0; c < BED_CAMERAS; c++) {
        struct cap_gvcam_config k = bed_config(c);
        k.ring_fps = FPS;
        k.ptp_settle_ms = 100;
        bed_restart(c, &k);
    }
    bed_fault(0, (struct cap_gvcam_fault){.ptp_master = true});
    log_begin();
    cap_capture *cap = start(CAP_TRIGGER_FREE_RUN, true);
    if (cap == NULL)
        return;
    T_OK(until(cap, complete, 5));
    T_OK(until(cap, one_master, 0)); /* one is as it should be */
    usleep(1200000);
    cap_capture_stats(cap, &st);
    T_EQ_I(st.camera[0].count[CAP_PTP_MASTERS], 0);
    bed_fault(2, (struct cap_gvcam_fault){.ptp_master = true});
    T_OK(until(cap, masters, 2));
    T_LE(1, st.camera[2].count[CAP_PTP_MASTERS]);
    T_EQ_I(st.camera[1].count[CAP_PTP_MASTERS], 0);
    cap_capture_stop(cap);
    log_end();
    cap_capture_free(&cap);
    T_EQ_I(lines_with("2 cameras are PTP masters at once ("), 1);
}

int main(void)
{
    bed_open();
    T_RUN(a_changed_mode_is_found_and_set_again);
    T_RUN(a_camera_that_begins_to_wait_is_set_free);
    T_RUN(a_locked_camera_is_opened_anew);
    T_RUN(two_ptp_masters_are_told);
    bed_close();
    return t_done();
}
