/* The loops of solve/problem.c, start.c and lambda.c. */
#include "recon/opencl/ops.h"

#include <string.h>

#define LANES sizeof(double[4])

void rec_cl_load(rec_problem *pb, struct rec_card_load *out)
{
    const struct rec_cl_at t = rec_cl_at(pb->a);
    const struct rec_cl_part *a = t.a;
    int four = rec_cl_per_channel(pb);
    double sum[4][4], of_columns[2][4];
    uint32_t groups;
    REC_CL_ROWS(&t, REC_CL_K_PROBLEM_LOAD, REC_CL_BINS(&t), REC_CL_BUFFER(&a->is_row),
                REC_CL_BUFFER(&a->b), REC_CL_BUFFER(four ? &a->w4 : &a->w),
                REC_CL_BUFFER(four ? &a->w4 : &a->w), REC_CL_VALUE(four), REC_CL_VECTOR(&t, pb->b),
                REC_CL_VECTOR(&t, pb->w), REC_CL_VECTOR(&t, four ? pb->w4 : pb->w),
                REC_CL_TO_PARTS(&t));
    for (int i = 0; i < 4; i++)
        rec_cl_want(&t, t.rows, sum[i]);
    rec_cl_column_norms(t.q, a, rec_cl_twin_of(t.s, pb->w), rec_cl_twin_of(t.s, pb->column),
                        t.s->wanted, &groups);
    rec_cl_sums_of(&t, groups, 2, of_columns);
    *out = (struct rec_card_load){.norm2 = sum[0][0],
                                  .rows = sum[0][1],
                                  .ones = sum[0][2],
                                  .diagonal = of_columns[0][0],
                                  .chord = of_columns[1][0]};
    memcpy(out->light, sum[1], LANES);
    memcpy(out->measured, sum[2], LANES);
    memcpy(out->weight, sum[3], LANES);
}

/* r from A x, or without it. */
static void problem_residual(rec_problem *pb, const float *x, float *r, float *wr, double rwr[4])
{
    const struct rec_cl_at t = rec_cl_at(pb->a);
    int four = rec_cl_per_channel(pb), zero = x == NULL;
    if (!zero)
        rec_cl_forward(t.q, t.a, t.cs, rec_cl_twin_of(t.s, x), rec_cl_twin_of(t.s, r), false);
    REC_CL_ROWS(&t, REC_CL_K_PROBLEM_RESIDUAL, REC_CL_BINS(&t), REC_CL_WEIGHTS(&t, pb, four),
                REC_CL_VALUE(zero), REC_CL_VECTOR(&t, pb->b), REC_CL_VECTOR(&t, r),
                REC_CL_VECTOR(&t, wr), REC_CL_TO_PARTS(&t));
    rec_cl_sums_of(&t, t.rows, 1, (double(*)[4])rwr);
}
void rec_cl_residual(rec_problem *pb, const float *x, float *r, float *wr, double rwr[4])
{
    problem_residual(pb, x, r, wr, rwr);
}
void rec_cl_zero_residual(rec_problem *pb, float *r, float *wr, double rwr[4])
{
    problem_residual(pb, NULL, r, wr, rwr);
}

void rec_cl_copy_x(rec_problem *pb, float *to, const float *from)
{
    const struct rec_cl_at t = rec_cl_at(pb->a);
    rec_cl_copy(t.q, rec_cl_twin_of(t.s, from), 0, rec_cl_twin_of(t.s, to), 0,
                t.n * (size_t)t.cs * sizeof *to);
}
void rec_cl_clear_x(rec_problem *pb, float *x)
{
    const struct rec_cl_at t = rec_cl_at(pb->a);
    rec_cl_zero(t.q, rec_cl_twin_of(t.s, x), 0, t.n * (size_t)t.cs * sizeof *x);
}

void rec_cl_square(rec_problem *pb, const float *x, double out[4])
{
    const struct rec_cl_at t = rec_cl_at(pb->a);
    REC_CL_COLUMNS(&t, REC_CL_K_PROBLEM_SQUARE, REC_CL_VALUE(t.n), REC_CL_VECTOR(&t, x),
                   REC_CL_TO_PARTS(&t));
    rec_cl_sums_of(&t, t.columns, 1, (double(*)[4])out);
}

void rec_cl_fit(rec_problem *pb, const float *r, double fit[4], double size[4])
{
    const struct rec_cl_at t = rec_cl_at(pb->a);
    int four = rec_cl_per_channel(pb);
    double sum[2][4];
    REC_CL_ROWS(&t, REC_CL_K_PROBLEM_FIT, REC_CL_BINS(&t), REC_CL_WEIGHTS(&t, pb, four),
                REC_CL_VECTOR(&t, pb->b), REC_CL_VECTOR(&t, r), REC_CL_TO_PARTS(&t));
    rec_cl_sums_of(&t, t.rows, 2, sum);
    memcpy(fit, sum[0], LANES);
    memcpy(size, sum[1], LANES);
}

void rec_cl_scale(rec_problem *pb, const float scale[4], float *x, float *r, float *wr,
                  double rwr[4])
{
    const struct rec_cl_at t = rec_cl_at(pb->a);
    const cl_float4 by = {{scale[0], scale[1], scale[2], scale[3]}};
    int four = rec_cl_per_channel(pb);
    REC_CL_COLUMNS(&t, REC_CL_K_PROBLEM_SCALE, REC_CL_VALUE(t.n), REC_CL_VALUE(by),
                   REC_CL_VECTOR(&t, x));
    REC_CL_ROWS(&t, REC_CL_K_PROBLEM_SCALE_ROWS, REC_CL_BINS(&t), REC_CL_WEIGHTS(&t, pb, four),
                REC_CL_VALUE(by), REC_CL_VECTOR(&t, pb->b), REC_CL_VECTOR(&t, r),
                REC_CL_VECTOR(&t, wr), REC_CL_TO_PARTS(&t));
    rec_cl_sums_of(&t, t.rows, 1, (double(*)[4])rwr);
}

void rec_cl_differences(rec_problem *pb, double first[4], double second[4], double *blocks)
{
    const struct rec_cl_at t = rec_cl_at(pb->a);
    const struct rec_cl_part *a = t.a;
    int four = rec_cl_per_channel(pb);
    double sum[3][4];
    REC_CL_ROWS(&t, REC_CL_K_PROBLEM_DIFFERENCES, REC_CL_BINS(&t), REC_CL_BUFFER(&a->is_row),
                REC_CL_BUFFER(&a->b), REC_CL_BUFFER(four ? &a->w4 : &a->w),
                REC_CL_BUFFER(four ? &a->w4 : &a->w), REC_CL_VALUE(four), REC_CL_TO_PARTS(&t));
    rec_cl_sums_of(&t, t.rows, 3, sum);
    memcpy(first, sum[0], LANES);
    memcpy(second, sum[1], LANES);
    *blocks = sum[2][0];
}
