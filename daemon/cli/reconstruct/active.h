/* active.h - the system matrix of a reconstruction.  It is whole and cached.  If that does not fit into memory, it
 * has only the part of the grid where these frame sets have flame (recon/matrix/active.h). */
#ifndef RECONSTRUCT_ACTIVE_H
#define RECONSTRUCT_ACTIVE_H
#include "daemon/cli/reconstruct/memory.h"

struct silhouettes;

/* Least share of the rows of bins that is traced to estimate the size of a matrix (rec_sysmat_estimate_active). */
#define RECONSTRUCT_SHARE 0.03

/* The matrix for the sets of `in`.  Prints on stderr which part of it is built and how much memory that takes.
 * Errors: those of rec_sysmat_open; PVX_ENOMEM: even the part has no room (says what helps); PVX_ENOENT: no flame. */
PVX_MUST_CHECK pvx_err reconstruct_matrix(const struct reconstruct_options *o, struct frames_in *in,
                                          const struct rec_frame_params *p, pvx_pool *pool,
                                          const struct rec_rig *rig, rec_sysmat **out,
                                          struct pvx_diag *d);

/* The k-th of n sets to look at, each once: the first few are spread over all. */
size_t reconstruct_spread(size_t k, size_t n);

/* Frame sets to look at, evenly spread, and how. */
struct reconstruct_look {
    struct frames_in *in; /* has begun */
    const struct rec_frame_params *params;
    const char *background; /* or NULL */
    pvx_pool *pool;
    size_t sets;    /* at most; 0 = all */
    double seconds; /* at most, but two sets; 0 = as long as it takes */
    bool quiet;
};
/* Marks their bricks in `outline`. */
PVX_MUST_CHECK pvx_err reconstruct_mark(const struct reconstruct_look *l, rec_sysmat *outline,
                                        struct reconstruct_seen *out, struct pvx_diag *d);

/* Warn if a set's hull reaches outside the part.  Returns whether it does. */
bool reconstruct_say_cut(const struct rec_frame_report *r, unsigned long long set);

#endif
