/* test_take_rolled.c - the files of a recording that rolled over are one take; what is missing, damaged or not of it is
 * said. */
#include "../t.h"

#include <dirent.h>
#include <hdf5.h>
#include <unistd.h>

#include "base/clock.h"
#include "capture/source/backends.h"
#include "capture/take/take.h"
#include "tests/lib/box.h"
#include "tests/lib/scratch.h"
#include "tests/lib/take.h"
#include "tests/lib/take_open.h"

#define CAMERAS 2
#define WIDTH   8
#define HEIGHT  6
#define PER     4 /* sets of a file */

static const struct cap_take_camera cameras[CAMERAS] = {{.name = "a"}, {.name = "b"}};
static struct cap_take_head head;

static void no_release(struct cap_frame *f)
{
    (void)f;
}

/* File k of the recording, from 1. */
static const char *file(unsigned k)
{
    return k == 1 ? at("night.h5") : at("night-%04u.h5", k);
}

static cap_take_writer *begin(unsigned k)
{
    struct pvx_diag d = {""};
    cap_take_writer *w = NULL;
    head.t_began_ns = 1;
    head.t_created_ns = k;
    T_CHECK_(cap_take_create(file(k), &head, &w, &d) == PVX_OK, "%s", d.text);
    return w;
}

/* Of `width` pixels camera 0, camera 1 not at all where that is 0. */
static void put(cap_take_writer *w, uint64_t number, int32_t width0, int32_t width1)
{
    unsigned char px[CAMERAS][4 * WIDTH * HEIGHT];
    struct cap_frame f[CAMERAS];
    struct cap_set s = {.number = number,
                        .t_exposure_ns = (int64_t)number * PVX_NS_PER_MS,
                        .t_last_mono_ns = (int64_t)number * PVX_NS_PER_MS};
    const int32_t width[CAMERAS] = {width0, width1};
    for (uint32_t c = 0; c < CAMERAS; c++) {
        memset(px[c], (int)(number * CAMERAS + c), sizeof px[c]);
        f[c] = (struct cap_frame){
            .img = {px[c], (size_t)width[c] * HEIGHT, width[c], HEIGHT, width[c], CAP_GREY8, 0},
            .camera = c,
            .id = number,
            .t_exposure_ns = s.t_exposure_ns,
            .t_arrival_mono_ns = s.t_last_mono_ns,
            .release = no_release};
        if (width[c] > 0) {
            s.frame[c] = &f[c];
            s.n++;
        }
    }
    T_EQ_I(cap_take_put_set(w, &s, NULL), PVX_OK);
}

static void end(cap_take_writer *w, bool goes_on)
{
    if (goes_on)
        cap_take_goes_on(w);
    T_EQ_I(cap_take_close(&w, NULL), PVX_OK);
}

/* File k with its sets, and a gap. */
static void write_file(unsigned k, bool goes_on)
{
    cap_take_writer *w = begin(k);
    for (uint64_t i = 0; i < PER; i++)
        put(w, (k - 1) * PER + i, WIDTH, 2 * WIDTH);
    const struct cap_take_gap g = {.camera = 1, .why = CAP_TAKE_QUEUE, .frames = k};
    T_EQ_I(cap_take_put_gap(w, &g, NULL), PVX_OK);
    end(w, goes_on);
}

static void record(unsigned files)
{
    remove_all(dir);
    scratch_new();
    head = take_head(cameras, CAMERAS);
    for (unsigned k = 1; k <= files; k++)
        write_file(k, k < files);
}

/* A frame is the one of its set. */
static bool is_right(const cap_take *t, uint32_t c, int64_t row, uint64_t number)
{
    unsigned char mem[4 * WIDTH * HEIGHT];
    struct cap_image img;
    return cap_take_row(t, c, (uint64_t)row)->id == number &&
           cap_take_read(t, c, (uint64_t)row, mem, sizeof mem, &img, NULL) == PVX_OK &&
           mem[0] == (unsigned char)(number * CAMERAS + c) && mem[img.size - 1] == mem[0];
}

/* All sets have the cameras of their mask, and the right pixels. */
static void check_sets(const cap_take *t)
{
    for (uint64_t k = 0; k < cap_take_info(t)->sets; k++) {
        const int64_t *member;
        const struct cap_take_set *s = cap_take_set(t, k, &member);
        T_EQ_I(cap_take_find_set(t, (int64_t)s->number), k);
        for (uint32_t c = 0; c < CAMERAS; c++) {
            T_EQ_I(member[c] >= 0, s->mask >> c & 1);
            T_OK(member[c] < 0 || is_right(t, c, member[c], s->number));
        }
    }
}

