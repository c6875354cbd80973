/* matrix.h - the system matrix on a device.  Private to recon/opencl.
 *
 * It is there twice, because both products gather.  Nothing is added by two items at once, so results do not change
 * from run to run.
 *   columns  A'y, a voxel at a time: the windows of S.  They lie by bricks of 4^3 voxels, the order in which footprints
 *            lie (sysmat.h): place o of a brick is voxel (i,j,k) with o = (k%4*4 + j%4)*4 + i%4.  The items of a group,
 *            one a voxel, read consecutive bytes.
 *   rows     A x, a bin at a time.  A pair is a tile (8x8 bins of a picture) and a brick with an entry there.  It has its
 *            entries bin by bin, each in two bytes: the place of the voxel, and the weight.
 * A brick that S does not keep (active.h) is not stored.
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
    uint32_t stored;               /* bricks */
    struct rec_cl_buffer store;    /* int [all_bricks]: a brick's number among the stored, or -1 */
    struct rec_cl_buffer brick; /* uint [stored]: a stored brick's number in the grid, ascending */
    /* columns: */
    struct rec_cl_buffer at; /* int [stored][cameras][64]: first row of the window, or NOWHERE */
    struct rec_cl_buffer w;  /* uchar4 [stored][cameras][high*wide/4][64]: its weights */
    struct rec_cl_buffer more, more_from; /* struct rec_cl_more [], uint [stored + 1]: by voxel */
    /* rows: */
    uint32_t pairs;
    struct rec_cl_buffer tile_from; /* uint [all_tiles + 1]: first pair of a tile */
    struct rec_cl_buffer
        pair_brick;                 /* uint [pairs]: number among the stored, ascending in a tile */
    struct rec_cl_buffer pair_bins; /* ulong [pairs]: bit i: bin i of the tile has entries */
    struct rec_cl_buffer pair_at;   /* uint [pairs]: where it begins in `rows`, in eights */
    struct rec_cl_buffer
        rows; /* ushort []: of each such bin the first entry, and the end of all, counted from the
                                  pair's beginning; then the entries, 256 * place + weight */
    /* of the finest level: */
    struct rec_cl_buffer fp; /* ushort4 [cameras][stored][64]: footprints */
    struct rec_cl_buffer
        rect; /* ushort4 [cameras][all_bricks]: those of bricks, as hull.c has them */
};

typedef struct rec_cl_matrix {
    rec_cl *cl;
    int levels;
    struct rec_cl_level level[REC_CL_LEVELS]; /* 0: S itself */
    struct rec_cl_queue *queue;               /* while it is made */
    int users;
} rec_cl_matrix;

/* All levels of S.  Takes as long as reading S a few times.  Errors: PVX_ENOMEM (diag: what the device lacks),
 * PVX_ENODEV, PVX_ERANGE (diag: what is too large). */
PVX_MUST_CHECK pvx_err rec_cl_matrix_new(rec_cl *cl, const rec_sysmat *S, rec_cl_matrix **out,
                                         struct pvx_diag *d);
/* One more user; one fewer, and the last one frees it.  Threads: one at a time. */
rec_cl_matrix *rec_cl_matrix_share(rec_cl_matrix *m);
void rec_cl_matrix_free(rec_cl_matrix **m);

#endif
