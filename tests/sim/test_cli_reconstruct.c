/* test_cli_reconstruct.c - `pyrovox reconstruct` and `pyrovox render` as a user runs them: recorded
 * frames of the analytic flame in, volumes near its truth out, unseen views near the real ones. */
#include "../t.h"

#include <cjson/cJSON.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <turbojpeg.h>
#include <unistd.h>

#include "base/file.h"
#include "capture/files/imgio.h"
#include "tests/lib/take.h"
#include "daemon/pipeline/volume_file.h"
#include "recon/view/metrics.h"
#include "recon/geom/rig.h"
#include "tests/lib/cli.h"
#include "tests/lib/flame_point.h"
#include "tests/lib/likeness.h"

enum { W = 120, H = 90, N = 32, CAMERAS = 9, FRAMES = 3 };

static struct rec_rig rig;
static struct rec_flame flame;

static void image_of(size_t camera, int frame, float *img)
{
    struct rec_flame_pose p;
    rec_flame_at(&flame, 0.2 * frame, &p);
    rec_flame_render(&p, &rig.cameras[camera], 2, 0, H, img);
}

/* Frames of all cameras but the last (cam8 is the unseen view), 1 % noise, .npy or .png. */
static void record(const char *name, const char *ext)
{
    float *img = malloc(W * H * 3 * sizeof *img);
    struct pvx_diag d = {""};
    for (size_t c = 0; c + 1 < CAMERAS; c++) {
        T_EQ_I(pvx_mkdirs(at("%s/cam%zu", name, c), &d), PVX_OK);
        for (int f = 0; f < FRAMES; f++) {
            image_of(c, f, img);
            for (int i = 0; i < W * H * 3; i++)
                img[i] += 0.008f * (float)t_normal();
            T_EQ_I(cap_image_save(at("%s/cam%zu/%06d.%s", name, c, f, ext), img, W, H, 3, &d),
                   PVX_OK);
            T_EQ_S(d.text, "");
        }
    }
    free(img);
}

#define EIGHT_NAMES "cam0,cam1,cam2,cam3,cam4,cam5,cam6,cam7"
#define EIGHT       "--cameras " EIGHT_NAMES

/* The take's flame from eight views. */
static int reconstruct(const char *args)
{
    char all[1000];
    snprintf(all, sizeof all, "reconstruct --rig rig.yaml --frames take " EIGHT " %s", args);
    return pyrovox(all);
}

static double volume_error(const char *name, int frame, enum rec_basis basis)
{
    float *v, *truth = malloc((size_t)N * N * N * 3 * sizeof *truth);
    size_t shape[4];
    int ndim;
    struct pvx_diag d = {""};
    double err = 99;
    if (cap_npy_load(at("%s", name), &v, shape, &ndim, &d) == PVX_OK && ndim == 4 &&
        shape[0] == N && shape[3] == 3) {
        struct rec_flame_pose p;
        struct rec_grid g = rig.grid;
        g.basis = basis;
        rec_flame_at(&flame, 0.2 * frame, &p);
        rec_flame_voxels(&p, &g, 0, N, truth);
        err = rec_rel_l2(v, truth, (size_t)N * N * N * 3);
        free(v);
    }
    free(truth);
    return err;
}

T_CASE_OF_THREADS(flame_comes_back)
{
    T_EQ_I(reconstruct("--out vol --save-report report.json --threads 2"), 0);
    for (int f = 0; f < FRAMES; f++)
        T_LE(volume_error(f == 0   ? "vol/000000.npy"
                          : f == 1 ? "vol/000001.npy"
                                   : "vol/000002.npy",
                          f, REC_BOX),
             0.25);
    slurp("report.json");
    cJSON *o = cJSON_Parse(text), *list = cJSON_GetObjectItem(o, "frames");
    T_EQ_I(cJSON_GetArraySize(list), FRAMES);
    for (int f = 0; f < cJSON_GetArraySize(list); f++) {
        cJSON *r = cJSON_GetArrayItem(list, f), *ms = cJSON_GetObjectItem(r, "ms");
        T_EQ_I(cJSON_GetNumberValue(cJSON_GetObjectItem(r, "frame")), f);
        const char *solver = cJSON_GetStringValue(cJSON_GetObjectItem(r, "solver"));
        T_EQ_S(solver != NULL ? solver : "", "pcg");
        T_OK(cJSON_GetStringValue(cJSON_GetObjectItem(r, "status")) != NULL);
        static const char *const numbers[] = {"iterations", "rel_residual", "active_voxels",
                                              "active_rays", "entries"};
        for (size_t i = 0; i < 5; i++)
            T_OK(cJSON_GetNumberValue(cJSON_GetObjectItem(r, numbers[i])) > 0);
        static const char *const stages[] = {"photometry", "hull", "restrict", "solve", "total"};
        for (size_t i = 0; i < 5; i++)
            T_OK(cJSON_GetNumberValue(cJSON_GetObjectItem(ms, stages[i])) >= 0);
        T_LE(cJSON_GetNumberValue(cJSON_GetObjectItem(r, "active_voxels")), 0.4 * N * N * N);
    }
    cJSON_Delete(o);
    slurp("vol/000001.json");
    o = cJSON_Parse(text);
    const char *basis = cJSON_GetStringValue(cJSON_GetObjectItem(o, "basis"));
    T_EQ_S(basis != NULL ? basis : "", "box");
    T_NEAR(cJSON_GetNumberValue(cJSON_GetArrayItem(cJSON_GetObjectItem(o, "spacing"), 0)), 1.0 / N,
           1e-12);
    T_EQ_I(cJSON_GetNumberValue(cJSON_GetObjectItem(o, "frame")), 1);
    cJSON_Delete(o);
}

/* Cameras so near that their views are 80 degrees wide, as pinholes and as fisheyes. */
T_CASE(fisheyes_are_as_good_as_pinholes)
{
    T_NOT_UNDER_SANITIZERS();
    static const double lens[4] = {-0.03, 0.011, -0.006, 0.001};
    struct rec_rig usual = rig;
    double error[2];
    for (int f = 0; f < 2; f++) {
        T_EQ_I(rec_rig_ring(CAMERAS, 1.3, W, H, N, &rig), PVX_OK);
        for (size_t c = 0; c < CAMERAS && f == 1; c++) {
            rig.cameras[c].model = REC_FISHEYE;
            memset(rig.cameras[c].dist, 0, sizeof rig.cameras[c].dist);
            memcpy(rig.cameras[c].dist, lens, sizeof lens);
            rig.cameras[c].fx *= 1.15;
            rig.cameras[c].fy *= 1.15;
        }
        write_rig("near.yaml", &rig);
        record("near", "npy");
        T_EQ_I(pyrovox("reconstruct --rig near.yaml --frames near " EIGHT
                       " --out wide --last 0 --quiet"),
               0);
        error[f] = volume_error("wide/000000.npy", 0, REC_BOX);
        rec_rig_fini(&rig);
    }
    rig = usual;
    printf("  pinholes %.3f, fisheyes %.3f\n", error[0], error[1]);
    T_LE(error[0], 0.25);
    T_LE(error[1], 1.1 * error[0]);
}

