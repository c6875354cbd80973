/* endpoints.h - the default endpoints of the daemon and of its clients.
 *
 * Under systemd (RuntimeDirectory=pyrovox): ipc:///run/pyrovox/{volumes,control}.  Started by hand:
 * ipc:///tmp/pyrovox-UID/{volumes,control}, in a folder of mode 0700 that belongs to the user, so
 * that two users' daemons do not collide and no other user can listen in.
 * Threads: any. */
#ifndef DMN_ENDPOINTS_H
#define DMN_ENDPOINTS_H
#include <stdbool.h>
#include "daemon/config/config.h"
#include "proto/pvp.h"

enum dmn_endpoint { DMN_VOLUMES, DMN_CONTROL };

/* The daemon's default.  Static storage. */
const char *dmn_default_endpoint(enum dmn_endpoint kind);

/* A client's default: the user's own daemon if its socket is there, else the system's if its socket
 * is there, else the user's own (which may still come).  Static storage. */
const char *dmn_client_endpoint(enum dmn_endpoint kind);

/* Before binding: if `endpoint` lies in the /tmp/pyrovox-UID folder, make that folder (0700).
 * Anything else is left alone.  PVX_EPERM: the folder belongs to another user or others may write
 * to it (diag names it). */
PVX_MUST_CHECK pvx_err dmn_endpoint_prepare(const char *endpoint, struct pvx_diag *d);

/* Reach of an endpoint.  Within it, no client is asked for its identity. */
enum dmn_reach {
    DMN_REACH_FILE, /* ipc:// with a path: users that its folder's mode lets in */
    DMN_REACH_HOST, /* every user of this host: loopback addresses, abstract ipc://@ */
    DMN_REACH_NET   /* other hosts: all else, names and wildcards too */
};
enum dmn_reach dmn_endpoint_reach(const char *endpoint);
/* Whether clients of the endpoint need a key: keys are configured, and the endpoint is not one that needs none. */
bool dmn_endpoint_guarded(const struct dmn_config *c, const char *endpoint, enum dmn_endpoint kind);

/* publish.compress; `auto` is LZ4 where volumes go to other hosts, and none where all readers are on this one
 * (proto/README.md has the figures). */
enum pvp_compress dmn_endpoints_compress(const struct dmn_config *c);
/* The same of an endpoint by itself. */
enum pvp_compress dmn_endpoint_compress(const struct dmn_config *c, const char *endpoint);

/* Checks access: volumes may be open to this host, and control to a file.  Anything beyond that takes keys, or
 * `insecure: true` in the configuration.  *open: an endpoint of c that is open beyond that, for a warning; NULL =
 * none.  PVX_EPERM: open beyond that with neither (diag names key and remedy); PVX_EINVAL: only half of the keys is
 * given. */
PVX_MUST_CHECK pvx_err dmn_endpoints_allowed(const struct dmn_config *c, const char **open,
                                             struct pvx_diag *d);

#endif
