/* rows.cl - S by rows, from its windows (matrix.h): once for a matrix.
 *
 *   brick_rects   the bins of each camera in which a brick has entries; the host lists the pairs of tiles and bricks
 *   pair_sizes    what each pair takes; the host says where it is
 *   pair_fill     the entries
 * A pair is read column by column.  A bin's voxels are a set of 64 bits, so any order in which they come gives the same
 * entries. */

/* A tile: its camera's rows, and its first bin in the picture. */
struct tile {
    int camera, row0, bw, x, y;
};
static inline struct tile tile_at(__constant const struct rec_cl_geometry *g, uint number)
{
    struct tile t;
    t.camera = tile_camera(g, number);
    t.row0 = g->camera[t.camera].row0;
    t.bw = g->camera[t.camera].bw;
    int n = (int)number - g->camera[t.camera].tile0, tiles = g->camera[t.camera].tiles;
    t.x = n % tiles * REC_CL_TILE;
    t.y = n / tiles * REC_CL_TILE;
    return t;
}

/* Grows a rectangle (x0, y0, -x1, -y1) by a window's bins that have a weight; weight k of the window is w[k/4*step + k%4]. */
static inline int4 grow(__constant const struct rec_cl_geometry *g, int camera, int first,
                        __global const uchar *w, int step, int4 r)
{
    int bin = first - g->camera[camera].row0, bw = g->camera[camera].bw;
    int x0 = bin % bw, y0 = bin / bw;
    for (int k = 0; k < g->high * g->wide; k++)
        if (w[k / 4 * step + k % 4] != 0) {
            int x = x0 + k % g->wide, y = y0 + k / g->wide;
            r = min(r, (int4)(x, y, -x, -y));
        }
    return r;
}

/* rect [stored][cameras]: x0, y0, x1, y1; x0 > x1: no entry.  A group a brick and camera, from
 * group `first` on. */
