#include "recon/opencl/solver.h"

#include <assert.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/opencl/ops.h"

/* ---- twins ----------------------------------------------------------------------------------------*/

const struct rec_cl_buffer *rec_cl_twin_of(const rec_cl_solver *s, const float *here)
{
    size_t i = 0;
    while (i < s->twins && s->twin[i].here != here)
        i++;
    assert(i < s->twins);
    return s->twin[i].on;
}

static void twin_name(rec_cl_solver *s, const float *here, const struct rec_cl_buffer *on)
{
    assert(s->twins < REC_CL_TWINS);
    s->twin[s->twins++] = (struct rec_cl_twin){here, on};
}

/* A vector of `n` entries with so many floats each. */
static pvx_err twin_make(rec_cl_solver *s, const float *here, size_t n, size_t floats,
                         struct pvx_diag *d)
{
    struct rec_cl_buffer *on = &s->own[s->owned];
    PVX_TRY(rec_cl_buffer_new(s->cl, n * floats * sizeof *here, on, d));
    s->owned++;
    twin_name(s, here, on);
    return PVX_OK;
}

/* What blend.c needs: vectors of one lane. */
static pvx_err twin_blend(rec_cl_solver *s, rec_problem *pb, size_t n, size_t rows,
                          struct pvx_diag *d)
{
    PVX_TRY(twin_make(s, pb->corner, n, 1, d));
    PVX_TRY(twin_make(s, pb->yv[2], rows, 1, d));
    return twin_make(s, pb->bound, rows, 1, d);
}

/* The vectors of a problem on `level` that the default method has without a prediction. */
static pvx_err twin_problem(rec_cl_solver *s, rec_problem *pb, size_t n,
                            const struct rec_cl_level *level, struct pvx_diag *d)
{
    const size_t cs = (size_t)s->cs, rows = (size_t)level->g.room;
    const float *each[] = {pb->column, pb->diag2, pb->stiff.by, pb->stiff.inverse, pb->stiff.diag};
    for (size_t i = 0; i < N_XVEC; i++)
        if (i != REC_XV_LHAT)
            PVX_TRY(twin_make(s, pb->xv[i], n, cs, d));
    for (size_t i = 0; i < sizeof each / sizeof *each; i++)
        PVX_TRY(twin_make(s, each[i], n, 1, d));
    PVX_TRY(twin_make(s, pb->yv[0], rows, cs, d));
    PVX_TRY(twin_make(s, pb->yv[1], rows, cs, d));
    PVX_TRY(twin_make(s, pb->b, rows, cs, d));
    PVX_TRY(twin_make(s, pb->w, rows, 1, d));
    if (s->cs == 1)
        return PVX_OK;
    PVX_TRY(twin_make(s, pb->w4, rows, 4, d));
    return twin_blend(s, pb, n, rows, d);
}

/* A solution of a level of the descent, which levels.c names by its begin and by the place after one zero. */
static pvx_err twin_solution(rec_cl_solver *s, const float *x, size_t n, struct pvx_diag *d)
{
    PVX_TRY(twin_make(s, x + s->cs, n, (size_t)s->cs, d));
    twin_name(s, x, &s->own[s->owned - 1]);
    return PVX_OK;
}

/* Room for columns on a level. */
static size_t solver_room(const rec_cl_solver *s, size_t columns, int level)
{
    size_t voxels = (size_t)s->m->level[level].g.voxels;
    return columns < voxels ? columns : voxels;
}

static pvx_err twin_descent(rec_cl_solver *s, struct rec_descent *to, size_t columns,
                            struct pvx_diag *d)
{
    PVX_TRY(twin_problem(s, to->problem, solver_room(s, columns, 1), &s->m->level[1], d));
    for (int i = 0; i < 2 && i + 1 < s->m->levels; i++)
        PVX_TRY(twin_solution(s, to->x[i], solver_room(s, columns, 1 + i), d));
    return twin_make(s, to->spare, solver_room(s, columns, 0), (size_t)s->cs, d);
}

/* ---- a solver -------------------------------------------------------------------------------------*/

/* smooth.h of all levels. */
static pvx_err solver_smooth(rec_cl_solver *s, struct pvx_diag *d)
{
    struct rec_cl_smooth to[REC_CL_LEVELS];
    for (int i = 0; i < s->m->levels; i++) {
        struct rec_smooth from;
        rec_smooth_init(&from, &s->m->level[i].S->grid);
        memcpy(to[i].axis, from.axis, sizeof from.axis);
        memcpy(to[i].centre, from.centre, sizeof from.centre);
        memcpy(to[i].diag2, from.diag2_of, sizeof from.diag2_of);
        PVX_TRY(rec_cl_buffer_new(s->cl, sizeof *to, &s->smooth[i], d));
        rec_cl_upload(s->queue, &s->smooth[i], 0, &to[i], sizeof *to);
    }
    return rec_cl_wait(s->queue) ? PVX_OK : pvx_fail(d, PVX_ENODEV, "%s", rec_cl_lost(s->cl));
}

