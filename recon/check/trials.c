#include "recon/check/trials.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "recon/check/lags.h"
#include "recon/geom/blind.h"

#define WIN     0.7   /* of E, where a change is about all cameras */
#define OWN     0.65  /* of the misfit of the cameras that it is about */
#define SHARE   0.5   /* of what that lowers E by, it does lower E by */
#define CLEAR   0.12  /* of the fall of E that any other change leaves */
#define ALL     1.15  /* times as large E counts where all cameras change, */
#define WITHOUT 0.6   /* of E that is left without the camera that is to blame */
#define LESS    1.4   /* or one is left out */
#define LEAST   0.003 /* of a camera's misfit: less is not told apart */
#define BEST    6     /* changes that are judged in full */
#define ROUGH   0.08  /* E from which on R, t and K of all cameras are read in other ways, */
#define LEAVES  0.03  /* and from which on a larger volume is tried */
#define LARGER  1.0   /* sides that a larger volume has more, half of it at each end */
#define EDGE    0.01  /* of the flame's light beyond the volume that is proposed, at each side */

/* A change, and what it leaves. */
struct change {
    enum rec_cause cause;
    uint64_t cameras;
    size_t of[2];    /* cameras; SWAPPED: both */
    int lag;         /* LATE */
    unsigned turned; /* TURNED */
    size_t reading;  /* RIG */
    double was, is;  /* misfit of its own cameras, a mean */
    double gain;     /* what E would fall by if nothing else changed */
    double E;        /* of all; INFINITY: not judged */
};

struct trials {
    const struct rec_trials *t;
    struct rec_trials_found *out;
    size_t n, cams;
    size_t at[REC_TRIALS_SETS]; /* of the sets */
    rec_coarse *coarse;
    struct rec_places **base, **other; /* [cams] */
    int32_t side[REC_MAX_CAMERAS];
    struct change best[BEST + 2]; /* and CAMERA, BOX */
    size_t n_best;
};

static const struct rec_blocks *trials_picture(const struct trials *k, size_t s, size_t c)
{
    const struct rec_blocks *b = &k->t->set[k->at[s]].picture[c];
    return b->some ? b : NULL;
}

const struct rec_blocks *rec_trials_later(const struct rec_trials *t, size_t i, size_t c, int lag)
{
    for (size_t j = 0; j < t->n; j++)
        if (t->set[j].number == t->set[i].number + (uint64_t)(int64_t)lag)
            return t->set[j].picture[c].some ? &t->set[j].picture[c] : NULL;
    return NULL;
}

static const struct rec_blocks *trials_later(const struct trials *k, size_t s, size_t c, int lag)
{
    return rec_trials_later(k->t, k->at[s], c, lag);
}

static void trials_belief(const struct trials *k, size_t s, struct rec_belief *w)
{
    for (size_t c = 0; c < k->cams; c++) {
        w->at[c] = k->base[c];
        w->picture[c] = trials_picture(k, s, c);
    }
}

/* Keeps a change if it is among the best so far, the best one for its cameras.  of: cameras that it is about. */
static void trials_keep(struct trials *k, struct change *h, double of)
{
    size_t at = k->n_best;
    h->gain = (h->was - h->is) * of / (double)k->cams;
    if (!(h->is < OWN * h->was) || h->was - h->is < LEAST)
        return;
    for (size_t i = 0; i < k->n_best; i++)
        if (k->best[i].cameras == h->cameras && k->best[i].cause == h->cause) {
            if (h->gain > k->best[i].gain)
                k->best[i] = *h;
            return;
        }
    for (size_t i = 0; i < k->n_best && k->n_best == BEST; i++)
        if (k->best[i].gain < h->gain && (at == BEST || k->best[i].gain < k->best[at].gain))
            at = i;
    if (at == BEST)
        return;
    k->best[at] = *h;
    k->n_best += at == k->n_best;
}

/* ---- what one camera is about ---- */

/* A change over the sets. */
struct single {
    struct change h;
    unsigned sets, better;
};

static void single_add(struct single *o, double was, double is)
{
    o->h.was += was;
    o->h.is += is;
    o->sets++;
    o->better += is < was;
}

