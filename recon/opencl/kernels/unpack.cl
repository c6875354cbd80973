/* unpack.cl - raw pixels to binned floats: capture/pixel/recipe.h to the bit.
 *
 * Sums are integers, so their order does not matter.  They are scaled once, as on the host. */
#define NO_MAP REC_CL_NO_MAP
#define FACTOR 0x1FFFu /* recipe.h: CAP_RECIPE_FACTOR */

/* raw.h: enum rec_cl_layout */
#define LAYOUT_NONE   0
#define LAYOUT_8      1
#define LAYOUT_16     2
#define LAYOUT_P      3
#define LAYOUT_PACKED 4
#define LAYOUT_YUV    6

/* Sums of a bin so far, of channels 0 to 2. */
struct gathered {
    uint4 sum, count;
    int4 saturated;
};

/* One sample, as capture/pixel/image.h has its place.  s: of a pixel. */
static inline uint sample(__global const struct rec_cl_raw_picture *r, __global const uchar *raw, int x,
                          int y, int s)
{
    __global const uchar *row = raw + r->at + (uint)y * r->stride, *t;
    const uint u = (uint)x, i = u * (uint)r->samples + (uint)(r->swapped ? 2 - s : s);
    const uint depth = (uint)r->depth, odd = u & 1;
    switch (r->layout) {
    case LAYOUT_8: return row[i];
    case LAYOUT_16: return row[2 * i] | (uint)row[2 * i + 1] << 8;
    case LAYOUT_P: { /* a sample reaches into two bytes */
        const uint at = i * depth, low = at & 7;
        return ((row[at / 8] | (uint)row[at / 8 + 1] << 8) >> low) & ((1u << depth) - 1);
    }
    case LAYOUT_PACKED:
        t = row + u / 2 * 3;
        return (uint)t[odd * 2] << (depth - 8) | (t[1] >> odd * 4 & ((1u << (depth - 8)) - 1));
    case LAYOUT_YUV: { /* (0) of recipe.h; a pair of pixels has its colour in common */
        const uint luma = (uint)r->swapped, hue = 1 - luma;
        t = row + u / 2 * 4;
        const float chroma = r->cb[s] * (float)t[hue] + r->cr[s] * (float)t[2 + hue];
        const float v = r->y * (float)t[odd * 2 + luma] + (r->at0[s] + chroma);
        return v > 0 ? (uint)min((int)v, 4095) : 0;
    }
    default: break; /* CSI-2 */
    }
    if (depth == 10) {
        t = row + u / 4 * 5;
        return (uint)t[u & 3] << 2 | (t[4] >> (u & 3) * 2 & 3u);
    }
    t = row + u / 2 * 3;
    return (uint)t[odd] << 4 | (t[2] >> odd * 4 & 15u);
}

/* A picture with its camera's tables and maps. */
struct source {
    __global const struct rec_cl_raw_picture *r;
    __global const uchar *raw;
    __global const uint *maps;
};

static inline void gather(const struct source *f, int x, int y, int s, int c, uint weight,
                          struct gathered *g)
{
    const int4 here = (int4)(c == 0, c == 1, c == 2, 0) != 0;
    if (f->r->mask != NO_MAP) {
        const uint i = (uint)y * (uint)f->r->width + (uint)x;
        if (f->maps[f->r->mask + i / 32] >> (i & 31) & 1)
            return;
    }
    const uint v = sample(f->r, f->raw, x, y, s);
    const bool full = v >= f->r->clip; /* then the table may not have it */
    const uint light = full ? 0 : f->r->table != NO_MAP ? f->maps[f->r->table + v] : v;
    g->saturated |= here & (full ? (int4)(-1) : (int4)(0));
    g->sum += select((uint4)(0), (uint4)(light * weight), as_uint4(here));
    g->count += select((uint4)(0), (uint4)(weight), as_uint4(here));
}

static inline int mirrored(int i, int n)
{
    return i < 0 ? -i : i >= n ? 2 * n - 2 - i : i;
}
static inline int colour(__global const struct rec_cl_raw_picture *r, int x, int y)
{
    return r->cell[(y & 1) * 2 + (x & 1)];
}

/* Not Bayer. */
static inline void gather_bin(const struct source *f, int X, int Y, struct gathered *g)
{
    const int b = f->r->binning;
    for (int y = Y * b; y < (Y + 1) * b; y++)
        for (int x = X * b; x < (X + 1) * b; x++)
            for (int s = 0; s < f->r->samples; s++)
                gather(f, x, y, s, s, 1, g);
}

/* Bayer, binning 1: a pixel's own colour is its sample, the others are the means of their samples around it. */
static inline void gather_around(const struct source *f, int x, int y, struct gathered *g)
{
    const int own = colour(f->r, x, y);
    gather(f, x, y, 0, own, 1, g);
    for (int k = 0; k < 9 && !f->r->rays; k++) {
        const int u = mirrored(x + k % 3 - 1, f->r->width);
        const int v = mirrored(y + k / 3 - 1, f->r->height), c = colour(f->r, u, v);
        if (c != own)
            gather(f, u, v, 0, c, 1, g);
    }
}

