/* test_mosaic.c - Bayer pixels as they are: photometry of one channel per bin, weights per row and channel in
 * the default solver, a frame set from such pictures. */
#include "../scene.h"

#include "capture/pixel/pixfmt.h"
#include "recon/levels.h"
#include "recon/carve/photo.h"
#include "recon/carve/photo_mosaic.h"

enum { W = 64, H = 48 };
static struct scene sc;
static float img[W * H * 4] __attribute__((aligned(16))),
    plane[W * H * 4] __attribute__((aligned(16))), weight[W * H], scratch[W * H];
static uint8_t lit[W * H];
static const float one[3] = {1, 1, 1};
static const uint8_t cells[4][4] = {{0, 1, 1, 2}, {1, 0, 2, 1}, {1, 2, 0, 1}, {2, 1, 1, 0}};

static int colour(const uint8_t *cell, int i)
{
    return cell[i / W % 2 * 2 + i % W % 2];
}

/* ---- photometry ---- */

/* A round flame of radius 10 that is `top` bright in one channel alone, on noise; other lanes NaN. */
static void paint(const uint8_t *cell, int channel, double top, double noise)
{
    for (int i = 0; i < W * H; i++) {
        double x = i % W - W / 2, y = i / W - H / 2, r = sqrt(x * x + y * y);
        int own = colour(cell, i);
        for (int l = 0; l < 4; l++)
            img[i * 4 + l] = NAN;
        img[i * 4 + own] =
            (float)((own == channel && r < 10 ? top * (1 - r / 20) : 0) + noise * t_normal());
    }
}

static void noise_comes_from_bins_of_one_colour(void)
{
    struct rec_photo_stats st;
    for (int k = 0; k < 4; k++) {
        paint(cells[k], 0, 0.6, 0.01);
        rec_photo_apply_mosaic(img, W, H, cells[k], NULL, one, &rec_photo_defaults, weight, lit,
                               scratch, plane, &st);
        for (int c = 0; c < 3; c++)
            T_NEAR(st.sigma[c], 0.01, 0.0025);
        T_EQ_I(st.not_finite, 0);
        for (int i = 0; i < W * H; i++)
            for (int l = 0; l < 4; l++)
                T_OK(l == colour(cells[k], i) || img[i * 4 + l] == 0);
    }
}

/* Bins of Bayer pixels share samples of red and blue, so neighbours' noise is alike; the estimate is that of
 * a bin nevertheless, and dark pictures do not fill with speckles. */
static void noise_of_binned_and_interpolated_pixels(void)
{
    enum { BIG = 4 * W };
    static uint16_t raw[BIG * BIG];
    for (int i = 0; i < BIG * BIG; i++)
        raw[i] = (uint16_t)lrint(10000 + 600 * t_normal());
    for (int b = 1; b <= 4; b *= 2) {
        struct rec_photo_params p = rec_photo_defaults;
        struct rec_photo_stats st;
        struct cap_image pic = {raw, sizeof raw, W * b, H * b, BIG * 2, CAP_BAYER_GB16, 0};
        double sum[3] = {0}, sum2[3] = {0};
        int dark = 0;
        T_EQ_I(cap_bin(&pic, b, 3, 0, H, img), PVX_OK);
        for (int i = 0; i < W * H; i++)
            for (int c = 0; c < 3; c++) {
                sum[c] += (double)img[i * 4 + c];
                sum2[c] += (double)img[i * 4 + c] * (double)img[i * 4 + c];
            }
        p.black = 10000.0f / 65535;
        rec_photo_apply_bayer(img, W, H, b, NULL, one, &p, weight, lit, scratch, &st);
        for (int c = 0; c < 3; c++) {
            double true_sigma = sqrt(sum2[c] / (W * H) - pow(sum[c] / (W * H), 2));
            T_CHECK_(fabs((double)st.sigma[c] / true_sigma - 1) < 0.25,
                     "binning %d channel %d: %g, is %g", b, c, (double)st.sigma[c], true_sigma);
        }
        for (int i = 0; i < W * H; i++)
            dark += lit[i];
        T_CHECK_(dark <= W * H / 100, "binning %d: %d of %d bins lit", b, dark, W * H);
    }
}

