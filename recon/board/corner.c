#include "recon/board/corner.h"

#include <math.h>
#include <string.h>

#include "recon/board/homography.h"
#include "recon/geom/spd.h"

#define R_MAX  9 /* px, half a window's side */
#define M_MAX  9 /* px around the window, for the blur */
#define SIDE   (2 * (R_MAX + M_MAX) + 1)
#define REACH  0.47 /* share of a square around the corner that is compared */
#define BLUR_0 0.2  /* px, limits of the blur */
#define BLUR_1 3.5
#define FLOOR  0.015 /* px, least error: bending within a window, print and plate */

struct window {
    const struct rec_field *f;
    const struct rec_print *p;
    double inverse[9], xy[2]; /* picture to board; the corner */
    double reach;             /* m */
    double hx, hy;            /* m, half the extent of a pixel */
    int r, m;                 /* px */
    int u0, v0;               /* the window's middle pixel */
    float t[SIDE * SIDE], blurred[SIDE * SIDE];
    bool use[SIDE * SIDE];
};

static void corner_draw(struct window *w, const double shift[2])
{
    int n = w->r + w->m, side = 2 * n + 1;
    for (int v = -n; v <= n; v++)
        for (int u = -n; u <= n; u++) {
            double b[2];
            rec_homography_map(w->inverse, w->u0 + u - shift[0], w->v0 + v - shift[1], b);
            w->t[(v + n) * side + u + n] =
                (float)(1 - rec_print_ink(w->p, b[0], b[1], w->hx, w->hy));
        }
}

static void corner_blur(struct window *w, double sigma)
{
    float k[2 * M_MAX + 1] = {0}, sum = 0, pass[SIDE * SIDE];
    int n = w->r + w->m, side = 2 * n + 1, m = (int)fmin(w->m - 1, ceil(2.7 * sigma));
    for (int i = -m; i <= m; i++)
        sum += k[i + m] = (float)exp(-0.5 * i * i / (sigma * sigma));
    for (int i = 0; i <= 2 * m; i++)
        k[i] /= sum;
    for (int v = 0; v < side; v++)
        for (int u = m; u < side - m; u++) {
            float s = 0;
            for (int i = -m; i <= m; i++)
                s += k[i + m] * w->t[v * side + u + i];
            pass[v * side + u] = s;
        }
    for (int v = m; v < side - m; v++)
        for (int u = m; u < side - m; u++) {
            float s = 0;
            for (int i = -m; i <= m; i++)
                s += k[i + m] * pass[(v + i) * side + u];
            w->blurred[v * side + u] = s;
        }
}

/* Which pixels count: near the corner on the board, inside the picture. */
static int corner_choose(struct window *w)
{
    int n = 0, side = 2 * w->r + 1;
    for (int v = -w->r; v <= w->r; v++)
        for (int u = -w->r; u <= w->r; u++) {
            double b[2];
            rec_homography_map(w->inverse, w->u0 + u, w->v0 + v, b);
            bool in = fabs(b[0] - w->xy[0]) <= w->reach && fabs(b[1] - w->xy[1]) <= w->reach &&
                      w->u0 + u >= 0 && w->v0 + v >= 0 && w->u0 + u < w->f->width &&
                      w->v0 + v < w->f->height;
            w->use[(v + w->r) * side + u + w->r] = in;
            n += in;
        }
    return n;
}

/* Solves the normal equations of (1), linear in (a d, a ds, a, b).  x [5]: solution; A: their factor. */
static bool corner_step(const struct window *w, double sigma, double A[25], double x[5],
                        double *rss, double *tss)
{
    int side = 2 * (w->r + w->m) + 1, use_side = 2 * w->r + 1, n = 0;
    double sum = 0, sq = 0, keep[5];
    memset(A, 0, 25 * sizeof *A);
    memset(x, 0, 5 * sizeof *x);
    for (int v = -w->r; v <= w->r; v++)
        for (int u = -w->r; u <= w->r; u++) {
            if (!w->use[(v + w->r) * use_side + u + w->r])
                continue;
            const float *t = &w->blurred[(v + w->r + w->m) * side + u + w->r + w->m];
            double I = w->f->level[(ptrdiff_t)(w->v0 + v) * w->f->width + w->u0 + u];
            double row[5] = {-(t[1] - t[-1]) / 2, -(t[side] - t[-side]) / 2,
                             sigma * (t[1] + t[-1] + t[side] + t[-side] - 4 * t[0]), t[0], 1};
            for (int i = 0; i < 5; i++) {
                for (int j = 0; j <= i; j++)
                    A[i * 5 + j] += row[i] * row[j];
                x[i] += row[i] * I;
            }
            sum += I;
            sq += I * I;
            n++;
        }
    memcpy(keep, x, sizeof keep);
    if (!rec_spd_solve(A, x, 5))
        return false;
    *rss = sq;
    for (int i = 0; i < 5; i++)
        *rss -= keep[i] * x[i];
    *tss = sq - sum * sum / n;
    return *tss > 0 && x[3] != 0;
}

