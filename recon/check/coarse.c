#include "recon/check/coarse.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"

#define WIDE  4    /* blocks of a tent along each side, at most */
#define RELAX 0.7F /* of (1), in the first sweep; then less */

struct place {
    int16_t x, y;             /* of the first block; x < 0: not in the picture */
    float wx[WIDE], wy[WIDE]; /* wx with the voxel's light */
};

struct rec_places {
    int32_t n;
    struct place at[];
};

struct rec_coarse {
    struct rec_grid grid;
    size_t n;
    int least;
    int32_t voxels, held; /* of the grid; those that may hold flame */
    const atomic_bool *stop;
    int32_t *index;  /* [voxels] */
    float *x;        /* [voxels], of held ones */
    float *up, *col; /* [voxels] */
    float p[REC_COARSE_BLOCKS], row[REC_COARSE_BLOCKS];
};

int32_t rec_blocks_side(const struct rec_camera *c, int32_t binning)
{
    int32_t longer = (c->width > c->height ? c->width : c->height) / binning;
    return (longer + REC_COARSE_SIDE - 1) / REC_COARSE_SIDE * binning;
}

void rec_blocks_finish(struct rec_blocks *k, const uint8_t *lit)
{
    double sum = 0;
    for (int32_t i = 0; i < k->w * k->h; i++) {
        k->near[i] = 0;
        sum += k->there[i] ? (double)k->b[i] : 0;
        for (int32_t y = i / k->w - 1; y <= i / k->w + 1; y++)
            for (int32_t x = i % k->w - 1; x <= i % k->w + 1; x++)
                if (x >= 0 && y >= 0 && x < k->w && y < k->h)
                    k->near[i] |= lit[y * k->w + x];
    }
    k->some = sum > 0;
}

pvx_err rec_coarse_new(const struct rec_grid *box, size_t n, int least, rec_coarse **out)
{
    rec_coarse *k = *out = pvx_calloc(1, sizeof *k);
    PVX_NEED(k);
    double longest = 0;
    k->grid = *box;
    k->n = n;
    k->least = least;
    for (int a = 0; a < 3; a++)
        longest = fmax(longest, box->max[a] - box->min[a]);
    for (int a = 0; a < 3; a++) {
        double m = ceil((box->max[a] - box->min[a]) / longest * REC_COARSE_VOXELS - 1e-6);
        k->grid.n[a] = m < 4 ? 4 : (int32_t)m;
    }
    k->voxels = (int32_t)rec_grid_count(&k->grid);
    k->index = pvx_calloc((size_t)k->voxels, sizeof *k->index);
    k->x = pvx_calloc((size_t)k->voxels, sizeof *k->x);
    k->up = pvx_calloc((size_t)k->voxels, sizeof *k->up);
    k->col = pvx_calloc((size_t)k->voxels, sizeof *k->col);
    if (k->index != NULL && k->x != NULL && k->up != NULL && k->col != NULL)
        return PVX_OK;
    rec_coarse_free(out);
    return PVX_ENOMEM;
}

void rec_coarse_free(rec_coarse **kp)
{
    rec_coarse *k = *kp;
    if (k == NULL)
        return;
    free(k->index);
    free(k->x);
    free(k->up);
    free(k->col);
    PVX_FREE(*kp);
}

struct rec_places *rec_places_new(const rec_coarse *k)
{
    struct rec_places *p = pvx_calloc(1, sizeof *p + (size_t)k->voxels * sizeof(struct place));
    if (p != NULL)
        p->n = k->voxels;
    return p;
}

static void coarse_centre(const struct rec_grid *g, int32_t i, double X[3])
{
    int32_t ijk[3];
    rec_grid_ijk(g, i, ijk);
    for (int a = 0; a < 3; a++)
        X[a] = g->min[a] + (ijk[a] + 0.5) * rec_grid_h(g, a);
}

/* A tent around u of half width s, of sum `all`, in blocks from *first on. */
static void coarse_tent(double u, double s, double all, int16_t *first, float w[WIDE])
{
    double from = ceil(u - s), sum = 0;
    for (int i = 0; i < WIDE; i++)
        sum += fmax(0, 1 - fabs(from + i - u) / s);
    for (int i = 0; i < WIDE; i++)
        w[i] = (float)(all * fmax(0, 1 - fabs(from + i - u) / s) / sum);
    *first = (int16_t)from;
}

