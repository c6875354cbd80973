/* folder.h - the files of one kind in a folder, in the order of their numbers: 999999 before 1000000. */
#ifndef VOL_FOLDER_H
#define VOL_FOLDER_H
#include <stdbool.h>
#include <stddef.h>
#include "base/err.h"

/* NAME.sd.npy beside NAME.npy has its error bars, and is no volume. */
#define VOL_SD ".sd.npy"

struct vol_folder {
    char **name; /* [n] without the folder's */
    size_t n;
};
/* Names that end in `end`.  Hidden files and error bars are passed over.  Owner: caller, vol_folder_free, also after an error.
 * Errors: PVX_EFORMAT (two files have one number: names both), PVX_ENOENT, PVX_EPERM. */
PVX_MUST_CHECK pvx_err vol_folder_list(const char *dir, const char *end, struct vol_folder *out,
                                       struct pvx_diag *d);
void vol_folder_free(struct vol_folder *f);
/* Whether path is a file with that ending, or a folder that has such files. */
bool vol_folder_has(const char *path, const char *end);
#endif
