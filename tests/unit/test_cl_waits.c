/* test_cl_waits.c - how often a solve waits for the device: a wait takes as long as a small product. */
#include "tests/lib/cl_fault.h"
#include "tests/lib/cl_ops.h"

enum { MOST = 24, RESTARTED = 1, WENT_BACK = 3, RENEWED = 1 };

/* Waits of a solve with so many iterations at most.  Each reads something. */
static long waits_of(struct bed *b, uint32_t iterations, enum rec_start start,
                     struct rec_solve_report *out)
{
    struct rec_solve_params p = rec_solve_defaults;
    rec_problem *pb = b->pb[THERE];
    p.iterations = iterations;
    p.tolerance = 1e-9F;
    T_OK(rec_problem_load(pb, b->sub, &b->in));
    rec_problem_weigh(pb, -1);
    rec_clear_x(pb, b->t[THERE].x);
    pb->start = start;
    cl_fault("clEnqueueReadBuffer:0:error");
    T_EQ_I(rec_solve(pb, &p, b->t[THERE].x, out), PVX_OK);
    long waits = cl_fault_calls();
    cl_fault(NULL);
    T_EQ_I(out->iterations, iterations);
    return waits;
}

/* A line search that restarts, a step back and a renewal wait once, three times and once more. */
T_CASE(an_iteration_waits_twice)
{
    for (enum way way = GREY; way <= COLOUR; way++) {
        struct rec_solve_report r;
        struct bed b;
        bed_new(&b, small(), way);
        long before = waits_of(&b, 1, REC_START_ZERO, &r), twice = 0;
        T_EQ_I(before, 2); /* the start shares the wait of the first direction */
        for (uint32_t k = 2; k <= MOST; k++) {
            long now = waits_of(&b, k, REC_START_ZERO, &r), more = now - before - 2;
            T_OK(more == 0 || more == RESTARTED || more == WENT_BACK ||
                 more == RESTARTED + WENT_BACK);
            twice += more == 0;
            before = now;
        }
        T_LE(2 * MOST / 3, twice);
        bed_free(&b);
    }
}
T_CASE(weights_that_are_renewed)
{
    struct rec_solve_report r;
    struct bed b;
    bed_new(&b, small(), GREY);
    long before = waits_of(&b, 3, REC_START_FITS, &r);
    T_EQ_I(r.renewals, 0);
    T_EQ_I(before, 1 + 3 * 2); /* the start waits once more: for V */
    T_EQ_I(waits_of(&b, 4, REC_START_FITS, &r), before + RENEWED + 2);
    T_EQ_I(r.renewals, 1);
    bed_free(&b);
}
/* Loads, starts, renewals, restarts and the end wait less than half as often as the iterations. */
T_CASE(a_whole_set)
{
    struct rec_solve_report r;
    struct bed b;
    bed_new(&b, 64, COLOUR);
    rec_problem *pb = b.pb[THERE];
    float *x = pvx_calloc(b.n * b.cs, sizeof *x);
    b.descent.levels = b.levels;
    cl_fault("clEnqueueReadBuffer:0:error");
    T_OK(rec_problem_load(pb, b.sub, &b.in));
    rec_problem_weigh(pb, -1);
    (void)rec_levels_start(pb, &b.descent, b.t[THERE].x, NULL);
    T_EQ_I(rec_solve(pb, &rec_solve_defaults, b.t[THERE].x, &r), PVX_OK);
    T_OK(rec_cl_solver_end(b.v, x));
    long waits = cl_fault_calls(), iterations = b.descent.iterations + r.iterations;
    cl_fault(NULL);
    printf("  64^3: %ld waits, %ld iterations on all grids, %u renewals on the finest\n", waits,
           iterations, r.renewals);
    T_LE(20, iterations);
    T_LE(waits, 3 * iterations);
    free(x);
    bed_free(&b);
}
T_MAIN((cl_fault_begin(), cl_bed_begin(), cl = cl_bed_open()), rec_cl_close(&cl))
