/* units.c - what every unit of an experiment starts from and ends with. */
#include <math.h>
#include <string.h>

#include "daemon/cli/experiment/experiment.h"

uint64_t experiment_used(const struct experiment *x)
{
    return (x->rig.n_cameras == 64 ? UINT64_MAX : ((uint64_t)1 << x->rig.n_cameras) - 1) &
           ~((uint64_t)1 << x->unused);
}

static struct cli_progress silent = {.quiet = true}; /* only stops the work at Ctrl-C */

struct experiment_lab_params experiment_lab_of(struct experiment *x, int32_t voxels)
{
    return (struct experiment_lab_params){.rig = &x->rig,
                                          .voxels = voxels,
                                          .basis = x->rig.grid.basis,
                                          .matrix = x->matrix,
                                          .frame = x->params,
                                          .pool = x->pool,
                                          .progress = {cli_progress, &silent}};
}

pvx_err experiment_finished(struct experiment *x, const char *key, const double *v,
                            struct pvx_diag *d)
{
    PVX_TRY(experiment_state_add(&x->state, key, v, d));
    /* a unit that is made again counts only once */
    cli_progress(&x->bar, (double)x->state.n / (double)x->units);
    return PVX_OK;
}

/* Frames without flame do not count in the means. */
struct experiment_mean experiment_mean_of(const struct experiment *x, const char *prefix)
{
    struct experiment_mean m = {.n = 0};
    size_t len = strlen(prefix);
    for (size_t i = 0; i < x->state.n; i++) {
        const struct experiment_unit *u = &x->state.unit[i];
        if (strncmp(u->key, prefix, len) != 0 || !(u->v[EXPERIMENT_VOXELS] > 0))
            continue;
        m.n++;
        for (int k = 0; k < EXPERIMENT_VALUES; k++) {
            double from = u->v[k] - m.mean[k]; /* Welford */
            m.mean[k] += from / (double)m.n;
            m.spread[k] += from * (u->v[k] - m.mean[k]);
        }
    }
    for (int k = 0; k < EXPERIMENT_VALUES; k++)
        m.spread[k] = m.n > 1 ? sqrt(m.spread[k] / (double)(m.n - 1)) : 0;
    return m;
}
