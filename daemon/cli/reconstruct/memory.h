/* memory.h - the memory that a reconstruction of the active part of a grid needs at most, computed beforehand, and the
 * memory that is free.  Bytes. */
#ifndef RECONSTRUCT_MEMORY_H
#define RECONSTRUCT_MEMORY_H
#include "daemon/cli/reconstruct/options.h"
#include "recon/matrix/active.h"
#include "recon/matrix/subsys.h"

/* What the silhouettes of some sets showed. */
struct reconstruct_seen {
    size_t sets;
    double seconds;     /* all of them took */
    size_t bricks_most; /* that one set's hull is in, the most of them */
    double bricks_mean;
    /* Rows of bins of each camera that a slab of a set's columns may reach (recon/matrix/subsys.h); lo > hi: none. */
    struct {
        int32_t lo, hi;
    } rows[REC_SLABS_MAX][REC_MAX_CAMERAS];
    double slabs; /* bins of them all */
};

struct reconstruct_need {
    double look;   /* silhouettes: vote's matrix, outline */
    double build;  /* matrix while it is built */
    double matrix; /* of that what stays */
    double sets;   /* frame sets in work, solver */
    double volume; /* dense, as it is written */
    double base;   /* program, libraries, pictures as they are in their files */
    double most;   /* at any time */
};

/* Upper bounds: every voxel of a set's bricks active, largest windows, all of the rows of bins that a slab is in. */
void reconstruct_need(const struct reconstruct_options *o, const struct rec_rig *rig,
                      const struct rec_frame_params *p, const struct rec_active_estimate *e,
                      const struct reconstruct_seen *seen, struct reconstruct_need *out);

/* The whole matrix while it is built, about: 2x2 or 3x4 windows and 5.4 entries a voxel and camera (NUMERICS.md, 16). */
double reconstruct_whole(const struct rec_rig *rig, const struct rec_sysmat_params *resolved);

/* Four fifths of MemAvailable, or of what the cgroup of this process leaves.  The rest is for other processes and for
 * cached files. */
double reconstruct_room(void);

#endif
