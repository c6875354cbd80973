#include "capture/files/tiff.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <tiffio.h>

#include "base/mem.h"
#include "capture/files/npy.h"
#include "capture/files/picture.h"

#define SAMPLES_MAX 16 /* in a pixel */

struct tiff {
    const struct cap_bytes *b;
    const char *name;
    uint64_t at; /* of the next read */
    bool tags;   /* they are being read: warnings are about tags */
    char why[200];

    TIFF *tif;
    uint32_t width, height, rows;
    uint16_t samples, bits, format, photometric, planes, compression;
    uint16_t *map[3]; /* of colours, or NULL */
    int colours;      /* samples of a pixel that are light */
    int channels;     /* of the picture: 1 or 3 */
    uint32_t most;    /* full scale of integers */
    size_t as_is;     /* bytes of a sample, where rows are copied; else 0 */
    uint32_t seen;    /* largest integer of more than 16 bits */
    struct cap_image *out;
};

/* ---- what libtiff calls ------------------------------------------------------------------------- */

static tmsize_t tiff_read(thandle_t h, void *to, tmsize_t size)
{
    struct tiff *t = h;
    uint64_t left = t->at < t->b->n ? t->b->n - t->at : 0;
    size_t n = (uint64_t)size < left ? (size_t)size : (size_t)left;
    if (!cap_bytes_get(t->b, t->at, to, n))
        return 0;
    t->at += n;
    return (tmsize_t)n;
}

static tmsize_t tiff_write(thandle_t h, void *from, tmsize_t size)
{
    (void)h, (void)from, (void)size;
    return 0;
}

static toff_t tiff_seek(thandle_t h, toff_t to, int whence)
{
    struct tiff *t = h;
    t->at = whence == SEEK_SET ? to : whence == SEEK_CUR ? t->at + to : t->b->n + to;
    return t->at;
}

static int tiff_close(thandle_t h)
{
    (void)h;
    return 0;
}

static toff_t tiff_size(thandle_t h)
{
    return ((struct tiff *)h)->b->n;
}

__attribute__((format(printf, 4, 0))) static int
tiff_error(TIFF *tif, void *ctx, const char *module, const char *format, va_list ap)
{
    struct tiff *t = ctx;
    (void)tif, (void)module;
    if (t->why[0] == '\0') /* the first says best what is wrong */
        vsnprintf(t->why, sizeof t->why, format, ap);
    return 1;
}

/* A warning is an error where a tag that matters is not taken as it stands, and wherever samples are decoded:
 * libtiff goes on with a guess or with zeros. */
__attribute__((format(printf, 4, 0))) static int
tiff_warning(TIFF *tif, void *ctx, const char *module, const char *format, va_list ap)
{
    static const char *const matters[] = {
        "ByteCounts",   "Offsets",         "RowsPerStrip", "Compression", "BitsPerSample",
        "SampleFormat", "SamplesPerPixel", "Photometric",  "FillOrder",   "PlanarConfig",
        "ColorMap",     "ExtraSamples",    "Predictor"};
    struct tiff *t = ctx;
    char text[200];
    va_list again;
    va_copy(again, ap);
    vsnprintf(text, sizeof text, format, again);
    va_end(again);
    bool bad = !t->tags;
    for (size_t i = 0; i < sizeof matters / sizeof matters[0]; i++)
        bad |= strstr(text, matters[i]) != NULL;
    if (strstr(text, "Defining non-color channels as ExtraSamples") == NULL && bad)
        return tiff_error(tif, ctx, module, format, ap);
    return 1;
}

static TIFF *tiff_open(struct tiff *t)
{
    TIFFOpenOptions *o = TIFFOpenOptionsAlloc();
    if (o == NULL)
        return NULL;
    TIFFOpenOptionsSetErrorHandlerExtR(o, tiff_error, t);
    TIFFOpenOptionsSetWarningHandlerExtR(o, tiff_warning, t);
    TIFFOpenOptionsSetMaxSingleMemAlloc(o, (tmsize_t)1 << 32);
    /* h: no tags yet; m: no map of the file; c: strips as they are */
    TIFF *tif = TIFFClientOpenExt(t->name, "rhmc", t, tiff_read, tiff_write, tiff_seek, tiff_close,
                                  tiff_size, NULL, NULL, o);
    TIFFOpenOptionsFree(o);
    return tif;
}

/* ---- tags --------------------------------------------------------------------------------------- */

