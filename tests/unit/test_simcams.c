/* What `pyrovox simcams` serves and the lines that change it: ring of images, faults, timetable, control. */
#include "daemon/cli/simcams/faults.c"
#include "daemon/cli/simcams/ring.c"
#include "tests/lib/plugins.h"
#include "tests/t.h"

static struct rec_rig rig;

static pvx_err set_line(const char *line, struct simcams_state *st, struct pvx_diag *d)
{
    struct simcams_plan plan = {0};
    pvx_err e = simcams_set_line(&rig, line, st, &plan, d);
    T_EQ_I(plan.n, 0);
    return e;
}

T_CASE(set_for_all_or_one)
{
    struct simcams_state st[3] = {0};
    struct pvx_diag d = {""};
    T_EQ_I(set_line("drop all 0.25", st, &d), PVX_OK);
    T_NEAR(st[0].fault.drop, 0.25, 0);
    T_NEAR(st[2].fault.drop, 0.25, 0);
    T_EQ_I(set_line("skew cam1 -500", st, &d), PVX_OK);
    T_EQ_I(set_line("skew cam2 1e3", st, &d), PVX_OK);
    T_NEAR(st[0].fault.skew_us, 0, 0);
    T_NEAR(st[1].fault.skew_us, -500, 0);
    T_NEAR(st[2].fault.skew_us, 1000, 0);
    T_EQ_I(set_line("delay cam0 12", st, &d), PVX_OK);
    T_NEAR(st[0].fault.delay_ms, 12, 0);
    T_EQ_I(set_line("loss cam0 0.1", st, &d), PVX_OK);
    T_NEAR(st[0].fault.packet_loss, 0.1, 0);
    T_EQ_I(set_line("drift all 40", st, &d), PVX_OK);
    T_NEAR(st[1].fault.drift_ppm, 40, 0);
    T_EQ_I(set_line("shift cam1 64:-2.5", st, &d), PVX_OK);
    T_EQ_I(set_line("shift cam2 0:1", st, &d), PVX_OK);
    T_NEAR(st[1].fault.optics.shift[0], 64, 0);
    T_NEAR(st[1].fault.optics.shift[1], -2.5, 0);
    T_NEAR(st[2].fault.optics.shift[1], 1, 0);
    T_NEAR(st[0].fault.optics.shift[0], 0, 0);
    T_EQ_I(set_line("cap cam1 on", st, &d), PVX_OK);
    T_OK(!st[0].fault.optics.cap && st[1].fault.optics.cap);
    T_EQ_I(set_line("cap all on", st, &d), PVX_OK);
    T_EQ_I(set_line("cap cam1 off", st, &d), PVX_OK);
    T_OK(st[0].fault.optics.cap && !st[1].fault.optics.cap);
    T_EQ_I(set_line("kill cam1", st, &d), PVX_OK);
    T_OK(!st[1].alive);
}

T_CASE(lines_that_are_wrong)
{
    static const struct {
        const char *line;
        pvx_err e;
        const char *says;
    } bad[] = {{"drop all 1.5", PVX_EINVAL, "0 to 1"},
               {"drop cam7 0.1", PVX_ENOENT, "cam7"},
               {"drop cam1", PVX_EINVAL, "cam1"},
               {"drop", PVX_EINVAL, "drop"},
               {"drop all 0.1,", PVX_EINVAL, "drop"},
               {"drop all nan", PVX_EINVAL, "nan"},
               {"shift all 64", PVX_EINVAL, "shift all: '64' should be two numbers X:Y"},
               {"shift cam1 64:", PVX_EINVAL, "shift cam1"},
               {"shift all 1:2:3", PVX_EINVAL, "shift"},
               {"shift all 1:20000", PVX_EINVAL, "-16384 to 16384"},
               {"gain all 1:2", PVX_EINVAL, "gain all: '1:2' should be a number"},
               {"gain all -1", PVX_EINVAL, "0 to 1000"},
               {"response all 0", PVX_EINVAL, "0.1 to 10"},
               {"late all 64", PVX_EINVAL, "0 to 63"},
               {"vignetting all 1", PVX_EINVAL, "0 to 0.99"},
               {"cap all 1", PVX_EINVAL, "cap all: '1' should be on or off"},
               {"cap all cam1", PVX_EINVAL, "on or off"}};
    for (size_t k = 0; k < sizeof bad / sizeof bad[0]; k++) {
        struct simcams_state st[3] = {0};
        struct pvx_diag d = {""};
        T_EQ_I(set_line(bad[k].line, st, &d), bad[k].e);
        T_CONTAINS(d.text, bad[k].says);
    }
}

