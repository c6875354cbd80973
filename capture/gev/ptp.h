/* ptp.h - IEEE 1588 in a camera, by its features: SFNC 2 (PtpEnable, PtpStatus, PtpDataSetLatch,
 * PtpOffsetFromMaster) or the older names (GevIEEE1588...) (private to the aravis: files).
 *
 * Threads: the caller holds the camera's features (gev.h). */
#ifndef CAP_ARAVIS_PTP_H
#define CAP_ARAVIS_PTP_H
#include <arv.h>
#include "capture/source/source.h"

#define ARAVIS_PTP_OFFSET_US 10 /* with cap_source_config.ptp_offset_us = 0 */

struct aravis_ptp {
    char state[16];   /* in the camera's words; "" = it has no PTP, or it is off */
    double offset_ns; /* from the master; NAN = not reported */
};
/* Ask the camera. */
void aravis_ptp_read(ArvCamera *cam, struct aravis_ptp *out);
/* True for Master, and for Slave if the offset is small enough or not reported. */
bool aravis_ptp_good(const struct aravis_ptp *p, double offset_us);
/* Switch PTP on if it is wanted, else leave it as it is.  PVX_EUNSUP: the camera has no PTP. */
PVX_MUST_CHECK pvx_err aravis_ptp_enable(const struct cap_source_config *c, ArvCamera *cam,
                                         struct pvx_diag *d);
/* Wait up to 1 s for the clock.  PVX_ETIMEDOUT (the text has state and offset): open again later; the camera goes on
 * synchronizing by itself. */
PVX_MUST_CHECK pvx_err aravis_ptp_wait(const struct cap_source_config *c, ArvCamera *cam,
                                       struct pvx_diag *d);
#endif
