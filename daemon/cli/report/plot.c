#include "daemon/cli/report/plot.h"

#include <math.h>
#include <string.h>

#include "daemon/cli/report/html.h"

double report_round(double v)
{
    double ten = pow(10, floor(log10(v) + 1e-9)), lead = v / ten;
    return ten * (lead >= 5 ? 5 : lead >= 2 ? 2 : 1);
}

#define LEFT   72.0
#define RIGHT  150.0 /* room for the names of the series */
#define TOP    14.0
#define BOTTOM 52.0
#define INK    "#5b6670"
#define LABELS 64
#define LETTER 7.5 /* of the font, at most in the mean */

struct frame {
    const struct plot *p;
    double x0, x1, y0, y1;
    double label[LABELS][2]; /* where some are; x, y */
    size_t labels;
};

static double plot_along(const struct frame *t, double x)
{
    double share =
        t->p->log_x ? log(x / t->x0) / log(t->x1 / t->x0) : (x - t->x0) / (t->x1 - t->x0);
    return LEFT + share * (PLOT_WIDTH - LEFT - RIGHT);
}

static double plot_up(const struct frame *t, double y)
{
    return PLOT_HEIGHT - BOTTOM - (y - t->y0) / (t->y1 - t->y0) * (PLOT_HEIGHT - TOP - BOTTOM);
}

static bool plot_drawn(const struct plot_series *s, size_t i)
{
    return isfinite(s->x[i]) && isfinite(s->y[i]);
}

static void find_frame(struct frame *t)
{
    *t = (struct frame){.p = t->p, .x0 = INFINITY, .x1 = -INFINITY, .y0 = INFINITY};
    for (size_t k = 0; k < t->p->n; k++)
        for (size_t i = 0; i < t->p->series[k].n; i++) {
            const struct plot_series *s = &t->p->series[k];
            if (!plot_drawn(s, i))
                continue;
            t->x0 = fmin(t->x0, s->x[i]);
            t->x1 = fmax(t->x1, s->x[i]);
            t->y0 = fmin(t->y0, s->points ? s->y[i] : 0);
            t->y1 = fmax(t->y1, s->y[i] + (s->spread != NULL ? s->spread[i] : 0));
        }
    if (!(t->x1 >= t->x0))
        t->x0 = t->x1 = 1;
    if (t->p->log_x) {
        t->x0 /= 1.2;
        t->x1 *= 1.2;
    } else {
        double rim = t->x1 > t->x0 ? 0.03 * (t->x1 - t->x0) : 1;
        t->x0 -= rim;
        t->x1 += rim;
    }
    t->y1 = t->y1 > 0 ? 1.08 * t->y1 : 1;
    t->y0 = isfinite(t->y0) ? 0.9 * t->y0 : 0;
}

static void plot_text(FILE *f, double x, double y, const char *anchor, const char *s)
{
    fprintf(f, "<text x=\"%.1f\" y=\"%.1f\" font-size=\"13\" fill=\"" INK "\" text-anchor=\"%s\">",
            x, y, anchor);
    html_text(f, s);
    fputs("</text>", f);
}

static void plot_tick(FILE *f, const struct frame *t, bool is_x, double v)
{
    char s[32];
    snprintf(s, sizeof s, "%.6g", fabs(v) < 1e-9 ? 0 : v); /* no -0 */
    if (is_x) {
        plot_text(f, plot_along(t, v), PLOT_HEIGHT - BOTTOM + 18, "middle", s);
        return;
    }
    fprintf(f,
            "<line x1=\"%.1f\" x2=\"%.1f\" y1=\"%.1f\" y2=\"%.1f\" stroke=\"" INK
            "\" stroke-opacity=\".3\"/>",
            LEFT, PLOT_WIDTH - RIGHT, plot_up(t, v), plot_up(t, v));
    plot_text(f, LEFT - 7, plot_up(t, v) + 4, "end", s);
}

static void axes(FILE *f, const struct frame *t)
{
    double step = report_round((t->y1 - t->y0) / 4),
           wide = t->p->log_x ? 0 : report_round((t->x1 - t->x0) / 6);
    for (double y = ceil(t->y0 / step) * step; y <= t->y1; y += step)
        plot_tick(f, t, false, y);
    if (!t->p->log_x && !t->p->fine_x && wide < 1)
        wide = 1; /* frames, voxels, views: whole numbers */
    for (double x = ceil(t->x0 / fmax(wide, 1e-9)) * wide; !t->p->log_x && x <= t->x1; x += wide)
        plot_tick(f, t, true, x);
    for (double ten = pow(10, floor(log10(fmax(t->x0, 1e-9)))); t->p->log_x && ten <= t->x1;
         ten *= 10)
        for (int k = 1; k <= 5; k += k == 2 ? 3 : 1)
            if (k * ten >= t->x0 && k * ten <= t->x1)
                plot_tick(f, t, true, k * ten);
    plot_text(f, (LEFT + PLOT_WIDTH - RIGHT) / 2, PLOT_HEIGHT - 12, "middle", t->p->x);
    fprintf(f, "<g transform=\"translate(14 %.1f) rotate(-90)\">",
            (PLOT_HEIGHT - BOTTOM + TOP) / 2);
    plot_text(f, 0, 0, "middle", t->p->y);
    fputs("</g>", f);
}

