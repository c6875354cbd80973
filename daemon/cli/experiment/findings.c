/* findings.c - the findings of the paper, and whether they hold for this recording. */
#include <math.h>
#include <string.h>

#include "daemon/cli/experiment/report.h"

#define SAME 1.02 /* values within this factor count as equal */

double experiment_over_channels(const struct experiment *x, const double *v)
{
    double sum = 0;
    for (int i = 0; i < x->in.nch; i++)
        sum += v[i];
    return sum / x->in.nch;
}

static double grid_error(const struct experiment *x, int g, int what)
{
    struct experiment_mean m = experiment_grid_mean(x, g);
    return experiment_over_channels(x, m.mean + what);
}

static double views_error(const struct experiment *x, size_t views)
{
    char key[64];
    snprintf(key, sizeof key, "views:%zu:", views);
    struct experiment_mean m = experiment_mean_of(x, key);
    return experiment_over_channels(x, m.mean + EXPERIMENT_INSIDE);
}

static const double *figure(const struct experiment *x, const char *key)
{
    static const double none[EXPERIMENT_VALUES];
    const double *v = experiment_state_find(&x->state, key);
    return v != NULL ? v : none;
}

#define SAY(f, ...) snprintf((f)->here, sizeof(f)->here, __VA_ARGS__)

static void hull(const struct experiment *x, struct experiment_finding *f)
{
    const double *v = figure(x, "figure:3");
    f->figure = "3, visual hull";
    f->paper = "Without the visual hull, ghosts appear where no flame is; with it they are gone.";
    SAY(f,
        "Without the hull %.1f %% of the light in the unused view falls where the picture is dark, "
        "with it %.1f %%; %.1f %% of the emission lay outside the hull. The mean difference over "
        "all of the picture falls from %.2f to %.2f of 255.",
        100 * v[2], 100 * v[0], 100 * v[4], v[3], v[1]);
    f->holds = v[0] < v[2] && v[1] < v[3];
}

static void findings_counts(const struct experiment *x, struct experiment_finding *f)
{
    const double *v = figure(x, "figure:4");
    double all = fmax(1, v[0] + v[1] + v[2]), share = (v[0] + v[1]) / all;
    f->figure = "4, coefficients";
    f->paper = "Of all coefficients about a tenth contribute.";
    SAY(f,
        "%.0f inside the hull, %.0f partly inside, %.0f outside: %.1f %% contribute. (The share is "
        "that of the flame in the rig's box: a tight box raises it.)",
        v[0], v[1], v[2], 100 * share);
    f->holds = share < 0.2;
}

/* Count the frames with flame that are better on the finest grid than on the coarsest. */
static void frames(const struct experiment *x, struct experiment_finding *f)
{
    size_t n = 0, better = 0;
    int last = x->o->n_grids - 1;
    for (size_t i = 0; i < x->sets; i++) {
        const double *a = experiment_grid(x, 0, i), *b = experiment_grid(x, last, i);
        if (a == NULL || b == NULL || !(a[EXPERIMENT_VOXELS] > 0) || !(b[EXPERIMENT_VOXELS] > 0))
            continue;
        n++;
        better += experiment_over_channels(x, b) < experiment_over_channels(x, a);
    }
    f->figure = "5, by frame";
    f->paper = "In every frame a finer grid comes nearer to the unused view.";
    SAY(f, "%d voxels are nearer to it than %d in %zu of %zu frames with flame.", x->o->grids[last],
        x->o->grids[0], better, n);
    f->holds = last == 0 ? -1 : n > 0 && (double)better >= 0.9 * (double)n;
}

static void findings_grids(const struct experiment *x, struct experiment_finding *f)
{
    int last = x->o->n_grids - 1;
    double first = grid_error(x, 0, EXPERIMENT_INSIDE),
           end = grid_error(x, last, EXPERIMENT_INSIDE);
    bool falls = end < first;
    f->figure = "6b, by grid";
    f->paper = "The finer the grid, the smaller the mean error; it converges.";
    for (int g = 1; g <= last; g++)
        falls &=
            grid_error(x, g, EXPERIMENT_INSIDE) <= SAME * grid_error(x, g - 1, EXPERIMENT_INSIDE);
    if (last == 0) {
        SAY(f, "%d voxels: %.2f of 255; there is no other grid to compare with.", x->o->grids[0],
            first);
        f->holds = -1;
        return;
    }
    double before = grid_error(x, last - 1, EXPERIMENT_INSIDE);
    SAY(f,
        "From %.2f of 255 with %d voxels to %.2f with %d; the last step, from %d voxels, changes "
        "it by %+.1f %%.%s",
        first, x->o->grids[0], end, x->o->grids[last], x->o->grids[last - 1],
        100 * (end / fmax(before, 1e-9) - 1),
        end > SAME * first ? " Finer grids are worse if cameras contradict each other: `pyrovox "
                             "calibrate check` names them, `calibrate refine` corrects poses."
                           : "");
    f->holds = falls;
}

