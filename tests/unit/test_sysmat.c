#include "recon/matrix/sysmat.h"

#include <fcntl.h>
#include <signal.h>
#include <stdbool.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>
#include "base/file.h"
#include "base/log.h"
#include "recon/geom/bundle.h"
#include "recon/geom/traverse.h"
#include "recon/matrix/cache.h"
#include "tests/lib/scratch.h"
#include "tests/t.h"
#include "tests/lib/centre.h"
#include "tests/lib/ray_entries.h"

static int files_in_dir(void)
{
    char cmd[300];
    int n = -1;
    snprintf(cmd, sizeof cmd, "find %s -type f | wc -l", dir);
    FILE *f = popen(cmd, "r");
    if (f == NULL || fscanf(f, "%d", &n) != 1)
        n = -1;
    if (f != NULL)
        pclose(f);
    return n;
}

static struct rec_rig ring(size_t n, int32_t w, int32_t h, int32_t voxels, enum rec_basis b)
{
    struct rec_rig r;
    T_EQ_I(rec_rig_ring(n, 2, w, h, voxels, &r), PVX_OK);
    r.grid.basis = b;
    return r;
}

/* Threads 0: without a pool. */
static rec_sysmat *build(const struct rec_rig *r, int32_t binning, int32_t rays, unsigned threads)
{
    struct rec_sysmat_params p = {binning, rays};
    struct pvx_diag d = {""};
    pvx_pool *pool = NULL;
    rec_sysmat *m = NULL;
    if (threads > 0)
        T_EQ_I(pvx_pool_new(threads, "t", &pool), PVX_OK);
    T_EQ_I(rec_sysmat_build(r, &p, pool, NULL, NULL, &m, &d), PVX_OK);
    T_EQ_S(d.text, "");
    pvx_pool_free(&pool);
    if (m == NULL)
        exit(1);
    return m;
}

static void done(rec_sysmat **m, struct rec_rig *r)
{
    rec_sysmat_free(m);
    rec_rig_fini(r);
}

static bool same_windows(const struct rec_windows *a, const struct rec_windows *b, size_t N)
{
    size_t windows = N * (size_t)a->slots, weights = windows * rec_window_size(a);
    return a->slots == b->slots && a->high == b->high && a->wide == b->wide &&
           memcmp(a->pitch, b->pitch, sizeof a->pitch) == 0 && a->nowhere == b->nowhere &&
           a->room == b->room && a->unit == b->unit && a->n_more == b->n_more &&
           memcmp(a->at, b->at, windows * sizeof *a->at) == 0 &&
           memcmp(a->w, b->w, weights + REC_WINDOWS_PAD) == 0 &&
           memcmp(a->more, b->more, a->n_more * sizeof *a->more) == 0;
}
static bool same_level(const rec_sysmat *a, const rec_sysmat *b)
{
    size_t N = rec_grid_count(&a->grid);
    if (memcmp(&a->grid, &b->grid, sizeof a->grid) != 0 || a->n_cameras != b->n_cameras ||
        a->key != b->key || a->nnz != b->nnz || a->binning != b->binning || a->unit != b->unit ||
        a->rays_per_bin != b->rays_per_bin || !same_windows(&a->win, &b->win, N))
        return false;
    for (size_t c = 0; c < a->n_cameras; c++) {
        const struct rec_sysmat_block *p = &a->block[c], *q = &b->block[c];
        if (p->bw != q->bw || p->bh != q->bh || p->nnz != q->nnz ||
            a->row0[c + 1] != b->row0[c + 1] ||
            memcmp(p->fp, q->fp, rec_brick_places(&a->grid) * 8) != 0)
            return false;
    }
    return true;
}

static bool same(const rec_sysmat *a, const rec_sysmat *b)
{
    for (; a != NULL && b != NULL; a = a->coarse, b = b->coarse)
        if (!same_level(a, b))
            return false;
    return a == b;
}

/* It is of that key, and the file has its very bits. */
static void loads_as(const rec_sysmat *m, const char *path, pvx_pool *pool)
{
    rec_sysmat *l;
    T_EQ_I(rec_sysmat_load(path, m->key, true, pool, &l, NULL), PVX_OK);
    T_OK(l != NULL && same(m, l));
    rec_sysmat_free(&l);
}

/* Saved as it is, it is refused. */
static void refused(const rec_sysmat *m, pvx_pool *pool, const char *part)
{
    struct pvx_diag d = {""};
    rec_sysmat *l;
    T_EQ_I(rec_sysmat_save(m, at("forged"), pool, &d), PVX_OK);
    T_EQ_I(rec_sysmat_load(at("forged"), 0, true, pool, &l, &d), PVX_ECORRUPT);
    T_CONTAINS(d.text, part);
}
/* ... with this in that place, which is put back. */
#define FORGED(m, pool, place, value, part) \
    do {                                    \
        __typeof__(place) old_ = (place);   \
        (place) = (value);                  \
        refused(m, pool, part);             \
        (place) = old_;                     \
    } while (0)

/* Length of the half line in the box, in long double. */
static double chord(const struct rec_grid *g, const double o[3], const double d[3])
{
    long double s0 = 0, s1 = 1e30L;
    for (int a = 0; a < 3; a++) {
        long double p = ((long double)g->min[a] - o[a]) / d[a];
        long double q = ((long double)g->max[a] - o[a]) / d[a];
        s0 = fmaxl(s0, fminl(p, q));
        s1 = fminl(s1, fmaxl(p, q));
    }
    return s1 > s0 ? (double)(s1 - s0) : 0;
}

static double *sums_of_rows(const rec_sysmat *m)
{
    double *sum = calloc(m->row0[m->n_cameras], sizeof *sum);
    struct entries all = entries_of(m);
    for (uint64_t e = 0; e < all.nnz; e++)
        sum[all.row[e]] += entries_value(&all, e);
    entries_free(&all);
    return sum;
}

/* Row sums of every bin are the mean of the chords of its rays: to half a unit. */
static void row_sums(int32_t binning, int32_t rays)
{
    struct rec_rig r = ring(3, 48, 36, 12, REC_BOX);
    rec_sysmat *m = build(&r, binning, rays, 2);
    double *sum = sums_of_rows(m);
    for (size_t c = 0; c < 3; c++) {
        const struct rec_sysmat_block *b = &m->block[c];
        double hit = 0;
        for (int32_t y = 0; y < b->bh; y++)
            for (int32_t x = 0; x < b->bw; x++) {
                double want = 0;
                for (int j = 0; j < rays; j++)
                    for (int i = 0; i < rays; i++) {
                        /* raw pixels [x*b - 1/2, (x+1)*b - 1/2) */
                        double u = (x + (i + 0.5) / rays) * binning - 0.5, o[3], d[3];
                        double v = (y + (j + 0.5) / rays) * binning - 0.5;
                        T_OK(rec_camera_ray(&r.cameras[c], u, v, o, d));
                        want += chord(&r.grid, o, d) / (rays * rays);
                    }
                T_NEAR(sum[m->row0[c] + (size_t)(y * b->bw + x)], want,
                       0.5 * m->unit + 1e-7 * want);
                hit += want > 0;
            }
        T_OK(hit > 0.2 * b->bw * b->bh); /* the test is about something */
    }
    free(sum);
    done(&m, &r);
}
T_CASE(row_sums_are_chords)
{
    row_sums(1, 1);
}
T_CASE(row_sums_of_binned_rows)
{
    row_sums(2, 2);
    row_sums(4, 1);
    row_sums(1, 3);
    row_sums(3, 5);
}

