/* Bad input to a calibration, from views alone: what is wrong is named, with the camera and the remedy. */
#include "recon/calib/calib.h"

#include "tests/lib/board_views.h"
#include "tests/lib/plugins.h"

static struct bv s;

/* Only the views that `keep` keeps. */
static void filter(bool (*keep)(const struct rec_board_view *v))
{
    size_t n = 0;
    for (size_t i = 0; i < s.n; i++)
        if (keep(&s.view[i]))
            s.view[n++] = s.view[i];
    s.n = s.in.n_views = n;
}

/* A board that is carried slowly through the volume and turned before the cameras. */
static void carried(void)
{
    for (size_t f = 0; f < s.frames; f++) {
        double t = 0.02 * (double)f;
        const double at[3] = {0.25 * cos(9 * t), 0.25 * sin(7 * t), 0.5 + 0.2 * sin(5 * t)};
        const double look[3] = {cos(11 * t), sin(11 * t), 0.6 * sin(13 * t)};
        s.pose[f] = bv_pose_at(&s, at, look, 3 * sin(4 * t));
    }
}

/* ---- bad input ------------------------------------------------------------------------------------ */

static bool two_groups(const struct rec_board_view *v)
{
    return (v->camera < 2) == (v->frame < 112);
}

T_CASE(groups_that_nothing_joins)
{
    struct bv_result r;
    bv_init(&s, 4, true);
    s.frames = 24;
    bv_everywhere(&s);
    bv_take(&s);
    filter(two_groups);
    bv_solve(&s, &r);
    T_EQ_I(r.e, PVX_EINVAL);
    T_CONTAINS(r.d.text, "nothing joins {");
    T_CONTAINS(r.d.text, "cam0 cam1}");
    T_CONTAINS(r.d.text, "{cam2 cam3}");
    T_CONTAINS(r.d.text, "5 poses");
    T_OK(bv_said(&r, REC_CALIB_APART) != NULL);
    T_OK(r.rig.cameras == NULL);
    T_EQ_I(r.report.n_pairs, 6);
    bv_done(&r);
}

static bool not_of_three(const struct rec_board_view *v)
{
    return v->camera != 3;
}

T_CASE(a_camera_that_sees_nothing)
{
    struct bv_result r;
    bv_init(&s, 4, true);
    s.frames = 12;
    bv_everywhere(&s);
    bv_take(&s);
    filter(not_of_three);
    bv_solve(&s, &r);
    T_EQ_I(r.e, PVX_EINVAL);
    T_CONTAINS(r.d.text, "cam3 never saw the board");
    bv_done(&r);
}

T_CASE(still_pictures_count_once)
{
    struct bv_result r;
    size_t still = 0;
    bv_init(&s, 3, true);
    s.frames = 30;
    bv_everywhere(&s);
    for (size_t f = 20; f < 30; f++)
        s.pose[f] = s.pose[f - 15];
    bv_take(&s);
    bv_solved(&s, &r);
    for (size_t i = 0; i < s.n; i++) {
        still += r.report.view[i].fate == REC_VIEW_STILL;
        T_EQ_I(r.report.view[i].fate == REC_VIEW_STILL, s.view[i].frame >= 120);
        if (s.view[i].frame >= 120)
            T_EQ_I(r.report.view[i].like, s.view[i].frame - 15);
    }
    T_OK(still > 10);
    const struct rec_calib_finding *f = bv_said(&r, REC_CALIB_PICTURES);
    T_CONTAINS(f != NULL ? f->text : "", "in which nothing moved");
    bv_done(&r);
}

T_CASE(a_camera_that_was_moved)
{
    struct bv_result r;
    bv_init(&s, 4, true);
    s.frames = 40;
    s.cam[1].moved_from = 124;
    s.cam[1].moved = 0.006;
    bv_everywhere(&s);
    bv_take(&s);
    bv_solved(&s, &r);
    const struct rec_calib_finding *f = bv_said(&r, REC_CALIB_MOVED);
    T_OK(f != NULL && f->severity == REC_CALIB_REFUSED && f->camera == 1);
    if (f != NULL)
        T_OK(f->frame >= 122 && f->frame <= 126);
    T_CONTAINS(f != NULL ? f->text : "", "(--to 12");
    T_CONTAINS(f != NULL ? f->text : "", "(--from 12");
    T_CONTAINS(f != NULL ? f->text : "", "--recover cam1 --from 12");
    bv_done(&r);
}

