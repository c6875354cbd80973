/* The aravis: source against simulated cameras over real GVCP/GVSP on loopback: a child process
 * serves known images, this one captures and compares bytes, numbers and stamps. */
#include <pthread.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "capture/backends.h"
#include "capture/rig/capture.h"
#include "capture/gevsim/netns.h"
#include "capture/simgv.h"
#include "tests/t.h"

#define N_CAM    3
#define N_RING   16
#define W        320
#define H        240
#define RING_FPS 25.0
#define KEEP     256

static const enum cap_pixfmt formats[N_CAM] = {CAP_GREY8, CAP_RGB8, CAP_BAYER_RG8};
static unsigned char *images[N_CAM][N_RING];
static bool usable;

static size_t image_bytes(int cam)
{
    return cap_pixfmt_image(formats[cam], W, H);
}

static void make_images(void)
{
    for (int c = 0; c < N_CAM; c++)
        for (int i = 0; i < N_RING; i++) {
            images[c][i] = malloc(image_bytes(c));
            for (size_t k = 0; k < image_bytes(c); k++)
                images[c][i][k] = (unsigned char)(t_rand() >> 56);
        }
}

/* ---- the child that serves -------------------------------------------------------------------- */

enum op { OP_FAULT, OP_KILL, OP_REVIVE, OP_STATS };
struct order {
    enum op op;
    int cam;
    struct cap_simgv_fault fault;
};
struct answer {
    pvx_err e;
    struct cap_simgv_stats stats;
};
static int to_server[2], from_server[2];
static pid_t server;

static pvx_err serve_one(int c, cap_simgv **out)
{
    char address[16], serial[16], name[16];
    if (cap_netns_address("127.0.0.2", (unsigned)c, address) != PVX_OK)
        return PVX_EINVAL;
    snprintf(serial, sizeof serial, "T%02d", c);
    snprintf(name, sizeof name, "view%d", c);
    struct cap_simgv_config config = {.address = address,
                                      .serial = serial,
                                      .user_name = name,
                                      .fmt = formats[c],
                                      .width = W,
                                      .height = H,
                                      .ring = (const void *const *)images[c],
                                      .n_ring = N_RING,
                                      .ring_fps = RING_FPS};
    struct pvx_diag d = {""};
    pvx_err e = cap_simgv_new(&config, out, &d);
    if (e != PVX_OK)
        printf("  server: %s\n", pvx_diag_text(&d, e));
    return e;
}

static void serve(void)
{
    cap_simgv *cam[N_CAM] = {NULL};
    struct order o;
    struct answer a = {PVX_OK, {0}};
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    for (int c = 0; c < N_CAM && a.e == PVX_OK; c++)
        a.e = serve_one(c, &cam[c]);
    while (write(from_server[1], &a, sizeof a) == sizeof a &&
           read(to_server[0], &o, sizeof o) == sizeof o) {
        a = (struct answer){PVX_OK, {0}};
        if (o.op == OP_FAULT)
            cap_simgv_set_fault(cam[o.cam], &o.fault);
        else if (o.op == OP_KILL)
            cap_simgv_free(&cam[o.cam]);
        else if (o.op == OP_REVIVE)
            a.e = serve_one(o.cam, &cam[o.cam]);
        else
            cap_simgv_stats(cam[o.cam], &a.stats);
    }
    for (int c = 0; c < N_CAM; c++)
        cap_simgv_free(&cam[c]);
}

static struct answer receive(void)
{
    struct answer a = {PVX_EIO, {0}};
    if (read(from_server[0], &a, sizeof a) != sizeof a)
        a.e = PVX_EIO;
    return a;
}

static struct answer order(enum op op, int cam, struct cap_simgv_fault fault)
{
    struct order o = {op, cam, fault};
    if (write(to_server[1], &o, sizeof o) != sizeof o)
        return (struct answer){PVX_EIO, {0}};
    struct answer a = receive();
    T_EQ_I(a.e, PVX_OK);
    return a;
}

static void start_server(void)
{
    if (pipe(to_server) != 0 || pipe(from_server) != 0)
        exit(1);
    fflush(stdout);
    server = fork();
    if (server == 0) {
        close(to_server[1]);
        close(from_server[0]);
        serve();
        fflush(stdout);
        exit(0);
    }
    close(to_server[0]);
    close(from_server[1]);
    usable = receive().e == PVX_OK;
}

