/* pipeline.h - the stages wired: the one place that sees capture, recon and proto together.
 *
 *     cameras -> assemble -> [carve] -> queue -> [solve] -> queue -> [publish] -> ZeroMQ
 *     carve = bin + photometry + hull + restricted system; each [stage] is a thread of its own and
 *     shares one pool of workers for its loops
 *
 * While set k is solved, k+1 is carved and k-1 encoded.  DMN_N_SLOTS slots, each with all work areas
 * of one frame set, go round; raw camera frames are given back as soon as they are binned.
 * Live: newest wins - a full queue gives up its oldest set, counted by cause.  Lossless: a full
 * queue holds the stage before it, back to the cameras.
 * Results are published in the order of the sets.  Once started, the frame path allocates nothing
 * (libzmq allocates for its own messages).
 * Threads: new/start/stop/free from one thread, the rest from any. */
#ifndef DMN_PIPELINE_H
#define DMN_PIPELINE_H
#include "daemon/config/config.h"
#include "daemon/control/state.h"

/* One being carved, one waiting and one in the solver, one waiting and one in the publisher, and one
 * more so that carve never waits for a slot while older sets could be given up. */
#define DMN_N_SLOTS 6

typedef struct dmn_pipeline dmn_pipeline;

/* Reads the rig, builds or maps the matrix (progress in the log), opens the publisher.  `cfg` is
 * copied.  Errors: the rig's, the matrix's, PVX_EBUSY (endpoint in use), PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err dmn_pipeline_new(const struct dmn_config *cfg, rec_progress_fn progress,
                                        void *progress_ctx, dmn_pipeline **out, struct pvx_diag *d);
/* All of that which can be wrong in `cfg` and the rig, without matrix, endpoints and cameras. */
PVX_MUST_CHECK pvx_err dmn_pipeline_check(const struct dmn_config *cfg, struct pvx_diag *d);
PVX_MUST_CHECK pvx_err dmn_pipeline_start(dmn_pipeline *p, struct pvx_diag *d);
/* End of all sources reached, or stopped, and everything published. */
bool dmn_pipeline_finished(dmn_pipeline *p);
/* Stop the cameras, drain, say `end` to subscribers, join. */
void dmn_pipeline_stop(dmn_pipeline *p, const char *reason);
void dmn_pipeline_free(dmn_pipeline **p);

void dmn_pipeline_snapshot(dmn_pipeline *p, struct dmn_state *out);
/* Begin (path NULL: where record.path says) or end a take of raw frames; where = its file. */
PVX_MUST_CHECK pvx_err dmn_pipeline_record(dmn_pipeline *p, bool start, const char *path,
                                           char *where, size_t size, struct pvx_diag *d);
/* The latency statistics start anew with the next volume. */
void dmn_pipeline_reset_latency(dmn_pipeline *p);
/* Longest time since a stage's last heartbeat, ns. */
int64_t dmn_pipeline_stuck_ns(dmn_pipeline *p);
#endif
