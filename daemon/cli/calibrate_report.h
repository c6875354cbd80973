/* calibrate_report.h - what a calibration came to: a table and sentences, and all of it as JSON. */
#ifndef CALIBRATE_REPORT_H
#define CALIBRATE_REPORT_H
#include "base/err.h"
#include "daemon/cli/calibrate_look.h"
#include "recon/calib/calib.h"

struct calibrate_result {
    const struct rec_board *board;
    const struct rec_grid *grid; /* n[] 0: not known */
    const struct calibrate_look *look;
    const struct rec_calib_report *report; /* of a solve that failed: what was found until then */
    bool accepted;
};

/* On stdout: what was found in the pictures, and why not in the others, counted. */
void calibrate_print_pictures(const struct calibrate_result *r);
/* On stdout: a line per camera, then the sentences. */
void calibrate_print_cameras(const struct calibrate_result *r);
/* On stdout; the worst first. */
void calibrate_print_findings(const struct calibrate_result *r);
/* Names of severity, kind of finding, fate. */
const char *calibrate_severity(enum rec_calib_severity s);

/* To a file that is there whole or not at all; an older one is replaced. */
PVX_MUST_CHECK pvx_err calibrate_write_json(const struct calibrate_result *r, const char *path,
                                            struct pvx_diag *d);
#endif