T_CASE(timetable_is_in_order)
{
    struct simcams_plan plan = {0};
    struct simcams_state st[3] = {0};
    struct pvx_diag d = {""};
    T_EQ_I(simcams_at_line(&rig, "5:freeze cam0 on", &plan, &d), PVX_OK);
    T_EQ_I(simcams_at_line(&rig, "9.5:freeze cam0 off", &plan, &d), PVX_OK);
    T_EQ_I(simcams_at_line(&rig, "1:kill cam2", &plan, &d), PVX_OK);
    T_EQ_I(simcams_at_line(&rig, "7:freeze all on", &plan, &d), PVX_OK);
    T_EQ_I(simcams_at_line(&rig, "6:reboot cam1 2.5", &plan, &d), PVX_OK);
    T_EQ_I(simcams_set_line(&rig, "line 30", st, &plan, &d), PVX_OK);
    T_EQ_I(plan.n, 6);
    static const char *const want[] = {"line 30",         "kill cam2",     "freeze cam0 on",
                                       "reboot cam1 2.5", "freeze all on", "freeze cam0 off"};
    for (size_t k = 0; k < plan.n; k++)
        T_EQ_S(plan.event[k].line, want[k]);
    static const char *const bad[] = {"kill cam0",    "x:kill cam0", "3:kill cam9", ":",
                                      "-1:pulse",     "3:explode",   "cam0@3",      "3:kill",
                                      "@3:kill cam0", ":kill cam0"};
    for (size_t k = 0; k < sizeof bad / sizeof bad[0]; k++)
        T_OK(simcams_at_line(&rig, bad[k], &plan, NULL) != PVX_OK);
    T_EQ_I(plan.n, 6);
    pvx_err e = PVX_OK;
    for (int k = 0; k < 100 && e == PVX_OK; k++)
        e = simcams_at_line(&rig, "1:kill cam0", &plan, NULL);
    T_EQ_I(e, PVX_ERANGE);
    T_EQ_I(plan.n, SIMCAMS_MAX_EVENTS);
}

