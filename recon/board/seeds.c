/* seeds.c - the start on a board: a few roughly known points. */
#include <limits.h>
#include <math.h>
#include <stdlib.h>

#include "base/mem.h"
#include "recon/board/detect_int.h"
#include "recon/board/spec.h"

#define ENOUGH 3  /* markers */
#define LEAST  14 /* px, the diagonal of a chessboard's square */
#define SMALL  24 /* px, the side of a marker that may be too small to read */

enum { SMALLER, AS_IT_IS, LARGER };

/* Scale that reduces a large picture to about half a million pixels, in steps of four times fewer; else 1. */
static double smaller(const rec_board_detector *det)
{
    double scale = 1, n = (double)det->field.width * det->field.height;
    for (; n * scale * scale > 700e3; scale /= 2)
        continue;
    return scale;
}

/* A rectangle that grows to contain each point put into it. */
struct box {
    double x0, y0, x1, y1;
};

static void seeds_put(struct box *b, double x, double y)
{
    b->x0 = fmin(b->x0, x);
    b->y0 = fmin(b->y0, y);
    b->x1 = fmax(b->x1, x);
    b->y1 = fmax(b->y1, y);
}

/* The part of the picture where markers too small to read may be: around the lattice and the small quadrangles. */
static void window(const rec_board_detector *det, int border, int32_t x[2], int32_t y[2])
{
    const struct rec_looked *l = &det->looked[AS_IT_IS][border - 1];
    struct box b = {INFINITY, INFINITY, -INFINITY, -INFINITY};
    int32_t w = det->field.width, h = det->field.height;
    for (size_t i = 0; i < det->n_nodes; i++)
        seeds_put(&b, det->nodes_flipped == det->flipped ? det->node[i].x : w - 1 - det->node[i].x,
                  det->node[i].y);
    for (size_t i = 0; i < l->n; i++) {
        double u = l->marker[i].xy[0][0];
        if (rec_marker_side(&l->marker[i]) < SMALL)
            seeds_put(&b, !det->both && l->flipped != det->flipped ? w - 1 - u : u,
                      l->marker[i].xy[0][1]);
    }
    double more = 20 + 0.5 * fmax(b.x1 - b.x0, b.y1 - b.y0);
    x[0] = (int32_t)fmin(fmax(0, b.x0 - more), w);
    y[0] = (int32_t)fmin(fmax(0, b.y0 - more), h);
    x[1] = (int32_t)fmax(fmin(w, b.x1 + more), x[0]);
    y[1] = (int32_t)fmax(fmin(h, b.y1 + more), y[0]);
}

/* Whether the marker m, the last so far, was read before: a blurred border has two outlines. */
static bool read_twice(const rec_board_detector *det, const struct rec_cv_marker *m)
{
    for (const struct rec_cv_marker *o = det->marker; o < m && m->id >= 0; o++) {
        double x = 0, y = 0;
        for (int c = 0; c < 4; c++) {
            x += 0.25 * (double)(m->xy[c][0] - o->xy[c][0]);
            y += 0.25 * (double)(m->xy[c][1] - o->xy[c][1]);
        }
        if (o->id == m->id && hypot(x, y) < 0.25 * rec_marker_side(o))
            return true;
    }
    return false;
}

/* Finds the markers of one face, in the coordinates of the picture flipped or not. */
static void seeds_look(rec_board_detector *det, int how, int border, bool flipped)
{
    struct rec_looked *l = &det->looked[how][border - 1];
    if (!l->done || (!det->both && l->flipped != flipped)) {
        rec_board_turn(det, flipped && !det->both);
        int32_t x[2] = {0, det->field.width}, y[2] = {0, det->field.height};
        if (how == LARGER)
            window(det, border, x, y);
        const struct rec_cv_picture p = {det->grey + (ptrdiff_t)y[0] * det->field.width + x[0],
                                         x[1] - x[0], y[1] - y[0], det->field.width};
        const struct rec_cv_search s = {
            .dictionary = rec_dictionary_find(det->print[0].board.dictionary)->index,
            .border = border,
            .scale = how == SMALLER  ? smaller(det)
                     : how == LARGER ? 2
                                     : 1,
            .min_side = how == LARGER ? 4.5 : 7,
            .darker = fmax(7, 3 * 255 * det->noise / (det->high - det->low)),
            .mirrored_too = det->both};
        if (det->cv->markers(&p, &s, l->marker, REC_DETECT_MARKERS, &l->n) != 0)
            l->n = 0;
        for (size_t i = 0; i < l->n; i++)
            for (int c = 0; c < 4; c++) {
                l->marker[i].xy[c][0] += (float)x[0];
                l->marker[i].xy[c][1] += (float)y[0];
            }
        l->done = true;
        l->flipped = flipped;
    }
    det->n_quads = det->n_markers = 0;
    bool behind = det->both && flipped;
    for (size_t i = 0; i < l->n; i++) {
        struct rec_cv_marker *m = &det->marker[det->n_quads];
        if (l->marker[i].id >= 0 && l->marker[i].mirrored != behind)
            continue;
        *m = l->marker[i];
        for (int c = 0; c < 4 && behind; c++)
            m->xy[c][0] = (float)(det->field.width - 1) - m->xy[c][0];
        if (read_twice(det, m))
            continue;
        det->n_markers += m->id >= 0;
        det->n_quads++;
    }
}

