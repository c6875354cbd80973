#include "daemon/cli/temperature/voxels.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/spectral/shade.h"

#define CELLS ((size_t)PVP_BRICK * PVP_BRICK * PVP_BRICK)
#define CLEAR 5.0 /* green over its noise for a ratio */
#define PPM   1e6

const struct vol_thermal_field temperature_fields[TEMPERATURE_FIELDS] = {
    {"temperature", "K", false}, {"temperature_sd", "K", false}, {"soot", "ppm", false},
    {"soot_sd", "ppm", false},   {"chi2", "1", false},           {"state", "1", true},
};
const struct vol_thermal_field temperature_ratios[TEMPERATURE_RATIOS] = {
    {"red_over_green", "1", false},
    {"red_over_green_sd", "1", false},
    {"blue_over_green", "1", false},
    {"blue_over_green_sd", "1", false},
};

struct job {
    struct temperature_voxels *t;
    const struct vol_volume *v;
    double noise2;                 /* of (2), squared; bars: not used */
    struct temperature_sums *sums; /* [bricks] */
    struct rec_misfit_part *lean;  /* [bricks] */
};

/* (1) or (2) */
static void covariance(const struct job *j, size_t at, double N[9])
{
    const struct vol_bars *b = &j->v->bars;
    size_t floats = (size_t)j->v->n_bricks * CELLS * 3;
    memset(N, 0, 9 * sizeof *N);
    for (int q = 0; q < 3; q++) {
        double sd = b->sd != NULL ? (double)b->sd[at + (size_t)q] : 0;
        N[4 * q] = b->sd != NULL ? sd * sd : j->noise2;
    }
    for (uint32_t k = 0; k < b->n_modes && b->sd != NULL; k++) {
        const float *m = b->modes + k * floats + at;
        for (int p = 0; p < 3; p++)
            for (int q = 0; q < 3; q++)
                N[3 * p + q] += p == q ? 0 : (double)m[p] * (double)m[q];
    }
}

static void add_up(struct temperature_sums *s, const struct rec_soot_voxel *x)
{
    s->state[x->state]++;
    if (x->state == REC_SOOT_OK || x->state == REC_SOOT_NOT) {
        s->chi2 += x->chi2;
        s->judged++;
    }
    if (x->state != REC_SOOT_OK)
        return;
    double weight = isfinite(x->f) ? x->f : 1;
    s->soot += weight;
    s->soot_kelvin += weight * x->kelvin;
    s->hottest = fmax(s->hottest, x->kelvin);
    s->coldest = s->coldest > 0 ? fmin(s->coldest, x->kelvin) : x->kelvin;
}

/* (3) times f of all modes into one field's. */
static void put_modes(const struct job *j, size_t at, float *out, double unit, const double by_e[3],
                      const double by_k[3])
{
    const size_t plane = (size_t)j->v->n_bricks * CELLS, n = plane * 3;
    const double *L = j->t->L;
    for (int k = 0; k < 3; k++)
        out[(size_t)k * plane + at] =
            (float)(unit * (by_k[0] * L[k] + by_k[1] * L[3 + k] + by_k[2] * L[6 + k]));
    for (uint32_t k = 0; k < j->v->bars.n_modes; k++) {
        const float *m = j->v->bars.modes + k * n + 3 * at;
        double sum = 0;
        for (int q = 0; q < 3; q++)
            sum += by_e[q] * (double)m[q] / (j->t->tau != NULL ? (double)j->t->tau[3 * at + q] : 1);
        out[(VOL_THERMAL_COMMON + k) * plane + at] = (float)(unit * sum);
    }
}

static void voxel_soot(const struct job *j, struct temperature_sums *sums, size_t b, size_t at,
                       const double e[3], const double N[9])
{
    struct rec_soot_voxel x = rec_soot_solve(j->t->soot, e, N);
    const double out[TEMPERATURE_FIELDS] = {x.kelvin,     x.kelvin_sd, x.f * PPM,
                                            x.f_sd * PPM, x.chi2,      x.state};
    for (int k = 0; k < TEMPERATURE_FIELDS; k++)
        j->t->field[k][at] = (float)out[k];
    add_up(sums, &x);
    const struct vol_bars *bars = &j->v->bars;
    const struct rec_misfit_modes modes = {bars->n_modes, 3 * CELLS * j->v->n_bricks,
                                           bars->modes + (bars->n_modes > 0 ? 3 * at : 0),
                                           j->t->tau != NULL ? j->t->tau + 3 * at : NULL};
    rec_misfit_add(&j->lean[b], &x, N, &modes);
    if (x.state == REC_SOOT_OK && j->t->modes.n > 0) {
        put_modes(j, at, j->t->mode[0], 1, x.kelvin_by_e, x.kelvin_by_k);
        put_modes(j, at, j->t->mode[1], PPM, x.f_by_e, x.f_by_k);
    }
}

/* a / b with its bar; covariances as in N. */
static void ratio(const double e[3], const double N[9], int a, int b, double out[2])
{
    double r = e[a] / e[b];
    double var = N[4 * a] + r * r * N[4 * b] - 2 * r * N[3 * a + b];
    out[0] = r;
    out[1] = sqrt(fmax(var, 0)) / e[b];
}

static void voxel_ratios(const struct job *j, struct temperature_sums *sums, size_t at,
                         const double e[3], const double N[9])
{
    double out[TEMPERATURE_RATIOS] = {NAN, NAN, NAN, NAN};
    bool clear = e[1] > CLEAR * sqrt(N[4]);
    if (clear) {
        ratio(e, N, 0, 1, out);
        ratio(e, N, 2, 1, out + 2);
    }
    for (int k = 0; k < TEMPERATURE_RATIOS; k++)
        j->t->field[k][at] = (float)out[k];
    sums->state[clear ? REC_SOOT_OK : REC_SOOT_DARK]++;
}

