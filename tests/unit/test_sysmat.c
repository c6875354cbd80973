#include "recon/matrix/sysmat.h"

#include <signal.h>
#include <stdbool.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>
#include "base/file.h"
#include "base/log.h"
#include "recon/geom/traverse.h"
#include "tests/t.h"

static char dir[] = "/tmp/pyrovox-sysmat-XXXXXX";

static const char *in_dir(const char *name)
{
    static char path[4][256];
    static int next;
    next = (next + 1) % 4;
    snprintf(path[next], sizeof path[next], "%s/%s", dir, name);
    return path[next];
}

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

static rec_sysmat *build(const struct rec_rig *r, int32_t binning, int32_t rays, unsigned threads)
{
    struct rec_sysmat_params p = {binning, rays};
    struct pvx_diag d = {""};
    pvx_pool *pool;
    rec_sysmat *m = NULL;
    T_EQ_I(pvx_pool_new(threads, "t", &pool), PVX_OK);
    T_EQ_I(rec_sysmat_build(r, &p, pool, NULL, NULL, &m, &d), PVX_OK);
    T_EQ_S(d.text, "");
    pvx_pool_free(&pool);
    if (m == NULL)
        exit(1);
    return m;
}

static bool same_level(const rec_sysmat *a, const rec_sysmat *b)
{
    size_t N = rec_grid_count(&a->grid);
    if (memcmp(&a->grid, &b->grid, sizeof a->grid) != 0 || a->n_cameras != b->n_cameras ||
        a->key != b->key || a->nnz != b->nnz || a->binning != b->binning || a->unit != b->unit ||
        a->rays_per_bin != b->rays_per_bin || memcmp(a->colptr, b->colptr, (N + 1) * 4) != 0 ||
        memcmp(a->row, b->row, a->nnz * 4) != 0 || memcmp(a->val, b->val, a->nnz * 2) != 0)
        return false;
    for (size_t c = 0; c < a->n_cameras; c++) {
        const struct rec_sysmat_block *p = &a->block[c], *q = &b->block[c];
        if (p->bw != q->bw || p->bh != q->bh || p->nnz != q->nnz ||
            a->row0[c + 1] != b->row0[c + 1] || memcmp(p->fp, q->fp, N * 8) != 0)
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
    for (uint64_t e = 0; e < m->nnz; e++)
        sum[m->row[e]] += rec_sysmat_value(m, e);
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
    rec_sysmat_free(&m);
    rec_rig_fini(&r);
}
static void row_sums_are_chords(void)
{
    row_sums(1, 1);
}
static void row_sums_of_binned_rows(void)
{
    row_sums(2, 2);
    row_sums(4, 1);
    row_sums(1, 3);
    row_sums(3, 5);
}

/* At 64 voxels a side half a unit is below 1e-6 of the chord. */
static void row_sums_at_64(void)
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
        T_NEAR(sum[i], want, 1e-6 * want);
        ordinary++;
    }
    T_OK(ordinary > 600);
    free(sum);
    rec_sysmat_free(&m);
    rec_rig_fini(&r);
}

/* Every entry once more, straight from the ray; nothing else is stored. */
static void entries(enum rec_basis basis, int32_t binning, int32_t rays)
{
    struct rec_rig r = ring(2, 32, 24, 9, basis);
    r.grid.n[1] = 7;
    r.grid.n[2] = 11;
    rec_sysmat *m = build(&r, binning, rays, 3);
    size_t N = rec_grid_count(&r.grid);
    double *want = calloc(N, sizeof *want), worst = 0;
    int32_t *index = malloc(rec_traverse_max(&r.grid) * sizeof *index);
    float *value = malloc(rec_traverse_max(&r.grid) * sizeof *value);
    uint32_t *at = malloc(N * sizeof *at);
    memcpy(at, m->colptr, N * sizeof *at);
    for (uint32_t row = 0; row < m->row0[2]; row++) {
        size_t c = row >= m->row0[1];
        uint32_t bw = (uint32_t)m->block[c].bw, bin = row - (uint32_t)m->row0[c];
        memset(want, 0, N * sizeof *want);
        for (int q = 0; q < rays * rays; q++) {
            double u = (bin % bw + (q % rays + 0.5) / rays) * binning - 0.5;
            double v = (bin / bw + (q / rays + 0.5) / rays) * binning - 0.5;
            double o[3], d[3];
            T_OK(rec_camera_ray(&r.cameras[c], u, v, o, d));
            size_t n = rec_traverse(&r.grid, o, d, index, value);
            for (size_t i = 0; i < n; i++)
                want[index[i]] += value[i] / (rays * rays);
        }
        for (size_t j = 0; j < N; j++) {
            double got = 0;
            if (at[j] < m->colptr[j + 1] && m->row[at[j]] == row) {
                got = rec_sysmat_value(m, at[j]++);
                T_OK(want[j] > 0); /* nothing that no ray meets */
            }
            worst = fmax(worst, fabs(got - want[j]));
        }
    }
    for (size_t j = 0; j < N; j++) /* all used: rows ascend and none is there twice */
        T_EQ_I(at[j], m->colptr[j + 1]);
    free(at);
    T_LE(worst, 1.0001 * m->unit);
    free(want);
    free(index);
    free(value);
    rec_sysmat_free(&m);
    rec_rig_fini(&r);
}
static void entries_of_box(void)
{
    entries(REC_BOX, 1, 1);
    entries(REC_BOX, 2, 3);
}
static void entries_of_trilinear(void)
{
    entries(REC_TRILINEAR, 1, 1);
    entries(REC_TRILINEAR, 4, 2);
}

