/* gvnet.c - one thread for all cameras: sockets, timers, the trigger line, the switch. */
#include "capture/gevsim/gvnet.h"

#include <arpa/inet.h>
#include <errno.h>
#include <math.h>
#include <poll.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/prctl.h>
#include <time.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/mem.h"
#include "capture/gevsim/gevsim.h"

#define MAX_SOCKETS  600
#define IDLE_NS      PVX_NS_PER_S /* longest sleep of the thread */
#define LINK_BUFFER  (512u << 10)
#define READ_AT_ONCE 64 /* datagrams of one socket before the next socket is read */

struct cap_gvnet {
    pthread_t thread;
    pthread_mutex_t lock;
    pthread_cond_t looked;
    int wake; /* eventfd */
    bool stop;
    bool polling;   /* the thread waits for sockets, which keeps them open */
    uint64_t polls; /* how often it has waited */
    struct cap_gvcam *cams;
    struct caster {
        int fd;
        struct in_addr addr;
        struct caster *next;
    } * casters; /* sockets for broadcasts */
    struct gvcam_link link;
    double line_hz;
    int64_t line_tick;
};

struct gvcam_link *gvnet_link(cap_gvnet *n)
{
    return &n->link;
}

/* ---- switch ----------------------------------------------------------------------------------- */

void cap_gvnet_link(cap_gvnet *n, double mbit_s, size_t buffer_bytes)
{
    gvnet_lock(n);
    n->link.bytes_per_ns = mbit_s > 0 ? mbit_s * 1e6 / 8 / 1e9 : 0;
    n->link.buffer = buffer_bytes > 0 ? buffer_bytes : LINK_BUFFER;
    n->link.level = 0;
    n->link.at = pvx_now_real();
    gvnet_unlock(n);
}

void cap_gvnet_reboot(cap_gvnet *n, double seconds)
{
    gvnet_lock(n);
    n->link.silent_until = pvx_now_real() + (int64_t)(seconds * 1e9);
    gvnet_unlock(n);
}

void cap_gvnet_show(cap_gvnet *n, int64_t image)
{
    gvnet_lock(n);
    n->link.shown = image < 0 ? 0 : image + 1;
    gvnet_unlock(n);
}

/* ---- trigger line ------------------------------------------------------------------------------ */

static void gvnet_edge(struct cap_gvnet *n, int64_t at)
{
    n->link.line_level = 1; /* the pulse lasts until the frame has been described */
    for (struct cap_gvcam *c = n->cams; c != NULL; c = c->next)
        gvcam_trigger(c, GVCAM_LINE1, at);
    n->link.line_level = 0;
}

static int64_t pulse_ns(int64_t k, double hz)
{
    return (int64_t)llroundl((long double)k * 1e9L / hz);
}

static int64_t line_step(struct cap_gvnet *n, int64_t now)
{
    if (n->line_hz <= 0)
        return GVCAM_NEVER;
    if (now - pulse_ns(n->line_tick, n->line_hz) > PVX_NS_PER_S)
        n->line_tick = (int64_t)((long double)now * n->line_hz / 1e9L);
    while (pulse_ns(n->line_tick + 1, n->line_hz) <= now)
        gvnet_edge(n, pulse_ns(++n->line_tick, n->line_hz));
    return pulse_ns(n->line_tick + 1, n->line_hz);
}

void cap_gvnet_line(cap_gvnet *n, double hz)
{
    gvnet_lock(n);
    n->line_hz = hz;
    n->line_tick = (int64_t)((long double)pvx_now_real() * hz / 1e9L);
    gvnet_unlock(n);
}

void cap_gvnet_pulse(cap_gvnet *n)
{
    gvnet_lock(n);
    gvnet_edge(n, pvx_now_real());
    gvnet_unlock(n);
}

/* ---- sockets ---------------------------------------------------------------------------------- */

static void broadcast(struct cap_gvnet *n, const uint8_t *p, size_t bytes,
                      const struct sockaddr_in *from, unsigned ifindex, int64_t now)
{
    struct cap_gvcp_request r;
    if (cap_gvcp_parse(p, bytes, &r) == CAP_GVCP_SILENT ||
        (r.command != CAP_GVCP_DISCOVERY && r.command != CAP_GVCP_FORCEIP &&
         r.command != CAP_GVCP_ACTION))
        return; /* other commands may not be broadcast */
    for (struct cap_gvcam *c = n->cams; c != NULL; c = c->next)
        if (ifindex == 0 || ifindex == c->ifindex)
            gvcam_control_datagram(c, p, bytes, from, now);
}

