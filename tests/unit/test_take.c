/* test_take.c - takes: what is recorded comes back bit for bit, in every pixel format; what is cut off or
 * wrong is said, and never read past. */
#include "../t.h"

#include <fcntl.h>
#include <hdf5.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "base/clock.h"
#include "capture/rig/capture.h"
#include "capture/source/backends.h"
#include "capture/take/h5.h"
#include "tests/lib/box.h"
#include "tests/lib/patience.h"
#include "tests/lib/scratch.h"
#include "tests/lib/take_open.h"

static char path[96], copy[96];

static void no_release(struct cap_frame *f)
{
    (void)f;
}

/* ---- frames that anybody can make again ---- */

static uint64_t mix(uint64_t x)
{
    x ^= x >> 33;
    x *= 0xff51afd7ed558ccdu;
    x ^= x >> 33;
    return x * 0xc4ceb9fe1a85ec53u;
}

struct made {
    struct cap_frame f;
    unsigned char *mem;
};

static size_t jpeg_bytes(uint32_t camera, uint64_t id)
{
    return 1 + mix(camera * 1000 + id) % 300;
}

static struct made make(enum cap_pixfmt fmt, int32_t w, int32_t h, size_t padding, uint32_t camera,
                        uint64_t id)
{
    struct made m = {0};
    size_t row = cap_pixfmt_row(fmt, w), stride = row > 0 ? row + padding : 0;
    size_t bytes = row > 0 ? stride * (size_t)h : jpeg_bytes(camera, id);
    m.mem = malloc(bytes);
    for (size_t i = 0; i < bytes; i++)
        m.mem[i] = (unsigned char)mix(camera * 7919 + id * 104729 + i);
    m.f = (struct cap_frame){.img = {.data = m.mem,
                                     .size = bytes,
                                     .width = w,
                                     .height = h,
                                     .stride = (ptrdiff_t)stride,
                                     .fmt = fmt,
                                     .yuv = CAP_YUV_709},
                             .camera = camera,
                             .id = id,
                             .t_device_ns = (int64_t)(id * 1000 + camera),
                             .t_arrival_ns = (int64_t)(id * 1001 + camera),
                             .t_arrival_mono_ns = (int64_t)(id * 1002 + camera),
                             .t_exposure_ns = (int64_t)(id * 1003 + camera),
                             .exposure_us = (double)id,
                             .gain = NAN,
                             .release = no_release};
    return m;
}

static bool same_pixels(const struct cap_image *got, const struct cap_image *want)
{
    size_t row = cap_pixfmt_row(want->fmt, want->width);
    if (got->fmt != want->fmt || got->width != want->width || got->height != want->height ||
        got->yuv != want->yuv)
        return false;
    if (row == 0)
        return got->size == want->size && memcmp(got->data, want->data, got->size) == 0;
    for (int32_t y = 0; y < want->height; y++)
        if (memcmp((const char *)got->data + y * got->stride,
                   (const char *)want->data + y * want->stride, row) != 0)
            return false;
    return true;
}

/* ---- a take ---- */

#define CAMERAS 3

static const struct cap_take_camera cameras[CAMERAS] = {
    {.name = "cam0", .uri = "sim:", .settings = "fps: 20\n"},
    {.name = "north-2", .uri = "aravis:GV01", .settings = ""},
    {.name = "c.3", .uri = "v4l2:/dev/video0", .settings = "gain: 3\nexposure_us: 100\n"}};

static struct cap_take_head head(void)
{
    return (struct cap_take_head){.rig = "version: 1\n",
                                  .config = "fps: 20\n",
                                  .software = "test",
                                  .host = "lab",
                                  .base = "/etc",
                                  .session = 0xfedcba9876543210u,
                                  .t_created_ns = 1700000000123456789,
                                  .fps = 20,
                                  .n_cameras = CAMERAS,
                                  .camera = cameras};
}

static cap_take_writer *create(void)
{
    struct cap_take_head h = head();
    struct pvx_diag d = {""};
    cap_take_writer *w = NULL;
    unlink(path);
    pvx_err e = cap_take_create(path, &h, &w, &d);
    T_CHECK_(e == PVX_OK, "%s", pvx_diag_text(&d, e));
    return w;
}

/* Set k: all cameras, but camera 1 is missing in every fifth. */
static bool in_set(uint32_t camera, uint64_t k)
{
    return camera != 1 || k % 5 != 4;
}