/* It has to be better in every set.  of: how many cameras its misfits are sums of. */
static void single_keep(struct trials *k, struct single *o, double of)
{
    if (o->sets == 0 || o->better < o->sets)
        return;
    o->h.was /= o->sets * of;
    o->h.is /= o->sets * of;
    trials_keep(k, &o->h, of);
}

static void single_keep_of(struct trials *k, struct single *o, enum rec_cause cause, size_t c)
{
    o->h.cause = cause;
    o->h.cameras = (uint64_t)1 << c;
    o->h.of[0] = o->h.of[1] = c;
    single_keep(k, o, 1);
}

/* Camera c against the volumes of the others: as it is, and with each change that is about it alone. */
static void trials_camera(struct trials *k, size_t c, struct rec_camera *as)
{
    enum { LAGS = 2 * REC_TRIALS_LATE + 1 };
    struct single turn[4] = {{.sets = 0}}, late[LAGS] = {{.sets = 0}};
    struct single *read = pvx_calloc(REC_READINGS, sizeof *read);
    char text[REC_PLAUSIBLE_TEXT];
    double miss = 0, gain = 0, sets = 0;
    for (size_t s = 0; s < k->n; s++) {
        struct rec_belief w;
        const struct rec_blocks *b = trials_picture(k, s, c);
        double g;
        if (b == NULL)
            continue;
        trials_belief(k, s, &w);
        w.picture[c] = NULL;
        (void)rec_coarse_solve(k->coarse, &w);
        double e = rec_coarse_miss(k->coarse, k->base[c], b, &g);
        miss += e;
        gain += g > 0 ? log(g) : 0;
        sets++;
        for (unsigned t = 1; t < 4; t++) {
            rec_places_find(k->coarse, &k->t->rig->cameras[c], k->side[c], t, true, k->other[c]);
            single_add(&turn[t], e, rec_coarse_miss(k->coarse, k->other[c], b, NULL));
        }
        for (int lag = -REC_TRIALS_LATE; lag <= REC_TRIALS_LATE; lag++) {
            const struct rec_blocks *then = trials_later(k, s, c, lag);
            if (then != NULL && lag != 0)
                single_add(&late[lag + REC_TRIALS_LATE], e,
                           rec_coarse_miss(k->coarse, k->base[c], then, NULL));
        }
        for (size_t i = 0; i < REC_READINGS && read != NULL; i++) {
            if (rec_blind_reading(k->t->rig, i, as, text, sizeof text) != 1)
                continue;
            rec_places_find(k->coarse, &as[c], k->side[c], 0, true, k->other[c]);
            single_add(&read[i], e, rec_coarse_miss(k->coarse, k->other[c], b, NULL));
        }
    }
    k->out->miss[c] = sets > 0 ? miss / sets : (double)NAN;
    k->out->gain[c] = sets > 0 ? exp(gain / sets) : (double)NAN;
    for (unsigned t = 1; t < 4; t++) {
        turn[t].h.turned = t;
        single_keep_of(k, &turn[t], REC_CAUSE_TURNED, c);
    }
    for (int i = 0; i < LAGS; i++) {
        late[i].h.lag = i - REC_TRIALS_LATE;
        if (late[i].sets > 1 ||
            late[i].h.is < OWN * OWN * late[i].h.was) /* by chance, in one set */
            single_keep_of(k, &late[i], REC_CAUSE_LATE, c);
    }
    for (size_t i = 0; i < REC_READINGS && read != NULL; i++) {
        read[i].h.reading = i;
        single_keep_of(k, &read[i], REC_CAUSE_RIG, c);
    }
    free(read);
}

/* ---- two cameras ---- */

/* Both are in the worse half. */
static bool trials_may_swap(const struct trials *k, size_t a, size_t b)
{
    const struct rec_camera *q = &k->t->rig->cameras[a], *r = &k->t->rig->cameras[b];
    size_t worse[2] = {0, 0};
    for (size_t c = 0; c < k->cams; c++) {
        worse[0] += k->out->miss[c] > k->out->miss[a];
        worse[1] += k->out->miss[c] > k->out->miss[b];
    }
    return q->width == r->width && q->height == r->height && 2 * worse[0] <= k->cams &&
           2 * worse[1] <= k->cams && !isnan(k->out->miss[a]) && !isnan(k->out->miss[b]);
}

