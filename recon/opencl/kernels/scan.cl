/* scan.cl - prefix sums of counts, of several ranges of words at once.
 *
 * A word has a count in bits 0..15, which is summed up, and three more in bits 16..22, 24..30 and 31, of which only the
 * totals are wanted.  Integers make the sums exact.
 *   scan_sum    each group adds up its piece of a range
 *   scan_total  a group of each range: what is before each piece, and the totals
 *   scan_place  what is before each word
 *   scan_list   the words whose count is not 0, for counts of 0 and 1 */

#define SCAN __attribute__((reqd_work_group_size(FLAT, 1, 1)))

static inline uint4 word_counts(uint word)
{
    return (uint4)(word & 0xFFFF, word >> 16 & 0x7F, word >> 24 & 0x7F, word >> 31);
}

/* The words [from, to) of a group's piece. */
static inline uint2 scan_piece(__constant const struct rec_cl_range *range, uint group)
{
    while (group >= range->group + range->groups)
        range++;
    uint size = (range->n + range->groups - 1) / range->groups;
    uint from = min(range->n, (group - range->group) * size);
    return range->at + (uint2)(from, min(range->n, from + size));
}

/* The sum of v over the items of the group up to this one.  row [FLAT] is the same for all of them afterwards, and
 * its last entry is the sum over all. */
static inline uint4 scan_group(uint4 v, __local uint4 *row)
{
    uint i = (uint)get_local_id(0);
    row[i] = v;
    barrier(CLK_LOCAL_MEM_FENCE);
    for (uint step = 1; step < FLAT; step *= 2) {
        v = i >= step ? v + row[i - step] : v;
        barrier(CLK_LOCAL_MEM_FENCE);
        row[i] = v;
        barrier(CLK_LOCAL_MEM_FENCE);
    }
    return v;
}

/* sums [groups] out.  Group `group` is the first one. */
__kernel SCAN void scan_sum(__constant const struct rec_cl_range *range, uint group,
                            __global const uint *restrict word, __global uint4 *restrict sums)
{
    __local uint4 row[FLAT];
    group += (uint)get_group_id(0);
    uint2 piece = scan_piece(range, group);
    uint4 sum = 0;
    for (uint i = piece.x + (uint)get_local_id(0); i < piece.y; i += FLAT)
        sum += word_counts(word[i]);
    sum = scan_group(sum, row);
    if (get_local_id(0) == FLAT - 1)
        sums[group] = sum;
}

/* sums: what is before each piece.  total [ranges] out.  Range `first` is that of the first group. */
__kernel SCAN void scan_total(__constant const struct rec_cl_range *range, uint first,
                              __global uint4 *restrict sums, __global uint4 *restrict total)
{
    __local uint4 row[FLAT];
    uint r = first + (uint)get_group_id(0), i = (uint)get_local_id(0);
    bool is = i < range[r].groups;
    uint4 own = is ? sums[range[r].group + i] : (uint4)0;
    uint4 sum = scan_group(own, row);
    if (is)
        sums[range[r].group + i] = sum - own;
    if (i == FLAT - 1)
        total[r] = sum;
}

/* at: the sum of the counts before each word, in its range. */
__kernel SCAN void scan_place(__constant const struct rec_cl_range *range, uint group,
                              __global const uint *restrict word, __global const uint4 *restrict sums,
                              __global uint *restrict at)
{
    __local uint4 row[FLAT];
    group += (uint)get_group_id(0);
    uint2 piece = scan_piece(range, group);
    uint before = sums[group].x;
    for (uint i0 = piece.x; i0 < piece.y; i0 += FLAT) {
        uint i = i0 + (uint)get_local_id(0);
        uint own = i < piece.y ? word[i] & 0xFFFF : 0;
        uint sum = scan_group((uint4)(own, 0, 0, 0), row).x;
        if (i < piece.y)
            at[i] = before + sum - own;
        before += row[FLAT - 1].x;
        barrier(CLK_LOCAL_MEM_FENCE);
    }
}

/* list [total] out: numbers of the words [first, first + n), from 0 on. */
__kernel SCAN void scan_list(uint first, uint n, __global const uint *restrict word,
                             __global const uint *restrict at, __global uint *restrict list)
{
    uint i = (uint)get_global_id(0);
    if (i < n && (word[first + i] & 0xFFFF) != 0)
        list[at[first + i]] = i;
}
