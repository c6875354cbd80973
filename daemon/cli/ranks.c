#include "daemon/cli/ranks.h"

#include <stdlib.h>

#include "base/module.h"

/* As mpirun says it, or srun by PMIx or PMI-2. */
static bool one_of_several(void)
{
    static const char *const sizes[] = {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE"};
    for (int i = 0; i < 2; i++)
        if (getenv(sizes[i]) != NULL && atoi(getenv(sizes[i])) > 1)
            return true;
    const char *tasks = getenv("SLURM_STEP_NUM_TASKS");
    return getenv("PMIX_RANK") != NULL && tasks != NULL && atoi(tasks) > 1;
}

pvx_err ranks_open(struct ranks *r, struct pvx_diag *d)
{
    char why[700] = "";
    *r = (struct ranks){.n = 1};
    if (!one_of_several())
        return PVX_OK;
    r->module = pvx_module_load("pyrovox-mpi.so", "pyrovox_ranks", RANKS_VERSION, why, sizeof why);
    if (r->module == NULL)
        return pvx_fail(d, PVX_EUNSUP, "several processes were started together, but %s", why);
    if (r->module->open(&r->rank, &r->n, &r->on_node))
        return PVX_OK;
    r->module = NULL;
    return pvx_fail(d, PVX_EIO, "MPI cannot be begun");
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
