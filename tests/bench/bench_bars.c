/* bench_bars.c - whether error bars (recon/frame/bars.h) hold the truth: NUMERICS.md, 21.
 *
 * Coverage: of how many voxels in percent the truth lies within 1.96 standard deviations, per channel, among the voxels
 * above 2 % of the brightest (sum of the channels), and of 300 random boxes the sum.  Wanted: 95, at least 93 and at most
 * 97 overall, 88 to 99 in each class:
 *   rim   within two voxels of where it is darker than that;   core   the others
 *   thin  2.5 times as bright as the mean at two voxels around
 *   few   seen by at most half of the cameras, where the odd ones of 8 look past a part of the flame
 * `view`: mean square of what the view of a camera that no solve saw misses, over its predicted variance, with its own noise:
 * wanted 0.8 to 1.25.  `sd`: root mean square of the bars over that of the errors.  `cost`: processor time of a set with its bars over
 * that without, the least of TURNS each.  `total`: root mean square over the channels of the error of the whole light over its bar;
 * of means, over flames too.  Wanted: at most 1.25.
 * bars_scenes.h has the flames on which constants were chosen (`chosen on`) and the others (`judged`).  doubt: bits of
 * recon/frame/bars.h; marked: of a mean, percent of the flames that have one.  48^3, 120x90, trilinear, K = 16.
 *
 * plume: ScalarFlow's real capture, frame PLUME_AT, 64x96x64, each of the five cameras left out: `view` and,
 * for the same view, `sd`, with the noise that the other pictures have, over the pixels whose rays meet the hull and after
 * the gain of that view.  outside: percent of its light whose rays meet no voxel.
 *
 *     bench_bars [FOLDER [FLAME [CASE]]] */
#include "bars.h"
#include "bars_scenes.h"
#include "capture/pixel/pixfmt.h"
#include "plume.h"
#include "wrong.h"

#define BOXES     300
#define TURNS     2
#define PLUME_AT  75
#define PLUME_BIN 4
#define COUNT(a)  (sizeof(a) / sizeof *(a))

/* ---- one case -----------------------------------------------------------------------------------*/

struct outcome {
    double held[N_CLASSES], boxes, view, sd, cost, total;
    uint32_t doubt;
};

static double cost_turn(rec_frame *f, rec_bars *b, const struct shot *shot, uint64_t seed,
                        struct rec_bars_view *v, double *without)
{
    shot_put(shot, f);
    double t0 = bench_cpu();
    rec_frame_carve(f);
    CHECK(rec_frame_solve(f, 0, NULL));
    double t1 = bench_cpu();
    CHECK(rec_frame_bars(f, b, seed, v));
    *without = fmin(*without, t1 - t0);
    return bench_cpu() - t0;
}

static bool judge(const struct bars_flame *flame, const struct bars_case *k, uint64_t seed,
                  pvx_pool *pool, struct outcome *out)
{
    const struct noise noise = {k->name, k->noise, 0};
    struct scene s;
    struct shot shot;
    struct rec_frame_params p = rec_frame_defaults;
    struct rec_bars_view v;
    rec_frame *f;
    rec_bars *b;
    double with = INFINITY, without = INFINITY;
    bars_rig(&s, k);
    if (!bars_burn(&s, flame, pool))
        return false;
    wrong_scene(wrong_named(k->wrong), &s, seed, pool);
    shot_new(&shot, &s, &noise, seed);
    s.rig.grid.basis = REC_TRILINEAR;
    rec_sysmat *S = scene_matrix(&s, 0, pool);
    scene_truth(&s, REC_TRILINEAR, pool);
    p.nch = s.nch;
    p.photo.saturation = 1e30F;
    CHECK(rec_frame_alone(S, &s.rig, &p, pool, &f, NULL));
    CHECK(rec_bars_new(S, s.nch, REC_BARS_USUAL, &b, NULL));
    for (int turn = 0; turn < TURNS; turn++)
        with = fmin(with, cost_turn(f, b, &shot, seed, &v, &without));
    struct dense_bars d;
    dense_bars_new(&d, &s, f, &v);
    out->cost = with / without;
    out->doubt = v.doubt;
    bars_classes(&d, k->narrow, out->held);
    out->sd = bars_size(&d);
    out->boxes = bars_boxes(&d, BOXES, seed);
    out->total = bars_total(&d);
    struct bars_look look = {.sigma = k->noise * s.peak};
    out->view = bars_view(&d, &look, pool);
    dense_bars_free(&d);
    rec_bars_free(&b);
    rec_frame_free(&f);
    rec_sysmat_free(&S);
    shot_free(&shot);
    scene_fini(&s);
    return true;
}

