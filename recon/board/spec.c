#include "recon/board/spec.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* In the order of OpenCV's PREDEFINED_DICTIONARY_NAME. */
static const struct rec_dictionary dictionaries[] = {
    {"4X4_50", 0, 4, 50},
    {"4X4_100", 1, 4, 100},
    {"4X4_250", 2, 4, 250},
    {"4X4_1000", 3, 4, 1000},
    {"5X5_50", 4, 5, 50},
    {"5X5_100", 5, 5, 100},
    {"5X5_250", 6, 5, 250},
    {"5X5_1000", 7, 5, 1000},
    {"6X6_50", 8, 6, 50},
    {"6X6_100", 9, 6, 100},
    {"6X6_250", 10, 6, 250},
    {"6X6_1000", 11, 6, 1000},
    {"7X7_50", 12, 7, 50},
    {"7X7_100", 13, 7, 100},
    {"7X7_250", 14, 7, 250},
    {"7X7_1000", 15, 7, 1000},
    {"ARUCO_ORIGINAL", 16, 5, 1024},
    {"16h5", 17, 4, 30},
    {"25h9", 18, 5, 35},
    {"36h10", 19, 6, 2320},
    {"36h11", 20, 6, 587},
};
#define N_DICTIONARIES (sizeof dictionaries / sizeof *dictionaries)

static const char *const kinds[] = {"charuco", "chessboard", "aprilgrid"};
#define SHAPES                                                                        \
    "charuco:8x11:0.03:0.022 (squares, square, marker), chessboard:9x6:0.025 (inner " \
    "corners, square) or aprilgrid:6x6:0.03:0.009 (markers, marker, gap)"

const struct rec_dictionary *rec_dictionary_find(const char *name)
{
    for (size_t i = 0; i < N_DICTIONARIES; i++)
        if (strcmp(dictionaries[i].name, name) == 0)
            return &dictionaries[i];
    return NULL;
}

bool rec_dictionary_two_sided(const struct rec_dictionary *dict)
{
    return dict->bits > 4 && dict->index != 16;
}

int32_t rec_board_markers(const struct rec_board *b)
{
    if (b->kind == REC_CHESSBOARD)
        return 0;
    if (b->kind == REC_APRILGRID)
        return b->cols * b->rows;
    /* the first square is black unless the layout is the old one of even rows */
    return (b->cols * b->rows + (b->legacy ? 1 : 0)) / 2;
}

bool rec_board_symmetric(const struct rec_board *b)
{
    return b->kind == REC_CHESSBOARD && (b->cols + b->rows) % 2 == 0;
}

uint32_t rec_board_corners(const struct rec_board *b)
{
    switch (b->kind) {
    case REC_CHARUCO: return (uint32_t)((b->cols - 1) * (b->rows - 1));
    case REC_CHESSBOARD: return (uint32_t)(b->cols * b->rows);
    default: return (uint32_t)(4 * b->cols * b->rows);
    }
}

void rec_board_point(const struct rec_board *b, enum rec_board_face face, uint32_t id,
                     double xyz[3])
{
    uint32_t across = (uint32_t)(b->kind == REC_CHARUCO      ? b->cols - 1
                                 : b->kind == REC_CHESSBOARD ? b->cols
                                                             : 2 * b->cols);
    uint32_t i[2] = {id % across, id / across};
    for (int a = 0; a < 2; a++)
        xyz[a] = b->kind == REC_APRILGRID
                     ? i[a] / 2 * (b->square + b->marker) + i[a] % 2 * b->square
                     : i[a] * b->square;
    xyz[2] = face == REC_BACK && !isnan(b->thickness) ? b->thickness : 0;
}

/* The next field of *rest, up to a colon; false at the end. */
static bool next_field(const char **rest, char *field, size_t size)
{
    if (**rest == '\0')
        return false;
    size_t n = strcspn(*rest, ":");
    snprintf(field, size, "%.*s", (int)(n < size ? n : size - 1), *rest);
    *rest += n + ((*rest)[n] == ':');
    return true;
}

static bool read_length(const char *text, double *out)
{
    char *end;
    if (*text == '\0' || strchr("0123456789.", *text) == NULL || strpbrk(text, "xX") != NULL)
        return false; /* strtod also reads nan, inf and hexadecimal */
    double v = strtod(text, &end);
    if (strcmp(end, "mm") == 0)
        v /= 1000;
    else if (*end != '\0')
        return false;
    *out = v;
    return isfinite(v);
}

