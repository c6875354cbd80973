#include "recon/solve/blend.h"

#include <math.h>
#include <string.h>

#include "recon/solve/card.h"
#include "recon/solve/selfcal.h"

/* The rules; NUMERICS.md, 4, says how they were found. */
#define SHARP   0.065 /* share of ||x|| that the first iteration moves, */
#define FAR     0.04  /* and the fifth: many more follow */
#define NOISY   0.03 /* noise over the mean of b: with less, finer differences of the channels show */
#define SOME    0.04 /* the same: with more, further iterations bring less, */
#define SOONER  1.5  /* and the stop's shares are larger by up to this factor */
#define ALIKE   0.2  /* ||x - k s|| over ||x||, k of (4): mostly, the channels differ by a factor */
#define LARGE   200000 /* voxels of the grid: smaller ones save no time */
#define NOTHING 0.02F  /* e of (4) */

struct blend {
    const struct rec_pcg *t;
    struct rec_pcg *one;
    double c[4];
    double tint[4]; /* k of (4) */
    float least;    /* e of (4) */
};

/* c of (1). */
static void blend_weights(const rec_problem *pb, double c[4])
{
    double most = 0;
    for (int l = 0; l < 4; l++) {
        double s2 = pb->in.sigma[l] * pb->in.sigma[l];
        c[l] = l < pb->nch && s2 > 0 ? fmax(pb->light[l], 0) / s2 : 0;
        most = fmax(most, c[l]);
    }
    for (int l = 0; l < 4 && most > 0; l++)
        c[l] /= most;
}

static inline float blend_sum(rec_f4 c, rec_f4 v)
{
    v *= c;
    return (v[0] + v[1]) + v[2];
}

/* ---- the rules ------------------------------------------------------------------------------------*/

/* Sums of x s, s^2 and x^2, s = sum c x. */
static void blend_colours_chunk(void *ctx, size_t k)
{
    const struct blend *b = ctx;
    rec_problem *pb = b->t->pb;
    rec_f4 c = rec_coef(b->c);
    rec_d4 xs = {0}, ss = {0}, xx = {0};
    int32_t q0, q1;
    rec_chunk_range(pb->a->n, k, &q0, &q1);
    for (size_t q = (size_t)q0; q < (size_t)q1; q++) {
        rec_f4 x = rec_ld(b->t->x, q, 4), s = rec_splat(blend_sum(c, x));
        rec_add_product(&xs, x, s);
        rec_add_product(&ss, s, s);
        rec_add_product(&xx, x, x);
    }
    rec_put(pb->part[k][0], &xs);
    rec_put(pb->part[k][1], &ss);
    rec_put(pb->part[k][2], &xx);
}

/* ||x - k s||^2 / ||x||^2, k = x's / s's in each channel. */
static double blend_apart(const struct blend *b)
{
    rec_problem *pb = b->t->pb;
    const struct rec_card_ops *card = rec_card_of(pb->a);
    size_t chunks = rec_column_chunks(pb);
    double xs[4], ss[4], xx[4], rest = 0;
    if (card != NULL) {
        card->colours(b->t, b->c, xs, ss, xx);
    } else {
        pvx_pool_run(pb->a->pool, chunks, blend_colours_chunk, (void *)b);
        rec_sum(pb, 0, chunks, 0, xs);
        rec_sum(pb, 0, chunks, 1, ss);
        rec_sum(pb, 0, chunks, 2, xx);
    }
    for (int l = 0; l < pb->nch; l++)
        rest += xx[l] - (ss[l] > 0 ? xs[l] * xs[l] / ss[l] : 0);
    return rest / rec_lanes_total(xx);
}

/* Whether the problem can be blended at all. */
static bool blend_can(const struct rec_pcg *t, uint32_t renewals)
{
    const rec_problem *pb = t->pb;
    bool known =
        pb->one != NULL && !pb->in.per_channel && pb->in.least == NULL && t->expect == NULL;
    for (int l = 0; l < pb->nch; l++)
        known = known && pb->in.sigma[l] > 0;
    return known && pb->automatic && !rec_selfcal_due(pb, renewals > 0);
}

