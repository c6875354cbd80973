/* Orders to simulated cameras reach the pictures of a client of the real protocol: the frame exposed after an order
 * shows it, bit for bit as a camera that was so from the start, and the next one after it was taken back is healthy. */
#include "daemon/cli/simcams/ring.h"
#include "tests/lib/gvraw.h"

#define CAMERAS 3
#define BLACK   5 /* grey levels of 255 */
#define NOISE   0.005

static struct rec_rig rig;
static struct simcams_ring ring; /* camera 0 of it is served */
static struct simcams_state state[CAMERAS];

static bool renew(void *ctx, size_t k, const struct cap_optics *o)
{
    return simcams_ring_renew(ctx, 0, k, o);
}

static void make_ring(bool keep, struct simcams_ring *out)
{
    struct simcams_ring_params p = {.fmt = CAP_RGB8,
                                    .n = BED_RING,
                                    .fps = BED_FPS,
                                    .seed = 2,
                                    .noise = {NOISE, NOISE, NOISE},
                                    .sub = 1,
                                    .keep = keep,
                                    .state = state};
    T_EQ_I(simcams_ring_init(&rig, &p, NULL, NULL, out), PVX_OK);
}

static void order(const char *line)
{
    struct simcams_order o;
    struct pvx_diag d = {""};
    T_EQ_I(simcams_control(&rig, line, state, &o, &d), PVX_OK);
    T_EQ_S(d.text, "");
    bed_fault(0, state[0].fault);
}

/* Camera 0 healthy, with so many images. */
static void healthy_camera(size_t images)
{
    struct cap_gvcam_config config = bed_config(0);
    for (int c = 0; c < CAMERAS; c++) {
        state[c] = simcams_healthy();
        state[c].fault.optics.pedestal = BLACK / 255.0;
    }
    if (ring.image == NULL)
        make_ring(true, &ring);
    config.ring = (const void *const *)ring.image;
    config.n_ring = images;
    config.renew = renew;
    config.renew_ctx = &ring;
    bed_restart(0, &config);
    bed_fault(0, state[0].fault);
}

/* With a client that triggers it. */
static ArvStream *begin(ArvCamera **cam)
{
    healthy_camera(BED_RING);
    if ((*cam = bed_rgb(0, 9000)) == NULL)
        return NULL;
    BED(arv_camera_set_trigger(*cam, "Software", &e));
    return bed_start(*cam, 10, true);
}

static void end(ArvCamera *cam, ArvStream *s)
{
    if (cam == NULL)
        return;
    bed_stop(cam, &s);
    g_object_unref(cam);
}

/* The next frame: its bytes, and which image its stamp names. */
static size_t next(ArvCamera *cam, ArvStream *s, unsigned char *out)
{
    size_t size = 0;
    ArvBuffer *b = bed_triggered(cam, s, NULL);
    if (b == NULL)
        return 0;
    const void *data = arv_buffer_get_data(b, &size);
    int64_t index = cap_gvcam_index((int64_t)arv_buffer_get_timestamp(b), BED_FPS);
    T_EQ_I(size, BED_BYTES);
    if (size == BED_BYTES)
        memcpy(out, data, size);
    arv_stream_push_buffer(s, b);
    return (size_t)(index % BED_RING);
}

/* What a picture shows: light above black in all, where its middle is, least and most. */
struct shown {
    double sum, x, y;
    int least, most;
};
static struct shown look(const unsigned char *image)
{
    struct shown r = {.least = 255};
    for (size_t k = 0; k < BED_BYTES; k++) {
        double v = image[k] - BLACK;
        r.sum += v;
        r.x += v * (double)(k / 3 % BED_W);
        r.y += v * (double)(k / 3 / BED_W);
        r.least = image[k] < r.least ? image[k] : r.least;
        r.most = image[k] > r.most ? image[k] : r.most;
    }
    r.x /= r.sum;
    r.y /= r.sum;
    return r;
}

#define NOISE_5 (int)(5 * NOISE * 255 + 1)

static bool is_dark(const struct shown *v, const struct shown *healthy)
{
    (void)healthy;
    return v->most <= BLACK + NOISE_5;
}
static bool is_flooded(const struct shown *v, const struct shown *healthy)
{
    (void)healthy;
    return v->least == 255;
}
static bool is_shifted(const struct shown *v, const struct shown *healthy)
{
    return fabs(v->x - healthy->x - 16) < 1 && fabs(v->y - healthy->y + 3) < 1;
}
static bool is_half(const struct shown *v, const struct shown *healthy)
{
    return fabs(v->sum / healthy->sum - 0.5) < 0.02;
}
static bool is_flat(const struct shown *v, const struct shown *healthy)
{
    (void)healthy;
    return v->least > 255 * 0.45 - NOISE_5 && v->most < 255 * 0.55 + BLACK + NOISE_5;
}
static bool is_raised(const struct shown *v, const struct shown *healthy)
{
    return fabs((v->sum - healthy->sum) / (double)BED_BYTES - 255 * 0.1 + BLACK) < 0.5;
}

