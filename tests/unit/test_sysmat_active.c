/* A part of S (active.h) against the whole: the same columns, footprints, hulls and volumes, bit for bit, and no memory
 * for the rest. */
#include "recon/matrix/active.h"

#include <sys/mman.h>

#include "recon/carve/hull_bricks.h"
#include "tests/lib/scene.h"

#define PAGE 4096

/* A rig whose sides are nobody's multiples. */
struct bed {
    struct rec_rig rig;
    pvx_pool *pool;
    struct rec_sysmat_params p;
    rec_sysmat *whole, *outline;
};

static struct bed bed_new(int32_t across, enum rec_basis basis, int32_t rays, const int32_t n[3])
{
    struct bed b = {.p = {1, rays}};
    T_EQ_I(rec_rig_ring(5, 2, across, across * 3 / 4 + 1, n[0], &b.rig), PVX_OK);
    b.rig.cameras[4].width = 62; /* and another size */
    b.rig.cameras[4].height = 34;
    b.rig.cameras[1].dist[0] = -0.2;
    memcpy(b.rig.grid.n, n, sizeof b.rig.grid.n);
    b.rig.grid.basis = basis;
    if (pvx_pool_new(3, "t", &b.pool) != PVX_OK)
        exit(2);
    return b;
}
static void bed_build(struct bed *b)
{
    struct pvx_diag d = {""};
    T_EQ_I(rec_sysmat_build(&b->rig, &b->p, b->pool, NULL, NULL, &b->whole, &d), PVX_OK);
    T_EQ_I(rec_sysmat_outline(&b->rig, &b->p, b->pool, (struct rec_progress){0}, &b->outline, &d),
           PVX_OK);
    T_EQ_S(d.text, "");
    if (b->whole == NULL || b->outline == NULL)
        exit(2);
}
static void bed_free(struct bed *b)
{
    rec_sysmat_free(&b->whole);
    rec_sysmat_free(&b->outline);
    rec_rig_fini(&b->rig);
    pvx_pool_free(&b->pool);
}

static rec_sysmat *part_of(struct bed *b, pvx_pool *pool)
{
    rec_sysmat *m = NULL;
    struct pvx_diag d = {""};
    T_EQ_I(rec_sysmat_build_active(&b->rig, &b->outline, pool, (struct rec_progress){0}, &m, &d),
           PVX_OK);
    T_EQ_S(d.text, "");
    T_OK(b->outline == NULL);
    if (m == NULL)
        exit(2);
    return m;
}

/* Marks the bricks of a ball low in the box, a seventh of it across. */
static void mark_low(rec_sysmat *outline)
{
    const struct rec_grid *g = &outline->grid;
    int32_t nx = rec_bricks(g, 0), ny = rec_bricks(g, 1), nz = rec_bricks(g, 2);
    for (int32_t i = 0; i < (int32_t)outline->active->bricks; i++) {
        double x = (i % nx + 0.5) / nx - 0.5, y = (i / nx % ny + 0.5) / ny - 0.5;
        double z = (i / nx / ny + 0.5) / nz - 0.2;
        outline->active->brick[i] = x * x + y * y + z * z < 0.07 * 0.07;
    }
}

/* Marks some bricks; each is kept with that probability. */
static void mark(rec_sysmat *outline, double density)
{
    for (size_t i = 0; i < outline->active->bricks; i++)
        outline->active->brick[i] = t_uniform(0, 1) < density;
}

static bool kept(const rec_sysmat *part, int32_t voxel)
{
    int32_t v[3];
    if (part->active == NULL)
        return true;
    rec_grid_ijk(&part->grid, voxel, v);
    return part->active->brick[rec_brick_place(&part->grid, v[0], v[1], v[2]) / REC_BRICK_VOXELS] !=
           0;
}

