/* bench_running.c - whether live error bars (recon/frame/running.h) hold the truth of flames that move: NUMERICS.md, 21.
 *
 * SETS sets of a moving flame (moving.h), one more solve each.  At the sets of JUDGED the bars that a volume is sent with,
 * from the sets before it, are held against the truth as in bench_bars, and beside them the K = 16 solves of the same set.
 * `all` `thin`: coverage in percent; `sd`: root mean square of the bars over that of the errors; `cost`: processor time
 * of a set with its more solve over that without, the least over the sets of each.
 * Choices were made on ring, campfire, gauss40 and ragged (`chosen on`); all others judge.
 * 48^3, 120x90, 8 cameras, trilinear.
 *
 * plume: ScalarFlow's real capture, five cameras on an arc, 30/s, whose truth nobody knows: root mean square of the live
 * bars over that of the K = 16 solves, on the voxels above 2 % of the brightest, at each set that is judged.
 *
 *     bench_running [FOLDER [FLAME]] */
#include "bars.h"
#include "moving.h"
#include "capture/pixel/pixfmt.h"
#include "plume.h"
#include "recon/frame/running.h"
#include "shot.h"

#define SETS       32
#define JUDGED(k)  ((k) >= 19 && (k) % 4 == 3)
#define PLUME_FROM 60
#define PLUME_BIN  4
#define PERIOD_NS  (50 * PVX_NS_PER_MS)
#define COUNT(a)   (sizeof(a) / sizeof *(a))

static const struct moving_case {
    double speed; /* moving.h */
    double noise;
} cases[] = {{0, 0.01}, {0.5, 0.01}, {2, 0.01}, {6, 0.01}, {1, 0.005}, {1, 0.05}};
static const enum flame_kind of[] = {FLAME_RING, FLAME_CAMPFIRE, FLAME_GAUSS40, FLAME_RAGGED,
                                     FLAME_JET,  FLAME_HOLLOW,   FLAME_CANDLES, FLAME_SHEETS,
                                     FLAME_WALL, FLAME_SHELL,    FLAME_POOL};

/* Sums over the sets that were judged, live and with K = 16: all, thin, sd. */
struct outcome {
    double sum[2][3], n[2][3], without, with;
};

static void outcome_add(struct outcome *o, int which, const struct dense_bars *d)
{
    double held[N_CLASSES], v[3];
    bars_classes(d, false, held);
    v[0] = held[CLASS_ALL];
    v[1] = held[CLASS_THIN];
    v[2] = bars_size(d);
    for (int i = 0; i < 3; i++)
        if (isfinite(v[i])) {
            o->sum[which][i] += v[i];
            o->n[which][i]++;
        }
}
static double outcome_mean(const struct outcome *o, int which, int i)
{
    return o->n[which][i] > 0 ? o->sum[which][i] / o->n[which][i] : NAN;
}

/* ---- a sequence ---------------------------------------------------------------------------------*/

struct sequence {
    rec_frame *f;
    rec_sysmat *S;
    rec_average *average;
    rec_running *running;
    rec_bars *bars;
    pvx_pool *pool;
};

static void sequence_new(struct sequence *q, const struct scene *s, pvx_pool *pool)
{
    struct rec_frame_params p = rec_frame_defaults;
    p.nch = s->nch;
    p.photo.saturation = 1e30F;
    q->pool = pool;
    q->S = scene_matrix(s, 0, pool);
    CHECK(rec_frame_alone(q->S, &s->rig, &p, pool, &q->f, NULL));
    CHECK(rec_running_new(q->S, s->nch, PVX_NS_PER_S, &q->running, NULL));
    CHECK(rec_bars_new(q->S, s->nch, REC_BARS_USUAL, &q->bars, NULL));
}

static void sequence_free(struct sequence *q)
{
    rec_bars_free(&q->bars);
    rec_running_free(&q->running);
    rec_frame_free(&q->f);
    rec_sysmat_free(&q->S);
}

