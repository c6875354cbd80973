#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/calib/model.h"
#include "recon/calib/pose.h"
#include "recon/calib/priv.h"

enum { PRIOR_F, PRIOR_C, PRIOR_K, PRIOR_P, PRIOR_K3, PRIORS }; /* of a lens, two residuals each */
enum { PRIOR_WARP, PRIOR_SHAPE, SHAPE_PRIORS };

/* What one term consists of. */
struct source {
    const struct view *view; /* NULL: the term is a prior */
    size_t index;            /* of the corner; of the camera (nc: the board) */
    int prior;
};

struct problem {
    const struct calib *k;
    struct source *source;
    struct rec_nls_term *term;
    struct rec_nls_block *block;
    size_t n;
    bool robust;
};

/* Priors of any lens: the middle within 5 % of the picture, f within 30 % of the start, square pixels within 1 %,
 * and distortions of a lens that is not a fisheye. */
void rec_calib_beliefs(const struct calib *k, size_t camera, double sigma[REC_LENS])
{
    const struct rec_calib_camera *c = &k->in->camera[camera];
    double side = c->width > c->height ? c->width : c->height, f = k->believed[camera][REC_FX];
    const double s[REC_LENS] = {0.3 * f, 0.3 * f, 0.05 * side, 0.05 * side, 0.3,
                                0.2,     0.01,    0.01,        0.1};
    memcpy(sigma, s, sizeof s);
}

void rec_calib_use_state(struct calib *k, double *state)
{
    k->state = k->shape = state;
    k->lens = (double(*)[REC_LENS])(state + SHAPE);
    k->pose = (double(*)[6])(state + SHAPE + REC_LENS * k->nc);
    k->board = k->pose + k->nc;
}

/* ---- residuals ---------------------------------------------------------------------------------- */

/* x: shape, lens, camera, board. */
static bool adjust_corner(const struct calib *k, const struct source *of, const double *const *x,
                          double r[2], double **J)
{
    const struct view *v = of->view;
    const struct seen *s = &k->seen[of->index];
    double a = (s->x - k->middle[0]) / k->half[0], b = (s->y - k->middle[1]) / k->half[1];
    const double bend[SHAPE] = {a * a - 1.0 / 3, a * b, b * b - 1.0 / 3,
                                v->board->face == REC_BACK};
    double X[3] = {s->x, s->y, 0}, Y[3], Z[3], uv[2], Jl[18], JX[6], Jc[18], Jb[18], R[9], Q[9];
    for (int i = 0; i < SHAPE; i++)
        X[2] += x[0][i] * bend[i];
    rec_model_move(x[3], X, Y, J != NULL ? Jb : NULL, Q);
    rec_model_move(x[2], Y, Z, J != NULL ? Jc : NULL, R);
    const struct rec_model m = rec_calib_model(k, v->camera, x[1]);
    if (!rec_model_project(&m, Z, uv, J != NULL ? Jl : NULL, J != NULL ? JX : NULL))
        return false;
    double over = 1 / k->scale[v->camera];
    double W[3] = {s->W[0] * over, s->W[1] * over, s->W[2] * over};
    double du = uv[0] - s->u, dv = uv[1] - s->v;
    r[0] = W[0] * du;
    r[1] = W[1] * du + W[2] * dv;
    if (J == NULL)
        return true;
    double D[6], B[6]; /* d r / d Z; d r / d Y; */
    for (int i = 0; i < 3; i++) {
        D[i] = W[0] * JX[i];
        D[3 + i] = W[1] * JX[i] + W[2] * JX[3 + i];
    }
    if (J[1] != NULL)
        for (int i = 0; i < REC_LENS; i++) {
            J[1][i] = W[0] * Jl[i];
            J[1][REC_LENS + i] = W[1] * Jl[i] + W[2] * Jl[REC_LENS + i];
        }
    if (J[2] != NULL)
        for (int row = 0; row < 2; row++)
            for (int i = 0; i < 6; i++)
                J[2][6 * row + i] =
                    D[3 * row] * Jc[i] + D[3 * row + 1] * Jc[6 + i] + D[3 * row + 2] * Jc[12 + i];
    for (int row = 0; row < 2; row++)
        for (int i = 0; i < 3; i++)
            B[3 * row + i] =
                D[3 * row] * R[i] + D[3 * row + 1] * R[3 + i] + D[3 * row + 2] * R[6 + i];
    if (J[3] != NULL)
        for (int row = 0; row < 2; row++)
            for (int i = 0; i < 6; i++)
                J[3][6 * row + i] =
                    B[3 * row] * Jb[i] + B[3 * row + 1] * Jb[6 + i] + B[3 * row + 2] * Jb[12 + i];
    if (J[0] != NULL) {
        for (int row = 0; row < 2; row++) {
            double z = B[3 * row] * Q[2] + B[3 * row + 1] * Q[5] + B[3 * row + 2] * Q[8];
            for (int i = 0; i < SHAPE; i++)
                J[0][SHAPE * row + i] = z * bend[i];
        }
    }
    return true;
}

