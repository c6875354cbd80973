#include "recon/board/print.h"

#include <math.h>
#include <stdlib.h>

#include "base/mem.h"
#include "base/module.h"
#include "recon/board/spec.h"

pvx_err rec_cv_load(const struct rec_cv **out, struct pvx_diag *d)
{
    static struct pvx_module module = {
        .file = "pyrovox-aruco.so", .entry = "rec_cv_module", .version = REC_CV_VERSION};
    *out = pvx_module(&module);
    return *out != NULL ? PVX_OK
                        : pvx_fail(d, PVX_EUNSUP, "markers need OpenCV: %.500s", module.why);
}

/* Sets which squares have markers, and which marker each has. */
static void number_cells(struct rec_print *p)
{
    const struct rec_board *b = &p->board;
    int32_t id = 0;
    for (int32_t r = 0; r < b->rows; r++)
        for (int32_t c = 0; c < b->cols; c++) {
            int32_t cell = ((b->grid & REC_GRID_UP) != 0 ? b->rows - 1 - r : r) * b->cols + c;
            bool has = b->kind == REC_APRILGRID || (r + c) % 2 == (b->legacy ? 0 : 1);
            p->id_at[cell] = has ? id : -1;
            if (has)
                p->cell[id++] = cell;
        }
}

static pvx_err print_fetch(struct rec_print *p, struct pvx_diag *d)
{
    const struct rec_cv *cv;
    char err[128] = "";
    const struct rec_dictionary *dict = rec_dictionary_find(p->board.dictionary);
    if (dict == NULL)
        return pvx_fail(d, PVX_EINVAL, "no dictionary '%s'", p->board.dictionary);
    PVX_TRY(rec_cv_load(&cv, d));
    p->bits = dict->bits;
    p->n_markers = rec_board_markers(&p->board);
    p->bit = pvx_calloc((size_t)p->n_markers, (size_t)(p->bits * p->bits));
    p->cell = pvx_calloc((size_t)p->n_markers, sizeof *p->cell);
    p->id_at = pvx_calloc((size_t)(p->board.cols * p->board.rows), sizeof *p->id_at);
    if (p->bit == NULL || p->cell == NULL || p->id_at == NULL)
        return PVX_ENOMEM;
    for (int32_t i = 0; i < p->n_markers; i++)
        if (cv->bits(dict->index, i, p->bit + (size_t)(i * p->bits * p->bits), err, sizeof err) !=
            0)
            return pvx_fail(d, PVX_EUNSUP, "dictionary %s: %s", dict->name, err);
    size_t cells = (size_t)(p->bits * p->bits);
    for (size_t i = 0; (p->board.grid & REC_GRID_TURNED) != 0 && i < cells * (size_t)p->n_markers;
         i++) {
        size_t j = i - i % cells + (cells - 1 - i % cells);
        if (i < j) {
            uint8_t keep = p->bit[i];
            p->bit[i] = p->bit[j];
            p->bit[j] = keep;
        }
    }
    number_cells(p);
    return PVX_OK;
}

pvx_err rec_print_init(struct rec_print *p, const struct rec_board *b, struct pvx_diag *d)
{
    *p = (struct rec_print){.board = *b, .border = (b->grid & REC_GRID_WIDE) != 0 ? 2 : 1};
    if (b->kind == REC_APRILGRID) {
        p->x0 = p->y0 = -b->marker;
        p->x1 = b->cols * (b->square + b->marker);
        p->y1 = b->rows * (b->square + b->marker);
    } else { /* a chessboard's size counts inner corners, charuco's squares */
        int32_t less = b->kind == REC_CHARUCO ? 1 : 0;
        p->x0 = p->y0 = -b->square;
        p->x1 = (b->cols - less) * b->square;
        p->y1 = (b->rows - less) * b->square;
    }
    pvx_err e = b->kind == REC_CHESSBOARD ? PVX_OK : print_fetch(p, d);
    bool april = b->kind == REC_APRILGRID;
    p->pitch = april ? b->square + b->marker : b->square;
    p->in = april ? b->marker : (b->square - b->marker) / 2;
    if (e == PVX_OK && b->kind != REC_CHESSBOARD)
        p->module = (april ? b->square : b->marker) / (p->bits + 2 * p->border);
    p->per_pitch = 1 / p->pitch;
    p->per_module = p->module > 0 ? 1 / p->module : 0;
    if (e != PVX_OK)
        rec_print_fini(p);
    return e;
}

