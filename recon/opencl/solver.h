/* solver.h - the vectors of a solver on a device, and the operations of solve/card.h.
 * Ownership: a solver's (frame/impl.h).  Threads: one at a time.  Private to recon. */
#ifndef REC_CL_SOLVER_H
#define REC_CL_SOLVER_H
#include "recon/opencl/system.h"
#include "recon/solve/levels.h"

typedef struct rec_cl_solver rec_cl_solver;

extern const struct rec_card_ops rec_cl_ops;

/* Twins of all vectors of `fine`, and of the descent's where there is one, with room for `columns` columns on the
 * finest level.  Borrows `fine`.  Errors: PVX_ENOMEM, PVX_ENODEV. */
PVX_MUST_CHECK pvx_err rec_cl_solver_new(rec_cl_matrix *m, int cs, size_t columns,
                                         rec_problem *fine, struct rec_descent *d,
                                         rec_cl_solver **out, struct pvx_diag *d_);
void rec_cl_solver_free(rec_cl_solver **s);

/* From now on the operations are on this set, which rec_cl_carve made. */
void rec_cl_solver_begin(rec_cl_solver *s, rec_cl_system *y);
/* The name of x on the finest level. */
float *rec_cl_solver_x(rec_cl_solver *s);
/* x = an earlier volume on this set's voxels, 0 where it had none.  index [n], value [n][cs]. */
void rec_cl_solver_earlier(rec_cl_solver *s, int32_t n, const int32_t *index, const float *value);
/* Downloads x [n][cs].  false: the device was lost meanwhile, and `to` has nothing. */
bool rec_cl_solver_end(rec_cl_solver *s, float *to);

#endif
