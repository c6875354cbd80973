/* vm_flame.c - pictures of a flame as .npy, which load without OpenCV (its loading alone takes seconds in an
 * emulated machine), as they are or with what a pixel format loses.  Runs outside, before 030-chain.sh.
 *
 *   vm_flame FROM TO         FROM/<camera>/<6 digits>.png of `pyrovox simcams --write-frames`: the bytes
 *   vm_flame FROM TO yuyv    RGB -> YUYV (the camera's, uvc/images.c) -> RGB by the formulas of BT.601 in double,
 *                            one chroma for two pixels, clipped to 0..1; float32
 *   vm_flame FROM TO bayer   RGB -> the byte of each pixel's own colour behind an RGGB filter
 *   vm_flame FROM TO mjpg    RGB -> JPEG (the camera's) -> RGB by OpenCV; bytes */
#include <dirent.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "capture/files/imgio.h"
#include "capture/files/sequence.h"
#include "tests/vm/uvc/images.h"

static const char *loss = "";

/* Version 1 of the format: 128 bytes of header, rows, channels innermost. */
static pvx_err save(const char *path, const char *type, const void *data, size_t item,
                    const struct cap_image *like, struct pvx_diag *d)
{
    int channels = cap_pixfmt_channels(like->fmt);
    size_t n = (size_t)like->width * (size_t)like->height * (size_t)channels * item;
    char *file = malloc(128 + n);
    if (file == NULL)
        return PVX_ENOMEM;
    memcpy(file, "\x93NUMPY\1\0\x76\0", 10);
    int len =
        snprintf(file + 10, 118, "{'descr': '%s', 'fortran_order': False, 'shape': (%d, %d%s), }",
                 type, like->height, like->width, channels == 3 ? ", 3" : "");
    memset(file + 10 + len, ' ', 117 - (size_t)len);
    file[127] = '\n';
    memcpy(file + 128, data, n);
    pvx_err e = pvx_file_write(path, file, 128 + n, d);
    free(file);
    return e;
}

static float clip(double v)
{
    return (float)(v < 0 ? 0 : v > 1 ? 1 : v);
}

static pvx_err save_yuyv(const char *path, const struct cap_image *m, const struct uvc_bytes *yuyv,
                         struct pvx_diag *d)
{
    size_t n = (size_t)m->width * (size_t)m->height;
    float *rgb = malloc(3 * n * sizeof *rgb);
    if (rgb == NULL)
        return PVX_ENOMEM;
    for (size_t i = 0; i < n; i++) {
        const uint8_t *pair = yuyv->data + 4 * (i / 2);
        double y = (pair[i % 2 == 0 ? 0 : 2] - 16) / 219.0;
        double u = (pair[1] - 128) / 224.0, v = (pair[3] - 128) / 224.0;
        rgb[3 * i] = clip(y + 1.402 * v);
        rgb[3 * i + 1] = clip(y - 0.344136 * u - 0.714136 * v);
        rgb[3 * i + 2] = clip(y + 1.772 * u);
    }
    pvx_err e = save(path, "<f4", rgb, sizeof *rgb, m, d);
    free(rgb);
    return e;
}

/* Rows of R G R G and G B G B; as a grey picture, which the configuration says is none. */
static pvx_err save_bayer(const char *path, const struct cap_image *m, struct pvx_diag *d)
{
    static const int colour[2][2] = {{0, 1}, {1, 2}};
    struct cap_image like = *m;
    const uint8_t *rgb = m->data;
    uint8_t *raw = malloc((size_t)m->width * (size_t)m->height);
    if (raw == NULL)
        return PVX_ENOMEM;
    for (int32_t y = 0, i = 0; y < m->height; y++)
        for (int32_t x = 0; x < m->width; x++, i++)
            raw[i] = rgb[3 * i + colour[y % 2][x % 2]];
    like.fmt = CAP_GREY8;
    pvx_err e = save(path, "|u1", raw, 1, &like, d);
    free(raw);
    return e;
}

static pvx_err save_mjpg(const char *path, const struct uvc_bytes *jpeg, struct pvx_diag *d)
{
    char name[4200];
    struct cap_loaded l;
    snprintf(name, sizeof name, "%s.jpg", path);
    PVX_TRY(pvx_file_write(name, jpeg->data, jpeg->n, d));
    PVX_TRY(cap_image_load(name, &l, d));
    remove(name);
    pvx_err e = save(path, "|u1", l.img.data, 1, &l.img, d);
    cap_loaded_free(&l);
    return e;
}

static pvx_err one(const char *from, const char *to, struct pvx_diag *d)
{
    struct cap_loaded l;
    struct uvc_images cam = {0};
    PVX_TRY(cap_image_load(from, &l, d));
    pvx_err e = PVX_OK;
    if (l.img.fmt != CAP_RGB8 && (l.img.fmt != CAP_GREY8 || strcmp(loss, "bayer") == 0))
        e = pvx_fail(d, PVX_EUNSUP, "%s: not of 8 bits, or without colours for bayer", from);
    else if (*loss == '\0')
        e = save(to, "|u1", l.img.data, 1, &l.img, d);
    else if (strcmp(loss, "bayer") == 0)
        e = save_bayer(to, &l.img, d);
    else if ((e = uvc_images_load(from, UVC_ALL_FORMATS, UVC_QUALITY, &cam, d)) == PVX_OK)
        e = strcmp(loss, "yuyv") == 0 ? save_yuyv(to, &l.img, &cam.frame[UVC_YUYV][0][0], d)
                                      : save_mjpg(to, &cam.frame[UVC_MJPG][0][0], d);
    uvc_images_free(&cam);
    cap_loaded_free(&l);
    return e;
}

static pvx_err camera(const char *from, const char *to, struct pvx_diag *d)
{
    struct cap_sequence seq;
    PVX_TRY(pvx_mkdirs(to, d));
    PVX_TRY(cap_sequence_find(from, &seq, d));
    pvx_err e = PVX_OK;
    for (size_t i = 0; e == PVX_OK && i < seq.n; i++) {
        char path[4096];
        snprintf(path, sizeof path, "%s/%06lld.npy", to, (long long)seq.item[i].number);
        e = one(seq.item[i].path, path, d);
    }
    cap_sequence_free(&seq);
    return e;
}

int main(int argc, char **argv)
{
    struct pvx_diag d = {""};
    pvx_err e = PVX_OK;
    if (argc == 4)
        loss = argv[3];
    DIR *all = argc == 3 || (argc == 4 && strchr("ymb", *loss) != NULL) ? opendir(argv[1]) : NULL;
    if (all == NULL) {
        fprintf(stderr, "usage: vm_flame FROM TO [yuyv|bayer|mjpg]\n");
        return 2;
    }
    for (struct dirent *c; e == PVX_OK && (c = readdir(all)) != NULL;) {
        char from[2048], to[2048];
        snprintf(from, sizeof from, "%s/%s", argv[1], c->d_name);
        snprintf(to, sizeof to, "%s/%s", argv[2], c->d_name);
        if (c->d_name[0] != '.')
            e = camera(from, to, &d);
    }
    closedir(all);
    if (e != PVX_OK)
        fprintf(stderr, "vm_flame: %s\n", pvx_diag_text(&d, e));
    return e == PVX_OK ? 0 : 1;
}
