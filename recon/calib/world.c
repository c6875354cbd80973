/* Places the world: moves the rig and its boards as one. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "recon/calib/pose.h"
#include "recon/calib/priv.h"

/* to_world: axes of the fit -> axes of the world. */
static void move_all(struct calib *k, const double to_world[6])
{
    double back[6], out[6];
    rec_pose_inverse(to_world, back);
    memcpy(k->to_world, to_world, sizeof k->to_world);
    for (size_t c = 0; c < k->nc; c++) {
        rec_pose_mul(k->pose[c], back, out);
        memcpy(k->pose[c], out, sizeof out);
    }
    for (size_t f = 0; f < k->nf; f++)
        if (k->placed[f]) {
            rec_pose_mul(to_world, k->board[f], out);
            memcpy(k->board[f], out, sizeof out);
        }
}

static void world_centre(const struct calib *k, size_t c, double out[3])
{
    double back[6];
    rec_pose_inverse(k->pose[c], back);
    memcpy(out, back + 3, 3 * sizeof *out);
}

static size_t views_of(const struct calib *k, size_t f, int *front)
{
    size_t n = 0;
    *front = 0;
    for (size_t i = k->of_frame[f]; i < k->of_frame[f + 1]; i++)
        if (k->view[i].fate == REC_VIEW_USED) {
            n++;
            *front += k->view[i].board->face == REC_FRONT ? 1 : -1;
        }
    return n;
}

/* The world in which the board of frame f lies at the bottom of the volume, its middle above (0,0). */
static void by_floor(struct calib *k, size_t f)
{
    int front;
    (void)views_of(k, f, &front);
    double half[6] = {front >= 0 ? acos(-1) : 0, 0, 0, 0, 0, 0}; /* z of the board looks into it */
    double z = front >= 0 ? 0 : k->shape[3];
    double middle[6] = {0, 0, 0, -k->middle[0], -k->middle[1], -z}, inverse[6], a[6], b[6];
    double lift[6] = {0, 0, 0, 0, 0, k->in->grid.min[2]};
    rec_pose_inverse(k->board[f], inverse);
    rec_pose_mul(middle, inverse, a);
    rec_pose_mul(half, a, b);
    rec_pose_mul(lift, b, a);
    move_all(k, a);
}

/* The frame that stands for this one: itself, or the earlier frame since which nothing moved. */
static uint32_t counts_as(const struct calib *k, uint32_t frame)
{
    for (size_t i = 0; i < k->in->n_views; i++)
        if (k->in->view[i].frame == frame && k->out->view[i].fate == REC_VIEW_STILL)
            return k->out->view[i].like;
    return frame;
}

static pvx_err floor_frame(struct calib *k)
{
    uint32_t floor = counts_as(k, k->in->options.floor_frame);
    for (size_t f = 0; f < k->nf; f++)
        if (k->out->frame[f] == floor && k->placed[f]) {
            by_floor(k, f);
            return PVX_OK;
        }
    rec_calib_say(
        k, REC_CALIB_REFUSED, REC_CALIB_WORLD, -1, k->in->options.floor_frame,
        "frame %u should show the board on the floor, but no camera has a usable view of it",
        k->in->options.floor_frame);
    return pvx_fail(k->d, PVX_EINVAL, "%s", rec_calib_last_refused(k));
}

static void best_frame(struct calib *k)
{
    size_t best = 0, most = 0;
    int front;
    for (size_t f = 0; f < k->nf; f++) {
        size_t n = k->placed[f] ? views_of(k, f, &front) : 0;
        if (n > most) {
            most = n;
            best = f;
        }
    }
    if (most == 0)
        return;
    by_floor(k, best);
    rec_calib_say(
        k, REC_CALIB_WARNING, REC_CALIB_WORLD, -1, k->out->frame[best],
        "nobody said where the world is: it stands on the board of frame %u, which %zu cameras "
        "saw; lay the board on the floor of the volume and name that frame",
        k->out->frame[best], most);
}

/* Rotation whose rows are x, y, z; z is of unit length, x is made so and perpendicular to z. */
static void upright(const double z[3], const double right[3], double R[9])
{
    double along = 0, n = 0, x[3];
    for (int i = 0; i < 3; i++)
        along += z[i] * right[i];
    for (int i = 0; i < 3; i++) {
        x[i] = right[i] - along * z[i];
        n += x[i] * x[i];
    }
    n = sqrt(n);
    for (int i = 0; i < 3; i++) {
        R[i] = x[i] / n;
        R[6 + i] = z[i];
    }
    for (int i = 0; i < 3; i++) {
        int a = (i + 1) % 3, b = (i + 2) % 3;
        R[3 + i] = z[a] * R[b] - z[b] * R[a];
    }
}

/* The point nearest to all optical axes: sum (I - d d^T) X = sum (I - d d^T) o, by Cramer. */
static bool meeting(const struct calib *k, double X[3])
{
    double A[9] = {0}, b[3] = {0};
    for (size_t c = 0; c < k->nc; c++) {
        double R[9], o[3];
        rec_rotation(k->pose[c], R);
        world_centre(k, c, o);
        for (int i = 0; i < 3; i++)
            for (int j = 0; j < 3; j++) {
                double m = (i == j) - R[6 + i] * R[6 + j];
                A[3 * i + j] += m;
                b[i] += m * o[j];
            }
    }
    double C[9], det = 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            int i1 = (i + 1) % 3, i2 = (i + 2) % 3, j1 = (j + 1) % 3, j2 = (j + 2) % 3;
            C[3 * i + j] = A[3 * i1 + j1] * A[3 * i2 + j2] - A[3 * i1 + j2] * A[3 * i2 + j1];
        }
    for (int j = 0; j < 3; j++)
        det += A[j] * C[j];
    for (int i = 0; i < 3; i++)
        X[i] = (C[i] * b[0] + C[3 + i] * b[1] + C[6 + i] * b[2]) / det;
    return det > 1e-6; /* axes that are nearly parallel do not meet */
}

