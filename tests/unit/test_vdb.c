/* Recordings in OpenVDB and NanoVDB: what was put comes out again, numbers have no holes, damaged files are
 * refused.
 *
 * `test_vdb --write DIR` is the system tests' writer: recordings of all layouts that other people's programs
 * then read.  `test_vdb --endless DIR` writes until it is killed. */
#include <stdio.h>
#include <sys/stat.h>

#include "base/file.h"
#include "daemon/volumes/volumes.h"
#include "tests/lib/plugins.h"
#include "tests/lib/scratch.h"
#include "tests/lib/volume_bed.h"
#include "tests/t.h"

#define T0 INT64_C(1767225600000000000)

static struct pvx_diag d;

static bool there(const char *path)
{
    struct stat st;
    return stat(path, &st) == 0;
}

/* Sets first, first+1 ... without those of `skip`, which end with 0. */
static void record(struct volume_bed *b, const struct vol_writer_ops *f, const char *path,
                   const struct vol_options *o, uint64_t first, uint64_t n, const uint64_t *skip)
{
    void *w = NULL;
    d = (struct pvx_diag){""};
    if (f->open(&w, path, &b->head, o, &d) != PVX_OK) {
        T_EQ_S(d.text, "");
        return;
    }
    for (uint64_t s = first; s < first + n; s++) {
        if (skip != NULL && s == *skip) {
            skip++;
            continue;
        }
        T_EQ_I(f->put(w, volume_bed_make(b, s, T0 + (int64_t)s * 50000000), &d), PVX_OK);
    }
    T_EQ_S(d.text, "");
    T_OK(f->bytes(w) > 0);
    T_EQ_I(f->close(w, &d), PVX_OK);
}

static void reread(struct volume_bed *b, const struct vol_reader_ops *f, const char *path,
                   uint64_t first, uint64_t n)
{
    void *r = NULL;
    struct vol_head head;
    uint64_t count = 0;
    bool cut = true;
    struct vol_volume got;
    d = (struct pvx_diag){""};
    T_OK(f->is(path));
    pvx_err e = f->open(&r, path, &head, &count, &cut, &d);
    T_EQ_S(d.text, "");
    if (e != PVX_OK)
        return;
    T_EQ_I(count, n);
    T_OK(!cut);
    T_EQ_S(head.rig, b->head.rig);
    T_OK(head.config == NULL);
    T_OK(pvp_grid_same(&head.start.grid, &b->head.start.grid));
    T_EQ_I(head.start.rig_hash, b->head.start.rig_hash);
    T_EQ_S(head.start.units, "1/m");
    for (uint64_t k = 0; k < count; k++) {
        T_EQ_I(f->get(r, k, &got, &d), PVX_OK);
        T_OK(volumes_same(&got,
                          volume_bed_make(b, first + k, T0 + (int64_t)(first + k) * 50000000)));
    }
    f->close(r);
}

static const struct format {
    const char *end;
    const struct vol_writer_ops *writer;
    const struct vol_reader_ops *reader;
} formats[] = {{"vdb", &vol_vdb_writer, &vol_vdb_reader},
               {"nvdb", &vol_nvdb_writer, &vol_nvdb_reader}};

T_CASE(comes_out_again) /* every layout */
{
    for (int layout = 0; layout < 16; layout++) {
        const struct format *f = &formats[layout >> 3];
        struct volume_bed b;
        volume_bed_new(&b, 19, 25, 9, layout & 4 ? 1 : 3, (uint32_t)layout & 1);
        struct vol_options o = {
            .split = (layout & 1) != 0, .y_up = (layout & 2) != 0, .unit_m = layout & 2 ? 0.01 : 0};
        record(&b, f->writer, at("again%d", layout), &o, 5, 3, NULL);
        reread(&b, f->reader, at("again%d", layout), 5, 3);
        volume_bed_free(&b);
    }
}