/* Columns of the level that are kept and differ; *n those kept. */
static size_t columns_differ(const rec_sysmat *whole, const rec_sysmat *part, size_t *n)
{
    const struct rec_windows *a = &whole->win, *b = &part->win;
    size_t wrong = a->high != b->high || a->wide != b->wide || a->slots != b->slots ||
                   a->nowhere != b->nowhere || a->room != b->room || a->unit != b->unit,
           slots = (size_t)a->slots, bytes = slots * rec_window_size(a);
    for (int32_t q = 0; q < (int32_t)rec_grid_count(&whole->grid) && wrong == 0; q++) {
        if (!kept(part, q))
            continue;
        ++*n;
        wrong += memcmp(a->at + (size_t)q * slots, b->at + (size_t)q * slots,
                        slots * sizeof *a->at) != 0 ||
                 memcmp(a->w + (size_t)q * bytes, b->w + (size_t)q * bytes, bytes) != 0;
    }
    return wrong;
}
static size_t more_differ(const rec_sysmat *whole, const rec_sysmat *part)
{
    size_t at = 0, wrong = 0;
    for (size_t i = 0; i < whole->win.n_more; i++) {
        const struct rec_more *k = &whole->win.more[i];
        if (!kept(part, (int32_t)k->column))
            continue;
        wrong += at >= part->win.n_more || memcmp(k, &part->win.more[at], sizeof *k) != 0;
        at++;
    }
    return wrong + (at != part->win.n_more);
}
static size_t footprints_differ(const rec_sysmat *whole, const rec_sysmat *part)
{
    size_t wrong = 0;
    for (size_t c = 0; c < whole->n_cameras; c++)
        for (int32_t q = 0; q < (int32_t)rec_grid_count(&whole->grid); q++) {
            struct rec_rect r = rec_footprint(whole, c, q), s = rec_footprint(part, c, q);
            wrong += kept(part, q) && memcmp(&r, &s, sizeof r) != 0;
        }
    return wrong;
}

/* All levels of what is kept. */
static void same_where_kept(const rec_sysmat *whole, const rec_sysmat *part)
{
    size_t level = 0, n = 0;
    for (; whole != NULL && part != NULL; whole = whole->coarse, part = part->coarse, level++) {
        T_EQ_I(memcmp(&whole->grid, &part->grid, sizeof whole->grid), 0);
        T_EQ_I(columns_differ(whole, part, &n), 0);
        T_EQ_I(more_differ(whole, part), 0);
        T_EQ_I(footprints_differ(whole, part), 0);
        T_OK(n > 100);
        T_EQ_I(part->active == NULL, part->coarse == NULL); /* the coarsest is whole */
    }
    T_OK(whole == NULL && part == NULL);
    T_LE(3, level);
}

static const int32_t odd[3] = {67, 49, 71};

T_CASE(kept_columns_are_those_of_the_whole)
{
    static const struct {
        int32_t across;
        enum rec_basis basis;
        int32_t rays;
        double density;
        int32_t wide; /* windows: those of four are put at one place in pairs */
    } of[] = {{170, REC_TRILINEAR, 2, 0.45, 4},
              {75, REC_BOX, 1, 0.3, 2},
              {75, REC_BOX, 2, 0.02, 2},
              {75, REC_TRILINEAR, 1, 1, 2}};
    for (size_t i = 0; i < sizeof of / sizeof *of; i++) {
        struct bed b = bed_new(of[i].across, of[i].basis, of[i].rays, odd);
        bed_build(&b);
        mark(b.outline, of[i].density);
        rec_sysmat *part = part_of(&b, b.pool);
        T_EQ_I(b.whole->win.wide, of[i].wide);
        same_where_kept(b.whole, part);
        if (of[i].density == 1)
            T_EQ_I(part->nnz, b.whole->nnz);
        else
            T_OK(part->nnz < b.whole->nnz / 8 * 5);
        rec_sysmat_free(&part);
        bed_free(&b);
    }
}

/* One camera in the middle, one that sees bodies: footprints there are not known from the lens alone. */
static void put_in_the_way(struct rec_rig *r)
{
    static const double to[3] = {0.3, 0.2, 0.1};
    const struct rec_grid *g = &r->grid;
    const double at[3] = {0.5 * (g->min[0] + g->max[0]), 0.5 * (g->min[1] + g->max[1]),
                          0.5 * (g->min[2] + g->max[2])};
    rec_camera_look(at, to, &r->cameras[2]);
    r->bodies.body = pvx_calloc(1, sizeof *r->bodies.body);
    r->bodies.n = 1;
    r->bodies.body[0] = (struct rec_body){.kind = REC_BODY_CYLINDER,
                                          .a = {0.25, 0, g->min[2]},
                                          .b = {0.25, 0, g->max[2]},
                                          .radius = 0.07};
}

