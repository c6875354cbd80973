#include "recon/check/judge.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/median.h"

#define BARELY    0.1 /* share that counts as next to nothing */
#define MOST      0.5
#define TWICE     0.5 /* of 1 - rho */
#define STILL     0.15
#define ERRORS    4.0 /* standard errors */
#define BLUR      2.0 /* bins */
#define GAIN      1.1
#define APART     0.1 /* 1 - rho */
#define TIMES     4.0 /* its median */
#define MOVES     4.0 /* change over noise of a flame that moves */
#define LEAST_LIT 60  /* bins: smallest usable flame in a picture */
#define SEEN_BY   3

static double judge_median_of(const struct rec_check_figures *f, size_t n,
                              double (*of)(const struct rec_check_camera *))
{
    double v[REC_MAX_CAMERAS];
    size_t m = 0;
    for (size_t c = 0; c < n; c++)
        if (f->use[c] && f->camera[c].sets > 0)
            v[m++] = of(&f->camera[c]);
    qsort(v, m, sizeof *v, pvx_ascending);
    return m == 0 ? 0 : m % 2 != 0 ? v[m / 2] : 0.5 * (v[m / 2 - 1] + v[m / 2]);
}

static double apart_of(const struct rec_check_camera *o)
{
    return 1 - o->rho_moved;
}
static double judge_gain_of(const struct rec_check_camera *o)
{
    return o->gain;
}
static double blur2_of(const struct rec_check_camera *o)
{
    return o->blur * fabs(o->blur);
}

double rec_check_floor(const struct rec_camera *c, int32_t binning)
{
    return fmax(fmax(REC_CHECK_MOVED, 0.3 * binning), c->uncertainty.px_95);
}

static bool judge_moved(const struct rec_check_camera *o, const struct rec_camera *c,
                        int32_t binning)
{
    double floor = rec_check_floor(c, binning);
    double d = hypot(o->shift[0], o->shift[1]), sigma = hypot(o->sigma[0], o->sigma[1]);
    return d > floor && d > ERRORS * sigma;
}

/* Turned about its axis, or nearer or further away: judged by how far that moves the flame's edge. */
static bool judge_turned(const struct rec_check_camera *o, const struct rec_camera *c,
                         int32_t binning)
{
    double radius = sqrt(0.5 * o->area * c->width * c->height); /* of a square: to its corner */
    return radius * fmax(fabs(o->roll), fabs(o->size)) >
           rec_check_floor(c, binning) + ERRORS * hypot(o->sigma[0], o->sigma[1]);
}

/* Pictures of another instant fit better, or the camera's picture never changes. */
static bool late(const struct rec_check_camera *o, double moves)
{
    for (int i = 0; i < REC_CHECK_LAGS; i++)
        if (i != REC_CHECK_LATE && o->late_z[i] > ERRORS && o->rho_late[i] > o->rho_moved)
            return true;
    return o->still < STILL && moves > MOVES;
}

struct usual {
    double apart, gain, blur2, moves;
};

static enum rec_wrong judge_name(const struct rec_check_camera *o, const struct rec_camera *c,
                                 int32_t binning, const struct usual *u)
{
    if (o->sets == 0)
        return o->area > 0 ? REC_WRONG_DISAGREES : REC_WRONG_NOTHING;
    double apart = apart_of(o);
    if (o->lit < BARELY && o->gain < BARELY)
        return REC_WRONG_DARK;
    if (o->area > MOST || o->saturated > MOST ||
        (o->explained < MOST && o->lit > MOST && apart > 1 - MOST))
        return REC_WRONG_FLOODED;
    if (1 - o->rho_mirrored < TWICE * apart)
        return REC_WRONG_MIRRORED;
    if (late(o, u->moves))
        return REC_WRONG_LATE;
    if (apart > APART && apart > TIMES * u->apart)
        return REC_WRONG_DISAGREES;
    if (judge_moved(o, c, binning))
        return REC_WRONG_MOVED;
    /* Noise makes every picture sharper than expected, since volumes have none; the median removes the common
     * part. */
    if (o->blur > 0 && blur2_of(o) - u->blur2 > BLUR * BLUR * binning * binning)
        return REC_WRONG_BLURRED; /* before turned: blur makes a flame look larger, too */
    if (judge_turned(o, c, binning))
        return REC_WRONG_MOVED;
    if (u->gain > 0 && fabs(log(fmax(o->gain, 1e-9) / u->gain)) > log(GAIN))
        return REC_WRONG_GAIN;
    return REC_WRONG_NOTHING;
}

