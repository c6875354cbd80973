#include "tests/vm/uvc/camera.h"

#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/mem.h"
#include "base/random.h"
#include "tests/vm/uvc/descriptors.h"
#include "tests/vm/uvc/usbip.h"

#define ATTACH      "/sys/devices/platform/vhci_hcd.0/attach"
#define HIGH_SPEED  3
#define HEADER      12 /* bytes of a payload's header */
#define PROBE       26 /* bytes of UVC 1.0's video probe and commit controls */
#define NO_FRAME_MS 200

enum { SET_CUR = 0x01, GET_CUR = 0x81, GET_MIN, GET_MAX, GET_RES, GET_LEN, GET_INFO, GET_DEF };

/* A control of the camera: unit and selector as in the specification. */
struct knob {
    uint8_t unit, selector, bytes;
    int min, max, step, def;
};
enum { EXPOSURE_MODE, EXPOSURE, BRIGHTNESS, GAIN, N_KNOBS };
static const struct knob knobs[N_KNOBS] = {
    [EXPOSURE_MODE] = {UVC_CAMERA_TERMINAL, 2, 1, 0, 0, 1 | 8, 8}, /* bits: manual, aperture */
    [EXPOSURE] = {UVC_CAMERA_TERMINAL, 4, 4, 1, 10000, 1, 156},
    [BRIGHTNESS] = {UVC_PROCESSING_UNIT, 2, 2, -64, 64, 1, 0},
    [GAIN] = {UVC_PROCESSING_UNIT, 4, 2, 0, 100, 1, 10},
};

struct uvc_camera {
    struct uvc_camera_config c;
    pthread_t thread;
    bool plugged;
    int fd;

    pthread_mutex_t lock; /* of these: */
    double fault[UVC_N_FAULTS];
    struct uvc_camera_stats stats;

    /* the thread's */
    struct usbip usb;
    uint8_t probe[PROBE], commit[PROBE];
    int knob[N_KNOBS];
    bool streaming, fid, zero_packet;
    int64_t due;
    uint64_t sent;    /* since the start */
    uint8_t *payload; /* [room] */
    size_t room, payload_n, payload_at;
    uint64_t random;
};

/* ---- video class: probe, commit and the knobs --------------------------------------------------- */

static enum uvc_format format_of(const uint8_t *probe)
{
    return (enum uvc_format)(probe[2] - 1);
}

static int64_t period_ns(const struct uvc_camera *c)
{
    return (int64_t)uvc_get32(c->commit + 4) * 100;
}

/* Make what the host proposes something that the camera can do. */
static void settle(const struct uvc_camera *c, uint8_t *p)
{
    if (uvc_get32(p + 4) == 0)
        uvc_put32(p + 4, uvc_default_interval());
    if (p[2] < 1 || p[2] > UVC_N_FORMATS)
        p[2] = UVC_MJPG + 1;
    if (p[3] < 1 || p[3] > UVC_N_SIZES)
        p[3] = 1;
    uint32_t wanted = uvc_get32(p + 4), best = uvc_intervals[0];
    for (int k = 1; k < UVC_N_INTERVALS; k++)
        if (llabs((int64_t)uvc_intervals[k] - wanted) < llabs((int64_t)best - wanted))
            best = uvc_intervals[k];
    uint32_t max = (uint32_t)uvc_images_max(c->c.images, format_of(p), p[3] - 1);
    uvc_put32(p + 4, best);
    uvc_put32(p + 18, max);
    uvc_put32(p + 22, max + HEADER); /* a frame is one payload */
}

static void start_streaming(struct uvc_camera *c)
{
    int64_t now = pvx_now_mono(), period = period_ns(c);
    c->streaming = true;
    c->sent = 0;
    c->due = (now / period + 1) * period;
    c->payload_n = 0;
    c->zero_packet = false;
    pthread_mutex_lock(&c->lock);
    c->stats.started++;
    pthread_mutex_unlock(&c->lock);
}

/* A bulk camera is told to stop by a CLEAR_FEATURE of its endpoint. */
static void stop_streaming(struct uvc_camera *c)
{
    c->streaming = false;
    c->payload_n = 0;
    c->zero_packet = false;
}