/* Receive the datagrams waiting at fd; cam NULL = a broadcast socket. */
static void gvnet_receive(struct cap_gvnet *n, int fd, struct cap_gvcam *cam)
{
    uint8_t p[2048];
    for (int k = 0; k < READ_AT_ONCE; k++) {
        struct sockaddr_in from;
        char control[CMSG_SPACE(sizeof(struct in_pktinfo))];
        struct iovec iov = {p, sizeof p};
        struct msghdr m = {.msg_name = &from,
                           .msg_namelen = sizeof from,
                           .msg_iov = &iov,
                           .msg_iovlen = 1,
                           .msg_control = control,
                           .msg_controllen = sizeof control};
        ssize_t got = recvmsg(fd, &m, MSG_DONTWAIT);
        if (got < 0) {
            if (errno == ECONNREFUSED || errno == EINTR)
                continue; /* a client that got an answer is gone */
            return;
        }
        if (m.msg_namelen != sizeof from || from.sin_family != AF_INET)
            continue;
        unsigned ifindex = 0;
        int64_t now = pvx_now_real(); /* for each datagram: a trigger is stamped with it */
        for (struct cmsghdr *h = CMSG_FIRSTHDR(&m); h != NULL; h = CMSG_NXTHDR(&m, h))
            if (h->cmsg_level == IPPROTO_IP && h->cmsg_type == IP_PKTINFO) {
                struct in_pktinfo info;
                memcpy(&info, CMSG_DATA(h), sizeof info);
                ifindex = (unsigned)info.ipi_ifindex;
            }
        if (cam != NULL)
            gvcam_control_datagram(cam, p, (size_t)got, &from, now);
        else
            broadcast(n, p, (size_t)got, &from, ifindex, now);
    }
}

/* Add a socket that receives datagrams to a broadcast address.  Other programs may receive them too. */
static pvx_err add_caster(struct cap_gvnet *n, struct in_addr addr, struct pvx_diag *d)
{
    for (const struct caster *k = n->casters; k != NULL; k = k->next)
        if (k->addr.s_addr == addr.s_addr)
            return PVX_OK;
    struct caster *k = pvx_calloc(1, sizeof *k);
    PVX_NEED(k);
    struct sockaddr_in sa = {
        .sin_family = AF_INET, .sin_port = htons(CAP_GVCP_PORT), .sin_addr = addr};
    int yes = 1;
    k->addr = addr;
    k->fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (k->fd < 0 || setsockopt(k->fd, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes) != 0 ||
        setsockopt(k->fd, IPPROTO_IP, IP_PKTINFO, &yes, sizeof yes) != 0 ||
        bind(k->fd, (struct sockaddr *)&sa, sizeof sa) != 0) {
        int e = errno;
        char text[INET_ADDRSTRLEN];
        if (k->fd >= 0)
            close(k->fd);
        free(k);
        return pvx_fail(d, e == EADDRINUSE ? PVX_EBUSY : pvx_err_from_errno(e),
                        "simulated cameras: broadcast address %s, UDP port %d: %s",
                        inet_ntop(AF_INET, &addr, text, sizeof text), CAP_GVCP_PORT, strerror(e));
    }
    k->next = n->casters;
    n->casters = k;
    return PVX_OK;
}

/* ---- thread ----------------------------------------------------------------------------------- */

static unsigned list_sockets(struct cap_gvnet *n, struct pollfd *p)
{
    unsigned k = 0;
    p[k++] = (struct pollfd){.fd = n->wake, .events = POLLIN};
    for (const struct caster *b = n->casters; b != NULL && k < MAX_SOCKETS; b = b->next)
        p[k++] = (struct pollfd){.fd = b->fd, .events = POLLIN};
    for (const struct cap_gvcam *c = n->cams; c != NULL && k < MAX_SOCKETS; c = c->next)
        p[k++] = (struct pollfd){.fd = c->control.fd, .events = POLLIN};
    return k;
}

static bool ready(const struct pollfd *p, unsigned n, int fd)
{
    for (unsigned k = 0; k < n; k++)
        if (p[k].fd == fd)
            return p[k].revents != 0;
    return false;
}

static void serve_sockets(struct cap_gvnet *n, const struct pollfd *p, unsigned n_p)
{
    uint64_t count;
    if (p[0].revents != 0 && read(n->wake, &count, sizeof count) < 0 && errno != EAGAIN)
        return;
    for (const struct caster *b = n->casters; b != NULL; b = b->next)
        if (ready(p, n_p, b->fd))
            gvnet_receive(n, b->fd, NULL);
    for (struct cap_gvcam *c = n->cams; c != NULL; c = c->next)
        if (ready(p, n_p, c->control.fd))
            gvnet_receive(n, c->control.fd, c);
}