/* Whatever the colour of the flame: bins of all colours are lit in it, hardly any beside it. */
static void silhouettes_have_no_holes(void)
{
    struct rec_photo_stats st;
    for (int channel = 0; channel < 3; channel++) {
        int holes = 0, beside = 0;
        paint(cells[0], channel, 0.6, 0.01);
        rec_photo_apply_mosaic(img, W, H, cells[0], NULL, one, &rec_photo_defaults, weight, lit,
                               scratch, plane, &st);
        for (int i = 0; i < W * H; i++) {
            double x = i % W - W / 2, y = i / W - H / 2, r = sqrt(x * x + y * y);
            holes += r < 9.5 && !lit[i];
            beside += r > 14 && lit[i];
            T_OK(weight[i] == 1);
        }
        T_EQ_I(holes, 0);
        T_LE(beside, W * H / 100);
    }
}

/* Faint flames are found by means: 1.5 sigma bright in the mosaic. */
static void faint_flames_are_seen(void)
{
    struct rec_photo_stats st;
    int seen = 0, all = 0, beside = 0;
    for (int i = 0; i < W * H; i++) {
        double x = i % W - W / 2, y = i / W - H / 2;
        for (int l = 0; l < 4; l++)
            img[i * 4 + l] = NAN;
        img[i * 4 + colour(cells[2], i)] =
            (float)((x * x + y * y < 100 ? 0.03 : 0) + 0.02 * t_normal());
    }
    rec_photo_apply_mosaic(img, W, H, cells[2], NULL, one, &rec_photo_defaults, weight, lit,
                           scratch, plane, &st);
    for (int i = 0; i < W * H; i++) {
        double x = i % W - W / 2, y = i / W - H / 2, r2 = x * x + y * y;
        all += r2 < 64;
        seen += r2 < 64 && lit[i];
        beside += r2 > 300 && lit[i];
    }
    T_LE(0.8 * all, seen);
    T_LE(beside, W * H / 50);
}

static void saturated_and_broken_bins(void)
{
    struct rec_photo_stats st;
    paint(cells[0], 1, 0.5, 0);
    img[(20 * W + 10) * 4 + colour(cells[0], 20 * W + 10)] = 1;               /* saturated */
    img[(20 * W + 51) * 4 + colour(cells[0], 20 * W + 51)] = NAN;             /* broken */
    img[(21 * W + 51) * 4 + (colour(cells[0], 21 * W + 51) + 1) % 3] = 1e20f; /* not its lane */
    rec_photo_apply_mosaic(img, W, H, cells[0], NULL, one, &rec_photo_defaults, weight, lit,
                           scratch, plane, &st);
    T_EQ_I(st.saturated, 1);
    T_EQ_I(st.not_finite, 1);
    T_OK(weight[20 * W + 10] == 0 && lit[20 * W + 10]);
    T_OK(weight[20 * W + 51] == 0 && lit[20 * W + 51]);
    T_OK(weight[21 * W + 51] == 1);
}

static void the_plane_is_flat_where_the_picture_is(void)
{
    for (int k = 0; k < 4; k++) {
        for (int i = 0; i < W * H; i++) {
            memset(img + i * 4, 0, 16);
            img[i * 4 + colour(cells[k], i)] = 0.5f;
        }
        rec_mosaic_plane(img, W, H, plane);
        for (int i = 0; i < W * H; i++)
            for (int l = 0; l < 3; l++)
                T_OK(fabsf(plane[i * 4 + l] - 0.5f) < 1e-6f);
    }
}

/* ---- solver ---- */

struct system {
    struct rec_kernels k;
    struct rec_subsys *a;
    rec_solver *s;
    int32_t *col;
    size_t rows;
    float *b, *w, *w4, *x;
};

/* All voxels of a ball, pictures of the scene in nch channels, some rows without weight; w4 the same per
 * channel. */
