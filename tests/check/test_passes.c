/* test_passes.c - the loops of the default solver, compiled for any processor and for AVX2, one by one: the
 * same bits in every vector and every partial sum, at odd sizes, for one channel, three, and three with
 * weights of their own, and nothing read or written beside the vectors (guard pages behind them). */
#include "tests/lib/scene.h"

#include "recon/solve/passes/pcg_pass.h"
#include "tests/lib/guarded.h"

#if defined(__x86_64__)
static struct scene sc;

static const int32_t sizes[] = {1, 2, 3, 5, 7, 17, 63, 64, 65, 127, 129, 511, 1027};

enum {
    X,
    NEXT,
    PHI,
    PHI_OLD,
    D,
    LX,
    AR,
    SCALE,
    R,
    Q,
    W,
    W4,
    DIAG,
    BY,
    INVERSE,
    STIFF_DIAG,
    DIAG2,
    RUN,
    CLIPPED,
    N_VECTORS
};

/* What a pass reads and writes: one copy for each table. */
struct bed {
    rec_problem pb;
    struct rec_pcg t;
    void *v[N_VECTORS];
    size_t bytes[N_VECTORS];
};

static void bed_new(struct bed *b, const struct rec_subsys *a, bool per_channel)
{
    size_t n = (size_t)a->n, rows = a->win.room, lane = (size_t)a->cs * sizeof(float);
    for (int i = X; i <= SCALE; i++)
        b->bytes[i] = n * lane;
    b->bytes[R] = b->bytes[Q] = rows * lane;
    b->bytes[W] = rows * sizeof(float);
    b->bytes[W4] = rows * 4 * sizeof(float);
    for (int i = DIAG; i <= DIAG2; i++)
        b->bytes[i] = n * sizeof(float);
    b->bytes[RUN] = n * sizeof(struct rec_run);
    b->bytes[CLIPPED] = n * sizeof(int32_t);
    for (int i = 0; i < N_VECTORS; i++)
        b->v[i] = guarded(b->bytes[i]);
    rec_images_free(&b->pb.images);
    memset(&b->pb, 0, sizeof b->pb);
    T_EQ_I(rec_images_new(a->S, a->cs, &b->pb.images), PVX_OK);
    b->pb.a = a;
    b->pb.cs = a->cs;
    b->pb.in.per_channel = per_channel;
    b->pb.w = b->v[W];
    b->pb.w4 = b->v[W4];
    b->pb.diag = b->v[DIAG];
    b->pb.clipped = b->v[CLIPPED];
    b->t = (struct rec_pcg){.pb = &b->pb,
                            .smooth = {.run = b->v[RUN], .diag2 = b->v[DIAG2]},
                            .stiff = {b->v[BY], b->v[INVERSE], b->v[STIFF_DIAG]},
                            .x = b->v[X],
                            .next = b->v[NEXT],
                            .phi = b->v[PHI],
                            .phi_old = b->v[PHI_OLD],
                            .d = b->v[D],
                            .lx = b->v[LX],
                            .ar = b->v[AR],
                            .scale = b->v[SCALE],
                            .r = b->v[R],
                            .q = b->v[Q]};
    rec_smooth_init(&b->t.smooth, &a->S->grid);
}

/* Any state of an iteration: half of x at the bound, steps that clip, a lane that stands still, columns
 * without a diagonal. */
static void bed_fill(struct bed *b)
{
    for (int i = X; i <= W4; i++)
        for (size_t k = 0; k < b->bytes[i] / sizeof(float); k++)
            ((float *)b->v[i])[k] = (float)t_uniform(i == W || i == W4 ? 0 : -1, 1);
    for (size_t k = 0; k < b->bytes[X] / sizeof(float); k++)
        b->t.x[k] = fmaxf(b->t.x[k], 0);
    for (int i = R; i <= Q; i++) { /* where windows lie that are not there */
        size_t end = b->bytes[i] / sizeof(float);
        for (size_t k = b->pb.a->win.nowhere * (size_t)b->pb.cs; k < end; k++)
            ((float *)b->v[i])[k] = 0;
    }
    for (size_t q = 0; q < (size_t)b->pb.a->n; q++) {
        float inverse = (float)t_uniform(0.3, 2);
        b->t.stiff.by[q] = 1 / inverse;
        b->t.stiff.inverse[q] = inverse;
        b->t.stiff.diag[q] = (float)t_uniform(1, 50);
        ((float *)b->v[DIAG])[q] = q % 9 == 8 ? 0 : (float)t_uniform(0, 1);
    }
    for (int l = 0; l < 4; l++) {
        b->t.alpha[l] = l == 1 ? 0 : t_uniform(0.1, 3);
        b->t.beta[l] = t_uniform(0, 1);
        b->t.mu[l] = t_uniform(0, 1);
        b->t.back[l] = t_uniform(0, 1);
        b->t.any_clipped = true;
        b->t.usual = t_uniform(0.1, 1);
        b->t.lambda[l] = l == 2 ? 0 : t_uniform(0, 2);
        b->pb.share[l] = t_uniform(0.2, 1);
    }
}

