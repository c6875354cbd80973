#include "tests/lib/simgv.h"

#include <arpa/inet.h>
#include <arv.h>
#include <errno.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "base/mem.h"
#include "capture/gevsim/gvcam.h"
#include "base/random.h"
#include "tests/lib/have_addresses.h"
#include "tests/lib/simgv_poll.h"

#define GVCP_PORT     3956
#define REG_USER_NAME 0xe8  /* GigE Vision bootstrap register, 16 bytes */
#define FIRST_ID      65401 /* as the stock fake: the wrap comes soon */

#define TRIGGER_HZ 500.0 /* how often a software trigger is looked for */

struct simgv {
    struct simgv_config c;
    const void **ring;
    char *strings[3];
    size_t bytes; /* of one image */
    ArvGvFakeCamera *gv;
    _Atomic(ArvFakeCamera *) cam; /* set after the camera's thread has begun */
    struct simgv_pacer pacer;

    pthread_mutex_t lock; /* fault, stats, ending */
    bool ending;
    struct simgv_fault fault;
    struct simgv_stats stats;

    /* The camera's thread alone: */
    uint16_t id;
    int64_t last_moment_ns;
    int64_t frozen_index, frozen_stamp_ns;
    bool frozen, warned;
    double loss; /* last set in the fake */
    uint64_t rng;
};

/* What one frame shows and says. */
struct shot {
    int64_t index;
    int64_t moment_ns; /* what it counts as exposed at: strictly increasing */
    int64_t stamp_ns;
    int64_t wait_ns; /* before it is sent */
};

static uint32_t reg(ArvFakeCamera *cam, uint32_t address)
{
    uint32_t v = 0;
    arv_fake_camera_read_register(cam, address, &v);
    return v;
}

static bool triggered(ArvFakeCamera *cam)
{
    return reg(cam, ARV_FAKE_CAMERA_REGISTER_TRIGGER_MODE) == 1;
}

static int64_t frame_period_us(ArvFakeCamera *cam)
{
    return reg(cam, ARV_FAKE_CAMERA_REGISTER_ACQUISITION_FRAME_PERIOD_US);
}

static int64_t pace_us(void *ctx)
{
    struct simgv *s = ctx;
    ArvFakeCamera *cam = atomic_load(&s->cam);
    if (cam == NULL || arv_fake_camera_get_acquisition_status(cam) == 0 ||
        arv_fake_camera_get_control_channel_privilege(cam) == 0)
        return 0;
    return triggered(cam) ? (int64_t)(1e6 / TRIGGER_HZ) : frame_period_us(cam);
}

/* Free run: the tick that the frame belongs to, the ring's image there, and the delay fault as whole
 * periods (an earlier tick is sent now) plus a rest that is slept, so that the rate stays. */
static struct shot free_run(const struct simgv *s, int64_t period_ns, double delay_ms)
{
    int64_t now = pvx_now_real();
    int64_t tick = now - now % period_ns;
    int64_t delay = (int64_t)(delay_ms * 1e6);
    int64_t periods = (int64_t)((double)delay / (double)period_ns + 0.2);
    int64_t rest = delay - periods * period_ns;
    tick -= periods * period_ns;
    struct shot shot = {.wait_ns = rest > 0 ? rest : 0};
    if ((double)period_ns * s->c.ring_fps < 0.999e9) { /* faster than the ring */
        shot.index = cap_gvcam_index(tick, s->c.ring_fps);
        shot.moment_ns = shot.stamp_ns = tick;
    } else {
        long double at = (long double)tick * (long double)s->c.ring_fps / 1e9L;
        shot.index = (int64_t)floorl(at + 1e-6L);
        shot.moment_ns = (int64_t)llroundl((long double)shot.index * 1e9L / s->c.ring_fps);
        shot.stamp_ns = shot.moment_ns;
    }
    return shot;
}

static struct shot on_trigger(const struct simgv *s, double delay_ms)
{
    int64_t now = pvx_now_real();
    return (struct shot){.index = cap_gvcam_index(now, s->c.ring_fps),
                         .moment_ns = now,
                         .stamp_ns = now,
                         .wait_ns = (int64_t)(delay_ms * 1e6)};
}

