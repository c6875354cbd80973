/* The restricted system against S itself, entry by entry, and as a pair of operators. */
#include "tests/lib/entries.h"
#include "tests/lib/product.h"
#include "tests/lib/scene.h"

/* Few columns and slabs; and as many as there can be, from bins so fine that many windows are beyond a
 * column's first; cameras of different widths, some with images smaller than a window. */
static struct scene sc, large, odd;

/* A scene with its entries, and systems on a pool of its own. */
static struct entries entries_sc, entries_large, entries_odd;
struct bed {
    const struct scene *sc;
    const struct entries *all;
    struct rec_kernels k;
    pvx_pool *pool;
    struct rec_subsys *a;
    struct rec_restrictor *r;
    struct rec_images images; /* as the last product left them */
    int32_t *col, n;
    bool present[REC_MAX_CAMERAS];
};

static void bed_new(struct bed *b, const struct scene *s, int cs, unsigned threads,
                    enum pvx_cpu most)
{
    *b = (struct bed){.sc = s,
                      .all = s == &sc      ? &entries_sc
                             : s == &large ? &entries_large
                                           : &entries_odd};
    rec_kernels_init(&b->k, most);
    b->col = pvx_calloc(s->voxels, sizeof *b->col);
    memset(b->present, true, sizeof b->present);
    if (pvx_pool_new(threads, "t", &b->pool) != PVX_OK ||
        rec_subsys_new(s->S, &b->k, b->pool, cs, &b->a) != PVX_OK ||
        rec_restrictor_new(s->S, &b->r) != PVX_OK || rec_images_new(s->S, cs, &b->images) != PVX_OK)
        exit(2);
}
static void bed_free(struct bed *b)
{
    rec_subsys_free(&b->a);
    rec_restrictor_free(&b->r);
    rec_images_free(&b->images);
    pvx_pool_free(&b->pool);
    free(b->col);
}

/* Each column with this probability. */
static void bed_restrict(struct bed *b, double density)
{
    b->n = 0;
    for (int32_t j = 0; j < (int32_t)b->sc->voxels; j++)
        if (t_uniform(0, 1) < density)
            b->col[b->n++] = j;
    rec_subsys_restrict(b->a, b->r, b->col, b->n, b->present);
}

/* Whether a row is of a present camera. */
static bool here(const struct bed *b, uint32_t row)
{
    for (size_t c = 0; c < b->sc->S->n_cameras; c++)
        if (row >= b->sc->S->row0[c] && row < b->sc->S->row0[c + 1])
            return b->present[c];
    return false;
}

/* Entries of S in the active columns and present cameras: one after the other, the same in A; their sums. */
static int64_t entry_differences(const struct bed *b, uint8_t *touched)
{
    const struct rec_subsys *a = b->a;
    struct entries got = entries_of_system(a);
    int64_t wrong = 0;
    uint64_t at = 0;
    double sum = 0, sum2 = 0, unit = b->all->unit;
    for (int32_t q = 0; q < b->n; q++) {
        double of_column = 0;
        wrong += got.colptr[q] != at;
        for (uint32_t e = b->all->colptr[b->col[q]]; e < b->all->colptr[b->col[q] + 1]; e++) {
            uint32_t row = b->all->row[e];
            double v = b->all->val[e];
            if (!here(b, row))
                continue;
            wrong += at >= got.nnz || got.row[at] != row || got.val[at] != b->all->val[e];
            touched[row] = 1;
            at++;
            sum += v;
            of_column += v * v;
        }
        sum2 += of_column;
        wrong += fabs(a->norm2[q] - unit * unit * of_column) > 1e-6 * unit * unit * of_column;
    }
    wrong += got.nnz != at || a->nnz != at;
    wrong += fabs(a->sum - unit * sum) > 1e-12 * unit * sum;
    wrong += fabs(a->sum2 - unit * unit * sum2) > 1e-12 * unit * unit * sum2;
    entries_free(&got);
    return wrong;
}