T_CASE(behind_bodies_and_cameras)
{
    struct bed b = bed_new(75, REC_TRILINEAR, 2, (int32_t[3]){40, 36, 36});
    put_in_the_way(&b.rig);
    bed_build(&b);
    mark(b.outline, 0.3);
    rec_sysmat *part = part_of(&b, b.pool);
    size_t n = 0;
    for (const rec_sysmat *w = b.whole, *p = part; w != NULL; w = w->coarse, p = p->coarse) {
        T_EQ_I(columns_differ(w, p, &n), 0);
        T_EQ_I(more_differ(w, p), 0);
        T_EQ_I(footprints_differ(w, p), 0);
    }
    T_OK(n > 1000);
    rec_sysmat_free(&part);
    bed_free(&b);
}

T_CASE_OF_THREADS(same_bits_for_any_number_of_threads)
{
    struct bed b = bed_new(75, REC_TRILINEAR, 2, (int32_t[3]){40, 33, 37});
    bed_build(&b);
    uint8_t *marks = pvx_calloc(b.outline->active->bricks, 1);
    mark(b.outline, 0.3);
    memcpy(marks, b.outline->active->brick, b.outline->active->bricks);
    rec_sysmat *three = part_of(&b, b.pool);
    T_EQ_I(rec_sysmat_outline(&b.rig, &b.p, NULL, (struct rec_progress){0}, &b.outline, NULL),
           PVX_OK);
    memcpy(b.outline->active->brick, marks, b.outline->active->bricks);
    rec_sysmat *one = part_of(&b, NULL);
    T_EQ_I(one->nnz, three->nnz);
    size_t n = 0;
    for (const rec_sysmat *p = one, *q = three; p != NULL; p = p->coarse, q = q->coarse) {
        T_EQ_I(columns_differ(p, q, &n), 0);
        T_EQ_I(more_differ(p, q), 0);
        T_EQ_I(footprints_differ(p, q), 0);
    }
    free(marks);
    rec_sysmat_free(&one);
    rec_sysmat_free(&three);
    bed_free(&b);
}

/* The union of a brick's footprints; unknown when one is not seen and another is. */
static struct rec_rect union_of(const rec_sysmat *m, size_t c, size_t brick)
{
    const struct rec_rect *fp = m->block[c].fp + brick * REC_BRICK_VOXELS;
    int32_t nx = rec_bricks(&m->grid, 0), ny = rec_bricks(&m->grid, 1);
    struct rec_rect u = {UINT16_MAX, UINT16_MAX, 0, 0};
    int seen = 0, unseen = 0;
    for (int32_t o = 0; o < REC_BRICK_VOXELS; o++) {
        int32_t i = (int32_t)brick % nx * REC_BRICK + o % REC_BRICK;
        int32_t j = (int32_t)brick / nx % ny * REC_BRICK + o / REC_BRICK % REC_BRICK;
        int32_t k = (int32_t)brick / nx / ny * REC_BRICK + o / REC_BRICK / REC_BRICK;
        if (i >= m->grid.n[0] || j >= m->grid.n[1] || k >= m->grid.n[2])
            continue;
        if (!rec_rect_seen(fp[o])) {
            unseen++;
            continue;
        }
        seen++;
        u.x0 = fp[o].x0 < u.x0 ? fp[o].x0 : u.x0;
        u.y0 = fp[o].y0 < u.y0 ? fp[o].y0 : u.y0;
        u.x1 = fp[o].x1 > u.x1 ? fp[o].x1 : u.x1;
        u.y1 = fp[o].y1 > u.y1 ? fp[o].y1 : u.y1;
    }
    return seen == 0 ? (struct rec_rect){1, 1, 0, 0} : unseen > 0 ? REC_RECT_UNKNOWN : u;
}

static double area(struct rec_rect r)
{
    return (double)(r.x1 - r.x0 + 1) * (r.y1 - r.y0 + 1);
}