static void stop_server(void)
{
    int status = 0;
    close(to_server[1]);
    waitpid(server, &status, 0);
    T_OK(WIFEXITED(status) && WEXITSTATUS(status) == 0);
}

/* ---- the side that captures ------------------------------------------------------------------- */

struct box {
    pthread_mutex_t lock;
    pthread_cond_t change;
    struct cap_frame *frame[KEEP];
    int n;
    uint64_t count[CAP_N_COUNT];
    int lost;
};

static void on_push(void *ctx, struct cap_frame *f)
{
    struct box *b = ctx;
    pthread_mutex_lock(&b->lock);
    bool room = b->n < KEEP;
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

static struct cap_sink sink_of(struct box *b)
{
    return (struct cap_sink){.push = on_push, .event = on_event, .count = on_count, .ctx = b};
}

/* Oldest frame, or NULL after 10 s. */
static struct cap_frame *next_frame(struct box *b)
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
        memmove(b->frame, b->frame + 1, (size_t)--b->n * sizeof f);
    }
    pthread_mutex_unlock(&b->lock);
    return f;
}

static uint64_t counted(struct box *b, enum cap_count what)
{
    pthread_mutex_lock(&b->lock);
    uint64_t n = b->count[what];
    pthread_mutex_unlock(&b->lock);
    return n;
}

static void empty(struct box *b)
{
    for (int i = 0; i < b->n; i++)
        cap_frame_release(b->frame[i]);
    b->n = 0;
}

static struct cap_source_config config_of(int cam)
{
    static const char *const uri[N_CAM] = {"127.0.0.2", "127.0.0.3", "127.0.0.4"};
    static const char *const name[N_CAM] = {"a", "b", "c"};
    return (struct cap_source_config){.uri = uri[cam],
                                      .name = name[cam],
                                      .camera = (uint32_t)cam,
                                      .width = W,
                                      .height = H,
                                      .fmt = formats[cam],
                                      .fps = RING_FPS,
                                      .buffers = 8,
                                      .exposure_us = -1,
                                      .gain = -1};
}

static const struct cap_source_ops *const ops = &cap_source_aravis;

struct session {
    struct box box;
    cap_source *src;
    int cam;
    uint64_t good, first_id, last_id;
    int64_t last_stamp;
    bool any;
};

static bool begin(struct session *s, const struct cap_source_config *c)
{
    memset(s, 0, sizeof *s);
    pthread_mutex_init(&s->box.lock, NULL);
    pthread_cond_init(&s->box.change, NULL);
    s->cam = (int)c->camera;
    struct pvx_diag d = {""};
    struct cap_sink sink = sink_of(&s->box);
    pvx_err e = ops->open(c, &s->src, &d);
    if (e == PVX_OK)
        e = ops->start(s->src, &sink, &d);
    T_EQ_S(d.text, "");
    T_EQ_I(e, PVX_OK);
    return e == PVX_OK;
}

static void end(struct session *s)
{
    if (s->src != NULL) {
        ops->stop(s->src);
        ops->close(&s->src);
    }
    empty(&s->box);
    pthread_mutex_destroy(&s->box.lock);
    pthread_cond_destroy(&s->box.change);
}

/* A good frame: the bytes are those of the ring image that its stamp names, number and stamp go up,
 * and every number between is accounted for.  False = none came. */
static bool take_good(struct session *s)
{
    struct cap_frame *f = next_frame(&s->box);
    T_OK(f != NULL);
    if (f == NULL)
        return false;
    T_EQ_I(f->img.width, W);
    T_EQ_I(f->img.height, H);
    T_EQ_I(f->img.fmt, formats[s->cam]);
    T_EQ_I(f->img.size, image_bytes(s->cam));
    T_EQ_I(f->img.stride, (int)cap_pixfmt_row(formats[s->cam], W));
    T_EQ_I(f->camera, s->cam);
    int64_t i = cap_simgv_index(f->t_device_ns, RING_FPS) % N_RING;
    T_OK(f->img.size == image_bytes(s->cam) &&
         memcmp(f->img.data, images[s->cam][i], f->img.size) == 0);
    if (s->any) {
        T_OK(f->id > s->last_id);
        T_OK(f->t_device_ns > s->last_stamp);
    } else {
        s->first_id = f->id;
    }
    T_OK(f->t_arrival_ns > f->t_device_ns);
    s->any = true;
    s->good++;
    s->last_id = f->id;
    s->last_stamp = f->t_device_ns;
    cap_frame_release(f);
    return true;
}

