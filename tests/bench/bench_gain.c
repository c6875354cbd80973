/* bench_gain.c - gains by a flame: the integrated emission alone, then alternately with the reconstruction.
 *
 * Eight cameras, 160x120, gains wrong by so much rms at random (log-normal, other numbers for every row), poses off
 * by so many pixels rms, noise of so much of the peak.  Of each flame as many instants as there are; two thirds fit,
 * the last third judges.  "cut": two cameras see the left two thirds of the flame's light only; they begin with a
 * gain of 1.  Errors are rms over cameras of the logarithm, once the geometric mean is taken out; E: unseen views of
 * the sets that were held out.  What is chosen was chosen on ring and campfire. */
#include "check_shots.h"
#include "recon/check/gains.h"
#include "recon/light/light.h"

static FILE *csv;

struct row {
    double wrong, noise, px;
    bool cut;
};

static double off(const double *gain, const double *want, size_t n)
{
    double mean = 0, s = 0;
    for (size_t c = 0; c < n; c++)
        mean += log(gain[c] / want[c]) / (double)n;
    for (size_t c = 0; c < n; c++)
        s += pow(log(gain[c] / want[c]) - mean, 2) / (double)n;
    return sqrt(s);
}

/* The columns that hold two thirds of the light, of all instants. */
static int32_t two_thirds(const struct shots *s, size_t c)
{
    double column[W] = {0}, all = 0, sum = 0;
    int32_t x = 0;
    for (size_t i = 0; i < s->n; i++)
        for (int k = 0; k < W * H; k++) {
            column[k % W] += (double)s->grey[i][c][k];
            all += (double)s->grey[i][c][k];
        }
    while (x < W && sum < all * 2 / 3)
        sum += column[x++];
    return x;
}

/* The flame of `clean` as cameras of such gains see it. */
static void expose(struct shots *s, const struct shots *clean, const double *gain, double noise)
{
    s->n = clean->n;
    for (size_t i = 0; i < s->n; i++)
        for (size_t c = 0; c < clean->scene[0].rig.n_cameras; c++) {
            if (s->grey[i][c] == NULL)
                s->grey[i][c] = must_floats(W * H);
            for (size_t k = 0; k < W * H; k++)
                s->grey[i][c][k] = (float)(((double)clean->grey[i][c][k] +
                                            noise * clean->scene[i].peak * bench_normal()) /
                                           gain[c]);
        }
    s->scene[0].rig.n_cameras = clean->scene[0].rig.n_cameras; /* get() asks */
}

/* Pictures as wide as the rig's now. */
static void crop(struct shots *s, size_t c, int32_t w)
{
    for (size_t i = 0; i < s->n; i++)
        for (int32_t y = 0; y < H; y++)
            memmove(s->grey[i][c] + y * w, s->grey[i][c] + y * W, (size_t)w * sizeof(float));
}

static void mean_picture(const struct shots *s, const struct rec_camera *k, size_t c, float *mean,
                         struct rec_light_picture *p)
{
    size_t n = (size_t)k->width * (size_t)k->height;
    memset(mean, 0, n * sizeof *mean);
    for (size_t i = 0; i < s->n; i++)
        for (size_t j = 0; j < n; j++)
            mean[j] += s->grey[i][c][j] / (float)s->n;
    *p = (struct rec_light_picture){
        .width = k->width, .height = k->height, .channels = 1, .n = (uint32_t)s->n, .mean = mean};
}

/* Gains by the integrated emission; 1 of those that it refuses. */
static void integrate(const struct shots *s, const struct rec_rig *rig, double *gain)
{
    static float mean[REC_MAX_CAMERAS][W * H];
    struct rec_light_picture p[REC_MAX_CAMERAS];
    const struct rec_light_picture *at[REC_MAX_CAMERAS];
    double light[REC_MAX_CAMERAS] = {0}, X[3];
    for (size_t c = 0; c < rig->n_cameras; c++) {
        mean_picture(s, &rig->cameras[c], c, mean[c], &p[c]);
        at[c] = &p[c];
    }
    CHECK(rec_light_where(at, rig->cameras, rig->n_cameras, X, NULL));
    for (size_t c = 0; c < rig->n_cameras; c++) {
        double v[3];
        if (rec_light_flux(&p[c], &rig->cameras[c], X, v, NULL) == PVX_OK)
            light[c] = v[1];
    }
    rec_light_gains(light, rig->n_cameras, gain);
}

