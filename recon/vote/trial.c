/* trial.c - solves (1) of vote.h without some cameras, each trial on one thread, and names the fault of a camera. */
#include <math.h>
#include <string.h>

#include "recon/vote/impl.h"

/* Constants of rec_vote_cause, which compares a camera's picture with the one that the others' volume predicts. */
#define SCARCELY 0.02 /* of the brightest predicted bin: no light is expected below this */
#define DARK     0.05 /* of the expected power: with less, the camera is dark */
#define RESTS    0.25 /* of the misfit: if less is left after scaling, the gain is wrong */

#define FOR_BINS(i, v) \
    REC_FOR_BINS (i, (v)->sub, ((struct rec_block_range){0, (v)->sub->n_blocks}), 1)

static size_t trial_bins_of(const rec_vote *v, size_t c)
{
    return v->level->row0[c + 1] - v->level->row0[c];
}

/* Row weights: m_c where camera c takes part and was measured, else 0. */
static void weights(const rec_vote *v, struct rec_trial *t)
{
    for (size_t c = 0; c < v->cameras; c++) {
        float m = rec_vote_has(t->without, c) ? 0 : (float)v->weigh[c];
        const float *use = v->use + v->level->row0[c];
        float *w = t->w + v->level->row0[c];
        for (size_t i = 0; i < trial_bins_of(v, c); i++)
            w[i] = m * use[i];
    }
}

/* r = A x - b, wr = W r. */
static void trial_residual(const rec_vote *v, struct rec_trial *t, const float *x)
{
    rec_forward_alone(v->sub, x, t->r);
    FOR_BINS(i, v)
    {
        t->r[i] -= v->b[i];
        t->wr[i] = t->w[i] * t->r[i];
    }
}

/* A_c x in the bins of camera c. */
static void trial_project(const rec_vote *v, int32_t c, const float *x, float *y)
{
    memset(y + v->level->row0[c], 0, trial_bins_of(v, (size_t)c) * sizeof *y);
    rec_add_forward_alone(v->sub, (struct rec_cameras){c, c + 1}, x, y);
}
static void trial_back(const rec_vote *v, int32_t c, const float *y, float *x)
{
    rec_adjoint_cameras(v->sub, (struct rec_cameras){c, c + 1}, y, 0, v->sub->n, x);
}

void rec_vote_lengths(rec_vote *v)
{
    struct rec_trial *t = &v->trial[0];
    for (int32_t q = 0; q < v->sub->n; q++)
        t->y[q] = 1;
    rec_forward_alone(v->sub, t->y, t->wr);
    FOR_BINS(i, v)
    t->wr[i] *= v->use[i];
    for (size_t c = 0; c < v->cameras; c++)
        if (v->set->present[c])
            trial_back(v, (int32_t)c, t->wr, v->length[c]);
}

/* scale = 1 / (A'W A 1): steps of this length never overshoot, because A >= 0. */
static void scale_steps(const rec_vote *v, struct rec_trial *t)
{
    size_t n = (size_t)v->sub->n;
    memset(t->scale, 0, n * sizeof *t->scale);
    for (size_t c = 0; c < v->cameras; c++) {
        float m = (float)v->weigh[c];
        for (size_t q = 0; q < n && !rec_vote_has(t->without, c) && v->set->present[c]; q++)
            t->scale[q] += m * v->length[c][q];
    }
    for (size_t q = 0; q < n; q++)
        t->scale[q] = t->scale[q] > 0 ? 1 / t->scale[q] : 0;
}

/* One step of SART: moves x to fit camera c alone. */
static void sweep_camera(const rec_vote *v, struct rec_trial *t, int32_t c)
{
    const float *length = v->length[c];
    trial_project(v, c, t->x, t->wr);
    for (size_t i = v->level->row0[c]; i < v->level->row0[c + 1]; i++)
        t->wr[i] = v->use[i] * (v->b[i] - t->wr[i]);
    trial_back(v, c, t->wr, t->step);
    for (int32_t q = 0; q < v->sub->n; q++) {
        float x = length[q] > 0 ? t->x[q] + t->step[q] / length[q] : t->x[q];
        t->x[q] = x > 0 ? x : 0;
    }
}

static void iterate(const rec_vote *v, struct rec_trial *t)
{
    size_t n = (size_t)v->sub->n;
    double momentum = 1;
    memcpy(t->y, t->x, n * sizeof *t->y);
    for (uint32_t k = 0; k < t->iterations; k++) {
        double next = 0.5 * (1 + sqrt(1 + 4 * momentum * momentum)), up = 0;
        float on = (float)((momentum - 1) / next);
        trial_residual(v, t, t->y);
        rec_adjoint_range(v->sub, t->wr, 0, v->sub->n, t->step);
        for (size_t q = 0; q < n; q++) {
            float x = t->y[q] - t->scale[q] * t->step[q];
            x = x > 0 ? x : 0;
            float d = x - t->x[q];
            if (t->scale[q] > 0)
                up += (double)(t->y[q] - x) * d / t->scale[q];
            t->x[q] = x;
            t->y[q] = x + on * d;
        }
        momentum = next;
        if (up > 0) { /* the step turned back: restart */
            momentum = 1;
            memcpy(t->y, t->x, n * sizeof *t->y);
        }
    }
}

