/* blend.cl - the loops of solve/blend.c; the equations are those of solve/blend.h.  Four lanes of `t`, one of the sum,
 * whatever CS is. */

static inline float blend_sum(float4 c, float4 v)
{
    v *= c;
    return (v.x + v.y) + v.z;
}

/* Sums of x s, s^2 and x^2, s = sum c x. */
__kernel FLAT_ITEMS void blend_colours(uint n, float4 c, __global const float4 *restrict x,
                                       __global double4 *restrict parts, uint slot)
{
    __local double4 tree[FLAT];
    double4 xs = 0, ss = 0, xx = 0;
    FOR_MINE (q, n) {
        double4 v = convert_double4(x[q]), s = (double4)(blend_sum(c, x[q]));
        xs += v * s;
        ss += s * s;
        xx += v * v;
    }
    put_sum(xs, tree, parts, slot);
    put_sum(ss, tree, parts, slot + 1);
    put_sum(xx, tree, parts, slot + 2);
}

/* b, r, W r of (1) and (2); sum r'Wr. */
__kernel FLAT_ITEMS void blend_rows(uint bins, __constant const struct rec_cl_geometry *g,
                                    __global const uint *restrict tile, __global const float *restrict w, float4 c,
                                    __global const float4 *restrict b, __global const float4 *restrict r,
                                    __global float *restrict one_b, __global float *restrict one_r,
                                    __global float *restrict one_wr, __global double4 *restrict parts, uint slot)
{
    __local double4 tree[FLAT];
    double sum = 0;
    FOR_MINE (e, bins) {
        int i = bin_of(g, tile, e);
        if (i < 0)
            continue;
        float v = blend_sum(c, r[i]), wv = w[i] * v;
        one_b[i] = blend_sum(c, b[i]);
        one_r[i] = v;
        one_wr[i] = wv;
        sum += (double)wv * (double)v;
    }
    put_sum((double4)(sum, 0, 0, 0), tree, parts, slot);
}
/* x of (2), d = 0. */
__kernel FLAT_ITEMS void blend_columns(uint n, float4 c, __global const float4 *restrict x,
                                       __global float *restrict one_x, __global float *restrict one_d)
{
    FOR_MINE (q, n) {
        one_x[q] = blend_sum(c, x[q]);
        one_d[q] = 0;
    }
}

/* Sums of x, s_0. */
__kernel FLAT_ITEMS void blend_tint(uint n, float4 c, __global const float4 *restrict x,
                                    __global double4 *restrict parts, uint slot)
{
    __local double4 tree[FLAT];
    double4 sum = 0, all = 0;
    FOR_MINE (q, n) {
        sum += convert_double4(x[q]);
        all += (double4)(blend_sum(c, x[q]));
    }
    put_sum(sum, tree, parts, slot);
    put_sum(all, tree, parts, slot + 1);
}
/* (4); least: e. */
__kernel FLAT_ITEMS void blend_colour(uint n, float4 c, float4 tint, float least,
                                      __global const float *restrict one_x, __global float4 *restrict x)
{
    FOR_MINE (q, n) {
        float4 v = x[q];
        float s = one_x[q] / (blend_sum(c, v) + least);
        x[q] = (v + least * tint) * s;
    }
}
