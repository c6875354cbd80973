/* pcg.cl - the loops of solve/passes/pcg_pass_impl.h.  Equations (1) to (6) are those of solve/pcg.c.
 *
 * An item takes a column with all its lanes, or a bin.  The order of operations is the host's, so that vectors are the
 * same to the bit where they do not come from a product.  Sums go to parts from a slot on. */

/* ---- second differences --------------------------------------------------------------------------*/

/* Neighbours of column q at -x +x -y +y -z +z: q itself where there is none.  Returns which there are. */
static inline uint neighbours(__global const int *near, uint room, uint q, uint at[6])
{
    uint have = 0;
    for (uint f = 0; f < 6; f++) {
        int k = near[(size_t)f * room + q];
        at[f] = k < 0 ? q : (uint)k;
        have |= (uint)(k >= 0) << f;
    }
    return have;
}
/* (1) of solve/smooth.h at column q. */
static inline lanes differences(__global const struct rec_cl_smooth *s, __global const int *near, uint room,
                                __global const lanes *v, uint q)
{
    uint at[6], have = neighbours(near, room, q, at);
    lanes x = v[at[0]] + v[at[1]], y = v[at[2]] + v[at[3]], z = v[at[4]] + v[at[5]];
    return s->centre[have] * v[q] - (s->axis[0] * x + s->axis[1] * y + s->axis[2] * z);
}

/* d = 0, V = 1, the diagonal of L L. */
__kernel FLAT_ITEMS void pcg_begin(uint n, __global const struct rec_cl_smooth *s, __global const int *near, uint room,
                                   __global lanes *restrict d, __global float *restrict diag2,
                                   __global float *restrict by, __global float *restrict inverse,
                                   __global float *restrict diag)
{
    FOR_MINE (q, n) {
        uint at[6], have = neighbours(near, room, q, at);
        float v = s->diag2[have];
        d[q] = SPLAT(0);
        diag2[q] = v;
        diag[q] = v;
        by[q] = 1;
        inverse[q] = 1;
    }
}

/* S of (6). */
__kernel FLAT_ITEMS void pcg_scale(uint n, float4 share4, float4 lambda4, __global const float *restrict diag,
                                   __global const float *restrict stiff, __global const float *restrict inverse,
                                   __global lanes *restrict scale)
{
    lanes share = OF_FOUR(share4), lambda = OF_FOUR(lambda4);
    FOR_MINE (q, n) {
        lanes h = share * diag[q] + lambda * stiff[q];
        lanes s = sqrt(SPLAT(sqrt(inverse[q])) / h);
        scale[q] = select(SPLAT(0), s, h > SPLAT(0));
    }
}

/* ---- an iteration --------------------------------------------------------------------------------*/

/* d of (4); sum d'phi. */
__kernel FLAT_ITEMS void pcg_direction(uint n, float4 beta4, float4 mu4, __global const lanes *restrict x,
                                       __global const lanes *restrict phi, __global const lanes *restrict scale,
                                       __global lanes *restrict d, __global double4 *restrict parts, uint slot)
{
    __local double4 tree[FLAT];
    lanes beta = OF_FOUR(beta4), mu = OF_FOUR(mu4), zero = SPLAT(0);
    dlanes sum = 0;
    FOR_MINE (q, n) {
        lanes p = phi[q], s = scale[q], z = s * p;
        lanes v = beta * d[q] - mu * s * z;
        v = select(zero, v, (x[q] > zero) | (p < zero));
        d[q] = v;
        sum += AS_DOUBLE(v) * AS_DOUBLE(p);
    }
    put_sum(of_lanes(sum), tree, parts, slot);
}