/* ---- tables -------------------------------------------------------------------------------------*/

/* A row: classes, boxes, view, sd, cost, light outside, total, and of means the share of flames with a doubt. */
#define N_OUT (N_CLASSES + 7)

static void outcome_row(const struct outcome *o, double v[N_OUT])
{
    memcpy(v, o->held, sizeof o->held);
    v[N_CLASSES] = o->boxes;
    v[N_CLASSES + 1] = o->view;
    v[N_CLASSES + 2] = o->sd;
    v[N_CLASSES + 3] = o->cost;
    v[N_CLASSES + 4] = NAN;
    v[N_CLASSES + 5] = o->total;
    v[N_CLASSES + 6] = o->doubt != 0 ? 100 : 0;
}

/* Mean over flames, without those that have no such voxel. */
struct mean {
    double sum[N_OUT];
    int n[N_OUT];
};
static void mean_add(struct mean *m, const double v[N_OUT])
{
    for (int i = 0; i < N_OUT; i++)
        if (isfinite(v[i])) {
            m->sum[i] += v[i];
            m->n[i]++;
        }
}
static void row(FILE *csv, const char *flame, const char *use, const char *name,
                const double v[N_OUT], uint32_t doubt)
{
    char line[512];
    int at = snprintf(line, sizeof line, "%s,%s,%s", flame, use, name);
    for (int i = 0; i < N_OUT; i++) {
        bool fine = i > N_CLASSES && i != N_CLASSES + 4 && i < N_CLASSES + 6;
        at += snprintf(line + at, sizeof line - (size_t)at,
                       !isfinite(v[i]) ? ",-"
                       : fine          ? ",%.2f"
                                       : ",%.1f",
                       v[i]);
    }
    bench_row(csv, "%s,%u", line, doubt);
}

/* ---- a real capture -----------------------------------------------------------------------------*/

static float *plume_picture(const struct rec_camera *c)
{
    cap_video *v = plume_video(c);
    float *out = must_floats((size_t)c->width * (size_t)c->height);
    for (int at = 0; v != NULL && at <= PLUME_AT; at++) {
        struct cap_image img = plume_next(v, c, PLUME_BIN);
        if (at == PLUME_AT)
            CHECK(cap_bin(&img, PLUME_BIN, 1, 0, c->height, out));
    }
    cap_video_close(&v);
    return out;
}

/* s: the four cameras that are used, the fifth and its picture. */
static void plume_judge(FILE *csv, struct scene *s, float *const image[], pvx_pool *pool)
{
    struct rec_frame_params p = rec_frame_defaults;
    struct rec_bars_view v;
    struct dense_bars d;
    double o[N_OUT];
    rec_frame *f;
    rec_bars *b;
    rec_sysmat *S = scene_matrix(s, 1, pool);
    p.nch = 1;
    CHECK(rec_frame_alone(S, &s->rig, &p, pool, &f, NULL));
    CHECK(rec_bars_new(S, 1, REC_BARS_USUAL, &b, NULL));
    rec_frame_reset(f);
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        memcpy(rec_frame_input(f, c), image[c],
               (size_t)s->unseen.width * (size_t)s->unseen.height * sizeof(float));
        rec_frame_camera(f, c)->present = true;
    }
    rec_frame_carve(f);
    CHECK(rec_frame_solve(f, 0, NULL));
    CHECK(rec_frame_bars(f, b, PLUME_AT, &v));
    dense_bars_new(&d, s, f, &v);
    for (int i = 0; i < N_OUT; i++)
        o[i] = NAN;
    struct bars_look look = {.sigma = (double)rec_frame_get_report(f)->sigma, .real = true};
    o[N_CLASSES + 1] = bars_view(&d, &look, pool);
    o[N_CLASSES + 2] = look.size;
    o[N_CLASSES + 4] = 100 * look.outside;
    row(csv, "plume", "real", s->unseen.name, o, v.doubt);
    dense_bars_free(&d);
    rec_bars_free(&b);
    rec_frame_free(&f);
    rec_sysmat_free(&S);
}