/* Every bin that a window of slab s covers is in a block of that slab: else nobody would clear it. */
static void cover(const struct bed *b, uint32_t *slabs, uint32_t at, size_t slot, uint32_t slab)
{
    const struct rec_windows *m = &b->a->win;
    for (uint32_t r = 0; r < (uint32_t)m->high; r++)
        for (uint32_t k = 0; k < (uint32_t)m->wide; k++) {
            uint32_t bin = at + r * (uint32_t)m->pitch[slot] + k;
            if (bin < m->nowhere)
                slabs[bin / REC_ROW_BLOCK] |= 1u << slab;
        }
}
static int64_t block_differences(const struct bed *b, const uint8_t *touched)
{
    const struct rec_subsys *a = b->a;
    const struct rec_windows *m = &a->win;
    size_t blocks = m->nowhere / REC_ROW_BLOCK;
    uint32_t *slabs = pvx_calloc(blocks + 1, sizeof *slabs);
    int64_t wrong = 0;
    int32_t n = 0, rows = 0;
    for (int32_t s = 0; s < a->slabs; s++) {
        int32_t q0, q1;
        rec_slab_range(a, (size_t)s, &q0, &q1);
        for (size_t i = (size_t)(q0 * m->slots); i < (size_t)(q1 * m->slots); i++)
            if (m->at[i] != m->nowhere)
                cover(b, slabs, m->at[i], i % (size_t)m->slots, (uint32_t)s);
        for (uint32_t i = a->more_at[s]; i < a->more_end[s]; i++)
            cover(b, slabs, m->more[i].at, m->more[i].slot, (uint32_t)s);
    }
    for (size_t k = 0; k < blocks; k++) {
        if (slabs[k] != 0) {
            wrong += n >= a->n_blocks || a->block[n] != k || a->slabs_of[n] != slabs[k];
            n++;
        }
        for (size_t i = k * REC_ROW_BLOCK; i < (k + 1) * REC_ROW_BLOCK; i++) {
            wrong += slabs[k] == 0 ? touched[i] : (a->is_row[i] != 0) != touched[i];
            rows += touched[i];
        }
    }
    wrong += n != a->n_blocks || rows != a->rows;
    free(slabs);
    return wrong;
}

/* What restrict should give, by its definition. */
static int64_t differences(const struct bed *b)
{
    uint8_t *touched = pvx_calloc(b->sc->S->win.room, 1);
    int64_t wrong = b->a->n != b->n || b->a->col != b->col;
    wrong += entry_differences(b, touched);
    wrong += block_differences(b, touched);
    free(touched);
    return wrong;
}

/* Any columns, any cameras, any number of threads, one frame set after the other. */
static void any(const struct scene *s, int trials)
{
    for (unsigned threads = 1; threads <= 4; threads++) {
        struct bed b;
        int32_t most = 0;
        bed_new(&b, s, 4, threads, PVX_CPU_BEST);
        for (int trial = 0; trial < trials; trial++) {
            uint64_t all = (1u << s->S->n_cameras) - 1;
            uint64_t cameras = trial % 3 == 0 ? all : t_rand() & all;
            for (size_t c = 0; c < REC_MAX_CAMERAS; c++)
                b.present[c] = cameras >> c & 1;
            bed_restrict(&b, trial % 5 == 0 ? 1 : pow(t_uniform(0, 1), 3));
            T_EQ_I(differences(&b), 0);
            most = b.a->slabs > most ? b.a->slabs : most;
        }
        T_OK(s == &large ? most == REC_SLABS_MAX : most < 4);
        bed_free(&b);
    }
}
T_CASE_OF_THREADS(any_restriction)
{
    any(&sc, 20);
}
T_CASE(any_restriction_of_odd_images)
{
    any(&odd, 20);
}
T_CASE_OF_THREADS(any_restriction_in_slabs)
{
    T_OK(large.S->win.n_more > 1000);
    any(&large, 3);
}

/* ---- products ----------------------------------------------------------------------------------- */

