/* test_spectral.c - recon/spectral: Planck's law against known values, curves from text, temperature and soot of a voxel
 * with their bars, what is not soot. */
#include <string.h>

#include "recon/spectral/known.h"
#include "recon/spectral/misfit.h"
#include "recon/spectral/shade.h"
#include "tests/lib/curves.h"
#include "tests/lib/normal.h"
#include "tests/t.h"

/* ---- Planck ------------------------------------------------------------------------------------- */

T_CASE(planck_has_its_peak_and_its_sum)
{
    const double T = 1800, pi = acos(-1), all = 5.670374419e-8 * pow(T, 4) / pi;
    /* Wien's displacement: l T = 2.897771955e-3 m K */
    double at = 2.897771955e-3 / T, peak = rec_planck(at, T), sum = 0;
    T_OK(peak > rec_planck(at * 1.001, T) && peak > rec_planck(at * 0.999, T));
    /* Stefan and Boltzmann's sum, and the shares of it below l T = 2000 and 3000 um K in tables of black bodies
     * (0.066728, 0.273232) */
    for (int i = 0; i < 20000; i++) {
        double l = 2e-7 * exp((i + 0.5) * 9e-4);
        double before = sum;
        sum += rec_planck(l, T) * l * 9e-4;
        if (before / all < 0.0667 && sum / all >= 0.0667)
            T_NEAR(l * T, 2000e-6, 1e-6);
        if (before / all < 0.273232 && sum / all >= 0.273232)
            T_NEAR(l * T, 3000e-6, 2e-6);
    }
    T_NEAR(sum / all, 1, 1e-5);
    T_OK(isfinite(rec_planck(2e-7, 200)) && rec_planck(2e-7, 200) > 0);
}

T_CASE(an_integral_over_a_box_is_exact)
{
    struct rec_spectral s = {.n = 2, .from = 500, .step = 40};
    double sum = 0, slope, h = 1e-6;
    s.response[1][0] = s.response[1][1] = 1;
    for (int i = 0; i < 40000; i++)
        sum += rec_planck((500 + (i + 0.5) * 1e-3) * 1e-9, 2000) * 1e-12;
    T_NEAR(rec_planck_channel(&s, 1, 2000, NULL, NULL, &slope) / sum, 1, 1e-8);
    double above = rec_planck_channel(&s, 1, 1 / (1 / 2000.0 + h), NULL, NULL, NULL);
    double below = rec_planck_channel(&s, 1, 1 / (1 / 2000.0 - h), NULL, NULL, NULL);
    T_NEAR(slope / ((above - below) / (2 * h)), 1, 1e-3);
}

/* ---- curves ------------------------------------------------------------------------------------- */

static struct rec_curve curve;

static pvx_err curve_of(const char *text, int columns, struct pvx_diag *d)
{
    d->text[0] = '\0';
    return rec_curve_parse(text, strlen(text), "c.csv", columns, &curve, d);
}

T_CASE(curves_are_read)
{
    struct pvx_diag d;
    T_EQ_I(curve_of("nm,r,g,b\n# a camera\n400, 0,0.5;1\r\n\n420\t1 0.25,0\n", 3, &d), PVX_OK);
    T_EQ_I(curve.n, 2);
    T_NEAR(rec_curve_at(&curve, 0, 410, 7), 0.5, 1e-12);
    T_NEAR(rec_curve_at(&curve, 1, 415, 7), 0.3125, 1e-12);
    T_NEAR(rec_curve_at(&curve, 1, 421, 7), 7, 0);
    T_OK(rec_curve_covers(&curve, 400, 420) && !rec_curve_covers(&curve, 399, 420));
}

