#include "recon/check/check.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/median.h"
#include "base/mem.h"

#define SMOOTH  2    /* passes over pictures before they are compared */
#define REACH   0.15 /* of a picture's width: range of the search for a displacement */
#define THROUGH 0.5  /* voxels: a bin that looks through less of the hull is not in it */

#define LEFT 0.075 /* share of white noise's energy that is left after these passes */
#define TINY 1e-12
#define SAME 1e-4 /* a share of the light that may change without anything moving */

enum { KEPT = REC_CHECK_LATE + 1 };

struct sums {
    uint32_t sets, lags[REC_CHECK_LAGS], spread, changes;
    struct rec_lattice lattice;
    double rho, rho_moved, flip[4];
    double late[REC_CHECK_LAGS], better[REC_CHECK_LAGS], better2[REC_CHECK_LAGS];
    double mean[2], m2[2];           /* of displacements of single sets, by Welford's method */
    double Eb, Gb, Ep, Gp;           /* (1) */
    double own, own_in, due, due_in; /* own light, its explained part; light due, its lit part */
    double light, light_due;         /* light seen and due where light is due */
    double out2, in2, with2;         /* squares: b - p of the others, b, b - p of all */
    double lit, lost, bins;          /* bins */
    double change, change_due;       /* squares, between consecutive sets */
    double moves;                    /* change since the first set over its noise */
};

struct rec_check {
    struct rec_rig rig;
    rec_unseen *u;
    const rec_sysmat *S;
    bool use[REC_MAX_CAMERAS];
    struct sums sums[REC_MAX_CAMERAS];
    uint32_t sets;
    uint64_t number[KEPT];            /* of the kept sets; place = sets % KEPT */
    bool kept[KEPT][REC_MAX_CAMERAS]; /* camera was in that set */
    double rho[KEPT][REC_MAX_CAMERAS];
    float *b[KEPT], *p[KEPT]; /* [rows] smoothed */
    float *first, *all, *tmp; /* [rows] */
    bool has_first[REC_MAX_CAMERAS];
};

/* ---- made and given back ---- */

static pvx_err check_make(rec_check *k, const struct rec_rig *rig,
                          const struct rec_unseen_params *p, pvx_pool *pool, struct pvx_diag *d)
{
    PVX_TRY(rec_rig_copy(rig, &k->rig));
    PVX_TRY(rec_unseen_new(rig, p, pool, &k->u, d));
    k->S = rec_unseen_matrix(k->u);
    size_t rows = k->S->row0[k->S->n_cameras];
    bool ok = true;
    float **at[2 * KEPT + 3] = {&k->first, &k->all, &k->tmp};
    for (int i = 0; i < KEPT; i++) {
        at[3 + 2 * i] = &k->b[i];
        at[4 + 2 * i] = &k->p[i];
    }
    for (size_t i = 0; i < sizeof at / sizeof *at; i++)
        ok = (*at[i] = pvx_calloc(rows, sizeof(float))) != NULL && ok;
    if (!ok)
        return pvx_fail(d, PVX_ENOMEM, "check: no memory for %zu bins", rows);
    rec_check_begin(k, NULL);
    return PVX_OK;
}

pvx_err rec_check_new(const struct rec_rig *rig, const struct rec_unseen_params *p, pvx_pool *pool,
                      rec_check **out, struct pvx_diag *d)
{
    rec_check *k = *out = pvx_calloc(1, sizeof *k);
    if (k == NULL)
        return pvx_fail(d, PVX_ENOMEM, "check: out of memory");
    pvx_err e = check_make(k, rig, p, pool, d);
    if (e != PVX_OK)
        rec_check_free(out);
    return e;
}

void rec_check_free(rec_check **kp)
{
    rec_check *k = *kp;
    if (k == NULL)
        return;
    for (int i = 0; i < KEPT; i++) {
        free(k->b[i]);
        free(k->p[i]);
    }
    free(k->first);
    free(k->all);
    free(k->tmp);
    rec_unseen_free(&k->u);
    rec_rig_fini(&k->rig);
    PVX_FREE(*kp);
}

rec_unseen *rec_check_unseen(rec_check *k)
{
    return k->u;
}

const rec_sysmat *rec_check_matrix(const rec_check *k)
{
    return k->S;
}

void rec_check_begin(rec_check *k, const bool *use)
{
    for (size_t c = 0; c < REC_MAX_CAMERAS; c++)
        k->use[c] = use == NULL || use[c];
    memset(k->sums, 0, sizeof k->sums);
    memset(k->kept, 0, sizeof k->kept);
    memset(k->has_first, 0, sizeof k->has_first);
    k->sets = 0;
}

/* ---- one camera of a set ---- */

