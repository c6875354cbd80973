#include "daemon/config/config.h"

#include <ctype.h>
#include <math.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/file.h"
#include "base/log.h"
#include "base/yaml.h"
#include "daemon/config/compute.h"
#include "recon/geom/blind.h"

#define MAX_BYTES (1u << 20)

static void *member(struct dmn_config *c, const struct dmn_option *o)
{
    return (char *)c + o->offset;
}

/* ---- one value ---- */

static pvx_err set_word(const pvx_yaml *y, int node, const char *key, char *out, size_t size,
                        struct pvx_diag *d)
{
    if (pvx_yaml_kind(y, node) != PVX_YAML_SCALAR)
        return pvx_yaml_fail(y, node, key, PVX_EFORMAT, d, "should be a word");
    const char *t = pvx_yaml_text(y, node);
    if (strlen(t) >= size)
        return pvx_yaml_fail(y, node, key, PVX_EINVAL, d, "longer than %zu characters", size - 1);
    for (const char *p = t; *p != '\0'; p++)
        if (iscntrl((unsigned char)*p))
            return pvx_yaml_fail(y, node, key, PVX_EINVAL, d, "contains a control character");
    snprintf(out, size, "%s", t);
    return PVX_OK;
}

static pvx_err set_choice(const pvx_yaml *y, int node, const struct dmn_option *o, int *out,
                          struct pvx_diag *d)
{
    char word[64];
    if (pvx_yaml_kind(y, node) == PVX_YAML_SCALAR)
        for (int i = 0; dmn_choice_word(o->choices, i, word, sizeof word), word[0] != '\0'; i++)
            if (strcmp(word, pvx_yaml_text(y, node)) == 0) {
                *out = i;
                return PVX_OK;
            }
    return pvx_yaml_fail(y, node, o->key, PVX_EINVAL, d, "'%.40s' is not one of %s",
                         pvx_yaml_text(y, node), o->choices);
}

static pvx_err set_where(const pvx_yaml *y, int node, const struct dmn_option *o, char *out,
                         struct pvx_diag *d)
{
    char word[DMN_WORD_MAX];
    enum dmn_compute_where where;
    const char *name;
    PVX_TRY(set_word(y, node, o->key, word, sizeof word, d));
    if (!dmn_compute_parse(word, &where, &name))
        return pvx_yaml_fail(y, node, o->key, PVX_EINVAL, d, "'%.40s' is not one of %s", word,
                             DMN_COMPUTE_WORDS);
    memcpy(out, word, strlen(word) + 1);
    return PVX_OK;
}

static pvx_err config_set_format(const pvx_yaml *y, int node, const struct dmn_option *o, int *out,
                                 struct pvx_diag *d)
{
    char names[CAP_PIXFMT_NAMES_MAX];
    bool scalar = pvx_yaml_kind(y, node) == PVX_YAML_SCALAR;
    const char *word = scalar ? pvx_yaml_text(y, node) : "";
    *out = (int)cap_pixfmt_parse(word);
    if (*out != CAP_FMT_NONE || strcmp(word, "auto") == 0)
        return PVX_OK;
    cap_pixfmt_names(names, sizeof names);
    return pvx_yaml_fail(y, node, o->key, PVX_EINVAL, d, "'%.40s' is not auto or one of %s", word,
                         names);
}

static pvx_err set_ints(const pvx_yaml *y, int node, const struct dmn_option *o,
                        struct dmn_ints *out, struct pvx_diag *d)
{
    int seq = pvx_yaml_kind(y, node) == PVX_YAML_SEQ;
    size_t n = seq ? pvx_yaml_length(y, node) : 1;
    if ((!seq && pvx_yaml_kind(y, node) != PVX_YAML_SCALAR) || (n != 0 && n != 1 && n != 3))
        return pvx_yaml_fail(y, node, o->key, PVX_EFORMAT, d, "should be one number or three");
    for (size_t i = 0; i < n; i++) {
        int64_t v;
        PVX_TRY(pvx_yaml_int(y, seq ? pvx_yaml_item(y, node, i) : node, o->key, (int64_t)o->min,
                             (int64_t)o->max, &v, d));
        out->v[i] = v;
    }
    out->n = n;
    return PVX_OK;
}