T_CASE(control_lines)
{
    struct simcams_state st[3] = {{.alive = true}, {.alive = true}, {.alive = true}};
    struct simcams_order order;
    struct pvx_diag d = {""};
    static const char *const good[] = {"drop cam1 0.1",       "loss cam0 0.5",
                                       " delay  cam2 20 ",    "",
                                       "freeze all on",       "freeze cam0 off",
                                       "kill cam1",           "skew cam0 10",
                                       "drift all 3",         "   ",
                                       "jitter cam0 1.5",     "reorder cam0 0.2",
                                       "duplicate cam0 1",    "size cam1 0.3",
                                       "corrupt cam1 0.4",    "miss cam1 0.6",
                                       "hostile cam2 0.7",    "stuck cam2 on",
                                       "no-ptp cam1 on",      "ptp-offset cam0 -40",
                                       "ptp-master cam1 on",  "lock-trigger all on",
                                       "cap cam1 on",         "flood cam2 on",
                                       "empty cam0 on",       "mirrored cam0 on",
                                       "still cam1 on",       "late cam2 3",
                                       "shift cam2 64:-2.5",  "blur cam0 1.5",
                                       "flat cam0 2",         "background cam0 0.02",
                                       "vignetting cam1 0.3", "gain cam1 0.5",
                                       "exposure cam1 0.25",  "response cam2 0.45",
                                       "pedestal cam2 0.03",  "hot cam2 0.01",
                                       "inputs cam1 6"};
    for (size_t k = 0; k < sizeof good / sizeof good[0]; k++) {
        T_EQ_I(simcams_control(&rig, good[k], st, &order, &d), PVX_OK);
        T_EQ_I(order.what, SIMCAMS_NOTHING);
    }
    T_NEAR(st[1].fault.drop, 0.1, 0);
    T_NEAR(st[0].fault.packet_loss, 0.5, 0);
    T_NEAR(st[2].fault.delay_ms, 20, 0);
    T_OK(!st[0].fault.freeze && st[1].fault.freeze);
    T_OK(st[0].alive && !st[1].alive);
    T_NEAR(st[0].fault.jitter_ms, 1.5, 0);
    T_NEAR(st[0].fault.reorder, 0.2, 0);
    T_NEAR(st[0].fault.duplicate, 1, 0);
    T_NEAR(st[1].fault.wrong_size, 0.3, 0);
    T_NEAR(st[1].fault.corrupt, 0.4, 0);
    T_NEAR(st[1].fault.miss, 0.6, 0);
    T_NEAR(st[2].fault.hostile, 0.7, 0);
    T_OK(st[2].fault.stuck_clock && !st[1].fault.stuck_clock && st[1].fault.no_ptp_master);
    T_OK(st[1].fault.ptp_master && !st[0].fault.ptp_master && st[0].fault.lock_trigger);
    T_NEAR(st[0].fault.ptp_offset_us, -40, 0);
    const struct cap_optics *o = &st[0].fault.optics, *p = &st[1].fault.optics,
                            *q = &st[2].fault.optics;
    T_OK(p->cap && q->flood && o->empty && o->mirrored && !o->cap && !p->flood);
    T_OK(st[1].fault.still && !st[0].fault.still);
    T_NEAR(st[2].fault.late, 3, 0);
    T_NEAR(q->shift[0], 64, 0);
    T_NEAR(q->shift[1], -2.5, 0);
    T_NEAR(o->blur, 1.5, 0);
    T_NEAR(o->flat, 2, 0);
    T_NEAR(o->background, 0.02, 0);
    T_NEAR(p->vignetting, 0.3, 0);
    T_NEAR(p->gain, 0.5, 0);
    T_NEAR(p->exposure, 0.25, 0);
    T_NEAR(q->response, 0.45, 0);
    T_NEAR(q->pedestal, 0.03, 0);
    T_NEAR(q->hot, 0.01, 0);
    T_NEAR(st[1].fault.inputs, 6, 0);
    T_EQ_I(simcams_control(&rig, "revive all", st, &order, &d), PVX_OK);
    T_OK(st[1].alive);
    static const char *const bad[] = {"drop cam1",
                                      "drop cam1 2",
                                      "freeze cam1",
                                      "freeze cam1 maybe",
                                      "kill",
                                      "kill cam9",
                                      "explode cam1",
                                      "cap cam1",
                                      "cap cam1 1",
                                      "shift cam1 3",
                                      "shift cam1 3 4",
                                      "shift cam1 3,4",
                                      "gain cam1 on",
                                      "flat cam1 -1",
                                      "still",
                                      "kill cam1 now",
                                      "drop cam1 0.1 0.2",
                                      "reboot",
                                      "reboot cam1 x",
                                      "jump cam1",
                                      "inputs cam1 on",
                                      "line",
                                      "line -3",
                                      "link",
                                      "link 100 x",
                                      "switch",
                                      "pulse 3",
                                      "stats all",
                                      "ids",
                                      "ids cam1 0",
                                      "trigger-mode cam1",
                                      "trigger-mode cam1 2"};
    for (size_t k = 0; k < sizeof bad / sizeof bad[0]; k++) {
        d.text[0] = '\0';
        T_OK(simcams_control(&rig, bad[k], st, &order, &d) != PVX_OK);
        T_OK(d.text[0] != '\0');
    }
    d.text[0] = '\0';
    T_EQ_I(simcams_control(&rig, "explode cam1", st, &order, &d), PVX_EINVAL);
    static const char *const says[] = {"'explode cam1'", "cap|", "|gain|", "shift CAMERA X:Y",
                                       "pose NUMBER"};
    for (size_t k = 0; k < sizeof says / sizeof says[0]; k++) /* every word there is */
        T_CONTAINS(d.text, says[k]);
}

T_CASE(control_orders)
{
    struct simcams_state st[3] = {0};
    static const struct {
        const char *line;
        struct simcams_order want;
    } t[] = {{"reboot cam1", {SIMCAMS_REBOOT, 1, 2, 0, 0}},
             {"reboot all 4", {SIMCAMS_REBOOT, 0, 3, 4, 0}},
             {"jump cam2 -1.5", {SIMCAMS_JUMP, 2, 3, -1.5, 0}},
             {"ids cam0", {SIMCAMS_IDS, 0, 1, 0, 0}},
             {"ids all 65500", {SIMCAMS_IDS, 0, 3, 65500, 0}},
             {"trigger-mode cam1 1", {SIMCAMS_MODE, 1, 2, 1, 0}},
             {"line 25", {SIMCAMS_LINE, 0, 3, 25, 0}},
             {"pulse", {SIMCAMS_PULSE, 0, 3, 0, 0}},
             {"link 1000 256", {SIMCAMS_LINK, 0, 3, 1000, 256}},
             {"switch 1.5", {SIMCAMS_SWITCH, 0, 3, 1.5, 0}},
             {"stats", {SIMCAMS_STATS, 0, 3, 0, 0}}};
    for (size_t k = 0; k < sizeof t / sizeof t[0]; k++) {
        struct simcams_order o;
        T_EQ_I(simcams_control(&rig, t[k].line, st, &o, NULL), PVX_OK);
        T_EQ_I(o.what, t[k].want.what);
        T_EQ_I(o.lo, t[k].want.lo);
        T_EQ_I(o.hi, t[k].want.hi);
        T_NEAR(o.arg, t[k].want.arg, 0);
        T_NEAR(o.arg2, t[k].want.arg2, 0);
    }
}

