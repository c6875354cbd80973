#include "recon/board/match.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/median.h"
#include "base/mem.h"
#include "recon/board/spec.h"

#define MARKERS 1024 /* markers that are used, at most */
#define PAIRS   400
#define NEAR    0.7 /* of a marker's side: largest distance of a corner from its place by the map */

double rec_marker_side(const struct rec_cv_marker *m)
{
    double area = (m->xy[2][0] - m->xy[0][0]) * (m->xy[3][1] - m->xy[1][1]) -
                  (m->xy[2][1] - m->xy[0][1]) * (m->xy[3][0] - m->xy[1][0]);
    return sqrt(fabs(area) / 2);
}

static bool on_board(const struct rec_print *p, const struct rec_cv_marker *m)
{
    return m->id >= 0 && m->id < p->n_markers;
}

size_t rec_match_pairs(const struct rec_print *p, const struct rec_cv_marker *m,
                       struct rec_pair *pair)
{
    double xy[4][2];
    int turn = (p->board.grid & REC_GRID_TURNED) != 0 ? 2 : 0;
    rec_print_marker(p, m->id, xy);
    for (int c = 0; c < 4; c++) {
        const double *at = xy[(c + turn) % 4];
        pair[c] = (struct rec_pair){at[0], at[1], m->xy[c][0], m->xy[c][1], 1};
    }
    return 4;
}

/* Mean square distance of the marker's corners from their places by h; INFINITY beyond reach. */
static double match_distance(const struct rec_print *p, const struct rec_cv_marker *m,
                             const double h[9])
{
    struct rec_pair pair[4];
    double uv[2], sum = 0, limit = NEAR * rec_marker_side(m);
    rec_match_pairs(p, m, pair);
    for (int c = 0; c < 4; c++) {
        rec_homography_map(h, pair[c].x, pair[c].y, uv);
        double d = hypot(uv[0] - pair[c].u, uv[1] - pair[c].v);
        if (!(d <= limit))
            return INFINITY;
        sum += d * d / 4;
    }
    return sum;
}

static size_t match_count(const struct rec_print *p, const struct rec_cv_marker *m, size_t n,
                          const double h[9], double *sum, bool *agrees)
{
    size_t k = 0;
    *sum = 0;
    for (size_t i = 0; i < n; i++) {
        double d = on_board(p, &m[i]) ? match_distance(p, &m[i], h) : INFINITY;
        bool yes = d < INFINITY;
        if (agrees != NULL)
            agrees[i] = yes;
        if (yes) {
            k++;
            *sum += d;
        }
    }
    return k;
}

/* The map from the markers in `in`; false: they do not give one. */
static bool match_fit(const struct rec_print *p, const struct rec_cv_marker *m, size_t n,
                      const bool *which, double h[9])
{
    struct rec_pair *pair = pvx_calloc(4 * n, sizeof *pair);
    size_t k = 0;
    for (size_t i = 0; pair != NULL && i < n; i++)
        if (which[i])
            k += rec_match_pairs(p, &m[i], pair + k);
    bool ok = pair != NULL && rec_homography_fit(pair, k, h);
    free(pair);
    return ok;
}

void rec_match(const struct rec_print *p, const struct rec_cv_marker *m, size_t n,
               struct rec_match *out, bool *agrees)
{
    bool in[MARKERS], now[MARKERS];
    double best = INFINITY, sum, h[9];
    *out = (struct rec_match){0};
    n = n < MARKERS ? n : MARKERS;
    memset(in, 0, sizeof in);
    size_t stride = n * n / 2 / PAIRS + 1, at = 0;
    for (size_t i = 0; i < n; i++)
        for (size_t j = i; j < n; j++) {
            struct rec_pair pair[8];
            if ((i == j && n > 1) || !on_board(p, &m[i]) || !on_board(p, &m[j]) ||
                m[i].id == m[j].id * (n > 1 ? 1 : -1) || at++ % stride != 0)
                continue;
            size_t k = rec_match_pairs(p, &m[i], pair);
            if (i != j)
                k += rec_match_pairs(p, &m[j], pair + k);
            if (!rec_homography_fit(pair, k, h))
                continue;
            size_t c = match_count(p, m, n, h, &sum, now);
            if (c > out->agreeing || (c == out->agreeing && c > 0 && sum < best)) {
                out->agreeing = c;
                best = sum;
                memcpy(out->h, h, sizeof h);
                memcpy(in, now, n * sizeof *in);
            }
        }
    /* a map from all that agree is better than one from two, and then more may agree */
    for (int turn = 0; turn < 4 && out->agreeing > 1; turn++) {
        if (!match_fit(p, m, n, in, h))
            break;
        size_t c = match_count(p, m, n, h, &sum, now);
        if (c < out->agreeing || (c == out->agreeing && !(sum < best)))
            break;
        out->agreeing = c;
        best = sum;
        memcpy(out->h, h, sizeof h);
        memcpy(in, now, n * sizeof *in);
    }
    out->error = out->agreeing > 0 ? sqrt(best / (double)out->agreeing) : 0;
    if (agrees != NULL)
        memcpy(agrees, in, n * sizeof *in);
}