static pvx_err put_set(cap_take_writer *w, enum cap_pixfmt fmt, int32_t wd, int32_t ht,
                       size_t padding, uint64_t k, struct pvx_diag *d)
{
    struct made m[CAMERAS];
    struct cap_set s = {.number = k + 10,
                        .t_exposure_ns = (int64_t)k * 1003 + 1,
                        .spread_ns = 2,
                        .t_last_mono_ns = (int64_t)k};
    for (uint32_t c = 0; c < CAMERAS; c++) {
        m[c] = make(fmt, wd, ht, padding, c, k);
        if (in_set(c, k)) {
            s.frame[c] = &m[c].f;
            s.n++;
        }
    }
    pvx_err e = cap_take_put_set(w, &s, d);
    if (e == PVX_OK)
        e = cap_take_commit(w, d);
    for (uint32_t c = 0; c < CAMERAS; c++)
        free(m[c].mem);
    return e;
}

/* m, the k-th: spent. */
static bool same_frame(const cap_take *t, uint32_t c, int64_t row, struct made m, uint64_t k)
{
    size_t size = cap_take_frame_max(t, c);
    void *mem = malloc(size);
    struct cap_image img = {0};
    const struct cap_take_row *r = cap_take_row(t, c, (uint64_t)row);
    bool ok = cap_take_read(t, c, (uint64_t)row, mem, size, &img, NULL) == PVX_OK &&
              same_pixels(&img, &m.f.img) && r->id == m.f.id && r->set == (int64_t)k + 10 &&
              r->t_device_ns == m.f.t_device_ns && r->t_arrival_ns == m.f.t_arrival_ns &&
              r->t_arrival_mono_ns == m.f.t_arrival_mono_ns &&
              r->t_exposure_ns == m.f.t_exposure_ns && r->exposure_us == m.f.exposure_us &&
              isnan(r->gain);
    free(mem);
    free(m.mem);
    return ok;
}

/* All sets of the take are as they were put; how many, -1 = one is not. */
static int64_t whole_sets(const cap_take *t, enum cap_pixfmt fmt, int32_t wd, int32_t ht,
                          size_t padding)
{
    const struct cap_take_info *info = cap_take_info(t);
    for (uint64_t i = 0; i < info->sets; i++) {
        const int64_t *member;
        const struct cap_take_set *s = cap_take_set(t, i, &member);
        uint64_t k = s->number - 10;
        if (s->spread_ns != 2 || s->t_exposure_ns != (int64_t)k * 1003 + 1)
            return -1;
        for (uint32_t c = 0; c < CAMERAS; c++)
            if ((member[c] >= 0) != in_set(c, k) ||
                (member[c] >= 0 &&
                 !same_frame(t, c, member[c], make(fmt, wd, ht, padding, c, k), k)))
                return -1;
    }
    return (int64_t)info->sets;
}

/* What has been written, closed and opened again. */
static cap_take *closed(cap_take_writer **w)
{
    struct pvx_diag d = {""};
    pvx_err e = cap_take_close(w, &d);
    T_CHECK_(e == PVX_OK, "%s", pvx_diag_text(&d, e));
    return open_take(path);
}

static void round_trip(enum cap_pixfmt fmt, int32_t wd, int32_t ht, size_t padding)
{
    struct pvx_diag d = {""};
    cap_take_writer *w = create();
    for (uint64_t k = 0; k < 9; k++)
        T_CHECK_(put_set(w, fmt, wd, ht, padding, k, &d) == PVX_OK, "%s: %s", cap_pixfmt_name(fmt),
                 d.text);
    cap_take *t = closed(&w);
    if (t == NULL)
        return;
    const struct cap_take_info *i = cap_take_info(t);
    T_OK(i->closed);
    T_EQ_I(i->sets_lost, 0);
    T_CHECK_(whole_sets(t, fmt, wd, ht, padding) == 9, "%s %dx%d+%zu: %lld sets came back",
             cap_pixfmt_name(fmt), wd, ht, padding, (long long)whole_sets(t, fmt, wd, ht, padding));
    cap_take_free(&t);
}

/* ---- who the cameras are ---- */

static void is(const struct cap_take_camera *k, const char *serial, double temperature)
{
    T_EQ_S(k->serial, serial);
    T_OK(isnan(temperature) ? isnan(k->temperature_c) : k->temperature_c == temperature);
}

