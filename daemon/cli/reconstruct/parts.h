/* parts.h - one recording of volumes that several processes make: who solves which run of its sets, how far each is.
 *
 * Beside OUT lies OUT.parts:
 *   job.json               the sets, dealt into how many parts, of which rig, with which options: the same for all
 *   part-0003-of-0008.h5   the volumes of a part (daemon/VOLUMES.md); .cut-off: what a try left that died, until its volumes
 *                          are in the new file
 *   part-0003-of-0008.json how far it is, replaced once a second
 *   part-0003-of-0008.lock held (a lock of the open file) while somebody solves it
 * A part that says "running" while nobody holds its lock has died, whatever any clock says: those of two nodes may differ.
 * Threads: one at a time. */
#ifndef CLI_PARTS_H
#define CLI_PARTS_H
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"

#define PARTS_MAX 100000

struct parts_job {
    const char *out;
    unsigned n;      /* parts */
    const char *rig; /* rig.yaml, and a line an option: the same in all */
    const char *options;
    const char *software;   /* who began it, where it was loaded */
    const uint32_t *number; /* [n_sets] ascending */
    size_t n_sets;
};

/* The runs are contiguous: part i of n (from 1) has the sets [*first, *end) of the list. */
void parts_run(size_t n_sets, unsigned i, unsigned n, size_t *first, size_t *end);

/* Begins OUT.parts, or finds that it is of this very job.
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
/* How part i is; of what cannot be read PART_NONE. */
void parts_status(const struct parts_job *j, unsigned i, struct part_status *out);
/* Name of a part's file; what: "h5", "h5.cut-off", ... */
void parts_path(const struct parts_job *j, unsigned i, const char *what, char *out, size_t size);

typedef struct part part;
/* Part i for this process alone.  resume: what an earlier try left is gone on with, else PVX_EBUSY.
 * *done: there is nothing left to do.  Errors: PVX_EBUSY (somebody solves it: names host and process), PVX_EPERM, ... */
PVX_MUST_CHECK pvx_err part_take(const struct parts_job *j, unsigned i, bool resume, bool *done,
                                 part **out, struct pvx_diag *d);
/* Of its sets `done` are done from before: the rate counts from here. */
void part_begin(part *p, uint64_t done);
/* How far it is; writes at most once a second while it runs. */
void part_say(part *p, enum part_state state, uint64_t done, const char *error);
/* Gives it back; what was said last stays. */
void part_free(part **p);
#endif