/* rms px between the markers that agree and a map fitted to them, if markers had `ratio` times their side. */
static double match_misfit(const struct rec_print *p, const struct rec_cv_marker *m, size_t n,
                           const bool *agrees, double ratio)
{
    struct rec_pair *pair = pvx_calloc(4 * n, sizeof *pair);
    double h[9], uv[2], sum = 0;
    size_t k = 0;
    for (size_t i = 0; pair != NULL && i < n; i++) {
        if (!agrees[i])
            continue;
        struct rec_pair *c = pair + k;
        k += rec_match_pairs(p, &m[i], c);
        double middle[2] = {(c[0].x + c[2].x) / 2, (c[0].y + c[2].y) / 2};
        for (int q = 0; q < 4; q++) {
            c[q].x = middle[0] + ratio * (c[q].x - middle[0]);
            c[q].y = middle[1] + ratio * (c[q].y - middle[1]);
        }
    }
    bool ok = pair != NULL && rec_homography_fit(pair, k, h);
    for (size_t i = 0; ok && i < k; i++) {
        rec_homography_map(h, pair[i].x, pair[i].y, uv);
        sum +=
            (uv[0] - pair[i].u) * (uv[0] - pair[i].u) + (uv[1] - pair[i].v) * (uv[1] - pair[i].v);
    }
    free(pair);
    return ok ? sqrt(sum / (double)k) : INFINITY;
}

/* Sizes are compared with a map that was made from the markers' middles alone.  Middles that lie nearly in a row give
 * no such map, so the ratio must also fit better than 1 does. */
double rec_match_ratio(const struct rec_print *p, const struct rec_cv_marker *m, size_t n,
                       const bool *agrees)
{
    double ratio[MARKERS], h[9], inverse[9];
    struct rec_pair pair[MARKERS];
    size_t k = 0;
    n = n < MARKERS ? n : MARKERS;
    for (size_t i = 0; i < n; i++) {
        struct rec_pair c[4];
        if (!agrees[i])
            continue;
        rec_match_pairs(p, &m[i], c);
        /* the diagonals cross at the image of the middle, for any size */
        double x[2] = {c[2].u - c[0].u, c[2].v - c[0].v}, y[2] = {c[3].u - c[1].u, c[3].v - c[1].v};
        double s =
            ((c[1].u - c[0].u) * y[1] - (c[1].v - c[0].v) * y[0]) / (x[0] * y[1] - x[1] * y[0]);
        pair[k++] = (struct rec_pair){(c[0].x + c[2].x) / 2, (c[0].y + c[2].y) / 2,
                                      c[0].u + s * x[0], c[0].v + s * x[1], 1};
    }
    if (k < 6 || !rec_homography_fit(pair, k, h) || !rec_homography_inverse(h, inverse))
        return NAN;
    k = 0;
    for (size_t i = 0; i < n; i++) {
        double b[4][2], t[4][2], have = 0, want = 0;
        if (!agrees[i])
            continue;
        rec_print_marker(p, m[i].id, t);
        for (int c = 0; c < 4; c++)
            rec_homography_map(inverse, m[i].xy[c][0], m[i].xy[c][1], b[c]);
        for (int c = 0; c < 4; c++) {
            int e = (c + 1) % 4;
            have += hypot(b[c][0] - b[e][0], b[c][1] - b[e][1]);
            want += hypot(t[c][0] - t[e][0], t[c][1] - t[e][1]);
        }
        ratio[k++] = have / want;
    }
    qsort(ratio, k, sizeof *ratio, pvx_ascending);
    bool better = match_misfit(p, m, n, agrees, ratio[k / 2]) < match_misfit(p, m, n, agrees, 1);
    return better ? ratio[k / 2] : 1;
}

bool rec_match_other(const struct rec_print *p, const struct rec_cv_marker *m, size_t n,
                     size_t agreeing, int32_t *cols, int32_t *rows)
{
    int32_t last = 0;
    size_t most = agreeing + 2;
    bool found = false;
    for (size_t i = 0; i < n; i++)
        last = m[i].id > last ? m[i].id : last;
    if (n < 5)
        return false;
    for (int32_t c = 3; c <= 40; c++)
        for (int legacy = 0; legacy < (p->board.kind == REC_CHARUCO ? 2 : 1); legacy++) {
            struct rec_board b = p->board;
            struct rec_print other;
            struct rec_match match;
            b.cols = c;
            b.legacy = legacy != 0;
            b.rows = (p->board.kind == REC_CHARUCO ? 2 : 1) * (last / c + 1);
            if (b.rows > REC_BOARD_MAX || rec_print_init(&other, &b, NULL) != PVX_OK)
                continue;
            rec_match(&other, m, n, &match, NULL);
            if (match.agreeing > most) {
                most = match.agreeing;
                *cols = c;
                *rows = (b.grid & REC_GRID_UP) != 0 ? b.rows : other.cell[last] / c + 1;
                found = true;
            }
            rec_print_fini(&other);
        }
    return found && most * 10 >= n * 8;
}
