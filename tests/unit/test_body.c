/* Bodies against brute force: small steps along the ray, all triangles of a mesh. */
#include "recon/geom/body.h"
#include "tests/lib/body_mesh.h"
#include "tests/t.h"

/* First hit by walking: what is inside by definition, to within a step. */
static double walk(const struct rec_body *b, const double o[3], const double d[3], double step,
                   double end)
{
    for (double s = 0; s < end; s += step) {
        double x[3] = {o[0] + s * d[0], o[1] + s * d[1], o[2] + s * d[2]};
        if (rec_body_inside(b, x))
            return s;
    }
    return INFINITY;
}

static void random_ray(double o[3], double d[3])
{
    double len = 0;
    for (int a = 0; a < 3; a++) {
        o[a] = t_uniform(-2, 2);
        d[a] = t_uniform(-0.6, 0.6) - o[a];
        len += d[a] * d[a];
    }
    for (int a = 0; a < 3; a++)
        d[a] /= sqrt(len);
}

/* Grazing rays may be missed by the walk: then the chord is short. */
static void against_walk(const struct rec_body *b, int rays, int *hits)
{
    const double step = 1e-3;
    const struct rec_bodies all = {1, (struct rec_body *)b};
    for (int i = 0; i < rays; i++) {
        double o[3], d[3];
        random_ray(o, d);
        double s = rec_body_hit(&all, o, d), w = walk(b, o, d, step, 6);
        *hits += isfinite(s);
        if (isfinite(w))
            T_OK(s <= w + 1e-9 && s >= 0);
        if (isfinite(s)) { /* what is hit is the surface: inside just behind, outside before */
            double before[3], behind[3];
            for (int a = 0; a < 3; a++) {
                before[a] = o[a] + (s - 1e-7) * d[a];
                behind[a] = o[a] + (s + 1e-7) * d[a];
            }
            T_OK(s == 0 || !rec_body_inside(b, before));
            if (isfinite(w))
                T_OK(rec_body_inside(b, behind) || w > s + step);
        }
        if (isfinite(s) && isfinite(w) && w <= s + step)
            T_NEAR(w, s, 1.001 * step);
    }
}

T_CASE(boxes_end_rays_where_a_walk_enters_them)
{
    int hits = 0;
    for (int i = 0; i < 40; i++) {
        struct rec_body b = {.kind = REC_BODY_BOX};
        for (int a = 0; a < 3; a++) {
            b.a[a] = t_uniform(-0.6, 0.3);
            b.b[a] = b.a[a] + t_uniform(0.01, 0.5);
        }
        against_walk(&b, 50, &hits);
    }
    T_OK(hits > 100);
}

T_CASE(cylinders_end_rays_where_a_walk_enters_them)
{
    int hits = 0;
    for (int i = 0; i < 40; i++) {
        struct rec_body b = {.kind = REC_BODY_CYLINDER, .radius = t_uniform(0.02, 0.3)};
        for (int a = 0; a < 3; a++) {
            b.a[a] = t_uniform(-0.6, 0.6);
            b.b[a] = t_uniform(-0.6, 0.6);
        }
        against_walk(&b, 50, &hits);
    }
    T_OK(hits > 100);
}

T_CASE(closed_forms)
{
    struct rec_body two[2] = {
        {.kind = REC_BODY_CYLINDER, .a = {0, 0, -1}, .b = {0, 0, 1}, .radius = 0.25},
        {.kind = REC_BODY_BOX, .a = {-2, -1, -1}, .b = {-1, 1, 1}}};
    struct rec_bodies b = {2, two}, none = {0};
    T_NEAR(rec_body_hit(&b, (double[]){3, 0, 0}, (double[]){-1, 0, 0}), 2.75, 1e-15);
    T_NEAR(rec_body_hit(&b, (double[]){3, 0.15, 0}, (double[]){-1, 0, 0}), 2.8, 1e-15);
    T_NEAR(rec_body_hit(&b, (double[]){3, 0.5, 0}, (double[]){-1, 0, 0}), 4, 1e-15); /* the box */
    T_NEAR(rec_body_hit(&b, (double[]){0.1, 0, 5}, (double[]){0, 0, -1}), 4, 1e-15); /* its cap */
    T_NEAR(rec_body_hit(&b, (double[]){0.1, 0, 0}, (double[]){0, 0, -1}), 0, 0);     /* inside */
    T_OK(isinf(rec_body_hit(&b, (double[]){3, 0, 0}, (double[]){1, 0, 0})));
    T_OK(isinf(rec_body_hit(&b, (double[]){0.26, 0, 5}, (double[]){0, 0, -1})));
    T_OK(isinf(rec_body_hit(&none, (double[]){3, 0, 0}, (double[]){-1, 0, 0})));
}

T_CASE(a_mesh_ends_rays_at_the_nearest_of_all_triangles)
{
    enum { N = 24 };
    size_t n;
    double *t = sphere_mesh(N, 0.5, &n);
    struct rec_mesh *m;
    struct pvx_diag d = {""};
    T_EQ_I(rec_mesh_new(t, n, &m, &d), PVX_OK);
    int hits = 0;
    for (int i = 0; i < 3000; i++) {
        double o[3], dir[3], best = INFINITY;
        random_ray(o, dir);
        for (size_t k = 0; k < n;
             k++) { /* each alone, by another formula: the plane, then its sides */
            double s = plane_hit(t + 9 * k, o, dir);
            best = s < best ? s : best;
        }
        double s = rec_mesh_hit(m, o, dir);
        hits += isfinite(s);
        T_OK(isfinite(s) == isfinite(best));
        if (isfinite(s) && isfinite(best))
            T_NEAR(s, best, 1e-12);
        double r = sqrt(o[0] * o[0] + o[1] * o[1] + o[2] * o[2]);
        if (r < 0.48 || r > 0.5)
            T_EQ_I(rec_mesh_inside(m, o), r < 0.5);
    }
    T_OK(hits > 500);
    rec_mesh_free(&m);
    free(t);
}

T_CASE(no_ray_slips_through_an_edge)
{
    double t[12 * 9];
    struct rec_mesh *m;
    struct pvx_diag d = {""};
    box_mesh((double[]){-1, -1, -1}, (double[]){1, 1, 1}, t);
    T_EQ_I(rec_mesh_new(t, 12, &m, &d), PVX_OK);
    for (int i = -8; i <= 8; i++) /* along the diagonals of the faces */
        T_NEAR(rec_mesh_hit(m, (double[]){3, i / 8.0, i / 8.0}, (double[]){-1, 0, 0}), 2, 1e-9);
    rec_mesh_free(&m);
}

T_CASE(surfaces_that_enclose_nothing_are_refused)
{
    double t[12 * 9];
    struct rec_mesh *m;
    struct pvx_diag d = {""};
    box_mesh((double[]){-1, -1, -1}, (double[]){1, 1, 1}, t);
    T_EQ_I(rec_mesh_new(t, 11, &m, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "not closed");
    T_EQ_I(rec_mesh_new(t, 0, &m, &d), PVX_EINVAL);
    d.text[0] = 0;
    T_EQ_I(rec_mesh_new(t, REC_MESH_MAX + 1, &m, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "simplify");
    d.text[0] = 0;
    t[40] = NAN;
    T_EQ_I(rec_mesh_new(t, 12, &m, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "triangle 5");
}
