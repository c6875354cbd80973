/* test_cl_unpack.c - raw pixels unpacked and binned on a device: the bits of cap_convert, for every format that a device
 * takes, linear and gamma-coded, with and without maps, with rows that have padding, saturated samples and words that do
 * not fit their depth. */
#include "tests/t.h"
#include "tests/lib/cl_bed.h"

#include "base/mem.h"
#include "capture/pixel/maps.h"
#include "daemon/pipeline/raw.h"
#include "recon/opencl/photo.h"

enum { CAMERAS = 6, ROUNDS = 240 };
static const int binnings[] = {1, 2, 3, 4, 5, 8, 12, 33};

static rec_cl *cl;
/* Oclgrind checks every access, and is slow: few pictures.  Their last one, at the end of the device's bytes, is in turn
 * of each layout, and its maps are at the end of theirs.  So a read beyond them is seen. */
static const enum cap_pixfmt ends[] = {CAP_GREY8,        CAP_BAYER_RG14,    CAP_GREY10P,
                                       CAP_GREY12PACKED, CAP_BAYER_GB10CSI, CAP_GREY12CSI,
                                       CAP_UYVY};
static bool slow;

/* Pictures that the device took: by format and binning 1 or more; with maps; of these by kind. */
static uint32_t seen[CAP_N_FMT][2], seen_maps[CAP_N_FMT];
static struct {
    uint32_t gamma, response, masked, matrix, rays, declined;
} tried;

struct shot {
    struct cap_image img;
    struct cap_convert_params how;
    struct cap_maps *maps;
    struct rec_cl_raw raw;
    uint8_t *bytes;
    size_t at; /* bins before its own */
};
struct set {
    struct shot of[CAMERAS];
    struct rec_photo_image im[CAMERAS];
    struct rec_photo_params params;
    float gain[3];
    size_t rows, cs;
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
    if (cap_pixfmt_layout(fmt) == CAP_LAYOUT_YUV)
        s->img.yuv = (uint8_t)(t_rand() % CAP_YUV_CODED);
    if (t_rand() % 4 == 0 && cap_pixfmt_layout(fmt) != CAP_LAYOUT_F32)
        s->how.transfer = t_rand() % 2 ? CAP_TRANSFER_SRGB : CAP_TRANSFER_BT709;
    s->img.size = stride * (size_t)(h - 1) + cap_pixfmt_row(fmt, w);
    s->img.data = s->bytes = malloc(s->img.size); /* no byte beyond may be read */
    fill(s);
}

/* Values of a map [height][width][channels] between lo and hi; some, or all of a half of the rows, have `bad` instead. */
static float *map_of(const struct shot *s, int channels, float lo, float hi, float bad)
{
    size_t row = (size_t)s->img.width * (size_t)channels, n = row * (size_t)s->img.height;
    float *map = malloc(n * sizeof *map);
    bool half = t_rand() % 4 == 0, some = t_rand() % 2 == 0;
    for (size_t i = 0; i < n; i++) {
        map[i] = (float)t_uniform((double)lo, (double)hi);
        if ((half && i / row < (size_t)s->img.height / 2) || (some && t_rand() % 64 == 0))
            map[i] = bad;
    }
    return map;
}

