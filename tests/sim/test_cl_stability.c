/* The hard cases (make stability) in a reduced size on a device, each compared with the processors. */
#include "tests/lib/cl_bed.h"
#include "tests/t.h"

#include "tests/stability/stab.h"

static struct stab_run run = STAB_QUICK;

T_CASE(hard_cases_on_a_device)
{
    int before = stab_failed();
    T_NOT_UNDER_SANITIZERS();
    stab_cases(&run);
    T_EQ_I(stab_failed(), before);
}
T_CASE(terms_of_the_model_on_a_device)
{
    int before = stab_failed();
    T_NOT_UNDER_SANITIZERS();
    stab_terms(&run);
    T_EQ_I(stab_failed(), before);
    T_LE(80, stab_pairs());
}

int main(void)
{
    cl_bed_begin();
    run.card = cl_bed_open();
    if (pvx_pool_new(2, "test", &run.pool) != PVX_OK)
        return 2;
    stab_begin(&run);
    t_run();
    stab_end();
    rec_cl_close(&run.card);
    pvx_pool_free(&run.pool);
    return t_done();
}
