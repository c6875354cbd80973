/* test_volumes.c - recordings of volumes: what was put comes back, bit for bit; what is cut off or wrong is said. */
#include "../t.h"

#include <fcntl.h>
#include <hdf5.h>
#include <signal.h>
#include <sys/wait.h>

#include "base/file.h"
#include "daemon/volumes/volumes.h"
#include "tests/lib/scratch.h"
#include "tests/lib/volumes.h"

static const char *const names[VOL_FORMATS] = {"npy", "v.h5", "vdb", "nvdb"};

static vol_writer *begin(enum vol_format f, const char *path, const struct pvp_start *s)
{
    vol_writer *w = NULL;
    struct pvx_diag d = {""};
    struct vol_head h = {.start = *s, .rig = "cameras: []\n", .config = "x: 1\n"};
    T_CHECK_(vol_writer_open(f, path, &h, NULL, &w, &d) == PVX_OK, "%s", d.text);
    return w;
}

static void put(vol_writer *w, const struct pvp_start *s, uint64_t set, double share)
{
    struct pvx_diag d = {""};
    struct made_volume m = volumes_make(s, set, share);
    T_CHECK_(vol_writer_put(w, &m.v, &d) == PVX_OK, "%s", d.text);
    vol_store_free(&m.store);
}

static void finish(vol_writer *w)
{
    struct pvx_diag d = {""};
    T_CHECK_(vol_writer_close(&w, &d) == PVX_OK, "%s", d.text);
}

static void comes_back(enum vol_format f, const struct pvp_start *s, double share)
{
    scratch_new();
    const char *path = at("%s", names[f]);
    vol_writer *w = begin(f, path, s);
    if (w == NULL)
        return;
    struct vol_gap g = {.why = VOL_GAP_QUEUE, .set_first = 4, .set_last = 6, .volumes = 3};
    for (uint64_t k = 1; k < 4; k++) {
        vol_writer_hurry(w, k == 2);
        put(w, s, k, share);
    }
    T_EQ_I(vol_writer_gap(w, &g, NULL), PVX_OK);
    put(w, s, 7, share);
    for (int why = 0; why < VOL_GAPS; why++) {
        uint64_t set = 8 + (uint64_t)why;
        T_EQ_I(vol_writer_gap(w, &(struct vol_gap){(enum vol_gap_why)why, set, set, 1}, NULL),
               PVX_OK);
    }
    finish(w);
    vol_reader *r = NULL;
    struct pvx_diag d = {""};
    T_CHECK_(vol_reader_open(path, &r, &d) == PVX_OK, "%s", d.text);
    if (r == NULL)
        return;
    const struct vol_head *h = vol_reader_head(r);
    T_EQ_I(vol_reader_format(r), f);
    T_EQ_I(vol_reader_count(r), 4);
    T_OK(!vol_reader_cut(r));
    T_EQ_S(h->rig, "cameras: []\n");
    T_EQ_S(h->config, "x: 1\n");
    T_OK(h->start.session == s->session && h->start.rig_hash == s->rig_hash);
    T_EQ_I(h->start.n_cameras, 8);
    T_NEAR(h->start.fps, 20, 0);
    T_EQ_S(h->start.units, "1/m");
    T_EQ_S(h->start.software, "pyrovoxd test");
    for (uint64_t k = 0; k < 4; k++) {
        struct made_volume m = volumes_make(s, k < 3 ? k + 1 : 7, share);
        struct vol_volume v;
        T_CHECK_(vol_reader_get(r, k, &v, &d) == PVX_OK, "%s", d.text);
        T_OK(volumes_same(&m.v, &v));
        for (int a = 0; a < 3; a++) {
            T_EQ_I(v.v.grid.n[a], s->grid.n[a]);
            T_NEAR(v.v.grid.min[a], s->grid.min[a], 0);
            T_NEAR(v.v.grid.max[a], s->grid.max[a], 1e-12);
        }
        vol_store_free(&m.store);
    }
    const struct vol_gap *back = vol_reader_gap(r, 0);
    T_OK(back != NULL && back->why == VOL_GAP_QUEUE && back->set_first == 4 &&
         back->set_last == 6 && back->volumes == 3);
    for (uint64_t why = 0; why < VOL_GAPS; why++) {
        back = vol_reader_gap(r, 1 + why);
        T_OK(back != NULL && back->why == why && back->set_first == 8 + why);
    }
    T_OK(vol_reader_gap(r, 1 + VOL_GAPS) == NULL);
    vol_reader_close(&r);
    scratch_remove();
}

