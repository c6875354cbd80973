/* bench_record.c - recordings of volumes.
 *
 * (a) live: 128^3 in three colours at 20 sets/s through the recorder of `pyrovox record` (queue, writer thread, a
 *     file in the folder given) as HDF5: gaps, time from a set's arrival to its last byte written, the longest queue,
 *     processor time a set (receiving included), and the file over raw frames of 8 cameras and over dense floats.
 * (b) rate: writing alone, as fast as it goes, every format; .vdb and .nvdb on one core, as OpenVDB uses all.
 * bound: the same bytes written in the same run by write(2) and fdatasync, a file a set where the format has that;
 * for HDF5 the larger of it and zlib's time for the same chunks shuffled, shared among the cores. */
#include <sched.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zlib.h>

#include "base/hist.h"
#include "daemon/volumes/bricks.h"
#include "daemon/volumes/recorder.h"
#include "tests/lib/scratch.h"
#include "volume.h"

enum { FRAMES = 8, RATE = 20, SIDE = 16, CHUNK = SIDE * SIDE * SIDE * 3 };
#define MB 1e-6

static char path[4096];
static unsigned cores;

static double seconds(void)
{
    return (double)pvx_now_mono() * 1e-9;
}

/* ---- what is recorded --------------------------------------------------------------------------- */

/* A flame in motion, as messages and as bricks. */
struct reel {
    const char *name;
    struct pvp_grid grid;
    int n;
    double lit;
    struct {
        void *msg;
        struct pvp_view view;
        struct vol_store store;
    } frame[FRAMES];
};

static void reel_add(struct reel *r, pvp_encoder *e, pvp_decoder *dec, const struct volume *v)
{
    struct pvp_volume about = {.grid = v->grid, .report.solver = "pcg"};
    struct pvx_diag d = {""};
    const void *msg;
    size_t len;
    CHECK(pvp_encode_volume(e, 0, &about, &v->x, &msg, &len));
    void *copy = malloc(len);
    if (copy == NULL)
        CHECK(PVX_ENOMEM);
    memcpy(copy, msg, len);
    struct pvp_view view;
    bench_check(pvp_decode_volume(copy, len, &view, &d), &d);
    struct vol_store s = {0};
    CHECK(vol_store_grow(&s, view.n_bricks, v->grid.channels));
    size_t floats = (size_t)view.n_bricks * PVP_BRICK * PVP_BRICK * PVP_BRICK * v->grid.channels;
    bench_check(pvp_volume_bricks(dec, &view, s.ids, s.brick, floats, &d), &d);
    s.n = view.n_bricks;
    r->frame[r->n].msg = copy;
    r->frame[r->n].view = view;
    r->frame[r->n].store = s;
    r->lit = volume_lit(v);
    r->n++;
}

/* kind FLAME_RING moves; another one stands still, and its noise changes. */
static struct reel reel_new(int side, enum flame_kind kind, pvx_pool *pool)
{
    struct reel r = {.name = flames[kind].name};
    pvp_encoder *e = NULL;
    pvp_decoder *dec;
    CHECK(pvp_decoder_new(&dec));
    for (int k = 0; k < FRAMES; k++) {
        struct volume v =
            kind == FLAME_RING ? volume_ring(side, 0.05 * k) : volume_function(side, kind, pool);
        r.grid = v.grid;
        if (e == NULL)
            CHECK(pvp_encoder_new(&r.grid, PVP_F16, PVP_RAW, &e));
        reel_add(&r, e, dec, &v);
        volume_free(&v);
    }
    pvp_encoder_free(&e);
    pvp_decoder_free(&dec);
    return r;
}

static void reel_free(struct reel *r)
{
    for (int k = 0; k < r->n; k++) {
        free(r->frame[k].msg);
        vol_store_free(&r->frame[k].store);
    }
}

static struct pvp_volume reel_about(const struct reel *r, uint64_t set)
{
    return (struct pvp_volume){.session = 1,
                               .set = set,
                               .t_exposure_ns = (int64_t)set * (PVX_NS_PER_S / RATE),
                               .grid = r->grid,
                               .report.solver = "pcg"};
}

static struct vol_head reel_head(const struct reel *r)
{
    return (struct vol_head){.start = {.grid = r->grid,
                                       .session = 1,
                                       .n_cameras = 8,
                                       .fps = RATE,
                                       .units = "1/m",
                                       .software = "bench_record"}};
}

static double dense_bytes(const struct reel *r)
{
    return (double)pvp_grid_count(&r->grid) * sizeof(float);
}

/* ---- bounds ------------------------------------------------------------------------------------- */

