/* v4l2.c - v4l2: webcams and other cameras of the kernel's Video for Linux.
 *
 * Zero copy: the driver's own mapped buffers go to the consumer and come back (lend.h).  Images are copied when the
 * driver has fewer buffers than the configuration's `buffers` and the two it always keeps.  So a slow consumer
 * never takes the driver's last ones.
 * One thread per camera takes full buffers out of the driver's queue.  A device that is unplugged (ENODEV, EIO,
 * POLLERR, POLLHUP) is lost at once.  The capture then opens it again by its name.
 *
 * Numbers are the driver's sequence, widened past 32 bits.  If a driver does not number its frames (the sequence
 * stays at one value), they are counted here, and frames that it drops cannot be seen.
 * Times: stamps of CLOCK_MONOTONIC are used.  For others (unknown, copied, or more than 10 s from the arrival) the
 * time of arrival counts, and one message says so.  A stamp of the end of a frame is moved back by the exposure when
 * that is fixed and known.  The readout time stays in it, the same for equal cameras.
 *
 * Source: kernel documentation, userspace-api/media/v4l (mmap, buffer). */
#include <errno.h>
#include <math.h>
#include <poll.h>
#include <pthread.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/mman.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "capture/source/backends.h"
#include "capture/source/bufpool.h"
#include "capture/source/lend.h"
#include "capture/source/frame_number.h"
#include "capture/v4l2/v4l2.h"

#define SPARE       2   /* buffers that always stay with the driver */
#define COPIED_FROM 6   /* buffers asked for when images are copied */
#define LOOK_MS     250 /* interval to ask a driver that does not wake us */
#define NAP_MS      1   /* pause after a wake-up without a buffer */
#define STAMP_MAX   (10 * PVX_NS_PER_S)
#define RT_PRIORITY 10

/* The driver's buffers.  They live until their last frame is released, perhaps longer than the source. */
struct buffers {
    int fd; /* the source's; used only while streaming */
    uint32_t type;
    unsigned n;
    struct {
        void *mem;
        size_t bytes;
    } at[VIDEO_MAX_FRAME];
};

struct source {
    struct cap_source base;
    char serial[CAP_SERIAL_MAX];
    struct cap_source_config c; /* strings are copies */
    char *uri, *name;
    struct v4l_device dev;
    struct v4l_layout layout;
    double exposure_us, gain; /* fixed and known, else NAN */
    cap_lend *lend;
    struct buffers *buffers; /* of lend */
    cap_bufpool *pool;       /* images are copied into it; NULL: they are lent */
    struct cap_sink sink;
    int wake; /* eventfd: stop */
    pthread_t thread;
    bool streaming;

    /* the thread's: */
    bool stamped, odd_stamp; /* a stamp was checked; the last message was about odd stamps */
    struct cap_numbering sequence;
};

/* A buffer from the driver, for both forms of the interface. */
struct filled {
    unsigned index;
    uint32_t flags, sequence;
    size_t offset, bytes; /* of the image in the buffer */
    int64_t stamp_ns;
};

/* ---- buffers ---------------------------------------------------------------------------------- */

static struct v4l2_buffer v4l2_empty(uint32_t type, unsigned index, struct v4l2_plane *plane)
{
    struct v4l2_buffer b = {.type = type, .memory = V4L2_MEMORY_MMAP, .index = index};
    *plane = (struct v4l2_plane){0};
    if (type == V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE) {
        b.m.planes = plane;
        b.length = 1;
    }
    return b;
}

static bool queue_buffer(void *ctx, unsigned index)
{
    const struct buffers *bs = ctx;
    struct v4l2_plane plane;
    struct v4l2_buffer b = v4l2_empty(bs->type, index, &plane);
    return v4l_call(bs->fd, VIDIOC_QBUF, &b) == 0;
}

