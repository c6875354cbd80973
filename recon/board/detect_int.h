/* detect_int.h - shared by detect.c, seeds.c, picture.c and why.c. */
#ifndef REC_BOARD_DETECT_INT_H
#define REC_BOARD_DETECT_INT_H
#include "recon/board/detect.h"
#include "recon/board/grow.h"
#include "recon/board/lattice.h"
#include "recon/board/match.h"

#define REC_DETECT_MARKERS 1024

/* Result of one search for markers at one scale. */
struct rec_looked {
    bool done, flipped; /* flipped: the picture was flipped then */
    size_t n;
    struct rec_cv_marker marker[REC_DETECT_MARKERS];
};

struct rec_board_detector {
    struct rec_print
        print[8]; /* [0]: of the board; then its other layouts: charuco of even rows, aprilgrid */
    int n_prints;
    const struct rec_cv *cv;
    /* the present picture, inverted if the board is, flipped when that is tried */
    float *level;
    uint8_t *grey; /* the same, stretched to 0..255 */
    size_t size;   /* pixels allocated */
    struct rec_field field;
    bool flipped;        /* the picture is flipped now */
    double low, high;    /* levels that all but 0.5 % lie between, or 30 times the noise */
    double range, noise; /* of full scale: between those levels; standard deviation */
    bool both; /* mirrored markers are distinguishable, so that one search finds both faces */
    /* in the picture made smaller, as it is, made larger; for markers with a border of 1 and 2 cells */
    struct rec_looked looked[3][2];
    struct rec_cv_marker marker[REC_DETECT_MARKERS]; /* of one face, the dictionary's first */
    size_t n_markers, n_quads;
    bool small;   /* there were quadrangles that may be markers too small to read */
    bool some[2]; /* markers that lie as on the board were seen, [0] unflipped, [1] flipped */
    bool agrees[REC_DETECT_MARKERS];
    struct rec_node node[REC_LATTICE_MAX];
    size_t n_nodes;
    bool nodes_flipped; /* the nodes are those of the flipped picture */
    int32_t id[REC_LATTICE_MAX];
    struct rec_pair *pair, *seed;
    struct rec_grown *grown;
    struct rec_board_corner *corner;
};

/* Ways to seeds, each costlier than the one before: markers in a large picture made smaller, if the result is
 * certain; markers in the picture as it is; the lattice of corners; markers in the picture made larger and
 * sharper; the one or two markers found at first. */
enum rec_way {
    REC_BY_SMALLER,
    REC_BY_MARKERS,
    REC_BY_LATTICE,
    REC_BY_LARGER,
    REC_BY_FEW_MARKERS,
    REC_N_WAYS
};

/* picture.c: loads a picture as the present one. */
PVX_MUST_CHECK pvx_err rec_board_read(rec_board_detector *det, const struct rec_board_picture *p);
/* Makes the present picture unflipped or flipped. */
void rec_board_turn(rec_board_detector *det, bool flipped);

/* Fills det->seed, in the picture flipped or not as given; the present picture may differ.  Returns their number.
 * *print: the layout that they fit.  Sets markers, legacy and ratio of out where they are known. */
size_t rec_board_seeds(rec_board_detector *det, enum rec_way way, bool flipped,
                       struct rec_board_sight *out, const struct rec_print **print);

/* Whether the lattice of nodes is a whole chessboard of another size, in inner corners, or would go on outside the
 * picture. */
enum rec_other_size { REC_SIZE_UNKNOWN, REC_SIZE_OTHER, REC_SIZE_CUT };
enum rec_other_size rec_board_other_size(rec_board_detector *det, int size[2]);

/* Nothing was found: the outcome and its text. */
void rec_sight_why(const rec_board_detector *det, struct rec_board_sight *out);
#endif
