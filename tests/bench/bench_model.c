/* bench_model.c - the imaging model: 1 to 4 rays per bin side where the pixels of the pictures are
 * area means.  What each buys in error, what it costs in entries and time. */
#include "curve.h"

static void model(FILE *csv, const char *name, enum flame_kind kind, int binned, pvx_pool *pool)
{
    struct scene s;
    struct shot shot;
    /* binned: pictures with half the pixels across, so that a bin is wider than a voxel */
    if (!scene_new(&s, kind, &views_8, 160 / binned, 120 / binned, 64, kind == FLAME_RING ? 0.3 : 6,
                   pool))
        return;
    shot_new(&shot, &s, &noise_1, 1);
    for (int basis = REC_BOX; basis <= REC_TRILINEAR; basis++) {
        scene_truth(&s, (enum rec_basis)basis, pool);
        for (int rays = 1; rays <= 4; rays++) {
            double build_s;
            rec_sysmat *S = scene_matrix(&s, rays, pool, &build_s);
            struct course c = {.scene = &s, .shot = &shot, .n = 1, .S = S, .pool = pool};
            course_base(&c);
            struct setting set = {.solver = rec_solver_names()[0], .look = true};
            struct point p = measure(&c, &set);
            printf("  %-9s %3dx%-4d %-9s %dx%d %6.3f %6.3f %5.1f %8.2f %7.2f %7.2f %7.2f %4.0f\n",
                   name, 160 / binned, 120 / binned, rec_basis_name(S->grid.basis), rays, rays,
                   p.q.volume, p.q.view, p.q.psnr, (double)S->nnz * 1e-6,
                   (double)p.report.entries * 1e-6, build_s, p.ms, p.iterations);
            fprintf(csv, "%s,%d,%d,%s,%d,%.6f,%.4f,%.3f,%llu,%llu,%.4f,%.4f,%.0f\n", name,
                    160 / binned, 120 / binned, rec_basis_name(S->grid.basis), rays, p.q.volume,
                    p.q.view, p.q.psnr, (unsigned long long)S->nnz,
                    (unsigned long long)p.report.entries, build_s, p.ms, p.iterations);
            fflush(stdout);
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
    FILE *csv = bench_csv(argc, argv, "model");
    fprintf(csv, "scene,width,height,basis,rays,volume,view,psnr,nnz,entries,build_s,solve_ms,"
                 "iterations\n");
    printf("\nimaging model, 8 cameras, voxels 1/64, 1 %% noise, %s, %u threads\n"
           "  flame     pixels   basis     rays volume   view  PSNR      M nnz  on hull  build s  "
           "solve ms  it\n",
           rec_solver_names()[0], pvx_pool_threads(pool));
    model(csv, "ring", FLAME_RING, 1, pool);
    model(csv, "ring", FLAME_RING, 2, pool);
    model(csv, "campfire", FLAME_CAMPFIRE, 1, pool);
    fclose(csv);
    pvx_pool_free(&pool);
    return 0;
}
