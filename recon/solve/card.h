/* card.h - the loops of a solve on a graphics card (recon/opencl).
 *
 * A restricted system that is on a card has `card` set (subsys.h).  Its windows, blocks, norms and rows are there, and
 * so are the pictures and all vectors of a problem that has it.  The solve is the same on the host: where it would run
 * a loop over rows or columns on the pool, it calls one of these operations, which returns the loop's sums.  Weights,
 * steps, renewals and the stop are decided on the host from those sums.
 *
 * A vector is named by its address on the host.  That memory is reserved address space and is never touched.
 * An operation that fails leaves its sums 0, and so do all after it: the solve ends soon, and nobody uses its result
 * (frame/solver.c).  So no operation returns an error.
 * Sums are per lane; lanes that are not there are 0.  The host waits for the card once for all sums of an operation,
 * which takes as long as a small product.  rec_card_later lets two operations share a wait.
 * Threads: one per problem.  Allocates nothing. */
#ifndef REC_SOLVE_CARD_H
#define REC_SOLVE_CARD_H
#include "recon/solve/passes/pcg_pass.h"

/* Sums of rec_problem_load. */
struct rec_card_load {
    double norm2; /* ||W^(1/2) b||^2 */
    double rows;  /* with weight > 0 */
    double ones;  /* with weight 1 */
    double light[4], measured[4], weight[4];
    double diagonal, chord; /* on a card: the sum of pb->column, and of w A's entries (lambda.c) */
};

/* How selfcal.c moves a camera's picture: (1) of selfcal.h. */
struct rec_card_shot {
    int32_t dx, dy;
    float gain, w[16]; /* of the 4x4 samples, row by row */
    int32_t moved;
};

/* A coarser level of a frame set: its system, pictures and columns, all on the card; `col` also here. */
struct rec_card_level {
    struct rec_subsys *sub;
    float *b, *w;
    int32_t *col;
};

/* The loops of the file that is named; pb->a->card is their system. */
struct rec_card_ops {
    void (*later)(const struct rec_subsys *a); /* rec_card_later */
    /* problem.c; load: also pb->column */
    void (*load)(rec_problem *pb, struct rec_card_load *out);
    void (*residual)(rec_problem *pb, const float *x, float *r, float *wr, double rwr[4]);
    void (*copy)(rec_problem *pb, float *to, const float *from);
    void (*clear)(rec_problem *pb, float *x);
    void (*square)(rec_problem *pb, const float *x, double out[4]); /* x'x */
    /* start.c */
    void (*zero_residual)(rec_problem *pb, float *r, float *wr, double rwr[4]); /* of x = 0 */
    void (*fit)(rec_problem *pb, const float *r, double fit[4], double size[4]);
    void (*scale)(rec_problem *pb, const float scale[4], float *x, float *r, float *wr,
                  double rwr[4]);
    /* lambda.c: sums of differences, and the number of blocks */
    void (*differences)(rec_problem *pb, double first[4], double second[4], double *blocks);
    /* pcg.c */
    void (*pass)(struct rec_pcg *t, enum rec_pcg_pass pass, double (*sums)[4]);
    /* blend.c; c of (1) */
    void (*colours)(const struct rec_pcg *t, const double c[4], double xs[4], double ss[4],
                    double xx[4]);
    void (*blend)(const struct rec_pcg *t, struct rec_pcg *one, const double c[4], double rwr[4]);
    void (*tint)(const struct rec_pcg *t, const double c[4], double sum[4], double all[4]);
    void (*colour)(const struct rec_pcg *t, const struct rec_pcg *one, const double c[4],
                   const double tint[4], float least);
    /* selfcal.c: the sums of each camera, [REC_SELFCAL_TILES][REC_SELFCAL_SUMS], NULL: it is absent; they come as 0.
     * pb->b from pb->in.b, shot [cameras] */
    void (*tiles)(rec_problem *pb, const float *r, double *const *tile);
    void (*correct)(rec_problem *pb, const struct rec_card_shot *shot);
    /* levels.c: n coarser levels of `fine`, from the next one on, sub->card and sub->col set; x of a coarse system to
     * a finer one */
    void (*levels)(const struct rec_subsys *fine, const struct rec_pictures *in,
                   struct rec_card_level *level, int n);
    void (*refine)(const struct rec_subsys *coarse, const float *x, const struct rec_subsys *fine,
                   float *to);
};

/* What a restricted system on a card begins with. */
struct rec_card_system {
    const struct rec_card_ops *op;
};

/* The operations for a system; NULL: it is here. */
static inline const struct rec_card_ops *rec_card_of(const struct rec_subsys *a)
{
    return a->card == NULL ? NULL : a->card->op;
}

/* Before residual, zero_residual or a pass with sums.  On a card these sums come with those of the operation after it:
 * until then they are not there, and their place must stay.  Here they come at once. */
static inline void rec_card_later(const struct rec_subsys *a)
{
    const struct rec_card_ops *card = rec_card_of(a);
    if (card != NULL)
        card->later(a);
}

#endif
