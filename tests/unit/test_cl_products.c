/* test_cl_products.c - products on a device against the processor's restricted system, entry by entry: rows, counts and
 * norms to the bit, products within the bound of their rounding. */
#include "recon/opencl/impl.h"
#include "tests/lib/cl_part.h"
#include "tests/lib/entries.h"
#include "tests/lib/matrices.h"
#include "tests/t.h"

static rec_cl *cl;
static pvx_pool *pool;

/* One restricted system in both places. */
struct bed {
    rec_cl_queue *q;
    struct rec_subsys *a;
    struct rec_restrictor *r;
    int32_t *col;
    rec_cl_system y;
    struct entries columns, rows; /* of A; rows of all bins */
    uint8_t *is_row;              /* [room] */
    size_t room;
};

static bool is_kept(const rec_sysmat *S, int32_t voxel)
{
    return S->active == NULL || rec_active_has(S->active, (size_t)voxel);
}

static void bed_new(struct bed *b, rec_cl_queue *q, rec_cl_matrix *m, int level, int cs,
                    double density, uint64_t cameras)
{
    const rec_sysmat *S = m->level[level].S;
    struct rec_kernels k;
    bool present[REC_MAX_CAMERAS];
    int32_t n = 0, voxels = (int32_t)rec_grid_count(&S->grid);
    *b = (struct bed){.q = q, .room = S->win.room};
    rec_kernels_init(&k, PVX_CPU_BEST);
    b->col = pvx_calloc((size_t)voxels, sizeof *b->col);
    for (int32_t v = 0; v < voxels; v++)
        if (is_kept(S, v) && t_uniform(0, 1) < density)
            b->col[n++] = v;
    for (int c = 0; c < REC_MAX_CAMERAS; c++)
        present[c] = (cameras >> c & 1) != 0;
    if (rec_subsys_new(S, &k, pool, cs, &b->a) != PVX_OK || rec_restrictor_new(S, &b->r) != PVX_OK)
        exit(2);
    rec_subsys_restrict(b->a, b->r, b->col, n, present);
    b->columns = entries_of_system(b->a);
    b->rows = entries_by_row(&b->columns, b->room);
    b->is_row = pvx_calloc(b->room, 1);
    uint32_t *row = rows_of_system(b->a);
    for (int32_t i = 0; i < b->a->rows; i++)
        b->is_row[row[i]] = 1;
    free(row);
    cl_part_new(q, m, level, cs, (struct cl_part_of){b->col, n, cameras}, &b->y);
}
static void bed_free(struct bed *b)
{
    cl_part_free(&b->y);
    entries_free(&b->columns);
    entries_free(&b->rows);
    rec_subsys_free(&b->a);
    rec_restrictor_free(&b->r);
    free(b->col);
    free(b->is_row);
}

/* ---- rows, counts, norms ------------------------------------------------------------------------ */

static void same_rows(const struct bed *b)
{
    uint8_t *got = pvx_calloc(b->room, 1);
    int64_t wrong = 0;
    rec_cl_download(b->q, &b->y.part[0].is_row, 0, got, b->room);
    T_OK(rec_cl_wait(b->q));
    for (size_t i = 0; i < b->room; i++)
        wrong += got[i] != b->is_row[i];
    T_EQ_I(wrong, 0);
    T_EQ_I(b->y.part[0].rows, b->a->rows);
    free(got);
}