static void v4l2_free_buffers(void *ctx)
{
    struct buffers *bs = ctx;
    for (unsigned i = 0; i < bs->n; i++)
        munmap(bs->at[i].mem, bs->at[i].bytes);
    free(bs);
}

static const struct cap_lend_ops lend_ops = {queue_buffer, v4l2_free_buffers, NULL};

static pvx_err map_buffer(struct source *s, struct buffers *bs, struct pvx_diag *d)
{
    struct v4l2_plane plane;
    struct v4l2_buffer b = v4l2_empty(bs->type, bs->n, &plane);
    if (v4l_call(s->dev.fd, VIDIOC_QUERYBUF, &b) != 0)
        return v4l_fail(&s->c, s->dev.node, "VIDIOC_QUERYBUF", d);
    bool mplane = v4l_mplane(&s->dev);
    size_t bytes = mplane ? plane.length : b.length;
    if (bytes < s->layout.size || bytes == 0)
        return CAP_FAIL(&s->c, "v4l2", d, PVX_EIO,
                        "its driver %s gives buffers of %zu bytes for images of %zu", s->dev.driver,
                        bytes, s->layout.size);
    void *mem = mmap(NULL, bytes, PROT_READ | PROT_WRITE, MAP_SHARED, s->dev.fd,
                     mplane ? plane.m.mem_offset : b.m.offset);
    if (mem == MAP_FAILED)
        return v4l_fail(&s->c, s->dev.node, "mmap of a buffer", d);
    bs->at[bs->n].mem = mem;
    bs->at[bs->n].bytes = bytes;
    bs->n++;
    return PVX_OK;
}

static pvx_err request(struct source *s, unsigned n, unsigned *got, struct pvx_diag *d)
{
    struct v4l2_requestbuffers r = {.count = n, .type = s->dev.type, .memory = V4L2_MEMORY_MMAP};
    if (v4l_call(s->dev.fd, VIDIOC_REQBUFS, &r) != 0)
        return v4l_fail(&s->c, s->dev.node, "VIDIOC_REQBUFS", d);
    *got = r.count < VIDEO_MAX_FRAME ? r.count : VIDEO_MAX_FRAME;
    if (*got > SPARE)
        return PVX_OK;
    return CAP_FAIL(&s->c, "v4l2", d, PVX_ENOMEM, "its driver %s gives only %u buffers",
                    s->dev.driver, *got);
}

static pvx_err v4l2_make_buffers(struct source *s, struct pvx_diag *d)
{
    unsigned want = s->c.buffers < 4 ? 4 : s->c.buffers, n = 0;
    bool lend = want + SPARE <= VIDEO_MAX_FRAME;
    PVX_TRY(request(s, lend ? want + SPARE : COPIED_FROM, &n, d));
    lend = lend && n >= want + SPARE;
    struct buffers *bs = pvx_calloc(1, sizeof *bs);
    PVX_NEED(bs);
    *bs = (struct buffers){.fd = s->dev.fd, .type = s->dev.type};
    pvx_err e = PVX_OK;
    while (e == PVX_OK && bs->n < n)
        e = map_buffer(s, bs, d);
    PVX_THEN(e, cap_lend_new(n, SPARE, s->c.camera, &lend_ops, bs, &s->lend));
    if (e != PVX_OK) {
        v4l2_free_buffers(bs);
        return e;
    }
    s->buffers = bs;
    if (lend)
        return PVX_OK;
    CAP_LOG(PVX_LOG_INFO, &s->c, "v4l2", "copied",
            "%u buffers of the driver for %u frames: images are copied", n, want);
    size_t most = 0;
    for (unsigned i = 0; i < n; i++)
        most = bs->at[i].bytes > most ? bs->at[i].bytes : most;
    return cap_bufpool_of(&s->c, want, most, &s->pool);
}

/* ---- the camera's thread ---------------------------------------------------------------------- */

static void v4l2_count(struct source *s, enum cap_count what, uint64_t n)
{
    s->sink.count(s->sink.ctx, s->c.camera, what, n);
}

