/* vm_views.c - all virtual USB cameras at once through a backend of Pyrovox.
 *
 *   vm_views v4l2|libcamera N DIR    DIR/cam0/%06d.npy ...: what camera i must be showing, grey
 * Cameras are opened by the addresses that the backend lists.  Every frame must be one of its
 * camera's pictures, byte for byte; numbers grow, stamps lie shortly before the arrival, and frames
 * of one instant show the same picture number in all cameras. */
#include <pthread.h>
#include <stdlib.h>
#include <unistd.h>

#include "base/clock.h"
#include "capture/imgio.h"
#include "capture/source.h"
#include "capture/sequence.h"
#include "tests/t.h"

#define MAX    8
#define FRAMES 12 /* looked at per camera */

struct seen {
    int64_t stamp;
    size_t picture;
};
struct camera {
    char uri[256];
    cap_source *source;
    struct cap_loaded picture[16];
    size_t n_pictures, n;
    struct seen seen[FRAMES];
    uint64_t last_id, count[CAP_N_COUNT];
    bool odd; /* a frame was not what it should be; why says what */
    char why[128];
};
static struct camera cam[MAX];
static const struct cap_source_ops *ops;
static unsigned n_cams, n_listed;
static const char *dir;
static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;

static void found(void *ctx, const struct cap_found *f)
{
    (void)ctx;
    const char *wanted[] = {"Mono8 160x120", "YUV422_8 160x120", "JPEG 160x120", "Mono8 80x60"};
    for (size_t i = 0; i < sizeof wanted / sizeof wanted[0]; i++)
        T_CONTAINS(f->formats != NULL ? f->formats : "", wanted[i]);
    T_CONTAINS(f->text, "Flame cam");
    if (n_listed < MAX)
        snprintf(cam[n_listed].uri, sizeof cam[0].uri, "%s", f->uri);
    n_listed++;
}

static int by_uri(const void *a, const void *b)
{
    return strcmp(((const struct camera *)a)->uri, ((const struct camera *)b)->uri);
}

static void listed(void)
{
    struct pvx_diag d = {""};
    T_EQ_I(ops->list(found, NULL, &d), PVX_OK);
    T_EQ_S(d.text, "");
    T_EQ_I(n_listed, n_cams);
    qsort(cam, n_cams, sizeof cam[0], by_uri);
}

static void load_pictures(struct camera *c, unsigned i)
{
    char name[512];
    struct cap_sequence seq;
    struct pvx_diag d = {""};
    snprintf(name, sizeof name, "%s/cam%u", dir, i);
    if (cap_sequence_find(name, &seq, &d) != PVX_OK) {
        T_EQ_S(d.text, "");
        return;
    }
    for (size_t k = 0; k < seq.n && k < 16; k++)
        if (cap_image_load(seq.item[k].path, &c->picture[k], &d) == PVX_OK)
            c->n_pictures++;
    T_EQ_I(c->n_pictures, seq.n);
    cap_sequence_free(&seq);
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
    if (c->n < FRAMES) {
        const struct cap_image *m = &f->img;
        int64_t age = f->t_arrival_mono_ns - f->t_device_ns;
        if (m->width != 160 || m->height != 120 || m->fmt != CAP_GREY8 || m->size != 160 * 120)
            odd(c, "format or size", (double)m->size);
        if (c->n > 0 && f->id <= c->last_id)
            odd(c, "numbers do not grow", (double)f->id);
        if (c->n > 0 && f->t_device_ns <= c->seen[c->n - 1].stamp)
            odd(c, "stamps do not grow", (double)f->t_device_ns);
        if (age < 0 || age > 5 * PVX_NS_PER_S) /* s, not ms: an emulated machine may be starved */
            odd(c, "stamp is no recent time", (double)age);
        size_t k = 0;
        while (k < c->n_pictures && !c->odd &&
               memcmp(m->data, c->picture[k].img.data, m->size) != 0)
            k++;
        if (k == c->n_pictures)
            odd(c, "none of its pictures", (double)f->id);
        c->last_id = f->id;
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
        all &= cam[i].n == FRAMES;
    pthread_mutex_unlock(&lock);
    return all;
}

static void streamed(void)
{
    const struct cap_sink sink = {.push = push, .event = event, .count = count};
    const char *slow = getenv("VM_SLOW");
    T_EQ_I(n_listed, n_cams);
    if (n_listed != n_cams)
        return;
    for (unsigned i = 0; i < n_cams; i++) {
        const char *rest;
        struct pvx_diag d = {""};
        load_pictures(&cam[i], i);
        T_OK(cap_backend_find(cam[i].uri, &rest) == ops);
        struct cap_source_config c = {.uri = rest,
                                      .name = "cam",
                                      .camera = i,
                                      .width = 160,
                                      .height = 120,
                                      .fmt = CAP_GREY8,
                                      .fps = 5,
                                      .buffers = 6,
                                      .exposure_us = -1,
                                      .gain = -1};
        pvx_err e = ops->open(&c, &cam[i].source, &d);
        if (e == PVX_OK)
            e = ops->start(cam[i].source, &sink, &d);
        T_EQ_S(e == PVX_OK ? "" : pvx_diag_text(&d, e), "");
    }
    int64_t end = pvx_now_mono() + (int64_t)(60e9 * (slow != NULL ? atof(slow) : 1));
    while (!enough() && pvx_now_mono() < end)
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
        T_EQ_I(cam[i].n, FRAMES);
        T_EQ_I(cam[i].count[CAP_INCOMPLETE], 0);
    }
}

/* The cameras send picture floor(t / period) at every multiple of the period. */
static void in_step(void)
{
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

int main(int argc, char **argv)
{
    char scheme[32];
    const char *rest;
    if (argc != 4)
        return 2;
    snprintf(scheme, sizeof scheme, "%s:", argv[1]);
    ops = cap_backend_find(scheme, &rest);
    n_cams = (unsigned)atoi(argv[2]);
    dir = argv[3];
    if (ops == NULL || n_cams < 1 || n_cams > MAX)
        return 2;
    T_RUN(listed);
    T_RUN(streamed);
    T_RUN(in_step);
    for (unsigned i = 0; i < n_cams; i++)
        for (size_t k = 0; k < cam[i].n_pictures; k++)
            cap_loaded_free(&cam[i].picture[k]);
    return t_done();
}
