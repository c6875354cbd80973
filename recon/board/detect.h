/* detect.h - finds a board in a picture.
 *
 * OpenCV finds markers (or a whole chessboard), and match.h finds which of them lie as on the board.  From there
 * corner.h goes from corner to corner.  Each corner is searched where a local homography of the nearest known corners
 * predicts it.  So a lens may bend the board, and the corners around an unreadable marker are still found.  At the
 * end every corner is fitted again from its neighbours.  It is kept if it looks as printed and lies where they
 * predict it.
 *
 * Deterministic: the same picture gives the same bits. */
#ifndef REC_BOARD_DETECT_H
#define REC_BOARD_DETECT_H
#include "base/err.h"
#include "recon/board/board.h"

enum rec_sight {
    REC_SIGHT_FOUND,
    REC_SIGHT_NO_MARKER, /* nothing looks like the board */
    REC_SIGHT_DARK,      /* no contrast */
    REC_SIGHT_BLURRED,
    REC_SIGHT_SMALL,       /* markers or squares of too few pixels */
    REC_SIGHT_FEW,         /* fewer corners than a pose needs */
    REC_SIGHT_MIRRORED,    /* found in the flipped picture */
    REC_SIGHT_OTHER_BOARD, /* markers lie as on a board of another size */
    REC_SIGHT_OTHER_RATIO, /* another ratio of markers to squares */
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
    char text[240]; /* the reason and the remedy; "" when found */
    struct rec_board_view
        view;    /* n > 0 only when found; camera and frame 0; the detector's until its next call */
    bool legacy; /* the layout of charuco squares that fits */
    uint8_t grid;     /* the layout of the aprilgrid that fits */
    uint32_t markers; /* markers found that lie as on the board */
    double ratio;     /* of the markers' size to that in the board's spec; NAN where unknown */
    double square;    /* px, mean side of a square */
    double blur;      /* px, of a Gaussian, median */
};

typedef struct rec_board_detector rec_board_detector;

/* b is copied.  PVX_EUNSUP: OpenCV's module cannot be loaded. */
PVX_MUST_CHECK pvx_err rec_board_detector_new(const struct rec_board *b, rec_board_detector **out,
                                              struct pvx_diag *d);
void rec_board_detector_free(rec_board_detector **det);

/* Errors are of memory and arguments only; a board that is not found is an outcome.  NaN pixels count as black.  A
 * two-sided board gives the face that is seen better.  Threads: one detector per thread.
 * Cost: see tests/bench. */
PVX_MUST_CHECK pvx_err rec_board_detect(rec_board_detector *det, const struct rec_board_picture *p,
                                        struct rec_board_sight *out);
#endif
