/* hdf5_write.c - a growing HDF5 file of volumes (daemon/VOLUMES.md).
 *
 * The chunks of a volume, then those of its error bars, are packed (hdf5_pack.h) and written as they are, then the
 * volume's row in each column, then the file is flushed.  So an SWMR reader, and a file that a kill leaves, end with a whole set. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/file.h"
#include "base/mem.h"
#include "daemon/volumes/hdf5_bars.h"

#define B         PVP_BRICK
#define ROOT_MOST 64 /* attributes, links */
#define SYNC_NS \
    (2 * PVX_NS_PER_S) /* a power cut takes no more than what came since, and what took the disk */

struct out {
    char *path;
    struct take_h5_room room;
    hid_t file, emission;
    struct vol_column column[VOL_COLUMNS];
    hid_t col[VOL_COLUMNS], gap[VOL_GAP_COLS];
    struct vol_bars_file bars;
    struct pvp_grid grid;
    char units[32];
    uint64_t n_sets, n_gaps, bytes;
    int64_t t_first_ns, t_synced_ns;
    struct vol_packer pack;
};

static pvx_err hdf5_write_fail(struct out *w, const char *what, struct pvx_diag *d)
{
    return take_h5_fail(d, PVX_EIO, w->path, what);
}

static bool reach(hid_t set, const struct pvp_grid *g, uint64_t sets)
{
    const hsize_t all[VOL_RANK] = {sets, g->n[2], g->n[1], g->n[0], g->channels};
    return H5Dset_extent(set, all) >= 0;
}

static void fill_row(struct out *w, const struct vol_volume *vol, struct vol_row *r)
{
    const struct pvp_volume *v = &vol->v;
    const struct pvp_report *p = &v->report;
    if (w->n_sets == 0)
        w->t_first_ns = v->t_exposure_ns;
    *r = (struct vol_row){.number = v->set,
                          .camera_mask = v->camera_mask,
                          .entries = p->entries,
                          .time = (double)(v->t_exposure_ns - w->t_first_ns) * 1e-9,
                          .rel_residual = p->rel_residual,
                          .t_exposure_ns = v->t_exposure_ns,
                          .t_publish_ns = v->t_publish_ns,
                          .spread_ns = v->spread_ns,
                          .latency_ns = v->latency_ns,
                          .photometry_ns = p->photometry_ns,
                          .hull_ns = p->hull_ns,
                          .restrict_ns = p->restrict_ns,
                          .solve_ns = p->solve_ns,
                          .total_ns = p->total_ns,
                          .cameras_present = v->cameras_present,
                          .status = p->status,
                          .iterations = p->iterations,
                          .active_voxels = p->active_voxels,
                          .active_rays = p->active_rays,
                          .chunks = w->pack.n_chunks,
                          .clamped = vol->clamped,
                          .sample = (uint8_t)vol->sample};
    memcpy(r->solver, p->solver, sizeof r->solver);
    r->solver[sizeof r->solver - 1] = '\0';
    r->check = vol_row_check(w->column, r, vol_pack_hash(&w->pack, 0, 0));
}

static pvx_err sync_file(struct out *w, struct pvx_diag *d)
{
    w->t_synced_ns = pvx_now_mono();
    return fdatasync(w->room.fd) == 0 || errno == EINVAL
               ? PVX_OK
               : pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", w->path, strerror(errno));
}

/* The datasets of a file that was closed. */
static bool open_again(struct out *w)
{
    char name[64];
    w->emission = H5Dopen2(w->file, "emission", H5P_DEFAULT);
    bool ok = w->emission >= 0;
    for (int k = 0; k < VOL_COLUMNS && ok; k++) {
        snprintf(name, sizeof name, "sets/%s", w->column[k].name);
        ok = (w->col[k] = H5Dopen2(w->file, name, H5P_DEFAULT)) >= 0;
    }
    for (int k = 0; k < VOL_GAP_COLS && ok; k++) {
        snprintf(name, sizeof name, "gaps/%s", vol_gap_columns[k]);
        ok = (w->gap[k] = H5Dopen2(w->file, name, H5P_DEFAULT)) >= 0;
    }
    return ok;
}

