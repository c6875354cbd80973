/* state.h - what the daemon knows about itself at one moment, and its JSON.
 *
 * A snapshot is a copy: filled by the pipeline, read by the control socket, the status message and
 * the summary at the end.  Every count has a name, a unit and a meaning in a table.
 * Invariant (tested): produced == published + sum(dropped) + inside. */
#ifndef DMN_STATE_H
#define DMN_STATE_H
#include <stddef.h>
#include <stdint.h>
#include "capture/rig/capture.h"
#include "capture/take/recorder.h"
#include "capture/take/ring.h"
#include "daemon/config/triggers.h"
#include "daemon/control/belong.h"
#include "daemon/control/checks.h"
#include "daemon/control/votes.h"
#include "recon/geom/camera.h"
#include "recon/frame/frame.h"

/* A background that the daemon was asked for (background.h). */
struct dmn_background_state {
    unsigned request; /* number of the last one; 0 = there was none */
    enum dmn_taking state;
    uint32_t sets, have; /* sets asked for, sets taken so far */
    struct pvx_diag why; /* FAILED */
};

#define DMN_NUMBER(number, ...) number,
/* Why a frame set that capture produced did not become a published volume. */
#define DMN_DROPS(M)                                                                            \
    M(DMN_DROP_STALE, "stale", "sets", "too old when its turn came, and a newer one was there") \
    M(DMN_DROP_SOLVE, "solver_busy", "sets", "displaced by a newer set before the solver")      \
    M(DMN_DROP_PUBLISH, "publisher_busy", "sets", "displaced by a newer set before publishing") \
    M(DMN_DROP_IMAGES, "images", "sets", "too few images of the set could be used")             \
    M(DMN_DROP_FAILED, "failed", "sets", "solver or publisher refused the set")                 \
    M(DMN_DROP_STOPPED, "stopped", "sets", "under way when the daemon was stopped")
enum dmn_drop { DMN_DROPS(DMN_NUMBER) DMN_N_DROP };
struct dmn_count_def {
    const char *name, *unit, *help;
};
/* Why a camera's frame was left out of a set that it had come for.  Data that are no JPEG at all count
 * as damaged; kinds that cameras do not send are progressive, CMYK ... */
#define DMN_IMAGE_FAULTS(M)                                                                     \
    M(DMN_IMAGE_SIZE, "image_size", "frames", "not of the size that the rig says")              \
    M(DMN_IMAGE_FORMAT, "image_format", "frames", "in a pixel format that cannot be converted") \
    M(DMN_IMAGE_KIND, "image_kind", "frames", "grey beside pictures with colour")               \
    M(DMN_IMAGE_NO_NUMBER, "image_no_number", "frames", "without a finite pixel")               \
    M(DMN_IMAGE_JPEG_DAMAGED, "jpeg_damaged", "frames", "JPEG cut off or damaged")              \
    M(DMN_IMAGE_JPEG_SIZE, "jpeg_size", "frames", "JPEG of another size than its frame")        \
    M(DMN_IMAGE_JPEG_KIND, "jpeg_kind", "frames", "JPEG of a kind that cameras do not send")
enum dmn_image_fault { DMN_IMAGE_FAULTS(DMN_NUMBER) DMN_N_IMAGE };
extern const struct dmn_count_def dmn_image_defs[DMN_N_IMAGE];
extern const struct dmn_count_def dmn_drop_defs[DMN_N_DROP];

/* What is known of a camera's pose while it runs (pipeline/watch.h). */
struct dmn_rig_state {
    bool moved;
    uint64_t looks, alarms; /* sets in which it was compared; times that it was named */
    double px[2];           /* shift of its pictures from where others see the flame: right, down */
};

/* The solves for live error bars (daemon/pipeline/draws.h), and why a set had none. */
#define DMN_LEFT_OUTS(M)                                                                           \
    M(DMN_LEFT_OUT_TIME, "no_time", "sets", "the live path had no time to spare")                  \
    M(DMN_LEFT_OUT_SHARE, "share", "sets", "they would take over 0.8 of the other processor time") \
    M(DMN_LEFT_OUT_BUSY, "busy", "sets", "the set before was still being solved once more")        \
    M(DMN_LEFT_OUT_VOID, "void", "sets", "dark, not published, or settings or cameras had changed")
