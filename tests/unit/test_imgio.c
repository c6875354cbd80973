/* test_imgio.c - images and arrays in files. */
#include "../t.h"

#include <png.h>
#include <sys/stat.h>
#include <turbojpeg.h>
#include <unistd.h>

#include "base/file.h"
#include "capture/files/imgio.h"
#include "tests/lib/plugins.h"
#include "tests/lib/scratch.h"

T_CASE(npy_round_trip)
{
    float v[24], *back;
    for (int i = 0; i < 24; i++)
        v[i] = (float)i / 7;
    size_t shape[4] = {2, 3, 4, 1}, got[4];
    int ndim;
    struct pvx_diag d = {""};
    T_EQ_I(cap_npy_save(at("a.npy"), v, shape, 3, &d), PVX_OK);
    T_EQ_I(cap_npy_load(at("a.npy"), &back, got, &ndim, &d), PVX_OK);
    T_EQ_I(ndim, 3);
    T_EQ_I(got[0] * 100 + got[1] * 10 + got[2], 234);
    T_EQ_I(memcmp(back, v, sizeof v), 0);
    free(back);
    char *bytes;
    size_t len;
    T_EQ_I(pvx_file_read(at("a.npy"), 1 << 20, &bytes, &len, &d), PVX_OK);
    T_EQ_I((len - sizeof v) % 64, 0); /* data are aligned as NumPy asks */
    T_OK(memmem(bytes, len, "'shape': (2, 3, 4), }", 21) != NULL); /* three for every reader */
    free(bytes);
}

/* A .npy of the given dictionary and data bytes. */
static size_t build(char *out, const char *dict, const void *data, size_t n)
{
    size_t h = strlen(dict);
    memcpy(out, "\x93NUMPY\x01\x00", 8);
    out[8] = (char)h;
    out[9] = 0;
    memcpy(out + 10, dict, h);
    memcpy(out + 10 + h, data, n);
    return 10 + h + n;
}

T_CASE(npy_types)
{
    char b[512];
    float *v;
    size_t shape[4];
    int ndim;
    struct pvx_diag d = {""};
    const uint16_t half[6] = {0x3c00, 0xc000, 0x0001, 0x7bff, 0xfc00, 0x3555};
    size_t n = build(b, "{'descr': '<f2', 'fortran_order': False, 'shape': (6,), }", half, 12);
    T_EQ_I(cap_npy_parse(b, n, "x", &v, shape, &ndim, &d), PVX_OK);
    T_NEAR(v[0], 1, 0);
    T_NEAR(v[1], -2, 0);
    T_NEAR(v[2], 0x1p-24, 0);
    T_NEAR(v[3], 65504, 0);
    T_OK(isinf(v[4]) && v[4] < 0);
    T_NEAR(v[5], 0.333251953125, 0);
    free(v);
    const double f8[2] = {0.1, 1e300};
    n = build(b, "{\"shape\": (2,), 'descr': '<f8', 'fortran_order': True}  \n", f8, 16);
    T_EQ_I(cap_npy_parse(b, n, "x", &v, shape, &ndim, &d), PVX_OK); /* one dimension has no order */
    T_OK(v[0] == 0.1f && isinf(v[1]));
    free(v);
    n = build(b, "{'descr': '|u1', 'fortran_order': False, 'shape': (1, 2)}", "\x07\xff", 2);
    T_EQ_I(cap_npy_parse(b, n, "x", &v, shape, &ndim, &d), PVX_OK);
    T_OK(v[0] == 7 && v[1] == 255 && shape[1] == 2);
    free(v);
}

