/* Each camera alone: focal length from homographies (Zhang, IEEE TPAMI 22:1330, 2000, with the principal point at
 * its prior), both poses of the plane in every view, and a bundle adjustment of its own. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/calib/model.h"
#include "recon/calib/pose.h"
#include "recon/calib/priv.h"

/* Points of a view for the module.  The back is seen from behind, so the sign of y changes. */
struct flat {
    double *plane, *pixels; /* [n][2] */
    size_t n;
};

static void flatten(const struct calib *k, const struct view *v, bool ideal, struct flat *f)
{
    f->n = 0;
    for (size_t i = v->first; i < v->first + v->n; i++) {
        const struct seen *s = &k->seen[i];
        double *p = &f->pixels[2 * f->n];
        if (s->wrong)
            continue;
        p[0] = s->u;
        p[1] = s->v;
        if (ideal && !rec_model_ideal(k->lens[v->camera], p, p))
            continue;
        f->plane[2 * f->n] = s->x - k->middle[0];
        f->plane[2 * f->n + 1] = (s->y - k->middle[1]) * (v->board->face == REC_BACK ? -1 : 1);
        f->n++;
    }
}

/* Both poses of a view with the present lens. */
static pvx_err plane_poses(struct calib *k, struct view *v, struct flat *f)
{
    char err[PVX_DIAG_MAX] = "";
    double pose[2][6];
    flatten(k, v, true, f);
    v->n_poses = 0;
    if (f->n < LEAST)
        return PVX_OK;
    int e = k->lib->planar(f->plane, f->pixels, f->n, pose[0], &v->n_poses, err, sizeof err);
    if (e == PVX_ENOMEM)
        return PVX_ENOMEM;
    if (e != PVX_OK)
        v->n_poses = 0;
    /* From the board's axes to the plane's: its middle, and on the back half a turn about x. */
    bool back = v->board->face == REC_BACK;
    double half[6] = {back ? acos(-1) : 0, 0, 0, 0, 0, 0};
    double middle[6] = {0, 0, 0, -k->middle[0], -k->middle[1], back ? -k->shape[3] : 0}, to[6];
    rec_pose_mul(half, middle, to);
    int good = 0;
    for (int i = 0; i < v->n_poses; i++) {
        double sum = 0;
        for (int a = 0; a < 6; a++)
            sum += pose[i][a];
        if (!isfinite(sum))
            continue;
        rec_pose_mul(pose[i], to, v->pose[good]);
        rec_calib_measure(k, v, v->pose[good]);
        v->fit[good++] = rec_calib_rms(k, v);
    }
    v->n_poses = good;
    if (good == 2 && v->fit[1] < v->fit[0]) {
        double swap[6], fit = v->fit[0];
        memcpy(swap, v->pose[0], sizeof swap);
        memcpy(v->pose[0], v->pose[1], sizeof swap);
        memcpy(v->pose[1], swap, sizeof swap);
        v->fit[0] = v->fit[1];
        v->fit[1] = fit;
    }
    return PVX_OK;
}

/* Estimates q = (f / side)^2 from a homography H to pixels relative to the middle, in units of `side`.  Its first two
 * columns are at right angles and equally long once their upper two numbers are divided by f:
 *     H0 H1 + H3 H4 = -q H6 H7,   H0^2 + H3^2 - H1^2 - H4^2 = -q (H6^2 - H7^2),   in short B = q A.
 * Returns the weight A^2 of this view; 0 where the board is not tilted. */
static double focal_of(const double H[9], double *q)
{
    double g =
        sqrt((H[0] * H[0] + H[3] * H[3] + H[6] * H[6]) * (H[1] * H[1] + H[4] * H[4] + H[7] * H[7]));
    double B[2] = {(H[0] * H[1] + H[3] * H[4]) / g,
                   (H[0] * H[0] + H[3] * H[3] - H[1] * H[1] - H[4] * H[4]) / (2 * g)};
    double A[2] = {-H[6] * H[7] / g, -(H[6] * H[6] - H[7] * H[7]) / (2 * g)};
    double aa = A[0] * A[0] + A[1] * A[1];
    *q = aa > 0 ? (A[0] * B[0] + A[1] * B[1]) / aa : 0;
    return aa;
}