T_CASE(trilinear_and_other_solvers)
{
    T_NOT_UNDER_SANITIZERS();
    T_EQ_I(reconstruct("--out tri --basis trilinear --last 0 --quiet"), 0);
    T_LE(volume_error("tri/000000.npy", 0, REC_TRILINEAR), 0.25);
    T_OK(access(at("tri/000001.npy"), F_OK) != 0); /* --last */
    T_EQ_I(reconstruct("--out mlem --solver mlem --iterations 20 --last 0 --quiet"), 0);
    T_LE(volume_error("mlem/000000.npy", 0, REC_BOX), 0.35);
    T_EQ_I(reconstruct("--out cgls --solver cgls-paper --stop lcurve --last 0 --quiet"), 0);
    T_LE(volume_error("cgls/000000.npy", 0, REC_BOX), 0.5);
    /* without the hull it is worse: that is what the hull is for */
    T_EQ_I(reconstruct("--out full --no-hull --solver mlem --iterations 20 --last 0 --quiet"), 0);
    T_LE(volume_error("mlem/000000.npy", 0, REC_BOX), volume_error("full/000000.npy", 0, REC_BOX));
}

T_CASE_OF_THREADS(unseen_view)
{
    float *img, *want = malloc(W * H * 3 * sizeof *want);
    size_t shape[4];
    int ndim;
    struct pvx_diag d = {""};
    T_EQ_I(pyrovox("render --rig rig.yaml --camera cam8 vol/000001.npy view.npy"), 0);
    T_EQ_I(cap_npy_load(at("view.npy"), &img, shape, &ndim, &d), PVX_OK);
    T_EQ_I(ndim, 3);
    T_EQ_I(shape[0] * 1000000 + shape[1] * 1000 + shape[2], H * 1000000 + W * 1000 + 3);
    image_of(8, 1, want);
    T_LE(image_mean_abs_255(img, want, W * H * 3), 1.0);
    free(img);
    free(want);
    struct cap_loaded l;
    T_EQ_I(pyrovox("render --strip 0,120,3 --size 60x80 vol/000001.npy strip.png"), 0);
    T_EQ_I(cap_image_load(at("strip.png"), &l, &d), PVX_OK);
    T_EQ_I(l.img.width * 1000 + l.img.height, 180 * 1000 + 80);
    uint8_t most = 0;
    for (size_t i = 0; i < l.img.size; i++)
        most = ((const uint8_t *)l.img.data)[i] > most ? ((const uint8_t *)l.img.data)[i] : most;
    T_LE(250, most); /* exposed for looking at */
    cap_loaded_free(&l);
    T_EQ_I(pyrovox("render --rig rig.yaml --camera camX vol/000001.npy x.npy"), 1);
    slurp("err");
    T_CONTAINS(text, "no camera 'camX'");
    T_EQ_I(pyrovox("render vol/000001.npy x.npy"), 2);
    T_EQ_I(pyrovox("render --rig rig.yaml --camera cam8 view.npy x.npy"),
           0); /* [h][w][3]: grey cube */
    T_EQ_I(pyrovox("render --rig rig.yaml --camera cam8 take x.npy"), 1);
}

/* 8-bit files: one missing, one of the wrong size, one not an image; the rest goes on. */
T_CASE_OF_THREADS(bad_and_missing_frames)
{
    struct pvx_diag d = {""};
    record("png", "png");
    T_EQ_I(unlink(at("png/cam3/000001.png")), 0);
    float small[8 * 6 * 3] = {0};
    T_EQ_I(cap_image_save(at("png/cam4/000002.png"), small, 8, 6, 3, &d), PVX_OK);
    T_EQ_I(pvx_file_write(at("png/cam5/000002.png"), "hello", 5, &d), PVX_OK);
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames png " EIGHT
                   " --out vol8 --save-report r8.json"),
           1);
    slurp("err");
    T_CONTAINS(text, "frame 000001: solved from 7 of 8 cameras, without cam3");
    T_CONTAINS(text, "png/cam4/000002.png: is 8x6, but the rig says camera cam4 takes 120x90");
    T_CONTAINS(text, "png/cam5/000002.png");
    T_CONTAINS(text, "frame 000002: solved from 6 of 8");
    T_LE(volume_error("vol8/000000.npy", 0, REC_BOX), 0.25);
    T_LE(volume_error("vol8/000001.npy", 1, REC_BOX), 0.3);
    T_LE(volume_error("vol8/000002.npy", 2, REC_BOX), 0.4);
    slurp("r8.json");
    cJSON *o = cJSON_Parse(text), *f = cJSON_GetArrayItem(cJSON_GetObjectItem(o, "frames"), 2);
    const char *problem = cJSON_GetStringValue(cJSON_GetObjectItem(f, "problem"));
    T_CONTAINS(problem != NULL ? problem : "", "cam4/000002.png");
    T_EQ_I(cJSON_GetArraySize(cJSON_GetObjectItem(f, "cameras_missing")), 2);
    cJSON_Delete(o);
}

/* cam3 has its cap on in frame 1: it is left out of that one, and said so; frames 0 and 2 have all eight. */
T_CASE(a_camera_that_lies_is_left_out)
{
    float *black = calloc(W * H * 3, sizeof *black);
    struct pvx_diag d = {""};
    record("capped", "npy");
    T_EQ_I(cap_image_save(at("capped/cam3/000001.npy"), black, W, H, 3, &d), PVX_OK);
    free(black);
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames capped --cameras " EIGHT_NAMES
                   " --out believed --save-report vote.json"),
           0);
    T_LE(volume_error("believed/000001.npy", 1, REC_BOX), 0.25);
    T_CONTAINS(slurp("err"),
               "frame 000001: camera cam3 is left out, it contradicts the others: dark; "
               "take the cap off");
    T_CONTAINS(text, "frame 000002: camera cam3 agrees with the others again");
    slurp("vote.json");
    cJSON *o = cJSON_Parse(text), *list = cJSON_GetObjectItem(o, "frames");
    for (int f = 0; f < FRAMES; f++) {
        cJSON *r = cJSON_GetArrayItem(list, f), *out = cJSON_GetObjectItem(r, "out");
        T_EQ_I(cJSON_GetArraySize(out), f == 1);
        T_EQ_I(cJSON_GetNumberValue(cJSON_GetObjectItem(r, "cameras")), f == 1 ? 7 : 8);
        cJSON *k = cJSON_GetArrayItem(out, 0);
        const char *name = cJSON_GetStringValue(cJSON_GetObjectItem(k, "camera"));
        const char *why = cJSON_GetStringValue(cJSON_GetObjectItem(k, "why"));
        T_EQ_S(name != NULL ? name : "", f == 1 ? "cam3" : "");
        T_EQ_S(why != NULL ? why : "", f == 1 ? "dark" : "");
    }
    cJSON_Delete(o);
    /* for comparison: the cap carves everything away */
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames capped --cameras " EIGHT_NAMES
                   " --out trusted --trust-all --first 1 --last 1"),
           0);
    T_EQ_I(volume_error("trusted/000001.npy", 1, REC_BOX), 1);
    T_OK(strstr(slurp("err"), "left out") == NULL);
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames capped --cameras cam0,cam1,cam2 --out few"),
           0);
    T_CONTAINS(slurp("err"), "fewer than four cameras");
}

