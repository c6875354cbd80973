#include "capture/files/pairs.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/mem.h"
#include "capture/files/said.h"

#define RATES 0.01 /* rates that differ by more are said */
#define FEW   0.5  /* share of the possible common frames of two cameras, below which it is said */
#define NONE  0.1  /* below which it is refused */

struct pairing {
    const struct cap_reel *reel;
    const char *const *camera;
    size_t cameras;
    bool times;
    int64_t unit; /* ns of a reel's numbers */
    double step;  /* ns, of the fastest camera */
    size_t fastest;
    int64_t **key;    /* [cameras][n]: frames of one key go together */
    size_t *left_out; /* [cameras] frames that came second at their instant */
    struct cap_pairs *out;
};

static int64_t pairs_time(const struct pairing *w, size_t c, size_t i)
{
    return w->reel[c].frame[i].at * w->unit;
}

/* ---- instants --------------------------------------------------------------------------------- */

static pvx_err pairs_fastest(struct pairing *w, struct pvx_diag *d)
{
    double slowest = 0;
    size_t slow = 0;
    int64_t least = INT64_MAX, most = INT64_MIN;
    for (size_t c = 0; c < w->cameras; c++) {
        const struct cap_reel *r = &w->reel[c];
        if (r->n > 0 && (r->frame[r->n - 1].at > INT64_MAX / 4 / w->unit ||
                         r->frame[0].at < -INT64_MAX / 4 / w->unit)) {
            char room[CAP_REEL_NAME];
            return pvx_fail(d, PVX_ERANGE, "%s: its number is too large for a time in this unit",
                            cap_reel_name(r, r->n - 1, room));
        }
        if (r->n > 0) {
            least = pairs_time(w, c, 0) < least ? pairs_time(w, c, 0) : least;
            most = pairs_time(w, c, 0) > most ? pairs_time(w, c, 0) : most;
        }
        double step = cap_reel_step(r) * (double)w->unit;
        if (step > slowest) {
            slowest = step;
            slow = c;
        }
        if (step > 0 && (!(w->step > 0) || step < w->step * (1 - RATES) ||
                         (step < w->step * (1 + RATES) && r->n > w->reel[w->fastest].n))) {
            w->step = step;
            w->fastest = c;
        }
    }
    while (w->fastest + 1 < w->cameras && w->reel[w->fastest].n == 0)
        w->fastest++;
    if (most > least && !(w->step > 0))
        return cap_said_add(&w->out->said,
                            "no camera has two frames, so that no frame period is known: they are "
                            "taken as one set, though their times are %.4g s apart",
                            (double)(most - least) * 1e-9);
    if (slowest > w->step * (1 + RATES))
        return cap_said_add(
            &w->out->said,
            "%s has %.4g frames a second and %s %.4g: sets come at the higher rate, "
            "and the slower camera is missing in some",
            w->camera[w->fastest], 1e9 / w->step, w->camera[slow], 1e9 / slowest);
    return PVX_OK;
}

/* The instant next to time t, given the place i of the fastest camera's last frame before it, or 0. */
static int64_t pairs_instant(const struct pairing *w, int64_t t, size_t i)
{
    const struct cap_reel *r = &w->reel[w->fastest];
    int64_t from = pairs_time(w, w->fastest, i);
    double step = w->step, after = (double)(t - from);
    if (!(step > 0)) /* no camera has two frames */
        return from;
    if (i + 1 < r->n && t >= from) { /* between two frames: parts as long as the usual step */
        double gap = (double)(pairs_time(w, w->fastest, i + 1) - from);
        step = gap / fmax(1, round(gap / step));
    }
    return from + (step > 0 ? llround(round(after / step) * step) : 0);
}

static void pairs_keys(struct pairing *w, size_t c)
{
    const struct cap_reel *r = &w->reel[c];
    size_t at = 0;
    for (size_t i = 0; i < r->n; i++) {
        int64_t t = pairs_time(w, c, i);
        while (w->times && at + 1 < w->reel[w->fastest].n && pairs_time(w, w->fastest, at + 1) <= t)
            at++;
        w->key[c][i] = w->times ? pairs_instant(w, t, at) : t;
    }
}

