/* pixfmt_priv.h - shared by the files of cap_convert: its checked arguments and its implementations.
 *
 * cap_pix_ref handles every case, sample by sample, and is the specification.  The others are fast, handle the cases
 * that their comments name, and give the same bits (tests/check/test_pixels.c). */
#ifndef CAP_PIXFMT_PRIV_H
#define CAP_PIXFMT_PRIV_H
#include <math.h>
#include <stdbool.h>
#include <string.h>
#include "base/cpu.h"
#include "capture/pixel/pixfmt.h"

#define CAP_PIX_INLINE static inline __attribute__((always_inline))

typedef float cap_f4 __attribute__((vector_size(16), aligned(4), may_alias));
typedef int32_t cap_i4 __attribute__((vector_size(16), aligned(4), may_alias));

/* Equation (2) of pixfmt.h in steps of 1/4095, in lanes R' G' B' -:  y Y + cb Cb + cr Cr + at0, truncated to an
 * integer (at0 includes the half for rounding).  Error of the float arithmetic: less than 0.001 of a step. */
struct cap_yuv_coef {
    cap_f4 y, cb, cr, at0;
};

struct cap_pix {
    struct cap_image img;
    int binning, nch;
    bool rays;             /* Bayer pixels as they are */
    const uint8_t *cell;   /* Bayer's 2x2 colours, else NULL */
    int samples;           /* per pixel: 1 or 3 */
    bool grey, swapped;    /* one channel; BGR order */
    unsigned full;         /* of a raw sample; 0 = float */
    unsigned clip;         /* a raw sample is saturated from here on, <= full */
    float most;            /* value of saturated channels, without maps */
    const uint32_t *table; /* light of a raw sample; NULL = linear */
    float scale_full;      /* full scale of the values that are summed: full or CAP_LIGHT_ONE */
    float unit;            /* of the maps, or 1 */
    struct cap_yuv_coef yuv;
    const struct cap_maps *maps; /* or NULL */
    const float *base;           /* start of out: a bin's place in it is its place in the maps */
    const float *plane; /* replaces the samples: [height][width][samples], NaN left out (maps.c) */
};

/* Maps of bins as (1) of maps.h needs them. */
struct cap_maps {
    uint64_t number; /* of maps made in this process */
    int32_t width, height;
    struct cap_convert_params p;
    const uint8_t *cell;
    int samples;
    float unit;     /* of factors, and of dark and light while they are subtracted */
    uint32_t *word; /* [planes][plane], see cap_pix_map */
    size_t planes;  /* 3 with nch = 3, except 1 for rays; else 1 */
    size_t plane;   /* bins, plus slack that may be read beyond them */
    float matrix[9];
    bool has_matrix;
    float saturated;
    uint32_t *table[17]; /* by bits; NULL = no response */
    uint8_t *mask;       /* a bit for each raw pixel; NULL = all are good */
    size_t n_masked, n_patches;
    /* [n_patches] ascending: bins in which a masked pixel would count; CAP_BLANK: no other pixel counts */
    uint32_t *patch;
};
#define CAP_BLANK 0x80000000u
CAP_PIX_INLINE bool cap_pix_masked(const struct cap_maps *m, int32_t x, int32_t y)
{
    size_t i = (size_t)y * (size_t)m->width + (size_t)x;
    return m->mask[i / 8] >> i % 8 & 1;
}

/* ---- shared arithmetic ---- */

/* The chroma term of a YUV pair, which is the same for both pixels; then R'G'B' of one pixel. */
CAP_PIX_INLINE cap_f4 cap_pix_chroma(const struct cap_yuv_coef *k, int cb, int cr)
{
    return k->at0 + (k->cb * (float)cb + k->cr * (float)cr);
}
CAP_PIX_INLINE cap_i4 cap_pix_yuv(const struct cap_yuv_coef *k, int luma, cap_f4 chroma)
{
    const cap_f4 most = {4095, 4095, 4095, 0};
    cap_f4 v = k->y * (float)luma + chroma;
    v = (cap_f4)((cap_i4)v & (v > 0));
    cap_i4 over = v > most;
    v = (cap_f4)(((cap_i4)most & over) | ((cap_i4)v & ~over));
    return __builtin_convertvector(v, cap_i4);
}