static void same_counts(const struct bed *b)
{
    enum { SLOT = 5 };
    uint32_t groups[SLOT + 3] = {0};
    double got[SLOT + 3][4];
    uint64_t sum = 0, sum2 = 0;
    double unit = b->a->S->unit;
    rec_cl_count_entries(b->q, &b->y.part[0], SLOT, &groups[SLOT]);
    groups[SLOT + 1] = groups[SLOT + 2] = groups[SLOT];
    T_OK(rec_cl_sums(b->q, groups, SLOT + 3, got));
    for (uint64_t i = 0; i < b->columns.nnz; i++) {
        sum += b->columns.val[i];
        sum2 += (uint64_t)b->columns.val[i] * b->columns.val[i];
    }
    T_EQ_I(got[SLOT][0], b->a->nnz);
    T_EQ_I(got[SLOT + 1][0], sum);
    T_EQ_I(got[SLOT + 2][0], sum2);
    T_NEAR(unit * got[SLOT + 1][0], b->a->sum, 0);
    T_NEAR(unit * unit * got[SLOT + 2][0], b->a->sum2, 0);
}

/* Sums of n doubles that are not below 0, in any order: within n eps. */
static void same_norms(const struct bed *b)
{
    size_t n = (size_t)b->a->n;
    float *w = pvx_calloc(b->room, sizeof *w), *d2 = pvx_calloc(3 * n + 1, sizeof *d2);
    float *d1 = d2 + n, *got = d1 + n;
    double want[2] = {0, 0}, sums[2][4];
    int64_t wrong = 0;
    for (size_t i = 0; i < b->room; i++)
        w[i] = b->is_row[i] ? (float)(t_rand() % 4 == 0 ? 0 : t_uniform(0, 1)) : NAN;
    struct rec_cl_buffer weight = cl_bed_buffer(cl, b->q, w, b->room * sizeof *w),
                         out = cl_bed_buffer(cl, b->q, NULL, (n + 1) * sizeof *got);
    uint32_t groups[2];
    rec_cl_column_norms(b->q, &b->y.part[0], &weight, &out, 0, &groups[0]);
    groups[1] = groups[0];
    rec_cl_download(b->q, &out, 0, got, n * sizeof *got);
    T_OK(rec_cl_sums(b->q, groups, 2, sums));
    for (size_t i = 0; i < b->room; i++)
        w[i] = b->is_row[i] ? w[i] : 0;
    rec_column_norms(b->a, w, d2, d1);
    for (size_t i = 0; i < n; i++) {
        wrong += memcmp(&got[i], &d2[i], sizeof *got) != 0;
        want[0] += d2[i];
        want[1] += d1[i];
    }
    T_EQ_I(wrong, 0);
    for (int s = 0; s < 2; s++)
        T_NEAR(sums[s][0], want[s], 2 * (double)n * 0x1p-53 * want[s]);
    rec_cl_buffer_free(cl, &weight);
    rec_cl_buffer_free(cl, &out);
    free(w);
    free(d2);
}

/* ---- products ----------------------------------------------------------------------------------- */

/* A sum of products, n of them, each of which is rounded at most n + further times:
 *     |got - exact| <= g sum|a||x|,  g = m u / (1 - m u),  m = n + further,  u = 2^-24
 * (N. J. Higham, Accuracy and Stability of Numerical Algorithms, ch. 3). */
struct bound {
    double exact, size;
};
static struct bound sum_of(const struct entries *e, size_t i, const float *in, size_t cs, size_t l)
{
    struct bound s = {0, 0};
    for (uint32_t o = e->colptr[i]; o < e->colptr[i + 1]; o++) {
        double p = entries_value(e, o) * in[(size_t)e->row[o] * cs + l];
        s.exact += p;
        s.size += fabs(p);
    }
    return s;
}
static bool is_within(double got, struct bound s, double m)
{
    const double u = 0x1p-24;
    return fabs(got - s.exact) <= m * u / (1 - m * u) * s.size;
}

static float *random_vector(size_t n, double zeros)
{
    float *v = pvx_calloc(n + 1, sizeof *v);
    for (size_t i = 0; i < n; i++)
        v[i] = t_uniform(0, 1) < zeros ? 0 : (float)t_uniform(-1, 1);
    return v;
}

