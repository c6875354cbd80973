/* record_file.h - one received volume on disk: DIR/SET.npy and, beside it, DIR/SET.json.
 *
 * Both are there and whole, or neither: each is written beside its place and renamed, and if the
 * description cannot be written the array goes too. */
#ifndef RECORD_FILE_H
#define RECORD_FILE_H
#include "proto/pvp.h"

/* dense: float32 [nz][ny][nx][channels] of view's grid; units and rig from `start`.
 * Errors: PVX_ENOSPC (disk full), PVX_EPERM, PVX_EIO; the diag names the file. */
PVX_MUST_CHECK pvx_err record_file_save(const char *dir, const struct pvp_view *view,
                                        const struct pvp_start *start, const float *dense,
                                        struct pvx_diag *d);
#endif
