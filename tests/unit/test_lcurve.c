/* The corner of the L-curve, point by point. */
#include "../t.h"

#include "recon/solve/lcurve.h"

/* Residual falls to 1e-3 while the norm hardly moves, then the norm rises at a constant residual. */
T_CASE(corner_of_an_L)
{
    struct rec_lcurve c = {0};
    uint32_t done = 0;
    for (uint32_t k = 1; k <= 40 && done == 0; k++) {
        double r = k <= 12 ? pow(10, -0.25 * k) : 1e-3 * (1 - 1e-3 * (k - 12));
        double x = k <= 12 ? 1 + 1e-3 * k : pow(1.3, (double)k - 12);
        (void)rec_lcurve_add(&c, k, r, x);
        if (rec_lcurve_done(&c, k, 6))
            done = k;
    }
    T_EQ_I(c.best_k, 12);
    T_EQ_I(done, 18);
}

T_CASE(points_without_a_logarithm_are_skipped)
{
    struct rec_lcurve c = {0};
    for (uint32_t k = 1; k < 20; k++) {
        T_OK(!rec_lcurve_add(&c, k, 0, 1));
        T_OK(!rec_lcurve_add(&c, k, 1, (double)INFINITY));
        T_OK(!rec_lcurve_add(&c, k, (double)NAN, 1));
    }
    T_EQ_I(c.n, 0);
    T_EQ_I(c.best_k, 0);
    T_OK(!rec_lcurve_done(&c, 1000, 6)); /* no corner: never done */
}

T_CASE(repeated_points_are_skipped)
{
    struct rec_lcurve c = {0};
    for (uint32_t k = 1; k < 20; k++)
        (void)rec_lcurve_add(&c, k, 0.5, 2);
    T_EQ_I(c.n, 1);
    T_EQ_I(c.best_k, 0);
}

/* A straight line, and a bend the other way, are no corner. */
T_CASE(only_an_L_has_a_corner)
{
    struct rec_lcurve line = {0}, other = {0};
    for (uint32_t k = 1; k <= 20; k++) {
        (void)rec_lcurve_add(&line, k, pow(2, -1.0 * k), pow(1.5, k));
        double r = k <= 10 ? 1 - 1e-3 * k : pow(0.8, (double)k - 10);
        double x = k <= 10 ? pow(1.3, k) : pow(1.3, 10) * (1 + 1e-3 * k);
        (void)rec_lcurve_add(&other, k, r, x);
    }
    T_LE(line.best, 1e-6);
    T_OK(other.best_k != 10 && other.best_k != 11);
}

/* A sharper corner later takes over, and `add` says at once that the point before is the one. */
T_CASE(the_sharpest_corner_wins)
{
    struct rec_lcurve c = {0};
    static const double lr[] = {0, -1, -2, -2.9, -3.8, -4.8, -4.8, -4.8},
                        lx[] = {0, 0, 0, 0.5, 1, 1, 2, 3};
    uint32_t told = 0;
    for (uint32_t k = 1; k <= 8; k++) {
        if (rec_lcurve_add(&c, k, exp(lr[k - 1]), exp(lx[k - 1])))
            told = k - 1;
        if (k == 5)
            T_EQ_I(c.best_k, 3);
    }
    T_EQ_I(c.best_k, 6);
    T_EQ_I(told, 6);
    T_OK(!rec_lcurve_done(&c, 8, 6));
    T_OK(rec_lcurve_done(&c, 12, 6));
}
