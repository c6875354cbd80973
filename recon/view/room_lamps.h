/* room_lamps.h - light of a volume on a surface: every voxel is a lamp.
 *
 *     E(p) = sum_v e_v dV max(0, n.(x_v - p)) / max(|x_v - p|, R)^3 x visibility of x_v          (1)
 *
 * e_v emission per metre (radiance a metre adds), dV volume of a voxel, R radius of a ball with that volume.  Source:
 * irradiance of an optically thin source, dE = e dV cos / d^2.  A voxel counts as such a ball.  From outside its
 * light is that of a point at its middle; inside it is linear, since the integral of d / |d|^3 over a ball is that of
 * gravity (Newton, Principia, book I, propositions 71 and 73).  So (1) is finite everywhere.  A voxel sends out 4 pi
 * e dV in all.
 *
 * Lamps are the leaves of a tree of balls.  A ball (c, r) that is above p's horizon, in no shadow and at D = |c - p|
 * with r <= theta D counts by its two first moments about c,
 *     w = sum e, m = sum e (x - c):   n . [ w D + m - 3 D (D.m) / |D|^2 ] / |D|^3,  D = c - p    (2)
 * (J. Barnes and P. Hut, Nature 324:446-449, 1986, with the second moment.)  Any other ball is opened, down to the
 * lamps.  So shadows and horizon are those of (1) for every voxel.  By Taylor's remainder, with the third derivative
 * of 1/d at most 6/d^4, the error of (2) is at most
 *     3 theta^2 / (1 - theta)^4  x  sum e dV / |D|^2                                             (3)
 * The sum is in the tree's order: same bits for any number of threads.
 * Private to the room's files and its tests. */
#ifndef REC_ROOM_LAMPS_H
#define REC_ROOM_LAMPS_H
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"
#include "recon/geom/grid.h"
#include "recon/view/room_scene.h"

#define ROOM_THETA 0.1

struct room_lamp {
    double x[3];
    float e[3];
};

struct room_node {
    double c[3], r, w[3], m[3][3];
    size_t first, n; /* its lamps */
    size_t right;    /* its second child; the first is the next node; 0: has none */
};

struct room_lamps {
    struct room_lamp *lamp;
    struct room_node *node;
    size_t n, n_nodes, room; /* room: for nodes */
    int nch;
    double volume, ball; /* dV, R */
};

/* Voxels of dense [nz][ny][nx][nch] with light in them that are in the room and in no body; negative and
 * non-finite values are dark.  PVX_ENOMEM.  Owner: caller, room_lamps_fini (0 bytes are fine). */
PVX_MUST_CHECK pvx_err room_lamps_init(struct room_lamps *l, const struct room_scene *s,
                                       const struct rec_grid *g, const float *dense, int nch);
void room_lamps_fini(struct room_lamps *l);

/* (1) at p, unit normal n, on a face of `body` (-1: of none), by (2).  out [3], unused channels 0. */
void room_lamps_shine(const struct room_lamps *l, const struct room_scene *s, const double p[3],
                      const double n[3], int body, double out[3]);

#endif