/* Half a unit is half a voxel's diagonal over 254: of a chord of 64 sides sqrt(3) / 508 / 64 = 5.4e-5, and of
 * the shortest that is looked at, half as long, twice that. */
T_CASE(row_sums_at_64)
{
    struct rec_rig r = ring(1, 64, 48, 64, REC_BOX);
    rec_sysmat *m = build(&r, 1, 1, 2);
    double *sum = sums_of_rows(m);
    int ordinary = 0;
    for (int i = 0; i < 64 * 48; i++) {
        double o[3], d[3];
        T_OK(rec_camera_ray(&r.cameras[0], i % 64, i / 64, o, d));
        double want = chord(&r.grid, o, d);
        if (want < 0.5)
            continue;
        T_NEAR(sum[i], want, 1.07e-4 * want);
        ordinary++;
    }
    T_OK(ordinary > 600);
    free(sum);
    done(&m, &r);
}

struct plain {
    const struct rec_grid *grid;
    int32_t *index;
    float *value;
};
static void add_plain(void *ctx, const double o[3], const double d[3], double share, double *want)
{
    const struct plain *p = ctx;
    size_t n = rec_traverse(p->grid, o, d, p->index, p->value);
    for (size_t i = 0; i < n; i++)
        want[p->index[i]] += share * p->value[i];
}

/* Every entry once more, straight from the ray; nothing else is stored. */
static void entries_are_rays(const struct rec_rig *r, const rec_sysmat *m)
{
    size_t most = rec_traverse_max(&r->grid), empty;
    struct plain p = {&r->grid, malloc(most * sizeof *p.index), malloc(most * sizeof *p.value)};
    T_LE(entries_against_rays(r, m, add_plain, &p, 0, &empty), 1.0001 * m->unit);
    free(p.index);
    free(p.value);
}
static void entries(enum rec_basis basis, int32_t binning, int32_t rays)
{
    struct rec_rig r = ring(2, 32, 24, 9, basis);
    r.grid.n[1] = 7;
    r.grid.n[2] = 11;
    rec_sysmat *m = build(&r, binning, rays, 3);
    entries_are_rays(&r, m);
    done(&m, &r);
}
T_CASE(entries_of_box)
{
    entries(REC_BOX, 1, 1);
    entries(REC_BOX, 2, 3);
}
T_CASE(entries_of_trilinear)
{
    entries(REC_TRILINEAR, 1, 1);
    entries(REC_TRILINEAR, 4, 2);
}

/* Cameras of different widths and heights, some with images smaller than a window; voxels of less than a bin
 * and of a thousand, which are covered in pieces. */
T_CASE(entries_of_any_rig)
{
    static const size_t cameras[] = {1, 4, 5, 8, 12};
    static const int32_t images[][2] = {{48, 36}, {1, 9}, {7, 2}, {2, 3}, {3, 30}, {40, 1}, {1, 1}};
    static const struct {
        int32_t side, layers;
        enum rec_basis basis;
    } grid[] = {{1, 1, REC_TRILINEAR}, {3, 3, REC_BOX},   {6, 6, REC_TRILINEAR},
                {8, 8, REC_BOX},       {12, 12, REC_BOX}, {6, 12, REC_TRILINEAR},
                {8, 16, REC_BOX}};
    bool seen[5][5] = {{false}}, pieces = false;
    size_t more = 0;
    for (size_t n = 0; n < sizeof cameras / sizeof *cameras; n++)
        for (size_t v = 0; v < sizeof grid / sizeof *grid; v++) {
            struct rec_rig r = ring(cameras[n], 48, 36, grid[v].side, grid[v].basis);
            r.grid.n[2] = grid[v].layers;
            for (size_t c = 0; c < cameras[n]; c++) {
                struct rec_camera *camera = &r.cameras[c];
                const int32_t *size = images[c % (sizeof images / sizeof *images)];
                camera->cx -= (48 - size[0]) / 2.0;
                camera->cy -= (36 - size[1]) / 2.0;
                camera->width = size[0];
                camera->height = size[1];
            }
            rec_sysmat *m = build(&r, 1, 1, 2);
            entries_are_rays(&r, m);
            struct entries all = entries_of(m);
            for (size_t j = 0; j < all.n; j++) {
                uint32_t of_first = 0;
                for (uint32_t e = all.colptr[j]; e < all.colptr[j + 1]; e++)
                    of_first += all.row[e] < m->row0[1];
                pieces = pieces || of_first > 1024;
            }
            entries_free(&all);
            seen[m->win.high][m->win.wide] = true;
            more += m->win.n_more;
            done(&m, &r);
        }
    T_OK(seen[2][2] && seen[2][4] && seen[3][4] && seen[4][4]);
    T_OK(pieces && more > 1000);
}

T_CASE_OF_THREADS(same_bits_for_any_threads)
{
    for (int basis = 0; basis < 2; basis++)
        for (int rays = 1; rays < 3; rays++) {
            struct rec_rig r = ring(3, 60, 44, 31, basis == 0 ? REC_BOX : REC_TRILINEAR);
            T_EQ_I(rec_sysmat_levels(&r.grid), 2);
            rec_sysmat *one = build(&r, 2, rays, 1);
            static const unsigned threads[] = {0, 3};
            for (int i = 0; i < 2; i++) {
                rec_sysmat *m = build(&r, 2, rays, threads[i]);
                T_OK(same(one, m));
                rec_sysmat_free(&m);
            }
            rec_sysmat_free(&one);
            rec_rig_fini(&r);
        }
}

static void in_footprint(const rec_sysmat *m, size_t c, int32_t col, double u, double v,
                         int32_t binning)
{
    const struct rec_sysmat_block *b = &m->block[c];
    double x = floor((u + 0.5) / binning), y = floor((v + 0.5) / binning);
    if (x < 0 || y < 0 || x >= b->bw || y >= b->bh)
        return;
    struct rec_rect r = rec_footprint(m, c, col);
    T_OK(rec_rect_seen(r) && x >= r.x0 && x <= r.x1 && y >= r.y0 && y <= r.y1);
}

static void entries_in_footprint(const rec_sysmat *m, const struct entries *all, size_t c, size_t j,
                                 int32_t binning)
{
    const struct rec_sysmat_block *b = &m->block[c];
    for (uint32_t e = all->colptr[j]; e < all->colptr[j + 1]; e++) {
        if (all->row[e] < m->row0[c] || all->row[e] >= m->row0[c + 1])
            continue;
        uint32_t bin = all->row[e] - (uint32_t)m->row0[c], bw = (uint32_t)b->bw;
        in_footprint(m, c, (int32_t)j, bin % bw * binning, bin / bw * binning, binning);
    }
}

/* Kind 3: a fisheye; 4: behind two plates, one of them oblique; 5: a Scheimpflug behind them; 6: telecentric
 * behind them.  The others are pinholes. */
