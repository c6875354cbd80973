#include "recon/opencl/library.h"

#include <dlfcn.h>
#include <pthread.h>
#include <stdbool.h>
#include <stdio.h>

static struct rec_cl_library library;
static bool library_is_there;
static char library_why[256];

static void library_load(void)
{
    static const struct {
        const char *name;
        void **at;
    } functions[] = {
#define ROW(f) {"cl" #f, (void **)&library.f},
        REC_CL_FUNCTIONS(ROW)
#undef ROW
    };
    void *so = dlopen("libOpenCL.so.1", RTLD_NOW | RTLD_LOCAL);
    if (so == NULL) {
        const char *why = dlerror();
        snprintf(
            library_why, sizeof library_why,
            "OpenCL cannot be loaded (%.120s): install ocl-icd-libopencl1 and the driver of the "
            "card",
            why != NULL ? why : "libOpenCL.so.1");
        return;
    }
    for (size_t i = 0; i < sizeof functions / sizeof functions[0]; i++)
        if ((*functions[i].at = dlsym(so, functions[i].name)) == NULL) {
            snprintf(library_why, sizeof library_why,
                     "libOpenCL.so.1 has no %s: OpenCL 1.2 or later is needed", functions[i].name);
            return;
        }
    library_is_there = true;
}

const struct rec_cl_library *rec_cl_library(struct pvx_diag *d)
{
    static pthread_once_t once = PTHREAD_ONCE_INIT;
    pthread_once(&once, library_load);
    if (!library_is_there)
        (void)pvx_fail(d, PVX_ENOENT, "%s", library_why);
    return library_is_there ? &library : NULL;
}

const char *rec_cl_error(cl_int e)
{
    static const struct {
        cl_int e;
        const char *name;
    } names[] = {
#define ROW(e) {e, #e}
        ROW(CL_DEVICE_NOT_FOUND),
        ROW(CL_DEVICE_NOT_AVAILABLE),
        ROW(CL_COMPILER_NOT_AVAILABLE),
        ROW(CL_MEM_OBJECT_ALLOCATION_FAILURE),
        ROW(CL_OUT_OF_RESOURCES),
        ROW(CL_OUT_OF_HOST_MEMORY),
        ROW(CL_BUILD_PROGRAM_FAILURE),
        ROW(CL_MAP_FAILURE),
        ROW(CL_EXEC_STATUS_ERROR_FOR_EVENTS_IN_WAIT_LIST),
        ROW(CL_INVALID_VALUE),
        ROW(CL_INVALID_DEVICE),
        ROW(CL_INVALID_CONTEXT),
        ROW(CL_INVALID_COMMAND_QUEUE),
        ROW(CL_INVALID_MEM_OBJECT),
        ROW(CL_INVALID_BINARY),
        ROW(CL_INVALID_BUILD_OPTIONS),
        ROW(CL_INVALID_PROGRAM),
        ROW(CL_INVALID_PROGRAM_EXECUTABLE),
        ROW(CL_INVALID_KERNEL_NAME),
        ROW(CL_INVALID_KERNEL_ARGS),
        ROW(CL_INVALID_ARG_INDEX),
        ROW(CL_INVALID_ARG_VALUE),
        ROW(CL_INVALID_ARG_SIZE),
        ROW(CL_INVALID_WORK_GROUP_SIZE),
        ROW(CL_INVALID_WORK_ITEM_SIZE),
        ROW(CL_INVALID_EVENT),
        ROW(CL_INVALID_OPERATION),
        ROW(CL_INVALID_BUFFER_SIZE),
#undef ROW
    };
    static _Thread_local char other[32];
    for (size_t i = 0; i < sizeof names / sizeof names[0]; i++)
        if (names[i].e == e)
            return names[i].name;
    snprintf(other, sizeof other, "OpenCL error %d", e);
    return other;
}
