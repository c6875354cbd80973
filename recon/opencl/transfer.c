/* transfer.c - between host and device, through the queue's staging memory. */
#include <string.h>

#include "recon/opencl/impl.h"

/* Room for `bytes` of staging memory. */
static unsigned char *staging_take(rec_cl_queue *q, size_t bytes, size_t *at)
{
    if (q->used + bytes > REC_CL_STAGING && !rec_cl_wait(q))
        return NULL;
    *at = q->used;
    q->used += (bytes + 63) / 64 * 64;
    return q->staging + *at;
}

/* Of what does not fit at once: one half is filled while the other one is on its way. */
static size_t staging_piece(size_t bytes)
{
    return bytes < REC_CL_STAGING / 2 ? bytes : REC_CL_STAGING / 2;
}

void rec_cl_upload(rec_cl_queue *q, const struct rec_cl_buffer *to, size_t at, const void *from,
                   size_t bytes)
{
    const rec_cl *cl = q->cl;
    for (size_t done = 0, n, where; done < bytes && rec_cl_lost(cl) == NULL; done += n) {
        unsigned char *through = staging_take(q, n = staging_piece(bytes - done), &where);
        if (through == NULL)
            return;
        memcpy(through, (const unsigned char *)from + done, n);
        cl_event e = NULL;
        rec_cl_enqueued(q,
                        cl->lib->EnqueueWriteBuffer(q->queue, to->mem, CL_FALSE, at + done, n,
                                                    through, 0, NULL, &e),
                        &e, "clEnqueueWriteBuffer");
        if (n == REC_CL_STAGING / 2)
            (void)cl->lib->Flush(q->queue);
    }
}

void rec_cl_download(rec_cl_queue *q, const struct rec_cl_buffer *from, size_t at, void *to,
                     size_t bytes)
{
    const rec_cl *cl = q->cl;
    for (size_t done = 0, n, where; done < bytes && rec_cl_lost(cl) == NULL; done += n) {
        if (q->n_pending == REC_CL_PENDING && !rec_cl_wait(q))
            return;
        unsigned char *through = staging_take(q, n = staging_piece(bytes - done), &where);
        if (through == NULL)
            return;
        cl_event e = NULL;
        rec_cl_enqueued(q,
                        cl->lib->EnqueueReadBuffer(q->queue, from->mem, CL_FALSE, at + done, n,
                                                   through, 0, NULL, &e),
                        &e, "clEnqueueReadBuffer");
        q->pending[q->n_pending].to = (unsigned char *)to + done;
        q->pending[q->n_pending].at = where;
        q->pending[q->n_pending++].bytes = n;
    }
}

void rec_cl_copy(rec_cl_queue *q, const struct rec_cl_buffer *from, size_t from_at,
                 const struct rec_cl_buffer *to, size_t to_at, size_t bytes)
{
    cl_event e = NULL;
    if (bytes > 0 && rec_cl_lost(q->cl) == NULL)
        rec_cl_enqueued(q,
                        q->cl->lib->EnqueueCopyBuffer(q->queue, from->mem, to->mem, from_at, to_at,
                                                      bytes, 0, NULL, &e),
                        &e, "clEnqueueCopyBuffer");
}

void rec_cl_zero(rec_cl_queue *q, const struct rec_cl_buffer *b, size_t at, size_t bytes)
{
    cl_event e = NULL;
    if (bytes > 0 && rec_cl_lost(q->cl) == NULL)
        rec_cl_enqueued(q, rec_cl_fill(q->cl, q->queue, b->mem, at, bytes, &e), &e,
                        "clEnqueueFillBuffer");
}
