/* vm_views.c - all virtual USB cameras at once through a backend of Pyrovox.
 *
 *   vm_views v4l2|libcamera N DIR [FORMAT [HZ [FRAMES]]]      Mono8 5 12
 * DIR/cam0/%06d.npy ...: what camera i must be showing.  Cameras are opened by the addresses that the
 * backend lists.  Every frame must be one of its camera's pictures in the format, byte for byte; numbers
 * grow, stamps lie shortly before the arrival, and without HZ frames of one instant show the same
 * picture number in all cameras (busier, an emulated machine stamps too late to tell).
 * At the end it prints "figures ..." with the rate, and per camera "camera 3 received 12 missing 0": what
 * was received, and what the backend says was lost. */
#include <pthread.h>
#include <stdlib.h>
#include <unistd.h>

#include "base/clock.h"
#include "capture/rig/backends.h"
#include "tests/lib/patience.h"
#include "tests/lib/source.h"
#include "tests/t.h"
#include "tests/vm/uvc/images.h"

#define MAX        8
#define MAX_FRAMES 4096

struct seen {
    int64_t stamp;
    size_t picture;
};
struct camera {
    cap_source *source;
    struct uvc_images picture;
    size_t n;
    struct seen seen[MAX_FRAMES]; /* the first of them */
    int64_t begin, end;           /* CLOCK_MONOTONIC of the first and last frame looked at */
    uint64_t last_id, count[CAP_N_COUNT];
    bool odd; /* a frame was not what it should be; why says what */
    char why[128];
};
static struct camera cam[MAX];
static char uris[MAX][256];
static const struct cap_source_ops *ops;
static unsigned n_cams, n_listed;
static const char *dir;
static enum cap_pixfmt fmt = CAP_GREY8;
static enum uvc_format uvc_fmt = UVC_GREY;
static double rate = 5;
static bool rate_given;
static size_t frames = 12; /* looked at per camera */
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

static const struct {
    enum cap_pixfmt fmt;
    enum uvc_format uvc;
} formats[] = {{CAP_JPEG, UVC_MJPG},       {CAP_YUYV, UVC_YUYV},
               {CAP_GREY8, UVC_GREY},      {CAP_BAYER_RG8, UVC_RGGB},
               {CAP_BAYER_RG16, UVC_RG16}, {CAP_BAYER_RG10CSI, UVC_RW10}};

static void found(void *ctx, const struct cap_found *f)
{
    (void)ctx;
    for (size_t i = 0; i < sizeof formats / sizeof formats[0]; i++)
        for (int k = 0; k < UVC_N_SIZES; k++) {
            char wanted[64];
            snprintf(wanted, sizeof wanted, "%s %dx%d", cap_pixfmt_name(formats[i].fmt),
                     cam[0].picture.size[k].width, cam[0].picture.size[k].height);
            T_CONTAINS(f->formats != NULL ? f->formats : "", wanted);
        }
    T_CONTAINS(f->text, "Flame cam");
    if (n_listed < MAX)
        snprintf(uris[n_listed], sizeof uris[0], "%s", f->uri);
    n_listed++;
}

T_CASE(load_pictures)
{
    for (unsigned i = 0; i < n_cams; i++) {
        char name[512];
        struct pvx_diag d = {""};
        snprintf(name, sizeof name, "%s/cam%u", dir, i);
        pvx_err e = uvc_images_load(name, 1u << uvc_fmt, UVC_QUALITY, &cam[i].picture, &d);
        T_EQ_S(e == PVX_OK ? "" : pvx_diag_text(&d, e), "");
    }
}

static int by_text(const void *a, const void *b)
{
    return strcmp(a, b);
}

T_CASE(listed)
{
    struct pvx_diag d = {""};
    T_EQ_I(ops->list(found, NULL, &d), PVX_OK);
    T_EQ_S(d.text, "");
    T_EQ_I(n_listed, n_cams);
    qsort(uris, n_cams, sizeof uris[0], by_text);
}

static void odd(struct camera *c, const char *why, double v)
{
    if (!c->odd)
        snprintf(c->why, sizeof c->why, "%s (%g)", why, v);
    c->odd = true;
}

static void push(void *ctx, struct cap_frame *f)
{
    (void)ctx;
    struct camera *c = &cam[f->camera];
    pthread_mutex_lock(&lock);
    c->count[CAP_RECEIVED]++;
    if (c->n < frames) {
        const struct cap_image *m = &f->img;
        const struct uvc_size *size = &c->picture.size[0];
        int64_t age = f->t_arrival_mono_ns - f->t_device_ns;
        if (m->width != size->width || m->height != size->height || m->fmt != fmt)
            odd(c, "format or size", (double)m->size);
        if (c->n > 0 && f->id <= c->last_id)
            odd(c, "numbers do not grow", (double)f->id);
        if (c->n > 0 && f->t_device_ns <= c->seen[c->n - 1].stamp)
            odd(c, "stamps do not grow", (double)f->t_device_ns);
        if (age < 0 || age > 5 * PVX_NS_PER_S) /* s, not ms: an emulated machine may be starved */
            odd(c, "stamp is no recent time", (double)age);
        size_t k = 0;
        const struct uvc_bytes *b = c->picture.frame[uvc_fmt][0];
        while (k < c->picture.n && (b[k].n != m->size || memcmp(m->data, b[k].data, m->size) != 0))
            k++;
        if (k == c->picture.n)
            odd(c, "none of its pictures", (double)f->id);
        c->last_id = f->id;
        c->begin = c->n == 0 ? f->t_arrival_mono_ns : c->begin;
        c->end = f->t_arrival_mono_ns;
        c->seen[c->n++] = (struct seen){f->t_device_ns, k};
    }
    pthread_mutex_unlock(&lock);
    cap_frame_release(f);
}

