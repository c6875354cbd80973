/* test_cli_light.c - `pyrovox calibrate response, dark, flat, gain, colour` as a user runs them, on cameras whose
 * faults are known: what they wrote is near the truth, and what they should refuse they refuse. */
#include "../t.h"

#include <cjson/cJSON.h>
#include <stdbool.h>

#include "capture/files/imgio.h"
#include "capture/pixel/maps.h"
#include "recon/geom/rig.h"
#include "recon/view/flame.h"
#include "tests/lib/cli.h"
#include "tests/lib/light_camera.h"

enum { W = 96, H = 72, N = 4 };

static struct rec_rig rig;
static uint64_t noise = 5;

static struct light_camera healthy(size_t c)
{
    return (struct light_camera){.w = W,
                                 .h = H,
                                 .gain = 1,
                                 .pedestal = 0.02,
                                 .read = 0.002,
                                 .shot = 2e-5,
                                 .corner = 0.5,
                                 .full = 65535,
                                 .hot_x = -1,
                                 .dead_x = -1,
                                 .seed = 7 + c};
}

/* Radiance at a pixel. */
typedef double (*scene)(size_t camera, int group, int x, int y);

/* `pictures` of each camera into DIR/name. */
static void take(const char *name, const struct light_camera *cam, int group, int pictures, scene s)
{
    static uint16_t px[W * H];
    static uint8_t px8[W * H];
    struct pvx_diag d = {""};
    for (size_t c = 0; c < N; c++) {
        T_EQ_I(pvx_mkdirs(at("%s/%s", name, rig.cameras[c].name), &d), PVX_OK);
        for (int f = 0; f < pictures; f++) {
            for (int i = 0; i < W * H; i++) {
                px[i] = (uint16_t)light_sample(&cam[c], i % W, i / W, s(c, group, i % W, i / W),
                                               &noise);
                px8[i] = (uint8_t)px[i];
            }
            bool eight = cam[c].full == 255;
            T_EQ_I(cap_image_write(at("%s/%s/%06d.png", name, rig.cameras[c].name, f),
                                   eight ? (void *)px8 : (void *)px, W, H, 1, eight ? 8 : 16, &d),
                   PVX_OK);
        }
    }
    T_EQ_S(d.text, "");
}

static struct rec_rig load(const char *name)
{
    struct rec_rig r = {.n_cameras = 0};
    struct pvx_diag d = {""};
    T_EQ_I(rec_rig_load(at("%s", name), &r, &d), PVX_OK);
    T_EQ_S(d.text, "");
    return r;
}

static double nothing(size_t c, int g, int x, int y)
{
    (void)c, (void)g, (void)x, (void)y;
    return 0;
}

/* A panel whose tilt turns by a quarter from place to place, not quite. */
static double panel(size_t c, int g, int x, int y)
{
    double u = 2.0 * x / W - 1, v = 2.0 * y / H - 1, turn = 1.5707963 * g + 0.05 * (double)c;
    double bright = 0.55 + 0.05 * g;
    return bright * (1 + 0.12 * (u * cos(turn) + v * sin(turn)) + 0.005 * (g - 1.5) * u);
}

/* ---- response ---- */

/* Uneven steps, ms. */
enum { STEPS = 12 };
static const double steps[STEPS] = {0.8, 1.1, 1.7, 2.3, 3.5, 5, 8, 11, 17, 24, 37, 55};

static double ladder(size_t c, int g, int x, int y)
{
    (void)c, (void)y;
    return steps[g] / 64 * (0.3 + 1.2 * x / W);
}

static void ladder_takes(const char *name, const struct light_camera *cam, scene of, char *args,
                         size_t size)
{
    for (int g = 0; g < STEPS; g++) {
        char folder[40];
        snprintf(folder, sizeof folder, "%s%d", name, g);
        take(folder, cam, g, 4, of);
        size_t n = strlen(args);
        snprintf(args + n, size - n, " --frames %s --exposure %g", folder, steps[g]);
    }
}

