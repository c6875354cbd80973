/* source.h - one camera, whatever stands behind it (Aravis, files, simulation).
 *
 * A backend's driver thread only stamps and pushes: the sink takes the frame and returns at once.
 * A frame is lent by the source's fixed buffer pool until cap_frame_release; no buffer free = the
 * source counts an underrun and drops its newest frame.
 * Times: t_device on the camera's clock (0 = none), t_arrival when the driver's callback ran. */
#ifndef CAP_SOURCE_H
#define CAP_SOURCE_H
#include <stdbool.h>
#include "base/err.h"
#include "capture/image.h"

struct cap_frame {
    struct cap_image img;
    uint32_t camera;      /* index in the rig */
    uint64_t id;          /* camera's own frame number, widened past wraps; gaps = lost frames */
    int64_t t_device_ns;  /* exposure, on the clock that enum cap_clock names; 0 = not known */
    int64_t t_arrival_ns; /* host CLOCK_REALTIME */
    int64_t t_arrival_mono_ns;
    int64_t t_exposure_ns; /* host CLOCK_REALTIME, filled by the clock map (clockmap.h) */
    int dmabuf;            /* DMABUF file of the memory that img.data lies in, borrowed; 0 = none */
    void (*release)(struct cap_frame *f);
    void *owner;
};
void cap_frame_release(struct cap_frame *f); /* any thread; NULL is fine */

/* The source counts INCOMPLETE, UNDERRUN and ID_GAP (only it knows which numbers it dropped itself).
 * Size, format and stamps of the frames that it pushes are checked and counted by capture.c, as all
 * the rest; a source that cannot even store a frame of another size counts that itself. */
/* Why a frame did not become part of a set, and what else is counted, per camera. */
enum cap_count {
    CAP_RECEIVED,    /* good frames handed over by the driver */
    CAP_INCOMPLETE,  /* frames with missing packets or another transport error */
    CAP_BAD_SIZE,    /* width, height or bytes are not what was configured (also short SUCCESS) */
    CAP_BAD_FORMAT,  /* pixel format changed under way */
    CAP_BAD_STAMP,   /* device time runs backwards or stands still */
    CAP_UNDERRUN,    /* no free buffer: consumer too slow */
    CAP_OVERFLOW,    /* a newer frame or set displaced it before the consumer took it */
    CAP_LATE,        /* came after its set had been closed */
    CAP_UNMATCHED,   /* its set was never completed (partial set dropped) */
    CAP_ID_GAP,      /* frames that the camera numbered but we never saw */
    CAP_LOST_CAMERA, /* times the camera stopped answering */
    CAP_N_COUNT
};
struct cap_count_def {
    const char *name, *unit, *help;
};
extern const struct cap_count_def cap_count_defs[CAP_N_COUNT];

enum cap_event { CAP_EV_LOST, CAP_EV_END }; /* camera gone (reopen it) / sequence finished */

/* All three may be called from any thread of the source, holding no lock that stop needs: in a
 * lossless run push waits for room (until the capture stops). */
struct cap_sink {
    void (*push)(void *ctx, struct cap_frame *f); /* takes the frame */
    void (*event)(void *ctx, uint32_t camera, enum cap_event ev);
    void (*count)(void *ctx, uint32_t camera, enum cap_count what, uint64_t n);
    void *ctx;
};

struct cap_feature {
    char name[64], value[64];
};

/* Ask a GigE camera for lost packets again?  AUTO: when it says that it can.  A frame waits up to
 * 50 ms for them, and the frames behind it with it. */
enum cap_resend { CAP_RESEND_AUTO, CAP_RESEND_ALWAYS, CAP_RESEND_NEVER };

struct cap_source_config {
    const char *uri;  /* after the scheme: "127.0.0.2", "GV01", "DIR/cam0/%06d.png" */
    const char *name; /* camera's name in the rig, for messages */
    uint32_t camera;
    int32_t width, height;
    enum cap_pixfmt fmt;                /* CAP_FMT_NONE = the source's choice */
    double fps;                         /* 0 = the source's */
    bool software_trigger;              /* else free run */
    unsigned buffers;                   /* frames in the pool, >= 4 */
    int32_t packet_size;                /* GigE: bytes, 0 = negotiate */
    enum cap_resend resend;             /* GigE */
    double exposure_us, gain;           /* < 0 = leave */
    const struct cap_feature *features; /* GenICam features set at opening, read back */
    size_t n_features;
    bool lossless;                 /* files: wait for room instead of dropping; no pacing */
    bool loop;                     /* files: start over at the end */
    const struct cap_scene *scene; /* sim: */
};

/* Images of a scene for sim: - given by the caller, so that capture needs no reconstruction code. */
struct cap_scene {
    /* Fill data (format fmt, tightly packed) with what camera sees at time t. Any thread. */
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

/* What t_device_ns counts. */
enum cap_clock {
    CAP_CLOCK_OWN, /* the camera's own time: mapped to the host's on line (clockmap.h) */
    CAP_CLOCK_MONO /* the host's CLOCK_MONOTONIC: only its distance to CLOCK_REALTIME is added */
};

typedef struct cap_source cap_source;
struct cap_source_ops {
    const char *scheme, *help; /* "sim" without the colon; what may follow it, one line */
    bool
        recorded; /* stamps follow from frame numbers: no clock to map, no first frame to distrust */
    enum cap_clock clock;
    pvx_err (*open)(const struct cap_source_config *c, cap_source **out, struct pvx_diag *d);
    pvx_err (*start)(cap_source *s, const struct cap_sink *sink, struct pvx_diag *d);
    pvx_err (*trigger)(cap_source *s); /* software trigger; NULL = cannot */
    void (*stop)(cap_source *s);   /* no push after it returns; frames out may still be released */
    void (*close)(cap_source **s); /* waits for no one: outstanding frames keep the pool alive */
    /* Call cb once per camera that can be found, without disturbing one that is in use; NULL = cannot
     * list. */
    pvx_err (*list)(void (*cb)(void *ctx, const struct cap_found *f), void *ctx,
                    struct pvx_diag *d);
};
struct cap_source {
    const struct cap_source_ops *ops;
};

/* Backends built in (the table is in source.c), NULL-terminated; and the one for "scheme:rest" (*rest = after the colon). */
const struct cap_source_ops *const *cap_backends(void);
const struct cap_source_ops *cap_backend_find(const char *uri, const char **rest);
#endif
