#include "recon/opencl/photo_impl.h"

static struct rec_cl_raw_picture unpack_picture(const struct rec_cl_raw *r, size_t at)
{
    struct rec_cl_raw_picture o = {.at = (uint32_t)at,
                                   .stride = (uint32_t)r->stride,
                                   .layout = (int)r->layout,
                                   .depth = r->depth,
                                   .width = r->width,
                                   .height = r->height,
                                   .binning = r->binning,
                                   .samples = r->samples,
                                   .grey = r->grey,
                                   .swapped = r->swapped,
                                   .rays = r->rays,
                                   .bayer = r->cell != NULL,
                                   .clip = r->clip,
                                   .full = (float)((1u << r->depth) - 1),
                                   .most = r->most};
    for (int k = 0; k < 4 && r->cell != NULL; k++)
        o.cell[k] = r->cell[k];
    return o;
}

bool rec_cl_photo_unpack(rec_cl_photo *p, rec_cl_queue *q, const struct rec_photo_image *im,
                         const struct rec_cl_raw *raw, const struct rec_cl_pictures *to)
{
    size_t all = 0, at = 0;
    for (size_t c = 0; c < p->cameras; c++)
        all += raw[c].layout != REC_CL_LAYOUT_NONE ? raw[c].bytes : 0;
    if (all > p->bytes.bytes || all > UINT32_MAX)
        return false;
    for (size_t c = 0; c < p->cameras; c++) {
        p->raws[c] = (struct rec_cl_raw_picture){0};
        if (raw[c].layout == REC_CL_LAYOUT_NONE)
            continue;
        p->raws[c] = unpack_picture(&raw[c], at);
        rec_cl_upload(q, &p->bytes, at, raw[c].data, raw[c].bytes);
        at += raw[c].bytes;
    }
    if (at == 0)
        return true;
    rec_cl_photo_send(p, q, im);
    rec_cl_upload(q, &p->raw_picture, 0, p->raws, p->cameras * sizeof *p->raws);
    REC_CL_RUN(q, REC_CL_K_UNPACK, (int)p->cs, p->bands, REC_CL_FLAT, REC_CL_BUFFER(&p->shot),
               REC_CL_BUFFER(&p->raw_picture), REC_CL_BUFFER(&p->at), REC_CL_BUFFER(&p->bytes),
               REC_CL_BUFFER(&to->b));
    return true;
}
