/* parse.h - readers of the kernel's text files; pure, for any bytes (fuzzed).
 *
 * text: 0-terminated.  A key or line that is not there gives false or 0; malformed lines are passed
 * over.  Formats: proc(5), Documentation/filesystems/proc.rst, net/core/net-procfs.c. */
#ifndef DOC_PARSE_H
#define DOC_PARSE_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define DOC_UNLIMITED UINT64_MAX

/* Next line of *p into line (cut to size, without its end); false at the end. */
bool doc_line_next(const char **p, char *line, size_t size);
/* Does the blank-separated list contain the word? */
bool doc_has_word(const char *list, const char *word);
/* The word of a list in brackets, as in "always [madvise] never"; "" when there is none. */
void doc_bracketed(const char *list, char *out, size_t size);

/* /proc/PID/limits: soft and hard value of "Max locked memory". */
bool doc_parse_limit(const char *text, const char *name, uint64_t *soft, uint64_t *hard);
/* "Key: value ..." as in /proc/PID/status, /proc/meminfo, /proc/cpuinfo: text after the colon. */
bool doc_parse_key(const char *text, const char *key, char *out, size_t size);
bool doc_parse_key_int(const char *text, const char *key, int base, uint64_t *out);
/* /proc/net/snmp: value of `name` in the pair of lines that begins with "Udp:". */
bool doc_parse_snmp(const char *text, const char *proto, const char *name, uint64_t *out);

struct doc_softnet {
    uint64_t processed, dropped, squeezed; /* packets, packets, times; all processors */
    size_t cpus;
};
void doc_parse_softnet(const char *text, struct doc_softnet *out);

/* /proc/net/udp: packets lost by the sockets that exist now. */
uint64_t doc_parse_udp(const char *text);

struct doc_route {
    char iface[16];
    uint32_t dest, mask, gateway; /* host order */
};
/* /proc/net/route, routes that are up; at most `max`. */
size_t doc_parse_routes(const char *text, struct doc_route *out, size_t max);

/* /proc/interrupts: interrupts of lines whose names contain `name` as a word or "name-...". */
struct doc_irqs {
    size_t lines, cpus;
    uint64_t total, busiest; /* busiest processor's share of total */
    unsigned busiest_cpu;
    unsigned irq; /* number of the line with most */
};
void doc_parse_interrupts(const char *text, const char *name, struct doc_irqs *out);

/* Values of all "Key=..." of a systemd unit's section [Service], with blanks between; an empty one
 * forgets those before it.  false: not set. */
bool doc_parse_unit(const char *text, const char *key, char *out, size_t size);
#endif
