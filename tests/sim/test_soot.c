/* test_soot.c - a flame of soot through pictures, solver, error bars and temperature: truth comes out within the bars, with and
 * without self-absorption; a blue flame and another camera's curves do not; an Abel inversion of the same flame agrees. */
#include "base/median.h"
#include "tests/bench/soot.h"
#include "tests/t.h"

static struct {
    struct rec_rig rig;
    rec_sysmat *S;
    pvx_pool *pool;
    rec_bars *bars;
    rec_frame *frame;
    struct soot_cameras k;
    struct soot_pictures p;
    struct rec_sparse v;
    struct rec_bars_view view;
} b;
static const struct soot_flame flame = {at_round, true, 0.3e-6};

/* The flame's pictures `way`, solved. */
static void solve(int way)
{
    bench_seed(7);
    soot_expose(b.frame, &b.p, way, 1, 12);
    rec_frame_carve(b.frame);
    T_EQ_I(rec_frame_solve(b.frame, 0, NULL), PVX_OK);
    T_EQ_I(rec_frame_bars(b.frame, b.bars, 1, &b.view), PVX_OK);
    rec_frame_volume(b.frame, &b.v);
}

static void begin(void)
{
    struct scene s;
    struct rec_frame_params fp = rec_frame_defaults;
    double scale[CURVES];
    CHECK(pvx_pool_new(2, "soot", &b.pool));
    scene_views(&s, &views_8, 120, 90, 48);
    s.rig.grid.basis = REC_TRILINEAR;
    b.rig = s.rig;
    b.S = scene_matrix(&s, 0, b.pool);
    CHECK(rec_bars_new(b.S, 3, 8, &b.bars, NULL));
    soot_cameras_new(&b.k, NULL);
    soot_shoot(&b.p, &flame, &b.k, &b.rig, b.pool);
    for (int c = 0; c < CURVES; c++)
        scale[c] = PEAK / b.p.peak[2 * c];
    soot_cameras_free(&b.k);
    soot_cameras_new(&b.k, scale);
    for (int w = 0; w < SOOT_WAYS; w++) /* pictures are linear in the constants */
        for (size_t c = 0; c < b.p.n; c++)
            for (size_t i = 0; i < b.p.floats; i++)
                b.p.px[w][c][i] *= (float)scale[w / 2];
    fp.nch = 3;
    fp.photo.saturation = 1e30F;
    CHECK(rec_frame_alone(b.S, &b.rig, &fp, b.pool, &b.frame, NULL));
}

static void end(void)
{
    rec_frame_free(&b.frame);
    rec_bars_free(&b.bars);
    soot_pictures_free(&b.p);
    soot_cameras_free(&b.k);
    rec_sysmat_free(&b.S);
    rec_rig_fini(&b.rig);
    pvx_pool_free(&b.pool);
}

/* The class of 5 to 20 bars is large whatever the bars are like. */
static void good(const struct soot_score *s)
{
    T_OK(s->known[1] > 5000 && s->known[1] > 0.95 * (double)s->voxels[1]);
    T_LE(soot_quantile(s, 1, 0.5), 0.015);
    T_OK((double)s->held_t[1] > 0.93 * (double)s->known[1]);
    T_OK((double)s->held_f[1] > 0.93 * (double)s->known[1]);
    if (s->known[0] > 0)
        T_LE(soot_quantile(s, 0, 0.5), 0.01);
}

T_CASE(the_truth_comes_out)
{
    struct soot_score s;
    solve(0);
    soot_judge(&flame, b.k.m[0], &b.v, &b.view, NULL, &s);
    good(&s);
    soot_score_free(&s);
}

T_CASE(self_absorption_is_taken_out)
{
    struct soot_score s;
    struct rec_shade shade;
    double kappa[3];
    solve(1);
    soot_judge(&flame, b.k.m[0], &b.v, &b.view, NULL, &s);
    T_OK(s.mean[1] < -0.01); /* blue is absorbed more: it looks colder */
    soot_score_free(&s);
    rec_shade_kappa(&b.k.s[0], &rec_soot_defaults, kappa);
    rec_shade_init(&shade, &b.rig, &b.rig.grid, kappa);
    double *tau = soot_shade(b.k.m[0], &shade, &b.v, &b.view);
    soot_judge(&flame, b.k.m[0], &b.v, &b.view, tau, &s);
    good(&s);
    T_LE(fabs(s.mean[1]), 0.005);
    soot_score_free(&s);
    free(tau);
}

T_CASE(a_blue_flame_stays_without_a_temperature)
{
    double blue[3];
    curves_blue_flame(&b.k.s[0], blue);
    for (size_t c = 0; c < b.p.n; c++) /* the flame's shape in one colour, instead of camera 2 */
        for (size_t i = 0; i < b.p.floats; i++)
            b.p.px[4][c][i] =
                (float)(blue[i % 3] / fmax(blue[1], blue[2])) * b.p.px[0][c][i / 3 * 3 + 1];
    solve(4);
    size_t all = 0, soot = 0, not_soot = 0;
    for (int32_t i = 0; i < b.v.n; i++) {
        double e[3], N[9];
        soot_noise(&b.view, i, N);
        for (int q = 0; q < 3; q++)
            e[q] = (double)b.v.value[(size_t)i * (size_t)b.v.cs + (size_t)q];
        struct rec_soot_voxel r = rec_soot_solve(b.k.m[0], e, N);
        bool bright = e[2] > 10 * sqrt(N[8]);
        all += bright;
        not_soot += bright && r.state == REC_SOOT_NOT;
        soot += r.state == REC_SOOT_OK;
    }
    T_OK(all > 500 && (double)not_soot > 0.9 * (double)all);
    T_EQ_I(soot, 0);
}

