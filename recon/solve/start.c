#include "recon/solve/start.h"

#include <math.h>
#include <string.h>

#include "recon/solve/card.h"

struct scaling {
    rec_problem *pb;
    float *x;
    float *r, *wr;
    float scale[4];
};

/* (1): rows of r = A x - b;  sums (A x)'W b, (A x)'W (A x). */
static void fit_chunk(void *ctx, size_t k)
{
    struct scaling *t = ctx;
    rec_problem *pb = t->pb;
    size_t cs = (size_t)pb->cs;
    double fit[4] = {0}, size[4] = {0};
    REC_FOR_ROWS (i, pb->a, k)
        for (size_t l = 0; l < cs; l++) {
            double b = pb->b[i * cs + l], ax = (double)t->r[i * cs + l] + b;
            double w = rec_weight_at(pb, i, l);
            fit[l] += w * ax * b;
            size[l] += w * ax * ax;
        }
    memcpy(pb->part[k][0], fit, sizeof fit);
    memcpy(pb->part[k][1], size, sizeof size);
}
/* Columns: x = alpha x.  Rows: r = alpha (r + b) - b, wr, r'Wr. */
static void scale_task(void *ctx, size_t i)
{
    struct scaling *t = ctx;
    rec_problem *pb = t->pb;
    size_t cs = (size_t)pb->cs, rows = rec_row_chunks(pb);
    int32_t i0, i1;
    double s[4] = {0};
    if (i >= rows) {
        rec_chunk_range(pb->a->n, i - rows, &i0, &i1);
        for (size_t q = (size_t)i0; q < (size_t)i1; q++)
            for (size_t l = 0; l < cs; l++)
                t->x[q * cs + l] *= t->scale[l];
        return;
    }
    REC_FOR_ROWS (k, pb->a, i)
        for (size_t l = 0; l < cs; l++) {
            float *r = &t->r[k * cs + l], b = pb->b[k * cs + l];
            s[l] += rec_put_residual(pb, k, l, t->scale[l] * (*r + b) - b, r, &t->wr[k * cs + l]);
        }
    memcpy(pb->part[i][0], s, sizeof s);
}
static void start_fit(struct scaling *t, double fit[4], double size[4])
{
    size_t rows = rec_row_chunks(t->pb);
    pvx_pool_run(t->pb->a->pool, rows, fit_chunk, t);
    rec_sum(t->pb, 0, rows, 0, fit);
    rec_sum(t->pb, 0, rows, 1, size);
}
static void start_scale(struct scaling *t)
{
    rec_problem *pb = t->pb;
    size_t rows = rec_row_chunks(pb);
    pvx_pool_run(pb->a->pool, rows + rec_column_chunks(pb), scale_task, t);
    rec_sum(pb, 0, rows, 0, pb->start_rwr);
}
static void start_zero_chunk(void *ctx, size_t k)
{
    struct scaling *t = ctx;
    rec_problem *pb = t->pb;
    size_t cs = (size_t)pb->cs;
    double s[4] = {0};
    REC_FOR_ROWS (i, pb->a, k)
        for (size_t l = 0; l < cs; l++)
            s[l] += rec_put_residual(pb, i, l, -pb->b[i * cs + l], &t->r[i * cs + l],
                                     &t->wr[i * cs + l]);
    memcpy(pb->part[k][0], s, sizeof s);
}

void rec_start_residual(rec_problem *pb, const float *x, double out[4])
{
    const struct rec_card_ops *card = rec_card_of(pb->a);
    struct scaling t = {.pb = pb, .r = pb->yv[0], .wr = pb->yv[1]};
    if (pb->start == REC_START_SCALED) {
        memcpy(out, pb->start_rwr, sizeof pb->start_rwr);
    } else if (pb->start == REC_START_ZERO && card != NULL) {
        rec_card_later(pb->a);
        card->zero_residual(pb, t.r, t.wr, out);
    } else if (pb->start == REC_START_ZERO) { /* r = -b */
        pvx_pool_run(pb->a->pool, rec_row_chunks(pb), start_zero_chunk, &t);
        rec_sum(pb, 0, rec_row_chunks(pb), 0, out);
    } else { /* r = A x - b */
        rec_card_later(pb->a);
        rec_residual(pb, x, t.r, t.wr, out);
    }
}

void rec_start_zero(rec_problem *pb, float *x)
{
    rec_clear_x(pb, x);
    pb->start = REC_START_ZERO;
}

void rec_start_scaled(rec_problem *pb, float *x)
{
    const struct rec_card_ops *card = rec_card_of(pb->a);
    struct scaling t = {.pb = pb, .x = x, .r = pb->yv[0], .wr = pb->yv[1]};
    double fit[4], size[4], rwr[4];
    rec_card_later(pb->a);
    rec_residual(pb, x, t.r, t.wr, rwr);
    if (card != NULL)
        card->fit(pb, t.r, fit, size);
    else
        start_fit(&t, fit, size);
    for (int l = 0; l < 4; l++) {
        t.scale[l] = size[l] > 0 && fit[l] > 0 ? (float)(fit[l] / size[l]) : 0;
        if (!isfinite(t.scale[l]))
            t.scale[l] = 0;
    }
    if (card != NULL)
        card->scale(pb, t.scale, x, t.r, t.wr, pb->start_rwr);
    else
        start_scale(&t);
    pb->start = REC_START_SCALED;
}

void rec_start_earlier(rec_problem *pb, float *x)
{
    if (pb->any && rec_norm_x(pb, x) > 0)
        rec_start_scaled(pb, x);
    else
        pb->start = REC_START_ZERO;
}

/* ---- of the multiplicative methods --------------------------------------------------------------*/

struct positive {
    rec_problem *pb;
    const float *sens;
    float *x;
    float least[4];
};

/* Rows: light, w max(b, 0). */
static void light_chunk(void *ctx, size_t k)
{
    struct positive *t = ctx;
    rec_problem *pb = t->pb;
    size_t cs = (size_t)pb->cs;
    double sum[4] = {0};
    REC_FOR_ROWS (i, pb->a, k)
        for (size_t l = 0; l < cs; l++)
            sum[l] += (double)pb->w[i] * fmaxf(pb->b[i * cs + l], 0);
    memcpy(pb->part[k][0], sum, sizeof sum);
}

static void lift_chunk(void *ctx, size_t k)
{
    struct positive *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->pb->a->n, k, &q0, &q1);
    size_t cs = (size_t)t->pb->cs;
    for (size_t i = (size_t)q0; i < (size_t)q1; i++)
        for (size_t l = 0; l < cs; l++)
            t->x[i * cs + l] = t->sens[i] > 0 ? fmaxf(t->x[i * cs + l], t->least[l]) : 0;
}

void rec_start_positive(rec_problem *pb, const float *sens, float *x)
{
    size_t rows = rec_row_chunks(pb);
    struct positive t = {.pb = pb, .sens = sens, .x = x};
    double light[4], weight = 0;
    pvx_pool_run(pb->a->pool, rows, light_chunk, &t);
    rec_sum(pb, 0, rows, 0, light);
    for (int32_t q = 0; q < pb->a->n; q++)
        weight += sens[q];
    double share = rec_norm_x(pb, x) > 0 ? 1e-2 : 1;
    for (int l = 0; l < 4; l++)
        t.least[l] = weight > 0 ? (float)(share * light[l] / weight) : 0;
    pvx_pool_run(pb->a->pool, rec_column_chunks(pb), lift_chunk, &t);
}
