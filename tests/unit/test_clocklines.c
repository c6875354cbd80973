/* test_clocklines.c - the two estimators of a clock's line, each alone: the envelope under frames, the fit
 * through readings. */
#include "../t.h"

#include "base/clock.h"
#include "capture/sync/clockfit.h"
#include "capture/sync/envelope.h"

#define S  PVX_NS_PER_S
#define MS PVX_NS_PER_MS

/* 30 points a second of y = at + ppm x + what(k), which is never negative.  The sum of what above says. */
static double feed(struct cap_envelope *e, int64_t from, int64_t to, double at, double ppm,
                   double (*what)(int64_t k))
{
    double sum = 0, above;
    for (int64_t k = from * 30; k < to * 30; k++) {
        int64_t x = k * (S / 30);
        (void)cap_envelope_add(e, x, at + ppm * 1e-6 * (double)x + what(k), &above);
        sum += above;
    }
    return sum;
}
static double none(int64_t k)
{
    (void)k;
    return 0;
}
static double some(int64_t k)
{
    (void)k;
    return t_uniform(0, 1e6);
}
static double mostly_late(int64_t k) /* one in ten is in time */
{
    return k % 10 == 3 ? 0 : 120e6;
}

T_CASE(a_line_is_found_as_it_is)
{
    for (double ppm = -400; ppm <= 400; ppm += 200) {
        struct cap_envelope e = {0};
        cap_envelope_begin(&e, 0, 1e6);
        T_OK(feed(&e, 0, 40, 1e6, ppm, none) == 0);
        T_NEAR(e.drift * 1e6, ppm, 1e-6);
        T_NEAR(cap_envelope_at(&e, 100 * S), 1e6 + ppm * 1e-6 * 100e9, 1);
        T_NEAR(e.excess_ns, 0, 1);
    }
}

T_CASE(it_lies_under_every_point_and_late_ones_do_not_pull_it)
{
    double (*const what[])(int64_t) = {some, mostly_late};
    for (int i = 0; i < 2; i++) {
        struct cap_envelope e = {0};
        double above;
        cap_envelope_begin(&e, 0, 0);
        (void)feed(&e, 0, 20, 0, 60, what[i]);
        for (int64_t k = 20 * 30; k < 120 * 30; k++) {
            double x = (double)(k * (S / 30)), y = 60e-6 * x + what[i](k);
            (void)cap_envelope_add(&e, k * (S / 30), y, &above);
            T_LE(cap_envelope_at(&e, k * (S / 30)), y + 1e-8); /* of 7e6, four roundings */
            T_NEAR(cap_envelope_at(&e, k * (S / 30)), 60e-6 * x, i == 0 ? 150e3 : 1);
        }
        T_NEAR(e.drift * 1e6, 60, i == 0 ? 3 : 1e-6);
    }
}

T_CASE(drift_is_limited_more_so_at_first)
{
    struct cap_envelope e = {0};
    cap_envelope_begin(&e, 0, 0);
    (void)feed(&e, 0, 3, 0, 300, none);
    T_OK(e.drift == 0); /* not yet a line */
    (void)feed(&e, 3, 10, 0, 300, none);
    T_OK(e.n < CAP_ENVELOPE_KNOWN && e.drift == 150e-6);
    (void)feed(&e, 10, 20, 0, 300, none);
    T_NEAR(e.drift, 300e-6, 1e-12);
    (void)feed(&e, 20, 100, -4.2e6, 510, none); /* a bend, and no step */
    T_OK(e.drift == CAP_DRIFT_MAX);
}

/* Down at once, up after three seconds and only by 5 ms or more; the drift stays. */
T_CASE(a_step_is_followed)
{
    struct cap_envelope e = {0};
    cap_envelope_begin(&e, 0, 0);
    (void)feed(&e, 0, 30, 0, 50, none);
    T_OK(feed(&e, 30, 40, 4e6, 50, none) == 0);
    double drift = e.drift;
    T_NEAR(feed(&e, 40, 44, 50e6, 50, none), 50e6, 3e6);
    T_OK(e.n == 1 && e.drift == drift);
    T_NEAR(cap_envelope_at(&e, 44 * S), 50e6 + 50e-6 * 44e9, 1e3);
    (void)feed(&e, 44, 45, -7e6, 50, none);
    T_NEAR(cap_envelope_at(&e, 45 * S), -7e6 + 50e-6 * 45e9, 1e3);
}