T_CASE(npy_refusals)
{
    static const struct {
        const char *dict, *says;
        pvx_err e;
    } bad[] = {
        {"{'descr': '>f4', 'fortran_order': False, 'shape': (2,)}", ">f4", PVX_EUNSUP},
        {"{'descr': '<i4', 'fortran_order': False, 'shape': (2,)}", "<i4", PVX_EUNSUP},
        {"{'descr': '<f4', 'fortran_order': True, 'shape': (2, 1)}", "Fortran", PVX_EUNSUP},
        {"{'descr': '<f4', 'fortran_order': False, 'shape': (3,)}", "need 12 bytes", PVX_EFORMAT},
        {"{'descr': '<f4', 'fortran_order': False, 'shape': (1,)}", "file has 8", PVX_EFORMAT},
        {"{'descr': '<f4', 'fortran_order': False, 'shape': (0,)}", "empty", PVX_EFORMAT},
        {"{'descr': '<f4', 'fortran_order': False, 'shape': ()}", "0 dimensions", PVX_EUNSUP},
        {"{'descr': '<f4', 'fortran_order': False, 'shape': (1,1,1,1,2)}", "5 dim", PVX_EUNSUP},
        {"{'descr': '<f4', 'fortran_order': False}", "malformed", PVX_EFORMAT},
        {"{'descr': '<f4', 'descr': '<f4', 'fortran_order': False, 'shape': (2,)}", "malformed",
         PVX_EFORMAT},
        {"{'descr': '<f4', 'fortran_order': False, 'shape': (2,)} x", "malformed", PVX_EFORMAT},
        {"{'descr': '<f8', 'fortran_order': False, 'shape': (4294967296, 4294967296)}",
         "does not fit", PVX_EFORMAT},
        {"{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999999999999,)}", "malformed",
         PVX_EFORMAT},
    };
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++) {
        char b[512];
        float *v, two[2] = {1, 2};
        size_t shape[4], n = build(b, bad[i].dict, two, 8);
        int ndim;
        struct pvx_diag d = {""};
        T_EQ_I(cap_npy_parse(b, n, "vol.npy", &v, shape, &ndim, &d), bad[i].e);
        T_OK(v == NULL);
        T_CONTAINS(d.text, "vol.npy: ");
        T_CONTAINS(d.text, bad[i].says);
    }
}

T_CASE(npy_images_keep_their_depth)
{
    struct cap_loaded l;
    struct pvx_diag d = {""};
    char b[512];
    const uint16_t u2[4] = {1, 2, 3, 65535};
    size_t n = build(b, "{'descr': '<u2', 'fortran_order': False, 'shape': (2, 2)}", u2, 8);
    T_EQ_I(pvx_file_write(at("u2.npy"), b, n, &d), PVX_OK);
    T_EQ_I(cap_image_load(at("u2.npy"), &l, &d), PVX_OK);
    T_EQ_I(l.img.fmt, CAP_GREY16);
    T_EQ_I(memcmp(l.img.data, u2, 8), 0);
    cap_loaded_free(&l);
    float pix[2 * 3 * 3] = {0.5f, -1, 7};
    T_EQ_I(cap_image_save(at("f.npy"), pix, 3, 2, 3, &d), PVX_OK);
    T_EQ_I(cap_image_load(at("f.npy"), &l, &d), PVX_OK);
    T_EQ_I(l.img.fmt, CAP_RGB_F32);
    T_EQ_I(l.img.width * 10 + l.img.height, 32);
    T_EQ_I(memcmp(l.img.data, pix, sizeof pix), 0); /* unclipped */
    cap_loaded_free(&l);
    T_EQ_I(cap_npy_save(at("v.npy"), pix, (size_t[3]){3, 3, 2}, 3, &d), PVX_OK);
    T_EQ_I(cap_image_load(at("v.npy"), &l, &d), PVX_EFORMAT);
    T_CONTAINS(d.text, "[h][w]");
}

T_CASE(png_round_trip)
{
    enum { W = 5, H = 3 };
    float pix[W * H * 3];
    for (int i = 0; i < W * H * 3; i++)
        pix[i] = (float)(i * 5) / 255;
    pix[0] = -3;
    pix[1] = 9;
    pix[2] = NAN;
    struct pvx_diag d = {""};
    struct cap_loaded l;
    T_EQ_I(cap_image_save(at("a.png"), pix, W, H, 3, &d), PVX_OK);
    T_EQ_S(d.text, "");
    T_EQ_I(cap_image_load(at("a.png"), &l, &d), PVX_OK);
    if (l.img.data == NULL)
        return;
    T_EQ_I(l.img.fmt, CAP_RGB8);
    T_EQ_I(l.img.width * 10 + l.img.height, W * 10 + H);
    const uint8_t *px = l.img.data;
    T_EQ_I(px[0], 0);
    T_EQ_I(px[1], 255);
    T_EQ_I(px[2], 0);
    for (int i = 3; i < W * H * 3; i++)
        T_EQ_I(px[i], i * 5); /* red first, as written */
    cap_loaded_free(&l);
    for (int i = 0; i < W * H; i++)
        pix[i] = 0.25f;
    T_EQ_I(cap_image_save(at("g.png"), pix, W, H, 1, &d), PVX_OK);
    T_EQ_I(cap_image_load(at("g.png"), &l, &d), PVX_OK);
    T_EQ_I(l.img.fmt, CAP_GREY8);
    T_EQ_I(((const uint8_t *)l.img.data)[7], 64);
    cap_loaded_free(&l);
}

