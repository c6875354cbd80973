/* test_blend.c - the channels as one in the middle of a solve: sums and colours against plain loops in double, which
 * solves blend and which keep their bits, what it costs in error, the report, threads, deadlines. */
#include <math.h>

#include "base/clock.h"
#include "recon/solve/blend.h"
#include "tests/lib/scene.h"
#include "tests/lib/system.h"

/* ---- there and back -----------------------------------------------------------------------------*/

/* A ball in which three channels are known, with noise of their own. */
struct parts {
    struct scene s;
    struct system y;
    struct rec_pcg t, one;
    float *volume; /* t.x as it was */
    double c[4];   /* (1) of blend.h, in double */
    size_t n;
};

static void parts_new(struct parts *p)
{
    static const double sigma[3] = {0.01, 0.02, 0.03};
    memset(p, 0, sizeof *p);
    scene_new(&p->s, 6, 48, 16, 1, 2);
    system_new(&p->y, &p->s, 3, 0.4, PVX_CPU_BEST);
    rec_problem *pb = p->y.s;
    struct rec_pictures in = {.b = p->y.b, .w = p->y.w, .sigma = {0.01, 0.02, 0.03}};
    p->n = (size_t)p->y.a->n;
    for (size_t i = 0; i < p->y.rows * 4; i++)
        p->y.b[i] = i % 4 < 3 ? (float)(0.1 * (double)(i % 4 + 1) + 0.05 * t_normal()) : 0;
    for (size_t i = 0; i < p->n * 4; i++) /* many voxels are dark */
        p->y.x[i] = i % 4 < 3 && i / 4 % 3 != 0 ? (float)fabs(t_normal()) : 0;
    T_OK(rec_problem_load(pb, p->y.a, &in));
    rec_problem_weigh(pb, -1);
    p->t = rec_pcg_of(pb, p->y.x, NULL);
    for (int l = 0; l < 3; l++)
        p->t.lambda[l] = pb->lambda[l] * (1 + l);
    double most = 0;
    for (int l = 0; l < 3; l++) {
        p->c[l] = pb->light[l] / (sigma[l] * sigma[l]);
        most = fmax(most, p->c[l]);
    }
    for (int l = 0; l < 3; l++)
        p->c[l] /= most;
    p->volume = pvx_calloc(p->n * 4, sizeof *p->volume);
    memcpy(p->volume, p->t.x, p->n * 4 * sizeof *p->volume);
}
static void parts_free(struct parts *p)
{
    free(p->volume);
    system_free(&p->y);
    scene_free(&p->s);
}
static double parts_sum(const struct parts *p, const float *v)
{
    return p->c[0] * (double)v[0] + p->c[1] * (double)v[1] + p->c[2] * (double)v[2];
}

/* x, b and r of the sum; r is the sum's own residual, to the rounding of the products. */
T_CASE(the_sum_is_the_problem_of_the_sums)
{
    struct parts p;
    double all[4], rwr[4], again[4], scale = 0;
    parts_new(&p);
    rec_residual(p.y.s, p.t.x, p.t.r, p.t.q, all);
    rec_blend_begin(&p.t, &p.one, rwr);
    rec_problem *one = p.one.pb;
    T_EQ_I(one->cs, 1);
    T_EQ_I(one->a->cs, 1);
    T_EQ_I(p.y.a->cs, 4);
    T_OK(one->m * 3 == p.y.s->m);
    for (size_t q = 0; q < p.n; q++)
        T_NEAR(p.one.x[q], parts_sum(&p, p.volume + q * 4), 1e-5);
    float *r = pvx_calloc(one->room, sizeof *r), *wr = pvx_calloc(one->room, sizeof *wr);
    rec_residual(one, p.one.x, r, wr, again);
    T_NEAR(again[0], rwr[0], 1e-5 * rwr[0]);
    T_OK(rwr[0] > 0);
    REC_FOR_BLOCK_ROWS (i, one->a, ((struct rec_block_range){0, one->a->n_blocks}))
        scale = fmax(scale, fabs((double)r[i]));
    REC_FOR_BLOCK_ROWS (i, one->a, ((struct rec_block_range){0, one->a->n_blocks}))
        T_NEAR(r[i], p.one.r[i], 1e-5 * scale);
    double s2 = 0;
    for (int l = 0; l < 3; l++)
        s2 += p.c[l] * p.c[l] * p.y.s->in.sigma[l] * p.y.s->in.sigma[l];
    T_NEAR(one->in.sigma[0], sqrt(s2), 1e-9);
    T_OK(one->lambda[0] > p.t.lambda[0] / 3 && one->lambda[0] < 3 * p.t.lambda[2]);
    free(r);
    free(wr);
    parts_free(&p);
}