/* The same frame: a black camera, believed, leaves no box; left out, the box is that of the other seven. */
T_CASE(nor_does_it_spoil_the_fitted_volume)
{
    T_NOT_UNDER_SANITIZERS();
    struct rec_rig with, without;
    struct pvx_diag d = {""};
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames capped --cameras " EIGHT_NAMES
                   " --first 1 --last 1 --fit-volume --save-rig with.yaml"),
           0);
    T_CONTAINS(slurp("err"), "without camera cam3 in 1 of 1 frame sets, it contradicts the others: "
                             "dark; take the cap off");
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames capped --cameras "
                   "cam0,cam1,cam2,cam4,cam5,cam6,cam7"
                   " --first 1 --last 1 --fit-volume --save-rig without.yaml --quiet"),
           0);
    T_EQ_I(rec_rig_load(at("with.yaml"), &with, &d), PVX_OK);
    T_EQ_I(rec_rig_load(at("without.yaml"), &without, &d), PVX_OK);
    for (int a = 0; a < 3; a++) {
        T_NEAR(with.grid.min[a], without.grid.min[a], 1e-9);
        T_NEAR(with.grid.max[a], without.grid.max[a], 1e-9);
    }
    rec_rig_fini(&with);
    rec_rig_fini(&without);
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames capped --cameras " EIGHT_NAMES
                   " --first 1 --last 1 --fit-volume --save-rig no.yaml --trust-all --quiet"),
           1);
    T_CONTAINS(slurp("err"), "nowhere in the rig's box");
}

/* Sets are numbered from the daemon's start: after 14 hours at 20 a second six digits are not enough. */
T_CASE(large_frame_numbers)
{
    T_EQ_I(mkdir(at("far"), 0777), 0);
    for (size_t c = 0; c + 1 < CAMERAS; c++) {
        T_EQ_I(mkdir(at("far/cam%zu", c), 0777), 0);
        T_EQ_I(symlink(at("take/cam%zu/000000.npy", c), at("far/cam%zu/999999.npy", c)), 0);
        T_EQ_I(symlink(at("take/cam%zu/000001.npy", c), at("far/cam%zu/1000000.npy", c)), 0);
        T_EQ_I(symlink(at("take/cam%zu/000002.npy", c), at("far/cam%zu/1000001.npy", c)), 0);
    }
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames far " EIGHT " --out vfar --quiet"), 0);
    T_LE(volume_error("vfar/999999.npy", 0, REC_BOX), 0.25);
    T_LE(volume_error("vfar/1000000.npy", 1, REC_BOX), 0.25);
    T_LE(volume_error("vfar/1000001.npy", 2, REC_BOX), 0.25);
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames far " EIGHT
                   " --out vlast --quiet --first 1000001"),
           0);
    T_LE(volume_error("vlast/1000001.npy", 2, REC_BOX), 0.25);
    for (size_t c = 0; c + 1 < CAMERAS; c++)
        T_EQ_I(rename(at("far/cam%zu/1000001.npy", c), at("far/cam%zu/1700000000123456789.npy", c)),
               0);
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames far " EIGHT
                   " --out vtime --quiet --first 1700000000123456789 --save-report time.json"),
           0);
    T_LE(volume_error("vtime/1700000000123456789.npy", 2, REC_BOX), 0.25);
    T_CONTAINS(slurp("time.json"), "1700000000123456789");
}

/* Numbers of a clock, beyond 32 bits and apart by jitter; names in capitals; hidden files. */
T_CASE(numbers_that_are_times)
{
    struct pvx_diag d = {""};
    record("png", "png");
    for (size_t c = 0; c + 1 < CAMERAS; c++) {
        T_EQ_I(pvx_mkdirs(at("us/cam%zu", c), &d), PVX_OK);
        for (int f = 0; f < FRAMES; f++)
            T_EQ_I(symlink(at("png/cam%zu/%06d.png", c, f),
                           at("us/cam%zu/x%lld.PNG", c, 4294000000LL + f * 50000 + (int)c * 7)),
                   0);
        T_EQ_I(pvx_file_write(at("us/cam%zu/._x1.PNG", c), "junk", 4, &d), PVX_OK);
    }
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames us " EIGHT " --out vus --quiet"), 1);
    T_CONTAINS(slurp("err"), "cam0: 0 of its 3 frames have a number that another camera has too");
    T_CONTAINS(slurp("err"), "--numbers ms, us or ns");
    T_EQ_I(
        pyrovox("reconstruct --rig rig.yaml --frames us " EIGHT " --numbers us --out vus --quiet"),
        0);
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames png " EIGHT " --out vpng --quiet"), 0);
    for (int f = 0; f < FRAMES; f++) {
        char cmd[400];
        snprintf(cmd, sizeof cmd, "cmp '%s/vus/%06d.npy' '%s/vpng/%06d.npy'", dir, f, dir, f);
        T_EQ_I(system(cmd), 0); /* NOLINT(cert-env33-c,bugprone-command-processor) */
    }
    /* a name that no camera has, two files of one number, one film */
    T_EQ_I(rename(at("us/cam2"), at("us/cam 2")), 0);
    T_EQ_I(pvx_file_write(at("us/cam1/7.ppm"), "P6", 2, &d), PVX_OK);
    T_EQ_I(
        pyrovox("reconstruct --rig rig.yaml --frames us " EIGHT " --numbers us --out vus --quiet"),
        0);
    T_CONTAINS(slurp("err"), "no frames of cam2, missing in all sets; 'cam 2' in it belongs to");
    T_CONTAINS(slurp("err"), "us/cam1/7.ppm: no type that is read (.npy .png");
    T_EQ_I(rename(at("us/cam 2"), at("cam 2")), 0);
    T_EQ_I(pvx_file_write(at("us/cam2.wmv"), "film", 4, &d), PVX_OK);
    T_EQ_I(
        pyrovox("reconstruct --rig rig.yaml --frames us " EIGHT " --numbers us --out vus --quiet"),
        0);
    T_CONTAINS(slurp("err"), "no frames of cam2, missing in all sets; cam2.wmv is of no type that");
    T_EQ_I(symlink(at("png/cam1/000001.png"), at("png/cam1/1.tif")), 0);
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames png " EIGHT " --out vus --quiet"), 1);
    T_CONTAINS(slurp("err"), "png/cam1/1.tif");
    T_CONTAINS(slurp("err"), "png/cam1/000001.png");
    T_EQ_I(unlink(at("png/cam1/1.tif")), 0);
    T_EQ_I(pvx_file_write(at("png/cam1.mp4"), "film", 4, &d), PVX_OK);
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames png " EIGHT " --out vus --quiet"), 1);
    T_CONTAINS(slurp("err"), "png/cam1.mp4");
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames png/cam1.mp4 --out vus --quiet"), 1);
    T_CONTAINS(slurp("err"), "is one film");
}