/* A 1x1 RGBA 8-bit and a 2x1 grey 16-bit PNG, as bytes. */
T_CASE(png_alpha_and_16_bit)
{
    static const uint8_t rgba[] = {
        0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a, 0x00, 0x00, 0x00, 0x0d, 0x49, 0x48,
        0x44, 0x52, 0x00, 0x00, 0x00, 0x01, 0x00, 0x00, 0x00, 0x01, 0x08, 0x06, 0x00, 0x00,
        0x00, 0x1f, 0x15, 0xc4, 0x89, 0x00, 0x00, 0x00, 0x0d, 0x49, 0x44, 0x41, 0x54, 0x78,
        0xda, 0x63, 0xe0, 0x12, 0x91, 0xd3, 0x00, 0x00, 0x00, 0xcd, 0x00, 0x65, 0xb5, 0xc7,
        0x96, 0x52, 0x00, 0x00, 0x00, 0x00, 0x49, 0x45, 0x4e, 0x44, 0xae, 0x42, 0x60, 0x82};
    static const uint8_t grey16[] = {
        0x89, 0x50, 0x4e, 0x47, 0x0d, 0x0a, 0x1a, 0x0a, 0x00, 0x00, 0x00, 0x0d, 0x49, 0x48,
        0x44, 0x52, 0x00, 0x00, 0x00, 0x02, 0x00, 0x00, 0x00, 0x01, 0x10, 0x00, 0x00, 0x00,
        0x00, 0x81, 0xd9, 0xfc, 0x15, 0x00, 0x00, 0x00, 0x0d, 0x49, 0x44, 0x41, 0x54, 0x78,
        0xda, 0x63, 0x10, 0x32, 0xf9, 0xff, 0x1f, 0x00, 0x03, 0xe6, 0x02, 0x45, 0xf1, 0x1c,
        0x84, 0x65, 0x00, 0x00, 0x00, 0x00, 0x49, 0x45, 0x4e, 0x44, 0xae, 0x42, 0x60, 0x82};
    struct pvx_diag d = {""};
    struct cap_loaded l;
    T_EQ_I(pvx_file_write(at("rgba.png"), rgba, sizeof rgba, &d), PVX_OK);
    T_EQ_I(cap_image_load(at("rgba.png"), &l, &d), PVX_OK);
    T_EQ_S(d.text, "");
    if (l.img.data != NULL) {
        T_EQ_I(l.img.fmt, CAP_RGB8);
        const uint8_t *p = l.img.data;
        T_EQ_I(p[0] * 1000000 + p[1] * 1000 + p[2], 10020030);
    }
    cap_loaded_free(&l);
    T_EQ_I(pvx_file_write(at("g16.png"), grey16, sizeof grey16, &d), PVX_OK);
    T_EQ_I(cap_image_load(at("g16.png"), &l, &d), PVX_OK);
    T_EQ_S(d.text, "");
    if (l.img.data != NULL) {
        T_EQ_I(l.img.fmt, CAP_GREY16);
        uint16_t v[2];
        memcpy(v, l.img.data, 4);
        T_EQ_I(v[0], 0x1234);
        T_EQ_I(v[1], 65535);
    }
    cap_loaded_free(&l);
}

/* A JPEG is gamma-coded and says so; other pictures are linear. */
T_CASE(jpeg_files_are_coded)
{
    struct pvx_diag d = {""};
    struct cap_loaded l;
    unsigned char px[16 * 16], *coded = NULL;
    unsigned long n = 0;
    memset(px, 100, sizeof px);
    tjhandle tj = tjInitCompress();
    T_EQ_I(tjCompress2(tj, px, 16, 0, 16, TJPF_GRAY, &coded, &n, TJSAMP_GRAY, 95, 0), 0);
    tjDestroy(tj);
    T_EQ_I(pvx_file_write(at("a.jpg"), coded, n, &d), PVX_OK);
    tjFree(coded);
    T_EQ_I(cap_image_load(at("a.jpg"), &l, &d), PVX_OK);
    T_EQ_I(l.img.yuv, CAP_YUV_CODED);
    if (l.img.data != NULL)
        T_NEAR(((const uint8_t *)l.img.data)[0], 100, 1);
    cap_loaded_free(&l);
    T_EQ_I(cap_image_save(at("a.png"), (float[3]){0}, 1, 1, 3, &d), PVX_OK);
    T_EQ_I(cap_image_load(at("a.png"), &l, &d), PVX_OK);
    T_EQ_I(l.img.yuv, 0);
    cap_loaded_free(&l);
}

