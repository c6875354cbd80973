/* simcams_faults.h - how the simulated cameras are broken: from options, by a timetable, by hand.
 *
 * Options   "0.05" (every camera) or "cam3=0.05,cam4=0.1"
 * Timetable "cam3@12.5" or "cam3@10-15" (seconds after the cameras began)
 * By hand   one line each:  drop|loss|delay|skew|drift CAMERA NUMBER
 *                           freeze CAMERA on|off     kill CAMERA     revive CAMERA
 *           CAMERA may be "all". */
#ifndef SIMCAMS_FAULTS_H
#define SIMCAMS_FAULTS_H
#include "base/err.h"
#include "capture/simgv.h"
#include "recon/rig.h"

struct simcams_state {
    struct cap_simgv_fault fault;
    bool alive; /* wanted: a killed camera can be revived */
};

enum simcams_fault_kind { SIMCAMS_DROP, SIMCAMS_LOSS, SIMCAMS_DELAY, SIMCAMS_SKEW, SIMCAMS_DRIFT };

#define SIMCAMS_MAX_EVENTS 64
struct simcams_event {
    double at_s;
    size_t camera;
    enum { EV_KILL, EV_FREEZE, EV_THAW } what;
};
struct simcams_plan {
    size_t n;
    struct simcams_event event[SIMCAMS_MAX_EVENTS];
};

/* state [rig->n_cameras].  Errors: PVX_EINVAL, PVX_ENOENT (camera), with the reason in d. */
PVX_MUST_CHECK pvx_err simcams_fault_option(const struct rec_rig *rig, enum simcams_fault_kind kind,
                                            const char *text, struct simcams_state *state,
                                            struct pvx_diag *d);
/* Adds to the plan; `until` allowed for freezing only. */
PVX_MUST_CHECK pvx_err simcams_plan_option(const struct rec_rig *rig, bool freeze, const char *text,
                                           struct simcams_plan *plan, struct pvx_diag *d);
void simcams_plan_apply(const struct simcams_event *e, struct simcams_state *state);
/* One control line; empty ones are fine. */
PVX_MUST_CHECK pvx_err simcams_control(const struct rec_rig *rig, const char *line,
                                       struct simcams_state *state, struct pvx_diag *d);
#endif
