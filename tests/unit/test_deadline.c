/* test_deadline.c - how long the solver may take live, from made-up times. */
#include "../t.h"

#include "daemon/pipeline/deadline.h"

#define MS 1000000LL

T_CASE(a_limit_holds_as_it_is)
{
    struct dmn_deadline none = {0}, d = {.limit_ns = 40 * MS};
    T_EQ_I(dmn_deadline_at(&none, 100 * MS, 105 * MS), 0);
    T_EQ_I(dmn_deadline_at(&d, 100 * MS, 105 * MS), 140 * MS);
    T_EQ_I(dmn_deadline_at(&d, 100 * MS, 900 * MS), 140 * MS); /* over before it began */
    for (int i = 0; i < 5; i++)
        dmn_deadline_learn(&d, true, 0, 0);
    T_EQ_I(dmn_deadline_at(&d, 100 * MS, 105 * MS), 140 * MS);
}

/* 20 Hz: period 50 ms, limit 75 ms after the set came, as dmn_config_deadline says. */
static struct dmn_deadline live(void)
{
    return (struct dmn_deadline){.limit_ns = 75 * MS, .period_ns = 50 * MS};
}

T_CASE(live_it_keeps_up)
{
    struct dmn_deadline d = live();
    T_EQ_I(dmn_deadline_at(&d, 1000 * MS, 1040 * MS), 1075 * MS); /* the limit */
    T_EQ_I(dmn_deadline_at(&d, 1000 * MS, 1001 * MS), 1046 * MS); /* 0.9 periods at most */
    T_EQ_I(dmn_deadline_at(&d, 1000 * MS, 1300 * MS), 1325 * MS); /* half a period at least */
    for (int64_t now = 1000; now < 1500; now++) {
        int64_t for_it = dmn_deadline_at(&d, 1000 * MS, now * MS) - now * MS;
        T_OK(for_it >= 25 * MS && for_it <= 45 * MS);
    }
}

static int64_t granted(const struct dmn_deadline *d)
{
    return (dmn_deadline_at(d, 1000 * MS, 1001 * MS) - 1001 * MS) / MS;
}

T_CASE(without_a_solution_it_gets_more_and_gives_it_back)
{
    struct dmn_deadline d = live();
    static const int more[] = {90, 180, 360, 360}; /* 0.9 of 2, 4, 8 periods, and no further */
    for (size_t i = 0; i < 4; i++) {
        dmn_deadline_learn(&d, true, DMN_ITERATIONS_FEW - 1, DMN_ITERATIONS_FEW - 1);
        T_EQ_I(granted(&d), more[i]);
    }
    dmn_deadline_learn(&d, true, 3, 3); /* just enough: it stays */
    T_EQ_I(granted(&d), 360);
    dmn_deadline_learn(&d, true, 3 * DMN_ITERATIONS_FEW + 1, 3 * DMN_ITERATIONS_FEW + 1);
    T_EQ_I(granted(&d), 315); /* plenty, though the deadline ended it */
    for (int i = 0; i < 6; i++)
        dmn_deadline_learn(&d, false, 1, 1); /* done by itself */
    T_EQ_I(granted(&d), 45);
    dmn_deadline_learn(&d, false, 1, 1); /* never less than one period's */
    T_EQ_I(granted(&d), 45);
}

/* Iterations on coarser grids are a solution too. */
T_CASE(coarse_iterations_count)
{
    struct dmn_deadline d = live();
    dmn_deadline_learn(&d, true, 8, 0);
    T_EQ_I(granted(&d), 45);
}

/* A machine on which an iteration takes 60 ms, then 5 ms: the loop settles both times. */
T_CASE(it_settles)
{
    struct dmn_deadline d = live();
    for (int round = 0; round < 2; round++) {
        int64_t iteration = round == 0 ? 60 : 5;
        uint32_t done = 0;
        int changes = 0;
        for (int set = 0; set < 200; set++) {
            int64_t before = granted(&d);
            done = (uint32_t)(before / iteration);
            bool ended_it = done < 30;
            dmn_deadline_learn(&d, ended_it, ended_it ? done : 30, ended_it ? done : 30);
            changes += set >= 100 && granted(&d) != before;
        }
        T_OK(done >= DMN_ITERATIONS_FEW);
        T_EQ_I(changes, 0);
        T_EQ_I(granted(&d), round == 0 ? 180 : 45);
    }
}
