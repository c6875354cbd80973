/* test_cl_unpack.c - raw pixels unpacked and binned on a device: the bits of cap_convert, for every format that a device
 * takes, with rows that have padding, saturated samples and words that do not fit their depth. */
#include "tests/t.h"
#include "tests/lib/cl_bed.h"

#include "base/mem.h"
#include "daemon/pipeline/raw.h"
#include "recon/opencl/photo.h"

enum { CAMERAS = 6, ROUNDS = 60 };
static const int binnings[] = {1, 2, 3, 4, 5, 8, 12, 33};

static rec_cl *cl;
/* Oclgrind checks every access, and is slow: few pictures.  Their last one, at the end of the device's bytes, is in turn
 * of each layout, so a read beyond it is seen. */
static const enum cap_pixfmt ends[] = {CAP_GREY8,        CAP_BAYER_RG14,    CAP_GREY10P,
                                       CAP_GREY12PACKED, CAP_BAYER_GB10CSI, CAP_GREY12CSI};
static bool slow;

static uint32_t seen[CAP_N_FMT][2]; /* pictures by format that the device took: binning 1, more */

struct shot {
    struct cap_image img;
    struct cap_convert_params how;
    struct rec_cl_raw raw;
    uint8_t *bytes;
    size_t at; /* bins before its own */
};
struct set {
    struct shot of[CAMERAS];
    struct rec_photo_image im[CAMERAS];
    struct rec_photo_params params;
    float gain[3];
    size_t rows, cs, bytes;
};

static void fill(struct shot *s)
{
    unsigned most = t_rand() % 2 == 0 ? 256 : 200; /* whether samples are saturated */
    for (size_t i = 0; i < s->img.size; i++)
        s->bytes[i] = (uint8_t)(t_rand() % most);
    if (cap_pixfmt_layout(s->img.fmt) == CAP_LAYOUT_16 && t_rand() % 4 != 0)
        for (size_t i = 1; i < s->img.size; i += 2) /* as most cameras have them */
            s->bytes[i] &= (uint8_t)((1u << (cap_pixfmt_depth(s->img.fmt) - 8)) - 1);
}

static void shot_new(struct shot *s, enum cap_pixfmt fmt, int nch)
{
    int b = binnings[t_rand() % (sizeof binnings / sizeof *binnings)];
    int32_t w = b * (int32_t)(1 + t_rand() % (uint64_t)(b > 8 ? 3 : 40)),
            h = b * (int32_t)(1 + t_rand() % 20);
    w = w < 2 ? 2 : w;
    h = h < 2 ? 2 : h;
    size_t stride = cap_pixfmt_row(fmt, w) + t_rand() % 5;
    *s = (struct shot){.how = {.binning = b,
                               .nch = nch,
                               .mosaic = t_rand() % 2 ? CAP_MOSAIC_RAYS : CAP_MOSAIC_DEMOSAIC,
                               .clip = t_rand() % 3 == 0 ? 1023 : 0},
                       .img = {.fmt = fmt, .width = w, .height = h, .stride = (ptrdiff_t)stride}};
    s->img.size = stride * (size_t)(h - 1) + cap_pixfmt_row(fmt, w);
    s->img.data = s->bytes = malloc(s->img.size); /* no byte beyond may be read */
    fill(s);
}

/* CAMERAS pictures, in formats from `first` on. */
static void set_new(struct set *t, unsigned first, int nch)
{
    *t = (struct set){.cs = nch == 3 ? 4 : 1, .params = rec_photo_defaults, .gain = {1, 1, 1}};
    for (unsigned c = 0; c < CAMERAS; c++) {
        struct shot *s = &t->of[c];
        enum cap_pixfmt fmt = (enum cap_pixfmt)(1 + (first + c) % (CAP_N_FMT - 1));
        if (slow && c == CAMERAS - 1)
            fmt = ends[first / CAMERAS % (sizeof ends / sizeof *ends)];
        fmt = fmt == CAP_JPEG ? CAP_GREY8 : fmt;
        shot_new(s, fmt, nch);
        s->at = t->rows;
        t->im[c] = (struct rec_photo_image){.bw = s->img.width / s->how.binning,
                                            .bh = s->img.height / s->how.binning,
                                            .nch = nch,
                                            .gain = t->gain,
                                            .params = &t->params};
        t->im[c].work = rec_photo_work_new(t->im[c].bw, t->im[c].bh);
        t->rows += (size_t)t->im[c].bw * (size_t)t->im[c].bh;
        if (dmn_raw_of(&s->img, &s->how, &s->raw)) {
            seen[fmt][s->how.binning > 1]++;
            t->bytes += s->raw.bytes;
        }
    }
}

