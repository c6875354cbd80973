/* test_cl_ops_problem.c - what comes before and after the passes on a device, against the loops of the processor: loads,
 * weights, residuals, the sum of channels, corrections of cameras. */
#include "recon/solve/blend.h"
#include "tests/lib/cl_ops.h"

/* ---- problem.c, start.c, lambda.c ----------------------------------------------------------------*/

static void loads(struct bed *b)
{
    const rec_problem *here = b->pb[HERE], *there = b->pb[THERE];
    struct rec_card_load sum;
    size_t measured = 0, ones = 0;
    double light[4] = {0};
    rec_cl_ops.load(b->pb[THERE], &sum);
    for (size_t i = 0; i < b->room; i++) {
        measured += b->row[i] && here->w[i] > 0;
        ones += b->row[i] && here->w[i] == 1;
        for (size_t l = 0; l < b->cs && b->row[i]; l++)
            light[l] += fabs((double)rec_weight_at(here, i, l) * (double)here->b[i * b->cs + l]);
    }
    T_EQ_I(sum.rows, measured);
    T_EQ_I(sum.ones, ones);
    double n = (double)b->room * (double)b->cs * EPS;
    T_NEAR(there->b_norm2, here->b_norm2, 2 * n * here->b_norm2);
    T_EQ_I(there->m, here->m);
    T_EQ_I(there->whole, here->whole);
    for (int l = 0; l < 4; l++) {
        T_NEAR(there->light[l], here->light[l], 2 * n * light[l]);
        if (b->in.per_channel)
            T_EQ_I(there->measured[l], here->measured[l]);
        T_NEAR(there->share[l], here->share[l], 4 * n);
    }
}

static void weights(struct bed *b)
{
    rec_problem *here = b->pb[HERE], *there = b->pb[THERE];
    rec_problem_weigh(here, -1);
    rec_problem_weigh(there, -1);
    float *column = down(b, there->column, b->n);
    same_floats(b, "diagonal", "column", here->diag, column, b->n, 0);
    free(column);
    for (int l = 0; l < here->nch; l++) {
        T_OK(here->lambda[l] > 0 && here->noise2[l] > 0);
        /* the processor adds up floats, the device doubles before they are rounded; lambda has powers of the sums */
        double n = 0x1p-24, m = 4 * (double)b->room * EPS;
        T_NEAR(there->unit[l], here->unit[l], n * here->unit[l]);
        T_NEAR(there->noise2[l], here->noise2[l], m * here->noise2[l]);
        T_NEAR(there->lambda[l], here->lambda[l], (4 * n + 4 * m) * here->lambda[l]);
    }
}

static void residuals(struct bed *b)
{
    struct rec_pcg *t = b->t;
    double rwr[2][4];
    bed_fill(b);
    for (int i = 0; i < 2; i++)
        rec_residual(b->pb[i], t[i].x, t[i].r, t[i].q, rwr[i]);
    float *r = down(b, t[THERE].r, b->room * b->cs), *size = forward_size(b, t[HERE].x);
    for (size_t i = 0; i < b->room * b->cs; i++)
        size[i] += fabsf(b->pb[HERE]->b[i]);
    near_product(b, "A x - b", true, t[HERE].r, r, size);
    free(r);
    free(size);
    take(b, "r");
    take(b, "q");
    double sum[4] = {0};
    for (size_t i = 0; i < b->room * b->cs; i++)
        if (b->row[i / b->cs])
            sum[i % b->cs] += (double)t[HERE].q[i] * (double)t[HERE].r[i];
    same_sums(b, "r'Wr", b->room, sum, rwr[THERE], NULL);

    rec_problem *pb = b->pb[THERE];
    double fit[4], length[4], want[2][4] = {{0}}, abs_fit[4] = {0};
    rec_cl_ops.fit(pb, t[THERE].r, fit, length);
    for (size_t i = 0; i < b->room * b->cs; i++) {
        double v = b->pb[HERE]->b[i], ax = (double)t[HERE].r[i] + v;
        double w = rec_weight_at(b->pb[HERE], i / b->cs, i % b->cs);
        if (!b->row[i / b->cs])
            continue;
        want[0][i % b->cs] += w * ax * v;
        abs_fit[i % b->cs] += fabs(w * ax * v);
        want[1][i % b->cs] += w * ax * ax;
    }
    same_sums(b, "fit", b->room, want[0], fit, abs_fit);
    same_sums(b, "fit: size", b->room, want[1], length, NULL);

    const float scale[4] = {0.7f, 1.3f, 0, 0};
    memset(sum, 0, sizeof sum);
    for (size_t i = 0; i < b->n * b->cs; i++)
        t[HERE].x[i] *= scale[i % b->cs];
    for (size_t i = 0; i < b->room * b->cs; i++) {
        float *to = &t[HERE].r[i], v = b->pb[HERE]->b[i];
        if (b->row[i / b->cs])
            sum[i % b->cs] += rec_put_residual(b->pb[HERE], i / b->cs, i % b->cs,
                                               scale[i % b->cs] * (*to + v) - v, to, &t[HERE].q[i]);
    }
    rec_cl_ops.scale(pb, scale, t[THERE].x, t[THERE].r, t[THERE].q, rwr[THERE]);
    all_same(b, "scale", 0);
    same_sums(b, "scale: r'Wr", b->room, sum, rwr[THERE], NULL);

    for (int i = 0; i < 2; i++) {
        b->pb[i]->start = REC_START_ZERO;
        rec_start_residual(b->pb[i], t[i].x, rwr[i]);
    }
    all_same(b, "residual of 0", 0);
    T_NEAR(rec_norm_x(b->pb[THERE], t[THERE].phi), rec_norm_x(b->pb[HERE], t[HERE].phi),
           (double)b->n * EPS * rec_norm_x(b->pb[HERE], t[HERE].phi));
    same_sums(b, "residual of 0", b->room, rwr[HERE], rwr[THERE], NULL); /* it came with the norm */

    for (int i = 0; i < 2; i++) {
        rec_copy_x(b->pb[i], t[i].x, t[i].phi);
        rec_clear_x(b->pb[i], t[i].phi_old);
    }
    all_same(b, "copy", 0);
}

