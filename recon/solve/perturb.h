/* perturb.h - a problem that was just solved, solved again from pictures and a prior that chance has moved: how far
 * its solution may be from the truth.
 *
 * The solution minimises (1) of pcg.c, which is the negative logarithm of a density of x times sigma^2:
 *     ||W^(1/2) (A x - b)||^2 / (2 sigma^2) + lambda ||V^(1/2) L x||^2 / (2 sigma^2),   x >= 0     (1)
 * Without the bound x is normal about the solution with the covariance
 *     C = sigma^2 (A'WA + lambda L V L)^-1                                                       (2)
 * and so is the minimiser of the same sum of squares with
 *     b + sigma W^(-1/2) e1  in place of b,   V^(1/2) L x - sigma lambda^(-1/2) e2  in place of V^(1/2) L x    (3)
 * where e1, e2 have independent entries of mean 0 and variance 1: its deviation from the solution is
 *     C / sigma^2 (A'W^(1/2) sigma e1 + lambda^(1/2) sigma L V^(1/2) e2), of covariance C               (4)
 * The bound holds in each such solve, so dark voxels deviate as far as they can.  sigma is per channel and the caller's:
 * it is what the model misses in the pictures, not their noise in the dark.  V and lambda stay those with which the
 * solve ended.  With a prediction xhat (temporal.h, (1b) of pcg.c), xhat + sigma (lambda nu)^(-1/2) e3 in place of xhat,
 * and (2) has the term lambda nu too.
 * Entries of e1, e2 are +1 or -1.  (4) asks for no more, each entry of the deviation is a sum of very many of them, and
 * of all choices this one makes the squares of (4) scatter least (Hutchinson, Commun. Stat. Simul. 19:433, 1990).
 * Cameras may be left out.
 * Source: randomised maximum likelihood, or perturb and optimise: Oliver, He & Reynolds, 5th ECMOR 1996; Papandreou &
 * Yuille, NIPS 2010; Bardsley et al., SIAM J. Sci. Comput. 36:A1895, 2014.
 * Cost: a solve of so many iterations without coarser grids, from the solution.
 * Memory: 2 vectors over voxels, 2 over rows, of reserved address space.
 * Threads: as the problem; same bits for any number, since an entry depends on the seed, the number of the draw, its row
 * or voxel and its channel alone.  Allocates nothing after ..._new.  Private to recon. */
#ifndef REC_PERTURB_H
#define REC_PERTURB_H
#include "recon/solve/params.h"
#include "recon/solve/problem.h"

typedef struct rec_perturb rec_perturb;

/* For problems of S.  Errors: PVX_ENOMEM.  Owner: caller. */
PVX_MUST_CHECK pvx_err rec_perturb_new(const rec_sysmat *S, int nch, rec_perturb **out);
void rec_perturb_free(rec_perturb **t);

/* What the solve of a problem says of its errors, per lane. */
struct rec_perturb_fit {
    double m, g;   /* measured values; degrees of freedom that they determine: (4) of lambda.c */
    double noise2; /* r'Wr / (m - g): sigma^2 of (1), from what the solution misses */
    double dark2;  /* the pictures' own noise, with that of their light; < 0: unknown */
    double lambda;
    double unit; /* mean diagonal of A'WA */
    double
        excess; /* light that the solution has and the pictures have not: 1'W (A x - b) / 1'W b */
};

/* Takes over a problem that the default method has just solved, with its solution x [n][cs].  Both are borrowed until
 * rec_perturb_end, which leaves the problem as it was, except its work areas.  false: there is nothing to move, and
 * nothing to end. */
bool rec_perturb_begin(rec_perturb *t, rec_problem *pb, const float *x,
                       struct rec_perturb_fit fit[4]);

struct rec_perturbation {
    uint64_t seed;
    uint32_t draw;   /* number of e1 and e2 */
    double sigma[4]; /* of (3); 0: neither pictures nor prior are moved */
    double prior[4]; /* factor on e2: 1 for (3) */
    const bool *out; /* [cameras] left out; NULL: none */
    uint32_t iterations;
    int64_t deadline_ns; /* of rec_solve_params */
};
/* Writes the minimiser to x [n][cs].  Returns the iterations. */
uint32_t rec_perturb_solve(rec_perturb *t, const struct rec_perturbation *p, float *x);
void rec_perturb_end(rec_perturb *t);

#endif
