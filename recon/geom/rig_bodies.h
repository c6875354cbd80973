/* rig_bodies.h - the bodies of a rig file, for rig.c alone. */
#ifndef REC_RIG_BODIES_H
#define REC_RIG_BODIES_H
#include <stdio.h>
#include "base/yaml.h"
#include "recon/geom/rig.h"

/* Reads the list `seq` under `bodies` of the file called `name`.  The rig's volume and cameras must be read already.
 * After an error *out may be half filled; call rec_bodies_fini. */
PVX_MUST_CHECK pvx_err rec_bodies_read(const pvx_yaml *y, int seq, const char *name,
                                       const struct rec_rig *rig, struct rec_bodies *out,
                                       struct pvx_diag *d);
void rec_bodies_write(FILE *f, const struct rec_bodies *b);
/* Numbers that determine a body's shape and place, for hashes, into out[8]; returns how many. */
size_t rec_body_numbers(const struct rec_body *b, double out[8]);
#endif
