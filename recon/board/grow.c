#include "recon/board/grow.h"

#include <math.h>
#include <string.h>

#define SEED_WEIGHT \
    0.05 /* of a seed relative to a fitted corner: markers' corners are off by half a pixel */
#define FAR_WEIGHT 1e-3 /* of points many squares away, relative to near ones */
#define SPREAD     1.7  /* squares: how fast the weight falls */
#define SHORTEST   7.0  /* px, least shorter side of a square: a smaller window is unreliable */
#define FLATTEST \
    5.0 /* px, least extent of a square in any direction: below, the board is seen on edge */
#define LIKENESS 0.85
#define STRAY    0.12 /* of a square: largest distance from the place that the neighbours predict */

struct growth {
    const struct rec_field *f;
    const struct rec_print *p;
    struct rec_pair *pair; /* seeds, then found corners; weight: before that of distance */
    size_t n;
    struct rec_pair local[2048];
};

/* The map near (x, y) from all known points but `without`. */
static bool local_map(struct growth *g, const double xy[2], const struct rec_pair *without,
                      double h[9])
{
    double scale = 1 / (2 * SPREAD * SPREAD * g->p->board.square * g->p->board.square);
    size_t k = 0, step = g->n / 2048 + 1;
    for (size_t i = 0; i < g->n; i++) {
        const struct rec_pair *q = &g->pair[i];
        double dx = q->x - xy[0], dy = q->y - xy[1], far = scale * (dx * dx + dy * dy);
        if (q == without || (far > 12 && i % step != 0) || k == 2048)
            continue;
        g->local[k] = *q;
        g->local[k++].weight *= exp(-far) + FAR_WEIGHT;
    }
    return rec_homography_fit(g->local, k, h);
}

static bool as_printed(const struct rec_corner_fit *c, double side)
{
    return side >= SHORTEST && c->likeness >= LIKENESS && c->contrast > 0.01 &&
           c->moved < 0.35 * side && isfinite(c->cov[0]) && isfinite(c->cov[2]) &&
           c->cov[0] + c->cov[2] < 0.02;
}

/* px, the shorter side of a square there; 0 where the board is seen on edge. */
static double side_at(const struct rec_print *p, const double h[9], const double xy[2])
{
    double d[4];
    rec_homography_jacobian(h, xy[0], xy[1], d);
    double most = hypot(d[0] + d[3], d[1] - d[2]), least = hypot(d[0] - d[3], d[1] + d[2]);
    if (0.5 * p->board.square * fabs(most - least) < FLATTEST) /* the smaller singular value */
        return 0;
    return p->board.square * fmin(hypot(d[0], d[2]), hypot(d[1], d[3]));
}

/* The open corner nearest to a known point; -1 at the end. */
static ptrdiff_t grow_next(const double *distance, size_t n)
{
    ptrdiff_t best = -1;
    for (size_t i = 0; i < n; i++)
        if (distance[i] >= 0 && (best < 0 || distance[i] < distance[best]))
            best = (ptrdiff_t)i;
    return best;
}

static void come_nearer(double *distance, size_t n, const struct rec_print *p, double x, double y)
{
    double q[3];
    for (size_t i = 0; i < n; i++) {
        if (distance[i] < 0)
            continue;
        rec_board_point(&p->board, REC_FRONT, (uint32_t)i, q);
        distance[i] = fmin(distance[i], hypot(q[0] - x, q[1] - y));
    }
}

static void grow_keep(struct growth *g, const double xy[2], const struct rec_corner_fit *c)
{
    g->pair[g->n++] = (struct rec_pair){xy[0], xy[1], c->x, c->y, 1};
}

/* Finds corners from the seeds outwards. */
static void spread_out(struct growth *g, size_t n, struct rec_grown *corner)
{
    double distance[REC_BOARD_CORNERS], blur = 0.8;
    for (size_t i = 0; i < n; i++)
        distance[i] = INFINITY;
    for (size_t i = 0; i < g->n; i++)
        come_nearer(distance, n, g->p, g->pair[i].x, g->pair[i].y);
    for (ptrdiff_t i; (i = grow_next(distance, n)) >= 0;) {
        double xy[3], h[9];
        distance[i] = -1;
        rec_board_point(&g->p->board, REC_FRONT, (uint32_t)i, xy);
        struct rec_corner_fit *c = &corner[i].fit;
        *c = (struct rec_corner_fit){.blur = blur};
        if (!local_map(g, xy, NULL, h) || !rec_corner_refine(g->f, g->p, h, xy, false, c) ||
            !as_printed(c, side_at(g->p, h, xy)))
            continue;
        corner[i].found = true;
        blur += 0.3 * (c->blur - blur);
        grow_keep(g, xy, c);
        come_nearer(distance, n, g->p, xy[0], xy[1]);
    }
}

/* Fits each corner anew with the map of its neighbours; corners that stray are dropped. */
static size_t grow_settle(struct growth *g, size_t n, struct rec_grown *corner)
{
    size_t at = 0, left = 0;
    for (size_t i = 0; i < n; i++) {
        double xy[3], h[9], uv[2];
        if (!corner[i].found)
            continue;
        struct rec_pair *own = &g->pair[at++];
        struct rec_corner_fit c = corner[i].fit;
        rec_board_point(&g->p->board, REC_FRONT, (uint32_t)i, xy);
        corner[i].found = false;
        if (!local_map(g, xy, own, h))
            continue;
        double side = side_at(g->p, h, xy);
        rec_homography_map(h, xy[0], xy[1], uv);
        if (hypot(uv[0] - own->u, uv[1] - own->v) > STRAY * side + 0.5 ||
            !local_map(g, xy, NULL, h) || !rec_corner_refine(g->f, g->p, h, xy, true, &c) ||
            !as_printed(&c, side))
            continue;
        corner[i].found = true;
        corner[i].fit = c;
        left++;
    }
    return left;
}

size_t rec_grow(const struct rec_field *f, const struct rec_print *p, const struct rec_pair *seed,
                size_t n_seed, struct rec_pair *pair, struct rec_grown *corner)
{
    struct growth g = {.f = f, .p = p, .pair = pair, .n = n_seed};
    size_t n = rec_board_corners(&p->board), found = 0;
    memset(corner, 0, n * sizeof *corner);
    for (size_t i = 0; i < n_seed; i++) {
        pair[i] = seed[i];
        pair[i].weight *= SEED_WEIGHT;
    }
    spread_out(&g, n, corner);
    /* the corners alone, in their order */
    g.n = 0;
    for (size_t i = 0; i < n; i++)
        if (corner[i].found) {
            double xy[3];
            rec_board_point(&p->board, REC_FRONT, (uint32_t)i, xy);
            grow_keep(&g, xy, &corner[i].fit);
            found++;
        }
    return found >= 5 ? grow_settle(&g, n, corner) : found;
}
