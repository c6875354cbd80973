#include "daemon/cli/experiment/experiment.h"

#include <math.h>
#include <string.h>

#include "base/clock.h"

#define TIMES 3 /* how often a solver is timed */

/* ---- choices of views ---- */

size_t experiment_views_max(const struct experiment *x)
{
    size_t most = x->rig.n_cameras - 1;
    return most < EXPERIMENT_VIEWS_MAX ? most : EXPERIMENT_VIEWS_MAX;
}

/* n over k; at most 64 over 7: 6e8. */
static uint64_t binomial(size_t n, size_t k)
{
    uint64_t b = 1;
    for (size_t i = 1; i <= k; i++)
        b = b * (n - k + i) / i;
    return k > n ? 0 : b;
}

size_t experiment_choices(const struct experiment *x, size_t views)
{
    uint64_t all = binomial(x->rig.n_cameras, views);
    return all < EXPERIMENT_CHOICES ? (size_t)all : EXPERIMENT_CHOICES;
}

/* The choices are in the order of their first cameras.  If there are too many, those measured are evenly spread. */
uint64_t experiment_choice(const struct experiment *x, size_t views, size_t k)
{
    size_t n = x->rig.n_cameras, left = views;
    uint64_t all = binomial(n, views), mask = 0, at = k;
    if (all > EXPERIMENT_CHOICES)
        at = k * (all - 1) / (EXPERIMENT_CHOICES - 1);
    for (size_t c = 0; c < n && left > 0; c++) {
        uint64_t with = binomial(n - c - 1, left - 1);
        if (at < with) {
            mask |= (uint64_t)1 << c;
            left--;
        } else {
            at -= with;
        }
    }
    return mask;
}

/* ---- units ---- */

static void add_error(const struct experiment_error *e, double *v)
{
    for (int i = 0; i < 3; i++) {
        v[EXPERIMENT_INSIDE + i] += e->inside[i];
        v[EXPERIMENT_ALL + i] += e->all[i];
    }
    v[EXPERIMENT_BINS] += e->bins;
}

/* Solve the loaded set from the cameras used.  The errors are means over the comparisons with all other cameras. */
static pvx_err experiment_measure_measure(struct experiment_lab *l, uint64_t used,
                                          double v[EXPERIMENT_VALUES])
{
    const struct rec_frame_report *r = rec_frame_get_report(l->frame);
    struct experiment_error e;
    double n = 0;
    memset(v, 0, EXPERIMENT_VALUES * sizeof *v);
    PVX_TRY(experiment_lab_solve(l, used));
    for (size_t c = 0; c < l->S->n_cameras; c++)
        if ((used >> c & 1) == 0) {
            experiment_lab_compare(l, c, &e);
            add_error(&e, v);
            n++;
        }
    for (int i = 0; i < EXPERIMENT_VALUES; i++)
        v[i] /= n;
    v[EXPERIMENT_MS] = (double)(r->hull_ns + r->restrict_ns + r->solve_ns) * 1e-6;
    v[EXPERIMENT_VOXELS] = (double)r->active_voxels;
    v[EXPERIMENT_ITERATIONS] = r->solve.iterations;
    return PVX_OK;
}

/* Measure a unit that uses all cameras but the unused one. */
static pvx_err measure_unused(struct experiment *x, struct experiment_lab *l, const char *key,
                              struct pvx_diag *d)
{
    double v[EXPERIMENT_VALUES];
    pvx_err e = experiment_measure_measure(l, experiment_used(x), v);
    return e == PVX_OK ? experiment_finished(x, key, v, d)
                       : pvx_fail(d, e, "%s: %s", key, pvx_strerror(e));
}

static bool measure_has(const struct experiment *x, const char *key)
{
    return experiment_state_find(&x->state, key) != NULL;
}

/* ---- Figures 5 and 6b ---- */

static void grid_key(const struct experiment *x, int g, size_t i, char *key, size_t size)
{
    snprintf(key, size, "grid:%d:%06lld", x->o->grids[g], (long long)x->in.number[x->set[i]]);
}

const double *experiment_grid(const struct experiment *x, int g, size_t i)
{
    char key[64];
    grid_key(x, g, i, key, sizeof key);
    return experiment_state_find(&x->state, key);
}

struct experiment_mean experiment_grid_mean(const struct experiment *x, int g)
{
    char key[64];
    snprintf(key, sizeof key, "grid:%d:", x->o->grids[g]);
    return experiment_mean_of(x, key);
}

