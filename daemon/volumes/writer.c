#include <errno.h>
#include <libgen.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "base/mem.h"
#include "daemon/volumes/volumes.h"

const char *const vol_format_names[VOL_FORMATS] = {"npy", "hdf5", "vdb", "nvdb"};

bool vol_hdf5_name(const char *path)
{
    const char *end = strrchr(path, '.');
    return end != NULL && end > path && end[-1] != '/' &&
           (strcmp(end, ".h5") == 0 || strcmp(end, ".hdf5") == 0);
}

static const struct vol_writer_ops *const writers[VOL_FORMATS] = {
    [VOL_NPY] = &vol_npy_writer,
    [VOL_HDF5] = &vol_hdf5_writer,
    [VOL_VDB] = &vol_vdb_writer,
    [VOL_NVDB] = &vol_nvdb_writer,
};

#define MOST_HALF 65504.0F

struct vol_writer {
    enum vol_format format;
    const struct vol_writer_ops *ops;
    void *self;
    struct pvp_grid grid;
    char path[PATH_MAX];
    uint64_t keep_free_bytes;
    pvx_err broken; /* why nothing more is taken */
};

pvx_err vol_writer_check(enum vol_format f, const char *path, struct pvx_diag *d)
{
    return writers[f]->check(path, d);
}

pvx_err vol_writer_open(enum vol_format f, const char *path, const struct vol_head *head,
                        const struct vol_options *o, vol_writer **out, struct pvx_diag *d)
{
    static const struct vol_options defaults;
    *out = NULL;
    vol_writer *w = pvx_calloc(1, sizeof *w);
    PVX_NEED(w);
    if (o == NULL)
        o = &defaults;
    snprintf(w->path, sizeof w->path, "%s", path);
    w->keep_free_bytes = o->keep_free_bytes;
    w->format = f;
    w->ops = writers[f];
    w->grid = head->start.grid;
    pvx_err e = w->ops->open(&w->self, path, head, o, d);
    if (e != PVX_OK) {
        free(w);
        return e;
    }
    *out = w;
    return PVX_OK;
}

/* After an error of the disk nothing more is written: the file stays as it was. */
static pvx_err writer_note(vol_writer *w, pvx_err e)
{
    if (e == PVX_ENOSPC || e == PVX_EIO || e == PVX_EPERM)
        w->broken = e;
    return e;
}

static pvx_err is_broken(const vol_writer *w, struct pvx_diag *d)
{
    return w->broken == PVX_OK ? PVX_OK
                               : pvx_fail(d, w->broken, "the recording has ended before: %s",
                                          pvx_strerror(w->broken));
}

/* Whether there is room for the volume's size in memory, which is a little more than most formats need. */
static pvx_err writer_has_room(const vol_writer *w, const struct vol_volume *v, struct pvx_diag *d)
{
    struct statvfs st;
    char dir[PATH_MAX];
    snprintf(dir, sizeof dir, "%s", w->path);
    if (w->keep_free_bytes == 0 || statvfs(dirname(dir), &st) != 0)
        return PVX_OK;
    uint64_t left = (uint64_t)st.f_bavail * st.f_frsize;
    uint64_t planes = v->bars.sd != NULL ? 2 + v->bars.n_modes : 1;
    uint64_t need = planes * v->n_bricks * PVP_BRICK * PVP_BRICK * PVP_BRICK * v->v.grid.channels *
                    sizeof(float);
    return left >= w->keep_free_bytes + need
               ? PVX_OK
               : pvx_fail(d, PVX_ENOSPC,
                          "%s: the disk has less than the %.1f GB that are kept free", w->path,
                          (double)w->keep_free_bytes * 1e-9);
}

/* Whether the file still exists.  A deleted HDF5 file could be written on for hours, and nothing would remain. */
static pvx_err writer_is_there(const vol_writer *w, struct pvx_diag *d)
{
    return access(w->path, F_OK) == 0 || errno != ENOENT
               ? PVX_OK
               : pvx_fail(d, PVX_EIO,
                          "%s: was removed or renamed while it was written; record again, to a "
                          "place that stays",
                          w->path);
}

bool vol_beyond(enum vol_format f, const struct vol_volume *v)
{
    size_t n = (size_t)v->n_bricks * PVP_BRICK * PVP_BRICK * PVP_BRICK * v->v.grid.channels;
    bool beyond = false;
    for (size_t i = 0; i < n && f == VOL_VDB && !beyond; i++)
        beyond = fabsf(v->brick[i]) > MOST_HALF;
    return beyond;
}

pvx_err vol_writer_put(vol_writer *w, const struct vol_volume *v, struct pvx_diag *d)
{
    PVX_TRY(is_broken(w, d));
    if (!pvp_grid_same(&v->v.grid, &w->grid))
        return pvx_fail(d, PVX_ERANGE, "set %llu: its grid is not that of the recording",
                        (unsigned long long)v->v.set);
    struct pvx_diag own = {""}, gone = {""};
    struct vol_volume put = *v;
    put.clamped |= vol_beyond(w->format, v);
    pvx_err e = writer_has_room(w, v, &own);
    PVX_THEN(e, w->ops->put(w->self, &put, &own));
    if (writer_is_there(w, &gone) != PVX_OK) { /* says more than the format's own error */
        e = PVX_EIO;
        own = gone;
    }
    if (e != PVX_OK)
        pvx_fail(d, e, "%s", pvx_diag_text(&own, e));
    return writer_note(w, e);
}

pvx_err vol_writer_gap(vol_writer *w, const struct vol_gap *g, struct pvx_diag *d)
{
    PVX_TRY(is_broken(w, d));
    return writer_note(w, w->ops->gap(w->self, g, d));
}

void vol_writer_hurry(vol_writer *w, bool on)
{
    if (w->ops->hurry != NULL)
        w->ops->hurry(w->self, on);
}

uint64_t vol_writer_bytes(const vol_writer *w)
{
    return w->ops->bytes(w->self);
}

pvx_err vol_writer_close(vol_writer **wp, struct pvx_diag *d)
{
    if (*wp == NULL)
        return PVX_OK;
    pvx_err e = (*wp)->ops->close((*wp)->self, d);
    PVX_FREE(*wp);
    return e;
}
