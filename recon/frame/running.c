#include "recon/frame/running.h"

#include <math.h>
#include <stdatomic.h>
#include <string.h>

#include "base/mem.h"
#include "recon/frame/impl.h"
#include "recon/frame/parts.h"

#define FADE   0.9F  /* (1) */
#define SIDE   4     /* voxels of a block */
#define SHARE  0.05F /* a of (2) */
#define GROUPS 8     /* cameras are left out in at most so many */
#define ENOUGH 8     /* of D, and each group of J, or there is a doubt */
#define FRESH  4U    /* beside the number of a table */

enum { J, D, T, N_KINDS };

/* What is known after a solve: (2) added up over the kinds. */
struct running_table {
    float *ratio; /* [blocks][cs] */
    bool any, late;
    uint32_t doubt, solves, iterations;
    uint64_t mask; /* cameras that were believed */
    int64_t t_ns;
    unsigned age;
};

struct rec_running {
    int32_t blocks[3];
    size_t cs, voxels, n_blocks, bytes;
    void *areas;
    int64_t pause_ns;
    atomic_uint age;

    /* of add */
    rec_perturb *perturb;
    struct rec_spread spread;
    float *x, *mean, *detail;                 /* [n][cs] */
    float *squares[N_KINDS], *light[N_KINDS]; /* [blocks][cs] E, L of (1) */
    float *around[3];                         /* [blocks][cs] work areas */
    double part;                              /* R of (5) in bars.h, of the newest set */
    double weight[N_KINDS], weight2[N_KINDS]; /* sums of the weights and of their squares */
    uint32_t turn, fresh[N_KINDS], solves, iterations; /* fresh: since the cameras changed */
    unsigned has_age;
    uint64_t mask;
    uint32_t cameras; /* in it */
    int64_t t_ns;

    /* three tables: one is written, one is read, and the newest that nobody has */
    struct running_table table[3];
    unsigned writes, reads;
    atomic_uint newest; /* with FRESH: nobody has read it */

    /* of bars */
    struct rec_spread look;
    struct rec_subsys seen; /* the frame's columns, without its system */
    float *sd;              /* [n][cs] */
};

static size_t running_lay_out(struct rec_running *r, float *base)
{
    const size_t vector = r->voxels * r->cs, blocks = r->n_blocks * r->cs;
    struct {
        float **to;
        size_t floats;
    } const parts[] = {
        {&r->x, vector},
        {&r->mean, vector},
        {&r->detail, vector},
        {&r->sd, vector},
        {&r->spread.work[0], vector},
        {&r->spread.work[1], vector},
        {&r->look.work[0], vector},
        {&r->look.work[1], vector},
        {&r->spread.inverse, r->voxels},
        {&r->look.inverse, r->voxels},
        {(float **)&r->spread.place, r->voxels},
        {(float **)&r->look.place, r->voxels},
        {&r->squares[J], blocks},
        {&r->squares[D], blocks},
        {&r->squares[T], blocks},
        {&r->light[J], blocks},
        {&r->light[D], blocks},
        {&r->light[T], blocks},
        {&r->around[0], blocks},
        {&r->around[1], blocks},
        {&r->around[2], blocks},
        {&r->table[0].ratio, blocks},
        {&r->table[1].ratio, blocks},
        {&r->table[2].ratio, blocks},
    };
    size_t at = 0;
    for (size_t i = 0; i < sizeof parts / sizeof *parts; i++) {
        if (base != NULL)
            *parts[i].to = base + at;
        at += (parts[i].floats + 15) / 16 * 16;
    }
    return at * sizeof *base;
}

