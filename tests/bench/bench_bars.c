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
 * that without, the least of TURNS each.
 * Constants were chosen on ring, campfire, gauss40 and ragged (`chosen on`); all others judge (`judged`).
 * doubt: bits of recon/frame/bars.h.  48^3, 120x90, trilinear, K = 16.
 *
 * plume: ScalarFlow's real capture, frame PLUME_AT, 64x96x64, each of the five cameras left out: `view` and,
 * for the same view, `sd`, with the noise that the other pictures have.
 *
 *     bench_bars [FOLDER [FLAME [CASE]]] */
#include "bars.h"
#include "capture/pixel/pixfmt.h"
#include "plume.h"
#include "wrong.h"

#define BOXES     300
#define TURNS     3
#define PLUME_AT  75
#define PLUME_BIN 4

static const struct view_set views_4 = {"4 on a ring", 8, 4, 3, {0, 2, 4, 6}},
                             arc_6 = {"6 on 150 deg", 12, 6, 6, {0, 1, 2, 3, 4, 5}},
                             views_12 = {"12 on a ring",
                                         13,
                                         12,
                                         6,
                                         {0, 1, 2, 3, 4, 5, 7, 8, 9, 10, 11, 12}};
static const struct noise noise_half = {"0.5 %", 0.005, 0}, noise_2 = {"2 %", 0.02, 0};
static const int32_t size_48[3] = {120, 90, 48};

static const struct bars_case {
    const char *name;
    const struct view_set *views;
    const struct noise *noise;
    const char *wrong;
    bool narrow; /* odd cameras look past a part of the flame */
} cases[] = {
    {"8 cameras", &views_8, &noise_1, "exact", false},
    {"0.5 %", &views_8, &noise_half, "exact", false},
    {"5 %", &views_8, &noise_5, "exact", false},
    {"4 cameras", &views_4, &noise_1, "exact", false},
    {"6 on an arc", &arc_6, &noise_2, "exact", false},
    {"12 cameras", &views_12, &noise_1, "exact", false},
    {"poses", &views_8, &noise_1, "poses 0.3 px", false},
    {"gains", &views_8, &noise_1, "gains 5 %", false},
    {"narrow", &views_8, &noise_1, "exact", true},
};
static const enum flame_kind of[] = {FLAME_RING, FLAME_CAMPFIRE, FLAME_GAUSS40, FLAME_RAGGED,
                                     FLAME_JET,  FLAME_HOLLOW,   FLAME_CANDLES, FLAME_SHEETS,
                                     FLAME_WALL, FLAME_SHELL,    FLAME_POOL};
#define COUNT(a) (sizeof(a) / sizeof *(a))

static bool is_judged(enum flame_kind k)
{
    return strcmp(flames[k].use, "held out") == 0;
}

/* ---- one case -----------------------------------------------------------------------------------*/

struct outcome {
    double held[N_CLASSES], boxes, view, sd, cost;
    uint32_t doubt;
};

static void narrow(struct scene *s)
{
    for (size_t c = 1; c < s->rig.n_cameras; c += 2)
        s->rig.cameras[c].cy -= 0.35 * s->rig.cameras[c].height;
}

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

static bool judge(enum flame_kind kind, const struct bars_case *k, uint64_t seed, pvx_pool *pool,
                  struct outcome *out)
{
    struct scene s;
    struct shot shot;
    struct rec_frame_params p = rec_frame_defaults;
    struct rec_bars_view v;
    rec_frame *f;
    rec_bars *b;
    double with = INFINITY, without = INFINITY;
    scene_views(&s, k->views, size_48[0], size_48[1], size_48[2]);
    if (k->narrow)
        narrow(&s);
    if (!scene_burn(&s, kind, flames[kind].t, pool))
        return false;
    wrong_scene(wrong_named(k->wrong), &s, seed, pool);
    shot_new(&shot, &s, k->noise, seed);
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
    double size;
    out->view = bars_view(&d, k->noise->sigma * s.peak, &size, pool);
    dense_bars_free(&d);
    rec_bars_free(&b);
    rec_frame_free(&f);
    rec_sysmat_free(&S);
    shot_free(&shot);
    scene_fini(&s);
    return true;
}

