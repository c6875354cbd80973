/* test_capture_files.c - recorded frames through the capture layer: nothing lost, nothing shifted.
 * Every image says in its pixels which camera and number it is. */
#include "../t.h"

#include <sys/stat.h>
#include <unistd.h>

#include "base/clock.h"
#include "base/log.h"
#include "capture/rig/capture.h"
#include "capture/files/imgio.h"

#define N           4
#define W           8
#define H           6
#define PATIENCE_NS (60 * PVX_NS_PER_S)

static char dir[64];

static void path_of(char *out, size_t size, int cam, int number, const char *ext)
{
    snprintf(out, size, "%s/cam%d/%06d.%s", dir, cam, number, ext);
}

static void write_image(int cam, int number, const char *ext, int32_t w)
{
    char path[256];
    float px[W * H * 4];
    for (int i = 0; i < w * H; i++)
        px[i] = (float)i;
    px[0] = (float)cam / 255;
    px[1] = (float)number / 255;
    path_of(path, sizeof path, cam, number, ext);
    struct pvx_diag d = {""};
    pvx_err e = cap_image_save(path, px, w, H, 1, 1, &d);
    T_CHECK_(e == PVX_OK, "%s", d.text);
}

static void begin(void)
{
    snprintf(dir, sizeof dir, "/tmp/pyrovox-files-XXXXXX");
    T_OK(mkdtemp(dir) != NULL);
    for (int c = 0; c < N; c++) {
        char path[128];
        snprintf(path, sizeof path, "%s/cam%d", dir, c);
        T_EQ_I(mkdir(path, 0777), 0);
    }
}

static void end(void)
{
    char cmd[128];
    snprintf(cmd, sizeof cmd, "rm -rf '%s'", dir);
    T_EQ_I(system(cmd), 0);
}

struct rig {
    struct cap_source_config cam[N];
    struct cap_capture_config cfg;
    char uri[N][256], name[N][16];
};

static void rig_init(struct rig *r, int n, bool lossless)
{
    memset(r, 0, sizeof *r);
    for (int i = 0; i < n; i++) {
        snprintf(r->uri[i], sizeof r->uri[i], "files:%s/cam%d/%%06d.npy", dir, i);
        snprintf(r->name[i], sizeof r->name[i], "cam%d", i);
        r->cam[i] = (struct cap_source_config){.uri = r->uri[i],
                                               .name = r->name[i],
                                               .width = W,
                                               .height = H,
                                               .fmt = CAP_GREY_F32,
                                               .buffers = 4,
                                               .exposure_us = -1,
                                               .gain = -1};
    }
    r->cfg = (struct cap_capture_config){
        .n_cameras = (uint32_t)n,
        .camera = r->cam,
        .fps = 100,
        .lossless = lossless,
        .discard_first = 1, /* must not touch recorded frames */
        .sets = {.policy = CAP_POLICY_PARTIAL, .min_cameras = 1, .max_wait_ns = PVX_NS_PER_S}};
}

static cap_capture *run(const struct rig *r)
{
    cap_capture *c;
    struct pvx_diag d = {""};
    pvx_err e = cap_capture_new(&r->cfg, &c, &d);
    T_CHECK_(e == PVX_OK, "new: %s", d.text);
    if (e != PVX_OK)
        exit(1);
    T_EQ_I(cap_capture_start(c, &d), PVX_OK);
    return c;
}

/* Number that the set shows, checked in every member; -1 = members disagree. */
static int shows(const struct cap_set *s)
{
    int number = -2;
    for (int i = 0; i < N; i++) {
        if (s->frame[i] == NULL)
            continue;
        const struct cap_image *img = &s->frame[i]->img;
        int cam, n;
        if (img->fmt == CAP_GREY_F32) {
            const float *px = img->data;
            cam = (int)lrintf(px[0] * 255);
            n = (int)lrintf(px[1] * 255);
            T_NEAR(px[W * H - 1], W * H - 1, 0);
        } else {
            const uint8_t *px = img->data;
            cam = px[0];
            n = px[1];
        }
        T_EQ_I(cam, i);
        if (number != -2 && number != n)
            return -1;
        number = n;
    }
    return number;
}

static pvx_err next(cap_capture *c, struct cap_set **s)
{
    return cap_capture_next(c, PATIENCE_NS, s);
}

static struct cap_stats st;

