#include "recon/check/plausible.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/median.h"
#include "base/mem.h"
#include "recon/check/trials.h"

#define KEPT      REC_TRIALS_MOST /* sets, the last ones */
#define GROWN     0.02            /* sides of the volume by which a ray may miss it */
#define OUTSIDE   0.03 /* share of the light outside from which on it is asked where the flame is, */
#define MUCH      0.15 /* and from which on volumes are meaningless */
#define LIT       0.6  /* share of a picture */
#define SATURATED 0.05 /* share of the flame's bins */
#define DARKEST   0.25 /* quantile of a picture's blocks that is taken for its black level, */
#define FLATTEST \
    0.02 /* and the one that is FLAT of it or more; where a flame fills pictures, less */
#define FLAT      0.5
#define EXPLAINED 0.5 /* share of the light */
#define APART     3   /* a camera's misfit over the median, */
#define POOR      0.15 /* and at least this where it has a part: one along a thin flame is apart, too */
#define BAD       0.3 /* misfit that nothing explains, */
#define LOST      0.4 /* and of which nothing is told: 0.34 may be noise */
#define GAIN      1.5
#define FAR       3    /* times the noise, */
#define FAIR      0.05 /* and at least this residual: fair, not good */

/* One camera, over all sets. */
struct sums {
    double light, outside; /* of lit bins with a value; of those whose block misses the volume */
    double bins, lit, flame, full; /* bins; lit ones; lit ones with light, those at full scale */
    double level, low;             /* sums over sets of the DARKEST, of the FLATTEST */
    unsigned sets, same;           /* sets; the last ones that repeat the one before */
};

struct rec_plausible {
    struct rec_rig rig;
    int32_t binning, side[REC_MAX_CAMERAS];
    uint8_t *misses[REC_MAX_CAMERAS]; /* [blocks] */
    struct sums sums[REC_MAX_CAMERAS];
    double residual, noise;
    bool at_least;
    const atomic_bool *stop;
    unsigned residuals, sets, seen; /* seen: sets with flame in two cameras */
    struct rec_blocks *kept;        /* [KEPT][cameras] */
    uint64_t number[KEPT];
    size_t at, n;
    double *block; /* [2 blocks] */
    uint8_t *lit;  /* [blocks] */
};

static const char *const names[REC_N_CAUSES] = {"",        "dark",   "black",  "saturated", "box",
                                                "repeats", "rig",    "turned", "swapped",   "late",
                                                "gain",    "camera", "untold"};

const char *rec_cause_name(enum rec_cause c)
{
    return names[c];
}

static bool plausible_far(const struct rec_plausible_verdict *v)
{
    return v->noise > 0 && v->residual > FAIR && v->residual > FAR * v->noise;
}

const char *rec_plausible_word(const struct rec_plausible_verdict *v)
{
    return v->cause != REC_CAUSE_NONE ? "bad" : plausible_far(v) ? "fair" : "good";
}

void rec_plausible_line(const struct rec_plausible_verdict *v, char line[REC_PLAUSIBLE_LINE])
{
    const bool good = v->cause == REC_CAUSE_NONE, far = good && plausible_far(v);
    char fit[120] = "";
    if (good && v->noise > 0)
        snprintf(fit, sizeof fit, "residual %.1f %% (noise allows %.1f %%)%s ", 100 * v->residual,
                 100 * v->noise, far ? ": calibration or model;" : ",");
    const char *next = good && !far ? "" : v->next;
    snprintf(line, REC_PLAUSIBLE_LINE, "%s: %s%s%s%s", rec_plausible_word(v), fit, v->text,
             next[0] != '\0' ? "; next: " : "", next);
}

/* ---- made and given back ---- */