T_CASE(what_cameras_say_of_themselves)
{
    struct pvx_diag d = {""};
    cap_take_writer *w = create();
    cap_take_about(w, 0, "SIM00", NAN);
    T_EQ_I(put_set(w, CAP_GREY8, 8, 6, 0, 0, &d), PVX_OK);
    cap_take_about(w, 0, "", 41.5); /* it says that later */
    cap_take_about(w, 1, "a serial number that is longer than any camera of all that there are has",
                   3);
    T_EQ_I(put_set(w, CAP_GREY8, 8, 6, 0, 1, &d), PVX_OK);
    cap_take *t = open_take(path); /* as a killed daemon would leave it */
    is(&cap_take_info(t)->head.camera[0], "SIM00", NAN);
    is(&cap_take_info(t)->head.camera[1], "", NAN);
    cap_take_free(&t);
    t = closed(&w);
    is(&cap_take_info(t)->head.camera[0], "SIM00", 41.5);
    is(&cap_take_info(t)->head.camera[1], "", 3);
    is(&cap_take_info(t)->head.camera[2], "", NAN);
    T_EQ_I(whole_sets(t, CAP_GREY8, 8, 6, 0), 2);
    cap_take_free(&t);
}

T_CASE(every_pixel_format_comes_back)
{
    for (int f = CAP_FMT_NONE + 1; f < CAP_N_FMT; f++) {
        round_trip((enum cap_pixfmt)f, 16, 6, 0);
        round_trip((enum cap_pixfmt)f, 20, 3, 12); /* rows padded */
    }
    round_trip(CAP_YUYV, 7, 5, 0);
    round_trip(CAP_GREY8, 1, 1, 0);
    round_trip(CAP_GREY12P, 3, 1, 5);
}

T_CASE(head_comes_back)
{
    struct pvx_diag d = {""};
    cap_take_writer *w = create();
    T_EQ_I(put_set(w, CAP_GREY8, 8, 8, 0, 0, &d), PVX_OK);
    struct made m = make(CAP_GREY8, 8, 8, 0, 2, 77);
    T_EQ_I(cap_take_put_stray(w, &m.f, CAP_TAKE_LATE, &d), PVX_OK);
    m.f.img.width = 4; /* does not fit: a gap */
    T_EQ_I(cap_take_put_stray(w, &m.f, CAP_TAKE_LATE, &d), PVX_OK);
    free(m.mem);
    struct cap_take_gap g = {.camera = 1,
                             .why = CAP_TAKE_QUEUE,
                             .frames = 4,
                             .id_first = 5,
                             .id_last = 9,
                             .set_first = 6,
                             .set_last = 10};
    T_EQ_I(cap_take_put_gap(w, &g, &d), PVX_OK);
    T_EQ_I(cap_take_bytes(w), 4 * 64);
    cap_take *t = closed(&w);
    const struct cap_take_info *i = cap_take_info(t);
    T_EQ_S(i->head.rig, "version: 1\n");
    T_EQ_S(i->head.config, "fps: 20\n");
    T_EQ_S(i->head.software, "test");
    T_EQ_S(i->head.host, "lab");
    T_EQ_S(i->head.base, "/etc");
    T_OK(i->head.session == 0xfedcba9876543210u);
    T_EQ_I(i->head.t_created_ns, 1700000000123456789);
    T_NEAR(i->head.fps, 20, 0);
    T_EQ_I(i->head.n_cameras, CAMERAS);
    for (uint32_t c = 0; c < CAMERAS; c++) {
        T_EQ_S(i->head.camera[c].name, cameras[c].name);
        T_EQ_S(i->head.camera[c].uri, cameras[c].uri);
        T_EQ_S(i->head.camera[c].settings, cameras[c].settings);
    }
    T_EQ_I(i->head.camera[2].frames, 2);
    T_EQ_I(cap_take_row(t, 2, 1)->set, -1);
    T_EQ_I(cap_take_row(t, 2, 1)->why, CAP_TAKE_LATE);
    T_EQ_I(i->gaps, 2);
    T_EQ_I(cap_take_gap(t, 0)->why, CAP_TAKE_UNFIT);
    T_EQ_I(cap_take_gap(t, 0)->id_first, 77);
    T_OK(memcmp(cap_take_gap(t, 1), &g, sizeof g) == 0);
    T_EQ_I(cap_take_find(t, "c.3"), 2);
    T_EQ_I(cap_take_find(t, "c"), -1);
    T_EQ_I(cap_take_find_set(t, 10), 0);
    T_EQ_I(cap_take_find_set(t, 11), -1);
    T_EQ_I(cap_take_find_set(t, -1), -1);
    cap_take_free(&t);
}

