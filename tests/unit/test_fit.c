/* test_fit.c - the fitted box holds the flame, is no larger than it has to be, and pays. */
#include "../t.h"

#include "base/mem.h"
#include "recon/carve/fit.h"
#include "tests/lib/flame_point.h"
#include "tests/lib/slot.h"

struct ball {
    double m[3], r;
};

static bool hits(const struct ball *b, int n, const double o[3], const double d[3])
{
    for (int i = 0; i < n; i++) {
        double w[3], wd = 0, ww = 0;
        for (int a = 0; a < 3; a++) {
            w[a] = b[i].m[a] - o[a];
            wd += w[a] * d[a];
            ww += w[a] * w[a];
        }
        if (wd > 0 && ww - wd * wd <= b[i].r * b[i].r)
            return true;
    }
    return false;
}

/* Any point of the ball's surface. */
static void on_surface(const struct ball *b, double X[3])
{
    double len = 0;
    for (int a = 0; a < 3; a++) {
        X[a] = t_normal();
        len += X[a] * X[a];
    }
    for (int a = 0; a < 3; a++)
        X[a] = b->m[a] + b->r * X[a] / sqrt(len);
}

/* Exact silhouette of balls: bins with a ray of 3 x 3 per pixel that meets one, and bins that a point
 * of a ball's surface projects to. */
static void silhouette(const struct rec_camera *c, const struct ball *b, int n, int32_t binning,
                       uint8_t *lit)
{
    int32_t w = c->width / binning, h = c->height / binning;
    memset(lit, 0, (size_t)w * (size_t)h);
    for (int32_t v = 0; v < c->height * 3; v++)
        for (int32_t u = 0; u < c->width * 3; u++) {
            double o[3], d[3];
            if (rec_camera_ray(c, (u - 1) / 3.0, (v - 1) / 3.0, o, d) && hits(b, n, o, d))
                lit[v / 3 / binning * w + u / 3 / binning] = 1;
        }
    for (int i = 0; i < n; i++)
        for (int k = 0; k < 4000; k++) {
            double X[3], uv[2];
            on_surface(&b[i], X);
            if (!rec_camera_project(c, X, uv))
                continue;
            double x = floor((uv[0] + 0.5) / binning), y = floor((uv[1] + 0.5) / binning);
            if (x >= 0 && y >= 0 && x < w && y < h)
                lit[(int)y * w + (int)x] = 1;
        }
}

static double inside_box(const struct ball *b, int n, const struct rec_fit_box *box)
{
    double out = 0; /* how far a ball sticks out */
    for (int i = 0; i < n; i++)
        for (int a = 0; a < 3; a++)
            out = fmax(out,
                       fmax(box->min[a] - (b[i].m[a] - b[i].r), b[i].m[a] + b[i].r - box->max[a]));
    return out;
}

/* Shift the image so that ball b lies just left of it: the camera sees that there is no flame beside
 * the ball, and nothing of the ball. */
static void look_past(struct rec_camera *c, const struct ball *b)
{
    double right = -1e9;
    for (int k = 0; k < 4000; k++) {
        double X[3], uv[2];
        on_surface(b, X);
        if (rec_camera_project(c, X, uv))
            right = fmax(right, uv[0]);
    }
    c->cx += -0.6 - right;
}

