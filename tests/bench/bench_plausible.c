/* bench_plausible.c - are mistakes of rigs and recordings named rightly, and none where there is none?
 *
 * bench_plausible [DIR] [all|fitted|FLAME]   FLAME: on one rig only
 * Mistakes by flames and rigs into plausible.csv; then healthy recordings with noise, poses and gains that are off.
 * The constants of recon/check/plausible.c and trials.c were fitted on the flames that flames.h calls fitted and seen;
 * those that are held out are counted apart.  A mistake is named rightly if cause and cameras are right. */
#include "mistakes.h"

/* ---- tables ---- */

struct count {
    unsigned right, all;
};
static struct count named[N_MISTAKES][2], healthy[2], of_flame[N_FLAMES];

static const struct {
    const char *name;
    enum rig_kind kind;
    size_t n;
} rigs[] = {{"ring of 8", EVEN, 8}, {"dome of 6", DOME, 6}, {"mixed 12", MIXED, 12}};
enum { N_SHAPES = sizeof rigs / sizeof *rigs };

static void bench_mistakes(FILE *csv, struct bed *q, const struct shots *t, enum flame_kind f,
                           size_t r, unsigned draws)
{
    const bool held = strcmp(flames[f].use, "held out") == 0;
    for (int m = 0; m < N_MISTAKES; m++)
        for (unsigned i = 0; i < draws; i++) {
            struct rec_plausible_verdict v;
            bench_seed((uint64_t)(m * 1000 + (int)i * 100 + (int)f * 10) + r);
            struct case_of k = {.m = (enum mistake)m, .noise = 0.01, .poses = 0.3, .gains = 0.05};
            size_t n = t->rig.n_cameras;
            k.a = (size_t)(bench_even() * (double)n);
            k.b = m == M_SWAP_NEAR ? (k.a + 1) % n
                                   : (k.a + 2 + (size_t)(bench_even() * (double)(n - 3))) % n;
            bed_judge(q, t, &k, &v);
            bool ok = bed_right(&k, &v);
            named[m][held].all++;
            named[m][held].right += ok;
            of_flame[f].all++;
            of_flame[f].right += ok;
            fprintf(csv, "%s,%s,%s,%d,%s,%.4f,%.4f,%.3f,\"%s\"\n", flames[f].name, rigs[r].name,
                    mistakes[m].name, ok, rec_cause_name(v.cause), v.before, v.after, v.outside,
                    v.text);
        }
}

static void bench_healthy(FILE *csv, struct bed *q, const struct shots *t, enum flame_kind f,
                          size_t r, unsigned draws)
{
    const bool held = strcmp(flames[f].use, "held out") == 0;
    for (unsigned i = 0; i < draws; i++) {
        struct rec_plausible_verdict v;
        bench_seed((uint64_t)(900000 + (int)i * 100 + (int)f * 10) + r);
        static const double noise[] = {0, 0.01, 0.05, 0.1};
        struct case_of k = {.m = N_MISTAKES,
                            .noise = noise[i % 4],
                            .poses = 0.5 * (i / 4 % 2),
                            .gains = 0.1 * (i / 8 % 2)};
        bed_judge(q, t, &k, &v);
        bool ok = bed_right(&k, &v);
        healthy[held].all++;
        healthy[held].right += ok;
        fprintf(csv, "%s,%s,healthy,%d,%s,%.4f,%.4f,%.3f,\"noise %g poses %g gains %g: %s\"\n",
                flames[f].name, rigs[r].name, ok, rec_cause_name(v.cause), v.before, v.after,
                v.outside, k.noise, k.poses, k.gains, v.text);
    }
}

static void bench_print(void)
{
    struct count all[2] = {{0, 0}, {0, 0}};
    printf("\n%-24s %14s %14s\n", "mistake", "fitted, seen", "held out");
    for (int m = 0; m < N_MISTAKES; m++) {
        printf("%-24s %10u/%-3u %10u/%-3u\n", mistakes[m].name, named[m][0].right, named[m][0].all,
               named[m][1].right, named[m][1].all);
        for (int h = 0; h < 2; h++) {
            all[h].right += named[m][h].right;
            all[h].all += named[m][h].all;
        }
    }
    printf("%-24s %10u/%-3u %10u/%-3u\n", "all mistakes", all[0].right, all[0].all, all[1].right,
           all[1].all);
    printf("%-24s %10u/%-3u %10u/%-3u\n", "healthy, no alarm", healthy[0].right, healthy[0].all,
           healthy[1].right, healthy[1].all);
    for (int f = 0; f < N_FLAMES; f++)
        if (of_flame[f].all > 0)
            printf("%-24s %10u/%-3u  %s\n", flames[f].name, of_flame[f].right, of_flame[f].all,
                   flames[f].use);
}

int main(int argc, char **argv)
{
    static const enum flame_kind all[] = {FLAME_RING,   FLAME_CAMPFIRE, FLAME_RAGGED, FLAME_JET,
                                          FLAME_HOLLOW, FLAME_CANDLES,  FLAME_POOL,   FLAME_WALL};
    const char *what = argc > 2 ? argv[2] : "all";
    const bool fit = strcmp(what, "fitted") == 0, one = !fit && strcmp(what, "all") != 0;
    size_t n = fit ? 3 : sizeof all / sizeof *all; /* the first three are the fitted ones */
    pvx_pool *pool;
    FILE *csv = bench_csv(argc, argv, "plausible",
                          "flame,rig,mistake,right,cause,before,after,outside,text");
    struct bed *q = calloc(1, sizeof *q);
    CHECK(pvx_pool_new(0, "bench", &pool));
    CHECK(q != NULL && (q->work = rec_photo_work_new(W, H)) != NULL ? PVX_OK : PVX_ENOMEM);
    for (size_t i = 0; i < n; i++)
        for (size_t r = 0; r < (one ? 1 : N_SHAPES); r++) {
            enum flame_kind f = all[i];
            struct shots t;
            if (one && strcmp(flames[f].name, what) != 0)
                continue;
            bench_seed((uint64_t)f * 100 + r);
            if (!shots_new(&t, f, rigs[r].kind, rigs[r].n, pool))
                continue;
            bench_mistakes(csv, q, &t, f, r, 1);
            bench_healthy(csv, q, &t, f, r, 16);
            shots_free(&t);
        }
    bench_print();
    fclose(csv);
    free(q->work);
    free(q);
    pvx_pool_free(&pool);
    return *bench_status();
}
