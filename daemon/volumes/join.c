#include "daemon/volumes/join.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/file.h"
#include "base/mem.h"
#include "daemon/volumes/hdf5_bars.h"

#define NOWHERE UINT32_MAX

/* Where a set is. */
struct place {
    uint32_t part;
    bool gone; /* a part says that there is no volume of it */
    uint64_t row;
};

struct joining {
    const struct vol_join *j;
    struct vol_head head; /* of the first part that has volumes, which stays open: */
    void *first;
    uint64_t *count; /* [n_parts] sets of each */
    struct place *at;
    struct vol_row *row;
    struct vol_bars_row *bars;
    uint32_t *modes; /* [n_parts] that each has, 0 none */
    bool *sd;        /* [n_parts] */
    size_t n;        /* sets of the new file: at, row and bars have that many */
    char *tmp;
    hid_t file;
};

static int join_by_number(const void *a, const void *b)
{
    uint64_t x = *(const uint64_t *)a, y = *(const uint64_t *)b;
    return (x > y) - (x < y);
}

static struct place *join_find(struct joining *w, uint64_t number, size_t *k)
{
    const uint64_t *hit = bsearch(&number, w->j->number, w->j->n, sizeof number, join_by_number);
    if (hit == NULL)
        return NULL;
    *k = (size_t)(hit - w->j->number);
    return &w->at[*k];
}

static bool same_recording(const struct vol_head *a, const struct vol_head *b)
{
    return a->start.session == b->start.session && a->start.rig_hash == b->start.rig_hash &&
           pvp_grid_same(&a->start.grid, &b->start.grid) &&
           strcmp(a->rig != NULL ? a->rig : "", b->rig != NULL ? b->rig : "") == 0;
}

/* Take the rows of one part for the sets that no part before had. */
static pvx_err join_take_rows(struct joining *w, void *part, uint32_t p, struct pvx_diag *d)
{
    const struct vol_gap *g;
    size_t k;
    struct vol_row *row = pvx_calloc(w->count[p], sizeof *row);
    pvx_err e = row == NULL ? PVX_ENOMEM
                : vol_hdf5_rows(part, w->count[p], row)
                    ? PVX_OK
                    : pvx_fail(d, PVX_ECORRUPT, "%s: /sets cannot be read", w->j->part[p]);
    for (uint64_t i = 0; i < w->count[p] && e == PVX_OK; i++) {
        struct place *at = join_find(w, row[i].number, &k);
        if (at == NULL)
            e = pvx_fail(d, PVX_EFORMAT, "%s: set %llu is none of this recording", w->j->part[p],
                         (unsigned long long)row[i].number);
        if (at != NULL && at->part == NOWHERE) {
            *at = (struct place){.part = p, .row = i};
            w->row[k] = row[i];
            if (!vol_hdf5_bars_row(part, i, &w->bars[k]))
                e = pvx_fail(d, PVX_ECORRUPT, "%s: its error bars are damaged", w->j->part[p]);
        }
    }
    vol_hdf5_has_bars(part, &w->sd[p], &w->modes[p]);
    free(row);
    if (e != PVX_OK)
        return e;
    for (uint64_t i = 0; (g = vol_hdf5_reader.gap(part, i)) != NULL; i++)
        for (k = 0; k < w->j->n; k++)
            w->at[k].gone |= w->j->number[k] >= g->set_first && w->j->number[k] <= g->set_last;
    return PVX_OK;
}

static pvx_err read_part(struct joining *w, uint32_t p, struct pvx_diag *d)
{
    struct vol_head head;
    void *part;
    bool cut;
    PVX_TRY(vol_hdf5_reader.open(&part, w->j->part[p], &head, &w->count[p], &cut, d));
    pvx_err e = cut ? PVX_OK
                : w->first == NULL || same_recording(&w->head, &head)
                    ? join_take_rows(w, part, p, d)
                    : pvx_fail(d, PVX_EFORMAT, "%s: is of another recording than %s", w->j->part[p],
                               w->j->part[0]);
    if (e == PVX_OK && !cut && w->first == NULL && w->count[p] > 0) {
        w->first = part;
        w->head = head;
    } else {
        vol_hdf5_reader.close(part);
    }
    return e;
}

