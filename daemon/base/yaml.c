#include "base/yaml.h"

#include <ctype.h>
#include <errno.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <yaml.h>

#include "base/mem.h"

#define MAX_BYTES (4u << 20)
#define MAX_DEPTH 64
#define POINT     "; numbers have a decimal point: 0.5, not 0,5"

struct pvx_yaml {
    yaml_document_t doc;
    char name[256];
};

/* libyaml's accessor takes a non-const document but does not change it. */
static yaml_node_t *yaml_at(const pvx_yaml *y, int node)
{
    return node > 0 ? yaml_document_get_node((yaml_document_t *)&y->doc, node) : NULL;
}

static pvx_err invalid(const yaml_parser_t *p, const char *text, size_t len, const char *name,
                       struct pvx_diag *d)
{
    const char *end = text + len;
    const char *why = p->problem == NULL ? "unknown" : p->problem;
    int colon = strncmp(why, "mapping values", 14) == 0; /* cameras: sim: */
    for (size_t line = 0; line < p->problem_mark.line && text < end; line++) {
        const char *eol = memchr(text, '\n', (size_t)(end - text));
        text = eol == NULL ? end : eol + 1;
    }
    while (text < end && *text == ' ')
        text++;
    if (text < end && *text == '\t')
        return pvx_fail(d, PVX_EFORMAT, "%s:%zu: a tab begins this line: indent by spaces", name,
                        p->problem_mark.line + 1);
    return pvx_fail(d, PVX_EFORMAT, "%s:%zu: not valid YAML: %s%s", name, p->problem_mark.line + 1,
                    why, colon ? "; a value that ends in a colon needs quotes, as \"sim:\"" : "");
}

/* Aliases would turn the tree into a graph with possible cycles.  A scan of the events refuses
 * them, and too deep nesting, before the document is composed. */
static pvx_err scan_events(const char *text, size_t len, const char *name, struct pvx_diag *d)
{
    yaml_parser_t p;
    if (!yaml_parser_initialize(&p))
        return PVX_ENOMEM;
    yaml_parser_set_input_string(&p, (const unsigned char *)text, len);
    pvx_err e = PVX_OK;
    int depth = 0, docs = 0;
    for (int done = 0; !done && e == PVX_OK;) {
        yaml_event_t ev;
        if (!yaml_parser_parse(&p, &ev)) {
            e = invalid(&p, text, len, name, d);
            break;
        }
        size_t line = ev.start_mark.line + 1;
        switch (ev.type) {
        case YAML_ALIAS_EVENT:
            e = pvx_fail(d, PVX_EFORMAT, "%s:%zu: aliases (*name) are not allowed here", name,
                         line);
            break;
        case YAML_DOCUMENT_START_EVENT:
            if (++docs > 1)
                e = pvx_fail(d, PVX_EFORMAT, "%s:%zu: only one document per file", name, line);
            break;
        case YAML_SEQUENCE_START_EVENT:
        case YAML_MAPPING_START_EVENT:
            if (++depth > MAX_DEPTH)
                e = pvx_fail(d, PVX_EFORMAT, "%s:%zu: nested too deeply", name, line);
            break;
        case YAML_SEQUENCE_END_EVENT:
        case YAML_MAPPING_END_EVENT: depth--; break;
        case YAML_STREAM_END_EVENT: done = 1; break;
        default: break;
        }
        yaml_event_delete(&ev);
    }
    yaml_parser_delete(&p);
    return e;
}