static void same_bits_for_any_threads(void)
{
    for (int basis = 0; basis < 2; basis++)
        for (int rays = 1; rays < 3; rays++) {
            struct rec_rig r = ring(3, 60, 44, 31, basis == 0 ? REC_BOX : REC_TRILINEAR);
            T_EQ_I(rec_sysmat_levels(&r.grid), 2);
            rec_sysmat *one = build(&r, 2, rays, 1);
            static const unsigned threads[] = {2, 3, 5};
            for (int i = 0; i < 3; i++) {
                rec_sysmat *m = build(&r, 2, rays, threads[i]);
                T_OK(same(one, m));
                rec_sysmat_free(&m);
            }
            struct rec_sysmat_params p = {2, rays};
            rec_sysmat *serial;
            T_EQ_I(rec_sysmat_build(&r, &p, NULL, NULL, NULL, &serial, NULL), PVX_OK);
            T_OK(same(one, serial));
            rec_sysmat_free(&serial);
            rec_sysmat_free(&one);
            rec_rig_fini(&r);
        }
}

static void in_footprint(const struct rec_sysmat_block *b, size_t col, double u, double v,
                         int32_t binning)
{
    double x = floor((u + 0.5) / binning), y = floor((v + 0.5) / binning);
    if (x < 0 || y < 0 || x >= b->bw || y >= b->bh)
        return;
    struct rec_rect r = b->fp[col];
    T_OK(rec_rect_seen(r) && x >= r.x0 && x <= r.x1 && y >= r.y0 && y <= r.y1);
}

static void entries_in_footprint(const rec_sysmat *m, size_t c, size_t j, int32_t binning)
{
    const struct rec_sysmat_block *b = &m->block[c];
    for (uint32_t e = m->colptr[j]; e < m->colptr[j + 1]; e++) {
        if (m->row[e] < m->row0[c] || m->row[e] >= m->row0[c + 1])
            continue;
        uint32_t bin = m->row[e] - (uint32_t)m->row0[c], bw = (uint32_t)b->bw;
        in_footprint(b, j, bin % bw * binning, bin / bw * binning, binning);
    }
}

/* Points anywhere in a support, and all entries, are inside the footprint; and it is not much larger
 * than the points show.  Strong lenses, coarse grids. */
