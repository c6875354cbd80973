/* check_links.c - each interface that cameras are on: cable, size of packets, card, routing. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/doctor/checks.h"
#include "daemon/doctor/parse.h"

#define SWITCH_BYTES 500e3 /* what a small switch keeps at least */

/* "(if cameras are on it)" for a card that is only suspected. */
static const char *maybe(const struct doc_link *l)
{
    return l->certain ? "" : ", if cameras are on it";
}

static void cable(struct doctor *d, const struct doc_link *l)
{
    int64_t carrier = 0, speed = -1;
    char word[32];
    if (l->loopback)
        return;
    if (doc_settled(
            !doc_exists(d->host, "/sys/class/net/%s", l->name), d, DOC_UNKNOWN, 50, "net.carrier",
            "%s is not under /sys: this is a container that shows another network's", l->name))
        return;
    if (!doc_int(d->host, &carrier, "/sys/class/net/%s/carrier", l->name) || carrier != 1) {
        struct doc_finding *f =
            doc_say(d, DOC_FAIL, 99, "net.carrier", "%s is down or has no cable", l->name);
        doc_means(f, "its cameras cannot be reached");
        doc_command(f, "ip link set %s up", doc_quote(l->name));
        return;
    }
    if (doc_exists(d->host, "/sys/class/net/%s/wireless", l->name)) {
        struct doc_finding *f = doc_say(d, l->certain ? DOC_FAIL : DOC_WARN, 92, "net.wireless",
                                        "%s is wireless", l->name);
        doc_means(f, "frames are lost with every disturbance of the air, and stamps jitter");
        doc_note(f, "connect the cameras by cable");
    }
    if (doc_text(d->host, word, sizeof word, "/sys/class/net/%s/duplex", l->name) &&
        strcmp(word, "half") == 0) {
        struct doc_finding *f =
            doc_say(d, DOC_FAIL, 93, "net.duplex", "%s runs half duplex", l->name);
        doc_means(f,
                  "packets collide: negotiation with the switch went wrong, or the cable is bad");
        doc_command(f, "ethtool -s %s autoneg on", doc_quote(l->name));
        doc_note(f, "another cable (Cat 5e or better) and another port of the switch");
    }
    if (doc_settled(!doc_int(d->host, &speed, "/sys/class/net/%s/speed", l->name) || speed <= 0, d,
                    DOC_UNKNOWN, 20, "net.speed", "%s does not say how fast it is", l->name))
        return;
    double need = (l->certain ? l->bytes_per_s : d->load.bytes_per_s) * 8e-6 * 1.05;
    double share = need / (double)speed;
    if (doc_settled(share <= 0.8, d, DOC_OK, 88, "net.speed",
                    "%s: %lld Mb/s, the cameras need %.0f (%.0f %%)", l->name, (long long)speed,
                    need, share * 100))
        return;
    bool fail = share > 0.97 && l->certain;
    struct doc_finding *f = doc_say(d, fail ? DOC_FAIL : DOC_WARN, 94, "net.speed",
                                    "%s carries %lld Mb/s, the cameras need %.0f (%.0f %%)%s",
                                    l->name, (long long)speed, need, share * 100, maybe(l));
    doc_means(f, share > 0.97 ? "frames must be lost: more comes than fits"
                              : "nothing is left for packets that are sent again, nor for bursts");
    doc_note(f, "lower fps, a packed or Bayer pixel_format, a smaller region, a second card, or "
                "2.5 or 10 Gb/s (table in capture/SYNC.md)");
}

static void mtu(struct doctor *d, const struct doc_link *l)
{
    int64_t v;
    int packet = d->load.packet_size;
    if (!doc_int(d->host, &v, "/sys/class/net/%s/mtu", l->name))
        return;
    if (packet > v) {
        struct doc_finding *f = doc_say(d, DOC_FAIL, 98, "net.mtu",
                                        "%s has an MTU of %lld, gige.packet_size asks for %d",
                                        l->name, (long long)v, packet);
        doc_means(f, "packets are cut in pieces: frames come short although they look complete, "
                     "and one lost piece loses the packet");
        doc_command(f, "ip link set %s mtu 9000", doc_quote(l->name));
        doc_note(f, "the switch must pass jumbo frames too; or set gige.packet_size: %lld",
                 (long long)v);
        return;
    }
    if (doc_settled(v >= 8000 || l->loopback, d, DOC_OK, 70, "net.mtu", "%s: MTU %lld", l->name,
                    (long long)v))
        return;
    struct doc_finding *f =
        doc_say(d, DOC_WARN, 70, "net.mtu", "%s has an MTU of %lld: no jumbo frames%s", l->name,
                (long long)v, maybe(l));
    doc_means(f, "six times as many packets, interrupts and processor time as with 9000 bytes");
    doc_command(f, "ip link set %s mtu 9000", doc_quote(l->name));
    doc_note(f, "switch and cameras must be set to jumbo frames as well; gige.packet_size: 0 then "
                "finds the largest that passes");
}

