/* impl.h - shared by the methods: the loaded problem with its work areas, fused passes.
 * Private to recon/solve. */
#ifndef REC_SOLVE_IMPL_H
#define REC_SOLVE_IMPL_H
#include "base/clock.h"
#include "recon/matrix/collect.h"
#include "recon/solve/lcurve.h"
#include "recon/solve/smooth.h"
#include "recon/solve/solve.h"

#define N_XVEC           8
#define REC_XV_LHAT      6 /* the default method leaves a L xhat of (1b) there */
#define N_YVEC           3
#define REC_OSEM_SUBSETS 4

/* Local strength of the smoothness term at each voxel, V of (1) in pcg.c. */
struct rec_stiff {
    float *by, *inverse; /* V; 1 / V */
    float *diag;         /* diagonal of L V L, without its neighbours' V */
};

/* Content of x when a method begins. */
enum rec_start {
    REC_START_NONE,
    REC_START_ZERO,
    REC_START_SCALED, /* an earlier volume, scaled to the least residual; yv[0], yv[1] hold it */
    REC_START_FITS    /* x fits b already, as a coarser solution does: it shows where it burns */
};

/* The weights with which a solve of the default method ended, and what its solution has of the terms, per lane. */
struct rec_ended {
    double lambda[4];
    double penalty[4]; /* ||V^(1/2) L x||^2, of (1b) where it holds */
    double rwr[4];     /* r'Wr */
};

/* An objective that is given instead of found: (1b) of pcg.c with this lambda, nu, xhat and a L xhat, and with the V
 * and the neighbours that the solve before of the same columns left behind.  Nothing is renewed. */
struct rec_frozen {
    double lambda[4], nu[4];
    const float *expect; /* [n][cs] xhat, and a L xhat; NULL, NULL: (1) */
    float *lhat;
};

struct rec_problem {
    int nch, cs;
    size_t n_max, room; /* voxels of the grid; bins of a vector over rows */

    struct rec_selfcal *selfcal; /* or NULL: pictures are taken as they are */
    struct rec_one *one;         /* room for blend.h; NULL with one channel */

    /* rec_problem_load */
    const struct rec_subsys *a;
    struct rec_pictures in;
    const float *given; /* in.b, or where there are bounds the corrected pictures (selfcal.h) */
    float *b;           /* [room][cs] on A's rows; 0 elsewhere in A's blocks */
    float *bound;       /* [room][cs] of `given` */
    float *w;           /* [room] the same; the largest weight of the channels */
    float *w4;          /* [room][4] the same, of each channel, with in.per_channel */
    bool any;           /* there is something to solve */
    bool whole;         /* every row has weight 1 */
    double b_norm2;     /* ||W^(1/2) b||^2 over A's rows, all channels */
    double light[4];    /* sum of w b over A's rows */
    double m;           /* measured values: rows with weight > 0, times channels */
    /* on a card, where `column` is known from the load on: its sum, and the sum of w A's entries */
    double diagonal, chord;
    /* per channel (else m / nch and 1): rows that measured the channel; its weight over w, which is nearly the ratio
     * of its diagonal of A'WA to `diag` */
    double measured[4], share[4];

    /* rec_problem_weigh, rec_problem_weigh_as */
    bool weighed;
    bool automatic;    /* lambda comes from the data: a method may renew it */
    const float *diag; /* [n] diagonal of A'WA */
    double unit[4];    /* mean of the diagonal, per lane */
    double lambda[4];  /* initial weight of the smoothness term per lane, absolute */
    double formula[4]; /* the same without rec_problem_misfit */
    double noise2[4];  /* variance of b about A x for which it was chosen; 0 when it was given */
    double shot2[4];   /* mean variance of b beyond sigma^2; only where the weight is automatic */

    /* the prediction of x, [n][cs], or NULL (temporal.h); nu and a of (1b) in pcg.c */
    const float *expect;
    double nu[4], keep[4];

    /* of the default method; rec_problem_load: NULL */
    const struct rec_frozen *frozen; /* or NULL: the method finds its weights */
    struct rec_ended ended;          /* out */

    /* start.h */
    enum rec_start start;
    uint32_t renewals;   /* limit, of V and lambda; rec_problem_load: REC_RENEWALS */
    double start_rwr[4]; /* r'Wr of a scaled start */

