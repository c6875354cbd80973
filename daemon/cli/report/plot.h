/* plot.h - lines and points over two axes, as SVG inside a page.  Colours are attributes, because in a PDF the style
 * sheet does not apply inside a drawing.  Threads: pure. */
#ifndef REPORT_PLOT_H
#define REPORT_PLOT_H
#include <stdbool.h>
#include <stddef.h>
#include <stdio.h>

struct plot_series {
    const char *name, *colour;
    size_t n;
    const double *x, *y; /* [n]; only finite points are drawn */
    const double *
        spread; /* [n] a bar of so much up and down, or NULL; a band where there is a line of many points */
    const char *const *label; /* [n] beside each point, or NULL */
    bool points, dashed;      /* points: no line */
};
struct plot {
    const char *x, *y; /* labels of the axes */
    bool log_x;        /* all x > 0 */
    bool fine_x;       /* x is no whole number: ticks may be fractions */
    const struct plot_series *series;
    size_t n;
};
/* A round number (1, 2, 5 times a power of ten) that is not above v > 0. */
double report_round(double v);
#define PLOT_WIDTH  720.0
#define PLOT_HEIGHT 380.0
/* Write the plot as an svg element.  y begins at 0, or below the lowest point if there are only points. */
void plot_svg(FILE *f, const struct plot *p);
/* The same without the element around it, for a drawing of several: PLOT_WIDTH or more by PLOT_HEIGHT from 0, 0 on. */
void plot_inside(FILE *f, const struct plot *p);

#endif