/* Two numbers of x[0], each over its standard deviation; all derivatives but two are 0. */
static void believe(const double *x, int n, const int at[2], const double mean[2],
                    const double sigma[2], double r[2], double **J)
{
    if (J != NULL && J[0] != NULL)
        memset(J[0], 0, 2 * (size_t)n * sizeof **J);
    for (int i = 0; i < 2; i++) {
        r[i] = at[i] < 0 ? 0 : (x[at[i]] - mean[i]) / sigma[i];
        if (J != NULL && J[0] != NULL && at[i] >= 0)
            J[0][n * i + at[i]] = 1 / sigma[i];
    }
}

static bool prior(const struct calib *k, const struct source *of, const double *const *x,
                  double r[2], double **J)
{
    if (of->index == k->nc) {
        double reach = 0.01 * hypot(k->half[0], k->half[1]); /* boards are flat to 1 % */
        static const double zero[2] = {0, 0};
        const double sigma[2] = {reach, of->prior == PRIOR_WARP ? reach : 0.05};
        static const int at[SHAPE_PRIORS][2] = {{0, 1}, {2, 3}};
        believe(x[0], SHAPE, at[of->prior], zero, sigma, r, J);
        return true;
    }
    static const int at[PRIORS][2] = {
        {REC_FX, REC_FY}, {REC_CX, REC_CY}, {REC_K1, REC_K2}, {REC_P1, REC_P2}, {REC_K3, -1}};
    const int *i = at[of->prior];
    const double *m = k->believed[of->index];
    double s[REC_LENS];
    rec_calib_beliefs(k, of->index, s);
    const double mean[2] = {m[i[0]], i[1] < 0 ? 0 : m[i[1]]};
    const double sigma[2] = {s[i[0]], i[1] < 0 ? 1 : s[i[1]]};
    believe(x[0], REC_LENS, i, mean, sigma, r, J);
    if (of->prior == PRIOR_F) { /* the second: square pixels */
        double over = 1 / (0.01 * m[REC_FX]);
        r[1] = (x[0][REC_FY] - x[0][REC_FX]) * over;
        if (J != NULL && J[0] != NULL) {
            J[0][REC_LENS + REC_FX] = -over;
            J[0][REC_LENS + REC_FY] = over;
        }
    }
    return true;
}

static bool adjust_residual(const void *ctx, size_t i, const double *const *x, double *r,
                            double **J)
{
    const struct problem *p = ctx;
    const struct source *of = &p->source[i];
    return of->view != NULL ? adjust_corner(p->k, of, x, r, J) : prior(p->k, of, x, r, J);
}

/* ---- the problem -------------------------------------------------------------------------------- */

static void add_prior(struct problem *p, size_t index, int which, uint32_t block)
{
    p->source[p->n] = (struct source){NULL, index, which};
    p->term[p->n++] = (struct rec_nls_term){{block}, 1, false};
}

static void add_view(struct problem *p, const struct view *v)
{
    const struct calib *k = p->k;
    for (size_t s = v->first; s < v->first + v->n; s++)
        if (!k->seen[s].wrong) {
            p->source[p->n] = (struct source){v, s, 0};
            p->term[p->n++] =
                (struct rec_nls_term){{0, 1 + v->camera, 1 + (uint32_t)k->nc + v->camera,
                                       1 + 2 * (uint32_t)k->nc + v->frame},
                                      4,
                                      p->robust};
        }
}

