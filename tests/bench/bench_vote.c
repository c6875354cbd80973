/* bench_vote.c - which cameras are believed: false alarms, what a camera that lies costs, time.
 *
 * (a) SETS healthy frame sets (argument, default 1000) of every flame of flames.h, seen by 4 to 16 cameras
 *     on random rigs, with noise of 0 to 10 % of the brightest pixel: nobody may be voted out.  `nearest`:
 *     the greatest cost of a camera over what it may cost.
 * (b) one camera spoilt: the error with the vote, and believing all, over that of leaving the camera out.
 *     The plume is a capture of five views and has no truth: it is bench_scalarflow's.
 * (c) time of the vote and its share of a set's.
 * Constants were chosen on the flames that are fitted and seen, and on other rigs. */
#include "liars.h"

static FILE *csv;

static const char *const rig_names[N_RIGS] = {"ring", "arc", "dome", "mixed", "wild"};
/* ---- (a) nobody is wrong ------------------------------------------------------------------------ */

#define DRAWS 32 /* of noise, from one rig and flame */

struct tally {
    const char *name;
    uint32_t sets, alarms, torn, asked;
    double nearest;
};
static void tally_add(struct tally *t, const struct rec_verdict *v)
{
    t->sets++;
    t->alarms += v->out != 0;
    t->torn += v->state == REC_VOTE_TORN;
    t->asked += v->doubt > 0;
    t->nearest = fmax(t->nearest, v->doubt);
}
static void tally_print(const struct tally *t)
{
    if (t->sets > 0)
        bench_row(csv, "healthy,%s,%u,%u,%u,%.2f,%.3f", t->name, t->sets, t->alarms, t->torn,
                  (double)t->asked / t->sets, t->nearest);
}

static void false_alarms(uint32_t sets, uint64_t seed, pvx_pool *pool)
{
    struct tally all = {.name = "all"}, flame[N_FLAMES] = {0}, kind[N_RIGS] = {0}, views[4] = {0};
    static const char *const view_names[] = {"4 cameras", "5 to 7", "8 to 11", "12 to 16"};
    bench_row(csv, "part,of,sets,voted out,torn,asked,nearest");
    for (uint32_t i = 0; all.sets < sets && i < 8 * sets + N_FLAMES; i++) {
        struct rec_rig rig;
        struct take t;
        bench_seed(seed + i);
        size_t n = 4 + (size_t)(13 * bench_even());
        enum rig_kind k = (enum rig_kind)(N_RIGS * bench_even());
        int32_t wide = 64 + 16 * (int32_t)(3 * bench_even());
        random_rig(&rig, k, n, wide, 32);
        enum flame_kind f = (enum flame_kind)(i % N_FLAMES);
        if (f != FLAME_PLUME &&
            take_new(&t, &rig, f, i % 2 ? REC_BOX : REC_TRILINEAR, false, pool)) {
            for (uint32_t d = 0; d < DRAWS; d++) {
                double noise = d == 0 ? 0 : 0.1 * (d + bench_even() - 1) / (DRAWS - 1);
                shoot(&t, t.f, HEALTHY, 0, noise, (seed + i) * DRAWS + d);
                rec_frame_carve(t.f);
                const struct rec_verdict *v = &rec_frame_get_report(t.f)->vote;
                struct tally *of[] = {&all, &flame[f], &kind[k],
                                      &views[n == 4   ? 0
                                             : n < 8  ? 1
                                             : n < 12 ? 2
                                                      : 3]};
                for (size_t o = 0; o < sizeof of / sizeof *of; o++)
                    tally_add(of[o], v);
                if (v->doubt > 0.8)
                    printf("    %.2f: %s, %zu cameras, %s, noise %.3f\n", v->doubt, flames[f].name,
                           n, rig_names[k], noise);
            }
            take_free(&t);
        }
        rec_rig_fini(&rig);
    }
    for (int f = 0; f < N_FLAMES; f++) {
        flame[f].name = flames[f].name;
        tally_print(&flame[f]);
    }
    for (int k = 0; k < N_RIGS; k++) {
        kind[k].name = rig_names[k];
        tally_print(&kind[k]);
    }
    for (int v = 0; v < 4; v++) {
        views[v].name = view_names[v];
        tally_print(&views[v]);
    }
    tally_print(&all);
}

/* ---- (b) one is wrong --------------------------------------------------------------------------- */

struct cost {
    uint32_t n, named, innocent;
    double vote, worst, trust, log_vote, log_trust;
    uint32_t why[REC_N_WRONG];
};

static void try_fault(const struct take *t, enum fault fault, size_t bad, uint64_t seed,
                      struct cost *o)
{
    double noise = seed % 2 ? 0.01 : 0.03;
    shoot(t, t->trusting, fault, bad, noise, seed);
    rec_frame_camera(t->trusting, bad)->present = false;
    double without = error_of(t, t->trusting);
    shoot(t, t->trusting, fault, bad, noise, seed);
    double trust = error_of(t, t->trusting) / without;
    shoot(t, t->f, fault, bad, noise, seed);
    double vote = error_of(t, t->f) / without;
    const struct rec_verdict *v = &rec_frame_get_report(t->f)->vote;
    o->n++;
    o->named += v->out >> bad & 1;
    o->innocent += (v->out & ~((uint64_t)1 << bad)) != 0;
    o->why[v->why[bad]] += v->out >> bad & 1;
    o->log_vote += log(vote);
    o->log_trust += log(trust);
    o->worst = fmax(o->worst, vote);
}

