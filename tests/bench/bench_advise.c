/* bench_advise.c - `pyrovox advise` on random scenes whose needs are known: what it finds, what it misses and what it
 * switches on in vain, term by term.
 *
 *   bench_advise [DIR] [SCENES] [FIRST]
 * Numbers from FIRST on (default 500); below zero, of flames that are not held out.  Thresholds were chosen on -80 to -1
 * and, of response and absorption, on 300 to 379; judged on 400 to 453.  0 to 23 and 200 to 299 were looked at before. */
#include "advise_scenes.h"

struct tally {
    int right, missed, in_vain, needed;
};

static void look(FILE *csv, long number, struct tally *t, pvx_pool *pool)
{
    struct advise_scene s;
    struct advice a;
    struct pvx_diag d = {""};
    int64_t t0 = pvx_now_mono();
    advise_scene_new(&s, (uint64_t)(number + (1L << 40)), number >= 0, pool);
    double made = ms(pvx_now_mono() - t0) * 1e-3;
    bool need[ADVISE_TERMS], on[ADVISE_TERMS];
    bench_check(advise_terms(&s.sets, &a, &d), &d);
    advise_verdict(&s, &a, need, on);
    char verdict[ADVISE_TERMS + 1] = "";
    for (int k = 0; k < ADVISE_TERMS; k++) {
        t[k].needed += need[k];
        t[k].right += need[k] == on[k];
        t[k].missed += need[k] && !on[k];
        t[k].in_vain += !need[k] && on[k];
        verdict[k] = need[k] ? (on[k] ? '+' : 'M') : on[k] ? 'V' : '.';
    }
    bench_row(csv,
              "%ld,%s,%zu,%s,%.3f,%.3f,%.3f,%.1f,%.1f,%.3f,%.2f,%.3f,%zu,%.3f,%zu,%.4f,%.4f,%.3f,%."
              "2f,%.1f,%.1f",
              number, s.flame, s.sets.rig.n_cameras, verdict, s.sigma, s.level, a.level[a.darkest],
              100 * s.at_top, 100 * a.saturated, s.depth, a.absorption.gain, s.off, s.which,
              1 / a.gain.gain[a.gain.worst], a.gain.worst, a.gain.error[0], a.gain.error[1],
              s.hidden, a.response.power, made, ms(pvx_now_mono() - t0) * 1e-3 - made);
    advise_scene_free(&s);
}

int main(int argc, char **argv)
{
    pvx_pool *pool;
    struct tally t[ADVISE_TERMS] = {0};
    long n = argc > 2 ? atol(argv[2]) : 24, first = argc > 3 ? atol(argv[3]) : 500;
    CHECK(pvx_pool_new(2, "bench", &pool));
    printf("\nadvise on %ld random scenes; %d sets of %d x %d; + needed and found, . neither, M "
           "missed, V in vain:",
           n, SEEN_SETS, SEEN_W, SEEN_H);
    for (int k = 0; k < ADVISE_TERMS; k++)
        printf(" %s", advise_term_names[k]);
    putchar('\n');
    FILE *csv =
        bench_csv(argc, argv, "advise",
                  "scene,flame,cameras,verdict,noise,level,level found,saturated,found,depth,"
                  "absorption buys,gain,of,gain found,of,error,with gains,hidden,power,made_s,s");
    for (long i = first; i < first + n; i++)
        look(csv, i, t, pool);
    printf("\n%12s needed  right missed in vain\n", "");
    for (int k = 0; k < ADVISE_TERMS; k++)
        printf("%12s %6d %5.1f%% %6d %7d\n", advise_term_names[k], t[k].needed,
               100.0 * t[k].right / (double)n, t[k].missed, t[k].in_vain);
    fclose(csv);
    pvx_pool_free(&pool);
    return *bench_status();
}