/* Packs one plane of the volume and writes it to a dataset. */
static pvx_err put_plane(struct out *w, const struct vol_volume *v, const float *brick, hid_t to,
                         int mode, struct pvx_diag *d)
{
    uint64_t bytes;
    if (vol_pack(&w->pack, v->n_bricks, v->ids, brick, &bytes) != PVX_OK)
        return pvx_fail(d, PVX_ENOMEM, "%s: no memory for %u chunks", w->path, w->pack.n_chunks);
    PVX_TRY(take_h5_reserve(&w->room, w->file, w->path, bytes, d));
    w->bytes += bytes;
    return vol_pack_put(&w->pack, to, w->n_sets, mode) ? PVX_OK
                                                       : hdf5_write_fail(w, "cannot be written", d);
}

static pvx_err put_modes(struct out *w, const struct vol_volume *v, struct vol_bars_row *r,
                         struct pvx_diag *d)
{
    const struct vol_bars *bars = &v->bars;
    const size_t plane = (size_t)v->n_bricks * B * B * B * w->grid.channels;
    uint64_t seed = r->check;
    for (uint32_t m = 0; m < bars->n_modes; m++) {
        PVX_TRY(put_plane(w, v, bars->modes + m * plane, w->bars.modes, (int)m, d));
        seed = vol_pack_hash(&w->pack, seed, m * w->pack.t.all);
        r->modes_chunks += w->pack.n_chunks;
    }
    r->modes = bars->n_modes;
    r->modes_check = bars->n_modes > 0 ? vol_bars_check(seed, r->modes, r->modes_chunks) : 0;
    return PVX_OK;
}

/* The bars of a set, or that it has none, once the file has room for any. */
static pvx_err put_bars(struct out *w, const struct vol_volume *v, uint64_t row_check,
                        struct pvx_diag *d)
{
    struct vol_bars_row r = {.doubt = VOL_NO_BARS};
    if (w->bars.sd < 0)
        return PVX_OK;
    if (!vol_bars_reach(&w->bars, &w->grid, w->n_sets + 1))
        return hdf5_write_fail(w, "cannot be written", d);
    if (v->bars.sd != NULL) {
        PVX_TRY(put_plane(w, v, v->bars.sd, w->bars.sd, -1, d));
        r.doubt = v->bars.doubt;
        r.chunks = w->pack.n_chunks;
        r.check = vol_bars_check(vol_pack_hash(&w->pack, row_check, 0), r.doubt, r.chunks);
        PVX_TRY(put_modes(w, v, &r, d));
    }
    return vol_bars_append(&w->bars, w->n_sets, &r) ? PVX_OK
                                                    : hdf5_write_fail(w, "cannot be written", d);
}

/* Another set may have more of them. */
static pvx_err more_modes(struct out *w, const struct vol_volume *v, struct pvx_diag *d)
{
    uint32_t n = v->bars.sd != NULL ? v->bars.n_modes : 0;
    if (n > w->bars.most)
        return pvx_fail(d, PVX_ERANGE,
                        "%s: set %llu has error bars of %u modes, the recording has room for %u",
                        w->path, (unsigned long long)v->v.set, n, w->bars.most);
    w->bars.n_modes = n > w->bars.n_modes ? n : w->bars.n_modes;
    return PVX_OK;
}

