/* shared.h - what host and kernels both know.  OpenCL C reads it too, so it has no includes: an int and a float have 32
 * bits in both, and no member needs padding. */
#ifndef REC_CL_SHARED_H
#define REC_CL_SHARED_H

#define REC_CL_TILE    8    /* bins along a tile of a picture */
#define REC_CL_NOWHERE (-1) /* first row of a window that does not exist */
#define REC_CL_UNIT    8 /* a pair's entries begin at a multiple of so many (matrix.h: pair_at) */

struct rec_cl_camera {
    int row0, bw, bh;
    int tiles, tile0; /* tiles in a row of tiles; number of its first one */
};
/* A level of S. */
struct rec_cl_geometry {
    int n[3], bricks[3]; /* voxels and bricks of 4^3 voxels along the axes */
    int voxels, all_bricks, all_tiles;
    int cameras, wide, high; /* of a window */
    int rows, room;          /* bins of all pictures; of a vector over them */
    float unit;
    struct rec_cl_camera camera[64];
};
/* A further window of a brick's voxel. */
struct rec_cl_more {
    int voxel, camera;   /* 0..63 in the brick */
    int at;              /* its first row */
    unsigned char w[16]; /* [high*wide], then 0 */
};
/* smooth.h: a_i of (1); by the neighbours that there are, the factor of x_q and the diagonal of L L. */
struct rec_cl_smooth {
    float axis[3], centre[64], diag2[64];
};
/* card.h: struct rec_card_shot. */
struct rec_cl_shot {
    int dx, dy;
    float gain, w[16];
    int moved;
};
/* A level in the work areas of the carving (hull.h): its rows of voxels and its bricks among those of all levels. */
struct rec_cl_place {
    int n[3], bricks[3];
    unsigned int row, rows, brick, all_bricks;
};
/* A range of words of a scan (scan.cl): words [at, at + n), and the groups that have a piece of it each. */
struct rec_cl_range {
    unsigned int at, n, group, groups;
};

#endif
