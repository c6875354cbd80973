/* supervisor.c - one camera's life: open, start, trigger, watch, close, again. */
#include <stdio.h>
#include <string.h>

#include "base/clock.h"
#include "base/log.h"
#include "capture/capture_int.h"

#define BACKOFF_MIN_NS (250 * PVX_NS_PER_MS)
#define BACKOFF_MAX_NS (500 * PVX_NS_PER_MS)
#define FIRST_FRAME_NS (3 * PVX_NS_PER_S)  /* patience with a camera that has just been started */
#define TOGETHER_NS    (10 * PVX_NS_PER_S) /* what recorded cameras wait for one that hangs */
#define LOOK_NS        (100 * PVX_NS_PER_MS)
#define OVERSLEPT_NS   (50 * PVX_NS_PER_MS)
#define HEALTH_NS      PVX_NS_PER_S

enum fate { FATE_STOP, FATE_LOST, FATE_END };

/* State between two frames that came in order; what has been said is not said again. */
struct watch {
    struct cap_camera *cam;
    char said[256]; /* last trouble that was logged, "" after frames came */
    int64_t backoff_ns;
    bool ran; /* it has been started before */
};

static bool stopped(struct cap_capture *cap)
{
    pthread_mutex_lock(&cap->lock);
    bool s = cap->stop;
    pthread_mutex_unlock(&cap->lock);
    return s;
}

static void set_state(struct cap_camera *cam, enum cap_state state)
{
    pthread_mutex_lock(&cam->cap->lock);
    cam->state = state;
    cam->tried = true;
    if (state != CAP_RUNNING) {
        cam->delivering = false;
        cam->given_up = true;
        cam->health = cap_health_unknown;
    }
    pthread_cond_signal(&cam->cap->work);
    pthread_mutex_unlock(&cam->cap->lock);
}

static void trouble(struct watch *w, const char *text)
{
    struct cap_camera *cam = w->cam;
    pthread_mutex_lock(&cam->cap->lock);
    snprintf(cam->error, sizeof cam->error, "%s", text);
    pthread_mutex_unlock(&cam->cap->lock);
    /* One line until it is back; before it ever ran, one per reason. */
    if (w->said[0] != '\0' && (w->ran || strncmp(w->said, text, sizeof w->said - 1) == 0))
        return;
    snprintf(w->said, sizeof w->said, "%s", text);
    char who[CAP_DETAIL_MAX * 2];
    int n = snprintf(who, sizeof who, "camera %s (%s): ", cam->name, cam->uri);
    bool named =
        n < (int)sizeof who && strncmp(text, who, (size_t)n) == 0; /* a driver's own words */
    bool held = cam->cap->cfg.sets.policy == CAP_POLICY_DROP;
    LOG_W(CAPTURE, "%s%s; trying again every 0.25 to 0.5 s, %s", named ? "" : who, text,
          held ? "no set is whole until it is back (sync.policy: drop)" : "the others go on");
}

static bool all_looked_at(const struct cap_capture *cap)
{
    for (uint32_t i = 0; i < cap->n; i++)
        if (cap->camera[i].ops->recorded && !cap->camera[i].looked)
            return false;
    return true;
}

/* Recorded cameras start together: each must know how long the longest is, and none may be in its
 * second turn when another comes.  Under the lock. */
static void wait_for_recorded(struct cap_camera *cam)
{
    struct cap_capture *cap = cam->cap;
    if (!cam->ops->recorded)
        return;
    if (!cam->looked) {
        cam->looked = true;
        for (uint32_t i = 0; i < cap->n; i++)
            pthread_cond_signal(&cap->camera[i].wake);
    }
    int64_t until = pvx_now_mono() + TOGETHER_NS;
    while (!cap->stop && !all_looked_at(cap) && pvx_now_mono() < until)
        cap_wait_until(&cam->wake, &cap->lock, until);
}