static pvx_err one_grid(struct experiment *x, int g, struct pvx_diag *d)
{
    struct experiment_lab l = {.S = NULL};
    struct experiment_lab_params p = experiment_lab_of(x, x->o->grids[g]);
    pvx_err e = PVX_OK;
    char key[64];
    for (size_t i = 0; i < x->sets && e == PVX_OK; i++) {
        grid_key(x, g, i, key, sizeof key);
        if (measure_has(x, key))
            continue;
        if (l.S == NULL)
            e = experiment_lab_open(&l, &p, d);
        if (e == PVX_OK && cli_stop)
            e = PVX_ECANCELED;
        PVX_THEN(e, experiment_lab_load(&l, &x->in, x->set[i], d));
        PVX_THEN(e, measure_unused(x, &l, key, d));
    }
    experiment_lab_close(&l);
    return e;
}

/* ---- Figure 6a ---- */

static pvx_err one_choice(struct experiment *x, struct experiment_lab *l, size_t views, size_t k,
                          struct pvx_diag *d)
{
    double v[EXPERIMENT_VALUES];
    char key[64];
    snprintf(key, sizeof key, "views:%zu:%zu", views, k);
    if (measure_has(x, key))
        return PVX_OK;
    if (cli_stop)
        return PVX_ECANCELED;
    if (l->S == NULL) {
        struct experiment_lab_params p = experiment_lab_of(x, x->o->grid);
        PVX_TRY(experiment_lab_open(l, &p, d));
        PVX_TRY(experiment_lab_load(l, &x->in, x->set[x->one], d));
    }
    pvx_err e = experiment_measure_measure(l, experiment_choice(x, views, k), v);
    return e == PVX_OK ? experiment_finished(x, key, v, d)
                       : pvx_fail(d, e, "%s: %s", key, pvx_strerror(e));
}

static pvx_err all_views(struct experiment *x, struct pvx_diag *d)
{
    struct experiment_lab l = {.S = NULL};
    pvx_err e = PVX_OK;
    for (size_t v = EXPERIMENT_VIEWS_MIN; v <= experiment_views_max(x); v++)
        for (size_t k = 0; k < experiment_choices(x, v) && e == PVX_OK; k++)
            e = one_choice(x, &l, v, k, d);
    experiment_lab_close(&l);
    return e;
}

/* ---- error against time ---- */

/* Take the least of several times: the first run touches its memory, and others may be disturbed.  The volume is the
 * same each time. */
static pvx_err time_solver(struct experiment *x, struct experiment_lab *l, const char *key,
                           struct pvx_diag *d)
{
    double v[EXPERIMENT_VALUES], least = INFINITY;
    for (int i = 0; i < TIMES; i++) {
        pvx_err e = experiment_measure_measure(l, experiment_used(x), v);
        if (e != PVX_OK)
            return pvx_fail(d, e, "%s: %s", key, pvx_strerror(e));
        least = fmin(least, v[EXPERIMENT_MS]);
    }
    v[EXPERIMENT_MS] = least;
    return experiment_finished(x, key, v, d);
}

static void solver_key(const char *name, enum rec_basis basis, int32_t voxels, char key[64])
{
    snprintf(key, 64, "solver:%s:%s:%d", name, rec_basis_name(basis), voxels);
}

const double *experiment_solver(const struct experiment *x, const char *name, enum rec_basis basis,
                                int32_t voxels)
{
    char key[64];
    solver_key(name, basis, voxels, key);
    return experiment_state_find(&x->state, key);
}

size_t experiment_solver_grids(const struct experiment *x, int32_t voxels[EXPERIMENT_GRIDS + 1])
{
    size_t n = 0;
    int g = 0;
    for (; g < x->o->n_grids && x->o->grids[g] < x->o->grid; g++)
        voxels[n++] = x->o->grids[g];
    voxels[n++] = x->o->grid;
    for (g += g < x->o->n_grids && x->o->grids[g] == x->o->grid; g < x->o->n_grids; g++)
        voxels[n++] = x->o->grids[g];
    return n;
}

