/* checks.h - the checks by topic, and how they report (private to daemon/doctor). */
#ifndef DOC_CHECKS_H
#define DOC_CHECKS_H
#include "daemon/doctor/doctor.h"
#include "daemon/doctor/host.h"

/* A new finding; never NULL (with no room left it is counted and forgotten). */
struct doc_finding *doc_say(struct doctor *d, enum doc_verdict v, int weight, const char *id,
                            const char *fmt, ...) PVX_PRINTF(5, 6);
/* If `cond` holds, reports that as the only finding and is true. */
#define doc_settled(cond, ...) ((cond) && doc_say(__VA_ARGS__) != NULL)
/* Adds what the finding means for frames. */
void doc_means(struct doc_finding *f, const char *fmt, ...) PVX_PRINTF(2, 3);
/* Adds a remedy, in the order in which they should be tried.  `file`: a sysctl's key, or the file of the line. */
void doc_fix(struct doc_finding *f, enum doc_fix_kind kind, const char *file, const char *fmt, ...)
    PVX_PRINTF(4, 5);
#define doc_sysctl(f, key, ...)    doc_fix(f, DOC_SYSCTL, key, __VA_ARGS__)
#define doc_command(f, ...)        doc_fix(f, DOC_COMMAND, "", __VA_ARGS__)
#define doc_add_line(f, file, ...) doc_fix(f, DOC_LINE, file, __VA_ARGS__)
#define doc_note(f, ...)           doc_fix(f, DOC_NOTE, "", __VA_ARGS__)

/* Whether pyrovoxd may have this capability (its number in linux/capability.h): as it runs, by its file, or by
 * its unit. */
bool doc_has_cap(struct doctor *d, int cap);
/* The process whose limits and groups count: the /proc folder of the running pyrovoxd, else that of this process. */
void doc_subject(struct doctor *d, char *proc, size_t size, const char **title);
/* Text of the installed unit and its drop-ins; NULL: not installed.  Owner: caller, free(). */
char *doc_unit_text(struct doctor *d);
/* Number of a range list as "0-3,6"; 0 when it is none. */
unsigned doc_count_list(const char *list);
unsigned doc_cpus(struct doctor *d);
/* Text in single quotes for a shell, in a static buffer that the next call reuses. */
const char *doc_quote(const char *s);

void doc_find_links(struct doctor *d); /* links.c: fills link[], says what is wrong with routes */

/* One function per check; each asks d->load whether it matters. */
void doc_check_buffers(struct doctor *d);  /* socket buffers, backlog, budget */
void doc_check_links(struct doctor *d);    /* MTU, speed, ring, pause, interrupts, rp_filter */
void doc_check_counters(struct doctor *d); /* what was dropped where */
void doc_check_firewall(struct doctor *d);
void doc_check_cpu(struct doctor *d); /* number, features, governor, C-states, load */
void doc_check_irqs(struct doctor *d);
void doc_check_memory(struct doctor *d); /* swap, huge pages, free memory */
void doc_check_limits(struct doctor *d); /* rlimits, real-time, capabilities, unit */
void doc_check_usb(struct doctor *d);
void doc_check_access(struct doctor *d); /* groups, udev rules, device files */
void doc_check_time(struct doctor *d);   /* PTP, time daemons, clock */
void doc_check_disk(struct doctor *d);
void doc_check_system(struct doctor *d); /* kernel, virtual machine */
void doc_check_cards(struct doctor *d);  /* OpenCL devices */
void doc_check_blacks(struct doctor *d); /* of pictures, where cameras were opened */
#endif