/* Whether there are quadrangles that may be markers too small to read at this scale. */
static bool small_ones(const rec_board_detector *det)
{
    size_t small = 0;
    for (size_t i = 0; i < det->n_quads; i++)
        small += rec_marker_side(&det->marker[i]) < SMALL;
    return small >= 3 && (int64_t)det->field.width * det->field.height <= 4000000;
}

/* Seeds from the lattice, read as the likelier of the layouts. */
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
        det->nodes_flipped = det->flipped;
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

/* Lets at most one marker of each id count, if it was read in several places; returns how many count. */
static size_t each_once(rec_board_detector *det)
{
    size_t n = 0;
    for (size_t i = 0; i < det->n_markers; i++) {
        for (size_t j = 0; j < i && det->agrees[i]; j++)
            det->agrees[i] = !det->agrees[j] || det->marker[j].id != det->marker[i].id;
        n += det->agrees[i];
    }
    return n;
}

/* Seeds from the markers that OpenCV finds, of the layout that fits best. */
static size_t from_markers(rec_board_detector *det, int how, bool flipped,
                           struct rec_board_sight *out, const struct rec_print **print)
{
    struct rec_match best = {0}, m;
    int own = det->print[0].border, border = own;
    bool april = (*print)->board.kind == REC_APRILGRID;
    for (int other = 0; other < (april ? 2 : 1); other++) {
        int now = other != 0 ? 3 - own : own;
        seeds_look(det, how, now, flipped);
        for (int i = 0; i < det->n_prints; i++) {
            if (det->print[i].border != now)
                continue;
            rec_match(&det->print[i], det->marker, det->n_markers, &m, NULL);
            /* a wide border may be read as a narrow one around less */
            if (m.agreeing > best.agreeing ||
                (m.agreeing == best.agreeing && now != border && m.error < best.error)) {
                best = m;
                *print = &det->print[i];
                border = now;
            }
        }
    }
    seeds_look(det, how, border, flipped);
    if (best.agreeing == 0)
        return 0;
    rec_match(*print, det->marker, det->n_markers, &m, det->agrees);
    out->markers = (uint32_t)each_once(det);
    out->legacy = (*print)->board.legacy;
    out->grid = (*print)->board.grid;
    out->ratio = rec_match_ratio(*print, det->marker, det->n_markers, det->agrees);
    size_t n = 0;
    for (size_t i = 0; i < det->n_markers; i++)
        if (det->agrees[i])
            n += rec_match_pairs(*print, &det->marker[i], det->seed + n);
    return n;
}

/* Level of the paper minus that of the ink around the first inner corner, from the four squares that meet there. */
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

/* A rectangle of nodes of the lattice. */
struct rect {
    int lo[2], hi[2];
};

static int rect_side(const struct rect *r, int a)
{
    return r->hi[a] - r->lo[a] + 1;
}

static bool rect_has(const struct rect *r, const struct rec_node *p)
{
    return p->i >= r->lo[0] && p->i <= r->hi[0] && p->j >= r->lo[1] && p->j <= r->hi[1];
}

/* The rectangle of nodes of the lattice, without lines at its rim that are mostly empty.  Returns the share of its nodes
 * that are there. */
static double lattice_rect(const rec_board_detector *det, struct rect *r)
{
    size_t n = 0;
    *r = (struct rect){{INT_MAX, INT_MAX}, {INT_MIN, INT_MIN}};
    for (size_t k = 0; k < det->n_nodes; k++)
        for (int a = 0; a < 2; a++) {
            int v = a == 0 ? det->node[k].i : det->node[k].j;
            r->lo[a] = v < r->lo[a] ? v : r->lo[a];
            r->hi[a] = v > r->hi[a] ? v : r->hi[a];
        }
    for (int side = 0, full = 0; full < 4 && r->lo[0] < r->hi[0] && r->lo[1] < r->hi[1];
         side = (side + 1) % 4) {
        int a = side % 2, *at = side < 2 ? &r->lo[a] : &r->hi[a], on = 0;
        for (size_t k = 0; k < det->n_nodes; k++)
            on += rect_has(r, &det->node[k]) && (a == 0 ? det->node[k].i : det->node[k].j) == *at;
        full = 2 * on > r->hi[1 - a] - r->lo[1 - a] + 1 ? full + 1 : 0;
        *at += full > 0 ? 0 : side < 2 ? 1 : -1;
    }
    for (size_t k = 0; k < det->n_nodes; k++)
        n += rect_has(r, &det->node[k]);
    return n > 0 ? (double)n / (rect_side(r, 0) * rect_side(r, 1)) : 0;
}