static void trials_pair(struct trials *k, size_t a, size_t b)
{
    struct single o = {.sets = 0};
    for (size_t s = 0; s < k->n; s++) {
        struct rec_belief w;
        const struct rec_blocks *p = trials_picture(k, s, a), *q = trials_picture(k, s, b);
        if (p == NULL || q == NULL)
            continue;
        trials_belief(k, s, &w);
        w.picture[a] = w.picture[b] = NULL;
        (void)rec_coarse_solve(k->coarse, &w);
        single_add(&o,
                   rec_coarse_miss(k->coarse, k->base[a], p, NULL) +
                       rec_coarse_miss(k->coarse, k->base[b], q, NULL),
                   rec_coarse_miss(k->coarse, k->base[a], q, NULL) +
                       rec_coarse_miss(k->coarse, k->base[b], p, NULL));
    }
    o.h.cause = REC_CAUSE_SWAPPED;
    o.h.cameras = (uint64_t)1 << a | (uint64_t)1 << b;
    o.h.of[0] = a;
    o.h.of[1] = b;
    single_keep(k, &o, 2);
}

/* ---- E, and all cameras ---- */

/* E of a belief that `change` makes of each set's. */
static double trials_judge(struct trials *k, rec_coarse *coarse,
                           void (*change)(const struct trials *, size_t, const struct change *,
                                          struct rec_belief *),
                           const struct change *h, bool alone, size_t sets)
{
    double sum = 0, n = 0;
    for (size_t s = 0; s < sets && s < k->n; s++) {
        struct rec_belief w;
        trials_belief(k, s, &w);
        if (change != NULL)
            change(k, s, h, &w);
        if (h != NULL && h->cause == REC_CAUSE_LATE && trials_later(k, s, h->of[0], h->lag) == NULL)
            continue; /* there is no set so much later */
        if (!alone)
            (void)rec_coarse_solve(coarse, &w);
        for (size_t c = 0; c < k->cams; c++) {
            const struct rec_blocks *b = w.picture[c];
            if (b == NULL)
                continue;
            if (alone) {
                w.picture[c] = NULL;
                (void)rec_coarse_solve(coarse, &w);
                w.picture[c] = b;
            }
            sum += rec_coarse_miss(coarse, w.at[c], b, NULL);
            n++;
        }
    }
    return n > 0 ? sum / n : 1;
}

static void trials_apply(const struct trials *k, size_t s, const struct change *h,
                         struct rec_belief *w)
{
    for (size_t c = 0; c < k->cams; c++) {
        bool about = h->cameras == 0 || (h->cameras >> c & 1) != 0;
        if (about && (h->cause == REC_CAUSE_TURNED || h->cause == REC_CAUSE_RIG ||
                      h->cause == REC_CAUSE_BOX))
            w->at[c] = k->other[c];
        if (about && h->cause == REC_CAUSE_CAMERA)
            w->picture[c] = NULL;
        if (about && h->cause == REC_CAUSE_LATE)
            w->picture[c] = trials_later(k, s, c, h->lag);
    }
    if (h->cause == REC_CAUSE_SWAPPED) {
        const struct rec_blocks *p = w->picture[h->of[0]];
        w->picture[h->of[0]] = w->picture[h->of[1]];
        w->picture[h->of[1]] = p;
    }
}

/* Places of the cameras with the change, into other. */
static void trials_place(struct trials *k, const struct change *h, struct rec_camera *as)
{
    char text[REC_PLAUSIBLE_TEXT];
    for (size_t c = 0; c < k->cams; c++)
        as[c] = k->t->rig->cameras[c];
    if (h->cause == REC_CAUSE_RIG)
        (void)rec_blind_reading(k->t->rig, h->reading, as, text, sizeof text);
    for (size_t c = 0; c < k->cams; c++)
        if (h->cameras == 0 || (h->cameras >> c & 1) != 0)
            rec_places_find(k->coarse, &as[c], k->side[c], h->turned, false, k->other[c]);
}

