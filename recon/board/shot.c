#include "recon/board/shot.h"

#include <math.h>
#include <stdlib.h>

#include "base/mem.h"

struct shot {
    const struct rec_board_shot *s;
    double margin, plane; /* m: paper around the print; z of the visible face */
    bool bare;
};

/* v in board axes. */
static void to_board(const double R[9], const double v[3], double out[3])
{
    for (int i = 0; i < 3; i++)
        out[i] = R[i] * v[0] + R[3 + i] * v[1] + R[6 + i] * v[2];
}

static void shot_set_up(const struct rec_board_shot *s, struct shot *w)
{
    const struct rec_board *b = &s->print->board;
    double c[3], d[3], eye[3];
    *w = (struct shot){.s = s, .margin = 0.5 * s->print->pitch};
    rec_camera_centre(s->camera, c);
    for (int i = 0; i < 3; i++)
        d[i] = c[i] - s->t[i];
    to_board(s->R, d, eye);
    bool back = eye[2] > 0;
    w->plane = back && b->two_sided && !isnan(b->thickness) ? b->thickness : 0;
    w->bare = back && !b->two_sided;
}

/* Point where the ray of pixel (u, v) meets the face; NAN: none. */
static void shot_meet(const struct shot *w, double u, double v, double xy[2])
{
    double o[3], dir[3], d[3], from[3];
    xy[0] = xy[1] = NAN;
    if (!rec_camera_ray(w->s->camera, u, v, o, dir))
        return;
    to_board(w->s->R, dir, d);
    for (int i = 0; i < 3; i++)
        o[i] -= w->s->t[i];
    to_board(w->s->R, o, from);
    double along = (w->plane - from[2]) / d[2];
    if (!(along > 0) || !isfinite(along))
        return;
    xy[0] = from[0] + along * d[0];
    xy[1] = from[1] + along * d[1];
}

static double level_at(const struct shot *w, double x, double y, double hx, double hy)
{
    const struct rec_board_shot *s = w->s;
    const struct rec_print *p = s->print;
    if (!(x >= p->x0 - w->margin && x <= p->x1 + w->margin && y >= p->y0 - w->margin &&
          y <= p->y1 + w->margin))
        return s->ground;
    double ink = w->bare ? 0 : rec_print_ink(p, x, y, hx, hy);
    if (p->board.inverted && !w->bare)
        ink = 1 - ink;
    return s->paper + ink * (s->ink - s->paper);
}

/* Mean over a pixel whose corners meet the face at a, b (above, left to right), c, d (below).  Within a pixel the
 * points are interpolated bilinearly, to better than 1e-4 of its side. */
static double pixel(const struct shot *w, const double a[2], const double b[2], const double c[2],
                    const double d[2])
{
    int n = w->s->across;
    double sum = 0, h[2];
    for (int k = 0; k < 2; k++)
        h[k] = (fabs(b[k] - a[k]) + fabs(c[k] - a[k])) / (2 * n);
    for (int i = 0; i < n; i++)
        for (int j = 0; j < n; j++) {
            double f = (j + 0.5) / n, g = (i + 0.5) / n, at[2];
            for (int k = 0; k < 2; k++)
                at[k] = (1 - g) * ((1 - f) * a[k] + f * b[k]) + g * ((1 - f) * c[k] + f * d[k]);
            sum += level_at(w, at[0], at[1], h[0], h[1]);
        }
    return sum / (n * n);
}

/* The part of the picture that the plate may be in: [x0, x1) x [y0, y1). */
struct part {
    int32_t x0, y0, x1, y1;
};

