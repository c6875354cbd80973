/* pyrovox doctor: every check in a good and a bad state, on made-up hosts; the readers of the
 * kernel's files; the report and the script of remedies. */
#include <cjson/cJSON.h>

#include "base/file.h"
#include "daemon/config/config.h"
#include "daemon/doctor/checks.h"
#include "daemon/doctor/doctor.h"
#include "daemon/doctor/firewall.h"
#include "daemon/doctor/host.h"
#include "daemon/doctor/parse.h"
#include "tests/lib/scratch.h"
#include "tests/t.h"

/* ---- a made-up host --------------------------------------------------------------------------- */

static struct doctor doctor; /* large */
static struct doc_nic nic;
static struct doc_clock clock_state;
#define NFT_EMPTY "{\"nftables\": [{\"metainfo\": {\"version\": \"1.0.6\"}}]}"
static const char *nft_text, *ipt_text; /* NULL: not installed */
static pvx_err tool_error;
static double space;
static uint64_t file_caps;
static void (*meanwhile)(void); /* what happens between two looks at the counters */

static void put(const char *path, const char *text)
{
    char folder[512];
    snprintf(folder, sizeof folder, "%s%s", dir, path);
    *strrchr(folder, '/') = '\0';
    struct pvx_diag d = {""};
    if (pvx_mkdirs(folder, &d) != PVX_OK ||
        pvx_file_write(at("%s", path), text, strlen(text), &d) != PVX_OK)
        printf("  cannot write %s: %s\n", path, d.text);
}
static void put_in(const char *root, const char *rest, const char *text)
{
    char path[160];
    snprintf(path, sizeof path, "%s%s", root, rest);
    put(path, text);
}
static void cut(const char *path)
{
    unlink(at("%s", path));
}
/* What a file has to say that the script made: good until the next. */
static char *made(const char *path)
{
    static char *text;
    size_t len;
    free(text);
    T_EQ_I(pvx_file_read(at("%s", path), 65536, &text, &len, NULL), PVX_OK);
    if (text == NULL)
        abort();
    return text;
}

static void get_nic(struct doc_host *h, const char *ifname, struct doc_nic *out)
{
    (void)h, (void)ifname;
    *out = nic;
}
static void get_clock(struct doc_host *h, struct doc_clock *out)
{
    (void)h;
    *out = clock_state;
}
static pvx_err get_run(struct doc_host *h, const char *const *argv, char *out, size_t size,
                       struct pvx_diag *d)
{
    (void)h;
    const char *text = strcmp(argv[0], "nft") == 0 ? nft_text : ipt_text;
    if (tool_error != PVX_OK)
        return pvx_fail(d, tool_error, "%s: Operation not permitted (you must be root)", argv[0]);
    if (text == NULL)
        return pvx_fail(d, PVX_ENOENT, "%s is not installed", argv[0]);
    snprintf(out, size, "%s", text);
    return PVX_OK;
}
static bool get_space(struct doc_host *h, const char *path, double *bytes)
{
    (void)h, (void)path;
    *bytes = space;
    return space >= 0;
}
static bool get_caps(struct doc_host *h, const char *path, uint64_t *permitted)
{
    (void)h, (void)path;
    *permitted = file_caps;
    return file_caps != 0;
}
static void get_wait(struct doc_host *h, double s)
{
    (void)h, (void)s;
    if (meanwhile != NULL)
        meanwhile();
}

static struct doc_host host;

#define ROUTES_HEAD \
    "Iface\tDestination\tGateway \tFlags\tRefCnt\tUse\tMetric\tMask\t\tMTU\tWindow\tIRTT\n"
#define CAM_ROUTE "cam0\t000AA8C0\t00000000\t0001\t0\t0\t0\t00FFFFFF\t0\t0\t0\n"
#define LAN_ROUTES                                                 \
    "lan0\t00000000\t0101000A\t0003\t0\t0\t0\t00000000\t0\t0\t0\n" \
    "lan0\t0001000A\t00000000\t0001\t0\t0\t0\t00FFFFFF\t0\t0\t0\n"
#define LIMITS(memlock, rtprio, nofile)                                                      \
    "Limit                     Soft Limit           Hard Limit           Units     \n"       \
    "Max locked memory         " memlock "            " memlock "            bytes     \n"   \
    "Max open files            " nofile "                 20000                files     \n" \
    "Max realtime priority     " rtprio "                    " rtprio "                    \n"
#define SNMP(reasm, rcvbuf, mem)                                                             \
    "Ip: Forwarding DefaultTTL ReasmReqds ReasmOKs ReasmFails\nIp: 2 64 0 0 " reasm "\n"     \
    "Udp: InDatagrams NoPorts InErrors OutDatagrams RcvbufErrors SndbufErrors InCsumErrors " \
    "IgnoredMulti MemErrors\nUdp: 69 0 0 74 " rcvbuf " 0 0 2 " mem "\n"
#define UDP_HEAD                                                                                  \
    "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout " \
    "inode ref pointer drops\n"

