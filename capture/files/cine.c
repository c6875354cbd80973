/* cine.c - Vision Research's .cine: "The Cine File Format", little endian.
 *
 *   CINEFILEHEADER    what kind of pixels, the numbers of its images, where the rest lies, the instant of the trigger
 *   BITMAPINFOHEADER  size, bits and packing of a picture
 *   SETUP             grows with the programs' versions: a field is there if it ends before SETUP.Length
 *   tagged blocks     time and exposure of each image, in 2^-32 s
 *   image offsets     of each image: annotation, whose last 4 bytes are the number of bytes of pixels, then these
 *
 * Rows of 8 and 16 bits are stored from the bottom up, packed ones from the top down.  bFlipH, bFlipV and Rotate say how
 * the picture is shown.  FFmpeg obeys bFlipV, too.  CFA is the colour filter of the picture before that.  Gain, gamma,
 * tone, matrices and white balance for viewing (all after WBView) change no sample of the file. */
#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "capture/files/raw.h"
#include "capture/files/said.h"

/* Places in the header, the bitmap's header and SETUP. */
enum {
    HEAD_SIZE = 44,
    HEAD_COMPRESSION = 4,
    HEAD_VERSION = 6,
    HEAD_FIRST_MOVIE = 8,
    HEAD_TOTAL = 12,
    HEAD_FIRST = 16,
    HEAD_COUNT = 20,
    HEAD_BITMAP = 24,
    HEAD_SETUP = 28,
    HEAD_OFFSETS = 32,
    HEAD_TRIGGER = 36,
    BITMAP_SIZE = 40,
    SETUP_MARK = 140, /* "ST" */
    SETUP_LENGTH = 142,
    SETUP_FLIP_H = 756,
    SETUP_FLIP_V = 760,
    SETUP_RATE = 768,
    SETUP_CFA = 808,
    SETUP_WB_GAIN = 852, /* red and blue of the first head */
    SETUP_ROTATE = 884,
    SETUP_REAL_BPP = 896,
    SETUP_SHUTTER_NS = 1568,
    SETUP_ACQUIRED =
        1580, /* left, top, width, height: another than the picture's where text is beside it */
    SETUP_META_WB = 5724,
    SETUP_BLACK = 5732,
    SETUP_WHITE = 5736,
    SETUP_CROP = 6868, /* whether, left, top, right, bottom; the last two are in it */
    SETUP_RESAMPLE = 6888,
    SETUP_RATE_DOUBLE = 10400,
    SETUP_MOST = 10408,
    TAG_TIME_TOTAL = 1001, /* of all images that were recorded */
    TAG_TIME = 1002,
    TAG_EXPOSURE = 1003
};
#define UNINTERPOLATED 2
#define CFA_CODES      6
#define WB_NEAR        0.0005f
#define VARIES         1.01 /* ratio of exposures from which it is said */

struct cine {
    struct cap_raw *r;
    uint8_t head[HEAD_SIZE], bitmap[BITMAP_SIZE], setup[SETUP_MOST];
    uint32_t length; /* of SETUP */
    uint32_t count;
    uint64_t times, total, exposures; /* where they lie; 0: they do not */
    double rate;
};

static uint16_t cine_u16(const uint8_t *p)
{
    return (uint16_t)(p[0] | p[1] << 8);
}

static uint32_t cine_u32(const uint8_t *p)
{
    return (uint32_t)cine_u16(p) | (uint32_t)cine_u16(p + 2) << 16;
}

static uint64_t cine_u64(const uint8_t *p)
{
    return cine_u32(p) | (uint64_t)cine_u32(p + 4) << 32;
}

/* A field of SETUP; 0: the program was older than the field. */
static uint32_t cine_setup(const struct cine *c, unsigned at)
{
    return at + 4 <= c->length ? cine_u32(c->setup + at) : 0;
}

static float cine_float(const struct cine *c, unsigned at)
{
    uint32_t bits = cine_setup(c, at);
    float f;
    memcpy(&f, &bits, sizeof f);
    return f;
}

/* Which 12 bits the 10 of a packed picture stand for.  The specification has a table of 1024 values.  These are the
 * steps between its first 1015.  The others are full scale. */
static uint16_t cine_table[1024];

