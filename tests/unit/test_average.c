/* Corrections averaged over frame sets: their bars, false alarms, what is forgotten, cameras that were touched. */
#include <math.h>
#include <pthread.h>

#include "base/mem.h"
#include "recon/solve/average.h"
#include "tests/t.h"

#define CAMERAS 6

/* Cameras in a ring, about 50 bins to a metre. */
static void look_at(size_t c, struct rec_selfcal_look *l)
{
    double phi = 0.9 * (double)c;
    *l = (struct rec_selfcal_look){.known = true,
                                   .J = {{-50 * sin(phi), 50 * cos(phi), 0}, {0, 0, -50}}};
}

struct rig {
    double gain[CAMERAS], shift[CAMERAS][2]; /* logs; nothing in them that no picture shows */
};

static struct rig rig_off(double gains, double shifts)
{
    struct rec_selfcal_place p[CAMERAS];
    struct rig r;
    for (size_t c = 0; c < CAMERAS; c++) {
        struct rec_selfcal_look l;
        look_at(c, &l);
        p[c] = (struct rec_selfcal_place){.in = {true, true}, .gain = exp(gains * t_normal())};
        for (int i = 0; i < 2; i++)
            p[c].shift[i] = shifts * t_normal();
        memcpy(p[c].J, l.J, sizeof l.J);
    }
    rec_selfcal_anchor(p, CAMERAS);
    for (size_t c = 0; c < CAMERAS; c++) {
        r.gain[c] = log(p[c].gain);
        memcpy(r.shift[c], p[c].shift, sizeof p[c].shift);
    }
    return r;
}

/* A set that sees the rig with these errors; `share` of what is wrong beyond what is applied. */
static void see(rec_average *a, const struct rig *r, double gains, double shifts, double share)
{
    struct rec_selfcal_look l[CAMERAS];
    struct rec_selfcal_given g;
    (void)rec_average_given(a, &g);
    for (size_t c = 0; c < CAMERAS; c++) {
        double from = g.gain ? log(g.camera[c].gain) : 0;
        look_at(c, &l[c]);
        l[c].log_gain = from + share * (r->gain[c] - from) + gains * t_normal();
        l[c].gain_var = gains * gains;
        for (int i = 0; i < 2; i++) {
            from = g.shift ? g.camera[c].shift[i] : 0;
            l[c].shift[i] = from + share * (r->shift[c][i] - from) + shifts * t_normal();
            l[c].var[2 * i] = shifts * shifts;
        }
    }
    rec_average_add(a, l);
}

static rec_average *average(uint32_t block, uint32_t blocks)
{
    rec_average *a;
    if (rec_average_new(CAMERAS, 1, block, blocks, &a) != PVX_OK)
        exit(2);
    return a;
}

static struct rec_selfcal_report told(rec_average *a)
{
    struct rec_selfcal_report r;
    rec_average_tell(a, &r);
    return r;
}

/* One sigma holds two thirds of the errors, though five of twelve numbers are bound by what no picture shows. */
T_CASE(bars_hold_what_they_say)
{
    int within[2] = {0}, all[2] = {0};
    t_state = 1;
    for (int seed = 0; seed < 400; seed++) {
        struct rig r = rig_off(0.2, 0.6);
        rec_average *a = average(1, 21);
        rec_average_learn(a);
        for (int k = 0; k < 20; k++)
            see(a, &r, 0.02, 0.1, 1);
        struct rec_selfcal_report t = told(a);
        T_OK(t.gain);
        T_OK(t.shift);
        T_EQ_I(t.sets, 20);
        for (size_t c = 0; c < CAMERAS; c++) {
            const struct rec_selfcal_camera *k = &t.camera[c];
            within[0] += fabs(log((double)k->gain) - r.gain[c]) < (double)k->gain_error;
            all[0]++;
            for (int i = 0; i < 2; i++, all[1]++)
                within[1] += fabs((double)k->shift[i] - r.shift[c][i]) < (double)k->shift_error[i];
        }
        rec_average_free(&a);
    }
    double gains = (double)within[0] / all[0], shifts = (double)within[1] / all[1];
    printf("  within one sigma: gains %.3f, shifts %.3f\n", gains, shifts);
    T_OK(gains > 0.64 && gains < 0.80);
    T_OK(shifts > 0.64 && shifts < 0.85);
}

