/* gate.h - which requests are let in: addresses, Host and Origin, the token.
 *
 * A browser lets any site's page open a WebSocket to this host, and any name resolve to it (DNS rebinding).  So a
 * request is answered only if Host names the address that the connection really came to, or a name that was given,
 * and if Origin, when there is one, is the page of that same Host.  Addresses are parsed, never compared by their
 * beginning.  The token is asked for on loopback too, as other users of the host can connect there.
 * Threads: pure, except for the token's file. */
#ifndef VIEW_GATE_H
#define VIEW_GATE_H
#include <stdbool.h>
#include <stddef.h>
#include <sys/socket.h>
#include "base/err.h"
#include "daemon/view/words.h"

#define VIEW_HOSTS_MAX 8

struct view_gate {
    bool tls;
    const char
        *host[VIEW_HOSTS_MAX]; /* names and addresses that the page is reached by; borrowed */
    size_t n_hosts;
    char token[VIEW_TOKEN_DIGITS + 1];
};

/* Parses ADDRESS:PORT or [ADDRESS]:PORT; no name is looked up.  A port alone, or localhost, means 127.0.0.1. */
PVX_MUST_CHECK pvx_err view_gate_address(const char *text, struct sockaddr_storage *out,
                                         socklen_t *len, struct pvx_diag *d);
/* Checks a name or an address (IPv6 in brackets) by which a page is reached; it has no port. */
PVX_MUST_CHECK pvx_err view_gate_name(const char *text, struct pvx_diag *d);
bool view_gate_loopback(const struct sockaddr_storage *a);

/* host: the request's Host, NULL none; here: the address that the connection came to. */
bool view_gate_host(const struct view_gate *g, const char *host,
                    const struct sockaddr_storage *here);
/* origin: the request's Origin, NULL none, as programs send none. */
bool view_gate_origin(const struct view_gate *g, const char *origin, const char *host);
/* Takes a time that does not depend on where the tokens differ. */
bool view_gate_token(const struct view_gate *g, const char *token);

/* A fresh token. */
PVX_MUST_CHECK pvx_err view_gate_make_token(char out[VIEW_TOKEN_DIGITS + 1], struct pvx_diag *d);
/* Reads the token from the file, or makes the file, mode 0600, if it is not there.  PVX_EPERM: others may read it;
 * PVX_EFORMAT. */
PVX_MUST_CHECK pvx_err view_gate_read_token(const char *path, char out[VIEW_TOKEN_DIGITS + 1],
                                            struct pvx_diag *d);
#endif
