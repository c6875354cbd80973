#include "recon/view/room_scene.h"

#include <math.h>
#include <string.h>

/* The part (t0, t1) of the line o + t d inside |x| <= half; false: none, or it only touches.  axis: of the sides
 * by which it enters and leaves. */
static bool room_scene_slab(const double o[3], const double d[3], const double half[3], double t[2],
                            int axis[2])
{
    t[0] = -INFINITY;
    t[1] = INFINITY;
    axis[0] = axis[1] = 0;
    for (int a = 0; a < 3; a++) {
        if (d[a] == 0) {
            if (fabs(o[a]) >= half[a])
                return false;
            continue;
        }
        double per = 1 / d[a], mid = -o[a] * per, reach = half[a] * fabs(per);
        double in = mid - reach, out = mid + reach;
        if (in > t[0]) {
            t[0] = in;
            axis[0] = a;
        }
        if (out < t[1]) {
            t[1] = out;
            axis[1] = a;
        }
    }
    return t[0] < t[1];
}

static void turn(const struct room_body *b, const double v[3], double out[3])
{
    out[0] = b->cosine * v[0] + b->sine * v[1];
    out[1] = b->cosine * v[1] - b->sine * v[0];
    out[2] = v[2];
}

/* To the coordinates of the body, whose middle is 0. */
static void local(const struct room_body *b, const double x[3], double out[3])
{
    double v[3] = {x[0] - b->centre[0], x[1] - b->centre[1], x[2] - b->centre[2]};
    turn(b, v, out);
}

/* ---- the faces -------------------------------------------------------------------------------- */

static void add_face(struct room_scene *s, int body, const double o[3], const double u[3],
                     const double v[3], const double n[3], double spacing)
{
    struct room_face *f = &s->face[s->n_faces++];
    *f = (struct room_face){.body = body, .first = s->n_points, .albedo = {0.5, 0.5}};
    memcpy(f->o, o, sizeof f->o);
    memcpy(f->u, u, sizeof f->u);
    memcpy(f->v, v, sizeof f->v);
    memcpy(f->n, n, sizeof f->n);
    f->nu = (int32_t)ceil(sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]) / spacing);
    f->nv = (int32_t)ceil(sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]) / spacing);
    s->n_points += (size_t)(f->nu + 1) * (size_t)(f->nv + 1);
}

/* Walls 0..5: x min, x max, y min, y max, floor, ceiling. */
static void add_walls(struct room_scene *s, double spacing)
{
    for (int k = 0; k < 6; k++) {
        int a = k / 2, b = (a + 1) % 3, c = (a + 2) % 3;
        double o[3], u[3] = {0}, v[3] = {0}, n[3] = {0};
        memcpy(o, s->min, sizeof o);
        o[a] = k % 2 == 0 ? s->min[a] : s->max[a];
        u[b] = s->max[b] - s->min[b];
        v[c] = s->max[c] - s->min[c];
        n[a] = k % 2 == 0 ? 1 : -1;
        add_face(s, -1, o, u, v, n, k == ROOM_FLOOR ? spacing : 3 * spacing);
    }
    s->face[ROOM_FLOOR].tile = s->size / 4;
    s->face[ROOM_FLOOR].albedo[0] = 0.8;
    s->face[ROOM_FLOOR].albedo[1] = 0.4;
}

/* Adds its sides +x, +y, -x, -y, and the fifth, its top, if there is air above it. */
static void add_body(struct room_scene *s, const struct room_body *b, int sides, double spacing)
{
    int k = s->n_bodies++;
    s->body[k] = *b;
    for (int side = 0; side < sides; side++) {
        int a = side == 4 ? 2 : side % 2, p = (a + 1) % 3, q = (a + 2) % 3;
        double e[3][3] = {{b->cosine, b->sine, 0}, {-b->sine, b->cosine, 0}, {0, 0, 1}};
        double sign = side == 2 || side == 3 ? -1 : 1, o[3], u[3], v[3], n[3];
        for (int i = 0; i < 3; i++) {
            n[i] = sign * e[a][i];
            u[i] = 2 * b->half[p] * e[p][i];
            v[i] = 2 * b->half[q] * e[q][i];
            o[i] = b->centre[i] + n[i] * b->half[a] - u[i] / 2 - v[i] / 2;
        }
        add_face(s, k, o, u, v, n, spacing);
    }
}

void room_scene_init(struct room_scene *s, const double min[3], const double max[3], int32_t points)
{
    *s = (struct room_scene){.n_bodies = 0};
    double e[3], mid[3];
    for (int a = 0; a < 3; a++) {
        e[a] = fmax(max[a] - min[a], 1e-6);
        mid[a] = min[a] + e[a] / 2;
    }
    double size = fmax(e[2], hypot(e[0], e[1]));
    s->size = size;
    for (int a = 0; a < 3; a++) {
        s->min[a] = a < 2 ? mid[a] - 2.25 * size : min[2];
        s->max[a] = a < 2 ? mid[a] + 2.25 * size : min[2] + 2.25 * size;
    }
    double spacing = 4.5 * size / points;
    add_walls(s, spacing);
    /* Between the flame and a camera at +x, a little to the side: it hides half of the flame. */
    struct room_body pillar = {{mid[0] + 0.6 * size, mid[1] + 0.13 * size, min[2] + 1.125 * size},
                               {0.08 * size, 0.08 * size, 1.125 * size},
                               cos(0.35),
                               sin(0.35)};
    struct room_body block = {{mid[0] - 0.5 * size, mid[1] + 0.75 * size, min[2] + 0.15 * size},
                              {0.15 * size, 0.15 * size, 0.15 * size},
                              cos(0.9),
                              sin(0.9)};
    add_body(s, &pillar, 4, spacing);
    add_body(s, &block, 5, spacing);
}