/* 0, or errno. */
static int dequeue(struct source *s, struct filled *out)
{
    struct v4l2_plane plane;
    struct v4l2_buffer b = v4l2_empty(s->dev.type, 0, &plane);
    if (v4l_call(s->dev.fd, VIDIOC_DQBUF, &b) != 0)
        return errno != 0 ? errno : EIO;
    if (b.index >= s->buffers->n)
        return EIO;
    bool mplane = v4l_mplane(&s->dev);
    size_t used = mplane ? plane.bytesused : b.bytesused;
    size_t offset = mplane ? plane.data_offset : 0, room = s->buffers->at[b.index].bytes;
    bool fits = used <= room && offset <= used;
    *out = (struct filled){.index = b.index,
                           .flags = b.flags,
                           .sequence = b.sequence,
                           .offset = fits ? offset : 0,
                           .bytes = fits ? used - offset : 0,
                           .stamp_ns = (int64_t)b.timestamp.tv_sec * PVX_NS_PER_S +
                                       b.timestamp.tv_usec * 1000};
    return 0;
}

/* Number of the next good frame.  Counts the frames missing before it. */
static uint64_t v4l2_number(struct source *s, uint32_t counter)
{
    uint64_t gap, id = cap_numbering_next(&s->sequence, counter, &gap);
    if (gap > 0)
        v4l2_count(s, CAP_ID_GAP, gap);
    return id;
}

