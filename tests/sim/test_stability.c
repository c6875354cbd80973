/* The hard cases (make stability) in a reduced size. */
#include "../t.h"

#include "tests/stability/stab.h"

static struct stab_run run = STAB_QUICK;

static void all_pass(void (*part)(const struct stab_run *run))
{
    int before = stab_failed();
    part(&run);
    T_EQ_I(stab_failed(), before);
}

T_CASE(hard_cases)
{
    all_pass(stab_cases);
}
T_CASE(terms_of_the_model)
{
    T_NOT_UNDER_SANITIZERS();
    all_pass(stab_terms);
}
T_CASE(float_against_double)
{
    all_pass(stab_reference);
}
T_CASE(many_iterations)
{
    T_NOT_UNDER_SANITIZERS();
    all_pass(stab_iterations);
}
T_CASE(rings_of_views)
{
    T_NOT_UNDER_SANITIZERS();
    all_pass(stab_conditions);
}

int main(void)
{
    if (pvx_pool_new(2, "test", &run.pool) != PVX_OK)
        return 2;
    stab_begin(&run);
    t_run();
    stab_end();
    pvx_pool_free(&run.pool);
    return t_done();
}
