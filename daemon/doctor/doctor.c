/* doctor.c - the examination from end to end. */
#include "daemon/doctor/doctor.h"

#include <stdlib.h>
#include <string.h>

#include "daemon/doctor/checks.h"

static int rank(enum doc_verdict v)
{
    static const int order[DOC_N_VERDICT] = {
        [DOC_FAIL] = 0, [DOC_WARN] = 1, [DOC_UNKNOWN] = 2, [DOC_OK] = 3};
    return order[v];
}

static int worst_first(const void *pa, const void *pb)
{
    const struct doc_finding *a = pa, *b = pb;
    if (a->verdict != b->verdict)
        return rank(a->verdict) - rank(b->verdict);
    if (a->weight != b->weight)
        return b->weight - a->weight;
    int c = strcmp(a->id, b->id);
    return c != 0 ? c : strcmp(a->what, b->what);
}

void doc_run(struct doctor *d)
{
    d->report.n = d->report.lost = 0;
    doc_find_links(d);
    doc_check_buffers(d);
    doc_check_links(d);
    doc_check_counters(d);
    doc_check_firewall(d);
    doc_check_irqs(d);
    doc_check_usb(d);
    doc_check_access(d);
    doc_check_cpu(d);
    doc_check_memory(d);
    doc_check_limits(d);
    doc_check_time(d);
    doc_check_disk(d);
    doc_check_system(d);
    doc_check_blacks(d);
    doc_check_cards(d);
    qsort(d->report.f, d->report.n, sizeof d->report.f[0], worst_first);
}

size_t doc_count(const struct doc_report *r, enum doc_verdict v)
{
    size_t n = 0;
    for (size_t i = 0; i < r->n; i++)
        n += r->f[i].verdict == v;
    return n;
}

int doc_exit_status(const struct doc_report *r)
{
    if (doc_count(r, DOC_FAIL) > 0)
        return 2;
    return doc_count(r, DOC_WARN) + doc_count(r, DOC_UNKNOWN) > 0 ? 1 : 0;
}
