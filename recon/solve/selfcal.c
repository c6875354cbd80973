#include "recon/solve/selfcal.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/solve/card.h"

#define TILES    REC_SELFCAL_TILES
#define ROUNDS   2    /* renewals of the finest grid with an estimate, at most */
#define MOST     3.0  /* bins that a picture is shifted, at most, */
#define MOST_LOG 0.3  /* and the largest step of a gain */
#define VOXELS   1000 /* for (5), about */

/* The sums of a tile.  u: across, v: down. */
enum { S_B, S_R, S_MU, S_MV, S_GU, S_GV, S_HUU, S_HUV, S_HVV, S_YU, S_YV, N_SUMS };
_Static_assert(N_SUMS == REC_SELFCAL_SUMS, "selfcal.h names them");

struct aim {                         /* of a camera */
    double gain, shift[2];           /* (1), bins of the finest grid's pictures */
    double seen_gain, seen_shift[2]; /* the same as estimated, whether it is applied or not */
    double step[3];                  /* a, d of the last estimate, bins of its level */
    double gain_var, var[3];         /* (6) of it: uu, uv, vv */
    double freedom[2];               /* of (6), for gain and shift */
    double J[2][3];                  /* (5) */
    double tile[TILES][N_SUMS];
};

struct rec_selfcal {
    const rec_sysmat *S;
    enum rec_selfcal_mode mode;
    enum rec_selfcal_how how;
    bool any[2];    /* gains, shifts are corrected */
    double test[2]; /* (7) */
    double size[2]; /* (8) */
    bool estimated;
    double scale; /* of the last estimate */
    size_t cameras;
    bool in[REC_MAX_CAMERAS];
    uint32_t *mark, marks; /* [blocks of S] blocks of the system at hand have the last mark */
    struct aim *aim;       /* [cameras of S] */
};

/* ---- how pictures move with the volume ------------------------------------------------------------ */

/* Solves A z = y of n <= 4 unknowns, A symmetric; an unknown that is not determined is 0. */
static void selfcal_solve(int n, double A[4][4], double y[4])
{
    for (int i = 0; i < n; i++)
        for (int j = i + 1; j < n; j++) {
            double f = A[i][i] > 0 ? A[j][i] / A[i][i] : 0;
            for (int k = i; k < n; k++)
                A[j][k] -= f * A[i][k];
            y[j] -= f * y[i];
        }
    for (int i = n - 1; i >= 0; i--) {
        for (int k = i + 1; k < n; k++)
            y[i] -= A[i][k] * y[k];
        y[i] = A[i][i] > 0 ? y[i] / A[i][i] : 0;
    }
}

/* J of (5): an affine fit of the places of footprints to those of the system's voxels.  The footprints are far apart,
 * so all are fetched before the first is read. */
static void aim_follow(struct aim *o, const struct rec_subsys *a, size_t c)
{
    const struct rec_grid *g = &a->S->grid;
    const struct rec_rect *fp[VOXELS];
    double A[2][4][4] = {{{0}}}, y[2][4] = {{0}};
    int32_t step = a->n / VOXELS + 1, ijk[VOXELS][3];
    for (int32_t k = 0; k * step < a->n; k++) {
        int32_t *i = ijk[k];
        rec_grid_ijk(g, a->col[k * step], i);
        fp[k] = a->S->block[c].fp + rec_brick_place(g, i[0], i[1], i[2]);
        __builtin_prefetch(fp[k]);
    }
    for (int32_t k = 0; k * step < a->n; k++) {
        struct rec_rect f = *fp[k];
        if (!rec_rect_seen(f))
            continue;
        double h[4] = {1}, at[2] = {0.5 * (f.x0 + f.x1), 0.5 * (f.y0 + f.y1)};
        for (int i = 0; i < 3; i++)
            h[i + 1] = ijk[k][i] - 0.5 * g->n[i];
        for (int m = 0; m < 2; m++)
            for (int i = 0; i < 4; i++) {
                y[m][i] += h[i] * at[m];
                for (int j = 0; j < 4; j++)
                    A[m][i][j] += h[i] * h[j];
            }
    }
    for (int m = 0; m < 2; m++) {
        selfcal_solve(4, A[m], y[m]);
        memcpy(o->J[m], y[m] + 1, sizeof o->J[m]);
    }
}