T_CASE(cameras_out_of_step)
{
    T_NOT_UNDER_SANITIZERS();
    struct bv_result r;
    bv_init(&s, 4, true);
    s.frames = 50;
    s.cam[2].delay = 1;
    carried();
    bv_take(&s);
    bv_solved(&s, &r);
    const struct rec_calib_finding *f = bv_said(&r, REC_CALIB_SYNC);
    T_OK(f != NULL && f->camera == 2);
    T_CONTAINS(f != NULL ? f->text : "", "cam2 is one frame late");
    T_OK(f != NULL && f->severity == REC_CALIB_REFUSED);
    for (size_t c = 0; c < 4; c++) /* no lens bends to hide it */
        T_NEAR(r.rig.cameras[c].fx / s.cam[c].f[0], 1, 0.01);
    bv_done(&r);
    s.cam[2].delay = -1;
    bv_take(&s);
    bv_solved(&s, &r);
    f = bv_said(&r, REC_CALIB_SYNC);
    T_OK(f != NULL && f->camera == 2);
    T_CONTAINS(f != NULL ? f->text : "", "cam2 is one frame early");
    bv_done(&r);
    s.cam[2].delay = 0;
    bv_take(&s);
    bv_solved(&s, &r);
    T_OK(bv_said(&r, REC_CALIB_SYNC) == NULL);
    bv_done(&r);
}

/* The board is held still in a new pose for every picture, and one camera's numbers are one too high. */
T_CASE(numbers_that_are_one_too_high)
{
    struct bv_result r;
    bool late = false;
    bv_init(&s, 4, true);
    s.frames = 60;
    s.cam[2].delay = 1;
    bv_everywhere(&s);
    bv_take(&s);
    bv_solve(&s, &r);
    T_OK(r.e != PVX_OK || rec_calib_says(&r.report, REC_CALIB_REFUSED, -1));
    for (size_t i = 0; i < r.report.n_findings; i++)
        late |= strstr(r.report.finding[i].text, "cam2 is one frame late") != NULL;
    T_OK(late);
    bv_done(&r);
}

T_CASE(a_focal_length_that_nobody_knows)
{
    struct bv_result r;
    bv_init(&s, 1, false);
    s.frames = 12;
    for (size_t f = 0; f < s.frames; f++) { /* straight before the camera, always as far */
        double look[3], at[3];
        for (int j = 0; j < 3; j++) {
            look[j] = -s.cam[0].forward[j];
            at[j] = s.cam[0].at[j] + 1.5 * s.cam[0].forward[j] +
                    0.1 * sin((double)f) * s.cam[0].right[j];
        }
        s.pose[f] = bv_pose_at(&s, at, look, 0.5 * (double)f);
    }
    bv_take(&s);
    s.in.options.world = REC_WORLD_BEST;
    bv_solved(&s, &r);
    T_OK((r.report.camera[0].held & 3) == 3);
    const struct rec_calib_finding *f = bv_said(&r, REC_CALIB_HELD);
    T_OK(f != NULL && f->severity == REC_CALIB_WARNING);
    T_CONTAINS(f != NULL ? f->text : "", "tilt the board");
    f = bv_said(&r, REC_CALIB_WORLD);
    T_CONTAINS(f != NULL ? f->text : "", "nobody said where the world is");
    bv_done(&r);
}

T_CASE(a_lens_of_another_model)
{
    struct bv_result r;
    bv_init(&s, 3, true);
    s.frames = 25;
    s.cam[1].glass = 0.8;
    bv_everywhere(&s);
    bv_take(&s);
    bv_solved(&s, &r);
    const struct rec_calib_finding *f = bv_said(&r, REC_CALIB_LENS);
    T_OK(f != NULL && f->camera == 1 && f->severity == REC_CALIB_REFUSED);
    T_LE(r.report.camera[0].structure, 0.1);
    bv_done(&r);
}

