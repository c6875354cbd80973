/* levels.cl - columns of all levels from the hull's voxels, and the pictures of coarser levels (solve/levels.h).
 *
 *   levels_mask     coarse bricks: a voxel is active if one of its children is
 *   levels_rows     active voxels of each row of voxels; scan.cl sums them up
 *   levels_fill     a group a row of voxels: map, col
 *   levels_near     neighbours of columns
 *   levels_tiles    tiles with rows
 *   levels_entries  sums of A's entries
 *   levels_average  a group a tile: pictures of a coarser level; levels_average4 with weights per channel
 * mask [levels][bricks]: bit o: voxel o of the brick is active. */

#define ROW  __attribute__((reqd_work_group_size(GROUP, 1, 1)))
#define MANY __attribute__((reqd_work_group_size(FLAT, 1, 1)))

/* ---- columns -------------------------------------------------------------------------------------*/

/* Bits of the voxels of a finer brick -> of their parents, in one eighth of the coarse brick: 0, 1, 4, 5, 16, ... */
static inline ulong parents_of(ulong m)
{
    m |= m >> 1;
    m |= m >> 4;
    m |= m >> 16;
    ulong out = 0;
    for (uint k = 0; k < 8; k++) {
        uint x = k & 1, y = k >> 1 & 1, z = k >> 2;
        out |= (m >> (z * 32 + y * 8 + x * 2) & 1) << (z * 16 + y * 4 + x);
    }
    return out;
}

/* Bricks of level l from those of level l - 1.  Their words are from `first` on. */
__kernel MANY void levels_mask(__constant const struct rec_cl_place *place, uint l, __global ulong *restrict mask,
                               __global uint *restrict word, uint first)
{
    __constant const struct rec_cl_place *p = place + l, *fine = p - 1;
    int b = (int)get_global_id(0), row = b / p->bricks[0];
    if (b >= (int)p->all_bricks)
        return;
    int x = b % p->bricks[0] * 2, y = row % p->bricks[1] * 2, z = row / p->bricks[1] * 2;
    ulong m = 0;
    for (int k = 0; k < 8; k++) {
        int i = x + (k & 1), j = y + (k >> 1 & 1), h = z + (k >> 2);
        if (i < fine->bricks[0] && j < fine->bricks[1] && h < fine->bricks[2]) {
            size_t at = (size_t)fine->brick + (size_t)((h * fine->bricks[1] + j) * fine->bricks[0] + i);
            m |= parents_of(mask[at]) << ((k >> 2) * 32 + (k >> 1 & 1) * 8 + (k & 1) * 2);
        }
    }
    mask[p->brick + (uint)b] = m;
    word[first + (uint)b] = m != 0;
}

/* Where row r of voxels lies in the masks: in its first brick, from bit *shift on. */
static inline size_t first_brick(__constant const struct rec_cl_place *p, uint r, uint *shift)
{
    uint y = r % (uint)p->n[1], z = r / (uint)p->n[1];
    *shift = (z % 4 * 4 + y % 4) * 4;
    return (size_t)p->brick + (size_t)(z / 4 * (uint)p->bricks[1] + y / 4) * (uint)p->bricks[0];
}

/* word [rows of all levels] out. */
__kernel MANY void levels_rows(__constant const struct rec_cl_place *place, uint rows,
                               __global const ulong *restrict mask, __global uint *restrict word)
{
    uint i = (uint)get_global_id(0), n = 0, shift;
    if (i >= rows)
        return;
    while (i >= place->row + place->rows)
        place++;
    size_t at = first_brick(place, i - place->row, &shift);
    for (int b = 0; b < place->bricks[0]; b++)
        n += (uint)popcount((uint)(mask[at + (uint)b] >> shift) & 15);
    word[i] = n;
}

/* map, col of a level; at: columns before each of its rows. */
__kernel ROW void levels_fill(__constant const struct rec_cl_place *place, uint l, uint room,
                              __global const ulong *restrict mask, __global const uint *restrict at,
                              __global int *restrict map, __global int *restrict col)
{
    __constant const struct rec_cl_place *p = place + l;
    __local uchar four[GROUP / 4];
    uint r = (uint)get_group_id(0), i = (uint)get_local_id(0), wide = (uint)p->n[0], q = at[p->row + r], shift;
    size_t brick = first_brick(p, r, &shift), v = (size_t)r * wide;
    for (uint x = i; x - i < wide; x += GROUP) {
        uint b = (x - i) / 4 + i;
        if (i < GROUP / 4)
            four[i] = b < (uint)p->bricks[0] ? (uchar)(mask[brick + b] >> shift & 15) : 0;
        barrier(CLK_LOCAL_MEM_FENCE);
        uint own = four[i / 4], here = q + (uint)popcount(own & ((1u << i % 4) - 1));
        for (uint k = 0; k < GROUP / 4; k++) {
            uint n = (uint)popcount((uint)four[k]);
            here += k < i / 4 ? n : 0;
            q += n;
        }
        bool is = (own >> i % 4 & 1) != 0 && here < room;
        if (x < wide)
            map[v + x] = is ? (int)here : -1;
        if (is)
            col[here] = (int)(v + x);
        barrier(CLK_LOCAL_MEM_FENCE);
    }
}

