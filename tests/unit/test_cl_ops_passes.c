/* test_cl_ops_passes.c - the passes of an iteration on a device, one by one, against those of the processor on the same
 * inputs. */
#include "tests/lib/cl_ops.h"

static void sums_are_same(struct bed *b, const char *what, const struct sums *s, int slot,
                          const double *size)
{
    same_sums(b, what, b->n + b->room, s->of[HERE][slot], s->of[THERE][slot], size);
}

static float *adjoint_size(struct bed *b, const float *u)
{
    float *v = pvx_calloc(b->room * b->cs, sizeof *v), *x = pvx_calloc(b->n * b->cs, sizeof *x);
    for (size_t i = 0; i < b->room * b->cs; i++)
        v[i] = fabsf(u[i]);
    rec_adjoint_range(b->f->sub, v, 0, (int32_t)b->n, x);
    free(v);
    return x;
}

static void passes_over_columns(struct bed *b)
{
    double size[4];
    struct rec_pcg *t = &b->t[HERE];
    (void)run(b, REC_PASS_BEGIN);
    all_same(b, "begin", 0);
    bed_fill(b);
    (void)run(b, REC_PASS_SCALE);
    all_same(b, "scale", 0);
    bed_fill(b);
    struct sums s = run(b, REC_PASS_DIRECTION);
    all_same(b, "direction", 0);
    sizes(b, t->d, t->phi, size);
    sums_are_same(b, "direction", &s, 0, size);
    s = run(b, REC_PASS_STEP);
    all_same(b, "step", BUT("ar")); /* there it has e */
    take(b, "ar");
    sums_are_same(b, "step", &s, 0, NULL);
    T_OK(b->t[THERE].any_clipped && t->any_clipped);
    s = run(b, REC_PASS_SLOPE);
    float *step = pvx_calloc(b->n * b->cs, sizeof *step);
    for (size_t i = 0; i < b->n * b->cs; i++)
        step[i] = t->next[i] - t->x[i];
    sizes(b, step, t->phi, size);
    free(step);
    sums_are_same(b, "slope", &s, 0, size);
    (void)run(b, REC_PASS_RETREAT);
    all_same(b, "retreat", 0);
    s = run(b, REC_PASS_SMOOTHNESS);
    all_same(b, "smoothness", 0);
    sums_are_same(b, "smoothness: penalty", &s, 0, NULL);
    sums_are_same(b, "smoothness: norm", &s, 1, NULL);
    s = run(b, REC_PASS_BRIGHTNESS);
    all_same(b, "brightness", 0);
    memset(size, 0, sizeof size);
    for (size_t q = 0; q < b->n; q++)
        size[0] += fabs((double)t->next[q]);
    sums_are_same(b, "brightness: y", &s, 0, size);
    sums_are_same(b, "brightness: y^2", &s, 1, NULL);
    sums_are_same(b, "brightness: lit", &s, 2, NULL);
    s = run(b, REC_PASS_STIFFNESS);
    all_same(b, "stiffness", 0);
    sums_are_same(b, "stiffness", &s, 0, NULL);
    b->t[HERE].usual = b->t[THERE].usual = 0; /* nothing burns: V = 1 */
    (void)run(b, REC_PASS_STIFFNESS);
    all_same(b, "stiffness of the dark", 0);
    bed_fill(b);
    s = run(b, REC_PASS_REGRADIENT);
    all_same(b, "regradient", 0);
    sums_are_same(b, "regradient", &s, 0, NULL);
    sizes(b, t->phi, t->phi_old, size);
    for (int l = 0; l < 4; l++)
        size[l] *= 4; /* S <= 2 */
    sums_are_same(b, "regradient: cross", &s, 1, size);
}

/* Without clipping q keeps its bits, also those of -0. */
static void a_step_without_clipping(struct bed *b)
{
    bed_fill(b);
    for (int i = 0; i < 2; i++)
        memset(b->t[i].alpha, 0, sizeof b->t[i].alpha);
    (void)run(b, REC_PASS_STEP);
    T_OK(b->t[THERE].any_clipped && !b->t[HERE].any_clipped);
    size_t floats = b->room * b->cs;
    float *q = pvx_calloc(floats, sizeof *q);
    for (size_t i = 0; i < floats; i++)
        q[i] = i % 2 != 0 ? -0.0F : (float)t_normal();
    up(b, b->t[THERE].q, q, floats);
    rec_pcg_pass(&b->t[THERE], REC_PASS_CLIPPED, NULL);
    float *after = down(b, b->t[THERE].q, floats);
    T_OK(memcmp(q, after, floats * sizeof *q) == 0);
    free(q);
    free(after);
}

