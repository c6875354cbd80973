#include "daemon/cli/simcams/board.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "base/random.h"
#include "recon/board/hold.h"
#include "recon/board/shot.h"
#include "recon/board/spec.h"
#include "recon/calib/pose.h"

#define DEGREE    (M_PI / 180)
#define THICKNESS 0.003 /* m, of a plate whose thickness the spec leaves open */

static double board_between(uint64_t *rng, double lo, double hi)
{
    return lo + (hi - lo) * pvx_uniform(rng);
}

static void board_keep(const double R[9], const double t[3], double pose[6])
{
    rec_rotation_log(R, pose);
    memcpy(pose + 3, t, 3 * sizeof *t);
}

/* Unit vector from `at` to the camera. */
static void towards(const struct rec_rig *rig, size_t camera, const double at[3], double out[3])
{
    double c[3], n = 0;
    rec_camera_centre(&rig->cameras[camera], c);
    for (int i = 0; i < 3; i++)
        n += (c[i] - at[i]) * (c[i] - at[i]);
    for (int i = 0; i < 3; i++)
        out[i] = (c[i] - at[i]) / sqrt(n);
}

/* A random pose in the middle three fifths of the volume.  It faces camera k / 2 or the direction between it and the
 * next one, and is tilted and rolled as by a hand. */
static void anywhere(const struct rec_board *b, const struct rec_rig *rig, size_t k, uint64_t *rng,
                     double pose[6])
{
    const struct rec_grid *g = &rig->grid;
    double at[3], face[3], next[3], R[9], t[3], tilt[3], T[9], turned[3];
    for (int i = 0; i < 3; i++)
        at[i] = board_between(rng, 0.8 * g->min[i] + 0.2 * g->max[i],
                              0.2 * g->min[i] + 0.8 * g->max[i]);
    towards(rig, k / 2 % rig->n_cameras, at, face);
    towards(rig, (k / 2 + 1) % rig->n_cameras, at, next);
    for (int i = 0; i < 3 && k % 2 == 1; i++)
        face[i] += next[i] + 1e-6 * i; /* not 0 for opposite cameras */
    for (int i = 0; i < 3; i++)
        tilt[i] = board_between(rng, -25, 25) * DEGREE;
    rec_rotation(tilt, T);
    for (int i = 0; i < 3; i++)
        turned[i] = T[3 * i] * face[0] + T[3 * i + 1] * face[1] + T[3 * i + 2] * face[2];
    rec_board_hold(b, at, turned, board_between(rng, -30, 30) * DEGREE, R, t);
    board_keep(R, t, pose);
}

/* A pose at this share of the way from pose a to pose b. */
static void on_the_way(const double a[6], const double b[6], double share, double out[6])
{
    double Ra[9], Rb[9], step[9], w[3], S[9], R[9];
    rec_rotation(a, Ra);
    rec_rotation(b, Rb);
    for (int i = 0; i < 3; i++) /* Rb = step Ra */
        for (int j = 0; j < 3; j++)
            step[3 * i + j] = Rb[3 * i] * Ra[3 * j] + Rb[3 * i + 1] * Ra[3 * j + 1] +
                              Rb[3 * i + 2] * Ra[3 * j + 2];
    rec_rotation_log(step, w);
    for (int i = 0; i < 3; i++)
        w[i] *= share;
    rec_rotation(w, S);
    rec_mat3(S, Ra, R);
    rec_rotation_log(R, out);
    for (int i = 3; i < 6; i++)
        out[i] = (1 - share) * a[i] + share * b[i];
}

