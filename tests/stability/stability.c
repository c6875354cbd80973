/* stability.c - the hard cases, each with its outcome, its error against the truth and the
 * bound that the error must keep; exit status 1 when one does not.
 *
 *     stability [--quick] [FOLDER]      FOLDER for stability.csv and condition.csv */
#include "tests/stability/stab.h"

#include <string.h>

#include "base/clock.h"

int main(int argc, char **argv)
{
    struct stab_run run = STAB_FULL;
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--quick") == 0)
            run = (struct stab_run)STAB_QUICK;
        else
            run.folder = argv[i];
    }
    int64_t start = pvx_now_mono();
    CHECK(pvx_pool_new(0, "stability", &run.pool));
    stab_begin(&run);
    stab_cases(&run);
    stab_terms(&run);
    stab_reference(&run);
    stab_iterations(&run);
    stab_conditions(&run);
    stab_end();
    pvx_pool_free(&run.pool);
    printf("\n  %d cases, %d failed, %.0f s\n", stab_rows(), stab_failed(),
           1e-9 * (double)(pvx_now_mono() - start));
    return stab_failed() > 0;
}