T_CASE(nothing_burns) /* a volume without a brick */
{
    for (int k = 0; k < 2; k++) {
        struct volume_bed b;
        void *w = NULL, *r = NULL;
        struct vol_head head;
        struct vol_volume got;
        uint64_t count;
        bool cut;
        volume_bed_new(&b, 19, 25, 9, 3, 0);
        volume_bed_make(&b, 0, T0);
        b.v.n_bricks = 0;
        d = (struct pvx_diag){""};
        T_EQ_I(formats[k].writer->open(&w, at("dark%d", k), &b.head, &(struct vol_options){0}, &d),
               PVX_OK);
        T_EQ_I(formats[k].writer->put(w, &b.v, &d), PVX_OK);
        T_EQ_I(formats[k].writer->close(w, &d), PVX_OK);
        T_EQ_I(formats[k].reader->open(&r, at("dark%d", k), &head, &count, &cut, &d), PVX_OK);
        if (r != NULL) {
            T_EQ_I(formats[k].reader->get(r, 0, &got, &d), PVX_OK);
            T_OK(volumes_same(&got, &b.v));
            formats[k].reader->close(r);
        }
        T_EQ_S(d.text, "");
        volume_bed_free(&b);
    }
}

T_CASE(numbers_have_no_holes)
{
    struct volume_bed b;
    volume_bed_new(&b, 8, 8, 8, 1, 0);
    record(&b, &vol_vdb_writer, at("holes"), &(struct vol_options){0}, 100, 8,
           (const uint64_t[]){102, 103, 106, 0});
    char *text, *a, *c;
    size_t n, na, nc;
    for (int f = 1; f <= 8; f++)
        T_OK(there(at("holes/holes_%04d.vdb", f)));
    T_OK(!there(at("holes/holes_0009.vdb")));
    if (pvx_file_read(at("holes/holes_0002.vdb"), 1 << 20, &a, &na, NULL) == PVX_OK &&
        pvx_file_read(at("holes/holes_0004.vdb"), 1 << 20, &c, &nc, NULL) == PVX_OK) {
        T_OK(na == nc && memcmp(a, c, na) == 0);
        free(a);
        free(c);
    }
    if (pvx_file_read(at("holes/holes.json"), 1 << 20, &text, &n, NULL) == PVX_OK) {
        T_CONTAINS(text, "\"frames\":8");
        T_CONTAINS(text, "\"frame\":2,\"repeated\":2,\"set\":101");
        free(text);
    } else {
        T_OK(!"listed");
    }
    void *r = NULL;
    struct vol_head head;
    uint64_t count = 0;
    bool cut;
    if (vol_vdb_reader.open(&r, at("holes"), &head, &count, &cut, &d) == PVX_OK) {
        T_EQ_I(count, 5);
        const struct vol_gap *g = vol_vdb_reader.gap(r, 0);
        T_OK(g != NULL && g->set_first == 102 && g->set_last == 103);
        g = vol_vdb_reader.gap(r, 1);
        T_OK(g != NULL && g->set_first == 106 && g->set_last == 106);
        T_OK(vol_vdb_reader.gap(r, 2) == NULL);
        vol_vdb_reader.close(r);
    }
    volume_bed_free(&b);
}

T_CASE(large_numbers) /* nanoseconds as numbers: a double takes these for one */
{
    struct volume_bed b;
    void *w = NULL;
    volume_bed_new(&b, 8, 8, 8, 1, 0);
    T_EQ_I(vol_vdb_writer.open(&w, at("large"), &b.head, &(struct vol_options){0}, &d), PVX_OK);
    for (uint64_t k = 1; k <= 3; k++)
        T_EQ_I(vol_vdb_writer.put(w, volume_bed_make(&b, 2026112713451200000u + k, T0 + (int64_t)k),
                                  &d),
               PVX_OK);
    T_EQ_I(vol_vdb_writer.close(w, &d), PVX_OK);
    T_OK(there(at("large/large_0003.vdb")) && !there(at("large/large_0004.vdb")));
    volume_bed_free(&b);
}

T_CASE(resampled) /* 20 sets/s as 10 files, as 40 */
{
    struct volume_bed b;
    volume_bed_new(&b, 8, 8, 8, 1, 0);
    record(&b, &vol_vdb_writer, at("slow"), &(struct vol_options){.fps = 10}, 0, 9, NULL);
    T_OK(there(at("slow/slow_0005.vdb")) && !there(at("slow/slow_0006.vdb")));
    record(&b, &vol_vdb_writer, at("fast"), &(struct vol_options){.fps = 40}, 0, 9, NULL);
    T_OK(there(at("fast/fast_0017.vdb")) && !there(at("fast/fast_0018.vdb")));
    volume_bed_free(&b);
}

