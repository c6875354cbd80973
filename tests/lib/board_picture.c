#include "tests/lib/board_picture.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "base/random.h"
#include "recon/board/print.h"
#include "recon/board/spec.h"

static double extent[2], origin[2]; /* of the board being drawn */

static void measure(const struct rec_board *b)
{
    double pitch = b->kind == REC_APRILGRID ? b->square + b->marker : b->square;
    double first = b->kind == REC_APRILGRID ? b->marker : b->square;
    int32_t more = b->kind == REC_CHESSBOARD ? 1 : 0;
    origin[0] = origin[1] = -first;
    extent[0] = (b->cols + more) * pitch + (b->kind == REC_APRILGRID ? b->marker : 0);
    extent[1] = (b->rows + more) * pitch + (b->kind == REC_APRILGRID ? b->marker : 0);
}

void board_matmul(const double a[9], const double b[9], double o[9])
{
    for (int i = 0; i < 9; i++) {
        o[i] = 0;
        for (int k = 0; k < 3; k++)
            o[i] += a[i / 3 * 3 + k] * b[k * 3 + i % 3];
    }
}

struct board_shot board_shot_of(const struct rec_board *b, enum rec_board_face face, double square,
                                double tilt, double about, double roll)
{
    struct board_shot s = {.width = 640,
                           .height = 480,
                           .f = 600,
                           .cx = 321.3,
                           .cy = 238.6,
                           .dark = 0.1,
                           .light = 0.8,
                           .ground = 0.4,
                           .seed = 1};
    double d = M_PI / 180, ct = cos(tilt * d), st = sin(tilt * d), ca = cos(about * d),
           sa = sin(about * d), cr = cos(roll * d), sr = sin(roll * d);
    double back[9] = {face == REC_BACK ? -1 : 1, 0, 0, 0, 1, 0, 0, 0, face == REC_BACK ? -1 : 1};
    double in[9] = {ca, sa, 0, -sa, ca, 0, 0, 0, 1}, out[9] = {ca, -sa, 0, sa, ca, 0, 0, 0, 1};
    double turn[9] = {1, 0, 0, 0, ct, -st, 0, st, ct}, spin[9] = {cr, -sr, 0, sr, cr, 0, 0, 0, 1};
    double A[9], B[9];
    board_matmul(spin, back, A);
    board_matmul(in, A, B);
    board_matmul(turn, B, A);
    board_matmul(out, A, s.R);
    measure(b);
    double m[3] = {origin[0] + extent[0] / 2, origin[1] + extent[1] / 2, 0};
    for (int i = 0; i < 3; i++)
        s.t[i] = (i == 2 ? s.f * b->square / square : 0) -
                 (s.R[i * 3] * m[0] + s.R[i * 3 + 1] * m[1] + s.R[i * 3 + 2] * m[2]);
    return s;
}

static void eye(const struct board_shot *s, double c[3])
{
    for (int i = 0; i < 3; i++)
        c[i] = -(s->R[i] * s->t[0] + s->R[3 + i] * s->t[1] + s->R[6 + i] * s->t[2]);
}

enum rec_board_face board_face(const struct rec_board *b, const struct board_shot *s)
{
    double c[3];
    eye(s, c);
    return b->two_sided && c[2] > 0 ? REC_BACK : REC_FRONT;
}

/* How far the surface lies from its plane, at most in the middle. */
static double bend(const struct board_shot *s, double x, double y)
{
    double a = 2 * (x - origin[0]) / extent[0] - 1, c = 2 * (y - origin[1]) / extent[1] - 1;
    return -s->warp * (1 - (a * a + c * c) / 2);
}

/* Brown's model, normalised coordinates. */
static void distort(const double k[5], double x, double y, double out[2])
{
    double r = x * x + y * y, g = 1 + r * (k[0] + r * (k[1] + r * k[4]));
    out[0] = x * g + 2 * k[2] * x * y + k[3] * (r + 2 * x * x);
    out[1] = y * g + k[2] * (r + 2 * y * y) + 2 * k[3] * x * y;
}

/* Its inverse; J: derivative of the inverse. */
static void straighten(const double k[5], const double d[2], double xy[2], double J[4])
{
    xy[0] = d[0];
    xy[1] = d[1];
    for (int turn = 0; turn < 20; turn++) {
        double a[2], px[2], py[2], e = 1e-6;
        distort(k, xy[0], xy[1], a);
        distort(k, xy[0] + e, xy[1], px);
        distort(k, xy[0], xy[1] + e, py);
        double m[4] = {(px[0] - a[0]) / e, (py[0] - a[0]) / e, (px[1] - a[1]) / e,
                       (py[1] - a[1]) / e};
        double det = m[0] * m[3] - m[1] * m[2];
        J[0] = m[3] / det;
        J[1] = -m[1] / det;
        J[2] = -m[2] / det;
        J[3] = m[0] / det;
        double r[2] = {d[0] - a[0], d[1] - a[1]};
        xy[0] += J[0] * r[0] + J[1] * r[1];
        xy[1] += J[2] * r[0] + J[3] * r[1];
        if (hypot(r[0], r[1]) < 1e-12)
            break;
    }
}

