/* bench_products.c - one A x and one A^T y on the restricted system against the time that reading its
 * windows for each would take.
 *
 *     bound = (windows twice + x, and y on A's blocks, once) / bandwidth
 *     bandwidth: plain reading of a buffer as large as the windows, the same threads, the same run,
 *                turn by turn with the products, so that both live in the same cache level
 * Times are the shortest of all turns. */
#include "shot.h"
#include "tests/lib/product.h"
#include "recon/frame/inside.h"

/* ---- reading ------------------------------------------------------------------------------------ */

#define TASKS 256 /* as many as the products' chunks at most */

typedef uint64_t wide __attribute__((vector_size(64)));

struct reading {
    const wide *at;
    size_t n; /* of 64 bytes */
    wide sum[TASKS];
    void (*sweep)(const wide *at, size_t n, wide *sum);
};

/* Eight sums, so that no load waits for an addition. */
static inline __attribute__((always_inline)) void sweep(const wide *at, size_t n, wide *out)
{
    wide s[8] = {{0}};
    size_t i = 0;
    for (; i + 8 <= n; i += 8)
        for (size_t k = 0; k < 8; k++)
            s[k] += at[i + k];
    for (; i < n; i++)
        s[0] += at[i];
    for (size_t k = 1; k < 8; k++)
        s[0] += s[k];
    *out = s[0];
}

static void sweep_plain(const wide *at, size_t n, wide *out)
{
    sweep(at, n, out);
}
#if defined(__x86_64__)
__attribute__((target("avx2"))) static void sweep_avx2(const wide *at, size_t n, wide *out)
{
    sweep(at, n, out);
}
__attribute__((target("avx512f"))) static void sweep_avx512(const wide *at, size_t n, wide *out)
{
    sweep(at, n, out);
}
#endif

static void read_task(void *ctx, size_t i)
{
    struct reading *r = ctx;
    size_t from = r->n * i / TASKS, to = r->n * (i + 1) / TASKS;
    r->sweep(r->at + from, to - from, &r->sum[i]);
}

/* ---- products ----------------------------------------------------------------------------------- */

static FILE *csv;

/* Positive values: denormals and zeros would be another measurement. */
static float *values(size_t n)
{
    float *v = must_floats(n);
    for (size_t i = 0; i < n; i++)
        v[i] = (float)bench_even();
    return v;
}

static void products(const struct scene *s, const rec_sysmat *S, int nch, unsigned threads,
                     enum pvx_cpu level)
{
    struct rec_frame_params p = rec_frame_defaults;
    struct rec_kernels kernels;
    struct rec_subsys *a;
    rec_frame *f;
    pvx_pool *pool;
    bool present[REC_MAX_CAMERAS];
    rec_kernels_init(&kernels, level);
    CHECK(pvx_pool_new(threads, "bench", &pool));
    p.photo.saturation = 1e30f;
    CHECK(rec_frame_alone(S, &s->rig, &p, pool, &f, NULL));
    bench_seed(1);
    scene_fill(s, f, 0.01);
    rec_frame_carve(f);
    const struct rec_subsys *carved = rec_frame_subsys(f);
    int cs = nch == 3 ? 4 : 1;
    for (size_t c = 0; c < S->n_cameras; c++)
        present[c] = true;
    CHECK(rec_subsys_new(S, &kernels, pool, cs, &a));
    rec_subsys_restrict(a, f->carver->restrictor, carved->col, carved->n, present);