static bool corner_prepare(struct window *w, const double h[9], const double uv[2])
{
    double duv[4], dxy[4], far, square = w->p->board.square;
    w->u0 = (int)lrint(uv[0]);
    w->v0 = (int)lrint(uv[1]);
    rec_homography_jacobian(h, w->xy[0], w->xy[1], duv);
    if (!rec_homography_inverse(h, w->inverse))
        return false;
    rec_homography_jacobian(w->inverse, uv[0], uv[1], dxy);
    w->hx = 0.5 * hypot(dxy[0], dxy[1]);
    w->hy = 0.5 * hypot(dxy[2], dxy[3]);
    w->reach = REACH * square;
    far = w->reach * fmax(fabs(duv[0]) + fabs(duv[1]), fabs(duv[2]) + fabs(duv[3]));
    w->r = (int)fmin(R_MAX, ceil(far));
    /* else the window is too small for an edge, or the map is folded there */
    return isfinite(far) && w->r >= 3 && duv[0] * duv[3] - duv[1] * duv[2] > 0;
}

bool rec_corner_refine(const struct rec_field *f, const struct rec_print *p, const double h[9],
                       const double xy[2], bool fine, struct rec_corner_fit *out)
{
    struct window w = {.f = f, .p = p, .xy = {xy[0], xy[1]}};
    double uv[2], shift[2] = {0}, A[25], x[5], rss, tss;
    double sigma = fmin(BLUR_1, fmax(BLUR_0, out->blur));
    rec_homography_map(h, xy[0], xy[1], uv);
    if (!(uv[0] >= 1 && uv[1] >= 1 && uv[0] <= f->width - 2 && uv[1] <= f->height - 2) ||
        !corner_prepare(&w, h, uv))
        return false;
    int n = corner_choose(&w), all = 0;
    for (int turn = 0; turn < 12; turn++) {
        w.m = (int)fmin(M_MAX, ceil(2.7 * sigma) + 2);
        corner_draw(&w, shift);
        corner_blur(&w, sigma);
        if (n < 25 || !corner_step(&w, sigma, A, x, &rss, &tss))
            return false;
        double d[2] = {x[0] / x[3], x[1] / x[3]}, ds = x[2] / x[3];
        double far = hypot(d[0], d[1]), cut = far > 1 ? 1 / far : 1;
        shift[0] += cut * d[0];
        shift[1] += cut * d[1];
        sigma = fmin(BLUR_1, fmax(BLUR_0, sigma + fmin(0.5, fmax(-0.5, ds))));
        all++;
        if (far < (fine ? 0.05 : 0.15) && fabs(ds) < (fine ? 0.1 : 0.3))
            break;
        if (hypot(shift[0], shift[1]) > w.r)
            return false;
        if (all == 12 && far > 0.2)
            return false;
    }
    double s2 = rss / (n - 5) / (x[3] * x[3]);
    double e0[5] = {1}, e1[5] = {0, 1}; /* columns of the inverse, from the factor */
    for (int c = 0; c < 2; c++) {
        double *e = c ? e1 : e0;
        for (int i = 0; i < 5; i++) {
            for (int k = 0; k < i; k++)
                e[i] -= A[i * 5 + k] * e[k];
            e[i] /= A[i * 5 + i];
        }
        for (int i = 4; i >= 0; i--) {
            for (int k = i + 1; k < 5; k++)
                e[i] -= A[k * 5 + i] * e[k];
            e[i] /= A[i * 5 + i];
        }
    }
    *out = (struct rec_corner_fit){
        .x = uv[0] + shift[0],
        .y = uv[1] + shift[1],
        .cov = {s2 * e0[0] + FLOOR * FLOOR, s2 * e0[1], s2 * e1[1] + FLOOR * FLOOR},
        .blur = sigma,
        .contrast = x[3],
        .likeness = sqrt(fmax(0, 1 - rss / tss)),
        .moved = hypot(shift[0], shift[1])};
    return true;
}
