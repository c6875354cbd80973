/* The aravis: source against simulated cameras over real GVCP/GVSP on loopback: a child process
 * serves known images, this one captures and compares bytes, numbers and stamps. */
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "capture/gevsim/netns.h"
#include "capture/gevsim/gvcam.h"
#include "tests/lib/have_addresses.h"
#include "tests/lib/rig.h"
#include "tests/lib/session.h"
#include "tests/lib/simgv.h"
#include "tests/t.h"

#define N_CAM    3
#define N_RING   16
#define W        320
#define H        240
#define RING_FPS 25.0

static const enum cap_pixfmt formats[N_CAM] = {CAP_GREY8, CAP_RGB8, CAP_BAYER_RG8};
static unsigned char *images[N_CAM][N_RING];

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
    struct simgv_fault fault;
};
struct answer {
    pvx_err e;
    struct simgv_stats stats;
};
static int to_server[2], from_server[2];
static pid_t server;

static pvx_err serve_one(int c, simgv **out)
{
    char address[16], serial[16], name[16];
    if (cap_netns_address("127.0.0.2", (unsigned)c, address) != PVX_OK)
        return PVX_EINVAL;
    snprintf(serial, sizeof serial, "T%02d", c);
    snprintf(name, sizeof name, "view%d", c);
    struct simgv_config config = {.address = address,
                                  .serial = serial,
                                  .user_name = name,
                                  .fmt = formats[c],
                                  .width = W,
                                  .height = H,
                                  .ring = (const void *const *)images[c],
                                  .n_ring = N_RING,
                                  .ring_fps = RING_FPS};
    struct pvx_diag d = {""};
    pvx_err e = simgv_new(&config, out, &d);
    if (e != PVX_OK)
        printf("  server: %s\n", pvx_diag_text(&d, e));
    return e;
}

static void serve(void)
{
    simgv *cam[N_CAM] = {NULL};
    struct order o;
    struct answer a = {PVX_OK, {0}};
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    for (int c = 0; c < N_CAM && a.e == PVX_OK; c++)
        a.e = serve_one(c, &cam[c]);
    while (write(from_server[1], &a, sizeof a) == sizeof a &&
           read(to_server[0], &o, sizeof o) == sizeof o) {
        a = (struct answer){PVX_OK, {0}};
        if (o.op == OP_FAULT)
            simgv_set_fault(cam[o.cam], &o.fault);
        else if (o.op == OP_KILL)
            simgv_free(&cam[o.cam]);
        else if (o.op == OP_REVIVE)
            a.e = serve_one(o.cam, &cam[o.cam]);
        else
            simgv_stats(cam[o.cam], &a.stats);
    }
    for (int c = 0; c < N_CAM; c++)
        simgv_free(&cam[c]);
}

static struct answer receive(void)
{
    struct answer a = {PVX_EIO, {0}};
    if (read(from_server[0], &a, sizeof a) != sizeof a)
        a.e = PVX_EIO;
    return a;
}

static struct answer order(enum op op, int cam, struct simgv_fault fault)
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
    if (receive().e == PVX_OK)
        t_skip_all = NULL;
}

static void stop_server(void)
{
    int status = 0;
    close(to_server[1]);
    waitpid(server, &status, 0);
    T_OK(WIFEXITED(status) && WEXITSTATUS(status) == 0);
}

/* ---- the side that captures ------------------------------------------------------------------- */

static struct cap_source_config config_of(int cam)
{
    static const char *const uri[N_CAM] = {"127.0.0.2", "127.0.0.3", "127.0.0.4"};
    static const char *const name[N_CAM] = {"a", "b", "c"};
    struct cap_source_config c = source_of(uri[cam], W, H, formats[cam], RING_FPS);
    c.name = name[cam];
    c.camera = (uint32_t)cam;
    return c;
}

/* A good frame: the bytes are those of the ring image that its stamp names, number and stamp go up,
 * and every number between is accounted for.  False = none came. */
static bool next_good(struct session *s)
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
    int64_t i = cap_gvcam_index(f->t_device_ns, RING_FPS) % N_RING;
    T_OK(f->img.size == image_bytes(s->cam) &&
         memcmp(f->img.data, images[s->cam][i], f->img.size) == 0);
    T_OK(f->t_arrival_ns > f->t_device_ns);
    follows(s, f);
    cap_frame_release(f);
    return true;
}

/* After stop: numbers from the first to the last good frame = good ones + all that were counted.
 * Incomplete ones, and those without a buffer, may also have come before the first or after the last, hence
 * the two bounds. */
static void check_sum(struct session *s)
{
    while (s->box.n_held > 0)
        next_good(s);
    uint64_t span = s->last_id - s->first_id + 1;
    uint64_t sum = s->good + s->box.count[CAP_ID_GAP];
    T_LE(span, sum + s->box.count[CAP_INCOMPLETE] + s->box.count[CAP_UNDERRUN]);
    T_LE(sum, span);
}

static const struct simgv_fault healthy;

