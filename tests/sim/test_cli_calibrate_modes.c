/* test_cli_calibrate_modes.c - `pyrovox calibrate solve` where pictures of the board are not as those of the flame will
 * be: refused until binning and region are declared, then the rig is that of the flame's pictures.
 *
 * cam0: the first poses unbinned, 640x480, the others as its sensor bins them, 2 x 2; cam1: the last two poses are of a
 * region; the flame's pictures are binned, and of that region. */
#include "../t.h"

#include <cjson/cJSON.h>

#include "capture/files/imgio.h"
#include "recon/board/spec.h"
#include "recon/calib/calib.h"
#include "tests/lib/calib_bed.h"

enum { X = 40, Y = 30, RW = 240, RH = 180, FINE = 7, CUT = POSES - 2 };

static float level[4 * W * H], other[W * H];

static void save(int camera, int pose, const float *pixels, int w, int h)
{
    struct pvx_diag d = {""};
    pvx_err e = cap_image_save(at("mixed/cam%d/%06d.png", camera, pose), pixels, w, h, 1, &d);
    T_CHECK_(e == PVX_OK, "%s", d.text);
}

static void record(void)
{
    struct rec_board b;
    struct pvx_diag d = {""};
    T_EQ_I(rec_board_parse(BOARD, &b, &d), PVX_OK);
    for (int c = 0; c < CAMERAS; c++) {
        T_EQ_I(pvx_mkdirs(at("mixed/cam%d", c), &d), PVX_OK);
        for (int p = 0; p < POSES; p++) {
            shoot(&b, c, p, c == 0 ? 2 : 1, level);
            if (c == 0 && p >= FINE) {
                for (int i = 0; i < W * H; i++) {
                    const float *q = level + 4 * (i / W) * W + 2 * (i % W);
                    other[i] = 0.25f * (q[0] + q[1] + q[2 * W] + q[2 * W + 1]);
                }
                save(c, p, other, W, H);
            } else if (c == 1 && p >= CUT) {
                for (int i = 0; i < RW * RH; i++)
                    other[i] = level[(i / RW + Y) * W + i % RW + X];
                save(c, p, other, RW, RH);
            } else {
                save(c, p, level, c == 0 ? 2 * W : W, c == 0 ? 2 * H : H);
            }
        }
    }
}

/* Views that were used of a camera's poses from `from`. */
static int used(const char *report, const char *camera, int from)
{
    cJSON *o = cJSON_Parse(slurp(report));
    const cJSON *p;
    int n = 0;
    cJSON_ArrayForEach(p, cJSON_GetObjectItem(o, "pictures"))
    {
        const cJSON *fate = cJSON_GetObjectItem(p, "fate");
        n += cJSON_IsString(fate) && strcmp(fate->valuestring, "used") == 0 &&
             strcmp(cJSON_GetObjectItem(p, "camera")->valuestring, camera) == 0 &&
             cJSON_GetObjectItem(p, "frame")->valueint >= from;
    }
    cJSON_Delete(o);
    return n;
}

#define MIXED \
    SOLVE "mixed --board " BOARD " " VOLUME " --voxels 32 --keep true.yaml --out rig.yaml "

T_CASE(refused_until_it_is_said)
{
    T_EQ_I(pyrovox(MIXED), 1);
    T_CONTAINS(
        slurp("err"),
        "mixed/cam0/000007.png: 320 x 240 pixels, but other pictures of cam0 have 640 x 480");
    T_EQ_I(pyrovox(MIXED "--binning 2,cam0"), 1);
    T_CONTAINS(slurp("err"), "mixed/cam1/000010.png: 240 x 180 pixels");
    T_EQ_I(pyrovox(MIXED "--binning 4,cam0"), 1);
    T_CONTAINS(slurp("err"), "other pictures of cam0 have 160 x 120");
    T_EQ_I(pyrovox(MIXED "--binning 2,cam0 --region 100,30,240,180,cam1"), 1);
    T_CONTAINS(slurp("err"), "--region 100,30,240,180: pictures of cam1 have 320 x 240 pixels");
    T_EQ_I(pyrovox(MIXED "--binning 2,cam7"), 1);
    T_CONTAINS(slurp("err"), "'cam7'");
    T_EQ_I(pyrovox(MIXED "--binning 0"), 1);
    T_EQ_I(pyrovox(MIXED "--binning 2x"), 1);
    T_EQ_I(pyrovox(MIXED "--binning 2,"), 1);
    T_EQ_I(pyrovox(MIXED "--region 1,2,3"), 1);
    T_CONTAINS(slurp("err"), "--region 1,2,3: should be X,Y,WIDTH,HEIGHT");
    T_OK(!there("rig.yaml"));
}

T_CASE(the_rig_is_that_of_the_flame_s_pictures)
{
    struct rec_rig rig = {0};
    struct pvx_diag d = {""};
    double rms = NAN, worst = NAN;
    T_EQ_I(pyrovox(MIXED "--binning 2,cam0 --region 40,30,240,180,cam1 --report rig.json"), 0);
    T_OK(used("rig.json", "cam0", FINE) >=
         3); /* of both kinds; in two poses it does not see the board */
    T_OK(used("rig.json", "cam0", 0) - used("rig.json", "cam0", FINE) >= 3);
    T_EQ_I(used("rig.json", "cam1", CUT), POSES - CUT);
    pvx_err e = rec_rig_load(at("rig.yaml"), &rig, &d);
    T_CHECK_(e == PVX_OK, "%s", d.text);
    if (e != PVX_OK)
        return;
    T_EQ_I(rig.cameras[0].width, W);
    T_EQ_I(rig.cameras[0].height, H);
    T_EQ_I(rig.cameras[1].width, RW);
    T_EQ_I(rig.cameras[1].height, RH);
    struct rec_camera *k = &truth.cameras[1];
    k->cx -= X;
    k->cy -= Y;
    k->width = RW;
    k->height = RH;
    T_EQ_I(rec_calib_distance(&truth, &rig, &rms, &worst), PVX_OK);
    printf("  volume error %.3f px rms, %.3f largest\n", rms, worst);
    T_LE(rms, 0.05); /* half a pixel would be 0.25 in cam0 alone */
    T_LE(worst, 0.2);
    for (int c = 0; c < 2; c++)
        T_NEAR(rig.cameras[c].fx / truth.cameras[c].fx, 1, 0.01);
    rec_rig_fini(&rig);
    /* the rig of such pictures is an older rig for them */
    T_EQ_I(rename(at("rig.yaml"), at("old.yaml")), 0);
    T_EQ_I(pyrovox(SOLVE "mixed --board " BOARD " " VOLUME " --voxels 32 --keep old.yaml "
                         "--fix-intrinsics old.yaml --binning 2,cam0 --region 40,30,240,180,cam1 "
                         "--out rig.yaml"),
           0);
    T_EQ_I(rec_rig_load(at("rig.yaml"), &rig, &d), PVX_OK);
    T_EQ_S(d.text, "");
    T_EQ_I(rec_calib_distance(&truth, &rig, &rms, &worst), PVX_OK);
    T_LE(rms, 0.05);
    rec_rig_fini(&rig);
}

T_MAIN((bed_begin(), record()), bed_end())
