/* bench_error.c - error against time: every solver, both bases, three flames, noise to 5 % and 8-bit
 * cameras; what each solver returns by itself; the default solver over grid sizes. */
#include "curve.h"

#define MAX_SOLVERS 16

static FILE *table, *curves;

static void csv_row(FILE *f, const char *scene, int voxels, enum rec_basis b, const char *noise,
                    const char *solver, const char *stop, const struct point *p)
{
    fprintf(f, "%s,%d,%s,%s,%s,%s,%.1f,%.4f,%.6f,%.4f,%.3f,%.5f,%s\n", scene, voxels,
            rec_basis_name(b), noise, solver, stop, p->iterations, p->ms, p->q.volume, p->q.view,
            p->q.psnr, p->q.ssim, rec_status_name(p->status));
}

/* Is solver s ever ahead of the default d?  Says up to when, and whose best iterate is better. */
static void compare(const char *name, const struct curve *s, const char *d_name,
                    const struct curve *d)
{
    int last = -1;
    for (int i = 0; i < s->n; i++) {
        int by = curve_by(d, s->at[i].ms);
        if (by < 0 || s->at[i].q.volume < d->at[by].q.volume)
            last = last < 0 || s->at[i].ms > s->at[last].ms ? i : last;
    }
    const struct point *best = &s->at[s->best], *d_best = &d->at[d->best];
    if (last >= 0) {
        const struct point *p = &s->at[last];
        int by = curve_by(d, p->ms);
        printf("    %s is ahead of %s at times to %.2f ms: error %.3f against ", name, d_name,
               p->ms, p->q.volume);
        by < 0 ? printf("nothing yet\n") : printf("%.3f\n", d->at[by].q.volume);
    }
    if (best->q.volume < d_best->q.volume)
        printf("    %s has the better best iterate: %.3f after %.1f ms against %s's %.3f after "
               "%.1f ms\n",
               name, best->q.volume, best->ms, d_name, d_best->q.volume, d_best->ms);
}

/* All solvers on one scene, one basis, one noise; with_curves: every budget too. */
static void condition(const struct scene *s, const char *scene, const rec_sysmat *S,
                      const struct noise *noise, bool with_curves, pvx_pool *pool)
{
    const char *const *names = rec_solver_names();
    static struct curve curve[MAX_SOLVERS];
    struct shot shot;
    struct course c = {.scene = s, .shot = &shot, .n = 1, .S = S, .pool = pool};
    double lowest = INFINITY, first = 0;
    int winner = 0;
    shot_new(&shot, s, noise, 1);
    course_base(&c);
    for (int k = 0; names[k] != NULL && k < MAX_SOLVERS; k++) {
        printf("  %-9s %-9s %-9s %-11s", scene, rec_basis_name(S->grid.basis), noise->name,
               names[k]);
        struct setting set = {.solver = names[k], .stop = REC_STOP_AUTO, .look = true};
        struct point p = measure(&c, &set);
        if (with_curves) {
            struct curve *v = &curve[k];
            curve_measure(&c, &set, 100, 400, v);
            if (k == 0) /* what it gives when it is stopped early */
                curve_deadlines(&c, &set, p.ms, v);
            for (int i = 0; i < v->n; i++)
                csv_row(curves, scene, S->grid.n[2], S->grid.basis, noise->name, names[k],
                        v->k[i] > 0 ? "budget" : "deadline", &v->at[i]);
            csv_row(curves, scene, S->grid.n[2], S->grid.basis, noise->name, names[k], "auto", &p);
            printf(" %6.3f %4.0f %7.2f |", v->at[v->best].q.volume, v->at[v->best].iterations,
                   v->at[v->best].ms);
        } else {
            printf(" %6s %4s %7s |", "", "", "");
        }
        printf(" %6.3f %6.3f %5.1f %6.4f %4.0f %7.2f %s\n", p.q.volume, p.q.view, p.q.psnr,
               p.q.ssim, p.iterations, p.ms, rec_status_name(p.status));
        csv_row(table, scene, S->grid.n[2], S->grid.basis, noise->name, names[k], "auto", &p);
        if (p.q.volume < lowest) {
            lowest = p.q.volume;
            winner = k;
        }
        if (k == 0)
            first = p.q.volume;
        fflush(stdout);
    }
    if (winner != 0)
        printf("    %s returns the lowest error: %.3f, %s %.3f\n", names[winner], lowest, names[0],
               first);
    for (int k = 1; with_curves && names[k] != NULL && k < MAX_SOLVERS; k++)
        compare(names[k], &curve[k], names[0], &curve[0]);
    shot_free(&shot);
}

