/* state.h - what an experiment has measured, kept as it is done: DIR/state/done.csv, a line a unit of work,
 *
 *     KEY,v0,v1,...        "grid:64:000017"  "views:5:12"  "solver:pcg:box"                            (1)
 *
 * and DIR/state/arguments, what it was measured on.  A line that was not written to its end is forgotten.
 * Threads: one.  Owner: caller. */
#ifndef EXPERIMENT_STATE_H
#define EXPERIMENT_STATE_H
#include <stdbool.h>
#include <stdio.h>
#include "base/err.h"

#define EXPERIMENT_VALUES 10

struct experiment_unit {
    char key[64];
    double v[EXPERIMENT_VALUES];
};
struct experiment_state {
    struct experiment_unit *unit; /* [n] in the order in which they were done */
    size_t n, room;
    FILE *file;
};

/* Go on in `out`, made if it is not there.  PVX_EINVAL: it is of other arguments (anew: they are replaced). */
PVX_MUST_CHECK pvx_err experiment_state_open(struct experiment_state *s, const char *out,
                                             const char *arguments, bool anew, struct pvx_diag *d);
void experiment_state_close(struct experiment_state *s);
/* NULL: not done yet. */
const double *experiment_state_find(const struct experiment_state *s, const char *key);
PVX_MUST_CHECK pvx_err experiment_state_add(struct experiment_state *s, const char *key,
                                            const double v[EXPERIMENT_VALUES], struct pvx_diag *d);

#endif