/* Films without loss give the volumes of the pictures, bit for bit, where a camera's film lacks a frame too. */
T_CASE_OF_THREADS(films_are_frames)
{
    char cmd[600];
    if (system("ffmpeg -version >/dev/null 2>&1") != 0) /* NOLINT(cert-env33-c,*command-proc*) */
        T_SKIP("no ffmpeg");
    T_EQ_I(mkdir(at("film"), 0777), 0);
    record("shots", "png");
    for (int c = 0; c + 1 < CAMERAS; c++) {
        snprintf(cmd, sizeof cmd,
                 "cd '%s' && mkdir -p film/cam4 && ffmpeg -v error -framerate 20 -i "
                 "shots/cam%d/%%06d.png %s -vsync passthrough -c:v ffv1 -pix_fmt bgr0 film/%s.mkv",
                 dir, c, c == 3 ? "-vf 'select=not(eq(n\\,1))'" : "",
                 c == 4 ? "cam4/x" : at("/cam%d", c) + strlen(dir) + 1);
        T_EQ_I(system(cmd), 0); /* NOLINT(cert-env33-c,bugprone-command-processor) */
    }
    T_EQ_I(unlink(at("shots/cam3/000001.png")), 0);
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames shots " EIGHT " --out vshots --quiet"), 0);
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames film " EIGHT " --out vfilm --quiet"), 0);
    T_CONTAINS(slurp("err"), "cam3 has no frame in 1 of 3 sets");
    T_CONTAINS(slurp("err"), "frame 000001: solved from 7 of 8 cameras, without cam3");
    for (int f = 0; f < FRAMES; f++) {
        snprintf(cmd, sizeof cmd, "cmp '%s/vshots/%06d.npy' '%s/vfilm/%06d.npy'", dir, f, dir, f);
        T_EQ_I(system(cmd), 0); /* NOLINT(cert-env33-c,bugprone-command-processor) */
    }
}

/* A take of a camera's JPEG pictures: one set, sRGB. */
T_CASE_OF_THREADS(a_take_of_jpegs)
{
    struct cap_take_camera cameras[CAMERAS - 1];
    char names[CAMERAS - 1][8];
    struct cap_frame frames[CAMERAS - 1] = {0};
    struct cap_set set = {.n = CAMERAS - 1};
    struct pvx_diag d = {""};
    float *img = malloc(W * H * 3 * sizeof *img);
    unsigned char *px = malloc(W * H * 3);
    tjhandle tj = tjInitCompress();
    for (size_t c = 0; c + 1 < CAMERAS; c++) {
        unsigned char *coded = NULL;
        unsigned long size = 0;
        image_of(c, 0, img);
        for (int i = 0; i < W * H * 3; i++) {
            float v = img[i] > 1 ? 1 : img[i];
            v = v <= 0.0031308f ? 12.92f * v : 1.055f * powf(v, 1 / 2.4f) - 0.055f;
            px[i] = (unsigned char)(v * 255 + 0.5f);
        }
        T_EQ_I(tjCompress2(tj, px, W, W * 3, H, TJPF_RGB, &coded, &size, TJSAMP_444, 95, 0), 0);
        snprintf(names[c], sizeof names[c], "cam%zu", c);
        cameras[c] = (struct cap_take_camera){.name = names[c], .uri = "test:", .settings = ""};
        frames[c] = (struct cap_frame){
            .img = {.data = coded, .size = size, .width = W, .height = H, .fmt = CAP_JPEG},
            .camera = (uint32_t)c};
        set.frame[c] = &frames[c];
    }
    struct cap_take_head head = take_head(cameras, CAMERAS - 1);
    cap_take_writer *w;
    T_EQ_I(cap_take_create(at("jpeg.h5"), &head, &w, &d), PVX_OK);
    T_EQ_I(cap_take_put_set(w, &set, &d), PVX_OK);
    T_EQ_I(cap_take_close(&w, &d), PVX_OK);
    for (size_t c = 0; c + 1 < CAMERAS; c++)
        tjFree((unsigned char *)(uintptr_t)frames[c].img.data);
    tjDestroy(tj);
    free(px);
    free(img);
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames jpeg.h5 " EIGHT
                   " --threshold 0.02 --out vjpeg --quiet"),
           0);
    T_LE(volume_error("vjpeg/000000.npy", 0, REC_BOX), 0.25);
}

/* Frame f of camera c as a file: sRGB, or linear PNG. */
static void save_as(const char *folder, size_t c, int f, bool jpeg)
{
    static float img[W * H * 3];
    static unsigned char px[W * H * 3];
    struct pvx_diag d = {""};
    image_of(c, f, img);
    T_EQ_I(pvx_mkdirs(at("%s/cam%zu", folder, c), &d), PVX_OK);
    if (!jpeg) {
        T_EQ_I(cap_image_save(at("%s/cam%zu/%06d.png", folder, c, f), img, W, H, 3, &d), PVX_OK);
        return;
    }
    for (int i = 0; i < W * H * 3; i++) {
        float v = img[i] > 1 ? 1 : img[i];
        v = v <= 0.0031308f ? 12.92f * v : 1.055f * powf(v, 1 / 2.4f) - 0.055f;
        px[i] = (unsigned char)(v * 255 + 0.5f);
    }
    unsigned char *coded = NULL;
    unsigned long size = 0;
    tjhandle tj = tjInitCompress();
    tjCompress2(tj, px, W, W * 3, H, TJPF_RGB, &coded, &size, TJSAMP_444, 95, 0);
    T_EQ_I(pvx_file_write(at("%s/cam%zu/%06d.jpg", folder, c, f), (char *)coded, size, &d), PVX_OK);
    tjFree(coded);
    tjDestroy(tj);
}

/* In one camera's folder refused, unless one curve is said for all; between cameras said, as are floats. */
T_CASE(jpegs_beside_other_types)
{
    for (size_t c = 0; c + 1 < CAMERAS; c++)
        for (int f = 0; f < 2; f++)
            save_as("types", c, f, c == 3);
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames types " EIGHT
                   " --threshold 0.02 --out vtypes --quiet"),
           0);
    T_CONTAINS(slurp("err"), "samples of cam3 are decoded (JPEG");
    T_CONTAINS(text, "those of cam7 are taken as light");
    T_LE(volume_error("vtypes/000000.npy", 0, REC_BOX), 0.25);
    T_EQ_I(unlink(at("types/cam3/000001.jpg")), 0);
    save_as("types", 3, 1, false);
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames types " EIGHT
                   " --threshold 0.02 --out vtypes --quiet"),
           1);
    T_CONTAINS(slurp("err"), "types/cam3/000001.png: samples of JPEG files are taken as sRGB");
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames types " EIGHT
                   " --threshold 0.02 --out vtypes --quiet --transfer linear"),
           0);
    T_OK(strstr(slurp("err"), "decoded") == NULL);
    T_EQ_I(rename(at("types/cam3"), at("cam3")), 0);
    T_EQ_I(symlink(at("take/cam3"), at("types/cam3")), 0);
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames types " EIGHT
                   " --threshold 0.02 --out vtypes --quiet"),
           0);
    T_CONTAINS(slurp("err"), "samples of cam3 are floats, taken as they are, those of cam7");
}

