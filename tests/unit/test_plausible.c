/* test_plausible.c - do pictures and rig belong together: every mistake of tests/bench/mistakes.h on one flame and rig is
 * named rightly, and a healthy recording is good.  Many flames and rigs: tests/bench/bench_plausible.c. */
#include "tests/bench/mistakes.h"

#include "../t.h"

enum { CAMERAS = 6 };

static struct shots take;
static struct bed *bed;

static void judge(enum mistake m, double noise, struct rec_plausible_verdict *v)
{
    struct case_of k = {.m = m, .noise = noise, .poses = 0.3, .gains = 0.05, .a = 2, .b = 3};
    if (m == M_SWAP_FAR || m == M_LATE_TWO)
        k.b = 4;
    bench_seed(5);
    bed_judge(bed, &take, &k, v);
    if (!bed_right(&k, v))
        T_EQ_S(v->text, m < N_MISTAKES ? mistakes[m].name : "good");
}

T_CASE(names_every_mistake)
{
    struct rec_plausible_verdict v;
    char line[REC_PLAUSIBLE_LINE];
    bench_seed(1);
    bed = calloc(1, sizeof *bed);
    T_OK(bed != NULL && (bed->work = rec_photo_work_new(W, H)) != NULL);
    T_OK(shots_new(&take, FLAME_RING, EVEN, CAMERAS, NULL));
    for (int m = 0; m < N_MISTAKES; m++)
        if (m != M_EARLY_1 && m != M_LATE_TWO && /* the flame hardly changes */
            (m == M_SWAP_NEAR || !T_TSAN))
            judge((enum mistake)m, 0.01, &v);
    judge(N_MISTAKES, 0.05, &v);
    rec_plausible_line(&v, line);
    T_EQ_I(strncmp(line, "good: 6 cameras agree, ", 23), 0);
    v.residual = 0.024;
    v.noise = 0.001;
    rec_plausible_line(&v, line);
    T_CONTAINS(line, "good: residual 2.4 % (noise allows 0.1 %), 6 cameras agree, ");
    T_OK(strstr(line, "next:") == NULL);
    v.residual = 0.187;
    rec_plausible_line(&v, line);
    T_CONTAINS(line,
               "fair: residual 18.7 % (noise allows 0.1 %): calibration or model; 6 cameras ");
    T_CONTAINS(line, "; next: pyrovox advise --rig rig.yaml --frames DIR");
    v.noise = 0.1;
    rec_plausible_line(&v, line);
    T_CONTAINS(line, "good: residual 18.7 % (noise allows 10.0 %), ");
    judge(M_BOX_Z, 0.01, &v);
    T_OK(v.meaningless);
    rec_plausible_line(&v, line);
    T_CONTAINS(line, "bad: ");
    T_CONTAINS(line, "% of the flame's light lies on rays that miss the volume: the flame reaches "
                     "beyond z = 0.75");
    T_CONTAINS(line, "; next: in rig.yaml make z of max at least ");
    shots_free(&take);
    free(bed->work);
    free(bed);
}

/* From set to set it changes by less than coarse volumes miss: lags.h. */
T_CASE(cameras_that_are_late_of_a_slow_flame)
{
    struct rec_plausible_verdict v;
    T_NOT_UNDER_SANITIZERS();
    bench_seed(1);
    bed = calloc(1, sizeof *bed);
    T_OK(bed != NULL && (bed->work = rec_photo_work_new(W, H)) != NULL);
    T_OK(shots_new(&take, FLAME_WALL, EVEN, 8, NULL));
    for (int m = M_LATE_1; m <= M_LATE_TWO; m++) {
        judge((enum mistake)m, 0.01, &v);
        T_CONTAINS(v.text, "by how the flame changes in them");
    }
    judge(N_MISTAKES, 0.01, &v);
    shots_free(&take);
    free(bed->work);
    free(bed);
}

/* Without flame, and without a picture, nothing is said of the rig. */
T_CASE(says_where_there_is_nothing_to_judge)
{
    struct rec_rig rig;
    rec_plausible *p;
    struct rec_plausible_verdict v;
    T_EQ_I(rec_rig_ring(4, 2, W, H, 24, &rig), PVX_OK);
    T_EQ_I(rec_plausible_new(&rig, 1, &p), PVX_OK);
    rec_plausible_add(p, &(struct rec_plausible_set){.nch = 1, .cs = 1});
    T_EQ_I(rec_plausible_judge(p, REC_PLAUSIBLE_HYPOTHESES, NULL, NULL, &v), PVX_OK);
    T_EQ_S(rec_cause_name(v.cause), "dark");
    rec_plausible_begin(p);
    T_EQ_I(rec_plausible_judge(p, REC_PLAUSIBLE_FACTS, NULL, NULL, &v), PVX_OK);
    T_EQ_S(rec_cause_name(v.cause), "dark");
    rec_plausible_free(&p);
    rec_rig_fini(&rig);
}