static void trials_all(struct trials *k, struct rec_camera *as)
{
    char text[REC_PLAUSIBLE_TEXT];
    const double now = trials_judge(k, k->coarse, NULL, NULL, false, 2);
    struct change h = {.cause = REC_CAUSE_TURNED, .was = now};
    for (h.turned = 1; h.turned < 4; h.turned++) {
        trials_place(k, &h, as);
        h.is = trials_judge(k, k->coarse, trials_apply, &h, false, 2);
        trials_keep(k, &h, (double)k->cams);
    }
    h = (struct change){.cause = REC_CAUSE_RIG, .was = now};
    for (h.reading = 0; h.reading < REC_READINGS && k->out->now > ROUGH; h.reading++) {
        int changes = rec_blind_reading(k->t->rig, h.reading, as, text, sizeof text);
        if (changes == 0 || changes > 2)
            continue;
        trials_place(k, &h, as);
        h.is = trials_judge(k, k->coarse, trials_apply, &h, false, 1);
        h.is *= changes > 1 ? 1.1 : 1; /* the simpler one, if they are alike */
        trials_keep(k, &h, (double)k->cams);
    }
}

/* Without the camera of the largest misfit: if that is as good, no other camera is to blame. */
static void trials_without(struct trials *k)
{
    size_t c = 0;
    for (size_t i = 1; i < k->cams; i++)
        c = k->out->miss[i] > k->out->miss[c] || isnan(k->out->miss[c]) ? i : c;
    struct change h = {.cause = REC_CAUSE_CAMERA, .cameras = (uint64_t)1 << c, .of = {c, c}};
    h.E = trials_judge(k, k->coarse, trials_apply, &h, true, REC_TRIALS_SETS);
    k->best[k->n_best++] = h;
}

/* ---- a larger volume ---- */

static void trials_free_places(struct rec_places **at, size_t n)
{
    for (size_t c = 0; c < n && at != NULL; c++)
        free(at[c]);
    free(at);
}

/* Places of n cameras for this grid.  NULL: no memory. */
static struct rec_places **trials_new_places(const rec_coarse *coarse, size_t n)
{
    struct rec_places **at = pvx_calloc(n, sizeof(struct rec_places *));
    for (size_t c = 0; c < n && at != NULL; c++)
        if ((at[c] = rec_places_new(coarse)) == NULL) {
            trials_free_places(at, c);
            return NULL;
        }
    return at;
}

/* A grid of this box, with the places of all cameras in k->other; the ones before are freed. */
static pvx_err trials_grid(struct trials *k, const struct rec_grid *box, int least,
                           rec_coarse **out)
{
    PVX_TRY(rec_coarse_new(box, k->cams, least, out));
    rec_coarse_stop(*out, k->t->stop);
    trials_free_places(k->other, k->cams);
    k->other = trials_new_places(*out, k->cams);
    PVX_NEED(k->other);
    for (size_t c = 0; c < k->cams; c++)
        rec_places_find(*out, &k->t->rig->cameras[c], k->side[c], 0, false, k->other[c]);
    return PVX_OK;
}

static void trials_reach(struct trials *k, rec_coarse *large)
{
    for (size_t s = 0; s < k->n; s++) {
        double min[3], max[3];
        struct rec_belief w;
        trials_belief(k, s, &w);
        for (size_t c = 0; c < k->cams; c++)
            w.at[c] = k->other[c];
        (void)rec_coarse_solve(large, &w);
        rec_coarse_extent(large, EDGE, min, max);
        for (int a = 0; a < 3; a++) {
            k->out->min[a] = fmin(k->out->min[a], min[a]);
            k->out->max[a] = fmax(k->out->max[a], max[a]);
        }
    }
}