/* Balls anywhere in the volume, cameras anywhere around it, some of which see only a part. */
T_CASE(flame_is_inside)
{
    enum { W = 64, H = 48, TURNS = 12 };
    static uint8_t bits[8][W * H];
    const uint8_t *lit[8];
    double tightest = 1;
    for (int turn = 0; turn < TURNS; turn++) {
        struct rec_rig rig;
        size_t n = 3 + (size_t)turn % 6;
        int32_t binning = turn % 3 == 0 ? 2 : 1;
        T_EQ_I(rec_rig_ring(n, 2.2, W, H, 24, &rig), PVX_OK);
        for (int a = 0; a < 3; a++)
            rig.grid.n[a] = 20 + (int32_t)(t_rand() % 9);
        for (size_t c = 0; c < n; c++) {
            double turn_by = t_uniform(0, 6.2831853), far = t_uniform(1.4, 4);
            double at[3] = {far * cos(turn_by), far * sin(turn_by), t_uniform(-0.5, 2)};
            double to[3] = {t_uniform(-0.2, 0.2), t_uniform(-0.2, 0.2), t_uniform(0.3, 0.7)};
            rec_camera_look(at, to, &rig.cameras[c]);
            rig.cameras[c].fx = rig.cameras[c].fy = t_uniform(40, 140);
        }
        struct ball b[4];
        int balls = 1 + turn % 4;
        for (int i = 0; i < balls; i++) {
            b[i].r = t_uniform(0.02, 0.12);
            for (int a = 0; a < 3; a++)
                b[i].m[a] = t_uniform(rig.grid.min[a] + b[i].r, rig.grid.max[a] - b[i].r);
        }
        if (turn % 4 == 1)
            for (size_t c = 1; c < n; c++)
                look_past(&rig.cameras[c], &b[0]);
        /* only flame that min_views cameras see can come back */
        struct rec_fit_params p = {.cells = 24, .binning = binning, .min_views = 0};
        rec_fit *f;
        struct rec_fit_box box;
        bool present[8];
        T_EQ_I(rec_fit_new(&rig, &p, NULL, &f, NULL), PVX_OK);
        for (size_t c = 0; c < n; c++) {
            silhouette(&rig.cameras[c], b, balls, binning, bits[c]);
            lit[c] = bits[c];
            present[c] = c != 1 || turn % 5 != 0;
        }
        T_OK(rec_fit_add(f, lit, present) > 0);
        T_EQ_I(rec_fit_get(f, 0, 0, &box), PVX_OK);
        double volume = 1, all = 1;
        for (int a = 0; a < 3; a++) {
            T_OK(box.min[a] >= rig.grid.min[a] && box.max[a] <= rig.grid.max[a]);
            volume *= box.max[a] - box.min[a];
            all *= rig.grid.max[a] - rig.grid.min[a];
        }
        tightest = fmin(tightest, volume / all);
        T_LE(inside_box(b, balls, &box), 1e-9);
        struct rec_fit_box wider;
        T_EQ_I(rec_fit_get(f, 0, -1, &wider), PVX_OK);
        T_LE(wider.min[0], box.min[0]);
        rec_fit_free(&f);
        rec_rig_fini(&rig);
    }
    T_LE(tightest, 0.1); /* and it is a fit */
}

/* A cube seen from far away along the axes: its hull is itself. */
T_CASE(cube_is_found_exactly)
{
    enum { W = 160 };
    struct rec_rig rig;
    static uint8_t bits[3][W * W];
    const uint8_t *lit[3] = {bits[0], bits[1], bits[2]};
    const double lo[3] = {-0.25, 0.0, 0.5}, hi[3] = {0.125, 0.25, 0.75};
    static const double at[3][3] = {{200, 0, 0.5}, {0, 200, 0.5}, {0, 1e-6, 200.5}};
    bool present[3] = {true, true, true};
    T_EQ_I(rec_rig_ring(3, 2.2, W, W, 16, &rig), PVX_OK);
    for (int c = 0; c < 3; c++) {
        struct rec_camera *cam = &rig.cameras[c];
        memset(cam->dist, 0, sizeof cam->dist);
        cam->fx = cam->fy = 0.95 * W * 200;
        rec_camera_look(at[c], (double[3]){0, 0, 0.5}, cam);
        for (int32_t i = 0; i < W * W; i++) {
            double o[3], d[3], s0 = -1e9, s1 = 1e9;
            T_OK(rec_camera_ray(cam, i % W, i / W, o, d));
            for (int a = 0; a < 3; a++) {
                double p = (lo[a] - o[a]) / d[a], q = (hi[a] - o[a]) / d[a];
                s0 = fmax(s0, fmin(p, q));
                s1 = fmin(s1, fmax(p, q));
            }
            bits[c][i] = s0 < s1;
        }
    }
    struct rec_fit_params p = {.cells = 32, .binning = 1, .min_views = 2};
    struct rec_fit_box box;
    rec_fit *f;
    T_EQ_I(rec_fit_new(&rig, &p, NULL, &f, NULL), PVX_OK);
    T_OK(rec_fit_add(f, lit, present) > 0);
    T_EQ_I(rec_fit_get(f, 0, 0, &box), PVX_OK);
    for (int a = 0; a < 3; a++) { /* within the cell that shares a bin with it */
        T_NEAR(box.min[a], lo[a] - 0.5 / 32, 0.5 / 32 + 1e-3);
        T_NEAR(box.max[a], hi[a] + 0.5 / 32, 0.5 / 32 + 1e-3);
    }
    T_EQ_I(box.touches, 0);
    T_NEAR(box.cell, 1.0 / 32, 1e-12);
    rec_fit_free(&f);
    rec_rig_fini(&rig);
}