static int video_stream(struct uvc_camera *c, int request, int selector, const uint8_t *data,
                        size_t n, uint8_t *answer)
{
    if (selector != 1 && selector != 2)
        return -EPIPE;
    uint8_t *p = selector == 1 ? c->probe : c->commit;
    if (request == SET_CUR) {
        memset(p, 0, PROBE);
        memcpy(p, data, n < PROBE ? n : PROBE);
        settle(c, p);
        if (selector == 2)
            start_streaming(c);
        return 0;
    }
    switch (request) {
    case GET_LEN: uvc_put16(answer, PROBE); return 2;
    case GET_INFO: answer[0] = 3; return 1;
    case GET_CUR:
    case GET_MIN:
    case GET_MAX:
    case GET_DEF:
        memcpy(answer, p, PROBE);
        if (request == GET_DEF)
            answer[2] = answer[3] = 1;
        if (request == GET_DEF)
            uvc_put32(answer + 4, uvc_default_interval());
        else if (request != GET_CUR)
            uvc_put32(answer + 4, uvc_intervals[request == GET_MAX ? UVC_N_INTERVALS - 1 : 0]);
        settle(c, answer);
        return PROBE;
    default: return -EPIPE;
    }
}

static int put_number(int v, int bytes, uint8_t *out)
{
    for (int i = 0; i < bytes; i++)
        out[i] = (uint8_t)((uint32_t)v >> 8 * i);
    return bytes;
}

static int get_number(const uint8_t *p, int bytes)
{
    uint32_t v = 0;
    for (int i = 0; i < bytes; i++)
        v |= (uint32_t)p[i] << 8 * i;
    return bytes == 2 ? (int16_t)v : (int)v;
}

static void say_knobs(struct uvc_camera *c)
{
    pthread_mutex_lock(&c->lock);
    c->stats.exposure_100us = c->knob[EXPOSURE];
    c->stats.gain = c->knob[GAIN];
    c->stats.brightness = c->knob[BRIGHTNESS];
    pthread_mutex_unlock(&c->lock);
}

static int turn_knob(struct uvc_camera *c, int request, int unit, int selector, const uint8_t *data,
                     size_t n, uint8_t *answer)
{
    int i = 0;
    while (i < N_KNOBS && (knobs[i].unit != unit || knobs[i].selector != selector))
        i++;
    if (i == N_KNOBS)
        return -EPIPE;
    const struct knob *k = &knobs[i];
    switch (request) {
    case SET_CUR:
        if (n < k->bytes)
            return -EPIPE;
        c->knob[i] = get_number(data, k->bytes);
        say_knobs(c);
        pthread_mutex_lock(&c->lock);
        c->stats.turned++;
        c->stats.turned_at = c->sent;
        pthread_mutex_unlock(&c->lock);
        return 0;
    case GET_CUR: return put_number(c->knob[i], k->bytes, answer);
    case GET_MIN: return put_number(k->min, k->bytes, answer);
    case GET_MAX: return put_number(k->max, k->bytes, answer);
    case GET_RES: return put_number(k->step, k->bytes, answer);
    case GET_DEF: return put_number(k->def, k->bytes, answer);
    case GET_LEN: return put_number(k->bytes, 2, answer);
    case GET_INFO: return put_number(3, 1, answer); /* may be got and set */
    default: return -EPIPE;
    }
}

static int standard(struct uvc_camera *c, const uint8_t *s, uint8_t *answer)
{
    enum {
        GET_STATUS = 0,
        CLEAR_FEATURE = 1,
        SET_FEATURE = 3,
        GET_DESCRIPTOR = 6,
        GET_CONFIGURATION = 8,
        SET_CONFIGURATION = 9,
        GET_INTERFACE = 10,
        SET_INTERFACE = 11,
    };
    const struct uvc_identity id = {"Pyrovox", c->c.name, c->c.serial};
    switch (s[1]) {
    case GET_DESCRIPTOR: return uvc_descriptor(s[3], s[2], &id, c->c.images, answer);
    case GET_STATUS: answer[0] = answer[1] = 0; return 2;
    case GET_CONFIGURATION: answer[0] = 1; return 1;
    case GET_INTERFACE: answer[0] = 0; return 1;
    case CLEAR_FEATURE:
        if ((s[0] & 0x1f) == 2) /* of an endpoint */
            stop_streaming(c);
        return 0;
    case SET_FEATURE:
    case SET_CONFIGURATION:
    case SET_INTERFACE: return 0;
    default: return -EPIPE;
    }
}

static int control(void *ctx, const uint8_t s[8], const uint8_t *data, size_t n, uint8_t *answer)
{
    struct uvc_camera *c = ctx;
    if ((s[0] & 0x60) == 0)
        return standard(c, s, answer);
    if ((s[0] & 0x7f) != 0x21) /* class request to an interface */
        return -EPIPE;
    int selector = s[3], interface = s[4], unit = s[5];
    if (interface == 1)
        return video_stream(c, s[1], selector, data, n, answer);
    return turn_knob(c, s[1], unit, selector, data, n, answer);
}