static const char *tiff_meaning(uint16_t photometric)
{
    switch (photometric) {
    case PHOTOMETRIC_MASK: return "a mask";
    case PHOTOMETRIC_SEPARATED: return "inks (CMYK)";
    case PHOTOMETRIC_YCBCR: return "luma and chroma (YCbCr)";
    case PHOTOMETRIC_CIELAB:
    case PHOTOMETRIC_ICCLAB:
    case PHOTOMETRIC_ITULAB: return "L*a*b*";
    case PHOTOMETRIC_LOGL:
    case PHOTOMETRIC_LOGLUV: return "logarithms";
    case 32803:
        return "a raw sensor's (CFA): as grey samples, with --pixel-format BayerRG16 and so on";
    case 34892: return "a raw sensor's (LinearRaw)";
    default: return "unknown";
    }
}

static const char *tiff_compression(uint16_t compression)
{
    switch (compression) {
    case COMPRESSION_NONE:
    case COMPRESSION_CCITTRLE:
    case COMPRESSION_CCITTRLEW:
    case COMPRESSION_CCITTFAX3:
    case COMPRESSION_CCITTFAX4:
    case COMPRESSION_LZW:
    case COMPRESSION_ADOBE_DEFLATE:
    case COMPRESSION_DEFLATE:
    case COMPRESSION_PACKBITS:
    case COMPRESSION_LZMA:
    case COMPRESSION_ZSTD: return NULL;
    case COMPRESSION_OJPEG:
    case COMPRESSION_JPEG:
    case 34892: return " (JPEG, with losses)";
    default: return "";
    }
}

/* What the samples are; refuses what is not light on a linear scale. */
static pvx_err tiff_check_samples(struct tiff *t, struct pvx_diag *d)
{
    bool is_float = t->format == SAMPLEFORMAT_IEEEFP, grey = t->photometric < 2;
    if (t->photometric > PHOTOMETRIC_PALETTE)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: its samples are %s (PhotometricInterpretation %u): save it as grey or "
                        "RGB",
                        t->name, tiff_meaning(t->photometric), t->photometric);
    if (t->format != SAMPLEFORMAT_UINT && t->format != SAMPLEFORMAT_VOID && !is_float)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: its samples are %s: save it with unsigned integers or floats", t->name,
                        t->format == SAMPLEFORMAT_INT ? "signed integers" : "complex numbers");
    if (is_float ? t->bits != 16 && t->bits != 32 && t->bits != 64 : t->bits < 1 || t->bits > 32)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: samples of %u bits; 1 to 32 are read, and floats of 16, 32 or 64",
                        t->name, t->bits);
    if (is_float && t->photometric != PHOTOMETRIC_MINISBLACK && t->photometric != PHOTOMETRIC_RGB)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: floats of which the smallest is white, or that are entries of a map: "
                        "save it as grey or RGB",
                        t->name);
    float *levels;
    if (TIFFGetField(t->tif, TIFFTAG_REFERENCEBLACKWHITE, &levels))
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: names samples for black and white (ReferenceBlackWhite) that are not "
                        "the ends of its scale: save it without this tag",
                        t->name);
    t->colours = t->photometric == PHOTOMETRIC_RGB ? 3 : 1;
    t->channels = t->photometric >= PHOTOMETRIC_RGB ? 3 : 1;
    uint16_t extras = 0, *extra = NULL;
    TIFFGetField(t->tif, TIFFTAG_EXTRASAMPLES, &extras, &extra);
    if (t->samples < t->colours || t->samples > SAMPLES_MAX)
        return pvx_fail(d, PVX_EUNSUP, "%s: %u samples in a pixel; %d are needed, %d at most",
                        t->name, t->samples, t->colours, SAMPLES_MAX);
    for (int i = 0; grey && i < t->samples - 1; i++)
        if (i >= extras || extra == NULL || extra[i] == EXTRASAMPLE_UNSPECIFIED)
            return pvx_fail(d, PVX_EUNSUP,
                            "%s: grey with %d more samples in a pixel, and it does not say what "
                            "they are: save it as grey or RGB",
                            t->name, t->samples - 1);
    return PVX_OK;
}