T_CASE_OF_THREADS(union_and_nothing)
{
    enum { W = 64, H = 48 };
    static uint8_t bits[4][W * H];
    const uint8_t *lit[4] = {bits[0], bits[1], bits[2], bits[3]};
    bool present[4] = {true, true, true, true};
    struct rec_rig rig;
    T_EQ_I(rec_rig_ring(4, 2.2, W, H, 24, &rig), PVX_OK);
    struct rec_fit_params p = REC_FIT_DEFAULTS;
    struct rec_fit_box one, two;
    rec_fit *f;
    pvx_pool *pool;
    T_EQ_I(pvx_pool_new(2, "t", &pool), PVX_OK);
    T_EQ_I(rec_fit_new(&rig, &p, pool, &f, NULL), PVX_OK);
    T_EQ_I(rec_fit_get(f, 0, -1, &one), PVX_ENOENT);
    T_EQ_I(rec_fit_add(f, lit, present), 0); /* dark */
    T_EQ_I(rec_fit_get(f, 0, -1, &one), PVX_ENOENT);
    struct ball b[2] = {{{0.2, -0.1, 0.3}, 0.05}, {{-0.3, 0.2, 0.8}, 0.05}};
    for (size_t c = 0; c < 4; c++)
        silhouette(&rig.cameras[c], b, 1, 1, bits[c]);
    T_OK(rec_fit_add(f, lit, present) > 0);
    T_EQ_I(rec_fit_get(f, 0, 0, &one), PVX_OK);
    T_LE(inside_box(b, 1, &one), 0);
    T_OK(inside_box(b, 2, &one) > 0.1);
    for (size_t c = 0; c < 4; c++)
        silhouette(&rig.cameras[c], b + 1, 1, 1, bits[c]);
    T_OK(rec_fit_add(f, lit, present) > 0);
    T_EQ_I(rec_fit_get(f, 0, 0, &two), PVX_OK);
    T_LE(inside_box(b, 2, &two), 0);
    T_EQ_I(two.sets, 3);
    T_EQ_I(two.lit, 2);
    T_EQ_I(two.touches, 0);
    for (size_t c = 0; c < 4; c++)
        memset(bits[c], 1, sizeof bits[c]);
    T_OK(rec_fit_add(f, lit, present) > 0);
    T_EQ_I(rec_fit_get(f, 0, 0.1, &two), PVX_OK);
    T_EQ_I(two.touches, 63);
    T_NEAR(two.min[2], 0, 0); /* not beyond the rig's box */
    rec_fit_free(&f);
    pvx_pool_free(&pool);
    p.cells = 3;
    T_EQ_I(rec_fit_new(&rig, &p, NULL, &f, NULL), PVX_EINVAL);
    rec_rig_fini(&rig);
}

T_CASE(grids)
{
    struct rec_grid g = {{-0.5, -0.5, 0}, {0.5, 0.5, 2}, {50, 50, 100}, REC_TRILINEAR}, o;
    struct rec_fit_box b = {.min = {-0.11, -0.2, 0.1}, .max = {0.11, 0.2, 1.29}};
    T_EQ_I(rec_fit_grid(&g, &b, (int32_t[3]){0, 0, 0}, &o), PVX_OK); /* on the rig's lattice */
    T_EQ_I(o.n[0] * 10000 + o.n[1] * 100 + o.n[2], 12 * 10000 + 20 * 100 + 60);
    T_NEAR(o.min[0], -0.12, 1e-12);
    T_NEAR(o.max[0], 0.12, 1e-12);
    T_NEAR(o.min[1], -0.2, 1e-12);
    T_NEAR(o.max[2], 1.3, 1e-12);
    T_EQ_I(o.basis, REC_TRILINEAR);
    T_EQ_I(rec_fit_grid(&g, &b, (int32_t[3]){34, 0, 0}, &o), PVX_OK); /* cubes of 3.5 cm */
    T_EQ_I(o.n[0] * 10000 + o.n[1] * 100 + o.n[2], 7 * 10000 + 12 * 100 + 34);
    for (int a = 0; a < 3; a++) {
        T_NEAR(rec_grid_h(&o, a), 0.035, 1e-12);
        T_LE(o.min[a], b.min[a] + 1e-12);
        T_LE(b.max[a], o.max[a] + 1e-12);
    }
    T_EQ_I(rec_fit_grid(&g, &b, (int32_t[3]){3, 4, 5}, &o), PVX_OK);
    T_EQ_I(o.n[0] * 100 + o.n[1] * 10 + o.n[2], 345);
    T_NEAR(o.max[2], 1.29, 0);
    g.n[2] = 1024;
    g.max[2] = 0.2;
    T_EQ_I(rec_fit_grid(&g, &b, (int32_t[3]){0, 0, 0}, &o), PVX_ERANGE);
}

