/* pcg_pass.h - the loops of pcg.c over voxels and rays, compiled once per instruction set.
 *
 * Each runs over the fixed chunks of subsys.h and writes its sums to the partial results of the workspace, so nothing
 * depends on the threads.  Except for the FMA of the gather kernels, nothing depends on the instruction set either.
 * Equations (1) to (6) are those of pcg.c.
 * Private to the solver. */
#ifndef REC_PCG_PASS_H
#define REC_PCG_PASS_H
#include "recon/solve/impl.h"

enum { S_A, S_B, S_C };

/* ctx: struct rec_pcg.  A task is a chunk of columns.  For curvature and residual it is a chunk of rows, and after
 * those one of columns; for clipped it is a slab. */
struct rec_pcg_passes {
    pvx_task_fn expected;  /* lhat = a L expect */
    pvx_task_fn begin;     /* neighbours; V = 1; d = 0 */
    pvx_task_fn scale;     /* S of (6) */
    pvx_task_fn direction; /* (4); sum A: d'phi */
    pvx_task_fn curvature; /* rows: q = A d, sum A: q'Wq; columns, sum A: d'L V L d */
    pvx_task_fn step;      /* (5): next, the clipped columns; sum A: ||next - x||^2 */
    pvx_task_fn clipped;   /* the change of A d by clipping, A e, into the images */
    pvx_task_fn residual;  /* rows: q where clipped, r, q = W r, sum A: r'Wr; columns: smoothness */
    pvx_task_fn smoothness; /* lx = V L x; sums A x'L lx, B ||x||^2 */
    pvx_task_fn brightness; /* lx = L x; (2a): y to next, sums A y, B y^2, C columns with x > 0 */
    pvx_task_fn stiffness;  /* V of (2a) from that, lx = V lx; sum A: x'L lx */
    pvx_task_fn gradient;   /* ar, (3); sums A phi'M phi, B phi'M phi_old */
    pvx_task_fn regradient; /* the same from the existing ar */
    pvx_task_fn slope;      /* sum A: (next - x)'phi */
    pvx_task_fn retreat;    /* next = x + back (next - x) */
};

struct rec_pcg {
    const struct rec_pcg_passes *pass;
    rec_problem *pb;
    struct rec_smooth smooth;
    struct rec_stiff stiff;              /* [n] V of (1) */
    float *x, *next, *phi, *phi_old, *d; /* x space */
    float *lx, *ar;                      /* V L x, A'W r */
    float *scale;                        /* S of (6), [n][cs] */
    const float *expect;                 /* or NULL */
    float *lhat;                         /* a L expect */
    double nu[4];
    float *r, *q;     /* row space: A x - b; A d, then W r */
    bool any_clipped; /* in the last step */
    double alpha[4], beta[4], mu[4], back[4];
    double lambda[4], penalty[4]; /* ||V^(1/2) L x||^2 */
    double norm2[4];              /* ||x||^2 */
    double usual;                 /* brightness of (2a), weighted by itself; 0: V = 1 */
    double moved2[4];             /* ||x - next||^2 of the last step */
};

/* Fill the table for `cpu`: all slots with the reference, then an instruction set's over them. */
void rec_pcg_passes_init(struct rec_pcg_passes *p, enum pvx_cpu cpu);
/* One function of each file, which overwrites the slots that the file implements. */
void rec_pcg_passes_ref(struct rec_pcg_passes *p);
#if defined(__x86_64__)
void rec_pcg_passes_avx2(struct rec_pcg_passes *p);
#endif

#endif