struct view {
    struct rec_pair q; /* smoothed */
    size_t n;          /* bins */
};

static struct view check_view_of(const rec_check *k, size_t c, int place)
{
    const struct rec_sysmat_block *o = &k->S->block[c];
    size_t row0 = k->S->row0[c];
    return (struct view){
        {o->bw, o->bh, k->b[place] + row0, rec_unseen_weight(k->u, c), k->p[place] + row0},
        (size_t)o->bw * (size_t)o->bh};
}

static double energy(const struct rec_pair *q, const float *v)
{
    double s = 0;
    for (size_t i = 0; i < (size_t)q->bw * (size_t)q->bh; i++)
        s += q->weight[i] > 0 ? (double)v[i] * (double)v[i] : 0;
    return s;
}

static double check_difference(const struct rec_pair *q, const float *a, const float *b,
                               double scale)
{
    double s = 0;
    for (size_t i = 0; i < (size_t)q->bw * (size_t)q->bh; i++) {
        double r = (double)a[i] - scale * (double)b[i];
        s += q->weight[i] > 0 ? r * r : 0;
    }
    return s;
}

/* sum |grad v|^2 by forward differences. */
static double roughness(const struct rec_pair *q, const float *v)
{
    size_t w = (size_t)q->bw;
    double s = 0;
    for (size_t y = 0; y + 1 < (size_t)q->bh; y++)
        for (size_t x = 0; x + 1 < w; x++) {
            size_t i = y * w + x;
            if (!(q->weight[i] > 0) || !(q->weight[i + 1] > 0) || !(q->weight[i + w] > 0))
                continue;
            double dx = (double)v[i + 1] - (double)v[i], dy = (double)v[i + w] - (double)v[i];
            s += dx * dx + dy * dy;
        }
    return s;
}

static void check_coverage(const rec_check *k, size_t c, const float *p, const float *hull,
                           struct sums *s)
{
    const float *b = rec_unseen_b(k->u, c), *w = rec_unseen_weight(k->u, c);
    const uint8_t *lit = rec_unseen_lit(k->u, c);
    double h = rec_grid_h(&k->S->grid, 0);
    size_t n = k->S->row0[c + 1] - k->S->row0[c];
    for (size_t i = 0; i < n; i++) {
        double own = lit[i] && b[i] > 0 ? (double)b[i] : 0, due = (double)p[i];
        s->own += own;
        s->own_in += (double)hull[i] > THROUGH * h ? own : 0;
        s->due += due;
        s->due_in += lit[i] ? due : 0;
        if (w[i] > 0 && due > 0) {
            s->light += (double)b[i];
            s->light_due += due;
        }
        s->lit += lit[i];
        s->lost += !(w[i] > 0);
    }
    s->bins += (double)n;
}

/* Correlation as if the camera were `lag` sets late, compared with the same picture at its own time. */
static void as_late(struct sums *s, int lag, const struct rec_pair *q, double own)
{
    const int32_t zero[2] = {0, 0};
    int i = REC_CHECK_LATE + lag;
    double rho = rec_correlation(q, zero, 0), gain = rho - own;
    s->late[i] += rho;
    s->better[i] += gain;
    s->better2[i] += gain * gain;
    s->lags[i]++;
}

/* Correlations with pictures of other sets, if both are kept. */
static void other_times(const rec_check *k, size_t c, int place, struct sums *s)
{
    struct view now = check_view_of(k, c, place);
    for (uint32_t back = 1; back <= REC_CHECK_LATE && back <= k->sets; back++) {
        int old = (int)((k->sets - back) % KEPT);
        uint64_t lag = k->number[place] - k->number[old];
        if (!k->kept[old][c] || lag < 1 || lag > REC_CHECK_LATE)
            continue;
        struct view then = check_view_of(k, c, old);
        struct rec_pair late = now.q, early = now.q;
        late.p = then.q.p; /* late: shows now the picture that was due then */
        early.b = then.q.b;
        as_late(s, (int)lag, &late, k->rho[place][c]);
        as_late(s, -(int)lag, &early, k->rho[old][c]);
        if (lag == 1) {
            s->change += check_difference(&now.q, now.q.b, then.q.b, 1);
            s->change_due += check_difference(&now.q, now.q.p, then.q.p, 1);
            s->changes++;
        }
    }
}

static void check_spread(struct sums *s, const double d[2])
{
    s->spread++;
    for (int a = 0; a < 2; a++) {
        double off = d[a] - s->mean[a];
        s->mean[a] += off / s->spread;
        s->m2[a] += off * (d[a] - s->mean[a]);
    }
}