static struct part shot_find(const struct shot *w)
{
    enum { STEPS = 16 };
    const struct rec_camera *k = w->s->camera;
    const struct rec_print *p = w->s->print;
    struct part all = {0, 0, k->width, k->height};
    double lo[2] = {INFINITY, INFINITY}, hi[2] = {-INFINITY, -INFINITY};
    for (int i = 0; i < 4 * STEPS; i++) { /* along its rim */
        double f = (double)(i % STEPS) / STEPS, x = i / STEPS == 0 ? f : i / STEPS == 2 ? 1 - f : 0;
        double y = i / STEPS == 1 ? f : i / STEPS == 3 ? 1 - f : 0;
        x = i / STEPS == 1 ? 1 : x;
        y = i / STEPS == 2 ? 1 : y;
        double b[3] = {p->x0 - w->margin + x * (p->x1 - p->x0 + 2 * w->margin),
                       p->y0 - w->margin + y * (p->y1 - p->y0 + 2 * w->margin), w->plane};
        double X[3], uv[2];
        for (int a = 0; a < 3; a++)
            X[a] = w->s->R[3 * a] * b[0] + w->s->R[3 * a + 1] * b[1] + w->s->R[3 * a + 2] * b[2] +
                   w->s->t[a];
        if (!rec_camera_project(k, X, uv))
            return all;
        for (int a = 0; a < 2; a++) {
            lo[a] = fmin(lo[a], uv[a]);
            hi[a] = fmax(hi[a], uv[a]);
        }
    }
    return (struct part){(int32_t)fmin(fmax(floor(lo[0]) - 2, 0), k->width),
                         (int32_t)fmin(fmax(floor(lo[1]) - 2, 0), k->height),
                         (int32_t)fmin(fmax(ceil(hi[0]) + 3, 0), k->width),
                         (int32_t)fmin(fmax(ceil(hi[1]) + 3, 0), k->height)};
}

/* Each row of pixel corners is computed once, for the pixels above and below. */
static pvx_err shot_draw(const struct shot *w, const struct part *a, float *level)
{
    int32_t n = a->x1 - a->x0;
    if (n <= 0 || a->y1 <= a->y0)
        return PVX_OK;
    double *mem = pvx_calloc(4 * ((size_t)n + 1), sizeof *mem);
    PVX_NEED(mem);
    double(*above)[2] = (double(*)[2])mem, (*below)[2] = above + n + 1;
    for (int32_t i = 0; i <= n; i++)
        shot_meet(w, a->x0 + i - 0.5, a->y0 - 0.5, above[i]);
    for (int32_t v = a->y0; v < a->y1; v++) {
        float *row = level + (ptrdiff_t)v * w->s->camera->width + a->x0;
        for (int32_t i = 0; i <= n; i++)
            shot_meet(w, a->x0 + i - 0.5, v + 0.5, below[i]);
        for (int32_t i = 0; i < n; i++)
            row[i] = (float)pixel(w, above[i], above[i + 1], below[i], below[i + 1]);
        double(*t)[2] = above;
        above = below;
        below = t;
    }
    free(mem);
    return PVX_OK;
}

/* Separable; beyond the border the picture continues with the value at the border. */
static pvx_err shot_blur(double sigma, int32_t w, int32_t h, float *level)
{
    int32_t m = (int32_t)ceil(4 * sigma), longest = w > h ? w : h;
    double *k = pvx_calloc((size_t)m + 1, sizeof *k), sum = 0;
    float *line = pvx_calloc((size_t)longest + 2 * (size_t)m, sizeof *line);
    pvx_err e = k == NULL || line == NULL ? PVX_ENOMEM : PVX_OK;
    for (int32_t i = 0; e == PVX_OK && i <= m; i++)
        sum += (i > 0 ? 2 : 1) * (k[i] = exp(-0.5 * i * i / (sigma * sigma)));
    for (int pass = 0; e == PVX_OK && pass < 2; pass++) {
        int32_t n = pass == 0 ? w : h, lines = pass == 0 ? h : w;
        ptrdiff_t step = pass == 0 ? 1 : w, next = pass == 0 ? w : 1;
        for (int32_t j = 0; j < lines; j++) {
            float *a = level + j * next;
            for (int32_t i = -m; i < n + m; i++)
                line[i + m] = a[(i < 0 ? 0 : i >= n ? n - 1 : i) * step];
            for (int32_t i = 0; i < n; i++) {
                double v = k[0] * line[i + m];
                for (int32_t q = 1; q <= m; q++)
                    v += k[q] * (line[i + m - q] + line[i + m + q]);
                a[i * step] = (float)(v / sum);
            }
        }
    }
    free(k);
    free(line);
    return e;
}

pvx_err rec_board_shoot(const struct rec_board_shot *s, float *level)
{
    struct shot w;
    size_t n = (size_t)s->camera->width * (size_t)s->camera->height;
    shot_set_up(s, &w);
    for (size_t i = 0; i < n; i++)
        level[i] = (float)s->ground;
    struct part a = shot_find(&w);
    PVX_TRY(shot_draw(&w, &a, level));
    return s->blur > 0 ? shot_blur(s->blur, s->camera->width, s->camera->height, level) : PVX_OK;
}
