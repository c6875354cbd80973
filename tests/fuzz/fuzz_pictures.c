/* fuzz_pictures.c - any bytes as a picture in a file: refused with a line that names the file, or read, to the size and
 * depth that its head says, the same twice.
 *
 * Where the number of bytes is odd the checksums of a PNG are made right, or libpng would look at nothing behind the
 * first that changed. */
#include <malloc.h>
#include <stdbool.h>
#include <string.h>
#include <zlib.h>

#include "capture/files/imgio.h"
#include "tests/fuzz/input_file.h"

#define SIDE_MAX 16384

static uint32_t four(const uint8_t *p)
{
    return (uint32_t)p[0] << 24 | (uint32_t)p[1] << 16 | (uint32_t)p[2] << 8 | p[3];
}

static bool is_png(const uint8_t *p, size_t n)
{
    return n >= 33 && memcmp(p, "\x89PNG\r\n\x1a\n", 8) == 0;
}

static void make_right(uint8_t *p, size_t n)
{
    for (size_t at = 8; n - at >= 12 && four(p + at) <= n - at - 12; at += 12 + four(p + at)) {
        uint32_t size = four(p + at), sum = (uint32_t)crc32(0, p + at + 4, size + 4);
        for (unsigned i = 0; i < 4; i++)
            p[at + 8 + size + i] = (uint8_t)(sum >> (24 - 8 * i));
    }
}

static void check(const struct cap_image *img)
{
    MUST(img->width >= 1 && img->width <= SIDE_MAX && img->height >= 1 && img->height <= SIDE_MAX);
    MUST(img->stride == (ptrdiff_t)cap_pixfmt_row(img->fmt, img->width));
    MUST(img->size == (size_t)img->stride * (size_t)img->height);
}

/* What a PNG's head says must be what comes. */
static void check_png(const struct cap_image *img, const uint8_t *p)
{
    MUST((uint32_t)img->width == four(p + 16) && (uint32_t)img->height == four(p + 20));
    MUST(cap_pixfmt_depth(img->fmt) == (p[24] == 16 ? 16 : 8));
    MUST(img->yuv == 0);
}

static void as_page(const uint8_t *data, size_t size, uint32_t page)
{
    struct cap_loaded l, again;
    struct pvx_diag d = {""};
    pvx_err e = cap_image_load_page(input_file, page, &l, &d);
    if (e != PVX_OK) {
        MUST(l.mem == NULL);
        input_refused(e, &d);
        return;
    }
    fuzz_taken++;
    check(&l.img);
    if (is_png(data, size))
        check_png(&l.img, data);
    if (l.img.size <= 1 << 16) { /* what was never written is not the same twice */
        mallopt(M_PERTURB, 0x55);
        MUST(cap_image_load_page(input_file, page, &again, NULL) == PVX_OK);
        mallopt(M_PERTURB, 0);
        MUST(again.img.size == l.img.size && again.img.fmt == l.img.fmt);
        MUST(memcmp(again.img.data, l.img.data, l.img.size) == 0);
        cap_loaded_free(&again);
    }
    cap_loaded_free(&l);
}

/* The first pages; a file of several is no single picture. */
static void as_picture(const uint8_t *data, size_t size)
{
    struct cap_loaded l;
    struct pvx_diag d = {""};
    uint32_t pages;
    input_write("picture.png", data, size);
    pvx_err e = cap_image_pages(input_file, &pages, &d);
    if (e != PVX_OK)
        input_refused(e, &d);
    MUST(pages >= 1);
    for (uint32_t page = 0; page < pages && page < 3; page++)
        as_page(data, size, page);
    bool one = cap_image_load(input_file, &l, NULL) == PVX_OK;
    MUST(!one || (e == PVX_OK && pages == 1));
    cap_loaded_free(&l);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    uint8_t *copy = malloc(size > 0 ? size : 1);
    MUST(copy != NULL);
    memcpy(copy, data, size);
    if (size % 2 == 1 && is_png(copy, size))
        make_right(copy, size);
    as_picture(copy, size);
    free(copy);
    return 0;
}