static void check_notes(const cap_take *t, const char *const *part, uint64_t n)
{
    T_EQ_I(cap_take_info(t)->notes, n);
    for (uint64_t k = 0; k < n && k < cap_take_info(t)->notes; k++)
        T_CONTAINS(cap_take_note(t, k), part[k]);
}
#define NOTES(t, ...)                                  \
    check_notes(t, (const char *const[]){__VA_ARGS__}, \
                sizeof((const char *const[]){__VA_ARGS__}) / sizeof(char *))

T_CASE(files_are_one_take)
{
    record(3);
    cap_take *t = open_take(file(1));
    const struct cap_take_info *i = cap_take_info(t);
    T_OK(i->closed);
    T_EQ_I(i->pieces, 3);
    T_EQ_I(i->sets, 3 * PER);
    T_EQ_I(i->sets_lost, 0);
    T_EQ_I(i->notes, 0);
    T_EQ_I(i->head.camera[1].frames, 3 * PER);
    T_EQ_I(cap_take_frame_max(t, 1), 2 * WIDTH * HEIGHT);
    T_EQ_I(i->gaps, 3);
    for (unsigned k = 0; k < 3; k++) {
        struct cap_take_piece p = cap_take_piece(t, k);
        T_EQ_S(p.path, file(k + 1));
        T_EQ_I(p.first, k * PER);
        T_EQ_I(p.sets, PER);
        T_OK(p.closed);
        T_EQ_I(cap_take_gap(t, k)->frames, k + 1);
    }
    for (uint64_t k = 0; k < i->sets; k++)
        T_EQ_I(cap_take_set(t, k, NULL)->number, k);
    check_sets(t);
    T_EQ_I(cap_take_find_set(t, 3 * PER), -1);
    cap_take_only(t, PER, PER + 1); /* what is left is as it was */
    for (uint64_t k = PER; k < 2 * PER; k++)
        T_OK(is_right(t, 0, (int64_t)k, k));
    T_EQ_I(cap_take_find_set(t, 3 * PER - 1), 3 * PER - 1);
    cap_take_free(&t);
}

T_CASE(a_later_file_is_itself_alone)
{
    record(3);
    cap_take *t = open_take(file(2));
    T_EQ_I(cap_take_info(t)->sets, PER);
    T_OK(cap_take_info(t)->closed);
    T_EQ_I(cap_take_info(t)->notes, 0);
    check_sets(t);
    cap_take_free(&t);
    T_EQ_I(rename(file(2), at("x.h5")), 0); /* whatever it is called */
    T_EQ_I(rename(file(3), at("x-0002.h5")), 0);
    t = open_take(at("x.h5"));
    T_EQ_I(cap_take_info(t)->pieces, 1);
    cap_take_free(&t);
}

T_CASE(a_link_leads_to_all)
{
    record(2);
    T_EQ_I(symlink(file(1), at("tonight")), 0);
    cap_take *t = open_take(at("tonight"));
    T_EQ_I(cap_take_info(t)->sets, 2 * PER);
    check_sets(t);
    cap_take_free(&t);
}

T_CASE(missing_files_are_said)
{
    record(6);
    unlink(file(3));
    unlink(file(4));
    unlink(file(6));
    cap_take *t = open_take(file(1));
    const struct cap_take_info *i = cap_take_info(t);
    T_EQ_I(i->pieces, 3);
    T_EQ_I(i->sets, 3 * PER);
    T_EQ_I(i->sets_lost, 2 * PER);
    T_OK(!i->closed);
    NOTES(t, "night-0004.h5: are missing", "night-0005.h5: sets 8 to 15, before it, are lost",
          "night-0006.h5: is missing");
    check_sets(t);
    cap_take_free(&t);
}

static void damage(const char *name)
{
    T_EQ_I(truncate(name, 1000), 0);
}

T_CASE(damaged_files_are_said)
{
    record(4);
    damage(file(2));
    cap_take *t = open_take(file(1));
    T_EQ_I(cap_take_info(t)->sets, 3 * PER);
    T_EQ_I(cap_take_info(t)->sets_lost, PER);
    T_OK(cap_take_info(t)->closed);
    NOTES(t, "night-0002.h5: is not a take of raw frames, or damaged",
          "night-0003.h5: sets 4 to 7, before it, are lost");
    check_sets(t);
    cap_take_free(&t);

    damage(file(1));
    damage(file(4));
    t = open_take(file(1));
    T_EQ_I(cap_take_info(t)->sets, PER);
    T_OK(!cap_take_info(t)->closed);
    NOTES(t, "night.h5: is not a take", "night-0002.h5: is not a take", "night-0004.h5: is not");
    check_sets(t);
    cap_take_free(&t);

    damage(file(3));
    struct pvx_diag d = {""};
    T_EQ_I(cap_take_open(file(1), &t, &d), PVX_EFORMAT);
    T_CONTAINS(d.text, "night.h5: ");
}