bool board_truth(const struct rec_board *b, const struct board_shot *s, uint32_t id, double xy[2])
{
    double p[3], q[3], d[2];
    measure(b);
    rec_board_point(b, board_face(b, s), id, p);
    p[2] += bend(s, p[0], p[1]);
    for (int i = 0; i < 3; i++)
        q[i] = s->R[i * 3] * p[0] + s->R[i * 3 + 1] * p[1] + s->R[i * 3 + 2] * p[2] + s->t[i];
    distort(s->k, q[0] / q[2], q[1] / q[2], d);
    xy[0] = s->f * d[0] + s->cx;
    xy[1] = s->f * d[1] + s->cy;
    bool covered = xy[0] > s->cover[0] - 6 && xy[0] < s->cover[2] + 6 && xy[1] > s->cover[1] - 6 &&
                   xy[1] < s->cover[3] + 6 && s->cover[2] > s->cover[0];
    bool in =
        q[2] > 0 && xy[0] >= 3 && xy[1] >= 3 && xy[0] <= s->width - 4 && xy[1] <= s->height - 4;
    if (s->flipped)
        xy[0] = s->width - 1 - xy[0];
    return in && !covered;
}

/* bits of all markers, [markers][n][n] */
struct ink {
    const struct rec_board *b;
    uint8_t *bits;
    int n;
};

static bool marker_dark(const struct ink *k, int id, double x, double y) /* 0..1 across it */
{
    int w = (k->b->grid & REC_GRID_WIDE) != 0 ? 2 : 1;
    int c = (int)(x * (k->n + 2 * w)) - w, r = (int)(y * (k->n + 2 * w)) - w;
    if (c < 0 || r < 0 || c >= k->n || r >= k->n)
        return true;
    if ((k->b->grid & REC_GRID_TURNED) != 0) {
        c = k->n - 1 - c;
        r = k->n - 1 - r;
    }
    return k->bits[(id * k->n + r) * k->n + c] == 0;
}

/* Paper 0, ink 1, beyond the plate -1. */
static int printed(const struct ink *k, double X, double Y)
{
    const struct rec_board *b = k->b;
    double x = X - origin[0], y = Y - origin[1], rim = 0.4 * b->square;
    if (x < -rim || y < -rim || x > extent[0] + rim || y > extent[1] + rim)
        return -1;
    bool on = x >= 0 && y >= 0 && x < extent[0] && y < extent[1], dark = false;
    if (on && b->kind == REC_APRILGRID) {
        double pitch = b->square + b->marker;
        int c = (int)(x / pitch), r = (int)(y / pitch);
        double fx = x - c * pitch - b->marker, fy = y - r * pitch - b->marker;
        if (fx >= 0 && fy >= 0)
            dark =
                marker_dark(k, ((b->grid & REC_GRID_UP) != 0 ? b->rows - 1 - r : r) * b->cols + c,
                            fx / b->square, fy / b->square);
        else
            dark = fx < 0 && fy < 0;
    } else if (on) {
        int c = (int)(x / b->square), r = (int)(y / b->square);
        dark = (c + r) % 2 == (b->legacy ? 1 : 0);
        double fx = (x / b->square - c - 0.5) * b->square / b->marker + 0.5,
               fy = (y / b->square - r - 0.5) * b->square / b->marker + 0.5;
        if (!dark && b->kind == REC_CHARUCO && fx >= 0 && fy >= 0 && fx < 1 && fy < 1) {
            int whites = b->legacy ? (b->cols + 1) / 2 : b->cols / 2; /* of an even row */
            int before = r / 2 * b->cols + (r % 2 ? whites : 0);
            dark = marker_dark(k, before + c / 2, fx, fy);
        }
    }
    return dark != b->inverted;
}

