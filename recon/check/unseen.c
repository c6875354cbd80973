#include "recon/check/unseen.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/frame/inside.h"

struct rec_unseen {
    struct rec_rig rig; /* with the small grid */
    rec_sysmat *S;
    struct rec_kernels kernels;
    rec_carver *carver;
    rec_solver *solver;
    rec_frame *frame;
    struct rec_subsys *view; /* the volume's columns, one camera's rows */
    struct rec_restrictor *restrictor;
    struct rec_images images;
    bool present[REC_MAX_CAMERAS], floats;
    double sigma;
    float cut[REC_MAX_CAMERAS], pedestal[REC_MAX_CAMERAS];
    const float *picture[REC_MAX_CAMERAS]; /* borrowed during load, which copies */
    float *raw, *b, *weight;               /* [rows] */
    uint8_t *lit;
    float *ones, *seen, *through; /* [voxels], [room], [room] */
    struct rec_sparse before;     /* with params.temporal: the volume before, own copy; n 0: none */
    int32_t *before_index;        /* [voxels] */
    float *before_value;
    size_t rows;
};

int32_t rec_unseen_binning(const struct rec_rig *rig, const struct rec_unseen_params *p)
{
    int32_t b = p->binning > 0 ? p->binning : 64;
    for (; p->binning <= 0 && b > 1; b /= 2) {
        bool good = true;
        for (size_t c = 0; c < rig->n_cameras; c++) {
            const struct rec_camera *k = &rig->cameras[c];
            good = good && k->width % b == 0 && k->height % b == 0 && k->width / b >= p->across;
        }
        if (good)
            break;
    }
    return b;
}

static pvx_err unseen_allocate(rec_unseen *u, bool temporal, pvx_pool *pool)
{
    size_t voxels = rec_grid_count(&u->S->grid), room = u->S->win.room;
    u->rows = u->S->row0[u->S->n_cameras];
    u->raw = pvx_calloc(u->rows, sizeof *u->raw);
    u->b = pvx_calloc(u->rows, sizeof *u->b);
    u->weight = pvx_calloc(u->rows, sizeof *u->weight);
    u->lit = pvx_calloc(u->rows, 1);
    u->ones = pvx_calloc(voxels, sizeof *u->ones);
    u->seen = pvx_calloc(room, sizeof *u->seen);
    u->through = pvx_calloc(room, sizeof *u->through);
    if (u->raw == NULL || u->b == NULL || u->weight == NULL || u->lit == NULL || u->ones == NULL ||
        u->seen == NULL || u->through == NULL)
        return PVX_ENOMEM;
    for (size_t i = 0; i < voxels; i++)
        u->ones[i] = 1;
    if (temporal) {
        u->before_index = pvx_calloc(voxels, sizeof *u->before_index);
        u->before_value = pvx_calloc(voxels, sizeof *u->before_value);
        if (u->before_index == NULL || u->before_value == NULL)
            return PVX_ENOMEM;
    }
    rec_kernels_init(&u->kernels, PVX_CPU_BEST);
    PVX_TRY(rec_restrictor_new(u->S, &u->restrictor));
    PVX_TRY(rec_images_new(u->S, 1, &u->images));
    return rec_subsys_new(u->S, &u->kernels, pool, 1, &u->view);
}

