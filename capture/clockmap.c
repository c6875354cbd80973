#include "capture/clockmap.h"

#include <math.h>
#include <string.h>

#include "base/clock.h"

#define BUCKET_NS PVX_NS_PER_S
#define JUMP_NS   (PVX_NS_PER_S / 2)
#define MAX_DRIFT 500e-6
#define MIN_FIT   3 /* full buckets before a slope is believed */

void cap_clockmap_init(struct cap_clockmap *m, bool shared)
{
    memset(m, 0, sizeof *m);
    m->shared = shared;
}

/* Differences are kept relative to host0 - dev0, where double has ns to spare. */
static double predict(const struct cap_clockmap *m, int64_t device_ns)
{
    return m->offset_ns + m->drift * (double)(device_ns - m->dev0);
}

static void restart(struct cap_clockmap *m, int64_t device_ns, int64_t arrival_ns)
{
    m->valid = true;
    m->dev0 = device_ns;
    m->host0 = arrival_ns;
    m->drift = 0;
    m->offset_ns = 0;
    m->n = m->head = 0;
    m->bucket_end = device_ns + BUCKET_NS;
    m->current = (struct cap_clock_bucket){device_ns, 0};
}

/* Least squares of diff over device time about their means. */
static void fit(struct cap_clockmap *m)
{
    double mx = 0, my = 0, sxx = 0, sxy = 0;
    for (int i = 0; i < m->n; i++) {
        mx += (double)(m->bucket[i].dev - m->dev0);
        my += m->bucket[i].diff_ns;
    }
    mx /= m->n;
    my /= m->n;
    for (int i = 0; i < m->n; i++) {
        double x = (double)(m->bucket[i].dev - m->dev0) - mx;
        sxx += x * x;
        sxy += x * (m->bucket[i].diff_ns - my);
    }
    m->drift = sxx > 0 ? fmin(fmax(sxy / sxx, -MAX_DRIFT), MAX_DRIFT) : 0;
    m->offset_ns = my - m->drift * mx;
}

static void bucket_full(struct cap_clockmap *m, int64_t device_ns, double diff)
{
    m->bucket[m->head] = m->current;
    m->head = (m->head + 1) % CAP_CLOCK_BUCKETS;
    if (m->n < CAP_CLOCK_BUCKETS)
        m->n++;
    m->bucket_end = device_ns + BUCKET_NS;
    m->current = (struct cap_clock_bucket){device_ns, diff};
    if (m->n >= MIN_FIT)
        fit(m);
}

int64_t cap_clockmap_add(struct cap_clockmap *m, int64_t device_ns, int64_t arrival_ns)
{
    if (device_ns == 0)
        return arrival_ns;
    bool backwards = m->last_dev != 0 && device_ns < m->last_dev;
    m->last_dev = device_ns;
    if (m->shared) {
        m->valid = true;
        m->jumps += backwards;
        return device_ns;
    }
    if (!m->valid)
        restart(m, device_ns, arrival_ns);
    double diff = (double)((arrival_ns - m->host0) - (device_ns - m->dev0));
    if (backwards || fabs(diff - predict(m, device_ns)) > JUMP_NS) {
        m->jumps++;
        restart(m, device_ns, arrival_ns);
        diff = 0;
    }
    if (device_ns >= m->bucket_end)
        bucket_full(m, device_ns, diff);
    else if (diff < m->current.diff_ns)
        m->current = (struct cap_clock_bucket){device_ns, diff};
    if (m->n < MIN_FIT && diff < m->offset_ns)
        m->offset_ns = diff;
    return device_ns + (m->host0 - m->dev0) + llrint(predict(m, device_ns));
}