static struct simcams_ring_params params(enum cap_pixfmt fmt, double noise)
{
    return (struct simcams_ring_params){
        .fmt = fmt, .n = 6, .fps = 12, .seed = 3, .noise = {noise, noise, noise}, .sub = 1};
}

/* Every pixel is the flame's at i/fps, rounded. */
T_CASE(ring_is_the_flame)
{
    static const enum cap_pixfmt fmts[] = {CAP_GREY8, CAP_RGB8, CAP_BAYER_RG8};
    struct rec_flame flame;
    struct rec_flame_pose pose;
    simcams_flame(&rig, 6, 12, 3, &flame);
    T_NEAR(flame.period_s, 0.5, 1e-12);
    const struct rec_camera *cam = &rig.cameras[1];
    float *want = calloc((size_t)cam->width * (size_t)cam->height * 3, sizeof *want);
    for (size_t k = 0; k < 3; k++) {
        struct simcams_ring ring;
        struct simcams_ring_params p = params(fmts[k], 0);
        T_EQ_I(simcams_ring_init(&rig, &p, NULL, NULL, &ring), PVX_OK);
        rec_flame_at(&flame, 4 / 12.0 + 7 * flame.period_s, &pose);
        rec_flame_render(&pose, cam, 1, 0, cam->height, want);
        if (ring.image == NULL)
            abort();
        const unsigned char *got = ring.image[1 * ring.n + 4];
        int worst = 0, top = 0;
        for (int32_t y = 0; y < cam->height; y++)
            for (int32_t x = 0; x < cam->width; x++) {
                size_t at = (size_t)y * (size_t)cam->width + (size_t)x;
                for (int ch = 0; ch < (fmts[k] == CAP_RGB8 ? 3 : 1); ch++) {
                    const float *l = want + 3 * at;
                    double v = fmts[k] == CAP_RGB8    ? l[ch]
                               : fmts[k] == CAP_GREY8 ? (l[0] + l[1] + l[2]) / 3.0
                                                      : l[(x & 1) + (y & 1)];
                    int byte = got[fmts[k] == CAP_RGB8 ? 3 * at + (size_t)ch : at];
                    int diff = abs(byte - (int)(255 * v + 0.5));
                    worst = diff > worst ? diff : worst;
                    top = byte > top ? byte : top;
                }
            }
        T_LE(worst, 1); /* float against double rounding */
        T_LE(60, top);
        T_EQ_I(simcams_ring_bytes(&rig, &p),
               3 * 6 * (size_t)cam->width * (size_t)cam->height * cap_pixfmt_row(fmts[k], 1));
        simcams_ring_fini(&ring);
    }
    free(want);
}

/* Of each colour its own, on the pixels that have it. */
T_CASE(noise_by_channel)
{
    static const double noise[3] = {0.05, 0.02, 0.01};
    static const enum cap_pixfmt fmts[] = {CAP_RGB8, CAP_BAYER_RG8};
    size_t w = (size_t)rig.cameras[0].width, pixels = w * (size_t)rig.cameras[0].height;
    for (int f = 0; f < 2; f++) {
        struct simcams_ring clean, noisy;
        struct simcams_ring_params p = params(fmts[f], 0);
        double sum2[3] = {0}, n[3] = {0};
        T_EQ_I(simcams_ring_init(&rig, &p, NULL, NULL, &clean), PVX_OK);
        memcpy(p.noise, noise, sizeof noise);
        T_EQ_I(simcams_ring_init(&rig, &p, NULL, NULL, &noisy), PVX_OK);
        for (size_t i = 0; i < 3 * 6; i++) {
            const unsigned char *u = clean.image[i], *v = noisy.image[i];
            for (size_t k = 0; k < (f == 0 ? 3 : 1) * pixels; k++) {
                size_t channel = f == 0 ? k % 3 : (k % w & 1) + (k / w & 1);
                double clipped = 4 * 255 * noise[channel];
                if (u[k] < clipped || u[k] > 255 - clipped)
                    continue;
                n[channel]++;
                sum2[channel] += (v[k] - u[k]) * (v[k] - u[k]);
            }
        }
        for (int k = 0; k < 3; k++) {
            T_LE(60, n[k]); /* 4 standard errors, and rounding */
            T_NEAR(sqrt(sum2[k] / n[k]) / 255, noise[k], noise[k] * (0.03 + 4 / sqrt(2 * n[k])));
        }
        simcams_ring_fini(&clean);
        simcams_ring_fini(&noisy);
    }
}