/* The ray misses the volume, grown by a little. */
static bool plausible_misses(const struct rec_camera *c, const struct rec_grid *g, double u,
                             double v)
{
    double o[3], d[3], from = 0, to = INFINITY;
    if (!rec_camera_ray(c, u, v, o, d))
        return false;
    for (int a = 0; a < 3; a++) {
        double more = GROWN * (g->max[a] - g->min[a]);
        double s = (g->min[a] - more - o[a]) / d[a], e = (g->max[a] + more - o[a]) / d[a];
        from = fmax(from, fmin(s, e));
        to = fmin(to, fmax(s, e));
    }
    return !(from < to);
}

static void plausible_size(const rec_plausible *p, size_t c, int32_t *w, int32_t *h)
{
    const struct rec_camera *k = &p->rig.cameras[c];
    int32_t by = p->side[c] / p->binning;
    *w = (k->width / p->binning + by - 1) / by;
    *h = (k->height / p->binning + by - 1) / by;
}

static pvx_err plausible_make(rec_plausible *p, const struct rec_rig *rig, int32_t binning)
{
    p->binning = binning;
    PVX_TRY(rec_rig_copy(rig, &p->rig));
    p->kept = pvx_calloc(KEPT * rig->n_cameras, sizeof *p->kept);
    p->block = pvx_calloc(REC_COARSE_BLOCKS, 2 * sizeof *p->block);
    p->lit = pvx_calloc(REC_COARSE_BLOCKS, 1);
    PVX_NEED(p->kept);
    PVX_NEED(p->block);
    PVX_NEED(p->lit);
    for (size_t c = 0; c < rig->n_cameras; c++) {
        const struct rec_camera *k = &rig->cameras[c];
        int32_t w, h;
        p->side[c] = rec_blocks_side(k, binning);
        plausible_size(p, c, &w, &h);
        p->misses[c] = pvx_calloc((size_t)(w * h), 1);
        PVX_NEED(p->misses[c]);
        for (int32_t i = 0; i < w * h; i++)
            p->misses[c][i] = plausible_misses(k, &rig->grid, (i % w + 0.5) * p->side[c] - 0.5,
                                               (i / w + 0.5) * p->side[c] - 0.5);
    }
    return PVX_OK;
}

pvx_err rec_plausible_new(const struct rec_rig *rig, int32_t binning, rec_plausible **out)
{
    rec_plausible *p = *out = pvx_calloc(1, sizeof *p);
    PVX_NEED(p);
    pvx_err e = plausible_make(p, rig, binning);
    if (e != PVX_OK)
        rec_plausible_free(out);
    return e;
}

void rec_plausible_free(rec_plausible **pp)
{
    rec_plausible *p = *pp;
    if (p == NULL)
        return;
    for (size_t c = 0; c < p->rig.n_cameras; c++)
        free(p->misses[c]);
    rec_rig_fini(&p->rig);
    free(p->kept);
    free(p->block);
    free(p->lit);
    PVX_FREE(*pp);
}

void rec_plausible_at_least(rec_plausible *p)
{
    p->at_least = true;
}

void rec_plausible_stop(rec_plausible *p, const atomic_bool *stop)
{
    p->stop = stop;
}

void rec_plausible_begin(rec_plausible *p)
{
    memset(p->sums, 0, sizeof p->sums);
    p->residual = p->noise = 0;
    p->residuals = p->sets = p->seen = 0;
    p->at = p->n = 0;
}

/* ---- a set ---- */

