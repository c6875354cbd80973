/* strict.h - what the standard allows a driver to do and pocl does not do.  All tests with the shim have such a driver:
 *     - no work begins before its queue is flushed: until then its event is queued;
 *     - what is read is in the host's memory after clWaitForEvents, not before, whatever clGetEventInfo says;
 *     - what is written is taken from the host's memory as late as then: if it has changed, the program ends with 99;
 *     - a kernel's arguments are not for two threads at once: if another one begins with them before the kernel is
 *       enqueued, the program ends with 99. */
#ifndef TESTS_OPENCL_STRICT_H
#define TESTS_OPENCL_STRICT_H
#define CL_TARGET_OPENCL_VERSION 120
#include <CL/cl.h>
#include <stdbool.h>

/* The last command of a queue has this event. */
void strict_enqueued(cl_command_queue q, cl_event event);
/* The last command reads `bytes` by way of `through`, which is malloc's, or writes them; through NULL: it writes. */
void strict_transfer(cl_command_queue q, void *here, void *through, size_t bytes);
void strict_flushed(cl_command_queue q);
bool strict_may_begin(cl_event event);
void strict_waited(cl_event event);
void strict_released(cl_event event);
/* An argument of a kernel was set; it was enqueued, or released. */
void strict_argument(cl_kernel k);
void strict_kernel(cl_kernel k);
/* The queue is no more. */
void strict_forget(cl_command_queue q);

#endif