static bool same(const float *a, const float *b, size_t n)
{
    for (size_t i = 0; i < n; i++)
        if (memcmp(a + i, b + i, sizeof *a) != 0 && !(isnan(a[i]) && isnan(b[i])))
            return false;
    return true;
}

static void check_set(struct set *t)
{
    struct pvx_diag d = {""};
    rec_cl_queue *q = cl_bed_queue(cl);
    rec_cl_photo *p;
    struct rec_cl_raw raw[CAMERAS];
    size_t n = t->rows * t->cs * sizeof(float);
    float *want = malloc(n), *got = malloc(n);
    memset(want, 0x11, n);
    struct rec_cl_pictures to = {.b = cl_bed_buffer(cl, q, want, n)};
    T_OK(rec_cl_wait(q));
    T_EQ_I(rec_cl_photo_new(cl, t->im, CAMERAS, t->bytes, &p, &d), PVX_OK);
    for (int c = 0; c < CAMERAS; c++) {
        const struct shot *s = &t->of[c];
        raw[c] = s->raw;
        if (s->raw.layout != REC_CL_LAYOUT_NONE)
            T_EQ_I(cap_convert(&s->img, &s->how, 0, t->im[c].bh, want + s->at * t->cs), PVX_OK);
    }
    T_OK(rec_cl_photo_unpack(p, q, t->im, raw, &to));
    rec_cl_download(q, &to.b, 0, got, n);
    T_OK(rec_cl_wait(q));
    for (int c = 0; c < CAMERAS; c++) {
        const struct shot *s = &t->of[c];
        size_t bins = (size_t)t->im[c].bw * (size_t)t->im[c].bh;
        T_CHECK_(same(got + s->at * t->cs, want + s->at * t->cs, bins * t->cs),
                 "%s %dx%d binning %d nch %d mosaic %d clip %u", cap_pixfmt_name(s->img.fmt),
                 s->img.width, s->img.height, s->how.binning, s->how.nch, (int)s->how.mosaic,
                 s->how.clip);
    }
    raw[0].bytes += t->bytes + 1;
    T_OK(raw[0].layout == REC_CL_LAYOUT_NONE || !rec_cl_photo_unpack(p, q, t->im, raw, &to));
    rec_cl_photo_free(&p);
    rec_cl_buffer_free(cl, &to.b);
    rec_cl_queue_free(&q);
    free(want);
    free(got);
}

T_CASE(equals_cap_convert)
{
    slow = getenv("T_OPENCL") != NULL;
    for (unsigned round = 0; round < (slow ? 6 : ROUNDS); round++) {
        struct set t;
        set_new(&t, round * CAMERAS, round % 2 == 0 ? 1 : 3);
        check_set(&t);
        for (int c = 0; c < CAMERAS; c++) {
            free(t.of[c].bytes);
            free(t.im[c].work);
        }
    }
    size_t taken = 0;
    for (int f = CAP_GREY8; f < CAP_N_FMT; f++)
        taken += seen[f][0] + seen[f][1] > 0;
    T_OK(slow || taken >= 61); /* all but YUV, JPEG and floats */
}

/* What a device does not take. */
T_CASE(others_are_the_processors)
{
    uint8_t bytes[64] = {0};
    struct cap_image img = {bytes, sizeof bytes, 4, 4, 4, CAP_GREY8, 0};
    struct cap_convert_params how = {.binning = 1, .nch = 1};
    struct rec_cl_raw raw;
    T_OK(dmn_raw_of(&img, &how, &raw));
    how.transfer = CAP_TRANSFER_SRGB;
    T_OK(!dmn_raw_of(&img, &how, &raw));
    how.transfer = CAP_TRANSFER_AUTO;
    img.size = 15; /* too short */
    T_OK(!dmn_raw_of(&img, &how, &raw));
    img.size = sizeof bytes;
    img.fmt = CAP_YUYV;
    img.stride = 8;
    T_OK(!dmn_raw_of(&img, &how, &raw));
}

T_MAIN((cl_bed_begin(), cl = cl_bed_open()), rec_cl_close(&cl))