/* Uncompressed samples that take another room than the tags say are not those that the tags speak of. */
static pvx_err tiff_check_room(struct tiff *t, struct pvx_diag *d)
{
    uint64_t *size, have = 0;
    uint32_t strips = TIFFIsTiled(t->tif) ? 0 : TIFFNumberOfStrips(t->tif);
    uint64_t need = TIFFScanlineSize64(t->tif) * t->height * (t->planes == 2 ? t->samples : 1U);
    if (t->compression != COMPRESSION_NONE || strips == 0 ||
        !TIFFGetField(t->tif, TIFFTAG_STRIPBYTECOUNTS, &size) || size == NULL)
        return PVX_OK;
    for (uint32_t i = 0; i < strips; i++)
        have += size[i];
    if (have >= need + need / 8 + 64)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: its samples take %llu bytes, but by its tags (%u bits each) %llu: "
                        "save it again, each sample with the bits that it takes",
                        t->name, (unsigned long long)have, t->bits, (unsigned long long)need);
    return PVX_OK;
}

static pvx_err tiff_check_tags(struct tiff *t, struct pvx_diag *d)
{
    uint16_t order = FILLORDER_MSB2LSB;
    uint32_t depth = 1;
    t->planes = PLANARCONFIG_CONTIG;
    TIFFGetField(t->tif, TIFFTAG_IMAGEWIDTH, &t->width);
    TIFFGetField(t->tif, TIFFTAG_IMAGELENGTH, &t->height);
    if (t->width == 0 || t->height == 0)
        return pvx_fail(d, PVX_ECORRUPT, "%s: damaged: it has no size", t->name);
    /* Again: a tag may be there twice. */
    PVX_TRY(cap_picture_fits(t->width, t->height, t->b->n, t->name, d));
    if (!TIFFGetField(t->tif, TIFFTAG_PHOTOMETRIC, &t->photometric))
        return pvx_fail(d, PVX_ECORRUPT,
                        "%s: does not say what its samples mean (PhotometricInterpretation): save "
                        "it again",
                        t->name);
    TIFFGetFieldDefaulted(t->tif, TIFFTAG_SAMPLESPERPIXEL, &t->samples);
    TIFFGetFieldDefaulted(t->tif, TIFFTAG_BITSPERSAMPLE, &t->bits);
    TIFFGetFieldDefaulted(t->tif, TIFFTAG_SAMPLEFORMAT, &t->format);
    TIFFGetFieldDefaulted(t->tif, TIFFTAG_COMPRESSION, &t->compression);
    TIFFGetFieldDefaulted(t->tif, TIFFTAG_PLANARCONFIG, &t->planes);
    TIFFGetFieldDefaulted(t->tif, TIFFTAG_FILLORDER, &order);
    TIFFGetFieldDefaulted(t->tif, TIFFTAG_IMAGEDEPTH, &depth);
    const char *lossy = tiff_compression(t->compression);
    if (lossy != NULL || !TIFFIsCODECConfigured(t->compression))
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: compression %u%s is not read: save it without, or with LZW or Deflate",
                        t->name, t->compression, lossy != NULL ? lossy : "");
    if (order != FILLORDER_MSB2LSB && t->bits != 1)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: the bits of a byte lie the other way round (FillOrder 2), which means "
                        "nothing certain with %u bits: save it with FillOrder 1",
                        t->name, t->bits);
    if (depth != 1)
        return pvx_fail(d, PVX_EUNSUP, "%s: has %u layers (ImageDepth): save each as a page",
                        t->name, depth);
    PVX_TRY(tiff_check_samples(t, d));
    if (t->photometric == PHOTOMETRIC_PALETTE &&
        (t->bits > 16 ||
         !TIFFGetField(t->tif, TIFFTAG_COLORMAP, &t->map[0], &t->map[1], &t->map[2]) ||
         t->map[0] == NULL || t->map[1] == NULL || t->map[2] == NULL)) /* without memory */
        return pvx_fail(d, PVX_ECORRUPT, "%s: damaged: its map of colours is missing", t->name);
    return tiff_check_room(t, d);
}

/* ---- samples ------------------------------------------------------------------------------------ */

/* Sample i of a row as libtiff leaves it: 8, 16, 24 and 32 bits in the order of this processor; others a stream of bits,
 * the most significant first. */
