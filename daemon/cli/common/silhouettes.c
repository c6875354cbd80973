#include "daemon/cli/common/silhouettes.h"

#include <stdio.h>

#include <stdlib.h>
#include <string.h>

#include "recon/carve/fit.h"
#include "recon/frame/inside.h"
#include "recon/matrix/active.h"

#define VOXELS 24 /* of the vote: its own grid has 16 to 31 */

/* Approximate bytes of a bin's entries on that grid while the matrix is built, and the most for all bins. */
#define BIN_BYTES 1500
#define MOST      ((size_t)512 << 20)

/* A matrix that keeps only the vote's grid.  For large pictures it is made below finer grids, which keep nothing:
 * bins must not be far smaller than the voxels, or the matrix would take gigabytes. */
static pvx_err new_matrix(const struct rec_rig *in, int32_t binning, pvx_pool *pool,
                          struct rec_rig *rig, rec_sysmat **S, struct pvx_diag *d)
{
    const struct rec_sysmat_params one = {.binning = binning, .rays_per_bin = 1};
    struct rec_fit_box whole = {.cell = 0};
    int32_t n[3] = {VOXELS, 0, 0};
    size_t bins = 0;
    rec_sysmat *outline;
    for (size_t c = 0; c < rig->n_cameras; c++)
        bins +=
            (size_t)(rig->cameras[c].width / binning) * (size_t)(rig->cameras[c].height / binning);
    for (; bins > MOST / BIN_BYTES && n[0] <= REC_GRID_MAX / 2; bins /= 4)
        n[0] *= 2;
    memcpy(whole.min, rig->grid.min, sizeof whole.min);
    memcpy(whole.max, rig->grid.max, sizeof whole.max);
    PVX_TRY(rec_fit_grid(&in->grid, &whole, n, &rig->grid));
    PVX_TRY(rec_sysmat_outline(rig, &one, pool, (struct rec_progress){0}, &outline, d));
    return rec_sysmat_build_active(rig, &outline, pool, (struct rec_progress){0}, S, d);
}

pvx_err silhouettes_new(struct silhouettes *s, struct frames_in *in,
                        const struct rec_frame_params *p, const char *background, pvx_pool *pool,
                        struct pvx_diag *d)
{
    float *dark[REC_MAX_CAMERAS] = {0};
    struct rec_frame_params here = *p;
    struct rec_rig rig;
    here.card = NULL; /* nothing is solved */
    *s = (struct silhouettes){.in = in};
    PVX_TRY(rec_rig_copy(in->rig, &rig));
    pvx_err e = new_matrix(in->rig, in->binning, pool, &rig, &s->S, d);
    PVX_THEN(e, rec_carver_new(s->S, &rig, &here, pool, &s->carver, d));
    PVX_THEN(e, rec_solver_new(s->S, &here, &s->solver, d));
    PVX_THEN(e, rec_frame_new(s->carver, s->solver, &s->frame, d));
    if (e == PVX_OK && background != NULL)
        e = frames_in_background(in, background, dark, d);
    for (size_t c = 0; c < rig.n_cameras; c++) {
        if (e == PVX_OK && dark[c] != NULL)
            e = rec_carver_background(s->carver, c, dark[c]);
        free(dark[c]);
    }
    rec_rig_fini(&rig);
    return e;
}

void silhouettes_free(struct silhouettes *s)
{
    rec_frame_free(&s->frame);
    rec_solver_free(&s->solver);
    rec_carver_free(&s->carver);
    rec_sysmat_free(&s->S);
}

void silhouettes_load(struct silhouettes *s, size_t set)
{
    rec_frame_reset(s->frame);
    uint64_t mask = frames_in_load_frame(s->in, set, s->frame);
    rec_frame_carve(s->frame);
    s->verdict = &rec_frame_get_report(s->frame)->vote;
    for (size_t c = 0; c < s->S->n_cameras && c < REC_MAX_CAMERAS; c++) {
        s->lit[c] = rec_frame_lit(s->frame, c);
        s->weight[c] = rec_frame_weight(s->frame) + s->S->row0[c];
        s->there[c] = (mask >> c & 1) != 0;
        s->believed[c] = ((mask & ~s->verdict->out) >> c & 1) != 0;
    }
}

void silhouettes_without_hull(struct rec_frame_params *p)
{
    p->photo.threshold = 0;
    p->photo.margin = 16; /* noise may be below 0 here and there */
    p->hull.min_views = 1;
}

size_t silhouettes_check_lit(const char *camera, const uint8_t *lit, const float *weight,
                             size_t bins, bool *said)
{
    size_t n = 0, without = 0;
    for (size_t i = 0; i < bins; i++) {
        n += lit[i] != 0;
        without += !(weight[i] > 0);
    }
    if (*said || (double)n < 0.9 * (double)bins)
        return n;
    *said = true;
    if (without > bins / 2) {
        fprintf(stderr,
                "pyrovox: %.0f %% of the image of %s say nothing, so they count as flame: they are "
                "saturated, masked, not a number, or beyond %g\n",
                100 * (double)without / (double)bins, camera, (double)REC_PHOTO_LIMIT);
        return n;
    }
    fprintf(
        stderr,
        "pyrovox: %.0f %% of the image of %s count as flame: does it have a black level (--black "
        "X, share of full scale) or a lit scene (--background DIR)?\n",
        100 * (double)n / (double)bins, camera);
    return n;
}
