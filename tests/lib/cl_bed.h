/* cl_bed.h - a device for the tests of recon/opencl: pocl, which the package pocl-opencl-icd brings, or the device
 * that T_OPENCL names (Oclgrind).  A test fails where there is none. */
#ifndef TESTS_CL_BED_H
#define TESTS_CL_BED_H
#include <limits.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "recon/opencl/run.h"

/* pocl keeps what it compiled below the build folder, for all tests: it compiles slowly.  The product's own cache is not
 * used: to fill it pocl would compile every kernel. */
static inline void cl_bed_begin(void)
{
    char here[PATH_MAX - 32], cache[PATH_MAX];
    struct pvx_diag d = {""};
    if (pvx_exe_dir(here, sizeof here) != PVX_OK)
        exit(1);
    snprintf(cache, sizeof cache, "%s/../opencl/cache", here);
    if (pvx_mkdirs(cache, &d) != PVX_OK)
        exit(1);
    setenv("POCL_CACHE_DIR", cache, 1);
    setenv("PYROVOX_OPENCL_PATIENCE", "600", 0); /* a busy machine is no device that hangs */
    unsetenv("PYROVOX_CACHE");
    unsetenv("XDG_CACHE_HOME");
    unsetenv("HOME");
}

static inline const char *cl_bed_name(void)
{
    const char *name = getenv("T_OPENCL");
    return name != NULL ? name : "Portable";
}

/* Whether every read and write is checked, which is slow. */
static inline bool cl_bed_is_simulated(void)
{
    return strcmp(cl_bed_name(), "Oclgrind") == 0;
}

/* Nothing in a test makes sense without it. */
static inline rec_cl *cl_bed_open(void)
{
    struct pvx_diag d = {""};
    rec_cl *cl;
    if (rec_cl_open(cl_bed_name(), &cl, &d) == PVX_OK)
        return cl;
    printf("FAIL no OpenCL device \"%s\": %s\n", cl_bed_name(), d.text);
    exit(1);
}
static inline rec_cl_queue *cl_bed_queue(rec_cl *cl)
{
    struct pvx_diag d = {""};
    rec_cl_queue *q;
    if (rec_cl_queue_new(cl, &q, &d) == PVX_OK)
        return q;
    printf("FAIL no queue: %s\n", d.text);
    exit(1);
}
/* A buffer with the given bytes in it; NULL: zeros. */
static inline struct rec_cl_buffer cl_bed_buffer(rec_cl *cl, rec_cl_queue *q, const void *from,
                                                 size_t bytes)
{
    struct pvx_diag d = {""};
    struct rec_cl_buffer b;
    if (rec_cl_buffer_new(cl, bytes, &b, &d) != PVX_OK) {
        printf("FAIL no buffer: %s\n", d.text);
        exit(1);
    }
    if (from != NULL)
        rec_cl_upload(q, &b, 0, from, bytes);
    return b;
}
#endif
