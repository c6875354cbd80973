/* test_gains.c - gains by the volumes of the other cameras: right also where a picture has a part of the flame only,
 * undone where held-out sets get worse. */
#include "../t.h"

#include "recon/check/gains.h"
#include "tests/lib/flame_rig.h"

enum { W = 96, N = 6, SETS = 6 };

static pvx_pool *pool;
static struct flame_rig six; /* seed 21: no constant was chosen on it */
static const double wrong[N] = {1.2, 0.8, 1.0, 1.25, 0.9, 1.1};
static const struct rec_unseen_params params = {.voxels = 32, .binning = 1, .rays = 2, .margin = 1};

/* The flame with these gains; set `odd` of camera 2 at half. */
struct dimmed {
    double gain[N];
    size_t odd;
    int32_t width[N]; /* of what is left of a picture; 0 = all */
    float *room[N];
    const float *at[REC_MAX_CAMERAS];
};

static pvx_err dimmed_get(void *ctx, size_t i, struct rec_check_set *out)
{
    struct dimmed *s = ctx;
    for (size_t c = 0; c < N; c++) {
        size_t w = s->width[c] > 0 ? (size_t)s->width[c] : W, h = (size_t)six.h;
        double k = (c == 2 && i == s->odd ? 0.5 : 1) / s->gain[c];
        if (s->room[c] == NULL)
            s->room[c] = must_floats(W * h);
        for (size_t p = 0; p < w * h; p++)
            s->room[c][p] = (float)k * six.picture[i][c][p / w * W + p % w];
        s->at[c] = s->room[c];
    }
    *out = (struct rec_check_set){i, s->at, true};
    return PVX_OK;
}

static struct rec_gains_report report;
static struct pvx_diag diag;

static pvx_err find(struct dimmed *s, const struct rec_rig *rig, size_t sets, double *gain)
{
    struct rec_check_source from = {.n = sets, .get = dimmed_get, .ctx = s};
    for (size_t c = 0; c < REC_MAX_CAMERAS; c++)
        gain[c] = 1;
    diag.text[0] = '\0';
    pvx_err e = rec_gains(rig, &params, pool, &from, gain, &report, &diag);
    for (size_t c = 0; c < N; c++)
        PVX_FREE(s->room[c]);
    return e;
}

/* Worst error of a gain, once the product is 1. */
static double worst(const double *gain, const double *want)
{
    double mean = 0, product = 0, most = 0;
    for (size_t c = 0; c < N; c++) {
        mean += log(want[c]) / N;
        product += log(gain[c]);
    }
    T_NEAR(product, 0, 1e-9);
    for (size_t c = 0; c < N; c++)
        most = fmax(most, fabs(gain[c] / want[c] * exp(mean) - 1));
    return most;
}

static struct dimmed all(void)
{
    struct dimmed s = {.odd = SETS};
    memcpy(s.gain, wrong, sizeof wrong);
    return s;
}

T_CASE(gains_that_are_wrong_by_a_fifth)
{
    struct dimmed s = all();
    double gain[REC_MAX_CAMERAS];
    T_EQ_I(find(&s, &six.rig, SETS, gain), PVX_OK);
    printf("  after %u rounds %.4f, E %.4f -> %.4f\n", report.rounds, worst(gain, wrong),
           report.error[0], report.error[1]);
    T_OK(report.accepted);
    T_OK(report.error[1] < report.error[0]);
    T_OK(report.changed[report.rounds - 1] < REC_GAINS_SETTLED);
    T_EQ_I(report.fitted, 4);
    T_LE(worst(gain, wrong), 0.01);
}

T_CASE(a_flame_that_is_cut_off)
{
    struct rec_rig rig;
    double gain[REC_MAX_CAMERAS];
    struct dimmed s = all();
    T_EQ_I(rec_rig_copy(&six.rig, &rig), PVX_OK);
    rig.cameras[3].width = s.width[3] = 52; /* two thirds of its light */
    T_EQ_I(find(&s, &rig, SETS, gain), PVX_OK);
    printf("  after %u rounds %.4f, E %.4f -> %.4f\n", report.rounds, worst(gain, wrong),
           report.error[0], report.error[1]);
    T_OK(report.accepted);
    T_LE(worst(gain, wrong), 0.02);
    rec_rig_fini(&rig);
}

T_CASE(one_odd_set_does_not_count)
{
    struct dimmed s = all();
    double gain[REC_MAX_CAMERAS];
    s.odd = 1;
    T_EQ_I(find(&s, &six.rig, SETS, gain), PVX_OK);
    T_OK(report.accepted);
    T_LE(worst(gain, wrong), 0.03);
}

T_CASE(what_held_out_sets_do_not_bear_out_is_undone)
{
    struct dimmed s = {.gain = {1, 1, 1, 1, 1, 1}, .odd = 0};
    double gain[REC_MAX_CAMERAS];
    T_EQ_I(find(&s, &six.rig, 3, gain), PVX_OK); /* of two sets that fit one is odd */
    T_OK(!report.accepted);
    T_OK(report.error[1] > report.error[0]);
    for (size_t c = 0; c < N; c++)
        T_OK(gain[c] == 1);
}

T_CASE(the_same_bits_by_any_number_of_threads)
{
    T_NOT_UNDER_SANITIZERS();
    double gain[2][REC_MAX_CAMERAS];
    pvx_pool *both = pool;
    for (unsigned i = 0; i < 2; i++) {
        struct dimmed s = all();
        T_EQ_I(pvx_pool_new(i == 0 ? 1 : 3, "test", &pool), PVX_OK);
        T_EQ_I(find(&s, &six.rig, 3, gain[i]), PVX_OK);
        pvx_pool_free(&pool);
    }
    pool = both;
    T_OK(memcmp(gain[0], gain[1], N * sizeof(double)) == 0);
}

T_CASE(too_little)
{
    struct rec_rig few;
    double gain[REC_MAX_CAMERAS];
    struct dimmed s = all();
    T_EQ_I(find(&s, &six.rig, 2, gain), PVX_EINVAL);
    T_CONTAINS(diag.text, "2 frame sets");
    T_EQ_I(rec_rig_copy(&six.rig, &few), PVX_OK);
    few.n_cameras = 3;
    T_EQ_I(find(&s, &few, 3, gain), PVX_EINVAL);
    T_CONTAINS(diag.text, "3 cameras see flame");
    few.n_cameras = N;
    rec_rig_fini(&few);
}

static void begin(void)
{
    if (pvx_pool_new(2, "test", &pool) != PVX_OK)
        exit(1);
    flame_rig_new(&six, N, W, SETS, 21, t_normal);
}

static void end(void)
{
    flame_rig_free(&six);
    pvx_pool_free(&pool);
}

T_MAIN(begin(), end())