static void other_rays(struct rec_camera *c, int kind)
{
    static const enum rec_camera_model model[] = {REC_PINHOLE,    REC_PINHOLE, REC_PINHOLE,
                                                  REC_FISHEYE,    REC_PINHOLE, REC_SCHEIMPFLUG,
                                                  REC_TELECENTRIC};
    double at[3];
    c->model = model[kind];
    if (kind < 4)
        return;
    rec_camera_centre(c, at);
    for (int i = 0; i < 2; i++) {
        struct rec_glass *w = &c->window[i];
        double across = i == 0 ? 0 : 0.5, along = sqrt(1 - across * across), d = 0;
        for (int a = 0; a < 3; a++) {
            w->normal[a] = along * c->R[6 + a] + across * c->R[a];
            d += w->normal[a] * at[a];
        }
        w->at = d + 0.1 + 0.2 * i;
        w->thickness = 0.03;
        w->index = 1.6;
    }
    c->n_windows = 2;
    if (kind == 5) {
        c->tilt[0] = 0.14;
        c->tilt[1] = -0.1;
    }
    if (kind == 6) {
        double X[3] = {0, 0, 0.5}, z = c->t[2];
        memset(c->dist, 0, sizeof c->dist);
        for (int a = 0; a < 3; a++)
            z += c->R[6 + a] * X[a];
        c->fx /= z;
        c->fy /= z;
    }
}

/* Points anywhere in a support, and all entries, are inside the footprint; and it is not much larger
 * than the points show.  Strong lenses, coarse grids. */
T_CASE(footprints_hold_their_support)
{
    static const double lens[4][8] = {
        {0}, {-0.28, 0.09, 4e-3, -6e-3}, {0.5, 0.3, 2e-3, 2e-3, 0.2, 0.1}, {-0.05, 0.02}};
    for (int t = 0; t < 28; t++) { /* from 12 on: a fisheye, glass, a Scheimpflug, telecentrics */
        struct rec_rig r = ring(2, 96, 64, t % 3 == 0 ? 2 : 7, t % 2 ? REC_TRILINEAR : REC_BOX);
        int32_t binning = t % 4 < 2 ? 1 : 4;
        for (int c = 0; c < 2; c++) {
            memcpy(r.cameras[c].dist, lens[t / 4 % 4], sizeof lens[0]);
            r.cameras[c].fx *= 1.6; /* part of the volume is outside the image */
            other_rays(&r.cameras[c], t / 4);
        }
        rec_sysmat *m = build(&r, binning, 2, 2);
        struct entries all = entries_of(m);
        double reach = r.grid.basis == REC_TRILINEAR ? 1 : 0.5, area = 0, spread = 0;
        for (size_t c = 0; c < 2; c++) {
            for (int32_t j = 0; j < (int32_t)rec_grid_count(&r.grid); j++) {
                double mid[3], X[3], uv[2], lo[2] = {1e9, 1e9}, hi[2] = {-1e9, -1e9};
                grid_centre(&r.grid, j, mid);
                for (int i = 0; i < 200; i++) {
                    for (int a = 0; a < 3; a++) {
                        double f =
                            i < 100 && t_rand() % 2 ? (t_rand() % 2 ? 1 : -1) : t_uniform(-1, 1);
                        X[a] = mid[a] + f * reach * rec_grid_h(&r.grid, a) * (1 - 1e-9);
                    }
                    if (!rec_camera_project(&r.cameras[c], X, uv))
                        continue;
                    in_footprint(m, c, j, uv[0], uv[1], binning);
                    for (int a = 0; a < 2; a++) {
                        lo[a] = fmin(lo[a], uv[a]);
                        hi[a] = fmax(hi[a], uv[a]);
                    }
                }
                entries_in_footprint(m, &all, c, (size_t)j, binning);
                struct rec_rect f = rec_footprint(m, c, j);
                if (rec_rect_seen(f) && lo[0] > 0 && lo[1] > 0 && hi[0] < 95 && hi[1] < 63) {
                    area += (f.x1 - f.x0 + 1) * (f.y1 - f.y0 + 1);
                    spread += ((hi[0] - lo[0]) / binning + 2) * ((hi[1] - lo[1]) / binning + 2);
                }
            }
        }
        T_OK(area > 0);
        /* supports of half the volume behind the strongest lens, and of a seventh behind glass: the bound on the bend
         * is loose */
        T_LE(area, (r.grid.n[0] == 2 ? 2.5 : 1.25) * (t < 16 ? 1 : 1.15) * spread);
        entries_free(&all);
        done(&m, &r);
    }
}

/* Blurred cameras, one behind glass: a row's sum is the mean of the chords of its bundle.  The footprint is that of a
 * sharp camera, and light in the voxel reaches all of it. */
T_CASE(blurred_rows_are_means_of_their_bundles)
{
    for (int basis = 0; basis < 2; basis++) {
        struct rec_rig r = ring(2, 48, 36, 12, basis == 0 ? REC_BOX : REC_TRILINEAR), sharp;
        T_EQ_I(rec_rig_copy(&r, &sharp), PVX_OK);
        r.cameras[0].blur.sigma = 1.5;
        other_rays(&r.cameras[1], 4);
        other_rays(&sharp.cameras[1], 4);
        r.cameras[1].blur.aperture = 0.12;
        r.cameras[1].blur.focus = 4;
        rec_sysmat *m = build(&r, 2, 2, 2), *was = build(&sharp, 2, 2, 2);
        double *sum = sums_of_rows(m);
        struct entries all = entries_of(m), before = entries_of(was);
        T_LE(1.5 * (double)before.nnz, (double)all.nnz);
        for (size_t c = 0; c < 2 && basis == 0; c++) {
            const struct rec_sysmat_block *b = &m->block[c];
            struct rec_bundle rays;
            rec_bundle_init(&rays, &r.cameras[c], 2, 2, &r.grid);
            T_LE(9, rec_bundle_rays(&rays));
            for (int32_t y = 0; y < b->bh; y++)
                for (int32_t x = 0; x < b->bw; x++) {
                    double want = 0, o[3], d[3];
                    for (int32_t i = 0; i < rec_bundle_rays(&rays); i++) {
                        T_OK(rec_bundle_ray(&rays, 2 * x - 0.5, 2 * y - 0.5, i, o, d));
                        want += chord(&r.grid, o, d) / rec_bundle_rays(&rays);
                    }
                    T_NEAR(sum[m->row0[c] + (size_t)(y * b->bw + x)], want,
                           0.5 * m->unit + 1e-6 * want);
                }
        }
        for (size_t c = 0; c < 2; c++)
            for (int32_t j = 0; j < (int32_t)rec_grid_count(&r.grid); j++) {
                struct rec_rect f = rec_footprint(m, c, j), g = rec_footprint(was, c, j);
                if (basis == 1 && rec_rect_seen(g)) /* the sharp one has its entries' bins, too */
                    T_OK(rec_rect_seen(f) && f.x0 >= g.x0 && f.x1 <= g.x1 && f.y0 >= g.y0 &&
                         f.y1 <= g.y1);
            }
        free(sum);
        entries_free(&all);
        entries_free(&before);
        done(&was, &sharp);
        done(&m, &r);
    }
}

