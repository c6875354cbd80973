#include "recon/check/absorption.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "recon/check/holdout.h"

static const double depths[] = {0, 0.25, 0.5, 0.75, 1, 1.5, 2, 2.5, 3, 3.5, 4, 5, 6};
#define N_DEPTHS (sizeof depths / sizeof *depths)
#define EVERY    0x1555u /* tried first: every second depth; then those beside the best */

struct search {
    rec_unseen *u;
    const struct rec_check_source *from;
    size_t at[REC_ABSORPTION_SETS]; /* sets of the source */
    double top[REC_MAX_CAMERAS];    /* brightest bin of each camera */
    double brightest; /* second largest of `top`, since one camera may have another gain */
    double error[N_DEPTHS][REC_ABSORPTION_VIEWS];
    double size, noise; /* sum of b^2 of those pictures; N */
    uint32_t views;     /* entries of error[] in use */
    uint32_t tried;     /* bit i: depth i */
};

static pvx_err absorption_load(struct search *s, size_t i)
{
    struct rec_check_set set;
    PVX_TRY(s->from->get(s->from->ctx, i, &set));
    rec_unseen_absorb(s->u, 0);
    rec_unseen_load(s->u, set.picture, set.floats);
    return PVX_OK;
}

static void tops(struct search *s)
{
    const rec_sysmat *S = rec_unseen_matrix(s->u);
    for (size_t c = 0; c < S->n_cameras; c++) {
        const float *b = rec_unseen_b(s->u, c), *w = rec_unseen_weight(s->u, c);
        const uint8_t *lit = rec_unseen_lit(s->u, c);
        for (size_t i = 0; i < S->row0[c + 1] - S->row0[c] && rec_unseen_present(s->u, c); i++)
            if (lit[i] && w[i] > 0)
                s->top[c] = fmax(s->top[c], (double)b[i]);
    }
}

static double second(const struct search *s)
{
    double most[2] = {0, 0};
    for (size_t c = 0; c < rec_unseen_matrix(s->u)->n_cameras; c++) {
        double v = s->top[c];
        most[1] = fmax(most[1], fmin(v, most[0]));
        most[0] = fmax(most[0], v);
    }
    return most[1];
}

/* Sets with a flame, evenly spread over the source. */
static pvx_err absorption_choose(struct search *s, struct rec_absorption *out, struct pvx_diag *d)
{
    bool sees[REC_MAX_CAMERAS];
    for (size_t k = 0, last = SIZE_MAX; k < REC_ABSORPTION_SETS; k++) {
        size_t i = (2 * k + 1) * s->from->n / (2 * REC_ABSORPTION_SETS);
        if (i == last || i >= s->from->n)
            continue;
        last = i;
        PVX_TRY(absorption_load(s, i));
        if (rec_holdout_who(s->u, sees) >= REC_ABSORPTION_LEAST)
            s->at[out->sets++] = i;
        tops(s);
    }
    s->brightest = second(s);
    if (out->sets > 0 && s->brightest > 0)
        return PVX_OK;
    return pvx_fail(d, PVX_ENOENT,
                    "absorption: none of %zu frame sets has a flame in %d cameras; is it "
                    "--threshold or --black?",
                    s->from->n, REC_ABSORPTION_LEAST);
}

static double c_of(const struct search *s, double depth)
{
    return -expm1(-depth) / s->brightest;
}

/* F of these depths without camera k, of the loaded set. */
static pvx_err absorption_without(struct search *s, const bool *sees, size_t k, uint32_t which)
{
    bool use[REC_MAX_CAMERAS];
    memcpy(use, sees, sizeof use);
    use[k] = false;
    for (size_t i = 0; i < N_DEPTHS; i++) {
        if ((which >> i & 1) == 0)
            continue;
        double c = c_of(s, depths[i]);
        int32_t n;
        rec_unseen_absorb(s->u, c);
        PVX_TRY(rec_unseen_solve(s->u, use, &n));
        double size;
        s->error[i][s->views] = rec_holdout_miss(s->u, k, c, &size);
        if (i == 0) {
            s->size += size;
            s->noise += rec_holdout_noise(s->u, k);
        }
    }
    s->views++;
    return PVX_OK;
}