static uint32_t tiff_sample(const unsigned char *row, size_t i, unsigned bits)
{
    uint16_t u2;
    uint32_t u4;
    switch (bits) {
    case 8: return row[i];
    case 16: memcpy(&u2, row + 2 * i, 2); return u2;
    case 24: return row[3 * i] | (uint32_t)row[3 * i + 1] << 8 | (uint32_t)row[3 * i + 2] << 16;
    case 32: memcpy(&u4, row + 4 * i, 4); return u4;
    }
    uint64_t v = 0;
    size_t first = i * bits / 8, last = (i * bits + bits - 1) / 8;
    for (size_t k = first; k <= last; k++)
        v = v << 8 | row[k];
    return (uint32_t)(v >> (8 * (last + 1) - (i + 1) * bits) & ((1ULL << bits) - 1));
}

static float tiff_float(const unsigned char *row, size_t i, unsigned bits)
{
    float f4;
    double f8;
    uint16_t half;
    switch (bits) {
    case 16: memcpy(&half, row + 2 * i, 2); return cap_npy_half(half);
    case 32: memcpy(&f4, row + 4 * i, 4); return f4;
    default: memcpy(&f8, row + 8 * i, 8); return (float)f8;
    }
}

static void tiff_put_integer(struct tiff *t, size_t to, uint32_t v)
{
    unsigned char *out = (void *)(uintptr_t)t->out->data;
    if (t->photometric == PHOTOMETRIC_MINISWHITE)
        v = t->most - v;
    int depth = cap_pixfmt_depth(t->out->fmt);
    if (depth == 8)
        out[to] = (unsigned char)(v * (255 / t->most));
    else if (depth == 16)
        ((uint16_t *)out)[to] = (uint16_t)(((uint64_t)v * 65535 + t->most / 2) / t->most);
    else
        ((float *)out)[to] = (float)((double)v / t->most);
    t->seen = v > t->seen ? v : t->seen;
}

/* `n` pixels of a row, from pixel x of line y on.  plane: that of planes apart. */
static void tiff_put(struct tiff *t, const unsigned char *row, uint32_t x, uint32_t y, uint32_t n,
                     int plane)
{
    bool apart = t->planes == PLANARCONFIG_SEPARATE;
    size_t step = apart ? 1 : t->samples;
    size_t to = ((size_t)y * t->width + x) * (size_t)t->channels + (size_t)plane;
    if (t->as_is > 0) {
        memcpy((char *)(uintptr_t)t->out->data + to * t->as_is, row,
               n * (size_t)t->channels * t->as_is);
        return;
    }
    for (uint32_t i = 0; i < n; i++, to += (size_t)t->channels)
        for (int c = 0; c < (apart ? 1 : t->colours); c++) {
            size_t at = i * step + (size_t)c;
            if (t->format == SAMPLEFORMAT_IEEEFP) {
                ((float *)(uintptr_t)t->out->data)[to + (size_t)c] = tiff_float(row, at, t->bits);
                continue;
            }
            uint32_t v = tiff_sample(row, at, t->bits);
            if (t->map[0] == NULL)
                tiff_put_integer(t, to + (size_t)c, v);
            for (int k = 0; t->map[0] != NULL && k < 3; k++)
                ((uint16_t *)(uintptr_t)t->out->data)[to + (size_t)k] = t->map[k][v];
        }
}

static bool tiff_strips(struct tiff *t, int plane, unsigned char *row)
{
    bool good = true;
    for (uint32_t y = 0; y < t->height && good; y++) {
        good = TIFFReadScanline(t->tif, row, y, (uint16_t)plane) == 1;
        if (good)
            tiff_put(t, row, 0, y, t->width, plane);
    }
    return good;
}

static bool tiff_tiles(struct tiff *t, int plane, uint32_t w, uint32_t h, unsigned char *tile)
{
    size_t row = (size_t)TIFFTileRowSize(t->tif);
    for (uint32_t y = 0; y < t->height; y += h)
        for (uint32_t x = 0; x < t->width; x += w) {
            if (TIFFReadTile(t->tif, tile, x, y, 0, (uint16_t)plane) < 0)
                return false;
            for (uint32_t k = 0; k < h && k < t->height - y; k++)
                tiff_put(t, tile + k * row, x, y + k, w < t->width - x ? w : t->width - x, plane);
        }
    return true;
}

