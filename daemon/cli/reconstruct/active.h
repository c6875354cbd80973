/* active.h - the system matrix of a reconstruction.  Normally it is whole and cached.  If the whole matrix does not
 * fit into memory, only the part where these frame sets have flame is built (recon/matrix/active.h). */
#ifndef RECONSTRUCT_ACTIVE_H
#define RECONSTRUCT_ACTIVE_H
#include "daemon/cli/reconstruct/memory.h"

struct silhouettes;

/* Least share of the rows of bins that is traced to estimate the size of a matrix (rec_sysmat_estimate_active). */
#define RECONSTRUCT_SHARE 0.03

/* Make the matrix for the sets of `in`.  Prints on stderr which part is built and how much memory it takes.
 * Errors: those of rec_sysmat_open; PVX_ENOMEM: even the part has no room (says what helps); PVX_ENOENT: no flame. */
PVX_MUST_CHECK pvx_err reconstruct_matrix(const struct reconstruct_options *o, struct frames_in *in,
                                          const struct rec_frame_params *p, pvx_pool *pool,
                                          const struct rec_rig *rig, rec_sysmat **out,
                                          struct pvx_diag *d);

/* The k-th set to look at, of n.  k = 0 .. n-1 gives each set once, and the first few are spread over all. */
size_t reconstruct_spread(size_t k, size_t n);

/* Which frame sets to look at (spread evenly), and how. */
struct reconstruct_look {
    struct frames_in *in; /* has begun */
    const struct rec_frame_params *params;
    const char *background; /* or NULL */
    pvx_pool *pool;
    size_t sets;    /* at most; 0 = all */
    double seconds; /* at most, but at least two sets; 0 = no limit */
    bool quiet;
};
/* Marks the bricks of their hulls in `outline`. */
PVX_MUST_CHECK pvx_err reconstruct_mark(const struct reconstruct_look *l, rec_sysmat *outline,
                                        struct reconstruct_seen *out, struct pvx_diag *d);

/* Warn if a set's hull reaches outside the part.  Returns whether it does. */
bool reconstruct_say_cut(const struct rec_frame_report *r, unsigned long long set);

#endif
