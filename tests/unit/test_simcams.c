/* What `pyrovox simcams` serves and how it is told to break: ring of images, fault options, control. */
#include "cli/simcams_faults.c"
#include "cli/simcams_ring.c"
#include "tests/t.h"

static struct rec_rig rig;

static void options_for_all_or_some(void)
{
    struct simcams_state st[3] = {0};
    struct pvx_diag d = {""};
    T_EQ_I(simcams_fault_option(&rig, SIMCAMS_DROP, "0.25", st, &d), PVX_OK);
    T_NEAR(st[0].fault.drop, 0.25, 0);
    T_NEAR(st[2].fault.drop, 0.25, 0);
    T_EQ_I(simcams_fault_option(&rig, SIMCAMS_SKEW, "cam1=-500,cam2=1e3", st, &d), PVX_OK);
    T_NEAR(st[0].fault.skew_us, 0, 0);
    T_NEAR(st[1].fault.skew_us, -500, 0);
    T_NEAR(st[2].fault.skew_us, 1000, 0);
    T_EQ_I(simcams_fault_option(&rig, SIMCAMS_DELAY, "cam0=12", st, &d), PVX_OK);
    T_NEAR(st[0].fault.delay_ms, 12, 0);
    T_EQ_I(simcams_fault_option(&rig, SIMCAMS_LOSS, "cam0=0.1", st, &d), PVX_OK);
    T_NEAR(st[0].fault.packet_loss, 0.1, 0);
    T_EQ_I(simcams_fault_option(&rig, SIMCAMS_DRIFT, "40", st, &d), PVX_OK);
    T_NEAR(st[1].fault.drift_ppm, 40, 0);
}

static void options_that_are_wrong(void)
{
    static const struct {
        const char *text;
        pvx_err e;
        const char *says;
    } bad[] = {{"1.5", PVX_EINVAL, "0 to 1"}, {"cam7=0.1", PVX_ENOENT, "cam7"},
               {"cam1=", PVX_EINVAL, "cam1"}, {"", PVX_EINVAL, "drop"},
               {"0.1,", PVX_EINVAL, "drop"},  {"nan", PVX_EINVAL, "nan"},
               {"=0.1", PVX_ENOENT, "''"}};
    for (size_t k = 0; k < sizeof bad / sizeof bad[0]; k++) {
        struct simcams_state st[3] = {0};
        struct pvx_diag d = {""};
        T_EQ_I(simcams_fault_option(&rig, SIMCAMS_DROP, bad[k].text, st, &d), bad[k].e);
        T_CONTAINS(d.text, bad[k].says);
    }
}

static void timetable_is_in_order(void)
{
    struct simcams_plan plan = {0};
    struct simcams_state st[3] = {{.alive = true}, {.alive = true}, {.alive = true}};
    struct pvx_diag d = {""};
    T_EQ_I(simcams_plan_option(&rig, true, "cam0@5-9.5", &plan, &d), PVX_OK);
    T_EQ_I(simcams_plan_option(&rig, false, "cam2@1", &plan, &d), PVX_OK);
    T_EQ_I(simcams_plan_option(&rig, true, "all@7", &plan, &d), PVX_OK);
    T_EQ_I(plan.n, 6);
    for (size_t k = 1; k < plan.n; k++)
        T_LE(plan.event[k - 1].at_s, plan.event[k].at_s);
    simcams_plan_apply(&plan.event[0], st);
    T_OK(!st[2].alive && st[0].alive);
    simcams_plan_apply(&plan.event[1], st);
    T_OK(st[0].fault.freeze && !st[1].fault.freeze);
    for (size_t k = 2; k < plan.n; k++)
        simcams_plan_apply(&plan.event[k], st);
    T_OK(!st[0].fault.freeze && st[1].fault.freeze && st[2].fault.freeze);
    static const char *const bad[] = {"cam0", "cam0@", "cam0@x", "@3", "cam9@3", "cam0@-1"};
    for (size_t k = 0; k < sizeof bad / sizeof bad[0]; k++)
        T_OK(simcams_plan_option(&rig, false, bad[k], &plan, NULL) != PVX_OK);
    T_OK(simcams_plan_option(&rig, true, "cam0@9-5", &plan, NULL) != PVX_OK);
    T_OK(simcams_plan_option(&rig, false, "cam0@5-9", &plan, NULL) != PVX_OK);
    T_EQ_I(plan.n, 6);
    pvx_err e = PVX_OK;
    for (int k = 0; k < 100 && e == PVX_OK; k++)
        e = simcams_plan_option(&rig, false, "cam0@1", &plan, NULL);
    T_EQ_I(e, PVX_ERANGE);
    T_EQ_I(plan.n, SIMCAMS_MAX_EVENTS);
}

