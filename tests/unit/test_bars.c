/* test_bars.c - error bars in recordings: what was put comes back, in any order of sets with and without them; a reader
 * that wants no modes reads none; damage to them is noticed, as is a file that is cut off.
 *
 * `test_bars --write FILE.h5 SETS CHANNELS MODES` is the system tests' recording of a flame: its modes make it brighter,
 * wider and higher, and each voxel has a deviation of its own beside. */
#include "../t.h"

#include <hdf5.h>
#include <signal.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/file.h"
#include "capture/files/imgio.h"
#include "daemon/volumes/join.h"
#include "tests/lib/plugins.h"
#include "tests/lib/scratch.h"
#include "tests/lib/volumes.h"

#define SHARE 0.4
#define DOUBT (PVP_DOUBT_FINE | PVP_DOUBT_LATE)

static struct pvp_start start;

static vol_writer *begin(enum vol_format f, const char *path)
{
    vol_writer *w = NULL;
    struct pvx_diag d = {""};
    struct vol_head h = {.start = start, .rig = "cameras: []\n"};
    T_CHECK_(vol_writer_open(f, path, &h, NULL, &w, &d) == PVX_OK, "%s", d.text);
    return w;
}

/* Set `set`; modes -1: without bars. */
static struct made_volume make(uint64_t set, int modes, float **owned)
{
    struct made_volume m = volumes_make(&start, set, SHARE);
    *owned = modes >= 0 ? volumes_bars(&m, (uint32_t)modes, set % 2 != 0 ? DOUBT : 0) : NULL;
    return m;
}

static void put(vol_writer *w, uint64_t set, int modes)
{
    struct pvx_diag d = {""};
    float *owned;
    struct made_volume m = make(set, modes, &owned);
    T_CHECK_(vol_writer_put(w, &m.v, &d) == PVX_OK, "%s", d.text);
    vol_store_free(&m.store);
    free(owned);
}

static void finish(vol_writer *w)
{
    struct pvx_diag d = {""};
    T_CHECK_(vol_writer_close(&w, &d) == PVX_OK, "%s", d.text);
}

/* Whether volume k is set `set`, with its bars, and with `modes` of them. */
static void is(vol_reader *r, uint64_t k, uint64_t set, int modes, bool wanted)
{
    struct vol_volume v;
    struct pvx_diag d = {""};
    float *owned;
    struct made_volume m = make(set, modes, &owned);
    vol_reader_modes(r, wanted);
    if (!wanted)
        m.v.bars.n_modes = 0;
    bool got = vol_reader_get(r, k, &v, &d) == PVX_OK;
    T_CHECK_(got && volumes_same(&m.v, &v) && volumes_same_bars(&m.v, &v), "set %llu: %s",
             (unsigned long long)set, d.text);
    vol_store_free(&m.store);
    free(owned);
}

static vol_reader *open_it(const char *path, uint64_t count)
{
    vol_reader *r = NULL;
    struct pvx_diag d = {""};
    T_CHECK_(vol_reader_open(path, &r, &d) == PVX_OK, "%s", d.text);
    if (r != NULL)
        T_EQ_I(vol_reader_count(r), count);
    return r;
}

/* Modes of each set, -1: no bars. */
static void come_back(const int *modes, size_t n, uint32_t channels)
{
    scratch_new();
    start = volumes_start(33, 20, 9, channels);
    vol_writer *w = begin(VOL_HDF5, at("v.h5"));
    for (size_t k = 0; k < n; k++) {
        vol_writer_hurry(w, k % 2 == 1);
        put(w, k + 1, modes[k]);
    }
    finish(w);
    vol_reader *r = open_it(at("v.h5"), n);
    T_OK(r != NULL && !vol_reader_cut(r));
    for (size_t k = n; k > 0 && r != NULL; k--) {
        is(r, k - 1, k, modes[k - 1], true);
        is(r, k - 1, k, modes[k - 1], false);
    }
    vol_reader_close(&r);
    scratch_remove();
}

