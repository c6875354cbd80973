#include <math.h>
#include <stdlib.h>

#include "base/median.h"
#include "base/mem.h"
#include "daemon/cli/advise.h"
#include "recon/carve/absorb.h"

#define SETS   6
#define VOXELS 32
#define ROUNDS 2 /* of absorption and gains */

/* Some sets, as emission. */
struct emitted {
    struct flame_sets *s;
    struct rec_check_source of;
    size_t n;
    double c, gain[REC_MAX_CAMERAS]; /* c: of pixels times gain */
    float *room[REC_MAX_CAMERAS];
    const float *at[REC_MAX_CAMERAS];
};

static pvx_err get(void *ctx, size_t i, struct rec_check_set *out)
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

static bool progress(void *ctx, double done)
{
    struct emitted *m = ctx;
    return m->of.progress(m->of.ctx, done);
}

static void judge(const struct flame_sets *s, const double *gain, struct advise_gain *g)
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
    g->on = most > log(1 + ADVISE_GAIN) && g->error[1] < (1 - ADVISE_GAIN_BUYS) * g->error[0];
}

/* Gains of pictures that absorb by c, from `own`. */
static pvx_err gains(struct flame_sets *s, double c, const double *own, struct advise_gain *g,
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
        gain[k] = m.gain[k] = own[k];
        m.room[k] = pvx_calloc(s->bins[k], sizeof(float));
        e = m.room[k] == NULL ? PVX_ENOMEM : e;
    }
    struct rec_check_source from = {.n = m.n, .get = get, .progress = progress, .ctx = &m};
    if (e == PVX_OK)
        e = rec_gains(&s->rig, &p, s->pool, &from, gain, &r, d);
    for (size_t k = 0; k < s->rig.n_cameras; k++)
        free(m.room[k]);
    *g = (struct advise_gain){.known = e == PVX_OK};
    if (e == PVX_EINVAL) /* it tells nothing */
        return PVX_OK;
    PVX_TRY(e);
    g->error[0] = r.error[0];
    g->error[1] = r.accepted ? r.error[1] : r.error[0];
    for (size_t k = 0; k < s->rig.n_cameras; k++)
        gain[k] /= own[k];
    judge(s, gain, g);
    return PVX_OK;
}

static pvx_err absorption(struct flame_sets *s, struct advice *a, struct pvx_diag *d)
{
    struct rec_check_source from = flame_sets_source(s, "absorption");
    rec_unseen *u;
    PVX_TRY(rec_unseen_new(&s->rig, &s->params, s->pool, &u, d));
    pvx_err e = rec_absorption_find(u, &from, &a->absorption, d);
    rec_unseen_free(&u);
    return e;
}

/* A flame that absorbs has other gains than one that does not, and the other way round: where the two change each
 * other's verdict they are asked again. */
pvx_err advise_light(struct flame_sets *s, struct advice *a, struct pvx_diag *d)
{
    double own[REC_MAX_CAMERAS] = {0};
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        own[c] = (double)s->rig.cameras[c].gain[0];
    PVX_TRY(absorption(s, a, d));
    for (int round = 0; round < ROUNDS; round++) {
        double before = a->absorption.c;
        PVX_TRY(gains(s, before, own, &a->gain, d));
        for (size_t c = 0; c < s->rig.n_cameras; c++)
            for (int ch = 0; ch < 3; ch++)
                s->rig.cameras[c].gain[ch] = (float)(own[c] * (a->gain.on ? a->gain.gain[c] : 1));
        if (!a->gain.on)
            break;
        PVX_TRY(absorption(s, a, d));
        if ((a->absorption.c > 0) == (before > 0))
            break;
    }
    return PVX_OK;
}