/* All corners of the chessboard from a lattice that has its size. */
static size_t whole_lattice(rec_board_detector *det, const struct rect *r)
{
    const struct rec_board *b = &det->print[0].board;
    bool along = rect_side(r, 0) == b->cols && rect_side(r, 1) == b->rows;
    size_t n = 0;
    if (!along && (rect_side(r, 0) != b->rows || rect_side(r, 1) != b->cols))
        return 0;
    for (size_t k = 0; k < det->n_nodes; k++) {
        const struct rec_node *p = &det->node[k];
        int i = p->i - r->lo[0], j = p->j - r->lo[1];
        if (rect_has(r, p))
            det->seed[n++] = (struct rec_pair){(along ? i : j) * b->square,
                                               (along ? j : i) * b->square, p->x, p->y, 1};
    }
    return n;
}

/* All corners of the chessboard, as OpenCV finds them. */
static size_t opencvs_chessboard(rec_board_detector *det)
{
    const struct rec_board *b = &det->print[0].board;
    struct rec_cv_picture p = {det->grey, det->field.width, det->field.height, det->field.width};
    size_t n = rec_board_corners(b);
    float *xy = malloc(2 * n * sizeof *xy);
    int found = 0;
    if (xy == NULL || det->cv->chessboard(&p, b->cols, b->rows, xy, &found) != 0 || !found)
        n = 0;
    for (size_t i = 0; i < n; i++) {
        double q[3];
        rec_board_point(b, REC_FRONT, (uint32_t)i, q);
        det->seed[i] = (struct rec_pair){q[0], q[1], xy[2 * i], xy[2 * i + 1], 1};
    }
    free(xy);
    return n;
}

/* Mean difference between the levels in the middles of neighbours, of m squares from (i, j) on along i or j, with a sign
 * that changes from square to square.  NAN: few of them are inside the picture. */
static double alternation(const rec_board_detector *det, const double h[9], int i, int j, bool down,
                          int m)
{
    double sum = 0, before = NAN;
    int n = 0;
    for (int k = 0; k < m; k++) {
        int x = down ? i : i + k, y = down ? j + k : j;
        double uv[2], now = NAN;
        rec_homography_map(h, x + 0.5, y + 0.5, uv);
        if (uv[0] >= 0 && uv[1] >= 0 && uv[0] <= det->field.width - 1 &&
            uv[1] <= det->field.height - 1)
            now = det->level[lrint(uv[1]) * det->field.width + lrint(uv[0])];
        if (!isnan(now) && !isnan(before)) {
            sum += ((x + y) % 2 == 0 ? 0.5 : -0.5) * (now - before);
            n++;
        }
        before = now;
    }
    return 4 * n >= m - 1 ? sum / n : NAN;
}

/* Whether the board's size can be this one, with up to more[] lines added. */
static bool size_can_be(const struct rec_board *b, const struct rect *r, const int more[2])
{
    int along[2] = {b->cols - rect_side(r, 0), b->rows - rect_side(r, 1)};
    int across[2] = {b->rows - rect_side(r, 0), b->cols - rect_side(r, 1)};
    return (along[0] >= 0 && along[1] >= 0 && along[0] <= more[0] && along[1] <= more[1]) ||
           (across[0] >= 0 && across[1] >= 0 && across[0] <= more[0] && across[1] <= more[1]);
}

