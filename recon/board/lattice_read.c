/* lattice_read.c - finds which corners of a board the nodes of a lattice are. */
#include <math.h>
#include <stdlib.h>

#include "base/mem.h"
#include "recon/board/homography.h"
#include "recon/board/lattice.h"

#define BITS 8 /* across a marker, at most */

/* A square of the lattice between four nodes: the levels at the places of a marker's bits. */
struct inside {
    int i, j;                /* of its first node */
    double bit[BITS * BITS]; /* mean 0, sum of squares 1 where there is contrast */
};

static double lattice_read_at(const struct rec_field *f, double x, double y)
{
    int32_t w = f->width, u = (int32_t)floor(x), v = (int32_t)floor(y);
    if (!(x >= 0 && y >= 0) || u + 1 >= w || v + 1 >= f->height)
        return 0;
    const float *p = f->level + (ptrdiff_t)v * w + u;
    double a = x - u, b = y - v;
    return (1 - b) * ((1 - a) * p[0] + a * p[1]) + b * ((1 - a) * p[w] + a * p[w + 1]);
}

/* Levels at the places of a marker's bits, in the middle of the unit square that h maps. */
static void look_inside(const struct rec_field *f, const struct rec_print *p, const double h[9],
                        double contrast, double bit[BITS * BITS])
{
    int n = p->bits;
    double sum = 0, sq = 0, s0 = p->module / p->board.square, uv[2];
    for (int k = 0; k < n * n; k++) {
        rec_homography_map(h, 0.5 + s0 * (k % n + 0.5 - n / 2.0),
                           0.5 + s0 * (k / n + 0.5 - n / 2.0), uv);
        bit[k] = lattice_read_at(f, uv[0], uv[1]);
        sum += bit[k];
    }
    for (int k = 0; k < n * n; k++) {
        bit[k] -= sum / (n * n);
        sq += bit[k] * bit[k];
    }
    /* a square of one colour is not a marker, whatever its noise looks like */
    double scale = 1 / fmax(sqrt(sq), 0.05 * contrast * n);
    for (int k = 0; k < n * n; k++)
        bit[k] *= scale;
}

static const struct rec_node *node_at(const struct rec_node *node, size_t n, int i, int j)
{
    for (size_t k = 0; k < n; k++)
        if (node[k].i == i && node[k].j == j)
            return &node[k];
    return NULL;
}

/* Board square of lattice square (i, j), turned by k quarters, before it is shifted. */
static void board_turned(int k, int i, int j, int out[2])
{
    int x[4] = {i, -j - 1, -i - 1, j}, y[4] = {j, i, -j - 1, -i - 1};
    out[0] = x[k];
    out[1] = y[k];
}

/* Correlation of a square's inside with marker `id`, with the lattice turned by k quarters on the board. */
static double alike(const struct rec_print *p, const double *seen, int32_t id, int k)
{
    int n = p->bits, white = 0;
    const uint8_t *bit = p->bit + (size_t)(id * n * n);
    double sum = 0;
    for (int q = 0; q < n * n; q++)
        white += bit[q];
    for (int q = 0; q < n * n; q++) {
        int i = q % n, j = q / n, x[4] = {i, n - 1 - j, n - 1 - i, j},
            y[4] = {j, i, n - 1 - j, n - 1 - i};
        sum += seen[q] * bit[y[k] * n + x[k]];
    }
    /* normalises the printed bits to mean 0 and sum of squares 1 */
    return sum / sqrt(fmax(1e-9, white - (double)white * white / (n * n)));
}

struct place {
    int turn, x, y;
    double score;
};

/* Sum of the correlations of all squares, with the lattice at one place. */
static double lattice_read_judge(const struct rec_print *p, const struct inside *s, size_t n,
                                 struct place at)
{
    double sum = 0;
    for (size_t k = 0; k < n; k++) {
        int c[2];
        board_turned(at.turn, s[k].i, s[k].j, c);
        c[0] += at.x;
        c[1] += at.y;
        if (c[0] < 0 || c[1] < 0 || c[0] >= p->board.cols || c[1] >= p->board.rows)
            continue;
        int32_t id = p->id_at[c[1] * p->board.cols + c[0]];
        if (id >= 0)
            sum += alike(p, s[k].bit, id, at.turn);
    }
    return sum;
}