/* Nothing new can be made in a file in SWMR mode, so it is closed and opened again, once or twice in its life. */
static pvx_err begin_bars(struct out *w, const struct vol_volume *v, struct pvx_diag *d)
{
    const struct vol_bars *bars = &v->bars;
    if (bars->sd == NULL || (w->bars.sd >= 0 && (w->bars.modes >= 0 || bars->n_modes == 0)))
        return more_modes(w, v, d);
    struct vol_head head = {.start = {.grid = w->grid}};
    memcpy(head.start.units, w->units, sizeof w->units);
    PVX_TRY(take_h5_reserve(&w->room, w->file, w->path, 0, d));
    bool ok = H5Fclose(w->file) >= 0;
    hid_t fapl = take_h5_access(VOL_ALIGN);
    H5Pset_small_data_block_size(fapl, 0);
    w->file = ok ? H5Fopen(w->path, H5F_ACC_RDWR, fapl) : -1;
    H5Pclose(fapl);
    if (w->file < 0)
        return hdf5_write_fail(w, "cannot be opened again", d);
    off_t end = lseek(w->room.fd, 0, SEEK_END);
    w->room.reserved = end > 0 ? (uint64_t)end : 0; /* closing gave back what was beyond */
    PVX_TRY(take_h5_reserve(&w->room, w->file, w->path, 0, d));
    ok = vol_bars_again(w->file, &w->bars) &&
         vol_bars_make(w->file, &head, bars, w->n_sets, &w->bars) && open_again(w) &&
         H5Fstart_swmr_write(w->file) >= 0;
    return ok ? PVX_OK : hdf5_write_fail(w, "cannot hold error bars", d);
}

static pvx_err hdf5_put(void *self, const struct vol_volume *v, struct pvx_diag *d)
{
    struct out *w = self;
    struct vol_row r;
    take_h5_init();
    PVX_TRY(begin_bars(w, v, d));
    if (!reach(w->emission, &w->grid, w->n_sets + 1))
        return hdf5_write_fail(w, "cannot be written", d);
    PVX_TRY(put_plane(w, v, v->brick, w->emission, -1, d));
    fill_row(w, v, &r);
    PVX_TRY(put_bars(w, v, r.check, d));
    bool ok = true;
    for (int k = 0; k < VOL_COLUMNS && ok; k++)
        ok = take_h5_append(w->col[k], w->column[k].type, 0, w->n_sets, 1,
                            (const char *)&r + w->column[k].offset);
    if (!ok || H5Fflush(w->file, H5F_SCOPE_LOCAL) < 0)
        return hdf5_write_fail(w, "cannot be written", d);
    w->n_sets++;
    w->bytes += sizeof r;
    return pvx_now_mono() - w->t_synced_ns < SYNC_NS ? PVX_OK : sync_file(w, d);
}

static pvx_err hdf5_write_hdf5_gap(void *self, const struct vol_gap *g, struct pvx_diag *d)
{
    struct out *w = self;
    const uint64_t row[VOL_GAP_COLS] = {g->why, g->set_first, g->set_last, g->volumes};
    take_h5_init();
    PVX_TRY(take_h5_reserve(&w->room, w->file, w->path, 0, d));
    bool ok = true;
    for (int k = 0; k < VOL_GAP_COLS && ok; k++)
        ok = take_h5_append(w->gap[k], H5T_STD_U64LE, 0, w->n_gaps, 1, &row[k]);
    if (!ok || H5Fflush(w->file, H5F_SCOPE_LOCAL) < 0)
        return hdf5_write_fail(w, "cannot be written", d);
    w->n_gaps++;
    return PVX_OK;
}

/* ---- the file ---- */

