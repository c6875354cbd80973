/* why.c - why no board was found, in words. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "recon/board/detect_int.h"

#define DIM      0.03 /* of full scale: contrast too low to read anything */
#define SOFT     3.0  /* px, Gaussian blur of the sharpest edges */
#define READABLE 14.0 /* px, the side of a square */

static const char *const names[REC_N_SIGHTS] = {"found",    "no marker",   "dark",
                                                "blurred",  "too small",   "few",
                                                "mirrored", "other board", "other ratio"};

const char *rec_sight_name(enum rec_sight s)
{
    return s < REC_N_SIGHTS ? names[s] : "?";
}

/* Gaussian blur of the sharpest edges [px].  The slope of a blurred step of height c is c / (blur sqrt(2 pi)); it
 * is taken as the slope that 0.2 % of the pixels exceed. */
static double edge_blur(const rec_board_detector *det)
{
    enum { BINS = 512 };
    size_t h[BINS] = {0}, n = 0, over = 0;
    const struct rec_field *f = &det->field;
    double range = det->range;
    for (int32_t v = 1; v + 1 < f->height; v++)
        for (int32_t u = 1; u + 1 < f->width; u++) {
            const float *p = f->level + (ptrdiff_t)v * f->width + u;
            double g = hypotf(p[1] - p[-1], p[f->width] - p[-f->width]) / 2 / range;
            h[(int)(fmin(g, 0.999) * BINS)]++;
            n++;
        }
    int at = BINS - 1;
    while (at > 0 && over + h[at] <= n / 500)
        over += h[at--];
    return 1 / ((at + 0.5) / BINS * sqrt(2 * 3.14159265358979));
}

/* px between the corners of a lattice that may be a board too small to read; INFINITY: there is none. */
static double small_side(const rec_board_detector *det)
{
    double sum = 0;
    size_t pairs = 0;
    if (det->print[0].board.kind == REC_APRILGRID) { /* no lattice: small quadrangles */
        for (size_t i = det->n_markers; i < det->n_quads; i++)
            if (rec_marker_side(&det->marker[i]) < READABLE) {
                sum += rec_marker_side(&det->marker[i]);
                pairs++;
            }
        return (int32_t)pairs * 2 >= det->print[0].n_markers && pairs >= 6 ? sum / (double)pairs
                                                                           : INFINITY;
    }
    for (size_t a = 0; a < det->n_nodes && det->n_nodes >= 9; a++)
        for (size_t b = 0; b < det->n_nodes; b++) {
            const struct rec_node *p = &det->node[a], *q = &det->node[b];
            if (abs(p->i - q->i) + abs(p->j - q->j) == 1) {
                sum += hypot(p->x - q->x, p->y - q->y);
                pairs++;
            }
        }
    return pairs > 0 ? sum / (double)pairs : INFINITY;
}

void rec_sight_why(const rec_board_detector *det, struct rec_board_sight *out)
{
    const struct rec_board *b = &det->print[0].board;
    const char *what = b->kind == REC_CHESSBOARD ? "chessboard" : "marker";
    double range = det->range, blur = edge_blur(det);
    double side = small_side(det);
    if (det->field.width < 16 || det->field.height < 16) {
        out->outcome = REC_SIGHT_SMALL;
        snprintf(out->text, sizeof out->text, "the picture has only %d x %d pixels",
                 det->field.width, det->field.height);
    } else if (range < DIM) {
        out->outcome = REC_SIGHT_DARK;
        snprintf(out->text, sizeof out->text,
                 "no %s: the picture has a contrast of %.1f %% of full scale; expose longer or "
                 "light the board",
                 what, 100 * range);
    } else if (out->markers > 0) {
        out->outcome = REC_SIGHT_FEW;
        snprintf(out->text, sizeof out->text,
                 "%u marker%s of the board, but too few corners: show more of it, larger or less "
                 "tilted",
                 out->markers, out->markers == 1 ? "" : "s");
    } else if (b->kind == REC_CHESSBOARD && side >= READABLE && side < INFINITY) {
        out->outcome = REC_SIGHT_FEW;
        snprintf(out->text, sizeof out->text,
                 "%zu corners of squares, but no %dx%d: a chessboard must be seen whole and have "
                 "so many inner corners",
                 det->n_nodes, b->cols, b->rows);
    } else if (blur > SOFT) {
        out->outcome = REC_SIGHT_BLURRED;
        snprintf(out->text, sizeof out->text,
                 "no %s: the sharpest edges are blurred by %.1f px; focus, stop down, or hold the "
                 "board still",
                 what, blur);
    } else if (side < READABLE) {
        out->outcome = REC_SIGHT_SMALL;
        snprintf(out->text, sizeof out->text,
                 "no %s is readable: what may be the board has squares of %.0f pixels; bring it "
                 "nearer or print it larger",
                 what, side);
    } else {
        out->outcome = REC_SIGHT_NO_MARKER;
        snprintf(out->text, sizeof out->text, "no %s of the board in the picture%s", what,
                 det->n_markers > 3 ? ": those that are there do not lie as on it"
                 : det->n_quads > 8 && b->kind != REC_CHESSBOARD
                     ? ", though there are quadrangles: is the dictionary right?"
                     : "");
    }
}
