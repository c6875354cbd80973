#include "recon/check/lags.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/median.h"

#define LATE   0.55 /* of (1) */
#define CLEAR  1.8
#define NEAR   0.7 /* of the largest (1): it may be this camera, too */
#define BLOCKS 0.1 /* least displacement, in blocks: two poses that are off by 0.5 px of 640 */
#define MOVED  1.6 /* times as much of r is explained by a shift */
#define ALIKE  0.8 /* from which on both are said */

/* Sums over sets of products of r, v and the slopes of b across and down. */
struct sums {
    double rv, vv, rx, ry, xx, xy, yy;
};

/* (1) of all cameras, in volumes without those of `out`. */
struct look {
    uint64_t out;
    struct sums sums[REC_MAX_CAMERAS];
    double off[REC_MAX_CAMERAS]; /* from the median of the others; NAN: not known */
    double rest;                 /* the largest of cameras that are not in out */
};

/* The volume of set i from all cameras but c and those of out. */
static void lags_solve(const struct rec_lags *k, size_t i, size_t c, uint64_t out)
{
    struct rec_belief w;
    for (size_t d = 0; d < k->t->rig->n_cameras; d++) {
        w.at[d] = k->at[d];
        w.picture[d] = d == c || (out >> d & 1) != 0 ? NULL : rec_trials_later(k->t, i, d, 0);
    }
    (void)rec_coarse_solve(k->coarse, &w);
}

static void lags_add(const float *p, const struct rec_blocks *b, const struct rec_blocks *was,
                     const struct rec_blocks *next, struct sums *o)
{
    double bp = 0, pp = 0;
    for (int32_t i = 0; i < b->w * b->h; i++)
        if (b->there[i]) {
            bp += (double)b->b[i] * (double)p[i];
            pp += (double)p[i] * (double)p[i];
        }
    const double gain = pp > 0 ? bp / pp : 0;
    for (int32_t y = 1; y + 1 < b->h; y++)
        for (int32_t x = 1; x + 1 < b->w; x++) {
            const int32_t i = y * b->w + x;
            if (!b->there[i] || !was->there[i] || !next->there[i])
                continue;
            const double r = (double)b->b[i] - gain * (double)p[i],
                         v = 0.5 * ((double)next->b[i] - (double)was->b[i]),
                         bx = 0.5 * ((double)b->b[i + 1] - (double)b->b[i - 1]),
                         by = 0.5 * ((double)b->b[i + b->w] - (double)b->b[i - b->w]);
            o->rv += r * v;
            o->vv += v * v;
            o->rx += r * bx;
            o->ry += r * by;
            o->xx += bx * bx;
            o->xy += bx * by;
            o->yy += by * by;
        }
}

static void lags_look(const struct rec_lags *k, uint64_t out, struct look *o)
{
    const size_t cams = k->t->rig->n_cameras;
    double in[REC_MAX_CAMERAS];
    size_t n = 0;
    memset(o, 0, sizeof *o);
    o->out = out;
    for (size_t c = 0; c < cams; c++) {
        struct sums *s = &o->sums[c];
        for (size_t i = 0; i < k->t->n; i++) {
            const struct rec_blocks *b = rec_trials_later(k->t, i, c, 0),
                                    *was = rec_trials_later(k->t, i, c, -1),
                                    *next = rec_trials_later(k->t, i, c, 1);
            if (b == NULL || was == NULL || next == NULL)
                continue;
            lags_solve(k, i, c, out);
            lags_add(rec_coarse_show(k->coarse, k->at[c], b), b, was, next, s);
        }
        o->off[c] = s->vv > 0 ? -s->rv / s->vv : (double)NAN;
        if ((out >> c & 1) == 0 && !isnan(o->off[c]))
            in[n++] = o->off[c];
    }
    const double usual = n > 0 ? pvx_median(in, n) : 0;
    for (size_t c = 0; c < cams; c++) {
        o->off[c] -= usual;
        if ((out >> c & 1) == 0 && !isnan(o->off[c]))
            o->rest = fmax(o->rest, fabs(o->off[c]));
    }
}

