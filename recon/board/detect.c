#include "recon/board/detect.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/median.h"
#include "base/mem.h"
#include "recon/board/detect_int.h"
#include "recon/board/spec.h"

#define ALIKE \
    0.15 /* least correlation of seen and printed bits; a wrong board stays within 0.1 of 0 */
#define FEWEST 6 /* corners of a view: a homography and two to check it */

/* Makes b its i-th layout, the likelier before the others; false: it has none, or it looks like an earlier one.  A grid
 * with one row looks the same counted upwards.  With one column that is half a turn of the board. */
static bool detect_layout(struct rec_board *b, int i)
{
    static const uint8_t grid[8] = {0, REC_GRID_KALIBR, 3, 1, 2, 4, 5, 6};
    if (b->kind != REC_APRILGRID) {
        b->legacy ^= i == 1;
        return i == 0 || (i == 1 && b->kind == REC_CHARUCO && b->rows % 2 == 0);
    }
    bool up = (grid[i] & REC_GRID_UP) != 0, turned = (grid[i] & REC_GRID_TURNED) != 0;
    b->grid ^= grid[i];
    return i < 2 || ((!up || b->rows > 1) && (!turned || b->cols > 1));
}

pvx_err rec_board_detector_new(const struct rec_board *b, rec_board_detector **out,
                               struct pvx_diag *d)
{
    size_t n = rec_board_corners(b), seeds = 4 * (size_t)rec_board_markers(b) + n + 4;
    rec_board_detector *det = *out = pvx_calloc(1, sizeof *det);
    PVX_NEED(det);
    const struct rec_dictionary *dict = rec_dictionary_find(b->dictionary);
    det->both = dict != NULL && rec_dictionary_two_sided(dict);
    pvx_err e = rec_cv_load(&det->cv, d);
    for (int i = 0; i < 8 && e == PVX_OK; i++) {
        struct rec_board other = *b;
        if (detect_layout(&other, i))
            e = rec_print_init(&det->print[det->n_prints++], &other, d);
    }
    det->pair = pvx_calloc(seeds + n, sizeof *det->pair);
    det->seed = pvx_calloc(seeds, sizeof *det->seed);
    det->grown = pvx_calloc(n, sizeof *det->grown);
    det->corner = pvx_calloc(n, sizeof *det->corner);
    if (e == PVX_OK &&
        (det->pair == NULL || det->seed == NULL || det->grown == NULL || det->corner == NULL))
        e = PVX_ENOMEM;
    if (e != PVX_OK) {
        rec_board_detector_free(out);
    }
    return e;
}

void rec_board_detector_free(rec_board_detector **out)
{
    rec_board_detector *det = *out;
    if (det == NULL)
        return;
    for (int i = 0; i < det->n_prints; i++)
        rec_print_fini(&det->print[i]);
    free(det->level);
    free(det->grey);
    free(det->pair);
    free(det->seed);
    free(det->grown);
    free(det->corner);
    PVX_FREE(*out);
}

static void flip_corners(rec_board_detector *det, struct rec_board_sight *out)
{
    for (size_t i = 0; i < out->view.n; i++) {
        out->view.corner[i].x = det->field.width - 1 - out->view.corner[i].x;
        out->view.corner[i].cov[1] *= -1;
    }
}

/* ---- one way round ------------------------------------------------------------------------------ */

static void detect_describe(const struct rec_print *print, const struct rec_grown *g, size_t n,
                            size_t found, struct rec_board_sight *out)
{
    double *blur = malloc(found * sizeof *blur), side = 0;
    size_t k = 0, pairs = 0;
    for (size_t i = 0; i < n && blur != NULL; i++) {
        if (!g[i].found)
            continue;
        blur[k++] = g[i].fit.blur;
        for (size_t j = i + 1; j < n; j++) {
            double p[3], q[3];
            rec_board_point(&print->board, REC_FRONT, (uint32_t)i, p);
            rec_board_point(&print->board, REC_FRONT, (uint32_t)j, q);
            double apart = hypot(p[0] - q[0], p[1] - q[1]);
            if (!g[j].found || apart > 1.01 * print->board.square)
                continue;
            side += hypot(g[i].fit.x - g[j].fit.x, g[i].fit.y - g[j].fit.y) * print->board.square /
                    apart;
            pairs++;
        }
    }
    if (blur != NULL) {
        qsort(blur, k, sizeof *blur, pvx_ascending);
        out->blur = k > 0 ? blur[k / 2] : NAN;
        out->square = pairs > 0 ? side / (double)pairs : NAN;
    }
    free(blur);
}