/* Passes of an iteration on the device from one state; shared: with one wait for all sums. */
static void some_passes(struct bed *b, uint64_t seed, bool shared, double sums[4][3][4])
{
    static const enum rec_pcg_pass passes[] = {REC_PASS_CURVATURE, REC_PASS_STEP, REC_PASS_RESIDUAL,
                                               REC_PASS_GRADIENT};
    t_state = seed;
    bed_fill(b);
    for (size_t i = 0; i < 4; i++) {
        if (shared && i < 3)
            rec_card_later(b->sub);
        rec_pcg_pass(&b->t[THERE], passes[i], sums[i]);
    }
}
static void sums_that_share_a_wait(struct bed *b)
{
    double each[4][3][4] = {{{0}}}, all[4][3][4] = {{{0}}};
    uint64_t seed = t_rand();
    some_passes(b, seed, false, each);
    some_passes(b, seed, true, all);
    T_OK(memcmp(each, all, sizeof all) == 0);
    for (int i = 0; i < 4; i++)
        T_OK(all[i][0][0] > 0);
}

static void passes_with_products(struct bed *b)
{
    struct rec_pcg *t = &b->t[HERE];
    bed_fill(b);
    struct sums s = run(b, REC_PASS_CURVATURE);
    all_same(b, "curvature", BUT("q"));
    float *size = forward_size(b, t->d);
    float *q = down(b, b->t[THERE].q, b->room * b->cs);
    near_product(b, "A d", true, t->q, q, size);
    sums_are_same(b, "curvature: d'L V L d", &s, 1, NULL);
    double qwq[4] = {0};
    for (size_t i = 0; i < b->room * b->cs; i++) {
        float w = rec_weight_at(b->pb[HERE], i / b->cs, i % b->cs);
        if (b->row[i / b->cs])
            qwq[i % b->cs] += (double)(w * q[i]) * (double)q[i];
    }
    same_sums(b, "curvature: q'Wq", b->room, qwq, s.of[THERE][0], NULL);
    free(size);

    (void)run(b, REC_PASS_STEP);
    rec_pcg_pass(&b->t[THERE], REC_PASS_CLIPPED, NULL);
    float *e = down(b, b->t[THERE].ar, b->n * b->cs);
    size_t wrong = 0, some = 0;
    for (size_t i = 0; i < b->n * b->cs; i++) {
        float alpha = (float)t->alpha[i % b->cs],
              inverse = alpha > 0 ? (float)(1 / t->alpha[i % b->cs]) : 0;
        float want = t->x[i] + alpha * t->d[i] < 0 ? -t->x[i] * inverse - t->d[i] : 0;
        wrong += e[i] != want;
        some += want != 0;
    }
    T_EQ_I(wrong, 0);
    T_OK(some > 10);
    float *change = pvx_calloc(b->room * b->cs, sizeof *change);
    rec_forward(b->f->sub, &b->pb[HERE]->images, e, change);
    size = forward_size(b, e);
    float *after = down(b, b->t[THERE].q, b->room * b->cs);
    for (size_t i = 0; i < b->room * b->cs; i++) {
        change[i] += q[i];
        size[i] += fabsf(q[i]);
    }
    near_product(b, "A e", true, change, after, size);
    free(q);
    free(e);
    free(change);
    free(size);
    free(after);

    take(b, "q"); /* from the same q on */
    take(b, "ar");
    t->any_clipped = false;
    s = run(b, REC_PASS_RESIDUAL);
    all_same(b, "residual", 0);
    sums_are_same(b, "residual: r'Wr", &s, 0, NULL);
    sums_are_same(b, "residual: penalty", &s, 1, NULL);
    sums_are_same(b, "residual: norm", &s, 2, NULL);

    s = run(b, REC_PASS_GRADIENT);
    float *ar = down(b, b->t[THERE].ar, b->n * b->cs);
    size = adjoint_size(b, t->q);
    near_product(b, "A'W r", false, t->ar, ar, size);
    free(size);
    free(ar);
    take(b, "ar");
    double sums[3][4], cross[4];
    rec_pcg_pass(t, REC_PASS_REGRADIENT, sums);
    all_same(b, "gradient", 0);
    same_sums(b, "gradient", b->n, sums[0], s.of[THERE][0], NULL);
    sizes(b, t->phi, t->phi_old, cross);
    for (int l = 0; l < 4; l++)
        cross[l] *= 4;
    same_sums(b, "gradient: cross", b->n, sums[1], s.of[THERE][1], cross);
}

T_CASE(passes_are_those_of_the_processor)
{
    for (enum way way = GREY; way <= MOSAIC; way++) {
        if (cl_bed_is_simulated() && way == COLOUR)
            continue;
        struct bed b;
        bed_new(&b, small(), way);
        all_same(&b, "load", ~(BUT("b") | BUT("w") | BUT("w4")));
        bed_fill(&b);
        passes_over_columns(&b);
        passes_with_products(&b);
        a_step_without_clipping(&b);
        sums_that_share_a_wait(&b);
        bed_free(&b);
    }
}
T_MAIN((cl_bed_begin(), cl = cl_bed_open()), rec_cl_close(&cl))
