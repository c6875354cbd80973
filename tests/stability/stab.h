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
#include "base/random.h"
#include "recon/view/flame.h"
#include "recon/geom/traverse.h"
#include "tests/lib/must.h"
#include "tests/lib/slot.h"

struct stab_size {
    int32_t voxels, w, h; /* a side; of a picture */
};

struct stab_run {
    struct stab_size size, long_size; /* of the hard cases, of the 10^4 iterations */
    uint32_t long_iterations;
    bool quick;
    const char *folder; /* for CSV files, or NULL */
    pvx_pool *pool;
    struct rec_cl *card; /* solves too what it can, and is compared with the processors; or NULL */
};

#define STAB_FULL                                                                   \
    {                                                                               \
        .size = {64, 160, 120}, .long_size = {32, 80, 60}, .long_iterations = 10000 \
    }
#define STAB_QUICK                                                                              \
    {                                                                                           \
        .size = {24, 64, 48}, .long_size = {20, 48, 36}, .long_iterations = 1000, .quick = true \
    }

/* ---- the table ----------------------------------------------------------------------------------*/

#define STAB_NO_BOUND INFINITY /* reported only */
/* Outcome and error as tests/stability/quick.csv or full.csv has them, the error at most 1.3 times as
 * large; the two forms of cgls without a bound on it.  A run with a folder writes what it measured to
 * measured.csv there: after a change that is meant, that file replaces the other. */
#define STAB_MEASURED (-1.0)

struct stab_row {
    const char *name;
    int basis; /* enum rec_basis, or -1 where none is meant */
    const char *solver, *outcome;
    double error, bound; /* must be finite and error <= bound */
    bool sound;          /* whatever else the case asserts */
    bool flame;          /* the row must not accept a volume of zeros */
    double residual;     /* relative; 0 where there is none */
    uint32_t iterations;
    int32_t voxels; /* active */
    double ms;
};

/* Print the row, PASS or FAIL; and to stability.csv in the folder. */
void stab_begin(const struct stab_run *run);
/* NAME.csv in the folder, or NULL where there is none. */
FILE *stab_csv(const struct stab_run *run, const char *name);
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
    const struct rec_bodies *bodies;         /* that stand in them; NULL: none */
    struct rec_flame_pose pose0;             /* the flame at t = 0.3 s, ... */
    float *truth0, *image0[REC_MAX_CAMERAS]; /* ... its truth and its pictures */
    float *truth;                            /* [voxels][3] */
    float *image[REC_MAX_CAMERAS];           /* [h][w][3] */
    bool present[REC_MAX_CAMERAS];
    double norm;   /* of the truth as rendered: errors are relative to it */
    double peak;   /* brightest pixel */
    bool residual; /* no flame could make these pictures: the error is the relative residual */
    struct rec_frame_params p;
    uint64_t rng;
};

void stab_bed_new(struct stab_bed *b, const struct stab_run *run, enum stab_rig kind,
                  size_t cameras, enum rec_basis basis, struct stab_size size);
void stab_bed_free(struct stab_bed *b);
/* The flame at t = 0.3 s, its pictures and truth, default parameters, all cameras, first random. */
void stab_bed_reset(struct stab_bed *b);
/* Pictures and truth anew from b->pose; `cameras` NULL = the rig's own. */
void stab_bed_render(struct stab_bed *b, const struct rec_camera *cameras);
/* Gaussian noise, sigma as a share of the brightest pixel. */
void stab_bed_noise(struct stab_bed *b, double share);
size_t stab_pixels(const struct stab_bed *b, size_t camera);

struct stab_result {
    struct rec_frame_report report;
    bool finite;  /* and >= 0, every channel */
    bool flame;   /* there is one, so zeros are wrong */
    double error; /* ||x - truth|| / norm */
    double ms;
    /* flame: "light"; "astray", error 1 or more: worse than no light at all; "carved away", the hull
     * left no voxel; "nothing", zeros for another reason.  No flame: "dark", all 0, or "ghost". */
    const char *outcome;
};
/* Pixels into the slot, carve, solve with f's parameters, judge.  previous as in rec_frame_solve. */
struct stab_result stab_solve(const struct stab_bed *b, rec_frame *f,
                              const struct rec_sparse *previous);
/* The same in a slot of its own with b->p and this solver (NULL = default). */
struct stab_result stab_reconstruct(const struct stab_bed *b, const char *solver);
/* The row of a result, with a measured bound. */
struct stab_row stab_row_of(const char *name, const struct stab_bed *b, const char *solver,
                            const struct stab_result *r);
/* The same for a slot with a device, filled; false: it differs from the processors by more than rounding. */
bool stab_solve_pair(const struct stab_bed *b, rec_frame *f, const struct rec_sparse *previous);
/* How many such sets there were; prints by how much they differed. */
size_t stab_pairs(void);
/* Pixels into the slot only. */
void stab_fill(const struct stab_bed *b, rec_frame *f);

/* ---- the parts ----------------------------------------------------------------------------------*/

void stab_cases(const struct stab_run *run);      /* every hard case */
void stab_terms(const struct stab_run *run);      /* bodies, and a flame that jumps */
void stab_reference(const struct stab_run *run);  /* float against double */
void stab_iterations(const struct stab_run *run); /* 10^4 of them */
void stab_conditions(const struct stab_run *run); /* singular values of rigs of 2 to 16 views */

#endif