/* ---- streaming ---------------------------------------------------------------------------------- */

static bool by_chance(struct uvc_camera *c, double share)
{
    return pvx_uniform(&c->random) < share;
}

static void fill_payload(struct uvc_camera *c, int64_t due, int64_t now, bool cut)
{
    const struct uvc_images *m = c->c.images;
    size_t at = (size_t)(due / period_ns(c)) % m->n;
    const struct uvc_bytes *b = &m->frame[format_of(c->commit)][c->commit[3] - 1][at];
    uint8_t *p = c->payload;
    p[0] = HEADER;
    p[1] = (uint8_t)(0x80 | 0x08 | 0x04 | 0x02 | (c->fid ? 1 : 0)); /* with SCR and PTS, last */
    c->fid = !c->fid;
    uvc_put32(p + 2, (uint32_t)(due * 48 / 1000)); /* 48 MHz */
    uvc_put32(p + 6, (uint32_t)(now * 48 / 1000));
    uvc_put16(p + 10, (unsigned)(now / PVX_NS_PER_MS) & 0x7ff);
    size_t n = cut ? b->n / 2 : b->n;
    memcpy(p + HEADER, b->data, n);
    c->payload_n = HEADER + n;
    c->payload_at = 0;
}

/* A frame is due: send it, or say why not. */
static void next_frame(struct uvc_camera *c)
{
    int64_t now = pvx_now_mono(), period = period_ns(c), due = c->due;
    if (now < due)
        return;
    c->due += (now - due) / period * period + period;
    due = c->due - period; /* the latest one, when the thread has overslept */
    pthread_mutex_lock(&c->lock);
    bool drop = c->fault[UVC_FREEZE] != 0 || by_chance(c, c->fault[UVC_DROP]);
    bool cut = by_chance(c, c->fault[UVC_CUT]), busy = c->payload_n > 0;
    c->stats.dropped += drop;
    c->stats.busy += !drop && busy;
    c->stats.cut += !drop && !busy && cut;
    c->stats.sent += !drop && !busy && !cut;
    c->stats.unlinked = c->usb.unlinked;
    pthread_mutex_unlock(&c->lock);
    c->sent += !drop && !busy;
    if (!drop && !busy)
        fill_payload(c, due, now, cut);
}

/* Into the transfers that wait, what there is of the frame.  A payload ends with a short packet, an
 * empty one if need be, or at its greatest size. */
static bool pump(struct uvc_camera *c)
{
    size_t room;
    while ((room = usbip_bulk_room(&c->usb)) > 0 && (c->payload_n > 0 || c->zero_packet)) {
        size_t n = c->zero_packet ? 0 : c->payload_n - c->payload_at;
        if (n > room)
            n = room;
        if (!usbip_bulk_answer(&c->usb, c->payload + c->payload_at, n))
            return false;
        c->payload_at += n;
        if (c->zero_packet) {
            c->zero_packet = false;
            continue;
        }
        if (c->payload_at == c->payload_n) {
            c->zero_packet = n == room && c->payload_n < uvc_get32(c->commit + 22);
            c->payload_n = c->payload_at = 0;
        }
    }
    return true;
}

static void *run(void *arg)
{
    struct uvc_camera *c = arg;
    for (;;) {
        int64_t left = c->streaming ? c->due - pvx_now_mono() : PVX_NS_PER_S;
        int ms = left <= 0 ? 0 : (int)(left / PVX_NS_PER_MS) + 1;
        struct pollfd p = {c->usb.fd, POLLIN, 0};
        int n = poll(&p, 1, ms < NO_FRAME_MS ? ms : NO_FRAME_MS);
        if (n < 0 && errno != EINTR)
            break;
        if (n > 0 && !usbip_serve(&c->usb))
            break;
        if (c->streaming)
            next_frame(c);
        if (!pump(c))
            break;
    }
    return NULL;
}

/* ---- plugging ----------------------------------------------------------------------------------- */

