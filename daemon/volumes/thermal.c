#include "daemon/volumes/thermal.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/mem.h"
#include "daemon/volumes/hdf5.h"

#define B     PVP_BRICK
#define CELLS (B * B * B)
enum { RANK = 4, SET_COLS = 4, LEVEL_OF_DEFLATE = 4, MODED = 2 };

struct vol_thermal {
    char *path;
    struct take_h5_room room;
    hid_t file, field[VOL_THERMAL_MOST], col[SET_COLS];
    hid_t modes[MODED]; /* -1: no set has had any */
    uint32_t n_modes;   /* of a set, at most, so far */
    struct vol_thermal_field about[VOL_THERMAL_MOST];
    int n;
    struct pvp_grid grid;
    struct vol_tiles t;
    uint32_t nb[3], n_bricks, *brick_at; /* place of a brick + 1, 0: not there */
    uint64_t n_sets;
    int64_t t_first_ns;
    float chunk[VOL_CHUNK * VOL_CHUNK * VOL_CHUNK];
};

static pvx_err thermal_fail(const vol_thermal *t, const char *what, struct pvx_diag *d)
{
    return take_h5_fail(d, PVX_EIO, t->path, what);
}

/* ---- the file ----------------------------------------------------------------------------------- */

static bool thermal_head(hid_t file, const struct vol_head *h)
{
    const struct pvp_start *s = &h->start;
    double spacing[3];
    for (int a = 0; a < 3; a++)
        spacing[a] = (s->grid.max[a] - s->grid.min[a]) / s->grid.n[a];
    return take_h5_put_text(file, "format", VOL_THERMAL_FORMAT) &&
           take_h5_put_int(file, "version", VOL_THERMAL_VERSION) &&
           take_h5_put_int(file, "t_created_ns", pvx_now_real()) &&
           take_h5_put_int(file, "closed", 0) &&
           take_h5_put_attr(file, "session", H5T_STD_U64LE, &s->session) &&
           take_h5_put_attr(file, "rig_hash", H5T_STD_U64LE, &s->rig_hash) &&
           take_h5_put_text(file, "software", "pyrovox " PVX_VERSION) &&
           take_h5_put_list(file, "origin", H5T_IEEE_F64LE, 3, s->grid.min) &&
           take_h5_put_list(file, "spacing", H5T_IEEE_F64LE, 3, spacing) &&
           take_h5_put_long_text(file, "rig", h->rig != NULL ? h->rig : "");
}

