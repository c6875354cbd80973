/* job.h - from options and pictures of a board to rig.yaml: what `calibrate solve` and
 * `calibrate live` share.
 *
 * In this order: start, the cameras into `look`, prepare, the pictures looked at, conclude, fini. */
#ifndef CALIBRATE_JOB_H
#define CALIBRATE_JOB_H
#include "base/err.h"
#include "daemon/cli/calibrate/look.h"
#include "daemon/cli/calibrate/options.h"
#include "recon/calib/calib.h"

struct calibrate_job {
    const struct calibrate_args *a;
    struct rec_board board;
    struct rec_rig old, rig;
    struct calibrate_look look;
    struct rec_calib_measured measured[CALIBRATE_MEASURED];
    struct rec_calib_input in;
    struct rec_calib_report report;
};

/* Checks that need no cameras: read the board, and check that no older file is in the way. */
PVX_MUST_CHECK pvx_err calibrate_start(struct calibrate_job *j, const struct calibrate_args *a,
                                       struct pvx_diag *d);
/* Checks that need no pictures: fill in `in`, except for the views. */
PVX_MUST_CHECK pvx_err calibrate_prepare(struct calibrate_job *j, struct pvx_diag *d);
/* After the pictures were looked at: solve, print and write. */
PVX_MUST_CHECK pvx_err calibrate_conclude(struct calibrate_job *j, struct pvx_diag *d);
void calibrate_job_fini(struct calibrate_job *j);

#endif
