#include "capture/clockmap.h"

#include <math.h>
#include <string.h>

#include "base/clock.h"

#define BUCKET_NS    PVX_NS_PER_S
#define MAX_DRIFT    500e-6
#define EARLY_DRIFT  150e-6
#define MIN_FIT      3                               /* full buckets before a slope is believed */
#define MOVED_NS     (5.0 * (double)PVX_NS_PER_MS)   /* off the line: not the same line any more */
#define JUMP_NS      (100.0 * (double)PVX_NS_PER_MS) /* so far off: the camera's clock, surely */
#define EARLY_NS     (2.0 * (double)PVX_NS_PER_S)    /* the same before there is a line */
#define MOVED_AFTER  3                               /* buckets that are late throughout */
#define MAX_BOUND_NS (10 * PVX_NS_PER_MS)
#define GOOD_DRIFT   50e-6 /* uncertainty below which readings are the line */
#define MIN_READ     3
#define STALE_NS     (10 * PVX_NS_PER_S)
#define UNFIT_NS     100e3 /* a reading farther off, beyond the bounds: the clock has been moved */

void cap_clockmap_init(struct cap_clockmap *m, bool shared)
{
    memset(m, 0, sizeof *m);
    m->shared = shared;
}

/* Differences are kept relative to host0 - dev0, where double has ns to spare. */
static double envelope(const struct cap_clockmap *m, int64_t device_ns)
{
    return m->offset_ns + m->drift * (double)(device_ns - m->dev0);
}

static void forget_readings(struct cap_clockmap *m)
{
    m->n_readings = m->reading_head = 0;
    m->read.good = false;
}

/* The crystal is the same after a jump: the drift stays. */
static void restart(struct cap_clockmap *m, int64_t device_ns, int64_t arrival_ns)
{
    m->valid = true;
    m->dev0 = device_ns;
    m->host0 = arrival_ns;
    m->offset_ns = 0;
    m->delay_ns = m->delay_bound_ns = 0;
    m->n = m->head = m->above = 0;
    forget_readings(m);
    m->bucket_end = device_ns + BUCKET_NS;
    m->current = (struct cap_clock_bucket){device_ns, 0};
}

/* The network's delay has changed, the clock has not: what was read of it stays. */
static void restart_envelope(struct cap_clockmap *m, int64_t device_ns, double diff)
{
    m->offset_ns = diff - m->drift * (double)(device_ns - m->dev0);
    m->n = m->head = m->above = 0;
    m->bucket_end = device_ns + BUCKET_NS;
    m->current = (struct cap_clock_bucket){device_ns, diff};
}

/* Lower side of the convex hull of the buckets, and its edge over their mean time. */
static void fit(struct cap_clockmap *m)
{
    double x[CAP_CLOCK_BUCKETS] = {0}, y[CAP_CLOCK_BUCKETS] = {0}, mean = 0;
    int hull = 0;
    for (int i = 0; i < m->n; i++) {
        const struct cap_clock_bucket *b =
            &m->bucket[(m->head - m->n + i + CAP_CLOCK_BUCKETS) % CAP_CLOCK_BUCKETS];
        double px = (double)(b->dev - m->dev0), py = b->diff_ns;
        mean += px / m->n;
        while (hull >= 2 && (y[hull - 1] - y[hull - 2]) * (px - x[hull - 2]) >=
                                (py - y[hull - 2]) * (x[hull - 1] - x[hull - 2]))
            hull--;
        x[hull] = px;
        y[hull++] = py;
    }
    int k = 1;
    while (k < hull - 1 && x[k] < mean)
        k++;
    double slope = x[k] > x[k - 1] ? (y[k] - y[k - 1]) / (x[k] - x[k - 1]) : 0;
    double most = m->n < CAP_CLOCK_KNOWN ? EARLY_DRIFT : MAX_DRIFT;
    m->drift = fmin(fmax(slope, -most), most);
    m->offset_ns = INFINITY; /* clamped or not, the line lies under all of them */
    for (int i = 0; i < hull; i++)
        m->offset_ns = fmin(m->offset_ns, y[i] - m->drift * x[i]);
    m->offset_ns -= fmax(envelope(m, m->current.dev) - m->current.diff_ns, 0);
    m->excess_ns = 0;
    for (int i = 0; i < m->n; i++)
        m->excess_ns += (m->bucket[i].diff_ns - envelope(m, m->bucket[i].dev)) / m->n;
}

/* Least squares through the readings, about their weighted mean. */
static void line_of_readings(struct cap_clockmap *m)
{
    double weight = 0, mx = 0, my = 0, sxx = 0, sxy = 0;
    for (int i = 0; i < m->n_readings; i++) {
        const struct cap_clock_reading *r = &m->reading[i];
        double w = 1 / (r->bound_ns * r->bound_ns);
        weight += w;
        mx += w * (double)(r->dev - m->dev0);
        my += w * r->diff_ns;
    }
    mx /= weight;
    my /= weight;
    for (int i = 0; i < m->n_readings; i++) {
        const struct cap_clock_reading *r = &m->reading[i];
        double w = 1 / (r->bound_ns * r->bound_ns), x = (double)(r->dev - m->dev0) - mx;
        sxx += w * x * x;
        sxy += w * x * (r->diff_ns - my);
    }
    m->read.at = mx;
    m->read.diff_ns = my;
    m->read.bound_ns = 1 / sqrt(weight);
    m->read.drift_bound = sxx > 0 ? 1 / sqrt(sxx) : INFINITY;
    m->read.drift = sxx > 0 ? fmin(fmax(sxy / sxx, -MAX_DRIFT), MAX_DRIFT) : 0;
    m->read.good = m->n_readings >= MIN_READ && m->read.drift_bound < GOOD_DRIFT;
}

