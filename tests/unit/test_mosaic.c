/* test_mosaic.c - Bayer pixels as they are: photometry of one channel per bin, weights per row and channel in
 * the default solver, a frame set from such pictures. */
#include "tests/lib/scene.h"
#include "tests/lib/slot.h"
#include "tests/lib/system.h"

#include "capture/pixel/pixfmt.h"
#include "recon/solve/impl.h"
#include "recon/carve/photo.h"
#include "recon/frame/inside.h"

enum { W = 64, H = 48 };
static struct scene sc;
static float img[W * H * 4] __attribute__((aligned(16))),
    plane[W * H * 4] __attribute__((aligned(16))), weight[W * H];
static uint8_t lit[W * H];
static const float one[3] = {1, 1, 1};
static struct rec_photo_stats st;
static const uint8_t cells[4][4] = {{0, 1, 1, 2}, {1, 0, 2, 1}, {1, 2, 0, 1}, {2, 1, 1, 0}};

static int colour(const uint8_t *cell, int i)
{
    return cell[i / W % 2 * 2 + i % W % 2];
}

/* ---- photometry ---- */

/* A mosaic of these cells, or made from Bayer pixels with this binning. */
static void apply(const uint8_t *cell, int32_t bayer, const struct rec_photo_params *p)
{
    struct rec_photo_work *work = rec_photo_work_new(W, H);
    rec_photo_apply(&(struct rec_photo_image){.img = img,
                                              .bw = W,
                                              .bh = H,
                                              .nch = 3,
                                              .cell = cell,
                                              .bayer = bayer,
                                              .gain = one,
                                              .params = p,
                                              .weight = weight,
                                              .lit = lit,
                                              .stats = &st,
                                              .work = work,
                                              .plane = plane},
                    1, NULL);
    free(work);
}

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

