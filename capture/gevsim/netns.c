#include "capture/gevsim/netns.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/capability.h>
#include <net/if.h>
#include <sched.h>
#include <stdio.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#define REMEDY                                                                                    \
    "allow it (sysctl kernel.unprivileged_userns_clone=1, user.max_user_namespaces=100, "         \
    "kernel.apparmor_restrict_unprivileged_userns=0), run as root, or add the addresses by hand " \
    "(sudo ip addr add 127.0.0.2/8 dev lo, and so on) and leave the private network out"

static int put_file(const char *path, const char *text)
{
    int fd = open(path, O_WRONLY | O_CLOEXEC);
    if (fd < 0)
        return errno;
    ssize_t n = write(fd, text, strlen(text));
    int e = n < 0 ? errno : 0;
    close(fd);
    return e;
}

/* In a user namespace a process may map only itself, and groups only after it has given up setgroups. */
static int map_ids(unsigned uid, unsigned gid)
{
    char map[64];
    int e = put_file("/proc/self/setgroups", "deny");
    if (e != 0 && e != ENOENT)
        return e;
    snprintf(map, sizeof map, "%u %u 1\n", uid, uid);
    if ((e = put_file("/proc/self/uid_map", map)) != 0)
        return e;
    snprintf(map, sizeof map, "%u %u 1\n", gid, gid);
    return put_file("/proc/self/gid_map", map);
}

/* Ids other than 0 lose every capability at exec, except "ambient" ones.  A failure is not an error: GigE streams
 * then use plain UDP sockets. */
static void keep_net_raw(void)
{
    struct __user_cap_header_struct head = {.version = _LINUX_CAPABILITY_VERSION_3};
    struct __user_cap_data_struct data[2];
    if (syscall(SYS_capget, &head, data) != 0)
        return;
    data[0].inheritable |= 1u << CAP_NET_RAW;
    if (syscall(SYS_capset, &head, data) == 0)
        (void)prctl(PR_CAP_AMBIENT, PR_CAP_AMBIENT_RAISE, CAP_NET_RAW, 0, 0);
}

static pvx_err refuse(struct pvx_diag *d, const char *what, int errnum)
{
    if (errnum == EINVAL)
        return pvx_fail(d, PVX_EINVAL, "private network: %s: threads are running already", what);
    if (errnum == ENOSYS)
        return pvx_fail(d, PVX_EUNSUP, "private network: %s: not in this kernel", what);
    if (errnum == EPERM || errnum == EACCES || errnum == ENOSPC || errnum == EUSERS)
        return pvx_fail(d, PVX_EPERM, "private network: %s: %s; %s", what, strerror(errnum),
                        REMEDY);
    return pvx_fail(d, pvx_err_from_errno(errnum), "private network: %s: %s", what,
                    strerror(errnum));
}

static pvx_err enter_namespaces(struct pvx_diag *d)
{
    unsigned uid = geteuid(), gid = getegid();
    if (uid == 0 && unshare(CLONE_NEWNET) == 0)
        return PVX_OK;
    /* Also for root without the right to make namespaces, as in containers. */
    if (unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0)
        return refuse(d, "new user and network namespace", errno);
    int e = map_ids(uid, gid);
    if (e != 0)
        return refuse(d, "user id map", e);
    keep_net_raw();
    return PVX_OK;
}

/* Each address is an alias, lo:1 and so on, with the mask of 127.0.0.0/8 and the scope of the host. */
static pvx_err set_up_lo(unsigned n, struct pvx_diag *d)
{
    int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    if (fd < 0)
        return refuse(d, "socket", errno);
    struct ifreq r = {.ifr_name = "lo", .ifr_flags = IFF_UP};
    int e = ioctl(fd, SIOCSIFFLAGS, &r) == 0 ? 0 : errno;
    for (unsigned i = 0; e == 0 && i < n; i++) {
        struct sockaddr_in a = {.sin_family = AF_INET,
                                .sin_addr.s_addr = htonl(INADDR_LOOPBACK + 1 + i)};
        snprintf(r.ifr_name, sizeof r.ifr_name, "lo:%u", i + 1);
        memcpy(&r.ifr_addr, &a, sizeof a);
        e = ioctl(fd, SIOCSIFADDR, &r) == 0 ? 0 : errno;
    }
    close(fd);
    return e == 0 ? PVX_OK : refuse(d, "addresses of lo", e);
}

pvx_err cap_netns_enter(unsigned n_addresses, struct pvx_diag *d)
{
    if (n_addresses < 1 || n_addresses > CAP_NETNS_MAX_ADDRESSES)
        return pvx_fail(d, PVX_EINVAL, "private network: %u addresses; 1 to %d are possible",
                        n_addresses, CAP_NETNS_MAX_ADDRESSES);
    PVX_TRY(enter_namespaces(d));
    return set_up_lo(n_addresses, d);
}

pvx_err cap_netns_address(const char *first, unsigned i, char out[16])
{
    struct in_addr a;
    if (inet_pton(AF_INET, first, &a) != 1 || i > 0xffffu)
        return PVX_EINVAL;
    uint32_t host = ntohl(a.s_addr);
    if ((host & 0xffu) + i > 254) /* stay in the last byte: no broadcast, no carry */
        return PVX_EINVAL;
    a.s_addr = htonl(host + i);
    return inet_ntop(AF_INET, &a, out, 16) != NULL ? PVX_OK : PVX_EINVAL;
}