static void same_adjoint(const struct bed *b, int cs)
{
    size_t n = (size_t)b->a->n, lanes = (size_t)cs;
    float *y = random_vector(b->room * lanes, 0), *got = pvx_calloc(2 * n * lanes + 1, sizeof *got);
    float *again = got + n * lanes;
    int64_t wrong = 0;
    for (size_t i = 0; i < b->room * lanes; i++)
        if (!b->is_row[i / lanes]) /* nobody may look at these */
            y[i] = NAN;
    struct rec_cl_buffer from = cl_bed_buffer(cl, b->q, y, b->room * lanes * sizeof *y),
                         to = cl_bed_buffer(cl, b->q, NULL, (n + 1) * lanes * sizeof *y);
    rec_cl_adjoint(b->q, &b->y.part[0], cs, &from, &to);
    rec_cl_download(b->q, &to, 0, got, n * lanes * sizeof *got);
    rec_cl_adjoint(b->q, &b->y.part[0], cs, &from, &to);
    rec_cl_download(b->q, &to, 0, again, n * lanes * sizeof *got);
    T_OK(rec_cl_wait(b->q));
    for (size_t i = 0; i < n; i++)
        for (size_t l = 0; l < lanes; l++)
            wrong += !is_within(got[i * lanes + l], sum_of(&b->columns, i, y, lanes, l),
                                b->columns.colptr[i + 1] - b->columns.colptr[i] + 1);
    T_EQ_I(wrong, 0);
    T_EQ_I(memcmp(got, again, n * lanes * sizeof *got), 0);
    rec_cl_buffer_free(cl, &from);
    rec_cl_buffer_free(cl, &to);
    free(y);
    free(got);
}

/* Bricks whose columns are in a row. */
static uint32_t bricks_in(const struct bed *b, size_t row, uint32_t *stamp)
{
    const struct rec_grid *g = &b->a->S->grid;
    uint32_t n = 0;
    for (uint32_t o = b->rows.colptr[row]; o < b->rows.colptr[row + 1]; o++) {
        int32_t v[3];
        rec_grid_ijk(g, b->col[b->rows.row[o]], v);
        uint32_t *at = &stamp[rec_brick_place(g, v[0], v[1], v[2]) / REC_BRICK_VOXELS];
        n += *at != row + 1;
        *at = (uint32_t)row + 1;
    }
    return n;
}
/* Whether each bin is in a tile with a row. */
static uint8_t *in_active_tile(const struct bed *b)
{
    uint8_t *in = pvx_calloc(b->room, 1);
    for (size_t c = 0; c < b->a->S->n_cameras; c++) {
        size_t bw = (size_t)b->a->S->block[c].bw, bh = (size_t)b->a->S->block[c].bh;
        for (size_t k = 0; k < 2; k++)
            for (size_t i = 0; i < bw * bh; i++) {
                size_t x = i % bw / REC_CL_TILE * REC_CL_TILE,
                       y = i / bw / REC_CL_TILE * REC_CL_TILE;
                size_t row0 = b->a->row0[c], first = row0 + y * bw + x;
                if (k == 0 && b->is_row[row0 + i])
                    in[first] = 1;
                if (k == 1)
                    in[row0 + i] = in[first];
            }
    }
    return in;
}