T_CASE_OF_THREADS(response_is_linear_to_half_a_percent)
{
    struct light_camera cam[N];
    char args[1500] = "calibrate response --rig rig.yaml --out response.yaml";
    static const double bends[N] = {0, 0.3, 0.6, 0.9};
    for (size_t c = 0; c < N; c++) {
        cam[c] = healthy(c);
        cam[c].bend = bends[c];
        cam[c].pedestal = 0.004;
        if (c % 2 == 1)
            cam[c].full = 255;
    }
    ladder_takes("e", cam, ladder, args, sizeof args);
    T_EQ_I(pyrovox(args), 0);
    T_EQ_S(slurp("err"), "response.yaml written\n");
    struct rec_rig r = load("response.yaml");
    for (size_t c = 0; c < N; c++) {
        const struct rec_photometry *p = &r.cameras[c].photometry;
        double worst = 0, s[5] = {0}; /* from the best line: an offset is the dark's */
        T_EQ_I(p->n_response, 33);
        for (int pass = 0; pass < 2; pass++)
            for (double l = 0.05; l <= 0.95; l += 0.01) {
                double v = cap_response(p->response, p->n_response, light_curve(&cam[c], l));
                double b = (s[0] * s[4] - s[1] * s[3]) / (s[0] * s[2] - s[1] * s[1]);
                if (pass == 1)
                    worst = fmax(worst, fabs(v - (s[3] - b * s[1]) / s[0] - b * l));
                s[0] += pass == 0;
                s[1] += pass == 0 ? l : 0;
                s[2] += pass == 0 ? l * l : 0;
                s[3] += pass == 0 ? v : 0;
                s[4] += pass == 0 ? l * v : 0;
            }
        printf("  bend %.1f, %u: at most %.4f from linear\n", bends[c], cam[c].full, worst);
        T_LE(worst, 0.005);
    }
    rec_rig_fini(&r);
}

static double falling(size_t c, int g, int x, int y)
{
    return ladder(c, g == 4 ? 1 : g, x, y);
}

T_CASE(ladders_that_are_none)
{
    struct light_camera cam[N];
    for (size_t c = 0; c < N; c++)
        cam[c] = healthy(c);
    char args[1500] = "";
    ladder_takes("f", cam, falling, args, sizeof args);
    refused(
        "calibrate response --rig rig.yaml --out no.yaml --frames f3 --exposure 2.3 --frames f4 "
        "--exposure 3.5 --frames f5 --exposure 5 --frames f6 --exposure 8",
        "the samples fall while the exposure rises from 2.3 to 3.5 ms");
    refused(
        "calibrate response --rig rig.yaml --out no.yaml --frames f0 --exposure 0.8 --frames f1 "
        "--exposure 1.1 --frames f2 --exposure 1.7 --frames f3 --exposure 2.3",
        "of the range only");
    refused("calibrate response --rig rig.yaml --out no.yaml --frames f0 --exposure 1 --frames f1 "
            "--exposure 2 --frames f2 --exposure 4 --frames f3 --exposure 8",
            "make the steps uneven");
    refused("calibrate response --rig rig.yaml --out no.yaml --frames f0 --frames f1 --exposure 2 "
            "--frames f2 --exposure 4 --frames f3 --exposure 8",
            "its exposure is not known");
    refused("calibrate response --rig rig.yaml --out no.yaml --frames f0 --exposure 1",
            "1 exposures: a response needs 4");
}

/* ---- dark, flat, gain ---- */

static double even(size_t c, int g, int x, int y)
{
    (void)c, (void)g, (void)x, (void)y;
    return 0.4;
}

static const double gains[N] = {1.0, 0.8, 1.1, 0.95};

static struct light_camera *faulty(void)
{
    static struct light_camera cam[N];
    for (size_t c = 0; c < N; c++) {
        cam[c] = healthy(c);
        cam[c].gain = gains[c];
        cam[c].hot_x = 10 + (int)c;
        cam[c].hot_y = 20;
        cam[c].dead_x = 50;
        cam[c].dead_y = 30 + (int)c;
    }
    return cam;
}

