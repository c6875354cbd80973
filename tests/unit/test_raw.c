/* test_raw.c - recordings of high-speed cameras: every packing with known pixels, what headers say, times, and files that are cut
 * or damaged at any byte. */
#include "tests/t.h"

#include "capture/files/reel.h"
#include "capture/files/said.h"
#include "tests/lib/raw_file.h"
#include "tests/lib/scratch.h"

#define SECOND (1ull << 32) /* of a cine's times */
#define MS     ((1ull << 32) / 1000)

static unsigned mask; /* of the samples that are written */

static unsigned noise(int k, int x, int y)
{
    uint32_t v = (uint32_t)(k * 7919 + y * 131 + x + 1) * 2654435761u;
    return (v ^ v >> 15) & mask;
}

static struct cap_raw r;
static struct pvx_diag d;

static pvx_err open_raw(const char *path)
{
    cap_raw_close(&r);
    d.text[0] = '\0';
    return cap_raw_open(path, &r, &d);
}

/* Sample of a loaded picture. */
static unsigned sample_at(const struct cap_image *img, int x, int y)
{
    const uint8_t *p = (const uint8_t *)img->data + y * img->stride;
    uint16_t v;
    if (cap_pixfmt_depth(img->fmt) == 8)
        return p[x];
    memcpy(&v, p + 2 * x, 2);
    return v;
}

static const struct cine_file plain = {.w = 9,
                                       .h = 6,
                                       .n = 3,
                                       .first = -1,
                                       .bits = 16,
                                       .version = 1,
                                       .real_bpp = 12,
                                       .rate = 1000,
                                       .trigger = 1700000000 * SECOND + 12345,
                                       .begin = 1700000000 * SECOND + 12345 - MS,
                                       .step = MS,
                                       .tag = 1002,
                                       .sample = noise};

/* The file can be opened, and its pictures are w x h of `fmt` with want(k, x, y). */
static void gives(const char *path, int w, int h, enum cap_pixfmt fmt, raw_sample *want)
{
    struct cap_image img;
    T_EQ_I(open_raw(path), PVX_OK);
    T_EQ_S(d.text, "");
    for (size_t k = 0; k < r.n; k++) {
        T_EQ_I(cap_raw_load(&r, k, &img, &d), PVX_OK);
        T_OK(img.width == w && img.height == h && img.fmt == fmt);
        int wrong = 0;
        for (int y = 0; y < h && img.width == w; y++)
            for (int x = 0; x < w; x++)
                wrong += sample_at(&img, x, y) != want((int)k, x, y);
        T_EQ_I(wrong, 0);
    }
}

static void cine_gives(const struct cine_file *c, int w, int h, enum cap_pixfmt fmt,
                       raw_sample *want)
{
    cine_save(at("a.cine"), c);
    gives(at("a.cine"), w, h, fmt, want);
}

static void refuses(const char *path, const char *part)
{
    T_OK(open_raw(path) != PVX_OK);
    T_CONTAINS(d.text, path);
    T_CONTAINS(d.text, part);
}

static void cine_refuses(const struct cine_file *c, const char *part)
{
    cine_save(at("a.cine"), c);
    refuses(at("a.cine"), part);
}

/* ---- Phantom ---- */

T_CASE(cine_packings)
{
    struct cine_file c = plain;
    mask = 0xFFF;
    cine_gives(&c, 9, 6, CAP_GREY12, noise);
    for (c.pad = 0; c.pad < 5; c.pad += 4)
        for (int odd = 0; odd < 4; odd++) { /* rows that begin inside a byte, and not */
            c.w = 9 + odd;
            c.bits = 16;
            cine_gives(&c, c.w, 6, CAP_GREY12, noise);
            c.bits = 12;
            cine_gives(&c, c.w, 6, CAP_GREY12, noise);
            c.bits = 8;
            mask = 0xFF;
            cine_gives(&c, c.w, 6, CAP_GREY8, noise);
            mask = 0xFFF;
        }
    c = plain;
    for (c.annotation = 0; c.annotation < 40; c.annotation += 17)
        cine_gives(&c, 9, 6, CAP_GREY12, noise);
    c.version = 0; /* offsets of 32 bits */
    cine_gives(&c, 9, 6, CAP_GREY12, noise);
    c.setup = 900; /* an old program */
    cine_gives(&c, 9, 6, CAP_GREY12, noise);
}

