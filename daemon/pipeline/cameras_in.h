/* cameras_in.h - the live source of the pipeline: the rig's cameras.
 *
 * It waits for the next set, skips sets that are too old while there is a newer one, and makes pixels of the set's
 * images.  A camera whose serial number differs from that of the rig's photometry is left out, with a log message.
 * Ownership: the struct is the caller's, all that it points to borrowed.  Threads: the carve stage's. */
#ifndef DMN_CAMERAS_IN_H
#define DMN_CAMERAS_IN_H
#include <stdatomic.h>
#include "capture/rig/capture.h"
#include "daemon/pipeline/background.h"
#include "daemon/pipeline/images.h"
#include "daemon/pipeline/instant.h"
#include "daemon/pipeline/pipeline.h"

/* Which messages about a camera have been logged. */
struct dmn_camera_said {
    bool other, far;
    int64_t bad_ns;   /* when it was logged that an image cannot be used; 0: never */
    unsigned unknown; /* sets without a temperature */
    int bits;         /* at which its samples end */
};

struct dmn_cameras_in {
    cap_capture *capture;
    dmn_images *images;
    const struct rec_rig *rig;
    struct cap_assembler_params sets; /* how many images a set must have */
    atomic_llong stale_ns;            /* an older set gives way to a newer one; 0 = never */
    const atomic_size_t *wait_for;    /* no set is taken while this is 0; NULL = do not wait */
    const atomic_bool *stopping;      /* while true, wait_for is ignored */
    dmn_background *background;       /* sees each set that is handed on; or NULL */
    dmn_instant *instant;             /* may keep a set that is handed on; or NULL */
    dmn_pipeline *const *pipeline;    /* the pipeline of this source, for the background */
    struct dmn_camera_said said[REC_MAX_CAMERAS]; /* starts as zeros */
};
struct dmn_source dmn_cameras_source(struct dmn_cameras_in *in);
#endif
