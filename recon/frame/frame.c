#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/frame/card.h"

const struct rec_frame_params rec_frame_defaults = {.nch = 3,
                                                    .photo = REC_PHOTO_DEFAULTS,
                                                    .hull = REC_HULL_DEFAULTS,
                                                    .solve = REC_SOLVE_DEFAULTS,
                                                    .coarse_start = true,
                                                    .selfcal = REC_SELFCAL_ON};

pvx_err rec_systems_new(const rec_carver *k, const rec_solver *s, rec_systems **out,
                        struct pvx_diag *d)
{
    rec_systems *y = *out = pvx_calloc(1, sizeof *y);
    if (y == NULL)
        return pvx_fail(d, PVX_ENOMEM, "frame: out of memory");
    int cs = k->p.nch == 3 ? 4 : 1;
    pvx_err e = rec_subsys_new(k->S, &k->kernels, k->pool, cs, &y->sub);
    if (e == PVX_OK && s->coarse)
        e = rec_levels_new(k->S, &k->kernels, k->pool, cs, &y->levels);
    if (e != PVX_OK)
        pvx_fail(d, e, "frame: systems of %zu voxels: %s", rec_grid_count(&k->S->grid),
                 pvx_strerror(e));
    PVX_THEN(e, rec_card_systems(y, k, d));
    if (e != PVX_OK)
        rec_systems_free(out);
    return e;
}

void rec_systems_free(rec_systems **yp)
{
    if (*yp == NULL)
        return;
    rec_subsys_free(&(*yp)->sub);
    rec_levels_free(&(*yp)->levels);
    rec_card_systems_fini(*yp);
    PVX_FREE(*yp);
}

void rec_frame_lend(rec_frame *f, rec_systems *y)
{
    f->systems = y;
    f->sub = y->sub;
    f->levels = y->levels;
}

rec_systems *rec_frame_give_back(rec_frame *f)
{
    rec_systems *y = f->systems;
    f->systems = NULL;
    f->sub = NULL;
    f->levels = NULL;
    return y;
}

static pvx_err frame_allocate(rec_frame *f)
{
    f->b = pvx_calloc(f->rows * (size_t)f->cs, sizeof *f->b);
    f->weight = pvx_calloc(f->rows, sizeof *f->weight);
    f->lit = pvx_calloc(f->rows, 1);
    f->weight4 = pvx_reserve(f->rows * 4 * sizeof *f->weight4);
    f->least = pvx_reserve(f->rows * sizeof *f->least);
    f->least_of = pvx_reserve(f->rows);
    f->col = pvx_reserve(f->voxels * sizeof *f->col);
    f->x = pvx_reserve(f->voxels * (size_t)f->cs * sizeof *f->x);
    if (f->carver->there != NULL &&
        (f->bytes = pvx_reserve(f->carver->raw0[f->S->n_cameras])) == NULL)
        return PVX_ENOMEM;
    if (f->b == NULL || f->weight == NULL || f->lit == NULL || f->weight4 == NULL ||
        f->least == NULL || f->least_of == NULL || f->col == NULL || f->x == NULL)
        return PVX_ENOMEM;
    return PVX_OK;
}

pvx_err rec_frame_new_bare(rec_carver *k, rec_solver *s, rec_frame **out, struct pvx_diag *d)
{
    rec_frame *f = *out = pvx_calloc(1, sizeof *f);
    if (f == NULL)
        return pvx_fail(d, PVX_ENOMEM, "frame: out of memory");
    f->carver = k;
    f->solver = s;
    f->S = k->S;
    f->nch = k->p.nch;
    f->cs = f->nch == 3 ? 4 : 1;
    f->voxels = rec_grid_count(&f->S->grid);
    f->rows = f->S->row0[f->S->n_cameras];
    pvx_err e = frame_allocate(f);
    if (e != PVX_OK)
        pvx_fail(d, e, "frame: a slot for %zu voxels: %s", f->voxels, pvx_strerror(e));
    PVX_THEN(e, rec_card_solver(s, k, d));
    if (e != PVX_OK) {
        rec_frame_free(out);
        return e;
    }
    rec_frame_reset(f);
    return PVX_OK;
}

