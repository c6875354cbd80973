#include "daemon/pipeline/recording.h"

#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "daemon/pipeline/photometry.h"

#define GB 1e9

struct dmn_recording {
    cap_capture *const *capture;
    pthread_mutex_t lock; /* one start or stop at a time */
    cap_recorder *recorder;
    cap_ring *ring; /* NULL = none */
    char pattern[DMN_WORD_MAX];
    char *rig, *config, *settings[REC_MAX_CAMERAS];
    char base[PATH_MAX], host[256];
    char name[REC_MAX_CAMERAS][REC_NAME_MAX], uri[REC_MAX_CAMERAS][DMN_WORD_MAX];
    struct cap_take_camera camera[REC_MAX_CAMERAS];
    struct cap_take_head head;
};

/* The settings that the camera is asked for, one "name: value" per line. */
static char *settings_text(const struct cap_source_config *s)
{
    static const char *const triggers[] = {"free-run", "software", "line", "action"};
    char *text = NULL;
    size_t len;
    FILE *f = open_memstream(&text, &len);
    if (f == NULL)
        return NULL;
    fprintf(f, "pixel_format: %s\nfps: %.17g\ntrigger: %s\n",
            s->fmt == CAP_FMT_NONE ? "auto" : cap_pixfmt_name(s->fmt), s->fps,
            triggers[s->trigger]);
    if (s->exposure_us >= 0)
        fprintf(f, "exposure_us: %.17g\n", s->exposure_us);
    if (s->gain >= 0)
        fprintf(f, "gain: %.17g\n", s->gain);
    for (size_t i = 0; i < s->n_features; i++)
        fprintf(f, "features.%s: %s\n", s->features[i].name, s->features[i].value);
    if (fclose(f) != 0)
        PVX_FREE(text);
    return text;
}

/* The rig as text, with absolute map names: its maps lie beside its file, not beside the take. */
static pvx_err describe_rig(dmn_recording *r, const struct dmn_config *c, const struct rec_rig *rig)
{
    struct rec_rig here;
    char path[PATH_MAX];
    size_t len;
    dmn_config_path(c, c->rig, path, sizeof path);
    PVX_TRY(rec_rig_copy(rig, &here));
    pvx_err e = dmn_photometry_move(&here, path, NULL, NULL);
    e = rec_rig_format(e == PVX_OK ? &here : rig, &r->rig, &len);
    rec_rig_fini(&here);
    return e;
}

static pvx_err recording_describe(dmn_recording *r, const struct dmn_config *c,
                                  const struct rec_rig *rig, const struct dmn_sources *s,
                                  uint64_t session)
{
    PVX_TRY(describe_rig(r, c, rig));
    r->config = dmn_config_format(c);
    if (r->config == NULL)
        return PVX_ENOMEM;
    if (realpath(c->dir, r->base) == NULL)
        snprintf(r->base, sizeof r->base, "%s", c->dir);
    if (gethostname(r->host, sizeof r->host - 1) != 0)
        r->host[0] = '\0';
    for (size_t i = 0; i < rig->n_cameras; i++) {
        r->settings[i] = settings_text(&s->source[i]);
        if (r->settings[i] == NULL)
            return PVX_ENOMEM;
        snprintf(r->name[i], sizeof r->name[i], "%s", rig->cameras[i].name);
        snprintf(r->uri[i], sizeof r->uri[i], "%s", s->uri[i]);
        r->camera[i] = (struct cap_take_camera){
            .name = r->name[i], .uri = r->uri[i], .settings = r->settings[i]};
    }
    r->head = (struct cap_take_head){.rig = r->rig,
                                     .config = r->config,
                                     .software = "pyrovoxd " PVX_VERSION,
                                     .host = r->host,
                                     .base = r->base,
                                     .session = session,
                                     .fps = c->fps,
                                     .n_cameras = (uint32_t)rig->n_cameras,
                                     .camera = r->camera};
    return PVX_OK;
}

static void recording_health(void *ctx, uint32_t camera, struct cap_health *out)
{
    cap_capture_health(*((dmn_recording *)ctx)->capture, camera, out);
}

