#include "capture/files/raw.h"

#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/file.h"
#include "base/mem.h"
#include "capture/files/sequence.h"
#include "capture/files/tiff.h"

#define SLACK 8 /* bytes that may be read beyond the last packed sample */
#define AHEAD 4 /* frames that the kernel reads while this one is used */

bool cap_raw_get(const struct cap_raw *r, uint64_t at, void *to, size_t size)
{
    return cap_bytes_get(&(struct cap_bytes){NULL, r->bytes, r->fd}, at, to, size);
}

/* ---- layout ----------------------------------------------------------------------------------- */

static unsigned raw_bits(const struct cap_raw *r)
{
    static const unsigned bits[] = {
        [CAP_RAW_8] = 8, [CAP_RAW_10_TABLE] = 10, [CAP_RAW_12] = 12, [CAP_RAW_16] = 16};
    return bits[r->code];
}

/* Rows follow each other without a gap, or begin at bytes (packed) or at multiples of four bytes: the size of a frame
 * tells which. */
static pvx_err raw_rows(struct cap_raw *r, struct pvx_diag *d)
{
    uint64_t bits = raw_bits(r) * (uint64_t)r->width, rows = (uint64_t)r->height;
    uint64_t of_bytes = (bits + 7) / 8, of_words = (of_bytes + 3) / 4 * 4;
    r->row_bits = r->frame_bytes == (bits * rows + 7) / 8 ? bits
                  : r->frame_bytes == of_bytes * rows     ? of_bytes * 8
                  : r->frame_bytes == of_words * rows     ? of_words * 8
                                                          : 0;
    if (r->row_bits > 0)
        return PVX_OK;
    return pvx_fail(d, PVX_ECORRUPT,
                    "%s: a frame has %llu bytes, but %dx%d pixels of %u bits have %llu: its header "
                    "and its frames do not belong together",
                    r->path, (unsigned long long)r->frame_bytes, r->width, r->height, raw_bits(r),
                    (unsigned long long)((bits * rows + 7) / 8));
}

/* Where the pixels of the part come to lie in the picture. */
static void raw_turn(struct cap_raw *r)
{
    bool lying = r->quarters % 2 != 0;
    int32_t w = r->out_width = lying ? r->high : r->wide;
    r->out_height = lying ? r->wide : r->high;
    /* x and y of the step to the right and down in the part; a quarter counterclockwise takes (x, y) to (y, -x) */
    int rx = r->mirror_x ? -1 : 1, ry = 0, dx = 0, dy = r->mirror_y ? -1 : 1;
    for (int k = 0; k < r->quarters; k++) {
        int x = rx;
        rx = ry;
        ry = -x;
        x = dx;
        dx = dy;
        dy = -x;
    }
    r->right = rx + (ptrdiff_t)ry * w;
    r->down = dx + (ptrdiff_t)dy * w;
    r->first = (r->right < 0 ? -r->right * (r->wide - 1) : 0) +
               (r->down < 0 ? -r->down * (r->high - 1) : 0);
}

/* The colour filter of the picture's first 2x2 pixels; grey: NONE. */
static enum cap_pixfmt raw_mosaic(const struct cap_raw *r)
{
    static const char *const order[] = {"RGGB", "GRBG", "GBRG", "BGGR"};
    char cell[5] = "";
    for (int32_t y = 0; y < 2; y++)
        for (int32_t x = 0; x < 2; x++) {
            /* a pixel of the same place in its 2x2 cell, inside the part */
            ptrdiff_t at = r->first + x * r->right + y * r->down;
            ptrdiff_t across = at % r->out_width, down = at / r->out_width;
            cell[down % 2 * 2 + across % 2] = r->cell[(y + r->top) % 2 * 2 + (x + r->left) % 2];
        }
    for (int k = 0; k < 4; k++)
        if (memcmp(cell, order[k], 4) == 0)
            return (enum cap_pixfmt)(CAP_BAYER_RG8 + k);
    return CAP_FMT_NONE;
}

static pvx_err raw_format(struct cap_raw *r, struct pvx_diag *d)
{
    int depth = r->depth == 8 && r->code == CAP_RAW_8                ? 8
                : r->depth == 10 || r->depth == 12 || r->depth == 14 ? r->depth
                                                                     : 16;
    bool cells = r->wide >= 2 && r->high >= 2;
    enum cap_pixfmt of_8 = r->cell[0] == 0 ? CAP_GREY8 : cells ? raw_mosaic(r) : CAP_FMT_NONE;
    static const struct {
        int depth;
        enum cap_pixfmt grey, bayer;
    } to[] = {{8, CAP_GREY8, CAP_BAYER_RG8},
              {10, CAP_GREY10, CAP_BAYER_RG10},
              {12, CAP_GREY12, CAP_BAYER_RG12},
              {14, CAP_GREY14, CAP_BAYER_RG14},
              {16, CAP_GREY16, CAP_BAYER_RG16}};
    for (size_t i = 0; i < sizeof to / sizeof to[0] && of_8 != CAP_FMT_NONE; i++)
        if (to[i].depth == depth)
            r->fmt = of_8 == CAP_GREY8 ? to[i].grey
                                       : (enum cap_pixfmt)(to[i].bayer + (of_8 - CAP_BAYER_RG8));
    if (r->fmt == CAP_FMT_NONE)
        return pvx_fail(d, PVX_EUNSUP, "%s: its colour filter (%.4s) is no Bayer pattern", r->path,
                        r->cell);
    return PVX_OK;
}

