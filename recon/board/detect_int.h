/* detect_int.h - what detect.c and why.c share. */
#ifndef REC_BOARD_DETECT_INT_H
#define REC_BOARD_DETECT_INT_H
#include "recon/board/detect.h"
#include "recon/board/grow.h"
#include "recon/board/lattice.h"
#include "recon/board/match.h"

#define REC_DETECT_MARKERS 1024

/* What was looked for at one scale. */
struct rec_looked {
    bool done, flipped; /* flipped: the picture was, then */
    size_t n;
    struct rec_cv_marker marker[REC_DETECT_MARKERS];
};

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
    bool flipped;        /* the picture is, now */
    double low, high;    /* levels that all but 0.5 % lie between, or 30 times the noise */
    double range, noise; /* of full scale: between those levels; standard deviation */
    bool both;           /* mirrored markers are told from others, so that one look finds both */
    struct rec_looked looked[3]; /* at the picture made smaller, as it is, larger */
    struct rec_cv_marker marker[REC_DETECT_MARKERS]; /* of one face, of the dictionary first */
    size_t n_markers, n_quads;
    bool small;   /* quadrangles were seen that may be markers too small to read */
    bool some[2]; /* markers that lie as on the board were seen, as it is and flipped */
    bool agrees[REC_DETECT_MARKERS];
    struct rec_node node[REC_LATTICE_MAX];
    size_t n_nodes;
    bool nodes_flipped; /* they are those of the picture flipped */
    int32_t id[REC_LATTICE_MAX];
    struct rec_pair *pair, *seed;
    struct rec_grown *grown;
    struct rec_board_corner *corner;
};

/* Ways to seeds, each dearer than the one before: markers in a large picture made smaller, if they leave no doubt;
 * markers as they are; the lattice of corners; markers in the picture made larger and sharper; the one or two
 * markers that there were at first. */
enum rec_way {
    REC_BY_SMALLER,
    REC_BY_MARKERS,
    REC_BY_LATTICE,
    REC_BY_LARGER,
    REC_BY_FEW_MARKERS,
    REC_N_WAYS
};

/* picture.c: the picture becomes the one at hand. */
PVX_MUST_CHECK pvx_err rec_board_read(rec_board_detector *det, const struct rec_board_picture *p);
/* It the right way round, or flipped. */
void rec_board_turn(rec_board_detector *det, bool flipped);

/* det->seed in the picture this way round, which it may not be yet; how many.  *print: the layout that they fit.  Sets markers, legacy and ratio
 * of out where they are known. */
size_t rec_board_seeds(rec_board_detector *det, enum rec_way way, bool flipped,
                       struct rec_board_sight *out, const struct rec_print **print);

/* Nothing was found: the outcome and its text. */
void rec_sight_why(const rec_board_detector *det, struct rec_board_sight *out);
#endif
