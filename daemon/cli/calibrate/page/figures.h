/* figures.h - what a calibration's report shows, as SVG inside its page.  Colours are classes of style.c, so that a
 * figure follows the page into the dark and onto paper. */
#ifndef CALIBRATE_REPORT_FIGURES_H
#define CALIBRATE_REPORT_FIGURES_H
#include <stdio.h>

#include "daemon/cli/calibrate/report.h"

/* How many times longer than in the picture residuals are drawn, the same for all cameras; 0: there are none. */
double report_enlargement(const struct calibrate_result *r);
/* What camera c saw: cells of the picture with and without corners, residuals as arrows. */
pvx_err report_camera(FILE *f, const struct calibrate_result *r, size_t c, double enlargement);
/* Cameras on a ring, joined by poses that two of them saw; the same as a table. */
void report_pairs(FILE *f, const struct calibrate_result *r);
/* Cameras, volume and boards from above and from the front. */
void report_rig(FILE *f, const struct calibrate_result *r);
/* The expected error at points of the volume, a square for each height. */
void report_volume(FILE *f, const struct calibrate_result *r);
/* How the board is bent. */
void report_warp(FILE *f, const struct calibrate_result *r);

#endif
