/* hull.cl - the visual hull: rule (1) of carve/hull.h, and its method.
 *
 *   table_*      the summed-area table of each silhouette: along rows, then down bands of BAND rows
 *   hull_bricks  an item a brick: drops it, or lists it with the cameras that have to test its voxels
 *   hull_voxels  a group a listed brick, an item a voxel
 * The table of camera c has (bh+1) x (bw+1) entries from row0 + c * pad on; its first row and column are 0.
 * present: bit c: camera c carves and counts. */

#define BRICK __attribute__((reqd_work_group_size(GROUP, 1, 1)))
#define BAND  16

/* Bit i: `yes` of item i.  All GROUP items of the group call it. */
static inline ulong votes(bool yes, __local uchar *vote, __local uchar *eight)
{
    uint i = (uint)get_local_id(0);
    vote[i] = yes;
    barrier(CLK_LOCAL_MEM_FENCE);
    if (i < GROUP / 8) {
        uint bits = 0;
        for (uint k = 0; k < 8; k++)
            bits |= (uint)vote[i * 8 + k] << k;
        eight[i] = (uchar)bits;
    }
    barrier(CLK_LOCAL_MEM_FENCE);
    ulong all = 0;
    for (uint k = 0; k < GROUP / 8; k++)
        all |= (ulong)eight[k] << k * 8;
    return all;
}
static inline uint count_bits(ulong bits)
{
    return (uint)popcount(bits);
}

/* ---- tables --------------------------------------------------------------------------------------*/

static inline __global uint *table_row(__constant const struct rec_cl_geometry *g, uint pad, __global uint *sat, uint c,
                                       uint y)
{
    return sat + ((size_t)g->camera[c].row0 + (size_t)c * pad + (size_t)(y + 1) * (uint)(g->camera[c].bw + 1) + 1);
}

/* Sums along rows.  A group a row; high: of the highest picture. */
__kernel BRICK void table_rows(__constant const struct rec_cl_geometry *g, ulong present, uint pad, uint high,
                               __global const uchar *restrict lit, __global uint *restrict sat)
{
    __local uchar vote[GROUP], eight[GROUP / 8];
    uint c = (uint)get_group_id(0) / high, y = (uint)get_group_id(0) % high, i = (uint)get_local_id(0), sum = 0;
    uint wide = (uint)g->camera[c].bw;
    if ((present >> c & 1) == 0 || y >= (uint)g->camera[c].bh)
        return;
    lit += (size_t)g->camera[c].row0 + (size_t)y * wide;
    sat = table_row(g, pad, sat, c, y);
    for (uint x = i; x - i < wide; x += GROUP) {
        ulong all = votes(x < wide && lit[x] != 0, vote, eight);
        if (x < wide)
            sat[x] = sum + count_bits(all & ~0UL >> (GROUP - 1 - i));
        sum += count_bits(all);
    }
}

/* A group's part of a band: its first row and its column of table and bands. */
struct band {
    uint c, b, x, y0, y1;
    bool is;
};
static inline struct band band_of(__constant const struct rec_cl_geometry *g, ulong present, uint bands, uint across)
{
    uint group = (uint)get_group_id(0);
    struct band t = {.c = group / across / bands, .b = group / across % bands};
    t.x = group % across * GROUP + (uint)get_local_id(0);
    t.y0 = t.b * BAND;
    t.y1 = min(t.y0 + BAND, (uint)g->camera[t.c].bh);
    t.is = (present >> t.c & 1) != 0 && t.x < (uint)g->camera[t.c].bw && t.y0 < t.y1;
    return t;
}

/* band [cameras][bands][across * GROUP] out: the sums down each band. */
__kernel BRICK void table_bands(__constant const struct rec_cl_geometry *g, ulong present, uint pad, uint bands,
                                uint across, __global uint *restrict sat, __global uint *restrict band)
{
    struct band t = band_of(g, present, bands, across);
    uint sum = 0;
    if (!t.is)
        return;
    for (uint y = t.y0; y < t.y1; y++)
        sum += table_row(g, pad, sat, t.c, y)[t.x];
    band[(t.c * bands + t.b) * across * GROUP + t.x] = sum;
}

/* Sums down columns, a band each. */
__kernel BRICK void table_columns(__constant const struct rec_cl_geometry *g, ulong present, uint pad, uint bands,
                                  uint across, __global uint *restrict sat, __global const uint *restrict band)
{
    struct band t = band_of(g, present, bands, across);
    uint sum = 0;
    if (!t.is)
        return;
    for (uint b = 0; b < t.b; b++)
        sum += band[(t.c * bands + b) * across * GROUP + t.x];
    for (uint y = t.y0; y < t.y1; y++) {
        __global uint *here = table_row(g, pad, sat, t.c, y) + t.x;
        *here = sum += *here;
    }
}

/* ---- footprints ----------------------------------------------------------------------------------*/

