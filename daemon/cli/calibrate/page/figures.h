/* figures.h - the figures of a calibration's report, as SVG inside its page.  Colours are classes of style.c, so a
 * figure follows the page's dark style and its style on paper. */
#ifndef CALIBRATE_REPORT_FIGURES_H
#define CALIBRATE_REPORT_FIGURES_H
#include <stdio.h>

#include "daemon/cli/calibrate/report.h"

/* The factor by which residuals are drawn longer than in the picture, one for all cameras.  0: there are none. */
double report_enlargement(const struct calibrate_result *r);
/* The picture of camera c: cells with and without corners, and residuals as arrows. */
pvx_err report_camera(FILE *f, const struct calibrate_result *r, size_t c, double enlargement);
/* Cameras on a ring, joined by the poses that two of them saw.  A table says the same. */
void report_pairs(FILE *f, const struct calibrate_result *r);
/* Cameras, volume and boards from above and from the front. */
void report_rig(FILE *f, const struct calibrate_result *r);
/* The expected error at points of the volume, a square for each height. */
void report_volume(FILE *f, const struct calibrate_result *r);
/* How the board is bent. */
void report_warp(FILE *f, const struct calibrate_result *r);

#endif
