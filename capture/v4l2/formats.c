#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>

#include "capture/v4l2/v4l2.h"

#ifndef V4L2_PIX_FMT_Y12P /* Linux 6.3 */
#define V4L2_PIX_FMT_Y12P v4l2_fourcc('Y', '1', '2', 'P')
#endif
#define MAX_ENUM 256 /* entries of a list that a driver gives */

int v4l_call(int fd, unsigned long request, void *arg)
{
    int r;
    do
        r = ioctl(fd, request, arg);
    while (r < 0 && errno == EINTR);
    return r;
}

#define BAYER(suffix, depth)                               \
    {V4L2_PIX_FMT_SRGGB##suffix, CAP_BAYER_RG##depth},     \
        {V4L2_PIX_FMT_SGRBG##suffix, CAP_BAYER_GR##depth}, \
        {V4L2_PIX_FMT_SGBRG##suffix, CAP_BAYER_GB##depth}, \
    {                                                      \
        V4L2_PIX_FMT_SBGGR##suffix, CAP_BAYER_BG##depth    \
    }
static const struct {
    uint32_t fourcc;
    enum cap_pixfmt fmt;
} table[] = {
    {V4L2_PIX_FMT_GREY, CAP_GREY8},
    {V4L2_PIX_FMT_Y10, CAP_GREY10},
    {V4L2_PIX_FMT_Y12, CAP_GREY12},
    {V4L2_PIX_FMT_Y14, CAP_GREY14},
    {V4L2_PIX_FMT_Y16, CAP_GREY16},
    {V4L2_PIX_FMT_Y10P, CAP_GREY10CSI},
    {V4L2_PIX_FMT_Y12P, CAP_GREY12CSI},
    {V4L2_PIX_FMT_RGB24, CAP_RGB8},
    {V4L2_PIX_FMT_BGR24, CAP_BGR8},
    {V4L2_PIX_FMT_YUYV, CAP_YUYV},
    {V4L2_PIX_FMT_UYVY, CAP_UYVY},
    {V4L2_PIX_FMT_MJPEG, CAP_JPEG},
    {V4L2_PIX_FMT_JPEG, CAP_JPEG},
    BAYER(8, 8),
    BAYER(10, 10),
    BAYER(12, 12),
    BAYER(14, 14),
    BAYER(16, 16),
    BAYER(10P, 10CSI),
    BAYER(12P, 12CSI),
};
#define N_TABLE (sizeof table / sizeof table[0])

enum cap_pixfmt v4l_pixfmt(uint32_t fourcc)
{
    for (size_t i = 0; i < N_TABLE; i++)
        if (table[i].fourcc == fourcc)
            return table[i].fmt;
    return CAP_FMT_NONE;
}

struct v4l_fourcc_text v4l_fourcc_text(uint32_t fourcc)
{
    struct v4l_fourcc_text t = {""};
    size_t n = 0;
    for (int i = 0; i < 4; i++) {
        char ch = (char)(fourcc >> (8 * i) & 0x7f);
        t.s[n++] = ch > ' ' && ch < 0x7f ? ch : ' ';
    }
    while (n > 0 && t.s[n - 1] == ' ')
        t.s[--n] = '\0';
    if (fourcc >> 31)
        snprintf(t.s + n, sizeof t.s - n, "-BE");
    return t;
}

/* Among the matrices and curves known here, BT.709 is the nearest to BT.2020 and SMPTE 240M. */
uint8_t v4l_yuv(enum cap_pixfmt fmt, uint32_t colorspace, uint32_t ycbcr_enc, uint32_t quantization,
                uint32_t xfer_func)
{
    enum cap_layout layout = cap_pixfmt_layout(fmt);
    if (layout != CAP_LAYOUT_YUV && layout != CAP_LAYOUT_JPEG)
        return 0;
    if (ycbcr_enc == V4L2_YCBCR_ENC_DEFAULT)
        ycbcr_enc = V4L2_MAP_YCBCR_ENC_DEFAULT(colorspace);
    if (quantization == V4L2_QUANTIZATION_DEFAULT)
        quantization = V4L2_MAP_QUANTIZATION_DEFAULT(0, colorspace, ycbcr_enc);
    if (xfer_func == V4L2_XFER_FUNC_DEFAULT && colorspace != V4L2_COLORSPACE_DEFAULT)
        xfer_func = V4L2_MAP_XFER_FUNC_DEFAULT(colorspace);
    bool tv = xfer_func == V4L2_XFER_FUNC_709 || xfer_func == V4L2_XFER_FUNC_SMPTE240M;
    uint8_t transfer = tv ? CAP_YUV_TRANSFER_709 : 0;
    if (layout == CAP_LAYOUT_JPEG) /* the rest is in its own header */
        return transfer;
    bool is_601 = ycbcr_enc == V4L2_YCBCR_ENC_601 || ycbcr_enc == V4L2_YCBCR_ENC_XV601 ||
                  ycbcr_enc == V4L2_YCBCR_ENC_SYCC;
    bool full = quantization == V4L2_QUANTIZATION_FULL_RANGE;
    return (uint8_t)((is_601 ? CAP_YUV_601 : CAP_YUV_709) | (full ? CAP_YUV_FULL : 0) | transfer);
}

/* ---- what a device offers --------------------------------------------------------------------- */

void v4l_say(struct v4l_text *t, const char *fmt, ...)
{
    if (t->len + 1 >= t->size)
        return;
    va_list ap;
    va_start(ap, fmt);
    int n = vsnprintf(t->at + t->len, t->size - t->len, fmt, ap);
    va_end(ap);
    if (n < 0)
        return;
    t->len += (size_t)n;
    if (t->len >= t->size) {
        t->len = t->size - 1;
        if (t->size > 4)
            memcpy(t->at + t->size - 4, "...", 4);
    }
}

uint32_t v4l_enum_format(const struct v4l_device *dev, unsigned index)
{
    struct v4l2_fmtdesc f = {.index = index, .type = dev->type};
    if (index >= MAX_ENUM || v4l_call(dev->fd, VIDIOC_ENUM_FMT, &f) != 0)
        return 0;
    return f.pixelformat;
}

void v4l_say_formats(const struct v4l_device *dev, struct v4l_text *t)
{
    uint32_t code;
    bool other = false;
    for (unsigned i = 0; (code = v4l_enum_format(dev, i)) != 0; i++)
        if (v4l_pixfmt(code) != CAP_FMT_NONE)
            v4l_say(t, "%s%s", t->len > 0 ? " " : "", cap_pixfmt_name(v4l_pixfmt(code)));
        else
            other = true;
    if (!other)
        return;
    v4l_say(t, "%sof no use here:", t->len > 0 ? "; " : "nothing; ");
    for (unsigned i = 0; (code = v4l_enum_format(dev, i)) != 0; i++)
        if (v4l_pixfmt(code) == CAP_FMT_NONE)
            v4l_say(t, " %s", v4l_fourcc_text(code).s);
}

static bool size_at(const struct v4l_device *dev, uint32_t fourcc, unsigned i,
                    struct v4l2_frmsizeenum *out)
{
    *out = (struct v4l2_frmsizeenum){.index = i, .pixel_format = fourcc};
    return i < MAX_ENUM && v4l_call(dev->fd, VIDIOC_ENUM_FRAMESIZES, out) == 0;
}

static void formats_say_range(const struct v4l2_frmsize_stepwise *s, struct v4l_text *t)
{
    v4l_say(t, "%ux%u..%ux%u", s->min_width, s->min_height, s->max_width, s->max_height);
    if (s->step_width > 1 || s->step_height > 1)
        v4l_say(t, " in steps of %ux%u", s->step_width, s->step_height);
}

void v4l_say_sizes(const struct v4l_device *dev, uint32_t fourcc, struct v4l_text *t)
{
    struct v4l2_frmsizeenum s;
    for (unsigned i = 0; size_at(dev, fourcc, i, &s); i++) {
        v4l_say(t, "%s", i > 0 ? " " : "");
        if (s.type != V4L2_FRMSIZE_TYPE_DISCRETE) {
            formats_say_range(&s.stepwise, t);
            return;
        }
        v4l_say(t, "%ux%u", s.discrete.width, s.discrete.height);
    }
}

static double hertz(const struct v4l2_fract *period)
{
    return period->numerator > 0 ? (double)period->denominator / (double)period->numerator : 0;
}

void v4l_say_rates(const struct v4l_device *dev, uint32_t fourcc, uint32_t w, uint32_t h,
                   struct v4l_text *t)
{
    for (unsigned i = 0; i < MAX_ENUM; i++) {
        struct v4l2_frmivalenum v = {.index = i, .pixel_format = fourcc, .width = w, .height = h};
        if (v4l_call(dev->fd, VIDIOC_ENUM_FRAMEINTERVALS, &v) != 0)
            return;
        v4l_say(t, "%s", i > 0 ? " " : "");
        if (v.type != V4L2_FRMIVAL_TYPE_DISCRETE) {
            v4l_say(t, "%.4g..%.4g", hertz(&v.stepwise.max), hertz(&v.stepwise.min));
            return;
        }
        v4l_say(t, "%.4g", hertz(&v.discrete));
    }
}

static void say_line(const struct v4l_device *dev, uint32_t code, const struct v4l2_frmsizeenum *s,
                     struct v4l_text *t)
{
    bool one = s->type == V4L2_FRMSIZE_TYPE_DISCRETE;
    v4l_say(t, "%s%s ", t->len > 0 ? "\n" : "", cap_pixfmt_name(v4l_pixfmt(code)));
    if (one)
        v4l_say(t, "%ux%u", s->discrete.width, s->discrete.height);
    else
        formats_say_range(&s->stepwise, t);
    size_t before = t->len;
    v4l_say(t, " ");
    v4l_say_rates(dev, code, one ? s->discrete.width : s->stepwise.max_width,
                  one ? s->discrete.height : s->stepwise.max_height, t);
    if (t->len > before + 1)
        v4l_say(t, " Hz");
    else if (t->len == before + 1)
        t->at[--t->len] = '\0';
}

void v4l_say_all(const struct v4l_device *dev, struct v4l_text *t)
{
    uint32_t code;
    for (unsigned i = 0; (code = v4l_enum_format(dev, i)) != 0; i++) {
        struct v4l2_frmsizeenum s;
        if (v4l_pixfmt(code) == CAP_FMT_NONE)
            continue;
        if (!size_at(dev, code, 0, &s))
            v4l_say(t, "%s%s", t->len > 0 ? "\n" : "", cap_pixfmt_name(v4l_pixfmt(code)));
        for (unsigned k = 0; size_at(dev, code, k, &s); k++) {
            say_line(dev, code, &s, t);
            if (s.type != V4L2_FRMSIZE_TYPE_DISCRETE)
                break;
        }
    }
}
