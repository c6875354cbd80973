/* test_tiff.c - what a TIFF file says of its samples is obeyed or refused by name. */
#include "../t.h"

#include <tiffio.h>

#include "base/file.h"
#include "capture/files/imgio.h"
#include "capture/files/reel.h"
#include "tests/lib/plugins.h"
#include "tests/lib/scratch.h"

enum { W = 20, H = 12 };

/* The picture of all files: 16 bits, another one for each channel and page. */
static unsigned truth(unsigned x, unsigned y, unsigned channel, unsigned page)
{
    return (1000 + 2500 * x + 100 * y + 77 * page) >> channel;
}

struct kind {
    int photometric, samples, bits, planar, format, compression, tile, extra, orientation, type;
    int rows, predictor, fill;
    bool big_endian, big, counts;
    const char *text;
    const float *levels;
    const uint16_t *map[3];
    unsigned page;
};

static void put_bits(unsigned char *p, size_t at, unsigned bits, uint64_t v)
{
    for (unsigned i = 0; i < bits; i++, at++)
        if (v >> (bits - 1 - i) & 1)
            p[at / 8] |= (unsigned char)(0x80 >> at % 8);
}

static uint16_t half_of(float f) /* positive, normal, exact enough */
{
    int e;
    float m = frexpf(f, &e);
    return f == 0 ? 0 : (uint16_t)((e + 14) << 10 | (int)((2 * m - 1) * 1024));
}

/* Sample i of a row: the upper bits of v, or v / 65535. */
static void put_sample(unsigned char *row, size_t i, const struct kind *k, unsigned v)
{
    float f4 = (float)v / 65535;
    double f8 = (double)v / 65535;
    uint16_t half = half_of(f4);
    uint64_t most = (1ULL << k->bits % 64) - 1, u = (v * most + 32767) / 65535;
    u = k->counts ? v >> 4 : u;
    u = k->photometric == PHOTOMETRIC_MINISWHITE ? most - u : u;
    uint16_t u2 = (uint16_t)u;
    uint32_t u4 = (uint32_t)u;
    if (k->format == SAMPLEFORMAT_IEEEFP && k->bits == 16)
        memcpy(row + 2 * i, &half, 2);
    else if (k->format == SAMPLEFORMAT_IEEEFP)
        memcpy(row + (size_t)k->bits / 8 * i, k->bits == 32 ? (void *)&f4 : (void *)&f8,
               (size_t)k->bits / 8);
    else if (k->bits == 16)
        memcpy(row + 2 * i, &u2, 2);
    else if (k->bits == 24 || k->bits == 32)
        memcpy(row + (size_t)k->bits / 8 * i, &u4, (size_t)k->bits / 8);
    else
        put_bits(row, i * (size_t)k->bits, (unsigned)k->bits, u);
}

/* Samples of `n` pixels from (x, y) on; what lies beside the picture is 0, and alpha all ones. */
static void put_row(unsigned char *row, size_t size, const struct kind *k, unsigned x, unsigned y,
                    unsigned n, unsigned plane)
{
    unsigned each = k->planar == 2 ? 1 : (unsigned)k->samples;
    memset(row, 0, size);
    for (unsigned i = 0; i < n && y < H; i++)
        for (unsigned c = 0; c < each && x + i < W; c++) {
            unsigned channel = k->planar == 2 ? plane : c;
            bool light = channel < (k->photometric == PHOTOMETRIC_RGB ? 3 : 1);
            put_sample(row, (size_t)i * each + c, k,
                       light ? truth(x + i, y, channel, k->page) : 65535);
        }
}

