/* check_buffers.c - room for packets between the network card and the program.
 *
 * A GigE camera sends a frame in one go; what the program has not taken yet waits in the socket's
 * buffer (net.core.rmem_*), all sockets together under net.ipv4.udp_mem, and on interfaces without
 * NAPI before that in the backlog of a processor. */
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "daemon/doctor/checks.h"

#define CAP_NET_RAW_BIT 13
#define MIB             1048576.0

/* Next power of two. */
static int64_t round_up(double v)
{
    int64_t n = 65536;
    while ((double)n < v && n < (int64_t)1 << 40)
        n *= 2;
    return n;
}

static void rmem_max(struct doctor *d, bool packet_socket)
{
    int64_t v;
    double frame = (double)d->load.frame_bytes, need = 2 * frame;
    double most = need > (double)d->load.socket_buffer ? need : (double)d->load.socket_buffer;
    int64_t want = round_up(most > 32 * MIB ? most : 32 * MIB);
    if (doc_settled(!doc_int(d->host, &v, "/proc/sys/net/core/rmem_max"), d, DOC_UNKNOWN, 60,
                    "net.rmem_max",
                    "largest socket buffer: /proc/sys/net/core/rmem_max cannot be read"))
        return;
    if ((double)v >= need && (size_t)v < d->load.socket_buffer) {
        struct doc_finding *f =
            doc_say(d, DOC_WARN, 43, "net.rmem_max",
                    "largest socket buffer is %.1f MiB, gige.socket_buffer asks for %.1f",
                    (double)v / MIB, (double)d->load.socket_buffer / MIB);
        doc_means(f, "cameras get less buffer for bursts than the configuration asks for");
        doc_sysctl(f, "net.core.rmem_max", "%lld", (long long)want);
        return;
    }
    if (doc_settled((double)v >= need, d, DOC_OK, 90, "net.rmem_max",
                    "largest socket buffer %.1f MiB, two frames take %.1f", (double)v / MIB,
                    need / MIB))
        return;
    bool fail = (double)v < frame && !packet_socket;
    struct doc_finding *f =
        doc_say(d, fail ? DOC_FAIL : DOC_WARN, 95, "net.rmem_max",
                "largest socket buffer is %.2f MiB, a frame of a camera takes %.2f",
                (double)v / MIB, frame / MIB);
    doc_means(f, "%s",
              packet_socket
                  ? "pyrovoxd may bypass the socket buffers (CAP_NET_RAW); without that right, "
                    "packets are lost whenever it is not scheduled for a moment"
                  : "packets are lost whenever the program is not scheduled for a moment: frames "
                    "are counted as incomplete, or have to be sent again");
    doc_sysctl(f, "net.core.rmem_max", "%lld", (long long)want);
}

static void rmem_default(struct doctor *d, bool packet_socket)
{
    int64_t v;
    double frame = (double)d->load.frame_bytes;
    if (!doc_int(d->host, &v, "/proc/sys/net/core/rmem_default"))
        return;
    if (doc_settled((double)v >= frame, d, DOC_OK, 40, "net.rmem_default",
                    "first socket buffer %.1f MiB", (double)v / MIB))
        return;
    /* Only SO_RCVBUF set after the first leader helps later frames. */
    struct doc_finding *f = doc_say(d, packet_socket ? DOC_OK : DOC_WARN, 45, "net.rmem_default",
                                    "first socket buffer is %.2f MiB, a frame takes %.2f",
                                    (double)v / MIB, frame / MIB);
    doc_means(f,
              "the buffer grows only after the first frame has begun, so the first frame "
              "of each camera after a start is often incomplete (discard_first: 1 leaves it out)");
    if (!packet_socket)
        doc_sysctl(f, "net.core.rmem_default", "%lld", (long long)round_up(frame));
}

