#include "capture/files/png.h"

#include <png.h>
#include <setjmp.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "base/file.h"
#include "base/mem.h"
#include "capture/files/picture.h"
#include "capture/files/tiff.h"

/* All that changes between setjmp and longjmp is in here. */
struct png_work {
    png_structp png;
    png_infop info;
    const unsigned char *bytes;
    size_t n, at;
    png_bytepp row;
    struct cap_image *out; /* to read */
    void *mem;
    const char *name;
    struct pvx_diag *d;
    pvx_err e;
    const struct cap_image *in; /* to write */
    FILE *file;
    char why[160];
};

static void png_failed(png_structp png, png_const_charp text)
{
    struct png_work *w = png_get_error_ptr(png);
    snprintf(w->why, sizeof w->why, "%s", text);
    longjmp(png_jmpbuf(png), 1);
}

/* Warnings are about what means nothing here: profiles, times, text. */
static void png_warned(png_structp png, png_const_charp text)
{
    (void)png, (void)text;
}

static void png_give(png_structp png, png_bytep to, size_t n)
{
    struct png_work *w = png_get_io_ptr(png);
    if (n > w->n - w->at)
        png_error(png, "ends too early");
    memcpy(to, w->bytes + w->at, n);
    w->at += n;
}

/* The data of the first chunk of that name, or NULL. */
static const unsigned char *png_chunk(const unsigned char *p, size_t n, const char *name,
                                      uint32_t *size)
{
    for (size_t at = 8; n - at >= 12; at += 12 + (size_t)*size) {
        *size = png_get_uint_32(p + at);
        if (*size > n - at - 12)
            break;
        if (memcmp(p + at + 4, name, 4) == 0)
            return p + at + 8;
    }
    return NULL;
}

/* Samples name colours of the map: they lie in the last third of the picture and are replaced from the first on. */
static void png_map(struct png_work *w, size_t n)
{
    png_colorp map;
    int colours = 0;
    unsigned char *out = w->mem, *in = out + 2 * n;
    png_get_PLTE(w->png, w->info, &map, &colours);
    for (size_t i = 0; i < n; i++, out += 3) {
        int k = in[i];
        if (k >= colours)
            png_error(w->png, "a sample names a colour that is not in its map");
        memcpy(out, (unsigned char[3]){map[k].red, map[k].green, map[k].blue}, 3);
    }
}

static void png_samples(struct png_work *w)
{
    png_set_read_fn(w->png, w, png_give);
    png_set_crc_action(w->png, PNG_CRC_ERROR_QUIT, PNG_CRC_ERROR_QUIT);
    png_set_chunk_malloc_max(w->png, 64 << 20);
    png_read_info(w->png, w->info);
    uint32_t width = png_get_image_width(w->png, w->info);
    uint32_t height = png_get_image_height(w->png, w->info);
    int colour = png_get_color_type(w->png, w->info);
    int depth = png_get_bit_depth(w->png, w->info) == 16 ? 16 : 8;
    bool map = colour == PNG_COLOR_TYPE_PALETTE;
    if (map)
        png_set_packing(w->png);
    else
        png_set_expand_gray_1_2_4_to_8(w->png);
    png_set_strip_alpha(w->png);
    png_set_swap(w->png);
    png_set_interlace_handling(w->png);
    png_read_update_info(w->png, w->info);
    w->mem = cap_picture_make(width, height, (colour & PNG_COLOR_MASK_COLOR) != 0 ? 3 : 1, depth,
                              w->name, w->out, w->d);
    w->row = pvx_calloc(height, sizeof *w->row);
    if (w->mem == NULL || w->row == NULL) {
        w->e = PVX_ENOMEM;
        png_error(w->png, "no memory");
    }
    size_t size = map ? width : cap_pixfmt_row(w->out->fmt, (int32_t)width);
    for (size_t y = 0; y < height; y++)
        w->row[y] = (png_bytep)w->mem + (map ? 2 * size * height : 0) + y * size;
    png_read_image(w->png, w->row);
    png_read_end(w->png, NULL);
    if (map)
        png_map(w, size * height);
}

static bool png_try(struct png_work *w, void (*work)(struct png_work *))
{
    if (w->png == NULL || w->info == NULL || setjmp(png_jmpbuf(w->png)) != 0)
        return false;
    work(w);
    return true;
}

pvx_err cap_png_load(const void *bytes, size_t n, const char *name, struct cap_image *out,
                     void **mem, struct pvx_diag *d)
{
    struct png_work w = {.bytes = bytes, .n = n, .out = out, .name = name, .d = d};
    uint32_t size;
    const unsigned char *animation = png_chunk(bytes, n, "acTL", &size);
    if (animation != NULL && size >= 8 && png_get_uint_32(animation) > 1)
        return pvx_fail(
            d, PVX_EUNSUP,
            "%s: has %u pictures, where one is expected: save each as a file of its own", name,
            png_get_uint_32(animation));
    const unsigned char *exif = png_chunk(bytes, n, "eXIf", &size);
    if (exif != NULL)
        PVX_TRY(cap_exif_upright(exif, size, name, d));
    w.png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &w, png_failed, png_warned);
    w.info = w.png != NULL ? png_create_info_struct(w.png) : NULL;
    bool good = png_try(&w, png_samples);
    png_destroy_read_struct(&w.png, &w.info, NULL);
    free(w.row);
    *mem = w.mem;
    if (good)
        return PVX_OK;
    PVX_FREE(*mem);
    if (w.e == PVX_ENOMEM || w.why[0] == '\0')
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for the image", name);
    return pvx_fail(d, PVX_ECORRUPT, "%s: damaged or cut: %s", name, w.why);
}

static void png_put(struct png_work *w)
{
    const struct cap_image *img = w->in;
    int depth = cap_pixfmt_depth(img->fmt);
    bool rgb = cap_pixfmt_channels(img->fmt) == 3;
    png_init_io(w->png, w->file);
    png_set_IHDR(w->png, w->info, (uint32_t)img->width, (uint32_t)img->height, depth,
                 rgb ? PNG_COLOR_TYPE_RGB : PNG_COLOR_TYPE_GRAY, PNG_INTERLACE_NONE,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    /* Fast; of flames, whose pictures are dark beside the flame, hardly larger than the best. */
    png_set_filter(w->png, PNG_FILTER_TYPE_BASE, PNG_FILTER_SUB);
    png_set_compression_level(w->png, Z_BEST_SPEED);
    png_set_compression_strategy(w->png, Z_RLE);
    png_write_info(w->png, w->info);
    if (depth == 16)
        png_set_swap(w->png);
    for (int32_t y = 0; y < img->height; y++)
        png_write_row(w->png, (png_const_bytep)img->data + y * img->stride);
    png_write_end(w->png, NULL);
}

pvx_err cap_png_save(const char *path, const struct cap_image *img, struct pvx_diag *d)
{
    struct png_work w = {.in = img};
    char *bytes = NULL;
    size_t n = 0;
    w.file = open_memstream(&bytes, &n);
    w.png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &w, png_failed, png_warned);
    w.info = w.png != NULL ? png_create_info_struct(w.png) : NULL;
    bool good = w.file != NULL && png_try(&w, png_put);
    png_destroy_write_struct(&w.png, &w.info);
    if (w.file != NULL)
        good = fclose(w.file) == 0 && good;
    pvx_err e = good ? pvx_file_write(path, bytes, n, d)
                     : pvx_fail(d, PVX_ENOMEM, "%s: no memory for the image", path);
    free(bytes);
    return e;
}
