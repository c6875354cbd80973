/* vdb_notes.h - the notes that a .vdb or .nvdb has beside its grids, written and read: everything that came with its
 * volume on the wire, so that a file can be understood alone and played again.
 *
 * Keys are the wire's fields (PROTOCOL.md); 64-bit identities are text of 16 hexadecimal digits.  Threads: pure. */
#ifndef VOL_VDB_NOTES_H
#define VOL_VDB_NOTES_H
#include <stdio.h>

#include "daemon/volumes/openvdb_shim.h"
#include "daemon/volumes/volumes.h"

struct vol_vdb_about {
    struct pvp_start start;
    struct pvp_volume v;
    uint32_t sample, clamped;
    uint32_t y_up, split; /* how the file is laid out */
    double unit_m;
    bool bars; /* it was written with error bars */
    uint32_t doubt;
};

/* Fills note [VOL_VDB_NOTES_MAX].  Returns their number. */
size_t vol_vdb_notes_make(const struct vol_vdb_about *a, struct vol_vdb_note *note);
/* Loads the notes: the metadata of a .vdb, or the blind data of a .nvdb's first grid (openvdb_shim.h).  They are
 * parsed here, because OpenVDB and NanoVDB trust every length.  note [VOL_VDB_NOTES_MAX] gets those of the kinds that
 * pyrovox writes.  PVX_EFORMAT. */
PVX_MUST_CHECK pvx_err vol_vdb_notes_load(FILE *f, bool nano, const char *name,
                                          struct vol_vdb_note *note, size_t *n, struct pvx_diag *d);
/* PVX_EFORMAT: not from pyrovox, or a key is missing or outside its range (diag names it); PVX_EVERSION.
 * `name` is what messages call the file. */
PVX_MUST_CHECK pvx_err vol_vdb_notes_read(const struct vol_vdb_note *note, size_t n,
                                          const char *name, struct vol_vdb_about *out,
                                          struct pvx_diag *d);
/* Loads all that the notes of file `path` say.  Errors: those of the two functions above, and of opening it. */
PVX_MUST_CHECK pvx_err vol_vdb_about_load(const char *path, bool nano, struct vol_vdb_about *out,
                                          struct pvx_diag *d);
#endif
