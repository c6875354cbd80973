/* unpack.cl - raw pixels to binned floats: capture/pixel/pixfmt.h for integers of linear light, to the bit.
 *
 * Sums are integers, so their order does not matter.  They are scaled once, as on the host. */

/* raw.h: enum rec_cl_layout */
#define LAYOUT_NONE   0
#define LAYOUT_8      1
#define LAYOUT_16     2
#define LAYOUT_P      3
#define LAYOUT_PACKED 4

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
    default: break; /* CSI-2 */
    }
    if (depth == 10) {
        t = row + u / 4 * 5;
        return (uint)t[u & 3] << 2 | (t[4] >> (u & 3) * 2 & 3u);
    }
    t = row + u / 2 * 3;
    return (uint)t[odd] << 4 | (t[2] >> odd * 4 & 15u);
}

static inline void gather(struct gathered *g, uint v, int c, uint weight, uint clip)
{
    const int4 here = (int4)(c == 0, c == 1, c == 2, 0) != 0;
    g->saturated |= here & (v >= clip ? (int4)(-1) : (int4)(0));
    g->sum += select((uint4)(0), (uint4)(v * weight), as_uint4(here));
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
static inline void gather_bin(__global const struct rec_cl_raw_picture *r, __global const uchar *raw,
                       int X, int Y, struct gathered *g)
{
    const int b = r->binning;
    for (int y = Y * b; y < (Y + 1) * b; y++)
        for (int x = X * b; x < (X + 1) * b; x++)
            for (int s = 0; s < r->samples; s++)
                gather(g, sample(r, raw, x, y, s), s, 1, r->clip);
}

/* Bayer, binning 1: a pixel's own colour is its sample, the others are the means of their samples around it. */
static inline void gather_around(__global const struct rec_cl_raw_picture *r, __global const uchar *raw,
                          int x, int y, struct gathered *g)
{
    const int own = colour(r, x, y);
    gather(g, sample(r, raw, x, y, 0), own, 1, r->clip);
    for (int k = 0; k < 9 && !r->rays; k++) {
        const int u = mirrored(x + k % 3 - 1, r->width), v = mirrored(y + k / 3 - 1, r->height);
        if (colour(r, u, v) != own)
            gather(g, sample(r, raw, u, v, 0), colour(r, u, v), 1, r->clip);
    }
}

/* Along one axis, sample u stands for two pixels about it.  Their overlap with bin X, in half pixels. */
static inline int overlap(int u, int X, int b)
{
    return max(0, min(2 * u + 2, 2 * (X + 1) * b - 1) - max(2 * u - 2, 2 * X * b - 1));
}

/* Bayer, binning 2 and more: the bin's own samples of green; each one of red and blue as far as the four pixels that it
 * stands for lie in the bin. */
static inline void gather_mosaic(__global const struct rec_cl_raw_picture *r, __global const uchar *raw,
                          int X, int Y, struct gathered *g)
{
    const int b = r->binning;
    for (int y = Y * b - 1; y <= (Y + 1) * b; y++)
        for (int x = X * b - 1; x <= (X + 1) * b; x++) {
            const int c = colour(r, x, y);
            const bool inside = x >= X * b && y >= Y * b && x < (X + 1) * b && y < (Y + 1) * b;
            const int weight = c == 1 ? inside : overlap(x, X, b) * overlap(y, Y, b);
            if (weight > 0)
                gather(g, sample(r, raw, mirrored(x, r->width), mirrored(y, r->height), 0), c,
                       (uint)weight, r->clip);
        }
}

/* sum / (count full), where 1 / (count full) is the nearest float; NaN: no sample. */
static inline float mean_of(__global const struct rec_cl_raw_picture *r, uint sum, uint count,
                     int saturated)
{
    const float scale = (float)(1.0 / (double)((float)count * r->full));
    return saturated ? r->most : count == 0 ? NAN : (float)sum * scale;
}

/* Bins of pictures that are raw.  Groups: a band each; band: its camera and first row. */
__kernel FLAT_ITEMS void unpack_bins(__global const struct rec_cl_picture *restrict shot,
                                     __global const struct rec_cl_raw_picture *restrict picture,
                                     __global const int2 *restrict band, __global const uchar *restrict raw,
                                     __global lanes *restrict b)
{
    const int2 at = band[get_group_id(0)];
    __global const struct rec_cl_picture *im = &shot[at.x];
    __global const struct rec_cl_raw_picture *r = &picture[at.x];
    const int bins = min(BAND_ROWS, im->bh - at.y) * im->bw;
    for (int k = (int)get_local_id(0); k < bins && r->layout != LAYOUT_NONE; k += FLAT) {
        const int x = k % im->bw, y = at.y + k / im->bw;
        struct gathered g = {(uint4)(0), (uint4)(0), (int4)(0)};
        if (!r->bayer)
            gather_bin(r, raw, x, y, &g);
        else if (r->binning == 1)
            gather_around(r, raw, x, y, &g);
        else
            gather_mosaic(r, raw, x, y, &g);
        const float red = mean_of(r, g.sum.x, g.count.x, g.saturated.x);
        const float green = mean_of(r, g.sum.y, g.count.y, g.saturated.y);
        const float blue = mean_of(r, g.sum.z, g.count.z, g.saturated.z);
        const int i = im->row0 + y * im->bw + x;
#if CS == 4
        b[i] = r->grey ? (float4)(red, red, red, 0) : (float4)(red, green, blue, 0);
#else
        b[i] = r->grey                       ? red
               : any(g.saturated)            ? r->most
                                             : (red + green + blue) * (1.0f / 3.0f);
#endif
    }
}