T_CASE(curves_are_refused_by_line)
{
    static const struct {
        const char *text, *part;
        int columns;
    } bad[] = {
        {"400,1,1,1\n390,1,1,1\n", "c.csv:2: wavelength 390 nm does not follow", 3},
        {"400,1,1,1\n500,1,1,1\n", "c.csv:2: wavelength 500 nm does not follow", 3},
        {"0.4,1,1,1\n", "c.csv:1: wavelength 0.4 is outside 200..2000; it should be in nanometres",
         3},
        {"nm,r\n400,1\n410,1.5\n", "c.csv:3: value 1.5 is outside 0..1", 1},
        {"400,1,1,1\n410,1,-1,1\n", "c.csv:2: value -1 is outside", 3},
        {"400,1,1,1\n410,1,1\n", "c.csv:2: should be four numbers", 3},
        {"400,1,1,1\n410,nan,1,1\n", "c.csv:2: should be four numbers", 3},
        {"a,b,c,d\ne,f\n", "c.csv:2: should be four numbers", 3},
        {"400,1\n", "c.csv: 1 wavelengths", 1},
        {"", "c.csv: 0 wavelengths", 3},
    };
    struct pvx_diag d;
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        T_OK(curve_of(bad[i].text, bad[i].columns, &d) != PVX_OK);
        T_CONTAINS(d.text, bad[i].part);
    }
}