    /* work areas, all in one piece of memory */
    void *areas;
    size_t bytes;
    float *xv[N_XVEC];        /* [n_max][cs] */
    float *yv[N_YVEC];        /* [room][cs]; a method's first are r and W r */
    struct rec_images images; /* of the product at hand */
    float *corner, *before;   /* [n_max][cs] stop.c: iterates of the L-curve */
    float *column;            /* [n_max] sums of the columns */
    struct rec_run *run;      /* [n_max] */
    float *diag2;             /* [n_max] smooth.h */
    struct rec_stiff stiff;   /* [n_max] */
    int32_t *clipped;         /* [n_max] columns whose step met the bound, chunk by chunk */
    int32_t n_clipped[REC_MAX_CHUNKS];
    double part[2 * REC_MAX_CHUNKS][4][4]; /* partial sums of a pass: task, sum, lane */
};

/* The channels of a problem as one, and the system of that. */
struct rec_one {
    rec_problem problem;
    struct rec_subsys system;
};

/* One method: x from its start to the result.  It sets status, iterations, best, objective and lambda of the report,
 * and residual_norm and solution_norm where it knows them (they come as -1).  rec_solve sets the rest. */
typedef void rec_method(rec_problem *pb, const struct rec_solve_params *p, float *x,
                        struct rec_solve_report *out);
#define REC_METHOD(name, run) rec_method run;
REC_SOLVERS(REC_METHOD)
#undef REC_METHOD

/* lambda.c, (2) to (4): renews an automatic weight from an iterate that it led to.  lit: columns with x > 0; rwr:
 * r'Wr; penalty: ||V^(1/2) L x||^2; each per lane, as lambda [4], in and out. */
void rec_problem_reweigh(const rec_problem *pb, const double rwr[4], const double penalty[4],
                         const double lit[4], double lambda[4]);

/* g of (4): the degrees of freedom of lane l, of which `lit` columns are not at their bound. */
double rec_problem_freedom(const rec_problem *pb, int l, double lit, double lambda);

/* A pass is cut into the chunks of A's rows, or of its columns, or of its rows and then its columns. */
static inline size_t rec_row_chunks(const rec_problem *pb)
{
    return rec_row_pieces(pb->a);
}
static inline size_t rec_column_chunks(const rec_problem *pb)
{
    return rec_chunks(pb->a->n);
}

/* Sum of the lanes. */
static inline double rec_lanes_total(const double v[4])
{
    return v[0] + v[1] + v[2] + v[3];
}

static inline bool rec_late(const struct rec_solve_params *p)
{
    return p->deadline_ns != 0 && pvx_now_mono() >= p->deadline_ns;
}

/* Number of rows in which a lane was measured. */
static inline double rec_rows_of(const rec_problem *pb, int l)
{
    return pb->in.per_channel ? pb->measured[l] : pb->m / pb->nch;
}

/* Weight of row i in lane l. */
static inline float rec_weight_at(const rec_problem *pb, size_t i, size_t l)
{
    return pb->in.per_channel ? pb->w4[i * 4 + l] : pb->w[i];
}
/* Writes `value` as the residual of row i, lane l, to *r and *wr = W r; returns its part of r'Wr. */
static inline double rec_put_residual(const rec_problem *pb, size_t i, size_t l, float value,
                                      float *r, float *wr)
{
    *r = value;
    *wr = rec_weight_at(pb, i, l) * value;
    return (double)*wr * value;
}

/* Weight of row i; `per_channel` is a constant: pb->in.per_channel. */
REC_INLINE rec_f4 rec_row_weight(const rec_problem *pb, size_t i, size_t cs, bool per_channel)
{
    return per_channel ? rec_ld(pb->w4, i, 4) : rec_of_each(pb->w, i, cs);
}

/* Computes A x into the images; chunks of rows then collect their parts. */
static inline void rec_start_product(rec_problem *pb, const float *x)
{
    rec_scatter(pb->a, &pb->images, x);
}
REC_INLINE void rec_take_product(rec_problem *pb, size_t k, float *y)
{
    rec_collect_blocks(pb->a, &pb->images, rec_blocks_of(pb->a, k), y, false);
}