void rec_places_find(const rec_coarse *k, const struct rec_camera *c, int32_t side, unsigned turned,
                     bool held, struct rec_places *out)
{
    const struct rec_grid *g = &k->grid;
    const double h[3] = {rec_grid_h(g, 0), rec_grid_h(g, 1), rec_grid_h(g, 2)};
    const double size = cbrt(h[0] * h[1] * h[2]);
    for (int32_t j = 0; j < (held ? k->held : k->voxels); j++) {
        const int32_t i = held ? k->index[j] : j;
        double X[3], uv[2];
        coarse_centre(g, i, X);
        out->at[i].x = -1;
        if (!rec_camera_sees(c, X, uv))
            continue;
        double z = rec_camera_depth(c, X), px = size * sqrt(c->fx * c->fy) / z / side;
        double s = fmin(fmax(px, 1), 1.5);
        double u = (turned & REC_TURN_ACROSS) != 0 ? c->width - 1 - uv[0] : uv[0];
        double v = (turned & REC_TURN_UPSIDE) != 0 ? c->height - 1 - uv[1] : uv[1];
        /* one block further in, so that a tent at the border has a place */
        coarse_tent((u + 0.5) / side + 1.5, s, size * px * px, &out->at[i].x, out->at[i].wx);
        coarse_tent((v + 0.5) / side + 1.5, s, 1, &out->at[i].y, out->at[i].wy);
    }
}

/* Each block of a tent that is in the picture. */
#define COARSE_EACH(q, k, body)                                  \
    for (int ty_ = 0; ty_ < WIDE; ty_++) {                       \
        const int32_t by_ = (q)->y + ty_ - 2;                    \
        if (!((q)->wy[ty_] > 0) || by_ < 0 || by_ >= (k)->h)     \
            continue;                                            \
        for (int tx_ = 0; tx_ < WIDE; tx_++) {                   \
            const int32_t bx_ = (q)->x + tx_ - 2;                \
            if (!((q)->wx[tx_] > 0) || bx_ < 0 || bx_ >= (k)->w) \
                continue;                                        \
            const int32_t at = by_ * (k)->w + bx_;               \
            const float weight = (q)->wx[tx_] * (q)->wy[ty_];    \
            body                                                 \
        }                                                        \
    }

/* The block that a voxel's centre is in. */
static int32_t coarse_block(const struct place *q, const struct rec_blocks *b)
{
    int32_t best[2] = {0, 0};
    for (int i = 1; i < WIDE; i++) {
        best[0] = q->wx[i] > q->wx[best[0]] ? i : best[0];
        best[1] = q->wy[i] > q->wy[best[1]] ? i : best[1];
    }
    int32_t x = q->x + best[0] - 2, y = q->y + best[1] - 2;
    x = x < 0 ? 0 : x >= b->w ? b->w - 1 : x;
    y = y < 0 ? 0 : y >= b->h ? b->h - 1 : y;
    return y * b->w + x;
}

static void coarse_hold(rec_coarse *k, const struct rec_belief *w)
{
    int used = 0;
    for (size_t c = 0; c < k->n; c++)
        used += w->picture[c] != NULL && w->picture[c]->some;
    const int most = used >= 6 ? 2 : used > 3 ? 1 : 0;
    k->held = 0;
    for (int32_t i = 0; i < k->voxels; i++) {
        int lit = 0, dark = 0;
        for (size_t c = 0; c < k->n && dark <= most; c++) {
            const struct rec_blocks *b = w->picture[c];
            if (b == NULL || !b->some || w->at[c]->at[i].x < 0)
                continue;
            bool on = b->near[coarse_block(&w->at[c]->at[i], b)];
            lit += on;
            dark += !on;
        }
        if (lit >= k->least && dark <= most)
            k->index[k->held++] = i;
    }
}

static void coarse_forward(rec_coarse *k, const struct rec_places *places,
                           const struct rec_blocks *b, bool ones, float *p)
{
    memset(p, 0, (size_t)(b->w * b->h) * sizeof *p);
    for (int32_t j = 0; j < k->held; j++) {
        const struct place *q = &places->at[k->index[j]];
        const float x = ones ? 1 : k->x[j];
        if (q->x < 0 || x == 0)
            continue;
        COARSE_EACH(q, b, p[at] += weight * x;)
    }
}