pvx_err rec_selfcal_new(const rec_sysmat *S, rec_selfcal **out)
{
    rec_selfcal *s = *out = pvx_calloc(1, sizeof *s);
    if (s == NULL)
        return PVX_ENOMEM;
    s->S = S;
    s->aim = pvx_calloc(S->n_cameras, sizeof *s->aim);
    s->mark = pvx_calloc(S->win.room / REC_ROW_BLOCK + 1, sizeof *s->mark);
    if (s->aim == NULL || s->mark == NULL) {
        rec_selfcal_free(out);
        return PVX_ENOMEM;
    }
    rec_selfcal_begin(s, REC_SELFCAL_OFF, REC_SELFCAL_ALONE, NULL);
    return PVX_OK;
}

void rec_selfcal_attach(rec_problem *pb, rec_selfcal *s)
{
    pb->selfcal = s;
}

void rec_selfcal_free(rec_selfcal **s)
{
    if (*s == NULL)
        return;
    free((*s)->aim);
    free((*s)->mark);
    PVX_FREE(*s);
}

void rec_selfcal_begin(rec_selfcal *s, enum rec_selfcal_mode mode, enum rec_selfcal_how how,
                       const struct rec_selfcal_given *given)
{
    s->mode = mode;
    s->how = how;
    s->any[0] = given != NULL && given->gain && mode != REC_SELFCAL_OFF;
    s->any[1] = given != NULL && given->shift && mode == REC_SELFCAL_ON;
    s->test[0] = s->test[1] = s->size[0] = s->size[1] = 0;
    s->estimated = false;
    for (size_t c = 0; c < s->S->n_cameras; c++) {
        s->aim[c].gain = s->any[0] ? given->camera[c].gain : 1;
        for (int i = 0; i < 2; i++)
            s->aim[c].shift[i] = s->any[1] ? given->camera[c].shift[i] : 0;
    }
}

/* Bins of the finest grid along one of the problem at hand. */
static double selfcal_scale(const rec_problem *pb)
{
    return (double)pb->a->S->binning / pb->selfcal->S->binning;
}

/* ---- tiles ----------------------------------------------------------------------------------------*/

/* Marks the blocks of the system: other bins have what an earlier one left. */
static void selfcal_mark(rec_selfcal *s, const struct rec_subsys *a)
{
    if (++s->marks == 0) {
        memset(s->mark, 0, (s->S->win.room / REC_ROW_BLOCK + 1) * sizeof *s->mark);
        s->marks = 1;
    }
    for (int32_t k = 0; k < a->n_blocks; k++)
        s->mark[a->block[k]] = s->marks;
}

/* Whether bin i was measured and is no bound. */
static inline bool selfcal_usable(const rec_problem *pb, size_t i)
{
    const rec_selfcal *s = pb->selfcal;
    return s->mark[i / REC_ROW_BLOCK] == s->marks && pb->a->is_row[i] && pb->in.w[i] > 0 &&
           (pb->in.least == NULL || pb->in.least[i] <= 0);
}

struct look {
    rec_problem *pb;
    const float *r;
};

/* Adds row i of camera c, at (x, y), to the sums of a block: few enough for floats. */
REC_INLINE void selfcal_row(const struct look *t, size_t c, size_t i, size_t x, size_t y, size_t cs,
                            rec_f4 sum[N_SUMS])
{
    const rec_problem *pb = t->pb;
    size_t bw = (size_t)pb->a->S->block[c].bw, bh = (size_t)pb->a->S->block[c].bh;
    size_t x0 = x > 0 && selfcal_usable(pb, i - 1) ? i - 1 : i;
    size_t x1 = x + 1 < bw && selfcal_usable(pb, i + 1) ? i + 1 : i;
    size_t y0 = y > 0 && selfcal_usable(pb, i - bw) ? i - bw : i;
    size_t y1 = y + 1 < bh && selfcal_usable(pb, i + bw) ? i + bw : i;
    const float *b = pb->b, *r = t->r;
    rec_f4 half = rec_splat(0.5F), quarter = rec_splat(0.25F), w = rec_splat(pb->w[i]);
    rec_f4 wb = w * rec_ld(b, i, cs), wr = w * rec_ld(r, i, cs);
    rec_f4 u = half * (rec_ld(b, x1, cs) - rec_ld(b, x0, cs)) +
               quarter * (rec_ld(r, x1, cs) - rec_ld(r, x0, cs));
    rec_f4 v = half * (rec_ld(b, y1, cs) - rec_ld(b, y0, cs)) +
               quarter * (rec_ld(r, y1, cs) - rec_ld(r, y0, cs));
    rec_f4 wu = w * u, wv = w * v;
    sum[S_B] += wb;
    sum[S_R] += wr;
    sum[S_MU] += wu;
    sum[S_MV] += wv;
    sum[S_GU] += wb * u;
    sum[S_GV] += wb * v;
    sum[S_HUU] += wu * u;
    sum[S_HUV] += wu * v;
    sum[S_HVV] += wv * v;
    sum[S_YU] += wr * u;
    sum[S_YV] += wr * v;
}

