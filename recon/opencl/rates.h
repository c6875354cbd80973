/* rates.h - how fast a device moves bytes: a short measurement, a few tenths of a second.
 * Threads: any. */
#ifndef REC_CL_RATES_H
#define REC_CL_RATES_H
#include "recon/opencl/device.h"

/* Bytes a second, the best of several times. */
struct rec_cl_rates {
    double copy; /* within its memory, read plus written */
    double up;   /* from the host's memory to its own, */
    double down; /* and back, by pinned memory as the solve does */
};
/* Of the device with this number in rec_cl_list.  Errors: those of rec_cl_open. */
PVX_MUST_CHECK pvx_err rec_cl_measure(size_t number, struct rec_cl_rates *out, struct pvx_diag *d);

#endif