static bool thermal_axis(hid_t file, const struct pvp_grid *g, int axis)
{
    const char *name = &"x\0y\0z"[2 * axis];
    hsize_t n = g->n[axis];
    double at[PVP_GRID_MAX], h = (g->max[axis] - g->min[axis]) / g->n[axis];
    for (uint32_t i = 0; i < g->n[axis]; i++)
        at[i] = g->min[axis] + (i + 0.5) * h;
    hid_t space = H5Screate_simple(1, &n, NULL);
    hid_t s = H5Dcreate2(file, name, H5T_IEEE_F64LE, space, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    bool ok = s >= 0 && H5Dwrite(s, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, at) >= 0 &&
              take_h5_put_text(s, "units", "m");
    H5Dclose(s);
    H5Sclose(space);
    return ok;
}

static bool thermal_field(vol_thermal *t, int k)
{
    const struct pvp_grid *g = &t->grid;
    const struct vol_thermal_field *f = &t->about[k];
    hsize_t now[RANK] = {0, g->n[2], g->n[1], g->n[0]};
    hsize_t most[RANK] = {H5S_UNLIMITED, g->n[2], g->n[1], g->n[0]};
    hsize_t chunk[RANK] = {1, t->t.side[2], t->t.side[1], t->t.side[0]};
    const float none = NAN;
    hid_t space = H5Screate_simple(RANK, now, most), p = H5Pcreate(H5P_DATASET_CREATE);
    H5Pset_chunk(p, RANK, chunk);
    H5Pset_shuffle(p);
    H5Pset_deflate(p, LEVEL_OF_DEFLATE);
    if (!f->small)
        H5Pset_fill_value(p, H5T_NATIVE_FLOAT, &none);
    t->field[k] = H5Dcreate2(t->file, f->name, f->small ? H5T_STD_U8LE : H5T_IEEE_F32LE, space,
                             H5P_DEFAULT, p, H5P_DEFAULT);
    H5Pclose(p);
    H5Sclose(space);
    return t->field[k] >= 0 && take_h5_put_text(t->field[k], "units", f->units);
}

static bool thermal_columns(vol_thermal *t)
{
    static const char *const names[SET_COLS] = {"time", "t_exposure_ns", "modes", "number"};
    const hid_t types[SET_COLS] = {H5T_IEEE_F64LE, H5T_STD_I64LE, H5T_STD_U32LE, H5T_STD_U64LE};
    hsize_t rows = VOL_ROWS;
    hid_t sets = H5Gcreate2(t->file, "sets", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    bool ok = sets >= 0;
    for (int k = 0; k < SET_COLS && ok; k++)
        ok = take_h5_make_table(sets, names[k], types[k], 1, &rows, &t->col[k]);
    H5Gclose(sets);
    return ok;
}

static pvx_err thermal_create(vol_thermal *t, const struct vol_head *head, struct pvx_diag *d)
{
    hid_t fapl = take_h5_access(VOL_ALIGN), fcpl = H5Pcreate(H5P_FILE_CREATE);
    pvx_err e = take_h5_create(&t->room, t->path, fcpl, fapl, &t->file, d);
    H5Pclose(fcpl);
    H5Pclose(fapl);
    if (e != PVX_OK)
        return e;
    bool ok = thermal_head(t->file, head) && thermal_columns(t);
    for (int a = 0; a < 3 && ok; a++)
        ok = thermal_axis(t->file, &t->grid, a);
    for (int k = 0; k < t->n && ok; k++)
        ok = thermal_field(t, k);
    return ok ? PVX_OK : thermal_fail(t, "cannot be begun", d);
}

pvx_err vol_thermal_open(const char *path, const struct vol_head *head,
                         const struct vol_thermal_field *field, int n, vol_thermal **out,
                         struct pvx_diag *d)
{
    *out = NULL;
    take_h5_init();
    PVX_TRY(take_h5_check(path, d));
    vol_thermal *t = pvx_calloc(1, sizeof *t);
    PVX_NEED(t);
    t->room.fd = -1;
    t->file = t->modes[0] = t->modes[1] = -1;
    t->n = n;
    memcpy(t->about, field, (size_t)n * sizeof *field);
    t->grid = head->start.grid;
    t->t = vol_tiles(&t->grid);
    t->path = strdup(path);
    t->n_bricks = pvp_grid_bricks(&t->grid, t->nb);
    t->brick_at = pvx_calloc(t->n_bricks, sizeof *t->brick_at);
    pvx_err e = t->path != NULL && t->brick_at != NULL ? PVX_OK : PVX_ENOMEM;
    PVX_THEN(e, thermal_create(t, head, d));
    if (e == PVX_OK)
        *out = t;
    else
        (void)vol_thermal_close(&t, false, NULL);
    return e;
}

pvx_err vol_thermal_note(vol_thermal *t, const char *key, double number, const char *text,
                         struct pvx_diag *d)
{
    take_h5_init();
    bool ok = text != NULL ? take_h5_put_text(t->file, key, text)
                           : take_h5_put_attr(t->file, key, H5T_IEEE_F64LE, &number);
    return ok ? PVX_OK : thermal_fail(t, "cannot be written", d);
}

/* ---- one set ------------------------------------------------------------------------------------ */

/* One plane of a set: a field, or one of its modes. */
struct plane {
    hid_t into;
    int mode;          /* -1: the dataset has none */
    float none;        /* where there is nothing: NAN or 0 */
    const float *from; /* [n_bricks][8^3] */
};

/* The plane in the chunk that begins at `at`, [z][y][x] of `n`; false: nothing in it. */
static bool thermal_chunk(const vol_thermal *t, const struct plane *p, const uint32_t at[3],
                          const hsize_t n[RANK], float *out)
{
    bool some = false;
    for (uint32_t k = 0; k < n[1]; k++)
        for (uint32_t j = 0; j < n[2]; j++)
            for (uint32_t i = 0; i < n[3]; i++, out++) {
                uint32_t x = at[0] + i, y = at[1] + j, z = at[2] + k;
                uint32_t b = t->brick_at[(z / B * t->nb[1] + y / B) * t->nb[0] + x / B];
                *out = b == 0 ? p->none
                              : p->from[(size_t)(b - 1) * CELLS + (z % B * B + y % B) * B + x % B];
                some |= isnan(p->none) ? !isnan(*out) : *out != 0;
            }
    return some;
}

static bool thermal_write(vol_thermal *t, const struct plane *p)
{
    const struct vol_tiles *c = &t->t;
    const int lead = p->mode >= 0 ? 2 : 1;
    hid_t space = H5Dget_space(p->into);
    bool ok = true;
    for (uint32_t id = 0; id < c->all && ok; id++) {
        const uint32_t at[3] = {id % c->n[0] * c->side[0], id / c->n[0] % c->n[1] * c->side[1],
                                id / c->n[0] / c->n[1] * c->side[2]};
        hsize_t from[RANK + 1] = {t->n_sets, p->mode >= 0 ? (hsize_t)p->mode : 0};
        hsize_t n[RANK + 1] = {1, 1}, flat[RANK] = {1};
        for (int a = 0; a < 3; a++) {
            uint32_t left = t->grid.n[a] - at[a];
            from[lead + 2 - a] = at[a];
            n[lead + 2 - a] = flat[3 - a] = left < c->side[a] ? left : c->side[a];
        }
        if (!thermal_chunk(t, p, at, flat, t->chunk))
            continue;
        hid_t memory = H5Screate_simple(RANK, flat, NULL);
        ok = H5Sselect_hyperslab(space, H5S_SELECT_SET, from, NULL, n, NULL) >= 0 &&
             H5Dwrite(p->into, H5T_NATIVE_FLOAT, memory, space, H5P_DEFAULT, t->chunk) >= 0;
        H5Sclose(memory);
    }
    H5Sclose(space);
    return ok;
}

static bool thermal_set(vol_thermal *t, const float *const *value)
{
    const struct pvp_grid *g = &t->grid;
    const hsize_t all[RANK] = {t->n_sets + 1, g->n[2], g->n[1], g->n[0]};
    bool ok = true;
    for (int k = 0; k < t->n && ok; k++) {
        const struct plane p = {t->field[k], -1, t->about[k].small ? 0.0F : NAN, value[k]};
        ok = H5Dset_extent(t->field[k], all) >= 0 && thermal_write(t, &p);
    }
    return ok;
}

/* The datasets of modes, from the first set on that has some. */
static bool thermal_make_modes(vol_thermal *t, uint32_t n)
{
    static const char *const names[MODED] = {"temperature_modes", "soot_modes"},
                             *const units[MODED] = {"K", "ppm"};
    const struct pvp_grid *g = &t->grid;
    const hsize_t now[RANK + 1] = {t->n_sets, n, g->n[2], g->n[1], g->n[0]};
    const hsize_t most[RANK + 1] = {H5S_UNLIMITED, H5S_UNLIMITED, g->n[2], g->n[1], g->n[0]};
    const hsize_t chunk[RANK + 1] = {1, 1, t->t.side[2], t->t.side[1], t->t.side[0]};
    hid_t space = H5Screate_simple(RANK + 1, now, most), p = H5Pcreate(H5P_DATASET_CREATE);
    bool ok = true;
    H5Pset_chunk(p, RANK + 1, chunk);
    H5Pset_shuffle(p);
    H5Pset_deflate(p, LEVEL_OF_DEFLATE);
    for (int k = 0; k < MODED && ok; k++) {
        t->modes[k] =
            H5Dcreate2(t->file, names[k], H5T_IEEE_F32LE, space, H5P_DEFAULT, p, H5P_DEFAULT);
        ok = t->modes[k] >= 0 && take_h5_put_text(t->modes[k], "units", units[k]);
    }
    H5Pclose(p);
    H5Sclose(space);
    return ok;
}

static bool thermal_modes(vol_thermal *t, const struct vol_volume *v,
                          const struct vol_thermal_modes *m)
{
    const struct pvp_grid *g = &t->grid;
    const float *const from[MODED] = {m->kelvin, m->soot};
    t->n_modes = m->n > t->n_modes ? m->n : t->n_modes;
    bool ok = t->modes[0] >= 0 || m->n == 0 || thermal_make_modes(t, m->n);
    const hsize_t all[RANK + 1] = {t->n_sets + 1, t->n_modes, g->n[2], g->n[1], g->n[0]};
    for (int k = 0; k < MODED && ok && t->modes[0] >= 0; k++) {
        ok = H5Dset_extent(t->modes[k], all) >= 0;
        for (uint32_t i = 0; i < m->n && ok; i++) {
            const struct plane p = {t->modes[k], (int)i, 0,
                                    from[k] + (size_t)i * v->n_bricks * CELLS};
            ok = thermal_write(t, &p);
        }
    }
    return ok;
}

pvx_err vol_thermal_put(vol_thermal *t, const struct vol_volume *v, const float *const *value,
                        const struct vol_thermal_modes *modes, struct pvx_diag *d)
{
    take_h5_init();
    if (memcmp(v->v.grid.n, t->grid.n, sizeof t->grid.n) != 0)
        return pvx_fail(d, PVX_ERANGE, "set %llu: its grid is not that of the recording",
                        (unsigned long long)v->v.set);
    for (uint32_t b = 0; b < v->n_bricks; b++)
        t->brick_at[v->ids[b]] = b + 1;
    pvx_err e = take_h5_reserve(&t->room, t->file, t->path,
                                (uint64_t)v->n_bricks * CELLS * sizeof(float) *
                                    ((uint64_t)t->n + (uint64_t)MODED * modes->n),
                                d);
    bool ok = e == PVX_OK && thermal_set(t, value) && thermal_modes(t, v, modes);
    for (uint32_t b = 0; b < v->n_bricks; b++)
        t->brick_at[v->ids[b]] = 0;
    PVX_TRY(e);
    if (t->n_sets == 0)
        t->t_first_ns = v->v.t_exposure_ns;
    double time = (double)(v->v.t_exposure_ns - t->t_first_ns) * 1e-9;
    ok = ok && take_h5_append(t->col[0], H5T_NATIVE_DOUBLE, 0, t->n_sets, 1, &time) &&
         take_h5_append(t->col[1], H5T_NATIVE_INT64, 0, t->n_sets, 1, &v->v.t_exposure_ns) &&
         take_h5_append(t->col[2], H5T_NATIVE_UINT32, 0, t->n_sets, 1, &modes->n) &&
         take_h5_append(t->col[3], H5T_NATIVE_UINT64, 0, t->n_sets, 1, &v->v.set);
    if (!ok)
        return thermal_fail(t, "cannot be written", d);
    t->n_sets++;
    return PVX_OK;
}

pvx_err vol_thermal_close(vol_thermal **tp, bool keep, struct pvx_diag *d)
{
    vol_thermal *t = *tp;
    pvx_err e = PVX_OK;
    if (t == NULL)
        return PVX_OK;
    take_h5_init();
    bool made = t->file >= 0;
    if (made && keep && !take_h5_put_int(t->file, "closed", 1))
        e = thermal_fail(t, "cannot be closed", d);
    if (made && H5Fclose(t->file) < 0 && keep)
        PVX_THEN(e, thermal_fail(t, "cannot be closed", d));
    if (t->room.fd >= 0) {
        off_t end = lseek(t->room.fd, 0, SEEK_END);
        if (keep && (end < 0 || ftruncate(t->room.fd, end) != 0 || fdatasync(t->room.fd) != 0))
            PVX_THEN(e, pvx_fail(d, PVX_EIO, "%s: cannot be closed", t->path));
        close(t->room.fd);
    }
    if (made && (!keep || e != PVX_OK))
        unlink(t->path);
    free(t->path);
    free(t->brick_at);
    PVX_FREE(*tp);
    return e;
}