struct vectors {
    float *x, *y, *ax, *aty;
    size_t room;
};

/* Random x and y; y in A's blocks, where no rows are too, 0 nowhere, and no number elsewhere: that nobody
 * may look at.  The same of what is to be overwritten. */
static void vectors_new(struct vectors *v, const struct bed *b)
{
    const struct rec_subsys *a = b->a;
    size_t cs = (size_t)a->cs, n = (size_t)a->n;
    v->room = a->win.room;
    v->x = pvx_calloc(n * cs + 1, 4);
    v->aty = pvx_calloc(n * cs + 1, 4);
    v->y = pvx_calloc(v->room * cs, 4);
    v->ax = pvx_calloc(v->room * cs, 4);
    for (size_t i = 0; i < n * cs; i++) {
        v->x[i] = i % cs == 3 ? 0 : (float)t_uniform(-1, 1);
        v->aty[i] = NAN;
    }
    for (size_t i = 0; i < v->room * cs; i++) {
        v->y[i] = i < a->win.nowhere * cs ? NAN : 0;
        v->ax[i] = 77;
    }
    for (size_t k = 0; k < (size_t)a->n_blocks; k++)
        for (size_t i = a->block[k] * REC_ROW_BLOCK * cs, l = 0; l < REC_ROW_BLOCK * cs; l++) {
            v->y[i + l] = l % cs == 3 ? 0 : (float)t_uniform(-1, 1);
            v->ax[i + l] = NAN;
        }
}
static void vectors_free(struct vectors *v)
{
    free(v->x);
    free(v->y);
    free(v->ax);
    free(v->aty);
}

/* One of them, all its outputs: a sum of n entries in floats in any order, where further roundings are those
 * of an entry times unit and x, of unit, and of the slabs' images,
 *     |got - exact| <= g sum|a||x|,  g = k u / (1 - k u),  k = n + further,  u = 2^-24
 * (N. J. Higham, Accuracy and Stability of Numerical Algorithms, ch. 3; weights of 0 change no sum). */
static int64_t off(const struct entries *e, size_t cs, int further, const float *in,
                   const float *got)
{
    int64_t wrong = 0;
    for (size_t i = 0; i < e->n; i++)
        for (size_t l = 0; l < cs; l++) {
            double exact = 0, size = 0;
            double k = (double)(e->colptr[i + 1] - e->colptr[i]) + further, u = 0x1p-24;
            for (uint32_t o = e->colptr[i]; o < e->colptr[i + 1]; o++) {
                double p = entries_value(e, o) * in[(size_t)e->row[o] * cs + l];
                exact += p;
                size += fabs(p);
            }
            wrong += !(fabs(got[i * cs + l] - exact) <= k * u / (1 - k * u) * size);
        }
    return wrong;
}