/* Errors so large that their mean has a size that matters: only the test says that it is chance. */
T_CASE(chance_seldom_opens_the_gate)
{
    for (int n = 5; n <= 20; n += 15) {
        const struct rig exact = {{0}, {{0}}};
        int alarms = 0, large = 0;
        t_state = 2;
        for (int seed = 0; seed < 2000; seed++) {
            rec_average *a = average(1, 21);
            rec_average_learn(a);
            for (int k = 0; k < n; k++)
                see(a, &exact, 0.2, 1, 1);
            struct rec_selfcal_report t = told(a);
            alarms += t.gain || t.shift;
            large += fabs((double)t.camera[0].shift[0]) > REC_SELFCAL_SHIFT_LEAST;
            rec_average_free(&a);
        }
        printf("  %d sets: %d of 2000 alarms, %d of a size that matters\n", n, alarms, large);
        T_OK(alarms <= 20 && large > 400);
    }
}

/* What is beyond chance and too small to matter is not applied; what is six times as large is. */
T_CASE(size_matters)
{
    struct rig r;
    t_state = 3;
    r = rig_off(0.01, 0.03);
    for (int k = 0; k < 2; k++) {
        rec_average *a = average(1, 21);
        struct rec_selfcal_given g;
        rec_average_learn(a);
        for (int i = 0; i < 20; i++)
            see(a, &r, 0.001, 0.004, 1);
        rec_average_fix(a);
        T_EQ_I(rec_average_given(a, &g), REC_SELFCAL_FIXED);
        T_EQ_I(g.gain, k == 1);
        T_EQ_I(g.shift, k == 1);
        T_OK(told(a).test[0] > 5 && told(a).test[1] > 5);
        for (size_t c = 0; c < CAMERAS; c++) {
            r.gain[c] *= 6;
            for (int i = 0; i < 2; i++)
                r.shift[c][i] *= 6;
        }
        rec_average_free(&a);
    }
}

/* A set shows only half of what is wrong: what is applied still comes to the whole. */
T_CASE(a_mean_that_is_applied_comes_to_the_truth)
{
    t_state = 4;
    struct rig r = rig_off(0.1, 0.4);
    rec_average *a = average(4, 9);
    for (int k = 0; k < 400; k++)
        see(a, &r, 0.01, 0.05, 0.5);
    struct rec_selfcal_report t = told(a);
    T_OK(t.gain && t.shift && t.sets == 32);
    for (size_t c = 0; c < CAMERAS; c++) {
        T_NEAR(log((double)t.camera[c].gain), r.gain[c], 0.015);
        T_NEAR((double)t.camera[c].shift[0], r.shift[c][0], 0.07);
        T_EQ_I(t.camera[c].touched, 0);
    }
    rec_average_free(&a);
}

/* Live: before there is a mean, sets correct themselves; old sets do not count for ever. */
T_CASE(a_slow_change_is_followed)
{
    struct rec_selfcal_given g;
    t_state = 5;
    struct rig r = rig_off(0.05, 0.2);
    rec_average *a = average(4, 9);
    for (int k = 0; k < 15; k++) {
        T_EQ_I(rec_average_given(a, &g), REC_SELFCAL_ALONE);
        T_OK(!g.gain && !g.shift && told(a).sets == 0);
        see(a, &r, 0.01, 0.05, 1);
    }
    see(a, &r, 0.01, 0.05, 1);
    T_EQ_I(rec_average_given(a, &g), REC_SELFCAL_GIVEN);
    for (int k = 0; k < 400; k++) {
        r.shift[1][1] += 0.002; /* a mount that creeps: .8 bins, little by little */
        see(a, &r, 0.01, 0.05, 1);
    }
    for (int k = 0; k < 40; k++)
        see(a, &r, 0.01, 0.05, 1);
    struct rec_selfcal_report t = told(a);
    T_EQ_I(t.camera[1].touched, 0);
    double others = 0; /* all pictures moved alike: the flame would have, and nobody can tell */
    for (size_t c = 0; c < CAMERAS; c++)
        others += c == 1 ? 0 : ((double)t.camera[c].shift[1] - r.shift[c][1]) / (CAMERAS - 1);
    T_NEAR((double)t.camera[1].shift[1] - r.shift[1][1] - others, 0, 0.05);
    rec_average_free(&a);
}

