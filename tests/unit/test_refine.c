/* test_refine.c - poses corrected by a flame: nearer to the truth, refused where held-out frames do not get better,
 * what cannot be seen held. */
#include "../t.h"

#include "recon/check/refine.h"
#include "tests/lib/flame_rig.h"

enum { W = 96, SETS = 6, CAMERAS = 6 };

static pvx_pool *pool;
static struct flame_rig f; /* seed 41: no constant was chosen on it */
static struct rec_refine_report report;
static struct pvx_diag diag;

static const struct rec_unseen_params params = {.voxels = 32, .binning = 1, .rays = 2, .margin = 1};

static pvx_err refine(struct rec_rig *rig, size_t sets, size_t wrong, enum spoil what)
{
    struct flame_source s = {.f = &f, .noise = t_normal};
    struct rec_check_source from = {.n = sets, .get = flame_source_get, .ctx = &s};
    s.what[wrong] = what;
    diag.text[0] = '\0';
    pvx_err e = rec_refine(rig, &params, pool, &from, &report, &diag);
    flame_source_free(&s);
    return e;
}

static double off(const struct rec_rig *rig)
{
    struct rec_rig r;
    T_EQ_I(rec_rig_copy(rig, &r), PVX_OK);
    double px = rec_gauge_hold(&f.rig, &r, NULL);
    rec_rig_fini(&r);
    return px;
}

T_CASE(a_bumped_tripod)
{
    struct rec_rig rig;
    const double mid[3] = {0, 0, 0.5}, turn[3] = {0, 0, 0.02}, aside[3] = {0.05, -0.03, 0.02};
    T_EQ_I(rec_rig_copy(&f.rig, &rig), PVX_OK);
    rec_camera_nudge(&rig.cameras[3], mid, turn, aside);
    double before = off(&rig), own[REC_MAX_CAMERAS];
    T_LE(0.6, before);
    T_EQ_I(refine(&rig, SETS, 0, SPOIL_NOTHING), PVX_OK);
    T_EQ_S(diag.text, "");
    T_OK(report.accepted);
    T_LE(off(&rig), 0.4 * before);
    T_LE(report.error[report.best], 0.8 * report.error[0]);
    for (size_t c = 0; c < CAMERAS; c++)
        T_LE(report.px[c], report.px[3]);
    /* the box stays where it was: the camera came back, the others did not go to it */
    (void)rec_gauge_distance(&f.rig, &rig, own);
    T_LE(own[3], 0.7 * before * sqrt(CAMERAS));
    rec_rig_fini(&rig);
}

/* Nothing to gain: the very numbers that came go out. */
T_CASE(a_right_rig_is_refused)
{
    struct rec_rig rig;
    T_EQ_I(rec_rig_copy(&f.rig, &rig), PVX_OK);
    T_EQ_I(refine(&rig, SETS, 0, SPOIL_NOTHING), PVX_OK);
    if (!report.accepted) {
        for (size_t c = 0; c < CAMERAS; c++)
            T_EQ_I(memcmp(&rig.cameras[c], &f.rig.cameras[c], sizeof rig.cameras[c]), 0);
    } else { /* or less than what pixels are apart */
        T_LE(report.error[report.best], 0.99 * report.error[0]);
    }
    T_LE(off(&rig), 0.2);
    rec_rig_fini(&rig);
}

T_CASE(what_is_no_pose_is_refused)
{
    struct rec_rig rig;
    T_EQ_I(rec_rig_copy(&f.rig, &rig), PVX_OK);
    T_EQ_I(refine(&rig, SETS, 2, SPOIL_CAP), PVX_EINVAL);
    T_OK(strstr(diag.text, "cam2 is wrong, but not its pose (dark)") != NULL);
    T_EQ_I(refine(&rig, 5, 0, SPOIL_NOTHING), PVX_EINVAL);
    T_OK(strstr(diag.text, "5 frame sets: a refinement needs 6") != NULL);
    rec_rig_fini(&rig);
}

T_CASE(cameras_in_a_line)
{
    T_NOT_UNDER_SANITIZERS();
    struct rec_rig rig;
    T_EQ_I(rec_rig_copy(&f.rig, &rig), PVX_OK);
    T_OK(!rec_rig_in_line(&rig));
    for (size_t c = 0; c < CAMERAS; c++) {
        const double eye[3] = {0.5 * (double)c - 1.2, -2, 0.5}, to[3] = {0, 0, 0.5};
        rec_camera_look(eye, to, &rig.cameras[c]);
    }
    T_OK(rec_rig_in_line(&rig));

    struct flame_rig line = {.w = f.w, .h = f.h, .n = SETS};
    T_EQ_I(rec_rig_copy(&rig, &line.rig), PVX_OK);
    flame_rig_shoot(&line, 42, 0.1, t_normal);
    struct flame_source s = {.f = &line, .noise = t_normal};
    struct rec_check_source from = {.n = SETS, .get = flame_source_get, .ctx = &s};
    const double mid[3] = {0, 0, 0.5}, none[3] = {0}, up[3] = {0, 0.05, 0};
    rec_camera_nudge(&rig.cameras[2], mid, none, up);
    T_EQ_I(rec_refine(&rig, &params, pool, &from, &report, &diag), PVX_OK);
    T_OK(report.in_line);
    for (size_t c = 0; c < CAMERAS; c++)
        T_EQ_I(report.held[c], REC_POSE_FROM | REC_POSE_DISTANCE | REC_POSE_FOCAL);
    flame_rig_free(&line);
    rec_rig_fini(&rig);
}

static void begin(void)
{
    CHECK(pvx_pool_new(2, "test", &pool));
    f = (struct flame_rig){.w = W, .h = W * 3 / 4, .n = SETS};
    CHECK(rec_rig_ring(CAMERAS, 2.2, W, W * 3 / 4, 32, &f.rig));
    flame_rig_shoot(&f, 41, 0.1, t_normal);
}
static void end(void)
{
    flame_rig_free(&f);
    pvx_pool_free(&pool);
}
T_MAIN(begin(), end())
