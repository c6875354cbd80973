/* photo.cl - photometry: the pixels to b, and what noise is measured by, as carve/photo_pass_impl.h has it.
 *
 * Every value has the bits that it has on the host: operations on a bin are the same in the same order, sums too, and
 * quotients of floats are taken in double and rounded once, which gives the exact quotient's float.
 * A group works on a band of 16 rows of one picture, its items on neighbouring bins.
 * band: camera and first row of each band.  raw: UNLIT, LIT or FORCED for each bin. */
#define BLOCK  8 /* photo_pass.h: REC_PHOTO_BLOCK */
#define BLOCKS 400
#define LIMIT  1e9f /* photo.h: REC_PHOTO_LIMIT */

#if CS == 4
#define ALWAYS(m)    ((int4)(-(m)))
#define TO_FOUR(v)   (v)
#define BRIGHTEST(v) max(max(as_int4(v).x, as_int4(v).y), max(as_int4(v).z, as_int4(v).w))
#else
#define ALWAYS(m)    (m)
#define TO_FOUR(v)   ((float4)(v, INFINITY, INFINITY, INFINITY))
#define BRIGHTEST(v) as_int(v)
#endif

/* The lanes that bin (x, y) measures. */
static inline ilanes measured(__global const struct rec_cl_picture *im, int x, int y)
{
#if CS == 4
    if (im->mosaic) {
        int c = im->cell[(y & 1) * 2 + (x & 1)];
        return (int4)(c == 0, c == 1, c == 2, 0) != 0;
    }
    return (int4)(-1, -1, -1, 0);
#else
    return 1;
#endif
}

/* The least of what the items of a group have; for all of them. */
static inline float4 least_of_group(float4 v, __local float4 *tree)
{
    int i = (int)get_local_id(0);
    tree[i] = v;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int reach = FLAT / 2; reach > 0; reach /= 2) {
        if (i < reach)
            tree[i] = tree[i + reach] < tree[i] ? tree[i + reach] : tree[i];
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    v = tree[0];
    barrier(CLK_LOCAL_MEM_FENCE);
    return v;
}
/* ---- pixels to b ---- */

/* (1) of photo.h.  b: binned pixels, then b.  weight4: of each channel, where `per_channel`. */
__kernel FLAT_ITEMS void photo_linear(__global const struct rec_cl_picture *restrict shot,
                                      __global const int2 *restrict band, __global lanes *restrict b,
                                      __global const lanes *restrict background,
                                      __global float *restrict weight, __global float4 *restrict weight4,
                                      int per_channel, __global uchar *restrict raw,
                                      __global uchar *restrict lit, __global struct rec_cl_picture_band *restrict out)
{
    __local float4 tree[FLAT];
    __local int4 counts[FLAT];
    const struct strip s = strip_of(shot, band);
    __global const struct rec_cl_picture *im = &shot[s.camera];
    const lanes scale = LANES_OF(im->scale), level = LANES_OF(im->level);
    lanes low = SPLAT(INFINITY), above = SPLAT(INFINITY);
    int4 count = 0;
    for (int k = (int)get_local_id(0); k < s.bins; k += FLAT) {
        const int i = im->row0 + s.y0 * im->bw + k;
        const ilanes has = measured(im, k % im->bw, s.y0 + k / im->bw);
        lanes v = select(SPLAT(0), b[i], has); /* other lanes: anything */
        const int full = ANY((v >= SPLAT(im->full)) & has);
        v -= SPLAT(im->black);
        if (im->background)
            v -= background[i];
        v *= scale;
        const int bad = ANY(!((v <= SPLAT(LIMIT)) & (v >= SPLAT(-LIMIT))) & has); /* NaN too */
        const int good = !bad && !full && !im->absent;
        v = select(SPLAT(0), bad || im->absent ? SPLAT(0) : v, has);
        b[i] = v;
        weight[i] = good;
#if CS == 4
        if (per_channel)
            weight4[i] = select((float4)(0), (float4)(good), has);
#endif
        raw[i] = bad || full ? FORCED : UNLIT;
        if (im->absent)
            lit[i] = 0;
        low = select(low, v, (v < low) & has & ALWAYS(good));
        above = select(above, v, (v < above) & (v > level) & has & ALWAYS(good));
        count += (int4)(!bad && full, bad, 0, 0);
        count.w = max(count.w, BRIGHTEST(v));
    }
    float4 least = least_of_group(TO_FOUR(low), tree);
    float4 next = least_of_group(TO_FOUR(above), tree);
    count = count_group(count, counts);
    if (get_local_id(0) == 0) {
        __global struct rec_cl_picture_band *o = &out[get_group_id(0)];
        vstore4(least, 0, o->low);
        vstore4(next, 0, o->above);
        o->saturated = count.x;
        o->not_finite = count.y;
        o->peak = count.w;
    }
}

/* ---- noise ---- */

/* a / b as the float nearest to the exact quotient; 0/0 is NaN. */
static inline lanes quotient(lanes a, lanes b)
{
#if CS == 4
    return convert_float4(convert_double4(a) / convert_double4(b));
#else
    return (float)((double)a / (double)b);
#endif
}

/* What a column of a block has, and then the block. */
struct column {
    lanes value, diff2, low;
    ilanes at_low, bins, cells;
};

#if CS == 4
#define ONES(m) (-(m))
#else
#define ONES(m) (m)
#endif

