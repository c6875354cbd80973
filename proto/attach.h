/* attach.h - zmq_bind and zmq_connect for every endpoint that a person may write.
 *
 * libzmq knows IPv6 only where ZMQ_IPV6 is set, and then prefers it for names: a client of "localhost" would wait for
 * ever for a daemon on 127.0.0.1.  So it is set for an endpoint that needs it: [ADDRESS], a wildcard to bind, a name
 * that has no IPv4 address.  To bind, "localhost" is 127.0.0.1, and no other name is looked up.
 * Threads: those of the socket.  A connection to a name may wait for the name server. */
#ifndef PVP_ATTACH_H
#define PVP_ATTACH_H
#include "base/err.h"

/* Returns 0, or -1 with errno, as zmq_connect does. */
int pvp_connect(void *socket, const char *endpoint);
/* PVX_EBUSY, PVX_EINVAL, PVX_EIO (diag: cause and remedy). */
PVX_MUST_CHECK pvx_err pvp_bind(void *socket, const char *endpoint, struct pvx_diag *d);
#endif