/* The level that the ray (x, y, 1) of the camera meets. */
static double meet(const struct ink *k, const struct board_shot *s, const double c[3], double x,
                   double y)
{
    double d[3], X = 0, Y = 0;
    for (int i = 0; i < 3; i++)
        d[i] = s->R[i] * x + s->R[3 + i] * y + s->R[6 + i];
    bool back = c[2] > 0;
    double plane = back && !isnan(k->b->thickness) ? k->b->thickness : 0, z = plane;
    for (int turn = 0; turn < (s->warp != 0 ? 6 : 1); turn++) {
        double l = (z - c[2]) / d[2];
        if (!(l > 0))
            return s->ground;
        X = c[0] + l * d[0];
        Y = c[1] + l * d[1];
        z = plane + bend(s, X, Y);
    }
    int v = printed(k, X, Y);
    if (back && !k->b->two_sided && v >= 0)
        v = 0; /* bare */
    return v < 0 ? s->ground : v ? s->dark : s->light;
}

static void gauss(float *level, int w, int h, double sigma)
{
    int m = (int)ceil(4 * sigma);
    double *k = calloc((size_t)m + 1, sizeof *k), sum = 0;
    float *line = calloc((size_t)(w > h ? w : h), sizeof *line);
    for (int i = 0; i <= m; i++)
        sum += (i ? 2 : 1) * (k[i] = exp(-0.5 * i * i / (sigma * sigma)));
    for (int pass = 0; pass < 2; pass++) {
        int n = pass ? h : w, lines = pass ? w : h, by = pass ? w : 1;
        for (int j = 0; j < lines; j++) {
            float *a = level + (ptrdiff_t)j * (pass ? 1 : w);
            for (int i = 0; i < n; i++) {
                double v = 0;
                for (int q = -m; q <= m; q++) {
                    int at = i + q < 0 ? 0 : i + q >= n ? n - 1 : i + q;
                    v += k[abs(q)] * a[(ptrdiff_t)at * by];
                }
                line[i] = (float)(v / sum);
            }
            for (int i = 0; i < n; i++)
                a[(ptrdiff_t)i * by] = line[i];
        }
    }
    free(k);
    free(line);
}

static double pixel(const struct ink *k, const struct board_shot *s, const double c[3], int u,
                    int v)
{
    if (u >= s->cover[0] && u < s->cover[2] && v >= s->cover[1] && v < s->cover[3])
        return 0.5;
    int n = s->across > 0 ? s->across : 4;
    double at[2] = {(u - s->cx) / s->f, (v - s->cy) / s->f}, xy[2], J[4], sum = 0;
    straighten(s->k, at, xy, J);
    for (int i = 0; i < n * n; i++) { /* no two in one row or column: digits the other way round */
        double du = ((i + 0.5) / (n * n) - 0.5) / s->f,
               dv = ((i % n * n + i / n + 0.5) / (n * n) - 0.5) / s->f;
        sum += meet(k, s, c, xy[0] + J[0] * du + J[1] * dv, xy[1] + J[2] * du + J[3] * dv);
    }
    return sum / (n * n);
}

void board_picture(const struct rec_board *b, const struct board_shot *s, float *level)
{
    struct ink k = {.b = b};
    const struct rec_dictionary *dict = rec_dictionary_find(b->dictionary);
    const struct rec_cv *cv;
    char err[100];
    double c[3];
    if (dict != NULL && rec_cv_load(&cv, NULL) == PVX_OK) {
        int n = rec_board_markers(b);
        k.n = dict->bits;
        k.bits = calloc((size_t)n, (size_t)(k.n * k.n));
        for (int i = 0; i < n; i++)
            if (cv->bits(dict->index, i, k.bits + (size_t)(i * k.n * k.n), err, sizeof err) != 0)
                abort();
    }
    measure(b);
    eye(s, c);
    for (int v = 0; v < s->height; v++)
        for (int u = 0; u < s->width; u++)
            level[(ptrdiff_t)v * s->width + u] = (float)pixel(&k, s, c, u, v);
    if (s->blur > 0)
        gauss(level, s->width, s->height, s->blur);
    uint64_t state = s->seed * 0x9E3779B97F4A7C15u + 1;
    for (ptrdiff_t i = 0; s->noise > 0 && i < (ptrdiff_t)s->width * s->height; i++) {
        double r = (double)((pvx_random(&state) >> 11) + 1) * 0x1p-53,
               a = (double)(pvx_random(&state) >> 11) * 0x1p-53;
        level[i] += (float)(s->noise * sqrt(-2 * log(r)) * cos(2 * M_PI * a));
    }
    for (int v = 0; s->flipped && v < s->height; v++)
        for (int u = 0; u < s->width / 2; u++) {
            float *row = level + (ptrdiff_t)v * s->width, keep = row[u];
            row[u] = row[s->width - 1 - u];
            row[s->width - 1 - u] = keep;
        }
    free(k.bits);
}
