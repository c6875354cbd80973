#include "recon/solve/solve.h"

#include <math.h>
#include <string.h>

#include "base/clock.h"
#include "recon/solve/card.h"

const struct rec_solve_params rec_solve_defaults = REC_SOLVE_DEFAULTS;

#define NAME(name, solve_do_run) name,
#define RUN(name, solve_do_run)  solve_do_run,
static const char *const names[] = {REC_SOLVERS(NAME) NULL};
static rec_method *const methods[] = {REC_SOLVERS(RUN)};

const char *rec_status_name(enum rec_status s)
{
    static const char *const name[] = {[REC_CONVERGED] = "converged",
                                       [REC_MAX_ITER] = "max-iter",
                                       [REC_DEADLINE] = "deadline",
                                       [REC_EMPTY] = "empty"};
    bool known = (size_t)s < sizeof name / sizeof *name && name[s] != NULL;
    return known ? name[s] : "unknown";
}

const char *const *rec_solver_names(void)
{
    return names;
}

/* Index of the method, or that of the NULL. */
static size_t solve_find(const char *name)
{
    size_t i = 0;
    while (name != NULL && *name != '\0' && names[i] != NULL && strcmp(names[i], name) != 0)
        i++;
    return i;
}

bool rec_solver_is_default(const char *name)
{
    return solve_find(name) == 0;
}

/* Runs the method, and fills in the report what the method left open. */
static void solve_do_run(rec_problem *pb, rec_method *method, const struct rec_solve_params *p,
                         float *x, struct rec_solve_report *out)
{
    double rwr[4];
    out->residual_norm = out->solution_norm = -1;
    if (rec_late(p))
        out->status = REC_DEADLINE; /* x stays as it is: no time left */
    else
        method(pb, p, x, out);
    if (out->residual_norm < 0) {
        rec_residual(pb, x, pb->yv[0], pb->yv[1], rwr);
        out->residual_norm = sqrt(rec_lanes_total(rwr));
    }
    if (out->solution_norm < 0)
        out->solution_norm = rec_norm_x(pb, x);
    out->rel_residual = out->residual_norm / sqrt(pb->b_norm2);
}

/* What recon/opencl can do. */
static bool solve_on_card(const rec_problem *pb, const struct rec_solve_params *p)
{
    return rec_solver_is_default(p->solver) && p->stop != REC_STOP_LCURVE && p->trace == NULL &&
           pb->in.least == NULL && pb->expect == NULL && pb->frozen == NULL;
}

pvx_err rec_solve(rec_problem *pb, const struct rec_solve_params *p, float *x,
                  struct rec_solve_report *out)
{
    size_t i = solve_find(p->solver);
    *out = (struct rec_solve_report){.status = REC_EMPTY, .solver = names[i]};
    if (names[i] == NULL || pb->start == REC_START_NONE)
        return PVX_EINVAL;
    if (pb->in.per_channel && (i != 0 || pb->nch != 3))
        return PVX_EUNSUP;
    if (pb->a->card != NULL && !solve_on_card(pb, p))
        return PVX_EUNSUP;
    int64_t begin = pvx_now_mono();
    if (pb->any)
        solve_do_run(pb, methods[i], p, x, out);
    else
        rec_clear_x(pb, x);
    pb->start = REC_START_NONE; /* x is no longer a start */
    out->time_ns = pvx_now_mono() - begin;
    return PVX_OK;
}