#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wformat-nonliteral" /* the user's, for strftime: it cannot harm */
pvx_err dmn_recording_name(const char *key, const char *pattern, const char *base, char *out,
                           size_t size, struct pvx_diag *d)
{
    time_t now = time(NULL);
    struct tm tm;
    char name[1024];
    localtime_r(&now, &tm);
    if (pattern[0] == '\0' || strftime(name, sizeof name, pattern, &tm) == 0)
        return pvx_fail(d, PVX_EINVAL, "%s: '%s' makes no name for a file", key, pattern);
    int n =
        name[0] == '/' ? snprintf(out, size, "%s", name) : snprintf(out, size, "%s/%s", base, name);
    return n < (int)size ? PVX_OK : pvx_fail(d, PVX_ERANGE, "%s: '%s' is too long", key, name);
}
#pragma GCC diagnostic pop

/* file: in, an absolute path; out, `name` in the same folder. */
static pvx_err name_beside(const char *name, char *file, size_t size, struct pvx_diag *d)
{
    char *at = strrchr(file, '/') + 1; /* the name is absolute */
    int n = snprintf(at, size - (size_t)(at - file), "%s", name);
    return n < (int)(size - (size_t)(at - file))
               ? PVX_OK
               : pvx_fail(d, PVX_ERANGE, "'%s' is too long for a file's name", name);
}

/* name: a path (with a slash), or a name for the folder of record.path; NULL: record.path. */
static pvx_err recording_place(const dmn_recording *r, const char *name, char *out, size_t size,
                               struct pvx_diag *d)
{
    if (name != NULL && strchr(name, '/') != NULL)
        return snprintf(out, size, "%s", name) < (int)size
                   ? PVX_OK
                   : pvx_fail(d, PVX_ERANGE, "%s: is too long", name);
    PVX_TRY(dmn_recording_name("record.path", r->pattern, r->base, out, size, d));
    return name != NULL ? name_beside(name, out, size, d) : PVX_OK;
}

/* ---- the ring ---- */

static void recording_counts(void *ctx, uint32_t camera, uint64_t out[CAP_N_COUNT])
{
    cap_capture_counts(*((dmn_recording *)ctx)->capture, camera, out);
}

/* The take of a trigger: NAME-TIME.h5 in the folder of record.path, with its instant. */
static pvx_err recording_place_trigger(void *ctx, const struct cap_take_trigger *t, char *path,
                                       size_t size, struct cap_take_head *head, struct pvx_diag *d)
{
    dmn_recording *r = ctx;
    time_t s = (time_t)(t->t_ns / PVX_NS_PER_S);
    struct tm tm;
    char when[32] = "", name[128];
    if (localtime_r(&s, &tm) != NULL)
        strftime(when, sizeof when, "%Y%m%dT%H%M%S", &tm);
    for (int i = 1; i < 1000; i++) {
        char more[8] = "";
        if (i > 1)
            snprintf(more, sizeof more, "-%d", i);
        snprintf(name, sizeof name, "%s-%s.%03d%s.h5", t->name, when,
                 (int)(t->t_ns / PVX_NS_PER_MS % 1000), more);
        PVX_TRY(recording_place(r, name, path, size, d));
        if (access(path, F_OK) != 0)
            break;
    }
    pthread_mutex_lock(&r->lock);
    *head = r->head;
    pthread_mutex_unlock(&r->lock);
    head->t_created_ns = pvx_now_real();
    head->t_began_ns = 0;
    return PVX_OK;
}

/* Bytes of one frame of each camera together. */
static double bytes_of_cameras(const struct dmn_config *c, const struct rec_rig *rig)
{
    enum cap_pixfmt fmt = dmn_config_pixfmt(c);
    double bytes = 0;
    for (size_t i = 0; i < rig->n_cameras; i++) {
        int32_t w = rig->cameras[i].width, h = rig->cameras[i].height;
        bytes += fmt == CAP_FMT_NONE ? 3.0 * w * h : (double)cap_pixfmt_image(fmt, w, h);
    }
    return bytes;
}