pvx_err rec_running_new(const rec_sysmat *S, int nch, int64_t pause_ns, rec_running **out,
                        struct pvx_diag *d)
{
    rec_running *r = *out = pvx_calloc(1, sizeof *r);
    if (r == NULL)
        return pvx_fail(d, PVX_ENOMEM, "error bars: out of memory");
    r->cs = nch == 3 ? 4 : 1;
    r->voxels = rec_grid_count(&S->grid);
    r->pause_ns = pause_ns;
    r->n_blocks = 1;
    for (int a = 0; a < 3; a++) {
        r->blocks[a] = (S->grid.n[a] + SIDE - 1) / SIDE;
        r->n_blocks *= (size_t)r->blocks[a];
    }
    r->writes = 1;
    r->reads = 2;
    r->seen = (struct rec_subsys){.S = S, .cs = (int)r->cs};
    r->bytes = running_lay_out(r, NULL);
    r->areas = pvx_reserve(r->bytes);
    pvx_err e = r->areas != NULL ? rec_perturb_new(S, nch, &r->perturb) : PVX_ENOMEM;
    if (e != PVX_OK) {
        rec_running_free(out);
        return pvx_fail(d, e, "error bars: work areas for %zu voxels: %s", rec_grid_count(&S->grid),
                        pvx_strerror(e));
    }
    running_lay_out(r, r->areas);
    return PVX_OK;
}

void rec_running_free(rec_running **r)
{
    if (*r == NULL)
        return;
    pvx_unreserve((*r)->areas, (*r)->bytes);
    rec_perturb_free(&(*r)->perturb);
    PVX_FREE(*r);
}

void rec_running_outdate(rec_running *r)
{
    atomic_fetch_add(&r->age, 1);
}

unsigned rec_running_age(const rec_running *r)
{
    return atomic_load(&r->age);
}

/* ---- blocks -------------------------------------------------------------------------------------*/

static size_t running_block(const rec_running *r, const rec_sysmat *S, int32_t voxel)
{
    const int32_t *n = S->grid.n;
    int32_t x = voxel % n[0], y = voxel / n[0] % n[1], z = voxel / n[0] / n[1];
    return (size_t)(((z / SIDE) * r->blocks[1] + y / SIDE) * r->blocks[0] + x / SIDE);
}

/* The set's part of (1): of v^2 by[lane], v [n][cs]; the light is in `mean`. */
static void running_gather(rec_running *r, const struct rec_subsys *a, int kind, const float *v,
                           const double by[4])
{
    size_t cs = r->cs, all = r->n_blocks * cs;
    for (size_t i = 0; i < all; i++) {
        r->squares[kind][i] *= FADE;
        r->light[kind][i] *= FADE;
    }
    for (int32_t q = 0; q < a->n; q++) {
        size_t to = running_block(r, a->S, a->col[q]) * cs, at = (size_t)q * cs;
        for (size_t l = 0; l < cs; l++) {
            r->squares[kind][to + l] += (float)by[l] * v[at + l] * v[at + l];
            r->light[kind][to + l] += r->mean[at + l];
        }
    }
    r->weight[kind] = r->weight[kind] * (double)FADE + 1;
    r->weight2[kind] = r->weight2[kind] * (double)(FADE * FADE) + 1;
    r->fresh[kind]++;
}

/* to = from and its two neighbours along the axis, added up. */
static void running_along(const rec_running *r, int axis, const float *from, float *to)
{
    size_t step = r->cs, all = r->n_blocks * r->cs;
    for (int a = 0; a < axis; a++)
        step *= (size_t)r->blocks[a];
    for (size_t i = 0; i < all; i++) {
        size_t at = i / step % (size_t)r->blocks[axis];
        to[i] = from[i] + (at > 0 ? from[i - step] : 0) +
                (at + 1 < (size_t)r->blocks[axis] ? from[i + step] : 0);
    }
}

/* of(B+) into `to`; `work` is another area. */
static void running_around(const rec_running *r, const float *of, float *work, float *to)
{
    running_along(r, 0, of, to);
    running_along(r, 1, to, work);
    running_along(r, 2, work, to);
}