T_CASE_OF_THREADS(bars_come_back)
{
    static const int all[] = {3, 3, 3}, none[] = {-1, -1}, later[] = {-1, -1, 0, 0, 2, -1, 4};
    static const int between[] = {2, -1, 2}, only_sd[] = {0, 0};
    for (uint32_t c = 1; c <= 3; c += 2) {
        come_back(all, 3, c);
        come_back(none, 2, c);
        come_back(later, 7, c);
        come_back(between, 3, c);
        come_back(only_sd, 2, c);
    }
}

T_CASE(more_modes_than_there_is_room_for)
{
    struct pvx_diag d = {""};
    float *owned;
    scratch_new();
    start = volumes_start(16, 16, 16, 1);
    vol_writer *w = begin(VOL_HDF5, at("v.h5"));
    put(w, 1, 2);
    put(w, 2, 5); /* more cameras gave a frame */
    struct made_volume m = make(3, 33, &owned);
    T_EQ_I(vol_writer_put(w, &m.v, &d), PVX_ERANGE);
    T_CONTAINS(d.text, "set 3 has error bars of 33 modes, the recording has room for 32");
    vol_store_free(&m.store);
    free(owned);
    put(w, 4, 1);
    finish(w);
    vol_reader *r = open_it(at("v.h5"), 3);
    is(r, 0, 1, 2, true);
    is(r, 1, 2, 5, true);
    is(r, 2, 4, 1, true);
    vol_reader_close(&r);
    scratch_remove();
}

/* Bars where the emission is 0 in a whole brick: the brick is there, as 0. */
T_CASE(bars_beyond_the_flame)
{
    scratch_new();
    start = volumes_start(24, 16, 16, 1);
    const uint32_t ids[] = {1, 4};
    static float brick[2 * 512], sd[2 * 512];
    brick[700] = 3;
    sd[5] = 0.5f;
    sd[700] = 0.25f;
    struct vol_volume v = volumes_empty(&start, 7, 1767225600123456789), back;
    v.n_bricks = 2;
    v.ids = ids;
    v.brick = brick;
    v.bars.sd = sd;
    vol_writer *w = begin(VOL_HDF5, at("v.h5"));
    T_EQ_I(vol_writer_put(w, &v, NULL), PVX_OK);
    finish(w);
    vol_reader *r = open_it(at("v.h5"), 1);
    T_EQ_I(vol_reader_get(r, 0, &back, NULL), PVX_OK);
    T_OK(volumes_same(&v, &back) && volumes_same_bars(&v, &back));
    vol_reader_close(&r);
    scratch_remove();
}

/* A folder of .npy has deviations without modes; what is no deviation is refused, and is no volume. */
T_CASE(bars_beside_npy)
{
    struct vol_volume v;
    struct pvx_diag d = {""};
    float *dense = calloc((size_t)33 * 20 * 9 * 3, sizeof *dense);
    scratch_new();
    start = volumes_start(33, 20, 9, 3);
    vol_writer *w = begin(VOL_NPY, at("npy"));
    put(w, 1, 2);
    put(w, 2, -1);
    put(w, 3, 0);
    finish(w);
    vol_reader *r = open_it(at("npy"), 3);
    is(r, 0, 1, 2, false);
    is(r, 1, 2, -1, false);
    is(r, 2, 3, 0, false);
    vol_reader_close(&r);
    dense[7] = -1;
    const size_t shape[4] = {9, 20, 33, 3};
    T_EQ_I(cap_npy_save(at("npy/sd/000003.npy"), dense, shape, 4, &d), PVX_OK);
    r = open_it(at("npy"), 3);
    T_EQ_I(vol_reader_get(r, 2, &v, &d), PVX_ECORRUPT);
    T_CONTAINS(d.text, "sd/000003.npy: is not a deviation");
    vol_reader_close(&r);
    T_EQ_I(unlink(at("npy/sd/000003.npy")), 0);
    r = open_it(at("npy"), 3);
    is(r, 2, 3, -1, false);
    vol_reader_close(&r);
    free(dense);
    scratch_remove();
}

