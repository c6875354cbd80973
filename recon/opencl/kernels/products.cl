/* products.cl - products with a restricted system (products.h), and what it takes to make one. */

/* ---- rows --------------------------------------------------------------------------------------- */

/* The entries of a bin in a pair. */
struct row {
    __global const ushort *at, *end;
};
/* bins, head: the pair's bins with entries, and its numbers (matrix.h). */
static inline struct row row_of(ulong bins, uint bin, __global const ushort *head)
{
    struct row r = {head, head};
    if ((bins >> bin & 1) != 0) {
        uint k = (uint)popcount(bins & (((ulong)1 << bin) - 1));
        r.at = head + head[k];
        r.end = head + head[k + 1];
    }
    return r;
}

/* active [stored]: the voxels of a brick that are columns.  A group a stored brick. */
__kernel GROUP_ITEMS void
find_active(__constant const struct rec_cl_geometry *g, __global const uint *restrict brick,
            __global const int *restrict map, __global ulong *restrict active)
{
    __local ulong bits[GROUP];
    uint s = (uint)get_group_id(0), o = (uint)get_local_id(0);
    int voxel = brick_voxel(g, brick[s], o);
    bits[o] = voxel >= 0 && map[voxel] >= 0 ? (ulong)1 << o : 0;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (uint step = GROUP / 2; step > 0; step /= 2) {
        if (o < step)
            bits[o] |= bits[o + step];
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    if (o == 0)
        active[s] = bits[0];
}

/* The pairs of a tile whose brick is active, in their order; which of its bins are rows, and how many.  A group a tile
 * of all. */
__kernel GROUP_ITEMS void
mark_rows(__constant const struct rec_cl_geometry *g, ulong present,
          __global const uint *restrict tile_from, __global const uint *restrict pair_brick,
          __global const ulong *restrict pair_bins, __global const uint *restrict pair_at,
          __global const ushort *restrict rows, __global const ulong *restrict active,
          __global uint *restrict pair, __global uint *restrict tile_pairs,
          __global uint *restrict tile_rows, __global uchar *restrict is_row)
{
    __local ulong voxels[GROUP], bins[GROUP];
    __local uint at[GROUP], some[GROUP];
    uint tile = (uint)get_group_id(0), i = (uint)get_local_id(0);
    uint from = tile_from[tile], to = tile_from[tile + 1], n = 0;
    bool found = false;
    if ((present >> tile_camera(g, tile) & 1) == 0)
        to = from;
    for (uint first = from; first < to; first += GROUP) {
        uint p = first + i, all;
        ulong columns = p < to ? active[pair_brick[p]] : 0;
        uint before = sum_before(columns != 0, some, &all);
        if (columns != 0) {
            pair[from + n + before] = p;
            voxels[before] = columns;
            bins[before] = pair_bins[p];
            at[before] = pair_at[p];
        }
        barrier(CLK_LOCAL_MEM_FENCE);
        for (uint k = 0; k < all && !found; k++) {
            struct row r = row_of(bins[k], i, rows + (size_t)at[k] * REC_CL_UNIT);
            for (; r.at != r.end; r.at++)
                found |= (voxels[k] >> (*r.at >> 8) & 1) != 0;
        }
        n += all;
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    int row = tile_bin(g, tile, i);
    if (row >= 0)
        is_row[row] = found;
    uint found_by_all;
    (void)sum_before(found, some, &found_by_all);
    if (i == 0) {
        tile_pairs[tile] = n;
        tile_rows[tile] = found_by_all;
    }
}

/* lit [stored]: whether some x of the brick is not 0.  xb [stored][64]: x of the bricks that are lit, 0 where a voxel is
 * no column.  A group an active brick. */
__kernel GROUP_ITEMS void
spread(__constant const struct rec_cl_geometry *g, __global const uint *restrict brick,
       __global const int *restrict store, __global const int *restrict map,
       __global const lanes *restrict x, __global lanes *restrict xb, __global uchar *restrict lit)
{
    __local uchar some[GROUP];
    uint b = brick[get_group_id(0)], o = (uint)get_local_id(0), s = (uint)store[b];
    int voxel = brick_voxel(g, b, o), q = voxel < 0 ? -1 : map[voxel];
    lanes v = SPLAT(0);
    if (q >= 0)
        v = x[q];
    some[o] = (uchar)ANY(v != 0);
    barrier(CLK_LOCAL_MEM_FENCE);
    for (uint step = GROUP / 2; step > 0; step /= 2) {
        if (o < step)
            some[o] |= some[o + step];
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    if (some[0] != 0)
        xb[(size_t)s * GROUP + o] = v;
    if (o == 0)
        lit[s] = some[0];
}

/* y = A x, or y += A x, in the bins of an active tile.  y += A x leaves y's bits where A x is 0.  A group of 4 x 64 items
 * a tile: item i of each quarter has bin i.  The quarters take the pairs in turn, so that four are read at a time.  Their
 * sums are added last, in a fixed order. */
#define QUARTERS (FLAT / GROUP)
__kernel FLAT_ITEMS void
forward(__constant const struct rec_cl_geometry *g, __global const uint *restrict tiles,
        __global const uint *restrict tile_from, __global const uint *restrict tile_pairs,
        __global const uint *restrict pair, __global const uint *restrict pair_brick,
        __global const ulong *restrict pair_bins, __global const uint *restrict pair_at,
        __global const ushort *restrict rows, __global const lanes *restrict xb,
        __global const uchar *restrict lit, __global lanes *restrict y, int add)
{
    __local ulong bins[FLAT];
    __local uint at[FLAT], place[FLAT];
    __local lanes sum[FLAT];
    uint me = (uint)get_local_id(0), i = me % GROUP, tile = tiles[get_group_id(0)];
    uint n = tile_pairs[tile];
    size_t from = tile_from[tile];
    lanes total = SPLAT(0);
    for (uint first = 0; first < n; first += FLAT) {
        if (first + me < n) {
            uint p = pair[from + first + me], s = pair_brick[p];
            place[me] = s;
            at[me] = pair_at[p];
            bins[me] = lit[s] ? pair_bins[p] : 0; /* a sum of zeros is left out */
        }
        barrier(CLK_LOCAL_MEM_FENCE);
        for (uint k = me / GROUP; k < min(n - first, (uint)FLAT); k += QUARTERS) {
            struct row r = row_of(bins[k], i, rows + (size_t)at[k] * REC_CL_UNIT);
            __global const lanes *x = xb + (size_t)place[k] * GROUP;
            lanes of_brick = SPLAT(0);
            for (; r.at != r.end; r.at++)
                of_brick += (float)(*r.at & 255) * x[*r.at >> 8];
            total += of_brick;
        }
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    sum[me] = total;
    barrier(CLK_LOCAL_MEM_FENCE);
    int row = tile_bin(g, tile, i);
    if (me < GROUP && row >= 0) {
        lanes v = g->unit * ((sum[i] + sum[i + GROUP]) + (sum[i + 2 * GROUP] + sum[i + 3 * GROUP]));
        if (!add)
            y[row] = v;
        else if (ANY(v != 0)) /* else y keeps its bits */
            y[row] += v;
    }
}

/* ---- columns ------------------------------------------------------------------------------------ */

/* Where columns are. */
struct columns {
    __constant const struct rec_cl_geometry *g;
    ulong present;
    __global const int *at;
    __global const uchar4 *w;
    __global const struct rec_cl_more *more;
    __global const uint *more_from;
};
static inline bool is_present(const struct columns *s, int camera)
{
    return (s->present >> camera & 1) != 0;
}

/* A window: its weights by fours, `step` of them apart.  The first four are of bins first, first + 1, first + third and
 * first + third + 1, the next four of bins `down` later. */
struct window {
    __global const uchar4 *w;
    int step, first, third, down;
};
static inline struct window window_at(const struct columns *s, int camera, int first,
                                      __global const uchar4 *w, int step)
{
    int bw = s->g->camera[camera].bw, two = s->g->wide == 2;
    struct window v = {w, step, first, two ? bw : 2, two ? 2 * bw : bw};
    return v;
}
/* That of voxel o of brick b in a camera; first NOWHERE: there is none, or the camera is absent. */
static inline struct window own_window(const struct columns *s, uint b, uint o, int camera)
{
    size_t at = (size_t)b * (uint)s->g->cameras + (uint)camera;
    int first = is_present(s, camera) ? s->at[at * GROUP + o] : REC_CL_NOWHERE;
    size_t quads = (size_t)(s->g->high * s->g->wide / 4);
    return window_at(s, camera, first, s->w + at * quads * GROUP + o, GROUP);
}
/* Further window number m. */
static inline struct window more_window(const struct columns *s, uint m)
{
    __global const struct rec_cl_more *k = &s->more[m];
    int first = is_present(s, k->camera) ? k->at : REC_CL_NOWHERE;
    return window_at(s, k->camera, first, (__global const uchar4 *)k->w, 1);
}
/* The further windows of voxel o of brick b: [from, to). */
struct run {
    uint from, to;
};
static inline uint more_of(const struct columns *s, uint b, uint o)
{
    uint lo = s->more_from[b], hi = s->more_from[b + 1];
    while (lo < hi) {
        uint mid = lo + (hi - lo) / 2;
        if (s->more[mid].voxel < (int)o)
            lo = mid + 1;
        else
            hi = mid;
    }
    return lo;
}
static inline struct run more_run(const struct columns *s, uint b, uint o)
{
    struct run r = {more_of(s, b, o), more_of(s, b, o + 1)};
    return r;
}

/* sum + w'y.  A bin of weight 0 is not read: it need not be a row. */
static inline lanes add_window(const struct columns *s, struct window v, __global const lanes *y,
                               lanes sum)
{
    if (v.first == REC_CL_NOWHERE)
        return sum;
    y += v.first;
    for (int k = s->g->high * s->g->wide; k > 0; k -= 4, v.w += v.step, y += v.down) {
        uchar4 w = *v.w;
        if (w.x != 0)
            sum += (float)w.x * y[0];
        if (w.y != 0)
            sum += (float)w.y * y[1];
        if (w.z != 0)
            sum += (float)w.z * y[v.third];
        if (w.w != 0)
            sum += (float)w.w * y[v.third + 1];
    }
    return sum;
}

/* x = A'y.  A group an active brick, an item a voxel. */
__kernel GROUP_ITEMS void
adjoint(__constant const struct rec_cl_geometry *g, __global const uint *restrict brick,
        __global const int *restrict store, __global const int *restrict map, ulong present,
        __global const int *restrict at, __global const uchar4 *restrict w,
        __global const struct rec_cl_more *restrict more, __global const uint *restrict more_from,
        __global const lanes *restrict y, __global lanes *restrict x)
{
    const struct columns s = {g, present, at, w, more, more_from};
    uint number = brick[get_group_id(0)], o = (uint)get_local_id(0), b = (uint)store[number];
    int voxel = brick_voxel(g, number, o), q = voxel < 0 ? -1 : map[voxel];
    lanes sum = SPLAT(0);
    if (q < 0)
        return;
    for (int c = 0; c < g->cameras; c++)
        sum = add_window(&s, own_window(&s, b, o, c), y, sum);
    struct run r = more_run(&s, b, o);
    for (uint m = r.from; m < r.to; m++)
        sum = add_window(&s, more_window(&s, m), y, sum);
    x[q] = g->unit * sum;
}

/* The number of a window's entries, their sum, the sum of their squares. */
static inline ulong3 count_window(const struct columns *s, struct window v, ulong3 sum)
{
    if (v.first == REC_CL_NOWHERE)
        return sum;
    for (int k = s->g->high * s->g->wide; k > 0; k -= 4, v.w += v.step) {
        uint4 w = convert_uint4(*v.w), one = min(w, (uint4)(1)), square = w * w;
        sum.x += one.x + one.y + one.z + one.w;
        sum.y += w.x + w.y + w.z + w.w;
        sum.z += square.x + square.y + square.z + square.w;
    }
    return sum;
}
/* parts of slot, slot + 1, slot + 2: those of all of A.  Exact: they are integers below 2^53. */
__kernel FLAT_ITEMS void
count_entries(__constant const struct rec_cl_geometry *g, uint stored,
              __global const ulong *restrict active, ulong present, __global const int *restrict at,
              __global const uchar4 *restrict w, __global const struct rec_cl_more *restrict more,
              __global const uint *restrict more_from, __global double4 *restrict parts, uint slot)
{
    __local double4 tree[FLAT];
    const struct columns s = {g, present, at, w, more, more_from};
    uint o = (uint)get_local_id(0) % GROUP, from, to;
    ulong3 sum = 0;
    piece(stored, &from, &to);
    for (uint b = from + (uint)get_local_id(0) / GROUP; b < to; b += FLAT / GROUP) {
        if ((active[b] >> o & 1) == 0)
            continue;
        for (int c = 0; c < g->cameras; c++)
            sum = count_window(&s, own_window(&s, b, o, c), sum);
        struct run r = more_run(&s, b, o);
        for (uint m = r.from; m < r.to; m++)
            sum = count_window(&s, more_window(&s, m), sum);
    }
    put_sum((double4)((double)sum.x, 0, 0, 0), tree, parts, slot);
    put_sum((double4)((double)sum.y, 0, 0, 0), tree, parts, slot + 1);
    put_sum((double4)((double)sum.z, 0, 0, 0), tree, parts, slot + 2);
}

/* sum + (v'Wv, w'v) of a window's values v, in units. */
static inline double2 weigh_window(const struct columns *s, struct window v,
                                   __global const float *weight, double2 sum)
{
    if (v.first == REC_CL_NOWHERE)
        return sum;
    weight += v.first;
    for (int k = s->g->high * s->g->wide; k > 0; k -= 4, v.w += v.step, weight += v.down) {
        uchar4 w = *v.w;
        const uint each[4] = {w.x, w.y, w.z, w.w};
        const int bin[4] = {0, 1, v.third, v.third + 1};
        for (int i = 0; i < 4; i++)
            if (each[i] != 0) {
                double value = each[i], wv = value * weight[bin[i]];
                sum += (double2)(value * wv, wv);
            }
    }
    return sum;
}
/* d2 of each column; parts of slot and slot + 1: the sums of d2 and of w'v. */
__kernel FLAT_ITEMS void
column_norms(__constant const struct rec_cl_geometry *g, uint bricks,
             __global const uint *restrict brick, __global const int *restrict store,
             __global const int *restrict map, ulong present, __global const int *restrict at,
             __global const uchar4 *restrict w, __global const struct rec_cl_more *restrict more,
             __global const uint *restrict more_from, __global const float *restrict weight,
             __global float *restrict d2, __global double4 *restrict parts, uint slot)
{
    __local double4 tree[FLAT];
    const struct columns s = {g, present, at, w, more, more_from};
    uint o = (uint)get_local_id(0) % GROUP, from, to;
    double unit = g->unit, sum2 = 0, sum1 = 0;
    piece(bricks, &from, &to);
    for (uint k = from + (uint)get_local_id(0) / GROUP; k < to; k += FLAT / GROUP) {
        uint b = (uint)store[brick[k]];
        int voxel = brick_voxel(g, brick[k], o), q = voxel < 0 ? -1 : map[voxel];
        double2 sum = 0;
        if (q < 0)
            continue;
        for (int c = 0; c < g->cameras; c++)
            sum = weigh_window(&s, own_window(&s, b, o, c), weight, sum);
        struct run r = more_run(&s, b, o);
        for (uint m = r.from; m < r.to; m++)
            sum = weigh_window(&s, more_window(&s, m), weight, sum);
        d2[q] = (float)(unit * unit * sum.x);
        sum2 += d2[q];
        sum1 += (float)(unit * sum.y);
    }
    put_sum((double4)(sum2, 0, 0, 0), tree, parts, slot);
    put_sum((double4)(sum1, 0, 0, 0), tree, parts, slot + 1);
}
