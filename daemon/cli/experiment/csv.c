#include "base/file.h"
#include "daemon/cli/experiment/experiment.h"

struct csv {
    char *text;
    size_t len;
    FILE *f;
    int nch;
};

static pvx_err csv_begin(struct csv *c, const struct experiment *x, const char *head,
                         struct pvx_diag *d)
{
    *c = (struct csv){.nch = x->in.nch};
    c->f = open_memstream(&c->text, &c->len);
    if (c->f == NULL)
        return pvx_fail(d, PVX_ENOMEM, "out of memory for a table");
    fputs(head, c->f);
    return PVX_OK;
}

static void csv_columns(struct csv *c, const char *what)
{
    static const char *const channel[] = {"red", "green", "blue"};
    for (int i = 0; i < c->nch && i < 3; i++)
        fprintf(c->f, ",%s_%s", what, c->nch == 1 ? "grey" : channel[i]);
}

static void values(struct csv *c, const double *v)
{
    for (int i = 0; i < c->nch; i++)
        fprintf(c->f, ",%.6g", v[i]);
}

static pvx_err csv_save(struct csv *c, const struct experiment *x, const char *name,
                        struct pvx_diag *d)
{
    char path[4300];
    snprintf(path, sizeof path, "%s/%s", x->o->out, name);
    bool bad = fclose(c->f) != 0;
    pvx_err e = bad ? pvx_fail(d, PVX_ENOMEM, "%s: out of memory", path)
                    : pvx_file_write(path, c->text, c->len, d);
    free(c->text);
    return e;
}

static pvx_err csv_by_frame(const struct experiment *x, struct pvx_diag *d)
{
    struct csv c;
    PVX_TRY(csv_begin(&c, x, "grid,frame", d));
    csv_columns(&c, "inside");
    csv_columns(&c, "all");
    fputs(",ms,voxels,bins\n", c.f);
    for (int g = 0; g < x->o->n_grids; g++)
        for (size_t i = 0; i < x->sets; i++) {
            const double *v = experiment_grid(x, g, i);
            if (v == NULL)
                continue;
            fprintf(c.f, "%d,%lld", x->o->grids[g], (long long)x->in.number[x->set[i]]);
            values(&c, v + EXPERIMENT_INSIDE);
            values(&c, v + EXPERIMENT_ALL);
            fprintf(c.f, ",%.4g,%.0f,%.0f\n", v[EXPERIMENT_MS], v[EXPERIMENT_VOXELS],
                    v[EXPERIMENT_BINS]);
        }
    return csv_save(&c, x, "fig5.csv", d);
}

static void mean_row(struct csv *c, const struct experiment *x, const char *what, size_t value)
{
    char key[64];
    snprintf(key, sizeof key, "%s:%zu:", what, value);
    struct experiment_mean m = experiment_mean_of(x, key);
    fprintf(c->f, "%zu", value);
    values(c, m.mean + EXPERIMENT_INSIDE);
    values(c, m.spread + EXPERIMENT_INSIDE);
    values(c, m.mean + EXPERIMENT_ALL);
    fprintf(c->f, ",%.4g,%zu\n", m.mean[EXPERIMENT_MS], m.n);
}

static pvx_err mean_begin(struct csv *c, const struct experiment *x, const char *what,
                          const char *counted, struct pvx_diag *d)
{
    PVX_TRY(csv_begin(c, x, what, d));
    csv_columns(c, "inside");
    csv_columns(c, "spread");
    csv_columns(c, "all");
    fprintf(c->f, ",ms,%s\n", counted);
    return PVX_OK;
}

static pvx_err by_grid(const struct experiment *x, struct pvx_diag *d)
{
    struct csv c;
    PVX_TRY(mean_begin(&c, x, "grid", "frames", d));
    for (int g = 0; g < x->o->n_grids; g++)
        mean_row(&c, x, "grid", (size_t)x->o->grids[g]);
    return csv_save(&c, x, "fig6b.csv", d);
}

static pvx_err by_views(const struct experiment *x, struct pvx_diag *d)
{
    struct csv c;
    PVX_TRY(mean_begin(&c, x, "views", "choices", d));
    for (size_t v = EXPERIMENT_VIEWS_MIN; v <= experiment_views_max(x); v++)
        mean_row(&c, x, "views", v);
    return csv_save(&c, x, "fig6a.csv", d);
}

static void solvers_on(struct csv *c, const struct experiment *x, enum rec_basis basis,
                       int32_t voxels)
{
    for (const char *const *name = rec_solver_names(); *name != NULL; name++) {
        const double *v = experiment_solver(x, *name, basis, voxels);
        if (v == NULL)
            continue;
        fprintf(c->f, "%s,%s,%d", *name, rec_basis_name(basis), voxels);
        values(c, v + EXPERIMENT_INSIDE);
        values(c, v + EXPERIMENT_ALL);
        fprintf(c->f, ",%.4g,%.0f\n", v[EXPERIMENT_MS], v[EXPERIMENT_ITERATIONS]);
    }
}

static pvx_err csv_by_solver(const struct experiment *x, struct pvx_diag *d)
{
    struct csv c;
    int32_t voxels[EXPERIMENT_GRIDS + 1];
    size_t n = experiment_solver_grids(x, voxels);
    PVX_TRY(csv_begin(&c, x, "solver,basis,grid", d));
    csv_columns(&c, "inside");
    csv_columns(&c, "all");
    fputs(",ms,iterations\n", c.f);
    for (size_t g = 0; g < n; g++) {
        solvers_on(&c, x, REC_BOX, voxels[g]);
        solvers_on(&c, x, REC_TRILINEAR, voxels[g]);
    }
    return csv_save(&c, x, "solvers.csv", d);
}

pvx_err experiment_csv(const struct experiment *x, struct pvx_diag *d)
{
    PVX_TRY(csv_by_frame(x, d));
    PVX_TRY(by_grid(x, d));
    PVX_TRY(by_views(x, d));
    return csv_by_solver(x, d);
}
