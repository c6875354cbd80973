/* test_cli_check.c - `pyrovox calibrate check` and `refine` as a user runs them: a bumped camera is named, with how
 * far and which way; what tells nothing is refused in a sentence. */
#include "../t.h"

#include <cjson/cJSON.h>

#include "capture/files/imgio.h"
#include "tests/lib/cli.h"
#include "tests/lib/flame_rig.h"

#define PEDESTAL 0.05F

enum { W = 96, SETS = 6, CAMERAS = 6 };

static struct flame_rig f;

/* DIR/NAME/camN/NNNNNN.npy; cameras from `first` to `last` spoilt. */
static void record_some(const char *name, size_t first, size_t last, enum spoil what)
{
    float *out = must_floats((size_t)f.w * (size_t)f.h);
    struct pvx_diag d = {""};
    for (size_t c = 0; c < CAMERAS; c++) {
        T_EQ_I(pvx_mkdirs(at("%s/%s", name, f.rig.cameras[c].name), &d), PVX_OK);
        for (size_t i = 0; i < SETS; i++) {
            spoil_picture(&f, c >= first && c <= last ? what : SPOIL_NOTHING, i, c, t_normal, out);
            T_EQ_I(cap_image_save(at("%s/%s/%06zu.npy", name, f.rig.cameras[c].name, i), out, f.w,
                                  f.h, 1, &d),
                   PVX_OK);
        }
    }
    free(out);
}

static void record(const char *name, size_t spoilt, enum spoil what)
{
    record_some(name, spoilt, spoilt, what);
}

/* The flame as a spot of 3 x 3 pixels that flickers. */
static void shrink(void)
{
    for (size_t i = 0; i < SETS; i++)
        for (size_t c = 0; c < CAMERAS; c++)
            for (int32_t k = 0; k < f.w * f.h; k++) {
                bool in = abs(k % f.w - f.w / 2) <= 1 && abs(k / f.w - f.h / 2) <= 1;
                f.picture[i][c][k] =
                    0.005F * (float)t_normal() + (in ? 0.5F + 0.1F * (float)(i % 3) : 0);
            }
}

/* line/: as cameras beside each other see it; line.yaml: one of them lies lower. */
static void record_line(void)
{
    struct flame_rig ring = f;
    const double mid[3] = {0, 0, 0.5}, none[3] = {0}, up[3] = {0, 0.05, 0};
    f = (struct flame_rig){.w = ring.w, .h = ring.h, .n = SETS};
    T_EQ_I(rec_rig_copy(&ring.rig, &f.rig), PVX_OK);
    for (size_t c = 0; c < CAMERAS; c++) {
        const double eye[3] = {0.5 * (double)c - 1.2, -2, 0.5}, to[3] = {0, 0, 0.5};
        rec_camera_look(eye, to, &f.rig.cameras[c]);
    }
    flame_rig_shoot(&f, 42, 0.1, t_normal);
    record("line", CAMERAS, SPOIL_NOTHING);
    rec_camera_nudge(&f.rig.cameras[2], mid, none, up);
    write_rig("line.yaml", &f.rig);
    flame_rig_free(&f);
    f = ring;
}

static void lift(float by)
{
    for (size_t i = 0; i < SETS; i++)
        for (size_t c = 0; c < CAMERAS; c++)
            for (size_t k = 0; k < (size_t)f.w * (size_t)f.h; k++)
                f.picture[i][c][k] += by;
}

static bool says(const char *file, const char *words)
{
    return strstr(slurp(file), words) != NULL;
}

T_CASE(a_right_rig)
{
    T_EQ_I(pyrovox("calibrate check --rig rig.yaml --frames good --quiet"), 0);
    T_OK(says("out.txt", "the flame agrees with the rig in all 6 cameras"));
    T_EQ_S(slurp("err"), "");
}

T_CASE(a_black_level)
{
    T_NOT_UNDER_SANITIZERS();
    T_EQ_I(pyrovox("calibrate check --rig rig.yaml --frames pedestal --quiet"), 1);
    T_OK(says("err", "--black"));
    T_EQ_I(pyrovox("calibrate check --rig rig.yaml --frames pedestal --quiet --black 0.05"), 0);
    T_OK(says("out.txt", "the flame agrees with the rig in all 6 cameras"));
}