static int64_t gvnet_earlier(int64_t a, int64_t b)
{
    return a < b ? a : b;
}

/* Do everything that is due.  Returns the time when the next thing is due. */
static int64_t gvnet_step(struct cap_gvnet *n)
{
    int64_t now = pvx_now_real(), next = line_step(n, now);
    for (struct cap_gvcam *c = n->cams; c != NULL; c = c->next) {
        next = gvnet_earlier(next, gvcam_control_step(c, now));
        if (c->control.gone_until != 0)
            continue;
        next = gvnet_earlier(next, gvcam_expose_step(c, now));
        next = gvnet_earlier(next, gvcam_send_step(c, pvx_now_real()));
    }
    return next;
}

static void *gvnet_run(void *arg)
{
    struct cap_gvnet *n = arg;
    struct pollfd p[MAX_SOCKETS];
    pthread_setname_np(pthread_self(), "simcams");
    prctl(PR_SET_TIMERSLACK, 1000UL);
    pthread_mutex_lock(&n->lock);
    while (!n->stop) {
        int64_t next = gvnet_step(n), left = next - pvx_now_real();
        unsigned k = list_sockets(n, p);
        left = left < 0 ? 0 : left > IDLE_NS ? IDLE_NS : left;
        n->polling = true;
        pthread_mutex_unlock(&n->lock);
        struct timespec ts = {left / PVX_NS_PER_S, left % PVX_NS_PER_S};
        int got = ppoll(p, k, &ts, NULL);
        pthread_mutex_lock(&n->lock);
        n->polling = false;
        n->polls++;
        pthread_cond_broadcast(&n->looked);
        if (got > 0)
            serve_sockets(n, p, k);
    }
    pthread_mutex_unlock(&n->lock);
    return NULL;
}

void gvnet_lock(cap_gvnet *n)
{
    pthread_mutex_lock(&n->lock);
}

static void wake(cap_gvnet *n)
{
    uint64_t one = 1;
    if (write(n->wake, &one, sizeof one) < 0)
        return; /* full: the thread is awake already */
}

void gvnet_unlock(cap_gvnet *n)
{
    pthread_mutex_unlock(&n->lock);
    wake(n);
}

pvx_err gvnet_add(cap_gvnet *n, cap_gvcam *c, struct pvx_diag *d)
{
    struct in_addr all = {htonl(INADDR_BROADCAST)};
    struct in_addr subnet = {c->addr.s_addr | ~c->mask.s_addr};
    gvnet_lock(n);
    pvx_err e = add_caster(n, all, d);
    if (e == PVX_OK && subnet.s_addr != c->addr.s_addr)
        e = add_caster(n, subnet, d);
    if (e == PVX_OK) {
        c->next = n->cams;
        n->cams = c;
    }
    gvnet_unlock(n);
    return e;
}

void gvnet_remove(cap_gvnet *n, cap_gvcam *c)
{
    gvnet_lock(n);
    for (struct cap_gvcam **at = &n->cams; *at != NULL; at = &(*at)->next)
        if (*at == c) {
            *at = c->next;
            break;
        }
    uint64_t polls = n->polls;
    wake(n);
    while (n->polling && n->polls == polls) /* else the address stays in use after close */
        pthread_cond_wait(&n->looked, &n->lock);
    pthread_mutex_unlock(&n->lock);
}

pvx_err cap_gvnet_new(cap_gvnet **out, struct pvx_diag *d)
{
    *out = NULL;
    struct cap_gvnet *n = pvx_calloc(1, sizeof *n);
    PVX_NEED(n);
    pthread_mutex_init(&n->lock, NULL);
    pthread_cond_init(&n->looked, NULL);
    n->wake = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    if (n->wake < 0 || pthread_create(&n->thread, NULL, gvnet_run, n) != 0) {
        pvx_fail(d, PVX_EIO, "simulated cameras: thread: %s", strerror(errno));
        if (n->wake >= 0)
            close(n->wake);
        free(n);
        return PVX_EIO;
    }
    *out = n;
    return PVX_OK;
}

void cap_gvnet_free(cap_gvnet **np)
{
    struct cap_gvnet *n = *np;
    if (n == NULL)
        return;
    *np = NULL;
    gvnet_lock(n);
    n->stop = true;
    gvnet_unlock(n);
    pthread_join(n->thread, NULL);
    while (n->casters != NULL) {
        struct caster *k = n->casters;
        n->casters = k->next;
        close(k->fd);
        free(k);
    }
    close(n->wake);
    pthread_cond_destroy(&n->looked);
    pthread_mutex_destroy(&n->lock);
    free(n);
}
