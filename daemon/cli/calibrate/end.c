/* end.c - how a step of `pyrovox calibrate` ends. */
#include <stdio.h>

#include "daemon/cli/calibrate/calibrate.h"
#include "daemon/cli/common/cli.h"

int calibrate_end(pvx_err e, const struct pvx_diag *d)
{
    if (e != PVX_ECANCELED)
        return e == PVX_OK ? 0 : cli_error(d, e);
    fprintf(stderr, "\npyrovox: stopped; nothing was written\n");
    return 130;
}
