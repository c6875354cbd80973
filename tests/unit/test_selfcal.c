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

T_CASE(bits_do_not_depend_on_threads_or_on_the_set_before)
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
