/* bodies.c - dark bodies before a camera: bins that stay dark over the whole recording although the volume of the
 * other cameras has light there.  That light may be a ghost, if the other cameras are few.  So a second test is made:
 * a volume that these bins do not carve must explain the pictures of the other cameras better. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "daemon/cli/advise/advise.h"
#include "recon/check/holdout.h"

#define SETS   4
#define DARK   0.2 /* a bin is dark below this share of the light expected there */
#define DUE    0.1 /* least expected light, of the camera's brightest; means of the recording */
#define LEAST  6   /* bins */
#define ROUNDS 2   /* bodies of one camera show better after those of another are masked */
#define MOST   0.7 /* of a camera's light: beyond it the camera itself is dark */

struct dark {
    struct flame_sets *s;
    struct rec_check_source from;
    rec_unseen *u;
    size_t n;       /* sets */
    float *b, *p;   /* [rows] means over the sets */
    uint8_t *part;  /* [rows] 1: dark, 2: of the largest part */
    int32_t *stack; /* [rows] */
    float *room;    /* [bins of the largest picture] */
};

static pvx_err bodies_load(struct dark *w, size_t j, struct rec_check_set *set)
{
    PVX_TRY(w->from.get(w->from.ctx, (2 * j + 1) * w->from.n / (2 * w->n), set));
    rec_unseen_load(w->u, set->picture, set->floats);
    return PVX_OK;
}

/* Mean pictures: b as every camera sees it, p as the volume of the other cameras predicts it. */
static pvx_err bodies_means(struct dark *w)
{
    const rec_sysmat *S = rec_unseen_matrix(w->u);
    size_t rows = S->row0[S->n_cameras];
    struct rec_check_set set;
    memset(w->b, 0, rows * sizeof *w->b);
    memset(w->p, 0, rows * sizeof *w->p);
    for (size_t j = 0; j < w->n; j++) {
        PVX_TRY(bodies_load(w, j, &set));
        for (size_t c = 0; c < S->n_cameras; c++) {
            const float *b = rec_unseen_b(w->u, c), *wt = rec_unseen_weight(w->u, c), *p;
            bool use[REC_MAX_CAMERAS];
            int32_t n;
            for (size_t k = 0; k < S->n_cameras; k++)
                use[k] = k != c;
            if (!rec_unseen_present(w->u, c))
                continue;
            PVX_TRY(rec_unseen_solve(w->u, use, &n));
            rec_unseen_project(w->u, c, &p, NULL);
            for (size_t i = 0; i < S->row0[c + 1] - S->row0[c]; i++) {
                w->b[S->row0[c] + i] += (wt[i] > 0 ? b[i] : INFINITY) / (float)w->n;
                w->p[S->row0[c] + i] += p[i] / (float)w->n;
            }
        }
        if (!w->from.progress(w->from.ctx, (double)(j + 1) / (double)w->n))
            return PVX_ECANCELED;
    }
    return PVX_OK;
}

/* Mark the connected part around bin i with `as`.  Returns the light expected in it. */
static double bodies_fill(struct dark *w, size_t c, int32_t i, uint8_t from, uint8_t as,
                          int32_t *bins)
{
    const struct rec_sysmat_block *k = &rec_unseen_matrix(w->u)->block[c];
    size_t row0 = rec_unseen_matrix(w->u)->row0[c];
    int32_t n = 0;
    double light = 0;
    w->stack[n++] = i;
    w->part[row0 + (size_t)i] = as;
    for (*bins = 0; n > 0; ++*bins) {
        int32_t at = w->stack[--n], x = at % k->bw, y = at / k->bw;
        light += (double)w->p[row0 + (size_t)at];
        for (int32_t v = y > 0 ? y - 1 : 0; v <= y + 1 && v < k->bh; v++)
            for (int32_t u = x > 0 ? x - 1 : 0; u <= x + 1 && u < k->bw; u++)
                if (w->part[row0 + (size_t)(v * k->bw + u)] == from) {
                    w->part[row0 + (size_t)(v * k->bw + u)] = as;
                    w->stack[n++] = v * k->bw + u;
                }
    }
    return light;
}

/* Mark with 2 the part of camera c where most light is missing.  Returns its share of the light that c should see. */
static double bodies_largest(struct dark *w, size_t c)
{
    const rec_sysmat *S = rec_unseen_matrix(w->u);
    size_t row0 = S->row0[c], bins = S->row0[c + 1] - row0;
    float top = 0;
    double all = 0, most = 0;
    int32_t best = -1, n;
    for (size_t i = row0; i < row0 + bins; i++) {
        top = fmaxf(top, w->p[i]);
        all += (double)w->p[i];
    }
    for (size_t i = row0; i < row0 + bins; i++)
        w->part[i] = w->p[i] > (float)DUE * top && w->b[i] < (float)DARK * w->p[i];
    for (size_t i = 0; i < bins; i++)
        if (w->part[row0 + i] == 1) {
            double light = bodies_fill(w, c, (int32_t)i, 1, 3, &n);
            if (n >= LEAST && light > most) {
                most = light;
                best = (int32_t)i;
            }
        }
    if (best >= 0)
        (void)bodies_fill(w, c, best, 3, 2, &n);
    return all > 0 ? most / all : 0;
}