T_CASE(clock_set_back_goes_on) /* by an hour, resampled: not an hour of volumes is left out */
{
    struct volume_bed b;
    void *w = NULL;
    volume_bed_new(&b, 8, 8, 8, 1, 0);
    T_EQ_I(vol_vdb_writer.open(&w, at("back"), &b.head, &(struct vol_options){.fps = 20}, &d),
           PVX_OK);
    for (uint64_t s = 0; s < 8; s++) {
        int64_t t = T0 + (int64_t)s * 50000000 - (s < 4 ? 0 : INT64_C(3600000000000));
        T_EQ_I(vol_vdb_writer.put(w, volume_bed_make(&b, s, t), &d), PVX_OK);
    }
    T_EQ_I(vol_vdb_writer.close(w, &d), PVX_OK);
    T_OK(there(at("back/back_0008.vdb")) && !there(at("back/back_0009.vdb")));
    volume_bed_free(&b);
}

T_CASE(another_session_goes_on)
{
    struct volume_bed b;
    void *w = NULL;
    volume_bed_new(&b, 8, 8, 8, 1, 0);
    T_EQ_I(vol_vdb_writer.open(&w, at("two"), &b.head, &(struct vol_options){0}, &d), PVX_OK);
    T_EQ_I(vol_vdb_writer.put(w, volume_bed_make(&b, 1000, T0), &d), PVX_OK);
    b.head.start.session++;
    T_EQ_I(vol_vdb_writer.put(w, volume_bed_make(&b, 0, T0), &d), PVX_OK);
    T_EQ_I(vol_vdb_writer.put(w, volume_bed_make(&b, UINT64_MAX, T0), &d),
           PVX_OK); /* too long a hole */
    T_EQ_I(vol_vdb_writer.close(w, &d), PVX_OK);
    T_OK(there(at("two/two_0003.vdb")) && !there(at("two/two_0004.vdb")));
    volume_bed_free(&b);
}

T_CASE(writes_over_nothing)
{
    struct volume_bed b;
    void *w = NULL;
    volume_bed_new(&b, 8, 8, 8, 1, 0);
    d = (struct pvx_diag){""};
    T_EQ_I(pvx_mkdirs(at("mine"), &d), PVX_OK);
    T_EQ_I(pvx_file_write(at("mine/thesis"), "x", 1, &d), PVX_OK);
    T_EQ_I(vol_vdb_writer.open(&w, at("mine"), &b.head, &(struct vol_options){0}, &d), PVX_EBUSY);
    T_CONTAINS(d.text, "mine: there is something in it");
    d = (struct pvx_diag){""};
    vol_writer *all = NULL;
    T_EQ_I(vol_writer_open(VOL_VDB, at("full"), &b.head,
                           &(struct vol_options){.keep_free_bytes = UINT64_MAX / 2}, &all, &d),
           PVX_OK);
    T_EQ_I(vol_writer_put(all, volume_bed_make(&b, 0, T0), &d), PVX_ENOSPC);
    T_CONTAINS(d.text, "kept free");
    T_EQ_I(vol_writer_close(&all, NULL), PVX_OK);
    volume_bed_free(&b);
}

T_CASE(halves_are_finite) /* beyond what a half holds, beside the smallest */
{
    struct volume_bed b;
    void *w = NULL;
    vol_writer *all = NULL;
    struct vol_head head;
    struct vol_volume got;
    uint64_t count;
    bool cut;
    volume_bed_new(&b, 8, 8, 8, 1, 0);
    volume_bed_make(&b, 0, T0);
    T_OK(!b.v.clamped && !vol_beyond(VOL_VDB, &b.v));
    b.brick[0] = 1e30f;
    b.brick[1] = -1e30f;
    b.brick[2] = 65519.9f;
    b.brick[3] = 0x1p-24f;
    T_OK(vol_beyond(VOL_VDB, &b.v) && !vol_beyond(VOL_NVDB, &b.v));
    T_EQ_I(vol_writer_open(VOL_VDB, at("big"), &b.head, NULL, &all, &d), PVX_OK);
    T_EQ_I(vol_writer_put(all, &b.v, &d), PVX_OK);
    T_EQ_I(vol_writer_close(&all, &d), PVX_OK);
    if (vol_vdb_reader.open(&w, at("big/big_0001.vdb"), &head, &count, &cut, &d) == PVX_OK) {
        T_EQ_I(vol_vdb_reader.get(w, 0, &got, &d), PVX_OK);
        T_OK(got.clamped);
        T_OK(got.brick[0] == 65504 && got.brick[1] == -65504 && got.brick[2] == 65504 &&
             got.brick[3] == 0x1p-24f);
        vol_vdb_reader.close(w);
    }
    volume_bed_free(&b);
}