static unsigned spread_9(int k, int x, int y)
{
    return (unsigned)lround(noise(k, x, y) * 65535.0 / 511);
}

T_CASE(cine_depths)
{
    static const enum cap_pixfmt of[] = {
        [10] = CAP_GREY10, [12] = CAP_GREY12, [14] = CAP_GREY14, [16] = CAP_GREY16};
    struct cine_file c = plain;
    for (c.real_bpp = 10; c.real_bpp <= 16; c.real_bpp += 2) {
        mask = (1u << c.real_bpp) - 1;
        cine_gives(&c, 9, 6, of[c.real_bpp], noise);
        T_OK(r.said == NULL);
    }
    c.real_bpp = 9; /* no format of its own: full scale stays full scale */
    mask = 511;
    cine_gives(&c, 9, 6, CAP_GREY16, spread_9);
    c.real_bpp = 0; /* older than the field: the palette says the number of levels */
    c.levels = 4096;
    mask = 0xFFF;
    cine_gives(&c, 9, 6, CAP_GREY12, noise);
    c.levels = 0;
    cine_gives(&c, 9, 6, CAP_GREY16, noise);
    T_CONTAINS(r.said, "does not say how many of its 16 bits are used");
}

static unsigned code(int k, int x, int y)
{
    return (unsigned)(k * 512 + y * 32 + x);
}

/* The specification's table.  Its first part is a line, and the rest a power: both to a rounding. */
T_CASE(cine_ten_bits_are_not_linear)
{
    static const struct {
        unsigned code, light;
    } known[] = {{0, 2},     {1, 5},       {64, 64},     {100, 98},    {200, 204},  {500, 952},
                 {512, 998}, {1000, 3947}, {1014, 4064}, {1015, 4095}, {1023, 4095}};
    struct cine_file c = plain;
    struct cap_image img;
    unsigned light[1024];
    c.w = 32;
    c.h = 16;
    c.n = 2;
    c.bits = 10;
    c.sample = code;
    cine_save(at("a.cine"), &c);
    T_EQ_I(open_raw(at("a.cine")), PVX_OK);
    for (int k = 0; k < 2; k++) {
        T_EQ_I(cap_raw_load(&r, (size_t)k, &img, &d), PVX_OK);
        T_EQ_I(img.fmt, CAP_GREY12);
        for (int i = 0; i < 512; i++)
            light[k * 512 + i] = sample_at(&img, i % 32, i / 32);
    }
    for (size_t i = 0; i < sizeof known / sizeof known[0]; i++)
        T_EQ_I(light[known[i].code], known[i].light);
    for (int i = 1; i < 1015; i++) {
        T_OK(light[i] >= light[i - 1]);
        if (i < 150)
            T_NEAR(light[i], 65.76 + 0.939 * (i - 64) - 1.3, 1.2);
        if (i >= 160)
            T_NEAR(light[i], 64.22 + 3633.39 * pow((i + 30.2997) / 1000, 2.220804), 0.9);
    }
}

static unsigned mirrored_x(int k, int x, int y)
{
    return noise(k, 8 - x, y);
}
static unsigned mirrored_y(int k, int x, int y)
{
    return noise(k, x, 5 - y);
}
static unsigned turned(int k, int x,
                       int y) /* a quarter counterclockwise: the right column is on top */
{
    return noise(k, 8 - y, x);
}
static unsigned turned_back(int k, int x, int y)
{
    return noise(k, y, 5 - x);
}
static unsigned half_turned(int k, int x, int y)
{
    return noise(k, 8 - x, 5 - y);
}