T_CASE(an_order_is_seen_in_the_next_frame)
{
    static const struct {
        const char *on, *off;
        bool (*judge)(const struct shown *v, const struct shown *healthy);
    } t[] = {{"cap cam0 on", "cap cam0 off", is_dark},
             {"flood cam0 on", "flood cam0 off", is_flooded},
             {"empty cam0 on", "empty cam0 off", is_dark},
             {"shift cam0 16:-3", "shift cam0 0:0", is_shifted},
             {"gain cam0 0.5", "gain cam0 1", is_half},
             {"exposure all 0.5", "exposure all 1", is_half},
             {"flat cam0 2", "flat cam0 0", is_flat},
             {"pedestal cam0 0.1", "pedestal cam0 0.0196078431372549", is_raised}};
    static unsigned char got[BED_BYTES];
    ArvCamera *cam;
    ArvStream *s = begin(&cam);
    for (size_t i = 0; s != NULL && i < sizeof t / sizeof t[0]; i++) {
        struct simcams_ring healthy, broken;
        make_ring(false, &healthy);
        order(t[i].on);
        make_ring(false, &broken);
        for (int k = 0; k < 4; k++) {
            size_t at = next(cam, s, got);
            struct shown was = look(healthy.image[at]), is = look(got);
            T_CHECK_(memcmp(got, broken.image[at], BED_BYTES) == 0, "%s: not as it should be",
                     t[i].on);
            T_CHECK_(t[i].judge(&is, &was), "%s: sum %g of %g, middle %g %g of %g %g, %d to %d",
                     t[i].on, is.sum, was.sum, is.x, is.y, was.x, was.y, is.least, is.most);
            T_OK(!t[i].judge(&was, &was));
            usleep(20000); /* another image */
        }
        order(t[i].off);
        size_t at = next(cam, s, got);
        T_CHECK_(memcmp(got, healthy.image[at], BED_BYTES) == 0, "%s: not healthy again", t[i].off);
        simcams_ring_fini(&healthy);
        simcams_ring_fini(&broken);
    }
    end(cam, s);
}

/* late: the picture of some frames before; still: the same one for ever; the stamps go on in both. */
T_CASE(late_and_still_are_other_instants)
{
    enum { N = 12, LATE = 3 };
    static unsigned char got[BED_BYTES];
    size_t at[N];
    struct simcams_ring truth;
    ArvCamera *cam;
    ArvStream *s = begin(&cam);
    make_ring(false, &truth);
    order("late cam0 3");
    bool other = false;
    for (int k = 0; s != NULL && k < N; k++) {
        at[k] = next(cam, s, got);
        size_t shows = at[k < LATE ? 0 : k - LATE]; /* nothing is older than the first */
        T_OK(memcmp(got, truth.image[shows], BED_BYTES) == 0);
        other |= shows != at[k];
        usleep(20000);
    }
    T_OK(other);
    order("late cam0 0");
    order("still cam0 on");
    size_t held = 0;
    for (int k = 0; s != NULL && k < N; k++) {
        at[k] = next(cam, s, got);
        held = k == 0 ? at[0] : held;
        other |= at[k] != held;
        T_OK(memcmp(got, truth.image[held], BED_BYTES) == 0);
        usleep(20000);
    }
    order("still cam0 off");
    if (s != NULL)
        held = next(cam, s, got);
    T_OK(memcmp(got, truth.image[held], BED_BYTES) == 0);
    end(cam, s);
    simcams_ring_fini(&truth);
}

/* A frame by trigger: its number and the brightest of its pixels. */
static uint16_t raw_frame(struct raw *r, int *most)
{
    struct packet p = {0};
    *most = 0;
    usleep(50); /* exposure: 10 us */
    T_EQ_I(raw_write(r, feature(GVF_TRIGGER_SOFTWARE), 1), CAP_GVCP_OK);
    while (raw_packet(r, 10000, &p) && p.h.content != CAP_GVSP_TRAIL)
        for (size_t k = p.head; p.h.content == CAP_GVSP_DATA && k < p.bytes; k++)
            *most = p.data[k] > *most ? p.data[k] : *most;
    T_EQ_I(p.h.content, CAP_GVSP_TRAIL);
    return (uint16_t)p.h.block;
}

/* What the camera says to the request for packet 1 of a frame. */
static uint16_t again(struct raw *r, uint16_t block)
{
    uint8_t p[CAP_GVCP_MAX], data[12] = {0};
    struct packet answer = {0};
    cap_put16(data + 2, block);
    cap_put32(data + 4, 1);
    cap_put32(data + 8, 1);
    raw_send(r, p, cap_gvcp_put_command(p, 0, CAP_GVCP_RESEND, 1, data, sizeof data));
    T_OK(raw_packet(r, 10000, &answer));
    T_EQ_I(answer.h.block, block);
    return answer.h.status;
}

/* What was sent is not sent again as something else: of an image that was made anew there is no frame left. */
T_CASE(frames_before_an_order_are_gone)
{
    struct raw r;
    int bright, dark;
    healthy_camera(1);
    raw_open(&r, bed_address[0]);
    raw_prepare(&r, BED_W, BED_H, 1400);
    raw_triggered(&r, 0);
    raw_start(&r);
    uint16_t before = raw_frame(&r, &bright);
    T_EQ_I(again(&r, before), CAP_GVSP_RESENT);
    order("cap cam0 on");
    T_EQ_I(again(&r, before), CAP_GVSP_RESENT); /* no frame since */
    uint16_t after = raw_frame(&r, &dark);
    T_EQ_I(again(&r, before), CAP_GVCP_PACKET_REMOVED);
    T_EQ_I(again(&r, after), CAP_GVSP_RESENT);
    T_LE(60, bright);
    T_LE(dark, BLACK + NOISE_5);
    raw_stop(&r);
    raw_leave(&r);
}

static void set_up(void)
{
    bed_open();
    if (bed_usable && rec_rig_ring(CAMERAS, 2.5, BED_W, BED_H, 32, &rig) != PVX_OK)
        exit(1);
}
static void clear_up(void)
{
    bed_close();
    simcams_ring_fini(&ring);
    rec_rig_fini(&rig);
}
T_MAIN(set_up(), clear_up())