/* Keys must be scalars and unique within their mapping. */
static pvx_err check_maps(const pvx_yaml *y, struct pvx_diag *d)
{
    yaml_node_t *n;
    for (int id = 1; (n = yaml_at(y, id)) != NULL; id++) {
        if (n->type != YAML_MAPPING_NODE)
            continue;
        size_t count = pvx_yaml_length(y, id);
        if (count > 4096)
            return pvx_yaml_fail(y, id, "mapping", PVX_EFORMAT, d, "more than 4096 keys");
        for (size_t i = 0; i < count; i++) {
            int key = n->data.mapping.pairs.start[i].key;
            if (pvx_yaml_kind(y, key) != PVX_YAML_SCALAR)
                return pvx_yaml_fail(y, key, "key", PVX_EFORMAT, d, "a key must be a plain word");
            for (size_t j = 0; j < i; j++)
                if (strcmp(pvx_yaml_key(y, id, i), pvx_yaml_key(y, id, j)) == 0)
                    return pvx_yaml_fail(y, key, pvx_yaml_key(y, id, i), PVX_EFORMAT, d,
                                         "given twice");
            const char *name = pvx_yaml_key(y, id, i); /* {black: 0,02} */
            if (name[strspn(name, "0123456789")] == '\0' &&
                pvx_yaml_text(y, pvx_yaml_value(y, id, i))[0] == '\0' &&
                pvx_yaml_kind(y, pvx_yaml_value(y, id, i)) == PVX_YAML_SCALAR)
                return pvx_yaml_fail(y, key, name, PVX_EFORMAT, d, "a number is no key%s", POINT);
        }
    }
    return PVX_OK;
}

pvx_err pvx_yaml_parse(const char *text, size_t len, const char *name, pvx_yaml **out,
                       struct pvx_diag *d)
{
    *out = NULL;
    if (len > MAX_BYTES)
        return pvx_fail(d, PVX_EFORMAT, "%s: larger than %u bytes", name, MAX_BYTES);
    if (memchr(text, '\0', len) != NULL)
        return pvx_fail(d, PVX_EFORMAT, "%s: contains a NUL byte, so it is not a YAML file", name);
    PVX_TRY(scan_events(text, len, name, d));
    pvx_yaml *y = pvx_calloc(1, sizeof *y);
    PVX_NEED(y);
    snprintf(y->name, sizeof y->name, "%s", name);
    yaml_parser_t p;
    if (!yaml_parser_initialize(&p)) {
        free(y);
        return PVX_ENOMEM;
    }
    yaml_parser_set_input_string(&p, (const unsigned char *)text, len);
    int ok = yaml_parser_load(&p, &y->doc);
    if (!ok) {
        pvx_err e = invalid(&p, text, len, name, d);
        yaml_parser_delete(&p);
        free(y);
        return e;
    }
    yaml_parser_delete(&p);
    pvx_err e = check_maps(y, d);
    if (e != PVX_OK) {
        pvx_yaml_free(&y);
        return e;
    }
    *out = y;
    return PVX_OK;
}

void pvx_yaml_free(pvx_yaml **y)
{
    if (*y == NULL)
        return;
    yaml_document_delete(&(*y)->doc);
    PVX_FREE(*y);
}

int pvx_yaml_root(const pvx_yaml *y)
{
    return yaml_at(y, 1) == NULL ? 0 : 1;
}

enum pvx_yaml_kind pvx_yaml_kind(const pvx_yaml *y, int node)
{
    yaml_node_t *n = yaml_at(y, node);
    if (n == NULL)
        return PVX_YAML_NONE;
    switch (n->type) {
    case YAML_SCALAR_NODE: return PVX_YAML_SCALAR;
    case YAML_SEQUENCE_NODE: return PVX_YAML_SEQ;
    case YAML_MAPPING_NODE: return PVX_YAML_MAP;
    default: return PVX_YAML_NONE;
    }
}

unsigned pvx_yaml_line(const pvx_yaml *y, int node)
{
    yaml_node_t *n = yaml_at(y, node);
    return n == NULL ? 1 : (unsigned)n->start_mark.line + 1;
}

const char *pvx_yaml_text(const pvx_yaml *y, int node)
{
    yaml_node_t *n = yaml_at(y, node);
    return n != NULL && n->type == YAML_SCALAR_NODE ? (const char *)n->data.scalar.value : "";
}

