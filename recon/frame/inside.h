/* inside.h - more of frame.h, for the daemon, tests, benches and checks of the rig; not installed.
 * Threads: as frame.h.  Results are borrowed until the slot is carved again or reset. */
#ifndef REC_FRAME_INSIDE_H
#define REC_FRAME_INSIDE_H
#include "recon/frame/frame.h"
#include "recon/matrix/subsys.h"

/* rec_carver_background without a copy.  The carver takes *bg, which is of pvx_calloc or NULL, and gives the
 * background before it to the caller in *bg.  Allocates and frees nothing.  camera < the rig's. */
void rec_carver_exchange_background(rec_carver *k, size_t camera, float **bg);

/* Restricted system and right-hand side of the carved frame.  A camera that was voted out has its
 * right-hand side and weight 0. */
const struct rec_subsys *rec_frame_subsys(const rec_frame *f);
const float *rec_frame_rhs(const rec_frame *f);
const float *rec_frame_weight(const rec_frame *f);
const float *rec_frame_weight4(const rec_frame *f); /* [rows][4] of each channel; NULL: as above */
int rec_frame_channels(const rec_frame *f);
#endif
