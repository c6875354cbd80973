/* shim.h - what a test program says to the shim of OpenCL that it runs with. */
#ifndef TESTS_OPENCL_SHIM_H
#define TESTS_OPENCL_SHIM_H
#include <stdbool.h>

/* text: FUNCTION:N:WHAT; NULL: no fault from now on.  Calls are counted anew. */
void pyrovox_cl_fault(const char *text);
/* Whether it has happened; *calls: of FUNCTION so far. */
bool pyrovox_cl_happened(long *calls);
/* change(1) when a thread begins a call of OpenCL, change(-1) when that ends; NULL: no more. */
void pyrovox_cl_watch(void (*change)(int by));
/* OpenCL's objects that were made and not released. */
long pyrovox_cl_objects(void);

#endif
