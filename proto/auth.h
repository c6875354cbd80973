/* auth.h - who may come in over the network: CURVE (RFC 26) and a ZAP handler (RFC 27) that knows a list.
 *
 * A guarded socket lets in who proves to have the secret half of a listed key with the role that it asks
 * for, and nobody else: it asks by name (its ZAP domain is that of the role), and turns everybody away
 * where nobody answers.  What CURVE hides is what is said, not that something is said, how much and when.
 * What is read again counts a generation up where somebody may do less than before, or the daemon's key is another: who
 * guards a socket then closes it and opens it anew, so that whoever is connected has to prove it again.
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
/* Key and list again.  On error both stay as they were. */
PVX_MUST_CHECK pvx_err pvp_auth_reload(pvp_auth *a, struct pvx_diag *d);
uint64_t pvp_auth_generation(const pvp_auth *a);
size_t pvp_auth_clients(const pvp_auth *a); /* listed */
/* Connections: with a key that is not listed, or of another role, and those that were counted as failed. */
uint64_t pvp_auth_refused(const pvp_auth *a);
/* Connections that came without a key, or with another daemon's (door.h). */
void pvp_auth_count_failed(pvp_auth *a, uint64_t n);

/* Before binding, after pvp_zap_new of the same context. */
PVX_MUST_CHECK pvx_err pvp_auth_guard(const pvp_auth *a, void *socket, enum pvp_role role);

/* The thread that answers for the guarded sockets of one ZeroMQ context. */
typedef struct pvp_zap pvp_zap;
PVX_MUST_CHECK pvx_err pvp_zap_new(pvp_auth *a, void *zmq, pvp_zap **out, struct pvx_diag *d);
void pvp_zap_free(pvp_zap **z); /* after the sockets, before the context */

/* A client's socket, before it connects.  PVX_EFORMAT: the key file has no server's key. */
PVX_MUST_CHECK pvx_err pvp_auth_client(void *socket, const char *key_file, struct pvx_diag *d);
#endif
