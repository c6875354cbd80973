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
    bool small;   /* quadrangles were seen that may be markers too small to read */
    bool some[2]; /* markers that lie as on the board were seen, as it is and flipped */
    bool agrees[REC_DETECT_MARKERS];
    struct rec_node node[REC_LATTICE_MAX];
    size_t n_nodes;
    int32_t id[REC_LATTICE_MAX];
    struct rec_pair *pair, *seed;
    struct rec_grown *grown;
    struct rec_board_corner *corner;
};

/* Ways to seeds, each dearer than the one before: markers as they are; the lattice of corners; markers in the
 * picture made larger and sharper; the one or two markers that there were at first. */
enum rec_way { REC_BY_MARKERS, REC_BY_LATTICE, REC_BY_LARGER, REC_BY_FEW_MARKERS, REC_N_WAYS };

/* det->seed from the picture at hand; how many.  *print: the layout that they fit.  Sets markers, legacy and ratio
 * of out where they are known. */
size_t rec_board_seeds(rec_board_detector *det, enum rec_way way, bool flipped,
                       struct rec_board_sight *out, const struct rec_print **print);

/* Nothing was found: the outcome and its text. */
void rec_sight_why(const rec_board_detector *det, struct rec_board_sight *out);
#endif
