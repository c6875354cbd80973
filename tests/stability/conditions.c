/* Singular values of the restricted system for rings of 2 to 16 views, and what they mean for the
 * volume: the error that the default solver reaches at 1 % noise. */
#include "tests/stability/stab.h"

#include <float.h>
#include <lapacke.h>
#include <stdlib.h>

#include "base/mem.h"
#include "recon/frame/inside.h"
#include "tests/lib/entries.h"

#define SIDE 20   /* voxels; the spectrum costs their sixth power twice */
#define SEEN 1e-3 /* of sigma max: singular values above it count for the rank */

/* The prior must leave a well-conditioned problem whatever A is: with a condition number of 100 for
 * K, CG gains a digit in some hundred steps at worst, and in practice in ten. */
#define REGULAR 1e2

/* Singular values of K = [ W^(1/2) A ; sqrt(lambda) L ], L the second differences of smooth.h. */
struct spectrum {
    int32_t rows, columns, rank; /* rank: as many as are SEEN */
    double max, min;             /* min: the min(rows, columns)-th; 0 below what rounding leaves */
};

struct ring {
    size_t views;
    bool quick;
    struct spectrum plain[2], regular[2];
    double error[2], lambda[2];
};

static struct ring rings[] = {
    {.views = 2, .quick = true}, {.views = 3},  {.views = 4},  {.views = 5},  {.views = 6},
    {.views = 8, .quick = true}, {.views = 10}, {.views = 12}, {.views = 16},
};
#define RINGS (sizeof rings / sizeof *rings)

/* gram += w (row of K)' (row of K). */
static void add_row(double *gram, size_t n, size_t count, const size_t *at, const double *value,
                    double w)
{
    for (size_t i = 0; i < count; i++)
        for (size_t j = 0; j < count; j++)
            gram[at[i] * n + at[j]] += w * value[i] * value[j];
}

/* Active index of voxel v of a layer's or line's neighbour, or -1. */
static int32_t active(const struct rec_subsys *a, const int32_t ijk[3])
{
    const struct rec_grid *g = &a->S->grid;
    for (int k = 0; k < 3; k++)
        if (ijk[k] < 0 || ijk[k] >= g->n[k])
            return -1;
    int32_t v = (int32_t)rec_grid_index(g, ijk[0], ijk[1], ijk[2]);
    int32_t q = rec_first_column(a->col, a->n, v);
    return q < a->n && a->col[q] == v ? q : -1;
}

static void add_second_differences(double *gram, const struct rec_subsys *a, double lambda)
{
    const struct rec_grid *g = &a->S->grid;
    double h = fmin(rec_grid_h(g, 0), fmin(rec_grid_h(g, 1), rec_grid_h(g, 2)));
    for (int32_t q = 0; q < a->n; q++) {
        size_t at[7] = {(size_t)q}, n = 1;
        double value[7] = {0};
        int32_t ijk[3];
        rec_grid_ijk(g, a->col[q], ijk);
        for (int f = 0; f < 6; f++) {
            int32_t beside[3] = {ijk[0], ijk[1], ijk[2]};
            beside[f / 2] += f & 1 ? 1 : -1;
            double scale = h / rec_grid_h(g, f / 2) * h / rec_grid_h(g, f / 2);
            int32_t p = active(a, beside);
            value[0] += scale;
            if (p >= 0) {
                at[n] = (size_t)p;
                value[n++] = -scale;
            }
        }
        add_row(gram, (size_t)a->n, n, at, value, lambda);
    }
}