/* A host on which everything is well, for 4 GigE cameras on cam0, with PTP and a recording. */
static void good_host(void)
{
    scratch_remove();
    scratch_new();
    put("/proc/sys/net/core/rmem_max", "33554432\n");
    put("/proc/sys/net/core/rmem_default", "4194304\n");
    put("/proc/sys/net/ipv4/udp_mem", "100000\t150000\t200000\n");
    put("/proc/sys/net/core/netdev_max_backlog", "1000\n");
    put("/proc/sys/net/core/netdev_budget", "300\n");
    put("/proc/sys/net/core/netdev_budget_usecs", "8000\n");
    put("/proc/net/route", ROUTES_HEAD LAN_ROUTES CAM_ROUTE);
    put("/sys/class/net/cam0/type", "1\n");
    put("/sys/class/net/cam0/device/vendor", "0x8086\n");
    put("/sys/class/net/cam0/carrier", "1\n");
    put("/sys/class/net/cam0/speed", "1000\n");
    put("/sys/class/net/cam0/duplex", "full\n");
    put("/sys/class/net/cam0/mtu", "9000\n");
    put("/sys/class/net/cam0/queues/rx-0/rps_cpus", "0\n");
    static const char *const counters[] = {"rx_missed_errors", "rx_fifo_errors",   "rx_over_errors",
                                           "rx_crc_errors",    "rx_length_errors", "rx_dropped"};
    for (size_t i = 0; i < sizeof counters / sizeof *counters; i++)
        put_in("/sys/class/net/cam0/statistics/", counters[i], "0\n");
    put("/proc/sys/net/ipv4/conf/all/rp_filter", "1\n");
    put("/proc/sys/net/ipv4/conf/cam0/rp_filter", "1\n");
    put("/proc/net/snmp", SNMP("0", "0", "0"));
    put("/proc/net/softnet_stat", "0066d8cc 00000000 00000001 0 0 0 0 0 0 0 0 0 0 0 0\n");
    put("/proc/net/udp",
        UDP_HEAD " 1049: 0100007F:2328 00000000:0000 07 00000000:00000000 00:00000000 00000000     "
                 "0        0 4096 2 ffff888 0         \n");
    put("/proc/interrupts", "           CPU0       CPU1       \n"
                            "  24:     600000     500000  PCI-MSI 1-edge      cam0-TxRx-0\n"
                            "  25:     500000     600000  PCI-MSI 2-edge      cam0-TxRx-1\n");
    put("/sys/devices/system/cpu/online", "0-3\n");
    put("/proc/loadavg", "0.10 0.20 0.30 1/200 4000\n");
    put("/proc/cpuinfo", "processor\t: 0\nflags\t\t: fpu sse2 avx2 avx512vl\n");
    put("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "performance\n");
    put("/sys/devices/system/cpu/cpu0/cpufreq/energy_performance_preference", "performance\n");
    put("/sys/devices/system/cpu/cpu0/cpuidle/state0/latency", "0\n");
    put("/sys/devices/system/cpu/cpu0/cpuidle/state0/name", "POLL\n");
    put("/proc/meminfo", "MemTotal: 32000000 kB\nMemAvailable:   16000000 kB\nSwapTotal: 0 kB\n");
    put("/proc/sys/vm/swappiness", "60\n");
    put("/sys/kernel/mm/transparent_hugepage/enabled", "always [madvise] never\n");
    put("/sys/kernel/mm/transparent_hugepage/defrag", "always defer [madvise] never\n");
    put("/proc/self/limits", LIMITS("unlimited", "20", "1024"));
    put("/proc/self/status", "Name:\tx\nUid:\t1000\t1000\t1000\t1000\nGroups:\t44 46 1000 \n"
                             "CapEff:\t0000000000802000\n");
    put("/etc/group", "root:x:0:\nvideo:x:44:me\nplugdev:x:46:me\n");
    put("/proc/sys/kernel/sched_rt_runtime_us", "950000\n");
    put("/proc/sys/kernel/osrelease", "6.1.0-56-amd64\n");
    put("/proc/100/comm", "ptp4l\n");
    put("/proc/101/comm", "phc2sys\n");
    put("/proc/net/ip_tables_names", "");
    put("/dev/video0", "");
    nic = (struct doc_nic){.ring_known = true,
                           .rx_ring = 4096,
                           .rx_ring_max = 4096,
                           .pause_known = true,
                           .tx_pause = true,
                           .coalesce_known = true,
                           .adaptive_rx = true,
                           .rx_usecs = 3,
                           .stamp_known = true,
                           .hw_stamps = true,
                           .phc = 0};
    clock_state = (struct doc_clock){.known = true, .synchronized = true, .max_error_s = 1e-3};
    nft_text = NFT_EMPTY;
    ipt_text = NULL;
    tool_error = PVX_OK;
    space = 4e12;
    file_caps = 0;
    meanwhile = NULL;
    host = (struct doc_host){.root = dir,
                             .nic = get_nic,
                             .clock = get_clock,
                             .run = get_run,
                             .space = get_space,
                             .file_caps = get_caps,
                             .wait = get_wait,
                             .sample_s = 1,
                             .exe_dir = "/opt/pyrovox/bin"};
    memset(&doctor, 0, sizeof doctor);
    doc_load_assumed(&doctor.load);
    doctor.load.n = 4;
    doctor.load.bytes_per_s = 4 * 20.0 * 921600;
    for (uint32_t i = 0; i < 4; i++)
        doctor.load.camera[i].address = 0xC0A80A0B + i; /* 192.168.10.11 .. */
    doctor.load.ptp = doctor.load.shared_clock = true;
    doctor.load.packet_delay_ns = 40000;
    snprintf(doctor.load.record, sizeof doctor.load.record, "/data");
    doctor.host = &host;
}

static const struct doc_finding *finding(const char *id)
{
    for (size_t i = 0; i < doctor.report.n; i++)
        if (strcmp(doctor.report.f[i].id, id) == 0)
            return &doctor.report.f[i]; /* sorted: the worst of this name */
    static const struct doc_finding none = {.verdict = DOC_N_VERDICT, .what = "(no such finding)"};
    return &none;
}
static bool has_remedy(const struct doc_finding *f, const char *part)
{
    for (size_t i = 0; i < f->n_fix; i++) {
        char line[512];
        snprintf(line, sizeof line, "%s=%s", f->fix[i].file, f->fix[i].text);
        if (strstr(line, part) != NULL)
            return true;
    }
    return false;
}
static const char *const verdict_name[] = {"OK", "WARN", "FAIL", "UNKNOWN", "absent"};
/* Examine and look at one finding. */
static void expect(const char *id, enum doc_verdict v, const char *text, const char *remedy)
{
    doc_run(&doctor);
    const struct doc_finding *f = finding(id);
    T_CHECK_(f->verdict == v, "%s is %s (%s), want %s", id, verdict_name[f->verdict], f->what,
             verdict_name[v]);
    if (text != NULL)
        T_CONTAINS(f->what, text);
    if (remedy != NULL)
        T_CHECK_(has_remedy(f, remedy), "%s has no remedy with \"%s\"", id, remedy);
    if (v != DOC_OK && v != DOC_N_VERDICT)
        T_OK(f->verdict == DOC_UNKNOWN || f->means[0] != '\0');
}

/* A card, a card without double precision, pocl; or none, and why. */
static size_t n_cards;
static size_t get_cards(struct doc_host *h, struct doc_card out[REC_CL_MOST], struct pvx_diag *d)
{
    (void)h;
    const struct doc_card all[] = {
        {.info = {.name = "Fast 9000",
                  .platform = "Fast CL",
                  .driver = "5.1",
                  .kind = REC_CL_GPU,
                  .memory = 80000000000u},
         .rates = {2.5e12, 2.4e10, 2.3e10}},
        {.info = {.name = "Small 1",
                  .platform = "Small CL",
                  .kind = REC_CL_GPU,
                  .why_not = "it has no double precision (cl_khr_fp64)"}},
        {.info = {.name = "pthread-any",
                  .platform = "Portable Computing Language",
                  .kind = REC_CL_CPU},
         .slow = "it did not answer for 10 s"}};
    memcpy(out, all, n_cards * sizeof *out);
    if (n_cards == 0)
        (void)pvx_fail(d, PVX_ENOENT, "OpenCL cannot be loaded: install ocl-icd-libopencl1");
    return n_cards;
}

T_CASE(cards)
{
    good_host();
    host.cards = get_cards;
    n_cards = 3;
    doc_run(&doctor);
    T_EQ_I(doc_exit_status(&doctor.report), 0);
    size_t seen = 0;
    for (size_t i = 0; i < doctor.report.n; i++) {
        const char *what = doctor.report.f[i].what;
        if (strcmp(doctor.report.f[i].id, "compute.card") != 0)
            continue;
        seen++;
        if (strstr(what, "Fast 9000: graphics card, 80 GB, Fast CL, driver 5.1; copies 2500.0 GB/s,"
                         " 24.0 GB/s from the host, 23.0 GB/s to it") == NULL)
            T_CONTAINS(what, strstr(what, "Small") != NULL
                                 ? "it cannot be used: it has no double precision"
                                 : "a processor, used only by its name");
    }
    T_EQ_I(seen, 3);
    n_cards = 0;
    expect("compute.card", DOC_OK, "on the processors alone: OpenCL cannot be loaded", NULL);
    expect("compute.device", DOC_N_VERDICT, NULL, NULL);
}

T_CASE(card_of_the_configuration)
{
    good_host();
    host.cards = get_cards;
    n_cards = 3;
    snprintf(doctor.load.compute, sizeof doctor.load.compute, "opencl");
    expect("compute.device", DOC_N_VERDICT, NULL, NULL);
    snprintf(doctor.load.compute, sizeof doctor.load.compute, "opencl:fast");
    expect("compute.device", DOC_N_VERDICT, NULL, NULL);
    snprintf(doctor.load.compute, sizeof doctor.load.compute, "opencl:small");
    expect("compute.device", DOC_FAIL, "no OpenCL device named small that can be used", "auto");
    snprintf(doctor.load.compute, sizeof doctor.load.compute, "opencl:Portable");
    expect("compute.device", DOC_FAIL, "named Portable", "compute: auto");
    n_cards = 0;
    expect("compute.device", DOC_FAIL, NULL, "ocl-icd-libopencl1");
    snprintf(doctor.load.compute, sizeof doctor.load.compute, "auto");
    expect("compute.device", DOC_N_VERDICT, NULL, NULL);
}

T_CASE(all_is_well)
{
    good_host();
    doc_run(&doctor);
    for (size_t i = 0; i < doctor.report.n; i++)
        T_CHECK_(doctor.report.f[i].verdict == DOC_OK, "%s: %s", doctor.report.f[i].id,
                 doctor.report.f[i].what);
    T_EQ_I(doc_exit_status(&doctor.report), 0);
    T_EQ_I(doctor.n_links, 1);
    T_EQ_S(doctor.link[0].name, "cam0");
    T_EQ_I(doctor.link[0].cameras, 4);
    T_LE(35, doctor.report.n); /* that many things were looked at */
}

T_CASE(socket_buffers)
{
    good_host();
    put("/proc/sys/net/core/rmem_max", "212992\n");
    expect("net.rmem_max", DOC_WARN, "0.20 MiB", "net.core.rmem_max=33554432");
    put("/proc/self/status", "Uid:\t1000\t1000\nGroups:\t44 46 \nCapEff:\t0000000000000000\n");
    expect("net.rmem_max", DOC_FAIL, "0.88", "net.core.rmem_max=33554432");
    expect("cap.net_raw", DOC_WARN, NULL,
           "setcap cap_net_raw,cap_sys_nice+ep /opt/pyrovox/bin/pyrovoxd");
    put("/proc/sys/net/core/rmem_default", "212992\n");
    expect("net.rmem_default", DOC_WARN, NULL, "net.core.rmem_default=1048576");
    file_caps = 1 << 13;
    expect("net.rmem_max", DOC_WARN, NULL, NULL);
    expect("cap.net_raw", DOC_OK, NULL, NULL);
    file_caps = 0;
    put("/etc/systemd/system/pyrovoxd.service",
        "[Service]\nAmbientCapabilities=CAP_NET_RAW CAP_SYS_NICE\n");
    expect("cap.net_raw", DOC_OK, NULL, NULL);
    put("/etc/systemd/system/pyrovoxd.service", "[Service]\nLimitRTPRIO=20\n");
    expect("cap.net_raw", DOC_WARN, NULL, NULL);
    put("/proc/sys/net/core/rmem_max", "4194304\n");
    expect("cap.net_raw", DOC_OK, "large enough", NULL); /* the service as it comes */
    doctor.load.socket_buffer = 8388608;
    expect("net.rmem_max", DOC_WARN, "4.0 MiB, gige.socket_buffer asks for 8.0",
           "rmem_max=33554432");
    cut("/proc/sys/net/core/rmem_max");
    expect("net.rmem_max", DOC_UNKNOWN, "cannot be read", NULL);
    put("/proc/sys/net/ipv4/udp_mem", "100 150 200\n");
    expect("net.udp_mem", DOC_FAIL, "0.8 MiB", "net.ipv4.udp_mem=");
}

T_CASE(backlog_and_budget)
{
    good_host();
    put("/sys/class/net/cam0/queues/rx-0/rps_cpus", "0000,0000000f\n");
    expect("net.backlog", DOC_WARN, "cam0 queues at most 1000",
           "net.core.netdev_max_backlog=65536");
    put("/proc/sys/net/core/netdev_max_backlog", "8192\n");
    expect("net.backlog", DOC_OK, NULL, NULL);
    put("/proc/sys/net/core/netdev_budget", "64\n");
    expect("net.budget", DOC_WARN, "64 packets", "net.core.netdev_budget=600");
}

T_CASE(cable_and_speed)
{
    good_host();
    put("/sys/class/net/cam0/carrier", "0\n");
    expect("net.carrier", DOC_FAIL, "cam0", "ip link set cam0 up");
    good_host();
    put("/proc/net/route",
        ROUTES_HEAD "inner0\t000AA8C0\t00000000\t0001\t0\t0\t0\t00FFFFFF\t0\t0\t0\n");
    expect("net.carrier", DOC_UNKNOWN, "container", NULL);
    good_host();
    put("/sys/class/net/cam0/speed", "100\n");
    expect("net.speed", DOC_FAIL, "100 Mb/s", "lower fps");
    put("/sys/class/net/cam0/speed", "700\n");
    expect("net.speed", DOC_WARN, NULL, NULL);
    put("/sys/class/net/cam0/speed", "-1\n");
    expect("net.speed", DOC_UNKNOWN, NULL, NULL);
    put("/sys/class/net/cam0/duplex", "half\n");
    expect("net.duplex", DOC_FAIL, NULL, "autoneg on");
    put("/sys/class/net/cam0/wireless/x", "");
    expect("net.wireless", DOC_FAIL, "cam0 is wireless", NULL);
}

T_CASE(packet_size)
{
    good_host();
    put("/sys/class/net/cam0/mtu", "1500\n");
    expect("net.mtu", DOC_WARN, "no jumbo frames", "ip link set cam0 mtu 9000");
    doctor.load.packet_size = 9000;
    expect("net.mtu", DOC_FAIL, "packet_size asks for 9000", "gige.packet_size: 1500");
    doctor.load.packet_size = 1500;
    expect("net.mtu", DOC_WARN, NULL, NULL);
}

T_CASE(burst)
{
    good_host(); /* PTP: they expose together */
    doctor.load.packet_delay_ns = 0;
    /* 4 x 921600 bytes at 1 Gb/s each onto 1 Gb/s: 3/4 of a set waits in the switch; a packet of 1500
     * bytes takes 1538 x 8 ns, each camera pauses for those of the three others */
    expect("net.burst", DOC_WARN, "must keep 2.8 MB", "gige.packet_delay_ns: 36912 ");
    doctor.load.packet_delay_ns = 36912;
    expect("net.burst", DOC_OK, "pause", NULL);
    doctor.load.packet_delay_ns = 0;
    put("/sys/class/net/cam0/speed", "10000\n");
    expect("net.burst", DOC_OK, "do not flood", NULL);
    put("/sys/class/net/cam0/speed", "1000\n");
    doctor.load.ptp = false;
    expect("net.burst", DOC_N_VERDICT, NULL, NULL); /* free running: chance spreads them */
}

T_CASE(the_card)
{
    good_host();
    nic.rx_ring = 256;
    expect("net.ring", DOC_WARN, "256 packets, it could be 4096", "ethtool -G cam0 rx 4096");
    nic.ring_known = false;
    expect("net.ring", DOC_UNKNOWN, NULL, NULL);
    nic.tx_pause = false;
    expect("net.pause", DOC_WARN, NULL, "ethtool -A cam0 rx on tx on");
    nic.pause_known = false;
    expect("net.pause", DOC_UNKNOWN, NULL, NULL);
    nic.rx_usecs = 1000;
    expect("net.coalesce", DOC_WARN, "1000 us", "rx-usecs 100");
    nic.rx_usecs = 0;
    nic.adaptive_rx = false;
    expect("net.coalesce", DOC_WARN, "every single packet", "rx-usecs 50");
    nic.eee_known = nic.eee_active = true;
    expect("net.eee", DOC_WARN, NULL, "eee off");
}

T_CASE(routes)
{
    good_host();
    put("/proc/net/route", ROUTES_HEAD LAN_ROUTES);
    expect("net.route", DOC_FAIL, "192.168.10.11) is not on a network of this host, only behind",
           "ip address add 192.168.10.1/24");
    put("/proc/net/route", ROUTES_HEAD);
    expect("net.route", DOC_FAIL, "is not on a network of this host", NULL);
    /* two cards in one network: the strict filter drops what comes by the other */
    put("/proc/net/route",
        ROUTES_HEAD CAM_ROUTE "cam1\t000AA8C0\t00000000\t0001\t0\t0\t0\t00FFFFFF\t0\t0\t0\n");
    expect("net.rp_filter", DOC_FAIL, "cam1 has the same network", "net.ipv4.conf.all.rp_filter=2");
    put("/proc/sys/net/ipv4/conf/cam0/rp_filter",
        "2\n"); /* the larger of all's and its own counts */
    expect("net.rp_filter", DOC_OK, "loose", NULL);
    put("/proc/sys/net/ipv4/conf/cam0/rp_filter", "0\n");
    put("/proc/sys/net/ipv4/conf/all/rp_filter", "0\n");
    expect("net.rp_filter", DOC_OK, "off", NULL);
    /* cameras known by name only: every card with a cable is looked at */
    good_host();
    doctor.load.camera[2].address = 0;
    put("/sys/class/net/spare/type", "1\n");
    put("/sys/class/net/spare/device/vendor", "1\n");
    put("/sys/class/net/spare/carrier", "1\n");
    put("/sys/class/net/spare/mtu", "1500\n");
    put("/sys/class/net/dark/type", "1\n");
    put("/sys/class/net/dark/device/vendor", "1\n");
    expect("net.mtu", DOC_WARN, "spare has an MTU of 1500: no jumbo frames, if cameras are on it",
           NULL);
    T_EQ_I(doctor.n_links, 2);
    /* loopback is no card */
    good_host();
    for (uint32_t i = 0; i < 4; i++)
        doctor.load.camera[i].address = 0x7F000002 + i;
    doc_run(&doctor);
    T_EQ_I(doctor.n_links, 1);
    T_EQ_S(doctor.link[0].name, "lo");
    expect("net.backlog", DOC_WARN, "lo queues at most", NULL);
}

static void lose_now(void)
{
    put("/sys/class/net/cam0/statistics/rx_missed_errors", "17\n");
    put("/proc/net/snmp", SNMP("0", "9", "0"));
    put("/sys/class/net/cam0/statistics/rx_dropped", "3\n");
}
T_CASE(counters)
{
    good_host();
    put("/sys/class/net/cam0/statistics/rx_missed_errors", "12\n");
    put("/sys/class/net/cam0/statistics/rx_crc_errors", "4\n");
    expect("net.missed", DOC_WARN, "12 packets lost in the network card", "ethtool -G");
    expect("net.crc", DOC_WARN, "4 packets that arrived damaged on cam0 since", "cable");
    meanwhile = lose_now;
    put("/proc/net/snmp", SNMP("0", "5", "0"));
    put("/sys/class/net/cam0/statistics/rx_missed_errors", "12\n");
    expect("net.missed", DOC_FAIL, "5 packets lost in the network card", NULL);
    put("/proc/net/snmp", SNMP("0", "5", "0"));
    expect("net.rcvbuf", DOC_FAIL, "4 packets lost because a socket's buffer", "net.core.rmem_max");
    put("/sys/class/net/cam0/statistics/rx_dropped", "0\n");
    expect("net.dropped", DOC_WARN, "3 packets", NULL);
    good_host();
    put("/proc/net/snmp", SNMP("2", "0", "7"));
    expect("net.reasm", DOC_WARN, "2 IP fragments", "packet_size");
    expect("net.udpmem", DOC_WARN, "7 packets", "net.ipv4.udp_mem");
    put("/proc/net/softnet_stat", "00100000 00000010 00010000 0\n00100000 00000000 00000000 0\n");
    expect("net.softnet", DOC_WARN, "16 packets", "net.core.netdev_max_backlog");
    expect("net.squeeze", DOC_WARN, "65536 times", "netdev_budget");
    put("/proc/net/udp", UDP_HEAD "  1: 0100007F:C001 00000000:0000 07 00000000:00000000 "
                                  "00:00000000 00000000  0  0 1 2 0 21 \n");
    expect("net.sockets", DOC_WARN, "21 packets", NULL);
}

T_CASE(firewall)
{
    good_host();
    expect("net.firewall", DOC_OK, NULL, NULL);
    nft_text =
        "{\"nftables\": [{\"table\": {\"family\": \"inet\", \"name\": \"filter\"}}, {\"chain\": "
        "{\"family\": \"inet\", \"table\": \"filter\", \"name\": \"input\", \"type\": \"filter\", "
        "\"hook\": \"input\", \"prio\": 0, \"policy\": \"drop\"}}]}";
    expect("net.firewall", DOC_FAIL, "policy drop",
           "nft insert rule inet filter input iifname cam0 meta l4proto udp accept");
    nft_text = NULL;
    ipt_text = "*filter\n:INPUT DROP [0:0]\n-A INPUT -i cam+ -j ACCEPT\nCOMMIT\n";
    expect("net.firewall", DOC_OK, NULL, NULL);
    ipt_text =
        "*filter\n:INPUT ACCEPT [0:0]\n-A INPUT -i lo -j ACCEPT\n-A INPUT -p udp -j DROP\nCOMMIT\n";
    expect("net.firewall", DOC_FAIL, "-A INPUT -p udp -j DROP", "iptables -I INPUT -i cam0");
    tool_error = PVX_EPERM;
    put("/sys/module/nf_tables/x", "");
    expect("net.firewall", DOC_UNKNOWN, "not permitted", "sudo pyrovox doctor");
    tool_error = PVX_OK;
    ipt_text = NULL;
    expect("net.firewall", DOC_UNKNOWN, "not installed", NULL);
}

/* Rules as `nft -j list ruleset` (1.0.6) prints them, with ' for ". */
#define MATCH(op, left, right) "{'match':{'op':'" op "','left':" left ",'right':" right "}},"
#define META(key)              "{'meta':{'key':'" key "'}}"
#define FIELD(proto, field)    "{'payload':{'protocol':'" proto "','field':'" field "'}}"
#define STATE                  "{'ct':{'key':'state'}}"
#define ACCEPT                 "{'accept':null}"
#define DROP                   "{'drop':null}"
#define PORTS                  "{'range':[1024,65535]}"

/* Does the stream of a camera 192.168.10.11 on cam0 pass these rules of an input chain? */
static enum doc_pass nft_json(const char *text)
{
    char json[2048], why[256], chain[256];
    struct doc_stream s = {"cam0", 0xC0A80A0B};
    snprintf(json, sizeof json, "%s", text);
    for (char *p = json; *p != '\0'; p++)
        *p = *p == '\'' ? '"' : *p;
    return doc_firewall_nft(json, &s, why, chain, sizeof why);
}
static enum doc_pass nft(const char *policy, const char *rule)
{
    char text[2048];
    snprintf(text, sizeof text,
             "{'nftables':[{'metainfo':{'version':'1.0.6','json_schema_version':1}},"
             "{'table':{'family':'inet','name':'f','handle':1}},"
             "{'set':{'family':'inet','name':'s','table':'f','elem':['10.0.0.1']}},"
             "{'chain':{'family':'inet','table':'f','name':'other','handle':1}},"
             "{'chain':{'family':'inet','table':'f','name':'in','handle':2,'type':'filter',"
             "'hook':'input','prio':0,'policy':'%s'}},"
             "{'rule':{'family':'inet','table':'f','chain':'other','expr':[" DROP "]}},"
             "{'rule':{'family':'inet','table':'f','chain':'in','handle':5,'expr':[%s]}}]}",
             policy, rule);
    return nft_json(text);
}
T_CASE(nft_rules)
{
    T_EQ_I(nft("accept", ""), DOC_PASS_YES);
    T_EQ_I(nft("drop", ""), DOC_PASS_NO);
    T_EQ_I(nft("drop", MATCH("==", META("iifname"), "'cam0'") ACCEPT), DOC_PASS_YES);
    T_EQ_I(
        nft("drop", MATCH("==", META("iifname"),
                          "{'set':['lo','cam0']}") "{'counter':{'packets':3,'bytes':9}}," ACCEPT),
        DOC_PASS_YES);
    T_EQ_I(nft("drop", MATCH("!=", META("iifname"), "'cam0'") ACCEPT), DOC_PASS_NO);
    T_EQ_I(nft("drop", MATCH("==", META("iif"), "'lo'") ACCEPT), DOC_PASS_NO);
    T_EQ_I(nft("drop",
               MATCH("==", FIELD("ip", "saddr"), "{'prefix':{'addr':'192.168.10.0','len':24}}")
                   MATCH("==", FIELD("udp", "dport"), PORTS) ACCEPT),
           DOC_PASS_YES);
    T_EQ_I(nft("drop",
               MATCH("==", FIELD("ip", "saddr"),
                     "{'set':['10.0.0.1',{'prefix':{'addr':'192.168.11.0','len':24}}]}") ACCEPT),
           DOC_PASS_NO);
    T_EQ_I(nft("drop", MATCH("==", FIELD("udp", "dport"), "3956") ACCEPT), DOC_PASS_NO);
    T_EQ_I(nft("drop", MATCH("==", FIELD("udp", "dport"), "{'set':[22," PORTS "]}") ACCEPT),
           DOC_PASS_YES);
    T_EQ_I(nft("drop", MATCH("in", STATE, "['established','related']") ACCEPT), DOC_PASS_NO);
    T_EQ_I(nft("drop", MATCH("==", STATE, "{'set':['established','related']}") ACCEPT),
           DOC_PASS_NO);
    T_EQ_I(nft("accept", MATCH("!=", STATE, "'established'") DROP), DOC_PASS_NO);
    T_EQ_I(nft("drop", MATCH("in", STATE, "'new'")
                           MATCH("==", META("l4proto"), "{'set':['tcp','udp']}") ACCEPT),
           DOC_PASS_YES);
    T_EQ_I(nft("drop", MATCH("==", FIELD("ip", "saddr"), "'@s'") ACCEPT), DOC_PASS_UNSURE);
    T_EQ_I(nft("drop", "{'jump':{'target':'other'}}"), DOC_PASS_UNSURE);
    T_EQ_I(nft("accept", "{'goto':{'target':'other'}}"), DOC_PASS_UNSURE);
    T_EQ_I(nft("accept", MATCH("==", META("iifname"), "'cam*'")
                             MATCH("==", FIELD("udp", "dport"), PORTS) DROP),
           DOC_PASS_NO);
    T_EQ_I(nft("accept", MATCH("==", FIELD("tcp", "dport"), "22") DROP), DOC_PASS_YES);
    T_EQ_I(nft("accept", MATCH("==", FIELD("ip6", "saddr"), "'::1'") DROP), DOC_PASS_YES);
    T_EQ_I(nft("accept", MATCH("==", META("nfproto"), "'ipv4'") "{'log':{'prefix':'x '}},"
                                                                "{'reject':{'type':'icmp'}}"),
           DOC_PASS_NO);
    T_EQ_I(nft("accept", MATCH(">", FIELD("udp", "length"), "9000") DROP), DOC_PASS_UNSURE);
    T_EQ_I(nft("accept", "{'limit':{'rate':10,'burst':5,'per':'second'}}," DROP), DOC_PASS_UNSURE);
    T_EQ_I(nft("accept", MATCH("==", META("iifname"), "'cam0'") ACCEPT
               "]}},"
               "{'rule':{'family':'inet','table':'f','chain':'in','handle':6,'expr':[" DROP),
           DOC_PASS_YES);
}
T_CASE(nft_maps)
{
#define VMAP(key, pairs) "{'vmap':{'key':" key ",'data':{'set':[" pairs "]}}}"
    T_EQ_I(nft("drop", VMAP(STATE, "['invalid'," DROP "],['established'," ACCEPT "]")),
           DOC_PASS_NO);
    T_EQ_I(nft("drop", VMAP(META("iifname"), "['lo'," DROP "],['cam0'," ACCEPT "]")), DOC_PASS_YES);
    T_EQ_I(nft("drop", VMAP(META("iifname"), "['cam0',{'jump':{'target':'other'}}]")),
           DOC_PASS_UNSURE);
    T_EQ_I(nft("drop", VMAP(META("mark"), "[1," ACCEPT "]")), DOC_PASS_UNSURE);
    T_EQ_I(nft("accept", VMAP(FIELD("tcp", "dport"), "[22," DROP "]")), DOC_PASS_YES);
}
/* What is no ruleset is never taken for leave to pass. */
T_CASE(nft_malformed)
{
    static const char *const bad[] = {
        "", "{", "[]", "null", "{'nftables':{}}", "{'nftables':[", "table inet filter {\n}\n"};
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; i++)
        T_EQ_I(nft_json(bad[i]), DOC_PASS_UNSURE);
    T_EQ_I(nft("drop", "7,null,'x',[],{},{'match':3},{'vmap':[]},{'match':{'op':'=='}}"),
           DOC_PASS_UNSURE);
    T_EQ_I(nft("accept", "{'vmap':{'key':" STATE ",'data':{'set':[3,['new'],['new',3]]}}}"),
           DOC_PASS_UNSURE);
    T_EQ_I(nft_json("{'nftables':[3,{'chain':7},{'rule':null},{'chain':{'type':'filter',"
                    "'hook':'input'}},{'rule':{'expr':3}}]}"),
           DOC_PASS_YES);
}
static enum doc_pass ipt(const char *rules)
{
    char text[1024], why[256], chain[256];
    snprintf(text, sizeof text, "*nat\n:INPUT DROP [0:0]\nCOMMIT\n*filter\n%sCOMMIT\n", rules);
    struct doc_stream s = {"cam0", 0xC0A80A0B};
    return doc_firewall_iptables(text, &s, why, chain, sizeof why);
}
T_CASE(iptables_rules)
{
    T_EQ_I(ipt(":INPUT ACCEPT [0:0]\n"), DOC_PASS_YES);
    T_EQ_I(ipt(":INPUT DROP [0:0]\n"), DOC_PASS_NO);
    T_EQ_I(ipt(":INPUT DROP [0:0]\n-A INPUT -s 192.168.0.0/16 -p udp -m udp --dport 1024:65535 -j "
               "ACCEPT\n"),
           DOC_PASS_YES);
    T_EQ_I(ipt(":INPUT DROP [0:0]\n-A INPUT -p udp -m udp --dport 3956 -j ACCEPT\n"), DOC_PASS_NO);
    T_EQ_I(
        ipt(":INPUT DROP [0:0]\n-A INPUT -m conntrack --ctstate RELATED,ESTABLISHED -j ACCEPT\n"),
        DOC_PASS_NO);
    T_EQ_I(ipt(":INPUT DROP [0:0]\n-A INPUT ! -i lo -m comment --comment \"a b\" -j ACCEPT\n"),
           DOC_PASS_YES);
    T_EQ_I(ipt(":INPUT DROP [0:0]\n-A INPUT -j ufw-before-input\n"), DOC_PASS_UNSURE);
    T_EQ_I(ipt(":INPUT ACCEPT [0:0]\n-A INPUT -j REJECT --reject-with icmp-host-prohibited\n"),
           DOC_PASS_NO);
    T_EQ_I(ipt(":INPUT ACCEPT [0:0]\n-A INPUT -m limit --limit 3/min -j DROP\n"), DOC_PASS_UNSURE);
}