__kernel GROUP_ITEMS void
brick_rects(__constant const struct rec_cl_geometry *g, ulong first,
            __global const int *restrict at, __global const uchar *restrict w, __global const struct rec_cl_more *restrict more,
            __global const uint *restrict more_from, __global ushort4 *restrict rect)
{
    __local int4 tree[GROUP];
    size_t group = first + get_group_id(0);
    uint o = (uint)get_local_id(0), s = (uint)(group / (uint)g->cameras);
    int camera = (int)(group % (uint)g->cameras), row = at[group * GROUP + o];
    int4 r = (int4)(65535, 65535, 0, 0);
    if (row != REC_CL_NOWHERE)
        r = grow(g, camera, row, w + (group * (uint)(g->high * g->wide / 4) * GROUP + o) * 4,
                 4 * GROUP, r);
    for (uint m = more_from[s] + o; m < more_from[s + 1]; m += GROUP)
        if (more[m].camera == camera)
            r = grow(g, camera, more[m].at, more[m].w, 4, r);
    tree[o] = r;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (uint dist = GROUP / 2; dist > 0; dist /= 2) {
        if (o < dist)
            tree[o] = min(tree[o], tree[o + dist]);
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    if (o == 0)
        rect[group] = convert_ushort4((int4)(tree[0].xy, -tree[0].zw));
}

/* The two halves of a bin's voxels. */
struct met {
    uint low, high;
};
static inline uint voxels_of(struct met m)
{
    return popcount(m.low) + popcount(m.high);
}
/* Those of them before voxel o. */
static inline uint voxels_before(struct met m, uint o)
{
    uint bits = (1u << (o & 31)) - 1;
    return o < 32 ? popcount(m.low & bits) : popcount(m.low) + popcount(m.high & bits);
}

/* Bit i: bin i has some. */
static inline ulong bins_of(__local const struct met *m)
{
    ulong bins = 0;
    for (uint i = 0; i < GROUP; i++)
        bins |= (ulong)((m[i].low | m[i].high) != 0) << i;
    return bins;
}

/* A window of voxel o.  out NULL: marks its bins in met; else writes its entries, those of a bin from start[bin] on. */
static inline void meet(__constant const struct rec_cl_geometry *g, struct tile t, uint o, int first,
                        __global const uchar *w, int step, __local struct met *met,
                        __local const uint *start, __global ushort *out)
{
    int bin = first - t.row0, x0 = bin % t.bw - t.x, y0 = bin / t.bw - t.y;
    for (int k = 0; k < g->high * g->wide; k++) {
        int x = x0 + k % g->wide, y = y0 + k / g->wide;
        uint weight = w[k / 4 * step + k % 4];
        if (weight == 0 || x < 0 || y < 0 || x >= REC_CL_TILE || y >= REC_CL_TILE)
            continue;
        int b = y * REC_CL_TILE + x;
        if (out != 0)
            out[start[b] + voxels_before(met[b], o)] = (ushort)(o << 8 | weight);
        else
            atomic_or(o < 32 ? &met[b].low : &met[b].high, 1u << (o & 31)); /* in any order the same */
    }
}
/* All windows of brick s in the tile.  Item o has voxel o. */
static inline void meet_brick(__constant const struct rec_cl_geometry *g, struct tile t, uint s,
                              __global const int *at, __global const uchar *w,
                              __global const struct rec_cl_more *more,
                              __global const uint *more_from, __local struct met *met,
                              __local const uint *start, __global ushort *out)
{
    uint o = (uint)get_local_id(0);
    size_t window = (size_t)s * (uint)g->cameras + (uint)t.camera;
    int first = at[window * GROUP + o];
    if (first != REC_CL_NOWHERE)
        meet(g, t, o, first, w + (window * (uint)(g->high * g->wide / 4) * GROUP + o) * 4,
             4 * GROUP, met, start, out);
    for (uint m = more_from[s] + o; m < more_from[s + 1]; m += GROUP)
        if (more[m].camera == t.camera)
            meet(g, t, (uint)more[m].voxel, more[m].at, more[m].w, 4, met, start, out);
}

/* size [pairs]: the entries of a pair, with the numbers before them; 0: it has none.  A group a tile, from `tile0` on. */
__kernel GROUP_ITEMS void
pair_sizes(__constant const struct rec_cl_geometry *g, uint tile0, __global const int *restrict at,
           __global const uchar *restrict w, __global const struct rec_cl_more *restrict more,
           __global const uint *restrict more_from, __global const uint *restrict tile_from,
           __global const uint *restrict pair_brick, __global uint *restrict size)
{
    __local struct met met[GROUP];
    __local uint sum[GROUP];
    uint tile = tile0 + (uint)get_group_id(0), o = (uint)get_local_id(0);
    struct tile t = tile_at(g, tile);
    for (uint p = tile_from[tile]; p < tile_from[tile + 1]; p++) {
        met[o].low = met[o].high = 0;
        barrier(CLK_LOCAL_MEM_FENCE);
        meet_brick(g, t, pair_brick[p], at, w, more, more_from, met, 0, 0);
        barrier(CLK_LOCAL_MEM_FENCE);
        uint n = voxels_of(met[o]), all;
        (void)sum_before(n + (n > 0), sum, &all);
        if (o == 0)
            size[p] = all + (all > 0);
    }
}

/* pair_bins and rows.  A group a tile, from `tile0` on. */
__kernel GROUP_ITEMS void
pair_fill(__constant const struct rec_cl_geometry *g, uint tile0, __global const int *restrict at,
          __global const uchar *restrict w, __global const struct rec_cl_more *restrict more,
          __global const uint *restrict more_from, __global const uint *restrict tile_from,
          __global const uint *restrict pair_brick, __global const uint *restrict pair_at,
          __global ulong *restrict pair_bins, __global ushort *restrict rows)
{
    __local struct met met[GROUP];
    __local uint sum[GROUP], start[GROUP];
    uint tile = tile0 + (uint)get_group_id(0), o = (uint)get_local_id(0);
    struct tile t = tile_at(g, tile);
    for (uint p = tile_from[tile]; p < tile_from[tile + 1]; p++) {
        __global ushort *out = rows + (size_t)pair_at[p] * REC_CL_UNIT;
        met[o].low = met[o].high = 0;
        barrier(CLK_LOCAL_MEM_FENCE);
        meet_brick(g, t, pair_brick[p], at, w, more, more_from, met, 0, 0);
        barrier(CLK_LOCAL_MEM_FENCE);
        uint n = voxels_of(met[o]), bins, all;
        uint head = sum_before(n > 0, sum, &bins), before = sum_before(n, sum, &all);
        start[o] = bins + 1 + before;
        if (n > 0)
            out[head] = (ushort)start[o];
        if (o == 0)
            out[bins] = (ushort)(bins + 1 + all);
        barrier(CLK_LOCAL_MEM_FENCE);
        meet_brick(g, t, pair_brick[p], at, w, more, more_from, met, start, out);
        if (o == 0)
            pair_bins[p] = bins_of(met);
        barrier(CLK_LOCAL_MEM_FENCE | CLK_GLOBAL_MEM_FENCE);
    }
}