static bool make_columns(struct out *w)
{
    hsize_t rows = VOL_ROWS;
    hid_t sets = vol_hdf5_group(w->file, "sets");
    hid_t gaps = H5Gcreate2(w->file, "gaps", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    bool ok = sets >= 0 && gaps >= 0;
    for (int k = 0; k < VOL_COLUMNS && ok; k++)
        ok = take_h5_make_table(sets, w->column[k].name, w->column[k].type, 1, &rows, &w->col[k]);
    for (int k = 0; k < VOL_GAP_COLS && ok; k++)
        ok = take_h5_make_table(gaps, vol_gap_columns[k], H5T_STD_U64LE, 1, &rows, &w->gap[k]);
    H5Gclose(sets);
    H5Gclose(gaps);
    return ok;
}

static pvx_err create(struct out *w, const struct vol_head *head, struct pvx_diag *d)
{
    hid_t fapl = take_h5_access(VOL_ALIGN), fcpl = H5Pcreate(H5P_FILE_CREATE);
    /* All that closing changes lies in one piece, that of the root: else a cut at that moment leaves half of it. */
    H5Pset_attr_phase_change(fcpl, ROOT_MOST, 0);
    H5Pset_link_phase_change(fcpl, ROOT_MOST, 0);
    H5Pset_est_link_info(fcpl, ROOT_MOST, 16);
    H5Pset_small_data_block_size(fapl, 0); /* chunks lie in the order of the sets */
    pvx_err e = take_h5_create(&w->room, w->path, fcpl, fapl, &w->file, d);
    H5Pclose(fcpl);
    H5Pclose(fapl);
    if (e != PVX_OK)
        return e;
    w->emission = vol_pack_make(w->file, "emission", &w->grid, 0);
    if (vol_hdf5_head(w->file, head) && w->emission >= 0 && make_columns(w) &&
        vol_hdf5_nexus(w->file, head) && H5Fstart_swmr_write(w->file) >= 0)
        return PVX_OK;
    unlink(w->path);
    return hdf5_write_fail(w, "cannot be begun", d);
}

static void hdf5_write_free_out(struct out *w)
{
    if (w->file >= 0)
        H5Fclose(w->file);
    if (w->room.fd >= 0)
        close(w->room.fd);
    vol_columns_done(w->column);
    vol_packer_free(&w->pack);
    free(w->path);
    free(w);
}

static pvx_err hdf5_write_hdf5_open(void **self, const char *path, const struct vol_head *head,
                                    const struct vol_options *o, struct pvx_diag *d)
{
    (void)o;
    take_h5_init();
    struct out *w = pvx_calloc(1, sizeof *w);
    PVX_NEED(w);
    w->file = -1;
    w->room.fd = -1;
    w->grid = head->start.grid;
    w->bars = (struct vol_bars_file)VOL_BARS_FILE;
    memcpy(w->units, head->start.units, sizeof w->units);
    w->path = strdup(path);
    vol_columns(w->column);
    pvx_err e = w->path != NULL ? vol_packer_open(&w->pack, &w->grid) : PVX_ENOMEM;
    PVX_THEN(e, create(w, head, d));
    if (e != PVX_OK) {
        hdf5_write_free_out(w);
        return pvx_fail(d, e, "%s: %s", path, pvx_strerror(e));
    }
    *self = w;
    return PVX_OK;
}

static void hdf5_hurry(void *self, bool on)
{
    ((struct out *)self)->pack.hurry = on;
}

static uint64_t hdf5_bytes(const void *self)
{
    return ((const struct out *)self)->bytes;
}

static pvx_err hdf5_write_hdf5_close(void *self, struct pvx_diag *d)
{
    struct out *w = self;
    take_h5_init();
    bool ok = H5Fclose(w->file) >= 0;
    hid_t fapl = take_h5_access(VOL_ALIGN);
    w->file = ok ? H5Fopen(w->path, H5F_ACC_RDWR, fapl) : -1;
    H5Pclose(fapl);
    ok = w->file >= 0 && vol_hdf5_vtk(w->file, &w->grid, w->n_sets) &&
         take_h5_put_int(w->file, "t_closed_ns", pvx_now_real()) &&
         take_h5_put_int(w->file, "closed", 1);
    pvx_err e = ok && H5Fclose(w->file) >= 0 ? PVX_OK : hdf5_write_fail(w, "cannot be closed", d);
    if (ok)
        w->file = -1;
    /* give back the reserved space that was not needed */
    if (e == PVX_OK && w->room.fd >= 0) {
        off_t end = lseek(w->room.fd, 0, SEEK_END);
        if (end < 0 || ftruncate(w->room.fd, end) != 0)
            e = pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", w->path, strerror(errno));
        PVX_THEN(e, sync_file(w, d));
    }
    hdf5_write_free_out(w);
    return e;
}

const struct vol_writer_ops vol_hdf5_writer = {.check = take_h5_check,
                                               .open = hdf5_write_hdf5_open,
                                               .put = hdf5_put,
                                               .gap = hdf5_write_hdf5_gap,
                                               .hurry = hdf5_hurry,
                                               .bytes = hdf5_bytes,
                                               .close = hdf5_write_hdf5_close};
