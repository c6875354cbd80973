/* hdf5_write.c - a growing HDF5 file of volumes (daemon/VOLUMES.md).
 *
 * A pool assembles, shuffles and deflates a volume's chunks.  They are written as they are, then the volume's row in
 * each column, then the file is flushed.  So an SWMR reader, and a file that a kill leaves, end with a whole set. */
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <xxhash.h>
#include <zlib.h>

#include "base/clock.h"
#include "base/cpu.h"
#include "base/file.h"
#include "base/mem.h"
#include "base/pool.h"
#include "daemon/volumes/hdf5.h"

#define LEVEL     1  /* of deflate: higher ones cost several times the time for a few per cent */
#define AS_IT_IS  3u /* filter mask: neither shuffled nor deflated */
#define FLOATS    ((size_t)VOL_CHUNK * VOL_CHUNK * VOL_CHUNK * 3)
#define B         PVP_BRICK
#define NO_BRICK  UINT32_MAX
#define THREADS   4
#define ROOT_MOST 64 /* attributes, links */
#define SYNC_NS \
    (2 * PVX_NS_PER_S) /* a power cut takes no more than what came since, and what took the disk */

struct out {
    char *path;
    struct take_h5_room room;
    hid_t file, emission;
    struct vol_column column[VOL_COLUMNS];
    hid_t col[VOL_COLUMNS], gap[VOL_GAP_COLS];
    struct pvp_grid grid;
    struct vol_tiles t;
    uint32_t nb[3], n_bricks;
    uint64_t n_sets, n_gaps, bytes;
    int64_t t_first_ns, t_synced_ns;
    pvx_pool *pool;
    bool hurry;
    /* the volume at hand */
    const struct vol_volume *v;
    uint32_t *brick_at; /* [n_bricks of the grid], NO_BRICK = not there */
    uint32_t *chunk;    /* [n_chunks] ids, ascending */
    uint32_t n_chunks;
    unsigned char *packed; /* [n_chunks][bound] */
    uint32_t packed_room;
    size_t bound;
    size_t *size;          /* [n_chunks] */
    unsigned *mask;        /* [n_chunks] filters that were left out */
    uint64_t *hash;        /* [n_chunks] */
    unsigned char *wanted; /* [chunks of the grid] */
};

static pvx_err hdf5_write_fail(struct out *w, const char *what, struct pvx_diag *d)
{
    return take_h5_fail(d, PVX_EIO, w->path, what);
}

/* ---- one volume into chunks ---- */

/* The bricks of chunk `id` as floats [side z][side y][side x][c]. */
static void assemble(const struct out *w, uint32_t id, float *out)
{
    const uint32_t *s = w->t.side, c = w->grid.channels;
    const uint32_t at[3] = {id % w->t.n[0] * s[0], id / w->t.n[0] % w->t.n[1] * s[1],
                            id / w->t.n[0] / w->t.n[1] * s[2]};
    memset(out, 0, w->t.floats * sizeof *out);
    for (uint32_t k = 0; k < s[2] && at[2] + k < w->grid.n[2]; k++)
        for (uint32_t j = 0; j < s[1] && at[1] + j < w->grid.n[1]; j++)
            for (uint32_t i = 0; i < s[0] && at[0] + i < w->grid.n[0]; i += B) {
                uint32_t x = at[0] + i, y = at[1] + j, z = at[2] + k;
                uint32_t b = w->brick_at[(z / B * w->nb[1] + y / B) * w->nb[0] + x / B];
                if (b == NO_BRICK)
                    continue;
                size_t row = ((size_t)b * B * B + z % B * B + y % B) * B;
                uint32_t in = s[0] - i < B ? s[0] - i : B;
                memcpy(out + (((size_t)k * s[1] + j) * s[0] + i) * c, w->v->brick + row * c,
                       (size_t)in * c * sizeof *out);
            }
}

/* HDF5's shuffle filter: first bytes of all floats, then the second ones, ... */
static void shuffle(const float *in, size_t n, unsigned char *out)
{
    const unsigned char *p = (const unsigned char *)in;
    for (size_t byte = 0; byte < sizeof *in; byte++)
        for (size_t i = 0; i < n; i++)
            out[byte * n + i] = p[i * sizeof *in + byte];
}