/* A small picture of a kind of its own, in colour. */
static unsigned char *coded(int sampling, int flags, unsigned long *n)
{
    unsigned char px[48 * 32 * 3], *out = NULL;
    for (int i = 0; i < 48 * 32 * 3; i++)
        px[i] = (unsigned char)(i * 7 + i / 97);
    tjhandle tj = tjInitCompress();
    T_EQ_I(tjCompress2(tj, px, 48, 0, 32, TJPF_RGB, &out, n, sampling, 90, flags), 0);
    tjDestroy(tj);
    return out;
}

/* Progressive ones are read, too, to the same pixels; a cut one is refused wherever the cut is. */
T_CASE(jpeg_files_are_whole)
{
    struct pvx_diag d = {""};
    struct cap_loaded l, p;
    unsigned long n, np;
    unsigned char *a = coded(TJSAMP_420, 0, &n), *b = coded(TJSAMP_420, TJFLAG_PROGRESSIVE, &np);
    T_EQ_I(pvx_file_write(at("a.jpg"), a, n, &d), PVX_OK);
    T_EQ_I(pvx_file_write(at("p.jpg"), b, np, &d), PVX_OK);
    T_EQ_I(cap_image_load(at("a.jpg"), &l, &d), PVX_OK);
    T_EQ_I(cap_image_load(at("p.jpg"), &p, &d), PVX_OK);
    T_EQ_S(d.text, "");
    T_OK(l.img.fmt == CAP_RGB8 && l.img.width == 48 && l.img.height == 32);
    T_OK(l.img.size == p.img.size && memcmp(l.img.data, p.img.data, l.img.size) == 0);
    cap_loaded_free(&l);
    cap_loaded_free(&p);
    int taken = 0;
    for (unsigned long cut = 0; cut < n - 2; cut += cut < n / 2 ? 13 : 1) {
        d.text[0] = '\0';
        FILE *f = fopen(at("cut.jpg"), "wb");
        T_OK(fwrite(a, 1, cut, f) == cut);
        fclose(f);
        taken += cap_image_load(at("cut.jpg"), &l, &d) == PVX_OK;
        cap_loaded_free(&l);
    }
    T_EQ_I(taken, 0);
    T_CONTAINS(d.text, "cut.jpg: ");
    tjFree(a);
    tjFree(b);
}

/* Says so, names the file, and leaves nothing. */
static bool is_refused(const char *name, const char *says)
{
    struct pvx_diag d = {""};
    struct cap_loaded l;
    pvx_err e = cap_image_load(at("%s", name), &l, &d);
    bool good = e != PVX_OK && l.mem == NULL && strstr(d.text, name) != NULL &&
                strstr(d.text, says) != NULL;
    if (!good)
        printf("  %d instead of \"%s\": %s\n", (int)e, says, d.text);
    cap_loaded_free(&l);
    return good;
}

/* EXIF data of one tag, which asks to turn the picture: TIFF in Intel's or Motorola's order. */
static size_t exif_of(bool motorola, unsigned char orientation, unsigned char out[26])
{
    static const unsigned char intel[26] = "II*\0\x08\0\0\0\1\0\x12\1\3\0\1\0\0\0";
    static const unsigned char big[26] = "MM\0*\0\0\0\x08\0\1\1\x12\0\3\0\0\0\1";
    memcpy(out, motorola ? big : intel, 26);
    out[motorola ? 19 : 18] = orientation;
    return 26;
}

/* The segment behind the first marker of a JPEG. */
static void write_jpeg(const char *name, const unsigned char *jpeg, size_t n, size_t leave_out,
                       const char *segment, size_t size)
{
    char *b = malloc(n + size);
    memcpy(b, jpeg, 2);
    memcpy(b + 2, segment, size);
    memcpy(b + 2 + size, jpeg + 2 + leave_out, n - 2 - leave_out);
    T_EQ_I(pvx_file_write(at("%s", name), b, n + size - leave_out, NULL), PVX_OK);
    free(b);
}