/* Maps of any kind, new ones in place of those before. */
static void make_maps(struct shot *s)
{
    static const double response[] = {0, 0.1, 0.1, 0.6, 1},
                        matrix[] = {1, -.3, .1, .2, .7, -.1, 0, .4, .9};
    const uint8_t *cell = cap_pixfmt_bayer(s->img.fmt);
    int channels = cell == NULL ? cap_pixfmt_channels(s->img.fmt) : 1;
    bool rays = cell != NULL && s->how.mosaic == CAP_MOSAIC_RAYS && s->how.binning == 1;
    bool coloured = s->how.nch == 3 && cap_pixfmt_channels(s->img.fmt) == 3 && !rays;
    bool floats = cap_pixfmt_layout(s->img.fmt) == CAP_LAYOUT_F32;
    size_t pixels = (size_t)s->img.width * (size_t)s->img.height;
    float *dark = t_rand() % 3 != 0 ? map_of(s, channels, -0.01f, 0.1f, NAN) : NULL;
    float *flat = t_rand() % 3 != 0 ? map_of(s, channels, 0.2f, 1.3f, 0.01f) : NULL;
    uint8_t *mask = malloc(pixels);
    for (size_t i = 0; i < pixels; i++)
        mask[i] = t_rand() % 90 != 0;
    struct cap_photometry c = {.width = s->img.width,
                               .height = s->img.height,
                               .dark = dark,
                               .flat = flat,
                               .channels = channels,
                               .mask = t_rand() % 3 == 0 ? mask : NULL,
                               .response = t_rand() % 2 && !floats ? response : NULL,
                               .n_response = 5,
                               .matrix = t_rand() % 2 && coloured ? matrix : NULL,
                               .gain = {1.5f, 0.5f, 1}};
    cap_maps_free(&s->maps);
    s->how.maps = NULL;
    T_EQ_I(cap_maps_new(&c, &s->img, &s->how, &s->maps, NULL), PVX_OK);
    s->how.maps = s->maps;
    free(dark);
    free(flat);
    free(mask);
}

/* What the device is told. */
static void shot_raw(struct shot *s)
{
    const struct rec_cl_maps *m = &s->raw.maps;
    if (!dmn_raw_of(&s->img, &s->how, &s->raw)) {
        tried.declined += s->maps != NULL;
        return;
    }
    seen[s->img.fmt][s->how.binning > 1]++;
    seen_maps[s->img.fmt] += s->maps != NULL;
    tried.gamma += m->table != NULL && s->how.transfer != CAP_TRANSFER_AUTO;
    tried.response += m->table != NULL && s->how.transfer == CAP_TRANSFER_AUTO;
    tried.masked += m->mask != NULL;
    tried.matrix += m->matrix != NULL;
    tried.rays += m->planes == 1 && s->how.nch == 3;
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
        if (t_rand() % 2 == 0 || (slow && c == CAMERAS - 1))
            make_maps(s);
        shot_raw(s);
        s->at = t->rows;
        t->im[c] = (struct rec_photo_image){.bw = s->img.width / s->how.binning,
                                            .bh = s->img.height / s->how.binning,
                                            .nch = nch,
                                            .gain = t->gain,
                                            .params = &t->params};
        t->im[c].work = rec_photo_work_new(t->im[c].bw, t->im[c].bh);
        t->rows += (size_t)t->im[c].bw * (size_t)t->im[c].bh;
    }
}
static void set_free(struct set *t)
{
    for (int c = 0; c < CAMERAS; c++) {
        cap_maps_free(&t->of[c].maps);
        free(t->of[c].bytes);
        free(t->im[c].work);
    }
}

/* The next set of the same cameras: one has other maps, another one has none any more, others have other pixels. */
static void set_next(struct set *t)
{
    for (int c = 0; c < CAMERAS; c++) {
        struct shot *s = &t->of[c];
        if (s->raw.layout == REC_CL_LAYOUT_NONE) /* there is no room for it */
            continue;
        if (s->maps != NULL && c % 3 == 0)
            make_maps(s);
        if (s->maps != NULL && c % 3 == 1) {
            cap_maps_free(&s->maps);
            s->how.maps = NULL;
        }
        fill(s);
        shot_raw(s);
    }
}

static bool same(const float *a, const float *b, size_t n)
{
    for (size_t i = 0; i < n; i++)
        if (memcmp(a + i, b + i, sizeof *a) != 0 && !(isnan(a[i]) && isnan(b[i])))
            return false;
    return true;
}

static void compare(const struct set *t, int c, const float *got, const float *want)
{
    const struct shot *s = &t->of[c];
    size_t bins = (size_t)t->im[c].bw * (size_t)t->im[c].bh;
    const struct rec_cl_maps *m = &s->raw.maps;
    T_CHECK_(same(got + s->at * t->cs, want + s->at * t->cs, bins * t->cs),
             "%s %dx%d binning %d nch %d mosaic %d clip %u: table %d, maps %d, mask %d, matrix %d",
             cap_pixfmt_name(s->img.fmt), s->img.width, s->img.height, s->how.binning, s->how.nch,
             (int)s->how.mosaic, s->how.clip, m->table != NULL, m->number > 0, m->mask != NULL,
             m->matrix != NULL);
}

