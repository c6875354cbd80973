/* raw_file.h - writes .cine, .mraw and .cih files as cameras do, with pixels that are known. */
#ifndef TESTS_RAW_FILE_H
#define TESTS_RAW_FILE_H
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { RAW_SETUP = 10408, RAW_FIRST_AT = 44 + 40 };

/* Sample (x, y) of image k, from the top left, as the file has it. */
typedef unsigned raw_sample(int k, int x, int y);

struct cine_file {
    int w, h, n, first;
    unsigned bits; /* 8, 10, 12 (packed) or 16 */
    unsigned compression, version, cfa, real_bpp, levels, setup;
    int flip_h, flip_v, rotate;
    int crop[5], acquired[4], resample[3];
    int black, white, meta_wb;
    float wb[2];
    double rate;
    unsigned annotation;           /* bytes in each, beyond 8 */
    uint64_t trigger, begin, step; /* 2^-32 s; step 0: no times */
    unsigned tag;                  /* 1002, or 1001 with two images before and one after */
    unsigned exposure[2];          /* of even and odd images; 0: none */
    unsigned pad;                  /* bytes to which rows are rounded; 0: 1 */
    uint32_t packing;              /* another than `bits` means */
    raw_sample *sample;
};

struct raw_bytes {
    uint8_t *p;
    size_t n, room;
};

static inline uint8_t *raw_more(struct raw_bytes *b, size_t n)
{
    if (b->n + n > b->room) {
        b->room = 2 * (b->n + n);
        b->p = realloc(b->p, b->room);
        if (b->p == NULL)
            abort();
    }
    memset(b->p + b->n, 0, n);
    b->n += n;
    return b->p + b->n - n;
}

static inline void raw_put(uint8_t *p, uint64_t v, int bytes)
{
    for (int i = 0; i < bytes; i++)
        p[i] = (uint8_t)(v >> 8 * i);
}

/* How samples lie: packed rows follow each other without a gap where pad, the bytes to which rows are rounded, is 1. */
struct raw_layout {
    int w, h;
    unsigned bits, pad;
    bool bottom_up;
};

static inline void raw_image(struct raw_bytes *b, raw_sample *sample, int k,
                             const struct raw_layout *l)
{
    size_t pad = l->pad > 0 ? l->pad : 1, bits = l->bits, w = (size_t)l->w, h = (size_t)l->h;
    size_t row = ((w * bits + 7) / 8 + pad - 1) / pad * pad * 8; /* bits */
    row = pad == 1 ? w * bits : row;
    uint8_t *p = raw_more(b, (row * h + 7) / 8);
    for (int y = 0; y < l->h; y++)
        for (int x = 0; x < l->w; x++) {
            size_t bit = (size_t)(l->bottom_up ? l->h - 1 - y : y) * row + (size_t)x * bits;
            unsigned v = sample(k, x, y);
            if (bits == 8 || bits == 16)
                raw_put(p + bit / 8, v, (int)bits / 8);
            else
                for (unsigned i = 0; i < bits; i++, bit++)
                    p[bit / 8] |= (uint8_t)((v >> (bits - 1 - i) & 1) << (7 - bit % 8));
        }
}