static void cine_make_table(void)
{
    static const char step[] =
        "311111111111101111111111111111011111111111111101111111111111110111111111111111"
        "101111111111111110111111111111111101111111111111110111111111111011111111111111"
        "111211111111121111112111121112111211121121121121121211212121121212121212122121"
        "221212212212212212221222122212222212222222122222222222222222222222322222223222"
        "223222322232223223223223223232322323232323232323323232332332332332333233323332"
        "333332333333332333333333333333333343333333343333433334333433433343343433434334"
        "343434343434343443434434434434434443444344443444444344444444444444444444444444"
        "544444544445444544454454454454454545445454545454554545455455455455455545554555"
        "545555554555555555555555555555555565555556555565556555655655655656556565656565"
        "656565656656656566566656665666566665666666665666666666666667666666667666676666"
        "766676676676676766767676767676767676776767767767776777677767777767777777777767"
        "777787777777777787777787777877787787787787787878778787878788787878878878878878"
        "887888878888878888888888888888888888888988888988889888988988988988989898898988";
    uint16_t v = 2;
    for (size_t i = 0; i < 1024; i++) {
        cine_table[i] = v;
        v = i + 1 < sizeof step ? (uint16_t)(v + (step[i] - '0')) : 4095;
    }
}

/* ---- headers ---------------------------------------------------------------------------------- */

static pvx_err cine_cut(const struct cine *c, const char *what, struct pvx_diag *d)
{
    return pvx_fail(d, PVX_ECORRUPT, "%s: cut or damaged: its %s is not whole; save it again",
                    c->r->path, what);
}

static pvx_err cine_headers(struct cine *c, struct pvx_diag *d)
{
    const struct cap_raw *r = c->r;
    if (!cap_raw_get(r, 0, c->head, HEAD_SIZE))
        return cine_cut(c, "header", d);
    if (memcmp(c->head, "CI", 2) != 0 || cine_u16(c->head + 2) < HEAD_SIZE)
        return pvx_fail(d, PVX_EFORMAT, "%s: is no cine: it does not begin as one", r->path);
    if (cine_u16(c->head + HEAD_VERSION) > 1)
        return pvx_fail(d, PVX_EUNSUP, "%s: is a cine of version %u; 0 and 1 are known", r->path,
                        cine_u16(c->head + HEAD_VERSION));
    if (!cap_raw_get(r, cine_u32(c->head + HEAD_BITMAP), c->bitmap, BITMAP_SIZE))
        return cine_cut(c, "picture header", d);
    uint64_t at = cine_u32(c->head + HEAD_SETUP);
    if (!cap_raw_get(r, at, c->setup, SETUP_LENGTH + 2))
        return cine_cut(c, "SETUP", d);
    if (memcmp(c->setup + SETUP_MARK, "ST", 2) != 0)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: its SETUP has no mark, as in the first versions of the format; save "
                        "it again with a newer program",
                        r->path);
    c->length = cine_u16(c->setup + SETUP_LENGTH);
    uint32_t known = c->length < SETUP_MOST ? c->length : SETUP_MOST;
    if (known < SETUP_LENGTH + 2 || !cap_raw_get(r, at, c->setup, known))
        return cine_cut(c, "SETUP", d);
    c->length = known;
    c->count = cine_u32(c->head + HEAD_COUNT);
    c->rate = cine_setup(c, SETUP_RATE);
    double fine = 0;
    if (c->length >= SETUP_RATE_DOUBLE + sizeof fine)
        memcpy(&fine, c->setup + SETUP_RATE_DOUBLE, sizeof fine);
    if (fine > 0 && fine < 1e12)
        c->rate = fine;
    return PVX_OK;
}

/* ---- pixels ----------------------------------------------------------------------------------- */

static pvx_err cine_packing(struct cine *c, struct pvx_diag *d)
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    struct cap_raw *r = c->r;
    unsigned bits = cine_u16(c->bitmap + 14), kind = cine_u16(c->head + HEAD_COMPRESSION);
    uint32_t packing = cine_u32(c->bitmap + 16);
    if (bits == 24 || bits == 48)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: its colours are interpolated (%u bits a pixel), and so not as the "
                        "sensor saw them: save it as a raw cine",
                        r->path, bits);
    if (kind != 0 && kind != UNINTERPOLATED)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: its images are compressed (Compression %u): save it as a raw cine",
                        r->path, kind);
    r->code = packing == 0x100   ? CAP_RAW_10_TABLE
              : packing == 0x400 ? CAP_RAW_12
              : bits == 8        ? CAP_RAW_8
                                 : CAP_RAW_16;
    if ((packing != 0 && packing != 0x100 && packing != 0x400) ||
        (packing == 0 && bits != 8 && bits != 16))
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: its images have a packing that is not known (biCompression %u, %u "
                        "bits): save it as 8 or 16 bits, or packed as 10 or 12",
                        r->path, packing, bits);
    r->bottom_up = packing == 0;
    pthread_once(&once, cine_make_table);
    r->table = cine_table;
    return PVX_OK;
}

