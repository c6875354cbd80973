#include "capture/files/imgio.h"

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/file.h"
#include "base/mem.h"
#include "base/module.h"
#include "capture/files/npy.h"
#include "capture/files/picture.h"
#include "capture/files/png.h"
#include "capture/files/sequence.h"
#include "capture/files/tiff.h"
#include "capture/pixel/jpeg.h"

static struct pvx_module module = {
    .file = "pyrovox-tiff.so", .entry = "cap_tiff_module", .version = CAP_TIFF_VERSION};

/* ---- images ------------------------------------------------------------------------------------- */

static bool imgio_has_extension(const char *path, const char *ext)
{
    const char *dot = strrchr(path, '.');
    return dot != NULL && strcasecmp(dot, ext) == 0;
}

static pvx_err from_npy(const char *bytes, size_t len, const char *path, struct cap_loaded *out,
                        struct pvx_diag *d)
{
    struct cap_npy a;
    PVX_TRY(cap_npy_header(bytes, len, path, &a, d));
    size_t channels = a.ndim == 3 ? a.shape[2] : 1;
    if ((a.ndim != 2 && a.ndim != 3) || (channels != 1 && channels != 3))
        return pvx_fail(d, PVX_EFORMAT, "%s: an image is [h][w] or [h][w][1 or 3]", path);
    if (a.shape[0] > 1 << 20 || a.shape[1] > 1 << 20)
        return pvx_fail(d, PVX_ERANGE, "%s: %zu x %zu pixels are too many", path, a.shape[1],
                        a.shape[0]);
    int depth = a.type == CAP_NPY_U1 ? 8 : a.type == CAP_NPY_U2 ? 16 : 32;
    out->mem = cap_picture_make((uint32_t)a.shape[1], (uint32_t)a.shape[0], (int)channels, depth,
                                path, &out->img, d);
    if (out->mem == NULL)
        return PVX_ENOMEM;
    if (depth == 32)
        cap_npy_floats(&a, out->mem);
    else
        memcpy(out->mem, a.data, a.count * a.item);
    return PVX_OK;
}

/* Uses the decoder of the cameras' pictures, because libjpeg takes a cut or damaged picture as whole. */
static pvx_err from_jpeg(const char *bytes, size_t len, const char *path,
                         const struct cap_picture *p, struct cap_loaded *out, struct pvx_diag *d)
{
    const struct cap_image in = {bytes, len, (int32_t)p->width, (int32_t)p->height, 0, CAP_JPEG, 0};
    struct cap_image img;
    struct pvx_diag why = {""};
    cap_jpeg *j;
    size_t size;
    const void *exif = cap_jpeg_exif(bytes, len, &size);
    if (exif != NULL)
        PVX_TRY(cap_exif_upright(exif, size, path, d));
    pvx_err e = cap_jpeg_new(in.width, in.height, &j);
    if (e == PVX_OK) {
        cap_jpeg_progressive(j);
        e = cap_jpeg_decode(j, &in, &img, &why);
    }
    if (e == PVX_OK) {
        out->mem = cap_picture_make(p->width, p->height, cap_pixfmt_channels(img.fmt), 8, path,
                                    &out->img, &why);
        e = out->mem != NULL ? PVX_OK : PVX_ENOMEM;
    }
    if (e == PVX_OK) {
        memcpy(out->mem, img.data, img.size);
        out->img.yuv = img.yuv;
    }
    cap_jpeg_free(&j);
    return e == PVX_OK ? e : pvx_fail(d, e, "%s: %s", path, pvx_diag_text(&why, e));
}

static pvx_err from_tiff(const struct cap_bytes *b, const char *path, uint32_t page, bool single,
                         struct cap_loaded *out, struct pvx_diag *d)
{
    uint32_t pages = 1;
    uint64_t at;
    PVX_TRY(cap_tiff_pages(b, path, page, single ? &pages : NULL, &at, d));
    if (pages > 1)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: has %u pages, where one picture is expected: save each page as a file "
                        "of its own",
                        path, pages);
    const struct cap_tiff *tiff = pvx_module(&module);
    if (tiff == NULL)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: the module of TIFF cannot be loaded: %.500s; PNG, JPEG and .npy work "
                        "without",
                        path, module.why);
    return tiff->load(b, path, at, &out->img, &out->mem, d);
}

static pvx_err from_picture(const char *bytes, size_t len, const char *path, uint32_t page,
                            bool single, struct cap_loaded *out, struct pvx_diag *d)
{
    struct cap_picture p;
    if (imgio_has_extension(path, ".npy") && page == 0)
        return from_npy(bytes, len, path, out, d);
    if (cap_picture_is_tiff(bytes, len)) /* from a pipe */
        return from_tiff(&(struct cap_bytes){bytes, len, -1}, path, page, single, out, d);
    if (page > 0)
        return pvx_fail(d, PVX_ERANGE, "%s: has one picture; there is no page %u", path, page);
    PVX_TRY(cap_picture_head(bytes, len, path, &p, d));
    return p.kind == CAP_FILE_JPEG ? from_jpeg(bytes, len, path, &p, out, d)
                                   : cap_png_load(bytes, len, path, &out->img, &out->mem, d);
}

