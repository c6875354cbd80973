#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/board/spec.h"
#include "recon/calib/priv.h"

#define STILL \
    0.5 /* px: two pictures between which the board moved less count as the same picture */

/* Two cameras of the old rig are the same: probably a copied entry. */
static pvx_err check_old(const struct calib *k)
{
    const struct rec_rig *old = k->in->options.old;
    for (size_t i = 0; old != NULL && i < old->n_cameras; i++)
        for (size_t j = 0; j < i; j++) {
            const struct rec_camera *a = &old->cameras[j], *b = &old->cameras[i];
            double x[3], y[3], turn = 0;
            rec_camera_centre(a, x);
            rec_camera_centre(b, y);
            for (int e = 0; e < 9; e++)
                turn = fmax(turn, fabs(a->R[e] - b->R[e]));
            if (turn < 1e-4 && hypot(hypot(x[0] - y[0], x[1] - y[1]), x[2] - y[2]) < 1e-4)
                return pvx_fail(k->d, PVX_EINVAL,
                                "the old rig has %s and %s at one place, looking the same way: one "
                                "is a copy of the other; take out the one that is not there, or "
                                "calibrate without the old rig",
                                a->name, b->name);
        }
    return PVX_OK;
}

static pvx_err take_check(const struct calib *k)
{
    const struct rec_calib_input *in = k->in;
    const struct rec_board *b = &in->board;
    int least = b->kind == REC_CHARUCO ? 2 : 1;
    if (b->cols < least || b->rows < least || b->cols > 1000 || b->rows > 1000 ||
        !(b->square > 0 && b->square < 1e3) || !(b->marker >= 0 || b->kind != REC_APRILGRID) ||
        (!isnan(b->thickness) && !(fabs(b->thickness) < 1)))
        return pvx_fail(k->d, PVX_EINVAL, "the board has no squares or no size");
    if (in->n_cameras < 1 || in->n_cameras > REC_MAX_CAMERAS)
        return pvx_fail(k->d, PVX_EINVAL, "%zu cameras; 1 to %d can be calibrated", in->n_cameras,
                        REC_MAX_CAMERAS);
    if (in->n_cameras > 1 && rec_board_symmetric(b))
        return pvx_fail(
            k->d, PVX_EINVAL,
            "a chessboard of %dx%d inner corners looks the same after half a turn, so "
            "that cameras cannot agree on its first corner: take one with one side even "
            "and one odd, or a charuco board",
            b->cols, b->rows);
    for (int i = 0; i < 3; i++)
        if (!(in->grid.max[i] - in->grid.min[i] >= 1e-9) || in->grid.n[i] < 0 ||
            in->grid.n[i] > REC_GRID_MAX)
            return pvx_fail(k->d, PVX_EINVAL, "the volume is empty along %c", "xyz"[i]);
    PVX_TRY(check_old(k));
    for (size_t c = 0; c < in->n_cameras; c++) {
        const struct rec_calib_camera *m = &in->camera[c];
        if (m->width < 1 || m->height < 1 || m->width > 16384 || m->height > 16384)
            return pvx_fail(k->d, PVX_EINVAL, "%s: a picture of %d x %d pixels", m->name, m->width,
                            m->height);
        int old = in->options.old != NULL ? rec_rig_find(in->options.old, m->name) : -1;
        if (m->hold != 0 && old < 0)
            return pvx_fail(k->d, PVX_EINVAL, "%s is to stay as it is, but no old rig has it",
                            m->name);
        if (old >= 0 && in->options.old->cameras[old].model != REC_PINHOLE)
            return pvx_fail(k->d, PVX_EUNSUP,
                            "%s: a %s in the old rig; boards give lenses with k1 k2 p1 p2 k3 "
                            "only: calibrate it with another program, and leave its pictures out",
                            m->name, rec_camera_model_name(in->options.old->cameras[old].model));
        const double *dist = old >= 0 ? in->options.old->cameras[old].dist : NULL;
        if ((m->hold & REC_HOLD_LENS) != 0 && (dist[5] != 0 || dist[6] != 0 || dist[7] != 0))
            return pvx_fail(k->d, PVX_EINVAL,
                            "%s: its lens in the old rig has k4, k5 or k6, which a calibration "
                            "does not know: let it be found anew, without --fix-intrinsics",
                            m->name);
        if ((m->hold & REC_HOLD_LENS) != 0 && (in->options.old->cameras[old].width != m->width ||
                                               in->options.old->cameras[old].height != m->height))
            return pvx_fail(
                k->d, PVX_EINVAL,
                "%s: pictures of %d x %d pixels, but the old rig's are %d x %d: its lens "
                "holds for its own size only",
                m->name, m->width, m->height, in->options.old->cameras[old].width,
                in->options.old->cameras[old].height);
    }
    for (size_t i = 0; i < in->n_views; i++)
        if (in->view[i].camera >= in->n_cameras)
            return pvx_fail(k->d, PVX_EINVAL, "view %zu is of camera %u of %zu", i,
                            in->view[i].camera, in->n_cameras);
    const struct rec_calib_options *o = &in->options;
    if ((o->world == REC_WORLD_UP && o->up_camera >= in->n_cameras) ||
        (o->world == REC_WORLD_OLD && o->old == NULL))
        return pvx_fail(k->d, PVX_EINVAL,
                        "the world is to be taken from a camera or rig that is not there");
    for (size_t i = 0; i < o->n_measured; i++)
        if (o->measured[i].a >= in->n_cameras || o->measured[i].b >= in->n_cameras ||
            !(o->measured[i].metres > 0))
            return pvx_fail(k->d, PVX_EINVAL,
                            "a measured distance needs two cameras and metres above 0");
    return PVX_OK;
}