/* After stop: numbers from the first to the last good frame = good ones + all that were counted.
 * Incomplete ones may also have come before the first or after the last, hence the two bounds. */
static void check_sum(struct session *s)
{
    while (s->box.n > 0)
        take_good(s);
    uint64_t span = s->last_id - s->first_id + 1;
    uint64_t sum = s->good + s->box.count[CAP_ID_GAP] + s->box.count[CAP_UNDERRUN];
    T_LE(span, sum + s->box.count[CAP_INCOMPLETE]);
    T_LE(sum, span);
}

#define NEED_CAMERAS() \
    if (!usable)       \
    T_SKIP("no private network and no addresses 127.0.0.2 to 127.0.0.4 here")

static const struct cap_simgv_fault healthy;

static void pixels_numbers_stamps(void)
{
    NEED_CAMERAS();
    static const char *const uri[N_CAM] = {"127.0.0.2", "T01", "view2"}; /* address, serial, name */
    for (int c = 0; c < N_CAM; c++) {
        struct session s;
        struct cap_source_config config = config_of(c);
        config.uri = uri[c];
        if (begin(&s, &config)) {
            for (int k = 0; k < 12 && take_good(&s); k++)
                ;
            ops->stop(s.src);
            T_EQ_I(s.last_stamp % (PVX_NS_PER_S / (int64_t)RING_FPS), 0); /* on the ring's grid */
            check_sum(&s);
            T_EQ_I(s.box.lost, 0);
        }
        end(&s);
    }
}

static void numbers_past_the_wrap(void)
{
    NEED_CAMERAS();
    struct session s;
    struct cap_source_config config = config_of(0);
    config.fps = 100;           /* four times the ring's rate: stamps are the camera's ticks then */
    order(OP_KILL, 0, healthy); /* a fresh one starts at 65401 */
    order(OP_REVIVE, 0, healthy);
    if (begin(&s, &config)) {
        while (take_good(&s) && s.last_id < 65560)
            ;
        ops->stop(s.src);
        T_LE(65401, s.first_id);
        T_LE(65560, s.last_id);
        check_sum(&s);
    }
    end(&s);
}

static void dropped_frames_are_gaps(void)
{
    NEED_CAMERAS();
    struct session s;
    struct cap_source_config config = config_of(1);
    if (begin(&s, &config)) {
        take_good(&s);
        order(OP_FAULT, 1, (struct cap_simgv_fault){.drop = 0.5});
        for (int k = 0; k < 200 && counted(&s.box, CAP_ID_GAP) < 5 && take_good(&s); k++)
            ;
        order(OP_FAULT, 1, healthy);
        for (int k = 0; k < 2; k++)
            take_good(&s);
        T_LE(5, counted(&s.box, CAP_ID_GAP));
        T_LE(5, order(OP_STATS, 1, healthy).stats.dropped);
        ops->stop(s.src);
        check_sum(&s);
    }
    end(&s);
}

static void lost_packets_are_incomplete_frames(void)
{
    NEED_CAMERAS();
    struct session s;
    struct cap_source_config config = config_of(2);
    config.gige.packet_size = 1500; /* 53 packets a frame */
    config.fps = 25;
    if (begin(&s, &config)) {
        take_good(&s);
        order(OP_FAULT, 2, (struct cap_simgv_fault){.packet_loss = 0.03});
        for (int k = 0; k < 200 && counted(&s.box, CAP_INCOMPLETE) < 12 && take_good(&s); k++)
            ;
        order(OP_FAULT, 2, healthy);
        for (int k = 0; k < 2; k++)
            take_good(&s);
        T_LE(12, counted(&s.box, CAP_INCOMPLETE));
        ops->stop(s.src);
        check_sum(&s);
    }
    end(&s);
}

static void late_frames_keep_their_stamps(void)
{
    NEED_CAMERAS();
    struct session s;
    struct cap_source_config config = config_of(0);
    if (begin(&s, &config)) {
        take_good(&s);
        order(OP_FAULT, 0, (struct cap_simgv_fault){.delay_ms = 150});
        int64_t least = INT64_MAX;
        for (int k = 0; k < 16; k++) {
            struct cap_frame *f = next_frame(&s.box);
            T_OK(f != NULL);
            if (f == NULL)
                break;
            int64_t i = cap_simgv_index(f->t_device_ns, RING_FPS) % N_RING;
            T_OK(memcmp(f->img.data, images[0][i], image_bytes(0)) == 0);
            T_OK(f->t_device_ns > s.last_stamp);
            s.last_stamp = f->t_device_ns;
            int64_t age = f->t_arrival_ns - f->t_device_ns;
            if (k >= 6 && age < least) /* the first ones were under way already */
                least = age;
            cap_frame_release(f);
        }
        T_LE(120, (double)least * 1e-6);
        order(OP_FAULT, 0, healthy);
    }
    end(&s);
}

