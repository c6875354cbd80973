#include "daemon/pipeline/sources.h"

#include <arpa/inet.h>
#include <stdio.h>
#include <string.h>

#include "base/clock.h"

static pvx_err feature(struct dmn_sources *s, const struct dmn_config *c, const char *section,
                       const char *name, const char *value, struct pvx_diag *d)
{
    struct cap_feature *f = &s->feature[s->n_features++];
    snprintf(f->name, sizeof f->name, "%s", name);
    if (snprintf(f->value, sizeof f->value, "%s", value) >= (int)sizeof f->value)
        return pvx_fail(d, PVX_EINVAL, "%s: %s.%s: longer than %zu characters", c->name, section,
                        name, sizeof f->value - 1);
    return PVX_OK;
}

/* "CAMERA.FEATURE" -> "FEATURE" when it is that camera's. */
static const char *own_feature(const char *key, const char *camera)
{
    size_t n = strlen(camera);
    return strncmp(key, camera, n) == 0 && key[n] == '.' && key[n + 1] != '\0' ? key + n + 1 : NULL;
}

/* The features for all cameras, then the camera's own. */
static pvx_err sources_features(struct dmn_sources *s, const struct dmn_config *c,
                                const char *camera, struct cap_source_config *out,
                                struct pvx_diag *d)
{
    out->features = s->feature + s->n_features;
    for (size_t i = 0; i < c->features.n; i++)
        PVX_TRY(feature(s, c, "features", c->features.item[i].key, c->features.item[i].value, d));
    for (size_t i = 0; i < c->camera_features.n; i++) {
        const char *name = own_feature(c->camera_features.item[i].key, camera);
        if (name != NULL)
            PVX_TRY(feature(s, c, "camera_features", name, c->camera_features.item[i].value, d));
    }
    out->n_features = (size_t)(s->feature + s->n_features - out->features);
    return PVX_OK;
}

static pvx_err features_have_cameras(const struct dmn_config *c, const struct rec_rig *rig,
                                     struct pvx_diag *d)
{
    for (size_t i = 0; i < c->camera_features.n; i++) {
        const char *key = c->camera_features.item[i].key;
        bool any = false;
        for (size_t k = 0; k < rig->n_cameras; k++)
            any = any || own_feature(key, rig->cameras[k].name) != NULL;
        if (!any)
            return pvx_fail(d, PVX_EINVAL,
                            "%s: camera_features.%s: should be CAMERA.FEATURE, with a camera that "
                            "the rig and `cameras` have",
                            c->name, key);
    }
    return PVX_OK;
}

static pvx_err action(const struct dmn_config *c, struct cap_action_config *out, struct pvx_diag *d)
{
    *out =
        (struct cap_action_config){.keys = {.device_key = (uint32_t)c->action_device_key,
                                            .group_key = (uint32_t)c->action_group_key,
                                            .group_mask = (uint32_t)c->action_group_mask},
                                   .lead_ns = (int64_t)(c->action_lead_ms * (double)PVX_NS_PER_MS),
                                   .acknowledge = c->action_acknowledge};
    for (size_t i = 0; i < c->action_addresses.n; i++) {
        struct in_addr a;
        if (inet_pton(AF_INET, c->action_addresses.v[i], &a) != 1)
            return pvx_fail(d, PVX_EINVAL, "%s: action.addresses: '%s' is not an IPv4 address",
                            c->name, c->action_addresses.v[i]);
        out->address[out->n_addresses++] = ntohl(a.s_addr);
    }
    return PVX_OK;
}

static struct cap_gige gige(const struct dmn_config *c)
{
    return (struct cap_gige){.packet_size = (int32_t)c->packet_size,
                             .packet_delay = (int32_t)c->packet_delay_ns,
                             .resend = (enum cap_resend)c->resend,
                             .socket_buffer = (int32_t)c->socket_buffer,
                             .frame_retention_ms = c->frame_retention_ms,
                             .packet_timeout_ms = c->packet_timeout_ms,
                             .rt_priority = c->rt_priority > 0 ? (int32_t)c->rt_priority : -1,
                             .no_packet_socket = !c->packet_socket};
}

/* Checks that need the rig and the configuration together. */
static pvx_err fits_the_rig(const struct dmn_config *c, const struct rec_rig *rig,
                            struct pvx_diag *d)
{
    const struct {
        const char *key;
        int64_t n;
    } least[] = {{"sync.min_cameras", c->min_cameras}, {"hull.min_views", c->min_views}};
    for (size_t i = 0; i < sizeof least / sizeof least[0]; i++)
        if (least[i].n > (int64_t)rig->n_cameras)
            return pvx_fail(d, PVX_EINVAL, "%s: %s: %lld, but there %s", c->name, least[i].key,
                            (long long)least[i].n,
                            rig->n_cameras == 1 ? "is only one camera: set it to 1"
                                                : "are not so many cameras");
    if (c->tolerance_ms * 2e-3 * c->fps >= 1)
        return pvx_fail(d, PVX_EINVAL,
                        "%s: sync.tolerance_ms: %g is not below half a period, %.3f ms at fps: %g",
                        c->name, c->tolerance_ms, 500 / c->fps, c->fps);
    return PVX_OK;
}

