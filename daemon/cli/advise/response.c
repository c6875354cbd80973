/* response.c - pictures that are a power of the light, as sRGB nearly is.  Volumes of such pictures do not fit the
 * left-out pictures.  Absorption has a similar effect, but only on bright pixels. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "daemon/cli/advise/advise.h"
#include "recon/carve/absorb.h"
#include "recon/check/holdout.h"

#define SETS   3
#define VIEWS  12
#define BRIGHT 0.25 /* least light, of a picture's brightest: at edges errors exceed the light */
#define LIFT   20.0 /* factor on all light: squared dim light is below the least threshold */

static const double powers[] = {0.45, 0.7, 1.4, 2.2};
#define N_POWERS (sizeof powers / sizeof *powers)

/* A way to turn pictures into light: unchanged with the best gains and absorption, accepted or not, or by a power.
 * A power in the pictures may itself cause wrong gains, so each power is tried with and without the gains found. */
struct tried {
    double power, c;
    bool gains;
    double miss[VIEWS], all; /* sums of squares: of errors, of the pictures */
};

struct curve {
    struct flame_sets *s;
    struct rec_check_source from;
    rec_unseen *u;
    double gain[REC_MAX_CAMERAS];
    float *room[REC_MAX_CAMERAS];
    struct tried tried[2 + 2 * N_POWERS];
    size_t n, as_came; /* all; the first as_came of them have power 1 */
    double noise;      /* sum of squares, of the pictures of tried[0] */
    uint32_t views;
};

static double bent(double v, double power)
{
    return copysign(pow(fabs(v), power), v);
}

/* Load set i as light.  Saturated bins become NaN. */
static pvx_err response_load(struct curve *w, size_t i, const struct tried *t)
{
    const float *at[REC_MAX_CAMERAS];
    struct rec_check_set set;
    PVX_TRY(w->from.get(w->from.ctx, i, &set));
    float top = set.floats ? INFINITY : REC_PHOTO_FULL;
    for (size_t c = 0; c < w->s->rig.n_cameras; c++) {
        const float *p = set.picture[c];
        at[c] = p != NULL ? w->room[c] : NULL;
        double gain = t->gains ? w->gain[c] : 1;
        for (size_t k = 0; k < w->s->bins[c] && p != NULL; k++)
            w->room[c][k] = p[k] >= top ? NAN : (float)(LIFT * bent(gain * (double)p[k], t->power));
    }
    rec_unseen_absorb(w->u, 0);
    rec_unseen_load(w->u, at, true);
    rec_unseen_absorb(w->u, t->c / LIFT);
    return PVX_OK;
}

/* Squared error of the volume in camera k's picture where that is bright, on the scale of the original picture. */
static double missed(struct curve *w, size_t k, struct tried *t)
{
    const double power = t->power;
    const rec_sysmat *S = rec_unseen_matrix(w->u);
    const float *b = rec_unseen_b(w->u, k), *wt = rec_unseen_weight(w->u, k), *e;
    const uint8_t *lit = rec_unseen_lit(w->u, k);
    double sigma = rec_unseen_sigma(w->u) / LIFT, sum = 0, top = 0, c = t->c / LIFT;
    rec_unseen_project(w->u, k, &e, NULL);
    for (size_t i = 0; i < S->row0[k + 1] - S->row0[k]; i++)
        top = wt[i] > 0 && lit[i] ? fmax(top, bent((double)b[i] / LIFT, 1 / power)) : top;
    for (size_t i = 0; i < S->row0[k + 1] - S->row0[k]; i++)
        if (wt[i] > 0 && lit[i]) {
            double due = bent(rec_absorb_seen(c, (double)e[i]) / LIFT, 1 / power);
            double is = bent((double)b[i] / LIFT, 1 / power);
            if (is < BRIGHT * top)
                continue;
            sum += (due - is) * (due - is);
            t->all += is * is;
            w->noise += t == w->tried ? sigma * sigma : 0;
        }
    return sum;
}

static pvx_err response_measure(struct curve *w, struct tried *t)
{
    size_t n = w->s->rig.n_cameras, sets = w->s->n < SETS ? w->s->n : SETS;
    bool sees[REC_MAX_CAMERAS], use[REC_MAX_CAMERAS];
    w->views = 0;
    for (size_t j = 0; j < sets; j++) {
        PVX_TRY(response_load(w, (2 * j + 1) * w->from.n / (2 * sets), t));
        (void)rec_holdout_who(w->u, sees);
        for (size_t m = 0; m < VIEWS / SETS; m++) {
            size_t k = (j + m * n / (VIEWS / SETS)) % n;
            int32_t voxels;
            for (size_t c = 0; c < n; c++)
                use[c] = sees[c] && c != k;
            if (!sees[k])
                continue;
            PVX_TRY(rec_unseen_solve(w->u, use, &voxels));
            t->miss[w->views++] = missed(w, k, t);
        }
        double done = (double)(t - w->tried) + (double)(j + 1) / (double)sets;
        if (!w->from.progress(w->from.ctx, done / (double)w->n))
            return PVX_ECANCELED;
    }
    return PVX_OK;
}

