#include "daemon/doctor/wrap.h"

#include <stdbool.h>
#include <string.h>

static int wrap_columns(const char *s, size_t n)
{
    int c = 0;
    for (size_t i = 0; i < n; i++)
        c += ((unsigned char)s[i] & 0xC0) != 0x80; /* bytes that begin a character */
    return c;
}

void dmn_wrap(FILE *f, const char *text, int at, int indent, int width)
{
    bool first = true;
    for (const char *p = text + strspn(text, " "); *p != '\0'; p += strspn(p, " ")) {
        size_t n = strcspn(p, " ");
        int w = wrap_columns(p, n);
        if (!first && at + 1 + w > width) {
            fprintf(f, "\n%*s", indent, "");
            at = indent;
            first = true;
        }
        fprintf(f, "%s%.*s", first ? "" : " ", (int)n, p);
        at += w + !first;
        first = false;
        p += n;
    }
    fputc('\n', f);
}
