/* photo.cl - photometry: the loops of carve/photo_pass_impl.h and clipped.c on a card.
 *
 * Every value has the bits that it has on the host: operations on a bin are the same in the same order, sums too, and
 * quotients of floats are taken in double and rounded once, which gives the exact quotient's float.
 * A group works on a band of 16 rows of one picture, its items on neighbouring bins.
 * band: camera and first row of each band.  raw: UNLIT, LIT or FORCED for each bin. */
#define BAND_ROWS 16 /* bands.h: REC_BAND_ROWS */
#define BLOCK     8  /* photo_pass.h: REC_PHOTO_BLOCK */
#define BLOCKS    400
#define UNLIT     0
#define LIT       1
#define FORCED    2
#define LIMIT     1e9f /* photo.h: REC_PHOTO_LIMIT */
#define NOISY     7.5f /* photo_limits.h: REC_PHOTO_NOISY */
#define KNOTS     512  /* clipped.h: REC_CLIPPED_KNOTS */
#define NEAR      0.398942280401432678
#define FAR       4.0

#if CS == 4
#define ANY(m)       any(m)
#define ALWAYS(m)    ((int4)(-(m)))
#define LANES_OF(v)  vload4(0, v)
#define TO_FOUR(v)   (v)
#define BRIGHTEST(v) max(max(as_int4(v).x, as_int4(v).y), max(as_int4(v).z, as_int4(v).w))
#else
#define ANY(m)       ((m) != 0)
#define ALWAYS(m)    (m)
#define LANES_OF(v)  ((v)[0])
#define TO_FOUR(v)   ((float4)(v, INFINITY, INFINITY, INFINITY))
#define BRIGHTEST(v) as_int(v)
#endif

/* The lanes that bin (x, y) measures. */
inline ilanes measured(__global const struct rec_cl_picture *im, int x, int y)
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

/* The band of a group: its camera, first row and number of bins. */
struct strip {
    int camera, y0, bins;
};
inline struct strip strip_of(__global const struct rec_cl_picture *shot, __global const int2 *band)
{
    int2 b = band[get_group_id(0)];
    int rows = min(BAND_ROWS, shot[b.x].bh - b.y);
    return (struct strip){b.x, b.y, rows * shot[b.x].bw};
}

