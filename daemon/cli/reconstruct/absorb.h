/* absorb.h - `pyrovox reconstruct --absorption auto`: find c from the recording before it is
 * reconstructed (recon/check/absorption.h), and print a line about it. */
#ifndef RECONSTRUCT_ABSORB_H
#define RECONSTRUCT_ABSORB_H
#include "daemon/cli/reconstruct/options.h"

/* *c: 0 if nothing absorbs.  Errors: those of flame_sets_load and rec_absorption_find. */
PVX_MUST_CHECK pvx_err reconstruct_absorb(const struct reconstruct_options *o, double *c,
                                          struct pvx_diag *d);

#endif