/* A first frame that is of no known format or lacks rows costs itself alone, not the take. */
T_CASE(unfit_first_frame_costs_itself_alone)
{
    struct pvx_diag d = {""};
    cap_take_writer *w = create();
    struct made good = make(CAP_GREY8, 8, 8, 0, 0, 0), bad = make(CAP_GREY8, 8, 8, 0, 2, 0);
    struct cap_set s = {.n = 2, .frame = {&good.f, NULL, &bad.f}};
    struct cap_image fit = bad.f.img, first[] = {fit, fit, fit, fit};
    first[0].fmt = CAP_FMT_NONE;
    first[1].width = 0;
    first[2].size = 63;
    for (; s.number < 4; s.number++) {
        bad.f.img = first[s.number];
        T_EQ_I(cap_take_put_set(w, &s, &d), PVX_OK);
    }
    cap_take *t = closed(&w);
    free(good.mem);
    free(bad.mem);
    const struct cap_take_info *i = cap_take_info(t);
    T_EQ_I(i->sets, 4);
    T_EQ_I(i->head.camera[0].frames, 4);
    T_EQ_I(i->head.camera[2].frames, 1);
    T_EQ_I(i->gaps, 3);
    for (uint64_t k = 0; k < i->gaps; k++) {
        T_EQ_I(cap_take_gap(t, k)->why, CAP_TAKE_UNFIT);
        T_EQ_I(cap_take_gap(t, k)->camera, 2);
        T_EQ_I(cap_take_set(t, k, NULL)->mask, 1);
    }
    T_EQ_I(cap_take_set(t, 3, NULL)->mask, 5);
    cap_take_free(&t);
}

/* Times that cannot be subtracted from each other are not read. */
T_CASE(impossible_times_are_not_read)
{
    for (int what = 0; what < 2; what++) {
        struct pvx_diag d = {""};
        cap_take_writer *w = create();
        struct made m = make(CAP_GREY8, 8, 8, 0, 0, 0);
        struct cap_set s = {.n = 1, .frame = {&m.f}, .t_exposure_ns = INT64_MAX / 2};
        T_EQ_I(cap_take_put_set(w, &s, &d), PVX_OK);
        s.number = 1;
        *(what == 0 ? &s.t_exposure_ns : &m.f.t_arrival_mono_ns) =
            what == 0 ? INT64_MAX / 2 + 1 : -1;
        T_EQ_I(cap_take_put_set(w, &s, &d), PVX_OK);
        cap_take *t = closed(&w);
        free(m.mem);
        T_EQ_I(cap_take_info(t)->sets, 1);
        T_EQ_I(cap_take_info(t)->sets_lost, 1);
        cap_take_free(&t);
    }
}

/* ---- played ---- */

static struct box box = BOX_EMPTY;

/* The host clock was set an hour on, then back by two: the frames say so, and come as they came. */
T_CASE(a_set_clock_does_not_pace_the_replay)
{
    static const int64_t hour[] = {2, 3, 1};
    struct pvx_diag d = {""};
    cap_take_writer *w = create();
    struct made m = make(CAP_GREY8, 8, 8, 0, 0, 0);
    struct cap_set s = {.n = 1, .frame = {&m.f}};
    for (unsigned k = 0; k < 3; k++) {
        s.number = m.f.id = k;
        s.t_exposure_ns = m.f.t_exposure_ns = hour[k] * 3600 * PVX_NS_PER_S + k;
        s.t_last_mono_ns = m.f.t_arrival_mono_ns = (5 + k) * PVX_NS_PER_MS;
        T_EQ_I(cap_take_put_set(w, &s, &d), PVX_OK);
    }
    T_EQ_I(cap_take_close(&w, &d), PVX_OK);
    free(m.mem);
    struct cap_source_config c = {.uri = path, .name = cameras[0].name, .buffers = 4};
    struct cap_sink sink = SINK_OF(&box);
    cap_source *src = NULL;
    keep_box(&box, true);
    T_EQ_I(cap_source_take.open(&c, &src, &d), PVX_OK);
    T_EQ_I(cap_source_take.start(src, &sink, &d), PVX_OK);
    T_OK(wait_count(&box, &box.ended, 1));
    cap_source_take.stop(src);
    T_EQ_I(box.ended, 1);
    T_EQ_I(box.n, 3);
    for (unsigned k = 0; k < 3 && k < box.n_held; k++)
        T_EQ_I(box.held[k]->t_exposure_ns, hour[k] * 3600 * PVX_NS_PER_S + k);
    empty_box(&box);
    cap_source_take.close(&src);
}

/* Lossless, all wait for all: a camera that is in none of so many sets that their frames take the others'
 * last buffers holds nobody up, also where a camera that is not played was in them. */
