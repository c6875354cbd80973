/* file.h - whole-file reading and crash-safe writing.
 *
 * Only input with an end is read: a regular file, or a pipe without a name that the parent process opened
 * (/dev/stdin, the shell's <(...)).  Folders, devices, sockets and named pipes are refused with PVX_EFORMAT,
 * by name and with the remedy. */
#ifndef PVX_FILE_H
#define PVX_FILE_H
#include <stdbool.h>
#include <stddef.h>
#include "base/err.h"

/* Checks that `path` may be read, for libraries that open files by name themselves.  Errors: PVX_EFORMAT,
 * PVX_ENOENT, PVX_EPERM. */
PVX_MUST_CHECK pvx_err pvx_file_check(const char *path, struct pvx_diag *d);
/* The same, and opens it: the caller closes *fd; -1 on error. */
PVX_MUST_CHECK pvx_err pvx_file_open(const char *path, int *fd, struct pvx_diag *d);

/* Read all of `path` (at most `max` bytes) into a new buffer with a 0 byte after the end.
 * Owner: caller, free().  Errors: those of pvx_file_check, PVX_EIO, PVX_ERANGE (too large). */
PVX_MUST_CHECK pvx_err pvx_file_read(const char *path, size_t max, char **out, size_t *len,
                                     struct pvx_diag *d);
/* The same for a frame.  It may come through a named pipe, so this waits for the writer. */
PVX_MUST_CHECK pvx_err pvx_file_await(const char *path, size_t max, char **out, size_t *len,
                                      struct pvx_diag *d);

/* Write to `path`.tmp.PID, fsync, rename: readers see the old file or the whole new one.  On error
 * (PVX_ENOSPC, PVX_EPERM, PVX_EIO) the old file is untouched and the temporary is removed. */
PVX_MUST_CHECK pvx_err pvx_file_write(const char *path, const void *data, size_t len,
                                      struct pvx_diag *d);

/* fsync: all data written to `path` so far survives a power cut. */
PVX_MUST_CHECK pvx_err pvx_file_sync(const char *path, struct pvx_diag *d);

/* mkdir -p, mode 0777 & ~umask. */
PVX_MUST_CHECK pvx_err pvx_mkdirs(const char *path, struct pvx_diag *d);

/* "a/b.h5" ends in ".h5"; ".h5" does not. */
bool pvx_path_ends(const char *path, const char *end);
/* `path` with `more` before its ending: "a/b.h5", "-0002": "a/b-0002.h5".  PVX_ERANGE: no room. */
PVX_MUST_CHECK pvx_err pvx_path_more(const char *path, const char *more, char *out, size_t size);

/* Directory of the running executable ("/usr/bin"), no trailing slash. */
PVX_MUST_CHECK pvx_err pvx_exe_dir(char *out, size_t size);

#endif