/* A camera in the middle of the volume: half of it is behind, and the rest is all over the image. */
T_CASE(camera_inside_the_volume)
{
    for (int basis = 0; basis < 2; basis++) {
        struct rec_rig r = ring(1, 40, 30, 10, basis == 0 ? REC_BOX : REC_TRILINEAR);
        struct rec_camera *c = &r.cameras[0];
        double inside[3] = {0.03, 0.01, 0.52};
        for (int i = 0; i < 3; i++)
            c->t[i] = -(c->R[3 * i] * inside[0] + c->R[3 * i + 1] * inside[1] +
                        c->R[3 * i + 2] * inside[2]);
        rec_sysmat *m = build(&r, 1, 1, 2);
        struct entries all = entries_of(m);
        size_t behind = 0, whole = 0;
        double sum = 0, want = 0, o[3], d[3];
        for (int32_t j = 0; j < 1000; j++) {
            struct rec_rect f = rec_footprint(m, 0, j);
            behind += !rec_rect_seen(f);
            whole += f.x0 == 0 && f.y0 == 0 && f.x1 == 39 && f.y1 == 29;
            entries_in_footprint(m, &all, 0, (size_t)j, 1);
        }
        for (uint64_t e = 0; e < all.nnz; e++)
            sum += entries_value(&all, e);
        entries_free(&all);
        for (int i = 0; i < 1200; i++)
            if (rec_camera_ray(c, i % 40, i / 40, o, d))
                want += chord(&r.grid, o, d);
        if (basis == 0)
            T_NEAR(sum, want, 1e-6 * want + 0.5 * 1200 * m->unit);
        T_OK(behind > 300);
        T_OK(whole >= 1);
        done(&m, &r);
    }
}

/* R A P by its definition, entry by entry, in images and grids of odd sides. */
T_CASE(coarse_level_is_r_a_p)
{
    for (int basis = 0; basis < 2; basis++) {
        struct rec_rig r = ring(2, 33, 25, 9, basis == 0 ? REC_BOX : REC_TRILINEAR);
        r.cameras[1].width = 30;
        r.grid.n[0] = 31;
        r.grid.n[1] = 8;
        r.grid.n[2] = 1 + 4 * basis;
        rec_sysmat *m = build(&r, 1, 2, 2);
        const rec_sysmat *c = m->coarse;
        T_OK(c != NULL);
        struct entries all = entries_of(m), coarser = entries_of(c);
        const struct rec_grid *f = &m->grid, *g = &c->grid;
        T_OK(g->n[0] == 16 && g->n[1] == 4 && g->n[2] == 1 + 2 * basis && g->basis == f->basis);
        T_NEAR(c->unit, 2 * m->unit, 0);
        for (int a = 0; a < 3; a++) {
            T_NEAR(rec_grid_h(g, a), 2 * rec_grid_h(f, a), 1e-12);
            T_NEAR(g->min[a], f->min[a], 0);
        }
        T_EQ_I(c->row0[2], 17 * 13 + 15 * 13);
        size_t N = rec_grid_count(g), rows = c->row0[2];
        double *want = calloc(rows * N, sizeof *want), *sum = calloc(rows, sizeof *sum);
        for (int32_t j = 0; j < (int32_t)rec_grid_count(f); j++) {
            int32_t ijk[3];
            rec_grid_ijk(f, j, ijk);
            size_t J = (size_t)rec_grid_index(g, ijk[0] / 2, ijk[1] / 2, ijk[2] / 2);
            for (uint32_t e = all.colptr[j]; e < all.colptr[j + 1]; e++) {
                size_t cam = all.row[e] >= m->row0[1], bin = all.row[e] - m->row0[cam];
                size_t bw = (size_t)m->block[cam].bw, x = bin % bw, y = bin / bw;
                double share = (x == bw - 1 && bw % 2 ? 1 : 0.5) * (y == 24 ? 1 : 0.5);
                size_t row = c->row0[cam] + y / 2 * (size_t)c->block[cam].bw + x / 2;
                want[row * N + J] += share * entries_value(&all, e);
                sum[row] += share * entries_value(&all, e);
            }
        }
        double worst = 0, *got_sum = sums_of_rows(c);
        size_t stored = 0;
        for (size_t J = 0; J < N; J++)
            for (uint32_t e = coarser.colptr[J]; e < coarser.colptr[J + 1]; e++) {
                double *w = &want[coarser.row[e] * N + J];
                worst = fmax(worst, fabs(*w - entries_value(&coarser, e)));
                *w = 0;
                stored++;
            }
        T_EQ_I(stored, c->nnz);
        for (size_t i = 0; i < rows * N; i++)
            worst = fmax(worst, want[i]); /* what is not stored */
        T_LE(worst, 1.0001 * c->unit);
        for (size_t i = 0; i < rows; i++)
            T_NEAR(got_sum[i], sum[i], 0.5001 * c->unit);
        T_EQ_I(c->block[0].nnz + c->block[1].nnz, c->nnz);
        free(want);
        free(sum);
        free(got_sum);
        entries_free(&all);
        entries_free(&coarser);
        done(&m, &r);
    }
}

/* For the box basis the coarse level is the matrix of the coarser grid, whose bins have the rays of
 * their children; footprints hold the entries on every level. */
T_CASE(coarse_box_is_the_coarse_grid)
{
    struct rec_rig r = ring(2, 64, 48, 64, REC_BOX);
    rec_sysmat *m = build(&r, 1, 1, 2);
    T_EQ_I(rec_sysmat_levels(&r.grid), 3);
    const rec_sysmat *level = m->coarse;
    for (int k = 1; k <= 2; k++, level = level->coarse) {
        struct rec_rig rk = ring(2, 64, 48, 64 >> k, REC_BOX);
        rec_sysmat *want = build(&rk, 1 << k, 1 << k, 2);
        struct entries must = entries_of(want), is = entries_of(level);
        size_t N = rec_grid_count(&want->grid), entries = 0;
        double *column = calloc(want->row0[2], sizeof *column), worst = 0;
        T_OK(level != NULL && rec_grid_count(&level->grid) == N);
        T_EQ_I(level->row0[2], want->row0[2]);
        T_EQ_I(level->binning, 1 << k);
        for (size_t j = 0; j < N; j++) {
            for (uint32_t e = must.colptr[j]; e < must.colptr[j + 1]; e++)
                column[must.row[e]] += entries_value(&must, e);
            for (uint32_t e = is.colptr[j]; e < is.colptr[j + 1]; e++) {
                column[is.row[e]] -= entries_value(&is, e);
                worst = fmax(worst, fabs(column[is.row[e]]));
                column[is.row[e]] = 0;
                entries++;
            }
            for (uint32_t e = must.colptr[j]; e < must.colptr[j + 1]; e++) {
                worst = fmax(worst, fabs(column[must.row[e]]));
                column[must.row[e]] = 0;
            }
            entries_in_footprint(level, &is, 0, j, 1 << k);
            entries_in_footprint(level, &is, 1, j, 1 << k);
        }
        T_OK(entries > 10000);
        T_LE(worst, 3 * (double)want->unit);
        free(column);
        entries_free(&must);
        entries_free(&is);
        rec_sysmat_free(&want);
        rec_rig_fini(&rk);
    }
    T_OK(level == NULL);
    done(&m, &r);
}

T_CASE(camera_that_sees_nothing)
{
    struct rec_rig r = ring(2, 40, 30, 8, REC_BOX);
    struct rec_camera *c = &r.cameras[1];
    for (int i = 0; i < 3; i++) { /* turned round: R -> R diag of 180 degrees about its y axis */
        c->R[i] = -c->R[i];
        c->R[6 + i] = -c->R[6 + i];
    }
    c->t[0] = -c->t[0];
    c->t[2] = -c->t[2];
    rec_sysmat *m = build(&r, 0, 0, 2);
    T_EQ_I(m->block[1].nnz, 0);
    T_OK(m->block[0].nnz > 0);
    for (int j = 0; j < 512; j++)
        T_OK(!rec_rect_seen(rec_footprint(m, 1, j)));
    T_EQ_I(rec_sysmat_save(m, at("blind"), NULL, NULL), PVX_OK);
    loads_as(m, at("blind"), NULL);
    done(&m, &r);
    unlink(at("blind"));
}

