#include "recon/opencl/rates.h"

#include "base/clock.h"
#include "recon/opencl/impl.h"

#define RATES_BYTES (64u << 20) /* of a buffer; less where a device has little */
#define RATES_NS    (60 * PVX_NS_PER_MS)
#define RATES_LEAST 4

enum rates_way { RATES_COPY, RATES_UP, RATES_DOWN };

struct rates {
    rec_cl *cl;
    struct rec_cl_buffer a, b;
    size_t bytes;
    cl_mem pinned;
    void *here;
};

static cl_int rates_enqueue(struct rates *r, enum rates_way way, cl_event *done)
{
    const struct rec_cl_library *lib = r->cl->lib;
    cl_command_queue q = r->cl->zeroes;
    switch (way) {
    case RATES_COPY:
        return lib->EnqueueCopyBuffer(q, r->a.mem, r->b.mem, 0, 0, r->bytes, 0, NULL, done);
    case RATES_UP:
        return lib->EnqueueWriteBuffer(q, r->a.mem, CL_FALSE, 0, r->bytes, r->here, 0, NULL, done);
    case RATES_DOWN:
        return lib->EnqueueReadBuffer(q, r->a.mem, CL_FALSE, 0, r->bytes, r->here, 0, NULL, done);
    }
    return CL_INVALID_VALUE;
}

static bool rates_done(const struct rates *r, cl_event done)
{
    return rec_cl_ok(r->cl, r->cl->lib->Flush(r->cl->zeroes), "clFlush") &&
           rec_cl_await(r->cl, done);
}

/* Bytes a second of the quickest one; 0: the device is lost. */
static double rates_of(struct rates *r, enum rates_way way)
{
    int64_t begin = pvx_now_mono(), least = INT64_MAX;
    for (int i = 0; i < RATES_LEAST || pvx_now_mono() - begin < RATES_NS; i++) {
        cl_event done = NULL;
        int64_t t0 = pvx_now_mono();
        if (!rec_cl_ok(r->cl, rates_enqueue(r, way, &done), "a transfer") || !rates_done(r, done))
            return 0;
        int64_t ns = pvx_now_mono() - t0;
        least = i > 0 && ns < least ? ns : least; /* the first one touches the pages */
    }
    return (way == RATES_COPY ? 2e9 : 1e9) * (double)r->bytes / (double)(least > 0 ? least : 1);
}

static pvx_err rates_pin(struct rates *r, struct pvx_diag *d)
{
    const struct rec_cl_library *lib = r->cl->lib;
    cl_event done = NULL;
    cl_int e = CL_SUCCESS;
    r->pinned = lib->CreateBuffer(r->cl->context, CL_MEM_READ_WRITE | CL_MEM_ALLOC_HOST_PTR,
                                  r->bytes, NULL, &e);
    if (r->pinned != NULL && e == CL_SUCCESS)
        r->here =
            lib->EnqueueMapBuffer(r->cl->zeroes, r->pinned, CL_FALSE, CL_MAP_READ | CL_MAP_WRITE, 0,
                                  r->bytes, 0, NULL, &done, &e);
    if (r->here == NULL || e != CL_SUCCESS)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for transfers: %s", r->cl->info.name,
                        rec_cl_error(e));
    return rates_done(r, done) ? PVX_OK : PVX_ENODEV;
}

static void rates_unpin(struct rates *r)
{
    const struct rec_cl_library *lib = r->cl->lib;
    cl_event done = NULL;
    if (r->here != NULL &&
        rec_cl_ok(r->cl,
                  lib->EnqueueUnmapMemObject(r->cl->zeroes, r->pinned, r->here, 0, NULL, &done),
                  "clEnqueueUnmapMemObject"))
        (void)rates_done(r, done);
    if (r->pinned != NULL && rec_cl_lost(r->cl) == NULL)
        (void)lib->ReleaseMemObject(r->pinned);
}

static void rates_release(struct rates *r)
{
    if (rec_cl_lost(r->cl) == NULL)
        rates_unpin(r);
    rec_cl_buffer_free(r->cl, &r->a);
    rec_cl_buffer_free(r->cl, &r->b);
    rec_cl_close(&r->cl);
}

pvx_err rec_cl_measure(size_t number, struct rec_cl_rates *out, struct pvx_diag *d)
{
    struct rates r = {.bytes = RATES_BYTES};
    *out = (struct rec_cl_rates){0, 0, 0};
    PVX_TRY(rec_cl_open_bare(number, &r.cl, d));
    if (r.cl->info.largest / 4 < r.bytes)
        r.bytes = (size_t)(r.cl->info.largest / 4);
    pvx_err e = rec_cl_buffer_new(r.cl, r.bytes, &r.a, d);
    PVX_THEN(e, rec_cl_buffer_new(r.cl, r.bytes, &r.b, d));
    PVX_THEN(e, rates_pin(&r, d));
    if (e == PVX_OK)
        *out = (struct rec_cl_rates){.copy = rates_of(&r, RATES_COPY),
                                     .up = rates_of(&r, RATES_UP),
                                     .down = rates_of(&r, RATES_DOWN)};
    if (rec_cl_lost(r.cl) != NULL)
        e = pvx_fail(d, PVX_ENODEV, "%s: %s", r.cl->info.name, rec_cl_lost(r.cl));
    rates_release(&r);
    return e;
}
