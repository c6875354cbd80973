#include "daemon/volumes/thermal_read.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "daemon/volumes/hdf5.h"

enum { RANK = 4, MODED = 2 };

struct vol_thermal_reader {
    char *path;
    hid_t file, field[VOL_THERMAL_READ], number, taken;
    struct pvp_grid grid;
    uint64_t n;
    size_t voxels;
    float *room;                 /* [VOL_THERMAL_READ][voxels] */
    hid_t modes[MODED], n_modes; /* -1: not in this file */
    uint32_t most_modes;
    float *mode; /* [voxels] */
};

bool vol_is_thermal(const char *path)
{
    uint64_t bytes;
    take_h5_init();
    hid_t file = take_h5_looks(path, &bytes) ? take_h5_open(path) : -1;
    if (file < 0)
        return false;
    char *format = take_h5_get_text(file, "format", false);
    bool is = format != NULL && strcmp(format, VOL_THERMAL_FORMAT) == 0;
    free(format);
    H5Fclose(file);
    return is;
}

static pvx_err thermal_wrong(const vol_thermal_reader *r, struct pvx_diag *d, const char *what)
{
    H5Eclear2(H5E_DEFAULT);
    return pvx_fail(d, PVX_EFORMAT, "%s: is not a recording of temperatures, or damaged: %s",
                    r->path, what);
}

static pvx_err thermal_fields(vol_thermal_reader *r, struct pvx_diag *d)
{
    static const char *const names[VOL_THERMAL_READ] = {"temperature", "temperature_sd", "soot",
                                                        "soot_sd"};
    if (H5Lexists(r->file, names[0], H5P_DEFAULT) <= 0 &&
        H5Lexists(r->file, "red_over_green", H5P_DEFAULT) > 0)
        return pvx_fail(
            d, PVX_EFORMAT,
            "%s: has ratios of channels and no temperatures: its rig had no `spectral:` "
            "(pyrovox calibrate spectral)",
            r->path);
    for (int k = 0; k < VOL_THERMAL_READ; k++) {
        hsize_t dims[RANK];
        hid_t space = -1;
        if (H5Lexists(r->file, names[k], H5P_DEFAULT) <= 0 ||
            (r->field[k] = H5Dopen2(r->file, names[k], H5P_DEFAULT)) < 0)
            return thermal_wrong(r, d, names[k]);
        space = H5Dget_space(r->field[k]);
        bool ok = H5Sget_simple_extent_ndims(space) == RANK &&
                  H5Sget_simple_extent_dims(space, dims, NULL) == RANK &&
                  take_h5_is_inside(r->field[k]);
        H5Sclose(space);
        hid_t type = H5Dget_type(r->field[k]);
        ok = ok && H5Tget_class(type) == H5T_FLOAT;
        H5Tclose(type);
        for (int a = 0; a < 3 && ok; a++) {
            ok = dims[3 - a] > 0 && dims[3 - a] <= PVP_GRID_MAX &&
                 (k == 0 || dims[3 - a] == r->grid.n[a]);
            r->grid.n[a] = ok ? (uint32_t)dims[3 - a] : 1;
        }
        ok = ok && (k == 0 || dims[0] == r->n);
        if (!ok)
            return thermal_wrong(r, d, names[k]);
        r->n = dims[0];
    }
    return PVX_OK;
}

