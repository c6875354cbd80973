/* hdf5_read.c - reads what hdf5_write.c wrote: a whole, growing or cut-off file.
 *
 * Everything in the file is checked before it is used: types, ranks, sizes, the chunks of a set against the hash in
 * its row.  A set counts when its row and all its chunks are there.  Sets are appended in order, so bisection finds
 * the first incomplete set of a file that was cut. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/file.h"
#include "base/mem.h"
#include "daemon/volumes/hdf5_bars.h"

#define SQUEEZE 1100 /* a byte of deflate gives no more bytes */

struct in {
    char *path;
    hid_t file, emission;
    struct vol_column column[VOL_COLUMNS];
    hid_t col[VOL_COLUMNS];
    struct pvp_start start;
    struct vol_bars_file bars;
    bool chunked;          /* as the recorder does it; else another program wrote it anew */
    bool modes;            /* are wanted */
    bool spare, closed;    /* damaged bars are left out; the file says that it is complete */
    uint64_t said, n_gaps; /* sets that the file claims; rows of gaps */
    char *rig, *config;
    struct vol_gap *gap;
    struct vol_unpacker unpack;
};

static pvx_err hdf5_read_wrong(const struct in *r, struct pvx_diag *d, const char *what)
{
    H5Eclear2(H5E_DEFAULT);
    return pvx_fail(d, PVX_EFORMAT, "%s: is not a recording of volumes, or damaged: %s", r->path,
                    what);
}

static bool hdf5_is(const char *path)
{
    uint64_t bytes;
    return take_h5_looks(path, &bytes);
}

/* ---- the head ---- */

static bool get_short(hid_t at, const char *name, char *out, size_t size)
{
    char *text = take_h5_get_text(at, name, false);
    bool ok = text != NULL && strlen(text) < size;
    if (ok)
        memcpy(out, text, strlen(text) + 1);
    free(text);
    return ok;
}

/* Whether its chunks are those of the recorder. */
static void look_at_layout(struct in *r)
{
    hsize_t side[VOL_RANK] = {0};
    hid_t p = H5Dget_create_plist(r->emission);
    H5D_layout_t layout = H5Pget_layout(p);
    const struct vol_tiles t = vol_tiles(&r->start.grid);
    r->chunked = layout == H5D_CHUNKED && H5Pget_chunk(p, VOL_RANK, side) == VOL_RANK &&
                 side[0] == 1 && side[1] == t.side[2] && side[2] == t.side[1] &&
                 side[3] == t.side[0] && side[4] == r->start.grid.channels;
    H5Pclose(p);
}

static pvx_err open_emission(struct in *r, uint64_t bytes, uint64_t *sets, struct pvx_diag *d)
{
    struct pvp_grid *g = &r->start.grid;
    hsize_t n[VOL_RANK];
    r->emission = vol_hdf5_filtered(r->file, "emission") || vol_hdf5_heaps_end(r->path, bytes)
                      ? H5Dopen2(r->file, "emission", H5P_DEFAULT)
                      : -1;
    if (r->emission < 0)
        return hdf5_read_wrong(r, d, "no emission");
    hid_t type = H5Dget_type(r->emission), space = H5Dget_space(r->emission);
    bool ok = H5Tequal(type, H5T_IEEE_F32LE) > 0 && H5Sget_simple_extent_ndims(space) == VOL_RANK &&
              H5Sget_simple_extent_dims(space, n, NULL) == VOL_RANK && (n[4] == 1 || n[4] == 3);
    H5Sclose(space);
    H5Tclose(type);
    for (int a = 0; a < 3 && ok; a++) {
        ok = n[3 - a] >= 1 && n[3 - a] <= PVP_GRID_MAX;
        g->n[a] = ok ? (uint32_t)n[3 - a] : 0;
    }
    if (!ok)
        return hdf5_read_wrong(r, d, "the shape of emission");
    g->channels = (uint32_t)n[4];
    *sets = n[0];
    int lacks = vol_hdf5_lacks(r->emission);
    if (lacks >= 0)
        return pvx_fail(d, PVX_EUNSUP,
                        "%s: is compressed by HDF5 filter %d, which this program lacks; write it "
                        "anew with gzip or without compression",
                        r->path, lacks);
    look_at_layout(r);
    return take_h5_is_inside(r->emission) ? PVX_OK
                                          : hdf5_read_wrong(r, d, "emission is in other files");
}

