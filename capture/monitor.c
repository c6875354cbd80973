/* monitor.c - a thread that looks at the counters ten times a second and says what goes wrong: once
 * when it begins, with the remedy, and once when it is over.
 *
 * A trouble is on from the first look at which its count has risen until it has not risen for 3 s (or
 * three windows of syncwatch.h).  One that comes back within a minute has to stay away twice as long the
 * next time, 10 minutes at most, so that a frame lost now and then does not fill the log.
 * A camera that is lost is the supervisor's to report; its troubles wait until it is back. */
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "base/clock.h"
#include "base/log.h"
#include "capture/capture_int.h"

#define LOOK_NS     (100 * PVX_NS_PER_MS)
#define HOLD_MIN_NS (3 * PVX_NS_PER_S)
#define HOLD_MAX_NS (600 * PVX_NS_PER_S)
#define RELAPSE_NS  (60 * PVX_NS_PER_S)
#define SETTLE_NS   (2 * PVX_NS_PER_S) /* after a start */
#define BEGIN_NS    (PVX_NS_PER_S / 2)
#define LOOKS       10 /* in a second */
#define MASTERS_NS  (PVX_NS_PER_S / 2)
#define LINES_MAX   16 /* that one look may say; the rest is said by the next */
#define LINE_CHARS  640

const struct cap_trouble_def cap_trouble_defs[CAP_N_COUNT] = {
    [CAP_INCOMPLETE] = {"frames arrive incomplete",
                        "data is lost on the way: look at cable and switch, let the camera pause "
                        "between packets, raise the receive buffers (pyrovox doctor)"},
    [CAP_BAD_SIZE] = {"frames of another size are left out",
                      "the camera's region must be the rig's image size"},
    [CAP_BAD_FORMAT] = {"frames of another pixel format are left out", "set pixel_format"},
    [CAP_CLOCK_STUCK] =
        {"its time stands still, its frames are left out",
         "the camera has frozen or repeats a picture: it is used again as soon as its "
         "stamps move; switch it off and on if they do not"},
    [CAP_UNDERRUN] = {"no buffer was free for its frames",
                      "they come faster than they are used: raise buffers, lower fps, or give the "
                      "solver less to do"},
    [CAP_LATE] = {"frames come after their set was closed",
                  "raise sync.max_wait_ms, or look for what delays this camera"},
    [CAP_ID_GAP] = {"frames that it numbered never came",
                    "they were lost in the camera, on the way or in the driver: look at the link's "
                    "load (pyrovox doctor)"},
    [CAP_NO_TRIGGER] = {"it answers, but no pulse comes on its trigger line",
                        "start the pulse generator; else look at the cable, at trigger_line and at "
                        "TriggerActivation"},
    [CAP_CLOCK_JUMP] = {"its clock jumped",
                        "the camera was restarted or its clock was set; its time is mapped anew"},
    [CAP_SLIP] = {"its frame numbers and times disagree",
                  "its pictures may belong to the instant before or after: if it happens again, "
                  "look for bouncing triggers, and start the camera anew"},
    [CAP_MISSED_TRIGGER] = {"it misses triggers",
                            "exposure and readout must end before the next trigger; look at its "
                            "trigger line"},
    [CAP_TRIGGER_MODE] =
        {"its trigger mode is not the one that was set",
         "look for what else changes the camera: another program, a user set, a button; "
         "`trigger` says what it should wait for"},
    [CAP_OUT_OF_STEP] =
        {"it is out of step",
         "is it running freely while the others are triggered, without its cable, or "
         "without the others' clock?"},
    [CAP_PHASE_WALK] = {"it runs by itself",
                        "give it the others' trigger (trigger: software, line or action) or clock "
                        "(ptp)"},
    [CAP_RATE] = {"its frame rate is wrong",
                  "fps, the camera's own rate and the trigger's must be the same, and the exposure "
                  "must fit into it; does it run freely while the others are triggered?"},
    [CAP_BANDWIDTH] = {"it sends incomplete frames together with others",
                       "the link they share is at its limit: lower fps or image size, let the "
                       "cameras pause between packets (gige.packet_delay_ns), use jumbo frames"},
    [CAP_PTP_MASTERS] =
        {"it keeps PTP time by itself, and another camera too",
         "their clocks are not one time: let PTP's messages (224.0.1.129, UDP 319 and 320) pass "
         "between all cameras, in one PTP domain, or give all one master (capture/SYNC.md)"},
};