static void one(enum flame_kind kind, const struct shots *clean, const struct row *r,
                pvx_pool *pool)
{
    static struct shots s;
    const struct rec_unseen_params p = {.voxels = 48, .binning = 1, .rays = 2, .margin = 1};
    double want[REC_MAX_CAMERAS], gain[REC_MAX_CAMERAS], ones[REC_MAX_CAMERAS], first;
    struct rec_check_source from = {.n = clean->n, .get = get, .ctx = &s};
    struct rec_gains_report o = {0};
    struct pvx_diag d = {""};
    struct rec_rig rig;
    static unsigned seed = 500;
    bench_seed(++seed);
    CHECK(rec_rig_copy(&clean->scene[0].rig, &rig));
    if (r->px > 0)
        disturb(&rig, r->px);
    for (size_t c = 0; c < REC_MAX_CAMERAS; c++)
        ones[c] = want[c] = gain[c] = 1;
    for (size_t c = 0; c < rig.n_cameras; c++)
        want[c] = exp(r->wrong * bench_normal());
    expose(&s, clean, want, r->noise);
    for (size_t c = 1; c < rig.n_cameras && r->cut; c += 4) {
        rig.cameras[c].width = two_thirds(clean, c);
        crop(&s, c, rig.cameras[c].width);
    }
    integrate(&s, &rig, gain);
    first = off(gain, want, rig.n_cameras);
    int64_t t0 = pvx_now_mono();
    if (rec_gains(&rig, &p, pool, &from, gain, &o, &d) != PVX_OK)
        printf("%s\n", d.text);
    bench_row(csv, "%s,%s,%s,%zu,%g,%g,%g,%.2f,%.2f,%.2f,%u,%d,%.4f,%.4f,%.1f", flames[kind].name,
              flames[kind].use, r->cut ? "cut" : "whole", s.n, 100 * r->wrong, 100 * r->noise,
              r->px, 100 * off(ones, want, rig.n_cameras), 100 * first,
              100 * off(gain, want, rig.n_cameras), o.rounds, o.accepted, o.error[0], o.error[1],
              ms(pvx_now_mono() - t0) * 1e-3);
    rec_rig_fini(&rig);
    let_go(&s);
    memset(&s, 0, sizeof s);
}

static void all(enum flame_kind kind, size_t n, pvx_pool *pool)
{
    static const struct row rows[] = {{0.03, 0.01, 0, false},  {0.1, 0.01, 0, false},
                                      {0.2, 0.01, 0, false},   {0.1, 0.03, 0, false},
                                      {0.1, 0.01, 0.5, false}, {0.1, 0.03, 0.5, false},
                                      {0.1, 0.01, 0, true},    {0.2, 0.03, 0.5, true}};
    static struct shots clean;
    if (shoot(&clean, kind, n, 0, pool))
        for (size_t i = 0; i < sizeof rows / sizeof *rows; i++)
            one(kind, &clean, &rows[i], pool);
    let_go(&clean);
}

int main(int argc, char **argv)
{
    static const struct {
        enum flame_kind kind;
        size_t n;
    } of[] = {{FLAME_JET, 6},
              {FLAME_CANDLES, 6},
              {FLAME_HOLLOW, 6},
              {FLAME_CAMPFIRE, 9},
              {FLAME_RING, 9}};
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    printf("\ngains by a flame: 8 x 160x120, %u threads; errors in %%, rms over cameras\n",
           pvx_pool_threads(pool));
    csv = bench_csv(argc, argv, "gain",
                    "flame,use,view,sets,gains_rms_pct,noise_pct,pose_px,before_pct,integrated_pct,"
                    "alternated_pct,rounds,accepted,unseen_before,unseen_after,s");
    for (size_t f = 0; f < sizeof of / sizeof *of; f++)
        all(of[f].kind, of[f].n, pool);
    fclose(csv);
    pvx_pool_free(&pool);
    return *bench_status();
}