/* Reduces a picture to blocks, and adds up what is counted. */
static void plausible_reduce(rec_plausible *p, const struct rec_plausible_set *s, size_t c,
                             struct rec_blocks *k)
{
    const struct rec_camera *q = &p->rig.cameras[c];
    const int32_t bw = q->width / p->binning, bh = q->height / p->binning,
                  by = p->side[c] / p->binning;
    const float *b = s->b[c], *weight = s->weight[c];
    const uint8_t *lit = s->lit[c];
    struct sums *o = &p->sums[c];
    double *all = p->block, *n = p->block + REC_COARSE_BLOCKS;
    const double lit_before = o->lit;
    plausible_size(p, c, &k->w, &k->h);
    const size_t blocks = (size_t)(k->w * k->h);
    memset(k->b, 0, blocks * sizeof *k->b);
    memset(p->lit, 0, blocks);
    memset(all, 0, blocks * sizeof *all);
    memset(n, 0, blocks * sizeof *n);
    for (int32_t y = 0; y < bh; y++)
        for (int32_t x = 0; x < bw; x++) {
            const size_t i = (size_t)y * (size_t)bw + (size_t)x,
                         at = (size_t)(y / by * k->w + x / by);
            float v = 0;
            for (int l = 0; l < s->nch; l++)
                v += b[i * (size_t)s->cs + (size_t)l];
            const bool has = weight == NULL || weight[i] > 0;
            p->lit[at] |= lit[i];
            o->lit += lit[i];
            o->flame += lit[i] && v > 0;
            o->full += lit[i] && v > 0 && !has;
            if (!has)
                continue;
            n[at]++;
            all[at] += (double)v;
            k->b[at] += lit[i] ? v : 0;
        }
    size_t there = 0;
    for (size_t i = 0; i < blocks; i++) {
        k->there[i] = n[i] > 0.5 * by * by;
        o->light += (double)k->b[i];
        o->outside += p->misses[c][i] ? (double)k->b[i] : 0;
        k->b[i] = k->there[i] ? k->b[i] / (float)n[i] : 0;
        if (k->there[i])
            all[there++] = all[i] / (n[i] * s->nch);
    }
    o->bins += (double)bw * bh;
    if (there > 0 && o->lit - lit_before > LIT * bw * bh) {
        qsort(all, there, sizeof *all, pvx_ascending);
        o->level += all[(size_t)(DARKEST * (double)there)];
        o->low += all[(size_t)(FLATTEST * (double)there)];
    }
    rec_blocks_finish(k, p->lit);
}

static bool plausible_same(const struct rec_blocks *a, const struct rec_blocks *b)
{
    return a->some && b->some && memcmp(a->b, b->b, (size_t)(a->w * a->h) * sizeof *a->b) == 0;
}

void rec_plausible_add(rec_plausible *p, const struct rec_plausible_set *s)
{
    const size_t cams = p->rig.n_cameras;
    struct rec_blocks *now = p->kept + p->at * cams;
    const struct rec_blocks *before = p->kept + (p->at + KEPT - 1) % KEPT * cams;
    size_t seen = 0;
    for (size_t c = 0; c < cams; c++) {
        now[c].some = false;
        if (s->b[c] == NULL)
            continue;
        plausible_reduce(p, s, c, &now[c]);
        bool same = p->n > 0 && plausible_same(&now[c], &before[c]);
        p->sums[c].same = same ? p->sums[c].same + 1 : 0;
        p->sums[c].sets++;
        seen += now[c].some;
    }
    p->sets++;
    if (seen < 2)
        return;
    p->seen++;
    if (s->noise > 0) {
        p->residual += s->residual;
        p->noise += s->noise;
        p->residuals++;
    }
    p->number[p->at] = s->number;
    p->at = (p->at + 1) % KEPT;
    p->n += p->n < KEPT;
}

void rec_plausible_add_unseen(rec_plausible *p, const rec_unseen *u, uint64_t number)
{
    struct rec_plausible_set s = {.number = number, .nch = 1, .cs = 1};
    for (size_t c = 0; c < p->rig.n_cameras; c++) {
        if (!rec_unseen_present(u, c))
            continue;
        s.b[c] = rec_unseen_b(u, c);
        s.weight[c] = rec_unseen_weight(u, c);
        s.lit[c] = rec_unseen_lit(u, c);
    }
    rec_plausible_add(p, &s);
}

/* ---- facts ---- */

enum plausible_what { OF_OUTSIDE, OF_LIT, OF_FULL, OF_LEVEL, OF_LOW };

