/* faults.h - text lines that change simulated cameras: from the start, at a time, or typed by hand.
 *
 *   WORD CAMERA NUMBER|X:Y|on|off   each word of SIMCAMS_FAULTS, below; CAMERA may be "all"
 *   kill|revive CAMERA   ids CAMERA [NUMBER]   reboot CAMERA [SECONDS]
 *   jump CAMERA SECONDS   trigger-mode CAMERA 0|1
 *   line HZ    pulse    link MBIT_S [KIB]    switch SECONDS    stats    pose NUMBER
 *
 * --set LINE holds from the start, --at SECONDS:LINE from that time after the cameras began. */
#ifndef SIMCAMS_FAULTS_H
#define SIMCAMS_FAULTS_H
#include "base/err.h"
#include "capture/gevsim/gvcam.h"
#include "recon/geom/rig.h"

struct simcams_state {
    struct cap_gvcam_fault fault;
    bool alive; /* whether it should run: a killed camera can be revived */
};

/* Faults of a camera: the word, how many numbers follow (two: X:Y; none: on or off), their least and most, and
 * the member of struct cap_gvcam_fault.  capture/gevsim/optics.h explains optics.*. */
#define SIMCAMS_FAULTS(M)                                                                   \
    M(SIMCAMS_DROP, "drop", 1, 0, 1, drop)                                                  \
    M(SIMCAMS_LOSS, "loss", 1, 0, 1, packet_loss)                                           \
    M(SIMCAMS_DELAY, "delay", 1, 0, 10000, delay_ms)                                        \
    M(SIMCAMS_SKEW, "skew", 1, -1e15, 1e15, skew_us)                                        \
    M(SIMCAMS_DRIFT, "drift", 1, -1000, 1000, drift_ppm)                                    \
    M(SIMCAMS_JITTER, "jitter", 1, 0, 10000, jitter_ms)                                     \
    M(SIMCAMS_REORDER, "reorder", 1, 0, 1, reorder)                                         \
    M(SIMCAMS_DUPLICATE, "duplicate", 1, 0, 1, duplicate)                                   \
    M(SIMCAMS_SIZE, "size", 1, 0, 1, wrong_size)                                            \
    M(SIMCAMS_CORRUPT, "corrupt", 1, 0, 1, corrupt)                                         \
    M(SIMCAMS_MISS, "miss", 1, 0, 1, miss)                                                  \
    M(SIMCAMS_HOSTILE, "hostile", 1, 0, 1, hostile)                                         \
    M(SIMCAMS_PTP_OFFSET, "ptp-offset", 1, -1e9, 1e9, ptp_offset_us)                        \
    M(SIMCAMS_INPUTS, "inputs", 1, 0, 4294967295.0, inputs)                                 \
    M(SIMCAMS_LATE, "late", 1, 0, CAP_GVCAM_LATE_MAX, late)                                 \
    M(SIMCAMS_BLUR, "blur", 1, 0, CAP_OPTICS_BLUR_MAX, optics.blur)                         \
    M(SIMCAMS_VIGNETTING, "vignetting", 1, 0, 0.99, optics.vignetting)                      \
    M(SIMCAMS_GAIN, "gain", 1, 0, 1000, optics.gain)                                        \
    M(SIMCAMS_EXPOSURE, "exposure", 1, 0, 1000, optics.exposure)                            \
    M(SIMCAMS_RESPONSE, "response", 1, 0.1, 10, optics.response)                            \
    M(SIMCAMS_PEDESTAL, "pedestal", 1, 0, 1, optics.pedestal)                               \
    M(SIMCAMS_HOT, "hot", 1, 0, 1, optics.hot)                                              \
    M(SIMCAMS_FLAT, "flat", 1, 0, 1000, optics.flat)                                        \
    M(SIMCAMS_BACKGROUND, "background", 1, 0, 1, optics.background)                         \
    M(SIMCAMS_SHIFT, "shift", 2, -CAP_OPTICS_SHIFT_MAX, CAP_OPTICS_SHIFT_MAX, optics.shift) \
    M(SIMCAMS_CAP, "cap", 0, 0, 1, optics.cap)                                              \
    M(SIMCAMS_FLOOD, "flood", 0, 0, 1, optics.flood)                                        \
    M(SIMCAMS_EMPTY, "empty", 0, 0, 1, optics.empty)                                        \
    M(SIMCAMS_MIRRORED, "mirrored", 0, 0, 1, optics.mirrored)                               \
    M(SIMCAMS_FREEZE, "freeze", 0, 0, 1, freeze)                                            \
    M(SIMCAMS_STILL, "still", 0, 0, 1, still)                                               \
    M(SIMCAMS_STUCK, "stuck", 0, 0, 1, stuck_clock)                                         \
    M(SIMCAMS_NO_PTP, "no-ptp", 0, 0, 1, no_ptp_master)                                     \
    M(SIMCAMS_PTP_MASTER, "ptp-master", 0, 0, 1, ptp_master)                                \
    M(SIMCAMS_LOCK_TRIGGER, "lock-trigger", 0, 0, 1, lock_trigger)
