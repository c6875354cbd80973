/* bench_check.c - a flame against its rig: what refinement leaves of an error of the poses.
 *
 * Eight cameras, 160x120, every pose off by 1 pixel rms (turned and shifted at random, other numbers for every flame
 * and run), 1 % noise.  Of each flame as many instants as there are; two thirds fit, the last third judges.  Errors are
 * rms of pixels over the box, after the similarity that no picture tells; volumes those of all cameras on 64 voxels,
 * with the rig laid onto the true one, over what the true rig gives.  What is chosen was chosen on ring and campfire. */
#include "check_shots.h"
#include "recon/check/refine.h"

enum { RUNS = 1 };

static FILE *csv;

static double distance(const struct rec_rig *truth, const struct rec_rig *rig)
{
    struct rec_rig r;
    CHECK(rec_rig_copy(rig, &r));
    double d = rec_gauge_hold(truth, &r, NULL);
    rec_rig_fini(&r);
    return d;
}

/* Error of the last set's volume. */
static double volume(struct shots *s, const struct rec_rig *rig, pvx_pool *pool)
{
    struct scene *q = &s->scene[s->n - 1];
    struct scene mine = *q;
    struct rec_frame_params p = rec_frame_defaults;
    struct rec_sparse v;
    rec_frame *f;
    size_t n = rec_grid_count(&q->rig.grid) * (size_t)q->nch;
    float *dense = must_floats(n);
    scene_truth(q, REC_TRILINEAR, pool);
    CHECK(rec_rig_copy(rig, &mine.rig));
    mine.rig.grid = q->rig.grid;
    (void)rec_gauge_hold(&q->rig, &mine.rig, NULL);
    rec_sysmat *S = scene_matrix(&mine, 2, pool, NULL);
    p.nch = q->nch;
    CHECK(slot_new(S, &mine.rig, &p, pool, &f, NULL));
    bench_seed(77);
    scene_fill(q, f, 0.01);
    rec_frame_carve(f);
    CHECK(rec_frame_solve(f, 0, NULL));
    rec_frame_volume(f, &v);
    rec_sparse_to_dense(&v, dense);
    double e = rec_rel_l2(dense, q->truth, n);
    slot_free(&f);
    rec_sysmat_free(&S);
    rec_rig_fini(&mine.rig);
    free(dense);
    return e;
}

static void refine(enum flame_kind kind, size_t n, pvx_pool *pool)
{
    static struct shots s;
    const struct rec_unseen_params p = {.voxels = 48, .binning = 1, .rays = 2, .margin = 1};
    if (shoot(&s, kind, n, 0.01, pool)) {
        const struct rec_rig *truth = &s.scene[0].rig;
        double exact = volume(&s, truth, pool);
        for (unsigned run = 0; run < RUNS; run++) {
            struct rec_check_source from = {.n = s.n, .get = get, .ctx = &s};
            struct rec_refine_report o;
            struct rec_rig rig;
            struct pvx_diag d = {""};
            CHECK(rec_rig_copy(truth, &rig));
            bench_seed(100 * (uint64_t)kind + run);
            disturb(&rig, 1);
            double before = distance(truth, &rig), off = volume(&s, &rig, pool) / exact;
            int64_t t0 = pvx_now_mono();
            if (rec_refine(&rig, &p, pool, &from, &o, &d) != PVX_OK)
                printf("%s\n", d.text);
            bench_row(csv, "%s,%s,%u,%zu,%.3f,%.3f,%u,%d,%.4f,%.4f,%.3f,%.3f,%.1f",
                      flames[kind].name, flames[kind].use, run, s.n, before, distance(truth, &rig),
                      o.best, o.accepted, o.error[0], o.error[o.best], off,
                      volume(&s, &rig, pool) / exact, ms(pvx_now_mono() - t0) * 1e-3);
            rec_rig_fini(&rig);
        }
    }
    let_go(&s);
}

int main(int argc, char **argv)
{
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    printf(
        "\nrefined by a flame: 8 x 160x120, poses off by 1 px rms, 1 %% noise, %u threads; volume: "
        "error over the true rig's\n",
        pvx_pool_threads(pool));
    csv = bench_csv(argc, argv, "check",
                    "flame,use,run,sets,px_before,px_after,rounds,accepted,unseen_before,unseen_"
                    "after,volume_before,volume_after,s");
    refine(FLAME_JET, 6, pool);
    refine(FLAME_CANDLES, 6, pool);
    refine(FLAME_HOLLOW, 6, pool);
    refine(FLAME_CAMPFIRE, 9, pool);
    refine(FLAME_RING, 9, pool);
    fclose(csv);
    pvx_pool_free(&pool);
    return *bench_status();
}
