/* vdb_child.h - lets OpenVDB read a file in a process of its own, since it trusts what it reads: damaged bytes make
 * it crash or ask for all memory.  That process has limits, and everything that comes from it is checked. */
#ifndef VOL_VDB_CHILD_H
#define VOL_VDB_CHILD_H
#include "base/err.h"
#include "daemon/volumes/openvdb_shim.h"

typedef int vol_vdb_read_fn(const void *bytes, size_t len, struct vol_vdb_bricks *v, char *err,
                            size_t err_size);
/* As the module's `read`: ids ascending and within the grid, values finite, bars and kelvin not below 0.  Owner: caller,
 * vol_vdb_child_free.  PVX_ECORRUPT: it cannot be read. */
PVX_MUST_CHECK pvx_err vol_vdb_child_read(vol_vdb_read_fn *decode, const char *path,
                                          const void *bytes, size_t len, struct vol_vdb_bricks *v,
                                          struct pvx_diag *d);
void vol_vdb_child_free(struct vol_vdb_bricks *v);
#endif
