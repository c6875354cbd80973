/* bench_card_products.c - one A x and one A'y on an OpenCL device against the time that moving their bytes takes, and
 * what the matrix takes there (recon/opencl/README.md: bytes).
 *
 *     CARD=NAME      part of the device's or the platform's name (default: Portable, which is pocl)
 *     CARD_SIZES=N   the first N of 64^3, 128^3, 256^3 (default: 1); 256: that one alone
 *
 * Rate: a copy within the device's memory, read plus written.  Times are the shortest of eight turns of REPEATS products.
 * A device that is a CPU only shows that this runs. */
#include "bench.h"

#include "recon/opencl/rates.h"
#include "tests/lib/cl_part.h"

#define CAMERAS 8
#define REPEATS 20

struct card_bed {
    rec_cl *cl;
    rec_cl_queue *q;
    double rate; /* bytes/s */
};

/* The rate of the device that was opened. */
static double copy_rate(const rec_cl *cl)
{
    struct rec_cl_info o[REC_CL_MOST];
    struct rec_cl_rates r = {0};
    struct pvx_diag d = {""};
    size_t n = rec_cl_list(o, &d);
    for (size_t i = 0; i < n; i++)
        if (strcmp(o[i].name, rec_cl_about(cl)->name) == 0 && rec_cl_measure(i, &r, &d) == PVX_OK)
            return r.copy;
    printf("no rate: %s\n", d.text);
    exit(1);
}

static void print_matrix(const rec_cl_matrix *m, double ms)
{
    for (int i = 0; i < m->levels; i++) {
        const struct rec_cl_level *l = &m->level[i];
        double at = (double)(l->at.bytes + l->w.bytes + l->more.bytes);
        double rows =
            (double)(l->rows.bytes + l->pairs * (sizeof(uint64_t) + 2 * sizeof(uint32_t)));
        printf("  level %d: windows %dx%d, columns %.1f MB, rows %.1f MB, footprints %.1f MB, "
               "%.2f pairs a brick and camera, %.0f bytes a pair\n",
               i, l->g.high, l->g.wide, 1e-6 * at, 1e-6 * rows, 1e-6 * (double)l->fp.bytes,
               (double)l->pairs / l->stored / CAMERAS, (double)l->rows.bytes / l->pairs);
    }
    printf("  made in %.0f ms\n", ms);
}

/* Voxels in an ellipsoid, 4 % of the box. */
static int32_t flame_of(const struct rec_grid *g, int32_t *col)
{
    int32_t n = 0;
    for (int32_t v = 0; v < (int32_t)rec_grid_count(g); v++) {
        int32_t ijk[3];
        double r2 = 0;
        rec_grid_ijk(g, v, ijk);
        for (int a = 0; a < 3; a++) {
            double x = ((ijk[a] + 0.5) / g->n[a] - 0.5) * (a == 2 ? 0.5 : 1);
            r2 += x * x;
        }
        if (r2 < 0.17 * 0.17)
            col[n++] = v;
    }
    return n;
}

static double products_ms(const struct card_bed *b, const struct rec_cl_part *a, int cs,
                          struct rec_cl_buffer v[2], bool adjoint)
{
    double least = INFINITY;
    for (int turn = 0; turn < 8; turn++) {
        int64_t t0 = pvx_now_mono();
        for (int i = 0; i < REPEATS; i++)
            if (adjoint)
                rec_cl_adjoint(b->q, a, cs, &v[1], &v[0]);
            else
                rec_cl_forward(b->q, a, cs, &v[0], &v[1], false);
        if (!rec_cl_wait(b->q)) {
            printf("lost: %s\n", rec_cl_lost(b->cl));
            exit(1);
        }
        least = fmin(least, 1e-6 * (double)(pvx_now_mono() - t0) / REPEATS);
    }
    return least;
}

/* Active pairs. */
static double pairs_of(const struct card_bed *b, const struct rec_cl_part *a)
{
    size_t tiles = (size_t)a->level->g.all_tiles;
    uint32_t *n = pvx_calloc(tiles, sizeof *n);
    double sum = 0;
    rec_cl_download(b->q, &a->products.tile_pairs, 0, n, tiles * sizeof *n);
    if (!rec_cl_wait(b->q))
        exit(1);
    for (size_t t = 0; t < tiles; t++)
        sum += n[t];
    free(n);
    return sum;
}

