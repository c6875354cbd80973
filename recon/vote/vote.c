#include "recon/vote/vote.h"

#include <math.h>
#include <string.h>

#include "base/median.h"
#include "recon/vote/impl.h"

/* Constants of (3) of vote.h. */
#define ALONE        REC_VOTE_ALONE
#define SECOND       1.25
#define NOISE        0.5
#define BACK         0.5  /* a camera that was out agrees below this share of (3) */
#define TORN         0.1  /* no healthy camera ever came near this G */
#define DAZZLED      0.5  /* a camera with more than this share of its bins saturated is flooded, */
#define CLEAR        0.1  /* if the median share of the cameras is at most this */
#define LEAST_SWEEPS 2    /* sweeps from zero if all cameras fit after them, */
#define MOST_SWEEPS  3    /* otherwise */
#define MOST_GAIN    1.75 /* factor of a gain that the solve corrects, either way, */
#define REGAINED     0.5  /* if at most this share of the misfit is left then */
#define FURTHER      6    /* iterations after the sweeps, for all cameras and without each */

static const char *const state_names[REC_N_VOTE_STATES] = {
    [REC_VOTE_NONE] = "none",   [REC_VOTE_FEW] = "few", [REC_VOTE_DARK] = "dark",
    [REC_VOTE_AGREE] = "agree", [REC_VOTE_OUT] = "out", [REC_VOTE_TORN] = "torn",
};
const char *rec_vote_state_name(enum rec_vote_state s)
{
    return state_names[s];
}

static uint64_t bit(size_t c)
{
    return (uint64_t)1 << c;
}

/* Cameras that take part, except those in `without`. */
static uint64_t vote_believed(const rec_vote *v, uint64_t without)
{
    uint64_t all = 0;
    for (size_t c = 0; c < v->cameras; c++)
        all |= v->set->present[c] ? bit(c) : 0;
    return all & ~without;
}
static int vote_count(uint64_t set)
{
    return __builtin_popcountll(set);
}

/* Median of `value` over the cameras of a set. */
static double vote_median_of(const rec_vote *v, uint64_t set, const double *value)
{
    double some[REC_MAX_CAMERAS];
    size_t n = 0;
    for (size_t c = 0; c < v->cameras; c++)
        if (rec_vote_has(set, c))
            some[n++] = value[c];
    return n > 0 ? pvx_median(some, n) : 0;
}

/* R of a trial over the cameras of a set. */
static double misfit_of(const rec_vote *v, const struct rec_trial *t, uint64_t set)
{
    double sum = 0;
    for (size_t c = 0; c < v->cameras; c++)
        sum += rec_vote_has(set, c) ? t->misfit[c] : 0;
    return sum;
}

/* The costs (2) of every camera in trial 0. */
struct ballot {
    uint64_t voters;
    double cost[REC_MAX_CAMERAS];
    size_t top;
    double second; /* the second greatest cost */
    size_t trial[REC_MAX_CAMERAS];
};
static void take_ballot(rec_vote *v, struct ballot *b)
{
    struct rec_trial *all = &v->trial[0];
    size_t n = 1;
    *b = (struct ballot){.voters = vote_believed(v, all->without)};
    all->iterations = FURTHER;
    for (size_t c = 0; c < v->cameras; c++)
        if (rec_vote_has(b->voters, c)) {
            struct rec_trial *t = &v->trial[n];
            t->without = all->without | bit(c);
            t->iterations = FURTHER;
            memcpy(t->x, all->x, (size_t)v->sub->n * sizeof *t->x);
            b->trial[c] = n++;
        }
    rec_vote_solve(v, 0, n);
    double r = misfit_of(v, all, b->voters), top = -INFINITY;
    b->second = -INFINITY;
    for (size_t c = 0; c < v->cameras; c++) {
        if (!rec_vote_has(b->voters, c))
            continue;
        double rest = misfit_of(v, &v->trial[b->trial[c]], b->voters & ~bit(c));
        b->cost[c] = (r - rest - v->after_k[c] * v->of[c].noise) / v->unit;
        if (b->cost[c] > top) {
            b->second = top;
            top = b->cost[c];
            b->top = c;
        } else if (b->cost[c] > b->second) {
            b->second = b->cost[c];
        }
    }
}

/* The limit (3) for the cost of camera c. */
static double limit(const rec_vote *v, const struct ballot *b, size_t c)
{
    double next = c == b->top ? b->second : b->cost[b->top];
    return ALONE + SECOND * (next > 0 ? next : 0) +
           NOISE * v->after_k[c] * v->of[c].noise / v->unit;
}
static bool stands_out(const rec_vote *v, const struct ballot *b)
{
    return b->cost[b->top] > limit(v, b, b->top);
}

