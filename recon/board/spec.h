/* spec.h - a board in one line of text, as in options and rig.yaml.
 *
 *     charuco:8x11:0.03:0.022[:5X5_100]     squares across x down : side of a square : side of a marker
 *     chessboard:9x6:0.025                  inner corners across x down : side of a square
 *     aprilgrid:6x6:0.03:0.009[:36h11]      markers across x down : side of a marker : gap between them
 *
 * Lengths are metres, or millimetres with "mm" behind ("30mm").  Optional fields, in any order, each after a
 * colon: a dictionary of OpenCV ("5X5_100", "DICT_5X5_100", "36h11"), "two-sided", "thickness=0.003" (implies
 * two-sided), "inverted", "legacy" (charuco of even rows as OpenCV before 4.6 drew it), "kalibr" (aprilgrid as Kalibr's
 * kalibr_create_target_pdf draws it: tagCols x tagRows, tagSize, tagSize * tagSpacing). */
#ifndef REC_BOARD_SPEC_H
#define REC_BOARD_SPEC_H
#include "base/err.h"
#include "recon/board/board.h"

#define REC_BOARD_TEXT 160 /* room for any board's text */
#define REC_BOARD_MAX  64  /* squares or markers along a side */

/* OpenCV's predefined dictionaries; `index` is its number there. */
struct rec_dictionary {
    const char *name;
    int index, bits, count; /* bits x bits inside the black border; markers */
};
/* By name, NULL when there is none. */
const struct rec_dictionary *rec_dictionary_find(const char *name);
/* None of its markers looks like another one when seen mirrored. */
bool rec_dictionary_two_sided(const struct rec_dictionary *dict);

/* Errors: PVX_EFORMAT, PVX_ERANGE, PVX_EUNSUP with the remedy in d.  *b is whole or zeroed. */
PVX_MUST_CHECK pvx_err rec_board_parse(const char *text, struct rec_board *b, struct pvx_diag *d);

/* The text that gives this board: rec_board_parse(rec_board_text(b)) equals b. */
void rec_board_text(const struct rec_board *b, char text[REC_BOARD_TEXT]);

/* Markers on a face; 0 for a chessboard. */
int32_t rec_board_markers(const struct rec_board *b);

/* A chessboard that looks the same after half a turn: no picture shows its origin, so several cameras cannot share
 * it. */
bool rec_board_symmetric(const struct rec_board *b);
#endif
