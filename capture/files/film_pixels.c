/* film_pixels.c - the frames of a film as samples: all bits, by the matrix, the range and the turn that the film says.
 *
 * A sample of n bits becomes one of 8 or 16 so that full scale stays full scale: v * 65535 / (2^n - 1).
 * YUV becomes R'G'B' by (2) of pixfmt.h with the matrix of the film.  BT.601 and limited range are the default, as in
 * FFmpeg.  All pixels of a group have its Cb and Cr.  The result is clipped to black and white.
 * Own arithmetic, since libswscale makes 65472 of 1023 in 10 bits and reads matrices that it does not know as BT.601. */
#include <libavutil/display.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "capture/files/film_priv.h"

static bool pixels_grey_palette(const AVFrame *f)
{
    const uint32_t *argb = (const uint32_t *)(const void *)f->data[1];
    for (int i = 0; i < 256; i++)
        if ((argb[i] & 0xFF) != (argb[i] >> 8 & 0xFF) || (argb[i] & 0xFF) != (argb[i] >> 16 & 0xFF))
            return false;
    return true;
}

/* All entries alike: there is no palette. */
static bool pixels_no_palette(const AVFrame *f)
{
    const uint32_t *argb = (const uint32_t *)(const void *)f->data[1];
    return memcmp(argb, argb + 1, 255 * sizeof *argb) == 0;
}

static bool pixels_indexed(const AVPixFmtDescriptor *desc)
{
    return (desc->flags & AV_PIX_FMT_FLAG_PAL) != 0;
}

static enum cap_pixfmt pixels_format(const AVPixFmtDescriptor *desc, const AVFrame *f)
{
    bool grey = pixels_indexed(desc) ? pixels_grey_palette(f) : desc->nb_components < 3;
    int depth = desc->comp[0].depth;
    if ((desc->flags & (AV_PIX_FMT_FLAG_HWACCEL | AV_PIX_FMT_FLAG_BAYER)) != 0 ||
        strncmp(desc->name, "xyz", 3) == 0 || (pixels_indexed(desc) && pixels_no_palette(f)))
        return CAP_FMT_NONE;
    if ((desc->flags & AV_PIX_FMT_FLAG_FLOAT) != 0)
        return depth != 32 ? CAP_FMT_NONE : grey ? CAP_GREY_F32 : CAP_RGB_F32;
    return depth > 16  ? CAP_FMT_NONE
           : depth > 8 ? (grey ? CAP_GREY16 : CAP_RGB16)
                       : (grey ? CAP_GREY8 : CAP_RGB8);
}

/* Kr and Kb of the matrices that are weighted sums; 0: another one. */
static void pixels_weights(enum AVColorSpace space, double *kr, double *kb)
{
    switch (space) {
    case AVCOL_SPC_UNSPECIFIED:
    case AVCOL_SPC_BT470BG:
    case AVCOL_SPC_SMPTE170M: *kr = 0.299, *kb = 0.114; break;
    case AVCOL_SPC_BT709: *kr = 0.2126, *kb = 0.0722; break;
    case AVCOL_SPC_FCC: *kr = 0.30, *kb = 0.11; break;
    case AVCOL_SPC_SMPTE240M: *kr = 0.212, *kb = 0.087; break;
    case AVCOL_SPC_BT2020_NCL: *kr = 0.2627, *kb = 0.0593; break;
    default: *kr = *kb = 0;
    }
}

static pvx_err pixels_matrix(const char *path, const AVFrame *f, struct film_pixels *p,
                             struct pvx_diag *d)
{
    double kr, kb, kg;
    pixels_weights(f->colorspace, &kr, &kb);
    kg = 1 - kr - kb;
    if (f->colorspace == AVCOL_SPC_YCGCO)
        memcpy(p->of_chroma, (float[3][2]){{-1, 1}, {1, 0}, {-1, -1}}, sizeof p->of_chroma);
    else if (kr > 0)
        memcpy(p->of_chroma,
               (float[3][2]){{0, (float)(2 * (1 - kr))},
                             {(float)(-2 * kb * (1 - kb) / kg), (float)(-2 * kr * (1 - kr) / kg)},
                             {(float)(2 * (1 - kb)), 0}},
               sizeof p->of_chroma);
    else
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: its colour matrix (%s) is not read; write it again with another, for "
                        "instance as RGB: ffmpeg -i IN -vf zscale=matrix=gbr -c:v ffv1 OUT.mkv",
                        path, av_color_space_name(f->colorspace));
    int depth = p->desc->comp[0].depth;
    bool full = f->color_range == AVCOL_RANGE_JPEG || strncmp(p->desc->name, "yuvj", 4) == 0;
    int unit = 1 << (depth - 8);
    p->luma_zero = full ? 0 : (float)(16 * unit);
    p->luma_scale = 1.0f / (float)(full ? (1 << depth) - 1 : 219 * unit);
    p->chroma_scale = 1.0f / (float)(full ? (1 << depth) - 1 : 224 * unit);
    return PVX_OK;
}

