/* frame.h - one frame set from binned pixels to a sparse volume: the interface of daemon and CLI.
 *
 * Stages own workspaces, slots own data.  Each stage thread has one rec_carver or one rec_solver, which holds the
 * constant data and all work areas.  A rec_frame is the slot that travels from one to the other: {pixels, lit, A on
 * every level, x, report}.
 *   1. write the pixels of camera c to rec_frame_input(f, c), and their properties to *rec_frame_camera(f, c)
 *   2. rec_frame_carve: photometry, silhouettes, absorption, vote, hull, restricted system
 *   3. rec_frame_solve
 *   4. read rec_frame_volume; then rec_frame_reset for the next set
 * Threads: one slot at a time in each of 2 and 3; different slots may be in different steps.
 * After the three ..._new nothing allocates.  Owner: caller.  S and pool are borrowed; a slot borrows its carver and
 * its solver. */
#ifndef REC_FRAME_H
#define REC_FRAME_H
#include <math.h>
#include "recon/carve/hull.h"
#include "recon/carve/photo.h"
#include "recon/geom/rig.h"
#include "recon/solve/params.h"
#include "recon/vote/verdict.h"

#ifdef __cplusplus
extern "C" {
#endif

struct rec_cl; /* recon/opencl/device.h */

struct rec_frame_params {
    int nch; /* 1 or 3 */
    struct rec_photo_params photo;
    struct rec_hull_params hull;
    struct rec_solve_params solve;
    bool coarse_start; /* solve on coarser grids first (levels.h); only the default solver does */
    bool trust_all;    /* no vote (vote.h): every camera is believed */
    bool at_least; /* saturated pixels are lower bounds (bound.h; default solver), else left out */
    bool temporal; /* use the previous volume as a prediction (temporal.h); needs coarse_start */
    enum rec_selfcal_mode selfcal; /* gain and aim of the cameras are corrected in the solve
                                      (recon/solve/selfcal.h); needs coarse_start */
    double absorption;             /* c of absorb.h, 1 over pixel value; 0, the default: none */
    uint32_t hold; /* sets in which a camera that was voted out has to agree before it is back;
                          0, the default: each set by itself */
    bool again;    /* frames are solved again for error bars (bars.h) */
    struct rec_cl
        *card; /* carves and solves on it, borrowed; NULL, the default: on the processors */
};
extern const struct rec_frame_params rec_frame_defaults; /* nch 3 */
/* What of these parameters only the processors can do, in a few words; NULL: nothing, a card can do all of it. */
const char *rec_frame_card_why_not(const struct rec_frame_params *p);

struct rec_frame_report {
    struct rec_solve_report solve;
    struct rec_hull_counts hull;
    int64_t active_voxels, active_rays;
    uint64_t entries;
    uint32_t cameras;                       /* present and believed */
    uint32_t saturated, not_finite;         /* bins, all cameras */
    uint32_t saturated_in[REC_MAX_CAMERAS]; /* each camera that is present, believed or not */
    double absorption;                      /* rec_frame_params */
    float cut[REC_MAX_CAMERAS];             /* share of a dark's noise that is clipped at black, */
    float pedestal[REC_MAX_CAMERAS];        /* and what the camera lacks (photo.h) */
    float sigma;                            /* noise estimate, mean over cameras and channels */
    struct rec_verdict vote;                /* cameras that are not believed count as absent */
    struct rec_selfcal_report selfcal;
    double temporal;            /* trust in the previous volume, 0..1 */
    bool warm;                  /* the solve started from the earlier volume */
    bool on_card;               /* solved on params.card, */
    bool raw_on_card;           /* and its pixels were unpacked and judged there */
    char why_here[128];         /* with params.card, but solved on the processors: the reason */
    uint32_t coarse_iterations; /* iterations on coarser grids, before those of `solve` */
    int64_t photo_ns, vote_ns, hull_ns, restrict_ns, solve_ns; /* wall time of each stage */
};

static inline int64_t rec_frame_total_ns(const struct rec_frame_report *r)
{
    return r->photo_ns + r->vote_ns + r->hull_ns + r->restrict_ns + r->solve_ns;
}

/* The relative residual that noise alone leaves, with nch channels; 0: not known. */
static inline double rec_frame_noise(const struct rec_frame_report *r, int nch)
{
    double norm = r->solve.rel_residual > 0 ? r->solve.residual_norm / r->solve.rel_residual : 0;
    return norm > 0 ? (double)r->sigma * sqrt((double)r->active_rays * nch) / norm : 0;
}

/* Sparse volume: values [n][cs] (cs = 1 or 4, first nch lanes count) at voxels index[n] ascending;
 * all others are 0.  Emission per metre in units of linear pixel value. */
struct rec_sparse {
    const struct rec_grid *grid;
    int nch, cs;
    int32_t n;
    const int32_t *index;
    const float *value;
};

/* rig gives the gains and must have S's cameras in S's order.  Errors: PVX_EINVAL, PVX_ENOMEM. */
typedef struct rec_carver rec_carver;
PVX_MUST_CHECK pvx_err rec_carver_new(const rec_sysmat *S, const struct rec_rig *rig,
                                      const struct rec_frame_params *p, pvx_pool *pool,
                                      rec_carver **out, struct pvx_diag *d);
void rec_carver_free(rec_carver **k);
/* Background image of camera c, [bh][bw][cs], copied; NULL = none. */
PVX_MUST_CHECK pvx_err rec_carver_background(rec_carver *k, size_t camera, const float *bg);

/* New photometry from the next set on.  Call on the carve stage's thread, between sets.  Allocates nothing. */
void rec_carver_tune(rec_carver *k, const struct rec_photo_params *p);

/* New gains of camera c from the next set on.  Call as rec_carver_tune. */
void rec_carver_gain(rec_carver *k, size_t camera, const float gain[3]);

/* New absorption from the next set on.  Call as rec_carver_tune. */
void rec_carver_absorb(rec_carver *k, double absorption);

/* Errors: PVX_EINVAL, PVX_ENOMEM. */
typedef struct rec_solver rec_solver;
PVX_MUST_CHECK pvx_err rec_solver_new(const rec_sysmat *S, const struct rec_frame_params *p,
                                      rec_solver **out, struct pvx_diag *d);
void rec_solver_free(rec_solver **s);
/* New limits and weight from the next set on.  The method stays, because the work areas were made for it.  Call on
 * the solve stage's thread, between sets.  Allocates nothing. */
void rec_solver_tune(rec_solver *s, const struct rec_solve_params *p);

/* A slot for a carver and a solver that were made from the same matrix and the same params.  Errors: PVX_ENOMEM,
 * those of rec_subsys_new. */
typedef struct rec_frame rec_frame;
PVX_MUST_CHECK pvx_err rec_frame_new(rec_carver *k, rec_solver *s, rec_frame **out,
                                     struct pvx_diag *d);
/* A slot with a carver and a solver of its own, for one frame set at a time. */
PVX_MUST_CHECK pvx_err rec_frame_alone(const rec_sysmat *S, const struct rec_rig *rig,
                                       const struct rec_frame_params *p, pvx_pool *pool,
                                       rec_frame **out, struct pvx_diag *d);
void rec_frame_free(rec_frame **f);
void rec_frame_reset(rec_frame *f);

/* Properties of one camera's pixels in one set.  All 0, as rec_frame_reset leaves it: the camera is absent. */
struct rec_frame_camera {
    bool present; /* Without it the pixels are not read. */
    /* The pixels have finer steps than 8 bits.  In a dim picture fainter light then counts as flame: half a percent of
     * the brightest bin (photo.h, dim). */
    bool fine;
    /* The pixels were floating-point numbers.  They have no full scale, so no automatic saturation. */
    bool floats;
    /* The pixels are means of so many pictures; 0 and 1: of one.  From 16 on they have fine steps. */
    uint32_t pictures;
    /* Of means: standard deviation of one picture in the dark, per channel, from what changes between the pictures;
     * 0: not known, it is then measured from bin to bin. */
    float noise[3];
    /* The pixels come unchanged from a Bayer filter: each has the channel of its filter and NaN in the others.  Only
     * for the default solver.  Otherwise they were binned or interpolated, which changes their noise (photo.h). */
    bool mosaic;
    /* Colours of the Bayer filter's 2x2 pixels, row by row; NULL: no filter.  Only for 3 channels.  Borrowed until
     * rec_frame_reset. */
    const uint8_t *cell;
    /* Value of saturated pixels, above all others; 0: full scale, which is 1.  It replaces params.photo.saturation,
     * unless that is off. */
    float saturated;
};

float *rec_frame_input(rec_frame *f, size_t camera); /* [bh][bw][cs], cs = 4 for 3 channels */
/* The set's entry for the camera, to be written before rec_frame_carve. */
struct rec_frame_camera *rec_frame_camera(rec_frame *f, size_t camera);

void rec_frame_carve(rec_frame *f);
/* deadline_ns on the mono clock, 0 = none.  `previous`: an earlier volume of the same grid, or NULL.  With
 * coarse_start the solver starts from the solution on coarser grids or from `previous`, whichever fits better.
 * Without coarse_start it starts from `previous`, or from zero.  With `temporal`, `previous` predicts the frame and
 * is not a start. */
PVX_MUST_CHECK pvx_err rec_frame_solve(rec_frame *f, int64_t deadline_ns,
                                       const struct rec_sparse *previous);

void rec_frame_volume(const rec_frame *f, struct rec_sparse *out);
const struct rec_frame_report *rec_frame_get_report(const rec_frame *f);
/* Silhouette of the carved frame, [bh][bw] 0/1, also of a camera that was voted out. */
const uint8_t *rec_frame_lit(const rec_frame *f, size_t camera);

/* dense [nz][ny][nx][nch] out; zeroed first. */
void rec_sparse_to_dense(const struct rec_sparse *v, float *dense);

#ifdef __cplusplus
}
#endif
#endif