T_CASE(a_touched_camera_is_learnt_anew)
{
    t_state = 6;
    for (int kind = 0; kind < 2; kind++) {
        struct rig r = rig_off(0.05, 0.2);
        rec_average *a = average(4, 17);
        for (int k = 0; k < 80; k++)
            see(a, &r, 0.01, 0.05, 1);
        r.gain[3] += kind == 0 ? 0.3 : 0;
        r.shift[3][0] += kind == 1 ? 1 : 0;
        for (int k = 0; k < 12; k++)
            see(a, &r, 0.01, 0.05, 1);
        struct rec_selfcal_report t = told(a);
        for (size_t c = 0; c < CAMERAS; c++)
            T_EQ_I(t.camera[c].touched, c == 3);
        T_OK(!t.camera[3].known && t.camera[2].known);
        for (int k = 0; k < 40; k++)
            see(a, &r, 0.01, 0.05, 1);
        t = told(a);
        T_OK(t.camera[3].known && t.camera[3].touched == 1);
        double mean = 0; /* of what the others lack against it, gains first */
        for (size_t c = 0; c < CAMERAS && kind == 0; c++)
            mean += c == 3 ? 0 : (log((double)t.camera[c].gain) - r.gain[c]) / (CAMERAS - 1);
        if (kind == 0)
            T_NEAR(log((double)t.camera[3].gain) - r.gain[3], mean, 0.02);
        rec_average_free(&a);
    }
}

T_CASE(nobody_is_touched_by_chance)
{
    const struct rig exact = {{0}, {{0}}};
    int alarms = 0;
    t_state = 7;
    for (int seed = 0; seed < 200; seed++) {
        rec_average *a = average(1, 33);
        for (int k = 0; k < 200; k++)
            see(a, &exact, 0.2, 1, 1);
        for (size_t c = 0; c < CAMERAS; c++)
            alarms += (int)told(a).camera[c].touched;
        rec_average_free(&a);
    }
    printf("  %d false alarms in 40000 sets of %d cameras\n", alarms, CAMERAS);
    T_OK(alarms <= 1);
}

/* Sets without one camera, then with it: it waits until it is known, the others do not. */
T_CASE(a_missing_camera_is_not_known)
{
    struct rec_selfcal_look l[CAMERAS];
    struct rec_selfcal_given g;
    rec_average *a = average(1, 21);
    rec_average_learn(a);
    for (int k = 0; k < 8; k++) {
        for (size_t c = 0; c < CAMERAS; c++) {
            look_at(c, &l[c]);
            l[c].known = c != 2;
            l[c].log_gain = c == 0 ? 0.2 : 0;
            l[c].gain_var = 1e-6;
            l[c].var[0] = l[c].var[2] = INFINITY; /* gains alone */
        }
        rec_average_add(a, l);
    }
    rec_average_fix(a);
    struct rec_selfcal_report t = told(a);
    T_OK(t.gain && !t.shift && !t.camera[2].known && t.camera[1].known && t.camera[0].known);
    (void)rec_average_given(a, &g);
    T_OK(g.gain && !g.shift && g.camera[2].gain == 1 && g.camera[0].gain > 1.1);
    rec_average_free(&a);
}

/* Too few sets: each corrects itself. */
T_CASE(too_few_sets_are_no_mean)
{
    struct rec_selfcal_given g;
    t_state = 8;
    struct rig r = rig_off(0.1, 0.3);
    rec_average *a = average(1, 21);
    rec_average_learn(a);
    for (int k = 0; k < REC_AVERAGE_LEAST - 1; k++)
        see(a, &r, 0.01, 0.05, 1);
    rec_average_fix(a);
    T_EQ_I(rec_average_given(a, &g), REC_SELFCAL_ALONE);
    T_EQ_I(told(a).sets, 0);
    rec_average_free(&a);
}

static void *sees(void *ctx)
{
    struct rec_selfcal_look l[CAMERAS];
    struct rec_selfcal_given g;
    for (size_t c = 0; c < CAMERAS; c++) {
        look_at(c, &l[c]);
        l[c].log_gain = c == 0 ? 0.5 : -0.1;
        l[c].gain_var = l[c].var[0] = l[c].var[2] = 1e-4;
    }
    for (int k = 0; k < 1000; k++) {
        (void)rec_average_given(ctx, &g);
        rec_average_add(ctx, l);
    }
    return NULL;
}

T_CASE(several_solvers_share_it)
{
    rec_average *a = average(16, 200);
    pthread_t t[3];
    for (int i = 0; i < 3; i++)
        T_EQ_I(pthread_create(&t[i], NULL, sees, a), 0);
    for (int i = 0; i < 3; i++)
        pthread_join(t[i], NULL);
    T_EQ_I(told(a).sets, 2992); /* whole blocks */
    T_NEAR(log((double)told(a).camera[0].gain / (double)told(a).camera[1].gain), 0.6, 1e-6);
    rec_average_free(&a);
}
