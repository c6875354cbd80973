#include "capture/gev/feature.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/log.h"
#include "capture/gev/err.h"

bool aravis_has(ArvCamera *cam, const char *name)
{
    return arv_camera_is_feature_available(cam, name, NULL);
}

bool aravis_can_set(ArvCamera *cam, const char *name)
{
    ArvGcNode *node = arv_device_get_feature(arv_camera_get_device(cam), name);
    if (!ARV_IS_GC_FEATURE_NODE(node))
        return false;
    ArvGcFeatureNode *f = ARV_GC_FEATURE_NODE(node);
    return arv_gc_feature_node_get_actual_access_mode(f) != ARV_GC_ACCESS_MODE_RO &&
           !arv_gc_feature_node_is_locked(f, NULL);
}

bool aravis_asks(const struct cap_source_config *c, const char *name)
{
    for (size_t i = 0; i < c->n_features; i++)
        if (strcmp(c->features[i].name, name) == 0)
            return true;
    return false;
}

/* ---- names that come near ------------------------------------------------------------------------ */

#define NEAREST   4
#define MOST_SEEN 4096 /* features of a camera that are looked at */

struct near {
    ArvDevice *device;
    const char *want;
    unsigned seen;
    struct {
        const char *name;
        size_t score;
    } best[NEAREST];
};

/* The length of the longest text that is in both. */
static size_t common(const char *a, const char *b)
{
    size_t most = 0;
    for (const char *p = a; *p != '\0'; p++)
        for (const char *q = b; *q != '\0'; q++) {
            size_t n = 0;
            while (p[n] != '\0' && g_ascii_tolower(p[n]) == g_ascii_tolower(q[n]))
                n++;
            most = n > most ? n : most;
        }
    return most;
}

/* Letters of the words of `want` ("Frame", "Rate") that are in the name. */
static size_t common_words(const char *want, const char *name)
{
    char word[64];
    size_t sum = 0;
    for (const char *p = want; *p != '\0';) {
        size_t n = 1;
        while (g_ascii_islower(p[n]) || g_ascii_isdigit(p[n]))
            n++;
        snprintf(word, sizeof word, "%.*s", (int)n, p);
        sum += strstr(name, word) != NULL ? n : 0;
        p += n;
    }
    return sum;
}

/* A name that holds the other, or is in it, is nearest.  Else the share of letters in common counts (Dice). */
static void near_add(struct near *n, const char *name)
{
    size_t a = strlen(n->want), b = strlen(name);
    if (a < 3 || b < 3 || b > 100)
        return;
    size_t same = common(n->want, name), words = common_words(n->want, name);
    bool within = same == a || same == b;
    size_t score = within ? 2000 - b : 2000 * (same > words ? same : words) / (a + b);
    for (int i = 0; i < NEAREST && score >= 450; i++)
        if (score > n->best[i].score) {
            memmove(&n->best[i + 1], &n->best[i], (size_t)(NEAREST - 1 - i) * sizeof n->best[0]);
            n->best[i].name = name;
            n->best[i].score = score;
            return;
        }
}

static void near_walk(struct near *n, const char *category, int depth)
{
    ArvGcNode *node = arv_device_get_feature(n->device, category);
    if (!ARV_IS_GC_CATEGORY(node) || depth > 8)
        return;
    for (const GSList *l = arv_gc_category_get_features(ARV_GC_CATEGORY(node));
         l != NULL && n->seen < MOST_SEEN; l = l->next) {
        node = arv_device_get_feature(n->device, l->data);
        n->seen++;
        if (ARV_IS_GC_CATEGORY(node))
            near_walk(n, l->data, depth + 1);
        else if (ARV_IS_GC_FEATURE_NODE(node))
            near_add(n, l->data);
    }
}

struct aravis_near aravis_near(ArvCamera *cam, const char *name)
{
    struct near n = {.device = arv_camera_get_device(cam), .want = name};
    struct aravis_near out = {""};
    size_t at = 0;
    near_walk(&n, "Root", 0);
    for (int i = 0; i < NEAREST && n.best[i].name != NULL && at < sizeof out.text; i++)
        at += (size_t)snprintf(out.text + at, sizeof out.text - at, "%s%.50s",
                               i == 0 ? " (it has " : ", ", n.best[i].name);
    if (at > 0 && at + 1 < sizeof out.text)
        snprintf(out.text + at, sizeof out.text - at, ")");
    return out;
}

