#include "daemon/cli/calibrate/still.h"

#include <math.h>
#include <stdlib.h>

#include "base/median.h"

#define LEAST 6    /* corners */
#define MOST  4096 /* more are not needed */

/* Distances of common corners; both lists are by id. */
static size_t still_distances(const struct rec_board_view *a, const struct rec_board_view *b,
                              double scale, double *d, size_t room)
{
    size_t n = 0, i = 0, j = 0;
    while (i < a->n && j < b->n && n < room) {
        const struct rec_board_corner *p = &a->corner[i], *q = &b->corner[j];
        if (p->id == q->id)
            d[n++] = hypot(p->x - q->x, p->y - q->y) / scale;
        i += p->id <= q->id;
        j += q->id <= p->id;
    }
    return n;
}

double calibrate_moved(const struct rec_board_view *a, const struct rec_board_view *b, size_t n,
                       const double *scale)
{
    double d[MOST];
    size_t all = 0;
    for (size_t i = 0; i < n; i++)
        if (a[i].n > 0 && b[i].n > 0 && a[i].face == b[i].face)
            all += still_distances(&a[i], &b[i], scale != NULL ? scale[i] : 1, d + all, MOST - all);
    if (all < LEAST)
        return INFINITY;
    qsort(d, all, sizeof *d, pvx_ascending);
    return d[all / 2];
}

/* ---- the graph ---- */

static uint32_t root_of(const uint32_t *up, uint32_t c)
{
    while (up[c] != c)
        c = up[c];
    return c;
}

/* Number the groups by size: the largest is 0.  Of two equal groups the one with the lowest camera comes first. */
static void number_groups(const uint32_t *up, size_t n, struct calibrate_graph *g)
{
    size_t size[REC_MAX_CAMERAS] = {0};
    for (uint32_t c = 0; c < n; c++)
        size[root_of(up, c)]++;
    for (;;) {
        size_t best = n;
        for (size_t r = 0; r < n; r++)
            if (size[r] > 0 && (best == n || size[r] > size[best]))
                best = r;
        if (best == n)
            return;
        size[best] = 0;
        for (uint32_t c = 0; c < n; c++)
            if (root_of(up, c) == best)
                g->group[c] = (uint32_t)g->groups;
        g->groups++;
    }
}

void calibrate_graph(const uint32_t *common, size_t n, struct calibrate_graph *g)
{
    uint32_t up[REC_MAX_CAMERAS];
    *g = (struct calibrate_graph){0};
    for (uint32_t c = 0; c < n; c++)
        up[c] = c;
    for (;;) { /* Kruskal's, strongest pair first */
        struct calibrate_pair best = {0};
        for (uint32_t a = 0; a < n; a++)
            for (uint32_t b = a + 1; b < n; b++)
                if (common[a * n + b] > best.common && root_of(up, a) != root_of(up, b))
                    best = (struct calibrate_pair){a, b, common[a * n + b]};
        if (best.common == 0)
            break;
        uint32_t ra = root_of(up, best.a), rb = root_of(up, best.b);
        up[ra > rb ? ra : rb] = ra > rb ? rb : ra;
        g->tree[g->n_tree++] = best;
    }
    number_groups(up, n, g);
}