struct line {
    enum pvx_log_level level;
    char text[LINE_CHARS];
};

struct monitor {
    struct cap_capture *cap;
    struct line line[LINES_MAX];
    unsigned n_lines;
    uint64_t incomplete[LOOKS][CAP_MAX_CAMERAS]; /* counts of the looks of the last second */
    unsigned look;
    uint64_t steps;                       /* of the host's clock that have been told */
    int64_t next_second[CAP_MAX_CAMERAS]; /* of bandwidth */
    int64_t masters_since;                /* more than one, without a break; 0 = not now */
    int64_t next_master_second;
};

static bool room(const struct monitor *m)
{
    return m->n_lines < LINES_MAX;
}

static char *say(struct monitor *m, enum pvx_log_level level)
{
    m->line[m->n_lines].level = level;
    return m->line[m->n_lines++].text;
}

enum change { SAME, BEGINS, ENDS };

static enum change look_at(struct cap_episode *e, uint64_t count, int64_t now, int64_t hold_min,
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

static void look_at_camera(struct monitor *m, struct cap_camera *cam, int64_t now)
{
    int64_t hold = 3 * m->cap->watch.window_ns;
    hold = hold > HOLD_MIN_NS ? hold : HOLD_MIN_NS;
    int64_t settled = cam->first_slot * CAP_FPS_BIN_NS + SETTLE_NS;
    int64_t begun = settled - SETTLE_NS + BEGIN_NS;
    for (int k = 0; k < CAP_N_COUNT && room(m); k++) {
        const struct cap_trouble_def *d = &cap_trouble_defs[k];
        struct cap_episode *e = &cam->episode[k];
        if (d->what == NULL)
            continue;
        /* cameras that start one after the other; the first frames after a start are often bad */
        if (!e->on && ((k == CAP_LATE && now < settled) || (k == CAP_INCOMPLETE && now < begun))) {
            e->seen = cam->count[k];
            continue;
        }
        enum change c = look_at(e, cam->count[k], now, hold, cam->delivering);
        if (c == SAME || k == CAP_BANDWIDTH || k == CAP_PTP_MASTERS) /* one line for all */
            continue;
        const char *detail = cam->detail[k], *remedy = d->remedy;
        if (cam->ops->recorded && (k == CAP_INCOMPLETE || k == CAP_ID_GAP))
            remedy = "the recording lacks them, or its file is damaged (pyrovox replay --info)";
        if (c == BEGINS)
            snprintf(say(m, PVX_LOG_WARN), LINE_CHARS, "camera %s (%s): %s%s%s; %s", cam->name,
                     cam->uri, d->what, detail[0] != '\0' ? ": " : "", detail, remedy);
        else
            snprintf(say(m, PVX_LOG_INFO), LINE_CHARS,
                     "camera %s (%s): no more: %s (%llu %s in %.0f s)", cam->name, cam->uri,
                     d->what, (unsigned long long)(e->seen - e->begin), cap_count_defs[k].unit,
                     (double)(e->last_ns - e->begin_ns) * 1e-9);
    }
}

/* Two frames or more of half of the running cameras, at least two, incomplete within a second: a
 * camera's own cable does not do that. */
static void look_at_bandwidth(struct monitor *m, int64_t now)
{
    struct cap_capture *cap = m->cap;
    uint64_t *then = m->incomplete[m->look++ % LOOKS];
    uint32_t running = 0, hit = 0;
    uint64_t mask = 0;
    for (uint32_t i = 0; i < cap->n; i++) {
        uint64_t n = cap->camera[i].count[CAP_INCOMPLETE];
        running += cap->camera[i].state == CAP_RUNNING;
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
    if (!room(m))
        return;
    uint64_t seen = cap->bandwidth.seen + now_so;
    enum change c = look_at(&cap->bandwidth, seen, now, HOLD_MIN_NS, true);
    if (c == BEGINS)
        snprintf(say(m, PVX_LOG_WARN), LINE_CHARS,
                 "%u of %u cameras send incomplete frames at once; %s", hit, running,
                 cap_trouble_defs[CAP_BANDWIDTH].remedy);
    else if (c == ENDS)
        snprintf(say(m, PVX_LOG_INFO), LINE_CHARS,
                 "no more: several cameras send incomplete frames at once (%.0f s)",
                 (double)(cap->bandwidth.last_ns - cap->bandwidth.begin_ns) * 1e-9);
}

static bool is_master(const struct cap_camera *cam)
{
    return cam->state == CAP_RUNNING && cam->cfg.ptp && strcasecmp(cam->health.ptp, "Master") == 0;
}

/* Cameras elect one master among them, which may take a moment; two that stay are two times. */
static void look_at_masters(struct monitor *m, int64_t now)
{
    struct cap_capture *cap = m->cap;
    struct cap_episode *e = &cap->ptp_masters;
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
    if (!room(m))
        return;
    enum change c = look_at(e, e->seen + now_so, now, HOLD_MIN_NS, true);
    if (c == BEGINS)
        snprintf(say(m, PVX_LOG_WARN), LINE_CHARS, "%u cameras are PTP masters at once (%s); %s", n,
                 names, cap_trouble_defs[CAP_PTP_MASTERS].remedy);
    else if (c == ENDS)
        snprintf(say(m, PVX_LOG_INFO), LINE_CHARS,
                 "no more: several cameras are PTP masters at once (%.0f s)",
                 (double)(e->last_ns - e->begin_ns) * 1e-9);
}

/* All of several cameras gone: that is not the cameras. */
static void look_at_all(struct monitor *m, int64_t now)
{
    struct cap_capture *cap = m->cap;
    struct cap_episode *e = &cap->all_gone;
    uint32_t lost = 0;
    for (uint32_t i = 0; i < cap->n; i++)
        lost += cap->camera[i].state == CAP_LOST;
    if (!room(m) || cap->n < 2 || (lost < cap->n) == !e->on)
        return;
    if (lost == cap->n) {
        e->on = true;
        e->begin_ns = now;
        cap->times_all_gone++;
        snprintf(say(m, PVX_LOG_ERROR), LINE_CHARS,
                 "all %u cameras are gone; look at the switch, its power and this host's "
                 "network or USB port; they are used again as they come back",
                 cap->n);
    } else if (lost == 0) {
        e->on = false;
        snprintf(say(m, PVX_LOG_INFO), LINE_CHARS, "all %u cameras are back, after %.1f s", cap->n,
                 (double)(now - e->begin_ns) * 1e-9);
    }
}

static void look_at_host_clock(struct monitor *m)
{
    const struct cap_host_clock *h = &m->cap->host;
    if (h->steps == m->steps || !room(m))
        return;
    m->steps = h->steps;
    snprintf(say(m, PVX_LOG_WARN), LINE_CHARS,
             "the host's clock was set by %+.3f s; the times of frames follow it, no frame is lost "
             "(let chrony or ntpd steer it instead of setting it)",
             (double)h->last_step_ns * 1e-9);
}

static void look(struct monitor *m, int64_t now)
{
    for (uint32_t i = 0; i < m->cap->n; i++)
        look_at_camera(m, &m->cap->camera[i], now);
    look_at_bandwidth(m, now);
    look_at_masters(m, now);
    look_at_all(m, now);
    look_at_host_clock(m);
}

void cap_monitor_troubles(const struct cap_camera *cam, struct cap_camera_stats *out)
{
    out->n_troubles = 0;
    for (int k = 0; k < CAP_N_COUNT && out->n_troubles < CAP_TROUBLES_MAX; k++) {
        const struct cap_episode *e = &cam->episode[k];
        if (!e->on)
            continue;
        struct cap_trouble *t = &out->trouble[out->n_troubles++];
        t->cause = (enum cap_count)k;
        t->n = cam->count[k] - e->begin;
        memcpy(t->detail, cam->detail[k], sizeof t->detail);
    }
}

void *cap_monitor(void *arg)
{
    struct cap_capture *cap = arg;
    struct monitor m = {.cap = cap};
    bool stop;
    do {
        pthread_mutex_lock(&cap->lock);
        if (!cap->stop)
            cap_wait_until(&cap->ending, &cap->lock, pvx_now_mono() + LOOK_NS);
        stop = cap->stop;
        look(&m, pvx_now_mono());
        pthread_mutex_unlock(&cap->lock);
        for (unsigned i = 0; i < m.n_lines; i++)
            pvx_log(m.line[i].level, TOPIC_CAPTURE, "%s", m.line[i].text);
        m.n_lines = 0;
    } while (!stop);
    return NULL;
}
