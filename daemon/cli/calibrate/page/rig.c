/* Cameras, volume and boards as they stand in the world, drawn in parallel from two sides. */
#include <float.h>
#include <math.h>
#include <string.h>

#include "daemon/cli/calibrate/page/figures.h"
#include "daemon/cli/report/html.h"
#include "daemon/cli/report/plot.h"
#include "recon/geom/rig.h"

#define WIDTH   520.0
#define EDGE    26.0 /* around it, for names */
#define FRUSTUM 0.10 /* depth of a camera, of the whole */

struct side {
    const char *title, *axis[2];
    int across, up;
};
static const struct side sides[] = {{"From above", {"x", "y"}, 0, 1},
                                    {"From the front, along y", {"x", "z"}, 0, 2}};

struct drawing {
    FILE *f;
    const struct side *side;
    double least[2], most[2], unit; /* m; per m */
    double label[REC_MAX_CAMERAS][2];
    size_t labels;
};

static void rig_widen(struct drawing *g, const double X[3])
{
    const double at[2] = {X[g->side->across], X[g->side->up]};
    for (int i = 0; i < 2 && isfinite(at[0]) && isfinite(at[1]); i++) {
        g->least[i] = fmin(g->least[i], at[i]);
        g->most[i] = fmax(g->most[i], at[i]);
    }
}

static void rig_place(const struct drawing *g, const double X[3], double at[2])
{
    at[0] = EDGE + g->unit * (X[g->side->across] - g->least[0]);
    at[1] = EDGE + g->unit * (g->most[1] - X[g->side->up]);
}

/* A closed line through n points, without its end. */
static void polygon(const struct drawing *g, const char *class, const double (*X)[3], size_t n)
{
    fprintf(g->f, "<path class=\"%s\" d=\"", class);
    for (size_t i = 0; i < n; i++) {
        double at[2];
        rig_place(g, X[i], at);
        fprintf(g->f, "%c%.1f %.1f", i == 0 ? 'M' : 'L', at[0], at[1]);
    }
    fputs("Z\"", g->f);
}

/* ---- drawings ---- */

/* Centre, then the picture's corners at `depth`, without distortion: some lenses have no such rays. */
static void frustum(const struct rec_camera *k, double depth, double X[5][3])
{
    rec_camera_centre(k, X[0]);
    for (int i = 0; i < 4; i++) {
        double u = i == 1 || i == 2 ? k->width - 0.5 : -0.5, v = i >= 2 ? k->height - 0.5 : -0.5;
        double x = (u - k->cx) / k->fx, y = (v - k->cy) / k->fy;
        for (int a = 0; a < 3; a++)
            X[1 + i][a] = X[0][a] + depth * (k->R[a] * x + k->R[3 + a] * y + k->R[6 + a]);
    }
}

/* The outermost corners of the board in frame i; false: it is not known where it was. */
static bool board(const struct calibrate_result *r, size_t i, double X[4][3])
{
    const double *R = r->report->board[i];
    double lo[3], hi[3];
    if (!isfinite(R[0]) || !isfinite(R[9]))
        return false;
    rec_board_point(r->board, REC_FRONT, 0, lo);
    rec_board_point(r->board, REC_FRONT, rec_board_corners(r->board) - 1, hi);
    for (int k = 0; k < 4; k++) {
        double x = k == 1 || k == 2 ? hi[0] : lo[0], y = k >= 2 ? hi[1] : lo[1];
        for (int a = 0; a < 3; a++)
            X[k][a] = R[3 * a] * x + R[3 * a + 1] * y + R[9 + a];
    }
    return true;
}

static void rig_measure(struct drawing *g, const struct calibrate_result *r)
{
    double X[5][3];
    for (int i = 0; i < 2; i++) {
        g->least[i] = DBL_MAX;
        g->most[i] = -DBL_MAX;
    }
    rig_widen(g, r->rig->grid.min);
    rig_widen(g, r->rig->grid.max);
    for (size_t c = 0; c < r->rig->n_cameras; c++) {
        rec_camera_centre(&r->rig->cameras[c], X[0]);
        rig_widen(g, X[0]);
    }
    for (size_t i = 0; r->report->board != NULL && i < r->report->n_frames; i++)
        for (int k = 0; board(r, i, X) && k < 4; k++)
            rig_widen(g, X[k]);
    double reach = fmax(g->most[0] - g->least[0], g->most[1] - g->least[1]);
    for (int i = 0; i < 2; i++) { /* room for the frusta */
        g->least[i] -= FRUSTUM * reach;
        g->most[i] += FRUSTUM * reach;
    }
    g->unit = (WIDTH - 2 * EDGE) / (g->most[0] - g->least[0]);
}

static void boards(const struct drawing *g, const struct calibrate_result *r)
{
    double X[4][3];
    for (size_t i = 0; r->report->board != NULL && i < r->report->n_frames; i++)
        if (board(r, i, X)) {
            polygon(g, "board", (const double(*)[3])X, 4);
            fprintf(g->f, "><title>board %u</title></path>\n", r->report->frame[i]);
        }
}

