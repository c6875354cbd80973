#include "daemon/config/triggers.h"

#include <ctype.h>
#include <math.h>
#include <string.h>
#include <time.h>

#include "base/clock.h"

#define SECONDS_MAX 3600.0
#define BYTES_MAX   1e15
#define TIME_MAX    (INT64_MAX / PVX_NS_PER_S)
#define LEVEL_MAX   1e12

const char *const dmn_when_names[DMN_N_WHEN] = {"order",  "at",     "line",    "light",
                                                "height", "change", "appears", "vanishes"};
/* Light: emission per metre, integrated over the box. */
const char *const dmn_when_units[DMN_N_WHEN] = {"", "", "", "m2", "m", "%", "voxels", "voxels"};

/* "8GB", "500 MB", or a number of bytes. */
static pvx_err read_bytes(const pvx_yaml *y, int node, const char *key, double *out,
                          struct pvx_diag *d)
{
    static const struct {
        const char *unit;
        double bytes;
    } units[] = {{"GB", 1e9}, {"MB", 1e6}, {"kB", 1e3}, {"", 1}};
    const char *text = pvx_yaml_text(y, node);
    size_t n = strlen(text);
    while (n > 0 && isalpha((unsigned char)text[n - 1]))
        n--;
    const char *unit = text + n;
    while (n > 0 && text[n - 1] == ' ')
        n--;
    char number[32];
    for (size_t i = 0; i < sizeof units / sizeof units[0]; i++)
        if (strcmp(unit, units[i].unit) == 0 && n > 0 && n < sizeof number) {
            snprintf(number, sizeof number, "%.*s", (int)n, text);
            double n_units;
            if (pvx_parse_double(number, 0, BYTES_MAX, &n_units) != PVX_OK ||
                n_units * units[i].bytes < 1 || n_units * units[i].bytes > BYTES_MAX)
                break;
            *out = n_units * units[i].bytes;
            return PVX_OK;
        }
    return pvx_yaml_fail(y, node, key, PVX_EINVAL, d,
                         "'%.40s' is not a size as 8GB, 500MB or a number of bytes", text);
}

/* The node of a word in the mapping, 0 = none, and its path for messages. */
static int node_of(const pvx_yaml *y, int map, const char *key, const char *word, char path[128])
{
    snprintf(path, 128, "%.90s.%s", key, word);
    return pvx_yaml_get(y, map, word);
}

/* A time in seconds, if the mapping has it. */
static pvx_err read_seconds(const pvx_yaml *y, int map, const char *key, const char *word,
                            double *out, struct pvx_diag *d)
{
    char path[128];
    int node = node_of(y, map, key, word, path);
    return node != 0 ? pvx_yaml_double(y, node, path, 0, SECONDS_MAX, out, d) : PVX_OK;
}

static pvx_err read_level(const pvx_yaml *y, int map, const char *key, const char *word,
                          double *out, struct pvx_diag *d)
{
    char path[128];
    int node = node_of(y, map, key, word, path);
    return node != 0 ? pvx_yaml_double(y, node, path, -LEVEL_MAX, LEVEL_MAX, out, d) : PVX_OK;
}

pvx_err dmn_ring_read(const pvx_yaml *y, int node, const char *key, struct dmn_ring *out,
                      struct pvx_diag *d)
{
    struct dmn_ring r = {.pre = 2, .post = 3};
    char path[128];
    if (pvx_yaml_kind(y, node) != PVX_YAML_MAP)
        return pvx_yaml_fail(y, node, key, PVX_EFORMAT, d,
                             "should be a mapping as { seconds: 5, memory: 8GB }");
    PVX_TRY(pvx_yaml_known(y, node, key, "seconds memory pre post", d));
    PVX_TRY(read_seconds(y, node, key, "seconds", &r.seconds, d));
    PVX_TRY(read_seconds(y, node, key, "pre", &r.pre, d));
    PVX_TRY(read_seconds(y, node, key, "post", &r.post, d));
    int memory = pvx_yaml_get(y, node, "memory");
    snprintf(path, sizeof path, "%.90s.memory", key);
    if (memory != 0)
        PVX_TRY(read_bytes(y, memory, path, &r.memory, d));
    if (pvx_yaml_length(y, node) > 0 && (r.seconds <= 0 || r.memory <= 0))
        return pvx_yaml_fail(y, node, key, PVX_EINVAL, d,
                             "needs seconds and memory, as { seconds: 5, memory: 8GB }");
    *out = r;
    return PVX_OK;
}

