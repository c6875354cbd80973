/* course.h - the figures of every set of a recording (daemon/volumes/measure.h), as text, CSV and plots over time.
 * Threads: one. */
#ifndef REPORT_COURSE_H
#define REPORT_COURSE_H
#include <stdio.h>

#include "daemon/volumes/measure.h"
#include "daemon/volumes/thermal_read.h"

#define COURSE_MOST 5 /* figures */
struct course_column {
    const char *name, *unit, *per, *says; /* per: the unit in a name of CSV */
};

struct course_how {
    struct vol_measure_how
        measure;      /* level NAN: a tenth of the brightest voxel in the region, of all sets */
    int64_t from, to; /* sets */
    bool quiet;
};
struct course_row {
    uint64_t place; /* in the recording */
    struct pvp_volume v;
    double time; /* s since the first row; NAN: the recording has no times */
    struct vol_figure figure[COURSE_MOST];
    bool bars, modes;
    uint32_t doubt;
};
struct course {
    struct course_how how;              /* with the level that was used; NAN: there is none */
    const struct course_column *column; /* [figures] */
    int figures;
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
/* The same of temperatures: mean, hottest, mean soot, its volume, and the volume that has a temperature.  Voxels without
 * one are left out. */
PVX_MUST_CHECK pvx_err course_read_thermal(vol_thermal_reader *r, const char *name,
                                           const struct course_how *how, struct course *out,
                                           struct pvx_diag *d);
/* The same of volumes in kelvin, as a running daemon publishes them: they know nothing of soot. */
PVX_MUST_CHECK pvx_err course_read_kelvin(vol_reader *r, const char *name,
                                          const struct course_how *how, struct course *out,
                                          struct pvx_diag *d);
void course_free(struct course *c);

/* Figures of volumes, and of temperatures. */
enum { COURSE_MEAN, COURSE_LIGHT, COURSE_HEIGHT, COURSE_VOLUME, COURSE_BRIGHTEST };
enum { COURSE_KELVIN, COURSE_HOTTEST, COURSE_SOOT, COURSE_SOOT_VOLUME, COURSE_SOOTY };

void course_print(FILE *f, const struct course *c);
/* A new file is written whole or not at all.  Errors: those of pvx_file_write. */
PVX_MUST_CHECK pvx_err course_csv(const struct course *c, const char *path, struct pvx_diag *d);
/* One figure over time as an svg element (daemon/cli/report/plot.h).  PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err course_svg(FILE *f, const struct course *c, int k);
/* All figures in one file. */
PVX_MUST_CHECK pvx_err course_plot(const struct course *c, const char *path, struct pvx_diag *d);

#endif