/* The spread of a line of many points. */
static void plot_band(FILE *f, const struct frame *t, const struct plot_series *s)
{
    fprintf(f, "<polygon fill=\"%s\" fill-opacity=\".25\" points=\"", s->colour);
    for (size_t i = 0; i < s->n; i++)
        if (plot_drawn(s, i))
            fprintf(f, "%.1f,%.1f ", plot_along(t, s->x[i]), plot_up(t, s->y[i] + s->spread[i]));
    for (size_t i = s->n; i-- > 0;)
        if (plot_drawn(s, i))
            fprintf(f, "%.1f,%.1f ", plot_along(t, s->x[i]),
                    plot_up(t, fmax(t->y0, s->y[i] - s->spread[i])));
    fputs("\"/>", f);
}

static void plot_line(FILE *f, const struct frame *t, const struct plot_series *s)
{
    fprintf(f, "<polyline fill=\"none\" stroke=\"%s\" stroke-width=\"1.8\"%s points=\"", s->colour,
            s->dashed ? " stroke-dasharray=\"5 4\"" : "");
    for (size_t i = 0; i < s->n; i++)
        if (plot_drawn(s, i))
            fprintf(f, "%.1f,%.1f ", plot_along(t, s->x[i]), plot_up(t, s->y[i]));
    fputs("\"/>", f);
}

/* Write a label beside a point, or lower if a label is there already.  The step is larger than the distance that
 * counts as "there", so that rounding cannot find the same label again and again. */
static void plot_beside(FILE *f, struct frame *t, double x, double y, const char *s)
{
    for (size_t i = 0; i < t->labels; i++)
        if (fabs(t->label[i][0] - x) < 60 && fabs(t->label[i][1] - y) < 12) {
            y = t->label[i][1] + 12.1;
            i = (size_t)-1; /* begin with the first again */
        }
    if (t->labels < LABELS) {
        t->label[t->labels][0] = x;
        t->label[t->labels++][1] = y;
    }
    plot_text(f, x, y, "start", s);
}

static void plot_point(FILE *f, struct frame *t, const struct plot_series *s, size_t i)
{
    double x = plot_along(t, s->x[i]), y = plot_up(t, s->y[i]);
    fprintf(f, "<circle cx=\"%.1f\" cy=\"%.1f\" r=\"3.2\" fill=\"%s\"/>", x, y, s->colour);
    if (s->spread != NULL)
        fprintf(f,
                "<line x1=\"%.1f\" x2=\"%.1f\" y1=\"%.1f\" y2=\"%.1f\" stroke=\"%s\" "
                "stroke-opacity=\".6\"/>",
                x, x, plot_up(t, s->y[i] + s->spread[i]),
                plot_up(t, fmax(0, s->y[i] - s->spread[i])), s->colour);
    if (s->label != NULL)
        plot_beside(f, t, x + 6, y + 4, s->label[i]);
}

/* The width that the plot needs: more where a name is long. */
static double plot_width(const struct plot *p)
{
    double width = PLOT_WIDTH;
    for (size_t k = 0; k < p->n; k++)
        width =
            fmax(width, PLOT_WIDTH - RIGHT + 40 + LETTER * (double)strlen(p->series[k].name) + 4);
    return width;
}

void plot_inside(FILE *f, const struct plot *p)
{
    struct frame t = {.p = p};
    find_frame(&t);
    axes(f, &t);
    for (size_t k = 0; k < p->n; k++) {
        const struct plot_series *s = &p->series[k];
        double y = TOP + 12 + 20 * (double)k;
        bool many = !s->points && s->n > 20;
        if (many && s->spread != NULL)
            plot_band(f, &t, s);
        if (!s->points)
            plot_line(f, &t, s);
        for (size_t i = 0; i < s->n && !many; i++)
            if (plot_drawn(s, i))
                plot_point(f, &t, s, i);
        fprintf(f,
                "<line x1=\"%.1f\" x2=\"%.1f\" y1=\"%.1f\" y2=\"%.1f\" stroke=\"%s\" "
                "stroke-width=\"3\"%s/>",
                PLOT_WIDTH - RIGHT + 12, PLOT_WIDTH - RIGHT + 34, y - 4, y - 4, s->colour,
                s->dashed ? " stroke-dasharray=\"5 4\"" : "");
        plot_text(f, PLOT_WIDTH - RIGHT + 40, y, "start", s->name);
    }
}

void plot_svg(FILE *f, const struct plot *p)
{
    fprintf(f, "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 %.0f %.0f\" role=\"img\">",
            plot_width(p), PLOT_HEIGHT);
    plot_inside(f, p);
    fputs("</svg>", f);
}