static void add_page(TIFF *t, const struct kind *k)
{
    static unsigned char part[1 << 16];
    uint16_t extras[8];
    for (int i = 0; i < 8; i++)
        extras[i] = (uint16_t)(k->extra > 0 ? k->extra : 0);
    TIFFSetField(t, TIFFTAG_IMAGEWIDTH, W);
    TIFFSetField(t, TIFFTAG_IMAGELENGTH, H);
    TIFFSetField(t, TIFFTAG_SAMPLESPERPIXEL, k->samples);
    TIFFSetField(t, TIFFTAG_BITSPERSAMPLE, k->bits);
    TIFFSetField(t, TIFFTAG_PHOTOMETRIC, k->photometric);
    TIFFSetField(t, TIFFTAG_PLANARCONFIG, k->planar > 0 ? k->planar : 1);
    TIFFSetField(t, TIFFTAG_SAMPLEFORMAT, k->format > 0 ? k->format : 1);
    TIFFSetField(t, TIFFTAG_COMPRESSION, k->compression > 0 ? k->compression : 1);
    if (k->predictor > 0)
        TIFFSetField(t, TIFFTAG_PREDICTOR, k->predictor);
    if (k->fill > 0)
        TIFFSetField(t, TIFFTAG_FILLORDER, k->fill);
    if (k->map[0] != NULL)
        TIFFSetField(t, TIFFTAG_COLORMAP, k->map[0], k->map[1], k->map[2]);
    if (k->levels != NULL)
        TIFFSetField(t, TIFFTAG_REFERENCEBLACKWHITE, k->levels);
    if (k->text != NULL)
        TIFFSetField(t, TIFFTAG_IMAGEDESCRIPTION, k->text);
    if (k->orientation > 0)
        TIFFSetField(t, TIFFTAG_ORIENTATION, k->orientation);
    if (k->type > 0)
        TIFFSetField(t, TIFFTAG_SUBFILETYPE, k->type);
    int more = k->samples - (k->photometric == PHOTOMETRIC_RGB ? 3 : 1);
    if (more > 0 && k->extra >= 0)
        TIFFSetField(t, TIFFTAG_EXTRASAMPLES, more, extras);
    unsigned planes = k->planar == 2 ? (unsigned)k->samples : 1, tile = (unsigned)k->tile;
    if (tile > 0) {
        TIFFSetField(t, TIFFTAG_TILEWIDTH, tile);
        TIFFSetField(t, TIFFTAG_TILELENGTH, tile);
        size_t row = (size_t)TIFFTileRowSize(t);
        for (unsigned p = 0; p < planes; p++)
            for (unsigned y = 0; y < H; y += tile)
                for (unsigned x = 0; x < W; x += tile) {
                    for (unsigned i = 0; i < tile; i++)
                        put_row(part + i * row, row, k, x, y + i, tile, p);
                    T_OK(TIFFWriteTile(t, part, x, y, 0, (uint16_t)p) > 0);
                }
    } else {
        TIFFSetField(t, TIFFTAG_ROWSPERSTRIP, k->rows > 0 ? k->rows : H);
        for (unsigned p = 0; p < planes; p++)
            for (unsigned y = 0; y < H; y++) {
                put_row(part, (size_t)TIFFScanlineSize(t), k, 0, y, W, p);
                T_OK(TIFFWriteScanline(t, part, y, (uint16_t)p) == 1);
            }
    }
    T_OK(TIFFWriteDirectory(t));
}

static void write_tiff(const char *name, const struct kind *k, size_t pages)
{
    const char mode[] = {'w', k->big_endian ? 'b' : 'l', k->big ? '8' : '\0', '\0'};
    TIFF *t = TIFFOpen(at("%s", name), mode);
    T_OK(t != NULL);
    for (size_t i = 0; i < pages && t != NULL; i++) {
        struct kind one = k[i];
        one.page = (unsigned)i;
        add_page(t, &one);
    }
    if (t != NULL)
        TIFFClose(t);
}

static double sample_of(const struct cap_image *img, size_t i)
{
    switch (cap_pixfmt_depth(img->fmt)) {
    case 8: return ((const uint8_t *)img->data)[i] / 255.0;
    case 16: return ((const uint16_t *)img->data)[i] / 65535.0;
    default: return (double)((const float *)img->data)[i];
    }
}

/* How far the picture is from the truth at worst; 1: it has another shape. */
static double off(const struct cap_image *img, int channels, unsigned page)
{
    double worst = 0;
    if (img->width != W || img->height != H || cap_pixfmt_channels(img->fmt) != channels)
        return 1;
    for (unsigned i = 0; i < (unsigned)(W * H * channels); i++) {
        unsigned c = i % (unsigned)channels, p = i / (unsigned)channels;
        worst = fmax(worst, fabs(sample_of(img, i) - truth(p % W, p / W, c, page) / 65535.0));
    }
    return worst;
}

