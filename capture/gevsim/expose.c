/* expose.c - when a frame is exposed, its image and its data. */
#include <math.h>
#include <string.h>

#include "base/clock.h"
#include "capture/gevsim/gevsim.h"

#define CATCH_UP_NS PVX_NS_PER_S /* a thread farther behind than this leaves frames out */

double gvcam_expose_rate(const struct cap_gvcam *c)
{
    double rate = gvcam_float(c, GVF_RATE), exposure = gvcam_float(c, GVF_EXPOSURE);
    if (c->reg.v[GVF_RATE_ENABLE] == 0 || fabs(rate - c->c.ring_fps) < 1e-6 * rate)
        rate = c->c.ring_fps; /* exactly: registers hold single precision */
    rate = rate < 1e6 / exposure ? rate : 1e6 / exposure;
    double frame_s = (double)gvcam_payload(c) * 8 / (c->c.link_mbit * 1e6);
    return rate < 0.97 / frame_s ? rate : 0.97 / frame_s; /* 3 % are packet heads */
}

static bool free_running(const struct cap_gvcam *c)
{
    return c->reg.v[GVF_TRIGGER_MODE] == 0;
}

static int64_t tick_ns(int64_t tick, double rate)
{
    return (int64_t)llroundl((long double)tick * 1e9L / rate);
}

static int64_t tick_at(int64_t t, double rate)
{
    int64_t k = (int64_t)floorl((long double)t * rate / 1e9L);
    while (tick_ns(k + 1, rate) <= t)
        k++;
    while (tick_ns(k, rate) > t)
        k--;
    return k;
}

void gvcam_expose_start(struct cap_gvcam *c, int64_t now)
{
    if (c->expose.acquiring)
        return;
    gvcam_send_start(c);
    gvcam_image_start(c);
    c->expose.frames_left = c->reg.v[GVF_ACQ_MODE] == 0   ? UINT32_MAX
                            : c->reg.v[GVF_ACQ_MODE] == 1 ? 1
                                                          : c->reg.v[GVF_ACQ_COUNT];
    c->expose.tick = tick_at(now, gvcam_expose_rate(c));
    c->expose.tick_rate = gvcam_expose_rate(c);
    c->expose.trigger_at = GVCAM_NEVER;
    c->expose.busy_until = c->expose.frame_count = 0;
    c->expose.last_moment = INT64_MIN;
    c->expose.n_actions = 0;
    c->expose.acquiring = true;
}

void gvcam_expose_stop(struct cap_gvcam *c)
{
    c->expose.acquiring = false;
    c->expose.n_actions = 0;
    c->expose.trigger_at = GVCAM_NEVER;
    gvcam_send_forget(c);
}

/* The image that the frame with number `count` shows instead of `index`. */
static int64_t expose_image_of(struct cap_gvcam *c, uint32_t count, int64_t index)
{
    const uint32_t n = CAP_GVCAM_LATE_MAX + 1;
    double late = fmin(fmin(c->fault.late, CAP_GVCAM_LATE_MAX), count);
    bool hold = c->fault.freeze || c->fault.still;
    c->expose.past[count % n] = index;
    index = c->expose.past[(count - (uint32_t)late) % n];
    if (hold && !c->expose.held)
        c->expose.held_index = index;
    c->expose.held = hold;
    return hold ? c->expose.held_index : index;
}

/* Expose a frame at host time `moment`, with image `index`. */
static void expose_frame(struct cap_gvcam *c, int64_t moment, int64_t index, int64_t now)
{
    const struct cap_gvcam_fault *f = &c->fault;
    if (moment <= c->expose.last_moment && c->expose.last_moment - moment < 10 * PVX_NS_PER_S)
        return; /* the ring has no newer image */
    c->expose.last_moment = moment;
    struct gvcam_shot s = {.id = c->expose.id,
                           .index = c->link->shown > 0 ? c->link->shown - 1 : index,
                           .ticks = gvcam_clock_ticks(&c->clock, gvcam_clock_ns(&c->clock, moment)),
                           .line = gvcam_lines(c),
                           .count = c->expose.frame_count++,
                           .exposure_us = gvcam_float(c, GVF_EXPOSURE),
                           .gain = gvcam_float(c, GVF_GAIN)};
    c->expose.id = cap_gvsp_next(c->expose.id, c->send.wide);
    c->stats.exposed++;
    c->expose.busy_until = moment + (int64_t)((double)s.exposure_us * 1e3);
    s.index = expose_image_of(c, s.count, s.index);
    if (f->freeze && !c->expose.frozen)
        c->expose.frozen_ticks = s.ticks;
    c->expose.frozen = f->freeze;
    if (c->expose.frozen)
        s.ticks = c->expose.frozen_ticks;
    if (c->expose.frames_left != UINT32_MAX && --c->expose.frames_left == 0)
        c->expose.acquiring = false; /* queued frames are still sent */
    if (gvcam_chance(c, f->drop)) {
        c->stats.dropped++;
        return;
    }
    double late_ms = f->delay_ms + (f->jitter_ms > 0 ? f->jitter_ms * pvx_uniform(&c->rng) : 0);
    s.send_at = (moment < now ? moment : now) + (int64_t)(late_ms * 1e6);
    if (gvcam_chance(c, f->wrong_size))
        s.wrong = pvx_uniform(&c->rng) < 0.5 ? 1 : 2;
    if (gvcam_chance(c, f->corrupt))
        s.corrupt = pvx_uniform(&c->rng) < 0.5 ? 1 : 2;
    s.hostile = gvcam_chance(c, f->hostile);
    c->stats.overrun += !gvcam_send_queue(c, &s);
}