static double plausible_of(const struct sums *s, enum plausible_what what)
{
    switch (what) {
    case OF_OUTSIDE: return s->light > 0 ? s->outside / s->light : 0;
    case OF_LIT: return s->bins > 0 ? s->lit / s->bins : 0;
    case OF_FULL: return s->flame > 0 ? s->full / s->flame : 0;
    case OF_LEVEL: return s->sets > 0 ? s->level / s->sets : 0;
    default: return s->sets > 0 ? s->low / s->sets : 0;
    }
}

/* Median over the cameras that have pictures; *most: the camera with the most. */
static double plausible_median(const rec_plausible *p, enum plausible_what what, size_t *most)
{
    double v[REC_MAX_CAMERAS];
    size_t n = 0;
    *most = 0;
    for (size_t c = 0; c < p->rig.n_cameras; c++) {
        if (p->sums[c].sets == 0)
            continue;
        v[n++] = plausible_of(&p->sums[c], what);
        if (v[n - 1] > plausible_of(&p->sums[*most], what))
            *most = c;
    }
    return n > 0 ? pvx_median(v, n) : 0;
}

/* Most of the pictures counts as flame.  flat: and their dark parts are equal, as a black level is and a flame that
 * fills the pictures is not. */
static bool plausible_black(const rec_plausible *p, bool flat, struct rec_plausible_verdict *o)
{
    size_t most;
    double lit = plausible_median(p, OF_LIT, &most), level = plausible_median(p, OF_LEVEL, &most);
    if (!(lit > LIT && level > 0) || (flat && plausible_median(p, OF_LOW, &most) < FLAT * level))
        return false;
    o->cause = REC_CAUSE_BLACK;
    o->meaningless = flat;
    snprintf(o->text, sizeof o->text,
             "%.0f %% of the pictures counts as flame, and their darkest parts have %.1f %% of "
             "full scale: a black level or a lit scene",
             100 * lit, 100 * level);
    snprintf(o->next, sizeof o->next,
             "--black %.3f (photometry: { black: %.3f }), or --background DIR", level, level);
    return true;
}

static void plausible_facts(const rec_plausible *p, struct rec_plausible_verdict *o)
{
    size_t most;
    double flame = 0, full = 0, light = 0, outside = 0;
    for (size_t c = 0; c < p->rig.n_cameras; c++) {
        flame += p->sums[c].flame;
        full += p->sums[c].full;
        light += p->sums[c].light;
        outside += p->sums[c].outside;
    }
    o->saturated = flame > 0 ? full / flame : 0;
    o->outside = light > 0 ? outside / light : 0;
    o->residual = p->residuals > 0 ? p->residual / p->residuals : 0;
    o->noise = p->residuals > 0 ? p->noise / p->residuals : 0;
    if (p->seen == 0) {
        o->cause = REC_CAUSE_DARK;
        snprintf(o->text, sizeof o->text, "no flame in two cameras of any of %u sets", p->sets);
        snprintf(o->next, sizeof o->next,
                 "take the caps off, expose longer; --threshold, --black and --background decide "
                 "what counts as flame");
    } else if (plausible_black(p, true, o)) {
        return;
    } else if (o->saturated > SATURATED) {
        (void)plausible_median(p, OF_FULL, &most);
        o->cause = REC_CAUSE_SATURATED;
        snprintf(o->text, sizeof o->text,
                 "%.0f %% of the flame is saturated (%s: %.0f %%), so %s in the volume",
                 100 * o->saturated, p->rig.cameras[most].name,
                 100 * plausible_of(&p->sums[most], OF_FULL),
                 p->at_least ? "only its least brightness is known" : "it is too dark");
        snprintf(o->next, sizeof o->next, "expose a quarter as long%s",
                 p->at_least ? ""
                             : "; for these pictures --saturated at-least (model: { saturated: "
                               "at-least })");
    }
}

