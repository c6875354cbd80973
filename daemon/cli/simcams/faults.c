#include "daemon/cli/simcams/faults.h"

#include <stdio.h>
#include <string.h>

#include "base/yaml.h"

#define ROW(faults_number, name, n, min, max, member) \
    [faults_number] = {name, n, min, max, offsetof(struct cap_gvcam_fault, member)},
static const struct kind {
    const char *name;
    int n; /* numbers; 0: on or off */
    double min, max;
    size_t offset;
} kinds[SIMCAMS_N_KINDS] = {SIMCAMS_FAULTS(ROW)};

struct simcams_state simcams_healthy(void)
{
    return (struct simcams_state){.fault.optics = cap_optics_none, .alive = true};
}

/* Cameras [*lo,*hi) that `name` means. */
static pvx_err faults_find(const struct rec_rig *rig, const char *name, size_t *lo, size_t *hi,
                           struct pvx_diag *d)
{
    *lo = 0;
    *hi = rig->n_cameras;
    if (strcmp(name, "all") == 0)
        return PVX_OK;
    int c = rec_rig_find(rig, name);
    if (c < 0)
        return pvx_fail(d, PVX_ENOENT, "no camera '%s'; there are %s to %s", name,
                        rig->cameras[0].name, rig->cameras[rig->n_cameras - 1].name);
    *lo = (size_t)c;
    *hi = *lo + 1;
    return PVX_OK;
}

static pvx_err on_or_off(const char *what, const char *camera, const char *text, bool *on,
                         struct pvx_diag *d)
{
    *on = strcmp(text, "on") == 0;
    if (!*on && strcmp(text, "off") != 0)
        return pvx_fail(d, PVX_EINVAL, "%s %s: '%s' should be on or off", what, camera, text);
    return PVX_OK;
}

/* "64" or "64:-2" */
static pvx_err faults_numbers(const struct kind *k, const char *camera, const char *text,
                              double out[2], struct pvx_diag *d)
{
    char copy[64];
    snprintf(copy, sizeof copy, "%s", text);
    char *second = k->n == 2 ? strchr(copy, ':') : NULL;
    if (second != NULL)
        *second++ = '\0';
    if (strlen(text) >= sizeof copy || (k->n == 2 && second == NULL) ||
        pvx_parse_double(copy, k->min, k->max, &out[0]) != PVX_OK ||
        (second != NULL && pvx_parse_double(second, k->min, k->max, &out[1]) != PVX_OK))
        return pvx_fail(d, PVX_EINVAL, "%s %s: '%s' should be %s from %g to %g", k->name, camera,
                        text, k->n == 2 ? "two numbers X:Y" : "a number", k->min, k->max);
    return PVX_OK;
}

static pvx_err faults_set(const struct rec_rig *rig, enum simcams_fault_kind kind,
                          const char *camera, const char *value, struct simcams_state *state,
                          struct pvx_diag *d)
{
    const struct kind *k = &kinds[kind];
    size_t lo, hi;
    bool on = false;
    double v[2];
    PVX_TRY(faults_find(rig, camera, &lo, &hi, d));
    if (k->n == 0)
        PVX_TRY(on_or_off(k->name, camera, value, &on, d));
    else
        PVX_TRY(faults_numbers(k, camera, value, v, d));
    for (size_t c = lo; c < hi; c++) {
        char *at = (char *)&state[c].fault + k->offset;
        memcpy(at, k->n == 0 ? (const void *)&on : v,
               k->n == 0 ? sizeof on : (size_t)k->n * sizeof *v);
    }
    return PVX_OK;
}

/* ---- lines ------------------------------------------------------------------------------------ */

struct words {
    int n;
    char w[3][64];
};

static pvx_err faults_number(const char *what, const char *text, double min, double max,
                             double *out, struct pvx_diag *d)
{
    if (pvx_parse_double(text, min, max, out) != PVX_OK)
        return pvx_fail(d, PVX_EINVAL, "%s: '%s' should be a number from %g to %g", what, text, min,
                        max);
    return PVX_OK;
}

static pvx_err faults_set_alive(const struct rec_rig *rig, const char *camera, bool alive,
                                struct simcams_state *state, struct pvx_diag *d)
{
    size_t lo, hi;
    PVX_TRY(faults_find(rig, camera, &lo, &hi, d));
    for (size_t c = lo; c < hi; c++)
        state[c].alive = alive;
    return PVX_OK;
}

#define ORDER(faults_number, name, ...) {name, faults_number, __VA_ARGS__},
static const struct order_def {
    const char *name;
    int what, n_min, n_max;
    bool camera;
    double min, max; /* of the number after that */
} orders[] = {SIMCAMS_ORDERS(ORDER)};

static pvx_err give_order(const struct rec_rig *rig, const struct order_def *o,
                          const struct words *w, struct simcams_order *out, struct pvx_diag *d)
{
    int k = 1;
    struct simcams_order r = {.hi = rig->n_cameras};
    if (o->camera)
        PVX_TRY(faults_find(rig, w->w[k++], &r.lo, &r.hi, d));
    if (k < w->n)
        PVX_TRY(faults_number(o->name, w->w[k++], o->min, o->max, &r.arg, d));
    if (k < w->n)
        PVX_TRY(faults_number(o->name, w->w[k++], 1, 1 << 20, &r.arg2, d));
    *out = r;
    memcpy(&out->what, &o->what, sizeof out->what);
    return PVX_OK;
}

