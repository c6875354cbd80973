/* motion.c - consecutive sets: how far the flame moves, how much of its change is noise, whether the volume before
 * improves left-out pictures, and the finest detail that noise and cameras allow. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/clock.h"
#include "base/mem.h"
#include "daemon/cli/advise/advise.h"
#include "recon/check/holdout.h"
#include "recon/solve/flow.h"

#define RUN     6 /* sets */
#define LEAST   3
#define CAMERAS 3 /* left out, one after the other */

struct motion {
    struct flame_sets *s;
    struct rec_check_source from;
    struct advise_motion *m;
    rec_unseen *u;
    rec_flow *flow;
    struct rec_sparse before; /* own copy */
    int32_t *index;
    float *value;
    double c; /* absorption */
    size_t first, done;
    double miss[2], all, ms[2], moved,
        light; /* miss, ms: without and with the volume before; moved: emission times way */
    double noise;
    size_t solves[2];
    double gain[CAMERAS * RUN]; /* of each picture, in miss */
    size_t pictures[2];
};

/* The longest run of sets that follow each other. */
static size_t run_of(const struct flame_sets *s, size_t *first)
{
    size_t longest = 0;
    for (size_t i = 0, n = 1; i < s->n; i++, n++) {
        if (i > 0 && s->number[i] != s->number[i - 1] + 1)
            n = 1;
        if (n > longest) {
            longest = n;
            *first = i + 1 - n;
        }
    }
    return longest < RUN ? longest : RUN;
}

static pvx_err motion_load(struct motion *w, size_t i)
{
    struct rec_check_set set;
    PVX_TRY(w->from.get(w->from.ctx, i, &set));
    rec_unseen_absorb(w->u, 0);
    rec_unseen_load(w->u, set.picture, set.floats);
    rec_unseen_absorb(w->u, w->c);
    return PVX_OK;
}

/* Measure how much the pictures change from set to set, and how much of that noise makes.  Both relative to light. */
static pvx_err motion_change(struct motion *w)
{
    const rec_sysmat *S = rec_unseen_matrix(w->u);
    size_t rows = S->row0[S->n_cameras];
    float *last = pvx_calloc(rows, sizeof *last);
    double off = 0, light = 0, noise = 0;
    pvx_err e = last == NULL ? PVX_ENOMEM : PVX_OK;
    for (size_t j = 0; j < w->m->sets && e == PVX_OK; j++) {
        e = motion_load(w, w->first + j);
        double sigma = rec_unseen_sigma(w->u);
        for (size_t c = 0; c < S->n_cameras && e == PVX_OK; c++) {
            const float *b = rec_unseen_b(w->u, c), *wt = rec_unseen_weight(w->u, c);
            const uint8_t *lit = rec_unseen_lit(w->u, c);
            float *was = last + S->row0[c];
            for (size_t i = 0; i < S->row0[c + 1] - S->row0[c]; i++) {
                bool seen = wt[i] > 0 && lit[i];
                double by = (double)b[i] - (double)was[i];
                if (j > 0 && seen && isfinite(was[i])) {
                    off += by * by;
                    noise += 2 * sigma * sigma;
                    light += (double)b[i] * (double)b[i];
                }
                was[i] = wt[i] > 0 && rec_unseen_present(w->u, c) ? b[i] : NAN;
            }
        }
        w->m->sigma += sigma / (double)w->m->sets;
    }
    w->m->change = light > 0 ? sqrt(fmax(off - noise, 0) / light) : 0;
    w->m->noise = light > 0 ? sqrt(noise / light) : 0;
    free(last);
    return e;
}

/* Add how far emission moved since the volume before.  Then keep this volume as the one before. */
static void follow(struct motion *w, bool begun)
{
    struct rec_sparse v;
    rec_unseen_volume(w->u, &v);
    if (begun) {
        struct rec_flow_volume from = {w->before.n, w->index, w->value, v.cs, v.nch};
        struct rec_flow_volume to = {v.n, v.index, v.value, v.cs, v.nch};
        rec_flow_find(w->flow, &from, &to, w->s->pool);
        for (int32_t q = 0; q < v.n; q++) {
            int32_t i = v.index[q], n0 = v.grid->n[0], n1 = v.grid->n[1];
            const int32_t ijk[3] = {i % n0, i / n0 % n1, i / n0 / n1};
            float u[3];
            rec_flow_at(w->flow, ijk, u);
            double e = (double)v.value[(size_t)q * (size_t)v.cs];
            w->moved += e * sqrt((double)(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]));
            w->light += e;
        }
    }
    memcpy(w->index, v.index, (size_t)v.n * sizeof *v.index);
    memcpy(w->value, v.value, (size_t)v.n * (size_t)v.cs * sizeof *v.value);
    w->before = v;
}

