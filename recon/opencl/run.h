/* run.h - a queue of a device, its buffers and its kernels.  Private to recon/opencl.
 *
 * Everything that is enqueued runs in order.  Kernels are listed in kernels.h.
 * Sums: a kernel's group writes its part to `parts` of the queue (kernels/common.cl); rec_cl_sums adds the parts up in
 * a fixed order.  So results do not change from run to run.
 * Threads: one per queue; queues of a device run side by side.  After ..._new nothing allocates. */
#ifndef REC_CL_RUN_H
#define REC_CL_RUN_H
#define CL_TARGET_OPENCL_VERSION 120
#include <CL/cl.h>
#include "recon/opencl/device.h"
#include "recon/opencl/kernels.h"

#define REC_CL_GROUP 64  /* items of a group: the voxels of a brick, the bins of a tile */
#define REC_CL_FLAT  256 /* items of a group of a loop over floats */
#define REC_CL_PARTS 512 /* groups that write a sum, at most */
#define REC_CL_SUMS  16  /* sums that are read at a time, at most */

struct rec_cl_buffer {
    cl_mem mem;
    size_t bytes;
};
/* Zeroed.  0 bytes give a buffer that is not used.  PVX_ENOMEM: the device has no room; diag: how much it lacks. */
PVX_MUST_CHECK pvx_err rec_cl_buffer_new(rec_cl *cl, size_t bytes, struct rec_cl_buffer *out,
                                         struct pvx_diag *d);
void rec_cl_buffer_free(rec_cl *cl, struct rec_cl_buffer *b);

typedef struct rec_cl_queue rec_cl_queue;
PVX_MUST_CHECK pvx_err rec_cl_queue_new(rec_cl *cl, rec_cl_queue **out, struct pvx_diag *d);
void rec_cl_queue_free(rec_cl_queue **q);
rec_cl *rec_cl_of(const rec_cl_queue *q);

/* `from` may be changed at once; `to` is written by rec_cl_wait.  Offsets are in bytes. */
void rec_cl_upload(rec_cl_queue *q, const struct rec_cl_buffer *to, size_t at, const void *from,
                   size_t bytes);
void rec_cl_download(rec_cl_queue *q, const struct rec_cl_buffer *from, size_t at, void *to,
                     size_t bytes);
void rec_cl_copy(rec_cl_queue *q, const struct rec_cl_buffer *from, size_t from_at,
                 const struct rec_cl_buffer *to, size_t to_at, size_t bytes);
void rec_cl_zero(rec_cl_queue *q, const struct rec_cl_buffer *b, size_t at, size_t bytes);
/* Until all that was enqueued is done.  false: the device is lost; then nothing that was downloaded counts. */
bool rec_cl_wait(rec_cl_queue *q);
/* The same for what `of` has enqueued so far, on the device: later work of q begins after it. */
void rec_cl_after(rec_cl_queue *q, rec_cl_queue *of);

/* An argument of a kernel. */
struct rec_cl_arg {
    const void *value;
    size_t size;
};
#define REC_CL_BUFFER(b) \
    ((struct rec_cl_arg){&(b)->mem, sizeof(cl_mem)})               /* of a buffer's address */
#define REC_CL_VALUE(v)     ((struct rec_cl_arg){&(v), sizeof(v)}) /* of a variable */
#define REC_CL_LOCAL(bytes) ((struct rec_cl_arg){NULL, (bytes)})
/* Enqueues kernel k for cs lanes: `groups` groups of `items` items.  0 groups: nothing. */
struct rec_cl_launch {
    enum rec_cl_kernel k;
    int cs;
    size_t groups, items;
};
void rec_cl_run(rec_cl_queue *q, struct rec_cl_launch how, const struct rec_cl_arg *arg, size_t n);
#define REC_CL_RUN(q, kernel, lanes, n_groups, n_items, ...)                \
    rec_cl_run(q, (struct rec_cl_launch){kernel, lanes, n_groups, n_items}, \
               (const struct rec_cl_arg[]){__VA_ARGS__},                    \
               sizeof((const struct rec_cl_arg[]){__VA_ARGS__}) / sizeof(struct rec_cl_arg))

/* The queue's parts: [REC_CL_SUMS][REC_CL_PARTS] of double4. */
const struct rec_cl_buffer *rec_cl_parts(const rec_cl_queue *q);
/* out[i]: the sum of parts of slot i over groups[i] groups, i < n.  Waits.  Lost: all 0, false. */
bool rec_cl_sums(rec_cl_queue *q, const uint32_t *groups, size_t n, double (*out)[4]);
/* Groups of a flat loop over n items: at most REC_CL_PARTS; each takes a whole piece of the range (common.cl). */
static inline size_t rec_cl_groups(size_t n)
{
    size_t g = (n + REC_CL_FLAT - 1) / REC_CL_FLAT;
    return g < REC_CL_PARTS ? g : REC_CL_PARTS;
}

#endif
