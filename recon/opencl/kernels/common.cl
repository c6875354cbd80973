/* common.cl - what all kernels share.  It stands before each of them in the program.
 *
 * CS: lanes of a vector's entry, 1 for one channel and 4 for three.  Each kernel is compiled for both.
 * Floats are stored, sums are double.  No product is contracted to a fused one, as on the host. */
#pragma OPENCL EXTENSION cl_khr_fp64 : enable
#pragma OPENCL FP_CONTRACT OFF

#define GROUP 64  /* run.h: REC_CL_GROUP, */
#define FLAT  256 /* REC_CL_FLAT, */
#define PARTS 512 /* REC_CL_PARTS */

#if CS == 4
typedef float4 lanes;
typedef double4 dlanes;
typedef int4 ilanes;
#define AS_DOUBLE(v) convert_double4(v)
#define SPLAT(v)     ((float4)(v))
#else
typedef float lanes;
typedef double dlanes;
typedef int ilanes;
#define AS_DOUBLE(v) ((double)(v))
#define SPLAT(v)     ((float)(v))
#endif

/* The piece [from, to) of n items that belongs to this group; its items go through it in steps of the group's size. */
static inline void piece(uint n, uint *from, uint *to)
{
    uint groups = (uint)get_num_groups(0), size = (n + groups - 1) / groups;
    *from = min(n, (uint)get_group_id(0) * size);
    *to = min(n, *from + size);
}

/* Adds v of all items of the group and writes it to parts[slot][group].  tree: local, one double4 an item.  All items
 * of the group call it. */
static inline void put_sum(double4 v, __local double4 *tree, __global double4 *parts, uint slot)
{
    uint i = (uint)get_local_id(0);
    tree[i] = v;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (uint step = (uint)get_local_size(0) / 2; step > 0; step /= 2) {
        if (i < step)
            tree[i] += tree[i + step];
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    if (i == 0)
        parts[slot * PARTS + get_group_id(0)] = tree[0];
    barrier(CLK_LOCAL_MEM_FENCE);
}
static inline double4 of_lanes(dlanes v)
{
#if CS == 4
    return v;
#else
    return (double4)(v, 0, 0, 0);
#endif
}