static pvx_err attach(struct uvc_camera *c, int fd, struct pvx_diag *d)
{
    char order[64];
    int n = snprintf(order, sizeof order, "%u %d %u %d", c->c.port, fd, 0x10002 + c->c.port,
                     HIGH_SPEED);
    for (int64_t end = pvx_now_mono() + 10 * PVX_NS_PER_S;;) {
        int sys = open(ATTACH, O_WRONLY | O_CLOEXEC);
        if (sys < 0)
            return pvx_fail(d, pvx_err_from_errno(errno), ATTACH ": %s; modprobe vhci-hcd, as root",
                            strerror(errno));
        ssize_t put = write(sys, order, (size_t)n);
        int why = errno;
        close(sys);
        if (put == n)
            return PVX_OK;
        /* The port of a camera that was just pulled is free only after the kernel's clean-up. */
        if ((why != EBUSY && why != EINVAL) || pvx_now_mono() > end)
            return pvx_fail(d, pvx_err_from_errno(why), ATTACH ": port %u: %s", c->c.port,
                            strerror(why));
        pvx_sleep_until_mono(pvx_now_mono() + 20 * PVX_NS_PER_MS);
    }
}

static void reset(struct uvc_camera *c, int fd)
{
    c->usb = (struct usbip){.fd = fd, .control = control, .ctx = c};
    memset(c->probe, 0, sizeof c->probe);
    settle(c, c->probe);
    memcpy(c->commit, c->probe, sizeof c->commit);
    for (int i = 0; i < N_KNOBS; i++)
        c->knob[i] = knobs[i].def;
    say_knobs(c);
    stop_streaming(c);
}

pvx_err uvc_camera_plug(uvc_camera *c, struct pvx_diag *d)
{
    int pair[2], room = 1 << 20;
    if (c->plugged)
        return PVX_OK;
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, pair) != 0)
        return pvx_fail(d, PVX_EIO, "socketpair: %s", strerror(errno));
    (void)setsockopt(pair[0], SOL_SOCKET, SO_SNDBUF, &room, sizeof room);
    reset(c, pair[0]);
    pvx_err e = PVX_OK;
    if (pthread_create(&c->thread, NULL, run, c) != 0) {
        close(pair[0]);
        close(pair[1]);
        return pvx_fail(d, PVX_EIO, "no thread for camera %u", c->c.port);
    }
    c->plugged = true;
    c->fd = pair[0];
    e = attach(c, pair[1], d);
    close(pair[1]); /* the kernel has its own */
    if (e != PVX_OK)
        uvc_camera_unplug(c);
    return e;
}

void uvc_camera_unplug(uvc_camera *c)
{
    if (!c->plugged)
        return;
    shutdown(c->fd, SHUT_RDWR);
    pthread_join(c->thread, NULL);
    close(c->fd);
    c->plugged = false;
}

/* ---- the rest ----------------------------------------------------------------------------------- */

pvx_err uvc_camera_new(const struct uvc_camera_config *cfg, uvc_camera **out)
{
    *out = NULL;
    struct uvc_camera *c = pvx_calloc(1, sizeof *c);
    if (c == NULL)
        return PVX_ENOMEM;
    c->c = *cfg;
    c->random = (cfg->seed + 1) * 0x9E3779B97F4A7C15u;
    pthread_mutex_init(&c->lock, NULL);
    c->room = HEADER + uvc_images_max(cfg->images, UVC_YUYV, 0);
    for (size_t i = 0; i < cfg->images->n; i++) /* a JPEG of noise may be larger than its pixels */
        for (int s = 0; s < UVC_N_SIZES; s++)
            if (HEADER + cfg->images->frame[UVC_MJPG][s][i].n > c->room)
                c->room = HEADER + cfg->images->frame[UVC_MJPG][s][i].n;
    c->payload = pvx_calloc(c->room, 1);
    if (c->payload == NULL) {
        uvc_camera_free(&c);
        return PVX_ENOMEM;
    }
    *out = c;
    return PVX_OK;
}

void uvc_camera_fault(uvc_camera *c, enum uvc_fault f, double value)
{
    pthread_mutex_lock(&c->lock);
    c->fault[f] = value;
    pthread_mutex_unlock(&c->lock);
}

void uvc_camera_stats(uvc_camera *c, struct uvc_camera_stats *out)
{
    pthread_mutex_lock(&c->lock);
    *out = c->stats;
    pthread_mutex_unlock(&c->lock);
    out->plugged = c->plugged;
}

void uvc_camera_free(uvc_camera **cp)
{
    uvc_camera *c = *cp;
    if (c == NULL)
        return;
    *cp = NULL;
    uvc_camera_unplug(c);
    pthread_mutex_destroy(&c->lock);
    free(c->payload);
    free(c);
}