/* The frame that was filled, solved, and once more; bars: those that the volume is sent with. */
static void sequence_step(struct sequence *q, int k, struct outcome *o, struct rec_bars_view *bars)
{
    double t0 = bench_cpu();
    rec_frame_carve(q->f);
    CHECK(rec_frame_solve(q->f, 0, NULL));
    double t1 = bench_cpu();
    rec_running_bars(q->running, q->f, k * PERIOD_NS, q->pool, bars);
    struct rec_running_set set = {.seed = 1 + (uint64_t)k, .t_ns = k * PERIOD_NS};
    if (!JUDGED(k))
        (void)rec_running_add(q->running, q->f, &set);
    double t2 = bench_cpu();
    if (k > 2 && !JUDGED(k)) {
        o->without = fmin(o->without, t1 - t0);
        o->with = fmin(o->with, t2 - t0);
    }
}

static bool sequence_judge(enum flame_kind kind, const struct moving_case *c, uint64_t seed,
                           pvx_pool *pool, struct outcome *o)
{
    struct moving m;
    struct scene s;
    struct sequence q;
    struct noise noise = {"", c->noise, 0};
    double peak = 0;
    *o = (struct outcome){.with = INFINITY, .without = INFINITY};
    if (!moving_new(&m, kind, c->speed))
        return false;
    for (int k = 0; k < SETS; k++) {
        struct shot shot;
        struct rec_bars_view live, whole;
        scene_views(&s, &views_8, 120, 90, 48);
        s.rig.grid.basis = REC_TRILINEAR;
        moving_burn(&m, k, &s, &peak, pool);
        scene_truth(&s, REC_TRILINEAR, pool);
        shot_new(&shot, &s, &noise, seed + (uint64_t)k);
        if (k == 0)
            sequence_new(&q, &s, pool);
        shot_put(&shot, q.f);
        sequence_step(&q, k, o, &live);
        if (JUDGED(k)) {
            struct dense_bars d;
            CHECK(rec_frame_bars(q.f, q.bars, (uint64_t)k, &whole));
            dense_bars_new(&d, &s, q.f, &live);
            outcome_add(o, 0, &d);
            d.v = whole;
            outcome_add(o, 1, &d);
            dense_bars_free(&d);
            struct rec_running_set set = {.seed = 1 + (uint64_t)k, .t_ns = k * PERIOD_NS};
            (void)rec_running_add(q.running, q.f, &set);
        }
        shot_free(&shot);
        scene_fini(&s);
    }
    sequence_free(&q);
    moving_free(&m);
    return true;
}

/* ---- a real capture -----------------------------------------------------------------------------*/

/* The next picture of each camera. */
static void plume_pictures(cap_video *const video[], const struct rec_camera *cam, float *out[])
{
    for (int c = 0; c < PLUME_CAMERAS; c++) {
        struct cap_image img = plume_next(video[c], &cam[c], PLUME_BIN);
        CHECK(cap_bin(&img, PLUME_BIN, 1, 0, cam[c].height, out[c]));
    }
}

/* Root mean square of sd over that of `other`, on the voxels above 2 % of the brightest. */
static double plume_ratio(const rec_frame *f, const float *sd, const float *other)
{
    struct rec_sparse x;
    double top = 0, a = 0, b = 0;
    rec_frame_volume(f, &x);
    for (int32_t q = 0; q < x.n; q++)
        top = fmax(top, (double)x.value[q]);
    for (int32_t q = 0; q < x.n; q++)
        if ((double)x.value[q] > BARS_LIT * top) {
            a += (double)sd[q] * (double)sd[q];
            b += (double)other[q] * (double)other[q];
        }
    return sqrt(a / b);
}

static void plume_set(struct sequence *q, const struct scene *s, int k, float *const in[],
                      FILE *csv)
{
    struct outcome o = {.with = INFINITY, .without = INFINITY};
    struct rec_bars_view live, whole;
    char name[32];
    rec_frame_reset(q->f);
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        const struct rec_camera *cam = &s->rig.cameras[c];
        memcpy(rec_frame_input(q->f, c), in[c],
               (size_t)cam->width * (size_t)cam->height * sizeof(float));
        rec_frame_camera(q->f, c)->present = true;
    }
    sequence_step(q, k, &o, &live);
    if (!JUDGED(k))
        return;
    CHECK(rec_frame_bars(q->f, q->bars, (uint64_t)k, &whole));
    snprintf(name, sizeof name, "frame %d", PLUME_FROM + k);
    bench_row(csv, "plume,real,%s,,,%.2f,,,,", name, plume_ratio(q->f, live.sd, whole.sd));
    struct rec_running_set set = {.seed = 1 + (uint64_t)k, .t_ns = k * PERIOD_NS};
    (void)rec_running_add(q->running, q->f, &set);
}