static double read_line(const struct cap_clockmap *m, int64_t device_ns)
{
    return m->read.diff_ns + m->read.drift * ((double)(device_ns - m->dev0) - m->read.at);
}

static bool by_readings(const struct cap_clockmap *m, int64_t device_ns)
{
    return m->read.good && device_ns - m->read.newest < STALE_NS;
}

/* delay = envelope - what the readings say, weighted; a delay cannot be negative. */
static void settle_readings(struct cap_clockmap *m)
{
    double sum = 0, weight = 0;
    for (int i = 0; i < m->n_readings; i++) {
        const struct cap_clock_reading *r = &m->reading[i];
        double w = 1 / (r->bound_ns * r->bound_ns);
        sum += w * (envelope(m, r->dev) - r->diff_ns);
        weight += w;
    }
    m->delay_ns = weight > 0 ? fmax(sum / weight, 0) : 0;
    m->delay_bound_ns = weight > 0 ? 1 / sqrt(weight) : 0;
}

static void keep_bucket(struct cap_clockmap *m)
{
    double by = m->current.diff_ns - envelope(m, m->current.dev);
    m->above = m->n >= MIN_FIT && by > MOVED_NS ? m->above + 1 : 0;
    if (m->above == MOVED_AFTER) {
        m->jumps += by >= JUMP_NS;
        if (by >= JUMP_NS)
            forget_readings(m);
        restart_envelope(m, m->current.dev, m->current.diff_ns);
    }
    m->bucket[m->head] = m->current;
    m->head = (m->head + 1) % CAP_CLOCK_BUCKETS;
    if (m->n < CAP_CLOCK_BUCKETS)
        m->n++;
}

static void bucket_full(struct cap_clockmap *m, int64_t device_ns, double diff)
{
    if (isfinite(m->current.diff_ns)) /* else no frame has come yet */
        keep_bucket(m);
    m->bucket_end = device_ns + BUCKET_NS;
    m->current = (struct cap_clock_bucket){device_ns, diff};
    if (m->n >= MIN_FIT)
        fit(m);
    settle_readings(m);
}

/* One difference: into its bucket, and the line under it. */
static void take(struct cap_clockmap *m, int64_t device_ns, double diff)
{
    if (device_ns >= m->bucket_end)
        bucket_full(m, device_ns, diff);
    else if (diff < m->current.diff_ns)
        m->current = (struct cap_clock_bucket){device_ns, diff};
    double below = envelope(m, device_ns) - diff;
    if (below > 0) {
        m->offset_ns -= below;
        settle_readings(m);
    }
}

static double difference(const struct cap_clockmap *m, int64_t device_ns, int64_t host_ns)
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
        restart(m, device_ns, arrival_ns);
    double diff = difference(m, device_ns, arrival_ns), off = diff - envelope(m, device_ns);
    /* before there is a line there may have been slow frames only */
    if (backwards || off < (m->n < MIN_FIT ? -EARLY_NS : -JUMP_NS)) {
        m->jumps++;
        restart(m, device_ns, arrival_ns);
        diff = 0;
    } else if (m->n >= MIN_FIT && off < -MOVED_NS) {
        restart_envelope(m, device_ns, diff);
    }
    take(m, device_ns, diff);
    double line = envelope(m, device_ns) - m->delay_ns;
    if (by_readings(m, device_ns)) /* nothing arrives before it was exposed */
        line = fmin(read_line(m, device_ns), diff);
    return device_ns + (m->host0 - m->dev0) + llrint(line);
}

double cap_clockmap_drift(const struct cap_clockmap *m)
{
    return by_readings(m, m->last_dev) ? m->read.drift : m->drift;
}

double cap_clockmap_doubt(const struct cap_clockmap *m)
{
    if (m->shared || !m->valid)
        return 0;
    if (by_readings(m, m->last_dev))
        return 6 * m->read.bound_ns;
    return m->n < CAP_CLOCK_KNOWN ? INFINITY : 6 * m->excess_ns;
}

void cap_clockmap_measure(struct cap_clockmap *m, int64_t device_ns, int64_t host_ns,
                          int64_t bound_ns)
{
    if (m->shared || device_ns <= 0 || device_ns > INT64_MAX / 2 || bound_ns < 0 ||
        bound_ns > MAX_BOUND_NS)
        return;
    if (!m->valid) {
        restart(m, device_ns, host_ns);
        m->current.diff_ns = INFINITY;
    }
    double diff = difference(m, device_ns, host_ns);
    double off = envelope(m, device_ns) - diff; /* the delay, so far as this reading knows */
    if (fabs(off) > EARLY_NS)
        return; /* of another life of the clock; frames will tell */
    if (m->read.good && fabs(diff - read_line(m, device_ns)) >
                            UNFIT_NS + 3 * ((double)bound_ns + m->read.bound_ns) +
                                3 * m->read.drift_bound * (double)(device_ns - m->read.newest))
        forget_readings(m);
    m->reading[m->reading_head] =
        (struct cap_clock_reading){device_ns, diff, (double)bound_ns + 1000};
    m->reading_head = (m->reading_head + 1) % CAP_CLOCK_READINGS;
    if (m->n_readings < CAP_CLOCK_READINGS)
        m->n_readings++;
    m->read.newest = device_ns;
    line_of_readings(m);
    settle_readings(m);
}
