/* detect_int.h - what detect.c and why.c share. */
#ifndef REC_BOARD_DETECT_INT_H
#define REC_BOARD_DETECT_INT_H
#include "recon/board/detect.h"
#include "recon/board/grow.h"
#include "recon/board/lattice.h"
#include "recon/board/match.h"

#define REC_DETECT_MARKERS 1024

struct rec_board_detector {
    struct rec_print
        print[2]; /* as the board says; charuco of even rows: then in the other layout */
    int n_prints;
    const struct rec_cv *cv;
    /* the picture at hand, inverted where the board is, flipped when that is tried */
    float *level;
    uint8_t *grey; /* the same, stretched to 0..255 */
    size_t size;   /* pixels that there is room for */
    struct rec_field field;
    double low, high;                                /* levels that all but 0.5 % lie between */
    struct rec_cv_marker marker[REC_DETECT_MARKERS]; /* of the dictionary first */
    size_t n_markers, n_quads;
    bool agrees[REC_DETECT_MARKERS];
    struct rec_node node[REC_LATTICE_MAX];
    size_t n_nodes;
    int32_t id[REC_LATTICE_MAX];
    struct rec_pair *pair, *seed;
    struct rec_grown *grown;
    struct rec_board_corner *corner;
};

/* Nothing was found: the outcome and its text. */
void rec_sight_why(const rec_board_detector *det, struct rec_board_sight *out);
#endif