static pvx_err cine_depth(struct cine *c)
{
    struct cap_raw *r = c->r;
    uint32_t real = cine_setup(c, SETUP_REAL_BPP), levels = cine_u32(c->bitmap + 36);
    r->depth = r->code == CAP_RAW_8 ? 8 : r->code == CAP_RAW_16 ? 16 : 12;
    if (r->code != CAP_RAW_16)
        return PVX_OK;
    if (real < 8 || real > 16)
        for (real = 16; real > 8 && levels >> (real - 1) != 2; real--) /* levels = 2^bits */
            ;
    if (real > 8 || levels == 256) {
        r->depth = (int)real;
        return PVX_OK;
    }
    return cap_said_add(&r->said,
                        "%s: does not say how many of its 16 bits are used: all are taken; if they "
                        "are 12, say --pixel-format Mono12",
                        r->path);
}

/* The filter of the stored picture, upright. */
static pvx_err cine_colours(struct cine *c, struct pvx_diag *d)
{
    static const char *const cell[CFA_CODES + 1] = {
        [3] = "GBRG", [4] = "RGGB", [5] = "GRBG", [6] = "BGGR"};
    struct cap_raw *r = c->r;
    uint32_t cfa = cine_setup(c, SETUP_CFA), code = cfa & 0xFF;
    if (code == 0)
        return PVX_OK;
    if (cine_u16(c->head + HEAD_COMPRESSION) != UNINTERPOLATED) {
        r->filter = true; /* a colour camera, but grey by its kind of pixels */
        return PVX_OK;
    }
    if (code > CFA_CODES || cell[code] == NULL || cfa >> 8 != 0)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: its colour filter (CFA 0x%x) is of a kind that is not read; Bayer "
                        "patterns are 3 to 6",
                        r->path, cfa);
    memcpy(r->cell, cell[code], sizeof r->cell);
    float red = cine_float(c, SETUP_WB_GAIN), blue = cine_float(c, SETUP_WB_GAIN + 4);
    if (cine_setup(c, SETUP_META_WB) != 0 || !(red > 0 && blue > 0) ||
        (fabsf(red - 1) < WB_NEAR && fabsf(blue - 1) < WB_NEAR))
        return PVX_OK;
    return cap_said_add(&r->said,
                        "%s: the camera has multiplied red by %.3g and blue by %.3g (white "
                        "balance); samples come as they are",
                        r->path, (double)red, (double)blue);
}

static pvx_err cine_turn(struct cine *c, struct pvx_diag *d)
{
    struct cap_raw *r = c->r;
    int32_t turn = (int32_t)cine_setup(c, SETUP_ROTATE);
    r->mirror_x = cine_setup(c, SETUP_FLIP_H) != 0;
    r->mirror_y = cine_setup(c, SETUP_FLIP_V) != 0;
    if (turn % 90 != 0 || turn < -270 || turn > 270)
        return pvx_fail(d, PVX_EUNSUP, "%s: is turned by %d degrees; only quarters are read",
                        r->path, turn);
    r->quarters = (turn / 90 + 4) % 4;
    if (r->quarters % 2 != 0 && r->mirror_x != r->mirror_y)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: is to be mirrored and turned by a quarter, and it does not say which "
                        "comes first: save it with one of them",
                        r->path);
    return PVX_OK;
}

/* Only this part of the picture is used. */
static pvx_err cine_part(struct cine *c, const char *why, const int64_t part[4], struct pvx_diag *d)
{
    struct cap_raw *r = c->r;
    if (part[0] < 0 || part[1] < 0 || part[2] < 1 || part[3] < 1 || part[0] + part[2] > r->width ||
        part[1] + part[3] > r->height)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: %s: %lldx%lld pixels at (%lld,%lld), which lie outside its %dx%d: "
                        "save it without",
                        r->path, why, (long long)part[2], (long long)part[3], (long long)part[0],
                        (long long)part[1], r->width, r->height);
    if (r->mirror_x || r->mirror_y || r->quarters != 0)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: %s, and it is to be turned or mirrored: it does not say which comes "
                        "first: save it with one of them",
                        r->path, why);
    r->left = (int32_t)part[0];
    r->top = (int32_t)part[1];
    r->wide = (int32_t)part[2];
    r->high = (int32_t)part[3];
    return cap_said_add(&r->said, "%s: %s: %dx%d pixels at (%d,%d) of %dx%d", r->path, why, r->wide,
                        r->high, r->left, r->top, r->width, r->height);
}

