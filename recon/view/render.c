#include "recon/view/render.h"

#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/geom/traverse.h"
#include "recon/view/eye.h"

/* Rows are dealt out in turn to this many tasks, so that the bright middle is shared evenly; each
 * task has its own room for one ray's entries. */
enum { TASKS = 32 };

struct view {
    const struct rec_grid *g;
    const float *dense;
    int nch;
    const struct rec_eye *eye;
    struct rec_bundle bundle;
    float *image;
    size_t max;
    int32_t *index; /* [TASKS][max] */
    float *value;   /* [TASKS][max] */
};

void rec_eye_rays(const struct rec_eye *eye, const struct rec_grid *g, struct rec_bundle *out)
{
    rec_bundle_init(out, eye->camera, 1, eye->sub, g);
}

/* Of a sharp camera.  It is not rec_bundle_ray, so that pictures keep their bits. */
static bool eye_sharp(const struct rec_eye *eye, int32_t x, int32_t y, int32_t i, double o[3],
                      double d[3])
{
    return rec_camera_ray(eye->camera, x + (i % eye->sub + 0.5) / eye->sub - 0.5,
                          y + (i / eye->sub + 0.5) / eye->sub - 0.5, o, d);
}

size_t rec_eye_ray(const struct rec_eye *eye, const struct rec_bundle *b, const struct rec_grid *g,
                   const int32_t pixel[2], int32_t i, int32_t *index, float *value)
{
    double o[3], d[3], end = INFINITY;
    if (!(b->reach > 0 ? rec_bundle_ray(b, pixel[0] - 0.5, pixel[1] - 0.5, i, o, d)
                       : eye_sharp(eye, pixel[0], pixel[1], i, o, d)))
        return 0;
    if (eye->bodies != NULL && eye->bodies->n > 0)
        end = rec_body_hit(eye->bodies, o, d);
    return rec_traverse_until(g, o, d, end, index, value);
}

static void render_add_ray(const struct view *v, size_t task, const int32_t pixel[2], int32_t i,
                           double sum[3])
{
    int32_t *index = v->index + task * v->max;
    float *value = v->value + task * v->max;
    size_t n = rec_eye_ray(v->eye, &v->bundle, v->g, pixel, i, index, value);
    for (size_t e = 0; e < n; e++) {
        const float *a = v->dense + (size_t)index[e] * (size_t)v->nch;
        for (int ch = 0; ch < v->nch; ch++)
            sum[ch] += (double)value[e] * a[ch];
    }
}

static void view_render_rows(void *ctx, size_t task)
{
    const struct view *v = ctx;
    const struct rec_camera *c = v->eye->camera;
    int32_t w = c->width;
    int32_t rays = rec_bundle_rays(&v->bundle);
    for (int32_t y = (int32_t)task; y < c->height; y += TASKS)
        for (int32_t x = 0; x < w; x++) {
            double sum[3] = {0};
            for (int32_t i = 0; i < rays; i++)
                render_add_ray(v, task, (const int32_t[2]){x, y}, i, sum);
            float *out = v->image + ((size_t)y * (size_t)w + (size_t)x) * (size_t)v->nch;
            for (int ch = 0; ch < v->nch; ch++)
                out[ch] = (float)(sum[ch] / rays);
        }
}

pvx_err rec_render(const struct rec_grid *g, const float *dense, int nch, const struct rec_eye *eye,
                   pvx_pool *pool, float *image)
{
    if (nch < 1 || nch > 3 || eye->sub < 1 || eye->sub > REC_RENDER_SUB_MAX)
        return PVX_EINVAL;
    struct view v = {
        .g = g, .dense = dense, .nch = nch, .eye = eye, .image = image, .max = rec_traverse_max(g)};
    rec_eye_rays(eye, g, &v.bundle);
    v.index = pvx_calloc(v.max * TASKS, sizeof *v.index);
    v.value = pvx_calloc(v.max * TASKS, sizeof *v.value);
    pvx_err e = v.index != NULL && v.value != NULL ? PVX_OK : PVX_ENOMEM;
    if (e == PVX_OK)
        pvx_pool_run(pool, TASKS, view_render_rows, &v);
    free(v.index);
    free(v.value);
    return e;
}

