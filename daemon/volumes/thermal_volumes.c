/* thermal_volumes.c - a recording of temperatures (thermal.h) as volumes of one channel: of kelvin, or of soot in ppm.
 * A voxel without a number is 0. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "daemon/volumes/bricks.h"
#include "daemon/volumes/hdf5.h"
#include "daemon/volumes/thermal_read.h"

struct thermal_volumes {
    vol_thermal_reader *in;
    int field; /* VOL_KELVIN or VOL_SOOT; its deviations are the next */
    uint64_t session;
    char *rig;
    struct pvp_grid grid;
    size_t voxels;
    float *dense, *sd; /* [voxels] */
    struct vol_store bricks, bars;
};

static void thermal_volumes_close(void *self)
{
    struct thermal_volumes *t = self;
    vol_thermal_read_close(&t->in);
    vol_store_free(&t->bricks);
    vol_store_free(&t->bars);
    free(t->dense);
    free(t->sd);
    free(t->rig);
    free(t);
}

/* What all sets have in common, as far as the file says it. */
static pvx_err thermal_volumes_head(struct thermal_volumes *t, const char *path,
                                    struct pvp_start *s, struct pvx_diag *d)
{
    double absolute = 1;
    hid_t file = take_h5_open(path);
    if (file < 0)
        return pvx_fail(d, PVX_EFORMAT, "%s: libhdf5 cannot open it", path);
    char *software = take_h5_get_text(file, "software", true);
    t->rig = take_h5_get_text(file, "rig", true);
    snprintf(s->software, sizeof s->software, "%s", software != NULL ? software : "");
    free(software);
    (void)take_h5_get_attr(file, "session", H5T_NATIVE_UINT64, 8, &s->session);
    (void)take_h5_get_attr(file, "rig_hash", H5T_NATIVE_UINT64, 8, &s->rig_hash);
    (void)take_h5_get_attr(file, "absolute", H5T_NATIVE_DOUBLE, 8, &absolute);
    H5Eclear2(H5E_DEFAULT);
    H5Fclose(file);
    s->session += t->field == VOL_SOOT; /* a session has one quantity */
    t->session = s->session;
    if (t->field == VOL_SOOT && absolute == 0)
        return pvx_fail(d, PVX_EINVAL,
                        "%s: calibrated by a thermocouple, so the amount of soot is not known",
                        path);
    return PVX_OK;
}

static pvx_err thermal_volumes_begin(struct thermal_volumes *t, const char *path,
                                     struct vol_head *head, uint64_t *count, struct pvx_diag *d)
{
    struct vol_thermal_set a, b;
    PVX_TRY(vol_thermal_read(path, &t->in, d));
    *head = (struct vol_head){.rig = NULL};
    PVX_TRY(thermal_volumes_head(t, path, &head->start, d));
    *count = vol_thermal_count(t->in);
    head->start.grid = t->grid = *vol_thermal_grid(t->in);
    snprintf(head->start.units, sizeof head->start.units, "%s",
             t->field == VOL_SOOT ? VOL_UNITS_SOOT : VOL_UNITS_KELVIN);
    head->rig = t->rig != NULL && t->rig[0] != '\0' ? t->rig : NULL;
    t->voxels = pvp_grid_count(&t->grid);
    t->dense = pvx_calloc(t->voxels, sizeof *t->dense);
    t->sd = pvx_calloc(t->voxels, sizeof *t->sd);
    if (t->dense == NULL || t->sd == NULL)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for a set of %zu voxels", path, t->voxels);
    if (*count < 2)
        return PVX_OK;
    PVX_TRY(vol_thermal_get(t->in, 0, &a, d));
    int64_t first = a.t_exposure_ns;
    PVX_TRY(vol_thermal_get(t->in, 1, &b, d));
    head->start.fps = b.t_exposure_ns > first ? 1e9 / (double)(b.t_exposure_ns - first) : 0;
    return PVX_OK;
}

static pvx_err thermal_volumes_open(int field, void **self, const char *path, struct vol_head *head,
                                    uint64_t *count, bool *cut, struct pvx_diag *d)
{
    struct thermal_volumes *t = *self = pvx_calloc(1, sizeof *t);
    PVX_NEED(t);
    t->field = field;
    *cut = false;
    pvx_err e = thermal_volumes_begin(t, path, head, count, d);
    if (e != PVX_OK)
        thermal_volumes_close(t);
    return e;
}

static pvx_err kelvin_open(void **self, const char *path, struct vol_head *head, uint64_t *count,
                           bool *cut, struct pvx_diag *d)
{
    return thermal_volumes_open(VOL_KELVIN, self, path, head, count, cut, d);
}

static pvx_err soot_open(void **self, const char *path, struct vol_head *head, uint64_t *count,
                         bool *cut, struct pvx_diag *d)
{
    return thermal_volumes_open(VOL_SOOT, self, path, head, count, cut, d);
}

static pvx_err thermal_volumes_get(void *self, uint64_t k, struct vol_volume *out,
                                   struct pvx_diag *d)
{
    struct thermal_volumes *t = self;
    struct vol_thermal_set s;
    uint32_t known = 0;
    PVX_TRY(vol_thermal_get(t->in, k, &s, d));
    const float *value = s.value[t->field], *sd = s.value[t->field + 1];
    for (size_t i = 0; i < t->voxels; i++) {
        bool is = isfinite(value[i]) && value[i] > 0;
        t->dense[i] = is ? value[i] : 0;
        t->sd[i] = is && isfinite(sd[i]) ? sd[i] : 0;
        known += is;
    }
    PVX_TRY(vol_from_dense_bars(&t->bricks, &t->bars, &t->grid, t->dense, t->sd));
    *out = (struct vol_volume){.v = {.session = t->session,
                                     .set = s.number,
                                     .t_exposure_ns = s.t_exposure_ns,
                                     .grid = t->grid,
                                     .report = {.rel_residual = NAN, .active_voxels = known}},
                               .sample = PVP_F32,
                               .n_bricks = t->bricks.n,
                               .ids = t->bricks.ids,
                               .brick = t->bricks.brick,
                               .bars = {.sd = t->bars.brick}};
    return PVX_OK;
}

const struct vol_reader_ops vol_kelvin_reader = {.is = vol_is_thermal,
                                                 .open = kelvin_open,
                                                 .get = thermal_volumes_get,
                                                 .close = thermal_volumes_close};
const struct vol_reader_ops vol_soot_reader = {.is = vol_is_thermal,
                                               .open = soot_open,
                                               .get = thermal_volumes_get,
                                               .close = thermal_volumes_close};
