/* bench_targets.c - what the reconstruction must reach against the paper's solver, side by side in one
 * run: error at equal time, time to equal error, and that more iterations do no harm.
 *
 * For every flame, basis and noise:
 *   T, E   time and volume error of cgls-paper's best iterate, chosen with the truth known
 *   volume error of the default solver at time T, over E                  reach 0.65   aim 0.45
 *   mean error of the unseen view at time T, over that of the same iterate      0.75       0.6
 *   time in which the default solver has error E, over T                        1/3       1/10
 *   its error after 1000 iterations, over that at its automatic stop            1.05       1.0
 * "At time T": of all iteration budgets and deadlines the last whole solve that takes T or less.
 * inf: nothing returned by then, or not reached within twice T. */
#include "curve.h"

enum { VOLUME, VIEW, TIME, LATE, N_TARGETS };
static const struct target {
    const char *key;
    double reach, aim;
} targets[N_TARGETS] = {
    {"volume", 0.65, 0.45},
    {"view", 0.75, 0.6},
    {"time", 1.0 / 3, 0.1},
    {"late", 1.05, 1.0},
};

static FILE *csv, *errors;

/* Measured values are compared as they are printed, to three digits. */
static const char *verdict(const struct target *t, double v)
{
    return v < t->aim + 5e-4 ? "aim" : v < t->reach + 5e-4 ? "reach" : "no";
}

/* The iterate of `budget`, with the unseen view. */
static struct point look_at(const struct course *c, const char *solver, uint32_t budget, bool warm)
{
    struct setting set = {.solver = solver,
                          .stop = REC_STOP_ITERATIONS,
                          .iterations = budget,
                          .warm = warm,
                          .look = true,
                          .once = true};
    return measure(c, &set);
}

static void condition(const struct flame *f, const struct noise *noise, const struct course *c)
{
    const char *const ours = rec_solver_names()[0];
    const char *basis = rec_basis_name(c->S->grid.basis);
    bool warm = c->n > 1; /* as the daemon does */
    const char *name = warm ? "moving" : f->name;
    static struct curve paper, mlem, own;
    curve_measure(c, &(struct setting){.solver = "cgls-paper"}, 32, 200, &paper);
    const struct point *best = &paper.at[paper.best];
    double T = best->ms, E = best->q.volume, v[N_TARGETS];
    curve_measure(c, &(struct setting){.solver = ours, .warm = warm}, 100, 2 * T, &own);
    curve_deadlines(c, &(struct setting){.solver = ours, .warm = warm, .look = true}, T, &own);
    curve_measure(c, &(struct setting){.solver = "mlem", .warm = warm}, 32, T, &mlem);

    int by = curve_by(&own, T), mlem_by = curve_by(&mlem, T);
    struct point view = look_at(c, "cgls-paper", paper.k[paper.best], false);
    struct point own_view = {0};
    if (by >= 0)
        own_view = own.k[by] > 0 ? look_at(c, ours, own.k[by], warm) : own.at[by];
    struct setting set = {.solver = ours, .stop = REC_STOP_AUTO, .warm = warm};
    struct point stop = measure(c, &set), late = {.q.volume = NAN};
    set = (struct setting){
        .solver = ours, .stop = REC_STOP_ITERATIONS, .iterations = 1000, .once = true};
    if (c->n == 1) /* a sequence is made of the same flames */
        late = measure(c, &set);

    v[VOLUME] = by >= 0 ? own.at[by].q.volume / E : INFINITY;
    v[VIEW] = by >= 0 ? own_view.q.view / view.q.view : INFINITY;
    v[TIME] = curve_reach(&own, E) / T;
    v[LATE] = late.q.volume / stop.q.volume;
    for (int i = 0; i < N_TARGETS; i++)
        if (!isnan(v[i]))
            bench_row(csv, "%s,%s,%s,%s,%s,%.4f,%.4f,%.4f,%s", targets[i].key, name, f->use, basis,
                      noise->name, v[i], targets[i].reach, targets[i].aim,
                      verdict(&targets[i], v[i]));
    bench_row(errors, "%s,%s,%s,%s,%.5f,%.3f,%.5f,%.3f", name, f->use, basis, noise->name, E, T,
              stop.q.volume, stop.ms);
    if (mlem_by >= 0 && (by < 0 || mlem.at[mlem_by].q.volume < own.at[by].q.volume))
        printf("    mlem wins over %s at that time: %.3f\n", ours, mlem.at[mlem_by].q.volume);
}

/* n instants `step` apart, one flame; all noise levels and both bases. */
static void flame(enum flame_kind kind, int n, double step, pvx_pool *pool)
{
    static const struct noise *const noise[] = {&noise_0, &noise_1, &noise_5};
    struct scene s[8];
    struct shot shot[8];
    for (int i = 0; i < n; i++)
        if (!scene_new(&s[i], kind, &views_8, size_64, flames[kind].t + i * step, pool))
            return;
    for (int basis = REC_BOX; basis <= REC_TRILINEAR; basis++) {
        for (int i = 0; i < n; i++)
            scene_truth(&s[i], (enum rec_basis)basis, pool);
        rec_sysmat *S = scene_matrix(&s[0], 2, pool, NULL);
        for (size_t k = 0; k < sizeof noise / sizeof *noise; k++) {
            for (int i = 0; i < n; i++)
                shot_new(&shot[i], &s[i], noise[k], 1 + (uint64_t)i);
            struct course c = {
                .scene = s, .shot = shot, .n = n, .from = n > 1 ? 1 : 0, .S = S, .pool = pool};
            course_base(&c);
            condition(&flames[kind], noise[k], &c);
            for (int i = 0; i < n; i++)
                shot_free(&shot[i]);
        }
        rec_sysmat_free(&S);
    }
    for (int i = 0; i < n; i++)
        scene_fini(&s[i]);
}

int main(int argc, char **argv)
{
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    printf("\ntargets: %s against cgls-paper's best iterate, voxels 1/64, 8 x 160x120, %u threads "
           "(moving: 3 frames at 20 Hz, warm starts)\n",
           rec_solver_names()[0], pvx_pool_threads(pool));
    csv = bench_csv(argc, argv, "targets", "target,scene,use,basis,noise,measured,reach,aim,met");
    errors = bench_csv(argc, argv, "best", "scene,use,basis,noise,paper,paper_ms,own,own_ms");
    for (int kind = 0; kind < N_FLAMES; kind++)
        if (kind != FLAME_PLUME) /* bench_scalarflow's */
            flame((enum flame_kind)kind, 1, 0, pool);
    flame(FLAME_RING, 4, 0.05, pool);
    fclose(csv);
    fclose(errors);
    pvx_pool_free(&pool);
    return *bench_status();
}
