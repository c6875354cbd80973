/* test_film.c - what linear values look like, pictures into one file. */
#include "tests/t.h"

#include <stdlib.h>
#include <unistd.h>

#include "base/file.h"
#include "capture/files/imgio.h"
#include "daemon/cli/pictures/film.h"
#include "tests/lib/plugins.h"
#include "tests/lib/scratch.h"

static const float nan_inf[3] = {NAN, INFINITY, -INFINITY};

/* (1) of look.h, its formulas once more. */
T_CASE(tones)
{
    float pix[300];
    for (int i = 0; i < 300; i++)
        pix[i] = (float)(0.00002 * pow(1.06, i)); /* to 740 */
    for (int tone = LOOK_CLIP; tone <= LOOK_FILMIC; tone++)
        for (int depth = 8; depth <= 16; depth += 8) {
            struct look l = {
                .exposure = 2, .gamma = 2.2, .tone = (enum look_tone)tone, .depth = depth};
            uint16_t wide[300];
            look_samples(&l, pix, 100, 3, wide);
            for (int i = 0; i < 300; i++) {
                int at = i / 3 * 3;
                double v = 2 * (double)pix[i];
                double L = 2 * (0.2126 * (double)pix[at] + 0.7152 * (double)pix[at + 1] +
                                0.0722 * (double)pix[at + 2]);
                double x = tone == LOOK_CLIP ? v
                           : tone == LOOK_REINHARD
                               ? v / L * (L * (1 + L / 16) / (1 + L))
                               : (2.51 * v * v + 0.03 * v) / (2.43 * v * v + 0.59 * v + 0.14);
                double want = ((1 << depth) - 1) * pow(fmin(x, 1), 1 / 2.2);
                double got = depth == 16 ? wide[i] : ((const uint8_t *)wide)[i];
                T_NEAR(got, want, 0.50001);
                T_OK(i < 3 || got >= (depth == 16 ? wide[i - 3] : ((const uint8_t *)wide)[i - 3]));
            }
            look_samples(&l, nan_inf, 1, 3, wide);
            const uint8_t *b = (const uint8_t *)wide;
            T_OK(depth == 16 ? wide[0] == 0 && wide[2] == 0 : b[0] == 0 && b[2] == 0);
        }
    uint8_t one;
    float grey = 0.25f;
    look_samples(&(struct look){.exposure = 0, .gamma = 1, .depth = 8}, &grey, 1, 1, &one);
    T_EQ_I(one, 64);
}

T_CASE(sixteen_bits_in_a_file)
{
    struct pvx_diag d = {""};
    struct look l = {.exposure = 1, .gamma = 1, .depth = 16};
    float pix[12];
    for (int i = 0; i < 12; i++)
        pix[i] = (float)(i * 1000 + 1) / 65535;
    T_EQ_I(look_save(&l, at("deep.png"), pix, 2, 2, 3, &d), PVX_OK);
    struct cap_loaded got;
    T_EQ_I(cap_image_load(at("deep.png"), &got, &d), PVX_OK);
    T_EQ_I(got.img.fmt, CAP_RGB16);
    for (int i = 0; i < 12; i++)
        T_EQ_I(((const uint16_t *)got.img.data)[i], i * 1000 + 1);
    cap_loaded_free(&got);
}

enum { W = 37, H = 22, N = 6 }; /* odd: a video is a pixel wider */

static void picture(int k, int nch, float *pix)
{
    for (int i = 0; i < W * H; i++)
        for (int c = 0; c < nch; c++)
            pix[i * nch + c] = 0.02f * (float)(i % W) + 0.1f * (float)((k + c) % N);
}

static void film_of(const char *path, int nch, struct pvx_diag *d)
{
    struct film *f;
    float pix[W * H * 3];
    T_EQ_I(film_new(path, 10, &(struct look){.exposure = 1, .gamma = 1, .depth = 8}, &f, d),
           PVX_OK);
    for (int k = 0; k < N; k++) {
        picture(k, nch, pix);
        T_EQ_I(film_add(f, pix, W, H, nch, d), PVX_OK);
    }
    T_EQ_I(film_add(f, pix, W - 1, H, nch, d), PVX_EFORMAT);
    T_OK(access(path, F_OK) != 0); /* whole or not at all */
    T_EQ_I(film_end(&f, d), PVX_OK);
    T_OK(f == NULL);
}