T_CASE(autos_resolve)
{
    static const struct {
        int32_t w, h, voxels, binning, rays;
    } want[] = {
        {640, 480, 64, 2, 2}, /* a voxel is 3.6 px */
        {160, 120, 64, 1, 2}, {640, 480, 16, 8, 2},
        {641, 480, 16, 1, 2}, {644, 484, 16, 4, 2}, /* 4 is the largest power that divides */
    };
    for (size_t i = 0; i < sizeof want / sizeof want[0]; i++) {
        struct rec_rig r = ring(8, want[i].w, want[i].h, want[i].voxels, REC_BOX);
        struct rec_sysmat_params p;
        T_EQ_I(rec_sysmat_resolve(&r, &rec_sysmat_defaults, &p, NULL), PVX_OK);
        T_EQ_I(p.binning, want[i].binning);
        T_EQ_I(p.rays_per_bin, want[i].rays);
        rec_rig_fini(&r);
    }
    struct rec_rig r = ring(2, 64, 48, 8, REC_BOX);
    struct pvx_diag d = {""};
    struct rec_sysmat_params p = {5, 1}, out;
    T_EQ_I(rec_sysmat_resolve(&r, &p, &out, &d), PVX_EINVAL);
    T_CONTAINS(d.text, "binning 5 does not divide the 64 x 48 image of camera cam0");
    p = (struct rec_sysmat_params){65, 1};
    T_EQ_I(rec_sysmat_resolve(&r, &p, &out, NULL), PVX_EINVAL);
    p = (struct rec_sysmat_params){1, 17};
    T_EQ_I(rec_sysmat_resolve(&r, &p, &out, NULL), PVX_EINVAL);
    rec_rig_fini(&r);
}

static uint64_t key_of(const struct rec_rig *r, struct rec_sysmat_params p)
{
    uint64_t k = 0;
    T_EQ_I(rec_sysmat_key(r, &p, &k, NULL), PVX_OK);
    return k;
}

T_CASE(key_depends_on_everything)
{
    struct rec_rig r = ring(2, 64, 48, 8, REC_BOX);
    const struct rec_sysmat_params p = {1, 1}, autos = {0, 0};
    struct rec_sysmat_params resolved;
    uint64_t k = key_of(&r, p);
    T_OK(key_of(&r, (struct rec_sysmat_params){2, 1}) != k);
    T_OK(key_of(&r, (struct rec_sysmat_params){1, 2}) != k);
    T_EQ_I(rec_sysmat_resolve(&r, &autos, &resolved, NULL), PVX_OK);
    T_OK(key_of(&r, autos) == key_of(&r, resolved));
    r.cameras[1].fx *= 1.000001;
    T_OK(key_of(&r, p) != k);
    k = key_of(&r, p);
    other_rays(&r.cameras[0], 4);
    uint64_t glass = key_of(&r, p);
    T_OK(glass != k);
    r.cameras[0].window[1].index += 1e-6;
    T_OK(key_of(&r, p) != glass);
    rec_rig_fini(&r);
}

struct cancel {
    int calls;
    double stop_at, last;
};
static bool cancel_at(void *ctx, double done)
{
    struct cancel *c = ctx;
    c->calls++;
    T_OK(done >= 0 && done <= 1);
    c->last = done;
    return done < c->stop_at;
}

T_CASE_OF_THREADS(progress_and_cancel)
{
    struct rec_rig r = ring(3, 80, 60, 16, REC_BOX);
    pvx_pool *pool;
    T_EQ_I(pvx_pool_new(2, "t", &pool), PVX_OK);
    static const double stops[] = {0.0001, 0.4, 0.9, 1};
    for (int i = 0; i < 4; i++) {
        struct cancel c = {0, stops[i], 0};
        struct pvx_diag d = {""};
        rec_sysmat *m;
        T_EQ_I(rec_sysmat_build(&r, &rec_sysmat_defaults, pool, cancel_at, &c, &m, &d),
               PVX_ECANCELED);
        T_OK(m == NULL && c.calls > 0);
        T_CONTAINS(d.text, "stopped");
        /* nor does it leave a file */
        T_EQ_I(rec_sysmat_open(&r, &rec_sysmat_defaults, at("canceled"), pool,
                               (struct rec_progress){cancel_at, &c}, &m, NULL),
               PVX_ECANCELED);
        T_EQ_I(files_in_dir(), 0);
    }
    struct cancel c = {0, 2, 0};
    rec_sysmat *m;
    T_EQ_I(rec_sysmat_build(&r, &rec_sysmat_defaults, pool, cancel_at, &c, &m, NULL), PVX_OK);
    T_NEAR(c.last, 1, 0);
    T_OK(c.calls > 20);
    rec_sysmat_free(&m);
    pvx_pool_free(&pool);
    rec_rig_fini(&r);
}

T_CASE(save_and_load)
{
    for (int basis = 0; basis < 2; basis++) {
        struct rec_rig r = ring(3, 50, 30, 9, basis == 0 ? REC_BOX : REC_TRILINEAR);
        rec_sysmat *m = build(&r, 1, 1, 2), *l = NULL;
        const char *path = at("m.pvxm");
        struct pvx_diag d = {""};
        T_EQ_I(rec_sysmat_save(m, path, NULL, &d), PVX_OK);
        for (int i = 0; i < 4; i++) {
            T_EQ_I(rec_sysmat_load(path, i & 1 ? m->key : 0, i & 2, NULL, &l, &d), PVX_OK);
            T_OK(l != NULL && same(m, l));
            for (const rec_sysmat *k = l; k != NULL; k = k->coarse) {
                T_EQ_I((uintptr_t)k->win.at % 64, 0);
                T_EQ_I((uintptr_t)k->win.w % 64, 0);
                T_EQ_I((uintptr_t)k->win.more % 64, 0);
                for (size_t c = 0; c < 3; c++)
                    T_EQ_I((uintptr_t)k->block[c].fp % 64, 0);
            }
            rec_sysmat_free(&l);
        }
        T_EQ_I(rec_sysmat_load(path, m->key + 1, true, NULL, &l, &d), PVX_ESTALE);
        T_CONTAINS(d.text, "m.pvxm: made for another rig");
        T_OK(l == NULL);
        T_EQ_I(files_in_dir(), 1); /* no temporary left */
        done(&m, &r);
        unlink(path);
    }
}

/* The saved bytes of a small matrix, to be damaged. */
static char *bytes_of_matrix(size_t *n)
{
    struct rec_rig r = ring(2, 20, 15, 5, REC_BOX);
    r.grid.n[2] = 32; /* a second level */
    rec_sysmat *m = build(&r, 1, 1, 1);
    T_OK(m->coarse != NULL && m->coarse->coarse == NULL);
    T_OK(m->win.n_more > 0 && m->coarse->win.n_more > 0);
    char *data;
    T_EQ_I(rec_sysmat_save(m, at("good"), NULL, NULL), PVX_OK);
    T_EQ_I(pvx_file_read(at("good"), 1 << 24, &data, n, NULL), PVX_OK);
    done(&m, &r);
    unlink(at("good"));
    return data;
}

/* Header, and table with one row per camera and then per level, of a file of two cameras. */
#define HEAD(levels) (128 + 2 * 8 + (levels) * (2 * 8 + 8 + 5 * 24))
/* Where section s of a level lies: offset and bytes. */
static void section_at(const char *data, int level, int s, uint64_t at[2])
{
    memcpy(at, data + HEAD(level) + 2 * 8 + 8 + 24 * s, 16);
}