static pvx_err one_solver(struct experiment *x, struct experiment_lab *l,
                          struct experiment_lab_params *p, const char *name, struct pvx_diag *d)
{
    char key[64];
    solver_key(name, p->basis, p->voxels, key);
    if (measure_has(x, key))
        return PVX_OK;
    if (cli_stop)
        return PVX_ECANCELED;
    p->frame.solve.solver = name;
    if (l->S == NULL)
        PVX_TRY(experiment_lab_open(l, p, d));
    else
        PVX_TRY(experiment_lab_frame(l, p, d));
    PVX_TRY(experiment_lab_load(l, &x->in, x->set[x->one], d));
    return time_solver(x, l, key, d);
}

/* Measure all solvers on one matrix. */
static pvx_err one_matrix(struct experiment *x, enum rec_basis basis, int32_t voxels,
                          struct pvx_diag *d)
{
    struct experiment_lab l = {.S = NULL};
    struct experiment_lab_params p = experiment_lab_of(x, voxels);
    pvx_err e = PVX_OK;
    p.basis = basis;
    for (const char *const *name = rec_solver_names(); *name != NULL && e == PVX_OK; name++)
        e = one_solver(x, &l, &p, *name, d);
    experiment_lab_close(&l);
    return e;
}

static pvx_err all_solvers(struct experiment *x, struct pvx_diag *d)
{
    int32_t voxels[EXPERIMENT_GRIDS + 1];
    size_t n = experiment_solver_grids(x, voxels);
    for (size_t g = 0; g < n; g++) {
        PVX_TRY(one_matrix(x, REC_BOX, voxels[g], d));
        PVX_TRY(one_matrix(x, REC_TRILINEAR, voxels[g], d));
    }
    return PVX_OK;
}

/* ---- the frame that is looked at closely ---- */

/* The k-th place of n, from the middle outwards. */
static size_t measure_outwards(size_t n, size_t k)
{
    size_t m = n / 2, step = (k + 1) / 2;
    return k % 2 == 1 ? m - step : m + step;
}

/* Find the frame nearest to the middle whose hull is not empty. */
static pvx_err find_one(struct experiment *x, struct pvx_diag *d)
{
    struct experiment_lab l = {.S = NULL};
    struct experiment_lab_params p = experiment_lab_of(x, x->o->grids[0]);
    pvx_err e = experiment_lab_open(&l, &p, d);
    bool found = false;
    for (size_t k = 0; k < x->sets && e == PVX_OK && !found; k++) {
        x->one = measure_outwards(x->sets, k);
        e = cli_stop ? PVX_ECANCELED : experiment_lab_load(&l, &x->in, x->set[x->one], d);
        found = e == PVX_OK && rec_frame_get_report(l.frame)->active_voxels > 0;
    }
    experiment_lab_close(&l);
    if (e == PVX_OK && !found)
        return pvx_fail(d, PVX_ENOENT,
                        "%s: no flame in any of %zu frame sets: the silhouettes of the cameras "
                        "meet nowhere in the rig's box; is --threshold too high or --black "
                        "brighter than the flame, is the rig of this recording?",
                        x->o->frames, x->sets);
    return e;
}

static void count_units(struct experiment *x)
{
    int32_t voxels[EXPERIMENT_GRIDS + 1];
    size_t solvers = 0;
    while (rec_solver_names()[solvers] != NULL)
        solvers++;
    x->units = (size_t)x->o->n_grids * x->sets + experiment_figures() +
               2 * solvers * experiment_solver_grids(x, voxels);
    for (size_t v = EXPERIMENT_VIEWS_MIN; v <= experiment_views_max(x); v++)
        x->units += experiment_choices(x, v);
}

static pvx_err all_grids(struct experiment *x, struct pvx_diag *d)
{
    size_t before = x->state.n;
    int64_t t0 = pvx_now_mono();
    for (int g = 0; g < x->o->n_grids; g++)
        PVX_TRY(one_grid(x, g, d));
    if (x->state.n > before && !x->o->quiet)
        fprintf(stderr, "figure 5: %zu volumes in %.1f s, pictures and matrices included\n",
                x->state.n - before, cli_seconds_since(t0));
    return PVX_OK;
}

pvx_err experiment_measure(struct experiment *x, struct pvx_diag *d)
{
    x->bar = (struct cli_progress){.label = "experiment", .quiet = x->o->quiet};
    count_units(x);
    PVX_TRY(find_one(x, d));
    PVX_TRY(all_grids(x, d));
    PVX_TRY(all_views(x, d));
    PVX_TRY(all_solvers(x, d));
    return experiment_pictures(x, d);
}
