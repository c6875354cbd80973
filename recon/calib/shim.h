/* shim.h - the functions of the calibration module (lib/pyrovox/pyrovox-calib.so) in plain C: nonlinear least squares
 * by Ceres, and from OpenCV the homography and the two poses of a plane.
 *
 * The module is C++ and is loaded with dlopen by module.c on first use; it exports one function, rec_calib_module.
 * No exception crosses this border: every entry returns a pvx_err value as int and puts a line into `err` when
 * that is not 0.  The module keeps nothing between calls and starts no thread, so the same input gives the same
 * bits. */
#ifndef REC_CALIB_SHIM_H
#define REC_CALIB_SHIM_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#define REC_CALIB_NOEXCEPT noexcept
#else
#define REC_CALIB_NOEXCEPT
#endif

#define REC_CALIB_VERSION 1
#define REC_NLS_BLOCKS    4 /* blocks that one term may depend on */

/* Numbers that belong together: a pose, a lens. */
struct rec_nls_block {
    double *x;
    int32_t n;
    uint32_t held; /* bit i: x[i] stays */
    bool first;    /* eliminated first (Schur): no term has two of these */
};

/* Two residuals of up to four blocks.  robust: the squared length goes through Cauchy's loss. */
struct rec_nls_term {
    uint32_t block[REC_NLS_BLOCKS];
    int32_t n_blocks;
    bool robust;
};

struct rec_nls {
    size_t n_blocks, n_terms;
    const struct rec_nls_block *block;
    const struct rec_nls_term *term;
    /* Residuals r [2] of term i at x; J[k], where J and J[k] are not NULL, is [2][n of block k], row major.
     * False: not defined at x; the step is then shortened.  Called from one thread. */
    bool (*residual)(const void *ctx, size_t i, const double *const *x, double *r, double **J);
    const void *ctx;
    double loss;      /* scale of Cauchy's loss, in units of the residuals */
    double tolerance; /* stop when a step changes a smaller share of the sum of squares */
    int max_iterations;
};

struct rec_nls_report {
    double initial, final; /* half the sum of squares, after the loss */
    int iterations;
    bool converged;
};

struct rec_calib_lib {
    int version; /* REC_CALIB_VERSION */
    /* Levenberg-Marquardt, steps by DENSE_SCHUR (Ceres).  Moves x of the blocks. */
    int (*solve)(const struct rec_nls *p, struct rec_nls_report *out, char *err,
                 size_t err_size) REC_CALIB_NOEXCEPT;
    /* (J^T J)^-1 of the listed blocks, side by side in this order: cov [N][N], N the sum of their n; rows of held
     * numbers are 0 (ceres::Covariance).  PVX_EINVAL: J^T J is singular. */
    int (*covariance)(const struct rec_nls *p, const uint32_t *list, size_t n, double *cov,
                      char *err, size_t err_size) REC_CALIB_NOEXCEPT;
    /* plane [n][2] -> pixels [n][2] by H [9], row major, H[8] = 1, tolerating a tenth of wrong points (RANSAC,
     * `reach` px).  PVX_EINVAL: there is none. */
    int (*homography)(const double *plane, const double *pixels, size_t n, double reach, double *H,
                      char *err, size_t err_size) REC_CALIB_NOEXCEPT;
    /* Poses of a plane z = 0 seen in ideal coordinates (x/z, y/z) [n][2]: up to two (IPPE; Collins and
     * Bartoli, IJCV 109, 2014), the better first: rotation vector, translation, in pose [2][6].  n >= 4. */
    int (*planar)(const double *plane, const double *ideal, size_t n, double *pose, int *n_poses,
                  char *err, size_t err_size) REC_CALIB_NOEXCEPT;
};

const struct rec_calib_lib *rec_calib_module(void) REC_CALIB_NOEXCEPT;

#ifdef __cplusplus
}
#endif
#endif