/* K of a rig holds for a picture as it is stored or as it is turned, never for both. */
T_CASE(turned_jpegs_are_refused)
{
    struct cap_loaded l;
    unsigned long n;
    unsigned char *a = coded(TJSAMP_420, 0, &n);
    char app1[36] = "\xFF\xE1\0\x22"
                    "Exif\0";
    for (int k = 0; k < 2; k++)
        for (unsigned char o = 0; o <= 9; o++) {
            exif_of(k, o, (unsigned char *)app1 + 10);
            write_jpeg("turned.jpg", a, n, 0, app1, sizeof app1);
            if (o > 1)
                T_OK(is_refused("turned.jpg", "orientation tag"));
            else
                T_EQ_I(cap_image_load(at("turned.jpg"), &l, NULL), PVX_OK);
            if (o <= 1)
                cap_loaded_free(&l);
        }
    tjFree(a);
}

/* Three components are luma and chroma, or red, green and blue where Adobe's segment says so.  Four are inks. */
T_CASE(jpeg_colours)
{
    struct cap_loaded l;
    unsigned long n;
    unsigned char *a = coded(TJSAMP_444, 0, &n), inks[16 * 16 * 4] = {0}, *c = NULL;
    static unsigned char yuv[48 * 32 * 3];
    write_jpeg("rgb.jpg", a, n, 18,
               "\xFF\xEE\0\x0E"
               "Adobe\0\x64\0\0\0\0\0",
               16);
    T_EQ_I(cap_image_load(at("rgb.jpg"), &l, NULL), PVX_OK);
    tjhandle tj = tjInitDecompress();
    T_EQ_I(tjDecompressToYUV2(tj, a, n, yuv, 48, 1, 32, TJFLAG_ACCURATEDCT), 0);
    tjDestroy(tj);
    int other = 0;
    for (int i = 0; i < 48 * 32 * 3 && l.img.data != NULL; i++)
        other += ((const uint8_t *)l.img.data)[i] != yuv[i % 3 * 48 * 32 + i / 3];
    T_EQ_I(other, 0);
    cap_loaded_free(&l);
    tj = tjInitCompress();
    T_EQ_I(tjCompress2(tj, inks, 16, 0, 16, TJPF_CMYK, &c, &n, TJSAMP_444, 90, 0), 0);
    tjDestroy(tj);
    write_jpeg("inks.jpg", c, n, 0, "", 0);
    T_OK(is_refused("inks.jpg", "4 components"));
    tjFree(a);
    tjFree(c);
}

struct png_kind {
    int colour, depth, interlace;
    const char *chunk; /* one more */
    const unsigned char *data;
    size_t size;
};

/* Sample i of row y, all that the depth can say. */
static unsigned png_truth(const struct png_kind *k, unsigned i, unsigned y)
{
    return (i * 2731 + y * 997) & ((1U << k->depth) - 1);
}

static void write_png(const char *name, const struct png_kind *k, int colours)
{
    enum { W = 13, H = 9 };
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png_create_info_struct(png);
    FILE *f = fopen(at("%s", name), "wb");
    png_color map[256];
    static unsigned char rows[H][W * 8];
    png_bytep row[H];
    unsigned each = k->colour == 2 ? 3 : k->colour == 4 ? 2 : k->colour == 6 ? 4 : 1;
    memset(rows, 0, sizeof rows);
    for (unsigned y = 0; y < H; y++) {
        row[y] = rows[y];
        for (unsigned i = 0; i < W * each; i++)
            for (unsigned b = 0; b < (unsigned)k->depth; b++)
                if (png_truth(k, i, y) >> ((unsigned)k->depth - 1 - b) & 1)
                    rows[y][(i * (unsigned)k->depth + b) / 8] |=
                        (unsigned char)(0x80 >> (i * (unsigned)k->depth + b) % 8);
    }
    for (unsigned i = 0; i < 256; i++)
        map[i] = (png_color){(png_byte)i, (png_byte)(255 - i), (png_byte)(i ^ 77)};
    png_init_io(png, f);
    png_set_IHDR(png, info, W, H, k->depth, k->colour, k->interlace, 0, 0);
    if (k->colour == 3) {
        png_set_PLTE(png, info, map, colours);
        png_set_tRNS(png, info, rows[0], 2, NULL);
    } else if (k->colour < 3) {
        png_set_tRNS(png, info, NULL, 0, &(png_color_16){.gray = 1, .red = 1});
    }
    png_set_gAMA(png, info, 1 / 2.2);
    png_write_info(png, info);
    if (k->chunk != NULL)
        png_write_chunk(png, (png_const_bytep)k->chunk, k->data, k->size);
    png_set_interlace_handling(png);
    png_set_benign_errors(png, 1);
    png_write_image(png, row);
    png_write_end(png, NULL);
    png_destroy_write_struct(&png, &info);
    fclose(f);
}

