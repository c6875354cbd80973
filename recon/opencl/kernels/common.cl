/* common.cl - what all kernels share.  It stands before each of them in the program.
 *
 * CS: lanes of a vector's entry, 1 for one channel and 4 for three.  Each kernel is compiled for both.
 * Floats are stored, sums are double.  No product is contracted to a fused one, as on the host. */
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
#pragma OPENCL FP_CONTRACT OFF

#define GROUP 64  /* run.h: REC_CL_GROUP, */
#define FLAT  256 /* REC_CL_FLAT, */
#define PARTS 512 /* REC_CL_PARTS */
#define GROUP_ITEMS __attribute__((reqd_work_group_size(GROUP, 1, 1)))
#define FLAT_ITEMS  __attribute__((reqd_work_group_size(FLAT, 1, 1)))

#if CS == 4
typedef float4 lanes;
typedef double4 dlanes;
typedef int4 ilanes;
#define AS_DOUBLE(v) convert_double4(v)
#define SPLAT(v)     ((float4)(v))
#define OF_FOUR(v)   (v)
#define ANY(m)       any(m) /* of a comparison */
#else
typedef float lanes;
typedef double dlanes;
typedef int ilanes;
#define AS_DOUBLE(v) ((double)(v))
#define SPLAT(v)     ((float)(v))
#define OF_FOUR(v)   ((v).x) /* of an argument with four lanes */
#define ANY(m)       ((m) != 0)
#endif

/* The piece [from, to) of n items that belongs to this group; its items go through it in steps of the group's size. */
static inline void piece(uint n, uint *from, uint *to)
{
    uint groups = (uint)get_num_groups(0), size = (n + groups - 1) / groups;
    *from = min(n, (uint)get_group_id(0) * size);
    *to = min(n, *from + size);
}

/* Weight of bin i in every lane. */
static inline lanes weight_of(__global const float *w, __global const float4 *w4, int per_channel, int i)
{
#if CS == 4
    if (per_channel)
        return w4[i];
#endif
    return SPLAT(w[i]);
}

/* for (every one of n items in the group's piece that is this item's). */
#define FOR_MINE(q, n)       \
    uint q, q##_to;          \
    piece(n, &q, &q##_to);   \
    for (q += (uint)get_local_id(0); q < q##_to; q += (uint)get_local_size(0))

/* The camera of a tile. */
static inline int tile_camera(__constant const struct rec_cl_geometry *g, uint tile)
{
    int c = 0;
    while (c + 1 < g->cameras && (int)tile >= g->camera[c + 1].tile0)
        c++;
    return c;
}
/* The camera of a row. */
static inline int row_camera(__constant const struct rec_cl_geometry *g, int row)
{
    int c = 0;
    while (c + 1 < g->cameras && row >= g->camera[c + 1].row0)
        c++;
    return c;
}
/* The row of bin i of a tile; -1: it is beside the picture. */
static inline int tile_bin(__constant const struct rec_cl_geometry *g, uint tile, uint i)
{
    int c = tile_camera(g, tile), n = (int)tile - g->camera[c].tile0, bw = g->camera[c].bw;
    int x = n % g->camera[c].tiles * REC_CL_TILE + (int)i % REC_CL_TILE;
    int y = n / g->camera[c].tiles * REC_CL_TILE + (int)i / REC_CL_TILE;
    return x < bw && y < g->camera[c].bh ? g->camera[c].row0 + y * bw + x : -1;
}
/* Bin e of the active tiles, GROUP bins each: its row. */
static inline int bin_of(__constant const struct rec_cl_geometry *g, __global const uint *tile, uint e)
{
    return tile_bin(g, tile[e / GROUP], e % GROUP);
}

/* The sum of v of all items of the group, for all of them.  tree: local, one double4 an item.  All items of the group
 * call it. */
static inline double4 group_sum(double4 v, __local double4 *tree)
{
    uint i = (uint)get_local_id(0);
    tree[i] = v;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (uint step = (uint)get_local_size(0) / 2; step > 0; step /= 2) {
        if (i < step)
            tree[i] += tree[i + step];
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    v = tree[0];
    barrier(CLK_LOCAL_MEM_FENCE);
    return v;
}
/* The same to parts[slot][group]. */
static inline void put_sum(double4 v, __local double4 *tree, __global double4 *parts, uint slot)
{
    v = group_sum(v, tree);
    if (get_local_id(0) == 0)
        parts[slot * PARTS + get_group_id(0)] = v;
}
static inline double4 of_lanes(dlanes v)
{
#if CS == 4
    return v;
#else
    return (double4)(v, 0, 0, 0);
#endif
}

/* The voxel of place o of a brick; -1: it is beside the grid. */
static inline int brick_voxel(__constant const struct rec_cl_geometry *g, uint brick, uint o)
{
    int b = (int)brick, p = (int)o, row = b / g->bricks[0];
    int i = b % g->bricks[0] * 4 + p % 4;
    int j = row % g->bricks[1] * 4 + p / 4 % 4;
    int k = row / g->bricks[1] * 4 + p / 16;
    return i < g->n[0] && j < g->n[1] && k < g->n[2] ? (k * g->n[1] + j) * g->n[0] + i : -1;
}

/* The sum of v of the items before this one; *all: of all GROUP items.  sum: local, one an item.  All items of the group
 * call it. */
static inline uint sum_before(uint v, __local uint *sum, uint *all)
{
    uint i = (uint)get_local_id(0);
    sum[i] = v;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (uint step = 1; step < GROUP; step *= 2) {
        uint left = i >= step ? sum[i - step] : 0;
        barrier(CLK_LOCAL_MEM_FENCE);
        sum[i] += left;
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    uint before = sum[i] - v;
    *all = sum[GROUP - 1];
    barrier(CLK_LOCAL_MEM_FENCE);
    return before;
}

/* ---- pictures in bands (photo.cl, lit.cl, unpack.cl) ---- */

#define BAND_ROWS 16 /* bands.h: REC_BAND_ROWS */
#define UNLIT     0  /* photo_pass.h */
#define LIT       1
#define FORCED    2

#if CS == 4
#define LANES_OF(v) vload4(0, v)
#else
#define LANES_OF(v) ((v)[0])
#endif

/* The band of a group: its camera, first row and number of bins. */
struct strip {
    int camera, y0, bins;
};
static inline struct strip strip_of(__global const struct rec_cl_picture *shot, __global const int2 *band)
{
    int2 b = band[get_group_id(0)];
    int rows = min(BAND_ROWS, shot[b.x].bh - b.y);
    return (struct strip){b.x, b.y, rows * shot[b.x].bw};
}

/* Of what FLAT items have: the sums of x, y, z and the greatest w; for all of them. */
static inline int4 count_group(int4 v, __local int4 *tree)
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
