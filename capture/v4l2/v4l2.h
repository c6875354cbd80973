/* v4l2.h - what the files of the v4l2: backend share (private to this folder).
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

/* ioctl(2), asked again when a signal interrupts it. */
int v4l_call(int fd, unsigned long request, void *arg);
/* Error of errno after `what` failed: names the camera, the programs that use the device (EBUSY), and the remedy
 * for what has one (EACCES, ENOSPC, EPIPE). */
pvx_err v4l_fail(const struct cap_source_config *c, const char *node, const char *what,
                 struct pvx_diag *d);

/* Text that is put together piece by piece; what does not fit is cut and ends in "...". */
struct v4l_text {
    char *at;
    size_t size, len;
};
void v4l_say(struct v4l_text *t, const char *fmt, ...) PVX_PRINTF(2, 3);

/* ---- find.c ---- */
/* Open the camera that c->uri names (source's help).  Owner: caller, v4l_close.
 * Errors: PVX_ENOENT (none; diag lists those there are), PVX_EINVAL (more than one; diag lists what
 * tells them apart), PVX_EPERM, PVX_EUNSUP (no capture device), PVX_EBUSY, PVX_ENODEV, PVX_EIO. */
PVX_MUST_CHECK pvx_err v4l_open(const struct cap_source_config *c, struct v4l_device *out,
                                struct pvx_diag *d);
void v4l_close(struct v4l_device *dev);
/* "usb-SERIAL" of an open device; "" = it has none, or another that is plugged in has the same, as cheap ones do. */
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
/* enum cap_yuv of what a driver says; DEFAULT of each as the kernel's documentation resolves it. */
uint8_t v4l_yuv(enum cap_pixfmt fmt, uint32_t colorspace, uint32_t ycbcr_enc, uint32_t quantization,
                uint32_t xfer_func);
/* Index-th format of the device, 0 = no more. */
uint32_t v4l_enum_format(const struct v4l_device *dev, unsigned index);
/* What the device offers: "Mono8 YUV422_8; of no use here: NV12"; "640x480 320x240" of a format;
 * "15 30" (Hz) of a size; and all of it, a line per format and size. */
void v4l_say_formats(const struct v4l_device *dev, struct v4l_text *t);
void v4l_say_sizes(const struct v4l_device *dev, uint32_t fourcc, struct v4l_text *t);
void v4l_say_rates(const struct v4l_device *dev, uint32_t fourcc, uint32_t w, uint32_t h,
                   struct v4l_text *t);
void v4l_say_all(const struct v4l_device *dev, struct v4l_text *t);

/* ---- controls.c ---- */
/* Features, exposure and gain of the configuration: set, read back, refused with the camera's own
 * range.  Errors: PVX_EINVAL, PVX_EBUSY, PVX_EIO. */
PVX_MUST_CHECK pvx_err v4l_set_controls(const struct cap_source_config *c,
                                        const struct v4l_device *dev, struct pvx_diag *d);
/* Exposure time [us] and gain when they are fixed and the camera says them (exposure: in units of time); else NAN. */
double v4l_fixed_exposure_us(const struct v4l_device *dev);
double v4l_fixed_gain(const struct v4l_device *dev);

/* ---- setup.c ---- */
struct v4l_layout {
    int32_t width, height;
    enum cap_pixfmt fmt;
    uint8_t yuv;
    ptrdiff_t stride; /* 0 for JPEG */
    size_t size;      /* bytes of a full frame, as the driver says */
    double fps;       /* read back; 0 = the driver does not say */
};
/* Format, size and frame rate of the configuration, read back. */
PVX_MUST_CHECK pvx_err v4l_set_layout(const struct cap_source_config *c,
                                      const struct v4l_device *dev, struct v4l_layout *l,
                                      struct pvx_diag *d);
#endif
