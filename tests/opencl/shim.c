/* shim.c - a libOpenCL.so.1 that stands in front of the real one and fails on demand.
 *
 *     LD_LIBRARY_PATH=build/tests/opencl PYROVOX_CL_FAULT=clEnqueueNDRangeKernel:57:error build/bin/pyrovoxd ...
 *
 * FUNCTION:N:WHAT.  FUNCTION: a name, or "any" (all but clGetEventInfo, which is asked as often as time allows).
 * N: its n-th call, from 1; 0: never, it is counted.  WHAT:
 *     error   the call returns CL_OUT_OF_RESOURCES; a negative number: that error
 *     few     from then on clGetKernelWorkGroupInfo says that groups have at most 32 items
 *     idle    from then on kernels do nothing, and the device says that all is well
 *     event   the call succeeds, and from then on the work of the device fails
 *     hang    the call succeeds, and from then on the device does nothing; what waits in the driver never returns, also
 *             not at the end of the program
 * strict.h has what it does without a fault.
 * $PYROVOX_CL_SAID: a file to which a line is added when that happens, and one at the end: "any 1234" (calls so far).
 * In a test program: tests/lib/cl_fault.h. */
#define CL_TARGET_OPENCL_VERSION 120
#include <CL/cl.h>
#include <dlfcn.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "tests/opencl/shim.h"
#include "tests/opencl/strict.h"

enum what { WORKS, FAILS, FEW, IDLE, BROKEN, HANGS };
static struct {
    pthread_mutex_t lock;
    char function[64];
    long at, calls, any;
    enum what what;
    cl_int error;
    bool set;
} fault = {.lock = PTHREAD_MUTEX_INITIALIZER};
static _Atomic long objects; /* that were made and not released */
static _Atomic int state =
    WORKS; /* BROKEN or HANGS once that has begun; FAILS: a call has failed */

static void fault_said(const char *function, long n)
{
    const char *path = getenv("PYROVOX_CL_SAID");
    FILE *f = path != NULL ? fopen(path, "ae") : NULL;
    if (f == NULL)
        return;
    fprintf(f, "%s %ld\n", function, n);
    fclose(f);
}

void pyrovox_cl_fault(const char *text)
{
    char what[32] = "";
    pthread_mutex_lock(&fault.lock);
    fault.set = true;
    fault.at = fault.calls = fault.any = 0;
    fault.what = WORKS;
    fault.error = CL_OUT_OF_RESOURCES;
    if (text != NULL) {
        if (sscanf(text, "%63[^:]:%ld:%31s", fault.function, &fault.at, what) != 3) {
            fprintf(stderr, "PYROVOX_CL_FAULT=%s: should be FUNCTION:N:WHAT\n", text);
            _exit(99);
        }
        fault.what = strcmp(what, "hang") == 0    ? HANGS
                     : strcmp(what, "event") == 0 ? BROKEN
                     : strcmp(what, "few") == 0   ? FEW
                     : strcmp(what, "idle") == 0  ? IDLE
                                                  : FAILS;
        if (what[0] == '-')
            fault.error = (cl_int)strtol(what, NULL, 10);
    }
    pthread_mutex_unlock(&fault.lock);
    atomic_store(&state, WORKS);
}

bool pyrovox_cl_happened(long *calls)
{
    pthread_mutex_lock(&fault.lock);
    *calls = fault.calls;
    pthread_mutex_unlock(&fault.lock);
    return atomic_load(&state) != WORKS;
}

static void (*_Atomic inside_change)(int by);

void pyrovox_cl_watch(void (*change)(int by))
{
    atomic_store(&inside_change, change);
}
static int inside_by(int by)
{
    void (*change)(int) = atomic_load(&inside_change);
    if (change != NULL)
        change(by);
    return by;
}
static void inside_leave(const int *by)
{
    (void)inside_by(-*by);
}
/* Until the block ends this thread is inside of the library. */
#define INSIDE __attribute__((cleanup(inside_leave), unused)) const int inside_ = inside_by(1)

long pyrovox_cl_objects(void)
{
    return atomic_load(&objects);
}

static cl_int made(cl_int e)
{
    if (e == CL_SUCCESS)
        atomic_fetch_add(&objects, 1);
    return e;
}
static cl_int released(cl_int e)
{
    if (e == CL_SUCCESS)
        atomic_fetch_sub(&objects, 1);
    return e;
}