/* near [6][room] of the first *total columns. */
__kernel MANY void levels_near(__constant const struct rec_cl_place *place, uint l, uint room,
                               __global const uint4 *restrict total, __global const int *restrict map,
                               __global const int *restrict col, __global int *restrict near)
{
    const int nx = place[l].n[0], ny = place[l].n[1], nz = place[l].n[2];
    uint q, to;
    piece(min(total[l].x, room), &q, &to);
    for (q += (uint)get_local_id(0); q < to; q += FLAT) {
        int v = col[q], x = v % nx, y = v / nx % ny, z = v / nx / ny;
        near[q] = x > 0 ? map[v - 1] : -1;
        near[(size_t)room + q] = x + 1 < nx ? map[v + 1] : -1;
        near[(size_t)room * 2 + q] = y > 0 ? map[v - nx] : -1;
        near[(size_t)room * 3 + q] = y + 1 < ny ? map[v + nx] : -1;
        near[(size_t)room * 4 + q] = z > 0 ? map[v - nx * ny] : -1;
        near[(size_t)room * 5 + q] = z + 1 < nz ? map[v + nx * ny] : -1;
    }
}

/* ---- rows ----------------------------------------------------------------------------------------*/

/* Words of the n tiles of a level, from `first` on; rows [n]: their rows. */
__kernel MANY void levels_tiles(uint n, __global const uint *restrict rows, __global uint *restrict word, uint first)
{
    uint i = (uint)get_global_id(0);
    if (i < n)
        word[first + i] = rows[i] << 16 | (uint)(rows[i] != 0);
}

/* out[l]: the sums of parts of slots 0, 1 and 2, lane 0.  They are integers.  One group. */
__kernel MANY void levels_entries(uint groups, __global const double4 *restrict parts, __global double4 *restrict out,
                                  int l)
{
    __local double4 tree[FLAT];
    uint i = (uint)get_local_id(0);
    double4 sum = 0;
    for (uint k = i; k < groups; k += FLAT)
        sum += (double4)(parts[k].x, parts[PARTS + k].x, parts[2 * PARTS + k].x, 0);
    tree[i] = sum;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (uint step = FLAT / 2; step > 0; step /= 2) {
        if (i < step)
            tree[i] += tree[i + step];
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    if (i == 0)
        out[l] = tree[0];
}

/* ---- pictures ------------------------------------------------------------------------------------*/

/* The item's bin in the group's tile: its number, -1: beyond the picture, or in a tile without rows.  The bins of the
 * finest level under it: `high` rows of `wide` bins, `pitch` apart. */
struct patch {
    int first, wide, high, pitch;
};
static inline int my_patch(__constant const struct rec_cl_geometry *g, __constant const struct rec_cl_geometry *fine,
                           int shift, __global const uint *rows, struct patch *p)
{
    uint t = (uint)get_group_id(0);
    int i = rows[t] != 0 ? tile_bin(g, t, (uint)get_local_id(0)) : -1;
    if (i < 0)
        return -1;
    int c = tile_camera(g, t), in = i - g->camera[c].row0, bw = g->camera[c].bw, side = 1 << shift;
    int x0 = in % bw << shift, y0 = in / bw << shift, fw = fine->camera[c].bw;
    p->first = fine->camera[c].row0 + y0 * fw + x0;
    p->wide = min(side, fw - x0);
    p->high = min(side, fine->camera[c].bh - y0);
    p->pitch = fw;
    return i;
}

/* In double, because a device may round quotients of floats less well than the host. */
static inline float quotient(float a, float b)
{
    return (float)((double)a / (double)b);
}

/* The mean of a bin's patch without the bins that were not measured; no weight if fewer than half were. */
__kernel ROW void levels_average(__constant const struct rec_cl_geometry *g,
                                 __constant const struct rec_cl_geometry *fine, int shift,
                                 __global const uint *restrict rows, __global const uchar *restrict is_row,
                                 __global const lanes *restrict b, __global const float *restrict w,
                                 __global lanes *restrict to_b, __global float *restrict to_w)
{
    struct patch p;
    int i = my_patch(g, fine, shift, rows, &p);
    if (i < 0)
        return;
    lanes sum = SPLAT(0);
    float weight = 0;
    int measured = 0, bins = p.wide * p.high;
    if (is_row[i])
        for (int y = 0; y < p.high; y++)
            for (int x = 0; x < p.wide; x++) {
                int at = p.first + y * p.pitch + x;
                float of = w[at];
                sum += SPLAT(of) * b[at];
                weight += of;
                measured += of > 0;
            }
    bool use = measured > 0 && 2 * measured >= bins;
    to_w[i] = use ? quotient(weight, (float)bins) : 0;
    to_b[i] = sum * SPLAT(use ? quotient(1, weight) : 0);
}

/* The same per channel: its mean is over the bins that measured it, and its weight their share of all bins. */
__kernel ROW void levels_average4(__constant const struct rec_cl_geometry *g,
                                  __constant const struct rec_cl_geometry *fine, int shift,
                                  __global const uint *restrict rows, __global const uchar *restrict is_row,
                                  __global const float4 *restrict b, __global const float4 *restrict w,
                                  __global float4 *restrict to_b, __global float4 *restrict to_w)
{
    struct patch p;
    int i = my_patch(g, fine, shift, rows, &p);
    if (i < 0)
        return;
    float4 sum = 0, weight = 0;
    int measured = 0, bins = p.wide * p.high;
    if (is_row[i])
        for (int y = 0; y < p.high; y++)
            for (int x = 0; x < p.wide; x++) {
                int at = p.first + y * p.pitch + x;
                float4 of = w[at];
                sum += of * b[at];
                weight += of;
                measured += any(of > 0);
            }
    int4 use = weight > 0;
    if (2 * measured < bins)
        use = 0;
    double4 all = convert_double4(weight);
    to_w[i] = select((float4)0, convert_float4(all / (double)bins), use);
    to_b[i] = select((float4)0, convert_float4(convert_double4(sum) / all), use);
}
