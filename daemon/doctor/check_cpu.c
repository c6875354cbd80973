/* check_cpu.c - processors: enough of them, awake, fast, and not all interrupts on one. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/doctor/checks.h"
#include "daemon/doctor/parse.h"

#define WAKE_MAX_US 200 /* a processor that takes longer to wake lets the ring fill up */

/* Processors needed, roughly: receiving (about 200 000 packets/s per processor), binning and photometry
 * (300 MB/s, README), one for solving. */
static double cores_needed(const struct doctor *d)
{
    double packet = d->load.packet_size > 64 ? d->load.packet_size : 1500;
    double packets = doc_load_count(&d->load, DOC_CAM_GIGE) > 0 ? d->load.bytes_per_s / packet : 0;
    return packets / 2e5 + d->load.bytes_per_s / 300e6 + 1;
}

static void check_cpu_number(struct doctor *d)
{
    unsigned n = doc_cpus(d);
    double need = cores_needed(d), load1 = 0;
    char text[128];
    if (n == 0)
        return;
    if ((double)n + 0.25 >= need) {
        doc_say(d, DOC_OK, 60, "cpu.count", "%u processors; cameras and solver need about %.1f", n,
                need);
    } else {
        struct doc_finding *f =
            doc_say(d, DOC_WARN, 72, "cpu.count",
                    "%u processors; receiving, unpacking and solving need about %.1f", n, need);
        doc_means(f, "frames wait for a processor, and newer frames replace them (overflow)");
        doc_note(f,
                 "use a lower fps, jumbo frames, more binning, a coarser grid, or more processors");
    }
    if (!doc_text(d->host, text, sizeof text, "/proc/loadavg") ||
        sscanf(text, "%lf", &load1) != 1 || !isfinite(load1))
        return;
    if (doc_settled(load1 <= 0.7 * n || doc_process(d->host, "pyrovoxd", NULL), d, DOC_OK, 58,
                    "cpu.load", "load %.2f on %u processors", load1, n))
        return;
    struct doc_finding *f =
        doc_say(d, DOC_WARN, 58, "cpu.load", "other programs want %.1f processors of %u", load1, n);
    doc_means(f, "receiving threads wait while packets arrive");
    doc_note(f, "end them, or give them less (`top` shows which; `systemctl set-property NAME "
                "CPUQuota=50%%`)");
}

static void check_cpu_features(struct doctor *d)
{
    char *text = doc_file(d->host, "/proc/cpuinfo");
    char *flags = malloc(4096);
    if (text != NULL && flags != NULL && doc_parse_key(text, "flags", flags, 4096)) {
        if (doc_has_word(flags, "avx2")) {
            doc_say(d, DOC_OK, 30, "cpu.features", "AVX2%s",
                    doc_has_word(flags, "avx512vl") ? " and AVX-512" : "");
        } else {
            struct doc_finding *f =
                doc_say(d, DOC_WARN, 50, "cpu.features", "the processor has no AVX2");
            doc_means(f,
                      "the solver runs in plain C, two to four times slower: fewer sets a second");
            doc_note(f, "in a virtual machine pass the host's processor through (qemu: -cpu host)");
        }
    }
    free(flags);
    free(text);
}

static void governor(struct doctor *d)
{
    char gov[64], epp[64] = "";
    if (doc_settled(!doc_text(d->host, gov, sizeof gov,
                              "/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor"),
                    d, DOC_OK, 50, "cpu.governor", "this machine shows no frequency scaling%s",
                    doc_exists(d->host, "/sys/class/dmi") ? ""
                                                          : " (a virtual machine's host decides)"))
        return;
    bool has_epp = doc_text(d->host, epp, sizeof epp,
                            "/sys/devices/system/cpu/cpu0/cpufreq/energy_performance_preference");
    if (strcmp(gov, "performance") != 0) {
        struct doc_finding *f =
            doc_say(d, DOC_WARN, 66, "cpu.governor", "frequency governor is `%s`", gov);
        doc_means(f, "processors run slowly between bursts: each burst begins on a slow processor, "
                     "and the solving time varies");
        doc_command(f, "for g in /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor; do echo "
                       "performance > \"$g\"; done");
        return;
    }
    if (has_epp && (strcmp(epp, "power") == 0 || strcmp(epp, "balance_power") == 0)) {
        struct doc_finding *f = doc_say(d, DOC_WARN, 60, "cpu.energy",
                                        "the processor's energy preference is `%s`", epp);
        doc_means(f, "the processor saves energy at the cost of speed");
        doc_command(f, "for p in /sys/devices/system/cpu/cpu*/cpufreq/energy_performance_preference"
                       "; do echo performance > \"$p\"; done");
        return;
    }
    doc_say(d, DOC_OK, 66, "cpu.governor", "frequency governor `performance`");
}

