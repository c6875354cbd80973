/* test_flame.c - the analytic flame: integrals, period, extent, images and voxel truth. */
#include "tests/lib/flame_point.h"
#include "tests/lib/scene.h"

#include "recon/geom/rig.h"
#include "tests/lib/centre.h"
#include "tests/lib/optics.h"

static const struct rec_grid unit_grid = {{-0.5, -0.5, 0}, {0.5, 0.5, 1}, {32, 32, 32}, REC_BOX};

T_CASE(ray_is_the_integral_of_point)
{
    struct rec_flame_pose p = scene_pose(&unit_grid, 7, 0.3);
    for (int n = 0; n < 20; n++) {
        double o[3] = {2, t_uniform(-0.2, 0.2), t_uniform(0, 1)};
        double d[3] = {-1, t_uniform(-0.1, 0.1), t_uniform(-0.2, 0.2)}, len = 0;
        for (int a = 0; a < 3; a++)
            len += d[a] * d[a];
        for (int a = 0; a < 3; a++)
            d[a] /= sqrt(len);
        double sum[3] = {0}, ray[3];
        enum { STEPS = 4000 };
        for (int i = 0; i < STEPS; i++) { /* midpoint rule: spectrally exact for Gaussians */
            double s = 4.0 * (i + 0.5) / STEPS, x[3], e[3];
            for (int a = 0; a < 3; a++)
                x[a] = o[a] + s * d[a];
            flame_point(&p, x, e);
            for (int c = 0; c < 3; c++)
                sum[c] += e[c] * 4.0 / STEPS;
        }
        rec_flame_ray(&p, o, d, ray);
        for (int c = 0; c < 3; c++)
            T_NEAR(ray[c], sum[c], 1e-9 + 1e-7 * sum[c]);
    }
}

T_CASE(periodic_and_inside)
{
    struct rec_flame f;
    struct rec_flame_pose p, q;
    for (uint32_t seed = 0; seed < 5; seed++) {
        rec_flame_init(&f, &unit_grid, seed);
        for (double t = -3; t < 5; t += 0.0371) {
            rec_flame_at(&f, t, &p);
            rec_flame_at(&f, t + 3 * f.period_s, &q);
            for (int g = 0; g < p.n; g++)
                for (int a = 0; a < 3; a++) {
                    double lo = a < 2 ? -0.4 : 0.02, hi = a < 2 ? 0.4 : 0.95;
                    const struct rec_blob *b = &p.blob[g], *c = &q.blob[g];
                    T_LE(lo - 1e-12, b->m[a] - 3 * b->s[a]);
                    T_LE(b->m[a] + 3 * b->s[a], hi + 1e-12);
                    T_OK(b->a[a] >= 0 && b->s[a] > 0);
                    T_NEAR(b->a[a], c->a[a], 1e-9); /* where a life ends the position may jump, */
                    if (b->a[0] > 1e-6)             /* but only in the dark */
                        T_NEAR(b->m[a], c->m[a], 1e-9);
                }
        }
    }
}

/* What one sees changes little in a short time: no blob pops in or out. */
T_CASE(motion_is_smooth)
{
    struct rec_flame f;
    rec_flame_init(&f, &unit_grid, 3);
    double worst = 0, x[3] = {0, 0, 0};
    for (int n = 0; n < 400; n++) {
        x[2] = 0.1 + 0.6 * (n % 20) / 20;
        struct rec_flame_pose p, q;
        double u[3], v[3], t = n * f.period_s / 400;
        rec_flame_at(&f, t, &p);
        rec_flame_at(&f, t + 1e-4, &q);
        rec_flame_ray(&p, x, (double[3]){1, 0, 0}, u);
        rec_flame_ray(&q, x, (double[3]){1, 0, 0}, v);
        worst = fmax(worst, fabs(u[0] - v[0]));
    }
    T_LE(worst, 0.002);
    T_OK(worst > 1e-6); /* and it does move */
}

T_CASE(follows_its_box)
{
    struct rec_grid g = {{1, 2, 3}, {3, 5, 7}, {16, 16, 16}, REC_BOX};
    struct rec_flame f, unit;
    struct rec_flame_pose p, u;
    rec_flame_init(&f, &g, 9);
    rec_flame_init(&unit, &unit_grid, 9);
    rec_flame_at(&f, 1.1, &p);
    rec_flame_at(&unit, 1.1, &u);
    for (int i = 0; i < p.n; i++) {
        T_NEAR(p.blob[i].m[0], 2 + 2 * u.blob[i].m[0], 1e-12);
        T_NEAR(p.blob[i].m[1], 3.5 + 3 * u.blob[i].m[1], 1e-12);
        T_NEAR(p.blob[i].s[2], 4 * u.blob[i].s[2], 1e-12);
    }
}

