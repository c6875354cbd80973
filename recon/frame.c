#include "recon/frame/frame.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/mem.h"

const struct rec_frame_params rec_frame_defaults = {.nch = 3,
                                                    .photo = REC_PHOTO_DEFAULTS,
                                                    .hull = REC_HULL_DEFAULTS,
                                                    .solve = REC_SOLVE_DEFAULTS,
                                                    .coarse_start = true};

struct rec_frame {
    const rec_sysmat *S;
    struct rec_frame_params p;
    pvx_pool *pool;
    struct rec_kernels kernels;
    rec_hull *hull;
    rec_solver *solver;
    size_t voxels, rows, row0[REC_MAX_CAMERAS + 1];
    int cs;
    float gain[REC_MAX_CAMERAS][3];
    float *background[REC_MAX_CAMERAS]; /* or NULL */
    bool present[REC_MAX_CAMERAS];
    float *b;       /* [rows][cs] pixels in, right-hand side after carve */
    float *weight;  /* [rows] */
    float *weight4; /* [rows][4] of each channel, where cameras have mosaics */
    float *plane;   /* [rows][4] work area of those */
    uint8_t cell[REC_MAX_CAMERAS][4];
    bool bayer[REC_MAX_CAMERAS],
        mosaic[REC_MAX_CAMERAS]; /* cameras with a filter; pixels as they are */
    bool lanes;                  /* any of those present */
    uint8_t *lit;                /* [rows] */
    float *scratch;              /* [rows] */
    int32_t *col;                /* [voxels] */
    float *x;                    /* [voxels][cs] */
    float *start; /* [voxels][cs] the coarser grids' solution, while x holds an earlier volume */
    struct rec_photo_stats stats[REC_MAX_CAMERAS];
    struct rec_subsys *sub;
    rec_levels *levels; /* or NULL: start from zero or from an earlier volume */
    double sigma;
    struct rec_frame_report report;
};

pvx_err rec_frame_new(const rec_sysmat *S, const struct rec_rig *rig,
                      const struct rec_frame_params *p, pvx_pool *pool, rec_frame **out,
                      struct pvx_diag *d)
{
    *out = NULL;
    if (p->nch != 1 && p->nch != 3)
        return pvx_fail(d, PVX_EINVAL, "frame: %d channels, want 1 or 3", p->nch);
    if (rig->n_cameras != S->n_cameras)
        return pvx_fail(d, PVX_EINVAL, "frame: the rig has %zu cameras, the matrix %zu",
                        rig->n_cameras, S->n_cameras);
    rec_frame *f = pvx_calloc(1, sizeof *f);
    if (f == NULL)
        return pvx_fail(d, PVX_ENOMEM, "frame: out of memory");
    f->S = S;
    f->p = *p;
    f->pool = pool;
    f->cs = p->nch == 3 ? 4 : 1;
    f->voxels = rec_grid_count(&S->grid);
    f->rows = rec_rowspace(S, f->row0);
    rec_kernels_init(&f->kernels, REC_CPU_ALL);
    for (size_t c = 0; c < S->n_cameras; c++)
        memcpy(f->gain[c], rig->cameras[c].gain, sizeof f->gain[c]);
    f->b = pvx_calloc(f->rows * (size_t)f->cs, sizeof *f->b);
    f->weight = pvx_calloc(f->rows, sizeof *f->weight);
    f->lit = pvx_calloc(f->rows, 1);
    f->scratch = pvx_calloc(f->rows, sizeof *f->scratch);
    f->weight4 = pvx_reserve(f->rows * 4 * sizeof *f->weight4);
    f->plane = pvx_reserve(f->rows * 4 * sizeof *f->plane);
    f->col = pvx_reserve(f->voxels * sizeof *f->col);
    f->x = pvx_reserve(f->voxels * (size_t)f->cs * sizeof *f->x);
    f->start = pvx_reserve(f->voxels * (size_t)f->cs * sizeof *f->start);
    pvx_err e = PVX_ENOMEM;
    if (f->b != NULL && f->weight != NULL && f->weight4 != NULL && f->plane != NULL &&
        f->lit != NULL && f->scratch != NULL && f->col != NULL && f->x != NULL && f->start != NULL)
        e = rec_hull_new(S, &f->hull);
    if (e == PVX_OK)
        e = rec_subsys_new(S, &f->kernels, pool, f->cs, &f->sub);
    if (e == PVX_OK)
        e = rec_solver_new(S, p->nch, &f->solver);
    bool coarse = p->coarse_start && rec_solver_is_default(p->solve.solver);
    if (e == PVX_OK && coarse)
        e = rec_levels_new(S, &f->kernels, pool, p->nch, &f->levels);
    if (e != PVX_OK) {
        rec_frame_free(&f);
        return pvx_fail(d, e, "frame: work areas for %zu voxels: %s", rec_grid_count(&S->grid),
                        pvx_strerror(e));
    }
    rec_frame_reset(f);
    *out = f;
    return PVX_OK;
}

