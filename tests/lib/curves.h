/* curves.h - what three cameras see of the spectrum, in coarse figures, and sources of light that are not soot.
 *
 * Source of the figures: J. Jiang, D. Liu, J. Gu, S. Suesstrunk, "What is the space of spectral sensitivity functions for
 * digital color cameras?", IEEE WACV 2013, 168-179: measured by a monochromator; here every 20 nm, to 0.01, each
 * camera's largest value 1. */
#ifndef TESTS_CURVES_H
#define TESTS_CURVES_H
#include <math.h>
#include <stdio.h>

#include "recon/spectral/curves.h"
#include "recon/spectral/soot.h"

enum { CURVES_N = 17, CURVES = 3 };
static const struct published {
    const char *name;
    double v[CURVES_N][3]; /* 400, 420, ... 720 nm: red, green, blue */
} published[CURVES] = {
    {"Point Grey Grasshopper2 14S5C",
     {{.02, .02, .22},
      {.01, .03, .49},
      {.01, .05, .79},
      {0, .09, 1},
      {.01, .20, .99},
      {.01, .28, .71},
      {.03, .46, .30},
      {.03, .53, .06},
      {.01, .46, 0},
      {.31, .31, 0},
      {.61, .12, 0},
      {.56, .02, 0},
      {.53, .01, 0},
      {.46, 0, 0},
      {.11, 0, 0},
      {.02, 0, 0},
      {.01, 0, 0}}},
    {"Nikon D5100",
     {{0, 0, 0},
      {0, .01, .05},
      {.04, .16, .81},
      {.03, .24, .87},
      {.04, .43, .82},
      {.04, .65, .53},
      {.09, .94, .22},
      {.06, .90, .09},
      {.04, .67, .03},
      {.47, .43, .01},
      {.68, .18, .01},
      {.46, .06, 0},
      {.29, .03, 0},
      {.15, .02, 0},
      {.03, .01, 0},
      {0, 0, 0},
      {0, 0, 0}}},
    {"Canon 500D",
     {{0, .01, .03},
      {.01, .06, .48},
      {.01, .10, .76},
      {.01, .17, .87},
      {.04, .59, .82},
      {.08, .83, .59},
      {.13, .94, .31},
      {.17, .91, .18},
      {.27, .74, .12},
      {.59, .65, .11},
      {.51, .29, .06},
      {.40, .11, .03},
      {.27, .05, .02},
      {.17, .03, .02},
      {.06, .02, .01},
      {0, 0, 0},
      {0, 0, 0}}},
};

/* As a file that `calibrate spectral` reads. */
static inline int curves_csv(const struct published *c, char *out, size_t size)
{
    int n = snprintf(out, size, "wavelength,red,green,blue\n");
    for (int i = 0; i < CURVES_N; i++)
        n += snprintf(out + n, size - (size_t)n, "%d,%.2f,%.2f,%.2f\n", 400 + 20 * i, c->v[i][0],
                      c->v[i][1], c->v[i][2]);
    return n;
}

/* Camera k with constants that make a voxel of soot of 1 ppm at 1800 K some 1 per metre in its brightest channel. */
static inline void curves_camera(int k, struct rec_spectral *s)
{
    char text[2000];
    static struct rec_curve c;
    int n = curves_csv(&published[k], text, sizeof text);
    *s = (struct rec_spectral){.absolute = true};
    if (rec_curve_parse(text, (size_t)n, "curves", 3, &c, NULL) != PVX_OK ||
        rec_curve_response(&c, NULL, false, s, NULL) != PVX_OK)
        return;
    for (int q = 0; q < 3; q++)
        s->constant[q] = (double[]){1, 1.1, 1.4}[q] * 5e-5;
}

/* Light of one wavelength in the three channels, per W m^-2 sr^-1. */
static inline void curves_line(const struct rec_spectral *s, double nm, double power, double e[3])
{
    double x = (nm - s->from) / s->step;
    int i = (int)x;
    for (int q = 0; q < 3; q++)
        e[q] += power * s->constant[q] *
                ((1 - (x - i)) * s->response[q][i] + (x - i) * s->response[q][i + 1]);
}

/* A blue flame without soot: CH* at 431 nm, C2* (Swan bands) at 474, 517 and 564 nm, in a ratio that methane has. */
static inline void curves_blue_flame(const struct rec_spectral *s, double e[3])
{
    e[0] = e[1] = e[2] = 0;
    curves_line(s, 431, 1, e);
    curves_line(s, 474, 0.25, e);
    curves_line(s, 517, 0.45, e);
    curves_line(s, 564, 0.12, e);
}
#endif