/* Frame 0's volume (box basis) against the flame itself at points of the rig's volume. */
static double error_of_field(const char *name, struct rec_grid *g)
{
    float *v;
    int nch;
    struct rec_flame_pose p;
    struct pvx_diag d = {""};
    if (dmn_volume_load(at("%s", name), g, &nch, &v, &d) != PVX_OK)
        return 99;
    double e = 0, sum = 0;
    rec_flame_at(&flame, 0, &p);
    for (int k = 0; k < 20000; k++) {
        double x[3], want[3];
        int32_t ijk[3];
        bool in = true;
        for (int a = 0; a < 3; a++) {
            x[a] = t_uniform(rig.grid.min[a], rig.grid.max[a]);
            double u = (x[a] - g->min[a]) / rec_grid_h(g, a);
            in = in && u >= 0 && u < g->n[a];
            ijk[a] = in ? (int32_t)u : 0;
        }
        flame_point(&p, x, want);
        size_t at_voxel = (size_t)rec_grid_index(g, ijk[0], ijk[1], ijk[2]) * 3;
        for (size_t c = 0; c < 3; c++) {
            double diff = (in ? v[at_voxel + c] : 0) - want[c];
            e += diff * diff;
            sum += want[c] * want[c];
        }
    }
    free(v);
    return sqrt(e / sum);
}

/* A rig with a box of eight times the volume: fitted, the same number of voxels gives less error. */
T_CASE(volume_fitted_to_the_flame)
{
    struct rec_rig wide, tight;
    struct rec_grid g, fitted;
    struct pvx_diag d = {""};
    T_EQ_I(rec_rig_copy(&rig, &wide), PVX_OK);
    for (int a = 0; a < 3; a++) {
        wide.grid.min[a] -= 0.5;
        wide.grid.max[a] += 0.5;
    }
    write_rig("wide.yaml", &wide);
    T_EQ_I(pyrovox("reconstruct --rig wide.yaml --frames take " EIGHT " --out w --last 0"), 0);
    T_EQ_I(pyrovox("reconstruct --rig wide.yaml --frames take " EIGHT
                   " --out f --fit-volume --grid 32 --save-rig tight.yaml --save-report f.json"),
           0);
    slurp("err");
    T_CONTAINS(text, "volume fitted: x ");
    T_CONTAINS(text, "% of the rig's box (from 3 of 3 frame sets");
    double before = error_of_field("w/000000.npy", &g);
    double after = error_of_field("f/000000.npy", &fitted);
    T_LE(rec_grid_count(&fitted), rec_grid_count(&g));
    printf("  %zu voxels: error %.3f on the rig's box, %.3f on the fitted one\n",
           rec_grid_count(&g), before, after);
    T_LE(after, 0.7 * before);
    /* for the daemon: the fitted volume, and all cameras although eight were used */
    T_EQ_I(rec_rig_load(at("tight.yaml"), &tight, &d), PVX_OK);
    T_EQ_I(tight.n_cameras, CAMERAS);
    for (int a = 0; a < 3; a++) {
        T_EQ_I(tight.grid.n[a], fitted.n[a]);
        T_NEAR(tight.grid.min[a], fitted.min[a], 1e-12);
        T_NEAR(tight.grid.max[a], fitted.max[a], 1e-9);
        T_OK(fitted.min[a] >= wide.grid.min[a] - 0.05 && fitted.max[a] <= wide.grid.max[a] + 0.05);
    }
    slurp("f.json");
    T_CONTAINS(text, "\"fitted\":\ttrue");
    /* the rig's voxel size is kept unless said otherwise; no --out: only the box is found */
    T_EQ_I(pyrovox("reconstruct --rig wide.yaml --frames take " EIGHT
                   " --fit-volume=0.1 --fit-frames 1 --save-rig same.yaml --quiet"),
           0);
    rec_rig_fini(&tight);
    T_EQ_I(rec_rig_load(at("same.yaml"), &tight, &d), PVX_OK);
    for (int a = 0; a < 3; a++)
        T_NEAR(rec_grid_h(&tight.grid, a), rec_grid_h(&wide.grid, a), 1e-12);
    rec_rig_fini(&tight);
    /* as fine as the eight cameras allow on the box that was found */
    T_EQ_I(pyrovox("reconstruct --rig wide.yaml --frames take " EIGHT
                   " --fit-volume --grid auto --binning 2 --save-rig auto.yaml --quiet"),
           0);
    T_EQ_I(rec_rig_load(at("auto.yaml"), &tight, &d), PVX_OK);
    T_EQ_I(rec_rig_select(&tight, EIGHT_NAMES, &d), PVX_OK);
    int32_t finest[3];
    T_EQ_I(rec_rig_finest(&tight, 2, finest), PVX_OK);
    for (int a = 0; a < 3; a++) {
        T_EQ_I(tight.grid.n[a], finest[a]);
        T_OK(tight.grid.max[a] - tight.grid.min[a] < wide.grid.max[a] - wide.grid.min[a]);
    }
    rec_rig_fini(&tight);
    for (int a = 0; a < 3; a++) { /* a box beside the flame */
        wide.grid.min[a] = 5;
        wide.grid.max[a] = 6;
    }
    write_rig("astray.yaml", &wide);
    T_EQ_I(pyrovox("reconstruct --rig astray.yaml --frames take " EIGHT " --out x --fit-volume"),
           1);
    slurp("err");
    T_CONTAINS(text, "3 of 3 frame sets have light, but the silhouettes of all cameras meet "
                     "nowhere in the rig's box");
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames take --out x --fit-volume --threshold 9"),
           1);
    slurp("err");
    T_CONTAINS(text, "no flame in any of the 3 frame sets from 000000 to 000002");
    rec_rig_fini(&wide);
}

static double report(const char *file, const char *group, const char *key)
{
    slurp(file);
    cJSON *o = cJSON_Parse(text), *f = cJSON_GetArrayItem(cJSON_GetObjectItem(o, "frames"), 0);
    cJSON *item = cJSON_GetObjectItem(group != NULL ? cJSON_GetObjectItem(f, group) : f, key);
    double v = cJSON_IsNumber(item) ? item->valuedouble : -1;
    cJSON_Delete(o);
    return v;
}

