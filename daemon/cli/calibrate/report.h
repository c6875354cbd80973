/* report.h - what a calibration came to: a table and sentences, all of it as JSON, and as a page to look
 * at (daemon/cli/report/). */
#ifndef CALIBRATE_REPORT_H
#define CALIBRATE_REPORT_H
#include "base/err.h"
#include "daemon/cli/calibrate/look.h"
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

/* Whether a report can be written there: .json or .html.  PVX_EUNSUP */
PVX_MUST_CHECK pvx_err calibrate_report_possible(const char *path, struct pvx_diag *d);
/* The same of one that is .json only. */
PVX_MUST_CHECK pvx_err calibrate_json_possible(const char *path, struct pvx_diag *d);
/* What f prints of `of`, as above.  Errors: those of dmn_json_print and pvx_file_write. */
struct dmn_json;
PVX_MUST_CHECK pvx_err calibrate_write_json(const char *path,
                                            void (*f)(struct dmn_json *j, const void *of),
                                            const void *of, struct pvx_diag *d);
/* By its extension, to a file that is there whole or not at all; an older one is replaced. */
PVX_MUST_CHECK pvx_err calibrate_write_report(const struct calibrate_result *r, const char *path,
                                              struct pvx_diag *d);
/* Text of len bytes; owner: caller, free(). */
PVX_MUST_CHECK pvx_err calibrate_json(const struct calibrate_result *r, char **text, size_t *len,
                                      struct pvx_diag *d);
PVX_MUST_CHECK pvx_err calibrate_html(const struct calibrate_result *r, char **text, size_t *len);
#endif
