/* ranks.h - the processes that mpirun or srun started together.  Only they load the module pyrovox-mpi.so (Open MPI).
 * A process that was started alone is rank 0 of 1, and every call returns at once.
 * Threads: that of main.  All ranks must make the same calls in the same order. */
#ifndef CLI_RANKS_H
#define CLI_RANKS_H
#include <stdbool.h>
#include "base/err.h"

#define RANKS_VERSION 1

/* The functions of the module (ranks_mpi.c). */
struct ranks_module {
    int version;
    bool (*open)(unsigned *rank, unsigned *n, unsigned *on_node, unsigned *node_n);
    int (*worst)(int value);    /* the largest value of all ranks */
    void (*node_barrier)(void); /* until all ranks of this node are here */
    void (*close)(void);
};

struct ranks {
    unsigned rank, n;
    unsigned on_node, node_n; /* place among the ranks of this node, and their number */
    const struct ranks_module *module;
};

/* Errors: PVX_EUNSUP (several processes, but the module is not installed: names the package), PVX_EIO. */
PVX_MUST_CHECK pvx_err ranks_open(struct ranks *r, struct pvx_diag *d);
/* Returns e, or PVX_ECANCELED if only another rank failed. */
pvx_err ranks_all(const struct ranks *r, pvx_err e);
/* Returns the largest value of all ranks. */
int ranks_worst(const struct ranks *r, int value);
/* Between these two calls the first process of a node works while the others wait. */
void ranks_first(const struct ranks *r);
void ranks_others(const struct ranks *r);
void ranks_close(struct ranks *r);
#endif
