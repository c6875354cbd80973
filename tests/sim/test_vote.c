/* test_vote.c - cameras are left out while they lie, and only then: every fault, healthy sets, few cameras, two at
 * once, any order and number of threads, back again; errors by the flame's truth, on flames that nothing was chosen
 * on where they need no data (flames.h). */
#include "../t.h"

#include "tests/bench/liars.h"

#define WIDE   64 /* pixels */
#define VOXELS 24

static pvx_pool *pool;

static struct take bed(enum flame_kind kind, enum rig_kind rigs, size_t cameras, uint64_t seed)
{
    struct rec_rig rig;
    struct take t;
    if (pool == NULL)
        CHECK(pvx_pool_new(2, "test", &pool));
    bench_seed(seed);
    random_rig(&rig, rigs, cameras, WIDE, VOXELS);
    if (!take_new(&t, &rig, kind, REC_TRILINEAR, true, pool))
        exit(2);
    rec_rig_fini(&rig);
    return t;
}

static const struct rec_verdict *verdict(const struct take *t)
{
    return &rec_frame_get_report(t->f)->vote;
}
static const struct rec_verdict *vote(const struct take *t, enum fault fault, size_t bad,
                                      double noise)
{
    shoot(t, t->f, fault, bad, noise, 5);
    rec_frame_carve(t->f);
    return verdict(t);
}

static const enum flame_kind held_out[] = {FLAME_SHEETS, FLAME_WALL, FLAME_SHELL, FLAME_POOL};
#define N_HELD (sizeof held_out / sizeof *held_out)

/* Error with the vote over that of leaving the camera out. */
static double over_leaving_out(const struct take *t, enum fault fault, size_t bad)
{
    shoot(t, t->trusting, fault, bad, 0.01, 5);
    rec_frame_camera(t->trusting, bad)->present = false;
    double without = error_of(t, t->trusting);
    shoot(t, t->f, fault, bad, 0.01, 5);
    return error_of(t, t->f) / without;
}

T_CASE(one_that_lies_costs_what_leaving_it_out_costs)
{
    static const size_t cameras[] = {5, 6, 8, 12};
    static const enum rec_wrong why[] = {[BLACK] = REC_WRONG_DARK,
                                         [SHIFTED] = REC_WRONG_DISAGREES,
                                         [FLOODED] = REC_WRONG_FLOODED,
                                         [HALF] = REC_WRONG_GAIN};
    for (size_t i = 0; i < (T_SANITIZED ? 1 : N_HELD); i++) {
        struct take t = bed(held_out[i], (enum rig_kind)(i % N_RIGS), cameras[i], 11 + i);
        size_t bad = i % cameras[i];
        for (int f = BLACK; f <= HALF; f++) {
            T_LE(over_leaving_out(&t, (enum fault)f, bad), 1.1);
            T_EQ_I(verdict(&t)->out, (uint64_t)1 << bad);
            if (f != SHIFTED && f != HALF)
                T_EQ_I(verdict(&t)->why[bad], why[f]);
        }
        take_free(&t);
    }
}

/* Camera `bad` shows all others' light times a gain; noise 1 %. */
static double error_at_gain(const struct take *t, size_t bad, float gain)
{
    const struct rec_camera *c = &t->now.rig.cameras[bad];
    size_t cs = t->now.nch == 3 ? 4 : 1;
    shoot(t, t->f, HEALTHY, 0, 0.01, 5);
    for (size_t i = 0; i < (size_t)c->width * (size_t)c->height * cs; i++)
        rec_frame_input(t->f, bad)[i] *= gain;
    return error_of(t, t->f);
}

/* The solve corrects gains, so a camera that is off by its gain alone is worth more than its absence: in the
 * mean.  A single one may be worth less (walls 1.06), for the mean of all gains is what says how bright it burns. */
