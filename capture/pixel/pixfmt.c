#include "capture/pixel/pixfmt.h"

#include "capture/pixel/maps.h"
#include "capture/pixel/pixfmt_priv.h"

static void yuv_coef(uint8_t yuv, struct cap_yuv_coef *out)
{
    double kr = yuv & CAP_YUV_709 ? 0.2126 : 0.299, kb = yuv & CAP_YUV_709 ? 0.0722 : 0.114;
    double kg = 1 - kr - kb;
    bool full = yuv & CAP_YUV_FULL;
    double y = 4095.0 / (full ? 255 : 219), c = 4095.0 / (full ? 255 : 224);
    double cb[3] = {0, -c * 2 * kb * (1 - kb) / kg, c * 2 * (1 - kb)};
    double cr[3] = {c * 2 * (1 - kr), -c * 2 * kr * (1 - kr) / kg, 0};
    *out = (struct cap_yuv_coef){.y = {0}};
    for (int i = 0; i < 3; i++) {
        out->y[i] = (float)y;
        out->cb[i] = (float)cb[i];
        out->cr[i] = (float)cr[i];
        out->at0[i] = (float)(0.5 - (full ? 0 : 16 * y) - 128 * (cb[i] + cr[i]));
    }
}

enum cap_transfer cap_transfer_declared(const struct cap_image *img)
{
    enum cap_layout l = cap_pixfmt_layout(img->fmt);
    if (l != CAP_LAYOUT_YUV && l != CAP_LAYOUT_JPEG && !(img->yuv & CAP_YUV_CODED))
        return CAP_TRANSFER_LINEAR;
    return img->yuv & CAP_YUV_TRANSFER_709 ? CAP_TRANSFER_BT709 : CAP_TRANSFER_SRGB;
}

static pvx_err pixfmt_check_size(const struct cap_image *img, int binning, int32_t y0, int32_t y1)
{
    if (binning < 1 || binning > CAP_BINNING_MAX || img->width < 1 || img->height < 1 ||
        img->width % binning != 0 || img->height % binning != 0 || y0 < 0 ||
        y1 > img->height / binning)
        return PVX_EINVAL;
    size_t row = cap_pixfmt_row(img->fmt, img->width), need;
    if (img->stride < 0 || (size_t)img->stride < row)
        return PVX_EINVAL;
    if (__builtin_mul_overflow((size_t)img->stride, (size_t)(img->height - 1), &need) ||
        __builtin_add_overflow(need, row, &need) || img->data == NULL || img->size < need)
        return PVX_EFORMAT;
    return PVX_OK;
}

pvx_err cap_pix_check(const struct cap_image *img, const struct cap_convert_params *p, int32_t y0,
                      int32_t y1, struct cap_pix *j)
{
    enum cap_layout layout = cap_pixfmt_layout(img->fmt);
    enum cap_transfer curve = p->transfer;
    if (curve == CAP_TRANSFER_AUTO)
        curve = cap_transfer_declared(img);
    if (layout == CAP_LAYOUT_NONE || layout == CAP_LAYOUT_JPEG ||
        (layout == CAP_LAYOUT_F32 && curve != CAP_TRANSFER_LINEAR))
        return PVX_EUNSUP;
    if (p->nch != 1 && p->nch != 3)
        return PVX_EINVAL;
    PVX_TRY(pixfmt_check_size(img, p->binning, y0, y1));
    int bits = layout == CAP_LAYOUT_YUV ? 12 : cap_pixfmt_depth(img->fmt);
    bool grey = cap_pixfmt_channels(img->fmt) == 1;
    *j = (struct cap_pix){.img = *img,
                          .binning = p->binning,
                          .nch = p->nch,
                          .cell = cap_pixfmt_bayer(img->fmt),
                          .grey = grey,
                          .swapped = img->fmt == CAP_BGR8,
                          .full = bits == 32 ? 0 : (1u << bits) - 1};
    j->samples = grey || j->cell != NULL ? 1 : 3;
    j->rays = p->mosaic == CAP_MOSAIC_RAYS && p->nch == 3;
    if (j->cell != NULL && (img->width < 2 || img->height < 2))
        return PVX_EINVAL;
    if (curve != CAP_TRANSFER_LINEAR)
        j->table = cap_transfer_table(curve, bits);
    if (p->maps != NULL && !cap_maps_fit(p->maps, img))
        return PVX_EUNSUP;
    j->maps = p->maps;
    j->unit = p->maps != NULL ? p->maps->unit : 1;
    if (j->maps != NULL && j->maps->table[bits < 32 ? bits : 0] != NULL)
        j->table = j->maps->table[bits];
    j->clip = j->full;
    if (layout == CAP_LAYOUT_16 && bits == 16)
        j->clip = CAP_CLIP_16;
    j->most = 1;
    if (layout == CAP_LAYOUT_16 && p->clip > 0 && p->clip < j->clip) {
        j->clip = p->clip;
        j->most = j->table != NULL ? (float)j->table[j->clip] / (float)CAP_LIGHT_ONE
                                   : (float)j->clip / (float)j->full;
    }
    j->scale_full = (float)(j->table != NULL ? CAP_LIGHT_ONE : j->full);
    if (layout == CAP_LAYOUT_YUV)
        yuv_coef(img->yuv, &j->yuv);
    return PVX_OK;
}

