/* The loops of solve/blend.c, selfcal.c and levels.c, and the table of all operations. */
#include <string.h>

#include "recon/opencl/ops.h"

#define LANES sizeof(double[4])

/* ---- blend.c --------------------------------------------------------------------------------------*/

static void ops_colours(const struct rec_pcg *v, const double c[4], double xs[4], double ss[4],
                        double xx[4])
{
    const struct rec_cl_at t = rec_cl_at(v->pb->a);
    const cl_float4 by = rec_cl_four(c);
    double sum[3][4];
    REC_CL_COLUMNS(&t, REC_CL_K_BLEND_COLOURS, REC_CL_VALUE(t.n), REC_CL_VALUE(by),
                   REC_CL_VECTOR(&t, v->x), REC_CL_TO_PARTS(&t));
    rec_cl_sums_of(&t, t.columns, 3, sum);
    memcpy(xs, sum[0], LANES);
    memcpy(ss, sum[1], LANES);
    memcpy(xx, sum[2], LANES);
}

static void ops_blend(const struct rec_pcg *v, struct rec_pcg *one, const double c[4],
                      double rwr[4])
{
    const struct rec_cl_at t = rec_cl_at(v->pb->a);
    const cl_float4 by = rec_cl_four(c);
    REC_CL_COLUMNS(&t, REC_CL_K_BLEND_COLUMNS, REC_CL_VALUE(t.n), REC_CL_VALUE(by),
                   REC_CL_VECTOR(&t, v->x), REC_CL_VECTOR(&t, one->x), REC_CL_VECTOR(&t, one->d));
    REC_CL_ROWS(&t, REC_CL_K_BLEND_ROWS, REC_CL_BINS(&t), REC_CL_VECTOR(&t, v->pb->w),
                REC_CL_VALUE(by), REC_CL_VECTOR(&t, v->pb->b), REC_CL_VECTOR(&t, v->r),
                REC_CL_VECTOR(&t, one->pb->b), REC_CL_VECTOR(&t, one->r), REC_CL_VECTOR(&t, one->q),
                REC_CL_TO_PARTS(&t));
    rec_cl_sums_of(&t, t.rows, 1, (double(*)[4])rwr);
}

static void ops_tint(const struct rec_pcg *v, const double c[4], double sum[4], double all[4])
{
    const struct rec_cl_at t = rec_cl_at(v->pb->a);
    const cl_float4 by = rec_cl_four(c);
    double both[2][4];
    REC_CL_COLUMNS(&t, REC_CL_K_BLEND_TINT, REC_CL_VALUE(t.n), REC_CL_VALUE(by),
                   REC_CL_VECTOR(&t, v->x), REC_CL_TO_PARTS(&t));
    rec_cl_sums_of(&t, t.columns, 2, both);
    memcpy(sum, both[0], LANES);
    memcpy(all, both[1], LANES);
}

static void ops_colour(const struct rec_pcg *v, const struct rec_pcg *one, const double c[4],
                       const double tint[4], float least)
{
    const struct rec_cl_at t = rec_cl_at(v->pb->a);
    const cl_float4 by = rec_cl_four(c), of = rec_cl_four(tint);
    REC_CL_COLUMNS(&t, REC_CL_K_BLEND_COLOUR, REC_CL_VALUE(t.n), REC_CL_VALUE(by), REC_CL_VALUE(of),
                   REC_CL_VALUE(least), REC_CL_VECTOR(&t, one->x), REC_CL_VECTOR(&t, v->x));
}

/* ---- selfcal.c ------------------------------------------------------------------------------------*/

static void ops_tiles(rec_problem *pb, const float *r, double *const *tile)
{
    const struct rec_cl_at t = rec_cl_at(pb->a);
    const struct rec_cl_part *a = t.a;
    const size_t cameras = (size_t)a->level->g.cameras;
    const size_t bytes = REC_SELFCAL_TILES * REC_SELFCAL_SUMS * sizeof **tile;
    REC_CL_RUN(t.q, REC_CL_K_SELFCAL_TILES, t.cs, cameras * REC_SELFCAL_TILES, REC_CL_GROUP,
               REC_CL_BUFFER(&a->level->geometry), REC_CL_BUFFER(&a->is_row), REC_CL_BUFFER(&a->w),
               REC_CL_VECTOR(&t, pb->w), REC_CL_VECTOR(&t, pb->b), REC_CL_VECTOR(&t, r),
               REC_CL_BUFFER(&t.s->tiles));
    for (size_t c = 0; c < cameras; c++)
        if (tile[c] != NULL)
            rec_cl_download(t.q, &t.s->tiles, c * bytes, tile[c], bytes);
    if (rec_cl_wait(t.q))
        return;
    for (size_t c = 0; c < cameras; c++)
        if (tile[c] != NULL)
            memset(tile[c], 0, bytes);
}

static void ops_correct(rec_problem *pb, const struct rec_card_shot *shot)
{
    const struct rec_cl_at t = rec_cl_at(pb->a);
    const size_t cameras = (size_t)t.a->level->g.cameras;
    _Static_assert(sizeof *shot == sizeof(struct rec_cl_shot), "the same members");
    rec_cl_upload(t.q, &t.s->shot, 0, shot, cameras * sizeof *shot);
    REC_CL_ROWS(&t, REC_CL_K_SELFCAL_CORRECT, REC_CL_BINS(&t), REC_CL_BUFFER(&t.a->is_row),
                REC_CL_BUFFER(&t.s->shot), REC_CL_BUFFER(&t.a->b), REC_CL_BUFFER(&t.a->w),
                REC_CL_VECTOR(&t, pb->b));
}

/* ---- levels.c -------------------------------------------------------------------------------------*/

static void ops_refine(const struct rec_subsys *coarse, const float *x,
                       const struct rec_subsys *fine, float *to)
{
    const struct rec_cl_at t = rec_cl_at(coarse), f = rec_cl_at(fine);
    const uint32_t n = t.n * (uint32_t)t.cs;
    REC_CL_RUN(t.q, REC_CL_K_REFINE, t.cs, rec_cl_groups(n), REC_CL_FLAT, REC_CL_VALUE(n),
               REC_CL_BUFFER(&t.a->level->geometry), REC_CL_BUFFER(&t.a->map),
               REC_CL_BUFFER(&t.a->col), REC_CL_VECTOR(&t, x), REC_CL_BUFFER(&f.a->level->geometry),
               REC_CL_BUFFER(&f.a->map), REC_CL_VECTOR(&f, to));
}

const struct rec_card_ops rec_cl_ops = {
    .later = rec_cl_later,
    .load = rec_cl_load,
    .residual = rec_cl_residual,
    .copy = rec_cl_copy_x,
    .clear = rec_cl_clear_x,
    .square = rec_cl_square,
    .zero_residual = rec_cl_zero_residual,
    .fit = rec_cl_fit,
    .scale = rec_cl_scale,
    .differences = rec_cl_differences,
    .pass = rec_cl_pass,
    .colours = ops_colours,
    .blend = ops_blend,
    .tint = ops_tint,
    .colour = ops_colour,
    .tiles = ops_tiles,
    .correct = ops_correct,
    .levels = rec_cl_levels,
    .refine = ops_refine,
};
