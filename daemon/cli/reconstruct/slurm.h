/* slurm.h - submit the parts of a recording to Slurm as a job array, and a job that joins them afterwards. */
#ifndef RECONSTRUCT_SLURM_H
#define RECONSTRUCT_SLURM_H
#include "daemon/volumes/parts.h"

/* Writes OUT.parts/job.sh and submits it with sbatch: all parts, or with `resume` those that are neither done nor
 * running.  argv: the command as it was typed.  options: more options for sbatch, or NULL.  Prints the numbers of the
 * jobs.  Errors: PVX_ENOENT (no sbatch), PVX_EINVAL (sbatch refuses, with its words, or `options` are not words of a
 * shell), PVX_EBUSY (nothing is left to do, or parts were begun and `resume` is false), those of pvx_file_write.  If
 * no job was submitted, OUT.parts is deleted. */
PVX_MUST_CHECK pvx_err reconstruct_slurm(const struct parts_job *j, bool resume, int argc,
                                         char **argv, const char *options, struct pvx_diag *d);
#endif
