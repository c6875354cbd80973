/* replay_export.c - frames of a take as files that other programs read, without losing bits:
 *     8 and 16 bits per sample          .png, the samples as they are (BGR turned to RGB)
 *     10, 12, 14 bits, also packed      .png of 16 bits, the value in the low bits; Bayer stays Bayer, and
 *                                       reconstruct needs --pixel-format, as BayerRG12
 *     JPEG                              .jpg, the bytes as they came
 *     YUV, float                        .npy, float; YUV as linear RGB */
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/mem.h"
#include "capture/files/imgio.h"
#include "capture/pixel/pixfmt.h"
#include "daemon/cli/recordings/replay.h"
#include "daemon/cli/common/take_notes.h"

struct export
{
    const cap_take *t;
    const char *dir;
    void *mem; /* a frame's bytes as in the take */
    size_t size;
    float *values;     /* [pixels][4] */
    uint16_t *samples; /* [pixels][3] */
    uint64_t written;
};

/* Unpack the samples of a packed format with the common conversion.  It gives value / full scale, exact in float for
 * up to 14 bits. */
static pvx_err unpack(struct export *x, const struct cap_image *img, struct pvx_diag *d)
{
    const uint8_t *cell = cap_pixfmt_bayer(img->fmt);
    struct cap_convert_params p = {.binning = 1,
                                   .nch = cell != NULL ? 3 : 1,
                                   .transfer = CAP_TRANSFER_LINEAR,
                                   .mosaic = CAP_MOSAIC_RAYS};
    pvx_err e = cap_convert(img, &p, 0, img->height, x->values);
    if (e != PVX_OK)
        return pvx_fail(d, e, "cannot be unpacked: %s", pvx_strerror(e));
    float full = (float)((1 << cap_pixfmt_depth(img->fmt)) - 1);
    size_t w = (size_t)img->width;
    for (size_t i = 0; i < w * (size_t)img->height; i++) {
        float v =
            cell != NULL ? x->values[4 * i + cell[2 * (i / w % 2) + i % w % 2]] : x->values[i];
        x->samples[i] = (uint16_t)lrintf(v * full);
    }
    return PVX_OK;
}

static pvx_err write_packed(struct export *x, const struct cap_image *img, const char *stem,
                            struct pvx_diag *d)
{
    char path[4300];
    PVX_TRY(unpack(x, img, d));
    snprintf(path, sizeof path, "%s.png", stem);
    return cap_image_write(path, x->samples, img->width, img->height, 1, 16, d);
}

static pvx_err write_float(struct export *x, const struct cap_image *img, const char *stem,
                           struct pvx_diag *d)
{
    char path[4300];
    int nch = cap_pixfmt_channels(img->fmt);
    struct cap_convert_params p = {.binning = 1, .nch = nch, .transfer = CAP_TRANSFER_AUTO};
    pvx_err e = cap_convert(img, &p, 0, img->height, x->values);
    if (e != PVX_OK)
        return pvx_fail(d, e, "cannot be converted: %s", pvx_strerror(e));
    size_t n = (size_t)img->width * (size_t)img->height;
    for (size_t i = 0; i < n && nch == 3; i++)
        memmove(&x->values[3 * i], &x->values[4 * i], 3 * sizeof *x->values);
    snprintf(path, sizeof path, "%s.npy", stem);
    return cap_image_save(path, x->values, img->width, img->height, nch, d);
}

static pvx_err write_samples(struct export *x, const struct cap_image *img, const char *stem,
                             struct pvx_diag *d)
{
    char path[4300];
    int nch = cap_pixfmt_bayer(img->fmt) != NULL ? 1 : cap_pixfmt_channels(img->fmt);
    int depth = cap_pixfmt_depth(img->fmt) == 8 ? 8 : 16;
    snprintf(path, sizeof path, "%s.png", stem);
    unsigned char *px = x->mem;
    for (size_t i = 0; img->fmt == CAP_BGR8 && i + 2 < img->size; i += 3) {
        unsigned char b = px[i];
        px[i] = px[i + 2];
        px[i + 2] = b;
    }
    return cap_image_write(path, px, img->width, img->height, nch, depth, d);
}