T_CASE(a_gain_that_is_corrected_puts_nobody_out)
{
    static const float gains[] = {0.7F, 1.5F};
    double product = 1;
    for (size_t i = 0; i < (T_SANITIZED ? 1 : N_HELD); i++) {
        struct take t = bed(held_out[i], EVEN, 8, 31 + i);
        for (size_t k = 0; k < 2; k++) {
            size_t bad = 2 * i + k;
            double with = error_at_gain(&t, bad, gains[k]);
            T_EQ_I(verdict(&t)->out, 0);
            T_EQ_I(verdict(&t)->state, REC_VOTE_AGREE);
            shoot(&t, t.f, HEALTHY, 0, 0.01, 5);
            rec_frame_camera(t.f, bad)->present = false;
            double over = with / error_of(&t, t.f);
            rec_frame_camera(t.f, bad)->present = true;
            T_LE(over, 1.1);
            product *= over;
        }
        take_free(&t);
    }
    T_LE(product, 1);
}

/* A flame that moves, a tenth of a second late, and frozen.  What is late by little stays under (3) of vote.h:
 * it is believed, and costs up to a fifth. */
T_CASE(late_and_frozen)
{
    struct take t = bed(FLAME_RING, EVEN, 8, 3);
    for (size_t bad = 0; bad < 8; bad += 3) {
        T_LE(over_leaving_out(&t, LATE, bad), verdict(&t)->out != 0 ? 1.1 : 1.25);
        T_LE(over_leaving_out(&t, FROZEN, bad), 1.1);
        T_EQ_I(verdict(&t)->out & ~((uint64_t)1 << bad), 0);
    }
    T_EQ_I(vote(&t, FROZEN, 2, 0.01)->out, 4);
    T_EQ_I(verdict(&t)->why[2], REC_WRONG_DISAGREES);
    take_free(&t);
}

T_CASE(left_out_is_absent_to_the_bit)
{
    struct take t = bed(FLAME_POOL, EVEN, 6, 2);
    struct rec_sparse a, b;
    shoot(&t, t.trusting, BLACK, 1, 0.01, 5);
    rec_frame_camera(t.trusting, 1)->present = false;
    (void)error_of(&t, t.trusting);
    shoot(&t, t.f, BLACK, 1, 0.01, 5);
    (void)error_of(&t, t.f);
    rec_frame_volume(t.trusting, &a);
    rec_frame_volume(t.f, &b);
    T_EQ_I(a.n, b.n);
    T_OK(a.n > 0 && a.n == b.n &&
         memcmp(a.value, b.value, (size_t)a.n * (size_t)a.cs * sizeof *a.value) == 0);
    T_EQ_I(rec_frame_get_report(t.f)->cameras, 5);
    take_free(&t);
}

T_CASE(nobody_of_a_healthy_set)
{
    static const enum flame_kind kinds[] = {FLAME_RING, FLAME_GAUSS40, FLAME_RAGGED, FLAME_SHEETS,
                                            FLAME_WALL, FLAME_SHELL,   FLAME_POOL};
    for (size_t i = 0; i < (T_SANITIZED ? 2 : 14); i++) {
        struct take t = bed(kinds[i % 7], (enum rig_kind)(i % N_RIGS), 4 + i % 13, 100 + i);
        for (int noise = 0; noise <= 10; noise += 5) {
            const struct rec_verdict *v = vote(&t, HEALTHY, 0, 0.01 * noise);
            T_EQ_I(v->out, 0);
            T_EQ_I(v->state, REC_VOTE_AGREE);
        }
        take_free(&t);
    }
}

/* Voxels four and eight times longer one way: what they cannot show is no fault of a camera, and faults are found. */
T_CASE(long_voxels)
{
    static const struct {
        int32_t n[3];
        enum flame_kind flame;
        enum rig_kind rigs;
        size_t cameras;
        uint64_t seed;
    } of[] = {{{24, 24, 6}, FLAME_WALL, WILD, 4, 1031},
              {{6, 24, 24}, FLAME_WALL, WILD, 4, 1031},
              {{24, 6, 24}, FLAME_SHEETS, MIXED, 6, 1021},
              {{24, 3, 24}, FLAME_POOL, EVEN, 8, 7}};
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct rec_rig rig;
        struct take t;
        bench_seed(of[i].seed);
        (void)bench_even();
        random_rig(&rig, of[i].rigs, of[i].cameras, WIDE, VOXELS);
        memcpy(rig.grid.n, of[i].n, sizeof rig.grid.n);
        if (!take_new(&t, &rig, of[i].flame, REC_TRILINEAR, false, pool))
            exit(2);
        T_EQ_I(vote(&t, HEALTHY, 0, 0)->out, 0);
        T_EQ_I(verdict(&t)->state, REC_VOTE_AGREE);
        T_EQ_I(vote(&t, BLACK, 1, 0.01)->out, 2);
        if (of[i].cameras > 4)
            T_EQ_I(vote(&t, SHIFTED, 1, 0.01)->out, 2);
        take_free(&t);
        rec_rig_fini(&rig);
    }
}

