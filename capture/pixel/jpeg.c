#include "capture/pixel/jpeg.h"

#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <turbojpeg.h>

#include "base/mem.h"

#define LEFT_OVER 16 /* extra bytes before the end of image that do not count as damage */

struct cap_jpeg {
    tjhandle tj;
    int32_t width, height;
    int last_kind; /* largest n of SOFn that is decoded */
    unsigned char *pixels;
    size_t bytes;
};

pvx_err cap_jpeg_new(int32_t width, int32_t height, cap_jpeg **out)
{
    *out = NULL;
    if (width < 1 || height < 1 || width > 65535 || height > 65535)
        return PVX_EINVAL;
    cap_jpeg *j = pvx_calloc(1, sizeof *j);
    PVX_NEED(j);
    j->width = width;
    j->height = height;
    j->last_kind = 1;
    j->bytes = (size_t)width * (size_t)height * 3;
    j->tj = tjInitDecompress();
    j->pixels = pvx_reserve(j->bytes);
    if (j->tj == NULL || j->pixels == NULL) {
        cap_jpeg_free(&j);
        return PVX_ENOMEM;
    }
    *out = j;
    return PVX_OK;
}

void cap_jpeg_free(cap_jpeg **jp)
{
    cap_jpeg *j = *jp;
    if (j == NULL)
        return;
    if (j->tj != NULL)
        tjDestroy(j->tj);
    if (j->pixels != NULL)
        pvx_unreserve(j->pixels, j->bytes);
    PVX_FREE(*jp);
}

/* The fields of a frame header. */
struct header {
    int kind; /* marker SOFn: n */
    int depth, height, width, components;
    const uint8_t *exif; /* TIFF tags, or NULL */
    size_t exif_size;
};

static int two(const uint8_t *p)
{
    return p[0] << 8 | p[1];
}

/* Walk the marker segments to the frame header; ITU-T T.81 B.1, B.2.2. */
static pvx_err read_header(const uint8_t *p, size_t n, struct header *h, struct pvx_diag *d)
{
    if (n < 4 || p[0] != 0xFF || p[1] != 0xD8)
        return pvx_fail(d, PVX_EFORMAT, "not a JPEG picture");
    for (size_t at = 2; n - at >= 4;) {
        if (p[at] != 0xFF)
            return pvx_fail(d, PVX_ECORRUPT, "JPEG: no marker at byte %zu", at);
        int marker = p[at + 1];
        if (marker == 0xFF) { /* fill byte */
            at++;
            continue;
        }
        if (marker == 0x01 || (marker >= 0xD0 && marker <= 0xD8)) {
            at += 2;
            continue;
        }
        size_t length = (size_t)two(p + at + 2);
        if (marker == 0xD9 || marker == 0xDA || length < 2 || length > n - at - 2)
            return pvx_fail(d, PVX_ECORRUPT, "JPEG: ends before its frame header");
        if (marker >= 0xC0 && marker <= 0xCF && marker != 0xC4 && marker != 0xC8 &&
            marker != 0xCC) {
            if (length < 8)
                return pvx_fail(d, PVX_ECORRUPT, "JPEG: frame header of %zu bytes", length);
            p += at + 4;
            h->kind = marker - 0xC0;
            h->depth = p[0];
            h->height = two(p + 1);
            h->width = two(p + 3);
            h->components = p[5];
            return PVX_OK;
        }
        if (marker == 0xE1 && length >= 8 && memcmp(p + at + 4, "Exif\0", 6) == 0) {
            h->exif = p + at + 10;
            h->exif_size = length - 8;
        }
        at += 2 + length;
    }
    return pvx_fail(d, PVX_ECORRUPT, "JPEG: ends before its frame header");
}

static pvx_err check_header(const cap_jpeg *j, const struct header *h, struct pvx_diag *d)
{
    if (h->width != j->width || h->height != j->height)
        return pvx_fail(d, PVX_ERANGE, "JPEG of %dx%d instead of %dx%d", h->width, h->height,
                        j->width, j->height);
    if (h->kind > j->last_kind)
        return pvx_fail(d, PVX_EUNSUP,
                        "JPEG of kind SOF%d (progressive, lossless or arithmetic); cameras send "
                        "sequential ones",
                        h->kind);
    if (h->depth != 8 || (h->components != 1 && h->components != 3))
        return pvx_fail(d, PVX_EUNSUP, "JPEG of %d components of %d bits; 1 or 3 of 8 can be read",
                        h->components, h->depth);
    return PVX_OK;
}

const void *cap_jpeg_exif(const void *bytes, size_t n, size_t *size)
{
    struct header h = {0};
    *size = read_header(bytes, n, &h, NULL) == PVX_OK ? h.exif_size : 0;
    return *size > 0 ? h.exif : NULL;
}

pvx_err cap_jpeg_size(const void *bytes, size_t n, uint32_t *width, uint32_t *height,
                      struct pvx_diag *d)
{
    struct header h = {0};
    PVX_TRY(read_header(bytes, n, &h, d));
    *width = (uint32_t)h.width;
    *height = (uint32_t)h.height;
    return PVX_OK;
}

void cap_jpeg_progressive(cap_jpeg *j)
{
    j->last_kind = 2;
}

/* Whether the library's first warning was only about a few extra bytes at the very end. */
static bool harmless(tjhandle tj)
{
    unsigned n, marker;
    return tjGetErrorCode(tj) == TJERR_WARNING &&
           sscanf(tjGetErrorStr2(tj), "Corrupt JPEG data: %u extraneous bytes before marker %x", &n,
                  &marker) == 2 &&
           n <= LEFT_OVER && marker == 0xD9;
}

pvx_err cap_jpeg_decode(cap_jpeg *j, const struct cap_image *in, struct cap_image *out,
                        struct pvx_diag *d)
{
    struct header h = {0};
    PVX_TRY(read_header(in->data, in->data != NULL ? in->size : 0, &h, d));
    PVX_TRY(check_header(j, &h, d));
    bool grey = h.components == 1;
    int row = j->width * (grey ? 1 : 3);
    /* Do not use tjDecompressHeader3: in 2.1.5 a decoder stays broken after a bad header.  The library refuses
     * a second frame header, so the size is the one read above. */
    if (tjDecompress2(j->tj, in->data, in->size, j->pixels, j->width, row, j->height,
                      grey ? TJPF_GRAY : TJPF_RGB, TJFLAG_ACCURATEDCT | TJFLAG_LIMITSCANS) != 0 &&
        !harmless(j->tj))
        return pvx_fail(d, PVX_ECORRUPT, "JPEG: %s", tjGetErrorStr2(j->tj));
    *out = (struct cap_image){.data = j->pixels,
                              .size = (size_t)row * (size_t)j->height,
                              .width = j->width,
                              .height = j->height,
                              .stride = row,
                              .fmt = grey ? CAP_GREY8 : CAP_RGB8,
                              .yuv = (uint8_t)(CAP_YUV_CODED | (in->yuv & CAP_YUV_TRANSFER_709))};
    return PVX_OK;
}