static void copy(const char *from, const char *to, long bytes)
{
    char *all;
    size_t n;
    T_EQ_I(pvx_file_read(from, 1 << 26, &all, &n, NULL), PVX_OK);
    T_EQ_I(pvx_file_write(to, all, bytes >= 0 ? (size_t)bytes : n, NULL), PVX_OK);
    free(all);
}

/* One set with bars, one without, and one whose bars reach a brick that is dark. */
static void through_grids(enum vol_format f, uint32_t channels, const struct vol_options *o)
{
    float brick[2 * 512 * 3] = {0}, sd[2 * 512 * 3] = {0};
    const uint32_t ids[] = {1, 4};
    struct pvx_diag d = {""};
    vol_writer *w = NULL;
    scratch_new();
    start = volumes_start(33, 20, 9, channels);
    struct vol_volume v = volumes_empty(&start, 9, 1767225600123456789), back;
    struct vol_head h = {.start = start};
    brick[512 * channels + 8 * channels] = 3;
    sd[5] = 0.5f;
    sd[512 * channels + 8 * channels] = 0.25f;
    v.n_bricks = 2;
    v.ids = ids;
    v.brick = brick;
    v.bars = (struct vol_bars){.sd = sd, .doubt = DOUBT};
    if (vol_writer_open(f, at("g"), &h, o, &w, &d) != PVX_OK) {
        T_EQ_S(d.text, "");
        return;
    }
    put(w, 7, 0);
    put(w, 8, -1);
    T_EQ_I(vol_writer_put(w, &v, &d), PVX_OK);
    finish(w);
    vol_reader *r = open_it(at("g"), 3);
    is(r, 0, 7, 0, true);
    is(r, 1, 8, -1, true);
    T_EQ_I(vol_reader_get(r, 2, &back, &d), PVX_OK);
    T_OK(volumes_same(&v, &back) && volumes_same_bars(&v, &back));
    vol_reader_close(&r);
    scratch_remove();
}

T_CASE(bars_in_vdb_and_nvdb)
{
    for (int k = 0; k < 16; k++)
        through_grids(k & 1 ? VOL_NVDB : VOL_VDB, k & 2 ? 3 : 1,
                      &(struct vol_options){
                          .split = (k & 4) != 0, .y_up = (k & 8) != 0, .unit_m = k & 8 ? 0.01 : 0});
}

