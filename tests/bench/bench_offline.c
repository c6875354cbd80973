/* bench_offline.c - from raw 8-bit pixels to volumes: sets per second, and each stage against the time
 * that moving its bytes would take at the bandwidth measured here. */
#include "bench.h"

#include "capture/pixel/pixfmt.h"

struct input {
    uint8_t *px[REC_MAX_CAMERAS];
};

struct bin_job {
    const struct scene *s;
    const struct input *in;
    rec_frame *f;
    int binning;
};

static void bin_camera(void *ctx, size_t c)
{
    const struct bin_job *j = ctx;
    const struct rec_camera *cam = &j->s->rig.cameras[c];
    struct cap_image img = {j->in->px[c],
                            (size_t)cam->width * (size_t)cam->height * 3,
                            cam->width,
                            cam->height,
                            (ptrdiff_t)cam->width * 3,
                            CAP_RGB8,
                            0};
    CHECK(cap_bin(&img, j->binning, 3, 0, cam->height / j->binning, rec_frame_input(j->f, c)));
}

static void run(FILE *csv, const int32_t size[3], enum rec_basis basis, double want,
                unsigned threads, int32_t rays)
{
    const int32_t w = size[0], h = size[1], voxels = size[2];
    pvx_pool *pool;
    struct scene s;
    struct input in;
    rec_sysmat *S;
    rec_frame *f;
    CHECK(pvx_pool_new(threads, "bench", &pool));
    scene_flame(&s, size, basis, pool);
    for (size_t c = 0; c < s.rig.n_cameras; c++)
        in.px[c] = scene_rgb8(&s, c);
    int64_t t0 = pvx_now_mono();
    struct rec_sysmat_params mp = rec_sysmat_defaults;
    mp.rays_per_bin = rays;
    CHECK(rec_sysmat_build(&s.rig, &mp, pool, NULL, NULL, &S, NULL));
    double build_s = (double)(pvx_now_mono() - t0) * 1e-9;
    CHECK(rec_frame_alone(S, &s.rig, &rec_frame_defaults, pool, &f, NULL));

    int64_t bin = 0, photo = 0, hull = 0, restricted = 0, solve = 0;
    int sets = 0;
    struct rec_frame_report r = {0};
    int64_t start = pvx_now_mono();
    for (; sets < 200 && (sets < 5 || pvx_now_mono() - start < 3 * PVX_NS_PER_S); sets++) {
        rec_frame_reset(f);
        int64_t t = pvx_now_mono();
        struct bin_job j = {&s, &in, f, S->binning};
        pvx_pool_run(pool, 8, bin_camera, &j);
        for (size_t c = 0; c < 8; c++)
            rec_frame_camera(f, c)->present = true;
        bin += pvx_now_mono() - t;
        rec_frame_carve(f);
        CHECK(rec_frame_solve(f, 0, NULL));
        r = *rec_frame_get_report(f);
        photo += r.photo_ns;
        hull += r.hull_ns;
        restricted += r.restrict_ns;
        solve += r.solve_ns;
    }
    double rate = sets / ((double)(pvx_now_mono() - start) * 1e-9);

    /* bytes that each stage must move at least once */
    size_t N = rec_grid_count(&S->grid), bins = 0;
    for (size_t c = 0; c < 8; c++)
        bins += (size_t)S->block[c].bw * (size_t)S->block[c].bh;
    double raw = 8.0 * w * h * 3, active = (double)r.active_voxels, rows = (double)r.active_rays;
    double windows = bytes_of_windows(rec_frame_subsys(f));
    double vectors = active * 316 + rows * 16 * 4; /* NUMERICS.md, 5 */
    double bytes[] = {raw + (double)bins * 16, (double)bins * 53,
                      8.0 * ((double)N / 64 + active) * sizeof(struct rec_rect) + (double)bins * 5,
                      active * 8 + windows * 2,
                      r.solve.iterations * (2 * windows + vectors)}; /* coarse grids: time only */
    int64_t ns[] = {bin, photo, hull, restricted, solve};
    static const char *const stage[] = {"unpack+bin", "photometry", "hull", "restrict", "solve"};
    double bw = bench_bandwidth((size_t)(windows + vectors), pool);
    printf(
        "\n%d^3 %s from 8 x %dx%d RGB8, binning %d, %dx%d rays, %u thread%s: %.1f sets/s (target "
        "%.0f), matrix "
        "%.0f MB in %.1f s\n",
        voxels, rec_basis_name(basis), w, h, S->binning, S->rays_per_bin, S->rays_per_bin, threads,
        threads > 1 ? "s" : "", rate, want, (double)S->nnz * 6e-6, build_s);
    printf("  %lld voxels, %lld rays, %.2f M entries, %u + %u iterations (coarser grids, this one; "
           "%s); "
           "bandwidth of that working set %.1f GB/s\n",
           (long long)r.active_voxels, (long long)r.active_rays, (double)r.entries * 1e-6,
           r.coarse_iterations, r.solve.iterations, rec_status_name(r.solve.status), bw * 1e-9);
    for (int i = 0; i < 5; i++) {
        double t = ms(ns[i]) / sets, bound = bytes[i] / bw * 1e3;
        bench_row(csv, "%d,%d,%d,%s,%d,%u,%s,%.4f,%.4f,%.2f", voxels, w, h, rec_basis_name(basis),
                  rays, threads, stage[i], t, bound, rate);
    }
    struct rec_sparse v;
    float *dense = must_floats(N * 3);
    rec_frame_volume(f, &v);
    rec_sparse_to_dense(&v, dense);
    printf("  volume error %.3f, unseen view %.2f of 255 where the flame is\n",
           rec_rel_l2(dense, s.truth, N * 3), view_error(&s, dense, pool));
    free(dense);
    for (size_t c = 0; c < 8; c++)
        free(in.px[c]);
    rec_frame_free(&f);
    rec_sysmat_free(&S);
    scene_fini(&s);
    pvx_pool_free(&pool);
}

int main(int argc, char **argv)
{
    static const int32_t size_128[3] = {320, 240, 128}, live[3] = {640, 480, 64};
    printf("offline: raw pixels to volume, one set after the other\n");
    FILE *csv = bench_csv(argc, argv, "offline",
                          "voxels,width,height,basis,rays,threads,stage,ms,bound_ms,sets_per_s");
    for (int basis = REC_BOX; basis <= REC_TRILINEAR; basis++)
        for (unsigned threads = 1; threads <= 2; threads++) {
            run(csv, size_64, basis, basis == REC_BOX ? 170 : 120, threads, 2);
            run(csv, size_128, basis, basis == REC_BOX ? 30 : 20, threads, 2);
        }
    run(csv, size_64, REC_BOX, 170, 2, 1); /* the paper's pixel */
    run(csv, size_128, REC_BOX, 30, 2, 1);
    run(csv, live, REC_TRILINEAR, 15, 2, 2);
    fclose(csv);
    return 0;
}
