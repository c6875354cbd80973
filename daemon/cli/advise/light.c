#include <math.h>
#include <stdlib.h>

#include "base/median.h"
#include "base/mem.h"
#include "daemon/cli/advise/advise.h"
#include "recon/carve/absorb.h"

#define SETS   6
#define VOXELS 32
#define ROUNDS 3   /* of gains and absorption */
#define GUESS  2.0 /* depth at the brightest pixel */

/* Some sets, as emission. */
struct emitted {
    struct flame_sets *s;
    struct rec_check_source of;
    size_t n;
    double c, gain[REC_MAX_CAMERAS]; /* c: of pixels times gain */
    float *room[REC_MAX_CAMERAS];
    const float *at[REC_MAX_CAMERAS];
};

static pvx_err light_get(void *ctx, size_t i, struct rec_check_set *out)
{
    struct emitted *m = ctx;
    PVX_TRY(m->of.get(m->of.ctx, (2 * i + 1) * m->of.n / (2 * m->n), out));
    float top = out->floats ? INFINITY : REC_PHOTO_FULL;
    for (size_t c = 0; c < m->s->rig.n_cameras && m->c > 0; c++) {
        const float *p = out->picture[c];
        m->at[c] = p != NULL ? m->room[c] : NULL;
        for (size_t k = 0; k < m->s->bins[c] && p != NULL; k++)
            m->room[c][k] =
                p[k] >= top
                    ? NAN
                    : (float)(rec_absorb_emitted(m->c, m->gain[c] * (double)p[k]) / m->gain[c]);
    }
    if (m->c > 0)
        *out = (struct rec_check_set){out->number, m->at, true};
    return PVX_OK;
}

static bool light_progress(void *ctx, double done)
{
    struct emitted *m = ctx;
    return m->of.progress(m->of.ctx, done);
}

static void light_judge(const struct flame_sets *s, const double *gain, struct advise_gain *g)
{
    double sorted[REC_MAX_CAMERAS], most = 0;
    size_t n = s->rig.n_cameras;
    for (size_t c = 0; c < n; c++)
        sorted[c] = gain[c];
    double median = pvx_median(sorted, n);
    for (size_t c = 0; c < n; c++) {
        g->gain[c] = gain[c] / median;
        if (fabs(log(g->gain[c])) > most) {
            most = fabs(log(g->gain[c]));
            g->worst = c;
        }
    }
    double was = g->error[0] * g->error[0], is = g->error[1] * g->error[1];
    g->on = most > log(1 + ADVISE_GAIN) &&
            was - is > ADVISE_GAIN_BUYS * fmax(was - g->noise * g->noise, 0);
}

/* Gains relative to `own` for a flame that absorbs by c.  Starts from the gains of `begin` if they are on. */
static pvx_err light_gains(struct flame_sets *s, double c, const double *own,
                           const struct advise_gain *begin, struct advise_gain *g,
                           struct pvx_diag *d)
{
    struct emitted m = {.s = s, .of = flame_sets_source(s, "gains"), .c = c};
    struct rec_unseen_params p = s->params;
    struct rec_gains_report r = {0};
    double gain[REC_MAX_CAMERAS] = {0};
    pvx_err e = PVX_OK;
    m.n = s->n < SETS ? s->n : SETS;
    p.voxels = VOXELS;
    for (size_t k = 0; k < s->rig.n_cameras; k++) {
        gain[k] = m.gain[k] = own[k] * (begin->on ? begin->gain[k] : 1);
        m.room[k] = pvx_calloc(s->bins[k], sizeof(float));
        e = m.room[k] == NULL ? PVX_ENOMEM : e;
    }
    struct rec_check_source from = {
        .n = m.n, .get = light_get, .progress = light_progress, .ctx = &m};
    PVX_THEN(e, rec_gains(&s->rig, &p, s->pool, &from, gain, &r, d));
    for (size_t k = 0; k < s->rig.n_cameras; k++)
        free(m.room[k]);
    *g = (struct advise_gain){.known = e == PVX_OK};
    if (e == PVX_EINVAL) /* the pictures do not determine gains */
        return PVX_OK;
    PVX_TRY(e);
    g->noise = r.noise;
    g->error[0] = r.error[0];
    g->error[1] = r.accepted ? r.error[1] : r.error[0];
    for (size_t k = 0; k < s->rig.n_cameras; k++)
        gain[k] /= own[k];
    light_judge(s, gain, g);
    if (begin->on) { /* accepted before: is there still a gain? */
        g->error[0] = begin->error[0];
        g->on = fabs(log(g->gain[g->worst])) > log(1 + ADVISE_GAIN);
    }
    return PVX_OK;
}

