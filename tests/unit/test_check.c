/* test_check.c - recon/check: displacements to a few hundredths of a pixel, every fault by its name. */
#include "../t.h"

#include "recon/check/judge.h"
#include "tests/lib/flame_rig.h"

enum { W = 120, SETS = 4 };

static pvx_pool *pool;
static struct flame_rig seven; /* seed 21: no constant was chosen on it */

static struct rec_check_verdict verdict;
static struct pvx_diag diag;

static const struct rec_unseen_params params = {.voxels = 32, .binning = 1, .rays = 2, .margin = 1};

/* Cameras that are wrong: a list that ends with N_SPOILS as its camera. */
struct fault {
    size_t camera;
    enum spoil what;
};
static pvx_err judge(const struct flame_rig *f, const struct rec_rig *rig, size_t sets,
                     const struct fault *fault)
{
    struct flame_source s = {.f = f, .noise = t_normal};
    for (; fault->what != N_SPOILS; fault++)
        s.what[fault->camera] = fault->what;
    struct rec_check_source from = {.n = sets, .get = flame_source_get, .ctx = &s};
    rec_check *k;
    diag.text[0] = '\0';
    pvx_err e = rec_check_new(rig, &params, pool, &k, &diag);
    if (e == PVX_OK)
        e = rec_check_run(k, rig, &from, &verdict, &diag);
    rec_check_free(&k);
    flame_source_free(&s);
    return e;
}

static enum rec_wrong named(size_t camera, enum spoil what)
{
    const struct fault one[] = {{camera, what}, {0, N_SPOILS}};
    T_EQ_I(judge(&seven, &seven.rig, SETS, one), PVX_OK);
    for (size_t c = 0; c < seven.rig.n_cameras; c++)
        if (c != camera)
            T_EQ_S(rec_wrong_name(verdict.figures.camera[c].wrong), "");
    return verdict.figures.camera[camera].wrong;
}

T_CASE(a_right_rig_agrees)
{
    T_EQ_I(named(0, SPOIL_NOTHING), REC_WRONG_NOTHING);
    T_EQ_I(verdict.outcome, REC_CHECK_AGREES);
    for (size_t c = 0; c < seven.rig.n_cameras; c++) {
        const struct rec_check_camera *o = &verdict.figures.camera[c];
        T_LE(hypot(o->shift[0], o->shift[1]), 0.15);
        T_NEAR(o->gain, 1, 0.05);
        T_LE(0.95, o->rho);
        T_LE(0.98, o->explained);
        T_LE(0.95, o->lit);
    }
}

T_CASE(each_fault_by_its_name)
{
    T_NOT_UNDER_SANITIZERS();
    static const enum rec_wrong is[N_SPOILS] = {
        [SPOIL_CAP] = REC_WRONG_DARK,    [SPOIL_FLOOD] = REC_WRONG_FLOODED,
        [SPOIL_SHIFT] = REC_WRONG_MOVED, [SPOIL_TENTH] = REC_WRONG_MOVED,
        [SPOIL_LATE] = REC_WRONG_LATE,   [SPOIL_MIRROR] = REC_WRONG_MIRRORED,
        [SPOIL_FROZEN] = REC_WRONG_LATE, [SPOIL_BLUR] = REC_WRONG_BLURRED,
        [SPOIL_HALF] = REC_WRONG_GAIN};
    for (enum spoil s = SPOIL_SHIFT; s < N_SPOILS; s++) {
        size_t camera = (size_t)s % seven.rig.n_cameras;
        T_EQ_S(rec_wrong_name(named(camera, s)), rec_wrong_name(is[s]));
        T_EQ_I(verdict.outcome, REC_CHECK_NAMED);
        T_EQ_I(verdict.n_wrong, 1);
        const struct rec_check_camera *o = &verdict.figures.camera[camera];
        if (s == SPOIL_SHIFT || s == SPOIL_TENTH) {
            T_NEAR(o->shift[0], s == SPOIL_SHIFT ? 3 : W / 10, 0.15);
            T_NEAR(o->shift[1], s == SPOIL_SHIFT ? -2 : 0, 0.15);
        }
        if (s == SPOIL_HALF)
            T_NEAR(o->gain, 0.5, 0.03);
        if (s == SPOIL_MIRROR)
            T_EQ_I(o->mirrored, 1);
        if (s == SPOIL_FROZEN)
            T_LE(o->still, 1e-6);
    }
}

T_CASE(two_at_once)
{
    const struct fault two[] = {{1, SPOIL_CAP}, {4, SPOIL_SHIFT}, {0, N_SPOILS}};
    T_EQ_I(judge(&seven, &seven.rig, SETS, two), PVX_OK);
    T_EQ_I(verdict.outcome, REC_CHECK_NAMED);
    T_EQ_I(verdict.n_wrong, 2);
    T_EQ_I(verdict.figures.camera[1].wrong, REC_WRONG_DARK);
    T_EQ_I(verdict.figures.camera[4].wrong, REC_WRONG_MOVED);
    T_NEAR(verdict.figures.camera[4].shift[0], 3, 0.2);
}