pvx_err aravis_lacks(const struct cap_source_config *c, ArvCamera *cam, const char *asked,
                     const char *name, struct pvx_diag *d)
{
    return CAP_FAIL(c, "aravis", d, PVX_EINVAL, "%s: the camera has no %s%s", asked, name,
                    aravis_near(cam, name).text);
}

void aravis_entries(ArvCamera *cam, const char *name, char *out, size_t size)
{
    guint n = 0;
    size_t at = 0;
    const char **list = arv_camera_dup_available_enumerations_as_strings(cam, name, &n, NULL);
    snprintf(out, size, "nothing");
    for (guint i = 0; list != NULL && i < n && at < size; i++)
        at += (size_t)snprintf(out + at, size - at, "%s%s", i > 0 ? ", " : "", list[i]);
    g_free(list);
}

/* ---- setting ------------------------------------------------------------------------------------- */

pvx_err aravis_choose(const struct cap_source_config *c, ArvCamera *cam, const char *name,
                      const char *value, struct pvx_diag *d)
{
    GError *err = NULL;
    if (!aravis_has(cam, name)) {
        CAP_LOG(PVX_LOG_WARN, c, "aravis", name,
                "the camera has no %s%s: it is used as it is, as if that were %s", name,
                aravis_near(cam, name).text, value);
        return PVX_OK;
    }
    const char *is = arv_camera_get_string(cam, name, NULL);
    if (is != NULL && strcmp(is, value) == 0)
        return PVX_OK;
    arv_camera_set_string(cam, name, value, &err);
    return err == NULL ? PVX_OK : aravis_fail(c, PVX_EINVAL, name, &err, d);
}

/* Equal as text, or both are numbers and equal.  Real ones may differ by the rounding of a camera's steps.  Whole ones
 * may not: an offset of 2000 that became 1998 moves the picture. */
static bool same_value(const char *want, const char *got, bool real)
{
    char *end_want, *end_got;
    double a = strtod(want, &end_want), b = strtod(got, &end_got);
    if (end_want != want && *end_want == '\0' && end_got != got && *end_got == '\0')
        return fabs(a - b) <= (real ? 1e-3 * fabs(a) : 0);
    bool truth = strcmp(got, "true") == 0;
    if ((truth || strcmp(got, "false") == 0) && (strcmp(want, "1") == 0 || strcmp(want, "0") == 0))
        return truth == (want[0] == '1');
    return strcmp(want, got) == 0;
}

/* "" = the value is the line's, or cannot be read. */
static pvx_err read_back(const struct cap_source_config *c, ArvGcNode *node,
                         const struct cap_feature *f, char *other, size_t size, struct pvx_diag *d)
{
    GError *err = NULL;
    other[0] = '\0';
    if (arv_gc_feature_node_get_actual_access_mode(ARV_GC_FEATURE_NODE(node)) ==
        ARV_GC_ACCESS_MODE_WO)
        return PVX_OK;
    const char *got = arv_gc_feature_node_get_value_as_string(ARV_GC_FEATURE_NODE(node), &err);
    if (err != NULL || got == NULL)
        return aravis_fail(c, PVX_EINVAL, f->name, &err, d);
    if (!same_value(f->value, got, ARV_IS_GC_FLOAT(node)))
        snprintf(other, size, "%s", got);
    return PVX_OK;
}

pvx_err aravis_feature_set(const struct cap_source_config *c, ArvCamera *cam,
                           const struct cap_feature *f, struct pvx_diag *d)
{
    GError *err = NULL;
    char other[256];
    ArvGcNode *node = arv_device_get_feature(arv_camera_get_device(cam), f->name);
    if (!ARV_IS_GC_FEATURE_NODE(node))
        return CAP_FAIL(c, "aravis", d, PVX_EINVAL, "the camera has no feature %s%s", f->name,
                        aravis_near(cam, f->name).text);
    if (ARV_IS_GC_COMMAND(node)) {
        arv_gc_command_execute(ARV_GC_COMMAND(node), &err);
        return err == NULL ? PVX_OK : aravis_fail(c, PVX_EINVAL, f->name, &err, d);
    }
    arv_gc_feature_node_set_value_from_string(ARV_GC_FEATURE_NODE(node), f->value, &err);
    if (err != NULL && ARV_IS_GC_ENUMERATION(node) && err->domain == ARV_GC_ERROR) {
        g_clear_error(&err);
        aravis_entries(cam, f->name, other, sizeof other);
        return CAP_FAIL(c, "aravis", d, PVX_EINVAL, "feature %s = %s refused: the camera offers %s",
                        f->name, f->value, other);
    }
    if (err != NULL)
        return aravis_fail(c, PVX_EINVAL, f->name, &err, d);
    PVX_TRY(read_back(c, node, f, other, sizeof other, d));
    return other[0] == '\0'
               ? PVX_OK
               : CAP_FAIL(c, "aravis", d, PVX_EINVAL, "feature %s = %s refused: the camera has %s",
                          f->name, f->value, other);
}