static void system_new(struct system *y, int nch, unsigned cpu)
{
    bool present[REC_MAX_CAMERAS];
    int32_t n = 0;
    size_t cs = nch == 3 ? 4 : 1;
    memset(y, 0, sizeof *y);
    memset(present, true, sizeof present);
    rec_kernels_init(&y->k, cpu);
    y->col = pvx_calloc(sc.voxels, sizeof *y->col);
    for (int32_t i = 0; i < (int32_t)sc.voxels; i++) {
        double p[3];
        rec_grid_centre(&sc.rig.grid, i, p);
        if (p[0] * p[0] + p[1] * p[1] + (p[2] - 0.5) * (p[2] - 0.5) < 0.16)
            y->col[n++] = i;
    }
    if (rec_subsys_new(sc.S, &y->k, sc.pool, (int)cs, &y->a) != PVX_OK ||
        rec_solver_new(sc.S, nch, &y->s) != PVX_OK)
        exit(2);
    rec_subsys_restrict(y->a, y->col, n, present);
    y->rows = y->a->row0[sc.S->n_cameras];
    y->b = pvx_calloc(y->rows * cs, sizeof *y->b);
    y->w = pvx_calloc(y->rows, sizeof *y->w);
    y->w4 = pvx_calloc(y->rows * 4, sizeof *y->w4);
    y->x = pvx_calloc(((size_t)n + 1) * cs, sizeof *y->x);
    for (size_t c = 0; c < sc.rig.n_cameras; c++)
        for (size_t i = y->a->row0[c]; i < y->a->row0[c + 1]; i++) {
            for (size_t l = 0; l < (cs == 4 ? 3 : 1); l++)
                y->b[i * cs + l] = sc.image[c][(i - y->a->row0[c]) * 4 + l];
            y->w[i] = i % 7 != 0;
            for (size_t l = 0; l < 3; l++)
                y->w4[i * 4 + l] = y->w[i];
        }
}

static void system_free(struct system *y)
{
    rec_solver_free(&y->s);
    rec_subsys_free(&y->a);
    free(y->col);
    free(y->b);
    free(y->w);
    free(y->w4);
    free(y->x);
}

/* Row i of camera c: which colour it measures. */
static int row_colour(const struct system *y, size_t i)
{
    size_t c = 0;
    while (i >= y->a->row0[c + 1])
        c++;
    size_t bw = (size_t)sc.S->block[c].bw, r = i - y->a->row0[c];
    return cells[c % 4][r / bw % 2 * 2 + r % bw % 2];
}

/* Rows measure their colour alone: weights, and b where there is none 0. */
static void make_mosaic(struct system *y)
{
    for (size_t i = 0; i < y->rows; i++)
        for (int l = 0; l < 3; l++)
            if (l != row_colour(y, i))
                y->w4[i * 4 + (size_t)l] = y->b[i * 4 + (size_t)l] = 0;
}

static void solve(struct system *y, const struct rec_solve_params *p)
{
    struct rec_solve_report r;
    T_EQ_I(rec_solve(y->s, y->a, y->b, p->lanes ? y->w4 : y->w, 0.01, p, y->x, NULL, NULL, &r),
           PVX_OK);
}

static void weights_alike_are_one_weight(void)
{
    struct system a, b;
    struct rec_solve_params p = rec_solve_defaults;
    system_new(&a, 3, REC_CPU_ALL);
    system_new(&b, 3, REC_CPU_ALL);
    solve(&a, &p);
    p.lanes = true;
    solve(&b, &p);
    T_EQ_I(memcmp(a.x, b.x, (size_t)a.a->n * 16), 0);
    system_free(&a);
    system_free(&b);
}

/* Each channel of a mosaic is a system of its own: one channel with the same rows has the same answer. */
static void channels_are_systems_of_their_own(void)
{
    struct system y, mono;
    const double lambda[4] = {1e-4, 1e-4, 1e-4, 1e-4};
    struct rec_solve_params p = rec_solve_defaults;
    p.stop = REC_STOP_ITERATIONS;
    p.iterations = 300;
    p.weight = lambda;
    p.lanes = true;
    system_new(&y, 3, REC_CPU_ALL);
    make_mosaic(&y);
    solve(&y, &p);
    p.lanes = false;
    for (int l = 0; l < 3; l++) {
        double e = 0, sum = 0;
        system_new(&mono, 1, REC_CPU_ALL);
        for (size_t i = 0; i < mono.rows; i++) {
            mono.b[i] = y.b[i * 4 + (size_t)l];
            mono.w[i] = y.w4[i * 4 + (size_t)l];
        }
        solve(&mono, &p);
        for (int32_t q = 0; q < y.a->n; q++) {
            double d = (double)y.x[q * 4 + l] - (double)mono.x[q];
            e += d * d;
            sum += (double)mono.x[q] * (double)mono.x[q];
        }
        T_LE(sqrt(e / sum), 2e-3);
        T_OK(sum > 0);
        system_free(&mono);
    }
    system_free(&y);
}

