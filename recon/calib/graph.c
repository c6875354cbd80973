/* Joins cameras by the frames that two of them saw: a relative pose for every pair, the maximum spanning tree with
 * the pairs' weights, and from it a first pose of everything. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "recon/calib/pose.h"
#include "recon/calib/priv.h"

#define GUESSES 64  /* relative poses of one pair that are tried, and that each is compared with */
#define FAR     4.0 /* a pose further than this many median distances counts as wrong */

/* A plane seen from afar has a second pose that may fit nearly as well; then both are used. */
static int poses_of(const struct view *v)
{
    return v->n_poses == 2 && v->fit[1] < 3 * v->fit[0] ? 2 : v->n_poses > 0;
}

static const struct view *graph_find(const struct calib *k, size_t frame, uint32_t camera)
{
    for (size_t i = k->of_frame[frame]; i < k->of_frame[frame + 1]; i++)
        if (k->view[i].camera == camera && k->view[i].fate == REC_VIEW_USED &&
            k->view[i].n_poses > 0)
            return &k->view[i];
    return NULL;
}

/* The frame whose number is that of f plus `later`; nf: none. */
static size_t shifted(const struct calib *k, size_t f, int later)
{
    const uint32_t *n = k->out->frame;
    size_t g = later < 0 ? f - 1 : f + (size_t)later;
    return later == 0 || (g < k->nf && (int64_t)n[g] - n[f] == later) ? g : k->nf;
}

/* All possible relative poses, up to four per frame; frame[i]: the frame of pose[i]. */
struct guesses {
    double pose[4 * GUESSES][6];
    size_t frame[4 * GUESSES], n, frames;
    double depth; /* m: mean distance of the board */
};

static void graph_gather(const struct calib *k, uint32_t a, uint32_t b, int later,
                         struct guesses *g)
{
    size_t both = 0, step, at = 0;
    g->n = g->frames = 0;
    g->depth = 0;
    for (size_t f = 0; f < k->nf; f++) {
        size_t s = shifted(k, f, later);
        both += s < k->nf && graph_find(k, s, a) != NULL && graph_find(k, f, b) != NULL;
    }
    step = both / GUESSES + 1;
    for (size_t f = 0; f < k->nf; f++) {
        size_t s = shifted(k, f, later);
        const struct view *va = s < k->nf ? graph_find(k, s, a) : NULL, *vb = graph_find(k, f, b);
        if (va == NULL || vb == NULL || at++ % step != 0)
            continue;
        for (int i = 0; i < poses_of(va); i++)
            for (int j = 0; j < poses_of(vb); j++) {
                double inverse[6];
                rec_pose_inverse(vb->pose[j], inverse);
                g->frame[g->n] = f;
                rec_pose_mul(va->pose[i], inverse, g->pose[g->n++]);
            }
        g->depth += va->pose[0][5];
        g->frames++;
    }
    if (g->frames > 0)
        g->depth /= (double)g->frames;
}

/* For each frame the distance from `pose` to the frame's nearest pose. */
static size_t graph_distances(const struct guesses *g, const double pose[6], double *d)
{
    size_t n = 0;
    for (size_t i = 0; i < g->n; i++) {
        double now = rec_pose_distance(pose, g->pose[i], g->depth);
        if (i > 0 && g->frame[i] == g->frame[i - 1])
            d[n - 1] = fmin(d[n - 1], now);
        else
            d[n++] = now;
    }
    return n;
}

size_t rec_calib_pair_pose(const struct calib *k, uint32_t a, uint32_t b, int later, double pose[6],
                           double *spread)
{
    struct guesses g;
    double d[GUESSES], best = INFINITY;
    graph_gather(k, a, b, later, &g);
    *spread = INFINITY;
    for (size_t i = 0; i < g.n; i++) {
        size_t n = graph_distances(&g, g.pose[i], d);
        double median = pvx_median(d, n), sum = 0; /* sorts d */
        for (size_t j = 0; j < n; j++)
            sum += fmin(d[j], FAR * median + 1e-9);
        if (sum < best) {
            best = sum;
            *spread = median;
            memcpy(pose, g.pose[i], 6 * sizeof *pose);
        }
    }
    return g.frames;
}

/* ---- the pairs and the tree ---------------------------------------------------------------------- */

