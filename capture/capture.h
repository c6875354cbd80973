/* capture.h - all cameras of the rig, supervised: what the daemon sees.
 *
 * One supervisor thread per camera opens it, starts it, watches it (no frame for max(1 s, 5 periods)
 * = lost) and reopens it with back-off 0.25 s .. 4 s, while the others go on; one assembler thread
 * maps clocks and groups frames.  Driver callbacks push into a bounded ring per camera (oldest goes
 * first when full, counted).
 * Threads: next() from one thread, stats() and stop() from any. */
#ifndef CAP_CAPTURE_H
#define CAP_CAPTURE_H
#include "base/hist.h"
#include "capture/frameset.h"

struct cap_capture_config {
    uint32_t n_cameras;
    struct cap_source_config *camera;  /* [n_cameras]; .uri with its scheme ("aravis:127.0.0.2") */
    struct cap_assembler_params sets;  /* .cameras is filled in */
    double fps;                        /* nominal */
    bool software_trigger;             /* one sweep per period to all cameras */
    bool shared_clock;                 /* device clocks are the host's (PTP, simulation): identity */
    bool lossless;                     /* replay: back-pressure instead of dropping */
    uint32_t discard_first;            /* frames per camera dropped after each start; default 1 */
};

enum cap_state { CAP_OPENING, CAP_RUNNING, CAP_LOST, CAP_ENDED };
struct cap_camera_stats {
    enum cap_state state;
    uint64_t count[CAP_N_COUNT];
    double fps;             /* over the last 2 s */
    double drift_ppm;
    char error[256];        /* last reason it could not be opened, "" when fine */
};
struct cap_stats {
    struct cap_camera_stats camera[CAP_MAX_CAMERAS];
    uint64_t sets_complete, sets_partial, sets_dropped;
    struct pvx_hist spread;
};

typedef struct cap_capture cap_capture;
PVX_MUST_CHECK pvx_err cap_capture_new(const struct cap_capture_config *c, cap_capture **out,
                                       struct pvx_diag *d);
PVX_MUST_CHECK pvx_err cap_capture_start(cap_capture *c, struct pvx_diag *d);
/* PVX_ETIMEDOUT; PVX_ECLOSED after stop or when every source has ended and all sets are out. */
PVX_MUST_CHECK pvx_err cap_capture_next(cap_capture *c, int64_t timeout_ns, struct cap_set **out);
void cap_capture_stop(cap_capture *c);
void cap_capture_free(cap_capture **c);
void cap_capture_stats(cap_capture *c, struct cap_stats *out);
#endif
