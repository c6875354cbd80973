/* door.h - what happens to connections during the handshake: refusals, seen from either side.
 *
 * Owner: caller; freed before the socket is closed.  Threads: the socket's. */
#ifndef PVP_DOOR_H
#define PVP_DOOR_H
#include <stdbool.h>
#include <stdint.h>
#include "base/err.h"

typedef struct pvp_door pvp_door;
/* For a socket that is not bound or connected yet. */
PVX_MUST_CHECK pvx_err pvp_door_new(void *zmq, void *socket, pvp_door **out);
void pvp_door_free(pvp_door **p);
/* A socket to poll together with the watched one. */
void *pvp_door_socket(const pvp_door *p);
/* For a server: connections since the last call that failed before the handler was asked about a key.  They had no
 * key, a key for another daemon, or spoke another protocol. */
uint64_t pvp_door_failed(pvp_door *p);
/* For a client: PVX_EPERM and the reason, once for each time that the daemon at `endpoint` refused it; PVX_OK: it
 * did not.  libzmq does not try again after a refusal.  has_key: whether the client has a key. */
PVX_MUST_CHECK pvx_err pvp_door_refused(pvp_door *p, const char *endpoint, bool has_key,
                                        struct pvx_diag *d);
#endif
