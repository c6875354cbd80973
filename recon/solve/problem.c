#include "recon/solve/problem.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/solve/card.h"
#include "recon/solve/selfcal.h"

#define PAGE 4096

/* Places `bytes` more after `base`, in pages of their own. */
static void *problem_place(char *base, size_t *end, size_t bytes)
{
    size_t at = *end;
    *end += (bytes + PAGE - 1) / PAGE * PAGE;
    return base == NULL ? NULL : base + at;
}

/* Places all work areas one after the other; returns their total size. */
static size_t problem_lay_out(rec_problem *pb, char *base)
{
    size_t n = pb->n_max, rows = pb->room, lane = (size_t)pb->cs * sizeof(float), end = 0;
    for (int i = 0; i < N_XVEC; i++)
        pb->xv[i] = problem_place(base, &end, n * lane);
    for (int i = 0; i < N_YVEC; i++)
        pb->yv[i] = problem_place(base, &end, rows * lane);
    pb->corner = problem_place(base, &end, n * lane);
    pb->before = problem_place(base, &end, n * lane);
    pb->b = problem_place(base, &end, rows * lane);
    pb->bound = problem_place(base, &end, rows * lane);
    pb->w = problem_place(base, &end, rows * sizeof *pb->w);
    pb->w4 = problem_place(base, &end, rows * 4 * sizeof *pb->w4);
    pb->column = problem_place(base, &end, n * sizeof *pb->column);
    pb->run = problem_place(base, &end, n * sizeof *pb->run);
    pb->diag2 = problem_place(base, &end, n * sizeof *pb->diag2);
    pb->stiff.by = problem_place(base, &end, n * sizeof *pb->stiff.by);
    pb->stiff.inverse = problem_place(base, &end, n * sizeof *pb->stiff.inverse);
    pb->stiff.diag = problem_place(base, &end, n * sizeof *pb->stiff.diag);
    pb->clipped = problem_place(base, &end, n * sizeof *pb->clipped);
    return end;
}

pvx_err rec_problem_new(const rec_sysmat *S, int nch, rec_problem **out)
{
    *out = NULL;
    if (nch != 1 && nch != 3)
        return PVX_EINVAL;
    rec_problem *pb = pvx_calloc(1, sizeof *pb);
    if (pb == NULL)
        return PVX_ENOMEM;
    pb->nch = nch;
    pb->cs = nch == 3 ? 4 : 1;
    pb->n_max = rec_grid_count(&S->grid);
    pb->room = S->win.room;
    pb->bytes = problem_lay_out(pb, NULL);
    pb->areas = pvx_reserve(pb->bytes);
    pb->one = nch == 3 ? pvx_calloc(1, sizeof *pb->one) : NULL;
    if ((nch == 3 && pb->one == NULL) || pb->areas == NULL ||
        rec_images_new(S, pb->cs, &pb->images) != PVX_OK) {
        rec_problem_free(&pb);
        return PVX_ENOMEM;
    }
    problem_lay_out(pb, pb->areas);
    *out = pb;
    return PVX_OK;
}

void rec_problem_free(rec_problem **pb)
{
    if (*pb == NULL)
        return;
    free((*pb)->one);
    pvx_unreserve((*pb)->areas, (*pb)->bytes);
    rec_images_free(&(*pb)->images);
    PVX_FREE(*pb);
}

/* ---- what the methods share ---------------------------------------------------------------------*/

void rec_sum(const rec_problem *pb, size_t from, size_t to, int what, double out[4])
{
    for (int l = 0; l < 4; l++) {
        double s = 0;
        for (size_t k = from; k < to; k++)
            s += pb->part[k][what][l];
        out[l] = s;
    }
}

double rec_norm_x(rec_problem *pb, const float *v)
{
    const struct rec_card_ops *card = rec_card_of(pb->a);
    double d[4];
    if (card != NULL)
        card->square(pb, v, d);
    else
        rec_dot(pb->a, pb->a->n, v, v, d);
    return sqrt(rec_lanes_total(d));
}

