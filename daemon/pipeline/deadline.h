/* deadline.h - how long the solver may take for a frame set, from measured solves.
 *
 * A configured limit (solver.deadline_ms) holds as it is.  Otherwise a solve ends `limit_ns` after its set came.  It
 * gets at most 0.9 periods, to keep up with the cameras, and at least half a period, however late its set was.
 * If that is too short for a solution (another program has the processors), the solver gets up to DMN_PATIENCE_MAX
 * periods.  Then sets are dropped, but the published ones are solved.
 * Threads: pure functions of the struct; one thread at a time. */
#ifndef DMN_DEADLINE_H
#define DMN_DEADLINE_H
#include <stdbool.h>
#include <stdint.h>

#define DMN_PATIENCE_MAX   8
#define DMN_ITERATIONS_FEW 2 /* fewer give no solution, not even from a warm start */

struct dmn_deadline {
    int64_t limit_ns;  /* 0 = none */
    int64_t period_ns; /* of the cameras; 0 = the limit holds as it is */
    int patience;      /* periods that a solve may take; 0 means 1 */
};

/* Deadline of a solve that begins at `now`, for a set that came at t_set_ns; 0 = none. */
int64_t dmn_deadline_at(const struct dmn_deadline *d, int64_t t_set_ns, int64_t now);
/* Call after a solve.  ended_it: the deadline ended it; all, finest: iterations on all grids and on the finest. */
void dmn_deadline_learn(struct dmn_deadline *d, bool ended_it, uint32_t all, uint32_t finest);
#endif
