/* watch.c - the slow loop of a running camera (gev.h).  Every 0.4 s it checks that we still control the camera, and
 * that its trigger mode is the one that was set.  Every 2 s it reads the camera's clock, temperature and PTP state,
 * and the number of packets that were requested again.
 *
 * The clock: the camera latches it on command (TimestampLatch, GevTimestampControlLatch), between the command and
 * its answer, which gives the bound.  The best of three readings counts.
 * Loss of PTP while the camera runs is logged once, and its return once. */
#include <math.h>
#include <sched.h>
#include <stdio.h>
#include <string.h>

#include "base/clock.h"
#include "base/log.h"
#include "capture/gev/err.h"
#include "capture/gev/feature.h"
#include "capture/gev/gev.h"
#include "capture/gev/ptp.h"
#include "capture/gev/ticks.h"

#define MODE_NS (400 * PVX_NS_PER_MS)
#define ROUND   5 /* everything is read in each fifth round of MODE_NS */
#define LATCHES 3

/* ---- reading each value ----------------------------------------------------------------------- */

static bool latch_once(struct aravis_source *s, const char *latch, const char *value, guint64 hz,
                       struct cap_health *h)
{
    GError *err = NULL;
    pthread_mutex_lock(&s->device);
    int64_t before = pvx_now_mono();
    arv_camera_execute_command(s->camera, latch, &err);
    int64_t after = pvx_now_mono();
    gint64 ticks = err == NULL ? arv_camera_get_integer(s->camera, value, &err) : 0;
    pthread_mutex_unlock(&s->device);
    bool ok = err == NULL && ticks != 0;
    g_clear_error(&err);
    if (ok && (h->clock.bound_ns < 0 || (after - before) / 2 < h->clock.bound_ns)) {
        h->clock.device_ns = aravis_ticks_to_ns((uint64_t)ticks, hz);
        h->clock.host_mono_ns = before + (after - before) / 2;
        h->clock.bound_ns = (after - before) / 2 + 1;
    }
    return ok;
}

static void look_at_clock(struct aravis_source *s, struct cap_health *h)
{
    static const char *const names[][2] = {{"GevTimestampControlLatch", "GevTimestampValue"},
                                           {"TimestampLatch", "TimestampLatchValue"}};
    h->clock.bound_ns = -1;
    for (size_t i = 0; i < 2; i++) {
        pthread_mutex_lock(&s->device);
        bool has = arv_camera_is_feature_available(s->camera, names[i][0], NULL) &&
                   arv_camera_is_feature_available(s->camera, names[i][1], NULL);
        guint64 hz = has ? aravis_tick_hz(s->camera) : 0;
        pthread_mutex_unlock(&s->device);
        if (!has)
            continue;
        for (int k = 0; k < LATCHES && latch_once(s, names[i][0], names[i][1], hz, h); k++)
            ;
        return;
    }
}

/* Release `device` for a moment, so that a software trigger waits for at most one question. */
static void let_others(struct aravis_source *s)
{
    pthread_mutex_unlock(&s->device);
    sched_yield();
    pthread_mutex_lock(&s->device);
}

static void look_at_device(struct aravis_source *s, struct cap_health *h)
{
    GError *err = NULL;
    struct aravis_ptp ptp;
    h->temperature_c = h->link_mbps = NAN;
    pthread_mutex_lock(&s->device);
    const char *temperature =
        aravis_has(s->camera, "DeviceTemperature") ? "DeviceTemperature" : "TemperatureAbs";
    if (aravis_has(s->camera, temperature)) {
        h->temperature_c = arv_camera_get_float(s->camera, temperature, &err);
        if (err != NULL)
            h->temperature_c = NAN;
        g_clear_error(&err);
    }
    let_others(s);
    guint32 mbps = 0;
    if (s->route.camera != 0 &&
        arv_device_read_register(arv_camera_get_device(s->camera), 0x670 /* link speed */, &mbps,
                                 NULL) &&
        mbps > 0)
        h->link_mbps = mbps;
    let_others(s);
    aravis_ptp_read(s->camera, &ptp);
    pthread_mutex_unlock(&s->device);
    memcpy(h->ptp, ptp.state, sizeof h->ptp);
    h->ptp_offset_ns = ptp.offset_ns;
}

/* Another program may have changed the trigger mode.  It is set again.  A camera that cannot do that while it takes
 * frames is opened again. */
static void look_at_mode(struct aravis_source *s)
{
    char is[CAP_DETAIL_MAX] = "", text[CAP_DETAIL_MAX];
    pthread_mutex_lock(&s->device);
    bool good = aravis_mode_is(s->camera, &s->mode, is, sizeof is);
    bool again = good || aravis_mode_again(s->camera, &s->mode);
    pthread_mutex_unlock(&s->device);
    if (good)
        return;
    snprintf(text, sizeof text, "%.70s; %s", is,
             again ? "it was set again" : "it cannot be set now: opened again");
    if (cap_gate_enter(&s->gate)) {
        if (s->sink.detail != NULL)
            s->sink.detail(s->sink.ctx, s->c.camera, CAP_TRIGGER_MODE, text);
        s->sink.count(s->sink.ctx, s->c.camera, CAP_TRIGGER_MODE, 1);
        cap_gate_leave(&s->gate);
    }
    if (!again)
        aravis_say_lost(s);
}

