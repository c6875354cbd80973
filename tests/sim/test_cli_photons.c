/* test_cli_photons.c - `pyrovox calibrate colour` and `noise` as a user runs them, on cameras whose colours
 * and noise are known. */
#include "../t.h"

#include <stdbool.h>

#include "capture/files/imgio.h"
#include "recon/geom/rig.h"
#include "tests/lib/cli.h"
#include "tests/lib/light_camera.h"

enum { W = 96, H = 72, N = 3 };

static struct rec_rig rig;
static uint64_t random_state = 11;

/* ---- colour ---- */

/* What camera c makes of light of three colours: its filters overlap, and so does its gain. */
static const double filters[N][9] = {{0.9, 0.1, 0.02, 0.08, 0.8, 0.1, 0.01, 0.12, 0.7},
                                     {0.8, 0.2, 0.05, 0.1, 0.9, 0.2, 0.02, 0.05, 0.9},
                                     {0.7, 0.05, 0.01, 0.15, 0.75, 0.02, 0.06, 0.2, 0.8}};
static const double lamps[][3] = {
    {0.8, 0.1, 0.05}, {0.1, 0.7, 0.1}, {0.05, 0.1, 0.9}, {0.4, 0.4, 0.4}};
static const double greys[][3] = {{0.2, 0.2, 0.2}, {0.4, 0.4, 0.4}, {0.7, 0.7, 0.7}};

/* Pictures of a lamp, of every camera, into DIR/name; channels 1: its green. */
static void shine(const char *name, const double lamp[3], int channels)
{
    static uint16_t px[W * H * 3];
    struct pvx_diag d = {""};
    for (size_t c = 0; c < N; c++) {
        const struct light_camera cam = {.w = W,
                                         .h = H,
                                         .gain = 1,
                                         .read = 0.002,
                                         .shot = 2e-5,
                                         .corner = 1,
                                         .full = 65535,
                                         .hot_x = -1,
                                         .dead_x = -1,
                                         .seed = 3 + c};
        T_EQ_I(pvx_mkdirs(at("%s/%s", name, rig.cameras[c].name), &d), PVX_OK);
        for (int i = 0; i < W * H; i++)
            for (int k = 0; k < channels; k++) {
                const double *f = filters[c] + 3 * k;
                double light = f[0] * lamp[0] + f[1] * lamp[1] + f[2] * lamp[2];
                px[i * channels + k] =
                    (uint16_t)light_sample(&cam, i % W, i / W, light, &random_state);
            }
        T_EQ_I(cap_image_write(at("%s/%s/000000.png", name, rig.cameras[c].name), px, W, H,
                               channels, 16, &d),
               PVX_OK);
    }
}

/* The matrix of (1) in capture/pixel/maps.h makes each camera's lamps those of the reference, gains too. */
static void check_colours(const char *name, size_t to)
{
    struct rec_rig r;
    struct pvx_diag d = {""};
    T_EQ_I(rec_rig_load(at("%s", name), &r, &d), PVX_OK);
    for (size_t c = 0; c < N; c++) {
        const double *M = r.cameras[c].photometry.matrix, *A = filters[c], *B = filters[to];
        T_EQ_I(r.cameras[c].photometry.has_matrix, c != to);
        for (int a = 0; a < 3; a++)
            T_NEAR((double)r.cameras[c].gain[a], (double)rig.cameras[c].gain[a], 1e-6);
        double worst = 0, most = 0;
        for (int i = 0; i < 3 && c != to; i++)
            for (int j = 0; j < 3; j++) {
                double is = 0, want = (double)rig.cameras[to].gain[i] * B[3 * i + j];
                for (int k = 0; k < 3; k++)
                    is += M[3 * i + k] * (double)rig.cameras[c].gain[k] * A[3 * k + j];
                worst = fmax(worst, fabs(is - want));
                most = fmax(most, want);
            }
        printf("  %s camera %zu: at most %.5f off\n", name, c, worst);
        T_LE(worst, 0.01 * most);
    }
    rec_rig_fini(&r);
}

