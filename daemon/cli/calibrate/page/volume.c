/* The error through the volume, and the shape of the board. */
#include <math.h>

#include "daemon/cli/calibrate/page/figures.h"
#include "daemon/cli/report/html.h"

#define SIDE REC_CALIB_SIDE
#define CELL 40.0
#define WARP 14 /* cells across the drawing of the board */

/* Draw a cell at (x, y) with opacity `share`. */
static void cell(FILE *f, double x, double y, double side, const char *class, double share)
{
    fprintf(f,
            "<rect x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\" class=\"%s\" "
            "fill-opacity=\"%.2f\"/>",
            x, y, side, side, class, share);
}

/* Draw height k as seen from above, with y upwards. */
static void slice(FILE *f, const struct calibrate_result *r, int k, double most)
{
    const struct rec_grid *g = r->grid;
    fprintf(f, "<figure><h3>z = %.3g m</h3><svg viewBox=\"0 0 %.0f %.0f\" role=\"img\">",
            g->min[2] + (k + 0.5) / SIDE * (g->max[2] - g->min[2]), SIDE * CELL, SIDE * CELL);
    for (int j = 0; j < SIDE; j++)
        for (int i = 0; i < SIDE; i++) {
            double v = r->report->at[(k * SIDE + j) * SIDE + i], x = i * CELL,
                   y = (SIDE - 1 - j) * CELL;
            if (isfinite(v))
                cell(f, x, y, CELL, "some", 0.08 + 0.72 * v / most);
            else
                cell(f, x, y, CELL, "none", 0.15);
            fprintf(f, "<text x=\"%.1f\" y=\"%.1f\" font-size=\"11\" text-anchor=\"middle\">",
                    x + CELL / 2, y + CELL / 2 + 4);
            html_number(f, v, most < 10 ? 3 : most < 100 ? 2 : 1); /* as many decimals as fit */
            fputs("</text>", f);
        }
    fputs("</svg></figure>\n", f);
}

void report_volume(FILE *f, const struct calibrate_result *r)
{
    double most = 0, least = INFINITY;
    if (r->rig == NULL) {
        fputs("<p class=\"mute\">Not known without a rig.</p>", f);
        return;
    }
    for (int i = 0; i < SIDE * SIDE * SIDE; i++)
        if (isfinite(r->report->at[i])) {
            most = fmax(most, r->report->at[i]);
            least = fmin(least, r->report->at[i]);
        }
    if (!(most > 0)) {
        fputs("<p class=\"mute\">No camera sees the volume.</p>", f);
        return;
    }
    fprintf(
        f,
        "<p class=\"mute\">Expected error in pixels, rms over the cameras that see a place; %.3f "
        "to %.3f px, the stronger the colour the larger. Five heights, each as seen from "
        "above: x to the right, y upwards. Red: seen by no camera.</p><div class=\"slices\">\n",
        least, most);
    for (int k = 0; k < SIDE; k++)
        slice(f, r, k, most);
    fputs("</div>\n", f);
}

/* ---- the board ---- */

/* mm out of the plane, (2) of calib.h; X, Y: -1..1 */
static double bend(const double w[3], double X, double Y)
{
    return 1e3 * (w[0] * (X * X - 1.0 / 3) + w[1] * X * Y + w[2] * (Y * Y - 1.0 / 3));
}

void report_warp(FILE *f, const struct calibrate_result *r)
{
    const double *w = r->report->warp;
    double lo[3], hi[3], least = INFINITY, most = -INFINITY;
    rec_board_point(r->board, REC_FRONT, 0, lo);
    rec_board_point(r->board, REC_FRONT, rec_board_corners(r->board) - 1, hi);
    double side = 420.0 / WARP, ratio = (hi[1] - lo[1]) / (hi[0] - lo[0]);
    int rows = (int)fmax(1, fmin(4 * WARP, rint(WARP * ratio)));
    for (int i = 0; i <= 20; i++)
        for (int j = 0; j <= 20; j++) {
            least = fmin(least, bend(w, 0.1 * i - 1, 0.1 * j - 1));
            most = fmax(most, bend(w, 0.1 * i - 1, 0.1 * j - 1));
        }
    if (r->rig == NULL || !(most > least)) {
        fputs("<p class=\"mute\">The board was taken to be flat.</p>", f);
        return;
    }
    double strongest = fmax(fabs(least), fabs(most));
    fprintf(f, "<figure class=\"alone\"><svg viewBox=\"0 0 420 %.1f\" role=\"img\">", rows * side);
    for (int j = 0; j < rows; j++)
        for (int i = 0; i < WARP; i++) {
            double v = bend(w, (2 * i + 1.0) / WARP - 1, (2 * j + 1.0) / rows - 1);
            cell(f, i * side, j * side, side, v > 0 ? "plus" : "minus",
                 0.05 + 0.75 * fabs(v) / strongest);
        }
    for (int j = 0; j < 3; j++)
        for (int i = 0; i < 3; i++)
            fprintf(f,
                    "<text class=\"halo\" x=\"%.0f\" y=\"%.0f\" font-size=\"15\" "
                    "text-anchor=\"%s\">%+.3f</text>",
                    i == 0   ? 6.0
                    : i == 1 ? 210.0
                             : 414.0,
                    j == 0   ? 20.0
                    : j == 1 ? rows * side / 2 + 5
                             : rows * side - 8,
                    i == 0   ? "start"
                    : i == 1 ? "middle"
                             : "end",
                    bend(w, i - 1, j - 1));
    fprintf(f,
            "</svg><figcaption>Millimetres out of its plane, the front seen straight on, first "
            "corner at the top left; positive (blue) is away from a viewer of the front. From "
            "lowest to highest %.3f mm.",
            most - least);
    if (r->board->two_sided)
        fprintf(f, " The board is %.2f mm thick.", 1e3 * r->report->thickness);
    fputs("</figcaption></figure>\n", f);
}