/* Who is not believed from the start is judged all the same: named when it is wrong, back when it is not. */
T_CASE(doubted_from_the_start)
{
    T_NOT_UNDER_SANITIZERS();
    for (int wrong = 0; wrong < 2; wrong++) {
        const bool doubted[REC_MAX_CAMERAS] = {[4] = true};
        struct flame_source s = {.f = &seven, .noise = t_normal};
        s.what[4] = wrong ? SPOIL_MIRROR : SPOIL_NOTHING;
        const struct rec_check_source from = {
            .n = SETS, .get = flame_source_get, .ctx = &s, .doubted = doubted};
        rec_check *k;
        T_EQ_I(rec_check_new(&seven.rig, &params, pool, &k, &diag), PVX_OK);
        T_EQ_I(rec_check_run(k, &seven.rig, &from, &verdict, &diag), PVX_OK);
        T_EQ_I(verdict.outcome, wrong ? REC_CHECK_NAMED : REC_CHECK_AGREES);
        T_OK(!verdict.figures.use[4]);
        for (size_t c = 0; c < seven.rig.n_cameras; c++)
            T_EQ_I(verdict.figures.camera[c].wrong,
                   wrong && c == 4 ? REC_WRONG_MIRRORED : REC_WRONG_NOTHING);
        rec_check_free(&k);
        flame_source_free(&s);
    }
}

/* Of five, two that lie leave three: no more than could agree by chance. */
T_CASE(what_cannot_be_told_is_said)
{
    struct flame_rig five;
    const struct fault two[] = {{1, SPOIL_TENTH}, {3, SPOIL_MIRROR}, {0, N_SPOILS}};
    flame_rig_new(&five, 5, W, 3, 22, t_normal);
    T_EQ_I(judge(&five, &five.rig, five.n, two), PVX_OK);
    T_EQ_I(verdict.outcome, REC_CHECK_UNTOLD);
    T_LE(2, (double)verdict.n_wrong);
    flame_rig_free(&five);
}

/* A camera turned about its axis, or further away, shows no displacement of the middle.  The fit is of first order:
 * so much is seen a quarter too small. */
T_CASE(a_turn_and_a_size)
{
    T_NOT_UNDER_SANITIZERS();
    struct rec_rig rig;
    const struct fault none[] = {{0, N_SPOILS}};
    const double mid[3] = {0, 0, 0.5}, still[3] = {0}, roll[3] = {0, 0, 0.1};
    T_EQ_I(rec_rig_copy(&seven.rig, &rig), PVX_OK);
    rec_camera_nudge(&rig.cameras[2], mid, roll, still); /* the rig's word, not the picture */
    T_EQ_I(judge(&seven, &rig, SETS, none), PVX_OK);
    T_EQ_I(verdict.figures.camera[2].wrong, REC_WRONG_MOVED);
    T_NEAR(verdict.figures.camera[2].roll, -0.09, 0.02);
    rec_rig_fini(&rig);
    T_EQ_I(rec_rig_copy(&seven.rig, &rig), PVX_OK);
    const double back[3] = {0, 0, 0.3};
    rec_camera_nudge(&rig.cameras[5], mid, still, back);
    T_EQ_I(judge(&seven, &rig, SETS, none), PVX_OK);
    T_EQ_I(verdict.figures.camera[5].wrong, REC_WRONG_MOVED);
    T_NEAR(verdict.figures.camera[5].size, 0.1, 0.025);
    rec_rig_fini(&rig);
}

static pvx_err refused(const struct flame_rig *f, size_t sets, const char *says)
{
    const struct fault none[] = {{0, N_SPOILS}};
    pvx_err e = judge(f, &f->rig, sets, none);
    T_OK(strstr(diag.text, says) != NULL);
    return e;
}

T_CASE(what_tells_nothing_is_refused)
{
    struct flame_rig few;
    flame_rig_new(&few, 3, W, 3, 23, t_normal);
    T_EQ_I(refused(&few, 3, "fewer than 4"), PVX_EINVAL);
    flame_rig_free(&few);
    T_EQ_I(refused(&seven, 2, "2 frame sets"), PVX_EINVAL);

    struct fault all[REC_MAX_CAMERAS + 1];
    size_t n = seven.rig.n_cameras;
    for (size_t c = 0; c <= n; c++)
        all[c] = (struct fault){c, c < n ? SPOIL_FROZEN : N_SPOILS};
    T_EQ_I(judge(&seven, &seven.rig, 3, all), PVX_EINVAL);
    T_OK(strstr(diag.text, "never moves") != NULL);
    for (size_t c = 2; c < n; c++)
        all[c].what = SPOIL_CAP;
    T_EQ_I(judge(&seven, &seven.rig, 3, all), PVX_EINVAL);
    T_OK(strstr(diag.text, "2 of 7 cameras see any flame") != NULL);
}