static pvx_err hdf5_read_read_head(struct in *r, uint64_t bytes, bool *closed, struct pvx_diag *d)
{
    struct pvp_start *s = &r->start;
    int64_t version, is_closed = 0, cameras = 0;
    char kind[32] = "", basis[16];
    double spacing[3];
    if (!get_short(r->file, "format", kind, sizeof kind) || strcmp(kind, VOL_FORMAT) != 0 ||
        !take_h5_get_int(r->file, "version", &version)) {
        bool take = strcmp(kind, "pyrovox take") == 0;
        return take ? pvx_fail(d, PVX_EFORMAT,
                               "%s: is a take of raw frames, not of volumes: see "
                               "`pyrovox replay --help`",
                               r->path)
                    : hdf5_read_wrong(r, d, "HDF5, but of another kind");
    }
    if (version != VOL_VERSION)
        return pvx_fail(d, PVX_EVERSION,
                        "%s: version %lld of the layout; this program reads %d: update it", r->path,
                        (long long)version, VOL_VERSION);
    PVX_TRY(open_emission(r, bytes, &r->said, d));
    r->rig = take_h5_get_text(r->file, "rig", true);
    r->config = take_h5_get_text(r->file, "config", true);
    bool ok = r->rig != NULL && r->config != NULL &&
              vol_hdf5_triple(r->file, "origin", s->grid.min) &&
              vol_hdf5_triple(r->file, "spacing", spacing) &&
              get_short(r->file, "units", s->units, sizeof s->units) &&
              get_short(r->file, "software", s->software, sizeof s->software) &&
              get_short(r->file, "basis", basis, sizeof basis) &&
              take_h5_get_int(r->file, "n_cameras", &cameras) && cameras >= 0 && cameras <= 64 &&
              take_h5_get_attr(r->file, "session", H5T_NATIVE_UINT64, 8, &s->session) &&
              take_h5_get_attr(r->file, "rig_hash", H5T_NATIVE_UINT64, 8, &s->rig_hash) &&
              take_h5_get_attr(r->file, "fps", H5T_NATIVE_DOUBLE, 8, &s->fps) && isfinite(s->fps);
    for (int a = 0; a < 3 && ok; a++)
        s->grid.max[a] = s->grid.min[a] + spacing[a] * s->grid.n[a];
    s->grid.basis = ok && strcmp(basis, "trilinear") == 0;
    if (!ok || !pvp_grid_valid(&s->grid))
        return hdf5_read_wrong(r, d, "an attribute of the head");
    s->n_cameras = (uint32_t)cameras;
    *closed = take_h5_get_int(r->file, "closed", &is_closed) && is_closed == 1;
    return PVX_OK;
}

static pvx_err open_columns(struct in *r, struct pvx_diag *d)
{
    for (int k = 0; k < VOL_COLUMNS; k++) {
        char name[64];
        uint64_t n;
        snprintf(name, sizeof name, "sets/%s", r->column[k].name);
        r->col[k] = take_h5_open_table(r->file, name, r->column[k].type, 1, NULL, &n);
        if (r->col[k] < 0)
            return hdf5_read_wrong(r, d, name);
        r->said = n < r->said ? n : r->said;
    }
    return PVX_OK;
}

