#include "capture/gevsim/clock.h"

#include "base/clock.h"

#define PTP_WANDER_NS 100 /* largest error of a slave */

void gvcam_clock_start(struct gvcam_clock *k, const struct cap_gvcam_config *c, int64_t now)
{
    k->tick_hz = (uint64_t)c->tick_hz;
    k->settle_ns = (int64_t)(c->ptp_settle_ms * 1e6);
    k->tai_ns = (int64_t)(c->tai_offset_s * 1e9);
    k->host0 = now;
    k->dev0 = (c->boot_clock ? 0 : now) + (int64_t)(k->skew_us * 1e3);
    k->ptp_since = 0;
    k->ptp_locked = false;
    k->stuck_ns = k->dev0;
}

/* Cheap noise that depends only on time and seed, and changes ten times a second. */
static int64_t wander(const struct gvcam_clock *k, int64_t now)
{
    uint64_t z = (uint64_t)(now / (100 * PVX_NS_PER_MS)) * 0x9E3779B97F4A7C15u + k->seed;
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9u;
    return (int64_t)(z >> 33) % (2 * PTP_WANDER_NS + 1) - PTP_WANDER_NS;
}

enum gvcam_ptp gvcam_ptp_status(const struct gvcam_clock *k, int64_t now)
{
    if (k->ptp_since == 0)
        return GVCAM_PTP_DISABLED;
    int64_t t = now - k->ptp_since, whole = k->settle_ns;
    if (t < whole / 10)
        return GVCAM_PTP_INITIALIZING;
    if (t < whole / 2 || k->no_ptp_master)
        return GVCAM_PTP_LISTENING;
    if (k->ptp_master)
        return GVCAM_PTP_MASTER;
    return t < whole ? GVCAM_PTP_UNCALIBRATED : GVCAM_PTP_SLAVE;
}

static int64_t master_ns(const struct gvcam_clock *k, int64_t now)
{
    return now + k->tai_ns;
}

static int64_t free_ns(const struct gvcam_clock *k, int64_t now)
{
    int64_t t = now - k->host0;
    return k->dev0 + t + (int64_t)((double)t * k->drift_ppm * 1e-6);
}

static int64_t slave_ns(const struct gvcam_clock *k, int64_t now)
{
    return master_ns(k, now) + wander(k, now) + (int64_t)(k->ptp_offset_us * 1e3);
}

/* PTP releases the clock, which runs on from its present time. */
static void clock_let_go(struct gvcam_clock *k, int64_t now)
{
    k->dev0 = slave_ns(k, now);
    k->host0 = now;
    k->ptp_locked = false;
}

static int64_t running_ns(struct gvcam_clock *k, int64_t now)
{
    bool slave = gvcam_ptp_status(k, now) == GVCAM_PTP_SLAVE;
    if (k->ptp_locked && !slave)
        clock_let_go(k, now);
    k->ptp_locked = slave;
    return slave ? slave_ns(k, now) : free_ns(k, now);
}

int64_t gvcam_clock_ns(struct gvcam_clock *k, int64_t now)
{
    return k->stuck ? k->stuck_ns : running_ns(k, now);
}

int64_t gvcam_ptp_offset_ns(struct gvcam_clock *k, int64_t now)
{
    int64_t off = running_ns(k, now) - master_ns(k, now);
    return gvcam_ptp_status(k, now) == GVCAM_PTP_MASTER ? 0 : off;
}

uint64_t gvcam_clock_hz(const struct gvcam_clock *k)
{
    return k->ptp_since != 0 ? 1000000000u : k->tick_hz;
}

uint64_t gvcam_clock_ticks(const struct gvcam_clock *k, int64_t dev_ns)
{
    uint64_t hz = gvcam_clock_hz(k);
    if (hz == 1000000000u || dev_ns < 0)
        return (uint64_t)dev_ns;
    uint64_t s = (uint64_t)dev_ns / 1000000000u, rest = (uint64_t)dev_ns % 1000000000u;
    return s * hz + rest * hz / 1000000000u; /* hz <= 1e10: no overflow */
}

void gvcam_clock_faults(struct gvcam_clock *k, const struct cap_gvcam_fault *f, int64_t now)
{
    if (f->drift_ppm != k->drift_ppm && !k->ptp_locked) {
        k->dev0 = free_ns(k, now);
        k->host0 = now;
    }
    k->drift_ppm = f->drift_ppm;
    k->dev0 += (int64_t)((f->skew_us - k->skew_us) * 1e3);
    k->skew_us = f->skew_us;
    if (f->stuck_clock && !k->stuck)
        k->stuck_ns = running_ns(k, now);
    k->stuck = f->stuck_clock;
    k->no_ptp_master = f->no_ptp_master;
    k->ptp_master = f->ptp_master;
    k->ptp_offset_us = f->ptp_offset_us;
}

void gvcam_clock_jump(struct gvcam_clock *k, int64_t now, int64_t ns)
{
    (void)running_ns(k, now);
    k->dev0 += ns;
    k->stuck_ns += ns;
}

bool gvcam_clock_reset(struct gvcam_clock *k, int64_t now)
{
    if (k->ptp_since != 0)
        return false;
    k->dev0 = 0;
    k->host0 = now;
    k->stuck_ns = 0;
    return true;
}

void gvcam_ptp_enable(struct gvcam_clock *k, int64_t now, bool on)
{
    if (on == (k->ptp_since != 0))
        return;
    (void)running_ns(k, now);
    if (!on && k->ptp_locked)
        clock_let_go(k, now);
    k->ptp_since = on ? now : 0;
}