/* Fail with a message that lists the lines. */
static pvx_err faults_unknown(const char *line, struct pvx_diag *d)
{
    static const char *const after[] = {" CAMERA on|off", " CAMERA NUMBER", " CAMERA X:Y"};
    char words[1024] = "";
    size_t at = 0;
    for (int n = 0; n < 3; n++) {
        const char *between = "";
        for (size_t k = 0; k < SIMCAMS_N_KINDS; k++)
            if (kinds[k].n == n && at < sizeof words) {
                at +=
                    (size_t)snprintf(words + at, sizeof words - at, "%s%s", between, kinds[k].name);
                between = "|";
            }
        if (at < sizeof words)
            at += (size_t)snprintf(words + at, sizeof words - at, "%s, ", after[n]);
    }
    return pvx_fail(
        d, PVX_EINVAL,
        "'%.60s': should be %skill|revive CAMERA, ids CAMERA [NUMBER], reboot CAMERA [SECONDS], "
        "jump CAMERA SECONDS, trigger-mode CAMERA 0|1, line HZ, pulse, link MBIT_S [KIB], "
        "switch SECONDS, stats or pose NUMBER",
        line, words);
}

pvx_err simcams_control(const struct rec_rig *rig, const char *line, struct simcams_state *state,
                        struct simcams_order *order, struct pvx_diag *d)
{
    struct words w = {0};
    char extra[2] = "";
    *order = (struct simcams_order){.what = SIMCAMS_NOTHING};
    w.n = sscanf(line, "%63s %63s %63s %1s", w.w[0], w.w[1], w.w[2], extra);
    if (w.n <= 0)
        return PVX_OK;
    for (size_t k = 0; k < SIMCAMS_N_KINDS; k++)
        if (strcmp(w.w[0], kinds[k].name) == 0 && w.n == 3)
            return faults_set(rig, (enum simcams_fault_kind)k, w.w[1], w.w[2], state, d);
    if (w.n == 2 && (strcmp(w.w[0], "kill") == 0 || strcmp(w.w[0], "revive") == 0))
        return faults_set_alive(rig, w.w[1], strcmp(w.w[0], "revive") == 0, state, d);
    for (size_t k = 0; k < sizeof orders / sizeof orders[0]; k++)
        if (strcmp(w.w[0], orders[k].name) == 0 && w.n >= orders[k].n_min && w.n <= orders[k].n_max)
            return give_order(rig, &orders[k], &w, order, d);
    return faults_unknown(line, d);
}

/* ---- timetable -------------------------------------------------------------------------------- */

static pvx_err add_event(struct simcams_plan *plan, double at_s, const char *line,
                         struct pvx_diag *d)
{
    if (plan->n == SIMCAMS_MAX_EVENTS)
        return pvx_fail(d, PVX_ERANGE, "more than %d timed faults", SIMCAMS_MAX_EVENTS);
    struct simcams_event e = {.at_s = at_s};
    snprintf(e.line, sizeof e.line, "%s", line);
    size_t k = plan->n++;
    for (; k > 0 && plan->event[k - 1].at_s > e.at_s; k--)
        plan->event[k] = plan->event[k - 1];
    plan->event[k] = e;
    return PVX_OK;
}

pvx_err simcams_at_line(const struct rec_rig *rig, const char *text, struct simcams_plan *plan,
                        struct pvx_diag *d)
{
    char copy[32 + SIMCAMS_LINE_MAX];
    snprintf(copy, sizeof copy, "%s", text);
    char *line = strchr(copy, ':');
    double at_s;
    if (line != NULL)
        *line++ = '\0';
    if (line == NULL || strlen(text) >= sizeof copy || strlen(line) >= SIMCAMS_LINE_MAX ||
        pvx_parse_double(copy, 0, 1e9, &at_s) != PVX_OK)
        return pvx_fail(d, PVX_EINVAL, "'%s' should be SECONDS:LINE; --help lists the lines", text);
    static struct simcams_state scratch[REC_MAX_CAMERAS]; /* wrong lines are refused now */
    struct simcams_order order;
    PVX_TRY(simcams_control(rig, line, scratch, &order, d));
    return add_event(plan, at_s, line, d);
}

pvx_err simcams_set_line(const struct rec_rig *rig, const char *line, struct simcams_state *state,
                         struct simcams_plan *plan, struct pvx_diag *d)
{
    struct simcams_order order;
    if (strlen(line) >= SIMCAMS_LINE_MAX)
        return pvx_fail(d, PVX_EINVAL, "'%.60s...': the line is too long", line);
    PVX_TRY(simcams_control(rig, line, state, &order, d));
    return order.what != SIMCAMS_NOTHING ? add_event(plan, 0, line, d) : PVX_OK;
}