static void lossless_gives_every_frame(void)
{
    begin();
    for (int k = 0; k < 100; k++)
        for (int c = 0; c < N; c++)
            write_image(c, k, "npy", W);
    static struct rig r;
    rig_init(&r, N, true);
    r.cam[2].width = r.cam[2].height = 0; /* the first image says */
    r.cam[2].fmt = CAP_FMT_NONE;
    cap_capture *c = run(&r);
    struct cap_set *s;
    pvx_err e;
    int k = 0;
    while ((e = next(c, &s)) == PVX_OK) {
        T_EQ_I(s->n, N);
        T_EQ_I(shows(s), k);
        T_EQ_I(s->spread_ns, 0);
        T_EQ_I(s->t_exposure_ns, PVX_NS_PER_S + k * 10 * PVX_NS_PER_MS);
        T_EQ_I(s->frame[1]->id, k);
        if (k % 25 == 0) /* a consumer that takes its time loses nothing */
            pvx_sleep_until_mono(pvx_now_mono() + 30 * PVX_NS_PER_MS);
        cap_set_release(s);
        k++;
    }
    T_EQ_I(e, PVX_ECLOSED);
    T_EQ_I(k, 100);
    cap_capture_stats(c, &st);
    T_EQ_I(st.sets_complete, 100);
    T_EQ_I(st.sets_dropped, 0);
    for (int i = 0; i < N; i++) {
        T_EQ_I(st.camera[i].count[CAP_RECEIVED], 100);
        T_EQ_I(st.camera[i].state, CAP_ENDED);
    }
    cap_capture_free(&c);
    end();
}

/* Camera 1 misses numbers, 2 has broken and misfit files, 3 begins late and ends early. */
static void holes_do_not_shift_sets(void)
{
    begin();
    for (int k = 10; k < 60; k++) {
        write_image(0, k, "npy", W);
        if (k % 7 != 0)
            write_image(1, k, "npy", W);
        write_image(2, k, "npy", k % 10 == 5 ? W + 1 : W);
        if (k >= 20 && k < 50)
            write_image(3, k, "npy", W);
    }
    char path[256];
    path_of(path, sizeof path, 2, 33, "npy");
    T_EQ_I(truncate(path, 100), 0);
    static struct rig r;
    rig_init(&r, N, true);
    cap_capture *c = run(&r);
    struct cap_set *s;
    int k = 10;
    while (next(c, &s) == PVX_OK) {
        T_EQ_I(shows(s), k);
        T_EQ_I(s->frame[0] != NULL, 1);
        T_EQ_I(s->frame[1] != NULL, k % 7 != 0);
        T_EQ_I(s->frame[2] != NULL, k % 10 != 5 && k != 33);
        T_EQ_I(s->frame[3] != NULL, k >= 20 && k < 50);
        cap_set_release(s);
        k++;
    }
    T_EQ_I(k, 60);
    cap_capture_stats(c, &st);
    T_EQ_I(st.camera[1].count[CAP_ID_GAP], 7); /* 14 21 28 35 42 49 56 */
    T_EQ_I(st.camera[2].count[CAP_BAD_SIZE], 5);
    T_EQ_I(st.camera[2].count[CAP_INCOMPLETE], 1);
    T_EQ_I(st.camera[3].count[CAP_RECEIVED], 30);
    cap_capture_free(&c);
    end();
}

static void missing_folder_does_not_stop_the_others(void)
{
    begin();
    for (int k = 0; k < 5; k++)
        write_image(0, k, "npy", W);
    static struct rig r;
    rig_init(&r, 2, true);
    snprintf(r.uri[1], sizeof r.uri[1], "files:%s/nosuch", dir);
    cap_capture *c = run(&r);
    struct cap_set *s;
    int k = 0;
    while (next(c, &s) == PVX_OK) {
        T_EQ_I(shows(s), k++);
        cap_set_release(s);
    }
    T_EQ_I(k, 5);
    cap_capture_stats(c, &st);
    T_CONTAINS(st.camera[1].error, "nosuch");
    cap_capture_free(&c);
    end();
}

/* Turns have one length for all: camera 1 lacks the first and the last number. */
static void loops_stay_together(void)
{
    begin();
    for (int k = 3; k < 8; k++)
        write_image(0, k, "npy", W);
    for (int k = 4; k < 7; k++)
        write_image(1, k, "npy", W);
    static struct rig r;
    rig_init(&r, 2, true);
    r.cam[0].loop = r.cam[1].loop = true;
    cap_capture *c = run(&r);
    struct cap_set *s;
    for (int i = 0; i < 43; i++) {
        T_EQ_I(next(c, &s), PVX_OK);
        if (s == NULL)
            break;
        int k = 3 + i % 5;
        T_EQ_I(shows(s), k);
        T_EQ_I(s->frame[0] != NULL, 1);
        T_EQ_I(s->frame[1] != NULL, k > 3 && k < 7);
        T_EQ_I(s->frame[0]->id, 3 + i);
        cap_set_release(s);
    }
    cap_capture_free(&c); /* in mid-stream */
    end();
}

