/* state.h - the results of an experiment, saved one by one: DIR/state/done.csv, a line for each unit of work,
 *
 *     KEY,v0,v1,...        "grid:64:000017"  "views:5:12"  "solver:pcg:box"                            (1)
 *
 * and DIR/state/arguments, the arguments of the run.  An incomplete last line is ignored.
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

/* Continue in `out`, which is made if it does not exist.  anew: begin again.  PVX_EINVAL: it has other arguments. */
PVX_MUST_CHECK pvx_err experiment_state_open(struct experiment_state *s, const char *out,
                                             const char *arguments, bool anew, struct pvx_diag *d);
void experiment_state_close(struct experiment_state *s);
/* Values of a unit.  NULL: not done yet. */
const double *experiment_state_find(const struct experiment_state *s, const char *key);
PVX_MUST_CHECK pvx_err experiment_state_add(struct experiment_state *s, const char *key,
                                            const double v[EXPERIMENT_VALUES], struct pvx_diag *d);

#endif
