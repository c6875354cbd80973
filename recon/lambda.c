/* The weight of the smoothness term, from the data.
 *
 * Bayes gives lambda = noise variance / variance of L x.  Neither is known; what they hang on is
 * measured in the pictures, averaged 2x2 so that noise hurts less:
 *     noise     N = (sigma^2 + 0.03 G1) / mean^2,  G1 = mean square of first differences: the
 *                   larger they are, the more the basis functions fail to follow the flame
 *     roughness R = G2 / mean^2, mean square of second differences, less what sigma adds
 *     chord     K = mean chord of a ray in voxels
 *     density   d = mean diagonal of A'WA / h^2, how often a voxel is measured
 *     lambda / mean diagonal = C N^n R^-r K^k d^-e                                         (1)
 * A channel that only a share of the rows measure (lanes) has that share of the mean diagonal.
 * The exponents were fitted to the weight of least error in random cases (two kinds of flame,
 * 32..96 voxels a side, images 1.5..5 times as wide, 3..12 cameras, noise 0..20 %, both bases):
 * NUMERICS.md has the table. */
#include <math.h>
#include <string.h>

#include "recon/simd/lanes.h"
#include "recon/solve_impl.h"

#define FROM_GRADIENT 0.03
#define NOISE_FLOOR   1e-9
#define SCALE         -4.6 /* log C */
#define ON_NOISE      1.0
#define ON_ROUGHNESS  -0.66
#define ON_CHORD      2.06
#define ON_DENSITY    -0.5
#define LOWEST        1e-3
#define HIGHEST       100.0
#define MOST_MISFIT   1e3
#define ON_MISFIT     0.75 /* part of what the coarser grid misses is its coarseness */
#define UNKNOWN       0.3  /* when sigma is not known */

/* Mean of the 2x2 bins at `at`; false where one of them has no weight.  With lanes, of those bins that
 * measured a channel; false where one has none. */
REC_INLINE bool mean2x2(const struct rec_job *j, size_t at, size_t bw, size_t cs, bool lanes,
                        rec_f4 *out)
{
    const size_t r[4] = {at, at + 1, at + bw, at + bw + 1};
    rec_f4 s = {0};
    if (lanes) {
        rec_f4 weight = {0, 0, 0, 1};
        for (int i = 0; i < 4; i++) {
            rec_f4 w = rec_ld(j->image_weight, r[i], 4);
            s += w * rec_ld(j->image, r[i], 4);
            weight += w;
            if (!rec_any(w > 0))
                return false;
        }
        *out = s / weight;
        return rec_all(weight > 0);
    }
    for (int i = 0; i < 4; i++) {
        if (j->image_weight[r[i]] == 0)
            return false;
        s += rec_ld(j->image, r[i], cs);
    }
    *out = s * rec_splat(0.25f);
    return true;
}