/* Time of exposure on CLOCK_MONOTONIC; 0 = not known. */
static int64_t v4l2_exposure_time(struct source *s, const struct filled *b, int64_t arrival_mono)
{
    bool mono = (b->flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
    bool start = (b->flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK) == V4L2_BUF_FLAG_TSTAMP_SRC_SOE;
    int64_t off = b->stamp_ns - arrival_mono;
    bool good = mono && b->stamp_ns > 0 && off > -STAMP_MAX && off < STAMP_MAX;
    if (!s->stamped || (!good && !s->odd_stamp)) {
        s->stamped = true;
        s->odd_stamp = !good;
        if (good)
            CAP_DEBUG(&s->c, "v4l2", "stamps of the %s%s",
                      start ? "start of exposure" : "end of the frame",
                      !start && s->exposure_us > 0 ? ", moved back by the exposure" : "");
        else
            CAP_LOG(PVX_LOG_WARN, &s->c, "v4l2", "odd_stamps",
                    "%s: the time of arrival is used, which is late by the readout and jitters",
                    mono ? "its driver's time stamps are off by more than 10 s"
                         : "its driver does not say which clock its time stamps are of");
    }
    if (!good)
        return 0;
    return start || isnan(s->exposure_us) ? b->stamp_ns
                                          : b->stamp_ns - llrint(s->exposure_us * 1e3);
}

/* The frame for a full buffer; NULL: none is free.  *lent: the frame holds the buffer. */
static struct cap_frame *v4l2_frame_for(struct source *s, const struct filled *b, bool *lent)
{
    const unsigned char *data = (const unsigned char *)s->buffers->at[b->index].mem + b->offset;
    struct cap_frame *f;
    *lent = false;
    if (s->pool != NULL) {
        f = cap_bufpool_get(s->pool);
        if (f != NULL)
            memcpy(cap_bufpool_memory(f), data, b->bytes);
    } else {
        f = cap_lend_out(s->lend, b->index);
        *lent = f != NULL;
        if (f != NULL)
            f->img.data = data;
    }
    return f;
}

static void v4l2_deliver(struct source *s, const struct filled *b)
{
    int64_t real = 0, mono = 0;
    pvx_now_both(&real, &mono);
    if ((b->flags & V4L2_BUF_FLAG_ERROR) != 0 || b->bytes == 0) {
        s->sequence.bad++;
        cap_lend_back(s->lend, b->index);
        v4l2_count(s, CAP_INCOMPLETE, 1);
        return;
    }
    uint64_t id = v4l2_number(s, b->sequence);
    int64_t exposure = v4l2_exposure_time(s, b, mono);
    bool lent;
    struct cap_frame *f = v4l2_frame_for(s, b, &lent);
    if (!lent)
        cap_lend_back(s->lend, b->index);
    if (f == NULL) {
        v4l2_count(s, CAP_UNDERRUN, 1);
        return;
    }
    f->img.size = b->bytes;
    f->img.width = s->layout.width;
    f->img.height = s->layout.height;
    f->img.stride = s->layout.stride;
    f->img.fmt = s->layout.fmt;
    f->img.yuv = s->layout.yuv;
    f->id = id;
    f->t_device_ns = exposure;
    f->exposure_us = s->exposure_us;
    f->gain = s->gain;
    f->t_arrival_ns = real;
    f->t_arrival_mono_ns = mono;
    s->sink.push(s->sink.ctx, f);
}

/* Deliver all buffers that are ready.  Returns 0 if the device goes on, else its errno. */
static int v4l2_drain(struct source *s, bool *any)
{
    struct filled b = {0};
    int err;
    *any = false;
    while ((err = dequeue(s, &b)) == 0) {
        *any = true;
        v4l2_deliver(s, &b);
        struct pollfd stop = {.fd = s->wake, .events = POLLIN};
        if (poll(&stop, 1, 0) > 0)
            return 0;
    }
    return err == EAGAIN ? 0 : err;
}

static void *camera_thread(void *arg)
{
    struct source *s = arg;
    struct sched_param rt = {.sched_priority = RT_PRIORITY};
    if (pthread_setschedparam(pthread_self(), SCHED_RR, &rt) != 0)
        LOG_D(CAPTURE, "camera %s: no real-time priority for its thread", s->name);
    for (;;) {
        struct pollfd p[2] = {{.fd = s->wake, .events = POLLIN},
                              {.fd = s->dev.fd, .events = POLLIN}};
        bool any;
        poll(p, 2, LOOK_MS);
        if (p[0].revents != 0)
            return NULL;
        cap_lend_retry(s->lend);
        int err = v4l2_drain(s, &any);
        if (err == 0 && !any && (p[1].revents & (POLLERR | POLLHUP | POLLNVAL)) != 0)
            err = EIO;
        if (err != 0) {
            CAP_DEBUG(&s->c, "v4l2", "%s: %s", s->dev.node, strerror(err));
            s->sink.event(s->sink.ctx, s->c.camera, CAP_EV_LOST);
            return NULL;
        }
        if (!any && p[1].revents != 0)
            poll(p, 1, NAP_MS);
    }
}

/* ---- operations ------------------------------------------------------------------------------- */

static void v4l2_close(cap_source **sp)
{
    struct source *s = (struct source *)*sp;
    if (s == NULL)
        return;
    *sp = NULL;
    if (s->lend != NULL) {
        /* Memory that the consumer still uses stays mapped.  The device is free for the next user. */
        struct v4l2_requestbuffers none = {.type = s->dev.type, .memory = V4L2_MEMORY_MMAP};
        v4l_call(s->dev.fd, VIDIOC_REQBUFS, &none);
        cap_lend_close(&s->lend);
    }
    cap_bufpool_unref(&s->pool);
    v4l_close(&s->dev);
    if (s->wake >= 0)
        close(s->wake);
    free(s->uri);
    free(s->name);
    free(s);
}

static pvx_err v4l2_open(const struct cap_source_config *c, cap_source **out, struct pvx_diag *d)
{
    *out = NULL;
    struct source *s = pvx_calloc(1, sizeof *s);
    PVX_NEED(s);
    s->base.ops = &cap_source_v4l2;
    s->dev.fd = -1;
    s->wake = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    s->c = *c;
    s->c.uri = s->uri = strdup(c->uri);
    s->c.name = s->name = strdup(c->name != NULL ? c->name : "?");
    pvx_err e = s->uri == NULL || s->name == NULL || s->wake < 0 ? PVX_ENOMEM : PVX_OK;
    PVX_THEN(e, v4l_open(&s->c, &s->dev, d));
    PVX_THEN(e, v4l_set_layout(&s->c, &s->dev, &s->layout, d));
    PVX_THEN(e, v4l_set_controls(&s->c, &s->dev, d));
    s->c.features = NULL; /* borrowed for the call */
    s->c.n_features = 0;
    PVX_THEN(e, v4l2_make_buffers(s, d));
    cap_source *base = &s->base;
    if (e != PVX_OK) {
        v4l2_close(&base);
        return e;
    }
    s->exposure_us = v4l_fixed_exposure_us(&s->dev);
    s->gain = v4l_fixed_gain(&s->dev);
    v4l_serial(&s->dev, s->serial, sizeof s->serial);
    CAP_DEBUG(&s->c, "v4l2", "%s, %s: %s %dx%d, %.4g Hz, %u buffers", s->dev.node, s->dev.card,
              cap_pixfmt_name(s->layout.fmt), s->layout.width, s->layout.height, s->layout.fps,
              s->buffers->n);
    *out = base;
    return PVX_OK;
}

static void end_stream(struct source *s)
{
    int type = (int)s->dev.type;
    cap_lend_run(s->lend, false);
    v4l_call(s->dev.fd, VIDIOC_STREAMOFF, &type);
    s->streaming = false;
}

static pvx_err v4l2_start(cap_source *base, const struct cap_sink *sink, struct pvx_diag *d)
{
    struct source *s = (struct source *)base;
    int type = (int)s->dev.type;
    uint64_t old;
    s->sink = *sink;
    s->stamped = s->odd_stamp = false;
    s->sequence = (struct cap_numbering){0};
    while (read(s->wake, &old, sizeof old) > 0)
        ;
    cap_lend_run(s->lend, true);
    errno = EIO;
    pvx_err e = PVX_OK;
    if (cap_lend_retry(s->lend) > 0)
        e = v4l_fail(&s->c, s->dev.node, "VIDIOC_QBUF", d);
    else if (v4l_call(s->dev.fd, VIDIOC_STREAMON, &type) != 0)
        e = v4l_fail(&s->c, s->dev.node, "VIDIOC_STREAMON", d);
    else if (pthread_create(&s->thread, NULL, camera_thread, s) != 0)
        e = CAP_FAIL(&s->c, "v4l2", d, PVX_EIO, "cannot start its thread");
    if (e != PVX_OK) {
        end_stream(s);
        return e;
    }
    char name[16];
    snprintf(name, sizeof name, "v4l2-%u", s->c.camera);
    pthread_setname_np(s->thread, name);
    s->streaming = true;
    return PVX_OK;
}

static void v4l2_health(cap_source *base, struct cap_health *out)
{
    *out = cap_health_unknown;
    memcpy(out->serial, ((struct source *)base)->serial, sizeof out->serial);
}

static void v4l2_stop(cap_source *base)
{
    struct source *s = (struct source *)base;
    if (!s->streaming)
        return;
    uint64_t one = 1;
    while (write(s->wake, &one, sizeof one) < 0 && errno == EINTR)
        ;
    pthread_join(s->thread, NULL);
    end_stream(s);
}

const struct cap_source_ops cap_source_v4l2 = {
    .scheme = "v4l2",
    .help = "webcam or other V4L2 camera: usb-SERIAL, bus, card name, link under /dev/v4l, or node "
            "(/dev/video0); `pyrovox cameras v4l2` says which",
    .clock = CAP_CLOCK_MONO,
    .open = v4l2_open,
    .start = v4l2_start,
    .health = v4l2_health,
    .stop = v4l2_stop,
    .close = v4l2_close,
    .list = v4l_list,
};