/* Both rules of the hull, its counts and its picture. */
T_CASE(hull_is_reported)
{
    struct cap_loaded l;
    struct pvx_diag d = {""};
    T_EQ_I(reconstruct("--out h --last 0 --quiet --save-report h.json --save-hull hulls"), 0);
    double inside = report("h.json", "hull", "inside"),
           partial = report("h.json", "hull", "partial");
    T_OK(inside > 0 && partial > 0);
    T_EQ_I(inside + partial + report("h.json", "hull", "outside"), N * N * N);
    T_EQ_I(report("h.json", NULL, "active_voxels"), inside + partial);
    T_EQ_I(cap_image_load(at("hulls/000000.png"), &l, &d), PVX_OK);
    T_EQ_S(d.text, "");
    size_t red = 0, green = 0, yellow = 0;
    for (size_t i = 0; i + 2 < l.img.size; i += 3) {
        const uint8_t *p = (const uint8_t *)l.img.data + i;
        red += p[0] == 255 && p[1] == 51 && p[2] == 31;
        green += p[0] == 38 && p[1] == 217 && p[2] == 64;
        yellow += p[0] == 242 && p[1] == 217 && p[2] == 51;
    }
    T_OK(red > 1000 && green > 500 && yellow > 500);
    cap_loaded_free(&l);
    T_EQ_I(reconstruct("--out h --last 0 --quiet --save-report h.json --hull-rule inside"), 0);
    T_EQ_I(report("h.json", "hull", "inside"), inside);
    T_EQ_I(report("h.json", NULL, "active_voxels"), inside);
}

/* Each rule of stopping does what it says, and the report says which it was. */
T_CASE(stopping_and_starting)
{
    static const struct {
        const char *args, *status;
        int least, most;
    } cases[] = {
        {"--iterations 4", "max-iter", 4, 4},
        {"--solver fista --stop discrepancy", "converged", 1, 39},
        {"--solver fista --stop discrepancy --iterations 2", "max-iter", 2, 2},
        {"--solver cgls-paper --stop lcurve --iterations 60", "converged", 3, 59},
        {"--stop iterations --iterations 100 --deadline 0.01", "deadline", 0, 1},
        {"--deadline 60000 --iterations 3", "max-iter", 3, 3},
    };
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        char args[300];
        snprintf(args, sizeof args, "--out s --last 0 --quiet --save-report s.json %s",
                 cases[i].args);
        T_EQ_I(reconstruct(args), 0);
        int k = (int)report("s.json", NULL, "iterations");
        T_CHECK_(k >= cases[i].least && k <= cases[i].most, "%s: %d iterations", cases[i].args, k);
        cJSON *o = cJSON_Parse(text), *f = cJSON_GetArrayItem(cJSON_GetObjectItem(o, "frames"), 0);
        const char *status = cJSON_GetStringValue(cJSON_GetObjectItem(f, "status"));
        T_EQ_S(status != NULL ? status : "", cases[i].status);
        cJSON_Delete(o);
    }
    T_EQ_I(reconstruct("--out s --start warm --solver sirt --save-report s.json"),
           0); /* has no coarser grids to start from instead */
    slurp("s.json");
    cJSON *o = cJSON_Parse(text);
    for (int i = 0; i < FRAMES; i++) {
        cJSON *f = cJSON_GetArrayItem(cJSON_GetObjectItem(o, "frames"), i);
        const char *start = cJSON_GetStringValue(cJSON_GetObjectItem(f, "start"));
        T_EQ_S(start != NULL ? start : "", i == 0 ? "cold" : "warm");
    }
    cJSON_Delete(o);
    T_EQ_I(reconstruct("--out s --start warm"), 0);
    T_LE(volume_error("s/000002.npy", 2, REC_BOX), 0.25);
}

static double image_difference(const char *a, const char *b)
{
    float *x, *y;
    size_t shape[4], same[4];
    int ndim;
    struct pvx_diag d = {""};
    if (cap_npy_load(at("%s", a), &x, shape, &ndim, &d) != PVX_OK)
        return 98;
    if (cap_npy_load(at("%s", b), &y, same, &ndim, &d) != PVX_OK) {
        free(x);
        return 97;
    }
    double e = memcmp(shape, same, sizeof same) == 0
                   ? rec_rel_l2(x, y, shape[0] * shape[1] * shape[2])
                   : 96;
    free(x);
    free(y);
    return e;
}

/* Folders of pictures: the same as one at a time, one exposure, any viewpoint. */
T_CASE_OF_THREADS(animations)
{
    T_EQ_I(pyrovox("render --rig rig.yaml --camera cam8 --format both vol movie"), 0);
    slurp("err");
    T_CONTAINS(text, "3 pictures in movie, exposure 1; ");
    T_CONTAINS(text, "ms per picture as a product");
    T_EQ_I(pyrovox("render --rig rig.yaml --camera cam8 vol/000002.npy one.npy"), 0);
    T_LE(image_difference("movie/000002.npy", "one.npy"), 1e-6);
    T_OK(access(at("movie/000000.png"), F_OK) == 0 && access(at("movie/000001.png"), F_OK) == 0);
    T_EQ_I(pyrovox("render --rig rig.yaml --camera cam8 --anew --format npy vol anew"), 0);
    slurp("err");
    T_CONTAINS(text, "traced anew");
    T_LE(image_difference("movie/000001.npy", "anew/000001.npy"), 1e-6);
    T_OK(access(at("anew/000001.png"), F_OK) != 0);
    /* cam8 by hand: its centre, what it looks at; an ideal lens is nearly the same */
    double eye[3];
    char args[300];
    rec_camera_centre(&rig.cameras[8], eye);
    double fov = 2 * atan(H / 2.0 / rig.cameras[8].fy) * 180 / 3.14159265358979;
    snprintf(args, sizeof args,
             "render --eye %.9f,%.9f,%.9f --look-at 0,0,0.5 --fov %.9f --size %dx%d "
             "vol/000001.npy eye.npy",
             eye[0], eye[1], eye[2], fov, W, H);
    T_EQ_I(pyrovox(args), 0);
    T_LE(image_difference("eye.npy", "movie/000001.npy"), 0.15);
    T_EQ_I(pyrovox("render --orbit 4 --size 40x50 --format both vol orbit"), 0);
    T_OK(access(at("orbit/000003.png"), F_OK) == 0 && access(at("orbit/000004.png"), F_OK) != 0);
    T_EQ_I(pyrovox("render --orbit 4 --size 40x50 --format npy vol/000000.npy turn"), 0);
    double turn = image_difference("turn/000000.npy", "turn/000001.npy");
    T_OK(turn > 0.05 && turn < 90); /* another side */
    static const struct cli_case wrong[] = {
        {"render --orbit 4 vol turn.png", "name a folder", 1},
        {"render --angle 4 vol turn.png", "name a folder", 1},
        {"render --angle 4 --eye 1,2,3 vol turn", "only one of", 2},
        {"render --eye 1,2 vol x", "--eye 1,2: should be X,Y,Z", 2},
        {"render --eye 0,0,3 vol x", "line of sight", 1},
        {"render --orbit 4 take x", "no volumes", 1},
        {"render --orbit 4 rig.yaml x", "a volume is a .npy", 1},
        {"render --orbit 4 vol/nope.npy x", "nope.npy", 1},
        {"render --rig rig.yaml --camera cam1 --size 4x4 vol x", "has its own", 2},
    };
    CLI_CASES("", wrong);
    /* whose box was lost */
    T_EQ_I(rename(at("vol/000001.json"), at("box.json")), 0);
    T_EQ_I(pyrovox("render --rig rig.yaml --camera cam8 vol x"), 1);
    T_CONTAINS(slurp("err"), "vol/000001.npy: has no .json with its box, as vol/000000.npy has");
    T_EQ_I(pyrovox("render --angle 4 vol/000001.npy x.png"), 1);
    T_CONTAINS(slurp("err"), "vol/000001.npy: has no .json");
    T_EQ_I(rename(at("box.json"), at("vol/000001.json")), 0);
    T_EQ_I(symlink(at("vol/000001.npy"), at("alone.npy")), 0);
    T_EQ_I(pyrovox("render --rig rig.yaml --camera cam8 alone.npy x.npy"), 0);
    T_LE(image_difference("x.npy", "movie/000001.npy"), 1e-6);
}

