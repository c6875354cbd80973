/* bench_rigs.c - harder rigs and flames: fewer cameras, cameras on an arc, a flame full of holes. */
#include "curve.h"

static const struct view_set rigs[] = {
    {"8 on a ring", 9, 8, 4, {0, 1, 2, 3, 5, 6, 7, 8}},
    {"5 on a ring", 10, 5, 5, {0, 2, 4, 6, 8}},
    {"4 on a ring", 8, 4, 3, {0, 2, 4, 6}},
    {"8 on 120 deg", 21, 8, 9, {0, 1, 2, 3, 4, 5, 6, 7}}, /* judged 30 degrees outside */
    {"5 on 120 deg", 12, 5, 5, {0, 1, 2, 3, 4}},
};

int main(int argc, char **argv)
{
    static const enum flame_kind kinds[] = {FLAME_RING, FLAME_CAMPFIRE, FLAME_GAUSS40,
                                            FLAME_RAGGED};
    const char *const *names = rec_solver_names();
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    FILE *csv = bench_csv(argc, argv, "rigs");
    fprintf(csv, "rig,scene,basis,solver,voxels,entries,iterations,ms,volume,view,psnr,ssim\n");
    printf(
        "\nharder rigs, 160x120, voxels 1/64, 1 %% noise, %u threads, default stops (cgls-paper: "
        "its best budget, knowing the truth)\n"
        "  rig          flame     basis      voxels entries |",
        pvx_pool_threads(pool));
    for (int k = 0; names[k] != NULL; k++)
        printf(" %-11s ", names[k]);
    printf("(volume error / view error of 255)\n");
    for (size_t r = 0; r < sizeof rigs / sizeof *rigs; r++)
        for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++) {
            struct scene s;
            struct shot shot;
            if (!scene_new(&s, kinds[k], &rigs[r], 160, 120, 64, kinds[k] == FLAME_RING ? 0.3 : 6,
                           pool))
                continue;
            shot_new(&shot, &s, &noise_1, 1);
            for (int basis = REC_BOX; basis <= REC_TRILINEAR; basis++) {
                scene_truth(&s, (enum rec_basis)basis, pool);
                rec_sysmat *S = scene_matrix(&s, 2, pool, NULL);
                struct course c = {.scene = &s, .shot = &shot, .n = 1, .S = S, .pool = pool};
                course_base(&c);
                for (int n = 0; names[n] != NULL; n++) {
                    struct setting set = {.solver = names[n], .look = true, .once = true};
                    struct point best = {.q.volume = INFINITY};
                    if (strcmp(names[n], "cgls-paper") == 0) {
                        set.stop = REC_STOP_ITERATIONS;
                        for (set.iterations = 3; set.iterations <= 12; set.iterations++) {
                            struct point p = measure(&c, &set);
                            if (p.q.volume > best.q.volume)
                                break;
                            best = p;
                        }
                    } else {
                        best = measure(&c, &set);
                    }
                    if (n == 0)
                        printf("  %-12s %-9s %-9s %7lld %6.2fM |", rigs[r].name,
                               flame_name(kinds[k]), rec_basis_name(S->grid.basis),
                               (long long)best.report.active_voxels,
                               (double)best.report.entries * 1e-6);
                    printf(" %5.3f %5.3f ", best.q.volume, best.q.view);
                    fprintf(csv, "%s,%s,%s,%s,%lld,%llu,%.0f,%.4f,%.6f,%.4f,%.3f,%.5f\n",
                            rigs[r].name, flame_name(kinds[k]), rec_basis_name(S->grid.basis),
                            names[n], (long long)best.report.active_voxels,
                            (unsigned long long)best.report.entries, best.iterations, best.ms,
                            best.q.volume, best.q.view, best.q.psnr, best.q.ssim);
                }
                putchar('\n');
                fflush(stdout);
                rec_sysmat_free(&S);
            }
            shot_free(&shot);
            scene_fini(&s);
        }
    fclose(csv);
    pvx_pool_free(&pool);
    return 0;
}
