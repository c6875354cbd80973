#include "capture/gev/trigger.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "base/log.h"
#include "capture/gev/err.h"
#include "capture/gev/feature.h"

/* A camera whose rate cannot be set gives frames at its own rate. */
static pvx_err set_frame_rate(const struct cap_source_config *c, ArvCamera *cam, struct pvx_diag *d)
{
    static const char *const names[] = {"AcquisitionFrameRate", "AcquisitionFrameRateAbs", "FPS"};
    GError *err = NULL;
    bool can = false;
    if (c->fps <= 0)
        return PVX_OK;
    arv_camera_set_frame_rate(cam, c->fps, NULL);
    double min = 0, max = 0, got = arv_camera_get_frame_rate(cam, &err);
    if (err != NULL && aravis_means_gone(err))
        return aravis_fail(c, PVX_EIO, "frame rate", &err, d);
    if (err == NULL && fabs(got - c->fps) <= 0.01 * c->fps)
        return PVX_OK;
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++)
        can = can || aravis_can_set(cam, names[i]);
    if (err == NULL && can) {
        arv_camera_get_frame_rate_bounds(cam, &min, &max, NULL);
        return aravis_refused(c, d, "frame rate", c->fps, got, min, max);
    }
    char is[32] = "";
    if (err == NULL)
        snprintf(is, sizeof is, " of %g Hz", got);
    CAP_LOG(PVX_LOG_WARN, c, "aravis", names[0],
            "the camera has no %s that can be set%s: its frames come at its own rate%s, whatever "
            "fps: %g says",
            names[0], aravis_near(cam, names[0]).text, is, c->fps);
    g_clear_error(&err);
    return PVX_OK;
}

static bool offers(const char *const *list, guint n, const char *what)
{
    for (guint i = 0; i < n; i++)
        if (strcmp(list[i], what) == 0)
            return true;
    return false;
}

/* The text for a camera that has no such trigger names those that it has. */
static pvx_err no_such_trigger(const struct cap_source_config *c, const char *want,
                               const char *const *list, guint n, struct pvx_diag *d)
{
    char have[256] = "none";
    size_t at = 0;
    for (guint i = 0; i < n && at < sizeof have; i++)
        at += (size_t)snprintf(have + at, sizeof have - at, "%s%s", i > 0 ? ", " : "", list[i]);
    return CAP_FAIL(c, "aravis", d, PVX_EINVAL,
                    "cannot be triggered by %s: the trigger sources that it offers are: %s", want,
                    have);
}

/* Set the source, and check that the camera waits for it. */
static pvx_err trigger_wait_for(const struct cap_source_config *c, ArvCamera *cam,
                                const char *source, struct pvx_diag *d)
{
    GError *err = NULL;
    arv_camera_set_trigger(cam, source, &err);
    if (err != NULL)
        return aravis_fail(c, PVX_EINVAL, source, &err, d);
    const char *got = arv_camera_get_trigger_source(cam, &err);
    bool same = err == NULL && got != NULL && strcmp(got, source) == 0;
    char now[64];
    snprintf(now, sizeof now, "%s", got != NULL ? got : "nothing");
    const char *mode = arv_camera_get_string(cam, "TriggerMode", NULL);
    g_clear_error(&err);
    if (same && mode != NULL && strcmp(mode, "On") == 0)
        return PVX_OK;
    return CAP_FAIL(c, "aravis", d, PVX_EINVAL,
                    "trigger source %s refused: the camera has %s, trigger mode %s", source, now,
                    mode != NULL ? mode : "?");
}

/* Make the line an input.  Cameras without the choice have fixed lines. */
static void make_input(ArvCamera *cam, const char *line)
{
    if (!arv_camera_is_feature_available(cam, "LineMode", NULL) ||
        !arv_camera_is_enumeration_entry_available(cam, "LineSelector", line, NULL))
        return;
    arv_camera_set_string(cam, "LineSelector", line, NULL);
    arv_camera_set_string(cam, "LineMode", "Input", NULL);
}

