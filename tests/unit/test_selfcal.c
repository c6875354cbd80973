/* Gain and aim of the cameras, corrected in the solve: found where they are wrong, no bit changed where not. */
#include <math.h>

#include "recon/frame/impl.h"
#include "recon/solve/impl.h"
#include "tests/lib/scene.h"

static rec_frame *slot(const struct scene *s, enum rec_selfcal_mode mode)
{
    struct rec_frame_params p = rec_frame_defaults;
    rec_frame *f;
    p.selfcal = mode;
    p.photo.saturation = REC_PHOTO_UNSATURATED;
    p.trust_all = true;
    if (rec_frame_alone(s->S, &s->rig, &p, s->pool, &f, NULL) != PVX_OK)
        exit(2);
    return f;
}

/* Pictures with these gains and aims: g[c] times what the camera sees at u + d[c]. */
static void shoot(const struct scene *s, rec_frame *f, const double *g, double (*d)[2])
{
    t_state = 0;
    scene_shoot(s, f, 0);
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        struct rec_camera k = s->rig.cameras[c];
        size_t n = (size_t)k.width * (size_t)k.height;
        float *raw = pvx_calloc(n * 3, sizeof *raw), *in = rec_frame_input(f, c);
        k.cx += d != NULL ? d[c][0] : 0;
        k.cy += d != NULL ? d[c][1] : 0;
        rec_flame_render(&s->pose, &k, 4, 0, k.height, raw);
        for (size_t i = 0; i < n; i++)
            for (size_t l = 0; l < 3; l++)
                in[i * 4 + l] =
                    (float)((g != NULL ? g[c] : 1) * (double)raw[i * 3 + l] + 0.002 * t_normal());
        free(raw);
    }
}

static double solve(const struct scene *s, rec_frame *f)
{
    struct rec_sparse v;
    rec_frame_carve(f);
    T_OK(rec_frame_solve(f, 0, NULL) == PVX_OK);
    rec_frame_volume(f, &v);
    return scene_error(s, &v);
}

static bool same_volume(const rec_frame *a, const rec_frame *b)
{
    return a->sub->n == b->sub->n &&
           memcmp(a->x, b->x, (size_t)a->sub->n * (size_t)a->cs * sizeof *a->x) == 0;
}

static const struct rec_selfcal_report *found(const rec_frame *f)
{
    return &rec_frame_get_report(f)->selfcal;
}

#define CAMERAS 6
static const double gains[CAMERAS] = {1.1, 0.93, 1, 1.05, 0.9, 1.02};

/* Shifts that no motion of the flame explains: what is left of `raw` is what rec_selfcal_report can show. */
static double aims[CAMERAS][2] = {{0.4, 0.3},   {-0.4, 0.3}, {0.4, -0.3},
                                  {-0.4, -0.3}, {0.4, 0.3},  {-0.4, -0.3}};

T_CASE(an_exact_rig_keeps_every_bit)
{
    struct scene s;
    scene_new(&s, CAMERAS, 96, 32, 2, 2);
    rec_frame *off = slot(&s, REC_SELFCAL_OFF), *on = slot(&s, REC_SELFCAL_ON);
    for (int k = 0; k < 4; k++) {
        scene_at(&s, 0.2 + 0.3 * k);
        shoot(&s, off, NULL, NULL);
        shoot(&s, on, NULL, NULL);
        solve(&s, off);
        solve(&s, on);
        T_OK(same_volume(off, on));
        T_OK(!found(on)->gain && !found(on)->shift);
        T_OK(found(on)->cameras == CAMERAS && found(on)->camera[0].known);
        T_OK(found(off)->cameras == 0);
        printf("  gains %.1f sigma, shifts %.1f\n", found(on)->test[0], found(on)->test[1]);
    }
    rec_frame_free(&off);
    rec_frame_free(&on);
    scene_free(&s);
}

