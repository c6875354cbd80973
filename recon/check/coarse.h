/* coarse.h - cheap volumes of a coarse grid, from any cameras and pictures: what trials.h judges hypotheses with.
 *
 * Pictures are means over blocks, REC_COARSE_SIDE along the longer side.  A voxel is a tent in the picture, as wide as
 * its distance to the next voxel, with the light of (h^3 f^2 / z^2).  Only voxels that may hold flame have values: all
 * cameras that see one show flame there or beside it, but for one (six cameras or more: two), and `least` of them do.
 *     x <- max(0, x + r A_c' (b_c - A_c x) / rows / columns)      camera after camera, REC_COARSE_SWEEPS times   (1)
 * Source: SART, Andersen & Kak, Ultrasonic Imaging 6:81, 1984.  Tents are not the flame: a right rig leaves 1 to 3 % of
 * the squares.  The error is alike for all hypotheses.
 *     e_c = 1 - <b_c, p_c>^2 / (|b_c|^2 |p_c|^2),   p_c = A_c x                                       (2)
 * is the share that no gain explains.
 * Threads: pure but for the work area. */
#ifndef REC_COARSE_H
#define REC_COARSE_H
#include <stdatomic.h>

#include "base/err.h"
#include "recon/geom/rig.h"

#define REC_COARSE_SIDE   64
#define REC_COARSE_BLOCKS (REC_COARSE_SIDE * REC_COARSE_SIDE)
#define REC_COARSE_VOXELS 24 /* along the volume's longest side */
#define REC_COARSE_SWEEPS 6

/* A picture in blocks: the mean of the lit light of those bins that have a value. */
struct rec_blocks {
    int32_t w, h;
    bool some; /* any light */
    float b[REC_COARSE_BLOCKS];
    uint8_t near[REC_COARSE_BLOCKS];  /* lit, without a value, or beside such a block */
    uint8_t there[REC_COARSE_BLOCKS]; /* has a value */
};
/* Pixels along a block of this camera. */
int32_t rec_blocks_side(const struct rec_camera *c, int32_t binning);
/* Finds `near` and `some` from b and there: block 1 of lit is lit. */
void rec_blocks_finish(struct rec_blocks *k, const uint8_t *lit);

/* Where the voxels of a camera are in its picture. */
struct rec_places;

typedef struct rec_coarse rec_coarse;
/* For n cameras, of which `least` show flame at a voxel that has a value.  Errors: PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_coarse_new(const struct rec_grid *box, size_t n, int least,
                                      rec_coarse **out);
void rec_coarse_free(rec_coarse **k);
/* While *stop is true, solves end at once and leave no volume.  NULL: never. */
void rec_coarse_stop(rec_coarse *k, const atomic_bool *stop);
/* Room for the places of a camera.  Owner: caller, free().  NULL: no memory. */
struct rec_places *rec_places_new(const rec_coarse *k);

enum { REC_TURN_ACROSS = 1, REC_TURN_UPSIDE = 2 };
/* Places of a camera whose picture is turned, in blocks of `side` pixels.  held: only of voxels that the last solve
 * gave values. */
void rec_places_find(const rec_coarse *k, const struct rec_camera *c, int32_t side, unsigned turned,
                     bool held, struct rec_places *out);

/* What is believed: the places of each camera and the picture that it has; picture NULL: not used. */
struct rec_belief {
    const struct rec_places *at[REC_MAX_CAMERAS];
    const struct rec_blocks *picture[REC_MAX_CAMERAS];
};
/* Solves (1) from all cameras with a picture.  Returns the share of their light that the voxels can explain. */
double rec_coarse_solve(rec_coarse *k, const struct rec_belief *w);
/* (2) of that volume, seen by a camera with these places, against this picture; *gain: |b| / |p|, or NULL.  1: it sees
 * nothing of it. */
double rec_coarse_miss(rec_coarse *k, const struct rec_places *at, const struct rec_blocks *b,
                       double *gain);
/* The picture p_c of that volume, as large as b; valid until the next call. */
const float *rec_coarse_show(rec_coarse *k, const struct rec_places *at,
                             const struct rec_blocks *b);
/* The box around the voxels with light, but for a share of it at each side. */
void rec_coarse_extent(const rec_coarse *k, double share, double min[3], double max[3]);

#endif