T_CASE(colours_to_one_camera)
{
    for (int k = 0; k < 4; k++) {
        char name[8];
        snprintf(name, sizeof name, "c%d", k);
        shine(name, lamps[k], 3);
    }
    T_EQ_I(pyrovox("calibrate colour --rig rig.yaml --frames c0 --frames c1 --frames c2 --frames "
                   "c3 --out first.yaml"),
           0);
    T_CONTAINS(slurp("out.txt"), "the others' colours become its");
    check_colours("first.yaml", 0);
    T_EQ_I(pyrovox("calibrate colour --rig first.yaml --to cam2 --frames c0 --frames c1 --frames "
                   "c2 --out third.yaml"),
           0);
    check_colours("third.yaml", 2);
    refused("calibrate colour --rig rig.yaml --to nobody --frames c0 --out no.yaml",
            "--to nobody: the rig has no such camera");
}

T_CASE(colours_that_make_no_matrix)
{
    for (int k = 0; k < 3; k++) {
        char name[8];
        snprintf(name, sizeof name, "g%d", k);
        shine(name, greys[k], 3);
    }
    shine("red", lamps[0], 3);
    shine("green", lamps[1], 3);
    shine("mono", lamps[1], 1);
    shine("bright", (const double[]){3, 3, 3}, 3);
    shine("black", (const double[]){0, 0, 0}, 3);
    refused("calibrate colour --rig rig.yaml --frames g0 --frames g1 --frames g2 --out no.yaml",
            "show at least three different colours");
    refused("calibrate colour --rig rig.yaml --frames red --frames green --out no.yaml",
            "show at least three different colours");
    refused("calibrate colour --rig rig.yaml --frames red --frames green --frames red --out "
            "no.yaml",
            "show at least three different colours");
    refused("calibrate colour --rig rig.yaml --frames mono --frames mono --frames mono --out "
            "no.yaml",
            "camera cam0 is grey");
    refused("calibrate colour --rig rig.yaml --frames red --frames bright --frames green --out "
            "no.yaml",
            "camera cam0: bright is saturated");
    refused("calibrate colour --rig rig.yaml --frames red --frames black --frames green --out "
            "no.yaml",
            "camera cam0: black is dark in the middle");
}

/* ---- noise ---- */

static const double reads[N] = {0.002, 0.004, 0.001}, shots[N] = {2e-5, 1e-4, 4e-5};

struct scene {
    double light, flicker; /* rms, relative, of the lamp */
    bool moves;            /* light that wanders over the picture */
    unsigned full;
};

static void expose(const char *name, const struct scene *s, int pictures)
{
    static uint16_t px[W * H];
    static uint8_t px8[W * H];
    struct pvx_diag d = {""};
    for (size_t c = 0; c < N; c++) {
        const struct light_camera cam = {.w = W,
                                         .h = H,
                                         .gain = 1,
                                         .pedestal = 0.02,
                                         .read = s->full == 255 ? 1e-4 : reads[c],
                                         .shot = s->full == 255 ? 1e-9 : shots[c],
                                         .corner = 0.8,
                                         .full = s->full,
                                         .hot_x = 30,
                                         .hot_y = 40,
                                         .dead_x = -1,
                                         .seed = 3 + c};
        T_EQ_I(pvx_mkdirs(at("%s/%s", name, rig.cameras[c].name), &d), PVX_OK);
        for (int f = 0; f < pictures; f++) {
            double lamp = s->light * (1 + s->flicker * normal_deviate(&random_state));
            for (int i = 0; i < W * H; i++) {
                int x = i % W, y = i / W;
                double l = s->moves ? lamp * (1 + 0.3 * sin(6.2832 * x / W + f)) : lamp;
                px[i] = (uint16_t)light_sample(&cam, x, y, l, &random_state);
                px8[i] = (uint8_t)px[i];
            }
            bool eight = s->full == 255;
            T_EQ_I(cap_image_write(at("%s/%s/%06d.png", name, rig.cameras[c].name, f),
                                   eight ? (void *)px8 : (void *)px, W, H, 1, eight ? 8 : 16, &d),
                   PVX_OK);
        }
    }
}