static pvx_err write_frame(struct export *x, const struct cap_image *img, const char *stem,
                           struct pvx_diag *d)
{
    char path[4300];
    switch (cap_pixfmt_layout(img->fmt)) {
    case CAP_LAYOUT_8:
    case CAP_LAYOUT_16: return write_samples(x, img, stem, d);
    case CAP_LAYOUT_P:
    case CAP_LAYOUT_PACKED:
    case CAP_LAYOUT_CSI: return write_packed(x, img, stem, d);
    case CAP_LAYOUT_YUV:
    case CAP_LAYOUT_F32: return write_float(x, img, stem, d);
    case CAP_LAYOUT_JPEG:
        snprintf(path, sizeof path, "%s.jpg", stem);
        return pvx_file_write(path, img->data, img->size, d);
    case CAP_LAYOUT_NONE: break;
    }
    return PVX_EUNSUP;
}

static pvx_err export_camera(struct export *x, uint32_t c, struct pvx_diag *d)
{
    const struct cap_take_info *info = cap_take_info(x->t);
    char path[4200];
    snprintf(path, sizeof path, "%s/%s", x->dir, info->head.camera[c].name);
    PVX_TRY(pvx_mkdirs(path, d));
    for (uint64_t k = 0; k < info->sets && !cli_stop; k++) {
        const int64_t *member;
        const struct cap_take_set *s = cap_take_set(x->t, k, &member);
        struct cap_image img;
        if (member[c] < 0)
            continue;
        if (s->number > 999999)
            return pvx_fail(d, PVX_ERANGE, "set %" PRIu64 ": six digits are not enough", s->number);
        snprintf(path, sizeof path, "%s/%s/%06" PRIu64, x->dir, info->head.camera[c].name,
                 s->number);
        PVX_TRY(cap_take_read(x->t, c, (uint64_t)member[c], x->mem, x->size, &img, d));
        PVX_TRY(write_frame(x, &img, path, d));
        x->written++;
    }
    return PVX_OK;
}

static pvx_err export_all(struct export *x, struct pvx_diag *d)
{
    const struct cap_take_head *h = &cap_take_info(x->t)->head;
    size_t pixels = 1;
    for (uint32_t c = 0; c < h->n_cameras; c++) {
        size_t bytes = cap_take_frame_max(x->t, c);
        size_t n = (size_t)h->camera[c].width * (size_t)h->camera[c].height;
        x->size = bytes > x->size ? bytes : x->size;
        pixels = n > pixels ? n : pixels;
    }
    x->mem = malloc(x->size + 1);
    x->values = pvx_calloc(pixels * 4, sizeof *x->values);
    x->samples = pvx_calloc(pixels * 3, sizeof *x->samples);
    if (x->mem == NULL || x->values == NULL || x->samples == NULL)
        return PVX_ENOMEM;
    PVX_TRY(pvx_mkdirs(x->dir, d));
    char path[4200];
    snprintf(path, sizeof path, "%s/rig.yaml", x->dir);
    PVX_TRY(pvx_file_write(path, h->rig, strlen(h->rig), d));
    for (uint32_t c = 0; c < h->n_cameras && !cli_stop; c++)
        if (h->camera[c].fmt != CAP_FMT_NONE)
            PVX_TRY(export_camera(x, c, d));
    return PVX_OK;
}

/* Print the --pixel-format that reconstruct needs, because the files do not contain it. */
static void tell_format(const struct cap_take_head *h)
{
    for (uint32_t c = 0; c < h->n_cameras; c++) {
        enum cap_pixfmt f = h->camera[c].fmt;
        int depth = cap_pixfmt_depth(f);
        const uint8_t *cell = cap_pixfmt_bayer(f);
        if (cell == NULL && (cap_pixfmt_channels(f) == 3 || depth == 8 || depth == 16))
            continue;
        if (f == CAP_GREY_F32 || f == CAP_FMT_NONE)
            continue;
        static const char rgb[] = "RGB";
        char name[16] = "Mono";
        if (cell != NULL)
            snprintf(name, sizeof name, "Bayer%c%c", rgb[cell[0]], rgb[cell[1]]);
        printf("say --pixel-format %s%d to `pyrovox reconstruct`\n", name, depth);
        return;
    }
}

int replay_export(const cap_take *t, const char *dir)
{
    struct export x = {.t = t, .dir = dir};
    struct pvx_diag d = {""};
    cli_catch_stop();
    take_notes(t);
    pvx_err e = export_all(&x, &d);
    free(x.mem);
    free(x.values);
    free(x.samples);
    if (e != PVX_OK)
        return cli_error(&d, e);
    printf("%" PRIu64 " frames in %s, with rig.yaml\n", x.written, dir);
    tell_format(&cap_take_info(t)->head);
    return cli_stop ? 130 : 0;
}