static void footprints_hold_their_support(void)
{
    static const double lens[3][8] = {
        {0}, {-0.28, 0.09, 4e-3, -6e-3}, {0.5, 0.3, 2e-3, 2e-3, 0.2, 0.1}};
    for (int t = 0; t < 12; t++) {
        struct rec_rig r = ring(2, 96, 64, t % 3 == 0 ? 2 : 7, t % 2 ? REC_TRILINEAR : REC_BOX);
        int32_t binning = t % 4 < 2 ? 1 : 4;
        for (int c = 0; c < 2; c++) {
            memcpy(r.cameras[c].dist, lens[t / 4], sizeof lens[0]);
            r.cameras[c].fx *= 1.6; /* part of the volume is outside the image */
        }
        rec_sysmat *m = build(&r, binning, 2, 2);
        double reach = r.grid.basis == REC_TRILINEAR ? 1 : 0.5, area = 0, spread = 0;
        for (size_t c = 0; c < 2; c++) {
            const struct rec_sysmat_block *b = &m->block[c];
            for (int32_t j = 0; j < (int32_t)rec_grid_count(&r.grid); j++) {
                double mid[3], X[3], uv[2], lo[2] = {1e9, 1e9}, hi[2] = {-1e9, -1e9};
                rec_grid_centre(&r.grid, j, mid);
                for (int i = 0; i < 200; i++) {
                    for (int a = 0; a < 3; a++) {
                        double f =
                            i < 100 && t_rand() % 2 ? (t_rand() % 2 ? 1 : -1) : t_uniform(-1, 1);
                        X[a] = mid[a] + f * reach * rec_grid_h(&r.grid, a) * (1 - 1e-9);
                    }
                    if (!rec_camera_project(&r.cameras[c], X, uv))
                        continue;
                    in_footprint(b, (size_t)j, uv[0], uv[1], binning);
                    for (int a = 0; a < 2; a++) {
                        lo[a] = fmin(lo[a], uv[a]);
                        hi[a] = fmax(hi[a], uv[a]);
                    }
                }
                entries_in_footprint(m, c, (size_t)j, binning);
                struct rec_rect f = b->fp[j];
                if (rec_rect_seen(f) && lo[0] > 0 && lo[1] > 0 && hi[0] < 95 && hi[1] < 63) {
                    area += (f.x1 - f.x0 + 1) * (f.y1 - f.y0 + 1);
                    spread += ((hi[0] - lo[0]) / binning + 2) * ((hi[1] - lo[1]) / binning + 2);
                }
            }
        }
        T_OK(area > 0);
        /* supports of half the volume behind the strongest lens: the bound on its bend is loose */
        T_LE(area, (r.grid.n[0] == 2 ? 2.5 : 1.25) * spread);
        rec_sysmat_free(&m);
        rec_rig_fini(&r);
    }
}

/* A camera in the middle of the volume: half of it is behind, and the rest is all over the image. */
static void camera_inside_the_volume(void)
{
    for (int basis = 0; basis < 2; basis++) {
        struct rec_rig r = ring(1, 40, 30, 10, basis == 0 ? REC_BOX : REC_TRILINEAR);
        struct rec_camera *c = &r.cameras[0];
        double inside[3] = {0.03, 0.01, 0.52};
        for (int i = 0; i < 3; i++)
            c->t[i] = -(c->R[3 * i] * inside[0] + c->R[3 * i + 1] * inside[1] +
                        c->R[3 * i + 2] * inside[2]);
        rec_sysmat *m = build(&r, 1, 1, 2);
        const struct rec_sysmat_block *b = &m->block[0];
        size_t behind = 0, whole = 0;
        double sum = 0, want = 0, o[3], d[3];
        for (int32_t j = 0; j < 1000; j++) {
            struct rec_rect f = b->fp[j];
            behind += !rec_rect_seen(f);
            whole += f.x0 == 0 && f.y0 == 0 && f.x1 == 39 && f.y1 == 29;
            entries_in_footprint(m, 0, (size_t)j, 1);
        }
        for (uint64_t e = 0; e < m->nnz; e++)
            sum += rec_sysmat_value(m, e);
        for (int i = 0; i < 1200; i++)
            if (rec_camera_ray(c, i % 40, i / 40, o, d))
                want += chord(&r.grid, o, d);
        if (basis == 0)
            T_NEAR(sum, want, 1e-6 * want + 0.5 * 1200 * m->unit);
        T_OK(behind > 300);
        T_OK(whole >= 1);
        rec_sysmat_free(&m);
        rec_rig_fini(&r);
    }
}

