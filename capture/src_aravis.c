/* src_aravis.c - aravis: GigE Vision and USB3 Vision cameras.
 *
 * Zero copy: each frame of the pool has one ArvBuffer around its memory.  The buffer is queued in
 * the stream until it is full; then its frame is handed out, and the release of the frame queues the
 * buffer again (or, when the stream has gone, gives the frame back to the pool).
 * Two buffers always stay with the stream: a frame that would take the last but one is dropped here
 * and counted as an underrun, because Aravis counts those in packets.
 *
 * Nothing of a buffer without SUCCESS is used: after a lost leader its number and stamp are those of
 * an earlier frame (seen: 31 of 696).  A SUCCESS may still be short (IP fragments): the frame goes
 * out with the bytes that are there, and capture.c sorts it out.
 *
 * USB3 Vision cameras go the same way through Aravis; that was not exercised, for want of one. */
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "capture/aravis_ids.h"
#include "capture/aravis_setup.h"
#include "capture/backends.h"
#include "capture/bufpool.h"

#define SPARE 2 /* buffers that always stay with the stream */
/* what cap_gige says with 0 */
#define RETENTION_MS      50.0
#define PACKET_TIMEOUT_MS 5.0
#define SOCKET_BUFFER     (8 << 20)
#define RT_PRIORITY       10

struct slot {
    struct cap_frame *frame;
    void (*put_back)(struct cap_frame *f); /* the pool's own release */
    ArvBuffer *buffer;
    struct link *link;
    bool out; /* with the consumer */
};

/* What frames that are out need after their source has been closed. */
struct link {
    pthread_mutex_t lock;
    ArvStream *stream; /* NULL: not streaming, or stopping */
    bool closed;
    unsigned n, n_out;
    struct slot *slot; /* [n] */
};

struct source {
    struct cap_source base;
    struct cap_source_config c; /* strings are copies */
    char *uri, *name;
    ArvCamera *camera;
    struct aravis_layout layout;
    cap_bufpool *pool;
    struct link *link;
    bool resend;
    struct cap_sink sink;

    /* The stream's thread alone, while it runs: */
    ArvStream *stream;
    struct aravis_ids ids;
    uint64_t unnumbered; /* incomplete frames since the last good one */

    pthread_mutex_t lock; /* events against stop */
    pthread_cond_t idle;
    gulong lost_handler;
    bool active, lost;
    unsigned busy; /* events being delivered */
};

/* ---- buffers ---------------------------------------------------------------------------------- */

static void link_free(struct link *l)
{
    pthread_mutex_destroy(&l->lock);
    free(l->slot);
    free(l);
}

static void queue(ArvStream *stream, struct slot *s)
{
    arv_stream_push_buffer(stream, g_object_ref(s->buffer)); /* takes the reference */
}

static void release(struct cap_frame *f)
{
    struct slot *s = f->owner;
    struct link *l = s->link;
    pthread_mutex_lock(&l->lock);
    s->out = false;
    l->n_out--;
    bool closed = l->closed, last = closed && l->n_out == 0;
    if (l->stream != NULL)
        queue(l->stream, s);
    void (*put_back)(struct cap_frame *) = s->put_back;
    pthread_mutex_unlock(&l->lock);
    if (closed)
        put_back(f);
    if (last)
        link_free(l);
}

static pvx_err make_buffers(struct source *s)
{
    unsigned n = (s->c.buffers < 4 ? 4 : s->c.buffers) + SPARE;
    PVX_TRY(cap_bufpool_new(n, s->layout.payload, s->c.camera, &s->pool));
    struct link *l = pvx_calloc(1, sizeof *l);
    if (l == NULL)
        return PVX_ENOMEM;
    pthread_mutex_init(&l->lock, NULL);
    s->link = l;
    l->slot = pvx_calloc(n, sizeof *l->slot);
    if (l->slot == NULL)
        return PVX_ENOMEM;
    for (unsigned i = 0; i < n; i++) {
        struct slot *slot = &l->slot[i];
        slot->frame = cap_bufpool_take(s->pool);
        slot->put_back = slot->frame->release;
        slot->link = l;
        slot->buffer =
            arv_buffer_new_full(s->layout.payload, cap_bufpool_memory(slot->frame), slot, NULL);
        l->n = i + 1;
    }
    return PVX_OK;
}

