/* compute_check.h - whether a device computes what the processors compute: before it is used, it solves a small set of
 * raw pictures in colour and one in grey.  A driver may compile a kernel wrongly, and nothing else would show that.
 * Threads: one. */
#ifndef DMN_COMPUTE_CHECK_H
#define DMN_COMPUTE_CHECK_H
#include "recon/opencl/device.h"

/* Volumes may differ by this share, as the solver's own stop lets them.  Those of a right device differ by 1e-5. */
#define DMN_COMPUTE_APART 0.01

/* Errors: PVX_EUNSUP (diag: how far the volumes are apart), PVX_ENODEV (it failed), PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err dmn_compute_check(rec_cl *card, struct pvx_diag *d);
#endif
