#include "daemon/cli/temperature/vdb.h"

#include <math.h>
#include <stdio.h>
#include <limits.h>
#include <stdlib.h>
#include <unistd.h>

#include "base/mem.h"
#include "daemon/volumes/folder.h"

#define CELLS ((size_t)PVP_BRICK * PVP_BRICK * PVP_BRICK)

pvx_err temperature_vdb_open(struct temperature_vdb *w, const char *dir,
                             const struct vol_head *head, struct pvx_diag *d)
{
    struct vol_head h = *head;
    h.start.grid.channels = 1;
    snprintf(h.start.units, sizeof h.start.units, "ppm");
    return vol_writer_open(VOL_VDB, dir, &h, NULL, &w->writer, d);
}

pvx_err temperature_vdb_check(struct temperature_vdb *w, const char *dir, struct pvx_diag *d)
{
    w->made = access(dir, F_OK) != 0;
    PVX_TRY(vol_writer_check(VOL_VDB, dir, d));
    snprintf(w->dir, sizeof w->dir, "%s", dir);
    return PVX_OK;
}

/* The folder had nothing in it, so that all files of these endings are ours (daemon/volumes/numbered.h). */
void temperature_vdb_remove(const struct temperature_vdb *w)
{
    static const char *const ends[] = {".vdb", ".json", "rig.yaml", "pyrovoxd.yaml"};
    char path[PATH_MAX];
    for (size_t k = 0; k < sizeof ends / sizeof *ends && w->dir[0] != '\0'; k++) {
        struct vol_folder f;
        if (vol_folder_list(w->dir, ends[k], &f, NULL) == PVX_OK)
            for (size_t i = 0; i < f.n; i++) {
                snprintf(path, sizeof path, "%s/%s", w->dir, f.name[i]);
                unlink(path);
            }
        vol_folder_free(&f);
    }
    if (w->dir[0] != '\0' && w->made)
        rmdir(w->dir);
}

static pvx_err vdb_room(struct temperature_vdb *w, uint32_t bricks)
{
    if (bricks <= w->room)
        return PVX_OK;
    w->room = 0;
    free(w->density);
    free(w->kelvin);
    w->density = pvx_calloc(bricks * CELLS, sizeof *w->density);
    w->kelvin = pvx_calloc(bricks * CELLS, sizeof *w->kelvin);
    if (w->density == NULL || w->kelvin == NULL)
        return PVX_ENOMEM;
    w->room = bricks;
    return PVX_OK;
}

/* What is seen of soot of unknown amount: Rec. 709. */
static float brightness(const float e[3])
{
    return 0.2126F * e[0] + 0.7152F * e[1] + 0.0722F * e[2];
}

pvx_err temperature_vdb_put(struct temperature_vdb *w, const struct vol_volume *v,
                            const struct temperature_voxels *t, struct pvx_diag *d)
{
    struct vol_volume one = *v;
    PVX_TRY(vdb_room(w, v->n_bricks));
    for (size_t i = 0; i < v->n_bricks * CELLS; i++) {
        float kelvin = t->field[0][i], ppm = t->field[2][i];
        bool known = isfinite(kelvin);
        w->kelvin[i] = known ? kelvin : 0;
        w->density[i] = !known ? 0 : isfinite(ppm) ? ppm : brightness(v->brick + 3 * i);
    }
    one.v.grid.channels = 1;
    one.brick = w->density;
    one.bars = (struct vol_bars){.sd = NULL};
    one.kelvin = w->kelvin;
    return vol_writer_put(w->writer, &one, d);
}

pvx_err temperature_vdb_close(struct temperature_vdb *w, struct pvx_diag *d)
{
    pvx_err e = vol_writer_close(&w->writer, d);
    PVX_FREE(w->density);
    PVX_FREE(w->kelvin);
    w->room = 0;
    return e;
}