size_t pvx_yaml_length(const pvx_yaml *y, int node)
{
    yaml_node_t *n = yaml_at(y, node);
    if (n == NULL)
        return 0;
    if (n->type == YAML_SEQUENCE_NODE)
        return (size_t)(n->data.sequence.items.top - n->data.sequence.items.start);
    if (n->type == YAML_MAPPING_NODE)
        return (size_t)(n->data.mapping.pairs.top - n->data.mapping.pairs.start);
    return 0;
}

int pvx_yaml_item(const pvx_yaml *y, int seq, size_t i)
{
    if (pvx_yaml_kind(y, seq) != PVX_YAML_SEQ || i >= pvx_yaml_length(y, seq))
        return 0;
    return yaml_at(y, seq)->data.sequence.items.start[i];
}

const char *pvx_yaml_key(const pvx_yaml *y, int map, size_t i)
{
    if (pvx_yaml_kind(y, map) != PVX_YAML_MAP || i >= pvx_yaml_length(y, map))
        return "";
    return pvx_yaml_text(y, yaml_at(y, map)->data.mapping.pairs.start[i].key);
}

int pvx_yaml_value(const pvx_yaml *y, int map, size_t i)
{
    if (pvx_yaml_kind(y, map) != PVX_YAML_MAP || i >= pvx_yaml_length(y, map))
        return 0;
    return yaml_at(y, map)->data.mapping.pairs.start[i].value;
}

int pvx_yaml_get(const pvx_yaml *y, int map, const char *key)
{
    for (size_t i = 0; i < pvx_yaml_length(y, map); i++)
        if (strcmp(pvx_yaml_key(y, map, i), key) == 0)
            return pvx_yaml_value(y, map, i);
    return 0;
}

pvx_err(pvx_yaml_fail)(const pvx_yaml *y, int node, const char *key, pvx_err e, struct pvx_diag *d,
                       const char *fmt, ...)
{
    char reason[400];
    va_list ap;
    va_start(ap, fmt);
    vsnprintf(reason, sizeof reason, fmt, ap);
    va_end(ap);
    return pvx_fail(d, e, "%s:%u: %s: %s", y->name, pvx_yaml_line(y, node), key, reason);
}

static int yaml_word_in(const char *word, const char *list)
{
    size_t n = strlen(word);
    for (const char *p = list; n > 0 && (p = strstr(p, word)) != NULL; p += n)
        if ((p == list || p[-1] == ' ') && (p[n] == ' ' || p[n] == '\0'))
            return 1;
    return 0;
}

pvx_err pvx_yaml_known(const pvx_yaml *y, int map, const char *path, const char *known,
                       struct pvx_diag *d)
{
    if (pvx_yaml_kind(y, map) != PVX_YAML_MAP)
        return pvx_yaml_fail(y, map, path, PVX_EFORMAT, d, "should be a mapping (key: value)");
    for (size_t i = 0; i < pvx_yaml_length(y, map); i++) {
        const char *key = pvx_yaml_key(y, map, i);
        if (!yaml_word_in(key, known))
            return pvx_yaml_fail(y, yaml_at(y, map)->data.mapping.pairs.start[i].key, key,
                                 PVX_EFORMAT, d, "unknown key; known here: %s", known);
    }
    return PVX_OK;
}

pvx_err pvx_parse_double(const char *s, double min, double max, double *out)
{
    if (*s == '\0' || isspace((unsigned char)*s))
        return PVX_EFORMAT;
    for (const char *p = s; *p != '\0'; p++) /* no hex floats, no nan/inf words */
        if (!isdigit((unsigned char)*p) && strchr("+-.eE", *p) == NULL)
            return PVX_EFORMAT;
    char *end;
    double v = strtod(s, &end);
    if (*end != '\0' || end == s || !isfinite(v))
        return PVX_EFORMAT;
    if (v < min || v > max)
        return PVX_ERANGE;
    *out = v;
    return PVX_OK;
}

pvx_err pvx_parse_int(const char *s, int64_t min, int64_t max, int64_t *out)
{
    const char *p = *s == '-' || *s == '+' ? s + 1 : s;
    if (!isdigit((unsigned char)*p))
        return PVX_EFORMAT;
    char *end;
    errno = 0;
    long long v = strtoll(s, &end, 10);
    if (*end != '\0')
        return PVX_EFORMAT;
    if (errno == ERANGE || v < min || v > max)
        return PVX_ERANGE;
    *out = v;
    return PVX_OK;
}