/* Adds up the sums of all tiles of camera c.  The bins of a block count for the tile of its first. */
REC_INLINE void selfcal_tiles(const struct look *t, size_t c, size_t cs)
{
    const struct rec_subsys *a = t->pb->a;
    size_t from = a->row0[c], to = a->row0[c + 1], bw = (size_t)a->S->block[c].bw;
    size_t side = rec_selfcal_tile(bw, (size_t)a->S->block[c].bh);
    struct aim *o = &t->pb->selfcal->aim[c];
    for (int32_t k = 0; k < a->n_blocks; k++) {
        size_t i = (size_t)a->block[k] * REC_ROW_BLOCK, end = i + REC_ROW_BLOCK;
        if (end <= from || i >= to)
            continue;
        i = i < from ? from : i;
        end = end > to ? to : end;
        double(*tile) = o->tile[(i - from) / bw / side * REC_SELFCAL_SIDE + (i - from) % bw / side];
        rec_f4 sum[N_SUMS];
        memset(sum, 0, sizeof sum);
        for (; i < end; i++)
            if (selfcal_usable(t->pb, i))
                selfcal_row(t, c, i, (i - from) % bw, (i - from) / bw, cs, sum);
        for (int n = 0; n < N_SUMS; n++)
            tile[n] +=
                ((double)sum[n][0] + (double)sum[n][1]) + ((double)sum[n][2] + (double)sum[n][3]);
    }
}

/* The totals of a camera's tiles, and how many of them count: by light, by gradient. */
static void aim_total(const struct aim *o, double all[N_SUMS], double count[2])
{
    double b2 = 0, h1 = 0, h2 = 0;
    memset(all, 0, N_SUMS * sizeof *all);
    for (int k = 0; k < TILES; k++) {
        const double *t = o->tile[k];
        double h = t[S_HUU] + t[S_HVV];
        b2 += t[S_B] * t[S_B];
        h1 += h;
        h2 += h * h;
        for (int j = 0; j < N_SUMS; j++)
            all[j] += t[j];
    }
    count[0] = b2 > 0 ? all[S_B] * all[S_B] / b2 : 0;
    count[1] = h2 > 0 ? h1 * h1 / h2 : 0;
}

/* (3) with its part of (6), n tiles. */
static void aim_shift(struct aim *o, const double all[N_SUMS], double n)
{
    double det = all[S_HUU] * all[S_HVV] - all[S_HUV] * all[S_HUV], a = all[S_R] / all[S_B];
    if (!(n > 2) || !(det > 1e-6 * all[S_HUU] * all[S_HVV]))
        return;
    const double inv[3] = {all[S_HVV] / det, -all[S_HUV] / det, all[S_HUU] / det};
    double yu = all[S_YU] - a * all[S_GU], yv = all[S_YV] - a * all[S_GV], var[3] = {0};
    double d[2] = {inv[0] * yu + inv[1] * yv, inv[1] * yu + inv[2] * yv};
    for (int k = 0; k < TILES; k++) {
        const double *t = o->tile[k];
        double eu = t[S_YU] - a * t[S_GU] - t[S_HUU] * d[0] - t[S_HUV] * d[1];
        double ev = t[S_YV] - a * t[S_GV] - t[S_HUV] * d[0] - t[S_HVV] * d[1];
        double u = inv[0] * eu + inv[1] * ev, v = inv[1] * eu + inv[2] * ev;
        var[0] += u * u;
        var[1] += u * v;
        var[2] += v * v;
    }
    for (int j = 0; j < 3; j++)
        o->var[j] = var[j] * n / (n - 2);
    o->freedom[1] = 2 * n - 2;
    o->step[1] = d[0];
    o->step[2] = d[1];
}

