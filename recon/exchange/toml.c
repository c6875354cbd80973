/* toml.c - TOML translated to YAML text, line by line: [a.b] becomes the key "a.b" of one mapping.  Debian 12 has no C
 * library for TOML.  Source: TOML 1.0.0.  Not read, and refused: arrays of tables, strings over several lines. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "recon/exchange/fields.h"

#define BARE      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-"
#define MAX_DEPTH 16

struct toml {
    const char *p, *end, *name;
    unsigned line;
    FILE *f;
    struct pvx_diag *d;
};

static pvx_err toml_fail(const struct toml *t, const char *why)
{
    return pvx_fail(t->d, PVX_EFORMAT, "%s:%u: not valid TOML: %s", t->name, t->line, why);
}

static int toml_peek(const struct toml *t)
{
    return t->p < t->end ? (unsigned char)*t->p : -1;
}

/* Blanks and comments; with `lines` also ends of lines, which are copied. */
static void toml_blanks(struct toml *t, bool lines)
{
    for (; t->p < t->end; t->p++) {
        if (*t->p == '#')
            while (t->p + 1 < t->end && t->p[1] != '\n')
                t->p++;
        else if (*t->p == '\n' && lines) {
            t->line++;
            fputc('\n', t->f);
        } else if (*t->p != ' ' && *t->p != '\t' && *t->p != '\r')
            return;
    }
}

static void toml_put(const struct toml *t, int c)
{
    if (c == '"' || c == '\\')
        fputc('\\', t->f);
    fputc(c, t->f);
}

/* "basic": its escapes are YAML's, too.  'literal': none. */
static pvx_err toml_string(struct toml *t)
{
    const char quote = *t->p++;
    if (t->p + 1 < t->end && t->p[0] == quote && t->p[1] == quote)
        return toml_fail(t, "strings over several lines are not read here");
    for (; toml_peek(t) != quote; t->p++) {
        if (t->p == t->end || (unsigned char)*t->p < ' ')
            return toml_fail(t, "a string does not end on its line");
        if (quote == '\'')
            toml_put(t, *t->p);
        else {
            fputc(*t->p, t->f);
            if (*t->p == '\\' && t->p + 1 < t->end && (unsigned char)t->p[1] >= ' ')
                fputc(*++t->p, t->f);
        }
    }
    t->p++;
    return PVX_OK;
}

/* a.b."c d", into one quoted key. */
static pvx_err toml_key(struct toml *t)
{
    fputc('"', t->f);
    for (;;) {
        toml_blanks(t, false);
        size_t n = strspn(t->p, BARE); /* the buffer ends in a 0 byte */
        if (n > 0) {
            fwrite(t->p, 1, n, t->f);
            t->p += n;
        } else if (toml_peek(t) == '"' || toml_peek(t) == '\'')
            PVX_TRY(toml_string(t));
        else
            return toml_fail(t, "here should be a key");
        toml_blanks(t, false);
        if (toml_peek(t) != '.')
            break;
        fputc('.', t->f);
        t->p++;
    }
    fputc('"', t->f);
    return PVX_OK;
}

static pvx_err toml_value(struct toml *t, int depth);

static pvx_err toml_pair(struct toml *t, int depth)
{
    PVX_TRY(toml_key(t));
    if (toml_peek(t) != '=')
        return toml_fail(t, "here should be =");
    t->p++;
    fputs(": ", t->f);
    toml_blanks(t, false);
    return toml_value(t, depth);
}

static pvx_err toml_inside(struct toml *t, int depth, char close)
{
    const bool list = close == ']';
    if (depth == MAX_DEPTH)
        return toml_fail(t, "nested too deeply");
    fputc(*t->p++, t->f);
    for (;;) {
        toml_blanks(t, list);
        if (toml_peek(t) == close)
            break;
        PVX_TRY(list ? toml_value(t, depth + 1) : toml_pair(t, depth + 1));
        toml_blanks(t, list);
        if (toml_peek(t) == close)
            break;
        if (toml_peek(t) != ',')
            return toml_fail(t, list ? "here should be , or ]" : "here should be , or }");
        fputs(", ", t->f);
        t->p++;
    }
    fputc(*t->p++, t->f);
    return PVX_OK;
}

static pvx_err toml_value(struct toml *t, int depth)
{
    int c = toml_peek(t);
    if (c == '[')
        return toml_inside(t, depth, ']');
    if (c == '{')
        return toml_inside(t, depth, '}');
    fputc('"', t->f);
    if (c == '"' || c == '\'')
        PVX_TRY(toml_string(t));
    else {
        size_t n = strcspn(t->p, ",]}# \t\r\n\"'\\");
        if (n == 0 || t->p + n > t->end)
            return toml_fail(t, "here should be a value");
        for (size_t i = 0; i < n; i++)
            if (t->p[i] != '_') /* 1_000 */
                fputc(t->p[i], t->f);
        t->p += n;
    }
    fputc('"', t->f);
    return PVX_OK;
}

static pvx_err toml_table(struct toml *t, bool *open)
{
    if (t->p + 1 < t->end && t->p[1] == '[')
        return toml_fail(t, "arrays of tables, [[...]], are not read here");
    t->p++;
    fputs(*open ? "}, " : "", t->f);
    PVX_TRY(toml_key(t));
    if (toml_peek(t) != ']')
        return toml_fail(t, "here should be ]");
    t->p++;
    fputs(": {", t->f);
    *open = true;
    return PVX_OK;
}

static pvx_err toml_all(struct toml *t)
{
    bool open = false;
    fputc('{', t->f);
    for (;;) {
        toml_blanks(t, true);
        if (t->p == t->end)
            break;
        if (*t->p == '[')
            PVX_TRY(toml_table(t, &open));
        else {
            PVX_TRY(toml_pair(t, 0));
            fputs(", ", t->f);
        }
        toml_blanks(t, false);
        if (t->p < t->end && *t->p != '\n')
            return toml_fail(t, "here should be the end of the line");
    }
    fputs(open ? "}}\n" : "}\n", t->f);
    return PVX_OK;
}

pvx_err exchange_from_toml(const char *text, size_t len, const char *name, char **out, size_t *n,
                           struct pvx_diag *d)
{
    *out = NULL;
    *n = 0;
    if (memchr(text, '\0', len) != NULL)
        return pvx_fail(d, PVX_EFORMAT, "%s: contains a NUL byte, so it is not a TOML file", name);
    char *copy = malloc(len + 1); /* with a 0 byte behind it */
    PVX_NEED(copy);
    memcpy(copy, text, len);
    copy[len] = '\0';
    struct toml t = {copy, copy + len, name, 1, open_memstream(out, n), d};
    pvx_err e = t.f == NULL ? PVX_ENOMEM : toml_all(&t);
    if (t.f != NULL && fclose(t.f) != 0 && e == PVX_OK)
        e = PVX_ENOMEM;
    free(copy);
    if (e != PVX_OK) {
        free(*out);
        *out = NULL;
    }
    return e;
}
