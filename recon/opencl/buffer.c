#include "recon/opencl/impl.h"

/* Zeroes a new buffer: many drivers find only now that they have no room, some even while they do it. */
static cl_int buffer_zero(rec_cl *cl, cl_mem mem, size_t bytes)
{
    cl_event done = NULL;
    cl_int e = rec_cl_fill(cl, cl->zeroes, mem, 0, bytes, &done);
    if (e != CL_SUCCESS)
        return e;
    return rec_cl_ok(cl, cl->lib->Flush(cl->zeroes), "clFlush") ? rec_cl_settle(cl, done)
                                                                : CL_SUCCESS;
}

static pvx_err buffer_no_room(const rec_cl *cl, size_t bytes, cl_int e, struct pvx_diag *d)
{
    double gb = 1e-9, used = gb * (double)atomic_load(&cl->used),
           all = gb * (double)cl->info.memory;
    double lacks = used + gb * (double)bytes - all;
    if (bytes > cl->info.largest)
        return pvx_fail(d, PVX_ENOMEM, "%s: a buffer of %.3g GB is needed, and it has at most %.3g",
                        cl->info.name, gb * (double)bytes, gb * (double)cl->info.largest);
    if (lacks > 0)
        return pvx_fail(
            d, PVX_ENOMEM,
            "%s: it has no room for %.3g GB: it lacks %.3g GB, this program uses %.3g of "
            "%.3g GB",
            cl->info.name, gb * (double)bytes, lacks, used, all);
    return pvx_fail(
        d, PVX_ENOMEM,
        "%s: it has no room for %.3g GB (%s): this program uses %.3g of %.3g GB, others "
        "the rest",
        cl->info.name, gb * (double)bytes, rec_cl_error(e), used, all);
}

/* A driver may give more than what it calls the largest buffer, as NVIDIA's does, which says a quarter of the memory. */
static bool buffer_is_room(const rec_cl *cl, size_t bytes, cl_int e)
{
    if (e != CL_SUCCESS && bytes > cl->info.largest)
        return true;
    return e == CL_MEM_OBJECT_ALLOCATION_FAILURE || e == CL_OUT_OF_RESOURCES ||
           e == CL_OUT_OF_HOST_MEMORY || e == CL_INVALID_BUFFER_SIZE;
}

pvx_err rec_cl_buffer_new(rec_cl *cl, size_t bytes, struct rec_cl_buffer *out, struct pvx_diag *d)
{
    cl_int e = CL_SUCCESS;
    *out = (struct rec_cl_buffer){NULL, 0};
    if (bytes == 0)
        return PVX_OK;
    if (rec_cl_lost(cl) != NULL)
        return pvx_fail(d, PVX_ENODEV, "%s: %s", cl->info.name, rec_cl_lost(cl));
    if (atomic_load(&cl->used) + bytes > cl->info.memory)
        return buffer_no_room(cl, bytes, e, d);
    cl_mem mem = cl->lib->CreateBuffer(cl->context, CL_MEM_READ_WRITE, bytes, NULL, &e);
    if (mem != NULL && e == CL_SUCCESS) {
        pthread_mutex_lock(&cl->zeroing);
        e = buffer_zero(cl, mem, bytes);
        pthread_mutex_unlock(&cl->zeroing);
        if (e != CL_SUCCESS)
            (void)cl->lib->ReleaseMemObject(mem);
    }
    if (buffer_is_room(cl, bytes, e))
        return buffer_no_room(cl, bytes, e, d);
    (void)rec_cl_ok(cl, e, "clCreateBuffer");
    if (rec_cl_lost(cl) != NULL)
        return pvx_fail(d, PVX_ENODEV, "%s: %s", cl->info.name, rec_cl_lost(cl));
    atomic_fetch_add(&cl->used, bytes);
    *out = (struct rec_cl_buffer){mem, bytes};
    return PVX_OK;
}

void rec_cl_buffer_free(rec_cl *cl, struct rec_cl_buffer *b)
{
    if (b->mem != NULL) {
        atomic_fetch_sub(&cl->used, b->bytes);
        if (rec_cl_lost(cl) == NULL)
            (void)rec_cl_ok(cl, cl->lib->ReleaseMemObject(b->mem), "clReleaseMemObject");
    }
    *b = (struct rec_cl_buffer){NULL, 0};
}