static pvx_err absorption_measure(struct search *s, uint32_t sets, uint32_t which)
{
    bool sees[REC_MAX_CAMERAS];
    size_t n = rec_unseen_matrix(s->u)->n_cameras, each = REC_ABSORPTION_VIEWS / sets;
    each = each < n ? each : n;
    s->views = 0;
    s->tried |= which;
    for (uint32_t j = 0; j < sets; j++) {
        PVX_TRY(absorption_load(s, s->at[j]));
        (void)rec_holdout_who(s->u, sees);
        for (size_t m = 0; m < each; m++) {
            size_t k = (j + m * n / each) % n; /* spread around the ring */
            if (sees[k])
                PVX_TRY(absorption_without(s, sees, k, which));
            double done = ((double)j + (double)(m + 1) / (double)each) / sets;
            if (s->from->progress != NULL && !s->from->progress(s->from->ctx, done))
                return PVX_ECANCELED;
        }
    }
    return PVX_OK;
}

/* F of depth i; INFINITY: not tried. */
static double absorption_total(const struct search *s, size_t i)
{
    double sum = (s->tried >> i & 1) != 0 ? 0 : INFINITY;
    for (uint32_t v = 0; v < s->views; v++)
        sum += s->error[i][v];
    return sum;
}

static size_t absorption_least(const struct search *s)
{
    size_t best = 0;
    for (size_t i = 1; i < N_DEPTHS; i++)
        best = absorption_total(s, i) < absorption_total(s, best) ? i : best;
    return best;
}

/* The minimum of a parabola through three depths. */
static double absorption_between(const struct search *s, size_t i)
{
    if (i == 0 || i + 1 == N_DEPTHS || !isfinite(absorption_total(s, i - 1)) ||
        !isfinite(absorption_total(s, i + 1)))
        return depths[i];
    double x0 = depths[i - 1] - depths[i], x1 = depths[i + 1] - depths[i],
           f = absorption_total(s, i);
    double f0 = absorption_total(s, i - 1) - f, f1 = absorption_total(s, i + 1) - f;
    double bend = f0 * x1 - f1 * x0; /* its sign is that of the curvature */
    if (!(bend > 0))
        return depths[i];
    return depths[i] + 0.5 * (f0 * x1 * x1 - f1 * x0 * x0) / bend;
}

/* Standard error of F(0) - F(depth i), a sum over pictures. */
static double absorption_unsure(const struct search *s, size_t i)
{
    double gain[sizeof s->error[0] / sizeof s->error[0][0]];
    for (uint32_t v = 0; v < s->views; v++)
        gain[v] = s->error[0][v] - s->error[i][v];
    return rec_holdout_unsure(gain, s->views);
}

pvx_err rec_absorption_find(rec_unseen *u, const struct rec_check_source *sets,
                            struct rec_absorption *out, struct pvx_diag *d)
{
    struct search *s = calloc(1, sizeof *s);
    *out = (struct rec_absorption){0};
    if (s == NULL)
        return pvx_fail(d, PVX_ENOMEM, "absorption: out of memory");
    s->u = u;
    s->from = sets;
    pvx_err e = absorption_choose(s, out, d);
    if (e == PVX_OK)
        e = absorption_measure(s, out->sets, EVERY);
    size_t best = absorption_least(s);
    if (e == PVX_OK)
        e = absorption_measure(s, out->sets,
                               (2u << best | 1u << best >> 1) & ((1u << N_DEPTHS) - 1) & ~s->tried);
    rec_unseen_absorb(u, 0);
    best = absorption_least(s);
    if (e == PVX_OK && s->views > 0) {
        out->views = s->views;
        out->brightest = s->brightest;
        out->depth = absorption_between(s, best);
        out->best = c_of(s, out->depth);
        double of = fmax(absorption_total(s, 0) - s->noise, 1e-3 * absorption_total(s, 0) + 1e-300);
        out->gain = fmax(absorption_total(s, 0) - absorption_total(s, best), 0) / of;
        out->unsure = absorption_unsure(s, best) / of;
        out->noise = sqrt(s->noise / fmax(s->size, 1e-300));
        out->missed[0] = sqrt(absorption_total(s, 0) / fmax(s->size, 1e-300));
        out->missed[1] = sqrt(absorption_total(s, best) / fmax(s->size, 1e-300));
        for (uint32_t v = 0; v < s->views; v++)
            out->better += s->error[best][v] < s->error[0][v];
        if (out->gain >= fmax(REC_ABSORPTION_GAIN, REC_ABSORPTION_SURE * out->unsure) &&
            4 * out->better >= 3 * out->views)
            out->c = out->best;
    }
    free(s);
    return e;
}
