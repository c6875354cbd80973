/* rig_spectral.h - `spectral:` of a rig file, for rig.c alone. */
#ifndef REC_RIG_SPECTRAL_H
#define REC_RIG_SPECTRAL_H
#include <stdio.h>
#include "base/yaml.h"
#include "recon/geom/spectral.h"

/* Reads the mapping `map` under `spectral`.  *out is from malloc. */
PVX_MUST_CHECK pvx_err rec_spectral_read(const pvx_yaml *y, int map, struct rec_spectral **out,
                                         struct pvx_diag *d);
void rec_spectral_write(FILE *f, const struct rec_spectral *s);
#endif