static void rp_filter(struct doctor *d, const struct doc_link *l, const struct doc_route *r,
                      size_t n)
{
    int64_t all = 0, own = 0;
    const char *twin = NULL;
    if (l->loopback || !doc_int(d->host, &all, "/proc/sys/net/ipv4/conf/all/rp_filter") ||
        !doc_int(d->host, &own, "/proc/sys/net/ipv4/conf/%s/rp_filter", l->name))
        return;
    int64_t v = all > own ? all : own; /* ip-sysctl: the larger of the two counts */
    for (size_t i = 0; i < n;
         i++) /* another card with a network that overlaps one of this card's */
        for (size_t k = 0; k < n && twin == NULL; k++)
            if (strcmp(r[i].iface, l->name) == 0 && strcmp(r[k].iface, l->name) != 0 &&
                r[i].mask != 0 && r[k].mask != 0 &&
                ((r[i].dest ^ r[k].dest) & r[i].mask & r[k].mask) == 0)
                twin = r[k].iface;
    if (doc_settled(v != 1 || (twin == NULL && l->certain), d, DOC_OK, 65, "net.rp_filter",
                    "%s: reverse-path filter %s", l->name,
                    v == 0   ? "off"
                    : v == 2 ? "loose"
                             : "strict, and the only way to its cameras"))
        return;
    struct doc_finding *f =
        twin != NULL
            ? doc_say(d, DOC_FAIL, 90, "net.rp_filter",
                      "%s filters by reverse path, and %s has the same network", l->name, twin)
            : doc_say(d, DOC_WARN, 40, "net.rp_filter", "%s filters by reverse path%s", l->name,
                      maybe(l));
    doc_means(f, "packets of a camera whose way back leads over another card are dropped without "
                 "any counter");
    /* a dot in the name of an interface would end a word of the key */
    doc_sysctl(f, "net.ipv4.conf.all.rp_filter", "2");
    if (strchr(l->name, '.') == NULL) {
        char key[80];
        snprintf(key, sizeof key, "net.ipv4.conf.%s.rp_filter", l->name);
        doc_sysctl(f, key, "2");
    }
    if (twin != NULL)
        doc_note(f, "better: give each card a network of its own");
}

static void check_links_ring(struct doctor *d, const struct doc_link *l, const struct doc_nic *nic)
{
    if (doc_settled(!nic->ring_known, d, DOC_UNKNOWN, 10, "net.ring",
                    "%s does not say how large its ring is", l->name))
        return;
    uint32_t want = nic->rx_ring_max < 4096 ? nic->rx_ring_max : 4096;
    if (doc_settled(nic->rx_ring >= want || nic->rx_ring >= 2048, d, DOC_OK, 75, "net.ring",
                    "%s: receive ring of %u packets", l->name, nic->rx_ring))
        return;
    struct doc_finding *f =
        doc_say(d, DOC_WARN, 75, "net.ring", "%s has a receive ring of %u packets, it could be %u",
                l->name, nic->rx_ring, nic->rx_ring_max);
    doc_means(f, "packets are lost in the card when the kernel is late (rx_missed_errors)");
    doc_command(f, "ethtool -G %s rx %u", doc_quote(l->name), want);
}

