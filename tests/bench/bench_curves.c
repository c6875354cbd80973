/* bench_curves.c - error against time for the flames of the picture (plot.py), 1 % noise. */
#include "curve.h"

static FILE *curves;

/* What a row is about. */
struct about {
    const struct flame *flame;
    const rec_sysmat *S;
    const char *solver;
};

static void csv_row(const struct about *a, const char *stop, const struct point *p)
{
    bench_row(curves, "%s,%s,%d,%s,%s,%s,%s,%.1f,%.4f,%.6f,%.4f,%.3f,%.5f,%s", a->flame->name,
              a->flame->use, a->S->grid.n[2], rec_basis_name(a->S->grid.basis), noise_1.name,
              a->solver, stop, p->iterations, p->ms, p->q.volume, p->q.view, p->q.psnr, p->q.ssim,
              rec_status_name(p->status));
}

/* All solvers on one scene in one basis. */
static void all_solvers(const struct scene *s, const struct flame *flame, const rec_sysmat *S,
                        pvx_pool *pool)
{
    const char *const *names = rec_solver_names();
    static struct curve curve;
    struct shot shot;
    struct course c = {.scene = s, .shot = &shot, .n = 1, .S = S, .pool = pool};
    shot_new(&shot, s, &noise_1, 1);
    course_base(&c);
    for (int k = 0; names[k] != NULL; k++) {
        struct about about = {flame, S, names[k]};
        struct setting set = {.solver = names[k], .stop = REC_STOP_AUTO, .look = true};
        struct point p = measure(&c, &set);
        curve_measure(&c, &set, 100, 400, &curve);
        if (k == 0) /* what it gives when it is stopped early */
            curve_deadlines(&c, &set, p.ms, &curve);
        for (int i = 0; i < curve.n; i++)
            csv_row(&about, curve.k[i] > 0 ? "budget" : "deadline", &curve.at[i]);
        csv_row(&about, "auto", &p);
    }
    shot_free(&shot);
}

int main(int argc, char **argv)
{
    /* two of them held out */
    static const enum flame_kind picture[] = {FLAME_RING, FLAME_CAMPFIRE, FLAME_JET, FLAME_SHEETS};
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    printf(
        "\nerror against time, voxels 1/64, 8 x 160x120, %u threads, 2x2 rays per pixel; auto: as "
        "returned with the default stop\n",
        pvx_pool_threads(pool));
    curves = bench_csv(
        argc, argv, "curves",
        "scene,use,voxels,basis,noise,solver,stop,iterations,ms,volume,view,psnr,ssim,status");
    for (size_t i = 0; i < sizeof picture / sizeof *picture; i++) {
        const struct flame *f = &flames[picture[i]];
        struct scene s;
        if (!scene_new(&s, picture[i], &views_8, size_64, f->t, pool))
            continue;
        for (int basis = REC_BOX; basis <= REC_TRILINEAR; basis++) {
            scene_truth(&s, (enum rec_basis)basis, pool);
            rec_sysmat *S = scene_matrix(&s, 2, pool, NULL);
            all_solvers(&s, f, S, pool);
            rec_sysmat_free(&S);
        }
        scene_fini(&s);
    }
    fclose(curves);
    pvx_pool_free(&pool);
    return *bench_status();
}