T_CASE(same_bits_for_any_number_of_threads)
{
    T_NOT_UNDER_SANITIZERS();
    struct rec_check_camera at[2];
    for (int i = 0; i < 2; i++) {
        pvx_pool *all = pool;
        if (i == 1)
            T_EQ_I(pvx_pool_new(3, "other", &pool), PVX_OK);
        T_EQ_I(named(3, SPOIL_SHIFT), REC_WRONG_MOVED);
        at[i] = verdict.figures.camera[3];
        if (i == 1) {
            pvx_pool_free(&pool);
            pool = all;
        }
    }
    T_EQ_I(memcmp(at[0].shift, at[1].shift, sizeof at[0].shift), 0);
    T_OK(at[0].rho == at[1].rho && at[0].blur == at[1].blur && at[0].with_it == at[1].with_it);
}

/* A rig moved as a whole is the same rig; one camera moved is not. */
T_CASE(gauge)
{
    struct rec_rig rig;
    double own[REC_MAX_CAMERAS];
    const double mid[3] = {0, 0, 0.5}, none[3] = {0}, aside[3] = {0.02, -0.01, 0.03};
    T_EQ_I(rec_rig_copy(&seven.rig, &rig), PVX_OK);
    for (size_t c = 0; c < rig.n_cameras; c++) /* the world 1.1 times as large, and shifted */
        for (int a = 0; a < 3; a++) {
            const double *R = rig.cameras[c].R + 3 * a;
            rig.cameras[c].t[a] = 1.1 * rig.cameras[c].t[a] + 0.05 * R[0] - 0.02 * R[2];
        }
    T_LE(3, rec_gauge_distance(&seven.rig, &rig, NULL));
    T_LE(rec_gauge_hold(&seven.rig, &rig, NULL), 1e-6);
    rec_camera_nudge(&rig.cameras[2], mid, none, aside);
    double before = rec_gauge_distance(&seven.rig, &rig, own);
    T_LE(0.9, own[2]);
    T_LE(own[3], 1e-6);
    T_LE(rec_gauge_hold(&seven.rig, &rig, own), before);
    T_LE(own[3], own[2]);
    rec_rig_fini(&rig);
}

/* A blob moved by part of a bin, in noise of 5 % of its peak: what is found is right on the mean of many, wherever the
 * search began. */
T_CASE(noise_draws_nothing)
{
    enum { N = 64, MANY = 60 };
    static float raw[N * N], b[N * N], p[N * N], weight[N * N], tmp[N * N];
    static struct rec_lattice sum;
    static const double moved[][2] = {{0, 0}, {0.9, -0.4}, {-3.3, 2.2}};
    for (size_t m = 0; m < sizeof moved / sizeof *moved; m++)
        for (int32_t start = 0; start < 2; start++) {
            const int32_t s[2] = {(int32_t)lround(moved[m][0]) + start,
                                  (int32_t)lround(moved[m][1])};
            double d[2], mean[2];
            memset(&sum, 0, sizeof sum);
            for (int k = 0; k < MANY; k++) {
                for (int i = 0; i < N * N; i++) {
                    double x = i % N - 31.3, y = i / N - 30.6;
                    double u = x - moved[m][0], v = y - moved[m][1];
                    p[i] = (float)(0.8 * exp(-0.5 * (x * x / 16 + y * y / 25)));
                    raw[i] =
                        (float)(0.6 * exp(-0.5 * (u * u / 16 + v * v / 25)) + 0.03 * t_normal());
                    weight[i] = 1;
                }
                rec_smooth(raw, N, N, 2, b, tmp);
                memcpy(raw, p, sizeof raw);
                rec_smooth(raw, N, N, 2, p, tmp);
                const struct rec_pair q = {N, N, b, weight, p};
                T_NEAR(rec_shift_add(&q, s, &sum, d), 0.75, 0.05);
            }
            T_OK(rec_shift_mean(&sum, mean));
            T_NEAR(mean[0], moved[m][0], 0.02);
            T_NEAR(mean[1], moved[m][1], 0.02);
        }
}

/* J of rec_camera_nudged is what rec_camera_nudge does. */
T_CASE(derivatives)
{
    const double X0[3] = {0.05, -0.1, 0.4}, X[3] = {-0.2, 0.1, 0.7};
    const struct rec_camera *c = &seven.rig.cameras[1];
    double J[14], u0[2], u1[2];
    T_OK(rec_camera_nudged(c, X0, X, u0, J));
    for (int p = 0; p < 7; p++) {
        struct rec_camera k = *c;
        double step = 1e-6, v[7] = {0};
        v[p] = step;
        rec_camera_nudge(&k, X0, v, v + 3);
        k.fx *= exp(v[6]);
        k.fy *= exp(v[6]);
        T_OK(rec_camera_project(&k, X, u1));
        T_NEAR((u1[0] - u0[0]) / step, J[p], 1e-3 * (1 + fabs(J[p])));
        T_NEAR((u1[1] - u0[1]) / step, J[7 + p], 1e-3 * (1 + fabs(J[7 + p])));
    }
}

static void begin(void)
{
    CHECK(pvx_pool_new(2, "test", &pool));
    flame_rig_new(&seven, 7, W, SETS, 21, t_normal);
}
static void end(void)
{
    flame_rig_free(&seven);
    pvx_pool_free(&pool);
}
T_MAIN(begin(), end())
