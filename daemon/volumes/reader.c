#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/file.h"
#include "base/mem.h"
#include "daemon/volumes/volumes.h"

/* Readers, asked in this order whether the path has their format. */
static const struct {
    enum vol_format format;
    const struct vol_reader_ops *ops;
} readers[] = {
    {VOL_HDF5, &vol_kelvin_reader}, {VOL_HDF5, &vol_joined_reader}, {VOL_HDF5, &vol_hdf5_reader},
    {VOL_VDB, &vol_vdb_reader},     {VOL_NVDB, &vol_nvdb_reader},   {VOL_NPY, &vol_npy_reader},
};

struct vol_reader {
    enum vol_format format;
    const struct vol_reader_ops *ops;
    void *self;
    struct vol_head head;
    uint64_t count;
    bool cut;
};

static pvx_err reader_begin(const char *path, enum vol_format format,
                            const struct vol_reader_ops *ops, vol_reader **out, struct pvx_diag *d)
{
    vol_reader *r = pvx_calloc(1, sizeof *r);
    PVX_NEED(r);
    r->format = format;
    r->ops = ops;
    pvx_err e = r->ops->open(&r->self, path, &r->head, &r->count, &r->cut, d);
    if (e != PVX_OK) {
        free(r);
        return e;
    }
    *out = r;
    return PVX_OK;
}

pvx_err vol_reader_open_soot(const char *path, vol_reader **out, struct pvx_diag *d)
{
    *out = NULL;
    if (access(path, R_OK) != 0)
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", path, strerror(errno));
    if (!vol_soot_reader.is(path))
        return pvx_fail(d, PVX_EFORMAT,
                        "%s: has no amounts of soot: `pyrovox temperature` makes a file that has "
                        "them",
                        path);
    return reader_begin(path, VOL_HDF5, &vol_soot_reader, out, d);
}

pvx_err vol_reader_open(const char *path, vol_reader **out, struct pvx_diag *d)
{
    *out = NULL;
    struct stat st;
    if (access(path, R_OK) != 0)
        return pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", path, strerror(errno));
    if (stat(path, &st) != 0 || !S_ISDIR(st.st_mode))
        PVX_TRY(pvx_file_check(path, d));
    size_t k = 0, n = sizeof readers / sizeof readers[0];
    while (k < n && !readers[k].ops->is(path))
        k++;
    if (k == n)
        return pvx_fail(d, PVX_EFORMAT,
                        "%s: is not a recording of volumes (a folder of .npy, .vdb or .nvdb, "
                        "an HDF5 file)",
                        path);
    return reader_begin(path, readers[k].format, readers[k].ops, out, d);
}

pvx_err vol_reader_emission(const vol_reader *r, const char *path, struct pvx_diag *d)
{
    const char *units = r->head.start.units;
    if (vol_is_emission(units))
        return PVX_OK;
    return pvx_fail(d, PVX_EINVAL,
                    "%s: has %s, and emission [1/m] is needed: give the recording that the "
                    "temperatures were made of",
                    path,
                    strcmp(units, VOL_UNITS_KELVIN) == 0 ? "temperatures [K]" : "amounts of soot");
}

enum vol_format vol_reader_format(const vol_reader *r)
{
    return r->format;
}

const struct vol_head *vol_reader_head(const vol_reader *r)
{
    return &r->head;
}

uint64_t vol_reader_count(const vol_reader *r)
{
    return r->count;
}

bool vol_reader_cut(const vol_reader *r)
{
    return r->cut;
}

pvx_err vol_reader_get(vol_reader *r, uint64_t k, struct vol_volume *out, struct pvx_diag *d)
{
    if (k >= r->count)
        return pvx_fail(d, PVX_EINVAL, "volume %llu of %llu", (unsigned long long)k,
                        (unsigned long long)r->count);
    return r->ops->get(r->self, k, out, d);
}

void vol_reader_modes(vol_reader *r, bool on)
{
    if (r->ops->modes != NULL)
        r->ops->modes(r->self, on);
}

void vol_reader_spare(vol_reader *r)
{
    if (r->ops->spare != NULL)
        r->ops->spare(r->self, &r->count, &r->cut);
}

const struct vol_gap *vol_reader_gap(const vol_reader *r, uint64_t k)
{
    return r->ops->gap != NULL ? r->ops->gap(r->self, k) : NULL;
}

uint64_t vol_reader_unsolved(const vol_reader *r)
{
    const struct vol_gap *g;
    uint64_t n = 0;
    for (uint64_t k = 0; (g = vol_reader_gap(r, k)) != NULL; k++)
        n += g->why == VOL_GAP_UNSOLVED ? g->volumes : 0;
    return n;
}

void vol_reader_close(vol_reader **rp)
{
    if (*rp == NULL)
        return;
    (*rp)->ops->close((*rp)->self);
    PVX_FREE(*rp);
}