/* Marks corners further than `reach` from the homography as wrong; false: too many are. */
static bool start_fits(struct calib *k, const struct view *v, const struct flat *f,
                       const double H[9], double reach)
{
    size_t right = 0;
    for (size_t j = 0; j < f->n; j++) { /* none was wrong before: f has them all */
        double x = f->plane[2 * j], y = f->plane[2 * j + 1], w = H[6] * x + H[7] * y + H[8];
        double u = (H[0] * x + H[1] * y + H[2]) / w, t = (H[3] * x + H[4] * y + H[5]) / w;
        bool near = w * H[8] > 0 && hypot(u - f->pixels[2 * j], t - f->pixels[2 * j + 1]) < reach;
        k->seen[v->first + j].wrong = !near;
        right += near;
    }
    return right >= LEAST && (double)right >= (1 - WRONG_VIEW) * (double)v->n;
}

struct vote {
    double q, weight;
};

static int by_q(const void *a, const void *b)
{
    double x = ((const struct vote *)a)->q, y = ((const struct vote *)b)->q;
    return (x > y) - (x < y);
}

/* The focal length [px]: weighted median of the views' estimates, or 1.2 times the longer side if there is none.
 * Views without a homography are left out. */
static pvx_err focal(struct calib *k, uint32_t c, struct flat *flat, struct vote *vote, double *f)
{
    const struct rec_calib_camera *m = &k->in->camera[c];
    double side = m->width > m->height ? m->width : m->height, sum = 0, half = 0;
    size_t n = 0;
    *f = 1.2 * side;
    for (size_t i = 0; i < k->nv; i++) {
        struct view *v = &k->view[i];
        double H[9];
        char err[PVX_DIAG_MAX] = "";
        if (v->camera != c || v->fate != REC_VIEW_USED)
            continue;
        flatten(k, v, false, flat);
        for (size_t j = 0; j < flat->n; j++) {
            flat->pixels[2 * j] -= 0.5 * (m->width - 1);
            flat->pixels[2 * j + 1] -= 0.5 * (m->height - 1);
        }
        /* distortion bends a board that fills the picture by several pixels */
        int e =
            k->lib->homography(flat->plane, flat->pixels, flat->n, 0.01 * side, H, err, sizeof err);
        if (e == PVX_ENOMEM)
            return PVX_ENOMEM;
        if (e != PVX_OK || !start_fits(k, v, flat, H, 0.01 * side)) {
            v->fate = e != PVX_OK ? REC_VIEW_FEW : REC_VIEW_SELF;
            continue;
        }
        for (int j = 0; j < 6; j++)
            H[j] /= side;
        struct vote one;
        one.weight = focal_of(H, &one.q);
        if (one.q > 0.05 && one.q < 400 && one.weight > 1e-6) {
            vote[n++] = one;
            sum += one.weight;
        }
    }
    qsort(vote, n, sizeof *vote, by_q);
    for (size_t i = 0; i < n && half < 0.5 * sum; i++) {
        half += vote[i].weight;
        *f = side * sqrt(vote[i].q);
    }
    return PVX_OK;
}

static void start_lens(struct calib *k, uint32_t c, double f)
{
    const struct rec_calib_camera *m = &k->in->camera[c];
    double *l = k->lens[c];
    k->lens_held[c] = 0;
    if ((m->hold & REC_HOLD_LENS) != 0) {
        const struct rec_camera *old =
            &k->in->options.old->cameras[rec_rig_find(k->in->options.old, m->name)];
        const double as[REC_LENS] = {old->fx,      old->fy,      old->cx,
                                     old->cy,      old->dist[0], old->dist[1],
                                     old->dist[2], old->dist[3], old->dist[4]};
        memcpy(l, as, sizeof as);
        k->lens_held[c] = (1u << REC_LENS) - 1;
    } else {
        const double as[REC_LENS] = {f, f, 0.5 * (m->width - 1), 0.5 * (m->height - 1)};
        memcpy(l, as, sizeof as);
    }
    memcpy(k->believed[c], l, sizeof k->believed[c]);
}

/* Marks corners beyond the camera's own spread as wrong, and leaves out views with many wrong corners.  True when
 * anything changed. */
static bool start_judge(struct calib *k, uint32_t c, double *room)
{
    size_t n = 0;
    bool changed = false;
    for (size_t i = 0; i < k->nv; i++) {
        const struct view *v = &k->view[i];
        if (v->camera != c || v->fate != REC_VIEW_USED)
            continue;
        rec_calib_measure(k, v, k->board[v->frame]);
        for (size_t s = v->first; s < v->first + v->n; s++)
            room[n++] = fmin(k->seen[s].far, 1e9);
    }
    double unit =
        fmax(pvx_median(room, n) / 1.17741, 1e-6); /* of a circular normal: sqrt(2 ln 2) */
    k->scale[c] *= unit;
    for (size_t i = 0; i < k->nv; i++) {
        struct view *v = &k->view[i];
        size_t wrong = 0;
        if (v->camera != c || v->fate != REC_VIEW_USED)
            continue;
        for (size_t s = v->first; s < v->first + v->n; s++) {
            struct seen *p = &k->seen[s];
            p->far /= unit;
            bool now = !(p->far < OUTLIER);
            changed |= now != p->wrong;
            p->wrong = now;
            wrong += now;
        }
        if (wrong > WRONG_VIEW * (double)v->n || v->n - wrong < LEAST) {
            v->fate = REC_VIEW_SELF;
            changed = true;
        }
    }
    return changed;
}

