/* auth.h - access control for network sockets: CURVE (RFC 26) and a ZAP handler (RFC 27) with a list of clients.
 *
 * A guarded socket lets in only a client that proves to have the secret half of a listed key with the required role.
 * The socket names the role to the handler by its ZAP domain, and refuses everybody while no handler answers.  CURVE
 * hides the contents of messages, but not their number, size and time.
 * A reload counts a generation up if a client lost rights, or if the daemon's key changed.  The owner of a guarded
 * socket then closes it and opens it again, so that every connected client has to prove its key again.
 * Threads: any.  Owner: caller; the sockets are closed, and the handlers ended, before it is freed. */
#ifndef PVP_AUTH_H
#define PVP_AUTH_H
#include <stdint.h>
#include "proto/keys.h"

typedef struct pvp_auth pvp_auth;

/* server: a .key file, clients: a list.  Errors: those of keys.h. */
PVX_MUST_CHECK pvx_err pvp_auth_new(const char *server, const char *clients, pvp_auth **out,
                                    struct pvx_diag *d);
void pvp_auth_free(pvp_auth **a);
/* Reads key and list again.  On error both stay unchanged. */
PVX_MUST_CHECK pvx_err pvp_auth_reload(pvp_auth *a, struct pvx_diag *d);
uint64_t pvp_auth_generation(const pvp_auth *a);
size_t pvp_auth_clients(const pvp_auth *a); /* listed */
/* Refused connections: those with an unlisted key or a key of another role, and those counted as failed. */
uint64_t pvp_auth_refused(const pvp_auth *a);
/* Adds n connections that had no key, or the key of another daemon (door.h). */
void pvp_auth_count_failed(pvp_auth *a, uint64_t n);

/* Call it before binding, after pvp_zap_new of the same context. */
PVX_MUST_CHECK pvx_err pvp_auth_guard(const pvp_auth *a, void *socket, enum pvp_role role);

/* The thread that answers for the guarded sockets of one ZeroMQ context. */
typedef struct pvp_zap pvp_zap;
PVX_MUST_CHECK pvx_err pvp_zap_new(pvp_auth *a, void *zmq, pvp_zap **out, struct pvx_diag *d);
void pvp_zap_free(pvp_zap **z); /* after the sockets, before the context */

/* Sets the key of a client's socket, before it connects.  PVX_EFORMAT: the key file has no server key. */
PVX_MUST_CHECK pvx_err pvp_auth_client(void *socket, const char *key_file, struct pvx_diag *d);
#endif
