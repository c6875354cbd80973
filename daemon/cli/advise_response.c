/* advise_response.c - pictures that are a power of the light, as sRGB nearly is: volumes of such pictures miss those
 * that were left out, as where a flame absorbs, which bends only what is bright. */
#include <math.h>
#include <stdlib.h>

#include "base/mem.h"
#include "daemon/cli/advise.h"
#include "recon/carve/absorb.h"
#include "recon/check/holdout.h"

#define SETS   3
#define VIEWS  12
#define BRIGHT 0.25 /* of a picture's brightest: edges are off by more than they are bright */
#define LIFT   20.0 /* dim light is below the least threshold when it is squared */

static const double powers[] = {1, 0.45, 0.7, 1.4, 2.2};
#define N_POWERS (sizeof powers / sizeof *powers)

struct curve {
    struct flame_sets *s;
    struct rec_check_source from;
    rec_unseen *u;
    double c;
    float *room[REC_MAX_CAMERAS];
    double miss[N_POWERS][VIEWS];
    double all, noise; /* squares of the pictures, of their noise */
    uint32_t views;
};

static double bent(double v, double power)
{
    return copysign(pow(fabs(v), power), v);
}

/* Set i as light by this power; full scale says nothing. */
static pvx_err load(struct curve *w, size_t i, double power)
{
    const float *at[REC_MAX_CAMERAS];
    struct rec_check_set set;
    PVX_TRY(w->from.get(w->from.ctx, i, &set));
    float top = set.floats ? INFINITY : REC_PHOTO_FULL;
    for (size_t c = 0; c < w->s->rig.n_cameras; c++) {
        const float *p = set.picture[c];
        at[c] = p != NULL ? w->room[c] : NULL;
        for (size_t k = 0; k < w->s->bins[c] && p != NULL; k++)
            w->room[c][k] = p[k] >= top ? NAN : (float)(LIFT * bent((double)p[k], power));
    }
    rec_unseen_absorb(w->u, 0);
    rec_unseen_load(w->u, at, true);
    rec_unseen_absorb(w->u, power == 1 ? w->c / LIFT : 0);
    return PVX_OK;
}

/* What the volume misses of camera k's picture where it is bright, as the picture was. */
static double missed(struct curve *w, size_t k, double power, double *all)
{
    const rec_sysmat *S = rec_unseen_matrix(w->u);
    const float *b = rec_unseen_b(w->u, k), *wt = rec_unseen_weight(w->u, k), *e;
    const uint8_t *lit = rec_unseen_lit(w->u, k);
    double sigma = rec_unseen_sigma(w->u) / LIFT, sum = 0, top = 0,
           c = power == 1 ? w->c / LIFT : 0;
    rec_unseen_project(w->u, k, &e, NULL);
    *all = 0;
    for (size_t i = 0; i < S->row0[k + 1] - S->row0[k]; i++)
        top = wt[i] > 0 && lit[i] ? fmax(top, bent((double)b[i] / LIFT, 1 / power)) : top;
    for (size_t i = 0; i < S->row0[k + 1] - S->row0[k]; i++)
        if (wt[i] > 0 && lit[i]) {
            double due = bent(rec_absorb_seen(c, (double)e[i]) / LIFT, 1 / power);
            double is = bent((double)b[i] / LIFT, 1 / power);
            if (is < BRIGHT * top)
                continue;
            sum += (due - is) * (due - is);
            *all += is * is;
            w->noise += power == 1 ? sigma * sigma : 0;
        }
    return sum;
}

static pvx_err measure(struct curve *w, size_t power)
{
    size_t n = w->s->rig.n_cameras, sets = w->s->n < SETS ? w->s->n : SETS;
    bool sees[REC_MAX_CAMERAS], use[REC_MAX_CAMERAS];
    double all;
    w->views = 0;
    for (size_t j = 0; j < sets; j++) {
        PVX_TRY(load(w, (2 * j + 1) * w->from.n / (2 * sets), powers[power]));
        (void)rec_holdout_who(w->u, sees);
        for (size_t m = 0; m < VIEWS / SETS; m++) {
            size_t k = (j + m * n / (VIEWS / SETS)) % n;
            int32_t voxels;
            for (size_t c = 0; c < n; c++)
                use[c] = sees[c] && c != k;
            if (!sees[k])
                continue;
            PVX_TRY(rec_unseen_solve(w->u, use, &voxels));
            w->miss[power][w->views++] = missed(w, k, powers[power], &all);
            w->all += power == 0 ? all : 0;
        }
        double done = ((double)power + (double)(j + 1) / (double)sets) / (double)N_POWERS;
        if (!w->from.progress(w->from.ctx, done))
            return PVX_ECANCELED;
    }
    return PVX_OK;
}

static void judge(const struct curve *w, double least, struct advise_response *r)
{
    double total[N_POWERS] = {0};
    size_t best = 0;
    uint32_t better = 0;
    for (size_t k = 0; k < N_POWERS; k++) {
        for (uint32_t v = 0; v < w->views; v++)
            total[k] += w->miss[k][v];
        best = total[k] < total[best] ? k : best;
    }
    for (uint32_t v = 0; v < w->views; v++)
        better += w->miss[best][v] < w->miss[0][v];
    r->power = powers[best];
    r->error[0] = sqrt(total[0] / w->all);
    r->error[1] = sqrt(total[best] / w->all);
    r->on = total[0] - total[best] > least * fmax(total[0] - w->noise, 0) && best > 0 &&
            4 * better >= 3 * w->views;
}

pvx_err advise_response(struct flame_sets *s, struct advice *a, struct pvx_diag *d)
{
    struct curve w = {.s = s, .from = flame_sets_source(s, "response"), .c = a->absorption.c};
    pvx_err e = PVX_OK;
    a->response = (struct advise_response){.power = 1};
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        if ((w.room[c] = pvx_calloc(s->bins[c], sizeof(float))) == NULL)
            e = PVX_ENOMEM;
    if (e == PVX_OK)
        e = rec_unseen_new(&s->rig, &s->params, s->pool, &w.u, d);
    for (size_t k = 0; k < N_POWERS && e == PVX_OK; k++)
        e = measure(&w, k);
    if (e == PVX_OK && w.all > 0)
        judge(&w, advise_told(s, a) ? ADVISE_BENT : ADVISE_BENT_AT_LEAST, &a->response);
    rec_unseen_free(&w.u);
    for (size_t c = 0; c < s->rig.n_cameras; c++)
        free(w.room[c]);
    return e;
}

/* The pictures as light from now on. */
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
