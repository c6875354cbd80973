#include "daemon/control/json.h"

#include <errno.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define PRINT_FIRST ((size_t)64 << 10)
#define PRINT_MAX   ((size_t)64 << 20)

static void control_put(struct dmn_json *j, const char *s, size_t n)
{
    if (j->full || n >= j->size - j->len) {
        j->full = true;
        return;
    }
    memcpy(j->text + j->len, s, n);
    j->len += n;
    j->text[j->len] = '\0';
}

size_t dmn_utf8(const char *text)
{
    const unsigned char *s = (const unsigned char *)text;
    size_t n = s[0] < 0x80                   ? 1
               : s[0] >= 0xC2 && s[0] < 0xE0 ? 2
               : s[0] >= 0xE0 && s[0] < 0xF0 ? 3
               : s[0] >= 0xF0 && s[0] < 0xF5 ? 4
                                             : 0;
    for (size_t i = 1; i < n; i++)
        if ((s[i] & 0xC0) != 0x80)
            return 0;
    /* overlong forms, surrogates and what lies past U+10FFFF */
    if ((s[0] == 0xE0 && s[1] < 0xA0) || (s[0] == 0xED && s[1] > 0x9F) ||
        (s[0] == 0xF0 && s[1] < 0x90) || (s[0] == 0xF4 && s[1] > 0x8F))
        return 0;
    return n;
}

static void control_quoted(struct dmn_json *j, const char *v)
{
    control_put(j, "\"", 1);
    for (const char *p = v; *p != '\0';) {
        size_t n = dmn_utf8(p);
        char esc[8];
        if (n == 0) {
            control_put(j, "?", 1);
            n = 1;
        } else if (*p == '"' || *p == '\\') {
            esc[0] = '\\';
            esc[1] = *p;
            control_put(j, esc, 2);
        } else if ((unsigned char)*p < 0x20) {
            snprintf(esc, sizeof esc, "\\u%04x", (unsigned)*p);
            control_put(j, esc, 6);
        } else {
            control_put(j, p, n);
        }
        p += n;
    }
    control_put(j, "\"", 1);
}

static void control_start(struct dmn_json *j, const char *key)
{
    if (j->comma)
        control_put(j, ",", 1);
    if (key != NULL) {
        control_quoted(j, key);
        control_put(j, ":", 1);
    }
    j->comma = true;
}

void dmn_json_init(struct dmn_json *j, char *text, size_t size)
{
    *j = (struct dmn_json){.text = text, .size = size, .full = size == 0};
    if (size > 0)
        text[0] = '\0';
}

void dmn_json_open(struct dmn_json *j, const char *key, char bracket)
{
    control_start(j, key);
    control_put(j, &bracket, 1);
    j->comma = false;
}

void dmn_json_close(struct dmn_json *j, char bracket)
{
    control_put(j, &bracket, 1);
    j->comma = true;
}

void dmn_json_int(struct dmn_json *j, const char *key, long long v)
{
    char s[32];
    control_start(j, key);
    control_put(j, s, (size_t)snprintf(s, sizeof s, "%lld", v));
}

static void control_number(struct dmn_json *j, const char *key, double v, int digits)
{
    char s[40];
    control_start(j, key);
    if (isfinite(v))
        control_put(j, s, (size_t)snprintf(s, sizeof s, "%.*g", digits, v));
    else
        control_put(j, "null", 4);
}

void dmn_json_num(struct dmn_json *j, const char *key, double v)
{
    control_number(j, key, v, 6);
}

void dmn_json_exact(struct dmn_json *j, const char *key, double v)
{
    char s[40];
    snprintf(s, sizeof s, "%.15g", v);
    control_number(j, key, v, strtod(s, NULL) == v ? 15 : 17);
}

void dmn_json_bool(struct dmn_json *j, const char *key, bool v)
{
    control_start(j, key);
    control_put(j, v ? "true" : "false", v ? 4 : 5);
}

void dmn_json_str(struct dmn_json *j, const char *key, const char *v)
{
    control_start(j, key);
    control_quoted(j, v);
}

size_t dmn_json_end(struct dmn_json *j)
{
    return j->full ? 0 : j->len;
}

static pvx_err print_text(FILE *f, const char *text, struct pvx_diag *d)
{
    if (fprintf(f, "%s\n", text) >= 0 && fflush(f) == 0)
        return PVX_OK;
    return pvx_fail(d, pvx_err_from_errno(errno), "the JSON cannot be written: %s",
                    strerror(errno));
}

pvx_err dmn_json_print(FILE *f, void (*fill)(struct dmn_json *j, const void *what),
                       const void *what, struct pvx_diag *d)
{
    for (size_t size = PRINT_FIRST; size <= PRINT_MAX; size *= 4) {
        struct dmn_json j;
        char *text = malloc(size);
        if (text == NULL)
            return pvx_fail(d, PVX_ENOMEM, "no memory for %zu bytes of JSON", size);
        dmn_json_init(&j, text, size);
        fill(&j, what);
        bool fits = dmn_json_end(&j) > 0;
        pvx_err e = fits ? print_text(f, text, d) : PVX_OK;
        free(text);
        if (fits)
            return e;
    }
    return pvx_fail(d, PVX_ERANGE, "more than %zu MiB of JSON", PRINT_MAX >> 20);
}
