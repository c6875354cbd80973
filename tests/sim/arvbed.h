/* arvbed.h - bed of the tests of the aravis: source against GigE cameras of our own: a private
 * network, cameras whose images carry their number, and a sink that keeps what comes. */
#ifndef ARVBED_H
#define ARVBED_H
#include <pthread.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "capture/backends.h"
#include "capture/rig/capture.h"
#include "capture/gevsim/gvcam.h"
#include "capture/gevsim/netns.h"
#include "tests/t.h"

#define BED_CAMERAS 4
#define BED_RING    64
#define BED_W       160
#define BED_H       120
#define BED_BYTES   ((size_t)BED_W * BED_H)
#define BED_KEEP    512
#define MS          PVX_NS_PER_MS

static const char *const bed_address[BED_CAMERAS] = {"127.0.0.2", "127.0.0.3", "127.0.0.4",
                                                     "127.0.0.5"};
static unsigned char *bed_image[BED_CAMERAS][BED_RING]; /* Mono8; bytes 0, 1: number, camera */
static cap_gvnet *bed_net;
static cap_gvcam *bed_cam[BED_CAMERAS];
static double bed_ring_fps = 25;
static bool bed_usable;

#define NEED_BED()   \
    if (!bed_usable) \
    T_SKIP("no private network and no addresses 127.0.0.2 to 127.0.0.5 here")

static struct cap_gvcam_config bed_config(int c)
{
    static const char *const serial[BED_CAMERAS] = {"T00", "T01", "T02", "T03"};
    return (struct cap_gvcam_config){.address = bed_address[c],
                                     .serial = serial[c],
                                     .fmt = CAP_GREY8,
                                     .width = BED_W,
                                     .height = BED_H,
                                     .ring = (const void *const *)bed_image[c],
                                     .n_ring = BED_RING,
                                     .ring_fps = bed_ring_fps,
                                     .ptp_settle_ms = 300,
                                     .reboot_s = 1};
}

/* Kill the camera if it is there, and start it as configured.  The kernel gives its port free when the
 * thread that polled it has seen that it is closed. */
static void bed_restart(int c, const struct cap_gvcam_config *config)
{
    pvx_err e = PVX_EBUSY;
    cap_gvcam_free(&bed_cam[c]);
    for (int k = 0; k < 100 && e == PVX_EBUSY; k++) {
        struct pvx_diag d = {""};
        if (k > 0)
            usleep(20000);
        e = cap_gvcam_new(bed_net, config, &bed_cam[c], &d);
        if (e != PVX_OK && e != PVX_EBUSY)
            printf("  %s\n", pvx_diag_text(&d, e));
    }
    T_EQ_I(e, PVX_OK);
    if (e != PVX_OK)
        exit(1); /* nothing here works without it */
}

/* All cameras new, with images of so many a second. */
__attribute__((unused)) static void bed_all(double ring_fps)
{
    bed_ring_fps = ring_fps;
    for (int c = 0; c < BED_CAMERAS; c++) {
        struct cap_gvcam_config config = bed_config(c);
        bed_restart(c, &config);
    }
}

static void bed_open(void)
{
    struct pvx_diag d = {""};
    pvx_log_set_level(PVX_LOG_ERROR);
    pvx_err e = cap_netns_enter(BED_CAMERAS, &d); /* still one thread */
    bed_usable = e == PVX_OK || cap_netns_have(bed_address[0], BED_CAMERAS);
    if (!bed_usable)
        printf("  %s\n", pvx_diag_text(&d, e));
    for (int c = 0; c < BED_CAMERAS; c++)
        for (int i = 0; i < BED_RING; i++) {
            unsigned char *p = bed_image[c][i] = malloc(BED_BYTES);
            for (size_t k = 0; k < BED_BYTES; k++)
                p[k] = (unsigned char)(t_rand() >> 56);
            p[0] = (unsigned char)i;
            p[1] = (unsigned char)c;
        }
    if (bed_usable && cap_gvnet_new(&bed_net, &d) != PVX_OK) {
        printf("  %s\n", d.text);
        exit(1); /* the network is ours: a fault, not a reason to skip */
    }
}

static void bed_close(void)
{
    for (int c = 0; c < BED_CAMERAS; c++) {
        cap_gvcam_free(&bed_cam[c]);
        for (int i = 0; i < BED_RING; i++)
            free(bed_image[c][i]);
    }
    cap_gvnet_free(&bed_net);
}

__attribute__((unused)) static struct cap_gvcam_stats bed_stats(int c)
{
    struct cap_gvcam_stats st;
    cap_gvcam_stats(bed_cam[c], &st);
    return st;
}

__attribute__((unused)) static void bed_fault(int c, struct cap_gvcam_fault f)
{
    cap_gvcam_set_fault(bed_cam[c], &f);
}

/* ---- the source ------------------------------------------------------------------------------- */

static const struct cap_source_ops *const ops = &cap_source_aravis;

static struct cap_source_config bed_source(int c)
{
    static const char *const name[BED_CAMERAS] = {"a", "b", "c", "d"};
    return (struct cap_source_config){.uri = bed_address[c],
                                      .name = name[c],
                                      .camera = (uint32_t)c,
                                      .width = BED_W,
                                      .height = BED_H,
                                      .fmt = CAP_GREY8,
                                      .fps = bed_ring_fps,
                                      .buffers = 64,
                                      .exposure_us = -1,
                                      .gain = -1};
}