T_CASE(noise_is_as_asked_and_repeats)
{
    struct simcams_ring clean, a, b;
    struct simcams_ring_params p = params(CAP_RGB8, 0), q = params(CAP_RGB8, 0.02);
    T_EQ_I(simcams_ring_init(&rig, &p, NULL, NULL, &clean), PVX_OK);
    T_EQ_I(simcams_ring_init(&rig, &q, NULL, NULL, &a), PVX_OK);
    T_EQ_I(simcams_ring_init(&rig, &q, NULL, NULL, &b), PVX_OK);
    size_t n = (size_t)rig.cameras[0].width * (size_t)rig.cameras[0].height * 3, used = 0;
    double sum = 0, sum2 = 0;
    for (size_t i = 0; i < 3 * 6; i++) {
        const unsigned char *u = clean.image[i], *v = a.image[i];
        T_OK(memcmp(a.image[i], b.image[i], n) == 0);
        for (size_t k = 0; k < n; k++)
            if (u[k] > 40 && u[k] < 215) { /* away from the clipping */
                double e = (double)v[k] - u[k];
                sum += e;
                sum2 += e * e;
                used++;
            }
    }
    T_LE(2000, used);
    T_NEAR(sum / (double)used, 0, 0.3);
    T_NEAR(sqrt(sum2 / (double)used), 0.02 * 255, 0.3);
    T_OK(memcmp(a.image[0], a.image[6], n) != 0);
    simcams_ring_fini(&clean);
    simcams_ring_fini(&a);
    simcams_ring_fini(&b);
}

/* An image can be made anew and back again; it is the one that a ring of such cameras has. */
T_CASE(images_follow_the_optics)
{
    struct simcams_state st[3] = {simcams_healthy(), simcams_healthy(), simcams_healthy()};
    struct simcams_ring ring, healthy, broken;
    struct simcams_ring_params p = params(CAP_RGB8, 0.01);
    p.state = st;
    T_EQ_I(simcams_ring_init(&rig, &p, NULL, NULL, &healthy), PVX_OK);
    p.keep = true;
    T_EQ_I(simcams_ring_init(&rig, &p, NULL, NULL, &ring), PVX_OK);
    T_EQ_I(simcams_ring_bytes(&rig, &p), 3 * 6 * (size_t)80 * 60 * (3 + 6));
    st[1].fault.optics.gain = 0.5;
    st[1].fault.optics.shift[0] = 8;
    p.keep = false;
    T_EQ_I(simcams_ring_init(&rig, &p, NULL, NULL, &broken), PVX_OK);
    size_t n = (size_t)80 * 60 * 3;
    const struct cap_optics *o = &st[1].fault.optics;
    T_OK(!simcams_ring_renew(&ring, 1, 4, &cap_optics_none));
    T_EQ_I(memcmp(ring.image[6 + 4], healthy.image[6 + 4], n), 0);
    T_OK(simcams_ring_renew(&ring, 1, 4, o));
    T_OK(!simcams_ring_renew(&ring, 1, 4, o));
    T_EQ_I(memcmp(ring.image[6 + 4], broken.image[6 + 4], n), 0);
    T_OK(memcmp(broken.image[6 + 4], healthy.image[6 + 4], n) != 0);
    T_EQ_I(memcmp(ring.image[6 + 3], healthy.image[6 + 3], n), 0);
    T_EQ_I(memcmp(broken.image[4], healthy.image[4], n), 0);
    T_OK(simcams_ring_renew(&ring, 1, 4, &cap_optics_none));
    T_EQ_I(memcmp(ring.image[6 + 4], healthy.image[6 + 4], n), 0);
    simcams_ring_fini(&ring);
    simcams_ring_fini(&healthy);
    simcams_ring_fini(&broken);
}