/* Of all bricks in all cameras: those that say less than their voxels, or other things; unions known; more unknown. */
struct held {
    size_t all, wrong, unknown, none, more_unknown;
    double larger, unions; /* areas of those that both know */
};
static struct held hold_voxels(enum rec_basis basis, bool in_the_way)
{
    struct held h = {0};
    struct bed b = bed_new(75, basis, 2, odd);
    b.rig.cameras[3].fx *= 2; /* does not see all */
    b.rig.cameras[3].fy *= 2;
    if (in_the_way)
        put_in_the_way(&b.rig);
    bed_build(&b);
    for (size_t c = 0; c < b.rig.n_cameras; c++)
        for (size_t i = 0; i < b.outline->active->bricks; i++, h.all++) {
            struct rec_rect u = union_of(b.whole, c, i), r = b.outline->active->rect[c][i];
            h.unknown += rec_rect_unknown(u);
            h.none += !rec_rect_seen(u) && !rec_rect_unknown(u);
            if (rec_rect_unknown(r)) {
                h.more_unknown += !rec_rect_unknown(u);
            } else if (!rec_rect_seen(r)) {
                h.wrong += rec_rect_seen(u) || rec_rect_unknown(u);
            } else {
                h.wrong +=
                    !rec_rect_seen(u) || r.x0 > u.x0 || r.y0 > u.y0 || r.x1 < u.x1 || r.y1 < u.y1;
                h.larger += area(r);
                h.unions += area(u);
            }
        }
    bed_free(&b);
    return h;
}

/* And not much more: a bin where a lens bends a brick's outline, unknown where a brick goes beyond the image and each
 * of its voxels is in it. */
T_CASE(bricks_hold_their_voxels_and_little_more)
{
    for (int basis = REC_BOX; basis <= REC_TRILINEAR; basis++) {
        struct held h = hold_voxels((enum rec_basis)basis, false);
        T_EQ_I(h.wrong, 0);
        T_OK(h.unknown > 0 && h.none > 0 && h.unknown + h.none < h.all / 2);
        T_LE(h.larger / h.unions, 1.05);
        T_LE((double)h.more_unknown / (double)h.all, 0.03);
        h = hold_voxels((enum rec_basis)basis, true);
        T_EQ_I(h.wrong, 0);
        T_OK(h.larger > 0 && h.unknown > 0);
    }
}

/* What of an array is in memory. */
static size_t resident(const void *p, size_t bytes)
{
    size_t pages = (bytes + PAGE - 1) / PAGE, n = 0;
    unsigned char *in = pvx_calloc(pages, 1);
    T_EQ_I(mincore((void *)p, pages * PAGE, in), 0);
    for (size_t i = 0; i < pages; i++)
        n += in[i] & 1;
    free(in);
    return n * PAGE;
}

T_CASE(the_rest_has_no_memory)
{
    struct bed b = bed_new(75, REC_BOX, 1, (int32_t[3]){128, 128, 96});
    T_EQ_I(rec_sysmat_outline(&b.rig, &b.p, b.pool, (struct rec_progress){0}, &b.outline, NULL),
           PVX_OK);
    b.outline->active->brick[b.outline->active->bricks / 2] = 1;
    rec_sysmat *m = part_of(&b, b.pool);
    size_t N = rec_grid_count(&m->grid), slots = (size_t)m->win.slots;
    T_EQ_I(m->active->columns, REC_BRICK_VOXELS);
    /* 16 rows of voxels, each on a page or two, and the end of w; 40 MB otherwise */
    T_LE(resident(m->win.w, N * slots * rec_window_size(&m->win)), 33 * PAGE);
    T_LE(resident(m->win.at, N * slots * sizeof *m->win.at), 32 * PAGE);
    T_LE(resident(m->block[0].fp, N * sizeof(struct rec_rect)), PAGE);
    T_LE(1, resident(m->win.w, N * slots * rec_window_size(&m->win)));
    rec_sysmat_free(&m);
    bed_free(&b);
}

/* Entries of all levels. */
static double all_entries(const rec_sysmat *m)
{
    double n = 0;
    for (; m != NULL; m = m->coarse)
        n += (double)m->nnz;
    return n;
}
/* Bytes in memory of all levels' windows and footprints. */
static double all_resident(const rec_sysmat *m)
{
    double n = 0;
    for (; m != NULL; m = m->coarse) {
        size_t N = rec_grid_count(&m->grid), slots = (size_t)m->win.slots;
        n += (double)m->win.n_more * sizeof *m->win.more;
        if (m->active == NULL) {
            n += (double)(N * slots) * (double)(sizeof *m->win.at + rec_window_size(&m->win));
            n += (double)(rec_brick_places(&m->grid) * sizeof(struct rec_rect) * m->n_cameras);
            continue;
        }
        n += (double)resident(m->win.w, N * slots * rec_window_size(&m->win));
        n += (double)resident(m->win.at, N * slots * sizeof *m->win.at);
        for (size_t c = 0; c < m->n_cameras; c++)
            n += (double)resident(m->block[c].fp, rec_brick_places(&m->grid) * 8);
    }
    return n;
}

