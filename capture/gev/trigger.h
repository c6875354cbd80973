/* trigger.h - sets what starts an exposure, and checks that it stays so (private to the aravis: files).
 * Threads: the caller holds the camera's features (gev.h). */
#ifndef CAP_ARAVIS_TRIGGER_H
#define CAP_ARAVIS_TRIGGER_H
#include <arv.h>
#include <stdbool.h>
#include "capture/source/source.h"

/* Acquisition mode, trigger and, in free run, frame rate. */
PVX_MUST_CHECK pvx_err aravis_set_trigger(const struct cap_source_config *c, ArvCamera *cam,
                                          struct pvx_diag *d);

/* What starts an exposure, as the camera reports; mode "" = it has no TriggerMode, or does not answer. */
struct aravis_mode {
    char selector[32], mode[16], source[64];
};
/* Reads the mode of a camera that has just been set up. */
void aravis_mode_first(ArvCamera *cam, struct aravis_mode *out);
/* Whether the mode is still `want`; also true if there is nothing to compare.  Else `text` says what is wrong. */
bool aravis_mode_is(ArvCamera *cam, const struct aravis_mode *want, char *text, size_t size);
/* Set the mode again.  True: the camera then reports it. */
bool aravis_mode_again(ArvCamera *cam, const struct aravis_mode *want);
#endif