static pvx_err trials_box(struct trials *k)
{
    struct rec_grid box = k->t->rig->grid;
    rec_coarse *large = NULL, *fit = NULL;
    for (int a = 0; a < 3; a++) {
        double more = 0.5 * LARGER * (box.max[a] - box.min[a]);
        k->out->min[a] = box.min[a];
        k->out->max[a] = box.max[a];
        box.min[a] -= more;
        box.max[a] += more;
    }
    pvx_err e = trials_grid(k, &box, (int)k->cams / 2 + 1, &large);
    if (e == PVX_OK)
        trials_reach(k, large);
    for (int a = 0; a < 3; a++) {
        box.min[a] = k->out->min[a];
        box.max[a] = k->out->max[a];
    }
    PVX_THEN(e, trials_grid(k, &box, 2, &fit));
    if (e == PVX_OK) {
        struct change h = {.cause = REC_CAUSE_BOX, .was = k->out->now};
        h.E = trials_judge(k, fit, trials_apply, &h, true, REC_TRIALS_SETS);
        k->best[k->n_best++] = h;
    }
    rec_coarse_free(&large);
    rec_coarse_free(&fit);
    return e;
}

/* ---- the winner ---- */

static const char *const turns[] = {"", "mirrored left to right", "mirrored top to bottom",
                                    "turned by 180 degrees"};

static void trials_say_box(const struct trials *k, struct rec_trials_found *o)
{
    const struct rec_grid *g = &k->t->rig->grid;
    size_t n = 0, m = 0;
    for (int a = 0; a < 3; a++) {
        const double edge[2] = {o->min[a], o->max[a]}, is[2] = {g->min[a], g->max[a]};
        for (int i = 0; i < 2; i++) {
            double step = 0.05 * (g->max[a] - g->min[a]),
                   tried = fabs(edge[i] - is[i]) / (0.5 * LARGER * (g->max[a] - g->min[a]));
            if (fabs(edge[i] - is[i]) < 1e-9)
                continue;
            double to = i == 0 ? floor(edge[i] / step) * step : ceil(edge[i] / step) * step;
            n += (size_t)snprintf(o->text + n, sizeof o->text - n, "%s%s%c = %.3g",
                                  n > 0 ? ", " : "the flame reaches ",
                                  tried > 1 - 1e-6 ? "beyond " : "", 'x' + a, edge[i]);
            m += (size_t)snprintf(o->next + m, sizeof o->next - m, "%s %c %s %.3g",
                                  m > 0 ? "," : "in rig.yaml make", 'x' + a,
                                  i == 0 ? "of min at most" : "of max at least", to);
        }
    }
}

static void trials_say_reading(const struct trials *k, const struct change *h,
                               struct rec_camera *as, struct rec_trials_found *o)
{
    char text[REC_PLAUSIBLE_TEXT];
    const size_t c = h->of[0];
    const struct rec_camera *q = &as[c], *was = &k->t->rig->cameras[c];
    size_t m = 0;
    (void)rec_blind_reading(k->t->rig, h->reading, as, text, sizeof text);
    snprintf(o->text, sizeof o->text, "%.400s%s%s", text + (strncmp(text, "if ", 3) == 0 ? 3 : 0),
             h->cameras != 0 ? " in " : "", h->cameras != 0 ? was->name : "");
    m += (size_t)snprintf(o->next, sizeof o->next, "in rig.yaml%s %s has",
                          h->cameras != 0 ? "" : ", of all cameras alike,", was->name);
    if (memcmp(q->R, was->R, sizeof q->R) != 0)
        m += (size_t)snprintf(o->next + m, sizeof o->next - m,
                              " R: [%.6g, %.6g, %.6g, %.6g, %.6g, %.6g, %.6g, %.6g, %.6g]", q->R[0],
                              q->R[1], q->R[2], q->R[3], q->R[4], q->R[5], q->R[6], q->R[7],
                              q->R[8]);
    if (memcmp(q->t, was->t, sizeof q->t) != 0)
        m += (size_t)snprintf(o->next + m, sizeof o->next - m, " t: [%.6g, %.6g, %.6g]", q->t[0],
                              q->t[1], q->t[2]);
    if (q->fx != was->fx || q->fy != was->fy)
        snprintf(o->next + m, sizeof o->next - m, " K: [%.6g, %.6g, %.6g, %.6g]", q->fx, q->fy,
                 q->cx, q->cy);
}

