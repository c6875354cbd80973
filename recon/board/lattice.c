#include "recon/board/lattice.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"

#define SADDLES 4000
#define SEEDS   80   /* saddles from which a lattice is started, strongest first */
#define WEAK    0.08 /* share of the response of full contrast below which there is no saddle */
#define NEAREST 4.0  /* px between corners */
#define OFF     1.2  /* px from a line at which its two sides are compared */
#define CELL    16   /* px, for looking up saddles by place */
#define SPAN    160  /* nodes along the lattice, from one end of the table to the other */

struct saddle {
    double x, y, response;
    double dir[2][2]; /* along the edges that cross there, unit vectors */
    double dark[2];   /* through the dark sides */
};

struct finder {
    int32_t w, h;
    float *soft, *response, *work;
    double contrast;
    struct saddle saddle[SADDLES];
    int n;
    int32_t *head, next[SADDLES], across, down;
    int32_t owner[SPAN * SPAN]; /* saddle at a node, -1 = none */
    bool used[SADDLES], diagonal;
};

static double lattice_at(const struct finder *g, double x, double y)
{
    int32_t w = g->w, u = (int32_t)floor(x), v = (int32_t)floor(y);
    if (!(x >= 0 && y >= 0) || u + 1 >= w || v + 1 >= g->h)
        return NAN;
    const float *p = g->soft + (ptrdiff_t)v * w + u;
    double a = x - u, b = y - v;
    return (1 - b) * ((1 - a) * p[0] + a * p[1]) + b * ((1 - a) * p[w] + a * p[w + 1]);
}

/* 1 2 1 along both axes: a Gaussian of 0.7 px.  More would fill the white between a corner and the markers beside
 * it. */
static void lattice_smooth(struct finder *g, const float *level)
{
    ptrdiff_t w = g->w, n = w * g->h;
    memcpy(g->work, level, (size_t)n * sizeof *level);
    memcpy(g->soft, level, (size_t)n * sizeof *level);
    for (ptrdiff_t i = 1; i < n - 1; i++)
        g->work[i] = (level[i - 1] + level[i + 1] + 2 * level[i]) / 4;
    for (ptrdiff_t i = w; i < n - w; i++)
        g->soft[i] = (g->work[i - w] + g->work[i + w] + 2 * g->work[i]) / 4;
}

static void hessian(const struct finder *g, ptrdiff_t i, double out[3])
{
    const float *p = g->soft + i;
    ptrdiff_t w = g->w;
    out[0] = p[1] + p[-1] - 2 * p[0];
    out[1] = (p[w + 1] + p[-w - 1] - p[w - 1] - p[-w + 1]) / 4;
    out[2] = p[w] + p[-w] - 2 * p[0];
}

/* Directions in which the Hessian's form is 0: those of the edges. */
static void directions(const double h[3], double dir[2][2])
{
    double s = sqrt(fmax(0, h[1] * h[1] - h[0] * h[2]));
    for (int k = 0; k < 2; k++) {
        double r = h[1] + (k ? -s : s);
        /* h0 x^2 + 2 h1 x y + h2 y^2 = 0, from the larger of h0 and h2 */
        double x = fabs(h[0]) > fabs(h[2]) ? -r : h[2], y = fabs(h[0]) > fabs(h[2]) ? h[0] : -r;
        double l = fmax(hypot(x, y), 1e-12);
        dir[k][0] = x / l;
        dir[k][1] = y / l;
    }
}

/* The axis along which the picture falls fastest to both sides: eigenvector of the smaller eigenvalue. */
static void dark_axis(const double h[3], double out[2])
{
    double turn = 0.5 * atan2(2 * h[1], h[0] - h[2]); /* of the larger one */
    out[0] = -sin(turn);
    out[1] = cos(turn);
}

static int stronger(const void *a, const void *b)
{
    const struct saddle *p = a, *q = b;
    if (p->response != q->response)
        return p->response < q->response ? 1 : -1;
    return p->y != q->y ? (p->y > q->y) - (p->y < q->y) : (p->x > q->x) - (p->x < q->x);
}