static void no_light(const struct job *j, size_t at)
{
    for (int k = 0; k < TEMPERATURE_FIELDS; k++)
        j->t->field[k][at] = k == 5 ? 0 : NAN;
}

/* e and N as they were before the soot's own absorption; false: too little is left. */
static bool unshade(const float tau[3], double e[3], double N[9])
{
    for (int q = 0; q < 3; q++) {
        if (!((double)tau[q] >= REC_SHADE_LEAST))
            return false;
        e[q] /= (double)tau[q];
        for (int p = 0; p < 3; p++)
            N[3 * p + q] /= (double)tau[p] * (double)tau[q];
    }
    return true;
}

static void do_brick(void *ctx, size_t b)
{
    const struct job *j = ctx;
    for (size_t i = b * CELLS; i < (b + 1) * CELLS; i++) {
        const float *x = j->v->brick + 3 * i;
        double e[3] = {(double)x[0], (double)x[1], (double)x[2]}, N[9];
        if (x[0] == 0 && x[1] == 0 && x[2] == 0) {
            no_light(j, i);
            continue;
        }
        covariance(j, 3 * i, N);
        if (j->t->tau != NULL && !unshade(j->t->tau + 3 * i, e, N)) {
            no_light(j, i);
            continue;
        }
        if (j->t->soot != NULL)
            voxel_soot(j, &j->sums[b], b, i, e, N);
        else
            voxel_ratios(j, &j->sums[b], i, e, N);
    }
}

static void sums_join(struct temperature_sums *to, const struct temperature_sums *s)
{
    for (int k = 0; k < REC_N_SOOT_STATES; k++)
        to->state[k] += s->state[k];
    to->soot += s->soot;
    to->chi2 += s->chi2;
    to->judged += s->judged;
    to->soot_kelvin += s->soot_kelvin;
    to->hottest = fmax(to->hottest, s->hottest);
    if (s->coldest > 0)
        to->coldest = to->coldest > 0 ? fmin(to->coldest, s->coldest) : s->coldest;
}

/* Zeroed room for the modes of temperature and soot, if the volume has some. */
static pvx_err mode_room(struct temperature_voxels *t, const struct vol_volume *v)
{
    t->modes = (struct vol_thermal_modes){0};
    if (v->bars.sd == NULL || v->bars.n_modes == 0 || t->soot == NULL)
        return PVX_OK;
    const uint32_t n = VOL_THERMAL_COMMON + v->bars.n_modes;
    const size_t floats = (size_t)n * v->n_bricks * CELLS;
    for (int k = 0; k < 2; k++) {
        if (floats > t->mode_room || t->mode[k] == NULL) {
            free(t->mode[k]);
            t->mode[k] = malloc(floats > 0 ? floats * sizeof(float) : sizeof(float));
            PVX_NEED(t->mode[k]);
        }
        memset(t->mode[k], 0, floats * sizeof(float));
    }
    t->mode_room = floats > t->mode_room ? floats : t->mode_room;
    t->modes = (struct vol_thermal_modes){n, t->mode[0], t->mode[1]};
    return PVX_OK;
}

static pvx_err make_room(struct temperature_voxels *t, uint32_t bricks)
{
    if (bricks <= t->room)
        return PVX_OK;
    t->room = 0;
    for (int k = 0; k < TEMPERATURE_FIELDS; k++) {
        free(t->field[k]);
        t->field[k] = pvx_calloc(bricks * CELLS, sizeof(float));
        PVX_NEED(t->field[k]);
    }
    t->room = bricks;
    return PVX_OK;
}

pvx_err temperature_do(struct temperature_voxels *t, const struct vol_volume *v, struct pvx_diag *d)
{
    double most = 0;
    if (v->bars.sd == NULL && !isfinite(t->noise))
        return pvx_fail(d, PVX_EINVAL,
                        "set %llu has no error bars: reconstruct with --error-bars, or say its "
                        "noise (--noise 0.01: a hundredth of its largest emission)",
                        (unsigned long long)v->v.set);
    PVX_TRY(make_room(t, v->n_bricks));
    PVX_TRY(mode_room(t, v));
    for (size_t i = 0; i < v->n_bricks * CELLS * 3; i++)
        most = fmax(most, (double)v->brick[i]);
    struct job j = {t, v, most * t->noise * most * t->noise, NULL, NULL};
    j.sums = pvx_calloc(v->n_bricks, sizeof *j.sums);
    j.lean = pvx_calloc(v->n_bricks, sizeof *j.lean);
    if (j.sums != NULL && j.lean != NULL) {
        pvx_pool_run(t->pool, v->n_bricks, do_brick, &j);
        for (uint32_t b = 0; b < v->n_bricks; b++)
            sums_join(&t->sums, &j.sums[b]);
        rec_misfit_volume(j.lean, v->n_bricks, v->bars.n_modes, t->L, &t->sums.misfit);
    }
    bool done = j.sums != NULL && j.lean != NULL;
    free(j.sums);
    free(j.lean);
    return done ? PVX_OK : PVX_ENOMEM;
}

void temperature_fini(struct temperature_voxels *t)
{
    for (int k = 0; k < TEMPERATURE_FIELDS; k++)
        PVX_FREE(t->field[k]);
    PVX_FREE(t->mode[0]);
    PVX_FREE(t->mode[1]);
    t->room = 0;
    t->mode_room = 0;
}
