/* stability.c - the hard cases, each with its outcome, its error against the truth and the
 * bound that the error must keep; exit status 1 when one does not.
 *
 *     stability [--quick] [--card NAME] [FOLDER]      FOLDER for stability.csv and condition.csv
 *
 * --card: the cases of the default solver on this OpenCL device too, each compared with the processors. */
#include "tests/stability/stab.h"

#include <string.h>

#include "base/clock.h"
#include "recon/opencl/device.h"

int main(int argc, char **argv)
{
    struct stab_run run = STAB_FULL;
    const char *card = NULL;
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--quick") == 0)
            run = (struct stab_run)STAB_QUICK;
        else if (strcmp(argv[i], "--card") == 0 && i + 1 < argc)
            card = argv[++i];
        else
            run.folder = argv[i];
    }
    struct pvx_diag d = {""};
    int64_t start = pvx_now_mono();
    CHECK(pvx_pool_new(0, "stability", &run.pool));
    if (card != NULL && rec_cl_open(card, &run.card, &d) != PVX_OK) {
        fprintf(stderr, "stability: %s\n", d.text);
        return 2;
    }
    stab_begin(&run);
    stab_cases(&run);
    stab_terms(&run);
    if (card == NULL) {
        stab_reference(&run);
        stab_iterations(&run);
        stab_conditions(&run);
    }
    stab_end();
    bool none = card != NULL && stab_pairs() == 0;
    if (card != NULL)
        rec_cl_close(&run.card);
    pvx_pool_free(&run.pool);
    printf("\n  %d cases, %d failed, %.0f s\n", stab_rows(), stab_failed(),
           1e-9 * (double)(pvx_now_mono() - start));
    return stab_failed() > 0 || none;
}
