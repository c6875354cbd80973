/* lambda.c - the weight of the smoothness term, from the data.
 *
 * Bayes gives lambda = noise variance / variance of L x.  Neither is known.  The quantities that they depend on
 * are measured in the pictures, averaged 2x2 to reduce the noise:
 *     noise     N = (sigma^2 + 0.03 G1) / mean^2,  G1 = mean square of first differences: the
 *                   larger they are, the more the basis functions fail to follow the flame
 *     roughness R = G2 / mean^2, mean square of second differences, less what sigma adds
 *     chord     K = mean chord of a ray in voxels
 *     density   d = mean diagonal of A'WA / h^2, how often a voxel is measured
 *     lambda / mean diagonal = C N^n R^-r K^k d^-e                                         (1)
 * A channel that only a share of the rows measure has that share of the mean diagonal.  Where the noise of
 * light is known, sigma^2 in all that follows is the mean over a channel's rows, sigma^2 + shot mean b; the noise
 * in the dark parts of the pictures is less.
 * The exponents were fitted to the weight of least error in random cases (two kinds of flame,
 * 32..96 voxels a side, images 1.5..5 times as wide, 3..12 cameras, noise 0..20 %, both bases):
 * NUMERICS.md has the table.
 *
 * Calibration error and other effects that the model leaves out are not in sigma: a coarser solution then misses
 * b by more than N mean^2.  But it also does so if the flame is finer than its voxels, and then a firmer weight
 * is wrong.  The finer grid tells the two cases apart.  (1) begins raised by the misfit of the coarser grid, and
 * the model counts as at fault only if an iterate at that weight still has
 *     r'Wr > 25 m N mean^2,   m rows                                                       (2)
 * (real capture: 64 to 91; thin sheets and spirals: up to 10).  Otherwise (1) is only the initial weight, and an
 * iterate x gives the weight that Bayes asks for,
 *     E = [r'Wr / (m - g)] / [x'L V L x / g],  lambda / (1) = [1.5 E / (1)]^1.6,               (3)
 * within 0.02 .. 4 (mosaics: 1 .. 4, because the few rows of a channel can be fitted by structure that is not
 * there).  The weight is not lowered while r'Wr / (m - g) < 1.1 sigma^2: a solution as near to the pictures as
 * their noise allows needs no lighter weight.  g: the degrees of freedom that the data determine,
 * tr (A'WA + lambda L V L)^-1 A'WA on the n columns that are not held by their bound:
 *     g = G / (1 + G/m),  G = 0.048 n (lambda / mean diagonal)^(-1/2)                         (4)
 * so that r'Wr / (m - g) g = r'Wr / m G.
 * Reason for the power -1/2: a view determines the frequencies of one plane (the slice theorem), and
 * k'k'k'k' lambda = const bounds a disc in it, whose area goes with lambda^(-1/2).  The factor was fitted to g by
 * random probes, 200 systems from eight scenes, both bases, 4 to 8 cameras, lambda over five decades: within 14 %
 * (1 sigma).  A probe costs a lane, and a grey picture has none to spare.  E is MacKay's evidence (Neural Comput.
 * 4:415, 1992), which fits the pictures best.  The best volume is smoother than that where the flame is smooth
 * and less smooth where it is sharp, and a few iterations go only part of the way to the weight of E: hence the
 * power in (3). */
#include <math.h>
#include <string.h>

#include "recon/solve/card.h"

#define FROM_GRADIENT 0.03
#define NOISE_FLOOR   1e-9
#define SCALE         (-4.6) /* log C */
#define ON_NOISE      1.0
#define ON_ROUGHNESS  (-0.66)
#define ON_CHORD      2.06
#define ON_DENSITY    (-0.5)
#define LOWEST        1e-3
#define HIGHEST       100.0
#define MOST_MISFIT   1e3
#define UNKNOWN       0.3 /* when sigma is not known */

#define FAULT        25.0  /* (2) */
#define DOF          0.048 /* (4) */
#define EVIDENCE     1.5   /* (3) */
#define POWER        1.6
#define NEAR         1.1 /* sigma is known to some 5 % */
#define LEAST        0.02
#define LEAST_MOSAIC 1.0 /* a channel's few rows can be fitted by structure that is not there */
#define MOST         4.0

/* Mean of the 2x2 bins at `at`; false where one of them has no weight.  With weights per channel, of those
 * bins that measured a channel; false where one has none. */
