#include "recon/view/room_lamps.h"

#include <math.h>
#include <stdbool.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"

enum { LEAF = 8 };

/* ---- the tree --------------------------------------------------------------------------------- */

static bool bright(const float *e, int nch, float out[3])
{
    bool any = false;
    for (int c = 0; c < nch; c++) {
        out[c] = e[c] > 0 && isfinite(e[c]) ? e[c] : 0;
        any = any || out[c] > 0;
    }
    return any;
}

static size_t room_lamps_collect(const struct room_scene *s, const struct rec_grid *g,
                                 const float *dense, int nch, struct room_lamp *out)
{
    size_t n = 0, all = rec_grid_count(g);
    for (size_t i = 0; i < all; i++) {
        struct room_lamp lamp = {.e = {0}};
        int32_t v[3];
        if (!bright(dense + i * (size_t)nch, nch, lamp.e))
            continue;
        rec_grid_ijk(g, (int32_t)i, v);
        for (int a = 0; a < 3; a++)
            lamp.x[a] = g->min[a] + (v[a] + 0.5) * rec_grid_h(g, a);
        if (!room_scene_free(s, lamp.x))
            continue;
        if (out != NULL)
            out[n] = lamp;
        n++;
    }
    return n;
}

/* Sets the ball about the middle of its lamps' box, and their moments.  Returns the longest axis of the box. */
static int room_lamps_measure(const struct room_lamp *lamp, struct room_node *k)
{
    double lo[3], hi[3];
    memcpy(lo, lamp[k->first].x, sizeof lo);
    memcpy(hi, lo, sizeof hi);
    for (size_t i = k->first; i < k->first + k->n; i++)
        for (int a = 0; a < 3; a++) {
            lo[a] = fmin(lo[a], lamp[i].x[a]);
            hi[a] = fmax(hi[a], lamp[i].x[a]);
        }
    int axis = 0;
    for (int a = 0; a < 3; a++) {
        k->c[a] = lo[a] + (hi[a] - lo[a]) / 2;
        axis = hi[a] - lo[a] > hi[axis] - lo[axis] ? a : axis;
    }
    double r2 = 0;
    for (size_t i = k->first; i < k->first + k->n; i++) {
        double d2 = 0;
        for (int a = 0; a < 3; a++) {
            double d = lamp[i].x[a] - k->c[a];
            d2 += d * d;
            for (int c = 0; c < 3; c++)
                k->m[c][a] += lamp[i].e[c] * d;
        }
        for (int c = 0; c < 3; c++)
            k->w[c] += lamp[i].e[c];
        r2 = fmax(r2, d2);
    }
    k->r = sqrt(r2);
    return axis;
}

/* Puts the lamps below the middle of the axis first; returns how many they are.  Never 0 or all, since the box is
 * that of the lamps. */
static size_t room_lamps_split(struct room_lamp *lamp, const struct room_node *k, int axis)
{
    size_t low = k->first, high = k->first + k->n;
    while (low < high) {
        if (lamp[low].x[axis] <= k->c[axis]) {
            low++;
            continue;
        }
        struct room_lamp t = lamp[low];
        lamp[low] = lamp[--high];
        lamp[high] = t;
    }
    return low - k->first;
}

/* Makes room for one more node. */
static bool room_lamps_make_room(struct room_lamps *l)
{
    if (l->n_nodes < l->room)
        return true;
    size_t room = 2 * l->room + 1024;
    struct room_node *node = realloc(l->node, room * sizeof *node);
    if (node == NULL)
        return false;
    l->node = node;
    l->room = room;
    return true;
}

/* Appends the node of lamps [first, first + n) and all nodes below it.  A grid's side is halved at most 3 x 10
 * times.  PVX_ENOMEM. */
static pvx_err room_lamps_grow(struct room_lamps *l, size_t first, size_t n)
{
    if (!room_lamps_make_room(l))
        return PVX_ENOMEM;
    size_t at = l->n_nodes++;
    struct room_node *k = &l->node[at];
    *k = (struct room_node){.first = first, .n = n};
    int axis = room_lamps_measure(l->lamp, k);
    if (n <= LEAF)
        return PVX_OK;
    size_t low = room_lamps_split(l->lamp, k, axis);
    if (low == 0 || low == n)
        return PVX_OK;
    PVX_TRY(room_lamps_grow(l, first, low));
    l->node[at].right = l->n_nodes;
    return room_lamps_grow(l, first + low, n - low);
}

