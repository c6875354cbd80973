/* memory.h - the most memory that a reconstruction of the active part of a grid can need, computed beforehand, and
 * the memory that is free.  All in bytes. */
#ifndef RECONSTRUCT_MEMORY_H
#define RECONSTRUCT_MEMORY_H
#include "daemon/cli/reconstruct/options.h"
#include "recon/matrix/active.h"
#include "recon/matrix/subsys.h"

/* Figures from the silhouettes of some sets. */
struct reconstruct_seen {
    size_t sets;
    double seconds;     /* for all sets together */
    size_t bricks_most; /* most bricks that the hull of one set is in */
    double bricks_mean;
    /* Rows of bins of each camera that a slab of a set's columns may reach (recon/matrix/subsys.h).  lo > hi:
     * none. */
    struct {
        int32_t lo, hi;
    } rows[REC_SLABS_MAX][REC_MAX_CAMERAS];
    double slabs; /* bins of all of them */
};

struct reconstruct_need {
    double look;   /* silhouettes: vote's matrix, outline */
    double build;  /* matrix while it is built */
    double matrix; /* matrix after it is built */
    double sets;   /* frame sets in work, solver */
    double volume; /* dense, as it is written */
    double base;   /* program, libraries, pictures as they are in their files */
    double most;   /* largest total at any time */
};

/* Computes upper bounds.  They assume that every voxel of a set's bricks is active, that windows are largest, and
 * that a slab needs all of the rows of bins that it is in. */
void reconstruct_need(const struct reconstruct_options *o, const struct rec_rig *rig,
                      const struct rec_frame_params *p, const struct rec_active_estimate *e,
                      const struct reconstruct_seen *seen, struct reconstruct_need *out);

/* Four fifths of MemAvailable, or of what the cgroup of this process leaves.  The rest is for other processes and for
 * cached files. */
double reconstruct_room(void);

#endif
