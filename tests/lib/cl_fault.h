/* cl_fault.h - a device that fails on demand: the program has tests/opencl/shim.c in front of libOpenCL.so.1. */
#ifndef TESTS_CL_FAULT_H
#define TESTS_CL_FAULT_H
#include <dlfcn.h>
#include <errno.h>
#include <limits.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/file.h"
#include "tests/opencl/shim.h"

static __typeof__(&pyrovox_cl_fault) cl_fault_set;
static __typeof__(&pyrovox_cl_happened) cl_fault_asked;
static __typeof__(&pyrovox_cl_objects) cl_fault_objects;
static __typeof__(&pyrovox_cl_watch) cl_watch;

/* The first call of main: the program begins anew with the shim in front. */
static inline void cl_fault_begin(void)
{
    char here[PATH_MAX - 32], path[PATH_MAX];
    const char *now = getenv("LD_LIBRARY_PATH");
    if (pvx_exe_dir(here, sizeof here) != PVX_OK)
        exit(1);
    snprintf(path, sizeof path, "%s/../opencl", here);
    if (now == NULL || strcmp(now, path) != 0) {
        setenv("LD_LIBRARY_PATH", path, 1);
        execl("/proc/self/exe", program_invocation_name, (char *)NULL);
        exit(1);
    }
    void *so = dlopen("libOpenCL.so.1", RTLD_NOW | RTLD_LOCAL);
    *(void **)&cl_fault_set = so != NULL ? dlsym(so, "pyrovox_cl_fault") : NULL;
    *(void **)&cl_fault_asked = so != NULL ? dlsym(so, "pyrovox_cl_happened") : NULL;
    *(void **)&cl_fault_objects = so != NULL ? dlsym(so, "pyrovox_cl_objects") : NULL;
    *(void **)&cl_watch = so != NULL ? dlsym(so, "pyrovox_cl_watch") : NULL;
    if (cl_watch == NULL || cl_fault_objects == NULL || cl_fault_set == NULL ||
        cl_fault_asked == NULL) {
        printf("FAIL %s/libOpenCL.so.1 is not there\n", path);
        exit(1);
    }
}
/* "FUNCTION:N:WHAT" as in shim.c; NULL: the device works from now on.  Calls are counted anew. */
static inline void cl_fault(const char *what)
{
    cl_fault_set(what);
}
static inline bool cl_fault_happened(void)
{
    long calls;
    return cl_fault_asked(&calls);
}
/* Of FUNCTION, since then. */
static inline long cl_fault_calls(void)
{
    long calls;
    (void)cl_fault_asked(&calls);
    return calls;
}
#endif