static pvx_err hdf5_read_read_gaps(struct in *r, uint64_t file_bytes, struct pvx_diag *d)
{
    uint64_t n = UINT64_MAX, one, value;
    hid_t gap[VOL_GAP_COLS];
    for (int k = 0; k < VOL_GAP_COLS; k++) {
        char name[64];
        snprintf(name, sizeof name, "gaps/%s", vol_gap_columns[k]);
        gap[k] = take_h5_open_table(r->file, name, H5T_STD_U64LE, 1, NULL, &one);
        if (gap[k] < 0)
            return hdf5_read_wrong(r, d, name);
        n = one < n ? one : n;
    }
    if (n > file_bytes * SQUEEZE)
        return hdf5_read_wrong(r, d, "more gaps than it can have");
    r->gap = pvx_calloc(n, sizeof *r->gap);
    if (r->gap == NULL)
        return PVX_ENOMEM;
    for (uint64_t i = 0; i < n; i++) {
        uint64_t *to[VOL_GAP_COLS] = {&value, &r->gap[i].set_first, &r->gap[i].set_last,
                                      &r->gap[i].volumes};
        for (int k = 0; k < VOL_GAP_COLS; k++)
            if (!take_h5_read_rows(gap[k], H5T_NATIVE_UINT64, 1, 1, i, 1, to[k]))
                n = i;
        if (i >= n || value >= VOL_GAPS)
            break;
        r->gap[i].why = (enum vol_gap_why)value;
        r->n_gaps = i + 1;
    }
    H5Eclear2(H5E_DEFAULT);
    return PVX_OK;
}

/* ---- volumes ---- */

static bool read_row(struct in *r, uint64_t k, struct vol_row *row)
{
    memset(row, 0, sizeof *row);
    for (int c = 0; c < VOL_COLUMNS; c++)
        if (!take_h5_read_rows(r->col[c], r->column[c].type, 1, 1, k, 1,
                               (char *)row + r->column[c].offset))
            return false;
    return true;
}

bool vol_hdf5_rows(void *self, uint64_t n, struct vol_row *rows)
{
    struct in *r = self;
    take_h5_init();
    memset(rows, 0, n * sizeof *rows);
    bool ok = true;
    for (int c = 0; c < VOL_COLUMNS && ok; c++) {
        size_t size = H5Tget_size(r->column[c].type);
        char *all = pvx_calloc(n, size);
        ok = all != NULL && take_h5_read_rows(r->col[c], r->column[c].type, 1, 1, 0, n, all);
        for (uint64_t k = 0; k < n && ok; k++)
            memcpy((char *)&rows[k] + r->column[c].offset, all + k * size, size);
        free(all);
    }
    return ok;
}

bool vol_hdf5_bars_row(void *self, uint64_t k, struct vol_bars_row *r)
{
    return vol_bars_row(&((struct in *)self)->bars, k, r);
}

void vol_hdf5_has_bars(const void *self, bool *sd, uint32_t *modes)
{
    const struct vol_bars_file *b = &((const struct in *)self)->bars;
    *sd = b->sd >= 0;
    *modes = b->modes >= 0 ? b->n_modes : 0;
}

/* Read set k with the bars that b has.  look: check their modes too, though they are not wanted. */
static pvx_err hdf5_read_planes(struct in *r, uint64_t k, bool look, const struct vol_row *row,
                                const struct vol_bars_row *b)
{
    const struct vol_plane emission = {
        .from = r->emission, .chunked = r->chunked, .set = k, .mode = -1, .number = 0};
    uint64_t seed = 0;
    uint32_t found = 0;
    const bool modes = r->modes && b->modes > 0;
    PVX_TRY(vol_unpack_begin(&r->unpack,
                             b->doubt == VOL_NO_BARS ? 1
                             : modes                 ? 2 + b->modes
                                                     : 2,
                             (uint64_t)row->chunks + b->chunks + (modes ? b->modes_chunks : 0)));
    PVX_TRY(vol_unpack_plane(&r->unpack, &emission, 0, row->chunks, &seed, &found));
    if (found != row->chunks || row->check != vol_row_check(r->column, row, seed))
        return PVX_ECORRUPT;
    PVX_TRY(vol_bars_read(&r->unpack, &r->bars, b, k, row->check, modes, look));
    return vol_unpack_end(&r->unpack);
}