T_CASE_OF_THREADS(volumes_come_back)
{
    static const uint32_t shape[][3] = {{16, 16, 16}, {33, 20, 9}, {7, 5, 3}, {48, 1, 40}};
    for (size_t k = 0; k < sizeof shape / sizeof shape[0]; k++)
        for (uint32_t nch = 1; nch <= 3; nch += 2) {
            struct pvp_start s = volumes_start(shape[k][0], shape[k][1], shape[k][2], nch);
            comes_back(VOL_NPY, &s, 0.4);
            comes_back(VOL_HDF5, &s, 0.4);
            comes_back(VOL_HDF5, &s, 0);
        }
}

T_CASE(another_grid_or_an_old_file_is_refused)
{
    scratch_new();
    for (int f = VOL_NPY; f <= VOL_HDF5; f++) {
        struct pvp_start s = volumes_start(20, 20, 20, 3), other = volumes_start(20, 20, 21, 3);
        const char *path = at("%s", names[f]);
        vol_writer *w = begin((enum vol_format)f, path, &s), *again = NULL;
        struct made_volume m = volumes_make(&other, 1, 0.5);
        struct vol_head h = {.start = s};
        struct pvx_diag d = {""};
        put(w, &s, 1, 0.5);
        T_EQ_I(vol_writer_put(w, &m.v, &d), PVX_ERANGE);
        T_CONTAINS(d.text, "grid");
        finish(w);
        d.text[0] = '\0';
        T_EQ_I(vol_writer_open((enum vol_format)f, path, &h, NULL, &again, &d), PVX_EBUSY);
        T_CONTAINS(d.text, path);
        vol_store_free(&m.store);
    }
    scratch_remove();
}

/* The first `bytes` of a file; -1: all. */
static void copy(const char *from, const char *to, long bytes)
{
    char *text;
    size_t len;
    T_EQ_I(pvx_file_read(from, 1u << 30, &text, &len, NULL), PVX_OK);
    T_EQ_I(pvx_file_write(to, text, bytes < 0 ? len : (size_t)bytes, NULL), PVX_OK);
    free(text);
}

/* How many volumes a file gives; all of them are those that were put.  -1: not opened. */
static long whole(const char *path, const struct pvp_start *s, double share)
{
    vol_reader *r;
    if (vol_reader_open(path, &r, NULL) != PVX_OK)
        return -1;
    long n = (long)vol_reader_count(r);
    for (long k = 0; k < n; k++) {
        struct made_volume m = volumes_make(s, (uint64_t)k + 1, share);
        struct vol_volume v;
        struct pvx_diag d = {""};
        bool got = vol_reader_get(r, (uint64_t)k, &v, &d) == PVX_OK;
        T_CHECK_(got && volumes_same(&m.v, &v), "volume %ld of %ld: %s", k, n, d.text);
        vol_store_free(&m.store);
    }
    vol_reader_close(&r);
    return n;
}

/* Cut at any place: the sets before it, never one that is not whole. */
static void sweep(bool close_it)
{
    struct pvp_start s = volumes_start(24, 24, 24, 3);
    long last = -1;
    scratch_new();
    char path[512]; /* at() is good for a few names only */
    snprintf(path, sizeof path, "%s", at("v.h5"));
    vol_writer *w = begin(VOL_HDF5, path, &s);
    for (uint64_t k = 1; k <= 100; k++)
        put(w, &s, k, 0.3);
    struct stat st;
    if (close_it)
        finish(w);
    stat(path, &st);
    for (int i = 0; i <= 60; i += T_SANITIZED ? 4 : 1) {
        long bytes = (long)((double)st.st_size * i / 60);
        copy(path, at("cut.h5"), bytes);
        long n = whole(at("cut.h5"), &s, 0.3);
        T_CHECK_(n >= last - 1, "cut at %ld of %ld: %ld volumes, %ld in less", bytes,
                 (long)st.st_size, n, last);
        last = n > last ? n : last;
    }
    T_EQ_I(last, 100);
    if (!close_it)
        finish(w);
    scratch_remove();
}

