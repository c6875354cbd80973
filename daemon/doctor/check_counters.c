/* check_counters.c - what the host has dropped, and where: each counter names its own remedy.
 *
 * Counters are since boot; they are read twice, host.sample_s apart: what grows now is a failure,
 * what grew some time ago a warning. */
#include <stdlib.h>
#include <string.h>

#include "daemon/doctor/checks.h"
#include "daemon/doctor/parse.h"

enum source { FROM_LINK, FROM_SNMP_UDP, FROM_SNMP_IP, FROM_SOFTNET, FROM_SOCKETS };

/* What a counter means and what helps against it. */
static const struct counter {
    enum source from;
    const char *name, *id, *what, *means, *key, *value, *note;
} counters[] = {
    {FROM_LINK, "rx_missed_errors", "net.missed",
     "packets lost in the network card because its ring was full", "whole frames are incomplete",
     NULL, NULL,
     "set a larger ring (ethtool -G) and the governor `performance`, and give interrupts their own "
     "processors"},
    {FROM_LINK, "rx_fifo_errors", "net.fifo",
     "packets lost in the network card because its memory was full", "whole frames are incomplete",
     NULL, NULL,
     "set a larger ring (ethtool -G), turn flow control on (ethtool -A), or use a card with more "
     "memory"},
    {FROM_LINK, "rx_over_errors", "net.over",
     "packets lost in the network card because it was overrun", "whole frames are incomplete", NULL,
     NULL, "set a larger ring (ethtool -G) and turn flow control on (ethtool -A)"},
    {FROM_LINK, "rx_crc_errors", "net.crc", "packets that arrived damaged",
     "each one costs a frame, or the camera must send the packet again", NULL, NULL,
     "try another cable (Cat 6), and lay it away from motors and ignition"},
    {FROM_LINK, "rx_length_errors", "net.length", "packets of a wrong size",
     "frames larger than the MTU are thrown away", NULL, NULL,
     "set the same MTU on card, switch and cameras"},
    {FROM_LINK, "rx_dropped", "net.dropped",
     "packets that the kernel dropped after the network card took them",
     "some may be from cameras; packets of protocols that no program uses also count here", NULL,
     NULL, "`dropwatch` or `perf trace -e skb:kfree_skb` shows where"},
    {FROM_SNMP_UDP, "RcvbufErrors", "net.rcvbuf", "packets lost because a socket's buffer was full",
     "a program (pyrovoxd?) did not read in time", "net.core.rmem_max", "33554432",
     "give the receiving thread more priority, or end other programs"},
    {FROM_SNMP_UDP, "MemErrors", "net.udpmem", "packets lost because all UDP memory was in use",
     "the bursts of all cameras together do not fit", "net.ipv4.udp_mem", "131072 196608 262144",
     NULL},
    {FROM_SNMP_UDP, "InCsumErrors", "net.csum", "UDP packets with a wrong checksum",
     "each one costs a frame, or the camera must send the packet again", NULL, NULL,
     "check the cable, the switch and the card's checksum offload"},
    {FROM_SNMP_IP, "ReasmFails", "net.reasm", "IP fragments that could not be put together",
     "cameras send packets larger than the MTU of a switch or card", NULL, NULL,
     "set the same MTU everywhere, or a smaller gige.packet_size"},
    {FROM_SOFTNET, "dropped", "net.softnet", "packets lost because a processor's backlog was full",
     "whole frames are incomplete", "net.core.netdev_max_backlog", "16384", NULL},
    {FROM_SOCKETS, "drops", "net.sockets", "packets lost by UDP sockets that are open now",
     "the programs that own them did not read in time", "net.core.rmem_max", "33554432", NULL},
};
#define N_COUNTERS (sizeof counters / sizeof *counters)