static void copy_pixels(struct simgv *s, ArvBuffer *b, ArvPixelFormat want, int64_t index)
{
    static const struct {
        enum cap_pixfmt fmt;
        ArvPixelFormat arv;
        size_t bytes;
    } known[] = {{CAP_GREY8, ARV_PIXEL_FORMAT_MONO_8, 1},
                 {CAP_RGB8, ARV_PIXEL_FORMAT_RGB_8_PACKED, 3},
                 {CAP_BAYER_RG8, ARV_PIXEL_FORMAT_BAYER_RG_8, 1}};
    size_t px = 0;
    unsigned char *out = (unsigned char *)(uintptr_t)arv_buffer_get_data(b, NULL);
    int x, y, w, h;
    arv_buffer_get_image_region(b, &x, &y, &w, &h);
    /* Aravis has made sure that the buffer holds this much. */
    size_t size = (size_t)w * (size_t)h * ARV_PIXEL_FORMAT_BIT_PER_PIXEL(want) / 8;
    for (size_t i = 0; i < G_N_ELEMENTS(known); i++)
        if (known[i].fmt == s->c.fmt && known[i].arv == want)
            px = known[i].bytes;
    const unsigned char *in = s->ring[(size_t)(index % (int64_t)s->c.n_ring)];
    if (px != 0 && x == 0 && y == 0 && w == s->c.width && h == s->c.height) {
        memcpy(out, in, s->bytes);
        return;
    }
    memset(out, 0, size);
    if (px == 0) {
        if (!s->warned)
            LOG_W(SIM, "camera %s: the client wants pixel format 0x%08x, its images are %s: black",
                  s->c.address, (unsigned)want, cap_pixfmt_name(s->c.fmt));
        s->warned = true;
        return;
    }
    int cols = w < s->c.width - x ? w : s->c.width - x;
    for (int r = 0; r < h && r < s->c.height - y && cols > 0; r++)
        memcpy(out + (size_t)r * (size_t)w * px,
               in + ((size_t)(r + y) * (size_t)s->c.width + (size_t)x) * px, (size_t)cols * px);
}

/* The fake sends whatever comes out of the callback; with every packet lost, nothing is sent.  This is the
 * camera's thread: while the camera is let go, its reference would be the last, and it would join itself.  False:
 * so it cannot be set any more. */
static bool set_loss(struct simgv *s, double loss)
{
    pthread_mutex_lock(&s->lock);
    bool is_so = loss == s->loss || !s->ending;
    if (loss != s->loss && is_so)
        g_object_set(s->gv, "gvsp-lost-ratio", loss, NULL);
    if (is_so)
        s->loss = loss;
    pthread_mutex_unlock(&s->lock);
    return is_so;
}

static uint16_t next_id(struct simgv *s)
{
    uint16_t id = s->id;
    s->id = id == 65535 ? 1 : (uint16_t)(id + 1);
    return id;
}

static struct shot next_shot(struct simgv *s, const struct simgv_fault *f)
{
    ArvFakeCamera *cam = atomic_load(&s->cam);
    int64_t period_us = frame_period_us(cam);
    struct shot shot = triggered(cam) || period_us <= 0
                           ? on_trigger(s, f->delay_ms)
                           : free_run(s, period_us * 1000, f->delay_ms);
    if (f->freeze && !s->frozen) {
        s->frozen_index = shot.index;
        s->frozen_stamp_ns = shot.stamp_ns;
    }
    s->frozen = f->freeze;
    if (s->frozen) {
        shot.index = s->frozen_index;
        shot.stamp_ns = s->frozen_stamp_ns;
    }
    return shot;
}

/* Aravis calls this on the camera's thread for each frame, then sends the buffer. */
static void fill(ArvBuffer *b, void *user, guint32 exposure_us, guint32 gain, ArvPixelFormat fmt)
{
    struct simgv *s = user;
    (void)exposure_us, (void)gain;
    pthread_mutex_lock(&s->lock);
    struct simgv_fault f = s->fault;
    pthread_mutex_unlock(&s->lock);

    struct shot shot = next_shot(s, &f);
    /* The same moment twice: the camera's clock runs a trifle faster than the ring's, or a delay
     * was just switched on.  Nothing was exposed.  (A host clock set back by more is no such case.)  A
     * camera that is being let go sends the frame once more: receivers leave a stamp out that does not go up. */
    int64_t ahead = s->last_moment_ns - shot.moment_ns;
    if (ahead >= 0 && ahead < 10 * PVX_NS_PER_S && set_loss(s, 1))
        return;
    s->last_moment_ns = shot.moment_ns;
    bool dropped = f.drop > 0 && pvx_uniform(&s->rng) < f.drop;
    dropped = set_loss(s, dropped ? 1 : 0) && dropped;
    arv_buffer_set_frame_id(b, next_id(s));
    arv_buffer_set_timestamp(b, (guint64)shot.stamp_ns);
    pthread_mutex_lock(&s->lock);
    s->stats.dropped += dropped;
    pthread_mutex_unlock(&s->lock);
    if (dropped)
        return;
    copy_pixels(s, b, fmt, shot.index);
    if (shot.wait_ns > 0)
        pvx_sleep_until_mono(pvx_now_mono() + shot.wait_ns);
}

