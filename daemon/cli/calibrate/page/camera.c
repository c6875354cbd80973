/* A camera's picture: where corners were seen, and by how much they miss. */
#include <math.h>
#include <stdlib.h>

#include "base/median.h"
#include "base/mem.h"
#include "daemon/cli/calibrate/page/figures.h"
#include "daemon/cli/report/html.h"
#include "daemon/cli/report/plot.h"

#define WIDTH   480.0 /* of the drawing */
#define NX      8     /* cells of coverage, as in calib.h */
#define NY      6
#define MX      16 /* cells of medians */
#define MY      12
#define MEDIAN  5    /* corners that a median needs */
#define THIN    1200 /* single arrows of a camera, so that a page of many cameras stays small */
#define TYPICAL (WIDTH / 55) /* of an arrow */
#define LONGEST (WIDTH / 9)

struct miss {
    double x, y, dx, dy; /* px */
    int cell;
};

struct misses {
    size_t n;
    struct miss *at;
};

double report_enlargement(const struct calibrate_result *r)
{
    double each[REC_MAX_CAMERAS];
    size_t n = 0;
    for (size_t c = 0; c < r->look->n_cameras && r->rig != NULL; c++)
        if (r->report->camera[c].joint > 0 && r->look->camera[c].width > 0)
            each[n++] = r->report->camera[c].joint / r->look->camera[c].width * WIDTH;
    if (n == 0)
        return 0;
    qsort(each, n, sizeof *each, pvx_ascending);
    return report_round(fmax(TYPICAL / each[n / 2], 1e-3));
}

/* Whether the picture's corners count, and their residuals (NULL: none).  With a rig, corners of used views count.
 * Without a rig, all that were found count. */
static bool camera_counts(const struct calibrate_result *r, const struct calibrate_picture *p,
                          const float **residual)
{
    *residual = NULL;
    if (p->at == CALIBRATE_NO_VIEW || r->rig == NULL)
        return p->at != CALIBRATE_NO_VIEW;
    const struct rec_calib_view *v = &r->report->view[p->at];
    *residual = v->residual;
    return v->fate == REC_VIEW_USED && v->residual != NULL;
}

static int cell_of(double x, double y, const struct rec_calib_camera *k, int nx, int ny)
{
    int i = (int)floor((x + 0.5) / k->width * nx), j = (int)floor((y + 0.5) / k->height * ny);
    return (j < 0 ? 0 : j >= ny ? ny - 1 : j) * nx + (i < 0 ? 0 : i >= nx ? nx - 1 : i);
}

static pvx_err camera_collect(const struct calibrate_result *r, size_t c, struct misses *m)
{
    size_t all = 0;
    for (size_t i = 0; i < r->look->n; i++)
        all += r->look->picture[i].camera == c ? r->look->picture[i].view.n : 0;
    *m = (struct misses){.at = pvx_calloc(all > 0 ? all : 1, sizeof *m->at)};
    if (m->at == NULL)
        return PVX_ENOMEM;
    for (size_t i = 0; i < r->look->n; i++) {
        const struct calibrate_picture *p = &r->look->picture[i];
        const float *by;
        bool in = p->camera == c && camera_counts(r, p, &by);
        for (size_t k = 0; in && k < p->view.n; k++) {
            const struct rec_board_corner *o = &p->view.corner[k];
            struct miss one = {o->x, o->y, by != NULL ? (double)by[2 * k] : 0,
                               by != NULL ? (double)by[2 * k + 1] : 0,
                               cell_of(o->x, o->y, &r->look->camera[c], MX, MY)};
            if (isfinite(one.dx) && isfinite(one.dy) && isfinite(one.x) && isfinite(one.y))
                m->at[m->n++] = one;
        }
    }
    return PVX_OK;
}

/* ---- drawn ---- */

struct drawing {
    FILE *f;
    double unit, enlargement; /* of a pixel */
};

static void camera_coverage(const struct drawing *g, const struct misses *m,
                            const struct rec_calib_camera *k)
{
    double w = WIDTH / NX, h = g->unit * k->height / NY;
    size_t n[NX * NY] = {0}, most = 1;
    for (size_t i = 0; i < m->n; i++) {
        size_t *here = &n[cell_of(m->at[i].x, m->at[i].y, k, NX, NY)];
        most = ++*here > most ? *here : most;
    }
    for (int i = 0; i < NX * NY; i++) {
        fprintf(g->f, "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\" class=\"%s\"",
                i % NX * w, i / NX * h, w, h, n[i] > 0 ? "some" : "none");
        if (n[i] > 0)
            fprintf(g->f, " fill-opacity=\"%.2f\"", 0.06 + 0.3 * sqrt((double)n[i] / (double)most));
        fprintf(g->f, "><title>%zu corners</title></rect>", n[i]);
    }
}