/* How long a processor may take to wake up, and whether a program keeps it awake. */
static void sleep_states(struct doctor *d)
{
    char name[64], deepest[64] = "", qos[8] = "";
    int64_t worst = 0, v, off;
    for (int i = 0; i < 16; i++) {
        if (!doc_int(d->host, &v, "/sys/devices/system/cpu/cpu0/cpuidle/state%d/latency", i))
            break;
        if (doc_int(d->host, &off, "/sys/devices/system/cpu/cpu0/cpuidle/state%d/disable", i) &&
            off != 0)
            continue;
        if (v >= worst && doc_text(d->host, name, sizeof name,
                                   "/sys/devices/system/cpu/cpu0/cpuidle/state%d/name", i)) {
            worst = v;
            snprintf(deepest, sizeof deepest, "%s", name);
        }
    }
    /* four bytes, native order: the wake-up time that all programs together have asked for */
    int32_t asked = INT32_MAX;
    if (doc_text(d->host, qos, sizeof qos, "/dev/cpu_dma_latency"))
        memcpy(&asked, qos, sizeof asked);
    if (doc_settled(worst <= WAKE_MAX_US || asked <= WAKE_MAX_US, d, DOC_OK, 52, "cpu.sleep",
                    "processors wake within %lld us", (long long)(asked < worst ? asked : worst)))
        return;
    struct doc_finding *f =
        doc_say(d, DOC_WARN, 52, "cpu.sleep", "a sleeping processor takes %lld us to wake (%s)",
                (long long)worst, deepest);
    doc_means(f, "each burst of packets waits that long before the first packet is read");
    doc_command(f,
                "for s in /sys/devices/system/cpu/cpu*/cpuidle/state*; do [ \"$(cat "
                "\"$s/latency\")\" -le %d ] || echo 1 > \"$s/disable\"; done",
                WAKE_MAX_US);
    doc_note(f, "for good: intel_idle.max_cstate=1 processor.max_cstate=1 on the kernel's command "
                "line");
}

void doc_check_cpu(struct doctor *d)
{
    check_cpu_number(d);
    check_cpu_features(d);
    governor(d);
    sleep_states(d);
}

void doc_check_irqs(struct doctor *d)
{
    char *text = doc_file(d->host, "/proc/interrupts");
    unsigned cpus = doc_cpus(d);
    if (text == NULL || cpus < 2) {
        free(text);
        return;
    }
    bool balanced = doc_process(d->host, "irqbalance", NULL);
    const char *crowded = "";
    unsigned crowd_cpu = 0, sharing = 0;
    for (size_t i = 0; i < d->n_links; i++) {
        struct doc_irqs q;
        doc_parse_interrupts(text, d->link[i].name, &q);
        if (q.total < 10000 || (double)q.busiest < 0.9 * (double)q.total)
            continue;
        if (sharing == 0 || q.busiest_cpu == crowd_cpu) {
            crowded = d->link[i].name;
            crowd_cpu = q.busiest_cpu;
            sharing++;
        }
        if (q.lines < 2 || balanced)
            continue;
        struct doc_finding *f =
            doc_say(d, DOC_WARN, 56, "cpu.irq", "all %zu queues of %s interrupt processor %u",
                    q.lines, d->link[i].name, q.busiest_cpu);
        doc_means(f, "one processor receives everything while the others wait");
        doc_command(f, "apt-get install -y irqbalance");
        doc_note(f, "or by hand: echo %u > /proc/irq/%u/smp_affinity_list",
                 (q.busiest_cpu + 1) % cpus, q.irq);
        free(text);
        return;
    }
    free(text);
    if (sharing > 1 && !balanced) {
        struct doc_finding *f = doc_say(d, DOC_WARN, 56, "cpu.irq",
                                        "%u cards, %s among them, all interrupt processor %u",
                                        sharing, crowded, crowd_cpu);
        doc_means(f, "one processor receives everything while the others wait");
        doc_command(f, "apt-get install -y irqbalance");
    } else {
        doc_say(d, DOC_OK, 56, "cpu.irq", "interrupts of the cards %s",
                balanced ? "are balanced by irqbalance" : "are spread over the processors");
    }
}
