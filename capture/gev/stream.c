/* stream.c - frames of an aravis: camera, from Aravis' receiving thread.
 *
 * Zero copy: the ArvBuffers are lent out as frames and come back (lend.h).  Two always stay with the stream.  A frame
 * that would take one of them is dropped here and counted as an underrun, because Aravis counts those in packets.
 *
 * No field of a buffer without SUCCESS is used: after a lost leader, its number and stamp are those of an earlier
 * frame (seen: 31 of 696).  A buffer with SUCCESS may still be short.  With IP fragments bytes are missing, and with
 * invalid packets there are no bytes, or no leader and so the stamp of an earlier frame.  The number and stamp of a
 * short buffer are not used either. */
#include <stdlib.h>

#include "base/clock.h"
#include "base/mem.h"
#include "capture/gev/err.h"
#include "capture/gev/gev.h"
#include "capture/gev/host.h"
#include "capture/gev/last.h"
#include "capture/gev/ring.h"

#define ASK_AGAIN   4 /* packet timeouts between two requests for the same packet */
#define SPARE       2 /* buffers that always stay with the stream */
#define PAYLOAD_MAX ((size_t)1 << 32)

/* defaults, for 0 in cap_gige */
#define RETENTION_MS      50.0
#define PACKET_TIMEOUT_MS 5.0
#define SOCKET_BUFFER     (8 << 20)

/* They live until their last frame is released, perhaps longer than the source. */
struct aravis_buffers {
    ArvStream *stream; /* used between cap_lend_run(true) and cap_lend_run(false) only */
    unsigned n;
    unsigned char *memory; /* of all buffers; buffer i at i * step */
    size_t step,
        reserved; /* reserved: bytes of memory from cap_source_memory; 0 = it is from the heap */
    ArvBuffer *buffer[]; /* [n], one reference each; user data: its index */
};

/* ---- buffers ---------------------------------------------------------------------------------- */

/* Aravis leaves the stamp of the last use in a buffer until a leader comes.  So the stamp is set to 0 here, and a
 * frame without a stamp of its own is recognised. */
static bool stream_queue(void *ctx, unsigned index)
{
    struct aravis_buffers *bs = ctx;
    arv_buffer_set_timestamp(bs->buffer[index], 0);
    arv_stream_push_buffer(bs->stream, g_object_ref(bs->buffer[index]));
    return true;
}

static void stream_free_buffers(void *ctx)
{
    struct aravis_buffers *bs = ctx;
    for (unsigned i = 0; i < bs->n; i++)
        g_object_unref(bs->buffer[i]);
    if (bs->reserved > 0)
        pvx_unreserve(bs->memory, bs->reserved);
    else
        free(bs->memory);
    free(bs);
}

static void stream_unused(void *ctx, unsigned index)
{
    struct aravis_buffers *bs = ctx;
    if (bs->reserved > 0)
        pvx_discard(bs->memory + index * bs->step, bs->step);
}

static const struct cap_lend_ops lend_ops = {stream_queue, stream_free_buffers, stream_unused};

pvx_err aravis_make_buffers(struct aravis_source *s)
{
    unsigned n = (s->c.buffers < 4 ? 4 : s->c.buffers) + SPARE;
    size_t bytes = s->layout.payload;
    if (bytes == 0 || bytes > PAYLOAD_MAX)
        return PVX_EINVAL;
    struct aravis_buffers *bs = pvx_calloc(1, sizeof *bs + n * sizeof bs->buffer[0]);
    PVX_NEED(bs);
    size_t align = s->c.held > 0 ? PVX_PAGE : PVX_ALIGN;
    bs->step = (bytes + align - 1) & ~(align - 1);
    bs->reserved = s->c.held > 0 ? n * bs->step : 0;
    bs->memory = s->c.held > 0 ? cap_source_memory(&s->c, bs->reserved) : pvx_calloc(n, bs->step);
    pvx_err e = bs->memory == NULL ? PVX_ENOMEM
                                   : cap_lend_new(n, SPARE, s->c.camera, &lend_ops, bs, &s->lend);
    if (e != PVX_OK) {
        stream_free_buffers(bs);
        return e;
    }
    for (; bs->n < n; bs->n++)
        bs->buffer[bs->n] = arv_buffer_new_full(bytes, bs->memory + bs->n * bs->step,
                                                GUINT_TO_POINTER(bs->n), NULL);
    s->buffers = bs;
    return PVX_OK;
}

/* ---- the stream's thread ---------------------------------------------------------------------- */

static void stream_count(struct aravis_source *s, enum cap_count what, uint64_t n)
{
    s->sink.count(s->sink.ctx, s->c.camera, what, n);
}

/* The image in a buffer.  The leader may announce a wrong size, so the size is limited to the buffer's payload. */
static struct cap_image stream_image_of(ArvBuffer *b, const unsigned char *mem, size_t payload)
{
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
    img.fmt = cap_pixfmt_from_pfnc(arv_buffer_get_image_pixel_format(b));
    img.stride = (ptrdiff_t)cap_pixfmt_row(img.fmt, img.width) + x_pad;
    size_t rows;
    if (img.stride > x_pad && img.height > 0 &&
        !__builtin_mul_overflow((size_t)img.stride, (size_t)img.height, &rows) && rows < img.size)
        img.size = rows; /* without the chunk data behind it */
    return img;
}

/* Count the numbers missing before `id`, less those that came as incomplete frames. */
static void count_gap(struct aravis_source *s, bool first, uint64_t before, uint64_t id)
{
    uint64_t gap = first ? 0 : id - before - 1;
    if (gap > s->unnumbered)
        stream_count(s, CAP_ID_GAP, gap - s->unnumbered);
    s->unnumbered = 0;
}

