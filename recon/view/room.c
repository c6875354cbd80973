#include "recon/view/room.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>

#include "base/mem.h"
#include "recon/view/render.h"
#include "recon/view/room_int.h"
#include "recon/view/room_lamps.h"

enum { POINTS = 256 /* along the floor */ };

pvx_err rec_room_new(const double min[3], const double max[3], pvx_pool *pool, rec_room **out)
{
    *out = NULL;
    double most = 0;
    for (int a = 0; a < 3; a++) {
        if (!(isfinite(min[a]) && isfinite(max[a]) && max[a] > min[a]))
            return PVX_EINVAL;
        most = fmax(most, max[a] - min[a]);
    }
    if (!isnormal(most * most * most))
        return PVX_EINVAL;
    rec_room *r = pvx_calloc(1, sizeof *r);
    PVX_NEED(r);
    r->pool = pool;
    room_scene_init(&r->scene, min, max, POINTS);
    r->light = pvx_calloc(r->scene.n_points * 3, sizeof *r->light);
    if (r->light == NULL) {
        rec_room_free(&r);
        return PVX_ENOMEM;
    }
    *out = r;
    return PVX_OK;
}

void rec_room_free(rec_room **r)
{
    if (*r == NULL)
        return;
    free((*r)->light);
    PVX_FREE(*r);
}

double room_albedo(const struct room_face *f, double a, double b)
{
    if (!(f->tile > 0))
        return f->albedo[0];
    /* chequers are counted from the middle, where the flame is */
    double u = (a - 0.5) * sqrt(f->u[0] * f->u[0] + f->u[1] * f->u[1] + f->u[2] * f->u[2]);
    double v = (b - 0.5) * sqrt(f->v[0] * f->v[0] + f->v[1] * f->v[1] + f->v[2] * f->v[2]);
    bool odd = fmod(fabs(floor(u / f->tile) + floor(v / f->tile)), 2) != 0;
    return f->albedo[odd];
}

double room_point_area(const struct room_face *f, int32_t i, int32_t j)
{
    double u = 0, v = 0;
    for (int a = 0; a < 3; a++) {
        u += f->u[a] * f->u[a];
        v += f->v[a] * f->v[a];
    }
    double edge = (i == 0 || i == f->nu ? 0.5 : 1) * (j == 0 || j == f->nv ? 0.5 : 1);
    return edge * sqrt(u * v) / f->nu / f->nv;
}

/* ---- the light -------------------------------------------------------------------------------- */

struct shine {
    rec_room *r;
    const struct room_lamps *l;
};

/* Row `task` of all faces' points. */
static void shine_row(void *ctx, size_t task)
{
    const struct shine *t = ctx;
    const struct room_scene *s = &t->r->scene;
    const struct room_face *f = s->face;
    while (task > (size_t)f->nv) {
        task -= (size_t)f->nv + 1;
        f++;
    }
    for (int32_t i = 0; i <= f->nu; i++) {
        double x[3], e[3];
        float *out = t->r->light + 3 * room_point(f, i, (int32_t)task, x);
        bool covered = f->body < 0 && room_scene_covered(s, x);
        if (!covered)
            room_lamps_shine(t->l, s, x, f->n, f->body, e);
        for (int c = 0; c < 3; c++)
            out[c] = covered ? -1 : (float)fmin(FLT_MAX, e[c]);
    }
}

/* room.h (2) */
static void room_spread(rec_room *r)
{
    double sent[3] = {0}, albedo = 0, area = 0;
    for (int k = 0; k < r->scene.n_faces; k++) {
        const struct room_face *f = &r->scene.face[k];
        double mean = f->tile > 0 ? (f->albedo[0] + f->albedo[1]) / 2 : f->albedo[0];
        for (int32_t j = 0; j <= f->nv; j++)
            for (int32_t i = 0; i <= f->nu; i++) {
                double x[3], part = room_point_area(f, i, j);
                const float *e = r->light + 3 * room_point(f, i, j, x);
                if (e[0] < 0)
                    continue;
                area += part;
                albedo += part * mean;
                for (int c = 0; c < 3; c++)
                    sent[c] += part * mean * e[c];
            }
    }
    for (int c = 0; c < 3; c++)
        r->ambient[c] = sent[c] / area / (1 - albedo / area);
}

pvx_err rec_room_light(rec_room *r, const struct rec_grid *g, const float *dense, int nch)
{
    r->dense = NULL;
    if (nch != 1 && nch != 3)
        return PVX_EINVAL;
    struct room_lamps l;
    PVX_TRY(room_lamps_init(&l, &r->scene, g, dense, nch));
    struct shine t = {r, &l};
    size_t rows = 0;
    for (int k = 0; k < r->scene.n_faces; k++)
        rows += (size_t)r->scene.face[k].nv + 1;
    pvx_pool_run(r->pool, rows, shine_row, &t);
    room_lamps_fini(&l);
    room_spread(r);
    r->grid = *g;
    r->dense = dense;
    r->nch = nch;
    return PVX_OK;
}

/* ---- the view --------------------------------------------------------------------------------- */

void rec_room_camera(const rec_room *r, double angle, double elevation, int32_t w, int32_t h,
                     struct rec_camera *out)
{
    const struct room_scene *s = &r->scene;
    double far = 2.15 * s->size, up[3] = {0, 0, 1}, eye[3], at[3];
    elevation = fmax(-1.5, fmin(1.5, elevation));
    for (int a = 0; a < 2; a++)
        at[a] = (s->min[a] + s->max[a]) / 2;
    at[2] = s->min[2] + 0.36 * s->size;
    eye[0] = at[0] + far * cos(elevation) * cos(angle);
    eye[1] = at[1] + far * cos(elevation) * sin(angle);
    eye[2] = at[2] + far * sin(elevation);
    double half = 0.45 * fmax(1, (double)h / w); /* tall pictures get the same sides */
    if (rec_look_at_camera(eye, at, up, 2 * atan(half), w, h, out) != PVX_OK)
        *out = (struct rec_camera){.width = w, .height = h}; /* the size is out of range */
}
