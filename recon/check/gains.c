#include "recon/check/gains.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/median.h"
#include "base/mem.h"

#define STEP 0.85
#define MOST 0.7 /* largest change of a gain's logarithm in a round */

struct gains {
    size_t cameras;
    rec_unseen *u; /* with the gains of the round */
    const struct rec_check_source *s;
    struct rec_gains_report *out;
    double *ratio; /* [cameras][sets]: logarithms; NAN where a camera saw nothing */
    double error2; /* (2), summed over cameras and sets */
    double noise2; /* the same of noise alone */
    size_t errors;
    struct pvx_diag *d;
};

/* Camera c of the loaded set against the volume of the others. */
static pvx_err gains_one(struct gains *g, size_t c, double *ratio)
{
    rec_unseen *u = g->u;
    const rec_sysmat *S = rec_unseen_matrix(u);
    const float *p, *hull, *b = rec_unseen_b(u, c), *w = rec_unseen_weight(u, c);
    bool use[REC_MAX_CAMERAS];
    double due = 0, own = 0, off = 0, all = 0, bins = 0;
    int32_t n;
    for (size_t i = 0; i < S->n_cameras; i++)
        use[i] = i != c;
    PVX_TRY(rec_unseen_solve(u, use, &n));
    rec_unseen_project(u, c, &p, &hull);
    for (size_t i = 0; i < S->row0[c + 1] - S->row0[c]; i++) {
        double bi = (double)b[i], pi = (double)p[i];
        if (!(w[i] > 0))
            continue;
        off += (bi - pi) * (bi - pi);
        all += bi * bi;
        bins++;
        due += hull[i] > 0 ? pi : 0;
        own += hull[i] > 0 ? bi : 0;
    }
    *ratio = due > 0 && own > 0 ? log(due / own) : NAN;
    if (isfinite(*ratio)) {
        g->error2 += off / all;
        g->noise2 += bins * rec_unseen_sigma(u) * rec_unseen_sigma(u) / all;
        g->errors++;
    }
    return PVX_OK;
}

/* Sets [from, to) with these gains: ratios, and (2). */
static pvx_err gains_look(struct gains *g, const double *gain, size_t from, size_t to,
                          double *error)
{
    struct rec_check_set set;
    pvx_err e = PVX_OK;
    for (size_t c = 0; c < g->cameras; c++)
        rec_unseen_gain(g->u, c, gain[c]);
    g->error2 = g->noise2 = 0;
    g->errors = 0;
    for (size_t k = from; k < to && e == PVX_OK; k++) {
        if (g->s->progress != NULL &&
            !g->s->progress(g->s->ctx, (double)(k - from) / (double)(to - from)))
            e = PVX_ECANCELED;
        if (e == PVX_OK)
            e = g->s->get(g->s->ctx, k, &set);
        if (e == PVX_OK)
            rec_unseen_load(g->u, set.picture, set.floats);
        for (size_t c = 0; c < g->cameras && e == PVX_OK; c++) {
            double *ratio = &g->ratio[c * g->s->n + k];
            *ratio = NAN;
            if (rec_unseen_present(g->u, c))
                e = gains_one(g, c, ratio);
        }
    }
    *error = g->errors > 0 ? sqrt(g->error2 / (double)g->errors) : 1;
    return e;
}

/* Median of camera c's ratios over the fitted sets; NAN: it saw nothing in any of them. */
static double gains_usual(struct gains *g, size_t c)
{
    double *v = g->ratio + c * g->s->n;
    size_t n = 0;
    for (size_t k = 0; k < g->out->fitted; k++)
        if (isfinite(v[k]))
            v[n++] = v[k];
    qsort(v, n, sizeof *v, pvx_ascending);
    return n == 0 ? NAN : 0.5 * (v[n / 2] + v[(n - 1) / 2]);
}

/* (1).  *seen: cameras that see flame. */
static double gains_step(struct gains *g, double *gain, size_t *seen)
{
    double by[REC_MAX_CAMERAS], mean = 0, most = 0;
    *seen = 0;
    for (size_t c = 0; c < g->cameras; c++) {
        by[c] = STEP * gains_usual(g, c);
        if (!isfinite(by[c]))
            continue;
        by[c] = fmax(-MOST, fmin(MOST, by[c]));
        mean += by[c] + log(gain[c]);
        (*seen)++;
    }
    mean /= fmax((double)*seen, 1);
    for (size_t c = 0; c < g->cameras; c++)
        if (isfinite(by[c])) {
            gain[c] *= exp(by[c] - mean);
            most = fmax(most, fabs(by[c] - mean));
        }
    return most;
}

static pvx_err gains_rounds(struct gains *g, double *gain)
{
    struct rec_gains_report *o = g->out;
    double now[REC_MAX_CAMERAS], unused;
    size_t seen, n = g->cameras;
    memcpy(now, gain, n * sizeof *now);
    PVX_TRY(gains_look(g, gain, o->fitted, g->s->n, &o->error[0]));
    for (bool settled = false; !settled && o->rounds < REC_GAINS_ROUNDS; o->rounds++) {
        PVX_TRY(gains_look(g, now, 0, o->fitted, &unused));
        o->changed[o->rounds] = gains_step(g, now, &seen);
        settled = o->changed[o->rounds] < REC_GAINS_SETTLED;
        if (seen < REC_CHECK_LEAST)
            return pvx_fail(
                g->d, PVX_EINVAL,
                "%zu cameras see flame that others see too; gains by the volumes of the "
                "others need %d",
                seen, REC_CHECK_LEAST);
    }
    PVX_TRY(gains_look(g, now, o->fitted, g->s->n, &o->error[1]));
    o->noise = g->errors > 0 ? sqrt(g->noise2 / (double)g->errors) : 0;
    o->accepted = o->error[1] <= o->error[0];
    if (o->accepted)
        memcpy(gain, now, n * sizeof *now);
    return PVX_OK;
}

pvx_err rec_gains(const struct rec_rig *rig, const struct rec_unseen_params *p, pvx_pool *pool,
                  const struct rec_check_source *s, double gain[REC_MAX_CAMERAS],
                  struct rec_gains_report *out, struct pvx_diag *d)
{
    struct gains g = {.cameras = rig->n_cameras, .s = s, .out = out, .d = d};
    size_t held = s->n / 3 > 0 ? s->n / 3 : 1;
    *out = (struct rec_gains_report){.fitted = s->n - held, .held_out = held};
    if (s->n < REC_GAINS_SETS)
        return pvx_fail(d, PVX_EINVAL,
                        "%zu frame sets: gains by the volumes of the others need %d, two thirds to "
                        "fit and the rest to judge",
                        s->n, REC_GAINS_SETS);
    g.ratio = pvx_calloc(s->n * rig->n_cameras, sizeof *g.ratio);
    pvx_err e = g.ratio == NULL ? PVX_ENOMEM : rec_unseen_new(rig, p, pool, &g.u, d);
    if (e == PVX_OK)
        e = gains_rounds(&g, gain);
    rec_unseen_free(&g.u);
    free(g.ratio);
    return e;
}
