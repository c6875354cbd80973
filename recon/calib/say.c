/* The findings: what the figures mean, in sentences. */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "recon/calib/priv.h"

#define WRONG_PX 0.25 /* what glare or a hidden corner moves at least */

void rec_calib_say(struct calib *k, enum rec_calib_severity severity, enum rec_calib_what what,
                   int camera, uint32_t frame, const char *fmt, ...)
{
    struct rec_calib_report *r = k->out;
    struct rec_calib_finding f = {severity, what, camera, frame, ""}, *more;
    va_list args;
    va_start(args, fmt);
    vsnprintf(f.text, sizeof f.text, fmt, args);
    va_end(args);
    more = realloc(r->finding, (r->n_findings + 1) * sizeof *more);
    if (more == NULL)
        return; /* no room for this sentence; the figures still show its cause */
    r->finding = more;
    size_t at = r->n_findings++;
    for (; at > 0 && more[at - 1].severity < severity; at--)
        more[at] = more[at - 1];
    more[at] = f;
}

const char *rec_calib_last_refused(const struct calib *k)
{
    size_t i = k->out->n_findings;
    while (i > 0 && k->out->finding[i - 1].severity != REC_CALIB_REFUSED)
        i--;
    return i > 0 ? k->out->finding[i - 1].text : "no rig can be had of these views";
}

const char *rec_calib_verdict(const struct rec_uncertainty *u)
{
    if (!(u->px > 0))
        return "does not see the volume";
    return u->voxels_95 <= REC_CALIB_GOOD   ? "good"
           : u->voxels_95 <= REC_CALIB_FAIR ? "just enough"
                                            : "not enough";
}

bool rec_calib_says(const struct rec_calib_report *r, enum rec_calib_severity severity, int what)
{
    for (size_t i = 0; i < r->n_findings; i++)
        if (r->finding[i].severity == severity && (what < 0 || (int)r->finding[i].what == what))
            return true;
    return false;
}

static void calib_say_held(struct calib *k, uint32_t c)
{
    static const char *const names[REC_LENS] = {"fx", "fy", "cx", "cy", "k1",
                                                "k2", "p1", "p2", "k3"};
    const struct rec_calib_of_camera *o = &k->out->camera[c];
    char list[80] = "";
    size_t n = 0;
    if (o->held == 0)
        return;
    for (int i = 0; i < REC_LENS; i++)
        if ((o->held >> i & 1) != 0)
            n += (size_t)snprintf(list + n, sizeof list - n, " %s", names[i]);
    bool focal = (o->held & 3) != 0, inner = (o->held & ~(1u << REC_K2 | 1u << REC_K3)) != 0;
    const char *remedy = focal   ? "tilt the board by 30 to 45 degrees, and show it near and far"
                         : inner ? "show the board in the corners of the picture too"
                                 : "the pictures do not need it";
    rec_calib_say(k, focal ? REC_CALIB_WARNING : REC_CALIB_NOTE, REC_CALIB_HELD, (int)c,
                  REC_NO_FRAME, "%s: these pictures do not tell%s, held at what is usual: %s",
                  k->in->camera[c].name, list, remedy);
}

static void say_pictures(struct calib *k)
{
    static const char *const why[] = {"",
                                      "with ids or places that the board does not have",
                                      "with too few corners",
                                      "given twice",
                                      "in which nothing moved",
                                      "whose corners fit no board",
                                      "that disagree with the other cameras"};
    size_t n[sizeof why / sizeof *why] = {0}, out = 0, len = 0;
    char list[300] = "";
    for (size_t i = 0; i < k->nv; i++) {
        n[k->view[i].fate]++;
        out += k->view[i].fate != REC_VIEW_USED;
    }
    for (size_t i = 1; i < sizeof why / sizeof *why; i++)
        if (n[i] > 0)
            len += (size_t)snprintf(list + len, sizeof list - len, "%s%zu %s", len > 0 ? ", " : "",
                                    n[i], why[i]);
    if (out > 0)
        rec_calib_say(
            k, 4 * out > k->nv && n[REC_VIEW_STILL] < out ? REC_CALIB_WARNING : REC_CALIB_NOTE,
            REC_CALIB_PICTURES, -1, REC_NO_FRAME, "%zu of %zu views are left out: %s", out, k->nv,
            list);
}

/* 4 of 10^5 right corners are taken for wrong, so one in a hundred has another cause.  On pictures without noise that
 * cause is rounding, hundredths of a pixel: those corners are left out too, and nobody need look for glare. */
static void say_wrong(struct calib *k)
{
    size_t wrong = 0, all = 0;
    for (size_t i = 0; i < k->nv; i++) {
        const struct view *v = &k->view[i];
        if (v->fate != REC_VIEW_USED)
            continue;
        all += v->n;
        for (const struct seen *s = k->seen + v->first; s < k->seen + v->first + v->n; s++)
            wrong += s->wrong && !(hypot(s->r[0], s->r[1]) < WRONG_PX);
    }
    if (100 * wrong > all)
        rec_calib_say(k, REC_CALIB_WARNING, REC_CALIB_PICTURES, -1, REC_NO_FRAME,
                      "%zu of %zu corners are wrong and left out: look for blur, glare, or "
                      "something before the "
                      "board",
                      wrong, all);
}