T_CASE(cut_anywhere_gives_the_volumes_before)
{
    sweep(false);
}

T_CASE(closed_and_cut_gives_the_volumes_before)
{
    sweep(true);
}

/* A kill at any moment loses at most the volume being written. */
T_CASE(killed_at_any_time_gives_the_volumes_before)
{
    struct pvp_start s = volumes_start(24, 24, 24, 3);
    for (int round = 0; round < (T_SANITIZED ? 4 : 20); round++) {
        int told[2];
        uint64_t done = 0, one;
        scratch_new();
        T_EQ_I(pipe(told), 0);
        pid_t pid = fork();
        if (pid == 0) {
            vol_writer *w = begin(VOL_HDF5, at("v.h5"), &s);
            for (uint64_t k = 1; k <= 400; k++) {
                put(w, &s, k, 0.3);
                if (write(told[1], &k, sizeof k) != sizeof k)
                    _exit(1);
            }
            _exit(0);
        }
        close(told[1]);
        uint64_t stop_at = 1 + t_rand() % 100;
        while (done < stop_at && read(told[0], &one, sizeof one) == sizeof one)
            done = one;
        kill(pid, SIGKILL);
        waitpid(pid, NULL, 0);
        while (read(told[0], &one, sizeof one) == sizeof one)
            done = one;
        close(told[0]);
        long n = whole(at("v.h5"), &s, 0.3);
        T_CHECK_(n >= (long)done && n <= (long)done + 1, "%llu were told, %ld are there",
                 (unsigned long long)done, n);
        scratch_remove();
    }
}

