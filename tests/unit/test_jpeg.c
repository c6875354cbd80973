/* test_jpeg.c - JPEG pictures: what the encoder was given comes back, everything that a camera or a cable
 * can do to one is told by its cause, and a decoder goes on after any of it. */
#include "../t.h"

#include <turbojpeg.h>

#include "capture/pixel/jpeg.h"
#include "capture/pixel/pixfmt.h"

enum { W = 64, H = 48 };

static int red(int x)
{
    return 40 + 150 * x / W;
}
static int green(int y)
{
    return 30 + 120 * y / H;
}

/* Smooth picture, in colour or (TJSAMP_GRAY) grey; owner: caller, free(). */
static uint8_t *encode(int w, int h, int sampling, int flags, size_t *size)
{
    int per = sampling == TJSAMP_GRAY ? 1 : 3;
    uint8_t *px = malloc((size_t)(w * h * per));
    for (int y = 0; y < h; y++)
        for (int x = 0; x < w; x++) {
            uint8_t *p = px + (y * w + x) * per;
            p[0] = (uint8_t)red(x);
            if (per == 3) {
                p[1] = (uint8_t)green(y);
                p[2] = (uint8_t)(90 + 60 * (x + y) / (w + h));
            }
        }
    tjhandle tj = tjInitCompress();
    unsigned char *made = NULL;
    unsigned long n = 0;
    T_EQ_I(tjCompress2(tj, px, w, 0, h, per == 1 ? TJPF_GRAY : TJPF_RGB, &made, &n, sampling, 95,
                       flags),
           0);
    tjDestroy(tj);
    free(px);
    uint8_t *out = malloc(n); /* of exactly its size */
    memcpy(out, made, n);
    tjFree(made);
    *size = n;
    return out;
}

static cap_jpeg *decoder; /* one for all cases: none may be the worse for the ones before */

static pvx_err decode(const void *data, size_t size, struct cap_image *out)
{
    struct cap_image in = {data, size, W, H, 0, CAP_JPEG, 0};
    struct pvx_diag d = {""};
    pvx_err e = cap_jpeg_decode(decoder, &in, out, &d);
    T_CHECK_((e == PVX_OK) == (d.text[0] == '\0'), "error %d, text '%s'", (int)e, d.text);
    return e;
}

static void check_colours(const struct cap_image *img)
{
    int worst = 0;
    for (int y = 0; y < H; y++)
        for (int x = 0; x < W; x++) {
            const uint8_t *p = (const uint8_t *)img->data + y * img->stride + x * 3;
            int e = abs(p[0] - red(x)) + abs(p[1] - green(y));
            worst = e > worst ? e : worst;
        }
    T_LE(worst, 10);
}

T_CASE(colour_comes_back)
{
    static const int samplings[] = {TJSAMP_444, TJSAMP_422, TJSAMP_420};
    for (int k = 0; k < 3; k++) {
        size_t n;
        struct cap_image img;
        uint8_t *bytes = encode(W, H, samplings[k], 0, &n);
        T_EQ_I(decode(bytes, n, &img), PVX_OK);
        T_EQ_I(img.fmt, CAP_RGB8);
        T_EQ_I(img.yuv, CAP_YUV_CODED);
        T_EQ_I(img.size, W * H * 3);
        check_colours(&img);
        float light[W * H * 4];
        T_EQ_I(cap_bin(&img, 1, 3, 0, H, light), PVX_OK); /* gamma-coded without being told */
        const uint8_t *p = img.data;
        T_NEAR((double)light[0], pow((p[0] / 255.0 + 0.055) / 1.055, 2.4), 2e-6);
        free(bytes);
    }
}

T_CASE(grey_comes_back)
{
    size_t n;
    struct cap_image img;
    uint8_t *bytes = encode(W, H, TJSAMP_GRAY, 0, &n);
    T_EQ_I(decode(bytes, n, &img), PVX_OK);
    T_EQ_I(img.fmt, CAP_GREY8);
    T_EQ_I(img.stride, W);
    for (int x = 0; x < W; x++)
        T_OK(abs(((const uint8_t *)img.data)[x] - red(x)) <= 4);
    free(bytes);
}

/* First marker `code`; NULL when there is none before the scan. */
static uint8_t *segment(uint8_t *p, size_t n, int code)
{
    for (size_t at = 2; at + 4 <= n && p[at + 1] != 0xDA;
         at += 2 + (size_t)(p[at + 2] << 8 | p[at + 3]))
        if (p[at + 1] == code)
            return p + at;
    return NULL;
}