T_CASE(noise_comes_from_bins_of_one_colour)
{
    for (int k = 0; k < 4; k++) {
        paint(cells[k], 0, 0.6, 0.01);
        apply(cells[k], 0, &rec_photo_defaults);
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
T_CASE(noise_of_binned_and_interpolated_pixels)
{
    enum { BIG = 4 * W };
    static uint16_t raw[BIG * BIG];
    for (int i = 0; i < BIG * BIG; i++)
        raw[i] = (uint16_t)lrint(10000 + 600 * t_normal());
    for (int b = 1; b <= 4; b *= 2) {
        struct rec_photo_params p = rec_photo_defaults;
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
        apply(NULL, b, &p);
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
T_CASE(silhouettes_have_no_holes)
{
    for (int channel = 0; channel < 3; channel++) {
        int holes = 0, beside = 0;
        paint(cells[0], channel, 0.6, 0.01);
        apply(cells[0], 0, &rec_photo_defaults);
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
T_CASE(faint_flames_are_seen)
{
    int seen = 0, all = 0, beside = 0;
    for (int i = 0; i < W * H; i++) {
        double x = i % W - W / 2, y = i / W - H / 2;
        for (int l = 0; l < 4; l++)
            img[i * 4 + l] = NAN;
        img[i * 4 + colour(cells[2], i)] =
            (float)((x * x + y * y < 100 ? 0.03 : 0) + 0.02 * t_normal());
    }
    apply(cells[2], 0, &rec_photo_defaults);
    for (int i = 0; i < W * H; i++) {
        double x = i % W - W / 2, y = i / W - H / 2, r2 = x * x + y * y;
        all += r2 < 64;
        seen += r2 < 64 && lit[i];
        beside += r2 > 300 && lit[i];
    }
    T_LE(0.8 * all, seen);
    T_LE(beside, W * H / 50);
}

T_CASE(saturated_and_broken_bins)
{
    paint(cells[0], 1, 0.5, 0);
    img[(20 * W + 10) * 4 + colour(cells[0], 20 * W + 10)] = 1;               /* saturated */
    img[(20 * W + 51) * 4 + colour(cells[0], 20 * W + 51)] = NAN;             /* broken */
    img[(21 * W + 51) * 4 + (colour(cells[0], 21 * W + 51) + 1) % 3] = 1e20f; /* not its lane */
    apply(cells[0], 0, &rec_photo_defaults);
    T_EQ_I(st.saturated, 1);
    T_EQ_I(st.not_finite, 1);
    T_OK(weight[20 * W + 10] == 0 && lit[20 * W + 10]);
    T_OK(weight[20 * W + 51] == 0 && lit[20 * W + 51]);
    T_OK(weight[21 * W + 51] == 1);
}

T_CASE(the_plane_is_flat_where_the_picture_is)
{
    for (int k = 0; k < 4; k++) {
        for (int i = 0; i < W * H; i++) {
            memset(img + i * 4, 0, 16);
            img[i * 4 + colour(cells[k], i)] = 0.5f;
        }
        apply(cells[k], 0, &rec_photo_defaults);
        for (int i = 0; i < W * H; i++)
            for (int l = 0; l < 3; l++)
                T_OK(fabsf(plane[i * 4 + l] - 0.5f) < 1e-6f);
    }
}

/* ---- solver ---- */

/* Pictures of the scene in nch channels, some rows without weight; w4 the same per channel. */
static void view(struct system *y, int nch, unsigned cpu)
{
    system_new(y, &sc, nch, 0.4, cpu);
    system_pictures(y, &sc, 0);
    y->w4 = pvx_calloc(y->rows * 4, sizeof *y->w4);
    for (size_t i = 0; i < y->rows; i++) {
        y->w[i] = i % 7 != 0;
        for (size_t l = 0; l < 3; l++)
            y->w4[i * 4 + l] = y->w[i];
    }
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

static pvx_err solve(struct system *y, bool per_channel, const struct rec_solve_params *p)
{
    struct rec_solve_report r;
    const struct rec_pictures in = {.b = y->b,
                                    .w = per_channel ? y->w4 : y->w,
                                    .per_channel = per_channel,
                                    .sigma = {0.01, 0.01, 0.01, 0.01}};
    return solve_from(y->s, y->a, &in, p, y->x, &r);
}

T_CASE(weights_alike_are_one_weight)
{
    struct system a, b;
    struct rec_solve_params p = rec_solve_defaults;
    view(&a, 3, PVX_CPU_BEST);
    view(&b, 3, PVX_CPU_BEST);
    T_EQ_I(solve(&a, false, &p), PVX_OK);
    T_EQ_I(solve(&b, true, &p), PVX_OK);
    T_EQ_I(memcmp(a.x, b.x, (size_t)a.a->n * 16), 0);
    system_free(&a);
    system_free(&b);
}

/* The same with an absolute weight of the smoothness term. */
static pvx_err solve_weighed(struct system *y, bool per_channel, double lambda,
                             const struct rec_solve_params *p)
{
    struct rec_solve_report r;
    const struct rec_pictures in = {.b = y->b,
                                    .w = per_channel ? y->w4 : y->w,
                                    .per_channel = per_channel,
                                    .sigma = {0.01, 0.01, 0.01, 0.01}};
    rec_problem_load(y->s, y->a, &in);
    rec_problem_weigh(y->s, 0);
    for (int l = 0; l < 4; l++)
        y->s->lambda[l] = lambda;
    rec_start_earlier(y->s, y->x);
    return rec_solve(y->s, p, y->x, &r);
}

/* Each channel of a mosaic is a system of its own: one channel with the same rows has the same answer. */
T_CASE(channels_are_systems_of_their_own)
{
    struct system y, mono;
    struct rec_solve_params p = rec_solve_defaults;
    p.stop = REC_STOP_ITERATIONS;
    p.iterations = 300;
    view(&y, 3, PVX_CPU_BEST);
    make_mosaic(&y);
    T_EQ_I(solve_weighed(&y, true, 1e-4, &p), PVX_OK);
    for (int l = 0; l < 3; l++) {
        double e = 0, sum = 0;
        view(&mono, 1, PVX_CPU_BEST);
        for (size_t i = 0; i < mono.rows; i++) {
            mono.b[i] = y.b[i * 4 + (size_t)l];
            mono.w[i] = y.w4[i * 4 + (size_t)l];
        }
        T_EQ_I(solve_weighed(&mono, false, 1e-4, &p), PVX_OK);
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

T_CASE(any_processor_gives_the_same)
{
    struct system a, b;
    struct rec_solve_params p = rec_solve_defaults;
    p.stop = REC_STOP_ITERATIONS;
    p.iterations = 12;
    view(&a, 3, 0);
    view(&b, 3, PVX_CPU_BEST);
    make_mosaic(&a);
    make_mosaic(&b);
    T_EQ_I(solve(&a, true, &p), PVX_OK);
    T_EQ_I(solve(&b, true, &p), PVX_OK);
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
T_CASE_OF_THREADS(coarse_levels_agree)
{
    struct rec_kernels k;
    struct rec_frame_params fp = rec_frame_defaults;
    rec_frame *f = NULL;
    float *x[2];
    rec_kernels_init(&k, PVX_CPU_BEST);
    fp.photo.saturation = 1e30f;
    T_EQ_I(rec_frame_alone(sc.S, &sc.rig, &fp, sc.pool, &f, NULL), PVX_OK);
    scene_shoot(&sc, f, 0);
    rec_frame_carve(f);
    const struct rec_subsys *a = rec_frame_subsys(f);
    size_t rows = a->row0[sc.S->n_cameras];
    float *ones = pvx_calloc(rows * 4, sizeof *ones);
    for (size_t i = 0; i < rows * 4; i++)
        ones[i] = i % 4 < 3;
    rec_problem *pb;
    rec_levels *l;
    T_EQ_I(rec_problem_new(sc.S, 3, &pb), PVX_OK);
    T_EQ_I(rec_levels_new(sc.S, &k, sc.pool, 4, &l), PVX_OK);
    for (int per_channel = 0; per_channel < 2; per_channel++) {
        struct rec_descent *d = &f->solver->descent;
        struct rec_pictures in = slot_pictures(f, 0);
        in.per_channel = per_channel;
        in.w = per_channel ? ones : in.w;
        x[per_channel] = pvx_calloc((size_t)a->n * 4, sizeof *x[per_channel]);
        rec_levels_restrict(l, f->carver->restrictor, a, &in);
        rec_problem_load(pb, a, &in);
        rec_problem_weigh(pb, 0.1f);
        d->levels = l;
        d->deadline_ns = 0;
        rec_levels_solve(pb, d, x[per_channel]);
    }
    rec_levels_free(&l);
    rec_problem_free(&pb);
    T_EQ_I(memcmp(x[0], x[1], (size_t)a->n * 16), 0);
    free(ones);
    free(x[0]);
    free(x[1]);
    rec_frame_free(&f);
}

T_CASE(other_solvers_refuse)
{
    struct system y, mono;
    struct rec_solve_params p = rec_solve_defaults;
    view(&y, 3, PVX_CPU_BEST);
    for (const char *const *name = rec_solver_names() + 1; *name != NULL; name++) {
        p.solver = *name;
        T_EQ_I(solve(&y, true, &p), PVX_EUNSUP);
    }
    system_free(&y);
    view(&mono, 1, PVX_CPU_BEST);
    p.solver = NULL;
    T_EQ_I(solve(&mono, true, &p), PVX_EUNSUP);
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
        bool rays = way == CAP_MOSAIC_RAYS && !(three_chips != NULL && three_chips[c]);
        *rec_frame_camera(f, c) = (struct rec_frame_camera){
            .present = true, .mosaic = true, .cell = rays ? cap_pixfmt_bayer(fmt) : NULL};
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
    if (rec_frame_alone(sc.S, &sc.rig, &p, pool, &f, NULL) != PVX_OK)
        exit(2);
    return f;
}

T_CASE(pixels_as_they_are_beat_interpolated_ones)
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

/* Solved, both have the same bits. */
static void same_volumes(rec_frame *a, rec_frame *b)
{
    struct rec_sparse va, vb;
    (void)error_of(a);
    (void)error_of(b);
    rec_frame_volume(a, &va);
    rec_frame_volume(b, &vb);
    T_EQ_I(va.n, vb.n);
    T_OK(va.n > 100);
    T_EQ_I(memcmp(va.value, vb.value, (size_t)va.n * 16), 0);
}

T_CASE_OF_THREADS(threads_change_nothing)
{
    pvx_pool *single = NULL;
    T_EQ_I(pvx_pool_new(1, "one", &single), PVX_OK);
    rec_frame *a = new_frame(sc.pool), *b = new_frame(single);
    shoot(a, CAP_MOSAIC_RAYS, NULL);
    shoot(b, CAP_MOSAIC_RAYS, NULL);
    same_volumes(a, b);
    rec_frame_free(&a);
    rec_frame_free(&b);
    pvx_pool_free(&single);
}

/* A slot that had a mosaic does not keep it. */
T_CASE(a_reset_forgets_the_mosaic)
{
    rec_frame *f = new_frame(sc.pool), *fresh = new_frame(sc.pool);
    shoot(f, CAP_MOSAIC_RAYS, NULL);
    (void)error_of(f);
    shoot(f, CAP_MOSAIC_DEMOSAIC, NULL);
    shoot(fresh, CAP_MOSAIC_DEMOSAIC, NULL);
    same_volumes(f, fresh);
    rec_frame_free(&f);
    rec_frame_free(&fresh);
}

T_MAIN(scene_new(&sc, 8, W, 32, 2, 3), scene_free(&sc))
