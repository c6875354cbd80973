/* gvcam_take.c - when a frame is exposed, and what it shows and says. */
#include <math.h>
#include <string.h>

#include "base/clock.h"
#include "capture/gvcam_int.h"

#define CATCH_UP_NS PVX_NS_PER_S /* a thread that is further behind than this leaves frames out */

double gvcam_rate(const struct cap_gvcam *c)
{
    double rate = gvcam_float(c, GVF_RATE), exposure = gvcam_float(c, GVF_EXPOSURE);
    if (c->v[GVF_RATE_ENABLE] == 0 || fabs(rate - c->c.ring_fps) < 1e-6 * rate)
        rate = c->c.ring_fps; /* exactly: registers hold single precision */
    rate = rate < 1e6 / exposure ? rate : 1e6 / exposure;
    double frame_s = (double)gvcam_payload(c) * 8 / (c->c.link_mbit * 1e6);
    return rate < 0.97 / frame_s ? rate : 0.97 / frame_s; /* the rest is heads */
}

static bool free_running(const struct cap_gvcam *c)
{
    return c->v[GVF_TRIGGER_MODE] == 0;
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

void gvcam_start(struct cap_gvcam *c, int64_t now)
{
    if (c->acquiring)
        return;
    gvcam_forget(c);
    gvcam_images_drop(c);
    c->fmt = cap_pixfmt_from_pfnc(c->v[GVF_PIXEL_FORMAT]);
    c->region[0] = c->v[GVF_WIDTH];
    c->region[1] = c->v[GVF_HEIGHT];
    c->region[2] = c->v[GVF_OFFSET_X];
    c->region[3] = c->v[GVF_OFFSET_Y];
    c->frame_bytes = cap_pixfmt_row(c->fmt, (int32_t)c->region[0]) * c->region[1];
    c->wide = c->v[GVF_WIDE_IDS] != 0;
    c->chunks = c->v[GVF_CHUNK_MODE] != 0;
    c->frames_left = c->v[GVF_ACQ_MODE] == 0   ? UINT32_MAX
                     : c->v[GVF_ACQ_MODE] == 1 ? 1
                                               : c->v[GVF_ACQ_COUNT];
    c->tick = tick_at(now, gvcam_rate(c));
    c->tick_rate = gvcam_rate(c);
    c->trigger_at = GVCAM_NEVER;
    c->busy_until = c->frame_count = 0;
    c->last_moment = INT64_MIN;
    c->n_actions = 0;
    c->acquiring = true;
}

void gvcam_stop(struct cap_gvcam *c)
{
    c->acquiring = false;
    c->n_actions = 0;
    c->trigger_at = GVCAM_NEVER;
    gvcam_forget(c);
}

/* What is seen at host time `moment` as image `index`. */
static void take(struct cap_gvcam *c, int64_t moment, int64_t index, int64_t now)
{
    const struct cap_gvcam_fault *f = &c->fault;
    if (moment <= c->last_moment && c->last_moment - moment < 10 * PVX_NS_PER_S)
        return; /* the ring has no newer image */
    c->last_moment = moment;
    struct gvcam_shot s = {.id = c->id,
                           .index = index,
                           .ticks = gvcam_clock_ticks(c, gvcam_clock_ns(c, moment)),
                           .line = c->net->line_level,
                           .count = c->frame_count++,
                           .exposure_us = gvcam_float(c, GVF_EXPOSURE),
                           .gain = gvcam_float(c, GVF_GAIN)};
    c->id = cap_gvsp_next(c->id, c->wide);
    c->stats.taken++;
    c->busy_until = moment + (int64_t)((double)s.exposure_us * 1e3);
    if (f->freeze && !c->frozen) {
        c->frozen_index = s.index;
        c->frozen_ticks = s.ticks;
    }
    c->frozen = f->freeze;
    if (c->frozen) {
        s.index = c->frozen_index;
        s.ticks = c->frozen_ticks;
    }
    if (c->frames_left != UINT32_MAX && --c->frames_left == 0)
        c->acquiring = false; /* what is queued still goes out */
    if (gvcam_chance(c, f->drop)) {
        c->stats.dropped++;
        return;
    }
    if (c->q_n == GVCAM_QUEUE) {
        c->stats.overrun++;
        return;
    }
    double late_ms = f->delay_ms + (f->jitter_ms > 0 ? f->jitter_ms * gvcam_uniform(c) : 0);
    s.send_at = (moment < now ? moment : now) + (int64_t)(late_ms * 1e6);
    if (gvcam_chance(c, f->wrong_size))
        s.wrong = gvcam_uniform(c) < 0.5 ? 1 : 2;
    if (gvcam_chance(c, f->corrupt))
        s.corrupt = gvcam_uniform(c) < 0.5 ? 1 : 2;
    s.hostile = gvcam_chance(c, f->hostile);
    c->queue[(c->q_first + c->q_n++) % GVCAM_QUEUE] = s;
}

static void take_tick(struct cap_gvcam *c, int64_t t, double rate, int64_t now)
{
    double ring = c->c.ring_fps;
    if (rate > ring * 1.001) { /* faster than the ring: images more than once */
        take(c, t, cap_simgv_index(t, ring), now);
        return;
    }
    int64_t index = (int64_t)floorl((long double)t * (long double)ring / 1e9L + 1e-6L);
    take(c, tick_ns(index, ring), index, now);
}

static int64_t free_run_step(struct cap_gvcam *c, int64_t now)
{
    double rate = gvcam_rate(c);
    if (rate != c->tick_rate || now - tick_ns(c->tick, rate) > CATCH_UP_NS) {
        c->tick = tick_at(now, rate);
        c->tick_rate = rate;
    }
    while (c->acquiring && tick_ns(c->tick + 1, rate) <= now)
        take_tick(c, tick_ns(++c->tick, rate), rate, now);
    return c->acquiring ? tick_ns(c->tick + 1, rate) : GVCAM_NEVER;
}

/* ---- triggers --------------------------------------------------------------------------------- */

static bool waits_for(const struct cap_gvcam *c, enum gvcam_trigger source)
{
    return c->acquiring && !free_running(c) && c->v[GVF_TRIGGER_SOURCE] == (uint32_t)source &&
           c->gone_until == 0;
}

static void expose(struct cap_gvcam *c, int64_t at, int64_t now)
{
    if (at < c->busy_until)
        c->stats.too_fast++;
    else
        take(c, at, cap_simgv_index(at, c->c.ring_fps), now);
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
        expose(c, at, at);
    else if (c->trigger_at != GVCAM_NEVER)
        c->stats.too_fast++; /* one trigger at a time waits */
    else
        c->trigger_at = at + delay;
}

uint16_t gvcam_action(struct cap_gvcam *c, const struct cap_gvcp_action *a, int64_t now)
{
    if (a->device_key != c->v[GVF_ACTION_DEVICE_KEY] ||
        a->group_key != c->v[GVF_ACTION_GROUP_KEY] ||
        (a->group_mask & c->v[GVF_ACTION_GROUP_MASK]) == 0)
        return CAP_GVCP_SILENT; /* not for us */
    if (!waits_for(c, GVCAM_ACTION1))
        return CAP_GVCP_OK;
    int64_t dev = gvcam_clock_ns(c, now);
    if (a->scheduled && a->time > 0 && a->time <= INT64_MAX && (int64_t)a->time > dev) {
        enum gvcam_ptp ptp = gvcam_ptp_status(c, now);
        if (ptp != GVCAM_PTP_SLAVE && ptp != GVCAM_PTP_MASTER)
            return CAP_GVCP_NO_REFERENCE_TIME;
        if (c->n_actions == GVCAM_ACTIONS)
            return CAP_GVCP_OVERFLOW;
        size_t k = c->n_actions++; /* earliest first */
        for (; k > 0 && c->action[k - 1] > (int64_t)a->time; k--)
            c->action[k] = c->action[k - 1];
        c->action[k] = (int64_t)a->time;
    } else {
        gvcam_trigger(c, GVCAM_ACTION1, now);
    }
    return CAP_GVCP_OK;
}

/* Actions whose time has come.  The frame is stamped with the scheduled time. */
static int64_t action_step(struct cap_gvcam *c, int64_t now)
{
    int64_t dev = gvcam_clock_ns(c, now);
    while (c->n_actions > 0 && c->action[0] <= dev) {
        int64_t at = now + (c->action[0] - dev);
        c->n_actions--;
        memmove(c->action, c->action + 1, c->n_actions * sizeof c->action[0]);
        gvcam_trigger(c, GVCAM_ACTION1, at);
    }
    return c->n_actions > 0 ? now + (c->action[0] - dev) : GVCAM_NEVER;
}

int64_t gvcam_take_step(struct cap_gvcam *c, int64_t now)
{
    if (!c->acquiring)
        return GVCAM_NEVER;
    if (free_running(c))
        return free_run_step(c, now);
    int64_t next = c->n_actions > 0 ? action_step(c, now) : GVCAM_NEVER;
    if (c->trigger_at <= now) {
        int64_t at = c->trigger_at;
        c->trigger_at = GVCAM_NEVER;
        expose(c, at, now);
    }
    return c->trigger_at < next ? c->trigger_at : next;
}