/* Modes, if the file has some. */
static pvx_err thermal_modes(vol_thermal_reader *r, struct pvx_diag *d)
{
    static const char *const names[MODED] = {"temperature_modes", "soot_modes"};
    const hsize_t want[RANK + 1] = {r->n, 0, r->grid.n[2], r->grid.n[1], r->grid.n[0]};
    uint64_t rows = 0;
    if (H5Lexists(r->file, names[0], H5P_DEFAULT) <= 0)
        return PVX_OK;
    for (int k = 0; k < MODED; k++) {
        hsize_t dims[RANK + 1] = {0};
        if (H5Lexists(r->file, names[k], H5P_DEFAULT) <= 0 ||
            (r->modes[k] = H5Dopen2(r->file, names[k], H5P_DEFAULT)) < 0)
            return thermal_wrong(r, d, names[k]);
        hid_t space = H5Dget_space(r->modes[k]), type = H5Dget_type(r->modes[k]);
        bool ok = H5Sget_simple_extent_ndims(space) == RANK + 1 &&
                  H5Sget_simple_extent_dims(space, dims, NULL) == RANK + 1 &&
                  take_h5_is_inside(r->modes[k]) && H5Tget_class(type) == H5T_FLOAT;
        H5Sclose(space);
        H5Tclose(type);
        for (int a = 0; a <= RANK && ok; a++)
            ok = a == 1 ? dims[a] <= VOL_MODES_MAX + VOL_THERMAL_COMMON : dims[a] == want[a];
        if (!ok)
            return thermal_wrong(r, d, names[k]);
        r->most_modes = (uint32_t)dims[1];
    }
    r->n_modes = take_h5_open_table(r->file, "sets/modes", H5T_STD_U32LE, 1, NULL, &rows);
    r->mode = malloc(r->voxels * sizeof *r->mode);
    return r->n_modes < 0 || rows != r->n ? thermal_wrong(r, d, "sets/modes")
           : r->mode == NULL              ? PVX_ENOMEM
                                          : PVX_OK;
}

static pvx_err thermal_begin(vol_thermal_reader *r, struct pvx_diag *d)
{
    int64_t version = 0, closed = 0;
    uint64_t rows = 0, more = 0;
    double spacing[3];
    if ((r->file = take_h5_open(r->path)) < 0)
        return thermal_wrong(r, d, "libhdf5 cannot open it");
    if (!take_h5_get_int(r->file, "version", &version))
        return thermal_wrong(r, d, "version");
    if (version != VOL_THERMAL_VERSION)
        return pvx_fail(d, PVX_EVERSION, "%s: temperatures of version %lld, this pyrovox reads %d",
                        r->path, (long long)version, VOL_THERMAL_VERSION);
    if (!take_h5_get_int(r->file, "closed", &closed) || closed != 1)
        return thermal_wrong(r, d, "it is not complete");
    PVX_TRY(thermal_fields(r, d));
    if (!vol_hdf5_triple(r->file, "origin", r->grid.min) ||
        !vol_hdf5_triple(r->file, "spacing", spacing))
        return thermal_wrong(r, d, "origin, spacing");
    for (int a = 0; a < 3; a++)
        r->grid.max[a] = r->grid.min[a] + spacing[a] * r->grid.n[a];
    r->grid.channels = 1;
    if (!pvp_grid_valid(&r->grid))
        return thermal_wrong(r, d, "origin, spacing");
    r->number = take_h5_open_table(r->file, "sets/number", H5T_STD_U64LE, 1, NULL, &rows);
    r->taken = take_h5_open_table(r->file, "sets/t_exposure_ns", H5T_STD_I64LE, 1, NULL, &more);
    if (r->number < 0 || r->taken < 0 || rows != r->n || more != r->n)
        return thermal_wrong(r, d, "sets");
    r->voxels = pvp_grid_count(&r->grid);
    r->room = malloc(VOL_THERMAL_READ * r->voxels * sizeof *r->room);
    return r->room != NULL ? thermal_modes(r, d)
                           : pvx_fail(d, PVX_ENOMEM, "%s: no memory for a set of %zu voxels",
                                      r->path, r->voxels);
}

pvx_err vol_thermal_read(const char *path, vol_thermal_reader **out, struct pvx_diag *d)
{
    take_h5_init();
    vol_thermal_reader *r = *out = pvx_calloc(1, sizeof *r);
    PVX_NEED(r);
    r->file = r->number = r->taken = r->n_modes = r->modes[0] = r->modes[1] = -1;
    for (int k = 0; k < VOL_THERMAL_READ; k++)
        r->field[k] = -1;
    r->path = strdup(path);
    pvx_err e = r->path != NULL ? thermal_begin(r, d) : PVX_ENOMEM;
    if (e != PVX_OK)
        vol_thermal_read_close(out);
    return e;
}

