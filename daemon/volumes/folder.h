/* folder.h - the files of one kind in a folder, in the order of their numbers: 999999 before 1000000. */
#ifndef VOL_FOLDER_H
#define VOL_FOLDER_H
#include <stdbool.h>
#include <stddef.h>
#include "base/err.h"

/* DIR/sd/NAME.npy has the error bars of DIR/NAME.npy.  So every .npy in a folder is a volume, also for other programs. */
#define VOL_SD "sd"
/* false: too long for `size`. */
bool vol_sd_path(const char *npy, char *out, size_t size);

struct vol_folder {
    char **name; /* [n] without the folder's */
    size_t n;
};
/* Names that end in `end`.  Hidden files are passed over.  Owner: caller, vol_folder_free, also after an error.
 * Errors: PVX_EFORMAT (two files have one number: names both), PVX_ENOENT, PVX_EPERM. */
PVX_MUST_CHECK pvx_err vol_folder_list(const char *dir, const char *end, struct vol_folder *out,
                                       struct pvx_diag *d);
void vol_folder_free(struct vol_folder *f);
/* Whether path is a file with that ending, or a folder that has such files. */
bool vol_folder_has(const char *path, const char *end);
#endif