/* Of damaged bars the volume is kept, where that is asked for. */
T_CASE(spared_of_damaged_bars)
{
    struct vol_volume v;
    struct pvx_diag d = {""};
    struct vol_repaired fixed;
    scratch_new();
    start = volumes_start(20, 9, 17, 1);
    vol_writer *w = begin(VOL_NPY, at("npy"));
    put(w, 1, 2);
    put(w, 2, 2);
    finish(w);
    T_EQ_I(pvx_file_write(at("npy/sd/000001.npy"), "x", 1, NULL), PVX_OK);
    vol_reader *r = open_it(at("npy"), 2);
    T_OK(vol_damaged(vol_reader_get(r, 0, &v, &d)));
    vol_reader_spare(r);
    T_EQ_I(vol_reader_get(r, 0, &v, &d), PVX_OK);
    T_OK(v.bars.sd == NULL && v.bars.damaged && v.n_bricks > 0);
    T_EQ_I(vol_reader_get(r, 1, &v, &d), PVX_OK);
    T_OK(v.bars.sd != NULL && !v.bars.damaged);
    vol_reader_close(&r);
    T_EQ_I(vol_repair_folder(at("npy"), &fixed, &d), PVX_OK);
    T_OK(fixed.done && fixed.good == 2 && fixed.bad == 0 && fixed.bare == 1);
    T_EQ_I(access(at("npy/sd/000001.npy.cut-off"), F_OK), 0);
    r = open_it(at("npy"), 2);
    is(r, 0, 1, -1, false);
    is(r, 1, 2, 2, false);
    vol_reader_close(&r);
    T_EQ_I(vol_repair_folder(at("npy"), &fixed, &d), PVX_OK);
    T_OK(!fixed.done && fixed.good == 2);
    /* a volume that was written anew without bars: those in sd are not its own */
    T_EQ_I(rename(at("npy/000001.npy"), at("npy/was")), 0);
    copy(at("npy/sd/000002.npy"), at("npy/sd/000001.npy"), -1);
    T_EQ_I(unlink(at("npy/000002.npy")), 0);
    T_EQ_I(rename(at("npy/was"), at("npy/000001.npy")), 0);
    char *text;
    size_t n;
    T_EQ_I(pvx_file_read(at("npy/000001.json"), 1 << 20, &text, &n, NULL), PVX_OK);
    char *bars = strstr(text, "\"bars\"");
    T_OK(bars != NULL);
    if (bars != NULL)
        bars[1] = 'x';
    T_EQ_I(pvx_file_write(at("npy/000001.json"), text, n, NULL), PVX_OK);
    free(text);
    r = open_it(at("npy"), 1);
    is(r, 0, 1, -1, false);
    vol_reader_close(&r);
    scratch_remove();
}

/* Whatever the byte: the first volumes that count as whole are those that were put. */
static void cut_off(bool close_it)
{
    static const int modes[] = {-1, 2, 2, 0, 2};
    struct stat st;
    uint64_t last = 0;
    scratch_new();
    start = volumes_start(20, 9, 17, 3);
    vol_writer *w = begin(VOL_HDF5, at("v.h5"));
    for (size_t k = 0; k < 5; k++)
        put(w, k + 1, modes[k]);
    if (close_it)
        finish(w);
    T_EQ_I(stat(at("v.h5"), &st), 0);
    const int cuts = T_SANITIZED ? 12 : 60;
    for (int i = 1; i <= cuts; i++) {
        vol_reader *r;
        copy(at("v.h5"), at("cut.h5"), (long)st.st_size * i / cuts);
        if (vol_reader_open(at("cut.h5"), &r, NULL) != PVX_OK)
            continue;
        uint64_t n = vol_reader_count(r);
        T_OK(n <= 5 && n >= last);
        T_OK(close_it || vol_reader_cut(r));
        for (uint64_t k = 0; k < n; k++)
            is(r, k, k + 1, modes[k], true);
        last = n;
        vol_reader_close(&r);
    }
    T_EQ_I(last, 5);
    if (!close_it)
        finish(w);
    scratch_remove();
}

T_CASE(cut_off_with_bars)
{
    cut_off(false);
    cut_off(true);
}