/* s to write n bytes as one file, onto the disk; mean of `times` files. */
static double plain_write(size_t n, int times)
{
    char file[4200];
    char *data = malloc(n);
    if (data == NULL)
        CHECK(PVX_ENOMEM);
    for (size_t i = 0; i < n; i++)
        data[i] = (char)(i * 2654435761u >> 13);
    snprintf(file, sizeof file, "%s.plain", path);
    double t0 = seconds();
    for (int k = 0; k < times; k++) {
        FILE *f = fopen(file, "wbe");
        if (f == NULL || fwrite(data, 1, n, f) != n || fflush(f) != 0 ||
            fdatasync(fileno(f)) != 0 || fclose(f) != 0) {
            perror(file);
            exit(1);
        }
        unlink(file);
    }
    double s = (seconds() - t0) / times;
    free(data);
    return s;
}

struct packed {
    double bytes, s; /* zlib alone, one core */
    int chunks;
};

/* The chunks of 16^3 that have flame, shuffled, through deflate. */
static struct packed deflated(const struct reel *r, int frame)
{
    static float chunk[CHUNK];
    static unsigned char shuffled[sizeof chunk], to[2 * sizeof chunk];
    const uint32_t *n = r->grid.n;
    float *dense = must_floats(pvp_grid_count(&r->grid));
    const struct vol_store *s = &r->frame[frame].store;
    struct packed p = {0};
    vol_to_dense(
        &(struct vol_volume){
            .v = {.grid = r->grid}, .n_bricks = s->n, .ids = s->ids, .brick = s->brick},
        dense);
    for (uint32_t z = 0; z < n[2]; z += SIDE)
        for (uint32_t y = 0; y < n[1]; y += SIDE)
            for (uint32_t x = 0; x < n[0]; x += SIDE) {
                bool any = false;
                for (size_t row = 0; row < (size_t)SIDE * SIDE; row++)
                    memcpy(chunk + row * SIDE * 3,
                           dense +
                               ((((size_t)z + row / SIDE) * n[1] + y + row % SIDE) * n[0] + x) * 3,
                           (size_t)SIDE * 3 * sizeof *chunk);
                for (size_t i = 0; i < CHUNK; i++)
                    any |= chunk[i] != 0;
                if (!any)
                    continue;
                for (size_t i = 0; i < CHUNK; i++)
                    for (size_t b = 0; b < sizeof *chunk; b++)
                        shuffled[b * CHUNK + i] = ((const unsigned char *)&chunk[i])[b];
                uLongf len = sizeof to;
                double t0 = seconds();
                if (compress2(to, &len, shuffled, sizeof shuffled, 1) != Z_OK)
                    exit(1);
                p.s += seconds() - t0;
                p.bytes += (double)len;
                p.chunks++;
            }
    free(dense);
    return p;
}

/* ---- live --------------------------------------------------------------------------------------- */

static double file_bytes(void)
{
    struct stat st;
    return stat(path, &st) == 0 ? (double)st.st_size : 0;
}

/* Until `until`: when each set was written, and how much waited at most. */
static void watch(vol_recorder *r, int64_t until, const int64_t *came, uint64_t *seen,
                  struct pvx_hist *took, size_t *most)
{
    struct vol_recorder_stats st;
    for (;;) {
        vol_recorder_stats(r, &st);
        int64_t now = pvx_now_mono();
        for (; *seen < st.written; ++*seen)
            pvx_hist_add(took, now - came[*seen]);
        *most = st.queued > *most ? st.queued : *most;
        if (now >= until)
            return;
        usleep(500);
    }
}

static void live(FILE *csv, const struct reel *reel, int sets)
{
    const double raw[] = {8.0 * 320 * 240 * 3, 8.0 * 640 * 480 * 3};
    struct vol_recorder_config c = {.format = VOL_HDF5, .path = path};
    struct vol_head head = reel_head(reel);
    struct vol_recorder_stats st;
    struct pvx_diag d = {""};
    struct pvx_hist took = {0};
    char where[4200];
    vol_recorder *r;
    pvp_decoder *dec;
    int64_t *came = pvx_calloc((size_t)sets, sizeof *came);
    uint64_t seen = 0;
    size_t most = 0;
    if (came == NULL)
        CHECK(PVX_ENOMEM);
    remove_all(path);
    CHECK(pvp_decoder_new(&dec));
    bench_check(vol_recorder_new(&c, &r, &d), &d);
    bench_check(vol_recorder_session(r, &head, where, sizeof where, &d), &d);
    double used = bench_cpu();
    int64_t next = pvx_now_mono();
    for (int k = 0; k < sets; k++) {
        watch(r, next, came, &seen, &took, &most);
        struct pvp_view view = reel->frame[k % reel->n].view;
        view.v = reel_about(reel, (uint64_t)k);
        came[k] = pvx_now_mono();
        bench_check(vol_recorder_put(r, dec, &view, &d), &d);
        next += PVX_NS_PER_S / RATE;
    }
    watch(r, next, came, &seen, &took, &most);
    bench_check(vol_recorder_finish(&r, &st, &d), &d);
    used = (bench_cpu() - used) / sets;
    double bytes = file_bytes() / sets;
    struct packed p = deflated(reel, 0);
    double disk = plain_write((size_t)bytes, 20);
    bench_row(csv, "%s,%.3f,%d,%llu,%.1f,%.1f,%.1f,%.4f,%.2f,%.2f,%.2f,%.3f,%.3f,%.3f", reel->name,
              reel->lit, sets, (unsigned long long)st.left_out, ms(pvx_hist_quantile(&took, 0.5)),
              ms(pvx_hist_quantile(&took, 0.99)), (double)most * MB, used,
              fmax(disk, p.s / cores) * 1e3, bytes * MB, p.bytes * MB, bytes / raw[0],
              bytes / raw[1], bytes / dense_bytes(reel));
    pvp_decoder_free(&dec);
    free(came);
    remove_all(path);
}