T_CASE(an_estimate_is_what_it_becomes)
{
    struct bed b = bed_new(170, REC_TRILINEAR, 2, odd);
    struct rec_active_estimate all, share;
    const struct rec_progress quiet = {0};
    struct pvx_diag d = {""};
    bed_build(&b);
    mark(b.outline, 0.2);
    T_EQ_I(rec_sysmat_estimate_active(&b.rig, b.outline, 1, b.pool, quiet, &all, &d), PVX_OK);
    T_EQ_I(rec_sysmat_estimate_active(&b.rig, b.outline, 0.2, b.pool, quiet, &share, &d), PVX_OK);
    T_EQ_S(d.text, "");
    rec_sysmat *part = part_of(&b, b.pool);
    T_NEAR(all.entries, (double)b.whole->nnz, 0.5);
    T_NEAR(all.kept, all_entries(part), 0.5);
    T_EQ_I(all.columns, part->active->columns);
    T_NEAR(share.entries / all.entries, 1, 0.1);
    T_NEAR(share.kept / all.kept, 1, 0.1);
    T_OK(all.seconds > 0 && share.seconds > 0);
    /* a bound, and one that says something */
    T_LE(all_resident(part), (double)all.stored);
    T_LE((double)all.stored, 2 * all_resident(part));
    T_OK(all.building > all.stored);
    rec_sysmat_free(&part);
    bed_free(&b);
}

/* Few rows of a large picture see it. */
T_CASE(a_small_flame_is_not_missed)
{
    struct bed b = bed_new(300, REC_BOX, 1, odd);
    struct rec_active_estimate e;
    struct pvx_diag d = {""};
    bed_build(&b);
    mark_low(b.outline);
    T_EQ_I(rec_sysmat_estimate_active(&b.rig, b.outline, 0.01, b.pool, (struct rec_progress){0}, &e,
                                      &d),
           PVX_OK);
    rec_sysmat *part = part_of(&b, b.pool);
    T_LE(e.share, 0.5);
    T_NEAR(e.kept / all_entries(part), 1, 0.3);
    T_LE(all_resident(part), (double)e.stored);
    rec_sysmat_free(&part);
    bed_free(&b);
}

/* ---- with pictures ---- */

static bool stop_at_half(void *ctx, double done)
{
    (void)ctx;
    return done < 0.5;
}

T_CASE_OF_THREADS(a_stop_leaves_nothing)
{
    struct bed b = bed_new(75, REC_BOX, 1, odd);
    struct pvx_diag d = {""};
    rec_sysmat *m;
    T_EQ_I(rec_sysmat_outline(&b.rig, &b.p, b.pool, (struct rec_progress){0}, &b.outline, NULL),
           PVX_OK);
    T_EQ_I(rec_sysmat_build_active(&b.rig, &b.outline, b.pool,
                                   (struct rec_progress){stop_at_half, NULL}, &m, &d),
           PVX_ECANCELED);
    T_CONTAINS(d.text, "stopped");
    T_OK(m == NULL && b.outline == NULL);
    bed_free(&b);
}

/* A slot of S, without the vote: its hull has no part in what is compared here. */
static rec_frame *slot_of(const struct scene *s, const rec_sysmat *S)
{
    struct rec_frame_params p = rec_frame_defaults;
    rec_frame *f = NULL;
    if (rec_frame_alone(S, &s->rig, &p, s->pool, &f, NULL) != PVX_OK)
        exit(2);
    return f;
}
/* Carves the scene as it is, with the same noise each time. */
static void shoot(const struct scene *s, rec_frame *f)
{
    t_state = 77;
    scene_shoot(s, f, 0.01);
    rec_frame_carve(f);
}

