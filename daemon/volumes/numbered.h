/* numbered.h - files numbered without holes, as Blender and Unreal want them: DIR/NAME_0001.vdb and on, where NAME is
 * the folder's name, and DIR/NAME.json, which says what each file shows.
 *
 * Frame = 1 + set - first set; with `fps` = 1 + round((time - first time) * fps).  A frame without a volume of its
 * own repeats the one before (as a link if the file system has links).  A volume whose frame is taken is left out.
 * Counting goes on with the next frame after a new session, after a hole of more than VOL_HOLE_MAX frames and, with
 * `fps`, after a clock that was set back.
 * NAME.json, rig.yaml and pyrovoxd.yaml lie beside the files.  NAME.json is written at the beginning, and again at
 * the end with `closed` true and what each frame shows.  If it is not closed, the recording was cut off: the files
 * that are there are whole, and vol_repair_folder makes the list from them.
 * Threads: one at a time. */
#ifndef VOL_NUMBERED_H
#define VOL_NUMBERED_H
#include "daemon/volumes/volumes.h"

#define VOL_HOLE_MAX 10000

typedef struct vol_numbered vol_numbered;
/* Makes the folder.  PVX_EBUSY: something is in it. */
PVX_MUST_CHECK pvx_err vol_numbered_check(const char *dir, struct pvx_diag *d);
/* ext: ending of the files without its dot, constant text.  Errors: PVX_EBUSY (something is in the folder), those of
 * pvx_mkdirs. */
PVX_MUST_CHECK pvx_err vol_numbered_new(const char *dir, const char *ext,
                                        const struct vol_head *head, const struct vol_options *o,
                                        vol_numbered **out, struct pvx_diag *d);
/* Begins a new list of the files that are there already.  any: the name of one of them.  Then call vol_numbered_found
 * for each file, in order.  The rate is taken from the old list. */
PVX_MUST_CHECK pvx_err vol_numbered_again(const char *dir, const char *any, const char *ext,
                                          const struct vol_head *head, const struct vol_options *o,
                                          vol_numbered **out, struct pvx_diag *d);
/* The file `name` shows v; frames that are missing before it are filled. */
PVX_MUST_CHECK pvx_err vol_numbered_found(vol_numbered *n, const char *name,
                                          const struct pvp_volume *v, struct pvx_diag *d);
/* false: this volume is to be left out. */
bool vol_numbered_wants(const vol_numbered *n, const struct pvp_volume *v);
/* Fills the frames that are missing before v, then writes v's file. */
PVX_MUST_CHECK pvx_err vol_numbered_put(vol_numbered *n, const struct pvp_volume *v,
                                        const void *data, size_t len, struct pvx_diag *d);
PVX_MUST_CHECK pvx_err vol_numbered_gap(vol_numbered *n, const struct vol_gap *g);
uint64_t vol_numbered_bytes(const vol_numbered *n);
/* Writes NAME.json, closed.  Frees *n, whatever is returned. */
pvx_err vol_numbered_close(vol_numbered **n, struct pvx_diag *d);
void vol_numbered_drop(vol_numbered **n); /* frees it without writing the list */
#endif
