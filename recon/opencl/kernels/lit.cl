/* lit.cl - photometry: silhouettes, and blacks that are clipped, as carve/photo_pass_impl.h and clipped.c have them.
 *
 * Every value has the bits that it has on the host, as in photo.cl. */
#define NOISY 7.5f /* photo_limits.h: REC_PHOTO_NOISY */
#define KNOTS 512  /* clipped.h: REC_CLIPPED_KNOTS */
#define NEAR  0.398942280401432678
#define FAR   4.0

/* The sum over side x side bins about (x, y), each at most cap: down the columns first, then across. */
static inline lanes square(__global const lanes *pic, int bw, int x, int y, int side, lanes cap)
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
static inline bool is_inside(__global const struct rec_cl_picture *im, int x, int y, int reach)
{
    return x >= reach && y >= reach && x + reach < im->bw && y + reach < im->bh;
}

/* Bins that reach `limit` and means over 3x3 that reach `near`; sum and hits.  The items test FLAT bins at a time, and
 * an item a lane adds the hits in their order. */
__kernel FLAT_ITEMS void photo_judge(__global const struct rec_cl_picture *restrict shot,
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
__kernel GROUP_ITEMS void photo_noisy(__global const struct rec_cl_picture *restrict shot,
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
__kernel FLAT_ITEMS void photo_widen(__global const struct rec_cl_picture *restrict shot,
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
static inline int lit_near(__global const uchar *raw, int bw, int bh, int x, int y)
{
    int n = 0;
    for (int v = max(y - 1, 0); v <= min(y + 1, bh - 1); v++)
        for (int u = max(x - 1, 0); u <= min(x + 1, bw - 1); u++)
            n += raw[v * bw + u] != UNLIT;
    return n;
}

/* raw to 0 and 1, without lone bins where `despeckle`: to `clean` where silhouettes are grown, else to `lit`. */
__kernel FLAT_ITEMS void photo_finish(__global const struct rec_cl_picture *restrict shot,
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
__kernel FLAT_ITEMS void photo_grow_rows(__global const struct rec_cl_picture *restrict shot,
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
__kernel FLAT_ITEMS void photo_grow_columns(__global const struct rec_cl_picture *restrict shot,
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
static inline double clipped_inverse(__global const float *inverse, double x)
{
    const double u = fmax(0.0, (x - NEAR) / (FAR - NEAR) * (KNOTS - 1));
    const int k = (int)fmin(u, (double)(KNOTS - 2));
    const double part = u - (double)k;
    return (1 - part) * (double)inverse[k] + part * (double)inverse[k + 1];
}

/* The value above the level without its bias: (4) and (5) of clipped.h. */
static inline double mended(__global const struct rec_cl_picture_limits *t, int c,
                            __global const float *inverse, double b)
{
    if (t->cut[c] < 0)
        return b > 0 ? b : t->cut[c];
    if (b < t->dark[c])
        return t->sigma[c] * t->t[c] + t->slope[c] * (b - t->dark[c]);
    return b < FAR * t->sigma[c] ? t->sigma[c] * clipped_inverse(inverse, b / t->sigma[c]) : b;
}

__kernel FLAT_ITEMS void photo_mend(__global const struct rec_cl_picture *restrict shot,
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
