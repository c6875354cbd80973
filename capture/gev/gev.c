/* gev.c - aravis: GigE Vision and USB3 Vision cameras.
 *
 * find.c finds a camera.  setup.c applies the settings (with trigger.c, ptp.c and chunk.c).  stream.c receives
 * frames.  watch.c is the slow loop.  gev.h lists threads and locks.
 *
 * We do not wait for a camera that has gone silent: Aravis asks for seconds at each access and when it gives up the
 * device.  Stop asks the camera once by itself.  Without an answer, a thread of its own gives up the device, so that
 * the camera can be opened again as soon as it is back.
 *
 * USB3 Vision cameras use the same code through Aravis.  Not tested: no such camera was available. */
#include <malloc.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/mem.h"
#include "capture/gev/err.h"
#include "capture/gev/find.h"
#include "capture/gev/gev.h"
#include "capture/gev/last.h"
#include "capture/source/backends.h"

#define RELEASE_NS (1500 * PVX_NS_PER_MS)
#define LOOK_NS    (50 * PVX_NS_PER_MS)

/* ---- end -------------------------------------------------------------------------------------- */

static void free_source(struct aravis_source *s)
{
    pthread_mutex_destroy(&s->device);
    cap_gate_fini(&s->gate);
    pthread_mutex_destroy(&s->lock);
    pthread_cond_destroy(&s->wake);
    free(s->uri);
    free(s->name);
    free(s);
}

static atomic_uint giving_up; /* number of devices that are being released */

static void *gev_give_up(void *source)
{
    struct aravis_source *s = source;
    atomic_fetch_add(&giving_up, 1);
    aravis_watch_join(s);
    aravis_end_stream(s);
    cap_lend_close(&s->lend);        /* lent frames keep its memory */
    aravis_close_camera(&s->camera); /* ends the heartbeat's thread and leaves control */
    aravis_chunks_fini(&s->chunks);
    free_source(s);
    /* A camera's GenICam description is some 30000 small blocks.  What lives longer lies among them, so libc keeps
     * their pages: without this, the free part of the heap grew by 11 KB with every camera that was opened anew. */
    malloc_trim(0);
    atomic_fetch_sub(&giving_up, 1);
    return NULL;
}

/* Whether closing takes long: the camera is silent, or Aravis still holds a reference to its device. */
static bool is_slow_to_close(const struct aravis_source *s)
{
    return s->dead || (s->camera != NULL && !aravis_is_last(arv_camera_get_device(s->camera)));
}

static void aravis_close(cap_source **sp)
{
    struct aravis_source *s = (struct aravis_source *)*sp;
    pthread_t thread;
    if (s == NULL)
        return;
    *sp = NULL;
    if (is_slow_to_close(s) && pthread_create(&thread, NULL, gev_give_up, s) == 0)
        pthread_detach(thread);
    else
        gev_give_up(s);
}

static void aravis_stop(cap_source *base)
{
    struct aravis_source *s = (struct aravis_source *)base;
    if (s->stream == NULL)
        return;
    aravis_watch_quit(s);
    cap_gate_shut(&s->gate);
    s->dead = s->route.camera != 0 && !aravis_probe(s->route.camera, NULL);
    aravis_cut_stream(s);
    if (s->dead)
        return; /* close ends the stream */
    aravis_watch_join(s);
    if (!cap_gate_is_lost(&s->gate))
        arv_camera_stop_acquisition(s->camera, NULL);
    aravis_end_stream(s);
}

/* ---- begin ------------------------------------------------------------------------------------ */

static void init_locks(struct aravis_source *s)
{
    pthread_mutex_init(&s->device, NULL);
    pthread_mutex_init(&s->lock, NULL);
    pvx_cond_init(&s->wake, CLOCK_MONOTONIC);
    cap_gate_init(&s->gate);
}

/* A camera that lost its connection but not its power still belongs to our old device, which is being released and
 * asks the camera every 0.5 s to let it go.  So an open that finds the camera busy tries again for RELEASE_NS. */
static pvx_err open_in_time(struct aravis_source *s, struct pvx_diag *d)
{
    for (int64_t until = pvx_now_mono() + RELEASE_NS;;) {
        struct pvx_diag why = {""};
        pvx_err e = aravis_open_camera(&s->c, &s->camera, &s->route, &why);
        if (e == PVX_EBUSY && atomic_load(&giving_up) > 0 && pvx_now_mono() < until) {
            pvx_sleep_until_mono(pvx_now_mono() + LOOK_NS);
            continue;
        }
        return e == PVX_OK ? e : pvx_fail(d, e, "%s", pvx_diag_text(&why, e));
    }
}