/* One arrow of a path, no longer than LONGEST. */
static void arrow(const struct drawing *g, double x, double y, double dx, double dy, bool head)
{
    double s = g->unit * g->enlargement, len = s * hypot(dx, dy);
    if (len > LONGEST)
        s *= LONGEST / len;
    dx *= s, dy *= s;
    fprintf(g->f, "M%.1f %.1fl%.1f %.1f", g->unit * (x + 0.5), g->unit * (y + 0.5), dx, dy);
    if (head && len > 1)
        fprintf(g->f, "m%.1f %.1fL%.1f %.1fl%.1f %.1f", -0.35 * dx - 0.22 * dy,
                -0.35 * dy + 0.22 * dx, g->unit * (x + 0.5) + dx, g->unit * (y + 0.5) + dy,
                -0.35 * dx + 0.22 * dy, -0.35 * dy - 0.22 * dx);
}

/* Draw every step-th arrow of those that are too long (far), or of the others. */
static void camera_arrows(const struct drawing *g, const struct misses *m, bool far, size_t step)
{
    size_t k = 0;
    fprintf(g->f, "<path class=\"%s\" d=\"", far ? "far" : "corner");
    for (size_t i = 0; i < m->n; i++) {
        const struct miss *a = &m->at[i];
        if ((g->unit * g->enlargement * hypot(a->dx, a->dy) > LONGEST) == far && k++ % step == 0)
            arrow(g, a->x, a->y, a->dx, a->dy, false);
    }
    fputs("\"/>", g->f);
}

static int by_dx(const void *a, const void *b)
{
    const struct miss *x = a, *y = b;
    return x->cell != y->cell ? x->cell - y->cell : pvx_ascending(&x->dx, &y->dx);
}
static int by_dy(const void *a, const void *b)
{
    const struct miss *x = a, *y = b;
    return x->cell != y->cell ? x->cell - y->cell : pvx_ascending(&x->dy, &y->dy);
}

/* Draw the median residual of each cell: single wrong corners do not move it.  Changes the order of m. */
static void medians(const struct drawing *g, struct misses *m, const struct rec_calib_camera *k)
{
    double dx[MX * MY] = {0};
    for (int pass = 0; pass < 2; pass++) {
        qsort(m->at, m->n, sizeof *m->at, pass == 0 ? by_dx : by_dy);
        for (size_t i = 0, to; i < m->n; i = to) {
            int cell = m->at[i].cell;
            for (to = i; to < m->n && m->at[to].cell == cell; to++)
                ;
            const struct miss *a = &m->at[i + (to - i) / 2];
            if (to - i < MEDIAN)
                continue;
            if (pass == 0)
                dx[cell] = a->dx;
            else
                arrow(g, (cell % MX + 0.5) / MX * k->width - 0.5,
                      (cell / MX + 0.5) / MY * k->height - 0.5, dx[cell], a->dy, true);
        }
    }
}

pvx_err report_camera(FILE *f, const struct calibrate_result *r, size_t c, double enlargement)
{
    const struct rec_calib_camera *k = &r->look->camera[c];
    struct misses m;
    if (k->width < 1 || k->height < 1)
        return PVX_OK;
    PVX_TRY(camera_collect(r, c, &m));
    struct drawing g = {f, WIDTH / k->width, enlargement};
    double h = g.unit * k->height;
    size_t step = m.n > THIN ? (m.n + THIN - 1) / THIN : 1, far = 0;
    fprintf(f, "<figure><h3>");
    html_text(f, k->name);
    fprintf(f, "</h3><svg viewBox=\"-1 -1 %.0f %.1f\" role=\"img\">", WIDTH + 2, h + 2);
    camera_coverage(&g, &m, k);
    if (m.n > 0 && enlargement > 0 && r->rig != NULL) {
        for (size_t i = 0; i < m.n; i++)
            far += g.unit * enlargement * hypot(m.at[i].dx, m.at[i].dy) > LONGEST;
        camera_arrows(&g, &m, false, step);
        camera_arrows(&g, &m, true, far > THIN ? step : 1);
        fputs("<path class=\"median\" d=\"", f);
        medians(&g, &m, k);
        fputs("\"/>", f);
    }
    fprintf(f, "<rect class=\"frame\" width=\"%.0f\" height=\"%.1f\"/></svg><figcaption>", WIDTH,
            h);
    if (m.n == 0)
        fputs("No corner of this camera was used.", f);
    else if (r->rig == NULL)
        fprintf(f, "%zu corners found", m.n);
    else
        fprintf(f, "%zu corners, 1 in %zu drawn, %zu cut; coverage %.0f %%", m.n, step, far,
                100 * r->report->camera[c].coverage);
    fputs("</figcaption></figure>\n", f);
    free(m.at);
    return PVX_OK;
}