/* Live-like: in real time; what a busy machine leaves out is counted, sets stay pure. */
static void paced_frames_come_in_real_time(void)
{
    begin();
    for (int k = 0; k < 40; k++)
        for (int c = 0; c < 2; c++)
            write_image(c, k, "npy", W);
    static struct rig r;
    rig_init(&r, 2, false);
    cap_capture *c = run(&r);
    int64_t t0 = pvx_now_mono();
    struct cap_set *s;
    pvx_err e;
    uint64_t frames[2] = {0};
    int last = -1;
    while ((e = next(c, &s)) == PVX_OK) {
        int k = shows(s);
        T_OK(k > last);
        last = k;
        int64_t age = pvx_now_real() - s->t_exposure_ns;
        T_OK(age >= 0);
        T_LE(age, PATIENCE_NS);
        for (int i = 0; i < 2; i++)
            frames[i] += s->frame[i] != NULL;
        cap_set_release(s);
    }
    T_EQ_I(e, PVX_ECLOSED);
    T_OK(last == 39 || pvx_now_mono() - t0 > PVX_NS_PER_S);
    T_OK(pvx_now_mono() - t0 >= 390 * PVX_NS_PER_MS); /* 39 periods, not faster */
    cap_capture_stats(c, &st);
    for (int i = 0; i < 2; i++) {
        const uint64_t *k = st.camera[i].count;
        T_EQ_I(k[CAP_RECEIVED] + k[CAP_ID_GAP] + k[CAP_UNDERRUN], 40);
        T_EQ_I(k[CAP_RECEIVED], frames[i] + k[CAP_LATE] + k[CAP_UNMATCHED] + k[CAP_OVERFLOW]);
    }
    cap_capture_free(&c);
    end();
}

/* Needs the OpenCV module beside the build. */
static void png_folder_and_bayer(void)
{
#ifdef __SANITIZE_THREAD__
    T_SKIP("libraries under OpenCV order their own locks in ways that ThreadSanitizer reports");
#endif
    begin();
    char path[256];
    float px[W * H] = {0};
    path_of(path, sizeof path, 0, 0, "png");
    struct pvx_diag d = {""};
    if (cap_image_save(path, px, W, H, 1, 1, &d) == PVX_EUNSUP) {
        end();
        T_SKIP("the OpenCV module is not there");
    }
    T_EQ_S(d.text, "");
    for (int k = 0; k < 10; k++)
        for (int c = 0; c < 2; c++)
            write_image(c, k, "png", W);
    static struct rig r;
    rig_init(&r, 2, true);
    snprintf(r.uri[0], sizeof r.uri[0], "files:%s/cam0", dir);
    snprintf(r.uri[1], sizeof r.uri[1], "files:%s/cam1/*.png", dir);
    r.cam[0].fmt = CAP_GREY8;
    r.cam[1].fmt = CAP_BAYER_RG8; /* a sensor's raw picture kept as grey */
    cap_capture *c = run(&r);
    struct cap_set *s;
    int k = 0;
    while (next(c, &s) == PVX_OK) {
        T_EQ_I(shows(s), k++);
        T_EQ_I(s->n, 2);
        T_EQ_I(s->frame[1]->img.fmt, CAP_BAYER_RG8);
        cap_set_release(s);
    }
    T_EQ_I(k, 10);
    cap_capture_free(&c);
    /* grey is not colour: said, not converted */
    r.cam[0].fmt = CAP_RGB8;
    c = run(&r);
    k = 0;
    while (next(c, &s) == PVX_OK) {
        T_OK(s->frame[0] == NULL);
        k++;
        cap_set_release(s);
    }
    T_EQ_I(k, 10);
    cap_capture_stats(c, &st);
    T_EQ_I(st.camera[0].count[CAP_BAD_FORMAT], 10);
    cap_capture_free(&c);
    end();
}

/* ---- video: an uncompressed AVI, RIFF chunks written by hand ---------------------------------- */

static void u32(FILE *f, uint32_t v)
{
    for (int i = 0; i < 4; i++)
        fputc((int)(v >> 8 * i & 255), f);
}
static void chunk(FILE *f, const char *id, uint32_t size)
{
    fwrite(id, 1, 4, f);
    u32(f, size);
}

enum { VW = 16, VH = 8, V_BYTES = VW * VH * 3 };

