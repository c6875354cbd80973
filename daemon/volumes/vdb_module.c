#include "daemon/volumes/vdb_module.h"

#include "base/module.h"

pvx_err vol_vdb_need(const char *path, const struct vol_vdb **out, struct pvx_diag *d)
{
    static struct pvx_module module = {
        .file = "pyrovox-openvdb.so", .entry = "vol_vdb_module", .version = VOL_VDB_VERSION};
    *out = pvx_module(&module);
    if (*out != NULL)
        return PVX_OK;
    return pvx_fail(
        d, PVX_EUNSUP,
        "%.200s: OpenVDB cannot be used: %.300s; the module needs Debian's libopenvdb10.0 and is "
        "built where libopenvdb-dev and libnanovdb-dev are installed; npy and hdf5 work without",
        path, module.why);
}

pvx_err vol_vdb_error(int e, const char *path, const char *err, struct pvx_diag *d)
{
    pvx_err r = e > 0 && e < PVX_N_ERR ? (pvx_err)e : PVX_EIO;
    return pvx_fail(d, r, "%s: %s", path, err[0] != '\0' ? err : pvx_strerror(r));
}