/* Thumbnails and masks are none. */
T_CASE(pages_are_pictures)
{
    const struct kind stack[] = {{1, 1, 16, .type = FILETYPE_REDUCEDIMAGE},
                                 {1, 1, 16, .type = FILETYPE_PAGE},
                                 {.photometric = 1, .samples = 1, .bits = 16},
                                 {1, 1, 16, .type = FILETYPE_MASK},
                                 {.photometric = 1, .samples = 1, .bits = 16}};
    struct pvx_diag d = {""};
    struct cap_loaded l;
    uint32_t pages;
    write_tiff("stack.tif", stack, 5);
    T_EQ_I(cap_image_pages(at("stack.tif"), &pages, &d), PVX_OK);
    T_EQ_I(pages, 3);
    for (uint32_t i = 0; i < 3; i++) {
        T_EQ_I(cap_image_load_page(at("stack.tif"), i, &l, &d), PVX_OK);
        T_NEAR(off(&l.img, 1, i == 2 ? 4 : i + 1), 0, 1e-5);
        cap_loaded_free(&l);
    }
    T_EQ_I(cap_image_load_page(at("stack.tif"), 3, &l, &d), PVX_ERANGE);
    T_CONTAINS(d.text, "has 3 pages; there is no page 3");
    d.text[0] = '\0';
    T_EQ_I(cap_image_load(at("stack.tif"), &l, &d), PVX_EUNSUP);
    T_CONTAINS(d.text, "stack.tif: has 3 pages");
    d.text[0] = '\0';
    write_tiff("one.tif", stack + 2, 1);
    T_EQ_I(cap_image_pages(at("one.tif"), &pages, &d), PVX_OK);
    T_EQ_I(pages, 1);
    T_EQ_I(cap_image_load(at("one.tif"), &l, &d), PVX_OK);
    T_NEAR(off(&l.img, 1, 0), 0, 1e-5);
    cap_loaded_free(&l);
    struct kind mixed[6] = {{0}};
    static const char *const text[] = {"ImageJ=1.53t\nimages=6\nchannels=2\nframes=3\n",
                                       "ImageJ=1.53t\nimages=6\nslices=2\nframes=3\n",
                                       "<OME><Pixels SizeC=\"2\" SizeT=\"3\" SizeZ=\"1\"/></OME>",
                                       "<OME><Pixels SizeC=\"1\" SizeT=\"3\" SizeZ=\"2\"/></OME>",
                                       "ImageJ=1.53t\nimages=6\nslices=6\n",
                                       "<OME><Pixels SizeC=\"1\" SizeT=\"6\" SizeZ=\"1\"/></OME>"};
    for (size_t i = 0; i < 6; i++) {
        for (size_t k = 0; k < 6; k++)
            mixed[k] = stack[2];
        mixed[0].text = text[i];
        write_tiff("mixed.tif", mixed, 6);
        d.text[0] = '\0';
        T_EQ_I(cap_image_pages(at("mixed.tif"), &pages, &d), i < 4 ? PVX_EUNSUP : PVX_OK);
        T_CONTAINS(d.text, i < 4 ? "not one picture after the other" : "");
    }
    static const struct {
        const char *text, *says;
    } one[] = {
        {"ImageJ=1.53t\nmin=0\ncf=0\nc0=-32768\nc1=1\nvunit=Gray Value\n", "ImageJ's calibration"},
        {"ImageJ=1.53t\ncf=21\nvunit=Uncalibrated OD\n", "ImageJ's calibration"},
        {"ImageJ=1.53t\ncf=0\nvunit=counts\n", ""},
        {"{\"shape\": [12, 12, 20, 1], \"truncated\": true}", "has 12 pictures, but the tags of 1"},
        {"{\"shape\": [18446744073709551615, 2]}", ""},
        {"{\"axes\": \"YX\", \"shape\": [12, 20]}", ""},
        {"{\"shape\": [", ""}};
    for (size_t i = 0; i < sizeof one / sizeof one[0]; i++) {
        mixed[0].text = one[i].text;
        write_tiff("one.tif", mixed, 1);
        d.text[0] = '\0';
        T_EQ_I(cap_image_pages(at("one.tif"), &pages, &d),
               *one[i].says != '\0' ? PVX_EUNSUP : PVX_OK);
        T_CONTAINS(d.text, one[i].says);
        d.text[0] = '\0';
        T_EQ_I(cap_image_load(at("one.tif"), &l, &d), *one[i].says != '\0' ? PVX_EUNSUP : PVX_OK);
        cap_loaded_free(&l);
    }
    write_tiff("previews.tif", stack, 1);
    T_EQ_I(cap_image_pages(at("previews.tif"), &pages, &d), PVX_EUNSUP);
    T_CONTAINS(d.text, "previews.tif: has only previews");
}