/* (4) with its part of (6), n tiles. */
static void aim_gain(struct aim *o, const double all[N_SUMS], double n)
{
    const double *d = o->step + 1;
    double a = (all[S_R] - d[0] * all[S_MU] - d[1] * all[S_MV]) / all[S_B], e2 = 0;
    if (!(n > 1))
        return;
    for (int k = 0; k < TILES; k++) {
        const double *t = o->tile[k];
        double e = t[S_R] - d[0] * t[S_MU] - d[1] * t[S_MV] - a * t[S_B];
        e2 += e * e;
    }
    o->gain_var = e2 / (all[S_B] * all[S_B]) * n / (n - 1);
    o->freedom[0] = n - 1;
    o->step[0] = a;
}

/* (2) to (4) and (6) of a camera.  What too few tiles determine stays 0, with infinite variance. */
static void aim_step(struct aim *o, bool shifts)
{
    double all[N_SUMS], count[2];
    memset(o->step, 0, sizeof o->step);
    o->gain_var = o->var[0] = o->var[2] = INFINITY;
    o->var[1] = o->freedom[0] = o->freedom[1] = 0;
    aim_total(o, all, count);
    if (!(all[S_B] > 0))
        return;
    if (shifts)
        aim_shift(o, all, count[1]);
    aim_gain(o, all, count[0]);
}

static void selfcal_look(void *ctx, size_t c)
{
    const struct look *t = ctx;
    const struct rec_subsys *a = t->pb->a;
    struct aim *o = &t->pb->selfcal->aim[c];
    bool shifts = t->pb->selfcal->mode == REC_SELFCAL_ON;
    if (!a->present[c])
        return;
    if (shifts)
        aim_follow(o, a, c);
    if (a->card == NULL)
        t->pb->cs == 4 ? selfcal_tiles(t, c, 4) : selfcal_tiles(t, c, 1);
    aim_step(o, shifts);
}

/* ---- all cameras ----------------------------------------------------------------------------------*/

/* (7): F of f and v degrees of freedom as a normal deviate (Paulson, Ann. Math. Stat. 13:233, 1942). */
static double selfcal_deviate(double F, double f, double v)
{
    double at = cbrt(F), a = 2 / (9 * f), b = 2 / (9 * v);
    return v > 0 ? ((1 - b) * at - (1 - a)) / sqrt(b * at * at + a) : 0;
}

static double selfcal_clamp(double v, double most)
{
    return fmin(fmax(v, -most), most);
}

/* Gains of mean 1/g = 1. */
static void anchor_gains(struct rec_selfcal_place *p, size_t cameras)
{
    double mean = 0, n = 0;
    for (size_t c = 0; c < cameras; c++)
        n += p[c].in[0];
    for (size_t c = 0; c < cameras; c++)
        mean += p[c].in[0] ? 1 / p[c].gain / n : 0;
    for (size_t c = 0; c < cameras; c++)
        p[c].gain *= p[c].in[0] ? mean : 1;
}

/* Shifts without (5). */
static void anchor_shifts(struct rec_selfcal_place *p, size_t cameras)
{
    double A[4][4] = {{0}}, T[4] = {0};
    for (size_t c = 0; c < cameras; c++)
        for (int m = 0; m < 2 && p[c].in[1]; m++)
            for (int i = 0; i < 3; i++) {
                T[i] += p[c].J[m][i] * p[c].shift[m];
                for (int j = 0; j < 3; j++)
                    A[i][j] += p[c].J[m][i] * p[c].J[m][j];
            }
    selfcal_solve(3, A, T);
    for (size_t c = 0; c < cameras; c++)
        for (int m = 0; m < 2 && p[c].in[1]; m++)
            p[c].shift[m] -= p[c].J[m][0] * T[0] + p[c].J[m][1] * T[1] + p[c].J[m][2] * T[2];
}

void rec_selfcal_anchor(struct rec_selfcal_place *p, size_t cameras)
{
    anchor_gains(p, cameras);
    anchor_shifts(p, cameras);
}

