/* fit.c - random cases for the weight of the smoothness term: what is measured in the pictures, and the
 * error at each weight of a sweep.  fit.py finds the exponents of (1) in recon/solve/lambda.c from it.
 *
 *     fit FOLDER [CASES]      writes FOLDER/fit.csv
 *
 * Two cases of three show a flame that may be fitted on (ring, campfire), the third one that is held out:
 * those only judge.  One channel, box of one metre, all else by chance: the instant, 32..96 voxels high,
 * pictures 1.5..5 times as wide, 3..12 cameras, noise 0..20 % of the peak, basis, 1 or 2x2 rays.
 * The case number is the seed: a case is the same in every run. */
#include "recon/frame/inside.h"
#include "tests/bench/shot.h"
#include "tests/lib/entries.h"

#define ITERATIONS 60 /* nothing moves any more */
#define SWEEP      11 /* weights 10^-3 .. 10^2, in half decades */

struct random_case {
    enum flame_kind kind;
    int cameras, rays, channel;
    int32_t size[3];
    double t, noise;
    enum rec_basis basis;
};

/* The quantities of lambda.c, worked out once more, plainly. */
struct features {
    double noise, rough, chord, density, mean_diag;
};

static double between(double lo, double hi)
{
    return lo + (hi - lo) * bench_even();
}

static struct random_case draw(int number)
{
    static const enum flame_kind fit_on[] = {FLAME_RING, FLAME_CAMPFIRE};
    static const enum flame_kind held_out[] = {FLAME_JET,    FLAME_HOLLOW, FLAME_CANDLES,
                                               FLAME_SHEETS, FLAME_WALL,   FLAME_SHELL};
    struct random_case c;
    bench_seed((uint64_t)number);
    c.kind = number % 3 < 2 ? fit_on[number % 3] : held_out[number / 3 % 6];
    c.t =
        c.kind == FLAME_RING ? between(0, 2) : floor(between(0, c.kind == FLAME_CAMPFIRE ? 12 : 6));
    c.size[2] = 8 * (int32_t)between(4, 13);
    c.size[0] = (int32_t)fmin(320, c.size[2] * between(1.5, 5)) / 4 * 4;
    c.size[1] = c.size[0] / 4 * 3;
    c.cameras = (int)between(3, 13);
    c.noise = bench_even() < 0.15 ? 0 : exp(between(log(0.002), log(0.2)));
    c.basis = bench_even() < 0.5 ? REC_BOX : REC_TRILINEAR;
    c.rays = bench_even() < 0.5 ? 1 : 2;
    c.channel = (int)between(0, 3);
    return c;
}

/* Everything but the chosen channel goes. */
static void keep_one(float *v, size_t n, int channel)
{
    for (size_t i = 0; i < n; i++)
        v[i] = v[i * 3 + (size_t)channel];
}

static double mean2x2(const float *p, size_t bw)
{
    return 0.25 * ((double)p[0] + p[1] + p[bw] + p[bw + 1]);
}

static struct features measure_features(const rec_frame *f)
{
    const struct rec_subsys *a = rec_frame_subsys(f);
    const float *b = rec_frame_rhs(f);
    const struct rec_grid *g = &a->S->grid;
    double sigma = rec_frame_get_report(f)->sigma, s2 = sigma * sigma;
    double light = 0, first = 0, second = 0, blocks = 0,
           h = cbrt(rec_grid_h(g, 0) * rec_grid_h(g, 1) * rec_grid_h(g, 2));
    size_t c = 0;
    uint32_t *row = rows_of_system(a);
    for (int32_t i = 0; i < a->rows; i++) {
        while (row[i] >= a->row0[c + 1])
            c++;
        size_t bw = (size_t)a->S->block[c].bw, bh = (size_t)a->S->block[c].bh;
        size_t r = row[i] - a->row0[c], y = r / bw, x = r % bw;
        const float *p = b + row[i];
        light += *p;
        if (x % 2 != 0 || y % 2 != 0 || x < 2 || y < 2 || x + 3 >= bw || y + 3 >= bh)
            continue;
        double v = mean2x2(p, bw), right = mean2x2(p + 2, bw), down = mean2x2(p + 2 * bw, bw);
        double lap = 4 * v - right - down - mean2x2(p - 2, bw) - mean2x2(p - 2 * bw, bw);
        first += (right - v) * (right - v) + (down - v) * (down - v);
        second += lap * lap;
        blocks++;
    }
    free(row);
    double mean2 = pow(light / a->rows, 2);
    double g1 = fmax(first / blocks - s2, 0) / 4;
    double g2 = fmax(second / blocks - 5 * s2, 1e-3 * second / blocks) / 16;
    struct features q = {.noise = fmax((s2 + 0.03 * g1) / mean2, 1e-9),
                         .rough = fmax(g2 / mean2, 1e-9),
                         .chord = a->sum / a->rows / h,
                         .mean_diag = a->sum2 / a->n};
    q.density = q.mean_diag / (h * h);
    return q;
}

