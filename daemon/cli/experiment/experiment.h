/* experiment.h - the parts of `pyrovox experiment`: measurements (measure.c), CSV files (csv.c), pictures
 * (pictures.c) and a report (report.c).
 * Threads: one, parallel inside. */
#ifndef EXPERIMENT_H
#define EXPERIMENT_H
#include "daemon/cli/common/cli.h"
#include "daemon/cli/experiment/lab.h"
#include "daemon/cli/experiment/options.h"
#include "daemon/cli/experiment/state.h"

#define EXPERIMENT_VIEWS_MIN 3
#define EXPERIMENT_VIEWS_MAX 7
#define EXPERIMENT_CHOICES   35 /* of views, at most */

/* Places among a unit's values. */
enum {
    EXPERIMENT_INSIDE,  /* [3] difference in the model's silhouette */
    EXPERIMENT_ALL = 3, /* [3] difference in the model's and the picture's silhouette */
    EXPERIMENT_MS = 6,  /* of hull, restriction and solution */
    EXPERIMENT_VOXELS,  /* in the hull; 0: no flame */
    EXPERIMENT_BINS,    /* compared bins, in the model's silhouette */
    EXPERIMENT_ITERATIONS
};

struct experiment {
    const struct experiment_options *o;
    struct rec_rig rig;
    pvx_pool *pool;
    dmn_photometry *light;
    struct frames_in in;
    struct rec_frame_params params;
    struct rec_sysmat_params
        matrix; /* one binning for all grids, so that the same bins are compared */
    size_t unused;
    size_t *set;      /* [sets] places in `in`, ascending */
    size_t sets, one; /* one: the frame of the experiments on one frame, a place in `set` */
    struct experiment_state state;
    struct cli_progress bar;
    size_t units; /* in all */
};

/* Measure everything that was not measured yet.  PVX_ECANCELED: stopped; finished units are kept. */
PVX_MUST_CHECK pvx_err experiment_measure(struct experiment *x, struct pvx_diag *d);
/* Parameters of a lab with this many voxels along the longest side, at the experiment's binning. */
struct experiment_lab_params experiment_lab_of(struct experiment *x, int32_t voxels);
/* The number of choices of `views` of the rig's cameras that are measured, and the k-th choice as a mask. */
size_t experiment_choices(const struct experiment *x, size_t views);
uint64_t experiment_choice(const struct experiment *x, size_t views, size_t k);
/* The most views that leave one camera to compare with. */
size_t experiment_views_max(const struct experiment *x);
uint64_t experiment_used(const struct experiment *x); /* all but the unused one */

/* Mean and standard deviation of units' values over n frames of a grid, or over n choices of a number of views. */
struct experiment_mean {
    double mean[EXPERIMENT_VALUES], spread[EXPERIMENT_VALUES];
    size_t n;
};
struct experiment_mean experiment_mean_of(const struct experiment *x, const char *prefix);

/* Values of frame i of `set` on grid g (NULL: not measured), and the mean over all frames on that grid. */
const double *experiment_grid(const struct experiment *x, int g, size_t i);
struct experiment_mean experiment_grid_mean(const struct experiment *x, int g);

/* Values of a solver on the one frame (NULL: not measured), and the grids measured, ascending: those of Figure 5 and
 * the experiment's own. */
const double *experiment_solver(const struct experiment *x, const char *name, enum rec_basis basis,
                                int32_t voxels);
size_t experiment_solver_grids(const struct experiment *x, int32_t voxels[EXPERIMENT_GRIDS + 1]);

/* Store a finished unit, and show the progress. */
PVX_MUST_CHECK pvx_err experiment_finished(struct experiment *x, const char *key, const double *v,
                                           struct pvx_diag *d);

/* Draw the figures as PNG.  Each figure is a unit.  Values of
 *   figure:3  share of the unused view's light on dark bins, mean difference of all bins: with hull, and without;
 *             share of the emission outside the hull
 *   figure:4  voxels inside, partly inside, outside
 *   figure:7  difference of each channel in the model's silhouette, then with the picture's as well; correlation of
 *             picture and model
 *   figure:8  numbers of the frames
 * Errors: the files'; PVX_ECANCELED. */
PVX_MUST_CHECK pvx_err experiment_pictures(struct experiment *x, struct pvx_diag *d);
size_t experiment_figures(void);

/* fig5.csv fig6a.csv fig6b.csv solvers.csv.  Errors: the files'. */
PVX_MUST_CHECK pvx_err experiment_csv(const struct experiment *x, struct pvx_diag *d);

#endif