/* Read set k.  Where that is allowed, damaged modes are left out, or all bars, and *less says so.  PVX_ECORRUPT: it is not
 * as it was written. */
static pvx_err hdf5_read_load(struct in *r, uint64_t k, bool look, struct vol_row *row,
                              struct vol_bars_row *b, bool *less)
{
    *less = false;
    if (!read_row(r, k, row))
        return PVX_ECORRUPT;
    pvx_err e = vol_bars_row(&r->bars, k, b) ? hdf5_read_planes(r, k, look, row, b) : PVX_ECORRUPT;
    if (e == PVX_ECORRUPT && r->spare && b->modes > 0) {
        *less = true;
        b->modes = 0;
        e = hdf5_read_planes(r, k, look, row, b);
    }
    if (e == PVX_ECORRUPT && r->spare) {
        *less = true;
        *b = (struct vol_bars_row){.doubt = VOL_NO_BARS};
        e = hdf5_read_planes(r, k, look, row, b);
    }
    return e;
}

/* The bars of the set that was read last. */
static struct vol_bars bars_of(const struct in *r, const struct vol_bars_row *b, bool less)
{
    const struct vol_unpacker *u = &r->unpack;
    const size_t plane = u->n * u->cells;
    if (b->doubt == VOL_NO_BARS)
        return (struct vol_bars){.damaged = less};
    const bool modes = r->modes && b->modes > 0;
    return (struct vol_bars){.sd = u->brick + plane,
                             .n_modes = modes ? b->modes : 0,
                             .modes = modes ? u->brick + 2 * plane : NULL,
                             .doubt = b->doubt,
                             .damaged = less};
}

static void hdf5_modes(void *self, bool on)
{
    ((struct in *)self)->modes = on;
}

static pvx_err hdf5_get(void *self, uint64_t k, struct vol_volume *out, struct pvx_diag *d)
{
    struct in *r = self;
    struct vol_row row;
    struct vol_bars_row bars;
    bool less;
    take_h5_init();
    pvx_err e = hdf5_read_load(r, k, r->spare, &row, &bars, &less);
    H5Eclear2(H5E_DEFAULT);
    if (e != PVX_OK)
        return pvx_fail(
            d, e, "%s: volume %llu is damaged%s", r->path, (unsigned long long)k,
            e == PVX_ECORRUPT ? ", or its error bars; `pyrovox repair` keeps what is whole" : "");
    *out = (struct vol_volume){
        .v = {.session = r->start.session,
              .set = row.number,
              .t_exposure_ns = row.t_exposure_ns,
              .t_publish_ns = row.t_publish_ns,
              .spread_ns = row.spread_ns,
              .latency_ns = row.latency_ns,
              .cameras_present = row.cameras_present,
              .camera_mask = row.camera_mask,
              .grid = r->start.grid,
              .report = {.status = row.status,
                         .iterations = row.iterations,
                         .rel_residual = row.rel_residual,
                         .active_voxels = row.active_voxels,
                         .active_rays = row.active_rays,
                         .entries = row.entries,
                         .photometry_ns = row.photometry_ns,
                         .hull_ns = row.hull_ns,
                         .restrict_ns = row.restrict_ns,
                         .solve_ns = row.solve_ns,
                         .total_ns = row.total_ns}},
        .sample = row.sample == PVP_F16 ? PVP_F16 : PVP_F32,
        .clamped = row.clamped != 0,
        .n_bricks = r->unpack.n,
        .ids = r->unpack.ids,
        .brick = r->unpack.brick,
        .bars = bars_of(r, &bars, less),
    };
    memcpy(out->v.report.solver, row.solver, sizeof row.solver);
    out->v.report.solver[sizeof row.solver - 1] = '\0';
    return PVX_OK;
}

