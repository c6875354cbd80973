/* instant.h - one frame set kept for `snapshot`: its raw frames, its volume and the status, as a folder of files.
 *
 * The carve stage keeps a reference to the set, so each camera needs one more frame buffer.  The last stage copies
 * the volume into memory that is there.  Neither stage waits or allocates.  If the set is dropped on the way, the
 * next one is taken.
 * Threads: look: the carve stage; volume: the last stage; take: one other thread at a time. */
#ifndef DMN_INSTANT_H
#define DMN_INSTANT_H
#include <stdatomic.h>
#include "capture/take/take.h"
#include "daemon/pipeline/pipeline.h"
#include "proto/pvp.h"

typedef struct dmn_instant dmn_instant;
/* stopping: borrowed; while it is true, take does not wait. */
PVX_MUST_CHECK pvx_err dmn_instant_new(const struct rec_grid *g, int nch,
                                       const atomic_bool *stopping, dmn_instant **out);
void dmn_instant_free(dmn_instant **in); /* after both stages have ended */

/* Call with each set that is handed on; in may be NULL. */
void dmn_instant_look(dmn_instant *in, struct cap_set *s);
/* Call with each volume that was published; in may be NULL. */
void dmn_instant_volume(dmn_instant *in, const struct pvp_volume *m, const struct rec_sparse *v);

struct dmn_instant_got {
    struct cap_set *set;
    struct pvp_volume volume;
    struct rec_sparse x; /* n, cs, nch, index, value */
};
/* Waits for the next set and its volume, which stay valid until dmn_instant_done.  voxels: expected number.
 * PVX_ETIMEDOUT: no set came for 5 s, or no volume of one within 30 s; PVX_ECANCELED: the daemon stops; PVX_ENOMEM.
 */
PVX_MUST_CHECK pvx_err dmn_instant_take(dmn_instant *in, size_t voxels, struct dmn_instant_got *out,
                                        struct pvx_diag *d);
void dmn_instant_done(dmn_instant *in, struct dmn_instant_got *got);

/* What else goes into the files. */
struct dmn_instant_about {
    struct pvp_start start;
    struct cap_take_head head; /* rig and config are the volume's too */
    const char *status;        /* JSON */
    uint64_t keep_free_bytes;
    void (*health)(void *ctx, uint32_t camera, struct cap_health *out);
    void *ctx;
};
/* Checks that `folder` can be made, and makes its parent.  PVX_EBUSY: it is there already; PVX_EPERM ... */
PVX_MUST_CHECK pvx_err dmn_instant_place(const char *folder, struct pvx_diag *d);
/* Writes folder/: SET.npy and SET.json with recording.json, rig.yaml and config.yaml (a recording of one volume),
 * raw.h5 (a take of one set), status.json.  The folder appears only when it is complete; while it is written it is
 * called folder.part.  PVX_ENOSPC, PVX_EIO ... */
PVX_MUST_CHECK pvx_err dmn_instant_write(const char *folder, const struct dmn_instant_got *got,
                                         const struct dmn_instant_about *about, struct pvx_diag *d);
#endif
