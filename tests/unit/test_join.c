/* test_join.c - recordings of parts as one: every volume comes back bit for bit, to HDF5 itself too; what is missing reads
 * as not solved; what does not belong together is refused. */
#include "../t.h"

#include <hdf5.h>
#include <math.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/file.h"
#include "daemon/volumes/join.h"
#include "tests/lib/scratch.h"
#include "tests/lib/volumes.h"

#define SETS  12
#define SHARE 0.4

static struct pvp_start start;
static uint64_t numbers[SETS]; /* 10, 12, 14, ... */

/* Sets [a, b) of them into a part; with one gap, unless `hole` is 0. */
static const char *part(const char *name, size_t a, size_t b, uint64_t hole)
{
    const char *path = at("%s", name);
    vol_writer *w = NULL;
    struct pvx_diag d = {""};
    struct vol_head h = {.start = start, .rig = "cameras: []\n"};
    T_CHECK_(vol_writer_open(VOL_HDF5, path, &h, NULL, &w, &d) == PVX_OK, "%s", d.text);
    for (size_t k = a; k < b; k++) {
        if (numbers[k] == hole) {
            struct vol_gap g = {VOL_GAP_UNREADABLE, hole, hole, 1};
            T_EQ_I(vol_writer_gap(w, &g, &d), PVX_OK);
            continue;
        }
        struct made_volume m = volumes_make(&start, numbers[k], SHARE);
        T_CHECK_(vol_writer_put(w, &m.v, &d) == PVX_OK, "%s", d.text);
        vol_store_free(&m.store);
    }
    T_CHECK_(vol_writer_close(&w, &d) == PVX_OK, "%s", d.text);
    return path;
}

static void begin(void)
{
    scratch_new();
    start = volumes_start(33, 20, 9, 3);
    for (size_t k = 0; k < SETS; k++)
        numbers[k] = 10 + 2 * k;
    T_EQ_I(mkdir(at("v.h5.parts"), 0777), 0);
}

static pvx_err join(const char *out, const char *const *parts, size_t n, size_t *missing,
                    struct pvx_diag *d)
{
    struct vol_join j = {.out = out, .part = parts, .n_parts = n, .number = numbers, .n = SETS};
    return vol_join(&j, missing, d);
}

/* Of the sets [a, b) of the recording, counted from k, each volume. */
static void has(vol_reader *r, uint64_t k, size_t a, size_t b)
{
    for (; a < b; a++, k++) {
        struct made_volume m = volumes_make(&start, numbers[a], SHARE);
        struct vol_volume v;
        struct pvx_diag d = {""};
        bool got = vol_reader_get(r, k, &v, &d) == PVX_OK;
        T_CHECK_(got && v.v.set == numbers[a] && volumes_same(&m.v, &v), "set %zu: %s", a, d.text);
        vol_store_free(&m.store);
    }
}

/* As any program sees it: the value at the middle of set k, or NaN. */
static float middle(const char *path, hsize_t k, uint32_t *status)
{
    const hsize_t from[5] = {k, 4, 10, 16, 0}, one[5] = {1, 1, 1, 1, 1};
    float value = -1;
    hid_t f = H5Fopen(path, H5F_ACC_RDONLY, H5P_DEFAULT), s = H5Dopen2(f, "emission", H5P_DEFAULT);
    hid_t space = H5Dget_space(s), mem = H5Screate_simple(1, one, NULL);
    H5Sselect_hyperslab(space, H5S_SELECT_SET, from, NULL, one, NULL);
    T_OK(H5Dread(s, H5T_NATIVE_FLOAT, mem, space, H5P_DEFAULT, &value) >= 0);
    uint32_t all[SETS] = {0};
    hid_t c = H5Dopen2(f, "sets/status", H5P_DEFAULT);
    T_OK(H5Dread(c, H5T_NATIVE_UINT32, H5S_ALL, H5S_ALL, H5P_DEFAULT, all) >= 0);
    *status = all[k];
    H5Dclose(c);
    H5Sclose(mem);
    H5Sclose(space);
    H5Dclose(s);
    H5Fclose(f);
    return value;
}

