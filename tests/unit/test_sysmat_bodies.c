/* test_sysmat_bodies.c - what a body hides is not in the matrix, and does not carve. */
#include "base/mem.h"
#include "recon/carve/hull.h"
#include "recon/geom/traverse.h"
#include "tests/lib/body_mesh.h"
#include "tests/lib/centre.h"
#include "tests/lib/ray_entries.h"
#include "tests/t.h"

/* ---- entries --------------------------------------------------------------------------------------- */

static const double box_min[3] = {-0.2, -0.45, 0.3}, box_max[3] = {0.15, 0.1, 0.52};
enum { ROD_X = 1, ROD_Y = 3 };
static const double rod_at[2] = {0.1 * ROD_X, 0.1 * ROD_Y}, rod_r = 0.08, rod_z[2] = {0.2, 0.9};

static void put_bodies(struct rec_rig *r)
{
    r->bodies.body = pvx_calloc(2, sizeof *r->bodies.body);
    r->bodies.n = 2;
    struct rec_body *b = r->bodies.body;
    b[0] = (struct rec_body){.kind = REC_BODY_BOX};
    memcpy(b[0].a, box_min, sizeof box_min);
    memcpy(b[0].b, box_max, sizeof box_max);
    b[1] = (struct rec_body){.kind = REC_BODY_CYLINDER,
                             .a = {rod_at[0], rod_at[1], rod_z[0]},
                             .b = {rod_at[0], rod_at[1], rod_z[1]},
                             .radius = rod_r};
}

/* The nearest of twelve triangles, a circle in the plane and two caps: none of it body.c's. */
static double brute_hit(const double o[3], const double d[3])
{
    double t[12 * 9], first = INFINITY;
    box_mesh(box_min, box_max, t);
    for (int i = 0; i < 12; i++)
        first = fmin(first, plane_hit(t + 9 * (size_t)i, o, d));
    double x = o[0] - rod_at[0], y = o[1] - rod_at[1];
    double a = d[0] * d[0] + d[1] * d[1], b = x * d[0] + y * d[1],
           c = x * x + y * y - rod_r * rod_r;
    double s = b * b >= a * c ? (-b - sqrt(b * b - a * c)) / a : -1;
    if (s >= 0 && o[2] + s * d[2] >= rod_z[0] && o[2] + s * d[2] <= rod_z[1])
        first = fmin(first, s);
    for (int k = 0; k < 2; k++) {
        s = (rod_z[k] - o[2]) / d[2];
        double u = x + s * d[0], v = y + s * d[1];
        if (s >= 0 && u * u + v * v <= rod_r * rod_r)
            first = fmin(first, s);
    }
    return first;
}

struct ray {
    const struct rec_grid *grid;
    int32_t *index;
    float *value;
    int stopped;
};

/* The whole ray, less what it would have met from where it ends on. */
static void add_clipped(void *ctx, const double o[3], const double d[3], double share, double *want)
{
    struct ray *w = ctx;
    double end = brute_hit(o, d), from[3];
    size_t n = rec_traverse(w->grid, o, d, w->index, w->value);
    for (size_t i = 0; i < n; i++)
        want[w->index[i]] += share * w->value[i];
    if (!isfinite(end))
        return;
    w->stopped++;
    for (int a = 0; a < 3; a++)
        from[a] = o[a] + end * d[a];
    n = rec_traverse(w->grid, from, d, w->index, w->value);
    for (size_t i = 0; i < n; i++)
        want[w->index[i]] -= share * w->value[i];
}

static void entries_are_clipped_rays(const struct rec_rig *r, const rec_sysmat *m)
{
    size_t max = rec_traverse_max(&r->grid), hidden;
    struct ray w = {&r->grid, pvx_calloc(max, sizeof *w.index), pvx_calloc(max, sizeof *w.value),
                    0};
    T_LE(entries_against_rays(r, m, add_clipped, &w, 1e-9, &hidden), 1.001 * m->unit);
    T_OK(w.stopped > 80);
    free(w.index);
    free(w.value);
    if (r->grid.basis == REC_BOX && r->grid.n[0] > 12) /* the inside of the box */
        T_OK(hidden > 10);
}

static rec_sysmat *build(const struct rec_rig *r, int32_t binning, int32_t rays)
{
    struct rec_sysmat_params p = {binning, rays};
    struct pvx_diag d = {""};
    rec_sysmat *m = NULL;
    T_EQ_I(rec_sysmat_build(r, &p, NULL, NULL, NULL, &m, &d), PVX_OK);
    if (m == NULL)
        exit(1);
    return m;
}

static void entries(enum rec_basis basis, int32_t voxels, int32_t binning, int32_t rays)
{
    struct rec_rig r;
    T_EQ_I(rec_rig_ring(3, 2, 32, 24, voxels, &r), PVX_OK);
    r.grid.basis = basis;
    put_bodies(&r);
    rec_sysmat *m = build(&r, binning, rays);
    entries_are_clipped_rays(&r, m);
    rec_sysmat_free(&m);
    rec_rig_fini(&r);
}

