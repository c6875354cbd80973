/* control.h - the control socket: one JSON object in, one out, over ZeroMQ REQ/REP.
 *
 * The table in commands.h has the requests.  CONTROL.md describes requests and answers.
 * A second daemon on the same endpoint is refused (proto/ipc.h).  An ipc:// endpoint may be systemd's (socket
 * activation): the first request starts the daemon, which answers it.
 * Threads: a thread of its own.  It calls dmn_control_ops, which should return at once. */
#ifndef DMN_CONTROL_H
#define DMN_CONTROL_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"
#include "proto/auth.h"
#include "daemon/config/config.h"
#include "daemon/control/state.h"

#define DMN_REQUEST_MAX 4096
#define DMN_REPLY_MAX   (448u << 10)

struct dmn_control_ops {
    size_t (*status)(void *ctx, char *out, size_t size); /* JSON; 0 = does not fit */
    void (*reset_latency)(void *ctx);
    void (*stop)(void *ctx);
    /* Begin (path NULL: as configured; without a slash: that name in the same folder) or end a take; where = its
     * file.  NULL = cannot. */
    pvx_err (*record)(void *ctx, bool start, const char *path, char *where, size_t size,
                      struct pvx_diag *d);
    /* The same for volumes, where the configuration says. */
    /* name NULL: a trigger without a name; *t_ns: its instant */
    pvx_err (*trigger)(void *ctx, const char *name, int64_t *t_ns, struct pvx_diag *d);
    pvx_err (*record_volumes)(void *ctx, bool start, char *where, size_t size, struct pvx_diag *d);
    /* One frame set, its volume and the status into a folder, named as a take.  NULL = cannot. */
    pvx_err (*snapshot)(void *ctx, const char *path, char *where, size_t size, struct pvx_diag *d);
    void *ctx;
    /* Begin to take a background of so many sets, and give the state of that; NULL = cannot. */
    pvx_err (*background)(void *ctx, uint32_t sets, struct pvx_diag *d);
    void (*background_state)(void *ctx, struct dmn_background_state *out);
    /* Begin to compare pictures and rig, and give the state of that; NULL = cannot. */
    pvx_err (*check)(void *ctx, struct pvx_diag *d);
    void (*check_state)(void *ctx, struct dmn_check_request *out);
    /* config gives the options in effect, which the control thread owns.  apply takes others, which differ in options
     * that may change while the daemon runs (dmn_option_live).  NULL = cannot. */
    const struct dmn_config *(*config)(void *ctx);
    pvx_err (*apply)(void *ctx, const struct dmn_config *c, struct pvx_diag *d);
    pvx_err (*reload_keys)(void *ctx, struct pvx_diag *d); /* NULL = cannot */
    bool remote; /* a request may not say which file to write; dmn_control_new sets it */
};

/* Answer one request; returns the reply's length (at least 2, 0-terminated beyond).  size >= 512. */
size_t dmn_control_handle(const struct dmn_control_ops *ops, const void *request, size_t len,
                          char *reply, size_t size);

typedef struct dmn_control dmn_control;
/* auth (borrowed): only clients with a key of role control are let in, and they may not give a path; NULL: every
 * client that reaches the endpoint is let in.  Errors: PVX_EBUSY (in use: says which), PVX_EINVAL (endpoint). */
PVX_MUST_CHECK pvx_err dmn_control_new(const char *endpoint, pvp_auth *auth,
                                       const struct dmn_control_ops *ops, dmn_control **out,
                                       struct pvx_diag *d);
void dmn_control_free(dmn_control **c);
#endif