static pvx_err length(const char **rest, const char *what, const char *whole, double *out,
                      struct pvx_diag *d)
{
    char f[32];
    if (!next_field(rest, f, sizeof f))
        return pvx_fail(d, PVX_EFORMAT, "board '%s': %s is missing; boards are " SHAPES, whole,
                        what);
    if (!read_length(f, out))
        return pvx_fail(d, PVX_EFORMAT,
                        "board '%s': %s '%s' is no length; write metres, as 0.03, or 30mm", whole,
                        what, f);
    if (!(*out >= 0.0005 && *out <= 10))
        return pvx_fail(d, PVX_ERANGE,
                        "board '%s': %s of %g m is not within 0.5 mm and 10 m; write metres, as "
                        "0.03, or 30mm",
                        whole, what, *out);
    return PVX_OK;
}

static pvx_err spec_size(const char **rest, const char *whole, struct rec_board *b,
                         struct pvx_diag *d)
{
    char f[32] = "";
    int end = -1;
    int lo = b->kind == REC_APRILGRID ? 1 : 3;
    next_field(rest, f, sizeof f);
    if (strspn(f, "0123456789x") != strlen(f) || strlen(f) > 9 ||
        sscanf(f, "%dx%d%n", &b->cols, &b->rows, &end) != 2 || f[end] != '\0')
        return pvx_fail(d, PVX_EFORMAT, "board '%s': '%s' is no size; write across x down, as 8x11",
                        whole, f);
    if (b->cols < lo || b->rows < lo || b->cols > REC_BOARD_MAX || b->rows > REC_BOARD_MAX)
        return pvx_fail(d, PVX_ERANGE, "board '%s': a %s has %d to %d across and down, not %s",
                        whole, kinds[b->kind], lo, REC_BOARD_MAX, f);
    return PVX_OK;
}

static pvx_err spec_option(const char *f, const char *whole, struct rec_board *b,
                           struct pvx_diag *d)
{
    const char *name = strncmp(f, "DICT_APRILTAG_", 14) == 0 ? f + 14
                       : strncmp(f, "DICT_", 5) == 0         ? f + 5
                                                             : f;
    const struct rec_dictionary *dict = rec_dictionary_find(name);
    if (dict != NULL && b->kind != REC_CHESSBOARD) {
        snprintf(b->dictionary, sizeof b->dictionary, "%s", dict->name);
    } else if (strcmp(f, "two-sided") == 0) {
        b->two_sided = true;
    } else if (strcmp(f, "inverted") == 0) {
        b->inverted = true;
    } else if (strcmp(f, "legacy") == 0) {
        b->legacy = true;
    } else if (strcmp(f, "kalibr") == 0) {
        b->grid = REC_GRID_KALIBR;
    } else if (strncmp(f, "thickness=", 10) == 0) {
        b->two_sided = true;
        if (!read_length(f + 10, &b->thickness) || b->thickness < 0 || b->thickness > 0.5)
            return pvx_fail(d, PVX_ERANGE,
                            "board '%s': thickness '%s' is no length of 0 to 0.5 m; write metres, "
                            "as thickness=0.003",
                            whole, f + 10);
    } else {
        return pvx_fail(d, PVX_EFORMAT,
                        "board '%s': '%s' is neither a dictionary for this kind (4X4_50 to "
                        "7X7_1000, 16h5 to 36h11) nor two-sided, thickness=M, inverted, legacy or "
                        "kalibr",
                        whole, f);
    }
    return PVX_OK;
}

