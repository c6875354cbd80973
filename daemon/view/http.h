/* http.h - HTTP by libmicrohttpd: the page's files, and the upgrade to a WebSocket.
 *
 * It runs in view_http_run, without a thread of its own.  Nothing of a request is written anywhere.  Every connection
 * serves one request and has VIEW_HTTP_PATIENCE_NS to make it.  The number of connections that wait is bounded.
 * Threads: one. */
#ifndef VIEW_HTTP_H
#define VIEW_HTTP_H
#include <poll.h>
#include <stdint.h>
#include "daemon/view/gate.h"

#define VIEW_HTTP_CLIENTS     64
#define VIEW_HTTP_HEADERS     16384
#define VIEW_HTTP_PATIENCE_NS 10000000000LL
#define VIEW_PATH             "/live"
#define VIEW_SUBPROTOCOL      "pyrovox.1"

struct view_http_stats {
    uint64_t requests, refused_host, refused_origin, late;
};
struct view_http_params {
    const struct view_gate *gate;  /* borrowed */
    const char *listen;            /* ADDRESS:PORT; port 0: any */
    const char *cert, *key;        /* PEM files, both or none */
    void (*say)(const char *line); /* with a certificate: see tls.h */
    /* fd is non-blocking, and lives until view_http_drop(handle). */
    void (*upgraded)(void *ctx, int fd, void *handle, const void *early, size_t n_early);
    void *ctx;
};
typedef struct view_http view_http;
/* Errors: PVX_EINVAL (the address; other hosts reach it and there is no certificate), PVX_EBUSY (in use), PVX_EFORMAT
 * (certificate and key), PVX_ESTALE (the certificate has expired), PVX_ENOENT, PVX_EPERM, PVX_EIO. */
PVX_MUST_CHECK pvx_err view_http_new(const struct view_http_params *p, view_http **out,
                                     struct pvx_diag *d);
void view_http_free(view_http **h); /* after every handle was dropped */
/* Where it listens, "127.0.0.1:8737"; valid as long as h. */
const char *view_http_at(const view_http *h);
#define VIEW_HTTP_FDS 2
int view_http_fds(const view_http *h, struct pollfd out[VIEW_HTTP_FDS]); /* to wait for; count */
int64_t view_http_due_ns(const view_http *h); /* mono clock: run it then at the latest */
void view_http_run(view_http *h);
void view_http_drop(void *handle);
void view_http_stats(const view_http *h, struct view_http_stats *out);
#endif