static pvx_err absorption(struct flame_sets *s, struct rec_absorption *out, struct pvx_diag *d)
{
    struct rec_check_source from = flame_sets_source(s, "absorption");
    rec_unseen *u;
    PVX_TRY(rec_unseen_new(&s->rig, &s->params, s->pool, &u, d));
    pvx_err e = rec_absorption_find(u, &from, out, d);
    rec_unseen_free(&u);
    return e;
}

/* Whether neither bodies nor saturated pixels were found. */
static bool told(const struct flame_sets *s, const struct advice *a)
{
    bool all = a->saturated <= ADVISE_SATURATED;
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        all &= !(a->body[c].share > 0);
    return all;
}

/* Set the rig's gains to own times those of g, or to own if g is not on. */
static void light_use(struct flame_sets *s, const double *own, const struct advise_gain *g)
{
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        for (int ch = 0; ch < 3; ch++)
            s->rig.cameras[c].gain[ch] = (float)(own[c] * (g->on ? g->gain[c] : 1));
}

/* Absorption and gains that were found together. */
struct light {
    struct rec_absorption absorption;
    struct advise_gain gain;
};
/* Least errors of left-out pictures so far. */
struct least {
    double without, with; /* absorption */
    double alone;         /* with it and no gains: */
    struct rec_absorption plain;
};

/* Find the absorption with these gains, and put both into *best if they are better.  Gains without absorption count
 * only if their error is below that of absorption alone: absorption is one number, gains are one for every camera. */
static pvx_err try(struct flame_sets *s, const double *own, const struct advise_gain *g,
                   struct light *best, struct least *l, struct pvx_diag *d)
{
    struct light now = {.gain = *g};
    light_use(s, own, g);
    PVX_TRY(absorption(s, &now.absorption, d));
    const double *missed = now.absorption.missed;
    if (missed[1] < l->with)
        *best = now;
    if (!g->on) {
        l->alone = missed[1];
        l->plain = now.absorption;
    }
    if (!g->on || missed[0] < l->alone)
        l->without = fmin(l->without, missed[0]);
    l->with = fmin(l->with, missed[1]);
    return PVX_OK;
}

/* From its thin sides a flame that absorbs looks like cameras with other gains, and the other way round.  So
 * absorption is accepted only if it is better than gains alone.  Gains are first found without absorption: with it, a
 * camera that is brighter than full absorption allows has no gain. */
pvx_err advise_light(struct flame_sets *s, struct advice *a, struct pvx_diag *d)
{
    struct advise_gain none = {0}, thin, deep;
    struct light best = {0};
    double own[REC_MAX_CAMERAS] = {0};
    struct least l = {.without = INFINITY, .with = INFINITY, .alone = INFINITY};
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        own[c] = (double)s->rig.cameras[c].gain[0];
    PVX_TRY(try(s, own, &none, &best, &l, d));
    PVX_TRY(light_gains(s, 0, own, &none, &thin, d));
    if (thin.on)
        PVX_TRY(try(s, own, &thin, &best, &l, d));
    for (int round = 0; round < ROUNDS; round++) {
        double before = l.with, c = best.absorption.best;
        if (best.absorption.gain < 0.5 * REC_ABSORPTION_GAIN) {
            if (!thin.on || round > 0)
                break;
            c = -expm1(-GUESS) / best.absorption.brightest; /* gains may hide all of it */
        }
        PVX_TRY(light_gains(s, c, own, &best.gain, &deep, d));
        if (!deep.on && !best.gain.on) {
            best.gain = deep; /* keep the measurement */
            break;
        }
        PVX_TRY(try(s, own, &deep, &best, &l, d));
        if (l.with > 0.98 * before)
            break;
    }
    double was = l.alone * l.alone, is = l.with * l.with, noise = best.absorption.noise;
    if (best.gain.on && was - is < ADVISE_GAIN_BUYS * fmax(was - noise * noise, 0)) {
        best.absorption = l.plain;
        best.gain.on = false;
        is = was;
    }
    was = l.without * l.without;
    struct rec_absorption *b = &best.absorption;
    b->gain = fmax(was - is, 0) / fmax(was - noise * noise, 1e-3 * was + 1e-300);
    b->c = b->gain >= fmax(told(s, a) ? REC_ABSORPTION_GAIN : ADVISE_ABSORPTION,
                           REC_ABSORPTION_SURE * b->unsure)
               ? b->c
               : 0;
    b->missed[0] = l.without;
    b->missed[1] = sqrt(is);
    a->absorption = *b;
    a->gain = b->c > 0 ? best.gain : thin;
    light_use(s, own, &a->gain);
    return PVX_OK;
}
