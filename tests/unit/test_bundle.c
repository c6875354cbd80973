#include "recon/geom/bundle.h"

#include "recon/geom/rig.h"
#include "tests/lib/optics.h"
#include "tests/t.h"

static struct rec_camera camera(void)
{
    struct rec_camera c = {
        .width = 640, .height = 480, .fx = 500, .fy = 503, .cx = 322.1, .cy = 236.7};
    const double at[3] = {1.5, -1, 0.7}, to[3] = {0, 0, 0.4};
    rec_camera_look(at, to, &c);
    c.dist[0] = -0.1;
    return c;
}

static const struct rec_grid grid = {{-0.5, -0.5, 0}, {0.5, 0.5, 1}, {16, 16, 16}, REC_TRILINEAR};

T_CASE(sharp_rays_are_even)
{
    struct rec_camera c = camera();
    struct rec_bundle b;
    rec_bundle_init(&b, &c, 4, 3, &grid);
    T_EQ_I(rec_bundle_rays(&b), 9);
    T_NEAR(b.reach, 0, 0);
    for (int i = 0; i < 9; i++) {
        double o[3], d[3], p[3], e[3];
        T_OK(rec_bundle_ray(&b, 40 - 0.5, 80 - 0.5, i, o, d));
        T_OK(rec_camera_ray(&c, 40 - 0.5 + (i % 3 + 0.5) * (4.0 / 3),
                            80 - 0.5 + (i / 3 + 0.5) * (4.0 / 3), p, e));
        T_OK(memcmp(d, e, sizeof d) == 0 && memcmp(o, p, sizeof o) == 0);
    }
}

/* Points of equal weight along an axis against the square convolved with the Gaussian, sampled. */
T_CASE(sigma_is_the_gaussian)
{
    static const double sigmas[] = {0.3, 1, 2, 5, 16};
    for (int s = 0; s < 5; s++)
        for (int px = 1; px <= 4; px *= 2) {
            struct rec_camera c = camera();
            struct rec_bundle b;
            double mean = 0, var = 0, worst = 0;
            c.blur.sigma = sigmas[s];
            rec_bundle_init(&b, &c, px, 2, &grid);
            T_LE(2, b.side);
            T_LE(b.side, REC_BUNDLE_SIDE);
            for (int i = 0; i < b.side; i++)
                mean += (b.at[i] - 0.5 * px) / b.side;
            for (int i = 0; i < b.side; i++)
                var += (b.at[i] - 0.5 * px) * (b.at[i] - 0.5 * px) / b.side;
            T_NEAR(mean, 0, 1e-9 * sigmas[s]);
            T_NEAR(var, px * px / 12.0 + sigmas[s] * sigmas[s], 1e-9 * var);
            for (int k = -20; k <= 20; k++) { /* light of an edge there */
                double x = 0.15 * k * sigmas[s], is = 0, should = 0;
                for (int i = 0; i < b.side; i++)
                    is += (b.at[i] - 0.5 * px < x) / (double)b.side;
                for (int i = 0; i < 1000; i++)
                    should += 0.5 *
                              erfc(-(x - px * ((i + 0.5) / 1000 - 0.5)) / sigmas[s] / sqrt(2)) /
                              1000;
                worst = fmax(worst, fabs(is - should));
            }
            T_LE(worst, 1.2 / b.side);
            T_NEAR(b.reach, fmax(0, -b.at[0]), 0);
        }
}

/* All rays of a point of the square meet at the focus, begin on the aperture, and fill it evenly; behind glass they
 * are what Snell's law makes of these. */
T_CASE(an_aperture_is_focused)
{
    for (int glass = 0; glass < 2; glass++) {
        struct rec_camera c = camera(), bare = c;
        struct rec_bundle b;
        struct optics_plate plate = {.n = {-0.6, 0.8, 0}, .thickness = 0.03, .index = 1.5};
        double centre[3], area = 0, middle[2] = {0, 0};
        rec_camera_centre(&c, centre);
        c.blur.aperture = 0.02;
        c.blur.focus = 3;
        plate.at = optics_dot(plate.n, centre) + 0.3;
        if (glass == 1) {
            c.n_windows = 1;
            memcpy(c.window[0].normal, plate.n, sizeof plate.n);
            c.window[0].at = plate.at;
            c.window[0].thickness = plate.thickness;
            c.window[0].index = plate.index;
        }
        rec_bundle_init(&b, &c, 1, 2, &grid);
        T_LE(20, b.lens);
        T_LE(b.lens, REC_BUNDLE_LENS);
        for (int i = 0; i < rec_bundle_rays(&b); i++) {
            double o[3], d[3], m[3], e[3], F[3], from[3], z = 0, x[3], to[3];
            int sub = i / b.lens;
            T_OK(rec_bundle_ray(&b, 99.5, 149.5, i, o, d));
            T_OK(rec_camera_ray(&bare, 99.5 + b.at[sub % 2], 149.5 + b.at[sub / 2], m, e));
            for (int a = 0; a < 3; a++)
                z += c.R[6 + a] * e[a];
            for (int a = 0; a < 3; a++)
                F[a] = m[a] + 3 / z * e[a];
            if (glass == 0) {
                memcpy(from, o, sizeof o);
            } else { /* back to the lens */
                memcpy(x, o, sizeof o);
                for (int a = 0; a < 3; a++)
                    to[a] = -d[a];
                struct optics_plate back = {.n = {0.6, -0.8, 0},
                                            .at = -(plate.at + plate.thickness),
                                            .thickness = plate.thickness,
                                            .index = plate.index};
                T_OK(optics_plates(&back, 1, x, to));
                optics_go(x, to, c.R + 6, optics_dot(c.R + 6, centre));
                memcpy(from, x, sizeof x);
            }
            double off[3], r2 = 0, length = 0;
            for (int a = 0; a < 3; a++) {
                off[a] = from[a] - centre[a];
                r2 += off[a] * off[a];
                length += (F[a] - from[a]) * (F[a] - from[a]);
            }
            T_NEAR(optics_dot(off, c.R + 6), 0, 1e-12);
            T_LE(r2, 0.01 * 0.01);
            for (int a = 0; a < 3; a++)
                T_NEAR(d[a], (F[a] - from[a]) / sqrt(length), 1e-12);
            area += r2 / rec_bundle_rays(&b);
            middle[0] += optics_dot(off, c.R) / rec_bundle_rays(&b);
            middle[1] += optics_dot(off, c.R + 3) / rec_bundle_rays(&b);
        }
        T_NEAR(area, 0.01 * 0.01 / 2, 1e-9);
        T_LE(hypot(middle[0], middle[1]), 0.03 * 0.01);
        /* the largest disc: at the nearest corner of the volume */
        double disc = rec_blur_disc(&c, &grid), most = 0;
        for (int i = 0; i < 2000; i++) {
            struct rec_projection p;
            double X[3] = {t_uniform(-0.5, 0.5), t_uniform(-0.5, 0.5), t_uniform(0, 1)};
            double far = rec_camera_depth(&c, X);
            if (rec_camera_project_full(&c, X, &p))
                most = fmax(most, 0.01 * fabs(1.0 / 3 - 1 / far) * 500);
        }
        T_LE(0.7 * most, disc);
        T_LE(disc, 2.2 * most);
    }
}
