#include "daemon/volumes/hdf5_bars.h"

#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <xxhash.h>

#include "base/mem.h"

#define MODES 32u /* a set may have, if the first one has fewer */

/* Their columns.  H5T_* are no constants, so a function gives the type. */
static const struct {
    const char *name;
    bool wide;
    size_t offset;
} cols[VOL_BARS_COLS] = {
    {"bars_doubt", false, offsetof(struct vol_bars_row, doubt)},
    {"bars_chunks", false, offsetof(struct vol_bars_row, chunks)},
    {"bars_check", true, offsetof(struct vol_bars_row, check)},
    {"modes", false, offsetof(struct vol_bars_row, modes)},
    {"modes_chunks", false, offsetof(struct vol_bars_row, modes_chunks)},
    {"modes_check", true, offsetof(struct vol_bars_row, modes_check)},
};

static hid_t col_type(int c)
{
    return cols[c].wide ? H5T_STD_U64LE : H5T_STD_U32LE;
}

uint64_t vol_bars_check(uint64_t chunks_hash, uint32_t number, uint32_t chunks)
{
    const uint32_t all[2] = {number, chunks};
    return XXH3_64bits_withSeed(all, sizeof all, chunks_hash);
}

/* ---- writing ---- */

/* A column of n rows, linked nowhere yet. */
static bool bars_column(hid_t file, int c, uint64_t n, const struct vol_bars_row *rows, hid_t *out)
{
    const size_t size = cols[c].wide ? 8 : 4;
    const hsize_t none = 0, most = H5S_UNLIMITED, chunk = VOL_ROWS;
    hid_t space = H5Screate_simple(1, &none, &most), p = H5Pcreate(H5P_DATASET_CREATE);
    H5Pset_chunk(p, 1, &chunk);
    *out = H5Dcreate_anon(file, col_type(c), space, p, H5P_DEFAULT);
    H5Pclose(p);
    H5Sclose(space);
    char *all = pvx_calloc(n, size);
    for (uint64_t k = 0; k < n && all != NULL; k++)
        memcpy(all + k * size, (const char *)&rows[k] + cols[c].offset, size);
    bool ok =
        all != NULL && *out >= 0 && (n == 0 || take_h5_append(*out, col_type(c), 0, 0, n, all));
    free(all);
    return ok;
}

static bool link_columns(hid_t file, int from, int to, const hid_t *col)
{
    hid_t sets = H5Gopen2(file, "sets", H5P_DEFAULT);
    bool ok = sets >= 0;
    for (int c = from; c < to && ok; c++)
        ok = H5Olink(col[c], sets, cols[c].name, H5P_DEFAULT, H5P_DEFAULT) >= 0;
    H5Gclose(sets);
    return ok;
}

bool vol_bars_columns(hid_t file, const struct vol_bars_row *rows, uint64_t n, bool modes)
{
    const int last = modes ? VOL_BARS_COLS : VOL_BARS_OWN;
    hid_t col[VOL_BARS_COLS];
    bool ok = true;
    int made = 0;
    while (made < last && ok)
        ok = bars_column(file, made, n, rows, &col[made]) && ++made > 0;
    ok = ok && link_columns(file, 0, last, col);
    for (int c = 0; c < made; c++)
        H5Dclose(col[c]);
    return ok;
}

/* Columns [from, to), whose rows so far say that there are none. */
static bool make_columns(hid_t file, int from, int to, uint64_t n, struct vol_bars_file *b)
{
    struct vol_bars_row *rows = pvx_calloc(n, sizeof *rows);
    bool ok = rows != NULL;
    for (uint64_t k = 0; k < n && ok; k++)
        rows[k].doubt = VOL_NO_BARS;
    for (int c = from; c < to && ok; c++)
        ok = bars_column(file, c, n, rows, &b->col[c]);
    free(rows);
    return ok;
}

static bool reach(hid_t set, const struct pvp_grid *g, uint64_t sets, uint32_t modes)
{
    const hsize_t flat[] = {sets, g->n[2], g->n[1], g->n[0], g->channels};
    const hsize_t deep[] = {sets, modes, g->n[2], g->n[1], g->n[0], g->channels};
    return H5Dset_extent(set, modes > 0 ? deep : flat) >= 0;
}

bool vol_bars_reach(const struct vol_bars_file *b, const struct pvp_grid *g, uint64_t sets)
{
    return reach(b->sd, g, sets, 0) && (b->modes < 0 || reach(b->modes, g, sets, b->n_modes));
}

bool vol_bars_append(const struct vol_bars_file *b, uint64_t n, const struct vol_bars_row *r)
{
    for (int c = 0; c < (b->modes >= 0 ? VOL_BARS_COLS : VOL_BARS_OWN); c++)
        if (!take_h5_append(b->col[c], col_type(c), 0, n, 1, (const char *)r + cols[c].offset))
            return false;
    return true;
}

