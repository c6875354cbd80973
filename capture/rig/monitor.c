/* monitor.c - a thread that reads the counters ten times a second.  It reports a trouble once when it begins, with
 * the remedy, and once when it is over.
 *
 * A trouble begins at the first look at which its count has risen.  It ends when the count has not risen for 3 s (or
 * three windows of syncwatch.h).  If it returns within a minute, this time doubles, up to 10 minutes, so that single
 * lost frames do not fill the log.
 * The supervisor reports a lost camera.  Other troubles of that camera wait until it is back. */
#include <stdio.h>
#include <strings.h>

#include "base/clock.h"
#include "base/log.h"
#include "capture/rig/capture_int.h"

#define LOOK_NS     (100 * PVX_NS_PER_MS)
#define HOLD_MIN_NS (3 * PVX_NS_PER_S)
#define HOLD_MAX_NS (600 * PVX_NS_PER_S)
#define RELAPSE_NS  (60 * PVX_NS_PER_S)
#define SETTLE_NS   (2 * PVX_NS_PER_S) /* after a start */
#define BEGIN_NS    (PVX_NS_PER_S / 2)
#define LOOKS       10 /* per second */
#define MASTERS_NS  (PVX_NS_PER_S / 2)

/* A trouble from its first occurrence until it has not been seen for a while. */
struct episode {
    bool on;
    uint64_t seen;                     /* count at the last look */
    uint64_t begin;                    /* count before the first occurrence */
    int64_t begin_ns, last_ns, end_ns; /* mono */
    int64_t hold_ns;                   /* quiet time that ends it; grows when it comes back soon */
};

struct monitor {
    struct cap_capture *cap;
    struct episode episode[CAP_MAX_CAMERAS][CAP_N_COUNT];
    struct episode bandwidth, ptp_masters;
    bool all_gone;
    int64_t all_gone_ns;                         /* since then */
    uint64_t incomplete[LOOKS][CAP_MAX_CAMERAS]; /* counts at each look of the last second */
    unsigned look;
    uint64_t steps;                       /* of the host's clock that have been reported */
    int64_t next_second[CAP_MAX_CAMERAS]; /* of bandwidth */
    int64_t masters_since;                /* since when there is more than one; 0 = not now */
    int64_t next_master_second;
};

enum change { SAME, BEGINS, ENDS };

static enum change monitor_look_at(struct episode *e, uint64_t count, int64_t now, int64_t hold_min,
                                   bool may_end)
{
    bool more = count != e->seen;
    if (more && !e->on) {
        bool relapse = e->end_ns != 0 && now - e->end_ns < RELAPSE_NS;
        e->hold_ns = relapse ? e->hold_ns * 2 : hold_min;
        if (e->hold_ns > HOLD_MAX_NS)
            e->hold_ns = HOLD_MAX_NS;
        e->on = true;
        e->begin = e->seen;
        e->begin_ns = now;
    }
    enum change c = more && e->begin_ns == now ? BEGINS : SAME;
    if (more)
        e->last_ns = now;
    e->seen = count;
    if (e->on && may_end && now - e->last_ns > e->hold_ns) {
        e->on = false;
        e->end_ns = now;
        return ENDS;
    }
    return c;
}

static void monitor_tell(const struct cap_camera *cam, int k, const struct episode *e,
                         enum change c)
{
    const struct cap_trouble_def *d = &cap_trouble_defs[k];
    char detail[CAP_DETAIL_MAX];
    const char *remedy = d->remedy;
    const struct pvx_about *about = ABOUT(.cause = cap_count_defs[k].name, .camera = cam->name);
    pvx_board_read(&cam->detail[k], detail, sizeof detail);
    if (cam->ops->recorded && (k == CAP_INCOMPLETE || k == CAP_ID_GAP))
        remedy = "the recording lacks them, or its file is damaged (pyrovox replay --info)";
    if (c == BEGINS)
        LOG_ABOUT(PVX_LOG_WARN, CAPTURE, about, "camera %s (%s): %s%s%s; %s", cam->name, cam->uri,
                  d->what, detail[0] != '\0' ? ": " : "", detail, remedy);
    else
        LOG_ABOUT(PVX_LOG_INFO, CAPTURE, about, "camera %s (%s): no more: %s (%llu %s in %.0f s)",
                  cam->name, cam->uri, d->what, (unsigned long long)(e->seen - e->begin),
                  cap_count_defs[k].unit, (double)(e->last_ns - e->begin_ns) * 1e-9);
}