static pvx_err gev_set_up(struct aravis_source *s, struct pvx_diag *d)
{
    PVX_TRY(open_in_time(s, d));
    PVX_TRY(aravis_configure(&s->c, s->camera, &s->layout, &s->chunks, d));
    return aravis_make_buffers(s);
}

static pvx_err aravis_open(const struct cap_source_config *c, cap_source **out, struct pvx_diag *d)
{
    *out = NULL;
    struct aravis_source *s = pvx_calloc(1, sizeof *s);
    PVX_NEED(s);
    s->base.ops = &cap_source_aravis;
    init_locks(s);
    s->c = *c;
    s->c.uri = s->uri = strdup(c->uri);
    s->c.name = s->name = strdup(c->name != NULL ? c->name : "?");
    pvx_err e = s->uri == NULL || s->name == NULL ? PVX_ENOMEM : gev_set_up(s, d);
    s->c.features = NULL; /* borrowed for the call */
    s->c.n_features = 0;
    s->c.trigger_line = NULL;
    cap_source *base = &s->base;
    if (e != PVX_OK) {
        s->dead = s->route.camera != 0 && !aravis_probe(s->route.camera, NULL);
        aravis_close(&base);
        return e;
    }
    s->resend = arv_camera_is_gv_device(s->camera) && aravis_wants_resend(&s->c, s->camera);
    const char *serial = arv_camera_get_device_serial_number(s->camera, NULL);
    if (serial != NULL && strlen(serial) < sizeof s->serial)
        snprintf(s->serial, sizeof s->serial, "%s", serial);
    *out = base;
    return PVX_OK;
}

static pvx_err aravis_start(cap_source *base, const struct cap_sink *sink, struct pvx_diag *d)
{
    struct aravis_source *s = (struct aravis_source *)base;
    GError *err = NULL;
    aravis_watch_join(s);
    aravis_end_stream(s);
    s->sink = *sink;
    s->dead = false;
    PVX_TRY(aravis_begin_stream(s, d));
    cap_gate_open(&s->gate);
    pthread_mutex_lock(&s->device);
    aravis_mode_first(s->camera, &s->mode);
    pthread_mutex_unlock(&s->device);
    arv_camera_start_acquisition(s->camera, &err);
    if (err != NULL) {
        cap_gate_shut(&s->gate);
        aravis_end_stream(s);
        return aravis_fail(&s->c, PVX_EIO, "start of acquisition", &err, d);
    }
    aravis_watch_start(s);
    return PVX_OK;
}

/* ---- while it runs ---------------------------------------------------------------------------- */

static pvx_err aravis_trigger(cap_source *base)
{
    struct aravis_source *s = (struct aravis_source *)base;
    GError *err = NULL;
    if (cap_gate_is_lost(&s->gate))
        return PVX_ENODEV;
    pthread_mutex_lock(&s->device);
    arv_camera_software_trigger(s->camera, &err);
    pthread_mutex_unlock(&s->device);
    if (err == NULL)
        return PVX_OK;
    /* With an answer, even "busy", only one trigger is missed.  Without one, Aravis has asked several times by now,
     * and waiting for the next answer would take as long. */
    bool gone = aravis_means_gone(err);
    g_clear_error(&err);
    if (!gone)
        return PVX_EIO;
    aravis_say_lost(s);
    return PVX_ENODEV;
}

static bool aravis_answers(cap_source *base)
{
    struct aravis_source *s = (struct aravis_source *)base;
    /* The loss of a USB camera has been reported already.  After a restart, no program controls a GigE camera. */
    return !cap_gate_is_lost(&s->gate) &&
           (s->route.camera == 0 ||
            (aravis_probe(s->route.camera, NULL) && aravis_controlled(s->route.camera)));
}

static void aravis_health(cap_source *base, struct cap_health *out)
{
    struct aravis_source *s = (struct aravis_source *)base;
    pthread_mutex_lock(&s->lock);
    *out = s->health;
    pthread_mutex_unlock(&s->lock);
    if (!ARV_IS_GV_STREAM(s->stream))
        return;
    guint64 resent = 0, missing = 0;
    arv_gv_stream_get_statistics(ARV_GV_STREAM(s->stream), &resent, &missing);
    out->packets_resent = resent;
    out->packets_missing = missing;
}

const struct cap_source_ops cap_source_aravis = {
    .scheme = "aravis",
    .help = "GigE Vision or USB3 Vision camera: IP address, serial number, its name or Aravis' id",
    .open = aravis_open,
    .start = aravis_start,
    .trigger = aravis_trigger,
    .triggers = true,
    .answers = aravis_answers,
    .health = aravis_health,
    .stop = aravis_stop,
    .close = aravis_close,
    .list = aravis_list,
};
