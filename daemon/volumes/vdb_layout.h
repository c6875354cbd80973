/* vdb_layout.h - a volume as the OpenVDB module takes it: bricks, their place, notes.  Threads: pure. */
#ifndef VOL_VDB_LAYOUT_H
#define VOL_VDB_LAYOUT_H
#include "daemon/volumes/vdb_notes.h"

/* Fill in the grid of b, and its place in the file's unit. */
void vol_vdb_place(const struct vol_vdb_about *a, struct vol_vdb_bricks *b);
/* about: start, y_up, split and unit_m are input, the rest is filled in from v.  out borrows v's bricks and note
 * [VOL_VDB_NOTES_MAX]. */
void vol_vdb_lay(struct vol_vdb_about *about, const struct vol_volume *v, struct vol_vdb_note *note,
                 struct vol_vdb_bricks *out);
#endif