T_CASE(entries_of_box_end_at_bodies)
{
    entries(REC_BOX, 9, 1, 1);
    entries(REC_BOX, 16, 2, 3);
}
T_CASE(entries_of_trilinear_end_at_bodies)
{
    entries(REC_TRILINEAR, 9, 1, 1);
    entries(REC_TRILINEAR, 11, 2, 2);
}

/* A body that no ray meets changes no bit but the key; none, not even that. */
T_CASE(a_body_around_everything_is_refused)
{
    struct rec_rig r;
    rec_sysmat *S;
    struct pvx_diag d = {""};
    struct rec_body crate = {
        .name = "crate", .kind = REC_BODY_BOX, .a = {-0.9, -0.9, -0.4}, .b = {0.9, 0.9, 1.4}};
    T_OK(rec_rig_ring(4, 2.2, 32, 24, 8, &r) == PVX_OK);
    r.bodies = (struct rec_bodies){1, &crate};
    T_EQ_I(rec_sysmat_build(&r, &rec_sysmat_defaults, NULL, NULL, NULL, &S, &d), PVX_EINVAL);
    T_OK(S == NULL);
    T_CONTAINS(d.text, "'crate'");
    r.bodies = (struct rec_bodies){0};
    rec_rig_fini(&r);
}
T_CASE(no_body_in_the_way_same_bits)
{
    struct rec_rig r, beside;
    T_EQ_I(rec_rig_ring(4, 2, 48, 36, 20, &r), PVX_OK);
    r.grid.basis = REC_TRILINEAR;
    T_EQ_I(rec_rig_copy(&r, &beside), PVX_OK);
    put_bodies(&beside);
    for (size_t i = 0; i < 2; i++)
        for (int a = 0; a < 3; a++) {
            beside.bodies.body[i].a[a] += 50;
            beside.bodies.body[i].b[a] += 50;
        }
    rec_sysmat *a = build(&r, 1, 2), *b = build(&beside, 1, 2);
    T_OK(a->key != b->key);
    for (const rec_sysmat *p = a, *q = b; p != NULL; p = p->coarse, q = q->coarse) {
        size_t windows = rec_grid_count(&p->grid) * (size_t)p->win.slots;
        T_EQ_I(p->nnz, q->nnz);
        T_OK(memcmp(p->win.at, q->win.at, windows * sizeof *p->win.at) == 0);
        T_OK(memcmp(p->win.w, q->win.w, windows * rec_window_size(&p->win)) == 0);
        for (size_t c = 0; c < p->n_cameras; c++)
            T_OK(memcmp(p->block[c].fp, q->block[c].fp,
                        rec_brick_places(&p->grid) * sizeof *p->block[c].fp) == 0);
    }
    rec_sysmat_free(&a);
    rec_sysmat_free(&b);
    rec_rig_fini(&r);
    rec_rig_fini(&beside);
}

/* ---- hull ------------------------------------------------------------------------------------------ */

enum { W = 48, H = 36, CAMERAS = 5 };

struct carving {
    struct rec_rig rig;
    rec_sysmat *S;
    rec_hull *h;
    uint8_t bits[CAMERAS][W * H];
    int32_t *col;
    uint8_t *klass;
};

static void carve_with(struct carving *t, uint32_t min_views)
{
    const uint8_t *lit[CAMERAS];
    bool present[CAMERAS];
    struct rec_hull_params p = {.min_views = min_views, .keep_partial = 1};
    struct rec_hull_kept kept = {.col = t->col, .klass = t->klass};
    for (int c = 0; c < CAMERAS; c++) {
        lit[c] = t->bits[c];
        present[c] = true;
    }
    rec_hull_carve(t->h, &p, lit, present, NULL, &kept);
}

static void carving_new(struct carving *t)
{
    t->S = build(&t->rig, 1, 2);
    T_EQ_I(rec_hull_new(t->S, &t->h), PVX_OK);
    t->col = pvx_calloc(rec_grid_count(&t->rig.grid), sizeof *t->col);
    t->klass = pvx_calloc(rec_grid_count(&t->rig.grid), 1);
}

static void carving_fini(struct carving *t)
{
    rec_hull_free(&t->h);
    rec_sysmat_free(&t->S);
    rec_rig_fini(&t->rig);
    free(t->col);
    free(t->klass);
}

/* A wall halfway from camera c to the voxel. */
static void hide_from(struct rec_rig *r, size_t c, int32_t voxel)
{
    double x[3], from[3];
    struct rec_body *b = &r->bodies.body[r->bodies.n++];
    grid_centre(&r->grid, voxel, x);
    rec_camera_centre(&r->cameras[c], from);
    *b = (struct rec_body){.kind = REC_BODY_CYLINDER, .radius = 0.25};
    for (int a = 0; a < 3; a++) {
        b->a[a] = 0.4 * from[a] + 0.6 * x[a];
        b->b[a] = 0.38 * from[a] + 0.62 * x[a];
    }
}

