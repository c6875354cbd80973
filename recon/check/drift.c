#include "recon/check/drift.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/check/shift.h"

#define SMOOTHINGS 2    /* passes of [1 2 1]: detail that a small grid cannot show */
#define REACH      8    /* bins: range of the first search */
#define PEAK       0.05 /* gain of the correlation over no shift above which the search counts */
#define PATIENCE   16   /* sets */
#define AT_ONCE    8    /* cameras for which one look per set is enough */

struct look {
    double A[3], d[2]; /* bins */
};

struct mean {
    double d[2], e; /* m and its error, bins */
};

struct camera {
    struct look look[REC_DRIFT_LOOKS];
    int n, at; /* how many looks; place of the next one */
    bool based;
    struct mean base;
    struct rec_drift_camera out;
};

struct rec_drift {
    struct rec_drift_params p;
    rec_unseen *unseen;
    size_t n, turn;
    int trial;                             /* camera left out on trial, or -1 */
    bool present[REC_MAX_CAMERAS], looked; /* the cameras of volumes so far */
    int strange;                           /* sets of other cameras in a row */
    double bin_px;
    struct camera camera[REC_MAX_CAMERAS];
    float *b, *seen, *tmp; /* [bins of the greatest picture] */
};

pvx_err rec_drift_new(rec_unseen *u, const struct rec_drift_params *p, rec_drift **out,
                      struct pvx_diag *d)
{
    const rec_sysmat *S = rec_unseen_matrix(u);
    size_t most = 0;
    rec_drift *t = *out = pvx_calloc(1, sizeof *t);
    if (t == NULL)
        return pvx_fail(d, PVX_ENOMEM, "drift: out of memory");
    t->p = *p;
    t->unseen = u;
    t->n = S->n_cameras;
    t->trial = -1;
    for (size_t c = 0; c < t->n; c++)
        most = S->row0[c + 1] - S->row0[c] > most ? S->row0[c + 1] - S->row0[c] : most;
    t->bin_px = S->binning;
    t->b = pvx_calloc(most, sizeof *t->b);
    t->seen = pvx_calloc(most, sizeof *t->seen);
    t->tmp = pvx_calloc(most, sizeof *t->tmp);
    if (t->b != NULL && t->seen != NULL && t->tmp != NULL)
        return PVX_OK;
    rec_drift_free(out);
    return pvx_fail(d, PVX_ENOMEM, "drift: work areas for %zu bins", most);
}

void rec_drift_free(rec_drift **tp)
{
    rec_drift *t = *tp;
    if (t == NULL)
        return;
    free(t->b);
    free(t->seen);
    free(t->tmp);
    PVX_FREE(*tp);
}

const struct rec_drift_camera *rec_drift_of(const rec_drift *t, size_t camera)
{
    return &t->camera[camera].out;
}

double rec_drift_off(const struct rec_drift_params *p, int32_t binning)
{
    return fmax(p->off_px, 4 * p->moved_bins * binning);
}

/* ---- what the looks say ------------------------------------------------------------------------- */

/* (1). */
static struct mean drift_mean_of(const struct camera *k)
{
    double A[3] = {0}, v[2] = {0}, scatter = 0;
    struct mean m = {{0}, INFINITY};
    for (int i = 0; i < k->n; i++) {
        const struct look *l = &k->look[i];
        for (int a = 0; a < 3; a++)
            A[a] += l->A[a];
        v[0] += l->A[0] * l->d[0] + l->A[1] * l->d[1];
        v[1] += l->A[1] * l->d[0] + l->A[2] * l->d[1];
    }
    double det = A[0] * A[2] - A[1] * A[1];
    if (k->n < 2 || !(det > 0))
        return m;
    m.d[0] = (A[2] * v[0] - A[1] * v[1]) / det;
    m.d[1] = (A[0] * v[1] - A[1] * v[0]) / det;
    for (int i = 0; i < k->n; i++)
        scatter += pow(k->look[i].d[0] - m.d[0], 2) + pow(k->look[i].d[1] - m.d[1], 2);
    m.e = sqrt(scatter / (k->n * (k->n - 1.0)));
    return m;
}

/* How far a camera is beyond (2): 1 is the bound. */
static double beyond(const rec_drift *t, const struct camera *k)
{
    struct mean m = drift_mean_of(k);
    double F = fmax(t->p.moved_px / t->bin_px, t->p.moved_bins);
    double G = rec_drift_off(&t->p, (int32_t)t->bin_px) / t->bin_px;
    double off = hypot(m.d[0], m.d[1]) / (G + t->p.sigmas * m.e);
    if (!k->based)
        return off;
    double moved = hypot(m.d[0] - k->base.d[0], m.d[1] - k->base.d[1]) /
                   (F + t->p.sigmas * hypot(m.e, k->base.e));
    return fmax(moved, off);
}

static void drift_forget(rec_drift *t, bool base)
{
    for (size_t c = 0; c < t->n; c++) {
        t->camera[c].n = t->camera[c].at = 0;
        if (base)
            t->camera[c].based = false;
    }
}

static void drift_name(rec_drift *t, size_t c, bool moved, uint64_t *changed)
{
    t->camera[c].out.moved = moved;
    *changed |= (uint64_t)1 << c;
}