void cap_pix_kernels_init(struct cap_pix_kernels *k, enum pvx_cpu most)
{
    enum pvx_cpu cpu = pvx_cpu() < most ? pvx_cpu() : most;
    *k = (struct cap_pix_kernels){cap_pix_ref, cap_pix_ref, cap_pix_ref, cap_pix_ref};
    cap_pix_kernels_base(k);
#if defined(__x86_64__)
    if (cpu >= PVX_CPU_AVX2)
        cap_pix_kernels_avx2(k);
#else
    (void)cpu;
#endif
}

/* Compute again, by the reference, the bins in which a masked pixel would count.  A blank bin's value (CAP_BLANK)
 * depends only on its place in the filter's cell, so it is computed once for each place and then copied. */
static void patch(const struct cap_pix *j, int32_t y0, int32_t y1, float *out)
{
    const struct cap_maps *m = j->maps;
    const uint32_t bw = (uint32_t)(j->img.width / j->binning);
    const size_t cs = j->nch == 3 ? 4 : 1;
    const float *blank[4] = {NULL};
    size_t lo = 0, hi = m->n_patches;
    while (lo < hi) { /* find the first patch from row y0 on */
        size_t mid = (lo + hi) / 2;
        if ((m->patch[mid] & ~CAP_BLANK) < (uint32_t)y0 * bw)
            lo = mid + 1;
        else
            hi = mid;
    }
    for (; lo < m->n_patches && (m->patch[lo] & ~CAP_BLANK) < (uint32_t)y1 * bw; lo++) {
        uint32_t at = m->patch[lo] & ~CAP_BLANK;
        int32_t x = (int32_t)(at % bw), y = (int32_t)(at / bw);
        const float **known = &blank[(y * j->binning & 1) << 1 | (x * j->binning & 1)];
        bool is_blank = (m->patch[lo] & CAP_BLANK) != 0;
        if (is_blank && *known != NULL) {
            memcpy(out + at * cs, *known, cs * sizeof *out);
            continue;
        }
        cap_pix_ref_bin(j, x, y, out);
        if (is_blank)
            *known = out + at * cs;
    }
}

void cap_pix_run(const struct cap_pix_kernels *k, const struct cap_pix *j, int32_t y0, int32_t y1,
                 float *out)
{
    int most = j->cell != NULL && j->table != NULL ? 16 : 32; /* sums fit 31 bits */
    struct cap_pix job = *j;
    job.base = out;
    if (j->full > 0 && j->binning > most) {
        cap_pix_ref(&job, y0, y1, out);
        return;
    }
    (j->full == 0      ? k->floats
     : j->cell == NULL ? k->sums
     : j->binning == 1 ? k->bayer
                       : k->mosaic)(&job, y0, y1, out);
    if (job.maps != NULL)
        patch(&job, y0, y1, out);
}

pvx_err cap_convert(const struct cap_image *img, const struct cap_convert_params *p, int32_t y0,
                    int32_t y1, float *out)
{
    struct cap_pix j;
    struct cap_pix_kernels k;
    PVX_TRY(cap_pix_check(img, p, y0, y1, &j));
    cap_pix_kernels_init(&k, PVX_CPU_BEST);
    cap_pix_run(&k, &j, y0, y1, out);
    return PVX_OK;
}

float cap_saturated(const struct cap_image *img, const struct cap_convert_params *p)
{
    struct cap_pix j;
    pvx_err e = cap_pix_check(img, p, 0, 0, &j);
    return e != PVX_OK ? 1 : j.maps != NULL ? j.maps->saturated : j.most;
}

pvx_err cap_bin(const struct cap_image *img, int binning, int nch, int32_t y0, int32_t y1,
                float *out)
{
    return cap_convert(img, &(struct cap_convert_params){.binning = binning, .nch = nch}, y0, y1,
                       out);
}
