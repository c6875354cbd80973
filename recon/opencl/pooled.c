#include "recon/opencl/pooled.h"

#include <stdlib.h>

#include "base/mem.h"
#include "recon/opencl/kernels/shared.h"

struct rec_cl_pooled {
    rec_cl *cl;
    size_t cameras, n;
    bool sent; /* `of` is on the device */
    struct rec_cl_buffer camera, bin;
    struct rec_cl_coarse of[REC_MAX_CAMERAS];
    struct rec_vote_pooled here[]; /* [n] */
};
_Static_assert(sizeof(struct rec_vote_pooled) == sizeof(struct rec_cl_pooled_bin), "as downloaded");

pvx_err rec_cl_pooled_new(rec_cl *cl, const rec_sysmat *S, const rec_vote *vote,
                          rec_cl_pooled **out, struct pvx_diag *d)
{
    int shift;
    const rec_sysmat *level = rec_vote_level(vote, &shift);
    size_t n = level->row0[level->n_cameras];
    rec_cl_pooled *p = *out = pvx_calloc(1, sizeof *p + n * sizeof *p->here);
    PVX_NEED(p);
    p->cl = cl;
    p->n = n;
    p->cameras = S->n_cameras;
    for (size_t c = 0; c < S->n_cameras; c++)
        p->of[c] = (struct rec_cl_coarse){.first = (int)level->row0[c],
                                          .wide = level->block[c].bw,
                                          .row0 = (int)S->row0[c],
                                          .bw = S->block[c].bw,
                                          .bh = S->block[c].bh,
                                          .side = 1 << shift};
    pvx_err e = rec_cl_buffer_new(cl, p->cameras * sizeof *p->of, &p->camera, d);
    PVX_THEN(e, rec_cl_buffer_new(cl, n * sizeof *p->here, &p->bin, d));
    if (e != PVX_OK)
        rec_cl_pooled_free(out);
    return e;
}

void rec_cl_pooled_free(rec_cl_pooled **pp)
{
    if (*pp == NULL)
        return;
    rec_cl_buffer_free((*pp)->cl, &(*pp)->camera);
    rec_cl_buffer_free((*pp)->cl, &(*pp)->bin);
    PVX_FREE(*pp);
}

const struct rec_vote_pooled *rec_cl_pooled_take(rec_cl_pooled *p, rec_cl_queue *q,
                                                 const struct rec_cl_pictures *in)
{
    const int per_channel = in->w4.bytes > 0, cameras = (int)p->cameras, n = (int)p->n;
    const int cs = in->b.bytes > in->w.bytes ? 4 : 1;
    const struct rec_cl_buffer *w4 = per_channel ? &in->w4 : &in->w; /* it is not read then */
    if (!p->sent)
        rec_cl_upload(q, &p->camera, 0, p->of, p->cameras * sizeof *p->of);
    p->sent = true;
    REC_CL_RUN(q, REC_CL_K_PHOTO_POOL, cs, (p->n + REC_CL_GROUP - 1) / REC_CL_GROUP, REC_CL_GROUP,
               REC_CL_BUFFER(&p->camera), REC_CL_VALUE(cameras), REC_CL_VALUE(n),
               REC_CL_VALUE(per_channel), REC_CL_BUFFER(&in->b), REC_CL_BUFFER(&in->w),
               REC_CL_BUFFER(w4), REC_CL_BUFFER(&in->lit), REC_CL_BUFFER(&p->bin));
    rec_cl_download(q, &p->bin, 0, p->here, p->n * sizeof *p->here);
    return p->here;
}
