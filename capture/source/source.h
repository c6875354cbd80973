/* source.h - the interface to one camera of any kind (Aravis, V4L2, libcamera, files, a recorded take, simulation).
 *
 * A backend's driver thread only stamps frames and pushes them.  The sink takes a frame and returns at once.
 * The source's fixed buffer pool lends a frame until cap_frame_release.  When no buffer is free, the source counts
 * an underrun and drops its newest frame.
 * Times: t_device is on the camera's clock (0 = none), t_arrival is when the driver's callback ran. */
#ifndef CAP_SOURCE_H
#define CAP_SOURCE_H
#include <stdbool.h>
#include "base/err.h"
#include "capture/pixel/image.h"

struct cap_frame {
    struct cap_image img;
    uint32_t camera;      /* index in the rig */
    uint64_t id;          /* camera's own frame number, widened past wraps; gaps = lost frames */
    int64_t t_device_ns;  /* exposure, on the clock that enum cap_clock names; 0 = not known */
    int64_t t_arrival_ns; /* host CLOCK_REALTIME */
    int64_t t_arrival_mono_ns;
    int64_t t_exposure_ns; /* host CLOCK_REALTIME, filled by the clock map (clockmap.h) */
    /* Of a recording with known sets: number of the frame's set + 1, and how many frames the set has.  The times
     * above are then the recording's and stay as they are.  0 = grouped by exposure. */
    uint64_t set;
    uint32_t set_size;
    double exposure_us, gain; /* used for this frame, as the camera reports; NAN = not reported */
    uint64_t lines;           /* levels of its lines, bit as in LineStatusAll (SFNC), if */
    bool lines_known;         /* the camera reports them with the frame */
    void (*release)(struct cap_frame *f);
    void *owner;
};
void cap_frame_release(struct cap_frame *f); /* any thread; NULL is fine */

/* Counts per camera: why a frame did not become part of a set, and other events.
 * The source counts INCOMPLETE, UNDERRUN and ID_GAP (only it knows which numbers it dropped itself).
 * rig/intake.c checks size, format and stamps of the pushed frames, and counts all the rest.  Only a source that
 * cannot even store a frame of another size counts that frame itself.
 * BAD_SIZE also counts frames that the driver calls good but that are too short.
 * The counts from CAP_CLOCK_STUCK on report faults (syncwatch.h, monitor.c).  They count no frame that the counts
 * before them do not count.  A window is 0.5 s, or 8 periods. */
#define CAP_COUNTS(M)                                                                              \
    M(CAP_RECEIVED, "received", "frames", "good frames handed over by the driver")                 \
    M(CAP_INCOMPLETE, "incomplete", "frames",                                                      \
      "packets missing, file unreadable, or another error")                                        \
    M(CAP_BAD_SIZE, "bad_size", "frames", "width, height or bytes are not what is configured")     \
    M(CAP_BAD_FORMAT, "bad_format", "frames", "pixel format is not what is configured")            \
    M(CAP_BAD_STAMP, "bad_stamp", "frames", "device time ran backwards or stood still")            \
    M(CAP_UNDERRUN, "underrun", "frames", "no free buffer: the consumer was too slow")             \
    M(CAP_OVERFLOW, "overflow", "frames", "displaced by newer ones: the consumer was too slow")    \
    M(CAP_LATE, "late", "frames", "came after its set had been closed")                            \
    M(CAP_UNMATCHED, "unmatched", "frames", "its set was never completed")                         \
    M(CAP_ID_GAP, "id_gap", "frames", "numbered by the camera but never seen")                     \
    M(CAP_LOST_CAMERA, "lost_camera", "times", "the camera stopped answering")                     \
    M(CAP_NO_TRIGGER, "no_trigger", "times", "the camera answered, but no pulse came on its line") \
    M(CAP_CLOCK_STUCK, "clock_stuck", "times", "device time stood still for several frames")       \
    M(CAP_CLOCK_JUMP, "clock_jump", "times", "the camera's clock jumped")                          \
    M(CAP_SLIP, "slip", "times", "frame numbers and times disagreed: pictures may be off by one")  \
    M(CAP_MISSED_TRIGGER, "missed_trigger", "frames", "not exposed while the other cameras did")   \
    M(CAP_TRIGGER_MODE, "trigger_mode", "times",                                                   \
      "it was in another trigger mode than it had been set to")                                    \
    M(CAP_OUT_OF_STEP, "out_of_step", "windows",                                                   \
      "exposed outside the tolerance around the others")                                           \
    M(CAP_PHASE_WALK, "phase_walk", "windows", "its exposures moved against the others'")          \
    M(CAP_RATE, "rate", "windows", "its frame rate was not what it should be")                     \
    M(CAP_BANDWIDTH, "bandwidth", "s", "several cameras at once sent incomplete frames")           \
    M(CAP_PTP_MASTERS, "ptp_masters", "s", "it was PTP master beside another camera")