/* Keys are often write-only; where they can be read, they must be what was written. */
static pvx_err set_key(const struct cap_source_config *c, ArvCamera *cam, const char *feature,
                       uint32_t value, struct pvx_diag *d)
{
    GError *err = NULL;
    if (!aravis_has(cam, feature))
        return aravis_lacks(c, cam, "cannot be triggered by action commands", feature, d);
    arv_camera_set_integer(cam, feature, value, &err);
    if (err != NULL)
        return aravis_fail(c, PVX_EINVAL, feature, &err, d);
    if (arv_device_get_feature_access_mode(arv_camera_get_device(cam), feature) ==
        ARV_GC_ACCESS_MODE_WO)
        return PVX_OK;
    gint64 min = 0, max = 0, got = arv_camera_get_integer(cam, feature, &err);
    if (err != NULL)
        return aravis_fail(c, PVX_EIO, feature, &err, d);
    if (got == (gint64)value)
        return PVX_OK;
    arv_camera_get_integer_bounds(cam, feature, &min, &max, NULL);
    return aravis_refused(c, d, feature, value, (double)got, (double)min, (double)max);
}

/* Cameras number their actions from 0 or from 1.  The trigger source and the selector of the keys use the same
 * number. */
static pvx_err set_action(const struct cap_source_config *c, ArvCamera *cam,
                          const char *const *list, guint n, struct pvx_diag *d)
{
    gint64 min = 0, max = 1;
    char source[16];
    int k = offers(list, n, "Action1") ? 1 : 0;
    bool selector = arv_camera_is_feature_available(cam, "ActionSelector", NULL);
    if (selector)
        arv_camera_get_integer_bounds(cam, "ActionSelector", &min, &max, NULL);
    if (k == 1 && max < 1 && offers(list, n, "Action0"))
        k = 0;
    snprintf(source, sizeof source, "Action%d", k);
    if (!offers(list, n, source))
        return no_such_trigger(c, "action commands", list, n, d);
    if (selector)
        PVX_TRY(set_key(c, cam, "ActionSelector",
                        (uint32_t)(k < min   ? min
                                   : k > max ? max
                                             : k),
                        d));
    PVX_TRY(set_key(c, cam, "ActionDeviceKey", c->action.device_key, d));
    PVX_TRY(set_key(c, cam, "ActionGroupKey", c->action.group_key, d));
    PVX_TRY(set_key(c, cam, "ActionGroupMask", c->action.group_mask, d));
    return trigger_wait_for(c, cam, source, d);
}

/* Every trigger that the camera has is off, and that of frames stays selected. */
static pvx_err triggers_off(const struct cap_source_config *c, ArvCamera *cam, struct pvx_diag *d)
{
    guint n = 0;
    bool some = false;
    pvx_err e = PVX_OK;
    const char **list = aravis_has(cam, "TriggerSelector")
                            ? arv_camera_dup_available_triggers(cam, &n, NULL)
                            : NULL;
    for (guint i = 0; i < n && e == PVX_OK; i++) {
        arv_camera_set_string(cam, "TriggerSelector", list[i], NULL);
        some = some || aravis_has(cam, "TriggerMode");
        if (aravis_has(cam, "TriggerMode")) /* not every trigger has one */
            e = aravis_choose(c, cam, "TriggerMode", "Off", d);
    }
    g_free(list);
    return e != PVX_OK || some ? e : aravis_choose(c, cam, "TriggerMode", "Off", d);
}