T_CASE(cine_is_turned_as_it_says)
{
    struct cine_file c = plain;
    mask = 0xFFF;
    c.flip_h = 1;
    cine_gives(&c, 9, 6, CAP_GREY12, mirrored_x);
    c.flip_v = 1;
    cine_gives(&c, 9, 6, CAP_GREY12, half_turned);
    c.flip_h = 0;
    cine_gives(&c, 9, 6, CAP_GREY12, mirrored_y);
    c.bits = 12; /* stored from the top down: the same */
    cine_gives(&c, 9, 6, CAP_GREY12, mirrored_y);
    c.rotate = 90;
    cine_refuses(&c, "which comes first");
    c.flip_v = 0;
    cine_gives(&c, 6, 9, CAP_GREY12, turned);
    c.rotate = -90;
    cine_gives(&c, 6, 9, CAP_GREY12, turned_back);
    c.rotate = 180;
    cine_gives(&c, 9, 6, CAP_GREY12, half_turned);
    c.rotate = 45;
    cine_refuses(&c, "only quarters are read");
}

static unsigned part(int k, int x, int y)
{
    return noise(k, x + 3, y + 1);
}

T_CASE(cine_crop)
{
    struct cine_file c = plain;
    mask = 0xFFF;
    for (int packed = 0; packed < 2; packed++) {
        c = plain;
        c.bits = packed ? 12 : 16;
        memcpy(c.crop, (int[5]){1, 3, 1, 7, 4}, sizeof c.crop);
        cine_gives(&c, 5, 4, CAP_GREY12, part);
        T_CONTAINS(r.said, "5x4 pixels at (3,1) of 9x6");
        c.crop[0] = 0;
        cine_gives(&c, 9, 6, CAP_GREY12, noise);
    }
    memcpy(c.crop, (int[5]){1, 10, 10, 18, 15},
           sizeof c.crop); /* it was cropped when it was saved */
    cine_gives(&c, 9, 6, CAP_GREY12, noise);
    memcpy(c.crop, (int[5]){1, -1, 0, 4, 4}, sizeof c.crop);
    cine_refuses(&c, "outside its 9x6");
    memcpy(c.crop, (int[5]){1, 3, 1, 7, 4}, sizeof c.crop);
    c.flip_h = 1;
    cine_refuses(&c, "which comes first");
    c = plain;
    memcpy(c.acquired, (int[4]){3, 1, 5, 4}, sizeof c.acquired);
    cine_gives(&c, 5, 4, CAP_GREY12, part);
    T_CONTAINS(r.said, "text beside the picture");
    c = plain;
    c.resample[0] = 1;
    cine_gives(&c, 9, 6, CAP_GREY12, noise);
    T_CONTAINS(r.said, "comes with those it has");
}

/* The colour of a stored pixel goes with it wherever it is turned to. */
T_CASE(cine_filters)
{
    static const char *const cell[] = {[3] = "GBRG", [4] = "RGGB", [5] = "GRBG", [6] = "BGGR"};
    static const enum cap_pixfmt first[] = {CAP_BAYER_RG8, CAP_BAYER_RG10, CAP_BAYER_RG12};
    for (unsigned cfa = 3; cfa <= 6; cfa++)
        for (int how = 0; how < 8; how++)
            for (int size = 0; size < 4; size++) {
                struct cine_file c = plain;
                struct cap_image img;
                c.compression = 2;
                c.cfa = cfa;
                c.w = 8 + size % 2;
                c.h = 6 + size / 2;
                c.flip_h = how == 1 || how == 3;
                c.flip_v = how == 2 || how == 3;
                c.rotate = how == 4 ? 90 : how == 5 ? -90 : 0;
                if (how == 6)
                    memcpy(c.crop, (int[5]){1, 1, 0, 6, 4}, sizeof c.crop);
                if (how == 7)
                    memcpy(c.crop, (int[5]){1, 0, 1, 6, 4}, sizeof c.crop);
                c.sample = code;
                c.real_bpp = 16;
                cine_save(at("a.cine"), &c);
                T_EQ_I(open_raw(at("a.cine")), PVX_OK);
                T_EQ_I(cap_raw_load(&r, 0, &img, &d), PVX_OK);
                const uint8_t *colour = cap_pixfmt_bayer(img.fmt);
                T_OK(colour != NULL);
                for (int y = 0; y < img.height && colour != NULL; y++)
                    for (int x = 0; x < img.width; x++) {
                        unsigned from = sample_at(&img, x, y); /* 32 y + x of the stored one */
                        char was = cell[cfa][from / 32 % 2 * 2 + from % 2];
                        T_EQ_I("RGB"[colour[y % 2 * 2 + x % 2]], was);
                    }
            }
    struct cine_file c = plain;
    c.compression = 2;
    c.cfa = 4;
    mask = 0xFFF;
    cine_gives(&c, 9, 6, first[2], noise);
    T_OK(r.said == NULL);
    c.wb[0] = 1.5f;
    c.wb[1] = 2;
    cine_gives(&c, 9, 6, first[2], noise);
    T_CONTAINS(r.said, "red by 1.5 and blue by 2");
    c.meta_wb = 1;
    cine_gives(&c, 9, 6, first[2], noise);
    T_OK(r.said == NULL);
    c.bits = 12;
    cine_gives(&c, 9, 6, first[2], noise);
    c.cfa = 0x80000004;
    cine_refuses(&c, "CFA 0x80000004");
    c.cfa = 1;
    cine_refuses(&c, "CFA 0x1");
    c.cfa = 4;
    c.compression = 0; /* grey pictures of a colour camera, or raw ones: it has to be said */
    cine_gives(&c, 9, 6, CAP_GREY12, noise);
    T_OK(r.filter);
}