T_CASE(a_bumped_camera)
{
    T_EQ_I(pyrovox("calibrate check --rig rig.yaml --frames bumped --quiet --report c.html "
                   "--report c.json"),
           1);
    T_OK(says("out.txt", "cam2 moved: its flame lies 3."));
    T_OK(says("out.txt", "right, 2.0 up"));
    T_OK(says("out.txt", "pyrovox calibrate"));
    T_OK(says("out.txt", "1 of 6 cameras is wrong; the others agree"));
    cJSON *o = cJSON_Parse(slurp("c.json")),
          *cam = cJSON_GetArrayItem(cJSON_GetObjectItem(o, "cameras"), 2);
    T_EQ_S(cJSON_GetStringValue(cJSON_GetObjectItem(o, "outcome")), "named");
    T_EQ_S(cJSON_GetStringValue(cJSON_GetObjectItem(cam, "wrong")), "moved");
    T_NEAR(cJSON_GetNumberValue(cJSON_GetObjectItem(cam, "right_px")), 3, 0.2);
    T_NEAR(cJSON_GetNumberValue(cJSON_GetObjectItem(cam, "down_px")), -2, 0.2);
    T_OK(cJSON_IsFalse(cJSON_GetObjectItem(cam, "believed")));
    cJSON_Delete(o);
    T_OK(says("c.html", "cam2 moved: "));
    T_OK(says("c.html", "data:image/bmp;base64,Qk"));
    T_OK(!says("c.html", "<script"));
}

T_CASE(a_rig_read_wrongly)
{
    struct rec_rig wrong;
    T_EQ_I(rec_rig_copy(&f.rig, &wrong), PVX_OK);
    for (size_t c = 0; c < CAMERAS; c++)
        for (int i = 0; i < 9; i++)
            wrong.cameras[c].R[i] = f.rig.cameras[c].R[3 * (i % 3) + i / 3];
    write_rig("wrong.yaml", &wrong);
    for (size_t c = 0; c < CAMERAS; c++)
        if (c != 2)
            memcpy(wrong.cameras[c].R, f.rig.cameras[c].R, sizeof wrong.cameras[c].R);
    write_rig("one.yaml", &wrong);
    rec_rig_fini(&wrong);
    T_EQ_I(pyrovox("calibrate check --rig wrong.yaml --frames good --quiet"), 1);
    T_OK(says("out.txt", "if R is transposed"));
    T_EQ_I(pyrovox("reconstruct --rig wrong.yaml --frames good --out v --quiet --last 0"), 1);
    T_OK(says("err", "if R is transposed"));
    T_OK(says("err", "or --anyway"));
    T_OK(access(at("v/000000.npy"), F_OK) != 0);
    T_EQ_I(pyrovox("reconstruct --rig wrong.yaml --frames good --out v --quiet --last 0 --anyway"),
           0);
    T_OK(says("err", "if R is transposed"));
    T_EQ_I(pyrovox("reconstruct --rig one.yaml --frames good --out v --quiet --last 0"), 0);
    T_OK(says("err", "if R is transposed in cam2"));
    record("late", 2, SPOIL_NOTHING); /* its cap comes off after three sets */
    record("cap", 2, SPOIL_CAP);
    for (int i = 0; i < 3; i++)
        T_EQ_I(rename(at("cap/cam2/%06d.npy", i), at("late/cam2/%06d.npy", i)), 0);
    T_EQ_I(pyrovox("reconstruct --rig one.yaml --frames late --out v --quiet"), 0);
    T_OK(says("err", "if R is transposed in cam2"));
    T_EQ_I(pyrovox("reconstruct --rig rig.yaml --frames good --out right --quiet --last 0"), 0);
    T_EQ_S(slurp("err"), "");
}

T_CASE(a_cap_on_a_lens)
{
    T_EQ_I(pyrovox("calibrate check --rig rig.yaml --frames capped --quiet"), 1);
    T_OK(says("out.txt", "cam4 dark: "));
    T_OK(says("out.txt", "take the cap off"));
}