static float truth(size_t k)
{
    struct made_volume m = volumes_make(&start, numbers[k], SHARE);
    float *dense = calloc((size_t)33 * 20 * 9 * 3, sizeof *dense);
    vol_to_dense(&m.v, dense);
    float value = dense[((4 * 20 + 10) * 33 + 16) * 3];
    free(dense);
    vol_store_free(&m.store);
    return value;
}

T_CASE(parts_are_one_recording)
{
    begin();
    const char *parts[3] = {strdup(part("v.h5.parts/a.h5", 0, 4, 0)),
                            strdup(part("v.h5.parts/c.h5", 9, SETS, 0)),
                            strdup(part("v.h5.parts/b.h5", 4, 9, 0))};
    const char *out = at("v.h5");
    struct pvx_diag d = {""};
    size_t missing = 7;
    T_CHECK_(join(out, parts, 3, &missing, &d) == PVX_OK, "%s", d.text);
    T_EQ_I(missing, 0);
    vol_reader *r = NULL;
    T_CHECK_(vol_reader_open(out, &r, &d) == PVX_OK, "%s", d.text);
    T_EQ_I(vol_reader_format(r), VOL_HDF5);
    T_EQ_I(vol_reader_count(r), SETS);
    T_OK(!vol_reader_cut(r));
    T_OK(vol_reader_gap(r, 0) == NULL);
    T_EQ_S(vol_reader_head(r)->rig, "cameras: []\n");
    has(r, 0, 0, SETS);
    has(r, 2, 2, 3); /* back again */
    vol_reader_close(&r);
    uint32_t status;
    size_t lit = 0;
    for (size_t k = 0; k < SETS; k++) {
        T_NEAR(middle(out, k, &status), truth(k), 0);
        T_EQ_I(status, 2);
        lit += truth(k) != 0;
    }
    T_OK(lit > 0);
    for (int i = 0; i < 3; i++)
        free((char *)parts[i]);
    scratch_remove();
}

T_CASE(what_is_not_there_is_not_dark)
{
    begin();
    const char *parts[2] = {strdup(part("v.h5.parts/a.h5", 0, 4, 0)),
                            strdup(part("v.h5.parts/c.h5", 8, SETS, 30))};
    const char *out = at("v.h5");
    struct pvx_diag d = {""};
    size_t missing = 0;
    T_CHECK_(join(out, parts, 2, &missing, &d) == PVX_OK, "%s", d.text);
    T_EQ_I(missing, 4); /* 18 to 24; 30 has no volume, and never will */
    vol_reader *r = NULL;
    T_CHECK_(vol_reader_open(out, &r, &d) == PVX_OK, "%s", d.text);
    T_EQ_I(vol_reader_count(r), 7);
    T_OK(vol_reader_cut(r));
    const struct vol_gap *g = vol_reader_gap(r, 0);
    T_OK(g != NULL && g->why == VOL_GAP_UNSOLVED && g->set_first == 18 && g->set_last == 24 &&
         g->volumes == 4);
    T_OK(vol_reader_gap(r, 1) == NULL);
    has(r, 0, 0, 4);
    has(r, 4, 8, 10);
    has(r, 6, 11, SETS);
    vol_reader_close(&r);
    uint32_t status;
    T_OK(isnan(middle(out, 5, &status)));
    T_EQ_I(status, VOL_UNSOLVED);
    T_NEAR(middle(out, 9, &status), truth(9), 0);
    /* a part that goes later */
    T_EQ_I(unlink(parts[0]), 0);
    T_CHECK_(vol_reader_open(out, &r, &d) == PVX_OK, "%s", d.text);
    T_EQ_I(vol_reader_count(r), 3);
    T_OK(vol_reader_gap(r, 0)->set_first == 10 && vol_reader_gap(r, 0)->set_last == 24);
    has(r, 0, 8, 10);
    vol_reader_close(&r);
    T_EQ_I(unlink(parts[1]), 0);
    T_EQ_I(vol_reader_open(out, &r, &d), PVX_ENOENT);
    T_CONTAINS(d.text, "none of its parts");
    free((char *)parts[0]);
    free((char *)parts[1]);
    scratch_remove();
}

