/* sources.h - the cameras of pyrovoxd.yaml as capture's structs, for the daemon and for
 * `pyrovox cameras test`.
 *
 * Threads: constant after init. */
#ifndef DMN_SOURCES_H
#define DMN_SOURCES_H
#include "capture/rig/capture.h"
#include "daemon/config/config.h"

struct dmn_sources {
    struct cap_source_config source[REC_MAX_CAMERAS]; /* by the rig's order */
    char uri[REC_MAX_CAMERAS][DMN_WORD_MAX];
    struct cap_feature feature[DMN_PAIRS_MAX * (REC_MAX_CAMERAS + 1)];
    size_t n_features;
    struct cap_capture_config capture; /* .camera = source */
};

/* `rig` comes from dmn_config_rig.  Its names and the scene (for sim:, may be NULL) are borrowed.
 * s holds pointers into itself: it must not be moved.
 * Errors: PVX_EINVAL, PVX_ERANGE, the configuration's (diag names the key). */
PVX_MUST_CHECK pvx_err dmn_sources_init(struct dmn_sources *s, const struct dmn_config *c,
                                        const struct rec_rig *rig, const struct cap_scene *scene,
                                        struct pvx_diag *d);
#endif
