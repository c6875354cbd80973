/* ops.h - a solver on a device, for the files that have its operations: sums.c, ops_problem.c, ops_pcg.c and ops.c.
 * Private to recon/opencl. */
#ifndef REC_CL_OPS_H
#define REC_CL_OPS_H
#include "recon/opencl/products.h"
#include "recon/opencl/solver.h"
#include "recon/solve/selfcal.h"

#define REC_CL_TWINS 64

/* A vector on the device, and the address by which the host names it. */
struct rec_cl_twin {
    const float *here;
    const struct rec_cl_buffer *on;
};

struct rec_cl_solver {
    rec_cl_matrix *m;
    rec_cl *cl;
    rec_cl_queue *queue;
    int cs;
    rec_cl_system *y;     /* rec_cl_solver_begin */
    rec_problem *problem; /* of the finest level */
    float *x;             /* the name of x, in reserved address space */
    size_t bytes;
    struct rec_cl_twin twin[REC_CL_TWINS];
    size_t twins;
    struct rec_cl_buffer own[REC_CL_TWINS]; /* their memory */
    size_t owned;

    struct rec_cl_buffer smooth[REC_CL_LEVELS]; /* struct rec_cl_smooth */
    struct rec_cl_buffer shot;                  /* struct rec_cl_shot [cameras] */
    struct rec_cl_buffer tiles; /* double [cameras][REC_SELFCAL_TILES][REC_SELFCAL_SUMS] */

    /* Sums that are on their way, by their slots of the queue's parts. */
    struct {
        double *to; /* [4] */
        uint32_t groups;
    } want[REC_CL_SUMS];
    uint32_t wanted;
    bool later; /* the next ones are not waited for (card.h) */
};

/* The twin of a vector. */
const struct rec_cl_buffer *rec_cl_twin_of(const rec_cl_solver *s, const float *here);

/* What an operation on a system needs. */
struct rec_cl_at {
    rec_cl_solver *s;
    rec_cl_queue *q;
    const struct rec_cl_part *a;
    int cs;
    uint32_t n, bins;     /* columns; bins of active tiles */
    size_t columns, rows; /* groups of a loop over them */
};
static inline struct rec_cl_at rec_cl_at(const struct rec_subsys *sub)
{
    const struct rec_cl_part *a = rec_cl_part_of(sub);
    struct rec_cl_at t = {.s = a->of->solver,
                          .a = a,
                          .cs = sub->cs,
                          .n = (uint32_t)a->n,
                          .bins = a->tiles * REC_CL_GROUP};
    t.q = t.s->queue;
    t.columns = rec_cl_groups(t.n);
    t.rows = rec_cl_groups(t.bins);
    return t;
}
static inline size_t rec_cl_level_of(const struct rec_cl_at *t)
{
    return (size_t)(t->a - t->a->of->part);
}

/* Arguments: a vector; the bins of a system; weights of a problem; neighbours.  t: struct rec_cl_at *. */
#define REC_CL_VECTOR(t, here) REC_CL_BUFFER(rec_cl_twin_of((t)->s, here))
#define REC_CL_BINS(t) \
    REC_CL_VALUE((t)->bins), REC_CL_BUFFER(&(t)->a->level->geometry), REC_CL_BUFFER(&(t)->a->tile)
#define REC_CL_WEIGHTS(t, pb, four) \
    REC_CL_VECTOR(t, (pb)->w), REC_CL_VECTOR(t, (four) ? (pb)->w4 : (pb)->w), REC_CL_VALUE(four)
#define REC_CL_NEAR(t)                                                                \
    REC_CL_BUFFER(&(t)->s->smooth[rec_cl_level_of(t)]), REC_CL_BUFFER(&(t)->a->near), \
        REC_CL_VALUE((t)->a->room)
/* Of a kernel that has sums: the parts, and its first slot.  rec_cl_want follows it for each of them. */
#define REC_CL_TO_PARTS(t) REC_CL_BUFFER(rec_cl_parts((t)->q)), REC_CL_VALUE((t)->s->wanted)
/* Kernels over columns, over bins. */
#define REC_CL_COLUMNS(t, kernel, ...) \
    REC_CL_RUN((t)->q, kernel, (t)->cs, (t)->columns, REC_CL_FLAT, __VA_ARGS__)
#define REC_CL_ROWS(t, kernel, ...) \
    REC_CL_RUN((t)->q, kernel, (t)->cs, (t)->rows, REC_CL_FLAT, __VA_ARGS__)

static inline cl_float4 rec_cl_four(const double v[4])
{
    return (cl_float4){{(float)v[0], (float)v[1], (float)v[2], (float)v[3]}};
}
static inline int rec_cl_per_channel(const rec_problem *pb)
{
    return pb->in.per_channel;
}

/* ---- sums.c ---------------------------------------------------------------------------------------*/

/* The next sum of the kernel that was enqueued last, over its groups, goes to to [4]. */
void rec_cl_want(const struct rec_cl_at *t, size_t groups, double to[4]);
/* Waits for the sums that are wanted, or leaves them to the next call (rec_cl_later); lost: all 0. */
void rec_cl_fetch(const struct rec_cl_at *t);
/* rec_card_later. */
void rec_cl_later(const struct rec_subsys *sub);
/* All n sums of one kernel, and those that wait. */
static inline void rec_cl_sums_of(const struct rec_cl_at *t, size_t groups, size_t n,
                                  double (*out)[4])
{
    for (size_t i = 0; i < n; i++)
        rec_cl_want(t, groups, out[i]);
    rec_cl_fetch(t);
}

/* ---- the operations -------------------------------------------------------------------------------*/

/* ops_problem.c */
void rec_cl_load(rec_problem *pb, struct rec_card_load *out);
void rec_cl_residual(rec_problem *pb, const float *x, float *r, float *wr, double rwr[4]);
void rec_cl_copy_x(rec_problem *pb, float *to, const float *from);
void rec_cl_clear_x(rec_problem *pb, float *x);
void rec_cl_square(rec_problem *pb, const float *x, double out[4]);
void rec_cl_zero_residual(rec_problem *pb, float *r, float *wr, double rwr[4]);
void rec_cl_fit(rec_problem *pb, const float *r, double fit[4], double size[4]);
void rec_cl_scale(rec_problem *pb, const float scale[4], float *x, float *r, float *wr,
                  double rwr[4]);
void rec_cl_differences(rec_problem *pb, double first[4], double second[4], double *blocks);
/* ops_pcg.c */
void rec_cl_pass(struct rec_pcg *t, enum rec_pcg_pass pass, double (*sums)[4]);

#endif