static pvx_err load_bytes(const char *data, size_t n, struct pvx_diag *d)
{
    rec_sysmat *m;
    d->text[0] = '\0';
    FILE *f = fopen(at("bad"), "wb"); /* pvx_file_write waits for the disk, 1000 times here */
    T_OK(f != NULL && fwrite(data, 1, n, f) == n && fclose(f) == 0);
    pvx_err e = rec_sysmat_load(at("bad"), 0, true, NULL, &m, d);
    T_OK((e == PVX_OK) == (m != NULL));
    rec_sysmat_free(&m);
    unlink(at("bad"));
    return e;
}

T_CASE(every_flipped_byte_is_found)
{
    size_t n;
    char *data = bytes_of_matrix(&n);
    struct pvx_diag d;
    T_EQ_I(load_bytes(data, n, &d), PVX_OK);
    int format = 0, version = 0, undetected = 0, silent = 0;
    char *used = calloc(n, 1); /* bytes that mean something: all but the zeros between sections */
    memset(used, 1, HEAD(2));
    for (int level = 0; level < 2; level++)
        for (int s = 0; s < 5; s++) {
            uint64_t at[2];
            section_at(data, level, s, at);
            memset(used + at[0], 1, at[1]);
        }
    for (size_t i = 0; i < n; i += i < 512 ? 1 : 1 + t_rand() % 40) {
        data[i] ^= (char)(1 << (i % 8));
        pvx_err e = load_bytes(data, n, &d);
        data[i] ^= (char)(1 << (i % 8));
        format += e == PVX_EFORMAT;
        version += e == PVX_EVERSION;
        undetected += e == PVX_OK && used[i];
        silent += e != PVX_OK && strstr(d.text, dir) == NULL;
        T_OK(e == PVX_OK || e == PVX_EFORMAT || e == PVX_EVERSION || e == PVX_ECORRUPT);
    }
    T_EQ_I(format, 8);  /* the magic */
    T_EQ_I(version, 4); /* the version */
    T_EQ_I(undetected, 0);
    T_EQ_I(silent, 0); /* the path is always named */
    free(used);
    free(data);
}

/* One byte changed in each section of each level, named in the message. */
T_CASE(damage_names_the_section)
{
    static const char *const name[5] = {"windows", "weights", "further windows",
                                        "footprints of camera 0", "footprints of camera 1"};
    size_t n;
    char *data = bytes_of_matrix(&n);
    struct pvx_diag d;
    for (int level = 0; level < 2; level++)
        for (int s = 0; s < 5; s++) {
            char want[64];
            uint64_t at[2];
            section_at(data, level, s, at);
            data[at[0] + at[1] / 2] ^= 1;
            T_EQ_I(load_bytes(data, n, &d), PVX_ECORRUPT);
            data[at[0] + at[1] / 2] ^= 1;
            snprintf(want, sizeof want, "damaged (level %d, %s: checksum)", level, name[s]);
            T_CONTAINS(d.text, want);
            T_CONTAINS(d.text, "delete it");
        }
    free(data);
}

T_CASE(every_length_but_one_is_refused)
{
    size_t n;
    char *data = bytes_of_matrix(&n);
    struct pvx_diag d;
    for (size_t cut = 0; cut < n; cut += cut < 600 ? 1 : 1 + t_rand() % 200) {
        pvx_err e = load_bytes(data, cut, &d);
        T_EQ_I(e, cut < 8 ? PVX_EFORMAT : PVX_ECORRUPT);
    }
    char *longer = malloc(n + 1);
    memcpy(longer, data, n);
    longer[n] = 0;
    T_EQ_I(load_bytes(longer, n + 1, &d), PVX_ECORRUPT);
    T_CONTAINS(d.text, "bytes long, should be");
    free(longer);
    free(data);
    rec_sysmat *m;
    T_EQ_I(rec_sysmat_load(at("absent"), 0, true, NULL, &m, &d), PVX_ENOENT);
    T_EQ_I(rec_sysmat_load(dir, 0, true, NULL, &m, &d), PVX_EFORMAT);
    T_EQ_I(rec_sysmat_load("/dev/null", 0, true, NULL, &m, &d), PVX_EFORMAT);
    T_EQ_I(mkfifo(at("pipe"), 0600), 0);
    T_EQ_I(rec_sysmat_load(at("pipe"), 0, true, NULL, &m, &d), PVX_EFORMAT);
}

/* A matrix with windows of less than 16 weights, and more of them than one a column. */
static rec_sysmat *build_forgeable(struct rec_rig *r)
{
    *r = ring(2, 19, 15, 6, REC_TRILINEAR);
    rec_sysmat *m = build(r, 1, 1, 1);
    T_OK(rec_window_size(&m->win) < REC_WINDOW_MAX && m->win.n_more > 2);
    T_OK(m->row0[2] < m->win.nowhere && m->coarse == NULL);
    return m;
}
/* A window of camera 0 that has weights in its last row. */
static size_t deep_window(const rec_sysmat *m)
{
    size_t size = rec_window_size(&m->win), wide = (size_t)m->win.wide,
           slots = (size_t)m->win.slots;
    for (size_t i = 0; i < rec_grid_count(&m->grid) * slots; i += slots)
        for (size_t k = size - wide; k < size; k++)
            if (m->win.w[i * size + k] != 0)
                return i;
    exit(1);
}

/* Wrong contents under right checksums: what a bug or a forger would write. */
T_CASE(every_window_is_checked)
{
    struct rec_rig r;
    rec_sysmat *m = build_forgeable(&r);
    struct rec_windows *w = &m->win;
    size_t size = rec_window_size(w), N = rec_grid_count(&m->grid), i = deep_window(m);
    uint32_t second = (uint32_t)m->row0[1], end = (uint32_t)m->row0[2];
    FORGED(m, NULL, w->at[i], second, "level 0, windows: outside");
    FORGED(m, NULL, w->at[i + 1], second - 1, "windows: outside");
    FORGED(m, NULL, w->at[i + 1], end, "windows: outside");
    FORGED(m, NULL, w->at[i + 1], w->nowhere - 1, "windows: outside");
    FORGED(m, NULL, w->at[i + 1], w->nowhere + 1, "windows: outside");
    FORGED(m, NULL, w->at[i + 1], UINT32_MAX, "windows: outside");
    FORGED(m, NULL, w->at[i + 2], 0, "windows: outside"); /* of no camera */
    FORGED(m, NULL, w->at[N * (size_t)w->slots - 1], end - 1, "windows: outside");

    FORGED(m, NULL, w->at[i], w->nowhere, "level 0, weights: outside"); /* it has weights */
    FORGED(m, NULL, w->w[(i + 2) * size], 1, "weights: outside");
    FORGED(m, NULL, w->w[(N * (size_t)w->slots - 1) * size + size - 1], 1, "weights: outside");
    FORGED(m, NULL, w->at[i], second - 1, "weights: outside"); /* hangs over its image */
    for (size_t k = 0; k < REC_WINDOWS_PAD; k++)
        FORGED(m, NULL, w->w[N * (size_t)w->slots * size + k], 1, "weights: outside");
    done(&m, &r);
    unlink(at("forged"));
}

