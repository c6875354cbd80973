#include "capture/files/picture.h"

#include <stdbool.h>
#include <string.h>

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

void cap_picture_png(const void *bytes, size_t len, uint32_t *width, uint32_t *height)
{
    const struct bytes b = {bytes, len, true};
    bool says = begins(&b, PNG, 8) && b.n >= 16 && memcmp(b.p + 12, "IHDR", 4) == 0;
    *width = says ? (uint32_t)picture_number(&b, 16, 4) : 0;
    *height = says ? (uint32_t)picture_number(&b, 20, 4) : 0;
}

/* Reads the first folder of tags; TIFF 6.0, section 2, and BigTIFF, where counts and offsets have 8 bytes.  A colour
 * picture must state its number of samples.  If it does not, libtiff reads one sample and OpenCV takes three, two of
 * which were never written. */
static void tiff(struct bytes *b, struct cap_picture *out)
{
    b->big_endian = b->p[0] == 'M';
    bool big = picture_number(b, 2, 2) == 43;
    uint64_t folder = big ? picture_number(b, 8, 8) : picture_number(b, 4, 4);
    uint64_t n = picture_number(b, folder, big ? 8 : 2), at = folder + (big ? 8 : 2);
    uint32_t photometric = 0, samples = 0;
    for (; n > 0 && at < b->n; n--, at += big ? 20 : 12) {
        uint64_t tag = picture_number(b, at, 2), type = picture_number(b, at + 2, 2);
        uint32_t *to = tag == 256   ? &out->width
                       : tag == 257 ? &out->height
                       : tag == 262 ? &photometric
                       : tag == 277 ? &samples
                                    : NULL;
        if (to != NULL && *to == 0 && (type == 3 || type == 4)) /* SHORT, LONG */
            *to = (uint32_t)picture_number(b, at + (big ? 12 : 8), type == 3 ? 2 : 4);
    }
    if (photometric > 1 && samples == 0)
        out->width = 0;
}

static pvx_err sizes(struct bytes *b, const char *name, struct cap_picture *out, struct pvx_diag *d)
{
    struct pvx_diag why = {""};
    if (begins(b, PNG, 8)) {
        out->kind = CAP_FILE_PNG;
        cap_picture_png(b->p, b->n, &out->width, &out->height);
    } else if (begins(b, "II*\0", 4) || begins(b, "MM\0*", 4) || begins(b, "II+\0", 4) ||
               begins(b, "MM\0+", 4)) {
        out->kind = CAP_FILE_TIFF;
        tiff(b, out);
    } else if (begins(b, "\xFF\xD8\xFF", 3)) {
        out->kind = CAP_FILE_JPEG;
        pvx_err e = cap_jpeg_size(b->p, b->n, &out->width, &out->height, &why);
        if (e != PVX_OK)
            return pvx_fail(d, e, "%s: %s", name, why.text);
    } else {
        return pvx_fail(d, PVX_EFORMAT, "%s: not a PNG, TIFF or JPEG file, despite its name", name);
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
