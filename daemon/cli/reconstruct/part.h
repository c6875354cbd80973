/* part.h - one part of a recording that several processes reconstruct (parts.h): chooses its sets and writes their
 * volumes into the file of the part.  With warm starts and temporal terms a part begins a few sets early.  The
 * volumes of these sets are not its own.  The last of them goes to part-*.seam.h5; reconstruct_join compares it with
 * the same volume of the part before. */
#ifndef RECONSTRUCT_PART_H
#define RECONSTRUCT_PART_H
#include "daemon/cli/common/frames_in.h"
#include "daemon/volumes/parts.h"
#include "daemon/cli/reconstruct/options.h"
#include "daemon/cli/reconstruct/volumes_out.h"

struct reconstruct_part {
    struct parts_job job;
    part *part;      /* NULL: there are none, OUT is one file */
    bool nothing;    /* the part was done before */
    size_t early;    /* sets that are solved before its own */
    uint64_t own;    /* number of its first own set */
    uint64_t done;   /* volumes of the part, those of earlier tries included */
    uint64_t copied; /* of these, volumes of earlier tries */
    volumes_out *out;
    char *path;       /* of the part's file */
    const char *said; /* the options, borrowed */
};

/* Take the part that o names, or all sets.  `in` keeps only its sets.  Of files, only OUT.parts is written.
 * Errors: those of parts_begin, part_take and vol_writer_check. */
PVX_MUST_CHECK pvx_err reconstruct_part_begin(struct reconstruct_part *p,
                                              const struct reconstruct_options *o,
                                              const struct rec_rig *rig, struct frames_in *in,
                                              struct pvx_diag *d);
/* Open its file and copy the volumes of an earlier try into it.  Sets that are done are removed from `in`.
 * Errors: those of volumes_out. */
PVX_MUST_CHECK pvx_err reconstruct_part_open(struct reconstruct_part *p, const struct rec_rig *rig,
                                             struct frames_in *in, struct pvx_diag *d);
/* Take a set from the pipeline.  *own: whether the volume belongs to this part. */
PVX_MUST_CHECK pvx_err reconstruct_part_put(struct reconstruct_part *p, const struct dmn_slot *s,
                                            const struct rec_rig *rig, int nch, bool *own,
                                            struct pvx_diag *d);
/* Close.  e and d: the result so far; PVX_ECANCELED: stopped.  Returns e, or the error of closing. */
pvx_err reconstruct_part_end(struct reconstruct_part *p, pvx_err e, struct pvx_diag *d);
#endif