/* Killed at any moment, also while the file is closed and opened again for the first bars and the first modes. */
T_CASE(killed_with_bars)
{
    static const int modes[] = {-1, 0, 2, 2};
    start = volumes_start(24, 24, 24, 1);
    uint64_t rng = pvx_mix((uint64_t)getpid()) | 1;
    for (int round = 0; round < (T_SANITIZED ? 3 : 12); round++) {
        int told[2];
        uint64_t done = 0, one;
        scratch_new();
        T_EQ_I(pipe(told), 0);
        fflush(stdout);
        pid_t pid = fork();
        if (pid == 0) {
            vol_writer *w = begin(VOL_HDF5, at("v.h5"));
            for (uint64_t k = 1;; k++) {
                put(w, k, modes[k < 4 ? k - 1 : 3]);
                if (write(told[1], &k, sizeof k) != sizeof k)
                    _exit(1);
            }
        }
        close(told[1]);
        uint64_t until =
            1 + pvx_random(&rng) % 4; /* around the first sets, where all that happens */
        while (done < until && read(told[0], &one, sizeof one) == sizeof one)
            done = one;
        for (uint64_t spin = pvx_random(&rng) % 400000; spin > 0; spin--)
            __asm__ volatile("");
        kill(pid, SIGKILL);
        waitpid(pid, NULL, 0);
        while (read(told[0], &one, sizeof one) == sizeof one)
            done = one;
        close(told[0]);
        vol_reader *r = NULL;
        struct pvx_diag d = {""};
        T_CHECK_(vol_reader_open(at("v.h5"), &r, &d) == PVX_OK, "%s", d.text);
        uint64_t n = r != NULL ? vol_reader_count(r) : 0;
        T_CHECK_(n >= done && n <= done + 1, "%llu were told, %llu are there",
                 (unsigned long long)done, (unsigned long long)n);
        for (uint64_t k = 0; k < n; k++)
            is(r, k, k + 1, modes[k < 3 ? k : 3], true);
        vol_reader_close(&r);
        scratch_remove();
    }
}

/* Writes another value into a dataset of bars, as libhdf5 would, so that only the check can notice. */
static void change(const char *path, const char *name, const hsize_t *at_, int rank, bool number)
{
    hsize_t one[6] = {1, 1, 1, 1, 1, 1};
    hid_t f = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT), s = H5Dopen2(f, name, H5P_DEFAULT);
    hid_t space = H5Dget_space(s), mem = H5Screate_simple(rank, one, NULL);
    const uint32_t n = 1;
    const float x = 0.125f;
    T_OK(H5Sselect_hyperslab(space, H5S_SELECT_SET, at_, NULL, one, NULL) >= 0);
    T_OK(H5Dwrite(s, number ? H5T_NATIVE_UINT32 : H5T_NATIVE_FLOAT, mem, space, H5P_DEFAULT,
                  number ? (const void *)&n : &x) >= 0);
    H5Sclose(mem);
    H5Sclose(space);
    H5Dclose(s);
    H5Fclose(f);
}

T_CASE(damaged_bars_are_noticed)
{
    static const struct {
        const char *name;
        hsize_t at[6];
        int rank;
        bool number, modes_only;
    } hurt[] = {{"emission_sd", {1, 4, 4, 4, 0}, 5, false, false},
                {"emission_modes", {1, 1, 4, 4, 4, 0}, 6, false, true},
                {"sets/bars_doubt", {1}, 1, true, false},
                {"sets/modes", {1}, 1, true, true}};
    struct vol_volume v;
    vol_reader *r;
    scratch_new();
    start = volumes_start(16, 16, 16, 1);
    vol_writer *w = begin(VOL_HDF5, at("v.h5"));
    for (uint64_t k = 0; k < 3; k++)
        put(w, 2 * k, 2);
    finish(w);
    for (size_t i = 0; i < sizeof hurt / sizeof hurt[0]; i++) {
        copy(at("v.h5"), at("bad.h5"), -1);
        change(at("bad.h5"), hurt[i].name, hurt[i].at, hurt[i].rank, hurt[i].number);
        r = open_it(at("bad.h5"), 3);
        vol_reader_modes(r, true);
        T_EQ_I(vol_reader_get(r, 1, &v, NULL), PVX_ECORRUPT);
        T_EQ_I(vol_reader_get(r, 0, &v, NULL), PVX_OK);
        T_EQ_I(vol_reader_get(r, 2, &v, NULL), PVX_OK);
        vol_reader_modes(r, false);
        T_EQ_I(vol_reader_get(r, 1, &v, NULL), hurt[i].modes_only ? PVX_OK : PVX_ECORRUPT);
        vol_reader_close(&r);
    }
    scratch_remove();
}