/* ---- rays ------------------------------------------------------------------------------------- */

static double room_scene_along(const double x[3], const double o[3], const double e[3])
{
    double dot = 0, len = 0;
    for (int a = 0; a < 3; a++) {
        dot += (x[a] - o[a]) * e[a];
        len += e[a] * e[a];
    }
    return fmin(1, fmax(0, dot / len));
}

/* Number of the first face of body k on the ray, if it is nearer than *leave, else -1. */
static int meets_body(const struct room_scene *s, int k, const double o[3], const double d[3],
                      double enter, double *leave)
{
    const struct room_body *b = &s->body[k];
    double p[3], q[3], t[2];
    int axis[2], first = 0;
    local(b, o, p);
    turn(b, d, q);
    if (!room_scene_slab(p, q, b->half, t, axis) || t[0] < enter || t[0] >= *leave)
        return -1;
    while (s->face[first].body != k)
        first++;
    int side = axis[0] == 2 ? 4 : axis[0] + (q[axis[0]] > 0 ? 2 : 0);
    if (first + side >= s->n_faces || s->face[first + side].body != k)
        return -1; /* no such side: it stands on the floor, or under the ceiling */
    *leave = t[0];
    return first + side;
}

bool room_scene_ray(const struct room_scene *s, const double o[3], const double d[3], double *enter,
                    double *leave, struct room_hit *hit)
{
    double half[3], p[3], t[2];
    int axis[2];
    for (int a = 0; a < 3; a++) {
        half[a] = (s->max[a] - s->min[a]) / 2;
        p[a] = o[a] - s->min[a] - half[a];
    }
    if (!room_scene_slab(p, d, half, t, axis) || !(t[1] > 0) || !isfinite(t[1]))
        return false;
    *enter = fmax(0, t[0]);
    *leave = t[1];
    int face = 2 * axis[1] + (d[axis[1]] > 0);
    for (int k = 0; k < s->n_bodies; k++) {
        int f = meets_body(s, k, o, d, *enter, leave);
        face = f >= 0 ? f : face;
    }
    double x[3] = {o[0] + *leave * d[0], o[1] + *leave * d[1], o[2] + *leave * d[2]};
    const struct room_face *f = &s->face[face];
    *hit =
        (struct room_hit){face, room_scene_along(x, f->o, f->u), room_scene_along(x, f->o, f->v)};
    return true;
}

bool room_scene_covered(const struct room_scene *s, const double x[3])
{
    for (int k = 0; k < s->n_bodies; k++) {
        const struct room_body *b = &s->body[k];
        double y[3];
        local(b, x, y);
        if (fabs(y[0]) <= b->half[0] && fabs(y[1]) <= b->half[1] && fabs(y[2]) <= b->half[2])
            return true;
    }
    return false;
}

bool room_scene_free(const struct room_scene *s, const double x[3])
{
    for (int a = 0; a < 3; a++)
        if (!(x[a] > s->min[a] && x[a] < s->max[a]))
            return false;
    return !room_scene_covered(s, x);
}

/* Whether part of the way from p (t = 0) to p + d (t = 1) lies in the box; *end: where the last of it ends. */
static bool room_scene_passes(const double p[3], const double d[3], const double half[3],
                              double grown, double *end)
{
    double h[3] = {half[0] + grown, half[1] + grown, half[2] + grown}, t[2];
    int axis[2];
    if (!(h[0] > 0 && h[1] > 0 && h[2] > 0) || !room_scene_slab(p, d, h, t, axis))
        return false;
    *end = fmin(t[1], 1);
    return *end - fmax(t[0], 0) > 1e-9; /* more than touching */
}

enum room_seen room_scene_sees(const struct room_scene *s, int k, const double p[3],
                               const double c[3], double r)
{
    const struct room_body *b = &s->body[k];
    double from[3], to[3], end;
    local(b, p, from);
    local(b, c, to);
    double d[3] = {to[0] - from[0], to[1] - from[1], to[2] - from[2]};
    if (!room_scene_passes(from, d, b->half, r, &end))
        return ROOM_ALL;
    if (r == 0)
        return ROOM_NONE;
    r *= end; /* largest distance of a ray to the ball from q, as far as there is a body */
    if (!room_scene_passes(from, d, b->half, r, &end))
        return ROOM_ALL;
    return room_scene_passes(from, d, b->half, -r, &end) ? ROOM_NONE : ROOM_PART;
}