/* The copy holds what the first does, in vectors of its own. */
static void bed_copy(struct bed *to, const struct bed *from)
{
    for (int i = 0; i < N_VECTORS; i++)
        memcpy(to->v[i], from->v[i], from->bytes[i]);
    memcpy(to->pb.part, from->pb.part, sizeof to->pb.part);
    memcpy(to->pb.share, from->pb.share, sizeof to->pb.share);
    memcpy(to->t.alpha, from->t.alpha, sizeof to->t.alpha);
    memcpy(to->t.beta, from->t.beta, sizeof to->t.beta);
    memcpy(to->t.mu, from->t.mu, sizeof to->t.mu);
    memcpy(to->t.back, from->t.back, sizeof to->t.back);
    memcpy(to->t.lambda, from->t.lambda, sizeof to->t.lambda);
    to->t.usual = from->t.usual;
    to->t.any_clipped = from->t.any_clipped;
}

static void same(const char *pass, const struct bed *a, const struct bed *b)
{
    static const char *const name[] = {
        "x", "next", "phi",  "phi_old", "d",       "lx",          "ar",    "scale", "r",      "q",
        "w", "w4",   "diag", "by",      "inverse", "diag of LVL", "diag2", "runs",  "clipped"};
    for (int i = 0; i < N_VECTORS; i++)
        T_CHECK_(memcmp(a->v[i], b->v[i], a->bytes[i]) == 0, "%s: other bits in %s, n %d, cs %d",
                 pass, name[i], a->pb.a->n, a->pb.cs);
    T_CHECK_(memcmp(a->pb.part, b->pb.part, sizeof a->pb.part) == 0, "%s: other sums, n %d, cs %d",
             pass, a->pb.a->n, a->pb.cs);
    T_CHECK_(memcmp(a->pb.n_clipped, b->pb.n_clipped, sizeof a->pb.n_clipped) == 0,
             "%s: others clipped", pass);
}

/* Each pass on what the passes before it left.  How many voxels were clipped. */
static size_t compare(const struct rec_subsys *a, bool per_channel)
{
    enum { ROWS = 1, COLUMNS = 2, SLABS = 4 };
    static const struct {
        const char *name;
        enum rec_pcg_pass which;
        int tasks;
    } pass[] = {{"begin", REC_PASS_BEGIN, COLUMNS},
                {"scale", REC_PASS_SCALE, COLUMNS},
                {"direction", REC_PASS_DIRECTION, COLUMNS},
                {"curvature", REC_PASS_CURVATURE, ROWS | COLUMNS},
                {"step", REC_PASS_STEP, COLUMNS},
                {"clipped", REC_PASS_CLIPPED, SLABS},
                {"residual", REC_PASS_RESIDUAL, ROWS | COLUMNS},
                {"smoothness", REC_PASS_SMOOTHNESS, COLUMNS},
                {"gradient", REC_PASS_GRADIENT, COLUMNS},
                {"brightness", REC_PASS_BRIGHTNESS, COLUMNS},
                {"stiffness", REC_PASS_STIFFNESS, COLUMNS},
                {"regradient", REC_PASS_REGRADIENT, COLUMNS},
                {"slope", REC_PASS_SLOPE, COLUMNS},
                {"retreat", REC_PASS_RETREAT, COLUMNS}};
    struct rec_pcg_passes table[2];
    rec_pcg_passes_init(&table[0], PVX_CPU_REF);
    rec_pcg_passes_init(&table[1], PVX_CPU_AVX2);
    static struct bed bed[2];
    bed_new(&bed[0], a, per_channel);
    bed_new(&bed[1], a, per_channel);
    bed_fill(&bed[0]);
    bed_copy(&bed[1], &bed[0]);
    for (size_t p = 0; p < sizeof pass / sizeof *pass; p++) {
        size_t tasks = (pass[p].tasks & ROWS ? rec_row_chunks(&bed[0].pb) : 0) +
                       (pass[p].tasks & COLUMNS ? rec_column_chunks(&bed[0].pb) : 0) +
                       (pass[p].tasks & SLABS ? (size_t)a->slabs : 0);
        for (int i = 0; i < 2; i++) {
            pvx_task_fn fn = table[i].loop[pass[p].which];
            if (pass[p].which == REC_PASS_CURVATURE) /* A d is in the images */
                rec_start_product(&bed[i].pb, bed[i].t.d);
            for (size_t k = 0; k < tasks; k++)
                fn(&bed[i].t, k);
        }
        same(pass[p].name, &bed[0], &bed[1]);
        if (p == 0) { /* neighbours stay; the others need something to work on */
            bed_fill(&bed[0]);
            bed_copy(&bed[1], &bed[0]);
        }
    }
    size_t clipped = 0;
    for (size_t k = 0; k < rec_column_chunks(&bed[0].pb); k++)
        clipped += (size_t)bed[0].pb.n_clipped[k];
    return clipped;
}

/* n voxels in runs, so that some have neighbours along every axis and some none. */
static int32_t pick(int32_t n, int32_t *col)
{
    int32_t at = 0;
    for (int32_t j = 0, left = (int32_t)sc.voxels; j < (int32_t)sc.voxels && at < n; j++, left--)
        if (left <= n - at || t_uniform(0, 1) < (j / 7 % 2 ? 0.9 : 0.3))
            col[at++] = j;
    return at;
}