static pvx_err set_texts(const pvx_yaml *y, int node, const struct dmn_option *o,
                         struct dmn_texts *out, struct pvx_diag *d)
{
    int seq = pvx_yaml_kind(y, node) == PVX_YAML_SEQ;
    size_t n = seq ? pvx_yaml_length(y, node) : 1;
    if (n > DMN_TEXTS_MAX)
        return pvx_yaml_fail(y, node, o->key, PVX_EINVAL, d, "more than %d", DMN_TEXTS_MAX);
    for (size_t i = 0; i < n; i++) {
        int item = seq ? pvx_yaml_item(y, node, i) : node;
        PVX_TRY(set_word(y, item, o->key, out->v[i], sizeof out->v[i], d));
        if (out->v[i][0] == '\0')
            return pvx_yaml_fail(y, item, o->key, PVX_EINVAL, d, "is empty");
    }
    out->n = n;
    return PVX_OK;
}

static pvx_err set_pairs(const pvx_yaml *y, int node, const struct dmn_option *o,
                         struct dmn_pairs *out, struct pvx_diag *d)
{
    if (o->type == DMN_CAMERAS && pvx_yaml_kind(y, node) == PVX_YAML_SCALAR) {
        out->item[0].key[0] = '\0';
        PVX_TRY(set_word(y, node, o->key, out->item[0].value, sizeof out->item[0].value, d));
        out->n = out->item[0].value[0] == '\0' ? 0 : 1;
        return PVX_OK;
    }
    if (pvx_yaml_kind(y, node) != PVX_YAML_MAP)
        return pvx_yaml_fail(y, node, o->key, PVX_EFORMAT, d, "should be a mapping of names%s",
                             o->type == DMN_CAMERAS ? " to sources, or one source for all" : "");
    size_t n = pvx_yaml_length(y, node);
    if (n > DMN_PAIRS_MAX)
        return pvx_yaml_fail(y, node, o->key, PVX_EINVAL, d, "more than %d entries", DMN_PAIRS_MAX);
    for (size_t i = 0; i < n; i++) {
        const char *key = pvx_yaml_key(y, node, i);
        int value = pvx_yaml_value(y, node, i);
        char path[128];
        snprintf(path, sizeof path, "%s.%.60s", o->key, key);
        if (key[0] == '\0' || strlen(key) >= sizeof out->item[i].key)
            return pvx_yaml_fail(y, value, path, PVX_EINVAL, d, "a name has 1 to %zu characters",
                                 sizeof out->item[i].key - 1);
        for (const char *p = key; *p != '\0'; p++)
            if (!isalnum((unsigned char)*p) && strchr("._-", *p) == NULL)
                return pvx_yaml_fail(y, value, path, PVX_EINVAL, d,
                                     "a name is made of letters, digits and . _ -");
        snprintf(out->item[i].key, sizeof out->item[i].key, "%s", key);
        PVX_TRY(set_word(y, value, path, out->item[i].value, sizeof out->item[i].value, d));
        if (out->item[i].value[0] == '\0')
            return pvx_yaml_fail(y, value, path, PVX_EINVAL, d, "is empty");
    }
    out->n = n;
    return PVX_OK;
}

static pvx_err config_set(const pvx_yaml *y, int node, const struct dmn_option *o,
                          struct dmn_config *c, struct pvx_diag *d)
{
    void *m = member(c, o);
    switch (o->type) {
    case DMN_BOOL: return pvx_yaml_bool(y, node, o->key, m, d);
    case DMN_INT: return pvx_yaml_int(y, node, o->key, (int64_t)o->min, (int64_t)o->max, m, d);
    case DMN_REAL: return pvx_yaml_double(y, node, o->key, o->min, o->max, m, d);
    case DMN_TEXT: return set_word(y, node, o->key, m, o->size, d);
    case DMN_WHERE: return set_where(y, node, o, m, d);
    case DMN_CHOICE: return set_choice(y, node, o, m, d);
    case DMN_FORMAT: return config_set_format(y, node, o, m, d);
    case DMN_INTS: return set_ints(y, node, o, m, d);
    case DMN_TEXTS: return set_texts(y, node, o, m, d);
    case DMN_PAIRS:
    case DMN_CAMERAS: return set_pairs(y, node, o, m, d);
    case DMN_RING: return dmn_ring_read(y, node, o->key, m, d);
    case DMN_TRIGGERS: return dmn_triggers_read(y, node, o->key, m, d);
    }
    return PVX_EINVAL;
}

/* ---- the file ---- */