/* Weight of one view: high with many corners, a large image, and a tilt that is not grazing. */
static double worth(const struct view *v)
{
    return (double)v->n * sqrt(v->area) * cos(v->tilt) * (0.3 + sin(v->tilt));
}

static void list_pairs(struct calib *k)
{
    for (uint32_t a = 0; a < k->nc; a++)
        for (uint32_t b = a + 1; b < k->nc; b++) {
            struct rec_calib_pair *p = &k->out->pair[k->out->n_pairs++];
            *p = (struct rec_calib_pair){.a = a, .b = b};
            for (size_t f = 0; f < k->nf; f++) {
                const struct view *va = graph_find(k, f, a), *vb = graph_find(k, f, b);
                if (va != NULL && vb != NULL) {
                    p->common++;
                    p->weight += fmin(worth(va), worth(vb));
                }
            }
        }
}

static bool stays(const struct calib *k, size_t c)
{
    return (k->in->camera[c].hold & REC_HOLD_POSE) != 0;
}

/* Sets the cameras that keep their pose, and the root of the tree: one of them, or the camera of the highest
 * weight. */
static void plant(struct calib *k)
{
    double most = -1;
    bool held = false;
    for (uint32_t c = 0; c < k->nc; c++) {
        if (!stays(k, c))
            continue;
        const struct rec_camera *old =
            &k->in->options.old->cameras[rec_rig_find(k->in->options.old, k->in->camera[c].name)];
        rec_rotation_log(old->R, k->pose[c]);
        memcpy(k->pose[c] + 3, old->t, sizeof old->t);
        k->pose_held[c] = k->joined[c] = true;
        if (!held)
            k->root = c;
        held = true;
    }
    for (uint32_t c = 0; c < k->nc && !held; c++) {
        double sum = 0;
        for (size_t i = 0; i < k->out->n_pairs; i++)
            if (k->out->pair[i].a == c || k->out->pair[i].b == c)
                sum += k->out->pair[i].weight;
        if (sum > most) {
            most = sum;
            k->root = c;
        }
    }
    if (!held)
        memset(k->pose[k->root], 0, sizeof k->pose[k->root]);
    k->pose_held[k->root] = k->joined[k->root] = true;
}

static void graph_grow(struct calib *k)
{
    for (;;) {
        struct rec_calib_pair *best = NULL;
        for (size_t i = 0; i < k->out->n_pairs; i++) {
            struct rec_calib_pair *p = &k->out->pair[i];
            if (p->common > 0 && k->joined[p->a] != k->joined[p->b] &&
                (best == NULL || p->weight > best->weight))
                best = p;
        }
        if (best == NULL)
            return;
        uint32_t from = k->joined[best->a] ? best->a : best->b,
                 to = from == best->a ? best->b : best->a;
        double step[6], spread;
        (void)rec_calib_pair_pose(k, to, from, 0, step, &spread);
        rec_pose_mul(step, k->pose[from], k->pose[to]);
        best->in_tree = k->joined[to] = true;
        if (best->common < REC_CALIB_JOINT)
            rec_calib_say(k, REC_CALIB_WARNING, REC_CALIB_WEAK_PAIR, (int)to, REC_NO_FRAME,
                          "%s hangs on %s by %u common poses; show the board to both %u times more",
                          k->in->camera[to].name, k->in->camera[from].name, best->common,
                          REC_CALIB_JOINT - best->common);
    }
}

/* ---- what cannot be joined ------------------------------------------------------------------------ */

static size_t usable(const struct calib *k, uint32_t c)
{
    size_t n = 0;
    for (size_t i = 0; i < k->nv; i++)
        n += k->view[i].camera == c && k->view[i].fate == REC_VIEW_USED && k->view[i].n_poses > 0;
    return n;
}

static pvx_err unseen(struct calib *k)
{
    pvx_err e = PVX_OK;
    for (uint32_t c = 0; c < k->nc; c++) {
        if (usable(k, c) > 0)
            continue;
        bool any = k->out->camera[c].views > 0;
        rec_calib_say(k, stays(k, c) ? REC_CALIB_NOTE : REC_CALIB_REFUSED, REC_CALIB_UNSEEN, (int)c,
                      REC_NO_FRAME,
                      stays(k, c) ? "%s shows no board and keeps the pose that it had"
                      : any ? "%s has no view of the board that fits one: is it the board that was "
                              "named, and sharp?"
                            : "%s never saw the board: show it there, or leave the camera out",
                      k->in->camera[c].name);
        if (stays(k, c))
            continue; /* keeps its pose of the old rig */
        e = PVX_EINVAL;
    }
    return e == PVX_OK ? e : pvx_fail(k->d, e, "%s", k->out->finding[0].text);
}

