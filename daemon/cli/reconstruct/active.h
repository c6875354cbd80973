/* active.h - the matrix of a reconstruction: whole and cached, or, where that would not fit into memory, of
 * the part of the grid where the flame is in these frame sets (recon/matrix/active.h). */
#ifndef RECONSTRUCT_ACTIVE_H
#define RECONSTRUCT_ACTIVE_H
#include "daemon/cli/reconstruct/memory.h"

struct silhouettes;

/* Of the rows of bins, at least: what of a matrix is traced to know what it would take (rec_sysmat_estimate_active). */
#define RECONSTRUCT_SHARE 0.03

/* The matrix that the sets of `in` are solved with; which part of it and what that takes is said on stderr.
 * Errors: as rec_sysmat_open; PVX_ENOMEM: even the part has no room, with what helps; PVX_ENOENT: no flame. */
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

/* A set's hull leaves the part: says so.  Whether it does. */
bool reconstruct_say_cut(const struct rec_frame_report *r, unsigned long long set);

#endif
