/* selfcal.cl - the loops of solve/selfcal.c; the equations are those of solve/selfcal.h. */

#define SIDE  16 /* REC_SELFCAL_SIDE */
#define SUMS  11 /* REC_SELFCAL_SUMS */
#define BLOCK 8  /* sysmat.h: REC_ROW_BLOCK */

/* Whether bin i is a row that was measured. */
static inline bool usable(__global const uchar *is_row, __global const float *w, int i)
{
    return is_row[i] && w[i] > 0;
}

/* Adds bin i at (x, y) to the sums of a block: few enough for floats. */
static inline void add_bin(__constant const struct rec_cl_camera *k, int i, int x, int y, __global const uchar *is_row,
                           __global const float *given, __global const float *w, __global const lanes *b,
                           __global const lanes *r, lanes sum[SUMS])
{
    int x0 = x > 0 && usable(is_row, given, i - 1) ? i - 1 : i;
    int x1 = x + 1 < k->bw && usable(is_row, given, i + 1) ? i + 1 : i;
    int y0 = y > 0 && usable(is_row, given, i - k->bw) ? i - k->bw : i;
    int y1 = y + 1 < k->bh && usable(is_row, given, i + k->bw) ? i + k->bw : i;
    lanes wb = w[i] * b[i], wr = w[i] * r[i];
    lanes u = 0.5f * (b[x1] - b[x0]) + 0.25f * (r[x1] - r[x0]);
    lanes v = 0.5f * (b[y1] - b[y0]) + 0.25f * (r[y1] - r[y0]);
    lanes wu = w[i] * u, wv = w[i] * v;
    sum[0] += wb;
    sum[1] += wr;
    sum[2] += wu;
    sum[3] += wv;
    sum[4] += wb * u;
    sum[5] += wb * v;
    sum[6] += wu * u;
    sum[7] += wu * v;
    sum[8] += wv * v;
    sum[9] += wr * u;
    sum[10] += wr * v;
}

static inline double of_block(lanes v)
{
#if CS == 4
    return ((double)v.x + (double)v.y) + ((double)v.z + (double)v.w);
#else
    return (double)v;
#endif
}

/* out [cameras][SIDE * SIDE][SUMS].  A group takes a tile; the bins of a block of BLOCK count for the tile of its
 * first.  given: weights of the pictures; w, b, r: of the problem. */
__kernel GROUP_ITEMS void selfcal_tiles(__constant const struct rec_cl_geometry *g,
                                        __global const uchar *restrict is_row, __global const float *restrict given,
                                        __global const float *restrict w, __global const lanes *restrict b,
                                        __global const lanes *restrict r, __global double *restrict out)
{
    __local double4 tree[GROUP];
    int c = (int)get_group_id(0) / (SIDE * SIDE), t = (int)get_group_id(0) % (SIDE * SIDE);
    __constant const struct rec_cl_camera *k = &g->camera[c];
    int side = max(max(k->bw, k->bh) / SIDE + 1, 4); /* rec_selfcal_tile */
    int from = k->row0, last = from + k->bw * k->bh;
    int left = t % SIDE * side, right = min(left + side, k->bw), top = t / SIDE * side;
    int blocks = side / BLOCK + 2; /* of a row of the tile, at most */
    double all[SUMS + 1];
    for (int n = 0; n <= SUMS; n++)
        all[n] = 0;
    for (int m = (int)get_local_id(0); m < blocks * side; m += GROUP) {
        int y = top + m / blocks, row = from + y * k->bw;
        if (y >= k->bh || left >= right)
            continue;
        int first = y == 0 && left == 0 ? row / BLOCK : (row + left + BLOCK - 1) / BLOCK;
        int i = max(from, (first + m % blocks) * BLOCK), end = min(last, (first + m % blocks + 1) * BLOCK);
        if (i >= row + right)
            continue;
        lanes sum[SUMS];
        for (int n = 0; n < SUMS; n++)
            sum[n] = SPLAT(0);
        for (; i < end; i++)
            if (usable(is_row, given, i))
                add_bin(k, i, (i - from) % k->bw, (i - from) / k->bw, is_row, given, w, b, r, sum);
        for (int n = 0; n < SUMS; n++)
            all[n] += of_block(sum[n]);
    }
    for (int n = 0; n < SUMS; n += 4) {
        double4 s = group_sum((double4)(all[n], all[n + 1], all[n + 2], all[n + 3]), tree);
        if (get_local_id(0) == 0) {
            __global double *to = out + (size_t)get_group_id(0) * SUMS + n;
            to[0] = s.x;
            to[1] = s.y;
            to[2] = s.z;
            if (n + 3 < SUMS)
                to[3] = s.w;
        }
    }
}

/* Bin i of the picture at the shifted place; a sample that was not measured counts as the bin's own. */
static inline lanes shifted(__constant const struct rec_cl_camera *k, __constant const struct rec_cl_shot *s, int i,
                            __global const uchar *is_row, __global const float *w, __global const lanes *b)
{
    int x = (i - k->row0) % k->bw + s->dx - 1, y = (i - k->row0) / k->bw + s->dy - 1;
    lanes sum = SPLAT(0);
    for (int n = 0; n < 4; n++)
        for (int m = 0; m < 4; m++) {
            int at = i;
            if (x + m >= 0 && y + n >= 0 && x + m < k->bw && y + n < k->bh)
                at = k->row0 + (y + n) * k->bw + x + m;
            at = usable(is_row, w, at) ? at : i;
            sum += s->w[n * 4 + m] * b[at];
        }
    return sum;
}

/* b by (1) from the pictures `in` and their weights w. */
__kernel FLAT_ITEMS void selfcal_correct(uint bins, __constant const struct rec_cl_geometry *g,
                                         __global const uint *restrict tile, __global const uchar *restrict is_row,
                                         __constant const struct rec_cl_shot *shot, __global const lanes *restrict in,
                                         __global const float *restrict w, __global lanes *restrict b)
{
    FOR_MINE (e, bins) {
        int i = bin_of(g, tile, e);
        if (i < 0 || !is_row[i])
            continue;
        int c = row_camera(g, i);
        __constant const struct rec_cl_shot *s = &shot[c];
        lanes v = s->moved && usable(is_row, w, i) ? shifted(&g->camera[c], s, i, is_row, w, in) : in[i];
        b[i] = v * s->gain;
    }
}
