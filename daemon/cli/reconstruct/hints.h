/* hints.h - warnings about the volumes of a recording, printed once at its end with the remedy: all volumes are
 * empty, the deadline allowed no iteration, or the flame reaches the sides of a fitted box. */
#ifndef RECONSTRUCT_HINTS_H
#define RECONSTRUCT_HINTS_H
#include "daemon/cli/reconstruct/options.h"

struct reconstruct_hints {
    unsigned volumes;
    unsigned empty;     /* volumes without a voxel of light */
    unsigned dark;      /* without one iteration before the deadline */
    unsigned cut;       /* with flame at a side of the fitted box */
    unsigned corrected; /* with gain or aim of the cameras corrected in the solve */
    struct {            /* sums over those in which the camera was estimated */
        unsigned n;
        double gain, shift[2];
    } camera[REC_MAX_CAMERAS];
};

/* Count a volume.  whole: the rig's box if the volume was fitted, or NULL. */
void reconstruct_hints_add(struct reconstruct_hints *h, const struct rec_frame_report *r,
                           const struct rec_sparse *v, const struct rec_grid *whole);
/* On stderr. */
void reconstruct_hints_say(const struct reconstruct_hints *h, const struct reconstruct_options *o,
                           const struct rec_rig *rig);

#endif
