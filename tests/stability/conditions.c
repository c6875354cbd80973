/* Singular values of the restricted system for rings of 2 to 16 views, and what they mean for the
 * volume: the error that the default solver reaches at 1 % noise. */
#include "tests/stability/stab.h"

#include <stdlib.h>

#include "recon/condition.h"

/* Small, so that there are enough steps for the spectrum to show: rank means something once the
 * smallest value has come down to the limit that it counts from. */
#define SIDE 20

/* The prior must leave a well-conditioned problem whatever A is: with a condition number of 100 for
 * K, CG gains a digit in some hundred steps at worst, and in practice in ten. */
#define REGULAR 1e2

struct ring {
    size_t views;
    double bound[2]; /* box, trilinear */
    bool quick;
    struct rec_condition plain[2], regular[2];
    double error[2], lambda[2];
};

static struct ring rings[] = {
    {.views = 2, .bound = {0.72, 0.7}, .quick = true},
    {.views = 3, .bound = {0.34, 0.32}},
    {.views = 4, .bound = {0.34, 0.34}},
    {.views = 5, .bound = {0.24, 0.21}},
    {.views = 6, .bound = {0.26, 0.26}},
    {.views = 8, .bound = {0.23, 0.19}, .quick = true},
    {.views = 10, .bound = {0.2, 0.17}},
    {.views = 12, .bound = {0.17, 0.14}},
    {.views = 16, .bound = {0.17, 0.13}},
};
#define RINGS (sizeof rings / sizeof *rings)

static void measure(const struct stab_run *run, struct ring *t, enum rec_basis basis)
{
    struct stab_bed b;
    rec_frame *f;
    stab_bed_new(&b, run, RIG_RING, t->views, basis, SIDE, 48, 36);
    stab_bed_noise(&b, 0.01);
    CHECK(rec_frame_new(b.S, &b.rig, &b.p, run->pool, &f, NULL));
    struct stab_result r = stab_solve(&b, f, NULL);
    const struct rec_subsys *a = rec_frame_subsys(f);
    struct rec_condition_params p = {.steps = run->quick ? 200 : 600};
    CHECK(rec_condition(a, rec_frame_weight(f), &p, &t->plain[basis]));
    p.steps = 100; /* far more than such a spectrum needs */
    p.lambda = t->lambda[basis] = r.report.solve.lambda;
    CHECK(rec_condition(a, rec_frame_weight(f), &p, &t->regular[basis]));
    t->error[basis] = r.error;
    char name[64];
    snprintf(name, sizeof name, "ring of %zu views, %d voxels a side", t->views, SIDE);
    struct stab_row row = {.name = name,
                           .basis = (int)basis,
                           .solver = r.report.solve.solver,
                           .outcome = rec_status_name(r.report.solve.status),
                           .error = r.error,
                           .bound = t->bound[basis],
                           .sound = r.finite && t->plain[basis].sigma_max > 0 &&
                                    t->plain[basis].rank > 0 &&
                                    t->regular[basis].condition < REGULAR,
                           .residual = r.report.solve.rel_residual,
                           .iterations = r.report.solve.iterations,
                           .voxels = (int32_t)r.report.active_voxels,
                           .ms = r.ms};
    stab_add(&row);
    rec_frame_free(&f);
    stab_bed_free(&b);
}

static void print(const struct ring *t, int basis, FILE *csv)
{
    const struct rec_condition *c = &t->plain[basis], *reg = &t->regular[basis];
    int32_t values = c->rows < c->columns ? c->rows : c->columns;
    const char *name = rec_basis_name((enum rec_basis)basis);
    printf("  %5zu | %-9s | %5d | %7d | %9.4f | %s%8.2e | %s%8.2e | %6.0f | %5.2f | %5.2f | %10.1f "
           "| %.3f\n",
           t->views, name, c->rows, c->columns, c->sigma_max, c->exact ? " " : "<", c->sigma_min,
           c->exact ? " " : ">", c->condition, c->rank, c->rank / values, c->rank / c->columns,
           reg->condition, t->error[basis]);
    if (csv != NULL)
        fprintf(csv, "%zu,%s,%d,%d,%d,%.6g,%.6g,%.6g,%.1f,%.4f,%.4f,%.6g,%.6g,%.6g\n", t->views,
                name, c->rows, c->columns, c->exact, c->sigma_max, c->sigma_min, c->condition,
                c->rank, c->rank / values, c->rank / c->columns, t->lambda[basis], reg->condition,
                t->error[basis]);
}

/* Rows go to the table; what they were made of to a table of its own, after it. */
void stab_conditions(const struct stab_run *run)
{
    for (int basis = REC_BOX; basis <= REC_TRILINEAR; basis++)
        for (size_t i = 0; i < RINGS; i++)
            if (!run->quick || rings[i].quick)
                measure(run, &rings[i], (enum rec_basis)basis);

    FILE *csv = NULL;
    if (run->folder != NULL) {
        char path[4096];
        snprintf(path, sizeof path, "%s/condition.csv", run->folder);
        csv = fopen(path, "w");
        if (csv == NULL) {
            perror(path);
            exit(2);
        }
        fprintf(csv, "views,basis,rows,columns,exact,sigma_max,sigma_min,condition,rank,"
                     "rank_of_values,rank_of_columns,lambda,condition_with_prior,error\n");
    }
    printf("\n  rank: singular values above sigma max / 1000, their share of all and of the "
           "columns\n");
    printf("  views | basis     |  rows | columns | sigma max | sigma min | condition |   rank | "
           "share | /col. | with prior | error\n");
    for (int basis = REC_BOX; basis <= REC_TRILINEAR; basis++)
        for (size_t i = 0; i < RINGS; i++)
            if (!run->quick || rings[i].quick)
                print(&rings[i], basis, csv);
    if (csv != NULL && fclose(csv) != 0) {
        perror("condition.csv");
        exit(2);
    }
}