/* Grows from the seeds; returns the corners found, also in det->pair.  0: too few. */
static size_t detect_grow(rec_board_detector *det, const struct rec_print *print, size_t seeds)
{
    size_t all = rec_board_corners(&print->board), k = 0;
    size_t found = rec_grow(&det->field, print, det->seed, seeds, det->pair, det->grown);
    if (found < FEWEST && found < all)
        return 0;
    for (size_t i = 0; i < all; i++) {
        double q[3];
        rec_board_point(&print->board, REC_FRONT, (uint32_t)i, q);
        if (det->grown[i].found)
            det->pair[k++] =
                (struct rec_pair){q[0], q[1], det->grown[i].fit.x, det->grown[i].fit.y, 1};
    }
    return found;
}

static double detect_likeness(const rec_board_detector *det, const struct rec_print *print,
                              size_t corners)
{
    return rec_print_likeness(&det->field, print, det->high - det->low, det->pair, corners);
}

/* The aprilgrid with markers in the same order and with the other border, if its bits lie as in the picture: the
 * middle of a wide border can be taken for a narrow one. */
static const struct rec_print *other_border(const rec_board_detector *det,
                                            const struct rec_print *print, size_t corners)
{
    for (int i = 0; i < det->n_prints; i++)
        if ((det->print[i].board.grid ^ print->board.grid) == REC_GRID_WIDE &&
            detect_likeness(det, &det->print[i], corners) > detect_likeness(det, print, corners))
            return &det->print[i];
    return NULL;
}

/* Finds the corners in the picture, flipped or not; returns their number. */
static size_t attempt(rec_board_detector *det, enum rec_way way, bool flipped,
                      struct rec_board_sight *out)
{
    const struct rec_print *print = &det->print[0], *other;
    size_t all = rec_board_corners(&print->board);
    size_t seeds = rec_board_seeds(det, way, flipped, out, &print);
    if (seeds == 0)
        return 0;
    rec_board_turn(det, flipped);
    size_t found = detect_grow(det, print, seeds);
    if (found > 0 && (other = other_border(det, print, found)) != NULL) {
        print = other;
        out->grid = print->board.grid;
        found = detect_grow(det, print, seeds);
    }
    if (found == 0)
        return 0;
    /* two false markers can give a map, too */
    if (detect_likeness(det, print, found) < ALIKE) {
        out->markers = 0;
        return 0;
    }
    detect_describe(print, det->grown, all, found, out);
    out->view.n = 0;
    out->view.corner = det->corner;
    for (size_t i = 0; i < all; i++)
        if (det->grown[i].found) {
            const struct rec_corner_fit *c = &det->grown[i].fit;
            det->corner[out->view.n++] = (struct rec_board_corner){
                (uint32_t)i, c->x, c->y, {c->cov[0], c->cov[1], c->cov[2]}};
        }
    return found;
}

static bool contradicts(rec_board_detector *det, struct rec_board_sight *out)
{
    int32_t cols, rows;
    const struct rec_board *b = &det->print[0].board;
    /* of a wide border sometimes the middle is outlined */
    double side = 0, less = (out->grid & REC_GRID_WIDE) != 0 ? 0.25 : 0.08;
    for (size_t i = 0; i < det->n_markers; i++)
        side += rec_marker_side(&det->marker[i]) / (double)det->n_markers;
    if (b->kind == REC_CHESSBOARD || det->n_markers == 0)
        return false;
    if (out->markers * 10 < det->n_markers * 7 &&
        (rec_match_other(&det->print[0], det->marker, det->n_markers, out->markers, &cols, &rows) ||
         (b->kind == REC_APRILGRID && rec_match_other(&det->print[1], det->marker, det->n_markers,
                                                      out->markers, &cols, &rows)))) {
        out->outcome = REC_SIGHT_OTHER_BOARD;
        snprintf(out->text, sizeof out->text,
                 "markers fit %dx%d (or more rows), not %dx%d: give the board that was printed",
                 cols, rows, b->cols, b->rows);
    } else if (b->kind == REC_APRILGRID && det->n_markers >= 6 &&
               out->markers * 2 < det->n_markers) {
        out->outcome = REC_SIGHT_OTHER_BOARD;
        snprintf(
            out->text, sizeof out->text,
            "%u of %zu markers lie as on a grid of %dx%d: give the board that was printed, and "
            "hide other markers",
            out->markers, det->n_markers, b->cols, b->rows);
    } else if (out->ratio - 1 > fmax(0.08, 2 / side) || 1 - out->ratio > fmax(less, 2 / side)) {
        out->outcome = REC_SIGHT_OTHER_RATIO;
        snprintf(out->text, sizeof out->text,
                 "markers are %.2g of a square, the board says %.2g: measure square and marker on "
                 "the print",
                 out->ratio * b->marker / b->square, b->marker / b->square);
        if (b->kind == REC_APRILGRID)
            snprintf(out->text, sizeof out->text,
                     "markers are %.2g times as large beside their gaps as the board says: measure "
                     "marker and gap on the print",
                     out->ratio);
    } else {
        return false;
    }
    out->view.n = 0;
    return true;
}