/* Sums of squared first and second differences over the 2x2 blocks of A's rows; how many. */
REC_INLINE void measure(const struct rec_job *j, size_t k, size_t cs, bool lanes, double out[4][4])
{
    const struct rec_subsys *a = j->a;
    int32_t i0, i1;
    size_t c = 0;
    rec_d4 first = {0}, second = {0};
    double blocks = 0;
    rec_chunk_range(a->rows, k, &i0, &i1);
    for (int32_t i = i0; i < i1; i++) {
        while (a->ray[i] >= a->row0[c + 1])
            c++;
        size_t bw = (size_t)a->S->block[c].bw, bh = (size_t)a->S->block[c].bh;
        size_t r = a->ray[i] - a->row0[c], y = r / bw, x = r - y * bw;
        rec_f4 v, l, u, d, e;
        if (x % 2 != 0 || y % 2 != 0 || x < 2 || y < 2 || x + 3 >= bw || y + 3 >= bh ||
            !mean2x2(j, a->ray[i], bw, cs, lanes, &v) ||
            !mean2x2(j, a->ray[i] - 2, bw, cs, lanes, &l) ||
            !mean2x2(j, a->ray[i] + 2, bw, cs, lanes, &e) ||
            !mean2x2(j, a->ray[i] - 2 * bw, bw, cs, lanes, &u) ||
            !mean2x2(j, a->ray[i] + 2 * bw, bw, cs, lanes, &d))
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
    const struct rec_job *j = ctx;
    j->w4 != NULL   ? measure(j, k, 4, true, j->s->part[k])
    : j->a->cs == 4 ? measure(j, k, 4, false, j->s->part[k])
                    : measure(j, k, 1, false, j->s->part[k]);
}

static void automatic(const struct rec_job *j, double mean_diag, double chord, double lambda[4],
                      double noise2[4])
{
    const struct rec_grid *g = &j->a->S->grid;
    size_t chunks = rec_job_row_chunks(j);
    double first[4], second[4], count[4], rows = j->a->rows;
    double h = cbrt(rec_grid_h(g, 0) * rec_grid_h(g, 1) * rec_grid_h(g, 2));
    double voxels = chord / rows / h, s2 = j->sigma * j->sigma;
    pvx_pool_run(j->a->pool, chunks, measure_chunk, (void *)j);
    rec_job_sum(j, 0, chunks, 0, first);
    rec_job_sum(j, 0, chunks, 1, second);
    rec_job_sum(j, 0, chunks, 2, count);
    for (int l = 0; l < 4; l++) {
        double rel = UNKNOWN, density = j->share[l] * mean_diag / (h * h);
        double mean = j->light[l] / (j->share[l] * rows);
        double in_mean = s2 / fmin(j->share[l], 1); /* four times the variance of a mean of 2x2 */
        if (j->sigma >= 0 && mean > 0 && count[0] > 0) {
            /* the mean of 2x2 has noise sigma/2, one difference twice its variance, (4v-...) 20
             * times; a block is two bins wide */
            double g1 = fmax(first[l] / count[0] - in_mean, 0) / 4;
            double g2 = fmax(second[l] / count[0] - 5 * in_mean, 1e-3 * second[l] / count[0]) / 16;
            double noise = fmax((s2 + FROM_GRADIENT * g1) / (mean * mean), NOISE_FLOOR);
            double rough = fmax(g2 / (mean * mean), NOISE_FLOOR);
            noise2[l] = s2 + FROM_GRADIENT * g1;
            rel = exp(SCALE + ON_NOISE * log(noise) + ON_ROUGHNESS * log(rough) +
                      ON_CHORD * log(voxels) + ON_DENSITY * log(density));
            rel = rel < LOWEST ? LOWEST : rel < HIGHEST ? rel : HIGHEST; /* NaN: the highest */
        }
        lambda[l] = j->share[l] * mean_diag * rel;
    }
}

void rec_solve_weight_for_misfit(const double noise2[4], const double misfit2[4], double weight[4])
{
    for (int l = 0; l < 4; l++)
        if (noise2[l] > 0 && misfit2[l] > noise2[l])
            weight[l] *= fmin(pow(misfit2[l] / noise2[l], ON_MISFIT), MOST_MISFIT);
}

void rec_job_lambda(struct rec_job *j, double lambda[4], double noise2[4])
{
    rec_solver *s = j->s;
    const struct rec_subsys *a = j->a;
    double mean = a->sum2 / a->n, chord = a->sum;
    j->diag = j->whole ? a->norm2 : s->diag;
    if (!j->whole && !j->have_diag) {
        rec_column_norms(a, j->w, s->diag, s->xv[0]);
        mean = chord = 0;
        for (int32_t q = 0; q < a->n; q++) {
            mean += s->diag[q] / a->n;
            chord += s->xv[0][q];
        }
    }
    if (j->p->weight != NULL)
        memcpy(lambda, j->p->weight, 4 * sizeof *lambda);
    else if (j->p->lambda < 0)
        automatic(j, mean, chord, lambda, noise2);
    else
        for (int l = 0; l < 4; l++)
            lambda[l] = j->share[l] * mean * (double)j->p->lambda;
}
