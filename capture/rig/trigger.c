#include "capture/rig/trigger.h"

#include <errno.h>
#include <poll.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/log.h"
#include "capture/wire/gvcp.h"

#define LOOK_NS      (100 * PVX_NS_PER_MS) /* how soon a stop is seen */
#define ANSWER_NS    (200 * PVX_NS_PER_MS)
#define NEW_GRID_NS  PVX_NS_PER_S
#define READING_NS   (10 * PVX_NS_PER_S) /* older readings of a clock do not count */
#define MOST_ANSWERS 256                 /* per look */

struct run {
    struct cap_capture *cap;
    cap_action_sender *sender;
    uint16_t number;
    struct cap_trigger_open open[CAP_TRIGGER_OPEN];
    unsigned next_open;
    uint64_t silent; /* bit = camera that was reported as silent */
    /* shown to others on their boards */
    struct cap_action_stats stats;
    struct cap_action_answers answers[CAP_MAX_CAMERAS];
};

/* The addresses to send to, and the cameras that should answer. */
struct targets {
    uint32_t address[CAP_MAX_CAMERAS];
    size_t n;
    uint64_t cameras;
    bool clock;        /* offset is known */
    int64_t offset_ns; /* cameras' clock - CLOCK_MONOTONIC */
};

static void add_address(struct targets *t, uint32_t address)
{
    for (size_t i = 0; i < t->n; i++)
        if (t->address[i] == address)
            return;
    if (address != 0 && t->n < CAP_MAX_CAMERAS)
        t->address[t->n++] = address;
}

static void look_at_cameras(struct cap_capture *cap, struct targets *t)
{
    const struct cap_action_config *a = &cap->cfg.action;
    int64_t real, now, best = INT64_MAX;
    pvx_now_both(&real, &now);
    memset(t, 0, sizeof *t);
    if (cap->cfg.shared_clock) {
        t->clock = true;
        t->offset_ns = real - now;
    }
    for (size_t i = 0; i < a->n_addresses; i++)
        add_address(t, a->address[i]);
    for (uint32_t i = 0; i < cap->n; i++) {
        const struct cap_camera *cam = &cap->camera[i];
        struct cap_health h;
        pvx_board_read(&cam->life.health, &h, sizeof h);
        if (cam->life.state != CAP_RUNNING || h.address == 0)
            continue;
        t->cameras |= UINT64_C(1) << i;
        if (a->n_addresses == 0)
            add_address(t, h.broadcast);
        bool fresh = h.clock.bound_ns >= 0 && now - h.clock.host_mono_ns < READING_NS;
        if (fresh && !cap->cfg.shared_clock && h.clock.bound_ns < best) {
            best = h.clock.bound_ns;
            t->clock = true;
            t->offset_ns = h.clock.device_ns - h.clock.host_mono_ns;
        }
    }
}

/* ---- answers ---------------------------------------------------------------------------------- */

static void show_answers(struct run *r, uint32_t i)
{
    pvx_board_write(&r->cap->camera[i].answers, &r->answers[i], sizeof r->answers[i]);
}

static void close_open(struct run *r, struct cap_trigger_open *o)
{
    struct cap_capture *cap = r->cap;
    uint64_t silent = o->expected & ~o->answered;
    o->number = 0;
    for (uint32_t i = 0; i < cap->n; i++) {
        uint64_t bit = UINT64_C(1) << i;
        if ((silent & bit) == 0)
            continue;
        r->answers[i].silent++;
        show_answers(r, i);
        if ((r->silent & bit) == 0)
            LOG_ABOUT(PVX_LOG_WARN, CAPTURE,
                      ABOUT(.cause = "action_silent", .camera = cap->camera[i].name),
                      "camera %s (%s): does not acknowledge action commands: wrong keys, another "
                      "network, or a camera that never does (action.acknowledge: false)",
                      cap->camera[i].name, cap->camera[i].uri);
    }
    r->silent = (r->silent | silent) & ~o->answered;
}

static void note_answer(struct run *r, struct cap_trigger_open *o, uint32_t from, uint16_t status)
{
    struct cap_capture *cap = r->cap;
    for (uint32_t i = 0; i < cap->n; i++) {
        struct cap_action_answers *a = &r->answers[i];
        uint64_t bit = UINT64_C(1) << i;
        struct cap_health h;
        pvx_board_read(&cap->camera[i].life.health, &h, sizeof h);
        if (h.address != from || (o->expected & ~o->answered & bit) == 0)
            continue;
        o->answered |= bit;
        a->acknowledged += status == 0;
        a->refused += status != 0;
        a->too_late += status == CAP_GVCP_ACTION_LATE;
        a->no_clock += status == CAP_GVCP_NO_REFERENCE_TIME;
        show_answers(r, i);
        break;
    }
    if (status != 0)
        LOG_EVERY(PVX_LOG_WARN, CAPTURE,
                  "an action command was refused by %u.%u.%u.%u: %s (0x%04x)", from >> 24,
                  from >> 16 & 255, from >> 8 & 255, from & 255,
                  status == CAP_GVCP_ACTION_LATE         ? "it came too late: raise action.lead_ms"
                  : status == CAP_GVCP_NO_REFERENCE_TIME ? "the camera's clock is not synchronized"
                                                         : "error",
                  status);
}

static void read_answers(struct run *r)
{
    struct cap_action_ack a;
    uint32_t from;
    for (int n = 0; n < MOST_ANSWERS && cap_action_answer(r->sender, &from, &a); n++)
        for (int i = 0; i < CAP_TRIGGER_OPEN; i++)
            if (r->open[i].number == a.number)
                note_answer(r, &r->open[i], from, a.status);
    int64_t now = pvx_now_mono();
    for (int i = 0; i < CAP_TRIGGER_OPEN; i++)
        if (r->open[i].number != 0 && now >= r->open[i].until_mono_ns)
            close_open(r, &r->open[i]);
}

