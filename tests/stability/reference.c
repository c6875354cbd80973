/* Float against double: the products against plain loops, and the default solver, run to the end,
 * against the exact minimiser of the same problem,
 *
 *     f(x) = 1/2 ||W^(1/2) (A x - b)||^2 + lambda/2 ||L x||^2  ->  min,  x >= 0            (1)
 *
 * written out with dense matrices in double and solved by block principal pivoting: a guess at which
 * x are 0 is put right where the conditions of Kuhn and Tucker fail, all of them at once, and one
 * at a time when that does not lead on, which is known to end.
 * Source: L. F. Portugal, J. J. Judice, L. N. Vicente, Math. Comp. 63:625, 1994. */
#include "tests/stability/stab.h"

#include <stdlib.h>

#include "base/mem.h"
#include "tests/lib/entries.h"
#include "tests/lib/product.h"
#include "recon/frame/inside.h"

#define MAX_COLUMNS 1600 /* dense: 20 MB */

/* ---- products -----------------------------------------------------------------------------------*/

/* Largest |got - want| over the largest |want|, each output a gather over g in double. */
static double gather_error(const struct entries *g, size_t cs, const float *in, const float *got)
{
    double worst = 0, size = 0;
    for (size_t i = 0; i < g->n; i++)
        for (size_t l = 0; l < cs; l++) {
            double want = 0;
            for (uint32_t e = g->colptr[i]; e < g->colptr[i + 1]; e++)
                want += entries_value(g, e) * in[(size_t)g->row[e] * cs + l];
            worst = fmax(worst, fabs(got[i * cs + l] - want));
            size = fmax(size, fabs(want));
        }
    return worst / size;
}

static void products(struct stab_bed *b, rec_frame *f)
{
    const struct rec_subsys *a = rec_frame_subsys(f);
    size_t cs = (size_t)a->cs;
    float *x = pvx_calloc((size_t)a->n * cs, sizeof *x);
    size_t bins = a->win.nowhere, room = a->win.room;
    struct entries columns = entries_of_system(a), rows = entries_by_row(&columns, bins);
    float *y = pvx_calloc(room * cs, sizeof *y);
    float *ax = pvx_calloc(room * cs, sizeof *ax);
    float *aty = pvx_calloc((size_t)a->n * cs, sizeof *aty);
    if (x == NULL || y == NULL || ax == NULL || aty == NULL)
        CHECK(PVX_ENOMEM);
    for (size_t i = 0; i < (size_t)a->n * cs; i++)
        x[i] = i % cs == 3 ? 0 : (float)pvx_uniform(&b->rng);
    for (size_t i = 0; i < bins * cs; i++)
        y[i] = i % cs == 3 ? 0 : (float)(2 * pvx_uniform(&b->rng) - 1);
    product_ax(a, x, ax);
    product_aty(a, y, aty);
    /* Some hundred terms, each rounded once or the sum once at the end: 2^-24 of the largest, times
     * the root of their number. */
    struct stab_row row = {.name = cs == 4 ? "A x, float against double, 3 channels"
                                           : "A x, float against double, 1 channel",
                           .basis = (int)b->rig.grid.basis,
                           .solver = "-",
                           .outcome = "product",
                           .sound = true,
                           .voxels = a->n,
                           .bound = 1e-6};
    row.error = gather_error(&rows, cs, x, ax);
    stab_add(&row);
    row.name = cs == 4 ? "A' y, float against double, 3 channels"
                       : "A' y, float against double, 1 channel";
    row.error = gather_error(&columns, cs, y, aty);
    stab_add(&row);
    free(x);
    free(y);
    free(ax);
    free(aty);
    entries_free(&columns);
    entries_free(&rows);
}

/* ---- the minimiser ------------------------------------------------------------------------------*/

struct problem {
    size_t n;
    double *H;      /* [n][n] A'WA + lambda L L */
    double *c;      /* [n] A'W b */
    double half_bb; /* 1/2 b'Wb */
};

/* Second differences, 0 outside the hull: 6 x minus the neighbours, for cubic voxels. */
static double smooth(const struct rec_grid *g, int32_t u, int32_t v)
{
    int32_t a[3], b[3];
    rec_grid_ijk(g, u, a);
    rec_grid_ijk(g, v, b);
    int apart = abs(a[0] - b[0]) + abs(a[1] - b[1]) + abs(a[2] - b[2]);
    return apart == 0 ? 6 : apart == 1 ? -1 : 0;
}