static void add_saddle(struct finder *g, int32_t u, int32_t v)
{
    ptrdiff_t w = g->w, i = v * w + u;
    const float *r = g->response + i;
    for (int b = -2; b <= 2; b++)
        for (int a = -2; a <= 2; a++)
            if (r[b * w + a] > r[0] || (r[b * w + a] == r[0] && b * w + a < 0))
                return;
    double h[3], gx = (g->soft[i + 1] - g->soft[i - 1]) / 2,
                 gy = (g->soft[i + w] - g->soft[i - w]) / 2;
    hessian(g, i, h);
    double det = h[0] * h[2] - h[1] * h[1]; /* < 0 here; Newton's step to where the slope is 0 */
    double dx = -(h[2] * gx - h[1] * gy) / det, dy = -(h[0] * gy - h[1] * gx) / det;
    if (!(fabs(dx) <= 1.5 && fabs(dy) <= 1.5) || g->n == SADDLES)
        return;
    struct saddle *s = &g->saddle[g->n++];
    *s = (struct saddle){.x = u + dx, .y = v + dy, .response = r[0]};
    directions(h, s->dir);
    dark_axis(h, s->dark);
}

static void find_saddles(struct finder *g)
{
    ptrdiff_t w = g->w;
    double strong = g->contrast * g->contrast * 0.08; /* of an ideal corner, blurred by a pixel */
    memset(g->response, 0, (size_t)(w * g->h) * sizeof *g->response);
    for (int32_t v = 3; v < g->h - 3; v++)
        for (int32_t u = 3; u < g->w - 3; u++) {
            double h[3];
            hessian(g, v * w + u, h);
            g->response[v * w + u] = (float)(h[1] * h[1] - h[0] * h[2]);
        }
    for (int32_t v = 5; v < g->h - 5; v++)
        for (int32_t u = 5; u < g->w - 5; u++)
            if (g->response[v * w + u] > WEAK * WEAK * strong)
                add_saddle(g, u, v);
    qsort(g->saddle, (size_t)g->n, sizeof *g->saddle, stronger);
    memset(g->head, -1, (size_t)(g->across * g->down) * sizeof *g->head);
    for (int i = g->n - 1; i >= 0; i--) {
        int32_t c = (int32_t)(g->saddle[i].y / CELL) * g->across + (int32_t)(g->saddle[i].x / CELL);
        g->next[i] = g->head[c];
        g->head[c] = i;
    }
}

/* The line from a to b is an edge between them, and an edge with swapped sides beyond both ends. */
static bool joined(const struct finder *g, const struct saddle *a, const struct saddle *b)
{
    double dx = b->x - a->x, dy = b->y - a->y, l = hypot(dx, dy), most = 0, least = INFINITY;
    double nx = -dy / l * OFF, ny = dx / l * OFF, beyond = fmin(0.25, 4 / l), sign = 0;
    for (int k = 0; k < 7; k++) {
        double t = k == 0 ? -beyond : k == 6 ? 1 + beyond : 0.2 + 0.15 * (k - 1);
        double x = a->x + t * dx, y = a->y + t * dy,
               d = lattice_at(g, x + nx, y + ny) - lattice_at(g, x - nx, y - ny);
        if (k == 1)
            sign = d > 0 ? 1 : -1;
        if (isnan(d))
            return false;
        if (k == 0)
            least = d; /* judged when the sign is known */
        else if (k == 1 && least * sign > -0.02 * g->contrast)
            return false;
        else if (k == 6)
            return d * sign < -0.02 * g->contrast && least > 0.2 * most &&
                   least > 0.06 * g->contrast;
        if (k == 1)
            least = INFINITY;
        if (k > 0) {
            least = fmin(least, d * sign);
            most = fmax(most, d * sign);
        }
    }
    return false;
}

/* Opposite corners of a square: dark to the same sides, equally strong, and edges of the same directions. */
static bool opposite(const struct saddle *a, const struct saddle *b)
{
    double same = 0;
    for (int k = 0; k < 2; k++)
        same += fmax(fabs(a->dir[k][0] * b->dir[0][0] + a->dir[k][1] * b->dir[0][1]),
                     fabs(a->dir[k][0] * b->dir[1][0] + a->dir[k][1] * b->dir[1][1]));
    return fabs(a->dark[0] * b->dark[0] + a->dark[1] * b->dark[1]) > 0.95 && same > 1.9 &&
           b->response > 0.3 * a->response && a->response > 0.3 * b->response;
}