T_CASE(cine_times)
{
    struct cine_file c = plain;
    mask = 0xFFF;
    cine_save(at("a.cine"), &c);
    T_EQ_I(open_raw(at("a.cine")), PVX_OK);
    T_EQ_I(r.n, 3);
    for (int k = 0; k < 3; k++) {
        T_NEAR(r.frame[k].t_ns, (k - 1) * 1e6, 1); /* the two lowest bits of a time are signals */
        T_EQ_I(r.frame[k].number, k - 1);
    }
    c.tag = 1001; /* of all images that were recorded */
    cine_save(at("a.cine"), &c);
    T_EQ_I(open_raw(at("a.cine")), PVX_OK);
    T_NEAR(r.frame[0].t_ns, -1e6, 1);
    c.step = 0;
    cine_save(at("a.cine"), &c);
    T_EQ_I(open_raw(at("a.cine")), PVX_OK);
    T_EQ_I(r.frame[0].t_ns, -1000000);
    T_EQ_I(r.frame[2].t_ns, 1000000);
    T_CONTAINS(r.said, "they follow from their numbers and 1000 images a second");
    c.rate = 0;
    cine_refuses(&c, "neither the times of its images nor their rate");
    c = plain;
    c.step = -MS;
    cine_refuses(&c, "image 0 is not after image -1");
    c = plain;
    c.exposure[0] = 4294967;
    c.exposure[1] = 4294967;
    cine_gives(&c, 9, 6, CAP_GREY12, noise);
    T_OK(r.said == NULL);
    c.exposure[1] = 2147483;
    c.black = 64;
    c.white = 4064;
    cine_gives(&c, 9, 6, CAP_GREY12, noise);
    T_CONTAINS(r.said, "exposures go from 500 to 1000 us");
    T_CONTAINS(r.said, "--black 0.0156");
}

T_CASE(cine_what_is_not_understood)
{
    struct cine_file c = plain;
    mask = 0xFFF;
    c.compression = 1;
    cine_refuses(&c, "compressed (Compression 1)");
    c = plain;
    c.packing = 3;
    cine_refuses(&c, "biCompression 3");
    c = plain;
    c.version = 2;
    cine_refuses(&c, "version 2");
    c = plain;
    c.n = 0;
    cine_refuses(&c, "no image in it");
    c = plain;
    c.packing = 0x400; /* 16 bits that are said to be 12 */
    cine_refuses(&c, "do not belong together");
    struct raw_bytes b = cine_make(&plain);
    raw_put(b.p + 58, 24, 2);
    raw_save(at("a.cine"), b.p, b.n);
    refuses(at("a.cine"), "interpolated");
    raw_put(b.p + 58, 16, 2);
    raw_put(b.p + 48, 20000, 4);
    raw_save(at("a.cine"), b.p, b.n);
    refuses(at("a.cine"), "");
    raw_save(at("a.cine"), "not a cine, but long enough for its header.....", 47);
    refuses(at("a.cine"), "is no cine");
    free(b.p);
}