T_CASE(fewer_than_four_and_no_flame)
{
    struct take t = bed(FLAME_RING, EVEN, 5, 4);
    shoot(&t, t.f, BLACK, 0, 0.01, 5);
    rec_frame_camera(t.f, 3)->present = false;
    rec_frame_camera(t.f, 4)->present = false;
    rec_frame_carve(t.f);
    T_EQ_I(verdict(&t)->state, REC_VOTE_FEW);
    T_EQ_I(verdict(&t)->out, 0);
    shoot(&t, t.f, BLACK, 0, 0.01, 5);
    rec_frame_camera(t.f, 4)->present = false;
    rec_frame_carve(t.f); /* four are enough */
    T_EQ_I(verdict(&t)->out, 1);
    for (size_t c = 0; c < 5; c++)
        spoil(&t, t.f, BLACK, c, 0.02);
    for (size_t c = 0; c < 5; c++)
        rec_frame_camera(t.f, c)->present = true;
    rec_frame_carve(t.f);
    T_EQ_I(verdict(&t)->state, REC_VOTE_DARK);
    T_EQ_I(verdict(&t)->out, 0);
    take_free(&t);
}

/* Both are left out, or it is said that it cannot be told. */
T_CASE(two_of_eight)
{
    for (size_t i = 0; i < (T_SANITIZED ? 1 : N_HELD); i++) {
        struct take t = bed(held_out[i], EVEN, 8, 50 + i);
        for (int f = BLACK; f <= HALF; f++)
            for (int g = f; g <= HALF; g++) {
                shoot(&t, t.f, (enum fault)f, 1, 0.01, 5);
                spoil(&t, t.f, (enum fault)g, 4, 0.01);
                rec_frame_carve(t.f);
                bool both = verdict(&t)->out == (2 | 16);
                T_CHECK_(both || verdict(&t)->state == REC_VOTE_TORN, "%s: %s and %s: out %llx, %s",
                         flames[held_out[i]].name, fault_names[f], fault_names[g],
                         (unsigned long long)verdict(&t)->out,
                         rec_vote_state_name(verdict(&t)->state));
                T_EQ_I(verdict(&t)->out & ~(uint64_t)(2 | 16), 0);
            }
        take_free(&t);
    }
}

T_CASE_OF_THREADS(same_for_any_number_of_threads)
{
    struct take t = bed(FLAME_WALL, WILD, 7, 8);
    struct rec_verdict first = *vote(&t, SHIFTED, 3, 0.05);
    T_OK(first.out == 8);
    for (unsigned threads = 1; threads <= 5; threads += 2) {
        pvx_pool *other;
        rec_frame *f;
        struct rec_frame_params p = rec_frame_defaults;
        CHECK(pvx_pool_new(threads, "other", &other));
        CHECK(rec_frame_alone(t.S, &t.now.rig, &p, other, &f, NULL));
        shoot(&t, f, SHIFTED, 3, 0.05, 5);
        rec_frame_carve(f);
        T_OK(memcmp(&first, &rec_frame_get_report(f)->vote, sizeof first) == 0);
        rec_frame_free(&f);
        pvx_pool_free(&other);
    }
    take_free(&t);
}