static bool neighbours(const struct finder *g, int a, int b)
{
    return g->diagonal ? opposite(&g->saddle[a], &g->saddle[b])
                       : joined(g, &g->saddle[a], &g->saddle[b]);
}

/* The saddle nearest to (x, y) within `reach` that is joined to a; -1: none. */
static int nearest(const struct finder *g, int a, double x, double y, double reach)
{
    int best = -1;
    double least = reach;
    int32_t c0 = (int32_t)fmax(0, (x - reach) / CELL), c1 = (int32_t)((x + reach) / CELL),
            r0 = (int32_t)fmax(0, (y - reach) / CELL), r1 = (int32_t)((y + reach) / CELL);
    for (int32_t r = r0; r <= r1 && r < g->down; r++)
        for (int32_t c = c0; c <= c1 && c < g->across; c++)
            for (int i = g->head[r * g->across + c]; i >= 0; i = g->next[i]) {
                double d = hypot(g->saddle[i].x - x, g->saddle[i].y - y);
                if (i != a && !g->used[i] && d < least && neighbours(g, a, i)) {
                    best = i;
                    least = d;
                }
            }
    return best;
}

/* The nearest joined saddle along a direction, within 20 degrees of it; -1: none. */
static int lattice_along(const struct finder *g, int a, const double dir[2], double far)
{
    int best = -1;
    double least = far;
    const struct saddle *s = &g->saddle[a];
    int32_t c0 = (int32_t)fmax(0, (s->x - far) / CELL), c1 = (int32_t)((s->x + far) / CELL),
            r0 = (int32_t)fmax(0, (s->y - far) / CELL), r1 = (int32_t)((s->y + far) / CELL);
    for (int32_t r = r0; r <= r1 && r < g->down; r++)
        for (int32_t c = c0; c <= c1 && c < g->across; c++)
            for (int i = g->head[r * g->across + c]; i >= 0; i = g->next[i]) {
                double dx = g->saddle[i].x - s->x, dy = g->saddle[i].y - s->y, d = hypot(dx, dy);
                if (d >= NEAREST && d < least && dx * dir[0] + dy * dir[1] > 0.94 * d &&
                    neighbours(g, a, i)) {
                    best = i;
                    least = d;
                }
            }
    return best;
}

struct open {
    int saddle, i, j;
    double step[2][2]; /* px along i and j */
};

/* Grows a lattice from one saddle; returns its nodes. */
static size_t lattice_grow(struct finder *g, int seed, struct rec_node *node)
{
    static const int way[4][2] = {{1, 0}, {0, 1}, {-1, 0}, {0, -1}};
    struct open *queue = pvx_calloc(REC_LATTICE_MAX, sizeof *queue);
    const struct saddle *s = &g->saddle[seed];
    size_t n = 0;
    double far = 0.25 * fmin(g->w, g->h);
    memset(g->used, 0, sizeof g->used);
    memset(g->owner, -1, sizeof g->owner);
    if (queue == NULL)
        return 0;
    struct open first = {.saddle = seed};
    double across[2][2] = {{s->dark[0], s->dark[1]}, {-s->dark[1], s->dark[0]}};
    for (int k = 0; k < 2; k++) {
        const double *dir = g->diagonal ? across[k] : s->dir[k];
        int b = lattice_along(g, seed, dir, far);
        double back[2] = {-dir[0], -dir[1]}, sign = 1;
        if (b < 0) {
            b = lattice_along(g, seed, back, far);
            sign = -1;
        }
        if (b < 0)
            goto out;
        first.step[k][0] = sign * (g->saddle[b].x - s->x);
        first.step[k][1] = sign * (g->saddle[b].y - s->y);
    }
    if (first.step[0][0] * first.step[1][1] - first.step[0][1] * first.step[1][0] < 0)
        for (int a = 0; a < 2; a++)
            first.step[1][a] *= -1;
    queue[n++] = first;
    g->used[seed] = true;
    g->owner[SPAN / 2 * SPAN + SPAN / 2] = seed;
    for (size_t k = 0; k < n; k++)
        for (int d = 0; d < 4 && n < REC_LATTICE_MAX; d++) {
            struct open o = queue[k], *q = &queue[n];
            int i = o.i + way[d][0], j = o.j + way[d][1], axis = d % 2, sign = d < 2 ? 1 : -1;
            if (abs(i) >= SPAN / 2 || abs(j) >= SPAN / 2 ||
                g->owner[(j + SPAN / 2) * SPAN + i + SPAN / 2] >= 0)
                continue;
            const struct saddle *a = &g->saddle[o.saddle];
            double l = hypot(o.step[axis][0], o.step[axis][1]);
            int b = nearest(g, o.saddle, a->x + sign * o.step[axis][0],
                            a->y + sign * o.step[axis][1], 0.3 * l);
            if (b < 0)
                continue;
            *q = o;
            q->saddle = b;
            q->i = i;
            q->j = j;
            q->step[axis][0] = sign * (g->saddle[b].x - a->x);
            q->step[axis][1] = sign * (g->saddle[b].y - a->y);
            g->used[b] = true;
            g->owner[(j + SPAN / 2) * SPAN + i + SPAN / 2] = b;
            n++;
        }
out:
    for (size_t k = 0; k < n; k++)
        node[k] = (struct rec_node){queue[k].i, queue[k].j, g->saddle[queue[k].saddle].x,
                                    g->saddle[queue[k].saddle].y};
    free(queue);
    return n;
}