static void hdf5_write_pack(void *ctx, size_t task)
{
    struct out *w = ctx;
    float floats[FLOATS];
    unsigned char shuffled[FLOATS * sizeof(float)], *to = w->packed + task * w->bound;
    size_t n = w->t.floats, bytes = n * sizeof *floats;
    assemble(w, w->chunk[task], floats);
    w->hash[task] = XXH3_64bits(floats, bytes);
    uLongf packed = w->bound;
    if (!w->hurry) {
        shuffle(floats, n, shuffled);
        if (compress2(to, &packed, shuffled, bytes, LEVEL) == Z_OK && packed < bytes) {
            w->size[task] = packed;
            w->mask[task] = 0;
            return;
        }
    }
    memcpy(to, floats, bytes);
    w->size[task] = bytes;
    w->mask[task] = AS_IT_IS;
}

static pvx_err hdf5_write_grow(struct out *w, uint32_t chunks)
{
    if (chunks <= w->packed_room)
        return PVX_OK;
    free(w->packed);
    w->packed_room = 0;
    w->packed = malloc(chunks * w->bound);
    if (w->packed == NULL)
        return PVX_ENOMEM;
    w->packed_room = chunks;
    return PVX_OK;
}

/* Find the chunks that have flame and the places of their bricks. */
static void hdf5_write_mark(struct out *w)
{
    size_t cells = (size_t)B * B * B * w->grid.channels;
    memset(w->wanted, 0, w->t.all);
    for (uint32_t b = 0; b < w->v->n_bricks; b++) {
        uint32_t id = w->v->ids[b];
        if (vol_all_zero(w->v->brick + b * cells, cells))
            continue;
        w->brick_at[id] = b;
        uint32_t x = id % w->nb[0] * B / w->t.side[0],
                 y = id / w->nb[0] % w->nb[1] * B / w->t.side[1];
        uint32_t z = id / w->nb[0] / w->nb[1] * B / w->t.side[2];
        w->wanted[(z * w->t.n[1] + y) * w->t.n[0] + x] = 1;
    }
    w->n_chunks = 0;
    for (uint32_t k = 0; k < w->t.all; k++)
        if (w->wanted[k])
            w->chunk[w->n_chunks++] = k;
}

static bool put_chunks(struct out *w)
{
    const struct pvp_grid *g = &w->grid;
    hsize_t all[VOL_RANK] = {w->n_sets + 1, g->n[2], g->n[1], g->n[0], g->channels};
    if (H5Dset_extent(w->emission, all) < 0)
        return false;
    for (uint32_t k = 0; k < w->n_chunks; k++) {
        uint32_t id = w->chunk[k];
        hsize_t at[VOL_RANK] = {w->n_sets, (hsize_t)(id / w->t.n[0] / w->t.n[1]) * w->t.side[2],
                                (hsize_t)(id / w->t.n[0] % w->t.n[1]) * w->t.side[1],
                                (hsize_t)(id % w->t.n[0]) * w->t.side[0], 0};
        if (H5Dwrite_chunk(w->emission, H5P_DEFAULT, w->mask[k], at, w->size[k],
                           w->packed + k * w->bound) < 0)
            return false;
    }
    return true;
}

static void fill_row(struct out *w, struct vol_row *r)
{
    const struct pvp_volume *v = &w->v->v;
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
                          .chunks = w->n_chunks,
                          .clamped = w->v->clamped,
                          .sample = (uint8_t)w->v->sample};
    memcpy(r->solver, p->solver, sizeof r->solver);
    r->solver[sizeof r->solver - 1] = '\0';
    uint64_t seed = 0;
    for (uint32_t k = 0; k < w->n_chunks; k++)
        seed = vol_hash(seed, w->chunk[k], w->hash[k]);
    r->check = vol_row_check(w->column, r, seed);
}

static pvx_err sync_file(struct out *w, struct pvx_diag *d)
{
    w->t_synced_ns = pvx_now_mono();
    return fdatasync(w->room.fd) == 0 || errno == EINVAL
               ? PVX_OK
               : pvx_fail(d, pvx_err_from_errno(errno), "%s: %s", w->path, strerror(errno));
}

