/* rig_bodies.h - the bodies of a rig file, for rig.c alone. */
#ifndef REC_RIG_BODIES_H
#define REC_RIG_BODIES_H
#include <stdio.h>
#include "base/yaml.h"
#include "recon/geom/rig.h"

/* `seq`: the list under `bodies`, of the file called `name`; the rig's volume and cameras are read already.
 * *out may be left half filled, for rec_bodies_fini. */
PVX_MUST_CHECK pvx_err rec_bodies_read(const pvx_yaml *y, int seq, const char *name,
                                       const struct rec_rig *rig, struct rec_bodies *out,
                                       struct pvx_diag *d);
void rec_bodies_write(FILE *f, const struct rec_bodies *b);
/* Numbers that say where the bodies are, for hashes: of body `i`, in out[8]. */
size_t rec_body_numbers(const struct rec_body *b, double out[8]);
#endif
