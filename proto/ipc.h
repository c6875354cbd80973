/* ipc.h - one owner per ipc:// endpoint.
 *
 * libzmq removes the file of an ipc:// endpoint and binds again without checking whether its owner
 * is alive.  A second daemon would silently cut off the first.  A claim holds flock() on PATH.lock:
 * the lock ends with its owner.
 * Endpoints that are not files (tcp://, ipc://@name) are claimed by bind itself: no-op here.
 * Threads: a claim belongs to one thread at a time. */
#ifndef PVP_IPC_H
#define PVP_IPC_H
#include "base/err.h"

typedef struct pvp_ipc_claim pvp_ipc_claim;

/* Before zmq_bind.  *out = NULL for endpoints that need no claim.  PVX_EBUSY: in use (diag names the endpoint, the
 * owner's pid if known, and the remedy); PVX_ENOENT, PVX_EPERM: of the folder. */
PVX_MUST_CHECK pvx_err pvp_ipc_claim_new(const char *endpoint, pvp_ipc_claim **out,
                                         struct pvx_diag *d);
/* After the socket is closed: removes the socket's file and the lock. */
void pvp_ipc_claim_free(pvp_ipc_claim **c);
#endif