T_CASE(gains_are_found)
{
    struct scene s;
    double error[3], mean = 0;
    scene_new(&s, CAMERAS, 96, 32, 2, 2);
    for (int k = 0; k < 3; k++) { /* exact, wrong, corrected */
        rec_frame *f = slot(&s, k == 2 ? REC_SELFCAL_ON : REC_SELFCAL_OFF);
        shoot(&s, f, k > 0 ? gains : NULL, NULL);
        error[k] = solve(&s, f);
        for (int c = 0; c < CAMERAS && k == 2; c++)
            mean += gains[c] / CAMERAS;
        T_OK(k < 2 || found(f)->gain);
        for (int c = 0; c < CAMERAS && k == 2; c++)
            T_NEAR((double)found(f)->camera[c].gain * gains[c], mean, 0.015);
        rec_frame_free(&f);
    }
    printf("  error exact %.4f, wrong %.4f, corrected %.4f\n", error[0], error[1], error[2]);
    T_OK(error[1] > 1.1 * error[0] && error[2] < 0.5 * (error[0] + error[1]));
    scene_free(&s);
}

T_CASE(aims_are_found_but_for_what_no_picture_shows)
{
    struct scene s;
    double error[3];
    scene_new(&s, CAMERAS, 96, 32, 2, 2);
    for (int k = 0; k < 3; k++) {
        rec_frame *f = slot(&s, k == 2 ? REC_SELFCAL_ON : REC_SELFCAL_OFF);
        shoot(&s, f, NULL, k > 0 ? aims : NULL);
        error[k] = solve(&s, f);
        T_OK(k < 2 || found(f)->shift);
        /* A motion of the flame up moves all pictures alike: the differences of neighbours remain. */
        for (int c = 0; c < CAMERAS && k == 2; c++) {
            double want = aims[c][1] - aims[(c + 3) % CAMERAS][1];
            double got = (double)found(f)->camera[c].shift[1] -
                         (double)found(f)->camera[(c + 3) % CAMERAS].shift[1];
            T_NEAR(got, want, 0.15);
        }
        rec_frame_free(&f);
    }
    printf("  error exact %.4f, wrong %.4f, corrected %.4f\n", error[0], error[1], error[2]);
    T_OK(error[1] > 1.1 * error[0] && error[2] < 0.5 * (error[0] + error[1]));
    scene_free(&s);
}

T_CASE(gain_alone_moves_nothing)
{
    struct scene s;
    scene_new(&s, CAMERAS, 96, 32, 2, 2);
    rec_frame *f = slot(&s, REC_SELFCAL_GAIN);
    shoot(&s, f, gains, aims);
    solve(&s, f);
    T_OK(found(f)->gain && !found(f)->shift && found(f)->test[1] == 0);
    for (int c = 0; c < CAMERAS; c++)
        T_OK(found(f)->camera[c].shift[0] == 0 && found(f)->camera[c].shift_error[0] == 0);
    rec_frame_free(&f);
    scene_free(&s);
}

T_CASE_OF_THREADS(bits_do_not_depend_on_threads_or_on_the_set_before)
{
    struct scene s[2];
    rec_frame *f[2];
    for (unsigned k = 0; k < 2; k++) {
        scene_new(&s[k], CAMERAS, 96, 32, 1, 1 + 3 * k);
        f[k] = slot(&s[k], REC_SELFCAL_ON);
        if (k == 1) { /* another set before */
            shoot(&s[k], f[k], NULL, aims);
            solve(&s[k], f[k]);
        }
        shoot(&s[k], f[k], gains, aims);
        solve(&s[k], f[k]);
        T_OK(found(f[k])->gain);
    }
    T_OK(same_volume(f[0], f[1]));
    T_OK(memcmp(found(f[0]), found(f[1]), sizeof *found(f[0])) == 0);
    for (int k = 0; k < 2; k++) {
        rec_frame_free(&f[k]);
        scene_free(&s[k]);
    }
}

/* Three cameras, and mosaics, tell too little: nothing is estimated. */
T_CASE(nothing_where_too_little_is_known)
{
    struct scene s;
    scene_new(&s, CAMERAS, 96, 32, 1, 2);
    for (int k = 0; k < 2; k++) {
        rec_frame *f[2];
        for (int on = 0; on < 2; on++) {
            f[on] = slot(&s, on ? REC_SELFCAL_ON : REC_SELFCAL_OFF);
            shoot(&s, f[on], gains, NULL);
            if (k == 0)
                for (size_t c = 3; c < CAMERAS; c++)
                    rec_frame_camera(f[on], c)->present = false;
            else
                scene_filter(&s, f[on]);
            solve(&s, f[on]);
        }
        T_OK(same_volume(f[0], f[1]) && found(f[1])->cameras == 0);
        rec_frame_free(&f[0]);
        rec_frame_free(&f[1]);
    }
    scene_free(&s);
}

