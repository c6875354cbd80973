/* module.h - shared objects that are loaded on first use (FFmpeg, OpenCV, libcamera, ...).  So programs start fast,
 * and run where the library is not installed.
 *
 * A module is searched in $PYROVOX_LIBDIR if that is set, else in ../lib/pyrovox of the executable; Debian's
 * packages have it below ../lib/<machine>.  It is never unloaded. */
#ifndef PVX_MODULE_H
#define PVX_MODULE_H
#include <stddef.h>

/* Load `file` ("pyrovox-films.so") and call its `entry`, which returns a struct that begins with an int: its
 * version.
 * NULL: not found, cannot be loaded, or of another version; why [size]: the reason. */
const void *pvx_module_load(const char *file, const char *entry, int version, char *why,
                            size_t size);
#endif
