/* fuzz_vdb.c - the notes in front of a .vdb and behind a .nvdb's first grid: whatever is accepted can be written again
 * and says the same.  The first byte of the input says which of the two it is. */
#include <string.h>

#include "daemon/volumes/vdb_notes.h"
#include "tests/fuzz/fuzz.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    struct vol_vdb_note note[VOL_VDB_NOTES_MAX], again[VOL_VDB_NOTES_MAX];
    struct vol_vdb_about a, b;
    struct pvx_diag d = {""};
    size_t n = 0;
    if (size < 2)
        return 0;
    FILE *f = fmemopen((void *)(data + 1), size - 1, "rb");
    MUST(f != NULL);
    pvx_err e = vol_vdb_notes_load(f, (data[0] & 1) != 0, "fuzz", note, &n, &d);
    fclose(f);
    MUST(n <= VOL_VDB_NOTES_MAX);
    if (e == PVX_OK)
        e = vol_vdb_notes_read(note, n, "fuzz", &a, &d);
    if (e != PVX_OK) {
        MUST(d.text[0] != '\0');
        return 0;
    }
    fuzz_taken++;
    MUST(pvp_grid_valid(&a.v.grid));
    n = vol_vdb_notes_make(&a, again);
    MUST(vol_vdb_notes_read(again, n, "again", &b, NULL) == PVX_OK);
    MUST(a.v.set == b.v.set && a.v.session == b.v.session &&
         a.v.t_exposure_ns == b.v.t_exposure_ns && pvp_grid_same(&a.v.grid, &b.v.grid) &&
         strcmp(a.start.units, b.start.units) == 0);
    return 0;
}