/* A camera that is missing is not estimated, and the others are as they would be without it. */
T_CASE(a_missing_camera_has_no_part)
{
    struct scene s;
    scene_new(&s, CAMERAS, 96, 32, 2, 2);
    rec_frame *f = slot(&s, REC_SELFCAL_ON);
    shoot(&s, f, gains, NULL);
    rec_frame_camera(f, 4)->present = false;
    solve(&s, f);
    T_OK(found(f)->gain && !found(f)->camera[4].known && found(f)->camera[3].known);
    double mean = 0;
    for (int c = 0; c < CAMERAS; c++)
        mean += c == 4 ? 0 : gains[c] / (CAMERAS - 1);
    for (int c = 0; c < CAMERAS; c++)
        if (c != 4)
            T_NEAR((double)found(f)->camera[c].gain * gains[c], mean, 0.02);
    rec_frame_free(&f);
    scene_free(&s);
}

/* The bound of a saturated pixel is as much brighter as its camera's picture. */
T_CASE(bounds_follow_the_gain)
{
    struct scene s;
    double error[2];
    scene_new(&s, CAMERAS, 96, 32, 2, 2);
    for (int on = 0; on < 2; on++) {
        struct rec_frame_params p = rec_frame_defaults;
        rec_frame *f;
        p.at_least = true;
        p.trust_all = true;
        p.photo.saturation = 0.5F;
        p.selfcal = on ? REC_SELFCAL_ON : REC_SELFCAL_OFF;
        if (rec_frame_alone(s.S, &s.rig, &p, s.pool, &f, NULL) != PVX_OK)
            exit(2);
        shoot(&s, f, gains, NULL);
        for (size_t c = 0; c < CAMERAS; c++) {
            float *in = rec_frame_input(f, c);
            for (size_t i = 0; i < (s.S->row0[c + 1] - s.S->row0[c]) * 4; i++)
                in[i] = fminf(in[i], 0.5F);
        }
        error[on] = solve(&s, f);
        T_OK(f->any_least && found(f)->gain == (on == 1));
        const rec_problem *pb = f->solver->problem;
        for (size_t i = 0; i < s.S->row0[1] && on == 1; i++)
            if (f->sub->is_row[i] && f->least[i] > 0 && (f->least_of[i] & 1) != 0)
                T_NEAR((double)pb->given[i * 4],
                       (double)found(f)->camera[0].gain * (double)f->b[i * 4], 1e-5);
        rec_frame_free(&f);
    }
    printf("  error %.4f, corrected %.4f\n", error[0], error[1]);
    T_OK(error[1] < error[0]);
    scene_free(&s);
}

/* The vote is about pictures as they come: a camera of gain 0.8 is believed and corrected, a black one is left out. */
T_CASE(a_dim_camera_is_corrected_and_a_black_one_voted_out)
{
    static const double dim[CAMERAS] = {1, 0.8, 1, 1, 1, 1}, black[CAMERAS] = {1, 0.8, 0, 1, 1, 1};
    struct scene s;
    scene_new(&s, CAMERAS, 96, 32, 2, 2);
    for (int k = 0; k < 2; k++) {
        struct rec_frame_params p = rec_frame_defaults;
        rec_frame *f;
        p.photo.saturation = REC_PHOTO_UNSATURATED;
        if (rec_frame_alone(s.S, &s.rig, &p, s.pool, &f, NULL) != PVX_OK)
            exit(2);
        shoot(&s, f, k == 0 ? dim : black, NULL);
        solve(&s, f);
        T_EQ_I(rec_frame_get_report(f)->vote.out, k == 0 ? 0 : 4);
        T_OK(found(f)->gain && found(f)->camera[2].known == (k == 0));
        double others = (double)found(f)->camera[0].gain;
        T_NEAR((double)found(f)->camera[1].gain / others, 1 / 0.8, 0.03);
        rec_frame_free(&f);
    }
    scene_free(&s);
}

/* ---- sets that are averaged (average.h) ---------------------------------------------------------- */

#define SETS 6