/* Gains and shifts as they are seen: those that were applied, and the step.  scale: selfcal_scale. */
static void selfcal_see(rec_selfcal *s, double scale)
{
    struct rec_selfcal_place p[REC_MAX_CAMERAS];
    size_t n = s->S->n_cameras;
    for (size_t c = 0; c < n; c++) {
        const struct aim *o = &s->aim[c];
        p[c].in[0] = s->in[c];
        p[c].in[1] = s->in[c] && s->mode == REC_SELFCAL_ON;
        p[c].gain = o->gain * (s->in[c] ? 1 + selfcal_clamp(o->step[0], MOST_LOG) : 1);
        for (int i = 0; i < 2; i++)
            p[c].shift[i] = p[c].in[1] ? selfcal_clamp(o->shift[i] + scale * o->step[1 + i], MOST)
                                       : o->shift[i];
        memcpy(p[c].J, o->J, sizeof p[c].J);
    }
    rec_selfcal_anchor(p, n);
    for (size_t c = 0; c < n; c++) {
        s->aim[c].seen_gain = p[c].gain;
        memcpy(s->aim[c].seen_shift, p[c].shift, sizeof p[c].shift);
    }
}

/* (7) and (8) of gains. */
static void selfcal_judge_gains(rec_selfcal *s)
{
    double n = (double)s->cameras, f = 0, v = 0, known = 0;
    for (size_t c = 0; c < s->S->n_cameras; c++) {
        const struct aim *o = &s->aim[c];
        if (!s->in[c])
            continue;
        double off = log(o->seen_gain);
        f += o->gain_var > 0 ? off * off / o->gain_var : 0;
        known += o->gain_var > 0 ? 1 / o->gain_var : 0;
        v += o->freedom[0];
    }
    s->test[0] = selfcal_deviate(f / (n - 1), n - 1, v);
    s->size[0] = known > 0 ? sqrt(f / known) : 0;
}

/* (7) and (8) of shifts. */
static void selfcal_judge_shifts(rec_selfcal *s, double scale)
{
    double f = 0, v = 0, known = 0, free = 2 * (double)s->cameras - 3;
    for (size_t c = 0; c < s->S->n_cameras; c++) {
        const struct aim *o = &s->aim[c];
        double x = o->seen_shift[0] / scale, y = o->seen_shift[1] / scale;
        double det = o->var[0] * o->var[2] - o->var[1] * o->var[1];
        if (!s->in[c] || !isfinite(det) || !(det > 0))
            continue;
        f += (x * x * o->var[2] - 2 * x * y * o->var[1] + y * y * o->var[0]) / det;
        known += 0.5 * (o->var[0] + o->var[2]) / det;
        v += o->freedom[1];
    }
    s->test[1] = selfcal_deviate(f / free, free, v);
    s->size[1] = known > 0 ? scale * sqrt(2 * f / known) : 0;
}

/* All tiles as 0, or on a card with their sums. */
static void selfcal_prepare(rec_problem *pb, const float *r)
{
    const struct rec_card_ops *card = rec_card_of(pb->a);
    rec_selfcal *s = pb->selfcal;
    double *tile[REC_MAX_CAMERAS];
    for (size_t c = 0; c < s->S->n_cameras; c++) {
        memset(s->aim[c].tile, 0, sizeof s->aim[c].tile);
        tile[c] = pb->a->present[c] ? s->aim[c].tile[0] : NULL;
    }
    if (card != NULL)
        card->tiles(pb, r, tile);
    else
        selfcal_mark(s, pb->a);
}

bool rec_selfcal_estimate(rec_problem *pb, const float *r)
{
    rec_selfcal *s = pb->selfcal;
    struct look t = {pb, r};
    bool shifts = s->mode == REC_SELFCAL_ON;
    selfcal_prepare(pb, r);
    pvx_pool_run(pb->a->pool, s->S->n_cameras, selfcal_look, &t);
    selfcal_see(s, selfcal_scale(pb));
    selfcal_judge_gains(s);
    if (shifts)
        selfcal_judge_shifts(s, selfcal_scale(pb));
    s->estimated = true;
    s->scale = selfcal_scale(pb);
    if (s->how == REC_SELFCAL_GIVEN)
        return false;
    bool learn = s->how == REC_SELFCAL_LEARN;
    s->any[0] = s->any[0] || learn ||
                (s->test[0] > REC_SELFCAL_GAIN_SIGMAS && s->size[0] > REC_SELFCAL_GAIN_LEAST);
    s->any[1] = s->any[1] || (learn && shifts) ||
                (s->test[1] > REC_SELFCAL_SHIFT_SIGMAS && s->size[1] > REC_SELFCAL_SHIFT_LEAST);
    for (size_t c = 0; c < s->S->n_cameras; c++) {
        struct aim *o = &s->aim[c];
        o->gain = s->any[0] ? o->seen_gain : 1;
        for (int i = 0; i < 2; i++)
            o->shift[i] = s->any[1] ? o->seen_shift[i] : 0;
    }
    return s->any[0] || s->any[1];
}

