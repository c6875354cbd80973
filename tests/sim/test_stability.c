/* The hard cases of DESIGN 7 in a reduced size; make stability runs them in full. */
#include "../t.h"

#include "tests/stability/stab.h"

static struct stab_run run = STAB_QUICK;

static void hard_cases(void)
{
    int before = stab_failed();
    stab_cases(&run);
    T_EQ_I(stab_failed(), before);
}
static void float_against_double(void)
{
    int before = stab_failed();
    stab_reference(&run);
    T_EQ_I(stab_failed(), before);
}
static void many_iterations(void)
{
    int before = stab_failed();
    stab_iterations(&run);
    T_EQ_I(stab_failed(), before);
}
static void rings_of_views(void)
{
    int before = stab_failed();
    stab_conditions(&run);
    T_EQ_I(stab_failed(), before);
}

int main(void)
{
    if (pvx_pool_new(2, "test", &run.pool) != PVX_OK)
        return 2;
    stab_begin(&run);
    T_RUN(hard_cases);
    T_RUN(float_against_double);
    T_RUN(many_iterations);
    T_RUN(rings_of_views);
    stab_end();
    pvx_pool_free(&run.pool);
    return t_done();
}
