/* cache.h - the user's cache of system matrices: a folder of files sysmat-<key>.pvxm.  A file that is used is touched.
 * Those that were not used for longest are removed when all together are larger than $PYROVOX_CACHE_MAX, in GB.
 * Programs for graphics cards lie beside them (recon/opencl/program_cache.h). */
#ifndef REC_CACHE_H
#define REC_CACHE_H
#include <limits.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include "base/err.h"

struct rec_cached {
    char path[PATH_MAX];
    uint64_t bytes;
    int64_t used_ns; /* CLOCK_REALTIME */
};

/* The folder of the cache, which may not be there yet.  false: no variable names one. */
bool rec_cache_dir(char out[PATH_MAX]);
/* The largest size in bytes: $PYROVOX_CACHE_MAX, else 5 GB. */
double rec_cache_max(void);
/* The files of the cache, the one used last comes last.  Owner of *out: caller, free(). */
PVX_MUST_CHECK pvx_err rec_cache_list(struct rec_cached **out, size_t *n);
#endif
