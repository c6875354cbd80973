#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/opencl/impl.h"

/* Pinned memory: a card reads and writes it by itself. */
static pvx_err queue_pin(rec_cl_queue *q, struct pvx_diag *d)
{
    rec_cl *cl = q->cl;
    cl_int e = CL_SUCCESS;
    q->pinned.mem = cl->lib->CreateBuffer(cl->context, CL_MEM_READ_WRITE | CL_MEM_ALLOC_HOST_PTR,
                                          REC_CL_STAGING, NULL, &e);
    if (q->pinned.mem == NULL || e != CL_SUCCESS)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for transfers: %s", cl->info.name,
                        rec_cl_error(e));
    cl_event done = NULL;
    q->staging =
        cl->lib->EnqueueMapBuffer(q->queue, q->pinned.mem, CL_FALSE, CL_MAP_READ | CL_MAP_WRITE, 0,
                                  REC_CL_STAGING, 0, NULL, &done, &e);
    if (q->staging == NULL || e != CL_SUCCESS)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for transfers: %s", cl->info.name,
                        rec_cl_error(e));
    rec_cl_enqueued(q, e, &done, "clEnqueueMapBuffer");
    return rec_cl_wait(q) ? PVX_OK
                          : pvx_fail(d, PVX_ENODEV, "%s: %s", cl->info.name, rec_cl_lost(cl));
}

/* Groups of a kernel have the size that its text says.  A kernel may need so many registers that a device has too few
 * for that, whatever size it allows in general. */
static pvx_err queue_fits(const rec_cl *cl, cl_kernel kernel, const char *name, struct pvx_diag *d)
{
    size_t most = 0, asked[3] = {0, 0, 0};
    cl_int e = cl->lib->GetKernelWorkGroupInfo(kernel, cl->device, CL_KERNEL_WORK_GROUP_SIZE,
                                               sizeof most, &most, NULL);
    if (e == CL_SUCCESS)
        e = cl->lib->GetKernelWorkGroupInfo(kernel, cl->device, CL_KERNEL_COMPILE_WORK_GROUP_SIZE,
                                            sizeof asked, asked, NULL);
    if (e != CL_SUCCESS)
        return pvx_fail(d, PVX_ENODEV, "%s: kernel %s: %s", cl->info.name, name, rec_cl_error(e));
    if (most < asked[0])
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: kernel %s: its groups have at most %zu items there, and %zu are "
                        "needed",
                        cl->info.name, name, most, asked[0]);
    return PVX_OK;
}

static pvx_err queue_kernels(rec_cl_queue *q, struct pvx_diag *d)
{
    rec_cl *cl = q->cl;
    for (int k = 0; k < REC_CL_N_KERNELS; k++)
        for (int four = 0; four < 2; four++) {
            cl_int e = CL_SUCCESS;
            const struct rec_cl_kernel_name *of = &rec_cl_kernel_names[k];
            q->kernel[k][four] = cl->lib->CreateKernel(cl->program[of->file][four], of->name, &e);
            if (q->kernel[k][four] == NULL || e != CL_SUCCESS)
                return pvx_fail(d, PVX_ENODEV, "%s: kernel %s: %s", cl->info.name, of->name,
                                rec_cl_error(e));
            PVX_TRY(queue_fits(cl, q->kernel[k][four], of->name, d));
        }
    return PVX_OK;
}

static pvx_err queue_fill(rec_cl_queue *q, struct pvx_diag *d)
{
    rec_cl *cl = q->cl;
    cl_int e = CL_SUCCESS;
    q->queue = cl->lib->CreateCommandQueue(cl->context, cl->device, 0, &e);
    if (q->queue == NULL || e != CL_SUCCESS)
        return pvx_fail(d, PVX_ENODEV, "%s: clCreateCommandQueue: %s", cl->info.name,
                        rec_cl_error(e));
    PVX_TRY(queue_pin(q, d));
    PVX_TRY(rec_cl_buffer_new(cl, sizeof(cl_double4) * REC_CL_SUMS * REC_CL_PARTS, &q->parts, d));
    PVX_TRY(rec_cl_buffer_new(cl, sizeof(cl_double4) * REC_CL_SUMS, &q->sums, d));
    return queue_kernels(q, d);
}

pvx_err rec_cl_queue_new(rec_cl *cl, rec_cl_queue **out, struct pvx_diag *d)
{
    *out = NULL;
    if (rec_cl_lost(cl) != NULL)
        return pvx_fail(d, PVX_ENODEV, "%s: %s", cl->info.name, rec_cl_lost(cl));
    rec_cl_queue *q = pvx_calloc(1, sizeof *q);
    PVX_NEED(q);
    q->cl = cl;
    pvx_err e = queue_fill(q, d);
    if (e != PVX_OK)
        rec_cl_queue_free(&q);
    *out = q;
    return e;
}

