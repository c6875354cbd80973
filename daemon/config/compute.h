/* compute.h - where frame sets are solved: the words of `compute:` and --compute.
 * Threads: any. */
#ifndef DMN_COMPUTE_H
#define DMN_COMPUTE_H
#include <stdbool.h>
#include "base/err.h"

enum dmn_compute_where { DMN_COMPUTE_CPU, DMN_COMPUTE_AUTO, DMN_COMPUTE_OPENCL };
#define DMN_COMPUTE_WORDS "auto|cpu|opencl[:NAME]"

/* false: it is none of DMN_COMPUTE_WORDS.  *name: of the device, within `word`; "" with opencl: the first card. */
bool dmn_compute_parse(const char *word, enum dmn_compute_where *where, const char **name);
/* PVX_EINVAL: `word` is none of them, or it says opencl and there is something that only the processors can do
 * (`refused`, a few words; NULL: nothing).  what: what messages call the option. */
PVX_MUST_CHECK pvx_err dmn_compute_allowed(const char *what, const char *word, const char *refused,
                                           struct pvx_diag *d);
#endif