T_CASE(a_camera_missing_for_long_does_not_hold_up_a_lossless_replay)
{
    enum { SETS = 60, FROM = 10, TO = 50, BUFFERS = 8 };
    struct pvx_diag d = {""};
    cap_take_writer *w = create();
    for (unsigned k = 0; k < SETS; k++) {
        struct cap_set s = {.number = k};
        struct made m[CAMERAS];
        for (uint32_t c = 0; c < CAMERAS; c++) {
            m[c] = make(CAP_GREY8, 8, 8, 0, c, k);
            if (c != 1 || k < FROM || k >= TO)
                s.frame[c] = &m[c].f;
            s.n += s.frame[c] != NULL;
        }
        T_EQ_I(cap_take_put_set(w, &s, &d), PVX_OK);
        for (uint32_t c = 0; c < CAMERAS; c++)
            free(m[c].mem);
    }
    T_EQ_I(cap_take_close(&w, &d), PVX_OK);
    char uri[128];
    snprintf(uri, sizeof uri, "take:%s", path);
    struct cap_source_config cam[2];
    for (int c = 0; c < 2; c++)
        cam[c] =
            (struct cap_source_config){.uri = uri, .name = cameras[c].name, .buffers = BUFFERS};
    const struct cap_capture_config cfg = {
        .n_cameras = 2,
        .camera = cam,
        .fps = 20,
        .lossless = true,
        .sets = {.policy = CAP_POLICY_PARTIAL, .min_cameras = 1}};
    cap_capture *cap;
    T_EQ_I(cap_capture_new(&cfg, &cap, &d), PVX_OK);
    T_EQ_I(cap_capture_start(cap, &d), PVX_OK);
    struct cap_set *s;
    pvx_err e;
    unsigned n = 0;
    for (; (e = cap_capture_next(cap, PATIENCE_NS, &s)) == PVX_OK; n++) {
        T_EQ_I(s->number, n);
        T_EQ_I(s->n, n < FROM || n >= TO ? 2 : 1);
        cap_set_release(s);
    }
    T_EQ_I(e, PVX_ECLOSED);
    T_EQ_I(n, SETS);
    cap_capture_free(&cap);
}

T_CASE(camera_that_comes_later)
{
    struct pvx_diag d = {""};
    cap_take_writer *w = create();
    struct made m = make(CAP_GREY8, 8, 8, 0, 0, 0), n = make(CAP_JPEG, 64, 64, 0, 2, 1);
    struct cap_set s = {.number = 3, .n = 1, .frame = {&m.f}};
    T_EQ_I(cap_take_put_set(w, &s, &d), PVX_OK);
    s.number = 4;
    s.n = 2;
    s.frame[2] = &n.f;
    T_EQ_I(cap_take_put_set(w, &s, &d), PVX_OK);
    cap_take *t = closed(&w);
    const struct cap_take_info *i = cap_take_info(t);
    T_EQ_I(i->sets, 2);
    T_EQ_I(i->head.camera[0].frames, 2);
    T_EQ_I(i->head.camera[1].fmt, CAP_FMT_NONE);
    T_EQ_I(i->head.camera[1].frames, 0);
    T_EQ_I(i->head.camera[2].fmt, CAP_JPEG);
    const int64_t *member;
    T_EQ_I(cap_take_set(t, 1, &member)->mask, 5);
    T_EQ_I(member[1], -1);
    char mem[400];
    struct cap_image img;
    T_EQ_I(cap_take_read(t, 2, 0, mem, sizeof mem, &img, &d), PVX_OK);
    T_OK(same_pixels(&img, &n.f.img));
    T_EQ_I(cap_take_read(t, 2, 0, mem, 0, &img, &d), PVX_ERANGE);
    T_EQ_I(cap_take_read(t, 2, 1, mem, sizeof mem, &img, NULL), PVX_EINVAL);
    cap_take_free(&t);
    free(m.mem);
    free(n.mem);
}

/* ---- cut off ---- */

static void copy_cut(long bytes)
{
    unlink(copy);
    int in = open(path, O_RDONLY), out = open(copy, O_WRONLY | O_CREAT | O_TRUNC, 0600);
    struct stat st;
    if (fstat(in, &st) != 0)
        T_OK(0);
    if (bytes < 0 || bytes > st.st_size)
        bytes = st.st_size;
    for (long left = bytes; left > 0;) {
        ssize_t n = copy_file_range(in, NULL, out, NULL, (size_t)left, 0);
        if (n <= 0)
            break;
        left -= n;
    }
    close(in);
    close(out);
}

enum { W = 96, H = 80, ENDLESS = INT32_MAX };