static void coarse_step(rec_coarse *k, const struct rec_places *places, const struct rec_blocks *b,
                        float relax)
{
    coarse_forward(k, places, b, true, k->row);
    coarse_forward(k, places, b, false, k->p);
    for (int32_t i = 0; i < b->w * b->h; i++)
        k->p[i] = b->there[i] && k->row[i] > 0 ? (b->b[i] - k->p[i]) / k->row[i] : 0;
    for (int32_t j = 0; j < k->held; j++) {
        const struct place *q = &places->at[k->index[j]];
        float up = 0, sum = 0;
        if (q->x < 0)
            continue;
        COARSE_EACH(
            q, b, if (b->there[at]) {
                up += weight * k->p[at];
                sum += weight;
            })
        if (sum > 0)
            k->x[j] = fmaxf(0, k->x[j] + relax * up / sum);
    }
}

/* The share of the light that a ray through a held voxel can explain, mean of the cameras. */
static double coarse_explained(rec_coarse *k, const struct rec_belief *w)
{
    double sum = 0, cameras = 0;
    for (size_t c = 0; c < k->n; c++) {
        const struct rec_blocks *b = w->picture[c];
        double in = 0, all = 0;
        if (b == NULL || !b->some)
            continue;
        coarse_forward(k, w->at[c], b, true, k->row);
        for (int32_t i = 0; i < b->w * b->h; i++) {
            all += b->there[i] ? (double)b->b[i] : 0;
            in += b->there[i] && k->row[i] > 0 ? (double)b->b[i] : 0;
        }
        sum += all > 0 ? in / all : 0;
        cameras += all > 0;
    }
    return cameras > 0 ? sum / cameras : 0;
}

void rec_coarse_stop(rec_coarse *k, const atomic_bool *stop)
{
    k->stop = stop;
}

double rec_coarse_solve(rec_coarse *k, const struct rec_belief *w)
{
    if (k->stop != NULL && atomic_load(k->stop)) {
        k->held = 0;
        return 0;
    }
    coarse_hold(k, w);
    memset(k->x, 0, (size_t)k->held * sizeof *k->x);
    const size_t step =
        k->n > 4 ? (k->n - 1) / 2 : 1; /* neighbours are alike: not one after the other */
    for (int s = 0; s < REC_COARSE_SWEEPS && k->held > 0; s++)
        for (size_t first = 0; first < step; first++)
            for (size_t c = first; c < k->n; c += step)
                if (w->picture[c] != NULL && w->picture[c]->some)
                    coarse_step(k, w->at[c], w->picture[c], RELAX / (1 + 0.25F * (float)s));
    return coarse_explained(k, w);
}

double rec_coarse_miss(rec_coarse *k, const struct rec_places *at, const struct rec_blocks *b,
                       double *gain)
{
    double bp = 0, bb = 0, pp = 0;
    coarse_forward(k, at, b, false, k->p);
    for (int32_t i = 0; i < b->w * b->h; i++)
        if (b->there[i]) {
            bp += (double)b->b[i] * (double)k->p[i];
            bb += (double)b->b[i] * (double)b->b[i];
            pp += (double)k->p[i] * (double)k->p[i];
        }
    if (gain != NULL)
        *gain = pp > 0 ? bp / pp : 0;
    return bb > 0 && pp > 0 ? fmax(0, 1 - bp * bp / (bb * pp)) : 1;
}

const float *rec_coarse_show(rec_coarse *k, const struct rec_places *at, const struct rec_blocks *b)
{
    coarse_forward(k, at, b, false, k->p);
    return k->p;
}

void rec_coarse_extent(const rec_coarse *k, double share, double min[3], double max[3])
{
    for (int a = 0; a < 3; a++) {
        double sum[REC_GRID_MAX] = {0}, all = 0, low = 0, high = 0;
        int32_t n = k->grid.n[a], lo = 0, hi = n - 1;
        for (int32_t j = 0; j < k->held; j++) {
            int32_t ijk[3];
            rec_grid_ijk(&k->grid, k->index[j], ijk);
            sum[ijk[a]] += (double)k->x[j];
            all += (double)k->x[j];
        }
        while (lo < hi && low + sum[lo] <= share * all)
            low += sum[lo++];
        while (hi > lo && high + sum[hi] <= share * all)
            high += sum[hi--];
        min[a] = k->grid.min[a] + lo * rec_grid_h(&k->grid, a);
        max[a] = k->grid.min[a] + (hi + 1) * rec_grid_h(&k->grid, a);
    }
}
