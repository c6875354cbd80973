/* aravis_stream.c - frames of an aravis: camera, from Aravis' receiving thread.
 *
 * Zero copy: each frame of the pool has one ArvBuffer around its memory.  The buffer is queued in
 * the stream until it is full; then its frame is handed out, and the release of the frame queues the
 * buffer again (or, when the stream has gone, gives the frame back to the pool).
 * Two buffers always stay with the stream: a frame that would take the last but one is dropped here
 * and counted as an underrun, because Aravis counts those in packets.
 *
 * Nothing of a buffer without SUCCESS is used: after a lost leader its number and stamp are those of
 * an earlier frame (seen: 31 of 696).  A SUCCESS may still be short (IP fragments: bytes are missing;
 * packets that make no sense: no bytes, or no leader and so the stamp of an earlier frame): its number
 * and stamp are not used either. */
#include <math.h>
#include <stdlib.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "capture/aravis_int.h"

#define ASK_AGAIN 4 /* packet timeouts between two requests for the same packet */
#define SPARE     2 /* buffers that always stay with the stream */

/* what cap_gige says with 0 */
#define RETENTION_MS      50.0
#define PACKET_TIMEOUT_MS 5.0
#define SOCKET_BUFFER     (8 << 20)

struct slot {
    struct cap_frame *frame;
    void (*put_back)(struct cap_frame *f); /* the pool's own release */
    ArvBuffer *buffer;
    struct aravis_link *link;
    bool out; /* with the consumer */
};

/* What frames that are out need after their source has been closed. */
struct aravis_link {
    pthread_mutex_t lock;
    ArvStream *stream; /* NULL: not streaming, or stopping */
    bool closed;
    unsigned n, n_out;
    struct slot *slot; /* [n] */
};

/* ---- buffers ---------------------------------------------------------------------------------- */

static void link_free(struct aravis_link *l)
{
    pthread_mutex_destroy(&l->lock);
    free(l->slot);
    free(l);
}

/* Aravis leaves the stamp of the last use in a buffer until a leader comes: with 0 in it, a frame
 * without its own is known. */
static void push(ArvStream *stream, ArvBuffer *b) /* takes the reference */
{
    arv_buffer_set_timestamp(b, 0);
    arv_stream_push_buffer(stream, b);
}

static void queue(ArvStream *stream, struct slot *s)
{
    push(stream, g_object_ref(s->buffer));
}