/* Noise over the mean of the sum. */
static double blend_noise(const rec_problem *pb, const double c[4])
{
    double noise2 = 0, mean = 0;
    for (int l = 0; l < pb->nch; l++) {
        noise2 += c[l] * c[l] * pb->in.sigma[l] * pb->in.sigma[l];
        mean += c[l] * pb->light[l] / rec_rows_of(pb, l);
    }
    return mean > 0 ? sqrt(noise2) / mean : 0;
}

double rec_blend_helps(const struct rec_pcg *t, const struct rec_stopper *stop, uint32_t renewals)
{
    const rec_problem *pb = t->pb;
    struct blend b = {.t = t};
    if (!blend_can(t, renewals))
        return 0;
    blend_weights(pb, b.c);
    double noise = blend_noise(pb, b.c);
    if (noise <= 0) /* there is no light */
        return 0;
    bool rules = stop->first > SHARP && stop->moved > FAR && noise >= NOISY &&
                 pb->a->S->grid.basis == REC_TRILINEAR &&
                 rec_grid_count(&pb->a->S->grid) >= LARGE && blend_apart(&b) <= ALIKE * ALIKE;
    return rules || stop->p->blend == REC_BLEND_ON ? fmin(fmax(noise / SOME, 1), SOONER) : 0;
}

/* ---- there ----------------------------------------------------------------------------------------*/

/* b, r, W r of (1) and (2); sum r'Wr. */
static void blend_rows_chunk(void *ctx, size_t k)
{
    const struct blend *b = ctx;
    const struct rec_pcg *t = b->t, *one = b->one;
    const rec_problem *pb = t->pb;
    rec_f4 c = rec_coef(b->c);
    double rwr[4] = {0};
    REC_FOR_ROWS (i, pb->a, k) {
        one->pb->b[i] = blend_sum(c, rec_ld(pb->b, i, 4));
        rwr[0] += rec_put_residual(one->pb, i, 0, blend_sum(c, rec_ld(t->r, i, 4)), &one->r[i],
                                   &one->q[i]);
    }
    memcpy(one->pb->part[k][0], rwr, sizeof rwr);
}
static void blend_columns_chunk(void *ctx, size_t k)
{
    const struct blend *b = ctx;
    rec_f4 c = rec_coef(b->c);
    int32_t q0, q1;
    rec_chunk_range(b->t->pb->a->n, k, &q0, &q1);
    for (size_t q = (size_t)q0; q < (size_t)q1; q++)
        b->one->x[q] = blend_sum(c, rec_ld(b->t->x, q, 4));
    memset(b->one->d + q0, 0, (size_t)(q1 - q0) * sizeof *b->one->d);
}

/* (3) of one weight. */
static double blend_weight(const rec_problem *pb, const double c[4], const double of[4])
{
    double sum = 0, all = 0;
    for (int l = 0; l < pb->nch; l++) {
        double share = c[l] * fmax(pb->light[l], 0);
        sum += share * log(of[l] / pb->unit[l]);
        all += share;
    }
    return pb->unit[0] * exp(sum / all);
}

/* The problem of (1): pb's, with one channel. */
static void blend_problem(const struct rec_pcg *t, const double c[4])
{
    const rec_problem *pb = t->pb;
    rec_problem *one = &pb->one->problem;
    struct rec_subsys *a = &pb->one->system;
    double sigma2 = 0, spread = 0;
    *a = *pb->a;
    a->cs = 1;
    *one = *pb;
    one->a = a;
    one->one = NULL;
    one->selfcal = NULL;
    one->nch = one->cs = 1;
    one->b = pb->bound;
    one->m = pb->m / pb->nch;
    one->lambda[0] = blend_weight(pb, c, t->lambda);
    one->formula[0] = blend_weight(pb, c, pb->formula);
    one->shot2[0] = 0;
    for (int l = 0; l < pb->nch; l++) {
        sigma2 += c[l] * c[l] * pb->in.sigma[l] * pb->in.sigma[l];
        one->shot2[0] += c[l] * c[l] * pb->shot2[l];
        spread += c[l] * sqrt(pb->noise2[l]);
    }
    one->in.sigma[0] = sqrt(sigma2);
    one->noise2[0] = spread * spread; /* the flame's part is the same in all channels */
}