/* ---- tables -------------------------------------------------------------------------------------*/

/* Mean over flames, without those that have no such voxel. */
struct mean {
    double sum[N_CLASSES + 4];
    int n[N_CLASSES + 4];
};
static void mean_add(struct mean *m, const struct outcome *o)
{
    double v[N_CLASSES + 4];
    memcpy(v, o->held, sizeof o->held);
    v[N_CLASSES] = o->boxes;
    v[N_CLASSES + 1] = o->view;
    v[N_CLASSES + 2] = o->sd;
    v[N_CLASSES + 3] = o->cost;
    for (int i = 0; i < N_CLASSES + 4; i++)
        if (isfinite(v[i])) {
            m->sum[i] += v[i];
            m->n[i]++;
        }
}
static void row(FILE *csv, const char *flame, const char *use, const char *name, const double *v,
                uint32_t doubt)
{
    char field[N_CLASSES + 4][32];
    for (int i = 0; i < N_CLASSES + 4; i++) {
        snprintf(field[i], sizeof field[i], i <= N_CLASSES ? "%.1f" : "%.2f", v[i]);
        if (!isfinite(v[i]))
            snprintf(field[i], sizeof field[i], "-");
    }
    bench_row(csv, "%s,%s,%s,%s,%s,%s,%s,%s,%s,%s,%s,%s,%u", flame, use, name, field[0], field[1],
              field[2], field[3], field[4], field[5], field[6], field[7], field[8], doubt);
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
    double o[N_CLASSES + 4];
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
    for (int i = 0; i < N_CLASSES + 4; i++)
        o[i] = NAN;
    o[N_CLASSES + 1] =
        bars_view(&d, -(double)rec_frame_get_report(f)->sigma, &o[N_CLASSES + 2], pool);
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

int main(int argc, char **argv)
{
    static struct mean mean[2][COUNT(cases) + 1];
    static const char *const uses[2] = {"chosen on", "judged"};
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    FILE *csv = bench_csv(argc, argv, "bars",
                          "flame,use,case,all,rim,core,thin,few,boxes,view,sd,cost,doubt");
    for (size_t i = 0; i < COUNT(of); i++)
        for (size_t k = 0; k < COUNT(cases); k++) {
            struct outcome o;
            double v[N_CLASSES + 4];
            if ((argc > 2 && *argv[2] != '\0' && strcmp(argv[2], flames[of[i]].name) != 0) ||
                (argc > 3 && strcmp(argv[3], cases[k].name) != 0) ||
                !judge(of[i], &cases[k], 1 + 10 * i + k, pool, &o))
                continue;
            int judged = is_judged(of[i]);
            mean_add(&mean[judged][k], &o);
            mean_add(&mean[judged][COUNT(cases)], &o);
            memcpy(v, o.held, sizeof o.held);
            v[N_CLASSES] = o.boxes;
            v[N_CLASSES + 1] = o.view;
            v[N_CLASSES + 2] = o.sd;
            v[N_CLASSES + 3] = o.cost;
            row(csv, flames[of[i]].name, uses[judged], cases[k].name, v, o.doubt);
        }
    for (int judged = 0; judged < 2; judged++)
        for (size_t k = 0; k <= COUNT(cases); k++) {
            const struct mean *m = &mean[judged][k];
            double v[N_CLASSES + 4];
            for (int i = 0; i < N_CLASSES + 4; i++)
                v[i] = m->n[i] > 0 ? m->sum[i] / m->n[i] : NAN;
            if (m->n[0] > 0)
                row(csv, "mean", uses[judged], k < COUNT(cases) ? cases[k].name : "all cases", v,
                    0);
        }
    if (argc <= 2 || strcmp(argv[2], "plume") == 0)
        plume(csv, pool);
    fclose(csv);
    pvx_pool_free(&pool);
    return *bench_status();
}