/* Limited range of grey or RGB: programs write full range with this mark, too. */
static pvx_err pixels_range(const char *path, const AVFrame *f, const struct film_pixels *p,
                            struct pvx_diag *d)
{
    if (f->color_range != AVCOL_RANGE_MPEG)
        return PVX_OK;
    return pvx_fail(d, PVX_EUNSUP,
                    "%s: says that its %s samples have limited range (16 to 235), and programs do "
                    "not agree what that means; if they are 0 to 255: ffmpeg -i IN -c copy "
                    "-color_range pc OUT.mkv",
                    path, p->desc->name);
}

static pvx_err pixels_transfer(const char *path, const AVFrame *f, struct film_pixels *p,
                               struct pvx_diag *d)
{
    const char *remedy = "";
    switch (f->color_trc) {
    case AVCOL_TRC_RESERVED0:
    case AVCOL_TRC_RESERVED:
    case AVCOL_TRC_UNSPECIFIED:
    case AVCOL_TRC_LINEAR: return PVX_OK;
    case AVCOL_TRC_IEC61966_2_1: p->yuv = CAP_YUV_CODED; break;
    case AVCOL_TRC_BT709:
    case AVCOL_TRC_SMPTE170M:
    case AVCOL_TRC_IEC61966_2_4:
    case AVCOL_TRC_BT1361_ECG:
    case AVCOL_TRC_BT2020_10:
    case AVCOL_TRC_BT2020_12: p->yuv = CAP_YUV_CODED | CAP_YUV_TRANSFER_709; break;
    default: remedy = "; convert it: ffmpeg -i IN -vf zscale=transfer=bt709 -c:v ffv1 OUT.mkv";
    }
    if (*remedy == '\0' && cap_pixfmt_depth(p->fmt) <= 16)
        return PVX_OK;
    return pvx_fail(
        d, PVX_EUNSUP, "%s: its samples are coded by a transfer function (%s) that is not read%s%s",
        path, av_color_transfer_name(f->color_trc), *remedy == '\0' ? " for floats" : "", remedy);
}

/* Turned and mirrored by quarters as the display matrix says: x' = a x + c y, y' = b x + d y. */
static pvx_err pixels_turn(const char *path, const AVFrame *f, const int32_t *matrix,
                           struct film_pixels *p, struct pvx_diag *d)
{
    int64_t a = 1, b = 0, c = 0, e = 1;
    if (matrix != NULL)
        a = matrix[0], b = matrix[1], c = matrix[3], e = matrix[4];
    bool upright = b == 0 && c == 0 && a != 0 && llabs(a) == llabs(e);
    bool lying = a == 0 && e == 0 && b != 0 && llabs(b) == llabs(c);
    if (!upright && !lying)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: says that it is shown turned by %.4g degrees or distorted; only "
                        "quarters of a turn are read: ffmpeg -i IN -c:v ffv1 OUT.mkv turns it",
                        path, -av_display_rotation_get(matrix));
    p->width = upright ? f->width : f->height;
    p->height = upright ? f->height : f->width;
    p->right = upright ? (a > 0 ? 1 : -1) : (b > 0 ? p->width : -p->width);
    p->down = upright ? (e > 0 ? p->width : -p->width) : (c > 0 ? 1 : -1);
    p->first = (p->right < 0 ? -p->right * (f->width - 1) : 0) +
               (p->down < 0 ? -p->down * (f->height - 1) : 0);
    return PVX_OK;
}

pvx_err film_pixels_of(const char *path, const AVFrame *first, const int32_t *matrix,
                       struct film_pixels *p, struct pvx_diag *d)
{
    *p = (struct film_pixels){.desc = av_pix_fmt_desc_get(first->format)};
    p->fmt = p->desc != NULL ? pixels_format(p->desc, first) : CAP_FMT_NONE;
    if (p->fmt == CAP_FMT_NONE)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: its pixel format (%s) is not read; write it again: ffmpeg -i IN "
                        "-c:v ffv1 -pix_fmt rgb48le OUT.mkv (grey: gray16le)",
                        path, p->desc != NULL ? p->desc->name : "unknown");
    bool rgb = (p->desc->flags & (AV_PIX_FMT_FLAG_RGB | AV_PIX_FMT_FLAG_PAL)) != 0;
    PVX_TRY(rgb || p->desc->nb_components < 3 ? pixels_range(path, first, p, d)
                                              : pixels_matrix(path, first, p, d));
    PVX_TRY(pixels_transfer(path, first, p, d));
    PVX_TRY(pixels_turn(path, first, matrix, p, d));
    p->size = cap_pixfmt_image(p->fmt, p->width, p->height);
    p->row = pvx_calloc(3 * (size_t)first->width, sizeof *p->row);
    p->out = pvx_calloc(p->size, 1);
    return p->row != NULL && p->out != NULL
               ? PVX_OK
               : pvx_fail(d, PVX_ENOMEM, "%s: no memory for its pictures", path);
}

void film_pixels_free(struct film_pixels *p)
{
    PVX_FREE(p->row);
    PVX_FREE(p->out);
}

bool film_pixels_same_palette(const struct film_pixels *p, const AVFrame *frame)
{
    return !pixels_indexed(p->desc) || p->fmt == CAP_RGB8 || pixels_grey_palette(frame);
}

