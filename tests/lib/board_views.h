/* board_views.h - a known rig looks at a known board: what its cameras would find, with noise.
 * Shares no code with recon: the lens and the poses are written down here a second time. */
#ifndef TESTS_BOARD_VIEWS_H
#define TESTS_BOARD_VIEWS_H
#include <stdbool.h>

#include "recon/calib/priv.h"
#include "tests/lib/optics.h"
#include "tests/t.h"

#define BV_CAMERAS 8
#define BV_FRAMES  200
#define BV_CORNERS 70

struct bv_camera {
    double f[2], c[2], k[5]; /* px; k1 k2 p1 p2 k3 */
    double at[3], right[3], down[3], forward[3];
    int delay;           /* it takes the board of so many frames ago */
    double glass;        /* px: a lens that is not of the model */
    uint32_t moved_from; /* frame from which it stands `moved` m further right */
    double moved;
    struct optics_plate plate; /* that it looks through, if `plates` is 1 */
    int plates;
};

struct bv_pose {
    double o[3], x[3], y[3], z[3]; /* of the board's axes, in the world */
};

struct bv {
    struct rec_board board;
    size_t cameras, frames, n;
    int w, h;
    struct bv_camera cam[BV_CAMERAS];
    struct bv_pose pose[BV_FRAMES];
    double noise, wrong, wrong_px, warp[3], thickness; /* px; share of corners; px; m; m */
    struct rec_board_view view[BV_CAMERAS * BV_FRAMES];
    struct rec_board_corner corner[BV_CAMERAS * BV_FRAMES][BV_CORNERS];
    struct rec_calib_camera named[BV_CAMERAS];
    struct rec_calib_input in;
};

static inline double bv_dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}
static inline void bv_cross(const double a[3], const double b[3], double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}
static inline void bv_unit(double a[3])
{
    double n = sqrt(bv_dot(a, a));
    for (int i = 0; i < 3; i++)
        a[i] /= n;
}

/* n cameras on a full ring of 2.4 m that look at (0, 0, 0.5), no two alike; a board of 7 x 10 corners of
 * 30 mm, 100 frames. */
static inline void bv_init(struct bv *s, size_t n, bool two_sided)
{
    *s = (struct bv){.cameras = n,
                     .frames = 100,
                     .w = 640,
                     .h = 480,
                     .noise = 0.1,
                     .wrong_px = 8,
                     .thickness = 0.005};
    s->board = (struct rec_board){.kind = REC_CHARUCO,
                                  .cols = 8,
                                  .rows = 11,
                                  .square = 0.03,
                                  .marker = 0.022,
                                  .dictionary = "5X5_100",
                                  .two_sided = two_sided,
                                  .thickness = two_sided ? NAN : 0};
    for (size_t i = 0; i < n; i++) {
        struct bv_camera *c = &s->cam[i];
        double a = 6.283185307179586 * ((double)i + 0.1 * sin(3.0 * (double)i)) / (double)n;
        const double up[3] = {0.02 * sin(5.0 * (double)i), 0, 1};
        *c = (struct bv_camera){
            .f = {640 + 7 * sin(1.7 * (double)i), 641 + 7 * sin(1.7 * (double)i)},
            .c = {319.5 + 4 * sin(2.3 * (double)i), 239.5 + 4 * cos(1.1 * (double)i)},
            .k = {-0.08 + 0.02 * sin((double)i), 0.02, 5e-4, -4e-4, 0},
            .at = {2.4 * cos(a), 2.4 * sin(a), i % 2 == 0 ? 0.75 : 0.35},
            .moved_from = REC_NO_FRAME};
        for (int j = 0; j < 3; j++)
            c->forward[j] = (j == 2 ? 0.5 : 0) - c->at[j];
        bv_unit(c->forward);
        bv_cross(c->forward, up, c->right);
        bv_unit(c->right);
        bv_cross(c->forward, c->right, c->down);
        snprintf(s->named[i].name, sizeof s->named[i].name, "cam%zu", i);
        s->named[i].width = s->w;
        s->named[i].height = s->h;
    }
    s->in = (struct rec_calib_input){
        .n_cameras = n,
        .camera = s->named,
        .view = s->view,
        .grid = {{-0.5, -0.5, 0}, {0.5, 0.5, 1}, {64, 64, 64}, REC_TRILINEAR},
        .options = {.world = REC_WORLD_UP,
                    .up = {s->cam[0].right[2], s->cam[0].down[2], s->cam[0].forward[2]}}};
}

