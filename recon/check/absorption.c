#include "recon/check/absorption.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "recon/check/holdout.h"

static const double depths[] = {0, 0.25, 0.5, 0.75, 1, 1.5, 2, 2.5, 3, 3.5, 4, 5, 6};
#define N_DEPTHS (sizeof depths / sizeof *depths)

struct search {
    rec_unseen *u;
    const struct rec_check_source *from;
    size_t at[REC_ABSORPTION_SETS]; /* sets of the source */
    double brightest;               /* bin of them all */
    double error[N_DEPTHS][REC_ABSORPTION_VIEWS];
    uint32_t views; /* of error[] that are there */
};

static pvx_err load(struct search *s, size_t i)
{
    struct rec_check_set set;
    PVX_TRY(s->from->get(s->from->ctx, i, &set));
    rec_unseen_absorb(s->u, 0);
    rec_unseen_load(s->u, set.picture, set.floats);
    return PVX_OK;
}

/* Sets with a flame, evenly spread over the source. */
static pvx_err choose(struct search *s, struct rec_absorption *out, struct pvx_diag *d)
{
    bool sees[REC_MAX_CAMERAS];
    for (size_t k = 0, last = SIZE_MAX; k < REC_ABSORPTION_SETS; k++) {
        size_t i = (2 * k + 1) * s->from->n / (2 * REC_ABSORPTION_SETS);
        if (i == last || i >= s->from->n)
            continue;
        last = i;
        PVX_TRY(load(s, i));
        if (rec_holdout_who(s->u, sees, &s->brightest) >= REC_ABSORPTION_LEAST)
            s->at[out->sets++] = i;
    }
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

/* Every depth without camera k, of the set that is loaded. */
static pvx_err without(struct search *s, const bool *sees, size_t k)
{
    bool use[REC_MAX_CAMERAS];
    memcpy(use, sees, sizeof use);
    use[k] = false;
    for (size_t i = 0; i < N_DEPTHS; i++) {
        double c = c_of(s, depths[i]);
        int32_t n;
        rec_unseen_absorb(s->u, c);
        PVX_TRY(rec_unseen_solve(s->u, use, &n));
        s->error[i][s->views] = rec_holdout_miss(s->u, k, c, NULL);
    }
    s->views++;
    return PVX_OK;
}

static pvx_err measure(struct search *s, uint32_t sets)
{
    bool sees[REC_MAX_CAMERAS];
    size_t n = rec_unseen_matrix(s->u)->n_cameras, each = REC_ABSORPTION_VIEWS / sets;
    each = each < n ? each : n;
    for (uint32_t j = 0; j < sets; j++) {
        PVX_TRY(load(s, s->at[j]));
        (void)rec_holdout_who(s->u, sees, &s->brightest);
        for (size_t m = 0; m < each; m++) {
            size_t k = (j + m * n / each) % n; /* around the ring */
            if (sees[k])
                PVX_TRY(without(s, sees, k));
            double done = ((double)j + (double)(m + 1) / (double)each) / sets;
            if (s->from->progress != NULL && !s->from->progress(s->from->ctx, done))
                return PVX_ECANCELED;
        }
    }
    return PVX_OK;
}

static double total(const struct search *s, size_t i)
{
    double sum = 0;
    for (uint32_t v = 0; v < s->views; v++)
        sum += s->error[i][v];
    return sum;
}

/* The least of a parabola through three depths. */
static double between(const struct search *s, size_t i)
{
    if (i == 0 || i + 1 == N_DEPTHS)
        return depths[i];
    double x0 = depths[i - 1] - depths[i], x1 = depths[i + 1] - depths[i], f = total(s, i);
    double f0 = total(s, i - 1) - f, f1 = total(s, i + 1) - f;
    double bend = f0 * x1 - f1 * x0; /* of a common sign with x1 - x0 > 0 */
    if (!(bend > 0))
        return depths[i];
    return depths[i] + 0.5 * (f0 * x1 * x1 - f1 * x0 * x0) / bend;
}

pvx_err rec_absorption_find(rec_unseen *u, const struct rec_check_source *sets,
                            struct rec_absorption *out, struct pvx_diag *d)
{
    struct search *s = calloc(1, sizeof *s);
    size_t best = 0;
    *out = (struct rec_absorption){0};
    if (s == NULL)
        return pvx_fail(d, PVX_ENOMEM, "absorption: out of memory");
    s->u = u;
    s->from = sets;
    pvx_err e = choose(s, out, d);
    if (e == PVX_OK)
        e = measure(s, out->sets);
    rec_unseen_absorb(u, 0);
    for (size_t i = 1; i < N_DEPTHS && e == PVX_OK; i++)
        best = total(s, i) < total(s, best) ? i : best;
    if (e == PVX_OK && s->views > 0) {
        out->views = s->views;
        out->depth = between(s, best);
        out->best = c_of(s, out->depth);
        out->gain = 1 - total(s, best) / fmax(total(s, 0), 1e-300);
        for (uint32_t v = 0; v < s->views; v++)
            out->better += s->error[best][v] < s->error[0][v];
        if (out->gain >= REC_ABSORPTION_GAIN && 3 * out->better >= 2 * out->views)
            out->c = out->best;
    }
    free(s);
    return e;
}