/* How many samples of the file are not what was written. */
static int png_off(const char *name, const struct png_kind *k)
{
    struct cap_loaded l;
    struct pvx_diag d = {""};
    int wrong = 0, n = k->colour & 2 ? 3 : 1;
    if (cap_image_load(at("%s", name), &l, &d) != PVX_OK || l.img.width != 13 ||
        l.img.height != 9 || cap_pixfmt_channels(l.img.fmt) != n ||
        cap_pixfmt_depth(l.img.fmt) != (k->depth == 16 ? 16 : 8)) {
        printf("  %s\n", d.text);
        return -1;
    }
    unsigned each = k->colour == 2 ? 3 : k->colour == 4 ? 2 : k->colour == 6 ? 4 : 1;
    for (unsigned i = 0; i < 13 * 9 * (unsigned)n; i++) {
        unsigned p = i / (unsigned)n, c = i % (unsigned)n;
        unsigned v = png_truth(k, p % 13 * each + (k->colour == 3 ? 0 : c), p / 13);
        if (k->colour == 3)
            v = c == 0 ? v : c == 1 ? 255 - v : v ^ 77;
        else if (k->depth < 8)
            v = v * 255 / ((1U << k->depth) - 1);
        wrong += v != (k->depth == 16 ? ((const uint16_t *)l.img.data)[i]
                                      : ((const uint8_t *)l.img.data)[i]);
    }
    cap_loaded_free(&l);
    return wrong;
}

T_CASE(png_of_every_kind)
{
    static const int colours[] = {0, 2, 3, 4, 6};
    for (size_t c = 0; c < sizeof colours / sizeof colours[0]; c++)
        for (int depth = colours[c] == 0 || colours[c] == 3 ? 1 : 8;
             depth <= (colours[c] == 3 ? 8 : 16); depth *= 2)
            for (int interlace = 0; interlace < 2; interlace++) {
                const struct png_kind k = {
                    .colour = colours[c], .depth = depth, .interlace = interlace};
                write_png("kind.png", &k, 1 << depth);
                T_EQ_I(png_off("kind.png", &k), 0);
            }
}

T_CASE(png_refusals)
{
    unsigned char exif[26];
    const struct png_kind map = {.colour = 3, .depth = 4},
                          turned = {.depth = 8, .chunk = "eXIf", .data = exif, .size = 26},
                          animated = {.depth = 8,
                                      .chunk = "acTL",
                                      .data = (const unsigned char *)"\0\0\0\3\0\0\0",
                                      .size = 8},
                          still = {.depth = 8,
                                   .chunk = "acTL",
                                   .data = (const unsigned char *)"\0\0\0\1\0\0\0",
                                   .size = 8};
    for (int k = 0; k < 2; k++) {
        exif_of(k, 6, exif);
        write_png("turned.png", &turned, 0);
        T_OK(is_refused("turned.png", "orientation tag (6)"));
    }
    exif_of(true, 1, exif);
    write_png("upright.png", &turned, 0);
    T_EQ_I(png_off("upright.png", &turned), 0);
    write_png("animated.png", &animated, 0);
    T_OK(is_refused("animated.png", "has 3 pictures"));
    write_png("still.png", &still, 0);
    T_EQ_I(png_off("still.png", &still), 0);
    write_png("map.png", &map, 15);
    T_OK(is_refused("map.png", "colour that is not in its map"));
}

