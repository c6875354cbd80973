/* bench_hull.c - the restricted solve against the full one: same data, same solver, same threads.
 * Targets: at least 10 times faster, less than half the error. */
#include "bench.h"

struct outcome {
    double solve_ms;
    struct quality q;
    int64_t voxels;
    uint32_t iterations;
};

static struct outcome solve(const struct scene *s, const rec_sysmat *S, const char *solver,
                            enum rec_stop stop, uint32_t iterations, bool hull, pvx_pool *pool)
{
    struct rec_frame_params p = rec_frame_defaults;
    p.photo.saturation = 1e30f;
    p.solve.solver = solver;
    p.solve.stop = stop;
    p.solve.iterations = iterations;
    if (!hull) { /* everything is flame */
        p.photo.threshold = 0;
        p.photo.margin = 16;
        p.hull.min_views = 1;
    }
    rec_frame *f;
    CHECK(rec_frame_alone(S, &s->rig, &p, pool, &f, NULL));
    struct outcome o = {.solve_ms = 1e300};
    struct rec_sparse v;
    float *dense = must_floats(rec_grid_count(&S->grid) * 3);
    for (int r = 0; r < (hull ? 5 : 2); r++) {
        scene_fill(s, f, 0.01);
        rec_frame_carve(f);
        CHECK(rec_frame_solve(f, 0, NULL));
        o.solve_ms = fmin(o.solve_ms, ms(rec_frame_get_report(f)->solve_ns));
    }
    rec_frame_volume(f, &v);
    rec_sparse_to_dense(&v, dense);
    o.q = judge(s, dense, pool);
    o.voxels = rec_frame_get_report(f)->active_voxels;
    o.iterations = rec_frame_get_report(f)->solve.iterations;
    free(dense);
    rec_frame_free(&f);
    return o;
}

int main(int argc, char **argv)
{
    pvx_pool *pool;
    struct scene s;
    rec_sysmat *S;
    CHECK(pvx_pool_new(2, "bench", &pool));
    scene_flame(&s, size_64, REC_BOX, pool);
    struct rec_sysmat_params mp = {.binning = 1, .rays_per_bin = 1};
    CHECK(rec_sysmat_build(&s.rig, &mp, pool, NULL, NULL, &S, NULL));
    printf("\nrestricted against full solve, 64^3 from 8 x 160x120 RGB, 1 %% noise, 2 threads\n");
    FILE *csv = bench_csv(argc, argv, "hull",
                          "solver,stop,hull,voxels,ms,iterations,volume,view,psnr,ssim");
    static const struct {
        const char *solver, *stop;
        enum rec_stop rule;
        uint32_t iterations;
    } cases[] = {{"cgls-paper", "8 iterations", REC_STOP_ITERATIONS, 8},
                 {"cgls-paper", "L-curve", REC_STOP_LCURVE, 0},
                 {"mlem", "20 iterations", REC_STOP_ITERATIONS, 20},
                 {"pcg", "20 iterations", REC_STOP_ITERATIONS, 20},
                 {"pcg", "auto", REC_STOP_AUTO, 0}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++)
        for (int hull = 1; hull >= 0; hull--) {
            struct outcome o =
                solve(&s, S, cases[i].solver, cases[i].rule, cases[i].iterations, hull, pool);
            bench_row(csv, "%s,%s,%d,%lld,%.3f,%u,%.5f,%.4f,%.3f,%.5f", cases[i].solver,
                      cases[i].stop, hull, (long long)o.voxels, o.solve_ms, o.iterations,
                      o.q.volume, o.q.view, o.q.psnr, o.q.ssim);
        }
    fclose(csv);
    rec_sysmat_free(&S);
    scene_fini(&s);
    pvx_pool_free(&pool);
    return 0;
}