/* One live camera cannot be two cameras of the rig; a recording or a simulation can. */
static pvx_err named_once(const struct dmn_config *c, const struct dmn_sources *s,
                          const struct rec_rig *rig, size_t i, struct pvx_diag *d)
{
    static const char *const live[] = {"aravis:", "v4l2:", "libcamera:"};
    bool is_live = false;
    for (size_t k = 0; k < sizeof live / sizeof live[0]; k++)
        is_live |= strncmp(s->uri[i], live[k], strlen(live[k])) == 0;
    for (size_t k = 0; k < i && is_live; k++)
        if (strcmp(s->uri[i], s->uri[k]) == 0)
            return pvx_fail(d, PVX_EINVAL, "%s: cameras.%s: '%s' is %s already", c->name,
                            rig->cameras[i].name, s->uri[i], rig->cameras[k].name);
    return PVX_OK;
}

/* The cameras that triggers name have lines, and are to report them. */
static pvx_err sources_lines(struct dmn_sources *s, const struct dmn_config *c,
                             const struct rec_rig *rig, struct pvx_diag *d)
{
    for (size_t i = 0; i < c->triggers.n; i++) {
        const struct dmn_trigger *k = &c->triggers.item[i];
        if (k->when != DMN_WHEN_LINE)
            continue;
        int n = rec_rig_find(rig, k->camera);
        if (n < 0)
            return pvx_fail(d, PVX_EINVAL,
                            "%s: triggers: %s: there is no camera '%s': name one of "
                            "the rig",
                            c->name, k->name, k->camera);
        if (strncmp(s->uri[n], "aravis:", 7) != 0)
            return pvx_fail(d, PVX_EINVAL,
                            "%s: triggers: %s: %s is '%s', and only aravis: cameras (GigE Vision) "
                            "report their lines: name such a camera, or take another condition",
                            c->name, k->name, k->camera, s->uri[n]);
        s->source[n].lines = true;
    }
    return PVX_OK;
}

pvx_err dmn_sources_init(struct dmn_sources *s, const struct dmn_config *c,
                         const struct rec_rig *rig, const struct cap_scene *scene,
                         struct pvx_diag *d)
{
    s->n_features = 0;
    PVX_TRY(fits_the_rig(c, rig, d));
    PVX_TRY(features_have_cameras(c, rig, d));
    for (size_t i = 0; i < rig->n_cameras; i++) {
        const struct rec_camera *k = &rig->cameras[i];
        PVX_TRY(dmn_config_source(c, k->name, i, s->uri[i], sizeof s->uri[i], d));
        PVX_TRY(named_once(c, s, rig, i, d));
        s->source[i] = (struct cap_source_config){.uri = s->uri[i],
                                                  .name = k->name,
                                                  .camera = (uint32_t)i,
                                                  .width = k->width,
                                                  .height = k->height,
                                                  .fmt = dmn_config_pixfmt(c),
                                                  .fps = c->fps,
                                                  .trigger = (enum cap_trigger)c->trigger,
                                                  .trigger_line = c->trigger_line,
                                                  .ptp = c->ptp,
                                                  .ptp_offset_us = c->ptp_offset_us,
                                                  .chunks = c->chunks,
                                                  .buffers = (unsigned)c->buffers,
                                                  .gige = gige(c),
                                                  .exposure_us = c->exposure_us,
                                                  .gain = c->gain,
                                                  .lossless = c->lossless,
                                                  .loop = c->loop,
                                                  .scene = scene};
        PVX_TRY(sources_features(s, c, k->name, &s->source[i], d));
    }
    PVX_TRY(sources_lines(s, c, rig, d));
    /* in the order of the option's words */
    static const enum cap_policy policies[] = {CAP_POLICY_DROP, CAP_POLICY_PARTIAL, CAP_POLICY_WAIT,
                                               CAP_POLICY_PARTIAL};
    s->capture = (struct cap_capture_config){
        .n_cameras = (uint32_t)rig->n_cameras,
        .camera = s->source,
        .sets = {.cameras = (uint32_t)rig->n_cameras,
                 .tolerance_ns = (int64_t)(c->tolerance_ms * (double)PVX_NS_PER_MS),
                 .max_wait_ns = (int64_t)(c->max_wait_ms * (double)PVX_NS_PER_MS),
                 .period_ns = (int64_t)(1 / c->fps * (double)PVX_NS_PER_S),
                 .policy = policies[c->policy],
                 .min_cameras = (uint32_t)c->min_cameras},
        .fps = c->fps,
        .trigger = (enum cap_trigger)c->trigger,
        .shared_clock = c->shared_clock,
        .lossless = c->lossless,
        .discard_first = c->lossless ? 0 : (uint32_t)c->discard_first};
    return action(c, &s->capture.action, d);
}