/* The cameras in another order get the same costs, to what sums in another order leave. */
T_CASE(same_in_any_order)
{
    enum { N = 7, STEP = 3 }; /* camera c becomes number c * STEP % N */
    struct take t = bed(FLAME_SHELL, MIXED, N, 9), u = t;
    struct rec_sysmat_params p = {.binning = 1, .rays_per_bin = 1};
    struct rec_frame_params fp = rec_frame_defaults;
    struct rec_camera cameras[N];
    for (size_t c = 0; c < N; c++) {
        cameras[c * STEP % N] = t.now.rig.cameras[c];
        u.now.image[c * STEP % N] = t.now.image[c];
    }
    CHECK(rec_rig_copy(&t.now.rig, &u.now.rig));
    memcpy(u.now.rig.cameras, cameras, sizeof cameras);
    CHECK(rec_sysmat_build(&u.now.rig, &p, pool, NULL, NULL, &u.S, NULL));
    CHECK(rec_frame_alone(u.S, &u.now.rig, &fp, pool, &u.f, NULL));
    struct rec_verdict a = *vote(&t, HALF, 2, 0), b = *vote(&u, HALF, (size_t)2 * STEP % N, 0);
    T_EQ_I(a.out, 4);
    T_EQ_I(b.out, 1 << 2 * STEP % N);
    for (size_t c = 0; c < N; c++)
        T_NEAR(a.cost[c], b.cost[c * STEP % N], 1e-3 * a.cost[2]);
    rec_frame_free(&u.f);
    rec_sysmat_free(&u.S);
    rec_rig_fini(&u.now.rig);
    take_free(&t);
}

/* What says nothing is no lie: a camera that looks past the flame, one whose picture ends in it. */
T_CASE(who_sees_a_part_or_nothing_is_believed)
{
    struct rec_rig rig;
    struct take t;
    CHECK(pool != NULL ? PVX_OK : pvx_pool_new(2, "test", &pool));
    bench_seed(1);
    random_rig(&rig, EVEN, 6, WIDE, VOXELS);
    rig.cameras[1].cx += WIDE;        /* past the volume */
    rig.cameras[3].cx += 0.45 * WIDE; /* and half of it */
    rig.cameras[4].fx *= 2;
    rig.cameras[4].fy *= 2;
    for (int k = 0; k < 2; k++) {
        if (!take_new(&t, &rig, k == 0 ? FLAME_RING : FLAME_SHELL, REC_BOX, false, pool))
            exit(2);
        T_EQ_I(vote(&t, HEALTHY, 0, 0.01)->out, 0);
        T_EQ_I(vote(&t, BLACK, 2, 0.01)->out, 4);
        take_free(&t);
    }
    rec_rig_fini(&rig);
}

T_CASE(dazzled)
{
    struct take t = bed(FLAME_RING, EVEN, 6, 4);
    shoot(&t, t.f, HEALTHY, 0, 0.01, 5);
    for (size_t c = 0; c < 6; c++)
        rec_frame_camera(t.f, c)->floats = false;
    size_t n = (size_t)WIDE * (WIDE * 3 / 4) * 4;
    for (size_t i = 0; i < n; i++)
        rec_frame_input(t.f, 5)[i] = 1;
    rec_frame_carve(t.f);
    T_EQ_I(verdict(&t)->out, 32);
    T_EQ_I(verdict(&t)->why[5], REC_WRONG_FLOODED);
    take_free(&t);
}

/* Pixels behind a Bayer filter, as they are. */
T_CASE(mosaics)
{
    static const uint8_t cell[4] = {0, 1, 1, 2};
    struct take t = bed(FLAME_RING, EVEN, 6, 4);
    for (int fault = HEALTHY; fault <= HALF; fault++) {
        shoot(&t, t.f, (enum fault)fault, 3, 0.01, 5);
        for (size_t c = 0; c < 6; c++) {
            float *in = rec_frame_input(t.f, c);
            rec_frame_camera(t.f, c)->cell = cell;
            rec_frame_camera(t.f, c)->mosaic = true;
            for (size_t i = 0; i < (size_t)WIDE * (WIDE * 3 / 4); i++)
                for (size_t l = 0; l < 3; l++)
                    if (cell[i / WIDE % 2 * 2 + i % 2] != l)
                        in[i * 4 + l] = NAN;
        }
        rec_frame_carve(t.f);
        T_EQ_I(verdict(&t)->out, fault == HEALTHY ? 0 : 8);
    }
    take_free(&t);
}

