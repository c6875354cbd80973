#include "daemon/cli/common/silhouettes.h"
#include "daemon/cli/experiment/lab.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/carve/fit.h"

static pvx_err lab_allocate(struct experiment_lab *l, pvx_pool *pool)
{
    size_t rows = l->S->row0[l->S->n_cameras], cs = (size_t)l->cs;
    l->raw = pvx_calloc(rows * cs, sizeof *l->raw);
    l->b = pvx_calloc(rows * cs, sizeof *l->b);
    l->weight = pvx_calloc(rows, sizeof *l->weight);
    l->lit = pvx_calloc(rows, 1);
    l->seen = pvx_calloc(l->S->win.room * cs, sizeof *l->seen);
    if (l->raw == NULL || l->b == NULL || l->weight == NULL || l->lit == NULL || l->seen == NULL)
        return PVX_ENOMEM;
    rec_kernels_init(&l->kernels, PVX_CPU_BEST);
    PVX_TRY(rec_restrictor_new(l->S, &l->restrictor));
    PVX_TRY(rec_images_new(l->S, l->cs, &l->images));
    return rec_subsys_new(l->S, &l->kernels, pool, l->cs, &l->view);
}

pvx_err experiment_lab_frame(struct experiment_lab *l, const struct experiment_lab_params *p,
                             struct pvx_diag *d)
{
    rec_frame_free(&l->frame);
    return rec_frame_alone(l->S, &l->rig, &p->frame, p->pool, &l->frame, d);
}

pvx_err experiment_lab_open(struct experiment_lab *l, const struct experiment_lab_params *p,
                            struct pvx_diag *d)
{
    struct rec_fit_box whole = {.cell = 0};
    const int32_t n[3] = {p->voxels, 0, 0};
    *l = (struct experiment_lab){.nch = p->frame.nch, .cs = p->frame.nch == 1 ? 1 : 4};
    PVX_TRY(rec_rig_copy(p->rig, &l->rig));
    memcpy(whole.min, p->rig->grid.min, sizeof whole.min);
    memcpy(whole.max, p->rig->grid.max, sizeof whole.max);
    pvx_err e = rec_fit_grid(&p->rig->grid, &whole, n, &l->rig.grid);
    if (e != PVX_OK)
        return pvx_fail(d, e, "%d voxels along the longest side of the volume: %s", p->voxels,
                        pvx_strerror(e));
    l->rig.grid.basis = p->basis;
    PVX_TRY(rec_sysmat_open(&l->rig, &p->matrix, NULL, p->pool, p->progress, &l->S, d));
    PVX_TRY(experiment_lab_frame(l, p, d));
    e = lab_allocate(l, p->pool);
    return e == PVX_OK
               ? e
               : pvx_fail(d, e, "work areas of a grid of %d: %s", p->voxels, pvx_strerror(e));
}

void experiment_lab_close(struct experiment_lab *l)
{
    rec_frame_free(&l->frame);
    rec_subsys_free(&l->view);
    if (l->images.bytes > 0)
        rec_images_free(&l->images);
    rec_restrictor_free(&l->restrictor);
    rec_sysmat_free(&l->S);
    rec_rig_fini(&l->rig);
    PVX_FREE(l->raw);
    PVX_FREE(l->b);
    PVX_FREE(l->weight);
    PVX_FREE(l->lit);
    PVX_FREE(l->seen);
    *l = (struct experiment_lab){0};
}

/* Fill the frame from `raw` again, because photometry works in place.  The frame's information about files stays. */
static void lab_fill(struct experiment_lab *l, uint64_t used)
{
    size_t cs = (size_t)l->cs;
    for (size_t c = 0; c < l->S->n_cameras; c++) {
        size_t row0 = l->S->row0[c], n = l->S->row0[c + 1] - row0;
        memcpy(rec_frame_input(l->frame, c), l->raw + row0 * cs, n * cs * sizeof *l->raw);
        rec_frame_camera(l->frame, c)->present = (used >> c & 1) != 0;
    }
    rec_frame_carve(l->frame);
}

