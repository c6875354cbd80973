#include "recon/geom/bundle.h"

#include <math.h>

#include "recon/geom/ray_table.h"

#define PI 3.14159265358979323846

/* Integral of the normal distribution function: z Phi(z) + phi(z). */
static double bundle_ramp(double z)
{
    return z * 0.5 * erfc(-z / sqrt(2)) + exp(-0.5 * z * z) / sqrt(2 * PI);
}

/* Distribution function of a square of px blurred by sigma, at x from its middle. */
static double bundle_below(double x, double px, double sigma)
{
    double a = (x + 0.5 * px) / sigma, b = (x - 0.5 * px) / sigma;
    return sigma / px * (bundle_ramp(a) - bundle_ramp(b));
}

/* Points of equal weight along an axis, with the variance of the blurred square. */
static void bundle_spread(struct rec_bundle *b, double px, double sigma)
{
    double have = 0, n = b->side;
    for (int32_t i = 0; i < b->side; i++) {
        double lo = -0.5 * px - 8 * sigma, hi = -lo, share = (i + 0.5) / n;
        for (int it = 0; it < 60; it++) {
            double mid = 0.5 * (lo + hi);
            if (bundle_below(mid, px, sigma) < share)
                lo = mid;
            else
                hi = mid;
        }
        b->at[i] = 0.5 * (lo + hi);
        have += b->at[i] * b->at[i] / n;
    }
    double by = have > 0 ? sqrt((px * px / 12 + sigma * sigma) / have) : 0;
    for (int32_t i = 0; i < b->side; i++)
        b->at[i] = 0.5 * px + by * b->at[i];
}

/* The same of the rays of a table, whose middle is on their z axis. */
static double bundle_disc(const struct rec_camera *c, const struct rec_grid *g)
{
    double z[2] = {INFINITY, 0};
    for (int i = 0; i < 8; i++) {
        double Z = c->t[2];
        for (int a = 0; a < 3; a++)
            Z += c->R[6 + a] * (i >> a & 1 ? g->max[a] : g->min[a]);
        z[0] = fmin(z[0], fmax(Z, 0));
        z[1] = fmax(z[1], Z);
    }
    return rec_ray_table_disc(c->table, z) * fmax(c->fx, c->fy);
}

/* Radius of the largest disc of confusion in the volume; seen from a point a of the aperture, a point moves by
 * a (1/focus - 1/Z) in (x,y). */
double rec_blur_disc(const struct rec_camera *c, const struct rec_grid *g)
{
    double most = 0;
    if (c->blur.rays > 0)
        return bundle_disc(c, g);
    for (int i = 0; i < 8 && c->blur.aperture > 0; i++) {
        struct rec_projection p;
        double X[3], z;
        for (int a = 0; a < 3; a++)
            X[a] = i >> a & 1 ? g->max[a] + 0.5 * rec_grid_h(g, a)
                              : g->min[a] - 0.5 * rec_grid_h(g, a);
        z = rec_camera_depth(c, X);
        if (!(z > 0) || !rec_camera_project_full(c, X, &p))
            continue;
        double steep = sqrt(p.J[0] * p.J[0] + p.J[1] * p.J[1] + p.J[2] * p.J[2] + p.J[3] * p.J[3]);
        most = fmax(most, 0.5 * c->blur.aperture * fabs(1 / c->blur.focus - 1 / z) * steep);
    }
    return most;
}

void rec_bundle_init(struct rec_bundle *b, const struct rec_camera *c, double px, int32_t rays,
                     const struct rec_grid *g)
{
    double sigma = c->blur.sigma, step = px / rays;
    *b = (struct rec_bundle){.c = c, .side = rays, .lens = 1};
    if (sigma > 0) {
        b->side =
            (int32_t)fmin(REC_BUNDLE_SIDE, ceil(rays * sqrt(1 + 12 * sigma * sigma / (px * px))));
        bundle_spread(b, px, sigma);
        b->reach = fmax(0, -b->at[0]);
        return;
    }
    for (int32_t i = 0; i < rays; i++)
        b->at[i] = (i + 0.5) * step;
    if (c->blur.rays > 0) {
        b->reach = rec_blur_disc(c, g) + 0.05;
        b->lens = c->blur.rays;
    } else if (c->blur.aperture > 0) {
        double across = 2 * rec_blur_disc(c, g) / px; /* squares */
        b->reach = 0.51 * across * px + 0.05;         /* glass makes depths a little shorter */
        b->lens = (int32_t)fmin(REC_BUNDLE_LENS, ceil(fmax(1, 1 + 2 * across * across)));
    }
}

bool rec_bundle_ray(const struct rec_bundle *b, double u, double v, int32_t i, double origin[3],
                    double dir[3])
{
    int32_t sub = i / b->lens, point = i % b->lens;
    u += b->at[sub % b->side];
    v += b->at[sub / b->side];
    if (b->lens == 1)
        return rec_camera_ray(b->c, u, v, origin, dir);
    if (b->c->blur.rays > 0)
        return rec_camera_ray_of(b->c, u, v, point, origin, dir);
    double r = 0.5 * b->c->blur.aperture * sqrt((point + 0.5) / b->lens);
    double turn = 2.399963229728653 * (point + 0.37 * sub); /* the golden angle; squares differ */
    const double from[2] = {r * cos(turn), r * sin(turn)};
    return rec_camera_ray_from(b->c, u, v, from, origin, dir);
}