/* A child that has written one set, and writes `sets`; it ends without closing (close_it: in order). */
static pid_t writing(int sets, bool close_it, enum cap_pixfmt fmt)
{
    int ready[2];
    char byte;
    unlink(path);
    fflush(stdout);
    T_EQ_I(pipe(ready), 0);
    pid_t pid = fork();
    if (pid == 0) {
        cap_take_writer *w = create();
        struct pvx_diag d = {""};
        for (int k = 0; k < sets; k++)
            if (put_set(w, fmt, W, H, 0, (uint64_t)k, &d) != PVX_OK ||
                (k == 0 && write(ready[1], "", 1) != 1))
                _exit(1);
        if (close_it && cap_take_close(&w, &d) != PVX_OK)
            _exit(1);
        _exit(0);
    }
    close(ready[1]);
    T_EQ_I(read(ready[0], &byte, 1), 1);
    close(ready[0]);
    return pid;
}

static void killed_after(pid_t pid, int us)
{
    usleep((useconds_t)us);
    kill(pid, SIGKILL);
    waitpid(pid, NULL, 0);
}

/* Sets that the first `cut` bytes can have at most: their pixels alone. */
static void sweep(bool close_it, enum cap_pixfmt fmt, int sets, int cuts)
{
    struct stat st;
    int status;
    waitpid(writing(sets, close_it, fmt), &status, 0);
    T_EQ_I(status, 0);
    stat(path, &st);
    int64_t last = 0;
    long worst = 0;
    for (int i = 0; i <= cuts; i++) {
        long cut = (long)((double)st.st_size * i / cuts);
        copy_cut(cut);
        cap_take *t;
        struct pvx_diag d = {""};
        pvx_err e = cap_take_open(copy, &t, &d);
        if (e != PVX_OK) { /* only when the head itself is not there */
            T_CHECK_(cut < (256 << 10), "cut at %ld: %s", cut, d.text);
            T_OK(d.text[0] != '\0');
            continue;
        }
        int64_t n = whole_sets(t, fmt, W, H, 0);
        T_CHECK_(n >= last, "cut at %ld of %ld: %lld sets, but %lld in less", cut, (long)st.st_size,
                 (long long)n, (long long)last);
        last = n;
        if (fmt != CAP_JPEG) {
            long fit = 0, bytes = 2 * (256 << 10), frame = (long)cap_pixfmt_row(fmt, W) * H;
            frame = (frame + TAKE_ALIGN - 1) / TAKE_ALIGN * TAKE_ALIGN;
            for (; fit < sets; fit++) { /* pixels, rows with room, blocks of metadata */
                bytes += (frame + 130) * (2 + in_set(1, (uint64_t)fit)) + 130;
                if (bytes > cut)
                    break;
            }
            worst = fit - n > worst ? fit - n : worst;
        }
        cap_take_free(&t);
    }
    T_EQ_I(last, sets);
    T_LE(worst, 1);
}

T_CASE(cut_anywhere_gives_the_sets_before)
{
    sweep(false, CAP_RGB8, 100, 61);
    sweep(false, CAP_JPEG, 300, 31); /* a set without camera 1 may outlive one with it */
}

T_CASE(closed_and_cut_gives_the_sets_before)
{
    sweep(true, CAP_RGB8, 100, 61);
}

T_CASE(killed_at_any_time_gives_the_sets_before)
{
    for (int i = 0; i < 25; i++) {
        int us = 1 + 2477 * i;
        killed_after(writing(ENDLESS, false, CAP_RGB8), us);
        cap_take *t = open_take(path);
        if (t == NULL)
            continue;
        T_OK(!cap_take_info(t)->closed);
        int64_t n = whole_sets(t, CAP_RGB8, W, H, 0);
        T_CHECK_(n >= 1 && cap_take_info(t)->sets_lost <= 1,
                 "killed after %d us: %lld sets, %llu lost", us, (long long)n,
                 (unsigned long long)cap_take_info(t)->sets_lost);
        cap_take_free(&t);
    }
}

/* A copy that is made meanwhile has its front from earlier than its end.  The kernel does not promise that
 * it sees a write whole: a copy with a torn piece of metadata is refused, and the next one is taken. */
T_CASE(copied_while_it_is_written)
{
    uint64_t most = 0;
    for (int i = 0; i < 20 || (most < 10 && i < 1000); i++) {
        pid_t pid = writing(ENDLESS, false, CAP_RGB8);
        usleep((useconds_t)(2000 + 1300 * i));
        cap_take *t = NULL;
        struct pvx_diag d = {""};
        for (int try = 0; t == NULL && try < 20; try++) {
            d.text[0] = '\0';
            copy_cut(-1);
            T_OK(cap_take_open(copy, &t, &d) == PVX_OK || d.text[0] != '\0');
        }
        killed_after(pid, 0);
        T_CHECK_(t != NULL, "copy %d: %s", i, d.text);
        if (t == NULL)
            continue;
        uint64_t n = cap_take_info(t)->sets;
        T_CHECK_(n >= 1 && whole_sets(t, CAP_RGB8, W, H, 0) == (int64_t)n,
                 "copy %d: %lld of %llu sets", i, (long long)whole_sets(t, CAP_RGB8, W, H, 0),
                 (unsigned long long)n);
        most = n > most ? n : most;
        cap_take_free(&t);
    }
    T_LE(10, most);
}