/* A set's own silhouettes, as it has them once carved. */
static void mark_by(const struct scene *s, const rec_frame *f, rec_sysmat *outline)
{
    const struct rec_hull_params p = REC_HULL_DEFAULTS;
    const uint8_t *lit[REC_MAX_CAMERAS];
    bool present[REC_MAX_CAMERAS];
    rec_hull *h;
    T_EQ_I(rec_hull_new(outline, &h), PVX_OK);
    for (size_t c = 0; c < s->rig.n_cameras; c++) {
        lit[c] = rec_frame_lit(f, c);
        present[c] = (rec_frame_get_report(f)->vote.out >> c & 1) == 0;
    }
    size_t n = rec_hull_bricks(h, &p, lit, present, s->pool, outline->active->brick), marked = 0;
    for (size_t i = 0; i < outline->active->bricks; i++)
        marked += outline->active->brick[i];
    T_EQ_I(n, marked);
    T_LE(rec_frame_get_report(f)->active_voxels, REC_BRICK_VOXELS * n);
    rec_hull_free(&h);
}

static size_t volumes_differ(const rec_frame *f, const rec_frame *g)
{
    struct rec_sparse v, w;
    rec_frame_volume(f, &v);
    rec_frame_volume(g, &w);
    if (v.n != w.n || v.n == 0)
        return 1;
    return (memcmp(v.index, w.index, (size_t)v.n * sizeof *v.index) != 0) +
           (memcmp(v.value, w.value, (size_t)v.n * (size_t)v.cs * sizeof *v.value) != 0);
}

/* Stops after the camera that is number *ctx. */
static bool stop_at(void *ctx, double done)
{
    double *camera = ctx;
    return done * 6 < *camera - 0.5;
}

T_CASE(an_outline_is_stopped)
{
    struct scene s;
    struct rec_sysmat_params p = {1, 2};
    struct pvx_diag d = {""};
    double last = 2, never = 7;
    rec_sysmat *outline = NULL;
    scene_new(&s, 6, 96, 64, 2, 2);
    T_EQ_I(
        rec_sysmat_outline(&s.rig, &p, s.pool, (struct rec_progress){stop_at, &last}, &outline, &d),
        PVX_ECANCELED);
    T_OK(outline == NULL);
    T_OK(strstr(d.text, "stopped") != NULL);
    T_EQ_I(rec_sysmat_outline(&s.rig, &p, s.pool, (struct rec_progress){stop_at, &never}, &outline,
                              &d),
           PVX_OK);
    rec_sysmat_free(&outline);
    scene_free(&s);
}

T_CASE_OF_THREADS(volumes_are_those_of_the_whole)
{
    struct scene s;
    struct rec_sysmat_params p = {1, 2};
    rec_sysmat *outline = NULL, *part = NULL;
    scene_new(&s, 6, 96, 64, 2, 2);
    rec_frame *f = slot_of(&s, s.S);
    shoot(&s, f);
    T_EQ_I(rec_frame_solve(f, 0, NULL), PVX_OK);
    T_EQ_I(rec_frame_get_report(f)->hull.cut, 0);
    T_EQ_I(rec_sysmat_outline(&s.rig, &p, s.pool, (struct rec_progress){0}, &outline, NULL),
           PVX_OK);
    mark_by(&s, f, outline);
    T_EQ_I(rec_sysmat_build_active(&s.rig, &outline, s.pool, (struct rec_progress){0}, &part, NULL),
           PVX_OK);
    T_OK(part->active->columns < s.voxels / 2);

    rec_frame *g = slot_of(&s, part);
    shoot(&s, g);
    T_EQ_I(rec_frame_solve(g, 0, NULL), PVX_OK);
    T_EQ_I(rec_frame_get_report(g)->hull.cut, 0);
    T_EQ_I(rec_frame_get_report(g)->hull.outside, rec_frame_get_report(f)->hull.outside);
    T_EQ_I(rec_frame_get_report(g)->coarse_iterations, rec_frame_get_report(f)->coarse_iterations);
    T_EQ_I(volumes_differ(f, g), 0);

    scene_at(&s, 0.9); /* another flame: it is cut, and that is counted */
    shoot(&s, f);
    shoot(&s, g);
    T_OK(rec_frame_get_report(g)->hull.cut > 0);
    T_OK(rec_frame_get_report(g)->active_voxels < rec_frame_get_report(f)->active_voxels);
    T_EQ_I(rec_frame_solve(g, 0, NULL), PVX_OK);
    rec_frame_free(&f);
    rec_frame_free(&g);
    rec_sysmat_free(&part);
    scene_free(&s);
}