static int is_section(const char *word)
{
    size_t n = strlen(word);
    for (size_t i = 0; i < dmn_n_options; i++)
        if (strncmp(dmn_options[i].key, word, n) == 0 && dmn_options[i].key[n] == '.')
            return 1;
    return 0;
}

static pvx_err config_unknown(const pvx_yaml *y, int node, const char *path, struct pvx_diag *d)
{
    return pvx_yaml_fail(y, node, path, PVX_EINVAL, d,
                         "unknown key (`pyrovoxd --print-config` lists them)");
}

static struct dmn_config defaults;

static void make_defaults(void)
{
    struct dmn_config *c = &defaults;
    snprintf(c->dir, sizeof c->dir, ".");
    snprintf(c->name, sizeof c->name, "defaults");
    for (size_t i = 0; i < dmn_n_options; i++) {
        const struct dmn_option *o = &dmn_options[i];
        pvx_yaml *y;
        if (pvx_yaml_parse(o->def, strlen(o->def), "default", &y, NULL) != PVX_OK)
            continue; /* memory only: the test of the table reads every default */
        pvx_err e = config_set(y, pvx_yaml_root(y), o, c, NULL);
        (void)e;
        pvx_yaml_free(&y);
    }
}

void dmn_config_defaults(struct dmn_config *c)
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, make_defaults);
    *c = defaults;
}

static pvx_err config_read_map(const pvx_yaml *y, int map, const char *section,
                               struct dmn_config *c, struct pvx_diag *d)
{
    for (size_t i = 0; i < pvx_yaml_length(y, map); i++) {
        char path[160];
        const char *word = pvx_yaml_key(y, map, i);
        int value = pvx_yaml_value(y, map, i);
        snprintf(path, sizeof path, "%s%s%.64s", section, section[0] != '\0' ? "." : "", word);
        const struct dmn_option *o = strchr(word, '.') == NULL ? dmn_option_find(path) : NULL;
        if (o != NULL) {
            PVX_TRY(config_set(y, value, o, c, d));
        } else if (section[0] == '\0' && is_section(word)) {
            char mode[180];
            snprintf(mode, sizeof mode, "%s.mode", path);
            o = dmn_option_find(mode); /* "record: raw" */
            if (o != NULL && pvx_yaml_kind(y, value) == PVX_YAML_SCALAR) {
                PVX_TRY(config_set(y, value, o, c, d));
                continue;
            }
            if (pvx_yaml_kind(y, value) != PVX_YAML_MAP)
                return pvx_yaml_fail(y, value, path, PVX_EFORMAT, d, "should be a mapping");
            PVX_TRY(config_read_map(y, value, word, c, d));
        } else {
            return config_unknown(y, value, path, d);
        }
    }
    return PVX_OK;
}

pvx_err dmn_config_parse(const char *text, size_t len, const char *name, struct dmn_config *c,
                         struct pvx_diag *d)
{
    dmn_config_defaults(c);
    snprintf(c->name, sizeof c->name, "%s", name);
    pvx_yaml *y;
    PVX_TRY(pvx_yaml_parse(text, len, name, &y, d));
    int root = pvx_yaml_root(y);
    pvx_err e = PVX_OK;
    if (root != 0) { /* an empty file: all defaults */
        if (pvx_yaml_kind(y, root) != PVX_YAML_MAP)
            e = pvx_yaml_fail(y, root, "configuration", PVX_EFORMAT, d, "should be a mapping");
        else
            e = config_read_map(y, root, "", c, d);
    }
    pvx_yaml_free(&y);
    return e;
}

pvx_err dmn_config_load(const char *path, struct dmn_config *c, struct pvx_diag *d)
{
    char *text;
    size_t len;
    PVX_TRY(pvx_file_read(path, MAX_BYTES, &text, &len, d));
    pvx_err e = dmn_config_parse(text, len, path, c, d);
    free(text);
    const char *slash = strrchr(path, '/');
    if (slash != NULL)
        snprintf(c->dir, sizeof c->dir, "%.*s", (int)(slash == path ? 1 : slash - path), path);
    return e;
}

