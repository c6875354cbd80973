/* report.h - the result of a calibration as a table and sentences, as JSON, and as a page
 * (daemon/cli/report/). */
#ifndef CALIBRATE_REPORT_H
#define CALIBRATE_REPORT_H
#include <stdio.h>

#include "base/err.h"
#include "daemon/cli/calibrate/look.h"
#include "daemon/control/json.h"
#include "recon/calib/calib.h"

struct calibrate_result {
    const struct rec_board *board;
    const struct rec_grid *grid; /* n[] 0: not known */
    const struct calibrate_look *look;
    const struct rec_calib_report *report; /* if the solve failed: what was found until then */
    const struct rec_rig *rig;             /* NULL: there is none */
    const char *failure;                   /* why there is no rig; NULL: there is one */
    bool accepted;
};

/* On stdout: in how many pictures the board was found, and how often each reason why it was not. */
void calibrate_print_pictures(const struct calibrate_result *r);
/* On stdout: a line per camera, then the sentences. */
void calibrate_print_cameras(const struct calibrate_result *r);
/* On stdout, the worst finding first. */
void calibrate_print_findings(const struct calibrate_result *r);
/* Names of severities, of the fates of views, of a lens's parameters. */
const char *calibrate_severity(enum rec_calib_severity s);
extern const char *const calibrate_fate[REC_VIEW_JOINT + 1], *const calibrate_lens[REC_LENS];

/* Check that a report can be written to path: .json, and with html also .html.  PVX_EUNSUP: another name. */
PVX_MUST_CHECK pvx_err calibrate_report_possible(const char *path, bool html, struct pvx_diag *d);
/* Write what json or html prints of `of`; the extension of path chooses.  The file is written whole or not at all,
 * and replaces an older one.  html NULL: JSON only.  Errors: those of html, dmn_json_print, pvx_file_write. */
PVX_MUST_CHECK pvx_err calibrate_write_report(const char *path,
                                              void (*json)(struct dmn_json *j, const void *of),
                                              pvx_err (*html)(FILE *f, const void *of),
                                              const void *of, struct pvx_diag *d);
/* The report of a struct calibrate_result. */
void calibrate_json(struct dmn_json *j, const void *result);
PVX_MUST_CHECK pvx_err calibrate_html(FILE *f, const void *result);
#endif