/* Each voxel gets the sum that was solved, in the colour that it had; a dark one, in that of the whole flame. */
T_CASE(voxels_keep_their_colours)
{
    struct parts p;
    double all[4], rwr[4], before[4], whole[3] = {0}, light = 0;
    parts_new(&p);
    rec_residual(p.y.s, p.t.x, p.t.r, p.t.q, all);
    memcpy(before, p.t.lambda, sizeof before);
    rec_blend_begin(&p.t, &p.one, rwr);
    for (size_t q = 0; q < p.n; q++) {
        p.one.x[q] = (float)(1 + q % 7);
        light += parts_sum(&p, p.volume + q * 4);
        for (size_t l = 0; l < 3; l++)
            whole[l] += (double)p.volume[q * 4 + l];
    }
    p.one.lambda[0] = 0.25 * p.one.pb->lambda[0];
    rec_blend_end(&p.t, &p.one);
    for (int l = 0; l < 3; l++)
        T_NEAR(p.t.lambda[l], before[l] / 4, 1e-6 * before[l]);
    for (size_t q = 0; q < p.n; q++) {
        const float *is = p.t.x + q * 4, *was = p.volume + q * 4;
        double sum = parts_sum(&p, is), had = parts_sum(&p, was), e = 0.02 * light / (double)p.n;
        T_NEAR(sum, 1 + (double)(q % 7), 1e-4);
        for (size_t l = 0; l < 3; l++) {
            double colour = ((double)was[l] + e * whole[l] / light) / (had + e);
            T_NEAR(is[l], sum * colour, 1e-4 * (1 + sum));
        }
    }
    parts_free(&p);
}

/* A volume that is dark stays so, and nothing is divided by its light. */
T_CASE(a_dark_volume_stays_dark)
{
    struct parts p;
    double all[4], rwr[4];
    parts_new(&p);
    memset(p.t.x, 0, p.n * 4 * sizeof *p.t.x);
    rec_residual(p.y.s, p.t.x, p.t.r, p.t.q, all);
    rec_blend_begin(&p.t, &p.one, rwr);
    T_OK(rwr[0] > 0 && isfinite(rwr[0]));
    rec_blend_end(&p.t, &p.one);
    for (size_t i = 0; i < p.n * 4; i++)
        T_OK(p.t.x[i] == 0);
    T_OK(isfinite(p.t.lambda[0]) && p.t.lambda[0] > 0);
    parts_free(&p);
}

/* ---- whole frames -------------------------------------------------------------------------------*/

/* scene_new, trilinear: the rule's basis. */
static void blend_scene(struct scene *s, int32_t w, int32_t grid, unsigned threads)
{
    const struct rec_sysmat_params p = {.binning = 1, .rays_per_bin = 1};
    scene_new(s, 6, w, grid, 1, threads);
    rec_sysmat_free(&s->S);
    s->rig.grid.basis = REC_TRILINEAR;
    T_EQ_I(rec_sysmat_build(&s->rig, &p, s->pool, NULL, NULL, &s->S, NULL), PVX_OK);
}

