#include "recon/check/meant.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/geom/blind.h"

#define SIDE   80 /* blocks along a picture's longer side */
#define POINTS 32 /* along each side of the volume */
#define PLACES (POINTS * POINTS * POINTS)
#define LEAST  0.9
#define HALF   0.5
#define BESIDE (2.0 / 3)
#define CHANCE 0.01 /* of 1 - A: less is not told apart */

enum { ACROSS = 1, UPSIDE = 2 };

/* A silhouette in blocks. */
struct view {
    int32_t w, h, side;                          /* blocks, pixels along a block */
    uint32_t n;                                  /* lit blocks */
    uint8_t lit[SIDE * SIDE], near[SIDE * SIDE]; /* lit; lit or beside a lit one */
};

struct meant {
    const struct rec_rig *rig;
    size_t n;
    struct view *view; /* [n]; n 0: missing or dark */
    int16_t *at,
        *other; /* [n][POINTS^3] block of a point, -1: not in the picture; of the rig, of a reading */
    uint8_t (*met)[SIDE * SIDE]; /* [n] blocks where a point of the hull is */
    double best, second; /* of all trials, of those that change other cameras than the best */
    size_t of;           /* the camera that the best changes alone; n: it changes more */
    double alike;        /* of other trials that change it alone */
    double own[REC_MAX_CAMERAS]; /* best of those that change one camera */
    char text[REC_MEANT_TEXT - 120];
};

/* Whose picture a camera has, and how it is turned. */
struct picture {
    uint8_t of;
    unsigned turned;
};

static void meant_reduce(struct view *v, const struct rec_camera *c, int32_t binning,
                         const uint8_t *lit)
{
    int32_t bw = c->width / binning, bh = c->height / binning, longer = bw > bh ? bw : bh;
    int32_t by = (longer + SIDE - 1) / SIDE;
    *v = (struct view){.w = (bw + by - 1) / by, .h = (bh + by - 1) / by, .side = by * binning};
    for (int32_t y = 0; y < bh && lit != NULL; y++)
        for (int32_t x = 0; x < bw; x++)
            v->lit[y / by * v->w + x / by] |= lit[y * bw + x];
    for (int32_t i = 0; i < v->w * v->h; i++) {
        v->n += v->lit[i];
        for (int32_t y = i / v->w - 1; y <= i / v->w + 1; y++)
            for (int32_t x = i % v->w - 1; x <= i % v->w + 1; x++)
                if (x >= 0 && y >= 0 && x < v->w && y < v->h)
                    v->near[i] |= v->lit[y * v->w + x];
    }
}

/* The blocks of camera c where its points are, in its part of `of`. */
static const int16_t *meant_place(const struct meant *m, size_t c, const struct rec_camera *camera,
                                  int16_t *of)
{
    const struct rec_grid *g = &m->rig->grid;
    const struct view *v = &m->view[c];
    int16_t *at = of + c * PLACES;
    for (int32_t i = 0; i < PLACES; i++) {
        const int32_t p[3] = {i % POINTS, i / POINTS % POINTS, i / POINTS / POINTS};
        double X[3], uv[2];
        for (int a = 0; a < 3; a++)
            X[a] = g->min[a] + (p[a] + 0.5) / POINTS * (g->max[a] - g->min[a]);
        at[i] = -1;
        if (rec_camera_sees(camera, X, uv)) {
            int32_t x = (int32_t)((uv[0] + 0.5) / v->side);
            int32_t y = (int32_t)((uv[1] + 0.5) / v->side);
            if (x < v->w && y < v->h)
                at[i] = (int16_t)(y * v->w + x);
        }
    }
    return at;
}

static void meant_same(const struct meant *m, struct picture *p)
{
    for (size_t c = 0; c < m->n; c++)
        p[c] = (struct picture){(uint8_t)c, 0};
}

static int32_t meant_turn(const struct view *v, int32_t i, unsigned turned)
{
    int32_t x = i % v->w, y = i / v->w;
    return ((turned & UPSIDE) != 0 ? v->h - 1 - y : y) * v->w +
           ((turned & ACROSS) != 0 ? v->w - 1 - x : x);
}

/* (1) of meant.h. */
static double meant_agreement(const struct meant *m, const int16_t *const *at,
                              const struct picture *p)
{
    double sum = 0, cameras = 0;
    memset(m->met, 0, m->n * sizeof *m->met);
    for (size_t i = 0; i < PLACES; i++) {
        size_t seen = 0, c = 0;
        for (; c < m->n; c++) {
            const struct view *v = &m->view[p[c].of];
            int32_t b = at[c][i];
            if (b < 0 || v->n == 0)
                continue;
            if (!v->near[meant_turn(v, b, p[c].turned)])
                break;
            seen++;
        }
        for (size_t k = 0; k < m->n && c == m->n && seen > 1; k++)
            if (at[k][i] >= 0)
                m->met[k][at[k][i]] = 1;
    }
    for (size_t c = 0; c < m->n; c++) {
        const struct view *v = &m->view[p[c].of];
        uint32_t met = 0;
        for (int32_t i = 0; i < v->w * v->h; i++)
            met += m->met[c][i] && v->lit[meant_turn(v, i, p[c].turned)];
        sum += v->n > 0 ? (double)met / v->n : 0;
        cameras += v->n > 0;
    }
    return cameras > 1 ? sum / cameras : 1;
}