static void check_dark(void)
{
    struct rec_rig r = load("dark.yaml");
    for (size_t c = 0; c < N; c++) {
        float *v;
        size_t shape[4];
        int ndim;
        struct pvx_diag d = {""};
        const struct rec_photometry *p = &r.cameras[c].photometry;
        T_NEAR(p->exposure, 0.005, 1e-9);
        T_EQ_I(cap_npy_load(at("%s", p->dark.file), &v, shape, &ndim, &d), PVX_OK);
        T_EQ_I(shape[0] * shape[1], W * H);
        double sum2 = 0;
        for (int i = 0; i < W * H; i++) {
            bool hot = i % W == 10 + (int)c && i / W == 20;
            T_EQ_I(isnan(v[i]), hot);
            if (!hot)
                sum2 += pow((double)v[i] - 0.02, 2);
        }
        T_LE(sqrt(sum2 / (W * H)), 0.002 / 3); /* 16 pictures: a quarter of the noise */
        free(v);
    }
    rec_rig_fini(&r);
}

/* To 1 % rms, up to a factor; the dead pixel is marked. */
static void check_flat(const struct light_camera *cam)
{
    struct rec_rig r = load("flat.yaml");
    for (size_t c = 0; c < N; c++) {
        float *v;
        size_t shape[4];
        int ndim;
        struct pvx_diag d = {""};
        const struct rec_photometry *p = &r.cameras[c].photometry;
        T_EQ_I(cap_npy_load(at("%s", p->flat.file), &v, shape, &ndim, &d), PVX_OK);
        double sv = 0, st = 0, sum2 = 0;
        for (int pass = 0; pass < 2; pass++)
            for (int i = 0; i < W * H; i++) {
                double truth = light_sensitivity(&cam[c], i % W, i / W);
                if (!isfinite(v[i]))
                    continue;
                sv += pass == 0 ? (double)v[i] : 0;
                st += pass == 0 ? truth : 0;
                sum2 += pass == 1 ? pow((double)v[i] * st / sv / truth - 1, 2) : 0;
            }
        double rms = sqrt(sum2 / (W * H));
        printf("  flat of camera %zu: %.4f rms; noise %.5f, %.3g (truth 0.002, 2e-5)\n", c, rms,
               p->read_noise, p->noise_gain);
        T_LE(rms, 0.01);
        T_OK(isnan(v[(30 + (int)c) * W + 50]));
        T_NEAR(p->read_noise, 0.002, 0.0003);
        T_NEAR(p->noise_gain, 2e-5, 3e-6);
        free(v);
    }
    rec_rig_fini(&r);
}

static void check_gain(const char *name)
{
    struct rec_rig r = load(name);
    double mean = 0, product = 0;
    for (size_t c = 0; c < N; c++)
        mean += log(gains[c]) / N;
    for (size_t c = 0; c < N; c++) {
        double want = exp(mean) / gains[c], got = (double)r.cameras[c].gain[1];
        printf("  %s camera %zu: gain %.4f, want %.4f\n", name, c, got, want);
        T_LE(fabs(got / want - 1), 0.02);
        product += log(got);
    }
    T_NEAR(product, 0, 1e-6);
    rec_rig_fini(&r);
}

static float shown[N][W * H];

static double a_flame(size_t c, int g, int x, int y)
{
    (void)g;
    return 0.5 * (double)shown[c][y * W + x];
}