/* Any bit that is damaged, and any cut, is seen. */
T_CASE(damaged_pngs)
{
    const struct png_kind k = {.colour = 2, .depth = 16};
    char *b;
    size_t n;
    struct cap_loaded l;
    int taken = 0;
    write_png("whole.png", &k, 0);
    T_EQ_I(pvx_file_read(at("whole.png"), 1 << 20, &b, &n, NULL), PVX_OK);
    for (size_t i = 0; i < n; i++) {
        FILE *f = fopen(at("cut.png"), "wb");
        T_OK(fwrite(b, 1, i, f) == i);
        fclose(f);
        taken += cap_image_load(at("cut.png"), &l, NULL) == PVX_OK;
        cap_loaded_free(&l);
        b[i] = (char)(b[i] ^ 1 << i % 8);
        f = fopen(at("bent.png"), "wb");
        T_OK(fwrite(b, 1, n, f) == n);
        fclose(f);
        taken += cap_image_load(at("bent.png"), &l, NULL) == PVX_OK;
        cap_loaded_free(&l);
        b[i] = (char)(b[i] ^ 1 << i % 8);
    }
    T_EQ_I(taken, 0);
    free(b);
}

/* Head of a PNG, of a TIFF (Intel's order, Motorola's, BigTIFF) that says it has that size, and little more. */
static size_t head_of(int kind, uint32_t w, uint32_t h, uint8_t out[200])
{
    bool big_endian = kind == 0 || kind == 2;
    memset(out, 0, 200);
    size_t at_w = kind == 0 ? 16 : kind == 3 ? 16 + 8 + 12 : 8 + 2 + 8;
    size_t at_h = at_w + (kind == 0 ? 4 : kind == 3 ? 20 : 12);
    if (kind == 0)
        memcpy(out, "\x89PNG\r\n\x1a\n\0\0\0\rIHDR", 16);
    else if (kind == 1)
        memcpy(out, "II*\0\x08\0\0\0\x02\0\0\x01\x04\0\x01\0\0\0....\x01\x01\x04\0\x01\0\0\0", 30);
    else if (kind == 2)
        memcpy(out, "MM\0*\0\0\0\x08\0\x02\x01\0\0\x04\0\0\0\x01....\x01\x01\0\x04\0\0\0\x01", 30);
    else
        memcpy(out,
               "II+\0\x08\0\0\0\x10\0\0\0\0\0\0\0\x02\0\0\0\0\0\0\0\0\x01\x04\0\x01\0\0\0\0\0\0\0"
               "........\x01\x01\x04\0\x01\0\0\0\0\0\0\0",
               56);
    for (int i = 0; i < 4; i++) {
        out[at_w + (size_t)i] = (uint8_t)(w >> 8 * (big_endian ? 3 - i : i));
        out[at_h + (size_t)i] = (uint8_t)(h >> 8 * (big_endian ? 3 - i : i));
    }
    return 200;
}

/* A small file cannot ask for much memory: refused by its head, with a remedy. */
T_CASE(pictures_are_bounded)
{
    static const char *const name[] = {"head.png", "intel.tif", "motorola.tif", "big.tiff"};
    for (int kind = 0; kind < 4; kind++) {
        uint8_t b[200];
        struct cap_loaded l;
        struct pvx_diag d = {""};
        T_EQ_I(pvx_file_write(at("%s", name[kind]), b, head_of(kind, 60000, 59999, b), &d), PVX_OK);
        T_EQ_I(cap_image_load(at("%s", name[kind]), &l, &d), PVX_ERANGE);
        T_CONTAINS(d.text, name[kind]);
        T_CONTAINS(d.text, "60000x59999");
        T_CONTAINS(d.text, "at most 16384");
        d.text[0] = '\0';
        T_EQ_I(pvx_file_write(at("%s", name[kind]), b, head_of(kind, 16384, 16383, b), &d), PVX_OK);
        T_EQ_I(cap_image_load(at("%s", name[kind]), &l, &d), PVX_ECORRUPT);
        T_CONTAINS(d.text, "16384x16383");
        T_CONTAINS(d.text, "only 200 bytes");
        d.text[0] = '\0';
        T_EQ_I(pvx_file_write(at("%s", name[kind]), b, head_of(kind, 0, 7, b), &d), PVX_OK);
        T_EQ_I(cap_image_load(at("%s", name[kind]), &l, &d), PVX_ECORRUPT);
        T_CONTAINS(d.text, "no size or no samples");
        T_OK(l.mem == NULL);
    }
}

