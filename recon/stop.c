#include "recon/solve/stop.h"

#include <math.h>
#include <string.h>

#define BEYOND 6   /* points after a corner before it is believed */
#define NEAR   4.0 /* residual^2 over sigma^2 m from which a stall counts */

void rec_stop_begin(struct rec_stopper *t, struct rec_job *j, const struct rec_stop_own *own,
                    float *best, float *prev)
{
    enum rec_stop rule = j->p->stop;
    bool own_rule = rule == REC_STOP_AUTO;
    if (own_rule)
        rule = own->gain > 0 ? REC_STOP_ITERATIONS
               : own->corner ? REC_STOP_LCURVE
                             : REC_STOP_DISCREPANCY;
    *t = (struct rec_stopper){.j = j, .best = best, .prev = prev};
    t->corner = rule == REC_STOP_LCURVE;
    t->noise2 = rule == REC_STOP_DISCREPANCY ? rec_job_noise2(j) : 0;
    t->stall = own_rule && t->noise2 > 0 ? own->stall : 0;
    t->gain = own->gain;
    t->objective = j->out->objective;
    t->limit = rule == REC_STOP_DISCREPANCY && j->sigma < 0 ? own->blind : own->most;
    if (j->p->iterations > 0)
        t->limit = j->p->iterations;
}

bool rec_stop_next(struct rec_stopper *t)
{
    if (t->k < t->limit && !rec_job_late(t->j))
        return true;
    t->j->out->status = t->k < t->limit ? REC_DEADLINE : REC_MAX_ITER;
    return false;
}

bool rec_stop_after(struct rec_stopper *t, const float *x, double objective, double residual2)
{
    struct rec_job *j = t->j;
    double residual = sqrt(residual2);
    t->k++;
    j->out->iterations = j->out->best = t->k;
    j->out->objective = objective;
    if (j->trace != NULL)
        j->trace(j->trace_ctx, t->k, x, objective, residual);
    bool done = t->noise2 > 0 && residual2 <= t->noise2;
    if (t->stall > 0 && t->k > 1 && residual2 <= NEAR * t->noise2)
        done = done || t->last - residual2 <= t->stall * residual2;
    t->last = residual2;
    if (t->corner) {
        if (rec_lcurve_add(&t->curve, t->k, residual, rec_job_norm_x(j, x))) {
            float *swap = t->best;
            t->best = t->prev;
            t->prev = swap;
            t->best_objective = t->prev_objective;
        }
        done = rec_lcurve_done(&t->curve, t->k, BEYOND);
        rec_job_copy(j, t->prev, x);
        t->prev_objective = objective;
    }
    done = done || (t->gain > 0 && t->objective - objective <= t->gain * objective);
    t->objective = objective;
    if (done)
        j->out->status = REC_CONVERGED;
    return done;
}

bool rec_stop_end(struct rec_stopper *t, float *x)
{
    if (!t->corner || t->curve.best_k == 0)
        return false;
    rec_job_copy(t->j, x, t->best);
    t->j->out->best = t->curve.best_k;
    t->j->out->objective = t->best_objective;
    return true;
}

struct start {
    struct rec_job *j;
    const float *sens;
    float *x;
    float least[4];
};

/* Rows: light, w max(b, 0). */
static void light_chunk(void *ctx, size_t k)
{
    struct start *t = ctx;
    int32_t i0, i1;
    size_t cs = (size_t)t->j->a->cs;
    double sum[4] = {0};
    rec_chunk_range(t->j->a->rows, k, &i0, &i1);
    for (size_t i = (size_t)i0; i < (size_t)i1; i++)
        for (size_t l = 0; l < cs; l++)
            sum[l] += (double)t->j->w[i] * fmaxf(t->j->b[i * cs + l], 0);
    memcpy(t->j->s->part[k][0], sum, sizeof sum);
}

static void lift_chunk(void *ctx, size_t k)
{
    struct start *t = ctx;
    int32_t q0, q1;
    rec_chunk_range(t->j->a->n, k, &q0, &q1);
    size_t cs = (size_t)t->j->a->cs;
    for (size_t i = (size_t)q0; i < (size_t)q1; i++)
        for (size_t l = 0; l < cs; l++)
            t->x[i * cs + l] = t->sens[i] > 0 ? fmaxf(t->x[i * cs + l], t->least[l]) : 0;
}

void rec_positive_start(struct rec_job *j, const float *sens, float *x)
{
    size_t rows = rec_job_row_chunks(j);
    struct start t = {.j = j, .sens = sens, .x = x};
    double light[4], weight = 0;
    pvx_pool_run(j->a->pool, rows, light_chunk, &t);
    rec_job_sum(j, 0, rows, 0, light);
    for (int32_t q = 0; q < j->a->n; q++)
        weight += sens[q];
    double share = rec_job_norm_x(j, x) > 0 ? 1e-2 : 1;
    for (int l = 0; l < 4; l++)
        t.least[l] = weight > 0 ? (float)(share * light[l] / weight) : 0;
    pvx_pool_run(j->a->pool, rec_job_chunks(j), lift_chunk, &t);
}