static void monitor_look_at_camera(struct monitor *m, struct cap_camera *cam, int64_t now)
{
    int64_t hold = 3 * m->cap->watch.window_ns; /* fixed */
    hold = hold > HOLD_MIN_NS ? hold : HOLD_MIN_NS;
    int64_t settled = cam->intake.first_slot * CAP_FPS_BIN_NS + SETTLE_NS;
    int64_t begun = settled - SETTLE_NS + BEGIN_NS;
    bool delivers = cap_delivers(cam);
    for (int k = 0; k < CAP_N_COUNT; k++) {
        struct episode *e = &m->episode[cam->index][k];
        uint64_t count = cam->count[k];
        if (cap_trouble_defs[k].what == NULL)
            continue;
        /* not at a start: cameras start one after the other, and first frames are often bad */
        if (!e->on && ((k == CAP_LATE && now < settled) || (k == CAP_INCOMPLETE && now < begun))) {
            e->seen = count;
            continue;
        }
        enum change c = monitor_look_at(e, count, now, hold, delivers);
        cam->trouble[k] = e->on ? e->begin + 1 : 0;
        if (c != SAME && k != CAP_BANDWIDTH && k != CAP_PTP_MASTERS) /* one line for all */
            monitor_tell(cam, k, e, c);
    }
}

/* A lack of bandwidth: at least half of the running cameras, and at least two, have two or more incomplete frames
 * within a second.  The cable of a single camera does not cause that. */
static void look_at_bandwidth(struct monitor *m, int64_t now)
{
    struct cap_capture *cap = m->cap;
    uint64_t *then = m->incomplete[m->look++ % LOOKS];
    uint32_t running = 0, hit = 0;
    uint64_t mask = 0;
    for (uint32_t i = 0; i < cap->n; i++) {
        uint64_t n = cap->camera[i].count[CAP_INCOMPLETE];
        running += cap->camera[i].life.state == CAP_RUNNING;
        if (m->look > LOOKS && n - then[i] >= 2 && !cap->camera[i].ops->recorded) {
            hit++;
            mask |= 1ull << i;
        }
        then[i] = n;
    }
    bool now_so = hit >= 2 && 2 * hit >= running;
    for (uint32_t i = 0; i < cap->n && now_so; i++) {
        if ((mask >> i & 1) == 0 || now < m->next_second[i])
            continue;
        m->next_second[i] = now + PVX_NS_PER_S;
        cap->camera[i].count[CAP_BANDWIDTH]++;
    }
    struct episode *e = &m->bandwidth;
    enum change c = monitor_look_at(e, e->seen + now_so, now, HOLD_MIN_NS, true);
    if (c == BEGINS)
        LOG_ABOUT(PVX_LOG_WARN, CAPTURE, ABOUT(.cause = cap_count_defs[CAP_BANDWIDTH].name),
                  "%u of %u cameras send incomplete frames at once; %s", hit, running,
                  cap_trouble_defs[CAP_BANDWIDTH].remedy);
    else if (c == ENDS)
        LOG_ABOUT(PVX_LOG_INFO, CAPTURE, ABOUT(.cause = cap_count_defs[CAP_BANDWIDTH].name),
                  "no more: several cameras send incomplete frames at once (%.0f s)",
                  (double)(e->last_ns - e->begin_ns) * 1e-9);
}

static bool is_master(const struct cap_camera *cam)
{
    struct cap_health h;
    pvx_board_read(&cam->life.health, &h, sizeof h);
    return cam->life.state == CAP_RUNNING && cam->cfg.ptp && strcasecmp(h.ptp, "Master") == 0;
}