static pvx_err by_up(struct calib *k)
{
    const struct rec_calib_options *o = &k->in->options;
    const struct rec_grid *g = &k->in->grid;
    double C[9], z[3], n = 0, X[3], world[6], at[3];
    rec_rotation(k->pose[o->up_camera], C);
    for (int i = 0; i < 3; i++) { /* R^T up */
        z[i] = C[i] * o->up[0] + C[3 + i] * o->up[1] + C[6 + i] * o->up[2];
        n += z[i] * z[i];
    }
    n = sqrt(n);
    if (!(n > 1e-9) || !isfinite(n) || !(hypot(o->up[1], o->up[2]) > 1e-3 * n) || !meeting(k, X))
        return pvx_fail(k->d, PVX_EINVAL,
                        "up has no direction, or the optical axes meet nowhere: name the "
                        "frame with the board on the floor instead");
    for (int i = 0; i < 3; i++)
        z[i] /= n;
    double R[9];
    upright(z, C, R);
    rec_rotation_log(R, world);
    memset(world + 3, 0, 3 * sizeof *world);
    rec_pose_apply(world, X, at);
    for (int i = 0; i < 3; i++)
        world[3 + i] = 0.5 * (g->min[i] + g->max[i]) - at[i];
    move_all(k, world);
    return PVX_OK;
}

/* ---- an old rig ----------------------------------------------------------------------------------- */

/* The motion onto the old rig by the cameras of both rigs; cameras that were moved since count little. */
static pvx_err by_old(struct calib *k)
{
    const struct rec_rig *old = k->in->options.old;
    struct rec_camera a[REC_MAX_CAMERAS], b[REC_MAX_CAMERAS];
    struct rec_rig ra = {.grid = k->in->grid, .cameras = a}, rb = {.cameras = b}, now;
    struct rec_calib_overlay o;
    uint32_t who[REC_MAX_CAMERAS];
    double m[6], world[6], sorted[REC_MAX_CAMERAS];
    PVX_TRY(rec_calib_rig(k, &now));
    for (uint32_t c = 0; c < k->nc; c++) {
        int j = rec_rig_find(old, k->in->camera[c].name);
        if (j < 0)
            continue;
        who[ra.n_cameras] = c;
        a[ra.n_cameras++] = old->cameras[j];
        b[rb.n_cameras++] = now.cameras[c];
    }
    rec_rig_fini(&now);
    if (rec_calib_register(&ra, &rb, true, m, &o) != PVX_OK)
        return pvx_fail(
            k->d, PVX_EINVAL,
            "the old rig has none of these cameras by name, or none that sees the volume");
    for (size_t i = 0; i < ra.n_cameras; i++)
        sorted[i] = o.px[i];
    double usual = fmax(pvx_median(sorted, ra.n_cameras), 0.02);
    for (size_t i = 0; i < ra.n_cameras; i++)
        if (o.px[i] > 8 * usual && o.px[i] > 0.5)
            rec_calib_say(k, REC_CALIB_WARNING, REC_CALIB_OLD_RIG, (int)who[i], REC_NO_FRAME,
                          "%s sees the volume %.1f px from where it saw it in the old rig, the "
                          "others %.2g px: it "
                          "was moved or turned since",
                          a[i].name, o.px[i], usual);
    double off = 1 / o.scale - 1; /* size of the old rig over size of this one, less 1 */
    if (ra.n_cameras > 2 && fabs(off) > 5e-3)
        rec_calib_say(k, REC_CALIB_WARNING, REC_CALIB_SCALE, -1, REC_NO_FRAME,
                      "the old rig is %.2f %% %s: one of the boards was printed to another scale, "
                      "or a camera "
                      "moved far",
                      100 * fabs(off), off > 0 ? "larger" : "smaller");
    rec_pose_inverse(m, world);
    move_all(k, world);
    return PVX_OK;
}

static void check_scale(struct calib *k)
{
    for (size_t i = 0; i < k->in->options.n_measured; i++) {
        const struct rec_calib_measured *m = &k->in->options.measured[i];
        double a[3], b[3];
        world_centre(k, m->a, a);
        world_centre(k, m->b, b);
        double d = sqrt(pow(a[0] - b[0], 2) + pow(a[1] - b[1], 2) + pow(a[2] - b[2], 2));
        double off = d / m->metres - 1;
        rec_calib_say(
            k, fabs(off) > 0.01 ? REC_CALIB_WARNING : REC_CALIB_NOTE, REC_CALIB_SCALE, (int)m->a,
            REC_NO_FRAME,
            fabs(off) > 0.01
                ? "%s and %s are %.4f m apart, %+.2f %% of what was measured: measure the "
                  "print's squares, a printer may have scaled them"
                : "%s and %s are %.4f m apart, %+.2f %% of what was measured",
            k->in->camera[m->a].name, k->in->camera[m->b].name, d, 100 * off);
    }
}

pvx_err rec_calib_place(struct calib *k)
{
    bool held = false;
    memcpy(k->fit_pose, k->pose, k->nc * sizeof *k->pose);
    for (size_t c = 0; c < k->nc; c++)
        held |= (k->in->camera[c].hold & REC_HOLD_POSE) != 0;
    check_scale(k);
    if (held) /* the world is already that of the old rig */
        return PVX_OK;
    switch (k->in->options.world) {
    case REC_WORLD_FLOOR: return floor_frame(k);
    case REC_WORLD_UP: return by_up(k);
    case REC_WORLD_OLD: return by_old(k);
    default: best_frame(k); return PVX_OK;
    }
}