T_CASE(every_further_window_is_checked)
{
    struct rec_rig r;
    rec_sysmat *m = build_forgeable(&r);
    struct rec_windows *w = &m->win;
    size_t size = rec_window_size(w), N = rec_grid_count(&m->grid), i = 1;
    uint32_t second = (uint32_t)m->row0[1];
    while (i < w->n_more && (w->more[i].column == w->more[i - 1].column || w->more[i].slot != 0))
        i++;
    T_OK(i < w->n_more);
    struct rec_more *k = &w->more[i], over = *k;
    over.at = second - 1;
    memset(over.w, 1, size);
    FORGED(m, NULL, k->column, (uint32_t)N, "level 0, further windows: outside");
    FORGED(m, NULL, k->column, UINT32_MAX, "further windows: outside");
    FORGED(m, NULL, k->column, k[-1].column - 1, "further windows: not ascending");
    FORGED(m, NULL, k->slot, 2, "further windows: outside");
    FORGED(m, NULL, k->slot, UINT32_MAX, "further windows: outside");
    FORGED(m, NULL, k->slot, 1, "further windows: outside"); /* in the other's image */
    FORGED(m, NULL, k->at, second, "further windows: outside");
    FORGED(m, NULL, k->at, w->nowhere, "further windows: outside");
    FORGED(m, NULL, k->at, UINT32_MAX, "further windows: outside");
    FORGED(m, NULL, *k, over, "further windows: outside");
    for (size_t b = size; b < REC_WINDOW_MAX; b++)
        FORGED(m, NULL, k->w[b], 1, "further windows: outside");
    done(&m, &r);
    unlink(at("forged"));
}

/* What hangs over the end of an image and is 0 does no harm. */
T_CASE(windows_may_hang_over)
{
    struct rec_rig r = ring(2, 19, 15, 5, REC_BOX);
    for (int c = 0; c < 2; c++) { /* of one row */
        r.cameras[c].height = 1;
        r.cameras[c].cy = 0;
    }
    rec_sysmat *m = build(&r, 1, 1, 1);
    size_t size = rec_window_size(&m->win), i = 0;
    while (m->win.at[i] == m->win.nowhere)
        i++;
    T_EQ_I(rec_sysmat_save(m, at("forged"), NULL, NULL), PVX_OK);
    loads_as(m, at("forged"), NULL);
    FORGED(m, NULL, m->win.w[i * size + size - 1], 1, "weights: outside");
    done(&m, &r);
    unlink(at("forged"));
}

T_CASE(every_number_is_checked)
{
    struct rec_rig r;
    rec_sysmat *m = build_forgeable(&r);
    struct rec_sysmat_block *b = &m->block[1];
    struct rec_rect *fp = (struct rec_rect *)b->fp;
    size_t i = deep_window(m), j = i / (size_t)m->win.slots, size = rec_window_size(&m->win);
    struct rec_grid longer = m->grid, empty = m->grid, endless = m->grid;
    longer.n[0] = 32; /* has a coarser level, and no more bricks than are there */
    longer.n[1] = 4;
    longer.n[2] = 1;
    empty.n[0] = 0;
    endless.max[1] = NAN;
    FORGED(m, NULL, fp[j].x1, 19, "footprints of camera 1: outside");
    FORGED(m, NULL, fp[j].y1, 15, "footprints of camera 1: outside");
    FORGED(m, NULL, fp[j], ((struct rec_rect){1, 5, 2, 4}), "footprints");
    FORGED(m, NULL, m->grid, empty, "grid");
    FORGED(m, NULL, m->grid, endless, "grid");
    FORGED(m, NULL, m->unit, NAN, "parameters");
    FORGED(m, NULL, m->grid, longer, "number of levels");
    FORGED(m, NULL, m->rays_per_bin, 0, "parameters");
    FORGED(m, NULL, m->win.high, 1, "impossible shape of windows");
    FORGED(m, NULL, m->win.wide, 1, "impossible shape of windows");
    FORGED(m, NULL, m->win.wide, 3, "impossible shape of windows");
    /* an entry more or less than there are windows for */
    FORGED(m, NULL, b->nnz, b->nnz + 1, "number of entries");
    FORGED(m, NULL, b->nnz, UINT32_MAX, "number of entries");
    FORGED(m, NULL, b->nnz, UINT64_MAX, "number of entries");
    FORGED(m, NULL, m->win.n_more, m->win.n_more - 1, "number of entries");
    uint8_t full = 0;
    while (m->win.w[i * size + full] == 0)
        full++;
    FORGED(m, NULL, m->win.w[i * size + full], 0, "number of entries");
    T_EQ_I(rec_sysmat_save(m, at("forged"), NULL, NULL), PVX_OK); /* all put back */
    loads_as(m, at("forged"), NULL);
    done(&m, &r);
    unlink(at("forged"));
}

/* Damage on either side of a cut between pieces. */
static void damage_at_cuts(rec_sysmat *m, pvx_pool *pool, size_t piece)
{
    struct rec_windows *w = &m->win;
    size_t size = rec_window_size(w);
    for (size_t i = piece / size - 1; i <= piece / size + 1; i++) /* one lies in both */
        for (size_t k = 0; k < size; k += size - 1) {
            uint32_t was = w->at[i];
            uint8_t weights[REC_WINDOW_MAX];
            memcpy(weights, w->w + i * size, size);
            memset(w->w + i * size, 0, size);
            w->at[i] = w->nowhere;
            FORGED(m, pool, w->w[i * size + k], 1, "weights: outside");
            w->at[i] = was;
            memcpy(w->w + i * size, weights, size);
        }
    for (size_t i = piece / sizeof *w->more - 1; i <= piece / sizeof *w->more + 1; i++) {
        FORGED(m, pool, w->more[i].column, w->more[i - 1].column - 1, "windows: not ascending");
        FORGED(m, pool, w->more[i].slot, 5, "further windows: outside");
    }
}

/* Sections of several pieces, which several threads check, and damage on either side of a cut. */
T_CASE_OF_THREADS(sections_of_many_pieces)
{
    const size_t piece = 1 << 20;
    struct rec_rig r = ring(5, 160, 120, 44, REC_TRILINEAR);
    rec_sysmat *m = build(&r, 1, 1, 2);
    struct rec_windows *w = &m->win;
    size_t slots = (size_t)w->slots, size = rec_window_size(w), N = rec_grid_count(&m->grid);
    const char *path = at("large");
    struct pvx_diag d = {""};
    pvx_pool *pool;
    T_OK(N * slots * sizeof *w->at > piece && N * slots * size > piece && piece % size != 0);
    T_OK(w->n_more * sizeof *w->more > piece && piece % sizeof *w->more != 0);
    T_EQ_I(pvx_pool_new(3, "t", &pool), PVX_OK);
    T_EQ_I(rec_sysmat_save(m, path, pool, &d), PVX_OK);
    loads_as(m, path, pool);
    loads_as(m, path, NULL);
    for (size_t i = piece / sizeof *w->at - 1; i <= piece / sizeof *w->at; i++)
        FORGED(m, pool, w->at[i], (uint32_t)m->row0[4], "windows: outside");
    if (!T_TSAN)
        damage_at_cuts(m, pool, piece);
    unlink(at("forged"));
    pvx_pool_free(&pool);
    done(&m, &r);
    unlink(path);
}