/* Narrow blobs at random places; tint: how much one differs in colour from the next. */
static void sharp_flame(struct scene *s, double tint)
{
    struct rec_flame_pose *p = &s->pose;
    size_t n = (size_t)s->rig.cameras[0].width * (size_t)s->rig.cameras[0].height;
    float *raw = pvx_calloc(n * 3, sizeof *raw);
    p->n = 60;
    for (int b = 0; b < p->n; b++) {
        double up = (double)(t_rand() % 1000) / 1000, turn = (double)(t_rand() % 6283) / 1000;
        struct rec_blob *q = &p->blob[b];
        *q = (struct rec_blob){.m = {0.2 * cos(turn), 0.2 * sin(turn), 0.15 + 0.7 * up},
                               .s = {0.012, 0.012, 0.03}};
        for (int l = 0; l < 3; l++)
            q->a[l] = 6 * (1 - 0.3 * l) * (1 + (b % 2 ? tint : -tint) * (l - 1));
    }
    rec_flame_voxels(p, &s->rig.grid, 0, s->rig.grid.n[2], s->truth);
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        rec_flame_render(p, &s->rig.cameras[c], 2, 0, s->rig.cameras[c].height, raw);
        for (size_t i = 0; i < n; i++)
            memcpy(s->image[c] + i * 4, raw + i * 3, 3 * sizeof *raw);
    }
    free(raw);
}

struct solved {
    struct rec_solve_report r;
    float *x;
    size_t bytes;
    double error;
};
static struct solved solve_scene(const struct scene *s, enum rec_blend blend, double noise)
{
    struct rec_frame_params p = rec_frame_defaults;
    struct rec_sparse v;
    rec_frame *f;
    p.photo.saturation = 1e30F;
    p.solve.blend = blend;
    T_EQ_I(rec_frame_alone(s->S, &s->rig, &p, s->pool, &f, NULL), PVX_OK);
    uint64_t state = t_state;
    scene_shoot(s, f, noise);
    t_state = state; /* the next one has the same noise */
    rec_frame_carve(f);
    T_EQ_I(rec_frame_solve(f, 0, NULL), PVX_OK);
    rec_frame_volume(f, &v);
    struct solved out = {.r = rec_frame_get_report(f)->solve,
                         .bytes = (size_t)v.n * (size_t)v.cs * sizeof *v.value,
                         .error = scene_error(s, &v)};
    out.x = pvx_calloc(out.bytes, 1);
    memcpy(out.x, v.value, out.bytes);
    rec_frame_free(&f);
    return out;
}
static bool same_bits(struct solved *a, struct solved *b)
{
    bool same = a->bytes == b->bytes && a->bytes > 0 && memcmp(a->x, b->x, a->bytes) == 0;
    free(a->x);
    free(b->x);
    return same;
}

/* A sharp flame on a large grid blends; fewer iterations are of all channels, and the error is no larger. */
T_CASE(a_sharp_flame_blends)
{
    struct scene s;
    blend_scene(&s, 120, 64, 2);
    sharp_flame(&s, 0.1);
    struct solved with = solve_scene(&s, REC_BLEND_AUTO, 0.01),
                  without = solve_scene(&s, REC_BLEND_OFF, 0.01);
    T_OK(with.r.blended > 3);
    T_EQ_I(without.r.blended, 0);
    T_EQ_I(with.r.iterations - with.r.blended, REC_BLEND_AFTER);
    T_OK(without.r.iterations > REC_BLEND_AFTER + 3);
    T_LE(with.error, 1.01 * without.error);
    T_OK(!same_bits(&with, &without));

    struct solved clean =
        solve_scene(&s, REC_BLEND_AUTO, 0); /* fine differences of the channels show */
    T_EQ_I(clean.r.blended, 0);
    free(clean.x);
    sharp_flame(&s, 0.9); /* two kinds of blobs, whose colours are independent */
    struct solved apart = solve_scene(&s, REC_BLEND_AUTO, 0.01),
                  today = solve_scene(&s, REC_BLEND_OFF, 0.01);
    T_OK(same_bits(&apart, &today));
    scene_free(&s);
}