/* Out at once; back after `hold` sets in which it agrees, of which those without a flame are none. */
T_CASE(back_when_it_agrees_again)
{
    struct take t = bed(FLAME_RING, EVEN, 6, 4);
    struct rec_frame_params p = rec_frame_defaults;
    rec_frame *f;
    p.hold = 3;
    CHECK(rec_frame_alone(t.S, &t.now.rig, &p, pool, &f, NULL));
    static const struct {
        bool lies, dark;
        uint64_t out;
    } set[] = {{0, 0, 0}, {1, 0, 2}, {0, 0, 2}, {0, 0, 2}, {1, 0, 2}, {0, 0, 2},
               {0, 1, 2}, {0, 0, 2}, {0, 0, 0}, {0, 0, 0}, {1, 0, 2}};
    for (size_t i = 0; i < sizeof set / sizeof *set; i++) {
        shoot(&t, f, set[i].lies ? BLACK : HEALTHY, 1, 0.01, i);
        for (size_t c = 0; c < 6 && set[i].dark; c++)
            spoil(&t, f, BLACK, c, 0.01);
        rec_frame_carve(f);
        const struct rec_verdict *v = &rec_frame_get_report(f)->vote;
        T_CHECK_(v->out == set[i].out, "set %zu: out %llx", i, (unsigned long long)v->out);
        if (v->out != 0)
            T_EQ_I(v->why[1], REC_WRONG_DARK);
    }
    rec_frame_free(&f);
    take_free(&t);
}

/* Live not every set asks every camera; what is wrong at once is out at once, and who is out stays out. */
T_CASE(asked_now_and_then)
{
    struct take t = bed(FLAME_SHEETS, EVEN, 7, 4);
    struct rec_frame_params p = rec_frame_defaults;
    rec_frame *f;
    uint32_t asked = 0, back = 0;
    p.hold = 15;
    CHECK(rec_frame_alone(t.S, &t.now.rig, &p, pool, &f, NULL));
    for (uint32_t i = 0; i < 60; i++) {
        bool lies = i >= 10 && i < 32;
        shoot(&t, f, lies ? SHIFTED : HEALTHY, 3, 0.01, i);
        rec_frame_carve(f);
        const struct rec_verdict *v = &rec_frame_get_report(f)->vote;
        T_EQ_I(v->out & ~(uint64_t)8, 0);
        if (lies || i < 10)
            T_EQ_I(v->out, lies ? 8 : 0);
        asked += lies && v->doubt > 0;
        back = i >= 32 && back == 0 && v->out == 0 ? i : back;
    }
    T_LE(asked, 6);           /* of 22 */
    T_LE(32 + 14, back);      /* not before it agreed in 15 */
    T_LE(back, 32 + 14 + 10); /* and then with the next that is asked */
    rec_frame_free(&f);
    take_free(&t);
}

/* The same bits again and again while the others' pictures change: no statistics needed. */
T_CASE(frozen_to_the_bit)
{
    struct take t = bed(FLAME_RING, EVEN, 6, 4);
    size_t n = (size_t)WIDE * (WIDE * 3 / 4) * 4;
    float *still = must_floats(n);
    for (uint32_t i = 0; i < 12; i++) {
        shoot(&t, t.f, HEALTHY, 0, 0.01, i < 8 ? i : 20); /* in the last all stand still */
        if (i == 2)
            memcpy(still, rec_frame_input(t.f, 1), n * sizeof *still);
        if (i >= 2 && i < 7)
            memcpy(rec_frame_input(t.f, 1), still, n * sizeof *still);
        rec_frame_carve(t.f);
        T_EQ_I(verdict(&t)->out, i == 5 || i == 6 ? 2 : 0);
        if (verdict(&t)->out != 0)
            T_EQ_I(verdict(&t)->why[1], REC_WRONG_LATE);
    }
    free(still);
    take_free(&t);
}