static pvx_err solver_make(rec_cl_solver *s, size_t columns, struct rec_descent *descent,
                           struct pvx_diag *d)
{
    const struct rec_cl_level *level = &s->m->level[0];
    const size_t cameras = (size_t)level->g.cameras;
    const size_t n = solver_room(s, columns, 0);
    s->bytes = (size_t)s->cs * sizeof *s->x; /* it is a name alone */
    PVX_NEED(s->x = pvx_reserve(s->bytes));
    PVX_TRY(rec_cl_queue_new(s->cl, &s->queue, d));
    PVX_TRY(twin_problem(s, s->problem, n, level, d));
    PVX_TRY(twin_make(s, s->x, n, (size_t)s->cs, d));
    if (descent != NULL)
        PVX_TRY(twin_descent(s, descent, columns, d));
    PVX_TRY(rec_cl_buffer_new(s->cl, cameras * sizeof(struct rec_cl_shot), &s->shot, d));
    PVX_TRY(rec_cl_buffer_new(
        s->cl, cameras * REC_SELFCAL_TILES * REC_SELFCAL_SUMS * sizeof(double), &s->tiles, d));
    return solver_smooth(s, d);
}

pvx_err rec_cl_solver_new(rec_cl_matrix *m, int cs, size_t columns, rec_problem *fine,
                          struct rec_descent *d, rec_cl_solver **out, struct pvx_diag *d_)
{
    rec_cl_solver *s = *out = pvx_calloc(1, sizeof *s);
    PVX_NEED(s);
    s->m = rec_cl_matrix_share(m);
    s->cl = m->cl;
    s->cs = cs;
    s->problem = fine;
    pvx_err e = solver_make(s, columns, d, d_);
    if (e != PVX_OK) {
        rec_cl_solver_free(out);
        return e;
    }
    return PVX_OK;
}

void rec_cl_solver_free(rec_cl_solver **sp)
{
    rec_cl_solver *s = *sp;
    if (s == NULL)
        return;
    for (size_t i = 0; i < s->owned; i++)
        rec_cl_buffer_free(s->cl, &s->own[i]);
    for (int i = 0; i < REC_CL_LEVELS; i++)
        rec_cl_buffer_free(s->cl, &s->smooth[i]);
    rec_cl_buffer_free(s->cl, &s->shot);
    rec_cl_buffer_free(s->cl, &s->tiles);
    rec_cl_queue_free(&s->queue);
    rec_cl_matrix_free(&s->m);
    pvx_unreserve(s->x, s->bytes);
    PVX_FREE(*sp);
}

/* ---- a frame set ----------------------------------------------------------------------------------*/

void rec_cl_solver_begin(rec_cl_solver *s, rec_cl_system *y)
{
    s->y = y;
    y->solver = s;
    rec_cl_after(s->queue, y->queue);
}

float *rec_cl_solver_x(rec_cl_solver *s)
{
    return s->x;
}

/* Vectors that are free before a solve take the volume, as many voxels at a time as they have room for. */
void rec_cl_solver_earlier(rec_cl_solver *s, int32_t n, const int32_t *index, const float *value)
{
    const struct rec_cl_part *a = &s->y->part[0];
    const struct rec_cl_buffer *x = rec_cl_twin_of(s, s->x);
    const struct rec_cl_buffer *at = rec_cl_twin_of(s, s->problem->xv[0]);
    const struct rec_cl_buffer *from = rec_cl_twin_of(s, s->problem->xv[1]);
    const size_t lanes = (size_t)s->cs * sizeof *value, room = from->bytes / lanes;
    rec_cl_zero(s->queue, x, 0, (size_t)a->n * lanes);
    for (size_t begin = 0; begin < (size_t)n; begin += room) {
        size_t left = (size_t)n - begin;
        uint32_t some = (uint32_t)(left < room ? left : room);
        rec_cl_upload(s->queue, at, 0, index + begin, some * sizeof *index);
        rec_cl_upload(s->queue, from, 0, value + begin * (size_t)s->cs, some * lanes);
        REC_CL_RUN(s->queue, REC_CL_K_EARLIER, s->cs, rec_cl_groups(some), REC_CL_FLAT,
                   REC_CL_VALUE(some), REC_CL_BUFFER(at), REC_CL_BUFFER(from),
                   REC_CL_BUFFER(&a->map), REC_CL_BUFFER(x));
    }
}

bool rec_cl_solver_end(rec_cl_solver *s, float *to)
{
    size_t bytes = (size_t)s->y->part[0].n * (size_t)s->cs * sizeof *to;
    assert(s->wanted == 0 && !s->later); /* sums that are on their way have a place that is gone */
    rec_cl_download(s->queue, rec_cl_twin_of(s, s->x), 0, to, bytes);
    return rec_cl_wait(s->queue);
}
