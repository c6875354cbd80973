#include "daemon/doctor/parse.h"

#include <arpa/inet.h>
#include <ctype.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

bool doc_line_next(const char **p, char *line, size_t size)
{
    if (**p == '\0')
        return false;
    size_t n = strcspn(*p, "\n");
    snprintf(line, size, "%.*s", (int)(n < size ? n : size - 1), *p);
    *p += n + ((*p)[n] == '\n');
    return true;
}

bool doc_has_word(const char *list, const char *word)
{
    size_t n = strlen(word);
    for (const char *p = list; n > 0 && (p = strstr(p, word)) != NULL; p += n)
        if ((p == list || isspace((unsigned char)p[-1])) &&
            (p[n] == '\0' || isspace((unsigned char)p[n])))
            return true;
    return false;
}

void doc_bracketed(const char *list, char *out, size_t size)
{
    const char *a = strchr(list, '['), *b = a != NULL ? strchr(a, ']') : NULL;
    snprintf(out, size, "%.*s", b != NULL ? (int)(b - a - 1) : 0, b != NULL ? a + 1 : "");
}

/* A number of the given base at *p, blanks before it passed over; *p is then behind it. */
static bool parse_number(const char **p, int base, uint64_t *out)
{
    char *end;
    while (**p == ' ' || **p == '\t')
        (*p)++;
    if (!isxdigit((unsigned char)**p))
        return false;
    *out = strtoull(*p, &end, base);
    if (end == *p)
        return false;
    *p = end;
    return true;
}

static bool limit_value(const char **p, uint64_t *out)
{
    while (**p == ' ')
        (*p)++;
    if (strncmp(*p, "unlimited", 9) == 0) {
        *p += 9;
        *out = DOC_UNLIMITED;
        return true;
    }
    return parse_number(p, 10, out);
}

bool doc_parse_limit(const char *text, const char *name, uint64_t *soft, uint64_t *hard)
{
    char line[256];
    size_t n = strlen(name);
    while (doc_line_next(&text, line, sizeof line)) {
        const char *p = line + n;
        if (strncmp(line, name, n) == 0 && *p == ' ')
            return limit_value(&p, soft) && limit_value(&p, hard);
    }
    return false;
}

bool doc_parse_key(const char *text, const char *key, char *out, size_t size)
{
    char line[4096];
    size_t n = strlen(key);
    while (doc_line_next(&text, line, sizeof line)) {
        const char *p = line + n;
        if (strncmp(line, key, n) != 0)
            continue;
        p += strspn(p, " \t");
        if (*p != ':')
            continue;
        p++;
        snprintf(out, size, "%s", p + strspn(p, " \t"));
        return true;
    }
    out[0] = '\0';
    return false;
}

bool doc_parse_key_int(const char *text, const char *key, int base, uint64_t *out)
{
    char value[64];
    const char *p = value;
    return doc_parse_key(text, key, value, sizeof value) && parse_number(&p, base, out);
}

/* Place of a word in a blank-separated line, -1 when it is not there. */
static int parse_column(const char *line, const char *word)
{
    char copy[1024], *save = NULL;
    snprintf(copy, sizeof copy, "%s", line);
    int i = 0;
    for (char *t = strtok_r(copy, " ", &save); t != NULL; t = strtok_r(NULL, " ", &save), i++)
        if (strcmp(t, word) == 0)
            return i;
    return -1;
}

bool doc_parse_snmp(const char *text, const char *proto, const char *name, uint64_t *out)
{
    char head[1024], line[1024];
    size_t n = strlen(proto);
    while (doc_line_next(&text, head, sizeof head)) {
        if (strncmp(head, proto, n) != 0 || head[n] != ':')
            continue;
        int at = parse_column(head, name);
        if (at < 0 || !doc_line_next(&text, line, sizeof line))
            return false;
        char *save = NULL, *t = strtok_r(line, " ", &save);
        for (int i = 0; i < at && t != NULL; i++)
            t = strtok_r(NULL, " ", &save);
        const char *p = t;
        return t != NULL && parse_number(&p, 10, out);
    }
    return false;
}

