/* gvcam_clock.c - the device clock: an oscillator of its own, or PTP's. */
#include "base/clock.h"
#include "capture/gvcam_int.h"

#define PTP_WANDER_NS 100 /* how far a slave is off at most */

void gvcam_clock_start(struct cap_gvcam *c, int64_t now)
{
    c->clock.host0 = now;
    c->clock.dev0 = (c->c.boot_clock ? 0 : now) + (int64_t)(c->clock.skew_us * 1e3);
    c->clock.ptp_since = 0;
    c->clock.ptp_locked = false;
    c->clock.stuck_ns = c->clock.dev0;
}

/* Cheap noise that is the same whenever it is asked for: changes ten times a second. */
static int64_t wander(const struct cap_gvcam *c, int64_t now)
{
    uint64_t z = (uint64_t)(now / (100 * PVX_NS_PER_MS)) * 0x9E3779B97F4A7C15u + c->addr.s_addr;
    z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9u;
    return (int64_t)(z >> 33) % (2 * PTP_WANDER_NS + 1) - PTP_WANDER_NS;
}

static int64_t settle_ns(const struct cap_gvcam *c)
{
    return (int64_t)(c->c.ptp_settle_ms * 1e6);
}

enum gvcam_ptp gvcam_ptp_status(const struct cap_gvcam *c, int64_t now)
{
    if (c->clock.ptp_since == 0)
        return GVCAM_PTP_DISABLED;
    int64_t t = now - c->clock.ptp_since, whole = settle_ns(c);
    if (t < whole / 10)
        return GVCAM_PTP_INITIALIZING;
    if (t < whole / 2 || c->fault.no_ptp_master)
        return GVCAM_PTP_LISTENING;
    if (c->fault.ptp_master)
        return GVCAM_PTP_MASTER;
    return t < whole ? GVCAM_PTP_UNCALIBRATED : GVCAM_PTP_SLAVE;
}

static int64_t master_ns(const struct cap_gvcam *c, int64_t now)
{
    return now + (int64_t)(c->c.tai_offset_s * 1e9);
}

static int64_t free_ns(const struct cap_gvcam *c, int64_t now)
{
    int64_t t = now - c->clock.host0;
    return c->clock.dev0 + t + (int64_t)((double)t * c->clock.drift_ppm * 1e-6);
}

static int64_t slave_ns(const struct cap_gvcam *c, int64_t now)
{
    return master_ns(c, now) + wander(c, now) + (int64_t)(c->fault.ptp_offset_us * 1e3);
}

/* PTP lets the clock go: it runs on from where it is. */
static void let_go(struct cap_gvcam *c, int64_t now)
{
    c->clock.dev0 = slave_ns(c, now);
    c->clock.host0 = now;
    c->clock.ptp_locked = false;
}

static int64_t running_ns(struct cap_gvcam *c, int64_t now)
{
    bool slave = gvcam_ptp_status(c, now) == GVCAM_PTP_SLAVE;
    if (c->clock.ptp_locked && !slave)
        let_go(c, now);
    c->clock.ptp_locked = slave;
    return slave ? slave_ns(c, now) : free_ns(c, now);
}

int64_t gvcam_clock_ns(struct cap_gvcam *c, int64_t now)
{
    return c->clock.stuck ? c->clock.stuck_ns : running_ns(c, now);
}

int64_t gvcam_ptp_offset_ns(struct cap_gvcam *c, int64_t now)
{
    int64_t off = running_ns(c, now) - master_ns(c, now);
    return gvcam_ptp_status(c, now) == GVCAM_PTP_MASTER ? 0 : off;
}

uint64_t gvcam_clock_hz(const struct cap_gvcam *c)
{
    return c->clock.ptp_since != 0 ? 1000000000u : (uint64_t)c->c.tick_hz;
}

uint64_t gvcam_clock_ticks(const struct cap_gvcam *c, int64_t dev_ns)
{
    uint64_t hz = gvcam_clock_hz(c);
    if (hz == 1000000000u || dev_ns < 0)
        return (uint64_t)dev_ns;
    uint64_t s = (uint64_t)dev_ns / 1000000000u, rest = (uint64_t)dev_ns % 1000000000u;
    return s * hz + rest * hz / 1000000000u; /* hz <= 1e10: no overflow */
}

void gvcam_clock_faults(struct cap_gvcam *c, const struct cap_gvcam_fault *f, int64_t now)
{
    if (f->drift_ppm != c->clock.drift_ppm && !c->clock.ptp_locked) {
        c->clock.dev0 = free_ns(c, now);
        c->clock.host0 = now;
    }
    c->clock.drift_ppm = f->drift_ppm;
    c->clock.dev0 += (int64_t)((f->skew_us - c->clock.skew_us) * 1e3);
    c->clock.skew_us = f->skew_us;
    if (f->stuck_clock && !c->clock.stuck)
        c->clock.stuck_ns = running_ns(c, now);
    c->clock.stuck = f->stuck_clock;
}

void gvcam_clock_jump(struct cap_gvcam *c, int64_t now, int64_t ns)
{
    (void)running_ns(c, now);
    c->clock.dev0 += ns;
    c->clock.stuck_ns += ns;
}

void gvcam_clock_reset(struct cap_gvcam *c, int64_t now)
{
    if (c->clock.ptp_since != 0)
        return;
    c->clock.dev0 = 0;
    c->clock.host0 = now;
    c->clock.stuck_ns = 0;
}

void gvcam_ptp_enable(struct cap_gvcam *c, int64_t now, bool on)
{
    if (on == (c->clock.ptp_since != 0))
        return;
    (void)running_ns(c, now);
    if (!on && c->clock.ptp_locked)
        let_go(c, now);
    c->clock.ptp_since = on ? now : 0;
}