/* Whatever is missing, what is there is right. */
static void cut(const char *path, const uint8_t *bytes, size_t n, size_t images, size_t step)
{
    size_t least = images;
    for (size_t len = 0; len < n; len += step) {
        struct cap_image img;
        char count[40];
        raw_save(path, bytes, len);
        if (open_raw(path) != PVX_OK) {
            T_CONTAINS(d.text, path);
            T_EQ_I(least, images); /* the shortest that is read comes after all that are not */
            continue;
        }
        T_OK(r.n > 0 && r.n < images);
        least = least == images ? r.n : least;
        snprintf(count, sizeof count, "%zu of its %zu", images - r.n, images);
        T_CONTAINS(r.said, count);
        for (size_t k = 0; k < r.n; k++) {
            T_EQ_I(cap_raw_load(&r, k, &img, &d), PVX_OK);
            T_EQ_I(sample_at(&img, 8, 5), noise((int)k, 8, 5));
        }
    }
    T_EQ_I(least, 1);
}

T_CASE(cine_cut_at_any_byte)
{
    struct cine_file c = plain;
    c.setup = 900;
    mask = 0xFFF;
    struct raw_bytes b = cine_make(&c);
    cut(at("a.cine"), b.p, b.n, 3, 1);
    raw_put(b.p + RAW_FIRST_AT + 900 + 8 + 24 + 8, 0, 8); /* the second was not saved */
    raw_save(at("a.cine"), b.p, b.n);
    T_EQ_I(open_raw(at("a.cine")), PVX_OK);
    T_EQ_I(r.n, 2);
    T_EQ_I(r.frame[1].number, 1);
    T_NEAR(r.frame[1].t_ns, 1e6, 1);
    T_CONTAINS(r.said, "1 of its 3 images are not whole");
    free(b.p);
}

/* ---- Photron ---- */

static const char head[] =
    "#Camera Information Header\r\nDate : 2026/1/2\r\nRecord Rate(fps) : 2000\r\n"
    "Image Width : 9\r\nImage Height : 6\r\nFile Format : MRaw\r\n";

__attribute__((format(printf, 2, 3))) static void write_text(const char *path, const char *fmt, ...)
{
    char text[4000];
    va_list ap;
    va_start(ap, fmt);
    int n = vsnprintf(text, sizeof text, fmt, ap);
    va_end(ap);
    raw_save(path, text, (size_t)n);
}

/* A header for three frames. */
static void cih(int bits, int depth, const char *side, const char *type, const char *more)
{
    write_text(
        at("b.cih"),
        "%sTotal Frame : 3\r\nStart Frame : -1\r\nColor Type :%s\r\nColor Bit : %d\r\n"
        "EffectiveBit Depth : %d\r\nEffectiveBit Side : %s\r\n%s\r\nEND\r\nColor Bit : 1\r\n",
        head, type, bits, depth, side, more);
}

static unsigned upper(int k, int x, int y)
{
    return noise(k, x, y) << 4;
}

T_CASE(mraw_packings)
{
    mask = 0xFF;
    mraw_save(at("b.mraw"), noise, 9, 6, 3, 8);
    cih(8, 12, "Lower", "Mono", ""); /* 8 of the sensor's 12 bits were saved */
    gives(at("b.mraw"), 9, 6, CAP_GREY8, noise);
    mask = 0xFFF;
    mraw_save(at("b.mraw"), noise, 9, 6, 3, 12);
    cih(12, 12, "Lower", "Mono", "");
    gives(at("b.mraw"), 9, 6, CAP_GREY12, noise);
    mraw_save(at("b.mraw"), noise, 9, 6, 3, 16);
    cih(16, 12, "Lower", "Mono", "");
    gives(at("b.mraw"), 9, 6, CAP_GREY12, noise);
    mraw_save(at("b.mraw"), upper, 9, 6, 3, 16);
    cih(16, 12, "Higher", "Mono", "");
    gives(at("b.mraw"), 9, 6, CAP_GREY12, noise);
    mask = 0x3FF;
    mraw_save(at("b.mraw"), noise, 9, 6, 3, 16);
    cih(16, 10, "lower", "Mono", "");
    gives(at("b.cih"), 9, 6, CAP_GREY10, noise); /* the header stands for its film */
    mask = 0xFFFF;
    mraw_save(at("b.mraw"), noise, 9, 6, 3, 16);
    cih(16, 16, "", "Mono", "");
    gives(at("b.mraw"), 9, 6, CAP_GREY16, noise);
    cih(16, 16, "", "Bayer", "Bayer Pattern : grbg");
    gives(at("b.mraw"), 9, 6, CAP_BAYER_GR16, noise);
    for (int k = 0; k < 2; k++) { /* a colour camera's one sample a pixel is raw */
        cih(16, 16, "", k == 0 ? "Bayer" : "Color", "Shutter Speed(s) : 1/8000");
        gives(at("b.mraw"), 9, 6, CAP_GREY16, noise);
        T_OK(r.filter);
        T_NEAR(r.exposure_s[0], 1.0 / 8000, 1e-12);
    }
}