/* Number of complete sets from the first one on. */
static uint64_t whole_sets(struct in *r)
{
    struct vol_row row;
    struct vol_bars_row bars;
    bool less;
    uint64_t good = 0, bad = r->said; /* sets before `good` are complete, `bad` is not */
    if (bad > 0 && hdf5_read_load(r, bad - 1, true, &row, &bars, &less) == PVX_OK)
        good = bad;
    while (good < bad) {
        uint64_t mid = good + (bad - good) / 2;
        if (hdf5_read_load(r, mid, true, &row, &bars, &less) == PVX_OK)
            good = mid + 1;
        else
            bad = mid;
    }
    H5Eclear2(H5E_DEFAULT);
    return good;
}

static void hdf5_spare(void *self, uint64_t *count, bool *cut)
{
    struct in *r = self;
    take_h5_init();
    r->spare = true;
    *count = whole_sets(r);
    *cut = !r->closed || *count != r->said;
}

static void hdf5_read_hdf5_close(void *self)
{
    struct in *r = self;
    take_h5_init();
    if (r->file >= 0)
        H5Fclose(r->file); /* with all that is open in it */
    vol_columns_done(r->column);
    vol_unpacker_free(&r->unpack);
    free(r->path);
    free(r->rig);
    free(r->config);
    free(r->gap);
    free(r);
}

static pvx_err hdf5_read_open_all(struct in *r, const char *path, uint64_t *count, bool *cut,
                                  struct pvx_diag *d)
{
    uint64_t bytes;
    bool closed = false;
    PVX_TRY(pvx_file_check(path, d));
    if (!take_h5_looks(path, &bytes))
        return hdf5_read_wrong(r, d, "not HDF5");
    r->file = take_h5_open(path);
    if (r->file < 0)
        return hdf5_read_wrong(r, d, "libhdf5 cannot open it");
    PVX_TRY(hdf5_read_read_head(r, bytes, &closed, d));
    PVX_TRY(open_columns(r, d));
    PVX_TRY(hdf5_read_read_gaps(r, bytes, d));
    const char *wrong = vol_bars_open(r->file, path, bytes, &r->start.grid, &r->bars, &r->said);
    if (wrong != NULL)
        return hdf5_read_wrong(r, d, wrong);
    PVX_TRY(vol_unpacker_open(&r->unpack, &r->start.grid));
    *count = whole_sets(r);
    r->closed = closed;
    *cut = !closed || *count != r->said; /* the latter: it was cut after it was closed */
    return PVX_OK;
}

static pvx_err hdf5_read_hdf5_open(void **self, const char *path, struct vol_head *head,
                                   uint64_t *count, bool *cut, struct pvx_diag *d)
{
    take_h5_init();
    struct in *r = pvx_calloc(1, sizeof *r);
    PVX_NEED(r);
    r->file = -1;
    vol_columns(r->column);
    r->path = strdup(path);
    pvx_err e = r->path != NULL ? hdf5_read_open_all(r, path, count, cut, d) : PVX_ENOMEM;
    if (e != PVX_OK) {
        e = pvx_fail(d, e, "%s: %s", path, pvx_strerror(e));
        hdf5_read_hdf5_close(r);
        return e;
    }
    *head = (struct vol_head){.start = r->start,
                              .rig = r->rig[0] != '\0' ? r->rig : NULL,
                              .config = r->config[0] != '\0' ? r->config : NULL};
    *self = r;
    return PVX_OK;
}

static const struct vol_gap *hdf5_read_hdf5_gap(const void *self, uint64_t k)
{
    const struct in *r = self;
    return k < r->n_gaps ? &r->gap[k] : NULL;
}

const struct vol_reader_ops vol_hdf5_reader = {.is = hdf5_is,
                                               .open = hdf5_read_hdf5_open,
                                               .get = hdf5_get,
                                               .gap = hdf5_read_hdf5_gap,
                                               .modes = hdf5_modes,
                                               .spare = hdf5_spare,
                                               .close = hdf5_read_hdf5_close};
