/* options.h - the command line of `pyrovox experiment`. */
#ifndef EXPERIMENT_OPTIONS_H
#define EXPERIMENT_OPTIONS_H
#include "daemon/cli/common/frames_in.h"
#include "daemon/cli/common/opt_rig.h"
#include "recon/frame/frame.h"

#define EXPERIMENT_GRIDS 16

struct experiment_options {
    struct opt_rig rig;
    const char *frames, *out, *unused; /* unused NULL = the rig's first camera */
    int32_t grids[EXPERIMENT_GRIDS];   /* ascending: voxels along the longest side */
    int n_grids;
    int32_t grid; /* of the experiments on one frame */
    int64_t first, last;
    uint32_t frames_max;
    struct rec_frame_params frame;
    struct frames_in_reading reading;
    bool grey, anew, quiet;
};

/* Exits on wrong usage and on --help. */
void experiment_parse(int argc, char **argv, struct experiment_options *o);

#endif