/* (2) of a kind, times c^2, added to the table. */
static void running_ratio(rec_running *r, int kind, float *ratio)
{
    double n = r->weight[kind] * r->weight[kind] / r->weight2[kind];
    double c = kind == T ? 1 : rec_bars_student(n), sum[4] = {0}, light[4] = {0};
    float most[4] = {0}, *E = r->around[0], *L = r->around[1];
    size_t all = r->n_blocks * r->cs;
    running_around(r, r->squares[kind], r->around[2], E);
    running_around(r, r->light[kind], r->around[2], L);
    for (size_t i = 0; i < all; i++) {
        size_t l = i % r->cs;
        sum[l] += (double)r->squares[kind][i];
        light[l] += (double)r->light[kind][i];
        most[l] = fmaxf(most[l], L[i]);
    }
    for (size_t i = 0; i < all; i++) {
        size_t l = i % r->cs;
        float a = SHARE * most[l], usual = light[l] > 0 ? (float)(sum[l] / light[l]) : 0;
        ratio[i] += L[i] + a > 0 ? (float)(c * c) * (E[i] + a * usual) / (L[i] + a) : 0;
    }
}

/* ---- one more solve -----------------------------------------------------------------------------*/

static void running_anew(rec_running *r)
{
    for (int k = 0; k < N_KINDS; k++) {
        memset(r->squares[k], 0, r->n_blocks * r->cs * sizeof *r->squares[k]);
        memset(r->light[k], 0, r->n_blocks * r->cs * sizeof *r->light[k]);
        r->weight[k] = r->weight2[k] = 0;
        r->fresh[k] = 0;
    }
    r->turn = r->solves = r->iterations = 0;
}

static uint64_t running_mask(const rec_frame *f, uint32_t *cameras)
{
    uint64_t mask = 0;
    *cameras = 0;
    for (size_t c = 0; c < f->S->n_cameras; c++) {
        mask |= (uint64_t)f->believed[c] << c;
        *cameras += f->believed[c];
    }
    return mask;
}

static uint32_t running_groups(uint32_t cameras)
{
    return cameras < REC_BARS_LEAVES ? 0 : cameras < GROUPS ? cameras : GROUPS;
}

/* Repeats the solve with what it is the turn of, into r->x; by: s of (1).  Returns the kind. */
static int running_solve(rec_running *r, rec_frame *f, const struct rec_perturb_fit fit[4],
                         uint64_t seed, double by[4])
{
    bool out[REC_MAX_CAMERAS] = {false};
    uint32_t groups = running_groups(r->cameras), group = groups > 0 ? r->turn / 2 % groups : 0;
    int kind = groups > 0 && r->turn % 2 == 0 ? J : D;
    struct rec_perturbation p = {.seed = seed};
    p.iterations = rec_bars_iterations(&f->report.solve, kind == J ? r->cameras : 0);
    if (kind == J) {
        for (size_t c = 0, k = 0; c < f->S->n_cameras; c++)
            out[c] = f->believed[c] && k++ % groups == group;
        p.out = out;
        for (int l = 0; l < 4; l++)
            by[l] = rec_bars_groups(&f->report.solve, r->cameras, groups) * groups;
    } else {
        double factor[4] = {0};
        rec_bars_drawn(fit, f->nch, groups == 0, r->part, &p, factor);
        for (int l = 0; l < 4; l++)
            by[l] = factor[l] * factor[l];
    }
    r->iterations += rec_perturb_solve(r->perturb, &p, r->x);
    r->solves++;
    r->turn++;
    return kind;
}

/* Hands the table over to the reader. */
static void running_tell(rec_running *r, const struct rec_perturb_fit fit[4], int nch)
{
    struct running_table *t = &r->table[r->writes];
    uint32_t groups = running_groups(r->cameras);
    t->any = r->weight[D] > 0 && (groups == 0 || r->weight[J] > 0);
    t->late = r->fresh[D] < ENOUGH || r->fresh[J] < groups;
    t->doubt = rec_bars_doubt(fit, nch, r->cameras, r->part);
    t->solves = r->solves;
    t->iterations = r->iterations;
    t->mask = r->mask;
    t->t_ns = r->t_ns;
    t->age = r->has_age;
    memset(t->ratio, 0, r->n_blocks * r->cs * sizeof *t->ratio);
    for (int k = 0; k < N_KINDS; k++)
        if (r->weight[k] > 0)
            running_ratio(r, k, t->ratio);
    r->writes = atomic_exchange(&r->newest, r->writes | FRESH) & ~FRESH;
}

