#include "daemon/sources.h"

#include <stdio.h>

#include "base/clock.h"

static pvx_err features(struct dmn_sources *s, const struct dmn_config *c, struct pvx_diag *d)
{
    for (size_t i = 0; i < c->features.n; i++) {
        struct cap_feature *f = &s->feature[i];
        snprintf(f->name, sizeof f->name, "%s", c->features.item[i].key);
        if (snprintf(f->value, sizeof f->value, "%s", c->features.item[i].value) >=
            (int)sizeof f->value)
            return pvx_fail(d, PVX_EINVAL, "%s: features.%s: longer than %zu characters", c->name,
                            f->name, sizeof f->value - 1);
    }
    return PVX_OK;
}

pvx_err dmn_sources_init(struct dmn_sources *s, const struct dmn_config *c,
                         const struct rec_rig *rig, const struct cap_scene *scene,
                         struct pvx_diag *d)
{
    PVX_TRY(features(s, c, d));
    for (size_t i = 0; i < rig->n_cameras; i++) {
        const struct rec_camera *k = &rig->cameras[i];
        PVX_TRY(dmn_config_source(c, k->name, i, s->uri[i], sizeof s->uri[i], d));
        s->source[i] = (struct cap_source_config){.uri = s->uri[i],
                                                  .name = k->name,
                                                  .camera = (uint32_t)i,
                                                  .width = k->width,
                                                  .height = k->height,
                                                  .fmt = dmn_config_pixfmt(c),
                                                  .fps = c->fps,
                                                  .software_trigger = c->trigger == 1,
                                                  .buffers = (unsigned)c->buffers,
                                                  .packet_size = (int32_t)c->packet_size,
                                                  .exposure_us = c->exposure_us,
                                                  .gain = c->gain,
                                                  .features = s->feature,
                                                  .n_features = c->features.n,
                                                  .lossless = c->lossless,
                                                  .loop = c->loop,
                                                  .scene = scene};
    }
    s->capture = (struct cap_capture_config){
        .n_cameras = (uint32_t)rig->n_cameras,
        .camera = s->source,
        .sets = {.cameras = (uint32_t)rig->n_cameras,
                 .tolerance_ns = (int64_t)(c->tolerance_ms * (double)PVX_NS_PER_MS),
                 .max_wait_ns = (int64_t)(c->max_wait_ms * (double)PVX_NS_PER_MS),
                 .period_ns = (int64_t)(1 / c->fps * (double)PVX_NS_PER_S),
                 .policy = c->policy == 1 ? CAP_POLICY_PARTIAL : CAP_POLICY_DROP,
                 .min_cameras = (uint32_t)c->min_cameras},
        .fps = c->fps,
        .software_trigger = c->trigger == 1,
        .shared_clock = c->shared_clock,
        .lossless = c->lossless,
        .discard_first = c->lossless ? 0 : (uint32_t)c->discard_first};
    return PVX_OK;
}