#define SIMCAMS_NUMBER(number, ...) number,
enum simcams_fault_kind { SIMCAMS_FAULTS(SIMCAMS_NUMBER) SIMCAMS_N_KINDS };

/* Orders: the word, least and most words of the line, whether a camera follows, least and most of the number
 * after that. */
#define SIMCAMS_ORDERS(M)                             \
    M(SIMCAMS_REBOOT, "reboot", 2, 3, true, 0, 3600)  \
    M(SIMCAMS_JUMP, "jump", 3, 3, true, -1e9, 1e9)    \
    M(SIMCAMS_IDS, "ids", 2, 3, true, 1, 0x1p53)      \
    M(SIMCAMS_MODE, "trigger-mode", 3, 3, true, 0, 1) \
    M(SIMCAMS_LINE, "line", 2, 2, false, 0, 1000)     \
    M(SIMCAMS_PULSE, "pulse", 1, 1, false, 0, 0)      \
    M(SIMCAMS_LINK, "link", 2, 3, false, 0, 1e6)      \
    M(SIMCAMS_SWITCH, "switch", 2, 2, false, 0, 3600) \
    M(SIMCAMS_POSE, "pose", 2, 2, false, 0, 1e6)      \
    M(SIMCAMS_STATS, "stats", 1, 1, false, 0, 0)

/* An order: a line that starts an action instead of setting a state. */
struct simcams_order {
    enum { SIMCAMS_NOTHING, SIMCAMS_ORDERS(SIMCAMS_NUMBER) } what;
    size_t lo, hi; /* cameras [lo,hi) */
    double arg, arg2;
};

#define SIMCAMS_MAX_EVENTS 64
#define SIMCAMS_LINE_MAX   96
struct simcams_event {
    double at_s;
    char line[SIMCAMS_LINE_MAX]; /* as if typed by hand */
};
struct simcams_plan {
    size_t n;
    struct simcams_event event[SIMCAMS_MAX_EVENTS]; /* in order of time */
};

/* A camera without faults. */
struct simcams_state simcams_healthy(void);
/* Apply a line before the cameras start.  A state goes into state [rig->n_cameras], an order into the plan at 0 s.
 * Errors: those of simcams_control; PVX_ERANGE: the plan is full. */
PVX_MUST_CHECK pvx_err simcams_set_line(const struct rec_rig *rig, const char *line,
                                        struct simcams_state *state, struct simcams_plan *plan,
                                        struct pvx_diag *d);
/* Add "12.5:LINE" to the plan; the line is checked.  Errors as above. */
PVX_MUST_CHECK pvx_err simcams_at_line(const struct rec_rig *rig, const char *text,
                                       struct simcams_plan *plan, struct pvx_diag *d);
/* Apply one line to state and *order.  An empty line does nothing.  Errors: PVX_EINVAL, PVX_ENOENT (camera). */
PVX_MUST_CHECK pvx_err simcams_control(const struct rec_rig *rig, const char *line,
                                       struct simcams_state *state, struct simcams_order *order,
                                       struct pvx_diag *d);
#endif