static pvx_err raw_room(struct cap_raw *r, struct pvx_diag *d)
{
    if (r->wide == 0) {
        r->wide = r->width;
        r->high = r->height;
    }
    PVX_TRY(raw_rows(r, d));
    raw_turn(r);
    PVX_TRY(raw_format(r, d));
    r->in = pvx_calloc((size_t)r->frame_bytes + SLACK, 1);
    r->out = pvx_calloc(cap_pixfmt_image(r->fmt, r->out_width, r->out_height), 1);
    r->row = pvx_calloc((size_t)r->wide, sizeof *r->row);
    return r->in != NULL && r->out != NULL && r->row != NULL
               ? PVX_OK
               : pvx_fail(d, PVX_ENOMEM, "%s: no memory for its pictures", r->path);
}

static pvx_err raw_begin(struct cap_raw *r, struct pvx_diag *d)
{
    struct stat st;
    PVX_TRY(pvx_file_open(r->path, &r->fd, d));
    if (fstat(r->fd, &st) != 0 || !S_ISREG(st.st_mode))
        return pvx_fail(d, PVX_EFORMAT, "%s: is no file", r->path);
    r->bytes = (uint64_t)st.st_size;
    PVX_TRY(cap_is_cine(r->path) ? cap_cine_read(r, d) : cap_mraw_read(r, d));
    return raw_room(r, d);
}

/* The .mraw that belongs to a .cih or .cihx.  NULL: no memory. */
static char *raw_film_of(const char *path)
{
    const char *dot = strrchr(path, '.');
    char *out = NULL;
    static const char *const ending[] = {".mraw", ".MRAW", ".Mraw"};
    if (cap_is_video(path))
        return strdup(path);
    for (size_t i = 0; i < sizeof ending / sizeof ending[0]; i++) {
        free(out);
        if (asprintf(&out, "%.*s%s", (int)(dot - path), path, ending[i]) < 0)
            return NULL;
        if (access(out, F_OK) == 0)
            return out;
    }
    free(out);
    return asprintf(&out, "%.*s.mraw", (int)(dot - path), path) < 0 ? NULL : out;
}

pvx_err cap_raw_open(const char *path, struct cap_raw *r, struct pvx_diag *d)
{
    *r = (struct cap_raw){.fd = -1, .path = raw_film_of(path)};
    return r->path != NULL ? raw_begin(r, d)
                           : pvx_fail(d, PVX_ENOMEM, "%s: no memory for a recording", path);
}

void cap_raw_close(struct cap_raw *r)
{
    if (r->path == NULL)
        return;
    if (r->fd >= 0)
        close(r->fd);
    free(r->path);
    free(r->frame);
    free(r->said);
    free(r->in);
    free(r->out);
    free(r->row);
    *r = (struct cap_raw){.fd = -1};
}

/* ---- frames ----------------------------------------------------------------------------------- */

/* n pairs of 12 bits in 3 bytes, and n fours of 10 bits in 5. */
static void raw_pairs(const uint8_t *restrict p, int32_t n, uint16_t *restrict out)
{
    for (int32_t i = 0; i < n; i++, p += 3, out += 2) {
        out[0] = (uint16_t)(p[0] << 4 | p[1] >> 4);
        out[1] = (uint16_t)((p[1] & 15) << 8 | p[2]);
    }
}

static void raw_fours(const uint8_t *restrict p, int32_t n, uint16_t *restrict out)
{
    for (int32_t i = 0; i < n; i++, p += 5, out += 4) {
        out[0] = (uint16_t)(p[0] << 2 | p[1] >> 6);
        out[1] = (uint16_t)((p[1] & 63) << 4 | p[2] >> 4);
        out[2] = (uint16_t)((p[2] & 15) << 6 | p[3] >> 2);
        out[3] = (uint16_t)((p[3] & 3) << 8 | p[4]);
    }
}

