/* course.h - the figures of every set of a recording (daemon/volumes/measure.h), as text, CSV and plots over time.
 * Threads: one. */
#ifndef REPORT_COURSE_H
#define REPORT_COURSE_H
#include <stdio.h>

#include "daemon/volumes/measure.h"

struct course_how {
    struct vol_measure_how
        measure;      /* level NAN: a tenth of the brightest voxel in the region, of all sets */
    int64_t from, to; /* sets */
    bool quiet;
};
struct course_row {
    struct pvp_volume v;
    double time; /* s since the first row; NAN: the recording has no times */
    struct vol_measured m;
};
struct course {
    struct course_how how; /* with the level that was used */
    struct course_row *row;
    size_t n;
    bool timed;
    size_t with_bars, with_modes, doubted; /* rows */
    uint32_t doubt;                        /* of any row */
};
/* Measure each set from `from` to `to`.  Owner: caller, course_free, after an error too.
 * Errors: PVX_ENOENT (no set in the range), PVX_ECANCELED, those of vol_reader_get and vol_measure. */
PVX_MUST_CHECK pvx_err course_read(vol_reader *r, const char *name, const struct course_how *how,
                                   struct course *out, struct pvx_diag *d);
void course_free(struct course *c);

enum course_figure {
    COURSE_MEAN,
    COURSE_LIGHT,
    COURSE_HEIGHT,
    COURSE_VOLUME,
    COURSE_MOST,
    COURSE_FIGURES
};
struct course_column {
    const char *name, *unit, *says;
};
extern const struct course_column course_columns[COURSE_FIGURES];
struct vol_figure course_figure_of(const struct vol_measured *m, enum course_figure k);

void course_print(FILE *f, const struct course *c);
/* A new file is written whole or not at all.  Errors: those of pvx_file_write. */
PVX_MUST_CHECK pvx_err course_csv(const struct course *c, const char *path, struct pvx_diag *d);
/* One figure over time as an svg element (daemon/cli/report/plot.h).  PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err course_svg(FILE *f, const struct course *c, enum course_figure k);
/* All figures in one file. */
PVX_MUST_CHECK pvx_err course_plot(const struct course *c, const char *path, struct pvx_diag *d);

#endif