static void any_processor_gives_the_same(void)
{
    struct system a, b;
    struct rec_solve_params p = rec_solve_defaults;
    p.lanes = true;
    p.stop = REC_STOP_ITERATIONS;
    p.iterations = 12;
    system_new(&a, 3, 0);
    system_new(&b, 3, REC_CPU_ALL);
    make_mosaic(&a);
    make_mosaic(&b);
    solve(&a, &p);
    solve(&b, &p);
    double e = 0, sum = 0;
    for (size_t i = 0; i < (size_t)a.a->n * 4; i++) {
        e += ((double)a.x[i] - b.x[i]) * ((double)a.x[i] - b.x[i]);
        sum += (double)a.x[i] * a.x[i];
    }
    T_LE(sqrt(e / sum), 1e-4);
    system_free(&a);
    system_free(&b);
}

/* On the coarser grids too: weights of 1 per channel give the start that weights of 1 give. */
static void coarse_levels_agree(void)
{
    struct rec_kernels k;
    struct rec_frame_params fp = rec_frame_defaults;
    rec_frame *f = NULL;
    float *x[2];
    rec_kernels_init(&k, REC_CPU_ALL);
    fp.photo.saturation = 1e30f;
    T_EQ_I(rec_frame_new(sc.S, &sc.rig, &fp, sc.pool, &f, NULL), PVX_OK);
    scene_shoot(&sc, f, 0);
    rec_frame_carve(f);
    const struct rec_subsys *a = rec_frame_subsys(f);
    size_t rows = a->row0[sc.S->n_cameras];
    float *ones = pvx_calloc(rows * 4, sizeof *ones);
    for (size_t i = 0; i < rows * 4; i++)
        ones[i] = i % 4 < 3;
    for (int lanes = 0; lanes < 2; lanes++) {
        const double lambda[4] = {1e-4, 1e-4, 1e-4, 1e-4};
        double misfit2[4];
        uint32_t iterations;
        rec_levels *l = NULL;
        x[lanes] = pvx_calloc((size_t)a->n * 4, sizeof *x[lanes]);
        T_EQ_I(rec_levels_new(sc.S, &k, sc.pool, 3, &l), PVX_OK);
        rec_levels_restrict(l, a, rec_frame_rhs(f), lanes ? ones : rec_frame_weight(f), lanes);
        rec_levels_solve(l, a, lambda, 0, x[lanes], &iterations, misfit2);
        rec_levels_free(&l);
    }
    T_EQ_I(memcmp(x[0], x[1], (size_t)a->n * 16), 0);
    free(ones);
    free(x[0]);
    free(x[1]);
    rec_frame_free(&f);
}

static void other_solvers_refuse(void)
{
    struct system y, mono;
    struct rec_solve_params p = rec_solve_defaults;
    struct rec_solve_report r;
    system_new(&y, 3, REC_CPU_ALL);
    p.lanes = true;
    for (const char *const *name = rec_solver_names() + 1; *name != NULL; name++) {
        p.solver = *name;
        T_EQ_I(rec_solve(y.s, y.a, y.b, y.w4, 0.01, &p, y.x, NULL, NULL, &r), PVX_EUNSUP);
    }
    system_free(&y);
    system_new(&mono, 1, REC_CPU_ALL);
    p.solver = NULL;
    T_EQ_I(rec_solve(mono.s, mono.a, mono.b, mono.w4, 0.01, &p, mono.x, NULL, NULL, &r),
           PVX_EUNSUP);
    system_free(&mono);
}

/* ---- a frame set ---- */

/* 16-bit raw pictures of every camera, converted the given way. */
static void shoot(rec_frame *f, enum cap_mosaic way, const bool *three_chips)
{
    static uint16_t raw[W * H];
    rec_frame_reset(f);
    for (size_t c = 0; c < sc.rig.n_cameras; c++) {
        enum cap_pixfmt fmt = (enum cap_pixfmt)(CAP_BAYER_RG16 + c % 4);
        struct cap_image pic = {raw, sizeof raw, W, H, W * 2, fmt, 0};
        struct cap_convert_params p = {.binning = 1, .nch = 3, .mosaic = way};
        for (int i = 0; i < W * H; i++)
            raw[i] = (uint16_t)lrintf(sc.image[c][i * 4 + colour(cells[c % 4], i)] * 60000);
        T_EQ_I(cap_convert(&pic, &p, 0, H, rec_frame_input(f, c)), PVX_OK);
        if (three_chips != NULL && three_chips[c])
            for (int i = 0; i < W * H * 4; i++)
                rec_frame_input(f, c)[i] = sc.image[c][i] * (60000.0f / 65535);
        else if (way == CAP_MOSAIC_RAYS)
            rec_frame_bayer(f, c, cap_pixfmt_bayer(fmt), true);
        rec_frame_present(f, c, true);
    }
}