/* Both products against the entries; both as a pair, <Ax,y> = <x,A'y>; and the columns' sums. */
static void products(struct bed *b)
{
    const struct rec_subsys *a = b->a;
    struct entries columns = entries_of_system(a);
    struct entries rows = entries_by_row(&columns, a->win.nowhere);
    uint32_t *row = rows_of_system(a);
    struct vectors v;
    vectors_new(&v, b);
    size_t cs = (size_t)a->cs;
    rec_forward(a, &b->images, v.x, v.ax);
    product_aty(a, v.y, v.aty);
    T_EQ_I(off(&columns, cs, 2, v.y, v.aty), 0);

    int64_t stray = 0;
    for (int32_t k = 0, at = 0; k < (int32_t)(a->win.nowhere / REC_ROW_BLOCK); k++) {
        bool block = at < a->n_blocks && a->block[at] == (uint32_t)k;
        at += block;
        for (size_t i = (size_t)k * REC_ROW_BLOCK, r = 0; r < REC_ROW_BLOCK; r++, i++)
            for (size_t l = 0; l < cs; l++) {
                float *got = &v.ax[i * cs + l];
                bool is_row = block && a->is_row[i];
                stray += !is_row && !(block ? *got >= 0 && *got <= 0 : *got >= 77 && *got <= 77);
                *got = is_row ? *got : 0;
            }
    }
    T_EQ_I(stray, 0);
    T_EQ_I(off(&rows, cs, 2 + a->slabs, v.x, v.ax), 0);

    double left[4] = {0}, right[4] = {0}, size[4] = {0}, longest = 0;
    rec_dot(a, a->n, v.x, v.aty, right);
    for (int32_t i = 0; i < a->rows; i++)
        for (size_t l = 0; l < cs; l++)
            left[l] += (double)v.ax[row[i] * cs + l] * v.y[row[i] * cs + l];
    for (size_t i = 0; i < rows.n; i++) {
        longest = fmax(longest, rows.colptr[i + 1] - rows.colptr[i]);
        for (uint32_t e = rows.colptr[i]; e < rows.colptr[i + 1]; e++)
            for (size_t l = 0; l < cs; l++)
                size[l] +=
                    fabs(entries_value(&rows, e) * v.x[rows.row[e] * cs + l] * v.y[i * cs + l]);
    }
    for (size_t i = 0; i < columns.n; i++)
        longest = fmax(longest, columns.colptr[i + 1] - columns.colptr[i]);
    for (size_t l = 0; l < cs; l++)
        T_NEAR(left[l], right[l], 2 * (longest + 2 + a->slabs) * 0x1p-24 * size[l]);
    T_OK(a->nnz == 0 || size[0] > 0);

    float *w = pvx_calloc(v.room, 4), *d = pvx_calloc((size_t)a->n * 4 + 1, 4);
    float *d2 = d, *d1 = d + a->n, *of_some = d1 + a->n, *ones = of_some + a->n;
    struct rec_cameras some = {1, (int32_t)a->S->n_cameras - 1};
    int64_t wrong = 0;
    for (size_t i = 0; i < v.room; i++)
        w[i] = i < a->win.nowhere ? (float)t_uniform(0, 1) : 0;
    rec_column_norms(a, w, d2, d1);
    rec_column_norms(a, NULL, NULL, ones);
    rec_column_sums_cameras(a, some, w, of_some);
    for (size_t q = 0; q < (size_t)a->n; q++) {
        double w2 = 0, w1 = 0, ws = 0, all = 0;
        for (uint32_t e = columns.colptr[q]; e < columns.colptr[q + 1]; e++) {
            double value = entries_value(&columns, e), weight = w[columns.row[e]];
            bool in = columns.row[e] >= a->row0[some.c0] && columns.row[e] < a->row0[some.c1];
            w1 += weight * value;
            w2 += weight * value * value;
            ws += in ? weight * value : 0;
            all += value;
        }
        wrong += !(fabs(d1[q] - w1) <= 1e-6 * w1 && fabs(d2[q] - w2) <= 1e-6 * w2 &&
                   fabs(of_some[q] - ws) <= 1e-6 * ws && fabs(ones[q] - all) <= 1e-6 * all);
    }
    T_EQ_I(wrong, 0);
    free(w);
    free(d);
    free(row);
    vectors_free(&v);
    entries_free(&columns);
    entries_free(&rows);
}

static void products_of(const struct scene *s, int trials)
{
    for (int level = PVX_CPU_REF; level <= (int)pvx_cpu_have(); level++)
        for (int cs = 1; cs <= 4; cs += 3) {
            struct bed b;
            bed_new(&b, s, cs, 2, (enum pvx_cpu)level);
            for (int t = 0; t < trials; t++) {
                for (size_t c = 0; c < s->S->n_cameras; c++)
                    b.present[c] = t < 2 || t_rand() % 3 > 0;
                bed_restrict(&b, t == 0 ? 1 : 0.3);
                products(&b);
            }
            bed_free(&b);
        }
}
T_CASE_OF_THREADS(forward_and_adjoint_agree)
{
    products_of(&sc, 5);
}
T_CASE(forward_and_adjoint_agree_in_odd_images)
{
    products_of(&odd, 8);
}
T_CASE(forward_and_adjoint_agree_in_slabs)
{
    products_of(&large, 1);
}

