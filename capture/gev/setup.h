/* setup.h - applies the configuration to a camera (private to the aravis: files).
 * Every value that is set is read back.  If the camera has another one, it is refused; the error gives the camera's
 * value and limits. */
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

/* Whether to ask the camera for lost packets again. */
bool aravis_wants_resend(const struct cap_source_config *c, ArvCamera *camera);

#endif
