#include "capture/gevsim/gvcam.h"

#include <arpa/inet.h>
#include <errno.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/mem.h"
#include "capture/gevsim/gevsim.h"
#include "capture/gevsim/gvnet.h"

#define S(member)                                         \
    {                                                     \
#member, offsetof(struct cap_gvcam_stats, member) \
    }
const struct cap_gvcam_stat_def cap_gvcam_stat_defs[] = {
    S(exposed),    S(frames),     S(dropped),     S(overrun), S(triggers), S(missed),   S(too_fast),
    S(packets),    S(lost),       S(cut),         S(asked),   S(resent),   S(gone),     S(torn),
    S(reordered),  S(duplicated), S(wrong_size),  S(corrupt), S(hostile),  S(commands), S(refused),
    S(heartbeats), S(reboots),    S(send_errors), {NULL, 0}};
#undef S

/* ---- set-up ----------------------------------------------------------------------------------- */

static bool ring_format(enum cap_pixfmt f)
{
    int depth = cap_pixfmt_depth(f);
    enum cap_layout l = cap_pixfmt_layout(f);
    return f != CAP_BGR8 && cap_pixfmt_pfnc(f) != 0 &&
           ((depth == 8 && l == CAP_LAYOUT_8) || (depth == 16 && l == CAP_LAYOUT_16));
}

static pvx_err gvcam_check(const struct cap_gvcam_config *c, struct pvx_diag *d)
{
    if (!ring_format(c->fmt))
        return pvx_fail(d, PVX_EINVAL,
                        "simulated camera %s: images of format %s; it takes Mono, RGB and Bayer of "
                        "8 or 16 bits",
                        c->address, cap_pixfmt_name(c->fmt));
    if (c->width < 1 || c->height < 1 || c->width > 16384 || c->height > 16384 || c->n_ring < 1 ||
        !(c->ring_fps > 0 && c->ring_fps <= 1000) || !(c->tick_hz >= 0 && c->tick_hz <= 1e10) ||
        !(c->link_mbit >= 0) || !(c->ptp_settle_ms >= 0) || !(c->reboot_s >= 0))
        return pvx_fail(d, PVX_EINVAL,
                        "simulated camera %s: image size 1 to 16384, at least one image, rates up "
                        "to 1000 Hz, a clock of at most 1e10 Hz",
                        c->address);
    if (c->serial[0] == '\0' || strlen(c->serial) > CAP_GVCAM_NAME_MAX ||
        (c->user_name != NULL && strlen(c->user_name) > CAP_GVCAM_NAME_MAX))
        return pvx_fail(d, PVX_EINVAL,
                        "simulated camera %s: serial and name have at most %d characters",
                        c->address, CAP_GVCAM_NAME_MAX);
    return PVX_OK;
}

/* The interface that has the address. */
static pvx_err find_interface(struct cap_gvcam *c, struct pvx_diag *d)
{
    struct ifaddrs *list;
    bool found = false;
    if (inet_pton(AF_INET, c->c.address, &c->addr) != 1)
        return pvx_fail(d, PVX_EINVAL, "simulated camera: '%s' is not an IPv4 address",
                        c->c.address);
    if (getifaddrs(&list) != 0)
        return pvx_fail(d, PVX_EIO, "simulated camera %s: interfaces: %s", c->c.address,
                        strerror(errno));
    for (const struct ifaddrs *p = list; p != NULL && !found; p = p->ifa_next) {
        struct sockaddr_in sa;
        if (p->ifa_addr == NULL || p->ifa_addr->sa_family != AF_INET)
            continue;
        memcpy(&sa, p->ifa_addr, sizeof sa);
        found = sa.sin_addr.s_addr == c->addr.s_addr;
        if (found) {
            memcpy(&sa, p->ifa_netmask, sizeof sa);
            c->mask = sa.sin_addr;
            c->ifindex = if_nametoindex(p->ifa_name);
        }
    }
    freeifaddrs(list);
    if (!found)
        return pvx_fail(d, PVX_ENOENT,
                        "simulated camera %s: no interface of this host has that address; use a "
                        "private network (--private-net) or `sudo ip addr add %s/8 dev lo`",
                        c->c.address, c->c.address);
    return PVX_OK;
}