#define CAP_COUNT_NUMBER(number, ...) number,
enum cap_count { CAP_COUNTS(CAP_COUNT_NUMBER) CAP_N_COUNT };
struct cap_count_def {
    const char *name, *unit, *help;
};
extern const struct cap_count_def cap_count_defs[CAP_N_COUNT];

enum cap_event { CAP_EV_LOST, CAP_EV_END }; /* camera gone (reopen it) / sequence finished */

/* All may be called from any thread of the source, push from one thread at a time.  The caller holds no lock that
 * stop needs: in a lossless run push waits for room (until the capture stops).  Otherwise it does not wait.
 * clock (NULL = not wanted): when the camera's clock (of t_device_ns) showed device_ns, the host's CLOCK_MONOTONIC
 * showed host_mono_ns +- bound_ns, half the round trip of the question.
 * detail (NULL = not wanted): describes the next count in a few words for a message; copied. */
#define CAP_DETAIL_MAX 112
struct cap_sink {
    void (*push)(void *ctx, struct cap_frame *f); /* takes the frame */
    void (*event)(void *ctx, uint32_t camera, enum cap_event ev);
    void (*count)(void *ctx, uint32_t camera, enum cap_count what, uint64_t n);
    void *ctx;
    void (*clock)(void *ctx, uint32_t camera, int64_t device_ns, int64_t host_mono_ns,
                  int64_t bound_ns);
    void (*detail)(void *ctx, uint32_t camera, enum cap_count what, const char *text);
};

struct cap_feature {
    char name[64], value[64];
};

/* What starts an exposure: the camera itself, one command per camera, a cable, or one broadcast GigE Vision
 * action command to all cameras (trigger.h). */
enum cap_trigger {
    CAP_TRIGGER_FREE_RUN,
    CAP_TRIGGER_SOFTWARE,
    CAP_TRIGGER_LINE,
    CAP_TRIGGER_ACTION
};

/* A camera acts on an action command with its device key and group key, and a mask that shares a bit with its own. */
struct cap_action_keys {
    uint32_t device_key, group_key, group_mask;
};

/* Whether to ask a GigE camera for lost packets again.  AUTO: if the camera reports that it can resend.  A frame
 * waits up to frame_retention_ms for its packets, and the frames behind it wait too. */
enum cap_resend { CAP_RESEND_AUTO, CAP_RESEND_ALWAYS, CAP_RESEND_NEVER };

/* All 0 are good defaults. */
struct cap_gige {
    int32_t packet_size;  /* bytes, 0 = negotiate */
    int32_t packet_delay; /* ns between two packets of a frame, 0 = leave */
    enum cap_resend resend;
    int32_t socket_buffer;     /* bytes, as far as net.core.rmem_max allows; 0 = 8 MiB */
    double frame_retention_ms; /* longest wait for the packets of a frame; 0 = 50 */
    double packet_timeout_ms;  /* after this delay a packet is asked for again; 0 = 5 */
    int32_t rt_priority;       /* SCHED_RR of the receiving thread; 0 = 10, -1 = none */
    bool no_packet_socket;     /* plain UDP even where AF_PACKET is allowed */
};

#define CAP_BUFFERS_MAX 65536

struct cap_source_config {
    const char *uri;  /* after the scheme: "127.0.0.2", "GV01", "DIR/cam0/%06d.png" */
    const char *name; /* camera's name in the rig, for messages */
    uint32_t camera;
    int32_t width, height;
    enum cap_pixfmt fmt; /* CAP_FMT_NONE = the source's choice */
    double fps;          /* 0 = the source's */
    enum cap_trigger trigger;
    const char *trigger_line;      /* LINE: "Line1"; NULL = that */
    struct cap_action_keys action; /* ACTION */
    bool ptp;                      /* camera clocks are to be synchronized (IEEE 1588) */
    double ptp_offset_us;          /* largest offset from the master; 0 = 10 */
    bool chunks;                   /* exposure and gain of each frame in its data */
    bool lines;       /* levels of its lines likewise (cap_frame.lines); aravis: only */
    unsigned buffers; /* frames in the pool, 4..CAP_BUFFERS_MAX */
    /* Of these, frames that a receiver beside the consumer keeps for long (take/ring.h); cap_source_memory. */
    unsigned held;
    bool again; /* the camera was open before; frames of that time may still be kept */
    struct cap_gige gige;
    double exposure_us, gain; /* < 0 = leave */
    /* GenICam features, V4L2 or libcamera controls: set at opening and read back */
    const struct cap_feature *features;
    size_t n_features;
    bool lossless;                 /* files: wait for room instead of dropping frames; no pacing */
    bool loop;                     /* files: start over at the end */
    const struct cap_scene *scene; /* sim: */
};

