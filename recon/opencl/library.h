/* library.h - libOpenCL.so.1, loaded on first use.  Private to recon/opencl. */
#ifndef REC_CL_LIBRARY_H
#define REC_CL_LIBRARY_H
#define CL_TARGET_OPENCL_VERSION 120
#include <CL/cl.h>
#include "base/err.h"

/* The functions that are used, without their "cl". */
#define REC_CL_FUNCTIONS(X)       \
    X(GetPlatformIDs)             \
    X(GetPlatformInfo)            \
    X(GetDeviceIDs)               \
    X(GetDeviceInfo)              \
    X(CreateContext)              \
    X(ReleaseContext)             \
    X(CreateCommandQueue)         \
    X(ReleaseCommandQueue)        \
    X(CreateProgramWithSource)    \
    X(CreateProgramWithBinary)    \
    X(BuildProgram)               \
    X(GetProgramInfo)             \
    X(GetProgramBuildInfo)        \
    X(ReleaseProgram)             \
    X(CreateKernel)               \
    X(SetKernelArg)               \
    X(GetKernelWorkGroupInfo)     \
    X(ReleaseKernel)              \
    X(CreateBuffer)               \
    X(ReleaseMemObject)           \
    X(EnqueueMapBuffer)           \
    X(EnqueueUnmapMemObject)      \
    X(EnqueueFillBuffer)          \
    X(EnqueueCopyBuffer)          \
    X(EnqueueWriteBuffer)         \
    X(EnqueueReadBuffer)          \
    X(EnqueueNDRangeKernel)       \
    X(EnqueueMarkerWithWaitList)  \
    X(EnqueueBarrierWithWaitList) \
    X(GetEventInfo)               \
    X(WaitForEvents)              \
    X(ReleaseEvent)               \
    X(Flush)

struct rec_cl_library {
#define REC_CL_MEMBER(f) __typeof__ (&cl##f)(f);
    REC_CL_FUNCTIONS(REC_CL_MEMBER)
#undef REC_CL_MEMBER
};

/* NULL: it is not there, or lacks a function; *d: the reason and the remedy.  Threads: any. */
const struct rec_cl_library *rec_cl_library(struct pvx_diag *d);

/* "CL_OUT_OF_RESOURCES"; "OpenCL error -9999" where the number has no name. */
const char *rec_cl_error(cl_int e);

#endif
