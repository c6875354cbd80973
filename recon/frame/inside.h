/* inside.h - more of frame.h, for the daemon, tests, benches and checks of the rig; not installed.
 * Threads: as frame.h.  Results are borrowed until the slot is carved again or reset. */
#ifndef REC_FRAME_INSIDE_H
#define REC_FRAME_INSIDE_H
#include "recon/frame/frame.h"
#include "recon/matrix/subsys.h"
#include "recon/opencl/raw.h"
#include "recon/solve/average.h"

/* rec_carver_background without a copy.  The carver takes *bg, which is of pvx_calloc or NULL, and gives the
 * background before it to the caller in *bg.  Allocates and frees nothing.  camera < the rig's. */
void rec_carver_exchange_background(rec_carver *k, size_t camera, float **bg);

/* Whether sets of these parameters have gain and aim corrected (recon/solve/selfcal.h), where the matrix has coarser
 * grids. */
bool rec_frame_corrects(const struct rec_frame_params *p);
/* From the next set on the solver corrects cameras by `a` and tells it what it sees; NULL: every set by itself.
 * Borrowed; several solvers of one rig may share it.  Call on the solve stage's thread, between sets. */
void rec_solver_average(rec_solver *s, rec_average *a);

/* What a slot needs only from its carving to the end of its solve: the restricted systems of all levels, two thirds of
 * its memory.  A slot of rec_frame_new_bare has none, and is lent some before it is carved.  It keeps its volume and
 * report when it gives them back.  They are for slots of this carver and solver.  Errors: PVX_ENOMEM, PVX_ENODEV. */
typedef struct rec_systems rec_systems;
PVX_MUST_CHECK pvx_err rec_systems_new(const rec_carver *k, const rec_solver *s, rec_systems **out,
                                       struct pvx_diag *d);
void rec_systems_free(rec_systems **y);
PVX_MUST_CHECK pvx_err rec_frame_new_bare(rec_carver *k, rec_solver *s, rec_frame **out,
                                          struct pvx_diag *d);
void rec_frame_lend(rec_frame *f, rec_systems *y);
rec_systems *rec_frame_give_back(rec_frame *f); /* NULL: it has none */

/* A solved frame that will be solved again (running.h) while its solver goes on with other frames keeps the problem
 * that was solved: the solver takes the kept one's in exchange, and the frame's loops run on `pool`, or NULL, from then
 * on.  Costs a copy of the prediction where there is one, else nothing.  Call on the solve stage's thread, after the
 * solve.  The frame keeps its systems until it is released; then it has the solver's problem and pool again.
 * Errors: PVX_ENOMEM.  Owner: caller. */
typedef struct rec_kept rec_kept;
PVX_MUST_CHECK pvx_err rec_kept_new(const rec_sysmat *S, int nch, rec_kept **out);
void rec_kept_free(rec_kept **k);
void rec_frame_keep(rec_frame *f, rec_kept *k, pvx_pool *pool);
rec_kept *rec_frame_release(rec_frame *f); /* NULL: it was not kept */

/* Pixels as the cameras gave them, raw [cameras], for a card that unpacks, bins and judges them (recon/opencl/raw.h).
 * They are copied to the slot in place of rec_frame_input; tables and maps are borrowed until it is carved.  All that
 * are present have a layout, or it is false: then rec_frame_input has to be written, as it also has without a card that
 * can do this.
 * bin: unpacks and bins pictures of the slot to out [cameras], [bh][bw][cs] each, where the processors have to do it
 * after all: in rec_frame_input, which gives binned pixels, or in rec_frame_carve.  false: it no longer can; then no
 * camera is present. */
struct rec_frame_binner {
    bool (*bin)(void *ctx, uint64_t number, const struct rec_cl_raw *raw, float *const *out);
    void *ctx;
    uint64_t number; /* of the pictures, for bin */
};
bool rec_frame_raw(rec_frame *f, const struct rec_cl_raw *raw, const struct rec_frame_binner *bin);

/* Restricted system and right-hand side of the carved frame.  On a graphics card the system has columns and counts
 * alone (subsys.h).  A camera that was voted out has its right-hand side and weight 0. */
const struct rec_subsys *rec_frame_subsys(const rec_frame *f);
const float *rec_frame_rhs(const rec_frame *f);
const float *rec_frame_weight(const rec_frame *f);
const float *rec_frame_weight4(const rec_frame *f); /* [rows][4] of each channel; NULL: as above */
int rec_frame_channels(const rec_frame *f);
#endif