/* Is it, to the last byte, the image that it says it is?  Its number, -1 = no. */
static int bed_truth(const struct cap_frame *f, int c)
{
    if (f->img.size != BED_BYTES || f->img.width != BED_W || f->img.height != BED_H)
        return -1;
    int i = ((const unsigned char *)f->img.data)[0];
    return i < BED_RING && memcmp(f->img.data, bed_image[c][i], BED_BYTES) == 0 ? i : -1;
}

struct box {
    pthread_mutex_t lock;
    pthread_cond_t change;
    struct cap_frame *frame[BED_KEEP];
    int n;
    uint64_t count[CAP_N_COUNT];
    int lost, readings;
    int64_t device_ns, mono_ns, bound_ns; /* last reading of the clock */
};

static void on_push(void *ctx, struct cap_frame *f)
{
    struct box *b = ctx;
    pthread_mutex_lock(&b->lock);
    bool room = b->n < BED_KEEP;
    if (room)
        b->frame[b->n++] = f;
    pthread_cond_broadcast(&b->change);
    pthread_mutex_unlock(&b->lock);
    if (!room)
        cap_frame_release(f);
}
static void on_event(void *ctx, uint32_t camera, enum cap_event ev)
{
    struct box *b = ctx;
    (void)camera;
    pthread_mutex_lock(&b->lock);
    b->lost += ev == CAP_EV_LOST;
    pthread_cond_broadcast(&b->change);
    pthread_mutex_unlock(&b->lock);
}
static void on_count(void *ctx, uint32_t camera, enum cap_count what, uint64_t n)
{
    struct box *b = ctx;
    (void)camera;
    pthread_mutex_lock(&b->lock);
    b->count[what] += n;
    pthread_cond_broadcast(&b->change);
    pthread_mutex_unlock(&b->lock);
}
static void on_clock(void *ctx, uint32_t camera, int64_t device_ns, int64_t mono_ns,
                     int64_t bound_ns)
{
    struct box *b = ctx;
    (void)camera;
    pthread_mutex_lock(&b->lock);
    b->readings++;
    b->device_ns = device_ns;
    b->mono_ns = mono_ns;
    b->bound_ns = bound_ns;
    pthread_cond_broadcast(&b->change);
    pthread_mutex_unlock(&b->lock);
}

struct session {
    struct box box;
    cap_source *src;
    int cam;
    uint64_t good, first_id, last_id;
    int64_t last_stamp;
    int last_image;
};

__attribute__((unused)) static bool begin(struct session *s, const struct cap_source_config *c)
{
    memset(s, 0, sizeof *s);
    pthread_mutex_init(&s->box.lock, NULL);
    pthread_cond_init(&s->box.change, NULL);
    s->cam = (int)c->camera;
    struct pvx_diag d = {""};
    struct cap_sink sink = {
        .push = on_push, .event = on_event, .count = on_count, .ctx = &s->box, .clock = on_clock};
    pvx_err e = ops->open(c, &s->src, &d);
    if (e == PVX_OK)
        e = ops->start(s->src, &sink, &d);
    T_EQ_S(d.text, "");
    T_EQ_I(e, PVX_OK);
    return e == PVX_OK;
}

__attribute__((unused)) static void end(struct session *s)
{
    if (s->src != NULL) {
        ops->stop(s->src);
        ops->close(&s->src);
    }
    for (int i = 0; i < s->box.n; i++)
        cap_frame_release(s->box.frame[i]);
    pthread_mutex_destroy(&s->box.lock);
    pthread_cond_destroy(&s->box.change);
}

/* Oldest frame, or NULL after 10 s. */
__attribute__((unused)) static struct cap_frame *next_frame(struct box *b)
{
    struct timespec until;
    clock_gettime(CLOCK_REALTIME, &until);
    until.tv_sec += 10;
    struct cap_frame *f = NULL;
    pthread_mutex_lock(&b->lock);
    int e = 0;
    while (b->n == 0 && e == 0)
        e = pthread_cond_timedwait(&b->change, &b->lock, &until);
    if (b->n > 0) {
        f = b->frame[0];
        memmove(b->frame, b->frame + 1, (size_t)--b->n * sizeof(b->frame[0]));
    }
    pthread_mutex_unlock(&b->lock);
    return f;
}

__attribute__((unused)) static uint64_t counted(struct box *b, enum cap_count what)
{
    pthread_mutex_lock(&b->lock);
    uint64_t n = b->count[what];
    pthread_mutex_unlock(&b->lock);
    return n;
}

/* Next frame: its bytes are those of one of the camera's images, number and stamp go up.  False = none
 * came. */
__attribute__((unused)) static bool take_good(struct session *s)
{
    struct cap_frame *f = next_frame(&s->box);
    T_OK(f != NULL);
    if (f == NULL)
        return false;
    s->last_image = bed_truth(f, s->cam);
    T_OK(s->last_image >= 0);
    if (s->good++ > 0) {
        T_OK(f->id > s->last_id);
        T_OK(f->t_device_ns > s->last_stamp);
    } else {
        s->first_id = f->id;
    }
    s->last_id = f->id;
    s->last_stamp = f->t_device_ns;
    cap_frame_release(f);
    return true;
}
#endif
