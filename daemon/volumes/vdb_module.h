/* vdb_module.h - the OpenVDB module, found and loaded on first use. */
#ifndef VOL_VDB_MODULE_H
#define VOL_VDB_MODULE_H
#include "base/err.h"
#include "daemon/volumes/openvdb_shim.h"

/* PVX_EUNSUP: it is not there; the diag begins with `path` and names the packages. */
PVX_MUST_CHECK pvx_err vol_vdb_need(const char *path, const struct vol_vdb **out,
                                    struct pvx_diag *d);
/* The module's error, with the file's name in front. */
pvx_err vol_vdb_error(int e, const char *path, const char *err, struct pvx_diag *d);
#endif
