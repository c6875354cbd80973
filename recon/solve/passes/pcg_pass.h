/* pcg_pass.h - the loops of pcg.c over voxels and rays, compiled once per instruction set.
 *
 * Each runs over the fixed chunks of subsys.h and writes its sums to the partial results of the workspace, so nothing
 * depends on the threads.  Except for the FMA of the gather kernels, nothing depends on the instruction set either.
 * Equations (1) to (6) are those of pcg.c.
 * Private to the solver. */
#ifndef REC_PCG_PASS_H
#define REC_PCG_PASS_H
#include <float.h>
#include "recon/solve/impl.h"

/* The passes and their sums, in this order. */
enum rec_pcg_pass {
    REC_PASS_EXPECTED,  /* lhat = a L expect */
    REC_PASS_BEGIN,     /* neighbours; V = 1; d = 0 */
    REC_PASS_SCALE,     /* S of (6) */
    REC_PASS_DIRECTION, /* (4); d'phi */
    REC_PASS_CURVATURE, /* q = A d; q'Wq, d'L V L d */
    REC_PASS_STEP,      /* (5): next; the clipped columns, on a card ar = e; ||next - x||^2 */
    REC_PASS_CLIPPED,  /* the change of A d by clipping, A e: into the images, on a card q += A e */
    REC_PASS_RESIDUAL, /* q where clipped, r, q = W r, lx = V L x; r'Wr, x'L lx, ||x||^2 */
    REC_PASS_SMOOTHNESS, /* lx = V L x; x'L lx, ||x||^2 */
    REC_PASS_BRIGHTNESS, /* lx = L x; (2a): y to next; y, y^2, columns with x > 0 */
    REC_PASS_STIFFNESS,  /* V of (2a) from that, lx = V lx; x'L lx */
    REC_PASS_GRADIENT,   /* ar, (3); phi'M phi, phi'M phi_old */
    REC_PASS_REGRADIENT, /* the same from the existing ar */
    REC_PASS_SLOPE,      /* (next - x)'phi */
    REC_PASS_RETREAT,    /* next = x + back (next - x) */
    REC_PCG_PASSES
};

/* Their loops on the pool.  ctx: struct rec_pcg.  A task is a chunk of columns.  For curvature and residual it is a
 * chunk of rows, and after those one of columns, with sums of each; for clipped it is a slab.  The product of curvature
 * is in the images before. */
struct rec_pcg_passes {
    pvx_task_fn loop[REC_PCG_PASSES];
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
    bool any_clipped; /* in the last step; on a card true, since only the card knows */
    double alpha[4], beta[4], mu[4], back[4];
    double lambda[4], penalty[4]; /* ||V^(1/2) L x||^2 */
    double norm2[4];              /* ||x||^2 */
    double usual;                 /* brightness of (2a), weighted by itself; 0: V = 1 */
    double moved2[4];             /* ||x - next||^2 of the last step */
};

/* c and 1 / y_usual of (2a).  c limits how firmly dark parts are held: at most about three times as firmly as the bright
 * ones. */
struct rec_pcg_bright {
    float dark, scale;
};
static inline struct rec_pcg_bright rec_pcg_bright(const struct rec_pcg *t)
{
    bool fits = t->usual > 1 / (double)FLT_MAX; /* 1/usual fits a float */
    return fits ? (struct rec_pcg_bright){0.09F, (float)(1 / t->usual)}
                : (struct rec_pcg_bright){1, 0};
}

/* The solver's vectors among the problem's work areas; x, and the loops of rec_pcg_passes_init. */
static inline struct rec_pcg rec_pcg_of(rec_problem *pb, float *x,
                                        const struct rec_pcg_passes *pass)
{
    return (struct rec_pcg){.pb = pb,
                            .smooth = {.run = pb->run, .diag2 = pb->diag2},
                            .stiff = pb->stiff,
                            .x = x,
                            .next = pb->xv[0],
                            .phi = pb->xv[1],
                            .phi_old = pb->xv[2],
                            .d = pb->xv[3],
                            .lx = pb->xv[4],
                            .ar = pb->xv[5],
                            .expect = pb->expect,
                            .lhat = pb->xv[REC_XV_LHAT],
                            .scale = pb->xv[7],
                            .r = pb->yv[0],
                            .q = pb->yv[1],
                            .pass = pass};
}

/* Runs a pass on the pool, or on the card where the system is (card.h).  sums: one for each, NULL for a pass that has
 * none. */
void rec_pcg_pass(struct rec_pcg *t, enum rec_pcg_pass which, double (*sums)[4]);

/* Fill the table for `cpu`: all slots with the reference, then an instruction set's over them. */
void rec_pcg_passes_init(struct rec_pcg_passes *p, enum pvx_cpu cpu);
/* One function of each file, which overwrites the slots that the file implements. */
void rec_pcg_passes_ref(struct rec_pcg_passes *p);
#if defined(__x86_64__)
void rec_pcg_passes_avx2(struct rec_pcg_passes *p);
#endif

#endif