/* ---- sets ------------------------------------------------------------------------------------- */

/* The frame of camera c, from place *next on, that is nearest to the instant; -1: none.  *next: the one after it. */
static int64_t pairs_take(struct pairing *w, size_t c, int64_t key, size_t *next)
{
    int64_t best = -1;
    for (; *next < w->reel[c].n && w->key[c][*next] == key; ++*next) {
        int64_t i = (int64_t)*next;
        w->left_out[c] += best >= 0;
        if (best < 0 ||
            llabs(pairs_time(w, c, *next) - key) < llabs(pairs_time(w, c, (size_t)best) - key))
            best = i;
    }
    return best;
}

static pvx_err pairs_room(struct pairing *w)
{
    size_t all = 0;
    struct cap_pairs *p = w->out;
    for (size_t c = 0; c < w->cameras; c++)
        all += w->reel[c].n;
    p->number = pvx_calloc(all, sizeof *p->number);
    p->t_ns = w->times ? pvx_calloc(all, sizeof *p->t_ns) : NULL;
    p->row = pvx_calloc(all * w->cameras, sizeof *p->row);
    return p->number != NULL && p->row != NULL && (!w->times || p->t_ns != NULL) ? PVX_OK
                                                                                 : PVX_ENOMEM;
}

static void pairs_sets(struct pairing *w, size_t *next)
{
    struct cap_pairs *p = w->out;
    for (;; p->n++) {
        bool left = false;
        int64_t key = 0;
        for (size_t c = 0; c < w->cameras; c++)
            if (next[c] < w->reel[c].n && (!left || w->key[c][next[c]] < key)) {
                key = w->key[c][next[c]];
                left = true;
            }
        if (!left)
            return;
        for (size_t c = 0; c < w->cameras; c++)
            p->row[p->n * w->cameras + c] = pairs_take(w, c, key, &next[c]);
        p->number[p->n] = w->times ? (int64_t)p->n : key;
        if (w->times)
            p->t_ns[p->n] = key;
    }
}

/* ---- what is said ----------------------------------------------------------------------------- */

/* How many of camera c's frames are in a set with another camera.  *most: how many there could be. */
static size_t pairs_in_common(const struct pairing *w, size_t c, size_t *most)
{
    size_t n = 0, others = 0;
    for (size_t o = 0; o < w->cameras; o++)
        others = o != c && w->reel[o].n > others ? w->reel[o].n : others;
    *most = others < w->reel[c].n ? others : w->reel[c].n;
    for (size_t k = 0; k < w->out->n; k++) {
        const int64_t *row = &w->out->row[k * w->cameras];
        bool other = false;
        for (size_t o = 0; o < w->cameras; o++)
            other = other || (o != c && row[o] >= 0);
        n += row[c] >= 0 && other;
    }
    return n;
}

static pvx_err pairs_refuse(const struct pairing *w, size_t c, size_t common, struct pvx_diag *d)
{
    size_t other = w->fastest;
    for (size_t k = 0; (other == c || w->reel[other].n == 0) && k < w->cameras; k++)
        other = k;
    const struct cap_reel *r = &w->reel[c], *o = &w->reel[other];
    if (w->times)
        return pvx_fail(
            d, PVX_EINVAL,
            "%s: %zu of its %zu frames are within half a frame period (%.4g ms) of "
            "another camera's: its times go from %.4f to %.4f s, those of %s from "
            "%.4f to %.4f s; their clocks must have one zero%s",
            w->camera[c], common, r->n, w->step * 0.5e-6, (double)pairs_time(w, c, 0) * 1e-9,
            (double)pairs_time(w, c, r->n - 1) * 1e-9, w->camera[other],
            (double)pairs_time(w, other, 0) * 1e-9, (double)pairs_time(w, other, o->n - 1) * 1e-9,
            cap_reel_timed(r) ? ""
                              : "; if one trigger took all frames, rename the files to count "
                                "them, and leave out --numbers");
    return pvx_fail(d, PVX_EINVAL,
                    "%s: %zu of its %zu frames have a number that another camera has too: its "
                    "numbers go from %lld to %lld, those of %s from %lld to %lld; if they are "
                    "times of one clock, say --numbers ms, us or ns; if not, rename the files",
                    w->camera[c], common, r->n, (long long)r->frame[0].at,
                    (long long)r->frame[r->n - 1].at, w->camera[other], (long long)o->frame[0].at,
                    (long long)o->frame[o->n - 1].at);
}