/* A footprint is (x0, y0, x1, y1), inclusive; x0 > x1: not seen. */
static inline bool is_seen(ushort4 r)
{
    return r.s0 <= r.s2;
}
/* Not seen as a whole, but maybe in part: REC_RECT_UNKNOWN. */
static inline bool is_unknown(ushort4 r)
{
    return r.s0 == 2 && r.s2 == 0;
}
/* Lit and dark bins. */
static inline uint2 hull_look(__global const uint *sat, int bw, ushort4 r)
{
    size_t w = (size_t)bw + 1, top = (size_t)r.s1 * w, bottom = ((size_t)r.s3 + 1) * w;
    size_t left = r.s0, right = (size_t)r.s2 + 1;
    uint lit = sat[bottom + right] - sat[bottom + left] - sat[top + right] + sat[top + left];
    uint area = (uint)(r.s2 - r.s0 + 1) * (uint)(r.s3 - r.s1 + 1);
    return (uint2)(lit, area - lit);
}
/* Whether the picture's edge may cut the footprint short. */
static inline bool is_cut_off(int bw, int bh, ushort4 r)
{
    return r.s0 == 0 || r.s1 == 0 || r.s2 + 1 == bw || r.s3 + 1 == bh;
}

/* listed [groups], list [groups][GROUP] out: the bricks of a group whose voxels are to be tested.  open, views [bricks]
 * out: the cameras that test them; how many others see all of the brick, all lit.  mask, word of the other bricks out:
 * no voxel; whether S lacks it.  word: from `first` on. */
__kernel BRICK void hull_bricks(__constant const struct rec_cl_geometry *g, ulong present, uint pad, uint min_views,
                                __global const ushort4 *restrict rect, __global const int *restrict store,
                                __global const uint *restrict sat, __global ulong *restrict open,
                                __global uchar *restrict views, __global uint *restrict list,
                                __global uint *restrict listed, __global ulong *restrict mask,
                                __global uint *restrict word, uint first)
{
    __local uchar vote[GROUP], eight[GROUP / 8];
    uint b = (uint)get_global_id(0), bricks = (uint)g->all_bricks, may = 0, all = 0;
    ulong dark = 0;
    bool keep = b < bricks;
    for (uint c = 0; keep && c < (uint)g->cameras; c++) {
        if ((present >> c & 1) == 0)
            continue;
        ushort4 r = rect[(size_t)c * bricks + b];
        int bw = g->camera[c].bw, bh = g->camera[c].bh;
        uint2 s = (uint2)(1, 1);
        if (is_seen(r))
            s = hull_look(sat + ((size_t)g->camera[c].row0 + (size_t)c * pad), bw, r);
        keep = s.x != 0 || is_cut_off(bw, bh, r);
        may += is_unknown(r) || (is_seen(r) && s.x != 0);
        dark |= (ulong)(s.y != 0) << c;
        all += s.y == 0;
    }
    keep = keep && may >= min_views;
    bool cut = keep && store[b] < 0;
    keep = keep && !cut;
    ulong kept = votes(keep, vote, eight);
    uint i = (uint)get_local_id(0);
    if (keep) {
        open[b] = dark;
        views[b] = (uchar)all;
        list[(b - i) + count_bits(kept & (((ulong)1 << i) - 1))] = b;
    } else if (b < bricks) {
        mask[b] = 0;
        word[first + b] = (uint)cut << 31;
    }
    if (i == 0)
        listed[get_group_id(0)] = count_bits(kept);
}

/* Whether the item's place in brick b is a voxel. */
static inline bool is_voxel(__constant const struct rec_cl_geometry *g, int b)
{
    int o = (int)get_local_id(0), row = b / g->bricks[0];
    return b % g->bricks[0] * 4 + o % 4 < g->n[0] && row % g->bricks[1] * 4 + o / 4 % 4 < g->n[1] &&
           row / g->bricks[1] * 4 + o / 16 < g->n[2];
}

/* mask, word of the listed bricks out: bit o: voxel o is kept; counts of inside and partial.  `share` groups share the
 * bricks of a list.  need: views that a kept voxel has, >= 1. */
__kernel BRICK void hull_voxels(__constant const struct rec_cl_geometry *g, uint pad, uint need, uint keep_partial,
                                uint share, uint stored, __global const ushort4 *restrict fp,
                                __global const int *restrict store, __global const uint *restrict sat,
                                __global const ulong *restrict open, __global const uchar *restrict views,
                                __global const uint *restrict list, __global const uint *restrict listed,
                                __global ulong *restrict mask, __global uint *restrict word, uint first)
{
    __local uchar vote[GROUP], eight[GROUP / 8];
    uint from = (uint)get_group_id(0) / share, n = listed[from], o = (uint)get_local_id(0);
    for (uint k = (uint)get_group_id(0) % share; k < n; k += share) {
        uint b = list[from * GROUP + k], seen = views[b];
        size_t at = (size_t)(uint)store[b] * GROUP + o;
        bool gone = !is_voxel(g, (int)b), part = false;
        for (ulong left = open[b]; left != 0; left &= left - 1) {
            uint c = 63 - (uint)clz(left & (~left + 1));
            int bw = g->camera[c].bw, bh = g->camera[c].bh;
            ushort4 r = fp[(size_t)c * stored * GROUP + at];
            if (!is_seen(r))
                continue;
            uint2 s = hull_look(sat + ((size_t)g->camera[c].row0 + (size_t)c * pad), bw, r);
            gone |= s.x == 0 && !is_cut_off(bw, bh, r);
            part |= s.y != 0;
            seen += s.x != 0;
        }
        bool any = !gone && seen >= need;
        ulong inside = votes(any && !part, vote, eight), partial = votes(any && part, vote, eight);
        if (o == 0) {
            ulong kept = keep_partial != 0 ? inside | partial : inside;
            mask[b] = kept;
            word[first + b] = (uint)(kept != 0) | count_bits(inside) << 16 | count_bits(partial) << 24;
        }
    }
}
