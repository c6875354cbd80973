/* live.h - what the daemon runs: the pipeline between the rig's cameras and ZeroMQ, as pyrovoxd.yaml says.
 *
 * The one place that sees capture, recon and proto together.
 * Once started, the frame path allocates nothing (libzmq allocates for its own messages).
 * Threads: new/start/stop/free from one thread, the rest from any. */
#ifndef DMN_LIVE_H
#define DMN_LIVE_H
#include "daemon/config/config.h"
#include "daemon/control/state.h"
#include "proto/auth.h"

typedef struct dmn_live dmn_live;

/* Reads the rig, builds or maps the matrix (progress in the log), opens the publisher.  `cfg` is copied.  auth
 * (borrowed) says which clients the endpoints with keys let in; NULL: no endpoint asks for a key.
 * Errors: the rig's, the matrix's, PVX_EBUSY (endpoint in use), PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err dmn_live_new(const struct dmn_config *cfg, pvp_auth *auth,
                                    rec_progress_fn progress, void *progress_ctx, dmn_live **out,
                                    struct pvx_diag *d);
/* Checks all that can be wrong in `cfg` and the rig, without matrix, endpoints and cameras.  *matrix: about the bytes
 * that the system matrix needs. */
PVX_MUST_CHECK pvx_err dmn_live_check(const struct dmn_config *cfg, double *matrix,
                                      struct pvx_diag *d);
PVX_MUST_CHECK pvx_err dmn_live_start(dmn_live *l, struct pvx_diag *d);
/* Whether all sources have ended or were stopped, and everything is published. */
bool dmn_live_finished(dmn_live *l);
/* Stop the cameras, drain, say `end` to subscribers, join. */
void dmn_live_stop(dmn_live *l, const char *reason);
void dmn_live_free(dmn_live **l);

void dmn_live_snapshot(dmn_live *l, struct dmn_state *out);
/* Begin (path NULL: where record.path says) or end a take of raw frames; where = its file. */
PVX_MUST_CHECK pvx_err dmn_live_record(dmn_live *l, bool start, const char *path, char *where,
                                       size_t size, struct pvx_diag *d);
/* As dmn_triggers_order (triggers.h). */
PVX_MUST_CHECK pvx_err dmn_live_trigger(dmn_live *l, const char *name, int64_t *t_ns,
                                        struct pvx_diag *d);
/* Takes the options of cfg that may change while the daemon runs (dmn_option_live).  Each stage takes them before its
 * next set.  No set is lost and no stage waits. */
void dmn_live_tune(dmn_live *l, const struct dmn_config *cfg);
/* Writes one frame set, its volume and the status into a folder (instant.h), named as for dmn_live_record.
 * c: the options in effect.  Returns when all is on the disk. */
PVX_MUST_CHECK pvx_err dmn_live_keep(dmn_live *l, const struct dmn_config *c, const char *path,
                                     char *where, size_t size, struct pvx_diag *d);
/* As dmn_live_record for volumes, by a process beside the daemon: format record.volumes, hdf5 when that is none. */
PVX_MUST_CHECK pvx_err dmn_live_record_volumes(dmn_live *l, bool start, char *where, size_t size,
                                               struct pvx_diag *d);
/* The mean of the next `sets` becomes the background, 0 removes it; and the state of that request (background.h).
 * From one thread at a time. */
PVX_MUST_CHECK pvx_err dmn_live_background(dmn_live *l, uint32_t sets, struct pvx_diag *d);
void dmn_live_background_state(dmn_live *l, struct dmn_background_state *out);
/* Asks whether pictures and rig belong together; and the state of that request (watch.h), with the residual of the
 * last set.  From one thread at a time. */
PVX_MUST_CHECK pvx_err dmn_live_check_begin(dmn_live *l, struct pvx_diag *d);
void dmn_live_check_state(dmn_live *l, struct dmn_check_request *out);
/* The latency statistics start anew with the next volume. */
void dmn_live_reset_latency(dmn_live *l);
/* Longest time since a stage's last heartbeat, ns. */
int64_t dmn_live_stuck_ns(dmn_live *l);
#endif