static void udp_mem(struct doctor *d)
{
    char text[128];
    long long low, pressure, high;
    double page = (double)sysconf(_SC_PAGESIZE);
    double need = 2 * (double)d->load.frame_bytes * (double)doc_load_count(&d->load, DOC_CAM_GIGE);
    if (!doc_text(d->host, text, sizeof text, "/proc/sys/net/ipv4/udp_mem") ||
        sscanf(text, "%lld %lld %lld", &low, &pressure, &high) != 3)
        return;
    if (doc_settled((double)high * page >= need, d, DOC_OK, 50, "net.udp_mem",
                    "all UDP sockets may hold %.0f MiB, need %.0f", (double)high * page / MIB,
                    need / MIB))
        return;
    struct doc_finding *f =
        doc_say(d, DOC_FAIL, 85, "net.udp_mem",
                "all UDP sockets together may hold %.1f MiB, two frames of every camera take %.1f",
                (double)high * page / MIB, need / MIB);
    doc_means(f, "packets are lost when all cameras send at once, even if each buffer is large");
    long long pages = (long long)(round_up(2 * need) / (int64_t)page);
    doc_sysctl(f, "net.ipv4.udp_mem", "%lld %lld %lld", pages / 2, pages * 3 / 4, pages);
}

/* Packets of one set of frames. */
static double set_packets(const struct doctor *d)
{
    double packet = d->load.packet_size > 64 ? d->load.packet_size - 36 : 1464;
    return (double)d->load.frame_bytes / packet * (double)doc_load_count(&d->load, DOC_CAM_GIGE);
}

static bool uses_backlog(struct doctor *d, char *which, size_t size)
{
    for (size_t i = 0; i < d->n_links; i++) {
        char mask[300];
        const char *name = d->link[i].name;
        snprintf(which, size, "%s", name);
        if (d->link[i].loopback || !doc_exists(d->host, "/sys/class/net/%s/device", name))
            return true;
        if (doc_text(d->host, mask, sizeof mask, "/sys/class/net/%s/queues/rx-0/rps_cpus", name) &&
            strspn(mask, "0,") != strlen(mask))
            return true;
    }
    return false;
}

static void backlog(struct doctor *d)
{
    int64_t v;
    char which[32] = "";
    double need = set_packets(d);
    if (!doc_int(d->host, &v, "/proc/sys/net/core/netdev_max_backlog"))
        return;
    if (doc_settled(!uses_backlog(d, which, sizeof which), d, DOC_OK, 30, "net.backlog",
                    "backlog of %lld packets; the cards here do not use it", (long long)v))
        return;
    if ((double)v >= need) {
        doc_say(d, DOC_OK, 30, "net.backlog", "backlog of %lld packets, a set has %.0f",
                (long long)v, need);
        return;
    }
    struct doc_finding *f =
        doc_say(d, DOC_WARN, 60, "net.backlog",
                "%s queues at most %lld packets per processor, a set of all cameras has %.0f",
                which, (long long)v, need);
    doc_means(f, "cameras that expose together send together; packets that exceed the "
                 "backlog are lost");
    doc_sysctl(f, "net.core.netdev_max_backlog", "%lld", (long long)round_up(2 * need));
}

static void budget(struct doctor *d)
{
    int64_t packets, usecs;
    if (!doc_int(d->host, &packets, "/proc/sys/net/core/netdev_budget") ||
        !doc_int(d->host, &usecs, "/proc/sys/net/core/netdev_budget_usecs"))
        return;
    if (doc_settled(packets >= 300 && usecs >= 2000, d, DOC_OK, 20, "net.budget",
                    "%lld packets or %lld us per round of receiving", (long long)packets,
                    (long long)usecs))
        return;
    struct doc_finding *f = doc_say(d, DOC_WARN, 50, "net.budget",
                                    "the kernel receives only %lld packets or %lld us at a time",
                                    (long long)packets, (long long)usecs);
    doc_means(f, "the card's ring fills up while the kernel does other things");
    doc_sysctl(f, "net.core.netdev_budget", "600");
    doc_sysctl(f, "net.core.netdev_budget_usecs", "8000");
}

void doc_check_buffers(struct doctor *d)
{
    if (doc_load_count(&d->load, DOC_CAM_GIGE) == 0)
        return;
    bool packet_socket = doc_has_cap(d, CAP_NET_RAW_BIT);
    rmem_max(d, packet_socket);
    rmem_default(d, packet_socket);
    udp_mem(d);
    backlog(d);
    budget(d);
}
