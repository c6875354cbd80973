/* tls.h - TLS by GnuTLS in front of the HTTP server, which sees plain connections.
 *
 * libmicrohttpd has TLS of its own.  But an upgraded connection is left with the eight bytes that its memory pool
 * keeps for emergencies: 4 bytes a record and 2 kB/s (measured, 0.9.75).  Here records have 16 kB.  A connection has
 * a socket pair: one end is the server's, and bytes go from the other through GnuTLS.
 * At most 16 kB wait each way here, PAIR_BYTES in the pair, and what TCP_NOTSENT_LOWAT allows in the kernel.
 * Threads: one. */
#ifndef VIEW_TLS_H
#define VIEW_TLS_H
#include <stdbool.h>
#include <stdint.h>
#include <sys/socket.h>
#include "base/err.h"

typedef struct view_tls view_tls;

struct view_tls_params {
    int listen;               /* non-blocking; owned by view_tls from now on */
    const char *cert, *key;   /* PEM files; checked for each new connection, as they are renewed */
    unsigned connections;     /* at most */
    int64_t patience_ns;      /* for a handshake */
    void (*prepare)(int tcp); /* options of a fresh connection's socket */
    /* A connection has done its handshake.  fd is the server's end, and owned by the server.  false: it is
     * refused. */
    bool (*come)(void *ctx, int fd, const struct sockaddr *from, socklen_t len);
    void *ctx;
    void (*say)(const char *line); /* that they were read again, or cannot be */
};
/* Errors: those of view_certificate, PVX_ENOMEM, PVX_EIO; listen is then closed. */
PVX_MUST_CHECK pvx_err view_tls_new(const struct view_tls_params *p, view_tls **out,
                                    struct pvx_diag *d);
void view_tls_free(view_tls **t);
int view_tls_fd(const view_tls *t);         /* readable when view_tls_run has something to do */
int64_t view_tls_due_ns(const view_tls *t); /* mono clock: run it then at the latest */
void view_tls_run(view_tls *t);
/* The address that the connection whose server's end is fd came to.  false: none of these. */
bool view_tls_here(const view_tls *t, int fd, struct sockaddr_storage *out);
uint64_t view_tls_late(const view_tls *t); /* connections that did not shake hands in time */
#endif