/* What a device that answers gives back. */
static void queue_release(rec_cl_queue *q)
{
    const struct rec_cl_library *lib = q->cl->lib;
    for (int k = 0; k < REC_CL_N_KERNELS; k++)
        for (int four = 0; four < 2; four++)
            if (q->kernel[k][four] != NULL)
                (void)lib->ReleaseKernel(q->kernel[k][four]);
    cl_event e = NULL;
    if (q->staging != NULL) {
        rec_cl_enqueued(
            q, lib->EnqueueUnmapMemObject(q->queue, q->pinned.mem, q->staging, 0, NULL, &e), &e,
            "clEnqueueUnmapMemObject");
        if (!rec_cl_wait(q))
            return;
    }
    if (q->pinned.mem != NULL)
        (void)lib->ReleaseMemObject(q->pinned.mem);
    if (q->queue != NULL)
        (void)lib->ReleaseCommandQueue(q->queue);
}

void rec_cl_queue_free(rec_cl_queue **q)
{
    if (*q == NULL)
        return;
    if (rec_cl_wait(*q))
        queue_release(*q);
    rec_cl_buffer_free((*q)->cl, &(*q)->parts);
    rec_cl_buffer_free((*q)->cl, &(*q)->sums);
    PVX_FREE(*q);
}

rec_cl *rec_cl_of(const rec_cl_queue *q)
{
    return q->cl;
}

void rec_cl_enqueued(rec_cl_queue *q, cl_int e, const cl_event *event, const char *what)
{
    if (!rec_cl_ok(q->cl, e, what))
        return;
    if (q->last != NULL)
        (void)rec_cl_ok(q->cl, q->cl->lib->ReleaseEvent(q->last), "clReleaseEvent");
    q->last = *event;
}

bool rec_cl_wait(rec_cl_queue *q)
{
    rec_cl *cl = q->cl;
    if (q->last != NULL && rec_cl_lost(cl) == NULL &&
        rec_cl_ok(cl, cl->lib->Flush(q->queue), "clFlush") && rec_cl_await(cl, q->last))
        for (size_t i = 0; i < q->n_pending; i++)
            memcpy(q->pending[i].to, q->staging + q->pending[i].at, q->pending[i].bytes);
    q->last = NULL;
    q->n_pending = 0;
    q->used = 0;
    return rec_cl_lost(cl) == NULL;
}

void rec_cl_after(rec_cl_queue *q, rec_cl_queue *of)
{
    const struct rec_cl_library *lib = q->cl->lib;
    cl_event e = NULL;
    if (of->last == NULL || rec_cl_lost(q->cl) != NULL ||
        !rec_cl_ok(q->cl, lib->Flush(of->queue), "clFlush"))
        return;
    rec_cl_enqueued(q, lib->EnqueueBarrierWithWaitList(q->queue, 1, &of->last, &e), &e,
                    "clEnqueueBarrierWithWaitList");
}

void rec_cl_run(rec_cl_queue *q, struct rec_cl_launch how, const struct rec_cl_arg *arg, size_t n)
{
    rec_cl *cl = q->cl;
    const char *name = rec_cl_kernel_names[how.k].name;
    cl_kernel kernel = q->kernel[how.k][how.cs == 4];
    size_t all = how.groups * how.items;
    if (how.groups == 0 || rec_cl_lost(cl) != NULL)
        return;
    for (size_t i = 0; i < n; i++) {
        cl_int e = cl->lib->SetKernelArg(kernel, (cl_uint)i, arg[i].size, arg[i].value);
        if (e != CL_SUCCESS) {
            rec_cl_lose(cl, "kernel %s, argument %zu: %s", name, i, rec_cl_error(e));
            return;
        }
    }
    cl_event event = NULL;
    rec_cl_enqueued(
        q,
        cl->lib->EnqueueNDRangeKernel(q->queue, kernel, 1, NULL, &all, &how.items, 0, NULL, &event),
        &event, name);
}

const struct rec_cl_buffer *rec_cl_parts(const rec_cl_queue *q)
{
    return &q->parts;
}

bool rec_cl_sums(rec_cl_queue *q, const uint32_t *groups, size_t n, double (*out)[4])
{
    cl_uint16 counts = {{0}};
    for (size_t i = 0; i < n; i++)
        counts.s[i] = groups[i];
    memset(out, 0, n * sizeof *out);
    REC_CL_RUN(q, REC_CL_K_ADD_PARTS, 1, n, REC_CL_GROUP, REC_CL_BUFFER(&q->parts),
               REC_CL_VALUE(counts), REC_CL_BUFFER(&q->sums));
    rec_cl_download(q, &q->sums, 0, out, n * sizeof *out);
    if (rec_cl_wait(q))
        return true;
    memset(out, 0, n * sizeof *out);
    return false;
}
