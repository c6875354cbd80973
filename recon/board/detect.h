/* detect.h - a board found in a picture.
 *
 * OpenCV finds markers (or a whole chessboard), match.h tells which of them lie as on the board, and from
 * there corner.h goes from corner to corner: each is looked for where the nearest known ones have it by a
 * local homography, so that a lens may bend the board and a marker need not be readable for the corners
 * around it to be found.  In the end every corner is laid on anew by its neighbours and kept when it looks
 * as printed and lies where they say.
 *
 * Deterministic: the same picture gives the same bits. */
#ifndef REC_BOARD_DETECT_H
#define REC_BOARD_DETECT_H
#include "base/err.h"
#include "recon/board/board.h"

enum rec_sight {
    REC_SIGHT_FOUND,
    REC_SIGHT_NO_MARKER, /* nothing that looks like the board */
    REC_SIGHT_DARK,      /* no contrast */
    REC_SIGHT_BLURRED,
    REC_SIGHT_SMALL,       /* markers or squares of too few pixels */
    REC_SIGHT_FEW,         /* fewer corners than a pose takes */
    REC_SIGHT_MIRRORED,    /* found on the flipped picture */
    REC_SIGHT_OTHER_BOARD, /* markers lie as on a board of another size */
    REC_SIGHT_OTHER_RATIO, /* markers of another size beside their squares */
    REC_N_SIGHTS
};

/* "found", "no marker", ... */
const char *rec_sight_name(enum rec_sight s);

struct rec_board_picture {
    const void *data; /* uint8_t, or float with 1 = full scale; grey */
    int32_t width, height;
    ptrdiff_t stride; /* bytes from row to row */
    bool is_float;
};

struct rec_board_sight {
    enum rec_sight outcome;
    char text[240]; /* why, and the remedy; "" when found */
    struct rec_board_view
        view;    /* n > 0 only when found; camera and frame 0; the detector's until its next call */
    bool legacy; /* the layout of charuco squares that fits */
    uint32_t markers; /* found that lie as on the board */
    double ratio;     /* of the markers' size to what the board says; NAN where unknown */
    double square;    /* px, mean side of a square */
    double blur;      /* px, of a Gaussian, median */
};

typedef struct rec_board_detector rec_board_detector;

/* b is copied.  PVX_EUNSUP: OpenCV's module cannot be loaded. */
PVX_MUST_CHECK pvx_err rec_board_detector_new(const struct rec_board *b, rec_board_detector **out,
                                              struct pvx_diag *d);
void rec_board_detector_free(rec_board_detector **det);

/* Errors are of memory and arguments only; what is not found is an outcome.  Pixels that are no numbers
 * count as black.  Of a two-sided board the face that is seen better.  Threads: a detector a thread.
 * Cost: see tests/bench. */
PVX_MUST_CHECK pvx_err rec_board_detect(rec_board_detector *det, const struct rec_board_picture *p,
                                        struct rec_board_sight *out);
#endif