static void plume(FILE *csv, pvx_pool *pool)
{
    struct rec_camera cam[PLUME_CAMERAS], used[PLUME_CAMERAS];
    struct rec_grid g;
    float *image[PLUME_CAMERAS], *in[PLUME_CAMERAS];
    if (!plume_rig(PLUME_BIN, cam, &g))
        return;
    g.basis = REC_TRILINEAR;
    for (int c = 0; c < PLUME_CAMERAS; c++)
        image[c] = plume_picture(&cam[c]);
    for (int out = 0; out < PLUME_CAMERAS && *bench_status() == 0; out++) {
        struct scene s = {.nch = 1, .unseen = cam[out], .unseen_image = image[out]};
        size_t n = 0;
        for (int c = 0; c < PLUME_CAMERAS; c++)
            if (c != out) {
                in[n] = image[c];
                used[n++] = cam[c];
            }
        s.rig = (struct rec_rig){.grid = g, .n_cameras = n, .cameras = used};
        s.truth = must_floats(rec_grid_count(&g));
        plume_judge(csv, &s, in, pool);
        free(s.truth);
    }
    for (int c = 0; c < PLUME_CAMERAS; c++)
        free(image[c]);
}

/* Flames at 96^3 take minutes: some stand for all. */
static bool bars_skips(const struct bars_flame *f, const struct bars_case *k)
{
    static const char *const of[] = {"ring", "jet", "sheets", "pool"};
    bool skips = k->voxels > 64;
    for (size_t i = 0; i < COUNT(of); i++)
        skips = skips && strcmp(of[i], f->name) != 0;
    return skips;
}

static bool bars_asked(int argc, char **argv, int at, const char *name)
{
    return argc <= at || *argv[at] == '\0' || strcmp(argv[at], name) == 0;
}

int main(int argc, char **argv)
{
    static struct mean mean[2][COUNT(bars_cases) + 1];
    static const char *const uses[2] = {"chosen on", "judged"};
    double v[N_OUT];
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    FILE *csv = bench_csv(
        argc, argv, "bars",
        "flame,use,case,all,rim,core,thin,few,boxes,view,sd,cost,outside,total,marked,doubt");
    for (size_t i = 0; i < COUNT(bars_flames); i++)
        for (size_t k = 0; k < COUNT(bars_cases); k++) {
            const struct bars_flame *flame = &bars_flames[i];
            const struct bars_case *of = &bars_cases[k];
            struct outcome o;
            if (!bars_asked(argc, argv, 2, flame->name) || !bars_asked(argc, argv, 3, of->name) ||
                bars_skips(flame, of) || !judge(flame, of, 1 + 100 * i + k, pool, &o))
                continue;
            int use = flame->judged;
            outcome_row(&o, v);
            mean_add(&mean[use][k], v);
            mean_add(&mean[use][COUNT(bars_cases)], v);
            row(csv, flame->name, uses[use], of->name, v, o.doubt);
        }
    for (int use = 0; use < 2; use++)
        for (size_t k = 0; k <= COUNT(bars_cases); k++) {
            const struct mean *m = &mean[use][k];
            for (int i = 0; i < N_OUT; i++)
                v[i] = m->n[i] > 0 ? m->sum[i] / m->n[i] : NAN;
            if (m->n[0] > 0)
                row(csv, "mean", uses[use],
                    k < COUNT(bars_cases) ? bars_cases[k].name : "all cases", v, 0);
        }
    if (argc <= 2 || strcmp(argv[2], "plume") == 0)
        plume(csv, pool);
    fclose(csv);
    pvx_pool_free(&pool);
    return *bench_status();
}