/* A camera whose picture repeats while those of others change. */
static void plausible_repeats(const rec_plausible *p, struct rec_plausible_verdict *o)
{
    const unsigned least = 3;
    size_t n = 0, cams = 0, which = 0;
    for (size_t c = 0; c < p->rig.n_cameras; c++) {
        cams += p->sums[c].sets > 0;
        if (p->sums[c].same >= least) {
            n++;
            which = c;
            o->cameras |= (uint64_t)1 << c;
        }
    }
    if (n == 0 || n == cams) {
        o->cameras = 0;
        return;
    }
    o->cause = REC_CAUSE_REPEATS;
    snprintf(o->text, sizeof o->text, "%s%s sends the same picture again and again",
             p->rig.cameras[which].name, n > 1 ? " and others" : "");
    snprintf(o->next, sizeof o->next, "look at its trigger and its cable: pyrovox cameras test");
}

/* ---- hypotheses ---- */

static void plausible_cameras(const rec_plausible *p, const struct rec_trials_found *f,
                              const char *rig, const char *frames, struct rec_plausible_verdict *o)
{
    double miss[REC_MAX_CAMERAS], gain[REC_MAX_CAMERAS];
    size_t n = 0, worst = 0, dim = 0;
    for (size_t c = 0; c < p->rig.n_cameras; c++) {
        if (isnan(f->miss[c]))
            continue;
        miss[n] = f->miss[c];
        gain[n++] = f->gain[c];
        worst = !(f->miss[c] <= f->miss[worst]) ? c : worst;
    }
    if (n < 3)
        return;
    double usual = pvx_median(miss, n), bright = pvx_median(gain, n);
    for (size_t c = 0; c < p->rig.n_cameras; c++)
        if (!isnan(f->gain[c]) && fabs(log(f->gain[c] / bright)) > fabs(log(f->gain[dim] / bright)))
            dim = c;
    if (f->cause == REC_CAUSE_CAMERA)
        worst = (size_t)__builtin_ctzll(f->cameras);
    const char *name = p->rig.cameras[worst].name;
    if (f->cause != REC_CAUSE_CAMERA && (f->explained < EXPLAINED || f->now > LOST)) {
        o->cause = REC_CAUSE_UNTOLD;
        snprintf(
            o->text, sizeof o->text,
            "left-out pictures are missed by %.0f %%, one flame explains %.0f %% of the light, and "
            "the cause cannot be told from these pictures",
            100 * sqrt(f->now), 100 * f->explained);
        snprintf(o->next, sizeof o->next, "pyrovox calibrate check --rig %s --frames %s", rig,
                 frames);
    } else if (f->cause == REC_CAUSE_CAMERA ||
               (f->in[worst] > POOR && f->miss[worst] > APART * usual)) {
        o->cause = REC_CAUSE_CAMERA;
        o->cameras = (uint64_t)1 << worst;
        snprintf(o->text, sizeof o->text,
                 "%s contradicts the others, and no single change of the rig explains it", name);
        snprintf(o->next, sizeof o->next,
                 "pyrovox calibrate check --rig %s --frames %s --report check.html", rig, frames);
    } else if (!isnan(f->gain[dim]) && fabs(log(f->gain[dim] / bright)) > log(GAIN)) {
        o->cause = REC_CAUSE_GAIN;
        o->cameras = (uint64_t)1 << dim;
        snprintf(o->text, sizeof o->text, "%s is %.2f times as bright as the others say",
                 p->rig.cameras[dim].name, f->gain[dim] / bright);
        snprintf(o->next, sizeof o->next,
                 "pyrovox calibrate gain --rig %s --flame --frames %s --out with-gains.yaml", rig,
                 frames);
    }
}

/* The flame's light beyond the volume is a fact, whether a larger volume explains all of it or not. */
static void plausible_box(const struct rec_trials_found *f, struct rec_plausible_verdict *o)
{
    char where[REC_PLAUSIBLE_TEXT - 100];
    snprintf(where, sizeof where, "%.400s", f->text);
    o->cause = REC_CAUSE_BOX;
    o->meaningless = o->outside > MUCH || f->now > BAD;
    if (o->outside > OUTSIDE)
        snprintf(o->text, sizeof o->text,
                 "%.0f %% of the flame's light lies on rays that miss the volume%s%.380s",
                 100 * o->outside, where[0] != '\0' ? ": " : "", where);
    else
        snprintf(o->text, sizeof o->text, "the flame is larger than the volume: %.380s", where);
    snprintf(o->next, sizeof o->next, "%s",
             f->next[0] != '\0' ? f->next : "make the volume in rig.yaml larger");
}

