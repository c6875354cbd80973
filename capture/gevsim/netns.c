#include "capture/gevsim/netns.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <ifaddrs.h>
#include <linux/capability.h>
#include <linux/if_addr.h>
#include <linux/netlink.h>
#include <linux/rtnetlink.h>
#include <net/if.h>
#include <sched.h>
#include <stdio.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/syscall.h>
#include <unistd.h>

#define REMEDY                                                                                    \
    "allow it (sysctl kernel.unprivileged_userns_clone=1, user.max_user_namespaces=100, "         \
    "kernel.apparmor_restrict_unprivileged_userns=0), run as root, or add the addresses by hand " \
    "(sudo ip addr add 127.0.0.2/8 dev lo, and so on) and leave the private network out"

/* One rtnetlink request with room for a link or an address message and two attributes. */
struct request {
    struct nlmsghdr head;
    union {
        struct ifinfomsg link;
        struct ifaddrmsg addr;
    } body;
    unsigned char attrs[64];
};

static void add_attr(struct request *r, unsigned short type, const void *data, unsigned short len)
{
    struct rtattr *a = (struct rtattr *)((char *)r + NLMSG_ALIGN(r->head.nlmsg_len));
    a->rta_type = type;
    a->rta_len = (unsigned short)RTA_LENGTH(len);
    memcpy(RTA_DATA(a), data, len);
    r->head.nlmsg_len = NLMSG_ALIGN(r->head.nlmsg_len) + (uint32_t)RTA_ALIGN(a->rta_len);
}

/* Send and wait for the kernel's answer; 0 or an errno value. */
static int transact(int fd, struct request *r)
{
    struct {
        struct nlmsghdr head;
        struct nlmsgerr err;
        unsigned char more[512];
    } answer;
    r->head.nlmsg_flags |= NLM_F_REQUEST | NLM_F_ACK;
    if (send(fd, r, r->head.nlmsg_len, 0) < 0)
        return errno;
    ssize_t n = recv(fd, &answer, sizeof answer, 0);
    if (n < 0)
        return errno;
    if ((size_t)n < NLMSG_LENGTH(sizeof answer.err) || answer.head.nlmsg_type != NLMSG_ERROR)
        return EPROTO;
    return -answer.err.error;
}

static int lo_up(int fd, int index)
{
    struct request r = {
        .head = {.nlmsg_len = NLMSG_LENGTH(sizeof r.body.link), .nlmsg_type = RTM_NEWLINK}};
    r.body.link = (struct ifinfomsg){.ifi_index = index, .ifi_flags = IFF_UP, .ifi_change = IFF_UP};
    return transact(fd, &r);
}

static int lo_add(int fd, int index, uint32_t address_be)
{
    struct request r = {.head = {.nlmsg_len = NLMSG_LENGTH(sizeof r.body.addr),
                                 .nlmsg_type = RTM_NEWADDR,
                                 .nlmsg_flags = NLM_F_CREATE}};
    r.body.addr = (struct ifaddrmsg){.ifa_family = AF_INET,
                                     .ifa_prefixlen = 8,
                                     .ifa_scope = RT_SCOPE_HOST,
                                     .ifa_index = (uint32_t)index};
    add_attr(&r, IFA_LOCAL, &address_be, sizeof address_be);
    add_attr(&r, IFA_ADDRESS, &address_be, sizeof address_be);
    return transact(fd, &r);
}

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

/* Inside a user namespace one may map oneself only, and groups only after giving up setgroups. */
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

/* Ids other than 0 lose every capability at exec unless it is "ambient".  Failing is no error: GigE
 * streams then use plain UDP sockets. */
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
    /* Also for a root without the right to make namespaces, as in containers. */
    if (unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0)
        return refuse(d, "new user and network namespace", errno);
    int e = map_ids(uid, gid);
    if (e != 0)
        return refuse(d, "user id map", e);
    keep_net_raw();
    return PVX_OK;
}

static pvx_err set_up_lo(unsigned n, struct pvx_diag *d)
{
    int fd = socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_ROUTE);
    if (fd < 0)
        return refuse(d, "netlink socket", errno);
    int index = (int)if_nametoindex("lo");
    int e = index == 0 ? errno : lo_up(fd, index);
    for (unsigned i = 0; e == 0 && i < n; i++)
        e = lo_add(fd, index, htonl(INADDR_LOOPBACK + 1 + i));
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

static bool on_interface(const struct ifaddrs *list, const char *text)
{
    struct in_addr want;
    if (inet_pton(AF_INET, text, &want) != 1)
        return false;
    for (const struct ifaddrs *p = list; p != NULL; p = p->ifa_next) {
        if (p->ifa_addr == NULL || p->ifa_addr->sa_family != AF_INET)
            continue;
        struct sockaddr_in sa;
        memcpy(&sa, p->ifa_addr, sizeof sa);
        if (sa.sin_addr.s_addr == want.s_addr)
            return true;
    }
    return false;
}

bool cap_netns_have(const char *first, unsigned n)
{
    struct ifaddrs *list;
    if (getifaddrs(&list) != 0)
        return false;
    bool all = true;
    for (unsigned i = 0; all && i < n; i++) {
        char text[16];
        all = cap_netns_address(first, i, text) == PVX_OK && on_interface(list, text);
    }
    freeifaddrs(list);
    return all;
}