static bool read_counter(struct doctor *d, const struct counter *c, const char *link, uint64_t *out)
{
    int64_t v;
    *out = 0;
    if (c->from == FROM_LINK) {
        bool ok = doc_int(d->host, &v, "/sys/class/net/%s/statistics/%s", link, c->name);
        *out = ok && v > 0 ? (uint64_t)v : 0;
        return ok;
    }
    char *text = doc_file(d->host, "/proc/net/%s",
                          c->from == FROM_SOFTNET   ? "softnet_stat"
                          : c->from == FROM_SOCKETS ? "udp"
                                                    : "snmp");
    if (text == NULL)
        return false;
    bool ok = true;
    if (c->from == FROM_SOFTNET) {
        struct doc_softnet s;
        doc_parse_softnet(text, &s);
        *out = s.dropped;
        ok = s.cpus > 0;
    } else if (c->from == FROM_SOCKETS) {
        *out = doc_parse_udp(text);
    } else {
        ok = doc_parse_snmp(text, c->from == FROM_SNMP_IP ? "Ip" : "Udp", c->name, out);
    }
    free(text);
    return ok;
}

static void doctor_judge(struct doctor *d, const struct counter *c, const char *link,
                         uint64_t before, uint64_t now)
{
    uint64_t grown = now > before ? now - before : 0;
    const char *on = link[0] != '\0' ? " on " : "";
    if (doc_settled(now == 0, d, DOC_OK, 10, c->id, "no %s%s%s", c->what, on, link))
        return;
    /* rx_dropped counts unknown protocols as well: by itself no sign of trouble */
    bool vague = strcmp(c->name, "rx_dropped") == 0;
    struct doc_finding *f =
        grown > 0 ? doc_say(d, vague ? DOC_WARN : DOC_FAIL, vague ? 40 : 97, c->id,
                            "%llu %s%s%s in the last %.1f s", (unsigned long long)grown, c->what,
                            on, link, d->host->sample_s)
                  : doc_say(d, vague ? DOC_OK : DOC_WARN, vague ? 10 : 55, c->id,
                            "%llu %s%s%s since the last boot, none of them now",
                            (unsigned long long)now, c->what, on, link);
    doc_means(f, "%s", c->means);
    if (c->key != NULL)
        doc_sysctl(f, c->key, "%s", c->value);
    if (c->note != NULL)
        doc_note(f, "%s", c->note);
}

/* The kernel gave up a round of receiving because its time was over. */
static void squeezed(struct doctor *d, const struct doc_softnet *s)
{
    double share = s->processed > 0 ? (double)s->squeezed / (double)s->processed : 0;
    if (doc_settled(s->squeezed < 100 || share < 1e-5, d, DOC_OK, 10, "net.squeeze",
                    "the kernel keeps up with receiving"))
        return;
    struct doc_finding *f =
        doc_say(d, DOC_WARN, 50, "net.squeeze",
                "the kernel stopped receiving early %llu times since boot, once per %.0f packets",
                (unsigned long long)s->squeezed, 1 / share);
    doc_means(f, "packets wait in the card's ring until the kernel receives again");
    doc_sysctl(f, "net.core.netdev_budget", "600");
    doc_sysctl(f, "net.core.netdev_budget_usecs", "8000");
}

void doc_check_counters(struct doctor *d)
{
    uint64_t before[N_COUNTERS][DOC_MAX_LINKS] = {{0}}, now;
    static const struct doc_link none = {.name = ""};
    if (doc_load_count(&d->load, DOC_CAM_GIGE) == 0)
        return;
    for (int pass = 0; pass < 2; pass++) {
        if (pass == 1 && d->host->sample_s > 0)
            d->host->wait(d->host, d->host->sample_s);
        for (size_t c = 0; c < N_COUNTERS; c++) {
            size_t n = counters[c].from == FROM_LINK ? d->n_links : 1;
            for (size_t i = 0; i < n; i++) {
                const struct doc_link *l = counters[c].from == FROM_LINK ? &d->link[i] : &none;
                bool ok = read_counter(d, &counters[c], l->name, &now);
                if (pass == 0)
                    before[c][i] = now;
                else if (ok)
                    doctor_judge(d, &counters[c], l->name, before[c][i], now);
            }
        }
    }
    char *text = doc_file(d->host, "/proc/net/softnet_stat");
    struct doc_softnet s;
    if (text == NULL)
        return;
    doc_parse_softnet(text, &s);
    squeezed(d, &s);
    free(text);
}