static pvx_err cine_crop(struct cine *c, struct pvx_diag *d)
{
    struct cap_raw *r = c->r;
    int64_t box[4], part[4];
    for (unsigned i = 0; i < 4; i++) {
        part[i] = cine_setup(c, SETUP_ACQUIRED + 4 * i);
        box[i] = (int32_t)cine_setup(c, SETUP_CROP + 4 + 4 * i);
    }
    bool beside = part[2] > 0 && part[3] > 0 && part[2] <= r->width && part[3] <= r->height &&
                  (part[2] < r->width || part[3] < r->height);
    bool cropped = cine_setup(c, SETUP_CROP) != 0;
    if (cine_setup(c, SETUP_RESAMPLE) != 0)
        PVX_TRY(cap_said_add(
            &r->said, "%s: is to be shown with %ux%u pixels; it comes with those it has", r->path,
            cine_setup(c, SETUP_RESAMPLE + 4), cine_setup(c, SETUP_RESAMPLE + 8)));
    const int64_t crop[4] = {box[0], box[1], box[2] - box[0] + 1, box[3] - box[1] + 1};
    bool done = crop[2] == r->width && crop[3] == r->height; /* when it was saved */
    if (cropped && !done)
        return cine_part(c, "is to be cropped", crop, d);
    return beside ? cine_part(c, "has text beside the picture", part, d) : PVX_OK;
}

static pvx_err cine_levels(struct cine *c)
{
    struct cap_raw *r = c->r;
    int32_t black = (int32_t)cine_setup(c, SETUP_BLACK),
            white = (int32_t)cine_setup(c, SETUP_WHITE), full = (1 << r->depth) - 1;
    if (black <= 0 || black >= full || r->code == CAP_RAW_8)
        return PVX_OK;
    return cap_said_add(&r->said,
                        "%s: black is %d and white %d of %d; samples come as they are: take darks, "
                        "or say --black %.4f",
                        r->path, black, white, full, (double)black / full);
}

static pvx_err cine_pixels(struct cine *c, struct pvx_diag *d)
{
    struct cap_raw *r = c->r;
    int64_t w = (int32_t)cine_u32(c->bitmap + 4), h = (int32_t)cine_u32(c->bitmap + 8);
    PVX_TRY(cine_packing(c, d));
    if (h < 0) /* of a bitmap: from the top down */
        r->bottom_up = false;
    h = h < 0 ? -h : h;
    if (w < 1 || h < 1)
        return pvx_fail(d, PVX_ECORRUPT, "%s: says that its images have no pixels", r->path);
    PVX_TRY(cap_picture_fits((uint32_t)(w < INT32_MAX ? w : INT32_MAX),
                             (uint32_t)(h < INT32_MAX ? h : INT32_MAX), r->bytes, r->path, d));
    r->width = (int32_t)w;
    r->height = (int32_t)h;
    PVX_TRY(cine_depth(c));
    PVX_TRY(cine_colours(c, d));
    PVX_TRY(cine_turn(c, d));
    PVX_TRY(cine_crop(c, d));
    return cine_levels(c);
}

/* ---- frames ----------------------------------------------------------------------------------- */

/* The tagged blocks, between SETUP and the offsets of the images. */
static void cine_tags(struct cine *c)
{
    const struct cap_raw *r = c->r;
    uint64_t at = cine_u32(c->head + HEAD_SETUP) + (uint64_t)cine_u16(c->setup + SETUP_LENGTH);
    uint64_t end = cine_u32(c->head + HEAD_OFFSETS);
    uint64_t all = cine_u32(c->head + HEAD_TOTAL);
    uint8_t b[8];
    while (at + sizeof b <= end && cap_raw_get(r, at, b, sizeof b)) {
        uint64_t size = cine_u32(b);
        if (size < sizeof b || at + size > end || at + size > r->bytes)
            return;
        if (cine_u16(b + 4) == TAG_TIME && size - 8 >= 8ull * c->count)
            c->times = at + 8;
        if (cine_u16(b + 4) == TAG_TIME_TOTAL && size - 8 >= 8 * all)
            c->total = at + 8;
        if (cine_u16(b + 4) == TAG_EXPOSURE && size - 8 >= 4ull * c->count)
            c->exposures = at + 8;
        at += size;
    }
}