/* Pose on the circle; K is left alone. */
static void render_place(const struct rec_grid *g, double angle, double elevation,
                         struct rec_camera *out)
{
    double centre[3], reach = 0;
    for (int a = 0; a < 3; a++) {
        double half = (g->max[a] - g->min[a]) / 2;
        centre[a] = g->min[a] + half;
        reach += half * half;
    }
    double distance = 4 * sqrt(reach), ce = cos(elevation), se = sin(elevation);
    double ca = cos(angle), sa = sin(angle);
    double R[9] = {-sa,      ca,       0,    /* right */
                   se * ca,  se * sa,  -ce,  /* down */
                   -ce * ca, -ce * sa, -se}; /* forward */
    memcpy(out->R, R, sizeof R);
    for (int r = 0; r < 3; r++)
        out->t[r] = -(R[3 * r] * centre[0] + R[3 * r + 1] * centre[1] + R[3 * r + 2] * centre[2]);
    out->t[2] += distance; /* the camera stands back along its own axis */
}

void rec_orbit_camera(const struct rec_grid *g, double angle, double elevation, int32_t w,
                      int32_t h, struct rec_camera *out)
{
    elevation = fmax(-1.5, fmin(1.5, elevation));
    *out = (struct rec_camera){
        .width = w, .height = h, .cx = (w - 1) / 2.0, .cy = (h - 1) / 2.0, .gain = {1, 1, 1}};
    snprintf(out->name, sizeof out->name, "orbit");
    double f = INFINITY; /* the largest that keeps every corner in the image at every angle */
    for (int turn = 0; turn < 64; turn++) {
        render_place(g, 2 * 3.14159265358979323846 * turn / 64, elevation, out);
        for (int corner = 0; corner < 8; corner++) {
            double X[3], Y[3];
            for (int a = 0; a < 3; a++)
                X[a] = corner >> a & 1 ? g->max[a] : g->min[a];
            for (int r = 0; r < 3; r++)
                Y[r] = out->R[3 * r] * X[0] + out->R[3 * r + 1] * X[1] + out->R[3 * r + 2] * X[2] +
                       out->t[r];
            f = fmin(f, fmin(0.49 * w * Y[2] / fmax(fabs(Y[0]), 1e-12),
                             0.49 * h * Y[2] / fmax(fabs(Y[1]), 1e-12)));
        }
    }
    render_place(g, angle, elevation, out);
    out->fx = out->fy = f;
}

static void cross(const double a[3], const double b[3], double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3];
}

/* To unit length; false when there is next to none. */
static bool render_normalise(double a[3])
{
    double n = sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
    if (!(n > 1e-9) || !isfinite(n))
        return false;
    for (int i = 0; i < 3; i++)
        a[i] /= n;
    return true;
}

pvx_err rec_look_at_camera(const double eye[3], const double target[3], const double up[3],
                           double fov, int32_t w, int32_t h, struct rec_camera *out)
{
    double forward[3], upward[3], right[3], down[3];
    for (int a = 0; a < 3; a++)
        forward[a] = target[a] - eye[a];
    memcpy(upward, up, sizeof upward);
    if (w < 1 || h < 1 || !(fov > 0 && fov < 3.14159) || !render_normalise(forward) ||
        !render_normalise(upward))
        return PVX_EINVAL;
    cross(forward, upward, right);
    if (!render_normalise(right))
        return PVX_EINVAL;
    cross(forward, right, down);
    *out = (struct rec_camera){
        .width = w, .height = h, .cx = (w - 1) / 2.0, .cy = (h - 1) / 2.0, .gain = {1, 1, 1}};
    snprintf(out->name, sizeof out->name, "eye");
    out->fx = out->fy = 0.5 * h / tan(fov / 2);
    for (int a = 0; a < 3; a++) {
        out->R[a] = right[a];
        out->R[3 + a] = down[a];
        out->R[6 + a] = forward[a];
    }
    for (int r = 0; r < 3; r++)
        out->t[r] =
            -(out->R[3 * r] * eye[0] + out->R[3 * r + 1] * eye[1] + out->R[3 * r + 2] * eye[2]);
    return PVX_OK;
}