/* R A P by its definition, entry by entry, in images and grids of odd sides. */
static void coarse_level_is_r_a_p(void)
{
    for (int basis = 0; basis < 2; basis++) {
        struct rec_rig r = ring(2, 33, 25, 9, basis == 0 ? REC_BOX : REC_TRILINEAR);
        r.cameras[1].width = 30;
        r.grid.n[1] = 8;
        r.grid.n[2] = 1 + 4 * basis;
        rec_sysmat *m = build(&r, 1, 2, 2), *c;
        T_EQ_I(rec_sysmat_coarsen(m, NULL, &c, NULL), PVX_OK);
        const struct rec_grid *f = &m->grid, *g = &c->grid;
        T_OK(g->n[0] == 5 && g->n[1] == 4 && g->n[2] == 1 + 2 * basis && g->basis == f->basis);
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
            for (uint32_t e = m->colptr[j]; e < m->colptr[j + 1]; e++) {
                size_t cam = m->row[e] >= m->row0[1], bin = m->row[e] - m->row0[cam];
                size_t bw = (size_t)m->block[cam].bw, x = bin % bw, y = bin / bw;
                double share = (x == bw - 1 && bw % 2 ? 1 : 0.5) * (y == 24 ? 1 : 0.5);
                size_t row = c->row0[cam] + y / 2 * (size_t)c->block[cam].bw + x / 2;
                want[row * N + J] += share * rec_sysmat_value(m, e);
                sum[row] += share * rec_sysmat_value(m, e);
            }
        }
        double worst = 0, *got_sum = sums_of_rows(c);
        size_t stored = 0;
        for (size_t J = 0; J < N; J++)
            for (uint32_t e = c->colptr[J]; e < c->colptr[J + 1]; e++) {
                T_OK(e == c->colptr[J] || c->row[e] > c->row[e - 1]);
                double *w = &want[c->row[e] * N + J];
                worst = fmax(worst, fabs(*w - rec_sysmat_value(c, e)));
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
        rec_sysmat_free(&c);
        rec_sysmat_free(&m);
        rec_rig_fini(&r);
    }
}

/* For the box basis the coarse level is the matrix of the coarser grid, whose bins have the rays of
 * their children; footprints hold the entries on every level. */
static void coarse_box_is_the_coarse_grid(void)
{
    struct rec_rig r = ring(2, 64, 48, 64, REC_BOX);
    rec_sysmat *m = build(&r, 1, 1, 2);
    T_EQ_I(rec_sysmat_levels(&r.grid), 3);
    const rec_sysmat *level = m->coarse;
    for (int k = 1; k <= 2; k++, level = level->coarse) {
        struct rec_rig rk = ring(2, 64, 48, 64 >> k, REC_BOX);
        rec_sysmat *want = build(&rk, 1 << k, 1 << k, 2);
        size_t N = rec_grid_count(&want->grid), entries = 0;
        double *column = calloc(want->row0[2], sizeof *column), worst = 0;
        T_OK(level != NULL && rec_grid_count(&level->grid) == N);
        T_EQ_I(level->row0[2], want->row0[2]);
        T_EQ_I(level->binning, 1 << k);
        for (size_t j = 0; j < N; j++) {
            for (uint32_t e = want->colptr[j]; e < want->colptr[j + 1]; e++)
                column[want->row[e]] += rec_sysmat_value(want, e);
            for (uint32_t e = level->colptr[j]; e < level->colptr[j + 1]; e++) {
                column[level->row[e]] -= rec_sysmat_value(level, e);
                worst = fmax(worst, fabs(column[level->row[e]]));
                column[level->row[e]] = 0;
                entries++;
            }
            for (uint32_t e = want->colptr[j]; e < want->colptr[j + 1]; e++) {
                worst = fmax(worst, fabs(column[want->row[e]]));
                column[want->row[e]] = 0;
            }
            entries_in_footprint(level, 0, j, 1 << k);
            entries_in_footprint(level, 1, j, 1 << k);
        }
        T_OK(entries > 10000);
        T_LE(worst, 3 * (double)want->unit);
        free(column);
        rec_sysmat_free(&want);
        rec_rig_fini(&rk);
    }
    T_OK(level == NULL);
    rec_sysmat_free(&m);
    rec_rig_fini(&r);
}

static void camera_that_sees_nothing(void)
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
        T_OK(!rec_rect_seen(m->block[1].fp[j]));
    T_EQ_I(rec_sysmat_save(m, in_dir("blind"), NULL, NULL), PVX_OK);
    rec_sysmat *l;
    T_EQ_I(rec_sysmat_load(in_dir("blind"), m->key, true, NULL, &l, NULL), PVX_OK);
    T_OK(same(m, l));
    rec_sysmat_free(&l);
    rec_sysmat_free(&m);
    rec_rig_fini(&r);
    unlink(in_dir("blind"));
}

static void autos_resolve(void)
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