static void rim(const struct experiment *x, struct experiment_finding *f)
{
    int last = x->o->n_grids - 1;
    double in = grid_error(x, last, EXPERIMENT_INSIDE), all = grid_error(x, last, EXPERIMENT_ALL);
    f->figure = "6.2, silhouettes";
    f->paper = "Calibration errors make the hull too small; the pixels beside it, left out of the "
               "error, do not occur with synthetic images.";
    SAY(f,
        "With the pixels that only the picture's silhouette has, the error on the finest grid is "
        "%.2f of 255 instead of %.2f (%+.1f %%): %s.",
        all, in, 100 * (all / fmax(in, 1e-9) - 1),
        all > 1.1 * in ? "the hull is too small: calibrate anew, or give a --margin"
                       : "no hull is too small (a few pixels off would not show in it: `pyrovox "
                         "calibrate check`)");
    f->holds = all > 1.1 * in ? 1 : -1;
}

static void views(const struct experiment *x, struct experiment_finding *f)
{
    size_t lo = EXPERIMENT_VIEWS_MIN, hi = experiment_views_max(x);
    double first = views_error(x, lo), end = views_error(x, hi);
    bool falls = end < first;
    f->figure = "6a, by views";
    f->paper = "The more views, the smaller the error; 4 to 5 are acceptable.";
    for (size_t v = lo + 1; v <= hi; v++)
        falls &= views_error(x, v) <= SAME * views_error(x, v - 1);
    if (hi == lo)
        SAY(f, "3 views: %.2f of 255; with four cameras there is no more to compare.", first);
    else
        SAY(f,
            "From %.2f of 255 with %zu views to %.2f with %zu, the mean over the choices of views; "
            "four views are at %.2f.",
            first, lo, end, hi, views_error(x, 4));
    f->holds = hi == lo ? -1 : falls;
}

static void view(const struct experiment *x, struct experiment_finding *f)
{
    const double *v = figure(x, "figure:7");
    f->figure = "7, unused view";
    f->paper = "The volume seen from the unused camera is like its picture.";
    SAY(f,
        "Where either shows light, their correlation is %.3f; the mean difference is %.2f of 255.",
        v[6], experiment_over_channels(x, v));
    f->holds = v[6] >= 0.95;
}

static double solver_error(const struct experiment *x, const double *v)
{
    return v != NULL ? experiment_over_channels(x, v) : NAN;
}

/* List the solvers that are better and faster than `own`, in any basis, on any grid.  Returns how many they are. */
static size_t ahead_of(const struct experiment *x, const double *own, char *list, size_t size)
{
    int32_t voxels[EXPERIMENT_GRIDS + 1];
    size_t grids = experiment_solver_grids(x, voxels), n = 0;
    list[0] = '\0';
    for (size_t i = 0; i < 2 * grids; i++)
        for (const char *const *name = rec_solver_names(); *name != NULL; name++) {
            enum rec_basis basis = i % 2 == 0 ? REC_BOX : REC_TRILINEAR;
            const double *v = experiment_solver(x, *name, basis, voxels[i / 2]);
            if (v == NULL || !(solver_error(x, v) < solver_error(x, own)) ||
                !(v[EXPERIMENT_MS] < own[EXPERIMENT_MS]))
                continue;
            if (n++ < 4)
                snprintf(list + strlen(list), size - strlen(list), "%s%s (%s, %d)",
                         n > 1 ? ", " : "", *name, rec_basis_name(basis), voxels[i / 2]);
        }
    return n;
}

/* Compare the default solver with the paper's, and list the solvers that are better in both error and time. */
static void solvers(const struct experiment *x, struct experiment_finding *f)
{
    enum rec_basis basis = x->rig.grid.basis;
    const double *own = experiment_solver(x, rec_solver_names()[0], basis, x->o->grid);
    const double *paper = experiment_solver(x, "cgls-paper", basis, x->o->grid);
    char ahead[240];
    f->figure = "error against time";
    f->paper = "(Not in the paper: its solver is cgls-paper.)";
    f->holds = -1;
    if (own == NULL || paper == NULL)
        return;
    size_t n = ahead_of(x, own, ahead, sizeof ahead);
    SAY(f,
        "The default, %s, has %.2f of the error of the paper's solver in %.2f of its time (%s "
        "basis, %d voxels). Of everything measured, better and faster than that: %s%s.",
        rec_solver_names()[0], solver_error(x, own) / fmax(solver_error(x, paper), 1e-9),
        own[EXPERIMENT_MS] / fmax(paper[EXPERIMENT_MS], 1e-9), rec_basis_name(basis), x->o->grid,
        n > 0 ? ahead : "nothing", n > 4 ? " and more" : "");
}

void experiment_findings(const struct experiment *x,
                         struct experiment_finding out[EXPERIMENT_FINDINGS])
{
    const double *two = figure(x, "figure:8");
    hull(x, &out[FINDING_HULL]);
    findings_counts(x, &out[FINDING_COUNTS]);
    frames(x, &out[FINDING_FRAMES]);
    findings_grids(x, &out[FINDING_GRIDS]);
    rim(x, &out[FINDING_RIM]);
    views(x, &out[FINDING_VIEWS]);
    view(x, &out[FINDING_VIEW]);
    out[FINDING_FLAMES] = (struct experiment_finding){
        .figure = "8, two flames", .paper = "Flames look like flames from all sides.", .holds = -1};
    SAY(&out[FINDING_FLAMES],
        "Frames %.0f and %.0f from all cameras, over 120 degrees; to look at.", two[0], two[1]);
    solvers(x, &out[FINDING_SOLVERS]);
}