static pvx_err hdf5_put(void *self, const struct vol_volume *v, struct pvx_diag *d)
{
    struct out *w = self;
    struct vol_row r;
    uint64_t bytes = 0;
    take_h5_init();
    w->v = v;
    hdf5_write_mark(w);
    pvx_err e = hdf5_write_grow(w, w->n_chunks);
    if (e == PVX_OK) {
        pvx_pool_run(w->pool, w->n_chunks, hdf5_write_pack, w);
        fill_row(w, &r);
    }
    for (uint32_t b = 0; b < v->n_bricks; b++)
        w->brick_at[v->ids[b]] = NO_BRICK;
    if (e != PVX_OK)
        return pvx_fail(d, e, "%s: no memory for %u chunks", w->path, w->n_chunks);
    for (uint32_t k = 0; k < w->n_chunks; k++)
        bytes += w->size[k];
    PVX_TRY(take_h5_reserve(&w->room, w->file, w->path, bytes, d));
    bool ok = put_chunks(w);
    for (int k = 0; k < VOL_COLUMNS && ok; k++)
        ok = take_h5_append(w->col[k], w->column[k].type, 0, w->n_sets, 1,
                            (const char *)&r + w->column[k].offset);
    if (!ok || H5Fflush(w->file, H5F_SCOPE_LOCAL) < 0)
        return hdf5_write_fail(w, "cannot be written", d);
    w->n_sets++;
    w->bytes += bytes + sizeof r;
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

static bool make_emission(struct out *w)
{
    const struct pvp_grid *g = &w->grid;
    hsize_t now[VOL_RANK] = {0, g->n[2], g->n[1], g->n[0], g->channels};
    hsize_t most[VOL_RANK] = {H5S_UNLIMITED, g->n[2], g->n[1], g->n[0], g->channels};
    hsize_t chunk[VOL_RANK] = {1, w->t.side[2], w->t.side[1], w->t.side[0], g->channels};
    hid_t space = H5Screate_simple(VOL_RANK, now, most), p = H5Pcreate(H5P_DATASET_CREATE);
    H5Pset_chunk(p, VOL_RANK, chunk);
    H5Pset_shuffle(p);
    H5Pset_deflate(p, LEVEL);
    w->emission =
        H5Dcreate2(w->file, "emission", H5T_IEEE_F32LE, space, H5P_DEFAULT, p, H5P_DEFAULT);
    H5Pclose(p);
    H5Sclose(space);
    return w->emission >= 0;
}

static bool make_columns(struct out *w)
{
    hsize_t rows = VOL_ROWS;
    hid_t sets = H5Gcreate2(w->file, "sets", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
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
    if (vol_hdf5_head(w->file, head) && make_emission(w) && make_columns(w) &&
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
    pvx_pool_free(&w->pool);
    free(w->path);
    free(w->brick_at);
    free(w->chunk);
    free(w->packed);
    free(w->size);
    free(w->mask);
    free(w->hash);
    free(w->wanted);
    free(w);
}

static bool hdf5_write_make_room(struct out *w)
{
    w->bound = compressBound(w->t.floats * sizeof(float));
    w->n_bricks = pvp_grid_bricks(&w->grid, w->nb);
    w->brick_at = malloc(w->n_bricks * sizeof *w->brick_at);
    w->chunk = malloc(w->t.all * sizeof *w->chunk);
    w->size = malloc(w->t.all * sizeof *w->size);
    w->mask = malloc(w->t.all * sizeof *w->mask);
    w->hash = malloc(w->t.all * sizeof *w->hash);
    w->wanted = malloc(w->t.all);
    for (uint32_t b = 0; b < w->n_bricks && w->brick_at != NULL; b++)
        w->brick_at[b] = NO_BRICK;
    return w->brick_at != NULL && w->chunk != NULL && w->size != NULL && w->mask != NULL &&
           w->hash != NULL && w->wanted != NULL;
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
    w->t = vol_tiles(&w->grid);
    w->path = strdup(path);
    vol_columns(w->column);
    unsigned cpus = pvx_cpu_count(), threads = cpus < THREADS ? cpus : THREADS;
    pvx_err e = w->path != NULL && hdf5_write_make_room(w) ? PVX_OK : PVX_ENOMEM;
    PVX_THEN(e, pvx_pool_new(threads, "vol-pack", &w->pool));
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
    ((struct out *)self)->hurry = on;
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