/* Keeps the best trial and the values of those beside it.  of: the camera that it changes alone, or n. */
static void meant_try(struct meant *m, const int16_t *const *at, const struct picture *p, size_t of,
                      const char *text)
{
    const double a = meant_agreement(m, at, p), own = of < m->n ? m->own[of] : 0;
    const bool same = of < m->n && of == m->of;
    if (a > m->best) {
        m->second = same ? m->second : m->best;
        m->alike = own;
        m->best = a;
        m->of = of;
        snprintf(m->text, sizeof m->text, "%s", text);
    } else if (same) {
        m->alike = fmax(m->alike, a);
    } else {
        m->second = fmax(m->second, a);
    }
    if (of < m->n)
        m->own[of] = fmax(own, a);
}

static void meant_try_pictures(struct meant *m, const int16_t *const *at)
{
    static const char *const turns[] = {"", "mirrored left to right", "mirrored top to bottom",
                                        "turned by 180 degrees"};
    struct picture p[REC_MAX_CAMERAS], same[REC_MAX_CAMERAS];
    char text[REC_MEANT_TEXT - 120];
    meant_same(m, same);
    for (unsigned k = ACROSS; k <= (ACROSS | UPSIDE); k++) {
        for (size_t c = 0; c < m->n; c++) {
            memcpy(p, same, sizeof p);
            p[c].turned = k;
            snprintf(text, sizeof text, "if the picture of %s is %s", m->rig->cameras[c].name,
                     turns[k]);
            meant_try(m, at, p, c, text);
        }
        for (size_t c = 0; c < m->n; c++)
            p[c] = (struct picture){(uint8_t)c, k};
        snprintf(text, sizeof text, "if all pictures are %s", turns[k]);
        meant_try(m, at, p, m->n, text);
    }
    for (size_t a = 0; a < m->n; a++)
        for (size_t b = a + 1; b < m->n; b++) {
            const struct rec_camera *q = &m->rig->cameras[a], *r = &m->rig->cameras[b];
            if (q->width != r->width || q->height != r->height)
                continue;
            memcpy(p, same, sizeof p);
            p[a].of = (uint8_t)b;
            p[b].of = (uint8_t)a;
            snprintf(text, sizeof text, "if the pictures of %s and %s are swapped", q->name,
                     r->name);
            meant_try(m, at, p, m->n, text);
        }
}

/* R, t and K of all cameras, and of each alone, with one change then. */
static void meant_try_readings(struct meant *m)
{
    struct rec_camera as[REC_MAX_CAMERAS];
    const int16_t *at[REC_MAX_CAMERAS];
    struct picture same[REC_MAX_CAMERAS];
    char text[REC_MEANT_TEXT - 120];
    meant_same(m, same);
    for (size_t i = 0; i < REC_READINGS; i++) {
        int changes = rec_blind_reading(m->rig, i, as, text, sizeof text);
        if (changes == 0 || changes > 2)
            continue;
        for (size_t c = 0; c < m->n; c++)
            at[c] = meant_place(m, c, &as[c], m->other);
        meant_try(m, at, same, m->n, text);
        const size_t n = strlen(text);
        for (size_t c = 0; c < m->n && changes == 1; c++) {
            for (size_t k = 0; k < m->n; k++)
                at[k] = (k == c ? m->other : m->at) + k * PLACES;
            snprintf(text + n, sizeof text - n, " in %s", m->rig->cameras[c].name);
            meant_try(m, at, same, c, text);
        }
    }
}

static void meant_conclude(struct meant *m, char text[REC_MEANT_TEXT])
{
    struct picture same[REC_MAX_CAMERAS];
    const int16_t *at[REC_MAX_CAMERAS];
    meant_same(m, same);
    for (size_t c = 0; c < m->n; c++)
        at[c] = meant_place(m, c, &m->rig->cameras[c], m->at);
    double now = meant_agreement(m, at, same);
    if (1 - now > 2 * CHANCE) {
        meant_try_pictures(m, at);
        meant_try_readings(m);
    }
    double left = fmax(1 - m->best, CHANCE);
    if (m->best >= LEAST && left <= HALF * (1 - now) && left <= BESIDE * (1 - m->second))
        snprintf(text, REC_MEANT_TEXT,
                 "the silhouettes of this set agree with the rig to %.0f %%, and to %.0f %% %s%s",
                 100 * now, 100 * m->best, left <= BESIDE * (1 - m->alike) ? "" : "for instance ",
                 m->text);
}

pvx_err rec_rig_meant(const struct rec_rig *rig, int32_t binning, const uint8_t *const *lit,
                      char text[REC_MEANT_TEXT])
{
    const size_t n = rig->n_cameras, places = n * PLACES;
    struct meant m = {.rig = rig,
                      .n = n,
                      .view = pvx_calloc(n, sizeof *m.view),
                      .at = pvx_calloc(places, sizeof *m.at),
                      .other = pvx_calloc(places, sizeof *m.other),
                      .met = pvx_calloc(n, sizeof *m.met)};
    bool ok = m.view != NULL && m.at != NULL && m.other != NULL && m.met != NULL;
    text[0] = '\0';
    for (size_t c = 0; c < n && ok; c++)
        meant_reduce(&m.view[c], &rig->cameras[c], binning, lit[c]);
    if (ok)
        meant_conclude(&m, text);
    free(m.view);
    free(m.at);
    free(m.other);
    free(m.met);
    return ok ? PVX_OK : PVX_ENOMEM;
}
