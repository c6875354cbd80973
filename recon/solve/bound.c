#include "recon/solve/bound.h"

#include <string.h>

#include "recon/solve/impl.h"

struct raise {
    rec_problem *pb;
    float *r, *wr;
    const float *q;
    /* The reduction of the sum by one entry that has a bound: lane l at row i. */
    double (*less)(struct raise *t, size_t i, size_t l);
};

static void chunk(void *ctx, size_t k)
{
    struct raise *t = ctx;
    rec_problem *pb = t->pb;
    double less[4] = {0};
    REC_FOR_ROWS (i, pb->a, k) {
        uint8_t lanes = pb->a->is_row[i] && pb->in.least[i] > 0 ? pb->in.least_of[i] : 0;
        for (size_t l = 0; l < (size_t)pb->cs && lanes >> l != 0; l++)
            if ((lanes >> l & 1) != 0)
                less[l] += t->less(t, i, l);
    }
    memcpy(pb->part[k][0], less, sizeof less);
}

/* Reduces a sum of squares by t->less over all entries with bounds. */
static void reduce(struct raise *t, double sum[4])
{
    rec_problem *pb = t->pb;
    double less[4];
    if (pb->in.least == NULL)
        return;
    pvx_pool_run(pb->a->pool, rec_row_chunks(pb), chunk, t);
    rec_sum(pb, 0, rec_row_chunks(pb), 0, less);
    for (int l = 0; l < 4; l++)
        sum[l] = sum[l] > less[l] ? sum[l] - less[l] : 0;
}

/* w q^2 where the row is above its bound. */
static double freed(struct raise *t, size_t i, size_t l)
{
    const rec_problem *pb = t->pb;
    size_t at = i * (size_t)pb->cs + l;
    return pb->b[at] > pb->given[at] ? (double)rec_weight_at(pb, i, l) * t->q[at] * t->q[at] : 0;
}

void rec_bound_curvature(rec_problem *pb, const float *q, double qwq[4])
{
    reduce(&(struct raise){.pb = pb, .q = q, .less = freed}, qwq);
}

static double raised(struct raise *t, size_t i, size_t l)
{
    rec_problem *pb = t->pb;
    size_t at = i * (size_t)pb->cs + l;
    float seen = t->r[at] + pb->b[at], b = pb->given[at];
    double before = (double)t->wr[at] * t->r[at];
    pb->b[at] = seen > b ? seen : b;
    return before - rec_put_residual(pb, i, l, seen - pb->b[at], &t->r[at], &t->wr[at]);
}

void rec_bound_raise(rec_problem *pb, float *r, float *wr, double rwr[4])
{
    reduce(&(struct raise){.pb = pb, .r = r, .wr = wr, .less = raised}, rwr);
}
