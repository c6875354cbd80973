/* netns.h - a private loopback network with extra addresses, for an ordinary user.
 *
 * Makes a new user and network namespace for the calling process, which must be single-threaded.  In it, lo is up and
 * has 127.0.0.2 .. 127.0.0.(1+n).  Sockets inside cannot reach out; ipc:// endpoints (files) can.
 * User and group ids stay the same.  Programs that are run from here keep CAP_NET_RAW of the private network, so that
 * GigE streams may use packet sockets as for root.  As root there is no user namespace. */
#ifndef CAP_NETNS_H
#define CAP_NETNS_H
#include "base/err.h"

#define CAP_NETNS_MAX_ADDRESSES 253

/* n_addresses 1..CAP_NETNS_MAX_ADDRESSES.  Errors: PVX_EPERM with the remedy (sysctl, or
 * `ip netns`), PVX_EINVAL (range, or threads are running), PVX_EUNSUP, PVX_EIO. */
PVX_MUST_CHECK pvx_err cap_netns_enter(unsigned n_addresses, struct pvx_diag *d);

/* Dotted text of the i-th address after `first` ("127.0.0.2", 3 -> "127.0.0.5").  PVX_EINVAL: not
 * an IPv4 address, or past its end. */
PVX_MUST_CHECK pvx_err cap_netns_address(const char *first, unsigned i, char out[16]);
#endif
