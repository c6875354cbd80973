/* err.h - errors of Aravis and messages of GLib in our words (private to the aravis: files). */
#ifndef CAP_ARAVIS_ERR_H
#define CAP_ARAVIS_ERR_H
#include <arv.h>
#include <stdbool.h>
#include "capture/source/source.h"

/* "camera NAME (aravis:URI): what: message"; frees *err and clears it.  Returns e. */
pvx_err aravis_fail(const struct cap_source_config *c, pvx_err e, const char *what, GError **err,
                    struct pvx_diag *d);
/* PVX_EINVAL: "what want refused: the camera has got and offers min to max". */
pvx_err aravis_refused(const struct cap_source_config *c, struct pvx_diag *d, const char *what,
                       double want, double got, double min, double max);

/* True: no answer, although Aravis has asked several times, or the answer that another program controls the
 * camera. */
bool aravis_means_gone(const GError *err);

/* From now on GLib's criticals and warnings are lines of our log.  They never end the process, whatever G_DEBUG says.
 * A g_error still ends it, after it is logged. */
void aravis_log_messages(void);
#endif
