/* beside.h - volumes recorded beside the daemon by `pyrovox record`, a process of its own.  It subscribes as any
 * other client does, so that no flush of a disk and no fault of a writer reaches the frame path.
 *
 * A thread here watches the process.  The process ends with the daemon: on the `end` message if the daemon ends in
 * order, by a signal if the daemon is killed.  A process that dies is started again with a new recording, at most
 * BESIDE_TRIES times in a row.  It is not started again if it says why it ends (disk full, folder gone).
 * Name: record.volumes_path, the session, and for a second recording of the same session its number.
 * Threads: start and stop from any, one at a time; state from any; the rest from one. */
#ifndef DMN_BESIDE_H
#define DMN_BESIDE_H
#include "daemon/config/config.h"
#include "daemon/control/state.h"

typedef struct dmn_beside dmn_beside;
/* PVX_EINVAL: record.volumes is on, but every endpoint asks this host for a key (diag: remedy). */
PVX_MUST_CHECK pvx_err dmn_beside_new(const struct dmn_config *c, uint64_t session,
                                      dmn_beside **out, struct pvx_diag *d);
/* where = the recording's file or folder.  PVX_EBUSY: it runs already; PVX_ENOENT: there is no program `pyrovox`
 * beside the daemon's. */
PVX_MUST_CHECK pvx_err dmn_beside_start(dmn_beside *b, char *where, size_t size,
                                        struct pvx_diag *d);
/* Ends it in order.  PVX_ENOENT: none runs; PVX_ETIMEDOUT: it had to be killed; PVX_EIO: it had ended before. */
PVX_MUST_CHECK pvx_err dmn_beside_stop(dmn_beside *b, char *where, size_t size, struct pvx_diag *d);
/* Call after `end` has been published.  Waits a limited time until all is on the disk.  b may be NULL. */
void dmn_beside_end(dmn_beside *b);
void dmn_beside_state(dmn_beside *b, struct dmn_beside_state *out); /* b may be NULL */
void dmn_beside_free(dmn_beside **b);
#endif