static void release(struct cap_frame *f)
{
    struct slot *s = f->owner;
    struct aravis_link *l = s->link;
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

pvx_err aravis_make_buffers(struct aravis_source *s)
{
    unsigned n = (s->c.buffers < 4 ? 4 : s->c.buffers) + SPARE;
    PVX_TRY(cap_bufpool_new(n, s->layout.payload, s->c.camera, &s->pool));
    struct aravis_link *l = pvx_calloc(1, sizeof *l);
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
void aravis_drop_buffers(struct aravis_source *s)
{
    struct aravis_link *l = s->link;
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

static void count(struct aravis_source *s, enum cap_count what, uint64_t n)
{
    s->sink.count(s->sink.ctx, s->c.camera, what, n);
}

/* Mark the slot as handed out, unless the stream would be left with too few buffers. */
static bool lend(struct slot *slot)
{
    struct aravis_link *l = slot->link;
    pthread_mutex_lock(&l->lock);
    bool may = l->n - l->n_out > SPARE;
    if (may) {
        slot->out = true;
        l->n_out++;
    }
    pthread_mutex_unlock(&l->lock);
    return may;
}

/* What the leader says about the size may be wrong: no more than what the buffer has. */
static struct cap_image image_of(ArvBuffer *b, size_t payload)
{
    const unsigned char *mem =
        cap_bufpool_memory(((const struct slot *)arv_buffer_get_user_data(b))->frame);
    struct cap_image img = {.data = mem};
    ArvBufferPayloadType type = arv_buffer_get_payload_type(b);
    bool image = type == ARV_BUFFER_PAYLOAD_TYPE_IMAGE ||
                 type == ARV_BUFFER_PAYLOAD_TYPE_EXTENDED_CHUNK_DATA;
    if (arv_buffer_get_n_parts(b) == 0 || !image)
        return img; /* no picture in it: CAP_FMT_NONE */
    int x_pad = 0, y_pad = 0;
    arv_buffer_get_image_padding(b, &x_pad, &y_pad);
    img.data = arv_buffer_get_image_data(b, &img.size);
    size_t before = (size_t)((const unsigned char *)img.data - mem);
    if (img.data == NULL || before >= payload)
        return (struct cap_image){.data = mem};
    if (img.size > payload - before)
        img.size = payload - before;
    img.width = arv_buffer_get_image_width(b);
    img.height = arv_buffer_get_image_height(b);
    img.fmt = aravis_pixfmt(arv_buffer_get_image_pixel_format(b));
    img.stride = (ptrdiff_t)cap_pixfmt_row(img.fmt, img.width) + x_pad;
    return img;
}

/* Numbers missing before `id`, less those that came as incomplete frames. */
static void count_gap(struct aravis_source *s, bool first, uint64_t before, uint64_t id)
{
    uint64_t gap = first ? 0 : id - before - 1;
    if (gap > s->unnumbered)
        count(s, CAP_ID_GAP, gap - s->unnumbered);
    s->unnumbered = 0;
}

/* A frame whose number is not known. */
static void drop(struct aravis_source *s, ArvBuffer *b, enum cap_count cause)
{
    s->unnumbered++;
    count(s, cause, 1);
    push(s->stream, b);
}

/* Fewer bytes than the rows that the frame itself announces. */
static bool is_short(const struct cap_image *img)
{
    size_t row = cap_pixfmt_row(img->fmt, img->width), rows = (size_t)img->height, need;
    return img->size == 0 || img->width <= 0 || img->height <= 0 || img->stride < (ptrdiff_t)row ||
           __builtin_mul_overflow((size_t)img->stride, rows - 1, &need) ||
           __builtin_add_overflow(need, row, &need) || img->size < need;
}

static void done(struct aravis_source *s, ArvBuffer *b)
{
    int64_t real = pvx_now_real(), mono = pvx_now_mono();
    struct slot *slot = (struct slot *)(uintptr_t)arv_buffer_get_user_data(b);
    ArvBufferStatus status = arv_buffer_get_status(b);
    if (status == ARV_BUFFER_STATUS_ABORTED || status == ARV_BUFFER_STATUS_CLEARED) {
        push(s->stream, b); /* the stream is being stopped */
        return;
    }
    if (status != ARV_BUFFER_STATUS_SUCCESS) {
        drop(s, b, CAP_INCOMPLETE);
        return;
    }
    int64_t stamp = (int64_t)arv_buffer_get_timestamp(b);
    s->stamps = s->stamps || stamp != 0;
    if (stamp == 0 && s->stamps) {
        drop(s, b, CAP_INCOMPLETE);
        return;
    }
    struct cap_image img = image_of(b, s->layout.payload);
    if (is_short(&img)) {
        drop(s, b, CAP_BAD_SIZE);
        return;
    }
    struct cap_frame *f = slot->frame;
    uint64_t number = arv_buffer_get_frame_id(b);
    f->t_device_ns = stamp;
    if (!aravis_chunks_read(&s->chunks, b, f, &number)) {
        drop(s, b, CAP_INCOMPLETE);
        return;
    }
    bool first = !s->ids.any;
    uint64_t before = s->ids.id, id = aravis_ids_next(&s->ids, number);
    count_gap(s, first, before, id);
    f->img = img;
    f->camera = s->c.camera;
    f->id = id;
    f->t_arrival_ns = real;
    f->t_arrival_mono_ns = mono;
    f->t_exposure_ns = 0;
    f->release = release;
    f->owner = slot;
    if (!lend(slot)) {
        count(s, CAP_UNDERRUN, 1);
        push(s->stream, b);
        return;
    }
    g_object_unref(b); /* the slot's own reference stays */
    s->sink.push(s->sink.ctx, f);
}

static void on_stream(void *user, ArvStreamCallbackType type, ArvBuffer *buffer)
{
    struct aravis_source *s = user;
    (void)buffer; /* the one that is done comes out of the queue */
    switch (type) {
    case ARV_STREAM_CALLBACK_TYPE_INIT: aravis_make_realtime(&s->c); break;
    case ARV_STREAM_CALLBACK_TYPE_START_BUFFER:
        /* Aravis' queue gave the buffer; the lock makes what its last user did to it visible here
         * in terms that do not depend on GLib's inside. */
        pthread_mutex_lock(&s->link->lock);
        pthread_mutex_unlock(&s->link->lock);
        break;
    case ARV_STREAM_CALLBACK_TYPE_BUFFER_DONE: {
        ArvBuffer *b = arv_stream_try_pop_buffer(s->stream);
        if (b == NULL)
            break;
        if (cap_gate_enter(&s->gate)) {
            done(s, b);
            cap_gate_leave(&s->gate);
        } else {
            push(s->stream, b); /* stopping: nobody wants it */
        }
        break;
    }
    case ARV_STREAM_CALLBACK_TYPE_EXIT: break;
    }
}

/* ---- start and end ---------------------------------------------------------------------------- */

static void set_stream(const struct aravis_source *s, ArvStream *stream)
{
    const struct cap_gige *g = &s->c.gige;
    double retention = g->frame_retention_ms > 0 ? g->frame_retention_ms : RETENTION_MS;
    double timeout = g->packet_timeout_ms > 0 ? g->packet_timeout_ms : PACKET_TIMEOUT_MS;
    int room = g->socket_buffer > 0 ? g->socket_buffer : SOCKET_BUFFER;
    aravis_check_room(&s->c, room);
    g_object_set(
        stream, "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED, "socket-buffer-size", room,
        "packet-resend",
        s->resend ? ARV_GV_STREAM_PACKET_RESEND_ALWAYS : ARV_GV_STREAM_PACKET_RESEND_NEVER,
        "frame-retention", (guint)(retention * 1000), "packet-timeout",
        (guint)(ASK_AGAIN * timeout * 1000), "initial-packet-timeout", (guint)(timeout * 1000),
        /* Every packet of a frame may be asked for once; with Aravis' quarter, a small frame is given up
         * when one is lost twice. */
        "packet-request-ratio", 1.0, NULL);
}

pvx_err aravis_begin_stream(struct aravis_source *s, struct pvx_diag *d)
{
    GError *err = NULL;
    s->ids = (struct aravis_ids){0};
    s->unnumbered = 0;
    s->stamps = false;
    if (arv_camera_is_gv_device(s->camera))
        arv_camera_gv_set_stream_options(
            s->camera, s->c.gige.no_packet_socket ? ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED
                                                  : ARV_GV_STREAM_OPTION_NONE);
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
    return PVX_OK;
}

void aravis_cut_stream(struct aravis_source *s)
{
    pthread_mutex_lock(&s->link->lock);
    s->link->stream = NULL;
    pthread_mutex_unlock(&s->link->lock);
}

void aravis_end_stream(struct aravis_source *s)
{
    if (s->stream == NULL)
        return;
    aravis_cut_stream(s);
    g_object_unref(s->stream); /* its thread uses the pointer until it has ended */
    s->stream = NULL;
}