static size_t names(const struct calib *k, bool joined, char *out, size_t size)
{
    size_t n = 0;
    out[0] = '\0';
    for (uint32_t c = 0; c < k->nc; c++)
        if (k->joined[c] == joined && n + REC_NAME_MAX + 2 < size)
            n += (size_t)snprintf(out + n, size - n, "%s%s", n > 0 ? " " : "",
                                  k->in->camera[c].name);
    return n;
}

/* The pair to bridge: the two cameras whose views are nearest in time, since the board went from one to the other. */
static pvx_err graph_apart(struct calib *k)
{
    uint32_t a = 0, b = 0;
    int64_t least = INT64_MAX;
    char in[120], out[120];
    for (size_t i = 0; i < k->nv; i++)
        for (size_t j = 0; j < k->nv; j++) {
            const struct view *v = &k->view[i], *w = &k->view[j];
            int64_t gap = llabs((long long)v->board->frame - (long long)w->board->frame);
            if (v->fate == REC_VIEW_USED && w->fate == REC_VIEW_USED && k->joined[v->camera] &&
                !k->joined[w->camera] && gap < least) {
                least = gap;
                a = v->camera;
                b = w->camera;
            }
        }
    (void)names(k, true, in, sizeof in);
    (void)names(k, false, out, sizeof out);
    rec_calib_say(k, REC_CALIB_REFUSED, REC_CALIB_APART, (int)b, REC_NO_FRAME,
                  "nothing joins {%s} and {%s}: show the board to %s and %s together, %d poses", in,
                  out, k->in->camera[a].name, k->in->camera[b].name, REC_CALIB_JOINT);
    return pvx_fail(k->d, PVX_EINVAL, "%s", rec_calib_last_refused(k));
}

/* ---- boards --------------------------------------------------------------------------------------- */

/* Cost of the board at `pose` in frame f: sum of squared px over its views; a corner counts at most 10 px. */
static double cost(struct calib *k, size_t f, const double pose[6])
{
    double sum = 0, to[6];
    for (size_t i = k->of_frame[f]; i < k->of_frame[f + 1]; i++) {
        const struct view *v = &k->view[i];
        if (v->fate != REC_VIEW_USED || !k->joined[v->camera])
            continue;
        rec_pose_mul(k->pose[v->camera], pose, to);
        rec_calib_measure(k, v, to);
        for (size_t j = v->first; j < v->first + v->n; j++) {
            const struct seen *s = &k->seen[j];
            double r2 = isfinite(s->far) ? s->r[0] * s->r[0] + s->r[1] * s->r[1] : 100;
            sum += s->wrong ? 0 : fmin(r2, 100);
        }
    }
    return sum;
}

static void place_boards(struct calib *k)
{
    for (size_t f = 0; f < k->nf; f++) {
        double best = INFINITY;
        k->placed[f] = false;
        for (size_t i = k->of_frame[f]; i < k->of_frame[f + 1]; i++) {
            const struct view *v = &k->view[i];
            if (v->fate != REC_VIEW_USED || !k->joined[v->camera])
                continue;
            for (int j = 0; j < poses_of(v); j++) {
                double inverse[6], pose[6];
                rec_pose_inverse(k->pose[v->camera], inverse);
                rec_pose_mul(inverse, v->pose[j], pose);
                double now = cost(k, f, pose);
                if (now < best) {
                    best = now;
                    memcpy(k->board[f], pose, sizeof pose);
                    k->placed[f] = true;
                }
            }
        }
    }
}

pvx_err rec_calib_join(struct calib *k)
{
    PVX_TRY(unseen(k));
    list_pairs(k);
    plant(k);
    graph_grow(k);
    for (size_t c = 0; c < k->nc; c++)
        if (!k->joined[c])
            return graph_apart(k);
    place_boards(k);
    return PVX_OK;
}