static void check_compare(rec_check *k, size_t c, int place, struct sums *s)
{
    struct view v = check_view_of(k, c, place);
    int32_t at[2] = {0, 0};
    const int32_t zero[2] = {0, 0};
    double d[2], rho = rec_correlation(&v.q, zero, 0);
    int32_t reach = (int32_t)(REACH * v.q.bw);
    for (unsigned flip = 1; flip < 4; flip++) {
        int32_t t[2] = {0, 0};
        s->flip[flip] += rec_correlation_peak(&v.q, reach, flip, t);
    }
    s->rho += k->rho[place][c] = rho;
    s->rho_moved += rec_correlation_peak(&v.q, reach, 0, at);
    if (rec_shift_add(&v.q, at, &s->lattice, d) > 0)
        check_spread(s, d);
    double Eb = energy(&v.q, v.q.b), Ep = energy(&v.q, v.q.p);
    double alpha = Ep > 0 ? rec_correlation(&v.q, at, 0) * sqrt(Eb / Ep) : 0;
    s->Eb += Eb;
    s->Ep += Ep;
    s->Gb += roughness(&v.q, v.q.b);
    s->Gp += roughness(&v.q, v.q.p);
    s->out2 += check_difference(&v.q, v.q.b, v.q.p, alpha);
    s->in2 += Eb;
    s->with2 += check_difference(&v.q, v.q.b, k->all + k->S->row0[c], 1);
    other_times(k, c, place, s);
    s->sets++;
}

/* Change of the flame since the first set, over the lit bins, in units of its noise. */
static void check_motion(rec_check *k, size_t c, int place, struct sums *s)
{
    struct view v = check_view_of(k, c, place);
    const uint8_t *lit = rec_unseen_lit(k->u, c);
    float *first = k->first + k->S->row0[c];
    double sigma = rec_unseen_sigma(k->u), moved = 0, noise = 0;
    if (!k->has_first[c]) {
        memcpy(first, v.q.b, v.n * sizeof *first);
        k->has_first[c] = true;
        return;
    }
    for (size_t i = 0; i < v.n; i++)
        if (lit[i] && v.q.weight[i] > 0) {
            double a = (double)v.q.b[i], r = a - (double)first[i];
            moved += r * r;
            noise += LEFT * 2 * sigma * sigma + SAME * a * a;
        }
    s->moves = fmax(s->moves, noise > 0 ? moved / noise : 0);
}

/* ---- a set ---- */

void rec_check_load(rec_check *k, const struct rec_check_set *s)
{
    rec_unseen_load(k->u, s->picture, s->floats);
}

static pvx_err check_without(rec_check *k, size_t c, size_t also, int32_t *n)
{
    bool use[REC_MAX_CAMERAS];
    for (size_t i = 0; i < k->S->n_cameras; i++)
        use[i] = k->use[i] && i != c && i != also;
    return rec_unseen_solve(k->u, use, n);
}

static void check_smooth(const rec_check *k, size_t c, const float *in, float *out)
{
    const struct rec_sysmat_block *o = &k->S->block[c];
    rec_smooth(in, o->bw, o->bh, SMOOTH, out + k->S->row0[c], k->tmp);
}

pvx_err rec_check_add(rec_check *k, const struct rec_check_set *set)
{
    int place = (int)(k->sets % KEPT);
    int32_t n;
    rec_check_load(k, set);
    k->number[place] = set->number;
    PVX_TRY(rec_unseen_solve(k->u, k->use, &n));
    for (size_t c = 0; c < k->S->n_cameras; c++) {
        const float *p;
        rec_unseen_project(k->u, c, &p, NULL);
        check_smooth(k, c, p, k->all);
    }
    for (size_t c = 0; c < k->S->n_cameras; c++) {
        struct sums *s = &k->sums[c];
        const float *p, *hull;
        struct rec_sparse v;
        k->kept[place][c] = false;
        if (!rec_unseen_present(k->u, c))
            continue;
        PVX_TRY(check_without(k, c, c, &n));
        rec_unseen_project(k->u, c, &p, &hull);
        check_smooth(k, c, p, k->p[place]);
        check_smooth(k, c, rec_unseen_b(k->u, c), k->b[place]);
        check_coverage(k, c, p, hull, s);
        check_motion(k, c, place, s);
        struct view q = check_view_of(k, c, place);
        if (!(energy(&q.q, q.q.p) > 0))
            continue;
        k->kept[place][c] = true;
        check_compare(k, c, place, s);
        rec_unseen_volume(k->u, &v);
        rec_shift_points(&v, &k->rig.cameras[c], k->S->binning, &s->lattice);
    }
    k->sets++;
    return PVX_OK;
}

/* ---- figures ---- */

static double ratio(double a, double b, double none)
{
    return b > 0 ? a / b : none;
}

