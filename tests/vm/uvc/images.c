#include "tests/vm/uvc/images.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>
#include <turbojpeg.h>

#include "base/mem.h"
#include "capture/files/imgio.h"
#include "capture/files/sequence.h"

const unsigned uvc_bits[UVC_N_FORMATS] = {[UVC_MJPG] = 16, [UVC_YUYV] = 16, [UVC_GREY] = 8,
                                          [UVC_RGGB] = 8,  [UVC_RG16] = 16, [UVC_RW10] = 10};

struct order {
    unsigned formats;
    int quality;
};

/* 8 bit, rows without padding. */
struct raw {
    const uint8_t *px;
    int32_t w, h;
    bool rgb;
};

static uint8_t byte(double v)
{
    return (uint8_t)(v < 0 ? 0 : v > 255 ? 255 : lrint(v));
}

static uint8_t yuv_luma(const uint8_t *p, bool rgb)
{
    double r = p[0], g = p[rgb ? 1 : 0], b = p[rgb ? 2 : 0];
    return byte(16 + (65.481 * r + 128.553 * g + 24.966 * b) / 255);
}

static void to_yuyv(const struct raw *m, uint8_t *out)
{
    size_t step = m->rgb ? 3 : 1, n = (size_t)m->w * (size_t)m->h;
    for (size_t i = 0; i < n; i += 2) {
        const uint8_t *p = m->px + i * step, *q = p + step;
        double r = (p[0] + q[0]) / 2.0, g = r, b = r;
        if (m->rgb) {
            g = (p[1] + q[1]) / 2.0;
            b = (p[2] + q[2]) / 2.0;
        }
        out[2 * i] = yuv_luma(p, m->rgb);
        out[2 * i + 1] = byte(128 + (-37.797 * r - 74.203 * g + 112 * b) / 255);
        out[2 * i + 2] = yuv_luma(q, m->rgb);
        out[2 * i + 3] = byte(128 + (112 * r - 93.786 * g - 18.214 * b) / 255);
    }
}

static void to_grey(const struct raw *m, uint8_t *out)
{
    size_t n = (size_t)m->w * (size_t)m->h;
    if (!m->rgb) {
        memcpy(out, m->px, n);
        return;
    }
    for (size_t i = 0; i < n; i++) {
        const uint8_t *p = m->px + 3 * i;
        out[i] = byte(0.299 * p[0] + 0.587 * p[1] + 0.114 * p[2]);
    }
}

static void to_rggb(const struct raw *m, uint8_t *out)
{
    for (int32_t y = 0; y < m->h; y++)
        for (int32_t x = 0; x < m->w; x++) {
            size_t i = (size_t)y * (size_t)m->w + (size_t)x;
            out[i] = m->rgb ? m->px[3 * i + (size_t)(x % 2 + y % 2)] : m->px[i];
        }
}

static void to_rg16(const uint8_t *rggb, size_t n, uint8_t *out)
{
    for (size_t i = 0; i < n; i++)
        out[2 * i] = out[2 * i + 1] = rggb[i];
}

static void to_rw10(const uint8_t *rggb, size_t n, uint8_t *out)
{
    for (size_t i = 0; i < n; i += 4, out += 5) {
        memcpy(out, rggb + i, 4);
        out[4] = 0;
        for (int k = 0; k < 4; k++)
            out[4] |= (uint8_t)(rggb[i + (size_t)k] >> 6 << 2 * k);
    }
}

static pvx_err to_jpeg(const struct raw *m, int quality, struct uvc_bytes *out, struct pvx_diag *d)
{
    tjhandle tj = tjInitCompress();
    if (tj == NULL)
        return PVX_ENOMEM;
    unsigned long n = 0;
    unsigned char *data = NULL;
    int bad = tjCompress2(tj, m->px, m->w, 0, m->h, m->rgb ? TJPF_RGB : TJPF_GRAY, &data, &n,
                          m->rgb ? TJSAMP_422 : TJSAMP_GRAY, quality, 0);
    pvx_err e = PVX_OK;
    if (bad)
        e = pvx_fail(d, PVX_EIO, "JPEG: %s", tjGetErrorStr2(tj));
    else if ((out->data = malloc(n)) == NULL)
        e = PVX_ENOMEM;
    else
        memcpy(out->data, data, out->n = n);
    tjFree(data);
    tjDestroy(tj);
    return e;
}

