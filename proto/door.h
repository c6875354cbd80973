/* door.h - what becomes of connections before they say anything: who was refused, seen from either side.
 *
 * Owner: caller; freed before the socket is closed.  Threads: the socket's. */
#ifndef PVP_DOOR_H
#define PVP_DOOR_H
#include <stdbool.h>
#include <stdint.h>
#include "base/err.h"

typedef struct pvp_door pvp_door;
/* Of a socket that is not bound or connected yet. */
PVX_MUST_CHECK pvx_err pvp_door_new(void *zmq, void *socket, pvp_door **out);
void pvp_door_free(pvp_door **p);
/* A socket to poll beside the one that is watched. */
void *pvp_door_socket(const pvp_door *p);
/* A server's: connections since the last call that ended without its having been asked about a key: they had none,
 * one for another daemon, or spoke something else. */
uint64_t pvp_door_failed(pvp_door *p);
/* A client's: PVX_EPERM and why, once for each time that the daemon at `endpoint` turned it away; PVX_OK: it did not.
 * libzmq does not try again after that.  has_key: whether the client came with one. */
PVX_MUST_CHECK pvx_err pvp_door_refused(pvp_door *p, const char *endpoint, bool has_key,
                                        struct pvx_diag *d);
#endif