T_CASE(wrong_use)
{
    static const struct cli_case cases[] = {
        {"reconstruct --rig rig.yaml --out x", "--frames", 2},
        {"reconstruct --rig nope.yaml --frames take --out x", "nope.yaml", 1},
        {"reconstruct --rig rig.yaml --frames nowhere --out x", "no frames", 1},
        {"reconstruct --rig rig.yaml --frames take --cameras cam0,camZ --out x", "camZ", 1},
        {"reconstruct --rig rig.yaml --frames take --out x --grid 0", "--grid", 2},
        {"reconstruct --rig rig.yaml --frames take --out x --solver magic", "magic", 2},
        {"reconstruct --rig rig.yaml --frames take --out x --binning 7", "binning", 1},
        {"reconstruct --rig rig.yaml --frames take --out x --first 5", "no frames", 1},
        {"reconstruct --rig rig.yaml --frames take --out rig.yaml", "rig.yaml", 1},
        {"reconstruct --rig rig.yaml --frames take --out x --min-views 10", "but there are only 9",
         1},
        {"reconstruct --rig rig.yaml --frames take --out x --stop never", "discrepancy", 2},
        {"reconstruct --rig rig.yaml --frames take --out x --start hot", "cold, warm", 2},
        {"reconstruct --rig rig.yaml --frames take --out x --hull-rule all", "conservative", 2},
        {"reconstruct --rig rig.yaml --frames take --out x --save-rig y", "--fit-volume", 2},
        {"reconstruct --rig rig.yaml --frames take --out x --fit-volume --no-hull", "hull", 2},
        {"reconstruct --rig rig.yaml --frames take --out x --fit-volume=wide", "--fit-volume", 2},
        {"reconstruct --rig rig.yaml --frames take --out x --background nope", "nope", 1},
    };
    CLI_CASES("", cases);
}

T_CASE(grey_and_background)
{
    T_EQ_I(reconstruct("--out grey --grey --last 0 --quiet"), 0);
    float *v;
    size_t shape[4];
    int ndim;
    struct pvx_diag d = {""};
    T_EQ_I(cap_npy_load(at("grey/000000.npy"), &v, shape, &ndim, &d), PVX_OK);
    T_EQ_I(ndim * 10 + (int)shape[3], 41);
    free(v);
    /* a lamp in every picture: subtracted, the flame is as good as without it */
    float *img = malloc(W * H * 3 * sizeof *img);
    T_EQ_I(pvx_mkdirs(at("bg"), &d), PVX_OK);
    for (int c = 0; c < CAMERAS - 1; c++) {
        struct cap_loaded l;
        T_EQ_I(cap_image_load(at("take/cam%d/000000.npy", c), &l, &d), PVX_OK);
        memcpy(img, l.img.data, W * H * 3 * sizeof *img);
        cap_loaded_free(&l);
        for (int i = 0; i < W * H * 3; i++)
            img[i] += 0.3f;
        T_EQ_I(pvx_mkdirs(at("lamp/cam%d", c), &d), PVX_OK);
        T_EQ_I(cap_image_save(at("lamp/cam%d/000000.npy", c), img, W, H, 3, &d), PVX_OK);
        for (int i = 0; i < W * H * 3; i++)
            img[i] = 0.3f;
        T_EQ_I(cap_image_save(at("bg/cam%d.npy", c), img, W, H, 3, &d), PVX_OK);
    }
    free(img);
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames lamp " EIGHT
                   " --out dark --background bg --quiet"),
           0);
    T_LE(volume_error("dark/000000.npy", 0, REC_BOX), 0.25);
}

/* The first pictures of `take`, times `times` plus `more`, into DIR/name, those of the cameras in `grey` without colour. */
static void retake(const char *name, unsigned grey, float times, float more)
{
    static float img[W * H * 3], one[W * H];
    struct pvx_diag d = {""};
    for (int c = 0; c < CAMERAS - 1; c++) {
        struct cap_loaded l;
        T_EQ_I(cap_image_load(at("take/cam%d/000000.npy", c), &l, &d), PVX_OK);
        memcpy(img, l.img.data, sizeof img);
        cap_loaded_free(&l);
        for (int i = 0; i < W * H * 3; i++)
            img[i] = img[i] * times + more;
        for (int i = 0; i < W * H; i++)
            one[i] = (img[3 * i] + img[3 * i + 1] + img[3 * i + 2]) / 3;
        bool is = grey >> c & 1;
        T_EQ_I(pvx_mkdirs(at("%s/cam%d", name, c), &d), PVX_OK);
        T_EQ_I(cap_image_save(at("%s/cam%d/000000.npy", name, c), is ? one : img, W, H, is ? 1 : 3,
                              &d),
               PVX_OK);
    }
    T_EQ_S(d.text, "");
}

T_CASE(grey_beside_colour)
{
    retake("mixed", 0x12, 1, 0);
    retake("first", 0x01, 1, 0);
    retake("mono", 0xff, 1, 0);
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames mono " EIGHT " --out mono-v --quiet"), 0);
    float *v, *w;
    size_t shape[4];
    int ndim;
    T_EQ_I(cap_npy_load(at("mono-v/000000.npy"), &v, shape, &ndim, NULL), PVX_OK);
    T_EQ_I(shape[3], 1);
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames mixed " EIGHT " --out m --grey --quiet"),
           0);
    T_EQ_I(cap_npy_load(at("m/000000.npy"), &w, shape, &ndim, NULL), PVX_OK);
    T_LE(rec_rel_l2(w, v, (size_t)N * N * N), 1e-3);
    free(v);
    free(w);
    T_EQ_I(pvx_mkdirs(at("half"), NULL), PVX_OK); /* colour backgrounds, but one */
    T_EQ_I(pvx_mkdirs(at("nan"), NULL), PVX_OK);
    static float no[W * H * 3], zero[W * H * 3];
    for (int i = 0; i < W * H * 3; i++)
        no[i] = NAN;
    for (int c = 0; c < CAMERAS - 1; c++) {
        T_EQ_I(cap_image_save(at("half/cam%d.npy", c), zero, W, H, c == 3 ? 1 : 3, NULL), PVX_OK);
        T_EQ_I(cap_image_save(at("nan/cam%d.npy", c), c == 3 ? no : zero, W, H, 3, NULL), PVX_OK);
    }
    static const struct cli_case cases[] = {
        {"mixed " EIGHT, "pictures of cam1, cam4 are grey, those of cam0, cam2", 1},
        {"first " EIGHT, "pictures of cam0 are grey", 1},
        {"mixed --cameras cam0,cam2,cam3,cam5", "1 volume in x", 0},
        {"take " EIGHT " --last 0 --background half", "half/cam3.npy: this background is grey", 1},
        {"mono " EIGHT " --background half", "half/cam0.npy: this background has colour", 1},
        {"take " EIGHT " --last 0 --background nan", "camera cam3: no pixel is a finite number", 1},
    };
    CLI_CASES("reconstruct --rig rig.yaml --out x --frames", cases);
}