pvx_err simcams_board_init(const char *spec, const struct rec_rig *rig, size_t poses, double hold_s,
                           uint32_t seed, struct simcams_board *b, struct pvx_diag *d)
{
    struct rec_board board;
    *b = (struct simcams_board){.n = poses, .hold_s = hold_s};
    PVX_TRY(rec_board_parse(spec, &board, d));
    if (board.two_sided && isnan(board.thickness))
        board.thickness = THICKNESS;
    PVX_TRY(rec_print_init(&b->print, &board, d));
    b->pose = pvx_calloc(poses * SIMCAMS_OF_POSE, sizeof *b->pose);
    if (b->pose == NULL)
        return PVX_ENOMEM;
    uint64_t rng = ((uint64_t)seed << 20) + 0x9E3779B97F4A7C15u;
    const double floor[3] = {0, 0, rig->grid.min[2]}, up[3] = {0, 0, 1};
    for (size_t k = 0; k < poses; k++) {
        double(*p)[6] = b->pose + k * SIMCAMS_OF_POSE;
        if (k == 0) {
            double R[9], t[3];
            rec_board_hold(&board, floor, up, 0, R, t);
            board_keep(R, t, p[0]);
        } else {
            anywhere(&board, rig, k - 1, &rng, p[0]);
        }
        for (int i = 1; i < SIMCAMS_STILLS; i++)
            memcpy(p[i], p[0], sizeof p[0]);
    }
    for (size_t k = 0; k < poses; k++)
        for (int i = 0; i < SIMCAMS_MOVES; i++)
            on_the_way(b->pose[k * SIMCAMS_OF_POSE], b->pose[(k + 1) % poses * SIMCAMS_OF_POSE],
                       (i + 1.0) / (SIMCAMS_MOVES + 1),
                       b->pose[k * SIMCAMS_OF_POSE + SIMCAMS_STILLS + (size_t)i]);
    return PVX_OK;
}

size_t simcams_board_floor(const struct simcams_board *b, const struct rec_rig *rig)
{
    size_t n = 0;
    double at[3] = {0, 0, b->pose[0][5]}, to[3];
    for (size_t c = 0; c < rig->n_cameras; c++) {
        towards(rig, c, at, to);
        n += to[2] > sin(20 * DEGREE);
    }
    return n;
}

pvx_err simcams_board_draw(const struct simcams_board *b, size_t image,
                           const struct rec_camera *cam, float *out)
{
    size_t pixels = (size_t)cam->width * (size_t)cam->height;
    struct rec_board_shot s = {.print = &b->print,
                               .camera = cam,
                               .ink = 0.1,
                               .paper = 0.75,
                               .ground = 0.3,
                               .blur = 0.6,
                               .across = 4};
    rec_rotation(b->pose[image], s.R);
    memcpy(s.t, b->pose[image] + 3, sizeof s.t);
    if (image % SIMCAMS_OF_POSE >= SIMCAMS_STILLS) { /* moving: need not be exact */
        s.across = 2;
        s.blur = 2;
    }
    PVX_TRY(rec_board_shoot(&s, out)); /* then spread over the channels, backwards in place */
    for (size_t i = pixels; i-- > 0;)
        out[3 * i] = out[3 * i + 1] = out[3 * i + 2] = out[i];
    return PVX_OK;
}

void simcams_board_fini(struct simcams_board *b)
{
    rec_print_fini(&b->print);
    free(b->pose);
    *b = (struct simcams_board){0};
}

void simcams_board_go(struct simcams_board *b, size_t pose)
{
    b->at = pose % b->n;
    b->moving = SIMCAMS_MOVE_TICKS;
}

size_t simcams_board_tick(struct simcams_board *b, double now_s, bool all)
{
    b->tick++;
    if (all && !b->begun)
        b->since_s = now_s;
    b->begun |= all;
    if (b->moving > 0) {
        int left = b->moving--; /* SIMCAMS_MOVE_TICKS .. 1 */
        size_t from = (b->at + b->n - 1) % b->n;
        b->since_s = now_s;
        return from * SIMCAMS_OF_POSE + SIMCAMS_STILLS +
               (size_t)((SIMCAMS_MOVE_TICKS - left) * SIMCAMS_MOVES / SIMCAMS_MOVE_TICKS);
    }
    if (b->begun && b->hold_s > 0 && b->n > 1 && now_s - b->since_s >= b->hold_s)
        simcams_board_go(b, b->at + 1);
    return b->at * SIMCAMS_OF_POSE + (size_t)(b->tick % SIMCAMS_STILLS);
}
