/* shim.h - the libcamera module (lib/pyrovox/pyrovox-libcamera.so) as plain C.
 *
 * The module is C++.  libcamera.c loads it with dlopen on first use, so the program also runs without libcamera.
 * It exports one function, cap_lc_module, and no exception leaves it.  Functions that can fail return a pvx_err value
 * as int, and put a line into `err` when that is not 0.
 * It compiles against libcamera 0.0.3 (Debian 12) and the current API.  Only the shim has code for the differences,
 * guarded by LIBCAMERA_VERSION_*.  Every release of libcamera has another soname, so the module needs the release
 * that it was built with.
 * Threads: callbacks run on libcamera's one thread for all cameras, so they should only hand over.  requeue from any
 * thread; open, start, stop, close of one camera from one thread at a time. */
#ifndef CAP_LIBCAMERA_SHIM_H
#define CAP_LIBCAMERA_SHIM_H
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#define CAP_LC_NOEXCEPT noexcept
#else
#define CAP_LC_NOEXCEPT
#endif

#define CAP_LC_VERSION 1

struct cap_lc_camera; /* opaque */
struct cap_lc_memory; /* opaque: the mapped buffers; may outlive the camera */

/* DRM's names of formats: 4 characters and a modifier. */
struct cap_lc_format {
    uint32_t fourcc;
    uint64_t modifier;
};
enum cap_lc_range { CAP_LC_RANGE_UNKNOWN, CAP_LC_RANGE_FULL, CAP_LC_RANGE_LIMITED };

struct cap_lc_mode {
    struct cap_lc_format format;
    int32_t width, height;
};
struct cap_lc_layout {
    struct cap_lc_mode mode;
    uint32_t stride, frame_bytes, buffers;
    int rec709;          /* the YUV matrix is BT.709's, else BT.601's */
    int transfer_rec709; /* gamma of television, else sRGB's */
    int full_range;      /* enum cap_lc_range */
    int has_duration;    /* the frame rate can be set */
};
struct cap_lc_control {
    const char *name, *value; /* libcamera's name; numbers, several with commas */
};
struct cap_lc_config {
    const char *id; /* of list() */
    int raw;        /* first choice: 1 = the sensor's raw stream, 0 = a processed one */
    /* Choose one of the n modes that the camera offers (index), or -1.  *width and *height may be set to another
     * size of the same format.  Called once, before anything is changed. */
    int (*choose)(void *ctx, const struct cap_lc_mode *mode, size_t n, int32_t *width,
                  int32_t *height);
    void *choose_ctx;
    uint32_t buffers;         /* asked for */
    int64_t frame_us;         /* 0 = leave */
    double exposure_us, gain; /* < 0 = leave */
    const struct cap_lc_control *control;
    size_t n_controls;
};
struct cap_lc_frame {
    uint32_t index; /* of the buffer, which stays with the receiver until requeue */
    const void *data;
    size_t bytes;
    uint32_t sequence;
    int64_t stamp_ns;         /* SensorTimestamp, else the buffer's */
    double exposure_us, gain; /* of this frame; NAN = not reported */
    double temperature_c;     /* of the sensor; NAN = not reported */
    int good;                 /* 0: error; -1: a start-up frame, not to be shown */
};
struct cap_lc_sink {
    void (*frame)(void *ctx, const struct cap_lc_frame *f);
    void (*gone)(void *ctx); /* the camera was unplugged */
    void *ctx;
};

struct cap_lc {
    int version;         /* CAP_LC_VERSION */
    const char *library; /* "0.0.3" */
    /* list: the cameras now present; starts libcamera on first use.  modes: calls `mode` for each mode of a
     * camera. */
    int (*list)(void (*camera)(void *ctx, const char *id, const char *model), void *ctx, char *err,
                size_t err_size) CAP_LC_NOEXCEPT;
    int (*modes)(const char *id, void (*mode)(void *ctx, const struct cap_lc_mode *m), void *ctx,
                 char *err, size_t err_size) CAP_LC_NOEXCEPT;
    /* Acquire and configure the camera, and map its buffers.  PVX_ENOENT, PVX_EBUSY, PVX_EINVAL (a control),
     * PVX_EUNSUP (choose returned -1, or the camera would do something else), PVX_EIO. */
    int (*open)(const struct cap_lc_config *c, struct cap_lc_camera **out,
                struct cap_lc_memory **memory, struct cap_lc_layout *layout, char *err,
                size_t err_size) CAP_LC_NOEXCEPT;
    int (*start)(struct cap_lc_camera *c, const struct cap_lc_sink *sink, char *err,
                 size_t err_size) CAP_LC_NOEXCEPT;
    int (*requeue)(struct cap_lc_camera *c, uint32_t index) CAP_LC_NOEXCEPT; /* 0: queued */
    /* Whether, at the tenth frame, the camera reports controls with other values than asked for: 1 once, with a line
     * in `text`; else 0. */
    int (*differs)(struct cap_lc_camera *c, char *text, size_t size) CAP_LC_NOEXCEPT;
    void (*stop)(struct cap_lc_camera *c) CAP_LC_NOEXCEPT; /* no callback after it returns */
    void (*close)(struct cap_lc_camera *c) CAP_LC_NOEXCEPT;
    void (*unmap)(struct cap_lc_memory *m) CAP_LC_NOEXCEPT;
};

const struct cap_lc *cap_lc_module(void) CAP_LC_NOEXCEPT;

#ifdef __cplusplus
}
#endif
#endif
