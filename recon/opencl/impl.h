/* impl.h - what is inside a device and a queue.  Private to its .c files (README.md). */
#ifndef REC_CL_IMPL_H
#define REC_CL_IMPL_H
#include <pthread.h>
#include <stdatomic.h>
#include "recon/opencl/library.h"
#include "recon/opencl/run.h"

#define REC_CL_LOCAL_NEEDED 32768 /* bytes that a group shares, at most */

struct rec_cl {
    const struct rec_cl_library *lib;
    cl_platform_id platform;
    cl_device_id device;
    cl_context context;
    cl_program program[REC_CL_N_FILES][2]; /* for 1 and 4 lanes */
    struct rec_cl_info info;
    double patience; /* s */
    /* A queue that zeroes new buffers, one at a time. */
    cl_command_queue zeroes;
    pthread_mutex_t zeroing;
    _Atomic uint64_t used; /* bytes of all buffers */
    _Atomic int lost;      /* 0: no; 1: `why` is being written; 2: yes */
    char why[192];
};

/* A device of a platform, as it was found. */
struct rec_cl_found {
    cl_platform_id platform;
    cl_device_id device;
    struct rec_cl_info info;
    size_t number; /* in the platforms' order */
};
/* To the order of rec_cl_list. */
void rec_cl_sort(struct rec_cl_found *f, size_t n);

/* The device with this number in rec_cl_list, without programs: for measurements. */
PVX_MUST_CHECK pvx_err rec_cl_open_bare(size_t number, rec_cl **out, struct pvx_diag *d);

/* A device is lost once: the first reason stays. */
void rec_cl_lose(rec_cl *cl, const char *fmt, ...) PVX_PRINTF(2, 3);
/* Whether e is CL_SUCCESS; else the device is lost: "what: CL_...". */
bool rec_cl_ok(rec_cl *cl, cl_int e, const char *what);
/* Until `event` is complete; releases it.  false: the device is lost. */
bool rec_cl_await(rec_cl *cl, cl_event event);
/* The same, but work that failed is only said: its error.  CL_SUCCESS: it is done, or the device is lost. */
cl_int rec_cl_settle(rec_cl *cl, cl_event event);

/* Enqueues zeros, by words where it can be, which some drivers do faster. */
static inline cl_int rec_cl_fill(const rec_cl *cl, cl_command_queue queue, cl_mem mem, size_t at,
                                 size_t bytes, cl_event *done)
{
    static const cl_uint4 zero;
    size_t word = at % 16 == 0 && bytes % 16 == 0 ? 16 : at % 4 == 0 && bytes % 4 == 0 ? 4 : 1;
    return cl->lib->EnqueueFillBuffer(queue, mem, &zero, word, at, bytes, 0, NULL, done);
}
/* Something was enqueued: `e` and `*event` are what the driver said. */
void rec_cl_enqueued(rec_cl_queue *q, cl_int e, const cl_event *event, const char *what);

/* All programs of the device, from the cache where they are there. */
PVX_MUST_CHECK pvx_err rec_cl_build(rec_cl *cl, struct pvx_diag *d);

/* Uploads and downloads pass through memory of the driver's own: where a device hangs, and ends its work late after
 * all, it touches no memory of ours. */
#define REC_CL_STAGING (16u << 20) /* bytes */
#define REC_CL_PENDING 64          /* downloads that wait to be copied out, at most */

struct rec_cl_queue {
    rec_cl *cl;
    cl_command_queue queue;
    cl_kernel kernel[REC_CL_N_KERNELS][2]; /* for 1 and 4 lanes: clSetKernelArg is for one thread */
    struct rec_cl_buffer parts, sums, pinned;
    unsigned char *staging;
    size_t used; /* bytes of staging since the last wait */
    struct {
        void *to;
        size_t at, bytes;
    } pending[REC_CL_PENDING];
    size_t n_pending;
    cl_event last; /* of what was enqueued last; NULL: nothing since the last wait */
};

#endif