/* Column x of a block whose rows are [y0, y1) and whose columns end at x1. */
static inline struct column add_column(__global const struct rec_cl_picture *im, __global const lanes *b,
                                       __global const float *weight, int x, int x1, int y0, int y1)
{
    struct column c = {SPLAT(0), SPLAT(0), SPLAT(INFINITY), (ilanes)(0), (ilanes)(0), (ilanes)(0)};
    const int k = im->step, bw = im->bw;
    for (int y = y0; y < y1 && x < x1; y++) {
        const int i = im->row0 + y * bw + x, j = i + k * bw;
        const ilanes has = measured(im, x, y);
        if (weight[i] == 0)
            continue;
        const lanes a = b[i];
        c.value += a;
        c.low = select(c.low, a, (a < c.low) & has);
        c.bins += ONES(has);
        if (x + k >= x1 || y + k >= y1 || weight[i + k] == 0 || weight[j] == 0 ||
            weight[j + k] == 0)
            continue;
        const lanes d = (a - b[i + k]) - (b[j] - b[j + k]);
        c.diff2 += d * d;
        c.cells += ONES(has);
    }
    return c;
}
static inline ilanes count_low(__global const struct rec_cl_picture *im, __global const lanes *b,
                               __global const float *weight, int x, int x1, int y0, int y1, lanes low)
{
    ilanes n = 0;
    for (int y = y0; y < y1 && x < x1; y++) {
        const int i = im->row0 + y * im->bw + x;
        if (weight[i] != 0)
            n += ONES((b[i] == low) & measured(im, x, y));
    }
    return n;
}

/* Sums over blocks, as photo_pass_impl.h explains them: down the columns first, then across.  GROUP items: eight
 * blocks, an item a column.  Groups: BLOCKS / 8 for each camera. */
__kernel GROUP_ITEMS void photo_blocks(__global const struct rec_cl_picture *restrict shot,
                                       __global const lanes *restrict b, __global const float *restrict weight,
                                       __global struct rec_cl_picture_block *restrict out)
{
    __local struct column column[GROUP];
    const int item = (int)get_local_id(0), group = (int)get_group_id(0), first = item & ~7;
    __global const struct rec_cl_picture *im = &shot[group / (BLOCKS / 8)];
    const int m = group % (BLOCKS / 8) * 8 + item / 8, k = m * im->every;
    const bool there = m < im->blocks && !im->absent;
    const int x0 = k % im->across * BLOCK, y0 = k / im->across * BLOCK;
    const int x1 = there ? min(x0 + BLOCK, im->bw) : x0, y1 = min(y0 + BLOCK, im->bh);
    struct column sum = add_column(im, b, weight, x0 + item % 8, x1, y0, y1);
    column[item] = sum;
    barrier(CLK_LOCAL_MEM_FENCE);
    lanes low = column[first].low;
    for (int u = 1; u < BLOCK; u++)
        low = select(low, column[first + u].low, column[first + u].low < low);
    barrier(CLK_LOCAL_MEM_FENCE);
    column[item].at_low = count_low(im, b, weight, x0 + item % 8, x1, y0, y1, low);
    barrier(CLK_LOCAL_MEM_FENCE);
    if (!there || item != first)
        return;
    sum = (struct column){SPLAT(0), SPLAT(0), low, (ilanes)(0), (ilanes)(0), (ilanes)(0)};
    for (int u = 0; u < BLOCK; u++) {
        sum.value += column[first + u].value;
        sum.diff2 += column[first + u].diff2;
        sum.at_low += column[first + u].at_low;
        sum.bins += column[first + u].bins;
        sum.cells += column[first + u].cells;
    }
    __global struct rec_cl_picture_block *o = &out[group / (BLOCKS / 8) * BLOCKS + m];
#if CS == 4
    const float4 bins = convert_float4(sum.bins), cells = convert_float4(sum.cells);
    o->measured = all(sum.cells.xyz >= 4);
    vstore4(quotient(sum.value, bins), 0, o->mean);
    vstore4(quotient(sum.diff2, 4 * cells), 0, o->noise2);
    vstore4(quotient(convert_float4(sum.at_low), bins), 0, o->at_low);
    vstore4(low, 0, o->low);
#else
    const float bins = (float)sum.bins;
    o->measured = sum.cells >= 4;
    o->mean[0] = quotient(sum.value, bins);
    o->noise2[0] = quotient(sum.diff2, 4 * (float)sum.cells);
    o->at_low[0] = quotient((float)sum.at_low, bins);
    o->low[0] = low;
#endif
}

#if CS == 4
/* (2) of photo.h, mirrored at the border. */
static inline float4 down(__global const float4 *b, const int *row, int x)
{
    return b[row[0] + x] + 2 * b[row[1] + x] + b[row[2] + x];
}
#endif
/* Of mosaics. */
__kernel FLAT_ITEMS void photo_plane(__global const struct rec_cl_picture *restrict shot,
                                     __global const int2 *restrict band, __global const lanes *restrict b,
                                     __global lanes *restrict plane)
{
#if CS == 4
    const struct strip s = strip_of(shot, band);
    __global const struct rec_cl_picture *im = &shot[s.camera];
    const float4 scale = (float4)(4.0f / 16, 2.0f / 16, 4.0f / 16, 0);
    if (im->absent || !im->mosaic)
        return;
    for (int k = (int)get_local_id(0); k < s.bins; k += FLAT) {
        const int x = k % im->bw, y = s.y0 + k / im->bw;
        const int row[3] = {im->row0 + (y > 0 ? y - 1 : 1) * im->bw, im->row0 + y * im->bw,
                            im->row0 + (y + 1 < im->bh ? y + 1 : im->bh - 2) * im->bw};
        const int left = x > 0 ? x - 1 : 1, right = x + 1 < im->bw ? x + 1 : im->bw - 2;
        plane[row[1] + x] =
            scale * (down(b, row, left) + 2 * down(b, row, x) + down(b, row, right));
    }
#endif
}
