/* system.h - one frame set on a device: its hull, and its restricted systems with their pictures on all levels.
 *
 * Columns have the numbers that they have on the host: active voxels in ascending order.  Rows are bins, as on the
 * host.  Hull, columns, rows and counts are the host's to the bit; pictures of coarser levels are too.
 * Ownership: a slot's (frame/impl.h: rec_systems).  Threads: one at a time.  Private to recon. */
#ifndef REC_CL_SYSTEM_H
#define REC_CL_SYSTEM_H
#include "recon/carve/hull.h"
#include "recon/opencl/matrix.h"
#include "recon/opencl/photo.h"
#include "recon/solve/card.h"

/* What products with a part need (products.h: rec_cl_products_new), and what rec_cl_mark_rows leaves there. */
struct rec_cl_products {
    struct rec_cl_buffer active;     /* ulong [stored]: bit o: the brick's voxel o is a column */
    struct rec_cl_buffer tile_rows;  /* uint [all_tiles]: rows of a tile; 0: it is not active */
    struct rec_cl_buffer tile_pairs; /* uint [all_tiles]: its pairs with active bricks, and */
    struct rec_cl_buffer pair; /* uint [pairs]: their numbers, from tile_from of the tile on */
    struct rec_cl_buffer x;    /* lanes [stored][64]: a vector x brick by brick, and */
    struct rec_cl_buffer lit;  /* uchar [stored]: whether it is not 0 in a brick */
};

/* The restricted system of one level.  rec_subsys.card points to `base`. */
struct rec_cl_part {
    struct rec_card_system base; /* first */
    const struct rec_cl_level *level;
    struct rec_cl_system *of;
    uint32_t room;               /* for columns: those of all voxels, or fewer */
    int32_t n, rows;             /* columns; rows of A */
    uint32_t bricks, tiles;      /* active: with an active voxel; with a row */
    struct rec_cl_buffer map;    /* int [voxels]: number of the column, or -1 */
    struct rec_cl_buffer col;    /* int [room]: voxel */
    struct rec_cl_buffer near;   /* int [6][room]: columns at -x +x -y +y -z +z, or -1 */
    struct rec_cl_buffer brick;  /* uint [all_bricks]: the active ones, ascending */
    struct rec_cl_buffer tile;   /* uint [all_tiles]: the active ones, ascending */
    struct rec_cl_buffer is_row; /* uchar [room of rows] */
    /* lanes, float, float4 [room of rows]: pictures, weights.  w4 with per_channel, and then w on the finest level
     * alone. */
    struct rec_cl_buffer b, w, w4;
    const float *b_here, *w_here; /* their names on the host (card.h) */
    struct rec_cl_products products;
};

typedef struct rec_cl_system {
    rec_cl_matrix *m;
    int cs;
    size_t columns; /* room for so many on the finest level */
    bool per_channel;
    uint64_t present; /* bit c: camera c */
    struct rec_cl_part part[REC_CL_LEVELS];
    struct rec_cl_solver *solver; /* whose vectors the operations use; set by rec_cl_solver_begin */
    struct rec_cl_hull *hull;     /* work areas of the carving */
    rec_cl_queue *queue;          /* of the carving */
} rec_cl_system;

/* Room for `columns` active voxels on the finest level.  Errors: PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_cl_system_new(rec_cl_matrix *m, int cs, size_t columns,
                                         rec_cl_system **out, struct pvx_diag *d);
void rec_cl_system_free(rec_cl_system **y);

struct rec_cl_carving {
    const struct rec_hull_params *hull;
    const uint8_t *const *lit;     /* [cameras] silhouettes */
    const bool *present;           /* [cameras] */
    const struct rec_pictures *in; /* carved pictures, of S's rows; per_channel: w is [rows][4] */
    const float *weight;           /* [rows] also with per_channel */
    bool there; /* pictures and silhouettes are on the device: rec_cl_system_pictures */
};
/* Where photometry on the device (photo.h) writes the set's pictures and silhouettes. */
void rec_cl_system_pictures(const rec_cl_system *y, bool per_channel, struct rec_cl_pictures *out);
/* Uploads silhouettes and pictures, unless they are there.  Carves, and restricts the finest level: kept->col, n and
 * counts as rec_hull_carve, `sub` as rec_subsys_restrict with sub->card set.  false: the device is lost, or has no room
 * for so many columns (*too_many); sub->card is then NULL. */
bool rec_cl_carve(rec_cl_system *y, const struct rec_cl_carving *in, struct rec_hull_kept *kept,
                  struct rec_subsys *sub, bool *too_many);
/* rec_card_ops.levels: the coarser systems and their pictures. */
void rec_cl_levels(const struct rec_subsys *fine, const struct rec_pictures *in,
                   struct rec_card_level *level, int n);

static inline struct rec_cl_part *rec_cl_part_of(const struct rec_subsys *a)
{
    return (struct rec_cl_part *)a->card;
}

#endif