/* A file of which some bytes are wrong is read or refused. */
static void try_damaged(const struct format *f, const char *bytes, size_t n)
{
    void *r = NULL;
    struct vol_head head;
    struct vol_volume v;
    uint64_t count;
    bool cut;
    char path[512];
    snprintf(path, sizeof path, "%s", at("damaged.%s", f->end));
    d = (struct pvx_diag){""};
    T_EQ_I(pvx_file_write(path, bytes, n, &d), PVX_OK);
    if (f->reader->open(&r, path, &head, &count, &cut, &d) == PVX_OK) {
        if (f->reader->get(r, 0, &v, &d) != PVX_OK)
            T_CONTAINS(d.text, path);
        f->reader->close(r);
    } else {
        T_CONTAINS(d.text, path);
    }
}

#ifdef __SANITIZE_ADDRESS__ /* each is a fork of a process with a shadow: a tenth of them */
#define CUTS    15
#define CHANGES 60
#else
#define CUTS    150
#define CHANGES 600
#endif

static bool same_files(const char *a, const char *b)
{
    char *x = NULL, *y = NULL;
    size_t n = 0, m = 1;
    bool same = pvx_file_read(a, 1 << 24, &x, &n, NULL) == PVX_OK &&
                pvx_file_read(b, 1 << 24, &y, &m, NULL) == PVX_OK && n == m && memcmp(x, y, n) == 0;
    free(x);
    free(y);
    return same;
}

/* Sets 0 to 4, of which file 3 is cut off at `share`; then the list too is as a kill leaves it. */
static void repair_one(const struct format *f, double share)
{
    struct volume_bed b;
    struct vol_repaired fixed;
    uint64_t count = 0;
    bool cut;
    char folder[300], third[400], *bytes;
    size_t n;
    void *r = NULL;
    struct vol_head head;
    snprintf(folder, sizeof folder, "%s", at("cut%d_%s", (int)(share * 1000), f->end));
    snprintf(third, sizeof third, "%s/cut%d_%s_0003.%s", folder, (int)(share * 1000), f->end,
             f->end);
    volume_bed_new(&b, 19, 25, 9, 3, 0);
    record(&b, f->writer, folder, &(struct vol_options){0}, 0, 5, NULL);
    volume_bed_free(&b);
    d = (struct pvx_diag){""};
    T_EQ_I(vol_repair_folder(folder, &fixed, &d), PVX_OK);
    T_OK(!fixed.done && fixed.good == 5 && fixed.bad == 0);
    T_EQ_I(pvx_file_read(third, 1 << 24, &bytes, &n, NULL), PVX_OK);
    T_EQ_I(pvx_file_write(third, bytes, (size_t)((double)n * share), NULL), PVX_OK);
    free(bytes);
    T_EQ_I(vol_repair_folder(folder, &fixed, &d), PVX_OK);
    T_EQ_S(d.text, "");
    T_OK(fixed.done && fixed.good == 4 && fixed.bad == 1);
    T_OK(there(at("cut%d_%s/cut%d_%s_0003.%s.cut-off", (int)(share * 1000), f->end,
                  (int)(share * 1000), f->end, f->end)));
    T_OK(same_files(third, at("cut%d_%s/cut%d_%s_0002.%s", (int)(share * 1000), f->end,
                              (int)(share * 1000), f->end, f->end)));
    T_EQ_I(f->reader->open(&r, folder, &head, &count, &cut, &d), PVX_OK);
    if (r != NULL) {
        const struct vol_gap *g = f->reader->gap(r, 0);
        T_OK(count == 4 && !cut && g != NULL && g->set_first == 2 && g->set_last == 2);
        f->reader->close(r);
    }
    T_EQ_I(vol_repair_folder(folder, &fixed, &d), PVX_OK);
    T_OK(!fixed.done && fixed.good == 5 && fixed.bad == 0);
}

T_CASE(cut_anywhere_and_repaired)
{
    for (int k = 0; k < 2; k++)
        for (int i = 0; i < 10; i++)
            repair_one(&formats[k], i / 10.0);
}