T_CASE(broken_views_are_left_out)
{
    struct bv_result r;
    bv_init(&s, 3, true);
    s.frames = 20;
    bv_everywhere(&s);
    bv_take(&s);
    s.view[0].corner[3].x = NAN;
    s.view[1].corner[2].id = s.view[1].corner[1].id;
    s.view[2].corner[s.view[2].n - 1].id = BV_CORNERS;
    s.view[3].n = 5;
    for (size_t i = 0; i < s.view[4].n; i++) /* noise */
        s.view[4].corner[i].x = t_uniform(0, 640);
    s.view[5].n = 7; /* one line of the print, if the first row is whole */
    for (uint32_t i = 0; i < 7; i++)
        s.view[5].corner[i] = (struct rec_board_corner){i, 100 + 20.0 * i, 200, {0.01, 0, 0.01}};
    s.view[s.n] = s.view[7];
    s.in.n_views = ++s.n;
    bv_solved(&s, &r);
    const struct rec_calib_view *v = r.report.view;
    T_EQ_I(v[0].fate, REC_VIEW_BROKEN);
    T_EQ_I(v[1].fate, REC_VIEW_BROKEN);
    T_EQ_I(v[2].fate, REC_VIEW_BROKEN);
    T_EQ_I(v[3].fate, REC_VIEW_FEW);
    T_OK(v[4].fate == REC_VIEW_SELF || v[4].fate == REC_VIEW_FEW);
    T_OK(v[5].fate == REC_VIEW_SELF || v[5].fate == REC_VIEW_FEW);
    T_EQ_I(v[7].fate, REC_VIEW_USED);
    T_EQ_I(v[s.n - 1].fate, REC_VIEW_TWICE);
    T_LE(r.rms, 0.2);
    bv_done(&r);
}

/* Pictures of every second instant are turned by 180 degrees, of one camera or of all in turn, or two cameras swap
 * theirs.  A rig that is called good is right in the cameras that nothing was done to. */
T_CASE(turned_and_swapped_pictures)
{
    enum { TURN_ONE, TURN_ALL, SWAP, N };
    int told = 0;
    for (size_t i = 0; i < 3 * N; i++) {
        struct bv_result r;
        const size_t what = i % N;
        bv_init(&s, 4, true);
        s.frames = 10 + 4 * (i / N);
        bv_everywhere(&s);
        bv_take(&s);
        for (size_t k = 0; k < s.n; k++) {
            struct rec_board_view *v = &s.view[k];
            bool turn = what == TURN_ONE   ? v->camera == 1 && v->frame % 2 == 1
                        : what == TURN_ALL ? (v->frame >> v->camera) % 2 == 1
                                           : false;
            if (what == SWAP && v->frame % 2 == 1 && v->camera % 2 == 1)
                v->camera ^= 2; /* 1 and 3 */
            for (size_t j = 0; j < v->n && turn; j++) {
                v->corner[j].x = s.w - 1 - v->corner[j].x;
                v->corner[j].y = s.h - 1 - v->corner[j].y;
            }
        }
        bv_solve(&s, &r);
        const struct rec_calib_finding *f = bv_said(&r, REC_CALIB_SYNC);
        bool refused = r.e != PVX_OK || rec_calib_says(&r.report, REC_CALIB_REFUSED, -1);
        T_OK(refused || !rec_calib_good(&r.report) || fmax(r.px[0], r.px[2]) < 1);
        told += refused && f != NULL && strstr(f->text, "turned, mirrored or of") != NULL;
        bv_done(&r);
    }
    T_OK(told > 0);
}

/* Sharp pictures.  One camera took a third when the board was not yet still.  They are left out.  They are hundreds
 * of times its own error off, which of less sharp pictures would be turned or swapped ones. */
T_CASE(a_board_that_moved_before_a_sharp_camera)
{
    struct bv_result r;
    size_t taken = 0;
    bv_init(&s, 6, true);
    s.frames = 60;
    s.noise = 0.003;
    bv_everywhere(&s);
    bv_take(&s);
    for (size_t k = 0; k < s.n; k++) {
        bool moved = s.view[k].camera == 1 && taken++ % 3 == 0;
        for (size_t j = 0; j < s.view[k].n && moved; j++)
            s.view[k].corner[j].x += 3;
    }
    bv_solve(&s, &r);
    T_EQ_I(r.e, PVX_OK);
    T_OK(r.report.camera[1].gross > 300);
    T_OK(!rec_calib_says(&r.report, REC_CALIB_REFUSED, -1));
    T_LE(fmax(r.px[0], fmax(r.px[1], r.px[2])), 0.2);
    bv_done(&r);
}

T_MAIN(plugins_of_this_build(), (void)0)
