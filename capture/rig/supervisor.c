/* supervisor.c - one camera's life: open, start, trigger, watch, close, again. */
#include <stdio.h>
#include <string.h>

#include "base/clock.h"
#include "base/log.h"
#include "capture/rig/capture_int.h"

#define BACKOFF_MIN_NS (250 * PVX_NS_PER_MS)
#define BACKOFF_MAX_NS (500 * PVX_NS_PER_MS)
#define FIRST_FRAME_NS (3 * PVX_NS_PER_S)  /* patience with a camera that has just been started */
#define TOGETHER_NS    (10 * PVX_NS_PER_S) /* recorded cameras wait so long for one that hangs */
#define LOOK_NS        (100 * PVX_NS_PER_MS)
#define OVERSLEPT_NS   (50 * PVX_NS_PER_MS)
#define HEALTH_NS      PVX_NS_PER_S

enum fate { FATE_STOP, FATE_LOST, FATE_END };

/* When the last frame came.  Time in which this thread should have run but could not does not count as silence of the
 * camera, because its frames could not come in either. */
struct heard {
    int64_t said_ns; /* the time that intake gives */
    int64_t at_ns;   /* that time plus what was overslept since */
};

struct watch {
    struct cap_camera *cam;
    /* a message is not repeated until frames come */
    char said[256]; /* last trouble that was logged, "" after frames came */
    bool error;     /* life.error has a text */
    int64_t backoff_ns;
    bool ran; /* it has been started before */
    /* of this run */
    struct heard any, good;
    int64_t answered_ns;   /* when a camera without frames last answered */
    int64_t no_trigger_of; /* any.said_ns when NO_TRIGGER was counted: once until a frame comes */
};

static void hear(struct heard *h, int64_t said_ns)
{
    if (h->said_ns != said_ns)
        h->at_ns = h->said_ns = said_ns;
}

static void listen(struct watch *w)
{
    hear(&w->any, w->cam->intake.any_ns);
    hear(&w->good, w->cam->intake.good_ns);
}

static void set_state(struct cap_camera *cam, enum cap_state state)
{
    struct cap_life *life = &cam->life;
    life->state = state;
    life->tried = true;
    if (state != CAP_RUNNING) {
        life->silent_at = cam->count[CAP_RECEIVED];
        life->given_up = true;
        pvx_board_write(&life->health, &cap_health_unknown, sizeof cap_health_unknown);
    }
    pvx_bell_ring(&cam->cap->work);
}

#define LOST cap_count_defs[CAP_LOST_CAMERA].name

static void trouble(struct watch *w, const char *text)
{
    struct cap_camera *cam = w->cam;
    char error[PVX_BOARD_BYTES];
    snprintf(error, sizeof error, "%s", text);
    pvx_board_write(&cam->life.error, error, sizeof error);
    w->error = true;
    /* Log one line until the camera is back; before its first run, one line per reason. */
    if (w->said[0] != '\0' && (w->ran || strncmp(w->said, text, sizeof w->said - 1) == 0))
        return;
    snprintf(w->said, sizeof w->said, "%s", text);
    char who[CAP_DETAIL_MAX * 2];
    int n = snprintf(who, sizeof who, "camera %s (%s): ", cam->name, cam->uri);
    bool named =
        n < (int)sizeof who && strncmp(text, who, (size_t)n) == 0; /* in the driver's own text */
    bool held = cam->cap->cfg.sets.policy == CAP_POLICY_DROP;
    LOG_ABOUT(PVX_LOG_WARN, CAPTURE, ABOUT(.cause = LOST, .camera = cam->name),
              "%s%s; trying again every 0.25 to 0.5 s, %s", named ? "" : who, text,
              held ? "no set is whole until it is back (sync.policy: drop)" : "the others go on");
}

static bool all_looked_at(const struct cap_capture *cap)
{
    for (uint32_t i = 0; i < cap->n; i++)
        if (cap->camera[i].ops->recorded && !cap->camera[i].life.looked)
            return false;
    return true;
}

/* Recorded cameras start together.  Each must know the length of the longest one, and none may be in its second turn
 * when another starts. */