static rec_average *average(uint32_t block, uint32_t blocks)
{
    rec_average *a;
    if (rec_average_new(CAMERAS, 1, block, blocks, &a) != PVX_OK)
        exit(2);
    return a;
}

/* Set k of a flame that burns, seen by a rig that is off. */
static void burn(struct scene *s, rec_frame *f, int k, const double *g, double (*d)[2])
{
    scene_at(s, 0.2 + 0.17 * k);
    shoot(s, f, g, d);
}

/* Two rounds over the sets; then what was learnt is fixed. */
static void learn(struct scene *s, rec_frame *f, rec_average *a, const double *g, double (*d)[2])
{
    rec_solver_average(f->solver, a);
    for (int round = 0; round < 2; round++) {
        rec_average_learn(a);
        for (int k = 0; k < SETS; k++) {
            burn(s, f, k, g, d);
            solve(s, f);
        }
    }
    rec_average_fix(a);
}

T_CASE(sets_learn_together_and_are_corrected_alike)
{
    struct scene s[2];
    rec_frame *f[2], *alone, *off;
    rec_average *a[2];
    double error[3] = {0};
    for (unsigned k = 0; k < 2; k++) {
        scene_new(&s[k], CAMERAS, 96, 32, 2, 1 + 3 * k);
        f[k] = slot(&s[k], REC_SELFCAL_ON);
        a[k] = average(1, SETS + 1);
        learn(&s[k], f[k], a[k], gains, aims);
    }
    alone = slot(&s[0], REC_SELFCAL_ON);
    off = slot(&s[0], REC_SELFCAL_OFF);
    for (int k = SETS; k-- > 0;) { /* in another order */
        rec_frame *all[] = {off, alone, f[0]};
        for (int i = 0; i < 3; i++) {
            burn(&s[0], all[i], k, gains, aims);
            error[i] += solve(&s[0], all[i]) / SETS;
        }
        burn(&s[1], f[1], k, gains, aims);
        solve(&s[1], f[1]);
        T_OK(same_volume(f[0], f[1]));
        T_OK(found(f[0])->gain && found(f[0])->shift && found(f[0])->sets == SETS);
        T_OK(memcmp(found(f[0]), found(f[1]), sizeof *found(f[0])) == 0);
    }
    for (int c = 0; c < CAMERAS; c++)
        T_OK(found(f[0])->camera[c].gain_error < 0.01F &&
             found(f[0])->camera[c].shift_error[0] < 0.05F);
    printf("  error as given %.4f, each set by itself %.4f, together %.4f\n", error[0], error[1],
           error[2]);
    T_OK(error[2] < 0.75 * error[0] && error[2] < 1.01 * error[1]);
    for (int k = 0; k < 2; k++) {
        rec_frame_free(&f[k]);
        rec_average_free(&a[k]);
    }
    rec_frame_free(&alone);
    rec_frame_free(&off);
    for (int k = 0; k < 2; k++)
        scene_free(&s[k]);
}

T_CASE(an_exact_rig_keeps_every_bit_in_the_mean_too)
{
    struct scene s;
    scene_new(&s, CAMERAS, 96, 32, 2, 2);
    rec_frame *off = slot(&s, REC_SELFCAL_OFF), *f = slot(&s, REC_SELFCAL_ON);
    for (int live = 0; live < 2; live++) {
        rec_average *a = average(1, 9);
        if (live)
            rec_solver_average(f->solver, a);
        else
            learn(&s, f, a, NULL, NULL);
        for (int k = 0; k < 8; k++) {
            burn(&s, f, k, NULL, NULL);
            burn(&s, off, k, NULL, NULL);
            solve(&s, f);
            solve(&s, off);
            T_OK(same_volume(off, f));
            T_OK(!found(f)->gain && !found(f)->shift);
        }
        T_OK(found(f)->sets == (live ? 8 : SETS));
        printf("  gains %.1f sigma, shifts %.1f\n", found(f)->test[0], found(f)->test[1]);
        rec_solver_average(f->solver, NULL);
        rec_average_free(&a);
    }
    rec_frame_free(&off);
    rec_frame_free(&f);
    scene_free(&s);
}

/* Live: sets correct themselves, then by the mean, which one more set does not move.  A camera that then is black is
 * voted out, and what was known of it stays. */