/* Cameras elect one master among them, which may take a moment.  If two remain, there are two different times. */
static void look_at_masters(struct monitor *m, int64_t now)
{
    struct cap_capture *cap = m->cap;
    struct episode *e = &m->ptp_masters;
    char names[128] = "";
    size_t at = 0;
    unsigned n = 0;
    for (uint32_t i = 0; i < cap->n; i++)
        if (is_master(&cap->camera[i])) {
            if (at < sizeof names)
                at += (size_t)snprintf(names + at, sizeof names - at, "%s%s", n > 0 ? ", " : "",
                                       cap->camera[i].name);
            n++;
        }
    if (n < 2)
        m->masters_since = 0;
    else if (m->masters_since == 0)
        m->masters_since = now;
    bool now_so = n >= 2 && now - m->masters_since >= MASTERS_NS;
    for (uint32_t i = 0; i < cap->n && now_so && now >= m->next_master_second; i++)
        cap->camera[i].count[CAP_PTP_MASTERS] += is_master(&cap->camera[i]);
    if (now_so && now >= m->next_master_second)
        m->next_master_second = now + PVX_NS_PER_S;
    enum change c = monitor_look_at(e, e->seen + now_so, now, HOLD_MIN_NS, true);
    if (c == BEGINS)
        LOG_ABOUT(PVX_LOG_WARN, CAPTURE, ABOUT(.cause = cap_count_defs[CAP_PTP_MASTERS].name),
                  "%u cameras are PTP masters at once (%s); %s", n, names,
                  cap_trouble_defs[CAP_PTP_MASTERS].remedy);
    else if (c == ENDS)
        LOG_ABOUT(PVX_LOG_INFO, CAPTURE, ABOUT(.cause = cap_count_defs[CAP_PTP_MASTERS].name),
                  "no more: several cameras are PTP masters at once (%.0f s)",
                  (double)(e->last_ns - e->begin_ns) * 1e-9);
}

/* If several cameras are all lost, the cause is not the cameras. */
static void monitor_look_at_all(struct monitor *m, int64_t now)
{
    struct cap_capture *cap = m->cap;
    uint32_t lost = 0;
    for (uint32_t i = 0; i < cap->n; i++)
        lost += cap->camera[i].life.state == CAP_LOST;
    if (cap->n < 2)
        return;
    if (lost == cap->n && !m->all_gone) {
        m->all_gone = true;
        m->all_gone_ns = now;
        cap->times_all_gone++;
        LOG_ABOUT(
            PVX_LOG_ERROR, CAPTURE, ABOUT(.cause = "all_lost"),
            "all %u cameras are gone; look at the switch, its power and this host's network or "
            "USB port; they are used again as they come back",
            cap->n);
    } else if (lost == 0 && m->all_gone) {
        m->all_gone = false;
        LOG_ABOUT(PVX_LOG_INFO, CAPTURE, ABOUT(.cause = "all_lost"),
                  "all %u cameras are back, after %.1f s", cap->n,
                  (double)(now - m->all_gone_ns) * 1e-9);
    }
}

static void look_at_host_clock(struct monitor *m)
{
    pthread_mutex_lock(&m->cap->figures);
    uint64_t steps = m->cap->host.steps;
    int64_t step_ns = m->cap->host.last_step_ns;
    pthread_mutex_unlock(&m->cap->figures);
    if (steps != m->steps)
        LOG_ABOUT(PVX_LOG_WARN, CAPTURE, ABOUT(.cause = "host_clock"),
                  "the host's clock was set by %+.3f s; the times of frames follow it, no frame is "
                  "lost (let chrony or ntpd steer it instead of setting it)",
                  (double)step_ns * 1e-9);
    m->steps = steps;
}

static void monitor_look(struct monitor *m, int64_t now)
{
    for (uint32_t i = 0; i < m->cap->n; i++)
        monitor_look_at_camera(m, &m->cap->camera[i], now);
    look_at_bandwidth(m, now);
    look_at_masters(m, now);
    monitor_look_at_all(m, now);
    look_at_host_clock(m);
}

void *cap_monitor(void *arg)
{
    struct cap_capture *cap = arg;
    struct monitor m = {.cap = cap};
    bool stop;
    do {
        if (!cap->stop)
            pvx_bell_wait(&cap->ending, pvx_now_mono() + LOOK_NS);
        stop = cap->stop;
        monitor_look(&m, pvx_now_mono());
    } while (!stop);
    return NULL;
}
