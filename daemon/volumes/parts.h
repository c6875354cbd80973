/* parts.h - one recording of volumes that several processes make: which process solves which sets, and how far each is.
 *
 * Beside OUT lies OUT.parts:
 *   job.json               the sets, the number of parts, the rig and the options: the same for all parts
 *   part-0003-of-0008.h5   the volumes of a part (daemon/VOLUMES.md).  .cut-off: the file of a try that died, until its
 *                          volumes are in the new file
 *   part-0003-of-0008.json its progress, replaced once a second
 *   part-0003-of-0008.lock locked (a lock of the open file) while a process solves it
 * A part whose state is "running" but whose lock is free has died.  Clocks are not used: those of two nodes may differ.
 * Threads: one at a time. */
#ifndef VOL_PARTS_H
#define VOL_PARTS_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"

#define PARTS_MAX        100000
#define PARTS_NUMBER_MAX (UINT64_C(1) << 53) /* job.json holds doubles */

struct parts_job {
    const char *out;
    unsigned n;      /* parts */
    const char *rig; /* rig.yaml, and a line an option: the same in all */
    const char *options;
    const char *software;   /* the version that began it, if it was loaded */
    const uint64_t *number; /* [n_sets] ascending, at most PARTS_NUMBER_MAX */
    size_t n_sets;
};

/* The runs are contiguous: part i of n (from 1) has the sets [*first, *end) of the list. */
void parts_run(size_t n_sets, unsigned i, unsigned n, size_t *first, size_t *end);

/* Begins OUT.parts, or finds that it belongs to this job.
 * Errors: PVX_ESTALE (of another job: names what differs), PVX_EFORMAT, PVX_ENOSPC, PVX_EPERM, PVX_EIO. */
PVX_MUST_CHECK pvx_err parts_begin(const struct parts_job *j, struct pvx_diag *d);
/* A number for all of the job: its rig, options and sets. */
uint64_t parts_session(const struct parts_job *j);
/* What parts_begin wrote beside `out`; owner of number, rig and options: caller, parts_free.
 * Errors: PVX_ENOENT (no job there), PVX_EFORMAT, PVX_ENOMEM. */
PVX_MUST_CHECK pvx_err parts_load(const char *out, struct parts_job *j, struct pvx_diag *d);
void parts_free(struct parts_job *j);

enum part_state { PART_NONE, PART_RUNNING, PART_DIED, PART_STOPPED, PART_FAILED, PART_DONE };
extern const char *const part_state_names[];

struct part_status {
    enum part_state state;
    uint64_t sets, done; /* of its run, and of them with a volume */
    double sets_per_s;   /* of the last try */
    double elapsed_s;    /* of all tries */
    char kernels[32]; /* levels of base/cpu.h: "avx2"; "avx2, ref" when a try went on elsewhere */
    int64_t pid;
    char host[256];
    char error[PVX_DIAG_MAX];
};
/* Status of part i; PART_NONE if it cannot be read. */
void parts_status(const struct parts_job *j, unsigned i, struct part_status *out);
/* Name of a part's file; what: "h5", "h5.cut-off", ... */
void parts_path(const struct parts_job *j, unsigned i, const char *what, char *out, size_t size);

typedef struct part part;
/* Lock part i for this process.  resume: continue what an earlier try left, else PVX_EBUSY.
 * *done: nothing is left to do.  Errors: PVX_EBUSY (another process solves it: names host and process), PVX_EPERM, ... */
PVX_MUST_CHECK pvx_err part_take(const struct parts_job *j, unsigned i, bool resume, bool *done,
                                 part **out, struct pvx_diag *d);
/* `done` of its sets are done already.  The rate counts from here. */
void part_begin(part *p, uint64_t done);
/* Set its progress.  While it runs, the file is written at most once a second. */
void part_say(part *p, enum part_state state, uint64_t done, const char *error);
/* Unlock it.  The last progress stays in the file. */
void part_free(part **p);
#endif
