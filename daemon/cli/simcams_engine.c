#include "cli/simcams_engine.h"

#include <string.h>

pvx_err simcams_engine_start(struct simcams_engine *e, enum simcams_kind kind, struct pvx_diag *d)
{
    e->kind = kind;
    return kind == SIMCAMS_OWN ? cap_gvnet_new(&e->net, d) : PVX_OK;
}

void simcams_engine_stop(struct simcams_engine *e)
{
    cap_gvnet_free(&e->net);
}

pvx_err simcams_camera_start(struct simcams_engine *e, const struct cap_gvcam_config *c,
                             struct simcams_camera *out, struct pvx_diag *d)
{
    if (e->kind == SIMCAMS_OWN)
        return cap_gvcam_new(e->net, c, &out->own, d);
    struct cap_simgv_config old = {.address = c->address,
                                   .serial = c->serial,
                                   .user_name = c->user_name,
                                   .fmt = c->fmt,
                                   .width = c->width,
                                   .height = c->height,
                                   .ring = c->ring,
                                   .n_ring = c->n_ring,
                                   .ring_fps = c->ring_fps,
                                   .trigger_hz = e->trigger_hz};
    return cap_simgv_new(&old, &out->aravis, d);
}

pvx_err simcams_camera_fault(struct simcams_camera *c, const struct cap_gvcam_fault *f,
                             struct pvx_diag *d)
{
    if (c->own != NULL) {
        cap_gvcam_set_fault(c->own, f);
        return PVX_OK;
    }
    if (c->aravis == NULL)
        return PVX_OK;
    struct cap_simgv_fault old = {.skew_us = f->skew_us,
                                  .drift_ppm = f->drift_ppm,
                                  .drop = f->drop,
                                  .packet_loss = f->packet_loss,
                                  .delay_ms = f->delay_ms,
                                  .freeze = f->freeze};
    struct cap_gvcam_fault rest;
    static const struct cap_gvcam_fault none;
    memcpy(&rest, f, sizeof rest);
    rest.skew_us = rest.drift_ppm = rest.drop = rest.packet_loss = rest.delay_ms = 0;
    rest.freeze = false;
    cap_simgv_set_fault(c->aravis, &old);
    if (memcmp(&rest, &none, sizeof rest) != 0)
        return pvx_fail(d, PVX_EUNSUP,
                        "Aravis' fake camera knows drop, loss, delay, skew, drift and freeze only: "
                        "leave out --engine aravis for the others");
    return PVX_OK;
}

void simcams_camera_stats(const struct simcams_camera *c, struct cap_gvcam_stats *total)
{
    struct cap_gvcam_stats st = {0};
    struct cap_simgv_stats old = {0};
    if (c->own != NULL)
        cap_gvcam_stats(c->own, &st);
    if (c->aravis != NULL) {
        cap_simgv_stats(c->aravis, &old);
        st.frames = old.frames;
        st.dropped = old.dropped;
        st.taken = old.frames + old.dropped;
    }
    for (const struct cap_gvcam_stat_def *k = cap_gvcam_stat_defs; k->name != NULL; k++) {
        uint64_t a, b;
        memcpy(&a, (char *)total + k->offset, sizeof a);
        memcpy(&b, (char *)&st + k->offset, sizeof b);
        a += b;
        memcpy((char *)total + k->offset, &a, sizeof a);
    }
}

void simcams_camera_stop(struct simcams_camera *c, struct cap_gvcam_stats *total)
{
    simcams_camera_stats(c, total);
    cap_gvcam_free(&c->own);
    cap_simgv_free(&c->aravis);
}