/* Refuse a camera that stands alone, and say which cameras are missing in many sets. */
static pvx_err pairs_judge(struct pairing *w, struct pvx_diag *d)
{
    size_t there = 0;
    bool pages = false;
    for (size_t c = 0; c < w->cameras; c++) {
        there += w->reel[c].n > 0;
        pages = pages || w->reel[c].kind == CAP_REEL_PAGES;
    }
    for (size_t c = 0; c < w->cameras && there > 1; c++) {
        size_t n = w->reel[c].n, most, common = pairs_in_common(w, c, &most), sets = w->out->n;
        if (n == 0)
            continue;
        if (common == 0 || (!w->times && (double)common < NONE * (double)most))
            return pairs_refuse(w, c, common, d);
        if (w->left_out[c] > 0)
            PVX_TRY(cap_said_add(&w->out->said,
                                 "%s: %zu of %zu frames are left out, because another is nearer to "
                                 "their instant",
                                 w->camera[c], w->left_out[c], n));
        size_t lacks = sets - (n - w->left_out[c]);
        if (lacks > 0 && (w->times || pages))
            PVX_TRY(cap_said_add(&w->out->said, "%s has no frame in %zu of %zu sets%s",
                                 w->camera[c], lacks, sets,
                                 pages ? "; stacks are taken to have started together" : ""));
        else if (!w->times && (double)common < FEW * (double)most)
            PVX_TRY(
                cap_said_add(&w->out->said,
                             "%s: only %zu of its %zu frames have a number that another camera "
                             "has too; if the numbers are times of one clock, say --numbers ms, "
                             "us or ns",
                             w->camera[c], common, n));
    }
    return PVX_OK;
}

/* Say where cameras took as many pictures, without a hole, but one counts from 0 and another from 1. */
static pvx_err pairs_from_one(const struct pairing *w)
{
    const struct cap_reel *zero = NULL, *one = NULL;
    size_t a = 0, b = 0;
    for (size_t c = 0; c < w->cameras; c++) {
        const struct cap_reel *r = &w->reel[c];
        int64_t first = r->n > 0 && r->kind == CAP_REEL_PICTURES ? r->frame[0].at : -1;
        if (first < 0 || first > 1 || r->frame[r->n - 1].at != first + (int64_t)r->n - 1)
            continue;
        *(first == 0 ? &zero : &one) = r;
        *(first == 0 ? &a : &b) = c;
    }
    return w->times || zero == NULL || one == NULL || zero->n != one->n
               ? PVX_OK
               : cap_said_add(&w->out->said,
                              "%s counts %zu pictures from 0, %s as many from 1: if they began "
                              "together, rename one camera's files, else its frames are one late",
                              w->camera[a], zero->n, w->camera[b]);
}

/* Pages count from the first file that is there, so cameras with several files must begin with the same one. */
static pvx_err pairs_stacks(const struct pairing *w, struct pvx_diag *d)
{
    const struct cap_reel *first = NULL, *r;
    for (size_t c = 0; c < w->cameras; c++) {
        r = &w->reel[c];
        if (r->n == 0 || r->kind != CAP_REEL_PAGES || r->files < 2 || r->begin < 0)
            continue;
        first = first == NULL ? r : first;
        if (r->begin != first->begin)
            return pvx_fail(d, PVX_EINVAL,
                            "%s is the first file of %s, and %s that of another camera: their "
                            "numbers should be the same; is a file missing before one of them?",
                            r->path[0], w->camera[c], first->path[0]);
    }
    return PVX_OK;
}