/* ---- triggers ---- */

static pvx_err read_name(const pvx_yaml *y, int map, const char *key, struct dmn_trigger *t,
                         struct pvx_diag *d)
{
    int node = pvx_yaml_get(y, map, "name");
    const char *name = pvx_yaml_text(y, node);
    if (node == 0)
        return pvx_yaml_fail(y, map, key, PVX_EINVAL, d, "has no name: add name: ignition");
    bool good = name[0] != '\0' && strlen(name) < sizeof t->name;
    for (const char *p = name; *p != '\0'; p++)
        good = good && (isalnum((unsigned char)*p) || *p == '_' || *p == '-');
    if (!good)
        return pvx_yaml_fail(y, node, key, PVX_EINVAL, d,
                             "'%.40s': a name is made of 1 to %d letters, digits, _ and -", name,
                             DMN_TRIGGER_NAME_MAX - 1);
    snprintf(t->name, sizeof t->name, "%s", name);
    return PVX_OK;
}

static pvx_err read_at(const pvx_yaml *y, int node, const char *key, int64_t *out,
                       struct pvx_diag *d)
{
    const char *text = pvx_yaml_text(y, node);
    struct tm tm = {0};
    const char *end = strptime(text, "%Y-%m-%dT%H:%M:%SZ", &tm);
    time_t t = end != NULL && *end == '\0' ? timegm(&tm) : -1;
    if (t < 0 || t > TIME_MAX)
        return pvx_yaml_fail(y, node, key, PVX_EINVAL, d,
                             "'%.40s' is not a time in UTC as 2026-12-01T12:00:00Z", text);
    *out = (int64_t)t * PVX_NS_PER_S;
    return PVX_OK;
}

static pvx_err read_when(const pvx_yaml *y, int map, const char *key, struct dmn_trigger *t,
                         struct pvx_diag *d)
{
    int when = pvx_yaml_get(y, map, "when"), at = pvx_yaml_get(y, map, "at");
    if (at != 0 && when != 0)
        return pvx_yaml_fail(y, when, key, PVX_EINVAL, d, "has when and at: leave one out");
    t->when = at != 0 ? DMN_WHEN_AT : DMN_WHEN_ORDER;
    if (at != 0)
        return read_at(y, at, key, &t->at_ns, d);
    if (when == 0)
        return PVX_OK;
    for (int i = 0; i < DMN_N_WHEN; i++)
        if (i != DMN_WHEN_AT && strcmp(pvx_yaml_text(y, when), dmn_when_names[i]) == 0) {
            t->when = (enum dmn_when)i;
            return PVX_OK;
        }
    return pvx_yaml_fail(y, when, key, PVX_EINVAL, d,
                         "when: '%.40s' is not one of order, line, light, height, change, "
                         "appears, vanishes",
                         pvx_yaml_text(y, when));
}

static pvx_err read_box(const pvx_yaml *y, int map, const char *key, struct dmn_trigger *t,
                        struct pvx_diag *d)
{
    int node = pvx_yaml_get(y, map, "box");
    if (node == 0)
        return PVX_OK;
    PVX_TRY(pvx_yaml_doubles(y, node, key, 6, 6, t->box, d));
    for (int a = 0; a < 3; a++)
        if (!(t->box[a] < t->box[a + 3]))
            return pvx_yaml_fail(y, node, key, PVX_EINVAL, d,
                                 "box: should be x y z of the lower, then of the upper corner, in "
                                 "metres");
    t->boxed = true;
    return PVX_OK;
}