/* Counts a call.  The error that it returns, or CL_SUCCESS. */
static cl_int fault_call(const char *function)
{
    cl_int e = CL_SUCCESS;
    if (!fault.set)
        pyrovox_cl_fault(getenv("PYROVOX_CL_FAULT"));
    pthread_mutex_lock(&fault.lock);
    bool polled = strcmp(function, "clGetEventInfo") == 0;
    fault.any += !polled;
    bool counts = fault.what != WORKS && (strcmp(fault.function, function) == 0 ||
                                          (strcmp(fault.function, "any") == 0 && !polled));
    if (counts && ++fault.calls == fault.at) {
        atomic_store(&state, fault.what);
        if (fault.what == FAILS)
            e = fault.error;
        fault_said(function, fault.at);
    }
    pthread_mutex_unlock(&fault.lock);
    return e;
}

static bool hangs(void)
{
    return atomic_load(&state) == HANGS;
}
/* What waits for a device that hangs. */
static void fault_wait(void)
{
    while (hangs())
        pause();
}

__attribute__((destructor)) static void fault_end(void)
{
    fault_said("any", fault.any);
    fault_wait();
}

/* The name is of the file that the loader would take without this one. */
static void *real(const char *function)
{
    static void *so;
    static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
    pthread_mutex_lock(&lock);
    if (so == NULL)
        so = dlopen("/usr/lib/" PVX_MULTIARCH "/libOpenCL.so.1", RTLD_NOW | RTLD_LOCAL);
    void *f = so != NULL ? dlsym(so, function) : NULL;
    pthread_mutex_unlock(&lock);
    if (f == NULL) {
        fprintf(stderr, "the shim of OpenCL finds no %s in the real one\n", function);
        _exit(99);
    }
    return f;
}
/* The signatures are those of OpenCL. */
/* NOLINTBEGIN(readability-function-size,bugprone-macro-parentheses) */
#define REAL(f) ((__typeof__(&f))real(#f))

/* An event of a device that hangs: nobody asks the driver for it. */
static int never;
#define NEVER ((cl_event)&never)

