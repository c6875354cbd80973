/* bench_check.c - a flame against its rig: what refinement leaves of an error of the poses.
 *
 * Eight cameras, 160x120, every pose off by 1 pixel rms (turned and shifted at random, other numbers for every flame
 * and run), 1 % noise.  Of each flame as many instants as there are; two thirds fit, the last third judges.  Errors are
 * rms of pixels over the box, after the similarity that no picture tells; volumes those of all cameras on 64 voxels,
 * with the rig laid onto the true one, over what the true rig gives.  Then what a check says of one camera spoilt in
 * each way: whether it names that one by its cause, and how many innocents it names.  What is chosen was chosen on ring and
 * campfire. */
#include "check_shots.h"
#include "recon/check/refine.h"
#include "tests/lib/flame_rig.h"

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
    CHECK(rec_frame_alone(S, &mine.rig, &p, pool, &f, NULL));
    bench_seed(77);
    scene_fill(q, f, 0.01);
    rec_frame_carve(f);
    CHECK(rec_frame_solve(f, 0, NULL));
    rec_frame_volume(f, &v);
    rec_sparse_to_dense(&v, dense);
    double e = rec_rel_l2(dense, q->truth, n);
    rec_frame_free(&f);
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

/* One camera of eight spoilt in turn: is it named, by its cause, and is anybody else? */
static const struct {
    enum spoil what;
    enum rec_wrong cause;
} faults[] = {{SPOIL_NOTHING, REC_WRONG_NOTHING}, {SPOIL_CAP, REC_WRONG_DARK},
              {SPOIL_FLOOD, REC_WRONG_FLOODED},   {SPOIL_SHIFT, REC_WRONG_MOVED},
              {SPOIL_TENTH, REC_WRONG_MOVED},     {SPOIL_MIRROR, REC_WRONG_MIRRORED},
              {SPOIL_BLUR, REC_WRONG_BLURRED},    {SPOIL_HALF, REC_WRONG_GAIN},
              {SPOIL_LATE, REC_WRONG_LATE},       {SPOIL_FROZEN, REC_WRONG_LATE}};

static void name(enum flame_kind kind, size_t n, pvx_pool *pool)
{
    static struct shots s;
    static struct rec_check_verdict v; /* large */
    static const char *const what[N_SPOILS] = {
        "nothing",  "shifted 3.6 px", "shifted a tenth", "capped",    "flooded",
        "mirrored", "one set late",   "frozen",          "blurred 2", "half gain"};
    const struct rec_unseen_params p = {.voxels = 48, .binning = 1, .rays = 2, .margin = 1};
    if (shoot(&s, kind, n, 0.01, pool)) {
        const struct rec_rig *rig = &s.scene[0].rig;
        struct flame_rig f = {.rig = *rig, .w = W, .h = H, .n = s.n};
        memcpy(f.picture, s.grey, sizeof s.grey);
        for (size_t i = 0; i < sizeof faults / sizeof *faults && rig->n_cameras > 0; i++) {
            struct flame_source from = {.f = &f, .noise = bench_normal};
            struct rec_check_source of = {.n = s.n, .get = flame_source_get, .ctx = &from};
            struct pvx_diag d = {""};
            rec_check *k;
            size_t bad = i % rig->n_cameras, others = 0;
            from.what[bad] = faults[i].what;
            CHECK(rec_check_new(rig, &p, pool, &k, &d));
            if (rec_check_run(k, rig, &of, &v, &d) != PVX_OK)
                printf("%s\n", d.text);
            for (size_t c = 0; c < rig->n_cameras; c++)
                others += c != bad && v.figures.camera[c].wrong != REC_WRONG_NOTHING;
            enum rec_wrong w = v.figures.camera[bad].wrong;
            bench_row(csv, "%s,%s,%s,%s,%d,%zu", flames[kind].name, flames[kind].use,
                      what[faults[i].what], rec_wrong_name(w), w == faults[i].cause, others);
            rec_check_free(&k);
            flame_source_free(&from);
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
    printf("\nnamed: one camera of the eight spoilt, the rig right\n");
    csv = bench_csv(argc, argv, "check_names", "flame,use,fault,named,right,innocents");
    name(FLAME_JET, 6, pool);
    name(FLAME_CANDLES, 6, pool);
    name(FLAME_HOLLOW, 6, pool);
    name(FLAME_CAMPFIRE, 6, pool);
    fclose(csv);
    pvx_pool_free(&pool);
    return *bench_status();
}
