#include "daemon/pipeline/raw.h"

#include "capture/pixel/recipe.h"
#include "recon/carve/photo.h"

static enum rec_cl_layout layout_of(enum cap_pixfmt fmt)
{
    switch (cap_pixfmt_layout(fmt)) {
    case CAP_LAYOUT_8: return REC_CL_LAYOUT_8;
    case CAP_LAYOUT_16: return REC_CL_LAYOUT_16;
    case CAP_LAYOUT_P: return REC_CL_LAYOUT_P;
    case CAP_LAYOUT_PACKED: return REC_CL_LAYOUT_PACKED;
    case CAP_LAYOUT_CSI: return REC_CL_LAYOUT_CSI;
    case CAP_LAYOUT_YUV: return REC_CL_LAYOUT_YUV;
    case CAP_LAYOUT_NONE:
    case CAP_LAYOUT_JPEG:
    case CAP_LAYOUT_F32: break;
    }
    return REC_CL_LAYOUT_NONE;
}

/* Whether a device can do it: its sums have 32 bits.  With maps a whole picture might have no number, which it cannot
 * tell. */
static bool device_can(const struct cap_recipe *r, const struct cap_convert_params *p)
{
    return (r->table == NULL || r->cell == NULL || p->binning <= 32) &&
           (r->maps == 0 || (r->whole && r->most <= REC_PHOTO_LIMIT));
}

bool dmn_raw_of(const struct cap_image *img, const struct cap_convert_params *p,
                struct rec_cl_raw *out)
{
    struct cap_recipe r;
    *out = (struct rec_cl_raw){0};
    if (layout_of(img->fmt) == REC_CL_LAYOUT_NONE || cap_recipe_of(img, p, &r) != PVX_OK ||
        !device_can(&r, p))
        return false;
    size_t stride = (size_t)img->stride;
    *out = (struct rec_cl_raw){
        .layout = layout_of(img->fmt),
        .data = img->data,
        .bytes = stride * (size_t)(img->height - 1) + cap_pixfmt_row(img->fmt, img->width),
        .width = img->width,
        .height = img->height,
        .stride = stride,
        .depth = r.depth,
        .binning = p->binning,
        .samples = r.samples,
        .grey = r.grey,
        .swapped = r.swapped || img->fmt == CAP_UYVY,
        .rays = r.rays,
        .cell = r.cell,
        .clip = r.clip,
        .most = r.most,
        .full = r.full,
        .yuv = {r.y,
                {r.cb[0], r.cb[1], r.cb[2]},
                {r.cr[0], r.cr[1], r.cr[2]},
                {r.at[0], r.at[1], r.at[2]}},
        .maps = {r.table, r.unit, r.maps, r.word, r.plane, r.planes, r.mask, r.matrix}};
    return true;
}