/* Error with the weight that f has, and in *used what it was. */
static double error_at(const struct scene *s, rec_frame *f, float *dense, double *used)
{
    struct rec_sparse v;
    CHECK(rec_frame_solve(f, 0, NULL));
    rec_frame_volume(f, &v);
    rec_sparse_to_dense(&v, dense);
    *used = rec_frame_get_report(f)->solve.lambda;
    return rec_rel_l2(dense, s->truth, rec_grid_count(&s->rig.grid));
}

static void fill(const struct scene *s, double noise, uint64_t seed, rec_frame *f)
{
    bench_seed(seed);
    scene_fill(s, f, noise);
    rec_frame_carve(f);
}

static void run(FILE *csv, int number, pvx_pool *pool)
{
    struct random_case c = draw(number);
    struct view_set views = {.ring = (size_t)c.cameras + 1, .n = (size_t)c.cameras, .judge = 1};
    struct scene s;
    rec_frame *f;
    double used;
    for (int i = 0; i < c.cameras; i++)
        views.use[i] = (uint8_t)(i < 1 ? i : i + 1);
    if (!scene_new(&s, c.kind, &views, c.size, c.t, pool))
        return;
    scene_truth(&s, c.basis, pool);
    keep_one(s.truth, rec_grid_count(&s.rig.grid), c.channel);
    s.peak = 0;
    for (size_t k = 0; k < s.rig.n_cameras; k++) {
        keep_one(s.image[k], (size_t)c.size[0] * (size_t)c.size[1], c.channel);
        for (int i = 0; i < c.size[0] * c.size[1]; i++)
            s.peak = fmax(s.peak, s.image[k][i]);
    }
    s.nch = 1;
    rec_sysmat *S = scene_matrix(&s, c.rays, pool);
    float *dense = must_floats(rec_grid_count(&S->grid));
    struct rec_frame_params p = rec_frame_defaults;
    p.nch = 1;
    p.photo.saturation = 1e30f;
    p.solve.stop = REC_STOP_ITERATIONS;
    p.solve.iterations = 1;
    p.coarse_start = false; /* whose misfit would count */
    CHECK(rec_frame_alone(S, &s.rig, &p, pool, &f, NULL));
    fill(&s, c.noise, (uint64_t)number, f);
    (void)error_at(&s, f, dense, &used);
    struct features q = measure_features(f);
    rec_frame_free(&f);
    fprintf(csv, "%s,%s,%.2f,%d,%d,%d,%.4f,%s,%d,%.6g,%.6g,%.6g,%.6g,%.6g", flames[c.kind].name,
            flames[c.kind].use, c.t, c.size[2], c.size[0], c.cameras, c.noise,
            rec_basis_name(c.basis), c.rays, q.noise, q.rough, q.chord, q.density,
            used / q.mean_diag);
    p.coarse_start = true;
    p.solve.iterations = ITERATIONS;
    for (int k = -1; k < SWEEP; k++) { /* the automatic one first */
        p.solve.lambda = k < 0 ? -1 : (float)pow(10, -3 + 0.5 * k);
        CHECK(rec_frame_alone(S, &s.rig, &p, pool, &f, NULL));
        fill(&s, c.noise, (uint64_t)number, f);
        fprintf(csv, ",%.6f", error_at(&s, f, dense, &used));
        rec_frame_free(&f);
    }
    fprintf(csv, "\n");
    fflush(csv);
    free(dense);
    rec_sysmat_free(&S);
    scene_fini(&s);
}

int main(int argc, char **argv)
{
    pvx_pool *pool;
    CHECK(pvx_pool_new(0, "fit", &pool));
    int cases = argc > 2 ? atoi(argv[2]) : 102;
    char head[400] = "flame,use,t,voxels,width,cameras,noise,basis,rays,N,R,K,d,code,auto";
    for (int k = 0; k < SWEEP; k++) {
        size_t n = strlen(head);
        snprintf(head + n, sizeof head - n, ",%g", pow(10, -3 + 0.5 * k));
    }
    FILE *csv = bench_csv(argc, argv, "fit", head);
    for (int i = 0; i < cases; i++) {
        run(csv, i, pool);
        if (i % 10 == 9)
            printf("%d of %d cases\n", i + 1, cases);
        fflush(stdout);
    }
    fclose(csv);
    pvx_pool_free(&pool);
    return *bench_status();
}