enum dmn_left_out { DMN_LEFT_OUTS(DMN_NUMBER) DMN_N_LEFT_OUT };
extern const struct dmn_count_def dmn_left_out_defs[DMN_N_LEFT_OUT];
struct dmn_draws_state {
    bool on, none;  /* none: the last volume had no bars */
    uint32_t doubt; /* enum rec_bars_*, of the last volume's */
    uint64_t made, left_out[DMN_N_LEFT_OUT];
    uint32_t in_average; /* since the average began */
    double mean_ms;
};

/* Where sets are solved (daemon/pipeline/compute.h). */
struct dmn_compute_state {
    char device[128];     /* a graphics card; "": the processors */
    uint64_t there, here; /* sets solved on it; on the processors, since it could not */
    uint64_t raw;         /* of the first: with pixels that were unpacked there */
    char why[128];        /* of the last of these; "" = none */
};

#define DMN_N_STAGES 3 /* carve, solve, publish */
struct dmn_stage_state {
    char name[16];
    uint64_t items;
    double mean_ms, p99_ms, max_ms; /* work per item, without waiting */
    double beat_age_s;              /* since its last heartbeat */
    size_t queued;                  /* items that wait for it */
};

/* The recorder of volumes beside the daemon (daemon/pipeline/beside.h). */
struct dmn_beside_state {
    bool running, failed;   /* failed: it ended by itself, and not with the daemon */
    char path[512];         /* of the last that was begun, "" = none */
    uint64_t written, lost; /* volumes; since it was begun by configuration or command */
    unsigned deaths;
    char error[512]; /* the last error that it reported, "" = nothing was wrong */
};

/* The triggers of record.ring (daemon/pipeline/triggers.h). */
struct dmn_triggers_state {
    size_t n;
    struct {
        char name[DMN_TRIGGER_NAME_MAX];
        enum dmn_when when;
        double above, value; /* its level, and the last volume's value */
        bool ready;          /* fires when the value is above */
        uint64_t fired;
        int64_t last_ns; /* last instant, UTC; 0 = none */
    } item[DMN_TRIGGERS_MAX];
    uint64_t latency_n; /* from a set's exposure to its event */
    double latency_p50_ms, latency_p99_ms, latency_max_ms;
};

struct dmn_state {
    double uptime_s;
    char open_to[256]; /* an endpoint that lets all clients in (insecure: true); "" = none */
    bool keys;         /* some endpoint asks for one */
    uint64_t clients_listed, connections_refused;
    uint64_t subscribers;
    uint64_t session;
    uint64_t produced, published, inside, dropped[DMN_N_DROP];
    double sets_per_s; /* published, over the last second or two */
    uint64_t latency_n;
    double latency_sum_s;                                  /* of these latency_n */
    double latency_p50_ms, latency_p99_ms, latency_max_ms; /* last frame received -> sent */
    double spread_p50_ms, spread_p99_ms;                   /* exposures within a set */
    uint64_t bytes;                                        /* of the last volume message */
    uint64_t last_set;
    int64_t last_exposure_ns; /* UTC */
    struct rec_frame_report report;
    int nch; /* channels of the volumes */
    struct dmn_votes votes;
    int32_t voxels[3];
    int32_t binning, rays;
    uint64_t matrix_entries;
    size_t n_cameras;
    char camera[CAP_MAX_CAMERAS][REC_NAME_MAX];
    uint64_t images[CAP_MAX_CAMERAS][DMN_N_IMAGE];
    struct dmn_rig_state rig[CAP_MAX_CAMERAS];
    struct dmn_checks checks;
    struct dmn_belong belong;
    struct cap_stats capture;
    struct cap_recorder_stats record;
    struct cap_ring_stats ring;
    struct dmn_triggers_state triggers;
    struct dmn_beside_state volumes;
    struct dmn_stage_state stage[DMN_N_STAGES];
    struct dmn_draws_state draws;
    struct dmn_compute_state compute;
    uint64_t previews_made, previews_subscribers;
    struct dmn_temperature_counts {
        bool on;
        /* sets while there were subscribers: sent; not, since the thread was still at an older one; not, without bars */
        uint64_t made, left_out, without_bars, subscribers;
    } temperature;
};

#define DMN_STATE_JSON_MAX (448u << 10)
/* JSON text of `s`; returns its length, 0 when it does not fit.  Allocates nothing. */
size_t dmn_state_json(const struct dmn_state *s, char *out, size_t size);
/* Its condition in one line, cut to fit: rate, cameras that are not there or not believed, what else is wrong. */
void dmn_state_sentence(const struct dmn_state *s, char *out, size_t size);
const char *dmn_camera_state_name(enum cap_state s);
#endif