/* q = A d on one chunk of rows, after rec_start_product; out = q'W q per lane. */
REC_INLINE void rec_square(const rec_problem *pb, size_t i, size_t cs, bool per_channel,
                           const float *q, rec_d4 *sum)
{
    rec_f4 v = rec_ld(q, i, cs);
    rec_add_product(sum, rec_row_weight(pb, i, cs, per_channel) * v, v);
}
REC_INLINE void rec_rows_product(rec_problem *pb, size_t k, size_t cs, bool per_channel, float *q,
                                 double out[4])
{
    rec_d4 sum = {0}, quads = {0};
    rec_take_product(pb, k, q);
    if (cs == 1)
        REC_FOR_ROW_QUADS (i, pb->a, k)
            rec_square(pb, i, REC_QUAD, false, q, &quads);
    else
        REC_FOR_ROWS (i, pb->a, k)
            rec_square(pb, i, 4, per_channel, q, &sum);
    rec_put_both(out, &sum, &quads);
}

/* Where a residual is kept: r, and wr = W r. */
struct rec_rows {
    float *r, *wr;
};
/* Row i of it; *sum += r'W r. */
REC_INLINE void rec_put_row(const rec_problem *pb, const struct rec_rows *to, size_t i, size_t cs,
                            bool per_channel, rec_f4 r, rec_d4 *sum)
{
    rec_f4 wr = rec_row_weight(pb, i, cs, per_channel) * r;
    rec_st(to->r, i, cs, r);
    rec_st(to->wr, i, cs, wr);
    rec_add_product(sum, wr, r);
}
/* r += alpha q, wr = W r on one chunk of rows; out = r'W r per lane.  wr may be q. */
struct rec_row_step {
    const double *alpha;
    struct rec_rows to;
    const float *q;
};
REC_INLINE void rec_step_row(const rec_problem *pb, const struct rec_row_step *s, size_t i,
                             size_t cs, bool per_channel, rec_d4 *sum)
{
    rec_f4 v = rec_ld(s->to.r, i, cs) + rec_of_lanes(s->alpha, cs) * rec_ld(s->q, i, cs);
    rec_put_row(pb, &s->to, i, cs, per_channel, v, sum);
}
/* Nine arguments: inlined with constants for cs and per_channel, each caller gets a loop of its own.
 * NOLINTNEXTLINE(readability-function-size) */
REC_INLINE void rec_rows_step(const rec_problem *pb, size_t k, size_t cs, bool per_channel,
                              const double alpha[4], float *r, const float *q, float *wr,
                              double out[4])
{
    const struct rec_row_step s = {alpha, {r, wr}, q};
    rec_d4 sum = {0}, quads = {0};
    if (cs == 1)
        REC_FOR_ROW_QUADS (i, pb->a, k)
            rec_step_row(pb, &s, i, REC_QUAD, false, &quads);
    else
        REC_FOR_ROWS (i, pb->a, k)
            rec_step_row(pb, &s, i, 4, per_channel, &sum);
    rec_put_both(out, &sum, &quads);
}

/* Sums slot `what` of the partial results [from, to), lane by lane, in order. */
void rec_sum(const rec_problem *pb, size_t from, size_t to, int what, double out[4]);
/* r = A x - b, wr = W r, two different arrays; out = r'Wr per lane. */
void rec_residual(rec_problem *pb, const float *x, float *r, float *wr, double out[4]);
/* ||v|| over active columns, all lanes. */
double rec_norm_x(rec_problem *pb, const float *v);
/* dst = src, [n][cs]. */
void rec_copy_x(rec_problem *pb, float *dst, const float *src);
/* x = 0, [n][cs]. */
void rec_clear_x(rec_problem *pb, float *x);

/* Writes the residual of the start x to yv[0] and yv[1], without a product where none is needed.  out: r'Wr per lane, on
 * a card with the sums of the next operation (card.h). */
void rec_start_residual(rec_problem *pb, const float *x, double out[4]);
/* Start of the multiplicative methods, which never leave zero.  A cold start is the uniform volume that has the
 * images' light.  A warm start is lifted to at least a hundredth of that volume.  Voxels without weight are 0.  sens
 * [n]: column sums of W A. */
void rec_start_positive(rec_problem *pb, const float *sens, float *x);

#endif
