/* control.h - the control socket: one JSON object in, one out, over ZeroMQ REQ/REP.
 *
 *   {"cmd":"ping"}                        {"ok":true,"pong":...}
 *   {"cmd":"status"}                      the state (state.h)
 *   {"cmd":"log-level","level":"debug"}   {"ok":true}
 *   {"cmd":"reset-latency"}               {"ok":true}; the latency statistics start anew
 *   {"cmd":"record","action":"start","path":"/data/a.h5"}   {"ok":true,"path":...}; path may be left out
 *   {"cmd":"record","action":"stop"}      {"ok":true,"path":...}; answers when the take is closed
 *   {"cmd":"background","sets":64}        {"ok":true,"request":1}; the mean of the next sets will be subtracted from
 *                                         then on; 0: none any more, nor is one taken
 *   {"cmd":"background"}                  {"ok":true,"request":1,"state":"taking","sets":64,"have":12}, "done", or
 *                                         "failed" with "why" (a flame in it); "none": nobody asked for one
 *   {"cmd":"stop"}                        {"ok":true}; the daemon drains and ends
 * Anything else, or more than DMN_REQUEST_MAX bytes: {"error":"..."}.
 * A second daemon on the same endpoint is refused (proto/ipc.h).
 * Threads: a thread of its own; the calls in dmn_control_ops come from it, and should answer at once. */
#ifndef DMN_CONTROL_H
#define DMN_CONTROL_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"
#include "proto/auth.h"
#include "daemon/control/state.h"

#define DMN_REQUEST_MAX 4096
#define DMN_REPLY_MAX   (448u << 10)

struct dmn_control_ops {
    size_t (*status)(void *ctx, char *out, size_t size); /* JSON; 0 = does not fit */
    void (*reset_latency)(void *ctx);
    void (*stop)(void *ctx);
    /* Begin (path NULL: as configured) or end a take; where = its file.  NULL = cannot. */
    pvx_err (*record)(void *ctx, bool start, const char *path, char *where, size_t size,
                      struct pvx_diag *d);
    void *ctx;
    /* Begin to take a background of so many sets, and what became of it; NULL = cannot. */
    pvx_err (*background)(void *ctx, uint32_t sets, struct pvx_diag *d);
    void (*background_state)(void *ctx, struct dmn_background_state *out);
    bool remote; /* a request may not say which file to write; dmn_control_new sets it */
};

/* Answer one request; returns the reply's length (at least 2, 0-terminated beyond).  size >= 256. */
size_t dmn_control_handle(const struct dmn_control_ops *ops, const void *request, size_t len,
                          char *reply, size_t size);

typedef struct dmn_control dmn_control;
/* auth, borrowed: only clients with a key of role control come in, and none of them names a file; NULL: whoever
 * reaches the endpoint.  Errors: PVX_EBUSY (in use: says which), PVX_EINVAL (endpoint). */
PVX_MUST_CHECK pvx_err dmn_control_new(const char *endpoint, pvp_auth *auth,
                                       const struct dmn_control_ops *ops, dmn_control **out,
                                       struct pvx_diag *d);
void dmn_control_free(dmn_control **c);
#endif