static int udp_socket(struct in_addr addr, uint16_t port)
{
    struct sockaddr_in sa = {.sin_family = AF_INET, .sin_port = htons(port), .sin_addr = addr};
    int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    int pieces = IP_PMTUDISC_DONT;
    if (fd >= 0 && (setsockopt(fd, IPPROTO_IP, IP_MTU_DISCOVER, &pieces, sizeof pieces) != 0 ||
                    bind(fd, (struct sockaddr *)&sa, sizeof sa) != 0)) {
        int e = errno;
        close(fd);
        errno = e;
        fd = -1;
    }
    return fd;
}

static pvx_err open_sockets(struct cap_gvcam *c, struct pvx_diag *d)
{
    struct sockaddr_in sa = {0};
    socklen_t n = sizeof sa;
    c->control.fd = udp_socket(c->addr, CAP_GVCP_PORT);
    if (c->control.fd < 0) {
        int e = errno;
        return pvx_fail(d, e == EADDRINUSE ? PVX_EBUSY : pvx_err_from_errno(e),
                        "simulated camera %s: UDP port %d: %s%s", c->c.address, CAP_GVCP_PORT,
                        strerror(e),
                        e == EADDRINUSE ? " (another camera or simulation is there)" : "");
    }
    c->send.fd = udp_socket(c->addr, 0);
    if (c->send.fd < 0 || getsockname(c->send.fd, (struct sockaddr *)&sa, &n) != 0)
        return pvx_fail(d, PVX_EIO, "simulated camera %s: stream socket: %s", c->c.address,
                        strerror(errno));
    c->send.port = ntohs(sa.sin_port);
    int room = 4 << 20;
    (void)setsockopt(c->send.fd, SOL_SOCKET, SO_SNDBUF, &room, sizeof room);
    return PVX_OK;
}

static void gvcam_put_text(struct cap_gvcam *c, enum gvcam_bootstrap at, size_t room,
                           const char *text)
{
    size_t n = strlen(text);
    memset(c->reg.boot + at, 0, room);
    memcpy(c->reg.boot + at, text, n < room ? n : room - 1);
}

static void fill_bootstrap(struct cap_gvcam *c)
{
    uint8_t *b = c->reg.boot;
    uint32_t ip = ntohl(c->addr.s_addr);
    cap_put32(b + GVB_VERSION, 0x00020000);
    cap_put32(b + GVB_MODE, 0x80000001); /* big-endian, UTF-8 */
    cap_put32(b + GVB_MAC_HIGH, 0x0250); /* locally administered */
    cap_put32(b + GVB_MAC_LOW, ip);
    cap_put32(b + GVB_IP_SUPPORTED, 0x5); /* persistent, link-local */
    cap_put32(b + GVB_IP_CURRENT, 0x5);
    cap_put32(b + GVB_IP, ip);
    cap_put32(b + GVB_MASK, ntohl(c->mask.s_addr));
    gvcam_put_text(c, GVB_VENDOR, 32, "Pyrovox");
    gvcam_put_text(c, GVB_MODEL, 32, "SimCam");
    gvcam_put_text(c, GVB_DEVICE_VERSION, 32, PVX_VERSION);
    gvcam_put_text(c, GVB_INFO, 48, "simulated camera");
    gvcam_put_text(c, GVB_SERIAL, 16, c->c.serial);
    gvcam_put_text(c, GVB_USER_NAME, 16, c->c.user_name != NULL ? c->c.user_name : "");
}

static pvx_err copy_config(struct cap_gvcam *c, const struct cap_gvcam_config *from)
{
    const char *text[3] = {from->address, from->serial, from->user_name};
    c->c = *from;
    c->c.tick_hz = from->tick_hz == 0 ? 1e9 : from->tick_hz;
    c->c.link_mbit = from->link_mbit == 0 ? 1000 : from->link_mbit;
    c->c.ptp_settle_ms = from->ptp_settle_ms == 0 ? 2000 : from->ptp_settle_ms;
    c->c.reboot_s = from->reboot_s == 0 ? 2 : from->reboot_s;
    c->c.first_id = from->first_id == 0 ? 65401 : from->first_id;
    for (size_t k = 0; k < 3; k++)
        if (text[k] != NULL && (c->strings[k] = strdup(text[k])) == NULL)
            return PVX_ENOMEM;
    c->c.address = c->strings[0];
    c->c.serial = c->strings[1];
    c->c.user_name = c->strings[2];
    c->ring = pvx_calloc(from->n_ring, sizeof *c->ring);
    c->image.conv = pvx_calloc(from->n_ring, sizeof *c->image.conv);
    if (c->ring == NULL || c->image.conv == NULL)
        return PVX_ENOMEM;
    memcpy(c->ring, from->ring, from->n_ring * sizeof *c->ring);
    c->c.ring = c->ring;
    return PVX_OK;
}

