/* vdb.c - recordings of volumes in OpenVDB and NanoVDB: numbered files, made by the module. */
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "daemon/volumes/numbered.h"
#include "daemon/volumes/vdb_kelvin.h"
#include "daemon/volumes/vdb_layout.h"
#include "daemon/volumes/vdb_module.h"

struct vdb {
    const struct vol_vdb *module;
    vol_numbered *files;
    struct vol_vdb_about about;
    struct vol_vdb_note note[VOL_VDB_NOTES_MAX];
    char path[400];
    bool nano, in_kelvin;
    struct vol_vdb_kelvin kelvin;
};

static pvx_err vdb_check(const char *path, struct pvx_diag *d)
{
    const struct vol_vdb *module;
    PVX_TRY(vol_vdb_need(path, &module, d));
    return vol_numbered_check(path, d);
}

static pvx_err vdb_open_any(bool nano, void **self, const char *path, const struct vol_head *head,
                            const struct vol_options *o, struct pvx_diag *d)
{
    const struct vol_vdb *module;
    struct vol_head mine = *head;
    bool in_kelvin = strcmp(head->start.units, VOL_UNITS_KELVIN) == 0;
    *self = NULL;
    if (nano && in_kelvin) {
        (void)rmdir(path); /* which the check has made, if it is empty */
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: temperatures are not written as .nvdb, where a renderer would take "
                        "them for light: take vdb, hdf5 or npy",
                        path);
    }
    if (in_kelvin)
        snprintf(mine.start.units, sizeof mine.start.units, VOL_UNITS_DENSITY);
    PVX_TRY(vol_vdb_need(path, &module, d));
    struct vdb *w = calloc(1, sizeof *w);
    PVX_NEED(w);
    w->module = module;
    w->nano = nano;
    w->in_kelvin = in_kelvin;
    snprintf(w->path, sizeof w->path, "%s", path);
    w->about.start = mine.start;
    w->about.y_up = o->y_up;
    w->about.split = o->split && head->start.grid.channels == 3;
    w->about.unit_m = o->unit_m > 0 ? o->unit_m : 1;
    pvx_err e = vol_numbered_new(path, nano ? "nvdb" : "vdb", &mine, o, &w->files, d);
    if (e == PVX_OK)
        *self = w;
    else
        free(w);
    return e;
}

static pvx_err vdb_open_vdb(void **self, const char *path, const struct vol_head *head,
                            const struct vol_options *o, struct pvx_diag *d)
{
    return vdb_open_any(false, self, path, head, o, d);
}

static pvx_err vdb_open_nvdb(void **self, const char *path, const struct vol_head *head,
                             const struct vol_options *o, struct pvx_diag *d)
{
    return vdb_open_any(true, self, path, head, o, d);
}

static pvx_err vdb_put(void *self, const struct vol_volume *v, struct pvx_diag *d)
{
    struct vdb *w = self;
    struct vol_vdb_bytes bytes = {NULL, 0};
    if (vol_numbered_wants(w->files, &v->v)) {
        struct vol_vdb_bricks b;
        struct vol_volume shown = *v;
        char err[256] = "";
        if (w->in_kelvin)
            PVX_TRY(vol_vdb_kelvin(&w->kelvin, v, &shown));
        vol_vdb_lay(&w->about, &shown, w->note, &b);
        int e =
            (w->nano ? w->module->write_nvdb : w->module->write_vdb)(&b, &bytes, err, sizeof err);
        if (e != PVX_OK)
            return vol_vdb_error(e, w->path, err, d);
    }
    pvx_err e = vol_numbered_put(w->files, &v->v, bytes.data, bytes.size, d);
    free(bytes.data);
    return e;
}

static pvx_err gap(void *self, const struct vol_gap *g, struct pvx_diag *d)
{
    (void)d;
    return vol_numbered_gap(((struct vdb *)self)->files, g);
}

static uint64_t bytes(const void *self)
{
    return vol_numbered_bytes(((const struct vdb *)self)->files);
}

static pvx_err close_all(void *self, struct pvx_diag *d)
{
    struct vdb *w = self;
    pvx_err e = vol_numbered_close(&w->files, d);
    vol_vdb_kelvin_free(&w->kelvin);
    free(w);
    return e;
}

const struct vol_writer_ops vol_vdb_writer = {.check = vdb_check,
                                              .open = vdb_open_vdb,
                                              .put = vdb_put,
                                              .gap = gap,
                                              .bytes = bytes,
                                              .close = close_all};
const struct vol_writer_ops vol_nvdb_writer = {.check = vdb_check,
                                               .open = vdb_open_nvdb,
                                               .put = vdb_put,
                                               .gap = gap,
                                               .bytes = bytes,
                                               .close = close_all};