REC_INLINE bool mean2x2(const struct rec_pictures *in, size_t at, size_t bw, size_t cs,
                        bool per_channel, rec_f4 *out)
{
    const size_t r[4] = {at, at + 1, at + bw, at + bw + 1};
    rec_f4 s = {0};
    if (per_channel) {
        rec_f4 weight = {0, 0, 0, 1};
        for (int i = 0; i < 4; i++) {
            rec_f4 w = rec_ld(in->w, r[i], 4);
            s += w * rec_ld(in->b, r[i], 4);
            weight += w;
            if (!rec_any(w > 0))
                return false;
        }
        *out = s / weight;
        return rec_all(weight > 0);
    }
    for (int i = 0; i < 4; i++) {
        if (in->w[r[i]] == 0)
            return false;
        s += rec_ld(in->b, r[i], cs);
    }
    *out = s * rec_splat(0.25f);
    return true;
}

/* Sums of squared first and second differences over the 2x2 blocks of A's rows; how many. */
REC_INLINE void measure(const rec_problem *pb, size_t k, size_t cs, bool per_channel,
                        double out[4][4])
{
    const struct rec_subsys *a = pb->a;
    const struct rec_pictures *in = &pb->in;
    size_t c = 0;
    rec_d4 first = {0}, second = {0};
    double blocks = 0;
    REC_FOR_ROWS (i, a, k) {
        if (!a->is_row[i])
            continue;
        while (i >= a->row0[c + 1])
            c++;
        size_t bw = (size_t)a->S->block[c].bw, bh = (size_t)a->S->block[c].bh;
        size_t r = i - a->row0[c], y = r / bw, x = r - y * bw;
        rec_f4 v, l, u, d, e;
        if (x % 2 != 0 || y % 2 != 0 || x < 2 || y < 2 || x + 3 >= bw || y + 3 >= bh ||
            !mean2x2(in, i, bw, cs, per_channel, &v) ||
            !mean2x2(in, i - 2, bw, cs, per_channel, &l) ||
            !mean2x2(in, i + 2, bw, cs, per_channel, &e) ||
            !mean2x2(in, i - 2 * bw, bw, cs, per_channel, &u) ||
            !mean2x2(in, i + 2 * bw, bw, cs, per_channel, &d))
            continue;
        rec_f4 lap = rec_splat(4) * v - l - e - u - d, dx = e - v, dy = d - v;
        rec_add_product(&first, dx, dx);
        rec_add_product(&first, dy, dy);
        rec_add_product(&second, lap, lap);
        blocks++;
    }
    rec_put(out[0], &first);
    rec_put(out[1], &second);
    out[2][0] = blocks;
}

static void measure_chunk(void *ctx, size_t k)
{
    rec_problem *pb = ctx;
    pb->in.per_channel ? measure(pb, k, 4, true, pb->part[k])
    : pb->cs == 4      ? measure(pb, k, 4, false, pb->part[k])
                       : measure(pb, k, 1, false, pb->part[k]);
}

/* Sums of `measure` over all of A's rows. */
static void differences(rec_problem *pb, double first[4], double second[4], double *blocks)
{
    const struct rec_card_ops *card = rec_card_of(pb->a);
    size_t chunks = rec_row_chunks(pb);
    double count[4];
    if (card != NULL) {
        card->differences(pb, first, second, blocks);
        return;
    }
    pvx_pool_run(pb->a->pool, chunks, measure_chunk, pb);
    rec_sum(pb, 0, chunks, 0, first);
    rec_sum(pb, 0, chunks, 1, second);
    rec_sum(pb, 0, chunks, 2, count);
    *blocks = count[0];
}

/* (1) for every lane; chord: the sum over rays, in metres. */
static void automatic(rec_problem *pb, double mean_diag, double chord)
{
    const struct rec_grid *g = &pb->a->S->grid;
    double first[4], second[4], count, rows = pb->a->rows;
    double h = cbrt(rec_grid_h(g, 0) * rec_grid_h(g, 1) * rec_grid_h(g, 2));
    double voxels = chord / rows / h;
    differences(pb, first, second, &count);
    for (int l = 0; l < 4; l++) {
        double rel = UNKNOWN, sigma = pb->in.sigma[l], density = pb->share[l] * mean_diag / (h * h);
        double mean = pb->light[l] / (pb->share[l] * rows);
        pb->shot2[l] = sigma >= 0 && mean > 0 ? pb->in.shot[l] * mean : 0;
        double s2 = sigma * sigma + pb->shot2[l];
        double in_mean = s2 / fmin(pb->share[l], 1); /* four times the variance of a mean of 2x2 */
        if (sigma >= 0 && mean > 0 && count > 0) {
            /* the mean of 2x2 has noise sigma/2, one difference twice its variance, (4v-...) 20
             * times; a block is two bins wide */
            double g1 = fmax(first[l] / count - in_mean, 0) / 4;
            double g2 = fmax(second[l] / count - 5 * in_mean, 1e-3 * second[l] / count) / 16;
            double noise = fmax((s2 + FROM_GRADIENT * g1) / (mean * mean), NOISE_FLOOR);
            double rough = fmax(g2 / (mean * mean), NOISE_FLOOR);
            pb->noise2[l] = s2 + FROM_GRADIENT * g1;
            rel = exp(SCALE + ON_NOISE * log(noise) + ON_ROUGHNESS * log(rough) +
                      ON_CHORD * log(voxels) + ON_DENSITY * log(density));
            rel = rel < LOWEST ? LOWEST : rel < HIGHEST ? rel : HIGHEST; /* NaN: the highest */
        }
        pb->lambda[l] = pb->unit[l] * rel;
    }
}

