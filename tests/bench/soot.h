/* soot.h - flames of soot as three published cameras see them, and what the product makes of their pictures.
 *
 * Where soot is, and how much, is from the red emission of a flame of flames.h; 1 is `most` ppm.  Its temperature is a field of
 * its own, smooth over some ten voxels, or belongs to the flame: hotter where it is whiter, across a front too.  Line
 * integrals are midpoint sums in steps of a quarter of a 64th; a channel is absorbed by Beer's law at its own mean
 * wavelength, between each place and the camera. */
#ifndef BENCH_SOOT_H
#define BENCH_SOOT_H
#include "shot.h"
#include "recon/frame/bars.h"
#include "recon/spectral/misfit.h"
#include "recon/spectral/shade.h"
#include "tests/lib/curves.h"

enum { SOOT_WAYS = 2 * CURVES }; /* camera k: 2 k without absorption, 2 k + 1 with it */

struct soot_flame {
    void (*at)(const double x[3], double out[3]);
    bool own;    /* the temperature belongs to the flame */
    double most; /* volume fraction */
};

static inline void soot_flame_at(const struct soot_flame *s, const double x[3], double *f,
                                 double *kelvin)
{
    double v[3];
    s->at(x, v);
    *f = s->most * v[0];
    *kelvin = s->own ? 1450 + 500 * fmin(v[1] / (v[0] + 1e-9), 1)
                     : 1700 + 200 * sin(6 * x[0] + 1) * cos(5 * x[1]) + 150 * sin(7 * x[2]);
}

/* An axisymmetric flame: a sheet about a cold core, hottest outside. */
static inline void at_round(const double x[3], double out[3])
{
    double r = hypot(x[0], x[1]), d = (r - 0.14) / 0.06;
    out[0] = exp(-0.5 * d * d) * window(x[2], -0.2, 1.2);
    out[1] = out[0] * fmin(1, 0.2 + 1.6 * r);
    out[2] = 0;
}

struct soot_cameras {
    struct rec_spectral s[CURVES];
    rec_soot *m[CURVES];
    double kappa[CURVES][3]; /* over f, 1/m */
};

/* Constants that make the largest value of the pictures PEAK: scale [CURVES]. */
static inline void soot_cameras_new(struct soot_cameras *k, const double *scale)
{
    for (int c = 0; c < CURVES; c++) {
        curves_camera(c, &k->s[c]);
        for (int q = 0; q < 3; q++) {
            double slope, i = rec_planck_channel(&k->s[c], q, 1700, NULL, NULL, &slope);
            k->s[c].constant[q] *= scale != NULL ? scale[c] : 1;
            k->kappa[c][q] = rec_soot_kappa(&rec_soot_defaults, REC_PLANCK_C2 / (-slope / i));
        }
        CHECK(rec_soot_new(&k->s[c], &rec_soot_defaults, &k->m[c], NULL));
    }
}

static inline void soot_cameras_free(struct soot_cameras *k)
{
    for (int c = 0; c < CURVES; c++)
        rec_soot_free(&k->m[c]);
}

/* ---- pictures ----------------------------------------------------------------------------------- */

struct soot_job {
    const struct soot_flame *f;
    const struct soot_cameras *k;
    const struct rec_camera *c;
    float *out[SOOT_WAYS]; /* [h][w][3] */
};

static inline bool soot_box(const double o[3], const double d[3], double *s0, double *s1)
{
    *s0 = 0;
    *s1 = 1e9;
    for (int a = 0; a < 3; a++) {
        double lo = a < 2 ? -0.5 : 0, hi = a < 2 ? 0.5 : 1;
        double u = (lo - o[a]) / d[a], v = (hi - o[a]) / d[a];
        *s0 = fmax(*s0, fmin(u, v));
        *s1 = fmin(*s1, fmax(u, v));
    }
    return *s1 > *s0;
}

/* Adds one ray, times `share`. */
static inline void soot_ray(const struct soot_job *j, const double o[3], const double d[3],
                            size_t pixel, double share)
{
    double s0, s1, depth[CURVES][3] = {{0}};
    if (!soot_box(o, d, &s0, &s1))
        return;
    int steps = (int)ceil((s1 - s0) * 256);
    double ds = (s1 - s0) / steps;
    for (int i = 0; i < steps; i++) {
        double x[3], f, T, g[3], at = s0 + (i + 0.5) * ds;
        for (int a = 0; a < 3; a++)
            x[a] = o[a] + at * d[a];
        soot_flame_at(j->f, x, &f, &T);
        if (f < 1e-5 * j->f->most)
            continue;
        for (int c = 0; c < CURVES; c++) {
            rec_soot_emission(j->k->m[c], T, g);
            for (int q = 0; q < 3; q++) {
                double e = f * g[q] * ds * share, thick = f * j->k->kappa[c][q] * ds;
                j->out[2 * c][3 * pixel + (size_t)q] += (float)e;
                j->out[2 * c + 1][3 * pixel + (size_t)q] +=
                    (float)(e * exp(-depth[c][q] - thick / 2));
                depth[c][q] += thick;
            }
        }
    }
}