void doc_parse_softnet(const char *text, struct doc_softnet *out)
{
    char line[512];
    *out = (struct doc_softnet){0};
    while (doc_line_next(&text, line, sizeof line)) {
        const char *p = line;
        uint64_t v[3];
        if (!parse_number(&p, 16, &v[0]) || !parse_number(&p, 16, &v[1]) ||
            !parse_number(&p, 16, &v[2]))
            continue;
        out->processed += v[0];
        out->dropped += v[1];
        out->squeezed += v[2];
        out->cpus++;
    }
}

uint64_t doc_parse_udp(const char *text)
{
    char line[512];
    uint64_t all = 0;
    while (doc_line_next(&text, line, sizeof line)) {
        unsigned port;
        /* "sl: local:port remote:port st ..." and drops at the end */
        for (size_t n = strlen(line); n > 0 && line[n - 1] == ' ';)
            line[--n] = '\0';
        const char *p = strrchr(line, ' ');
        uint64_t drops;
        if (p != NULL && sscanf(line, " %*u: %*8x:%4x", &port) == 1 &&
            parse_number(&p, 10, &drops) && *p == '\0')
            all += drops;
    }
    return all;
}

size_t doc_parse_routes(const char *text, struct doc_route *out, size_t max)
{
    char line[512];
    size_t n = 0;
    while (n < max && doc_line_next(&text, line, sizeof line)) {
        unsigned dest, gateway, flags, mask;
        struct doc_route r;
        if (sscanf(line, "%15s %8x %8x %4x %*d %*d %*d %8x", r.iface, &dest, &gateway, &flags,
                   &mask) != 5 ||
            (flags & 1) == 0)
            continue;
        r.dest = ntohl(dest); /* the file has them as they lie in memory */
        r.mask = ntohl(mask);
        r.gateway = ntohl(gateway);
        out[n++] = r;
    }
    return n;
}

/* Is `name` in the line as a word, or as the beginning of one such as "eth0-TxRx-1"? */
static bool names_interface(const char *line, const char *name)
{
    size_t n = strlen(name);
    for (const char *p = line; n > 0 && (p = strstr(p, name)) != NULL; p += n)
        if (p > line && (p[-1] == ' ' || p[-1] == ',' || p[-1] == '@' || p[-1] == '-') &&
            (p[n] == '\0' || p[n] == '-' || p[n] == ',' || p[n] == ' ' || p[n] == '@'))
            return true;
    return false;
}

void doc_parse_interrupts(const char *text, const char *name, struct doc_irqs *out)
{
    char line[8192];
    uint64_t count[256] = {0}, most = 0;
    *out = (struct doc_irqs){0};
    if (!doc_line_next(&text, line, sizeof line))
        return;
    for (const char *p = line; (p = strstr(p, "CPU")) != NULL; p += 3)
        out->cpus++;
    if (out->cpus > 256)
        out->cpus = 256;
    while (doc_line_next(&text, line, sizeof line)) {
        const char *p = line;
        uint64_t irq, v, sum = 0;
        if (!names_interface(line, name) || !parse_number(&p, 10, &irq) || *p != ':')
            continue;
        p++;
        for (size_t c = 0; c < out->cpus && parse_number(&p, 10, &v); c++) {
            count[c] += v;
            sum += v;
        }
        out->lines++;
        if (sum >= most) {
            most = sum;
            out->irq = (unsigned)irq;
        }
    }
    for (size_t c = 0; c < out->cpus; c++) {
        out->total += count[c];
        if (count[c] > out->busiest) {
            out->busiest = count[c];
            out->busiest_cpu = (unsigned)c;
        }
    }
}

bool doc_parse_unit(const char *text, const char *key, char *out, size_t size)
{
    char line[1024];
    size_t n = strlen(key);
    bool service = false, found = false;
    out[0] = '\0';
    while (doc_line_next(&text, line, sizeof line)) {
        if (line[0] == '[')
            service = strncmp(line, "[Service]", 9) == 0;
        if (!service || strncmp(line, key, n) != 0 || line[n] != '=')
            continue;
        size_t len = strlen(out);
        found = line[n + 1] != '\0';
        if (found)
            snprintf(out + len, size - len, "%s%s", len > 0 ? " " : "", line + n + 1);
        else
            out[0] = '\0';
    }
    return found;
}