static void say_folds(struct calib *k)
{
    double trained = 0, held = 0;
    for (int i = 0; i < REC_CALIB_FOLDS; i++) {
        trained += k->out->fold[i].trained;
        held += k->out->fold[i].held_out;
    }
    if (isnan(held))
        rec_calib_say(k, REC_CALIB_WARNING, REC_CALIB_HELD_OUT, -1, REC_NO_FRAME,
                      "too few poses to hold some out as a check: show the board in %d or more",
                      2 * REC_CALIB_FOLDS);
    else if (held > 1.2 * trained)
        rec_calib_say(k, REC_CALIB_WARNING, REC_CALIB_HELD_OUT, -1, REC_NO_FRAME,
                      "poses that were held out fit %.2f times worse than the others: there are "
                      "too few, or they "
                      "are too alike",
                      held / trained);
}

bool rec_calib_good(const struct rec_calib_report *r)
{
    bool good = true;
    for (size_t c = 0; c < r->n_cameras; c++)
        good = good && r->camera[c].expected.voxels_95 <= REC_CALIB_GOOD;
    return good;
}

/* Cameras that contradict each other (pictures of different instants, wrong frame numbers, turned pictures, an old rig
 * that no longer holds).  Each view errs as a whole, and n views reduce that to 1 / sqrt(n) at best.  If the rest is a
 * voxel of the volume, nothing can be reconstructed.  If a quarter of a camera's views, left out or not, are off by
 * WILD times its own error, which no motion between two exposures reaches, its pose came from right ones by chance.
 * An own error below SHARP counts as that: with it, motion of a pixel or two would be wild. */
#define WILD  100
#define SHARP 0.1 /* px */
static void say_contradiction(struct calib *k)
{
    const struct rec_calib_report *r = k->out;
    double most = 1, px = 0;
    int worst = -1;
    for (uint32_t c = 0; c < k->nc; c++) {
        const struct rec_calib_of_camera *o = &r->camera[c];
        double voxels = o->expected.px > 0 ? o->expected.voxels / o->expected.px
                        : r->px > 0        ? r->voxels / r->px
                                           : 1;
        double wild = o->gross * fmin(1, o->single / SHARP) / WILD;
        double fit = fmax(o->joint, (wild > 1 ? o->gross : o->over) * o->single);
        double left = fit * voxels / sqrt(fmax((double)o->used, 1));
        left = fmax(left, wild);
        if (fit > 2 * o->single && left > most) {
            most = left;
            px = fit;
            worst = (int)c;
        }
    }
    if (worst >= 0)
        rec_calib_say(
            k, REC_CALIB_REFUSED, REC_CALIB_SYNC, worst, REC_NO_FRAME,
            "the cameras contradict each other: residuals of %s are %.1f px with the others and "
            "%.2f px "
            "alone (%.0f times); see that pictures of one number are of one instant, that none is "
            "turned, mirrored or of another camera, that it is one board, still in each, and that "
            "nothing that was held has moved",
            k->in->camera[worst].name, px, r->camera[worst].single,
            px / fmax(r->camera[worst].single, 1e-3));
}

void rec_calib_verdicts(struct calib *k)
{
    const struct rec_calib_report *r = k->out;
    uint32_t worst = 0;
    while (worst + 1 < k->nc && rec_calib_stays(k, worst))
        worst++;
    for (uint32_t c = 0; c < k->nc; c++) {
        calib_say_held(k, c);
        if (!rec_calib_stays(k, c) &&
            r->camera[c].expected.voxels_95 > r->camera[worst].expected.voxels_95)
            worst = c;
    }
    say_pictures(k);
    if (!rec_calib_says(r, REC_CALIB_REFUSED, -1))
        say_contradiction(k);
    if (r->joint > 1.3 * r->single && !rec_calib_says(r, REC_CALIB_WARNING, REC_CALIB_SYNC) &&
        !rec_calib_says(r, REC_CALIB_REFUSED, -1))
        rec_calib_say(k, REC_CALIB_WARNING, REC_CALIB_SYNC, -1, REC_NO_FRAME,
                      "together the cameras fit %.2f times worse than each alone: something moved, "
                      "or they do not "
                      "expose together; what is expected of the volume is then too good",
                      r->joint / r->single);
    say_wrong(k);
    say_folds(k);
    const struct rec_uncertainty *u = &r->camera[worst].expected;
    const char *name = k->in->camera[worst].name;
    if (!(u->px > 0) && !isfinite(r->px))
        rec_calib_say(k, REC_CALIB_WARNING, REC_CALIB_VERDICT, -1, REC_NO_FRAME,
                      "no camera sees the volume: is it where the world is?");
    else if (u->voxels_95 <= REC_CALIB_FAIR)
        rec_calib_say(k, REC_CALIB_NOTE, REC_CALIB_VERDICT, (int)worst, REC_NO_FRAME,
                      "%s: expected volume error %.3f px, %.3f voxels; with 95 %% below %.3f in "
                      "the worst camera, "
                      "%s, and %.2f is what tomography bears",
                      rec_calib_verdict(u), r->px, r->voxels, u->voxels_95, name, REC_CALIB_FAIR);
    else
        rec_calib_say(k, REC_CALIB_WARNING, REC_CALIB_VERDICT, (int)worst, REC_NO_FRAME,
                      "not enough: expected volume error %.3f px, %.3f voxels; with 95 %% below "
                      "%.3f in the worst "
                      "camera, %s, where %.2f is what tomography bears: show the board to %s in "
                      "more poses, all "
                      "through the volume",
                      r->px, r->voxels, u->voxels_95, name, REC_CALIB_FAIR, name);
}
