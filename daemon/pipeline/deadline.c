#include "daemon/pipeline/deadline.h"

int64_t dmn_deadline_at(const struct dmn_deadline *d, int64_t t_set_ns, int64_t now)
{
    if (d->limit_ns == 0)
        return 0;
    int64_t until = t_set_ns + d->limit_ns;
    if (d->period_ns == 0)
        return until;
    int patience = d->patience < 1 ? 1 : d->patience;
    int64_t most = now + d->period_ns * patience * 9 / 10;
    int64_t least = now + d->period_ns * patience / 2;
    return patience > 1 || until > most ? most : until < least ? least : until;
}

void dmn_deadline_learn(struct dmn_deadline *d, bool ended_it, uint32_t all, uint32_t finest)
{
    int patience = d->patience < 1 ? 1 : d->patience;
    if (ended_it && all < DMN_ITERATIONS_FEW)
        patience = patience * 2 > DMN_PATIENCE_MAX ? DMN_PATIENCE_MAX : patience * 2;
    else if (patience > 1 && (!ended_it || finest > 3 * DMN_ITERATIONS_FEW))
        patience--;
    d->patience = patience;
}
