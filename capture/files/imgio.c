#include "capture/files/imgio.h"

#include <math.h>
#include <pthread.h>
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
#include "capture/files/opencv_shim.h"
#include "capture/files/picture.h"
#include "capture/files/png.h"
#include "capture/files/sequence.h"
#include "capture/files/tiff.h"
#include "capture/pixel/jpeg.h"

/* ---- the OpenCV module: found and loaded once, never unloaded ----------------------------------- */

static struct {
    pthread_once_t once;
    const struct cap_cv *cv;
    char why[PVX_DIAG_MAX]; /* why it could not be loaded */
} module = {.once = PTHREAD_ONCE_INIT};

static void imgio_find_module(void)
{
    module.cv = pvx_module_load("pyrovox-opencv.so", "cap_cv_module", CAP_CV_VERSION, module.why,
                                sizeof module.why);
}

static pvx_err imgio_need_module(const char *path, struct pvx_diag *d)
{
    pthread_once(&module.once, imgio_find_module);
    if (module.cv != NULL)
        return PVX_OK;
    return pvx_fail(d, PVX_EUNSUP,
                    "%s: image module cannot be loaded: %.500s; JPEG and .npy work without", path,
                    module.why);
}

/* The module's error, with the file's name in front. */
static pvx_err module_error(int e, const char *path, const char *err, struct pvx_diag *d)
{
    return e > 0 && e < PVX_N_ERR ? pvx_fail(d, (pvx_err)e, "%s: %s", path, err) : PVX_EIO;
}

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
    return cap_tiff_load(b, path, at, &out->img, &out->mem, d);
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
               : pvx_fail(d, PVX_EUNSUP,
                          "%s: unknown type; images are .npy .png .tif .tiff .jpg .jpeg", path);
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

/* ---- animated PNG ------------------------------------------------------------------------------- */

struct cap_apng {
    struct cap_cv_apng *cv;
    char *path;
};

pvx_err cap_apng_begin(const char *path, int32_t w, int32_t h, int nch, int fps, cap_apng **out,
                       struct pvx_diag *d)
{
    *out = NULL;
    if (w < 1 || h < 1 || w > 1 << 15 || h > 1 << 15 || (nch != 1 && nch != 3) || fps < 1 ||
        fps > 100)
        return pvx_fail(d, PVX_EINVAL, "%s: an animation has 1 or 3 channels, 1 to 100 fps", path);
    PVX_TRY(imgio_need_module(path, d));
    cap_apng *a = pvx_calloc(1, sizeof *a);
    if (a == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for the animation", path);
    a->path = strdup(path);
    char err[256] = "out of memory";
    int e = a->path == NULL ? PVX_ENOMEM
                            : module.cv->apng->begin(w, h, nch, fps, &a->cv, err, sizeof err);
    if (e != 0) {
        cap_apng_drop(&a);
        return module_error(e, path, err, d);
    }
    *out = a;
    return PVX_OK;
}

pvx_err cap_apng_add(cap_apng *a, const uint8_t *samples, struct pvx_diag *d)
{
    char err[256] = "";
    int e = module.cv->apng->add(a->cv, samples, err, sizeof err);
    return e == 0 ? PVX_OK : module_error(e, a->path, err, d);
}

pvx_err cap_apng_end(cap_apng **a, struct pvx_diag *d)
{
    void *bytes;
    size_t len;
    char err[256] = "";
    int e = module.cv->apng->end((*a)->cv, &bytes, &len, err, sizeof err);
    (*a)->cv = NULL;
    pvx_err r =
        e != 0 ? module_error(e, (*a)->path, err, d) : pvx_file_write((*a)->path, bytes, len, d);
    free(bytes);
    cap_apng_drop(a);
    return r;
}

void cap_apng_drop(cap_apng **a)
{
    if (*a == NULL)
        return;
    if ((*a)->cv != NULL)
        module.cv->apng->drop((*a)->cv);
    free((*a)->path);
    PVX_FREE(*a);
}

/* ---- video -------------------------------------------------------------------------------------- */

struct cap_video {
    struct cap_cv_video *cv;
    char *path;
};

/* Check the size of an animated PNG before libavformat, which decodes a picture on opening, allocates one. */
static pvx_err check_png(const char *path, uint64_t bytes, struct pvx_diag *d)
{
    unsigned char b[24];
    uint32_t width, height;
    FILE *f = fopen(path, "rb");
    size_t n = f != NULL ? fread(b, 1, sizeof b, f) : 0;
    if (f != NULL)
        fclose(f);
    cap_picture_png(b, n, &width, &height);
    return cap_picture_fits(width, height, bytes, path, d);
}

pvx_err cap_video_open(const char *path, cap_video **out, double *fps, struct pvx_diag *d)
{
    struct stat st;
    *out = NULL;
    if (access(path, R_OK) != 0 || stat(path, &st) != 0)
        return pvx_fail(d, PVX_ENOENT, "%s: no such video file, or not readable", path);
    PVX_TRY(pvx_file_check(path, d));
    uint64_t bytes = (uint64_t)st.st_size;
    PVX_TRY(check_png(path, bytes, d));
    PVX_TRY(imgio_need_module(path, d));
    cap_video *v = pvx_calloc(1, sizeof *v);
    if (v == NULL || (v->path = strdup(path)) == NULL) {
        free(v);
        return PVX_ENOMEM;
    }
    char err[256] = "";
    int32_t size[2] = {0, 0};
    int failed = module.cv->video_open(path, &v->cv, fps, size, err, sizeof err);
    pvx_err e = failed != 0
                    ? module_error(failed, path, err, d)
                    : cap_picture_fits((uint32_t)size[0], (uint32_t)size[1], bytes, path, d);
    if (e != PVX_OK)
        cap_video_close(&v);
    *out = v;
    return e;
}

pvx_err cap_video_next(cap_video *v, struct cap_image *img, struct pvx_diag *d)
{
    struct cap_cv_image f;
    char err[256] = "";
    int failed = module.cv->video_next(v->cv, img != NULL ? &f : NULL, err, sizeof err);
    if (failed == PVX_ECLOSED)
        return PVX_ECLOSED;
    if (failed != 0)
        return module_error(failed, v->path, err, d);
    if (img == NULL)
        return PVX_OK;
    /* A picture in the video may have another size.  It is in memory already. */
    PVX_TRY(cap_picture_fits((uint32_t)f.width, (uint32_t)f.height, UINT64_MAX, v->path, d));
    *img =
        (struct cap_image){f.data, f.size, f.width, f.height, (ptrdiff_t)f.width * 3, CAP_RGB8, 0};
    return PVX_OK;
}

void cap_video_close(cap_video **v)
{
    if (*v == NULL)
        return;
    if ((*v)->cv != NULL)
        module.cv->video_close((*v)->cv);
    free((*v)->path);
    PVX_FREE(*v);
}
