/* pooled.cl - pictures on the vote's coarse bins, as vote/pooled.c has them, to the bit. */
#define MEASURED_SHARE 0.75F /* pooled.c: MEASURED */
#define IS_MEASURED    1     /* vote.h: REC_VOTE_MEASURED */
#define IS_BRIGHT      2
#define IS_LIT         4

/* An item a coarse bin.  w: weights, w4 with `per_channel`. */
__kernel void photo_pool(__global const struct rec_cl_coarse *restrict camera, int cameras, int n,
                         int per_channel, __global const lanes *restrict b,
                         __global const float *restrict w, __global const float4 *restrict w4,
                         __global const uchar *restrict lit,
                         __global struct rec_cl_pooled_bin *restrict out)
{
    const int i = (int)get_global_id(0);
    int c = 0, any_lit = 0;
    if (i >= n)
        return;
    while (c + 1 < cameras && i >= camera[c + 1].first)
        c++;
    __global const struct rec_cl_coarse *at = &camera[c];
    const int side = at->side, x = (i - at->first) % at->wide, y = (i - at->first) / at->wide;
    for (int v = y * side; v < min((y + 1) * side, at->bh); v++)
        for (int u = x * side; u < min((x + 1) * side, at->bw); u++)
            any_lit |= lit[at->row0 + v * at->bw + u];

    /* A bin of a mosaic has one channel: four have all. */
    const int two = per_channel && side == 1;
    const int x0 = two ? x & ~1 : x * side, y0 = two ? y & ~1 : y * side;
    const int x1 = min(x0 + (two ? 2 : side), at->bw), y1 = min(y0 + (two ? 2 : side), at->bh);
    lanes sum = SPLAT(0), weight = SPLAT(0);
    float bright = 0;
    for (int v = y0; v < y1; v++)
        for (int u = x0; u < x1; u++) {
            const int k = at->row0 + v * at->bw + u;
#if CS == 4
            const float4 a = per_channel ? w4[k] : (float4)(w[k]);
            bright += a.x + a.y + a.z == 0 ? b[k].x : 0;
#else
            const float a = w[k];
            bright += a + a + a == 0 ? b[k] : 0;
#endif
            sum += a * b[k];
            weight += a;
        }

    const float bins = (float)((x1 - x0) * (y1 - y0));
    float least = MEASURED_SHARE * bins, value = 0;
    int ok = 1;
#if CS == 4
    if (per_channel) /* a filter passes one channel a bin; red and blue have a quarter of the bins */
        least *= weight.x + weight.y + weight.z <= 1.01F * bins ? 0.2F : 1;
    const float sums[3] = {sum.x, sum.y, sum.z}, weights[3] = {weight.x, weight.y, weight.z};
#else
    const float sums[1] = {sum}, weights[1] = {weight};
#endif
    for (int l = 0; l < min(CS, 3); l++) {
        ok = ok && weights[l] >= least && weights[l] > 0;
        value += (float)((double)sums[l] / (double)weights[l]); /* the nearest float */
    }
    out[i].value = ok ? value : 0;
    out[i].is = (ok ? IS_MEASURED : 0) | (bright > 0 ? IS_BRIGHT : 0) | (any_lit ? IS_LIT : 0);
}
