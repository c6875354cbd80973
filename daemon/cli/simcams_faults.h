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
 *           line HZ    pulse    link MBIT_S [KIB]    switch SECONDS    stats */
#ifndef SIMCAMS_FAULTS_H
#define SIMCAMS_FAULTS_H
#include "base/err.h"
#include "capture/gevsim/gvcam.h"
#include "recon/geom/rig.h"

struct simcams_state {
    struct cap_gvcam_fault fault;
    bool alive; /* wanted: a killed camera can be revived */
};

enum simcams_fault_kind {
    SIMCAMS_DROP,
    SIMCAMS_LOSS,
    SIMCAMS_DELAY,
    SIMCAMS_SKEW,
    SIMCAMS_DRIFT,
    SIMCAMS_JITTER,
    SIMCAMS_REORDER,
    SIMCAMS_DUPLICATE,
    SIMCAMS_SIZE,
    SIMCAMS_CORRUPT,
    SIMCAMS_MISS,
    SIMCAMS_HOSTILE,
    SIMCAMS_PTP_OFFSET,
    SIMCAMS_N_KINDS
};

/* What a line wants done at once, beyond the state. */
struct simcams_order {
    enum {
        SIMCAMS_NOTHING,
        SIMCAMS_REBOOT,
        SIMCAMS_JUMP,
        SIMCAMS_IDS,
        SIMCAMS_MODE,
        SIMCAMS_LINE,
        SIMCAMS_PULSE,
        SIMCAMS_LINK,
        SIMCAMS_SWITCH,
        SIMCAMS_STATS
    } what;
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
