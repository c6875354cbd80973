/* kernels.h - the kernels and their text.  Private to recon/opencl.
 *
 * A file of kernels/ is a program of its own.  shared.h and common.cl stand before it.  It is built for CS=1 and for
 * CS=4.  A new file needs a line in REC_CL_FILES, a new kernel one in REC_CL_KERNELS. */
#ifndef REC_CL_KERNELS_H
#define REC_CL_KERNELS_H
#include <stddef.h>

/* kernels/NAME.cl */
#define REC_CL_FILES(X) \
    X(run)              \
    X(scan)             \
    X(hull)             \
    X(levels)           \
    X(rows)             \
    X(products)         \
    X(pcg)              \
    X(problem)          \
    X(blend)            \
    X(selfcal)          \
    X(refine)           \
    X(photo)            \
    X(lit)              \
    X(unpack)

/* X(K, kernel, file): its number is REC_CL_K_<K>. */
#define REC_CL_KERNELS(X)                                \
    X(ADD_PARTS, add_parts, run)                         \
    X(SUM_LANES, sum_lanes, run)                         \
    X(BRICK_RECTS, brick_rects, rows)                    \
    X(PAIR_SIZES, pair_sizes, rows)                      \
    X(PAIR_FILL, pair_fill, rows)                        \
    X(FIND_ACTIVE, find_active, products)                \
    X(MARK_ROWS, mark_rows, products)                    \
    X(SPREAD, spread, products)                          \
    X(FORWARD, forward, products)                        \
    X(ADJOINT, adjoint, products)                        \
    X(COUNT_ENTRIES, count_entries, products)            \
    X(COLUMN_NORMS, column_norms, products)              \
    X(SCAN_SUM, scan_sum, scan)                          \
    X(SCAN_TOTAL, scan_total, scan)                      \
    X(SCAN_PLACE, scan_place, scan)                      \
    X(SCAN_LIST, scan_list, scan)                        \
    X(TABLE_ROWS, table_rows, hull)                      \
    X(TABLE_BANDS, table_bands, hull)                    \
    X(TABLE_COLUMNS, table_columns, hull)                \
    X(HULL_BRICKS, hull_bricks, hull)                    \
    X(HULL_VOXELS, hull_voxels, hull)                    \
    X(LEVELS_MASK, levels_mask, levels)                  \
    X(LEVELS_ROWS, levels_rows, levels)                  \
    X(LEVELS_FILL, levels_fill, levels)                  \
    X(LEVELS_NEAR, levels_near, levels)                  \
    X(LEVELS_TILES, levels_tiles, levels)                \
    X(LEVELS_ENTRIES, levels_entries, levels)            \
    X(LEVELS_AVERAGE, levels_average, levels)            \
    X(LEVELS_AVERAGE4, levels_average4, levels)          \
    X(PCG_BEGIN, pcg_begin, pcg)                         \
    X(PCG_SCALE, pcg_scale, pcg)                         \
    X(PCG_DIRECTION, pcg_direction, pcg)                 \
    X(PCG_ROWS_SQUARE, pcg_rows_square, pcg)             \
    X(PCG_CURVATURE, pcg_curvature, pcg)                 \
    X(PCG_STEP, pcg_step, pcg)                           \
    X(PCG_ROWS_STEP, pcg_rows_step, pcg)                 \
    X(PCG_SMOOTHNESS, pcg_smoothness, pcg)               \
    X(PCG_GRADIENT, pcg_gradient, pcg)                   \
    X(PCG_SLOPE, pcg_slope, pcg)                         \
    X(PCG_RETREAT, pcg_retreat, pcg)                     \
    X(PCG_BRIGHTNESS, pcg_brightness, pcg)               \
    X(PCG_STIFFNESS, pcg_stiffness, pcg)                 \
    X(PROBLEM_LOAD, problem_load, problem)               \
    X(PROBLEM_RESIDUAL, problem_residual, problem)       \
    X(PROBLEM_FIT, problem_fit, problem)                 \
    X(PROBLEM_SCALE_ROWS, problem_scale_rows, problem)   \
    X(PROBLEM_SCALE, problem_scale, problem)             \
    X(PROBLEM_SQUARE, problem_square, problem)           \
    X(PROBLEM_DIFFERENCES, problem_differences, problem) \
    X(BLEND_COLOURS, blend_colours, blend)               \
    X(BLEND_ROWS, blend_rows, blend)                     \
    X(BLEND_COLUMNS, blend_columns, blend)               \
    X(BLEND_TINT, blend_tint, blend)                     \
    X(BLEND_COLOUR, blend_colour, blend)                 \
    X(SELFCAL_TILES, selfcal_tiles, selfcal)             \
    X(SELFCAL_CORRECT, selfcal_correct, selfcal)         \
    X(REFINE, refine, refine)                            \
    X(EARLIER, earlier, refine)                          \
    X(PHOTO_LINEAR, photo_linear, photo)                 \
    X(PHOTO_BLOCKS, photo_blocks, photo)                 \
    X(PHOTO_PLANE, photo_plane, photo)                   \
    X(PHOTO_JUDGE, photo_judge, lit)                     \
    X(PHOTO_NOISY, photo_noisy, lit)                     \
    X(PHOTO_WIDEN, photo_widen, lit)                     \
    X(PHOTO_FINISH, photo_finish, lit)                   \
    X(PHOTO_GROW_ROWS, photo_grow_rows, lit)             \
    X(PHOTO_GROW_COLUMNS, photo_grow_columns, lit)       \
    X(PHOTO_MEND, photo_mend, lit)                       \
    X(UNPACK, unpack_bins, unpack)

enum rec_cl_file {
#define REC_CL_NUMBER(file) REC_CL_FILE_##file,
    REC_CL_FILES(REC_CL_NUMBER)
#undef REC_CL_NUMBER
        REC_CL_N_FILES
};
enum rec_cl_kernel {
#define REC_CL_NUMBER(K, kernel, file) REC_CL_K_##K,
    REC_CL_KERNELS(REC_CL_NUMBER)
#undef REC_CL_NUMBER
        REC_CL_N_KERNELS
};

struct rec_cl_text {
    const char *name, *begin, *end; /* "run.cl", and what is in it */
};
extern const struct rec_cl_text rec_cl_shared, rec_cl_common, rec_cl_text[REC_CL_N_FILES];
extern const struct rec_cl_kernel_name {
    const char *name;
    enum rec_cl_file file;
} rec_cl_kernel_names[REC_CL_N_KERNELS];

#endif
