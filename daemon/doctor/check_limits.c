/* check_limits.c - what pyrovoxd may do: priorities, locked memory, files, packet sockets. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/doctor/checks.h"
#include "daemon/doctor/parse.h"

#define CAP_NET_RAW_BIT  13
#define CAP_SYS_NICE_BIT 23
#define LIMITS_FILE      "/etc/security/limits.d/90-pyrovox.conf"

void doc_subject(struct doctor *d, char *proc, size_t size, const char **title)
{
    int pid = 0;
    bool running = doc_process(d->host, "pyrovoxd", &pid);
    if (running)
        snprintf(proc, size, "/proc/%d", pid);
    else
        snprintf(proc, size, "/proc/self");
    *title = running ? "the running pyrovoxd" : "a pyrovoxd started from here";
}

char *doc_unit_text(struct doctor *d)
{
    static const char *const dirs[] = {"/etc/systemd/system", "/usr/local/lib/systemd/system",
                                       "/usr/lib/systemd/system", "/lib/systemd/system"};
    char *unit = NULL;
    for (size_t i = 0; i < sizeof dirs / sizeof *dirs && unit == NULL; i++)
        unit = doc_file(d->host, "%s/pyrovoxd.service", dirs[i]);
    struct doc_names *names = doc_names(d->host, "/etc/systemd/system/pyrovoxd.service.d");
    for (size_t i = 0; names != NULL && i < names->n && unit != NULL; i++) {
        char *more = doc_file(d->host, "/etc/systemd/system/pyrovoxd.service.d/%s", names->v[i]);
        size_t a = strlen(unit), b = more != NULL ? strlen(more) : 0;
        char *joined = b > 0 ? realloc(unit, a + b + 2) : NULL;
        if (joined != NULL) {
            joined[a] = '\n';
            memcpy(joined + a + 1, more, b + 1);
            unit = joined;
        }
        free(more);
    }
    free(names);
    return unit;
}

static const char *cap_name(int cap)
{
    return cap == CAP_NET_RAW_BIT ? "CAP_NET_RAW" : "CAP_SYS_NICE";
}

bool doc_has_cap(struct doctor *d, int cap)
{
    char proc[64], path[4200], list[512];
    const char *title;
    uint64_t eff = 0;
    doc_subject(d, proc, sizeof proc, &title);
    char *status = doc_file(d->host, "%s/status", proc);
    bool has = status != NULL && doc_parse_key_int(status, "CapEff", 16, &eff) && eff >> cap & 1;
    free(status);
    if (has)
        return true;
    snprintf(path, sizeof path, "%s/pyrovoxd", d->host->exe_dir);
    if (d->host->exe_dir[0] != '\0' && d->host->file_caps(d->host, path, &eff) && eff >> cap & 1)
        return true;
    char *unit = doc_unit_text(d);
    has = unit != NULL && doc_parse_unit(unit, "AmbientCapabilities", list, sizeof list) &&
          doc_has_word(list, cap_name(cap));
    free(unit);
    return has;
}

/* The service runs without CAP_NET_RAW: the right to read every packet is more than it needs, if its
 * buffers hold what comes while it is not scheduled. */
static void raw_sockets(struct doctor *d)
{
    int64_t room = 0;
    double need = 2 * (double)d->load.frame_bytes;
    if (doc_load_count(&d->load, DOC_CAM_GIGE) == 0)
        return;
    if (doc_settled(doc_has_cap(d, CAP_NET_RAW_BIT), d, DOC_OK, 68, "cap.net_raw",
                    "pyrovoxd may bypass the socket buffers"))
        return;
    if (doc_settled(doc_int(d->host, &room, "/proc/sys/net/core/rmem_max") && (double)room >= need,
                    d, DOC_OK, 68, "cap.net_raw",
                    "pyrovoxd reads packets through socket buffers, and these are large enough"))
        return;
    struct doc_finding *f = doc_say(d, DOC_WARN, 68, "cap.net_raw",
                                    "pyrovoxd may not bypass the socket buffers "
                                    "(CAP_NET_RAW), and these are small");
    doc_means(f, "every packet goes through a buffer that may overflow");
    doc_command(f, "setcap cap_net_raw,cap_sys_nice+ep %s/pyrovoxd",
                d->host->exe_dir[0] != '\0' ? doc_quote(d->host->exe_dir) : "/usr/local/bin");
    doc_note(f, "or larger buffers (net.core.rmem_max), which is all that the service needs "
                "(systemd/README.md)");
}

