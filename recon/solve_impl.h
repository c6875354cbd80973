/* solve_impl.h - what the solvers share: work areas, the job of one solve, fused passes.
 * Private to solve*.c. */
#ifndef REC_SOLVE_IMPL_H
#define REC_SOLVE_IMPL_H
#include "recon/lcurve.h"
#include "recon/smooth.h"
#include "recon/solve.h"

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
    float *weight;                           /* [rows_max] w on A's rows */
    float *diag;                             /* [n_max] */
    struct rec_near *near;                   /* [n_max] */
    struct rec_stiff *stiff;                 /* [n_max] */
    uint32_t (*piece)[REC_OSEM_SUBSETS + 1]; /* [n_max] where the subsets' entries start (osem) */
    int32_t *clipped; /* [n_max] columns whose step met the bound, chunk by chunk */
    int32_t n_clipped[REC_MAX_CHUNKS];
    bool whole;                            /* as m */
    double b_norm2, m;                     /* of the last rec_solve_weight */
    double part[2 * REC_MAX_CHUNKS][4][4]; /* partial sums of a pass: task, sum, lane */
};

struct rec_job {
    rec_solver *s;
    const struct rec_subsys *a;
    const float *b, *w;                /* on A's rows */
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
};

/* One method: fills x and of the report status, iterations, best, objective, lambda, and
 * residual_norm where it is known.  Other norms and time are the caller's. */
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