/* Mean misfit over its deviation, by the curves of s. */
static double lean_of(const struct rec_spectral *s)
{
    rec_soot *m;
    double mean, z;
    T_EQ_I(rec_soot_new(s, &rec_soot_defaults, &m, NULL), PVX_OK);
    z = soot_lean(m, s->covariance, &b.v, &b.view, &mean);
    rec_soot_free(&m);
    return z;
}

/* Mean chi^2 of the clear voxels, by the bars, or as if each channel were known to `share` by itself. */
static double chi2_of(const rec_soot *m, double share)
{
    double sum = 0, n = 0;
    for (int32_t i = 0; i < b.v.n; i++) {
        double e[3], N[9];
        soot_noise(&b.view, i, N);
        for (int q = 0; q < 3; q++)
            e[q] = (double)b.v.value[(size_t)i * (size_t)b.v.cs + (size_t)q];
        if (!(e[2] > 8 * sqrt(N[8])))
            continue;
        for (int q = 0; q < 9 && share > 0; q++)
            N[q] = q % 4 == 0 ? share * share * e[q / 4] * e[q / 4] : 0;
        sum += rec_soot_solve(m, e, N).chi2;
        n++;
    }
    T_OK(n > 1000);
    return sum / n;
}

T_CASE(other_curves_show)
{
    struct rec_spectral other = b.k.s[1];
    rec_soot *m;
    solve(0);
    for (int q = 0; q < 3; q++) /* both calibrated by one lamp */
        other.constant[q] = b.k.s[0].constant[q] *
                            rec_planck_channel(&b.k.s[0], q, 2850, NULL, NULL, NULL) /
                            rec_planck_channel(&b.k.s[1], q, 2850, NULL, NULL, NULL);
    T_EQ_I(rec_soot_new(&other, &rec_soot_defaults, &m, NULL), PVX_OK);
    double right = chi2_of(b.k.m[0], 0), wrong = chi2_of(m, 0);
    T_LE(right, 1);
    T_OK(wrong > 1.5 * right);
    /* no voxel tells, all together do */
    T_LE(fabs(lean_of(&b.k.s[0])), REC_MISFIT_MOST);
    T_OK(fabs(lean_of(&other)) > REC_MISFIT_MOST);
    rec_soot_free(&m);
}

/* ---- an Abel inversion of the same flame -------------------------------------------------------- */

enum { SHELLS = 20 };
#define SHELL 0.018 /* m */

/* Emission of camera 0 in shells about the axis at height z, from line integrals at right angles to it with noise sd: onion
 * peeling from outside in. */
static void abel(double z, double sd, double e[SHELLS][3], double var[SHELLS])
{
    for (int i = SHELLS - 1; i >= 0; i--) {
        double y = (i + 0.5) * SHELL, P[3] = {0}, v = sd * sd;
        for (int k = -4000; k < 4000; k++) {
            double x[3] = {(k + 0.5) * 1e-4, y, z}, f, T, g[3];
            soot_flame_at(&flame, x, &f, &T);
            rec_soot_emission(b.k.m[0], T, g);
            for (int q = 0; q < 3; q++)
                P[q] += f * g[q] * 1e-4;
        }
        double inner = 0;
        for (int q = 0; q < 3; q++)
            P[q] += sd * bench_normal();
        for (int j = i; j < SHELLS; j++) {
            double outer = 2 * sqrt((j + 1) * (j + 1) * SHELL * SHELL - y * y);
            double chord = outer - inner;
            inner = outer;
            if (j > i) {
                for (int q = 0; q < 3; q++)
                    P[q] -= chord * e[j][q];
                v += chord * chord * var[j];
            }
        }
        double own = 2 * sqrt((i + 1) * (i + 1) * SHELL * SHELL - y * y);
        for (int q = 0; q < 3; q++)
            e[i][q] = P[q] / own;
        var[i] = v / (own * own);
    }
}

T_CASE(an_abel_inversion_agrees)
{
    double e[SHELLS][3], var[SHELLS], z = 0.5 + 0.5 / 48;
    size_t both = 0, agree = 0;
    bench_seed(3);
    abel(z, 0.0005, e, var);
    solve(0);
    for (int32_t i = 0; i < b.v.n; i++) {
        double x[3], here[3], N[9];
        grid_centre(&b.rig.grid, b.v.index[i], x);
        double r = hypot(x[0], x[1]);
        int shell = (int)(r / SHELL);
        if (fabs(x[2] - z) > 1e-6 || shell >= SHELLS || fabs(r / SHELL - shell - 0.5) > 0.25)
            continue;
        soot_noise(&b.view, i, N);
        for (int q = 0; q < 3; q++)
            here[q] = (double)b.v.value[(size_t)i * (size_t)b.v.cs + (size_t)q];
        struct rec_soot_voxel t = rec_soot_solve(b.k.m[0], here, N);
        const double own[9] = {[0] = var[shell], [4] = var[shell], [8] = var[shell]};
        struct rec_soot_voxel a = rec_soot_solve(b.k.m[0], e[shell], own);
        if (t.state != REC_SOOT_OK || a.state != REC_SOOT_OK)
            continue;
        both++;
        agree += fabs(t.kelvin - a.kelvin) < 2 * hypot(t.kelvin_sd, a.kelvin_sd);
    }
    T_OK(both > 200);
    T_OK((double)agree > 0.93 * (double)both);
}

int main(void)
{
    begin();
    t_run();
    end();
    return t_done();
}
