/* seeds.c - where to begin on a board: a few of its points, roughly. */
#include <math.h>
#include <stdlib.h>

#include "recon/board/detect_int.h"
#include "recon/board/spec.h"

#define ENOUGH 3 /* markers */

static void look(rec_board_detector *det, const struct rec_cv_picture *p, int scale,
                 double min_side)
{
    const struct rec_dictionary *dict = rec_dictionary_find(det->print[0].board.dictionary);
    if (det->cv->markers(p, dict->index, scale, min_side, det->marker, REC_DETECT_MARKERS,
                         &det->n_quads) != 0)
        det->n_quads = 0;
    det->n_markers = 0;
    while (det->n_markers < det->n_quads && det->marker[det->n_markers].id >= 0)
        det->n_markers++;
}

/* Quadrangles whose markers may be too small to read as they are. */
static bool small_ones(const rec_board_detector *det)
{
    size_t small = 0;
    for (size_t i = 0; i < det->n_quads; i++)
        small += rec_marker_side(&det->marker[i]) < 24;
    return small >= 3 && (int64_t)det->field.width * det->field.height <= 4000000;
}

/* Seeds from the lattice as one of the layouts, the likelier. */
static size_t read_lattice(rec_board_detector *det, size_t n, const struct rec_print **print)
{
    size_t seeds = 0;
    double best = 0;
    for (int i = det->n_prints - 1; i >= 0 && n > 0; i--) {
        double score = rec_lattice_read(&det->field, &det->print[i], det->node, n, det->id);
        if (score < best || score == 0)
            continue;
        best = score;
        *print = &det->print[i];
        seeds = 0;
        for (size_t k = 0; k < n; k++) {
            double xy[3];
            if (det->id[k] < 0)
                continue;
            rec_board_point(&(*print)->board, REC_FRONT, (uint32_t)det->id[k], xy);
            det->seed[seeds++] =
                (struct rec_pair){xy[0], xy[1], det->node[k].x, det->node[k].y, 10};
        }
    }
    return seeds;
}

/* Seeds from the squares' corners, where markers' outlines could not be followed. */
static size_t from_lattice(rec_board_detector *det, struct rec_board_sight *out,
                           const struct rec_print **print)
{
    size_t seeds = 0, n;
    for (int diagonal = 0; diagonal < 2 && seeds == 0; diagonal++) {
        if (rec_lattice_find(&det->field, det->high - det->low, diagonal, det->node, &n) != PVX_OK)
            return 0;
        seeds = read_lattice(det, n, print);
        if (diagonal == 0 || det->n_nodes == 0)
            det->n_nodes = n;
        if (n == 0 && diagonal == 0 && !det->small)
            break;
    }
    if (seeds > 0)
        out->legacy = (*print)->board.legacy;
    return seeds;
}

/* Seeds from the markers that OpenCV finds, of the layout that fits best.  scale as the shim has it. */
static size_t from_markers(rec_board_detector *det, int scale, struct rec_board_sight *out,
                           const struct rec_print **print)
{
    struct rec_cv_picture p = {det->grey, det->field.width, det->field.height, det->field.width};
    struct rec_match best = {0}, m;
    look(det, &p, scale, scale > 1 ? 4.5 : 7);
    for (int i = 0; i < det->n_prints; i++) {
        rec_match(&det->print[i], det->marker, det->n_markers, &m, NULL);
        if (m.agreeing > best.agreeing) {
            best = m;
            *print = &det->print[i];
        }
    }
    if (best.agreeing == 0)
        return 0;
    rec_match(*print, det->marker, det->n_markers, &m, det->agrees);
    out->markers = (uint32_t)best.agreeing;
    out->legacy = (*print)->board.legacy;
    out->ratio = rec_match_ratio(*print, det->marker, det->n_markers, det->agrees);
    size_t n = 0;
    for (size_t i = 0; i < det->n_markers; i++) {
        double xy[4][2];
        if (!det->agrees[i])
            continue;
        rec_print_marker(*print, det->marker[i].id, xy);
        for (int c = 0; c < 4; c++)
            det->seed[n++] = (struct rec_pair){xy[c][0], xy[c][1], det->marker[i].xy[c][0],
                                               det->marker[i].xy[c][1], 1};
    }
    return n;
}

/* Level of the paper minus that of the ink around the middle of the square (0,0), by two squares there. */
static double first_is_dark(const rec_board_detector *det, const double h[9], double s)
{
    double sum = 0;
    for (int i = 0; i < 4; i++) {
        double uv[2];
        rec_homography_map(h, (i % 2 - 0.5) * s, (i / 2 - 0.5) * s, uv);
        int32_t u = (int32_t)lrint(uv[0]), v = (int32_t)lrint(uv[1]);
        if (u < 0 || v < 0 || u >= det->field.width || v >= det->field.height)
            return 0;
        sum += (i == 0 || i == 3 ? -1 : 1) * det->level[(ptrdiff_t)v * det->field.width + u];
    }
    return sum;
}

/* All corners of a chessboard, from its dark corner square on, counted so that the board is not mirrored. */
static size_t from_chessboard(rec_board_detector *det)
{
    const struct rec_board *b = &det->print[0].board;
    struct rec_cv_picture p = {det->grey, det->field.width, det->field.height, det->field.width};
    size_t n = rec_board_corners(b);
    float *xy = malloc(2 * n * sizeof *xy);
    int found = 0;
    double h[9], d[4];
    if (xy == NULL || det->cv->chessboard(&p, b->cols, b->rows, xy, &found) != 0 || !found) {
        free(xy);
        return 0;
    }
    for (size_t i = 0; i < n; i++) {
        double q[3];
        rec_board_point(b, REC_FRONT, (uint32_t)i, q);
        det->seed[i] = (struct rec_pair){q[0], q[1], xy[2 * i], xy[2 * i + 1], 1};
    }
    free(xy);
    /* rows the other way round, then the whole by half a turn */
    for (int turn = 0; turn < 2; turn++) {
        if (!rec_homography_fit(det->seed, n, h))
            return 0;
        rec_homography_jacobian(h, det->seed[n / 2].x, det->seed[n / 2].y, d);
        if (turn == 0 && d[0] * d[3] - d[1] * d[2] < 0)
            for (size_t i = 0; i < n; i++)
                det->seed[i].x = (b->cols - 1) * b->square - det->seed[i].x;
        else if (turn == 1 && first_is_dark(det, h, b->square) < 0)
            for (size_t i = 0; i < n; i++) {
                det->seed[i].x = (b->cols - 1) * b->square - det->seed[i].x;
                det->seed[i].y = (b->rows - 1) * b->square - det->seed[i].y;
            }
    }
    return n;
}

size_t rec_board_seeds(rec_board_detector *det, enum rec_way way, bool flipped,
                       struct rec_board_sight *out, const struct rec_print **print)
{
    bool april = (*print)->board.kind == REC_APRILGRID;
    size_t n;
    if ((*print)->board.kind == REC_CHESSBOARD)
        return way == REC_BY_MARKERS ? from_chessboard(det) : 0;
    switch (way) {
    case REC_BY_MARKERS:
        n = from_markers(det, 1, out, print);
        det->small |= small_ones(det);
        det->some[flipped] = out->markers > 0;
        return out->markers >= ENOUGH ? n : 0;
    case REC_BY_LATTICE: return april ? 0 : from_lattice(det, out, print);
    case REC_BY_LARGER:
        return det->small && (april || det->n_nodes > 0) ? from_markers(det, 2, out, print) : 0;
    default: return det->some[flipped] ? from_markers(det, 1, out, print) : 0;
    }
}