T_CASE(folder_of_npy_is_repaired)
{
    struct pvp_start s = volumes_start(24, 24, 24, 3);
    struct vol_repaired fixed;
    struct pvx_diag d = {""};
    scratch_new();
    vol_writer *w = begin(VOL_NPY, at("npy"), &s);
    for (uint64_t k = 1; k <= 4; k++)
        put(w, &s, k, 0.3);
    const struct vol_gap far = {VOL_GAP_QUEUE, 1700000000123456789, 1700000000123456790, 2};
    T_EQ_I(vol_writer_gap(w, &far, &d), PVX_OK);
    copy(at("npy/recording.json"), at("open.json"), -1);
    finish(w);
    T_EQ_I(vol_repair_folder(at("npy"), &fixed, &d), PVX_OK);
    T_OK(!fixed.done && fixed.good == 4 && fixed.bad == 0);
    copy(at("open.json"), at("npy/recording.json"), -1); /* killed */
    struct stat st;
    char last[512];
    snprintf(last, sizeof last, "%s", at("npy/000004.npy"));
    copy(last, at("4"), -1);
    T_EQ_I(stat(last, &st), 0);
    for (int i = 0; i < 20; i++) { /* cut anywhere: refused, with its name */
        vol_reader *r;
        struct vol_volume v;
        copy(at("4"), last, (long)st.st_size * i / 20);
        d.text[0] = '\0';
        T_EQ_I(vol_reader_open(at("npy"), &r, &d), PVX_OK);
        T_OK(vol_reader_cut(r) && vol_reader_get(r, 3, &v, &d) != PVX_OK);
        T_CONTAINS(d.text, "000004.npy");
        vol_reader_close(&r);
    }
    d.text[0] = '\0';
    T_EQ_I(vol_repair_folder(at("npy"), &fixed, &d), PVX_OK);
    T_EQ_S(d.text, "");
    T_OK(fixed.done && fixed.good == 3 && fixed.bad == 1 &&
         access(at("npy/000004.npy.cut-off"), F_OK) == 0);
    T_EQ_I(whole(at("npy"), &s, 0.3), 3);
    vol_reader *again;
    T_EQ_I(vol_reader_open(at("npy"), &again, &d), PVX_OK);
    const struct vol_gap *g = vol_reader_gap(again, 0);
    T_OK(!vol_reader_cut(again) && g != NULL && g->why == VOL_GAP_QUEUE);
    T_OK(g->set_first == far.set_first && g->set_last == far.set_last && g->volumes == 2);
    T_OK(vol_reader_gap(again, 1) == NULL);
    vol_reader_close(&again);
    T_EQ_I(vol_repair_folder(at("npy"), &fixed, &d), PVX_OK);
    T_OK(!fixed.done && fixed.good == 3 && fixed.bad == 0);
    T_EQ_I(vol_repair_folder(at("npy/000001.npy"), &fixed, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "name its folder");
    scratch_remove();
}

/* The number of volume k of a recording. */
static uint64_t set_of(vol_reader *r, uint64_t k)
{
    struct vol_volume v = {.n_bricks = 0};
    struct pvx_diag d = {""};
    T_CHECK_(vol_reader_get(r, k, &v, &d) == PVX_OK, "%s", d.text);
    return v.v.set;
}

T_CASE(folder_of_npy_is_read_by_number)
{
    struct pvp_start s = volumes_start(9, 8, 7, 1);
    static const uint64_t sets[] = {7, 999999, 1000000, 2026112713451200001u};
    struct pvx_diag d = {""};
    vol_reader *r = NULL;
    scratch_new();
    vol_writer *w = begin(VOL_NPY, at("n[1]*"), &s); /* no pattern */
    for (size_t k = 4; k-- > 0;)
        put(w, &s, sets[k], 0.5);
    const struct vol_gap lost = {VOL_GAP_LOST, sets[3] + 1, sets[3] + 2, 2}; /* no doubles */
    T_EQ_I(vol_writer_gap(w, &lost, NULL), PVX_OK);
    finish(w);
    T_EQ_I(pvx_file_write(at("n[1]*/._000007.npy"), "x", 1, NULL), PVX_OK); /* hidden */
    T_CHECK_(vol_reader_open(at("n[1]*"), &r, &d) == PVX_OK, "%s", d.text);
    for (uint64_t k = 0; k < 4 && r != NULL; k++)
        T_EQ_I(set_of(r, k), sets[k]);
    T_EQ_I(vol_reader_count(r), 4);
    const struct vol_gap *gap = r != NULL ? vol_reader_gap(r, 0) : NULL;
    T_OK(gap != NULL && gap->set_first == lost.set_first && gap->set_last == lost.set_last);
    vol_reader_close(&r);
    copy(at("n[1]*/000007.json"), at("n[1]*/1000000.json"), -1); /* of another file */
    T_EQ_I(vol_reader_open(at("n[1]*"), &r, &d), PVX_OK);
    struct vol_volume v;
    T_EQ_I(vol_reader_get(r, 2, &v, &d), PVX_ERANGE);
    T_CONTAINS(d.text, "1000000.npy: its .json is of set 7");
    vol_reader_close(&r);
    d.text[0] = '\0';
    copy(at("n[1]*/000007.npy"), at("n[1]*/07.npy"), -1);
    T_EQ_I(vol_reader_open(at("n[1]*"), &r, &d), PVX_EFORMAT);
    T_CONTAINS(d.text, "have one number");
    scratch_remove();
}

T_CASE(what_is_not_known_is_not_there)
{
    struct pvp_start s = volumes_start(9, 8, 7, 1);
    scratch_new();
    for (int f = VOL_NPY; f <= VOL_HDF5; f++) {
        struct vol_head h = {.start = s};
        vol_writer *w = NULL;
        vol_reader *r = NULL;
        T_EQ_I(vol_writer_open((enum vol_format)f, at("%s", names[f]), &h, NULL, &w, NULL), PVX_OK);
        put(w, &s, 1, 0.5);
        finish(w);
        T_EQ_I(vol_reader_open(at("%s", names[f]), &r, NULL), PVX_OK);
        T_OK(vol_reader_head(r)->rig == NULL && vol_reader_head(r)->config == NULL);
        vol_reader_close(&r);
    }
    scratch_remove();
}

/* What `repair` puts aside is what cannot be read, and no more. */
T_CASE(repair_and_reader_agree)
{
    struct pvp_start s = volumes_start(9, 8, 7, 1), other = volumes_start(9, 8, 7, 3);
    struct pvx_diag d = {""}, d2 = {""};
    struct vol_repaired fixed;
    vol_reader *r = NULL;
    struct vol_volume v;
    scratch_new();
    vol_writer *w = begin(VOL_NPY, at("npy"), &s), *w2 = begin(VOL_NPY, at("other"), &other);
    for (uint64_t k = 1; k <= 3; k++)
        put(w, &s, k, 0.5);
    put(w2, &other, 3, 0.5);
    finish(w);
    finish(w2);
    copy(at("other/000003.npy"), at("npy/000001.npy"), -1); /* not as its .json says */
    T_CHECK_(vol_reader_open(at("npy"), &r, &d) == PVX_OK, "%s", d.text);
    T_EQ_I(vol_reader_get(r, 0, &v, &d), PVX_EFORMAT);
    T_CONTAINS(d.text, "000001.json");
    T_CONTAINS(d.text, "shape");
    T_EQ_I(set_of(r, 1), 2);
    vol_reader_close(&r);
    T_EQ_I(vol_repair_folder(at("npy"), &fixed, NULL), PVX_OK);
    T_OK(fixed.done && fixed.good == 2 && fixed.bad == 1);
    copy(at("other/000003.npy"), at("npy/000003.npy"), -1); /* another recording's, whole */
    copy(at("other/000003.json"), at("npy/000003.json"), -1);
    d.text[0] = '\0';
    T_EQ_I(vol_reader_open(at("npy"), &r, NULL), PVX_OK);
    T_EQ_I(vol_reader_get(r, 1, &v, &d), PVX_ERANGE);
    T_CONTAINS(d.text, "set 3");
    vol_reader_close(&r);
    T_EQ_I(vol_repair_folder(at("npy"), &fixed, &d2), PVX_ERANGE);
    T_CONTAINS(d2.text, "000003.npy");
    scratch_remove();
}

static void set_int(const char *path, const char *name, int64_t v)
{
    hid_t f = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT), a = H5Aopen(f, name, H5P_DEFAULT);
    T_OK(H5Awrite(a, H5T_NATIVE_INT64, &v) >= 0);
    H5Aclose(a);
    H5Fclose(f);
}