static pvx_err open_source(struct cap_camera *cam, cap_source **src, struct pvx_diag *d)
{
    const struct cap_source_ops *ops = cam->ops;
    pvx_err opened = ops->open(&cam->cfg, src, d);
    pthread_mutex_lock(&cam->cap->lock);
    wait_for_recorded(cam);
    cap_intake_restart(cam);
    bool stop = cam->cap->stop;
    pthread_mutex_unlock(&cam->cap->lock);
    PVX_TRY(opened);
    struct cap_sink sink = cap_intake_sink(cam);
    pvx_err e = stop ? PVX_ECANCELED : ops->start(*src, &sink, d);
    if (e != PVX_OK)
        ops->close(src);
    return e;
}

/* Frames come again?  Called without the lock, now and then. */
static void report(struct watch *w)
{
    struct cap_camera *cam = w->cam;
    pthread_mutex_lock(&cam->cap->lock);
    bool delivering = cam->delivering;
    pthread_mutex_unlock(&cam->cap->lock);
    if (delivering && w->said[0] != '\0') {
        LOG_I(CAPTURE, "camera %s (%s): frames come again", cam->name, cam->uri);
        w->said[0] = '\0';
    }
    if (delivering)
        w->backoff_ns = BACKOFF_MIN_NS;
}

/* Wait until `until`.  Time in which this thread should have run and was not let is no silence of the
 * camera's: its frames were not let in either.  Under the lock. */
static void doze(struct cap_camera *cam, int64_t until)
{
    cap_wait_until(&cam->wake, &cam->cap->lock, until);
    int64_t late = pvx_now_mono() - until;
    if (late > OVERSLEPT_NS) {
        cam->last_any_mono_ns += late;
        cam->last_good_mono_ns += late;
    }
}

/* Under the lock: is it over?  A camera whose frames come but are all bad is not lost, only no
 * longer waited for. */
static bool over(struct watch *w, int64_t now, enum fate *fate, char *why, size_t size)
{
    struct cap_camera *cam = w->cam;
    *fate = FATE_LOST;
    if (cam->cap->stop) {
        *fate = FATE_STOP;
        return true;
    }
    if (cam->ev_end) {
        *fate = FATE_END;
        return true;
    }
    if (cam->ev_lost) {
        snprintf(why, size, "connection lost; look at its cable and power");
        return true;
    }
    if (cam->cap->cfg.lossless || cam->ops->recorded)
        return false;
    int64_t quiet = cam->quiet_ns;
    if (cam->count[CAP_RECEIVED] == 0 || !cam->delivering)
        quiet = quiet > FIRST_FRAME_NS ? quiet : FIRST_FRAME_NS;
    bool there = cam->answered_mono_ns > cam->last_any_mono_ns;
    if (there && now - cam->last_any_mono_ns > quiet && !cam->no_trigger) {
        cam->no_trigger = true;
        cam->count[CAP_NO_TRIGGER]++;
    }
    if (now - (there ? cam->answered_mono_ns : cam->last_any_mono_ns) > quiet) {
        snprintf(why, size, "no frame for %.1f s; look at its cable, power and trigger",
                 (double)quiet * 1e-9);
        return true;
    }
    if (cam->delivering && now - cam->last_good_mono_ns > cam->quiet_ns) {
        cam->delivering = false;
        pthread_cond_signal(&cam->cap->work);
    }
    return false;
}

/* A camera that waits for pulses on a cable is not lost while it answers.  Asked early enough that a
 * dead one is found no later. */
static void ask_silent(struct cap_camera *cam, cap_source *src, int64_t *next)
{
    int64_t now = pvx_now_mono();
    if (cam->cfg.trigger != CAP_TRIGGER_LINE || cam->ops->answers == NULL || now < *next)
        return;
    pthread_mutex_lock(&cam->cap->lock);
    bool silent = now - cam->last_any_mono_ns > cam->quiet_ns / 3;
    pthread_mutex_unlock(&cam->cap->lock);
    if (!silent)
        return;
    *next = now + cam->quiet_ns / 3;
    if (!cam->ops->answers(src))
        return;
    pthread_mutex_lock(&cam->cap->lock);
    cam->answered_mono_ns = pvx_now_mono();
    pthread_mutex_unlock(&cam->cap->lock);
}