static int take_by_frame(const void *pa, const void *pb)
{
    const struct view *a = pa, *b = pb;
    if (a->board->frame != b->board->frame)
        return a->board->frame < b->board->frame ? -1 : 1;
    if (a->camera != b->camera)
        return a->camera < b->camera ? -1 : 1;
    return a->in < b->in ? -1 : a->in > b->in;
}

/* Whitening of a corner's covariance.  No detector locates a corner better than 0.02 px.  An invalid covariance is
 * replaced by 0.1 px. */
static void whiten(const double cov[3], double W[3])
{
    double xx = cov[0] + 4e-4, xy = cov[1], yy = cov[2] + 4e-4;
    if (!isfinite(xx + xy + yy) || !(cov[0] > 0) || !(cov[2] > 0) || !(xx * yy > xy * xy)) {
        xx = yy = 0.01;
        xy = 0;
    }
    double a = sqrt(xx), b = xy / a, c = sqrt(yy - b * b);
    W[0] = 1 / a;
    W[1] = -b / (a * c);
    W[2] = 1 / c;
}

/* The corners of one view, if they are valid. */
static enum rec_view_fate corners(struct calib *k, struct view *v)
{
    const struct rec_board_view *b = v->board;
    const struct rec_calib_camera *c = &k->in->camera[v->camera];
    uint32_t most = rec_board_corners(&k->in->board);
    double lo[2] = {INFINITY, INFINITY}, hi[2] = {-INFINITY, -INFINITY};
    v->first = k->ns;
    if ((b->n > 0 && b->corner == NULL) || b->n > most ||
        (b->face == REC_BACK && !k->in->board.two_sided))
        return REC_VIEW_BROKEN;
    for (size_t i = 0; i < b->n; i++) {
        const struct rec_board_corner *p = &b->corner[i];
        if (p->id >= most || (i > 0 && p->id <= b->corner[i - 1].id) ||
            !(p->x >= -c->width && p->x <= 2 * c->width) ||
            !(p->y >= -c->height && p->y <= 2 * c->height))
            return REC_VIEW_BROKEN;
        struct seen *s = &k->seen[k->ns + i];
        double X[3];
        rec_board_point(&k->in->board, b->face, p->id, X);
        *s = (struct seen){.x = X[0], .y = X[1], .u = p->x, .v = p->y};
        whiten(p->cov, s->W);
        for (int a = 0; a < 2; a++) {
            lo[a] = fmin(lo[a], a == 0 ? p->x : p->y);
            hi[a] = fmax(hi[a], a == 0 ? p->x : p->y);
        }
    }
    if (b->n < LEAST)
        return REC_VIEW_FEW;
    v->n = b->n;
    k->ns += b->n;
    v->area = (hi[0] - lo[0]) * (hi[1] - lo[1]) / ((double)c->width * c->height);
    return REC_VIEW_USED;
}

/* Do two views of one camera show the board in the same place? */
static bool same_place(const struct calib *k, const struct view *a, const struct view *b)
{
    double sum = 0;
    size_t n = 0;
    if (a->board->face != b->board->face)
        return false;
    for (size_t i = 0, j = 0; i < a->n && j < b->n;) {
        uint32_t p = a->board->corner[i].id, q = b->board->corner[j].id;
        if (p == q) {
            const struct seen *s = &k->seen[a->first + i], *t = &k->seen[b->first + j];
            sum += hypot(s->u - t->u, s->v - t->v);
            n++;
            if (n == 4 && sum > 16 * STILL)
                return false;
        }
        i += p <= q;
        j += q <= p;
    }
    return 2 * n >= a->n && n >= LEAST && sum < STILL * (double)n;
}