/* The least, the sum and the greatest of what the items of a group have; for all of them. */
inline float4 least_of_group(float4 v, __local float4 *tree)
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
/* x, y, z: sums; w: the greatest. */
inline int4 count_group(int4 v, __local int4 *tree)
{
    int i = (int)get_local_id(0);
    tree[i] = v;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (int reach = FLAT / 2; reach > 0; reach /= 2) {
        if (i < reach) {
            int4 a = tree[i], b = tree[i + reach];
            tree[i] = (int4)(a.xyz + b.xyz, max(a.w, b.w));
        }
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    v = tree[0];
    barrier(CLK_LOCAL_MEM_FENCE);
    return v;
}

/* ---- pixels to b ---- */

/* (1) of photo.h.  b: binned pixels, then b.  weight4: of each channel, where `per_channel`. */
__kernel void photo_linear(__global const struct rec_cl_picture *restrict shot,
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
inline lanes quotient(lanes a, lanes b)
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
inline struct column add_column(__global const struct rec_cl_picture *im, __global const lanes *b,
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
inline ilanes count_low(__global const struct rec_cl_picture *im, __global const lanes *b,
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
__kernel void photo_blocks(__global const struct rec_cl_picture *restrict shot,
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

/* ---- silhouettes ---- */

#if CS == 4
/* (2) of photo.h, mirrored at the border. */
inline float4 down(__global const float4 *b, const int *row, int x)
{
    return b[row[0] + x] + 2 * b[row[1] + x] + b[row[2] + x];
}
#endif
/* Of mosaics. */
__kernel void photo_plane(__global const struct rec_cl_picture *restrict shot,
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

/* The sum over side x side bins about (x, y), each at most cap: down the columns first, then across. */
inline lanes square(__global const lanes *pic, int bw, int x, int y, int side, lanes cap)
{
    lanes all = SPLAT(0);
    for (int u = 0; u < side; u++) {
        __global const lanes *at = pic + (y - side / 2) * bw + x - side / 2 + u;
        lanes s = select(cap, at[0], at[0] < cap);
        for (int v = 1; v < side; v++)
            s += select(cap, at[v * bw], at[v * bw] < cap);
        all = u == 0 ? s : all + s;
    }
    return all;
}
inline bool is_inside(__global const struct rec_cl_picture *im, int x, int y, int reach)
{
    return x >= reach && y >= reach && x + reach < im->bw && y + reach < im->bh;
}

/* Bins that reach `limit` and means over 3x3 that reach `near`; sum and hits.  The items test FLAT bins at a time, and
 * an item a lane adds the hits in their order. */
__kernel void photo_judge(__global const struct rec_cl_picture *restrict shot,
                          __global const struct rec_cl_picture_limits *restrict limits,
                          __global const int2 *restrict band, __global const lanes *restrict b,
                          __global const lanes *restrict plane, __global uchar *restrict raw,
                          __global struct rec_cl_picture_band *restrict out)
{
    __local lanes value[FLAT];
    __local uint lit[FLAT / 4]; /* four bins in each */
    const struct strip s = strip_of(shot, band);
    __global const struct rec_cl_picture *im = &shot[s.camera];
    __global const struct rec_cl_picture_limits *t = &limits[s.camera];
    const lanes limit = LANES_OF(t->limit), near = LANES_OF(t->near);
    const lanes cap = LANES_OF(t->near_cap);
    __global const lanes *img = b + im->row0, *pic = im->mosaic ? plane + im->row0 : img;
    const int item = (int)get_local_id(0);
    double sum = 0;
    int hits = 0;
    for (int from = 0; from < s.bins && !im->absent; from += FLAT) {
        const int k = from + item, x = k % im->bw, y = s.y0 + k / im->bw;
        const int i = s.y0 * im->bw + k;
        bool hit = false;
        if (k < s.bins) {
            ilanes h = (img[i] >= limit) | (pic[i] >= limit);
            if (t->means && is_inside(im, x, y, 1))
                h |= square(pic, im->bw, x, y, 3, cap) >= near;
            hit = ANY(h);
            value[item] = pic[i];
            if (hit)
                raw[im->row0 + i] |= LIT;
        }
        ((__local uchar *)lit)[item] = hit;
        barrier(CLK_LOCAL_MEM_FENCE);
        for (int w = 0; w < FLAT / 4 && item < CS; w++) {
            const uint four = lit[w];
            for (int u = 0; u < 4 && four != 0; u++)
                if (four >> 8 * u & 1) {
                    sum += (double)((__local float *)value)[(4 * w + u) * CS + item];
                    hits++;
                }
        }
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    if (item < CS)
        out[get_group_id(0)].sum[item] = sum;
    if (item == 0)
        out[get_group_id(0)].hits = hits;
}

/* Whether flames are faint (is_noisy in carve/photo.c).  An item a camera. */
__kernel void photo_noisy(__global const struct rec_cl_picture *restrict shot,
                          __global const struct rec_cl_picture_limits *restrict limits, int cameras,
                          __global const struct rec_cl_picture_band *restrict band,
                          __global int *restrict noisy)
{
    const int c = (int)get_global_id(0);
    double total[3] = {0, 0, 0}, best = 0;
    uint hits = 0;
    if (c >= cameras)
        return;
    for (int k = 0; k < shot[c].bands && !shot[c].absent; k++) {
        __global const struct rec_cl_picture_band *o = &band[shot[c].band0 + k];
        hits += (uint)o->hits;
        for (int l = 0; l < min(CS, 3); l++)
            total[l] += o->sum[l];
    }
    for (int l = 0; l < min(CS, 3) && hits > 0; l++)
        best = fmax(best, total[l] / hits / fmax((double)limits[c].noise[l], 1e-9));
    noisy[c] = limits[c].means && (float)best > 0 && (float)best < NOISY;
}

/* Means over 7x7 that reach `wide`, of faint flames. */
__kernel void photo_widen(__global const struct rec_cl_picture *restrict shot,
                          __global const struct rec_cl_picture_limits *restrict limits,
                          __global const int2 *restrict band, __global const int *restrict noisy,
                          __global const lanes *restrict b, __global const lanes *restrict plane,
                          __global uchar *restrict raw)
{
    const struct strip s = strip_of(shot, band);
    __global const struct rec_cl_picture *im = &shot[s.camera];
    __global const struct rec_cl_picture_limits *t = &limits[s.camera];
    const lanes wide = LANES_OF(t->wide), cap = LANES_OF(t->wide_cap);
    __global const lanes *pic = (im->mosaic ? plane : b) + im->row0;
    for (int k = (int)get_local_id(0); k < s.bins && noisy[s.camera]; k += FLAT) {
        const int x = k % im->bw, y = s.y0 + k / im->bw;
        if (is_inside(im, x, y, 3) && ANY(square(pic, im->bw, x, y, 7, cap) >= wide))
            raw[im->row0 + s.y0 * im->bw + k] |= LIT;
    }
}

/* Bins that are not unlit among the 3x3 about (x, y). */
inline int lit_near(__global const uchar *raw, int bw, int bh, int x, int y)
{
    int n = 0;
    for (int v = max(y - 1, 0); v <= min(y + 1, bh - 1); v++)
        for (int u = max(x - 1, 0); u <= min(x + 1, bw - 1); u++)
            n += raw[v * bw + u] != UNLIT;
    return n;
}

/* raw to 0 and 1, without lone bins where `despeckle`: to `clean` where silhouettes are grown, else to `lit`. */
__kernel void photo_finish(__global const struct rec_cl_picture *restrict shot,
                           __global const struct rec_cl_picture_limits *restrict limits,
                           __global const int2 *restrict band, __global const uchar *restrict raw,
                           __global uchar *restrict clean, __global uchar *restrict lit,
                           __global struct rec_cl_picture_band *restrict out)
{
    __local int4 counts[FLAT];
    const struct strip s = strip_of(shot, band);
    __global const struct rec_cl_picture *im = &shot[s.camera];
    __global const struct rec_cl_picture_limits *t = &limits[s.camera];
    __global uchar *to = (t->margin > 0 ? clean : lit) + im->row0;
    int n = 0;
    for (int k = (int)get_local_id(0); k < s.bins && !im->absent; k += FLAT) {
        const int i = s.y0 * im->bw + k, here = raw[im->row0 + i];
        const bool lone = t->despeckle && here == LIT &&
                          lit_near(raw + im->row0, im->bw, im->bh, k % im->bw, i / im->bw) < 3;
        to[i] = here != UNLIT && !lone; /* forced stays */
        n += here != UNLIT && !lone;
    }
    n = count_group((int4)(n, 0, 0, 0), counts).x;
    if (get_local_id(0) == 0)
        out[get_group_id(0)].lit = n;
}

/* Square dilation by the margin: rows of `clean` to raw, which is not needed any more, then columns of raw to lit. */
__kernel void photo_grow_rows(__global const struct rec_cl_picture *restrict shot,
                              __global const struct rec_cl_picture_limits *restrict limits,
                              __global const int2 *restrict band,
                              __global const uchar *restrict clean, __global uchar *restrict raw)
{
    const struct strip s = strip_of(shot, band);
    __global const struct rec_cl_picture *im = &shot[s.camera];
    const int r = limits[s.camera].margin;
    for (int k = (int)get_local_id(0); k < s.bins && r > 0 && !im->absent; k += FLAT) {
        const int x = k % im->bw, row = im->row0 + s.y0 * im->bw + k - x;
        uchar any_lit = 0;
        for (int u = max(x - r, 0); u <= min(x + r, im->bw - 1); u++)
            any_lit |= clean[row + u];
        raw[row + x] = any_lit;
    }
}
__kernel void photo_grow_columns(__global const struct rec_cl_picture *restrict shot,
                                 __global const struct rec_cl_picture_limits *restrict limits,
                                 __global const int2 *restrict band,
                                 __global const uchar *restrict raw, __global uchar *restrict lit,
                                 __global struct rec_cl_picture_band *restrict out)
{
    __local int4 counts[FLAT];
    const struct strip s = strip_of(shot, band);
    __global const struct rec_cl_picture *im = &shot[s.camera];
    const int r = limits[s.camera].margin;
    int n = 0;
    for (int k = (int)get_local_id(0); k < s.bins && r > 0 && !im->absent; k += FLAT) {
        const int x = k % im->bw, y = s.y0 + k / im->bw;
        uchar any_lit = 0;
        for (int v = max(y - r, 0); v <= min(y + r, im->bh - 1); v++)
            any_lit |= raw[im->row0 + v * im->bw + x];
        lit[im->row0 + y * im->bw + x] = any_lit;
        n += any_lit;
    }
    n = count_group((int4)(n, 0, 0, 0), counts).x;
    if (get_local_id(0) == 0 && r > 0)
        out[get_group_id(0)].lit = n;
}

/* ---- clipped blacks ---- */

/* h^-1 of x (clipped.c). */
inline double clipped_inverse(__global const float *inverse, double x)
{
    const double u = fmax(0.0, (x - NEAR) / (FAR - NEAR) * (KNOTS - 1));
    const int k = (int)fmin(u, (double)(KNOTS - 2));
    const double part = u - (double)k;
    return (1 - part) * (double)inverse[k] + part * (double)inverse[k + 1];
}

/* The value above the level without its bias: (4) and (5) of clipped.h. */
inline double mended(__global const struct rec_cl_picture_limits *t, int c,
                     __global const float *inverse, double b)
{
    if (t->cut[c] < 0)
        return b > 0 ? b : t->cut[c];
    if (b < t->dark[c])
        return t->sigma[c] * t->t[c] + t->slope[c] * (b - t->dark[c]);
    return b < FAR * t->sigma[c] ? t->sigma[c] * clipped_inverse(inverse, b / t->sigma[c]) : b;
}

__kernel void photo_mend(__global const struct rec_cl_picture *restrict shot,
                         __global const struct rec_cl_picture_limits *restrict limits,
                         __global const int2 *restrict band, __global const float *restrict inverse,
                         __global const float *restrict weight, __global float *restrict b)
{
    const struct strip s = strip_of(shot, band);
    __global const struct rec_cl_picture *im = &shot[s.camera];
    __global const struct rec_cl_picture_limits *t = &limits[s.camera];
    const int own = im->row0 + s.y0 * im->bw;
    for (int k = (int)get_local_id(0); k < s.bins * CS && t->clipped && !im->absent; k += FLAT) {
        const int i = k / CS, c = k % CS, x = i % im->bw, y = s.y0 + i / im->bw;
        const bool has = !im->mosaic || im->cell[(y & 1) * 2 + (x & 1)] == c;
        if (c == 3 || !t->is_clipped[c] || !has || weight[own + i] == 0)
            continue;
        __global float *v = b + (own + i) * CS + c;
        *v = (float)(t->level[c] + mended(t, c, inverse, (double)*v - t->level[c]));
    }
}
