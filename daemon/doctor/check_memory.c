/* check_memory.c - memory that is there when a frame needs it. */
#include <stdlib.h>
#include <string.h>

#include "daemon/doctor/checks.h"
#include "daemon/doctor/parse.h"

static void doctor_swap(struct doctor *d, const char *meminfo)
{
    uint64_t total = 0;
    int64_t v;
    if (!doc_parse_key_int(meminfo, "SwapTotal", 10, &total) ||
        !doc_int(d->host, &v, "/proc/sys/vm/swappiness"))
        return;
    if (doc_settled(total == 0 || v <= 10, d, DOC_OK, 30, "mem.swap",
                    total == 0 ? "no swap" : "swap is the last resort"))
        return;
    struct doc_finding *f =
        doc_say(d, DOC_WARN, 42, "mem.swap", "memory is swapped out early (vm.swappiness %lld)",
                (long long)v);
    doc_means(f, "a page of the frame path that was swapped out costs milliseconds to get back");
    doc_sysctl(f, "vm.swappiness", "1");
}

static void free_memory(struct doctor *d, const char *meminfo)
{
    uint64_t kib = 0;
    if (!doc_parse_key_int(meminfo, "MemAvailable", 10, &kib))
        return;
    double need = doc_load_memory(&d->load);
    double have = (double)kib * 1024;
    if (doc_settled(have >= 2 * need, d, DOC_OK, 48, "mem.free",
                    "%.1f GB of memory free, frames take %.2f", have * 1e-9, need * 1e-9))
        return;
    struct doc_finding *f = doc_say(d, have < need ? DOC_FAIL : DOC_WARN, 78, "mem.free",
                                    "%.2f GB of memory are free, frames alone take %.2f "
                                    "(%u of each camera)",
                                    have * 1e-9, need * 1e-9, d->load.buffers + d->load.held);
    doc_means(f, "pyrovoxd does not start, or it is swapped out or killed while it runs");
    doc_note(f, "end other programs, set fewer `buffers` or less `record.ring`, or add memory");
}

static void huge_pages(struct doctor *d)
{
    char list[128], enabled[32], defrag[32];
    if (!doc_text(d->host, list, sizeof list, "/sys/kernel/mm/transparent_hugepage/enabled"))
        return;
    doc_bracketed(list, enabled, sizeof enabled);
    if (!doc_text(d->host, list, sizeof list, "/sys/kernel/mm/transparent_hugepage/defrag"))
        return;
    doc_bracketed(list, defrag, sizeof defrag);
    if (doc_settled(strcmp(enabled, "always") != 0 || strcmp(defrag, "always") != 0, d, DOC_OK, 15,
                    "mem.hugepages", "huge pages `%s`, made `%s`", enabled, defrag))
        return;
    struct doc_finding *f = doc_say(d, DOC_WARN, 22, "mem.hugepages",
                                    "programs stop and wait while huge pages are made");
    doc_means(f, "a stall of milliseconds now and then, when memory is fragmented");
    doc_command(f, "echo madvise > /sys/kernel/mm/transparent_hugepage/defrag");
}

void doc_check_memory(struct doctor *d)
{
    char *meminfo = doc_file(d->host, "/proc/meminfo");
    if (meminfo != NULL) {
        doctor_swap(d, meminfo);
        free_memory(d, meminfo);
    }
    free(meminfo);
    huge_pages(d);
}