static void key_depends_on_everything(void)
{
    struct rec_rig r = ring(2, 64, 48, 8, REC_BOX);
    struct rec_sysmat_params p = {1, 1}, q = {2, 1}, s = {1, 2}, autos = {0, 0}, resolved;
    uint64_t k, k2;
    T_EQ_I(rec_sysmat_key(&r, &p, &k, NULL), PVX_OK);
    T_EQ_I(rec_sysmat_key(&r, &q, &k2, NULL), PVX_OK);
    T_OK(k2 != k);
    T_EQ_I(rec_sysmat_key(&r, &s, &k2, NULL), PVX_OK);
    T_OK(k2 != k);
    T_EQ_I(rec_sysmat_resolve(&r, &autos, &resolved, NULL), PVX_OK);
    uint64_t ka, kr;
    T_EQ_I(rec_sysmat_key(&r, &autos, &ka, NULL), PVX_OK);
    T_EQ_I(rec_sysmat_key(&r, &resolved, &kr, NULL), PVX_OK);
    T_OK(ka == kr);
    r.cameras[1].fx *= 1.000001;
    T_EQ_I(rec_sysmat_key(&r, &p, &k2, NULL), PVX_OK);
    T_OK(k2 != k);
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

static void progress_and_cancel(void)
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
        T_EQ_I(rec_sysmat_open(&r, &rec_sysmat_defaults, in_dir("canceled"), pool, cancel_at, &c,
                               &m, NULL, NULL),
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

static void save_and_load(void)
{
    for (int basis = 0; basis < 2; basis++) {
        struct rec_rig r = ring(3, 50, 30, 9, basis == 0 ? REC_BOX : REC_TRILINEAR);
        rec_sysmat *m = build(&r, 1, 1, 2), *l = NULL;
        const char *path = in_dir("m.pvxm");
        struct pvx_diag d = {""};
        T_EQ_I(rec_sysmat_save(m, path, NULL, &d), PVX_OK);
        for (int i = 0; i < 4; i++) {
            T_EQ_I(rec_sysmat_load(path, i & 1 ? m->key : 0, i & 2, NULL, &l, &d), PVX_OK);
            T_OK(l != NULL && same(m, l));
            for (const rec_sysmat *k = l; k != NULL; k = k->coarse) {
                T_EQ_I((uintptr_t)k->colptr % 64, 0);
                T_EQ_I((uintptr_t)k->row % 64, 0);
                T_EQ_I((uintptr_t)k->val % 64, 0);
                for (size_t c = 0; c < 3; c++)
                    T_EQ_I((uintptr_t)k->block[c].fp % 64, 0);
            }
            rec_sysmat_free(&l);
        }
        T_EQ_I(rec_sysmat_load(path, m->key + 1, true, NULL, &l, &d), PVX_ESTALE);
        T_CONTAINS(d.text, "m.pvxm: made for another rig");
        T_OK(l == NULL);
        T_EQ_I(files_in_dir(), 1); /* no temporary left */
        rec_sysmat_free(&m);
        rec_rig_fini(&r);
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
    char *data;
    T_EQ_I(rec_sysmat_save(m, in_dir("good"), NULL, NULL), PVX_OK);
    T_EQ_I(pvx_file_read(in_dir("good"), 1 << 24, &data, n, NULL), PVX_OK);
    rec_sysmat_free(&m);
    rec_rig_fini(&r);
    unlink(in_dir("good"));
    return data;
}

/* Header, and table with one row per camera and then per level, of a file of two cameras. */
#define HEAD(levels) (128 + 2 * 8 + (levels) * (2 * 8 + 5 * 24))
/* Where section s of a level lies: offset and bytes. */
static void section_at(const char *data, int level, int s, uint64_t at[2])
{
    memcpy(at, data + HEAD(level) + 2 * 8 + 24 * s, 16);
}

static pvx_err load_bytes(const char *data, size_t n, struct pvx_diag *d)
{
    rec_sysmat *m;
    d->text[0] = '\0';
    FILE *f = fopen(in_dir("bad"), "wb"); /* pvx_file_write waits for the disk, 1000 times here */
    T_OK(f != NULL && fwrite(data, 1, n, f) == n && fclose(f) == 0);
    pvx_err e = rec_sysmat_load(in_dir("bad"), 0, true, NULL, &m, d);
    T_OK((e == PVX_OK) == (m != NULL));
    rec_sysmat_free(&m);
    unlink(in_dir("bad"));
    return e;
}

static void every_flipped_byte_is_found(void)
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
static void damage_names_the_section(void)
{
    static const char *const name[5] = {"column starts", "rows", "values", "footprints of camera 0",
                                        "footprints of camera 1"};
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

static void every_length_but_one_is_refused(void)
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
    T_EQ_I(rec_sysmat_load(in_dir("absent"), 0, true, NULL, &m, &d), PVX_ENOENT);
    T_EQ_I(rec_sysmat_load(dir, 0, true, NULL, &m, &d), PVX_EFORMAT);
    T_EQ_I(rec_sysmat_load("/dev/null", 0, true, NULL, &m, &d), PVX_EFORMAT);
}

/* Wrong contents under right checksums: what a bug or a forger would write. */
static void every_index_is_checked(void)
{
    struct rec_rig r = ring(1, 20, 16, 5, REC_BOX);
    rec_sysmat *m = build(&r, 1, 1, 1);
    struct rec_sysmat_block *b = &m->block[0];
    uint32_t *colptr = (uint32_t *)m->colptr, *row = (uint32_t *)m->row;
    uint16_t *val = (uint16_t *)m->val;
    struct rec_rect *fp = (struct rec_rect *)b->fp;
    size_t full = 0; /* a column with entries */
    while (colptr[full + 1] < colptr[full] + 2)
        full++;
    uint32_t e = colptr[full];
#define REFUSED(what, part)                                                               \
    do {                                                                                  \
        struct pvx_diag d_ = {""};                                                        \
        rec_sysmat *l_;                                                                   \
        what;                                                                             \
        T_EQ_I(rec_sysmat_save(m, in_dir("forged"), NULL, NULL), PVX_OK);                 \
        T_EQ_I(rec_sysmat_load(in_dir("forged"), 0, true, NULL, &l_, &d_), PVX_ECORRUPT); \
        T_CONTAINS(d_.text, part);                                                        \
    } while (0)
    uint32_t c1 = colptr[1], c2 = colptr[full + 1], r0 = row[e], r1 = row[e + 1];
    uint16_t v = val[e];
    struct rec_rect f = fp[full];
    REFUSED(colptr[0] = 1, "column starts");
    colptr[0] = 0;
    REFUSED(colptr[full + 1] = UINT32_MAX, "column starts");
    colptr[full + 1] = c2;
    REFUSED(colptr[125] += 1, "column starts");
    colptr[125] -= 1;
    REFUSED(colptr[1] = colptr[2] + 1, "column starts");
    colptr[1] = c1;
    REFUSED(row[e + 1] = 320, "rows: outside");
    row[e + 1] = r1;
    REFUSED(row[e] = r1, "rows: not ascending");
    row[e] = r0;
    REFUSED(val[e] = 0, "values: outside");
    val[e] = v;
    REFUSED(fp[full].x1 = 20, "footprints of camera 0: outside");
    fp[full] = f;
    REFUSED(fp[full].y1 = 16, "footprints of camera 0: outside");
    fp[full] = f;
    REFUSED(fp[full] = ((struct rec_rect){1, 5, 2, 4}), "footprints");
    fp[full] = f;
    REFUSED(m->grid.n[0] = 0, "grid");
    m->grid.n[0] = 5;
    REFUSED(m->grid.max[1] = NAN, "grid");
    m->grid.max[1] = 0.5;
    REFUSED(b->nnz += 1, "does not lie where it should");
    b->nnz -= 1;
    float unit = m->unit;
    REFUSED(m->unit = NAN, "parameters");
    m->unit = unit;
    static const int32_t line[3] = {125, 1, 1}, cube[3] = {5, 5, 5};
    REFUSED(memcpy(m->grid.n, line, sizeof line), "number of levels");
    memcpy(m->grid.n, cube, sizeof cube);
    REFUSED(m->rays_per_bin = 0, "parameters");
    m->rays_per_bin = 1;
    rec_sysmat *l;
    T_EQ_I(rec_sysmat_save(m, in_dir("forged"), NULL, NULL), PVX_OK); /* all put back */
    T_EQ_I(rec_sysmat_load(in_dir("forged"), 0, true, NULL, &l, NULL), PVX_OK);
    rec_sysmat_free(&l);
    rec_sysmat_free(&m);
    rec_rig_fini(&r);
    unlink(in_dir("forged"));
}

/* Sections of several pieces, which several threads check: as many entries as a piece has rows, and
 * damage on either side of the cut. */
static void sections_of_many_pieces(void)
{
    const uint32_t cut = (1 << 20) / 4;
    struct rec_rig r;
    rec_sysmat *m, *l;
    size_t j;
    for (int32_t side = 64;; side++) { /* until the cut goes through a column */
        r = ring(3, 80, 60, side, REC_TRILINEAR);
        m = build(&r, 1, 1, 2);
        T_OK(m->nnz > cut + 1 && side < 80);
        for (j = 0; m->colptr[j + 1] <= cut;)
            j++;
        if (m->colptr[j] < cut && cut + 1 < m->colptr[j + 1])
            break;
        rec_sysmat_free(&m);
        rec_rig_fini(&r);
    }
    const char *path = in_dir("large");
    struct pvx_diag d = {""};
    pvx_pool *pool;
    T_EQ_I(pvx_pool_new(3, "t", &pool), PVX_OK);
    T_EQ_I(rec_sysmat_save(m, path, pool, &d), PVX_OK);
    for (int i = 0; i < 2; i++) {
        T_EQ_I(rec_sysmat_load(path, m->key, true, i == 0 ? pool : NULL, &l, &d), PVX_OK);
        T_OK(same(m, l));
        rec_sysmat_free(&l);
    }
    uint32_t *row = (uint32_t *)m->row, *colptr = (uint32_t *)m->colptr;
    for (uint32_t e = cut; e <= cut + 1; e++) {
        uint32_t old = row[e];
        row[e] = row[e - 1];
        d.text[0] = '\0';
        T_EQ_I(rec_sysmat_save(m, path, pool, &d), PVX_OK);
        T_EQ_I(rec_sysmat_load(path, 0, true, pool, &l, &d), PVX_ECORRUPT);
        T_CONTAINS(d.text, "rows: not ascending");
        row[e] = old;
    }
    uint32_t old = colptr[cut - 1];
    colptr[cut - 1] = colptr[cut] + 1;
    d.text[0] = '\0';
    T_EQ_I(rec_sysmat_save(m, path, pool, &d), PVX_OK);
    T_EQ_I(rec_sysmat_load(path, 0, true, pool, &l, &d), PVX_ECORRUPT);
    T_CONTAINS(d.text, "column starts: not ascending");
    colptr[cut - 1] = old;
    pvx_pool_free(&pool);
    rec_sysmat_free(&m);
    rec_rig_fini(&r);
    unlink(path);
}

static void cache_is_used_and_healed(void)
{
    struct rec_rig r = ring(2, 40, 30, 8, REC_BOX);
    struct rec_sysmat_params p = {1, 1};
    pvx_log_set_level(PVX_LOG_ERROR); /* the warnings are wanted, but not here */
    uint64_t key;
    bool cached;
    rec_sysmat *a, *b;
    char path[256];
    setenv("PYROVOX_CACHE", in_dir("deep/cache"), 1);
    T_EQ_I(rec_sysmat_key(&r, &p, &key, NULL), PVX_OK);
    snprintf(path, sizeof path, "%s/deep/cache/sysmat-%016llx.pvxm", dir, (unsigned long long)key);
    T_EQ_I(rec_sysmat_open(&r, &p, NULL, NULL, NULL, NULL, &a, &cached, NULL), PVX_OK);
    T_OK(!cached && access(path, R_OK) == 0);
    T_EQ_I(rec_sysmat_open(&r, &p, NULL, NULL, NULL, NULL, &b, &cached, NULL), PVX_OK);
    T_OK(cached && same(a, b));
    rec_sysmat_free(&b);
    /* cut short, and empty: rebuilt, then sound again */
    for (int cut = 0; cut < 2; cut++) {
        T_EQ_I(truncate(path, cut * 1000), 0);
        T_EQ_I(rec_sysmat_open(&r, &p, NULL, NULL, NULL, NULL, &b, &cached, NULL), PVX_OK);
        T_OK(!cached && same(a, b));
        rec_sysmat_free(&b);
        T_EQ_I(rec_sysmat_open(&r, &p, NULL, NULL, NULL, NULL, &b, &cached, NULL), PVX_OK);
        T_OK(cached && same(a, b));
        rec_sysmat_free(&b);
    }
    /* a named file made for another rig is replaced ... */
    T_EQ_I(rec_sysmat_save(a, in_dir("named"), NULL, NULL), PVX_OK);
    r.cameras[0].cx += 1;
    T_EQ_I(rec_sysmat_open(&r, &p, in_dir("named"), NULL, NULL, NULL, &b, &cached, NULL), PVX_OK);
    T_OK(!cached && b->key != key);
    rec_sysmat_free(&b);
    T_EQ_I(rec_sysmat_open(&r, &p, in_dir("named"), NULL, NULL, NULL, &b, &cached, NULL), PVX_OK);
    T_OK(cached);
    rec_sysmat_free(&b);
    /* ... but one that is no matrix is somebody's */
    struct pvx_diag d = {""};
    T_EQ_I(pvx_file_write(in_dir("thesis.txt"), "chapter one", 11, NULL), PVX_OK);
    T_EQ_I(rec_sysmat_open(&r, &p, in_dir("thesis.txt"), NULL, NULL, NULL, &b, &cached, &d),
           PVX_EFORMAT);
    T_CONTAINS(d.text, "left alone");
    /* a cache that cannot be: the matrix all the same */
    setenv("PYROVOX_CACHE", in_dir("thesis.txt"), 1);
    T_EQ_I(rec_sysmat_open(&r, &p, NULL, NULL, NULL, NULL, &b, &cached, NULL), PVX_OK);
    T_OK(!cached);
    rec_sysmat_free(&b);
    setenv("PYROVOX_CACHE", "", 1);
    setenv("XDG_CACHE_HOME", in_dir("xdg"), 1);
    T_EQ_I(rec_sysmat_open(&r, &p, NULL, NULL, NULL, NULL, &b, &cached, NULL), PVX_OK);
    rec_sysmat_free(&b);
    T_EQ_I(rec_sysmat_open(&r, &p, NULL, NULL, NULL, NULL, &b, &cached, NULL), PVX_OK);
    T_OK(cached && access(in_dir("xdg/pyrovox"), X_OK) == 0);
    rec_sysmat_free(&b);
    rec_sysmat_free(&a);
    rec_rig_fini(&r);
    pvx_log_set_level(PVX_LOG_INFO);
}

/* A disk that fills up, as the file size limit has it: said so, and nothing left behind. */
static void full_disk(void)
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
    pvx_err e = rec_sysmat_save(m, in_dir("full"), NULL, &d);
    T_EQ_I(setrlimit(RLIMIT_FSIZE, &old), 0);
    T_EQ_I(e, PVX_ENOSPC);
    T_CONTAINS(d.text, "full");
    T_EQ_I(files_in_dir(), before);
    T_EQ_I(rec_sysmat_save(m, "/nonexistent/dir/m", NULL, &d), PVX_ENOENT);
    rec_sysmat_free(&m);
    rec_rig_fini(&r);
}

/* Processes that build one cache at once: each gets the matrix, and the file is whole. */
static void two_processes_one_cache(void)
{
    struct rec_rig r = ring(2, 60, 44, 12, REC_BOX);
    rec_sysmat *m = build(&r, 1, 1, 1), *l;
    struct rec_sysmat_params p = {1, 1};
    char path[256];
    snprintf(path, sizeof path, "%s", in_dir("shared.pvxm"));
    pid_t child[4];
    for (int i = 0; i < 4; i++) {
        child[i] = fork();
        if (child[i] == 0) {
            int bad = 0;
            for (int n = 0; n < 10; n++) {
                rec_sysmat *mine;
                unlink(path);
                if (rec_sysmat_open(&r, &p, path, NULL, NULL, NULL, &mine, NULL, NULL) != PVX_OK)
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
    T_EQ_I(rec_sysmat_load(path, m->key, true, NULL, &l, NULL), PVX_OK);
    T_OK(l != NULL && same(m, l));
    rec_sysmat_free(&l);
    rec_sysmat_free(&m);
    rec_rig_fini(&r);
    unlink(path);
}

int main(void)
{
    if (mkdtemp(dir) == NULL)
        return 1;
    T_RUN(row_sums_are_chords);
    T_RUN(row_sums_of_binned_rows);
    T_RUN(row_sums_at_64);
    T_RUN(entries_of_box);
    T_RUN(entries_of_trilinear);
    T_RUN(same_bits_for_any_threads);
    T_RUN(footprints_hold_their_support);
    T_RUN(camera_inside_the_volume);
    T_RUN(coarse_level_is_r_a_p);
    T_RUN(coarse_box_is_the_coarse_grid);
    T_RUN(camera_that_sees_nothing);
    T_RUN(autos_resolve);
    T_RUN(key_depends_on_everything);
    T_RUN(progress_and_cancel);
    T_RUN(save_and_load);
    T_RUN(every_flipped_byte_is_found);
    T_RUN(damage_names_the_section);
    T_RUN(every_length_but_one_is_refused);
    T_RUN(every_index_is_checked);
    T_RUN(sections_of_many_pieces);
    T_RUN(cache_is_used_and_healed);
    T_RUN(full_disk);
    T_RUN(two_processes_one_cache);
    char cmd[300];
    snprintf(cmd, sizeof cmd, "rm -rf %s", dir);
    if (system(cmd) != 0)
        return 1;
    return t_done();
}