/* Solve the whole run without camera k, and compare with its pictures. */
static pvx_err motion_leave_out(struct motion *w, size_t k, int leaning, bool track)
{
    bool use[REC_MAX_CAMERAS];
    for (size_t c = 0; c < w->s->rig.n_cameras; c++)
        use[c] = c != k;
    rec_unseen_forget(w->u);
    for (size_t j = 0; j < w->m->sets; j++) {
        int32_t n;
        double all;
        PVX_TRY(motion_load(w, w->first + j));
        if (!rec_unseen_present(w->u, k))
            return PVX_OK;
        int64_t t0 = pvx_now_mono();
        PVX_TRY(rec_unseen_solve(w->u, use, &n));
        w->ms[leaning] += 1e-6 * (double)(pvx_now_mono() - t0);
        w->solves[leaning]++;
        if (track)
            follow(w, j > 0);
        if (j > 0) {
            double miss = rec_holdout_miss(w->u, k, w->c, &all);
            w->miss[leaning] += miss;
            w->gain[w->pictures[leaning]] += leaning ? -miss : miss;
            w->m->better += leaning && w->gain[w->pictures[1]] > 0;
            w->pictures[leaning]++;
            w->all += leaning ? 0 : all;
            w->noise += leaning ? 0 : rec_holdout_noise(w->u, k);
        }
        w->done++;
        if (!w->from.progress(w->from.ctx, (double)w->done / (double)(2 * CAMERAS * w->m->sets)))
            return PVX_ECANCELED;
    }
    return PVX_OK;
}

/* Finest detail that the noise of one set allows, from the volume of all cameras of the run's first set. */
static pvx_err details(struct motion *w, struct rec_resolution *out)
{
    bool all[REC_MAX_CAMERAS];
    struct rec_images *im;
    struct rec_sparse v;
    double e = 0, e2 = 0;
    int32_t n;
    for (size_t c = 0; c < w->s->rig.n_cameras; c++)
        all[c] = true;
    rec_unseen_forget(w->u);
    PVX_TRY(motion_load(w, w->first));
    PVX_TRY(rec_unseen_solve(w->u, all, &n));
    rec_unseen_volume(w->u, &v);
    for (int32_t q = 0; q < v.n; q++) {
        double x = (double)v.value[(size_t)q * (size_t)v.cs];
        e += x;
        e2 += x * x;
    }
    if (!(e > 0) || !(w->m->sigma > 0))
        return PVX_OK;
    for (size_t c = 0; c < w->s->rig.n_cameras; c++)
        all[c] = rec_unseen_present(w->u, c);
    const struct rec_subsys *a = rec_unseen_system(w->u, all, &im);
    return rec_resolution_find(a, im, w->m->sigma * e / e2, out);
}

static pvx_err motion_measure(struct motion *w, struct advice *a, int leaning, struct pvx_diag *d)
{
    struct rec_unseen_params p = w->s->params;
    size_t n = w->s->rig.n_cameras;
    p.temporal = leaning != 0;
    PVX_TRY(rec_unseen_new(&w->s->rig, &p, w->s->pool, &w->u, d));
    size_t voxels = rec_grid_count(&rec_unseen_matrix(w->u)->grid);
    pvx_err e = PVX_OK;
    if (!leaning) {
        w->index = pvx_calloc(voxels, sizeof *w->index);
        w->value = pvx_calloc(voxels, sizeof *w->value);
        e = w->index == NULL || w->value == NULL
                ? PVX_ENOMEM
                : rec_flow_new(&rec_unseen_matrix(w->u)->grid, &w->flow);
        PVX_THEN(e, motion_change(w));
        PVX_THEN(e, details(w, &a->resolution));
    }
    for (size_t k = 0; k < CAMERAS && w->m->sets >= LEAST && e == PVX_OK; k++)
        e = motion_leave_out(w, k * n / CAMERAS, leaning, !leaning && k == 0);
    rec_unseen_free(&w->u);
    return e;
}

pvx_err advise_motion(struct flame_sets *s, struct advice *a, struct pvx_diag *d)
{
    struct advise_motion *m = &a->motion;
    struct motion w = {
        .s = s, .m = m, .from = flame_sets_source(s, "motion"), .c = a->absorption.c};
    m->sets = run_of(s, &w.first);
    m->known = m->sets >= LEAST;
    pvx_err e = PVX_OK;
    for (int leaning = 0; leaning < (m->known ? 2 : 1) && e == PVX_OK; leaning++)
        e = motion_measure(&w, a, leaning, d);
    rec_flow_free(&w.flow);
    free(w.index);
    free(w.value);
    if (e != PVX_OK || !(w.all > 0)) {
        m->known = false;
        return e;
    }
    for (int k = 0; k < 2; k++) {
        m->error[k] = sqrt(w.miss[k] / w.all);
        m->ms[k] = w.ms[k] / (double)w.solves[k];
    }
    m->floor = sqrt(w.noise / w.all);
    m->voxels = w.light > 0 ? w.moved / w.light : 0;
    m->pictures = w.pictures[1];
    double unsure = rec_holdout_unsure(w.gain, m->pictures);
    m->sure = unsure > 0 ? (w.miss[0] - w.miss[1]) / unsure : 0;
    m->on = w.miss[0] - w.miss[1] > ADVISE_LEANS * fmax(w.miss[0] - w.noise, 0) &&
            m->sure > REC_ABSORPTION_SURE && 4 * m->better >= 3 * m->pictures;
    return PVX_OK;
}