void vol_thermal_read_close(vol_thermal_reader **r)
{
    if (*r == NULL)
        return;
    take_h5_init();
    if ((*r)->file >= 0)
        H5Fclose((*r)->file); /* and all that is open in it */
    free((*r)->room);
    free((*r)->mode);
    free((*r)->path);
    PVX_FREE(*r);
}

const struct pvp_grid *vol_thermal_grid(const vol_thermal_reader *r)
{
    return &r->grid;
}

uint64_t vol_thermal_count(const vol_thermal_reader *r)
{
    return r->n;
}

pvx_err vol_thermal_get(vol_thermal_reader *r, uint64_t k, struct vol_thermal_set *out,
                        struct pvx_diag *d)
{
    const hsize_t from[RANK] = {k}, n[RANK] = {1, r->grid.n[2], r->grid.n[1], r->grid.n[0]};
    take_h5_init();
    bool ok = k < r->n &&
              take_h5_read_rows(r->number, H5T_NATIVE_UINT64, 1, 0, k, 1, &out->number) &&
              take_h5_read_rows(r->taken, H5T_NATIVE_INT64, 1, 0, k, 1, &out->t_exposure_ns);
    out->n_modes = 0;
    if (r->n_modes >= 0)
        ok = ok && take_h5_read_rows(r->n_modes, H5T_NATIVE_UINT32, 1, 0, k, 1, &out->n_modes) &&
             out->n_modes <= r->most_modes;
    for (int i = 0; i < VOL_THERMAL_READ && ok; i++) {
        hid_t space = H5Dget_space(r->field[i]), memory = H5Screate_simple(RANK, n, NULL);
        float *to = r->room + (size_t)i * r->voxels;
        ok = H5Sselect_hyperslab(space, H5S_SELECT_SET, from, NULL, n, NULL) >= 0 &&
             H5Dread(r->field[i], H5T_NATIVE_FLOAT, memory, space, H5P_DEFAULT, to) >= 0;
        H5Sclose(memory);
        H5Sclose(space);
        out->value[i] = to;
    }
    for (size_t q = 0; q < VOL_THERMAL_READ * r->voxels && ok; q++)
        ok = !isinf(r->room[q]) && !(r->room[q] < 0);
    return ok ? PVX_OK
              : take_h5_fail(d, PVX_ECORRUPT, r->path,
                             "a set cannot be read, or has impossible numbers");
}

pvx_err vol_thermal_mode(vol_thermal_reader *r, uint64_t k, int field, uint32_t m,
                         const float **out, struct pvx_diag *d)
{
    const hsize_t from[RANK + 1] = {k, m},
                              n[RANK + 1] = {1, 1, r->grid.n[2], r->grid.n[1], r->grid.n[0]};
    const hid_t set = r->modes[field == VOL_SOOT];
    take_h5_init();
    bool ok = k < r->n && set >= 0 && m < r->most_modes;
    if (ok) {
        hid_t space = H5Dget_space(set), memory = H5Screate_simple(RANK + 1, n, NULL);
        ok = H5Sselect_hyperslab(space, H5S_SELECT_SET, from, NULL, n, NULL) >= 0 &&
             H5Dread(set, H5T_NATIVE_FLOAT, memory, space, H5P_DEFAULT, r->mode) >= 0;
        H5Sclose(memory);
        H5Sclose(space);
    }
    for (size_t q = 0; q < r->voxels && ok; q++)
        ok = isfinite(r->mode[q]);
    *out = r->mode;
    return ok ? PVX_OK
              : take_h5_fail(d, PVX_ECORRUPT, r->path,
                             "the modes of a set cannot be read, or have impossible numbers");
}