/* Frames of each camera that the ring holds: enough for every trigger, or an error. */
static pvx_err ring_frames(const struct dmn_config *c, const struct rec_rig *rig, uint32_t *out,
                           struct pvx_diag *d)
{
    const struct dmn_ring *k = &c->ring;
    double set = bytes_of_cameras(c, rig), fit = floor(k->memory / set) - CAP_RING_MORE,
           want = ceil(k->seconds * c->fps) + 1,
           frames = fmin(fmin(fit, want), CAP_BUFFERS_MAX / 2);
    const char *name = "an order";
    double pre = k->pre;
    for (size_t i = 0; i < c->triggers.n; i++)
        if (c->triggers.item[i].pre > pre) {
            pre = c->triggers.item[i].pre;
            name = c->triggers.item[i].name;
        }
    if (c->lossless)
        return pvx_fail(d, PVX_EINVAL,
                        "%s: record.ring: with lossless: true no frame is late; leave the ring out",
                        c->name);
    if (k->seconds < pre)
        return pvx_fail(d, PVX_EINVAL,
                        "%s: record.ring: seconds: %g is less than the %g s before %s (pre): raise "
                        "seconds or lower pre",
                        c->name, k->seconds, pre, name);
    if (frames < 1 || frames / c->fps < pre)
        return pvx_fail(d, PVX_EINVAL,
                        "%s: record.ring: memory: %.3g MB holds %.2f s of %zu cameras, %s needs %g "
                        "s before it (pre): raise memory to %.3g MB or lower pre",
                        c->name, k->memory * 1e-6, fmax(frames, 0) / c->fps, rig->n_cameras, name,
                        pre, (ceil(pre * c->fps) + 1 + CAP_RING_MORE) * set * 1e-6);
    if (frames < want)
        LOG_W(CAPTURE, "record.ring: memory: %.3g MB holds %.2f s instead of %g s",
              k->memory * 1e-6, frames / c->fps, k->seconds);
    LOG_I(CAPTURE,
          "record.ring: the last %.0f frames of each of %zu cameras, %.2f s at %g Hz, in %.1f MB%s",
          frames, rig->n_cameras, frames / c->fps, c->fps, (frames + CAP_RING_MORE) * set * 1e-6,
          dmn_config_pixfmt(c) == CAP_FMT_NONE
              ? "; pixel_format: auto counts as 3 bytes a pixel, so name the format"
              : "");
    *out = (uint32_t)frames;
    return PVX_OK;
}

static pvx_err ring_make(dmn_recording *r, const struct dmn_config *c, const struct rec_rig *rig,
                         struct dmn_sources *sources, struct pvx_diag *d)
{
    uint32_t frames = 0;
    if (c->ring.seconds <= 0)
        return c->triggers.n == 0 ? PVX_OK
                                  : pvx_fail(d, PVX_EINVAL,
                                             "%s: triggers: need frames in memory: add record: "
                                             "{ ring: { seconds: 5, memory: 8GB } }",
                                             c->name);
    PVX_TRY(ring_frames(c, rig, &frames, d));
    const struct cap_ring_config k = {.n_cameras = (uint32_t)rig->n_cameras,
                                      .frames = frames,
                                      .bytes = (uint64_t)c->ring.memory,
                                      .set_bytes = (uint64_t)bytes_of_cameras(c, rig),
                                      .fps = c->fps,
                                      .limit_bytes = (uint64_t)(c->record_limit_gb * GB),
                                      .keep_free_bytes = (uint64_t)(c->record_keep_free_gb * GB),
                                      .sync_ns = (int64_t)(c->record_sync_s * 1e9),
                                      .next = sources->capture.tap,
                                      .health = recording_health,
                                      .counts = recording_counts,
                                      .place = recording_place_trigger,
                                      .ctx = r};
    PVX_TRY(cap_ring_new(&k, &r->ring));
    sources->capture.tap = cap_ring_tap(r->ring);
    sources->capture.sets.held = frames + CAP_RING_MORE;
    for (size_t i = 0; i < rig->n_cameras; i++) {
        sources->source[i].held = frames + CAP_RING_MORE;
        sources->source[i].buffers += frames + CAP_RING_MORE;
    }
    return PVX_OK;
}

cap_ring *dmn_recording_ring(dmn_recording *r)
{
    return r != NULL ? r->ring : NULL;
}

