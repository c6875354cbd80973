/* feature.h - features of a camera by their names (private to the aravis: files).
 * Threads: the caller holds the camera's features (gev.h). */
#ifndef CAP_ARAVIS_FEATURE_H
#define CAP_ARAVIS_FEATURE_H
#include <arv.h>
#include <stdbool.h>
#include "capture/source/source.h"

/* Whether the camera has the feature, and whether it can be set.  False also if the camera does not answer. */
bool aravis_has(ArvCamera *cam, const char *name);
bool aravis_can_set(ArvCamera *cam, const char *name);
/* Whether `features` of the configuration names it. */
bool aravis_asks(const struct cap_source_config *c, const char *name);

/* Text for a message that names a feature which the camera lacks: " (it has A, B)", the names that come near.  "" = no
 * name comes near. */
struct aravis_near {
    char text[256];
};
struct aravis_near aravis_near(ArvCamera *cam, const char *name);
/* PVX_EINVAL: "`asked`: the camera has no `name` (it has A, B)". */
pvx_err aravis_lacks(const struct cap_source_config *c, ArvCamera *cam, const char *asked,
                     const char *name, struct pvx_diag *d);
/* "A, B" or "nothing": the values that an enumeration offers. */
void aravis_entries(ArvCamera *cam, const char *name, char *out, size_t size);

/* Set an enumeration that must have this value.  A camera without it is used as it is, with a warning.  PVX_EINVAL:
 * it has another value and keeps it. */
PVX_MUST_CHECK pvx_err aravis_choose(const struct cap_source_config *c, ArvCamera *cam,
                                     const char *name, const char *value, struct pvx_diag *d);

/* Set a line of `features`, and read it back.  PVX_EINVAL: refused. */
PVX_MUST_CHECK pvx_err aravis_feature_set(const struct cap_source_config *c, ArvCamera *cam,
                                          const struct cap_feature *f, struct pvx_diag *d);
/* Whether all lines of `features` are still true.  PVX_EINVAL: a setting of ours disagrees with one (diag names both). */
PVX_MUST_CHECK pvx_err aravis_features_stay(const struct cap_source_config *c, ArvCamera *cam,
                                            struct pvx_diag *d);
#endif