/* ---- what it buys ------------------------------------------------------------------------------- */

enum { CAMERAS = 8, W = 96, H = 72 };

/* Relative error at random points of the flame's neighbourhood, where the volume is read as the box
 * basis does; the images come from the flame itself. */
static double error_on(const struct rec_rig *rig, const struct rec_flame_pose *pose)
{
    struct rec_sysmat_params p = {.binning = 1, .rays_per_bin = 2};
    struct rec_frame_params fp = rec_frame_defaults;
    struct rec_sparse v;
    rec_sysmat *S;
    rec_frame *f;
    pvx_pool *pool;
    fp.photo.saturation = 1e30F;
    T_EQ_I(pvx_pool_new(2, "t", &pool), PVX_OK);
    T_EQ_I(rec_sysmat_build(rig, &p, pool, NULL, NULL, &S, NULL), PVX_OK);
    T_EQ_I(rec_frame_alone(S, rig, &fp, pool, &f, NULL), PVX_OK);
    float *raw = pvx_calloc(W * H * 3, sizeof *raw);
    for (size_t c = 0; c < CAMERAS; c++) {
        float *in = rec_frame_input(f, c);
        rec_flame_render(pose, &rig->cameras[c], 3, 0, H, raw);
        for (size_t i = 0; i < W * H; i++)
            for (size_t l = 0; l < 3; l++)
                in[i * 4 + l] = raw[i * 3 + l];
        rec_frame_camera(f, c)->present = true;
    }
    rec_frame_carve(f);
    T_EQ_I(rec_frame_solve(f, 0, NULL), PVX_OK);
    rec_frame_volume(f, &v);
    float *dense = pvx_calloc(rec_grid_count(&rig->grid) * 3, sizeof *dense);
    rec_sparse_to_dense(&v, dense);
    double e = 0, t = 0;
    t_state = 77;
    for (int k = 0; k < 20000; k++) {
        double x[3], want[3];
        int32_t at[3];
        bool in = true;
        for (int a = 0; a < 3; a++) {
            x[a] = t_uniform(a < 2 ? -0.5 : 0, a < 2 ? 0.5 : 1);
            double u = floor((x[a] - rig->grid.min[a]) / rec_grid_h(&rig->grid, a));
            in = in && u >= 0 && u < rig->grid.n[a];
            at[a] = in ? (int32_t)u : 0;
        }
        flame_point(pose, x, want);
        double got = in ? dense[(size_t)rec_grid_index(&rig->grid, at[0], at[1], at[2]) * 3] : 0;
        e += (got - want[0]) * (got - want[0]);
        t += want[0] * want[0];
    }
    free(raw);
    free(dense);
    rec_frame_free(&f);
    rec_sysmat_free(&S);
    pvx_pool_free(&pool);
    return sqrt(e / t);
}

/* A rig whose box is twice as wide as the flame needs: the same number of voxels, spent on the fitted
 * box, gives a better flame. */