/* Parts with and without bars as one file: volumes by way of the parts, and what HDF5 itself shows. */
T_CASE(joined_bars)
{
    static const uint64_t numbers[] = {1, 2, 3, 4, 9};
    struct pvx_diag d = {""};
    size_t missing;
    scratch_new();
    start = volumes_start(16, 16, 16, 1);
    T_EQ_I(mkdir(at("v.h5.parts"), 0777), 0);
    char a[512], b[512];
    snprintf(a, sizeof a, "%s", at("v.h5.parts/a.h5"));
    snprintf(b, sizeof b, "%s", at("v.h5.parts/b.h5"));
    vol_writer *w = begin(VOL_HDF5, a);
    put(w, 1, -1);
    put(w, 2, -1);
    finish(w);
    w = begin(VOL_HDF5, b);
    put(w, 3, 2);
    put(w, 4, 1);
    finish(w);
    const char *const part[] = {a, b};
    const struct vol_join j = {at("v.h5"), part, 2, numbers, 5};
    T_CHECK_(vol_join(&j, &missing, &d) == PVX_OK && missing == 1, "%s", d.text);
    vol_reader *r = open_it(at("v.h5"), 4);
    for (int wanted = 0; wanted < 2; wanted++) {
        is(r, 0, 1, -1, wanted != 0);
        is(r, 2, 3, 2, wanted != 0);
        is(r, 3, 4, 1, wanted != 0);
    }
    vol_reader_close(&r);
    float sd[5][4096], *dense = calloc(4096, sizeof *dense), *owned;
    uint32_t doubt[5];
    hid_t f = H5Fopen(at("v.h5"), H5F_ACC_RDONLY, H5P_DEFAULT);
    hid_t s = H5Dopen2(f, "entry/data/emission_errors", H5P_DEFAULT);
    hid_t c = H5Dopen2(f, "sets/bars_doubt", H5P_DEFAULT);
    T_OK(H5Dread(s, H5T_NATIVE_FLOAT, H5S_ALL, H5S_ALL, H5P_DEFAULT, sd) >= 0);
    T_OK(H5Dread(c, H5T_NATIVE_UINT32, H5S_ALL, H5S_ALL, H5P_DEFAULT, doubt) >= 0);
    T_EQ_I(H5Fclose(f) < 0, 0);
    struct made_volume m = make(4, 1, &owned);
    struct vol_volume as = m.v;
    as.brick = as.bars.sd;
    vol_to_dense(&as, dense);
    T_OK(memcmp(dense, sd[3], sizeof sd[3]) == 0);
    T_OK(isnan(sd[0][0]) && isnan(sd[4][0]));
    T_OK(doubt[0] == UINT32_MAX && doubt[4] == UINT32_MAX && doubt[2] == DOUBT && doubt[3] == 0);
    vol_store_free(&m.store);
    free(owned);
    free(dense);
    H5Dclose(c);
    H5Dclose(s);
    scratch_remove();
}

/* --- the system tests' recording --- */

/* A column of fire whose light is `bright`, `wide` of its width, `high` of its height. */
static double fire(const double p[3], double bright, double wide, double high)
{
    double r2 = (p[0] * p[0] + p[1] * p[1]) / (0.01 * wide * wide), z = p[2] / (0.45 * high);
    return z < 1 && r2 < 9 ? bright * 40 * exp(-r2) * z * (1 - z) * 4 : 0;
}