/* What somebody else wrote in place of a value. */
static void spoil(const char *path, float v)
{
    hid_t f = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT), s = H5Dopen2(f, "emission", H5P_DEFAULT);
    hsize_t at[5] = {0}, n[5] = {1, 1, 1, 1, 1};
    hid_t space = H5Dget_space(s), mem = H5Screate_simple(5, n, NULL);
    H5Sselect_hyperslab(space, H5S_SELECT_SET, at, NULL, n, NULL);
    T_OK(H5Dwrite(s, H5T_NATIVE_FLOAT, mem, space, H5P_DEFAULT, &v) >= 0);
    H5Sclose(mem);
    H5Sclose(space);
    H5Dclose(s);
    H5Fclose(f);
}

static hid_t no_link(const char *name, hid_t group, const void *to, size_t size, hid_t how,
                     hid_t open)
{
    (void)name, (void)group, (void)to, (void)size, (void)how, (void)open;
    return -1;
}

/* Puts in place of the data those of another file: by a link, or of a file of any kind. */
static void lie_elsewhere(const char *path, const char *other, bool link)
{
    hsize_t n[5] = {0};
    hid_t f = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT), s = H5Dopen2(f, "emission", H5P_DEFAULT);
    hid_t space = H5Dget_space(s), p = H5Pcreate(H5P_DATASET_CREATE);
    H5Sget_simple_extent_dims(space, n, NULL);
    H5Sclose(space);
    H5Dclose(s);
    H5Ldelete(f, "emission", H5P_DEFAULT);
    space = H5Screate_simple(5, n, NULL);
    H5Pset_external(p, other, 0, H5F_UNLIMITED);
    if (link) { /* our programs do not know such links */
        static const H5L_class_t is = {
            .version = H5L_LINK_CLASS_T_VERS, .id = H5L_TYPE_EXTERNAL, .trav_func = no_link};
        char to[4200] = "";
        size_t size = (size_t)snprintf(to + 1, sizeof to - 1, "%s%c/emission", other, 0) + 2;
        T_OK(H5Lregister(&is) >= 0);
        T_OK(H5Lcreate_ud(f, "emission", H5L_TYPE_EXTERNAL, to, size, H5P_DEFAULT, H5P_DEFAULT) >=
             0);
        T_OK(H5Lunregister(H5L_TYPE_EXTERNAL) >= 0);
    } else {
        s = H5Dcreate2(f, "emission", H5T_IEEE_F32LE, space, H5P_DEFAULT, p, H5P_DEFAULT);
        T_OK(s >= 0);
        H5Dclose(s);
    }
    H5Pclose(p);
    H5Sclose(space);
    H5Fclose(f);
}

