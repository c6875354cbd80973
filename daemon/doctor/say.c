/* say.c - findings and remedies put into the report. */
#include <ctype.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "daemon/doctor/checks.h"

#define FILL(to)                               \
    do {                                       \
        va_list ap_;                           \
        va_start(ap_, fmt);                    \
        vsnprintf((to), sizeof(to), fmt, ap_); \
        va_end(ap_);                           \
    } while (0)

struct doc_finding *doc_say(struct doctor *d, enum doc_verdict v, int weight, const char *id,
                            const char *fmt, ...)
{
    struct doc_report *r = &d->report;
    struct doc_finding *f = &r->f[r->n]; /* one more than counted: room for a forgotten one */
    if (r->n < DOC_MAX_FINDINGS)
        r->n++;
    else
        r->lost++;
    memset(f, 0, sizeof *f);
    snprintf(f->id, sizeof f->id, "%s", id);
    f->verdict = v;
    f->weight = weight;
    FILL(f->what);
    return f;
}

void doc_means(struct doc_finding *f, const char *fmt, ...)
{
    FILL(f->means);
}

void doc_fix(struct doc_finding *f, enum doc_fix_kind kind, const char *file, const char *fmt, ...)
{
    struct doc_fix *x = &f->fix[f->n_fix < DOC_MAX_FIX ? f->n_fix++ : DOC_MAX_FIX - 1];
    x->kind = kind;
    snprintf(x->file, sizeof x->file, "%s", file);
    FILL(x->text);
}

unsigned doc_count_list(const char *list)
{
    unsigned n = 0;
    const char *p = list;
    while (isdigit((unsigned char)*p)) {
        char *end;
        unsigned long a = strtoul(p, &end, 10), b = a;
        if (*end == '-')
            b = strtoul(end + 1, &end, 10);
        if (b < a || b > 65535)
            break;
        n += (unsigned)(b - a) + 1;
        p = *end == ',' ? end + 1 : end;
        if (p == end)
            break;
    }
    return n;
}

unsigned doc_cpus(struct doctor *d)
{
    char list[256];
    return doc_text(d->host, list, sizeof list, "/sys/devices/system/cpu/online")
               ? doc_count_list(list)
               : 0;
}

const char *doc_quote(const char *s)
{
    static char out[300];
    static const char plain[] = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789"
                                "._-/:@+,=";
    size_t n = 0;
    if (*s != '\0' && s[strspn(s, plain)] == '\0') {
        snprintf(out, sizeof out, "%s", s);
        return out;
    }
    out[n++] = '\'';
    for (; *s != '\0' && n < sizeof out - 6; s++) {
        if (*s == '\'') {
            memcpy(out + n, "'\\''", 4);
            n += 4;
        } else {
            out[n++] = *s;
        }
    }
    out[n++] = '\'';
    out[n] = '\0';
    return out;
}