/* Along one axis, sample u stands for two pixels about it.  Their overlap with bin X, in half pixels. */
static inline int overlap(int u, int X, int b)
{
    return max(0, min(2 * u + 2, 2 * (X + 1) * b - 1) - max(2 * u - 2, 2 * X * b - 1));
}

/* Bayer, binning 2 and more: the bin's own samples of green; each one of red and blue as far as the four pixels that it
 * stands for lie in the bin. */
static inline void gather_mosaic(const struct source *f, int X, int Y, struct gathered *g)
{
    const int b = f->r->binning;
    for (int y = Y * b - 1; y <= (Y + 1) * b; y++)
        for (int x = X * b - 1; x <= (X + 1) * b; x++) {
            const int c = colour(f->r, x, y);
            const bool inside = x >= X * b && y >= Y * b && x < (X + 1) * b && y < (Y + 1) * b;
            const int weight = c == 1 ? inside : overlap(x, X, b) * overlap(y, Y, b);
            if (weight > 0)
                gather(f, mirrored(x, f->r->width), mirrored(y, f->r->height), 0, c, (uint)weight, g);
        }
}

/* (1) of recipe.h, where 1 / (count full) is the nearest float; NaN: no sample. */
static inline float mean_of(__global const struct rec_cl_raw_picture *r, uint sum, uint count)
{
    const float scale = (float)(1.0 / (double)((float)count * r->full)) * r->unit;
    return count == 0 ? NAN : (float)sum * scale;
}

/* (2) of recipe.h for channel c of bin i of the picture. */
static inline float mapped(const struct source *f, float v, int c, int i)
{
    __global const struct rec_cl_raw_picture *r = f->r;
    if (r->planes == 0)
        return v;
    const int bins = r->width / r->binning * (r->height / r->binning);
    const uint word = f->maps[r->word + (uint)((r->planes == 3 ? c * bins : 0) + i)];
    return (v - as_float(word)) * (float)(int)(word & FACTOR);
}

#if CS == 4
/* A bin's three channels. */
static inline float4 finished(const struct source *f, float4 v, int4 saturated, int i)
{
    __global const struct rec_cl_raw_picture *r = f->r;
    v = (float4)(mapped(f, v.x, 0, i), mapped(f, v.y, 1, i), mapped(f, v.z, 2, i), 0);
    v = select(v, (float4)(r->most), saturated);
    if (!r->coloured)
        return v;
    if (any(saturated))
        return (float4)(r->most, r->most, r->most, 0);
    __global const float *a = r->matrix;
    return (float4)(a[0] * v.x + a[1] * v.y + a[2] * v.z, a[3] * v.x + a[4] * v.y + a[5] * v.z,
                    a[6] * v.x + a[7] * v.y + a[8] * v.z, 0);
}
#endif

/* Bins of pictures that are raw.  Groups: a band each; band: its camera and first row. */
__kernel FLAT_ITEMS void unpack_bins(__global const struct rec_cl_picture *restrict shot,
                                     __global const struct rec_cl_raw_picture *restrict picture,
                                     __global const int2 *restrict band, __global const uchar *restrict raw,
                                     __global const uint *restrict maps, __global lanes *restrict b)
{
    const int2 at = band[get_group_id(0)];
    __global const struct rec_cl_picture *im = &shot[at.x];
    const struct source f = {&picture[at.x], raw, maps};
    __global const struct rec_cl_raw_picture *r = f.r;
    const int bins = min(BAND_ROWS, im->bh - at.y) * im->bw;
    for (int k = (int)get_local_id(0); k < bins && r->layout != LAYOUT_NONE; k += FLAT) {
        const int x = k % im->bw, y = at.y + k / im->bw, i = y * im->bw + x;
        struct gathered g = {(uint4)(0), (uint4)(0), (int4)(0)};
        if (!r->bayer)
            gather_bin(&f, x, y, &g);
        else if (r->binning == 1)
            gather_around(&f, x, y, &g);
        else
            gather_mosaic(&f, x, y, &g);
        const float red = mean_of(r, g.sum.x, g.count.x);
        const float green = r->grey ? red : mean_of(r, g.sum.y, g.count.y);
        const float blue = r->grey ? red : mean_of(r, g.sum.z, g.count.z);
#if CS == 4
        const int4 saturated = r->grey ? (int4)(g.saturated.xxx, 0) : g.saturated;
        b[im->row0 + i] = finished(&f, (float4)(red, green, blue, 0), saturated, i);
#else
        const float mean = r->grey ? red : (red + green + blue) * (1.0f / 3.0f);
        b[im->row0 + i] = any(g.saturated) ? r->most : mapped(&f, mean, 0, i);
#endif
    }
}
