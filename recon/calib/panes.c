/* panes.c - windows between cameras and board.
 * Where a camera stands is not known before the solve, but how a window stands before it is: as in the old rig.  Only
 * its normal and its thickness matter, not its distance, so the windows stay in the axes of their camera. */
#include <math.h>

#include "recon/calib/pose.h"
#include "recon/calib/priv.h"

static double panes_dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

int32_t rec_calib_windows(const struct rec_camera *c, struct rec_glass out[REC_WINDOWS])
{
    double centre[3];
    rec_camera_centre(c, centre);
    for (int32_t i = 0; i < c->n_windows; i++) {
        const struct rec_glass *w = &c->window[i];
        out[i] = *w;
        for (int a = 0; a < 3; a++)
            out[i].normal[a] = panes_dot(c->R + 3 * a, w->normal);
        out[i].at = w->at - panes_dot(w->normal, centre);
    }
    return c->n_windows;
}

void rec_calib_glaze(const struct rec_glass *w, int32_t n, struct rec_camera *c)
{
    double centre[3];
    rec_camera_centre(c, centre);
    c->n_windows = n;
    for (int32_t i = 0; i < n; i++) {
        struct rec_glass *to = &c->window[i];
        *to = w[i];
        for (int a = 0; a < 3; a++)
            to->normal[a] = c->R[a] * w[i].normal[0] + c->R[3 + a] * w[i].normal[1] +
                            c->R[6 + a] * w[i].normal[2];
        double over = 1 / sqrt(panes_dot(to->normal, to->normal));
        for (int a = 0; a < 3; a++)
            to->normal[a] *= over;
        to->at = w[i].at + panes_dot(to->normal, centre);
    }
}

pvx_err rec_calib_beyond(const struct calib *k)
{
    for (size_t i = 0; i < k->nv; i++) {
        const struct view *v = &k->view[i];
        double pose[6], X[3], Z[3];
        if (v->fate != REC_VIEW_USED || !k->placed[v->frame] || k->windows[v->camera] == 0)
            continue;
        rec_pose_mul(k->pose[v->camera], k->board[v->frame], pose);
        for (size_t s = v->first; s < v->first + v->n; s++) {
            rec_calib_point(k, v, &k->seen[s], X);
            rec_model_move(pose, X, Z, NULL, NULL);
            for (int32_t w = 0; w < k->windows[v->camera]; w++) {
                const struct rec_glass *g = &k->window[v->camera][w];
                double beyond = panes_dot(g->normal, Z) - g->at - g->thickness;
                if (beyond < -0.02)
                    return pvx_fail(
                        k->d, PVX_EINVAL,
                        "%s: in frame %u the board is %.3g m before the far face of window %d of "
                        "the old rig: hold it where the flame burns, or correct the window's plane",
                        k->in->camera[v->camera].name, k->out->frame[v->frame], -beyond, (int)w);
            }
        }
    }
    return PVX_OK;
}
