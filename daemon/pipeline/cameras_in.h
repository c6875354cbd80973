/* cameras_in.h - the live source of the pipeline: the rig's cameras.
 *
 * A camera that says another serial number than the rig's photometry is left out, and it is said.
 * Waits for the next set, passes over those that are too old while there is a newer one, and makes pixels
 * of its images.
 * Ownership: the struct is the caller's, all that it points to borrowed.  Threads: the carve stage's. */
#ifndef DMN_CAMERAS_IN_H
#define DMN_CAMERAS_IN_H
#include <stdatomic.h>
#include "capture/rig/capture.h"
#include "daemon/pipeline/background.h"
#include "daemon/pipeline/images.h"
#include "daemon/pipeline/instant.h"
#include "daemon/pipeline/pipeline.h"

/* What has been said of a camera. */
struct dmn_camera_said {
    bool other, far;
    unsigned unknown; /* sets without a temperature */
};

struct dmn_cameras_in {
    cap_capture *capture;
    dmn_images *images;
    const struct rec_rig *rig;
    struct cap_assembler_params sets; /* how many images a set must have */
    atomic_llong stale_ns;         /* a set older than that makes way for a newer one; 0 = never */
    const atomic_size_t *wait_for; /* no image is taken before this is not 0; or NULL */
    const atomic_bool *stopping;   /* then it is not waited for */
    dmn_background *background;    /* looks at each set that is given on; or NULL */
    dmn_instant *instant;          /* may keep a set that is given on; or NULL */
    dmn_pipeline *const *pipeline; /* whose source this is, for that */
    struct dmn_camera_said said[REC_MAX_CAMERAS]; /* 0 */
};
struct dmn_source dmn_cameras_source(struct dmn_cameras_in *in);
#endif