T_CASE(mraw_times)
{
    mask = 0xFFFF;
    mraw_save(at("b.mraw"), noise, 9, 6, 3, 16);
    cih(16, 16, "", "Mono", "Save Step : 36\r\nZero Frame : Exist\r\nCorrect Trigger Frame : 0");
    gives(at("b.mraw"), 9, 6, CAP_GREY16, noise);
    T_EQ_I(r.frame[0].t_ns, -500000);
    T_EQ_I(r.frame[2].t_ns, (-1 + 2 * 36) * 500000);
    T_EQ_I(r.frame[2].number, 71);
    T_CONTAINS(r.said, "every 36th");
    cih(16, 16, "", "Mono", "Correct Trigger Frame : 1\r\nZero Frame : None");
    gives(at("b.mraw"), 9, 6, CAP_GREY16, noise);
    T_CONTAINS(r.said, "corrected its trigger by 1");
    T_CONTAINS(r.said, "without a zero");
}

T_CASE(mraw_what_is_not_understood)
{
    static const struct {
        int bits, depth;
        const char *side, *type, *more, *says;
    } bad[] = {{10, 10, "Lower", "Mono", "", "Color Bit is 10"},
               {16, 12, "Middle", "Mono", "", "neither Lower nor Higher"},
               {48, 12, "Lower", "Color", "", "interpolated"},
               {24, 8, "Lower", "Color", "", "interpolated"},
               {16, 12, "Lower", "Polarized", "", "Mono and Bayer"},
               {16, 12, "Lower", "Bayer", "Bayer Pattern : RGRG", "no Bayer pattern"},
               {16, 12, "Lower", "Mono", "Pre LUT Gamma : 2.2", "processed"},
               {16, 12, "Lower", "Mono", "Pre LUT PosiNega : Nega", "processed"},
               {16, 7, "Lower", "Mono", "", "is 7"},
               {16, 12, "Lower", "Mono", "Save Step : 1.5", "not a whole number"},
               {8, 8, "Lower", "Mono", "", "does not belong to it"}};
    mask = 0xFFF;
    mraw_save(at("b.mraw"), noise, 9, 6, 3, 16);
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        cih(bad[i].bits, bad[i].depth, bad[i].side, bad[i].type, bad[i].more);
        T_OK(open_raw(at("b.mraw")) != PVX_OK);
        T_CONTAINS(d.text, at("b."));
        T_CONTAINS(d.text, bad[i].says);
    }
    write_text(at("b.cih"), "%sColor Bit : 16\nColor Type : Mono\nTotal Frame : many\n", head);
    T_OK(open_raw(at("b.mraw")) != PVX_OK);
    T_CONTAINS(d.text, "Total Frame is \"many\"");
    write_text(at("b.cih"), "%sColor Bit : 16\nColor Type : Mono\n", head);
    T_OK(open_raw(at("b.mraw")) != PVX_OK);
    T_CONTAINS(d.text, "does not say Total Frame");
    write_text(at("b.cih"), "File Format : TIFF\n");
    T_OK(open_raw(at("b.mraw")) != PVX_OK);
    T_CONTAINS(d.text, "saved as TIFF");
    write_text(at("b.cihx"), "<cih></cih>");
    refuses(at("b.mraw"), "move the other away");
    unlink(at("b.cih"));
    T_OK(open_raw(at("b.mraw")) != PVX_OK);
    T_CONTAINS(d.text, "does not say imageDataInfo/resolution/width");
    unlink(at("b.cihx"));
    refuses(at("b.mraw"), "without the .cih or .cihx");
}