/* As it is while the last file is written, and when its daemon was killed. */
T_CASE(the_last_file_is_being_written)
{
    record(1);
    unlink(file(1));
    write_file(1, true);
    cap_take_writer *w = begin(2);
    put(w, PER, WIDTH, 2 * WIDTH);
    T_EQ_I(cap_take_commit(w, NULL), PVX_OK);
    cap_take *t = open_take(file(1));
    T_EQ_I(cap_take_info(t)->sets, PER + 1);
    T_OK(!cap_take_info(t)->closed);
    NOTES(t, "night-0002.h5: was cut off, or is being recorded: 1 complete sets");
    cap_take_free(&t);
    end(w, false);
    t = open_take(file(1));
    T_OK(cap_take_info(t)->closed);
    cap_take_free(&t);
}

T_CASE(a_file_in_the_middle_was_cut_off)
{
    record(3);
    hid_t f = H5Fopen(file(2), H5F_ACC_RDWR, H5P_DEFAULT), a = H5Aopen(f, "closed", H5P_DEFAULT);
    int64_t no = 0;
    T_OK(H5Awrite(a, H5T_NATIVE_INT64, &no) >= 0);
    H5Aclose(a);
    H5Fclose(f);
    cap_take *t = open_take(file(1));
    T_OK(cap_take_info(t)->closed); /* it grows no more */
    NOTES(t, "night-0002.h5: was cut off: 4 complete sets, 0 lost");
    cap_take_free(&t);
}

/* Its name alone makes no file one of the recording. */
T_CASE(what_is_not_of_it_is_left_out)
{
    static const struct cap_take_camera others[CAMERAS] = {{.name = "a"}, {.name = "c"}};
    record(3);
    unlink(file(2));
    head.session = 7;
    write_file(2, false);
    head.session = 0;
    head.camera = others;
    write_file(4, false);
    head.camera = cameras;
    head.rig = "another";
    write_file(5, false);
    head.rig = "rig";
    cap_take_writer *w = begin(6);
    put(w, 1, WIDTH, WIDTH);
    end(w, false);
    cap_take *t = open_take(file(1));
    T_EQ_I(cap_take_info(t)->sets, 2 * PER);
    T_EQ_I(cap_take_info(t)->sets_lost, PER);
    T_OK(cap_take_info(t)->closed);
    NOTES(t, "night-0002.h5: is of another recording", "night-0003.h5: sets 4 to 7, before it",
          "night-0004.h5: has other cameras", "night-0005.h5: has other cameras or another rig",
          "night-0006.h5: has sets that do not go on");
    check_sets(t);
    cap_take_free(&t);
}

T_CASE(names_that_only_look_alike_are_not_read)
{
    static const char *const name[] = {"night-02.h5",     "night-00002.h5", "night-0002.h5.old",
                                       "night-0001.h5",   "night-0000.h5",  "night-.h5",
                                       "night-0002-2.h5", "xnight-0002.h5", "night-99999999999.h5"};
    record(1);
    for (size_t k = 0; k < sizeof name / sizeof *name; k++)
        fclose(fopen(at("%s", name[k]), "w"));
    cap_take *t = open_take(file(1));
    T_EQ_I(cap_take_info(t)->notes, 0);
    cap_take_free(&t);
}

/* Takes of earlier versions say neither when their recording began nor that it goes on. */
T_CASE(older_files_are_one_take)
{
    record(3);
    for (unsigned k = 1; k <= 3; k++) {
        hid_t f = H5Fopen(file(k), H5F_ACC_RDWR, H5P_DEFAULT);
        T_OK(H5Adelete(f, "t_began_ns") >= 0 && H5Adelete(f, "goes_on") >= 0);
        H5Fclose(f);
    }
    cap_take *t = open_take(file(1));
    T_EQ_I(cap_take_info(t)->sets, 3 * PER);
    T_OK(cap_take_info(t)->closed);
    T_EQ_I(cap_take_info(t)->notes, 0);
    check_sets(t);
    cap_take_free(&t);
}