struct there {
    rec_cl_queue *q;
    rec_cl_photo *p;
    struct rec_cl_pictures to;
    float *want, *got;
};

/* Room for a camera's maps: as much as any take, but for the last one, whose maps stay, what these take. */
static size_t room_of(const struct set *t, int c)
{
    const struct rec_cl_raw *r = &t->of[c].raw;
    const struct rec_cl_maps *m = &r->maps;
    size_t bins = (size_t)t->im[c].bw * (size_t)t->im[c].bh, words = 0;
    size_t pixels = (size_t)t->of[c].img.width * (size_t)t->of[c].img.height;
    if (c < CAMERAS - 1)
        return rec_cl_maps_room(pixels, bins, t->im[c].nch);
    words += m->table != NULL ? (size_t)1 << r->depth : 0;
    words += m->word != NULL ? m->planes * bins : 0;
    words += m->mask != NULL ? (pixels + 31) / 32 : 0;
    return words * sizeof(uint32_t);
}

static void there_new(struct there *o, const struct set *t)
{
    struct pvx_diag d = {""};
    size_t n = t->rows * t->cs * sizeof(float), bytes = 0, maps[CAMERAS];
    for (int c = 0; c < CAMERAS; c++) {
        maps[c] = room_of(t, c);
        bytes += t->of[c].raw.bytes;
    }
    *o = (struct there){.q = cl_bed_queue(cl), .want = malloc(n), .got = malloc(n)};
    memset(o->want, 0x11, n);
    o->to.b = cl_bed_buffer(cl, o->q, o->want, n);
    T_OK(rec_cl_wait(o->q));
    T_EQ_I(rec_cl_photo_new(cl, t->im, CAMERAS, bytes, maps, &o->p, &d), PVX_OK);
}
static void there_free(struct there *o)
{
    rec_cl_photo_free(&o->p);
    rec_cl_buffer_free(cl, &o->to.b);
    rec_cl_queue_free(&o->q);
    free(o->want);
    free(o->got);
}

/* A device does what it takes, and leaves other pictures as they are. */
static void check_set(struct there *o, const struct set *t)
{
    struct rec_cl_raw raw[CAMERAS];
    size_t bytes = t->rows * t->cs * sizeof(float);
    for (int c = 0; c < CAMERAS; c++) {
        const struct shot *s = &t->of[c];
        raw[c] = s->raw;
        if (s->raw.layout != REC_CL_LAYOUT_NONE)
            T_EQ_I(cap_convert(&s->img, &s->how, 0, t->im[c].bh, o->want + s->at * t->cs), PVX_OK);
    }
    rec_cl_photo_send(o->p, o->q, t->im);
    T_OK(rec_cl_photo_unpack(o->p, o->q, raw, &o->to));
    rec_cl_download(o->q, &o->to.b, 0, o->got, bytes);
    T_OK(rec_cl_wait(o->q));
    for (int c = 0; c < CAMERAS; c++)
        compare(t, c, o->got, o->want);
}

T_CASE(equals_cap_convert)
{
    slow = getenv("T_OPENCL") != NULL;
    for (unsigned round = 0; round < (slow ? 7 : T_SANITIZED ? ROUNDS / 6 : ROUNDS); round++) {
        struct set t;
        struct there o;
        set_new(&t, round * CAMERAS, round % 2 == 0 ? 1 : 3);
        there_new(&o, &t);
        check_set(&o, &t);
        set_next(&t);
        check_set(&o, &t);
        there_free(&o);
        set_free(&t);
    }
    size_t taken = 0, mapped = 0;
    for (int f = CAP_GREY8; f < CAP_N_FMT; f++) {
        taken += seen[f][0] + seen[f][1] > 0;
        mapped += seen_maps[f] > 0;
    }
    if (slow || T_SANITIZED)
        return;
    T_OK(taken >= 63 && mapped >= 63); /* all but JPEG and floats */
    T_OK(tried.gamma > 50 && tried.response > 50 && tried.masked > 50);
    T_OK(tried.matrix > 20 && tried.rays > 5 && tried.declined > 5);
}