static pvx_err unseen_make(rec_unseen *u, const struct rec_rig *rig,
                           const struct rec_unseen_params *p, pvx_pool *pool, struct pvx_diag *d)
{
    struct rec_sysmat_params m = {.binning = rec_unseen_binning(rig, p), .rays_per_bin = p->rays};
    struct rec_frame_params f = rec_frame_defaults;
    f.selfcal = REC_SELFCAL_OFF; /* it would hide what is looked for */
    if (p->voxels < 4 || p->voxels > REC_GRID_MAX || p->margin < 0)
        return pvx_fail(d, PVX_EINVAL, "check: %d voxels along a side, %d bins of margin",
                        p->voxels, p->margin);
    PVX_TRY(rec_rig_copy(rig, &u->rig));
    struct rec_grid *g = &u->rig.grid;
    double longest = 0;
    for (int a = 0; a < 3; a++)
        longest = fmax(longest, g->max[a] - g->min[a]);
    for (int a = 0; a < 3; a++) {
        double n = ceil((g->max[a] - g->min[a]) / longest * p->voxels - 1e-6);
        g->n[a] = n < 4 ? 4 : (int32_t)n;
    }
    PVX_TRY(rec_sysmat_build(&u->rig, &m, pool, NULL, NULL, &u->S, d));
    f.nch = 1;
    f.photo.margin = p->margin;
    f.at_least = p->at_least;
    f.temporal = p->temporal;
    f.trust_all = true; /* the caller chooses the cameras of each volume */
    PVX_TRY(rec_carver_new(u->S, &u->rig, &f, pool, &u->carver, d));
    PVX_TRY(rec_solver_new(u->S, &f, &u->solver, d));
    PVX_TRY(rec_frame_new(u->carver, u->solver, &u->frame, d));
    pvx_err e = unseen_allocate(u, p->temporal, pool);
    return e == PVX_OK
               ? e
               : pvx_fail(d, e, "check: work areas for %zu bins: %s", u->rows, pvx_strerror(e));
}

pvx_err rec_unseen_new(const struct rec_rig *rig, const struct rec_unseen_params *p, pvx_pool *pool,
                       rec_unseen **out, struct pvx_diag *d)
{
    rec_unseen *u = *out = pvx_calloc(1, sizeof *u);
    if (u == NULL)
        return pvx_fail(d, PVX_ENOMEM, "check: out of memory");
    pvx_err e = unseen_make(u, rig, p, pool, d);
    if (e != PVX_OK)
        rec_unseen_free(out);
    return e;
}

void rec_unseen_free(rec_unseen **up)
{
    rec_unseen *u = *up;
    if (u == NULL)
        return;
    rec_frame_free(&u->frame);
    rec_solver_free(&u->solver);
    rec_carver_free(&u->carver);
    rec_subsys_free(&u->view);
    if (u->images.bytes > 0)
        rec_images_free(&u->images);
    rec_restrictor_free(&u->restrictor);
    rec_sysmat_free(&u->S);
    rec_rig_fini(&u->rig);
    free(u->raw);
    free(u->b);
    free(u->weight);
    free(u->lit);
    free(u->ones);
    free(u->seen);
    free(u->through);
    free(u->before_index);
    free(u->before_value);
    PVX_FREE(*up);
}

const rec_sysmat *rec_unseen_matrix(const rec_unseen *u)
{
    return u->S;
}

void rec_unseen_gain(rec_unseen *u, size_t camera, double gain)
{
    const float all[3] = {(float)gain, (float)gain, (float)gain};
    rec_carver_gain(u->carver, camera, all);
}

/* Copies the set's raw pixels into the slot, since photometry works in place. */
static void unseen_fill(rec_unseen *u, const bool *use)
{
    rec_frame_reset(u->frame);
    for (size_t c = 0; c < u->S->n_cameras; c++) {
        size_t row0 = u->S->row0[c], n = u->S->row0[c + 1] - row0;
        bool in = u->present[c] && (use == NULL || use[c]);
        if (in)
            memcpy(rec_frame_input(u->frame, c), u->raw + row0, n * sizeof *u->raw);
        rec_frame_camera(u->frame, c)->present = in;
        rec_frame_camera(u->frame, c)->floats = u->floats;
    }
    rec_frame_carve(u->frame);
}