/* Frames that are out keep the pool's memory and the link. */
static void drop_buffers(struct source *s)
{
    struct link *l = s->link;
    s->link = NULL;
    if (l != NULL) {
        pthread_mutex_lock(&l->lock);
        l->closed = true;
        for (unsigned i = 0; i < l->n; i++) {
            g_object_unref(l->slot[i].buffer);
            if (!l->slot[i].out)
                l->slot[i].put_back(l->slot[i].frame);
        }
        bool last = l->n_out == 0;
        pthread_mutex_unlock(&l->lock);
        if (last)
            link_free(l);
    }
    cap_bufpool_unref(&s->pool);
}

/* ---- the stream's thread ---------------------------------------------------------------------- */

static void count(struct source *s, enum cap_count what, uint64_t n)
{
    s->sink.count(s->sink.ctx, s->c.camera, what, n);
}

/* Mark the slot as handed out, unless the stream would be left with too few buffers. */
static bool lend(struct slot *slot)
{
    struct link *l = slot->link;
    pthread_mutex_lock(&l->lock);
    bool may = l->n - l->n_out > SPARE;
    if (may) {
        slot->out = true;
        l->n_out++;
    }
    pthread_mutex_unlock(&l->lock);
    return may;
}

static struct cap_image image_of(ArvBuffer *b)
{
    struct cap_image img = {
        .data = cap_bufpool_memory(((const struct slot *)arv_buffer_get_user_data(b))->frame)};
    ArvBufferPayloadType type = arv_buffer_get_payload_type(b);
    if (arv_buffer_get_n_parts(b) == 0 || (type != ARV_BUFFER_PAYLOAD_TYPE_IMAGE &&
                                           type != ARV_BUFFER_PAYLOAD_TYPE_EXTENDED_CHUNK_DATA))
        return img; /* no picture in it: CAP_FMT_NONE */
    int x_pad = 0, y_pad = 0;
    arv_buffer_get_image_padding(b, &x_pad, &y_pad);
    img.data = arv_buffer_get_image_data(b, &img.size);
    img.width = arv_buffer_get_image_width(b);
    img.height = arv_buffer_get_image_height(b);
    img.fmt = aravis_pixfmt(arv_buffer_get_image_pixel_format(b));
    img.stride = (ptrdiff_t)cap_pixfmt_row(img.fmt, img.width) + x_pad;
    return img;
}

/* Numbers missing before `id`, less those that came as incomplete frames. */
static void count_gap(struct source *s, bool first, uint64_t before, uint64_t id)
{
    uint64_t gap = first ? 0 : id - before - 1;
    if (gap > s->unnumbered)
        count(s, CAP_ID_GAP, gap - s->unnumbered);
    s->unnumbered = 0;
}

static void done(struct source *s, ArvBuffer *b)
{
    int64_t real = pvx_now_real(), mono = pvx_now_mono();
    struct slot *slot = (struct slot *)(uintptr_t)arv_buffer_get_user_data(b);
    ArvBufferStatus status = arv_buffer_get_status(b);
    if (status != ARV_BUFFER_STATUS_SUCCESS) {
        /* aborted and cleared ones are the stream being stopped */
        if (status != ARV_BUFFER_STATUS_ABORTED && status != ARV_BUFFER_STATUS_CLEARED) {
            s->unnumbered++;
            count(s, CAP_INCOMPLETE, 1);
        }
        arv_stream_push_buffer(s->stream, b);
        return;
    }
    bool first = !s->ids.any;
    uint64_t before = s->ids.id, id = aravis_ids_next(&s->ids, arv_buffer_get_frame_id(b));
    count_gap(s, first, before, id);
    struct cap_frame *f = slot->frame;
    f->img = image_of(b);
    f->camera = s->c.camera;
    f->id = id;
    f->t_device_ns = (int64_t)arv_buffer_get_timestamp(b);
    f->t_arrival_ns = real;
    f->t_arrival_mono_ns = mono;
    f->t_exposure_ns = 0;
    f->release = release;
    f->owner = slot;
    if (!lend(slot)) {
        count(s, CAP_UNDERRUN, 1);
        arv_stream_push_buffer(s->stream, b);
        return;
    }
    g_object_unref(b); /* the slot's own reference stays */
    s->sink.push(s->sink.ctx, f);
}