static void write_avi(const char *path, int frames)
{
    FILE *f = fopen(path, "wb");
    T_OK(f != NULL);
    if (f == NULL)
        return;
    uint32_t movi = 4 + (uint32_t)frames * (8 + V_BYTES), hdrl = 4 + 8 + 56 + 12 + 8 + 56 + 8 + 40;
    chunk(f, "RIFF", 4 + 8 + hdrl + 8 + movi);
    fwrite("AVI ", 1, 4, f);
    chunk(f, "LIST", hdrl);
    fwrite("hdrl", 1, 4, f);
    chunk(f, "avih", 56);
    uint32_t avih[14] = {40000, 0, 0, 0, (uint32_t)frames, 0, 1, V_BYTES, VW, VH};
    for (int i = 0; i < 14; i++)
        u32(f, avih[i]);
    chunk(f, "LIST", 4 + 8 + 56 + 8 + 40);
    fwrite("strl", 1, 4, f);
    chunk(f, "strh", 56);
    fwrite("vidsDIB ", 1, 8, f);
    uint32_t strh[12] = {0, 0, 0, 1, 25, 0, (uint32_t)frames, V_BYTES, 0, 0, 0, VW | VH << 16};
    for (int i = 0; i < 12; i++)
        u32(f, strh[i]);
    chunk(f, "strf", 40);
    uint32_t strf[10] = {40, VW, VH, 1 | 24 << 16, 0, V_BYTES};
    for (int i = 0; i < 10; i++)
        u32(f, strf[i]);
    chunk(f, "LIST", movi);
    fwrite("movi", 1, 4, f);
    for (int k = 0; k < frames; k++) {
        chunk(f, "00db", V_BYTES);
        for (int i = 0; i < VW * VH; i++) { /* blue, green, red */
            fputc(200, f);
            fputc(100, f);
            fputc(k * 10, f);
        }
    }
    T_EQ_I(fclose(f), 0);
}

static void videos_are_cameras(void)
{
#ifdef __SANITIZE_THREAD__
    T_SKIP("libraries under OpenCV order their own locks in ways that ThreadSanitizer reports");
#endif
    begin();
    char path[N][128];
    for (int c = 0; c < 2; c++) {
        snprintf(path[c], sizeof path[c], "%s/cam%d.avi", dir, c);
        write_avi(path[c], 12 - 2 * c);
    }
    cap_video *v;
    double fps = 0;
    struct pvx_diag d = {""};
    pvx_err e = cap_video_open(path[0], &v, &fps, &d);
    if (e == PVX_EUNSUP) {
        end();
        T_SKIP("the OpenCV module is not there");
    }
    T_CHECK_(e == PVX_OK, "%s", d.text);
    T_NEAR(fps, 25, 1e-6);
    cap_video_close(&v);
    for (int loop = 0; loop < 2; loop++) {
        static struct rig r;
        rig_init(&r, 2, true);
        for (int c = 0; c < 2; c++) {
            snprintf(r.uri[c], sizeof r.uri[c], "files:%.200s", path[c]);
            r.cam[c].width = VW;
            r.cam[c].height = VH;
            r.cam[c].fmt = CAP_RGB8;
            r.cam[c].loop = loop;
        }
        cap_capture *c = run(&r);
        struct cap_set *s;
        int k = 0;
        while (k < 30 && next(c, &s) == PVX_OK) {
            for (int i = 0; i < 2; i++) {
                T_EQ_I(s->frame[i] != NULL, k % 12 < 12 - 2 * i);
                if (s->frame[i] == NULL)
                    continue;
                const uint8_t *px = s->frame[i]->img.data;
                T_EQ_I(px[0], k % 12 * 10);
                T_EQ_I(px[V_BYTES - 2], 100);
                T_EQ_I(px[V_BYTES - 1], 200);
            }
            k++;
            cap_set_release(s);
        }
        T_EQ_I(k, loop ? 30 : 12);
        cap_capture_free(&c);
    }
    end();
}

int main(int argc, char **argv)
{
    (void)argc;
    /* programs lie in BUILD/tests/sim, the module in BUILD/lib */
    char lib[512];
    const char *slash = strrchr(argv[0], '/');
    snprintf(lib, sizeof lib, "%.*s/../../lib", slash != NULL ? (int)(slash - argv[0]) : 1,
             slash != NULL ? argv[0] : ".");
    setenv("PYROVOX_LIBDIR", lib, 0);
    pvx_log_set_level(PVX_LOG_ERROR);
    T_RUN(lossless_gives_every_frame);
    T_RUN(holes_do_not_shift_sets);
    T_RUN(missing_folder_does_not_stop_the_others);
    T_RUN(loops_stay_together);
    T_RUN(paced_frames_come_in_real_time);
    T_RUN(png_folder_and_bayer);
    T_RUN(videos_are_cameras);
    return t_done();
}