static void form(const struct rec_subsys *a, const float *b, const float *w, double lambda,
                 struct problem *p)
{
    p->n = (size_t)a->n;
    p->H = pvx_calloc(p->n * p->n, sizeof *p->H);
    p->c = pvx_calloc(p->n, sizeof *p->c);
    p->half_bb = 0;
    if (p->H == NULL || p->c == NULL)
        CHECK(PVX_ENOMEM);
    struct entries columns = entries_of_system(a), g = entries_by_row(&columns, a->win.room);
    for (size_t i = 0; i < g.n; i++) {
        if (g.colptr[i] == g.colptr[i + 1])
            continue;
        double wi = w[i], bi = b[i];
        p->half_bb += 0.5 * wi * bi * bi;
        for (uint32_t e = g.colptr[i]; e < g.colptr[i + 1]; e++) {
            double wv = wi * entries_value(&g, e);
            p->c[g.row[e]] += wv * bi;
            for (uint32_t k = g.colptr[i]; k < g.colptr[i + 1]; k++)
                p->H[g.row[e] * p->n + g.row[k]] += wv * entries_value(&g, k);
        }
    }
    entries_free(&columns);
    entries_free(&g);
    const struct rec_grid *grid = &a->S->grid;
    for (size_t u = 0; u < p->n; u++)
        for (size_t k = 0; k < p->n; k++) {
            double luk = smooth(grid, a->col[u], a->col[k]);
            for (size_t v = 0; luk != 0 && v < p->n; v++)
                p->H[u * p->n + v] += lambda * luk * smooth(grid, a->col[k], a->col[v]);
        }
}

/* f at x, and its gradient in g. */
static double value(const struct problem *p, const double *x, double *g)
{
    double f = p->half_bb;
    for (size_t u = 0; u < p->n; u++) {
        double s = 0;
        for (size_t v = 0; v < p->n; v++)
            s += p->H[u * p->n + v] * x[v];
        g[u] = s - p->c[u];
        f += x[u] * (0.5 * s - p->c[u]);
    }
    return f;
}

/* x on the free columns solves H_FF x_F = c_F by Cholesky in t [n][n]; false: not positive definite. */
static bool solve_free(const struct problem *p, const bool *is_free, double *t, size_t *at,
                       double *x)
{
    size_t m = 0;
    for (size_t u = 0; u < p->n; u++) {
        x[u] = 0;
        if (is_free[u])
            at[m++] = u;
    }
    for (size_t i = 0; i < m; i++)
        for (size_t k = 0; k <= i; k++) {
            double s[2] = {p->H[at[i] * p->n + at[k]], 0};
            const double *u = t + i * m, *v = t + k * m;
            for (size_t q = 0; q < k; q++)
                s[q & 1] -= u[q] * v[q];
            if (i != k)
                t[i * m + k] = (s[0] + s[1]) / t[k * m + k];
            else if (s[0] + s[1] > 0)
                t[i * m + i] = sqrt(s[0] + s[1]);
            else
                return false;
        }
    for (size_t i = 0; i < m; i++) {
        double s = p->c[at[i]];
        for (size_t q = 0; q < i; q++)
            s -= t[i * m + q] * x[at[q]];
        x[at[i]] = s / t[i * m + i];
    }
    for (size_t i = m; i-- > 0;) {
        double s = x[at[i]];
        for (size_t q = i + 1; q < m; q++)
            s -= t[q * m + i] * x[at[q]];
        x[at[i]] = s / t[i * m + i];
    }
    return true;
}

/* The minimiser of (1); false when it was not found, which would be a fault of this file. */
static bool minimise(const struct problem *p, double *x)
{
    double *t = pvx_calloc(p->n * p->n, sizeof *t), *g = pvx_calloc(p->n, sizeof *g);
    size_t *at = pvx_calloc(p->n, sizeof *at), fewest = p->n + 1;
    bool *is_free = pvx_calloc(p->n, sizeof *is_free), found = false;
    int patience = 3;
    double big = 0;
    if (t == NULL || g == NULL || at == NULL || is_free == NULL)
        CHECK(PVX_ENOMEM);
    for (size_t u = 0; u < p->n; u++) {
        is_free[u] = true;
        big = fmax(big, fabs(p->c[u]));
    }
    for (int round = 0; round < 300 && !found; round++) {
        if (!solve_free(p, is_free, t, at, x))
            break;
        value(p, x, g);
        size_t wrong = 0, last = 0;
        for (size_t u = 0; u < p->n; u++)
            if (is_free[u] ? x[u] < 0 : g[u] < -1e-12 * big) {
                wrong++;
                last = u;
            }
        found = wrong == 0;
        bool all = wrong < fewest || patience-- > 0;
        if (wrong < fewest) {
            fewest = wrong;
            patience = 3;
        }
        for (size_t u = 0; u < p->n; u++)
            if ((all || u == last) && (is_free[u] ? x[u] < 0 : g[u] < -1e-12 * big))
                is_free[u] = !is_free[u];
    }
    free(t);
    free(g);
    free(at);
    free(is_free);
    return found;
}