void rec_unseen_load(rec_unseen *u, const float *const *picture, bool floats)
{
    u->floats = floats;
    for (size_t c = 0; c < u->S->n_cameras; c++) {
        size_t row0 = u->S->row0[c], n = u->S->row0[c + 1] - row0;
        u->present[c] = picture[c] != NULL;
        if (picture[c] != NULL)
            memcpy(u->raw + row0, picture[c], n * sizeof *u->raw);
    }
    unseen_fill(u, NULL);
    memcpy(u->b, rec_frame_rhs(u->frame), u->rows * sizeof *u->b);
    memcpy(u->weight, rec_frame_weight(u->frame), u->rows * sizeof *u->weight);
    memcpy(u->lit, rec_frame_lit(u->frame, 0), u->rows);
    const struct rec_frame_report *r = rec_frame_get_report(u->frame);
    u->sigma = (double)r->sigma;
    memcpy(u->cut, r->cut, sizeof u->cut);
    memcpy(u->pedestal, r->pedestal, sizeof u->pedestal);
}

bool rec_unseen_present(const rec_unseen *u, size_t camera)
{
    return u->present[camera];
}
const float *rec_unseen_b(const rec_unseen *u, size_t camera)
{
    return u->b + u->S->row0[camera];
}
const float *rec_unseen_weight(const rec_unseen *u, size_t camera)
{
    return u->weight + u->S->row0[camera];
}
const uint8_t *rec_unseen_lit(const rec_unseen *u, size_t camera)
{
    return u->lit + u->S->row0[camera];
}
double rec_unseen_sigma(const rec_unseen *u)
{
    return u->sigma;
}
double rec_unseen_cut(const rec_unseen *u, size_t camera, double *pedestal)
{
    *pedestal = (double)u->pedestal[camera];
    return (double)u->cut[camera];
}

void rec_unseen_absorb(rec_unseen *u, double absorption)
{
    rec_carver_absorb(u->carver, absorption);
}

pvx_err rec_unseen_solve(rec_unseen *u, const bool *use, int32_t *n)
{
    struct rec_sparse v;
    unseen_fill(u, use);
    PVX_TRY(rec_frame_solve(u->frame, 0, u->before.n > 0 ? &u->before : NULL));
    rec_frame_volume(u->frame, &v);
    *n = v.n;
    if (u->before_index == NULL)
        return PVX_OK;
    memcpy(u->before_index, v.index, (size_t)v.n * sizeof *v.index);
    memcpy(u->before_value, v.value, (size_t)v.n * sizeof *v.value);
    u->before = v;
    u->before.index = u->before_index;
    u->before.value = u->before_value;
    return PVX_OK;
}

void rec_unseen_forget(rec_unseen *u)
{
    u->before.n = 0;
}

void rec_unseen_project(rec_unseen *u, size_t camera, const float **picture, const float **hull)
{
    struct rec_sparse v;
    bool one[REC_MAX_CAMERAS] = {false};
    size_t row0 = u->S->row0[camera], bytes = (u->S->row0[camera + 1] - row0) * sizeof(float);
    one[camera] = true;
    rec_frame_volume(u->frame, &v);
    rec_subsys_restrict(u->view, u->restrictor, v.index, v.n, one);
    if (picture != NULL) {
        memset(u->seen + row0, 0, bytes);
        rec_forward(u->view, &u->images, v.value, u->seen);
        *picture = u->seen + row0;
    }
    if (hull != NULL) {
        memset(u->through + row0, 0, bytes);
        rec_forward(u->view, &u->images, u->ones, u->through);
        *hull = u->through + row0;
    }
}

void rec_unseen_volume(const rec_unseen *u, struct rec_sparse *out)
{
    rec_frame_volume(u->frame, out);
}

const struct rec_subsys *rec_unseen_system(rec_unseen *u, const bool *use, struct rec_images **im)
{
    struct rec_sparse v;
    rec_frame_volume(u->frame, &v);
    rec_subsys_restrict(u->view, u->restrictor, v.index, v.n, use);
    *im = &u->images;
    return u->view;
}