/* Gives defaults to what is left out, and refuses what does not go together. */
static pvx_err spec_complete(const char *whole, struct rec_board *b, struct pvx_diag *d)
{
    if (b->legacy && (b->kind != REC_CHARUCO || b->rows % 2 != 0))
        return pvx_fail(d, PVX_EUNSUP,
                        "board '%s': legacy is a layout of charuco boards with an even number of "
                        "rows; leave it out",
                        whole);
    if (b->grid != 0 && b->kind != REC_APRILGRID)
        return pvx_fail(d, PVX_EUNSUP,
                        "board '%s': kalibr is a layout of an aprilgrid; leave it out", whole);
    if (b->kind == REC_CHARUCO && !(b->marker >= 0.2 * b->square && b->marker <= 0.95 * b->square))
        return pvx_fail(d, PVX_ERANGE,
                        "board '%s': the marker must be 0.2 to 0.95 of the square; the order is "
                        "square, marker",
                        whole);
    if (b->kind == REC_APRILGRID && !(b->marker >= 0.05 * b->square && b->marker <= b->square))
        return pvx_fail(d, PVX_ERANGE,
                        "board '%s': the gap must be 0.05 to 1 of the marker; the order is marker, "
                        "gap",
                        whole);
    if (!b->two_sided)
        b->thickness = 0;
    if (b->kind == REC_CHESSBOARD)
        return b->two_sided ? pvx_fail(d, PVX_EUNSUP,
                                       "board '%s': nothing tells the back of a chessboard from "
                                       "its front; a two-sided board needs markers (charuco)",
                                       whole)
                            : PVX_OK;
    int32_t need = rec_board_markers(b);
    const char *name = b->kind == REC_APRILGRID ? "36h11"
                       : need <= 100            ? "5X5_100"
                       : need <= 250            ? "5X5_250"
                                                : "5X5_1000";
    if (b->dictionary[0] == '\0')
        snprintf(b->dictionary, sizeof b->dictionary, "%s", name);
    const struct rec_dictionary *dict = rec_dictionary_find(b->dictionary);
    if (dict == NULL || need > dict->count)
        return pvx_fail(d, PVX_ERANGE,
                        "board '%s': it has %d markers, dictionary %s only %d; take a larger "
                        "dictionary or a smaller board",
                        whole, need, b->dictionary, dict != NULL ? dict->count : 0);
    if (b->two_sided && !rec_dictionary_two_sided(dict))
        return pvx_fail(d, PVX_EUNSUP,
                        "board '%s': markers of %s seen mirrored are taken for others, so that the "
                        "faces of a two-sided board are mixed up; take 5X5_100, 6X6 or 36h11",
                        whole, b->dictionary);
    return PVX_OK;
}

static pvx_err spec_parse(const char *text, struct rec_board *b, struct pvx_diag *d)
{
    char f[64] = "";
    const char *rest = text;
    if (strlen(text) >= REC_BOARD_TEXT || strpbrk(text, "\n\r\x1b") != NULL)
        return pvx_fail(d, PVX_EFORMAT, "a board is one line of less than %d characters: " SHAPES,
                        REC_BOARD_TEXT);
    next_field(&rest, f, sizeof f);
    int k = 0;
    while (k < 3 && strcmp(f, kinds[k]) != 0)
        k++;
    if (k == 3)
        return pvx_fail(d, PVX_EFORMAT, "board '%s': no kind '%s'; boards are " SHAPES, text, f);
    b->kind = (enum rec_board_kind)k;
    b->thickness = NAN;
    PVX_TRY(spec_size(&rest, text, b, d));
    PVX_TRY(length(&rest, k == REC_APRILGRID ? "side of a marker" : "side of a square", text,
                   &b->square, d));
    if (k != REC_CHESSBOARD)
        PVX_TRY(
            length(&rest, k == REC_APRILGRID ? "gap" : "side of a marker", text, &b->marker, d));
    while (next_field(&rest, f, sizeof f))
        PVX_TRY(spec_option(f, text, b, d));
    return spec_complete(text, b, d);
}

pvx_err rec_board_parse(const char *text, struct rec_board *b, struct pvx_diag *d)
{
    *b = (struct rec_board){0};
    pvx_err e = spec_parse(text, b, d);
    if (e != PVX_OK)
        *b = (struct rec_board){0};
    return e;
}

void rec_board_text(const struct rec_board *b, char text[REC_BOARD_TEXT])
{
    char marker[40] = "", thickness[48] = "";
    if (b->kind != REC_CHESSBOARD)
        snprintf(marker, sizeof marker, ":%.15g:", b->marker);
    if (b->two_sided && !isnan(b->thickness))
        snprintf(thickness, sizeof thickness, ":thickness=%.15g", b->thickness);
    else if (b->two_sided)
        snprintf(thickness, sizeof thickness, ":two-sided");
    snprintf(text, REC_BOARD_TEXT, "%s:%dx%d:%.15g%s%s%s%s%s%s", kinds[b->kind], b->cols, b->rows,
             b->square, marker, b->dictionary, thickness, b->inverted ? ":inverted" : "",
             b->legacy ? ":legacy" : "", b->grid == REC_GRID_KALIBR ? ":kalibr" : "");
}