static void software_trigger(void)
{
    NEED_CAMERAS();
    struct session s;
    struct cap_source_config config = config_of(1);
    config.trigger = CAP_TRIGGER_SOFTWARE;
    if (begin(&s, &config)) {
        for (int k = 0; k < 8; k++) {
            int64_t before = pvx_now_real();
            T_EQ_I(ops->trigger(s.src), PVX_OK);
            if (!take_good(&s))
                break;
            T_OK(s.last_stamp >= before);
        }
        ops->stop(s.src);
        T_EQ_I(s.good, 8);
        T_EQ_I(s.last_id - s.first_id + 1, 8); /* one each, none on its own */
    }
    end(&s);
}

static void slow_consumer_is_an_underrun(void)
{
    NEED_CAMERAS();
    struct session s;
    struct cap_source_config config = config_of(0);
    config.buffers = 4;
    if (begin(&s, &config)) {
        for (int k = 0; k < 500 && counted(&s.box, CAP_UNDERRUN) < 3; k++)
            usleep(20000); /* nothing is released */
        T_LE(3, counted(&s.box, CAP_UNDERRUN));
        T_EQ_I(s.box.n, 4);
        for (int k = 0; k < 8 && take_good(&s); k++)
            ;
        ops->stop(s.src);
        check_sum(&s);
    }
    end(&s);
}

static void frames_outlive_their_source(void)
{
    NEED_CAMERAS();
    struct session s;
    struct cap_source_config config = config_of(1);
    if (begin(&s, &config)) {
        struct cap_frame *a = next_frame(&s.box), *b = next_frame(&s.box);
        ops->stop(s.src);
        struct cap_sink sink = sink_of(&s.box);
        struct pvx_diag d = {""};
        T_EQ_I(ops->start(s.src, &sink, &d), PVX_OK); /* and again, with two buffers out */
        empty(&s.box);
        struct cap_frame *c = next_frame(&s.box);
        ops->stop(s.src);
        ops->close(&s.src);
        struct cap_frame *all[] = {a, b, c};
        for (int k = 0; k < 3; k++) {
            T_OK(all[k] != NULL);
            if (all[k] == NULL)
                continue;
            int64_t i = cap_simgv_index(all[k]->t_device_ns, RING_FPS) % N_RING;
            T_OK(memcmp(all[k]->img.data, images[1][i], image_bytes(1)) == 0);
        }
        for (int k = 0; k < 3; k++)
            cap_frame_release(all[k]);
    }
    end(&s);
}

static void refuse(struct cap_source_config c, pvx_err want, const char *says)
{
    char who[64];
    snprintf(who, sizeof who, "camera a (aravis:%s)", c.uri);
    cap_source *src = NULL;
    struct pvx_diag d = {""};
    T_EQ_I(ops->open(&c, &src, &d), want);
    T_OK(src == NULL);
    T_CONTAINS(d.text, who);
    T_CONTAINS(d.text, says);
    if (src != NULL)
        ops->close(&src);
}

static void refusals_have_reasons(void)
{
    NEED_CAMERAS();
    struct cap_source_config c = config_of(0);
    c.width = 4000;
    refuse(c, PVX_EINVAL, "sensor 320x240");
    c = config_of(0);
    c.fmt = CAP_RGB_F32;
    refuse(c, PVX_EUNSUP, "RGB32f");
    c = config_of(0);
    c.fps = 1e5;
    refuse(c, PVX_EINVAL, "frame rate");
    c = config_of(0);
    c.exposure_us = 1e9;
    refuse(c, PVX_EINVAL, "exposure time");
    c = config_of(0);
    c.gige.packet_size = 100000;
    refuse(c, PVX_EINVAL, "MTU");
    c = config_of(0);
    c.trigger = CAP_TRIGGER_LINE;
    c.trigger_line = "Line7";
    refuse(c, PVX_EINVAL, "cannot be triggered by Line7: the trigger sources that it offers are:");
    c = config_of(0);
    c.trigger = CAP_TRIGGER_ACTION;
    refuse(c, PVX_EINVAL, "cannot be triggered by action commands");
    struct cap_feature none = {"NoSuchThing", "1"}, high = {"GainRaw", "99"},
                       fine = {"GainRaw", "3"};
    c = config_of(0);
    c.n_features = 1;
    c.features = &none;
    refuse(c, PVX_EINVAL, "no feature NoSuchThing");
    c.features = &high;
    refuse(c, PVX_EINVAL, "GainRaw");
    c.uri = "nobody";
    refuse(c, PVX_ENOENT, "no camera answers");
    c = config_of(0);
    c.n_features = 1;
    c.features = &fine;
    cap_source *first = NULL;
    struct pvx_diag d = {""};
    T_EQ_I(ops->open(&c, &first, &d), PVX_OK);
    T_EQ_S(d.text, "");
    refuse(config_of(0), PVX_EBUSY, "another program");
    if (first != NULL)
        ops->close(&first);
}