T_CASE(what_does_not_belong_together_is_refused)
{
    begin();
    const char *parts[2] = {strdup(part("v.h5.parts/a.h5", 0, 4, 0)), NULL};
    const char *out = at("v.h5");
    struct pvx_diag d = {""};
    size_t missing;
    start.session++;
    parts[1] = strdup(part("v.h5.parts/b.h5", 4, SETS, 0));
    T_EQ_I(join(out, parts, 2, &missing, &d), PVX_EFORMAT);
    T_CONTAINS(d.text, "b.h5: is of another recording");
    T_OK(access(out, F_OK) != 0);
    /* a set that was not asked for */
    numbers[0] = 11;
    d.text[0] = '\0';
    T_EQ_I(join(out, parts, 1, &missing, &d), PVX_EFORMAT);
    T_CONTAINS(d.text, "set 10");
    numbers[0] = 10;
    /* nothing is written over but what was joined */
    d.text[0] = '\0';
    T_EQ_I(join(parts[0], parts, 1, &missing, &d), PVX_EBUSY);

    d.text[0] = '\0';
    T_EQ_I(join(out, parts, 0, &missing, &d), PVX_ENOENT);
    T_EQ_I(join(out, parts, 1, &missing, &d), PVX_OK);
    T_EQ_I(join(out, parts, 1, &missing, &d), PVX_OK);
    T_EQ_I(missing, SETS - 4);
    /* a part that is another one by now */
    vol_reader *r = NULL;
    T_EQ_I(rename(parts[1], parts[0]), 0);
    d.text[0] = '\0';
    pvx_err e = vol_reader_open(out, &r, &d);
    struct vol_volume v;
    if (e == PVX_OK)
        e = vol_reader_get(r, 0, &v, &d);
    T_OK(e == PVX_ECORRUPT || e == PVX_EFORMAT);
    T_CONTAINS(d.text, "a.h5");
    vol_reader_close(&r);
    free((char *)parts[0]);
    free((char *)parts[1]);
    scratch_remove();
}

/* What libhdf5 would look through for ever, or past its end: the heap in which the mapping lies. */
static void damage_heap(const char *path, long from, int value)
{
    char *file;
    size_t n;
    T_EQ_I(pvx_file_read(path, 1 << 24, &file, &n, NULL), PVX_OK);
    char *heap = memmem(file, n, "GCOL", 4);
    T_OK(heap != NULL);
    FILE *f = fopen(path, "r+b");
    T_OK(f != NULL && fseek(f, heap - file + from, SEEK_SET) == 0);
    for (int i = 0; i < 24; i++)
        fputc(value, f);
    T_EQ_I(fclose(f), 0);
    free(file);
}

T_CASE(a_damaged_mapping_is_refused)
{
    begin();
    const char *parts[1] = {strdup(part("v.h5.parts/a.h5", 0, SETS, 0))};
    const char *out = at("v.h5");
    for (int value = 0; value < 256; value += 255) {
        vol_reader *r = NULL;
        size_t missing;
        struct pvx_diag d = {""};
        T_EQ_I(join(out, parts, 1, &missing, &d), PVX_OK);
        T_EQ_I(vol_reader_open(out, &r, &d), PVX_OK);
        vol_reader_close(&r);
        damage_heap(out, 16, value);
        T_EQ_I(vol_reader_open(out, &r, &d), PVX_EFORMAT);
        T_OK(r == NULL && d.text[0] != '\0');
        T_EQ_I(unlink(out), 0);
    }
    free((char *)parts[0]);
    scratch_remove();
}