pvx_err dmn_config_set(struct dmn_config *c, const char *key, const char *value, const char *name,
                       struct pvx_diag *d)
{
    const struct dmn_option *o = dmn_option_find(key);
    if (o == NULL)
        return pvx_fail(d, PVX_EINVAL,
                        "%s: %.64s: unknown key (`pyrovoxd --print-config` lists them)", name, key);
    pvx_yaml *y;
    PVX_TRY(pvx_yaml_parse(value, strlen(value), name, &y, d));
    pvx_err e = config_set(y, pvx_yaml_root(y), o, c, d);
    pvx_yaml_free(&y);
    return e;
}

/* ---- printing ---- */

/* Print a word double-quoted, so that any text is read back as it was.  What YAML takes for a line break
 * or does not allow is escaped.  The text came out of libyaml, so it is UTF-8. */
static void config_print_word(FILE *f, const char *w)
{
    fputc('"', f);
    for (const unsigned char *p = (const unsigned char *)w; *p != '\0';) {
        size_t n = p[0] < 0x80 ? 1 : p[0] < 0xE0 ? 2 : p[0] < 0xF0 ? 3 : 4;
        unsigned long cp = n == 1 ? p[0] : p[0] & (0x7Fu >> n);
        for (size_t i = 1; i < n; i++)
            cp = cp << 6 | (p[i] & 0x3F);
        if (cp == '"' || cp == '\\')
            fprintf(f, "\\%c", (int)cp);
        else if ((cp >= 0x7F && cp < 0xA0) || cp == 0x2028 || cp == 0x2029 || cp >= 0xD800)
            fprintf(f, "\\U%08lX", cp);
        else
            fwrite(p, 1, n, f);
        p += n;
    }
    fputc('"', f);
}

static void print_real(FILE *f, double v)
{
    char s[40];
    for (int digits = 6; digits <= 17; digits++) { /* the shortest that reads back the same */
        snprintf(s, sizeof s, "%.*g", digits, v);
        if (strtod(s, NULL) == v)
            break;
    }
    fputs(s, f);
}

static void print_value(FILE *f, const struct dmn_option *o, const void *m, const char *indent)
{
    char word[64];
    switch (o->type) {
    case DMN_BOOL: fputs(*(const int *)m ? "true" : "false", f); break;
    case DMN_INT: fprintf(f, "%lld", (long long)*(const int64_t *)m); break;
    case DMN_REAL: print_real(f, *(const double *)m); break;
    case DMN_TEXT: config_print_word(f, m); break;
    case DMN_WHERE: strchr(m, ':') != NULL ? config_print_word(f, m) : (void)fputs(m, f); break;
    case DMN_CHOICE:
        dmn_choice_word(o->choices, *(const int *)m, word, sizeof word);
        fputs(word, f);
        break;
    case DMN_FORMAT: {
        int v = *(const int *)m;
        fputs(v == CAP_FMT_NONE ? "auto" : cap_pixfmt_name((enum cap_pixfmt)v), f);
        break;
    }
    case DMN_INTS: {
        const struct dmn_ints *v = m;
        fputc('[', f);
        for (size_t i = 0; i < v->n; i++)
            fprintf(f, "%s%lld", i > 0 ? ", " : "", v->v[i]);
        fputc(']', f);
        break;
    }
    case DMN_TEXTS: {
        const struct dmn_texts *v = m;
        fputc('[', f);
        for (size_t i = 0; i < v->n; i++) {
            fputs(i > 0 ? ", " : "", f);
            config_print_word(f, v->v[i]);
        }
        fputc(']', f);
        break;
    }
    case DMN_RING: dmn_ring_print(f, m); break;
    case DMN_TRIGGERS: dmn_triggers_print(f, m); break;
    case DMN_PAIRS:
    case DMN_CAMERAS: {
        const struct dmn_pairs *v = m;
        if (v->n == 0)
            fputs(o->type == DMN_CAMERAS ? "\"\"" : "{}", f);
        else if (v->item[0].key[0] == '\0')
            config_print_word(f, v->item[0].value);
        else
            for (size_t i = 0; i < v->n; i++) {
                fprintf(f, "\n%s  %s: ", indent, v->item[i].key);
                config_print_word(f, v->item[i].value);
            }
        break;
    }
    }
    fputc('\n', f);
}