/* The poses to start from: those of the plane, or the result of the last round where that is better. */
static pvx_err choose_poses(struct calib *k, uint32_t c, struct flat *flat, bool first,
                            size_t *views)
{
    *views = 0;
    for (size_t i = 0; i < k->nv; i++) {
        struct view *v = &k->view[i];
        double was = INFINITY;
        if (v->camera != c || v->fate != REC_VIEW_USED)
            continue;
        if (!first) {
            rec_calib_measure(k, v, k->board[v->frame]);
            was = rec_calib_rms(k, v);
        }
        PVX_TRY(plane_poses(k, v, flat));
        if (v->n_poses == 0) {
            v->fate = REC_VIEW_SELF;
            continue;
        }
        if (v->fit[0] < was)
            memcpy(k->board[v->frame], v->pose[0], sizeof v->pose[0]);
        k->placed[v->frame] = true;
        (*views)++;
    }
    return PVX_OK;
}

/* The adjusted pose becomes the first pose of a view; the other of the plane's two poses becomes the second. */
static void keep_poses(struct calib *k, uint32_t c)
{
    for (size_t i = 0; i < k->nv; i++) {
        struct view *v = &k->view[i];
        double R[9];
        if (v->camera != c || v->fate != REC_VIEW_USED)
            continue;
        const double *pose = k->board[v->frame];
        double reach = hypot(pose[3], pose[5]);
        if (v->n_poses == 2 && rec_pose_distance(pose, v->pose[1], reach) <
                                   rec_pose_distance(pose, v->pose[0], reach)) {
            memcpy(v->pose[1], v->pose[0], sizeof v->pose[0]);
            v->fit[1] = v->fit[0];
        }
        memcpy(v->pose[0], pose, sizeof v->pose[0]);
        rec_calib_measure(k, v, v->pose[0]);
        v->single = v->fit[0] = rec_calib_rms(k, v);
        v->usual = rec_calib_usual(k, v);
        rec_rotation(v->pose[0], R);
        v->tilt = acos(fmin(1, fabs(R[8])));
    }
}

static pvx_err start_alone(struct calib *k, uint32_t c, struct flat *flat, double *room)
{
    bool only[REC_MAX_CAMERAS] = {false}, changed = true;
    double f;
    size_t views;
    only[c] = true;
    PVX_TRY(focal(k, c, flat, (struct vote *)room, &f));
    start_lens(k, c, f);
    memset(k->pose[c], 0, sizeof k->pose[c]);
    memset(k->placed, 0, k->nf * sizeof *k->placed);
    for (int round = 0; round < 4 && changed; round++) {
        PVX_TRY(choose_poses(k, c, flat, round == 0, &views));
        if (views == 0)
            return PVX_OK;
        const struct adjust a = {
            .camera = only, .robust = true, .pose_fixed = true, .max_iterations = 50};
        PVX_TRY(rec_calib_adjust(k, &a));
        changed = start_judge(k, c, room) || round == 0; /* the scale is known from round 1 on */
    }
    keep_poses(k, c);
    return PVX_OK;
}

pvx_err rec_calib_start(struct calib *k)
{
    size_t corners = rec_board_corners(&k->in->board);
    struct flat flat = {pvx_calloc(2 * corners, sizeof(double)),
                        pvx_calloc(2 * corners, sizeof(double)), 0};
    double *room = pvx_calloc(k->ns + 2 * k->nv, sizeof *room), thickness = k->shape[3];
    unsigned held = k->shape_held;
    pvx_err e = flat.plane != NULL && flat.pixels != NULL && room != NULL ? PVX_OK : PVX_ENOMEM;
    k->shape_held |= 1u << 3; /* one camera sees one face at a time */
    for (uint32_t c = 0; c < k->nc && e == PVX_OK; c++) {
        memset(k->shape, 0, 3 * sizeof *k->shape);
        e = start_alone(k, c, &flat, room);
        k->out->camera[c].structure = rec_calib_structure(k, c, &k->out->camera[c].coverage);
    }
    memset(k->shape, 0, 3 * sizeof *k->shape);
    k->shape[3] = thickness;
    k->shape_held = held;
    free(flat.plane);
    free(flat.pixels);
    free(room);
    return e;
}