/* Of bins in tiles without a row the bytes stay; bins that are no rows become 0. */
static void same_forward(const struct bed *b, int cs, double zeros)
{
    size_t n = (size_t)b->a->n, lanes = (size_t)cs, bytes = b->room * lanes * sizeof(float);
    float *x = random_vector(n * lanes, zeros), *before = pvx_calloc(b->room * lanes, 4);
    float *got = pvx_calloc(b->room * lanes, 4), *added = pvx_calloc(b->room * lanes, 4);
    uint32_t *stamp = pvx_calloc(rec_brick_places(&b->a->S->grid), sizeof *stamp);
    uint8_t *in = in_active_tile(b);
    int64_t wrong = 0, stray = 0;
    for (size_t i = 0; i < b->room * lanes; i++)
        before[i] = 77;
    struct rec_cl_buffer from = cl_bed_buffer(cl, b->q, x, (n + 1) * lanes * sizeof *x),
                         to = cl_bed_buffer(cl, b->q, before, bytes);
    rec_cl_forward(b->q, &b->y.part[0], cs, &from, &to, false);
    rec_cl_download(b->q, &to, 0, got, bytes);
    rec_cl_forward(b->q, &b->y.part[0], cs, &from, &to, true);
    rec_cl_download(b->q, &to, 0, added, bytes);
    T_OK(rec_cl_wait(b->q));
    for (size_t i = 0; i < b->room; i++) {
        double m = b->rows.colptr[i + 1] - b->rows.colptr[i] + bricks_in(b, i, stamp) + 4;
        for (size_t l = 0; l < lanes; l++) {
            float y = got[i * lanes + l], y2 = added[i * lanes + l];
            stray += !b->is_row[i] && memcmp(&y, &(float){in[i] ? 0 : 77}, sizeof y) != 0;
            wrong += b->is_row[i] && !is_within(y, sum_of(&b->rows, i, x, lanes, l), m);
            float twice = y + y; /* the same product, added in float */
            wrong += in[i] && memcmp(&y2, &twice, sizeof y2) != 0;
        }
    }
    T_EQ_I(wrong, 0);
    T_EQ_I(stray, 0);
    rec_cl_buffer_free(cl, &from);
    rec_cl_buffer_free(cl, &to);
    free(x);
    free(before);
    free(got);
    free(added);
    free(stamp);
    free(in);
}

/* ---- matrices ----------------------------------------------------------------------------------- */

static void same(rec_cl_queue *q, rec_cl_matrix *m, int level, int cs, double density,
                 uint64_t cameras)
{
    struct bed b;
    bed_new(&b, q, m, level, cs, density, cameras);
    same_rows(&b);
    same_counts(&b);
    same_norms(&b);
    for (int of = 1; of <= cs; of += 3) { /* also one lane of a system that has four */
        same_adjoint(&b, of);
        same_forward(&b, of, 0.1);
        same_forward(&b, of, 0.999);
    }
    bed_free(&b);
}

/* All columns, some, none; all cameras, some, none. */
static void same_systems(rec_cl_queue *q, rec_cl_matrix *m, uint64_t all)
{
    for (int level = 0; level < m->levels; level++)
        for (int cs = 1; cs <= 4; cs += 3) {
            same(q, m, level, cs, 0.3, all);
            same(q, m, level, cs, 0.02, t_rand() & all);
        }
    same(q, m, 0, 4, 1, all & ~(uint64_t)2);
    same(q, m, 0, 1, 0, all);
    same(q, m, 0, 1, 0.5, 0);
}
static void same_everywhere(const rec_sysmat *S)
{
    struct pvx_diag d = {""};
    rec_cl_matrix *m;
    rec_cl_queue *q = cl_bed_queue(cl);
    uint64_t all = ((uint64_t)1 << S->n_cameras) - 1;
    T_EQ_I(rec_cl_matrix_new(cl, S, &m, &d), PVX_OK);
    T_EQ_S(d.text, "");
    if (m == NULL)
        exit(1);
    if (cl_bed_is_simulated()) /* it is slow */
        same(q, m, m->levels - 1, m->levels > 1 ? 1 : 4, 0.3, all & ~(uint64_t)2);
    else
        same_systems(q, m, all);
    rec_cl_queue_free(&q);
    rec_cl_matrix_free(&m);
    T_OK(m == NULL);
}

