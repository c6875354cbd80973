/* The graph of a calibration: cameras on a ring in the order in which they stand, joined by common poses. */
#include <math.h>

#include "daemon/cli/calibrate/page/figures.h"
#include "daemon/cli/report/html.h"
#include "recon/geom/rig.h"

#define RING   150.0
#define LABELS 10 /* cameras up to which every edge has its number beside it */
#define WIDEST 8.0
#define TURN   6.283185307179586

/* Place of each camera on the ring: by the direction in which it stands.  Without a rig: in the order of the list. */
static void pairs_order(const struct calibrate_result *r, size_t place[REC_MAX_CAMERAS])
{
    size_t n = r->look->n_cameras;
    double turn[REC_MAX_CAMERAS];
    for (size_t c = 0; c < n; c++) {
        turn[c] = (double)c;
        if (r->rig != NULL) {
            const struct rec_grid *g = &r->rig->grid;
            double x[3];
            int at = rec_rig_find(r->rig, r->look->camera[c].name); /* --add, --recover: merged */
            if (at < 0)
                continue;
            rec_camera_centre(&r->rig->cameras[at], x);
            turn[c] =
                atan2(x[1] - 0.5 * (g->min[1] + g->max[1]), x[0] - 0.5 * (g->min[0] + g->max[0]));
        }
    }
    for (size_t c = 0; c < n; c++) {
        place[c] = 0;
        for (size_t o = 0; o < n; o++)
            place[c] += turn[o] < turn[c] || (turn[o] == turn[c] && o < c);
    }
}

/* Position at `out` times the ring's radius.  Places go counterclockwise from the right, as x and y of the world. */
static void spot(size_t place, size_t n, double out, double at[2])
{
    double a = TURN * (double)place / (double)n;
    at[0] = out * RING * cos(a);
    at[1] = -out * RING * sin(a);
}

/* Whether the rig depends on this pair, but too few poses join it. */
static bool weak(const struct rec_calib_pair *p)
{
    return p->in_tree && p->common < REC_CALIB_JOINT;
}

static void pairs_edge(FILE *f, const struct rec_calib_pair *p, const size_t place[REC_MAX_CAMERAS],
                       size_t n, uint32_t most)
{
    double a[2], b[2];
    spot(place[p->a], n, 1, a);
    spot(place[p->b], n, 1, b);
    const char *class = p->common == 0 ? "missing"
                        : weak(p)      ? "weak"
                        : p->in_tree   ? "tree"
                                       : "edge";
    fprintf(f, "<line class=\"%s\" x1=\"%.1f\" y1=\"%.1f\" x2=\"%.1f\" y2=\"%.1f\"", class, a[0],
            a[1], b[0], b[1]);
    if (p->common > 0)
        fprintf(f, " stroke-width=\"%.1f\"", 1 + (WIDEST - 1) * p->common / most);
    fprintf(f, "><title>%u common poses</title></line>\n", p->common);
}

/* In the middle of the edge.  Labels of opposite cameras would all be in one place, so they are moved along it. */
static void edge_label(FILE *f, const struct rec_calib_pair *p, const size_t place[REC_MAX_CAMERAS],
                       size_t n)
{
    double a[2], b[2];
    size_t d = place[p->a] > place[p->b] ? place[p->a] - place[p->b] : place[p->b] - place[p->a];
    double t = 2 * d == n && n > 2 ? 0.31 : 0.5;
    spot(place[p->a], n, 1, a);
    spot(place[p->b], n, 1, b);
    fprintf(f,
            "<text class=\"halo\" x=\"%.1f\" y=\"%.1f\" text-anchor=\"middle\" "
            "font-size=\"12\">%u</text>\n",
            a[0] + t * (b[0] - a[0]), a[1] + t * (b[1] - a[1]) + 4, p->common);
}

static void pairs_ring(FILE *f, const struct calibrate_result *r)
{
    const struct rec_calib_report *o = r->report;
    size_t n = r->look->n_cameras, place[REC_MAX_CAMERAS];
    uint32_t most = 1;
    pairs_order(r, place);
    for (size_t i = 0; i < o->n_pairs; i++)
        most = o->pair[i].common > most ? o->pair[i].common : most;
    int tall = n == 2 ? 40 : 195;
    fprintf(f, "<figure class=\"alone\"><svg viewBox=\"-240 %d 480 %d\" role=\"img\">", -tall,
            2 * tall);
    for (size_t i = 0; i < o->n_pairs; i++)
        pairs_edge(f, &o->pair[i], place, n, most);
    for (size_t i = 0; i < o->n_pairs && n <= LABELS; i++)
        if (o->pair[i].common > 0)
            edge_label(f, &o->pair[i], place, n);
    for (size_t c = 0; c < n; c++) {
        double at[2], name[2];
        spot(place[c], n, 1, at);
        spot(place[c], n, 1.09, name);
        fprintf(f,
                "<circle class=\"node\" cx=\"%.1f\" cy=\"%.1f\" r=\"6\"/><text class=\"halo\" "
                "x=\"%.1f\" y=\"%.1f\" font-size=\"13\" text-anchor=\"%s\">",
                at[0], at[1], name[0], name[1] + 4.5 - 6 * (at[1] < -0.9 * RING),
                at[0] > 0.2 * RING    ? "start"
                : at[0] < -0.2 * RING ? "end"
                                      : "middle");
        html_text(f, r->look->camera[c].name);
        fputs("</text>\n", f);
    }
    fprintf(f, "</svg><figcaption>The wider, the more common poses. Grey: the tree by which the "
               "cameras were first put together; orange: too few in it; dashed red: no common "
               "pose.</figcaption></figure>\n");
}

static void pairs_table(FILE *f, const struct calibrate_result *r)
{
    const struct rec_calib_report *o = r->report;
    size_t n = r->look->n_cameras;
    fputs("<div class=\"wide\"><table class=\"small\"><tr><th>common poses</th>", f);
    for (size_t c = 1; c < n; c++) {
        fputs("<th class=\"n\">", f);
        html_text(f, r->look->camera[c].name);
        fputs("</th>", f);
    }
    fputs("</tr>\n", f);
    for (size_t a = 0, i = 0; a + 1 < n; a++) {
        fputs("<tr><th>", f);
        html_text(f, r->look->camera[a].name);
        fputs("</th>", f);
        for (size_t b = 1; b < n; b++) {
            if (b <= a || i == o->n_pairs) {
                fputs("<td></td>", f);
                continue;
            }
            const struct rec_calib_pair *p = &o->pair[i++]; /* a < b, b fastest */
            fprintf(f, "<td class=\"n%s\">%u</td>",
                    p->common == 0 ? " bad"
                    : weak(p)      ? " warn"
                                   : "",
                    p->common);
        }
        fputs("</tr>\n", f);
    }
    fputs("</table></div>\n", f);
}

void report_pairs(FILE *f, const struct calibrate_result *r)
{
    if (r->report->pair == NULL || r->report->n_pairs == 0) {
        fputs("<p class=\"mute\">The cameras were not compared.</p>", f);
        return;
    }
    pairs_ring(f, r);
    pairs_table(f, r);
}