/* Help as a comment of at most 96 columns, with choices or range, unit and default. */
static void print_help(FILE *f, const struct dmn_option *o, const char *indent)
{
    char text[900];
    int n = snprintf(text, sizeof text, "%s", o->help);
    if (o->choices != NULL)
        n += snprintf(text + n, sizeof text - (size_t)n, " One of %s.", o->choices);
    else if (o->min < o->max)
        n += snprintf(text + n, sizeof text - (size_t)n, " %.10g to %.10g%s%s.", o->min, o->max,
                      o->unit[0] != '\0' ? " " : "", o->unit);
    snprintf(text + n, sizeof text - (size_t)n, " Default %s.", o->def);
    const char *p = text;
    while (*p != '\0') {
        size_t room = 94 - strlen(indent), len = strlen(p);
        if (len > room) {
            len = room;
            while (len > 1 && p[len] != ' ')
                len--;
        }
        fprintf(f, "%s# %.*s\n", indent, (int)len, p);
        p += len;
        while (*p == ' ')
            p++;
    }
}

char *dmn_config_value(const struct dmn_config *c, const struct dmn_option *o)
{
    char *text = NULL;
    size_t len = 0;
    FILE *f = open_memstream(&text, &len);
    if (f == NULL)
        return NULL;
    print_value(f, o, (const char *)c + o->offset, "");
    if (fclose(f) != 0) {
        free(text);
        return NULL;
    }
    text[strcspn(text, "\n")] = '\0';
    return text;
}

char *dmn_config_format(const struct dmn_config *c)
{
    char *text = NULL;
    size_t len = 0;
    FILE *f = open_memstream(&text, &len);
    if (f == NULL)
        return NULL;
    char section[32] = "";
    for (size_t i = 0; i < dmn_n_options; i++) {
        const struct dmn_option *o = &dmn_options[i];
        const char *dot = strchr(o->key, '.');
        const char *word = dot == NULL ? o->key : dot + 1;
        size_t n = dot == NULL ? 0 : (size_t)(dot - o->key);
        if (n > 0 && (strlen(section) != n || strncmp(section, o->key, n) != 0)) {
            snprintf(section, sizeof section, "%.*s", (int)n, o->key);
            fprintf(f, "\n%s:\n", section);
        }
        const char *indent = n > 0 ? "  " : "";
        print_help(f, o, indent);
        fprintf(f, "%s%s: ", indent, word);
        print_value(f, o, (const char *)c + o->offset, indent);
    }
    if (fclose(f) != 0) {
        free(text);
        return NULL;
    }
    return text;
}

/* ---- what the rest of the daemon asks ---- */

void dmn_config_path(const struct dmn_config *c, const char *name, char *out, size_t size)
{
    if (name[0] == '/' || strcmp(c->dir, ".") == 0)
        snprintf(out, size, "%s", name);
    else
        snprintf(out, size, "%s/%s", c->dir, name);
}

/* "GV08+" number 3 -> "GV11"; digits keep their width. */
static pvx_err count_up(const char *pattern, size_t index, char *out, size_t size,
                        struct pvx_diag *d)
{
    size_t end = strlen(pattern) - 1, start = end;
    while (start > 0 && isdigit((unsigned char)pattern[start - 1]))
        start--;
    if (start == end || end - start > 9)
        return pvx_fail(d, PVX_EINVAL,
                        "cameras: '%s': the + at the end must follow a number of 1 to 9 digits",
                        pattern);
    unsigned long long v = strtoull(pattern + start, NULL, 10) + index;
    /* An IPv4 address counts in its last part only. */
    int dots = 0;
    for (size_t i = 0; i < start; i++)
        dots += pattern[i] == '.';
    if (dots == 3 && pattern[start - 1] == '.' && v > 254)
        return pvx_fail(d, PVX_EINVAL, "cameras: '%s' runs past .254 at camera number %zu", pattern,
                        index);
    snprintf(out, size, "%.*s%0*llu", (int)start, pattern, (int)(end - start), v);
    return PVX_OK;
}

/* {name} -> the camera's name; relative files: and take: patterns start at the configuration's folder. */
static pvx_err expand(const struct dmn_config *c, const char *pattern, const char *name, char *out,
                      size_t size, struct pvx_diag *d)
{
    char text[PATH_MAX];
    size_t n = 0;
    const char *p = pattern;
    const char *colon = strchr(p, ':');
    bool file = strncmp(p, "files:", 6) == 0 || strncmp(p, "take:", 5) == 0;
    if (file && colon[1] != '/' && strcmp(c->dir, ".") != 0) {
        n = (size_t)snprintf(text, sizeof text, "%.*s%s/", (int)(colon + 1 - p), p, c->dir);
        p = colon + 1;
    }
    for (; *p != '\0' && n + REC_NAME_MAX < sizeof text; p++) {
        if (strncmp(p, "{name}", 6) == 0) {
            n += (size_t)snprintf(text + n, sizeof text - n, "%s", name);
            p += 5;
        } else {
            text[n++] = *p;
        }
    }
    text[n < sizeof text ? n : sizeof text - 1] = '\0';
    if (*p != '\0' || n >= size)
        return pvx_fail(d, PVX_ERANGE, "cameras: %s: the source '%s' is too long", name, pattern);
    memcpy(out, text, n + 1);
    return PVX_OK;
}

