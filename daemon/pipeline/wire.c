#include "daemon/pipeline/wire.h"

#include <stdio.h>

#include "recon/frame/running.h"

void dmn_wire_start(const struct rec_rig *rig, int nch, double fps, const char *program,
                    struct pvp_start *out)
{
    const struct rec_grid *g = &rig->grid;
    *out = (struct pvp_start){
        .rig_hash = rec_rig_hash(rig), .n_cameras = (uint32_t)rig->n_cameras, .fps = fps};
    for (int a = 0; a < 3; a++) {
        out->grid.n[a] = (uint32_t)g->n[a];
        out->grid.min[a] = g->min[a];
        out->grid.max[a] = g->max[a];
    }
    out->grid.basis = g->basis == REC_TRILINEAR ? 1 : 0;
    out->grid.channels = (uint32_t)nch;
    snprintf(out->units, sizeof out->units, "1/m");
    snprintf(out->software, sizeof out->software, "%s %s", program, PVX_VERSION);
}

void dmn_wire_volume(const struct dmn_slot *s, const struct pvp_grid *grid, struct pvp_volume *out,
                     struct pvp_voxels *voxels)
{
    const struct rec_frame_report *r = rec_frame_get_report(s->frame);
    struct rec_sparse v;
    rec_frame_volume(s->frame, &v);
    *voxels = (struct pvp_voxels){(uint32_t)v.n, v.index, v.value, v.cs};
    *out = (struct pvp_volume){.set = s->set,
                               .t_exposure_ns = s->t_exposure_ns,
                               .spread_ns = s->spread_ns,
                               .cameras_present = r->cameras,
                               .camera_mask = s->mask & ~r->vote.out,
                               .grid = *grid,
                               .report = {.status = (uint32_t)r->solve.status,
                                          .iterations = r->solve.iterations,
                                          .rel_residual = r->solve.rel_residual,
                                          .active_voxels = (uint32_t)r->active_voxels,
                                          .active_rays = (uint32_t)r->active_rays,
                                          .entries = r->entries,
                                          .photometry_ns = r->photo_ns,
                                          .hull_ns = r->hull_ns,
                                          .restrict_ns = r->restrict_ns,
                                          .solve_ns = r->solve_ns,
                                          .total_ns = rec_frame_total_ns(r)}};
    snprintf(out->report.solver, sizeof out->report.solver, "%s", r->solve.solver);
}

_Static_assert(REC_BARS_POOR_FIT == (int)PVP_DOUBT_POOR_FIT &&
                   REC_BARS_FEW_CAMERAS == (int)PVP_DOUBT_FEW_CAMERAS &&
                   REC_BARS_FINE == (int)PVP_DOUBT_FINE && REC_BARS_LATE == (int)PVP_DOUBT_LATE &&
                   REC_BARS_BLURRED == (int)PVP_DOUBT_BLURRED,
               "doubts go out as they are");

bool dmn_wire_bars(const struct dmn_slot *s, struct pvp_voxels *sd, uint32_t *doubt)
{
    const struct rec_bars_view *b = &s->bars;
    if (b->sd == NULL)
        return false;
    *sd = (struct pvp_voxels){(uint32_t)b->n, b->index, b->sd, b->cs};
    *doubt = b->doubt;
    return true;
}
