#include "recon/solve/bound.h"

#include <string.h>

#include "recon/solve/impl.h"

struct raise {
    rec_problem *pb;
    float *r, *wr;
    const float *q;
};

/* Sum of w q^2 over rows that are above their bounds. */
static void free_chunk(void *ctx, size_t k)
{
    struct raise *t = ctx;
    rec_problem *pb = t->pb;
    size_t cs = (size_t)pb->cs;
    double less[4] = {0};
    REC_FOR_ROWS (i, pb->a, k) {
        uint8_t lanes = pb->a->is_row[i] && pb->in.least[i] > 0 ? pb->in.least_of[i] : 0;
        for (size_t l = 0; l < cs && lanes >> l != 0; l++) {
            size_t at = i * cs + l;
            if ((lanes >> l & 1) != 0 && pb->b[at] > pb->in.b[at])
                less[l] += (double)rec_weight_at(pb, i, l) * t->q[at] * t->q[at];
        }
    }
    memcpy(pb->part[k][0], less, sizeof less);
}

void rec_bound_curvature(rec_problem *pb, const float *q, double qwq[4])
{
    struct raise t = {.pb = pb, .q = q};
    double less[4];
    if (pb->in.least == NULL)
        return;
    pvx_pool_run(pb->a->pool, rec_row_chunks(pb), free_chunk, &t);
    rec_sum(pb, 0, rec_row_chunks(pb), 0, less);
    for (int l = 0; l < 4; l++)
        qwq[l] = qwq[l] > less[l] ? qwq[l] - less[l] : 0;
}

/* Sum of what r'Wr becomes less by. */
static void raise_chunk(void *ctx, size_t k)
{
    struct raise *t = ctx;
    rec_problem *pb = t->pb;
    size_t cs = (size_t)pb->cs;
    double less[4] = {0};
    REC_FOR_ROWS (i, pb->a, k) {
        uint8_t lanes = pb->a->is_row[i] && pb->in.least[i] > 0 ? pb->in.least_of[i] : 0;
        for (size_t l = 0; l < cs && lanes >> l != 0; l++) {
            size_t at = i * cs + l;
            if ((lanes >> l & 1) == 0)
                continue;
            float seen = t->r[at] + pb->b[at], b = pb->in.b[at];
            double before = (double)t->wr[at] * t->r[at];
            pb->b[at] = seen > b ? seen : b;
            less[l] += before - rec_put_residual(pb, i, l, seen - pb->b[at], &t->r[at], &t->wr[at]);
        }
    }
    memcpy(pb->part[k][0], less, sizeof less);
}

void rec_bound_raise(rec_problem *pb, float *r, float *wr, double rwr[4])
{
    struct raise t = {.pb = pb, .r = r, .wr = wr};
    double less[4];
    if (pb->in.least == NULL)
        return;
    pvx_pool_run(pb->a->pool, rec_row_chunks(pb), raise_chunk, &t);
    rec_sum(pb, 0, rec_row_chunks(pb), 0, less);
    for (int l = 0; l < 4; l++)
        rwr[l] = rwr[l] > less[l] ? rwr[l] - less[l] : 0;
}
