/* photometry_text.h - `photometry:` of a camera (photometry.h), read from rig.yaml and written to it.
 * Threads: pure. */
#ifndef REC_PHOTOMETRY_TEXT_H
#define REC_PHOTOMETRY_TEXT_H
#include <stdio.h>
#include "base/yaml.h"
#include "recon/geom/photometry.h"

/* The value of `photometry:` at `node`; `path` is what messages call it. */
PVX_MUST_CHECK pvx_err rec_photometry_read(const pvx_yaml *y, int node, const char *path,
                                           struct rec_photometry *out, struct pvx_diag *d);
/* As lines of a camera; nothing where nothing is known. */
void rec_photometry_write(FILE *f, const struct rec_photometry *p);
#endif