/* Renumbers the nodes of a lattice of opposite corners as nodes of the squares' lattice.  Adds the nodes between,
 * each midway between two opposite neighbours. */
static void lattice_fill(struct rec_node *node, size_t *n)
{
    static const int way[4][2] = {{1, 0}, {-1, 0}, {0, 1}, {0, -1}};
    size_t have = *n;
    for (size_t k = 0; k < have; k++) {
        int p = node[k].i, q = node[k].j;
        node[k].i = p - q;
        node[k].j = p + q;
    }
    for (size_t k = 0; k < have; k++)
        for (int d = 0; d < 4 && *n < REC_LATTICE_MAX; d++) {
            int i = node[k].i + way[d][0], j = node[k].j + way[d][1];
            bool there = false;
            for (size_t m = 0; m < *n && !there; m++)
                there = node[m].i == i && node[m].j == j;
            for (size_t m = 0; m < have && !there; m++)
                if (node[m].i == i + way[d][0] && node[m].j == j + way[d][1]) {
                    node[(*n)++] = (struct rec_node){i, j, (node[k].x + node[m].x) / 2,
                                                     (node[k].y + node[m].y) / 2};
                    break;
                }
        }
}

pvx_err rec_lattice_find(const struct rec_field *f, double contrast, bool diagonal,
                         struct rec_node node[REC_LATTICE_MAX], size_t *n)
{
    size_t pixels = (size_t)f->width * (size_t)f->height;
    struct rec_node *now = pvx_calloc(REC_LATTICE_MAX, sizeof *now);
    struct finder *g = pvx_calloc(1, sizeof *g);
    pvx_err e = PVX_ENOMEM;
    *n = 0;
    if (g == NULL || now == NULL)
        goto out;
    g->w = f->width;
    g->h = f->height;
    g->contrast = contrast;
    g->diagonal = diagonal;
    g->across = f->width / CELL + 1;
    g->down = f->height / CELL + 1;
    g->soft = pvx_calloc(pixels, sizeof *g->soft);
    g->work = pvx_calloc(pixels, sizeof *g->work);
    g->head = pvx_calloc((size_t)(g->across * g->down), sizeof *g->head);
    if (g->soft == NULL || g->work == NULL || g->head == NULL)
        goto out;
    e = PVX_OK;
    if (f->width < 32 || f->height < 32)
        goto out;
    lattice_smooth(g, f->level);
    g->response = g->work;
    find_saddles(g);
    for (int s = 0; s < g->n && s < SEEDS && *n < 24; s++) {
        size_t k = lattice_grow(g, s, now);
        /* bits of markers also form diagonal lattices, of weaker saddles; those come later */
        if (k > *n + (diagonal ? *n / 2 : 0) && k >= 6) {
            *n = k;
            memcpy(node, now, k * sizeof *node);
        }
    }
    if (diagonal)
        lattice_fill(node, n);
out:
    if (g != NULL) {
        free(g->soft);
        free(g->work);
        free(g->head);
    }
    free(g);
    free(now);
    return e;
}
