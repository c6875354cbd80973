/* device.h - graphics cards and other OpenCL devices: listed, opened, lost.
 *
 * libOpenCL.so.1 is loaded when a device is first asked for, and is no dependency: a host without it has no device.
 * OpenCL 1.2 with cl_khr_fp64 is enough; the kernels use buffers alone.
 * Programs are compiled once per device and driver, and are kept in the cache folder ($PYROVOX_CACHE, see
 * sysmat.h).
 * A device is lost when a call fails, or when its work does not end within REC_CL_PATIENCE.  From then on every
 * operation does nothing and sums are 0.  Nothing is retried; what the driver holds is left to it.
 * Threads: any.  Owner: caller. */
#ifndef REC_CL_DEVICE_H
#define REC_CL_DEVICE_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"

#ifdef __cplusplus
extern "C" {
#endif

#define REC_CL_PATIENCE 10.0 /* seconds; $PYROVOX_OPENCL_PATIENCE has tests' */

enum rec_cl_kind { REC_CL_GPU, REC_CL_CPU, REC_CL_OTHER };

struct rec_cl_info {
    char name[128], vendor[64], driver[64], platform[64];
    enum rec_cl_kind kind;
    uint64_t memory, largest; /* bytes: all of it; of one buffer */
    uint32_t units, mhz;
    bool shares;      /* its memory is the host's */
    bool denormals;   /* its floats keep them: photometry's numbers are the host's */
    char why_not[96]; /* "": it can be used */
};
#define REC_CL_MOST 16 /* devices that are listed */

/* All devices of all platforms: graphics cards first, of those the ones with memory of their own, of those the ones by
 * the driver of their vendor, which comes before those of Mesa and pocl for the same card; then in the platforms' order.
 * 0 and text in *d: there is none, and why. */
size_t rec_cl_list(struct rec_cl_info out[REC_CL_MOST], struct pvx_diag *d);

typedef struct rec_cl rec_cl;
/* The first device of the list whose name or platform has `name` in it, in any case; "": the first GPU.  One that can be
 * used comes before the others.
 * Errors: PVX_ENOENT (diag: the devices that there are), PVX_EUNSUP, PVX_ENODEV, PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_cl_open(const char *name, rec_cl **out, struct pvx_diag *d);
/* After all that was made with it is freed. */
void rec_cl_close(rec_cl **cl);

const struct rec_cl_info *rec_cl_about(const rec_cl *cl);
/* Why it is lost; NULL: it is not. */
const char *rec_cl_lost(const rec_cl *cl);
/* Whether a device has not answered in this process.  Its driver may wait for it at the end of the program, for ever:
 * a program then ends by _exit. */
bool rec_cl_hangs(void);

#ifdef __cplusplus
}
#endif
#endif
