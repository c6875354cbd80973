/* photometry_text.h - reads and writes `photometry:` of a camera (photometry.h) in rig.yaml.
 * Threads: pure. */
#ifndef REC_PHOTOMETRY_TEXT_H
#define REC_PHOTOMETRY_TEXT_H
#include <stdio.h>
#include "base/yaml.h"
#include "recon/geom/photometry.h"

/* Reads the value of `photometry:` at `node`; messages call it `path`. */
PVX_MUST_CHECK pvx_err rec_photometry_read(const pvx_yaml *y, int node, const char *path,
                                           struct rec_photometry *out, struct pvx_diag *d);
/* Writes the lines of a camera; nothing if nothing is known. */
void rec_photometry_write(FILE *f, const struct rec_photometry *p);
#endif
