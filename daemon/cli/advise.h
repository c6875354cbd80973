/* advise.h - what `pyrovox advise` measures in a recording, and what it says of it. */
#ifndef ADVISE_H
#define ADVISE_H
#include "daemon/cli/flame_sets.h"
#include "recon/check/absorption.h"

#define ADVISE_GRIDS 5

struct advise_grid {
    int32_t voxels; /* along the longest side */
    double error, ms;
};
struct advice {
    /* pictures, over all sets */
    double brightest;      /* measured value, full scale = 1 */
    double saturated, lit; /* share of the flame's bins at full scale; of all bins that are flame */
    double sigma;          /* noise */
    double level;          /* largest of the cameras' dark levels, */
    size_t level_camera;   /* and whose that is */
    struct rec_absorption absorption;
    double basis[2]; /* error of left-out pictures: box, trilinear */
    struct advise_grid grid[ADVISE_GRIDS];
    size_t n_grids, best_grid; /* the coarsest that is not worse by REC_ADVISE_SAME than the best */
    int32_t finest;            /* that the pictures hold, rec_rig_finest */
    double half, all;          /* error with every second camera, with all but the one */
};
#define ADVISE_SAME      1.02  /* errors that are alike */
#define ADVISE_LEVEL     0.002 /* half a step of 8 bits */
#define ADVISE_SATURATED 0.005

/* Errors: PVX_ENOENT: no flame; PVX_ECANCELED; those of unseen.h. */
PVX_MUST_CHECK pvx_err advise_measure(struct flame_sets *s, struct advice *a, struct pvx_diag *d);
/* A line a term on stdout, then a configuration to paste. */
void advise_print(const struct flame_sets *s, const struct advice *a);

#endif
