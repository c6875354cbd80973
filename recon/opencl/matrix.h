/* matrix.h - the system matrix on a device.  Private to recon/opencl.
 *
 * Windows lie by bricks of 4^3 voxels, the order in which footprints lie (sysmat.h): place o of brick k is voxel
 * (i,j,k) with o = (z%4*4 + y%4)*4 + x%4.  So the items of a group, one a voxel, read consecutive bytes.
 * Both products gather: A'y a voxel at a time, A x a bin at a time, from the voxels of the bricks that the bin's tile
 * (8x8 bins) lists.  Nothing is added by two items at once, so results do not change from run to run.
 * Ownership: counted; borrows S. */
#ifndef REC_CL_MATRIX_H
#define REC_CL_MATRIX_H
#include "recon/matrix/sysmat.h"
#include "recon/opencl/kernels/shared.h"
#include "recon/opencl/run.h"

#define REC_CL_LEVELS 8

struct rec_cl_level {
    const rec_sysmat *S;
    struct rec_cl_geometry g;
    struct rec_cl_buffer geometry; /* g */
    uint32_t stored; /* bricks whose windows are there; the others are not kept by S (active.h) */
    struct rec_cl_buffer
        store;               /* int [all_bricks]: a brick's number among the stored ones, or -1 */
    struct rec_cl_buffer w;  /* uchar [stored][cameras][high*wide][64] */
    struct rec_cl_buffer at; /* short2 [stored][cameras][64]: first bin of the window */
    struct rec_cl_buffer more, more_from; /* struct rec_cl_more [], uint [stored + 1]; ascending */
    struct rec_cl_buffer tile_from,
        tile_brick; /* uint [all_tiles + 1], uint []: stored bricks (their
                                                   number in the grid) with a window in the tile, ascending */
    /* of the finest level: */
    struct rec_cl_buffer fp; /* ushort4 [cameras][all_bricks][64]: footprints */
    struct rec_cl_buffer
        rect; /* ushort4 [cameras][all_bricks]: those of bricks, as hull.c has them */
};

typedef struct rec_cl_matrix {
    rec_cl *cl;
    int levels;
    struct rec_cl_level level[REC_CL_LEVELS]; /* 0: S itself */
    struct rec_cl_queue *queue;               /* of uploads, at first */
    int users;
} rec_cl_matrix;

/* All levels of S.  Takes as long as reading S once.  Errors: PVX_ENOMEM (diag: what the device lacks), PVX_ENODEV. */
PVX_MUST_CHECK pvx_err rec_cl_matrix_new(rec_cl *cl, const rec_sysmat *S, rec_cl_matrix **out,
                                         struct pvx_diag *d);
/* One more user; one fewer, and the last one frees it.  Threads: one at a time. */
rec_cl_matrix *rec_cl_matrix_share(rec_cl_matrix *m);
void rec_cl_matrix_free(rec_cl_matrix **m);

#endif