/* Samples of 10 or 12 bits from bit `at` on, the highest bit first. */
static void raw_packed(const uint8_t *in, uint64_t at, unsigned bits, int32_t n, uint16_t *out)
{
    const uint32_t mask = (1u << bits) - 1;
    int32_t x = at % 8 != 0 ? 0 : bits == 12 ? n / 2 * 2 : n / 4 * 4; /* whole groups */
    if (x > 0 && bits == 12)
        raw_pairs(in + at / 8, x / 2, out);
    else if (x > 0)
        raw_fours(in + at / 8, x / 4, out);
    for (at += (uint64_t)x * bits; x < n; x++, at += bits) {
        const uint8_t *p = in + at / 8;
        uint32_t v = (uint32_t)p[0] << 16 | (uint32_t)p[1] << 8 | p[2];
        out[x] = (uint16_t)(v >> (24 - at % 8 - bits) & mask);
    }
}

/* Row y of the part: r->row. */
static void raw_row(const struct cap_raw *r, int32_t y)
{
    int32_t stored = r->bottom_up ? r->height - 1 - (y + r->top) : y + r->top, n = r->wide;
    unsigned bits = raw_bits(r);
    uint64_t at = (uint64_t)stored * r->row_bits + (uint64_t)r->left * bits;
    const uint8_t *p = r->in + at / 8;
    uint16_t *row = r->row;
    if (r->code == CAP_RAW_8)
        for (int32_t x = 0; x < n; x++)
            row[x] = p[x];
    else if (r->code == CAP_RAW_16)
        memcpy(row, p, (size_t)n * 2);
    else
        raw_packed(r->in, at, bits, n, row);
    for (int32_t x = 0; x < n && r->code == CAP_RAW_10_TABLE; x++)
        row[x] = r->table[row[x]];
    for (int32_t x = 0; x < n && r->shift > 0; x++)
        row[x] = (uint16_t)(row[x] >> r->shift);
    if (r->code == CAP_RAW_8 || r->depth == cap_pixfmt_depth(r->fmt))
        return;
    uint32_t most = (1u << r->depth) - 1;
    for (int32_t x = 0; x < n; x++)
        row[x] = row[x] < most ? (uint16_t)((row[x] * 65535u + most / 2) / most) : UINT16_MAX;
}

static void raw_place(const struct cap_raw *r, int32_t y)
{
    ptrdiff_t at = r->first + y * r->down, step = r->right;
    if (cap_pixfmt_depth(r->fmt) == 8)
        for (int32_t x = 0; x < r->wide; x++)
            r->out[at + x * step] = (uint8_t)r->row[x];
    else if (step == 1)
        memcpy((uint16_t *)(void *)r->out + at, r->row, (size_t)r->wide * 2);
    else
        for (int32_t x = 0; x < r->wide; x++)
            ((uint16_t *)(void *)r->out)[at + x * step] = r->row[x];
}

/* Where the pixels of frame i begin.  Its annotation ends with the number of bytes that they have. */
static pvx_err raw_find(const struct cap_raw *r, size_t i, uint64_t *at, struct pvx_diag *d)
{
    uint8_t b[4];
    uint32_t head = 0, size = 0;
    *at = r->frame[i].at;
    if (!r->headed)
        return PVX_OK;
    if (cap_raw_get(r, *at, b, sizeof b))
        head = (uint32_t)b[0] | (uint32_t)b[1] << 8 | (uint32_t)b[2] << 16 | (uint32_t)b[3] << 24;
    if (head >= 8 && cap_raw_get(r, *at + head - 4, b, sizeof b))
        size = (uint32_t)b[0] | (uint32_t)b[1] << 8 | (uint32_t)b[2] << 16 | (uint32_t)b[3] << 24;
    *at += head;
    if (size == r->frame_bytes)
        return PVX_OK;
    return pvx_fail(d, PVX_ECORRUPT,
                    "%s: image %d: its header says that it has %u bytes, where the others have "
                    "%llu: damaged; save the recording again without it",
                    r->path, r->frame[i].number, size, (unsigned long long)r->frame_bytes);
}

pvx_err cap_raw_load(struct cap_raw *r, size_t i, struct cap_image *img, struct pvx_diag *d)
{
    uint64_t at;
    PVX_TRY(raw_find(r, i, &at, d));
    if (!cap_raw_get(r, at, r->in, (size_t)r->frame_bytes))
        return pvx_fail(d, PVX_ECORRUPT, "%s: image %d is cut, or cannot be read", r->path,
                        r->frame[i].number);
    if (i + 1 < r->n) /* a hint: while this frame is used, the next ones come */
        (void)posix_fadvise(r->fd, (off_t)r->frame[i + 1].at, (off_t)(AHEAD * r->frame_bytes),
                            POSIX_FADV_WILLNEED);
    for (int32_t y = 0; y < r->high; y++) {
        raw_row(r, y);
        raw_place(r, y);
    }
    size_t row = cap_pixfmt_row(r->fmt, r->out_width);
    *img = (struct cap_image){.data = r->out,
                              .size = row * (size_t)r->out_height,
                              .width = r->out_width,
                              .height = r->out_height,
                              .stride = (ptrdiff_t)row,
                              .fmt = r->fmt};
    return PVX_OK;
}