T_CASE(processors)
{
    good_host();
    put("/sys/devices/system/cpu/online", "0\n");
    expect("cpu.count", DOC_WARN, "1 processors", NULL);
    put("/proc/loadavg", "3.50 0.20 0.30 1/200 4000\n");
    expect("cpu.load", DOC_WARN, "3.5 processors of 1", NULL);
    put("/proc/cpuinfo", "flags\t\t: fpu sse2 avx\n");
    expect("cpu.features", DOC_WARN, "no AVX2", NULL);
    put("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "powersave\n");
    expect("cpu.governor", DOC_WARN, "powersave", "echo performance");
    put("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "performance\n");
    put("/sys/devices/system/cpu/cpu0/cpufreq/energy_performance_preference", "power\n");
    expect("cpu.energy", DOC_WARN, "power", "energy_performance_preference");
    put("/sys/devices/system/cpu/cpu0/cpuidle/state1/latency", "890\n");
    put("/sys/devices/system/cpu/cpu0/cpuidle/state1/name", "C10\n");
    expect("cpu.sleep", DOC_WARN, "890 us to wake (C10)", "disable");
    put("/sys/devices/system/cpu/cpu0/cpuidle/state1/disable", "1\n");
    expect("cpu.sleep", DOC_OK, NULL, NULL);
}

T_CASE(interrupts)
{
    good_host();
    put("/proc/interrupts", "           CPU0       CPU1       \n"
                            "  24:    9000000         10  PCI-MSI 1-edge      cam0-TxRx-0\n"
                            "  25:    8000000          0  PCI-MSI 2-edge      cam0-TxRx-1\n"
                            " NMI:          0          0   Non-maskable interrupts\n");
    expect("cpu.irq", DOC_WARN, "all 2 queues of cam0 interrupt processor 0", "irqbalance");
    put("/proc/102/comm", "irqbalance\n");
    expect("cpu.irq", DOC_OK, "balanced", NULL);
}

T_CASE(memory)
{
    good_host();
    put("/proc/meminfo", "MemAvailable:     80000 kB\nSwapTotal:   2000000 kB\n");
    expect("mem.free", DOC_WARN, "0.08 GB", NULL);
    expect("mem.swap", DOC_WARN, "60", "vm.swappiness=1");
    put("/proc/sys/vm/swappiness", "1\n");
    expect("mem.swap", DOC_OK, NULL, NULL);
    put("/proc/meminfo", "MemAvailable:     8000 kB\nSwapTotal: 0 kB\n");
    expect("mem.free", DOC_FAIL, NULL, NULL);
    put("/sys/kernel/mm/transparent_hugepage/enabled", "[always] madvise never\n");
    put("/sys/kernel/mm/transparent_hugepage/defrag", "[always] defer madvise never\n");
    expect("mem.hugepages", DOC_WARN, NULL, "transparent_hugepage/defrag");
}

T_CASE(limits)
{
    good_host();
    put("/proc/self/status", "Uid:\t1000\t1000\nGroups:\t44 46 \nCapEff:\t0000000000002000\n");
    put("/proc/self/limits", LIMITS("8388608", "0", "64"));
    expect("limit.rtprio", DOC_WARN, "rtprio 0", "limits.d/90-pyrovox.conf=@pyrovox - rtprio 20");
    expect("limit.memlock", DOC_WARN, "8.4 MB", "memlock unlimited");
    expect("limit.nofile", DOC_FAIL, "64 files", "nofile 4096");
    put("/proc/sys/kernel/sched_rt_runtime_us", "0\n");
    expect("limit.rt_runtime", DOC_FAIL, NULL, "kernel.sched_rt_runtime_us=950000");
    /* a daemon that runs has limits of its own */
    put("/proc/777/comm", "pyrovoxd\n");
    put("/proc/777/limits", LIMITS("unlimited", "20", "1024"));
    put("/proc/777/status", "Uid:\t990\t990\nGroups:\t44 46 \nCapEff:\t0000000000802000\n");
    expect("limit.rtprio", DOC_OK, "the running pyrovoxd", NULL);
    expect("limit.memlock", DOC_OK, NULL, NULL);
    cut("/proc/777/limits");
    expect("limit.rtprio", DOC_UNKNOWN, NULL, NULL);
}

T_CASE(the_unit)
{
    good_host();
    const char *unit = "[Unit]\nLimitRTPRIO=1\n[Service]\n"
                       "LimitRTPRIO=20\nLimitMEMLOCK=infinity\nSupplementaryGroups=video plugdev\n";
    put("/etc/systemd/system/pyrovoxd.service", unit);
    expect("unit", DOC_OK, "rights", NULL);
    put("/etc/systemd/system/pyrovoxd.service.d/10-x.conf",
        "[Service]\nSupplementaryGroups=\nSupplementaryGroups=plugdev\n");
    expect("unit", DOC_WARN, "SupplementaryGroups=video", "SupplementaryGroups=video");
    put("/etc/systemd/system/pyrovoxd.service.d/20-y.conf",
        "[Service]\nSupplementaryGroups=video\n");
    expect("unit", DOC_OK, NULL, NULL);
    put("/etc/systemd/system/pyrovoxd.service", "[Unit]\nLimitRTPRIO=1\nLimitMEMLOCK=1\n");
    expect("unit", DOC_WARN, NULL, NULL);
}

static void usb_camera(const char *dev, const char *class, const char *sub, const char *speed,
                       const char *power)
{
    char root[64];
    snprintf(root, sizeof root, "/sys/bus/usb/devices/%s", dev);
    put_in(root, ":1.0/bInterfaceClass", class);
    put_in(root, ":1.0/bInterfaceSubClass", sub);
    put_in(root, "/speed", speed);
    put_in(root, "/power/control", power);
    put_in(root, "/product", "Cam");
}
T_CASE(usb)
{
    good_host();
    usb_camera("2-1.4", "ef\n", "05\n", "5000\n", "on\n");
    usb_camera("3-2", "08\n", "06\n", "480\n", "auto\n"); /* a disk: nobody's camera */
    put("/sys/module/usbcore/parameters/usbfs_memory_mb", "1000\n");
    expect("usb.memory", DOC_OK, NULL, NULL);
    expect("usb.autosuspend", DOC_OK, NULL, NULL);
    expect("usb.shared", DOC_OK, NULL, NULL);
    put("/sys/module/usbcore/parameters/usbfs_memory_mb", "4\n");
    expect("usb.memory", DOC_FAIL, "only 4 MiB, 1 camera need 14",
           "echo 256 > /sys/module/usbcore");
    put("/sys/module/usbcore/parameters/usbfs_memory_mb", "0\n"); /* no limit */
    expect("usb.memory", DOC_OK, NULL, NULL);
    cut("/sys/module/usbcore/parameters/usbfs_memory_mb");
    expect("usb.memory", DOC_UNKNOWN, NULL, NULL);
    usb_camera("2-1.3", "ef\n", "05\n", "480\n", "auto\n");
    expect("usb.autosuspend", DOC_WARN, "USB 2-1.3", "echo on > /sys/bus/usb/devices/2-1.3/power");
    expect("usb.speed", DOC_FAIL, "480 Mb/s", NULL);
    usb_camera("1-1", "0e\n", "01\n", "480\n", "on\n");
    usb_camera("1-2", "0e\n", "01\n", "480\n", "on\n");
    usb_camera("1-3", "0e\n", "01\n", "480\n", "on\n");
    expect("usb.shared", DOC_FAIL, "3 cameras share USB bus 1: they need 55 MB/s, it carries 40",
           NULL);
}

T_CASE(access_to_devices)
{
    good_host();
    for (int i = 0; i < 4; i++)
        doctor.load.camera[i].kind = i < 2 ? DOC_CAM_V4L2 : DOC_CAM_USB3;
    put("/sys/module/usbcore/parameters/usbfs_memory_mb", "1000\n");
    put("/usr/lib/udev/rules.d/70-pyrovox-cameras.rules",
        "ENV{ID_USB_INTERFACES}==\"*:ef05*:*\"\n");
    expect("access.video", DOC_OK, NULL, NULL);
    expect("access.plugdev", DOC_OK, NULL, NULL);
    expect("access.udev", DOC_OK, NULL, NULL);
    expect("access.devices", DOC_OK, NULL, NULL);
    expect("net.rmem_max", DOC_N_VERDICT, NULL, NULL); /* no network camera: not looked at */
    cut("/usr/lib/udev/rules.d/70-pyrovox-cameras.rules");
    expect("access.udev", DOC_FAIL, NULL, "70-pyrovox-cameras.rules=SUBSYSTEM");
    put("/proc/self/status", "Uid:\t1000\t1000\nGroups:\t444 1000 \nCapEff:\t0\n");
    expect("access.video", DOC_FAIL, "not in the group video", "adduser");
    expect("access.plugdev", DOC_FAIL, NULL, "plugdev");
    put("/proc/self/status", "Uid:\t0\t0\nGroups:\t0 \nCapEff:\t0\n");
    expect("access.video", DOC_OK, NULL, NULL);
    cut("/dev/video0");
    expect("access.devices", DOC_FAIL, "no /dev/video", "modprobe uvcvideo");
}

T_CASE(clocks)
{
    good_host();
    cut("/proc/101/comm");
    expect("ptp.daemon", DOC_WARN, "without phc2sys", NULL);
    cut("/proc/100/comm");
    expect("ptp.daemon", DOC_FAIL, "no PTP daemon", "linuxptp");
    doctor.load.shared_clock = false;
    expect("ptp.daemon", DOC_OK, "a camera or the switch leads", NULL);
    doctor.load.ptp = false; /* then nobody asks */
    expect("ptp.daemon", DOC_N_VERDICT, NULL, NULL);
    good_host();
    put("/proc/103/comm", "chronyd\n");
    expect("time.daemons", DOC_FAIL, "phc2sys and chronyd", "systemctl disable --now chrony");
    put("/proc/104/comm", "timemaster\n");
    expect("time.daemons", DOC_OK, NULL, NULL);
    clock_state.synchronized = false;
    expect("time.sync", DOC_WARN, "not synchronized", "chrony");
    clock_state.known = false;
    expect("time.sync", DOC_UNKNOWN, NULL, NULL);
    nic.hw_stamps = false;
    expect("ptp.stamps", DOC_WARN, "cannot stamp", NULL);
    nic.stamp_known = false;
    expect("ptp.stamps", DOC_UNKNOWN, NULL, NULL);
}

T_CASE(disks)
{
    good_host();
    expect("disk.space", DOC_OK, NULL, NULL);
    space = 20e9;
    expect("disk.space", DOC_WARN, "271 s", NULL);
    space = 1e9;
    expect("disk.space", DOC_FAIL, NULL, NULL);
    space = -1;
    expect("disk.space", DOC_FAIL, "the folder does not exist", "mkdir -p /data");
    snprintf(doctor.load.record, sizeof doctor.load.record, "%s", dir);
    space = 4e12;
    host.disk_write = 4e6;
    doctor.load.bytes_per_s = 1;
    expect("disk.speed", DOC_OK, NULL, NULL); /* really written */
    doctor.load.bytes_per_s = 1e15;
    expect("disk.speed", DOC_FAIL, NULL, "NVMe");
    snprintf(doctor.load.record, sizeof doctor.load.record, "%s/none", dir);
    expect("disk.speed", DOC_UNKNOWN, "cannot be written", NULL);
}

T_CASE(the_machine)
{
    good_host();
    put("/proc/sys/kernel/osrelease", "4.19.0-27-amd64\n");
    expect("kernel", DOC_WARN, "4.19", NULL);
    put("/proc/sys/kernel/osrelease", "5.10.0\n");
    expect("kernel", DOC_OK, NULL, NULL);
    cut("/proc/sys/kernel/osrelease");
    expect("kernel", DOC_UNKNOWN, NULL, NULL);
    put("/proc/cpuinfo", "flags\t\t: fpu avx2 hypervisor\n");
    put("/sys/class/dmi/id/sys_vendor", "QEMU\n");
    expect("machine", DOC_WARN, "a virtual machine (QEMU)", NULL);
}

/* ---- readers, report, script ------------------------------------------------------------------ */

T_CASE(clipped_blacks)
{
    good_host();
    expect("camera.black", DOC_N_VERDICT, "no such finding", NULL); /* not opened */
    struct doc_load_camera *c = &doctor.load.camera[2];
    c->looked = true;
    expect("camera.black", DOC_UNKNOWN, "gave no picture", "cameras test");
    c->pictured = true;
    expect("camera.black", DOC_OK, "does not clip", NULL);
    c->cut = 0.5;
    c->pedestal = 0.0296;
    expect("camera.black", DOC_WARN,
           ": black is clipped: 50 % of the noise of its dark is cut off at 0",
           "raise the camera's black level by 2.96 % of full scale (8 steps of 8 bits");
    c->looked = false;
}

T_CASE(readers)
{
    struct doc_route r[4];
    struct doc_irqs q;
    uint64_t a, b;
    char word[32];
    T_EQ_I(doc_parse_udp(UDP_HEAD
                         "junk\n 1: 0100007F:0F74 00000000:0000 07 0:0 0:0 0  0  0 1 2 0 7\n"
                         " 2: 0100007F:0F75 00000000:0000 07 0:0 0:0 0  0  0 1 2 0 9   \n"
                         " 3: 0100007F:0F76 00000000:0000 07 0:0 0:0 0  0  0 1 2 0 x\n"),
           16);
    T_EQ_I(doc_parse_routes(ROUTES_HEAD CAM_ROUTE "down0\t0\t0\t0000\t0\t0\t0\t0\n", r, 4), 1);
    T_EQ_I(r[0].dest, 0xC0A80A00);
    T_EQ_I(r[0].mask, 0xFFFFFF00);
    doc_parse_interrupts(
        "  CPU0 CPU1\n 9: 5 6 PCI eth0\n 10: 7 8 PCI eth01\n 11: 1 2 PCI virtio2-eth0\n", "eth0",
        &q);
    T_EQ_I(q.lines, 2);
    T_EQ_I(q.total, 14);
    T_EQ_I(q.busiest_cpu, 1);
    T_EQ_I(q.irq, 9);
    T_OK(doc_parse_limit(LIMITS("unlimited", "5", "77"), "Max open files", &a, &b));
    T_EQ_I(a, 77);
    T_EQ_I(b, 20000);
    T_OK(!doc_parse_limit("Max open", "Max open files", &a, &b));
    T_OK(!doc_parse_snmp("Udp: A B\n", "Udp", "B", &a));
    T_OK(!doc_parse_snmp("Udp: A B\nUdp: 1\n", "Udp", "B", &a));
    T_EQ_I(doc_count_list("0-3,8,10-11"), 7);
    T_EQ_I(doc_count_list("x"), 0);
    T_OK(doc_has_word("a avx2 b", "avx2") && !doc_has_word("a avx2x b", "avx2"));
    doc_bracketed("a [b] c", word, sizeof word);
    T_EQ_S(word, "b");
    T_EQ_S(doc_quote("eth0"), "eth0");
    T_EQ_S(doc_quote("a;b'c"), "'a;b'\\''c'");
}

/* Good until the next. */
static char *capture(void (*print)(FILE *f))
{
    static char *text;
    static size_t len;
    free(text);
    FILE *f = open_memstream(&text, &len);
    print(f);
    fclose(f);
    if (text == NULL)
        abort();
    return text;
}
static void as_text(FILE *f)
{
    const struct doc_style s = {.width = 80};
    doc_print(f, &doctor, &s);
}
static void as_json(FILE *f)
{
    T_EQ_I(doc_print_json(f, &doctor, NULL), PVX_OK);
}
static void as_script(FILE *f)
{
    doc_script(f, &doctor);
}
static void bad_host(void)
{
    good_host();
    put("/proc/sys/net/core/rmem_max", "212992\n");
    put("/proc/net/snmp", SNMP("0", "5", "0"));
    put("/proc/self/status", "Uid:\t1000\t1000\nGroups:\t44 46 \nCapEff:\t0\n");
    put("/proc/self/limits", LIMITS("8388608", "0", "1024"));
    put("/sys/class/net/cam0/mtu", "1500\n");
    put("/etc/systemd/system/pyrovoxd.service", "[Service]\nLimitRTPRIO=20\n");
    put("/proc/sys/vm/swappiness", "60\n");
    doctor.load.frame_bytes = 30000000; /* a large camera: more than the usual buffer */
    doctor.load.packet_size = 9000;
    doc_run(&doctor);
}

T_CASE(report)
{
    bad_host();
    T_EQ_I(doc_exit_status(&doctor.report), 2);
    for (size_t i = 1; i < doctor.report.n; i++) /* failures first, then by weight */
        T_OK(doctor.report.f[i - 1].verdict != doctor.report.f[i].verdict ||
             doctor.report.f[i - 1].weight >= doctor.report.f[i].weight);
    T_EQ_I(doctor.report.f[0].verdict, DOC_FAIL);
    T_EQ_S(doctor.report.f[0].id, "net.mtu");
    char *text = capture(as_text);
    T_CONTAINS(text, "do    sysctl -w net.core.rmem_max=67108864\n");
    T_CONTAINS(text, "net.core.rmem_max = 67108864  in /etc/sysctl.d/90-pyrovox.conf");
    T_OK(strstr(text, "\033") == NULL);
    T_OK(strstr(text, "net.core.rmem_max") > strstr(text, "MTU"));
    for (char *line = strtok(text, "\n"); line != NULL; line = strtok(NULL, "\n"))
        if (strstr(line, " do  ") == NULL && strstr(line, " keep  ") == NULL)
            T_CHECK_(strlen(line) <= 80, "line of %zu columns: %s", strlen(line), line);
    text = capture(as_json);
    cJSON *j = cJSON_Parse(text);
    T_OK(j != NULL);
    cJSON *list = cJSON_GetObjectItem(j, "findings");
    T_EQ_I(cJSON_GetArraySize(list), doctor.report.n);
    T_EQ_S(cJSON_GetObjectItem(cJSON_GetArrayItem(list, 0), "verdict")->valuestring, "fail");
    cJSON_Delete(j);
    good_host();
    tool_error = PVX_EPERM;
    put("/sys/module/nf_tables/x", "");
    doc_run(&doctor);
    T_EQ_I(doc_exit_status(&doctor.report), 1); /* what cannot be told is not well */
}

/* The script, run for an image: files appear, commands are tried, twice is the same as once. */
T_CASE(script)
{
    bad_host();
    char command[700], *conf;
    put("/fix.sh", capture(as_script));
    put("/bin/ip", "#!/bin/sh\necho \"ip $*\" >> \"${0%/*}/said\"\n");
    put("/bin/setcap", "#!/bin/sh\nexit 1\n");
    snprintf(command, sizeof command,
             "cd %s && chmod +x bin/ip bin/setcap; for i in 1 2; do "
             "ROOT=$PWD/image PATH=$PWD/bin:$PATH sh fix.sh > out 2>&1; done; test $? = 1",
             dir);
    T_EQ_I(system(command), 0); /* setcap failed, and the script says so at its end */
    conf = made("/image/etc/sysctl.d/90-pyrovox.conf");
    T_CONTAINS(conf, "net.core.rmem_max = 67108864\n"); /* the larger of two findings' values */
    T_OK(strstr(strstr(conf, "net.core.rmem_max =") + 1, "net.core.rmem_max =") == NULL);
    conf = made("/image/etc/security/limits.d/90-pyrovox.conf");
    T_EQ_S(conf, "@pyrovox - rtprio 20\n@pyrovox - memlock unlimited\n"); /* once each */
    conf = made("/image/etc/systemd/system/pyrovoxd.service.d/90-doctor.conf");
    T_OK(strncmp(conf, "[Service]\n", 10) == 0);
    T_CONTAINS(conf, "LimitMEMLOCK=infinity\n");
    conf = made("/bin/said");
    T_EQ_S(conf, "ip link set cam0 mtu 9000\nip link set cam0 mtu 9000\n");
    conf = made("/out");
    T_CONTAINS(conf, "done, 1 failed");
}

/* What a configuration asks of the host. */
static void load_of(const char *text, struct doc_load *l)
{
    struct dmn_config *c = calloc(1, sizeof *c);
    struct pvx_diag d = {""};
    dmn_config_defaults(c);
    T_EQ_I(dmn_config_parse(text, strlen(text), "my.yaml", c, &d), PVX_OK);
    T_EQ_S(d.text, "");
    T_EQ_I(doc_load_config(c, l, &d), PVX_OK);
    T_EQ_S(d.text, "");
    free(c);
}
#define RING(memory)                                                                         \
    "rig: tests/data/rig4.yaml\nfps: 10\npixel_format: Mono8\ncameras: \"files:x/%d.png\"\n" \
    "buffers: 16\nrecord: {ring: {seconds: 5, memory: " memory "}}\n"
T_CASE(configuration)
{
    static struct doc_load l;
    load_of(
        "rig: tests/data/rig4.yaml\nfps: 10\npixel_format: Mono8\nptp: true\n"
        "gige: {packet_size: 9000, packet_delay_ns: 500}\nrecord: {mode: raw, path: "
        "/data/take-%H.h5}\n"
        "cameras: {cam0: \"aravis:192.168.10.11\", cam1: \"aravis:GV-7\", cam2: \"v4l2:usb-1\", "
        "cam3: \"files:x/%d.png\"}\n",
        &l);
    T_EQ_I(l.n, 4);
    T_EQ_I(l.camera[0].address, 0xC0A80A0B);
    T_EQ_I(doc_load_count(&l, DOC_CAM_GIGE), 2);
    T_EQ_I(doc_load_count(&l, DOC_CAM_V4L2), 1);
    T_EQ_I(doc_load_count(&l, DOC_CAM_OTHER), 1);
    T_NEAR(l.bytes_per_s, 4 * 10.0 * (double)l.frame_bytes, 1e-6);
    T_OK(l.ptp && !l.shared_clock && !l.triggered);
    T_EQ_I(l.packet_size, 9000);
    T_EQ_I(l.packet_delay_ns, 500);
    T_EQ_S(l.record, "/data");
    T_CONTAINS(l.source, "my.yaml: ");
    /* cameras of loopback are simulated: they need no PTP daemon */
    load_of("rig: tests/data/rig4.yaml\ncameras: \"aravis:127.0.0.2+\"\nshared_clock: true\n"
            "trigger: action\n",
            &l);
    T_OK(!l.ptp && !l.shared_clock && l.triggered);
    T_EQ_S(l.record, "");
    /* the ring's frames are memory too: 5 s at 10 Hz, or what fits into its bytes */
    T_EQ_I(l.held, 0);
    load_of(RING("1GB"), &l);
    T_EQ_I(l.held, 50);
    T_NEAR(doc_load_memory(&l), 4.0 * (16 + 50) * (double)l.frame_bytes, 1e-6);
    load_of(RING("500kB"), &l);
    T_EQ_I(l.held, (int)(5e5 / (4.0 * (double)l.frame_bytes)));
    T_OK(l.held < 50);
}

T_CASE(more_than_fits)
{
    good_host();
    doctor.report.n = 0;
    for (int i = 0; i < DOC_MAX_FINDINGS + 5; i++)
        doc_means(doc_say(&doctor, DOC_WARN, 1, "x", "finding %d", i), "nothing");
    T_EQ_I(doctor.report.n, DOC_MAX_FINDINGS);
    T_EQ_I(doctor.report.lost, 5);
}

/* This host: its answers are its own business, but they come, and commands end. */
T_CASE(the_real_host)
{
    struct doc_host h;
    doc_host_init(&h);
    h.sample_s = 0;
    memset(&doctor, 0, sizeof doctor);
    doc_load_assumed(&doctor.load);
    doctor.host = &h;
    doc_run(&doctor);
    T_LE(15, doctor.report.n);
    char out[64];
    struct pvx_diag d = {""};
    const char *const echo[] = {"echo", "hello", NULL}, *const none[] = {"no-such-tool-here", NULL};
    const char *const fails[] = {"sh", "-c", "echo Permission denied >&2; exit 1", NULL};
    T_EQ_I(doc_real_run(&h, echo, out, sizeof out, &d), PVX_OK);
    T_EQ_S(out, "hello\n");
    T_EQ_I(doc_real_run(&h, none, out, sizeof out, &d), PVX_ENOENT);
    d.text[0] = '\0';
    T_EQ_I(doc_real_run(&h, fails, out, sizeof out, &d), PVX_EPERM);
    T_CONTAINS(d.text, "Permission denied");
    const char *const much[] = {"sh", "-c", "yes | head -c 100000", NULL};
    T_EQ_I(doc_real_run(&h, much, out, sizeof out, &d), PVX_OK);
    T_EQ_I(strlen(out), sizeof out - 1);
}

T_MAIN((void)0, scratch_remove())