/* Whether the rectangle is a chessboard to its rim: beyond the squares around it none follow. */
static enum rec_other_size ends_there(const rec_board_detector *det, const struct rect *r)
{
    struct rec_pair *pair = pvx_calloc(det->n_nodes, sizeof *pair);
    double h[9];
    size_t n = 0;
    int cut[2] = {0, 0};
    for (size_t k = 0; pair != NULL && k < det->n_nodes; k++) {
        const struct rec_node *p = &det->node[k];
        if (rect_has(r, p))
            pair[n++] = (struct rec_pair){p->i, p->j, p->x, p->y, 1};
    }
    bool ok = pair != NULL && rec_homography_fit(pair, n, h);
    free(pair);
    if (!ok)
        return REC_SIZE_UNKNOWN;
    double inside = fabs(alternation(det, h, r->lo[0], r->lo[1], false, rect_side(r, 0) - 1));
    /* small or weak: a texture, and the board may be elsewhere */
    for (int a = 0; a < 2; a++) {
        double p[2], q[2];
        rec_homography_map(h, a == 0 ? r->lo[0] : r->hi[0], a == 0 ? r->lo[1] : r->hi[1], p);
        rec_homography_map(h, a == 0 ? r->lo[0] + 1 : r->hi[0] - 1,
                           a == 0 ? r->lo[1] + 1 : r->hi[1] - 1, q);
        if (hypot(q[0] - p[0], q[1] - p[1]) < LEAST || !(inside > 0.25 * (det->high - det->low)))
            return REC_SIZE_UNKNOWN;
    }
    for (int side = 0; side < 4; side++) {
        int a = side % 2, from[2] = {r->lo[0] - 1, r->lo[1] - 1};
        from[a] = side < 2 ? r->lo[a] - 2 : r->hi[a] + 1;
        double beyond =
            fabs(alternation(det, h, from[0], from[1], a == 0, rect_side(r, 1 - a) + 1));
        if (beyond >= 0.3 * inside)
            return REC_SIZE_UNKNOWN;
        cut[a] += isnan(beyond); /* one more line of corners may lie there */
    }
    return size_can_be(&det->print[0].board, r, cut) ? REC_SIZE_UNKNOWN
           : cut[0] + cut[1] > 0                     ? REC_SIZE_CUT
                                                     : REC_SIZE_OTHER;
}

enum rec_other_size rec_board_other_size(rec_board_detector *det, int size[2])
{
    const struct rec_board *b = &det->print[0].board;
    struct rect r;
    if (2 * det->n_nodes < rec_board_corners(b) || lattice_rect(det, &r) < 0.9)
        return REC_SIZE_UNKNOWN;
    size[0] = rect_side(&r, 0);
    size[1] = rect_side(&r, 1);
    return size_can_be(b, &r, (const int[2]){0, 0}) ? REC_SIZE_UNKNOWN : ends_there(det, &r);
}

/* All corners of a chessboard, counted from its dark corner square and so that the board is not mirrored. */
static size_t from_chessboard(rec_board_detector *det, bool lattice)
{
    const struct rec_board *b = &det->print[0].board;
    double h[9], d[4];
    struct rect r;
    size_t n = !lattice                     ? opencvs_chessboard(det)
               : lattice_rect(det, &r) == 1 ? whole_lattice(det, &r)
                                            : 0;
    if (n == 0)
        return 0;
    /* reverses the rows if mirrored, then turns the whole by half a turn if needed */
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

/* Seeds from the picture made smaller.  If there is any doubt: none, and no trace of the attempt. */
static size_t from_smaller(rec_board_detector *det, bool flipped, struct rec_board_sight *out,
                           const struct rec_print **print)
{
    size_t n = smaller(det) < 1 ? from_markers(det, SMALLER, flipped, out, print) : 0;
    if (n > 0 && out->markers >= 2 * ENOUGH && out->markers * 10 >= det->n_markers * 7 &&
        fabs(out->ratio - 1) < 0.08)
        return n;
    out->markers = 0;
    det->n_markers = 0;
    return 0;
}

size_t rec_board_seeds(rec_board_detector *det, enum rec_way way, bool flipped,
                       struct rec_board_sight *out, const struct rec_print **print)
{
    bool april = (*print)->board.kind == REC_APRILGRID;
    size_t n;
    if ((*print)->board.kind == REC_CHESSBOARD)
        return way == REC_BY_SMALLER || way == REC_BY_MARKERS
                   ? from_chessboard(det, way == REC_BY_SMALLER)
                   : 0;
    switch (way) {
    case REC_BY_SMALLER: return from_smaller(det, flipped, out, print);
    case REC_BY_MARKERS:
        n = from_markers(det, AS_IT_IS, flipped, out, print);
        det->small |= small_ones(det);
        det->some[flipped] = out->markers > 0;
        return out->markers >= ENOUGH ? n : 0;
    case REC_BY_LATTICE:
        rec_board_turn(det, flipped);
        return april ? 0 : from_lattice(det, out, print);
    case REC_BY_LARGER:
        return det->small && (april || det->n_nodes > 0)
                   ? from_markers(det, LARGER, flipped, out, print)
                   : 0;
    default: return det->some[flipped] ? from_markers(det, AS_IT_IS, flipped, out, print) : 0;
    }
}