T_CASE(what_is_wrong_is_refused)
{
    struct pvp_start s = volumes_start(24, 24, 24, 3);
    struct vol_volume v;
    struct pvx_diag d = {""};
    vol_reader *r = NULL;
    scratch_new();
    vol_writer *w = begin(VOL_HDF5, at("v.h5"), &s);
    put(w, &s, 1, 1);
    put(w, &s, 2, 1);
    finish(w);
    copy(at("v.h5"), at("later.h5"), -1);
    set_int(at("later.h5"), "version", 2);
    T_EQ_I(vol_reader_open(at("later.h5"), &r, &d), PVX_EVERSION);
    T_CONTAINS(d.text, "version 2");
    copy(at("v.h5"), at("nan.h5"), -1);
    spoil(at("nan.h5"), NAN);
    T_EQ_I(vol_reader_open(at("nan.h5"), &r, &d), PVX_OK);
    if (r != NULL) {
        d.text[0] = '\0';
        T_EQ_I(vol_reader_get(r, 0, &v, &d), PVX_ECORRUPT);
        T_EQ_I(vol_reader_get(r, 1, &v, NULL), PVX_OK);
        vol_reader_close(&r);
    }
    for (int link = 0; link < 2; link++) {
        copy(at("v.h5"), at("away.h5"), -1);
        lie_elsewhere(at("away.h5"), at("v.h5"), link);
        d.text[0] = '\0';
        T_OK(vol_reader_open(at("away.h5"), &r, &d) != PVX_OK);
        T_OK(r == NULL);
        T_CONTAINS(d.text, link ? "no emission" : "emission is in other files");
        vol_reader_close(&r);
    }
    T_EQ_I(vol_reader_open(at("nothing"), &r, NULL), PVX_ENOENT);
    T_EQ_I(vol_reader_open(dir, &r, NULL), PVX_EFORMAT);
    T_EQ_I(pvx_file_write(at("text.h5"), "\x89HDF\r\n\x1a\nrubbish", 16, NULL), PVX_OK);
    T_EQ_I(vol_reader_open(at("text.h5"), &r, NULL), PVX_EFORMAT);
    scratch_remove();
}
T_CASE(pipes_are_no_recordings)
{
    static const char *const ends[] = {"npy", "h5", "vdb", "nvdb"};
    scratch_new();
    for (size_t i = 0; i < sizeof ends / sizeof ends[0]; i++) {
        vol_reader *r;
        struct pvx_diag d = {""};
        T_EQ_I(mkfifo(at("pipe.%s", ends[i]), 0600), 0);
        T_EQ_I(vol_reader_open(at("pipe.%s", ends[i]), &r, &d), PVX_EFORMAT);
        T_CONTAINS(d.text, "is a named pipe");
    }
    scratch_remove();
}