void rec_check_name(const struct rec_rig *rig, int32_t binning, struct rec_check_figures *f)
{
    size_t n = rig->n_cameras;
    struct usual u = {judge_median_of(f, n, apart_of), judge_median_of(f, n, judge_gain_of),
                      judge_median_of(f, n, blur2_of), f->moves};
    for (size_t c = 0; c < n; c++)
        f->camera[c].wrong = judge_name(&f->camera[c], &rig->cameras[c], binning, &u);
}

/* ---- who lies ---- */

struct run {
    rec_check *k;
    const struct rec_rig *rig;
    const struct rec_check_source *s;
    bool use[REC_MAX_CAMERAS];
    struct pvx_diag *d;
};

static pvx_err judge_tick(const struct run *r, double done)
{
    bool on = r->s->progress == NULL || r->s->progress(r->s->ctx, done);
    return on ? PVX_OK : PVX_ECANCELED;
}

static pvx_err judge_all(struct run *r, struct rec_check_figures *f)
{
    struct rec_check_set set;
    rec_check_begin(r->k, r->use);
    for (size_t i = 0; i < r->s->n; i++) {
        PVX_TRY(judge_tick(r, (double)i / (double)r->s->n));
        PVX_TRY(r->s->get(r->s->ctx, i, &set));
        PVX_TRY(rec_check_add(r->k, &set));
    }
    PVX_TRY(judge_tick(r, 1));
    rec_check_get(r->k, f);
    rec_check_name(r->rig, rec_check_matrix(r->k)->binning, f);
    return PVX_OK;
}

/* (1): how much better the others agree without each camera that looks wrong. */
static pvx_err judge_gains(struct run *r, const struct rec_check_figures *f,
                           double gain[REC_MAX_CAMERAS])
{
    size_t n = r->rig->n_cameras, step = (r->s->n + REC_CHECK_PAIRS - 1) / REC_CHECK_PAIRS;
    struct rec_check_set set;
    memset(gain, 0, REC_MAX_CAMERAS * sizeof *gain);
    for (size_t i = 0; i < r->s->n; i += step) {
        PVX_TRY(judge_tick(r, (double)i / (double)r->s->n));
        PVX_TRY(r->s->get(r->s->ctx, i, &set));
        rec_check_load(r->k, &set);
        for (size_t a = 0; a < n; a++)
            for (size_t b = a + 1; b < n; b++) {
                double rho[2];
                bool wa = f->camera[a].wrong != REC_WRONG_NOTHING,
                     wb = f->camera[b].wrong != REC_WRONG_NOTHING;
                if (!r->use[a] || !r->use[b] || (!wa && !wb))
                    continue;
                PVX_TRY(rec_check_pair(r->k, a, b, rho));
                gain[b] += rho[0] - f->camera[a].rho;
                gain[a] += rho[1] - f->camera[b].rho;
            }
    }
    return judge_tick(r, 1);
}

static size_t wrong_ones(const struct run *r, const struct rec_check_figures *f, size_t *one)
{
    size_t n = 0;
    for (size_t c = 0; c < r->rig->n_cameras; c++)
        if (r->use[c] && f->camera[c].wrong != REC_WRONG_NOTHING) {
            n++;
            *one = c;
        }
    return n;
}

static pvx_err liar(struct run *r, const struct rec_check_figures *f, size_t *out)
{
    double gain[REC_MAX_CAMERAS];
    if (wrong_ones(r, f, out) == 1)
        return PVX_OK;
    PVX_TRY(judge_gains(r, f, gain));
    for (size_t c = 0; c < r->rig->n_cameras; c++)
        if (r->use[c] && f->camera[c].wrong != REC_WRONG_NOTHING && gain[c] > gain[*out])
            *out = c;
    return PVX_OK;
}