void rec_frame_free(rec_frame **fp)
{
    rec_frame *f = *fp;
    if (f == NULL)
        return;
    for (size_t c = 0; c < f->S->n_cameras; c++)
        free(f->background[c]);
    free(f->b);
    free(f->weight);
    free(f->lit);
    free(f->scratch);
    pvx_unreserve(f->weight4, f->rows * 4 * sizeof *f->weight4);
    pvx_unreserve(f->plane, f->rows * 4 * sizeof *f->plane);
    pvx_unreserve(f->col, f->voxels * sizeof *f->col);
    pvx_unreserve(f->x, f->voxels * (size_t)f->cs * sizeof *f->x);
    pvx_unreserve(f->start, f->voxels * (size_t)f->cs * sizeof *f->start);
    rec_hull_free(&f->hull);
    rec_subsys_free(&f->sub);
    rec_solver_free(&f->solver);
    rec_levels_free(&f->levels);
    free(f);
    *fp = NULL;
}

float *rec_frame_input(rec_frame *f, size_t camera)
{
    return f->b + f->row0[camera] * (size_t)f->cs;
}

void rec_frame_present(rec_frame *f, size_t camera, bool present)
{
    f->present[camera] = present;
}

void rec_frame_bayer(rec_frame *f, size_t camera, const uint8_t *cell, bool as_they_are)
{
    f->bayer[camera] = cell != NULL && f->cs == 4;
    f->mosaic[camera] = f->bayer[camera] && as_they_are;
    if (cell != NULL)
        memcpy(f->cell[camera], cell, sizeof f->cell[camera]);
}

pvx_err rec_frame_set_background(rec_frame *f, size_t camera, const float *bg)
{
    if (camera >= f->S->n_cameras)
        return PVX_EINVAL;
    if (bg == NULL) {
        PVX_FREE(f->background[camera]);
        return PVX_OK;
    }
    size_t n = (f->row0[camera + 1] - f->row0[camera]) * (size_t)f->cs;
    if (f->background[camera] == NULL)
        f->background[camera] = pvx_calloc(n, sizeof *bg);
    if (f->background[camera] == NULL)
        return PVX_ENOMEM;
    memcpy(f->background[camera], bg, n * sizeof *bg);
    return PVX_OK;
}

static void photo_camera(void *ctx, size_t c)
{
    rec_frame *f = ctx;
    const struct rec_sysmat_block *b = &f->S->block[c];
    size_t rows = f->row0[c + 1] - f->row0[c];
    float *img = rec_frame_input(f, c);
    if (!f->present[c]) {
        memset(img, 0, rows * (size_t)f->cs * sizeof *img);
        memset(f->weight + f->row0[c], 0, rows * sizeof *f->weight);
        memset(f->lit + f->row0[c], 0, rows);
        f->stats[c] = (struct rec_photo_stats){0};
        return;
    }
    if (f->mosaic[c])
        rec_photo_apply_mosaic(img, b->bw, b->bh, f->cell[c], f->background[c], f->gain[c],
                               &f->p.photo, f->weight + f->row0[c], f->lit + f->row0[c],
                               f->scratch + f->row0[c], f->plane + f->row0[c] * 4, &f->stats[c]);
    else if (f->bayer[c])
        rec_photo_apply_bayer(img, b->bw, b->bh, f->S->binning, f->background[c], f->gain[c],
                              &f->p.photo, f->weight + f->row0[c], f->lit + f->row0[c],
                              f->scratch + f->row0[c], &f->stats[c]);
    else
        rec_photo_apply(img, b->bw, b->bh, f->p.nch, f->background[c], f->gain[c], &f->p.photo,
                        f->weight + f->row0[c], f->lit + f->row0[c], f->scratch + f->row0[c],
                        &f->stats[c]);
}

