/* test_cl_ops_solves.c - starts of a solve on a device, and whole solves, against those of the processor. */
#include "tests/lib/cl_ops.h"

/* ---- levels.c ------------------------------------------------------------------------------------*/

/* A value of the coarse grid, 0 where it has no column. */
static float coarse_value(const struct rec_grid *g, const int32_t *at, const float *x, size_t cs,
                          const int32_t ijk[3])
{
    for (int i = 0; i < 3; i++)
        if (ijk[i] < 0 || ijk[i] >= g->n[i])
            return 0;
    int32_t q = at[rec_grid_index(g, ijk[0], ijk[1], ijk[2])];
    return q < 0 ? 0 : x[(size_t)q * cs];
}
/* (1) of levels.h along the axes up to `axis`, for the half `up` of each. */
static float refined(const struct rec_grid *g, const int32_t *at, const float *x, size_t cs,
                     const int32_t ijk[3], const int up[3], int axis)
{
    float c[3];
    for (int m = 0; m < 3; m++) {
        int32_t to[3] = {ijk[0], ijk[1], ijk[2]};
        to[axis] += m - 1;
        c[m] = axis == 0 ? coarse_value(g, at, x, cs, to) : refined(g, at, x, cs, to, up, axis - 1);
    }
    float d = 0.125f * (c[2] - c[0]);
    return up[axis] ? c[1] + d : c[1] - d;
}

static void refines(struct bed *b)
{
    const rec_sysmat *C = b->s.S->coarse;
    struct rec_cl_part *part = &b->y->part[1];
    struct rec_subsys coarse = {.S = C, .card = &part->base, .cs = (int)b->cs, .n = part->n};
    size_t n = (size_t)part->n, wrong = 0, burns = 0;
    int32_t *at = pvx_calloc(rec_grid_count(&C->grid), sizeof *at);
    int32_t *col = pvx_calloc(n, sizeof *col);
    rec_cl_download(b->y->queue, &part->col, 0, col, n * sizeof *col);
    T_OK(rec_cl_wait(b->y->queue) && n > 20);
    memset(at, -1, rec_grid_count(&C->grid) * sizeof *at);
    for (size_t q = 0; q < n; q++)
        at[col[q]] = (int32_t)q;
    float *x = pvx_calloc(n * b->cs, sizeof *x);
    for (size_t i = 0; i < n * b->cs; i++)
        x[i] = (float)fmax(t_normal(), 0);
    const float *name = b->descent.x[0] + b->cs;
    up(b, name, x, n * b->cs);
    b->sub->card->op->refine(&coarse, name, b->sub, b->t[THERE].x);
    float *got = down(b, b->t[THERE].x, b->n * b->cs);
    for (size_t i = 0; i < b->n * b->cs; i++) {
        int32_t ijk[3], half[3];
        rec_grid_ijk(&b->s.rig.grid, b->col[i / b->cs], ijk);
        for (int m = 0; m < 3; m++)
            half[m] = ijk[m] / 2;
        const int up_of[3] = {ijk[0] & 1, ijk[1] & 1, ijk[2] & 1};
        float v = refined(&C->grid, at, x + i % b->cs, b->cs, half, up_of, 2);
        wrong += got[i] != (v > 0 ? v : 0);
        burns += v > 0;
    }
    T_EQ_I(wrong, 0);
    T_OK(burns > b->n / 4 && burns < b->n * b->cs);
    free(at);
    free(col);
    free(x);
    free(got);
}

/* A volume of other voxels, more than there is room for at once. */
static void takes_an_earlier_volume(struct bed *b)
{
    size_t n = b->s.voxels / 2, kept = 0, wrong = 0;
    int32_t *index = pvx_calloc(n, sizeof *index);
    float *value = pvx_calloc(n * b->cs, sizeof *value);
    for (size_t i = 0; i < n; i++)
        index[i] = (int32_t)(2 * i + 1);
    for (size_t i = 0; i < n * b->cs; i++)
        value[i] = (float)t_uniform(0.1, 1);
    rec_cl_solver_earlier(b->v, (int32_t)n, index, value);
    float *got = pvx_calloc(b->n * b->cs, sizeof *got);
    T_OK(rec_cl_solver_end(b->v, got));
    for (size_t i = 0; i < b->n * b->cs; i++) {
        size_t voxel = (size_t)b->col[i / b->cs];
        bool has = voxel % 2 == 1 && voxel / 2 < n;
        wrong += got[i] != (has ? value[voxel / 2 * b->cs + i % b->cs] : 0);
        kept += has;
    }
    T_EQ_I(wrong, 0);
    T_OK(kept > 0 && kept < b->n * b->cs);
    free(index);
    free(value);
    free(got);
}

