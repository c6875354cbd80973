#include "recon/geom/body.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"

static double body_dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static double box_hit(const struct rec_body *b, const double o[3], const double d[3])
{
    double s0 = 0, s1 = INFINITY;
    for (int a = 0; a < 3; a++) {
        if (d[a] == 0) {
            if (o[a] < b->a[a] || o[a] > b->b[a])
                return INFINITY;
            continue;
        }
        double u = (b->a[a] - o[a]) / d[a], v = (b->b[a] - o[a]) / d[a];
        s0 = fmax(s0, fmin(u, v));
        s1 = fmin(s1, fmax(u, v));
    }
    return s0 <= s1 ? s0 : INFINITY;
}

/* A cylinder is the intersection of a slab along its axis and an endless tube: two intervals of the ray. */
static double cylinder_hit(const struct rec_body *b, const double o[3], const double d[3])
{
    double axis[3], from[3], s0 = 0, s1 = INFINITY;
    for (int a = 0; a < 3; a++) {
        axis[a] = b->b[a] - b->a[a];
        from[a] = o[a] - b->a[a];
    }
    double length = sqrt(body_dot(axis, axis));
    for (int a = 0; a < 3; a++)
        axis[a] /= length;
    double z = body_dot(from, axis), dz = body_dot(d, axis);
    if (dz != 0) {
        s0 = fmax(s0, fmin(-z / dz, (length - z) / dz));
        s1 = fmin(s1, fmax(-z / dz, (length - z) / dz));
    } else if (z < 0 || z > length) {
        return INFINITY;
    }
    double across[3], to[3]; /* across the axis: direction, origin */
    for (int a = 0; a < 3; a++) {
        across[a] = d[a] - dz * axis[a];
        to[a] = from[a] - z * axis[a];
    }
    double A = body_dot(across, across), r2 = b->radius * b->radius;
    if (A < 1e-24) /* the ray is parallel to the axis */
        return body_dot(to, to) <= r2 && s0 <= s1 ? s0 : INFINITY;
    /* Start from the nearest point to the axis: exact from far away, where b^2 - a c cancels. */
    double middle = -body_dot(to, across) / A, near2 = 0;
    for (int a = 0; a < 3; a++) {
        double p = to[a] + middle * across[a];
        near2 += p * p;
    }
    if (near2 > r2)
        return INFINITY;
    double half = sqrt((r2 - near2) / A);
    s0 = fmax(s0, middle - half);
    s1 = fmin(s1, middle + half);
    return s0 <= s1 ? s0 : INFINITY;
}

static double body_hit(const struct rec_body *b, const double o[3], const double d[3])
{
    switch (b->kind) {
    case REC_BODY_BOX: return box_hit(b, o, d);
    case REC_BODY_CYLINDER: return cylinder_hit(b, o, d);
    default: return rec_mesh_hit(b->mesh, o, d);
    }
}

double rec_body_hit(const struct rec_bodies *b, const double origin[3], const double dir[3])
{
    double first = INFINITY;
    for (size_t i = 0; i < b->n; i++)
        first = fmin(first, body_hit(&b->body[i], origin, dir));
    return first;
}

static bool in_cylinder(const struct rec_body *b, const double x[3])
{
    double axis[3], from[3], r2 = 0;
    for (int a = 0; a < 3; a++) {
        axis[a] = b->b[a] - b->a[a];
        from[a] = x[a] - b->a[a];
    }
    double t = body_dot(from, axis) / body_dot(axis, axis);
    for (int a = 0; a < 3; a++) {
        double p = from[a] - t * axis[a];
        r2 += p * p;
    }
    return t >= 0 && t <= 1 && r2 <= b->radius * b->radius;
}

bool rec_body_inside(const struct rec_body *b, const double x[3])
{
    if (b->kind == REC_BODY_MESH)
        return rec_mesh_inside(b->mesh, x);
    if (b->kind == REC_BODY_CYLINDER)
        return in_cylinder(b, x);
    for (int a = 0; a < 3; a++)
        if (x[a] < b->a[a] || x[a] > b->b[a])
            return false;
    return true;
}

pvx_err rec_bodies_copy(const struct rec_bodies *b, struct rec_bodies *out)
{
    *out = (struct rec_bodies){0};
    if (b->n == 0)
        return PVX_OK;
    out->body = pvx_calloc(b->n, sizeof *out->body);
    if (out->body == NULL)
        return PVX_ENOMEM;
    memcpy(out->body, b->body, b->n * sizeof *b->body);
    out->n = b->n;
    for (size_t i = 0; i < b->n; i++)
        if (b->body[i].kind == REC_BODY_MESH)
            out->body[i].mesh = rec_mesh_share(b->body[i].mesh);
    return PVX_OK;
}

void rec_bodies_fini(struct rec_bodies *b)
{
    for (size_t i = 0; i < b->n; i++)
        rec_mesh_free(&b->body[i].mesh);
    PVX_FREE(b->body);
    b->n = 0;
}