static inline struct raw_bytes cine_make(const struct cine_file *c)
{
    struct raw_bytes b = {0};
    unsigned setup = c->setup > 0 ? c->setup : RAW_SETUP;
    uint8_t s[RAW_SETUP] = {0}, *p;
    int before = c->tag == 1001 ? 2 : 0, total = c->n + before + (c->tag == 1001);
    raw_more(&b, RAW_FIRST_AT);
    memcpy(b.p, "CI", 2);
    raw_put(b.p + 2, 44, 2);
    raw_put(b.p + 4, c->compression, 2);
    raw_put(b.p + 6, c->version, 2);
    raw_put(b.p + 8, (uint64_t)(c->first - before), 4);
    raw_put(b.p + 12, (uint64_t)total, 4);
    raw_put(b.p + 16, (uint64_t)c->first, 4);
    raw_put(b.p + 20, (uint64_t)c->n, 4);
    raw_put(b.p + 24, 44, 4);
    raw_put(b.p + 28, RAW_FIRST_AT, 4);
    raw_put(b.p + 36, c->trigger, 8);
    raw_put(b.p + 44, 40, 4);
    raw_put(b.p + 48, (uint64_t)c->w, 4);
    raw_put(b.p + 52, (uint64_t)c->h, 4);
    raw_put(b.p + 56, 1, 2);
    raw_put(b.p + 58, c->bits == 8 ? 8 : 16, 2);
    raw_put(b.p + 60,
            c->packing != 0 ? c->packing
            : c->bits == 10 ? 0x100
            : c->bits == 12 ? 0x400
                            : 0,
            4);
    raw_put(b.p + 80, c->levels, 4);
    memcpy(s + 140, "ST", 2);
    raw_put(s + 142, setup, 2);
    raw_put(s + 756, (uint64_t)c->flip_h, 4);
    raw_put(s + 760, (uint64_t)c->flip_v, 4);
    raw_put(s + 768, (uint64_t)c->rate, 4);
    raw_put(s + 808, c->cfa, 4);
    memcpy(s + 852, c->wb, sizeof c->wb);
    raw_put(s + 884, (uint64_t)c->rotate, 4);
    raw_put(s + 896, c->real_bpp, 4);
    for (int i = 0; i < 4; i++)
        raw_put(s + 1580 + 4 * i, (uint64_t)c->acquired[i], 4);
    raw_put(s + 5724, (uint64_t)c->meta_wb, 4);
    raw_put(s + 5732, (uint64_t)c->black, 4);
    raw_put(s + 5736, (uint64_t)c->white, 4);
    for (int i = 0; i < 5; i++)
        raw_put(s + 6868 + 4 * i, (uint64_t)c->crop[i], 4);
    for (int i = 0; i < 3; i++)
        raw_put(s + 6888 + 4 * i, (uint64_t)c->resample[i], 4);
    memcpy(s + 10400, &c->rate, sizeof c->rate);
    memcpy(raw_more(&b, setup), s, setup < RAW_SETUP ? setup : RAW_SETUP);
    if (c->step != 0) {
        int items = c->tag == 1001 ? total : c->n;
        p = raw_more(&b, 8 + 8 * (size_t)items);
        raw_put(p, 8 + 8 * (uint64_t)items, 4);
        raw_put(p + 4, c->tag, 2);
        for (int k = 0; k < items; k++)
            raw_put(p + 8 + 8 * k, (c->begin + (uint64_t)(k - before) * c->step) | 3, 8);
    }
    if (c->exposure[0] != 0) {
        p = raw_more(&b, 8 + 4 * (size_t)c->n);
        raw_put(p, 8 + 4 * (uint64_t)c->n, 4);
        raw_put(p + 4, 1003, 2);
        for (int k = 0; k < c->n; k++)
            raw_put(p + 8 + 4 * k, c->exposure[k % 2], 4);
    }
    size_t list = b.n, item = c->version == 0 ? 4 : 8;
    raw_put(b.p + 32, list, 4);
    raw_more(&b, item * (size_t)c->n);
    for (int k = 0; k < c->n; k++) {
        raw_put(b.p + list + item * (size_t)k, b.n, (int)item);
        size_t at = b.n;
        raw_more(&b, 8 + c->annotation);
        raw_put(b.p + at, 8 + c->annotation, 4);
        raw_image(&b, c->sample, k,
                  &(struct raw_layout){c->w, c->h, c->bits, c->pad, c->bits == 8 || c->bits == 16});
        raw_put(b.p + at + 4 + c->annotation, b.n - at - 8 - c->annotation, 4);
    }
    return b;
}

static inline void raw_save(const char *path, const void *bytes, size_t n)
{
    FILE *f = fopen(path, "wb");
    if (f == NULL || fwrite(bytes, 1, n, f) != n || fclose(f) != 0)
        exit(1); /* no disk: nothing here makes sense */
}

static inline void cine_save(const char *path, const struct cine_file *c)
{
    struct raw_bytes b = cine_make(c);
    raw_save(path, b.p, b.n);
    free(b.p);
}

static inline void mraw_save(const char *path, raw_sample *sample, int w, int h, int n,
                             unsigned bits)
{
    struct raw_bytes b = {0};
    for (int k = 0; k < n; k++)
        raw_image(&b, sample, k, &(struct raw_layout){w, h, bits, 1, false});
    raw_save(path, b.p, b.n);
    free(b.p);
}
#endif
