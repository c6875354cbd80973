/* module.h - shared objects that are loaded on first use (FFmpeg, OpenCV, libcamera, ...).  So programs start fast,
 * and run where the library is not installed.
 *
 * A module is searched in $PYROVOX_LIBDIR if that is set, else in ../lib/pyrovox of the executable; Debian's
 * packages have it below ../lib/<machine>.  It is never unloaded. */
#ifndef PVX_MODULE_H
#define PVX_MODULE_H
#include <stdbool.h>
#include "base/err.h"

/* File, entry and version are the caller's.  The entry returns what the module has: a struct that begins with an int,
 * its version. */
struct pvx_module {
    const char *file, *entry; /* "pyrovox-films.so", "cap_films_module" */
    int version;
    const void *is; /* what the entry returned */
    bool tried;
    char why[PVX_DIAG_MAX];
};

/* m->is, searched by the first call.  NULL: not found, cannot be loaded, or of another version; m->why: the reason.
 * Threads: any; after a call m->is may be read without one. */
const void *pvx_module(struct pvx_module *m);
#endif
