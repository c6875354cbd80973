/* segment.h - the writer's side of pyrovox_share.h: a name in shared memory, three slots, one of them whole at any
 * time.
 *
 * The name belongs to this writer as long as it lives.  The segment is made without a name, locked, and then linked.
 * So no reader sees half of a segment, and a writer killed before leaves nothing.  A writer killed later leaves its
 * last volume without a lock: by this, readers and the next writer of the same user know that it has died.  A name
 * that belongs to another user or program is never taken.
 * Threads: one. */
#ifndef VOL_SEGMENT_H
#define VOL_SEGMENT_H
#include <stdbool.h>
#include <sys/types.h>

#include "base/err.h"
#include "proto/clients/pyrovox_share.h"

typedef struct vol_segment vol_segment;
/* Makes a segment without room.  mode: who may read, 0600 and more.
 * PVX_EINVAL: not a name; PVX_EBUSY: a process shares under it, or it is something else; PVX_EPERM: it belongs to
 * another user; PVX_ENOSPC, PVX_ENOENT: /dev/shm. */
PVX_MUST_CHECK pvx_err vol_segment_new(const char *name, mode_t mode, vol_segment **out,
                                       struct pvx_diag *d);
/* Replaces the segment by one of the same name, with slots of slot_size bytes and grids of that version of NanoVDB;
 * the old segment ends.  Memory is used only for what is written. */
PVX_MUST_CHECK pvx_err vol_segment_room(vol_segment *s, uint64_t slot_size, uint32_t nanovdb,
                                        struct pvx_diag *d);
uint64_t vol_segment_slot_size(const vol_segment *s);
/* Whether the name is still there: logind removes it when the user has logged out (RemoveIPC). */
bool vol_segment_named(const vol_segment *s);
/* Gives the oldest slot, with memory for `bytes`, to write the next volume to.  PVX_ENOSPC: no memory for it, nothing
 * has changed; PVX_ERANGE: more than a slot has. */
PVX_MUST_CHECK pvx_err vol_segment_begin(vol_segment *s, uint64_t bytes, void **grids,
                                         struct pvx_diag *d);
/* The slot is complete.  about has all members except lock and t_shared_ns. */
void vol_segment_commit(vol_segment *s, const struct pvp_share_slot *about);
/* Removes the name.  What readers have mapped stays valid. */
void vol_segment_free(vol_segment **s);
#endif