/* pb->diag; its mean over the columns, and the sum of w A's entries. */
static void diagonal(rec_problem *pb, double *mean, double *chord)
{
    const struct rec_subsys *a = pb->a;
    const struct rec_card_ops *card = rec_card_of(a);
    *mean = (pb->whole ? a->sum2 : pb->diagonal) / a->n;
    *chord = pb->whole ? a->sum : pb->chord;
    pb->diag = pb->whole && card == NULL ? a->norm2 : pb->column;
    if (!pb->whole && card == NULL) {
        rec_column_norms(a, pb->w, pb->column, pb->xv[0]);
        *mean = *chord = 0;
        for (int32_t q = 0; q < a->n; q++) {
            *mean += pb->column[q] / a->n;
            *chord += pb->xv[0][q];
        }
    }
    for (int l = 0; l < 4; l++)
        pb->unit[l] = pb->share[l] * *mean;
}

void rec_problem_weigh(rec_problem *pb, float lambda)
{
    double mean, chord;
    if (pb->weighed || !pb->any)
        return;
    pb->weighed = true;
    memset(pb->noise2, 0, sizeof pb->noise2);
    memset(pb->shot2, 0, sizeof pb->shot2);
    diagonal(pb, &mean, &chord);
    pb->automatic = lambda < 0;
    if (pb->automatic)
        automatic(pb, mean, chord);
    else
        for (int l = 0; l < 4; l++)
            pb->lambda[l] = pb->unit[l] * (double)lambda;
    memcpy(pb->formula, pb->lambda, sizeof pb->formula);
}

void rec_problem_weigh_as(rec_problem *pb, const rec_problem *other, double by)
{
    double mean, chord;
    if (!pb->any)
        return;
    pb->weighed = true;
    memset(pb->noise2, 0, sizeof pb->noise2);
    memset(pb->shot2, 0, sizeof pb->shot2);
    diagonal(pb, &mean, &chord);
    pb->automatic = other->automatic;
    for (int l = 0; l < 4; l++)
        pb->formula[l] = pb->lambda[l] = other->formula[l] / by;
}

void rec_problem_misfit(rec_problem *pb, const double misfit2[4])
{
    for (int l = 0; l < 4; l++)
        if (pb->noise2[l] > 0 && misfit2[l] > pb->noise2[l])
            pb->lambda[l] = pb->formula[l] * fmin(misfit2[l] / pb->noise2[l], MOST_MISFIT);
}

double rec_problem_freedom(const rec_problem *pb, int l, double lit, double lambda)
{
    double rows = rec_rows_of(pb, l), dof = DOF * lit / sqrt(lambda / pb->unit[l]); /* G */
    return dof / (1 + dof / rows);
}

void rec_problem_reweigh(const rec_problem *pb, const double rwr[4], const double penalty[4],
                         const double lit[4], double lambda[4])
{
    for (int l = 0; l < pb->nch && pb->automatic; l++) {
        double sigma = fmax(pb->in.sigma[l], 0), rows = rec_rows_of(pb, l),
               least = pb->in.per_channel ? LEAST_MOSAIC : LEAST;
        if (pb->noise2[l] > 0 && rwr[l] > FAULT * rows * pb->noise2[l])
            continue;
        double dof = DOF * lit[l] / sqrt(lambda[l] / pb->unit[l]); /* G */
        double noise2 = rwr[l] / (rows - dof / (1 + dof / rows));
        double asked = (rwr[l] / rows) / (penalty[l] / dof) / pb->formula[l];
        double next = pb->formula[l] * fmin(fmax(pow(EVIDENCE * asked, POWER), least), MOST);
        if (isfinite(asked) &&
            (next > lambda[l] || noise2 >= NEAR * sigma * sigma + NEAR * pb->shot2[l]))
            lambda[l] = next; /* not finite: nothing burns, or nothing was measured */
    }
}