static void faults(uint32_t rigs, uint64_t seed, pvx_pool *pool)
{
    static const size_t views[] = {4, 5, 6, 8, 12};
    bench_row(csv, "fault,use,cameras,sets,named,innocent,vote,worst,trust all,said");
    for (int held = 0; held < 2; held++)
        for (size_t v = 0; v < sizeof views / sizeof *views; v++) {
            struct cost cost[N_FAULTS] = {0};
            for (uint32_t r = 0; r < rigs * N_FLAMES; r++) {
                enum flame_kind f = (enum flame_kind)(r % N_FLAMES);
                struct rec_rig rig;
                struct take t;
                if (f == FLAME_PLUME || (strcmp(flames[f].use, "held out") == 0) != held)
                    continue;
                bench_seed(seed + 1000 * v + r);
                random_rig(&rig, (enum rig_kind)(r / N_FLAMES % N_RIGS), views[v], 80, 32);
                if (take_new(&t, &rig, f, REC_TRILINEAR, true, pool)) {
                    for (int k = BLACK; k < N_FAULTS; k++)
                        if (t.moves || (k != LATE && k != FROZEN))
                            try_fault(&t, (enum fault)k, r % views[v],
                                      seed + r * N_FAULTS + (uint32_t)k, &cost[k]);
                    take_free(&t);
                }
                rec_rig_fini(&rig);
            }
            for (int k = BLACK; k < N_FAULTS; k++) {
                const struct cost *o = &cost[k];
                size_t most = 1;
                for (size_t w = 1; w < REC_N_WRONG; w++)
                    most = o->why[w] > o->why[most] ? w : most;
                if (o->n > 0)
                    bench_row(csv, "%s,%s,%zu,%u,%u,%u,%.3f,%.3f,%.3f,%s %u", fault_names[k],
                              held ? "held out" : "seen", views[v], o->n, o->named, o->innocent,
                              exp(o->log_vote / o->n), o->worst, exp(o->log_trust / o->n),
                              rec_wrong_name((enum rec_wrong)most), o->why[most]);
            }
        }
}

/* ---- (c) what it costs -------------------------------------------------------------------------- */

/* Mean of the sets between two in which all cameras are asked; live they differ. */
#define CYCLE 5

/* Least times of the vote and of the whole set, over some cycles; hold as in rec_frame_params. */
static void time_faults(const struct take *t, uint32_t hold, const char *what, pvx_pool *pool)
{
    struct rec_frame_params fp = rec_frame_defaults;
    rec_frame *f;
    fp.nch = t->now.nch;
    fp.hold = hold;
    CHECK(rec_frame_alone(t->S, &t->now.rig, &fp, pool, &f, NULL));
    const struct rec_frame_report *r = rec_frame_get_report(f);
    for (int fault = HEALTHY; fault <= HALF; fault++) {
        double vote = INFINITY, set = INFINITY;
        for (int rep = 0; rep < 12; rep++) {
            double sum = 0;
            for (int k = 0; k < CYCLE; k++) {
                shoot(t, f, (enum fault)fault, 2, 0.01, (uint64_t)(rep * CYCLE + k));
                rec_frame_carve(f);
                CHECK(rec_frame_solve(f, 0, NULL));
                sum += ms(r->vote_ns);
                set = fmin(set, ms(r->photo_ns + r->hull_ns + r->restrict_ns + r->solve_ns));
            }
            vote = rep > 0 ? fmin(vote, sum / CYCLE) : vote; /* the first finds out */
        }
        bench_row(csv, "%s,%s,%s,%.3f,%.2f,%.1f", what, fault_names[fault],
                  rec_vote_state_name(r->vote.state), vote, set, 100 * vote / set);
    }
    rec_frame_free(&f);
}

static void times(int32_t voxels, int32_t w, enum flame_kind kind, pvx_pool *pool)
{
    struct scene s;
    char what[64];
    const int32_t size[3] = {w, w * 3 / 4, voxels};
    if (!scene_new(&s, kind, &views_8, size, flames[kind].t, pool))
        return;
    struct take t = {.now = s};
    struct rec_sysmat_params p = {.binning = 1};
    CHECK(rec_sysmat_build(&t.now.rig, &p, pool, NULL, NULL, &t.S, NULL));
    snprintf(what, sizeof what, "%d,%s,offline", voxels, flames[kind].name);
    time_faults(&t, 0, what, pool);
    snprintf(what, sizeof what, "%d,%s,live", voxels, flames[kind].name);
    time_faults(&t, 3 * CYCLE, what, pool);
    rec_sysmat_free(&t.S);
    scene_fini(&t.now);
}

int main(int argc, char **argv)
{
    pvx_pool *pool;
    uint32_t sets = argc > 2 ? (uint32_t)atoi(argv[2]) : 1000,
             rigs = argc > 3 ? (uint32_t)atoi(argv[3]) : 2;
    uint64_t seed = argc > 4 ? (uint64_t)atoll(argv[4]) : 1;
    CHECK(pvx_pool_new(2, "bench", &pool));
    csv = bench_csv(argc, argv, "vote", "part,of");
    printf("\nhealthy sets: nobody may be voted out\n");
    false_alarms(sets, seed, pool);
    printf("\none camera is wrong: error over that of leaving it out, geometric mean, worst, mean "
           "of believing all\n");
    faults(rigs, seed, pool);
    printf("\ntime: vote, rest of the set, share\n");
    bench_row(csv, "voxels,flame,use,fault,state,vote ms,set ms,percent");
    times(64, 160, FLAME_RING, pool);
    times(64, 160, FLAME_POOL, pool);
    times(64, 160, FLAME_SHEETS, pool);
    times(128, 320, FLAME_RING, pool);
    fclose(csv);
    pvx_pool_free(&pool);
    return *bench_status();
}