static pvx_err imgio_check_type(const char *path, struct pvx_diag *d)
{
    return cap_is_image(path)
               ? PVX_OK
               : pvx_fail(d, PVX_EUNSUP, "%s: unknown type; images are " CAP_IMAGES, path);
}

/* Opens a TIFF file that is no pipe; *fd = -1: it is something else. */
static pvx_err imgio_open_tiff(const char *path, struct cap_bytes *b, struct pvx_diag *d)
{
    struct stat st;
    char head[4];
    *b = (struct cap_bytes){.fd = -1};
    if (imgio_has_extension(path, ".npy") || (stat(path, &st) == 0 && S_ISFIFO(st.st_mode)))
        return PVX_OK;
    PVX_TRY(pvx_file_open(path, &b->fd, d));
    if (fstat(b->fd, &st) == 0)
        b->n = (uint64_t)st.st_size;
    if (cap_bytes_get(b, 0, head, sizeof head) && cap_picture_is_tiff(head, sizeof head))
        return PVX_OK;
    close(b->fd);
    b->fd = -1;
    return PVX_OK;
}

pvx_err cap_image_pages(const char *path, uint32_t *pages, struct pvx_diag *d)
{
    struct cap_bytes b;
    *pages = 1;
    PVX_TRY(imgio_check_type(path, d));
    PVX_TRY(imgio_open_tiff(path, &b, d));
    if (b.fd < 0)
        return PVX_OK;
    pvx_err e = cap_tiff_pages(&b, path, 0, pages, NULL, d);
    close(b.fd);
    return e;
}

static pvx_err imgio_load(const char *path, uint32_t page, bool single, struct cap_loaded *out,
                          struct pvx_diag *d)
{
    struct cap_bytes b;
    char *bytes;
    size_t len;
    pvx_err e;
    *out = (struct cap_loaded){0};
    PVX_TRY(imgio_check_type(path, d));
    PVX_TRY(imgio_open_tiff(path, &b, d));
    if (b.fd >= 0) {
        e = from_tiff(&b, path, page, single, out, d);
        close(b.fd);
        return e;
    }
    PVX_TRY(pvx_file_await(path, (size_t)1 << 32, &bytes, &len, d));
    e = from_picture(bytes, len, path, page, single, out, d);
    free(bytes);
    return e;
}

pvx_err cap_image_load_page(const char *path, uint32_t page, struct cap_loaded *out,
                            struct pvx_diag *d)
{
    return imgio_load(path, page, false, out, d);
}

pvx_err cap_image_load(const char *path, struct cap_loaded *out, struct pvx_diag *d)
{
    return imgio_load(path, 0, true, out, d);
}

void cap_loaded_free(struct cap_loaded *l)
{
    free(l->mem);
    *l = (struct cap_loaded){0};
}

static uint8_t to_byte(float v)
{
    return v > 0 ? (uint8_t)lrint(255 * (v < 1 ? (double)v : 1)) : 0; /* 0: NaN too */
}

static pvx_err save_png(const char *path, const float *pix, int32_t w, int32_t h, int nch,
                        struct pvx_diag *d)
{
    struct cap_image img;
    uint8_t *px = cap_picture_make((uint32_t)w, (uint32_t)h, nch, 8, path, &img, d);
    if (px == NULL)
        return PVX_ENOMEM;
    for (size_t i = 0; i < img.size; i++)
        px[i] = to_byte(pix[i]);
    pvx_err e = cap_png_save(path, &img, d);
    free(px);
    return e;
}

pvx_err cap_image_write(const char *path, const void *samples, int32_t w, int32_t h, int nch,
                        int depth, struct pvx_diag *d)
{
    if (w < 1 || h < 1 || (nch != 1 && nch != 3) || (depth != 8 && depth != 16))
        return pvx_fail(d, PVX_EINVAL, "%s: an image has 1 or 3 channels of 8 or 16 bits", path);
    if (!imgio_has_extension(path, ".png"))
        return pvx_fail(d, PVX_EUNSUP, "%s: samples are written as .png", path);
    enum cap_pixfmt fmt =
        depth == 16 ? (nch == 3 ? CAP_RGB16 : CAP_GREY16) : (nch == 3 ? CAP_RGB8 : CAP_GREY8);
    size_t row = cap_pixfmt_row(fmt, w);
    const struct cap_image img = {samples, row * (size_t)h, w, h, (ptrdiff_t)row, fmt, 0};
    return cap_png_save(path, &img, d);
}

pvx_err cap_image_save(const char *path, const float *pix, int32_t w, int32_t h, int nch,
                       struct pvx_diag *d)
{
    if (w < 1 || h < 1 || (nch != 1 && nch != 3))
        return pvx_fail(d, PVX_EINVAL, "%s: an image has 1 or 3 channels", path);
    if (imgio_has_extension(path, ".npy"))
        return cap_npy_save(path, pix, (size_t[3]){(size_t)h, (size_t)w, (size_t)nch}, 3, d);
    if (imgio_has_extension(path, ".png"))
        return save_png(path, pix, w, h, nch, d);
    return pvx_fail(d, PVX_EUNSUP, "%s: images are written as .png or .npy", path);
}