static void expose_tick(struct cap_gvcam *c, int64_t t, double rate, int64_t now)
{
    double ring = c->c.ring_fps;
    if (rate != ring) { /* not the ring's own instants */
        expose_frame(c, t, cap_gvcam_index(t, ring), now);
        return;
    }
    int64_t index = (int64_t)floorl((long double)t * (long double)ring / 1e9L + 1e-6L);
    expose_frame(c, tick_ns(index, ring), index, now);
}

static int64_t free_run_step(struct cap_gvcam *c, int64_t now)
{
    double rate = gvcam_expose_rate(c);
    if (rate != c->expose.tick_rate || now - tick_ns(c->expose.tick, rate) > CATCH_UP_NS) {
        c->expose.tick = tick_at(now, rate);
        c->expose.tick_rate = rate;
    }
    while (c->expose.acquiring && tick_ns(c->expose.tick + 1, rate) <= now)
        expose_tick(c, tick_ns(++c->expose.tick, rate), rate, now);
    return c->expose.acquiring ? tick_ns(c->expose.tick + 1, rate) : GVCAM_NEVER;
}

/* ---- triggers --------------------------------------------------------------------------------- */

static bool waits_for(const struct cap_gvcam *c, enum gvcam_trigger source)
{
    return c->expose.acquiring && !free_running(c) &&
           c->reg.v[GVF_TRIGGER_SOURCE] == (uint32_t)source;
}

static void gevsim_expose(struct cap_gvcam *c, int64_t at, int64_t now)
{
    if (at < c->expose.busy_until)
        c->stats.too_fast++;
    else
        expose_frame(c, at, cap_gvcam_index(at, c->c.ring_fps), now);
}

void gvcam_trigger(struct cap_gvcam *c, enum gvcam_trigger source, int64_t at)
{
    if (!waits_for(c, source))
        return;
    c->stats.triggers++;
    if (gvcam_chance(c, c->fault.miss)) {
        c->stats.missed++;
        return;
    }
    int64_t delay = (int64_t)((double)gvcam_float(c, GVF_TRIGGER_DELAY) * 1e3);
    if (delay == 0)
        gevsim_expose(c, at, at);
    else if (c->expose.trigger_at != GVCAM_NEVER)
        c->stats.too_fast++; /* one trigger at a time waits */
    else
        c->expose.trigger_at = at + delay;
}

uint16_t gvcam_action(struct cap_gvcam *c, const struct cap_gvcp_action *a, int64_t now)
{
    if (a->device_key != c->reg.v[GVF_ACTION_DEVICE_KEY] ||
        a->group_key != c->reg.v[GVF_ACTION_GROUP_KEY] ||
        (a->group_mask & c->reg.v[GVF_ACTION_GROUP_MASK]) == 0)
        return CAP_GVCP_SILENT; /* not for this camera */
    if (!waits_for(c, GVCAM_ACTION1))
        return CAP_GVCP_OK;
    int64_t dev = gvcam_clock_ns(&c->clock, now);
    if (a->scheduled && a->time > 0 && a->time <= INT64_MAX && (int64_t)a->time > dev) {
        enum gvcam_ptp ptp = gvcam_ptp_status(&c->clock, now);
        if (ptp != GVCAM_PTP_SLAVE && ptp != GVCAM_PTP_MASTER)
            return CAP_GVCP_NO_REFERENCE_TIME;
        if (c->expose.n_actions == GVCAM_ACTIONS)
            return CAP_GVCP_OVERFLOW;
        size_t k = c->expose.n_actions++; /* earliest first */
        for (; k > 0 && c->expose.action[k - 1] > (int64_t)a->time; k--)
            c->expose.action[k] = c->expose.action[k - 1];
        c->expose.action[k] = (int64_t)a->time;
    } else {
        gvcam_trigger(c, GVCAM_ACTION1, now);
    }
    return CAP_GVCP_OK;
}

/* Execute the actions that are due.  The frame is stamped with the scheduled time. */
static int64_t action_step(struct cap_gvcam *c, int64_t now)
{
    int64_t dev = gvcam_clock_ns(&c->clock, now);
    while (c->expose.n_actions > 0 && c->expose.action[0] <= dev) {
        int64_t at = now + (c->expose.action[0] - dev);
        c->expose.n_actions--;
        memmove(c->expose.action, c->expose.action + 1,
                c->expose.n_actions * sizeof c->expose.action[0]);
        gvcam_trigger(c, GVCAM_ACTION1, at);
    }
    return c->expose.n_actions > 0 ? now + (c->expose.action[0] - dev) : GVCAM_NEVER;
}

int64_t gvcam_expose_step(struct cap_gvcam *c, int64_t now)
{
    if (!c->expose.acquiring)
        return GVCAM_NEVER;
    if (free_running(c))
        return free_run_step(c, now);
    int64_t next = c->expose.n_actions > 0 ? action_step(c, now) : GVCAM_NEVER;
    if (c->expose.trigger_at <= now) {
        int64_t at = c->expose.trigger_at;
        c->expose.trigger_at = GVCAM_NEVER;
        gevsim_expose(c, at, now);
    }
    return c->expose.trigger_at < next ? c->expose.trigger_at : next;
}

void gvcam_expose_restart_ids(struct cap_gvcam *c, uint64_t first)
{
    c->expose.id = first > 0 ? first : 1;
}
