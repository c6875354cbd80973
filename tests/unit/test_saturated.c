/* Saturated pixels that say "at least this": the objective, its minimiser, and what they are worth. */
#include <math.h>

#include "recon/frame/impl.h"
#include "tests/lib/scene.h"

/* The scene's pictures, clipped where they are above `full`. */
static void clip(const struct scene *s, rec_frame *f, float full)
{
    scene_shoot(s, f, 0.002);
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        float *in = rec_frame_input(f, c);
        for (size_t i = 0; i < (s->S->row0[c + 1] - s->S->row0[c]) * 4; i++)
            in[i] = fminf(in[i], full);
    }
}

static rec_frame *slot(const struct scene *s, bool at_least, double saturation)
{
    struct rec_frame_params p = rec_frame_defaults;
    rec_frame *f;
    p.at_least = at_least;
    p.photo.saturation = (float)saturation;
    if (rec_frame_alone(s->S, &s->rig, &p, s->pool, &f, NULL) != PVX_OK)
        exit(2);
    return f;
}

static double error_of(const struct scene *s, rec_frame *f)
{
    struct rec_sparse v;
    rec_frame_carve(f);
    T_OK(rec_frame_solve(f, 0, NULL) == PVX_OK);
    rec_frame_volume(f, &v);
    for (int32_t i = 0; i < v.n * v.cs; i++)
        T_OK(v.value[i] >= 0 && isfinite(v.value[i]));
    return scene_error(s, &v);
}

T_CASE(they_are_worth_more_than_nothing)
{
    struct scene s;
    double error[3];
    scene_new(&s, 8, 80, 24, 2, 2);
    scene_at(&s, 0.3);
    for (int k = 0; k < 3; k++) { /* all of it, left out, at least */
        rec_frame *f = slot(&s, k == 2, k == 0 ? (double)REC_PHOTO_UNSATURATED : 0.5);
        t_state = 0;
        clip(&s, f, k == 0 ? 10 : 0.5F);
        error[k] = error_of(&s, f);
        if (k > 0)
            T_OK(rec_frame_get_report(f)->saturated > 100);
        rec_frame_free(&f);
    }
    printf("  error %.4f; a part saturated: left out %.4f, at least %.4f\n", error[0], error[1],
           error[2]);
    T_OK(error[2] < error[1]);
    T_OK(error[2] < 1.1 * error[0]);
    scene_free(&s);
}

/* At a solution that has come to rest: rows above their bounds have no part in the gradient, the others pull as in
 * least squares, so a step up along the gradient of the one-sided misfit is no descent. */
T_CASE(the_minimiser_is_that_of_the_one_sided_problem)
{
    struct scene s;
    struct rec_solve_params p = rec_solve_defaults;
    scene_new(&s, 5, 40, 16, 1, 2);
    scene_at(&s, 0.3);
    rec_frame *f = slot(&s, true, 0.3);
    clip(&s, f, 0.3F);
    rec_frame_carve(f);
    p.tolerance = 0;
    p.stop = REC_STOP_ITERATIONS;
    p.iterations = 4000;
    p.lambda = 1e-3F;
    rec_solver_tune(f->solver, &p);
    T_OK(rec_frame_solve(f, 0, NULL) == PVX_OK);
    T_OK(f->any_least);
    size_t rows = s.S->row0[s.S->n_cameras], above = 0, bounded = 0;
    double rwr = 0;
    float *y = pvx_calloc(s.S->win.room * 4, sizeof *y),
          *g = pvx_calloc(s.S->win.room * 4, sizeof *g);
    float *back = pvx_calloc(s.voxels * 4, sizeof *back);
    struct rec_images images;
    T_OK(rec_images_new(s.S, 4, &images) == PVX_OK);
    rec_forward(f->sub, &images, f->x, y);
    rec_images_free(&images);
    for (size_t i = 0; i < rows; i++)
        for (size_t l = 0; l < 3 && f->sub->is_row[i]; l++) {
            bool bound = (f->least_of[i] >> l & 1) != 0;
            double r = (double)y[i * 4 + l] - (double)f->b[i * 4 + l];
            double w = f->least_of[i] != 0 ? (double)f->least[i] : (double)f->weight[i];
            bounded += bound;
            above += bound && r > 1e-4;
            g[i * 4 + l] = bound && r > 0 ? 0 : (float)(w * r);
            rwr += bound && r > 0 ? 0 : w * r * r;
        }
    T_OK(bounded > 50 && above > 10); /* some are as bright as they were */
    rec_adjoint_range(f->sub, g, 0, f->sub->n, back);
    /* f is least: its derivative along x itself, x' grad = x'A'Wr + lambda x'L V L x, is 0, the second part >= 0. */
    double along[3] = {0}, size[3] = {0};
    for (int32_t q = 0; q < f->sub->n; q++)
        for (int l = 0; l < 3; l++) {
            along[l] += (double)f->x[q * 4 + l] * (double)back[q * 4 + l];
            size[l] += fabs((double)f->x[q * 4 + l] * (double)back[q * 4 + l]);
        }
    for (int l = 0; l < 3; l++)
        T_OK(along[l] <= 1e-3 * size[l]);
    /* Then lambda x'L V L x = -x'A'Wr, which is what the reported objective has of smoothness. */
    double want = 0.5 * rwr - 0.5 * (along[0] + along[1] + along[2]);
    double got = (double)rec_frame_get_report(f)->solve.objective;
    T_NEAR(got, want, 0.01 * want);
    free(y);
    free(g);
    free(back);
    rec_frame_free(&f);
    scene_free(&s);
}

