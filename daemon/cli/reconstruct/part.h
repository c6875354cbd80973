/* part.h - one part of a recording that several processes reconstruct (parts.h): which sets, and their volumes
 * into its file.  With warm starts and temporal terms a part begins a few sets early, with volumes that are not its own: the
 * last of them goes to part-*.seam.h5, where reconstruct_join compares it with what the part before has. */
#ifndef RECONSTRUCT_PART_H
#define RECONSTRUCT_PART_H
#include "daemon/cli/common/frames_in.h"
#include "daemon/cli/reconstruct/parts.h"
#include "daemon/cli/reconstruct/options.h"
#include "daemon/cli/reconstruct/volumes_out.h"

struct reconstruct_part {
    struct parts_job job;
    part *part;      /* NULL: there are none, OUT is one file */
    bool nothing;    /* it was done before */
    size_t early;    /* sets that are solved before its own */
    uint32_t own;    /* number of its first own set */
    uint64_t done;   /* volumes of it, those of earlier tries included */
    uint64_t copied; /* of them */
    volumes_out *out;
    char *path; /* of the file */
};

/* The part that o says, or all: `in` keeps only its sets.  Nothing is written yet but OUT.parts.
 * Errors: those of parts_begin, part_take and vol_writer_check. */
PVX_MUST_CHECK pvx_err reconstruct_part_begin(struct reconstruct_part *p,
                                              const struct reconstruct_options *o,
                                              const struct rec_rig *rig, struct frames_in *in,
                                              struct pvx_diag *d);
/* Its file, with what an earlier try left; the sets that are done are taken from `in`.  Errors: those of volumes_out. */
PVX_MUST_CHECK pvx_err reconstruct_part_open(struct reconstruct_part *p, const struct rec_rig *rig,
                                             struct frames_in *in, struct pvx_diag *d);
/* A set came out of the pipeline; *own: its volume counts. */
PVX_MUST_CHECK pvx_err reconstruct_part_put(struct reconstruct_part *p, const struct dmn_slot *s,
                                            const struct rec_rig *rig, int nch, bool *own,
                                            struct pvx_diag *d);
/* Closes; e and d: what came of it, e PVX_ECANCELED: stopped.  Returns e, or what closing came to. */
pvx_err reconstruct_part_end(struct reconstruct_part *p, pvx_err e, struct pvx_diag *d);
#endif