static void dead_and_back(void)
{
    NEED_CAMERAS();
    struct session s;
    struct cap_source_config config = config_of(0);
    if (begin(&s, &config)) {
        take_good(&s);
        order(OP_KILL, 0, healthy);
        int64_t until = pvx_now_mono() + 30 * PVX_NS_PER_S;
        int lost = 0;
        while (lost == 0 && pvx_now_mono() < until) {
            usleep(20000);
            pthread_mutex_lock(&s.box.lock);
            lost = s.box.lost;
            pthread_mutex_unlock(&s.box.lock);
        }
        T_EQ_I(lost, 1);
        order(OP_REVIVE, 0, healthy);
    }
    end(&s);
    if (begin(&s, &config))
        for (int k = 0; k < 3; k++)
            take_good(&s);
    end(&s);
}

struct listed {
    int n, formats, used;
    char text[N_CAM][512];
};

static void on_found(void *ctx, const struct cap_found *f)
{
    struct listed *l = ctx;
    unsigned c = 99;
    if (sscanf(f->uri, "aravis:127.0.0.%u", &c) != 1 || c < 2 || c >= 2 + N_CAM)
        return;
    l->n++;
    l->used += strstr(f->text, "in use") != NULL;
    l->formats += f->formats != NULL && strstr(f->formats, "Mono8 320x240") != NULL;
    snprintf(l->text[c - 2], sizeof l->text[0], "%s", f->text);
}

/* What a listing says, and that it leaves a camera that streams alone. */
static void listing(void)
{
    NEED_CAMERAS();
    struct session s;
    struct cap_source_config config = config_of(1);
    struct listed l = {0};
    struct pvx_diag d = {""};
    if (begin(&s, &config)) {
        take_good(&s);
        T_EQ_I(ops->list(on_found, &l, &d), PVX_OK);
        T_EQ_I(l.n, N_CAM);
        T_EQ_I(l.used, 1);
        T_EQ_I(l.formats, N_CAM - 1);
        T_CONTAINS(l.text[0], "serial T00, name view0, GigEVision");
        T_CONTAINS(l.text[1], "in use");
        for (int k = 0; k < 18 && take_good(&s); k++) /* 8 that waited, 10 from now on */
            ;
        ops->stop(s.src);
        T_EQ_I(s.box.lost, 0);
        check_sum(&s);
        T_EQ_I(s.box.count[CAP_INCOMPLETE] + s.box.count[CAP_ID_GAP], 0);
    }
    end(&s);
}

/* Without a word: nobody waits for Aravis to see it, and the camera is usable as soon as it is back. */
static void silent_and_back(void)
{
    NEED_CAMERAS();
    struct session s;
    struct cap_source_config config = config_of(1);
    config.name = "a"; /* as refuse expects */
    if (begin(&s, &config)) {
        take_good(&s);
        order(OP_KILL, 1, healthy);
    }
    int64_t before = pvx_now_mono();
    end(&s);
    double took = (double)(pvx_now_mono() - before) * 1e-9;
    printf("  given up in %.2f s\n", took);
    T_LE(took, 2); /* 5 to 7.5 when Aravis is asked */
    before = pvx_now_mono();
    refuse(config, PVX_ENOENT, "no camera answers there");
    T_LE((double)(pvx_now_mono() - before) * 1e-9, 2);
    order(OP_REVIVE, 1, healthy);
    before = pvx_now_mono();
    if (begin(&s, &config)) /* while the old one is still being given up */
        for (int k = 0; k < 3; k++)
            take_good(&s);
    took = (double)(pvx_now_mono() - before) * 1e-9;
    printf("  three frames %.2f s after it was back\n", took);
    T_LE(took, 2);
    end(&s);
}