/* ---- as fast as it goes ------------------------------------------------------------------------- */

static void pin(bool on)
{
    static cpu_set_t all, one;
    if (CPU_COUNT(&all) == 0 && sched_getaffinity(0, sizeof all, &all) != 0)
        exit(1);
    CPU_ZERO(&one);
    for (int c = 0; c < CPU_SETSIZE && CPU_COUNT(&one) == 0; c++)
        if (CPU_ISSET(c, &all))
            CPU_SET(c, &one);
    if (sched_setaffinity(0, sizeof one, on ? &one : &all) != 0)
        exit(1);
}

static void rate(FILE *csv, const struct reel *reel, enum vol_format f, bool split)
{
    struct vol_head head = reel_head(reel);
    struct vol_options o = {.split = split};
    struct pvx_diag d = {""};
    struct pvx_hist took = {0};
    vol_writer *w;
    bool one = f == VOL_VDB || f == VOL_NVDB;
    remove_all(path);
    pin(one); /* before the library makes its threads */
    bench_check(vol_writer_open(f, path, &head, &o, &w, &d), &d);
    double t0 = seconds(), used = bench_cpu();
    int sets = 0;
    for (; sets < 200 && (sets < 16 || seconds() - t0 < 4); sets++) {
        const struct vol_store *s = &reel->frame[sets % reel->n].store;
        struct vol_volume v = {.v = reel_about(reel, (uint64_t)sets),
                               .sample = PVP_F16,
                               .n_bricks = s->n,
                               .ids = s->ids,
                               .brick = s->brick};
        int64_t t = pvx_now_mono();
        bench_check(vol_writer_put(w, &v, &d), &d);
        pvx_hist_add(&took, pvx_now_mono() - t);
    }
    double s = (seconds() - t0) / sets;
    used = (bench_cpu() - used) / sets;
    double bytes = (double)vol_writer_bytes(w) / sets;
    bench_check(vol_writer_close(&w, &d), &d);
    double bound = plain_write((size_t)bytes, 20);
    if (f == VOL_HDF5)
        bound = fmax(bound, deflated(reel, 0).s / cores);
    pin(false);
    bench_row(csv, "%s,%u,%s%s,%s,%.1f,%.2f,%.2f,%.2f,%.2f,%.2f", reel->name, reel->grid.n[2],
              vol_format_names[f], split ? " split" : "", one ? "1" : "all", 1 / s, s * 1e3,
              ms(pvx_hist_quantile(&took, 0.99)), used * 1e3, bound * 1e3, bytes * MB);
    remove_all(path);
}

int main(int argc, char **argv)
{
    pvx_pool *pool;
    cpu_set_t all;
    snprintf(path, sizeof path, "%s/bench_record.tmp.h5", argc > 1 ? argv[1] : ".");
    if (sched_getaffinity(0, sizeof all, &all) != 0)
        return 1;
    cores = (unsigned)CPU_COUNT(&all);
    CHECK(pvx_pool_new(cores, "bench", &pool));
    struct reel ring = reel_new(128, FLAME_RING, pool), pool_fire = reel_new(128, FLAME_POOL, pool),
                shell = reel_new(128, FLAME_SHELL, pool), small = reel_new(64, FLAME_RING, pool);
    FILE *csv = bench_csv(argc, argv, "record",
                          "flame,lit share,sets,gaps,ms p50,ms p99,queue MB,cpu s,bound ms,"
                          "set MB,zlib MB,of raw 320,of raw 640,of dense");
    live(csv, &ring, 20 * RATE);
    live(csv, &pool_fire, 10 * RATE);
    live(csv, &shell, 10 * RATE);
    fclose(csv);
    csv = bench_csv(argc, argv, "record_rate",
                    "flame,voxels,format,cores,sets/s,ms,ms p99,cpu ms,bound ms,set MB");
    const struct reel *const reels[] = {&small, &ring, &pool_fire};
    for (size_t i = 0; i < sizeof reels / sizeof *reels; i++) {
        for (int f = 0; f < VOL_FORMATS; f++)
            rate(csv, reels[i], (enum vol_format)f, false);
        rate(csv, reels[i], VOL_VDB, true);
    }
    fclose(csv);
    reel_free(&ring);
    reel_free(&pool_fire);
    reel_free(&shell);
    reel_free(&small);
    pvx_pool_free(&pool);
    return 0;
}