/* As XML, behind bytes of another kind. */
static const char xml[] =
    "Not XML %c <cih><imageFileInfo><fileFormat>Mraw</fileFormat><resolution><width>1</width>"
    "</resolution></imageFileInfo>\n<imageDataInfo>\n<resolution><width> 9 "
    "</width><height>6</height>"
    "</resolution><colorInfo><type>Mono</type><bit>%d</bit></colorInfo><effectiveBit><depth>12"
    "</depth><side>Lower</side></effectiveBit><applyImageProc>%d</applyImageProc></imageDataInfo>"
    "<frameInfo><totalFrame>3</totalFrame><startFrame>-2</startFrame><skipFrame>1</skipFrame>"
    "</frameInfo><basicInfo><comment></comment></basicInfo><recordInfo><recordRate>50000"
    "</recordRate></recordInfo></cih>";

T_CASE(mraw_cihx)
{
    mask = 0xFFF;
    mraw_save(at("x.mraw"), noise, 9, 6, 3, 12);
    write_text(at("x.cihx"), xml, 1, 12, 0);
    gives(at("x.mraw"), 9, 6, CAP_GREY12, noise);
    gives(at("x.cihx"), 9, 6, CAP_GREY12, noise);
    T_EQ_I(r.frame[0].t_ns, -40000);
    T_EQ_I(r.frame[2].t_ns, 0);
    T_OK(r.said == NULL);
    write_text(at("x.cihx"), xml, 1, 12, 1);
    T_OK(open_raw(at("x.mraw")) != PVX_OK);
    T_CONTAINS(d.text, "applyImageProc");
    char text[sizeof xml];
    int all = snprintf(text, sizeof text, xml, 1, 12, 0);
    for (size_t n = (size_t)all; n > 0; n--) { /* a header that is cut is never taken */
        raw_save(at("x.cihx"), text, n - 1);
        T_OK(open_raw(at("x.mraw")) != PVX_OK);
        T_CONTAINS(d.text, at("x."));
    }
}

T_CASE(mraw_cut_at_any_byte)
{
    struct raw_bytes b = {0};
    mask = 0xFFF;
    for (int k = 0; k < 3; k++)
        raw_image(&b, noise, k, &(struct raw_layout){9, 6, 12, 1, false});
    cih(12, 12, "Lower", "Mono", "");
    cut(at("b.mraw"), b.p, b.n, 3, 1);
    raw_more(&b, 81);
    raw_save(at("b.mraw"), b.p, b.n); /* a frame more than the header says: it is another's */
    T_OK(open_raw(at("b.mraw")) != PVX_OK);
    free(b.p);
}

/* ---- as the frames of cameras ---- */

T_CASE(a_reel_of_one)
{
    struct cap_reel reel;
    struct cap_loaded l;
    char *path, room[CAP_REEL_NAME];
    struct cine_file c = plain;
    mask = 0xFFF;
    mkdir(at("rec"), 0777);
    mkdir(at("rec/cam1"), 0777);
    cine_save(at("rec/cam0.cine"), &c);
    mraw_save(at("rec/cam1/shot.MRAW"), noise, 9, 6, 3, 16);
    write_text(at("rec/cam1/shot.CIH"),
               "%sTotal Frame : 4\nStart Frame : -1\nColor Type : Mono\nColor Bit : 16\n"
               "EffectiveBit Depth : 12\nEffectiveBit Side : Lower\n",
               head);
    T_EQ_I(cap_reel_of(at("rec"), "cam0", &path, &d), PVX_OK);
    T_EQ_S(path, at("rec/cam0.cine"));
    T_EQ_I(cap_reel_open(path, &reel, &d), PVX_OK);
    free(path);
    T_OK(reel.kind == CAP_REEL_RAW && reel.n == 3 && cap_reel_timed(&reel));
    T_NEAR(cap_reel_step(&reel), 1e6, 1);
    T_CONTAINS(cap_reel_name(&reel, 0, room), "cam0.cine: image -1 at -0.001000 s");
    T_EQ_I(cap_reel_load(&reel, 2, &l, &d), PVX_OK);
    T_OK(l.mem == NULL && sample_at(&l.img, 3, 2) == noise(2, 3, 2));
    T_EQ_I(cap_reel_load(&reel, 0, &l, &d), PVX_OK);
    T_OK(sample_at(&l.img, 3, 2) == noise(0, 3, 2));
    cap_reel_close(&reel);
    T_EQ_I(cap_reel_of(at("rec"), "cam1", &path, &d), PVX_OK);
    T_EQ_I(cap_reel_open(path, &reel, &d), PVX_OK);
    free(path);
    T_OK(reel.kind == CAP_REEL_RAW && reel.n == 3);
    T_CONTAINS(reel.said, "1 of its 4 frames are not whole");
    cap_reel_close(&reel);
    cine_save(at("rec/cam1/other.cine"), &c);
    d.text[0] = '\0';
    T_OK(cap_reel_open(at("rec/cam1"), &reel, &d) == PVX_EINVAL);
    T_CONTAINS(d.text, "one camera has one of them");
    cap_reel_close(&reel);
}