/* The objective falls with every iteration that is allowed, though rows come and go. */
T_CASE_OF_THREADS(never_rises_and_does_not_depend_on_threads)
{
    float *kept = NULL;
    int32_t n = 0;
    for (unsigned threads = 1; threads <= 3; threads += 2) {
        struct scene s;
        scene_new(&s, 5, 40, 16, 1, threads);
        scene_at(&s, 0.3);
        rec_frame *f = slot(&s, true, 0.3);
        t_state = 0;
        clip(&s, f, 0.3F);
        rec_frame_carve(f);
        double before = INFINITY;
        struct rec_solve_params p = rec_solve_defaults;
        p.stop = REC_STOP_ITERATIONS;
        p.lambda = 1e-3F;
        for (uint32_t k = 12; k < 40 && threads == 1; k += 3) { /* V has been renewed by then */
            p.iterations = k;
            rec_solver_tune(f->solver, &p);
            T_OK(rec_frame_solve(f, 0, NULL) == PVX_OK);
            double now = (double)rec_frame_get_report(f)->solve.objective;
            if (rec_frame_get_report(f)->solve.renewals == 0 ||
                rec_frame_get_report(f)
                        ->solve.renewed[rec_frame_get_report(f)->solve.renewals - 1] < 12)
                T_LE(now, before * (1 + 1e-6));
            before = now;
        }
        p.iterations = 20;
        rec_solver_tune(f->solver, &p);
        T_OK(rec_frame_solve(f, 0, NULL) == PVX_OK);
        struct rec_sparse v;
        rec_frame_volume(f, &v);
        if (kept == NULL) {
            n = v.n * v.cs;
            kept = pvx_calloc((size_t)n, sizeof *kept);
            memcpy(kept, v.value, (size_t)n * sizeof *kept);
        } else {
            T_EQ_I(v.n * v.cs, n);
            T_OK(memcmp(kept, v.value, (size_t)n * sizeof *kept) == 0);
        }
        rec_frame_free(&f);
        scene_free(&s);
    }
    free(kept);
}

/* Without a saturated pixel the term is not there: the same bits. */
T_CASE(nothing_saturated_same_bits)
{
    struct scene s;
    struct rec_sparse v[2];
    rec_frame *f[2];
    scene_new(&s, 5, 40, 16, 1, 2);
    scene_at(&s, 0.3);
    for (int k = 0; k < 2; k++) {
        f[k] = slot(&s, k == 1, 0.998);
        t_state = 0;
        clip(&s, f[k], 10);
        (void)error_of(&s, f[k]);
        rec_frame_volume(f[k], &v[k]);
    }
    T_EQ_I(v[0].n, v[1].n);
    T_OK(v[0].n > 100);
    T_OK(memcmp(v[0].value, v[1].value, (size_t)(v[0].n * v[0].cs) * sizeof(float)) == 0);
    for (int k = 0; k < 2; k++)
        rec_frame_free(&f[k]);
    scene_free(&s);
}
T_MAIN(, )