T_CASE(pixels_numbers_stamps)
{
    static const char *const uri[N_CAM] = {"127.0.0.2", "T01", "view2"}; /* address, serial, name */
    for (int c = 0; c < N_CAM; c++) {
        struct session s;
        struct cap_source_config config = config_of(c);
        config.uri = uri[c];
        if (begin(&s, &config)) {
            for (int k = 0; k < 12 && next_good(&s); k++)
                ;
            ops->stop(s.src);
            T_EQ_I(s.last_stamp % (PVX_NS_PER_S / (int64_t)RING_FPS), 0); /* on the ring's grid */
            check_sum(&s);
            T_EQ_I(s.box.lost, 0);
        }
        end(&s);
    }
}

T_CASE(dropped_frames_are_gaps)
{
    struct session s;
    struct cap_source_config config = config_of(1);
    if (begin(&s, &config)) {
        next_good(&s);
        order(OP_FAULT, 1, (struct simgv_fault){.drop = 0.5});
        for (int k = 0; k < 200 && counted(&s.box, CAP_ID_GAP) < 5 && next_good(&s); k++)
            ;
        order(OP_FAULT, 1, healthy);
        for (int k = 0; k < 2; k++)
            next_good(&s);
        T_LE(5, counted(&s.box, CAP_ID_GAP));
        T_LE(5, order(OP_STATS, 1, healthy).stats.dropped);
        ops->stop(s.src);
        check_sum(&s);
    }
    end(&s);
}

T_CASE(late_frames_keep_their_stamps)
{
    struct session s;
    struct cap_source_config config = config_of(0);
    if (begin(&s, &config)) {
        next_good(&s);
        order(OP_FAULT, 0, (struct simgv_fault){.delay_ms = 150});
        int64_t least = INT64_MAX, from = pvx_now_real();
        for (int late = 0; late < 10;) {
            struct cap_frame *f = next_frame(&s.box);
            T_OK(f != NULL);
            if (f == NULL)
                break;
            int64_t i = cap_gvcam_index(f->t_device_ns, RING_FPS) % N_RING;
            T_OK(memcmp(f->img.data, images[0][i], image_bytes(0)) == 0);
            T_OK(f->t_device_ns > s.last_stamp);
            s.last_stamp = f->t_device_ns;
            int64_t age = f->t_arrival_ns - f->t_device_ns;
            if (f->t_device_ns > from) { /* the first ones were under way already */
                late++;
                least = age < least ? age : least;
            }
            cap_frame_release(f);
        }
        T_LE(120, (double)least * 1e-6);
        order(OP_FAULT, 0, healthy);
    }
    end(&s);
}

T_CASE(software_trigger)
{
    struct session s;
    struct cap_source_config config = config_of(1);
    config.trigger = CAP_TRIGGER_SOFTWARE;
    if (begin(&s, &config)) {
        for (int k = 0; k < 8; k++) {
            int64_t before = pvx_now_real();
            T_EQ_I(ops->trigger(s.src), PVX_OK);
            if (!next_good(&s))
                break;
            T_OK(s.last_stamp >= before);
        }
        ops->stop(s.src);
        T_EQ_I(s.good, 8);
        T_EQ_I(s.last_id - s.first_id + 1, 8); /* one each, none on its own */
    }
    end(&s);
}

T_CASE(slow_consumer_is_an_underrun)
{
    struct session s;
    struct cap_source_config config = config_of(0);
    config.buffers = 4;
    if (begin(&s, &config)) {
        T_OK(wait_count(&s.box, &s.box.count[CAP_UNDERRUN], 3)); /* nothing is released */
        T_EQ_I(s.box.n_held, 4);
        for (int k = 0; k < 8 && next_good(&s); k++)
            ;
        ops->stop(s.src);
        check_sum(&s);
    }
    end(&s);
}