static unsigned index_of(ArvBuffer *b)
{
    return GPOINTER_TO_UINT(arv_buffer_get_user_data(b));
}

/* Give the buffer back to the stream, unless the stream is being stopped. */
static void stream_give_back(struct aravis_source *s, ArvBuffer *b)
{
    unsigned i = index_of(b);
    g_object_unref(b); /* the stream's reference; ours stays */
    cap_lend_back(s->lend, i);
}

/* Drop a frame whose number is not known. */
static void stream_drop(struct aravis_source *s, ArvBuffer *b, enum cap_count cause)
{
    s->unnumbered++;
    stream_count(s, cause, 1);
    stream_give_back(s, b);
}

/* Whether the image has fewer bytes than the rows that the frame itself announces. */
static bool is_short(const struct cap_image *img)
{
    size_t row = cap_pixfmt_row(img->fmt, img->width), rows = (size_t)img->height, need;
    return img->size == 0 || img->width <= 0 || img->height <= 0 || img->stride < (ptrdiff_t)row ||
           __builtin_mul_overflow((size_t)img->stride, rows - 1, &need) ||
           __builtin_add_overflow(need, row, &need) || img->size < need;
}

static void stream_done(struct aravis_source *s, ArvBuffer *b)
{
    int64_t real, mono;
    pvx_now_both(&real, &mono);
    ArvBufferStatus status = arv_buffer_get_status(b);
    if (status == ARV_BUFFER_STATUS_ABORTED || status == ARV_BUFFER_STATUS_CLEARED) {
        stream_give_back(s, b); /* the stream is being stopped */
        return;
    }
    if (status != ARV_BUFFER_STATUS_SUCCESS) {
        stream_drop(s, b, CAP_INCOMPLETE);
        return;
    }
    int64_t stamp = (int64_t)arv_buffer_get_timestamp(b);
    s->stamps = s->stamps || stamp != 0;
    if (stamp == 0 && s->stamps) {
        stream_drop(s, b, CAP_INCOMPLETE);
        return;
    }
    const unsigned char *mem = s->buffers->memory + index_of(b) * s->buffers->step;
    struct cap_image img = stream_image_of(b, mem, s->layout.payload);
    if (is_short(&img)) {
        stream_drop(s, b, CAP_BAD_SIZE);
        return;
    }
    uint64_t number = arv_buffer_get_frame_id(b);
    struct cap_frame said = {.t_device_ns = stamp};
    if (!aravis_chunks_read(&s->chunks, b, &said, &number)) {
        stream_drop(s, b, CAP_INCOMPLETE);
        return;
    }
    bool first = !s->ids.any;
    uint64_t before = s->ids.id, id = aravis_ids_next(&s->ids, number);
    count_gap(s, first, before, id);
    struct cap_frame *f = cap_lend_out(s->lend, index_of(b));
    if (f == NULL) {
        stream_count(s, CAP_UNDERRUN, 1);
        stream_give_back(s, b);
        return;
    }
    g_object_unref(b); /* the stream's reference */
    f->img = img;
    f->id = id;
    f->t_device_ns = said.t_device_ns;
    f->t_arrival_ns = real;
    f->t_arrival_mono_ns = mono;
    f->exposure_us = said.exposure_us;
    f->gain = said.gain;
    f->lines = said.lines;
    f->lines_known = said.lines_known;
    s->sink.push(s->sink.ctx, f);
}

/* Take all finished buffers.  Aravis 0.8.26 does not announce a buffer that it used for a packet of an unknown kind.
 * Each such buffer left in the queue would delay every later frame by one. */
static void pop_done(struct aravis_source *s)
{
    ArvBuffer *b;
    while ((b = arv_stream_try_pop_buffer(s->stream)) != NULL)
        if (cap_gate_enter(&s->gate)) {
            stream_done(s, b);
            cap_gate_leave(&s->gate);
        } else {
            stream_give_back(s, b); /* stopping */
        }
}

static void on_stream(void *user, ArvStreamCallbackType type, ArvBuffer *buffer)
{
    struct aravis_source *s = user;
    (void)buffer; /* finished buffers come out of the queue */
    switch (type) {
    case ARV_STREAM_CALLBACK_TYPE_INIT: aravis_make_realtime(&s->c); break;
    case ARV_STREAM_CALLBACK_TYPE_START_BUFFER:
        /* The buffer comes from Aravis' queue.  Taking the lender's lock makes the writes of its last user visible
         * here, without relying on the inside of GLib. */
        cap_lend_n_out(s->lend);
        break;
    case ARV_STREAM_CALLBACK_TYPE_BUFFER_DONE: pop_done(s); break;
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
    if (ARV_IS_GV_STREAM(stream)) {
        if (!aravis_ring_settle(stream)) {
            aravis_unref_last(stream);
            return pvx_fail(d, PVX_ETIMEDOUT,
                            "camera %s: its receiving thread did not get to run for 10 s: the "
                            "machine is too busy to capture",
                            s->c.name);
        }
        set_stream(s, stream);
    }
    s->stream = s->buffers->stream = stream;
    cap_lend_run(s->lend, true);
    return PVX_OK;
}

void aravis_cut_stream(struct aravis_source *s)
{
    cap_lend_run(s->lend, false);
}

void aravis_end_stream(struct aravis_source *s)
{
    if (s->stream == NULL)
        return;
    aravis_cut_stream(s);
    aravis_unref_last(s->stream); /* its thread uses the pointer until it has ended */
    s->stream = NULL;
}