static void check_noise(const char *name)
{
    struct rec_rig r;
    struct pvx_diag d = {""};
    T_EQ_I(rec_rig_load(at("%s", name), &r, &d), PVX_OK);
    for (size_t c = 0; c < N; c++) {
        const struct rec_photometry *p = &r.cameras[c].photometry;
        printf("  %s camera %zu: read %.5f of %.5f, gain %.3g of %.3g\n", name, c, p->read_noise,
               reads[c], p->noise_gain, shots[c]);
        T_OK(p->has_noise);
        T_NEAR(p->read_noise / reads[c], 1, 0.05);
        T_NEAR(p->noise_gain / shots[c], 1, 0.05);
    }
    rec_rig_fini(&r);
}

T_CASE(noise_by_photon_transfer)
{
    static const struct {
        const char *name;
        struct scene s;
    } levels[] = {{"n0", {0, 0, false, 65535}},      {"n1", {0.1, 0, false, 65535}},
                  {"n2", {0.4, 0, false, 65535}},    {"n3", {0.8, 0, false, 65535}},
                  {"f2", {0.4, 0.01, false, 65535}}, {"f3", {0.8, 0.01, false, 65535}},
                  {"sat", {1.3, 0, false, 65535}},   {"flick", {0.4, 0.1, false, 65535}},
                  {"move", {0.4, 0, true, 65535}},   {"move2", {0.2, 0, true, 65535}},
                  {"step0", {0, 0, false, 255}},     {"step1", {0.5, 0, false, 255}}};
    for (size_t i = 0; i < sizeof levels / sizeof *levels; i++)
        expose(levels[i].name, &levels[i].s, 8);
    expose("one", &levels[2].s, 1);
    T_EQ_I(pyrovox("calibrate dark --rig rig.yaml --frames n0 --out dark.yaml"), 0);
    T_EQ_I(
        pyrovox("calibrate noise --rig dark.yaml --frames n0 --frames n1 --frames n2 --frames n3 "
                "--out noise.yaml"),
        0);
    T_CONTAINS(slurp("out.txt"), "cam0         variance = 0.0020");
    check_noise("noise.yaml");
    /* a lamp that flickers by 1 % */
    T_EQ_I(
        pyrovox("calibrate noise --rig dark.yaml --frames n0 --frames n1 --frames f2 --frames f3 "
                "--out flicker.yaml"),
        0);
    check_noise("flicker.yaml");
    refused("calibrate noise --rig dark.yaml --frames n2 --out no.yaml", "is one level");
    refused("calibrate noise --rig dark.yaml --frames n0 --frames one --out no.yaml",
            "camera cam0: level 2 is one picture");
    refused("calibrate noise --rig dark.yaml --frames n0 --frames sat --out no.yaml",
            "camera cam0: level 2 is saturated");
    refused("calibrate noise --rig dark.yaml --frames n0 --frames flick --out no.yaml",
            "the light of level 2 flickers by");
    refused(
        "calibrate noise --rig dark.yaml --frames n0 --frames move --frames move2 --out no.yaml",
        "no line over the light");
    refused("calibrate noise --rig rig.yaml --frames n0 --frames n1 --frames n2 --out no.yaml",
            "camera cam0: rig.yaml has no dark of it, and light counts from the dark: run "
            "`pyrovox calibrate dark` first");
    T_EQ_I(pyrovox("calibrate dark --rig rig.yaml --frames step0 --out step.yaml"), 0);
    refused("calibrate noise --rig step.yaml --frames step0 --frames step1 --out no.yaml",
            "pixel format of more bits");
    T_EQ_I(pyrovox("calibrate noise --rig dark.yaml --out no.yaml"), 2);
}

static void begin(void)
{
    static const float gains[N][3] = {{1, 1.1F, 0.9F}, {0.9F, 1, 1.2F}, {1.1F, 0.9F, 1}};
    cli_begin();
    if (rec_rig_ring(N, 2.5, W, H, 16, &rig) != PVX_OK)
        exit(1);
    for (size_t c = 0; c < N; c++)
        memcpy(rig.cameras[c].gain, gains[c], sizeof gains[c]);
    write_rig("rig.yaml", &rig);
}

static void end(void)
{
    rec_rig_fini(&rig);
    scratch_remove();
}

T_MAIN(begin(), end())