static size_t squares(const struct rec_field *f, const struct rec_print *p,
                      const struct rec_node *node, size_t n, struct inside *s)
{
    size_t m = 0;
    double low = INFINITY, high = -INFINITY;
    for (size_t k = 0; k < n; k++)
        for (int q = 0; q < 25; q++) {
            double v = lattice_read_at(f, node[k].x + q % 5 - 2, node[k].y + q / 5 - 2);
            low = fmin(low, v);
            high = fmax(high, v);
        }
    for (size_t k = 0; k < n; k++) {
        const struct rec_node *a = &node[k], *c[4] = {a, node_at(node, n, a->i + 1, a->j),
                                                      node_at(node, n, a->i + 1, a->j + 1),
                                                      node_at(node, n, a->i, a->j + 1)};
        if (c[1] == NULL || c[2] == NULL || c[3] == NULL)
            continue;
        double h[9];
        struct rec_pair pair[4];
        for (int q = 0; q < 4; q++)
            pair[q] = (struct rec_pair){q == 1 || q == 2, q >= 2, c[q]->x, c[q]->y, 1};
        if (!rec_homography_fit(pair, 4, h))
            continue;
        s[m] = (struct inside){.i = a->i, .j = a->j};
        look_inside(f, p, h, high - low, s[m++].bit);
    }
    return m;
}

double rec_lattice_read(const struct rec_field *f, const struct rec_print *p,
                        const struct rec_node *node, size_t n, int32_t *id)
{
    struct inside *s = pvx_calloc(n, sizeof *s);
    struct place best = {.score = 0}, second = {.score = 0};
    const struct rec_board *b = &p->board;
    size_t m = s != NULL && p->bits <= BITS ? squares(f, p, node, n, s) : 0;
    for (int k = 0; k < 4 && m > 0; k++) {
        int lo[2] = {1 << 20, 1 << 20}, hi[2] = {-(1 << 20), -(1 << 20)};
        for (size_t q = 0; q < m; q++) {
            int c[2];
            board_turned(k, s[q].i, s[q].j, c);
            for (int a = 0; a < 2; a++) {
                lo[a] = c[a] < lo[a] ? c[a] : lo[a];
                hi[a] = c[a] > hi[a] ? c[a] : hi[a];
            }
        }
        /* squares of the lattice lie between the board's outer ones; a stray node may lie outside */
        for (int y = -1 - lo[1]; y <= b->rows - hi[1]; y++)
            for (int x = -1 - lo[0]; x <= b->cols - hi[0]; x++) {
                struct place now = {k, x, y, 0};
                now.score = lattice_read_judge(p, s, m, now);
                if (now.score > best.score) {
                    second = best;
                    best = now;
                } else if (now.score > second.score) {
                    second = now;
                }
            }
    }
    free(s);
    for (size_t k = 0; k < n; k++) {
        /* a node is the first corner of its square: turn the square, then take the corner that it became */
        int q[4][2] = {{0, 0}, {-1, 0}, {-1, -1}, {0, -1}}, c[2];
        board_turned(best.turn, node[k].i, node[k].j, c);
        int x = c[0] + best.x - q[best.turn][0], y = c[1] + best.y - q[best.turn][1];
        bool on = x >= 1 && y >= 1 && x < b->cols && y < b->rows;
        id[k] = on ? (y - 1) * (b->cols - 1) + x - 1 : -1;
    }
    bool clear =
        best.score > 1.2 && best.score > 0.15 * (double)m && best.score > 1.4 * second.score;
    return clear ? best.score : 0;
}

double rec_print_likeness(const struct rec_field *f, const struct rec_print *p, double contrast,
                          const struct rec_pair *corner, size_t n)
{
    double sum = 0, near = 0.01 * p->pitch, out = p->board.kind == REC_CHARUCO ? p->in : 0,
           whole = p->board.square;
    size_t m = 0;
    for (int32_t id = 0; id < p->n_markers; id++) {
        double c[4][2], h[9], bit[BITS * BITS];
        struct rec_pair pair[4];
        size_t k = 0;
        rec_print_marker(p, id, c);
        /* the corners around it, as those of the unit square */
        for (size_t i = 0; i < n && k < 4; i++) {
            double x = corner[i].x - c[0][0] + out, y = corner[i].y - c[0][1] + out;
            if ((fabs(x) < near || fabs(x - whole) < near) &&
                (fabs(y) < near || fabs(y - whole) < near))
                pair[k++] = (struct rec_pair){x / whole, y / whole, corner[i].u, corner[i].v, 1};
        }
        if (k < 4 || p->bits > BITS || !rec_homography_fit(pair, 4, h))
            continue;
        look_inside(f, p, h, contrast, bit);
        sum += alike(p, bit, id, 0);
        m++;
    }
    return m > 0 ? sum / (double)m : NAN;
}
