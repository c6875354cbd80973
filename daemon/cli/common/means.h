/* means.h - sets of a recording averaged before they are solved: all of them, or those of one phase of a cycle.
 *
 * With b = S x of each set, mean(b) = S mean(x): the mean of the pictures is the same linear problem, so its volume is
 * the mean of the volumes, at the cost of one solve and with 1/sqrt(N) of the noise.  What is not linear does not pass:
 * a sample that is saturated in one of the sets is saturated in the mean, and the hull is that of the mean.
 * Bins are summed in double, set by set in ascending order.  Threads: one. */
#ifndef CLI_MEANS_H
#define CLI_MEANS_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"

/* What is averaged.  All 0: nothing. */
struct means_how {
    const char *average; /* "all", or a period: "20" sets, "12.5ms", "80Hz"; or NULL */
    const char
        *phases; /* a CSV file with the columns frame and phase (0 to 1) or degrees; or NULL */
    uint32_t n;  /* means in a cycle; 0: as many as sets in a period, 16 of a file */
};

struct means {
    size_t n;        /* means; 0: nothing is averaged */
    size_t *begin;   /* [n + 1] members of mean i are begin[i] <= k < begin[i + 1] */
    size_t *member;  /* sets, ascending in each mean */
    int64_t *number; /* [n] of each mean: its place in the cycle, from 0 */
};

/* Find the members of each mean.  number, t_ns: of the recording's sets, ascending; t_ns NULL: not known.
 * Errors: PVX_EINVAL (a wrong period; times that are not known; a file that is not understood, with its line),
 * PVX_ENOENT, PVX_ENOMEM.  Says on stderr what was averaged.  Owner: caller, means_free, after an error too. */
PVX_MUST_CHECK pvx_err means_find(const struct means_how *how, const int64_t *number,
                                  const int64_t *t_ns, size_t sets, struct means *out,
                                  struct pvx_diag *d);
void means_free(struct means *m);

/* Sums over one camera's pictures. */
struct means_sum {
    double *sum, *square; /* [values] */
    uint8_t *full;        /* [values] 1: saturated in one of the pictures */
    size_t values;
    uint32_t n; /* pictures */
};
/* full: the value of saturated bins, or INFINITY. */
void means_add(struct means_sum *s, const float *bins, float full);
void means_take(const struct means_sum *s, float *bins, float full);
/* Standard deviation of one picture in the dark, [channels]: of what changes between the pictures, over the darker half
 * of the bins without those that flicker.  A pattern that all pictures have is not in it.  About 4096 bins are looked
 * at.  0: fewer than 16 pictures.  cs: values of a bin.  Errors: PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err means_noise(const struct means_sum *s, size_t cs, size_t channels,
                                   float *out);

#endif