static void plume(FILE *csv, pvx_pool *pool)
{
    struct rec_camera cam[PLUME_CAMERAS];
    struct rec_grid g;
    cap_video *video[PLUME_CAMERAS];
    float *image[PLUME_CAMERAS];
    struct sequence q;
    if (!plume_rig(PLUME_BIN, cam, &g))
        return;
    g.basis = REC_TRILINEAR;
    for (int c = 0; c < PLUME_CAMERAS; c++) {
        image[c] = must_floats((size_t)cam[c].width * (size_t)cam[c].height);
        video[c] = plume_video(&cam[c]);
        if (video[c] == NULL)
            return;
    }
    struct scene s = {.nch = 1};
    s.rig = (struct rec_rig){.grid = g, .n_cameras = PLUME_CAMERAS, .cameras = cam};
    sequence_new(&q, &s, pool);
    for (int at = 0; at < PLUME_FROM + SETS; at++) {
        plume_pictures(video, cam, image);
        if (at >= PLUME_FROM)
            plume_set(&q, &s, at - PLUME_FROM, image, csv);
    }
    sequence_free(&q);
    for (int c = 0; c < PLUME_CAMERAS; c++) {
        cap_video_close(&video[c]);
        free(image[c]);
    }
}

/* ---- tables -------------------------------------------------------------------------------------*/

static void row(FILE *csv, const char *flame, const char *use, const char *name,
                const struct outcome *o)
{
    bench_row(csv, "%s,%s,%s,%.1f,%.1f,%.2f,%.1f,%.1f,%.2f,%.2f", flame, use, name,
              outcome_mean(o, 0, 0), outcome_mean(o, 0, 1), outcome_mean(o, 0, 2),
              outcome_mean(o, 1, 0), outcome_mean(o, 1, 1), outcome_mean(o, 1, 2),
              o->with / o->without);
}

/* A mean over flames of the means of each. */
static void outcome_join(struct outcome *all, const struct outcome *o)
{
    for (int i = 0; i < 6; i++) {
        double v = outcome_mean(o, i / 3, i % 3);
        if (isfinite(v)) {
            all->sum[i / 3][i % 3] += v;
            all->n[i / 3][i % 3]++;
        }
    }
    all->with += o->with / o->without;
    all->without++;
}

int main(int argc, char **argv)
{
    static struct outcome all[2][COUNT(cases) + 1];
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    FILE *csv =
        bench_csv(argc, argv, "running", "flame,use,case,all,thin,sd,all_16,thin_16,sd_16,cost");
    char name[64];
    for (size_t i = 0; i < COUNT(of); i++)
        for (size_t k = 0; k < COUNT(cases); k++) {
            struct outcome o;
            int judged = strcmp(flames[of[i]].use, "held out") == 0;
            if ((argc > 2 && strcmp(argv[2], flames[of[i]].name) != 0) ||
                !sequence_judge(of[i], &cases[k], 1 + 1000 * i + 100 * k, pool, &o))
                continue;
            outcome_join(&all[judged][k], &o);
            outcome_join(&all[judged][COUNT(cases)], &o);
            snprintf(name, sizeof name, "%g voxels a set %g %%", cases[k].speed,
                     100 * cases[k].noise);
            row(csv, flames[of[i]].name, judged ? "judged" : "chosen on", name, &o);
        }
    for (int judged = 0; judged < 2; judged++)
        for (size_t k = 0; k <= COUNT(cases); k++) {
            snprintf(name, sizeof name, "all cases");
            if (k < COUNT(cases))
                snprintf(name, sizeof name, "%g voxels a set %g %%", cases[k].speed,
                         100 * cases[k].noise);
            if (all[judged][k].without > 0)
                row(csv, "mean", judged ? "judged" : "chosen on", name, &all[judged][k]);
        }
    if (argc <= 2 || strcmp(argv[2], "plume") == 0)
        plume(csv, pool);
    fclose(csv);
    pvx_pool_free(&pool);
    return *bench_status();
}