/* The line that the condition has, and no other may have. */
static pvx_err read_line(const pvx_yaml *y, int map, const char *key, struct dmn_trigger *t,
                         struct pvx_diag *d)
{
    int camera = pvx_yaml_get(y, map, "camera"), line = pvx_yaml_get(y, map, "line");
    if (t->when != DMN_WHEN_LINE)
        return camera == 0 && line == 0
                   ? PVX_OK
                   : pvx_yaml_fail(y, camera != 0 ? camera : line, key, PVX_EINVAL, d,
                                   "%s needs when: line", camera != 0 ? "camera" : "line");
    if (camera == 0 || line == 0)
        return pvx_yaml_fail(y, map, key, PVX_EINVAL, d,
                             "when: line needs %s: add camera: NAME and line: N, its bit of "
                             "LineStatusAll",
                             camera == 0 ? "a camera" : "a line");
    const char *name = pvx_yaml_text(y, camera);
    bool good = name[0] != '\0' && strlen(name) < sizeof t->camera;
    for (const char *p = name; *p != '\0'; p++)
        good = good && (isalnum((unsigned char)*p) || strchr("._-", *p) != NULL);
    if (!good)
        return pvx_yaml_fail(y, camera, key, PVX_EINVAL, d, "camera: '%.40s' is not a name", name);
    snprintf(t->camera, sizeof t->camera, "%s", name);
    char path[128];
    snprintf(path, sizeof path, "%.90s.line", key);
    return pvx_yaml_int(y, line, path, 0, 63, &t->line, d);
}

/* Levels that the condition has, and no others. */
static pvx_err read_levels(const pvx_yaml *y, int map, const char *key, struct dmn_trigger *t,
                           struct pvx_diag *d)
{
    bool condition = t->when >= DMN_WHEN_LIGHT, line = t->when == DMN_WHEN_LINE,
         counts = t->when == DMN_WHEN_APPEARS || t->when == DMN_WHEN_VANISHES;
    int above = pvx_yaml_get(y, map, "above");
    static const char *const levels[] = {"above", "release", "box", "hold_off", "agree"};
    for (size_t i = 0; i < sizeof levels / sizeof levels[0] && !condition; i++)
        if (pvx_yaml_get(y, map, levels[i]) != 0 && !(line && strcmp(levels[i], "hold_off") == 0))
            return pvx_yaml_fail(y, pvx_yaml_get(y, map, levels[i]), key, PVX_EINVAL, d,
                                 line ? "when: line has no %s: leave it out"
                                      : "%s needs a condition: add when: light",
                                 levels[i]);
    if (condition && !counts && above == 0)
        return pvx_yaml_fail(y, map, key, PVX_EINVAL, d,
                             "when: %s needs a level: add above (`pyrovox advise` proposes one)",
                             dmn_when_names[t->when]);
    PVX_TRY(read_level(y, map, key, "above", &t->above, d));
    t->release =
        t->when == DMN_WHEN_LIGHT || t->when == DMN_WHEN_CHANGE ? 0.8 * t->above : t->above;
    PVX_TRY(read_level(y, map, key, "release", &t->release, d));
    bool falls = t->when == DMN_WHEN_VANISHES;
    if (falls ? t->release < t->above : t->release > t->above)
        return pvx_yaml_fail(y, pvx_yaml_get(y, map, "release"), key, PVX_EINVAL, d,
                             "release: %g is %s %g, at which it fires: %s it", t->release,
                             falls ? "below" : "above", t->above, falls ? "raise" : "lower");
    return read_box(y, map, key, t, d);
}