/* Notes which cameras would come back. */
static void note_agreement(rec_vote *v, const struct ballot *b)
{
    for (size_t c = 0; c < v->cameras; c++) {
        bool agrees = rec_vote_has(b->voters, c) && b->cost[c] < BACK * limit(v, b, c);
        v->agree = (v->agree & ~bit(c)) | (agrees ? bit(c) : 0);
    }
}

/* Fast path: no camera can exceed (3) when R of all cameras together does not. */
static bool calm(const rec_vote *v, const struct rec_trial *t)
{
    uint64_t all = vote_believed(v, t->without);
    double least = v->unit;
    for (size_t c = 0; c < v->cameras; c++)
        if (rec_vote_has(all, c) && v->after_k[c] * v->of[c].noise < least)
            least = v->after_k[c] * v->of[c].noise;
    least *= 1 + NOISE;
    return misfit_of(v, t, all) <= ALONE * v->unit + least;
}

/* Cameras of a set, the brightest first, independent of their order in the rig. */
static size_t by_light(const rec_vote *v, uint64_t set, size_t *order)
{
    size_t n = 0;
    for (size_t c = 0; c < v->cameras; c++) {
        if (!rec_vote_has(set, c))
            continue;
        size_t k = n++;
        for (; k > 0 && v->of[order[k - 1]].signal < v->of[c].signal; k--)
            order[k] = order[k - 1];
        order[k] = c;
    }
    return n;
}

/* Starts trial 0 from x = 0. */
static void vote_begin(rec_vote *v, uint64_t without)
{
    struct rec_trial *t = &v->trial[0];
    size_t order[REC_MAX_CAMERAS], n = by_light(v, vote_believed(v, without), order);
    t->without = without;
    memset(t->x, 0, (size_t)v->sub->n * sizeof *t->x);
    for (int k = 0; k < MOST_SWEEPS; k++) {
        rec_vote_sweep(v, order, n);
        if (k < LEAST_SWEEPS - 1)
            continue;
        rec_vote_judge(v);
        if (calm(v, t))
            return;
    }
}

static void vote_leave_out(rec_vote *v, struct rec_verdict *o, const struct ballot *b, size_t c)
{
    struct rec_trial *t = &v->trial[b->trial[c]];
    o->out |= bit(c);
    o->why[c] = (uint8_t)rec_vote_cause(v, t, c);
    o->cost[c] = (float)b->cost[c];
    /* this trial becomes trial 0 */
    struct rec_trial all = v->trial[0];
    v->trial[0] = *t;
    *t = all;
}

/* If camera c differs from the others most of all by a gain that the solve can correct, divides its picture by it. */
static bool vote_regain(rec_vote *v, const struct ballot *b, size_t c)
{
    double rest, gain = rec_vote_gain(v, &v->trial[b->trial[c]], c, &rest);
    if (!v->set->gains || rest > REGAINED || gain * MOST_GAIN < 1 || gain > MOST_GAIN)
        return false;
    for (size_t i = v->level->row0[c]; i < v->level->row0[c + 1]; i++)
        v->b[i] *= (float)(1 / gain);
    return true;
}

/* Two wrong cameras can hide each other.  Candidates are the camera of the greatest cost and the one that stands out
 * without it.  Both go out if the first stands out without the second too.  Otherwise *o stays and trial 0 begins
 * anew. */
static bool two_at_once(rec_vote *v, struct rec_verdict *o, const struct ballot *b)
{
    const uint64_t without = v->trial[0].without;
    struct rec_verdict first = *o, both;
    struct ballot one, other;
    vote_leave_out(v, &first, b, b->top);
    take_ballot(v, &one);
    if (stands_out(v, &one)) {
        both = first;
        vote_leave_out(v, &both, &one, one.top);
        vote_begin(v, without | bit(one.top));
        take_ballot(v, &other);
        if (other.top == b->top && stands_out(v, &other)) {
            vote_leave_out(v, &both, &other, other.top);
            *o = both;
            return true;
        }
    }
    vote_begin(v, without);
    return false;
}

/* R over the cameras in trial 0, over P. */
static double rest_of(const rec_vote *v)
{
    return misfit_of(v, &v->trial[0], vote_believed(v, v->trial[0].without)) / v->unit;
}

/* With `hold`: whether this set can do without testing every camera.  Trial 0 then omits the cameras that are out. */
static bool as_before(rec_vote *v, struct rec_verdict *o)
{
    uint64_t held = v->out & vote_believed(v, o->out), rest = vote_believed(v, v->out | o->out);
    vote_begin(v, v->out | o->out);
    if (vote_count(rest) < 3)
        return false;
    double r = rest_of(v);
    bool fits = calm(v, &v->trial[0]);
    bool news = (o->out & ~v->out) != 0;
    if (news || ((!fits || held != 0) && !rec_vote_may_wait(v, fits ? 0 : r))) {
        v->usual = r;
        return false;
    }
    o->state = fits ? REC_VOTE_AGREE : v->state;
    o->misfit = (float)(r / vote_count(rest));
    return true;
}