T_CASE(loads_weights_and_residuals_are_those_of_the_processor)
{
    for (enum way way = GREY; way <= MOSAIC; way++) {
        if (cl_bed_is_simulated() && way == COLOUR)
            continue;
        struct bed b;
        bed_new(&b, small(), way);
        loads(&b);
        weights(&b);
        residuals(&b);
        bed_free(&b);
    }
}

/* ---- blend.c -------------------------------------------------------------------------------------*/

/* Compares a vector of one lane. */
static void same_one(struct bed *b, const char *name, const float *here, const float *there,
                     size_t floats, bool bins)
{
    float *got = down(b, there, floats);
    same_floats(b, "blend", name, here, got, floats, bins ? 1 : 0);
    free(got);
}

/* Sums of c x and of its square and product with x. */
static void colours(struct bed *b, const double c[4])
{
    double want[3][4] = {{0}}, got[3][4];
    for (size_t q = 0; q < b->n; q++) {
        const float *x = b->t[HERE].x + q * 4;
        float s = ((float)c[0] * x[0] + (float)c[1] * x[1]) + (float)c[2] * x[2];
        for (int l = 0; l < 4; l++) {
            want[0][l] += (double)x[l] * (double)s;
            want[1][l] += (double)s * (double)s;
            want[2][l] += (double)x[l] * (double)x[l];
        }
    }
    rec_cl_ops.colours(&b->t[THERE], c, got[0], got[1], got[2]);
    for (int i = 0; i < 3; i++)
        same_sums(b, "colours", b->n, want[i], got[i], NULL);
}

