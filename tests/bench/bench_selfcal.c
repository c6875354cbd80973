/* bench_selfcal.c - what it costs that the solver corrects cameras (recon/solve/selfcal.h): processor time of a frame
 * set, carving included, with it and without it in turns, least of TURNS each.
 *
 * Gate closed: an exact rig, nothing is corrected.  Open: gains off by 10 % and poses by 0.5 px.  8 cameras, trilinear,
 * noise 1 %, one thread: processor time then hardly depends on other work.  Iterations are told because they differ.
 *
 *     bench_selfcal [FOLDER [FLAME]] */
#include "wrong.h"

#define TURNS 15

static const int32_t size_48[3] = {120, 90, 48};
static const int32_t *const sizes[] = {size_48, size_64};
static const enum flame_kind of[] = {FLAME_WALL, FLAME_CAMPFIRE, FLAME_POOL, FLAME_JET,
                                     FLAME_HOLLOW};
#define COUNT(a) (sizeof(a) / sizeof *(a))

struct side {
    rec_frame *f;
    double ms, solve; /* least of a set, of its solve */
};

static void side_turn(struct side *s, const struct shot *shot)
{
    shot_put(shot, s->f);
    double t0 = bench_cpu();
    rec_frame_carve(s->f);
    double t1 = bench_cpu();
    CHECK(rec_frame_solve(s->f, 0, NULL));
    double t2 = bench_cpu();
    s->ms = fmin(s->ms, 1e3 * (t2 - t0));
    s->solve = fmin(s->solve, 1e3 * (t2 - t1));
}

/* The logarithm of the ratio; NAN: the flame's data are not there. */
static double selfcal_cost(FILE *csv, enum flame_kind kind, const int32_t size[3],
                           const char *wrong, pvx_pool *pool)
{
    static const enum rec_selfcal_mode modes[2] = {REC_SELFCAL_OFF, REC_SELFCAL_ON};
    struct side side[2];
    struct scene s;
    struct shot shot;
    if (!scene_new(&s, kind, &views_8, size, flames[kind].t, pool))
        return NAN;
    wrong_scene(wrong_named(wrong), &s, 1, pool);
    shot_new(&shot, &s, &noise_1, 1);
    s.rig.grid.basis = REC_TRILINEAR;
    rec_sysmat *S = scene_matrix(&s, 0, pool);
    for (int i = 0; i < 2; i++) {
        struct rec_frame_params p = rec_frame_defaults;
        p.nch = s.nch;
        p.photo.saturation = 1e30F;
        p.selfcal = modes[i];
        side[i] = (struct side){.ms = INFINITY, .solve = INFINITY};
        CHECK(rec_frame_alone(S, &s.rig, &p, NULL, &side[i].f, NULL));
    }
    for (int turn = 0; turn < 2 * TURNS; turn++)
        side_turn(&side[(turn + turn / 2) % 2], &shot); /* neither is always the second */
    const struct rec_frame_report *off = rec_frame_get_report(side[0].f),
                                  *on = rec_frame_get_report(side[1].f);
    bench_row(csv, "%s,%s,%d,%s,%s,%.2f,%.2f,%.3f,%.3f,%u,%u", flames[kind].name, flames[kind].use,
              S->grid.n[2], wrong, on->selfcal.gain || on->selfcal.shift ? "open" : "closed",
              side[0].ms, side[1].ms, side[1].ms / side[0].ms, side[1].solve / side[0].solve,
              off->solve.iterations, on->solve.iterations);
    double ratio = log(side[1].ms / side[0].ms);
    for (int i = 0; i < 2; i++)
        rec_frame_free(&side[i].f);
    rec_sysmat_free(&S);
    shot_free(&shot);
    scene_fini(&s);
    return ratio;
}

int main(int argc, char **argv)
{
    static const char *const rigs[] = {"exact", "gains and poses"};
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    FILE *csv = bench_csv(argc, argv, "selfcal",
                          "flame,use,voxels,wrong,gate,off ms,on ms,set over off,solve over off,"
                          "iterations off,iterations on");
    for (size_t k = 0; k < COUNT(sizes); k++)
        for (size_t w = 0; w < COUNT(rigs); w++) {
            double sum = 0;
            int n = 0;
            for (size_t i = 0; i < COUNT(of); i++) {
                if (argc > 2 && strcmp(argv[2], flames[of[i]].name) != 0)
                    continue;
                double ratio = selfcal_cost(csv, of[i], sizes[k], rigs[w], pool);
                n += isfinite(ratio);
                sum += isfinite(ratio) ? ratio : 0;
            }
            if (n > 0)
                printf("  %d^3, %s: a set takes %.3f of the time without (wanted %s)\n",
                       sizes[k][2], rigs[w], exp(sum / n), w == 0 ? "1.02" : "1.25");
        }
    fclose(csv);
    pvx_pool_free(&pool);
    return *bench_status();
}