/* Total squared error of t, scaled to the pictures of tried[0]. */
static double response_total(const struct curve *w, const struct tried *t)
{
    double sum = 0;
    for (uint32_t v = 0; v < w->views; v++)
        sum += t->miss[v];
    return t->all > 0 ? sum * w->tried->all / t->all : INFINITY;
}

static void response_judge(const struct curve *w, double least, struct advise_response *r)
{
    const struct tried *as_is = w->tried, *best;
    uint32_t better = 0;
    for (size_t k = 1; k < w->as_came; k++)
        as_is = response_total(w, &w->tried[k]) < response_total(w, as_is) ? &w->tried[k] : as_is;
    best = as_is;
    for (size_t k = w->as_came; k < w->n; k++)
        best = response_total(w, &w->tried[k]) < response_total(w, best) ? &w->tried[k] : best;
    double scale = as_is->all / best->all, was = response_total(w, as_is),
           is = response_total(w, best);
    for (uint32_t v = 0; v < w->views; v++)
        better += scale * best->miss[v] < as_is->miss[v];
    r->power = best->power;
    r->error[0] = sqrt(was / w->tried->all);
    r->error[1] = sqrt(is / w->tried->all);
    r->on =
        was - is > least * fmax(was - w->noise, 0) && best != as_is && 4 * better >= 3 * w->views;
}

/* List what is tried, and take the gains found out of the cameras.  The caller puts them back. */
static void plan(struct curve *w, double absorbs, const struct advise_gain *g)
{
    w->tried[w->n++] = (struct tried){.power = 1, .gains = g->on};
    if (absorbs > 0)
        w->tried[w->n++] = (struct tried){.power = 1, .c = absorbs, .gains = g->on};
    w->as_came = w->n;
    for (size_t k = 0; k < N_POWERS; k++) {
        w->tried[w->n++] = (struct tried){.power = powers[k], .gains = g->on};
        if (g->on)
            w->tried[w->n++] = (struct tried){.power = powers[k]};
    }
    for (size_t c = 0; c < w->s->rig.n_cameras; c++) {
        w->gain[c] = g->on ? g->gain[c] : 1;
        for (int ch = 0; ch < 3; ch++)
            w->s->rig.cameras[c].gain[ch] =
                (float)((double)w->s->rig.cameras[c].gain[ch] / w->gain[c]);
    }
}

pvx_err advise_response(struct flame_sets *s, struct advice *a, struct pvx_diag *d)
{
    struct curve w = {.s = s, .from = flame_sets_source(s, "response")};
    float found[REC_MAX_CAMERAS][3];
    pvx_err e = PVX_OK;
    a->response = (struct advise_response){.power = 1};
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        if ((w.room[c] = pvx_calloc(s->bins[c], sizeof(float))) == NULL)
            e = PVX_ENOMEM;
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        memcpy(found[c], s->rig.cameras[c].gain, sizeof found[c]);
    plan(&w, a->absorption.best, &a->gain);
    PVX_THEN(e, rec_unseen_new(&s->rig, &s->params, s->pool, &w.u, d));
    for (size_t k = 0; k < w.n && e == PVX_OK; k++)
        e = response_measure(&w, &w.tried[k]);
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        memcpy(s->rig.cameras[c].gain, found[c], sizeof found[c]);
    if (e == PVX_OK && w.tried->all > 0)
        response_judge(&w, ADVISE_BENT, &a->response);
    rec_unseen_free(&w.u);
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        free(w.room[c]);
    return e;
}

/* Turn all pictures into light, for all that follows. */
void advise_straighten(struct flame_sets *s, double power)
{
    float top = s->floats ? INFINITY : REC_PHOTO_FULL;
    for (size_t i = 0; i < s->n; i++)
        for (size_t c = 0; c < s->rig.n_cameras; c++)
            for (size_t k = 0; k < s->bins[c] * (s->nch == 3 ? 4 : 1); k++) {
                float *p = s->picture[i][c] != NULL ? &s->picture[i][c][k] : NULL;
                if (p != NULL)
                    *p = *p >= top ? *p : (float)bent((double)*p, power);
            }
}
