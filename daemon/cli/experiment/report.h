/* report.h - write DIR/report.html, one page that needs no other file. */
#ifndef EXPERIMENT_REPORT_H
#define EXPERIMENT_REPORT_H
#include "daemon/cli/experiment/experiment.h"

/* A figure: the paper's finding and this recording's.  holds: 1 yes, 0 no, -1 nothing to measure. */
struct experiment_finding {
    const char *figure, *paper;
    char here[700];
    int holds;
};
enum {
    FINDING_HULL,
    FINDING_COUNTS,
    FINDING_FRAMES,
    FINDING_GRIDS,
    FINDING_RIM,
    FINDING_VIEWS,
    FINDING_VIEW,
    FINDING_FLAMES,
    FINDING_SOLVERS,
    EXPERIMENT_FINDINGS
};
void experiment_findings(const struct experiment *x,
                         struct experiment_finding out[EXPERIMENT_FINDINGS]);
/* Mean over the channels. */
double experiment_over_channels(const struct experiment *x, const double *v);

/* Write report.html.  Errors: the files'. */
PVX_MUST_CHECK pvx_err experiment_report(const struct experiment *x, struct pvx_diag *d);

#endif
