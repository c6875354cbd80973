#include "cli/simcams_faults.h"

#include <stdio.h>
#include <string.h>

#include "base/yaml.h"

static const struct {
    const char *name;
    double min, max;
    size_t offset;
} kinds[] = {
    [SIMCAMS_DROP] = {"drop", 0, 1, offsetof(struct cap_simgv_fault, drop)},
    [SIMCAMS_LOSS] = {"loss", 0, 1, offsetof(struct cap_simgv_fault, packet_loss)},
    [SIMCAMS_DELAY] = {"delay", 0, 10000, offsetof(struct cap_simgv_fault, delay_ms)},
    [SIMCAMS_SKEW] = {"skew", -1e12, 1e12, offsetof(struct cap_simgv_fault, skew_us)},
    [SIMCAMS_DRIFT] = {"drift", -1000, 1000, offsetof(struct cap_simgv_fault, drift_ppm)},
};
#define N_KINDS (sizeof kinds / sizeof kinds[0])

/* Cameras [*lo,*hi) that `name` means. */
static pvx_err find(const struct rec_rig *rig, const char *name, size_t *lo, size_t *hi,
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

static pvx_err set(const struct rec_rig *rig, enum simcams_fault_kind kind, const char *camera,
                   const char *value, struct simcams_state *state, struct pvx_diag *d)
{
    size_t lo, hi;
    double v;
    PVX_TRY(find(rig, camera, &lo, &hi, d));
    if (pvx_parse_double(value, kinds[kind].min, kinds[kind].max, &v) != PVX_OK)
        return pvx_fail(d, PVX_EINVAL, "%s %s: '%s' should be a number from %g to %g",
                        kinds[kind].name, camera, value, kinds[kind].min, kinds[kind].max);
    for (size_t c = lo; c < hi; c++)
        memcpy((char *)&state[c].fault + kinds[kind].offset, &v, sizeof v);
    return PVX_OK;
}

pvx_err simcams_fault_option(const struct rec_rig *rig, enum simcams_fault_kind kind,
                             const char *text, struct simcams_state *state, struct pvx_diag *d)
{
    char copy[1024];
    if (strlen(text) >= sizeof copy)
        return pvx_fail(d, PVX_EINVAL, "%s: too long", kinds[kind].name);
    snprintf(copy, sizeof copy, "%s", text);
    char *rest = copy, *item;
    while ((item = strsep(&rest, ",")) != NULL) {
        char *value = strchr(item, '=');
        if (value != NULL)
            *value++ = '\0';
        PVX_TRY(
            set(rig, kind, value != NULL ? item : "all", value != NULL ? value : item, state, d));
    }
    return PVX_OK;
}

static pvx_err add_event(struct simcams_plan *plan, struct simcams_event e, struct pvx_diag *d)
{
    if (plan->n == SIMCAMS_MAX_EVENTS)
        return pvx_fail(d, PVX_ERANGE, "more than %d timed faults", SIMCAMS_MAX_EVENTS);
    size_t k = plan->n++;
    for (; k > 0 && plan->event[k - 1].at_s > e.at_s; k--)
        plan->event[k] = plan->event[k - 1];
    plan->event[k] = e;
    return PVX_OK;
}

pvx_err simcams_plan_option(const struct rec_rig *rig, bool freeze, const char *text,
                            struct simcams_plan *plan, struct pvx_diag *d)
{
    char copy[256];
    snprintf(copy, sizeof copy, "%s", text);
    char *at = strrchr(copy, '@'), *until = NULL;
    double t0, t1;
    if (at != NULL) {
        *at++ = '\0';
        until = freeze ? strchr(at, '-') : NULL;
        if (until != NULL)
            *until++ = '\0';
    }
    if (at == NULL || strlen(text) >= sizeof copy || pvx_parse_double(at, 0, 1e9, &t0) != PVX_OK ||
        (until != NULL && pvx_parse_double(until, t0, 1e9, &t1) != PVX_OK))
        return pvx_fail(d, PVX_EINVAL, "'%s' should be CAMERA@SECONDS%s", text,
                        freeze ? " or CAMERA@FROM-UNTIL" : "");
    size_t lo, hi;
    PVX_TRY(find(rig, copy, &lo, &hi, d));
    for (size_t c = lo; c < hi; c++) {
        PVX_TRY(add_event(plan, (struct simcams_event){t0, c, freeze ? EV_FREEZE : EV_KILL}, d));
        if (until != NULL)
            PVX_TRY(add_event(plan, (struct simcams_event){t1, c, EV_THAW}, d));
    }
    return PVX_OK;
}

void simcams_plan_apply(const struct simcams_event *e, struct simcams_state *state)
{
    if (e->what == EV_KILL)
        state[e->camera].alive = false;
    else
        state[e->camera].fault.freeze = e->what == EV_FREEZE;
}

pvx_err simcams_control(const struct rec_rig *rig, const char *line, struct simcams_state *state,
                        struct pvx_diag *d)
{
    char word[3][64] = {"", "", ""}, extra[2] = "";
    int n = sscanf(line, "%63s %63s %63s %1s", word[0], word[1], word[2], extra);
    if (n <= 0)
        return PVX_OK;
    for (size_t k = 0; k < N_KINDS; k++)
        if (strcmp(word[0], kinds[k].name) == 0 && n == 3)
            return set(rig, (enum simcams_fault_kind)k, word[1], word[2], state, d);
    bool freeze = strcmp(word[0], "freeze") == 0, kill = strcmp(word[0], "kill") == 0;
    bool on = strcmp(word[2], "on") == 0;
    if (!(freeze && n == 3 && (on || strcmp(word[2], "off") == 0)) &&
        !((kill || strcmp(word[0], "revive") == 0) && n == 2))
        return pvx_fail(d, PVX_EINVAL,
                        "'%s': should be drop|loss|delay|skew|drift CAMERA NUMBER, freeze CAMERA "
                        "on|off, kill CAMERA or revive CAMERA",
                        line);
    size_t lo, hi;
    PVX_TRY(find(rig, word[1], &lo, &hi, d));
    for (size_t c = lo; c < hi; c++) {
        if (freeze)
            state[c].fault.freeze = on;
        else
            state[c].alive = !kill;
    }
    return PVX_OK;
}
