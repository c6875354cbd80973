#include "capture/sync/clockmap.h"

#include <math.h>
#include <string.h>

#include "base/clock.h"

#define MOVED_NS     (5.0 * (double)PVX_NS_PER_MS)   /* this far below the line: a new envelope */
#define JUMP_NS      (100.0 * (double)PVX_NS_PER_MS) /* this far off: the camera's clock jumped */
#define EARLY_NS     (2.0 * (double)PVX_NS_PER_S)    /* the same before there is a line */
#define MAX_BOUND_NS (10 * PVX_NS_PER_MS)

void cap_clockmap_init(struct cap_clockmap *m, bool shared)
{
    memset(m, 0, sizeof *m);
    m->shared = shared;
}

/* Start the map again.  The crystal is the same after a jump, so the drift stays. */
static void restart(struct cap_clockmap *m, int64_t device_ns, int64_t arrival_ns, double diff)
{
    m->valid = true;
    m->dev0 = device_ns;
    m->host0 = arrival_ns;
    m->delay_ns = 0;
    cap_envelope_begin(&m->envelope, 0, diff);
    cap_clockfit_forget(&m->read);
}

/* delay = weighted mean of (envelope - reading).  A delay cannot be negative. */
static void settle_delay(struct cap_clockmap *m)
{
    double sum = 0, weight = 0;
    for (int i = 0; i < m->read.n; i++) {
        const struct cap_clockfit_reading *r = &m->read.reading[i];
        double w = 1 / (r->bound_ns * r->bound_ns);
        sum += w * (cap_envelope_at(&m->envelope, r->x) - r->y);
        weight += w;
    }
    m->delay_ns = weight > 0 ? fmax(sum / weight, 0) : 0;
}

/* Differences are relative to host0 - dev0; so they are small, and a double resolves them better than 1 ns. */
static double clockmap_difference(const struct cap_clockmap *m, int64_t device_ns, int64_t host_ns)
{
    return (double)((host_ns - m->host0) - (device_ns - m->dev0));
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
        restart(m, device_ns, arrival_ns, 0);
    bool line = m->envelope.n >= CAP_ENVELOPE_LINE;
    double diff = clockmap_difference(m, device_ns, arrival_ns), above;
    double off = diff - cap_envelope_at(&m->envelope, device_ns - m->dev0);
    /* before there is a line, all frames so far may have been slow */
    if (backwards || off < (line ? -JUMP_NS : -EARLY_NS)) {
        m->jumps++;
        restart(m, device_ns, arrival_ns, 0);
        diff = 0;
    } else if (line && off < -MOVED_NS) { /* the network's delay has changed, the clock has not */
        cap_envelope_begin(&m->envelope, device_ns - m->dev0, diff);
    }
    int64_t x = device_ns - m->dev0;
    bool moved = cap_envelope_add(&m->envelope, x, diff, &above);
    if (above >= JUMP_NS) {
        m->jumps++;
        cap_clockfit_forget(&m->read);
    }
    if (moved)
        settle_delay(m);
    double least = cap_envelope_at(&m->envelope, x) - m->delay_ns;
    if (cap_clockfit_holds(&m->read, x)) /* a frame cannot arrive before its exposure */
        least = fmin(cap_clockfit_at(&m->read, x), diff);
    return device_ns + (m->host0 - m->dev0) + llrint(least);
}

double cap_clockmap_drift(const struct cap_clockmap *m)
{
    return cap_clockfit_holds(&m->read, m->last_dev - m->dev0) ? m->read.drift : m->envelope.drift;
}

double cap_clockmap_doubt(const struct cap_clockmap *m)
{
    if (m->shared || !m->valid)
        return 0;
    if (cap_clockfit_holds(&m->read, m->last_dev - m->dev0))
        return 6 * m->read.bound_ns;
    return m->envelope.n < CAP_ENVELOPE_KNOWN ? INFINITY : 6 * m->envelope.excess_ns;
}

void cap_clockmap_measure(struct cap_clockmap *m, int64_t device_ns, int64_t host_ns,
                          int64_t bound_ns)
{
    if (m->shared || device_ns <= 0 || device_ns > INT64_MAX / 2 || bound_ns < 0 ||
        bound_ns > MAX_BOUND_NS)
        return;
    if (!m->valid)
        restart(m, device_ns, host_ns, INFINITY);
    int64_t x = device_ns - m->dev0;
    double diff = clockmap_difference(m, device_ns, host_ns);
    double off = cap_envelope_at(&m->envelope, x) - diff; /* the delay according to this reading */
    if (fabs(off) > EARLY_NS)
        return; /* the clock jumped between reading and frames; the frames will show it */
    cap_clockfit_add(&m->read, x, diff, (double)bound_ns);
    settle_delay(m);
}
