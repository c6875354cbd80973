/* test_capture_files.c - recorded frames through the capture layer: nothing lost, nothing shifted.
 * Every image says in its pixels which camera and number it is. */
#include "tests/lib/rig.h"

#include "capture/files/imgio.h"
#include "tests/lib/avi.h"
#include "tests/lib/plugins.h"
#include "tests/lib/raw_file.h"
#include "tests/lib/scratch.h"

#define N 4
#define W 8
#define H 6

static const char *path_of(int cam, int number, const char *ext)
{
    return at("cam%d/%06d.%s", cam, number, ext);
}

static void write_image(int cam, int number, const char *ext, int32_t w)
{
    float px[W * H * 4];
    for (int i = 0; i < w * H; i++)
        px[i] = (float)i;
    px[0] = (float)cam / 255;
    px[1] = (float)number / 255;
    struct pvx_diag d = {""};
    pvx_err e = cap_image_save(path_of(cam, number, ext), px, w, H, 1, &d);
    T_CHECK_(e == PVX_OK, "%s", d.text);
}

static void write_images(int cameras, int n, const char *ext)
{
    for (int k = 0; k < n; k++)
        for (int c = 0; c < cameras; c++)
            write_image(c, k, ext, W);
}

static void begin(void)
{
    scratch_new();
    for (int c = 0; c < N; c++)
        T_EQ_I(mkdir(at("cam%d", c), 0777), 0);
}

static struct rig r;

