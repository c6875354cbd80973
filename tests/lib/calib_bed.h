/* calib_bed.h - four known cameras look at a known board, for tests of `pyrovox calibrate` as a user runs it. */
#ifndef TESTS_CALIB_BED_H
#define TESTS_CALIB_BED_H
#include "tests/t.h"

#include <math.h>
#include <unistd.h>

#include "base/file.h"
#include "recon/geom/rig.h"
#include "tests/lib/board_picture.h"
#include "tests/lib/cli.h"

#define BOARD  "charuco:5x6:0.06:0.045"
#define VOLUME "--volume -0.2,-0.2,0,0.2,0.2,0.4"
#define SOLVE  "calibrate solve --quiet --threads 2 --frames "

enum { W = 320, H = 240, CAMERAS = 4, POSES = 12 };

static struct rec_rig truth;

static inline bool there(const char *name)
{
    return access(at("%s", name), F_OK) == 0;
}
/* Cameras on a third of a ring of 1.1 m, no two alike. */
static inline void set_up(void)
{
    truth =
        (struct rec_rig){.grid = {{-0.2, -0.2, 0}, {0.2, 0.2, 0.4}, {32, 32, 32}, REC_TRILINEAR},
                         .n_cameras = CAMERAS,
                         .cameras = calloc(CAMERAS, sizeof *truth.cameras)};
    for (int c = 0; c < CAMERAS; c++) {
        struct rec_camera *k = &truth.cameras[c];
        double a = 0.6 * (c - 1.5), aim[3] = {0.02 * c - 0.03, 0, 0.2};
        double eye[3] = {1.1 * cos(a), 1.1 * sin(a), c % 2 ? 0.4 : 0.1};
        *k = (struct rec_camera){.width = W,
                                 .height = H,
                                 .fx = 330 + 3 * c,
                                 .fy = 330 + 3 * c,
                                 .cx = 160.3 - c,
                                 .cy = 118.4 + c,
                                 .dist = {-0.06 + 0.02 * c, 0.01, 3e-4, -2e-4},
                                 .gain = {1, 1, 1}};
        snprintf(k->name, sizeof k->name, "cam%d", c);
        rec_camera_look(eye, aim, k);
    }
}

/* The board in front of the cameras: its z into it, away from them, tilted by a and b, rolled by r. */
static inline void board_at(int pose, double R[9], double t[3])
{
    double a = pose == 0 ? 0 : 0.4 * sin(2.4 * pose), b = pose == 0 ? 0 : 0.45 * cos(1.7 * pose),
           r = 0.5 * sin(1.1 * pose);
    double facing[9] = {0, 0, -1, 1, 0, 0, 0, -1, 0};
    double A[9] = {cos(a), 0, sin(a), 0, 1, 0, -sin(a), 0, cos(a)};
    double B[9] = {1, 0, 0, 0, cos(b), -sin(b), 0, sin(b), cos(b)};
    double C[9] = {cos(r), -sin(r), 0, sin(r), cos(r), 0, 0, 0, 1}, AB[9], ABC[9];
    board_matmul(A, B, AB);
    board_matmul(AB, C, ABC);
    board_matmul(facing, ABC, R);
    double middle[3] = {0.09, 0.12, 0};
    double to[3] = {0.1 * sin(3.1 * pose), 0.13 * sin(1.9 * pose + 1), 0.2 + 0.1 * sin(2.7 * pose)};
    for (int i = 0; i < 3; i++)
        t[i] = to[i] - R[3 * i] * middle[0] - R[3 * i + 1] * middle[1];
}

/* level [H * fine][W * fine]: what the sensor gives before fine x fine of its pixels are made one. */
static inline void shoot(const struct rec_board *b, int camera, int pose, int fine, float *level)
{
    const struct rec_camera *k = &truth.cameras[camera];
    struct board_shot s = {.width = W * fine,
                           .height = H * fine,
                           .f = k->fx * fine,
                           .cx = (k->cx + 0.5) * fine - 0.5,
                           .cy = (k->cy + 0.5) * fine - 0.5,
                           .blur = 0.6,
                           .noise = 0.01,
                           .dark = 0.1,
                           .light = 0.8,
                           .ground = 0.4,
                           .across = 2,
                           .seed = (uint64_t)(1 + camera + 100 * pose)};
    double R[9], t[3];
    board_at(pose, R, t);
    memcpy(s.k, k->dist, sizeof s.k);
    board_matmul(k->R, R, s.R);
    for (int i = 0; i < 3; i++)
        s.t[i] = k->R[3 * i] * t[0] + k->R[3 * i + 1] * t[1] + k->R[3 * i + 2] * t[2] + k->t[i];
    board_picture(b, &s, level);
}

/* The scratch folder, with the truth as true.yaml. */
static inline void bed_begin(void)
{
    cli_begin();
    set_up();
    write_rig("true.yaml", &truth);
}
static inline void bed_end(void)
{
    rec_rig_fini(&truth);
    scratch_remove();
}
#endif
