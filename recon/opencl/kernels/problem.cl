/* problem.cl - the loops of solve/problem.c, start.c and lambda.c.
 *
 * An item takes a bin of an active tile, or a column.  Sums go to parts from a slot on. */

/* b and w of the problem from the pictures, 0 in bins that are no rows.  Sums: ||W^(1/2) b||^2, rows with weight > 0,
 * rows with weight 1; w b; rows that measured a channel; the channels' weights and the largest. */
__kernel FLAT_ITEMS void problem_load(uint bins, __constant const struct rec_cl_geometry *g,
                                      __global const uint *restrict tile, __global const uchar *restrict is_row,
                                      __global const lanes *restrict picture, __global const float *restrict given,
                                      __global const float4 *restrict given4, int per_channel,
                                      __global lanes *restrict b, __global float *restrict w,
                                      __global float4 *restrict w4, __global double4 *restrict parts, uint slot)
{
    __local double4 tree[FLAT];
    double norm = 0;
    uint rows = 0, ones = 0;
    dlanes light = 0;
    double4 measured = 0, weight = 0;
    FOR_MINE (e, bins) {
        int i = bin_of(g, tile, e);
        if (i < 0)
            continue;
        bool row = is_row[i] != 0;
        float most = row && !per_channel ? given[i] : 0;
        lanes v = row ? picture[i] : SPLAT(0), wl = SPLAT(most);
#if CS == 4
        if (per_channel) {
            wl = row ? given4[i] : SPLAT(0);
            wl.w = 0;
            most = fmax(fmax(wl.x, wl.y), wl.z);
            w4[i] = wl;
            measured += select((double4)(0), (double4)(1), convert_long4(wl > SPLAT(0)));
            weight += (double4)(wl.x, wl.y, wl.z, most);
        }
#endif
        b[i] = v;
        w[i] = most;
        rows += most > 0;
        ones += most == 1;
        dlanes wb = AS_DOUBLE(wl) * AS_DOUBLE(v), part = wb * AS_DOUBLE(v);
        light += wb;
#if CS == 4
        norm += ((part.x + part.y) + part.z) + part.w;
#else
        norm += part;
#endif
    }
    put_sum((double4)(norm, rows, ones, 0), tree, parts, slot);
    put_sum(of_lanes(light), tree, parts, slot + 1);
    put_sum(measured, tree, parts, slot + 2);
    put_sum(weight, tree, parts, slot + 3);
}

/* ---- residuals -----------------------------------------------------------------------------------*/

/* r = A x - b, wr = W r; r: A x before, or whatever where x = 0 (`zero`).  Sum r'Wr. */
__kernel FLAT_ITEMS void problem_residual(uint bins, __constant const struct rec_cl_geometry *g,
                                          __global const uint *restrict tile, __global const float *restrict w,
                                          __global const float4 *restrict w4, int per_channel, int zero,
                                          __global const lanes *restrict b, __global lanes *restrict r,
                                          __global lanes *restrict wr, __global double4 *restrict parts, uint slot)
{
    __local double4 tree[FLAT];
    dlanes sum = 0;
    FOR_MINE (e, bins) {
        int i = bin_of(g, tile, e);
        if (i < 0)
            continue;
        lanes v = zero ? -b[i] : r[i] - b[i], wv = weight_of(w, w4, per_channel, i) * v;
        r[i] = v;
        wr[i] = wv;
        sum += AS_DOUBLE(wv) * AS_DOUBLE(v);
    }
    put_sum(of_lanes(sum), tree, parts, slot);
}

/* (1) of solve/start.h: sums (A x)'W b, (A x)'W (A x); r = A x - b. */
__kernel FLAT_ITEMS void problem_fit(uint bins, __constant const struct rec_cl_geometry *g,
                                     __global const uint *restrict tile, __global const float *restrict w,
                                     __global const float4 *restrict w4, int per_channel,
                                     __global const lanes *restrict b, __global const lanes *restrict r,
                                     __global double4 *restrict parts, uint slot)
{
    __local double4 tree[FLAT];
    dlanes fit = 0, size = 0;
    FOR_MINE (e, bins) {
        int i = bin_of(g, tile, e);
        if (i < 0)
            continue;
        dlanes v = AS_DOUBLE(b[i]), ax = AS_DOUBLE(r[i]) + v;
        dlanes wl = AS_DOUBLE(weight_of(w, w4, per_channel, i));
        fit += wl * ax * v;
        size += wl * ax * ax;
    }
    put_sum(of_lanes(fit), tree, parts, slot);
    put_sum(of_lanes(size), tree, parts, slot + 1);
}