static pvx_err tiff_pixels(struct tiff *t, struct pvx_diag *d)
{
    uint32_t w = 0, h = 0;
    bool tiled = TIFFIsTiled(t->tif), good = true;
    if (tiled) {
        TIFFGetField(t->tif, TIFFTAG_TILEWIDTH, &w);
        TIFFGetField(t->tif, TIFFTAG_TILELENGTH, &h);
        if (w == 0 || h == 0)
            return pvx_fail(d, PVX_ECORRUPT, "%s: damaged: tiles without a size", t->name);
        PVX_TRY(cap_picture_fits(w, h, t->b->n, t->name, d));
    }
    uint64_t room = tiled ? TIFFTileSize64(t->tif) : TIFFScanlineSize64(t->tif);
    unsigned char *part = room > 0 && room < SIZE_MAX / 2 ? malloc((size_t)room) : NULL;
    if (part == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for its samples", t->name);
    int planes = t->planes == PLANARCONFIG_SEPARATE ? t->colours : 1;
    for (int p = 0; p < planes && good; p++)
        good = tiled ? tiff_tiles(t, p, w, h, part) : tiff_strips(t, p, part);
    free(part);
    if (!good || t->why[0] != '\0')
        return pvx_fail(d, PVX_ECORRUPT, "%s: damaged or cut: %s", t->name,
                        t->why[0] != '\0' ? t->why : "its samples are not all there");
    /* Counts of 16 bits or less in more: their full scale is not that of the type. */
    if (t->bits > 16 && t->format != SAMPLEFORMAT_IEEEFP && t->seen > 0 &&
        t->seen >> (t->bits - 12) == 0)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: its samples of %u bits end at %u, so they seem to be counts: save it "
                        "with 16 bits, or as floats of which 1 is full scale",
                        t->name, t->bits, t->seen);
    return PVX_OK;
}

/* Old maps have 8 bits in 16. */
static void tiff_widen_map(struct tiff *t)
{
    unsigned all = 0;
    for (uint32_t i = 0; t->map[0] != NULL && i <= t->most; i++)
        all |= t->map[0][i] | t->map[1][i] | t->map[2][i];
    for (uint32_t i = 0; t->map[0] != NULL && all < 256 && i <= t->most; i++)
        for (int c = 0; c < 3; c++)
            t->map[c][i] = (uint16_t)(t->map[c][i] * 257);
}

static pvx_err tiff_load(struct tiff *t, uint64_t at, void **mem, struct pvx_diag *d)
{
    t->tags = true;
    if (!TIFFSetSubDirectory(t->tif, at) || t->why[0] != '\0')
        return pvx_fail(d, PVX_ECORRUPT, "%s: damaged: %s", t->name,
                        t->why[0] != '\0' ? t->why : "its tags cannot be read");
    t->tags = false;
    PVX_TRY(tiff_check_tags(t, d));
    bool is_float = t->format == SAMPLEFORMAT_IEEEFP || t->bits > 16;
    t->most = t->bits < 32 ? (1U << t->bits) - 1 : UINT32_MAX;
    int depth = is_float ? 32 : t->map[0] == NULL && t->bits <= 8 && 255 % t->most == 0 ? 8 : 16;
    tiff_widen_map(t);
    bool alone = t->planes == PLANARCONFIG_SEPARATE ? t->colours == 1 : t->samples == t->colours;
    if (alone && t->bits == depth && t->map[0] == NULL &&
        t->photometric != PHOTOMETRIC_MINISWHITE &&
        (t->bits < 32 || t->format == SAMPLEFORMAT_IEEEFP))
        t->as_is = t->bits / 8U;
    *mem = cap_picture_make(t->width, t->height, t->channels, depth, t->name, t->out, d);
    return *mem == NULL ? PVX_ENOMEM : tiff_pixels(t, d);
}

static pvx_err tiff_load_page(const struct cap_bytes *b, const char *name, uint64_t at,
                              struct cap_image *out, void **mem, struct pvx_diag *d)
{
    struct tiff t = {.b = b, .name = name, .out = out};
    *mem = NULL;
    t.tif = tiff_open(&t);
    pvx_err e = t.tif != NULL      ? tiff_load(&t, at, mem, d)
                : t.why[0] == '\0' ? pvx_fail(d, PVX_ENOMEM, "%s: no memory for the image", name)
                                   : pvx_fail(d, PVX_ECORRUPT, "%s: damaged: %s", name, t.why);
    if (t.tif != NULL)
        TIFFClose(t.tif);
    if (e != PVX_OK)
        PVX_FREE(*mem);
    return e;
}

const struct cap_tiff *cap_tiff_module(void)
{
    static const struct cap_tiff is = {CAP_TIFF_VERSION, tiff_load_page};
    return &is;
}
