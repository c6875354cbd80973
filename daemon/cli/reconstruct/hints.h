/* hints.h - what is odd about a recording's volumes, told once at its end, with the remedy: all of them empty,
 * stopped before they began, cut at the sides of a fitted box. */
#ifndef RECONSTRUCT_HINTS_H
#define RECONSTRUCT_HINTS_H
#include "daemon/cli/reconstruct/options.h"

struct reconstruct_hints {
    unsigned volumes;
    unsigned empty; /* of them, without a voxel of light */
    unsigned dark;  /* without one iteration before the deadline */
    unsigned cut;   /* flame at a side of the fitted box */
};

/* One volume more; `whole`: the box that one was fitted in, or NULL. */
void reconstruct_hints_add(struct reconstruct_hints *h, const struct rec_frame_report *r,
                           const struct rec_sparse *v, const struct rec_grid *whole);
/* On stderr. */
void reconstruct_hints_say(const struct reconstruct_hints *h, const struct reconstruct_options *o);

#endif