pvx_err rec_frame_new(rec_carver *k, rec_solver *s, rec_frame **out, struct pvx_diag *d)
{
    PVX_TRY(rec_frame_new_bare(k, s, out, d));
    rec_frame *f = *out;
    pvx_err e = rec_systems_new(k, s, &f->own, d);
    if (e != PVX_OK) {
        rec_frame_free(out);
        return e;
    }
    rec_frame_lend(f, f->own);
    return PVX_OK;
}

pvx_err rec_frame_alone(const rec_sysmat *S, const struct rec_rig *rig,
                        const struct rec_frame_params *p, pvx_pool *pool, rec_frame **out,
                        struct pvx_diag *d)
{
    rec_carver *k = NULL;
    rec_solver *s = NULL;
    *out = NULL;
    pvx_err e = rec_carver_new(S, rig, p, pool, &k, d);
    PVX_THEN(e, rec_solver_new(S, p, &s, d));
    PVX_THEN(e, rec_frame_new(k, s, out, d));
    if (e == PVX_OK) {
        (*out)->alone = true;
        return PVX_OK;
    }
    rec_carver_free(&k);
    rec_solver_free(&s);
    return e;
}

void rec_frame_free(rec_frame **fp)
{
    rec_frame *f = *fp;
    if (f == NULL)
        return;
    if (f->bytes != NULL)
        pvx_unreserve(f->bytes, f->carver->raw0[f->S->n_cameras]);
    if (f->alone) {
        rec_carver_free(&f->carver);
        rec_solver_free(&f->solver);
    }
    free(f->b);
    free(f->weight);
    free(f->lit);
    pvx_unreserve(f->weight4, f->rows * 4 * sizeof *f->weight4);
    pvx_unreserve(f->least, f->rows * sizeof *f->least);
    pvx_unreserve(f->least_of, f->rows);
    pvx_unreserve(f->col, f->voxels * sizeof *f->col);
    pvx_unreserve(f->x, f->voxels * (size_t)f->cs * sizeof *f->x);
    rec_systems_free(&f->own);
    PVX_FREE(*fp);
}

void rec_frame_reset(rec_frame *f)
{
    memset(f->camera, 0, sizeof f->camera);
    f->per_channel = f->any_least = false;
    f->bin.bin = NULL;
    if (f->sub != NULL) {
        f->sub->card = NULL;
        f->sub->n = f->sub->rows = 0;
        f->sub->nnz = 0;
    }
    f->report = (struct rec_frame_report){0};
    f->report.solve.status = REC_EMPTY;
}

float *rec_frame_input(rec_frame *f, size_t camera)
{
    rec_card_bin_here(f);
    return f->b + f->S->row0[camera] * (size_t)f->cs;
}

struct rec_frame_camera *rec_frame_camera(rec_frame *f, size_t camera)
{
    return &f->camera[camera];
}

void rec_frame_volume(const rec_frame *f, struct rec_sparse *out)
{
    *out = (struct rec_sparse){.grid = &f->S->grid,
                               .nch = f->nch,
                               .cs = f->cs,
                               .n = (int32_t)f->report.active_voxels,
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

const float *rec_frame_weight4(const rec_frame *f)
{
    return f->per_channel ? f->weight4 : NULL;
}

int rec_frame_channels(const rec_frame *f)
{
    return f->nch;
}

const uint8_t *rec_frame_lit(const rec_frame *f, size_t camera)
{
    return f->lit + f->S->row0[camera];
}

void rec_sparse_to_dense(const struct rec_sparse *v, float *dense)
{
    memset(dense, 0, rec_grid_count(v->grid) * (size_t)v->nch * sizeof *dense);
    for (int32_t q = 0; q < v->n; q++)
        for (int l = 0; l < v->nch; l++)
            dense[(size_t)v->index[q] * (size_t)v->nch + (size_t)l] =
                v->value[(size_t)q * (size_t)v->cs + (size_t)l];
}