/* The part of the array of `size` bytes an entry that is in the file; *n: how many entries. */
static pvx_err cine_array(const struct cine *c, uint64_t at, unsigned size, uint8_t **out,
                          uint64_t *n, struct pvx_diag *d)
{
    uint64_t fit = at < c->r->bytes ? (c->r->bytes - at) / size : 0;
    *n = *n < fit ? *n : fit;
    *out = pvx_calloc((size_t)*n + 1, size);
    if (*out == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for its %llu images", c->r->path,
                        (unsigned long long)*n);
    return cap_raw_get(c->r, at, *out, (size_t)*n * size) ? PVX_OK : cine_cut(c, "list", d);
}

/* The first image tells how many bytes all have.  *head: of its annotation. */
static pvx_err cine_first(struct cine *c, const uint8_t *offset, unsigned size, uint64_t n,
                          uint64_t *head, struct pvx_diag *d)
{
    struct cap_raw *r = c->r;
    uint8_t b[4];
    for (uint64_t k = 0; k < n; k++) {
        uint64_t at = size == 8 ? cine_u64(offset + k * 8) : cine_u32(offset + k * 4);
        if (at == 0 || !cap_raw_get(r, at, b, sizeof b) || cine_u32(b) < 8)
            continue;
        *head = cine_u32(b);
        if (!cap_raw_get(r, at + *head - 4, b, sizeof b))
            continue;
        r->frame_bytes = cine_u32(b);
        return PVX_OK;
    }
    return pvx_fail(d, PVX_ECORRUPT,
                    "%s: none of its %u images is in it: cut, or not saved to its end", r->path,
                    c->count);
}

static pvx_err cine_whole(struct cine *c, struct pvx_diag *d)
{
    struct cap_raw *r = c->r;
    unsigned size = cine_u16(c->head + HEAD_VERSION) == 0 ? 4 : 8;
    int64_t first = (int32_t)cine_u32(c->head + HEAD_FIRST);
    uint64_t n = c->count, head = 0;
    uint8_t *offset = NULL;
    if (c->count == 0)
        return pvx_fail(d, PVX_EFORMAT, "%s: no image in it", r->path);
    pvx_err e = cine_array(c, cine_u32(c->head + HEAD_OFFSETS), size, &offset, &n, d);
    PVX_THEN(e, cine_first(c, offset, size, n, &head, d));
    if (e == PVX_OK && (r->frame = pvx_calloc((size_t)n, sizeof *r->frame)) == NULL)
        e = pvx_fail(d, PVX_ENOMEM, "%s: no memory for its %u images", r->path, c->count);
    for (uint64_t k = 0; k < n && e == PVX_OK; k++) {
        uint64_t at = size == 8 ? cine_u64(offset + k * 8) : cine_u32(offset + k * 4);
        if (at != 0 && at <= r->bytes && r->bytes - at >= head + r->frame_bytes)
            r->frame[r->n++] =
                (struct cap_raw_frame){at, (int64_t)k, (int32_t)(first + (int64_t)k)};
    }
    free(offset);
    PVX_TRY(e);
    if (r->n == 0)
        return pvx_fail(d, PVX_ECORRUPT, "%s: none of its %u images is whole: cut", r->path,
                        c->count);
    return r->n == c->count ? PVX_OK
                            : cap_said_add(&r->said,
                                           "%s: %zu of its %u images are not whole: it is cut, or "
                                           "was not saved to its end; they are left out",
                                           r->path, c->count - r->n, c->count);
}

/* Of a time in 2^-32 s.  The lowest two bits of a fraction are signals, not time. */
static int64_t cine_ns(uint64_t time, uint64_t trigger)
{
    __int128 t = (__int128)(time & ~3ull) - (__int128)(trigger & ~3ull), unit = (__int128)1 << 32;
    t = t * 1000000000 + unit / 2;
    t = t >= 0 ? t / unit : -((-t + unit - 1) / unit);
    return t > INT64_MAX / 4 ? INT64_MAX / 4 : t < -INT64_MAX / 4 ? -INT64_MAX / 4 : (int64_t)t;
}