struct copy {
    const rec_problem *pb;
    float *dst;
    const float *src;
};
static void copy_chunk(void *ctx, size_t k)
{
    struct copy *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->pb->a->n, k, &q0, &q1);
    size_t cs = (size_t)t->pb->cs, o = (size_t)q0 * cs;
    memcpy(t->dst + o, t->src + o, (size_t)(q1 - q0) * cs * sizeof *t->dst);
}
void rec_copy_x(rec_problem *pb, float *dst, const float *src)
{
    const struct rec_card_ops *card = rec_card_of(pb->a);
    struct copy t = {pb, dst, src};
    if (card != NULL)
        card->copy(pb, dst, src);
    else
        pvx_pool_run(pb->a->pool, rec_column_chunks(pb), copy_chunk, &t);
}

void rec_clear_x(rec_problem *pb, float *x)
{
    const struct rec_card_ops *card = rec_card_of(pb->a);
    if (card != NULL)
        card->clear(pb, x);
    else
        memset(x, 0, (size_t)pb->a->n * (size_t)pb->cs * sizeof *x);
}

struct residual {
    rec_problem *pb;
    struct rec_rows to;
};
REC_INLINE void residual(const struct residual *t, size_t i, size_t cs, bool per_channel,
                         rec_d4 *sum)
{
    rec_f4 v = rec_ld(t->to.r, i, cs) - rec_ld(t->pb->b, i, cs);
    rec_put_row(t->pb, &t->to, i, cs, per_channel, v, sum);
}
static void residual_chunk(void *ctx, size_t k)
{
    struct residual *t = ctx;
    const struct rec_subsys *a = t->pb->a;
    rec_d4 sum = {0}, quads = {0};
    rec_take_product(t->pb, k, t->to.r);
    if (t->pb->in.per_channel)
        REC_FOR_ROWS (i, a, k)
            residual(t, i, 4, true, &sum);
    else if (a->cs == 4)
        REC_FOR_ROWS (i, a, k)
            residual(t, i, 4, false, &sum);
    else
        REC_FOR_ROW_QUADS (i, a, k)
            residual(t, i, REC_QUAD, false, &quads);
    rec_put_both(t->pb->part[k][0], &sum, &quads);
}
void rec_residual(rec_problem *pb, const float *x, float *r, float *wr, double out[4])
{
    const struct rec_card_ops *card = rec_card_of(pb->a);
    struct residual t = {.pb = pb, .to = {r, wr}};
    if (card != NULL) {
        card->residual(pb, x, r, wr, out);
        return;
    }
    rec_start_product(pb, x);
    pvx_pool_run(pb->a->pool, rec_row_chunks(pb), residual_chunk, &t);
    rec_sum(pb, 0, rec_row_chunks(pb), 0, out);
}

/* ---- the way in ---------------------------------------------------------------------------------*/

/* Weight of row i from the pictures: that of all channels.  With weights per channel, stores each and returns the
 * largest. */
static float load_weight(rec_problem *pb, size_t i, double measured[4], double sum[4])
{
    float least = pb->in.least != NULL && pb->in.least_of[i] != 0 ? pb->in.least[i] : 0, most = 0;
    if (!pb->in.per_channel)
        return least > 0 ? least : pb->in.w[i];
    const float *w = pb->in.w + i * 4;
    for (size_t l = 0; l < 3; l++) {
        float of = least > 0 ? (float)(pb->in.least_of[i] >> l & 1) * least : w[l];
        pb->w4[i * 4 + l] = of;
        measured[l] += of > 0;
        sum[l] += (double)of;
        most = of > most ? of : most;
    }
    pb->w4[i * 4 + 3] = 0;
    sum[3] += (double)most;
    return most;
}

/* A bin that is not a row has weight 0. */
static void load_nothing(rec_problem *pb, size_t i)
{
    size_t cs = (size_t)pb->cs;
    pb->w[i] = 0;
    memset(pb->b + i * cs, 0, cs * sizeof *pb->b);
    if (pb->in.per_channel)
        memset(pb->w4 + i * 4, 0, 4 * sizeof *pb->w4);
}