static void running_begin(rec_running *r, const rec_frame *f, const struct rec_running_set *set)
{
    uint64_t mask = running_mask(f, &r->cameras);
    if (set->age != r->has_age || r->solves == 0 || set->t_ns - r->t_ns > r->pause_ns)
        running_anew(r);
    if (mask != r->mask)
        memset(r->fresh, 0, sizeof r->fresh);
    r->has_age = set->age;
    r->mask = mask;
    r->t_ns = set->t_ns;
}

bool rec_running_add(rec_running *r, rec_frame *f, const struct rec_running_set *set)
{
    static const double as_it_is[4] = {1, 1, 1, 1};
    struct rec_perturb_fit fit[4];
    double by[4];
    if (set->age != rec_running_age(r) || !rec_solver_is_default(f->solver->p.solver) ||
        f->sub->card != NULL || !rec_perturb_begin(r->perturb, rec_frame_problem(f), f->x, fit))
        return false;
    running_begin(r, f, set);
    rec_spread_begin(&r->spread, f->sub);
    r->part = rec_bars_detail(&r->spread, fit, r->cameras, f->x, r->mean, r->detail);
    rec_spread_mean(&r->spread, f->x, r->mean);
    rec_spread_end(&r->spread);
    int kind = running_solve(r, f, fit, set->seed, by);
    rec_perturb_end(r->perturb);
    size_t vector = (size_t)f->sub->n * r->cs;
    for (size_t i = 0; i < vector; i++)
        r->x[i] -= f->x[i];
    running_gather(r, f->sub, kind, r->x, by);
    running_gather(r, f->sub, T, r->detail, as_it_is);
    running_tell(r, fit, f->nch);
    return true;
}

/* ---- the bars of a volume -----------------------------------------------------------------------*/

struct running_pass {
    const rec_running *r;
    const struct running_table *t;
};

/* (3); sd has <x>. */
static void running_deviations(void *ctx, size_t k)
{
    const struct running_pass *p = ctx;
    const rec_running *r = p->r;
    int32_t q0, q1;
    rec_chunk_range(r->seen.n, k, &q0, &q1);
    for (int32_t q = q0; q < q1; q++) {
        float *sd = r->sd + (size_t)q * r->cs;
        const float *ratio = p->t->ratio + running_block(r, r->seen.S, r->seen.col[q]) * r->cs;
        for (size_t l = 0; l < r->cs; l++)
            sd[l] = sqrtf(fmaxf(sd[l] * ratio[l], 0));
    }
}

static const struct running_table *running_newest(rec_running *r)
{
    if (atomic_load(&r->newest) & FRESH)
        r->reads = atomic_exchange(&r->newest, r->reads) & ~FRESH;
    return &r->table[r->reads];
}

void rec_running_bars(rec_running *r, const rec_frame *f, int64_t t_ns, pvx_pool *pool,
                      struct rec_bars_view *out)
{
    const struct running_table *t = running_newest(r);
    struct rec_sparse v;
    uint32_t cameras;
    uint64_t mask = running_mask(f, &cameras);
    rec_frame_volume(f, &v);
    *out = (struct rec_bars_view){.nch = v.nch, .cs = v.cs, .n = v.n, .index = v.index};
    out->solves = t->solves;
    out->iterations = t->iterations;
    if (!t->any || v.n == 0)
        return;
    r->seen.n = v.n;
    r->seen.col = v.index;
    r->seen.pool = pool;
    rec_spread_begin(&r->look, &r->seen);
    rec_spread_mean(&r->look, v.value, r->sd);
    rec_spread_end(&r->look);
    pvx_pool_run(pool, rec_chunks(v.n), running_deviations, &(struct running_pass){r, t});
    out->sd = r->sd;
    out->doubt = t->doubt | (cameras < REC_BARS_CAMERAS ? REC_BARS_FEW_CAMERAS : 0);
    if (t->late || t->mask != mask || t->age != rec_running_age(r) || t_ns - t->t_ns > r->pause_ns)
        out->doubt |= REC_BARS_LATE;
}
