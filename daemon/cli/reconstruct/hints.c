#include "daemon/cli/reconstruct/hints.h"

#include <math.h>
#include <stdio.h>

static bool lit(const struct rec_sparse *v, int32_t q)
{
    float light = 0;
    for (int l = 0; l < v->nch; l++)
        light += v->value[(size_t)q * (size_t)v->cs + (size_t)l];
    return light > 0;
}

static bool any_lit(const struct rec_sparse *v)
{
    int32_t q = 0;
    while (q < v->n && !lit(v, q))
        q++;
    return q < v->n;
}

/* Whether flame touches a side of the fitted box that is not also a side of the rig's box.  The frames that the box
 * was fitted to had no flame there. */
static bool reaches_side(const struct rec_sparse *v, const struct rec_grid *whole)
{
    const struct rec_grid *g = v->grid;
    bool cut[3][2];
    for (int a = 0; a < 3; a++) {
        cut[a][0] = g->min[a] > whole->min[a] + 1e-9;
        cut[a][1] = g->max[a] < whole->max[a] - 1e-9;
    }
    for (int32_t q = 0; q < v->n; q++) {
        int32_t ijk[3];
        rec_grid_ijk(g, v->index[q], ijk);
        for (int a = 0; a < 3; a++)
            if (((ijk[a] == 0 && cut[a][0]) || (ijk[a] == g->n[a] - 1 && cut[a][1])) && lit(v, q))
                return true;
    }
    return false;
}

void reconstruct_hints_add(struct reconstruct_hints *h, const struct rec_frame_report *r,
                           const struct rec_sparse *v, const struct rec_grid *whole)
{
    h->volumes++;
    h->dark += r->solve.status == REC_DEADLINE && r->solve.iterations == 0 &&
               r->coarse_iterations == 0 && !r->warm;
    h->empty += !any_lit(v);
    h->corrected += r->selfcal.gain || r->selfcal.shift;
    for (uint32_t c = 0; c < r->selfcal.cameras && (r->selfcal.gain || r->selfcal.shift); c++) {
        const struct rec_selfcal_camera *k = &r->selfcal.camera[c];
        if (!k->known)
            continue;
        h->camera[c].n++;
        h->camera[c].gain += r->selfcal.gain ? (double)k->gain : 1;
        for (int i = 0; i < 2; i++)
            h->camera[c].shift[i] += r->selfcal.shift ? (double)k->shift[i] : 0;
    }
    h->cut += whole != NULL && reaches_side(v, whole);
}

/* The cameras furthest off in gain and in aim, means over the volumes that were corrected. */
static void say_corrected(const struct reconstruct_hints *h, const struct rec_rig *rig)
{
    size_t dim = 0, off = 0;
    double gain[REC_MAX_CAMERAS] = {0}, px[REC_MAX_CAMERAS] = {0};
    for (size_t c = 0; c < rig->n_cameras; c++) {
        double n = h->camera[c].n > 0 ? h->camera[c].n : 1;
        gain[c] = h->camera[c].n > 0 ? h->camera[c].gain / n : 1;
        px[c] = hypot(h->camera[c].shift[0] / n, h->camera[c].shift[1] / n);
        dim = fabs(log(gain[c])) > fabs(log(gain[dim])) ? c : dim;
        off = px[c] > px[off] ? c : off;
    }
    fprintf(stderr,
            "pyrovox: in %u of %u volumes the cameras were corrected while solving:", h->corrected,
            h->volumes);
    if (gain[dim] != 1)
        fprintf(stderr, " gains by up to %.3f (%s)", gain[dim], rig->cameras[dim].name);
    if (px[off] > 0)
        fprintf(stderr, "%s aim by up to %.2f px (%s)", gain[dim] != 1 ? "," : "", px[off],
                rig->cameras[off].name);
    fputs("; `pyrovox calibrate gain` and `pyrovox calibrate refine` mend the rig, --selfcal off "
          "leaves the pictures as they are\n",
          stderr);
}

void reconstruct_hints_say(const struct reconstruct_hints *h, const struct reconstruct_options *o,
                           const struct rec_rig *rig)
{
    if (h->volumes == 0)
        return;
    if (h->dark > 0)
        fprintf(stderr,
                "pyrovox: %u of %u volumes are empty, because not one iteration was done by the "
                "deadline; allow more than --deadline %g, or reduce the work (--grid, --binning)\n",
                h->dark, h->volumes, o->deadline_ms);
    else if (h->empty == h->volumes)
        fprintf(stderr,
                "pyrovox: no volume of %u has any light: are the pictures so dark? "
                "--threshold, --black and --background decide what counts as flame\n",
                h->volumes);
    if (h->corrected > 0)
        say_corrected(h, rig);
    if (h->cut > 0)
        fprintf(stderr,
                "pyrovox: in %u of %u volumes the flame reaches a side of the fitted box: look at "
                "more frames (--fit-frames all) or leave more room (--fit-volume=MARGIN)\n",
                h->cut, h->volumes);
}
