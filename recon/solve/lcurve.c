#include "recon/solve/lcurve.h"

#include <math.h>

/* Signed Menger curvature: 4 * area / product of sides; positive where the curve turns the way an
 * L-curve turns at its corner (residual falls first, then the norm rises). */
static double curvature(const double x[3], const double y[3])
{
    double ax = x[1] - x[0], ay = y[1] - y[0], bx = x[2] - x[1], by = y[2] - y[1];
    double cross = by * ax - bx * ay;
    double sides = hypot(ax, ay) * hypot(bx, by) * hypot(ax + bx, ay + by);
    return sides > 0 ? -2 * cross / sides : 0;
}

bool rec_lcurve_add(struct rec_lcurve *c, uint32_t k, double residual_norm, double solution_norm)
{
    double lr = log(residual_norm), lx = log(solution_norm);
    if (!isfinite(lr) || !isfinite(lx))
        return false;
    if (c->n > 0 && hypot(lr - c->lr[c->n - 1], lx - c->lx[c->n - 1]) < 1e-9)
        return false;
    if (c->n == 3) {
        for (int i = 0; i < 2; i++) {
            c->lr[i] = c->lr[i + 1];
            c->lx[i] = c->lx[i + 1];
            c->k[i] = c->k[i + 1];
        }
        c->n = 2;
    }
    c->lr[c->n] = lr;
    c->lx[c->n] = lx;
    c->k[c->n++] = k;
    if (c->n < 3)
        return false;
    double bend = curvature(c->lr, c->lx);
    if (bend <= c->best)
        return false;
    c->best = bend;
    c->best_k = c->k[1];
    return true;
}

bool rec_lcurve_done(const struct rec_lcurve *c, uint32_t k, uint32_t beyond)
{
    return c->best_k > 0 && k >= c->best_k + beyond;
}