static void trials_say(const struct trials *k, const struct change *h, struct rec_camera *as,
                       struct rec_trials_found *o)
{
    const char *a = k->t->rig->cameras[h->of[0]].name, *b = k->t->rig->cameras[h->of[1]].name;
    o->cause = h->cause;
    o->cameras = h->cameras;
    o->then = h->E;
    if (h->cause == REC_CAUSE_BOX)
        trials_say_box(k, o);
    else if (h->cause == REC_CAUSE_RIG)
        trials_say_reading(k, h, as, o);
    else if (h->cause == REC_CAUSE_SWAPPED) {
        snprintf(o->text, sizeof o->text, "the pictures of %s and %s are swapped", a, b);
        snprintf(o->next, sizeof o->next,
                 "exchange what rig.yaml says of %s and %s, all but the names, or their cables", a,
                 b);
    } else if (h->cause == REC_CAUSE_LATE) {
        snprintf(o->text, sizeof o->text, "the pictures of %s are %d frame%s %s", a, abs(h->lag),
                 abs(h->lag) == 1 ? "" : "s", h->lag > 0 ? "late" : "early");
        snprintf(o->next, sizeof o->next,
                 "look at trigger and clock of %s: pyrovox cameras test; number its files by %+d",
                 a, -h->lag);
    } else if (h->cameras == 0) {
        snprintf(o->text, sizeof o->text, "all pictures are %s", turns[h->turned]);
        snprintf(o->next, sizeof o->next,
                 "switch ReverseX and ReverseY of the cameras off, or turn the files back");
    } else {
        snprintf(o->text, sizeof o->text, "the picture of %s is %s", a, turns[h->turned]);
        snprintf(o->next, sizeof o->next,
                 "switch ReverseX and ReverseY of %s off, or turn its files back", a);
    }
}

/* They change the same cameras, or the one is the other for all cameras. */
static bool trials_alike(const struct change *a, const struct change *b)
{
    return (a->cameras == b->cameras && a->cameras != 0) || a == b ||
           (a->cause == b->cause && a->cause == REC_CAUSE_RIG &&
            (a->cameras == 0 || b->cameras == 0));
}

/* The simpler of two that leave as little is believed, and one that explains a camera. */
static double trials_weight(const struct change *h)
{
    return h->cause == REC_CAUSE_CAMERA                   ? LESS
           : h->cameras == 0 && h->cause != REC_CAUSE_BOX ? ALL
                                                          : 1;
}

static void trials_conclude(struct trials *k, struct rec_camera *as)
{
    struct rec_trials_found *o = k->out;
    const struct change *first = NULL;
    double second = o->now;
    for (size_t i = 0; i < k->n_best; i++) {
        const struct change *h = &k->best[i];
        if (first == NULL || trials_weight(h) * h->E < trials_weight(first) * first->E)
            first = h;
    }
    for (size_t i = 0; i < k->n_best && first != NULL; i++)
        if (!trials_alike(&k->best[i], first))
            second = fmin(second, k->best[i].E);
    if (first != NULL && first->cause == REC_CAUSE_CAMERA && first->E < WITHOUT * o->now) {
        o->cause = first->cause;
        o->cameras = first->cameras;
    }
    if (first == NULL || first->cause == REC_CAUSE_CAMERA ||
        o->now - first->E < SHARE * first->gain ||
        (first->cameras == 0 && first->E > WIN * o->now) ||
        second - first->E < CLEAR * (o->now - first->E))
        return;
    trials_say(k, first, as, o);
}

