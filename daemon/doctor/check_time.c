/* check_time.c - one clock for all cameras: PTP, and other programs that steer the host's clock. */
#include <string.h>

#include "daemon/doctor/checks.h"

static bool runs(struct doctor *d, const char *comm)
{
    return doc_process(d->host, comm, NULL);
}

/* Two programs that both steer the system clock. */
static void fight(struct doctor *d)
{
    static const char *const steer[] = {"chronyd", "ntpd", "systemd-timesyn", "openntpd"};
    const char *ntp = NULL;
    size_t n = 0;
    for (size_t i = 0; i < sizeof steer / sizeof *steer; i++)
        if (runs(d, steer[i])) {
            ntp = strcmp(steer[i], "systemd-timesyn") == 0 ? "systemd-timesyncd" : steer[i];
            n++;
        }
    /* timemaster starts chronyd or ntpd itself and feeds it, so only one program steers the clock */
    bool master = runs(d, "timemaster"), phc = runs(d, "phc2sys") && !master;
    if (doc_settled(n + phc < 2, d, DOC_OK, 46, "time.daemons", "%s",
                    n + phc == 0 ? "no program sets the system clock"
                                 : "one program sets the system clock"))
        return;
    struct doc_finding *f =
        doc_say(d, d->load.shared_clock ? DOC_FAIL : DOC_WARN, 77, "time.daemons",
                "%s and %s both set the system clock",
                phc ? "phc2sys" : "two of chronyd, ntpd and timesyncd", phc ? ntp : "another");
    doc_means(f, "the clock jumps back and forth: exposure times disagree, and frames do not "
                 "find their sets");
    if (phc)
        doc_command(f, "systemctl disable --now %s",
                    strcmp(ntp, "chronyd") == 0 ? "chrony"
                    : strcmp(ntp, "ntpd") == 0  ? "ntp"
                                                : ntp);
    doc_note(
        f,
        "keep exactly one of them: phc2sys where PTP leads, else chrony; `timemaster` joins both");
}

static void synchronized(struct doctor *d)
{
    struct doc_clock c;
    d->host->clock(d->host, &c);
    if (!c.known) {
        doc_say(d, DOC_UNKNOWN, 20, "time.sync",
                "the kernel does not say whether the clock is right");
    } else if (c.synchronized) {
        doc_say(d, DOC_OK, 38, "time.sync", "system clock is synchronized, to %.3g ms at worst",
                c.max_error_s * 1e3);
    } else {
        struct doc_finding *f = doc_say(d, DOC_WARN, d->load.ptp ? 74 : 18, "time.sync",
                                        "system clock is not synchronized to anything");
        doc_means(f, d->load.ptp ? "as PTP's source it gives the cameras a time that drifts; sets "
                                   "are right among themselves, their date is not"
                                 : "dates of volumes are not comparable with other machines");
        doc_command(f, "apt-get install -y chrony");
    }
}

static void ptp_daemon(struct doctor *d)
{
    bool ptp4l = runs(d, "ptp4l"), phc2sys = runs(d, "phc2sys"), master = runs(d, "timemaster");
    const char *link = d->n_links > 0 ? d->link[0].name : "INTERFACE";
    if (doc_settled(ptp4l && (phc2sys || master), d, DOC_OK, 85, "ptp.daemon", "ptp4l and %s run",
                    master ? "timemaster" : "phc2sys"))
        return;
    if (ptp4l) {
        /* right with software stamps, where ptp4l steers or serves the system clock itself */
        struct doc_finding *f =
            doc_say(d, DOC_WARN, 73, "ptp.daemon", "ptp4l runs without phc2sys");
        doc_means(f, "with hardware stamps the cameras follow the network card's clock, which is "
                     "not the system's: shared_clock then is wrong by their difference");
        doc_command(f, "phc2sys -a -rr >/dev/null 2>&1 &");
        doc_note(f, "leave it if ptp4l uses software stamps (-S); see capture/SYNC.md");
        return;
    }
    if (doc_settled(
            !d->load.shared_clock, d, DOC_OK, 85, "ptp.daemon",
            "no PTP daemon runs here: a camera or the switch leads, which is enough for sets"))
        return;
    struct doc_finding *f = doc_say(d, DOC_FAIL, 85, "ptp.daemon", "no PTP daemon runs");
    doc_means(f, "the cameras elect one of themselves as master, and their time is not the host's: "
                 "with shared_clock frames are matched by wrong times");
    doc_command(f, "apt-get install -y linuxptp");
    doc_note(f,
             "ptp4l -i %s --priority1=10, and phc2sys -a -rr beside it (capture/SYNC.md); or "
             "shared_clock: false: offsets are then fitted, which is nearly as good",
             link);
}

static void stamps(struct doctor *d)
{
    for (size_t i = 0; i < d->n_links; i++) {
        struct doc_nic nic = {.phc = -1};
        const char *name = d->link[i].name;
        if (d->link[i].loopback)
            continue;
        d->host->nic(d->host, name, &nic);
        if (!nic.stamp_known) {
            doc_say(d, DOC_UNKNOWN, 40, "ptp.stamps", "%s does not say how it stamps packets",
                    name);
        } else if (nic.hw_stamps && nic.phc >= 0) {
            doc_say(d, DOC_OK, 53, "ptp.stamps", "%s stamps packets in hardware (/dev/ptp%d)", name,
                    nic.phc);
        } else {
            struct doc_finding *f =
                doc_say(d, DOC_WARN, 53, "ptp.stamps", "%s cannot stamp packets in hardware", name);
            doc_means(f, "PTP is right to some 10 to 100 us instead of under 1 us; enough to match "
                         "frames, not to measure fast flames");
            doc_note(f, "a card with a PTP clock (Intel i210, i225 and others), or a camera or "
                        "switch as grandmaster");
        }
    }
}

void doc_check_time(struct doctor *d)
{
    fight(d);
    synchronized(d);
    if (!d->load.ptp)
        return;
    ptp_daemon(d);
    stamps(d);
}
