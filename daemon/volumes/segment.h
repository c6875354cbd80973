/* segment.h - the writer's side of pyrovox_share.h: a name in shared memory, three slots, one of them whole at any time.
 *
 * The name is this writer's as long as it lives.  The segment is made without a name, locked, and then linked, so that
 * nobody sees half of one and a writer killed before leaves nothing; one that is killed later leaves its last volume and no
 * lock, by which readers and the next writer of the same user tell.  Nobody else's name is ever taken.
 * Threads: one. */
#ifndef VOL_SEGMENT_H
#define VOL_SEGMENT_H
#include <stdbool.h>
#include <sys/types.h>

#include "base/err.h"
#include "proto/clients/pyrovox_share.h"

typedef struct vol_segment vol_segment;
/* A segment without room.  mode: who may read, 0600 and more.
 * PVX_EINVAL: no name; PVX_EBUSY: somebody shares under it, or it is something else's; PVX_EPERM: another user's;
 * PVX_ENOSPC, PVX_ENOENT: /dev/shm. */
PVX_MUST_CHECK pvx_err vol_segment_new(const char *name, mode_t mode, vol_segment **out,
                                       struct pvx_diag *d);
/* Slots of so many bytes, and grids of that version of NanoVDB: another segment under the name, the one before has ended.
 * Memory is used for what is written alone. */
PVX_MUST_CHECK pvx_err vol_segment_room(vol_segment *s, uint64_t slot_size, uint32_t nanovdb,
                                        struct pvx_diag *d);
uint64_t vol_segment_slot_size(const vol_segment *s);
/* Whether the name is still there: logind takes it from a user who has logged out (RemoveIPC). */
bool vol_segment_named(const vol_segment *s);
/* The oldest slot, with memory for `bytes`, to write the next volume to.  PVX_ENOSPC: no memory for it, nothing has changed;
 * PVX_ERANGE: more than a slot has. */
PVX_MUST_CHECK pvx_err vol_segment_begin(vol_segment *s, uint64_t bytes, void **grids,
                                         struct pvx_diag *d);
/* It is whole: about has all but lock and t_shared_ns. */
void vol_segment_commit(vol_segment *s, const struct pvp_share_slot *about);
/* The name goes, what readers have mapped stays theirs. */
void vol_segment_free(vol_segment **s);
#endif