T_CASE(same_voxels_less_error)
{
    T_NOT_UNDER_SANITIZERS();
    struct rec_rig rig;
    struct rec_flame flame;
    struct rec_flame_pose pose;
    static uint8_t bits[CAMERAS][W * H];
    const uint8_t *lit[CAMERAS];
    bool present[CAMERAS];
    T_EQ_I(rec_rig_ring(CAMERAS, 2.2, W, H, 28, &rig), PVX_OK);
    rec_flame_init(&flame, &rig.grid, 3);
    rec_flame_at(&flame, 0.7, &pose);
    for (int a = 0; a < 3; a++) {
        double half = rig.grid.max[a] - rig.grid.min[a];
        rig.grid.min[a] -= half / 2;
        rig.grid.max[a] += half / 2;
    }
    struct rec_fit_params p = REC_FIT_DEFAULTS;
    struct rec_fit_box box;
    rec_fit *f;
    T_EQ_I(rec_fit_new(&rig, &p, NULL, &f, NULL), PVX_OK);
    float *raw = pvx_calloc(W * H * 3, sizeof *raw);
    for (size_t c = 0; c < CAMERAS; c++) {
        rec_flame_render(&pose, &rig.cameras[c], 3, 0, H, raw);
        for (size_t i = 0; i < W * H; i++)
            bits[c][i] = raw[i * 3] > 0.004f;
        lit[c] = bits[c];
        present[c] = true;
    }
    free(raw);
    T_OK(rec_fit_add(f, lit, present) > 0);
    T_EQ_I(rec_fit_get(f, 0, -1, &box), PVX_OK);
    rec_fit_free(&f);
    double before = error_on(&rig, &pose);
    size_t voxels = rec_grid_count(&rig.grid);
    struct rec_grid fitted;
    int32_t n = 1;
    do
        T_EQ_I(rec_fit_grid(&rig.grid, &box, (int32_t[3]){++n, 0, 0}, &fitted), PVX_OK);
    while (rec_grid_count(&fitted) <= voxels);
    T_EQ_I(rec_fit_grid(&rig.grid, &box, (int32_t[3]){n - 1, 0, 0}, &rig.grid), PVX_OK);
    T_LE(rec_grid_count(&rig.grid), voxels);
    double after = error_on(&rig, &pose);
    printf("  %zu voxels on the rig's box: error %.3f; %zu on the fitted one: %.3f\n", voxels,
           before, rec_grid_count(&rig.grid), after);
    T_LE(after, 0.75 * before);
    rec_rig_fini(&rig);
}

/* A corner that two of four cameras see: their silhouettes may cross there, and only demanding more
 * views closes the box. */
T_CASE(few_views_keep_the_box_open)
{
    enum { SIDE = 64 };
    static uint8_t bits[4][SIDE * SIDE];
    const uint8_t *lit[4] = {bits[0], bits[1], bits[2], bits[3]};
    bool present[4] = {true, true, true, true};
    struct ball b = {{0, 0, 0.5}, 0.12};
    struct rec_rig rig;
    T_EQ_I(rec_rig_ring(4, 2.2, SIDE, SIDE, 24, &rig), PVX_OK);
    for (int c = 0; c < 4; c++) {
        double round = 0.7 * c;
        rec_camera_look((double[3]){2.5 * cos(round), 2.5 * sin(round), 0.6},
                        (double[3]){0, 0, 0.5}, &rig.cameras[c]);
        rig.cameras[c].fx = rig.cameras[c].fy = c < 2 ? 60 : 400; /* two see the ball alone */
        silhouette(&rig.cameras[c], &b, 1, 1, bits[c]);
    }
    memset(bits[0], 1, sizeof bits[0] / 2); /* light in the upper half of two pictures */
    memset(bits[1], 1, sizeof bits[1] / 2);
    struct rec_fit_params p = REC_FIT_DEFAULTS;
    struct rec_fit_box two, four;
    rec_fit *f;
    T_EQ_I(rec_fit_new(&rig, &p, NULL, &f, NULL), PVX_OK);
    T_OK(rec_fit_add(f, lit, present) > 0);
    T_EQ_I(rec_fit_get(f, 2, 0, &two), PVX_OK);
    T_EQ_I(rec_fit_get(f, 4, 0, &four), PVX_OK);
    T_LE(inside_box(&b, 1, &two), 0);
    T_LE(inside_box(&b, 1, &four), 0);
    T_OK(two.max[2] > 0.95);
    T_LE(four.max[2], 0.8);
    T_EQ_I(rec_fit_get(f, 1, 0, &two), PVX_EINVAL);
    T_EQ_I(rec_fit_get(f, 5, 0, &two), PVX_EINVAL);
    rec_fit_free(&f);
    rec_rig_fini(&rig);
}