static struct spectrum spectrum_of(const struct rec_subsys *a, const float *weight, double lambda)
{
    size_t n = (size_t)a->n, most = 0;
    struct entries columns = entries_of_system(a), r = entries_by_row(&columns, a->win.room);
    for (size_t i = 0; i < r.n; i++)
        most = r.colptr[i + 1] - r.colptr[i] > most ? r.colptr[i + 1] - r.colptr[i] : most;
    double *gram = pvx_calloc(n * n, sizeof *gram), *square = pvx_calloc(n, sizeof *square);
    double *value = pvx_calloc(most, sizeof *value);
    size_t *at = pvx_calloc(most, sizeof *at);
    if (gram == NULL || square == NULL || value == NULL || at == NULL)
        CHECK(PVX_ENOMEM);
    for (size_t i = 0; i < r.n; i++) {
        size_t count = 0;
        for (uint32_t e = r.colptr[i]; e < r.colptr[i + 1]; e++, count++) {
            at[count] = r.row[e];
            value[count] = entries_value(&r, e);
        }
        if (count > 0)
            add_row(gram, n, count, at, value, (double)weight[i]);
    }
    struct spectrum s = {.rows = a->rows + (lambda > 0 ? a->n : 0), .columns = a->n};
    if (lambda > 0)
        add_second_differences(gram, a, lambda);
    if (LAPACKE_dsyevd(LAPACK_ROW_MAJOR, 'N', 'U', a->n, gram, a->n, square) != 0)
        CHECK(PVX_EINVAL);
    double max = square[n - 1], rounding = (double)n * DBL_EPSILON * max;
    double min = square[s.rows < s.columns ? s.columns - s.rows : 0];
    s.max = sqrt(max);
    s.min = min > rounding ? sqrt(min) : 0;
    for (size_t i = 0; i < n; i++)
        s.rank += square[i] > SEEN * SEEN * max;
    free(gram);
    free(square);
    free(value);
    free(at);
    entries_free(&columns);
    entries_free(&r);
    return s;
}

static void measure(const struct stab_run *run, struct ring *t, enum rec_basis basis)
{
    struct stab_bed b;
    rec_frame *f;
    stab_bed_new(&b, run, RIG_RING, t->views, basis, (struct stab_size){SIDE, 48, 36});
    stab_bed_noise(&b, 0.01);
    CHECK(rec_frame_alone(b.S, &b.rig, &b.p, run->pool, &f, NULL));
    struct stab_result r = stab_solve(&b, f, NULL);
    const struct rec_subsys *a = rec_frame_subsys(f);
    t->lambda[basis] = r.report.solve.lambda;
    t->plain[basis] = spectrum_of(a, rec_frame_weight(f), 0);
    t->regular[basis] = spectrum_of(a, rec_frame_weight(f), t->lambda[basis]);
    t->error[basis] = r.error;
    char name[64];
    snprintf(name, sizeof name, "ring of %zu views, %d voxels a side", t->views, SIDE);
    struct stab_row row = stab_row_of(name, &b, r.report.solve.solver, &r);
    row.sound = row.sound && t->plain[basis].max > 0 &&
                t->regular[basis].max < REGULAR * t->regular[basis].min;
    stab_add(&row);
    rec_frame_free(&f);
    stab_bed_free(&b);
}

static void print(const struct ring *t, int basis, FILE *csv)
{
    const struct spectrum *c = &t->plain[basis], *reg = &t->regular[basis];
    int32_t values = c->rows < c->columns ? c->rows : c->columns;
    const char *name = rec_basis_name((enum rec_basis)basis);
    double share = (double)c->rank / values, per_column = (double)c->rank / c->columns;
    printf(
        "  %5zu | %-9s | %5d | %7d | %9.4f | %9.2e | %9.2e | %4d | %5.2f | %5.2f | %10.1f | %.3f\n",
        t->views, name, c->rows, c->columns, c->max, c->min, c->max / c->min, c->rank, share,
        per_column, reg->max / reg->min, t->error[basis]);
    if (csv != NULL)
        fprintf(csv, "%zu,%s,%d,%d,%.6g,%.6g,%.6g,%d,%.4f,%.4f,%.6g,%.6g,%.6g\n", t->views, name,
                c->rows, c->columns, c->max, c->min, c->max / c->min, c->rank, share, per_column,
                t->lambda[basis], reg->max / reg->min, t->error[basis]);
}

/* Rows go to the table; what they were made of to a table of its own, after it. */
void stab_conditions(const struct stab_run *run)
{
    for (int basis = REC_BOX; basis <= REC_TRILINEAR; basis++)
        for (size_t i = 0; i < RINGS; i++)
            if (!run->quick || rings[i].quick)
                measure(run, &rings[i], (enum rec_basis)basis);

    FILE *csv = stab_csv(run, "condition");
    if (csv != NULL)
        fprintf(csv, "views,basis,rows,columns,sigma_max,sigma_min,condition,rank,"
                     "rank_of_values,rank_of_columns,lambda,condition_with_prior,error\n");
    printf("\n  rank: singular values above sigma max / 1000, their share of all and of the "
           "columns\n");
    printf("  views | basis     |  rows | columns | sigma max | sigma min | condition | rank | "
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
