#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "base/mem.h"
#include "recon/geom/traverse.h"
#include "recon/view/render.h"
#include "recon/view/room.h"
#include "recon/view/room_int.h"

static const double pi = 3.14159265358979323846;

/* Rows are dealt out in turn to this many tasks; each has its own room for one ray's entries. */
enum { TASKS = 32 };

struct view {
    const rec_room *r;
    const struct rec_camera *c;
    int sub;
    float *image;
    size_t max;
    int32_t *index; /* [TASKS][max] */
    float *value;   /* [TASKS][max] */
};

/* E at a place of a face: bilinear, without the points that a body covers. */
static void room_render_light_at(const rec_room *r, const struct room_hit *at, double out[3])
{
    const struct room_face *f = &r->scene.face[at->face];
    double u = at->a * f->nu, v = at->b * f->nv, x[3], weight = 0;
    int32_t i = (int32_t)fmin(floor(u), f->nu - 1), j = (int32_t)fmin(floor(v), f->nv - 1);
    for (int c = 0; c < 3; c++)
        out[c] = 0;
    for (int k = 0; k < 4; k++) {
        int32_t p = i + (k & 1), q = j + (k >> 1);
        double w = (1 - fabs(u - p)) * (1 - fabs(v - q));
        const float *e = r->light + 3 * room_point(f, p, q, x);
        if (!(w > 0) || e[0] < 0)
            continue;
        weight += w;
        for (int c = 0; c < 3; c++)
            out[c] += w * e[c];
    }
    for (int c = 0; c < 3 && weight > 0; c++)
        out[c] /= weight;
}

/* room.h (1) */
static void room_render_add_ray(const struct view *t, size_t task, double px, double py,
                                double sum[3])
{
    const rec_room *r = t->r;
    double o[3], d[3], enter, leave, e[3];
    struct room_hit hit;
    if (!rec_camera_ray(t->c, px, py, o, d) ||
        !room_scene_ray(&r->scene, o, d, &enter, &leave, &hit))
        return;
    for (int a = 0; a < 3; a++)
        o[a] += enter * d[a];
    int32_t *index = t->index + task * t->max;
    float *value = t->value + task * t->max;
    size_t n = rec_traverse_until(&r->grid, o, d, leave - enter, index, value);
    for (size_t k = 0; k < n; k++) {
        const float *v = r->dense + (size_t)index[k] * (size_t)r->nch;
        for (int c = 0; c < r->nch; c++)
            sum[c] += v[c] > 0 && isfinite(v[c]) ? (double)value[k] * v[c] : 0;
    }
    room_render_light_at(r, &hit, e);
    double albedo = room_albedo(&r->scene.face[hit.face], hit.a, hit.b);
    for (int c = 0; c < r->nch; c++)
        sum[c] += albedo / pi * (e[c] + r->ambient[c]);
}

static void room_render_render_rows(void *ctx, size_t task)
{
    const struct view *t = ctx;
    int32_t w = t->c->width, nch = t->r->nch;
    for (int32_t y = (int32_t)task; y < t->c->height; y += TASKS)
        for (int32_t x = 0; x < w; x++) {
            double sum[3] = {0};
            for (int s = 0; s < t->sub * t->sub; s++)
                room_render_add_ray(t, task, x + (s % t->sub + 0.5) / t->sub - 0.5,
                                    y + (s / t->sub + 0.5) / t->sub - 0.5, sum);
            float *out = t->image + ((size_t)y * (size_t)w + (size_t)x) * (size_t)nch;
            for (int c = 0; c < nch; c++)
                out[c] = (float)fmin(FLT_MAX, sum[c] / (t->sub * t->sub));
        }
}

pvx_err rec_room_render(const rec_room *r, const struct rec_camera *c, int sub, float *image)
{
    if (sub < 1 || sub > REC_RENDER_SUB_MAX || r->dense == NULL)
        return PVX_EINVAL;
    struct view t = {.r = r, .c = c, .sub = sub, .image = image, .max = rec_traverse_max(&r->grid)};
    t.index = pvx_calloc(t.max * TASKS, sizeof *t.index);
    t.value = pvx_calloc(t.max * TASKS, sizeof *t.value);
    pvx_err e = t.index != NULL && t.value != NULL ? PVX_OK : PVX_ENOMEM;
    if (e == PVX_OK)
        pvx_pool_run(r->pool, TASKS, room_render_render_rows, &t);
    free(t.index);
    free(t.value);
    return e;
}
