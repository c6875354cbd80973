/* options.h - the options that `calibrate solve` and `calibrate live` share, as an argp child.
 *
 * A command lists calibrate_options() among its children and hands over a struct calibrate_args in ARGP_KEY_INIT, as
 * with opt_rig.h.  Strings point into argv. */
#ifndef CALIBRATE_OPTIONS_H
#define CALIBRATE_OPTIONS_H
#include <argp.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "recon/geom/rig.h"

#define CALIBRATE_MEASURED 64
#define CALIBRATE_REPORTS  2

struct calibrate_names {
    const char *name[REC_MAX_CAMERAS];
    size_t n;
};

struct calibrate_args {
    const char *board, *out, *keep, *lenses;
    const char *report[CALIBRATE_REPORTS];
    const char *measured[CALIBRATE_MEASURED], *up_camera; /* NULL: the first */
    size_t n_measured, n_reports;
    struct calibrate_names add, recover; /* cameras to solve; the others stay as in `keep` */
    double volume[6], up[3];
    int32_t voxels[3]; /* 0: auto */
    int64_t floor, threads;
    bool has_volume, has_up, accept, force, quiet;
    bool volume_later; /* --volume may be left out */
};
#define CALIBRATE_ARGS_INIT \
    {                       \
        .floor = -1         \
    }

const struct argp *calibrate_options(void);

/* Read n numbers separated by commas.  Returns the camera's name after one more comma, "" without one; NULL:
 * wrong. */
const char *calibrate_parse_numbers(const char *s, size_t n, double *out);
/* --volume and --voxels.  A wrong value ends the program, as arg.h says.  voxels: 0 0 0 for auto. */
void calibrate_parse_volume(struct argp_state *st, const char *arg, double volume[6]);
void calibrate_parse_voxels(struct argp_state *st, const char *arg, int32_t voxels[3]);

#endif
