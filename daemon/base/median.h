/* median.h - ascending order for qsort, and the median.
 * Threads: pure. */
#ifndef PVX_MEDIAN_H
#define PVX_MEDIAN_H
#include <stddef.h>
#include <stdlib.h>

/* Order of doubles, ascending. */
static inline int pvx_ascending(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* The middle of n values, or the mean of the middle two; 0 for none.  Sorts v.  Cost: O(n log n). */
static inline double pvx_median(double *v, size_t n)
{
    if (n == 0)
        return 0;
    qsort(v, n, sizeof *v, pvx_ascending);
    return 0.5 * (v[(n - 1) / 2] + v[n / 2]);
}
#endif