pvx_err pvx_yaml_double(const pvx_yaml *y, int node, const char *key, double min, double max,
                        double *out, struct pvx_diag *d)
{
    if (pvx_yaml_kind(y, node) != PVX_YAML_SCALAR)
        return pvx_yaml_fail(y, node, key, PVX_EFORMAT, d, "should be a number");
    pvx_err e = pvx_parse_double(pvx_yaml_text(y, node), min, max, out);
    if (e == PVX_ERANGE)
        return pvx_yaml_fail(y, node, key, PVX_EINVAL, d, "%s is outside %g..%g",
                             pvx_yaml_text(y, node), min, max);
    if (e != PVX_OK)
        return pvx_yaml_fail(y, node, key, PVX_EFORMAT, d, "'%s' is not a finite number%s",
                             pvx_yaml_text(y, node),
                             strchr(pvx_yaml_text(y, node), ',') != NULL ? POINT : "");
    return PVX_OK;
}

pvx_err pvx_yaml_int(const pvx_yaml *y, int node, const char *key, int64_t min, int64_t max,
                     int64_t *out, struct pvx_diag *d)
{
    if (pvx_yaml_kind(y, node) != PVX_YAML_SCALAR)
        return pvx_yaml_fail(y, node, key, PVX_EFORMAT, d, "should be a whole number");
    pvx_err e = pvx_parse_int(pvx_yaml_text(y, node), min, max, out);
    if (e == PVX_ERANGE)
        return pvx_yaml_fail(y, node, key, PVX_EINVAL, d, "%s is outside %lld..%lld",
                             pvx_yaml_text(y, node), (long long)min, (long long)max);
    if (e != PVX_OK)
        return pvx_yaml_fail(y, node, key, PVX_EFORMAT, d, "'%s' is not a whole number",
                             pvx_yaml_text(y, node));
    return PVX_OK;
}

pvx_err pvx_yaml_bool(const pvx_yaml *y, int node, const char *key, int *out, struct pvx_diag *d)
{
    const char *t = pvx_yaml_text(y, node);
    if (strcmp(t, "true") == 0 || strcmp(t, "yes") == 0 || strcmp(t, "on") == 0)
        *out = 1;
    else if (strcmp(t, "false") == 0 || strcmp(t, "no") == 0 || strcmp(t, "off") == 0)
        *out = 0;
    else
        return pvx_yaml_fail(y, node, key, PVX_EFORMAT, d, "should be true or false");
    return PVX_OK;
}

pvx_err pvx_yaml_doubles(const pvx_yaml *y, int node, const char *key, size_t n_min, size_t n_max,
                         double *out, struct pvx_diag *d)
{
    size_t len = pvx_yaml_length(y, node);
    if (pvx_yaml_kind(y, node) != PVX_YAML_SEQ || len < n_min || len > n_max) {
        if (n_min == n_max)
            return pvx_yaml_fail(y, node, key, PVX_EFORMAT, d, "should be a list of %zu numbers%s",
                                 n_min, len > n_max ? POINT : "");
        return pvx_yaml_fail(y, node, key, PVX_EFORMAT, d, "should be a list of %zu to %zu numbers",
                             n_min, n_max);
    }
    for (size_t i = 0; i < len; i++) {
        const char *text = pvx_yaml_text(y, pvx_yaml_item(y, node, i));
        if (text[0] == '0' && isdigit((unsigned char)text[1])) /* [-0,05, 0,01] */
            return pvx_yaml_fail(y, node, key, PVX_EFORMAT, d, "'%s' begins with 0%s", text, POINT);
        PVX_TRY(pvx_yaml_double(y, pvx_yaml_item(y, node, i), key, -1e300, 1e300, &out[i], d));
    }
    return PVX_OK;
}