/* Weights per channel: a mosaic's bin measures its colour. */
static void spread_weights(void *ctx, size_t c)
{
    rec_frame *f = ctx;
    int32_t bw = f->S->block[c].bw, bh = f->S->block[c].bh;
    const float *w = f->weight + f->row0[c];
    float *out = f->weight4 + f->row0[c] * 4;
    for (int32_t y = 0; y < bh; y++)
        for (int32_t x = 0; x < bw; x++, w++, out += 4) {
            for (int l = 0; l < 3; l++)
                out[l] = f->mosaic[c] ? 0 : *w;
            if (f->mosaic[c])
                out[f->cell[c][(y & 1) * 2 + (x & 1)]] = *w;
            out[3] = 0;
        }
}

static const float *weights(const rec_frame *f)
{
    return f->lanes ? f->weight4 : f->weight;
}

void rec_frame_carve(rec_frame *f)
{
    struct rec_frame_report *r = &f->report;
    size_t cameras = f->S->n_cameras;
    *r = (struct rec_frame_report){0};
    int64_t t0 = pvx_now_mono();
    pvx_pool_run(f->pool, cameras, photo_camera, f);
    f->lanes = false;
    for (size_t c = 0; c < cameras; c++)
        f->lanes |= f->present[c] && f->mosaic[c];
    if (f->lanes)
        pvx_pool_run(f->pool, cameras, spread_weights, f);
    double sigma = 0, sigma2 = 0;
    const uint8_t *lit[REC_MAX_CAMERAS];
    for (size_t c = 0; c < cameras; c++) {
        lit[c] = f->lit + f->row0[c];
        r->cameras += f->present[c];
        r->saturated += f->stats[c].saturated;
        r->not_finite += f->stats[c].not_finite;
        for (int l = 0; l < f->p.nch; l++) {
            sigma += f->stats[c].sigma[l];
            sigma2 += (double)f->stats[c].sigma[l] * f->stats[c].sigma[l];
        }
    }
    double n_sigma = r->cameras > 0 ? (double)r->cameras * f->p.nch : 1;
    r->sigma = (float)(sigma / n_sigma);
    f->sigma = sqrt(sigma2 / n_sigma);
    int64_t t1 = pvx_now_mono();
    int32_t n = 0;
    rec_hull_carve(f->hull, &f->p.hull, lit, f->present, f->pool, f->col, &n, NULL, &r->hull);
    int64_t t2 = pvx_now_mono();
    rec_subsys_restrict(f->sub, f->col, n, f->present);
    if (f->levels != NULL)
        rec_levels_restrict(f->levels, f->sub, f->b, weights(f), f->lanes);
    r->active_voxels = n;
    r->active_rays = f->sub->rows;
    r->entries = f->sub->nnz;
    r->photo_ns = t1 - t0;
    r->hull_ns = t2 - t1;
    r->restrict_ns = pvx_now_mono() - t2;
}

/* x = the earlier volume on this frame's voxels, 0 where it had none; both lists ascend. */
static void warm_start(rec_frame *f, const struct rec_sparse *from)
{
    int32_t at = 0;
    size_t cs = (size_t)f->cs;
    for (int32_t q = 0; q < f->sub->n; q++) {
        while (at < from->n && from->index[at] < f->col[q])
            at++;
        float *x = f->x + (size_t)q * cs;
        memset(x, 0, cs * sizeof *x);
        if (at < from->n && from->index[at] == f->col[q])
            memcpy(x, from->value + (size_t)at * cs, (size_t)f->p.nch * sizeof *x);
    }
}

