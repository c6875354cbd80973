#include "base/hist.h"

#include <math.h>

#define PER_OCTAVE 16
#define LOWEST_NS  1000.0

void pvx_hist_add(struct pvx_hist *h, int64_t ns)
{
    if (ns < 0)
        ns = 0;
    int b = ns <= (int64_t)LOWEST_NS ? 0 : (int)(log2((double)ns / LOWEST_NS) * PER_OCTAVE);
    if (b >= PVX_HIST_BUCKETS)
        b = PVX_HIST_BUCKETS - 1;
    __atomic_store_n(&h->bucket[b], h->bucket[b] + 1, __ATOMIC_RELAXED);
    __atomic_store_n(&h->count, h->count + 1, __ATOMIC_RELAXED);
    __atomic_store_n(&h->sum_ns, h->sum_ns + ns, __ATOMIC_RELAXED);
    if (ns > h->max_ns)
        __atomic_store_n(&h->max_ns, ns, __ATOMIC_RELAXED);
}

int64_t pvx_hist_quantile(const struct pvx_hist *h, double q)
{
    uint64_t total = 0;
    for (int i = 0; i < PVX_HIST_BUCKETS; i++)
        total += __atomic_load_n(&h->bucket[i], __ATOMIC_RELAXED);
    if (total == 0)
        return 0;
    double want = q * (double)total, seen = 0;
    int64_t max = __atomic_load_n(&h->max_ns, __ATOMIC_RELAXED);
    for (int i = 0; i < PVX_HIST_BUCKETS; i++) {
        seen += (double)__atomic_load_n(&h->bucket[i], __ATOMIC_RELAXED);
        if (seen >= want && seen > 0) {
            int64_t v = (int64_t)(LOWEST_NS * exp2((i + 0.5) / PER_OCTAVE));
            return v < max ? v : max;
        }
    }
    return max;
}