void rec_blend_begin(struct rec_pcg *t, struct rec_pcg *one, double rwr[4])
{
    rec_problem *pb = t->pb;
    const struct rec_card_ops *card = rec_card_of(pb->a);
    struct blend b = {.t = t, .one = one};
    size_t rows = rec_row_chunks(pb), nowhere = pb->a->win.nowhere;
    blend_weights(pb, b.c);
    blend_problem(t, b.c);
    *one = *t;
    one->pb = &pb->one->problem;
    one->x = pb->corner;
    one->r = pb->yv[2];
    memset(one->lambda, 0, sizeof one->lambda);
    one->lambda[0] = one->pb->lambda[0];
    if (card != NULL) {
        card->blend(t, one, b.c, rwr);
        return;
    }
    memset(one->r + nowhere, 0, (pb->a->win.room - nowhere) * sizeof *one->r);
    memset(one->q + nowhere, 0, (pb->a->win.room - nowhere) * sizeof *one->q);
    pvx_pool_run(pb->a->pool, rows, blend_rows_chunk, &b);
    rec_sum(one->pb, 0, rows, 0, rwr);
    pvx_pool_run(pb->a->pool, rec_column_chunks(pb), blend_columns_chunk, &b);
}

/* ---- and back -------------------------------------------------------------------------------------*/

/* Sums of x, s_0. */
static void blend_tint_chunk(void *ctx, size_t k)
{
    const struct blend *b = ctx;
    rec_problem *pb = b->t->pb;
    rec_f4 c = rec_coef(b->c), unit = rec_splat(1);
    rec_d4 sum = {0}, all = {0};
    int32_t q0, q1;
    rec_chunk_range(pb->a->n, k, &q0, &q1);
    for (size_t q = (size_t)q0; q < (size_t)q1; q++) {
        rec_f4 x = rec_ld(b->t->x, q, 4);
        rec_add_product(&sum, x, unit);
        rec_add_product(&all, rec_splat(blend_sum(c, x)), unit);
    }
    rec_put(pb->part[k][0], &sum);
    rec_put(pb->part[k][1], &all);
}
static void blend_colour_chunk(void *ctx, size_t k)
{
    const struct blend *b = ctx;
    rec_f4 c = rec_coef(b->c), tint = rec_coef(b->tint), e = rec_splat(b->least);
    int32_t q0, q1;
    rec_chunk_range(b->t->pb->a->n, k, &q0, &q1);
    for (size_t q = (size_t)q0; q < (size_t)q1; q++) {
        rec_f4 x = rec_ld(b->t->x, q, 4);
        float s = b->one->x[q] / (blend_sum(c, x) + b->least);
        rec_st(b->t->x, q, 4, (x + e * tint) * rec_splat(s));
    }
}

void rec_blend_end(struct rec_pcg *t, const struct rec_pcg *one)
{
    rec_problem *pb = t->pb;
    const struct rec_card_ops *card = rec_card_of(pb->a);
    struct blend b = {.t = t, .one = (struct rec_pcg *)one};
    size_t chunks = rec_column_chunks(pb);
    double sum[4], all[4];
    blend_weights(pb, b.c);
    if (card != NULL) {
        card->tint(t, b.c, sum, all);
    } else {
        pvx_pool_run(pb->a->pool, chunks, blend_tint_chunk, &b);
        rec_sum(pb, 0, chunks, 0, sum);
        rec_sum(pb, 0, chunks, 1, all);
    }
    for (int l = 0; l < pb->nch; l++) {
        b.tint[l] = sum[l] / all[0];
        t->lambda[l] *= one->lambda[0] / one->pb->lambda[0];
    }
    if (all[0] <= 0) /* it is dark and has no colour */
        return;
    b.least = NOTHING * (float)(all[0] / pb->a->n);
    if (card != NULL)
        card->colour(t, one, b.c, b.tint, b.least);
    else
        pvx_pool_run(pb->a->pool, chunks, blend_colour_chunk, &b);
}
