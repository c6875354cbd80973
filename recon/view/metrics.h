/* metrics.h - how far a volume is from the truth.  Double sums, a pure function. */
#ifndef REC_METRICS_H
#define REC_METRICS_H
#include <stddef.h>

/* ||a - b|| / ||b|| over n floats; 0 when both are zero, +inf never (b = 0, a != 0 gives 1e9). */
double rec_rel_l2(const float *a, const float *b, size_t n);

#endif