static pvx_err trials_run(struct trials *k, struct rec_camera *as)
{
    double sum = 0, n = 0, seen[REC_MAX_CAMERAS] = {0};
    struct rec_belief w;
    for (size_t c = 0; c < k->cams; c++)
        rec_places_find(k->coarse, &k->t->rig->cameras[c], k->side[c], 0, false, k->base[c]);
    for (size_t s = 0; s < k->n; s++) {
        trials_belief(k, s, &w);
        k->out->explained += rec_coarse_solve(k->coarse, &w) / (double)k->n;
        for (size_t c = 0; c < k->cams; c++)
            if (w.picture[c] != NULL) {
                k->out->in[c] += rec_coarse_miss(k->coarse, k->base[c], w.picture[c], NULL);
                seen[c]++;
            }
    }
    for (size_t c = 0; c < k->cams; c++)
        k->out->in[c] = seen[c] > 0 ? k->out->in[c] / seen[c] : (double)NAN;
    for (size_t c = 0; c < k->cams; c++) {
        trials_camera(k, c, as);
        sum += isnan(k->out->miss[c]) ? 0 : k->out->miss[c];
        n += !isnan(k->out->miss[c]);
    }
    k->out->now = n > 0 ? sum / n : 0;
    for (size_t a = 0; a < k->cams; a++)
        for (size_t b = a + 1; b < k->cams; b++)
            if (trials_may_swap(k, a, b))
                trials_pair(k, a, b);
    trials_all(k, as);
    for (size_t i = 0; i < k->n_best; i++) {
        struct change *h = &k->best[i];
        trials_place(k, h, as);
        h->E = trials_judge(k, k->coarse, trials_apply, h, true, REC_TRIALS_SETS);
        if (h->cause == REC_CAUSE_LATE) /* as if of all sets */
            h->E += k->out->now - trials_judge(k, k->coarse, NULL, h, true, REC_TRIALS_SETS);
    }
    trials_without(k);
    PVX_TRY(k->out->now > LEAVES || k->t->beyond ? trials_box(k) : PVX_OK);
    trials_conclude(k, as);
    const struct rec_lags lags = {k->t, k->coarse, k->base};
    if (k->out->cause == REC_CAUSE_NONE && k->t->beyond)
        trials_say_box(k, k->out);
    else if (k->out->cause == REC_CAUSE_NONE)
        rec_lags_find(&lags, k->out);
    return PVX_OK;
}

/* Sets with the flame in three cameras, and in as many as any other set, evenly spread. */
static void trials_choose(struct trials *k)
{
    size_t good[REC_TRIALS_MOST], n = 0, most = 3;
    for (size_t i = 0; i < k->t->n; i++) {
        size_t seen = 0;
        for (size_t c = 0; c < k->cams; c++)
            seen += k->t->set[i].picture[c].some;
        if (seen > most)
            n = 0;
        if (seen >= most)
            good[n++] = i;
        most = seen > most ? seen : most;
    }
    for (size_t i = 0; i < REC_TRIALS_SETS && n > 0; i++) {
        size_t at = good[(2 * i + 1) * n / (2 * REC_TRIALS_SETS)];
        if (k->n == 0 || k->at[k->n - 1] != at)
            k->at[k->n++] = at;
    }
}

pvx_err rec_trials_run(const struct rec_trials *t, struct rec_trials_found *out)
{
    const size_t cams = t->rig->n_cameras;
    struct trials k = {.t = t, .out = out, .cams = cams};
    struct rec_camera *as = pvx_calloc(cams, sizeof *as);
    memset(out, 0, sizeof *out);
    pvx_err e = as == NULL ? PVX_ENOMEM : rec_coarse_new(&t->rig->grid, cams, 2, &k.coarse);
    if (e == PVX_OK) {
        k.base = trials_new_places(k.coarse, cams);
        k.other = trials_new_places(k.coarse, cams);
        e = k.base == NULL || k.other == NULL ? PVX_ENOMEM : PVX_OK;
    }
    for (size_t c = 0; c < cams; c++)
        k.side[c] = rec_blocks_side(&t->rig->cameras[c], t->binning);
    if (e == PVX_OK) {
        rec_coarse_stop(k.coarse, t->stop);
        trials_choose(&k);
        out->sets = k.n;
        e = k.n > 0 ? trials_run(&k, as) : PVX_OK;
    }
    trials_free_places(k.base, cams);
    trials_free_places(k.other, cams);
    free(as);
    rec_coarse_free(&k.coarse);
    return e == PVX_OK && t->stop != NULL && atomic_load(t->stop) ? PVX_ECANCELED : e;
}
