/* module.h - shared objects in C++ that are loaded on first use (OpenCV, libcamera, ...), so that programs
 * start fast and run where the library is not installed.
 *
 * Looked for in $PYROVOX_LIBDIR when that is set, else in ../lib/pyrovox of the executable, where
 * Debian's packages have it below ../lib/<machine>.  Never unloaded. */
#ifndef PVX_MODULE_H
#define PVX_MODULE_H
#include <stddef.h>

/* Load `file` ("pyrovox-opencv.so") and call its `entry`, which gives a struct that begins with an
 * int: its version.  NULL: not found, or it cannot be loaded, or another version; why [size]. */
const void *pvx_module_load(const char *file, const char *entry, int version, char *why,
                            size_t size);
#endif
