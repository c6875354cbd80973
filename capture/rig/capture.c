#include "capture/rig/capture.h"

#include <stdio.h>
#include <stdlib.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "capture/rig/capture_int.h"
#include "capture/rig/trigger.h"

#define STUCK_NS (3 * PVX_NS_PER_S)

pvx_err cap_capture_new(const struct cap_capture_config *c, cap_capture **out, struct pvx_diag *d)
{
    *out = NULL;
    if (c->n_cameras < 1 || c->n_cameras > CAP_MAX_CAMERAS)
        return pvx_fail(d, PVX_EINVAL, "%u cameras; 1 to %d are possible", c->n_cameras,
                        CAP_MAX_CAMERAS);
    struct cap_capture *cap = pvx_calloc(1, sizeof *cap);
    PVX_NEED(cap);
    cap->camera = pvx_calloc(c->n_cameras, sizeof *cap->camera);
    if (cap->camera == NULL) {
        free(cap);
        return PVX_ENOMEM;
    }
    cap->cfg = *c;
    cap->n = c->n_cameras;
    cap->refs = 1;
    pthread_mutex_init(&cap->stopping, NULL);
    pthread_mutex_init(&cap->figures, NULL);
    pvx_bell_init(&cap->work);
    pvx_bell_init(&cap->home);
    pvx_bell_init(&cap->ending);
    for (uint32_t i = 0; i < cap->n; i++) {
        struct cap_camera *cam = &cap->camera[i];
        cam->cap = cap;
        cam->index = i;
        pvx_bell_init(&cam->life.wake);
        pvx_bell_init(&cam->intake.room);
        pthread_mutex_init(&cam->readings.lock, NULL);
    }
    pvx_err e = cap_set_up(cap, d);
    cap->cfg.camera = NULL; /* borrowed for set-up only */
    if (e != PVX_OK)
        cap_capture_free(&cap);
    *out = cap;
    return e;
}

static pvx_err capture_run(struct cap_capture *cap, pthread_t *thread, bool *started,
                           void *(*body)(void *), const char *name)
{
    *started = pthread_create(thread, NULL, body, cap) == 0;
    if (*started)
        pthread_setname_np(*thread, name);
    return *started ? PVX_OK : PVX_EIO;
}

static pvx_err run_supervisor(struct cap_camera *cam)
{
    char name[16];
    snprintf(name, sizeof name, "cap%u", cam->index);
    cam->cap->refs++;
    cam->life.started = pthread_create(&cam->life.thread, NULL, cap_supervise, cam) == 0;
    if (cam->life.started)
        pthread_setname_np(cam->life.thread, name);
    else
        cap_capture_unref(cam->cap);
    return cam->life.started ? PVX_OK : PVX_EIO;
}

pvx_err cap_capture_start(cap_capture *cap, struct pvx_diag *d)
{
    if (cap->started)
        return pvx_fail(d, PVX_EINVAL, "capture has been started before");
    cap->started = true;
    cap->started_mono_ns = pvx_now_mono();
    pvx_err e =
        capture_run(cap, &cap->assembler_thread, &cap->assembler_started, cap_assemble, "assemble");
    PVX_THEN(e,
             capture_run(cap, &cap->monitor_thread, &cap->monitor_started, cap_monitor, "monitor"));
    if (e == PVX_OK && cap->cfg.trigger == CAP_TRIGGER_ACTION)
        e = capture_run(cap, &cap->trigger_thread, &cap->trigger_started, cap_trigger_run,
                        "trigger");
    for (uint32_t i = 0; i < cap->n && e == PVX_OK; i++)
        e = run_supervisor(&cap->camera[i]);
    if (e == PVX_OK)
        return PVX_OK;
    cap_capture_stop(cap);
    return pvx_fail(d, e, "cannot start the threads of the capture");
}

pvx_err cap_capture_next(cap_capture *cap, int64_t timeout_ns, struct cap_set **out)
{
    void *item;
    pvx_err e = pvx_queue_pop(cap->out, timeout_ns, &item);
    *out = item;
    return e;
}

/* Join the supervisors that end in time, and leave the others behind. */
static void end_supervisors(struct cap_capture *cap)
{
    int64_t until = pvx_now_mono() + STUCK_NS;
    for (uint32_t i = 0; i < cap->n; i++) {
        struct cap_camera *cam = &cap->camera[i];
        if (!cam->life.started)
            continue;
        while (!cam->life.done && pvx_now_mono() < until)
            pvx_bell_wait(&cap->home, until);
        if (cam->life.done) {
            pthread_join(cam->life.thread, NULL);
        } else {
            LOG_W(CAPTURE, "camera %s (%s): its driver does not return; left behind", cam->name,
                  cam->uri);
            pthread_detach(cam->life.thread);
        }
    }
}

static void stop_all(struct cap_capture *cap)
{
    cap->stop = true;
    for (uint32_t i = 0; i < cap->n; i++) {
        pvx_bell_ring(&cap->camera[i].life.wake);
        pvx_bell_ring(&cap->camera[i].intake.room);
    }
    pvx_bell_ring(&cap->work);
    pvx_bell_ring(&cap->ending);
    if (cap->out != NULL)
        pvx_queue_close(cap->out);
    if (cap->trigger_started)
        pthread_join(cap->trigger_thread, NULL);
    end_supervisors(cap);
    if (cap->assembler_started)
        pthread_join(cap->assembler_thread, NULL);
    if (cap->monitor_started)
        pthread_join(cap->monitor_thread, NULL);
    cap_assemble_nothing(cap);
}

void cap_capture_stop(cap_capture *cap)
{
    pthread_mutex_lock(&cap->stopping); /* the second caller waits for the first */
    if (!cap->stop)
        stop_all(cap);
    pthread_mutex_unlock(&cap->stopping);
}

void cap_capture_free(cap_capture **cp)
{
    cap_capture *cap = *cp;
    if (cap == NULL)
        return;
    *cp = NULL;
    cap_capture_stop(cap);
    void *s;
    while (cap->out != NULL && pvx_queue_pop(cap->out, 0, &s) == PVX_OK)
        cap_set_release(s);
    pvx_queue_free(&cap->out);
    cap_assembler_free(&cap->assembler);
    cap_capture_unref(cap);
}
