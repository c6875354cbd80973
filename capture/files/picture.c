#include "capture/files/picture.h"

#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "capture/pixel/jpeg.h"

#define PNG "\x89PNG\r\n\x1a\n"

struct bytes {
    const uint8_t *p;
    size_t n;
    bool big_endian;
};

/* `size` bytes from `at` on as a number; 0 if they are not all there. */
static uint64_t picture_number(const struct bytes *b, uint64_t at, unsigned size)
{
    uint64_t v = 0;
    if (at > b->n || b->n - at < size)
        return 0;
    for (unsigned i = 0; i < size; i++)
        v |= (uint64_t)b->p[at + i] << 8 * (b->big_endian ? size - 1 - i : i);
    return v;
}

static bool begins(const struct bytes *b, const char *with, size_t n)
{
    return b->n >= n && memcmp(b->p, with, n) == 0;
}

bool cap_picture_is_tiff(const void *head, size_t n)
{
    return n >= 4 && (memcmp(head, "II*\0", 4) == 0 || memcmp(head, "MM\0*", 4) == 0 ||
                      memcmp(head, "II+\0", 4) == 0 || memcmp(head, "MM\0+", 4) == 0);
}

void cap_picture_png(const void *bytes, size_t len, uint32_t *width, uint32_t *height)
{
    const struct bytes b = {bytes, len, true};
    bool says = begins(&b, PNG, 8) && b.n >= 16 && memcmp(b.p + 12, "IHDR", 4) == 0;
    *width = says ? (uint32_t)picture_number(&b, 16, 4) : 0;
    *height = says ? (uint32_t)picture_number(&b, 20, 4) : 0;
}

static pvx_err sizes(struct bytes *b, const char *name, struct cap_picture *out, struct pvx_diag *d)
{
    struct pvx_diag why = {""};
    if (begins(b, PNG, 8)) {
        out->kind = CAP_FILE_PNG;
        cap_picture_png(b->p, b->n, &out->width, &out->height);
    } else if (begins(b, "\xFF\xD8\xFF", 3)) {
        out->kind = CAP_FILE_JPEG;
        pvx_err e = cap_jpeg_size(b->p, b->n, &out->width, &out->height, &why);
        if (e != PVX_OK)
            return pvx_fail(d, e, "%s: %s", name, why.text);
    } else {
        return pvx_fail(d, PVX_EFORMAT, "%s: %s", name,
                        b->n == 0 ? "is empty; is it still being written?"
                                  : "not a PNG, TIFF or JPEG file, despite its name");
    }
    return PVX_OK;
}

pvx_err cap_picture_fits(uint32_t width, uint32_t height, uint64_t len, const char *name,
                         struct pvx_diag *d)
{
    if (width > CAP_SIDE_MAX || height > CAP_SIDE_MAX)
        return pvx_fail(d, PVX_ERANGE,
                        "%s: says it has %ux%u pixels; at most %d each way are read: crop it, make "
                        "it smaller, or save it again if it is damaged",
                        name, width, height, CAP_SIDE_MAX);
    if ((uint64_t)width * height / CAP_PER_BYTE_MAX > len)
        return pvx_fail(d, PVX_ECORRUPT,
                        "%s: says it has %ux%u pixels, but only %llu bytes: damaged or cut; save "
                        "it again",
                        name, width, height, (unsigned long long)len);
    return PVX_OK;
}

pvx_err cap_picture_head(const void *bytes, size_t len, const char *name, struct cap_picture *out,
                         struct pvx_diag *d)
{
    struct bytes b = {bytes, len, false};
    *out = (struct cap_picture){0};
    PVX_TRY(sizes(&b, name, out, d));
    if (out->width == 0 || out->height == 0)
        return pvx_fail(d, PVX_ECORRUPT,
                        "%s: its head is damaged or cut: no size or no samples in it", name);
    return cap_picture_fits(out->width, out->height, len, name, d);
}

void *cap_picture_make(uint32_t width, uint32_t height, int channels, int depth, const char *name,
                       struct cap_image *out, struct pvx_diag *d)
{
    bool rgb = channels == 3;
    enum cap_pixfmt fmt = depth == 8    ? (rgb ? CAP_RGB8 : CAP_GREY8)
                          : depth == 16 ? (rgb ? CAP_RGB16 : CAP_GREY16)
                                        : (rgb ? CAP_RGB_F32 : CAP_GREY_F32);
    size_t row = cap_pixfmt_row(fmt, (int32_t)width);
    void *mem = pvx_calloc(height, row);
    if (mem == NULL)
        (void)pvx_fail(d, PVX_ENOMEM, "%s: no memory for the image", name);
    *out = (struct cap_image){
        mem, row * height, (int32_t)width, (int32_t)height, (ptrdiff_t)row, fmt, 0};
    return mem;
}
