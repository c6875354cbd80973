/* pooled.h - the pictures that the vote reads, made on a device: vote/pooled.c to the bit.
 * Ownership: a carver's.  Threads: one at a time.  After rec_cl_pooled_new nothing allocates.  Private to recon. */
#ifndef REC_CL_POOLED_H
#define REC_CL_POOLED_H
#include "recon/matrix/sysmat.h"
#include "recon/opencl/photo.h"
#include "recon/vote/vote.h"

typedef struct rec_cl_pooled rec_cl_pooled;

/* From the bins of S to those of rec_vote_level.  Errors: PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err rec_cl_pooled_new(rec_cl *cl, const rec_sysmat *S, const rec_vote *vote,
                                         rec_cl_pooled **out, struct pvx_diag *d);
void rec_cl_pooled_free(rec_cl_pooled **p);
/* [rows of the level], valid after rec_cl_wait, for rec_vote_set.pooled.  Enqueues and returns. */
const struct rec_vote_pooled *rec_cl_pooled_take(rec_cl_pooled *p, rec_cl_queue *q,
                                                 const struct rec_cl_pictures *in);

#endif