/* Some cameras' part alone: what is left when the others are not there. */
static void some_cameras(const struct scene *s, double density)
{
    for (int cs = 1; cs <= 4; cs += 3) {
        struct bed b;
        bed_new(&b, s, cs, 2, PVX_CPU_BEST);
        int32_t cameras = (int32_t)s->S->n_cameras;
        for (int32_t c0 = 0; c0 < cameras; c0++)
            for (int32_t c1 = c0; c1 <= cameras; c1 += 2) {
                struct vectors v;
                struct rec_cameras some = {c0, c1};
                memset(b.present, true, sizeof b.present);
                bed_restrict(&b, density);
                vectors_new(&v, &b);
                rec_scatter_cameras(b.a, &b.images, some, v.x);
                rec_collect(b.a, &b.images, (struct rec_block_range){0, b.a->n_blocks}, v.ax);
                rec_adjoint_cameras(b.a, some, v.y, 0, b.a->n, v.aty);
                int32_t slabs = b.a->slabs;
                size_t bins = b.a->win.nowhere;
                for (size_t i = 0; i < bins * (size_t)cs; i++)
                    v.ax[i] = v.ax[i] >= 77 ? 0 : v.ax[i];
                for (int32_t c = 0; c < cameras; c++)
                    b.present[c] = c >= c0 && c < c1;
                rec_subsys_restrict(b.a, b.r, b.col, b.n, b.present);
                struct entries columns = entries_of_system(b.a),
                               rows = entries_by_row(&columns, bins);
                T_EQ_I(off(&columns, (size_t)cs, 2, v.y, v.aty), 0);
                T_EQ_I(off(&rows, (size_t)cs, 2 + slabs, v.x, v.ax), 0);
                entries_free(&columns);
                entries_free(&rows);
                vectors_free(&v);
            }
        bed_free(&b);
    }
}
T_CASE_OF_THREADS(products_of_some_cameras)
{
    some_cameras(&large, 0.1);
    some_cameras(&odd, 0.6);
}

/* Column q times e in its slab's image, as a product with e at q alone gives it. */
static void one(const struct scene *s)
{
    for (int cs = 1; cs <= 4; cs += 3) {
        struct bed b;
        struct rec_images im;
        bed_new(&b, s, cs, 1, PVX_CPU_BEST);
        bed_restrict(&b, 0.5);
        struct entries columns = entries_of_system(b.a);
        T_EQ_I(rec_images_new(b.a->S, cs, &im), PVX_OK);
        T_OK(b.n > 0);
        for (int t = 0; t < 300 && b.n > 0; t++) {
            int32_t q = (int32_t)(t_rand() % (uint64_t)b.n);
            const rec_f4 e = {(float)t_uniform(-1, 1), 2, -3, 0};
            int64_t wrong = 0;
            size_t slab = 0;
            for (int32_t q0 = 0, q1 = 0; q1 <= q; slab += q1 <= q)
                rec_slab_range(b.a, slab, &q0, &q1);
            float *image = im.of[slab];
            rec_add_column(b.a, &im, slab, q, e);
            for (uint32_t i = columns.colptr[q]; i < columns.colptr[q + 1]; i++)
                for (int l = 0; l < cs; l++) {
                    float *got = &image[columns.row[i] * (size_t)cs + (size_t)l];
                    double want = entries_value(&columns, i) * e[l],
                           is = (double)b.a->win.unit * *got;
                    wrong += !(fabs(is - want) <= 0x1p-22 * fabs(want));
                    *got = 0;
                }
            for (size_t i = 0; i < b.a->win.room * (size_t)cs; i++)
                wrong += !(image[i] >= 0 && image[i] <= 0);
            T_EQ_I(wrong, 0);
        }
        entries_free(&columns);
        rec_images_free(&im);
        bed_free(&b);
    }
}
T_CASE(one_column)
{
    one(&large);
    one(&odd);
}

