/* upload.h - the matrix on its way to a device (matrix.c, upload.c, rows.c).  Not for other rooms. */
#ifndef REC_CL_UPLOAD_H
#define REC_CL_UPLOAD_H
#include "recon/opencl/matrix.h"

/* Launches are cut, so that even a slow device answers in time. */
#define REC_CL_LAUNCH 65536 /* pairs, or bricks in a camera */

/* Makes a buffer; `what` it has in the message.  All arrays from the host, in one go. */
PVX_MUST_CHECK pvx_err rec_cl_part_new(rec_cl *cl, const char *what, size_t bytes,
                                       struct rec_cl_buffer *out, struct pvx_diag *d);
PVX_MUST_CHECK pvx_err rec_cl_part_from(rec_cl_queue *q, const char *what, const void *from,
                                        size_t bytes, struct rec_cl_buffer *out,
                                        struct pvx_diag *d);

/* Which bricks are stored: l->store, l->brick. */
struct rec_cl_order {
    const int32_t *store;
    const uint32_t *brick;
};
/* l->at, w, more, more_from. */
PVX_MUST_CHECK pvx_err rec_cl_upload_columns(rec_cl_queue *q, struct rec_cl_level *l,
                                             const struct rec_cl_order *o, struct pvx_diag *d);
/* l->fp, rect. */
PVX_MUST_CHECK pvx_err rec_cl_upload_footprints(rec_cl_queue *q, struct rec_cl_level *l,
                                                const struct rec_cl_order *o, struct pvx_diag *d);
/* Pairs and rows, on the device from the columns. */
PVX_MUST_CHECK pvx_err rec_cl_make_rows(rec_cl_queue *q, struct rec_cl_level *l,
                                        struct pvx_diag *d);

#endif