T_CASE(image_agrees_with_rays)
{
    struct rec_rig rig;
    T_EQ_I(rec_rig_ring(5, 2.2, 160, 120, 32, &rig), PVX_OK);
    struct rec_flame_pose p = scene_pose(&rig.grid, 1, 0.7);
    float *img = malloc(160 * 120 * 3 * sizeof *img);
    for (int sub = 1; sub <= 3; sub += 2)
        for (size_t k = 0; k < rig.n_cameras; k++) {
            const struct rec_camera *c = &rig.cameras[k];
            rec_flame_render(&p, c, sub, 0, 120, img);
            double worst = 0, peak = 0;
            for (int n = 0; n < 3000; n++) {
                int x = (int)t_uniform(0, 160), y = (int)t_uniform(0, 120);
                double want[3] = {0};
                for (int s = 0; s < sub * sub; s++) {
                    double o[3], d[3], rgb[3];
                    T_OK(rec_camera_ray(c, x + (s % sub + 0.5) / sub - 0.5,
                                        y + (s / sub + 0.5) / sub - 0.5, o, d));
                    rec_flame_ray(&p, o, d, rgb);
                    for (int ch = 0; ch < 3; ch++)
                        want[ch] += rgb[ch] / (sub * sub);
                }
                for (int ch = 0; ch < 3; ch++) {
                    worst = fmax(worst, fabs(want[ch] - img[(y * 160 + x) * 3 + ch]));
                    peak = fmax(peak, want[ch]);
                }
            }
            T_LE(worst, 1e-4 * peak);
        }
    free(img);
    rec_rig_fini(&rig);
}

T_CASE(bands_give_the_same_bits)
{
    struct rec_rig rig;
    T_EQ_I(rec_rig_ring(1, 2.2, 100, 90, 32, &rig), PVX_OK);
    struct rec_flame_pose p = scene_pose(&rig.grid, 1, 1.9);
    size_t n = 100 * 90 * 3;
    float *a = malloc(n * sizeof *a), *b = malloc(n * sizeof *b);
    rec_flame_render(&p, rig.cameras, 2, 0, 90, a);
    for (int32_t y = 0; y < 90; y += REC_FLAME_BAND)
        rec_flame_render(&p, rig.cameras, 2, y, y + REC_FLAME_BAND < 90 ? y + REC_FLAME_BAND : 90,
                         b);
    T_EQ_I(memcmp(a, b, n * sizeof *a), 0);
    free(a);
    free(b);
    rec_rig_fini(&rig);
}

T_CASE(standard_rig_is_well_exposed)
{
    struct rec_rig rig;
    T_EQ_I(rec_rig_ring(8, 2.2, 160, 120, 32, &rig), PVX_OK);
    float *img = malloc(160 * 120 * 3 * sizeof *img);
    for (uint32_t seed = 0; seed < 3; seed++) {
        struct rec_flame f;
        rec_flame_init(&f, &rig.grid, seed);
        float most = 0;
        for (int it = 0; it < 8; it++) {
            struct rec_flame_pose p;
            rec_flame_at(&f, f.period_s * it / 8, &p);
            for (size_t c = 0; c < rig.n_cameras; c++) {
                rec_flame_render(&p, &rig.cameras[c], 1, 0, 120, img);
                for (int i = 0; i < 160 * 120 * 3; i++)
                    most = img[i] > most ? img[i] : most;
            }
        }
        T_NEAR(most, 0.8, 0.08);
    }
    free(img);
    rec_rig_fini(&rig);
}

T_CASE(behind_the_camera_is_black)
{
    struct rec_rig rig;
    T_EQ_I(rec_rig_ring(1, 2.2, 64, 48, 32, &rig), PVX_OK);
    struct rec_flame_pose p = scene_pose(&rig.grid, 1, 0);
    struct rec_camera c = rig.cameras[0]; /* turn it round: x and z change sign */
    for (int i = 0; i < 3; i++) {
        c.R[i] = -c.R[i];
        c.R[6 + i] = -c.R[6 + i];
    }
    c.t[0] = -c.t[0];
    c.t[2] = -c.t[2];
    float img[64 * 48 * 3];
    rec_flame_render(&p, &c, 1, 0, 48, img);
    float most = 0;
    for (int i = 0; i < 64 * 48 * 3; i++)
        most = img[i] > most ? img[i] : most;
    T_OK(most == 0);
    rec_rig_fini(&rig);
}

