/* lattice.h - corners of squares that join into a lattice, where markers are too small, too oblique or too
 * blurred for their outlines to be followed.
 *
 * Saddle points of the smoothed picture (-det of its Hessian, largest around) are where corners of squares
 * can be.  Two are neighbours when the line between them is an edge all along and changes its sides beyond
 * both ends.  From a strong saddle the lattice grows from neighbour to neighbour.
 *
 * Tilted about a diagonal, every other corner has its white sides squeezed between black ones and is no saddle
 * any more.  Then those of one kind are joined, opposite corners of squares, and the others put between. */
#ifndef REC_BOARD_LATTICE_H
#define REC_BOARD_LATTICE_H
#include <stddef.h>
#include "base/err.h"
#include "recon/board/corner.h"
#include "recon/board/homography.h"

#define REC_LATTICE_MAX 1024 /* nodes */

struct rec_node {
    int i,
        j; /* along the lattice: j is a quarter turn clockwise of i, as y down of x in a picture */
    double x, y; /* px */
};

/* The largest lattice that is found (diagonal: by opposite corners); its nodes, 0 where there are fewer than 6. */
PVX_MUST_CHECK pvx_err rec_lattice_find(const struct rec_field *f, double contrast, bool diagonal,
                                        struct rec_node node[REC_LATTICE_MAX], size_t *n);

/* Which corners of a charuco board they are: of all turns and places of the lattice on the board the one
 * where the squares' insides look most like the markers printed there (correlation of their bits).
 * id [n]: the corner, or -1 beyond the board.  The sum of the correlations; 0: none is clearly the best. */
double rec_lattice_read(const struct rec_field *f, const struct rec_print *p,
                        const struct rec_node *node, size_t n, int32_t *id);

/* Mean correlation of the bits of all markers whose corners around are known with what is seen there: near 1
 * where the board was taken for what it is, near 0 where not.  NAN: there is none. */
double rec_print_likeness(const struct rec_field *f, const struct rec_print *p, double contrast,
                          const struct rec_pair *corner, size_t n);
#endif
