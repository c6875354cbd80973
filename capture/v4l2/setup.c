#include <math.h>

#include "base/log.h"
#include "capture/v4l2/v4l2.h"

/* The picture format, for both forms of the interface. */
struct picture {
    uint32_t fourcc, width, height, field, stride, size;
    uint32_t colorspace, ycbcr_enc, quantization, xfer_func;
};

static struct picture picture_of(const struct v4l2_format *f)
{
    if (f->type == V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE) {
        const struct v4l2_pix_format_mplane *m = &f->fmt.pix_mp;
        return (struct picture){m->pixelformat,
                                m->width,
                                m->height,
                                m->field,
                                m->plane_fmt[0].bytesperline,
                                m->plane_fmt[0].sizeimage,
                                m->colorspace,
                                m->ycbcr_enc,
                                m->quantization,
                                m->xfer_func};
    }
    const struct v4l2_pix_format *p = &f->fmt.pix;
    bool extended = p->priv == V4L2_PIX_FMT_PRIV_MAGIC;
    return (struct picture){p->pixelformat,
                            p->width,
                            p->height,
                            p->field,
                            p->bytesperline,
                            p->sizeimage,
                            p->colorspace,
                            extended ? p->ycbcr_enc : V4L2_YCBCR_ENC_DEFAULT,
                            extended ? p->quantization : V4L2_QUANTIZATION_DEFAULT,
                            extended ? p->xfer_func : V4L2_XFER_FUNC_DEFAULT};
}

static struct v4l2_format setup_format_of(const struct v4l_device *dev, uint32_t fourcc, uint32_t w,
                                          uint32_t h)
{
    struct v4l2_format f = {.type = dev->type};
    if (v4l_mplane(dev)) {
        f.fmt.pix_mp = (struct v4l2_pix_format_mplane){.width = w,
                                                       .height = h,
                                                       .pixelformat = fourcc,
                                                       .field = V4L2_FIELD_NONE,
                                                       .num_planes = 1};
    } else {
        f.fmt.pix = (struct v4l2_pix_format){.width = w,
                                             .height = h,
                                             .pixelformat = fourcc,
                                             .field = V4L2_FIELD_NONE,
                                             .priv = V4L2_PIX_FMT_PRIV_MAGIC};
    }
    return f;
}

static pvx_err refused_format(const struct cap_source_config *c, const struct v4l_device *dev,
                              struct pvx_diag *d)
{
    char offered[400] = "";
    v4l_say_formats(dev, &(struct v4l_text){offered, sizeof offered, 0});
    return CAP_FAIL(c, "v4l2", d, PVX_EINVAL, "format %s refused: the camera offers %s",
                    cap_pixfmt_name(c->fmt), offered);
}

/* Choose the code to ask for: the configured one, else the camera's present one, else its first. */
static pvx_err setup_choose(const struct cap_source_config *c, const struct v4l_device *dev,
                            const struct picture *now, uint32_t *out, struct pvx_diag *d)
{
    uint32_t code;
    enum cap_pixfmt has = v4l_pixfmt(now->fourcc);
    *out = now->fourcc;
    if (has != CAP_FMT_NONE && (c->fmt == CAP_FMT_NONE || has == c->fmt))
        return PVX_OK;
    for (unsigned i = 0; (code = v4l_enum_format(dev, i)) != 0; i++) {
        enum cap_pixfmt fmt = v4l_pixfmt(code);
        *out = code;
        if (fmt != CAP_FMT_NONE && (c->fmt == CAP_FMT_NONE || fmt == c->fmt))
            return PVX_OK;
    }
    if (c->fmt != CAP_FMT_NONE)
        return refused_format(c, dev, d);
    char offered[400] = "";
    v4l_say_formats(dev, &(struct v4l_text){offered, sizeof offered, 0});
    return CAP_FAIL(c, "v4l2", d, PVX_EUNSUP, "the camera offers %s", offered);
}

static pvx_err setup_check_size(const struct cap_source_config *c, const struct v4l_device *dev,
                                const struct picture *p, struct pvx_diag *d)
{
    if (c->width <= 0 || c->height <= 0 ||
        (p->width == (uint32_t)c->width && p->height == (uint32_t)c->height))
        return PVX_OK;
    char offered[300] = "";
    v4l_say_sizes(dev, p->fourcc, &(struct v4l_text){offered, sizeof offered, 0});
    return CAP_FAIL(c, "v4l2", d, PVX_EINVAL,
                    "image size %dx%d refused: the camera gives %ux%u; of %s it offers %s",
                    c->width, c->height, p->width, p->height,
                    cap_pixfmt_name(v4l_pixfmt(p->fourcc)), offered);
}