/* Files of cameras, which may not be shipped. */
static const char *real(const char *name)
{
    static char path[1024];
    const char *root = getenv("PYROVOX_DATA");
    snprintf(path, sizeof path, "%s/highspeed/%s",
             root != NULL && *root != '\0' ? root : "../shared/data", name);
    return path;
}

T_CASE(real_cine)
{
    struct cap_image img;
    char line[1200];
    if (access(real("phantom.cine"), R_OK) != 0)
        T_SKIP("shared/data is not here");
    T_EQ_I(open_raw(real("phantom.cine")), PVX_OK);
    T_OK(r.n == 15 && r.width == 256 && r.height == 256 && r.fmt == CAP_GREY12);
    T_EQ_I(r.frame[0].number, -5417);
    T_NEAR(r.frame[0].t_ns, -601672714.576, 1);
    T_NEAR(r.frame[14].t_ns - r.frame[0].t_ns, 14 * 111071.2, 100);
    T_CONTAINS(r.said, "black is 64 and white 4064 of 4095");
    T_NEAR(r.exposure_s[0], 9.6965e-6, 1e-9);
    /* FFmpeg's own demuxer: the same pictures, spread over 16 bits */
    snprintf(line, sizeof line, "ffmpeg -v error -i %s -f rawvideo -pix_fmt gray16le -", r.path);
    FILE *f = popen(line, "r");
    if (f == NULL)
        T_SKIP("there is no ffmpeg");
    for (size_t k = 0; k < r.n; k++) {
        static uint16_t want[256 * 256];
        T_EQ_I(fread(want, 1, sizeof want, f), sizeof want);
        T_EQ_I(cap_raw_load(&r, k, &img, &d), PVX_OK);
        int wrong = 0;
        for (int i = 0; i < 256 * 256; i++) {
            unsigned v = sample_at(&img, i % 256, i / 256);
            wrong += (v << 4 | v >> 8) != want[i];
        }
        T_EQ_I(wrong, 0);
    }
    pclose(f);
}

T_CASE(real_mraw)
{
    struct cap_image img;
    static uint16_t want[1024 * 80];
    if (access(real("beam.mraw"), R_OK) != 0)
        T_SKIP("shared/data is not here");
    T_EQ_I(open_raw(real("beam.mraw")), PVX_OK);
    T_OK(r.n == 4 && r.width == 1024 && r.height == 80 && r.fmt == CAP_GREY12);
    T_EQ_I(r.frame[0].t_ns, 0);
    T_EQ_I(r.frame[1].t_ns, 2500 * 20000);
    T_CONTAINS(r.said, "every 2500th of 50000 frames");
    T_NEAR(r.exposure_s[1], 5e-6, 1e-12);
    FILE *f = fopen(r.path, "rb");
    for (size_t k = 0; k < 4; k++) {
        T_EQ_I(fread(want, 1, sizeof want, f), sizeof want);
        T_EQ_I(cap_raw_load(&r, k, &img, &d), PVX_OK);
        T_OK(memcmp(img.data, want, sizeof want) == 0);
    }
    fclose(f);
}

static void begin(void)
{
    scratch_new();
}
static void end(void)
{
    cap_raw_close(&r);
    scratch_remove();
}
T_MAIN(begin(), end())