T_CASE(a_live_mean_is_steadier_than_a_set)
{
    static const double dim[CAMERAS] = {1, 0.8, 1, 1, 1, 1}, black[CAMERAS] = {1, 0.8, 0, 1, 1, 1};
    struct rec_frame_params p = rec_frame_defaults;
    struct scene s;
    rec_frame *f;
    rec_average *a = average(1, 33);
    scene_new(&s, CAMERAS, 96, 32, 2, 2);
    p.photo.saturation = REC_PHOTO_UNSATURATED;
    if (rec_frame_alone(s.S, &s.rig, &p, s.pool, &f, NULL) != PVX_OK)
        exit(2);
    rec_solver_average(f->solver, a);
    for (int k = 0; k < 12; k++) {
        burn(&s, f, k, k < 10 ? dim : black, NULL);
        solve(&s, f);
        T_OK(found(f)->gain && found(f)->sets == (k + 1 < REC_AVERAGE_LEAST ? 0 : (unsigned)k + 1));
        T_EQ_I(rec_frame_get_report(f)->vote.out, k < 10 ? 0 : 4);
        double others = (double)found(f)->camera[0].gain;
        T_NEAR((double)found(f)->camera[1].gain / others, 1 / 0.8, 0.03);
        T_OK(k < REC_AVERAGE_LEAST || found(f)->camera[2].known);
        T_EQ_I(found(f)->camera[2].touched, 0);
    }
    rec_frame_free(&f);
    rec_average_free(&a);
    scene_free(&s);
}

/* Mosaics and three cameras: no set says anything, and each stays by itself, as it is. */
T_CASE(sets_that_say_nothing_are_no_mean)
{
    struct scene s;
    scene_new(&s, CAMERAS, 96, 32, 1, 2);
    for (int k = 0; k < 2; k++) {
        rec_frame *f = slot(&s, REC_SELFCAL_ON), *off = slot(&s, REC_SELFCAL_OFF);
        rec_average *a = average(1, 9);
        rec_solver_average(f->solver, a);
        for (int i = 0; i < 6; i++) {
            rec_frame *both[] = {f, off};
            for (int j = 0; j < 2; j++) {
                burn(&s, both[j], i, gains, NULL);
                for (size_t c = 3; c < CAMERAS && k == 0; c++)
                    rec_frame_camera(both[j], c)->present = false;
                if (k == 1)
                    scene_filter(&s, both[j]);
                solve(&s, both[j]);
            }
            T_OK(found(f)->cameras == 0 && found(f)->sets == 0 && same_volume(f, off));
        }
        rec_frame_free(&f);
        rec_frame_free(&off);
        rec_average_free(&a);
    }
    scene_free(&s);
}

/* One channel and four cameras are enough. */
T_CASE(grey_sets_of_four_cameras_learn_too)
{
    static const double g[4] = {1.1, 0.9, 1.05, 0.95};
    struct rec_frame_params p = rec_frame_defaults;
    struct scene s;
    rec_frame *f;
    rec_average *a;
    scene_new(&s, 4, 96, 32, 2, 2);
    p.nch = 1;
    p.photo.saturation = REC_PHOTO_UNSATURATED;
    p.trust_all = true;
    T_OK(rec_average_new(4, 1, 1, SETS + 1, &a) == PVX_OK);
    T_OK(rec_frame_alone(s.S, &s.rig, &p, s.pool, &f, NULL) == PVX_OK);
    rec_solver_average(f->solver, a);
    rec_average_learn(a);
    for (int k = 0; k <= SETS; k++) {
        scene_at(&s, 0.2 + 0.17 * k);
        rec_frame_reset(f);
        for (size_t c = 0; c < 4; c++) {
            float *in = rec_frame_input(f, c);
            for (size_t i = 0; i < s.S->row0[c + 1] - s.S->row0[c]; i++)
                in[i] = (float)(g[c] * (double)s.image[c][i * 4] + 0.002 * t_normal());
            rec_frame_camera(f, c)->present = true;
        }
        if (k == SETS)
            rec_average_fix(a);
        solve(&s, f);
    }
    T_OK(found(f)->gain && found(f)->sets == SETS);
    for (int c = 0; c < 4; c++)
        T_NEAR((double)found(f)->camera[c].gain * g[c], 1, 0.015);
    rec_frame_free(&f);
    rec_average_free(&a);
    scene_free(&s);
}