/* A kill at any moment leaves a whole file: what is new is on the disk before anything leads to it, and readers look for it
 * by its link in the root, which comes last. */
static bool link_in(hid_t file, hid_t set, const char *name, int from, int to,
                    const struct vol_bars_file *b)
{
    return H5Fflush(file, H5F_SCOPE_LOCAL) >= 0 && link_columns(file, from, to, b->col) &&
           H5Fflush(file, H5F_SCOPE_LOCAL) >= 0 &&
           H5Olink(set, file, name, H5P_DEFAULT, H5P_DEFAULT) >= 0 &&
           H5Fflush(file, H5F_SCOPE_LOCAL) >= 0;
}

bool vol_bars_make(hid_t file, const struct vol_head *h, const struct vol_bars *bars,
                   uint64_t n_sets, struct vol_bars_file *b)
{
    const struct pvp_grid *g = &h->start.grid;
    bool ok = true;
    if (b->sd < 0) {
        b->sd = vol_pack_make(file, NULL, g, 0);
        ok = b->sd >= 0 && make_columns(file, 0, VOL_BARS_OWN, n_sets, b) &&
             reach(b->sd, g, n_sets, 0) && H5Fflush(file, H5F_SCOPE_LOCAL) >= 0 &&
             vol_hdf5_errors(file, b->sd, h) &&
             link_in(file, b->sd, "emission_sd", 0, VOL_BARS_OWN, b);
    }
    if (ok && b->modes < 0 && bars->n_modes > 0) {
        b->n_modes = bars->n_modes;
        b->most = 2 * bars->n_modes < MODES ? MODES : 2 * bars->n_modes;
        b->most = b->most < VOL_MODES_MAX ? b->most : VOL_MODES_MAX;
        b->modes = vol_pack_make(file, NULL, g, b->most);
        ok = b->modes >= 0 && make_columns(file, VOL_BARS_OWN, VOL_BARS_COLS, n_sets, b) &&
             reach(b->modes, g, n_sets, b->n_modes) &&
             take_h5_put_text(b->modes, "units", h->start.units) &&
             link_in(file, b->modes, "emission_modes", VOL_BARS_OWN, VOL_BARS_COLS, b);
    }
    return ok;
}

bool vol_bars_again(hid_t file, struct vol_bars_file *b)
{
    char name[64];
    bool ok = true;
    const bool had[2] = {b->sd >= 0, b->modes >= 0};
    if (had[0])
        ok = (b->sd = H5Dopen2(file, "emission_sd", H5P_DEFAULT)) >= 0;
    if (had[1])
        ok = ok && (b->modes = H5Dopen2(file, "emission_modes", H5P_DEFAULT)) >= 0;
    for (int c = 0; c < VOL_BARS_COLS && ok; c++) {
        snprintf(name, sizeof name, "sets/%s", cols[c].name);
        if (had[c >= VOL_BARS_OWN])
            ok = (b->col[c] = H5Dopen2(file, name, H5P_DEFAULT)) >= 0;
    }
    return ok;
}

/* ---- reading ---- */

/* A dataset of values: with `modes`, /emission_modes. */
static hid_t bars_values(hid_t set, const struct pvp_grid *g, uint32_t *modes, uint64_t *sets,
                         bool *chunked)
{
    hsize_t n[VOL_RANK + 1] = {0}, side[VOL_RANK + 1] = {0};
    const int lead = modes != NULL ? 2 : 1;
    if (set < 0)
        return -1;
    hid_t type = H5Dget_type(set), space = H5Dget_space(set), p = H5Dget_create_plist(set);
    bool ok = H5Tequal(type, H5T_IEEE_F32LE) > 0 && H5Sget_simple_extent_ndims(space) == lead + 4 &&
              H5Sget_simple_extent_dims(space, n, NULL) == lead + 4 && n[lead + 3] == g->channels &&
              take_h5_is_inside(set) && vol_hdf5_lacks(set) < 0;
    for (int a = 0; a < 3 && ok; a++)
        ok = n[lead + a] == g->n[2 - a];
    if (ok && modes != NULL)
        ok = n[1] >= 1 && n[1] <= VOL_MODES_MAX;
    if (ok && modes != NULL)
        *modes = (uint32_t)n[1];
    *chunked = H5Pget_layout(p) == H5D_CHUNKED && H5Pget_chunk(p, lead + 4, side) == lead + 4 &&
               side[0] == 1 && (lead == 1 || side[1] == 1) && side[lead + 3] == g->channels;
    const struct vol_tiles t = vol_tiles(g);
    for (int a = 0; a < 3; a++)
        *chunked &= side[lead + a] == t.side[2 - a];
    H5Pclose(p);
    H5Sclose(space);
    H5Tclose(type);
    if (!ok)
        H5Dclose(set);
    *sets = n[0] < *sets ? n[0] : *sets;
    return ok ? set : -1;
}

