/* stab.h - what the parts of the stability program share: beds (a rig, its matrix, pictures whose
 * truth is known without the matrix), the chain run on them, and the one table of outcomes.
 *
 * The program runs in full (make stability) and in a reduced size inside make test
 * (tests/sim/test_stability.c); both link the same parts. */
#ifndef STAB_H
#define STAB_H
#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

#include "base/pool.h"
#include "recon/view/flame.h"
#include "recon/frame/frame.h"
#include "recon/geom/traverse.h"

/* The harness's own errors end the program: there is nothing to measure then. */
#define CHECK(expr)                                                                                \
    do {                                                                                           \
        pvx_err check_e_ = (expr);                                                                 \
        if (check_e_ != PVX_OK) {                                                                  \
            fprintf(stderr, "%s:%d: %s: %s\n", __FILE__, __LINE__, #expr, pvx_strerror(check_e_)); \
            exit(2);                                                                               \
        }                                                                                          \
    } while (0)

struct stab_run {
    int32_t voxels, w, h;                /* of the hard cases */
    int32_t long_voxels, long_w, long_h; /* of the 10^4 iterations */
    uint32_t long_iterations;
    bool quick;
    const char *folder; /* for CSV files, or NULL */
    pvx_pool *pool;
};

#define STAB_FULL                                                                        \
    {                                                                                    \
        .voxels = 64, .w = 160, .h = 120, .long_voxels = 32, .long_w = 80, .long_h = 60, \
        .long_iterations = 10000                                                         \
    }
#define STAB_QUICK                                                                     \
    {                                                                                  \
        .voxels = 24, .w = 64, .h = 48, .long_voxels = 20, .long_w = 48, .long_h = 36, \
        .long_iterations = 1000, .quick = true                                         \
    }

/* ---- the table ----------------------------------------------------------------------------------*/

#define STAB_NO_BOUND INFINITY /* reported only */

struct stab_row {
    const char *name;
    int basis; /* enum rec_basis, or -1 where none is meant */
    const char *solver, *outcome;
    double error, bound; /* must be finite and error <= bound */
    bool sound;          /* whatever else the case asserts */
    double residual;     /* relative; 0 where there is none */
    uint32_t iterations;
    int32_t voxels; /* active */
    double ms;
};

/* Print the row, PASS or FAIL; and to stability.csv in the folder. */
void stab_begin(const struct stab_run *run);
void stab_add(const struct stab_row *row);
/* Rows so far / failed ones. */
int stab_rows(void), stab_failed(void);
void stab_end(void);

/* ---- beds ---------------------------------------------------------------------------------------*/

enum stab_rig {
    RIG_RING,   /* the standard rig */
    RIG_TWINS,  /* camera 1 a millimetre from camera 0 */
    RIG_PLANE,  /* all at one height, looking level */
    RIG_INSIDE, /* the last camera stands in the flame */
    RIG_FACES,  /* rays in voxel faces, along edges and diagonals; one almost parallel bundle */
};

struct stab_bed {
    const struct stab_run *run;
    struct rec_rig rig;
    rec_sysmat *S;
    size_t voxels;                           /* of the grid */
    struct rec_flame_pose pose;              /* that the pictures are of */
    struct rec_flame_pose pose0;             /* the flame at t = 0.3 s, ... */
    float *truth0, *image0[REC_MAX_CAMERAS]; /* ... its truth and its pictures */
    float *truth;                            /* [voxels][3] */
    float *image[REC_MAX_CAMERAS];           /* [h][w][3] */
    bool present[REC_MAX_CAMERAS];
    double norm; /* of the truth as rendered: errors are relative to it */
    double peak; /* brightest pixel */
    struct rec_frame_params p;
    uint64_t rng;
};

void stab_bed_new(struct stab_bed *b, const struct stab_run *run, enum stab_rig kind,
                  size_t cameras, enum rec_basis basis, int32_t voxels, int32_t w, int32_t h);
void stab_bed_free(struct stab_bed *b);
/* The flame at t = 0.3 s, its pictures and truth, default parameters, all cameras, first random. */
void stab_bed_reset(struct stab_bed *b);
/* Pictures and truth anew from b->pose; `cameras` NULL = the rig's own. */
void stab_bed_render(struct stab_bed *b, const struct rec_camera *cameras);
/* Gaussian noise, sigma as a share of the brightest pixel. */
void stab_bed_noise(struct stab_bed *b, double share);
double stab_uniform(struct stab_bed *b);
size_t stab_pixels(const struct stab_bed *b, size_t camera);

struct stab_result {
    struct rec_frame_report report;
    bool finite;   /* and >= 0, every lane */
    double error;  /* ||x - truth|| / norm */
    double amount; /* ||x|| / norm */
    double ms;
};
/* Pixels into the slot, carve, solve with f's parameters, judge.  previous as in rec_frame_solve. */
struct stab_result stab_solve(const struct stab_bed *b, rec_frame *f,
                              const struct rec_sparse *previous);
/* The same in a slot of its own with b->p and this solver (NULL = default). */
struct stab_result stab_reconstruct(const struct stab_bed *b, const char *solver);
/* Pixels into the slot only. */
void stab_fill(const struct stab_bed *b, rec_frame *f);

/* ---- the parts ----------------------------------------------------------------------------------*/

void stab_cases(const struct stab_run *run);      /* every line of DESIGN 7 */
void stab_reference(const struct stab_run *run);  /* float against double */
void stab_iterations(const struct stab_run *run); /* 10^4 of them */
void stab_conditions(const struct stab_run *run); /* singular values of rigs of 2 to 16 views */

#endif