/* Maps are sent once, and nothing is done without room for them. */
T_CASE(maps_stay_there)
{
    struct set t;
    struct there o;
    struct rec_cl_raw raw[CAMERAS];
    struct pvx_diag d = {""};
    rec_cl_photo *without;
    uint32_t *zeros;
    do {
        set_new(&t, 0, 3);
        if (t.of[0].raw.maps.word == NULL)
            set_free(&t);
    } while (t.of[0].raw.maps.word == NULL);
    there_new(&o, &t);
    memset(t.of[0].bytes, 100, t.of[0].img.size); /* not saturated */
    check_set(&o, &t);
    for (int c = 0; c < CAMERAS; c++)
        raw[c] = t.of[c].raw;
    zeros = pvx_calloc(raw[0].maps.plane * raw[0].maps.planes, sizeof *zeros);
    raw[0].maps.word = zeros;
    T_OK(rec_cl_photo_unpack(o.p, o.q, raw, &o.to));
    rec_cl_download(o.q, &o.to.b, 0, o.got, t.rows * t.cs * sizeof(float));
    T_OK(rec_cl_wait(o.q));
    compare(&t, 0, o.got, o.want);
    raw[0].maps.number++; /* others */
    T_OK(rec_cl_photo_unpack(o.p, o.q, raw, &o.to));
    rec_cl_download(o.q, &o.to.b, 0, o.got, t.rows * t.cs * sizeof(float));
    T_OK(rec_cl_wait(o.q));
    T_OK(!same(o.got, o.want, (size_t)t.im[0].bw * (size_t)t.im[0].bh * t.cs));
    raw[0].bytes += 1u << 30;
    T_OK(!rec_cl_photo_unpack(o.p, o.q, raw, &o.to));
    T_EQ_I(rec_cl_photo_new(cl, t.im, CAMERAS, 1u << 20, NULL, &without, &d), PVX_OK);
    raw[0].bytes = t.of[0].raw.bytes;
    T_OK(!rec_cl_photo_unpack(without, o.q, raw, &o.to));
    rec_cl_photo_free(&without);
    there_free(&o);
    set_free(&t);
    free(zeros);
}

/* What a device does not take. */
T_CASE(others_are_the_processors)
{
    uint8_t bytes[64] = {0}, mask[16] = {0};
    struct cap_image img = {bytes, sizeof bytes, 4, 4, 4, CAP_GREY8, 0};
    struct cap_convert_params how = {.binning = 1, .nch = 1};
    struct cap_photometry light = {.width = 4, .height = 4, .mask = mask, .gain = {1, 1, 1}};
    struct cap_maps *maps;
    struct rec_cl_raw raw;
    T_OK(dmn_raw_of(&img, &how, &raw));
    img.size = 15; /* too short */
    T_OK(!dmn_raw_of(&img, &how, &raw));
    T_EQ_I(raw.layout, REC_CL_LAYOUT_NONE);
    img.size = sizeof bytes;
    T_EQ_I(cap_maps_new(&light, &img, &how, &maps, NULL), PVX_OK);
    how.maps = maps;
    T_OK(!dmn_raw_of(&img, &how, &raw)); /* no pixel is left */
    cap_maps_free(&maps);
    mask[5] = 1;
    T_EQ_I(cap_maps_new(&light, &img, &how, &maps, NULL), PVX_OK);
    how.maps = maps;
    T_OK(dmn_raw_of(&img, &how, &raw));
    how.maps = NULL;
    cap_maps_free(&maps);
    img.fmt = CAP_GREY_F32;
    img.stride = 16;
    T_OK(!dmn_raw_of(&img, &how, &raw));
}

T_MAIN((cl_bed_begin(), cl = cl_bed_open()), rec_cl_close(&cl))