static pvx_err read_layout(const struct cap_source_config *c, const struct v4l_device *dev,
                           const struct picture *p, struct v4l_layout *l, struct pvx_diag *d)
{
    *l = (struct v4l_layout){.width = (int32_t)p->width,
                             .height = (int32_t)p->height,
                             .fmt = v4l_pixfmt(p->fourcc),
                             .size = p->size};
    if (c->fmt != CAP_FMT_NONE && l->fmt != c->fmt)
        return refused_format(c, dev, d);
    PVX_TRY(setup_check_size(c, dev, p, d));
    if (p->width < 1 || p->height < 1 || p->width > 65536 || p->height > 65536)
        return CAP_FAIL(c, "v4l2", d, PVX_EUNSUP, "image size %ux%u", p->width, p->height);
    if (p->field != V4L2_FIELD_NONE && p->field != V4L2_FIELD_ANY)
        return CAP_FAIL(c, "v4l2", d, PVX_EUNSUP,
                        "it gives interlaced pictures (field order %u), whose "
                        "rows are of two instants",
                        p->field);
    enum cap_layout kind = cap_pixfmt_layout(l->fmt);
    l->yuv = v4l_yuv(l->fmt, p->colorspace, p->ycbcr_enc, p->quantization, p->xfer_func);
    if (kind == CAP_LAYOUT_JPEG)
        return PVX_OK;
    size_t row = cap_pixfmt_row(l->fmt, l->width);
    l->stride = (ptrdiff_t)(p->stride > 0 ? p->stride : row); /* 0: some drivers leave it out */
    size_t need = (size_t)l->stride * (size_t)(l->height - 1) + row;
    if (l->stride < (ptrdiff_t)row || l->size < need)
        return CAP_FAIL(c, "v4l2", d, PVX_EIO,
                        "its driver %s says %u bytes per row and %u per image "
                        "of %ux%u %s, which needs %zu and %zu",
                        dev->driver, p->stride, p->size, p->width, p->height,
                        cap_pixfmt_name(l->fmt), row, need);
    return PVX_OK;
}

static pvx_err v4l2_set_format(const struct cap_source_config *c, const struct v4l_device *dev,
                               struct v4l_layout *l, uint32_t *code, struct pvx_diag *d)
{
    struct v4l2_format f = {.type = dev->type};
    if (v4l_call(dev->fd, VIDIOC_G_FMT, &f) != 0)
        return v4l_fail(c, dev->node, "VIDIOC_G_FMT", d);
    struct picture now = picture_of(&f);
    PVX_TRY(setup_choose(c, dev, &now, code, d));
    bool sized = c->width > 0 && c->height > 0;
    f = setup_format_of(dev, *code, sized ? (uint32_t)c->width : now.width,
                        sized ? (uint32_t)c->height : now.height);
    /* A driver silently replaces values that it does not support, so the answer is checked. */
    if (v4l_call(dev->fd, VIDIOC_S_FMT, &f) != 0)
        return v4l_fail(c, dev->node, "VIDIOC_S_FMT", d);
    if (v4l_mplane(dev) && f.fmt.pix_mp.num_planes != 1)
        return CAP_FAIL(c, "v4l2", d, PVX_EUNSUP, "%s lies in %u planes of memory",
                        v4l_fourcc_text(*code).s, f.fmt.pix_mp.num_planes);
    struct picture p = picture_of(&f);
    *code = p.fourcc;
    return read_layout(c, dev, &p, l, d);
}

/* The period as a fraction that drivers' tables contain: whole rates exactly, others to 1/1000 Hz. */
static struct v4l2_fract period_of(double fps)
{
    double whole = nearbyint(fps);
    if (fabs(fps - whole) < 1e-6 && whole < 1e6)
        return (struct v4l2_fract){1, (uint32_t)whole};
    return (struct v4l2_fract){1000, (uint32_t)lrint(fps * 1000)};
}

static pvx_err set_rate(const struct cap_source_config *c, const struct v4l_device *dev,
                        uint32_t code, struct v4l_layout *l, struct pvx_diag *d)
{
    struct v4l2_streamparm p = {.type = dev->type};
    struct v4l2_fract *period = &p.parm.capture.timeperframe;
    bool can = v4l_call(dev->fd, VIDIOC_G_PARM, &p) == 0 &&
               (p.parm.capture.capability & V4L2_CAP_TIMEPERFRAME) != 0;
    if (can && c->fps > 0) {
        *period = period_of(c->fps);
        if (v4l_call(dev->fd, VIDIOC_S_PARM, &p) != 0)
            return v4l_fail(c, dev->node, "VIDIOC_S_PARM", d);
    }
    if (can && period->numerator > 0)
        l->fps = (double)period->denominator / (double)period->numerator;
    if (!can && c->fps > 0)
        CAP_LOG(PVX_LOG_WARN, c, "v4l2", "own_rate",
                "its driver %s has no frame rate to set: the camera runs at its "
                "own, which has to be %g Hz",
                dev->driver, c->fps);
    if (c->fps <= 0 || !can || fabs(l->fps - c->fps) <= 0.01 * c->fps)
        return PVX_OK;
    char offered[300] = "";
    v4l_say_rates(dev, code, (uint32_t)l->width, (uint32_t)l->height,
                  &(struct v4l_text){offered, sizeof offered, 0});
    return CAP_FAIL(c, "v4l2", d, PVX_EINVAL,
                    "frame rate %g refused: the camera has %.4g; with %dx%d %s it offers %s Hz",
                    c->fps, l->fps, l->width, l->height, cap_pixfmt_name(l->fmt), offered);
}

pvx_err v4l_set_layout(const struct cap_source_config *c, const struct v4l_device *dev,
                       struct v4l_layout *l, struct pvx_diag *d)
{
    uint32_t code = 0;
    PVX_TRY(v4l2_set_format(c, dev, l, &code, d));
    return set_rate(c, dev, code, l, d);
}