static void fill(float *value, float *sd, float *mode[3], uint32_t modes, uint32_t channels,
                 double bright, const struct pvp_grid *g)
{
    size_t i = 0;
    for (uint32_t at = 0; at < g->n[0] * g->n[1] * g->n[2]; at++) {
        double p[3];
        const uint32_t n[3] = {at % g->n[0], at / g->n[0] % g->n[1], at / g->n[0] / g->n[1]};
        for (int a = 0; a < 3; a++)
            p[a] = g->min[a] + (n[a] + 0.5) * (g->max[a] - g->min[a]) / g->n[a];
        for (uint32_t c = 0; c < channels; c++, i++) {
            const double part = 1 - 0.3 * c, v = fire(p, bright * part, 1, 1);
            const double d[3] = {fire(p, bright * part * 1.05, 1, 1) - v,
                                 fire(p, bright * part, 1.03, 1) - v,
                                 fire(p, bright * part, 1, 1.02) - v};
            double sum = 0.0025 * v * v; /* its own: 5 % */
            value[i] = (float)v;
            for (uint32_t k = 0; k < modes; k++) {
                mode[k][i] = (float)d[k];
                sum += d[k] * d[k];
            }
            sd[i] = (float)sqrt(sum);
        }
    }
}

static int write_flame(const char *path, uint64_t sets, uint32_t channels, uint32_t modes)
{
    start = volumes_start(24, 20, 32, channels);
    start.grid = (struct pvp_grid){
        .n = {24, 20, 32}, .min = {-0.24, -0.2, 0}, .max = {0.24, 0.2, 0.64}, .channels = channels};
    const size_t n = pvp_grid_count(&start.grid);
    float *all = calloc(5 * n, sizeof *all), *mode[3] = {all + 2 * n, all + 3 * n, all + 4 * n};
    struct vol_head head = {.start = start};
    struct pvx_diag d = {""};
    vol_writer *w;
    struct vol_store x = {0}, s = {0}, all_modes[3] = {{0}};
    pvx_err e = all == NULL || modes > 3 ? PVX_EINVAL
                                         : vol_writer_open(VOL_HDF5, path, &head, NULL, &w, &d);
    for (uint64_t set = 0; set < sets && e == PVX_OK; set++) {
        fill(all, all + n, mode, modes, channels, 1 + 0.2 * sin(0.7 * (double)set), &start.grid);
        struct vol_volume v =
            volumes_empty(&start, set, 1767225600000000000 + (int64_t)set * 50000000);
        v.sample = PVP_F32;
        e = vol_from_dense_bars(&x, &s, &start.grid, all, all + n);
        v.n_bricks = x.n;
        v.ids = x.ids;
        v.brick = x.brick;
        const size_t plane = (size_t)x.n * 512 * channels;
        float *planes = calloc(3 * plane + 1, sizeof *planes);
        for (uint32_t k = 0; k < modes && e == PVX_OK; k++) {
            struct vol_store both = {0};
            e = vol_from_dense_bars(&both, &all_modes[k], &start.grid, all, mode[k]);
            if (e == PVX_OK && both.n == x.n)
                memcpy(planes + k * plane, all_modes[k].brick, plane * sizeof *planes);
            vol_store_free(&both);
        }
        v.bars = (struct vol_bars){.sd = s.brick,
                                   .n_modes = modes,
                                   .modes = planes,
                                   .doubt = set == 1 ? PVP_DOUBT_FEW_CAMERAS : 0};
        if (set == 2) /* one without bars */
            v.bars = (struct vol_bars){0};
        PVX_THEN(e, vol_writer_put(w, &v, &d));
        free(planes);
    }
    PVX_THEN(e, vol_writer_close(&w, &d));
    if (e != PVX_OK)
        fprintf(stderr, "%s: %s\n", path, pvx_diag_text(&d, e));
    for (int k = 0; k < 3; k++)
        vol_store_free(&all_modes[k]);
    vol_store_free(&x);
    vol_store_free(&s);
    free(all);
    return e != PVX_OK;
}

int main(int argc, char **argv)
{
    if (argc == 6 && strcmp(argv[1], "--write") == 0)
        return write_flame(argv[2], strtoul(argv[3], NULL, 10), (uint32_t)atoi(argv[4]),
                           (uint32_t)atoi(argv[5]));
    plugins_of_this_build();
    t_run();
    return t_done();
}
