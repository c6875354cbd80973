/* slurm.h - a recording's parts as a job array of Slurm, and a job behind it that joins them. */
#ifndef RECONSTRUCT_SLURM_H
#define RECONSTRUCT_SLURM_H
#include "daemon/cli/reconstruct/parts.h"

/* Writes OUT.parts/job.sh and hands it to sbatch: all parts, or with `resume` those that are not done and that nobody solves.
 * argv: the command as it was typed; options: more for sbatch, or NULL.  Prints the jobs' numbers.
 * Errors: PVX_ENOENT (no sbatch), PVX_EINVAL (sbatch refuses: its words; `options` are no words of a shell), PVX_EBUSY
 * (nothing is to be done; parts were begun, without `resume`), those of pvx_file_write.  Where nobody has the job then,
 * OUT.parts is taken away. */
PVX_MUST_CHECK pvx_err reconstruct_slurm(const struct parts_job *j, bool resume, int argc,
                                         char **argv, const char *options, struct pvx_diag *d);
#endif
