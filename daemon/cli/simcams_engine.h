/* simcams_engine.h - what serves the cameras: our own (capture/gevsim/gvcam.h), or Aravis' fake
 * (capture/simgv.h), a second and independent one that can do less. */
#ifndef SIMCAMS_ENGINE_H
#define SIMCAMS_ENGINE_H
#include "capture/gevsim/gvcam.h"
#include "capture/simgv.h"

enum simcams_kind { SIMCAMS_OWN, SIMCAMS_ARAVIS };

struct simcams_engine {
    enum simcams_kind kind;
    cap_gvnet *net;    /* own only */
    double trigger_hz; /* Aravis only */
};
struct simcams_camera {
    cap_gvcam *own; /* one of the two, or none: dead */
    cap_simgv *aravis;
};

PVX_MUST_CHECK pvx_err simcams_engine_start(struct simcams_engine *e, enum simcams_kind kind,
                                            struct pvx_diag *d);
void simcams_engine_stop(struct simcams_engine *e);

PVX_MUST_CHECK pvx_err simcams_camera_start(struct simcams_engine *e,
                                            const struct cap_gvcam_config *c,
                                            struct simcams_camera *out, struct pvx_diag *d);
/* PVX_EUNSUP: a fault that this engine cannot show (d names it). */
PVX_MUST_CHECK pvx_err simcams_camera_fault(struct simcams_camera *c,
                                            const struct cap_gvcam_fault *f, struct pvx_diag *d);
/* Counts are added to *total; Aravis' fake has frames and dropped only. */
void simcams_camera_stop(struct simcams_camera *c, struct cap_gvcam_stats *total);
void simcams_camera_stats(const struct simcams_camera *c, struct cap_gvcam_stats *total);
static inline bool simcams_camera_alive(const struct simcams_camera *c)
{
    return c->own != NULL || c->aravis != NULL;
}
#endif