/* `path` NULL: in the cache.  It came from its file, or not. */
static rec_sysmat *opened(const struct rec_rig *r, const char *path, bool cached)
{
    struct rec_sysmat_params p = {1, 1};
    rec_sysmat *m = NULL;
    T_EQ_I(rec_sysmat_open(r, &p, path, NULL, (struct rec_progress){0}, &m, NULL), PVX_OK);
    if (m == NULL)
        exit(1);
    T_EQ_I(m->cached, cached);
    return m;
}
/* want NULL: whatever is in it. */
static void opens(const struct rec_rig *r, const char *path, bool cached, const rec_sysmat *want)
{
    rec_sysmat *m = opened(r, path, cached);
    T_OK(want == NULL || same(want, m));
    rec_sysmat_free(&m);
}

T_CASE(cache_is_used_and_healed)
{
    struct rec_rig r = ring(2, 40, 30, 8, REC_BOX);
    struct rec_sysmat_params p = {1, 1};
    pvx_log_set_level(PVX_LOG_ERROR); /* the warnings are wanted, but not here */
    uint64_t key = key_of(&r, p);
    char path[256];
    setenv("PYROVOX_CACHE", at("deep/cache"), 1);
    snprintf(path, sizeof path, "%s/deep/cache/sysmat-%016llx.pvxm", dir, (unsigned long long)key);
    rec_sysmat *a = opened(&r, NULL, false), *b;
    T_OK(access(path, R_OK) == 0);
    opens(&r, NULL, true, a);
    /* cut short, and empty: rebuilt, then sound again */
    for (int cut = 0; cut < 2; cut++) {
        T_EQ_I(truncate(path, cut * 1000), 0);
        opens(&r, NULL, false, a);
        opens(&r, NULL, true, a);
    }
    /* of an older version: refused, and rebuilt */
    static const char two[4] = {2};
    FILE *f = fopen(path, "r+b");
    T_OK(f != NULL && fseek(f, 8, SEEK_SET) == 0 && fwrite(two, 4, 1, f) == 1 && fclose(f) == 0);
    struct pvx_diag old = {""};
    T_EQ_I(rec_sysmat_load(path, 0, true, NULL, &b, &old), PVX_EVERSION);
    T_CONTAINS(old.text, "matrix format 2, this program reads 5");
    opens(&r, NULL, false, a);
    opens(&r, NULL, true, a);
    /* a named file made for another rig is replaced ... */
    T_EQ_I(rec_sysmat_save(a, at("named"), NULL, NULL), PVX_OK);
    r.cameras[0].cx += 1;
    b = opened(&r, at("named"), false);
    T_OK(b->key != key);
    opens(&r, at("named"), true, b);
    rec_sysmat_free(&b);
    /* ... but one that is no matrix is somebody's */
    struct pvx_diag d = {""};
    T_EQ_I(pvx_file_write(at("thesis.txt"), "chapter one", 11, NULL), PVX_OK);
    T_EQ_I(rec_sysmat_open(&r, &p, at("thesis.txt"), NULL, (struct rec_progress){0}, &b, &d),
           PVX_EFORMAT);
    T_CONTAINS(d.text, "left alone");
    /* a cache that cannot be: the matrix all the same */
    setenv("PYROVOX_CACHE", at("thesis.txt"), 1);
    opens(&r, NULL, false, NULL);
    setenv("PYROVOX_CACHE", "", 1);
    setenv("XDG_CACHE_HOME", at("xdg"), 1);
    opens(&r, NULL, false, NULL);
    opens(&r, NULL, true, NULL);
    T_OK(access(at("xdg/pyrovox"), X_OK) == 0);
    rec_sysmat_free(&a);
    rec_rig_fini(&r);
    pvx_log_set_level(PVX_LOG_INFO);
}

/* Of three matrices the two used last stay. */
T_CASE(cache_keeps_what_is_used)
{
    static const double cx[] = {0, 1, 0, 3}; /* the first is used again before the third comes */
    struct rec_cached *file;
    char gb[32], first[PATH_MAX], third[PATH_MAX];
    size_t n;
    setenv("PYROVOX_CACHE", at("small"), 1);
    for (int i = 0; i < 4; i++) {
        struct rec_rig r = ring(2, 40, 30, 8, REC_BOX);
        r.cameras[0].cx += cx[i];
        rec_sysmat *m = opened(&r, NULL, i == 2);
        snprintf(i == 0 ? first : third, PATH_MAX, "%s",
                 at("small/sysmat-%016llx.pvxm", (unsigned long long)m->key));
        T_OK(rec_cache_list(&file, &n) == PVX_OK && n == (i == 0 ? 1 : 2));
        snprintf(gb, sizeof gb, "%.9f", 2.5e-9 * (double)file[0].bytes);
        for (size_t k = 0; k < n && i < 2; k++) /* long ago, in this order */
            T_EQ_I(utimensat(AT_FDCWD, file[k].path,
                             (struct timespec[]){{.tv_sec = 1}, {.tv_sec = 1000 + 10 * i + (int)k}},
                             0),
                   0);
        setenv("PYROVOX_CACHE_MAX", gb, 1);
        free(file);
        rec_sysmat_free(&m);
        rec_rig_fini(&r);
    }
    T_OK(rec_cache_list(&file, &n) == PVX_OK && n == 2);
    T_OK(access(first, R_OK) == 0 && access(third, R_OK) == 0);
    free(file);
    unsetenv("PYROVOX_CACHE_MAX");
}

/* A disk that fills up, as the file size limit has it: said so, and nothing left behind. */
T_CASE(full_disk)
{
    struct rec_rig r = ring(2, 60, 40, 16, REC_BOX);
    rec_sysmat *m = build(&r, 1, 1, 1);
    struct rlimit old, small = {65536, 65536};
    struct pvx_diag d = {""};
    int before = files_in_dir();
    signal(SIGXFSZ, SIG_IGN);
    T_EQ_I(getrlimit(RLIMIT_FSIZE, &old), 0);
    small.rlim_max = old.rlim_max;
    T_EQ_I(setrlimit(RLIMIT_FSIZE, &small), 0);
    pvx_err e = rec_sysmat_save(m, at("full"), NULL, &d);
    T_EQ_I(setrlimit(RLIMIT_FSIZE, &old), 0);
    T_EQ_I(e, PVX_ENOSPC);
    T_CONTAINS(d.text, "full");
    T_EQ_I(files_in_dir(), before);
    T_EQ_I(rec_sysmat_save(m, "/nonexistent/dir/m", NULL, &d), PVX_ENOENT);
    done(&m, &r);
}

/* Processes that build one cache at once: each gets the matrix, and the file is whole. */
T_CASE(two_processes_one_cache)
{
    struct rec_rig r = ring(2, 60, 44, 12, REC_BOX);
    rec_sysmat *m = build(&r, 1, 1, 1);
    struct rec_sysmat_params p = {1, 1};
    char path[256];
    snprintf(path, sizeof path, "%s", at("shared.pvxm"));
    pid_t child[4];
    for (int i = 0; i < 4; i++) {
        child[i] = fork();
        if (child[i] == 0) {
            int bad = 0;
            for (int n = 0; n < 10; n++) {
                rec_sysmat *mine;
                unlink(path);
                if (rec_sysmat_open(&r, &p, path, NULL, (struct rec_progress){0}, &mine, NULL) !=
                    PVX_OK)
                    _exit(2);
                bad += !same(m, mine);
                rec_sysmat_free(&mine);
            }
            _exit(bad);
        }
    }
    for (int i = 0; i < 4; i++) {
        int status = -1;
        waitpid(child[i], &status, 0);
        T_EQ_I(status, 0);
    }
    loads_as(m, path, NULL);
    done(&m, &r);
    unlink(path);
}

T_MAIN(scratch_new(), scratch_remove())