T_CASE(frames_outlive_their_source)
{
    struct session s;
    struct cap_source_config config = config_of(1);
    if (begin(&s, &config)) {
        struct cap_frame *a = next_frame(&s.box), *b = next_frame(&s.box);
        ops->stop(s.src);
        struct cap_sink sink = SINK_OF(&s.box);
        struct pvx_diag d = {""};
        T_EQ_I(ops->start(s.src, &sink, &d), PVX_OK); /* and again, with two buffers out */
        empty_box(&s.box);
        struct cap_frame *c = next_frame(&s.box);
        ops->stop(s.src);
        ops->close(&s.src);
        struct cap_frame *all[] = {a, b, c};
        for (int k = 0; k < 3; k++) {
            T_OK(all[k] != NULL);
            if (all[k] == NULL)
                continue;
            int64_t i = cap_gvcam_index(all[k]->t_device_ns, RING_FPS) % N_RING;
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

T_CASE(refusals_have_reasons)
{
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
T_CASE(listing)
{
    struct session s;
    struct cap_source_config config = config_of(1);
    config.gige.frame_retention_ms = 5000; /* on a busy machine a frame may be long on its way */
    struct listed l = {0};
    struct pvx_diag d = {""};
    if (begin(&s, &config)) {
        next_good(&s);
        T_EQ_I(ops->list(on_found, &l, &d), PVX_OK);
        T_EQ_I(l.n, N_CAM);
        T_EQ_I(l.used, 1);
        T_EQ_I(l.formats, N_CAM - 1);
        T_CONTAINS(l.text[0], "serial T00, name view0, GigEVision");
        T_CONTAINS(l.text[1], "in use");
        for (int k = 0; k < 18 && next_good(&s); k++) /* 8 that waited, 10 from now on */
            ;
        ops->stop(s.src);
        T_EQ_I(s.box.lost, 0);
        check_sum(&s);
        T_EQ_I(s.box.count[CAP_INCOMPLETE] + s.box.count[CAP_ID_GAP], 0);
    }
    end(&s);
}

/* Without a word: nobody waits for Aravis to see it, and the camera is usable as soon as it is back. */
T_CASE(silent_and_back)
{
    struct session s;
    struct cap_source_config config = config_of(1);
    config.name = "a"; /* as refuse expects */
    if (begin(&s, &config)) {
        next_good(&s);
        order(OP_KILL, 1, healthy);
    }
    int64_t before = pvx_now_mono();
    end(&s);
    printf("  given up in %.2f s; 5 to 7.5 when Aravis is asked\n",
           (double)(pvx_now_mono() - before) * 1e-9);
    refuse(config, PVX_ENOENT, "no camera answers there");
    order(OP_REVIVE, 1, healthy);
    if (begin(&s, &config)) /* while the old one is still being given up */
        for (int k = 0; k < 3; k++)
            T_OK(next_good(&s));
    end(&s);
}

/* ---- all cameras under supervision ------------------------------------------------------------ */

static struct rig r;

/* So many sets of so many members, one after the other. */
static bool sets_until(uint32_t members, int how_many)
{
    int n = 0;
    UNTIL (n >= how_many) {
        struct cap_set *set;
        if (cap_capture_next(r.cap, PVX_NS_PER_S, &set) != PVX_OK)
            continue;
        n = set->n == members ? n + 1 : 0;
        for (int c = 0; c < N_CAM; c++) {
            if (set->frame[c] == NULL)
                continue;
            const struct cap_frame *f = set->frame[c];
            T_EQ_I(f->t_exposure_ns, set->t_exposure_ns); /* one instant, all cameras */
            int64_t i = cap_gvcam_index(set->t_exposure_ns, RING_FPS) % N_RING;
            T_OK(memcmp(f->img.data, images[c][i], image_bytes(c)) == 0);
        }
        T_EQ_I(set->spread_ns, 0);
        cap_set_release(set);
    }
    return n == how_many;
}

T_CASE(sets_of_one_instant)
{
    rig_init(&r, N_CAM, RING_FPS, config_of(0));
    for (int c = 0; c < N_CAM; c++) {
        r.cam[c] = config_of(c);
        r.cam[c].uri = r.uri[c];
        r.cam[c].buffers = 16;
        snprintf(r.uri[c], sizeof r.uri[c], "aravis:127.0.0.%d", 2 + c);
    }
    r.cfg.shared_clock = true;
    r.cfg.discard_first = 1;
    r.cfg.sets.max_wait_ns = 500 * PVX_NS_PER_MS;
    r.cfg.sets.min_cameras = 2;
    rig_start(&r);
    T_OK(sets_until(N_CAM, 10));
    order(OP_FAULT, 2, (struct simgv_fault){.freeze = true});
    T_OK(sets_until(N_CAM - 1, 5));
    order(OP_FAULT, 2, healthy);
    T_OK(sets_until(N_CAM, 5));
    T_LE(1, rig_stats(&r)->camera[2].count[CAP_BAD_STAMP]);
    order(OP_KILL, 1, healthy);
    T_OK(sets_until(N_CAM - 1, 5));
    order(OP_REVIVE, 1, healthy);
    T_OK(sets_until(N_CAM, 5));
    rig_end(&r);
    T_LE(1, r.st.camera[1].count[CAP_LOST_CAMERA]);
    T_EQ_I(r.st.camera[0].count[CAP_LOST_CAMERA], 0);
}

static void set_up(void)
{
    t_skip_all = "no private network and no addresses 127.0.0.2 to 127.0.0.4 here";
    make_images();
    pvx_log_set_level(PVX_LOG_ERROR);
    struct pvx_diag d = {""};
    pvx_err e = cap_netns_enter(N_CAM, &d);
    if (e == PVX_OK || have_addresses("127.0.0.2", N_CAM))
        start_server();
    else
        printf("  %s\n", pvx_diag_text(&d, e));
}

static void tear_down(void)
{
    if (server > 0)
        stop_server();
    for (int c = 0; c < N_CAM; c++)
        for (int i = 0; i < N_RING; i++)
            free(images[c][i]);
}

T_MAIN(set_up(), tear_down())
