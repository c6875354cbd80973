/* run.cl - sums. */

/* out[s] = the sum of parts[s][0 .. count of s), in a fixed order.  A group of GROUP items for each sum. */
__kernel GROUP_ITEMS void add_parts(__global const double4 *restrict parts, const uint16 counts,
                                    __global double4 *restrict out)
{
    __local double4 tree[GROUP];
    uint count[16], s = (uint)get_group_id(0), i = (uint)get_local_id(0);
    vstore16(counts, 0, count);
    double4 sum = 0;
    for (uint k = i; k < count[s]; k += GROUP)
        sum += parts[s * PARTS + k];
    tree[i] = sum;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (uint step = GROUP / 2; step > 0; step /= 2) {
        if (i < step)
            tree[i] += tree[i + step];
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    if (i == 0)
        out[s] = tree[0];
}

/* parts of slot: the sum of x[0..n). */
__kernel FLAT_ITEMS void sum_lanes(__global const lanes *restrict x, uint n,
                                   __global double4 *restrict parts, uint slot)
{
    __local double4 tree[FLAT];
    uint from, to;
    dlanes sum = 0;
    piece(n, &from, &to);
    for (uint i = from + (uint)get_local_id(0); i < to; i += FLAT)
        sum += AS_DOUBLE(x[i]);
    put_sum(of_lanes(sum), tree, parts, slot);
}