/* Row y of component c, as long as the frame is wide. */
static void pixels_component(const struct film_pixels *p, const AVFrame *f, int y, int c,
                             uint32_t *row)
{
    bool chroma = c > 0 && p->desc->nb_components >= 3;
    int wide = chroma ? p->desc->log2_chroma_w : 0, high = chroma ? p->desc->log2_chroma_h : 0;
    av_read_image_line2(row, (const uint8_t **)f->data, f->linesize, p->desc, 0, y >> high, c,
                        AV_CEIL_RSHIFT(f->width, wide), 0, sizeof *row);
    for (int x = f->width - 1; x > 0 && wide > 0; x--)
        row[x] = row[x >> wide];
}

static void pixels_to_full(uint32_t *row, int n, uint32_t most, uint32_t full)
{
    double scale = (double)full / most;
    for (int i = 0; i < n && most != full; i++)
        row[i] = (uint32_t)(row[i] * scale + 0.5);
}

static void pixels_from_palette(const AVFrame *f, uint32_t *row, int nch)
{
    const uint32_t *argb = (const uint32_t *)(const void *)f->data[1];
    for (int x = 0; x < f->width; x++) {
        uint32_t v = argb[row[x] & 0xFF];
        for (int c = 0; c < nch; c++)
            row[c * f->width + x] = v >> (16 - 8 * c) & 0xFF;
    }
}

static void pixels_from_yuv(const struct film_pixels *p, uint32_t *restrict row, int n, float full)
{
    uint32_t *restrict cb = row + n, *restrict cr = row + 2 * (ptrdiff_t)n;
    float zero = p->luma_zero, ky = p->luma_scale, kc = p->chroma_scale;
    float middle = (float)(1 << (p->desc->comp[0].depth - 1));
    for (int x = 0; x < n; x++) {
        float y = ((float)row[x] - zero) * ky;
        float b = ((float)cb[x] - middle) * kc, r = ((float)cr[x] - middle) * kc;
        float rgb[3];
        for (int c = 0; c < 3; c++) {
            float v = y + p->of_chroma[c][0] * b + p->of_chroma[c][1] * r;
            v = v > 0 ? v : 0;
            rgb[c] = (v < 1 ? v : 1) * full + 0.5f;
        }
        row[x] = (uint32_t)rgb[0];
        cb[x] = (uint32_t)rgb[1];
        cr[x] = (uint32_t)rgb[2];
    }
}

/* Row y of the frame as samples of the picture, channels apart: p->row. */
static void pixels_row(const struct film_pixels *p, const AVFrame *f, int y, int nch)
{
    int depth = cap_pixfmt_depth(p->fmt), w = f->width;
    uint32_t full = depth < 32 ? (1u << depth) - 1 : 0;
    bool indexed = pixels_indexed(p->desc);
    bool rgb = (p->desc->flags & AV_PIX_FMT_FLAG_RGB) != 0 || depth == 32;
    for (int c = 0; c < (indexed ? 1 : nch); c++) {
        pixels_component(p, f, y, c, p->row + c * w);
        if ((rgb || nch == 1) && !indexed && depth < 32)
            pixels_to_full(p->row + c * w, w, (1u << p->desc->comp[c].depth) - 1, full);
    }
    if (indexed)
        pixels_from_palette(f, p->row, nch);
    else if (nch == 3 && !rgb)
        pixels_from_yuv(p, p->row, w, (float)full);
    if (f->format == AV_PIX_FMT_MONOWHITE)
        for (int x = 0; x < w; x++)
            p->row[x] = full - p->row[x];
}

/* Put a row of samples to its place in the picture, which may be a column. */
static void pixels_place(const struct film_pixels *p, int w, int y, int nch)
{
    ptrdiff_t at = p->first + y * p->down;
    int depth = cap_pixfmt_depth(p->fmt);
    for (int c = 0; c < nch; c++) {
        const uint32_t *row = p->row + c * w;
        ptrdiff_t from = at * nch + c, step = p->right * nch;
        if (depth == 8)
            for (int x = 0; x < w; x++)
                ((uint8_t *)p->out)[from + x * step] = (uint8_t)row[x];
        else if (depth == 16)
            for (int x = 0; x < w; x++)
                ((uint16_t *)p->out)[from + x * step] = (uint16_t)row[x];
        else
            for (int x = 0; x < w; x++)
                ((uint32_t *)p->out)[from + x * step] = row[x]; /* a float's bits */
    }
}

void film_pixels_read(struct film_pixels *p, const AVFrame *frame, struct cap_image *img)
{
    size_t row = cap_pixfmt_row(p->fmt, p->width);
    int nch = cap_pixfmt_channels(p->fmt);
    for (int y = 0; y < frame->height; y++) {
        pixels_row(p, frame, y, nch);
        pixels_place(p, frame->width, y, nch);
    }
    *img = (struct cap_image){.data = p->out,
                              .size = p->size,
                              .width = p->width,
                              .height = p->height,
                              .stride = (ptrdiff_t)row,
                              .fmt = p->fmt,
                              .yuv = p->yuv};
}