/* A smooth flame, a small grid, the box: not a bit changes. */
T_CASE(others_keep_their_bits)
{
    for (int i = 0; i < 3; i++) {
        struct scene s;
        if (i < 2)
            blend_scene(&s, 96, i == 0 ? 60 : 32, 2);
        else
            scene_new(&s, 6, 96, 60, 1, 2); /* of the box */
        if (i > 0)
            sharp_flame(&s, 0.1);
        struct solved with = solve_scene(&s, REC_BLEND_AUTO, 0.01),
                      without = solve_scene(&s, REC_BLEND_OFF, 0.01);
        T_EQ_I(with.r.blended, 0);
        T_OK(same_bits(&with, &without));
        scene_free(&s);
    }
}

/* What the report says is of the volume that is returned. */
T_CASE(the_report_is_of_the_volume)
{
    struct parts p;
    double rwr[4];
    struct rec_solve_params sp = rec_solve_defaults;
    struct rec_solve_report r;
    parts_new(&p);
    sp.blend = REC_BLEND_ON;
    sp.tolerance = 1e-6F;
    p.y.s->start = REC_START_FITS;
    T_EQ_I(rec_solve(p.y.s, &sp, p.y.x, &r), PVX_OK);
    T_OK(r.blended > 0);
    T_OK(r.blended < r.iterations);
    rec_residual(p.y.s, p.y.x, p.y.s->yv[0], p.y.s->yv[1], rwr);
    T_NEAR(r.residual_norm, sqrt(rec_lanes_total(rwr)), 1e-5 * r.residual_norm);
    for (int l = 0; l < 3; l++)
        T_NEAR(r.misfit2[l], rwr[l] * 3 / p.y.s->m, 1e-5 * r.misfit2[l]);
    for (size_t i = 0; i < p.n * 4; i++)
        T_OK(p.y.x[i] >= 0 && isfinite(p.y.x[i]));
    parts_free(&p);
}

T_CASE_OF_THREADS(same_bits_for_any_number_of_threads)
{
    static const unsigned threads[] = {1, 2, 5};
    struct solved first = {0};
    for (size_t t = 0; t < 3; t++) {
        struct scene s;
        blend_scene(&s, 80, 32, threads[t]);
        struct solved is = solve_scene(&s, REC_BLEND_ON, 0.02);
        T_OK(is.r.blended > 0);
        if (t == 0) {
            first = is;
        } else {
            T_OK(is.bytes == first.bytes && memcmp(is.x, first.x, is.bytes) == 0);
            free(is.x);
        }
        scene_free(&s);
    }
    free(first.x);
}

/* Wherever a deadline falls: the volume is sound. */
T_CASE(deadlines_fall_anywhere)
{
    struct scene s;
    struct rec_frame_params p = rec_frame_defaults;
    struct rec_sparse v;
    rec_frame *f;
    p.photo.saturation = 1e30F;
    p.solve.blend = REC_BLEND_ON;
    blend_scene(&s, 80, 32, 2);
    T_EQ_I(rec_frame_alone(s.S, &s.rig, &p, s.pool, &f, NULL), PVX_OK);
    scene_shoot(&s, f, 0.02);
    rec_frame_carve(f);
    T_EQ_I(rec_frame_solve(f, 0, NULL), PVX_OK);
    int64_t whole = rec_frame_get_report(f)->solve_ns;
    for (int i = 1; i <= 20; i++) {
        T_EQ_I(rec_frame_solve(f, pvx_now_mono() + i * whole / 20, NULL), PVX_OK);
        const struct rec_solve_report *r = &rec_frame_get_report(f)->solve;
        rec_frame_volume(f, &v);
        bool sound = isfinite(r->objective) && isfinite(r->lambda) && isfinite(r->rel_residual);
        for (int32_t k = 0; k < v.n * v.cs; k++)
            sound = sound && v.value[k] >= 0 && v.value[k] < 1e6F;
        T_OK(sound);
        T_OK(r->blended <= r->iterations);
    }
    rec_frame_free(&f);
    scene_free(&s);
}
