/* vdb.h - temperatures as numbered .vdb files: `density` is soot in ppm (where its amount is unknown, the luminance of the
 * emission), `temperature` is in kelvin.  Voxels without a temperature have neither. */
#ifndef CLI_TEMPERATURE_VDB_H
#define CLI_TEMPERATURE_VDB_H
#include "daemon/cli/temperature/voxels.h"

struct temperature_vdb {
    vol_writer *writer;      /* NULL: not open */
    float *density, *kelvin; /* [room][8^3] */
    uint32_t room;
    char dir[400]; /* "": not made */
    bool made;     /* the folder was not there before */
};
/* Makes the folder.  From then on temperature_vdb_remove removes it. */
PVX_MUST_CHECK pvx_err temperature_vdb_check(struct temperature_vdb *w, const char *dir,
                                             struct pvx_diag *d);
/* After temperature_vdb_check.  Errors: those of vol_writer_open. */
PVX_MUST_CHECK pvx_err temperature_vdb_open(struct temperature_vdb *w, const char *dir,
                                            const struct vol_head *head, struct pvx_diag *d);
/* The volume that t did last. */
PVX_MUST_CHECK pvx_err temperature_vdb_put(struct temperature_vdb *w, const struct vol_volume *v,
                                           const struct temperature_voxels *t, struct pvx_diag *d);
pvx_err temperature_vdb_close(struct temperature_vdb *w, struct pvx_diag *d);
/* Removes the files of a recording that failed. */
void temperature_vdb_remove(const struct temperature_vdb *w);
#endif