/* q'Wq over the rows; q = A d. */
__kernel FLAT_ITEMS void pcg_rows_square(uint bins, __constant const struct rec_cl_geometry *g,
                                         __global const uint *restrict tile, __global const float *restrict w,
                                         __global const float4 *restrict w4, int per_channel,
                                         __global const lanes *restrict ad, __global double4 *restrict parts, uint slot)
{
    __local double4 tree[FLAT];
    dlanes sum = 0;
    FOR_MINE (e, bins) {
        int i = bin_of(g, tile, e);
        if (i < 0)
            continue;
        lanes v = ad[i];
        sum += AS_DOUBLE(weight_of(w, w4, per_channel, i) * v) * AS_DOUBLE(v);
    }
    put_sum(of_lanes(sum), tree, parts, slot);
}
/* d'L V L d. */
__kernel FLAT_ITEMS void pcg_curvature(uint n, __global const struct rec_cl_smooth *s, __global const int *near,
                                       uint room, __global const lanes *d, __global const float *restrict by,
                                       __global double4 *restrict parts, uint slot)
{
    __local double4 tree[FLAT];
    dlanes sum = 0;
    FOR_MINE (q, n) {
        lanes v = differences(s, near, room, d, q);
        sum += AS_DOUBLE(v) * AS_DOUBLE(by[q] * v);
    }
    put_sum(of_lanes(sum), tree, parts, slot);
}

/* (5): next; sum ||next - x||^2.  e = s/alpha - d, which is 0 except in clipped columns; inverse: 1/alpha. */
__kernel FLAT_ITEMS void pcg_step(uint n, float4 alpha4, float4 inverse4, __global const lanes *restrict x,
                                  __global const lanes *restrict d, __global lanes *restrict next,
                                  __global lanes *restrict e, __global double4 *restrict parts, uint slot)
{
    __local double4 tree[FLAT];
    lanes alpha = OF_FOUR(alpha4), inverse = OF_FOUR(inverse4), zero = SPLAT(0);
    dlanes sum = 0;
    FOR_MINE (q, n) {
        lanes from = x[q], s = d[q], to = from + alpha * s, y = select(zero, to, to >= zero);
        next[q] = y;
        e[q] = select(zero, -from * inverse - s, to < zero);
        sum += AS_DOUBLE(y - from) * AS_DOUBLE(y - from);
    }
    put_sum(of_lanes(sum), tree, parts, slot);
}

/* r += alpha q, q = W r; sum r'Wr. */
__kernel FLAT_ITEMS void pcg_rows_step(uint bins, __constant const struct rec_cl_geometry *g,
                                       __global const uint *restrict tile, __global const float *restrict w,
                                       __global const float4 *restrict w4, int per_channel, float4 alpha4,
                                       __global lanes *restrict r, __global lanes *restrict ad,
                                       __global double4 *restrict parts, uint slot)
{
    __local double4 tree[FLAT];
    lanes alpha = OF_FOUR(alpha4);
    dlanes sum = 0;
    FOR_MINE (e, bins) {
        int i = bin_of(g, tile, e);
        if (i < 0)
            continue;
        lanes v = r[i] + alpha * ad[i], wr = weight_of(w, w4, per_channel, i) * v;
        r[i] = v;
        ad[i] = wr;
        sum += AS_DOUBLE(wr) * AS_DOUBLE(v);
    }
    put_sum(of_lanes(sum), tree, parts, slot);
}

/* lx = V L x; sums x'L lx, ||x||^2. */
__kernel FLAT_ITEMS void pcg_smoothness(uint n, __global const struct rec_cl_smooth *s, __global const int *near,
                                        uint room, __global const lanes *x, __global const float *restrict by,
                                        __global const float *restrict inverse, __global lanes *restrict lx,
                                        __global double4 *restrict parts, uint slot)
{
    __local double4 tree[FLAT];
    dlanes penalty = 0, norm2 = 0;
    FOR_MINE (q, n) {
        lanes v = x[q], l = by[q] * differences(s, near, room, x, q);
        lx[q] = l;
        penalty += AS_DOUBLE(l) * AS_DOUBLE(inverse[q] * l);
        norm2 += AS_DOUBLE(v) * AS_DOUBLE(v);
    }
    put_sum(of_lanes(penalty), tree, parts, slot);
    put_sum(of_lanes(norm2), tree, parts, slot + 1);
}

