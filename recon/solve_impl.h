/* solve_impl.h - what the solvers share: work areas, the job of one solve, fused passes.
 * Private to solve*.c. */
#ifndef REC_SOLVE_IMPL_H
#define REC_SOLVE_IMPL_H
#include "recon/solve/lcurve.h"
#include "recon/solve/smooth.h"
#include "recon/solve/solve.h"

#define N_XVEC           9
#define N_YVEC           3
#define REC_OSEM_SUBSETS 4

/* How strongly the smoothness term holds at a voxel. */
struct rec_stiff {
    float by, inverse; /* and 1 / by */
};

/* Sized for the worst case (every voxel active) in reserved address space. */
struct rec_solver {
    const rec_sysmat *S;
    int nch, cs;
    size_t n_max, rows_max;                  /* voxels of the grid; rows of S */
    float *xv[N_XVEC];                       /* [n_max][cs] */
    float *yv[N_YVEC];                       /* [rows_max][cs] */
    float *b;                                /* [rows_max][cs] b on A's rows */
    float *weight;                           /* [rows_max] w on A's rows; the most over channels */
    float *weight4;                          /* [rows_max][4] with lanes: of each channel */
    float *diag;                             /* [n_max] */
    struct rec_near *near;                   /* [n_max] */
    struct rec_stiff *stiff;                 /* [n_max] */
    uint32_t (*piece)[REC_OSEM_SUBSETS + 1]; /* [n_max] where the subsets' entries start (osem) */
    int32_t *clipped; /* [n_max] columns whose step met the bound, chunk by chunk */
    int32_t n_clipped[REC_MAX_CHUNKS];
    bool whole, lanes;                        /* as m */
    double b_norm2, m, measured[4], share[4]; /* of the last rec_solve_weight */
    double part[2 * REC_MAX_CHUNKS][4][4];    /* partial sums of a pass: task, sum, lane */
};

struct rec_job {
    rec_solver *s;
    const struct rec_subsys *a;
    const float *b, *w;                /* on A's rows */
    const float *w4;                   /* [rows][4], or NULL: every channel has w */
    const float *image, *image_weight; /* the same on all rows of S */
    const float *diag;                 /* diagonal of A'WA, once rec_job_lambda was there */
    bool have_diag;                    /* s->diag is filled */
    bool whole;                        /* every row has weight 1 */
    bool zero;                         /* the start is zero */
    bool scaled;                       /* yv[0], yv[1], start_rwr hold what rec_job_start gives */
    double start_rwr[4];
    double sigma;
    const struct rec_solve_params *p;
    float *x;
    rec_trace_fn trace;
    void *trace_ctx;
    struct rec_solve_report *out;
    double b_norm2;  /* || W^(1/2) b ||^2 over A's rows, all channels */
    double light[4]; /* sum of b over A's rows with weight */
    double m;        /* measured values: rows with weight > 0, times channels */
    /* with w4, else m / nch and 1: rows that a channel was measured in; its weight over that of w, which
     * is what its diagonal of A'WA is over `diag`, nearly */
    double measured[4], share[4];
};

/* One method: fills x and of the report status, iterations, best, objective, lambda, and residual_norm
 * and solution_norm where they are known (they come as -1).  The rest is the caller's. */
void rec_solve_pcg(struct rec_job *j);
void rec_solve_cgls_paper(struct rec_job *j);
void rec_solve_cgls(struct rec_job *j);
void rec_solve_mlem(struct rec_job *j);
void rec_solve_osem(struct rec_job *j);
void rec_solve_sirt(struct rec_job *j);
void rec_solve_fista(struct rec_job *j);
void rec_solve_mrnsd(struct rec_job *j);

/* A pass is cut into the chunks of A's rows or columns, or the rows' and then the columns'. */
static inline size_t rec_job_row_chunks(const struct rec_job *j)
{
    return rec_chunks(j->a->rows);
}
static inline size_t rec_job_chunks(const struct rec_job *j)
{
    return rec_chunks(j->a->n);
}

/* Sum of the lanes. */
static inline double rec_lanes_total(const double v[4])
{
    return v[0] + v[1] + v[2] + v[3];
}

/* Weight of row i; `lanes` is a constant: j->w4 is there. */
REC_INLINE rec_f4 rec_job_weight(const struct rec_job *j, size_t i, bool lanes)
{
    return lanes ? rec_ld(j->w4, i, 4) : rec_splat(j->w[i]);
}

/* q = A d on one chunk of rows; out = q'W q per lane. */
REC_INLINE void rec_rows_product(const struct rec_job *j, size_t k, size_t cs, bool lanes,
                                 const float *d, float *q, double out[4])
{
    int32_t i0, i1;
    rec_d4 sum = {0};
    rec_chunk_range(j->a->rows, k, &i0, &i1);
    rec_forward_range(j->a, d, i0, i1, q);
    for (size_t i = (size_t)i0; i < (size_t)i1; i++) {
        rec_f4 v = rec_ld(q, i, cs);
        rec_add_product(&sum, rec_job_weight(j, i, lanes) * v, v);
    }
    rec_put(out, &sum);
}
/* r += alpha q, wr = W r on one chunk of rows; out = r'W r per lane.  wr may be q. */
REC_INLINE void rec_rows_step(const struct rec_job *j, size_t k, size_t cs, bool lanes,
                              const double alpha[4], float *r, const float *q, float *wr,
                              double out[4])
{
    int32_t i0, i1;
    rec_f4 by = rec_coef(alpha);
    rec_d4 sum = {0};
    rec_chunk_range(j->a->rows, k, &i0, &i1);
    for (size_t i = (size_t)i0; i < (size_t)i1; i++) {
        rec_f4 v = rec_ld(r, i, cs) + by * rec_ld(q, i, cs), wv = rec_job_weight(j, i, lanes) * v;
        rec_st(r, i, cs, v);
        rec_st(wr, i, cs, wv);
        rec_add_product(&sum, wv, v);
    }
    rec_put(out, &sum);
}

/* Sum slot `what` of the partial results [from, to), lane by lane, in order. */
void rec_job_sum(const struct rec_job *j, size_t from, size_t to, int what, double out[4]);

/* r = A x - b, wr = W r, two different arrays; out = r'Wr per lane. */
void rec_job_residual(struct rec_job *j, const float *x, float *r, float *wr, double out[4]);
/* The same for the start x into yv[0] and yv[1], without a product where it is not needed. */
void rec_job_start(struct rec_job *j, double out[4]);
/* Weight of the smoothness term per lane, absolute, from the parameters or the data (lambda.c); fills
 * j->diag with the diagonal of A'WA. */
void rec_job_lambda(struct rec_job *j, double lambda[4], double noise2[4]);
/* ||v|| over active columns, all lanes. */
double rec_job_norm_x(struct rec_job *j, const float *v);
/* dst = src, [n][cs]. */
void rec_job_copy(struct rec_job *j, float *dst, const float *src);

bool rec_job_late(const struct rec_job *j);
/* Noise target of the discrepancy principle: sigma^2 m; 0 when sigma is unknown. */
double rec_job_noise2(const struct rec_job *j);

#endif