static void print_products(const struct card_bed *b, const struct rec_cl_part *a, int cs)
{
    const struct rec_cl_level *l = a->level;
    size_t columns = (size_t)a->n * (size_t)cs, bins = (size_t)l->g.room * (size_t)cs;
    struct rec_cl_buffer v[2] = {cl_bed_buffer(b->cl, b->q, NULL, columns * sizeof(float)),
                                 cl_bed_buffer(b->cl, b->q, NULL, bins * sizeof(float))};
    float *x = pvx_calloc(columns, sizeof *x);
    for (size_t i = 0; i < columns; i++)
        x[i] = 1;
    rec_cl_upload(b->q, &v[0], 0, x, columns * sizeof *x);
    double lane = 4.0 * cs, pairs = pairs_of(b, a), bricks = a->bricks;
    double bytes[2] = {((double)l->rows.bytes / l->pairs + 21) * pairs +
                           (264 + 128 * lane) * bricks + lane * a->n + 64 * lane * a->tiles,
                       (64.0 * (4 + l->g.high * l->g.wide) * CAMERAS + 272) * bricks +
                           lane * (a->n + a->rows)};
    for (int adjoint = 0; adjoint < 2; adjoint++) {
        double ms = products_ms(b, a, cs, v, adjoint), bound = 1e3 * bytes[adjoint] / b->rate;
        printf("  %-4s cs %d: %.2f MB, bound %.4f ms, measured %.4f ms, %.1f of it\n",
               adjoint ? "A'y" : "A x", cs, 1e-6 * bytes[adjoint], bound, ms, ms / bound);
    }
    free(x);
    rec_cl_buffer_free(b->cl, &v[0]);
    rec_cl_buffer_free(b->cl, &v[1]);
}

static void size_of(const struct card_bed *b, int32_t n)
{
    struct rec_rig rig;
    struct rec_sysmat_params p = {1, 1};
    struct pvx_diag d = {""};
    pvx_pool *pool;
    rec_sysmat *S;
    rec_cl_matrix *m;
    CHECK(pvx_pool_new(2, "bench", &pool));
    CHECK(rec_rig_ring(CAMERAS, 2.2, n * 5 / 2, n * 15 / 8, n, &rig));
    rig.grid.basis = REC_TRILINEAR;
    CHECK(rec_sysmat_build(&rig, &p, pool, NULL, NULL, &S, &d));
    int64_t t0 = pvx_now_mono();
    if (rec_cl_matrix_new(b->cl, S, &m, &d) != PVX_OK) {
        printf("%d^3: %s\n", n, d.text);
        exit(1);
    }
    double ms = 1e-6 * (double)(pvx_now_mono() - t0);
    int32_t *col = pvx_calloc(rec_grid_count(&S->grid), sizeof *col), k = flame_of(&S->grid, col);
    rec_cl_system y;
    cl_part_new(b->q, m, 0, 4, (struct cl_part_of){col, k, (1 << CAMERAS) - 1}, &y);
    const struct rec_cl_part *a = &y.part[0];
    printf("%d^3 trilinear, %d cameras of %dx%d: %d columns, %u bricks, %d rows, %u tiles, %.0f "
           "pairs\n",
           n, CAMERAS, n * 5 / 2, n * 15 / 8, k, a->bricks, a->rows, a->tiles, pairs_of(b, a));
    print_matrix(m, ms);
    print_products(b, a, 1);
    print_products(b, a, 4);
    cl_part_free(&y);
    rec_cl_matrix_free(&m);
    rec_sysmat_free(&S);
    rec_rig_fini(&rig);
    pvx_pool_free(&pool);
    free(col);
}

int main(void)
{
    static const int32_t size[] = {64, 128, 256};
    const char *name = getenv("CARD"), *sizes = getenv("CARD_SIZES");
    struct card_bed b;
    setenv("T_OPENCL", name != NULL ? name : "Portable", 1);
    cl_bed_begin();
    b.cl = cl_bed_open();
    b.q = cl_bed_queue(b.cl);
    b.rate = copy_rate(b.cl);
    printf("%s: %.3g GB/s\n", rec_cl_about(b.cl)->name, 1e-9 * b.rate);
    const int n = sizes != NULL ? atoi(sizes) : 1;
    for (int i = 0; i < 3; i++)
        if (i < n && (n <= 3 || size[i] == n))
            size_of(&b, size[i]);
    rec_cl_queue_free(&b.q);
    rec_cl_close(&b.cl);
    return 0;
}