/* out = K_s in, along a row: weights 1 2 .. s .. 2 1 over s^2. */
static void smooth_row(const float *in, int32_t n, int32_t s, float *out)
{
    const float over = 1 / ((float)s * (float)s);
    memset(out, 0, (size_t)n * sizeof *out);
    for (int32_t k = 1 - s; k < s; k++) {
        const float weight = (float)(s - (k < 0 ? -k : k));
        int32_t to = k > 0 ? n - k : n;
        for (int32_t x = k < 0 ? -k : 0; x < to; x++)
            out[x] += weight * in[x + k];
    }
    for (int32_t x = 0; x < n; x++)
        out[x] *= over;
}

/* || K r ||^2 over the bins of camera c that were measured; wr holds r there, 0 elsewhere. */
static double misfit(const rec_vote *v, struct rec_trial *t, size_t c)
{
    const struct rec_sysmat_block *b = &v->level->block[c];
    const size_t w = (size_t)b->bw;
    const float *r = t->wr + v->level->row0[c], *use = v->use + v->level->row0[c];
    const int32_t s = v->blur[c][1], keep = 2 * s - 1;
    const float over = 1 / ((float)s * (float)s);
    float *rows = t->rows + v->widest, *k = t->rows; /* row y is in rows[y % keep] */
    double sum = 0;
    for (int32_t y = 1 - s; y < b->bh; y++) {
        int32_t next = y + s - 1;
        if (next < b->bh)
            smooth_row(r + (size_t)next * w, b->bw, v->blur[c][0],
                       rows + (size_t)(next % keep) * v->widest);
        if (y < 0)
            continue;
        memset(k, 0, w * sizeof *k);
        for (int32_t j = y < s ? 0 : y - s + 1; j <= next && j < b->bh; j++) {
            const float *row = rows + (size_t)(j % keep) * v->widest;
            const float weight = (float)(s - (j < y ? y - j : j - y));
            for (size_t x = 0; x < w; x++)
                k[x] += weight * row[x];
        }
        for (size_t x = 0; x < w; x++)
            sum += use[(size_t)y * w + x] * ((double)(over * k[x]) * (over * k[x]));
    }
    return v->weigh[c] * sum;
}

/* The misfit of every camera, also of those left out.  It includes light that no column explains. */
static void trial_judge(const rec_vote *v, struct rec_trial *t)
{
    trial_residual(v, t, t->x);
    for (size_t i = 0; i < v->level->row0[v->cameras]; i++)
        t->wr[i] = v->lit[i] ? -v->use[i] * v->b[i] : 0;
    FOR_BINS(i, v)
    t->wr[i] = v->use[i] * t->r[i];
    for (size_t c = 0; c < v->cameras; c++)
        t->misfit[c] = v->set->present[c] ? misfit(v, t, c) : 0;
}

static void trial_solve(void *ctx, size_t task)
{
    struct rec_vote_run *run = ctx;
    struct rec_trial *t = &run->v->trial[run->from + task];
    weights(run->v, t);
    scale_steps(run->v, t);
    iterate(run->v, t);
    trial_judge(run->v, t);
}

void rec_vote_solve(rec_vote *v, size_t from, size_t to)
{
    struct rec_vote_run run = {v, from};
    pvx_pool_run(v->pool, to - from, trial_solve, &run);
}

void rec_vote_sweep(rec_vote *v, const size_t *order, size_t n)
{
    struct rec_trial *t = &v->trial[0];
    for (size_t k = 0; k < n; k++)
        sweep_camera(v, t, (int32_t)order[k]);
}
void rec_vote_judge(rec_vote *v)
{
    trial_judge(v, &v->trial[0]);
}

/* Camera c's picture b against p, the prediction of the volume without c. */
struct likeness {
    double bb, bp, pp;
    uint32_t empty, lit; /* bins without light in p; those of them lit in b */
};
static struct likeness trial_compare(const rec_vote *v, const struct rec_trial *t, size_t c)
{
    struct likeness l = {0};
    size_t at = v->level->row0[c], n = trial_bins_of(v, c);
    float *p = t->wr + at, most = 0;
    memset(p, 0, n * sizeof *p);
    FOR_BINS(i, v)
    if (i >= at && i < at + n) {
        p[i - at] = v->use[i] * (t->r[i] + v->b[i]);
        most = p[i - at] > most ? p[i - at] : most;
    }
    for (size_t i = 0; i < n; i++) {
        double b = v->use[at + i] * v->b[at + i];
        l.bb += b * b;
        l.bp += b * p[i];
        l.pp += (double)p[i] * p[i];
        bool empty = v->chord[at + i] > 0 && p[i] < SCARCELY * most;
        l.empty += empty;
        l.lit += empty && v->lit[at + i];
    }
    return l;
}

double rec_vote_gain(const rec_vote *v, const struct rec_trial *t, size_t c, double *rest)
{
    const struct likeness l = trial_compare(v, t, c);
    double gain = l.pp > 0 ? l.bp / l.pp : 0, now = l.bb - 2 * l.bp + l.pp;
    *rest = now > 0 ? (l.bb - gain * l.bp) / now : 1;
    return gain;
}

enum rec_wrong rec_vote_cause(const rec_vote *v, const struct rec_trial *t, size_t c)
{
    const struct likeness l = trial_compare(v, t, c);
    double gain = l.pp > 0 ? l.bp / l.pp : 0;
    double now = l.bb - 2 * l.bp + l.pp, scaled = l.bb - gain * l.bp;
    if (2 * v->of[c].saturated > v->of[c].bins || (2 * l.lit > l.empty && l.bb > l.pp))
        return REC_WRONG_FLOODED;
    if (l.bb < DARK * l.pp || (gain < DARK && v->of[c].lit == 0))
        return REC_WRONG_DARK;
    return scaled < RESTS * now ? REC_WRONG_GAIN : REC_WRONG_DISAGREES;
}