static void card(struct doctor *d, const struct doc_link *l)
{
    struct doc_nic nic = {.phc = -1};
    if (l->loopback || !doc_exists(d->host, "/sys/class/net/%s/device", l->name))
        return;
    d->host->nic(d->host, l->name, &nic);
    check_links_ring(d, l, &nic);
    if (!nic.pause_known) {
        doc_say(d, DOC_UNKNOWN, 10, "net.pause", "%s does not say whether it uses flow control",
                l->name);
    } else if (nic.tx_pause) {
        doc_say(d, DOC_OK, 35, "net.pause", "%s: flow control on", l->name);
    } else {
        struct doc_finding *f =
            doc_say(d, DOC_WARN, 35, "net.pause",
                    "%s does not ask the switch to wait (flow control is off)", l->name);
        doc_means(f, "when the card is full, packets are lost instead of waiting in the switch");
        doc_command(f, "ethtool -A %s rx on tx on", doc_quote(l->name));
    }
    if (nic.coalesce_known && nic.rx_usecs > 500) {
        struct doc_finding *f =
            doc_say(d, DOC_WARN, 45, "net.coalesce",
                    "%s collects packets for %u us before it interrupts", l->name, nic.rx_usecs);
        doc_means(f, "its ring fills up in that time, and arrival times vary by as much");
        doc_command(f, "ethtool -C %s adaptive-rx off rx-usecs 100", doc_quote(l->name));
    } else if (nic.coalesce_known && nic.rx_usecs == 0 && !nic.adaptive_rx && nic.rx_frames <= 1) {
        struct doc_finding *f = doc_say(d, DOC_WARN, 30, "net.coalesce",
                                        "%s interrupts for every single packet", l->name);
        doc_means(f, "interrupts take most of the processor when all cameras send");
        doc_command(f, "ethtool -C %s rx-usecs 50", doc_quote(l->name));
    } else if (nic.coalesce_known) {
        doc_say(d, DOC_OK, 45, "net.coalesce", "%s: interrupts %s", l->name,
                nic.adaptive_rx ? "adapt to the traffic" : "are collected for a short time");
    }
    if (nic.eee_known && nic.eee_active) {
        struct doc_finding *f =
            doc_say(d, DOC_WARN, 25, "net.eee",
                    "%s sleeps between packets (Energy Efficient Ethernet)", l->name);
        doc_means(f, "each burst begins with the card waking up: jitter, and with some cards loss");
        doc_command(f, "ethtool --set-eee %s eee off", doc_quote(l->name));
    }
}

/* Cameras of 1 Gb/s that expose together share the link to this host: the switch keeps what does not
 * pass at once.  A pause of (n / r - 1) packets between packets lets all share it (n cameras, r = link
 * over camera). */
static void burst(struct doctor *d, const struct doc_link *l)
{
    int64_t speed = 0;
    int packet = d->load.packet_size > 0 ? d->load.packet_size : 1500;
    bool together = d->load.triggered || d->load.ptp;
    if (l->loopback || l->cameras < 2 || !together ||
        !doc_int(d->host, &speed, "/sys/class/net/%s/speed", l->name) || speed <= 0)
        return;
    double share = (double)l->cameras * 1000 / (double)speed;
    double kept =
        share > 1 ? (1 - 1 / share) * (double)d->load.frame_bytes * (double)l->cameras : 0;
    if (doc_settled(kept < SWITCH_BYTES || d->load.packet_delay_ns > 0, d, DOC_OK, 67, "net.burst",
                    "%s: cameras that expose together %s", l->name,
                    kept < SWITCH_BYTES ? "do not flood the switch" : "pause between packets"))
        return;
    int delay = (int)((share - 1) * (packet + 38) * 8); /* at 1 bit per ns, with preamble and gap */
    struct doc_finding *f =
        doc_say(d, DOC_WARN, 67, "net.burst",
                "%zu cameras of %s expose together: the switch must keep %.1f MB of each set",
                l->cameras, l->name, kept * 1e-6);
    doc_means(f, "small switches have 0.5 to 2 MB for all ports; what does not fit is lost, and "
                 "the same cameras lose every time");
    doc_note(f,
             "gige.packet_delay_ns: %d in pyrovoxd.yaml (packets of %d bytes, cameras of 1 Gb/s); "
             "a faster port to this host helps more",
             delay, packet);
}

void doc_check_links(struct doctor *d)
{
    char *text = doc_file(d->host, "/proc/net/route");
    struct doc_route *r = calloc(256, sizeof *r);
    size_t n = text != NULL && r != NULL ? doc_parse_routes(text, r, 256) : 0;
    for (size_t i = 0; i < d->n_links; i++) {
        cable(d, &d->link[i]);
        mtu(d, &d->link[i]);
        burst(d, &d->link[i]);
        if (n > 0)
            rp_filter(d, &d->link[i], r, n);
        card(d, &d->link[i]);
    }
    free(text);
    free(r);
}