T_CASE(dark_flat_and_gain_in_their_order)
{
    struct light_camera *cam = faulty();
    take("dark", cam, 0, 16, nothing);
    T_EQ_I(pyrovox("calibrate dark --rig rig.yaml --frames dark --exposure 5 --out dark.yaml"), 0);
    check_dark();
    take("p0", cam, 0, 8, panel);
    take("p1", cam, 1, 8, panel);
    take("p2", cam, 2, 8, panel);
    take("p3", cam, 3, 8, panel);
    T_EQ_I(pyrovox("calibrate flat --rig dark.yaml --frames p0 --frames p1 --frames p2 --frames p3 "
                   "--out flat.yaml"),
           0);
    check_flat(cam);
    take("even", cam, 0, 4, even);
    T_EQ_I(pyrovox("calibrate gain --rig flat.yaml --frames even --out gain.yaml"), 0);
    check_gain("gain.yaml");
    struct rec_flame flame;
    struct rec_flame_pose pose;
    rec_flame_init(&flame, &rig.grid, 3);
    rec_flame_at(&flame, 0.4, &pose);
    static float img[W * H * 3];
    for (size_t c = 0; c < N; c++) {
        rec_flame_render(&pose, &rig.cameras[c], 2, 0, H, img);
        for (size_t i = 0; i < W * H; i++)
            shown[c][i] = img[i * 3];
    }
    take("flame", cam, 0, 8, a_flame);
    T_EQ_I(pyrovox("calibrate gain --flame --rig flat.yaml --frames flame --out flame.yaml"), 0);
    check_gain("flame.yaml");
    /* a flame that stands still among four cameras tells nothing beyond */
    T_CONTAINS(slurp("out.txt"), "integrated emission alone: the 2 sets that were held out");
    /* the same rig again, and nothing of the older ones was touched */
    T_EQ_I(pyrovox("calibrate gain --rig flat.yaml --frames even --out gain.yaml"), 1);
    T_CONTAINS(slurp("err"), "--force");
    check_dark();
}

/* ---- a flame that is cut off ---- */

static struct rec_flame moving;
static struct rec_rig seen; /* as the cameras stand there */

/* Two thirds of the flame are in the picture of camera 2. */
static void cut_rig(void)
{
    T_EQ_I(rec_rig_copy(&rig, &seen), PVX_OK);
    seen.cameras[2].cx -= 40;
    write_rig("cut.yaml", &seen);
}

/* Of how many channels, and what a camera makes of each beside its gain. */
static double tint(size_t c, int channel)
{
    return channel == 1 ? 1 : 1 + 0.05 * ((int)c - 1.5) * (channel - 1);
}

static void take_moving(const char *name, const struct light_camera *cam, int sets, int channels)
{
    static float img[W * H * 3];
    static uint16_t px[W * H * 3];
    struct rec_flame_pose pose;
    struct pvx_diag d = {""};
    for (size_t c = 0; c < N; c++) {
        T_EQ_I(pvx_mkdirs(at("%s/%s", name, rig.cameras[c].name), &d), PVX_OK);
        for (int f = 0; f < sets; f++) {
            rec_flame_at(&moving, 0.1 * f, &pose);
            rec_flame_render(&pose, &seen.cameras[c], 2, 0, H, img);
            for (int i = 0; i < W * H * channels; i++) {
                int p = i / channels, k = i % channels;
                double light = 0.5 * (double)img[p * 3 + k] * (channels == 3 ? tint(c, k) : 1);
                px[i] = (uint16_t)light_sample(&cam[c], p % W, p / W, light, &noise);
            }
            T_EQ_I(cap_image_write(at("%s/%s/%06d.png", name, rig.cameras[c].name, f), px, W, H,
                                   channels, 16, &d),
                   PVX_OK);
        }
    }
}