/* Every kind of film holds its pictures in order, in the colours that they had. */
T_CASE(pictures_in_one_file)
{
    static const char *const names[] = {"f.apng", "f.mp4", "f.mov", "f.mkv", "f.webm"};
    struct pvx_diag d = {""};
    T_OK(!film_named("x.png"));
    for (int q = 0; q < 5; q++)
        for (int nch = 1; nch <= 3; nch += 2) {
            film_of(at("%s", names[q]), nch, &d);
            cap_video *v;
            struct cap_video_info info;
            struct cap_image img;
            double far = 0;
            float pix[W * H * 3];
            T_EQ_I(cap_video_open(at("%s", names[q]), &v, &info, &d), PVX_OK);
            T_NEAR(info.fps, 10, 0.01);
            for (int k = 0; k < N; k++) {
                picture(k, nch, pix);
                T_EQ_I(cap_video_next(v, &img, NULL, &d), PVX_OK);
                T_OK(img.width >= W && img.width <= W + 1 && img.height == H);
                int got = cap_pixfmt_channels(img.fmt), of = got > nch ? 3 : 1;
                T_EQ_I(got, q == 0 ? nch : 3); /* the videos are YUV */
                for (int y = 0; y < H; y++)
                    for (int x = 0; x < got * W; x++)
                        far += fabs(fmin(255, 255 * pix[y * W * nch + x / of]) -
                                    ((const uint8_t *)img.data)[y * img.stride + x]) *
                               3 / got;
            }
            T_LE(far / (N * W * H * 3), q == 0 ? 0.5 : 4); /* a neighbouring picture is 17 away */
            T_EQ_I(cap_video_next(v, &img, NULL, &d), PVX_ECLOSED);
            cap_video_close(&v);
            T_EQ_I(unlink(at("%s", names[q])), 0);
        }
}

/* No ffmpeg, none that works, a folder that is not there: a line, and nothing left behind. */
T_CASE(videos_that_fail)
{
    struct pvx_diag d = {""};
    struct film *f;
    float pix[W * H * 3] = {0};
    const char *had = getenv("PATH");
    char *path = strdup(had != NULL ? had : "/usr/bin:/bin");
    T_EQ_I(film_new("f.avi", 10, &look_defaults, &f, &d), PVX_EINVAL);
    d.text[0] = '\0';
    T_EQ_I(film_new(at("none/f.mp4"), 10, &look_defaults, &f, &d), PVX_OK);
    pvx_err e = PVX_OK;
    for (int k = 0; k < 1000 && e == PVX_OK; k++)
        e = film_add(f, pix, W, H, 3, &d);
    pvx_err last = film_end(&f, &d);
    T_OK(e != PVX_OK || last != PVX_OK);
    T_CONTAINS(d.text, "none/f.mp4: ffmpeg");
    T_EQ_I(setenv("PATH", at("."), 1), 0);
    d.text[0] = '\0';
    T_EQ_I(film_new(at("f.mp4"), 10, &look_defaults, &f, &d), PVX_OK);
    T_EQ_I(film_add(f, pix, W, H, 3, &d), PVX_ENOENT);
    T_CONTAINS(d.text, "apt install ffmpeg");
    T_EQ_I(film_end(&f, &d), PVX_OK); /* it had not begun */
    static const char fake[] = "#!/bin/sh\necho 'no disk today' >&2\nexit 3\n";
    T_EQ_I(pvx_file_write(at("ffmpeg"), fake, sizeof fake - 1, &d), PVX_OK);
    T_EQ_I(chmod(at("ffmpeg"), 0755), 0);
    d.text[0] = '\0';
    T_EQ_I(film_new(at("f.mp4"), 10, &look_defaults, &f, &d), PVX_OK);
    e = PVX_OK;
    for (int k = 0; k < 1000 && e == PVX_OK; k++)
        e = film_add(f, pix, W, H, 3, &d);
    last = film_end(&f, &d);
    T_OK(e != PVX_OK || last != PVX_OK);
    T_CONTAINS(d.text, "f.mp4: ffmpeg");
    T_OK(access(at("f.mp4"), F_OK) != 0);
    T_EQ_I(setenv("PATH", path, 1), 0);
    free(path);
    T_EQ_I(film_new(at("f.mp4"), 10, &look_defaults, &f, &d), PVX_OK); /* dropped: nothing */
    T_EQ_I(film_add(f, pix, W, H, 3, &d), PVX_OK);
    film_drop(&f);
    T_OK(access(at("f.mp4"), F_OK) != 0);
}

T_MAIN((scratch_new(), plugins_of_this_build()), scratch_remove())