/* Times by the camera's clock.  *known: there are such, and they are of a running clock. */
static pvx_err cine_clock(struct cine *c, bool *known, struct pvx_diag *d)
{
    struct cap_raw *r = c->r;
    uint64_t trigger = cine_u64(c->head + HEAD_TRIGGER), n = c->count, skip = 0;
    uint64_t at = c->times;
    uint8_t *time;
    int64_t before = (int32_t)cine_u32(c->head + HEAD_FIRST) -
                     (int64_t)(int32_t)cine_u32(c->head + HEAD_FIRST_MOVIE);
    *known = false;
    if (at == 0 && c->total != 0 && before >= 0 &&
        (uint64_t)before + n <= cine_u32(c->head + HEAD_TOTAL)) {
        at = c->total;
        skip = (uint64_t)before;
    }
    if (at == 0 || trigger == 0)
        return PVX_OK;
    PVX_TRY(cine_array(c, at + 8 * skip, 8, &time, &n, d));
    if (n == c->count && (n < 2 || cine_u64(time) != cine_u64(time + 8 * (n - 1)))) {
        *known = true;
        for (size_t i = 0; i < r->n; i++)
            r->frame[i].t_ns = cine_ns(cine_u64(time + 8 * r->frame[i].t_ns), trigger);
    }
    free(time);
    return PVX_OK;
}

static pvx_err cine_times(struct cine *c, struct pvx_diag *d)
{
    struct cap_raw *r = c->r;
    bool known;
    PVX_TRY(cine_clock(c, &known, d));
    if (!known && !(c->rate > 0))
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: has neither the times of its images nor their rate: save it again "
                        "with its times",
                        r->path);
    if (!known && fabs((double)INT32_MIN * (1e9 / c->rate)) > (double)(INT64_MAX / 4))
        return pvx_fail(d, PVX_ERANGE, "%s: %.4g images a second are too few for a clock", r->path,
                        c->rate);
    if (!known) {
        for (size_t i = 0; i < r->n; i++)
            r->frame[i].t_ns = (int64_t)(r->frame[i].number * (1e9 / c->rate));
        PVX_TRY(cap_said_add(&r->said,
                             "%s: has no times of its images: they follow from their numbers and "
                             "%.6g images a second",
                             r->path, c->rate));
    }
    for (size_t i = 1; i < r->n; i++)
        if (r->frame[i].t_ns <= r->frame[i - 1].t_ns)
            return pvx_fail(d, PVX_ECORRUPT,
                            "%s: image %d is not after image %d by their times: its clock was set; "
                            "save the images before and after that as two files",
                            r->path, r->frame[i].number, r->frame[i - 1].number);
    return PVX_OK;
}

/* Say where exposures differ: the camera has controlled them. */
static pvx_err cine_exposure(struct cine *c, struct pvx_diag *d)
{
    uint8_t *exposure;
    uint64_t n = c->count;
    uint32_t least = UINT32_MAX, most = 0;
    c->r->exposure_s[0] = c->r->exposure_s[1] = cine_setup(c, SETUP_SHUTTER_NS) * 1e-9;
    if (c->exposures == 0)
        return PVX_OK;
    PVX_TRY(cine_array(c, c->exposures, 4, &exposure, &n, d));
    for (uint64_t k = 0; k < n; k++) {
        uint32_t v = cine_u32(exposure + 4 * k);
        least = v < least ? v : least;
        most = v > most ? v : most;
    }
    free(exposure);
    c->r->exposure_s[0] = least * 0x1p-32;
    c->r->exposure_s[1] = most * 0x1p-32;
    return most <= least * VARIES
               ? PVX_OK
               : cap_said_add(&c->r->said,
                              "%s: its exposures go from %.4g to %.4g us: equal light gives "
                              "samples that differ by as much; record with a fixed exposure",
                              c->r->path, least * (1e6 / 0x1p32), most * (1e6 / 0x1p32));
}

pvx_err cap_cine_read(struct cap_raw *r, struct pvx_diag *d)
{
    struct cine c = {.r = r};
    r->headed = true;
    PVX_TRY(cine_headers(&c, d));
    PVX_TRY(cine_pixels(&c, d));
    PVX_TRY(cine_whole(&c, d));
    cine_tags(&c);
    PVX_TRY(cine_times(&c, d));
    return cine_exposure(&c, d);
}