/* Slabs are as many as the columns say. */
T_CASE_OF_THREADS(same_bits_for_any_number_of_threads)
{
    static const unsigned threads[] = {1, 2, 5};
    for (int cs = 1; cs <= 4; cs += 3)
        for (int full = 0; full < 2; full++) {
            struct vectors first = {0};
            uint64_t state = t_state;
            for (int i = 0; i < 3; i++) {
                struct bed b;
                struct vectors v;
                bed_new(&b, &large, cs, threads[i], PVX_CPU_BEST);
                t_state = state; /* the same columns and vectors */
                bed_restrict(&b, full ? 1 : 0.5);
                T_OK(full ? b.a->slabs == REC_SLABS_MAX
                          : b.a->slabs > 4 && b.a->slabs < REC_SLABS_MAX);
                vectors_new(&v, &b);
                product_ax(b.a, v.x, v.ax);
                product_aty(b.a, v.y, v.aty);
                if (i == 0) {
                    first = v;
                } else {
                    size_t n = (size_t)b.n * (size_t)cs * 4;
                    T_OK(memcmp(first.ax, v.ax, v.room * (size_t)cs * 4) == 0);
                    T_OK(memcmp(first.aty, v.aty, n) == 0);
                    vectors_free(&v);
                }
                bed_free(&b);
            }
            vectors_free(&first);
        }
}

T_CASE(nothing_active)
{
    struct bed b;
    bed_new(&b, &sc, 4, 1, PVX_CPU_BEST);
    bed_restrict(&b, 0);
    T_EQ_I(b.a->rows, 0);
    T_EQ_I(b.a->nnz, 0);
    product_ax(b.a, NULL, NULL);
    product_aty(b.a, NULL, NULL);
    memset(b.present, false, sizeof b.present); /* columns, but no camera */
    bed_restrict(&b, 1);
    T_EQ_I(b.a->rows, 0);
    T_EQ_I(differences(&b), 0);
    products(&b);
    bed_free(&b);
}

/* A rig and its matrix, no pictures. */
static void odd_new(void)
{
    static const int32_t size[][2] = {{24, 18}, {1, 9}, {7, 2}, {2, 3}, {3, 20},
                                      {30, 1},  {1, 1}, {5, 5}, {2, 12}};
    struct rec_sysmat_params p = {.binning = 1, .rays_per_bin = 2};
    if (pvx_pool_new(2, "test", &odd.pool) != PVX_OK ||
        rec_rig_ring(sizeof size / sizeof *size, 2.2, 24, 18, 9, &odd.rig) != PVX_OK)
        exit(2);
    odd.rig.grid.basis = REC_TRILINEAR;
    for (size_t c = 0; c < odd.rig.n_cameras; c++) {
        struct rec_camera *camera = &odd.rig.cameras[c];
        camera->cx -= (24 - size[c][0]) / 2.0;
        camera->cy -= (18 - size[c][1]) / 2.0;
        camera->width = size[c][0];
        camera->height = size[c][1];
    }
    if (rec_sysmat_build(&odd.rig, &p, odd.pool, NULL, NULL, &odd.S, NULL) != PVX_OK)
        exit(2);
    odd.voxels = rec_grid_count(&odd.rig.grid);
}
static void scenes_new(void)
{
    odd_new();
    scene_new(&sc, 4, 48, 14, 2, 2);
    scene_new(&large, 5, 160, 34, 1, 2);
    entries_sc = entries_of(sc.S);
    entries_large = entries_of(large.S);
    entries_odd = entries_of(odd.S);
}
static void scenes_free(void)
{
    scene_free(&sc);
    scene_free(&large);
    scene_free(&odd);
    entries_free(&entries_sc);
    entries_free(&entries_large);
    entries_free(&entries_odd);
}
T_MAIN(scenes_new(), scenes_free())