void rec_print_fini(struct rec_print *p)
{
    free(p->bit);
    free(p->cell);
    free(p->id_at);
    *p = (struct rec_print){0};
}

void rec_print_marker(const struct rec_print *p, int32_t id, double xy[4][2])
{
    const struct rec_board *b = &p->board;
    bool april = b->kind == REC_APRILGRID;
    double side = april ? b->square : b->marker;
    int32_t c = p->cell[id] % b->cols, r = p->cell[id] / b->cols;
    for (int k = 0; k < 4; k++) {
        xy[k][0] = p->x0 + c * p->pitch + p->in + (k == 1 || k == 2 ? side : 0);
        xy[k][1] = p->y0 + r * p->pitch + p->in + (k >= 2 ? side : 0);
    }
}

/* The place of a coordinate along an axis: the square (or the marker and the gap behind it) and the bit in it; bit
 * -1: before the marker; bits + 2 borders: behind it. */
struct slot {
    int32_t cell, bit;
    double end; /* begin of the next slot */
};

static struct slot print_slot_of(const struct rec_print *p, double v, double v0)
{
    enum { BELOW = 1024 }; /* squares before the first; from there a cast rounds like floor */
    double from = v - v0;
    struct slot s = {.cell = (int32_t)(fmin(fmax(from * p->per_pitch + BELOW, 0), 1e6)) - BELOW};
    double begin = v0 + s.cell * p->pitch, f = v - begin - p->in;
    int32_t all = p->bits + 2 * p->border;
    if (p->module == 0) {
        s.bit = -1;
        s.end = begin + p->pitch;
    } else if (f < 0) {
        s.bit = -1;
        s.end = begin + p->in;
    } else {
        s.bit = (int32_t)(f * p->per_module);
        s.bit = s.bit < all ? s.bit : all;
        s.end = s.bit == all ? begin + p->pitch : begin + p->in + (s.bit + 1) * p->module;
    }
    return s;
}

static double dark(const struct rec_print *p, const struct slot *x, const struct slot *y)
{
    const struct rec_board *b = &p->board;
    bool april = b->kind == REC_APRILGRID;
    int32_t more = b->kind == REC_CHESSBOARD ? 1 : 0; /* cols, rows: inner corners */
    int32_t w = p->border, end = p->bits + w;
    if (april && x->bit == -1 && y->bit == -1 && x->cell >= 0 && y->cell >= 0 &&
        x->cell <= b->cols && y->cell <= b->rows)
        return 1; /* a crossing of gaps */
    if (x->cell < 0 || y->cell < 0 || x->cell >= b->cols + more || y->cell >= b->rows + more)
        return 0;
    if (!april && (x->cell + y->cell) % 2 == (b->legacy ? 1 : 0))
        return 1;
    if (p->module == 0 || x->bit < 0 || y->bit < 0 || x->bit >= end + w || y->bit >= end + w)
        return 0;
    if (x->bit < w || y->bit < w || x->bit >= end || y->bit >= end)
        return 1;
    int32_t id = p->id_at[y->cell * b->cols + x->cell];
    return !p->bit[(id * p->bits + y->bit - w) * p->bits + x->bit - w];
}

double rec_print_ink(const struct rec_print *p, double x, double y, double hx, double hy)
{
    struct slot sx[2] = {print_slot_of(p, x - hx, p->x0)},
                sy[2] = {print_slot_of(p, y - hy, p->y0)};
    double wx = 1, wy = 1; /* share of the first slot */
    if (sx[0].end < x + hx) {
        wx = (sx[0].end - x + hx) / (2 * hx);
        sx[1] = print_slot_of(p, x + hx, p->x0);
    }
    if (sy[0].end < y + hy) {
        wy = (sy[0].end - y + hy) / (2 * hy);
        sy[1] = print_slot_of(p, y + hy, p->y0);
    }
    double sum = wx * wy * dark(p, &sx[0], &sy[0]);
    if (wx < 1)
        sum += (1 - wx) * wy * dark(p, &sx[1], &sy[0]);
    if (wy < 1)
        sum += wx * (1 - wy) * dark(p, &sx[0], &sy[1]);
    if (wx < 1 && wy < 1)
        sum += (1 - wx) * (1 - wy) * dark(p, &sx[1], &sy[1]);
    return sum;
}