T_CASE(list_of_a_killed_recorder_is_made_anew)
{
    struct volume_bed b;
    struct vol_repaired fixed;
    char *text;
    size_t n;
    const uint64_t skip[] = {103, 104, 0};
    struct vol_options o = {.y_up = true, .unit_m = 0.01};
    volume_bed_new(&b, 8, 8, 8, 1, 0);
    record(&b, &vol_vdb_writer, at("killed"), &o, 100, 8, skip);
    T_EQ_I(rename(at("killed/killed.json"), at("list")), 0);
    T_EQ_I(vol_repair_folder(at("killed"), &fixed, &d), PVX_OK);
    T_OK(fixed.done && fixed.good == 8 && fixed.bad == 0);
    T_EQ_I(pvx_file_read(at("killed/killed.json"), 1 << 20, &text, &n, NULL), PVX_OK);
    T_CONTAINS(text, "\"gaps\":[{\"why\":\"lost\",\"set_first\":103,\"set_last\":104,");
    char *gaps = strstr(text, "\"gaps\""), *was;
    *gaps = '\0'; /* the writer is told of gaps, and was not */
    T_EQ_I(pvx_file_read(at("list"), 1 << 20, &was, &n, NULL), PVX_OK);
    *strstr(was, "\"gaps\"") = '\0';
    T_EQ_S(text, was);
    free(text);
    free(was);
    volume_bed_free(&b);
}

static void damage(const struct format *f)
{
    struct volume_bed b;
    char *bytes;
    size_t n;
    volume_bed_new(&b, 19, 25, 9, 3, 0);
    record(&b, f->writer, at("whole_%s", f->end), &(struct vol_options){0}, 0, 1, NULL);
    volume_bed_free(&b);
    if (pvx_file_read(at("whole_%s/whole_%s_0001.%s", f->end, f->end, f->end), 1 << 24, &bytes, &n,
                      NULL) != PVX_OK) {
        T_OK(!"written");
        return;
    }
    for (int i = 0; i < CUTS; i++)
        try_damaged(f, bytes, t_rand() % n);
    for (int i = 0; i < CHANGES; i++) {
        size_t where[3];
        char was[3];
        for (int k = 0; k < 3; k++) {
            where[k] = t_rand() % (i % 3 == 0 ? n : n < 6000 ? n : 6000);
            was[k] = bytes[where[k]];
            bytes[where[k]] = (char)t_rand();
        }
        try_damaged(f, bytes, n);
        for (int k = 2; k >= 0; k--)
            bytes[where[k]] = was[k];
    }
    free(bytes);
}

T_CASE(damaged_files)
{
    damage(&formats[0]);
}

T_CASE(damaged_nanovdb_files)
{
    damage(&formats[1]);
}

/* ---- the system tests' writer ------------------------------------------------------------------- */

static int write_all(void)
{
    for (int layout = 0; layout < 16; layout++) {
        struct volume_bed b;
        volume_bed_new(&b, 19, 25, 9, layout & 8 ? 1 : 3, (uint32_t)layout & 1);
        struct vol_options o = {
            .split = (layout & 2) != 0, .y_up = (layout & 4) != 0, .unit_m = layout & 4 ? 0.01 : 1};
        record(&b, &vol_vdb_writer, at("v%d", layout), &o, 3, 2, NULL);
        record(&b, &vol_nvdb_writer, at("n%d", layout), &o, 3, 2, NULL);
        volume_bed_free(&b);
    }
    return t_case_fails > 0;
}

static int write_on(void)
{
    struct volume_bed b;
    void *w = NULL;
    volume_bed_new(&b, 40, 40, 40, 3, 0);
    if (vol_vdb_writer.open(&w, at("endless"), &b.head, &(struct vol_options){0}, &d) != PVX_OK)
        return 1;
    for (uint64_t s = 0; vol_vdb_writer.put(w, volume_bed_make(&b, s, T0), &d) == PVX_OK; s += 2)
        continue;
    return 1;
}

int main(int argc, char **argv)
{
    plugins_of_this_build();
    if (argc == 3) {
        snprintf(dir, sizeof dir, "%s", argv[2]);
        return strcmp(argv[1], "--write") == 0 ? write_all() : write_on();
    }
#ifdef __SANITIZE_THREAD__
    t_skip_all = "OpenVDB's threads (TBB) are not instrumented";
#endif
    scratch_new();
    t_run();
    scratch_remove();
    return t_done();
}
