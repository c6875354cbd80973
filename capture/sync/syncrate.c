#include "capture/sync/syncrate.h"

#include <math.h>

#include "base/clock.h"

#define BLOCK_NS      (100 * PVX_NS_PER_MS)
#define BLOCK_PERIODS 3
#define LEAST         400e-6
#define CRYSTALS      200e-6
#define NORMAL        6.47 /* quantile at 1e-10, both sides */
#define GRAIN_NS      1e3  /* least standard error of a stamp */

void cap_rate_forget(struct cap_rate *r)
{
    r->n = r->head = 0;
    r->block[0].n = 0;
    r->count = r->off_ns = r->t_ns = 0;
}

static bool full(const struct cap_rate *r, const struct cap_rate_block *b, int64_t period_ns)
{
    return r->t_ns - b->t0_ns >= BLOCK_NS - 5 * period_ns / 4 &&
           r->count - b->count0 + 1 >= BLOCK_PERIODS;
}

bool cap_rate_add(struct cap_rate *r, int64_t t_ns, int64_t periods, int64_t period_ns)
{
    struct cap_rate_block *b = &r->block[r->head];
    bool first = r->n == 0 && b->n == 0;
    if (!first) {
        r->count += periods;
        r->off_ns += t_ns - r->t_ns - periods * period_ns;
    }
    r->t_ns = t_ns;
    if (b->n == 0)
        *b = (struct cap_rate_block){.t0_ns = t_ns, .count0 = r->count, .off0_ns = r->off_ns};
    double x = (double)(r->count - b->count0), y = (double)(r->off_ns - b->off0_ns);
    b->n++;
    b->x += x;
    b->y += y;
    b->xx += x * x;
    b->xy += x * y;
    b->yy += y * y;
    if (!full(r, b, period_ns))
        return false;
    r->head = (r->head + 1) % CAP_RATE_BLOCKS;
    r->n += r->n < CAP_RATE_BLOCKS - 1;
    r->block[r->head].n = 0;
    return true;
}

struct line {
    double off, error; /* of the period, relative to it */
    double dof;
};

/* The line through the `m` blocks that end `skip` blocks before the last full one. */
static struct line syncrate_fit(const struct cap_rate *r, unsigned m, unsigned skip,
                                int64_t period_ns)
{
    double n = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;
    unsigned first = r->head + 2 * CAP_RATE_BLOCKS - skip - m;
    const struct cap_rate_block *o = &r->block[first % CAP_RATE_BLOCKS];
    for (unsigned i = 0; i < m; i++) {
        const struct cap_rate_block *b = &r->block[(first + i) % CAP_RATE_BLOCKS];
        double dx = (double)(b->count0 - o->count0), dy = (double)(b->off0_ns - o->off0_ns);
        n += b->n;
        x += b->x + b->n * dx;
        y += b->y + b->n * dy;
        xx += b->xx + 2 * dx * b->x + b->n * dx * dx;
        xy += b->xy + dx * b->y + dy * b->x + b->n * dx * dy;
        yy += b->yy + 2 * dy * b->y + b->n * dy * dy;
    }
    double sxx = xx - x * x / n, sxy = xy - x * y / n, syy = yy - y * y / n;
    double slope = sxy / sxx, dof = fmax(n - 2, 1);
    double rest = fmax(syy - slope * sxy, 0) / dof + GRAIN_NS * GRAIN_NS;
    double period = (double)period_ns;
    return (struct line){slope / period, sqrt(rest / sxx) / period, dof};
}

double cap_rate_quantile(double dof)
{
    return sqrt(dof * expm1(NORMAL * NORMAL / dof));
}

double cap_rate_unlike(const struct cap_rate *a, const struct cap_rate *b, unsigned m,
                       int64_t period_ns)
{
    if (m < CAP_RATE_FEWEST || a->n < m || b->n < m)
        return 0;
    struct line la = syncrate_fit(a, m, 0, period_ns), lb = syncrate_fit(b, m, 0, period_ns);
    double d = (1 + la.off) / (1 + lb.off) - 1;
    double sure = cap_rate_quantile(fmin(la.dof, lb.dof)) * hypot(la.error, lb.error);
    if (!(fabs(d) > LEAST && fabs(d) - CRYSTALS > sure))
        return 0;
    for (unsigned half = 0; half < 2; half++) {
        unsigned skip = half * (m / 2);
        double part = syncrate_fit(a, m / 2, skip, period_ns).off -
                      syncrate_fit(b, m / 2, skip, period_ns).off;
        if (!(part / d > 0.5))
            return 0;
    }
    return d;
}

double cap_rate_hz(const struct cap_rate *r, unsigned m, int64_t period_ns)
{
    return 1e9 / ((double)period_ns * (1 + syncrate_fit(r, m, 0, period_ns).off));
}

int64_t cap_rate_span_ns(const struct cap_rate *r, unsigned m)
{
    return r->t_ns - r->block[(r->head + CAP_RATE_BLOCKS - m) % CAP_RATE_BLOCKS].t0_ns;
}
