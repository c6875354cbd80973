/* bench_model.c - the imaging model: 1 to 3 rays per bin side where the pixels of the pictures are
 * area means.  What each buys in error, what it costs in entries and time. */
#include "curve.h"

static void model(FILE *csv, enum flame_kind kind, int binned, pvx_pool *pool)
{
    struct scene s;
    struct shot shot;
    /* binned: pictures with half the pixels across, so that a bin is wider than a voxel */
    const int32_t size[3] = {160 / binned, 120 / binned, 64};
    if (!scene_new(&s, kind, &views_8, size, flames[kind].t, pool))
        return;
    shot_new(&shot, &s, &noise_1, 1);
    for (int basis = REC_BOX; basis <= REC_TRILINEAR; basis++) {
        scene_truth(&s, (enum rec_basis)basis, pool);
        for (int rays = 1; rays <= 3; rays++) {
            double build_s;
            rec_sysmat *S = scene_matrix(&s, rays, pool, &build_s);
            struct course c = {.scene = &s, .shot = &shot, .n = 1, .S = S, .pool = pool};
            course_base(&c);
            struct setting set = {.solver = rec_solver_names()[0], .look = true};
            struct point p = measure(&c, &set);
            bench_row(csv, "%s,%s,%d,%d,%s,%d,%.6f,%.4f,%.3f,%llu,%llu,%.4f,%.4f,%.0f",
                      flames[kind].name, flames[kind].use, size[0], size[1],
                      rec_basis_name(S->grid.basis), rays, p.q.volume, p.q.view, p.q.psnr,
                      (unsigned long long)S->nnz, (unsigned long long)p.report.entries, build_s,
                      p.ms, p.iterations);
            rec_sysmat_free(&S);
        }
    }
    shot_free(&shot);
    scene_fini(&s);
}

int main(int argc, char **argv)
{
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    printf("\nimaging model, 8 cameras, voxels 1/64, 1 %% noise, %s, %u threads\n",
           rec_solver_names()[0], pvx_pool_threads(pool));
    FILE *csv = bench_csv(argc, argv, "model",
                          "scene,use,width,height,basis,rays,volume,view,psnr,nnz,entries,build_s,"
                          "solve_ms,iterations");
    model(csv, FLAME_RING, 1, pool);
    model(csv, FLAME_RING, 2, pool);
    model(csv, FLAME_CAMPFIRE, 1, pool);
    model(csv, FLAME_SHELL, 1, pool);
    model(csv, FLAME_JET, 1, pool);
    model(csv, FLAME_CANDLES, 1, pool);
    model(csv, FLAME_SHEETS, 1, pool);
    model(csv, FLAME_POOL, 1, pool);
    fclose(csv);
    pvx_pool_free(&pool);
    return *bench_status();
}