/* 1 / (count full) of equation (1) of pixfmt.h; with maps in the maps' unit. */
CAP_PIX_INLINE float cap_pix_scale(const struct cap_pix *j, int count)
{
    return 1.0f / ((float)count * j->scale_full) * j->unit;
}

/* (1) of maps.h, v in the maps' unit.  A word's least bits are g / flat in steps of that unit.  The whole word read
 * as a float is dark: its other bits are chosen so that this is nearest.  4 bytes and 4 operations a place. */
#define CAP_MAP_FACTOR_BITS 13
#define CAP_MAP_FACTOR      ((1u << CAP_MAP_FACTOR_BITS) - 1)
CAP_PIX_INLINE float cap_pix_map(float v, uint32_t word)
{
    float dark;
    memcpy(&dark, &word, sizeof dark);
    return (v - dark) * (float)(int32_t)(word & CAP_MAP_FACTOR);
}

/* v, or `top` if full.  Has no branch, because a branch would prevent vectorisation of the loop. */
CAP_PIX_INLINE float cap_pix_or(float v, bool full, float top)
{
    const int32_t mask = -(int32_t)full;
    int32_t a, b;
    memcpy(&a, &v, sizeof a);
    memcpy(&b, &top, sizeof b);
    a = (a & ~mask) | (b & mask);
    memcpy(&v, &a, sizeof v);
    return v;
}

/* Write one bin from its channel means; grey = the image has one channel; most = value of saturated bins. */
CAP_PIX_INLINE void cap_pix_put(float *out, const float rgb[3], const bool saturated[3], float most,
                                bool grey, int nch)
{
    if (nch == 3) {
        for (int c = 0; c < 3; c++)
            out[c] = grey ? rgb[0] : rgb[c];
        out[3] = 0;
    } else if (grey) {
        out[0] = rgb[0];
    } else if (saturated[0] || saturated[1] || saturated[2]) {
        out[0] = most;
    } else {
        float sum = 0;
        int n = 0;
        for (int c = 0; c < 3; c++)
            if (isfinite(rgb[c])) {
                sum += rgb[c];
                n++;
            }
        out[0] = n == 3 ? sum * (1.0f / 3.0f) : n > 0 ? sum / (float)n : NAN;
    }
}

/* ---- implementations ---- */

/* Fills *j; the errors of cap_convert. */
PVX_MUST_CHECK pvx_err cap_pix_check(const struct cap_image *img,
                                     const struct cap_convert_params *p, int32_t y0, int32_t y1,
                                     struct cap_pix *j);
void cap_pix_ref(const struct cap_pix *j, int32_t y0, int32_t y1, float *out);
/* One bin, by the same code, written to its place in out. */
void cap_pix_ref_bin(const struct cap_pix *j, int32_t X, int32_t Y, float *out);
/* Float images. */
void cap_pix_floats(const struct cap_pix *j, int32_t y0, int32_t y1, float *out);
/* One raw sample of an integer format, bit by bit from the format's definition. */
unsigned cap_pix_sample(const struct cap_pix *j, int32_t x, int32_t y, int s);

typedef void (*cap_pix_kernel)(const struct cap_pix *j, int32_t y0, int32_t y1, float *out);
/* Filled with the reference first; the file of an instruction set then overwrites the slots that it implements. */
struct cap_pix_kernels {
    cap_pix_kernel sums;   /* integer samples except Bayer; binning up to 32 */
    cap_pix_kernel bayer;  /* integer Bayer, binning 1: bilinear, or rays */
    cap_pix_kernel mosaic; /* integer Bayer, binning 2 to 32 (with a table: to 16) */
    cap_pix_kernel floats;
};
/* The kernels for pvx_cpu(), but no better instruction set than `most`. */
void cap_pix_kernels_init(struct cap_pix_kernels *k, enum pvx_cpu most);
void cap_pix_kernels_base(struct cap_pix_kernels *k); /* any processor */
#if defined(__x86_64__)
void cap_pix_kernels_avx2(struct cap_pix_kernels *k);
#endif
/* Runs the kernel for *j, or the reference if no kernel can do it. */
void cap_pix_run(const struct cap_pix_kernels *k, const struct cap_pix *j, int32_t y0, int32_t y1,
                 float *out);
#endif