/* Whatever the name says. */
T_CASE(only_what_is_promised_is_read)
{
    static const char bmp[] = "BM\x3a\0\0\0\0\0\0\0\x36\0\0\0\x28\0\0\0\1\0\0\0\1\0\0\0\1\0\x18"
                              "\0\0\0\0\0\4\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0\1\2\3";
    struct cap_loaded l;
    struct pvx_diag d = {""};
    T_EQ_I(pvx_file_write(at("b.png"), bmp, sizeof bmp, &d), PVX_OK);
    T_EQ_I(cap_image_load(at("b.png"), &l, &d), PVX_EFORMAT);
    T_CONTAINS(d.text, "not a PNG, TIFF or JPEG file");
}

/* A film of pictures that are too large is told, and a list of other files is none. */
T_CASE(films_are_bounded)
{
    struct pvx_diag d = {""};
    cap_video *v;
    uint8_t head[200];
    static const char list[] = "ffconcat version 1.0\nfile small.png\n";
    T_EQ_I(pvx_file_write(at("wide.apng"), head, head_of(0, 16385, 16, head), &d), PVX_OK);
    T_EQ_I(cap_video_open(at("wide.apng"), &v, NULL, &d), PVX_ERANGE);
    T_CONTAINS(d.text, "wide.apng: ");
    T_CONTAINS(d.text, "at most 16384");
    d.text[0] = '\0';
    T_EQ_I(pvx_file_write(at("few.apng"), head, head_of(0, 16384, 9999, head), &d), PVX_OK);
    T_EQ_I(cap_video_open(at("few.apng"), &v, NULL, &d), PVX_ECORRUPT);
    T_CONTAINS(d.text, "few.apng: says it has 16384x9999 pixels, but only 200 bytes");
    T_EQ_I(cap_image_save(at("small.png"), (float[3]){1, 1, 1}, 1, 1, 3, &d), PVX_OK);
    T_EQ_I(pvx_file_write(at("list.mp4"), list, sizeof list - 1, &d), PVX_OK);
    T_EQ_I(cap_video_open(at("list.mp4"), &v, NULL, &d), PVX_EFORMAT);
    T_OK(v == NULL);
    cap_video_close(&v);
}

T_CASE(damaged_and_missing)
{
    struct pvx_diag d = {""};
    struct cap_loaded l;
    T_EQ_I(pvx_file_write(at("bad.png"), "\x89PNG garbage", 12, &d), PVX_OK);
    T_EQ_I(cap_image_load(at("bad.png"), &l, &d), PVX_EFORMAT);
    T_CONTAINS(d.text, "bad.png");
    d.text[0] = '\0';
    T_EQ_I(cap_image_load(at("none.png"), &l, &d), PVX_ENOENT);
    T_CONTAINS(d.text, "none.png");
    d.text[0] = '\0';
    T_EQ_I(cap_image_load(at("x.bmp"), &l, &d), PVX_EUNSUP);
    T_CONTAINS(d.text, ".npy .png");
    d.text[0] = '\0';
    T_EQ_I(cap_image_save(at("x.jpg"), (float[3]){0}, 1, 1, 3, &d), PVX_EUNSUP);
    cap_video *v;
    d.text[0] = '\0';
    T_EQ_I(cap_video_open(at("none.mp4"), &v, NULL, &d), PVX_ENOENT);
    T_EQ_I(pvx_file_write(at("bad.mp4"), "not a film", 10, &d), PVX_OK);
    d.text[0] = '\0';
    T_EQ_I(cap_video_open(at("bad.mp4"), &v, NULL, &d), PVX_EFORMAT);
    T_OK(v == NULL);
    T_CONTAINS(d.text, "bad.mp4");
}

T_CASE(full_disk_is_named)
{
    struct stat st;
    if (stat("/dev/full", &st) != 0)
        T_SKIP("no /dev/full here");
    /* the temporary beside the target is a link to the full device */
    char tmp[320];
    const char *path = at("full.npy");
    snprintf(tmp, sizeof tmp, "%s.tmp.%ld", path, (long)getpid());
    T_EQ_I(symlink("/dev/full", tmp), 0);
    struct pvx_diag d = {""};
    T_EQ_I(cap_npy_save(path, (float[2]){1, 2}, (size_t[1]){2}, 1, &d), PVX_ENOSPC);
    T_CONTAINS(d.text, "full.npy");
    T_OK(access(path, F_OK) != 0);
}

int main(void)
{
    plugins_of_this_build();
    scratch_new();
    t_run();
    scratch_remove();
    return t_done();
}