static void control_lines(void)
{
    struct simcams_state st[3] = {{.alive = true}, {.alive = true}, {.alive = true}};
    struct pvx_diag d = {""};
    static const char *const good[] = {"drop cam1 0.1",    "loss cam0 0.5",
                                       " delay  cam2 20 ", "",
                                       "freeze all on",    "freeze cam0 off",
                                       "kill cam1",        "skew cam0 10",
                                       "drift all 3",      "   "};
    for (size_t k = 0; k < sizeof good / sizeof good[0]; k++)
        T_EQ_I(simcams_control(&rig, good[k], st, &d), PVX_OK);
    T_NEAR(st[1].fault.drop, 0.1, 0);
    T_NEAR(st[0].fault.packet_loss, 0.5, 0);
    T_NEAR(st[2].fault.delay_ms, 20, 0);
    T_OK(!st[0].fault.freeze && st[1].fault.freeze);
    T_OK(st[0].alive && !st[1].alive);
    T_EQ_I(simcams_control(&rig, "revive all", st, &d), PVX_OK);
    T_OK(st[1].alive);
    static const char *const bad[] = {"drop cam1",         "drop cam1 2",   "freeze cam1",
                                      "freeze cam1 maybe", "kill",          "kill cam9",
                                      "explode cam1",      "kill cam1 now", "drop cam1 0.1 0.2"};
    for (size_t k = 0; k < sizeof bad / sizeof bad[0]; k++) {
        d.text[0] = '\0';
        T_OK(simcams_control(&rig, bad[k], st, &d) != PVX_OK);
        T_OK(d.text[0] != '\0');
    }
}

static struct simcams_ring_params params(enum cap_pixfmt fmt, double noise)
{
    return (struct simcams_ring_params){
        .fmt = fmt, .n = 6, .fps = 12, .seed = 3, .noise = noise, .sub = 1};
}

/* Every pixel is the flame's at i/fps, rounded. */
static void ring_is_the_flame(void)
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

static void noise_is_as_asked_and_repeats(void)
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

static bool stop_at_half(void *ctx, double done)
{
    *(int *)ctx += 1;
    return done < 0.5;
}

static void rendering_can_be_stopped(void)
{
    struct simcams_ring ring;
    struct simcams_ring_params p = params(CAP_GREY8, 0);
    int calls = 0;
    T_EQ_I(simcams_ring_init(&rig, &p, stop_at_half, &calls, &ring), PVX_ECANCELED);
    T_EQ_I(calls, 3);
    T_OK(ring.image == NULL);
}

int main(void)
{
    if (rec_rig_ring(3, 2.5, 80, 60, 32, &rig) != PVX_OK)
        return 1;
    T_RUN(options_for_all_or_some);
    T_RUN(options_that_are_wrong);
    T_RUN(timetable_is_in_order);
    T_RUN(control_lines);
    T_RUN(ring_is_the_flame);
    T_RUN(noise_is_as_asked_and_repeats);
    T_RUN(rendering_can_be_stopped);
    rec_rig_fini(&rig);
    return t_done();
}