/* Squared error of the other cameras' pictures with the part's bins as they are (0), and without these bins (1). */
static pvx_err bodies_judge(struct dark *w, size_t c, double miss[2], double *size)
{
    const rec_sysmat *S = rec_unseen_matrix(w->u);
    size_t row0 = S->row0[c], bins = S->row0[c + 1] - row0;
    const float *at[REC_MAX_CAMERAS];
    int32_t n;
    miss[0] = miss[1] = *size = 0;
    for (size_t j = 0; j < w->n; j++)
        for (int without = 0; without < 2; without++) {
            struct rec_check_set set;
            double all;
            PVX_TRY(bodies_load(w, j, &set));
            if (set.picture[c] == NULL)
                continue;
            memcpy(at, set.picture, S->n_cameras * sizeof *at);
            memcpy(w->room, at[c], bins * sizeof *w->room);
            for (size_t i = 0; i < bins && without; i++)
                if (w->part[row0 + i] == 2)
                    w->room[i] = NAN;
            at[c] = w->room;
            rec_unseen_load(w->u, at, set.floats);
            PVX_TRY(rec_unseen_solve(w->u, NULL, &n));
            for (size_t k = 0; k < S->n_cameras; k++)
                if (k != c && rec_unseen_present(w->u, k)) {
                    miss[without] += rec_holdout_miss(w->u, k, 0, &all);
                    *size += without ? all : 0;
                }
        }
    return PVX_OK;
}

/* The rectangle around the part, in raw pixels. */
static void bodies_frame(const struct dark *w, size_t c, struct advise_body *b)
{
    const rec_sysmat *S = rec_unseen_matrix(w->u);
    const struct rec_sysmat_block *k = &S->block[c];
    const uint8_t *part = w->part + S->row0[c];
    int32_t lo[2] = {k->bw, k->bh}, hi[2] = {-1, -1};
    for (int32_t i = 0; i < k->bw * k->bh; i++)
        for (int a = 0; a < 2 && part[i] == 2; a++) {
            int32_t v = a == 0 ? i % k->bw : i / k->bw;
            lo[a] = v < lo[a] ? v : lo[a];
            hi[a] = v > hi[a] ? v : hi[a];
        }
    for (int a = 0; a < 2; a++) {
        b->from[a] = lo[a] * S->binning;
        b->to[a] = (hi[a] + 1) * S->binning - 1;
    }
}

/* Set the part's bins and those around them to NaN in all sets. */
static void bodies_mask(struct dark *w, size_t c)
{
    const rec_sysmat *S = rec_unseen_matrix(w->u);
    int32_t bw = S->block[c].bw, bh = S->block[c].bh;
    const uint8_t *part = w->part + S->row0[c];
    size_t lanes = w->s->nch == 3 ? 4 : 1;
    for (int32_t i = 0; i < bw * bh; i++) {
        bool near = false;
        for (int32_t y = i / bw - 1; y <= i / bw + 1; y++)
            for (int32_t x = i % bw - 1; x <= i % bw + 1; x++)
                near |= x >= 0 && y >= 0 && x < bw && y < bh && part[y * bw + x] == 2;
        for (size_t k = 0; k < w->s->n && near; k++)
            for (size_t l = 0; l < lanes && w->s->picture[k][c] != NULL; l++)
                w->s->picture[k][c][(size_t)i * lanes + l] = NAN;
    }
}

/* Look at all cameras once.  found[]: the bodies found so far.  *more: whether new ones were found. */
static pvx_err bodies_look(struct dark *w, struct advise_body *found, bool *more)
{
    PVX_TRY(bodies_means(w));
    *more = false;
    for (size_t c = 0; c < w->s->rig.n_cameras; c++) {
        struct advise_body b = {.share = bodies_largest(w, c)};
        if (b.share < ADVISE_HIDDEN || b.share > MOST || found[c].share > 0)
            continue;
        double miss[2], size;
        PVX_TRY(bodies_judge(w, c, miss, &size));
        if (!(size > 0) || miss[1] > (1 - ADVISE_HIDDEN_BUYS) * miss[0])
            continue;
        for (int k = 0; k < 2; k++)
            b.error[k] = sqrt(miss[k] / size);
        bodies_frame(w, c, &b);
        found[c] = b;
        *more = true;
    }
    return PVX_OK;
}

static pvx_err bodies_allocate(struct dark *w)
{
    const rec_sysmat *S = rec_unseen_matrix(w->u);
    size_t rows = S->row0[S->n_cameras];
    w->b = pvx_calloc(rows, sizeof *w->b);
    w->p = pvx_calloc(rows, sizeof *w->p);
    w->part = pvx_calloc(rows, 1);
    w->stack = pvx_calloc(rows, sizeof *w->stack);
    w->room = pvx_calloc(rows, sizeof *w->room);
    bool all =
        w->b != NULL && w->p != NULL && w->part != NULL && w->stack != NULL && w->room != NULL;
    return all ? PVX_OK : PVX_ENOMEM;
}

pvx_err advise_bodies(struct flame_sets *s, struct advise_body *found, struct pvx_diag *d)
{
    struct dark w = {.s = s, .from = flame_sets_source(s, "bodies")};
    bool more = true;
    w.n = s->n < SETS ? s->n : SETS;
    memset(found, 0, REC_MAX_CAMERAS * sizeof *found);
    PVX_TRY(rec_unseen_new(&s->rig, &s->params, s->pool, &w.u, d));
    pvx_err e = bodies_allocate(&w);
    for (int round = 0; round < ROUNDS && more && e == PVX_OK; round++) {
        bool was[REC_MAX_CAMERAS];
        for (size_t c = 0; c < s->rig.n_cameras; c++)
            was[c] = found[c].share > 0;
        e = bodies_look(&w, found, &more);
        for (size_t c = 0; c < s->rig.n_cameras && e == PVX_OK; c++)
            if (found[c].share > 0 && !was[c])
                bodies_mask(&w, c);
    }
    rec_unseen_free(&w.u);
    free(w.b);
    free(w.p);
    free(w.part);
    free(w.stack);
    free(w.room);
    return e;
}