/* The board with its middle at `at`, its front towards `look`, turned by `roll` in its own plane. */
static inline struct bv_pose bv_pose_at(const struct bv *s, const double at[3],
                                        const double look[3], double roll)
{
    struct bv_pose p;
    double z[3] = {-look[0], -look[1], -look[2]}, a[3], b[3];
    const double up[3] = {0.1, 0.2, 1};
    bv_unit(z);
    bv_cross(up, z, a);
    bv_unit(a);
    bv_cross(z, a, b);
    double middle[2] = {0.5 * s->board.square * (s->board.cols - 2),
                        0.5 * s->board.square * (s->board.rows - 2)};
    for (int i = 0; i < 3; i++) {
        p.x[i] = cos(roll) * a[i] + sin(roll) * b[i];
        p.y[i] = cos(roll) * b[i] - sin(roll) * a[i];
        p.z[i] = z[i];
        p.o[i] = at[i] - middle[0] * p.x[i] - middle[1] * p.y[i];
    }
    return p;
}

/* Somewhere in the volume, facing outwards anyhow. */
static inline struct bv_pose bv_anywhere(const struct bv *s)
{
    const double at[3] = {t_uniform(-0.35, 0.35), t_uniform(-0.35, 0.35), t_uniform(0.2, 0.8)};
    double a = t_uniform(0, 6.2831853), e = t_uniform(-0.7, 0.7);
    const double look[3] = {cos(a) * cos(e), sin(a) * cos(e), sin(e)};
    return bv_pose_at(s, at, look, t_uniform(-3, 3));
}

/* Where the camera sees X through its plate: rays are shot at it, each aimed by how far the last one missed. */
static inline void bv_aim(const struct bv_camera *c, const double at[3], const double X[3],
                          double aim[3])
{
    memcpy(aim, X, 3 * sizeof *aim);
    for (int it = 0; it < 40 && c->plates > 0; it++) {
        double o[3], d[3], along;
        for (int i = 0; i < 3; i++) {
            o[i] = at[i];
            d[i] = aim[i] - at[i];
        }
        bv_unit(d);
        if (!optics_plates(&c->plate, c->plates, o, d))
            return;
        along = bv_dot(d, X) - bv_dot(d, o);
        for (int i = 0; i < 3; i++)
            aim[i] += X[i] - (o[i] + along * d[i]);
    }
}

static inline bool bv_project(const struct bv *s, const struct bv_camera *c, uint32_t frame,
                              const double X[3], double uv[2])
{
    double d[3], at[3], aim[3];
    for (int i = 0; i < 3; i++)
        at[i] = c->at[i] + (frame >= c->moved_from ? c->moved * c->right[i] : 0);
    bv_aim(c, at, X, aim);
    for (int i = 0; i < 3; i++)
        d[i] = c->plates > 0
                   ? aim[i] - at[i]
                   : X[i] - c->at[i] - (frame >= c->moved_from ? c->moved * c->right[i] : 0);
    double depth = bv_dot(d, c->forward);
    if (depth < 0.05)
        return false;
    double x = bv_dot(d, c->right) / depth, y = bv_dot(d, c->down) / depth, q = x * x + y * y;
    double radial = 1 + c->k[0] * q + c->k[1] * q * q + c->k[4] * q * q * q;
    uv[0] = c->c[0] + c->f[0] * (x * radial + 2 * c->k[2] * x * y + c->k[3] * (3 * x * x + y * y));
    uv[1] = c->c[1] + c->f[1] * (y * radial + c->k[2] * (x * x + 3 * y * y) + 2 * c->k[3] * x * y);
    if (c->glass != 0) /* waves over the picture */
        uv[0] += c->glass * sin(uv[1] / 20), uv[1] += c->glass * sin(uv[0] / 20);
    return uv[0] > 2 && uv[1] > 2 && uv[0] < s->w - 3 && uv[1] < s->h - 3;
}

/* What camera i finds in frame f of the board at p. */
static inline void bv_look(struct bv *s, uint32_t i, uint32_t f, const struct bv_pose *p)
{
    const struct bv_camera *c = &s->cam[i];
    double middle[3], to[3];
    for (int j = 0; j < 3; j++) {
        middle[j] = p->o[j] + 0.09 * p->x[j] + 0.135 * p->y[j];
        to[j] = middle[j] - c->at[j];
    }
    double facing = bv_dot(to, p->z) / sqrt(bv_dot(to, to)); /* 1: straight at the front */
    if (fabs(facing) < 0.3 || (facing < 0 && !s->board.two_sided))
        return;
    struct rec_board_view *v = &s->view[s->n];
    *v = (struct rec_board_view){i, f, facing > 0 ? REC_FRONT : REC_BACK, 0, s->corner[s->n]};
    for (uint32_t id = 0; id < BV_CORNERS; id++) {
        double x = 0.03 * (id % 7), y = 0.03 * (double)(id / 7), X[3], uv[2];
        double a = (x - 0.09) / 0.09, b = (y - 0.135) / 0.135;
        double z = s->warp[0] * (a * a - 1.0 / 3) + s->warp[1] * a * b +
                   s->warp[2] * (b * b - 1.0 / 3) + (facing < 0 ? s->thickness : 0);
        for (int j = 0; j < 3; j++)
            X[j] = p->o[j] + x * p->x[j] + y * p->y[j] + z * p->z[j];
        if (!bv_project(s, c, f, X, uv))
            continue;
        double off = t_uniform(0, 1) < s->wrong ? s->wrong_px : 0;
        v->corner[v->n++] =
            (struct rec_board_corner){id,
                                      uv[0] + s->noise * t_normal() + off * t_uniform(-1, 1),
                                      uv[1] + s->noise * t_normal() + off * t_uniform(-1, 1),
                                      {s->noise * s->noise, 0, s->noise * s->noise}};
    }
    s->n += v->n >= 12; /* fewer are no detection */
}