/* x = the coarser grids' solution, or the earlier volume that is there (`warm`), scaled, if it leaves
 * the smaller residual: after a flame that jumped it does not.  true: it is the earlier volume. */
static bool coarse_start(rec_frame *f, const struct rec_solve_params *p, bool warm,
                         double misfit2[4])
{
    float *coarse = warm ? f->start : f->x;
    rec_levels_solve(f->levels, f->sub, p->weight, p->deadline_ns, coarse,
                     &f->report.coarse_iterations, misfit2);
    if (!warm)
        return false;
    double earlier = rec_solve_fit(f->solver, f->sub, true, f->x);
    if (earlier <= rec_solve_fit(f->solver, f->sub, false, coarse))
        return true;
    memcpy(f->x, coarse, (size_t)f->sub->n * (size_t)f->cs * sizeof *f->x);
    return false;
}

pvx_err rec_frame_solve(rec_frame *f, int64_t deadline_ns, const struct rec_sparse *previous)
{
    int64_t t0 = pvx_now_mono();
    struct rec_solve_params p = f->p.solve;
    double weight[4], noise2[4], misfit2[4] = {0};
    if (deadline_ns != 0)
        p.deadline_ns = deadline_ns;
    p.lanes = f->lanes;
    bool warm = previous != NULL && previous->n > 0;
    if (warm && (previous->cs != f->cs || previous->value == f->x))
        return PVX_EINVAL;
    if (warm)
        warm_start(f, previous);
    f->report.warm = warm;
    if (f->levels != NULL &&
        rec_solve_weight(f->solver, f->sub, f->b, weights(f), f->sigma, &p, weight, noise2)) {
        p.weight = weight;
        p.good_start = p.prepared = true;
        f->report.warm = coarse_start(f, &p, warm, misfit2);
        rec_solve_weight_for_misfit(noise2, misfit2, weight);
    } else if (!warm) {
        memset(f->x, 0, (size_t)f->sub->n * (size_t)f->cs * sizeof *f->x);
    }
    pvx_err e = rec_solve(f->solver, f->sub, f->b, weights(f), f->sigma, &p, f->x, NULL, NULL,
                          &f->report.solve);
    f->report.solve_ns = pvx_now_mono() - t0;
    return e;
}

void rec_frame_volume(const rec_frame *f, struct rec_sparse *out)
{
    *out = (struct rec_sparse){.grid = &f->S->grid,
                               .nch = f->p.nch,
                               .cs = f->cs,
                               .n = f->sub->n,
                               .index = f->col,
                               .value = f->x};
}

const struct rec_frame_report *rec_frame_get_report(const rec_frame *f)
{
    return &f->report;
}

const struct rec_subsys *rec_frame_subsys(const rec_frame *f)
{
    return f->sub;
}

const float *rec_frame_rhs(const rec_frame *f)
{
    return f->b;
}

const float *rec_frame_weight(const rec_frame *f)
{
    return f->weight;
}

const uint8_t *rec_frame_lit(const rec_frame *f, size_t camera)
{
    return f->lit + f->row0[camera];
}

void rec_frame_reset(rec_frame *f)
{
    memset(f->present, 0, sizeof f->present);
    memset(f->bayer, 0, sizeof f->bayer);
    memset(f->mosaic, 0, sizeof f->mosaic);
    f->lanes = false;
    f->sub->n = f->sub->rows = 0;
    f->sub->nnz = 0;
    f->report = (struct rec_frame_report){0};
    f->report.solve.status = REC_EMPTY;
}

void rec_sparse_to_dense(const struct rec_sparse *v, float *dense)
{
    memset(dense, 0, rec_grid_count(v->grid) * (size_t)v->nch * sizeof *dense);
    for (int32_t q = 0; q < v->n; q++)
        for (int l = 0; l < v->nch; l++)
            dense[(size_t)v->index[q] * (size_t)v->nch + (size_t)l] =
                v->value[(size_t)q * (size_t)v->cs + (size_t)l];
}