static inline void soot_row(void *ctx, size_t y)
{
    const struct soot_job *j = ctx;
    for (int32_t x = 0; x < j->c->width; x++)
        for (int s = 0; s < 4; s++) {
            double o[3], d[3];
            if (rec_camera_ray(j->c, x + (s % 2) * 0.5 - 0.25, (double)y + (s / 2) * 0.5 - 0.25, o,
                               d))
                soot_ray(j, o, d, y * (size_t)j->c->width + (size_t)x, 0.25);
        }
}

struct soot_pictures {
    size_t n, floats; /* cameras; of a picture */
    float *px[SOOT_WAYS][REC_MAX_CAMERAS];
    double peak[SOOT_WAYS];
};

static inline void soot_shoot(struct soot_pictures *p, const struct soot_flame *f,
                              const struct soot_cameras *k, const struct rec_rig *rig,
                              pvx_pool *pool)
{
    *p = (struct soot_pictures){.n = rig->n_cameras};
    p->floats = (size_t)rig->cameras[0].width * (size_t)rig->cameras[0].height * 3;
    for (size_t c = 0; c < p->n; c++) {
        struct soot_job j = {f, k, &rig->cameras[c], {NULL}};
        for (int w = 0; w < SOOT_WAYS; w++)
            j.out[w] = p->px[w][c] = must_floats(p->floats);
        pvx_pool_run(pool, (size_t)rig->cameras[c].height, soot_row, &j);
        for (int w = 0; w < SOOT_WAYS; w++)
            for (size_t i = 0; i < p->floats; i++)
                p->peak[w] = fmax(p->peak[w], (double)p->px[w][c][i]);
    }
}

static inline void soot_pictures_free(struct soot_pictures *p)
{
    for (int w = 0; w < SOOT_WAYS; w++)
        for (size_t c = 0; c < p->n; c++)
            free(p->px[w][c]);
}

/* Of a camera with a well of 20 000 electrons and a read noise of 5: shot noise, then `bits`. */
static inline void soot_expose(rec_frame *f, const struct soot_pictures *p, int way, double scale,
                               int bits)
{
    const double well = 20000, read = 5 / well, top = (1 << bits) - 1;
    rec_frame_reset(f);
    for (size_t c = 0; c < p->n; c++) {
        float *in = rec_frame_input(f, c);
        for (size_t i = 0; i < p->floats; i++) {
            double v = scale * (double)p->px[way][c][i];
            v += sqrt(v / well + read * read) * bench_normal();
            in[i / 3 * 4 + i % 3] = (float)fmin(floor(v * top + 0.5) / top, 1);
        }
        rec_frame_camera(f, c)->present = true;
    }
}

/* ---- verdict ------------------------------------------------------------------------------------ */

enum { SOOT_CLASSES = 2 }; /* weakest channel over its bar: above 20, 5 to 20 */
struct soot_score {
    size_t voxels[SOOT_CLASSES], known[SOOT_CLASSES], held_t[SOOT_CLASSES], held_f[SOOT_CLASSES];
    double rms[SOOT_CLASSES], mean[SOOT_CLASSES]; /* of dT / T */
    double *off[SOOT_CLASSES];                    /* [known] |dT| / T, sorted */
    size_t state[REC_N_SOOT_STATES];              /* of voxels with soot */
};

static inline void soot_score_free(struct soot_score *s)
{
    for (int k = 0; k < SOOT_CLASSES; k++)
        free(s->off[k]);
}

/* (1) of daemon/cli/temperature/voxels.h */
static inline void soot_noise(const struct rec_bars_view *b, int32_t i, double N[9])
{
    memset(N, 0, 9 * sizeof *N);
    for (int q = 0; q < 3; q++) {
        double sd = (double)b->sd[(size_t)i * (size_t)b->cs + (size_t)q];
        N[4 * q] = sd * sd;
    }
    for (uint32_t k = 0; k < b->n_modes; k++) {
        const float *m = b->modes + ((size_t)k * (size_t)b->n + (size_t)i) * (size_t)b->cs;
        for (int p = 0; p < 3; p++)
            for (int q = 0; q < 3; q++)
                N[3 * p + q] += p == q ? 0 : (double)m[p] * (double)m[q];
    }
}