/* phi of (3) from ar = A'W r and lx; sums phi'M phi, phi'M phi_old. */
__kernel FLAT_ITEMS void pcg_gradient(uint n, __global const struct rec_cl_smooth *s, __global const int *near,
                                      uint room, float4 lambda4, __global const lanes *restrict x,
                                      __global const lanes *restrict ar, __global const lanes *lx,
                                      __global const lanes *restrict scale, __global const lanes *restrict old,
                                      __global lanes *restrict phi, __global double4 *restrict parts, uint slot)
{
    __local double4 tree[FLAT];
    lanes lambda = OF_FOUR(lambda4), zero = SPLAT(0);
    dlanes square = 0, cross = 0;
    FOR_MINE (q, n) {
        lanes v = ar[q] + lambda * differences(s, near, room, lx, q);
        v = select(zero, v, (x[q] > zero) | (v < zero));
        phi[q] = v;
        lanes m = scale[q], sv = m * v;
        square += AS_DOUBLE(sv) * AS_DOUBLE(sv);
        cross += AS_DOUBLE(m * sv) * AS_DOUBLE(old[q]);
    }
    put_sum(of_lanes(square), tree, parts, slot);
    put_sum(of_lanes(cross), tree, parts, slot + 1);
}

/* ---- a step back ---------------------------------------------------------------------------------*/

/* phi's of the step s from x to next. */
__kernel FLAT_ITEMS void pcg_slope(uint n, __global const lanes *restrict x, __global const lanes *restrict next,
                                   __global const lanes *restrict phi, __global double4 *restrict parts,
                                   uint slot)
{
    __local double4 tree[FLAT];
    dlanes sum = 0;
    FOR_MINE (q, n)
        sum += AS_DOUBLE(next[q] - x[q]) * AS_DOUBLE(phi[q]);
    put_sum(of_lanes(sum), tree, parts, slot);
}
/* Moves next to the share `back` of the way from x. */
__kernel FLAT_ITEMS void pcg_retreat(uint n, float4 back4, __global const lanes *restrict x,
                                     __global lanes *restrict next)
{
    lanes back = OF_FOUR(back4), zero = SPLAT(0);
    FOR_MINE (q, n) {
        lanes y = x[q] + back * (next[q] - x[q]);
        next[q] = select(zero, y, y > zero);
    }
}

/* ---- (2a) ----------------------------------------------------------------------------------------*/

/* y to next, a float a column; lx = L x; sums y, y^2, columns with x > 0. */
__kernel FLAT_ITEMS void pcg_brightness(uint n, __global const lanes *restrict x,
                                        __global const float *restrict inverse, __global lanes *restrict lx, __global float *restrict next,
                                        __global double4 *restrict parts, uint slot)
{
    __local double4 tree[FLAT];
    double bright = 0, square = 0;
    dlanes lit = 0;
    FOR_MINE (q, n) {
        lanes v = x[q], l = inverse[q] * lx[q], y = v - 0.125f * l;
        lx[q] = l;
#if CS == 4
        float all = (y.x + y.y) + (y.z + y.w);
#else
        float all = y;
#endif
        next[q] = all;
        bright += (double)all;
        square += (double)all * (double)all;
        lit += AS_DOUBLE(select(SPLAT(0), SPLAT(1), v > SPLAT(0)));
    }
    put_sum((double4)(bright, 0, 0, 0), tree, parts, slot);
    put_sum((double4)(square, 0, 0, 0), tree, parts, slot + 1);
    put_sum(of_lanes(lit), tree, parts, slot + 2);
}
/* V from y of `next`, lx = V lx; sum x'L lx.  y / y_usual + dark, scale: 1 / y_usual. */
__kernel FLAT_ITEMS void pcg_stiffness(uint n, float dark, float scale, __global const float *restrict next,
                                       __global const float *restrict diag2, __global float *restrict by,
                                       __global float *restrict inverse, __global float *restrict diag,
                                       __global lanes *restrict lx, __global double4 *restrict parts, uint slot)
{
    __local double4 tree[FLAT];
    dlanes sum = 0;
    FOR_MINE (q, n) {
        float y = next[q], root = sqrt(dark + scale * (y > 0 ? y : 0)), v = 1 / root;
        lanes l = v * lx[q];
        inverse[q] = root;
        by[q] = v;
        diag[q] = v * diag2[q];
        lx[q] = l;
        sum += AS_DOUBLE(l) * AS_DOUBLE(root * l);
    }
    put_sum(of_lanes(sum), tree, parts, slot);
}