static void on_stream(void *user, ArvStreamCallbackType type, ArvBuffer *buffer)
{
    struct source *s = user;
    (void)buffer; /* the one that is done comes out of the queue */
    switch (type) {
    case ARV_STREAM_CALLBACK_TYPE_INIT:
        if (s->c.gige.rt_priority >= 0 &&
            !arv_make_thread_realtime(s->c.gige.rt_priority > 0 ? s->c.gige.rt_priority
                                                                : RT_PRIORITY))
            LOG_D(CAPTURE, "camera %s: no real-time priority for its thread", s->c.name);
        break;
    case ARV_STREAM_CALLBACK_TYPE_START_BUFFER:
        /* Aravis' queue gave the buffer; the lock makes what its last user did to it visible here
         * in terms that do not depend on GLib's inside. */
        pthread_mutex_lock(&s->link->lock);
        pthread_mutex_unlock(&s->link->lock);
        break;
    case ARV_STREAM_CALLBACK_TYPE_BUFFER_DONE: {
        ArvBuffer *b = arv_stream_try_pop_buffer(s->stream);
        if (b != NULL)
            done(s, b);
        break;
    }
    case ARV_STREAM_CALLBACK_TYPE_EXIT: break;
    }
}

/* ---- events ----------------------------------------------------------------------------------- */

static void say_lost(struct source *s)
{
    pthread_mutex_lock(&s->lock);
    bool tell = s->active && !s->lost;
    s->lost = true;
    if (tell)
        s->busy++;
    pthread_mutex_unlock(&s->lock);
    if (!tell)
        return;
    s->sink.event(s->sink.ctx, s->c.camera, CAP_EV_LOST);
    pthread_mutex_lock(&s->lock);
    s->busy--;
    pthread_cond_broadcast(&s->idle);
    pthread_mutex_unlock(&s->lock);
}

static void on_control_lost(ArvDevice *device, void *user)
{
    (void)device;
    say_lost(user);
}

/* ---- operations ------------------------------------------------------------------------------- */

static void aravis_close(cap_source **sp)
{
    struct source *s = (struct source *)*sp;
    if (s == NULL)
        return;
    *sp = NULL;
    if (s->camera != NULL) {
        if (s->lost_handler != 0)
            g_signal_handler_disconnect(arv_camera_get_device(s->camera), s->lost_handler);
        g_object_unref(s->camera); /* ends the heartbeat's thread */
    }
    drop_buffers(s);
    pthread_mutex_destroy(&s->lock);
    pthread_cond_destroy(&s->idle);
    free(s->uri);
    free(s->name);
    free(s);
}

static pvx_err aravis_open(const struct cap_source_config *c, cap_source **out, struct pvx_diag *d)
{
    *out = NULL;
    struct source *s = pvx_calloc(1, sizeof *s);
    if (s == NULL)
        return PVX_ENOMEM;
    s->base.ops = &cap_source_aravis;
    pthread_mutex_init(&s->lock, NULL);
    pthread_cond_init(&s->idle, NULL);
    s->c = *c;
    s->c.uri = s->uri = strdup(c->uri);
    s->c.name = s->name = strdup(c->name != NULL ? c->name : "?");
    pvx_err e = s->uri == NULL || s->name == NULL ? PVX_ENOMEM : PVX_OK;
    if (e == PVX_OK)
        e = aravis_setup(&s->c, &s->camera, &s->layout, d);
    s->c.features = NULL; /* borrowed for the call */
    s->c.n_features = 0;
    if (e == PVX_OK)
        e = make_buffers(s);
    cap_source *base = &s->base;
    if (e != PVX_OK) {
        aravis_close(&base);
        return e;
    }
    s->resend = arv_camera_is_gv_device(s->camera) && aravis_wants_resend(&s->c, s->camera);
    s->lost_handler = g_signal_connect(arv_camera_get_device(s->camera), "control-lost",
                                       G_CALLBACK(on_control_lost), s);
    *out = base;
    return PVX_OK;
}

/* End the stream: no callback runs any more after this. */
static void end_stream(struct source *s)
{
    pthread_mutex_lock(&s->link->lock);
    s->link->stream = NULL;
    pthread_mutex_unlock(&s->link->lock);
    g_clear_object(&s->stream);
}

static void set_active(struct source *s, bool on)
{
    pthread_mutex_lock(&s->lock);
    s->active = on;
    while (!on && s->busy > 0)
        pthread_cond_wait(&s->idle, &s->lock);
    pthread_mutex_unlock(&s->lock);
}