/* r = scale (r + b) - b, wr = W r; sum r'Wr. */
__kernel FLAT_ITEMS void problem_scale_rows(uint bins, __constant const struct rec_cl_geometry *g,
                                            __global const uint *restrict tile, __global const float *restrict w,
                                            __global const float4 *restrict w4, int per_channel, float4 scale4,
                                            __global const lanes *restrict b, __global lanes *restrict r,
                                            __global lanes *restrict wr, __global double4 *restrict parts, uint slot)
{
    __local double4 tree[FLAT];
    lanes scale = OF_FOUR(scale4);
    dlanes sum = 0;
    FOR_MINE (e, bins) {
        int i = bin_of(g, tile, e);
        if (i < 0)
            continue;
        lanes v = scale * (r[i] + b[i]) - b[i], wv = weight_of(w, w4, per_channel, i) * v;
        r[i] = v;
        wr[i] = wv;
        sum += AS_DOUBLE(wv) * AS_DOUBLE(v);
    }
    put_sum(of_lanes(sum), tree, parts, slot);
}
/* x = scale x. */
__kernel FLAT_ITEMS void problem_scale(uint n, float4 scale4, __global lanes *restrict x)
{
    lanes scale = OF_FOUR(scale4);
    FOR_MINE (q, n)
        x[q] *= scale;
}

/* Sum x'x. */
__kernel FLAT_ITEMS void problem_square(uint n, __global const lanes *restrict x, __global double4 *restrict parts,
                                        uint slot)
{
    __local double4 tree[FLAT];
    dlanes sum = 0;
    FOR_MINE (q, n)
        sum += AS_DOUBLE(x[q]) * AS_DOUBLE(x[q]);
    put_sum(of_lanes(sum), tree, parts, slot);
}

/* ---- solve/lambda.c ------------------------------------------------------------------------------*/

/* Mean of the 2x2 bins at `at`; false where one of them has no weight.  With weights per channel, of those bins that
 * measured a channel; false where one has none. */
static inline bool mean2x2(__global const lanes *b, __global const float *w, __global const float4 *w4, int per_channel,
                           int at, int wide, lanes *out)
{
    lanes s = SPLAT(0);
#if CS == 4
    if (per_channel) {
        float4 weight = (float4)(0, 0, 0, 1);
        for (int m = 0; m < 4; m++) {
            int i = at + m % 2 + m / 2 * wide;
            float4 of = w4[i];
            s += of * b[i];
            weight += of;
            if (!any(of > SPLAT(0)))
                return false;
        }
        *out = s / weight;
        return all(weight > SPLAT(0));
    }
#endif
    for (int m = 0; m < 4; m++) {
        int i = at + m % 2 + m / 2 * wide;
        if (w[i] == 0)
            return false;
        s += b[i];
    }
    *out = s * 0.25f;
    return true;
}

/* Sums of squared first and second differences over the 2x2 blocks of A's rows; how many. */
__kernel FLAT_ITEMS void problem_differences(uint bins, __constant const struct rec_cl_geometry *g,
                                             __global const uint *restrict tile, __global const uchar *restrict is_row,
                                             __global const lanes *restrict b, __global const float *restrict w,
                                             __global const float4 *restrict w4, int per_channel,
                                             __global double4 *restrict parts, uint slot)
{
    __local double4 tree[FLAT];
    dlanes first = 0, second = 0;
    uint blocks = 0;
    FOR_MINE (e, bins) {
        int i = bin_of(g, tile, e);
        if (i < 0 || !is_row[i])
            continue;
        int c = row_camera(g, i);
        int wide = g->camera[c].bw, y = (i - g->camera[c].row0) / wide, x = (i - g->camera[c].row0) % wide;
        lanes v, l, u, d, r;
        if (x % 2 != 0 || y % 2 != 0 || x < 2 || y < 2 || x + 3 >= wide || y + 3 >= g->camera[c].bh ||
            !mean2x2(b, w, w4, per_channel, i, wide, &v) || !mean2x2(b, w, w4, per_channel, i - 2, wide, &l) ||
            !mean2x2(b, w, w4, per_channel, i + 2, wide, &r) ||
            !mean2x2(b, w, w4, per_channel, i - 2 * wide, wide, &u) ||
            !mean2x2(b, w, w4, per_channel, i + 2 * wide, wide, &d))
            continue;
        lanes lap = 4 * v - l - r - u - d, dx = r - v, dy = d - v;
        first += AS_DOUBLE(dx) * AS_DOUBLE(dx);
        first += AS_DOUBLE(dy) * AS_DOUBLE(dy);
        second += AS_DOUBLE(lap) * AS_DOUBLE(lap);
        blocks++;
    }
    put_sum(of_lanes(first), tree, parts, slot);
    put_sum(of_lanes(second), tree, parts, slot + 1);
    put_sum((double4)(blocks, 0, 0, 0), tree, parts, slot + 2);
}