/* A frame in which every camera sees the same as in an earlier frame adds nothing new. */
static void drop_still(struct calib *k)
{
    for (size_t f = 1; f < k->nf; f++)
        for (size_t g = 0; g < f; g++) {
            size_t both = 0, same = 0, all = 0;
            for (size_t i = k->of_frame[f]; i < k->of_frame[f + 1]; i++) {
                all += k->view[i].fate == REC_VIEW_USED;
                for (size_t j = k->of_frame[g]; j < k->of_frame[g + 1] && both == same; j++)
                    if (k->view[i].camera == k->view[j].camera &&
                        k->view[i].fate == REC_VIEW_USED && k->view[j].fate == REC_VIEW_USED) {
                        both++;
                        same += same_place(k, &k->view[i], &k->view[j]);
                    }
            }
            if (all == 0 || both != same || same < all)
                continue;
            for (size_t i = k->of_frame[f]; i < k->of_frame[f + 1]; i++)
                if (k->view[i].fate == REC_VIEW_USED) {
                    k->view[i].fate = REC_VIEW_STILL;
                    k->out->view[k->view[i].in].like = k->out->frame[g];
                }
            break;
        }
}

static pvx_err take_reserve(struct calib *k)
{
    const struct rec_calib_input *in = k->in;
    struct rec_calib_report *r = k->out;
    size_t corners = 0;
    for (size_t i = 0; i < in->n_views; i++)
        corners += in->view[i].n;
    k->nc = r->n_cameras = in->n_cameras;
    k->nv = r->n_views = in->n_views;
    k->view = pvx_calloc(k->nv, sizeof *k->view);
    k->seen = pvx_calloc(corners, sizeof *k->seen);
    k->of_frame = pvx_calloc(k->nv + 1, sizeof *k->of_frame);
    k->placed = pvx_calloc(k->nv, sizeof *k->placed);
    k->n_state = SHAPE + (REC_LENS + 6) * k->nc + 6 * k->nv;
    k->state = pvx_calloc(k->n_state, sizeof *k->state);
    r->camera = pvx_calloc(k->nc, sizeof *r->camera);
    r->view = pvx_calloc(k->nv, sizeof *r->view);
    r->pair = pvx_calloc(k->nc * (k->nc - 1) / 2, sizeof *r->pair);
    r->frame = pvx_calloc(k->nv, sizeof *r->frame);
    r->board = pvx_calloc(k->nv, sizeof *r->board);
    return k->view == NULL || k->seen == NULL || k->of_frame == NULL || k->placed == NULL ||
                   k->state == NULL || r->camera == NULL || r->view == NULL || r->pair == NULL ||
                   r->frame == NULL || r->board == NULL
               ? PVX_ENOMEM
               : PVX_OK;
}

static void measure_board(struct calib *k)
{
    double lo[2] = {INFINITY, INFINITY}, hi[2] = {-INFINITY, -INFINITY}, X[3];
    for (uint32_t id = 0; id < rec_board_corners(&k->in->board); id++) {
        rec_board_point(&k->in->board, REC_FRONT, id, X);
        for (int a = 0; a < 2; a++) {
            lo[a] = fmin(lo[a], X[a]);
            hi[a] = fmax(hi[a], X[a]);
        }
    }
    for (int a = 0; a < 2; a++) {
        k->middle[a] = 0.5 * (lo[a] + hi[a]);
        k->half[a] = fmax(0.5 * (hi[a] - lo[a]), 1e-9);
    }
}

pvx_err rec_calib_take(struct calib *k)
{
    PVX_TRY(take_check(k));
    PVX_TRY(take_reserve(k));
    for (size_t i = 0; i < k->nv; i++)
        k->view[i] =
            (struct view){.in = i, .board = &k->in->view[i], .camera = k->in->view[i].camera};
    qsort(k->view, k->nv, sizeof *k->view, take_by_frame);
    for (size_t i = 0; i < k->nv; i++) {
        struct view *v = &k->view[i];
        if (i == 0 || v->board->frame != k->view[i - 1].board->frame) {
            k->of_frame[k->nf] = i;
            k->out->frame[k->nf++] = v->board->frame;
        }
        v->frame = (uint32_t)k->nf - 1;
        bool twice =
            i > 0 && k->view[i - 1].frame == v->frame && k->view[i - 1].camera == v->camera;
        v->fate = twice ? REC_VIEW_TWICE : corners(k, v);
        k->out->camera[v->camera].views++;
        k->out->view[v->in].corners = v->board->n;
    }
    k->of_frame[k->nf] = k->nv;
    k->out->n_frames = k->nf;
    rec_calib_use_state(k, k->state);
    measure_board(k);
    bool thick = k->in->board.two_sided && isnan(k->in->board.thickness);
    k->shape_held = thick ? 0 : 1u << 3;
    k->shape[3] = isnan(k->in->board.thickness) ? 0 : k->in->board.thickness;
    for (size_t c = 0; c < k->nc; c++) {
        const struct rec_rig *old = k->in->options.old;
        int was = old != NULL ? rec_rig_find(old, k->in->camera[c].name) : -1;
        k->scale[c] = 1;
        k->windows[c] = was >= 0 ? rec_calib_windows(&old->cameras[was], k->window[c]) : 0;
    }
    drop_still(k);
    return PVX_OK;
}
