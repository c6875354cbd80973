/* avi.h - an uncompressed AVI, RIFF chunks written by hand. */
#ifndef TESTS_AVI_H
#define TESTS_AVI_H
#include <stdint.h>
#include <stdio.h>

static inline void avi_u32(FILE *f, uint32_t v)
{
    for (int i = 0; i < 4; i++)
        fputc((int)(v >> 8 * i & 255), f);
}
static inline void avi_chunk(FILE *f, const char *id, uint32_t size)
{
    fwrite(id, 1, 4, f);
    avi_u32(f, size);
}

/* Then that many avi_frame(), and fclose(); w a multiple of 4.  NULL: it cannot be written. */
static inline FILE *avi_begin(const char *path, uint32_t w, uint32_t h, uint32_t frames,
                              uint32_t fps)
{
    FILE *f = fopen(path, "wb");
    if (f == NULL)
        return NULL;
    uint32_t bytes = 3 * w * h, hdrl = 4 + 8 + 56 + 12 + 8 + 56 + 8 + 40;
    uint32_t movi = 4 + frames * (8 + bytes);
    avi_chunk(f, "RIFF", 4 + 8 + hdrl + 8 + movi);
    fwrite("AVI ", 1, 4, f);
    avi_chunk(f, "LIST", hdrl);
    fwrite("hdrl", 1, 4, f);
    avi_chunk(f, "avih", 56);
    const uint32_t avih[14] = {1000000 / fps, 0, 0, 0, frames, 0, 1, bytes, w, h};
    for (int i = 0; i < 14; i++)
        avi_u32(f, avih[i]);
    avi_chunk(f, "LIST", 4 + 8 + 56 + 8 + 40);
    fwrite("strl", 1, 4, f);
    avi_chunk(f, "strh", 56);
    fwrite("vidsDIB ", 1, 8, f);
    const uint32_t strh[12] = {0, 0, 0, 1, fps, 0, frames, bytes, 0, 0, 0, w | h << 16};
    for (int i = 0; i < 12; i++)
        avi_u32(f, strh[i]);
    avi_chunk(f, "strf", 40);
    const uint32_t strf[10] = {40, w, h, 1 | 24 << 16, 0, bytes};
    for (int i = 0; i < 10; i++)
        avi_u32(f, strf[i]);
    avi_chunk(f, "LIST", movi);
    fwrite("movi", 1, 4, f);
    return f;
}

/* rgb [h][w][3]; stored from the lowest row up, blue first. */
static inline void avi_frame(FILE *f, const uint8_t *rgb, uint32_t w, uint32_t h)
{
    avi_chunk(f, "00db", 3 * w * h);
    for (uint32_t y = h; y-- > 0;)
        for (uint32_t x = 0; x < w; x++)
            for (int c = 3; c-- > 0;)
                fputc(rgb[3 * (y * w + x) + (uint32_t)c], f);
}
#endif