static pvx_err plausible_try(rec_plausible *p, const char *rig, const char *frames,
                             struct rec_plausible_verdict *o)
{
    struct rec_trials_set set[KEPT];
    struct rec_trials t = {
        .rig = &p->rig, .binning = p->binning, .n = p->n, .set = set, .stop = p->stop};
    struct rec_trials_found f;
    size_t most;
    for (size_t i = 0; i < p->n; i++) {
        size_t at = (p->at + KEPT - p->n + i) % KEPT;
        set[i] = (struct rec_trials_set){p->number[at], p->kept + at * p->rig.n_cameras};
    }
    t.beyond = o->outside > OUTSIDE && plausible_median(p, OF_OUTSIDE, &most) > 0.5 * OUTSIDE;
    PVX_TRY(rec_trials_run(&t, &f));
    o->before = f.now;
    o->after = f.then;
    if (f.sets == 0)
        return PVX_OK;
    if (f.cause == REC_CAUSE_BOX || (t.beyond && f.cause == REC_CAUSE_NONE)) {
        plausible_box(&f, o);
    } else if (f.cause != REC_CAUSE_NONE && f.cause != REC_CAUSE_CAMERA) {
        o->cause = f.cause;
        o->cameras = f.cameras;
        o->meaningless = f.cameras == 0 && f.now > BAD;
        if (f.then > 0)
            snprintf(o->text, sizeof o->text,
                     "left-out pictures are missed by %.0f %%, and by %.0f %% if %.380s",
                     100 * sqrt(f.now), 100 * sqrt(f.then), f.text);
        else
            snprintf(o->text, sizeof o->text, "%.500s", f.text);
        snprintf(o->next, sizeof o->next, "%s", f.next);
    } else if (o->cause == REC_CAUSE_NONE) {
        plausible_cameras(p, &f, rig, frames, o);
    }
    return PVX_OK;
}

static void plausible_good(const rec_plausible *p, const char *rig, const char *frames,
                           struct rec_plausible_verdict *o)
{
    char fit[80] = "";
    size_t cams = 0;
    for (size_t c = 0; c < p->rig.n_cameras; c++)
        cams += p->sums[c].sets > 0;
    if (o->before > 0)
        snprintf(fit, sizeof fit, ", left-out pictures are missed by %.0f %%",
                 100 * sqrt(o->before));
    snprintf(o->text, sizeof o->text,
             "%zu cameras agree, %.1f %% of the light outside the volume%s", cams, 100 * o->outside,
             fit);
    snprintf(o->next, sizeof o->next, "pyrovox advise --rig %s --frames %s", rig, frames);
}

pvx_err rec_plausible_judge(rec_plausible *p, enum rec_plausible_depth depth, const char *rig_path,
                            const char *frames, struct rec_plausible_verdict *out)
{
    const char *rig = rig_path != NULL ? rig_path : "rig.yaml",
               *from = frames != NULL ? frames : "DIR";
    *out = (struct rec_plausible_verdict){.cause = REC_CAUSE_NONE};
    plausible_facts(p, out);
    if (out->cause == REC_CAUSE_NONE)
        plausible_repeats(p, out);
    if (depth != REC_PLAUSIBLE_FACTS && out->cause != REC_CAUSE_DARK &&
        out->cause != REC_CAUSE_BLACK && out->cause != REC_CAUSE_REPEATS)
        PVX_TRY(plausible_try(p, rig, from, out));
    if (out->cause == REC_CAUSE_UNTOLD)
        (void)plausible_black(p, false, out);
    if (out->cause == REC_CAUSE_NONE)
        plausible_good(p, rig, from, out);
    return PVX_OK;
}