/* ---- all -------------------------------------------------------------------------------------- */

static pvx_err pairs_kind(struct pairing *w, enum cap_numbers numbers, struct pvx_diag *d)
{
    static const int64_t unit[] = {1, 1000000, 1000, 1};
    const struct cap_reel *film = NULL, *other = NULL, *own = NULL, *trigger = NULL;
    for (size_t c = 0; c < w->cameras; c++) {
        const struct cap_reel *r = &w->reel[c];
        if (r->n > 0)
            *(cap_reel_timed(r) ? &film : &other) = r;
        if (r->n > 0 && cap_reel_timed(r))
            *(r->kind == CAP_REEL_RAW ? &trigger : &own) = r;
    }
    if (own != NULL && trigger != NULL)
        return pvx_fail(d, PVX_EINVAL,
                        "%s counts its times from its own begin, and %s from its trigger: give all "
                        "cameras films of one of these kinds",
                        own->path[0], trigger->path[0]);
    if (film != NULL && other != NULL)
        return pvx_fail(d, PVX_EINVAL,
                        "%s is a film, but %s has only a number: give all cameras films, or all "
                        "pictures",
                        film->path[0], other->path[0]);
    w->times = film != NULL || numbers != CAP_NUMBERS_COUNT;
    w->unit = film != NULL ? 1 : unit[numbers];
    for (size_t c = 0; c < w->cameras && numbers != CAP_NUMBERS_COUNT; c++)
        if (w->reel[c].n > 0 && w->reel[c].kind == CAP_REEL_PAGES)
            return pvx_fail(d, PVX_EINVAL,
                            "%s: the pages of a file have no times: leave out "
                            "--numbers",
                            w->reel[c].path[0]);
    return PVX_OK;
}

pvx_err cap_pairs_find(const struct cap_reel *reel, const char *const *camera, size_t cameras,
                       enum cap_numbers numbers, bool apart, struct cap_pairs *out,
                       struct pvx_diag *d)
{
    struct pairing w = {.reel = reel, .camera = camera, .cameras = cameras, .out = out};
    *out = (struct cap_pairs){0};
    PVX_TRY(pairs_kind(&w, numbers, d));
    PVX_TRY(pairs_from_one(&w));
    if (!apart)
        PVX_TRY(pairs_stacks(&w, d));
    if (w.times)
        PVX_TRY(pairs_fastest(&w, d));
    size_t *next = pvx_calloc(cameras, sizeof *next);
    w.left_out = pvx_calloc(cameras, sizeof *w.left_out);
    w.key = pvx_calloc(cameras, sizeof *w.key);
    pvx_err e = next != NULL && w.left_out != NULL && w.key != NULL ? pairs_room(&w) : PVX_ENOMEM;
    for (size_t c = 0; c < cameras && e == PVX_OK; c++) {
        w.key[c] = pvx_calloc(reel[c].n, sizeof **w.key);
        if (w.key[c] != NULL)
            pairs_keys(&w, c);
        else
            e = PVX_ENOMEM;
    }
    if (e == PVX_OK)
        pairs_sets(&w, next);
    if (e == PVX_OK && !apart)
        e = pairs_judge(&w, d);
    for (size_t c = 0; c < cameras && w.key != NULL; c++)
        free(w.key[c]);
    free(w.key);
    free(w.left_out);
    free(next);
    return e;
}

void cap_pairs_free(struct cap_pairs *p)
{
    PVX_FREE(p->number);
    PVX_FREE(p->t_ns);
    PVX_FREE(p->row);
    PVX_FREE(p->said);
    p->n = 0;
}