pvx_err aravis_set_trigger(const struct cap_source_config *c, ArvCamera *cam, struct pvx_diag *d)
{
    PVX_TRY(aravis_choose(c, cam, "AcquisitionMode", "Continuous", d));
    if (c->trigger == CAP_TRIGGER_FREE_RUN) {
        PVX_TRY(triggers_off(c, cam, d));
        return set_frame_rate(c, cam, d);
    }
    static const char *const needs[] = {"TriggerMode", "TriggerSource", "TriggerSoftware"};
    for (size_t i = 0; i < (c->trigger == CAP_TRIGGER_SOFTWARE ? 3 : 2); i++)
        if (arv_device_get_feature(arv_camera_get_device(cam), needs[i]) == NULL)
            return aravis_lacks(c, cam, "cannot be triggered", needs[i], d);
    const char *line = c->trigger_line != NULL ? c->trigger_line : "Line1";
    if (aravis_has(cam, "TriggerSelector")) /* sources depend on it */
        arv_camera_set_string(cam, "TriggerSelector", "FrameStart", NULL);
    guint n = 0;
    const char **list = arv_camera_dup_available_trigger_sources(cam, &n, NULL);
    const char *const *have = list;
    pvx_err e;
    if (list == NULL)
        n = 0;
    if (c->trigger == CAP_TRIGGER_ACTION) {
        e = set_action(c, cam, have, n, d);
    } else {
        const char *source = c->trigger == CAP_TRIGGER_LINE ? line : "Software";
        if (c->trigger == CAP_TRIGGER_LINE)
            make_input(cam, line);
        e = offers(have, n, source) ? trigger_wait_for(c, cam, source, d)
                                    : no_such_trigger(c, source, have, n, d);
    }
    g_free(list);
    return e;
}

/* ---- checking the mode while the camera runs ---------------------------------------------------- */

static void read_string(ArvCamera *cam, const char *feature, char *out, size_t size)
{
    GError *err = NULL;
    const char *v = arv_camera_get_string(cam, feature, &err);
    snprintf(out, size, "%s", err == NULL && v != NULL ? v : "");
    g_clear_error(&err);
}

static void read_mode(ArvCamera *cam, struct aravis_mode *out)
{
    read_string(cam, "TriggerMode", out->mode, sizeof out->mode);
    out->source[0] = '\0';
    if (strcmp(out->mode, "On") == 0)
        read_string(cam, "TriggerSource", out->source, sizeof out->source);
}

void aravis_mode_first(ArvCamera *cam, struct aravis_mode *out)
{
    *out = (struct aravis_mode){.mode = ""};
    if (!arv_camera_is_feature_available(cam, "TriggerMode", NULL))
        return;
    if (arv_camera_is_feature_available(cam, "TriggerSelector", NULL)) {
        if (arv_camera_is_enumeration_entry_available(cam, "TriggerSelector", "FrameStart", NULL))
            arv_camera_set_string(cam, "TriggerSelector", "FrameStart", NULL);
        read_string(cam, "TriggerSelector", out->selector, sizeof out->selector);
    }
    read_mode(cam, out);
}

static bool trigger_same(const struct aravis_mode *a, const struct aravis_mode *b)
{
    return strcmp(a->mode, b->mode) == 0 && strcmp(a->source, b->source) == 0;
}

static void select_again(ArvCamera *cam, const struct aravis_mode *want)
{
    if (want->selector[0] != '\0')
        arv_camera_set_string(cam, "TriggerSelector", want->selector, NULL);
}

bool aravis_mode_is(ArvCamera *cam, const struct aravis_mode *want, char *text, size_t size)
{
    struct aravis_mode is = {.mode = ""};
    if (want->mode[0] == '\0')
        return true;
    read_mode(cam, &is);
    if (!trigger_same(&is, want)) { /* perhaps another trigger is selected */
        select_again(cam, want);
        read_mode(cam, &is);
    }
    bool silent = is.mode[0] == '\0' || (strcmp(is.mode, "On") == 0 && is.source[0] == '\0');
    if (silent || trigger_same(&is, want))
        return true;
    if (strcmp(is.mode, want->mode) != 0)
        snprintf(text, size, "TriggerMode is %s instead of %s", is.mode, want->mode);
    else
        snprintf(text, size, "TriggerSource is %s instead of %s", is.source, want->source);
    return false;
}

bool aravis_mode_again(ArvCamera *cam, const struct aravis_mode *want)
{
    struct aravis_mode is = {.mode = ""};
    select_again(cam, want);
    if (want->source[0] != '\0')
        arv_camera_set_string(cam, "TriggerSource", want->source, NULL);
    arv_camera_set_string(cam, "TriggerMode", want->mode, NULL);
    read_mode(cam, &is);
    return trigger_same(&is, want);
}