static void cameras(uint32_t n, bool lossless)
{
    rig_init(&r, n, 100, source_of(NULL, W, H, CAP_GREY_F32, 0));
    for (uint32_t i = 0; i < n; i++) {
        r.cam[i].buffers = 4;
        snprintf(r.uri[i], sizeof r.uri[i], "files:%s/cam%u/%%06d.npy", dir, i);
    }
    r.cfg.lossless = lossless;
    r.cfg.discard_first = 1; /* must not touch recorded frames */
    r.cfg.sets.max_wait_ns = PVX_NS_PER_S;
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

static pvx_err next(struct cap_set **s)
{
    return cap_capture_next(r.cap, PATIENCE_NS, s);
}

T_CASE(lossless_gives_every_frame)
{
    begin();
    write_images(N, 100, "npy");
    cameras(N, true);
    r.cam[2].width = r.cam[2].height = 0; /* the first image says */
    r.cam[2].fmt = CAP_FMT_NONE;
    rig_start(&r);
    struct cap_set *s;
    pvx_err e;
    int k = 0;
    while ((e = next(&s)) == PVX_OK) {
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
    rig_stats(&r);
    T_EQ_I(r.st.sets_complete, 100);
    T_EQ_I(r.st.sets_dropped, 0);
    for (int i = 0; i < N; i++) {
        T_EQ_I(r.st.camera[i].count[CAP_RECEIVED], 100);
        T_EQ_I(r.st.camera[i].state, CAP_ENDED);
    }
    rig_end(&r);
    scratch_remove();
}

/* Camera 1 misses numbers, 2 has broken and misfit files, 3 begins late and ends early. */
T_CASE(holes_do_not_shift_sets)
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
    T_EQ_I(truncate(path_of(2, 33, "npy"), 100), 0);
    cameras(N, true);
    rig_start(&r);
    struct cap_set *s;
    int k = 10;
    while (next(&s) == PVX_OK) {
        T_EQ_I(shows(s), k);
        T_EQ_I(s->frame[0] != NULL, 1);
        T_EQ_I(s->frame[1] != NULL, k % 7 != 0);
        T_EQ_I(s->frame[2] != NULL, k % 10 != 5 && k != 33);
        T_EQ_I(s->frame[3] != NULL, k >= 20 && k < 50);
        cap_set_release(s);
        k++;
    }
    T_EQ_I(k, 60);
    rig_stats(&r);
    T_EQ_I(r.st.camera[1].count[CAP_ID_GAP], 7); /* 14 21 28 35 42 49 56 */
    T_EQ_I(r.st.camera[2].count[CAP_BAD_SIZE], 5);
    T_EQ_I(r.st.camera[2].count[CAP_INCOMPLETE], 1);
    T_EQ_I(r.st.camera[3].count[CAP_RECEIVED], 30);
    rig_end(&r);
    scratch_remove();
}

/* Numbers that are dates, to the minute: from 0 on, a frame a second, that is 6400 years. */
T_CASE(dates_are_numbers_too)
{
    begin();
    for (int c = 0; c < 2; c++)
        for (int k = 0; k < 20; k++) {
            write_image(c, k, "npy", W);
            T_EQ_I(rename(path_of(c, k, "npy"), at("cam%d/2026112206%02d.npy", c, k)), 0);
        }
    cameras(2, true);
    r.cfg.fps = 1;
    rig_start(&r);
    struct cap_set *s;
    int k = 0;
    while (next(&s) == PVX_OK) {
        T_EQ_I(shows(s), k);
        T_EQ_I(s->n, 2);
        T_EQ_I(s->t_exposure_ns, PVX_NS_PER_S + k * PVX_NS_PER_S);
        cap_set_release(s);
        k++;
    }
    T_EQ_I(k, 20);
    rig_end(&r);
    scratch_remove();
}

T_CASE(missing_folder_does_not_stop_the_others)
{
    begin();
    for (int k = 0; k < 5; k++)
        write_image(0, k, "npy", W);
    cameras(2, true);
    snprintf(r.uri[1], sizeof r.uri[1], "files:%s/nosuch", dir);
    rig_start(&r);
    struct cap_set *s;
    int k = 0;
    while (next(&s) == PVX_OK) {
        T_EQ_I(shows(s), k++);
        cap_set_release(s);
    }
    T_EQ_I(k, 5);
    rig_stats(&r);
    T_CONTAINS(r.st.camera[1].error, "nosuch");
    rig_end(&r);
    scratch_remove();
}

/* Turns have one length for all: camera 1 lacks the first and the last number. */
T_CASE(loops_stay_together)
{
    begin();
    for (int k = 3; k < 8; k++)
        write_image(0, k, "npy", W);
    for (int k = 4; k < 7; k++)
        write_image(1, k, "npy", W);
    cameras(2, true);
    r.cam[0].loop = r.cam[1].loop = true;
    rig_start(&r);
    struct cap_set *s;
    for (int i = 0; i < 43; i++) {
        T_EQ_I(next(&s), PVX_OK);
        if (s == NULL)
            break;
        int k = 3 + i % 5;
        T_EQ_I(shows(s), k);
        T_EQ_I(s->frame[0] != NULL, 1);
        T_EQ_I(s->frame[1] != NULL, k > 3 && k < 7);
        T_EQ_I(s->frame[0]->id, 3 + i);
        cap_set_release(s);
    }
    rig_end(&r); /* in mid-stream */
    scratch_remove();
}

/* Live-like: in real time; what a busy machine leaves out is counted, sets stay pure. */
T_CASE(paced_frames_come_in_real_time)
{
    begin();
    write_images(2, 40, "npy");
    cameras(2, false);
    int64_t t0 = pvx_now_mono();
    rig_start(&r);
    struct cap_set *s;
    pvx_err e;
    uint64_t frames[2] = {0};
    int last = -1;
    while ((e = next(&s)) == PVX_OK) {
        int k = shows(s);
        T_OK(k > last);
        last = k;
        int64_t age = pvx_now_real() - s->t_exposure_ns;
        T_OK(age >= 0);
        T_LE(age, 120 * PVX_NS_PER_S);
        for (int i = 0; i < 2; i++)
            frames[i] += s->frame[i] != NULL;
        cap_set_release(s);
    }
    T_EQ_I(e, PVX_ECLOSED);
    T_OK(last >= 0);
    T_OK(pvx_now_mono() - t0 >= 390 * PVX_NS_PER_MS); /* 39 periods, not faster */
    rig_stats(&r);
    for (int i = 0; i < 2; i++) {
        const uint64_t *k = r.st.camera[i].count;
        T_EQ_I(k[CAP_RECEIVED] + k[CAP_ID_GAP] + k[CAP_UNDERRUN], 40);
        T_EQ_I(k[CAP_RECEIVED], frames[i] + k[CAP_LATE] + k[CAP_UNMATCHED] + k[CAP_OVERFLOW]);
    }
    rig_end(&r);
    scratch_remove();
}

T_CASE(png_folder_and_bayer)
{
    begin();
    write_images(2, 10, "png");
    cameras(2, true);
    snprintf(r.uri[0], sizeof r.uri[0], "files:%s/cam0", dir);
    snprintf(r.uri[1], sizeof r.uri[1], "files:%s/cam1/*.png", dir);
    r.cam[0].fmt = CAP_GREY8;
    r.cam[1].fmt = CAP_BAYER_RG8; /* a sensor's raw picture kept as grey */
    rig_start(&r);
    struct cap_set *s;
    int k = 0;
    while (next(&s) == PVX_OK) {
        T_EQ_I(shows(s), k++);
        T_EQ_I(s->n, 2);
        T_EQ_I(s->frame[1]->img.fmt, CAP_BAYER_RG8);
        cap_set_release(s);
    }
    T_EQ_I(k, 10);
    rig_end(&r);
    /* grey is not colour: said, not converted */
    r.cam[0].fmt = CAP_RGB8;
    rig_start(&r);
    k = 0;
    while (next(&s) == PVX_OK) {
        T_OK(s->frame[0] == NULL);
        k++;
        cap_set_release(s);
    }
    T_EQ_I(k, 10);
    rig_stats(&r);
    T_EQ_I(r.st.camera[0].count[CAP_BAD_FORMAT], 10);
    rig_end(&r);
    scratch_remove();
}

/* ---- video ------------------------------------------------------------------------------------ */

enum { VW = 16, VH = 8, V_BYTES = VW * VH * 3 };

static void write_avi(const char *path, int frames)
{
    FILE *f = avi_begin(path, VW, VH, (uint32_t)frames, 25);
    uint8_t px[V_BYTES];
    T_OK(f != NULL);
    for (int k = 0; f != NULL && k < frames; k++) {
        for (int i = 0; i < VW * VH; i++) {
            px[3 * i] = (uint8_t)(k * 10);
            px[3 * i + 1] = 100;
            px[3 * i + 2] = 200;
        }
        avi_frame(f, px, VW, VH);
    }
    T_OK(f == NULL || fclose(f) == 0);
}

T_CASE(videos_are_cameras)
{
#ifdef __SANITIZE_THREAD__
    T_SKIP("libraries under FFmpeg order their own locks in ways that ThreadSanitizer reports");
#endif
    begin();
    for (int c = 0; c < 2; c++)
        write_avi(at("cam%d.avi", c), 12 - 2 * c);
    cap_video *v;
    struct cap_video_info info = {0};
    struct pvx_diag d = {""};
    pvx_err e = cap_video_open(at("cam0.avi"), &v, &info, &d);
    if (e == PVX_EUNSUP) {
        scratch_remove();
        T_SKIP("the module of films is not there");
    }
    T_CHECK_(e == PVX_OK, "%s", d.text);
    T_NEAR(info.fps, 25, 1e-6);
    cap_video_close(&v);
    for (int loop = 0; loop < 2; loop++) {
        cameras(2, true);
        for (int c = 0; c < 2; c++) {
            snprintf(r.uri[c], sizeof r.uri[c], "files:%s/cam%d.avi", dir, c);
            r.cam[c].width = VW;
            r.cam[c].height = VH;
            r.cam[c].fmt = CAP_RGB8;
            r.cam[c].loop = loop;
        }
        rig_start(&r);
        struct cap_set *s;
        int k = 0;
        while (k < 30 && next(&s) == PVX_OK) {
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
        rig_end(&r);
    }
    scratch_remove();
}

/* A film that lost its frames 3 and 8, and begins with frame 1: the others keep their instants. */
T_CASE(a_film_with_lost_frames)
{
#ifdef __SANITIZE_THREAD__
    T_SKIP("libraries under FFmpeg order their own locks in ways that ThreadSanitizer reports");
#endif
    char cmd[600];
    if (system("ffmpeg -version >/dev/null 2>&1") != 0) /* NOLINT(cert-env33-c,*command-proc*) */
        T_SKIP("no ffmpeg");
    begin();
    write_avi(at("cam0.avi"), 12);
    snprintf(cmd, sizeof cmd,
             "cd '%s' && ffmpeg -v error -i cam0.avi -vf "
             "'select=not(eq(n\\,0)+eq(n\\,3)+eq(n\\,8))' -vsync passthrough -c:v ffv1 -pix_fmt "
             "bgr0 cam1.mkv",
             dir);
    T_EQ_I(system(cmd), 0); /* NOLINT(cert-env33-c,bugprone-command-processor) */
    cameras(2, true);
    r.cfg.sets.period_ns = 40 * PVX_NS_PER_MS;
    for (int c = 0; c < 2; c++) {
        snprintf(r.uri[c], sizeof r.uri[c], "files:%s/cam%d.%s", dir, c, c == 0 ? "avi" : "mkv");
        r.cam[c].width = VW;
        r.cam[c].height = VH;
        r.cam[c].fmt = CAP_RGB8;
        r.cam[c].fps = 25;
    }
    rig_start(&r);
    struct cap_set *s;
    int k = 0;
    for (; next(&s) == PVX_OK; k++) {
        T_EQ_I(s->frame[1] != NULL, k != 0 && k != 3 && k != 8);
        for (int i = 0; i < 2; i++)
            if (s->frame[i] != NULL)
                T_EQ_I(((const uint8_t *)s->frame[i]->img.data)[0], k * 10);
        cap_set_release(s);
    }
    T_EQ_I(k, 12);
    rig_end(&r);
    scratch_remove();
}

/* A TIFF file of two grey pages. */
static void write_stack(const char *path)
{
    enum { TAGS = 9, PAGE = 2 + 12 * TAGS + 4, PIXELS = 8 + 2 * PAGE };
    uint8_t file[PIXELS + W * H] = {'I', 'I', 42, 0, 8};
    for (uint32_t p = 0; p < 2; p++) {
        const uint32_t tag[TAGS][2] = {{256, W},      {257, H}, {258, 8}, {259, 1},    {262, 1},
                                       {273, PIXELS}, {277, 1}, {278, H}, {279, W * H}};
        uint8_t *at = file + 8 + p * PAGE;
        const uint32_t next = p == 0 ? 8 + PAGE : 0;
        *at = TAGS;
        for (int i = 0; i < TAGS; i++) {
            uint8_t *t = at + 2 + 12 * i;
            t[0] = (uint8_t)tag[i][0];
            t[1] = 1;
            t[2] = 3; /* one SHORT */
            t[4] = 1;
            t[8] = (uint8_t)tag[i][1];
            t[9] = (uint8_t)(tag[i][1] >> 8);
        }
        at[PAGE - 4] = (uint8_t)next;
    }
    FILE *f = fopen(path, "wb");
    T_OK(f != NULL && fwrite(file, sizeof file, 1, f) == 1);
    if (f != NULL)
        fclose(f);
}

/* Opens cameras of these names below the folder; `says`: the error of one of them. */
static void opens(const char *a, const char *b, const char *says)
{
    struct cap_set *s;
    cameras(2, true);
    for (int c = 0; c < 2; c++) {
        snprintf(r.uri[c], sizeof r.uri[c], "files:%s/%s", dir, c == 0 ? a : b);
        r.cam[c].width = r.cam[c].height = 0;
        r.cam[c].fmt = CAP_FMT_NONE;
    }
    rig_start(&r);
    while (next(&s) == PVX_OK)
        cap_set_release(s);
    rig_stats(&r);
    const char *e = r.st.camera[0].error, *f = r.st.camera[1].error; /* whichever is opened last */
    T_OK((*e == '\0' || *f == '\0') && (*says != '\0' || (*e == '\0' && *f == '\0')));
    T_CONTAINS(*e != '\0' ? e : f, says);
    rig_end(&r);
}

/* Stacks whose first files differ, and numbers that never meet, are refused, as by reconstruct. */
T_CASE(cameras_begin_together)
{
    begin();
    for (int c = 0; c < 2; c++)
        for (int k = 1; k <= 2; k++)
            write_stack(at("cam%d/rec_%d.tif", c, k + c));
    opens("cam0", "cam1", "is the first file, and");
    T_EQ_I(rename(at("cam1/rec_3.tif"), at("cam1/rec_1.tif")), 0);
    opens("cam0", "cam1", "");
    for (int k = 0; k < 3; k++) {
        write_image(2, k, "npy", W);
        write_image(3, k + 10, "npy", W);
    }
    opens("cam2", "cam3", "none is of one instant");
    write_image(3, 2, "npy", W);
    opens("cam2", "cam3", "");
    scratch_remove();
}

/* Image number and camera, of a recording whose first image is -3 or -1. */
static unsigned of_image(int k, int x, int y)
{
    return (unsigned)(k * 100 + y * 10 + x);
}

/* Two makes with one trigger: images of one instant go together, and the times before the trigger are times. */
T_CASE(high_speed_cameras_meet_at_their_trigger)
{
    begin();
    struct cine_file c = {.w = W,
                          .h = H,
                          .n = 6,
                          .first = -3,
                          .bits = 12,
                          .version = 1,
                          .trigger = 1700000000ull << 32,
                          .begin = (1700000000ull << 32) - 3 * ((1ull << 32) / 50000),
                          .step = (1ull << 32) / 50000,
                          .tag = 1002,
                          .sample = of_image};
    cine_save(at("cam0.cine"), &c);
    mraw_save(at("cam1.mraw"), of_image, W, H, 6, 16);
    FILE *f = fopen(at("cam1.cih"), "w");
    T_OK(f != NULL);
    fprintf(f,
            "Record Rate(fps) : 50000\nTotal Frame : 6\nStart Frame : -1\nImage Width : %d\n"
            "Image Height : %d\nColor Type : Mono\nColor Bit : 16\nEffectiveBit Depth : 12\n"
            "EffectiveBit Side : Lower\nEND\n",
            W, H);
    fclose(f);
    cameras(2, true);
    r.cfg.fps = 50000;
    for (int i = 0; i < 2; i++) {
        snprintf(r.uri[i], sizeof r.uri[i], "files:%s/cam%d.%s", dir, i, i == 0 ? "cine" : "mraw");
        r.cam[i].fmt = CAP_FMT_NONE;
        r.cam[i].fps = 0;
    }
    rig_start(&r);
    struct cap_set *s;
    int k = 0;
    for (; next(&s) == PVX_OK; k++) {
        T_EQ_I(s->frame[0] != NULL, k < 6);
        T_EQ_I(s->frame[1] != NULL, k >= 2);
        for (int i = 0; i < 2; i++) {
            uint16_t v;
            if (s->frame[i] == NULL)
                continue;
            memcpy(&v, s->frame[i]->img.data, 2);
            T_EQ_I(s->frame[i]->img.fmt, CAP_GREY12);
            T_EQ_I(v, (k - 2 * i) * 100);
            T_NEAR(s->frame[i]->t_device_ns, PVX_NS_PER_S + k * 20000, 3);
        }
        cap_set_release(s);
    }
    T_EQ_I(k, 8);
    rig_end(&r);
    scratch_remove();
}

T_MAIN((plugins_of_this_build(), pvx_log_set_level(PVX_LOG_ERROR)), (void)0)
