#include "daemon/cli/reconstruct/ranks.h"

#include <stdlib.h>

#include "base/module.h"

static bool several(const char *name)
{
    const char *n = getenv(name);
    return n != NULL && atoi(n) > 1;
}

/* Whether several processes were started together, from the environment that mpirun or srun sets. */
static bool one_of_several(void)
{
    return several("OMPI_COMM_WORLD_SIZE") || several("PMI_SIZE") ||
           several("SLURM_STEP_NUM_TASKS");
}

pvx_err ranks_open(struct ranks *r, struct pvx_diag *d)
{
    static struct pvx_module module = {
        .file = "pyrovox-mpi.so", .entry = "pyrovox_ranks", .version = RANKS_VERSION};
    *r = (struct ranks){.n = 1, .node_n = 1};
    if (!one_of_several())
        return PVX_OK;
    r->module = pvx_module(&module);
    if (r->module == NULL)
        return pvx_fail(d, PVX_EUNSUP, "several processes were started together, but %.600s",
                        module.why);
    bool begun = r->module->open(&r->rank, &r->n, &r->on_node, &r->node_n);
    if (begun && r->n > 1)
        return PVX_OK;
    if (begun)
        ranks_close(r);
    r->module = NULL;
    return pvx_fail(d, PVX_EIO,
                    "several processes were started together, but MPI sees one: start them by "
                    "mpirun, or by srun --mpi=pmix");
}

int ranks_worst(const struct ranks *r, int value)
{
    return r->module != NULL ? r->module->worst(value) : value;
}

pvx_err ranks_all(const struct ranks *r, pvx_err e)
{
    int worst = ranks_worst(r, (int)e);
    return e == PVX_OK && worst != PVX_OK ? PVX_ECANCELED : e;
}

void ranks_first(const struct ranks *r)
{
    if (r->module != NULL && r->on_node > 0)
        r->module->node_barrier();
}

void ranks_others(const struct ranks *r)
{
    if (r->module != NULL && r->on_node == 0)
        r->module->node_barrier();
}

void ranks_close(struct ranks *r)
{
    if (r->module != NULL)
        r->module->close();
    r->module = NULL;
}