T_CASE(read_while_it_is_written)
{
    struct pvx_diag d = {""};
    cap_take_writer *w = create();
    for (uint64_t k = 0; k < 70; k++) {
        T_EQ_I(put_set(w, CAP_RGB8, W, H, 0, k, &d), PVX_OK);
        if (k % 10 == 9) {
            copy_cut(-1); /* libhdf5 would share the file itself within one process */
            cap_take *t = open_take(copy);
            T_EQ_I(whole_sets(t, CAP_RGB8, W, H, 0), (long long)k + 1);
            cap_take_free(&t);
            unlink(copy);
        }
    }
    T_EQ_I(cap_take_close(&w, &d), PVX_OK);
}

/* ---- wrong ---- */

static void refused(const char *name, pvx_err want, const char *part)
{
    cap_take *t;
    struct pvx_diag d = {""};
    T_EQ_I(cap_take_open(name, &t, &d), want);
    T_OK(t == NULL);
    T_CONTAINS(d.text, part);
}

T_CASE(what_is_no_take_is_refused)
{
    refused("/nonexistent.h5", PVX_ENOENT, "no such file");
    refused("/etc/passwd", PVX_EFORMAT, "not HDF5");
    refused(dir, PVX_EFORMAT, "not HDF5");
    hid_t f = H5Fcreate(path, H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT);
    H5Fclose(f);
    refused(path, PVX_EFORMAT, "another kind");
}

/* A good take in which one thing is replaced. */
static void with_change(void (*change)(hid_t f), const char *part)
{
    struct pvx_diag d = {""};
    cap_take_writer *w = create();
    for (uint64_t k = 0; k < 3; k++)
        T_EQ_I(put_set(w, CAP_GREY8, 8, 8, 0, k, &d), PVX_OK);
    T_EQ_I(cap_take_close(&w, &d), PVX_OK);
    hid_t f = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT);
    change(f);
    H5Fclose(f);
    if (part != NULL)
        refused(path, PVX_EFORMAT, part);
}

static void replace(hid_t f, const char *name, hid_t type, int rank, const hsize_t *dims)
{
    H5Ldelete(f, name, H5P_DEFAULT);
    if (rank == 0)
        return;
    hid_t space = H5Screate_simple(rank, dims, NULL), p = H5Pcreate(H5P_DATASET_CREATE);
    hsize_t chunk[4] = {1, 1, 1, 1};
    H5Pset_chunk(p, rank, chunk); /* so that huge ones cost nothing */
    hid_t s = H5Dcreate2(f, name, type, space, H5P_DEFAULT, p, H5P_DEFAULT);
    H5Dclose(s);
    H5Pclose(p);
    H5Sclose(space);
}

/* Frames that are the bytes of any other file. */
static void frames_elsewhere(hid_t f)
{
    hid_t s = H5Dopen2(f, "cameras/cam0/frames", H5P_DEFAULT), space = H5Dget_space(s);
    hid_t t = H5Dget_type(s), p = H5Pcreate(H5P_DATASET_CREATE);
    hsize_t n[4] = {0};
    H5Dclose(s);
    H5Ldelete(f, "cameras/cam0/frames", H5P_DEFAULT);
    H5Pset_external(p, "/etc/services", 0, H5F_UNLIMITED);
    int rank = H5Sget_simple_extent_dims(space, n, NULL);
    H5Sset_extent_simple(space, rank, n, NULL);
    s = H5Dcreate2(f, "cameras/cam0/frames", t, space, H5P_DEFAULT, p, H5P_DEFAULT);
    T_OK(s >= 0);
    H5Dclose(s);
    H5Pclose(p);
    H5Tclose(t);
    H5Sclose(space);
}