T_CASE(no_point_yet_is_no_bucket)
{
    struct cap_envelope e = {0};
    double above;
    cap_envelope_begin(&e, 0, INFINITY);
    T_OK(cap_envelope_at(&e, 5 * S) == 0);
    T_OK(cap_envelope_add(&e, 5 * S, -3e6, &above));
    T_EQ_I(e.n, 0);
    T_NEAR(cap_envelope_at(&e, 5 * S), -3e6, 1e-6);
}

/* ---- readings --------------------------------------------------------------------------------- */

T_CASE(weights_are_those_of_the_bounds)
{
    struct cap_clockfit f = {0};
    for (int64_t i = 0; i < 8; i++) /* exact ones, and as many that are 50 us off and say so */
        cap_clockfit_add(&f, i * S, 1e6 + 80e-6 * (double)(i * S) + (i % 2 ? 50e3 : 0),
                         i % 2 ? 50e3 : 1e3);
    T_OK(f.good);
    T_NEAR(cap_clockfit_at(&f, 4 * S), 1e6 + 80e-6 * 4e9, 200); /* 50 us * (2 / 51)^2 */
    T_NEAR(f.drift * 1e6, 80, 0.1);
    T_OK(f.bound_ns < 1001 && f.drift_bound < 1e-6);
}

/* The estimate is off by its standard error, as the bounds say: chi-square of n draws, 1 +- sqrt(2 / n) = 0.0224; the limit
 * is 6.7 of that. */
T_CASE(it_knows_how_sure_it_is)
{
    double sum = 0, drift = 0;
    int n = 4000;
    for (int k = 0; k < n; k++) {
        struct cap_clockfit f = {0};
        for (int64_t i = 0; i < CAP_CLOCKFIT_READINGS; i++) {
            double u = 0; /* normal, sigma 21 us = bound and grain */
            for (int j = 0; j < 12; j++)
                u += t_uniform(-0.5, 0.5);
            cap_clockfit_add(&f, i * S, 21e3 * u, 20e3);
        }
        sum += f.diff_ns * f.diff_ns / (f.bound_ns * f.bound_ns) / n;
        drift += f.drift * f.drift / (f.drift_bound * f.drift_bound) / n;
    }
    T_NEAR(sum, 1, 0.15);
    T_NEAR(drift, 1, 0.15);
}

T_CASE(it_is_good_with_three_that_are_far_apart_and_for_ten_seconds)
{
    struct cap_clockfit f = {0};
    for (int i = 0; i < 3; i++) {
        T_OK(!f.good);
        cap_clockfit_add(&f, i * 2 * S, 0, 10e3);
    }
    T_OK(f.good);
    T_OK(cap_clockfit_holds(&f, 4 * S + 10 * S - 1));
    T_OK(!cap_clockfit_holds(&f, 4 * S + 10 * S));
    cap_clockfit_forget(&f);
    T_OK(!f.good && f.n == 0);
    for (int i = 0; i < 5; i++) /* together: no drift */
        cap_clockfit_add(&f, i * MS, 0, 10e3);
    T_OK(!f.good);
}

T_CASE(one_that_does_not_fit_begins_anew)
{
    struct cap_clockfit f = {0};
    for (int i = 0; i < 10; i++)
        cap_clockfit_add(&f, i * 2 * S, i % 2 ? 90e3 : 0, 10e3); /* within 100 us: stays */
    T_EQ_I(f.n, 10);
    cap_clockfit_add(&f, 20 * S, 500e3, 10e3);
    T_EQ_I(f.n, 1);
    T_OK(!f.good);
    T_NEAR(cap_clockfit_at(&f, 21 * S), 500e3, 1);
    for (int i = 0; i < 40; i++)
        cap_clockfit_add(&f, (22 + i) * S, 500e3, 10e3);
    T_EQ_I(f.n, CAP_CLOCKFIT_READINGS);
}