/* ---- all cameras under supervision ------------------------------------------------------------ */

/* Sets until one satisfies; false after 30 s. */
static bool sets_until(cap_capture *cap, uint32_t members, int how_many)
{
    int64_t until = pvx_now_mono() + 30 * PVX_NS_PER_S;
    int n = 0;
    while (n < how_many && pvx_now_mono() < until) {
        struct cap_set *set;
        if (cap_capture_next(cap, PVX_NS_PER_S, &set) != PVX_OK)
            continue;
        n = set->n == members ? n + 1 : 0;
        for (int c = 0; c < N_CAM; c++) {
            if (set->frame[c] == NULL)
                continue;
            const struct cap_frame *f = set->frame[c];
            T_EQ_I(f->t_exposure_ns, set->t_exposure_ns); /* one instant, all cameras */
            int64_t i = cap_simgv_index(set->t_exposure_ns, RING_FPS) % N_RING;
            T_OK(memcmp(f->img.data, images[c][i], image_bytes(c)) == 0);
        }
        T_EQ_I(set->spread_ns, 0);
        cap_set_release(set);
    }
    return n == how_many;
}

static void sets_of_one_instant(void)
{
    NEED_CAMERAS();
    static const char *const uri[N_CAM] = {"aravis:127.0.0.2", "aravis:127.0.0.3",
                                           "aravis:127.0.0.4"};
    struct cap_source_config cameras[N_CAM];
    for (int c = 0; c < N_CAM; c++) {
        cameras[c] = config_of(c);
        cameras[c].uri = uri[c];
        cameras[c].buffers = 16;
    }
    struct cap_capture_config config = {.n_cameras = N_CAM,
                                        .camera = cameras,
                                        .fps = RING_FPS,
                                        .shared_clock = true,
                                        .discard_first = 1,
                                        .sets = {.max_wait_ns = 500 * PVX_NS_PER_MS,
                                                 .policy = CAP_POLICY_PARTIAL,
                                                 .min_cameras = 2}};
    cap_capture *cap = NULL;
    struct pvx_diag d = {""};
    T_EQ_I(cap_capture_new(&config, &cap, &d), PVX_OK);
    if (cap == NULL)
        return;
    T_EQ_I(cap_capture_start(cap, &d), PVX_OK);
    T_OK(sets_until(cap, N_CAM, 10));
    order(OP_FAULT, 2, (struct cap_simgv_fault){.freeze = true});
    T_OK(sets_until(cap, N_CAM - 1, 5));
    order(OP_FAULT, 2, healthy);
    T_OK(sets_until(cap, N_CAM, 5));
    struct cap_stats st;
    cap_capture_stats(cap, &st);
    T_LE(1, st.camera[2].count[CAP_BAD_STAMP]);
    order(OP_KILL, 1, healthy);
    T_OK(sets_until(cap, N_CAM - 1, 5));
    order(OP_REVIVE, 1, healthy);
    T_OK(sets_until(cap, N_CAM, 5));
    cap_capture_stop(cap);
    cap_capture_stats(cap, &st);
    T_LE(1, st.camera[1].count[CAP_LOST_CAMERA]);
    T_EQ_I(st.camera[0].count[CAP_LOST_CAMERA], 0);
    cap_capture_free(&cap);
}

int main(void)
{
    make_images();
    pvx_log_set_level(PVX_LOG_ERROR);
    struct pvx_diag d = {""};
    pvx_err e = cap_netns_enter(N_CAM, &d);
    if (e == PVX_OK || cap_netns_have("127.0.0.2", N_CAM))
        start_server();
    else
        printf("  %s\n", pvx_diag_text(&d, e));
    T_RUN(pixels_numbers_stamps);
    T_RUN(numbers_past_the_wrap);
    T_RUN(dropped_frames_are_gaps);
    T_RUN(lost_packets_are_incomplete_frames);
    T_RUN(late_frames_keep_their_stamps);
    T_RUN(software_trigger);
    T_RUN(slow_consumer_is_an_underrun);
    T_RUN(frames_outlive_their_source);
    T_RUN(refusals_have_reasons);
    T_RUN(listing);
    T_RUN(dead_and_back);
    T_RUN(silent_and_back);
    T_RUN(sets_of_one_instant);
    if (server > 0)
        stop_server();
    for (int c = 0; c < N_CAM; c++)
        for (int i = 0; i < N_RING; i++)
            free(images[c][i]);
    return t_done();
}