/* Whether we still control the camera.  This replaces Aravis' signal "control-lost" (last.h). */
static bool watch_is_ours(struct aravis_source *s)
{
    ArvDevice *device = arv_camera_get_device(s->camera);
    if (ARV_IS_GV_DEVICE(device))
        return arv_gv_device_is_controller(ARV_GV_DEVICE(device));
    GError *err = NULL;
    pthread_mutex_lock(&s->device);
    arv_camera_get_payload(s->camera, &err);
    pthread_mutex_unlock(&s->device);
    bool ours = err == NULL || !aravis_means_gone(err);
    g_clear_error(&err);
    return ours;
}

static void watch_ptp(const struct aravis_source *s, const struct cap_health *h, bool *bad)
{
    struct aravis_ptp p = {.offset_ns = h->ptp_offset_ns};
    memcpy(p.state, h->ptp, sizeof p.state);
    bool good = aravis_ptp_good(&p, s->c.ptp_offset_us);
    if (!s->c.ptp || good != *bad)
        return;
    *bad = !good;
    if (good)
        CAP_LOG(PVX_LOG_INFO, &s->c, "aravis", "ptp", "its clock is synchronized again");
    else
        CAP_LOG(PVX_LOG_WARN, &s->c, "aravis", "ptp",
                "its clock is no longer synchronized: PTP says %s, offset %.3g "
                "us; its exposures drift away from the others'",
                p.state[0] != '\0' ? p.state : "nothing", p.offset_ns * 1e-3);
}

static void tell_unread_chunks(struct aravis_source *s, bool *told)
{
    if (*told || !atomic_load(&s->chunks.unread))
        return;
    *told = true;
    CAP_LOG(PVX_LOG_WARN, &s->c, "aravis", "chunks",
            "its chunk data are of a kind that Aravis does not read (payload "
            "type 5, GigE Vision 1.2): exposure and gain of its frames stay unknown%s",
            s->c.lines ? ", and triggers with when: line do not fire" : "");
}

/* ---- the loop --------------------------------------------------------------------------------- */

static bool quits(struct aravis_source *s)
{
    pthread_mutex_lock(&s->lock);
    bool q = s->quit;
    pthread_mutex_unlock(&s->lock);
    return q;
}

static void gev_watch_look(struct aravis_source *s, struct cap_health *h, bool *bad_ptp)
{
    look_at_clock(s, h);
    if (!quits(s))
        look_at_device(s, h);
    if (quits(s))
        return;
    if (h->clock.bound_ns >= 0 && s->sink.clock != NULL && cap_gate_enter(&s->gate)) {
        s->sink.clock(s->sink.ctx, s->c.camera, h->clock.device_ns, h->clock.host_mono_ns,
                      h->clock.bound_ns);
        cap_gate_leave(&s->gate);
    }
    watch_ptp(s, h, bad_ptp);
    pthread_mutex_lock(&s->lock);
    s->health = *h;
    pthread_mutex_unlock(&s->lock);
}

static struct cap_health known_at_once(const struct aravis_source *s)
{
    struct cap_health h = cap_health_unknown;
    h.address = s->route.camera;
    h.broadcast = s->route.broadcast;
    memcpy(h.serial, s->serial, sizeof h.serial);
    return h;
}

static void *gev_watch(void *arg)
{
    struct aravis_source *s = arg;
    bool bad_ptp = false, told = false;
    struct cap_health h = known_at_once(s);
    for (unsigned round = 0; !quits(s); round++) {
        /* Aravis would ask a camera that is gone for seconds, while other threads wait for its features. */
        bool there = s->route.camera == 0 || aravis_probe(s->route.camera, NULL);
        if (!watch_is_ours(s))
            aravis_say_lost(s);
        if (there)
            look_at_mode(s);
        if (there && round % ROUND == 0 && !quits(s))
            gev_watch_look(s, &h, &bad_ptp);
        tell_unread_chunks(s, &told);
        int64_t until = pvx_now_mono() + MODE_NS;
        struct timespec ts = {.tv_sec = until / PVX_NS_PER_S, .tv_nsec = until % PVX_NS_PER_S};
        pthread_mutex_lock(&s->lock);
        while (!s->quit && pvx_now_mono() < until)
            pthread_cond_timedwait(&s->wake, &s->lock, &ts);
        pthread_mutex_unlock(&s->lock);
    }
    return NULL;
}

void aravis_watch_start(struct aravis_source *s)
{
    pthread_mutex_lock(&s->lock);
    s->quit = false;
    s->health = known_at_once(s);
    pthread_mutex_unlock(&s->lock);
    if (pthread_create(&s->watch, NULL, gev_watch, s) != 0) {
        CAP_LOG(PVX_LOG_WARN, &s->c, "aravis", "unwatched", "no thread to watch its clock with");
        return;
    }
    s->watching = true;
    pthread_setname_np(s->watch, "camwatch");
}

void aravis_watch_quit(struct aravis_source *s)
{
    pthread_mutex_lock(&s->lock);
    s->quit = true;
    pthread_cond_broadcast(&s->wake);
    pthread_mutex_unlock(&s->lock);
}

void aravis_watch_join(struct aravis_source *s)
{
    if (s->watching)
        pthread_join(s->watch, NULL);
    s->watching = false;
}