pvx_err experiment_lab_load(struct experiment_lab *l, struct frames_in *in, size_t i,
                            struct pvx_diag *d)
{
    size_t rows = l->S->row0[l->S->n_cameras], n = l->S->n_cameras;
    uint64_t all = n == 64 ? UINT64_MAX : ((uint64_t)1 << n) - 1;
    rec_frame_reset(l->frame);
    if (frames_in_load_frame(in, i, l->frame) != all)
        return pvx_fail(d, PVX_EIO,
                        "frame %06lld: a camera's picture cannot be used (see the error above); "
                        "repair or remove it, or leave the frame out with --first or --last",
                        (long long)in->number[i]);
    memcpy(l->raw, rec_frame_input(l->frame, 0), rows * (size_t)l->cs * sizeof *l->raw);
    lab_fill(l, all);
    memcpy(l->b, rec_frame_rhs(l->frame), rows * (size_t)l->cs * sizeof *l->b);
    memcpy(l->weight, rec_frame_weight(l->frame), rows * sizeof *l->weight);
    memcpy(l->lit, rec_frame_lit(l->frame, 0), rows);
    for (size_t c = 0; c < n; c++)
        (void)silhouettes_check_lit(in->rig->cameras[c].name, l->lit + l->S->row0[c],
                                    l->weight + l->S->row0[c], l->S->row0[c + 1] - l->S->row0[c],
                                    &l->said_lit);
    return PVX_OK;
}

pvx_err experiment_lab_solve(struct experiment_lab *l, uint64_t used)
{
    lab_fill(l, used);
    return rec_frame_solve(l->frame, 0, NULL);
}

struct experiment_view experiment_lab_view(const struct experiment_lab *l, size_t c)
{
    size_t row0 = l->S->row0[c], cs = (size_t)l->cs;
    return (struct experiment_view){.rows = l->S->row0[c + 1] - row0,
                                    .nch = l->nch,
                                    .cs = l->cs,
                                    .p = l->b + row0 * cs,
                                    .q = l->seen + row0 * cs,
                                    .weight = l->weight + row0,
                                    .lit = l->lit + row0};
}

void experiment_lab_compare(struct experiment_lab *l, size_t c, struct experiment_error *out)
{
    size_t row0 = l->S->row0[c], cs = (size_t)l->cs;
    const struct experiment_view view = experiment_lab_view(l, c);
    bool one[REC_MAX_CAMERAS] = {false};
    struct rec_sparse v;
    one[c] = true;
    rec_frame_volume(l->frame, &v);
    memset(l->seen + row0 * cs, 0, view.rows * cs * sizeof *l->seen);
    if (v.n > 0) {
        rec_subsys_restrict(l->view, l->restrictor, v.index, v.n, one);
        rec_forward(l->view, &l->images, v.value, l->seen);
    }
    experiment_difference(&view, out);
}

static bool shows(const float *q, int nch)
{
    bool any = false;
    for (int i = 0; i < nch; i++)
        any |= q[i] >= EXPERIMENT_SHOWS;
    return any;
}

void experiment_difference(const struct experiment_view *v, struct experiment_error *out)
{
    *out = (struct experiment_error){.bins = 0};
    for (size_t r = 0; r < v->rows; r++) {
        const float *p = v->p + r * (size_t)v->cs, *q = v->q + r * (size_t)v->cs;
        bool in = shows(q, v->nch);
        if (!(v->weight[r] > 0) || !(in || v->lit[r]))
            continue;
        out->bins_all++;
        out->bins += in;
        for (int i = 0; i < v->nch; i++) {
            double diff = 255 * fabs((double)p[i] - (double)q[i]);
            out->all[i] += diff;
            out->inside[i] += in ? diff : 0;
        }
    }
    for (int i = 0; i < v->nch; i++) {
        out->all[i] /= fmax(1, out->bins_all);
        out->inside[i] /= fmax(1, out->bins);
    }
}

void experiment_ghosts(const struct experiment_view *v, double *share, double *difference)
{
    double all = 0, dark = 0, sum = 0;
    for (size_t r = 0; r < v->rows; r++)
        for (int i = 0; i < v->nch; i++) {
            size_t at = r * (size_t)v->cs + (size_t)i;
            double q = (double)v->q[at];
            all += q;
            dark += v->lit[r] ? 0 : q;
            sum += 255 * fabs((double)v->p[at] - q);
        }
    *share = all > 0 ? dark / all : 0;
    *difference = sum / (double)v->rows / v->nch;
}

double experiment_outside(const float *dense, const float *inside, size_t voxels, int nch)
{
    double all = 0, out = 0;
    for (size_t i = 0; i < voxels * (size_t)nch; i += (size_t)nch) {
        double v = 0, in = 0;
        for (size_t k = 0; k < (size_t)nch; k++) {
            v += (double)dense[i + k];
            in += (double)inside[i + k];
        }
        all += v;
        out += in > 0 ? 0 : v;
    }
    return all > 0 ? out / all : 0;
}