/* Opened only if that is safe, as /emission is. */
static hid_t bars_open(hid_t file, const char *name, const char *path, uint64_t bytes)
{
    return vol_hdf5_filtered(file, name) || vol_hdf5_heaps_end(path, bytes)
               ? H5Dopen2(file, name, H5P_DEFAULT)
               : -1;
}

static const char *open_cols(hid_t file, int from, int to, struct vol_bars_file *b, uint64_t *said)
{
    char name[64];
    uint64_t n;
    for (int c = from; c < to; c++) {
        snprintf(name, sizeof name, "sets/%s", cols[c].name);
        b->col[c] = take_h5_open_table(file, name, col_type(c), 1, NULL, &n);
        if (b->col[c] < 0)
            return cols[c].name;
        *said = n < *said ? n : *said;
    }
    return NULL;
}

const char *vol_bars_open(hid_t file, const char *path, uint64_t bytes, const struct pvp_grid *g,
                          struct vol_bars_file *b, uint64_t *said)
{
    *b = (struct vol_bars_file)VOL_BARS_FILE;
    if (H5Lexists(file, "emission_sd", H5P_DEFAULT) <= 0)
        return NULL;
    b->sd = bars_values(bars_open(file, "emission_sd", path, bytes), g, NULL, said, &b->sd_chunked);
    if (b->sd < 0)
        return "emission_sd";
    const char *wrong = open_cols(file, 0, VOL_BARS_OWN, b, said);
    if (wrong != NULL || H5Lexists(file, "emission_modes", H5P_DEFAULT) <= 0)
        return wrong;
    b->modes = bars_values(bars_open(file, "emission_modes", path, bytes), g, &b->n_modes, said,
                           &b->modes_chunked);
    return b->modes < 0 ? "emission_modes" : open_cols(file, VOL_BARS_OWN, VOL_BARS_COLS, b, said);
}

bool vol_bars_row(const struct vol_bars_file *b, uint64_t k, struct vol_bars_row *r)
{
    memset(r, 0, sizeof *r);
    r->doubt = VOL_NO_BARS;
    for (int c = 0; c < VOL_BARS_COLS; c++)
        if ((c < VOL_BARS_OWN ? b->sd : b->modes) >= 0 &&
            !take_h5_read_rows(b->col[c], col_type(c), 1, 1, k, 1, (char *)r + cols[c].offset))
            return false;
    if (r->doubt == VOL_NO_BARS)
        return r->chunks == 0 && r->check == 0 && r->modes == 0 && r->modes_chunks == 0 &&
               r->modes_check == 0;
    return r->modes <= b->n_modes && (r->modes > 0 || r->modes_check == 0);
}

static pvx_err read_modes(struct vol_unpacker *u, const struct vol_bars_file *b,
                          const struct vol_bars_row *r, uint64_t k, bool keep)
{
    struct vol_plane p = {.from = b->modes, .chunked = b->modes_chunked, .set = k};
    uint64_t seed = r->check;
    uint32_t found = 0;
    for (uint32_t m = 0; m < r->modes; m++) {
        p.mode = (int)m;
        p.number = keep ? 2 + m : UINT32_MAX;
        PVX_TRY(vol_unpack_plane(u, &p, m * u->t.all, r->modes_chunks, &seed, &found));
    }
    return found == r->modes_chunks && vol_bars_check(seed, r->modes, found) == r->modes_check
               ? PVX_OK
               : PVX_ECORRUPT;
}

pvx_err vol_bars_read(struct vol_unpacker *u, const struct vol_bars_file *b,
                      const struct vol_bars_row *r, uint64_t k, uint64_t row_check, bool keep,
                      bool look)
{
    if (r->doubt == VOL_NO_BARS)
        return PVX_OK;
    const struct vol_plane p = {.from = b->sd,
                                .chunked = b->sd_chunked,
                                .set = k,
                                .mode = -1,
                                .number = 1,
                                .not_below = true};
    uint64_t seed = row_check;
    uint32_t found = 0;
    PVX_TRY(vol_unpack_plane(u, &p, 0, r->chunks, &seed, &found));
    if (found != r->chunks || vol_bars_check(seed, r->doubt, found) != r->check)
        return PVX_ECORRUPT;
    return r->modes > 0 && (keep || look) ? read_modes(u, b, r, k, keep) : PVX_OK;
}