/* Shares of r that v and a shift explain. */
static void lags_explained(const struct sums *s, double *by_v, double *by_shift)
{
    const double det = s->xx * s->yy - s->xy * s->xy;
    *by_v = s->rv * s->rv / s->vv;
    *by_shift =
        det > 0 ? (s->rx * s->rx * s->yy - 2 * s->rx * s->ry * s->xy + s->ry * s->ry * s->xx) / det
                : 0;
}

static bool lags_sure(const struct look *o, size_t c, bool *alike)
{
    const struct sums *s = &o->sums[c];
    const double off = fabs(o->off[c]), blocks = off * sqrt(s->vv / (s->xx + s->yy));
    double v, shift;
    if (!(off >= LATE && off >= CLEAR * o->rest && blocks >= BLOCKS))
        return false;
    lags_explained(s, &v, &shift);
    *alike = *alike || shift > ALIKE * v;
    return shift < MOVED * v;
}

/* How many sets late camera c is, of the sign that is known: the picture that fits best. */
static int lags_count(const struct rec_lags *k, const struct look *o, size_t c)
{
    const int sign = o->off[c] > 0 ? 1 : -1;
    int best = 1;
    double least = INFINITY;
    for (int lag = 1; lag <= REC_TRIALS_LATE; lag++) {
        double gain = 0, n = 0;
        for (size_t i = 0; i < k->t->n; i++) {
            const struct rec_blocks *b = rec_trials_later(k->t, i, c, 0),
                                    *then = rec_trials_later(k->t, i, c, sign * lag);
            if (b == NULL || then == NULL)
                continue;
            lags_solve(k, i, c, o->out);
            gain += rec_coarse_miss(k->coarse, k->at[c], then, NULL) -
                    rec_coarse_miss(k->coarse, k->at[c], b, NULL);
            n++;
        }
        if (n > 0 && gain / n < least) {
            least = gain / n;
            best = lag;
        }
    }
    return sign * best;
}

static void lags_say(const struct rec_lags *k, const struct look *o, bool alike,
                     struct rec_trials_found *out)
{
    size_t n = 0, m = 0;
    out->cause = REC_CAUSE_LATE;
    out->cameras = o->out;
    for (size_t c = 0; c < k->t->rig->n_cameras; c++) {
        if ((o->out >> c & 1) == 0 || n > sizeof out->text - 200 || m > sizeof out->next - 200)
            continue;
        const char *name = k->t->rig->cameras[c].name;
        const int lag = lags_count(k, o, c);
        n += (size_t)snprintf(out->text + n, sizeof out->text - n, "%s %s are %d frame%s %s",
                              n > 0 ? ", those of" : "the pictures of", name, abs(lag),
                              abs(lag) == 1 ? "" : "s", lag > 0 ? "late" : "early");
        m += (size_t)snprintf(out->next + m, sizeof out->next - m,
                              m == 0 ? "look at trigger and clock of %s: pyrovox cameras test; "
                                       "number its files by %+d"
                                     : ", those of %s by %+d",
                              name, -lag);
    }
    snprintf(out->text + n, sizeof out->text - n, ", by how the flame changes in them%s",
             alike ? " (or moved, which looks the same here)" : "");
}

void rec_lags_find(const struct rec_lags *k, struct rec_trials_found *out)
{
    const size_t cams = k->t->rig->n_cameras;
    struct look now, with, best;
    bool alike = false;
    lags_look(k, 0, &now);
    for (size_t n = 0; n < cams / 3 && now.rest >= LATE; n++) {
        best = now;
        best.rest = INFINITY;
        for (size_t c = 0; c < cams; c++) {
            if ((now.out >> c & 1) != 0 || !(fabs(now.off[c]) >= NEAR * now.rest))
                continue;
            lags_look(k, now.out | (uint64_t)1 << c, &with);
            if (with.rest < best.rest)
                best = with;
        }
        now = best;
    }
    for (size_t c = 0; c < cams; c++)
        if ((now.out >> c & 1) != 0 && !lags_sure(&now, c, &alike))
            return;
    if (now.out != 0)
        lags_say(k, &now, alike, out);
}