T_CASE(starts_are_those_of_the_processor)
{
    for (enum way way = GREY; way <= MOSAIC; way++) {
        if (cl_bed_is_simulated() && way != MOSAIC)
            continue;
        struct bed b;
        bed_new(&b, 33, way);
        refines(&b);
        takes_an_earlier_volume(&b);
        bed_free(&b);
    }
}

/* ---- whole solves --------------------------------------------------------------------------------*/

/* Solves from the coarser grids, or from an earlier volume: `b->f->x`, or a volume that is on the device. */
static void solve(struct bed *b, int i, bool warm, const struct rec_solve_params *p,
                  struct rec_solve_report *out, uint32_t *coarse)
{
    rec_problem *pb = b->pb[i];
    struct rec_descent *d = i == HERE ? &b->f->solver->descent : &b->descent;
    d->levels = i == HERE ? b->f->levels : b->levels;
    T_OK(rec_problem_load(pb, i == HERE ? b->f->sub : b->sub, &b->in));
    rec_problem_weigh(pb, -1);
    (void)rec_levels_start(pb, d, b->t[i].x, warm ? d->spare : NULL);
    *coarse = d->iterations;
    T_EQ_I(rec_solve(pb, p, b->t[i].x, out), PVX_OK);
}

/* The largest difference from the processor's volume, over its largest value. */
static double apart(const struct bed *b, const float *got)
{
    double most = 0, off = 0;
    for (size_t i = 0; i < b->n * b->cs; i++) {
        most = fmax(most, (double)b->f->x[i]);
        off = fmax(off, fabs((double)got[i] - (double)b->f->x[i]));
    }
    return off / most;
}

static void solves(struct bed *b, enum way way, enum rec_blend blend)
{
    struct rec_solve_params p = rec_solve_defaults;
    struct rec_solve_report r[2];
    uint32_t coarse[2];
    float *got = pvx_calloc(b->n * b->cs, sizeof *got);
    float *again = pvx_calloc(b->n * b->cs, sizeof *again);
    p.blend = blend;
    for (int warm = 0; warm < 2; warm++) {
        for (int i = 0; i < 2; i++)
            solve(b, i, warm, &p, &r[i], &coarse[i]);
        T_OK(rec_cl_solver_end(b->v, got));
        T_EQ_I(r[THERE].status, r[HERE].status);
        T_EQ_I(coarse[THERE], coarse[HERE]);
        T_OK(r[HERE].iterations > 0 && coarse[HERE] > 0);
        T_EQ_I(r[THERE].iterations, r[HERE].iterations);
        T_EQ_I(r[THERE].blended, r[HERE].blended);
        T_EQ_I(r[HERE].blended > 0, blend == REC_BLEND_ON && way == COLOUR);
        double off = apart(b, got);
        /* each iteration adds the rounding of products of some 100 terms */
        double n = 100 * 0x1p-24 * (double)(coarse[HERE] + r[HERE].iterations);
        T_LE(off, n);
        T_NEAR(r[THERE].objective, r[HERE].objective, n * r[HERE].objective);
        if (warm == 0) { /* the same bits once more */
            solve(b, THERE, false, &p, &r[THERE], &coarse[THERE]);
            T_OK(rec_cl_solver_end(b->v, again));
            T_OK(memcmp(got, again, b->n * b->cs * sizeof *got) == 0);
        }
    }
    free(got);
    free(again);
}

T_CASE(whole_solves_are_those_of_the_processor)
{
    if (cl_bed_is_simulated())
        T_SKIP("simulated: the other cases have the same kernels");
    for (enum way way = GREY; way <= MOSAIC; way++) {
        struct bed b;
        bed_new(&b, 32, way);
        solves(&b, way, REC_BLEND_OFF);
        if (way == COLOUR)
            solves(&b, way, REC_BLEND_ON);
        T_OK(rec_cl_lost(cl) == NULL);
        bed_free(&b);
    }
}
T_MAIN((cl_bed_begin(), cl = cl_bed_open()), rec_cl_close(&cl))