/* A remedy that was followed is not given again. */
T_CASE(a_remedy_is_not_given_twice)
{
    struct rec_rig rig;
    rec_plausible *p;
    struct rec_plausible_verdict v;
    static float b[W * H], weight[W * H];
    static uint8_t lit[W * H];
    struct rec_plausible_set s = {.nch = 1, .cs = 1};
    for (int i = 0; i < W * H; i++) {
        b[i] = 1;
        lit[i] = i % W < 20;
        weight[i] = i % 3 > 0;
    }
    for (int c = 0; c < 4; c++) {
        s.b[c] = b;
        s.weight[c] = weight;
        s.lit[c] = lit;
    }
    T_EQ_I(rec_rig_ring(4, 2, W, H, 24, &rig), PVX_OK);
    T_EQ_I(rec_plausible_new(&rig, 1, &p), PVX_OK);
    rec_plausible_add(p, &s);
    T_EQ_I(rec_plausible_judge(p, REC_PLAUSIBLE_FACTS, NULL, NULL, &v), PVX_OK);
    T_EQ_S(rec_cause_name(v.cause), "saturated");
    T_CONTAINS(v.next, "--saturated at-least");
    rec_plausible_at_least(p);
    T_EQ_I(rec_plausible_judge(p, REC_PLAUSIBLE_FACTS, NULL, NULL, &v), PVX_OK);
    T_EQ_S(rec_cause_name(v.cause), "saturated");
    T_EQ_S(v.next, "expose a quarter as long");
    rec_plausible_free(&p);
    rec_rig_fini(&rig);
}

/* Pictures of which all counts as flame: a black level is flat.  A flame that fills the pictures is not refused. */
T_CASE(tells_a_black_level_from_a_flame_that_fills_the_pictures)
{
    enum { N = 4 };
    struct rec_rig rig;
    rec_plausible *p;
    struct rec_plausible_verdict v;
    float *b = calloc((size_t)W * H, sizeof *b);
    uint8_t *lit = malloc((size_t)W * H);
    struct rec_plausible_set s = {.nch = 1, .cs = 1};
    T_OK(b != NULL && lit != NULL);
    memset(lit, 1, (size_t)W * H);
    for (int c = 0; c < N; c++) {
        s.b[c] = b;
        s.lit[c] = lit;
    }
    T_EQ_I(rec_rig_ring(N, 2, W, H, 24, &rig), PVX_OK);
    T_EQ_I(rec_plausible_new(&rig, 1, &p), PVX_OK);
    for (int flame = 0; flame < 2; flame++) {
        for (int i = 0; i < W * H; i++) {
            double x = (i % W + 0.5) / W - 0.5, y = (i / W + 0.5) / H - 0.5;
            b[i] =
                flame ? (float)(0.8 * exp(-12 * (x * x + y * y))) : 0.08F + (float)(i % 3) * 0.01F;
        }
        rec_plausible_begin(p);
        rec_plausible_add(p, &s);
        T_EQ_I(rec_plausible_judge(p, REC_PLAUSIBLE_FACTS, NULL, NULL, &v), PVX_OK);
        T_EQ_S(rec_cause_name(v.cause), flame ? "" : "black");
        T_EQ_I(v.meaningless, !flame);
    }
    T_CONTAINS(v.text, "cameras agree");
    atomic_bool stop = true; /* on request, hypotheses end */
    rec_plausible_stop(p, &stop);
    T_EQ_I(rec_plausible_judge(p, REC_PLAUSIBLE_HYPOTHESES, NULL, NULL, &v), PVX_ECANCELED);
    atomic_store(&stop, false);
    T_EQ_I(rec_plausible_judge(p, REC_PLAUSIBLE_HYPOTHESES, NULL, NULL, &v), PVX_OK);
    T_OK(v.before > 0);
    rec_plausible_free(&p);
    rec_rig_fini(&rig);
    free(b);
    free(lit);
}
