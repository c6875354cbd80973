/* bench_finer.c - what cells of 2 and 4 times the size could save: the field of uniform 128^3 and of coarser grids, and what
 * a quarter of 128^3's unknowns could reach at best, if every block of 8^3 took the solution of that grid which is nearest
 * to the truth (an oracle), or the fine one where 64^3 differs most from 32^3 (a rule that needs no truth). */
#include "points.h"

enum { FINE = 128, BLOCK = 8, LEVELS = 3, GRIDS = 4 };
/* Levels: voxels of 4, 2, 1 of the finest; the last grid has as many unknowns as may be used. */
static const int32_t along[GRIDS] = {FINE / 4, FINE / 2, FINE, 80};
#define BUDGET 0.25 /* of the unknowns of the finest */

struct blocks {
    size_t n;
    double *error[GRIDS]; /* squared, over the block's points */
    double *detail;       /* squared, between the two coarser levels */
    double *unknowns;     /* of the finest level */
    double truth, all;    /* sum of squares; of unknowns */
};

struct uniform {
    struct rec_grid grid;
    float *dense;
    struct rec_frame_report report;
    double ms, view;
};

static double *must_zeros(size_t n)
{
    double *v = pvx_calloc(n, sizeof *v);
    if (v == NULL)
        abort();
    return v;
}

static void blocks_new(struct blocks *b, const struct rec_grid *at, const struct scene *s,
                       const struct uniform *level)
{
    size_t nch = (size_t)s->nch, nb[3];
    for (int a = 0; a < 3; a++)
        nb[a] = ((size_t)at->n[a] + BLOCK - 1) / BLOCK;
    *b = (struct blocks){.n = nb[0] * nb[1] * nb[2]};
    for (int l = 0; l < GRIDS; l++)
        b->error[l] = must_zeros(b->n);
    b->detail = must_zeros(b->n);
    b->unknowns = must_zeros(b->n);
    for (int32_t k = 0; k < at->n[2]; k++)
        for (int32_t j = 0; j < at->n[1]; j++)
            for (int32_t i = 0; i < at->n[0]; i++) {
                const int32_t q[3] = {i, j, k};
                const float *want = s->truth + (size_t)rec_grid_index(at, i, j, k) * nch;
                size_t to = ((size_t)(k / BLOCK) * nb[1] + (size_t)(j / BLOCK)) * nb[0] +
                            (size_t)(i / BLOCK);
                double x[3], v[GRIDS][3], any = 0;
                for (int a = 0; a < 3; a++)
                    x[a] = at->min[a] + (q[a] + 0.5) * rec_grid_h(at, a);
                for (int l = 0; l < GRIDS; l++)
                    volume_at(&level[l].grid, level[l].dense, nch, x, v[l]);
                for (size_t ch = 0; ch < nch; ch++) {
                    for (int l = 0; l < GRIDS; l++)
                        b->error[l][to] += (v[l][ch] - want[ch]) * (v[l][ch] - want[ch]);
                    b->detail[to] += (v[1][ch] - v[0][ch]) * (v[1][ch] - v[0][ch]);
                    b->truth += (double)want[ch] * want[ch];
                    any += fabs(v[LEVELS - 1][ch]);
                }
                b->unknowns[to] += any > 0;
                b->all += any > 0;
            }
}

static void blocks_free(struct blocks *b)
{
    for (int l = 0; l < GRIDS; l++)
        free(b->error[l]);
    free(b->detail);
    free(b->unknowns);
}

/* The least of error + price * unknowns, block by block: error and unknowns, as shares. */
static void oracle_at(const struct blocks *b, double price, double *error, double *unknowns)
{
    *error = *unknowns = 0;
    for (size_t i = 0; i < b->n; i++) {
        int best = 0;
        for (int l = 1; l < LEVELS; l++)
            if (b->error[l][i] + price * b->unknowns[i] / (1 << 3 * (LEVELS - 1 - l)) <
                b->error[best][i] + price * b->unknowns[i] / (1 << 3 * (LEVELS - 1 - best)))
                best = l;
        *error += b->error[best][i];
        *unknowns += b->unknowns[i] / (1 << 3 * (LEVELS - 1 - best));
    }
    *error = sqrt(*error / b->truth);
    *unknowns /= b->all;
}

static double oracle(const struct blocks *b)
{
    double lo = 0, hi = b->truth, e, u;
    for (int i = 0; i < 200; i++) {
        double mid = (lo + hi) / 2;
        oracle_at(b, mid, &e, &u);
        *(u <= BUDGET ? &hi : &lo) = mid;
    }
    oracle_at(b, hi, &e, &u);
    return e;
}