static pvx_err read_trigger(const pvx_yaml *y, int map, const char *key, struct dmn_trigger *out,
                            struct pvx_diag *d)
{
    struct dmn_trigger *t = out;
    char path[128];
    *t = (struct dmn_trigger){.pre = 2, .post = 3, .hold_off = 1};
    if (pvx_yaml_kind(y, map) != PVX_YAML_MAP)
        return pvx_yaml_fail(y, map, key, PVX_EFORMAT, d,
                             "should be a mapping as { name: ignition, when: appears }");
    PVX_TRY(pvx_yaml_known(
        y, map, key, "name when at camera line above release box pre post hold_off agree", d));
    PVX_TRY(read_name(y, map, key, t, d));
    PVX_TRY(read_when(y, map, key, t, d));
    PVX_TRY(read_line(y, map, key, t, d));
    PVX_TRY(read_levels(y, map, key, t, d));
    t->agree = t->when == DMN_WHEN_CHANGE ? 1 : 2;
    PVX_TRY(read_seconds(y, map, key, "pre", &t->pre, d));
    PVX_TRY(read_seconds(y, map, key, "post", &t->post, d));
    PVX_TRY(read_seconds(y, map, key, "hold_off", &t->hold_off, d));
    int agree = pvx_yaml_get(y, map, "agree");
    snprintf(path, sizeof path, "%.90s.agree", key);
    return agree != 0 ? pvx_yaml_int(y, agree, path, 1, 10000, &t->agree, d) : PVX_OK;
}

pvx_err dmn_triggers_read(const pvx_yaml *y, int node, const char *key, struct dmn_triggers *out,
                          struct pvx_diag *d)
{
    struct dmn_triggers all = {0};
    if (pvx_yaml_kind(y, node) != PVX_YAML_SEQ)
        return pvx_yaml_fail(y, node, key, PVX_EFORMAT, d,
                             "should be a list, as - { name: ignition, when: appears }");
    if (pvx_yaml_length(y, node) > DMN_TRIGGERS_MAX)
        return pvx_yaml_fail(y, node, key, PVX_EINVAL, d, "more than %d", DMN_TRIGGERS_MAX);
    for (size_t i = 0; i < pvx_yaml_length(y, node); i++) {
        char path[64];
        int item = pvx_yaml_item(y, node, i);
        snprintf(path, sizeof path, "%.40s[%zu]", key, i);
        PVX_TRY(read_trigger(y, item, path, &all.item[i], d));
        for (size_t k = 0; k < i; k++)
            if (strcmp(all.item[k].name, all.item[i].name) == 0)
                return pvx_yaml_fail(y, item, path, PVX_EINVAL, d, "'%s' is the name of another",
                                     all.item[i].name);
        all.n = i + 1;
    }
    *out = all;
    return PVX_OK;
}

/* ---- printing ---- */

void dmn_ring_print(FILE *f, const struct dmn_ring *r)
{
    if (r->seconds <= 0)
        fputs("{}", f);
    else
        fprintf(f, "{ seconds: %.17g, memory: %.17g, pre: %.17g, post: %.17g }", r->seconds,
                r->memory, r->pre, r->post);
}

void dmn_triggers_print(FILE *f, const struct dmn_triggers *t)
{
    fputc('[', f);
    for (size_t i = 0; i < t->n; i++) {
        const struct dmn_trigger *k = &t->item[i];
        fprintf(f, "%s{ name: \"%s\", ", i > 0 ? ", " : "", k->name);
        if (k->when == DMN_WHEN_AT) {
            time_t s = (time_t)(k->at_ns / PVX_NS_PER_S);
            struct tm tm;
            char text[40] = "";
            if (gmtime_r(&s, &tm) != NULL)
                strftime(text, sizeof text, "%Y-%m-%dT%H:%M:%SZ", &tm);
            fprintf(f, "at: \"%s\", ", text);
        } else {
            fprintf(f, "when: %s, ", dmn_when_names[k->when]);
        }
        if (k->when == DMN_WHEN_LINE)
            fprintf(f, "camera: \"%s\", line: %lld, hold_off: %.17g, ", k->camera,
                    (long long)k->line, k->hold_off);
        if (k->when >= DMN_WHEN_LIGHT)
            fprintf(f, "above: %.17g, release: %.17g, hold_off: %.17g, agree: %lld, ", k->above,
                    k->release, k->hold_off, (long long)k->agree);
        if (k->boxed)
            fprintf(f, "box: [%.17g, %.17g, %.17g, %.17g, %.17g, %.17g], ", k->box[0], k->box[1],
                    k->box[2], k->box[3], k->box[4], k->box[5]);
        fprintf(f, "pre: %.17g, post: %.17g }", k->pre, k->post);
    }
    fputc(']', f);
}
