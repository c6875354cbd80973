/* simcams_faults.h - how the simulated cameras are broken: from options, by a timetable, by hand.
 *
 * Options   "0.05" (every camera) or "cam3=0.05,cam4=0.1"
 * Timetable "12.5:LINE" (seconds after the cameras began); "cam3@12.5" and "cam3@10-15" are short for
 *           kill and freeze lines
 * By hand   one line each; CAMERA may be "all":
 *           drop|loss|delay|skew|drift|jitter|reorder|duplicate|size|corrupt|miss|hostile|ptp-offset
 *                                     CAMERA NUMBER
 *           freeze|stuck|no-ptp|ptp-master|lock-trigger
 *                                     CAMERA on|off
 *           kill|revive|ids           CAMERA
 *           reboot CAMERA [SECONDS]   jump CAMERA SECONDS   trigger-mode CAMERA 0|1
 *           line HZ    pulse    link MBIT_S [KIB]    switch SECONDS    stats    pose NUMBER */
#ifndef SIMCAMS_FAULTS_H
#define SIMCAMS_FAULTS_H
#include "base/err.h"
#include "capture/gevsim/gvcam.h"
#include "recon/geom/rig.h"

struct simcams_state {
    struct cap_gvcam_fault fault;
    bool alive; /* wanted: a killed camera can be revived */
};

/* Faults that are a number: what it may be, and which member of struct cap_gvcam_fault it is. */
#define SIMCAMS_FAULTS(M)                              \
    M(SIMCAMS_DROP, "drop", 0, 1, drop)                \
    M(SIMCAMS_LOSS, "loss", 0, 1, packet_loss)         \
    M(SIMCAMS_DELAY, "delay", 0, 10000, delay_ms)      \
    M(SIMCAMS_SKEW, "skew", -1e12, 1e12, skew_us)      \
    M(SIMCAMS_DRIFT, "drift", -1000, 1000, drift_ppm)  \
    M(SIMCAMS_JITTER, "jitter", 0, 10000, jitter_ms)   \
    M(SIMCAMS_REORDER, "reorder", 0, 1, reorder)       \
    M(SIMCAMS_DUPLICATE, "duplicate", 0, 1, duplicate) \
    M(SIMCAMS_SIZE, "size", 0, 1, wrong_size)          \
    M(SIMCAMS_CORRUPT, "corrupt", 0, 1, corrupt)       \
    M(SIMCAMS_MISS, "miss", 0, 1, miss)                \
    M(SIMCAMS_HOSTILE, "hostile", 0, 1, hostile)       \
    M(SIMCAMS_PTP_OFFSET, "ptp-offset", -1e9, 1e9, ptp_offset_us)
#define SIMCAMS_NUMBER(number, ...) number,
enum simcams_fault_kind { SIMCAMS_FAULTS(SIMCAMS_NUMBER) SIMCAMS_N_KINDS };

/* Orders: the word, how many words the line may have, which of them is a camera, least and most of the number
 * after that. */
#define SIMCAMS_ORDERS(M)                             \
    M(SIMCAMS_REBOOT, "reboot", 2, 3, true, 0, 3600)  \
    M(SIMCAMS_JUMP, "jump", 3, 3, true, -1e9, 1e9)    \
    M(SIMCAMS_IDS, "ids", 2, 2, true, 0, 0)           \
    M(SIMCAMS_MODE, "trigger-mode", 3, 3, true, 0, 1) \
    M(SIMCAMS_LINE, "line", 2, 2, false, 0, 1000)     \
    M(SIMCAMS_PULSE, "pulse", 1, 1, false, 0, 0)      \
    M(SIMCAMS_LINK, "link", 2, 3, false, 0, 1e6)      \
    M(SIMCAMS_SWITCH, "switch", 2, 2, false, 0, 3600) \
    M(SIMCAMS_POSE, "pose", 2, 2, false, 0, 1e6)      \
    M(SIMCAMS_STATS, "stats", 1, 1, false, 0, 0)

/* What a line wants done at once, beyond the state. */
struct simcams_order {
    enum { SIMCAMS_NOTHING, SIMCAMS_ORDERS(SIMCAMS_NUMBER) } what;
    size_t lo, hi; /* cameras [lo,hi) */
    double arg, arg2;
};

#define SIMCAMS_MAX_EVENTS 64
#define SIMCAMS_LINE_MAX   96
struct simcams_event {
    double at_s;
    char line[SIMCAMS_LINE_MAX]; /* as by hand */
};
struct simcams_plan {
    size_t n;
    struct simcams_event event[SIMCAMS_MAX_EVENTS]; /* in order of time */
};

/* state [rig->n_cameras].  Errors: PVX_EINVAL, PVX_ENOENT (camera), with the reason in d. */
PVX_MUST_CHECK pvx_err simcams_fault_option(const struct rec_rig *rig, enum simcams_fault_kind kind,
                                            const char *text, struct simcams_state *state,
                                            struct pvx_diag *d);
/* "cam3@12.5": kill, or freeze ("cam3@10-15": until).  Adds to the plan; PVX_ERANGE: full. */
PVX_MUST_CHECK pvx_err simcams_plan_option(const struct rec_rig *rig, bool freeze, const char *text,
                                           struct simcams_plan *plan, struct pvx_diag *d);
/* "12.5:LINE"; the line is checked. */
PVX_MUST_CHECK pvx_err simcams_plan_line(const struct rec_rig *rig, const char *text,
                                         struct simcams_plan *plan, struct pvx_diag *d);
/* One control line; empty ones are fine. */
PVX_MUST_CHECK pvx_err simcams_control(const struct rec_rig *rig, const char *line,
                                       struct simcams_state *state, struct simcams_order *order,
                                       struct pvx_diag *d);
#endif