static void set_stream(const struct source *s, ArvStream *stream)
{
    const struct cap_gige *g = &s->c.gige;
    double retention = g->frame_retention_ms > 0 ? g->frame_retention_ms : RETENTION_MS;
    double timeout = g->packet_timeout_ms > 0 ? g->packet_timeout_ms : PACKET_TIMEOUT_MS;
    g_object_set(stream, "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED, "socket-buffer-size",
                 g->socket_buffer > 0 ? g->socket_buffer : SOCKET_BUFFER, "packet-resend",
                 s->resend ? ARV_GV_STREAM_PACKET_RESEND_ALWAYS : ARV_GV_STREAM_PACKET_RESEND_NEVER,
                 "frame-retention", (guint)(retention * 1000), "packet-timeout",
                 (guint)(timeout * 1000), "initial-packet-timeout", (guint)(timeout * 1000), NULL);
}

static pvx_err aravis_start(cap_source *base, const struct cap_sink *sink, struct pvx_diag *d)
{
    struct source *s = (struct source *)base;
    GError *err = NULL;
    s->sink = *sink;
    s->ids = (struct aravis_ids){0};
    s->unnumbered = 0;
    s->lost = false;
    if (s->c.gige.no_packet_socket && arv_camera_is_gv_device(s->camera))
        arv_camera_gv_set_stream_options(s->camera, ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
    ArvStream *stream = arv_camera_create_stream(s->camera, on_stream, s, &err);
    if (stream == NULL)
        return aravis_fail(&s->c, PVX_EIO, "stream", &err, d);
    if (ARV_IS_GV_STREAM(stream))
        set_stream(s, stream);
    pthread_mutex_lock(&s->link->lock);
    s->stream = s->link->stream = stream;
    for (unsigned i = 0; i < s->link->n; i++)
        if (!s->link->slot[i].out)
            queue(stream, &s->link->slot[i]);
    pthread_mutex_unlock(&s->link->lock);
    set_active(s, true);
    arv_camera_start_acquisition(s->camera, &err);
    if (err != NULL) {
        set_active(s, false);
        end_stream(s);
        return aravis_fail(&s->c, PVX_EIO, "start of acquisition", &err, d);
    }
    return PVX_OK;
}

static pvx_err aravis_trigger(cap_source *base)
{
    struct source *s = (struct source *)base;
    GError *err = NULL;
    pthread_mutex_lock(&s->lock);
    bool lost = s->lost;
    pthread_mutex_unlock(&s->lock);
    if (lost)
        return PVX_ENODEV;
    arv_camera_software_trigger(s->camera, &err);
    if (err == NULL)
        return PVX_OK;
    /* Aravis has asked several times by now: waiting for the next answer would take as long. */
    g_clear_error(&err);
    say_lost(s);
    return PVX_ENODEV;
}

static void aravis_stop(cap_source *base)
{
    struct source *s = (struct source *)base;
    if (s->stream == NULL)
        return;
    set_active(s, false);
    if (!s->lost) /* a camera that is gone would only be waited for */
        arv_camera_stop_acquisition(s->camera, NULL);
    end_stream(s);
}

static pvx_err aravis_list(void (*cb)(void *ctx, const struct cap_found *f), void *ctx,
                           struct pvx_diag *d)
{
    (void)d;
    arv_update_device_list();
    unsigned n = arv_get_n_devices();
    for (unsigned i = 0; i < n; i++) {
        const char *protocol = arv_get_device_protocol(i), *address = arv_get_device_address(i);
        const char *vendor = arv_get_device_vendor(i), *model = arv_get_device_model(i);
        const char *serial = arv_get_device_serial_nbr(i);
        bool gige = protocol != NULL && strcmp(protocol, "GigEVision") == 0 && address != NULL;
        char uri[256], text[256];
        snprintf(uri, sizeof uri, "aravis:%s", gige ? address : arv_get_device_id(i));
        snprintf(text, sizeof text, "%s %s, serial %s, %s", vendor != NULL ? vendor : "?",
                 model != NULL ? model : "?", serial != NULL ? serial : "?",
                 protocol != NULL ? protocol : "?");
        cb(ctx, &(struct cap_found){uri, text, NULL});
    }
    return PVX_OK;
}

const struct cap_source_ops cap_source_aravis = {
    .scheme = "aravis",
    .help = "GigE Vision or USB3 Vision camera: IP address, serial number, its name or Aravis' id",
    .open = aravis_open,
    .start = aravis_start,
    .trigger = aravis_trigger,
    .triggers = true,
    .stop = aravis_stop,
    .close = aravis_close,
    .list = aravis_list,
};