/* Memory for the frames of a source of which a receiver keeps many (c->held > 0): reserved pages (base/mem.h), locked as
 * they are touched.  If that is not permitted, a line of the log gives the remedy.  They are touched here.  When the
 * camera is opened again, its earlier frames are still kept, so pages are touched only as those leave.  A frame that
 * will not be used again discards its pages (pvx_discard).  So however often a camera is opened, there is memory for
 * c->buffers frames.  NULL: out of memory.  Release: pvx_unreserve. */
void *cap_source_memory(const struct cap_source_config *c, size_t bytes);

/* Errors and lines of the log that begin with "camera NAME (SCHEME:URI): ". */
#define CAP_FAIL(c, scheme, d, e, fmt, ...) \
    pvx_fail(d, e, "camera %s (" scheme ":%s): " fmt, (c)->name, (c)->uri, ##__VA_ARGS__)
#define CAP_LOG(level, c, scheme, why, fmt, ...)                        \
    LOG_ABOUT(level, CAPTURE, ABOUT(.cause = why, .camera = (c)->name), \
              "camera %s (" scheme ":%s): " fmt, (c)->name, (c)->uri, ##__VA_ARGS__)
#define CAP_DEBUG(c, scheme, fmt, ...) \
    LOG_D(CAPTURE, "camera %s (" scheme ":%s): " fmt, (c)->name, (c)->uri, ##__VA_ARGS__)

#define CAP_SERIAL_MAX 64
/* State of a running camera.  A source leaves values that it does not know as in cap_health_unknown. */
struct cap_health {
    double temperature_c; /* NAN = not known, as for all doubles here */
    char serial
        [CAP_SERIAL_MAX]; /* identifies it among cameras of its kind, on any port; "" = not known */
    char ptp[16];         /* "Slave", "Master", "Uncalibrated" ...; "" = no PTP, or it is off */
    double ptp_offset_ns; /* from the master */
    double link_mbps;
    uint64_t packets_resent, packets_missing; /* since start: arrived on request; never arrived */
    /* IPv4, host order: the camera's, and the broadcast address for commands to all cameras of its network;
     * 0 = not a network camera */
    uint32_t address, broadcast;
    struct { /* last reading, as given to cap_sink.clock; bound < 0 = none */
        int64_t device_ns, host_mono_ns, bound_ns;
    } clock;
};
extern const struct cap_health cap_health_unknown;

/* Images of a scene for sim:, given by the caller, so that capture needs no reconstruction code. */
struct cap_scene {
    /* Fill data (format fmt, tightly packed) with the camera's view at time t_real_ns.  Any thread. */
    void (*render)(void *ctx, uint32_t camera, int64_t t_real_ns, enum cap_pixfmt fmt, int32_t w,
                   int32_t h, void *data);
    void *ctx;
};

/* A camera that could be used; strings are borrowed for the call. */
struct cap_found {
    const char *uri;     /* with its scheme, as in the configuration */
    const char *text;    /* maker, model, serial ...: one line */
    const char *formats; /* lines "Mono8 640x480 15 30 Hz", our names; NULL = not asked */
};

/* The clock of t_device_ns. */
enum cap_clock {
    CAP_CLOCK_OWN, /* the camera's own: mapped to the host's on line (clockmap.h) */
    CAP_CLOCK_MONO /* the host's CLOCK_MONOTONIC: only its offset to CLOCK_REALTIME is added */
};

typedef struct cap_source cap_source;
struct cap_source_ops {
    const char *scheme, *help; /* "sim" without the colon; one line about the text after it */
    bool recorded; /* stamps follow from frame numbers: no clock to map, the first frame is good */
    enum cap_clock clock;
    pvx_err (*open)(const struct cap_source_config *c, cap_source **out, struct pvx_diag *d);
    pvx_err (*start)(cap_source *s, const struct cap_sink *sink, struct pvx_diag *d);
    pvx_err (*trigger)(cap_source *s); /* software trigger; NULL = not possible */
    bool triggers;                     /* can be set to wait for a line or an action command */
    /* Whether a camera that gives no frame is still there and still ours.  Called between start and stop from the
     * supervisor's thread, for cameras that wait for a line.  Takes some ms, at most 0.5 s.  NULL = not
     * possible. */
    bool (*answers)(cap_source *s);
    /* Between start and stop, from the thread that calls these.  Returns at once, with the last values that a slow
     * loop of the source has read.  NULL = nothing is known. */
    void (*health)(cap_source *s, struct cap_health *out);
    void (*stop)(cap_source *s);   /* no push after it returns; lent frames may still be released */
    void (*close)(cap_source **s); /* does not wait: lent frames keep the pool alive */
    /* Calls cb once for each camera that can be found, without disturbing a camera in use.  NULL = not
     * possible. */
    pvx_err (*list)(void (*cb)(void *ctx, const struct cap_found *f), void *ctx,
                    struct pvx_diag *d);
};
struct cap_source {
    const struct cap_source_ops *ops;
};
#endif