T_CASE(a_camera_that_sees_two_thirds_of_the_flame)
{
    struct light_camera cam[N];
    for (size_t c = 0; c < N; c++) {
        cam[c] = healthy(c);
        cam[c].corner = 1;
        cam[c].pedestal = 0;
        cam[c].gain = gains[c];
    }
    cut_rig();
    rec_flame_init(&moving, &rig.grid, 3);
    take_moving("part", cam, 6, 1);
    T_EQ_I(pyrovox("calibrate gain --flame --quiet --rig cut.yaml --frames part --out part.yaml "
                   "--report part.json"),
           0);
    T_CONTAINS(slurp("out.txt"), "cam2 ");
    T_CONTAINS(slurp("out.txt"), "at the picture's border");
    T_CONTAINS(slurp("out.txt"), "by the volumes of the others only");
    check_gain("part.yaml");
    cJSON *j = cJSON_Parse(slurp("part.json"));
    const cJSON *k = cJSON_GetArrayItem(cJSON_GetObjectItem(j, "cameras"), 2);
    const cJSON *o = cJSON_GetArrayItem(cJSON_GetObjectItem(j, "colours"), 0);
    T_EQ_S(cJSON_GetStringValue(cJSON_GetObjectItem(k, "name")), "cam2");
    T_OK(cJSON_IsNull(cJSON_GetArrayItem(cJSON_GetObjectItem(k, "integrated"), 0)));
    T_OK(cJSON_IsTrue(cJSON_GetObjectItem(o, "accepted")));
    T_OK(cJSON_GetObjectItem(o, "unseen_after")->valuedouble <
         cJSON_GetObjectItem(o, "unseen_before")->valuedouble);
    cJSON_Delete(j);
    /* two sets tell nothing beyond the integrated emission, which that camera has not */
    take_moving("few", cam, 2, 1);
    refused("calibrate gain --flame --quiet --rig cut.yaml --frames few --out no.yaml",
            "nor do the volumes of the others tell: 2 frame sets");
    T_EQ_I(pyrovox(
               "calibrate gain --flame --rig cut.yaml --frames part --out no.yaml --report a.html"),
           1);
    T_CONTAINS(slurp("err"), "a.html: this report is written as .json");
    /* each colour of colour cameras by itself */
    take_moving("colours", cam, 3, 3);
    T_EQ_I(pyrovox(
               "calibrate gain --flame --quiet --rig cut.yaml --frames colours --out colours.yaml"),
           0);
    check_gain("colours.yaml");
    struct rec_rig r = load("colours.yaml");
    for (size_t c = 0; c < N; c++) /* tints have a product near 1 */
        T_LE(fabs((double)r.cameras[c].gain[0] * tint(c, 0) / (double)r.cameras[c].gain[1] - 1),
             0.02);
    rec_rig_fini(&r);
    rec_rig_fini(&seen);
}

/* ---- the volume ---- */

/* |a - s b| / |a| of two volumes, s the best. */
static double apart(const char *a, const char *b)
{
    float *v[2];
    size_t shape[4], n = 0;
    int ndim;
    struct pvx_diag d = {""};
    double ab = 0, bb = 0, aa = 0;
    T_EQ_I(cap_npy_load(at("%s/000000.npy", a), &v[0], shape, &ndim, &d), PVX_OK);
    T_EQ_I(cap_npy_load(at("%s/000000.npy", b), &v[1], shape, &ndim, &d), PVX_OK);
    T_EQ_S(d.text, "");
    n = shape[0] * shape[1] * shape[2] * shape[3];
    for (size_t i = 0; i < n; i++) {
        aa += (double)v[0][i] * (double)v[0][i];
        ab += (double)v[0][i] * (double)v[1][i];
        bb += (double)v[1][i] * (double)v[1][i];
    }
    free(v[0]);
    free(v[1]);
    return sqrt(fmax(0, aa - ab * ab / bb) / aa);
}

/* By the rigs of the case before. */
T_CASE(the_volume_is_that_of_healthy_cameras)
{
    struct light_camera cam[N];
    for (size_t c = 0; c < N; c++) {
        cam[c] = healthy(c);
        cam[c].corner = 1;
        cam[c].pedestal = 0.0;
    }
    take("healthy", cam, 0, 1, a_flame);
    T_EQ_I(pyrovox("reconstruct --quiet --rig rig.yaml --frames healthy --out v-healthy"), 0);
    T_EQ_I(pyrovox("reconstruct --quiet --rig gain.yaml --frames flame --last 0 --out v-measured"),
           0);
    T_EQ_I(
        pyrovox(
            "reconstruct --quiet --rig rig.yaml --black 0.02 --frames flame --last 0 --out v-raw"),
        0);
    double measured = apart("v-healthy", "v-measured"), raw = apart("v-healthy", "v-raw");
    printf("  from the healthy cameras' volume: measured %.3f, black level only %.3f\n", measured,
           raw);
    T_LE(measured, 0.08); /* their noise is in both */
    T_LE(2.5 * measured, raw);
}

/* By the rig with maps of the cases before: one that is written elsewhere finds them. */
T_CASE(a_rig_that_is_saved_elsewhere)
{
    T_EQ_I(pvx_mkdirs(at("else/where"), NULL), PVX_OK);
    T_EQ_I(pyrovox("reconstruct --quiet --rig gain.yaml --frames flame --last 0 --fit-volume "
                   "--save-rig else/where/tight.yaml"),
           0);
    struct rec_rig r = load("else/where/tight.yaml");
    T_EQ_I(strncmp(r.cameras[1].photometry.dark.file, "../../cam1-dark-", 16), 0);
    rec_rig_fini(&r);
    T_EQ_I(pyrovox("reconstruct --quiet --rig else/where/tight.yaml --frames flame --last 0 --out "
                   "v-else"),
           0);
}