static void figures(const rec_check *k, size_t c, struct rec_check_camera *o)
{
    const struct sums *s = &k->sums[c];
    double n = s->sets > 0 ? s->sets : 1, bin = k->S->binning;
    struct rec_pose_fit fit;
    *o = (struct rec_check_camera){.sets = s->sets, .still = NAN};
    for (int i = 0; i < REC_CHECK_LAGS; i++) {
        double m = s->lags[i], mean = s->better[i] / m;
        o->rho_late[i] = m > 0 ? s->late[i] / m : NAN;
        if (m > 2)
            o->late_z[i] = mean / sqrt((s->better2[i] / m - mean * mean) / (m - 1) + TINY);
    }
    o->rho_late[REC_CHECK_LATE] = o->rho = s->rho / n;
    o->rho_moved = s->rho_moved / n;
    for (unsigned f = 1; f < 4; f++)
        if (s->flip[f] / n > o->rho_mirrored) {
            o->rho_mirrored = s->flip[f] / n;
            o->mirrored = f;
        }
    if (rec_shift_mean(&s->lattice, o->shift))
        for (int a = 0; a < 2; a++) {
            o->shift[a] *= bin;
            if (s->spread > 1)
                o->sigma[a] = bin * sqrt(s->m2[a] / (s->spread - 1) / s->spread);
        }
    if (rec_pose_fit(&s->lattice, &k->rig.cameras[c], &k->rig.grid, k->S->binning, REC_POSE_FOCAL,
                     &fit)) {
        o->roll = fit.roll;
        o->size = fit.size;
    }
    if (s->changes > 0 && s->change_due > 0)
        o->still = sqrt(s->change / s->change_due);
    o->gain = fmax(ratio(s->light, s->light_due, 0), 0);
    double blur2 = ratio(s->Eb, s->Gb, 0) - ratio(s->Ep, s->Gp, 0);
    o->blur = bin * (blur2 < 0 ? -sqrt(-blur2) : sqrt(blur2));
    o->explained = ratio(s->own_in, s->own, 1);
    o->lit = ratio(s->due_in, s->due, 1);
    o->area = ratio(s->lit, s->bins, 0);
    o->saturated = ratio(s->lost, s->bins, 0);
    o->residual = sqrt(ratio(s->out2, s->in2, 0));
    o->with_it = sqrt(ratio(s->with2, s->in2, 0));
}

void rec_check_get(const rec_check *k, struct rec_check_figures *out)
{
    double moves[REC_MAX_CAMERAS];
    size_t n = 0;
    memset(out, 0, sizeof *out);
    out->sets = k->sets;
    memcpy(out->use, k->use, sizeof out->use);
    for (size_t c = 0; c < k->S->n_cameras; c++) {
        figures(k, c, &out->camera[c]);
        if (out->camera[c].area > 0)
            moves[n++] = k->sums[c].moves;
    }
    qsort(moves, n, sizeof *moves, pvx_ascending);
    out->moves = n > 0 ? moves[n / 2] : 0;
}

const struct rec_lattice *rec_check_lattice(const rec_check *k, size_t c)
{
    return &k->sums[c].lattice;
}

/* ---- looks ---- */

pvx_err rec_check_look(rec_check *k, size_t c, struct rec_check_picture *out)
{
    int32_t n;
    *out = (struct rec_check_picture){.bw = k->S->block[c].bw, .bh = k->S->block[c].bh};
    if (!rec_unseen_present(k->u, c))
        return PVX_OK;
    PVX_TRY(check_without(k, c, c, &n));
    rec_unseen_project(k->u, c, &out->p, &out->hull);
    out->b = rec_unseen_b(k->u, c);
    out->lit = rec_unseen_lit(k->u, c);
    return PVX_OK;
}

pvx_err rec_check_pair(rec_check *k, size_t c, size_t also, double rho[2])
{
    const size_t one[2] = {c, also};
    const int32_t zero[2] = {0, 0};
    int32_t n;
    PVX_TRY(check_without(k, c, also, &n));
    for (int i = 0; i < 2; i++) {
        const struct rec_sysmat_block *o = &k->S->block[one[i]];
        const float *p;
        size_t row0 = k->S->row0[one[i]];
        rec_unseen_project(k->u, one[i], &p, NULL);
        check_smooth(k, one[i], p, k->all);
        check_smooth(k, one[i], rec_unseen_b(k->u, one[i]), k->first);
        k->has_first[one[i]] = false;
        struct rec_pair q = {o->bw, o->bh, k->first + row0, rec_unseen_weight(k->u, one[i]),
                             k->all + row0};
        rho[i] = rec_unseen_present(k->u, one[i]) ? rec_correlation(&q, zero, 0) : 0;
    }
    return PVX_OK;
}