/* Whether the problem is one of those that are corrected; counts its cameras. */
static bool selfcal_can(const rec_problem *pb)
{
    rec_selfcal *s = pb->selfcal;
    if (s == NULL || s->mode == REC_SELFCAL_OFF || pb->in.per_channel)
        return false;
    s->cameras = 0;
    for (size_t c = 0; c < s->S->n_cameras; c++) {
        s->in[c] = pb->a->present[c];
        s->cameras += s->in[c];
    }
    return s->cameras >= REC_SELFCAL_LEAST;
}

bool rec_selfcal_due(const rec_problem *pb, uint32_t done)
{
    const rec_selfcal *s = pb->selfcal;
    if (!selfcal_can(pb) || pb->a->S != s->S || s->how >= REC_SELFCAL_GIVEN)
        return false;
    bool open = s->any[0] || s->any[1] || s->how == REC_SELFCAL_LEARN,
         near = s->test[0] > REC_SELFCAL_NEAR || s->test[1] > REC_SELFCAL_NEAR;
    return done < ROUNDS && (open || (done == 0 && near));
}

bool rec_selfcal_due_last(const rec_problem *pb)
{
    const rec_selfcal *s = pb->selfcal;
    bool finest = pb->a->S == (s != NULL ? s->S : NULL);
    if (!selfcal_can(pb) || s->how == REC_SELFCAL_FIXED)
        return false;
    return finest ? s->how != REC_SELFCAL_ALONE
                  : pb->a->S == s->S->coarse && s->how != REC_SELFCAL_GIVEN;
}

/* ---- pictures -------------------------------------------------------------------------------------*/

/* Weights of the four samples about a place t in [0,1) after the second (Catmull & Rom, 1974). */
static void selfcal_taps(double t, double w[4])
{
    w[0] = t * (-0.5 + t * (1 - 0.5 * t));
    w[1] = 1 + t * t * (-2.5 + 1.5 * t);
    w[2] = t * (0.5 + t * (2 - 1.5 * t));
    w[3] = t * t * (-0.5 + 0.5 * t);
}

/* (1) for a camera on a level. */
struct shot {
    const rec_problem *pb;
    size_t from, wide, high; /* first row, bins across and down */
    long dx, dy;
    float gain, w[4][4]; /* of samples, row by row */
    bool moved;
};

static struct shot shot_of(const rec_problem *pb, size_t c)
{
    const rec_selfcal *s = pb->selfcal;
    const struct rec_sysmat_block *k = &pb->a->S->block[c];
    double u = s->aim[c].shift[0] / selfcal_scale(pb), v = s->aim[c].shift[1] / selfcal_scale(pb);
    double wx[4], wy[4];
    struct shot t = {.pb = pb,
                     .from = pb->a->row0[c],
                     .wide = (size_t)k->bw,
                     .high = (size_t)k->bh,
                     .dx = (long)floor(u),
                     .dy = (long)floor(v),
                     .gain = (float)s->aim[c].gain,
                     .moved = u != 0 || v != 0};
    selfcal_taps(u - floor(u), wx);
    selfcal_taps(v - floor(v), wy);
    for (int n = 0; n < 4; n++)
        for (int m = 0; m < 4; m++)
            t.w[n][m] = (float)(wy[n] * wx[m]);
    return t;
}

/* Row i of the raw picture at the shifted place; a sample that was not measured counts as the row's own. */
REC_INLINE rec_f4 shot_at(const struct shot *t, size_t i, size_t cs)
{
    long x = (long)((i - t->from) % t->wide) + t->dx - 1;
    long y = (long)((i - t->from) / t->wide) + t->dy - 1;
    rec_f4 sum = {0};
    for (int n = 0; n < 4; n++)
        for (int m = 0; m < 4; m++) {
            size_t at = i;
            if (x + m >= 0 && y + n >= 0 && x + m < (long)t->wide && y + n < (long)t->high)
                at = t->from + (size_t)(y + n) * t->wide + (size_t)(x + m);
            at = selfcal_usable(t->pb, at) ? at : i;
            sum += rec_splat(t->w[n][m]) * rec_ld(t->pb->in.b, at, cs);
        }
    return sum;
}

