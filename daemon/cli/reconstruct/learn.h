/* learn.h - gain and aim of the cameras from some sets of a recording, before it is reconstructed
 * (recon/solve/average.h).  Every set is then corrected alike, so no volume depends on which process solves it.
 * A tenth of the sets are solved for it, RECONSTRUCT_LEARN_LEAST to RECONSTRUCT_LEARN_MOST, spread over the recording.
 * Where they find something, a second round starts from it.  That is at most a fifth of the time of a recording of 50
 * sets or more, and a tenth where the rig is right. */
#ifndef RECONSTRUCT_LEARN_H
#define RECONSTRUCT_LEARN_H
#include "daemon/cli/reconstruct/options.h"
#include "recon/solve/average.h"

#define RECONSTRUCT_LEARN_LEAST  5 /* with fewer, every set corrects itself */
#define RECONSTRUCT_LEARN_MOST   20
#define RECONSTRUCT_LEARN_ROUNDS 2

/* Sets of a round for a recording of n sets; 0: nothing is learnt. */
size_t reconstruct_learn_sets(const struct rec_frame_params *p, size_t cameras, size_t n);

/* What is learnt from, and how. */
struct reconstruct_learn {
    struct frames_in *in; /* has begun: all sets of the recording */
    const struct rec_frame_params *params;
    float *const *background; /* [cameras], or NULL */
    const rec_sysmat *S;
    const struct rec_rig *rig;
    pvx_pool *pool;
    bool quiet;
};
/* *out: what was learnt, fixed; NULL: nothing is, and every set corrects itself.  Owner: caller.
 * Errors: those of rec_frame_solve; PVX_ECANCELED: Ctrl-C. */
PVX_MUST_CHECK pvx_err reconstruct_learn(const struct reconstruct_learn *l, rec_average **out,
                                         struct pvx_diag *d);

#endif