void gvcam_destroy(struct cap_gvcam *c)
{
    if (c->control.fd >= 0)
        close(c->control.fd);
    if (c->send.fd >= 0)
        close(c->send.fd);
    if (c->image.conv != NULL)
        gvcam_image_drop(c);
    free(c->image.conv);
    free(c->ring);
    free(c->reg.xml);
    for (size_t k = 0; k < 3; k++)
        free(c->strings[k]);
    free(c);
}

pvx_err gvcam_build(struct gvcam_link *link, const struct cap_gvcam_config *config,
                    struct cap_gvcam **out)
{
    struct cap_gvcam *c = pvx_calloc(1, sizeof *c);
    PVX_NEED(c);
    c->link = link;
    c->control.fd = c->send.fd = -1;
    c->expose.trigger_at = GVCAM_NEVER;
    pvx_err e = copy_config(c, config);
    if (e == PVX_OK) {
        c->expose.id = c->c.first_id;
        gvcam_reg_reset(c);
        gvcam_clock_start(&c->clock, &c->c, pvx_now_real());
        c->reg.ptp_status_latched = GVCAM_PTP_DISABLED;
        e = gvcam_xml_make(c);
    }
    if (e != PVX_OK) {
        gvcam_destroy(c);
        return e;
    }
    *out = c;
    return PVX_OK;
}

pvx_err cap_gvcam_new(cap_gvnet *net, const struct cap_gvcam_config *config, cap_gvcam **out,
                      struct pvx_diag *d)
{
    struct cap_gvcam *c;
    *out = NULL;
    PVX_TRY(gvcam_check(config, d));
    PVX_TRY(gvcam_build(gvnet_link(net), config, &c));
    c->net = net;
    pvx_err e = find_interface(c, d);
    PVX_THEN(e, open_sockets(c, d));
    if (e == PVX_OK) {
        c->rng = 0x9E3779B97F4A7C15u ^ c->addr.s_addr;
        c->clock.seed = c->addr.s_addr;
        fill_bootstrap(c);
        e = gvnet_add(net, c, d);
    }
    if (e != PVX_OK) {
        gvcam_destroy(c);
        return e;
    }
    *out = c;
    return PVX_OK;
}

void cap_gvcam_free(cap_gvcam **cp)
{
    struct cap_gvcam *c = *cp;
    if (c == NULL)
        return;
    *cp = NULL;
    gvnet_remove(c->net, c);
    gvcam_destroy(c);
}

/* ---- live ------------------------------------------------------------------------------------- */

void cap_gvcam_set_fault(cap_gvcam *c, const struct cap_gvcam_fault *f)
{
    gvnet_lock(c->net);
    gvcam_clock_faults(&c->clock, f, pvx_now_real());
    c->fault = *f;
    gvnet_unlock(c->net);
}

void cap_gvcam_do(cap_gvcam *c, enum cap_gvcam_act act, double arg)
{
    gvnet_lock(c->net);
    int64_t now = pvx_now_real();
    switch (act) {
    case CAP_GVCAM_REBOOT: gvcam_control_reboot(c, now, arg); break;
    case CAP_GVCAM_CLOCK_JUMP: gvcam_clock_jump(&c->clock, now, (int64_t)(arg * 1e9)); break;
    case CAP_GVCAM_RESTART_IDS: gvcam_expose_restart_ids(c, (uint64_t)arg); break;
    case CAP_GVCAM_TRIGGER_MODE: c->reg.v[GVF_TRIGGER_MODE] = arg != 0; break;
    }
    gvnet_unlock(c->net);
}

void cap_gvcam_stats(cap_gvcam *c, struct cap_gvcam_stats *out)
{
    gvnet_lock(c->net);
    *out = c->stats;
    gvnet_unlock(c->net);
}