static void behind_the_rod(enum rec_basis basis)
{
    for (size_t hidden = 0; hidden <= CAMERAS; hidden++) {
        struct carving t = {.h = NULL};
        T_EQ_I(rec_rig_ring(CAMERAS, 2.2, W, H, 15, &t.rig), PVX_OK);
        t.rig.grid.basis = basis;
        t.rig.bodies.body = pvx_calloc(CAMERAS, sizeof *t.rig.bodies.body);
        int32_t voxel = rec_grid_index(&t.rig.grid, 7, 7, 7);
        for (size_t c = 0; c < hidden; c++)
            hide_from(&t.rig, c, voxel);
        carving_new(&t);
        for (size_t c = 0; c < CAMERAS; c++) { /* lit where the voxel is not hidden, else dark */
            memset(t.bits[c], c >= hidden, W * H);
            T_EQ_I(rec_rect_seen(rec_footprint(t.S, c, voxel)), c >= hidden);
        }
        carve_with(&t, 2); /* kept, as long as two cameras see it */
        T_EQ_I(t.klass[voxel] != 0, hidden + 2 <= CAMERAS);
        memset(t.bits[CAMERAS - 1], 0, W * H); /* a camera that sees it still carves it */
        carve_with(&t, 1);
        T_EQ_I(t.klass[voxel], 0);
        carving_fini(&t);
    }
}

T_CASE(a_camera_does_not_carve_what_a_rod_hides_from_it)
{
    behind_the_rod(REC_BOX);
    behind_the_rod(REC_TRILINEAR);
}

/* Bins in which a point of the inside of the voxel's support is seen past the bodies. */
static size_t light_up(const struct rec_rig *r, size_t c, int32_t voxel, uint8_t *lit)
{
    enum { POINTS = 15 };
    const struct rec_camera *cam = &r->cameras[c];
    double x[3], from[3], reach = r->grid.basis == REC_BOX ? 0.5 : 1;
    size_t n = 0;
    grid_centre(&r->grid, voxel, x);
    rec_camera_centre(cam, from);
    for (int i = 0; i < POINTS * POINTS * POINTS; i++) {
        int at[3] = {i % POINTS, i / POINTS % POINTS, i / POINTS / POINTS};
        double X[3], uv[2], d[3], far = 0;
        for (int a = 0; a < 3; a++) {
            X[a] =
                x[a] + 0.999 * rec_grid_h(&r->grid, a) * reach * (2.0 * at[a] / (POINTS - 1) - 1);
            d[a] = X[a] - from[a];
            far += d[a] * d[a];
        }
        for (int a = 0; a < 3; a++)
            d[a] /= sqrt(far);
        if (!rec_camera_sees(cam, X, uv) || rec_body_hit(&r->bodies, from, d) < sqrt(far))
            continue;
        lit[(int)floor(uv[1] + 0.5) * W + (int)floor(uv[0] + 0.5)] = 1;
        n++;
    }
    return n;
}

static void random_bodies(struct rec_rig *r)
{
    r->bodies.body = pvx_calloc(3, sizeof *r->bodies.body);
    for (; r->bodies.n < 3; r->bodies.n++) {
        struct rec_body *b = &r->bodies.body[r->bodies.n];
        b->kind = r->bodies.n == 0 ? REC_BODY_BOX : REC_BODY_CYLINDER;
        b->radius = t_uniform(0.01, 0.15);
        for (int a = 0; a < 3; a++) {
            b->a[a] = t_uniform(-0.5, 0.5) + 0.5 * (a == 2);
            b->b[a] = b->kind == REC_BODY_BOX ? b->a[a] + t_uniform(0.1, 0.8) : t_uniform(-0.5, 1);
        }
    }
}

/* With exact pictures of one voxel's light past the bodies it stays, whoever sees some of it. */
T_CASE(no_light_is_carved_between_bodies)
{
    int shadowed = 0, alone = 0;
    for (int turn = 0; turn < 60; turn++) {
        struct carving t = {.h = NULL};
        T_EQ_I(rec_rig_ring(CAMERAS, 2.2, W, H, 9 + turn % 5, &t.rig), PVX_OK);
        t.rig.grid.basis = turn % 2 == 0 ? REC_BOX : REC_TRILINEAR;
        random_bodies(&t.rig);
        carving_new(&t);
        for (int i = 0; i < 4; i++) {
            int32_t voxel = (int32_t)(t_rand() % rec_grid_count(&t.rig.grid));
            size_t seen = 0;
            for (size_t c = 0; c < CAMERAS; c++) {
                memset(t.bits[c], 0, W * H);
                seen += light_up(&t.rig, c, voxel, t.bits[c]) > 0;
            }
            carve_with(&t, 0);
            if (seen > 0)
                T_OK(t.klass[voxel] != 0);
            shadowed += seen > 0 && seen < CAMERAS;
            alone += seen == 0;
        }
        carving_fini(&t);
    }
    T_OK(shadowed > 20);
    T_OK(alone > 0);
}