static bool stop_at_half(void *ctx, double done)
{
    *(int *)ctx += 1;
    return done < 0.5;
}

T_CASE(rendering_can_be_stopped)
{
    struct simcams_ring ring;
    struct simcams_ring_params p = params(CAP_GREY8, 0);
    int calls = 0;
    T_EQ_I(simcams_ring_init(&rig, &p, stop_at_half, &calls, &ring), PVX_ECANCELED);
    T_EQ_I(calls, 3);
    T_OK(ring.image == NULL);
}

#define BOARD "charuco:5x6:0.08:0.06:two-sided"

/* On the floor until all send, then from pose to pose; told to go on, it goes. */
T_CASE(the_board_stands_still_and_moves_on)
{
    struct simcams_board b;
    struct pvx_diag d = {""};
    T_EQ_I(simcams_board_init(BOARD, &rig, 3, 2, 1, &b, &d), PVX_OK);
    T_EQ_S(d.text, "");
    T_NEAR(b.pose[0][5], rig.grid.min[2], 1e-12); /* flat: its t is on the floor */
    for (int k = 0; k < 100; k++)
        T_LE(simcams_board_tick(&b, k, false), SIMCAMS_STILLS - 1);
    bool both[2] = {false, false};
    for (double t = 100; t < 102; t += 0.1) {
        size_t image = simcams_board_tick(&b, t, true);
        T_LE(image, SIMCAMS_STILLS - 1);
        both[image % 2] = true;
    }
    T_OK(both[0] && both[1]);   /* with other noise */
    for (int k = 0; k < 2; k++) /* the last of the hold, then it is on its way */
        (void)simcams_board_tick(&b, 102.1, true);
    for (int k = 1; k < SIMCAMS_MOVE_TICKS; k++) {
        size_t image = simcams_board_tick(&b, 102.1, true);
        T_OK(image >= SIMCAMS_STILLS && image < SIMCAMS_OF_POSE);
    }
    T_EQ_I(simcams_board_tick(&b, 102.1, true) / SIMCAMS_OF_POSE, 1);
    simcams_board_go(&b, 5); /* 2 */
    for (int k = 0; k < SIMCAMS_MOVE_TICKS; k++)
        (void)simcams_board_tick(&b, 102.2, true);
    T_EQ_I(simcams_board_tick(&b, 102.2, true) / SIMCAMS_OF_POSE, 2);
    b.hold_s = 0; /* it stays */
    T_EQ_I(simcams_board_tick(&b, 1e6, true) / SIMCAMS_OF_POSE, 2);
    simcams_board_fini(&b);
}

/* The same for the same seed, elsewhere for another; two stills differ by noise only. */
T_CASE(pictures_of_the_board)
{
    struct simcams_board b, other;
    struct simcams_ring clean, noisy;
    T_EQ_I(simcams_board_init(BOARD, &rig, 2, 0, 1, &b, NULL), PVX_OK);
    T_EQ_I(simcams_board_init(BOARD, &rig, 2, 0, 2, &other, NULL), PVX_OK);
    T_OK(memcmp(b.pose[SIMCAMS_OF_POSE], other.pose[SIMCAMS_OF_POSE], sizeof *b.pose) != 0);
    T_EQ_I(memcmp(b.pose[0], other.pose[0], sizeof *b.pose), 0);
    struct simcams_ring_params p = params(CAP_GREY8, 0);
    p.board = &b;
    p.n = 2 * SIMCAMS_OF_POSE;
    T_EQ_I(simcams_ring_init(&rig, &p, NULL, NULL, &clean), PVX_OK);
    p.noise[0] = p.noise[1] = p.noise[2] = 0.01;
    T_EQ_I(simcams_ring_init(&rig, &p, NULL, NULL, &noisy), PVX_OK);
    size_t n = 80 * 60;
    T_EQ_I(memcmp(clean.image[0], clean.image[1], n), 0);
    T_OK(memcmp(clean.image[0], clean.image[SIMCAMS_OF_POSE], n) != 0);
    T_OK(memcmp(noisy.image[0], noisy.image[1], n) != 0);
    simcams_ring_fini(&clean);
    simcams_ring_fini(&noisy);
    simcams_board_fini(&b);
    simcams_board_fini(&other);
}

int main(void)
{
    plugins_of_this_build();
    if (rec_rig_ring(3, 2.5, 80, 60, 32, &rig) != PVX_OK)
        return 1;
    t_run();
    rec_rig_fini(&rig);
    return t_done();
}