static void wait_for_recorded(struct cap_camera *cam)
{
    struct cap_capture *cap = cam->cap;
    if (!cam->ops->recorded)
        return;
    cam->life.looked = true;
    for (uint32_t i = 0; i < cap->n; i++)
        pvx_bell_ring(&cap->camera[i].life.wake);
    int64_t until = pvx_now_mono() + TOGETHER_NS;
    while (!cap->stop && !all_looked_at(cap) && pvx_now_mono() < until)
        pvx_bell_wait(&cam->life.wake, until);
}

static pvx_err supervisor_open_source(struct cap_camera *cam, cap_source **src, struct pvx_diag *d)
{
    const struct cap_source_ops *ops = cam->ops;
    pvx_err opened = ops->open(&cam->cfg, src, d);
    cam->cfg.again |= opened == PVX_OK;
    wait_for_recorded(cam);
    cap_intake_restart(cam);
    PVX_TRY(opened);
    struct cap_sink sink = cap_intake_sink(cam);
    pvx_err e = cam->cap->stop ? PVX_ECANCELED : ops->start(*src, &sink, d);
    if (e != PVX_OK)
        ops->close(src);
    return e;
}

/* If frames come again, clear the error and report it. */
static void supervisor_report(struct watch *w)
{
    struct cap_camera *cam = w->cam;
    if (!cap_delivers(cam))
        return;
    if (w->error)
        pvx_board_write(&cam->life.error, "", 1);
    w->error = false;
    if (w->said[0] != '\0')
        LOG_ABOUT(PVX_LOG_INFO, CAPTURE, ABOUT(.cause = LOST, .camera = cam->name),
                  "camera %s (%s): frames come again", cam->name, cam->uri);
    w->said[0] = '\0';
    w->backoff_ns = BACKOFF_MIN_NS;
}

/* Wait until `until`, or until something happens. */
static void doze(struct watch *w, int64_t until)
{
    pvx_bell_wait(&w->cam->life.wake, until);
    int64_t late = pvx_now_mono() - until;
    listen(w);
    if (late > OVERSLEPT_NS) {
        w->any.at_ns += late;
        w->good.at_ns += late;
    }
}

/* Whether this run is over.  A camera whose frames are all bad is not lost; sets only no longer wait for it. */
static bool over(struct watch *w, int64_t now, enum fate *fate, char *why, size_t size)
{
    struct cap_camera *cam = w->cam;
    *fate = FATE_LOST;
    if (cam->cap->stop) {
        *fate = FATE_STOP;
        return true;
    }
    if (cam->intake.ended) {
        *fate = FATE_END;
        return true;
    }
    if (cam->intake.lost) {
        snprintf(why, size, "connection lost; look at its cable and power");
        return true;
    }
    if (cam->cap->cfg.lossless || cam->ops->recorded)
        return false;
    /* read before the time of the last good frame, so that a frame in between does not look like silence */
    uint64_t received = cam->count[CAP_RECEIVED];
    bool delivers = received != cam->life.silent_at;
    listen(w);
    int64_t quiet = cam->quiet_ns;
    if (received == 0 || !delivers)
        quiet = quiet > FIRST_FRAME_NS ? quiet : FIRST_FRAME_NS;
    bool there = w->answered_ns > w->any.at_ns;
    if (there && now - w->any.at_ns > quiet && w->no_trigger_of != w->any.said_ns) {
        w->no_trigger_of = w->any.said_ns;
        cam->count[CAP_NO_TRIGGER]++;
    }
    if (now - (there ? w->answered_ns : w->any.at_ns) > quiet) {
        snprintf(why, size, "no frame for %.1f s; look at its cable and power%s",
                 (double)quiet * 1e-9,
                 cam->cfg.trigger != CAP_TRIGGER_FREE_RUN ? ", and at its trigger" : "");
        return true;
    }
    if (delivers && now - w->good.at_ns > cam->quiet_ns) {
        cam->life.silent_at = received;
        pvx_bell_ring(&cam->cap->work);
    }
    return false;
}

/* A camera that waits for pulses on a cable is not lost while it answers.  It is asked early enough that a dead
 * camera is found no later than without the question. */