pvx_err dmn_config_source(const struct dmn_config *c, const char *name, size_t index, char *out,
                          size_t size, struct pvx_diag *d)
{
    out[0] = '\0';
    if (c->cameras.n == 1 && c->cameras.item[0].key[0] == '\0') {
        const char *pattern = c->cameras.item[0].value;
        char one[DMN_WORD_MAX + 16];
        if (pattern[strlen(pattern) - 1] == '+') {
            PVX_TRY(count_up(pattern, index, one, sizeof one, d));
            pattern = one;
        }
        return expand(c, pattern, name, out, size, d);
    }
    for (size_t i = 0; i < c->cameras.n; i++)
        if (strcmp(c->cameras.item[i].key, name) == 0)
            return expand(c, c->cameras.item[i].value, name, out, size, d);
    return PVX_OK;
}

static void set_grid(const struct dmn_config *c, struct rec_grid *g)
{
    if (c->basis != 0)
        g->basis = c->basis == 2 ? REC_TRILINEAR : REC_BOX;
    if (c->grid.n == 3) {
        for (int a = 0; a < 3; a++)
            g->n[a] = (int32_t)c->grid.v[a];
    } else if (c->grid.n == 1) {
        double h = (g->max[0] - g->min[0]) / (double)c->grid.v[0];
        for (int a = 0; a < 3; a++) {
            double n = (g->max[a] - g->min[a]) / h + 0.5;
            g->n[a] = n < 1 ? 1 : n > REC_GRID_MAX ? REC_GRID_MAX : (int32_t)n;
        }
    }
}

pvx_err dmn_config_rig(const struct dmn_config *c, struct rec_rig *out, struct pvx_diag *d)
{
    if (c->rig[0] == '\0')
        return pvx_fail(d, PVX_EINVAL, "%s: rig: not given; name the calibration file", c->name);
    if (c->cameras.n == 0)
        return pvx_fail(d, PVX_EINVAL,
                        "%s: cameras: none given; say for instance cameras: \"sim:\"", c->name);
    char path[PATH_MAX];
    dmn_config_path(c, c->rig, path, sizeof path);
    PVX_TRY(rec_rig_load(path, out, d));
    set_grid(c, &out->grid);
    if (c->cameras.item[0].key[0] == '\0')
        return PVX_OK;
    char list[REC_MAX_CAMERAS * (REC_NAME_MAX + 1)] = "";
    size_t n = 0;
    pvx_err e = PVX_OK;
    for (size_t i = 0; i < c->cameras.n && e == PVX_OK; i++) {
        const char *name = c->cameras.item[i].key;
        if (rec_rig_find(out, name) < 0)
            e = pvx_fail(d, PVX_ENOENT, "%s: cameras.%s: no camera of this name in %s", c->name,
                         name, path);
        n += (size_t)snprintf(list + n, sizeof list - n, "%s%s", i > 0 ? "," : "", name);
    }
    PVX_THEN(e, rec_rig_select(out, list, d));
    if (e != PVX_OK)
        rec_rig_fini(out);
    return e;
}

pvx_err dmn_config_sees(const struct rec_rig *rig, const char *path, struct pvx_diag *d)
{
    char text[PVX_DIAG_MAX];
    enum rec_blind blind = rec_rig_blind(rig, text, sizeof text);
    if (blind == REC_BLIND_ALL)
        return pvx_fail(d, PVX_EINVAL, "%s: %s", path, text);
    if (blind == REC_BLIND_SOME)
        LOG_W(RECON, "%s: %s", path, text);
    return PVX_OK;
}

bool dmn_config_simulated(const struct dmn_config *c)
{
    for (size_t i = 0; i < c->cameras.n; i++)
        if (strncmp(c->cameras.item[i].value, "sim:", 4) == 0)
            return true;
    return false;
}