static pvx_err check(const struct simgv_config *c, struct pvx_diag *d)
{
    if (c->fmt != CAP_GREY8 && c->fmt != CAP_RGB8 && c->fmt != CAP_BAYER_RG8)
        return pvx_fail(d, PVX_EINVAL,
                        "simulated camera %s: format %s; Mono8, RGB8 and BayerRG8 "
                        "can be served",
                        c->address, cap_pixfmt_name(c->fmt));
    if (c->width < 1 || c->height < 1 || c->width > 16384 || c->height > 16384 || c->n_ring < 1 ||
        !(c->ring_fps > 0 && c->ring_fps <= 1000))
        return pvx_fail(d, PVX_EINVAL,
                        "simulated camera %s: image size 1 to 16384, at least one "
                        "image, rates up to 1000 Hz",
                        c->address);
    if (c->serial[0] == '\0' || strlen(c->serial) > SIMGV_NAME_MAX ||
        (c->user_name != NULL && strlen(c->user_name) > SIMGV_NAME_MAX))
        return pvx_fail(d, PVX_EINVAL,
                        "simulated camera %s: serial and name have at most %d "
                        "characters",
                        c->address, SIMGV_NAME_MAX);
    return PVX_OK;
}

/* The fake says neither that its address is foreign nor that its port is taken: ask first. */
static pvx_err probe_port(const char *address, uint32_t *address_be, struct pvx_diag *d)
{
    struct sockaddr_in sa = {.sin_family = AF_INET, .sin_port = htons(GVCP_PORT)};
    if (inet_pton(AF_INET, address, &sa.sin_addr) != 1)
        return pvx_fail(d, PVX_EINVAL, "simulated camera: '%s' is not an IPv4 address", address);
    *address_be = sa.sin_addr.s_addr;
    if (!have_addresses(address, 1))
        return pvx_fail(d, PVX_ENOENT,
                        "simulated camera %s: no interface of this host has that "
                        "address; use a private network (--private-net) or `sudo ip addr add %s/8 "
                        "dev lo`",
                        address, address);
    int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (fd < 0)
        return pvx_fail(d, PVX_EIO, "simulated camera %s: socket: %s", address, strerror(errno));
    int e = bind(fd, (struct sockaddr *)&sa, sizeof sa) == 0 ? 0 : errno;
    close(fd);
    if (e != 0)
        return pvx_fail(d, e == EADDRINUSE ? PVX_EBUSY : pvx_err_from_errno(e),
                        "simulated camera %s: UDP port %d: %s%s", address, GVCP_PORT, strerror(e),
                        e == EADDRINUSE ? " (another camera or simulation is there)" : "");
    return PVX_OK;
}

