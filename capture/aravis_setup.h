/* aravis_setup.h - a camera made what the configuration says (private to the aravis: files).
 * Everything that is set is read back; a camera that does otherwise is refused with its own words
 * and limits. */
#ifndef CAP_ARAVIS_SETUP_H
#define CAP_ARAVIS_SETUP_H
#include <arv.h>
#include "capture/gev/chunk.h"
#include "capture/source/source.h"

struct aravis_layout {
    int width, height;
    enum cap_pixfmt fmt;
    size_t payload; /* bytes of one frame on the wire, chunks included */
};

/* Set PTP, features, format, region, trigger or frame rate, exposure, gain, chunks and packets; then
 * wait a second for PTP.  Errors: PVX_EINVAL (refused a value), PVX_EUNSUP (format, PTP), PVX_ETIMEDOUT
 * (PTP not there yet: open again), PVX_EIO. */
PVX_MUST_CHECK pvx_err aravis_configure(const struct cap_source_config *c, ArvCamera *cam,
                                        struct aravis_layout *layout, struct aravis_chunks *chunks,
                                        struct pvx_diag *d);

/* True when lost packets are worth asking for again. */
bool aravis_wants_resend(const struct cap_source_config *c, ArvCamera *camera);

/* aravis_list.c, as cap_source_ops.list. */
PVX_MUST_CHECK pvx_err aravis_list(void (*cb)(void *ctx, const struct cap_found *f), void *ctx,
                                   struct pvx_diag *d);

enum cap_pixfmt aravis_pixfmt(ArvPixelFormat f); /* CAP_FMT_NONE: none of ours */

/* "camera NAME (aravis:URI): what: message"; frees *err and clears it.  Returns e. */
pvx_err aravis_fail(const struct cap_source_config *c, pvx_err e, const char *what, GError **err,
                    struct pvx_diag *d);
/* PVX_EINVAL: "what want refused: the camera has got and offers min to max". */
pvx_err aravis_refused(const struct cap_source_config *c, struct pvx_diag *d, const char *what,
                       double want, double got, double min, double max);

/* aravis_trigger.c: acquisition mode, trigger and, in free run, frame rate. */
PVX_MUST_CHECK pvx_err aravis_set_trigger(const struct cap_source_config *c, ArvCamera *cam,
                                          struct pvx_diag *d);

/* What starts an exposure, as the camera says; mode "" = it has no TriggerMode, or does not answer. */
struct aravis_mode {
    char selector[32], mode[16], source[64];
};
/* Of a camera that has just been set up. */
void aravis_mode_first(ArvCamera *cam, struct aravis_mode *out);
/* Is it still `want`?  True, too, when there is nothing to compare.  `text` says what is wrong. */
bool aravis_mode_is(ArvCamera *cam, const struct aravis_mode *want, char *text, size_t size);
/* Set it again; true when the camera then says so. */
bool aravis_mode_again(ArvCamera *cam, const struct aravis_mode *want);
#endif