    size_t nx = (size_t)a->n * (size_t)cs, ny = (size_t)a->win.room * (size_t)cs;
    size_t nowhere = (size_t)a->win.nowhere * (size_t)cs;
    float *x = values(nx), *y = values(ny), *x_out = must_floats(nx), *y_out = must_floats(ny);
    memset(y + nowhere, 0, (ny - nowhere) * sizeof *y);
    struct rec_images images;
    CHECK(rec_images_new(S, cs, &images));
    double windows = bytes_of_windows(a);
    double bytes =
        2 * windows + ((double)nx + (double)a->n_blocks * REC_ROW_BLOCK * cs) * sizeof *x;
    static struct reading r;
    r.n = (size_t)windows / sizeof(wide) + 1;
    wide *buffer = pvx_calloc(r.n, sizeof(wide));
    if (buffer == NULL)
        CHECK(PVX_ENOMEM);
    memset(buffer, 1, r.n * sizeof(wide)); /* pages of its own, not the zero page */
    r.at = buffer;
    r.sweep = sweep_plain;
#if defined(__x86_64__)
    if (pvx_cpu_have() >= PVX_CPU_AVX2)
        r.sweep = sweep_avx2;
    if (pvx_cpu_have() >= PVX_CPU_AVX512)
        r.sweep = sweep_avx512;
#endif

    /* Blocks of turns, because two working sets that take turns one by one evict each other. */
    double best[3] = {1e300, 1e300, 1e300}; /* A, A^T, reading; ms */
    double pair = 1e300, spent = 0;
    for (int block = 0; block < 8 && (block < 2 || spent < 700); block++) {
        for (int turn = 0; turn < 6; turn++) {
            int64_t t0 = pvx_now_mono();
            rec_forward(a, &images, x, y_out);
            int64_t t1 = pvx_now_mono();
            product_aty(a, y, x_out);
            int64_t t2 = pvx_now_mono();
            best[0] = fmin(best[0], ms(t1 - t0));
            best[1] = fmin(best[1], ms(t2 - t1));
            pair = fmin(pair, ms(t2 - t0));
            spent += ms(t2 - t0);
        }
        for (int turn = 0; turn < 6; turn++) {
            int64_t t0 = pvx_now_mono();
            pvx_pool_run(pool, TASKS, read_task, &r);
            best[2] = fmin(best[2], ms(pvx_now_mono() - t0));
            spent += ms(pvx_now_mono() - t0);
        }
    }
    double rate = (double)r.n * sizeof(wide) / (best[2] * 1e-3), bound = bytes / rate * 1e3;
    bench_row(csv, "%d,%s,%d,%u,%s,%llu,%.0f,%.4g,%.5f,%.5f,%.5f,%.5f,%.3f", S->grid.n[2],
              rec_basis_name(S->grid.basis), nch, threads, pvx_cpu_name(level),
              (unsigned long long)a->nnz, bytes, rate, best[0], best[1], pair, bound, pair / bound);
    free(buffer);
    free(x);
    free(y);
    free(x_out);
    free(y_out);
    rec_images_free(&images);
    rec_subsys_free(&a);
    rec_frame_free(&f);
    pvx_pool_free(&pool);
}

static void all(const int32_t size[3], enum rec_basis basis)
{
    struct scene s;
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    scene_flame(&s, size, basis, pool);
    rec_sysmat *S = scene_matrix(&s, 1, pool);
    pvx_pool_free(&pool);
    for (unsigned threads = 1; threads <= 2; threads++)
        for (int v = PVX_CPU_REF; v <= (int)pvx_cpu(); v++) {
            products(&s, S, 3, threads, (enum pvx_cpu)v);
            if (threads == 2)
                products(&s, S, 1, threads, (enum pvx_cpu)v);
        }
    rec_sysmat_free(&S);
    scene_fini(&s);
}

int main(int argc, char **argv)
{
    static const int32_t size_128[3] = {320, 240, 128};
    printf("\none A and one A^T of the restricted system, ring, 1 ray per pixel; ratio to reach 2, "
           "aim 1.3\n");
    csv =
        bench_csv(argc, argv, "products",
                  "voxels,basis,channels,threads,kernels,entries,bytes,read_bytes_per_s,a_ms,at_ms,"
                  "pair_ms,bound_ms,ratio");
    all(size_64, REC_BOX);
    all(size_64, REC_TRILINEAR);
    all(size_128, REC_BOX);
    all(size_128, REC_TRILINEAR);
    fclose(csv);
    return 0;
}
