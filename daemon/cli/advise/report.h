/* report.h - the parts of `pyrovox report`: a recording of volumes on one page.
 * Threads: one, parallel inside. */
#ifndef ADVISE_REPORT_H
#define ADVISE_REPORT_H
#include "daemon/cli/advise/advise.h"
#include "daemon/cli/report/course.h"

/* How well the volume of all other cameras predicts the picture of one (recon/check/holdout.h). */
struct report_view {
    bool known;
    double error, noise; /* of the picture, relative; what noise alone makes */
};
struct report {
    const char *in, *out, *temperature;
    struct flame_sets_args a; /* a.rig; a.frames NULL: no pictures */
    int64_t set;              /* shown in slices, -1: the one with the most light */
    bool force;
    int argc;
    char **argv; /* of the command */

    vol_reader *volumes;
    const struct vol_head *head;
    struct rec_rig rig;
    struct course course, heat; /* heat: no rows without `temperature` */
    size_t shown;               /* row of the course */
    double white[2];            /* of the slices: emission and bars, 1/m; 0: there are no bars */
    double at[3];               /* where the slices meet, m */
    struct report_view view[REC_MAX_CAMERAS];
    size_t view_sets; /* 0: no views */
    char *advice;     /* what advise says, or NULL; owner: this */
};

/* report_slices.c: three slices of the shown set as OUT/slice-x.png and so on, those of its bars as OUT/bar-x.png.
 * Errors: PVX_ENOMEM, the files'. */
PVX_MUST_CHECK pvx_err report_slices(struct report *r, struct pvx_diag *d);
/* report_views.c: left-out views and advice, from the pictures.  Errors: those of flame_sets_load, PVX_ECANCELED. */
PVX_MUST_CHECK pvx_err report_views(struct report *r, struct pvx_diag *d);
/* report_page.c: writes OUT/report.html.  Errors: the file's. */
PVX_MUST_CHECK pvx_err report_page(const struct report *r, struct pvx_diag *d);

#endif