static const hsize_t small[4] = {3, 8, 8, 3}, huge[4] = {1ull << 40, 8, 8, 3};
static void huge_gaps(hid_t f)
{
    hid_t g = H5Dopen2(f, "gaps", H5P_DEFAULT), t = H5Dget_type(g);
    H5Dclose(g);
    replace(f, "gaps", t, 1, huge);
    H5Tclose(t);
}
static void set_attribute(hid_t f, const char *name, const void *v)
{
    hid_t g = H5Gopen2(f, "cameras/cam0", H5P_DEFAULT), a = H5Aopen(g, name, H5P_DEFAULT);
    hid_t t = H5Aget_type(a);
    T_OK(H5Awrite(a, t, v) >= 0);
    H5Tclose(t);
    H5Aclose(a);
    H5Gclose(g);
}
static void huge_width(hid_t f)
{
    int64_t v = 1ll << 40;
    set_attribute(f, "width", &v);
}
static void unknown_format(hid_t f)
{
    set_attribute(f, "pixel_format", "Monk8");
}
static void camera_is_a_link(hid_t f)
{
    H5Lcreate_soft("/cameras/cam0", f, "/cameras/cam9", H5P_DEFAULT, H5P_DEFAULT);
}
static void camera_missing(hid_t f)
{
    H5Ldelete(f, "cameras/cam0", H5P_DEFAULT);
}
/* Replaced by nothing where the rank is 0. */
static struct other {
    const char *name;
    hid_t type;
    int rank;
    const hsize_t *dims;
    const char *says;
} other;
static void replace_by_other(hid_t f)
{
    replace(f, other.name, other.type, other.rank, other.dims);
}

T_CASE(wrong_contents_are_refused)
{
    static const hsize_t many[2] = {1ull << 60, CAMERAS};
    const struct other wrong[] = {
        {"sets", 0, 0, NULL, "table of sets"},
        {"sets", H5T_STD_I32LE, 1, small, "table of sets"},
        {"members", H5T_STD_I64LE, 2, many, "table of sets"},
        {"members", H5T_STD_I64LE, 2, small, "table of sets"},
        {"cameras/cam0/frames", H5T_STD_U8LE, 4, small, "a camera's frames"},
        {"cameras/cam0/frames", H5T_STD_U16LE, 3, small, "a camera's frames"},
        {"cameras/cam0/index", 0, 0, NULL, "a camera's index"},
        {"rig", H5T_STD_I32LE, 1, small, "head"},
    };
    for (size_t i = 0; i < sizeof wrong / sizeof wrong[0]; i++) {
        other = wrong[i];
        with_change(replace_by_other, other.says);
    }
    with_change(huge_gaps, "gaps");
    with_change(huge_width, "pixel format or size");
    with_change(unknown_format, "pixel format");
    with_change(camera_is_a_link, "list of cameras");
    with_change(camera_missing, "name");
    with_change(frames_elsewhere, "a camera's frames");
}

static void pixels_changed(hid_t f)
{
    hid_t s = H5Dopen2(f, "cameras/cam0/frames", H5P_DEFAULT);
    hsize_t at[3] = {1, 0, 0};
    unsigned char zero[64] = {0};
    H5Dwrite_chunk(s, H5P_DEFAULT, 0, at, 64, zero);
    H5Dclose(s);
}

T_CASE(changed_pixels_are_noticed)
{
    with_change(pixels_changed, NULL);
    cap_take *t = open_take(path);
    char mem[64];
    struct cap_image img;
    struct pvx_diag d = {""};
    T_EQ_I(cap_take_info(t)->sets, 3);
    T_EQ_I(cap_take_read(t, 0, 0, mem, 64, &img, &d), PVX_OK);
    T_EQ_I(cap_take_read(t, 0, 1, mem, 64, &img, &d), PVX_ECORRUPT);
    T_CONTAINS(d.text, "cam0, frame 1");
    cap_take_free(&t);
}

T_CASE(an_old_file_is_not_written_over)
{
    struct pvx_diag d = {""};
    cap_take_writer *w = create(), *v;
    T_EQ_I(cap_take_close(&w, &d), PVX_OK);
    struct cap_take_head h = head();
    T_EQ_I(cap_take_create(path, &h, &v, &d), PVX_EBUSY);
    T_OK(v == NULL);
    T_CONTAINS(d.text, "is there already");
    d.text[0] = '\0';
    T_EQ_I(cap_take_create("/proc/self/x.h5", &h, &v, &d) == PVX_OK, 0);
    T_OK(d.text[0] != '\0');
    struct cap_take_camera bad = {.name = "a/b"};
    h.camera = &bad;
    h.n_cameras = 1;
    d.text[0] = '\0';
    T_EQ_I(cap_take_create(copy, &h, &v, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "a/b");
    cap_take *t = open_take(path); /* empty: no frame ever came */
    T_EQ_I(cap_take_info(t)->sets, 0);
    T_OK(cap_take_info(t)->closed);
    cap_take_free(&t);
}

static void set_up(void)
{
    scratch_new();
    snprintf(path, sizeof path, "%s/take.h5", dir);
    snprintf(copy, sizeof copy, "%s/copy.h5", dir);
}
T_MAIN(set_up(), scratch_remove())