static void rig_volume(const struct drawing *g, const struct rec_grid *v)
{
    double lo[2], hi[2];
    rig_place(g, v->min, lo);
    rig_place(g, v->max, hi);
    fprintf(g->f, "<rect class=\"box\" x=\"%.1f\" y=\"%.1f\" width=\"%.1f\" height=\"%.1f\"/>\n",
            lo[0], hi[1], hi[0] - lo[0], lo[1] - hi[1]);
}

/* Draw a name beside the camera, away from the middle.  It goes below a name that is there already. */
static void rig_name(struct drawing *g, const char *text, const double at[2])
{
    double away = at[0] < WIDTH / 2 ? -1 : 1, y = at[1] - 7;
    for (size_t i = 0; i < g->labels; i++)
        if (fabs(g->label[i][0] - at[0]) < 60 && fabs(g->label[i][1] - y) < 12) {
            y = g->label[i][1] + 12.5;
            i = (size_t)-1; /* begin with the first again; ends because y only grows */
        }
    g->label[g->labels][0] = at[0];
    g->label[g->labels++][1] = y;
    fprintf(g->f, "<text class=\"halo\" x=\"%.1f\" y=\"%.1f\" font-size=\"12\" text-anchor=\"%s\">",
            at[0] + 6 * away, y, away < 0 ? "end" : "start");
    html_text(g->f, text);
    fputs("</text>\n", g->f);
}

static void rig_cameras(struct drawing *g, const struct rec_rig *rig)
{
    double X[5][3], at[2];
    double depth = FRUSTUM * fmax(g->most[0] - g->least[0], g->most[1] - g->least[1]);
    for (size_t c = 0; c < rig->n_cameras; c++) {
        frustum(&rig->cameras[c], depth, X);
        polygon(g, "camera", (const double(*)[3])(X + 1), 4);
        fputs("/>", g->f);
        for (int i = 0; i < 4; i++) {
            double face[3][3];
            memcpy(face[0], X[0], sizeof face[0]);
            memcpy(face[1], X[1 + i], sizeof face[1]);
            memcpy(face[2], X[1 + (i + 1) % 4], sizeof face[2]);
            polygon(g, "camera", (const double(*)[3])face, 3);
            fputs("/>", g->f);
        }
        rig_place(g, X[0], at);
        fprintf(g->f, "<circle class=\"lens\" cx=\"%.1f\" cy=\"%.1f\" r=\"2.5\"/>\n", at[0], at[1]);
    }
    for (size_t c = 0; c < rig->n_cameras; c++) {
        rec_camera_centre(&rig->cameras[c], X[0]);
        rig_place(g, X[0], at);
        rig_name(g, rig->cameras[c].name, at);
    }
}

/* Draw the directions of x and y (or z), and a length. */
static void legend(const struct drawing *g, double height)
{
    double y = height - 14, metres = report_round(0.25 * (g->most[0] - g->least[0]));
    double bar = metres * g->unit;
    fprintf(g->f,
            "<path class=\"bar\" d=\"M12 %.1fv-26m-4 6l4 -6l4 6M12 %.1fh26m-6 -4l6 4l-6 4\"/>"
            "<text x=\"42\" y=\"%.1f\" font-size=\"12\">%s</text><text x=\"8\" y=\"%.1f\" "
            "font-size=\"12\">%s</text>\n",
            y, y, y + 4, g->side->axis[0], y - 31, g->side->axis[1]);
    fprintf(g->f,
            "<path class=\"bar\" d=\"M%.1f %.1fv6h%.1fv-6\"/><text x=\"%.1f\" y=\"%.1f\" "
            "font-size=\"12\" text-anchor=\"middle\">%g m</text>\n",
            WIDTH - 14 - bar, y - 4, bar, WIDTH - 14 - bar / 2, y - 4, metres);
}

void report_rig(FILE *f, const struct calibrate_result *r)
{
    if (r->rig == NULL) {
        fputs("<p class=\"mute\">No rig could be had.</p>", f);
        return;
    }
    fputs("<div class=\"halves\">", f);
    for (size_t i = 0; i < sizeof sides / sizeof *sides; i++) {
        struct drawing g = {.f = f, .side = &sides[i]};
        rig_measure(&g, r);
        double h = 2 * EDGE + g.unit * (g.most[1] - g.least[1]) + 30;
        fprintf(f, "<figure><h3>%s</h3><svg viewBox=\"0 0 %.0f %.1f\" role=\"img\">\n",
                sides[i].title, WIDTH, h);
        boards(&g, r);
        rig_volume(&g, &r->rig->grid);
        rig_cameras(&g, r->rig);
        legend(&g, h);
        fputs("</svg></figure>\n", f);
    }
    fputs("</div>\n", f);
}
