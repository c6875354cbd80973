#include "recon/check/holdout.h"

#include <math.h>
#include <string.h>

#include "base/clock.h"
#include "recon/carve/absorb.h"

#define LEAST 3 /* cameras of a volume */

static size_t holdout_bins_of(const rec_unseen *u, size_t c)
{
    const rec_sysmat *S = rec_unseen_matrix(u);
    return S->row0[c + 1] - S->row0[c];
}

double rec_holdout_miss(rec_unseen *u, size_t k, double c, double *all)
{
    const float *b = rec_unseen_b(u, k), *w = rec_unseen_weight(u, k), *e;
    const uint8_t *lit = rec_unseen_lit(u, k);
    double sum = 0, size = 0;
    rec_unseen_project(u, k, &e, NULL);
    for (size_t i = 0; i < holdout_bins_of(u, k); i++)
        if (w[i] > 0 && (lit[i] || e[i] > 0)) {
            double off = rec_absorb_seen(c, (double)e[i]) - (double)b[i];
            sum += off * off;
            size += (double)b[i] * (double)b[i];
        }
    if (all != NULL)
        *all = size;
    return sum;
}

double rec_holdout_noise(const rec_unseen *u, size_t k)
{
    const float *w = rec_unseen_weight(u, k);
    const uint8_t *lit = rec_unseen_lit(u, k);
    double sigma = rec_unseen_sigma(u), sum = 0;
    for (size_t i = 0; i < holdout_bins_of(u, k); i++)
        sum += w[i] > 0 && lit[i] ? sigma * sigma : 0;
    return sum;
}

size_t rec_holdout_who(const rec_unseen *u, bool *sees)
{
    size_t n = 0;
    for (size_t c = 0; c < rec_unseen_matrix(u)->n_cameras; c++) {
        const uint8_t *lit = rec_unseen_lit(u, c);
        sees[c] = false;
        for (size_t i = 0; i < holdout_bins_of(u, c) && rec_unseen_present(u, c); i++)
            sees[c] |= lit[i] != 0;
        n += sees[c];
    }
    return n;
}

struct sums {
    double miss, all, ms;
    size_t views;
};

/* Camera k of the loaded set. */
static pvx_err holdout_leave_out(rec_unseen *u, size_t k, const struct rec_holdout_params *p,
                                 const bool *sees, struct sums *s)
{
    bool use[REC_MAX_CAMERAS] = {false};
    size_t n = rec_unseen_matrix(u)->n_cameras, makers = 0;
    for (size_t i = 1; i < n; i += p->step) {
        use[(k + i) % n] = sees[(k + i) % n];
        makers += use[(k + i) % n];
    }
    int32_t voxels;
    double all;
    if (makers < LEAST)
        return PVX_OK;
    int64_t t0 = pvx_now_mono();
    PVX_TRY(rec_unseen_solve(u, use, &voxels));
    s->ms += 1e-6 * (double)(pvx_now_mono() - t0);
    s->miss += rec_holdout_miss(u, k, p->absorption, &all);
    s->all += all;
    s->views++;
    return PVX_OK;
}

pvx_err rec_holdout(rec_unseen *u, const struct rec_check_source *from,
                    const struct rec_holdout_params *p, double *error, double *ms)
{
    size_t n = rec_unseen_matrix(u)->n_cameras, sets = from->n < p->sets ? from->n : p->sets;
    size_t each = sets > 0 ? p->views / sets : 0;
    struct sums s = {0};
    bool sees[REC_MAX_CAMERAS] = {false};
    each = each < n ? each : n;
    for (size_t j = 0; j < sets; j++) {
        struct rec_check_set set;
        if (from->progress != NULL && !from->progress(from->ctx, (double)j / (double)sets))
            return PVX_ECANCELED;
        PVX_TRY(from->get(from->ctx, (2 * j + 1) * from->n / (2 * sets), &set));
        rec_unseen_absorb(u, 0);
        rec_unseen_load(u, set.picture, set.floats);
        rec_unseen_absorb(u, p->absorption);
        (void)rec_holdout_who(u, sees);
        for (size_t m = 0; m < each; m++) {
            size_t k = (j + m * n / each) % n; /* spread around the ring */
            if (sees[k])
                PVX_TRY(holdout_leave_out(u, k, p, sees, &s));
        }
    }
    if (from->progress != NULL && !from->progress(from->ctx, 1))
        return PVX_ECANCELED;
    if (s.views == 0 || !(s.all > 0))
        return PVX_ENOENT;
    *error = sqrt(s.miss / s.all);
    *ms = s.ms / (double)s.views;
    return PVX_OK;
}

double rec_holdout_unsure(const double *gain, size_t n)
{
    double sum = 0, scatter = 0;
    for (size_t i = 0; i < n; i++)
        sum += gain[i];
    for (size_t i = 0; i < n; i++) {
        double d = gain[i] - sum / (double)n;
        scatter += d * d;
    }
    return n > 1 ? sqrt((double)n * scatter / (double)(n - 1)) : INFINITY;
}
