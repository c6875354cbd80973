/* marks.h - the bricks of a grid that are marked, and the columns that follow (marks.c; active.h).  Not for other
 * modules. */
#ifndef REC_MARKS_H
#define REC_MARKS_H
#include "recon/matrix/active.h"

/* In this order: a new set without marks; the columns of the marks; the marks of a coarser grid, with their columns.
 * PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_active_new(const struct rec_grid *g, struct rec_active **out);
PVX_MUST_CHECK pvx_err rec_active_close(struct rec_active *a, const struct rec_grid *g);
PVX_MUST_CHECK pvx_err rec_active_coarser(const struct rec_active *a, const struct rec_grid *g,
                                          const struct rec_grid *coarse, struct rec_active **out);
void rec_active_free(struct rec_active **a);

#endif