/* The file without a number is the first of a recording, or it is no part of it. */
T_CASE(stacks_in_a_folder)
{
    const struct kind one = {.photometric = 1, .samples = 1, .bits = 16}, stack[] = {one, one};
    struct pvx_diag d = {""};
    struct cap_reel r;
    T_EQ_I(mkdir(at("stacks"), 0700), 0);
    write_tiff("stacks/rec@0001.tif", stack, 2);
    write_tiff("stacks/rec.tif", stack, 2);
    T_EQ_I(cap_reel_open(at("stacks"), &r, &d), PVX_OK);
    T_OK(r.kind == CAP_REEL_PAGES && r.n == 4 && r.begin == 0);
    T_CONTAINS(r.path[0], "stacks/rec.tif");
    cap_reel_close(&r);
    T_EQ_I(rename(at("stacks/rec.tif"), at("stacks/dark.tif")), 0);
    T_EQ_I(cap_reel_open(at("stacks"), &r, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "stacks/dark.tif has no number");
    cap_reel_close(&r);
    d.text[0] = '\0';
    T_EQ_I(remove(at("stacks/dark.tif")), 0);
    T_EQ_I(cap_reel_open(at("stacks"), &r, &d), PVX_OK);
    T_OK(r.n == 2 && r.begin == 1);
    cap_reel_close(&r);
    write_tiff("stacks/rec@0003.tif", stack, 2);
    T_EQ_I(cap_reel_open(at("stacks"), &r, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "rec@0003.tif: a file is missing between them");
    cap_reel_close(&r);
}

/* The picture is that which was written, to half a step of its samples, in the format that holds them. */
static void comes_right(const char *name, const struct kind *k)
{
    struct pvx_diag d = {""};
    struct cap_loaded l;
    write_tiff("kind.tif", k, 1);
    pvx_err e = cap_image_load(at("kind.tif"), &l, &d);
    bool is_float = k->format == SAMPLEFORMAT_IEEEFP;
    double near = is_float ? (k->bits == 16 ? 1e-3 : 1e-7) : 0.5 / (ldexp(1, k->bits) - 1);
    double worst = e == PVX_OK ? off(&l.img, k->photometric == PHOTOMETRIC_RGB ? 3 : 1, 0) : 2;
    int depth = e == PVX_OK ? cap_pixfmt_depth(l.img.fmt) : 0;
    int want = is_float || k->bits > 16 ? 32 : k->bits > 8 || k->bits == 3 ? 16 : 8;
    bool good = worst < near + 1e-5 && depth == want && d.text[0] == '\0';
    if (!good)
        printf("  %s, %d bits: off by %g, of %d bits: %s\n", name, k->bits, worst, depth, d.text);
    T_OK(good);
    cap_loaded_free(&l);
}

/* Every property that is obeyed. */
T_CASE(what_is_obeyed)
{
    enum { WHITE = PHOTOMETRIC_MINISWHITE, BLACK = PHOTOMETRIC_MINISBLACK, RGB = PHOTOMETRIC_RGB };
    static const int all[] = {1, 2, 3, 4, 8, 10, 12, 14, 16, 24, 32};
    for (size_t i = 0; i < sizeof all / sizeof all[0] * 6; i++) {
        const int photometric = (int)i % 3, planar = i % 2 == 0 ? 1 : 2;
        const struct kind k = {.photometric = photometric,
                               .samples = photometric == RGB ? 3 : 1,
                               .bits = all[i / 6],
                               .planar = planar};
        comes_right("integers", &k);
    }
    static const struct {
        const char *name;
        struct kind k;
    } good[] = {
        {"half", {BLACK, 1, 16, .format = 3}},
        {"float", {BLACK, 1, 32, .format = 3}},
        {"double", {RGB, 3, 64, .format = 3}},
        {"apart8", {RGB, 3, 8, .planar = 2, .rows = 5}},
        {"apart16", {RGB, 3, 16, .planar = 2}},
        {"apart12", {RGB, 3, 12, .planar = 2, .rows = 5}},
        {"apart_float", {RGB, 3, 32, .planar = 2, .format = 3, .tile = 16}},
        {"apart_alpha", {RGB, 5, 16, .planar = 2, .extra = 2}},
        {"alpha_associated", {RGB, 4, 8, .extra = 1}},
        {"alpha_unassociated", {RGB, 4, 16, .extra = 2, .tile = 32}},
        {"alpha_float", {RGB, 4, 32, .extra = 2, .format = 3}},
        {"extra_unspecified", {RGB, 6, 16, .extra = 0}},
        {"extra_unsaid", {RGB, 4, 8, .extra = -1}},
        {"grey_alpha", {BLACK, 2, 8, .extra = 1}},
        {"grey_alpha16", {BLACK, 2, 16, .extra = 2}},
        {"grey_alpha12", {WHITE, 2, 12, .extra = 2, .planar = 2}},
        {"grey_alpha_float", {BLACK, 2, 32, .extra = 2, .format = 3, .planar = 2}},
        {"tiles16", {BLACK, 1, 16, .tile = 16}},
        {"tiles12", {RGB, 3, 12, .tile = 16}},
        {"tiles1", {WHITE, 1, 1, .tile = 16}},
        {"strips1", {BLACK, 1, 12, .rows = 1}},
        {"strips7", {BLACK, 1, 16, .rows = 7, .compression = COMPRESSION_LZW}},
        {"motorola16", {RGB, 3, 16, .big_endian = true}},
        {"motorola12", {BLACK, 1, 12, .big_endian = true}},
        {"motorola24", {BLACK, 1, 24, .big_endian = true}},
        {"motorola_float", {RGB, 3, 32, .format = 3, .big_endian = true}},
        {"big", {RGB, 3, 16, .big = true}},
        {"big_motorola", {BLACK, 1, 16, .big = true, .big_endian = true}},
        {"lzw", {RGB, 3, 16, .compression = COMPRESSION_LZW, .predictor = 2}},
        {"deflate", {RGB, 3, 8, .compression = COMPRESSION_ADOBE_DEFLATE, .predictor = 2}},
        {"deflate12", {BLACK, 1, 12, .compression = COMPRESSION_DEFLATE}},
        {"deflate_float",
         {RGB, 3, 32, .format = 3, .compression = COMPRESSION_ADOBE_DEFLATE, .predictor = 3}},
        {"packbits", {BLACK, 1, 8, .compression = COMPRESSION_PACKBITS}},
        {"zstd", {BLACK, 1, 16, .compression = COMPRESSION_ZSTD, .predictor = 2}},
        {"lzma", {BLACK, 1, 16, .compression = COMPRESSION_LZMA}},
        {"fax", {WHITE, 1, 1, .compression = COMPRESSION_CCITTFAX4}},
        {"page", {BLACK, 1, 8, .type = FILETYPE_PAGE, .orientation = 1}},
    };
    for (size_t i = 0; i < sizeof good / sizeof good[0]; i++)
        comes_right(good[i].name, &good[i].k);
}

static bool is_refused(const char *name, const char *says, pvx_err want)
{
    struct pvx_diag d = {""};
    struct cap_loaded l;
    pvx_err e = cap_image_load(at("%s", name), &l, &d);
    bool good =
        e == want && l.mem == NULL && strstr(d.text, name) != NULL && strstr(d.text, says) != NULL;
    if (!good)
        printf("  %d instead of \"%s\": %s\n", (int)e, says, d.text);
    cap_loaded_free(&l);
    return good;
}

T_CASE(what_is_refused)
{
    enum { WHITE = PHOTOMETRIC_MINISWHITE, BLACK = PHOTOMETRIC_MINISBLACK, RGB = PHOTOMETRIC_RGB };
    static const float levels[6] = {16, 235, 16, 235, 16, 235};
    static const struct {
        struct kind k;
        const char *says;
    } bad[] = {
        {{BLACK, 1, 16, .format = 2}, "signed integers"},
        {{BLACK, 1, 64, .format = 6}, "complex numbers"},
        {{BLACK, 1, 24, .format = 3}, "samples of 24 bits"},
        {{BLACK, 1, 64, .rows = 3}, "samples of 64 bits"},
        {{WHITE, 1, 32, .format = 3}, "smallest is white"},
        {{PHOTOMETRIC_SEPARATED, 4, 8, .extra = -1}, "inks (CMYK)"},
        {{PHOTOMETRIC_YCBCR, 3, 8, .extra = -1}, "YCbCr"},
        {{PHOTOMETRIC_CIELAB, 3, 8, .extra = -1}, "L*a*b*"},
        {{32803, 1, 16, .rows = 3}, "BayerRG16"},
        {{34892, 3, 16, .extra = -1}, "LinearRaw"},
        {{BLACK, 2, 8, .extra = 0}, "does not say what they are"},
        {{BLACK, 3, 16, .extra = 0, .planar = 2}, "does not say what they are"},
        {{BLACK, 3, 16, .extra = -1}, "does not say what they are"},
        {{RGB, 3, 16, .orientation = 2}, "orientation tag (2)"},
        {{BLACK, 1, 16, .orientation = 3}, "orientation tag (3)"},
        {{BLACK, 1, 8, .orientation = 6, .big_endian = true}, "exiftool"},
        {{BLACK, 1, 8, .orientation = 8, .big = true}, "orientation tag (8)"},
        {{BLACK, 1, 8, .compression = COMPRESSION_JPEG}, "JPEG, with losses"},
        {{RGB, 3, 8, .levels = levels}, "ReferenceBlackWhite"},
        {{BLACK, 1, 8, .fill = 2}, "FillOrder 2"},
        {{BLACK, 1, 32, .counts = true}, "seem to be counts"},
        {{BLACK, 1, 16, .text = "ImageJ=1.53t\nimages=4000\nslices=4000\n"}, "has 4000 pictures"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        write_tiff("kind.tif", &bad[i].k, 1);
        T_OK(is_refused("kind.tif", bad[i].says, PVX_EUNSUP));
    }
}

/* Gives the first entry of a tag another tag or value; of files in Intel's order. */
static void retag(const char *name, unsigned tag, unsigned to, unsigned count, unsigned value)
{
    char *b;
    size_t n;
    uint32_t folder;
    uint16_t entries, one;
    T_EQ_I(pvx_file_read(at("%s", name), 1 << 20, &b, &n, NULL), PVX_OK);
    memcpy(&folder, b + 4, 4);
    memcpy(&entries, b + folder, 2);
    for (char *p = b + folder + 2; entries-- > 0; p += 12) {
        memcpy(&one, p, 2);
        if (one == tag) {
            memcpy(p, (uint16_t[1]){(uint16_t)to}, 2);
            memcpy(p + 4, (uint32_t[2]){count, value}, 8);
        }
    }
    T_EQ_I(pvx_file_write(at("%s", name), b, n, NULL), PVX_OK);
    free(b);
}

/* Tags that no library writes this way. */
T_CASE(strange_tags_are_refused)
{
    const struct kind grey = {.photometric = 1, .samples = 1, .bits = 16, .orientation = 1};
    static const struct {
        unsigned tag, to, count, value;
        pvx_err e;
        const char *says;
    } bad[] = {{274, 291, 1, 1, PVX_EUNSUP, "GrayResponseCurve"},
               {274, 33422, 1, 1, PVX_EUNSUP, "CFAPattern"},
               {274, 50706, 1, 1, PVX_EUNSUP, "DNGVersion"},
               {274, 317, 1, 2, PVX_EUNSUP, "Predictor"},
               {274, 33629, 12, 2, PVX_EUNSUP, "has 12 pictures"},
               {258, 258, 1, 12, PVX_EUNSUP, "take 480 bytes"},
               {277, 277, 1, 3, PVX_ECORRUPT, "ByteCounts"},
               {279, 279, 1, 479, PVX_ECORRUPT, "ByteCounts"},
               {279, 1279, 1, 480, PVX_ECORRUPT, "ByteCounts"},
               {262, 1262, 1, 1, PVX_ECORRUPT, "does not say what its samples mean"},
               {262, 262, 1, 999, PVX_EUNSUP, "unknown (PhotometricInterpretation 999)"},
               {339, 339, 1, 9, PVX_ECORRUPT, "SampleFormat"},
               {273, 273, 1, 1 << 20, PVX_ECORRUPT, "damaged"},
               {256, 256, 1, 0, PVX_ECORRUPT, "no size"},
               {257, 257, 1, 13, PVX_ECORRUPT, "damaged"}};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        write_tiff("strange.tif", &grey, 1);
        retag("strange.tif", bad[i].tag, bad[i].to, bad[i].count, bad[i].value);
        T_OK(is_refused("strange.tif", bad[i].says, bad[i].e));
    }
}
/* A tile of the size of the picture, which is no multiple of 16: libtiff writes none, others do. */
T_CASE(tiles_of_any_size)
{
    const struct kind grey = {.photometric = 1, .samples = 1, .bits = 16, .orientation = 1};
    struct cap_loaded l;
    write_tiff("tile.tif", &grey, 1);
    retag("tile.tif", 278, 322, 1, W);
    retag("tile.tif", 274, 323, 1, H);
    retag("tile.tif", 273, 324, 1, 8);
    retag("tile.tif", 279, 325, 1, W * H * 2);
    T_EQ_I(cap_image_load(at("tile.tif"), &l, NULL), PVX_OK);
    T_NEAR(off(&l.img, 1, 0), 0, 1e-5);
    cap_loaded_free(&l);
}

/* A map of colours of 16 bits, or, as some write it, of 8.  A chain of pages that leads back ends. */
T_CASE(maps_and_circles)
{
    struct kind map = {.photometric = PHOTOMETRIC_PALETTE, .samples = 1, .bits = 4};
    static uint16_t red[16], green[16], blue[16];
    struct cap_loaded l;
    for (unsigned wide = 0; wide < 2; wide++) {
        for (unsigned i = 0; i < 16; i++) {
            red[i] = (uint16_t)(i * (wide ? 4369 : 17));
            green[i] = (uint16_t)(i * (wide ? 4097 : 9));
            blue[i] = (uint16_t)(i * (wide ? 257 : 1));
        }
        map.map[0] = red;
        map.map[1] = green;
        map.map[2] = blue;
        write_tiff("map.tif", &map, 1);
        T_EQ_I(cap_image_load(at("map.tif"), &l, NULL), PVX_OK);
        T_EQ_I(l.img.fmt, CAP_RGB16);
        int wrong = 0;
        for (unsigned i = 0; i < W * H && l.img.fmt == CAP_RGB16; i++) {
            unsigned v = (truth(i % W, i / W, 0, 0) * 15 + 32767) / 65535;
            const uint16_t *p = (const uint16_t *)l.img.data + (size_t)3 * i, by = wide ? 1 : 257;
            wrong += p[0] != red[v] * by || p[1] != green[v] * by || p[2] != blue[v] * by;
        }
        T_EQ_I(wrong, 0);
        cap_loaded_free(&l);
    }
    char *b;
    size_t n;
    uint32_t folder;
    uint16_t entries;
    T_EQ_I(pvx_file_read(at("map.tif"), 1 << 20, &b, &n, NULL), PVX_OK);
    memcpy(&folder, b + 4, 4);
    memcpy(&entries, b + folder, 2);
    memcpy(b + folder + 2 + 12 * entries, &folder, 4);
    T_EQ_I(pvx_file_write(at("circle.tif"), b, n, NULL), PVX_OK);
    free(b);
    T_OK(is_refused("circle.tif", "lead back", PVX_ECORRUPT));
}

int main(void)
{
    plugins_of_this_build();
    TIFFSetWarningHandler(NULL); /* of what is written here */
    scratch_new();
    t_run();
    scratch_remove();
    return t_done();
}