/* Leave out sets that will never have a volume; the others keep their order.  Returns how many are missing. */
static size_t close_ranks(struct joining *w)
{
    size_t missing = 0;
    for (size_t k = 0; k < w->j->n; k++) {
        if (w->at[k].part == NOWHERE && w->at[k].gone)
            continue;
        if (w->at[k].part == NOWHERE) {
            missing++;
            w->row[k] = (struct vol_row){.number = w->j->number[k],
                                         .status = VOL_UNSOLVED,
                                         .time = NAN,
                                         .rel_residual = NAN};
            w->bars[k] = (struct vol_bars_row){.doubt = VOL_NO_BARS};
        }
        w->at[w->n] = w->at[k];
        w->bars[w->n] = w->bars[k];
        w->row[w->n++] = w->row[k];
    }
    /* times of a part count from its own first set, those of the new file from the first of all */
    bool any = false;
    int64_t t0 = 0;
    for (size_t k = 0; k < w->n; k++) {
        if (w->at[k].part == NOWHERE)
            continue;
        t0 = any ? t0 : w->row[k].t_exposure_ns;
        any = true;
        w->row[k].time = (double)(w->row[k].t_exposure_ns - t0) * 1e-9;
    }
    return missing;
}

static bool put_columns(struct joining *w)
{
    struct vol_column column[VOL_COLUMNS];
    hsize_t rows = VOL_ROWS;
    hid_t sets = H5Gcreate2(w->file, "sets", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    bool ok = sets >= 0;
    vol_columns(column);
    for (int c = 0; c < VOL_COLUMNS && ok; c++) {
        size_t size = H5Tget_size(column[c].type);
        char *all = malloc(w->n * size);
        hid_t table = -1;
        for (size_t k = 0; k < w->n && all != NULL; k++)
            memcpy(all + k * size, (const char *)&w->row[k] + column[c].offset, size);
        ok = all != NULL &&
             take_h5_make_table(sets, column[c].name, column[c].type, 1, &rows, &table) &&
             take_h5_append(table, column[c].type, 0, 0, w->n, all);
        H5Dclose(table);
        free(all);
    }
    vol_columns_done(column);
    H5Gclose(sets);
    return ok;
}

/* One gap for each run of sets that no part has solved. */
static bool join_put_gaps(struct joining *w)
{
    hid_t gaps = H5Gcreate2(w->file, "gaps", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    hid_t table[VOL_GAP_COLS];
    hsize_t rows = VOL_ROWS, n_gaps = 0;
    bool ok = gaps >= 0;
    for (int c = 0; c < VOL_GAP_COLS; c++) {
        table[c] = -1;
        ok = ok && take_h5_make_table(gaps, vol_gap_columns[c], H5T_STD_U64LE, 1, &rows, &table[c]);
    }
    for (size_t k = 0, n; k < w->n && ok; k += n) {
        for (n = 1; k + n < w->n && (w->at[k + n].part == NOWHERE) == (w->at[k].part == NOWHERE);)
            n++;
        if (w->at[k].part != NOWHERE)
            continue;
        const uint64_t gap[VOL_GAP_COLS] = {VOL_GAP_UNSOLVED, w->row[k].number,
                                            w->row[k + n - 1].number, n};
        for (int c = 0; c < VOL_GAP_COLS && ok; c++)
            ok = take_h5_append(table[c], H5T_STD_U64LE, 0, n_gaps, 1, &gap[c]);
        n_gaps++;
    }
    for (int c = 0; c < VOL_GAP_COLS; c++)
        H5Dclose(table[c]);
    H5Gclose(gaps);
    return ok;
}

/* A dataset of the new file over those of the parts: [set][z][y][x][c], or with modes [set][mode][z][y][x][c]. */
struct view {
    const char *name;
    uint32_t modes;
};

static bool view_in(const struct joining *w, const struct view *v, const struct place *at)
{
    return strcmp(v->name, "/emission") == 0 ||
           (v->modes > 0 ? w->modes[at->part] > 0 : w->sd[at->part]);
}

static int view_shape(const struct joining *w, const struct view *v, hsize_t sets, uint32_t modes,
                      hsize_t out[VOL_RANK + 1])
{
    const struct pvp_grid *g = &w->head.start.grid;
    const int lead = v->modes > 0 ? 2 : 1;
    out[0] = sets;
    out[1] = modes;
    for (int a = 0; a < 3; a++)
        out[lead + a] = g->n[2 - a];
    out[lead + 3] = g->channels;
    return lead + 4;
}

/* Map sets [k, k + n) of the new file to `n` consecutive ones of a part. */
static bool map_run(struct joining *w, const struct view *v, hid_t p, hid_t space, size_t k,
                    size_t n)
{
    const struct place *at = &w->at[k];
    const char *path = w->j->part[at->part], *slash = strrchr(w->j->out, '/');
    const char *name = slash != NULL ? path + (slash - w->j->out) + 1 : path;
    const hsize_t to[VOL_RANK + 1] = {k}, from[VOL_RANK + 1] = {at->row};
    hsize_t whole[VOL_RANK + 1], size[VOL_RANK + 1];
    view_shape(w, v, n, w->modes[at->part], size);
    hid_t source = H5Screate_simple(view_shape(w, v, w->count[at->part], w->modes[at->part], whole),
                                    whole, NULL);
    bool ok = H5Sselect_hyperslab(source, H5S_SELECT_SET, from, NULL, size, NULL) >= 0 &&
              H5Sselect_hyperslab(space, H5S_SELECT_SET, to, NULL, size, NULL) >= 0 &&
              H5Pset_virtual(p, space, name, v->name, source) >= 0;
    H5Sclose(source);
    return ok;
}

static bool put_view(struct joining *w, const struct view *v)
{
    hsize_t all[VOL_RANK + 1];
    const float unsolved = NAN;
    hid_t space = H5Screate_simple(view_shape(w, v, w->n, v->modes, all), all, NULL);
    hid_t p = H5Pcreate(H5P_DATASET_CREATE);
    bool ok = H5Pset_fill_value(p, H5T_NATIVE_FLOAT, &unsolved) >= 0;
    for (size_t k = 0, n; k < w->n && ok; k += n) {
        for (n = 1; k + n < w->n && w->at[k + n].part == w->at[k].part &&
                    (w->at[k].part == NOWHERE || w->at[k + n].row == w->at[k].row + n);)
            n++;
        ok = w->at[k].part == NOWHERE || !view_in(w, v, &w->at[k]) || map_run(w, v, p, space, k, n);
    }
    H5Sselect_all(space);
    hid_t s =
        ok ? H5Dcreate2(w->file, v->name, H5T_IEEE_F32LE, space, H5P_DEFAULT, p, H5P_DEFAULT) : -1;
    H5Dclose(s);
    H5Pclose(p);
    H5Sclose(space);
    return s >= 0;
}

static bool put_emission(struct joining *w)
{
    return put_view(w, &(struct view){"/emission", 0});
}

static bool join_put_errors(struct joining *w)
{
    hid_t sd = H5Dopen2(w->file, "emission_sd", H5P_DEFAULT);
    bool ok = sd >= 0 && vol_hdf5_errors(w->file, sd, &w->head);
    H5Dclose(sd);
    return ok;
}

/* Once /sets and the groups of NeXus are there. */
static bool join_put_bars(struct joining *w)
{
    bool sd = false;
    uint32_t modes = 0;
    for (uint32_t p = 0; p < w->j->n_parts; p++) {
        sd |= w->sd[p];
        modes = w->modes[p] > modes ? w->modes[p] : modes;
    }
    return !sd || (put_view(w, &(struct view){"/emission_sd", 0}) &&
                   (modes == 0 || put_view(w, &(struct view){"/emission_modes", modes})) &&
                   vol_bars_columns(w->file, w->bars, w->n, modes > 0) && join_put_errors(w));
}

static pvx_err write_out(struct joining *w, size_t missing, struct pvx_diag *d)
{
    hid_t fapl = take_h5_access(VOL_ALIGN);
    w->file = H5Fcreate(w->tmp, H5F_ACC_TRUNC, H5P_DEFAULT, fapl);
    H5Pclose(fapl);
    bool ok = w->file >= 0 && vol_hdf5_head(w->file, &w->head) && put_emission(w) &&
              put_columns(w) && join_put_gaps(w) && vol_hdf5_nexus(w->file, &w->head) &&
              join_put_bars(w) && vol_hdf5_vtk(w->file, &w->head.start.grid, w->n) &&
              take_h5_put_int(w->file, "t_closed_ns", missing == 0 ? pvx_now_real() : 0) &&
              take_h5_put_int(w->file, "closed", missing == 0);
    pvx_err e = ok ? PVX_OK : take_h5_fail(d, PVX_EIO, w->j->out, "cannot be joined");
    if (w->file >= 0 && H5Fclose(w->file) < 0 && e == PVX_OK)
        e = take_h5_fail(d, PVX_EIO, w->j->out, "cannot be joined");
    PVX_THEN(e, pvx_file_sync(w->tmp, d));
    if (e == PVX_OK && rename(w->tmp, w->j->out) != 0)
        e = pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", w->j->out, strerror(errno));
    if (e != PVX_OK)
        unlink(w->tmp);
    return e;
}

static pvx_err volumes_join(struct joining *w, size_t *missing, struct pvx_diag *d)
{
    for (size_t k = 0; k < w->j->n; k++)
        w->at[k].part = NOWHERE;
    for (uint32_t p = 0; p < w->j->n_parts; p++)
        PVX_TRY(read_part(w, p, d));
    *missing = close_ranks(w);
    if (w->first == NULL)
        return pvx_fail(d, PVX_ENOENT, "%s: no part of it has a volume yet", w->j->out);
    return write_out(w, *missing, d);
}

pvx_err vol_join_check(const char *path, struct pvx_diag *d)
{
    return access(path, F_OK) != 0 || vol_joined_reader.is(path)
               ? PVX_OK
               : pvx_fail(d, PVX_EBUSY,
                          "%s: is there already, and not made of parts; name another file", path);
}

pvx_err vol_join(const struct vol_join *j, size_t *missing, struct pvx_diag *d)
{
    struct joining w = {.j = j};
    char host[256] = ""; /* processes of two nodes may have the same number */
    gethostname(host, sizeof host - 1);
    take_h5_init();
    *missing = j->n;
    PVX_TRY(vol_join_check(j->out, d));
    w.count = pvx_calloc(j->n_parts, sizeof *w.count);
    w.at = pvx_calloc(j->n, sizeof *w.at);
    w.row = pvx_calloc(j->n, sizeof *w.row);
    w.bars = pvx_calloc(j->n, sizeof *w.bars);
    w.modes = pvx_calloc(j->n_parts, sizeof *w.modes);
    w.sd = pvx_calloc(j->n_parts, sizeof *w.sd);
    pvx_err e = asprintf(&w.tmp, "%s.tmp.%s.%ld", j->out, host, (long)getpid()) < 0 ||
                        w.count == NULL || w.at == NULL || w.row == NULL || w.bars == NULL ||
                        w.modes == NULL || w.sd == NULL
                    ? pvx_fail(d, PVX_ENOMEM, "%s: no memory for %zu sets", j->out, j->n)
                    : volumes_join(&w, missing, d);
    H5Eclear2(H5E_DEFAULT);
    if (w.first != NULL)
        vol_hdf5_reader.close(w.first);
    free(w.count);
    free(w.at);
    free(w.row);
    free(w.bars);
    free(w.modes);
    free(w.sd);
    free(w.tmp);
    return e;
}