static void ask_silent(struct watch *w, cap_source *src, int64_t *next)
{
    struct cap_camera *cam = w->cam;
    int64_t now = pvx_now_mono();
    if (cam->cfg.trigger != CAP_TRIGGER_LINE || cam->ops->answers == NULL || now < *next)
        return;
    listen(w);
    if (now - w->any.at_ns <= cam->quiet_ns / 3)
        return;
    *next = now + cam->quiet_ns / 3;
    if (cam->ops->answers(src))
        w->answered_ns = pvx_now_mono();
}

static void read_health(struct cap_camera *cam, cap_source *src)
{
    struct cap_health h = cap_health_unknown;
    if (cam->ops->health == NULL)
        return;
    cam->ops->health(src, &h);
    pvx_board_write(&cam->life.health, &h, sizeof h);
}

static enum fate supervisor_watch(struct watch *w, cap_source *src)
{
    struct cap_camera *cam = w->cam;
    bool triggers = cam->cfg.trigger == CAP_TRIGGER_SOFTWARE && cam->ops->trigger != NULL;
    int64_t period = cam->cap->period_ns;
    int64_t next = triggers ? (pvx_now_mono() / period + 1) * period : INT64_MAX;
    char why[128] = "";
    enum fate fate;
    int64_t health = 0, ask = 0;
    w->answered_ns = w->no_trigger_of = 0;
    for (;;) {
        ask_silent(w, src, &ask);
        if (pvx_now_mono() >= health) {
            read_health(cam, src);
            health = pvx_now_mono() + HEALTH_NS;
        }
        int64_t now = pvx_now_mono();
        int64_t until = now + LOOK_NS < next ? now + LOOK_NS : next;
        if (!over(w, now, &fate, why, sizeof why) && now < until) {
            doze(w, until);
            now = pvx_now_mono();
        }
        bool ends = over(w, now, &fate, why, sizeof why);
        supervisor_report(w);
        if (ends)
            break;
        if (now >= next) {
            pvx_err e = cam->ops->trigger(src);
            if (e != PVX_OK)
                LOG_ABOUT(PVX_LOG_WARN, CAPTURE,
                          ABOUT(.cause = "software_trigger", .camera = cam->name),
                          "camera %s (%s): software trigger failed: %s", cam->name, cam->uri,
                          pvx_strerror(e));
            /* all cameras share the grid; points that have passed are left out */
            next = (pvx_now_mono() / period + 1) * period;
        }
    }
    if (fate == FATE_LOST) {
        cam->count[CAP_LOST_CAMERA]++;
        trouble(w, why);
    }
    return fate;
}

static void back_off(struct watch *w)
{
    struct cap_camera *cam = w->cam;
    int64_t until = pvx_now_mono() + w->backoff_ns;
    while (!cam->cap->stop && pvx_now_mono() < until)
        pvx_bell_wait(&cam->life.wake, until);
    w->backoff_ns = w->backoff_ns * 2 < BACKOFF_MAX_NS ? w->backoff_ns * 2 : BACKOFF_MAX_NS;
}

static void supervisor_live(struct cap_camera *cam)
{
    struct watch w = {.cam = cam, .backoff_ns = BACKOFF_MIN_NS};
    while (!cam->cap->stop) {
        struct pvx_diag d = {""};
        cap_source *src = NULL;
        pvx_err e = supervisor_open_source(cam, &src, &d);
        if (e == PVX_ECANCELED)
            return;
        if (e != PVX_OK) {
            trouble(&w, pvx_diag_text(&d, e));
            set_state(cam, w.ran ? CAP_LOST : CAP_OPENING);
        } else {
            if (!w.ran)
                LOG_I(CAPTURE, "camera %s (%s): running", cam->name, cam->uri);
            w.ran = true;
            set_state(cam, CAP_RUNNING);
            enum fate fate = supervisor_watch(&w, src);
            if (fate == FATE_LOST) /* shown now, however long the driver takes to stop */
                set_state(cam, CAP_LOST);
            cam->ops->stop(src);
            cam->ops->close(&src);
            set_state(cam, fate == FATE_LOST ? CAP_LOST : CAP_ENDED);
            if (fate != FATE_LOST)
                return;
        }
        back_off(&w);
    }
}

void *cap_supervise(void *arg)
{
    struct cap_camera *cam = arg;
    struct cap_capture *cap = cam->cap;
    supervisor_live(cam);
    cam->life.done = true;
    pvx_bell_ring(&cap->home);
    cap_capture_unref(cap);
    return NULL;
}