static double error_of(rec_frame *f)
{
    struct rec_sparse v;
    rec_frame_carve(f);
    T_EQ_I(rec_frame_solve(f, 0, NULL), PVX_OK);
    rec_frame_volume(f, &v);
    T_EQ_I(rec_frame_get_report(f)->not_finite, 0);
    for (int32_t i = 0; i < v.n * 4; i++) /* in the truth's units */
        ((float *)v.value)[i] *= 65535.0f / 60000;
    return scene_error(&sc, &v);
}

static rec_frame *new_frame(pvx_pool *pool)
{
    rec_frame *f = NULL;
    struct rec_frame_params p = rec_frame_defaults;
    if (rec_frame_new(sc.S, &sc.rig, &p, pool, &f, NULL) != PVX_OK)
        exit(2);
    return f;
}

static void pixels_as_they_are_beat_interpolated_ones(void)
{
    rec_frame *f = new_frame(sc.pool);
    const bool all[8] = {true, true, true, true, true, true, true, true};
    const bool half[8] = {true, false, true, false, true, false, true, false};
    shoot(f, CAP_MOSAIC_DEMOSAIC, NULL);
    double bilinear = error_of(f);
    shoot(f, CAP_MOSAIC_RAYS, NULL);
    double rays = error_of(f);
    shoot(f, CAP_MOSAIC_DEMOSAIC, all);
    double rgb = error_of(f);
    shoot(f, CAP_MOSAIC_RAYS, half);
    double mixed = error_of(f);
    printf("  error: three chips %.3f, half of the cameras %.3f, rays %.3f, bilinear %.3f\n", rgb,
           mixed, rays, bilinear);
    T_LE(rays, 0.85 * bilinear);
    T_LE(rgb, rays);
    T_LE(mixed, rays);
    rec_frame_free(&f);
}

static void threads_change_nothing(void)
{
    pvx_pool *single = NULL;
    struct rec_sparse va, vb;
    T_EQ_I(pvx_pool_new(1, "one", &single), PVX_OK);
    rec_frame *a = new_frame(sc.pool), *b = new_frame(single);
    shoot(a, CAP_MOSAIC_RAYS, NULL);
    shoot(b, CAP_MOSAIC_RAYS, NULL);
    (void)error_of(a);
    (void)error_of(b);
    rec_frame_volume(a, &va);
    rec_frame_volume(b, &vb);
    T_EQ_I(va.n, vb.n);
    T_OK(va.n > 100);
    T_EQ_I(memcmp(va.value, vb.value, (size_t)va.n * 16), 0);
    rec_frame_free(&a);
    rec_frame_free(&b);
    pvx_pool_free(&single);
}

/* A slot that had a mosaic does not keep it. */
static void a_reset_forgets_the_mosaic(void)
{
    rec_frame *f = new_frame(sc.pool), *fresh = new_frame(sc.pool);
    struct rec_sparse va, vb;
    shoot(f, CAP_MOSAIC_RAYS, NULL);
    (void)error_of(f);
    shoot(f, CAP_MOSAIC_DEMOSAIC, NULL);
    shoot(fresh, CAP_MOSAIC_DEMOSAIC, NULL);
    (void)error_of(f);
    (void)error_of(fresh);
    rec_frame_volume(f, &va);
    rec_frame_volume(fresh, &vb);
    T_EQ_I(va.n, vb.n);
    T_EQ_I(memcmp(va.value, vb.value, (size_t)va.n * 16), 0);
    rec_frame_free(&f);
    rec_frame_free(&fresh);
}

int main(void)
{
    if (!scene_new(&sc, 8, W, 32, 2, 3))
        return 2;
    T_RUN(noise_comes_from_bins_of_one_colour);
    T_RUN(noise_of_binned_and_interpolated_pixels);
    T_RUN(silhouettes_have_no_holes);
    T_RUN(faint_flames_are_seen);
    T_RUN(saturated_and_broken_bins);
    T_RUN(the_plane_is_flat_where_the_picture_is);
    T_RUN(weights_alike_are_one_weight);
    T_RUN(channels_are_systems_of_their_own);
    T_RUN(any_processor_gives_the_same);
    T_RUN(coarse_levels_agree);
    T_RUN(other_solvers_refuse);
    T_RUN(pixels_as_they_are_beat_interpolated_ones);
    T_RUN(threads_change_nothing);
    T_RUN(a_reset_forgets_the_mosaic);
    scene_free(&sc);
    return t_done();
}
