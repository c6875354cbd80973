/* lattice.h - finds corners of squares that form a lattice, where markers are too small, too oblique or too blurred
 * for their outlines to be followed.
 *
 * Corners of squares are saddle points of the smoothed picture (local maxima of -det of its Hessian).  Two are
 * neighbours when the line between them is an edge all along, and the edge has swapped sides beyond both ends.  From
 * a strong saddle the lattice grows from neighbour to neighbour.
 *
 * When the board is tilted about a diagonal, the white sides of every other corner are squeezed between black
 * ones, and it is no longer a saddle.  Then the corners of one kind are joined, opposite corners of squares, and
 * the others are put between them. */
#ifndef REC_BOARD_LATTICE_H
#define REC_BOARD_LATTICE_H
#include <stddef.h>
#include "base/err.h"
#include "recon/board/corner.h"
#include "recon/board/homography.h"

#define REC_LATTICE_MAX 1024 /* nodes */

struct rec_node {
    int i,
        j; /* along the lattice: j is a quarter turn clockwise of i, as y (down) is of x in a picture */
    double x, y; /* px */
};

/* The largest lattice found (diagonal: by opposite corners).  *n: its nodes, 0 if there are fewer than 6. */
PVX_MUST_CHECK pvx_err rec_lattice_find(const struct rec_field *f, double contrast, bool diagonal,
                                        struct rec_node node[REC_LATTICE_MAX], size_t *n);

/* Finds which corners of a charuco board the nodes are.  Of all turns and places of the lattice on the board it takes
 * the one where the insides of the squares look most like the markers printed there (correlation of their bits).
 * id [n]: the corner, or -1 beyond the board.  Returns the sum of the correlations; 0: none is clearly the best. */
double rec_lattice_read(const struct rec_field *f, const struct rec_print *p,
                        const struct rec_node *node, size_t n, int32_t *id);

/* Mean correlation between the printed and the seen bits, over all markers with known corners around them: near 1
 * if the board was recognised correctly, near 0 if not.  NAN: there is no such marker. */
double rec_print_likeness(const struct rec_field *f, const struct rec_print *p, double contrast,
                          const struct rec_pair *corner, size_t n);
#endif
