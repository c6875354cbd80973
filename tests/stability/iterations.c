/* 10^4 iterations: every solver stays finite; the default neither drifts away from the error at its
 * automatic stop nor from the residual that its recursion believes in.  cgls-paper clips without
 * telling its recursion and is known to diverge in error (paper 4.3): that is reported, not bounded. */
#include "tests/stability/stab.h"

#include <stdlib.h>
#include <string.h>

#include "tests/lib/entries.h"
#include "tests/lib/product.h"
#include "recon/frame/inside.h"

/* The recurrences are begun anew every 64 iterations, and each may round r once. */
#define DRIFT (64 * 0x1p-24)

struct watch {
    const struct stab_bed *b;
    const struct rec_subsys *a;
    const float *rhs, *weight;
    uint32_t *row;         /* of A */
    float *ax;             /* [room][cs] */
    double outside2;       /* truth that the hull does not hold */
    uint32_t middle, last; /* iterations at which is measured */
    double error[2], drift;
    double residual; /* of the last iteration, as the solver believes */
    uint32_t before; /* iterations of earlier runs from their own result */
    bool finite;
};

static double error_of(const struct watch *t, const float *x)
{
    size_t cs = (size_t)t->a->cs;
    double e = t->outside2;
    for (size_t q = 0; q < (size_t)t->a->n; q++)
        for (size_t l = 0; l < 3; l++) {
            double d = x[q * cs + l] - (double)t->b->truth[(size_t)t->a->col[q] * 3 + l];
            e += d * d;
        }
    return sqrt(e) / t->b->norm;
}

/* | ||W^(1/2) (A x - b)|| - residual | / ||W^(1/2) b||, the first in double from float products. */
static double drift_of(const struct watch *t, const float *x, double residual)
{
    size_t cs = (size_t)t->a->cs;
    double r2 = 0, b2 = 0;
    product_ax(t->a, x, t->ax);
    for (size_t k = 0; k < (size_t)t->a->rows; k++)
        for (size_t i = t->row[k], l = 0; l < 3; l++) {
            double b = t->rhs[i * cs + l], w = t->weight[i];
            double r = t->ax[i * cs + l] - b;
            r2 += w * r * r;
            b2 += w * b * b;
        }
    return fabs(sqrt(r2) - residual) / sqrt(b2);
}

static void look(void *ctx, uint32_t k, const float *x, double objective, double residual)
{
    struct watch *t = ctx;
    t->finite = t->finite && isfinite(residual) && isfinite(objective);
    t->residual = residual;
    if (t->before + k != t->middle && t->before + k != t->last)
        return;
    int i = t->before + k == t->last;
    t->error[i] = error_of(t, x);
    if (i == 1)
        t->drift = drift_of(t, x, residual);
    for (size_t q = 0; q < (size_t)t->a->n * (size_t)t->a->cs; q++)
        t->finite = t->finite && isfinite(x[q]); /* cgls is clipped in the end only */
}

struct limit {
    double error, drift;
};

/* A solver that has nothing left to do ends before the count; then it starts anew from its own result
 * until the iterations add up, so that small errors of a start can add up too. */
