/* test_frame_bodies.c - a fire with a rod through it, from pictures to the volume: hull, vote, coarser
 * grids and solver with a rig that knows of the rod, one that does not, and without it.
 * The pictures are sums along rays up to the rod, not products of the matrix. */
#include "recon/frame/frame.h"
#include "base/mem.h"
#include "tests/lib/centre.h"
#include "tests/t.h"

enum { CAMERAS = 8, W = 64, H = 48, N = 32 };

static struct rec_body rod = {
    .kind = REC_BODY_CYLINDER, .a = {-0.6, 0, 0.4}, .b = {0.6, 0.1, 0.5}, .radius = 0.06};
static const struct rec_bodies one = {1, &rod};

/* A fire of three tongues. */
static double glow(const double x[3])
{
    static const double at[3][3] = {{-0.15, 0, 0.4}, {0.12, 0.12, 0.5}, {0.05, -0.15, 0.6}};
    double sum = 0;
    for (int i = 0; i < 3; i++) {
        double r2 = 0;
        for (int a = 0; a < 3; a++)
            r2 += (x[a] - at[i][a]) * (x[a] - at[i][a]);
        sum += fmax(0, 1 - r2 / 0.05);
    }
    return sum * sum;
}

static double ray(const double o[3], const double d[3], double end)
{
    const double step = 0.01;
    double sum = 0;
    for (double s = 1.2; s < 3.4; s += step) {
        double m = s + step / 2, x[3] = {o[0] + m * d[0], o[1] + m * d[1], o[2] + m * d[2]};
        sum += m < end ? step * glow(x) : 0;
    }
    return sum;
}

static float *picture[2][CAMERAS]; /* without the rod, with it */

static void shoot(const struct rec_rig *r)
{
    for (size_t c = 0; c < CAMERAS; c++)
        for (int k = 0; k < 2; k++) {
            picture[k][c] = pvx_calloc((size_t)W * H, sizeof(float));
            for (int i = 0; i < 4 * W * H; i++) { /* area means of 2 x 2 rays */
                int x = i / 4 % W, y = i / 4 / W;
                double o[3], d[3];
                if (!rec_camera_ray(&r->cameras[c], x + i % 2 * 0.5 - 0.25,
                                    y + i / 2 % 2 * 0.5 - 0.25, o, d))
                    continue;
                double end = k == 1 ? rec_body_hit(&one, o, d) : INFINITY;
                picture[k][c][y * W + x] += (float)(ray(o, d, end) / 4);
            }
        }
}

/* Error over the voxels that are outside the rod. */
static double error_of(const struct rec_grid *g, const float *dense)
{
    double wrong = 0, all = 0;
    for (size_t i = 0; i < rec_grid_count(g); i++) {
        double x[3];
        grid_centre(g, (int32_t)i, x);
        if (rec_body_inside(&rod, x))
            continue;
        double t = glow(x), e = dense[i] - t;
        wrong += e * e;
        all += t * t;
    }
    return sqrt(wrong / all);
}

static double solve(struct rec_rig r, bool knows, bool there)
{
    struct rec_frame_params p = rec_frame_defaults;
    struct rec_sparse v;
    rec_sysmat *S = NULL;
    rec_frame *f = NULL;
    if (knows)
        r.bodies = one;
    T_EQ_I(rec_sysmat_build(&r, &rec_sysmat_defaults, NULL, NULL, NULL, &S, NULL), PVX_OK);
    p.nch = 1;
    p.photo.saturation = 1e30f;
    T_EQ_I(rec_frame_alone(S, &r, &p, NULL, &f, NULL), PVX_OK);
    rec_frame_reset(f);
    for (size_t c = 0; c < CAMERAS; c++) {
        float *in = rec_frame_input(f, c);
        for (size_t i = 0; i < (size_t)W * H; i++)
            in[i] = picture[there][c][i] + (float)(0.005 * t_normal());
        rec_frame_camera(f, c)->present = true;
    }
    rec_frame_carve(f);
    T_EQ_I(rec_frame_solve(f, 0, NULL), PVX_OK);
    const struct rec_frame_report *report = rec_frame_get_report(f);
    if (knows || !there)
        T_EQ_I(report->cameras, CAMERAS); /* nobody is suspected for what the rod hides */
    T_OK(S->coarse != NULL && isfinite(report->solve.rel_residual));
    rec_frame_volume(f, &v);
    float *dense = pvx_calloc(rec_grid_count(v.grid), sizeof *dense);
    rec_sparse_to_dense(&v, dense);
    for (size_t i = 0; i < rec_grid_count(v.grid); i++)
        T_OK(dense[i] >= 0 && dense[i] < 100);
    double e = error_of(v.grid, dense);
    free(dense);
    rec_frame_free(&f);
    rec_sysmat_free(&S);
    return e;
}

static void compare(enum rec_basis basis)
{
    struct rec_rig r;
    T_EQ_I(rec_rig_ring(CAMERAS, 2.2, W, H, N, &r), PVX_OK);
    r.grid.basis = basis;
    shoot(&r);
    double without = solve(r, false, false), known = solve(r, true, true),
           unknown = solve(r, false, true);
    printf("  %s: without %.4f, known %.4f, unknown %.4f\n", rec_basis_name(basis), without, known,
           unknown);
    T_LE(known, 1.5 * without); /* four voxels thick; bench_bodies: 1.04 on a grid twice as fine */
    T_LE(2 * known, unknown);
    for (int k = 0; k < 2; k++)
        for (size_t c = 0; c < CAMERAS; c++)
            free(picture[k][c]);
    rec_rig_fini(&r);
}

T_CASE(a_rod_that_is_known_costs_little_box)
{
    T_NOT_UNDER_SANITIZERS();
    compare(REC_BOX);
}
T_CASE(a_rod_that_is_known_costs_little_trilinear)
{
    compare(REC_TRILINEAR);
}