pvx_err dmn_recording_new(const struct dmn_config *c, const struct rec_rig *rig,
                          struct dmn_sources *sources, cap_capture *const *capture,
                          uint64_t session, dmn_recording **out, struct pvx_diag *d)
{
    *out = NULL;
    if (c->record_queue == 0 && (c->ring.seconds > 0 || c->triggers.n > 0))
        return pvx_fail(d, PVX_EINVAL, "%s: record.queue: 0, so record.ring cannot be written",
                        c->name);
    if (c->record_queue == 0)
        return c->record_mode == 0
                   ? PVX_OK
                   : pvx_fail(d, PVX_EINVAL, "%s: record.queue: 0, so nothing can be recorded",
                              c->name);
    dmn_recording *r = pvx_calloc(1, sizeof *r);
    PVX_NEED(r);
    pthread_mutex_init(&r->lock, NULL);
    snprintf(r->pattern, sizeof r->pattern, "%s", c->record_path);
    struct cap_recorder_config rc = {.n_cameras = (uint32_t)rig->n_cameras,
                                     .queue = (unsigned)c->record_queue,
                                     .lossless = c->lossless,
                                     .limit_bytes = (uint64_t)(c->record_limit_gb * GB),
                                     .keep_free_bytes = (uint64_t)(c->record_keep_free_gb * GB),
                                     .sync_ns = (int64_t)(c->record_sync_s * 1e9),
                                     .roll_ns = (int64_t)(c->record_roll_s * 1e9),
                                     .health = recording_health,
                                     .ctx = r};
    r->capture = capture;
    pvx_err e = recording_describe(r, c, rig, sources, session);
    PVX_THEN(e, cap_recorder_new(&rc, &r->recorder));
    if (e != PVX_OK) {
        dmn_recording_free(&r);
        return pvx_fail(d, e, "recording: %s", pvx_strerror(e));
    }
    sources->capture.tap = cap_recorder_tap(r->recorder);
    for (size_t i = 0; i < rig->n_cameras; i++)
        sources->source[i].buffers += rc.queue + 1; /* 1 for a snapshot (instant.h) */
    *out = r;
    e = ring_make(r, c, rig, sources, d);
    if (e != PVX_OK)
        dmn_recording_free(out);
    return e;
}

pvx_err dmn_recording_snapshot(dmn_recording *r, const char *name, char *where, size_t size,
                               struct cap_take_head *head, struct pvx_diag *d)
{
    char now[PATH_MAX];
    if (r == NULL)
        return pvx_fail(d, PVX_EUNSUP, "this daemon cannot record: its record.queue is 0");
    PVX_TRY(dmn_recording_name("snapshot", "snapshot-%Y%m%dT%H%M%S", "", now, sizeof now, d));
    PVX_TRY(recording_place(r, name != NULL ? name : now + 1, where, size, d));
    pthread_mutex_lock(&r->lock);
    *head = r->head;
    pthread_mutex_unlock(&r->lock);
    head->t_created_ns = pvx_now_real();
    return PVX_OK;
}

pvx_err dmn_recording_start(dmn_recording *r, const char *path, char *where, size_t size,
                            struct pvx_diag *d)
{
    if (r == NULL)
        return pvx_fail(d, PVX_EUNSUP, "this daemon cannot record: its record.queue is 0");
    char name[PATH_MAX];
    PVX_TRY(recording_place(r, path, name, sizeof name, d));
    path = name;
    pthread_mutex_lock(&r->lock);
    r->head.t_created_ns = pvx_now_real();
    pvx_err e = cap_recorder_start(r->recorder, path, &r->head, d);
    pthread_mutex_unlock(&r->lock);
    snprintf(where, size, "%s", path);
    return e;
}

void dmn_recording_hurry(dmn_recording *r)
{
    if (r != NULL)
        cap_recorder_hurry(r->recorder);
}

pvx_err dmn_recording_stop(dmn_recording *r, char *where, size_t size, struct pvx_diag *d)
{
    if (r == NULL)
        return pvx_fail(d, PVX_ENOENT, "nothing is being recorded");
    struct cap_recorder_stats s;
    pthread_mutex_lock(&r->lock);
    pvx_err e = cap_recorder_stop(r->recorder, d);
    pthread_mutex_unlock(&r->lock);
    cap_recorder_stats(r->recorder, &s);
    snprintf(where, size, "%s", s.path);
    return e;
}

void dmn_recording_stats(dmn_recording *r, struct cap_recorder_stats *out)
{
    if (r == NULL)
        *out = (struct cap_recorder_stats){0};
    else
        cap_recorder_stats(r->recorder, out);
}

void dmn_recording_free(dmn_recording **rp)
{
    dmn_recording *r = *rp;
    if (r == NULL)
        return;
    *rp = NULL;
    cap_ring_free(&r->ring); /* first: it hands frames to the recorder's tap */
    cap_recorder_free(&r->recorder);
    for (size_t i = 0; i < REC_MAX_CAMERAS; i++)
        free(r->settings[i]);
    free(r->rig);
    free(r->config);
    pthread_mutex_destroy(&r->lock);
    free(r);
}
