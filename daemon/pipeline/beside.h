/* beside.h - volumes recorded beside the daemon: `pyrovox record`, a process of its own that subscribes as any
 * other does, so that no flush of a disk and no fault of a writer reaches the frame path.
 *
 * It is begun and watched by a thread here, and ends with the daemon: by the `end` message when that ends in order, by a
 * signal when it is killed.  One that dies is begun anew in a recording of its own, at most BESIDE_TRIES times in
 * a row; one that says why it ends (disk full, folder gone) is not.
 * Where it goes: record.volumes_path, the session, and for a second one of the same session its number.
 * Threads: start and stop from any, one at a time; state from any; the rest from one. */
#ifndef DMN_BESIDE_H
#define DMN_BESIDE_H
#include "daemon/config/config.h"
#include "daemon/control/state.h"

typedef struct dmn_beside dmn_beside;
/* PVX_EINVAL: record.volumes is on, but there is no endpoint of this host that needs no key (diag: remedy). */
PVX_MUST_CHECK pvx_err dmn_beside_new(const struct dmn_config *c, uint64_t session,
                                      dmn_beside **out, struct pvx_diag *d);
/* where = its file or folder.  PVX_EBUSY: it runs; PVX_ENOENT: no program `pyrovox` beside the daemon's. */
PVX_MUST_CHECK pvx_err dmn_beside_start(dmn_beside *b, char *where, size_t size,
                                        struct pvx_diag *d);
/* Closed in order.  PVX_ENOENT: none runs; PVX_ETIMEDOUT: it had to be killed; PVX_EIO: it had ended before. */
PVX_MUST_CHECK pvx_err dmn_beside_stop(dmn_beside *b, char *where, size_t size, struct pvx_diag *d);
/* After `end` has been published: waits until all is on the disk, within bounds.  b may be NULL. */
void dmn_beside_end(dmn_beside *b);
void dmn_beside_state(dmn_beside *b, struct dmn_beside_state *out); /* b may be NULL */
void dmn_beside_free(dmn_beside **b);
#endif