/* Puts cameras out one after the other, at most (voters - 2) / 2 of them. */
static void decide(rec_vote *v, struct rec_verdict *o)
{
    uint64_t dazzled = o->out, regained = 0;
    v->agree = ~dazzled;
    int voters = vote_count(vote_believed(v, 0)), most = (voters - 2) / 2;
    if (v->hold == 0 || v->trial[0].without != dazzled)
        vote_begin(v, dazzled);
    for (bool first = true; !calm(v, &v->trial[0]); first = false) {
        struct ballot b;
        uint64_t rest = vote_believed(v, o->out);
        if (vote_count(o->out) >= most || vote_count(rest) < REC_VOTE_LEAST) {
            if (misfit_of(v, &v->trial[0], rest) > TORN * v->unit * vote_count(rest))
                o->state = REC_VOTE_TORN;
            break;
        }
        take_ballot(v, &b);
        note_agreement(v, &b);
        for (size_t c = 0; first && c < v->cameras; c++)
            o->cost[c] = (float)b.cost[c];
        if (first)
            o->doubt = (float)(b.cost[b.top] / limit(v, &b, b.top));
        if (stands_out(v, &b) && !rec_vote_has(regained, b.top) && vote_regain(v, &b, b.top)) {
            regained |= bit(b.top);
            vote_begin(v, o->out);
        } else if (stands_out(v, &b)) {
            vote_leave_out(v, o, &b, b.top);
        } else if (b.cost[b.top] <= TORN) {
            break;
        } else if (vote_count(o->out) + 2 > most || !two_at_once(v, o, &b)) {
            o->state = REC_VOTE_TORN;
            break;
        }
    }
    o->misfit = (float)(rest_of(v) / vote_count(vote_believed(v, o->out)));
}

/* Puts out cameras whose picture is mostly saturated while those of the others are not. */
static void find_dazzled(const rec_vote *v, struct rec_verdict *o)
{
    double share[REC_MAX_CAMERAS] = {0};
    for (size_t c = 0; c < v->cameras; c++)
        share[c] = v->of[c].bins > 0 ? (double)v->of[c].saturated / v->of[c].bins : 0;
    if (vote_median_of(v, vote_believed(v, 0), share) > CLEAR)
        return;
    for (size_t c = 0; c < v->cameras; c++)
        if (v->set->present[c] && share[c] > DAZZLED) {
            o->out |= bit(c);
            o->why[c] = REC_WRONG_FLOODED;
        }
}

/* Sets P; returns whether three cameras see a flame. */
static bool vote_measure(rec_vote *v)
{
    double signal[REC_MAX_CAMERAS] = {0};
    uint64_t lit = 0;
    for (size_t c = 0; c < v->cameras; c++) {
        signal[c] = v->of[c].signal;
        if (v->set->present[c] && v->of[c].lit > 0 && signal[c] > 0)
            lit |= bit(c);
    }
    v->unit = vote_median_of(v, lit, signal);
    return vote_count(lit) >= 3 && v->unit > 0;
}

static void mark_frozen(rec_vote *v, struct rec_verdict *o)
{
    uint64_t frozen = rec_vote_frozen(v);
    for (size_t c = 0; c < v->cameras; c++)
        if (rec_vote_has(frozen, c)) {
            o->out |= bit(c);
            o->why[c] = REC_WRONG_LATE;
        }
}

/* The verdict on a set with a flame.  Returns whether every camera was tested. */
static bool judge_set(rec_vote *v, struct rec_verdict *o)
{
    find_dazzled(v, o);
    mark_frozen(v, o);
    rec_vote_lengths(v);
    bool asked = v->hold == 0 || !as_before(v, o);
    if (asked)
        decide(v, o);
    if (o->state == REC_VOTE_AGREE && o->out != 0)
        o->state = REC_VOTE_OUT;
    return asked;
}

void rec_vote_take(rec_vote *v, struct rec_restrictor *r, const struct rec_vote_set *set,
                   struct rec_verdict *out)
{
    *out = (struct rec_verdict){.state = REC_VOTE_FEW};
    v->set = set;
    int voters = vote_count(vote_believed(v, 0));
    bool asked = true, some = false;
    if (voters >= REC_VOTE_LEAST) {
        v->dark_allowed = voters >= 6 ? 2 : 1;
        rec_vote_light(v);
        some = rec_vote_restrict(v, r);
        rec_vote_pool(v);
        out->state = vote_measure(v) ? REC_VOTE_AGREE : REC_VOTE_DARK;
    }
    if (out->state == REC_VOTE_AGREE && some)
        asked = judge_set(v, out);
    else if (out->state == REC_VOTE_AGREE)
        out->state = REC_VOTE_TORN;
    if (v->hold > 0)
        rec_vote_remember(v, out, asked);
}