REC_INLINE void selfcal_correct_row(const struct shot *t, rec_problem *pb, size_t i, size_t cs)
{
    rec_f4 v = rec_ld(pb->in.b, i, cs);
    if (t->moved && selfcal_usable(pb, i))
        v = shot_at(t, i, cs);
    v *= rec_splat(t->gain);
    rec_st(pb->b, i, cs, v);
    if (pb->in.least != NULL)
        rec_st(pb->bound, i, cs, v);
}

static void selfcal_correct(void *ctx, size_t k)
{
    rec_problem *pb = ctx;
    const struct rec_subsys *a = pb->a;
    size_t c = 0;
    struct shot t = {0};
    REC_FOR_ROWS (i, a, k) {
        if (!a->is_row[i])
            continue;
        while (i >= a->row0[c + 1])
            c++;
        if (t.pb == NULL || t.from != a->row0[c])
            t = shot_of(pb, c);
        pb->cs == 4 ? selfcal_correct_row(&t, pb, i, 4) : selfcal_correct_row(&t, pb, i, 1);
    }
}

/* The same on a card. */
static void selfcal_correct_there(rec_problem *pb)
{
    struct rec_card_shot to[REC_MAX_CAMERAS];
    for (size_t c = 0; c < pb->selfcal->S->n_cameras; c++) {
        const struct shot s = shot_of(pb, c);
        to[c] = (struct rec_card_shot){
            .dx = (int32_t)s.dx, .dy = (int32_t)s.dy, .gain = s.gain, .moved = s.moved};
        memcpy(to[c].w, s.w, sizeof s.w);
    }
    rec_card_of(pb->a)->correct(pb, to);
}

void rec_selfcal_apply(rec_problem *pb)
{
    rec_selfcal *s = pb->selfcal;
    if (s == NULL || pb->in.per_channel || (!s->any[0] && !s->any[1]))
        return;
    if (pb->a->card != NULL) {
        selfcal_correct_there(pb);
    } else {
        selfcal_mark(s, pb->a);
        pvx_pool_run(pb->a->pool, rec_row_chunks(pb), selfcal_correct, pb);
    }
    pb->given = pb->in.least != NULL ? pb->bound : pb->in.b;
}

void rec_selfcal_tell(const rec_selfcal *s, struct rec_selfcal_report *out)
{
    double px = s->S->binning, scale = s->scale;
    *out = (struct rec_selfcal_report){.gain = s->any[0], .shift = s->any[1]};
    out->cameras = s->estimated ? (uint32_t)s->S->n_cameras : 0;
    memcpy(out->test, s->test, sizeof out->test);
    for (size_t c = 0; c < out->cameras; c++) {
        const struct aim *o = &s->aim[c];
        struct rec_selfcal_camera *to = &out->camera[c];
        to->known = s->in[c] && isfinite(o->gain_var);
        if (!to->known)
            continue;
        to->gain = (float)o->seen_gain;
        to->gain_error = (float)sqrt(o->gain_var);
        for (int i = 0; i < 2; i++) {
            to->shift[i] = (float)(px * o->seen_shift[i]);
            to->shift_error[i] =
                isfinite(o->var[0]) ? (float)(px * scale * sqrt(o->var[2 * i])) : 0;
        }
    }
}

void rec_selfcal_look(const rec_selfcal *s, struct rec_selfcal_look *out)
{
    double scale2 = s->scale * s->scale;
    for (size_t c = 0; c < s->S->n_cameras; c++) {
        const struct aim *o = &s->aim[c];
        out[c] = (struct rec_selfcal_look){.known = s->estimated && s->in[c]};
        if (!out[c].known)
            continue;
        out[c].log_gain = log(o->seen_gain);
        memcpy(out[c].shift, o->seen_shift, sizeof o->seen_shift);
        out[c].gain_var = o->gain_var;
        for (int i = 0; i < 3; i++)
            out[c].var[i] = scale2 * o->var[i];
        memcpy(out[c].J, o->J, sizeof o->J);
    }
}