T_CASE(a_camera_comes_in_a_later_file_and_one_changes)
{
    record(0);
    cap_take_writer *w = begin(1);
    put(w, 0, WIDTH, 0);
    end(w, true);
    w = begin(2);
    cap_take_about(w, 1, "SN2", 40);
    put(w, 1, 2 * WIDTH, WIDTH); /* a was set to another size */
    put(w, 2, 2 * WIDTH, WIDTH);
    end(w, true);
    w = begin(3);
    put(w, 3, WIDTH, WIDTH);
    end(w, false);
    cap_take *t = open_take(file(1));
    const struct cap_take_info *i = cap_take_info(t);
    T_EQ_I(i->sets, 4);
    T_EQ_I(i->head.camera[0].width, WIDTH);
    T_EQ_I(i->head.camera[0].frames, 2);
    T_EQ_I(cap_take_frame_max(t, 0), WIDTH * HEIGHT);
    T_EQ_I(i->head.camera[1].width, WIDTH);
    T_EQ_I(i->head.camera[1].frames, 3);
    T_EQ_S(i->head.camera[1].serial, "SN2");
    T_NEAR(i->head.camera[1].temperature_c, 40, 0);
    static const uint64_t mask[] = {1, 2, 2, 3};
    for (uint64_t k = 0; k < 4; k++) {
        T_EQ_I(cap_take_set(t, k, NULL)->mask, mask[k]);
        T_EQ_I(cap_take_set(t, k, NULL)->n, k == 3 ? 2 : 1);
    }
    T_EQ_I(i->gaps, 1);
    T_EQ_I(cap_take_gap(t, 0)->why, CAP_TAKE_UNFIT);
    T_EQ_I(cap_take_gap(t, 0)->frames, 2);
    T_EQ_I(cap_take_gap(t, 0)->set_last, 2);
    NOTES(t, "2 frames of camera a are left out: Mono8, 16x6 there, Mono8, 8x6 before");
    check_sets(t);
    cap_take_free(&t);
}

static unsigned files_open(void)
{
    unsigned n = 0;
    char name[300], to[300];
    DIR *d = opendir("/proc/self/fd");
    for (struct dirent *f; (f = readdir(d)) != NULL;) {
        snprintf(name, sizeof name, "/proc/self/fd/%s", f->d_name);
        ssize_t len = readlink(name, to, sizeof to - 1);
        to[len > 0 ? len : 0] = '\0';
        n += strstr(to, "/night") != NULL;
    }
    closedir(d);
    return n;
}

/* A night of minutes is more files than a process may open. */
T_CASE(few_files_are_open_at_a_time)
{
    enum { FILES = 30 };
    record(FILES);
    cap_take *t = open_take(file(1));
    T_EQ_I(cap_take_info(t)->pieces, FILES);
    check_sets(t);
    for (uint64_t k = FILES * PER; k-- > 0;)
        T_OK(is_right(t, k & 1, (int64_t)k, k));
    T_LE(files_open(), 10);
    unlink(file(1)); /* one that is not open any more */
    unsigned char mem[4 * WIDTH * HEIGHT];
    struct cap_image img;
    struct pvx_diag d = {""};
    for (uint64_t k = FILES * PER; k-- > FILES * PER / 2;)
        T_OK(is_right(t, 0, (int64_t)k, k));
    T_EQ_I(cap_take_read(t, 0, 0, mem, sizeof mem, &img, &d), PVX_ECORRUPT);
    T_CONTAINS(d.text, "night.h5: camera a");
    cap_take_only(t, FILES * PER - 1, FILES * PER);
    T_OK(is_right(t, 0, FILES * PER - 1, FILES * PER - 1));
    T_LE(files_open(), 1);
    cap_take_free(&t);
}

T_CASE(all_of_it_is_played)
{
    static struct box box = BOX_EMPTY;
    struct pvx_diag d = {""};
    record(3);
    struct cap_source_config c = {
        .uri = file(1), .name = "b", .buffers = 3 * PER, .lossless = true};
    struct cap_sink sink = SINK_OF(&box);
    cap_source *src = NULL;
    keep_box(&box, true);
    T_EQ_I(cap_source_take.open(&c, &src, &d), PVX_OK);
    T_EQ_I(cap_source_take.start(src, &sink, &d), PVX_OK);
    T_OK(wait_count(&box, &box.ended, 1));
    cap_source_take.stop(src);
    T_EQ_I(box.n, 3 * PER);
    for (unsigned k = 0; k < box.n_held; k++)
        T_EQ_I(box.held[k]->id, k);
    empty_box(&box);
    cap_source_take.close(&src);
}

T_MAIN(scratch_new(), scratch_remove())