static void free_problem(struct problem *p)
{
    free(p->source);
    free(p->term);
    free(p->block);
}

static pvx_err adjust_make(const struct calib *k, const struct adjust *a, struct problem *p)
{
    size_t most = k->ns + PRIORS * k->nc + SHAPE_PRIORS, nb = 1 + 2 * k->nc + k->nf;
    *p = (struct problem){.k = k, .robust = a->robust};
    p->source = pvx_calloc(most, sizeof *p->source);
    p->term = pvx_calloc(most, sizeof *p->term);
    p->block = pvx_calloc(nb, sizeof *p->block);
    if (p->source == NULL || p->term == NULL || p->block == NULL) {
        free_problem(p);
        return PVX_ENOMEM;
    }
    unsigned all = (1u << REC_LENS) - 1;
    p->block[0] = (struct rec_nls_block){k->shape, SHAPE, k->shape_held, false};
    for (size_t c = 0; c < k->nc; c++) {
        p->block[1 + c] = (struct rec_nls_block){k->lens[c], REC_LENS,
                                                 a->lens_fixed ? all : k->lens_held[c], false};
        p->block[1 + k->nc + c] =
            (struct rec_nls_block){k->pose[c], 6, a->pose_fixed || k->pose_held[c] ? 63 : 0, false};
    }
    for (size_t f = 0; f < k->nf; f++)
        p->block[1 + 2 * k->nc + f] = (struct rec_nls_block){k->board[f], 6, 0, true};
    for (size_t i = 0; i < k->nv; i++) {
        const struct view *v = &k->view[i];
        if (v->fate == REC_VIEW_USED && k->placed[v->frame] &&
            (a->camera == NULL || a->camera[v->camera]) && (a->frame == NULL || a->frame[v->frame]))
            add_view(p, v);
    }
    for (size_t c = 0; c < k->nc && !a->lens_fixed; c++)
        for (int i = 0; i < PRIORS && (a->camera == NULL || a->camera[c]); i++)
            add_prior(p, c, i, 1 + (uint32_t)c);
    for (int i = 0; i < SHAPE_PRIORS; i++)
        add_prior(p, k->nc, i, 0);
    return PVX_OK;
}

static struct rec_nls as_nls(const struct problem *p, int max_iterations)
{
    return (struct rec_nls){.n_blocks = 1 + 2 * p->k->nc + p->k->nf,
                            .n_terms = p->n,
                            .block = p->block,
                            .term = p->term,
                            .residual = adjust_residual,
                            .ctx = p,
                            .loss = LOSS,
                            .tolerance =
                                p->robust ? 1e-5 : 1e-9, /* a robust solve is followed by others */
                            .max_iterations = max_iterations};
}

pvx_err rec_calib_adjust(struct calib *k, const struct adjust *a)
{
    struct problem p;
    struct rec_nls_report report;
    char err[PVX_DIAG_MAX] = "";
    PVX_TRY(adjust_make(k, a, &p));
    struct rec_nls nls = as_nls(&p, a->max_iterations);
    int e = k->lib->solve(&nls, &report, err, sizeof err);
    free_problem(&p);
    if (e != PVX_OK)
        return pvx_fail(k->d, (pvx_err)e, "the bundle adjustment failed: %.500s", err);
    k->out->iterations += report.iterations;
    return PVX_OK;
}

pvx_err rec_calib_covariance(struct calib *k, double *cov)
{
    struct problem p;
    char err[PVX_DIAG_MAX] = "";
    uint32_t list[2 * REC_MAX_CAMERAS];
    for (uint32_t c = 0; c < k->nc; c++) {
        list[2 * c] = 1 + c;
        list[2 * c + 1] = 1 + (uint32_t)k->nc + c;
    }
    PVX_TRY(adjust_make(k, &(struct adjust){0}, &p));
    struct rec_nls nls = as_nls(&p, 0);
    int e = k->lib->covariance(&nls, list, 2 * k->nc, cov, err, sizeof err);
    free_problem(&p);
    return e == PVX_OK ? PVX_OK : pvx_fail(k->d, (pvx_err)e, "no uncertainty: %.500s", err);
}