/* The picture is right and the rig is not: the rig is corrected, and the flame then agrees with it. */
T_CASE(a_rig_refined)
{
    T_NOT_UNDER_SANITIZERS();
    struct rec_rig rig;
    const double mid[3] = {0, 0, 0.5}, none[3] = {0}, aside[3] = {0.05, -0.03, 0};
    T_EQ_I(rec_rig_copy(&f.rig, &rig), PVX_OK);
    rec_camera_nudge(&rig.cameras[2], mid, none, aside);
    write_rig("off.yaml", &rig);
    rec_rig_fini(&rig);
    T_EQ_I(pyrovox("calibrate check --rig off.yaml --frames good --quiet"), 1);
    T_OK(says("out.txt", "cam2 moved: "));
    T_EQ_I(pyrovox("calibrate refine --rig off.yaml --frames good --quiet --out new.yaml"), 0);
    T_OK(says("out.txt", "4 frame sets fit, 2 judge"));
    T_OK(says("out.txt", "new.yaml: unseen views of held-out frames: error"));
    T_EQ_I(pyrovox("calibrate check --rig new.yaml --frames good --quiet"), 0);
    T_EQ_I(pyrovox("calibrate refine --rig off.yaml --frames good --quiet --out new.yaml"), 1);
    T_OK(says("err", "new.yaml is there already; --force writes over it"));
}

/* Nothing is written where it cannot be had. */
T_CASE(what_is_not_refined)
{
    static const struct cli_case bad[] = {
        {"--frames good --last 4", "5 frame sets: a refinement needs 6", 1},
        {"--frames capped", "cam4 is wrong, but not its pose (dark): take the cap off", 1},
        {"--frames still", "never moves", 1},
        {"--frames two", "2 of 6 cameras see any flame", 1},
        {"--frames speck", "fills too little of the pictures", 1},
        {"--frames good --cameras cam0,cam1,cam2", "fewer than 4", 1}};
    CLI_CASES("calibrate refine --rig rig.yaml --quiet --out no.yaml", bad);
    T_OK(access(at("no.yaml"), F_OK) != 0);
    T_EQ_I(pyrovox("calibrate refine --rig rig.yaml --frames good"), 2);
    T_OK(says("err", "where to? --out refined.yaml"));
}

/* What such cameras cannot see is held, and said. */
T_CASE(cameras_in_a_line)
{
    T_NOT_UNDER_SANITIZERS();
    int code = pyrovox("calibrate refine --rig line.yaml --frames line --quiet --out bent.yaml");
    T_LE(code, 1);
    T_OK(says("out.txt", "the cameras stand in a line: the direction from which each looks, its "
                         "distance and its focal length cannot be seen and are held"));
    T_EQ_I(access(at("bent.yaml"), F_OK) == 0, code == 0);
}

T_CASE(what_cannot_be_judged)
{
    static const struct cli_case bad[] = {
        {"--rig rig.yaml", "which flame?", 2},
        {"--frames good", "which rig?", 2},
        {"--rig rig.yaml --frames good --cameras cam0,cam1,cam2", "fewer than 4", 1},
        {"--rig rig.yaml --frames still", "never moves", 1},
        {"--rig rig.yaml --frames two", "2 of 6 cameras see any flame", 1},
        {"--rig rig.yaml --frames speck", "fills too little of the pictures", 1},
        {"--rig rig.yaml --frames good --last 1", "2 frame sets", 1},
        {"--rig rig.yaml --frames nowhere", "nowhere: no frames", 1},
        {"--rig rig.yaml --frames good --binning 7", "--binning 7 does not divide", 1},
        {"--rig rig.yaml --frames good --report c.txt", "c.txt: a report is written as", 1},
        {"--rig rig.yaml --frames good --transfer x", "--transfer x", 2},
        {"--rig rig.yaml --frames good more", "takes options only", 2},
    };
    CLI_CASES("calibrate check --quiet", bad);
}

static void begin(void)
{
    cli_begin();
    flame_rig_new(&f, CAMERAS, W, SETS, 31, t_normal);
    write_rig("rig.yaml", &f.rig);
    record("good", CAMERAS, SPOIL_NOTHING);
    record("bumped", 2, SPOIL_SHIFT);
    record("capped", 4, SPOIL_CAP);
    record_some("two", 2, CAMERAS - 1, SPOIL_CAP);
    record_line();
    lift(PEDESTAL);
    record("pedestal", CAMERAS, SPOIL_NOTHING);
    lift(-PEDESTAL);
    for (size_t i = 1; i < SETS; i++) /* all the same picture */
        for (size_t c = 0; c < CAMERAS; c++)
            memcpy(f.picture[i][c], f.picture[0][c],
                   (size_t)f.w * (size_t)f.h * sizeof *f.picture[0][c]);
    record("still", CAMERAS, SPOIL_NOTHING);
    shrink();
    record("speck", CAMERAS, SPOIL_NOTHING);
}
static void end(void)
{
    flame_rig_free(&f);
    scratch_remove();
}
T_MAIN(begin(), end())