static void realtime(struct doctor *d, const char *limits, const char *title)
{
    int64_t runtime;
    uint64_t soft = 0, hard = 0;
    bool nice = doc_has_cap(d, CAP_SYS_NICE_BIT);
    if (doc_int(d->host, &runtime, "/proc/sys/kernel/sched_rt_runtime_us") && runtime == 0) {
        struct doc_finding *f = doc_say(d, DOC_FAIL, 64, "limit.rt_runtime",
                                        "the kernel gives real-time threads no time at all");
        doc_means(f, "receiving threads with real-time priority never run");
        doc_sysctl(f, "kernel.sched_rt_runtime_us", "950000");
    }
    if (doc_settled(limits == NULL ||
                        !doc_parse_limit(limits, "Max realtime priority", &soft, &hard),
                    d, DOC_UNKNOWN, 30, "limit.rtprio", "limits of %s cannot be read", title))
        return;
    if (nice || soft >= 10) {
        doc_say(d, DOC_OK, 62, "limit.rtprio", "%s may run in real time", title);
        return;
    }
    struct doc_finding *f =
        doc_say(d, DOC_WARN, 62, "limit.rtprio", "%s may not run in real time (limit rtprio %llu)",
                title, (unsigned long long)soft);
    doc_means(f, "receiving threads share processors with everything else, and are late when the "
                 "machine is busy");
    doc_add_line(f, LIMITS_FILE, "@pyrovox - rtprio 20");
    doc_note(f, "then put yourself into the group (adduser USER pyrovox) and log in again; the "
                "service has the right by itself");
}

static void locked_memory(struct doctor *d, const char *limits, const char *title)
{
    uint64_t soft = 0, hard = 0;
    double need = doc_load_memory(&d->load);
    if (limits == NULL || !doc_parse_limit(limits, "Max locked memory", &soft, &hard))
        return;
    if (doc_settled(soft == DOC_UNLIMITED || (double)soft >= need, d, DOC_OK, 28, "limit.memlock",
                    "%s may lock its frames in memory", title))
        return;
    struct doc_finding *f = doc_say(d, DOC_WARN, 28, "limit.memlock",
                                    "%s may lock only %.1f MB in memory, its frames take %.0f",
                                    title, (double)soft * 1e-6, need * 1e-6);
    doc_means(f, "frames may be swapped out when memory is short");
    doc_add_line(f, LIMITS_FILE, "@pyrovox - memlock unlimited");
}

static void open_files(struct doctor *d, const char *limits, const char *title)
{
    uint64_t soft = 0, hard = 0, need = 128 + 16 * (uint64_t)d->load.n;
    if (limits == NULL || !doc_parse_limit(limits, "Max open files", &soft, &hard))
        return;
    if (doc_settled(soft >= need, d, DOC_OK, 20, "limit.nofile", "%s may have enough files open",
                    title))
        return;
    struct doc_finding *f =
        doc_say(d, DOC_FAIL, 60, "limit.nofile", "%s may have only %llu files open, it needs %llu",
                title, (unsigned long long)soft, (unsigned long long)need);
    doc_means(f, "cameras at the end of the list cannot be opened");
    doc_add_line(f, LIMITS_FILE, "@pyrovox - nofile 4096");
}

/* Check that an edited unit still has what systemd/pyrovoxd.service gives. */
static void unit(struct doctor *d)
{
    static const struct {
        const char *key, *want, *means;
        bool list;
    } line[] = {
        {"LimitRTPRIO", NULL, "receiving threads get no real-time priority", false},
        {"LimitMEMLOCK", NULL, "frames may be swapped out", false},
        {"SupplementaryGroups", "video", "V4L2 and libcamera cameras cannot be opened", true},
        {"SupplementaryGroups", "plugdev", "USB3 Vision cameras cannot be opened", true},
    };
    char *text = doc_unit_text(d), value[512];
    if (doc_settled(text == NULL, d, DOC_OK, 12, "unit", "pyrovoxd is not installed as a service"))
        return;
    size_t bad = 0;
    for (size_t i = 0; i < sizeof line / sizeof *line; i++) {
        bool set = doc_parse_unit(text, line[i].key, value, sizeof value);
        if (set && (!line[i].list || doc_has_word(value, line[i].want)))
            continue;
        struct doc_finding *f =
            doc_say(d, DOC_WARN, 61, "unit", "the unit has no %s%s%s", line[i].key,
                    line[i].list ? "=" : "", line[i].list ? line[i].want : "");
        doc_means(f, "run as a service, %s", line[i].means);
        doc_add_line(f, "/etc/systemd/system/pyrovoxd.service.d/90-doctor.conf", "%s=%s",
                     line[i].key,
                     line[i].list                              ? line[i].want
                     : strcmp(line[i].key, "LimitRTPRIO") == 0 ? "20"
                                                               : "infinity");
        bad++;
    }
    if (bad == 0)
        doc_say(d, DOC_OK, 61, "unit", "the service has the rights that it needs");
    free(text);
}

void doc_check_limits(struct doctor *d)
{
    char proc[64];
    const char *title;
    doc_subject(d, proc, sizeof proc, &title);
    char *limits = doc_file(d->host, "%s/limits", proc);
    raw_sockets(d);
    realtime(d, limits, title);
    locked_memory(d, limits, title);
    open_files(d, limits, title);
    unit(d);
    free(limits);
}