/* After the last look of a round: suspect, name or take back cameras. */
static void drift_judge(rec_drift *t, uint64_t *changed)
{
    int worst = -1;
    double most = 1;
    for (size_t c = 0; c < t->n; c++) {
        struct camera *k = &t->camera[c];
        if (!t->present[c] || k->n < REC_DRIFT_LOOKS)
            continue;
        double far = beyond(t, k);
        if (k->out.moved && far < 0.5)
            drift_name(t, c, false, changed);
        else if (!k->out.moved && far > most) {
            most = far;
            worst = (int)c;
        }
    }
    if (t->trial >= 0) {
        if (beyond(t, &t->camera[t->trial]) > 1)
            drift_name(t, (size_t)t->trial, true, changed);
        t->trial = -1;
        drift_forget(t, false);
    } else if (worst >= 0) {
        t->trial = worst;
        drift_forget(t, false);
    }
    for (size_t c = 0; c < t->n; c++) {
        struct camera *k = &t->camera[c];
        if (!k->based && k->n == REC_DRIFT_LOOKS && !k->out.moved) {
            k->base = drift_mean_of(k);
            k->based = isfinite(k->base.e);
        }
    }
}

/* d and A of a whole picture. */
static bool displaced(const struct rec_pair *q, struct look *l)
{
    struct rec_lattice sum = {0};
    int32_t s[2] = {0, 0};
    const int32_t none[2] = {0, 0};
    if (rec_correlation_peak(q, REACH, 0, s) - rec_correlation(q, none, 0) <= PEAK)
        s[0] = s[1] = 0;
    if (rec_shift_add(q, s, &sum, l->d) <= 0)
        return false;
    for (int i = 0; i < REC_LATTICE; i++)
        for (int a = 0; a < 3; a++)
            l->A[a] += sum.w[i].A[a];
    return true;
}

/* ---- a look ------------------------------------------------------------------------------------- */

static pvx_err drift_look(rec_drift *t, size_t c)
{
    const rec_sysmat *S = rec_unseen_matrix(t->unseen);
    const struct rec_sysmat_block *B = &S->block[c];
    const float *picture;
    bool use[REC_MAX_CAMERAS];
    struct camera *k = &t->camera[c];
    int32_t n;
    size_t views = 0;
    for (size_t o = 0; o < t->n; o++) {
        use[o] = t->present[o] && o != c && !t->camera[o].out.moved && (int)o != t->trial;
        views += use[o];
    }
    if (views < REC_DRIFT_LEAST - 1)
        return PVX_OK;
    PVX_TRY(rec_unseen_solve(t->unseen, use, &n));
    if (n == 0)
        return PVX_OK;
    rec_unseen_project(t->unseen, c, &picture, NULL);
    rec_smooth(rec_unseen_b(t->unseen, c), B->bw, B->bh, SMOOTHINGS, t->b, t->tmp);
    rec_smooth(picture, B->bw, B->bh, SMOOTHINGS, t->seen, t->tmp);
    struct rec_pair q = {B->bw, B->bh, t->b, rec_unseen_weight(t->unseen, c), t->seen};
    struct look now = {{0}, {0}};
    if (!displaced(&q, &now))
        return PVX_OK;
    k->look[k->at] = now;
    k->at = (k->at + 1) % REC_DRIFT_LOOKS;
    k->n += k->n < REC_DRIFT_LOOKS;
    k->out.looks++;
    struct mean m = drift_mean_of(k);
    for (int a = 0; a < 2; a++) {
        k->out.px[a] = m.d[a] * t->bin_px;
        k->out.since[a] = k->based ? (m.d[a] - k->base.d[a]) * t->bin_px : 0;
    }
    return PVX_OK;
}

/* Whether the set has the cameras that made the volumes so far, since other cameras mean another bias.  A single
 * set of others is skipped; after many in a row they become the usual ones. */
static bool drift_usual(rec_drift *t, const float *const *picture)
{
    bool same = true;
    for (size_t c = 0; c < t->n; c++)
        same &= t->present[c] == (picture[c] != NULL);
    if (same) {
        t->strange = 0;
        return true;
    }
    if (t->looked && ++t->strange < PATIENCE)
        return false;
    for (size_t c = 0; c < t->n; c++)
        t->present[c] = picture[c] != NULL;
    drift_forget(t, true);
    t->strange = 0;
    t->trial = -1;
    t->turn = 0;
    return true;
}

pvx_err rec_drift_add(rec_drift *t, const float *const *picture, bool floats, uint64_t *changed)
{
    size_t views = 0;
    *changed = 0;
    if (!drift_usual(t, picture))
        return PVX_OK;
    t->looked = true;
    for (size_t c = 0; c < t->n; c++)
        views += t->present[c];
    if (views < REC_DRIFT_LEAST)
        return PVX_OK;
    rec_unseen_load(t->unseen, picture, floats);
    for (size_t k = 0; k < (t->n + AT_ONCE - 1) / AT_ONCE; k++) {
        while (!t->present[t->turn % t->n])
            t->turn++;
        PVX_TRY(drift_look(t, t->turn % t->n));
        if (++t->turn >= t->n * REC_DRIFT_LOOKS) {
            t->turn = 0;
            drift_judge(t, changed);
        }
    }
    return PVX_OK;
}