enum cap_pixfmt dmn_config_pixfmt(const struct dmn_config *c)
{
    return (enum cap_pixfmt)c->pixel_format;
}

int dmn_config_channels(const struct dmn_config *c)
{
    if (c->channels != 0)
        return c->channels == 1 ? 1 : 3;
    enum cap_pixfmt f = dmn_config_pixfmt(c);
    return f == CAP_FMT_NONE ? 3 : cap_pixfmt_channels(f);
}

bool dmn_choose_mosaic(int bayer, const char *solver, int channels, enum cap_mosaic *out)
{
    bool can = rec_solver_is_default(solver) && channels == 3;
    *out = can && bayer != 2 ? CAP_MOSAIC_RAYS : CAP_MOSAIC_DEMOSAIC;
    return can || bayer != 1;
}

pvx_err dmn_config_mosaic(const struct dmn_config *c, enum cap_mosaic *out, struct pvx_diag *d)
{
    const char *const *solvers = rec_solver_names();
    if (dmn_choose_mosaic(c->bayer, solvers[c->solver], dmn_config_channels(c), out))
        return PVX_OK;
    return pvx_fail(d, PVX_EINVAL,
                    "%s: bayer: rays needs solver.name: %s and three channels; say auto or "
                    "demosaic",
                    c->name, solvers[0]);
}

pvx_err dmn_config_bars(const struct dmn_config *c, struct pvx_diag *d)
{
    const char *const *solvers = rec_solver_names();
    if (!c->error_bars || rec_solver_is_default(solvers[c->solver]))
        return PVX_OK;
    return pvx_fail(d, PVX_EINVAL,
                    "%s: model.error_bars: solver.name: %s cannot make them; say %s, or "
                    "error_bars: false",
                    c->name, solvers[c->solver], solvers[0]);
}

const char *dmn_config_card_why_not(const struct dmn_config *c)
{
    struct rec_frame_params p;
    dmn_config_frame(c, &p);
    return rec_frame_card_why_not(&p);
}

pvx_err dmn_config_compute(const struct dmn_config *c, struct pvx_diag *d)
{
    char what[PATH_MAX + 16];
    snprintf(what, sizeof what, "%s: compute", c->name);
    return dmn_compute_allowed(what, c->compute, dmn_config_card_why_not(c), d);
}

void dmn_config_frame(const struct dmn_config *c, struct rec_frame_params *out)
{
    static const enum rec_stop stops[] = {REC_STOP_AUTO, REC_STOP_LCURVE, REC_STOP_DISCREPANCY,
                                          REC_STOP_ITERATIONS};
    *out = rec_frame_defaults;
    out->nch = dmn_config_channels(c);
    out->photo.black = (float)c->black;
    out->photo.threshold = (float)c->threshold;
    out->photo.floor = (float)c->floor;
    out->photo.auto_k = (float)c->auto_k;
    out->photo.margin = (int32_t)c->margin;
    out->photo.despeckle = c->despeckle;
    out->photo.saturation = c->saturation == 0 ? REC_PHOTO_UNSATURATED : (float)c->saturation;
    out->hull.min_views = (uint32_t)c->min_views;
    out->hull.keep_partial = c->keep_partial;
    out->absorption = c->absorption;
    out->at_least = c->saturated == 1;
    out->trust_all = c->trust == 1;
    out->temporal = c->temporal == 1;
    out->again = c->error_bars;
    out->selfcal = (enum rec_selfcal_mode)c->selfcal; /* in the order of the words */
    out->hold = c->lossless ? 0 : (uint32_t)fmin(fmax(0.5 * c->fps, 3), 30);
    out->solve.solver = rec_solver_names()[c->solver]; /* the table lists them in this order */
    out->solve.stop = stops[c->stop];
    out->solve.iterations = (uint32_t)c->iterations;
    out->solve.lambda = (float)c->lambda;
}

int64_t dmn_config_deadline(const struct dmn_config *c)
{
    if (c->deadline_ms >= 0)
        return (int64_t)(c->deadline_ms * (double)PVX_NS_PER_MS);
    return c->lossless ? 0 : (int64_t)(1.5 / c->fps * (double)PVX_NS_PER_S);
}

int dmn_config_warm(const struct dmn_config *c)
{
    return c->warm_start == 1 || (c->warm_start == 0 && !c->lossless);
}