pvx_err room_lamps_init(struct room_lamps *l, const struct room_scene *s, const struct rec_grid *g,
                        const float *dense, int nch)
{
    double volume = rec_grid_h(g, 0) * rec_grid_h(g, 1) * rec_grid_h(g, 2);
    *l = (struct room_lamps){
        .nch = nch, .volume = volume, .ball = cbrt(0.75 / 3.14159265358979323846 * volume)};
    l->n = room_lamps_collect(s, g, dense, nch, NULL);
    if (l->n == 0)
        return PVX_OK;
    l->lamp = pvx_calloc(l->n, sizeof *l->lamp);
    pvx_err e = l->lamp != NULL ? PVX_OK : PVX_ENOMEM;
    if (e == PVX_OK) {
        room_lamps_collect(s, g, dense, nch, l->lamp);
        e = room_lamps_grow(l, 0, l->n);
    }
    if (e != PVX_OK)
        room_lamps_fini(l);
    return e;
}

void room_lamps_fini(struct room_lamps *l)
{
    free(l->lamp);
    free(l->node);
    *l = (struct room_lamps){.n = 0};
}

/* ---- the light -------------------------------------------------------------------------------- */

struct point {
    const struct room_lamps *l;
    const struct room_scene *s;
    const double *p, *n;
    double sum[3];
};

static double room_lamps_dot(const double a[3], const double b[3])
{
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* One term of (1).  bodies: those that may stand between, a bit each. */
static void add_lamp(struct point *q, const struct room_lamp *lamp, unsigned bodies)
{
    double d[3] = {lamp->x[0] - q->p[0], lamp->x[1] - q->p[1], lamp->x[2] - q->p[2]};
    double cosine = room_lamps_dot(q->n, d);
    if (!(cosine > 0))
        return;
    for (int k = 0; k < q->s->n_bodies; k++)
        if ((bodies >> k & 1) && room_scene_sees(q->s, k, q->p, lamp->x, 0) != ROOM_ALL)
            return;
    double far = fmax(sqrt(room_lamps_dot(d, d)), q->l->ball), f = cosine / (far * far * far);
    for (int c = 0; c < q->l->nch; c++)
        q->sum[c] += lamp->e[c] * f;
}

/* (2) */
static void add_ball(struct point *q, const struct room_node *k, const double d[3], double d2)
{
    double f = 1 / (d2 * sqrt(d2)), nd = room_lamps_dot(q->n, d);
    for (int c = 0; c < q->l->nch; c++)
        q->sum[c] += f * (k->w[c] * nd + room_lamps_dot(q->n, k->m[c]) -
                          3 * nd * room_lamps_dot(d, k->m[c]) / d2);
}

static void add_node(struct point *q, size_t at, unsigned bodies)
{
    const struct room_node *k = &q->l->node[at];
    double d[3] = {k->c[0] - q->p[0], k->c[1] - q->p[1], k->c[2] - q->p[2]};
    double d2 = room_lamps_dot(d, d), height = room_lamps_dot(q->n, d);
    if (height <= -k->r)
        return;
    unsigned open = 0; /* bodies that may hide some of it */
    for (int b = 0; b < q->s->n_bodies; b++) {
        if (!(bodies >> b & 1))
            continue;
        enum room_seen seen = room_scene_sees(q->s, b, q->p, k->c, k->r);
        if (seen == ROOM_NONE)
            return;
        open |= seen == ROOM_PART ? 1u << b : 0;
    }
    if (open == 0 && height >= k->r && k->n > 1 && k->r * k->r <= ROOM_THETA * ROOM_THETA * d2) {
        add_ball(q, k, d, d2);
    } else if (k->right == 0) {
        for (size_t i = k->first; i < k->first + k->n; i++)
            add_lamp(q, &q->l->lamp[i], open);
    } else {
        add_node(q, at + 1, open);
        add_node(q, k->right, open);
    }
}

void room_lamps_shine(const struct room_lamps *l, const struct room_scene *s, const double p[3],
                      const double n[3], int body, double out[3])
{
    struct point q = {.l = l, .s = s, .p = p, .n = n};
    unsigned others = (1u << s->n_bodies) - 1; /* all are convex: no shade on the own lit side */
    if (body >= 0)
        others &= ~(1u << body);
    if (l->n > 0)
        add_node(&q, 0, others);
    for (int c = 0; c < 3; c++)
        out[c] = q.sum[c] * l->volume;
}