/* All at the middle level, the finest where the detail per unknown is largest, while the budget lasts. */
static double by_detail(const struct blocks *b)
{
    double left = (BUDGET - 1. / 8) * b->all, sum = 0;
    bool *fine = pvx_calloc(b->n, sizeof *fine);
    if (fine == NULL)
        abort();
    for (;;) {
        size_t best = b->n;
        for (size_t i = 0; i < b->n; i++)
            if (!fine[i] && b->unknowns[i] > 0 && b->unknowns[i] * 7 / 8 <= left &&
                (best == b->n ||
                 b->detail[i] / b->unknowns[i] > b->detail[best] / b->unknowns[best]))
                best = i;
        if (best == b->n)
            break;
        fine[best] = true;
        left -= b->unknowns[best] * 7 / 8;
    }
    for (size_t i = 0; i < b->n; i++)
        sum += b->error[fine[i] ? 2 : 1][i];
    free(fine);
    return sqrt(sum / b->truth);
}

static void flame(FILE *csv, enum flame_kind kind, pvx_pool *pool)
{
    static const int32_t size[3] = {320, 240, FINE};
    const struct flame *f = &flames[kind];
    struct scene s;
    struct shot shot;
    struct uniform u[GRIDS];
    struct blocks b;
    double off[GRIDS];
    if (!scene_new(&s, kind, &views_8, size, f->t, pool))
        return;
    shot_new(&shot, &s, &noise_1, 1);
    scene_truth(&s, REC_TRILINEAR, pool);
    const struct rec_grid at = s.rig.grid;
    for (int i = 0; i < GRIDS; i++) {
        regrid(&s.rig, &at, along[i]);
        u[i].grid = s.rig.grid;
        rec_sysmat *S = scene_matrix(&s, 0, pool, NULL);
        u[i].dense = must_floats(rec_grid_count(&s.rig.grid) * (size_t)s.nch);
        u[i].report = solve_once(&s, &shot, S, rec_solver_names()[0], pool, u[i].dense, &u[i].ms);
        u[i].view = view_error(&s, u[i].dense, pool);
        rec_sysmat_free(&S);
    }
    blocks_new(&b, &at, &s, u);
    for (int i = 0; i < GRIDS; i++) {
        off[i] = 0;
        for (size_t k = 0; k < b.n; k++)
            off[i] += b.error[i][k];
        off[i] = sqrt(off[i] / b.truth);
    }
    const struct uniform *a = &u[1], *z = &u[2], *q = &u[3];
    bench_row(csv,
              "%s,%s,%.4f,%.4f,%.4f,%.4f,%.4f,%.4f,%.3f,%.3f,%.3f,%.3f,%.3f,%.3f,%.3f,%.3f,%.1f",
              f->name, f->use, off[0], off[1], off[3], off[2], oracle(&b), by_detail(&b), a->view,
              z->view, q->view, (double)a->report.active_voxels / (double)z->report.active_voxels,
              (double)q->report.active_voxels / (double)z->report.active_voxels,
              (double)a->report.entries / (double)z->report.entries,
              (double)q->report.entries / (double)z->report.entries, q->ms / z->ms, z->ms);
    blocks_free(&b);
    for (int i = 0; i < GRIDS; i++)
        free(u[i].dense);
    shot_free(&shot);
    scene_fini(&s);
}

int main(int argc, char **argv)
{
    pvx_pool *pool;
    CHECK(pvx_pool_new(2, "bench", &pool));
    printf("\nfiner where needed: trilinear, 8 cameras of 320x240, 1 %% noise, %s, %u threads\n",
           rec_solver_names()[0], pvx_pool_threads(pool));
    FILE *csv =
        bench_csv(argc, argv, "finer",
                  "scene,use,volume_32,volume_64,volume_80,volume_128,oracle,rule,view_64,view_128,"
                  "view_80,unknowns_64,unknowns_80,entries_64,entries_80,time_80,ms_128");
    flame(csv, FLAME_JET, pool);
    flame(csv, FLAME_HOLLOW, pool);
    flame(csv, FLAME_CANDLES, pool);
    flame(csv, FLAME_SHEETS, pool);
    flame(csv, FLAME_WALL, pool);
    flame(csv, FLAME_SHELL, pool);
    flame(csv, FLAME_POOL, pool);
    fclose(csv);
    pvx_pool_free(&pool);
    return *bench_status();
}
