/* hist.h - fixed-size latency histogram: p50, p99, max without keeping the samples.
 *
 * Buckets are logarithmic, 16 per octave, so a quantile is right to 4.5 % (the max is exact).
 * Range 1 us .. 1000 s; smaller and larger values fall into the end buckets.
 * Threads: one writer; readers may see a sample late, never a torn value. */
#ifndef PVX_HIST_H
#define PVX_HIST_H
#include <stdint.h>

#define PVX_HIST_BUCKETS 480
struct pvx_hist {
    uint64_t bucket[PVX_HIST_BUCKETS];
    uint64_t count;
    int64_t max_ns;
    int64_t sum_ns;
};

void pvx_hist_add(struct pvx_hist *h, int64_t ns);
/* Value below which a share `q` (0..1) of the samples lies, ns (bucket centre); 0 when empty. */
int64_t pvx_hist_quantile(const struct pvx_hist *h, double q);

#endif
