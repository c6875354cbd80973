/* netns.h - a private loopback network with extra addresses, for an ordinary user.
 *
 * New user + network namespace for the calling process (single-threaded at that time): lo is up and
 * has 127.0.0.2 .. 127.0.0.(1+n).  Sockets inside cannot reach out; ipc:// endpoints (files) can.
 * As root the user namespace is left out.  Errors: PVX_EPERM with the remedy (sysctl, or
 * `ip netns`), PVX_EUNSUP. */
#ifndef CAP_NETNS_H
#define CAP_NETNS_H
#include "base/err.h"
PVX_MUST_CHECK pvx_err cap_netns_enter(unsigned n_addresses, struct pvx_diag *d);
#endif