/* Calls that do their work at once. */
#define PLAIN(f, params, args)                               \
    CL_API_ENTRY cl_int CL_API_CALL f params                 \
    {                                                        \
        INSIDE;                                              \
        cl_int fault_ = fault_call(#f);                      \
        return fault_ != CL_SUCCESS ? fault_ : REAL(f) args; \
    }
/* Calls that give an object back.  They may wait for the device. */
#define RELEASES(f, params, args)                                      \
    CL_API_ENTRY cl_int CL_API_CALL f params                           \
    {                                                                  \
        INSIDE;                                                        \
        cl_int fault_ = fault_call(#f);                                \
        fault_wait();                                                  \
        return fault_ != CL_SUCCESS ? fault_ : released(REAL(f) args); \
    }
/* Calls that give an object; the last argument is `error`. */
#define MAKES(type, f, params, args)       \
    CL_API_ENTRY type CL_API_CALL f params \
    {                                      \
        INSIDE;                            \
        cl_int fault_ = fault_call(#f);    \
        if (fault_ == CL_SUCCESS)          \
            (void)made(CL_SUCCESS);        \
        if (fault_ == CL_SUCCESS)          \
            return REAL(f) args;           \
        if (error != NULL)                 \
            *error = fault_;               \
        return NULL;                       \
    }
static cl_int enqueued(cl_int e, cl_command_queue q, const cl_event *event)
{
    if (e == CL_SUCCESS && event != NULL)
        strict_enqueued(q, *event);
    return e;
}
/* Calls that give the device work; the last argument is `event`.  first: before the call; then: after it. */
#define ENQUEUES_AND(f, params, args, first, then)       \
    CL_API_ENTRY cl_int CL_API_CALL f params             \
    {                                                    \
        INSIDE;                                          \
        cl_int fault_ = fault_call(#f);                  \
        if (fault_ == CL_SUCCESS && hangs())             \
            *event = NEVER;                              \
        if (fault_ != CL_SUCCESS || hangs())             \
            return fault_;                               \
        first;                                           \
        fault_ = enqueued(made(REAL(f) args), q, event); \
        if (fault_ == CL_SUCCESS)                        \
            then;                                        \
        return fault_;                                   \
    }
#define ENQUEUES(f, params, args) ENQUEUES_AND(f, params, args, (void)0, (void)0)
#define WAIT_LIST                 cl_uint n, const cl_event *list, cl_event *event

PLAIN(clGetPlatformIDs, (cl_uint n, cl_platform_id *out, cl_uint *all), (n, out, all))
PLAIN(clGetPlatformInfo, (cl_platform_id p, cl_platform_info i, size_t n, void *out, size_t *all),
      (p, i, n, out, all))
PLAIN(clGetDeviceIDs,
      (cl_platform_id p, cl_device_type t, cl_uint n, cl_device_id *out, cl_uint *all),
      (p, t, n, out, all))
PLAIN(clGetDeviceInfo, (cl_device_id d, cl_device_info i, size_t n, void *out, size_t *all),
      (d, i, n, out, all))
MAKES(cl_context, clCreateContext,
      (const cl_context_properties *p, cl_uint n, const cl_device_id *d,
       void(CL_CALLBACK *call)(const char *, const void *, size_t, void *), void *data,
       cl_int *error),
      (p, n, d, call, data, error))
RELEASES(clReleaseContext, (cl_context c), (c))
MAKES(cl_command_queue, clCreateCommandQueue,
      (cl_context c, cl_device_id d, cl_command_queue_properties p, cl_int *error),
      (c, d, p, error))
MAKES(cl_program, clCreateProgramWithSource,
      (cl_context c, cl_uint n, const char **text, const size_t *bytes, cl_int *error),
      (c, n, text, bytes, error))
MAKES(cl_program, clCreateProgramWithBinary,
      (cl_context c, cl_uint n, const cl_device_id *d, const size_t *bytes,
       const unsigned char **from, cl_int *taken, cl_int *error),
      (c, n, d, bytes, from, taken, error))
PLAIN(clBuildProgram,
      (cl_program p, cl_uint n, const cl_device_id *d, const char *options,
       void(CL_CALLBACK *call)(cl_program, void *), void *data),
      (p, n, d, options, call, data))
PLAIN(clGetProgramInfo, (cl_program p, cl_program_info i, size_t n, void *out, size_t *all),
      (p, i, n, out, all))
PLAIN(clGetProgramBuildInfo,
      (cl_program p, cl_device_id d, cl_program_build_info i, size_t n, void *out, size_t *all),
      (p, d, i, n, out, all))
RELEASES(clReleaseProgram, (cl_program p), (p))
MAKES(cl_kernel, clCreateKernel, (cl_program p, const char *name, cl_int *error), (p, name, error))
PLAIN(clSetKernelArg, (cl_kernel k, cl_uint i, size_t n, const void *value),
      (k, i, n, (strict_argument(k), value)))
RELEASES(clReleaseKernel, (cl_kernel k), ((strict_kernel(k), k)))
MAKES(cl_mem, clCreateBuffer,
      (cl_context c, cl_mem_flags flags, size_t n, void *host, cl_int *error),
      (c, flags, n, host, error))
RELEASES(clReleaseMemObject, (cl_mem m), (m))
ENQUEUES(clEnqueueUnmapMemObject, (cl_command_queue q, cl_mem m, void *p, WAIT_LIST),
         (q, m, p, n, list, event))
ENQUEUES(clEnqueueFillBuffer,
         (cl_command_queue q, cl_mem m, const void *with, size_t of, size_t at, size_t bytes,
          WAIT_LIST),
         (q, m, with, of, at, bytes, n, list, event))
ENQUEUES(clEnqueueCopyBuffer,
         (cl_command_queue q, cl_mem from, cl_mem to, size_t from_at, size_t to_at, size_t bytes,
          WAIT_LIST),
         (q, from, to, from_at, to_at, bytes, n, list, event))
ENQUEUES_AND(clEnqueueWriteBuffer,
             (cl_command_queue q, cl_mem m, cl_bool wait, size_t at, size_t bytes, const void *from,
              WAIT_LIST),
             (q, m, wait, at, bytes, from, n, list, event), (void)0,
             strict_transfer(q, (void *)from, NULL, bytes))
ENQUEUES_AND(clEnqueueReadBuffer,
             (cl_command_queue q, cl_mem m, cl_bool wait, size_t at, size_t bytes, void *to,
              WAIT_LIST),
             (q, m, wait, at, bytes, through, n, list, event), void *through = malloc(bytes),
             strict_transfer(q, to, through, bytes))
ENQUEUES(clEnqueueMarkerWithWaitList, (cl_command_queue q, WAIT_LIST), (q, n, list, event))
ENQUEUES(clEnqueueBarrierWithWaitList, (cl_command_queue q, WAIT_LIST), (q, n, list, event))

CL_API_ENTRY cl_int CL_API_CALL clReleaseCommandQueue(cl_command_queue q)
{
    INSIDE;
    cl_int e = fault_call("clReleaseCommandQueue");
    fault_wait();
    if (e == CL_SUCCESS)
        strict_forget(q);
    return e != CL_SUCCESS ? e : released(REAL(clReleaseCommandQueue)(q));
}

CL_API_ENTRY cl_int CL_API_CALL clFlush(cl_command_queue q)
{
    INSIDE;
    cl_int e = fault_call("clFlush");
    if (e == CL_SUCCESS)
        strict_flushed(q);
    return e != CL_SUCCESS ? e : REAL(clFlush)(q);
}

CL_API_ENTRY cl_int CL_API_CALL clEnqueueNDRangeKernel(cl_command_queue q, cl_kernel k,
                                                       cl_uint axes, const size_t *from,
                                                       const size_t *all, const size_t *group,
                                                       WAIT_LIST)
{
    INSIDE;
    cl_int e = fault_call("clEnqueueNDRangeKernel");
    if (e == CL_SUCCESS && hangs())
        *event = NEVER;
    if (e != CL_SUCCESS || hangs())
        return e;
    strict_kernel(k);
    if (atomic_load(&state) == IDLE)
        e = REAL(clEnqueueMarkerWithWaitList)(q, n, list, event);
    else
        e = REAL(clEnqueueNDRangeKernel)(q, k, axes, from, all, group, n, list, event);
    return enqueued(made(e), q, event);
}

CL_API_ENTRY void *CL_API_CALL clEnqueueMapBuffer(cl_command_queue q, cl_mem m, cl_bool wait,
                                                  cl_map_flags flags, size_t at, size_t bytes,
                                                  WAIT_LIST, cl_int *error)
{
    INSIDE;
    cl_int e = fault_call("clEnqueueMapBuffer");
    void *here = NULL;
    if (e == CL_SUCCESS)
        here = REAL(clEnqueueMapBuffer)(q, m, wait, flags, at, bytes, n, list, event, &e);
    if (here != NULL)
        (void)enqueued(made(e), q, event);
    *error = e;
    return here;
}

CL_API_ENTRY cl_int CL_API_CALL clGetEventInfo(cl_event event, cl_event_info i, size_t n, void *out,
                                               size_t *all)
{
    INSIDE;
    cl_int e = fault_call("clGetEventInfo");
    if (e != CL_SUCCESS)
        return e;
    int now = atomic_load(&state);
    if (now != HANGS && event != NEVER)
        e = REAL(clGetEventInfo)(event, i, n, out, all);
    if (now < BROKEN && !strict_may_begin(event))
        *(cl_int *)out = CL_QUEUED;
    if (now == HANGS || event == NEVER)
        *(cl_int *)out = CL_SUBMITTED;
    else if (now == BROKEN)
        *(cl_int *)out = CL_OUT_OF_RESOURCES;
    return e;
}

CL_API_ENTRY cl_int CL_API_CALL clGetKernelWorkGroupInfo(cl_kernel k, cl_device_id d,
                                                         cl_kernel_work_group_info i, size_t n,
                                                         void *out, size_t *all)
{
    INSIDE;
    cl_int e = fault_call("clGetKernelWorkGroupInfo");
    if (e == CL_SUCCESS)
        e = REAL(clGetKernelWorkGroupInfo)(k, d, i, n, out, all);
    if (e == CL_SUCCESS && atomic_load(&state) == FEW && i == CL_KERNEL_WORK_GROUP_SIZE)
        *(size_t *)out = 32;
    return e;
}

CL_API_ENTRY cl_int CL_API_CALL clWaitForEvents(cl_uint n, const cl_event *list)
{
    INSIDE;
    cl_int e = fault_call("clWaitForEvents");
    fault_wait();
    if (e == CL_SUCCESS)
        e = REAL(clWaitForEvents)(n, list);
    for (cl_uint i = 0; i < n && e == CL_SUCCESS; i++)
        strict_waited(list[i]);
    return e;
}

CL_API_ENTRY cl_int CL_API_CALL clReleaseEvent(cl_event event)
{
    INSIDE;
    cl_int e = fault_call("clReleaseEvent");
    if (e == CL_SUCCESS)
        strict_released(event);
    return e != CL_SUCCESS || event == NEVER ? e : released(REAL(clReleaseEvent)(event));
}
/* NOLINTEND(readability-function-size,bugprone-macro-parentheses) */