/* Motion JPEG leaves the standard Huffman tables out. */
T_CASE(without_huffman_tables)
{
    size_t n;
    struct cap_image img;
    uint8_t *bytes = encode(W, H, TJSAMP_422, 0, &n), *dht;
    while ((dht = segment(bytes, n, 0xC4)) != NULL) {
        size_t length = 2 + (size_t)(dht[2] << 8 | dht[3]);
        memmove(dht, dht + length, n - (size_t)(dht - bytes) - length);
        n -= length;
    }
    T_EQ_I(decode(bytes, n, &img), PVX_OK);
    check_colours(&img);
    free(bytes);
}

T_CASE(faults_are_told_apart)
{
    size_t n, m;
    struct cap_image img = {.fmt = CAP_FMT_NONE};
    uint8_t *good = encode(W, H, TJSAMP_422, 0, &n), *other;
    T_EQ_I(decode("GIF89a..", 8, &img), PVX_EFORMAT);
    T_EQ_I(decode(NULL, 0, &img), PVX_EFORMAT);
    other = encode(W + 16, H, TJSAMP_422, 0, &m);
    T_EQ_I(decode(other, m, &img), PVX_ERANGE);
    free(other);
    other = encode(W, H, TJSAMP_422, TJFLAG_PROGRESSIVE, &m);
    T_EQ_I(decode(other, m, &img), PVX_EUNSUP);
    free(other);
    for (size_t cut = 0; cut < n; cut++) { /* cut off anywhere: copies of exactly that size */
        uint8_t *part = malloc(cut > 0 ? cut : 1);
        memcpy(part, good, cut);
        pvx_err e = decode(part, cut, &img);
        T_CHECK_(e == (cut < 4 ? PVX_EFORMAT : PVX_ECORRUPT) || (cut >= n - 2 && e == PVX_OK),
                 "cut to %zu of %zu bytes: %s", cut, n, pvx_strerror(e));
        free(part);
    }
    T_EQ_I(img.fmt, CAP_FMT_NONE); /* untouched */
    T_EQ_I(decode(good, n, &img), PVX_OK);
    check_colours(&img);
    free(good);
}

/* 65500 x 65500 pixels announced in a few bytes: refused before anything is asked for. */
T_CASE(huge_pictures_are_refused)
{
    size_t n;
    struct cap_image img;
    uint8_t *bytes = encode(W, H, TJSAMP_444, 0, &n), *sof = segment(bytes, n, 0xC0);
    T_OK(sof != NULL);
    memcpy(sof + 5, "\xff\xdc\xff\xdc", 4);
    T_EQ_I(decode(bytes, n, &img), PVX_ERANGE);
    memcpy(sof + 5, "\x00\x00\x00\x40", 4); /* height to be told later */
    T_EQ_I(decode(bytes, n, &img), PVX_ERANGE);
    free(bytes);
    cap_jpeg *j;
    T_EQ_I(cap_jpeg_new(65536, 1, &j), PVX_EINVAL);
    T_EQ_I(cap_jpeg_new(0, 1, &j), PVX_EINVAL);
    T_OK(j == NULL);
}

/* What webcams do: a few bytes too many before the end, padding behind it.  More is damage. */
T_CASE(left_over_bytes)
{
    struct cap_image img;
    for (size_t extra = 0; extra <= 40; extra += 8) {
        size_t n;
        uint8_t *good = encode(W, H, TJSAMP_420, 0, &n);
        uint8_t *bytes = calloc(n + extra + 30, 1);
        memcpy(bytes, good, n - 2);
        memset(bytes + n - 2, 0x12, extra);
        memcpy(bytes + n - 2 + extra, "\xff\xd9", 2);
        pvx_err e = decode(bytes, n + extra + 30, &img);
        T_CHECK_(e == (extra <= 16 ? PVX_OK : PVX_ECORRUPT), "%zu bytes left over: %s", extra,
                 pvx_strerror(e));
        free(bytes);
        free(good);
    }
}

/* Damage in the coded data: nearly always seen (a wrong bit can decode to a valid picture), and the
 * decoder is none the worse for it. */
T_CASE(damage)
{
    size_t n, seen = 0, tried = 0;
    struct cap_image img;
    uint8_t *good = encode(W, H, TJSAMP_422, 0, &n), *bytes = malloc(n);
    for (int round = 0; round < 300; round++) {
        memcpy(bytes, good, n);
        size_t at = n / 2 + (size_t)(t_rand() % (n / 2 - 60));
        memset(bytes + at, 0xFF, 20); /* a lost packet */
        memset(bytes + at + 20, 0, 20);
        tried++;
        seen += decode(bytes, n, &img) == PVX_ECORRUPT;
    }
    T_CHECK_(seen > tried * 9 / 10, "%zu of %zu seen", seen, tried);
    T_EQ_I(decode(good, n, &img), PVX_OK);
    check_colours(&img);
    free(bytes);
    free(good);
}

static void set_up(void)
{
    if (cap_jpeg_new(W, H, &decoder) != PVX_OK)
        exit(1);
}
T_MAIN(set_up(), cap_jpeg_free(&decoder))