static void event(void *ctx, uint32_t camera, enum cap_event ev)
{
    (void)ctx;
    pthread_mutex_lock(&lock);
    odd(&cam[camera], "lost", ev);
    pthread_mutex_unlock(&lock);
}

static void count(void *ctx, uint32_t camera, enum cap_count what, uint64_t n)
{
    (void)ctx;
    pthread_mutex_lock(&lock);
    cam[camera].count[what] += n;
    pthread_mutex_unlock(&lock);
}

static bool enough(void)
{
    bool all = true;
    pthread_mutex_lock(&lock);
    for (unsigned i = 0; i < n_cams; i++)
        all &= cam[i].n == frames;
    pthread_mutex_unlock(&lock);
    return all;
}

T_CASE(streamed)
{
    const struct cap_sink sink = {.push = push, .event = event, .count = count};
    T_EQ_I(n_listed, n_cams);
    if (n_listed != n_cams)
        return;
    for (unsigned i = 0; i < n_cams; i++) {
        const char *rest;
        struct pvx_diag d = {""};
        T_OK(cap_backend_find(uris[i], &rest) == ops);
        const struct uvc_size *size = &cam[i].picture.size[0];
        struct cap_source_config c = source_of(rest, size->width, size->height, fmt, rate);
        c.camera = i;
        c.buffers = 6;
        pvx_err e = ops->open(&c, &cam[i].source, &d);
        if (e == PVX_OK)
            e = ops->start(cam[i].source, &sink, &d);
        T_EQ_S(e == PVX_OK ? "" : pvx_diag_text(&d, e), "");
    }
    UNTIL (enough())
        usleep(20000);
    for (unsigned i = 0; i < n_cams; i++) {
        if (cam[i].source == NULL)
            continue;
        ops->stop(cam[i].source);
        size_t n = cam[i].n;
        usleep(1000);
        T_EQ_I(cam[i].n, n); /* no push after stop */
        ops->close(&cam[i].source);
        T_EQ_S(cam[i].why, "");
        T_EQ_I(cam[i].n, frames);
        T_EQ_I(cam[i].count[CAP_INCOMPLETE], 0);
    }
}

/* The cameras send picture floor(t / period) at every multiple of the period. */
T_CASE(in_step)
{
    if (rate_given)
        T_SKIP("not at the pictures' own rate");
    unsigned pairs = 0;
    for (unsigned i = 1; i < n_cams; i++)
        for (size_t a = 0; a < cam[0].n; a++)
            for (size_t b = 0; b < cam[i].n; b++)
                if (llabs(cam[0].seen[a].stamp - cam[i].seen[b].stamp) < 30 * PVX_NS_PER_MS) {
                    pairs += cam[0].seen[a].picture == cam[i].seen[b].picture;
                    T_EQ_I(cam[0].seen[a].picture, cam[i].seen[b].picture);
                }
    T_OK(n_cams == 1 || pairs > 0);
}

static void figures(void)
{
    double hz = 0, slowest = 1e9;
    for (unsigned i = 0; i < n_cams; i++) {
        const struct camera *c = &cam[i];
        double own = c->n > 1 ? (double)(c->n - 1) * 1e9 / (double)(c->end - c->begin) : 0;
        hz += own / n_cams;
        slowest = own < slowest ? own : slowest;
        printf("camera %u received %llu missing %llu\n", i,
               (unsigned long long)c->count[CAP_RECEIVED],
               (unsigned long long)(c->count[CAP_ID_GAP] + c->count[CAP_UNDERRUN]));
    }
    printf("figures %u cameras %dx%d %s, asked %g Hz, got %.2f (slowest camera %.2f), %zu frames "
           "each\n",
           n_cams, cam[0].picture.size[0].width, cam[0].picture.size[0].height,
           cap_pixfmt_name(fmt), rate, hz, slowest, frames);
}

static bool options(int argc, char **argv)
{
    char scheme[32];
    const char *rest;
    if (argc < 4 || argc > 7)
        return false;
    snprintf(scheme, sizeof scheme, "%s:", argv[1]);
    ops = cap_backend_find(scheme, &rest);
    n_cams = (unsigned)atoi(argv[2]);
    dir = argv[3];
    if (argc > 4) {
        fmt = cap_pixfmt_parse(argv[4]);
        uvc_fmt = UVC_N_FORMATS;
        for (size_t i = 0; i < sizeof formats / sizeof formats[0]; i++)
            if (formats[i].fmt == fmt)
                uvc_fmt = formats[i].uvc;
    }
    rate_given = argc > 5;
    if (rate_given)
        rate = atof(argv[5]);
    if (argc > 6)
        frames = strtoul(argv[6], NULL, 10);
    return ops != NULL && n_cams >= 1 && n_cams <= MAX && uvc_fmt != UVC_N_FORMATS && rate > 0 &&
           frames > 0 && frames <= MAX_FRAMES;
}

int main(int argc, char **argv)
{
    if (!options(argc, argv))
        return 2;
    t_run();
    figures();
    for (unsigned i = 0; i < n_cams; i++)
        uvc_images_free(&cam[i].picture);
    return t_done();
}