/* Found in the flipped picture: this is the back of a two-sided board, else the picture or the print is mirrored. */
static void turn_back(rec_board_detector *det, struct rec_board_sight *out)
{
    if (det->print[0].board.two_sided) {
        out->view.face = REC_BACK;
        flip_corners(det, out);
        return;
    }
    out->outcome = REC_SIGHT_MIRRORED;
    out->view.n = 0;
    snprintf(out->text, sizeof out->text,
             "the board is mirrored: the camera's driver flips the picture, or the print is a "
             "mirror image (the back of a two-sided board: say two-sided)");
}

/* A two-sided board: tries each way unflipped and flipped, the cheapest way first.  Other boards: tries the
 * flipped picture last, and without the costliest ways. */
static bool detect_search(rec_board_detector *det, struct rec_board_sight *out)
{
    const struct rec_board *b = &det->print[0].board;
    const struct rec_board_sight nothing = *out;
    uint32_t markers = 0;
    int turns = b->kind == REC_CHESSBOARD ? 1 : 2;
    for (int i = 0; i < turns * REC_N_WAYS; i++) {
        bool flipped = b->two_sided ? i % 2 : i >= REC_N_WAYS;
        enum rec_way way = (enum rec_way)(b->two_sided ? i / 2 : i % REC_N_WAYS);
        if (flipped && !b->two_sided &&
            (way == REC_BY_LARGER || (way == REC_BY_LATTICE && det->n_nodes == 0)))
            continue;
        *out = nothing;
        size_t found = attempt(det, way, flipped, out);
        if (contradicts(det, out))
            return true;
        if (found > 0) {
            if (flipped)
                turn_back(det, out);
            return true;
        }
        if (!flipped && out->markers > markers)
            markers = out->markers;
    }
    *out = nothing;
    out->markers = markers;
    return false;
}

/* OpenCV would search long for a board that is not there. */
static bool detect_other_chessboard(rec_board_detector *det, struct rec_board_sight *out)
{
    const struct rec_board *b = &det->print[0].board;
    int n[2], most = b->cols > b->rows ? b->cols : b->rows, least = b->cols + b->rows - most;
    enum rec_other_size is = rec_board_other_size(det, n);
    if (is == REC_SIZE_CUT)
        rec_sight_why(det, out);
    if (is != REC_SIZE_OTHER)
        return is == REC_SIZE_CUT;
    int across = n[0] > n[1] ? n[0] : n[1], down = n[0] + n[1] - across;
    out->outcome = REC_SIGHT_OTHER_BOARD;
    snprintf(out->text, sizeof out->text, "the picture shows %dx%d inner corners, not %dx%d: %s",
             across, down, b->cols, b->rows,
             across == most - 1 && down == least - 1
                 ? "count the corners between four squares, not the squares"
                 : "give the board that was printed");
    return true;
}

pvx_err rec_board_detect(rec_board_detector *det, const struct rec_board_picture *p,
                         struct rec_board_sight *out)
{
    const struct rec_board *b = &det->print[0].board;
    *out = (struct rec_board_sight){
        .ratio = NAN, .square = NAN, .blur = NAN, .legacy = b->legacy, .grid = b->grid};
    if (p->data == NULL || p->width < 1 || p->height < 1 || p->width > 1 << 16 ||
        p->height > 1 << 16)
        return PVX_EINVAL;
    PVX_TRY(rec_board_read(det, p));
    det->n_nodes = det->n_markers = det->n_quads = 0;
    det->small = det->some[0] = det->some[1] = false;
    for (int i = 0; i < 6; i++)
        det->looked[i / 2][i % 2] = (struct rec_looked){0};
    if (b->kind == REC_CHESSBOARD)
        PVX_TRY(
            rec_lattice_find(&det->field, det->high - det->low, false, det->node, &det->n_nodes));
    if (b->kind == REC_CHESSBOARD && detect_other_chessboard(det, out))
        return PVX_OK;
    if (p->width >= 16 && p->height >= 16 && detect_search(det, out))
        return PVX_OK;
    rec_sight_why(det, out);
    return PVX_OK;
}