/* tau of shade.h for every voxel of v, [n][3]; owner: caller. */
static inline double *soot_shade(const rec_soot *m, const struct rec_shade *s,
                                 const struct rec_sparse *v, const struct rec_bars_view *b)
{
    const struct rec_grid *g = &s->grid;
    float *f = must_floats((size_t)g->n[0] * (size_t)g->n[1] * (size_t)g->n[2]);
    double *tau = calloc((size_t)v->n * 3 + 1, sizeof *tau);
    for (int32_t i = 0; i < 3 * v->n; i++)
        tau[i] = 1;
    for (int round = 0; round < REC_SHADE_ROUNDS; round++) {
        for (int32_t i = 0; i < v->n; i++) {
            double e[3], N[9];
            soot_noise(b, i, N);
            for (int q = 0; q < 3; q++)
                e[q] = (double)v->value[(size_t)i * (size_t)v->cs + (size_t)q] / tau[3 * i + q];
            struct rec_soot_voxel r = rec_soot_solve(m, e, N);
            f[v->index[i]] = r.state == REC_SOOT_OK ? (float)r.f : 0;
        }
        for (int32_t i = 0; i < v->n; i++)
            rec_shade_at(s, f, v->index[i], &tau[3 * i]);
    }
    free(f);
    return tau;
}

/* Mean misfit of a volume over its deviation (misfit.h), by the curves of m, whose covariance is C. */
static inline double soot_lean(const rec_soot *m, const double C[9], const struct rec_sparse *v,
                               const struct rec_bars_view *b, double *mean)
{
    struct rec_misfit_part *part = calloc(1, sizeof *part);
    struct rec_misfit all = {0, 0, 0};
    double L[9], sd;
    rec_misfit_calibration(C, L);
    for (int32_t i = 0; i < v->n; i++) {
        const size_t at = (size_t)i * (size_t)v->cs;
        double e[3], N[9];
        soot_noise(b, i, N);
        for (int q = 0; q < 3; q++)
            e[q] = (double)v->value[at + (size_t)q];
        const struct rec_soot_voxel x = rec_soot_solve(m, e, N);
        const struct rec_misfit_modes modes = {b->n_modes, (size_t)b->n * (size_t)b->cs,
                                               b->modes + (size_t)i * (size_t)b->cs, NULL};
        rec_misfit_add(part, &x, N, &modes);
    }
    rec_misfit_volume(part, 1, b->n_modes, L, &all);
    rec_misfit_mean(&all, mean, &sd);
    free(part);
    return *mean / sd;
}

/* tau: of soot_shade, or NULL. */
static inline void soot_judge(const struct soot_flame *f, const rec_soot *m,
                              const struct rec_sparse *v, const struct rec_bars_view *b,
                              const double *tau, struct soot_score *out)
{
    const struct rec_grid *g = v->grid;
    *out = (struct soot_score){.voxels = {0}};
    for (int k = 0; k < SOOT_CLASSES; k++)
        out->off[k] = calloc((size_t)v->n + 1, sizeof(double));
    for (int32_t i = 0; i < v->n; i++) {
        double x[3], amount, T, e[3], N[9], clear = 1e9;
        grid_centre(g, v->index[i], x);
        soot_flame_at(f, x, &amount, &T);
        if (amount < 1e-3 * f->most)
            continue;
        soot_noise(b, i, N);
        for (int q = 0; q < 3; q++) {
            e[q] = (double)v->value[(size_t)i * (size_t)v->cs + (size_t)q];
            clear = fmin(clear, e[q] / sqrt(N[4 * q]));
        }
        for (int q = 0; q < 3 && tau != NULL; q++) {
            e[q] /= tau[3 * i + q];
            for (int p = 0; p < 3; p++)
                N[3 * p + q] /= tau[3 * i + p] * tau[3 * i + q];
        }
        struct rec_soot_voxel r = rec_soot_solve(m, e, N);
        out->state[r.state]++;
        int k = clear > 20 ? 0 : 1;
        if (!(clear > 5))
            continue;
        out->voxels[k]++;
        if (r.state != REC_SOOT_OK)
            continue;
        double off = r.kelvin / T - 1;
        out->mean[k] += off;
        out->rms[k] += off * off;
        out->off[k][out->known[k]++] = fabs(off);
        out->held_t[k] += fabs(r.kelvin - T) < 2 * r.kelvin_sd;
        out->held_f[k] += fabs(r.f - amount) < 2 * r.f_sd;
    }
    for (int k = 0; k < SOOT_CLASSES; k++) {
        double n = fmax((double)out->known[k], 1);
        out->mean[k] /= n;
        out->rms[k] = sqrt(out->rms[k] / n);
        qsort(out->off[k], out->known[k], sizeof(double), pvx_ascending);
    }
}

/* Share p of the voxels of class k is off by no more. */
static inline double soot_quantile(const struct soot_score *s, int k, double p)
{
    return s->known[k] > 0 ? s->off[k][(size_t)(p * (double)(s->known[k] - 1))] : NAN;
}
#endif