T_CASE(voxels_are_cell_means)
{
    struct rec_grid g = unit_grid;
    struct rec_flame_pose p = scene_pose(&g, 4, 0.5);
    float *v = malloc(rec_grid_count(&g) * 3 * sizeof *v);
    for (int basis = 0; basis < 2; basis++) {
        g.basis = basis == 0 ? REC_BOX : REC_TRILINEAR;
        memset(v, 0xff, rec_grid_count(&g) * 3 * sizeof *v);
        rec_flame_voxels(&p, &g, 0, 20, v);
        rec_flame_voxels(&p, &g, 20, 32, v);
        double peak = 0;
        for (size_t i = 0; i < rec_grid_count(&g) * 3; i++)
            peak = fmax(peak, v[i]);
        for (int n = 0; n < 300; n++) {
            int32_t idx = (int32_t)t_uniform(0, (double)rec_grid_count(&g));
            double c[3], e[3], want[3] = {0};
            grid_centre(&g, idx, c);
            int m =
                basis == 0 ? 8 : 1; /* 8^3 midpoints: second order, error below 1e-3 of the peak */
            for (int s = 0; s < m * m * m; s++) {
                double x[3] = {c[0] + ((s % m + 0.5) / m - 0.5) / 32,
                               c[1] + ((s / m % m + 0.5) / m - 0.5) / 32,
                               c[2] + ((s / m / m + 0.5) / m - 0.5) / 32};
                flame_point(&p, x, e);
                for (int ch = 0; ch < 3; ch++)
                    want[ch] += e[ch] / (m * m * m);
            }
            for (int ch = 0; ch < 3; ch++)
                T_NEAR(v[idx * 3 + ch], want[ch], basis == 0 ? 1e-3 * peak : 3e-5 * peak);
        }
    }
    free(v);
}

/* Pictures through a window, against rays that are traced face by face. */
T_CASE(windows_are_looked_through)
{
    struct rec_rig rig;
    struct rec_flame f;
    struct rec_flame_pose p;
    enum { W = 80, H = 60 };
    static float img[W * H * 3];
    T_EQ_I(rec_rig_ring(1, 2.2, W, H, 16, &rig), PVX_OK);
    rec_flame_init(&f, &rig.grid, 3);
    rec_flame_at(&f, 0.4, &p);
    struct rec_camera *c = &rig.cameras[0];
    double centre[3], worst = 0, moved = 0;
    struct optics_plate plate = {.thickness = 0.1, .index = 1.5};
    memset(c->dist, 0, sizeof c->dist);
    rec_camera_centre(c, centre);
    for (int a = 0; a < 3; a++)
        plate.n[a] = 0.8 * c->R[6 + a] + 0.6 * c->R[a];
    plate.at = optics_dot(plate.n, centre) + 0.5;
    c->n_windows = 1;
    memcpy(c->window[0].normal, plate.n, sizeof plate.n);
    c->window[0].at = plate.at;
    c->window[0].thickness = plate.thickness;
    c->window[0].index = plate.index;
    rec_flame_render(&p, c, 1, 0, H, img);
    for (int i = 0; i < W * H; i++) {
        double x = (i % W - c->cx) / c->fx, y = (i / W - c->cy) / c->fy, o[3], d[3], rgb[3],
               bare[3];
        double length = sqrt(x * x + y * y + 1);
        for (int a = 0; a < 3; a++) {
            d[a] = (c->R[a] * x + c->R[3 + a] * y + c->R[6 + a]) / length;
            o[a] = centre[a];
        }
        rec_flame_ray(&p, o, d, bare);
        T_OK(optics_plates(&plate, 1, o, d));
        rec_flame_ray(&p, o, d, rgb);
        worst = fmax(worst, fabs(rgb[0] - (double)img[3 * i]));
        moved = fmax(moved, fabs(bare[0] - rgb[0]));
    }
    T_LE(worst, 1e-6);
    T_LE(0.05, moved);
    rec_rig_fini(&rig);
}
