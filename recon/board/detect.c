#include "recon/board/detect.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/board/detect_int.h"
#include "recon/board/spec.h"

#define ALIKE \
    0.15 /* markers' bits with those printed; what is taken for another is within 0.1 of 0 */
#define FEWEST 6 /* corners of a view: a homography and two to check it */

static pvx_err room(rec_board_detector *det, size_t pixels)
{
    if (pixels <= det->size)
        return PVX_OK;
    det->size = 0;
    free(det->level);
    free(det->grey);
    det->level = pvx_calloc(pixels, sizeof *det->level);
    det->grey = pvx_calloc(pixels, 1);
    if (det->level == NULL || det->grey == NULL)
        return PVX_ENOMEM;
    det->size = pixels;
    return PVX_OK;
}

pvx_err rec_board_detector_new(const struct rec_board *b, rec_board_detector **out,
                               struct pvx_diag *d)
{
    size_t n = rec_board_corners(b), seeds = 4 * (size_t)rec_board_markers(b) + n + 4;
    rec_board_detector *det = *out = pvx_calloc(1, sizeof *det);
    if (det == NULL)
        return PVX_ENOMEM;
    struct rec_board other = *b;
    other.legacy = !b->legacy;
    pvx_err e = rec_cv_load(&det->cv, d);
    if (e == PVX_OK)
        e = rec_print_init(&det->print[det->n_prints++], b, d);
    if (e == PVX_OK && b->kind == REC_CHARUCO && b->rows % 2 == 0)
        e = rec_print_init(&det->print[det->n_prints++], &other, d);
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

/* ---- the picture -------------------------------------------------------------------------------- */

static void read_levels(rec_board_detector *det, const struct rec_board_picture *p)
{
    float of_byte[256];
    for (int i = 0; i < 256; i++)
        of_byte[i] = (float)i / 255;
    for (int32_t v = 0; v < p->height; v++) {
        const char *row = (const char *)p->data + v * p->stride;
        float *to = det->level + (size_t)v * (size_t)p->width;
        for (int32_t u = 0; u < p->width; u++) {
            float x = p->is_float ? ((const float *)row)[u] : of_byte[((const uint8_t *)row)[u]];
            to[u] = x > 0 ? (x < 16 ? x : 16) : 0; /* NaN too */
        }
    }
    det->field = (struct rec_field){det->level, p->width, p->height};
}

/* The levels that leave 0.5 % of the pixels below and above, by a histogram of the square root: dim pictures
 * have fine bins. */
static void find_range(rec_board_detector *det)
{
    enum { BINS = 4096 };
    uint32_t h[BINS] = {0};
    size_t n = (size_t)det->field.width * (size_t)det->field.height, lo = 0, hi = 0, at;
    for (size_t i = 0; i < n; i++)
        h[(int)(sqrtf(det->level[i] / 16) * (BINS - 1))]++;
    for (at = 0; at < BINS - 1 && lo + h[at] <= n / 200; at++)
        lo += h[at];
    det->low = 16.0 * (double)(at * at) / ((BINS - 1.0) * (BINS - 1.0));
    for (at = BINS - 1; at > 0 && hi + h[at] <= n / 200; at--)
        hi += h[at];
    det->high = 16.0 * (double)((at + 1) * (at + 1)) / ((BINS - 1.0) * (BINS - 1.0));
}

/* 8 bits for OpenCV: full range, white on black turned round. */
static void make_grey(rec_board_detector *det)
{
    size_t n = (size_t)det->field.width * (size_t)det->field.height;
    bool inverted = det->print[0].board.inverted;
    float scale = (float)(255 / fmax(det->high - det->low, 1e-6)), low = (float)det->low;
    for (size_t i = 0; i < n; i++) {
        float x = (det->level[i] - low) * scale;
        x = x > 0 ? (x < 255 ? x : 255) : 0;
        det->grey[i] = (uint8_t)(inverted ? 255.5F - x : x + 0.5F);
    }
    for (size_t i = 0; inverted && i < n; i++)
        det->level[i] = -det->level[i];
}

static void flip(rec_board_detector *det)
{
    size_t w = (size_t)det->field.width;
    for (int32_t v = 0; v < det->field.height; v++) {
        float *f = det->level + (size_t)v * w;
        uint8_t *g = det->grey + (size_t)v * w;
        for (size_t u = 0; u < w / 2; u++) {
            float keep = f[u];
            uint8_t kept = g[u];
            f[u] = f[w - 1 - u];
            f[w - 1 - u] = keep;
            g[u] = g[w - 1 - u];
            g[w - 1 - u] = kept;
        }
    }
}

static void flip_corners(rec_board_detector *det, struct rec_board_sight *out)
{
    for (size_t i = 0; i < out->view.n; i++) {
        out->view.corner[i].x = det->field.width - 1 - out->view.corner[i].x;
        out->view.corner[i].cov[1] *= -1;
    }
}

/* ---- where to begin ----------------------------------------------------------------------------- */

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
        if (n == 0 && diagonal == 0 && !small_ones(det))
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

/* Three ways, the next where the last saw next to nothing: markers, the lattice of corners, markers in the
 * picture made larger and sharper.  The last two are dear: on the flipped picture only where the first saw
 * something like a lattice. */
static size_t from_any(rec_board_detector *det, bool flipped, struct rec_board_sight *out,
                       const struct rec_print **print)
{
    enum { ENOUGH = 3 }; /* markers */
    size_t seeds = from_markers(det, 1, out, print), more;
    bool april = (*print)->board.kind == REC_APRILGRID, again = small_ones(det);
    if (out->markers >= ENOUGH)
        return seeds;
    if (!april && (!flipped || det->n_nodes > 0) && (more = from_lattice(det, out, print)) > 0)
        return more;
    if (again && (april ? !flipped || (*print)->board.two_sided : det->n_nodes > 0))
        seeds = from_markers(det, 2, out, print);
    return seeds;
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

/* ---- one way round ------------------------------------------------------------------------------ */

static int ascending(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void describe(const struct rec_print *print, const struct rec_grown *g, size_t n,
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
        qsort(blur, k, sizeof *blur, ascending);
        out->blur = k > 0 ? blur[k / 2] : NAN;
        out->square = pairs > 0 ? side / (double)pairs : NAN;
    }
    free(blur);
}

/* Corners of the picture as it lies; their number. */
static size_t attempt(rec_board_detector *det, bool flipped, struct rec_board_sight *out)
{
    const struct rec_print *print = &det->print[0];
    bool chess = print->board.kind == REC_CHESSBOARD;
    size_t all = rec_board_corners(&print->board);
    size_t seeds = chess ? from_chessboard(det) : from_any(det, flipped, out, &print);
    if (seeds == 0)
        return 0;
    size_t found = rec_grow(&det->field, print, det->seed, seeds, det->pair, det->grown);
    if (found < FEWEST && found < all)
        return 0;
    size_t k = 0;
    for (size_t i = 0; i < all; i++) {
        double q[3];
        rec_board_point(&print->board, REC_FRONT, (uint32_t)i, q);
        if (det->grown[i].found)
            det->pair[k++] =
                (struct rec_pair){q[0], q[1], det->grown[i].fit.x, det->grown[i].fit.y, 1};
    }
    /* two false markers make a map too */
    if (rec_print_likeness(&det->field, print, det->high - det->low, det->pair, k) < ALIKE) {
        out->markers = 0;
        return 0;
    }
    describe(print, det->grown, all, found, out);
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
    double side = 0;
    for (size_t i = 0; i < det->n_markers; i++)
        side += rec_marker_side(&det->marker[i]) / (double)det->n_markers;
    if (b->kind == REC_CHESSBOARD || det->n_markers == 0)
        return false;
    if (out->markers * 10 < det->n_markers * 7 &&
        rec_match_other(&det->print[0], det->marker, det->n_markers, out->markers, &cols, &rows)) {
        out->outcome = REC_SIGHT_OTHER_BOARD;
        snprintf(out->text, sizeof out->text,
                 "markers fit %dx%d (or more rows), not %dx%d: give the board that was printed",
                 cols, rows, b->cols, b->rows);
    } else if (fabs(out->ratio - 1) > fmax(0.08, 2 / side)) {
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

pvx_err rec_board_detect(rec_board_detector *det, const struct rec_board_picture *p,
                         struct rec_board_sight *out)
{
    const struct rec_board *b = &det->print[0].board;
    *out = (struct rec_board_sight){.ratio = NAN, .square = NAN, .blur = NAN, .legacy = b->legacy};
    if (p->data == NULL || p->width < 1 || p->height < 1 || p->width > 1 << 16 ||
        p->height > 1 << 16)
        return PVX_EINVAL;
    PVX_TRY(room(det, (size_t)p->width * (size_t)p->height));
    read_levels(det, p);
    find_range(det);
    make_grey(det);
    struct rec_board_sight as_is = *out;
    det->n_nodes = det->n_markers = det->n_quads = 0;
    size_t found = p->width < 16 || p->height < 16 ? 0 : attempt(det, false, &as_is);
    if (contradicts(det, &as_is) || found > 0) {
        *out = as_is;
        return PVX_OK;
    }
    as_is.view.n = 0;
    if (b->kind == REC_CHESSBOARD) /* for what to say */
        PVX_TRY(
            rec_lattice_find(&det->field, det->high - det->low, false, det->node, &det->n_nodes));
    rec_sight_why(det, &as_is);
    if (b->kind != REC_CHESSBOARD && p->width >= 16 && p->height >= 16) {
        flip(det);
        found = attempt(det, true, out);
        if (contradicts(det, out))
            return PVX_OK;
        if (found > 0 && b->two_sided) {
            out->view.face = REC_BACK;
            flip_corners(det, out);
            return PVX_OK;
        }
        if (found > 0) {
            out->outcome = REC_SIGHT_MIRRORED;
            out->view.n = 0;
            snprintf(out->text, sizeof out->text,
                     "the board is mirrored: the camera's driver flips the picture, or the print "
                     "is a mirror image (the back of a two-sided board: say two-sided)");
            return PVX_OK;
        }
    }
    *out = as_is;
    return PVX_OK;
}
