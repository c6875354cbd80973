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
    const struct rec_calib_report *report; /* of a solve that failed: what was found until then */
    const struct rec_rig *rig;             /* NULL: none could be had */
    const char *failure;                   /* why not; NULL: there is one */
    bool accepted;
};

/* On stdout: what was found in the pictures, and why not in the others, counted. */
void calibrate_print_pictures(const struct calibrate_result *r);
/* On stdout: a line per camera, then the sentences. */
void calibrate_print_cameras(const struct calibrate_result *r);
/* On stdout; the worst first. */
void calibrate_print_findings(const struct calibrate_result *r);
/* Names of severities, of what became of views, of the numbers of a lens. */
const char *calibrate_severity(enum rec_calib_severity s);
extern const char *const calibrate_fate[REC_VIEW_JOINT + 1], *const calibrate_lens[REC_LENS];

/* Whether a report can be written there: .json, and with html also .html.  PVX_EUNSUP */
PVX_MUST_CHECK pvx_err calibrate_report_possible(const char *path, bool html, struct pvx_diag *d);
/* What json or html prints of `of`, by the extension, to a file that is there whole or not at all.  An older one is
 * replaced.  html NULL: JSON only.  Errors: those of html, dmn_json_print, pvx_file_write. */
PVX_MUST_CHECK pvx_err calibrate_write_report(const char *path,
                                              void (*json)(struct dmn_json *j, const void *of),
                                              pvx_err (*html)(FILE *f, const void *of),
                                              const void *of, struct pvx_diag *d);
/* Of a struct calibrate_result. */
void calibrate_json(struct dmn_json *j, const void *result);
PVX_MUST_CHECK pvx_err calibrate_html(FILE *f, const void *result);
#endif