T_CASE(a_response_behind_a_filter)
{
    struct rec_spectral s = {0}, t = {0};
    static struct rec_curve filter;
    struct pvx_diag d = {""};
    T_EQ_I(curve_of("400,1\n560,1\n561,0\n800,0\n", 1, &d), PVX_EINVAL); /* 239 nm apart */
    T_EQ_I(curve_of("400,1\n450,1\n500,1\n550,0.5\n600,0.5\n650,0\n700,0\n750,0\n", 1, &d), PVX_OK);
    filter = curve;
    T_EQ_I(curve_of("400,0,0,1\n450,0,1,2\n500,0,4,0\n550,4,0,0\n600,2,0,0\n", 3, &d), PVX_OK);
    T_EQ_I(rec_curve_response(&curve, &filter, false, &s, &d), PVX_OK);
    T_EQ_I(s.n, 41);
    T_NEAR(s.step, 5, 1e-12);
    T_NEAR(s.response[1][20], 1, 1e-12);   /* 500 nm */
    T_NEAR(s.response[0][30], 0.5, 1e-12); /* 550 nm, behind the filter */
    T_EQ_I(rec_curve_response(&curve, &filter, true, &t, &d), PVX_OK);
    T_NEAR(t.response[0][30] / t.response[1][20], s.response[0][30] * 550 / 500, 1e-12);
    T_EQ_I(curve_of("500,1\n540,1\n", 1, &d), PVX_OK);
    struct rec_curve narrow = curve;
    T_EQ_I(curve_of("400,0,0,1\n450,0,1,2\n500,0,4,0\n550,4,0,0\n600,2,0,0\n", 3, &d), PVX_OK);
    T_EQ_I(rec_curve_response(&curve, &narrow, false, &s, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "the filter is known from 500 to 540 nm");
    d.text[0] = '\0';
    T_EQ_I(curve_of("400,0,1,1\n450,0,1,2\n", 3, &d), PVX_OK);
    T_EQ_I(rec_curve_response(&curve, NULL, false, &s, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "the red channel sees nothing");
}

/* ---- the table ---------------------------------------------------------------------------------- */

static rec_soot *soot_of(const struct rec_spectral *s)
{
    struct pvx_diag d = {""};
    rec_soot *m = NULL;
    T_EQ_I(rec_soot_new(s, &rec_soot_defaults, &m, &d), PVX_OK);
    T_EQ_S(d.text, "");
    return m;
}

static double kappa(const void *ctx, double metres)
{
    (void)ctx;
    return 6 * acos(-1) * REC_SOOT_EM / metres;
}

T_CASE(the_table_is_the_integral)
{
    for (int c = 0; c < CURVES; c++) {
        struct rec_spectral s;
        double worst = 0, last[3] = {0};
        curves_camera(c, &s);
        rec_soot *m = soot_of(&s);
        for (double T = 801; T < 3200; T += 7.3) {
            double g[3];
            rec_soot_emission(m, T, g);
            for (int q = 0; q < 3; q++) {
                double want = s.constant[q] * rec_planck_channel(&s, q, T, kappa, NULL, NULL);
                worst = fmax(worst, fabs(g[q] / want - 1));
                T_OK(g[q] > last[q]);
                last[q] = g[q];
            }
        }
        T_LE(worst, 2e-6);
        rec_soot_free(&m);
    }
}

T_CASE(responses_that_say_no_temperature_are_refused)
{
    struct rec_spectral s;
    struct pvx_diag d = {""};
    rec_soot *m;
    curves_camera(1, &s);
    memcpy(s.response[0], s.response[1], sizeof s.response[0]);
    memcpy(s.response[2], s.response[1], sizeof s.response[0]);
    T_EQ_I(rec_soot_new(&s, &rec_soot_defaults, &m, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "see nearly the same wavelengths");
    T_OK(m == NULL);
    struct rec_soot_params p = rec_soot_defaults;
    p.em = 0;
    d.text[0] = '\0';
    T_EQ_I(rec_soot_new(&s, &p, &m, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "E(m) 0 is outside");
}

/* ---- a voxel ------------------------------------------------------------------------------------ */

static void diagonal(const double sd[3], double N[9])
{
    memset(N, 0, 9 * sizeof *N);
    for (int q = 0; q < 3; q++)
        N[4 * q] = sd[q] * sd[q];
}

/* Emission of soot, by the integral and not by the table. */
static void soot_light(const struct rec_spectral *s, double T, double f, double e[3])
{
    for (int q = 0; q < 3; q++)
        e[q] = f * s->constant[q] * rec_planck_channel(s, q, T, kappa, NULL, NULL);
}

T_CASE(temperature_there_and_back)
{
    for (int c = 0; c < CURVES; c++) {
        struct rec_spectral s;
        curves_camera(c, &s);
        rec_soot *m = soot_of(&s);
        for (double T = 1000; T <= 2500; T += 50)
            for (double f = 1e-9; f < 1e-4; f *= 10) {
                double e[3], N[9], sd[3];
                soot_light(&s, T, f, e);
                for (int q = 0; q < 3; q++)
                    sd[q] = 1e-4 * e[q];
                diagonal(sd, N);
                struct rec_soot_voxel v = rec_soot_solve(m, e, N);
                T_EQ_I(v.state, REC_SOOT_OK);
                T_NEAR(v.kelvin, T, 0.02);
                T_NEAR(v.f / f, 1, 2e-4);
                T_OK(v.chi2 < 1e-3 && v.kelvin_sd > 0 && v.f_sd > 0);
            }
        rec_soot_free(&m);
    }
}

/* Share of voxels whose T and f lie within two bars, in `hold`; noise `noise` of the blue channel's light, which is the
 * weakest, in all channels. */
static void coverage(const struct rec_spectral *s, double noise, double miss, double hold[2])
{
    enum { MANY = 20000 };
    rec_soot *m = soot_of(s);
    int known = 0, held_t = 0, held_f = 0;
    for (int i = 0; i < MANY; i++) {
        double e[3], N[9], sd[3], T = t_uniform(1500, 2100), f = 1e-6;
        struct rec_spectral is = *s; /* what the calibration missed by, another each time */
        for (int q = 0; q < 3; q++)
            is.constant[q] *= exp(miss * t_normal());
        soot_light(&is, T, f, e);
        double weakest = fmin(e[0], fmin(e[1], e[2]));
        for (int q = 0; q < 3; q++) {
            sd[q] = noise * weakest;
            e[q] += sd[q] * t_normal();
        }
        diagonal(sd, N);
        struct rec_soot_voxel v = rec_soot_solve(m, e, N);
        known += v.state == REC_SOOT_OK;
        held_t += v.state == REC_SOOT_OK && fabs(v.kelvin - T) < 2 * v.kelvin_sd;
        held_f += v.state == REC_SOOT_OK && fabs(v.f - f) < 2 * v.f_sd;
    }
    T_OK(known > (noise < 0.1 ? 0.99 : 0.7) * MANY);
    hold[0] = (double)held_t / known;
    hold[1] = (double)held_f / known;
    rec_soot_free(&m);
}

T_CASE(two_bars_hold_95_of_100)
{
    for (int c = 0; c < CURVES; c++) {
        struct rec_spectral s;
        double hold[2];
        curves_camera(c, &s);
        coverage(&s, 1.0 / 20, 0, hold);
        T_NEAR(hold[0], 0.955, 0.012);
        T_NEAR(hold[1], 0.95, 0.02);
        coverage(&s, 1.0 / 5, 0, hold);
        T_NEAR(hold[0], 0.955, 0.015);
        T_NEAR(hold[1], 0.93, 0.025); /* f is off by up to a half: its own bar is uncertain */
        memset(s.covariance, 0, sizeof s.covariance);
        for (int q = 0; q < 3; q++)
            s.covariance[4 * q] = 0.02 * 0.02;
        coverage(&s, 1.0 / 200, 0.02, hold);
        T_NEAR(hold[0], 0.955, 0.012);
        T_NEAR(hold[1], 0.95, 0.02);
    }
}

/* a' N a + b' C b, and what each channel is doubted by itself. */
static double spread_of(const double a[3], const double b[3], const double N[9], const double C[9])
{
    double var = 0;
    for (int p = 0; p < 3; p++) {
        for (int q = 0; q < 3; q++)
            var += a[p] * N[3 * p + q] * a[q] + b[p] * C[3 * p + q] * b[q];
        var += b[p] * b[p] * REC_SOOT_OWN * REC_SOOT_OWN;
    }
    return var;
}

/* The derivatives are those of small steps of e and of the constants, and the bars follow from them. */
T_CASE(derivatives_by_light_and_calibration)
{
    for (int c = 0; c < CURVES; c++) {
        struct rec_spectral s;
        curves_camera(c, &s);
        for (int q = 0; q < 9; q++)
            s.covariance[q] = q % 4 == 0 ? 4e-6 : 3e-6;
        rec_soot *m = soot_of(&s);
        double e[3], N[9];
        soot_light(&s, 1650, 2e-6, e);
        e[1] *= 1.004;
        for (int p = 0; p < 3; p++)
            for (int q = 0; q < 3; q++)
                N[3 * p + q] = (p == q ? 1 : 0.8) * 4e-5 * e[p] * e[q];
        struct rec_soot_voxel v = rec_soot_solve(m, e, N);
        T_EQ_I(v.state, REC_SOOT_OK);
        T_NEAR(sqrt(spread_of(v.kelvin_by_e, v.kelvin_by_k, N, s.covariance)) / v.kelvin_sd, 1,
               1e-6);
        T_NEAR(sqrt(spread_of(v.f_by_e, v.f_by_k, N, s.covariance)) / v.f_sd, 1, 1e-6);
        T_NEAR(v.misfit * v.misfit / spread_of(v.misfit_by_e, v.misfit_by_k, N, s.covariance) /
                   v.chi2,
               1, 0.02); /* V is taken at the fit before the last */
        T_NEAR(v.misfit, 0.004, 4e-4);
        for (int q = 0; q < 3; q++) {
            double more[3] = {e[0], e[1], e[2]}, step = 1e-4;
            struct rec_spectral off = s;
            more[q] *= 1 + step;
            struct rec_soot_voxel u = rec_soot_solve(m, more, N);
            T_NEAR((u.kelvin - v.kelvin) / step / e[q], v.kelvin_by_e[q],
                   0.03 * fabs(v.kelvin_by_e[q]) + 0.2 / e[q]);
            T_NEAR((u.f - v.f) / step / e[q], v.f_by_e[q],
                   0.04 * fabs(v.f_by_e[q]) + 2e-3 * v.f / e[q]);
            T_NEAR((u.misfit - v.misfit) / step / e[q], v.misfit_by_e[q], 0.03 / e[q]);
            off.constant[q] *= 1 + step;
            rec_soot *k = soot_of(&off);
            u = rec_soot_solve(k, e, N);
            T_NEAR((u.kelvin - v.kelvin) / step, v.kelvin_by_k[q],
                   0.03 * fabs(v.kelvin_by_k[q]) + 0.2);
            T_NEAR((u.misfit - v.misfit) / step, v.misfit_by_k[q], 0.03);
            rec_soot_free(&k);
        }
        rec_soot_free(&m);
    }
}

/* ---- many voxels -------------------------------------------------------------------------------- */

enum { CLOUD = 300, CLOUD_MODES = 3, DRAWS = 400 };
struct cloud {
    float modes[CLOUD_MODES][CLOUD][3];
    double e[CLOUD][3], N[CLOUD][9], own[CLOUD];
};

/* Soot of 1500 to 1900 K, whose noise is mostly common to all voxels. */
static void cloud_make(const struct rec_spectral *s, struct cloud *c)
{
    memset(c, 0, sizeof *c);
    for (int i = 0; i < CLOUD; i++) {
        soot_light(s, 1500 + 400.0 * i / CLOUD, 1e-6, c->e[i]);
        c->own[i] = 0.01 * c->e[i][2];
        for (int k = 0; k < CLOUD_MODES; k++)
            for (int q = 0; q < 3; q++)
                c->modes[k][i][q] =
                    (float)(0.01 * c->e[i][q] * (k == q ? 1 : 0.3) * sin(1 + k + 3.0 * i / CLOUD));
        for (int p = 0; p < 3; p++)
            for (int q = 0; q < 3; q++) {
                c->N[i][3 * p + q] = p == q ? c->own[i] * c->own[i] : 0;
                for (int k = 0; k < CLOUD_MODES; k++)
                    c->N[i][3 * p + q] += (double)c->modes[k][i][p] * (double)c->modes[k][i][q];
            }
    }
}

/* One draw of the light of voxel i: z of the modes, and noise of its own. */
static void cloud_draw(const struct cloud *c, int i, const double z[CLOUD_MODES], double e[3])
{
    for (int q = 0; q < 3; q++) {
        e[q] = c->e[i][q] + c->own[i] * t_normal();
        for (int k = 0; k < CLOUD_MODES; k++)
            e[q] += z[k] * (double)c->modes[k][i][q];
    }
}

/* What the file of temperatures has makes the bar of a mean, and the mean misfit its deviation. */
T_CASE(bars_of_means_are_those_of_many_draws)
{
    static struct cloud c;
    static struct rec_misfit_part part;
    struct rec_spectral s;
    struct rec_misfit m = {0, 0, 0};
    double L[9], var = 0, predicted, misfit, mean[2] = {0, 0}, square[2] = {0, 0};
    curves_camera(1, &s);
    for (int q = 0; q < 9; q++)
        s.covariance[q] = q % 4 == 0 ? 9e-5 : 5e-5;
    rec_misfit_calibration(s.covariance, L);
    cloud_make(&s, &c);
    struct rec_soot_params all = rec_soot_defaults;
    rec_soot *soot;
    all.reject = 1e6; /* errors in common would refuse all voxels of some draws */
    T_EQ_I(rec_soot_new(&s, &all, &soot, NULL), PVX_OK);
    double sums[CLOUD_MODES + 3] = {0};
    for (int i = 0; i < CLOUD; i++) {
        struct rec_soot_voxel v = rec_soot_solve(soot, c.e[i], c.N[i]);
        const struct rec_misfit_modes modes = {CLOUD_MODES, (size_t)CLOUD * 3, c.modes[0][i], NULL};
        double left = v.kelvin_sd * v.kelvin_sd;
        T_EQ_I(v.state, REC_SOOT_OK);
        rec_misfit_add(&part, &v, c.N[i], &modes);
        for (int k = 0; k < CLOUD_MODES + 3; k++) {
            double d = 0;
            for (int q = 0; q < 3; q++)
                d += k < 3 ? v.kelvin_by_k[q] * L[3 * q + k]
                           : v.kelvin_by_e[q] * (double)c.modes[k - 3][i][q];
            sums[k] += d / CLOUD;
            left -= d * d;
        }
        T_OK(left > 0);
        var += left / CLOUD / CLOUD;
    }
    for (int k = 0; k < CLOUD_MODES + 3; k++)
        var += sums[k] * sums[k];
    rec_misfit_volume(&part, 1, CLOUD_MODES, L, &m);
    rec_misfit_mean(&m, &misfit, &predicted);
    T_OK(fabs(misfit) < 1e-5 && predicted > 0);
    for (int n = 0; n < DRAWS; n++) {
        double z[CLOUD_MODES], off[3], k[3] = {t_normal(), t_normal(), t_normal()};
        double kelvin = 0, lean, lean_sd;
        static struct rec_misfit_part one;
        struct rec_misfit drawn = {0, 0, 0};
        memset(&one, 0, sizeof one);
        for (int q = 0; q < CLOUD_MODES; q++)
            z[q] = t_normal();
        for (int q = 0; q < 3; q++)
            off[q] = exp(L[3 * q] * k[0] + L[3 * q + 1] * k[1] + L[3 * q + 2] * k[2]);
        for (int i = 0; i < CLOUD; i++) {
            double e[3];
            cloud_draw(&c, i, z, e);
            for (int q = 0; q < 3; q++)
                e[q] *= off[q];
            struct rec_soot_voxel v = rec_soot_solve(soot, e, c.N[i]);
            const struct rec_misfit_modes modes = {CLOUD_MODES, (size_t)CLOUD * 3, c.modes[0][i],
                                                   NULL};
            rec_misfit_add(&one, &v, c.N[i], &modes);
            T_EQ_I(v.state, REC_SOOT_OK);
            kelvin += v.kelvin / CLOUD;
        }
        rec_misfit_volume(&one, 1, CLOUD_MODES, L, &drawn);
        rec_misfit_mean(&drawn, &lean, &lean_sd);
        const double x[2] = {kelvin, lean};
        for (int q = 0; q < 2; q++) {
            mean[q] += x[q] / DRAWS;
            square[q] += x[q] * x[q] / DRAWS;
        }
    }
    const double sd[2] = {sqrt(square[0] - mean[0] * mean[0]), sqrt(square[1] - mean[1] * mean[1])};
    T_NEAR(sd[0] / sqrt(var), 1, 0.14); /* four deviations of a deviation of 400 draws */
    T_NEAR(sd[1] / predicted, 1, 0.14);
    rec_soot_free(&soot);
}

T_CASE(a_blue_flame_is_not_soot)
{
    for (int c = 0; c < CURVES; c++) {
        struct rec_spectral s;
        double e[3], N[9], sd[3];
        int not_soot = 0;
        curves_camera(c, &s);
        rec_soot *m = soot_of(&s);
        for (int i = 0; i < 2000; i++) {
            curves_blue_flame(&s, e);
            double noise = t_uniform(0.01, 0.05) * fmax(e[0], fmax(e[1], e[2]));
            for (int q = 0; q < 3; q++) {
                sd[q] = noise;
                e[q] += noise * t_normal();
            }
            diagonal(sd, N);
            struct rec_soot_voxel v = rec_soot_solve(m, e, N);
            T_OK(v.state != REC_SOOT_OK && isnan(v.kelvin) && isnan(v.f));
            not_soot += v.state == REC_SOOT_NOT;
        }
        T_OK(not_soot > 1900);
        rec_soot_free(&m);
    }
}

T_CASE(a_wrong_response_shows_in_the_residual)
{
    for (int c = 0; c < CURVES; c++) {
        struct rec_spectral is, other;
        double e[3], N[9], sd[3];
        curves_camera(c, &is);
        curves_camera((c + 1) % CURVES, &other);
        for (int q = 0; q < 3; q++) /* both calibrated by a source of 2500 K */
            other.constant[q] = is.constant[q] *
                                rec_planck_channel(&is, q, 2500, NULL, NULL, NULL) /
                                rec_planck_channel(&other, q, 2500, NULL, NULL, NULL);
        rec_soot *m = soot_of(&other), *right = soot_of(&is);
        soot_light(&is, 1600, 1e-6, e);
        for (int q = 0; q < 3; q++)
            sd[q] = 0.005 * e[q];
        diagonal(sd, N);
        T_OK(rec_soot_solve(right, e, N).chi2 < 1);
        T_OK(rec_soot_solve(m, e, N).chi2 > REC_SOOT_REJECT);
        rec_soot_free(&m);
        rec_soot_free(&right);
    }
}

T_CASE(too_little_light_is_no_number)
{
    struct rec_spectral s;
    curves_camera(0, &s);
    rec_soot *m = soot_of(&s);
    for (int i = 0; i < 5000; i++) {
        double e[3], N[9], sd[3] = {1, 1, 1};
        for (int q = 0; q < 3; q++)
            e[q] = t_normal();
        diagonal(sd, N);
        struct rec_soot_voxel v = rec_soot_solve(m, e, N);
        T_OK(v.state == REC_SOOT_DARK && isnan(v.kelvin) && isnan(v.f) && isnan(v.kelvin_sd));
    }
    const double hard[][3] = {{0, 0, 0},         {-1, -1, -1},        {NAN, 1, 1},
                              {INFINITY, 1, 1},  {1e-300, 1e-301, 0}, {1e300, 1e299, 1},
                              {1, -1e30, 1e-30}, {5e-324, 0, 0}};
    for (size_t k = 0; k < sizeof hard / sizeof *hard; k++)
        for (double sd1 = 1e-200; sd1 < 1e200; sd1 *= 1e10) {
            double N[9], sd[3] = {sd1, sd1, sd1};
            diagonal(sd, N);
            struct rec_soot_voxel v = rec_soot_solve(m, hard[k], N);
            if (v.state == REC_SOOT_OK)
                T_OK(isfinite(v.kelvin) && isfinite(v.kelvin_sd) && isfinite(v.f) &&
                     isfinite(v.f_sd));
            else
                T_OK(isnan(v.kelvin) && isnan(v.f));
            T_OK(!isinf(v.chi2));
        }
    rec_soot_free(&m);
}

T_CASE(a_relative_calibration_says_no_amount)
{
    struct rec_spectral s;
    double e[3], N[9], sd[3] = {1e-3, 1e-3, 1e-3};
    curves_camera(2, &s);
    s.absolute = false;
    rec_soot *m = soot_of(&s);
    soot_light(&s, 1700, 1e-6, e);
    diagonal(sd, N);
    struct rec_soot_voxel v = rec_soot_solve(m, e, N);
    T_EQ_I(v.state, REC_SOOT_OK);
    T_NEAR(v.kelvin, 1700, 1);
    T_OK(isnan(v.f) && isnan(v.f_sd));
    rec_soot_free(&m);
}

/* ---- the constants ------------------------------------------------------------------------------ */

static double grey_body(const void *ctx, double metres)
{
    return *(const double *)ctx * (1 - 0.1 * (metres / 550e-9 - 1)); /* about that of tungsten */
}

static void lamp(const struct rec_spectral *s, double T, double emissivity, struct rec_known *k)
{
    k->kelvin = T;
    for (int q = 0; q < 3; q++) {
        k->value[q] = s->constant[q] * rec_planck_channel(s, q, T, grey_body, &emissivity, NULL);
        k->sd[q] = 1e-3 * k->value[q];
    }
}

T_CASE(constants_from_a_lamp)
{
    struct rec_spectral s, got;
    struct rec_known k[3];
    struct pvx_diag d = {""};
    const struct rec_known_doubt doubt = {10, 0.02, 0.01};
    double scatter, e = 0.45;
    curves_camera(1, &s);
    for (int i = 0; i < 3; i++)
        lamp(&s, 2000 + 300 * i, e, &k[i]);
    got = s;
    got.absolute = false;
    T_EQ_I(rec_known_source(&(struct rec_known_source){k, 3, grey_body, &e}, &doubt, &got, &scatter,
                            &d),
           PVX_OK);
    T_LE(scatter, 1e-6);
    T_OK(got.absolute);
    for (int q = 0; q < 3; q++)
        T_NEAR(got.constant[q] / s.constant[q], 1, 1e-9);
    /* the thermometer's error, by shifting it */
    struct rec_spectral off = s;
    for (int i = 0; i < 3; i++)
        k[i].kelvin += 10;
    T_EQ_I(rec_known_source(&(struct rec_known_source){k, 3, grey_body, &e}, &doubt, &off, &scatter,
                            &d),
           PVX_OK);
    for (int q = 0; q < 3; q++) {
        double shift = log(off.constant[q] / s.constant[q]);
        double want = shift * shift + 0.02 * 0.02 + 0.01 * 0.01 + 1e-6 / 3;
        T_NEAR(got.covariance[4 * q] / want, 1, 0.05);
    }
    T_OK(got.covariance[1] > 0.02 * 0.02 && got.covariance[1] == got.covariance[3]);
}

T_CASE(lamps_that_contradict_each_other)
{
    struct rec_spectral s, other;
    struct rec_known k[2];
    struct pvx_diag d = {""};
    const struct rec_known_doubt doubt = {10, 0.02, 0.01};
    double scatter, e = 0.45;
    curves_camera(1, &s);
    lamp(&s, 1800, e, &k[0]);
    lamp(&s, 2600, e, &k[1]);
    other = s; /* a response that ends 40 nm earlier: infrared that it does not know of */
    for (int i = 0; i < s.n; i++)
        other.response[0][i] = i + 8 < s.n ? s.response[0][i + 8] : 0;
    T_EQ_I(rec_known_source(&(struct rec_known_source){k, 2, grey_body, &e}, &doubt, &other,
                            &scatter, &d),
           PVX_EINVAL);
    T_CONTAINS(d.text, "differ by");
    d.text[0] = '\0';
    k[0].kelvin = 25;
    T_EQ_I(
        rec_known_source(&(struct rec_known_source){k, 2, grey_body, &e}, &doubt, &s, &scatter, &d),
        PVX_EINVAL);
    T_CONTAINS(d.text, "25 K is outside");
    d.text[0] = '\0';
    k[0].kelvin = 1800;
    k[0].sd[2] = k[0].value[2];
    T_EQ_I(
        rec_known_source(&(struct rec_known_source){k, 2, grey_body, &e}, &doubt, &s, &scatter, &d),
        PVX_EINVAL);
    T_CONTAINS(d.text, "the blue channel sees");
}

T_CASE(constants_from_a_thermocouple)
{
    struct rec_spectral s, got;
    struct rec_known k = {.kelvin = 1650};
    struct pvx_diag d = {""};
    const struct rec_known_doubt doubt = {15, 0, 0.01};
    double e[3], N[9], sd[3];
    curves_camera(0, &s);
    soot_light(&s, 1650, 3e-6, k.value);
    for (int q = 0; q < 3; q++)
        k.sd[q] = 1e-3 * k.value[q];
    got = s;
    T_EQ_I(rec_known_soot(&k, &rec_soot_defaults, &doubt, &got, &d), PVX_OK);
    T_OK(!got.absolute);
    T_NEAR(got.constant[0] / s.constant[0], 3, 1e-6); /* 3 ppm were taken for 1 */
    rec_soot *m = soot_of(&got);
    soot_light(&s, 1900, 1e-6, e);
    for (int q = 0; q < 3; q++)
        sd[q] = 1e-3 * e[q];
    diagonal(sd, N);
    struct rec_soot_voxel v = rec_soot_solve(m, e, N);
    T_EQ_I(v.state, REC_SOOT_OK);
    T_NEAR(v.kelvin, 1900, 1);
    T_OK(v.kelvin_sd > 15 && v.kelvin_sd < 40); /* the thermocouple's, a little more at another T */
    rec_soot_free(&m);
}

/* ---- self-absorption ---------------------------------------------------------------------------- */

T_CASE(an_even_cloud_shades_by_its_depth)
{
    enum { N = 20 };
    static float f[N * N * N];
    struct rec_rig rig;
    const double k[3] = {1e6, 2e6, 3e6};
    double tau[3], want[3] = {0};
    struct rec_shade s;
    T_EQ_I(rec_rig_ring(6, 4, 64, 48, N, &rig), PVX_OK);
    for (size_t i = 0; i < N * N * N; i++)
        f[i] = 1e-6F;
    rec_shade_init(&s, &rig, &rig.grid, k);
    int32_t middle = (N / 2 * N + N / 2) * N + N / 2;
    rec_shade_at(&s, f, middle, tau);
    for (size_t c = 0; c < rig.n_cameras;
         c++) { /* to the border of the box, half a metre away and more */
        double at[3], x[3] = {0.025, 0.025, 0.525}, length = 0, way = 1e9;
        rec_camera_centre(&rig.cameras[c], at);
        for (int a = 0; a < 3; a++)
            length += (at[a] - x[a]) * (at[a] - x[a]);
        for (int a = 0; a < 3; a++) {
            double d = (at[a] - x[a]) / sqrt(length);
            way = fmin(way, ((d > 0 ? rig.grid.max[a] : rig.grid.min[a]) - x[a]) / d);
        }
        for (int q = 0; q < 3; q++)
            want[q] += exp(-k[q] * 1e-6 * way) / (double)rig.n_cameras;
    }
    for (int q = 0; q < 3; q++)
        T_NEAR(tau[q], want[q], 0.02); /* the last half voxel falls to 0 */
    memset(f, 0, sizeof f);
    rec_shade_at(&s, f, middle, tau);
    T_NEAR(tau[2], 1, 1e-12);
    rec_rig_fini(&rig);
}