static void minimisers(struct stab_bed *b, rec_frame *f, float lambda)
{
    const struct rec_subsys *a = rec_frame_subsys(f);
    const char *solver = rec_solver_names()[0];
    rec_problem *s;
    struct rec_pictures in = slot_pictures(f, 0.01 * b->peak);
    struct problem p;
    struct rec_solve_report rep;
    struct rec_solve_params sp = {
        .solver = solver, .stop = REC_STOP_ITERATIONS, .iterations = 3000, .lambda = lambda};
    CHECK(rec_problem_new(b->S, 1, &s));
    float *x = pvx_calloc((size_t)a->n, sizeof *x);
    double *xd = pvx_calloc((size_t)a->n, sizeof *xd),
           *want = pvx_calloc((size_t)a->n, sizeof *want);
    double *g = pvx_calloc((size_t)a->n, sizeof *g);
    if (x == NULL || xd == NULL || want == NULL || g == NULL)
        CHECK(PVX_ENOMEM);
    CHECK(solve_from(s, a, &in, &sp, x, &rep));
    form(a, rec_frame_rhs(f), rec_frame_weight(f), rep.lambda, &p);
    bool found = minimise(&p, want);
    double diff = 0, norm = 0, at_bound = 0;
    for (size_t u = 0; u < p.n; u++) {
        xd[u] = x[u];
        diff += (xd[u] - want[u]) * (xd[u] - want[u]);
        norm += want[u] * want[u];
        at_bound += want[u] == 0;
    }
    double least = value(&p, want, g), got = value(&p, xd, g);
    char name[3][64];
    snprintf(name[0], sizeof name[0], "f(x) over the least f, lambda %g", (double)lambda);
    snprintf(name[1], sizeof name[1], "x against the minimiser, lambda %g", (double)lambda);
    snprintf(name[2], sizeof name[2], "f reported against f(x), lambda %g", (double)lambda);
    struct stab_row row = {.name = name[0],
                           .basis = (int)b->rig.grid.basis,
                           .solver = solver,
                           .outcome = rec_status_name(rep.status),
                           .error = got / least - 1,
                           .bound = STAB_MEASURED,
                           .sound = found && norm > 0 && at_bound > 0 && got >= least * (1 - 1e-9),
                           .residual = rep.rel_residual,
                           .iterations = rep.iterations,
                           .voxels = a->n,
                           .ms = 1e-6 * (double)rep.time_ns};
    stab_add(&row);
    row.name = name[1];
    row.error = sqrt(diff / norm);
    stab_add(&row);
    row.name = name[2];
    row.error = fabs(rep.objective / got - 1);
    row.bound = 4 * 0x1p-24; /* a sum in double of squares of floats, each rounded twice */
    stab_add(&row);
    free(p.H);
    free(p.c);
    free(x);
    free(xd);
    free(want);
    free(g);
    rec_problem_free(&s);
}

void stab_reference(const struct stab_run *run)
{
    for (int basis = REC_BOX; basis <= REC_TRILINEAR; basis++) {
        struct stab_bed b;
        stab_bed_new(&b, run, RIG_RING, 6, (enum rec_basis)basis, (struct stab_size){14, 48, 36});
        stab_bed_noise(&b, 0.01);
        for (int nch = 1; nch <= 3; nch += 2) {
            rec_frame *f;
            b.p.nch = nch;
            CHECK(rec_frame_alone(b.S, &b.rig, &b.p, run->pool, &f, NULL));
            stab_fill(&b, f);
            rec_frame_carve(f);
            products(&b, f);
            if (nch == 1 && rec_frame_subsys(f)->n <= MAX_COLUMNS) {
                if (!run->quick)
                    minimisers(&b, f, 0.5f);
                minimisers(&b, f, 0.02f);
            }
            rec_frame_free(&f);
        }
        stab_bed_free(&b);
    }
}
