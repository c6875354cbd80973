/* ranks_mpi.c - the module pyrovox-mpi.so: ranks.h by MPI.  In C, since MPI has a C API; a module, since Open MPI is
 * wanted only where it starts the processes. */
#include <mpi.h>

#include "daemon/cli/reconstruct/ranks.h"

static MPI_Comm node;

static bool ranks_mpi_begin(unsigned *rank, unsigned *n, unsigned *on_node, unsigned *node_n)
{
    int had, all, mine, there, together;
    /* a failed call ends the program with MPI's own message */
    if (MPI_Init_thread(NULL, NULL, MPI_THREAD_FUNNELED, &had) != MPI_SUCCESS)
        return false;
    MPI_Comm_rank(MPI_COMM_WORLD, &mine);
    MPI_Comm_size(MPI_COMM_WORLD, &all);
    MPI_Comm_split_type(MPI_COMM_WORLD, MPI_COMM_TYPE_SHARED, mine, MPI_INFO_NULL, &node);
    MPI_Comm_rank(node, &there);
    MPI_Comm_size(node, &together);
    *rank = (unsigned)mine;
    *n = (unsigned)all;
    *on_node = (unsigned)there;
    *node_n = (unsigned)together;
    return true;
}

static int worst(int value)
{
    int all = value;
    MPI_Allreduce(&value, &all, 1, MPI_INT, MPI_MAX, MPI_COMM_WORLD);
    return all;
}

static void node_barrier(void)
{
    MPI_Barrier(node);
}

static void ranks_mpi_end(void)
{
    MPI_Comm_free(&node);
    MPI_Finalize();
}

const struct ranks_module *pyrovox_ranks(void);
const struct ranks_module *pyrovox_ranks(void)
{
    static const struct ranks_module module = {.version = RANKS_VERSION,
                                               .open = ranks_mpi_begin,
                                               .worst = worst,
                                               .node_barrier = node_barrier,
                                               .close = ranks_mpi_end};
    return &module;
}