static pvx_err encode(const struct raw *m, const struct order *o, int size, size_t at,
                      struct uvc_images *out, struct pvx_diag *d)
{
    size_t n = (size_t)m->w * (size_t)m->h;
    unsigned raw = 1u << UVC_RG16 | 1u << UVC_RW10; /* made of the 8-bit one */
    unsigned formats = o->formats | (o->formats & raw ? 1u << UVC_RGGB : 0);
    uint8_t *to[UVC_N_FORMATS] = {NULL};
    for (int f = 0; f < UVC_N_FORMATS; f++) {
        struct uvc_bytes *b = &out->frame[f][size][at];
        if (f == UVC_MJPG || (formats >> f & 1) == 0)
            continue;
        b->n = uvc_images_max(out, (enum uvc_format)f, size);
        to[f] = b->data = malloc(b->n);
        if (to[f] == NULL)
            return PVX_ENOMEM;
    }
    if (to[UVC_YUYV] != NULL)
        to_yuyv(m, to[UVC_YUYV]);
    if (to[UVC_GREY] != NULL)
        to_grey(m, to[UVC_GREY]);
    if (to[UVC_RGGB] != NULL)
        to_rggb(m, to[UVC_RGGB]);
    if (to[UVC_RG16] != NULL)
        to_rg16(to[UVC_RGGB], n, to[UVC_RG16]);
    if (to[UVC_RW10] != NULL)
        to_rw10(to[UVC_RGGB], n, to[UVC_RW10]);
    if ((formats >> UVC_MJPG & 1) == 0)
        return PVX_OK;
    return to_jpeg(m, o->quality, &out->frame[UVC_MJPG][size][at], d);
}

static pvx_err encode_half(const struct raw *m, const struct order *o, size_t at,
                           struct uvc_images *out, struct pvx_diag *d)
{
    int c = m->rgb ? 3 : 1;
    struct raw half = {.w = m->w / 2, .h = m->h / 2, .rgb = m->rgb};
    uint8_t *px = malloc((size_t)half.w * (size_t)half.h * (size_t)c);
    if (px == NULL)
        return PVX_ENOMEM;
    ptrdiff_t row = (ptrdiff_t)m->w * c;
    for (int32_t y = 0; y < half.h; y++)
        for (int32_t x = 0; x < half.w; x++)
            for (int k = 0; k < c; k++) {
                const uint8_t *p = m->px + 2 * y * row + (ptrdiff_t)(2 * x * c + k);
                px[((ptrdiff_t)y * half.w + x) * c + k] =
                    (uint8_t)((p[0] + p[c] + p[row] + p[row + c] + 2) / 4);
            }
    half.px = px;
    pvx_err e = encode(&half, o, 1, at, out, d);
    free(px);
    return e;
}

static pvx_err load_one(const char *path, const struct order *o, size_t at, struct uvc_images *out,
                        struct pvx_diag *d)
{
    struct cap_loaded l;
    PVX_TRY(cap_image_load(path, &l, d));
    pvx_err e;
    struct raw m = {l.img.data, l.img.width, l.img.height, l.img.fmt == CAP_RGB8};
    if (at == 0) {
        out->size[0] = (struct uvc_size){m.w, m.h};
        out->size[1] = (struct uvc_size){m.w / 2, m.h / 2};
    }
    if (l.img.fmt != CAP_RGB8 && l.img.fmt != CAP_GREY8)
        e = pvx_fail(d, PVX_EUNSUP, "%s: %s; should be 8 bit", path, cap_pixfmt_name(l.img.fmt));
    else if (m.w % 8 != 0 || m.h % 8 != 0 || m.w != out->size[0].width ||
             m.h != out->size[0].height)
        e = pvx_fail(d, PVX_EUNSUP, "%s: %dx%d; all images have one size, in multiples of 8", path,
                     m.w, m.h);
    else if ((e = encode(&m, o, 0, at, out, d)) == PVX_OK)
        e = encode_half(&m, o, at, out, d);
    cap_loaded_free(&l);
    return e;
}

pvx_err uvc_images_load(const char *name, unsigned formats, int quality, struct uvc_images *out,
                        struct pvx_diag *d)
{
    struct order o = {formats, quality};
    *out = (struct uvc_images){0};
    struct cap_sequence seq;
    PVX_TRY(cap_sequence_find(name, &seq, d));
    pvx_err e = PVX_OK;
    out->n = seq.n;
    for (int f = 0; f < UVC_N_FORMATS; f++)
        for (int s = 0; s < UVC_N_SIZES; s++)
            if ((out->frame[f][s] = pvx_calloc(seq.n, sizeof *out->frame[f][s])) == NULL)
                e = PVX_ENOMEM;
    for (size_t i = 0; e == PVX_OK && i < seq.n; i++)
        e = load_one(seq.item[i].path, &o, i, out, d);
    cap_sequence_free(&seq);
    if (e != PVX_OK)
        uvc_images_free(out);
    return e;
}

void uvc_images_free(struct uvc_images *m)
{
    for (int f = 0; f < UVC_N_FORMATS; f++)
        for (int s = 0; s < UVC_N_SIZES; s++) {
            for (size_t i = 0; m->frame[f][s] != NULL && i < m->n; i++)
                free(m->frame[f][s][i].data);
            free(m->frame[f][s]);
        }
    *m = (struct uvc_images){0};
}

size_t uvc_images_max(const struct uvc_images *m, enum uvc_format f, int size)
{
    size_t n = (size_t)m->size[size].width * (size_t)m->size[size].height;
    return uvc_bits[f] * n / 8;
}
