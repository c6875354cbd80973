/* v4l2.h - shared by the files of the v4l2: backend (private to this folder).
 *
 * Source for the interface: the kernel's "Video for Linux API" (userspace-api/media/v4l). */
#ifndef CAP_V4L2_INT_H
#define CAP_V4L2_INT_H
#include <linux/videodev2.h>
#include "capture/source/source.h"

struct v4l_device {
    int fd;        /* O_NONBLOCK; -1 = closed */
    char node[64]; /* "/dev/video0" */
    char card[33], driver[17], bus[33];
    uint32_t type; /* V4L2_BUF_TYPE_VIDEO_CAPTURE or its _MPLANE */
};
static inline bool v4l_mplane(const struct v4l_device *dev)
{
    return dev->type == V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE;
}

/* ioctl(2), repeated when a signal interrupts it. */
int v4l_call(int fd, unsigned long request, void *arg);
/* The error for errno after `what` failed.  Its text names the camera, the programs that use the device (EBUSY), and
 * the remedy where there is one (EACCES, ENOSPC, EPIPE). */
pvx_err v4l_fail(const struct cap_source_config *c, const char *node, const char *what,
                 struct pvx_diag *d);

/* Text that is written piece by piece.  Text that does not fit is cut and ends in "...". */
struct v4l_text {
    char *at;
    size_t size, len;
};
void v4l_say(struct v4l_text *t, const char *fmt, ...) PVX_PRINTF(2, 3);

/* ---- find.c ---- */
/* Open the camera that c->uri names (see the source's help).  Owner: caller, v4l_close.
 * Errors: PVX_ENOENT (none; diag lists the cameras there are), PVX_EINVAL (more than one; diag lists names that
 * distinguish them), PVX_EPERM, PVX_EUNSUP (no capture device), PVX_EBUSY, PVX_ENODEV, PVX_EIO. */
PVX_MUST_CHECK pvx_err v4l_open(const struct cap_source_config *c, struct v4l_device *out,
                                struct pvx_diag *d);
void v4l_close(struct v4l_device *dev);
/* "usb-SERIAL" of an open device; "" = it has none, or another connected device has the same, as cheap ones do. */
void v4l_serial(const struct v4l_device *dev, char *out, size_t size);
PVX_MUST_CHECK pvx_err v4l_list(void (*cb)(void *ctx, const struct cap_found *f), void *ctx,
                                struct pvx_diag *d);

/* ---- formats.c ---- */
enum cap_pixfmt v4l_pixfmt(uint32_t fourcc); /* CAP_FMT_NONE: none of ours */
/* "YUYV"; big-endian codes end in "-BE". */
struct v4l_fourcc_text {
    char s[16];
};
struct v4l_fourcc_text v4l_fourcc_text(uint32_t fourcc);
/* enum cap_yuv of a driver's values.  DEFAULT values are resolved as in the kernel's documentation. */
uint8_t v4l_yuv(enum cap_pixfmt fmt, uint32_t colorspace, uint32_t ycbcr_enc, uint32_t quantization,
                uint32_t xfer_func);
/* Format number `index` of the device; 0 = no more. */
uint32_t v4l_enum_format(const struct v4l_device *dev, unsigned index);
/* List what the device offers: formats, "Mono8 YUV422_8; of no use here: NV12"; sizes of a format, "640x480 320x240";
 * rates of a size, "15 30" (Hz); and all of it, a line per format and size. */
void v4l_say_formats(const struct v4l_device *dev, struct v4l_text *t);
void v4l_say_sizes(const struct v4l_device *dev, uint32_t fourcc, struct v4l_text *t);
void v4l_say_rates(const struct v4l_device *dev, uint32_t fourcc, uint32_t w, uint32_t h,
                   struct v4l_text *t);
void v4l_say_all(const struct v4l_device *dev, struct v4l_text *t);

/* ---- controls.c ---- */
/* Set features, exposure and gain of the configuration, and read them back.  A refusal names the camera's own range.
 * Errors: PVX_EINVAL, PVX_EBUSY, PVX_EIO. */
PVX_MUST_CHECK pvx_err v4l_set_controls(const struct cap_source_config *c,
                                        const struct v4l_device *dev, struct pvx_diag *d);
/* Exposure time [us] and gain if they are fixed and the camera reports them (exposure: in units of time); else
 * NAN. */
double v4l_fixed_exposure_us(const struct v4l_device *dev);
double v4l_fixed_gain(const struct v4l_device *dev);

/* ---- setup.c ---- */
struct v4l_layout {
    int32_t width, height;
    enum cap_pixfmt fmt;
    uint8_t yuv;
    ptrdiff_t stride; /* 0 for JPEG */
    size_t size;      /* bytes of a full frame, from the driver */
    double fps;       /* read back; 0 = the driver does not report it */
};
/* Set format, size and frame rate of the configuration, and read them back. */
PVX_MUST_CHECK pvx_err v4l_set_layout(const struct cap_source_config *c,
                                      const struct v4l_device *dev, struct v4l_layout *l,
                                      struct pvx_diag *d);
#endif