/* Wait until mono_ns and read answers meanwhile; false = stop. */
static bool wait_until(struct run *r, int64_t mono_ns)
{
    for (;;) {
        if (r->cap->stop)
            return false;
        read_answers(r);
        int64_t left = mono_ns - pvx_now_mono();
        if (left <= 0)
            return true;
        if (left > LOOK_NS)
            left = LOOK_NS;
        struct timespec ts = {.tv_sec = 0, .tv_nsec = (long)left};
        struct pollfd p = {.fd = cap_action_sender_fd(r->sender), .events = POLLIN};
        ppoll(&p, 1, &ts, NULL);
    }
}

/* ---- sending ---------------------------------------------------------------------------------- */

enum outcome { SENT, LATE, FAILED };

static void trigger_count(struct run *r, enum outcome o, uint64_t n)
{
    struct cap_action_stats *s = &r->stats;
    s->sent += o == SENT ? n : 0;
    s->late += o == LATE ? n : 0;
    s->failed += o == FAILED ? n : 0;
    pvx_board_write(&r->cap->action, s, sizeof *s);
}

static void expect_answers(struct run *r, uint64_t cameras)
{
    struct cap_trigger_open *o = &r->open[r->next_open++ % CAP_TRIGGER_OPEN];
    if (o->number != 0)
        close_open(r, o);
    *o = (struct cap_trigger_open){
        .number = r->number, .expected = cameras, .until_mono_ns = pvx_now_mono() + ANSWER_NS};
}

static enum outcome send_to_all(struct run *r, const struct targets *t, int64_t at_ns)
{
    const struct cap_action_config *a = &r->cap->cfg.action;
    uint8_t p[CAP_ACTION_BYTES];
    size_t failed = 0;
    r->number = r->number == UINT16_MAX ? 1 : (uint16_t)(r->number + 1);
    size_t n = cap_action_encode(&a->keys, r->number, at_ns, a->acknowledge, p);
    if (a->acknowledge)
        expect_answers(r, t->cameras);
    for (size_t i = 0; i < t->n; i++) {
        if (cap_action_send(r->sender, t->address[i], p, n) == PVX_OK)
            continue;
        failed++;
        LOG_EVERY(PVX_LOG_WARN, CAPTURE, "action command to %u.%u.%u.%u could not be sent: %s",
                  t->address[i] >> 24, t->address[i] >> 16 & 255, t->address[i] >> 8 & 255,
                  t->address[i] & 255, strerror(errno));
    }
    return failed == 0 ? SENT : FAILED;
}

static void run_at_once(struct run *r)
{
    int64_t period = r->cap->period_ns;
    for (;;) {
        /* grid points that have passed are left out */
        if (!wait_until(r, (pvx_now_mono() / period + 1) * period))
            return;
        struct targets t;
        look_at_cameras(r->cap, &t);
        if (t.n > 0 && t.cameras != 0)
            trigger_count(r, send_to_all(r, &t, 0), 1);
    }
}

/* The next instant of the grid after `last` that can still be sent with its lead.  Instants missed in between count
 * as late.  If the clock was set, a new grid starts. */
static int64_t next_instant(struct run *r, const struct targets *t, int64_t last)
{
    int64_t period = r->cap->period_ns, lead = r->cap->cfg.action.lead_ns;
    int64_t at = ((pvx_now_mono() + t->offset_ns + lead) / period + 1) * period;
    if (last == 0 || llabs(at - last) > NEW_GRID_NS + period)
        return at;
    if (at <= last)
        return last + period;
    trigger_count(r, LATE, (uint64_t)((at - last) / period - 1));
    return at;
}

static void run_scheduled(struct run *r)
{
    int64_t lead = r->cap->cfg.action.lead_ns, last = 0;
    for (;;) {
        struct targets t;
        look_at_cameras(r->cap, &t);
        if (t.n == 0 || t.cameras == 0 || !t.clock) {
            last = 0;
            if (t.n > 0 && t.cameras != 0)
                LOG_EVERY(PVX_LOG_WARN, CAPTURE,
                          "no scheduled action commands: no camera tells its time (time-stamp "
                          "latch), and shared_clock is off");
            if (!wait_until(r, pvx_now_mono() + LOOK_NS))
                return;
            continue;
        }
        last = next_instant(r, &t, last);
        if (!wait_until(r, last - t.offset_ns - lead))
            return;
        if (last - t.offset_ns - pvx_now_mono() >= lead / 2) {
            trigger_count(r, send_to_all(r, &t, last), 1);
            continue;
        }
        trigger_count(r, LATE, 1);
        LOG_EVERY(PVX_LOG_WARN, CAPTURE,
                  "an action command was left out: the host was too busy to send it %.1f ms ahead; "
                  "raise action.lead_ms",
                  (double)lead * 0.5e-6);
    }
}

void *cap_trigger_run(void *arg)
{
    struct run r = {.cap = arg};
    struct pvx_diag d = {""};
    pvx_err e = cap_action_sender_new(&r.sender, &d);
    if (e != PVX_OK) {
        LOG_E(CAPTURE, "no action commands: %s", pvx_diag_text(&d, e));
        return NULL;
    }
    if (r.cap->cfg.action.lead_ns > 0)
        run_scheduled(&r);
    else
        run_at_once(&r);
    for (int i = 0; i < CAP_TRIGGER_OPEN; i++)
        if (r.open[i].number != 0)
            close_open(&r, &r.open[i]);
    cap_action_sender_free(&r.sender);
    return NULL;
}