/* ---- what is refused ---- */

static double lit_corner(size_t c, int g, int x, int y)
{
    (void)g;
    return c == 1 ? 0.1 * x * y / (W * H) : 0;
}
static double too_bright(size_t c, int g, int x, int y)
{
    return c == 2 ? 3 * panel(c, g, x, y) : panel(c, g, x, y);
}
static double shadowed(size_t c, int g, int x, int y)
{
    return c == 3 && x >= W / 2 && y < H / 4 ? 0.002 : panel(c, g, x, y);
}

T_CASE(pictures_that_are_no_measure)
{
    struct light_camera *cam = faulty();
    take("one", cam, 0, 2, panel);
    take("lit", cam, 0, 4, lit_corner);
    take("bright", cam, 1, 2, too_bright);
    take("shadow", cam, 2, 2, shadowed);
    refused("calibrate dark --rig rig.yaml --frames one --out no.yaml",
            "2 dark pictures; take 4 or more");
    refused("calibrate dark --rig rig.yaml --frames lit --out no.yaml",
            "camera cam1: there is light in the darks");
    refused("calibrate dark --rig rig.yaml --frames one --frames lit --out no.yaml",
            "darks of one exposure");
    refused("calibrate flat --rig rig.yaml --frames one --out no.yaml",
            "camera cam0: one picture cannot tell the lens from the source");
    refused("calibrate flat --rig rig.yaml --frames one --frames bright --out no.yaml",
            "camera cam2: picture 2 is saturated");
    refused("calibrate flat --rig rig.yaml --frames one --frames shadow --out no.yaml",
            "camera cam3: picture 2 is dark from 48,0 on (12 x 9 pixels)");
    refused("calibrate gain --rig rig.yaml --frames bright --out no.yaml",
            "camera cam2: bright is saturated");
    refused("calibrate gain --rig rig.yaml --frames lit --out no.yaml", "is dark in the middle");
    refused("calibrate gain --flame --rig rig.yaml --frames one --out no.yaml",
            "at the picture's border");
    refused("calibrate colour --rig rig.yaml --frames one --out no.yaml", "is grey");
    T_EQ_I(pyrovox("calibrate dark --rig rig.yaml --out no.yaml"), 2);
    T_EQ_I(pyrovox("calibrate dark --rig rig.yaml --exposure 3 --frames one --out no.yaml"), 2);
}

/* A map that is another file, or of another size, is not taken. */
T_CASE(maps_that_are_not_the_rigs)
{
    struct light_camera *cam = faulty();
    struct pvx_diag d = {""};
    take("dark", cam, 0, 4, nothing);
    T_EQ_I(pyrovox("calibrate dark --rig rig.yaml --frames dark --out maps.yaml"), 0);
    struct rec_rig r = load("maps.yaml");
    char file[REC_MAP_FILE_MAX];
    snprintf(file, sizeof file, "%s", r.cameras[2].photometry.dark.file);
    static const float few[4];
    const size_t shape[2] = {2, 2};
    T_EQ_I(cap_npy_save(at("%s", file), few, shape, 2, &d), PVX_OK);
    refused("calibrate gain --rig maps.yaml --frames dark --out no.yaml",
            "is not the file that this rig was made with");
    T_EQ_I(remove(at("%s", file)), 0);
    refused("calibrate gain --rig maps.yaml --frames dark --out no.yaml", "camera cam2");
    rec_rig_fini(&r);
}

static void begin(void)
{
    cli_begin();
    if (rec_rig_ring(N, 2.5, W, H, 16, &rig) != PVX_OK)
        exit(1);
    write_rig("rig.yaml", &rig);
}

static void end(void)
{
    rec_rig_fini(&rig);
    scratch_remove();
}

T_MAIN(begin(), end())