static void write_registers(const struct simgv *s, ArvFakeCamera *cam)
{
    static const uint32_t widths[] = {ARV_FAKE_CAMERA_REGISTER_SENSOR_WIDTH,
                                      ARV_FAKE_CAMERA_REGISTER_WIDTH};
    static const uint32_t heights[] = {ARV_FAKE_CAMERA_REGISTER_SENSOR_HEIGHT,
                                       ARV_FAKE_CAMERA_REGISTER_HEIGHT};
    for (size_t i = 0; i < G_N_ELEMENTS(widths); i++) {
        arv_fake_camera_write_register(cam, widths[i], (uint32_t)s->c.width);
        arv_fake_camera_write_register(cam, heights[i], (uint32_t)s->c.height);
    }
    ArvPixelFormat fmt = s->c.fmt == CAP_RGB8        ? ARV_PIXEL_FORMAT_RGB_8_PACKED
                         : s->c.fmt == CAP_BAYER_RG8 ? ARV_PIXEL_FORMAT_BAYER_RG_8
                                                     : ARV_PIXEL_FORMAT_MONO_8;
    arv_fake_camera_write_register(cam, ARV_FAKE_CAMERA_REGISTER_PIXEL_FORMAT, fmt);
    arv_fake_camera_write_register(cam, ARV_FAKE_CAMERA_REGISTER_ACQUISITION_FRAME_PERIOD_US,
                                   (uint32_t)(1e6 / s->c.ring_fps + 0.5));
    if (s->c.user_name != NULL)
        arv_fake_camera_write_memory(cam, REG_USER_NAME, (uint32_t)strlen(s->c.user_name) + 1,
                                     s->c.user_name);
    arv_fake_camera_set_trigger_frequency(cam, TRIGGER_HZ);
}

static pvx_err copy_config(struct simgv *s, const struct simgv_config *c)
{
    s->c = *c;
    s->bytes = cap_pixfmt_image(c->fmt, c->width, c->height);
    s->ring = pvx_calloc(c->n_ring, sizeof *s->ring);
    s->strings[0] = strdup(c->address);
    s->strings[1] = strdup(c->serial);
    s->strings[2] = strdup(c->user_name != NULL ? c->user_name : "");
    if (s->ring == NULL || s->strings[0] == NULL || s->strings[1] == NULL || s->strings[2] == NULL)
        return PVX_ENOMEM;
    memcpy(s->ring, c->ring, c->n_ring * sizeof *s->ring);
    s->c.ring = s->ring;
    s->c.address = s->strings[0];
    s->c.serial = s->strings[1];
    s->c.user_name = c->user_name != NULL ? s->strings[2] : NULL;
    return PVX_OK;
}

pvx_err simgv_new(const struct simgv_config *c, simgv **out, struct pvx_diag *d)
{
    *out = NULL;
    PVX_TRY(check(c, d));
    uint32_t address_be = 0;
    PVX_TRY(probe_port(c->address, &address_be, d));
    struct simgv *s = pvx_calloc(1, sizeof *s);
    if (s == NULL)
        return PVX_ENOMEM;
    pthread_mutex_init(&s->lock, NULL);
    s->id = FIRST_ID;
    s->rng = 0x9E3779B97F4A7C15u ^ address_be;
    s->pacer = (struct simgv_pacer){.address_be = address_be, .period_us = pace_us, .ctx = s};
    simgv_poll_add(&s->pacer);
    pvx_err e = copy_config(s, c);
    if (e == PVX_OK) {
        s->gv = arv_gv_fake_camera_new(s->c.address, s->c.serial);
        if (s->gv == NULL || !arv_gv_fake_camera_is_running(s->gv))
            e = pvx_fail(d, PVX_EIO, "simulated camera %s: libaravis cannot serve there",
                         s->c.address);
    }
    if (e != PVX_OK) {
        simgv_free(&s);
        return e;
    }
    ArvFakeCamera *cam = arv_gv_fake_camera_get_fake_camera(s->gv);
    write_registers(s, cam);
    atomic_store(&s->cam, cam);
    arv_fake_camera_set_fill_pattern(cam, fill, s);
    *out = s;
    return PVX_OK;
}

void simgv_set_fault(simgv *s, const struct simgv_fault *f)
{
    pthread_mutex_lock(&s->lock);
    s->fault = *f;
    pthread_mutex_unlock(&s->lock);
}

void simgv_stats(simgv *s, struct simgv_stats *out)
{
    pthread_mutex_lock(&s->lock);
    *out = s->stats;
    pthread_mutex_unlock(&s->lock);
}

void simgv_free(simgv **sp)
{
    struct simgv *s = *sp;
    if (s == NULL)
        return;
    *sp = NULL;
    pthread_mutex_lock(&s->lock);
    s->ending = true;
    pthread_mutex_unlock(&s->lock);
    if (s->gv != NULL)
        g_object_unref(s->gv); /* joins the camera's thread */
    simgv_poll_remove(&s->pacer);
    pthread_mutex_destroy(&s->lock);
    for (size_t i = 0; i < G_N_ELEMENTS(s->strings); i++)
        free(s->strings[i]);
    free(s->ring);
    free(s);
}