T_CASE(same_bits_on_every_instruction_set)
{
    if (pvx_cpu_have() < PVX_CPU_AVX2)
        T_SKIP("no AVX2 here");
    struct rec_kernels k;
    struct rec_restrictor *r;
    bool present[REC_MAX_CAMERAS];
    int32_t *col = pvx_calloc(sc.voxels, sizeof *col);
    memset(present, true, sizeof present);
    rec_kernels_init(&k, PVX_CPU_REF); /* one product for both */
    T_EQ_I(rec_restrictor_new(sc.S, &r), PVX_OK);
    size_t clipped = 0; /* of 17 voxels there may be none */
    for (int cs = 1; cs <= 4; cs += 3) {
        struct rec_subsys *a;
        T_EQ_I(rec_subsys_new(sc.S, &k, sc.pool, cs, &a), PVX_OK);
        for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
            rec_subsys_restrict(a, r, col, pick(sizes[i], col), present);
            T_EQ_I(a->n, sizes[i]);
            clipped += compare(a, false);
            if (cs == 4)
                clipped += compare(a, true);
        }
        rec_subsys_free(&a);
    }
    T_OK(clipped > 0);
    rec_restrictor_free(&r);
    free(col);
}

/* (1) of smooth.h as it stands there, of any neighbours. */
static void second_differences(const struct rec_subsys *a, const struct rec_smooth *s,
                               const float *v, size_t cs, float *out)
{
    const struct rec_grid *g = &a->S->grid;
    for (int32_t q = 0; q < a->n; q++)
        for (size_t l = 0; l < cs; l++) {
            double sum = 0;
            for (int f = 0; f < 6; f++) {
                int32_t ijk[3], axis = f / 2, i;
                rec_grid_ijk(g, a->col[q], ijk);
                ijk[axis] += f % 2 ? 1 : -1;
                bool in = ijk[axis] >= 0 && ijk[axis] < g->n[axis];
                int32_t voxel = in ? rec_grid_index(g, ijk[0], ijk[1], ijk[2]) : -1;
                i = rec_first_column(a->col, a->n, voxel);
                in = in && i < a->n && a->col[i] == voxel;
                double y = in ? (double)v[(size_t)i * cs + l] : 0;
                sum += (double)s->axis[axis] * ((double)v[(size_t)q * cs + l] - y);
            }
            out[(size_t)q * cs + l] = (float)sum;
        }
}

T_CASE(second_differences_are_those_of_the_neighbours)
{
    struct rec_kernels k;
    struct rec_restrictor *r;
    bool present[REC_MAX_CAMERAS];
    int32_t *col = pvx_calloc(sc.voxels, sizeof *col);
    memset(present, true, sizeof present);
    rec_kernels_init(&k, PVX_CPU_REF);
    T_EQ_I(rec_restrictor_new(sc.S, &r), PVX_OK);
    for (size_t cs = 1; cs <= 4; cs += 3) {
        struct rec_subsys *a;
        T_EQ_I(rec_subsys_new(sc.S, &k, sc.pool, (int)cs, &a), PVX_OK);
        for (size_t i = 0; i < sizeof sizes / sizeof *sizes; i++) {
            size_t n = (size_t)sizes[i];
            rec_subsys_restrict(a, r, col, pick(sizes[i], col), present);
            struct rec_smooth s = {.run = guarded(n * sizeof *s.run),
                                   .diag2 = guarded(n * sizeof *s.diag2)};
            float *v = guarded(n * cs * sizeof *v), *want = guarded(n * cs * sizeof *want);
            float *got = guarded((n * cs + REC_SMOOTH_PAD) * sizeof *got);
            rec_smooth_init(&s, &a->S->grid);
            for (size_t o = 0; o < n * cs; o++)
                v[o] = (float)t_uniform(-1, 1);
            second_differences(a, &s, v, cs, want);
            for (int32_t at = 0, end; at < a->n;
                 at = end) { /* some at a time, and of those a few */
                int32_t half = at + (int32_t)t_uniform(0, 40);
                end = at + 1 + (int32_t)t_uniform(0, 80);
                end = end < a->n ? end : a->n;
                half = half < end ? half : end;
                rec_smooth_runs(&s, a, at, end);
                const struct rec_run *run = s.run + at;
                rec_smooth_over(&s, &run, v, cs, (struct rec_span){at, half},
                                got + (size_t)at * cs);
                rec_smooth_over(&s, &run, v, cs, (struct rec_span){half, end},
                                got + (size_t)half * cs);
            }
            for (size_t o = 0; o < n * cs; o++)
                T_NEAR(got[o], want[o], 1e-5);
        }
        rec_subsys_free(&a);
    }
    rec_restrictor_free(&r);
    free(col);
}

T_MAIN(scene_new(&sc, 4, 40, 12, 1, 1), scene_free(&sc))
#else
T_CASE(same_bits_on_every_instruction_set)
{
    T_SKIP("one set of loops on this CPU");
}
#endif