static void all_scenes(pvx_pool *pool)
{
    static const enum flame_kind kinds[] = {FLAME_RING, FLAME_CAMPFIRE, FLAME_GAUSS40};
    static const struct noise *const noise[] = {&noise_0, &noise_1, &noise_5, &noise_8bit};
    printf(
        "\nerror against time, voxels 1/64, 8 x 160x120, %u threads, 2x2 rays per pixel; left: "
        "best of all budgets to 100, right: as returned with the default stop\n"
        "  scene     basis     noise     solver       volume   it      ms | volume   view  PSNR   "
        "SSIM   it      ms\n",
        pvx_pool_threads(pool));
    for (size_t k = 0; k < sizeof kinds / sizeof *kinds; k++) {
        struct scene s;
        if (!scene_new(&s, kinds[k], &views_8, 160, 120, 64, kinds[k] == FLAME_RING ? 0.3 : 6,
                       pool))
            continue;
        for (int basis = REC_BOX; basis <= REC_TRILINEAR; basis++) {
            scene_truth(&s, (enum rec_basis)basis, pool);
            rec_sysmat *S = scene_matrix(&s, 2, pool, NULL);
            for (size_t n = 0; n < sizeof noise / sizeof *noise; n++)
                condition(&s, flame_name(kinds[k]), S, noise[n], noise[n] == &noise_1, pool);
            rec_sysmat_free(&S);
        }
        if (kinds[k] == FLAME_GAUSS40)
            printf(
                "    peers on another flame of this kind, 1 %% noise, a like machine (ms, volume "
                "error): CGLS and clip on the hull, box 9, 0.192; MLEM on the hull, box 17, "
                "0.130, trilinear 40, 0.105; best CPU toolbox with masks 920, 0.104\n");
        scene_fini(&s);
    }
}

static void all_sizes(pvx_pool *pool)
{
    static const int sizes[] = {32, 48, 64, 72, 96, 128};
    struct scene s;
    struct shot shot;
    printf("\nring over grid sizes, %s, 1 %% noise, 1 ray per pixel\n"
           "  voxels basis     volume   view  PSNR   SSIM   it      ms\n",
           rec_solver_names()[0]);
    if (!scene_new(&s, FLAME_RING, &views_8, 160, 120, 64, 0.3, pool))
        return;
    shot_new(&shot, &s, &noise_1, 1);
    for (int basis = REC_BOX; basis <= REC_TRILINEAR; basis++)
        for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
            s.rig.grid.n[0] = s.rig.grid.n[1] = s.rig.grid.n[2] = sizes[i];
            scene_truth(&s, (enum rec_basis)basis, pool);
            rec_sysmat *S = scene_matrix(&s, 1, pool, NULL);
            struct course c = {.scene = &s, .shot = &shot, .n = 1, .S = S, .pool = pool};
            course_base(&c);
            struct setting set = {.solver = rec_solver_names()[0], .look = true};
            struct point p = measure(&c, &set);
            printf("  %4d^3 %-9s %6.3f %6.3f %5.1f %6.4f %4.0f %7.2f\n", sizes[i],
                   rec_basis_name(S->grid.basis), p.q.volume, p.q.view, p.q.psnr, p.q.ssim,
                   p.iterations, p.ms);
            csv_row(table, "ring", sizes[i], S->grid.basis, noise_1.name, set.solver, "auto", &p);
            rec_sysmat_free(&S);
            fflush(stdout);
        }
    shot_free(&shot);
    scene_fini(&s);
}

int main(int argc, char **argv)
{
    static const char head[] =
        "scene,voxels,basis,noise,solver,stop,iterations,ms,volume,view,psnr,ssim,status\n";
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    table = bench_csv(argc, argv, "error");
    curves = bench_csv(argc, argv, "curves");
    fputs(head, table);
    fputs(head, curves);
    all_scenes(pool);
    all_sizes(pool);
    fclose(table);
    fclose(curves);
    pvx_pool_free(&pool);
    return 0;
}