/* ---- ours and the person's ------------------------------------------------------------------------ */

/* The setting of ours that rules features whose names begin so; "" = none does. */
static void ruled_by(const struct cap_source_config *c, const char *name, char *out, size_t size)
{
    bool triggered = c->trigger != CAP_TRIGGER_FREE_RUN;
    out[0] = '\0';
    if (g_str_has_prefix(name, "AcquisitionFrameRate") || strcmp(name, "FPS") == 0)
        snprintf(out, size, triggered ? "the trigger" : "fps: %g", c->fps);
    else if (g_str_has_prefix(name, "Exposure") && c->exposure_us >= 0)
        snprintf(out, size, "exposure_us: %g", c->exposure_us);
    else if (strstr(name, "Gain") != NULL && c->gain >= 0)
        snprintf(out, size, "gain: %g", c->gain);
    else if (strcmp(name, "PixelFormat") == 0 && c->fmt != CAP_FMT_NONE)
        snprintf(out, size, "pixel_format: %s", cap_pixfmt_name(c->fmt));
    else if ((strcmp(name, "Width") == 0 || strcmp(name, "Height") == 0) && c->width > 0)
        snprintf(out, size, "the rig's size %dx%d", c->width, c->height);
    else if (strcmp(name, "AcquisitionMode") == 0)
        snprintf(out, size, "the capture, which needs Continuous,");
    else if (g_str_has_prefix(name, "GevSCPS") && c->gige.packet_size > 0)
        snprintf(out, size, "gige.packet_size: %d", c->gige.packet_size);
    else if (strcmp(name, "GevSCPD") == 0 && c->gige.packet_delay > 0)
        snprintf(out, size, "gige.packet_delay_ns: %d", c->gige.packet_delay);
    else if (g_str_has_prefix(name, "Action") && c->trigger == CAP_TRIGGER_ACTION)
        snprintf(out, size, "action");
    else if (g_str_has_prefix(name, "Chunk") && (c->chunks || c->lines))
        snprintf(out, size, c->chunks ? "chunks: true" : "triggers: when: line");
}

/* Whether a later line sets the feature again, and that under the same selectors. */
static bool set_again(const struct cap_source_config *c, size_t i)
{
    for (size_t k = i + 1; k < c->n_features; k++) {
        if (strcmp(c->features[k].name, c->features[i].name) == 0)
            return true;
        if (g_str_has_suffix(c->features[k].name, "Selector"))
            return false;
    }
    return false;
}

pvx_err aravis_features_stay(const struct cap_source_config *c, ArvCamera *cam, struct pvx_diag *d)
{
    for (size_t i = 0; i < c->n_features; i++) {
        const struct cap_feature *f = &c->features[i];
        char other[256], ours[96];
        ArvGcNode *node = arv_device_get_feature(arv_camera_get_device(cam), f->name);
        if (g_str_has_suffix(f->name, "Selector")) {
            PVX_TRY(aravis_feature_set(c, cam, f, d)); /* for those that follow */
            continue;
        }
        if (!ARV_IS_GC_FEATURE_NODE(node) || ARV_IS_GC_COMMAND(node) || set_again(c, i))
            continue;
        PVX_TRY(read_back(c, node, f, other, sizeof other, d));
        if (other[0] == '\0')
            continue;
        ruled_by(c, f->name, ours, sizeof ours);
        if (ours[0] != '\0')
            return CAP_FAIL(c, "aravis", d, PVX_EINVAL,
                            "%s and `features: %s: %s` disagree: the camera now has %s; leave one "
                            "of them out",
                            ours, f->name, f->value, other);
        return CAP_FAIL(c, "aravis", d, PVX_EINVAL,
                        "`features: %s: %s` did not stay: a later setting made it %s", f->name,
                        f->value, other);
    }
    return PVX_OK;
}