static void take_health(struct cap_camera *cam, cap_source *src)
{
    struct cap_health h = cap_health_unknown;
    if (cam->ops->health == NULL)
        return;
    cam->ops->health(src, &h);
    pthread_mutex_lock(&cam->cap->lock);
    cam->health = h;
    pthread_mutex_unlock(&cam->cap->lock);
}

static enum fate watch(struct watch *w, cap_source *src)
{
    struct cap_camera *cam = w->cam;
    struct cap_capture *cap = cam->cap;
    bool triggers = cam->cfg.trigger == CAP_TRIGGER_SOFTWARE && cam->ops->trigger != NULL;
    int64_t period = cap->period_ns;
    int64_t next = triggers ? (pvx_now_mono() / period + 1) * period : INT64_MAX;
    char why[128] = "";
    enum fate fate;
    int64_t health = 0, ask = 0;
    for (;;) {
        ask_silent(cam, src, &ask);
        if (pvx_now_mono() >= health) {
            take_health(cam, src);
            health = pvx_now_mono() + HEALTH_NS;
        }
        pthread_mutex_lock(&cap->lock);
        int64_t now = pvx_now_mono();
        int64_t until = now + LOOK_NS < next ? now + LOOK_NS : next;
        if (!over(w, now, &fate, why, sizeof why) && now < until) {
            doze(cam, until);
            now = pvx_now_mono();
        }
        bool ends = over(w, now, &fate, why, sizeof why);
        pthread_mutex_unlock(&cap->lock);
        report(w);
        if (ends)
            break;
        if (now >= next) {
            pvx_err e = cam->ops->trigger(src);
            if (e != PVX_OK)
                LOG_EVERY(PVX_LOG_WARN, CAPTURE, "camera %s (%s): software trigger failed: %s",
                          cam->name, cam->uri, pvx_strerror(e));
            /* the grid is common to all cameras; points that have passed are left out */
            next = (pvx_now_mono() / period + 1) * period;
        }
    }
    if (fate == FATE_LOST) {
        pthread_mutex_lock(&cap->lock);
        cam->count[CAP_LOST_CAMERA]++;
        pthread_mutex_unlock(&cap->lock);
        trouble(w, why);
    }
    return fate;
}

static void back_off(struct watch *w)
{
    struct cap_camera *cam = w->cam;
    int64_t until = pvx_now_mono() + w->backoff_ns;
    pthread_mutex_lock(&cam->cap->lock);
    while (!cam->cap->stop && pvx_now_mono() < until)
        cap_wait_until(&cam->wake, &cam->cap->lock, until);
    pthread_mutex_unlock(&cam->cap->lock);
    w->backoff_ns = w->backoff_ns * 2 < BACKOFF_MAX_NS ? w->backoff_ns * 2 : BACKOFF_MAX_NS;
}

static void live(struct cap_camera *cam)
{
    struct watch w = {.cam = cam, .backoff_ns = BACKOFF_MIN_NS};
    while (!stopped(cam->cap)) {
        struct pvx_diag d = {""};
        cap_source *src = NULL;
        pvx_err e = open_source(cam, &src, &d);
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
            enum fate fate = watch(&w, src);
            if (fate == FATE_LOST) /* known now, whatever the driver still takes to let go */
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
    live(cam);
    pthread_mutex_lock(&cap->lock);
    cam->done = true;
    pthread_cond_broadcast(&cap->changed);
    pthread_mutex_unlock(&cap->lock);
    cap_capture_unref(cap);
    return NULL;
}