/* How many levels, and windows beyond a voxel's first. */
static void whole(enum rec_basis basis, int32_t across, const int32_t n[3], int levels, bool more)
{
    struct real r;
    int have = 0;
    real_rig(&r, basis, across, n);
    T_EQ_I(rec_sysmat_build(&r.rig, &r.p, pool, NULL, NULL, &r.S, NULL), PVX_OK);
    for (const rec_sysmat *S = r.S; S != NULL; S = S->coarse)
        have++;
    T_EQ_I(have, levels);
    T_OK((r.S->win.n_more > 100) == more);
    same_everywhere(r.S);
    real_free(&r);
}
T_CASE(trilinear_with_coarser_levels)
{
    whole(REC_TRILINEAR, 71, (const int32_t[]){34, 6, 9}, 2, true);
}
T_CASE(box)
{
    whole(REC_BOX, 35, (const int32_t[]){5, 33, 10}, 2, false);
}

T_CASE(a_part_of_a_matrix)
{
    struct real r;
    rec_sysmat *outline = NULL;
    real_rig(&r, REC_TRILINEAR, 50, (const int32_t[]){14, 11, 33});
    T_EQ_I(rec_sysmat_outline(&r.rig, &r.p, pool, (struct rec_progress){0}, &outline, NULL),
           PVX_OK);
    for (size_t i = 0; i < outline->active->bricks; i++)
        outline->active->brick[i] = t_rand() % 5 == 0;
    T_EQ_I(rec_sysmat_build_active(&r.rig, &outline, pool, (struct rec_progress){0}, &r.S, NULL),
           PVX_OK);
    same_everywhere(r.S);
    real_free(&r);
}
T_CASE(a_part_that_is_empty)
{
    struct real r;
    rec_sysmat *outline = NULL;
    real_rig(&r, REC_BOX, 30, (const int32_t[]){9, 10, 7});
    T_EQ_I(rec_sysmat_outline(&r.rig, &r.p, pool, (struct rec_progress){0}, &outline, NULL),
           PVX_OK);
    T_EQ_I(rec_sysmat_build_active(&r.rig, &outline, pool, (struct rec_progress){0}, &r.S, NULL),
           PVX_OK);
    same_everywhere(r.S);
    real_free(&r);
}

static void written(int32_t high, int32_t wide)
{
    rec_sysmat *m = written_new(high, wide, pool);
    T_OK(m->win.n_more > 100);
    same_everywhere(m);
    rec_sysmat_free(&m);
}
T_CASE(windows_of_2x2)
{
    written(2, 2);
}
T_CASE(windows_of_2x4)
{
    written(2, 4);
}
T_CASE(windows_of_3x4)
{
    written(3, 4);
}
T_CASE(windows_of_4x4)
{
    written(4, 4);
}

/* Whatever has no room: one sentence, and nothing is left behind. */
T_CASE(a_device_without_room)
{
    rec_sysmat *S = written_new(2, 2, pool);
    const uint64_t memory = cl->info.memory, used = atomic_load(&cl->used);
    uint32_t refused = 0, bits = 0;
    pvx_err e;
    do {
        struct pvx_diag d = {""};
        rec_cl_matrix *m;
        cl->info.memory = used + ((uint64_t)1 << ++bits);
        e = rec_cl_matrix_new(cl, S, &m, &d);
        T_OK(e == PVX_OK || e == PVX_ENOMEM);
        T_OK((e == PVX_OK) == (m != NULL));
        if (e != PVX_OK)
            T_CONTAINS(d.text, "GB");
        if (e != PVX_OK && bits > 20) /* the queue has room */
            T_CONTAINS(d.text, "the system matrix' ");
        refused += e != PVX_OK;
        rec_cl_matrix_free(&m);
        T_EQ_I(atomic_load(&cl->used), used);
    } while (e != PVX_OK && cl->info.memory < memory);
    T_EQ_I(e, PVX_OK);
    T_OK(refused > 10);
    cl->info.memory = memory;
    rec_sysmat_free(&S);
}

static void begin(void)
{
    cl_bed_begin();
    cl = cl_bed_open();
    if (pvx_pool_new(2, "t", &pool) != PVX_OK)
        exit(2);
}
static void end(void)
{
    pvx_pool_free(&pool);
    rec_cl_close(&cl);
}
T_MAIN(begin(), end())