static void run_solver(struct watch *t, rec_problem *s, double sigma, const char *solver,
                       float lambda, struct limit limit)
{
    struct rec_solve_report stop, rep = {0};
    struct rec_solve_params p = rec_solve_defaults;
    const struct rec_pictures in = {
        .b = t->rhs, .w = t->weight, .sigma = {sigma, sigma, sigma, sigma}};
    float *x = must_floats((size_t)t->a->n * 4);
    p.solver = solver;
    CHECK(solve_from(s, t->a, &in, &p, x, &stop));
    double at_stop = error_of(t, x);
    memset(x, 0, (size_t)t->a->n * 4 * sizeof *x);
    p.stop = REC_STOP_ITERATIONS;
    p.lambda = lambda;
    p.trace = look;
    p.trace_ctx = t;
    t->finite = true;
    t->before = 0;
    t->error[0] = t->error[1] = t->drift = NAN;
    int64_t ns = 0;
    uint32_t runs = 0;
    while (t->before < t->last) {
        p.iterations = t->last - t->before;
        CHECK(solve_from(s, t->a, &in, &p, x, &rep));
        t->before += rep.iterations > 0 ? rep.iterations : 1; /* not even one was worth it */
        ns += rep.time_ns;
        runs++;
    }
    for (size_t q = 0; q < (size_t)t->a->n * 4; q++)
        t->finite = t->finite && isfinite(x[q]) && x[q] >= 0;
    double drift = isnan(t->drift) ? drift_of(t, x, t->residual) : t->drift;
    double error[2];
    for (int i = 0; i < 2; i++)
        error[i] = isnan(t->error[i]) ? error_of(t, x) : t->error[i];
    char name[64];
    struct stab_row row = {.name = name,
                           .basis = (int)t->b->rig.grid.basis,
                           .solver = solver,
                           .outcome = rec_status_name(rep.status),
                           .sound =
                               t->finite && isfinite(rep.rel_residual) && rep.rel_residual >= 0,
                           .residual = rep.rel_residual,
                           .iterations = t->last,
                           .voxels = t->a->n,
                           .ms = 1e-6 * (double)ns};
    const char *prior = lambda == 0 ? "no prior, " : "";
    snprintf(name, sizeof name, "%serror at %u / at the stop (%u)", prior, t->middle,
             stop.iterations);
    row.error = error[0] / at_stop;
    row.bound = limit.error;
    stab_add(&row);
    snprintf(name, sizeof name, "%serror at %u / at the stop (%u)", prior, t->last,
             stop.iterations);
    row.error = error[1] / at_stop;
    if (t->last > t->middle)
        stab_add(&row);
    snprintf(name, sizeof name, "%sresidual drift at %u, %u starts", prior, t->last, runs);
    row.error = drift;
    row.bound = limit.drift;
    stab_add(&row);
    free(x);
}

void stab_iterations(const struct stab_run *run)
{
    for (int basis = REC_BOX; basis <= REC_TRILINEAR; basis++) {
        struct stab_bed b;
        rec_frame *f;
        rec_problem *s;
        stab_bed_new(&b, run, RIG_RING, 8, (enum rec_basis)basis, run->long_size);
        stab_bed_noise(&b, 0.01);
        CHECK(rec_frame_alone(b.S, &b.rig, &b.p, run->pool, &f, NULL));
        CHECK(rec_problem_new(b.S, 3, &s));
        stab_fill(&b, f);
        rec_frame_carve(f);
        struct watch t = {.b = &b,
                          .a = rec_frame_subsys(f),
                          .rhs = rec_frame_rhs(f),
                          .weight = rec_frame_weight(f),
                          .middle = 1000,
                          .last = run->long_iterations};
        t.row = rows_of_system(t.a);
        t.ax = must_floats((size_t)t.a->win.room * 4);
        for (size_t i = 0; i < b.voxels * 3; i++)
            t.outside2 += (double)b.truth[i] * b.truth[i];
        for (size_t q = 0; q < (size_t)t.a->n * 3; q++) {
            double v = b.truth[(size_t)t.a->col[q / 3] * 3 + q % 3];
            t.outside2 -= v * v;
        }
        t.outside2 = fmax(0, t.outside2);
        for (const char *const *name = rec_solver_names(); *name != NULL; name++) {
            bool standard = name == rec_solver_names();
            struct limit limit = {standard ? 1.05 : STAB_NO_BOUND,
                                  standard ? DRIFT : STAB_NO_BOUND};
            if (standard || (basis == REC_BOX && !run->quick))
                run_solver(&t, s, 0.01 * b.peak, *name, -1, limit);
            limit.error = STAB_NO_BOUND; /* as good as any least squares solution */
            if (standard && basis == REC_BOX && !run->quick)
                run_solver(&t, s, 0.01 * b.peak, *name, 0, limit);
        }
        free(t.row);
        free(t.ax);
        rec_problem_free(&s);
        rec_frame_free(&f);
        stab_bed_free(&b);
    }
}