T_CASE(the_sum_of_channels_is_that_of_the_processor)
{
    struct bed b;
    struct rec_pcg one[2];
    double rwr[2][4];
    const double c[4] = {0.4, 1, 0.3, 0};
    bed_new(&b, small(), COLOUR);
    weights(&b);
    (void)run(&b, REC_PASS_BEGIN);
    bed_fill(&b);
    colours(&b, c);
    for (int i = 0; i < 2; i++) {
        for (int l = 0; l < 4; l++) /* sums differ by their rounding, and so would c */
            b.pb[THERE]->light[l] = b.pb[HERE]->light[l];
        rec_blend_begin(&b.t[i], &one[i], rwr[i]);
    }
    same_one(&b, "x", one[HERE].x, one[THERE].x, b.n, false);
    same_one(&b, "d", one[HERE].d, one[THERE].d, b.n, false);
    same_one(&b, "b", one[HERE].pb->b, one[THERE].pb->b, b.room, true);
    same_one(&b, "r", one[HERE].r, one[THERE].r, b.room, true);
    same_one(&b, "W r", one[HERE].q, one[THERE].q, b.room, true);
    same_sums(&b, "blend", b.room, rwr[HERE], rwr[THERE], NULL);
    double all[3][4];
    for (int i = 0; i < 2; i++) /* one lane of a system of four */
        rec_pcg_pass(&one[i], REC_PASS_SMOOTHNESS, all);
    same_one(&b, "L x", one[HERE].lx, one[THERE].lx, b.n, false);
    for (size_t q = 0; q < b.n; q++)
        one[HERE].x[q] *= 1.25f;
    up(&b, one[THERE].x, one[HERE].x, b.n);

    double sum[4], zero[4], want[2][4] = {{0}};
    for (size_t i = 0; i < b.n * 4; i++) {
        const float *x = b.t[HERE].x + i / 4 * 4;
        float s = ((float)c[0] * x[0] + (float)c[1] * x[1]) + (float)c[2] * x[2];
        want[0][i % 4] += (double)b.t[HERE].x[i];
        want[1][i % 4] += (double)s;
    }
    rec_cl_ops.tint(&b.t[THERE], c, sum, zero);
    same_sums(&b, "tint", b.n, want[0], sum, NULL);
    same_sums(&b, "tint: all", b.n, want[1], zero, NULL);
    const double tint[4] = {0.2, 0.7, 0.1, 0};
    const float least = 0.02f;
    for (size_t q = 0; q < b.n; q++) {
        float *x = b.t[HERE].x + q * 4;
        float s = ((float)c[0] * x[0] + (float)c[1] * x[1]) + (float)c[2] * x[2];
        s = one[HERE].x[q] / (s + least);
        for (int l = 0; l < 4; l++)
            x[l] = (x[l] + least * (float)tint[l]) * s;
    }
    rec_cl_ops.colour(&b.t[THERE], &one[THERE], c, tint, least);
    same(&b, "colour", &vectors[number_of("x")]);
    bed_free(&b);
}

/* ---- selfcal.c -----------------------------------------------------------------------------------*/

T_CASE(corrections_of_cameras_are_those_of_the_processor)
{
    for (enum way way = cl_bed_is_simulated() ? COLOUR : GREY; way <= COLOUR; way++) {
        struct bed b;
        struct rec_selfcal_given given = {.gain = true, .shift = true};
        struct rec_selfcal *s[2];
        struct rec_selfcal_look look[2][REC_MAX_CAMERAS];
        bed_new(&b, small(), way);
        bed_fill(&b);
        for (size_t c = 0; c < b.s.rig.n_cameras; c++) {
            given.camera[c].gain = t_uniform(0.9, 1.1);
            for (int i = 0; i < 2; i++)
                given.camera[c].shift[i] = c == 1 ? 0 : t_uniform(-2, 2);
        }
        for (int i = 0; i < 2; i++) {
            T_EQ_I(rec_selfcal_new(b.s.S, &s[i]), PVX_OK);
            rec_selfcal_begin(s[i], REC_SELFCAL_ON, REC_SELFCAL_GIVEN, &given);
            rec_selfcal_attach(b.pb[i], s[i]);
            rec_selfcal_apply(b.pb[i]);
        }
        same(&b, "correct", &vectors[number_of("b")]);
        for (int i = 0; i < 2; i++) {
            T_OK(rec_selfcal_due_last(b.pb[i])); /* counts the cameras */
            (void)rec_selfcal_estimate(b.pb[i], b.t[i].r);
            rec_selfcal_look(s[i], look[i]);
        }
        /* A tile has at most room bins, each of three lanes; the step is a quotient of such sums, whose determinant
         * may lose as much as 1e6 (selfcal.c). */
        double n = 3 * (double)b.room * EPS * 1e6;
        for (size_t c = 0; c < b.s.rig.n_cameras; c++) {
            const struct rec_selfcal_look *o = &look[HERE][c], *p = &look[THERE][c];
            T_EQ_I(p->known, o->known);
            T_EQ_I(o->known, c != 2);
            if (!o->known)
                continue;
            T_OK(o->gain_var > 0 && isfinite(o->var[0]));
            T_NEAR(p->log_gain, o->log_gain, n);
            T_NEAR(p->shift[0], o->shift[0], n);
            T_NEAR(p->shift[1], o->shift[1], n);
            T_NEAR(p->gain_var, o->gain_var, n * o->gain_var);
            T_NEAR(p->var[2], o->var[2], n * o->var[2]);
        }
        for (int i = 0; i < 2; i++) {
            rec_selfcal_attach(b.pb[i], NULL);
            rec_selfcal_free(&s[i]);
        }
        bed_free(&b);
    }
}
T_MAIN((cl_bed_begin(), cl = cl_bed_open()), rec_cl_close(&cl))