/* Sets b and w on A's rows; sums struct rec_card_load. */
static void load_chunk(void *ctx, size_t k)
{
    rec_problem *pb = ctx;
    const struct rec_subsys *a = pb->a;
    size_t cs = (size_t)pb->cs;
    double norm = 0, rows = 0, ones = 0, light[4] = {0}, measured[4] = {0}, sum[4] = {0};
    REC_FOR_ROWS (i, a, k) {
        if (!a->is_row[i]) {
            load_nothing(pb, i);
            continue;
        }
        float w = load_weight(pb, i, measured, sum);
        pb->w[i] = w;
        rows += w > 0;
        ones += w == 1;
        for (size_t l = 0; l < cs; l++) {
            float b = pb->in.b[i * cs + l], wl = rec_weight_at(pb, i, l);
            pb->b[i * cs + l] = b;
            norm += (double)wl * b * b;
            light[l] += (double)wl * b;
        }
    }
    memset(pb->part[k][0], 0, sizeof pb->part[k][0]);
    pb->part[k][0][0] = norm;
    pb->part[k][0][1] = rows;
    pb->part[k][0][2] = ones;
    memcpy(pb->part[k][1], light, sizeof light);
    memcpy(pb->part[k][2], measured, sizeof measured);
    memcpy(pb->part[k][3], sum, sizeof sum);
}

static void load_rows(rec_problem *pb, struct rec_card_load *out)
{
    const struct rec_subsys *a = pb->a;
    size_t rows = rec_row_chunks(pb);
    double sum[4];
    /* Clears the place of windows that do not exist: rows of another level may have been there. */
    size_t nowhere = a->win.nowhere * (size_t)pb->cs, end = a->win.room * (size_t)pb->cs;
    for (int i = 0; i < N_YVEC; i++)
        memset(pb->yv[i] + nowhere, 0, (end - nowhere) * sizeof *pb->yv[i]);
    pvx_pool_run(a->pool, rows, load_chunk, pb);
    rec_sum(pb, 0, rows, 0, sum);
    rec_sum(pb, 0, rows, 1, out->light);
    rec_sum(pb, 0, rows, 2, out->measured);
    rec_sum(pb, 0, rows, 3, out->weight);
    out->norm2 = sum[0];
    out->rows = sum[1];
    out->ones = sum[2];
}

bool rec_problem_load(rec_problem *pb, const struct rec_subsys *a, const struct rec_pictures *in)
{
    pb->a = a;
    pb->in = *in;
    pb->given = in->b;
    pb->weighed = false;
    pb->expect = NULL;
    pb->frozen = NULL;
    pb->start = REC_START_NONE;
    pb->renewals = REC_RENEWALS;
    const struct rec_card_ops *card = rec_card_of(a);
    struct rec_card_load sum = {0};
    if (card != NULL)
        card->load(pb, &sum);
    else
        load_rows(pb, &sum);
    memcpy(pb->light, sum.light, sizeof pb->light);
    memcpy(pb->measured, sum.measured, sizeof pb->measured);
    pb->b_norm2 = sum.norm2;
    pb->m = sum.rows * pb->nch;
    pb->diagonal = sum.diagonal;
    pb->chord = sum.chord;
    pb->whole = sum.ones == a->rows;
    for (int l = 0; l < 4; l++)
        pb->share[l] = 1;
    if (in->per_channel) {
        pb->m = rec_lanes_total(pb->measured);
        for (int l = 0; l < 4 && sum.weight[3] > 0; l++)
            pb->share[l] = l < 3 ? sum.weight[l] / sum.weight[3] : 1;
    }
    rec_selfcal_apply(pb);
    pb->any = a->n > 0 && a->nnz > 0 && pb->m > 0 && pb->b_norm2 > 0;
    return pb->any;
}
