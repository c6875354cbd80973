#include "daemon/pipeline/raw.h"

static enum rec_cl_layout layout_of(enum cap_pixfmt fmt)
{
    switch (cap_pixfmt_layout(fmt)) {
    case CAP_LAYOUT_8: return REC_CL_LAYOUT_8;
    case CAP_LAYOUT_16: return REC_CL_LAYOUT_16;
    case CAP_LAYOUT_P: return REC_CL_LAYOUT_P;
    case CAP_LAYOUT_PACKED: return REC_CL_LAYOUT_PACKED;
    case CAP_LAYOUT_CSI: return REC_CL_LAYOUT_CSI;
    case CAP_LAYOUT_NONE:
    case CAP_LAYOUT_YUV:
    case CAP_LAYOUT_JPEG:
    case CAP_LAYOUT_F32: break;
    }
    return REC_CL_LAYOUT_NONE;
}

/* A raw sample is saturated from here on: clip of pixfmt.h. */
static uint32_t clip_of(const struct cap_image *img, const struct cap_convert_params *p)
{
    int depth = cap_pixfmt_depth(img->fmt);
    bool words = cap_pixfmt_layout(img->fmt) == CAP_LAYOUT_16;
    uint32_t clip = words && depth == 16 ? CAP_CLIP_16 : (1u << depth) - 1;
    return words && p->clip > 0 && p->clip < clip ? p->clip : clip;
}

bool dmn_raw_of(const struct cap_image *img, const struct cap_convert_params *p,
                struct rec_cl_raw *out)
{
    enum cap_transfer t =
        p->transfer == CAP_TRANSFER_AUTO ? cap_transfer_declared(img) : p->transfer;
    *out = (struct rec_cl_raw){0};
    if (layout_of(img->fmt) == REC_CL_LAYOUT_NONE || t != CAP_TRANSFER_LINEAR || p->maps != NULL ||
        cap_convert(img, p, 0, 0, NULL) != PVX_OK)
        return false;
    const uint8_t *cell = cap_pixfmt_bayer(img->fmt);
    bool grey = cap_pixfmt_channels(img->fmt) == 1;
    size_t stride = (size_t)img->stride;
    *out = (struct rec_cl_raw){.layout = layout_of(img->fmt),
                               .data = img->data,
                               .bytes = stride * (size_t)(img->height - 1) +
                                        cap_pixfmt_row(img->fmt, img->width),
                               .width = img->width,
                               .height = img->height,
                               .stride = stride,
                               .depth = cap_pixfmt_depth(img->fmt),
                               .binning = p->binning,
                               .samples = grey || cell != NULL ? 1 : 3,
                               .grey = grey,
                               .swapped = img->fmt == CAP_BGR8,
                               .rays = p->mosaic == CAP_MOSAIC_RAYS && p->nch == 3,
                               .cell = cell,
                               .clip = clip_of(img, p),
                               .most = cap_saturated(img, p)};
    return true;
}
