/* still.h - whether the board stands still, whether its pose is new, and how poses join cameras.  `calibrate live`
 * decides by these, from corners alone.
 *
 * A view is the board in one picture.  n 0: it was not found there.  A list of views has one per camera.
 * Threads: pure. */
#ifndef CALIBRATE_STILL_H
#define CALIBRATE_STILL_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "recon/board/board.h"
#include "recon/geom/rig.h"

#define CALIBRATE_STILL_PX 0.5   /* a board that stands still moves less than this */
#define CALIBRATE_STILL_S  0.5   /* for at least this time, */
#define CALIBRATE_LOOKS    3     /* in at least so many pictures */
#define CALIBRATE_NEW      0.015 /* a smaller move is the same pose; of the picture's width */

/* How far the board moved: the median distance of the corners that both lists have in one camera and on one face.
 * The median is over all n cameras together, so one camera that sees the board badly does not decide.
 * scale[i] (NULL: 1) divides the distances of camera i.  INFINITY: fewer than 6 such corners. */
double calibrate_moved(const struct rec_board_view *a, const struct rec_board_view *b, size_t n,
                       const double *scale);

/* Two cameras and the number of poses that both saw.  `tree`: pairs of the maximum spanning tree.  These pairs must
 * hold. */
struct calibrate_pair {
    uint32_t a, b, common;
};
struct calibrate_graph {
    size_t n_tree, groups; /* groups of cameras that poses join; 1: all are joined */
    struct calibrate_pair tree[REC_MAX_CAMERAS]; /* the strongest first */
    uint32_t group[REC_MAX_CAMERAS];             /* of each camera; 0 is the largest */
};
/* common [n][n]: poses that two cameras saw together.  Of equal numbers the lower cameras come first. */
void calibrate_graph(const uint32_t *common, size_t n, struct calibrate_graph *g);

#endif
