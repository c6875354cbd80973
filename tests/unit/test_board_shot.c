/* What simulated cameras are shown is what the tests' own renderer draws, which shares nothing with it but the bits
 * of the markers; and where a held board is. */
#include "recon/board/shot.h"

#include "recon/board/hold.h"
#include "recon/board/spec.h"
#include "tests/lib/board_picture.h"
#include "tests/t.h"

enum { W = 320, H = 240 };

static const struct rec_camera lens = {.width = W,
                                       .height = H,
                                       .fx = 330,
                                       .fy = 330,
                                       .cx = 158.3,
                                       .cy = 121.4,
                                       .dist = {-0.1, 0.03, 1e-3, -2e-3}};

/* On the print, a bit away from its rim. */
static bool on_print(const struct rec_print *p, const struct rec_camera *cam, const double R[9],
                     const double t[3], int u, int v)
{
    double o[3], dir[3], a[3] = {0}, d[3] = {0};
    if (!rec_camera_ray(cam, u, v, o, dir))
        return false;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            a[i] += R[3 * j + i] * (o[j] - t[j]);
            d[i] += R[3 * j + i] * dir[j];
        }
    double x = a[0] - a[2] / d[2] * d[0], y = a[1] - a[2] / d[2] * d[1], m = 0.2 * p->pitch;
    return x > p->x0 + m && x < p->x1 - m && y > p->y0 + m && y < p->y1 - m;
}

/* The board tilted before a camera that stands somewhere, both ways; rms and mean of their difference on the
 * print (the paper around it reaches less far in the other one). */
static void compare(const char *spec, bool from_behind, double roll, double *rms, double *mean)
{
    static float ours[W * H], theirs[W * H];
    const double eye[3] = {0.9, 0.3, 0.5}, middle[3] = {0.02, -0.01, 0.1};
    double face[3] = {from_behind ? -0.9 : 0.9, from_behind ? 0.2 : -0.2, 0.35}, R[9], t[3];
    struct rec_camera cam = lens;
    struct rec_board b;
    struct rec_print p;
    struct pvx_diag d = {""};
    T_EQ_I(rec_board_parse(spec, &b, &d), PVX_OK);
    T_EQ_I(rec_print_init(&p, &b, &d), PVX_OK);
    T_EQ_S(d.text, "");
    rec_camera_look(eye, middle, &cam);
    rec_board_hold(&b, middle, face, roll, R, t);
    struct rec_board_shot s = {.print = &p,
                               .camera = &cam,
                               .ink = 0.1,
                               .paper = 0.8,
                               .ground = 0.4,
                               .blur = 0.7,
                               .across = 4};
    memcpy(s.R, R, sizeof R);
    memcpy(s.t, t, sizeof t);
    T_EQ_I(rec_board_shoot(&s, ours), PVX_OK);
    struct board_shot o = {.width = W,
                           .height = H,
                           .f = cam.fx,
                           .cx = cam.cx,
                           .cy = cam.cy,
                           .dark = 0.1,
                           .light = 0.8,
                           .ground = 0.4,
                           .blur = 0.7,
                           .across = 6,
                           .seed = 1};
    memcpy(o.k, cam.dist, sizeof o.k);
    board_matmul(cam.R, R, o.R);
    for (int i = 0; i < 3; i++)
        o.t[i] = cam.R[3 * i] * t[0] + cam.R[3 * i + 1] * t[1] + cam.R[3 * i + 2] * t[2] + cam.t[i];
    board_picture(&b, &o, theirs);
    double sum = 0, squares = 0, n = 0;
    for (int v = 0; v < H; v++)
        for (int u = 0; u < W; u++) {
            if (!on_print(&p, &cam, R, t, u, v))
                continue;
            double e = (double)ours[v * W + u] - (double)theirs[v * W + u];
            sum += e;
            squares += e * e;
            n++;
        }
    *rms = sqrt(squares / n);
    *mean = sum / n;
    T_OK(n > 2000);
    rec_print_fini(&p);
}

T_CASE(as_the_other_renderer_draws_it)
{
    static const struct {
        const char *spec;
        bool from_behind;
        double roll;
    } cases[] = {{"charuco:5x6:0.05:0.037", false, 0.3},
                 {"charuco:6x6:0.05:0.037:two-sided:thickness=0.01", true, -0.4},
                 {"chessboard:5x6:0.05", false, 0.1},
                 {"aprilgrid:4x4:0.06:0.02", false, 0.2},
                 {"aprilgrid:4x4:0.06:0.02:kalibr", false, 0.2},
                 {"charuco:5x6:0.05:0.037:inverted", false, 0}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        double rms = NAN, mean = NAN;
        compare(cases[i].spec, cases[i].from_behind, cases[i].roll, &rms, &mean);
        printf("  %s: rms %.4f, mean %.5f\n", cases[i].spec, rms, mean);
        T_LE(rms, 0.008); /* the noise of a camera is 0.01 */
        T_LE(fabs(mean), 0.002);
    }
}

T_CASE(the_bare_back_is_paper_and_far_away_is_ground)
{
    static float level[W * H];
    struct rec_board b;
    struct rec_print p;
    struct rec_camera cam = lens;
    const double eye[3] = {1, 0, 0.4}, middle[3] = {0, 0, 0.1}, away[3] = {-1, 0, 0};
    T_EQ_I(rec_board_parse("charuco:5x6:0.05:0.037", &b, NULL), PVX_OK);
    T_EQ_I(rec_print_init(&p, &b, NULL), PVX_OK);
    rec_camera_look(eye, middle, &cam);
    struct rec_board_shot s = {
        .print = &p, .camera = &cam, .ink = 0, .paper = 0.8, .ground = 0.4, .across = 2};
    rec_board_hold(&b, middle, away, 0, s.R, s.t);
    T_EQ_I(rec_board_shoot(&s, level), PVX_OK);
    for (int i = 0; i < W * H; i++)
        T_LE(0.399f, level[i]); /* no ink */
    T_NEAR(level[(int)cam.cy * W + (int)cam.cx], 0.8, 1e-6);
    T_NEAR(level[0], 0.4, 1e-6);
    s.t[0] += 5; /* behind the camera */
    T_EQ_I(rec_board_shoot(&s, level), PVX_OK);
    for (int i = 0; i < W * H; i++)
        T_NEAR(level[i], 0.4, 1e-6);
    rec_print_fini(&p);
}

/* Pose 0 of --board and --floor of calibrate mean the same: print up, rows along x, the middle at x = y = 0. */
T_CASE(flat_on_the_floor)
{
    struct rec_board b;
    const double floor[3] = {0, 0, -0.2}, up[3] = {0, 0, 2};
    double R[9], t[3], first[3], last[3];
    T_EQ_I(rec_board_parse("charuco:5x6:0.05:0.037", &b, NULL), PVX_OK);
    rec_board_hold(&b, floor, up, 0, R, t);
    const double want[9] = {1, 0, 0, 0, -1, 0, 0, 0, -1};
    for (int i = 0; i < 9; i++)
        T_NEAR(R[i], want[i], 1e-12);
    rec_board_point(&b, REC_FRONT, 0, first);
    rec_board_point(&b, REC_FRONT, rec_board_corners(&b) - 1, last);
    for (int i = 0; i < 3; i++)
        T_NEAR(R[3 * i] * (first[0] + last[0]) / 2 + R[3 * i + 1] * (first[1] + last[1]) / 2 + t[i],
               floor[i], 1e-12);
}

T_MAIN(plugins_of_this_build(), (void)0)