/* ---- what tells nothing ---- */

static pvx_err judge_enough(const struct run *r, const struct rec_check_figures *f)
{
    size_t n = r->rig->n_cameras, seen = 0, large = 0, bright = 0;
    double most = 0;
    const rec_sysmat *S = rec_check_matrix(r->k);
    for (size_t c = 0; c < n; c++)
        if (f->camera[c].area < MOST) /* else it is flooded */
            most = fmax(most, f->camera[c].area);
    for (size_t c = 0; c < n; c++) {
        double bins = f->camera[c].area * S->block[c].bw * S->block[c].bh;
        seen += f->camera[c].area > BARELY * most; /* noise lights bins even behind a cap */
        bright += f->camera[c].area >= MOST;
        large += bins >= LEAST_LIT && f->camera[c].area < MOST;
    }
    if (seen < SEEN_BY)
        return pvx_fail(r->d, PVX_EINVAL,
                        "%zu of %zu cameras see any flame; a check needs it in %d at least: take "
                        "the caps off, look at exposure and background",
                        seen, n, SEEN_BY);
    if (large < SEEN_BY && bright > seen / 2)
        return pvx_fail(r->d, PVX_EINVAL,
                        "most of the pictures is lit, flame or not: give their --black level, or a "
                        "--background");
    if (large < SEEN_BY)
        return pvx_fail(r->d, PVX_EINVAL,
                        "the flame fills too little of the pictures (under %d bins of %d x %d "
                        "pixels): burn a larger one, or --binning %d",
                        LEAST_LIT, S->binning, S->binning, S->binning > 1 ? S->binning / 2 : 1);
    if (f->moves < MOVES)
        return pvx_fail(r->d, PVX_EINVAL,
                        "the flame never moves in these frames: it could be a lamp or one picture "
                        "again and again; take some that flicker");
    return PVX_OK;
}

static size_t judge_believed(const struct run *r)
{
    size_t n = 0;
    for (size_t c = 0; c < r->rig->n_cameras; c++)
        n += r->use[c];
    return n;
}

pvx_err rec_check_run(rec_check *k, const struct rec_rig *rig, const struct rec_check_source *s,
                      struct rec_check_verdict *out, struct pvx_diag *d)
{
    struct run r = {.k = k, .rig = rig, .s = s, .d = d};
    size_t n = rig->n_cameras, one = 0;
    struct rec_check_figures *f = &out->figures;
    memset(out, 0, sizeof *out);
    if (n < REC_CHECK_LEAST)
        return pvx_fail(d, PVX_EINVAL,
                        "%zu cameras: with fewer than %d nobody can tell which of them is wrong; "
                        "calibrate with a board instead",
                        n, REC_CHECK_LEAST);
    if (s->n < REC_CHECK_SETS)
        return pvx_fail(d, PVX_EINVAL, "%zu frame sets: a check needs %d at least", s->n,
                        REC_CHECK_SETS);
    for (size_t c = 0; c < n; c++)
        r.use[c] = s->doubted == NULL || !s->doubted[c];
    for (bool first = true;; first = false) {
        PVX_TRY(judge_all(&r, f));
        if (first)
            PVX_TRY(judge_enough(&r, f));
        size_t wrong = wrong_ones(&r, f, &one), left = judge_believed(&r) - 1;
        if (wrong == 0)
            break;
        if (n == REC_CHECK_LEAST && wrong == 1)
            break; /* the three others are too few to judge anew */
        if (left < REC_CHECK_LEAST || 2 * left <= n) {
            out->outcome = REC_CHECK_UNTOLD;
            break;
        }
        PVX_TRY(liar(&r, f, &one));
        r.use[one] = false;
    }
    for (size_t c = 0; c < n; c++)
        out->n_wrong += f->camera[c].wrong != REC_WRONG_NOTHING;
    if (out->outcome == REC_CHECK_AGREES && out->n_wrong > 0)
        out->outcome = REC_CHECK_NAMED;
    return PVX_OK;
}
