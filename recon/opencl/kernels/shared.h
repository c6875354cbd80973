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

/* ---- photometry (photo.cl) ---- */

/* A camera's picture, as far as it is known before its noise is. */
struct rec_cl_picture {
    int row0, bw, bh;
    int band0, bands;  /* number of its first band of rows, and how many there are */
    int absent;        /* 1: no picture */
    int mosaic;        /* 1: cell holds */
    int cell[4];       /* colours of the 2x2 bins that repeat */
    int background;    /* 1: it has one */
    int step;          /* of the grain (photo_mosaic.h) */
    int across, every; /* of blocks (photo_pass.h), and how many are measured */
    int blocks;
    float full, black, scale[4]; /* (1) of photo.h */
    float level[4];              /* of b, at which samples are clipped (clipped.h) */
};
/* A band's part of its picture's sums (struct rec_photo_band), and the least value above `level`. */
struct rec_cl_picture_band {
    float low[4], above[4];
    double sum[4];
    int hits, saturated, not_finite, lit;
    int peak, none; /* none: makes the size a multiple of a double's */
};
/* A block (struct rec_photo_block). */
struct rec_cl_picture_block {
    float mean[4], noise2[4], low[4], at_low[4];
    int measured;
};
/* What the noise decides. */
struct rec_cl_picture_limits {
    double level[4], sigma[4], t[4], slope[4], dark[4], cut[4]; /* struct rec_clipped */
    int is_clipped[4];
    float limit[4];               /* of a bin */
    float near[4], near_cap[4];   /* of the sum of 3x3 bins; of a bin in it */
    float wide[4], wide_cap[4];   /* of 7x7 bins */
    float noise[4];               /* sigma of the picture */
    int means, despeckle, margin; /* margin in bins */
    int clipped;                  /* 1: any channel is */
};

#define REC_CL_NO_MAP 0xFFFFFFFFu

/* A camera's raw picture (raw.h). */
struct rec_cl_raw_picture {
    unsigned int at, stride; /* bytes: where it begins, from row to row */
    int layout, depth;
    int width, height, binning;
    int samples, grey, swapped, rays;
    int bayer;   /* 1: cell holds */
    int cell[4]; /* colours of the 2x2 pixels that repeat */
    unsigned int clip;
    float full, most, unit;
    /* Where they begin among the words of all cameras, or REC_CL_NO_MAP. */
    unsigned int table, word, mask;
    int planes;   /* of word: 0, 1, 3 */
    int coloured; /* 1: matrix holds */
    float matrix[9];
    float y, cb[3], cr[3], at0[3]; /* of YUV */
};

#endif