/* Floats of any scale have a pedestal in their own unit; a picture of NaN is named and does no harm. */
T_CASE(floats_of_any_scale)
{
    static float no[W * H * 3];
    for (int i = 0; i < W * H * 3; i++)
        no[i] = NAN;
    for (int i = 0; i < W * H / 20 * 3; i++)
        no[i] = 0;
    retake("few", 0, 1, 0); /* 5 % of a picture are numbers */
    T_EQ_I(cap_image_save(at("few/cam2/000000.npy"), no, W, H, 3, NULL), PVX_OK);
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames few " EIGHT " --out x --quiet"), 0);
    T_CONTAINS(slurp("err"), "95 % of the image of cam2 say nothing");
    for (int i = 0; i < W * H * 3; i++)
        no[i] = NAN;
    retake("counts", 0, 1000, 5.1F);
    T_EQ_I(cap_image_save(at("counts/cam2/000000.npy"), no, W, H, 3, NULL), PVX_OK);
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames counts " EIGHT
                   " --out counts-v --black 5.1 --quiet"),
           1);
    T_CONTAINS(slurp("err"), "cam2/000000.npy: camera cam2: no pixel is a finite number");
    T_OK(strstr(text, "count as flame") == NULL);
    float *v;
    size_t shape[4];
    int ndim;
    T_EQ_I(cap_npy_load(at("counts-v/000000.npy"), &v, shape, &ndim, NULL), PVX_OK);
    for (size_t i = 0; i < (size_t)N * N * N * 3; i++)
        v[i] /= 1000;
    T_EQ_I(cap_npy_save(at("counts-v/000000.npy"), v, shape, ndim, NULL), PVX_OK);
    free(v);
    T_LE(volume_error("counts-v/000000.npy", 0, REC_BOX), 0.25);
}

/* `take` as words of 16 bits into DIR/name: light 1 is the sample `one`, samples end at `most`, and lie `up` bits
 * higher. */
static void words(const char *name, int channels, double one, int most, int up)
{
    static uint16_t px[W * H * 3];
    struct pvx_diag d = {""};
    for (int c = 0; c < CAMERAS - 1; c++)
        for (int f = 0; f < FRAMES; f++) {
            struct cap_loaded l;
            T_EQ_I(cap_image_load(at("take/cam%d/%06d.npy", c, f), &l, &d), PVX_OK);
            const float *v = l.img.data;
            for (int i = 0; i < W * H * channels; i++) {
                double x =
                    channels == 3 ? (double)v[i] : ((double)v[3 * i] + (double)v[3 * i + 1]) / 2;
                px[i] = (uint16_t)((int)fmin(fmax(x * one, 0), most) << up);
            }
            cap_loaded_free(&l);
            T_EQ_I(pvx_mkdirs(at("%s/cam%d", name, c), &d), PVX_OK);
            T_EQ_I(cap_image_write(at("%s/cam%d/%06d.png", name, c, f), px, W, H, channels, 16, &d),
                   PVX_OK);
        }
    T_EQ_S(d.text, "");
}

static double reported(const char *what)
{
    slurp("report.json");
    cJSON *o = cJSON_Parse(text), *list = cJSON_GetObjectItem(o, "frames");
    double v = cJSON_GetNumberValue(cJSON_GetObjectItem(cJSON_GetArrayItem(list, 0), what));
    cJSON_Delete(o);
    return v;
}

/* Samples of 12 bits in 16: that they end there is said, and counted as saturation; with the right format the flame
 * comes back. */
T_CASE(fewer_bits_than_the_file)
{
    words("bright", 3, 20000, 4095, 0);
    words("grey12", 1, 20000, 4095, 0);
    words("upper", 3, 20000, 4095, 4);
    words("fits", 3, 3000, 4095, 0);
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames bright " EIGHT
                   " --out x --quiet --save-report report.json"),
           0);
    T_CONTAINS(slurp("err"), "bright: samples of cam0");
    T_CONTAINS(text, "go up to 4095 and stop there: these are 12 bits in 16, saturated at 4095; "
                     "--pixel-format RGB12 makes that full scale");
    double bright = reported("saturated");
    T_OK(bright > 100);
    static const char *const same[] = {"bright " EIGHT " --pixel-format RGB12", "upper " EIGHT};
    for (int k = 0; k < 2; k++) { /* the same samples are saturated */
        char args[300];
        snprintf(args, sizeof args,
                 "reconstruct --rig rig.yaml --out x --last 0 --quiet --save-report report.json "
                 "--frames %s",
                 same[k]);
        T_EQ_I(pyrovox(args), 0);
        T_OK(strstr(slurp("err"), "bits") == NULL);
        T_NEAR(reported("saturated"), bright, 0.01 * bright);
    }
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames fits " EIGHT
                   " --out fits-v --last 0 --quiet --pixel-format RGB12"),
           0);
    float *v;
    size_t shape[4];
    int ndim;
    T_EQ_I(cap_npy_load(at("fits-v/000000.npy"), &v, shape, &ndim, NULL), PVX_OK);
    for (size_t i = 0; i < (size_t)N * N * N * 3; i++)
        v[i] *= 4095.0F / 3000;
    T_EQ_I(cap_npy_save(at("fits-v/000000.npy"), v, shape, ndim, NULL), PVX_OK);
    free(v);
    T_LE(volume_error("fits-v/000000.npy", 0, REC_BOX), 0.25);
    static const struct cli_case cases[] = {
        {"grey12 " EIGHT " --last 0", "--pixel-format Mono12", 0},
        {"bright " EIGHT " --pixel-format Mono12",
         "RGB16 image cannot be read as Mono12, but as RGB12", 1},
        {"grey12 " EIGHT " --last 0 --pixel-format Mono10",
         "cam0/000000.png: Mono10 image: a sample is 4095, but 10 bits end at 1023", 1},
        {"upper " EIGHT " --last 0 --pixel-format RGB14", "or lie in the upper ones (RGB16)", 1},
        {"bright " EIGHT " --black 5.1", "--black 5.1: should be 0 to 1, a share of full scale", 1},
    };
    CLI_CASES("reconstruct --rig rig.yaml --out x --quiet --frames", cases);
}

int main(void)
{
    cli_begin();
    if (rec_rig_ring(CAMERAS, 2.2, W, H, N, &rig) != PVX_OK)
        return 1;
    write_rig("rig.yaml", &rig);
    rec_flame_init(&flame, &rig.grid, 5);
    record("take", "npy");
    t_run();
    rec_rig_fini(&rig);
    scratch_remove();
    return t_done();
}
