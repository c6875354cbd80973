/* deadline.h - how long the solver may take for a frame set, from what was measured.
 *
 * A limit of its own (solver.deadline_ms) holds as it is.  What keeps up with the cameras is learned: a
 * solve ends `limit_ns` after its set came, but takes no longer than keeps up (0.9 periods) and no less
 * than half a period, however late its set was.  Where that does not buy a solution (another program has
 * the processors), the solver gets up to DMN_PATIENCE_MAX periods: then sets are dropped, but those that
 * are published are solved.
 * Threads: pure functions of the struct; one thread at a time. */
#ifndef DMN_DEADLINE_H
#define DMN_DEADLINE_H
#include <stdbool.h>
#include <stdint.h>

#define DMN_PATIENCE_MAX   8
#define DMN_ITERATIONS_FEW 2 /* fewer than that is not a solution, not even from a warm start */

struct dmn_deadline {
    int64_t limit_ns;  /* 0 = none */
    int64_t period_ns; /* of the cameras; 0 = the limit holds as it is */
    int patience;      /* periods that a solve may take; 0 is 1 */
};

/* When a solve that begins at `now` has to come back, for a set that came at t_set_ns; 0 = no matter. */
int64_t dmn_deadline_at(const struct dmn_deadline *d, int64_t t_set_ns, int64_t now);
/* After a solve: whether the deadline ended it, and its iterations, on all grids and on the finest. */
void dmn_deadline_learn(struct dmn_deadline *d, bool ended_it, uint32_t all, uint32_t finest);
#endif
