/* bench_bayer.c - eight Bayer cameras: each raw pixel one ray of one channel, against demosaicing, against
 * averaging each colour over 2x2 pixels, and against cameras with three sensors as the upper bound.
 * The way of the pixels is the daemon's: 12-bit raw samples, cap_convert, rec_frame. */
#include "bench.h"
#include "capture/pixel/pixfmt.h"

enum { W = 160, H = 120, FULL = 4095 }; /* as size_64 */
enum way { THREE_CHIPS, RAYS, BILINEAR, BINNED, THREE_CHIPS_BINNED, N_WAYS };
static const char *const way_name[N_WAYS] = {"rgb", "rays", "bilinear", "2x2", "rgb 2x2"};

static FILE *csv;

/* A sample of a 12-bit sensor; noise is the sensor's, before it is cut. */
static uint16_t sample(double v, double noise)
{
    double s = rint((v + (noise > 0 ? noise * bench_normal() : 0)) * FULL);
    return (uint16_t)(s < 0 ? 0 : s > FULL ? FULL : s);
}

/* Raw pictures of all cameras into a frame slot. */
static void expose(const struct scene *s, enum way way, double noise, int binning, rec_frame *f)
{
    static uint16_t raw[W * H];
    static float rgb[W * H * 3];
    const uint8_t *cell = cap_pixfmt_bayer(CAP_BAYER_RG12);
    struct cap_image img = {raw, sizeof raw, W, H, W * 2, CAP_BAYER_RG12, 0};
    struct cap_convert_params p = {.binning = binning,
                                   .nch = 3,
                                   .mosaic = way == RAYS ? CAP_MOSAIC_RAYS : CAP_MOSAIC_DEMOSAIC};
    if (way == THREE_CHIPS || way == THREE_CHIPS_BINNED)
        img = (struct cap_image){rgb, sizeof rgb, W, H, W * 12, CAP_RGB_F32, 0};
    bench_seed(7);
    rec_frame_reset(f);
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        for (int i = 0; i < W * H; i++)
            for (int ch = 0; ch < 3; ch++) { /* the same noise for all ways */
                uint16_t v = sample((double)s->image[c][i * 3 + ch], noise * s->peak);
                rgb[i * 3 + ch] = (float)v / FULL;
                if (cell[i / W % 2 * 2 + i % W % 2] == ch)
                    raw[i] = v;
            }
        CHECK(cap_convert(&img, &p, 0, H / binning, rec_frame_input(f, c)));
        rec_frame_present(f, c, true);
        if (way == RAYS || way == BILINEAR || way == BINNED)
            rec_frame_bayer(f, c, cell, way == RAYS);
    }
}

static void measure(const struct scene *s, enum flame_kind kind, const rec_sysmat *S, enum way way,
                    double noise, pvx_pool *pool)
{
    struct rec_frame_params p = rec_frame_defaults;
    rec_frame *f;
    struct rec_sparse v;
    float *dense = must_floats(rec_grid_count(&S->grid) * 3);
    double best = INFINITY;
    CHECK(rec_frame_alone(S, &s->rig, &p, pool, &f, NULL));
    for (int r = 0; r < 3; r++) {
        expose(s, way, noise, S->binning, f);
        int64_t t0 = pvx_now_mono();
        rec_frame_carve(f);
        CHECK(rec_frame_solve(f, 0, NULL));
        best = fmin(best, ms(pvx_now_mono() - t0));
    }
    rec_frame_volume(f, &v);
    rec_sparse_to_dense(&v, dense);
    struct quality q = judge(s, dense, pool);
    const struct rec_frame_report *r = rec_frame_get_report(f);
    bench_row(csv, "%s,%s,%s,%.3f,%s,%.6f,%.4f,%.3f,%.5f,%d,%u,%.3f", flames[kind].name,
              flames[kind].use, rec_basis_name(S->grid.basis), noise, way_name[way], q.volume,
              q.view, q.psnr, q.ssim, (int)r->active_voxels, r->solve.iterations, best);
    rec_frame_free(&f);
    free(dense);
}

static void flame(enum flame_kind kind, pvx_pool *pool)
{
    static const double noise[] = {0, 0.01, 0.03};
    struct scene s;
    if (!scene_new(&s, kind, &views_8, size_64, flames[kind].t, pool))
        return;
    for (int basis = REC_BOX; basis <= REC_TRILINEAR; basis++) {
        rec_sysmat *S[3] = {NULL}; /* by binning */
        scene_truth(&s, (enum rec_basis)basis, pool);
        for (int b = 1; b <= 2; b++) {
            struct rec_sysmat_params p = {.binning = b, .rays_per_bin = 2};
            CHECK(rec_sysmat_build(&s.rig, &p, pool, NULL, NULL, &S[b], NULL));
        }
        for (size_t k = 0; k < sizeof noise / sizeof *noise; k++)
            for (int way = 0; way < N_WAYS; way++)
                measure(&s, kind, S[way >= BINNED ? 2 : 1], (enum way)way, noise[k], pool);
        rec_sysmat_free(&S[1]);
        rec_sysmat_free(&S[2]);
    }
    scene_fini(&s);
}

int main(int argc, char **argv)
{
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    printf("\nBayer pixels, 8 x %dx%d, 12 bits, voxels 1/64, %u threads: volume error, unseen view "
           "(mean absolute of 255, PSNR, SSIM), voxels of the hull, time of carve and solve\n",
           W, H, pvx_pool_threads(pool));
    csv = bench_csv(argc, argv, "bayer",
                    "scene,use,basis,noise,way,volume,view,psnr,ssim,voxels,iterations,ms");
    static const enum flame_kind kinds[] = {FLAME_RING, FLAME_CAMPFIRE, FLAME_RAGGED, FLAME_JET,
                                            FLAME_SHEETS};
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++)
        flame(kinds[k], pool);
    fclose(csv);
    pvx_pool_free(&pool);
    return *bench_status();
}