/* Views of all frames from the poses, frame numbers 100, 101, ... */
static inline void bv_take(struct bv *s)
{
    s->n = 0;
    for (uint32_t f = 0; f < s->frames; f++)
        for (uint32_t i = 0; i < s->cameras; i++) {
            int from = (int)f - s->cam[i].delay;
            if (from >= 0 && from < (int)s->frames)
                bv_look(s, i, 100 + f, &s->pose[from]);
        }
    s->in.board = s->board;
    s->in.n_views = s->n;
}

static inline void bv_everywhere(struct bv *s)
{
    for (size_t f = 0; f < s->frames; f++)
        s->pose[f] = bv_anywhere(s);
}

/* The truth as recon writes it. */
static inline void bv_truth(const struct bv *s, struct rec_camera cameras[BV_CAMERAS],
                            struct rec_rig *rig)
{
    *rig = (struct rec_rig){.grid = s->in.grid, .n_cameras = s->cameras, .cameras = cameras};
    for (size_t i = 0; i < s->cameras; i++) {
        const struct bv_camera *c = &s->cam[i];
        struct rec_camera *r = &cameras[i];
        *r = (struct rec_camera){.width = s->w,
                                 .height = s->h,
                                 .fx = c->f[0],
                                 .fy = c->f[1],
                                 .cx = c->c[0],
                                 .cy = c->c[1],
                                 .gain = {1, 1, 1}};
        snprintf(r->name, sizeof r->name, "cam%zu", i);
        memcpy(r->dist, c->k, sizeof c->k);
        for (int j = 0; j < 3; j++) {
            r->R[j] = c->right[j];
            r->R[3 + j] = c->down[j];
            r->R[6 + j] = c->forward[j];
        }
        r->t[0] = -bv_dot(c->right, c->at);
        r->t[1] = -bv_dot(c->down, c->at);
        r->t[2] = -bv_dot(c->forward, c->at);
        r->n_windows = c->plates;
        memcpy(r->window[0].normal, c->plate.n, sizeof c->plate.n);
        r->window[0].at = c->plate.at;
        r->window[0].thickness = c->plate.thickness;
        r->window[0].index = c->plate.index;
    }
}

/* A solve and its distance from the truth. */
struct bv_result {
    struct rec_rig rig;
    struct rec_calib_report report;
    struct pvx_diag d;
    pvx_err e;
    double rms, worst, px[BV_CAMERAS]; /* px, volume error; of each camera */
    double to_rig[6]; /* pose.h: from the truth's axes to the rig's, by what is seen */
};

static inline void bv_solve(const struct bv *s, struct bv_result *r)
{
    struct rec_camera cameras[BV_CAMERAS];
    struct rec_rig truth;
    *r = (struct bv_result){.rms = NAN, .worst = NAN};
    r->e = rec_calib_solve(&s->in, &r->rig, &r->report, &r->d);
    bv_truth(s, cameras, &truth);
    struct rec_calib_overlay o;
    if (r->e != PVX_OK || rec_calib_register(&truth, &r->rig, false, r->to_rig, &o) != PVX_OK)
        return;
    r->rms = o.rms;
    r->worst = o.worst;
    memcpy(r->px, o.px, sizeof r->px);
}
/* In a test; a solve that fails is its failure. */
static inline void bv_solved(const struct bv *s, struct bv_result *r)
{
    bv_solve(s, r);
    T_CHECK_(r->e == PVX_OK, "%s", pvx_diag_text(&r->d, r->e));
}

/* The first sentence about `what`; NULL: none. */
static inline const struct rec_calib_finding *bv_said(const struct bv_result *r,
                                                      enum rec_calib_what what)
{
    for (size_t i = 0; i < r->report.n_findings; i++)
        if (r->report.finding[i].what == what)
            return &r->report.finding[i];
    return NULL;
}

static inline void bv_done(struct bv_result *r)
{
    rec_rig_fini(&r->rig);
    rec_calib_report_fini(&r->report);
}
#endif
